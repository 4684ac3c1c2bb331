"""What perfect sensors would show of a run, at any time and at their own place in the vehicle.

A place r in the body frame moves with ``v_r = v_O + omega x r`` and lies at ``p_r = p_O + R(q) r``; through
the water it moves with ``v_r - R(q)' v_c``. GPS has a fix while its antenna is above the surface (down < 0);
bottom track needs the bottom within range along the sensor's own down axis. Source: Fossen, Handbook of
Marine Craft Hydrodynamics and Motion Control (2011), sections 2.2 and 8.3. Held by
tests/test_sensors_ideal.py.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.errors import TrialError
from seatrial.rotation import continuous, matrix, to_euler
from seatrial.sensors.conditions import Conditions
from seatrial.sensors.kinds import KINDS
from seatrial.sensors.load_cell import tether_force
from seatrial.sensors.sensor import Sensor

if TYPE_CHECKING:
    from seatrial._core import Run

__all__ = ["Ideal"]

Array = NDArray[np.float64]


class Ideal:
    """Perfect sensors on a run.

    Parameters
    ----------
    run : Run
        The true motion.
    conditions : Conditions
        Water, bottom, supply and tether.
    every : int, optional
        Only every so-many-th row of the run is looked at; values are linear in between.
    """

    def __init__(self, run: Run, conditions: Conditions, *, every: int = 1) -> None:
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
                water = self._at(self._conditions.water(len(run.t)), t)
                velocity -= np.einsum("nji,nj->ni", matrix(self._attitude(t)), water)
                return velocity
            velocity[self._out_of_range(sensor, t)] = np.nan
            return velocity
        if kind == "gyro":
            return np.rad2deg(self._at(run.nu[:, 3:], t))
        if kind == "attitude":
            return np.rad2deg(to_euler(self._attitude(t)))
        if kind in ("depth", "position", "gps"):
            place = self._place(r, t)
            if kind == "depth":
                return place[:, 2:]
            if kind == "gps":
                place[place[:, 2] >= 0.0] = np.nan
            return place[:, :2]
        if kind == "voltage":
            return self._voltage(t)
        if kind == "load_cell":
            return self._at(tether_force(run, self._conditions), t)
        return self._at(np.stack(list(run.actuators.values()), axis=1), t)

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

    def _place(self, r: Array, t: Array) -> Array:
        position = self._at(self._run.position, t)
        return position + matrix(self._attitude(t)) @ r if r.any() else position

    def _out_of_range(self, sensor: Sensor, t: Array) -> NDArray[np.bool_]:
        bottom = self._conditions.bottom_depth_m
        if bottom is None or sensor.max_range_m is None:
            return np.zeros(len(t), bool)
        altitude = bottom - self._place(np.array(sensor.position), t)[:, 2]
        if altitude.min(initial=np.inf) < 0.0:
            raise TrialError(
                f"dvl: the vehicle goes down to {bottom - altitude.min():.1f} m, below the bottom at"
                f" {bottom:g} m; give a deeper bottom or other commands"
            )
        down = matrix(self._attitude(t))[:, 2, 2]
        return np.asarray(altitude > sensor.max_range_m * down)

    def _voltage(self, t: Array) -> Array:
        voltage = self._conditions.voltage
        if voltage is None:
            raise TrialError(
                "voltage: no supply voltage is known; give voltage_v or leave the voltage sensor out"
            )
        held = np.searchsorted(self.t, t + 1e-9, side="right") - 1
        return np.asarray(voltage)[:: self._every][np.maximum(held, 0), None]
