"""Exact derivatives of the chain against central differences and CasADi's forward sensitivities, in one run.

Every contender gives the derivatives of nine channels (velocities and place) at every sample by coefficients
of CWolf, on one core. A rate counts time steps times unknowns per second. Central differences fly twice per
unknown: in plain numbers, or eight candidates to a vector, which gives the criterion alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.casadi_compiled import COMPILER
from benchmarks.casadi_forward import DIRECTIONS, Forward
from benchmarks.casadi_model import expressions
from benchmarks.speed import REST, seconds
from benchmarks.workload import STEP_S, SUBSTEPS, chain
from seatrial.base.channels import CHANNELS

ASKED = CHANNELS[:9]
# Hull, restoring, propeller and motor.
EIGHT = ("m", "X_udot", "X_uu", "N_rr", "z_b", "SbU.gain", "PU.p1_ahead", "SbL.T_1")
STEP = 1e-6


@dataclass(frozen=True)
class Derivatives:
    """Rates in steps times unknowns per second, and how far the contenders' derivatives are apart.

    Apart: the largest difference relative to the largest derivative of each channel and unknown.
    """

    rates: dict[str, float]
    apart_casadi: float
    apart_differences: float


def measure(*, rounds: int = 5, samples: int = 1201, compiler: Sequence[str] = COMPILER) -> Derivatives:
    """Return rates and agreement on a log of so many samples; the best of the rounds counts."""
    work = chain(samples)
    names, core = work.names(), work.open_loop()
    own, unknowns = work.own(), np.eye(len(names))
    eight = np.array([unknowns[names.index(name)] for name in EIGHT])
    beside = np.vstack([own + STEP * own * unknowns, own - STEP * own * unknowns])
    forward = Forward(expressions(work.parameters, STEP_S), compiler=compiler)
    contenders: dict[str, tuple[int, Callable[[], object]]] = {
        "exact": (len(names), lambda: core.sensitivities(own, unknowns, channels=list(ASKED), threads=1)),
        "exact, eight unknowns": (
            DIRECTIONS,
            lambda: core.sensitivities(own, eight, channels=list(ASKED), threads=1),
        ),
        "central differences": (1, lambda: [core.predict(own, threads=1) for _ in range(2)]),
        "central differences in lanes": (len(names), lambda: core.errors(beside, threads=1)),
        "CasADi forward": (DIRECTIONS, lambda: forward.run(work.t, work.commands, EIGHT, state=REST)),
    }
    best = dict.fromkeys(contenders, np.inf)
    for _ in range(rounds):
        for name, (_, run) in contenders.items():
            best[name] = min(best[name], seconds(run))
    ((_, exact),) = core.sensitivities(own, eight, channels=list(ASKED))
    _, found = forward.run(work.t, work.commands, EIGHT, state=REST)
    by_casadi = found[SUBSTEPS - 1 :: SUBSTEPS, [7, 8, 9, 10, 11, 12, 0, 1, 2]]
    steps = STEP * np.abs(eight @ own)
    by_difference = np.stack(
        [
            (core.predict(own + h * d)[0] - core.predict(own - h * d)[0])[:, : len(ASKED)] / (2.0 * h)
            for h, d in zip(steps, eight, strict=True)
        ],
        axis=2,
    )
    return Derivatives(
        rates={name: size * work.steps / best[name] for name, (size, _) in contenders.items()},
        apart_casadi=apart(by_casadi, exact[1:]),
        apart_differences=apart(by_difference, exact),
    )


def apart(found: np.ndarray, expected: np.ndarray) -> float:
    """Return the largest difference relative to the largest entry of each channel and unknown."""
    size = np.maximum(np.abs(expected).max(axis=0), np.finfo(float).tiny)
    return float((np.abs(found - expected) / size).max())
