"""Statics and linear stability: buoyancy, roll and pitch periods, course and pitch stability, damping.

Course and pitch stability are eigenvalues of the motion linearised about straight running (Fossen 2011,
chapter 12); the hull alone, without the propellers' own damping.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["Gain", "Statics", "damping_gain", "growth", "statics"]

Array = NDArray[np.float64]

_SMALL = 1e-5
_LEVEL = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Statics:
    """Weight and buoyancy in N, height of B over G in m, natural periods in s (None: not stable)."""

    weight_n: float
    buoyancy_n: float
    b_over_g_m: float
    roll_period_s: float | None
    pitch_period_s: float | None

    @property
    def net_n(self) -> float:
        """Buoyancy minus weight, N; positive: the vehicle rises."""
        return self.buoyancy_n - self.weight_n


@dataclass(frozen=True)
class Gain:
    """Damping and lift that push: where the power on the vehicle is positive.

    ``direction`` (6,) is the disturbance in m/s and rad/s, scaled to a largest entry of one; ``power_w`` is
    the power for that disturbance at ``speed_m_s`` ahead (negative: astern).
    """

    speed_m_s: float
    direction: tuple[float, ...]
    power_w: float

    @property
    def words(self) -> str:
        """The direction by its main velocities: ``v +1.00 m/s, r -0.82 rad/s``."""
        units = ("m/s",) * 3 + ("rad/s",) * 3
        parts = zip("uvwpqr", self.direction, units, strict=True)
        return ", ".join(f"{name} {value:+.2f} {unit}" for name, value, unit in parts if abs(value) > 0.05)


def statics(vehicle: Vehicle) -> Statics:
    """Buoyancy, centres and natural periods of roll and pitch, uncoupled, at rest and level."""
    values, g = vehicle.coefficients(), vehicle.environment()["g"]
    mass = np.asarray(vehicle.mass_matrix())

    def period(axis: int) -> float | None:
        tilted = np.zeros((2, 3))
        tilted[:, axis - 3] = [_SMALL, -_SMALL]
        moment = np.asarray(vehicle.forces(np.zeros((2, 6)), tilted)["restoring"])[:, axis]
        stiffness = -(moment[0] - moment[1]) / (2.0 * _SMALL)
        return float(2.0 * np.pi * np.sqrt(mass[axis, axis] / stiffness)) if stiffness > 0.0 else None

    return Statics(
        weight_n=values["m"] * g,
        buoyancy_n=values["B"],
        b_over_g_m=values.get("z_g", 0.0) - values.get("z_b", 0.0),
        roll_period_s=period(3),
        pitch_period_s=period(4),
    )


def growth(vehicle: Vehicle, speed_m_s: float, plane: str) -> float:
    """Fastest growth rate in 1/s of a small disturbance at this speed ahead; negative: it dies away.

    Parameters
    ----------
    vehicle : Vehicle
    speed_m_s : float
        Speed along x; negative is astern.
    plane : str
        "course" for sway and yaw, "pitch" for heave, pitch rate and pitch.
    """
    axes = (1, 5) if plane == "course" else (2, 4)
    size = len(axes) + (plane == "pitch")
    matrix = np.zeros((size, size))
    for column in range(size):
        nu, attitude = np.zeros((2, 6)), np.zeros((2, 3))
        nu[:, 0] = speed_m_s
        if column < len(axes):
            nu[:, axes[column]] = [_SMALL, -_SMALL]
        else:
            attitude[:, 1] = [_SMALL, -_SMALL]
        rates = np.asarray(vehicle.acceleration(nu, attitude, np.zeros(6)))
        slope = (rates[0] - rates[1]) / (2.0 * _SMALL)
        matrix[: len(axes), column] = slope[list(axes)]
    if plane == "pitch":
        matrix[2, 1] = 1.0
    return float(np.linalg.eigvals(matrix).real.max())


def damping_gain(vehicle: Vehicle, speeds_m_s: Sequence[float]) -> Gain | None:
    """The worst way in which damping and lift put energy into the vehicle, None where they only take it.

    At each speed along x the symmetric part of the force's slope tells small disturbances in the other five
    axes; random velocities of all sizes tell the quadratic terms.
    """
    found: list[Gain] = []
    length = max(vehicle.geometry().get("length", 1.0), 1e-6)
    scale = np.array([1.0, 1.0, 1.0, *[1.0 / length] * 3])  # a rate counts by the speed at the hull's end
    for speed in (0.0, *speeds_m_s):
        slope = np.zeros((6, 6))
        for axis in range(6):
            nu = np.zeros((2, 6))
            nu[:, 0] = speed
            nu[:, axis] += [_SMALL, -_SMALL]
            force = _dissipation(vehicle, nu)
            slope[:, axis] = (force[0] - force[1]) / (2.0 * _SMALL)
        part = slice(0 if speed == 0.0 else 1, 6)
        weight = scale[part]
        symmetric = 0.5 * (slope + slope.T)[part, part] * weight[:, None] * weight
        values, vectors = np.linalg.eigh(symmetric)
        if values[-1] > 1e-6 * max(abs(values[0]), 1e-12):
            direction = np.zeros(6)
            direction[part] = vectors[:, -1] * weight
            found.append(_gain(speed, direction, symmetric_power=float(values[-1])))
    random = np.random.default_rng(0)
    directions = random.standard_normal((4000, 6)) * scale * random.choice([0.1, 1.0, 10.0], (4000, 1))
    power = np.einsum("ij,ij->i", directions, _dissipation(vehicle, directions))
    worst = int(np.argmax(power))
    if power[worst] > 1e-9 * float(np.abs(power).max()):
        found.append(
            _gain(float(directions[worst, 0]), directions[worst], symmetric_power=float(power[worst]))
        )
    return max(found, key=lambda gain: gain.power_w, default=None)


def _dissipation(vehicle: Vehicle, nu: Array) -> Array:
    """Force (n, 6) of damping and lift."""
    terms = vehicle.forces(nu, _LEVEL)
    return np.asarray(terms["damping"]) + np.asarray(terms["lift"])


def _gain(speed: float, direction: Array, *, symmetric_power: float) -> Gain:
    size = float(np.abs(direction).max())
    scaled = direction / size * np.sign(direction[np.abs(direction).argmax()])
    return Gain(speed, tuple(map(float, scaled)), symmetric_power / size**2)
