"""Attitudes as quaternions and Euler angles, frames of a recording by name, a local frame of the Earth.

Inside, ``v_n = R(q) v_b`` from the body frame b (FRD: x forward, y starboard, z down) to the earth frame n
(NED); ``q' = 1/2 q (x) [0, omega]``, omega in rad/s expressed in b. Source: Fossen, Handbook of Marine Craft
Hydrodynamics and Motion Control (2011), sections 2.2.1 and 2.2.2. Held by the ``test_law_`` functions of
``tests/base/test_rotation.py`` and ``tests/base/test_frames.py``; `LocalFrame` by
``tests/flight/test_mission_geographic.py``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError


def product(a: ArrayLike, b: ArrayLike) -> Array:
    """Hamilton product a (x) b of quaternions, shape (n, 4) or (4,)."""
    aw, ax, ay, az = np.moveaxis(np.asarray(a, float), -1, 0)
    bw, bx, by, bz = np.moveaxis(np.asarray(b, float), -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def conjugate(q: ArrayLike) -> Array:
    """Inverse rotation of unit quaternions, shape (n, 4) or (4,)."""
    return np.asarray(np.asarray(q, float) * np.array([1.0, -1.0, -1.0, -1.0]))


def matrix(q: ArrayLike) -> Array:
    """Rotation matrix body -> NED, shape (n, 3, 3) or (3, 3), of unit quaternions."""
    w, x, y, z = np.moveaxis(np.asarray(q, float), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    if np.ndim(w) == 0:  # one of a stepped vehicle: stacking takes far longer than the arithmetic
        return np.array(rows)
    return np.asarray(np.stack([np.stack(row, axis=-1) for row in rows], axis=-2))


def from_euler(angles: ArrayLike) -> Array:
    """Unit quaternion, shape (n, 4) or (4,), of roll, pitch, yaw in rad.

    Examples
    --------
    >>> from_euler([0.0, 0.0, np.pi]).round(3).tolist()
    [0.0, 0.0, 0.0, 1.0]
    """
    half = 0.5 * np.moveaxis(np.asarray(angles, float), -1, 0)
    (cr, cp, cy), (sr, sp, sy) = np.cos(half), np.sin(half)
    return np.stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ],
        axis=-1,
    )


def to_euler(q: ArrayLike) -> Array:
    """Roll, pitch, yaw in rad, shape (n, 3) or (3,), of unit quaternions; yaw in (-pi, pi]."""
    w, x, y, z = np.moveaxis(np.asarray(q, float), -1, 0)
    return np.stack(
        [
            np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
            np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0)),
            np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
        ],
        axis=-1,
    )


def continuous(q: ArrayLike) -> tuple[Array, int]:
    """The same attitudes (n, 4) without sign flips (q and -q are one rotation), and the number of flips."""
    q = np.asarray(q, float)
    flips = np.einsum("ij,ij->i", q[1:], q[:-1]) < 0.0
    sign = np.concatenate([[1.0], np.where(flips, -1.0, 1.0)]).cumprod()
    return q * sign[:, None], int(flips.sum())


def body_rates(q: ArrayLike, q_dot: ArrayLike) -> Array:
    """Angular velocity p, q, r in rad/s in the body frame, shape (n, 3), from q and dq/dt."""
    return 2.0 * product(conjugate(q), q_dot)[..., 1:]


def angle_between(a: ArrayLike, b: ArrayLike) -> Array:
    """Angle in rad of the rotation from a to b, shape (n,)."""
    d = product(conjugate(a), b)
    return np.asarray(2.0 * np.arctan2(np.linalg.norm(d[..., 1:], axis=-1), np.abs(d[..., 0])))


def shorter(angle: ArrayLike) -> Array:
    """The same angle the shorter way round, in [-pi, pi), rad.

    Examples
    --------
    >>> shorter([0.5 + 2.0 * np.pi, -6.0]).round(3).tolist()
    [0.5, 0.283]
    """
    return np.asarray((np.asarray(angle, dtype=float) + np.pi) % (2.0 * np.pi) - np.pi)


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

    Raises `TrialError`: if it is no body frame; the message begins with `where`.
    """
    names = _names(frame)
    if len(names) == 1 and names[0] in _BODY:
        return _BODY[names[0]]
    raise TrialError(f'{where}: frame "{frame}" is no body frame; expected "FRD" (as inside) or "FLU"')


def earth_matrix(frame: str, where: str) -> Array:
    """Matrix (3, 3) from the earth frame of that name to NED; "FLU" is taken as its earth frame, NWU.

    Raises `TrialError`: if it is no earth frame; the message begins with `where`.
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

    With ``v_NED = E v`` and ``v_FRD = B v`` for the recording's frames, its rotation R becomes ``E R B'``.
    ROS uses FLU and ENU (REP 103).

    One name implies its usual partner: "FLU" and "NWU" are "FLU/NWU", "ENU" is "FLU/ENU".

    Raises `TrialError`: if the name is unknown; the message begins with `where`.
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

    It is the azimuthal equidistant projection of WGS 84: a point lies at its geodesic distance s from the
    origin, in the direction of the geodesic's azimuth there. Distances and bearings from the origin are
    exact; across, lengths grow by (s/R)²/6, 0.4 ppm at 10 km and 41 ppm (4 m) at 100 km. At s to the east,
    true north differs by s tan(latitude)/R, 0.16° at 10 km and 60° latitude. Source: Snyder, *Map
    Projections: A Working Manual* (USGS Professional Paper 1395, 1987), chapter 25; Karney, *Algorithms for
    geodesics*, Journal of Geodesy 87 (2013).

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
