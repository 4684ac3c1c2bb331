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

from seatrial.base.arrays import Array
from seatrial.flight.excesses import touched
from seatrial.flight.metrics import TRULY, Leg

if TYPE_CHECKING:
    from seatrial.flight.log import FlightLog

__all__ = ["Finding", "broken_limits", "missed_waypoint", "not_reached", "outside", "overrun", "where"]

_OFF_M = 0.05  # beyond a limit: less is the ripple of a loop

_WINDOW_S = 5.0  # over which the steepness of a path is told

_STEEPER, _LAGGING = 1.05, 1.25  # of a slope over what guidance allows, and over what was flown

_LONGER, _LEAST_S = 1.2, 30.0  # of the planned time, from which on a flight was late, and at least so much


class Finding(NamedTuple):
    """What was found, a sentence without its full stop, and what to do about it."""

    words: str
    remedy: str


def broken_limits(flight: FlightLog, metrics: Mapping[str, float]) -> list[Finding]:
    """Bottom, fence and limits of the mission that the vehicle broke, the gravest first."""
    found = []
    altitude, limits = metrics["altitude_smallest_m"], flight.mission.limits
    lowest = int(np.argmin(np.where(np.isfinite(flight.altitude), flight.altitude, np.inf)))
    away = "plan the legs farther from the bottom, or slow down before the depth changes"
    if touched(metrics):
        found.append(Finding(f"{flight.vehicle.name} touched the bottom, {where(flight, lowest)}", away))
    elif altitude < limits["min_altitude_m"] - _OFF_M:
        found.append(
            Finding(
                f"{flight.vehicle.name} came to {altitude:.2f} m above the bottom, {where(flight, lowest)};"
                f" the mission's least altitude is {limits['min_altitude_m']:g} m",
                away,
            )
        )
    if len(flight.mission.fence):
        beyond = outside(flight.position[:, :2], flight.mission.fence)
        row = int(np.argmax(beyond))
        if beyond[row] > _OFF_M:
            found.append(
                Finding(
                    f"{flight.vehicle.name} was up to {beyond[row]:.1f} m outside the mission's fence,"
                    f" {where(flight, row)}",
                    "plan the legs and their turns farther inside the fence, or widen it",
                )
            )
    if metrics["depth_largest_m"] > limits["max_depth_m"] + _OFF_M:
        row = int(np.nanargmax(flight.position[:, 2]))
        found.append(
            Finding(
                f"{flight.vehicle.name} went {metrics['depth_largest_m']:.2f} m deep, {where(flight, row)};"
                f" the mission's largest depth is {limits['max_depth_m']:g} m",
                "plan shallower legs, or raise the mission's largest depth",
            )
        )
    return found


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
    if leg.perceived_m <= leg.acceptance_m < TRULY * leg.acceptance_m < leg.smallest_m:
        return Finding(
            f"{words}: its position was wrong by so much",
            "give it position fixes more often or more exact ones, or fly by the navigation filter"
            " (--navigation filter)",
        )
    aside, deep = _miss(flight, k)
    words += f", {aside:.1f} m aside and {abs(deep):.1f} m too {'deep' if deep > 0.0 else 'shallow'}"
    slope = _Slope.of(flight, k)
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
