"""The CasADi expressions compiled to C (-O3 -march=native) and mapped over candidates by a loop in C.

Per candidate: the dead time on the shared record, RK4, and the sum of weighted absolute errors per channel;
the trajectory only where it is asked for.
Held by tests/core/test_casadi_model.py.
"""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmarks.casadi_model import CHANNELS, STATES, Expressions, ca
from benchmarks.textbook_thrusters import static_limits

Array: TypeAlias = NDArray[np.float64]

COMPILER = (
    "gcc",
    "-Werror=implicit-function-declaration",
    "-O3",
    "-march=native",
    "-fPIC",
    "-shared",
    "-fno-semantic-interposition",
)
DRIVER = """
#include <string.h>
#define A {thrusters}
#define P {coefficients}
#define C {constants}

/* k candidates p (k x P), dead times in steps (k x A); record: n samples of s steps, held commands
   (n-1)*s x A, wrench n x 6, measured channels and weights n x 12; state x0.
   Out: cost k x 12 and, unless it is null, the trajectory k x n x 13. */
void map(int k, int n, int s, const double *p, const double *dead, const double *held, const double *before,
         const double *tau, const double *v_c, const double *x0, const double *observed, const double *weight,
         double *cost, double *trajectory) {{
    static casadi_int iw[{iw} + 1];
    static casadi_real w[{w} + 1];
    for (int candidate = 0; candidate < k; candidate++, p += P, dead += A, cost += 12) {{
        double c[C + 1], x[13], motor[2 * A + 1], u[A + 1], next[13], next_motor[2 * A + 1], y[12];
        const double *arg_c[{arg}] = {{p}};
        double *res_c[{res}] = {{c}};
        model_constants(arg_c, res_c, iw, w, 0);
        memcpy(x, x0, sizeof x);
        for (int i = 0; i < 2 * A; i++) motor[i] = before[i];
        for (int i = 0; i < 12; i++) cost[i] = 0.0;
        for (int sample = 0; sample < n; sample++) {{
            const double *arg_y[{arg}] = {{x}};
            double *res_y[{res}] = {{y}};
            model_channels(arg_y, res_y, iw, w, 0);
            for (int i = 0; i < 12; i++) {{
                double e = weight[12 * sample + i] * (observed[12 * sample + i] - y[i]);
                cost[i] += e < 0.0 ? -e : e;
            }}
            if (trajectory) {{ memcpy(trajectory, x, sizeof x); trajectory += 13; }}
            if (sample == n - 1) break;
            for (int j = sample * s; j < (sample + 1) * s; j++) {{
                for (int i = 0; i < A; i++) {{
                    int whole = (int)dead[i], at = j - whole;
                    double part = dead[i] - whole;
                    double late = at >= 0 ? held[at * A + i] : before[2 * i];
                    double later = at >= 1 ? held[(at - 1) * A + i] : before[2 * i];
                    u[i] = (1.0 - part) * late + part * later;
                }}
                const double *arg[{arg}] = {{x, motor, u, tau + 6 * sample, v_c, p, c}};
                double *res[{res}] = {{next, next_motor}};
                model_step(arg, res, iw, w, 0);
                memcpy(x, next, sizeof x);
                for (int i = 0; i < 2 * A; i++) motor[i] = next_motor[i];
            }}
        }}
    }}
}}
"""


class Compiled:
    """Compiled expressions of one vehicle and step length; the library lives as long as the object."""

    def __init__(self, expressions: Expressions) -> None:
        """Generate and compile the C code.

        Raises
        ------
        subprocess.CalledProcessError
            The compiler refuses the code.
        """
        self.expressions = expressions
        self._folder = tempfile.TemporaryDirectory()
        folder = Path(self._folder.name)
        functions = (expressions.constants, expressions.step, expressions.channels)
        generator = ca.CodeGenerator("model.c")
        for function in functions:
            generator.add(function)
        generator.generate(f"{folder}/")
        work = {
            name: max(getattr(f, f"sz_{name}")() for f in functions) for name in ("arg", "res", "iw", "w")
        }
        driver = DRIVER.format(
            thrusters=len(expressions.thrusters),
            coefficients=len(expressions.names),
            constants=expressions.constants.numel_out(0),
            **work,
        )
        source = folder / "model.c"
        source.write_text(source.read_text() + driver)
        subprocess.run([*COMPILER, "-o", str(folder / "model.so"), str(source), "-lm"], check=True)
        self._map: Any = ctypes.CDLL(str(folder / "model.so")).map

    def run(
        self,
        values: ArrayLike,
        t: ArrayLike,
        commands: Mapping[str, ArrayLike],
        *,
        state: ArrayLike,
        tau: ArrayLike | None = None,
        current: ArrayLike = (0.0, 0.0, 0.0),
        observed: ArrayLike | None = None,
        weight: ArrayLike | None = None,
        trajectory: bool = False,
    ) -> tuple[Array, Array | None]:
        """Return the cost (k, 12) of all candidates and, if asked for, their states (k, n, 13).

        Parameters
        ----------
        values : (k, coefficients)
            In the order of ``expressions.names``.
        t : (n,)
            Uniform time in s, a multiple of the step apart.
        commands : {name: (n,)}
            In rpm, held from sample to sample; actuators start at rest.
        state : (13,)
            Position, quaternion and velocities at the first sample.
        tau, current, observed, weight
            Direct wrench (n, 6), constant current NED (3,), measured channels and weights (n, 12).
        trajectory : bool
            Keep the states.
        """
        e = self.expressions
        p, t = np.ascontiguousarray(values, dtype=float), np.asarray(t, dtype=float)
        k, n = len(p), len(t)
        substeps = round(float(t[1] - t[0]) / e.h)
        dead = np.zeros((k, len(e.thrusters)))
        held = np.zeros(((n - 1) * substeps, len(e.thrusters)))
        for i, thruster in enumerate(e.thrusters):
            if (name := f"{thruster.name}.T_t") in e.names:
                dead[:, i] = p[:, e.names.index(name)] / e.h
            limited = static_limits(thruster, commands[thruster.name])
            held[:, i] = np.repeat(limited[:-1], substeps)
        zero = np.zeros((n, CHANNELS))
        cost = np.empty((k, CHANNELS))
        states = np.empty((k, n, STATES)) if trajectory else None
        inputs = [
            p,
            dead,
            held,
            np.zeros(2 * len(e.thrusters)),
            np.zeros((n, 6)) if tau is None else tau,
            current,
            state,
            zero if observed is None else observed,
            zero if weight is None else weight,
        ]
        arrays = [np.ascontiguousarray(x, dtype=float) for x in inputs]
        pointers = [ctypes.c_void_p(x.ctypes.data) for x in [*arrays, cost]]
        kept = ctypes.c_void_p(None if states is None else states.ctypes.data)
        self._map(k, n, substeps, *pointers, kept)
        return cost, states
