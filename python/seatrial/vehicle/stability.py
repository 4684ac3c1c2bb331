"""Statics and linear stability: buoyancy, roll and pitch periods, course and pitch stability, damping.

Course and pitch stability are eigenvalues of the motion linearised about straight running (Fossen 2011,
chapter 12): hull, and movable fins held at neutral, without the propellers' own damping. Held by
``tests/check/test_check.py`` and ``tests/check/test_check_fins.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES, VELOCITIES
from seatrial.vehicle.actuators import NOMINAL_V, voltage_for

if TYPE_CHECKING:
    from seatrial._core import Vehicle

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
    """Damping, lift and fins that push: where the power on the vehicle is positive.

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
        parts = zip(VELOCITIES, self.direction, units, strict=True)
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


def positive_damping(vehicle: Vehicle) -> dict[str, float]:
    """Diagonal damping coefficients that are positive, SI: they drive the vehicle on."""
    values = vehicle.coefficients()
    names = (
        name
        for row, axis in zip(AXES, VELOCITIES, strict=True)
        for name in (f"{row}_{axis}", f"{row}_{axis}{axis}")
    )
    return {name: values[name] for name in names if values.get(name, 0.0) > 0.0}


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
    matrix, mass = np.zeros((size, size)), np.asarray(vehicle.mass_matrix())
    for column in range(size):
        nu, attitude = np.zeros((2, 6)), np.zeros((2, 3))
        nu[:, 0] = speed_m_s
        if column < len(axes):
            nu[:, axes[column]] = [_SMALL, -_SMALL]
        else:
            attitude[:, 1] = [_SMALL, -_SMALL]
        rates = np.asarray(vehicle.acceleration(nu, attitude, neutral_fins(vehicle, nu)))
        slope = (rates[0] - rates[1]) / (2.0 * _SMALL)
        # The other axes are held, so that no roll that has only begun takes part.
        matrix[: len(axes), column] = np.linalg.solve(mass[np.ix_(axes, axes)], (mass @ slope)[list(axes)])
    if plane == "pitch":
        matrix[2, 1] = 1.0
    return float(np.linalg.eigvals(matrix).real.max())


def damping_gain(vehicle: Vehicle, speeds_m_s: Sequence[float]) -> Gain | None:
    """The worst way in which damping, lift and fins at neutral put energy in, None where they only take it.

    At each speed along x the symmetric part of the force's slope gives small disturbances in the other five
    axes; random velocities of all sizes probe the quadratic terms.
    """
    gains: list[Gain] = []
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
            gains.append(_gain(speed, direction, symmetric_power=float(values[-1])))
    random = np.random.default_rng(0)
    directions = random.standard_normal((4000, 6)) * scale * random.choice([0.1, 1.0, 10.0], (4000, 1))
    power = np.einsum("ij,ij->i", directions, _hull(vehicle, directions))
    # A fin at neutral only takes energy, so that only what the hull pushes needs its fins looked at.
    pushed = np.flatnonzero(power > 0.0)
    fins = neutral_fins(vehicle, directions[pushed])
    power[pushed] += np.einsum("ij,ij->i", directions[pushed], fins)
    worst = int(np.argmax(power))
    if power[worst] > 1e-9 * float(np.abs(power).max()):
        gains.append(
            _gain(float(directions[worst, 0]), directions[worst], symmetric_power=float(power[worst]))
        )
    return max(gains, key=lambda gain: gain.power_w, default=None)


def neutral_fins(vehicle: Vehicle, nu: Array) -> Array:
    """Wrench (n, 6) in N and N m about O of the movable fins at neutral, at velocities (n, 6).

    The wrench of the held vehicle with its motors stopped, from the model's own chain; zero without fins.
    """
    from seatrial._core import State

    if not any(facts["kind"] == "fin" for facts in vehicle.actuator_info().values()):
        return np.zeros(nu.shape)
    t = np.array([0.0, 0.01])  # two samples, of which the first is taken: nothing moves
    voltage = voltage_for(vehicle, t, NOMINAL_V)
    runs = [vehicle.simulate(t, {}, State(nu=row), free="", voltage_v=voltage) for row in nu]
    return np.array([np.asarray(run.tau)[0] for run in runs]).reshape(nu.shape)


def _dissipation(vehicle: Vehicle, nu: Array) -> Array:
    """Force (n, 6) of damping, lift and fins at neutral."""
    return _hull(vehicle, nu) + neutral_fins(vehicle, nu)


def _hull(vehicle: Vehicle, nu: Array) -> Array:
    """Force (n, 6) of damping and lift."""
    terms = vehicle.forces(nu, _LEVEL)
    return np.asarray(terms["damping"]) + np.asarray(terms["lift"])


def _gain(speed: float, direction: Array, *, symmetric_power: float) -> Gain:
    size = float(np.abs(direction).max())
    scaled = direction / size * np.sign(direction[np.abs(direction).argmax()])
    return Gain(speed, tuple(map(float, scaled)), symmetric_power / size**2)
