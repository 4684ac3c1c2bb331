"""The legs of a mission as its file names them, its turns, and how near its straight ways come to the fence.

As the core plans: straight between waypoints, at the speeds of the legs; a circle is joined at its point
nearest to where the vehicle comes from. Held by tests/check/test_check_mission.py against the core's sums.

A turn by an angle psi on a circle of radius R that begins at the radius of acceptance R_0 before its corner
runs R (1 - cos psi) - R_0 sin psi beyond the next leg. A corner is tight where no circle of radius R
touches both ways within their nearer halves. R is the vehicle's (`seatrial.vehicle.steady_state`) or what the
largest rate of the desired heading allows, U/omega, whichever is larger. An autopilot with ``turn_radius_m``
begins its turns before the corner; what it makes of them is flown (`seatrial.check.mission`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.finding import Finding
from seatrial.check.file_check import note, warning
from seatrial.control_design.operating_points import autopilot_facts

if TYPE_CHECKING:
    from seatrial._core import Autopilot
    from seatrial.flight.mission import Mission


@dataclass(frozen=True)
class Way:
    """The way to every waypoint: straight and circular length in m, shape (n,), and time under way in s."""

    straight: Array
    circle: Array
    travel_s: Array

    @property
    def length(self) -> Array:
        """Length in m, shape (n,)."""
        return self.straight + self.circle


@dataclass(frozen=True)
class LegRow:
    """A leg of the file; a pattern has many waypoints.

    ``first`` is the index of its first waypoint; ``slope_deg`` is the steepest, positive upwards; ``level_m``
    runs from the shallowest depth (or lowest altitude) to the deepest (or highest). Time is with
    station-keeping; power is at the actuators in still water, None where it is not known.
    """

    number: int
    kind: str
    label: str
    first: int
    waypoints: int
    length_m: float
    time_s: float
    hold_s: float
    slope_deg: float
    vertical: str
    level_m: tuple[float, float]
    speed_m_s: float
    power_w: float | None = None


def ways(mission: Mission) -> Way:
    """Length and time of the way to every waypoint."""
    points = mission.waypoints
    here = np.array([mission.start["north_m"], mission.start["east_m"]])
    straight, circle = [], []
    for k, place in enumerate(np.stack([points["north_m"], points["east_m"]], axis=1)):
        radius, turns = float(points["circle_radius_m"][k]), float(points["turns"][k])
        to = place - here
        across, here = float(np.hypot(*to)), place
        if radius > 0.0:
            across = abs(across - radius)
            bearing = np.arctan2(to[1], to[0]) + np.pi + 2.0 * np.pi * turns
            here = place + radius * np.array([np.cos(bearing), np.sin(bearing)])
        straight.append(float(np.hypot(across, _down(mission, k))))
        circle.append(2.0 * np.pi * radius * abs(turns))
    lengths = np.array(straight), np.array(circle)
    return Way(*lengths, travel_s=sum(lengths) / np.asarray(points["speed_m_s"]))


def _down(mission: Mission, k: int) -> float:
    """Change of depth in m on the way to waypoint k; none is known between a depth and an altitude."""
    points = mission.waypoints
    before = "depth" if k == 0 else points["vertical"][k - 1]
    if before != points["vertical"][k]:
        return 0.0
    column = points[f"{before}_m"]
    return float(column[k] - (mission.start["depth_m"] if k == 0 else column[k - 1]))


def leg_rows(mission: Mission, powers: dict[float, float | None]) -> tuple[LegRow, ...]:
    """The legs of the file; `powers` in W by speed."""
    points, way = mission.waypoints, ways(mission)
    numbers = np.array(mission.core.leg_numbers)
    rows = []
    for number, leg in enumerate(mission.core.legs, start=1):
        # A pattern of the file is many waypoints of the core.
        chosen = np.flatnonzero(numbers == number)
        vertical = points["vertical"][chosen[0]]
        levels = np.asarray(points[f"{vertical}_m"])[chosen]
        slopes = np.rad2deg(np.asarray(points["slope"])[chosen])
        hold = np.asarray(points["hold_s"])[chosen]
        speed = float(points["speed_m_s"][chosen[0]])
        kind = leg["kind"]
        rows.append(
            LegRow(
                number=number,
                kind=kind,
                label=points["label"][chosen[0]] if kind == "waypoint" else str(leg.get("label", kind)),
                first=int(chosen[0]),
                waypoints=len(chosen),
                length_m=float(way.length[chosen].sum()),
                time_s=float((way.travel_s[chosen] + hold).sum()),
                hold_s=float(hold.sum()),
                slope_deg=float(slopes[np.abs(slopes).argmax()]),
                vertical=vertical,
                level_m=(float(levels.min()), float(levels.max())),
                speed_m_s=speed,
                power_w=powers.get(speed),
            )
        )
    return tuple(rows)


def clearance(points: Array, fence: Array) -> tuple[float, int]:
    """Smallest distance in m of a polyline (n, 2) inside a fence (m, 2), and the index of its leg."""
    ends = np.roll(fence, -1, axis=0)
    nearest, leg = np.inf, 0
    for k, (a, b) in enumerate(pairwise(points)):
        distance = min(
            float(_to_stretches(np.stack([a, b]), fence, ends).min()),
            float(_to_stretches(fence, a[None], b[None]).min()),
        )
        if distance < nearest:
            nearest, leg = distance, k
    return nearest, leg


def _to_stretches(places: Array, begin: Array, end: Array) -> Array:
    """Distances (places, stretches) in m."""
    along = end - begin
    square = np.maximum((along * along).sum(axis=1), 1e-30)
    share = np.clip(((places[:, None] - begin) * along).sum(axis=2) / square, 0.0, 1.0)
    rest = places[:, None] - begin - share[..., None] * along
    return np.asarray(np.hypot(rest[..., 0], rest[..., 1]))


def fence_findings(mission: Mission) -> list[Finding]:
    """How near the way comes to the fence."""
    if not len(mission.fence):
        return []
    points = mission.waypoints
    start = [[mission.start["north_m"], mission.start["east_m"]]]
    places = np.vstack([start, np.stack([points["north_m"], points["east_m"]], axis=1)])
    nearest, leg = clearance(places, mission.fence)
    label, radius = points["label"][leg], float(points["acceptance_radius_m"][leg])
    if nearest < radius:
        return [warning("way near fence", label, distance_m=nearest, acceptance_m=radius)]
    return [note("fence", label, distance_m=nearest)]


@dataclass(frozen=True)
class TurnCheckSettings:
    """Which turns of a mission count."""

    #: Change of course, rad, below which a waypoint is no corner: 1 deg.
    least_turn: float = math.radians(1.0)
    #: Deviation, m, that nobody needs to hear of.
    visible_m: float = 0.5


SETTINGS = TurnCheckSettings()


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
    turns = []
    for k in range(len(places) - 1):
        busy = points["hold_s"][k] > 0.0 or points["circle_radius_m"][k] > 0.0
        if busy or points["circle_radius_m"][k + 1] > 0.0 or min(lengths[k], lengths[k + 1]) <= 0.0:
            continue
        before, after = steps[k], steps[k + 1]
        across = before[0] * after[1] - before[1] * after[0]
        turn = float(np.arctan2(across, before @ after))
        if abs(turn) > SETTINGS.least_turn:
            half = 0.5 * float(min(lengths[k], lengths[k + 1]))
            turns.append(Corner(k, turn, half / np.tan(0.5 * abs(turn))))
    return turns


def beyond(radius_m: float, turn: float, acceptance_m: float) -> float:
    """How far in m a turn by an angle in rad runs beyond the leg that follows.

    >>> round(beyond(10.0, np.pi / 2.0, 3.0), 6)
    7.0
    """
    angle = abs(turn)
    return float(radius_m * (1.0 - np.cos(angle)) - acceptance_m * np.sin(angle))


def turn_findings(
    mission: Mission, circles: Mapping[float, float | None], autopilot: Autopilot | None
) -> list[Finding]:
    """What a vehicle makes of the turns of a mission, the widest and the tightest. `circles`: radius in m of
    its tightest turn by speed in m/s; the autopilot's largest rate of the heading counts too.
    """
    points = mission.waypoints
    guidance = None if autopilot is None else autopilot_facts(autopilot).guidance
    # The wider of two circles counts: what the vehicle can, and what its autopilot allows.
    radii: dict[float, tuple[float, str]] = {}
    for speed in map(float, np.unique(points["speed_m_s"])):
        known = [] if circles.get(speed) is None else [(circles[speed] or 0.0, "vehicle")]
        if guidance is not None:
            known.append((speed / float(np.deg2rad(guidance["turn_rate_max_deg_s"])), "turn_rate_max_deg_s"))
        if known:
            radii[speed] = max(known)
    turns = [corner for corner in corners(mission) if _speed(mission, corner) in radii]
    findings = []
    over = [
        (beyond(radii[_speed(mission, c)][0], c.turn, float(points["acceptance_radius_m"][c.index])), c.index)
        for c in turns
    ]
    # An autopilot that begins its turns before the corner does not run beyond the next leg.
    anticipated = guidance is not None and guidance["turn_radius_m"] > 0.0
    if over and max(over)[0] > SETTINGS.visible_m and not anticipated:
        widest, index = max(over)
        findings.append(note("widest turn", points["label"][index], beyond_m=widest))
    if tight := _tight(mission, turns, radii):
        worst = min(tight, key=lambda corner: corner.room_m / radii[_speed(mission, corner)][0])
        speed = _speed(mission, worst)
        circle = {"radius_m": radii[speed][0], "of": radii[speed][1], "m_s": speed}
        number = {"count": len(tight), "turns": len(turns), "room_m": worst.room_m}
        findings.append(warning("tight turns", points["label"][worst.index], **number, **circle))
    return [*findings, *_circles(mission, radii)]


def _speed(mission: Mission, corner: Corner) -> float:
    return float(mission.waypoints["speed_m_s"][corner.index + 1])


def _tight(mission: Mission, turns: list[Corner], radii: Mapping[float, tuple[float, str]]) -> list[Corner]:
    """Corners without room for the circle; a small turn counts only beside another one."""
    small = {}
    for corner in turns:
        radius = radii[_speed(mission, corner)][0]
        if corner.room_m < radius:
            # Short of a reversal: cos of half a turn would divide by zero.
            cut = radius * (1.0 / np.cos(0.5 * min(abs(corner.turn), np.pi - 1e-6)) - 1.0)
            small[corner.index] = (corner, cut)
    return [
        corner
        for k, (corner, cut) in small.items()
        if cut > SETTINGS.visible_m
        or any(n in small and small[n][0].turn * corner.turn > 0.0 for n in (k - 1, k + 1))
    ]


def _circles(mission: Mission, radii: Mapping[float, tuple[float, str]]) -> list[Finding]:
    """Circles about waypoints that are too small."""
    points, findings = mission.waypoints, []
    for k in np.flatnonzero(np.asarray(points["circle_radius_m"]) > 0.0):
        speed, asked = float(points["speed_m_s"][k]), float(points["circle_radius_m"][k])
        radius, whose = radii.get(speed, (0.0, ""))
        if asked < radius:
            circle = {"radius_m": radius, "of": whose, "m_s": speed}
            findings.append(warning("tight circle", points["label"][k], asked_m=asked, **circle))
    return findings
