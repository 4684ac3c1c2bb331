"""CasADi's forward sensitivities of the compiled chain: eight directions beside the state, in one C function.

The derivative of a step is CasADi's own (``jtimes`` of the expressions along eight seeds, common
subexpressions once), generated to C and compiled like the model itself. The dead times are read from the
record beforehand and are not differentiated.
Held by tests/benchmarks/test_benchmark_derivatives.py: derivatives equal the core's.
"""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmarks.casadi_compiled import COMPILER
from benchmarks.casadi_model import STATES, Expressions, ca
from benchmarks.textbook_thrusters import static_limits

Array: TypeAlias = NDArray[np.float64]

DIRECTIONS = 8
DRIVER = """
#include <string.h>
#define A {thrusters}

/* n steps; p and c with their seeds (columns), delayed commands u n x A, wrench tau of 6, state x0.
   Out: per step state (13) and its derivatives (13 x 8, columns). */
void flight(int n, const double *p, const double *c, const double *p_seed, const double *c_seed,
            const double *u, const double *tau, const double *v_c, const double *x0, double *states,
            double *derivatives) {{
    static casadi_int iw[{iw} + 1];
    static casadi_real w[{w} + 1];
    static double x[13], motor[2 * A + 1], X[13 * 8], M[2 * A * 8 + 1];
    static double next[13], next_motor[2 * A + 1], next_X[13 * 8], next_M[2 * A * 8 + 1];
    memcpy(x, x0, sizeof x);
    memset(motor, 0, sizeof motor);
    memset(X, 0, sizeof X);
    memset(M, 0, sizeof M);
    for (int k = 0; k < n; k++) {{
        const double *arg[{arg}] = {{x, motor, u + A * k, tau, v_c, p, c, X, M, p_seed, c_seed}};
        double *res[{res}] = {{next, next_motor, next_X, next_M}};
        forward_step(arg, res, iw, w, 0);
        memcpy(x, next, sizeof x);
        memcpy(motor, next_motor, sizeof motor);
        memcpy(X, next_X, sizeof X);
        memcpy(M, next_M, sizeof M);
        memcpy(states + 13 * k, x, sizeof x);
        memcpy(derivatives + 13 * 8 * k, X, sizeof X);
    }}
}}
"""


class Forward:
    """The compiled step with eight directions; the library lives as long as the object."""

    def __init__(self, expressions: Expressions, *, compiler: Sequence[str] = COMPILER) -> None:
        """Differentiate, generate and compile with a command line to which output and input are added.

        Raises
        ------
        subprocess.CalledProcessError
            The compiler refuses the code.
        """
        self.expressions = e = expressions
        a, coefficients, constants = len(e.thrusters), len(e.names), e.constants.numel_out(0)
        sizes = {"x": STATES, "motor": 2 * a, "p": coefficients, "c": constants}
        at = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
        seed = {name: ca.SX.sym(f"{name}_seed", size, DIRECTIONS) for name, size in sizes.items()}
        u, tau, v_c = ca.SX.sym("u", a), ca.SX.sym("tau", 6), ca.SX.sym("v_c", 3)
        after = e.step(at["x"], at["motor"], u, tau, v_c, at["p"], at["c"])
        along = ca.jtimes(ca.vertcat(*after), ca.vertcat(*at.values()), ca.vertcat(*seed.values()))
        outputs = [*after, along[:STATES, :], along[STATES:, :]]
        inputs = [at["x"], at["motor"], u, tau, v_c, at["p"], at["c"], *seed.values()]
        function = ca.Function("forward_step", inputs, ca.cse([ca.densify(output) for output in outputs]))
        self._constants_by_p = ca.Function("by_p", [at["p"]], [ca.jacobian(e.constants(at["p"]), at["p"])])
        self._folder = tempfile.TemporaryDirectory()
        folder = Path(self._folder.name)
        generator = ca.CodeGenerator("forward.c")
        generator.add(function)
        generator.generate(f"{folder}/")
        work = {name: getattr(function, f"sz_{name}")() for name in ("arg", "res", "iw", "w")}
        source = folder / "forward.c"
        source.write_text(source.read_text() + DRIVER.format(thrusters=a, **work))
        subprocess.run([*compiler, "-o", str(folder / "forward.so"), str(source), "-lm"], check=True)
        self._flight: Any = ctypes.CDLL(str(folder / "forward.so")).flight

    def run(
        self, t: ArrayLike, commands: Mapping[str, ArrayLike], names: Sequence[str], *, state: ArrayLike
    ) -> tuple[Array, Array]:
        """Return states (n, 13) and derivatives (n, 13, 8) by eight coefficients, after every step.

        Parameters
        ----------
        t : (samples,)
            Uniform time in s, a multiple of the step apart; n = (samples - 1) steps per sample.
        commands : {name: (samples,)}
            In rpm, held from sample to sample; actuators start at rest.
        names : (8,)
            Coefficients, no dead times among them.
        state : (13,)
            Position, quaternion and velocities at the first sample.
        """
        e, t = self.expressions, np.asarray(t, dtype=float)
        substeps = round(float(t[1] - t[0]) / e.h)
        n = (len(t) - 1) * substeps
        u = np.zeros((n, len(e.thrusters)))
        for i, thruster in enumerate(e.thrusters):
            held = np.repeat(static_limits(thruster, commands[thruster.name])[:-1], substeps)
            dead = e.values[e.names.index(f"{thruster.name}.T_t")] / e.h if thruster.T_t > 0.0 else 0.0
            # Linear between steps, at rest before the record.
            u[:, i] = np.interp(np.arange(n) - dead, np.arange(-1, n), np.append(0.0, held), left=0.0)
        p_seed = np.zeros((DIRECTIONS, len(e.names)))
        p_seed[np.arange(DIRECTIONS), [e.names.index(name) for name in names]] = 1.0
        c_seed = p_seed @ np.asarray(self._constants_by_p(e.values)).T
        states, derivatives = np.empty((n, STATES)), np.empty((n, DIRECTIONS, STATES))
        constants = np.asarray(e.constants(e.values)).ravel()
        given = [e.values, constants, p_seed, c_seed, u, np.zeros(6), np.zeros(3), state]
        arrays = [np.ascontiguousarray(x, dtype=float) for x in given]
        self._flight(n, *(ctypes.c_void_p(x.ctypes.data) for x in [*arrays, states, derivatives]))
        return states, derivatives.transpose(0, 2, 1)
