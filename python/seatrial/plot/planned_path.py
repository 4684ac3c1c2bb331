"""The path that a mission plans, as it is drawn: straight legs, circles joined where the vehicle meets them.

Held by `tests/test_mission_plan.py`.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seatrial.mission import Mission

__all__ = ["PlannedPath", "bottom_depth", "patterns", "planned_path"]

Array = NDArray[np.float64]
Seabed = tuple[float, float, float]

_ARC_RAD = math.radians(5.0)
_PLAIN = re.compile(r"waypoint \d+")
_OF_PATTERN = re.compile(r"(?:to )?(?P<stem>.+?) (?:\d+(?:/\d+)?|(?:round|stop) \d+.*)")


@dataclass(frozen=True, eq=False)
class PlannedPath:
    """A mission's path: points (m, 3) in order of travel, NED in m, and the waypoints on it.

    Attributes
    ----------
    points, leg
        North, east and depth along the path (the depth is nan where an altitude is kept above an unknown
        bottom), (m, 3), and the leg that each is on, (m,).
    places, names
        Start and waypoints, (n + 1, 3), and a short name each, empty inside a pattern.
    along
        Horizontal way up to each point, (m,), m.
    """

    points: Array
    leg: NDArray[np.int64]
    places: Array
    names: tuple[str, ...]

    @property
    def along(self) -> Array:
        """Horizontal way up to each point, (m,), m."""
        steps = np.hypot(*np.diff(self.points[:, :2], axis=0).T)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def way_of(self, waypoint: int) -> float:
        """Horizontal way up to the end of a leg, m."""
        return float(self.along[np.flatnonzero(self.leg == waypoint)[-1]])


def planned_path(mission: Mission, *, seabed: Seabed | None = None) -> PlannedPath:
    """Path of a mission.

    Parameters
    ----------
    mission : Mission
    seabed : tuple of float, optional
        Depth of the bottom at the origin, m, and its slopes north and east.
    """
    columns, start = mission.waypoints, mission.start
    here = np.array([start["north_m"], start["east_m"], start["depth_m"]])
    points, legs, places = [here], [0], [here]
    for k in range(len(columns["label"])):
        centre = np.array([columns["north_m"][k], columns["east_m"][k], columns["depth_m"][k]])
        if columns["vertical"][k] == "altitude":
            centre[2] = bottom_depth(centre, seabed) - columns["altitude_m"][k]
        for point in _way(here, centre, columns["circle_radius_m"][k], columns["turns"][k]):
            points.append(point)
            legs.append(k)
        here = points[-1]
        places.append(centre)
    return PlannedPath(np.array(points), np.array(legs), np.array(places), _names(columns["label"]))


def bottom_depth(place: Array, seabed: Seabed | None) -> float:
    """Depth of the bottom below a place (north, east, ...), m; nan where it is not known."""
    if seabed is None:
        return math.nan
    return float(seabed[0] + seabed[1] * place[0] + seabed[2] * place[1])


def patterns(names: Sequence[str]) -> list[tuple[str, int, int]]:
    """Runs of waypoints whose labels differ in their number only: (name, first, last)."""
    stems = [found["stem"] if (found := _OF_PATTERN.fullmatch(name)) else name for name in names]
    runs: list[tuple[str, int, int]] = []
    for k, stem in enumerate(stems):
        if runs and runs[-1][0] == stem:
            runs[-1] = (stem, runs[-1][1], k)
        else:
            runs.append((stem, k, k))
    return [(stem, first, last) for stem, first, last in runs if last > first and stem != "waypoint"]


def _way(here: Array, centre: Array, radius: float, turns: float) -> list[Array]:
    """Points after `here` to a waypoint, or to its circle at the nearest point and about it."""
    if radius <= 0.0:
        return [centre]
    out = here[:2] - centre[:2]
    bearing = math.atan2(out[1], out[0])
    count = max(2, math.ceil(abs(turns) * math.tau / _ARC_RAD))
    angles = bearing + np.linspace(0.0, turns * math.tau, count + 1)
    return [
        np.array([centre[0] + radius * math.cos(a), centre[1] + radius * math.sin(a), centre[2]])
        for a in angles
    ]


def _names(labels: Sequence[str]) -> tuple[str, ...]:
    """Short names: numbers or the labels of the file; within a pattern none but at its ends."""
    inside = {k for _, first, last in patterns(labels) for k in range(first, last + 1)}
    ends = {k for _, first, last in patterns(labels) for k in (first, last)}
    short = [
        "" if k in inside - ends else str(k + 1) if _PLAIN.fullmatch(label) or k in inside else label
        for k, label in enumerate(labels)
    ]
    return ("start", *short)
