"""What the corners and circles of a mission ask of the turning circle.

A turn by an angle psi on a circle of radius R that begins at the radius of acceptance R_0 before its corner
runs R (1 - cos psi) - R_0 sin psi beyond the next leg. A corner is tight where no circle of radius R
touches both ways within their nearer halves. R is the vehicle's (`seatrial.vehicle.turning`) or what the
largest rate of the desired heading allows, U/omega, whichever is larger. An autopilot with ``turn_radius_m``
begins its turns before the corner; what it makes of them is flown (`seatrial.check.flown`). Held by
tests/check/test_check_mission.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.control_design.autopilot_facts import autopilot_facts

if TYPE_CHECKING:
    from seatrial._core import Autopilot
    from seatrial.flight.mission import Mission

_TURNS = np.deg2rad(1.0)  # a smaller change of course is no corner

_SEEN_M = 0.5  # a deviation that nobody needs to hear of

_REVERSAL = np.pi - 1e-6


@dataclass(frozen=True)
class Corner:
    """A change of course at a waypoint that the vehicle passes.

    ``room_m`` is the radius of the largest circle that touches the ways before and behind within their nearer
    halves.
    """

    index: int
    turn: float
    room_m: float


def corners(mission: Mission) -> list[Corner]:
    """Changes of course at waypoints that the vehicle only passes, and the room for each."""
    points = mission.waypoints
    places = np.stack([points["north_m"], points["east_m"]], axis=1)
    steps = np.diff(places, axis=0, prepend=[[mission.start["north_m"], mission.start["east_m"]]])
    lengths = np.hypot(*steps.T)
    found = []
    for k in range(len(places) - 1):
        busy = points["hold_s"][k] > 0.0 or points["circle_radius_m"][k] > 0.0
        if busy or points["circle_radius_m"][k + 1] > 0.0 or min(lengths[k], lengths[k + 1]) <= 0.0:
            continue
        before, after = steps[k], steps[k + 1]
        across = before[0] * after[1] - before[1] * after[0]
        turn = float(np.arctan2(across, before @ after))
        if abs(turn) > _TURNS:
            half = 0.5 * float(min(lengths[k], lengths[k + 1]))
            found.append(Corner(k, turn, half / np.tan(0.5 * abs(turn))))
    return found


def beyond(radius_m: float, turn: float, acceptance_m: float) -> float:
    """How far in m a turn by an angle in rad runs beyond the leg that follows.

    Examples
    --------
    >>> round(beyond(10.0, np.pi / 2.0, 3.0), 6)
    7.0
    """
    angle = abs(turn)
    return float(radius_m * (1.0 - np.cos(angle)) - acceptance_m * np.sin(angle))


def turn_sentences(
    mission: Mission, circles: Mapping[float, float | None], autopilot: Autopilot | None
) -> tuple[list[str], list[str]]:
    """Notes and warnings about the turns of a mission.

    Parameters
    ----------
    mission : Mission
    circles : {float: float or None}
        Radius in m of the vehicle's tightest turn by speed in m/s.
    autopilot : Autopilot, optional
        Whose largest rate of the heading counts too.
    """
    points = mission.waypoints
    rate = None
    if autopilot is not None:
        rate = np.deg2rad(autopilot_facts(autopilot).guidance["turn_rate_max_deg_s"])
    radii: dict[float, tuple[float, str]] = {}
    for speed in map(float, np.unique(points["speed_m_s"])):
        known = [] if circles.get(speed) is None else [(circles[speed] or 0.0, "vehicle's circle")]
        if rate is not None:
            known.append((speed / float(rate), "circle of the autopilot's turn_rate_max_deg_s"))
        if known:
            radii[speed] = max(known)
    found = [corner for corner in corners(mission) if _speed(mission, corner) in radii]
    notes, warnings = [], []
    over = [
        (beyond(radii[_speed(mission, c)][0], c.turn, float(points["acceptance_radius_m"][c.index])), c.index)
        for c in found
    ]
    anticipated = autopilot is not None and autopilot_facts(autopilot).guidance["turn_radius_m"] > 0.0
    if over and max(over)[0] > _SEEN_M and not anticipated:
        widest, index = max(over)
        notes.append(f'Widest turn: {widest:.1f} m beyond the next leg, at "{points["label"][index]}"')
    tight = _tight(mission, found, radii)
    if tight:
        worst = min(tight, key=lambda corner: corner.room_m / radii[_speed(mission, corner)][0])
        radius, whose = radii[_speed(mission, worst)]
        warnings.append(
            f"{len(tight)} of {len(found)} turns are tighter than the {whose} of {radius:.1f} m at"
            f' {_speed(mission, worst):g} m/s, most of all at "{points["label"][worst.index]}" with room for'
            f" {worst.room_m:.1f} m; widen the pattern or, with thrusters, fly slower"
        )
    return notes, [*warnings, *_circles(mission, radii)]


def _speed(mission: Mission, corner: Corner) -> float:
    return float(mission.waypoints["speed_m_s"][corner.index + 1])


def _tight(mission: Mission, found: list[Corner], radii: Mapping[float, tuple[float, str]]) -> list[Corner]:
    """Corners without room for the circle; a small turn counts only beside another one."""
    small = {}
    for corner in found:
        radius = radii[_speed(mission, corner)][0]
        if corner.room_m < radius:
            cut = radius * (1.0 / np.cos(0.5 * min(abs(corner.turn), _REVERSAL)) - 1.0)
            small[corner.index] = (corner, cut)
    return [
        corner
        for k, (corner, cut) in small.items()
        if cut > _SEEN_M or any(n in small and small[n][0].turn * corner.turn > 0.0 for n in (k - 1, k + 1))
    ]


def _circles(mission: Mission, radii: Mapping[float, tuple[float, str]]) -> list[str]:
    """Sentence per circle about a waypoint that is too small."""
    points, sentences = mission.waypoints, []
    for k in np.flatnonzero(np.asarray(points["circle_radius_m"]) > 0.0):
        speed, asked = float(points["speed_m_s"][k]), float(points["circle_radius_m"][k])
        radius, whose = radii.get(speed, (0.0, ""))
        if asked < radius:
            sentences.append(
                f'the circle of {asked:g} m about "{points["label"][k]}" is tighter than the {whose} of'
                f" {radius:.1f} m at {speed:g} m/s; widen it or, with thrusters, fly slower"
            )
    return sentences
