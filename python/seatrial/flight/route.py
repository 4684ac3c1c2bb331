"""The waypoints of a mission as a flight is judged by them: one after the other, with where each leg begins.

Held by ``tests/test_flight.py``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from seatrial.mission import Mission

__all__ = ["Route", "Stop"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Stop:
    """A waypoint and the leg that ends there.

    Attributes
    ----------
    label
        Its name.
    position
        North, east, and depth or altitude in m, (3,).
    vertical
        "depth" or "altitude": what the third coordinate is.
    speed, acceptance
        On the leg, m/s; radius of its sphere, m.
    task
        "pass", "hold" or "circle".
    radius
        Of the circle, m; 0 for none.
    """

    label: str
    position: Array
    vertical: str
    speed: float
    acceptance: float
    task: str
    radius: float = 0.0


@dataclass(frozen=True, eq=False)
class Route:
    """Start, heading there, waypoints and times of a mission.

    Attributes
    ----------
    name
        Of the mission.
    start
        North, east, depth, m, (3,).
    heading
        With which it begins, rad.
    stops
        Waypoints in order.
    planned_time
        By the plan, s.
    longest
        Time that the mission allows, s; infinite without a limit.
    """

    name: str
    start: Array
    heading: float
    stops: tuple[Stop, ...]
    planned_time: float
    longest: float

    @classmethod
    def of(cls, mission: Mission) -> Route:
        """Route of a mission.

        Parameters
        ----------
        mission : Mission
        """
        columns, start = mission.waypoints, mission.start
        return cls(
            name=mission.name,
            start=np.array([start["north_m"], start["east_m"], start["depth_m"]]),
            heading=float(start["heading"]),
            stops=tuple(_stop(columns, k) for k in range(len(columns["label"]))),
            planned_time=float(mission.planned_time),
            longest=float(mission.limits["max_time_s"]),
        )

    def before(self, k: int) -> Array:
        """Where leg `k` begins, (3,), m."""
        return self.start if k == 0 else self.stops[k - 1].position

    def follows_bottom(self, k: int) -> bool:
        """Whether either end of leg `k` is given by its altitude."""
        return any(self.stops[i].vertical == "altitude" for i in (k - 1, k) if i >= 0)

    def length(self, k: int) -> float:
        """Horizontal length of leg `k`, m."""
        return math.hypot(*(self.stops[k].position[:2] - self.before(k)[:2]))


def _stop(columns: dict[str, Array | list[str]], k: int) -> Stop:
    def number(name: str) -> float:
        return float(columns[name][k])

    vertical = str(columns["vertical"][k])
    task = "circle" if number("circle_radius_m") > 0.0 else "hold" if number("hold_s") > 0.0 else "pass"
    return Stop(
        label=str(columns["label"][k]),
        position=np.array([number("north_m"), number("east_m"), number(f"{vertical}_m")]),
        vertical=vertical,
        speed=number("speed_m_s"),
        acceptance=number("acceptance_radius_m"),
        task=task,
        radius=number("circle_radius_m"),
    )
