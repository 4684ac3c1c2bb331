"""Kinematics of the textbook model: skew matrix, rotation, quaternion and Euler forms of (7), NumPy only.

Quaternions are ``[w x y z]``, body to NED; Euler angles are roll, pitch, yaw in rad (ZYX).
Source: T. I. Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, section 2.2.
Held by tests/core/test_textbook.py::test_law_quaternion_and_euler_kinematics_agree.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array: TypeAlias = NDArray[np.float64]


def skew(a: ArrayLike) -> Array:
    """Return S(a) (3,3) with S(a) b = a x b."""
    x, y, z = np.asarray(a, dtype=float)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation(q: ArrayLike) -> Array:
    """Return R (3,3), body to NED, of a unit quaternion (4,): I + 2 w S(e) + 2 S(e)^2."""
    w, x, y, z = np.asarray(q, dtype=float)
    S = skew([x, y, z])
    return np.asarray(np.eye(3) + 2.0 * w * S + 2.0 * S @ S)


def quaternion(phi: float, theta: float, psi: float) -> Array:
    """Return the unit quaternion (4,), body to NED, of roll, pitch and yaw in rad (ZYX)."""
    c1, c2, c3 = np.cos([phi / 2, theta / 2, psi / 2])
    s1, s2, s3 = np.sin([phi / 2, theta / 2, psi / 2])
    return np.array([
        c1 * c2 * c3 + s1 * s2 * s3,
        s1 * c2 * c3 - c1 * s2 * s3,
        c1 * s2 * c3 + s1 * c2 * s3,
        c1 * c2 * s3 - s1 * s2 * c3,
    ])


def euler(q: ArrayLike) -> Array:
    """Return roll, pitch, yaw (3,) in rad of a unit quaternion (4,), body to NED."""
    R = rotation(q)
    return np.array([
        np.arctan2(R[2, 1], R[2, 2]),
        -np.arcsin(np.clip(R[2, 0], -1.0, 1.0)),
        np.arctan2(R[1, 0], R[0, 0]),
    ])


def quaternion_rate(q: ArrayLike, omega: ArrayLike) -> Array:
    """Return q' = 1/2 q (x) [0, omega] (4,) in 1/s; omega in rad/s, body frame."""
    w, x, y, z = np.asarray(q, dtype=float)
    T = 0.5 * np.array([[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]])
    return np.asarray(T @ np.asarray(omega, dtype=float))


def euler_jacobian(phi: float, theta: float, psi: float) -> Array:
    """Return J(eta) (6,6) of (7): eta' = J nu, eta = [x y z roll pitch yaw]; singular at theta = +-90 deg."""
    J = np.zeros((6, 6))
    J[:3, :3] = rotation(quaternion(phi, theta, psi))
    s, c, t = np.sin(phi), np.cos(phi), np.tan(theta)
    J[3:, 3:] = [[1.0, s * t, c * t], [0.0, c, -s], [0.0, s / np.cos(theta), c / np.cos(theta)]]
    return J
