"""The work that all contenders do: CWolf, a recorded manoeuvre, a population of candidates.

The record excites every axis and crosses zero revolutions; the channels to fit are those of the vehicle
itself with noise, so that no candidate fits exactly. One step is a quarter of the log's sample.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

import seatrial as st
from benchmarks.casadi_model import coefficient_values
from benchmarks.textbook_kinematics import euler
from benchmarks.textbook_vehicle import Parameters, from_vehicle
from seatrial import _core

Array: TypeAlias = NDArray[np.float64]

RATE_HZ = 10.0
SUBSTEPS = 4
STEP_S = 1.0 / RATE_HZ / SUBSTEPS
# The dead time is read from the record: candidates that differ in it read different samples.
DEAD_TIME = ".T_t"


@dataclass(frozen=True)
class Workload:
    """A vehicle, its record and what is fitted to it."""

    vehicle: st.Vehicle
    parameters: Parameters
    t: Array
    commands: dict[str, ArrayLike]
    tau: Array | None
    observed: Array
    weight: Array

    @property
    def steps(self) -> int:
        """Time steps per candidate."""
        return (len(self.t) - 1) * SUBSTEPS

    def names(self) -> list[str]:
        """The coefficients that vary: all that the vehicle has."""
        return list(coefficient_values(self.parameters))

    def own(self) -> Array:
        """Return the vehicle's own values of ``names`` (coefficients,)."""
        return np.array(list(coefficient_values(self.parameters).values()))

    def candidates(self, count: int, *, dead_times: bool = True) -> Array:
        """Return ``count`` candidates (count, coefficients) within 5 % of the vehicle's own."""
        names = self.names()
        spread = np.random.default_rng(5).uniform(0.95, 1.05, size=(count, len(names)))
        if not dead_times:
            spread[:, [name.endswith(DEAD_TIME) for name in names]] = 1.0
        values: Array = spread * self.own()
        return values

    def open_loop(self) -> _core.OpenLoop:
        """Return the core's batch over the whole record, every coefficient sought."""
        record = _core.Record(self.t, self.commands, tau=self.tau, observed=self.observed, weight=self.weight)
        start = (0, 0, len(self.t), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(6))
        return _core.OpenLoop(self.vehicle, [record], [start], substeps=SUBSTEPS, names=self.names())


def chain(samples: int) -> Workload:
    """Return the whole vehicle under commands: motors, propellers, hull, criterion."""
    vehicle = st.Vehicle.load("cwolf")
    rng = np.random.default_rng(3)
    t = np.arange(samples) / RATE_HZ
    hold = 20
    commands: dict[str, ArrayLike] = {}
    for name in vehicle.actuators:
        levels = np.concatenate([[0.0], rng.uniform(-800.0, 1600.0, size=samples // hold)])
        commands[name] = np.repeat(levels, hold)[:samples]
    return fitted(vehicle, t, commands, None)


def hull(samples: int) -> Workload:
    """Return rigid body and hydrodynamics alone under a direct wrench."""
    # The thrusters are the last tables of the file.
    text = st.Vehicle.load("cwolf").to_toml().split("[[thrusters]]")[0]
    t = np.arange(samples) / RATE_HZ
    amplitude = np.array([60.0, 10.0, 10.0, 0.3, 8.0, 10.0])
    phase = np.linspace(0.0, 3.0, 6)
    tau = amplitude * np.sin(0.3 * t[:, None] + phase)
    return fitted(st.Vehicle.from_toml(text), t, {}, tau)


def fitted(vehicle: st.Vehicle, t: Array, commands: dict[str, ArrayLike], tau: Array | None) -> Workload:
    """Return the workload of a record, its channels those of the vehicle with noise."""
    run = vehicle.simulate(t, commands, tau=tau, max_step_s=STEP_S)
    rng = np.random.default_rng(4)
    attitude = np.array([euler(q) for q in np.asarray(run.attitude)])
    clean = np.hstack([run.nu, run.position, attitude])
    observed = clean + 0.01 * rng.standard_normal(clean.shape)
    return Workload(
        vehicle=vehicle,
        parameters=from_vehicle(vehicle),
        t=t,
        commands=commands,
        tau=tau,
        observed=observed,
        weight=np.ones_like(observed),
    )
