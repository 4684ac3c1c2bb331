"""A vehicle simulated under the commands of a file: the true run, its table, and what sensors log of it.

`SimulatedTrial` takes commands, voltage, added forces and the current from a trial and runs the core with as
many steps per row as the sensors need. Commands that do not fit the vehicle and diverging runs are refused.
Held by ``tests/base/test_bad_input.py`` and ``tests/cli/test_cli_sensors.py``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.errors import DivergenceError, TrialError, nearest
from seatrial.base.finding import Finding, Severity
from seatrial.base.report import Report, report_of
from seatrial.sensors.log import Surroundings, finer, held, linear, measure, times
from seatrial.trial.columns import WRENCH
from seatrial.trial.generated import motion_table, write_generated

if TYPE_CHECKING:
    from pathlib import Path

    import polars as pl

    from seatrial._core import Vehicle
    from seatrial.base.arrays import Array
    from seatrial.sensors.sensor import Sensor
    from seatrial.trial.trial import Trial


@dataclass(frozen=True)
class SimulationSettings:
    """What a simulated run is warned of."""

    #: m of the origin above the surface: less is rounding and the swell of a start at depth 0
    rise_m: float = 0.05
    over_limit: float = 1.0 + 1e-6  #: of a limit: less is rounding
    no_angle_rad: float = 1.6  #: rad: no fin is turned so far
    no_force: float = 5.0  #: limits: a force beyond so many is in another unit


SETTINGS = SimulationSettings()


class SimulatedTrial:
    """A vehicle under the commands of a file, with as many rows per row of the file as its sensors need."""

    def __init__(
        self,
        vehicle: Vehicle,
        trial: Trial,
        free: str,
        held: bool,
        current: tuple[float, float, float] | None,
        sensors: dict[str, Sensor] | None,
    ) -> None:
        from seatrial._core import State

        _check(vehicle, trial, held, current)
        self.vehicle, self.trial, self.held, self.sensors = vehicle, trial, held, sensors or {}
        self.every = finer(self.sensors.values(), trial.t)
        self.current: Array | None = None if current is None else np.array(current)
        if current is None and trial.current is not None:
            self.current = linear(trial.current, self.every)
        self.voltage = None if trial.voltage_v is None else self._rows(trial.voltage_v)
        try:
            self.run = vehicle.simulate(
                times(trial.t, self.every),
                {name: self._rows(values) for name, values in trial.commands.items()},
                State(trial.position[0], trial.attitude[0], trial.nu[0]),  # zero where it was not recorded
                self.current,
                "" if held else free,
                None if trial.tau is None else self._rows(trial.tau),
                voltage_v=self.voltage,
                rho=trial.rho,
                g=trial.g,
                surface=trial.surface,
            )
        except DivergenceError as error:
            raise DivergenceError(f"{trial.source}: {error}") from None

    def _rows(self, values: Array) -> Array:
        """Values that hold from row to row, at the steps of the run."""
        return held(values, self.every)

    def write_log(self, path: Path, seed: int, bottom: float | None, label: str) -> None:
        """Write what the sensors log, and the inputs of the run but for the current."""
        inputs = {f"cmd.{name}": values for name, values in self.trial.commands.items()}
        if self.trial.voltage_v is not None and "voltage" not in self.sensors:
            inputs["voltage_v"] = self.trial.voltage_v
        if self.trial.tau is not None:
            inputs |= dict(zip(WRENCH, self.trial.tau.T, strict=True))
        around = Surroundings(
            vehicle=self.vehicle,
            current=self.current,
            voltage_v=self.voltage,
            bottom_depth_m=bottom,
            held=self.held,
        )
        log = measure(self.run, self.sensors, seed=seed, conditions=around, inputs=inputs, every=self.every)
        write_generated(log, path, label)

    def frame(self) -> pl.DataFrame:
        """Table of a run with canonical columns, the commands and the actuators behind their motors."""
        return motion_table(self.run, self.trial.commands, self.every)

    def summary(self) -> dict[str, Any]:
        """Duration, distance, speeds and angles of the whole run, each key with its unit."""
        run = self.run
        speed = np.linalg.norm(np.asarray(run.nu)[:, :3], axis=1)
        path = np.linalg.norm(np.diff(np.asarray(run.position), axis=0), axis=1).sum()
        angles = np.rad2deg(run.euler)
        return {
            "duration, s": float(run.t[-1] - run.t[0]),
            "distance, m": float(path),
            "largest speed, m/s": float(speed.max()),
            "last speed, m/s": float(speed[-1]),
            "last depth, m": float(run.position[-1, 2]),
            "smallest depth, m": float(np.asarray(run.position)[:, 2].min()),
            "largest heel, deg": float(np.abs(angles[:, 0]).max()),
            "largest trim, deg": float(np.abs(angles[:, 1]).max()),
            "last heading, deg": float(angles[-1, 2]),
        }

    def findings(self) -> list[Finding]:
        """Commands beyond their limits, and what the run or its log does not show."""
        findings = _clipped(self.vehicle, self.trial)
        rise = -float(np.asarray(self.run.position)[:, 2].min())
        if rise > SETTINGS.rise_m and self.trial.surface is None:
            findings.append(Finding("leaves the water", Severity.WEAKNESS, values={"rise_m": rise}))
        if self.held and self.sensors and "load_cell" not in self.sensors:
            findings.append(Finding("no load cell", Severity.WEAKNESS))
        return findings

    def report(self, title: str, next_step: str) -> Report:
        """Three lines and a table of a simulated run."""
        return report_of(self, title=title, next_step=next_step)


def _check(vehicle: Vehicle, trial: Trial, held: bool, current: tuple[float, float, float] | None) -> None:
    for name in trial.commands:
        if name not in vehicle.actuators:
            raise TrialError(
                f'{trial.source}: column "cmd.{name}": the vehicle {vehicle.name} has no such actuator'
                + nearest(name, vehicle.actuators)
            )
    if not trial.commands and trial.tau is None:
        raise TrialError(
            f"{trial.source}: nothing drives the vehicle; expected columns cmd.{vehicle.actuators[0]} ..."
            if vehicle.actuators
            else f"{trial.source}: nothing drives the vehicle; expected columns tau.X_n ..."
        )
    if any(facts["needs_voltage"] for facts in vehicle.actuator_info().values()) and trial.voltage_v is None:
        raise TrialError(
            f"{trial.source}: the thrust of {vehicle.name} depends on the supply voltage; add a column"
            " voltage_v"
        )
    if held and np.any(trial.nu[0]):
        raise TrialError(
            f"{trial.source}: --held: a tied vehicle is at rest, and these commands start with a velocity;"
            " leave the columns of velocity out"
        )
    if current is not None and not np.isfinite(current).all():
        raise TrialError(f"--current: expected three numbers in m/s, found {current}")


def _clipped(vehicle: Vehicle, trial: Trial) -> list[Finding]:
    """That commands are beyond what their actuators take, of the worst one; empty where all are within."""
    facts = vehicle.actuator_info()
    excesses = []
    for name, commands in trial.commands.items():
        fact = facts[name]
        away = np.asarray(commands) - float(fact["neutral"])
        signal = -away if fact["reversed"] else away
        limit = np.where(signal < 0.0, float(fact["maximum_astern"]), float(fact["maximum_ahead"]))
        over = np.abs(away) > SETTINGS.over_limit * limit
        if over.any():
            row = int(np.argmax(np.where(over, np.abs(away), 0.0)))
            excesses.append((float(np.mean(over)), name, float(away[row]), float(limit[row])))
    if not excesses:
        return []
    share, name, largest, limit_there = max(excesses)
    values = {
        "share": share,
        "largest": largest,
        "limit": limit_there,
        "neutral": float(facts[name]["neutral"]),
        "unit": str(facts[name]["unit"]),
        "others": [other for _, other, *_ in excesses if other != name],
    }
    return [Finding("commands clipped", Severity.WEAKNESS, name, values)]
