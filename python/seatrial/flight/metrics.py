"""Metrics of a flight: of the whole, of its legs, of its control loops and actuators.

The whole is summed by the core while it flies (`flight/tally.rs`); names carry units. Errors of guidance
count on the second half of straight legs, where the vehicle has had time to settle, and are those that
guidance perceived; ``true_...`` is where the vehicle really was. Without a settled sample there is none. The
depth excursion is how far the vehicle leaves the band between the depths of a leg's two ends; while it turns
onto the leg and is still behind its start, the depths of the leg before count too. The quantiles
p50, p95 and p99 are those of one flight's error over time; the clearance is the smallest horizontal distance
of the hull from what stands in the water, its reserve that beyond what the mission promises (both infinite
without), and travel the mean rate at which commands move, in shares of an actuator's range.

A waypoint is reached when the autopilot perceived the vehicle within its radius of acceptance R, and the
vehicle truly was within 1.5 R: sensors err, and a leg ends as soon as they show R. A turn begins before its
waypoint, so that the next leg counts too where the vehicle only passes. The overshoot in depth
counts after a change of depth, beyond the new one, until the next change, as a share of the change.

The error of a loop is what was desired less what the vehicle really did, over the time in which the loop was
at work. A demand is saturated where it stands at the loop's limit, or is not met while an actuator that acts
in its row is at its own. It is not met where what the actuators reach differs from it by more than a
hundredth of the loop's limit: the allocation gives up a part for rows that it would disturb, or a motor rests
below its start.

Held by ``tests/flight/test_flight.py``; there ``test_figures_of_the_core_are_those_of_the_log``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial._core import Flights, autopilot_names, error_edges
from seatrial.base.arrays import Array, Mask
from seatrial.base.plain import Plain
from seatrial.flight.mission import Route

if TYPE_CHECKING:
    from seatrial.flight.log import FlightLog

DIVERGED = "diverged"


@dataclass(frozen=True)
class FlightMetricSettings:
    """From when a metric of a flight says something."""

    #: Share of the distance promised by a mission by which a flight may fall short of it.
    short_of_promise: float = 0.1
    off_m: float = 0.05  #: An error of a position in m from which it is worth a word.
    at_limit: float = 0.999  #: Share of a limit from which a demand is at it: rounding is not saturated.
    unmet: float = 0.01  #: Part of a demand, N or N m, that rounding leaves unmet.
    nothing: float = 1e-9  #: N or N m per newton: an actuator that does not act in a row.


SETTINGS = FlightMetricSettings()


CODED = ("ending", "alert", "alert_cause", "alert_time_s")
"""Metrics that a single flight tells in words: its ending and its alerts."""

_DEG = 180.0 / math.pi  # degrees in a radian

_FIGURES = {
    "m": "distance cross_track_largest cross_track_rms true_cross_track_largest true_cross_track_rms"
    " vertical_largest vertical_rms depth_largest depth_smallest altitude_smallest missed_by clearance"
    " clearance_reserve",
    "s": "duration alert_time clearance_time depth_smallest_time roll_time pitch_time",
    "deg": "roll_largest pitch_largest",
    "wh": "energy",
}
"""Figures of the core by the unit that their metric carries in its name."""

_RENAMED = {
    "excursion": "depth_excursion_m",
    "waypoints": "waypoints_behind",
    "switches": "switches_per_minute",
    "travel": "travel_per_s",
} | {figure: f"{figure}_{unit}" for unit, figures in _FIGURES.items() for figure in figures.split()}


def in_metric_units(figure: str) -> tuple[str, float]:
    """Name of the metric of a figure of the core, and the factor from the figure's unit to the metric's."""
    name = _RENAMED.get(figure, figure)
    return name, {"deg": _DEG, "wh": 1.0 / 3600.0}.get(name.rpartition("_")[2], 1.0)


_QUANTILES = {"p50": 0.50, "p95": 0.95, "p99": 0.99}


def metrics_of(flights: Flights) -> dict[str, Array]:
    """Metrics of all cases by name, (k,) each; a diverged flight has no duration. ``ending``, ``alert`` and
    ``alert_cause`` are places in lists of ``seatrial._core.autopilot_names``.
    """
    metrics: dict[str, Array] = {}
    for name, values in flights.figures.items():
        renamed, scale = in_metric_units(name)
        metrics[renamed] = scale * np.asarray(values)
    for error in ("cross_track", "true_cross_track", "vertical"):
        counts = getattr(flights, f"{error}_counts")
        for name, share in _QUANTILES.items():
            metrics[f"{error}_{name}_m"] = quantile(counts, share, largest=metrics[f"{error}_largest_m"])
    metrics["clearance_reserve_m"] = reserve(metrics["clearance_m"], metrics["clearance_reserve_m"])
    return metrics


def reserve(clear_m: Array, beyond_m: Array) -> Array:
    """Smallest clearance beyond what is promised of each obstacle, m, of the clearance of all obstacles (0 m
    is the promise of one that has none), and that beyond the promise of those that have one.
    """
    # Of an obstacle with a promise the clearance is the larger of the two, so that it does not count here.
    return np.asarray(np.fmin(clear_m, beyond_m))


def differs(perceived: float, truly: float) -> bool:
    """Whether a true error is another than the one that was perceived, by more than that one and 5 cm."""
    return abs(truly - perceived) > max(perceived, SETTINGS.off_m)


def quantile(counts: Array, share: float, *, largest: Array) -> Array:
    """Quantile (k,), m, of the magnitude of an error, log-linear between thresholds and at most the `largest`
    error. `counts` (k, 1 + edges): samples, and those above each of ``seatrial._core.error_edges``.
    """
    edges = np.log(np.asarray(error_edges()))
    samples, above = counts[:, :1], counts[:, 1:]
    exceeding = above / np.maximum(samples, 1.0)
    quantiles = np.empty(len(counts))
    for case, row in enumerate(exceeding):
        # From the rarest threshold down, as np.interp wants rising shares.
        quantiles[case] = np.exp(np.interp(1.0 - share, row[::-1], edges[::-1]))
        if row[-1] > 1.0 - share:  # beyond the last threshold only the largest is known
            quantiles[case] = np.inf
    return np.where(samples[:, 0] > 0.0, np.minimum(quantiles, largest), np.nan)


def ending_of(metrics: Mapping[str, Array], case: int = 0) -> str:
    """How a case ended: complete, surfaced, aborted, out of time or diverged."""
    if not np.isfinite(metrics["duration_s"][case]):
        return DIVERGED
    return autopilot_names()["endings"][int(metrics["ending"][case])]


@dataclass(frozen=True)
class Leg(Plain):
    """A leg of a flight and the waypoint at its end; NaN is what it does not have, a leg never begun nearly
    everything.

    `smallest_m` and `perceived_m` are the smallest distance (to a circle: to its circumference), true and as
    the sensors showed it; cross-track and vertical errors count on the second half of a straight leg; the
    overshoot in depth is that beyond the new depth, also as a share of the step; ``hold_…`` is the distance
    from the waypoint while station was kept, from the arrival within the radius on. `modes`: share of the
    time in each mode.
    """

    label: str
    task: str
    acceptance_m: float
    smallest_m: float = math.inf
    perceived_m: float = math.inf
    reached: bool = False
    begin_s: float = math.nan
    time_s: float = math.nan
    cross_track_mean_m: float = math.nan
    cross_track_largest_m: float = math.nan
    vertical_mean_m: float = math.nan
    vertical_largest_m: float = math.nan
    depth_step_m: float = math.nan
    depth_overshoot_m: float = math.nan
    depth_overshoot_percent: float = math.nan
    hold_rms_m: float = math.nan
    hold_largest_m: float = math.nan
    modes: Mapping[str, float] = field(default_factory=dict)


def true_vertical(flight: FlightLog) -> dict[str, float]:
    """Metrics of the vertical error by the true depth where the perceived one counts, without legs that
    follow the bottom; nan without such rows.
    """
    path = flight.route
    legs = range(len(path.stops))
    half = np.array([0.5 * path.length(k) for k in legs])
    straight = np.array([path.stops[k].task != "circle" and not path.follows_bottom(k) for k in legs])
    rows = flight.under_way & ~flight.holding & straight[flight.leg] & (flight.distance < half[flight.leg])
    below = (flight.errors["vertical"] + flight.position[:, 2] - flight.measured["z"])[rows]
    rms = _rms(below) if len(below) else math.nan
    return {"true_vertical_rms_m": rms, "true_vertical_largest_m": _largest(below)}


class _Rows:
    """Rows of the log that are under way, leg by leg: many legs share a long log."""

    def __init__(self, flight: FlightLog) -> None:
        under_way = np.flatnonzero(flight.under_way)
        self.rows = under_way[np.argsort(flight.leg[under_way], kind="stable")]
        self.ends = np.searchsorted(flight.leg[self.rows], np.arange(len(flight.route.stops) + 1))

    def of(self, first: int, last: int) -> NDArray[np.int64]:
        """Rows of the legs from the first to the last."""
        return np.asarray(self.rows[self.ends[first] : self.ends[last + 1]])


def legs_of(flight: FlightLog) -> tuple[Leg, ...]:
    """Legs of a flight, one per waypoint of its mission."""
    rows = _Rows(flight)
    place = np.column_stack([flight.position, flight.altitude])
    shown = np.column_stack([flight.measured[name] for name in ("x", "y", "z", "altitude")])
    near = flight.mission.core.reached(
        place, shown, flight.leg.tolist(), flight.under_way.tolist(), flight.loiter_radius
    )
    return tuple(_leg(flight, k, rows, near[k]) for k in range(len(flight.route.stops)))


def _leg(flight: FlightLog, k: int, of_legs: _Rows, near: Array) -> Leg:
    """Leg `k`; `near` are its smallest true and perceived distance in m, and whether it was reached."""
    path = flight.route
    stop = path.stops[k]
    own_rows = of_legs.of(k, k)
    if not len(own_rows):
        # It was never begun.
        return Leg(stop.label, stop.task, stop.acceptance, depth_step_m=_step(path, k))
    first, last = int(own_rows.min()), int(own_rows.max())
    # The row in which guidance goes on to the next leg is the one in which it perceived the waypoint reached.
    switched = min(last + 1, len(flight.t) - 1)
    part = slice(first, switched + 1)
    rows = np.zeros(switched + 1 - first, dtype=bool)
    rows[own_rows - first] = True
    distance = distance_to_stop(flight, k, flight.position[part], flight.altitude[part])
    half = 0.5 * path.length(k)
    holding = flight.holding[part]
    settled = rows & ~holding & (flight.distance[part] < half) & (stop.task != "circle")
    across, below = (flight.errors[name][part][settled] for name in ("cross_track", "vertical"))
    arrived = np.cumsum(rows & (distance <= stop.acceptance)) > 0
    at_station = rows & holding & arrived & (stop.task == "hold")
    step, beyond = _overshoot(flight, k, of_legs)
    modes = np.bincount(flight.mode[own_rows], minlength=len(flight.modes)) / len(own_rows)
    return Leg(
        label=stop.label,
        task=stop.task,
        acceptance_m=stop.acceptance,
        smallest_m=float(near[0]),
        perceived_m=float(near[1]),
        reached=bool(near[2]),
        begin_s=float(flight.t[first]),
        time_s=float(flight.t[switched] - flight.t[first]),
        cross_track_mean_m=_mean(across),
        cross_track_largest_m=_largest(across),
        vertical_mean_m=_mean(below),
        vertical_largest_m=_largest(below),
        depth_step_m=step,
        depth_overshoot_m=beyond,
        depth_overshoot_percent=100.0 * beyond / abs(step),
        hold_rms_m=math.sqrt(_mean(distance[at_station] ** 2)),
        hold_largest_m=_largest(distance[at_station]),
        modes={name: float(share) for name, share in zip(flight.modes, modes, strict=True) if share},
    )


def distance_to_stop(flight: FlightLog, k: int, position: Array, altitude: Array) -> Array:
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
    return step if abs(step) >= 0.5 else math.nan  # m: smaller changes of depth are none


def _overshoot(flight: FlightLog, k: int, of_legs: _Rows) -> tuple[float, float]:
    """Change of depth on leg `k` and how far beyond it the vehicle went before the next change, m."""
    path = flight.route
    step = _step(path, k)
    if math.isnan(step):
        return math.nan, math.nan
    last = k
    level = [not path.follows_bottom(i) and math.isnan(_step(path, i)) for i in range(len(path.stops))]
    while last + 1 < len(path.stops) and level[last + 1]:
        last += 1
    rows = of_legs.of(k, last)
    beyond = math.copysign(1.0, step) * (flight.position[rows, 2] - path.stops[k].position[2])
    return step, max(0.0, float(np.max(beyond)))


def _mean(values: Array) -> float:
    return float(np.mean(values)) if len(values) else math.nan


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values))) if len(values) else math.nan


_UNITS = (("m/s", "N"), ("m/s", "N"), ("m", "N"), ("deg", "N m"), ("deg", "N m"), ("deg", "N m"))


@dataclass(frozen=True)
class Loop(Plain):
    """A control loop over the time in which it was at work: error, desired less true, and demand of the
    actuators; `saturated`: share of the time in which the demand was limited, or not met with an actuator
    at its limit; `unmet`: share in which the actuators reached something else.
    """

    name: str
    time_s: float
    error_unit: str
    error_rms: float
    error_largest: float
    demand_unit: str
    demand_rms: float
    demand_largest: float
    saturated: float
    unmet: float


@dataclass(frozen=True)
class ActuatorUse(Plain):
    """What was asked of an actuator: rms and largest command from neutral, in its unit, share of the time at
    its largest command and away from neutral, and how often it went to or from neutral.
    """

    name: str
    unit: str
    rms: float
    largest: float
    at_limit: float
    running: float
    switches_per_minute: float


def loops_of(flight: FlightLog) -> dict[str, Loop]:
    """Metrics of the loops that were at work, by name."""
    loops = {}
    for i, name in enumerate(autopilot_names()["loops"]):
        rows = flight.active[:, i]
        if not rows.any():
            continue
        error_unit, demand_unit = _UNITS[i]
        scale = _DEG if error_unit == "deg" else 1.0
        error, demand = scale * flight.errors[name][rows], flight.demanded[rows, i]
        loops[name] = Loop(
            name=name,
            time_s=float(rows.sum() * flight.period_s),
            error_unit=error_unit,
            error_rms=_rms(error),
            error_largest=float(np.max(np.abs(error))),
            demand_unit=demand_unit,
            demand_rms=_rms(demand),
            demand_largest=float(np.max(np.abs(demand))),
            saturated=float(np.mean(saturated(flight, i)[rows])),
            unmet=float(np.mean(unmet(flight, i)[rows])),
        )
    return loops


def saturated(flight: FlightLog, index: int) -> Mask:
    """Rows (n,) in which a loop's demand stands at its limit, or is not met with an actuator at its limit."""
    limit = _limit(flight, index)
    acting = np.abs(flight.vehicle.allocation_matrix()[index]) > SETTINGS.nothing
    used = [
        _at_limit(flight, name) for name, acts in zip(flight.vehicle.actuators, acting, strict=True) if acts
    ]
    exhausted = np.any(used, axis=0) if used else np.zeros(len(flight.t), dtype=bool)
    limited = np.abs(flight.demanded[:, index]) >= SETTINGS.at_limit * limit
    return np.asarray(flight.active[:, index] & (limited & (limit > 0.0) | unmet(flight, index) & exhausted))


def unmet(flight: FlightLog, index: int) -> Mask:
    """Rows (n,) in which the actuators reach something else than a loop demands."""
    limit = _limit(flight, index)
    short = np.abs(flight.demanded[:, index] - flight.achieved[:, index]) > SETTINGS.unmet * limit
    return np.asarray(flight.active[:, index] & short & (limit > 0.0))


def _limit(flight: FlightLog, index: int) -> float:
    """Largest demand that a loop may make, N or N m."""
    table = flight.autopilot.loops().get(autopilot_names()["loops"][index], {})
    demand = np.abs(flight.demanded[flight.active[:, index], index])
    return float(table.get("tau_max", demand.max(initial=0.0)))


def _at_limit(flight: FlightLog, name: str) -> Mask:
    """Rows (n,) in which the command of an actuator is the largest that it takes."""
    fact = flight.vehicle.actuator_info()[name]
    away = flight.commands[name] - float(fact["neutral"])
    signal = -away if fact["reversed"] else away
    limit = np.where(signal < 0.0, float(fact["maximum_astern"]), float(fact["maximum_ahead"]))
    return np.asarray((np.abs(away) >= SETTINGS.at_limit * limit) & (limit > 0.0))


def actuators_of(flight: FlightLog) -> dict[str, ActuatorUse]:
    """What was asked of every actuator, by name."""
    facts = flight.vehicle.actuator_info()
    uses = {}
    minutes = max(float(flight.t[-1] - flight.t[0]), 1e-9) / 60.0
    for name, commands in flight.commands.items():
        fact = facts[name]
        away = commands - float(fact["neutral"])
        uses[name] = ActuatorUse(
            name=name,
            unit=str(fact["unit"]),
            rms=_rms(away),
            largest=float(np.max(np.abs(away))),
            at_limit=float(np.mean(_at_limit(flight, name))),
            running=float(np.mean(running(away))),
            switches_per_minute=switches(away) / minutes,
        )
    return uses


def running(away: Array) -> NDArray[np.bool_]:
    """Where a command (n,), from neutral, is none of neutral's."""
    return np.asarray(np.abs(away) > 1e-9)


def switches(away: Array) -> int:
    """Starts and stops of a command (n,), from neutral."""
    return int(np.count_nonzero(np.diff(running(away).astype(int))))


def _rms(values: Array) -> float:
    with np.errstate(over="ignore"):  # a flight that diverges ends in numbers without bounds
        return float(np.sqrt(np.mean(values**2)))
