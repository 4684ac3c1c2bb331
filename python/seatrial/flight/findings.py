"""What went wrong on a flight, by the facts of its log, as data: limits, waypoints, reactions, time lost.

True positions count, not those that the autopilot perceived. A finding names its cause where the log shows
it; what to do is that of the root, and the words are those of `seatrial.report.results.flight_findings`.

The slope of a leg is compared with what guidance asks for at most (``pitch_max_deg`` where the depth goes by
pitch, ``depth_rate_max_m_s`` at the leg's speed where it goes by heave), and with the steepest path over 5 s
that the vehicle flew on it.

Held by ``tests/flight/test_findings.py`` and ``tests/flight/test_reactions.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from seatrial._core import autopilot_names
from seatrial.base.arrays import Array, Mask
from seatrial.base.finding import Finding, Severity
from seatrial.flight.excesses import SETTINGS as EXCESS_SETTINGS
from seatrial.flight.excesses import promise_counts, too_deep, too_low, too_near, touched
from seatrial.flight.metrics import DIVERGED, Leg, Loop, saturated
from seatrial.vehicle.actuators import beyond_tables, commanded_rows
from seatrial.vehicle.stability import growth, statics

if TYPE_CHECKING:
    from seatrial.flight.log import FlightLog


@dataclass(frozen=True)
class FlightFindingSettings:
    """From when something on a flight is worth a finding, and what explains it."""

    steepness_s: float = 5.0  #: Time over which the steepness of a path is taken, s.
    slope_ratio: float = 1.05  #: Slope of a leg over what guidance allows, from which the leg is too steep.
    #: Slope of a leg over what was flown, from which the vehicle lagged behind it.
    lagging_ratio: float = 1.25
    #: Share of a leg's slope that was flown below which its loop does not change the depth at all.
    flat_share: float = 0.5
    #: Share of a leg's time in saturation from which its loop has no more to give.
    exhausted_share: float = 0.5
    #: Net buoyancy over the weight that is no fault: hulls of torpedoes carry it at a few degrees of pitch.
    buoyant_share: float = 0.01
    #: Net buoyancy over the heave loop's limit: less leaves enough to change the depth.
    carried_share: float = 0.5
    late_ratio: float = 1.2  #: Time of a flight over the planned one from which it was late.
    late_s: float = 30.0  #: Delay from which a flight was late, s.
    #: Share of a loop's time in saturation that is worth a word: less is a turn or a start.
    saturated_share: float = 0.05
    off_m: float = 0.05  #: Error of the position that the autopilot was told, m: less explains no miss.
    #: Pitch, rad, off its demand from which a hull that no loop holds has left its trim: waves and starts of
    #: a built-in hovering vehicle pitch it by less than half of that.
    tilted: float = math.radians(20.0)
    #: Share of the speed at which pitch becomes unstable that is safe to fly: an open frame that turned at
    #: 0.76 of it kept to 20 deg, at 0.87 it pitched to 56 deg (tests/flight/test_findings.py).
    safe_share: float = 0.75


SETTINGS = FlightFindingSettings()


class Result(NamedTuple):
    """What came of a flight, beside its log: as of `seatrial.flight.flight.Flight`."""

    outcome: str
    words: str
    metrics: Mapping[str, float]
    legs: Sequence[Leg]
    loops: Mapping[str, Loop]
    alerts: Sequence[Alert]


def findings(flight: FlightLog, result: Result) -> tuple[Finding, ...]:
    """What went wrong, the gravest first; of a flight that succeeded the weakness that counts most."""
    grave = _grave(flight, result)
    tilted = None if result.outcome == DIVERGED else tilt(flight)
    if tilted is not None:
        # What happened after the vehicle had tilted comes of it; NaN tells no time and is explained as well.
        grave = [finding if finding.at_s < tilted.at_s else finding.because(tilted) for finding in grave]
    return tuple(grave) or _lesser(flight, result)


def _grave(flight: FlightLog, result: Result) -> list[Finding]:
    """What made a flight fail or put the vehicle at risk, the gravest first; empty for a good flight."""
    if result.outcome == DIVERGED:
        return [Finding("diverged", Severity.DANGER)]
    wrong = [_nearness(flight, result.metrics)] if too_near(result.metrics, flight.mission.promised_m) else []
    wrong += broken_limits(flight, result.metrics)
    if result.alerts:
        called = called_for(flight, result.alerts, wrong)
        if result.metrics["pitch_largest_deg"] > EXCESS_SETTINGS.steep_deg:
            called = [
                finding.because(Finding("loops doubtful", Severity.DANGER))
                if finding.kind == "safety reaction" and finding.cause is None
                else finding
                for finding in called
            ]
        wrong = called
    elif missed := [(k, leg) for k, leg in enumerate(result.legs) if not leg.reached]:
        k, leg = missed[0]
        if math.isnan(leg.begin_s) or result.outcome == "out of time":
            words = {"outcome": result.words}
            wrong.append(Finding("waypoint out of time", Severity.PROBLEM, leg.label, words))
        else:
            wrong.append(missed_waypoint(flight, k, leg))
    return wrong + beyond_the_model(flight, result.metrics)


def beyond_the_model(flight: FlightLog, metrics: Mapping[str, float]) -> list[Finding]:
    """Where the vehicle left the water, or pitched beyond what its model and loops are made for."""
    wrong = []
    if (pitch := metrics["pitch_largest_deg"]) > EXCESS_SETTINGS.steep_deg:
        values = {
            "pitch_deg": pitch,
            "limit_deg": EXCESS_SETTINGS.steep_deg,
            **_at(flight, metrics["pitch_time_s"]),
        }
        wrong.append(Finding("pitched over", Severity.DANGER, flight.vehicle.name, values))
    if (height := -metrics["depth_smallest_m"]) > EXCESS_SETTINGS.in_the_air_m:
        values = {"height_m": height, **_at(flight, metrics["depth_smallest_time_s"])}
        wrong.append(Finding("left the water", Severity.DANGER, flight.vehicle.name, values))
    return wrong


def tilt(flight: FlightLog) -> Finding | None:
    """That the hull tilted in a mode in which no loop holds its pitch; None where it did not.

    The destabilising (Munk) moment grows with the speed squared, the righting moment does not: above a speed
    pitch is unstable (Fossen 2011, chapter 12), and thrust beside the centre tilts a hull at any speed. Where
    the actuators can command pitch, a loop is what is missing.
    """
    free = [k for k, mode in enumerate(flight.autopilot.modes) if "pitch" not in mode["loop_names"]]
    rows = flight.under_way & np.isin(flight.mode, free)
    tilted = np.abs(flight.euler[:, 1]) > SETTINGS.tilted
    # What a mode with a pitch loop tilted on purpose, and left behind, is none of its own.
    begun = np.flatnonzero(rows[1:] & tilted[1:] & ~tilted[:-1]) + 1
    if not len(begun):
        return None
    speed = float(np.max(np.abs(flight.nu[rows, 0])))
    limit, name = unstable_from(flight.vehicle, 2.0 * speed), flight.vehicle.name
    pitch = math.degrees(float(np.max(np.abs(flight.euler[rows, 1]))))
    began = float(flight.t[begun[0]])
    if "M" in commanded_rows(flight.vehicle):
        values: dict[str, Any] = {"pitch_deg": pitch, "mode": flight.modes[int(flight.mode[begun[0]])]}
        return Finding("pitch not held", Severity.DANGER, name, values, at_s=began)
    if limit is None or speed < SETTINGS.safe_share * limit:
        return None
    asked, height = max(stop.speed for stop in flight.route.stops), statics(flight.vehicle).b_over_g_m
    values = {
        "from_m_s": limit,
        "flown_m_s": speed,
        "pitch_deg": pitch,
        "safe_m_s": SETTINGS.safe_share * limit,
        "b_over_g_m": height,
        # The righting moment has to grow as the speed squared does.
        "b_over_g_needed_m": height * (asked / (SETTINGS.safe_share * limit)) ** 2,
    }
    return Finding("pitch unstable", Severity.DANGER, name, values, at_s=began)


def unstable_from(vehicle: Any, fastest_m_s: float) -> float | None:
    """Speed ahead from which pitch is unstable, m/s; None where it is stable up to the fastest one."""
    if growth(vehicle, fastest_m_s, "pitch") <= 0.0 or growth(vehicle, 0.0, "pitch") > 0.0:
        return None
    from scipy.optimize import brentq

    return float(brentq(lambda speed: growth(vehicle, speed, "pitch"), 0.0, fastest_m_s, xtol=1e-3))


def _at(flight: FlightLog, time_s: float) -> dict[str, Any]:
    """When and where a time was, as values of a finding."""
    return where(flight, int(np.argmin(np.abs(flight.t - time_s))))


def where(flight: FlightLog, row: int) -> dict[str, Any]:
    """When and where a row is: time in s, position in m, and the leg that is under way."""
    north, east, down = flight.position[row].tolist()
    stop = flight.route.stops[min(int(flight.leg[row]), len(flight.route.stops) - 1)]
    return {
        "at_s": float(flight.t[row]),
        "north_m": north,
        "east_m": east,
        "depth_m": down,
        "leg": stop.label,
    }


def _nearness(flight: FlightLog, metrics: Mapping[str, float]) -> Finding:
    """How near the hull came to something, because of a position that was so wrong where that explains it."""
    at = metrics["clearance_time_s"]
    row = int(np.argmin(np.abs(flight.t - at)))
    perceived = [flight.measured[name][row] for name in ("x", "y")]
    off = math.dist(perceived, flight.position[row, :2])
    short = -min(metrics["clearance_m"], metrics["clearance_reserve_m"])
    near = Finding("too near", Severity.DANGER, flight.vehicle.name, clearance(flight, metrics), at_s=at)
    if off > max(short, SETTINGS.off_m):
        return near.because(wrong_position(flight, math.inf, off_m=off))
    return near


def clearance(flight: FlightLog, metrics: Mapping[str, float]) -> dict[str, Any]:
    """How near the hull came to what stands in the water, when and where, and what was promised, m."""
    clear, reserve = metrics["clearance_m"], metrics["clearance_reserve_m"]
    counts = promise_counts(clear, reserve)
    promised = flight.mission.promised_m if counts else math.nan
    values = {"clearance_m": clear, "reserve_m": reserve, "promised_m": promised}
    return values | _at(flight, metrics["clearance_time_s"])


def _lesser(flight: FlightLog, result: Result) -> tuple[Finding, ...]:
    """The weakness of a flight that succeeded: time, errors beyond a radius, supply, saturation."""
    if late := overrun(flight, result.legs):
        return (late,)
    busy = saturated_loops(result.loops)
    if off := off_course(flight, result.legs):
        return (off, *busy[:1])
    supply = flight.circumstances.voltage_v
    if supply is not None and (beyond := beyond_tables(flight.vehicle, supply)):
        return (Finding("thrust table exceeded", Severity.WEAKNESS, values={"sentence": beyond[0]}),)
    for loop in result.loops.values():
        exhausted = loop.name in ("pitch", "heave") and loop.saturated > SETTINGS.exhausted_share
        if exhausted and (trim := out_of_trim(flight, loop.name)):
            values = {"share": loop.saturated, "of": "of its time"}
            return (Finding("loop saturated", Severity.WEAKNESS, loop.name, values, trim),)
    return tuple(busy[:1])


def saturated_loops(loops: Mapping[str, Loop]) -> list[Finding]:
    """Loops that were saturated, the most saturated one first."""
    return [
        Finding(
            "loop busy",
            Severity.WEAKNESS,
            loop.name,
            {"share": loop.saturated, "demand": loop.demand_largest, "unit": loop.demand_unit},
        )
        for loop in sorted(loops.values(), key=lambda loop: -loop.saturated)
        if loop.saturated > SETTINGS.saturated_share
    ]


def broken_limits(flight: FlightLog, metrics: Mapping[str, float]) -> list[Finding]:
    """Bottom, fence and limits of the mission that the vehicle broke, the gravest first."""
    wrong = []
    name, limits, depth = flight.vehicle.name, flight.mission.limits, flight.position[:, 2]
    altitude = np.where(np.isfinite(flight.altitude), flight.altitude, np.inf)
    lowest = int(np.argmin(altitude))
    least = limits["min_altitude_m"]

    def broken(kind: str, row: int, rows: Mask, **values: float) -> Finding:
        since = float(flight.t[int(np.argmax(rows))])
        return Finding(kind, Severity.DANGER, name, values | where(flight, row), at_s=since)

    # Each limit is told where it was broken furthest, and began when it was broken first.
    if touched(metrics):
        wrong.append(broken("bottom touched", lowest, altitude <= 0.0))
    elif too_low(metrics, least):
        values = {"altitude_m": float(altitude[lowest]), "limit_m": least}
        wrong.append(broken("too low", lowest, altitude < least - EXCESS_SETTINGS.off_limit_m, **values))
    if len(flight.mission.fence):
        beyond = outside(flight.position[:, :2], flight.mission.fence)
        row = int(np.argmax(beyond))
        if beyond[row] > EXCESS_SETTINGS.off_limit_m:
            wrong.append(
                broken(
                    "outside the fence",
                    row,
                    beyond > EXCESS_SETTINGS.off_limit_m,
                    beyond_m=float(beyond[row]),
                )
            )
    most = limits["max_depth_m"]
    if too_deep(metrics, most):
        row = int(np.nanargmax(depth))
        values = {"deepest_m": metrics["depth_largest_m"], "limit_m": most}
        wrong.append(broken("too deep", row, depth > most + EXCESS_SETTINGS.off_limit_m, **values))
    return wrong


def wrong_position(flight: FlightLog, until_s: float, *, off_m: float = math.nan) -> Finding:
    """That the position was wrong, by `off_m` if that is known, because of an outage that had begun before
    `until_s`.
    """
    missing = any(injected(flight, group, math.inf) for group in ("position", "velocity", "water"))
    values = {
        "outage": injected(flight, "position", until_s) if math.isnan(off_m) else "",
        "off_m": off_m,
        "filtered": flight.circumstances.navigation == "filter",
        "missing": missing,
    }
    return Finding("position wrong", Severity.PROBLEM, values=values)


def outside(points: Array, fence: Array) -> Array:
    """Distance (n,), m, of points (n, 2) to a fence (m, 2) where they are outside of it, else 0."""
    inside = np.zeros(len(points), dtype=bool)
    nearest = np.full(len(points), np.inf)
    north, east = points.T
    for (north_0, east_0), (north_1, east_1) in zip(fence, np.roll(fence, -1, axis=0), strict=True):
        along = np.array([north_1 - north_0, east_1 - east_0])
        share = (north - north_0) * along[0] + (east - east_0) * along[1]
        share = np.clip(share / max(float(along @ along), 1e-30), 0.0, 1.0)
        nearest = np.fmin(
            nearest, np.hypot(north - north_0 - share * along[0], east - east_0 - share * along[1])
        )
        # A ray to the north crosses the side: an odd number of crossings is inside.
        if east_0 != east_1:
            crosses = (east_0 > east) != (east_1 > east)
            inside ^= crosses & (north < north_0 + (east - east_0) * along[0] / along[1])
    return np.where(inside | ~np.isfinite(north), 0.0, nearest)


def missed_waypoint(flight: FlightLog, k: int, leg: Leg) -> Finding:
    """How near the vehicle came to the waypoint of leg `k` that it began and missed, and why."""
    values: dict[str, Any] = {
        "perceived_m": leg.perceived_m,
        "acceptance_m": leg.acceptance_m,
        "smallest_m": leg.smallest_m,
    }
    ended = leg.begin_s + leg.time_s
    missed = Finding("waypoint missed", Severity.PROBLEM, leg.label, values, at_s=ended)
    if leg.perceived_m <= leg.acceptance_m < leg.smallest_m:
        return missed.because(wrong_position(flight, ended))
    aside, deep = _miss(flight, k)
    missed = replace(missed, values=values | {"aside_m": aside, "deep_m": deep, "loop": "heading"})
    by = "heave" if _by_heave(flight, k) else "pitch"
    slope = _Slope.of(flight, k)
    if abs(deep) > aside and (slope is None or slope.flown < SETTINGS.flat_share * slope.asked):
        share = _saturated_on(flight, k, by)
        if share > SETTINGS.exhausted_share:
            exhausted = Finding("loop saturated", Severity.PROBLEM, by, {"share": share, "of": "of the leg"})
            return missed.because(exhausted).because(out_of_trim(flight, by, shallow=deep < 0.0))
    # What a leg is steeper than guidance allows is made in circles, so that the miss may be aside.
    if slope is not None and (slope.refused or (slope.lagging and abs(deep) > aside)):
        return missed.because(slope.finding())
    if abs(deep) > aside:
        return replace(missed, values={**missed.values, "loop": by})
    return missed


def out_of_trim(flight: FlightLog, by: str, *, shallow: bool | None = None) -> Finding | None:
    """Net buoyancy that explains why the loop of the depth ("heave" or "pitch") is at its limit; None where
    it is small against what the loop can do, or contradicts that the vehicle was too `shallow` or too
    deep.
    """
    rest = statics(flight.vehicle)
    limit = float(flight.autopilot.loops().get("heave", {}).get("tau_max", 0.0))
    # A thruster carries the net buoyancy itself. Fins carry it by the lift of a hull that is pitched.
    material = SETTINGS.carried_share * limit if by == "heave" else SETTINGS.buoyant_share * rest.weight_n
    if abs(rest.net_n) <= material or (shallow is not None and shallow != (rest.net_n > 0.0)):
        return None
    values = {"net_n": rest.net_n, "weight_n": rest.weight_n}
    return Finding("out of trim", Severity.PROBLEM, by, values)


def _saturated_on(flight: FlightLog, k: int, loop: str) -> float:
    """Share of the time of leg `k` in which a loop was saturated."""
    rows = flight.under_way & (flight.leg == k)
    return (
        float(np.mean(saturated(flight, autopilot_names()["loops"].index(loop))[rows])) if rows.any() else 0.0
    )


def overrun(flight: FlightLog, legs: Sequence[Leg]) -> Finding | None:
    """How much longer than planned or allowed a flight took, where and why; None if it did not."""
    took, planned, allowed = float(flight.t[-1]), flight.route.planned_time, flight.route.longest
    if took < max(SETTINGS.late_ratio * planned, planned + SETTINGS.late_s) and took <= allowed:
        return None
    values: dict[str, Any] = {"took_s": took, "planned_s": planned, "allowed_s": allowed}
    lost = [
        (leg.time_s - _planned(flight, k), k)
        for k, leg in enumerate(legs)
        if leg.task == "pass" and math.isfinite(leg.time_s)
    ]
    if not lost or max(lost)[0] <= 0.0:
        return Finding("late", Severity.WEAKNESS, values=values)
    k = max(lost)[1]
    leg, stop = legs[k], flight.route.stops[k]
    values |= {
        "leg_s": leg.time_s,
        "leg_planned_s": _planned(flight, k),
        "made_good_m_s": flight.route.length(k) / leg.time_s,
        "asked_m_s": stop.speed,
    }
    slope = _Slope.of(flight, k)
    cause = slope.finding(missed=False) if slope is not None and slope.refused else None
    return Finding("late", Severity.WEAKNESS, leg.label, values, cause)


def off_course(flight: FlightLog, legs: Sequence[Leg]) -> Finding | None:
    """The largest error of a leg beyond its radius of acceptance; None without one."""
    beyond = [
        (size, name, k)
        for k, leg in enumerate(legs)
        for name, size in (("cross-track", leg.cross_track_largest_m), ("vertical", leg.vertical_largest_m))
        if size > leg.acceptance_m
    ]
    if not beyond:
        return None
    size, name, k = max(beyond)
    guidance, speed = flight.autopilot.guidance(), flight.route.stops[k].speed
    current = math.hypot(*flight.circumstances.current[:2])
    values = {
        "error": name,
        "error_m": size,
        "acceptance_m": legs[k].acceptance_m,
        "loop": "heave" if _by_heave(flight, k) else "pitch",
        "speed_m_s": speed,
        "current_m_s": current,
        "crossing": current > 0.1 * speed,  # from a tenth of a leg's speed on a current counts across it
        "lookahead_m": guidance["lookahead_m"],
        "integral_gain_m_s": guidance["integral_gain_m_s"],
    }
    return Finding("off course", Severity.WEAKNESS, legs[k].label, values)


@dataclass(frozen=True)
class _Slope:
    """Slope of a leg, what the autopilot asks for at most, and the steepest that was flown, rad; change of
    depth, positive down, and horizontal length, m; the key of ``[guidance]`` that limits it.
    """

    depth_m: float
    length_m: float
    limit: float
    limited_by: str
    flown: float

    @classmethod
    def of(cls, flight: FlightLog, k: int) -> _Slope | None:
        """Slope of leg `k`; None where the bottom is followed, it is level, or heave dives on the spot."""
        path = flight.route
        depth = 0.0 if path.follows_bottom(k) else float(path.stops[k].position[2] - path.before(k)[2])
        guidance, speed = flight.autopilot.guidance(), path.stops[k].speed
        pitch, rate = float(guidance["pitch_max_deg"]), float(guidance["depth_rate_max_m_s"])
        by_heave = _by_heave(flight, k)
        if depth == 0.0 or (by_heave and path.length(k) == 0.0):
            return None
        return cls(
            depth_m=depth,
            length_m=max(path.length(k) - path.stops[k].radius, 0.0),
            limit=math.asin(min(rate / speed, 1.0)) if by_heave else math.radians(pitch),
            limited_by=f"depth_rate_max_m_s = {rate:g}" if by_heave else f"pitch_max_deg = {pitch:g}",
            flown=_steepest(flight, k, math.copysign(1.0, depth)),
        )

    @property
    def asked(self) -> float:
        """Slope of the straight leg, rad."""
        return math.atan2(abs(self.depth_m), self.length_m)

    @property
    def refused(self) -> bool:
        """Whether the leg is steeper than guidance flies it."""
        return self.asked > SETTINGS.slope_ratio * self.limit

    @property
    def lagging(self) -> bool:
        """Whether the vehicle flew nowhere as steep as the leg is."""
        return self.asked > SETTINGS.lagging_ratio * self.flown > 0.0

    def finding(self, *, missed: bool = True) -> Finding:
        """The slope against what is possible, and how long the leg has to be, for a waypoint that was missed
        or late.
        """
        reach = min(self.limit, self.flown) if self.lagging else self.limit
        values = {
            "depth_m": self.depth_m,
            "length_m": self.length_m,
            "asked_deg": math.degrees(self.asked),
            "limit_deg": math.degrees(self.limit),
            "limited_by": self.limited_by,
            "flown_deg": math.degrees(self.flown),
            "needed_m": math.ceil(abs(self.depth_m) / math.tan(reach)),
            "missed": missed,
        }
        return Finding("leg too steep", Severity.PROBLEM, values=values)


def _by_heave(flight: FlightLog, k: int) -> bool:
    """Whether the mode at the speed of leg `k` controls the depth by heave."""
    modes, speed = flight.autopilot.modes, flight.route.stops[k].speed
    reached = [mode for mode in modes[1:] if speed >= mode["from_speed_m_s"]]
    return str((reached or list(modes[:1]))[-1]["depth_by"]) == "heave"


def _miss(flight: FlightLog, k: int) -> tuple[float, float]:
    """Distance aside of waypoint `k`, and how much too deep, m, where the vehicle came nearest to it."""
    stop = flight.route.stops[k]
    # A turn begins before a waypoint that is only passed: the next leg may come nearer.
    legs = (k, k + 1) if stop.task == "pass" else (k,)
    rows = np.flatnonzero(flight.under_way & np.isin(flight.leg, legs))
    aside = np.abs(np.hypot(*(flight.position[rows, :2] - stop.position[:2]).T) - stop.radius)
    if stop.vertical == "altitude":
        deep = stop.position[2] - flight.altitude[rows]
    else:
        deep = flight.position[rows, 2] - stop.position[2]
    nearest = int(np.argmin(np.hypot(aside, deep)))
    return float(aside[nearest]), float(deep[nearest])


def _steepest(flight: FlightLog, k: int, sign: float) -> float:
    """Steepest path over 5 s on leg `k` towards its depth, rad; over the whole leg where it was shorter."""
    rows = np.flatnonzero(flight.under_way & (flight.leg == k))
    window = min(max(round(SETTINGS.steepness_s / flight.period_s), 1), len(rows) - 1)
    if window < 1:
        return 0.0
    north, east, down = flight.position[rows].T
    way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(north), np.diff(east)))])
    steep = np.arctan2(sign * (down[window:] - down[:-window]), way[window:] - way[:-window])
    return max(float(np.max(steep)), 0.0)


def _planned(flight: FlightLog, k: int) -> float:
    """Time of the straight leg `k` at its speed, s."""
    path = flight.route
    down = 0.0 if path.follows_bottom(k) else float(path.stops[k].position[2] - path.before(k)[2])
    return math.hypot(path.length(k), down) / path.stops[k].speed


GROUPS = {
    "position": "position",
    "depth": "depth",
    "attitude": "attitude",
    "velocity": "velocity over ground",
    "rates": "turn rates",
    "altitude": "altitude",
}
"""What a group of channels is called, by its name in ``stale_…``."""


def group(watch: str) -> str:
    """Group of channels whose samples a watch misses ("stale_velocity": "velocity"); empty for the other
    watches.
    """
    return watch.removeprefix("stale_") if watch.startswith("stale_") else ""


def reaction_key(watch: str) -> str:
    """Key under ``[safety]`` of the reaction to a watch, such as "depth" or "stale_velocity.reaction"."""
    watch = watch.replace("contradicted_", "stale_") if watch.startswith("contradicted_") else watch
    watch = "stale_depth" if watch == "ascent" else watch
    alone = watch in ("depth", "altitude", "fence", "time")
    return watch if alone else f"{watch}.reaction"


def patience(watch: str, safety: Mapping[str, Any]) -> float:
    """For how long a watch waits after what it misses was there last, s; `safety` is that of
    ``Autopilot.safety()``.
    """
    if watch.startswith("contradicted_"):
        watch = "contradiction"
    table = safety.get(watch)
    return float(table.get("after_s", 0.0)) if isinstance(table, Mapping) else 0.0


@dataclass(frozen=True)
class ReactionSettings:
    """When a vehicle that is to come up does not."""

    rising_m_s: float = 0.02  #: Slower it does not come up, m/s.
    lately_s: float = 10.0  #: Time over which that is told, s.


REACTIONS = ReactionSettings()


@dataclass(frozen=True)
class Alert:
    """A reaction of the autopilot's safety: when, what it did, why."""

    t_s: float
    reaction: str
    cause: str


def injected(flight: FlightLog, group: str, at_s: float) -> str:
    """The outage of a group of channels that was asked for and had begun by a time, in words, or ""."""
    begun = [
        outage for outage in flight.circumstances.outages if outage.group == group and outage.from_s <= at_s
    ]
    return begun[-1].sentence() if begun else ""


def called_for(flight: FlightLog, alerts: Sequence[Alert], others: Sequence[Finding]) -> list[Finding]:
    """The first reaction, why, and what became of the vehicle, in its place among `others`, gravest first:
    before them where the vehicle did not come up, or where its cause began before theirs.
    """
    first = alerts[0]
    missed = group(first.cause)
    waited = patience(first.cause, flight.autopilot.safety())
    begun = first.t_s - waited
    earlier = any(finding.at_s > begun for finding in others)
    after = ascent(flight, alerts)
    values = {
        "reaction": first.reaction,
        "watch": first.cause,
        "called_s": first.t_s,
        "waited_s": waited,
        "group": missed,
        "outage": injected(flight, missed, first.t_s),
        # A watch of samples that waited while something else went wrong waited too long.
        "too_patient": bool(earlier and missed),
        **after,
    }
    called = Finding("safety reaction", Severity.DANGER, flight.vehicle.name, values, at_s=begun)
    lost = after.get("ended") in ("sank", "stayed")
    return [called, *others] if earlier or lost else [*others, called]


def ascent(flight: FlightLog, alerts: Sequence[Alert]) -> dict[str, Any]:
    """What became of a vehicle that was to come up and was not up at the end; empty where it was. ``ended``
    is "rising" where it only was not given the time, "sank" or "stayed".
    """
    if not alerts or alerts[-1].reaction not in ("surface", "abort"):
        return {}
    last, depth = alerts[-1], flight.position[:, 2]
    begins, lately = np.searchsorted(flight.t, (last.t_s, flight.t[-1] - REACTIONS.lately_s))
    since = float(flight.t[-1]) - last.t_s
    highest = float(np.nanmin(depth[begins:]))
    up = highest <= flight.autopilot.safety()["surfaced_above_m"]
    if up or since < REACTIONS.lately_s or not math.isfinite(depth[-1]):
        return {}
    rising = float((depth[lately] - depth[-1]) / (flight.t[-1] - flight.t[lately]))
    sank = depth[-1] > depth[begins] + 0.1  # less is the way on of a hull under way
    return {
        "ended": "rising" if rising > REACTIONS.rising_m_s else "sank" if sank else "stayed",
        "since_s": since,
        "rising_m_s": rising,
        "begun_m": float(depth[begins]),
        "ended_m": float(depth[-1]),
        "net_n": statics(flight.vehicle).net_n,
        "down_m_s": float(flight.circumstances.current[2]),
        "last_reaction": last.reaction,
        "last_watch": last.cause,
    }
