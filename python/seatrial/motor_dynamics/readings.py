"""The two readings of commands below the minimum, lift and dead band, each fitted to the same records.

The knee of the robust loss comes from the errors of the first, where the motor moves: on plateaus alone it
would be the measurement's noise, and what rotors do beside a PT1 would count as outliers.

With a robust loss, single values far beyond are left out of the better reading: missed counts read zero, all
on one side, and Huber's loss limits their pull but keeps it. A run of such values is no missed count but
something that the chain does not know; it stays.
Held by `tests/test_motor_dynamics.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from seatrial.motor_dynamics.dead_band import edges
from seatrial.motor_dynamics.evidence import Reason, reachable
from seatrial.motor_dynamics.motor_fit import Fit, Loss, Problem, fit, spread
from seatrial.motor_dynamics.motor_model import NAMES, MotorModel
from seatrial.motor_dynamics.plateaus import Noise, Plateau, Statics
from seatrial.motor_dynamics.start_values import starts
from seatrial.motor_dynamics.step_record import StepRecord

__all__ = ["Reading", "Readings", "readings"]

Array = NDArray[np.float64]

_STARTS = 4
_KNEE = 1.5  # standard deviations: Huber's loss keeps 96 % of the efficiency for normal errors
_GROSS, _MOST_GROSS = 8.0, 0.1  # standard deviations of a gross error; largest part of the values
_RUN = 3  # values in a row that may be missed counts
_MINIMUM = [NAMES.index("n_min_ahead"), NAMES.index("n_min_astern")]


@dataclass(frozen=True)
class Reading:
    """A problem with its best fit, and why the commands cannot tell the parameters that were not free."""

    problem: Problem
    best: Fit
    reasons: dict[str, Reason]


@dataclass(frozen=True)
class Readings:
    """The better reading, and the cost of the other over its own; None where there is no other."""

    better: Reading
    ratio: float | None


def readings(
    records: tuple[StepRecord, ...], settled: Sequence[Plateau], shown: Statics, noise: Noise, loss: Loss
) -> Readings:
    """The better reading of commands below the minimum, or the only one where there are no such commands."""
    reasons = reachable(records, settled, shown, dead_band=False)
    free = np.array([name not in reasons for name in NAMES])
    base = MotorModel(shown.gain, 0.0, 0.0, shown.n_min, shown.n_max).coordinates()
    problem = Problem(records, base, free, _KNEE * noise.total, loss, dead_band=False)
    points = starts(records, shown, noise, cost=problem.cost, wanted=_STARTS)
    first = fit(problem, points)
    problem = replace(problem, knee=_KNEE * _size_of_errors(problem, first.x, noise))
    again = fit(problem, [first.x])
    lift = Reading(problem, replace(again, starts=first.starts, agreeing=first.agreeing), reasons)
    if max(*shown.n_min, *shown.dropped) <= 0:
        return Readings(_cleaned(lift, noise), None)
    free = free.copy()
    free[_MINIMUM] = False
    problem = replace(problem, base=edges(problem, lift.best.x), free=free, dead_band=True)
    best = fit(problem, [np.where(free, x, problem.base) for x in (lift.best.x, *points[:1])])
    drop = Reading(problem, best, reachable(records, settled, shown, dead_band=True))
    better, other = sorted([lift, drop], key=lambda one: one.best.cost)
    return Readings(_cleaned(better, noise), other.best.cost / max(better.best.cost, 1e-12))


def _cleaned(reading: Reading, noise: Noise) -> Reading:
    """The reading refitted without single gross errors, where the loss is robust."""
    problem, best = reading.problem, reading.best
    limit = _GROSS * _size_of_errors(problem, best.x, noise)
    if problem.loss == "none":
        return reading
    kept, found = [], 0
    for record in problem.records:
        times, measured = record.sampled
        bad = _single(np.abs(measured - problem.model(best.x).response(record, times)) > limit)
        found += int(bad.sum())
        stamps = np.asarray(record.t_measured)
        values = np.where(np.isin(stamps, times[bad]), np.nan, np.asarray(record.measured))
        kept.append(replace(record, measured=values) if bad.mean() <= _MOST_GROSS else record)
    if not found:
        return reading
    problem = replace(problem, records=tuple(kept))
    again = fit(problem, [best.x])
    return replace(reading, problem=problem, best=replace(again, starts=best.starts, agreeing=best.agreeing))


def _single(far: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Marks of values in runs that are short enough for missed counts."""
    borders = np.flatnonzero(np.diff(np.concatenate([[False], far, [False]]).astype(int)))
    kept = np.zeros_like(far)
    for start, end in borders.reshape(-1, 2):
        kept[start:end] = end - start <= _RUN
    return kept


def _size_of_errors(problem: Problem, x: Array, noise: Noise) -> float:
    """Standard deviation of the errors, the greater of all and of those while the motor moves."""
    errors, model = problem.errors(x), problem.model(x)
    moving = []
    for record in problem.records:
        at, near = record.sampled[0], 0.5 * record.sample_s
        change = model.response(record, at + near) - model.response(record, at - near)
        moving.append(np.abs(change) > 2.0 * noise.total)
    moved = errors[np.concatenate(moving)]
    return max(spread(errors), spread(moved) if len(moved) else 0.0, noise.total)
