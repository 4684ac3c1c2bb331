"""Taking out what the data do not tell, one parameter at a time, so that it does not blur the rest.

A rate limit whose interval reaches "no limit" is held at the vehicle's value if the data allow that, and
at no limit otherwise. A time constant near zero has no slope (a short lag delays a ramp as a dead time does):
its interval is that of the profile, where the cost with T_1 held and all others refitted rises by what chance
would. What then holds only beside a held parameter says so. Held by `tests/test_motor_dynamics.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from seatrial.motor_dynamics.evidence import Reason, unseen_rates, wide
from seatrial.motor_dynamics.motor_certainty import NORMAL, MotorCertainty, certainty
from seatrial.motor_dynamics.motor_fit import Fit, Problem, fit, spread
from seatrial.motor_dynamics.motor_model import NAMES, MotorModel, symbol
from seatrial.motor_dynamics.plateaus import Noise
from seatrial.motor_dynamics.readings import Reading

__all__ = ["Found", "eliminated"]

Array = NDArray[np.float64]

_CHANCE = 2.0 * NORMAL**2  # rise of the squared errors, in variances; doubled because errors are coloured
_LONGEST = 40.0  # samples at which the search for the longest lag ends
_HALVINGS = 8
_LAG, _DELAY = NAMES.index("T_1"), NAMES.index("T_t")


@dataclass(frozen=True)
class Found:
    """A fit without what is not determined: the reasons by name, and remarks on the others."""

    problem: Problem
    best: Fit
    known: MotorCertainty
    reasons: dict[str, Reason]
    remarks: dict[str, str]


def eliminated(reading: Reading, noise: Noise, prior: MotorModel | None) -> Found:
    """The fit of a reading without rate limits and a time constant that the data do not tell."""
    problem, best, reasons = reading.problem, reading.best, dict(reading.reasons)
    sample = float(np.median([record.sample_s for record in problem.records]))
    known = certainty(problem, best.x, noise)
    blurred = set(wide(best.x, known, sample))
    held: list[str] = []
    while unseen := unseen_rates(best.x, known, problem.free):
        name, reasons[name] = next(iter(unseen.items()))
        problem, best = _hold(problem, best, NAMES.index(name), prior, otherwise=0.0)
        known = certainty(problem, best.x, noise)
        held.append(symbol(name))
    if "T_1" in wide(best.x, known, sample):
        problem, best, known = _near_zero(problem, best, noise, prior, sample, reasons)
    reasons |= {name: reason for name, reason in wide(best.x, known, sample).items() if name not in reasons}
    beside = f"it holds for {', '.join(held)} as in the fit" if held else ""
    remarks = {name: beside for name in blurred if beside and name not in reasons}
    return Found(problem, best, known, reasons, remarks)


def _near_zero(
    problem: Problem,
    best: Fit,
    noise: Noise,
    prior: MotorModel | None,
    sample: float,
    reasons: dict[str, Reason],
) -> tuple[Problem, Fit, MotorCertainty]:
    """The fit with T_1 held, and T_1's interval from its profile where that is shorter than a sample."""
    longest = _longest_lag(problem, best, sample)
    if longest <= sample:
        problem, best = _hold(problem, best, _LAG, None, otherwise=float(best.x[_LAG]))
    else:
        reasons["T_1"] = Reason(
            "a longer one fits as well beside another dead time and other rates; steps of several sizes, some"
            " too small for the rate limit to matter, would tell it",
            at_most=longest if math.isfinite(longest) else None,
        )
        problem, best = _hold(problem, best, _LAG, prior, otherwise=float(best.x[_LAG]))
    known = certainty(problem, best.x, noise)
    sigma, half, dof = known.sigma.copy(), known.half.copy(), known.dof.copy()
    sigma[_LAG], half[_LAG], dof[_LAG] = longest / NORMAL, max(longest - best.x[_LAG], 0.0), math.inf
    # What the lag may be longer, the dead time is shorter.
    sigma[_DELAY], half[_DELAY] = math.hypot(sigma[_DELAY], sigma[_LAG]), math.hypot(half[_DELAY], half[_LAG])
    return problem, best, replace(known, sigma=sigma, half=half, dof=dof)


def _longest_lag(problem: Problem, best: Fit, sample: float) -> float:
    """Longest time constant in s that the data allow with all others refitted; infinite if all are."""
    length = max(float(best.x[_LAG]), 0.02 * sample)
    while _allowed(problem, best, _LAG, length):
        length *= 2.0
        if length > _LONGEST * sample:
            return math.inf
    shorter = float(best.x[_LAG])
    for _ in range(_HALVINGS):
        middle = 0.5 * (shorter + length)
        if _allowed(problem, best, _LAG, middle):
            shorter = middle
        else:
            length = middle
    return length


def _hold(
    problem: Problem, best: Fit, k: int, prior: MotorModel | None, *, otherwise: float
) -> tuple[Problem, Fit]:
    """The problem with a coordinate held at the vehicle's if the data allow it, and its fit."""
    value = otherwise
    if prior is not None:
        kept = float(prior.coordinates()[k])
        value = kept if math.isfinite(kept) and _allowed(problem, best, k, kept) else otherwise
    return _refitted(problem, best, k, value)


def _allowed(problem: Problem, best: Fit, k: int, value: float) -> bool:
    """Whether the cost with a coordinate held rises by no more than chance."""
    held = _refitted(problem, best, k, value)[1]
    size = max(spread(problem.errors(best.x)), 1e-12)
    return 2.0 * (held.cost - best.cost) * (problem.knee / size) ** 2 <= _CHANCE


def _refitted(problem: Problem, best: Fit, k: int, value: float) -> tuple[Problem, Fit]:
    """The problem with a coordinate held at a value, and its fit from the present one."""
    base, free = best.x.copy(), problem.free.copy()
    base[k], free[k] = value, False
    problem = replace(problem, base=base, free=free)
    points = [np.where(free, best.x, base)]
    if k == _LAG:
        # A longer lag wants a shorter dead time: start there too.
        moved = points[0].copy()
        moved[_DELAY] = max(moved[_DELAY] + float(best.x[k]) - value, 0.0)
        points.append(np.where(free, moved, base))
    again = fit(problem, points)
    return problem, replace(again, starts=best.starts, agreeing=best.agreeing)
