"""Straight level flight at a speed: attitude, velocities and wrench at which nothing accelerates.

The rows that are commanded take what the motion needs, whether or not the actuators reach it
(`seatrial.vehicle.authority`); each other row needs an angle that brings its own force to zero:
pitch for the heave force (a hull that is too light or too heavy is carried by its angle of attack), drift
for the sway force, heel for the roll moment. What the actuators bring along with the commanded rows
counts. Held by tests/control_design/test_control_design.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.vehicle.authority import ROWS, mixing
from seatrial.vehicle.stability import neutral_fins

if TYPE_CHECKING:
    from seatrial._core import Vehicle

_LARGEST = np.deg2rad(25.0)  # beyond it, the model and straight flight are not what they claim to be

_BALANCED = 1e-6  # of the mass times 1 m/s^2


@dataclass(frozen=True)
class Trim:
    """Attitude (3,) roll, pitch, yaw in rad, nu (6,) in m/s and rad/s, and wrench tau (6,) of the actuators.

    ``rows`` are the commanded ones; the others of ``tau`` are what the actuators at work bring along.
    """

    speed_m_s: float
    rows: str
    attitude: Array
    nu: Array
    tau: Array
    actuators: tuple[str, ...] | None = None


def level(speed_m_s: float, rows: str, actuators: tuple[str, ...] | None = None) -> Trim:
    """Level motion at a speed in m/s without any wrench: it stands in where there is no trim."""
    nu = np.array([speed_m_s, 0.0, 0.0, 0.0, 0.0, 0.0])
    return Trim(speed_m_s, rows, np.zeros(3), nu, np.zeros(6), actuators)


def trim(
    vehicle: Vehicle, speed_m_s: float, rows: str, actuators: tuple[str, ...] | None = None
) -> Trim | None:
    """Straight flight at constant depth and speed over ground in still water; None where there is none.

    Parameters
    ----------
    vehicle : Vehicle
    speed_m_s : float
        Horizontal speed, m/s; negative is astern.
    rows : str
        Commanded rows of the wrench, letters of XYZKMN.
    actuators : tuple of str
        Those at work; all by default.

    Examples
    --------
    >>> import seatrial as st
    >>> flight = trim(st.Vehicle.load("cwolf"), 1.5, "XMN")
    >>> round(float(np.rad2deg(flight.attitude[1])), 2)  # 5 N too light: bow down
    -0.83
    """
    from scipy.optimize import least_squares

    # Pitch serves the heave force, and where that is commanded the pitch moment; -1 stands for the drift.
    serves = {"Y": -1, "K": 0, "Z": 1, "M": 1 if "Z" in rows else None}
    angles = sorted({angle for row, angle in serves.items() if row not in rows and angle is not None})
    mass = np.asarray(vehicle.mass_matrix())
    scale = np.diag(mass)
    idle = [k for k, row in enumerate(ROWS) if row not in rows]
    chosen = [ROWS.index(row) for row in rows]
    mixed = mixing(vehicle, rows, actuators) if chosen else np.zeros((6, 0))

    def flight(x: Array) -> Trim:
        attitude, drift = np.zeros(3), 0.0
        for angle, value in zip(angles, x, strict=True):
            if angle < 0:
                drift = float(value)
            else:
                attitude[angle] = value
        nu = np.concatenate([_body(attitude, drift) * speed_m_s, np.zeros(3)])
        force = sum(np.asarray(term) for term in vehicle.forces(nu, attitude).values())
        held = neutral_fins(vehicle, nu[None])[0]
        along = mixed @ -(force + held)[chosen]
        return Trim(speed_m_s, rows, attitude, nu, held + along, actuators)

    def residual(x: Array) -> Array:
        at = flight(x)
        rest = np.asarray(vehicle.acceleration(at.nu, at.attitude, at.tau))
        return np.asarray((mass @ rest / scale)[idle])

    solution = np.zeros(len(angles))
    if angles:
        solution = least_squares(residual, solution, bounds=(-1.5, 1.5), xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    left = residual(solution)
    if np.abs(left).max(initial=0.0) > _BALANCED or np.abs(solution).max(initial=0.0) > _LARGEST:
        return None
    return flight(solution)


def _body(attitude: Array, drift: float) -> Array:
    """Unit vector of the course in the body frame; the course leads the heading by the drift angle."""
    roll, pitch = attitude[:2]
    north, east = np.cos(drift), np.sin(drift)
    ahead, down = np.cos(pitch) * north, np.sin(pitch) * north
    return np.array([
        ahead,
        np.cos(roll) * east + np.sin(roll) * down,
        -np.sin(roll) * east + np.cos(roll) * down,
    ])
