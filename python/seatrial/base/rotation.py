"""Attitude as a unit quaternion [w x y z] and as Euler angles ZYX, in NumPy, for logs, plots and fits.

Convention: body frame b (FRD) to earth frame n (NED); ``v_n = R(q) v_b``; ``q' = 1/2 q (x) [0, omega]``,
omega in rad/s expressed in b. Source: Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control
(2011), sections 2.2.1 and 2.2.2. Held by the ``test_law_`` functions of tests/base/test_rotation.py.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.arrays import Array


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
