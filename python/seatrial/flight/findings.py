"""What went wrong on a flight, by the facts of its log: limits that it broke, waypoints missed, time lost.

Each finding is a sentence without its full stop and what to do about it. True positions count, not those
that the autopilot was told.

The slope of a leg is compared with what guidance asks for at most (``pitch_max_deg`` where the depth goes by
pitch, ``depth_rate_max_m_s`` at the leg's speed where it goes by heave), and with the steepest path over 5 s
that the vehicle flew on it.

Held by ``tests/flight/test_findings.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seatrial._core import autopilot_names
from seatrial.base.arrays import Array, Mask
from seatrial.flight.excesses import OFF_LIMIT_M, too_deep, too_low, touched
from seatrial.flight.metrics import Leg, saturated
from seatrial.flight.watches import source
from seatrial.vehicle.stability import statics

if TYPE_CHECKING:
    from seatrial.flight.log import FlightLog

_WINDOW_S = 5.0  # over which the steepness of a path is told

_STEEPER, _LAGGING = 1.05, 1.25  # of a slope over what guidance allows, and over what was flown

_HARDLY, EXHAUSTED = 0.5, 0.5  # of a leg's slope, and of its time: its loop does not change the depth at all

_BUOYANT = 0.01  # of the weight: hulls of torpedoes carry so much net buoyancy at a few degrees of pitch

_CARRIED = 0.5  # of the heave loop's limit: less net buoyancy leaves enough to change the depth

_CROSSING = 0.1  # of a leg's speed: from there on a current counts across it

_LONGER, _LEAST_S = 1.2, 30.0  # of the planned time, from which on a flight was late, and at least so much


class Finding(NamedTuple):
    """What was found, a sentence without its full stop, and what to do about it."""

    words: str
    remedy: str
    at_s: float = math.nan
    """When it began; nan where that says nothing."""


def broken_limits(flight: FlightLog, metrics: Mapping[str, float]) -> list[Finding]:
    """Bottom, fence and limits of the mission that the vehicle broke, the gravest first."""
    found = []
    name, limits, depth = flight.vehicle.name, flight.mission.limits, flight.position[:, 2]
    altitude = np.where(np.isfinite(flight.altitude), flight.altitude, np.inf)
    lowest = int(np.argmin(altitude))
    away = "plan the legs farther from the bottom, or slow down before the depth changes"
    least = limits["min_altitude_m"]
    if touched(metrics):
        since = _since(flight, altitude <= 0.0)
        found.append(Finding(f"{name} touched the bottom, {where(flight, lowest)}", away, since))
    elif too_low(metrics, least):
        words = f"{name} came to {altitude[lowest]:.2f} m above the bottom, {where(flight, lowest)};"
        words += f" the mission's least altitude is {least:g} m"
        found.append(Finding(words, away, _since(flight, altitude < least - OFF_LIMIT_M)))
    if len(flight.mission.fence):
        beyond = outside(flight.position[:, :2], flight.mission.fence)
        row = int(np.argmax(beyond))
        if beyond[row] > OFF_LIMIT_M:
            words = f"{name} was up to {beyond[row]:.1f} m outside the mission's fence, {where(flight, row)}"
            inside = "plan the legs and their turns farther inside the fence, or widen it"
            found.append(Finding(words, inside, _since(flight, beyond > OFF_LIMIT_M)))
    most = limits["max_depth_m"]
    if too_deep(metrics, most):
        row = int(np.nanargmax(depth))
        words = f"{name} went {metrics['depth_largest_m']:.2f} m deep, {where(flight, row)};"
        words += f" the mission's largest depth is {most:g} m"
        remedy = "plan shallower legs, or raise the mission's largest depth"
        found.append(Finding(words, remedy, _since(flight, depth > most + OFF_LIMIT_M)))
    return found


def _since(flight: FlightLog, broken: Mask) -> float:
    """Time of the first row that is broken, s."""
    return float(flight.t[int(np.argmax(broken))])


def injected(flight: FlightLog, group: str, at_s: float) -> str:
    """The outage of a group of channels that was asked for and had begun by a time, in words; empty without.

    Parameters
    ----------
    flight : FlightLog
    group : str
        As "position".
    at_s : float
    """
    begun = [one for one in flight.circumstances.outages if one.group == group and one.from_s <= at_s]
    return begun[-1].sentence() if begun else ""


def position_remedy(flight: FlightLog) -> str:
    """What to do about a position that was wrong: what the flight did not have already.

    A navigation filter bridges samples that are missing. Alone it takes an offset of the fix for the truth;
    USBL and ranges to landmarks, which only the filter reads, show it (docs/validation.md, acoustics).
    """
    fixes = f"give it {source('position')}, or position fixes more often or more exact ones"
    if flight.circumstances.navigation == "filter":
        return fixes
    missing = any(injected(flight, group, math.inf) for group in ("position", "velocity", "water"))
    if missing:
        return f"{fixes}, or fly by the navigation filter (--navigation filter), which bridges the outage"
    return f"{fixes}; USBL and ranges need --navigation filter, which alone does not find an offset"


def outside(points: Array, fence: Array) -> Array:
    """Distance (n,), m, of points (n, 2) to a fence (m, 2) where they are outside of it, else 0.

    Examples
    --------
    >>> square = np.array([[0.0, 0.0], [0.0, 4.0], [4.0, 4.0], [4.0, 0.0]])
    >>> outside(np.array([[2.0, 2.0], [2.0, 5.5], [-3.0, -4.0]]), square).tolist()
    [0.0, 1.5, 5.0]
    """
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


def not_reached(leg: Leg) -> str:
    """How near it came, as perceived, which decides whether the waypoint counts as reached, and in truth."""
    return (
        f'"{leg.label}" not reached: the autopilot perceived it at {leg.perceived_m:.2f} m at the nearest'
        f" (radius {leg.acceptance_m:g} m), the true distance was {leg.smallest_m:.2f} m"
    )


def missed_waypoint(flight: FlightLog, k: int, leg: Leg) -> Finding:
    """How near the vehicle came to the waypoint of leg `k` that it began and missed, why, and what to do."""
    words = not_reached(leg)
    if leg.perceived_m <= leg.acceptance_m < leg.smallest_m:
        outage = injected(flight, "position", leg.begin_s + leg.time_s)
        why = f" ({outage})" if outage else ""
        return Finding(f"{words}: its position was wrong by so much{why}", position_remedy(flight))
    aside, deep = _miss(flight, k)
    words += f", {aside:.1f} m aside and {abs(deep):.1f} m too {'deep' if deep > 0.0 else 'shallow'}"
    slope = _Slope.of(flight, k)
    if abs(deep) > aside and (slope is None or slope.flown < _HARDLY * slope.asked):
        by = "heave" if _by_heave(flight, k) else "pitch"
        share = _saturated_on(flight, k, by)
        if share > EXHAUSTED:
            words += f"; the {by} loop was saturated for {100.0 * share:.0f} % of the leg"
            cause = out_of_trim(flight, by, shallow=deep < 0.0)
            remedy = cause.remedy if cause else "fly faster if fins steer it, or fit stronger actuators"
            words += f": {cause.words}" if cause else ""
            return Finding(words, f"{remedy}; a longer leg does not help")
    # What a leg is steeper than guidance allows is made in circles, so that the miss may be aside.
    if slope is not None and (slope.refused or (slope.lagging and abs(deep) > aside)):
        return Finding(
            f"{words}; {slope.words()}", f"{slope.remedy()}; a larger acceptance radius would only hide it"
        )
    if abs(deep) > aside:
        return Finding(
            words,
            "slow the leg down or lengthen it, for its depth was not reached in time; then tune the"
            f" {'heave' if _by_heave(flight, k) else 'pitch'} loop (seatrial tune)",
        )
    return Finding(
        words,
        f"enlarge its acceptance radius beyond {leg.smallest_m:.1f} m, slow the leg down, or tune the heading"
        " loop (seatrial tune)",
    )


def out_of_trim(flight: FlightLog, by: str, *, shallow: bool | None = None) -> Finding | None:
    """Net buoyancy that explains why the loop that changes the depth is at its limit, and what to do.

    Parameters
    ----------
    flight : FlightLog
    by : str
        The loop: "heave" or "pitch".
    shallow : bool, optional
        Whether the vehicle was too shallow, which only buoyancy explains, or too deep; either if omitted.

    Returns
    -------
    Finding or None
        A clause, None where the net buoyancy is small against what the loop can do.
    """
    rest = statics(flight.vehicle)
    net = abs(rest.net_n)
    limit = float(flight.autopilot.loops().get("heave", {}).get("tau_max", 0.0))
    # A thruster carries the net buoyancy itself. Fins carry it by the lift of a hull that is pitched.
    material = _CARRIED * limit if by == "heave" else _BUOYANT * rest.weight_n
    if net <= material or (shallow is not None and shallow != (rest.net_n > 0.0)):
        return None
    kind, change = (
        ("light", "take out buoyancy or add ballast") if rest.net_n > 0.0 else ("heavy", "add buoyancy")
    )
    words = f"the vehicle is too {kind} by {net:.1f} N ({100.0 * net / rest.weight_n:.1f} % of its weight)"
    faster = " or fly the leg faster, for the force of fins grows with the speed squared"
    return Finding(words, f"trim the vehicle ({change}){faster if by == 'pitch' else ''}")


def _saturated_on(flight: FlightLog, k: int, loop: str) -> float:
    """Share of the time of leg `k` in which a loop was saturated."""
    rows = flight.under_way & (flight.leg == k)
    return (
        float(np.mean(saturated(flight, autopilot_names()["loops"].index(loop))[rows])) if rows.any() else 0.0
    )


def overrun(flight: FlightLog, legs: Sequence[Leg]) -> Finding | None:
    """How much longer than planned or allowed a flight took, where and why; None if it did not."""
    took, planned, allowed = float(flight.t[-1]), flight.route.planned_time, flight.route.longest
    if took < max(_LONGER * planned, planned + _LEAST_S) and took <= allowed:
        return None
    words = f"it took {took:.0f} s, {took / planned:.2g} times the planned {planned:.0f} s"
    words += f", and the mission allows {allowed:.0f} s" if took > allowed else ""
    lost = [
        (leg.time_s - _planned(flight, k), k)
        for k, leg in enumerate(legs)
        if leg.task == "pass" and math.isfinite(leg.time_s)
    ]
    if not lost or max(lost)[0] <= 0.0:
        return Finding(words, "allow more time, or plan for the speed that the vehicle makes good")
    k = max(lost)[1]
    leg, stop = legs[k], flight.route.stops[k]
    words += f', furthest behind its plan on the way to "{leg.label}":'
    words += f" {leg.time_s:.0f} s for {_planned(flight, k):.0f} s"
    slope = _Slope.of(flight, k)
    if slope is not None and slope.refused:
        return Finding(f"{words}; {slope.words()}", slope.remedy())
    made = flight.route.length(k) / leg.time_s
    return Finding(
        f"{words} ({made:.2f} m/s made good, {stop.speed:g} m/s asked for)",
        "plan the legs for the speed that the vehicle makes good in this water, or allow more time",
    )


def off_course(flight: FlightLog, legs: Sequence[Leg]) -> Finding | None:
    """The largest error of a leg beyond its radius of acceptance, and what to do; None without one."""
    beyond = [
        (size, name, k)
        for k, leg in enumerate(legs)
        for name, size in (("cross-track", leg.cross_track_largest_m), ("vertical", leg.vertical_largest_m))
        if size > leg.acceptance_m
    ]
    if not beyond:
        return None
    size, name, k = max(beyond)
    words = f'{name} error of {size:.2f} m on the way to "{legs[k].label}", more than its acceptance radius'
    words += f" of {legs[k].acceptance_m:g} m"
    if name == "vertical":
        by = "heave" if _by_heave(flight, k) else "pitch"
        return Finding(words, f"lengthen the leg or slow it down; then tune the {by} loop (seatrial tune)")
    guidance, speed = flight.autopilot.guidance(), flight.route.stops[k].speed
    current = math.hypot(*flight.circumstances.current[:2])
    keys = [f"lookahead_m ({guidance['lookahead_m']:g})"]
    remedy = "turn onto it earlier or with a longer leg"
    if current > _CROSSING * speed:
        words += f"; the current of {current:.2g} m/s is {100.0 * current / speed:.0f} % of its {speed:g} m/s"
        keys.insert(0, f"integral_gain_m_s ({guidance['integral_gain_m_s']:g})")
        remedy = f"fly it faster against this current, {remedy}"
    return Finding(words, f"{remedy}, or tune {' and '.join(keys)} under [guidance] of the autopilot file")


@dataclass(frozen=True)
class _Slope:
    """Slope of a leg, what the autopilot asks for at most, and the steepest that was flown, rad.

    ``depth_m`` and ``length_m`` are the change of depth, positive down, and the horizontal length, m;
    ``limited_by`` is the key of ``[guidance]`` that limits it.
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
        return self.asked > _STEEPER * self.limit

    @property
    def lagging(self) -> bool:
        """Whether the vehicle flew nowhere as steep as the leg is."""
        return self.asked > _LAGGING * self.flown > 0.0

    def words(self) -> str:
        """The slope against what is possible."""
        way = "descends" if self.depth_m > 0.0 else "climbs"
        asked, limit, flown = (f"{math.degrees(x):.0f} deg" for x in (self.asked, self.limit, self.flown))
        rest = (
            f"the vehicle flew at most {flown}"
            if self.flown < self.asked
            else "the rest was made on the spot"
        )
        return (
            f"the leg {way} {abs(self.depth_m):.1f} m over {self.length_m:.1f} m, a slope of {asked}, where"
            f" guidance allows {limit} ({self.limited_by}); {rest}"
        )

    def remedy(self) -> str:
        """How long the leg has to be."""
        reach = min(self.limit, self.flown) if self.lagging else self.limit
        return (
            f"lengthen the leg to at least {math.ceil(abs(self.depth_m) / math.tan(reach))} m, or begin the"
            " change of depth a leg earlier"
        )


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
    window = min(max(round(_WINDOW_S / flight.period_s), 1), len(rows) - 1)
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


def where(flight: FlightLog, row: int) -> str:
    """When and where a row is, in words."""
    north, east, down = flight.position[row]
    label = flight.route.stops[min(int(flight.leg[row]), len(flight.route.stops) - 1)].label
    return (
        f"at {flight.t[row]:.1f} s, north {north:.1f} m, east {east:.1f} m, {down:.1f} m deep, on the way to"
        f' "{label}"'
    )
