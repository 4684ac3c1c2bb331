"""Missions from files, in metres or in latitude and longitude, and the route that a flight follows.

The core and the deployed autopilot read metres only, for they have no datum; what is geographic becomes
metres here (`seatrial.base.frames`), and `Mission.to_toml` gives the file that the autopilot reads. A `Route`
is what a flight is judged by: waypoints one after the other, with where each leg begins. Held by
``tests/flight/test_mission.py``, ``test_mission_geographic.py`` and ``test_flight.py``.
"""

from __future__ import annotations

import json
import math
import re
import reprlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial._core import Mission as CoreMission
from seatrial.base.arrays import Array
from seatrial.base.errors import VehicleError
from seatrial.base.frames import FARTHEST_M, LocalFrame
from seatrial.base.toml_file import tables, text_complaints, text_of

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

PLACE = {"latitude_deg": 90.0, "longitude_deg": 180.0}
"""Keys of a geographic place, with the largest magnitude of each."""

CORNERS = {"fence_deg": "fence_m", "corners_deg": "corners_m"}
"""Keys of geographic corners, with those of the same corners in metres."""

_METRES = ("north_m", "east_m")

_DIGITS = 4  # tenths of a millimetre: the file stays readable


@dataclass(frozen=True)
class Mission:
    """A mission: waypoints, where it starts and what it may not leave. Made by `load`, immutable.

    Attributes
    ----------
    core
        The same in metres for the compiled core; nobody else needs it.

    Raises
    ------
    VehicleError
        What is wrong with the file, in which leg, at which key, and what to do.

    Examples
    --------
    >>> import seatrial as st
    >>> mission = Mission.from_toml('''
    ... format = 1
    ... name = "out and back"
    ... speed_m_s = 1.5
    ... acceptance_radius_m = 3.0
    ... origin = { latitude_deg = 63.44, longitude_deg = 10.4 }
    ... [[legs]]
    ... latitude_deg = 63.441
    ... longitude_deg = 10.4
    ... depth_m = 5.0
    ... [[legs]]
    ... north_m = 0.0
    ... east_m = 0.0
    ... ''')
    >>> round(mission.length, 1), round(mission.planned_time, 1)
    (223.0, 148.7)
    """

    core: CoreMission  # what guidance flies, in metres; `Autopilot.engage` looks for it by this name

    def __post_init__(self) -> None:
        """Refuse what is no mission of the core."""
        if not isinstance(self.core, CoreMission):
            raise VehicleError(
                f"Mission: expected a mission of the core, found {type(self.core).__name__}; use Mission.load"
                " for a file, Mission.from_toml for text"
            )

    @classmethod
    def load(cls, path: str | Path) -> Mission:
        """Mission of the file at `path`; a geographic place in it is converted about its ``[origin]``."""
        return cls.from_toml(text_of(path, "a mission file", error=VehicleError), str(path))

    @classmethod
    def from_toml(cls, text: str, source: str = "<text>") -> Mission:
        """Mission of the text of a mission file; `source` is what to call it in messages."""
        if not isinstance(text, str):
            raise VehicleError(f"expected the text of a mission file, found {type(text).__name__}")
        # The core reads fast and says what is wrong; places in metres need no other reader.
        try:
            geographic = any(key in text for key in (*PLACE, *CORNERS))
            data = tables(text, source, error=VehicleError) if geographic else {}
        except VehicleError:
            data = {}
        if not any(_geographic(table) for _, table in _tables(data)):
            return cls(CoreMission.from_toml(text, source))
        legs = data.get("legs")
        for where, table in (("", {**data, "legs": None}), *_tables({"legs": legs})):
            for key, complaint in text_complaints(table):
                raise VehicleError(f"{source}: {where}{'.'.join(str(k) for k in key)}: {complaint}")
        _convert(data, source)
        try:
            return cls(CoreMission.from_toml(_written(data), source))
        except VehicleError as error:  # its lines are not those of the file
            raise VehicleError(re.sub(r": line \d+: ", ": ", str(error), count=1)) from None

    def to_toml(self, *, expanded: bool = False) -> str:
        """The mission file in metres, as the deployed autopilot reads it; `expanded`: with waypoints for
        patterns.
        """
        return self.core.to_toml(expanded=expanded)

    def geographic(self, points: ArrayLike) -> NDArray[np.float64]:
        """Latitude and longitude (..., 2) in degrees of points (..., 2), north and east in m; a VehicleError
        where the mission has no ``[origin]``.
        """
        if self.core.origin is None:
            raise VehicleError(
                f"mission {self.name!r}: expected [origin] with latitude_deg and longitude_deg, found none;"
                " without it the mission has no place on the Earth"
            )
        return LocalFrame(*self.core.origin).geographic(points)

    @property
    def name(self) -> str:
        """Name of the mission."""
        return self.core.name

    @property
    def description(self) -> str:
        """What the mission is for, in a sentence."""
        return self.core.description

    @property
    def origin(self) -> tuple[float, float] | None:
        """Latitude and longitude of north = east = 0 in degrees; None where the file has none."""
        return self.core.origin

    @property
    def waypoints(self) -> dict[str, Any]:
        """The waypoints as columns (n,), in the order of travel: see `seatrial._core.Mission.waypoints`."""
        return dict(self._columns)

    @cached_property
    def _columns(self) -> dict[str, Any]:
        """The columns once: the core makes them at every call, and a mission may have 10 000 waypoints."""
        return dict(self.core.waypoints)

    @property
    def start(self) -> dict[str, float]:
        """Where the first leg begins: ``north_m``, ``east_m``, ``depth_m``, and ``heading`` in rad."""
        return dict(self.core.start)

    @property
    def limits(self) -> dict[str, float]:
        """``max_depth_m`` and ``max_time_s`` (infinite without), ``min_altitude_m`` (0 without)."""
        return dict(self.core.limits)

    @property
    def fence(self) -> NDArray[np.float64]:
        """Corners (n, 2) of the fence, north and east in m; no row without one."""
        return np.asarray(self.core.fence).reshape(-1, 2)

    @property
    def obstacles(self) -> list[dict[str, Any]]:
        """What stands in the water, farms first: see `seatrial._core.Mission.obstacles`."""
        return self.core.obstacles

    @property
    def landmarks(self) -> list[dict[str, Any]]:
        """Known places that acoustic sensors see: see `seatrial._core.Mission.landmarks`."""
        return self.core.landmarks

    @cached_property
    def promised_m(self) -> float:
        """Smallest distance in m that the mission promises of what stands in the water; 0 without."""
        promised = [float(obstacle["distance_m"]) for obstacle in self.obstacles]
        return min((distance for distance in promised if distance > 0.0), default=0.0)

    @property
    def length(self) -> float:
        """Length of the path in m, from the start to the last waypoint, circles included."""
        return self.core.length

    @property
    def planned_time(self) -> float:
        """Time for the path in s at the speeds of its legs, with station-keeping and circles."""
        return self.core.planned_time


def _written(data: dict[str, Any]) -> str:
    """The mission as TOML, a line a key; a writer that keeps a layout takes the square of the entries."""
    return "".join(f"{_value(key)} = {_value(value)}\n" for key, value in data.items())


def _value(value: Any) -> str:
    """A value as TOML on one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(map(_entry, value.items())) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return str(value).lower() if isinstance(value, bool) else str(value)


def _entry(entry: tuple[str, Any]) -> str:
    return f"{_value(entry[0])} = {_value(entry[1])}"


def _tables(data: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Tables that may hold places, with what to call them in messages."""
    for key in ("start", "limits"):
        if isinstance(table := data.get(key), dict):
            yield f"{key}.", table
    for key, name in (("legs", "leg"), ("obstacles", "obstacle"), ("landmarks", "landmark")):
        tables = data.get(key)
        for number, table in enumerate(tables if isinstance(tables, list) else [], start=1):
            if isinstance(table, dict):
                yield f"{name} {number}: ", table


def _geographic(table: dict[str, Any]) -> bool:
    return any(key in table for key in (*PLACE, *CORNERS))


def _convert(data: dict[str, Any], source: str) -> None:
    """Replace every geographic place by metres, in place."""
    frame = _frame(data, source)
    for where, table in _tables(data):
        at = f"{source}: {where}"
        if given := [key for key in PLACE if key in table]:
            if missing := [key for key in PLACE if key not in table]:
                raise VehicleError(f"{at}{missing[0]}: expected with {given[0]}, found none; add it")
            if both := [key for key in _METRES if key in table]:
                raise VehicleError(
                    f"{at}{both[0]}: expected either latitude_deg and longitude_deg or metres, found both;"
                    " leave one out"
                )
            north, east = _metres(frame, [table.pop(key) for key in PLACE], at)
            table.update(zip(_METRES, (north, east), strict=True))
        for key, in_metres in CORNERS.items():
            if key not in table:
                continue
            if in_metres in table:
                raise VehicleError(f"{at}{key}: expected either it or {in_metres}, found both; leave one out")
            corners = table.pop(key)
            if not isinstance(corners, list) or not all(isinstance(c, list) and len(c) == 2 for c in corners):
                raise VehicleError(
                    f"{at}{key}: expected corners [latitude, longitude] in degrees, found"
                    f" {reprlib.repr(corners)}"
                )
            table[in_metres] = [_metres(frame, corner, f"{at}{key}: ") for corner in corners]


def _frame(data: dict[str, Any], source: str) -> LocalFrame:
    origin = data.get("origin")
    if not isinstance(origin, dict) or not all(key in origin for key in PLACE):
        raise VehicleError(
            f"{source}: origin: expected latitude_deg and longitude_deg of the place from which metres count,"
            " for a place is given in degrees; add [origin]"
        )
    return LocalFrame(*_degrees([origin[key] for key in PLACE], f"{source}: origin."))


def _degrees(values: list[Any], at: str) -> list[float]:
    for (key, largest), value in zip(PLACE.items(), values, strict=True):
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not abs(value) <= largest:
            raise VehicleError(
                f"{at}{key}: expected degrees from -{largest:g} to {largest:g}, found {reprlib.repr(value)};"
                " north and east are positive"
            )
    return [float(value) for value in values]


def _metres(frame: LocalFrame, values: list[Any], at: str) -> list[float]:
    latitude, longitude = _degrees(values, at)
    point = frame.metres([latitude, longitude])
    distance = float(np.hypot(*point))
    if distance > FARTHEST_M:
        raise VehicleError(
            f"{at}expected a place within {FARTHEST_M / 1e3:g} km of [origin], found {distance / 1e3:.0f}"
            " km; check signs, and that latitude comes first"
        )
    return [round(float(value), _DIGITS) for value in point]


@dataclass(frozen=True, eq=False)
class Stop:
    """A waypoint (north, east, and depth or altitude in m) and the leg that ends there, with its speed in m/s
    and radius of acceptance in m. `vertical`: "depth" or "altitude"; `task`: "pass", "hold" or "circle",
    of a `radius` in m.
    """

    label: str
    position: Array
    vertical: str
    speed: float
    acceptance: float
    task: str
    radius: float


@dataclass(frozen=True, eq=False)
class Route:
    """Start (3,), m, and heading there, rad, waypoints in order, planned time and longest time (infinite
    without) of a mission, s.
    """

    name: str
    start: Array
    heading: float
    stops: tuple[Stop, ...]
    planned_time: float
    longest: float

    @classmethod
    def of(cls, mission: Mission) -> Route:
        """Route of a mission."""
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
