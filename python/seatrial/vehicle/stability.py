"""Statics, linear stability and passivity: buoyancy, roll and pitch periods, course and pitch stability.

Course and pitch stability are eigenvalues of the motion linearised about straight running (Fossen 2011,
chapter 12): hull, and movable fins held at neutral, without the propellers' own damping. Held by
``tests/check/test_check.py`` and ``tests/check/test_check_fins.py``.

Coefficients are physically possible where no part of the vehicle creates energy. Each condition counts only
where the vehicle's own values meet it:

- the core accepts the values: positive masses and inertias, ``M_RB + M_A`` positive definite, motors with
  lags and rate limits that exist;
- damping takes energy at every speed: ``X_u <= 0`` and ``X_uu <= 0`` and so on along the diagonal, and the
  symmetric part of the linear damping matrix is positive semidefinite (Fossen 2011, section 6.4);
- actuators push along their direction: gains and thrust per revolution are positive, thrust deduction and
  wake fraction lie from 0 to below 1, losses from other groups' thrust are not gains.

Lift (``Y_uv`` and the like) turns forward motion into sideways force and quadratic cross terms have no sign
of their own; they are free. Held by ``tests/identification/test_fitted.py``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import AXES, VELOCITIES
from seatrial.base.errors import VehicleError
from seatrial.vehicle.actuators import NOMINAL_V, voltage_for

if TYPE_CHECKING:
    from seatrial._core import Vehicle


@dataclass(frozen=True)
class StabilitySettings:
    """How eigenvalues are told from rounding."""

    #: Step of a slope, m/s or rad/s or rad: quadratic terms vanish beside linear ones, and rounding does not
    #: show.
    slope_step: float = 1e-5
    #: Eigenvalue, with a diagonal of one, of a damping that takes no energy: zero but for rounding.
    zero_eigenvalue: float = 1e-9


SETTINGS = StabilitySettings()

_LEVEL = (0.0, 0.0, 0.0)  # roll, pitch and yaw in rad


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
        tilted[:, axis - 3] = [SETTINGS.slope_step, -SETTINGS.slope_step]
        moment = np.asarray(vehicle.forces(np.zeros((2, 6)), tilted)["restoring"])[:, axis]
        stiffness = -(moment[0] - moment[1]) / (2.0 * SETTINGS.slope_step)
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

    A negative speed is astern. `plane`: "course" for sway and yaw, "pitch" for heave, pitch rate and pitch.
    """
    axes = (1, 5) if plane == "course" else (2, 4)
    size = len(axes) + (plane == "pitch")
    matrix, mass = np.zeros((size, size)), np.asarray(vehicle.mass_matrix())
    for column in range(size):
        nu, attitude = np.zeros((2, 6)), np.zeros((2, 3))
        nu[:, 0] = speed_m_s
        if column < len(axes):
            nu[:, axes[column]] = [SETTINGS.slope_step, -SETTINGS.slope_step]
        else:
            attitude[:, 1] = [SETTINGS.slope_step, -SETTINGS.slope_step]
        rates = np.asarray(vehicle.acceleration(nu, attitude, neutral_fins(vehicle, nu)))
        slope = (rates[0] - rates[1]) / (2.0 * SETTINGS.slope_step)
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
            nu[:, axis] += [SETTINGS.slope_step, -SETTINGS.slope_step]
            force = _dissipation(vehicle, nu)
            slope[:, axis] = (force[0] - force[1]) / (2.0 * SETTINGS.slope_step)
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


_DIAGONAL = tuple(zip(AXES, VELOCITIES, strict=True))  # of damping: each axis by its own velocity

_POSITIVE = ("gain", "astern_ratio", "p1_ahead", "p1_astern")

_SHARES = ("t", "w")

_ANY_NUMBER = re.compile(r"[XYZKMN]_([uvwpqr]{1,2}|0)|.+\.(gain|loss|lever_[KMN])")
"""Names whose values the core takes whatever they are: forces by speed, biases, factors and levers."""


class PossibleCoefficients:
    """The conditions on some coefficients of a vehicle.

    `vehicle`: its own values decide which conditions count, and give the other coefficients; `names`:
    coefficients that vary, in the order of the columns.

    Examples
    --------
    >>> import seatrial as st
    >>> possible = PossibleCoefficients(st.Vehicle.load("cwolf"), ["X_uu", "X_udot"])
    >>> possible.mask([[-9.0, -4.0], [1.0, -4.0], [-9.0, 400.0]]).tolist()
    [True, False, False]
    """

    def __init__(self, vehicle: Vehicle, names: Sequence[str]) -> None:
        self.vehicle, self.names = vehicle, tuple(names)
        own = vehicle.coefficients()
        self._own = np.array([own.get(name, 0.0) for name in self.names])
        low, high = np.full(len(self.names), -np.inf), np.full(len(self.names), np.inf)
        damping = {f"{row}_{speed}" for row, speed in _DIAGONAL}
        damping |= {f"{row}_{2 * speed}" for row, speed in _DIAGONAL}
        for k, name in enumerate(self.names):
            suffix = name.partition(".")[2]
            if name in damping:
                high[k] = 0.0
            elif suffix in _POSITIVE or name == "B":
                low[k] = np.finfo(float).tiny
            elif suffix in _SHARES:
                low[k], high[k] = 0.0, np.nextafter(1.0, 0.0)
            elif suffix == "loss":
                low[k] = 0.0
        self.low = np.where(self._own < low, -np.inf, low)
        self.high = np.where(self._own > high, np.inf, high)
        self._linear = [
            (k, AXES.index(name[0]), VELOCITIES.index(name[2]))
            for k, name in enumerate(self.names)
            if len(name) == 3 and name[1] == "_" and name[0] in AXES and name[2] in VELOCITIES
        ]
        self._damping = np.array([[own.get(f"{row}_{speed}", 0.0) for speed in VELOCITIES] for row in AXES])
        self._judged = [k for k, name in enumerate(self.names) if not _ANY_NUMBER.fullmatch(name)]
        self._dissipative = bool(self._takes_energy(self._own[None])[0])

    def mask(self, values: Sequence[Sequence[float]] | Array) -> Mask:
        """Whether each row of values (k, n) is possible, (k,)."""
        rows = np.asarray(values, float).reshape(-1, len(self.names))
        good: Mask = np.logical_not(self.outside(rows).any(axis=1))
        if self._dissipative and self._linear:
            good[good] = self._takes_energy(rows[good])
        for k in np.flatnonzero(good) if self._judged else ():
            good[k] = self._core_takes(rows[k])
        return good

    def outside(self, values: Array) -> Mask:
        """Where values (k, n) have the wrong sign, (k, n)."""
        return (values < self.low) | (values > self.high)

    def _takes_energy(self, rows: Array) -> Mask:
        """Whether the linear damping of rows (k, n) takes energy from every motion, (k,)."""
        matrix = np.repeat(-self._damping[None], len(rows), axis=0)
        for k, row, column in self._linear:
            matrix[:, row, column] = -rows[:, k]
        symmetric = 0.5 * (matrix + matrix.transpose(0, 2, 1))
        size = np.sqrt(np.maximum(np.abs(np.diagonal(symmetric, axis1=1, axis2=2)), SETTINGS.zero_eigenvalue))
        least = np.linalg.eigvalsh(symmetric / size[:, :, None] / size[:, None, :])[:, 0]
        return np.asarray(least >= -SETTINGS.zero_eigenvalue)

    def _core_takes(self, row: Array) -> bool:
        try:
            self.vehicle.with_coefficients({self.names[k]: float(row[k]) for k in self._judged})
        except VehicleError:
            return False
        return True
