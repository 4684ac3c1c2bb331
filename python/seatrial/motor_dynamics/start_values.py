"""Start values of a motor's dynamics from its step responses, and the grid from which the fit starts.

From 20 to 80 % a pure lag takes ``T_1 ln 4``, a pure ramp 0.6 of its length ``step * s`` (s the reciprocal
rate limit); their squares add nearly, as those of any two responses in a row, so that the widths of steps of
several sizes give T_1 and one s per direction by non-negative least squares. The dead time is no later than
the time to 20 %: a grid of fractions of a sample up to there is judged by the criterion, because the cost
has several minima in T_t, one between any two crossings of samples.
Held by `tests/test_motor_dynamics.py`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seatrial.motor_dynamics.motor_model import NAMES, MotorModel
from seatrial.motor_dynamics.plateaus import Noise, Statics
from seatrial.motor_dynamics.step_record import StepRecord

__all__ = ["Transition", "limited", "starts", "transitions"]

Array = NDArray[np.float64]

_CLEAR = 10.0  # standard deviations of the noise that a step must exceed
_SETTLED = 0.15  # part of the step by which the revolutions may miss their level before it
_LN4 = math.log(4.0)
_PER_SAMPLE = 4  # points of the grid of dead times per sample
_MOST_DELAYS = 48
_LAG_FACTORS = (0.4, 0.75, 1.0, 1.5)
_RAMP_FACTORS = (1.0, 0.75, 0.3)


@dataclass(frozen=True)
class Transition:
    """A step from level to level of the limited command, s from the command's stamp.

    ``rate`` is the index of its rate limit among the parameters, None for a reversal.
    """

    size: float
    rate: int | None
    to_20: float
    to_80: float


def limited(command: float, low: tuple[float, float], high: tuple[float, float]) -> float:
    """Command after the static limits, lifted below the minimum.

    Examples
    --------
    >>> limited(-30.0, (150.0, 140.0), (2000.0, 1900.0))
    -140.0
    """
    side = int(command < 0)
    if command == 0:
        return 0.0
    return math.copysign(min(max(abs(command), low[side]), high[side]), command)


def transitions(records: Sequence[StepRecord], found: Statics, noise: Noise) -> list[Transition]:
    """Steps that start from a settled motor and reach 80 % before the next one."""
    kept = []
    for record in records:
        stamps, commands = record.held
        times, measured = record.sampled
        levels = [limited(float(c), found.n_min, found.n_max) for c in commands]
        for k in range(1, len(stamps)):
            before, after = levels[k - 1], levels[k]
            end = stamps[k + 1] if k + 1 < len(stamps) else math.inf
            rows = (times >= stamps[k]) & (times < end)
            clear = found.gain * abs(after - before) > _CLEAR * noise.total
            if not clear or rows.sum() < 3:
                continue
            part = (measured[rows] / found.gain - before) / (after - before)
            if abs(part[0]) > _SETTLED:
                continue
            passed = [_crossing(times[rows] - stamps[k], part, share) for share in (0.2, 0.8)]
            if all(math.isfinite(one) for one in passed):
                kept.append(Transition(abs(after - before), _rate(before, after), passed[0], passed[1]))
    return kept


def starts(
    records: Sequence[StepRecord],
    found: Statics,
    noise: Noise,
    *,
    cost: Callable[[Array], float],
    wanted: int,
) -> list[Array]:
    """The best start points (11,) of the grid by their cost, each in another place, best first."""
    seen = transitions(records, found, noise)
    sample = float(np.median([record.sample_s for record in records]))
    lag, ramps = _widths(seen, sample)
    latest = float(np.median([one.to_20 for one in seen])) if seen else 4.0 * sample
    delays = np.arange(0.0, latest + sample, sample / _PER_SAMPLE)
    delays = delays[:: max(1, math.ceil(len(delays) / _MOST_DELAYS))]
    grid: list[tuple[float, int, Array]] = []
    for delay, longer, steeper in itertools.product(delays, _LAG_FACTORS, _RAMP_FACTORS):
        x = MotorModel(found.gain, longer * lag, float(delay), found.n_min, found.n_max).coordinates()
        x[7:] = steeper * ramps
        grid.append((cost(x), len(grid), x))
    grid.sort()
    kept: list[Array] = []
    for _, _, x in grid:
        # Starts that differ in neither dead time nor lag run into the same minimum.
        if all(abs(x[2] - y[2]) > 0.6 * sample or abs(x[1] / y[1] - 1.0) > 0.2 for y in kept):
            kept.append(x)
        if len(kept) == wanted:
            break
    return kept


def _rate(before: float, after: float) -> int | None:
    """Index of the rate limit that a step meets."""
    if before * after < 0:
        return None
    growing = abs(after) > abs(before)
    side = int(min(before, after) < 0)
    return NAMES.index("n_acc_ahead" if growing else "n_dec_ahead") + side


def _crossing(times: Array, part: Array, share: float) -> float:
    """Time at which a response first passes a share of its step, linear between samples."""
    above = np.flatnonzero(part >= share)
    if not len(above):
        return math.inf
    k = int(above[0])
    if k == 0:
        return float(times[0])
    return float(np.interp(share, part[[k - 1, k]], times[[k - 1, k]]))


def _widths(seen: Sequence[Transition], sample: float) -> tuple[float, Array]:
    """Time constant in s and reciprocal rates (4,) from the times between 20 and 80 %."""
    from scipy.optimize import nnls

    kept = [one for one in seen if one.rate is not None]
    ramps = np.zeros(4)
    if not kept:
        return sample, ramps
    rows = np.zeros((len(kept), 5))
    rows[:, 0] = 1.0
    top = max(one.size for one in kept)
    for row, one in zip(rows, kept, strict=True):
        row[1 + int(one.rate or 0) - 7] = (one.size / top) ** 2
    squares, _ = nnls(rows, np.array([(one.to_80 - one.to_20) ** 2 for one in kept]))
    ramps[:] = np.sqrt(squares[1:]) / (0.6 * top)
    return max(math.sqrt(squares[0]) / _LN4, 0.2 * sample), ramps
