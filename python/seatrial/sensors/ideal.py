"""What perfect sensors would show of a run, at any time and at their own lever arm.

A point r in the body frame moves with ``v_r = v_O + omega x r`` and lies at ``p_r = p_O + R(q) r``; through
the water it moves with ``v_r - R(q)' v_c``. A sensor whose axes are turned by R_s in the body (roll, pitch
and yaw of its tilt) shows the vector x as ``R_s' x``. GPS has a fix while its antenna is above the surface
(down < 0); bottom track needs the bottom within range along the sensor's own down axis. Source: Fossen,
Handbook of Marine Craft Hydrodynamics and Motion Control (2011), sections 2.2 and 8.3. Held by
``tests/sensors/test_sensors_ideal.py``.

A load cell shows the force of a tied vehicle on its tether, which balances all else that acts on the vehicle:

    load = tau_actuators + sum of the other forces at nu = 0   (body frame, N)

that is, the actuators' wrench and the restoring force; a current past the vehicle adds its drag. Positive is
a push forward, to starboard, down. Held by ``tests/sensors/test_sensors_load_cell.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError
from seatrial.base.frames import continuous, from_euler, matrix, to_euler
from seatrial.sensors.sensor import KINDS, Sensor

if TYPE_CHECKING:
    from seatrial._core import Run, Vehicle


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Circumstances of a run.

    Attributes
    ----------
    vehicle
        The vehicle that made the run; only a load cell needs it.
    current
        Velocity of the water over ground, NED, m/s, (3,) or one row per row of the run; None: still water.
    voltage_v
        Supply in V, one value per row of the run; None: not known.
    bottom_depth_m
        Depth of the bottom below the surface; None: within reach everywhere.
    held
        Whether the vehicle is tied, as in a bollard test.
    """

    vehicle: Vehicle | None = None
    current: Array | None = None
    voltage_v: Array | None = None
    bottom_depth_m: float | None = None
    held: bool = False

    def water(self, rows: int) -> Array:
        """Velocity of the water, shape (rows, 3), NED, m/s."""
        current = np.zeros(3) if self.current is None else np.asarray(self.current, float)
        return np.asarray(np.broadcast_to(current, (rows, 3)))


ON_THE_TETHER = ("load_cell", "revolutions", "voltage")
"""Sensors that log while the vehicle is tied."""


def at_sea(sensors: Mapping[str, Sensor]) -> dict[str, Sensor]:
    """Those of a vehicle's sensors that log while no tether holds it: all but the load cell."""
    return {kind: sensor for kind, sensor in sensors.items() if kind != "load_cell"}


def _tether_force(run: Run | Motion, conditions: Surroundings) -> Array:
    """Force (n, 3) of a held vehicle on its tether at the rows of its run, body frame, N.

    Raises
    ------
    TrialError
        The vehicle is not held.
    """
    wrench = getattr(run, "tau", None)
    if not conditions.held or conditions.vehicle is None or wrench is None:
        raise TrialError(
            "load_cell: a load cell shows the pull of a tied vehicle, and this one moves freely; hold it"
            " (held = true in a recipe, --held on the command line) or leave the load cell out"
        )
    count = len(run.t)
    at_rest = np.zeros((count, 6))
    terms = conditions.vehicle.forces(at_rest, np.asarray(run.attitude), conditions.water(count))
    return np.asarray((np.asarray(wrench) + np.sum(list(terms.values()), axis=0))[:, :3])


def _turned(vectors: Array, sensor: Sensor) -> Array:
    """Vectors (n, 3) of the body frame along the sensor's own axes."""
    return np.asarray(vectors @ matrix(from_euler(np.array(sensor.tilt)))) if any(sensor.tilt) else vectors


class Motion(Protocol):
    """What sensors look at: a run of the model, or a flight."""

    @property
    def t(self) -> Array:
        """Times (n,), s, uniform."""

    @property
    def position(self) -> Array:
        """Of O, NED, m, (n, 3)."""

    @property
    def attitude(self) -> Array:
        """Unit quaternions (n, 4), body to NED."""

    @property
    def nu(self) -> Array:
        """Velocities (n, 6), body frame, m/s and rad/s."""

    @property
    def actuators(self) -> Mapping[str, Array]:
        """What the actuators do, {name: (n,)}, in the unit of the command."""


class Ideal:
    """Perfect sensors on a run.

    Parameters
    ----------
    run : Run or Motion
        The true motion; a load cell needs the run of a held vehicle.
    conditions : Surroundings
        Water, bottom, supply and tether.
    every : int, optional
        Only every so-many-th row of the run is looked at; values are linear in between.
    """

    def __init__(self, run: Run | Motion, conditions: Surroundings, *, every: int = 1) -> None:
        self._run, self._conditions, self._every = run, conditions, every
        self.t: Array = np.asarray(run.t)[::every]

    def columns(self, kind: str) -> tuple[str, ...]:
        """Columns that a kind of sensor logs of this run."""
        if kind == "revolutions":
            return tuple(f"meas.{name}" for name in self._run.actuators)
        return KINDS[kind].columns

    def values(self, kind: str, sensor: Sensor, t: Array) -> Array:
        """True values (m, columns) at the times `t` (m,), in the columns' units; NaN where it sees nothing.

        Raises
        ------
        TrialError
            The run has not what the sensor measures, or goes through the bottom.
        """
        run, r = self._run, np.array(sensor.position)
        if kind in ("dvl", "dvl_water"):
            velocity = self._velocity(r, t)
            if kind == "dvl_water":
                # The velocity through the water is that over ground less the current, in the body's axes.
                water = self._at(self._conditions.water(len(run.t)), t)
                velocity -= np.einsum("nji,nj->ni", matrix(self._attitude(t)), water)
                return _turned(velocity, sensor)
            velocity[self._out_of_range(sensor, t)] = np.nan
            return _turned(velocity, sensor)
        if kind == "gyro":
            return _turned(np.rad2deg(self._at(run.nu[:, 3:], t)), sensor)
        if kind == "attitude":
            return np.rad2deg(to_euler(self._attitude(t)))
        if kind in ("depth", "position", "gps"):
            position = self._position(r, t)
            if kind == "depth":
                return position[:, 2:]
            if kind == "gps":
                position[~self._in_the_air(r, t)] = np.nan
            return position[:, :2]
        if kind == "voltage":
            return self._voltage(t)
        if kind == "load_cell":
            return self._at(_tether_force(run, self._conditions), t)
        return self._at(np.stack(list(run.actuators.values()), axis=1), t)

    def _in_the_air(self, r: Array, t: Array) -> NDArray[np.bool_]:
        """Whether the antenna of a GPS is above the surface; on top of the hull where it has no place."""
        vehicle = self._conditions.vehicle
        antenna = r if r.any() or vehicle is None else np.asarray(vehicle.hull_top())
        return np.asarray(self._position(antenna, t)[:, 2] < 0.0)

    def _at(self, values: ArrayLike, t: Array) -> Array:
        """Values of the run's rows (n, k) at the times `t`, (m, k)."""
        return self._between(np.asarray(values, float)[:: self._every], t)

    def _between(self, table: Array, t: Array) -> Array:
        return np.stack([np.interp(t, self.t, column) for column in table.T], axis=1)

    def _attitude(self, t: Array) -> Array:
        q = self._between(continuous(self._run.attitude[:: self._every])[0], t)
        return np.asarray(q / np.linalg.norm(q, axis=1)[:, None])

    def _velocity(self, r: Array, t: Array) -> Array:
        nu = self._at(self._run.nu, t)
        return np.asarray(nu[:, :3] + np.cross(nu[:, 3:], r))

    def _position(self, r: Array, t: Array) -> Array:
        position = self._at(self._run.position, t)
        return position + matrix(self._attitude(t)) @ r if r.any() else position

    def _out_of_range(self, sensor: Sensor, t: Array) -> NDArray[np.bool_]:
        bottom = self._conditions.bottom_depth_m
        if bottom is None or sensor.max_range_m is None:
            return np.zeros(len(t), bool)
        altitude = bottom - self._position(np.array(sensor.position), t)[:, 2]
        if altitude.min(initial=np.inf) < 0.0:
            raise TrialError(
                f"dvl: the vehicle goes down to {bottom - altitude.min():.1f} m, below the bottom at"
                f" {bottom:g} m; give a deeper bottom or other commands"
            )
        down = matrix(self._attitude(t))[:, 2, 2]
        return np.asarray(altitude > sensor.max_range_m * down)

    def _voltage(self, t: Array) -> Array:
        voltage_v = self._conditions.voltage_v
        if voltage_v is None:
            raise TrialError(
                "voltage: no supply voltage is known; give voltage_v or leave the voltage sensor out"
            )
        held = np.searchsorted(self.t, t + 1e-9, side="right") - 1
        return np.asarray(voltage_v)[:: self._every][np.maximum(held, 0), None]
