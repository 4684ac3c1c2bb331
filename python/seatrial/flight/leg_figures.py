"""What became of every leg: was its waypoint reached, how far off the path, how far beyond the depth.

A waypoint is reached when the autopilot saw the vehicle within its radius of acceptance R, and the vehicle
truly was within 1.5 R: sensors err, and a leg ends as soon as they show R. Errors of guidance are those of
the second half of a straight leg, where the vehicle has had time to settle. The overshoot in depth counts
after a change of depth, beyond the new one, until the next change, as a share of the change.

Held by ``tests/test_flight.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.flight.route import Route

if TYPE_CHECKING:
    from seatrial.flight.flight import Flight

__all__ = ["Leg", "legs_of"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_LEAST_STEP_M = 0.5  # smaller changes of depth are none
_ROUNDING_M = 1e-6
_TRULY = 1.5  # of the radius, where the sensors show the vehicle within it


@dataclass(frozen=True)
class Leg:
    """A leg of a flight and the waypoint at its end.

    Attributes
    ----------
    label, task
        Name of the waypoint; "pass", "hold" or "circle".
    acceptance_m, smallest_m, seen_m, reached
        Radius; smallest true distance (to a circle: to its circumference), and as the sensors showed it;
        whether the waypoint was reached.
    begin_s, time_s
        When the leg began and how long it took; nan if it was never begun.
    cross_track_mean_m, cross_track_largest_m
        On the second half: mean, and largest magnitude; nan where it was not flown straight.
    vertical_mean_m, vertical_largest_m
        The same of the vertical error.
    depth_step_m, depth_overshoot_m, depth_overshoot_percent
        Change of depth, how far the vehicle went beyond the new depth, and as a share; nan without a change.
    hold_rms_m, hold_largest_m
        Distance from the waypoint while station was kept, from the arrival within the radius on; nan where it
        was not.
    modes
        Share of the leg's time in each mode.
    """

    label: str
    task: str
    acceptance_m: float
    smallest_m: float
    seen_m: float
    reached: bool
    begin_s: float
    time_s: float
    cross_track_mean_m: float
    cross_track_largest_m: float
    vertical_mean_m: float
    vertical_largest_m: float
    depth_step_m: float
    depth_overshoot_m: float
    depth_overshoot_percent: float
    hold_rms_m: float
    hold_largest_m: float
    modes: Mapping[str, float]

    def to_dict(self) -> dict[str, Any]:
        """The same as plain data."""
        return asdict(self)


class _Rows:
    """Rows of the log that are under way, leg by leg: many legs share a long log."""

    def __init__(self, flight: Flight) -> None:
        under_way = np.flatnonzero(flight.under_way)
        self.rows = under_way[np.argsort(flight.leg[under_way], kind="stable")]
        self.ends = np.searchsorted(flight.leg[self.rows], np.arange(len(flight.route.stops) + 1))

    def of(self, first: int, last: int) -> NDArray[np.int64]:
        """Rows of the legs from the first to the last."""
        return np.asarray(self.rows[self.ends[first] : self.ends[last + 1]])


def legs_of(flight: Flight) -> tuple[Leg, ...]:
    """Legs of a flight, one per waypoint of its mission."""
    rows = _Rows(flight)
    told = np.stack([flight.measured[name] for name in ("x", "y", "z")], axis=1)
    return tuple(_leg(flight, k, rows, told) for k in range(len(flight.route.stops)))


def _leg(flight: Flight, k: int, of_legs: _Rows, told: Array) -> Leg:
    path = flight.route
    stop = path.stops[k]
    found = of_legs.of(k, k)
    if not len(found):
        return _never(path, k)
    first, last = int(found.min()), int(found.max())
    # The row in which guidance goes on to the next leg is the one in which it saw the waypoint reached.
    switched = min(last + 1, len(flight.t) - 1)
    part = slice(first, switched + 1)
    rows = np.zeros(switched + 1 - first, dtype=bool)
    rows[found - first] = True
    distance = _distance(flight, k, flight.position[part], flight.altitude[part])
    shown = _distance(flight, k, told[part], flight.measured["altitude"][part])
    smallest, seen = float(np.nanmin(distance)), float(np.nanmin(shown))
    half = 0.5 * path.length(k)
    holding = flight.holding[part]
    settled = rows & ~holding & (flight.distance[part] < half) & (stop.task != "circle")
    across, below = (flight.errors[name][part][settled] for name in ("cross_track", "vertical"))
    arrived = np.cumsum(rows & (distance <= stop.acceptance)) > 0
    held = rows & holding & arrived & (stop.task == "hold")
    step, beyond = _overshoot(flight, k, of_legs)
    modes = np.bincount(flight.mode[found], minlength=len(flight.modes)) / len(found)
    return Leg(
        label=stop.label,
        task=stop.task,
        acceptance_m=stop.acceptance,
        smallest_m=smallest,
        seen_m=seen,
        reached=seen <= stop.acceptance + _ROUNDING_M and smallest <= _TRULY * stop.acceptance,
        begin_s=float(flight.t[first]),
        time_s=float(flight.t[switched] - flight.t[first]),
        cross_track_mean_m=_mean(across),
        cross_track_largest_m=_largest(across),
        vertical_mean_m=_mean(below),
        vertical_largest_m=_largest(below),
        depth_step_m=step,
        depth_overshoot_m=beyond,
        depth_overshoot_percent=100.0 * beyond / abs(step),
        hold_rms_m=math.sqrt(_mean(distance[held] ** 2)),
        hold_largest_m=_largest(distance[held]),
        modes={name: float(share) for name, share in zip(flight.modes, modes, strict=True) if share},
    )


def _never(path: Route, k: int) -> Leg:
    """A leg that was not begun."""
    stop, nan = path.stops[k], math.nan
    return Leg(
        label=stop.label,
        task=stop.task,
        acceptance_m=stop.acceptance,
        smallest_m=math.inf,
        seen_m=math.inf,
        reached=False,
        begin_s=nan,
        time_s=nan,
        cross_track_mean_m=nan,
        cross_track_largest_m=nan,
        vertical_mean_m=nan,
        vertical_largest_m=nan,
        depth_step_m=_step(path, k),
        depth_overshoot_m=nan,
        depth_overshoot_percent=nan,
        hold_rms_m=nan,
        hold_largest_m=nan,
        modes={},
    )


def _distance(flight: Flight, k: int, position: Array, altitude: Array) -> Array:
    """Distance to waypoint `k`, or to its circle, of rows (n, 3) with their altitude (n,), (n,), m."""
    stop = flight.route.stops[k]
    aside = np.hypot(*(position[:, :2] - stop.position[:2]).T)
    third = altitude if stop.vertical == "altitude" else position[:, 2]
    below = third - stop.position[2]
    if stop.task == "circle":
        return np.asarray(np.hypot(aside - stop.radius, below))
    to_point = np.hypot(aside, below)
    if stop.task == "hold" and flight.loiter_radius > 0.0:
        # A vehicle that cannot stop circles the point instead.
        return np.asarray(np.minimum(to_point, np.hypot(aside - flight.loiter_radius, below)))
    return np.asarray(to_point)


def _step(path: Route, k: int) -> float:
    """Change of depth along leg `k`, m; nan where there is none or the bottom is followed."""
    if path.follows_bottom(k):
        return math.nan
    step = float(path.stops[k].position[2] - path.before(k)[2])
    return step if abs(step) >= _LEAST_STEP_M else math.nan


def _overshoot(flight: Flight, k: int, of_legs: _Rows) -> tuple[float, float]:
    """Change of depth on leg `k` and how far beyond it the vehicle went before the next change, m."""
    path = flight.route
    step = _step(path, k)
    if math.isnan(step):
        return math.nan, math.nan
    last = k
    while (
        last + 1 < len(path.stops) and not path.follows_bottom(last + 1) and math.isnan(_step(path, last + 1))
    ):
        last += 1
    rows = of_legs.of(k, last)
    beyond = math.copysign(1.0, step) * (flight.position[rows, 2] - path.stops[k].position[2])
    return step, max(0.0, float(np.max(beyond)))


def _mean(values: Array) -> float:
    return float(np.mean(values)) if len(values) else math.nan


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values))) if len(values) else math.nan
