"""Frames: vectors and attitudes of a recording into NED and FRD by name; north and east about an origin.

Body frames: FRD (x forward, y starboard, z down), FLU (y port, z up). Earth frames: NED, NWU (z up, y west),
ENU (x east, y north, z up). An attitude turns the body frame into the earth frame and names both: "FLU/ENU".
With ``v_NED = E v`` and ``v_FRD = B v`` for the recording's frames, its rotation R becomes ``E R B'``.
ROS uses FLU and ENU (REP 103). Held by the ``test_law_`` functions of ``tests/base/test_frames.py``.

A local frame is the azimuthal equidistant projection of WGS 84: a point lies at its geodesic distance s from
the origin, in the direction of the geodesic's azimuth α there, north = s cos α, east = s sin α. Distances and
bearings from the origin are exact; across, lengths grow by (s/R)²/6, 0.4 ppm at 10 km (4 mm) and 41 ppm at
100 km (4 m). At s to the east, true north differs by s tan(latitude)/R, 0.16° at 10 km and 60° latitude.
Source: Snyder, *Map Projections: A Working Manual* (USGS Professional Paper 1395, 1987), chapter 25; Karney,
*Algorithms for geodesics*, Journal of Geodesy 87 (2013). Held by ``tests/flight/test_mission_geographic.py``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError
from seatrial.base.rotation import product

_Z_UP = np.diag([1.0, -1.0, -1.0])  # half a turn about x: y and z change their signs
_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # x and y change places, z its sign

_BODY = {"FRD": np.eye(3), "FLU": _Z_UP}

_EARTH = {"NED": np.eye(3), "NWU": _Z_UP, "ENU": _ENU}

_HALF_TURN = {  # the same matrices as quaternions: half turns about x and about the diagonal of x and y
    "FRD": np.array([1.0, 0.0, 0.0, 0.0]),
    "NED": np.array([1.0, 0.0, 0.0, 0.0]),
    "FLU": np.array([0.0, 1.0, 0.0, 0.0]),
    "NWU": np.array([0.0, 1.0, 0.0, 0.0]),
    "ENU": np.array([0.0, np.sqrt(0.5), np.sqrt(0.5), 0.0]),
}

_PARTNER = {"FRD": "NED", "NED": "FRD", "FLU": "NWU", "NWU": "FLU", "ENU": "FLU"}

_Z_NAMES = {"ZUP": "FLU", "ZDOWN": "FRD"}


def _names(frame: str) -> list[str]:
    """Frame names in the text; "FLU -> FRD" says the same as "FLU", since FRD and NED are always the goal."""
    source = re.split(r"->|→", frame)[0].strip().upper()
    plain = re.sub(r"[\s_-]", "", source)
    return [_Z_NAMES[plain]] if plain in _Z_NAMES else re.split(r"\s*/\s*", source)


def body_matrix(frame: str, where: str) -> Array:
    """Matrix (3, 3) from the body frame of that name to FRD.

    Raises
    ------
    TrialError
        If it is no body frame; the message begins with `where`.
    """
    names = _names(frame)
    if len(names) == 1 and names[0] in _BODY:
        return _BODY[names[0]]
    raise TrialError(f'{where}: frame "{frame}" is no body frame; expected "FRD" (as inside) or "FLU"')


def earth_matrix(frame: str, where: str) -> Array:
    """Matrix (3, 3) from the earth frame of that name to NED; "FLU" is taken as its earth frame, NWU.

    Raises
    ------
    TrialError
        If it is no earth frame; the message begins with `where`.
    """
    names = _names(frame)
    if len(names) == 1:
        name = _PARTNER[names[0]] if names[0] in _BODY else names[0]
        if name in _EARTH:
            return _EARTH[name]
    raise TrialError(
        f'{where}: frame "{frame}" is no earth frame; expected "NED" (as inside), "NWU" or "ENU"'
    )


def attitude_to_ned(q: Array, frame: str, where: str) -> Array:
    """Quaternions (n, 4) FRD -> NED from those between the two frames that `frame` names.

    One name implies its usual partner: "FLU" and "NWU" are "FLU/NWU", "ENU" is "FLU/ENU".

    Raises
    ------
    TrialError
        If the name is unknown; the message begins with `where`.
    """
    names = _names(frame)
    if len(names) == 1 and names[0] in _PARTNER:
        names = [names[0], _PARTNER[names[0]]]
    body, earth = sorted(names, key=lambda name: name in _EARTH)[:2] if len(names) == 2 else ("", "")
    if body not in _BODY or earth not in _EARTH:
        raise TrialError(
            f'{where}: frame "{frame}" is no attitude; expected body/earth: '
            '"FRD/NED" (as inside), "FLU/NWU" or "FLU/ENU"'
        )
    back = _HALF_TURN[body] * np.array([1.0, -1.0, -1.0, -1.0])
    return product(product(_HALF_TURN[earth], q), back)


FARTHEST_M = 100e3
"""Distance from the origin up to which a plane is good enough for a mission."""


@dataclass(frozen=True)
class LocalFrame:
    """A plane, north and east in m, that touches the Earth at an origin in degrees.

    Examples
    --------
    >>> frame = LocalFrame(63.44, 10.40)
    >>> point = frame.metres([63.45, 10.42])
    >>> point.round(2)
    array([1114.84,  997.82])
    >>> frame.geographic(point).round(6)
    array([63.45, 10.42])
    """

    latitude_deg: float
    longitude_deg: float

    def metres(self, points: ArrayLike) -> NDArray[np.float64]:
        """North and east (..., 2) in m of points (..., 2), latitude and longitude in degrees."""
        from pyproj import Geod

        latitude, longitude = np.moveaxis(np.asarray(points, dtype=float), -1, 0)
        origin = np.full_like(longitude, self.longitude_deg), np.full_like(latitude, self.latitude_deg)
        azimuth, _, distance = Geod(ellps="WGS84").inv(origin[0], origin[1], longitude, latitude)
        angle = np.deg2rad(azimuth)
        return np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=-1)

    def geographic(self, points: ArrayLike) -> NDArray[np.float64]:
        """Latitude and longitude (..., 2) in degrees of points (..., 2), north and east in m."""
        from pyproj import Geod

        north, east = np.moveaxis(np.asarray(points, dtype=float), -1, 0)
        origin = np.full_like(east, self.longitude_deg), np.full_like(north, self.latitude_deg)
        azimuth = np.rad2deg(np.arctan2(east, north))
        longitude, latitude, _ = Geod(ellps="WGS84").fwd(origin[0], origin[1], azimuth, np.hypot(north, east))
        return np.stack([latitude, longitude], axis=-1)
