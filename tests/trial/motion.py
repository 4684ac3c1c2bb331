"""A made-up motion whose pose, body velocities and rates are known exactly, as the columns of a recording."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from seatrial.base.frames import from_euler, matrix

Array = NDArray[np.float64]


def pose(t: Array) -> tuple[Array, Array]:
    """Position NED in m (n, 3) and quaternion (n, 4)."""
    position = np.stack(
        [2.0 * np.sin(0.31 * t), 1.5 * np.cos(0.23 * t), 3.0 + 0.4 * np.sin(0.47 * t)], axis=1
    )
    return position, from_euler(_euler(t))


def nu(t: Array) -> Array:
    """Body velocities (n, 6), m/s and rad/s, by the analytic derivative of `pose`."""
    rate = np.stack([0.62 * np.cos(0.31 * t), -0.345 * np.sin(0.23 * t), 0.188 * np.cos(0.47 * t)], axis=1)
    roll, pitch, _ = _euler(t).T
    roll_dot, pitch_dot, yaw_dot = _euler_rate(t).T
    rates = np.stack(
        [
            roll_dot - yaw_dot * np.sin(pitch),
            pitch_dot * np.cos(roll) + yaw_dot * np.cos(pitch) * np.sin(roll),
            -pitch_dot * np.sin(roll) + yaw_dot * np.cos(pitch) * np.cos(roll),
        ],
        axis=1,
    )
    velocity = np.einsum("nji,nj->ni", matrix(from_euler(_euler(t))), rate)
    return np.concatenate([velocity, rates], axis=1)


def columns(
    t: Array, *, velocity_late: float = 0.0, rates_late: float = 0.0, noise: float = 0.0, seed: int = 0
) -> dict[str, Array]:
    """Recording with canonical columns, sensors late by so many seconds, with noise in m, m/s and deg/s."""
    position, q = pose(t)
    velocity, rates = nu(t - velocity_late)[:, :3], np.rad2deg(nu(t - rates_late)[:, 3:])
    values = [position, q, velocity, rates]
    names = ["x_m y_m z_m", "q_w q_x q_y q_z", "u_m_s v_m_s w_m_s", "p_deg_s q_deg_s r_deg_s"]
    random = np.random.default_rng(seed)
    found = {"t_s": t}
    for name, value in zip(names, values, strict=True):
        scale = 0.0 if name.startswith("q_w") else noise
        noisy = value + scale * random.standard_normal(value.shape)
        found |= dict(zip(name.split(), noisy.T, strict=True))
    return found


def _euler(t: Array) -> Array:
    return np.stack(
        [0.2 * np.sin(0.7 * t), 0.15 * np.sin(0.5 * t + 1.0), 0.9 * np.sin(0.2 * t) + 0.3 * t], axis=1
    )


def _euler_rate(t: Array) -> Array:
    return np.stack(
        [0.14 * np.cos(0.7 * t), 0.075 * np.cos(0.5 * t + 1.0), 0.18 * np.cos(0.2 * t) + 0.3], axis=1
    )
