"""Generated trials: recordings that no vehicle made, simulated from a recipe.

A recipe is a TOML file: a truth vehicle with its sensors (a second file, shared by the recipes of a
campaign), the commands over time, a seed. The same recipe gives the same table. The reader "generated" turns
it into a table like that of any log, so that a campaign can name a recipe instead of a recording. The
models here are the only owner of the format; unknown keys are refused with the nearest known name. Held by
``tests/sensors/test_sensors.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from seatrial.base.arrays import Array
from seatrial.base.atomic_write import write_table
from seatrial.base.errors import TrialError, nearest
from seatrial.base.toml_file import Name, Number, Positive, Section
from seatrial.sensors.ideal import ON_THE_TETHER, Conditions, at_sea
from seatrial.sensors.log import finer, held, measure, times
from seatrial.sensors.sensor import Sensor, read_as
from seatrial.trial.truth import Truth, TruthFile
from seatrial.vehicle.actuators import actuator_groups

if TYPE_CHECKING:
    import polars as pl

    from seatrial._core import Run, Vehicle

__all__ = ["Recipe", "files_of", "write_generated"]

_STEP_S = 0.01

_MOST_ROWS = 1e7


class _Initial(Section):
    """State at the start, at rest over ground but for surge."""

    depth_m: Number = 0.0
    roll_deg: Number = 0.0
    pitch_deg: Number = 0.0
    yaw_deg: Number = 0.0
    surge_m_s: Number = 0.0


class _Current(Section):
    """Steady current over ground, NED."""

    north_m_s: Number = 0.0
    east_m_s: Number = 0.0
    down_m_s: Number = 0.0


class RecipeFile(Section):
    """A generated trial."""

    file_kind = "the recipe of a generated trial"

    format: Literal[1]
    description: str
    truth: Name
    seed: Annotated[int, Field(strict=True, ge=0)]
    duration_s: Positive
    rate_hz: Positive = 10.0
    held: Annotated[bool, Field(strict=True)] = False
    voltage_v: Positive | None = None
    bottom_depth_m: Positive | None = None
    initial: _Initial = _Initial()
    current: _Current = _Current()
    commands: tuple[dict[str, Number], ...] = ()

    @model_validator(mode="after")
    def _a_held_vehicle_is_at_rest(self) -> RecipeFile:
        if self.held and self.initial.surge_m_s != 0.0:
            raise ValueError(
                f"a held vehicle does not move, found initial surge_m_s = {self.initial.surge_m_s:g};"
                " leave it out, or held"
            )
        return self


@dataclass(frozen=True)
class Recipe:
    """A recipe of a generated trial.

    Attributes
    ----------
    path, description, seed
        The file, what it is for, and the seed of the sensors' noise.
    truth
        The vehicle that sails it.
    t, commands
        Times in s, shape (n,), and commands {actuator: (n,)}, each in its own unit.
    initial
        State at the start, by the recipe's keys.
    current
        Steady current (3,), NED, m/s; only a sensor of the velocity through the water measures it.
    held
        Whether the vehicle is tied, as in a bollard test: no axis moves.
    voltage_v
        Supply in V, (n,), where the recipe gives one.
    bottom_depth_m
        Depth of the bottom, where the recipe gives one.
    """

    path: Path
    description: str
    seed: int
    truth: Truth
    t: Array
    commands: Mapping[str, Array]
    initial: Mapping[str, float]
    current: Array
    held: bool = False
    voltage_v: Array | None = None
    bottom_depth_m: float | None = None

    @classmethod
    def load(cls, path: str | Path, *, truth: Truth | None = None) -> Recipe:
        """Recipe from its file.

        Parameters
        ----------
        path : str or Path
        truth : Truth, optional
            Sails it instead of the recipe's own.

        Raises
        ------
        TrialError
            The recipe or its truth file cannot be read, names an actuator that the vehicle has not, or gives
            no supply voltage on which the vehicle's thrust depends.
        """
        path = Path(path)
        file = read_as(RecipeFile, path)
        if truth is None:
            truth = Truth.load(path.parent / file.truth)
        rows = round(file.duration_s * file.rate_hz)
        if rows > _MOST_ROWS:
            raise TrialError(
                f"{path}: duration_s times rate_hz: expected at most {_MOST_ROWS:.0e} rows of a log, found"
                f" {rows:.1e}; shorten the trial or log less often"
            )
        t = np.arange(rows) / file.rate_hz
        commands, voltage_v = _commands(file, truth.vehicle, t, str(path))
        current = np.array([file.current.north_m_s, file.current.east_m_s, file.current.down_m_s])
        initial = file.initial.model_dump()
        return cls(
            path=path,
            description=file.description,
            seed=file.seed,
            truth=truth,
            t=t,
            commands=commands,
            initial=initial,
            current=current,
            held=file.held,
            voltage_v=voltage_v,
            bottom_depth_m=file.bottom_depth_m,
        )

    @property
    def every(self) -> int:
        """Rows of `run` per row of the log: 1, or so many that a sensor may sample in between."""
        return finer(self.sensors.values(), self.t)

    @property
    def sensors(self) -> dict[str, Sensor]:
        """Those of the truth that log: on the tether cell, motors and supply, at sea all but the cell."""
        carried = self.truth.sensors
        if self.held:
            return {kind: sensor for kind, sensor in carried.items() if kind in ON_THE_TETHER}
        return at_sea(carried)

    def run(self) -> Run:
        """What the truth vehicle really did, with `every` rows per row of the log."""
        from seatrial._core import State

        start = self.initial
        state = State(
            position=[0.0, 0.0, start["depth_m"]],
            attitude=np.deg2rad([start["roll_deg"], start["pitch_deg"], start["yaw_deg"]]),
            nu=[start["surge_m_s"], 0.0, 0.0, 0.0, 0.0, 0.0],
        )
        commands: dict[str, ArrayLike] = {name: held(y, self.every) for name, y in self.commands.items()}
        run = self.truth.vehicle.simulate(
            times(self.t, self.every),
            commands,
            state,
            self.current,
            "" if self.held else "XYZKMN",
            voltage_v=self._fine_voltage,
            max_step_s=_STEP_S,
        )
        if not np.isfinite(np.asarray(run.nu)).all():
            raise TrialError(
                f"{self.path}: the truth vehicle's motion diverges; check current, commands and the truth's"
                " coefficients"
            )
        return run

    def table(self, *, run: Run | None = None, seed: int | None = None) -> pl.DataFrame:
        """What its `sensors` logged, with canonical columns, the commands, and the supply as set.

        A supply that a voltage sensor measures is logged by it alone.

        Parameters
        ----------
        run : Run, optional
            An earlier result of `run`, which no seed changes.
        seed : int, optional
            Seed of the sensors' noise and biases; by default the recipe's.
        """
        sensors = self.sensors
        inputs = {f"cmd.{name}": y for name, y in self.commands.items()}
        if self.voltage_v is not None and "voltage" not in sensors:
            inputs["voltage_v"] = self.voltage_v
        around = Conditions(
            vehicle=self.truth.vehicle,
            current=self.current,
            voltage_v=self._fine_voltage,
            bottom_depth_m=self.bottom_depth_m,
            held=self.held,
        )
        return measure(
            self.run() if run is None else run,
            sensors,
            seed=self.seed if seed is None else seed,
            conditions=around,
            inputs=inputs,
            every=self.every,
        )

    @property
    def _fine_voltage(self) -> Array | None:
        return None if self.voltage_v is None else held(self.voltage_v, self.every)

    def save(self, path: str | Path) -> None:
        """Save the table as a CSV file whose first lines say that it was generated, and from what.

        Raises
        ------
        TrialError
            The file cannot be written.
        """
        write_generated(self.table(), path, f"{self.path.name}, seed {self.seed}", self.description)


def files_of(path: str | Path) -> tuple[Path, ...]:
    """Files that a generated trial is made of: its recipe, the truth, the truth's own vehicle file.

    Raises
    ------
    TrialError
        The recipe or its truth file cannot be read.
    """
    recipe = Path(path)
    truth = recipe.parent / read_as(RecipeFile, recipe).truth
    vehicle = read_as(TruthFile, truth).vehicle
    return (recipe, truth, *((truth.parent / vehicle,) if vehicle.endswith(".toml") else ()))


def write_generated(table: pl.DataFrame, path: str | Path, origin: str, description: str = "") -> None:
    """Write a table as a CSV file whose first lines say that it was generated, and from what.

    Raises
    ------
    TrialError
        The file cannot be written.
    """
    lines = [f"GENERATED by seatrial from {origin}: no vehicle was at sea.", *description.splitlines()]
    write_table(table, path, comments="".join(f"# {line}\n" for line in lines))


def _commands(
    file: RecipeFile, vehicle: Vehicle, t: Array, where: str
) -> tuple[dict[str, Array], Array | None]:
    """Commands (n,) of every actuator and the supply (n,); a row sets them from its ``t_s`` on."""
    facts = vehicle.actuator_info()
    members = actuator_groups(vehicle) | {name: [name] for name in vehicle.actuators}
    commands = {name: np.full(len(t), float(facts[name]["neutral"])) for name in vehicle.actuators}
    voltage_v = np.full(len(t), np.nan if file.voltage_v is None else file.voltage_v)
    last = -np.inf
    for number, row in enumerate(file.commands, 1):
        entry = f"{where}: commands[{number}]"
        start = row.get("t_s")
        if start is None or start < last:
            raise TrialError(
                f"{entry}: expected t_s, s, not before the row above; found {start}; sort the rows"
            )
        last = start
        after = t >= start - 1e-9
        for name, value in row.items():
            if name == "voltage_v":
                if value <= 0.0:
                    raise TrialError(f"{entry}, key voltage_v: expected a positive number, found {value:g}")
                voltage_v[after] = value
            elif name in members:
                for actuator in members[name]:
                    commands[actuator][after] = value
            elif name != "t_s":
                raise TrialError(f'{entry}: unknown actuator or group "{name}"{nearest(name, members)}')
    if np.isfinite(voltage_v).all():
        return commands, voltage_v
    if np.isfinite(voltage_v).any():
        raise TrialError(f"{where}: a row of commands gives voltage_v later; give the key voltage_v too")
    if any(actuator["needs_voltage"] for actuator in facts.values()):
        raise TrialError(
            f"{where}: the thrust of {vehicle.name} depends on the supply voltage; give the key voltage_v"
        )
    return commands, None
