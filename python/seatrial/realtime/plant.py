"""A vehicle that is stepped: commands in, motion and what inertial sensors feel out.

Steps follow one another by `seatrial.Run.final_state`, so that rate limit, lag and dead time of the motors
go on as in one long run. An accelerometer at O shows the specific force in the body frame,

    f = nu_1' + nu_2 x nu_1 - R(q)' g e_z      (m/s2),

which is (0, 0, -g) at rest and level (Fossen 2011, section 11.5); at a lever arm r it shows
``f + nu_2' x r + nu_2 x (nu_2 x r)``. Held by ``tests/realtime/test_plant.py``.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from seatrial._core import State, Vehicle
from seatrial.base.arrays import Array
from seatrial.base.errors import DivergenceError, SimulationError
from seatrial.base.frames import from_euler, matrix, to_euler

if TYPE_CHECKING:
    import polars as pl

    from seatrial.sensors.sensor import Sensor


@dataclass(frozen=True, eq=False)
class Motion:
    """What moves at an instant, SI."""

    t_s: float  #: Time since the beginning.
    #: `position`, `attitude`, `nu`: NED (3,); quaternion body to NED (4,); body frame (6,).
    position: Array
    attitude: Array
    nu: Array
    specific_force: Array  #: What an accelerometer shows, body frame, (3,), m/s2.

    @property
    def euler(self) -> Array:
        """Roll, pitch, yaw, (3,), rad."""
        return to_euler(self.attitude)

    @property
    def numbers(self) -> list[float]:
        """Position, roll pitch yaw, nu: twelve numbers, SI."""
        return [*self.position.tolist(), *self.euler.tolist(), *self.nu.tolist()]

    @cached_property
    def rotation(self) -> Array:
        """Rotation matrix body to NED, (3, 3)."""
        return matrix(self.attitude)

    @property
    def velocity(self) -> Array:
        """Velocity over ground, NED, (3,), m/s."""
        return np.asarray(self.rotation @ self.nu[:3])


def needs_voltage(vehicle: Vehicle) -> list[str]:
    """Names of the actuators whose thrust depends on the supply voltage."""
    return [name for name, facts in vehicle.actuator_info().items() if facts["needs_voltage"]]


class Plant:
    """A vehicle in the sea, one step at a time; the surface is at depth 0.

    Parameters
    ----------
    vehicle : Vehicle
    initial : State, optional
        Where it begins; at rest in O when omitted, and afloat where that is higher than it floats.
    current : (3,) array_like, optional
        Velocity of the water, NED, m/s.
    voltage_v : float, optional
        Supply, V, where thrust depends on it.
    imu_position_m : (3,) array_like, optional
        Place of the accelerometer in the body frame from O, m.
    max_step_s : float, optional
        Largest step of the integration, s.

    Raises
    ------
    SimulationError
        Thrust depends on a voltage that is not given, or a number is not usable.

    Examples
    --------
    >>> import seatrial as st
    >>> plant = Plant(st.Vehicle.load("cwolf"))
    >>> motion = plant.advance({}, 0.01)
    >>> motion.t_s, bool(abs(motion.specific_force[2] + 9.81) < 0.5)
    (0.01, True)
    """

    def __init__(
        self,
        vehicle: Vehicle,
        *,
        initial: State | None = None,
        current: ArrayLike = (0.0, 0.0, 0.0),
        voltage_v: float | None = None,
        imu_position_m: ArrayLike = (0.0, 0.0, 0.0),
        max_step_s: float = 0.02,
    ) -> None:
        dependent = needs_voltage(vehicle)
        if dependent and voltage_v is None:
            spans = vehicle.table_voltages().values()
            within = f", {min(a for a, _ in spans):g} to {max(b for _, b in spans):g} V" if spans else ""
            raise SimulationError(
                f"voltage_v: the thrust of {dependent[0]} depends on the supply voltage; give it"
                f" (--voltage){within}"
            )
        self.vehicle = vehicle
        self._initial = _launched(vehicle, State() if initial is None else initial)
        self._current = np.asarray(current, float)
        self._arm = np.asarray(imu_position_m, float)
        if self._current.shape != (3,) or self._arm.shape != (3,):
            raise SimulationError("current and imu_position_m: expected three numbers each")
        self._voltage = None if voltage_v is None else [float(voltage_v)] * 2
        self._max_step_s = max_step_s
        self._gravity = vehicle.environment()["g"]
        self.reset()

    def reset(self) -> None:
        """Back to the beginning, at time zero."""
        self._state = self._initial
        self._t = 0.0
        self.actuators: dict[str, float] = dict(self._initial.actuators)
        self.motion = self._motion(np.zeros(6))

    @property
    def state(self) -> State:
        """Where it is, with all that the motors remember."""
        return self._state

    @property
    def through_water(self) -> Array:
        """Velocity through the water, body frame, (3,), m/s."""
        return np.asarray(self.motion.nu[:3] - self.motion.rotation.T @ self._current)

    def advance(self, commands: Mapping[str, float], dt_s: float) -> Motion:
        """Motion `dt_s` later under held commands, each in the unit of its actuator; missing ones are
        neutral. A motion that diverges is no number, and stays none until `reset`.

        Raises
        ------
        SimulationError
            A command or the step is not usable.
        """
        try:
            run = self.vehicle.simulate(
                [0.0, dt_s],
                dict(commands),
                self._state,
                current=self._current,
                voltage_v=self._voltage,
                max_step_s=self._max_step_s,
                surface=0.0,
            )
        except DivergenceError:
            self._t += dt_s
            nothing = np.full(6, np.nan)
            self.motion = replace(self.motion, t_s=self._t, nu=nothing, specific_force=nothing[:3])
            return self.motion
        self._state = run.final_state
        self._t += dt_s
        self.actuators = {name: float(values[-1]) for name, values in run.actuators.items()}
        self.motion = self._motion(np.asarray(run.tau[-1], float))
        return self.motion

    def _motion(self, tau: Array) -> Motion:
        state = self._state
        nu, q = np.asarray(state.nu, float), np.asarray(state.attitude, float)
        depth = float(state.position[2])
        rate = np.asarray(self.vehicle.acceleration(nu, q, tau, self._current, depth=depth), float)
        omega = nu[3:]
        force = rate[:3] + _cross(omega, nu[:3]) - self._gravity * matrix(q)[2]
        if self._arm.any():
            force = force + _cross(rate[3:], self._arm) + _cross(omega, _cross(omega, self._arm))
        return Motion(self._t, np.asarray(state.position, float), q, nu, np.asarray(force))


def _launched(vehicle: Vehicle, initial: State) -> State:
    """Where a flight really begins, as in the core: who is launched higher than it floats is afloat."""
    position = np.array(initial.position, float)
    depth = vehicle.floating_depth()
    if position[2] >= depth:
        return initial
    position[2] = depth
    return State(position, initial.attitude, initial.nu, initial.actuators)


def _cross(a: Array, b: Array) -> Array:
    """A x b of two vectors; NumPy's own takes as long as the step for the shapes that it allows."""
    (a1, a2, a3), (b1, b2, b3) = a.tolist(), b.tolist()
    return np.array([a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1])


@dataclass(frozen=True, eq=False)
class _Kind:
    """Columns of the 15 shown numbers that a kind of sensor tells, and the factor of its unit."""

    columns: tuple[int, ...]
    factor: float = 1.0


_KINDS = {
    "position": _Kind((0, 1)),
    "gps": _Kind((0, 1)),
    "depth": _Kind((2,)),
    "attitude": _Kind((3, 4, 5), np.pi / 180.0),
    "dvl": _Kind((6, 7, 8)),
    "gyro": _Kind((9, 10, 11), np.pi / 180.0),
}


class Shown:
    """What the sensors show of a motion: noise, offset, digits, rate and latency of each; the rest is true.

    `sensors`: by kind; position, depth, attitude, dvl and gyro count.

    Attributes
    ----------
    fresh
        Which of x y z, roll pitch yaw, u v w, p q r are a sample of the last `measure` and no held one,
        (12,).
    sentences
        What is shown without error, and what is left out.
    """

    def __init__(self, sensors: Mapping[str, Sensor], seed: int = 0) -> None:
        self._random = np.random.default_rng(seed)
        self._sensors = {kind: sensor for kind, sensor in sensors.items() if kind in _KINDS}
        self._bias = {
            kind: sensor.bias * self._random.standard_normal(len(_KINDS[kind].columns))
            for kind, sensor in self._sensors.items()
        }
        measured = {column for kind in self._sensors for column in _KINDS[kind].columns}
        groups = ("position", "depth", "attitude", "dvl", "gyro")
        perfect = [kind for kind in groups if not measured & set(_KINDS[kind].columns)]
        left_out = [kind for kind in sensors if kind not in _KINDS]
        sentences = [f"Shown without error, for want of a sensor: {', '.join(perfect)}."] if perfect else []
        sentences += [f"Left out, without a channel here: {', '.join(left_out)}."] if left_out else []
        self.sentences = tuple(sentences)
        self.fresh = np.ones(12, bool)
        self._past: deque[tuple[float, Array]] = deque()
        self._held: dict[str, tuple[float, Array]] = {}
        self._keep = max((sensor.latency_s for sensor in self._sensors.values()), default=0.0)

    def reset(self) -> None:
        """Forget the past; offsets stay, as they do aboard."""
        self._past.clear()
        self._held.clear()

    def measure(self, motion: Motion) -> Motion:
        """The motion as the sensors show it at its time."""
        row = np.array(motion.numbers)
        self._past.append((motion.t_s, row))
        while len(self._past) > 2 and self._past[1][0] <= motion.t_s - self._keep:
            self._past.popleft()
        seen = row.copy()
        self.fresh[:] = True
        for kind, sensor in self._sensors.items():
            seen[list(_KINDS[kind].columns)] = self._sample(kind, sensor, motion.t_s)
        return Motion(motion.t_s, seen[:3], from_euler(seen[3:6]), seen[6:].copy(), motion.specific_force)

    def _sample(self, kind: str, sensor: Sensor, t_s: float) -> Array:
        interval = 0.0 if sensor.rate_hz is None else 1.0 / sensor.rate_hz
        if kind in self._held and t_s < self._held[kind][0] + interval - 1e-9:
            self.fresh[list(_KINDS[kind].columns)] = False
            return self._held[kind][1]
        columns, factor = list(_KINDS[kind].columns), _KINDS[kind].factor
        then = t_s - sensor.latency_s
        row = next((old for time, old in reversed(self._past) if time <= then + 1e-9), self._past[0][1])
        noise = sensor.noise * self._random.standard_normal(len(columns))
        value = row[columns] + factor * (self._bias[kind] + noise)
        if sensor.quantum > 0.0:
            step = factor * sensor.quantum
            value = np.round(value / step) * step
        self._held[kind] = (t_s, value)
        return np.asarray(value)


def motion_table(rows: Sequence[Sequence[float]], others: Sequence[str]) -> pl.DataFrame:
    """Rows of time, position, attitude and velocity (SI), and of other columns, as the columns of a trial."""
    import polars as pl

    names = ["t_s", "x_m", "y_m", "z_m", "roll_deg", "pitch_deg", "yaw_deg"]
    names += ["u_m_s", "v_m_s", "w_m_s", "p_deg_s", "q_deg_s", "r_deg_s", *others]
    data = np.array(rows, float).reshape(len(rows), len(names))
    angles = [k for k, name in enumerate(names) if name.endswith(("_deg", "_deg_s"))]
    data[:, angles] = np.rad2deg(data[:, angles])
    return pl.DataFrame(data, schema=names, orient="row")
