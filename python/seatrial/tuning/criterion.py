"""Constraint criterion of a set-point response: the area outside its corridor, and metrics of the response.

``Q = WI_u * under + WI_o * over`` with ``under = sum max(C_u - y, 0) dt`` and ``over = sum max(y - C_o, 0)
dt`` over the control periods of the corridor, in s (Taubert et al. 2014, (55)-(57), with ``y - C_o`` in the
second term, where ``y - C_u`` is printed). The sum is the definition, not an approximation of an integral: a
sampled controller acts once per period, and the core adds up the same numbers. ``Q = 0`` where the response
stays inside; among those the tie-breaker decides, the time-weighted absolute error (ITAE) ``sum t |y -
target| dt`` in s^2 (Graham and Lathrop, 1953).

Held by tests/control_design/test_corridor.py and tests/tuning/test_corridor_core.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError

if TYPE_CHECKING:
    from seatrial.control_design.corridor import Corridor

# Of the step: dead time ends at 5 %, a rise at 90 %, begun at 0 or 10 %.
_BEGUN, _RISES_FROM, _RISEN = 0.05, 0.1, 0.9

_END = 0.1  # last share of a record, over which a steady error is averaged

_EVEN = 1e-6  # how far a gap of the grid may differ from the others, as a share


@dataclass(frozen=True)
class StepMetrics:
    """Figures of a step response; shares are of the step, times in s since it, inf: never within the record.

    Attributes
    ----------
    dead_s : float
        Until 5 % of the step are reached for the first time.
    rise_s : float
        Until 90 % are reached for the first time.
    rise_10_90_s : float
        From 10 to 90 %.
    overshoot, undershoot : float
        Largest excess above the new set point, and largest way below the old one.
    settling_s : float
        From then on the response stays within the band.
    steady_error : float
        Mean of what is missing to the set point over the last tenth of the record.
    """

    dead_s: float
    rise_s: float
    rise_10_90_s: float
    overshoot: float
    undershoot: float
    settling_s: float
    steady_error: float


def normalised(response: ArrayLike, before: ArrayLike, after: ArrayLike) -> Array:
    """Response (..., n) as a share of its step: 0 at the set point before, 1 at that after.

    Parameters
    ----------
    response : array, shape (..., n)
        In any unit.
    before, after : array, shape (...)
        Set points in the same unit.

    Raises
    ------
    SimulationError
        A step of size zero.

    Examples
    --------
    >>> normalised([1.0, 0.8, 0.5], 1.0, 0.6).round(2).tolist()
    [0.0, 0.5, 1.25]
    """
    start, end = (np.asarray(value, dtype=float)[..., None] for value in (before, after))
    if np.any(start == end):
        raise SimulationError(
            "a step response needs two set points, found the same before and after; give a step that is not 0"
        )
    shares: Array = (np.asarray(response, dtype=float) - start) / (end - start)
    return shares


def violations(t: ArrayLike, y: ArrayLike, corridor: Corridor) -> Array:
    """Area below the lower and above the upper bound (..., 2) in s, without weights.

    Parameters
    ----------
    t : array, shape (n,)
        Even grid of the control periods, s since the step.
    y : array, shape (..., n)
        Normalised responses; one that is not finite anywhere has an infinite area.
    corridor : Corridor

    Raises
    ------
    SimulationError
        The grid is not even, or does not fit the responses.

    Examples
    --------
    >>> from seatrial.control_design.corridor import Corridor
    >>> corridor = Corridor([(1.0, 0.9)], [(0.0, 1.1), (4.0, 1.1)])
    >>> violations([0.0, 1.0, 2.0, 3.0], [[0.0, 0.8, 1.3, 1.0]], corridor).round(3).tolist()
    [[0.1, 0.2]]
    """
    at, response, period = _grid(t, y)
    lower, upper = corridor.sampled(at)
    with np.errstate(invalid="ignore"):
        outside = np.stack([np.maximum(lower - response, 0.0), np.maximum(response - upper, 0.0)], axis=-2)
    return _total(outside, response[..., None, :], period)


def criterion(t: ArrayLike, y: ArrayLike, corridor: Corridor) -> Array:
    """Constraint criterion Q (...) in s: weighted area outside the corridor, 0 where a response stays inside.

    Arguments and errors are those of `violations`.

    Examples
    --------
    >>> from seatrial.control_design.corridor import Corridor
    >>> corridor = Corridor([(1.0, 0.9)], [(0.0, 1.1), (4.0, 1.1)], weight_upper=2.0)
    >>> round(float(criterion([0.0, 1.0, 2.0, 3.0], [0.0, 0.8, 1.3, 1.0], corridor)), 3)
    0.5
    """
    areas = violations(t, y, corridor)
    weights = corridor.weight_lower, corridor.weight_upper
    # A side of weight zero stays out of it, an infinite area included, unless the response diverged.
    parts = [w * areas[..., k] if w > 0.0 else np.zeros(areas.shape[:-1]) for k, w in enumerate(weights)]
    diverged = np.isinf(areas).any(axis=-1)
    return np.asarray(np.where(diverged, np.inf, parts[0] + parts[1]))


def time_weighted_error(t: ArrayLike, y: ArrayLike, corridor: Corridor) -> Array:
    """Time-weighted absolute error (...) in s^2 over the corridor: the tie-breaker of feasible responses.

    The corridor gives the target and the time over which it counts; arguments and errors are those of
    `violations`.
    """
    at, response, period = _grid(t, y)
    with np.errstate(invalid="ignore"):
        weighed = corridor.clock(at) * np.abs(response - corridor.target)
    return _total(weighed, response, period)


def step_metrics(t: ArrayLike, y: ArrayLike, *, band: float = 0.05) -> StepMetrics:
    """Figures of one step response, between samples by linear interpolation.

    Parameters
    ----------
    t : array, shape (n,)
        Time since the step, s, rising; samples before it do not count.
    y : array, shape (n,)
        Normalised response.
    band : float
        Half-width of the band in which it settles, as a share of the step.

    Raises
    ------
    SimulationError
        Fewer than two samples from the step on, times that do not rise, or arrays that do not fit.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(0.0, 30.0, 0.01)
    >>> found = step_metrics(t, 1.0 - np.exp(-t / 2.0))
    >>> round(found.rise_s, 2), round(found.settling_s, 2), found.overshoot
    (4.61, 5.99, 0.0)
    """
    at, response = np.asarray(t, dtype=float), np.asarray(y, dtype=float)
    if at.ndim != 1 or response.shape != at.shape:
        raise SimulationError(
            f"a step response: expected times and values (n,), found {at.shape} and {response.shape}"
        )
    at, response = at[at >= 0.0], response[at >= 0.0]
    if len(at) < 2 or np.any(np.diff(at) <= 0.0):
        raise SimulationError(
            f"a step response: expected two or more rising times from the step on, found {len(at)}"
            f" {'that do not rise' if len(at) > 1 else 'sample(s)'}; sort the samples or record longer"
        )
    # What diverged has no figures; infinite ones fail every limit.
    if not np.isfinite(response).all():
        return StepMetrics(*[math.inf] * 7)
    risen, from_ten = _first(at, response, _RISEN), _first(at, response, _RISES_FROM)
    tail = at >= at[-1] - _END * (at[-1] - at[0])
    return StepMetrics(
        dead_s=_first(at, response, _BEGUN),
        rise_s=risen,
        rise_10_90_s=risen - from_ten if math.isfinite(risen) else math.inf,
        overshoot=max(float(response.max()) - 1.0, 0.0),
        undershoot=max(-float(response.min()), 0.0),
        settling_s=_settled(at, np.abs(response - 1.0) - band),
        steady_error=float(np.mean(1.0 - response[tail])),
    )


def _first(at: Array, response: Array, level: float) -> float:
    """First time in s at which a level is reached from below."""
    reached = np.flatnonzero(response >= level)
    return _crossing(at, response - level, int(reached[0])) if len(reached) else math.inf


def _settled(at: Array, outside: Array) -> float:
    """Time in s after which a signal stays at or below zero."""
    last = np.flatnonzero(outside > 0.0)
    if not len(last):
        return float(at[0])
    return _crossing(at, outside, int(last[-1]) + 1) if last[-1] + 1 < len(at) else math.inf


def _crossing(at: Array, signal: Array, k: int) -> float:
    """Time in s of the zero between the samples k - 1 and k."""
    if k == 0:
        return float(at[0])
    share = signal[k - 1] / (signal[k - 1] - signal[k])
    return float(at[k - 1] + share * (at[k] - at[k - 1]))


def _grid(t: ArrayLike, y: ArrayLike) -> tuple[Array, Array, float]:
    """Times (n,), responses (..., n) and the control period in s."""
    at, response = np.asarray(t, dtype=float), np.asarray(y, dtype=float)
    if at.ndim != 1 or response.shape[-1:] != at.shape:
        raise SimulationError(
            f"responses to hold against a corridor: expected times (n,) and values (..., n), found {at.shape}"
            f" and {response.shape}"
        )
    if len(at) < 2:
        raise SimulationError("responses to hold against a corridor: expected two or more periods, found one")
    period = float(at[-1] - at[0]) / (len(at) - 1)
    gaps = np.diff(at)
    if not (period > 0.0 and np.abs(gaps - period).max() <= _EVEN * period):
        raise SimulationError(
            f"responses to hold against a corridor: expected one sample per control period, found gaps from"
            f" {gaps.min():.4g} to {gaps.max():.4g} s; resample them evenly"
        )
    return at, response, period


def _total(values: Array, response: Array, period: float) -> Array:
    """Sum (...) over the periods, infinite where the response is not finite."""
    finite = np.isfinite(response).all(axis=-1)
    return np.asarray(np.where(finite, np.sum(values, axis=-1) * period, np.inf))
