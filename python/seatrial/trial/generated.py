"""Generated trials: recordings that no vehicle made, simulated from a recipe.

A recipe is a TOML file: a truth vehicle with its sensors (a second file, shared by the recipes of a
campaign), the commands over time or an autopilot with a mission (`seatrial.trial.truth`), a seed. The same
recipe gives the same table. The reader "generated" turns it into a table like that of any log, so that a
campaign can name a recipe instead of a recording. The models here are the only owner of the format; unknown
keys are refused with the nearest known name. Held by ``tests/sensors/test_sensors.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from seatrial.base.arrays import Array
from seatrial.base.errors import DivergenceError, TrialError, nearest
from seatrial.base.files import write_table
from seatrial.base.toml_file import Name, Number, Positive, Section
from seatrial.flight.flight import Flight
from seatrial.sensors.log import ON_THE_TETHER, Surroundings, at_sea, finer, held, measure, times
from seatrial.sensors.sensor import Sensor, read_as
from seatrial.trial.truth import DITHER, Current, Sailed, SailedTable, Truth, TruthFile, WavesTable
from seatrial.vehicle.actuators import actuator_groups

if TYPE_CHECKING:
    import polars as pl

    from seatrial._core import Run, State, Vehicle


_STEP_S = 0.01  # longest step of the simulation

_MOST_ROWS = 1e7  # of a log: a wrong duration or rate must not fill the memory


class _Initial(Section):
    """State at the start, at rest over ground but for surge."""

    depth_m: Number = 0.0
    roll_deg: Number = 0.0
    pitch_deg: Number = 0.0
    yaw_deg: Number = 0.0
    surge_m_s: Number = 0.0


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
    initial: _Initial | None = None
    current: Current = Current()
    waves: WavesTable | None = None
    commands: tuple[dict[str, Number], ...] = ()
    sailed: SailedTable | None = None

    @model_validator(mode="after")
    def _a_held_vehicle_is_at_rest(self) -> RecipeFile:
        if self.held and self.initial is not None and self.initial.surge_m_s != 0.0:
            raise ValueError(
                f"a held vehicle does not move, found initial surge_m_s = {self.initial.surge_m_s:g};"
                " leave it out, or held"
            )
        return self

    @model_validator(mode="after")
    def _commanded_or_sailed(self) -> RecipeFile:
        if self.sailed is None:
            for what, given in (("waves", self.waves is not None), ("current", self.current.varies)):
                if given:
                    raise ValueError(
                        f"{what}: water that moves unsteadily needs an autopilot, found no table [sailed];"
                        " add one, or keep to a steady current"
                    )
        elif self.commands or self.held:
            raise ValueError(
                f"an autopilot sails this trial, found {'held' if self.held else 'commands'} beside [sailed];"
                " leave one of them out"
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
        Current (3,), NED, m/s, at the start where it varies; only a sensor of the velocity through the water
        measures it.
    held
        Whether the vehicle is tied, as in a bollard test: no axis moves.
    voltage_v
        Supply in V, (n,), where the recipe gives one.
    bottom_depth_m
        Depth of the bottom, where the recipe gives one.
    sailed, flight
        How an autopilot sails it, and the flight: None where commands are given.
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
    sailed: Sailed | None = None
    flight: Flight | None = None

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
        initial = (file.initial or _Initial()).model_dump()
        recipe = cls(
            path=path,
            description=file.description,
            seed=file.seed,
            truth=truth,
            t=t,
            commands=commands,
            initial=initial,
            current=file.current.at_start,
            held=file.held,
            voltage_v=voltage_v,
            bottom_depth_m=file.bottom_depth_m,
        )
        if file.sailed is None:
            return recipe
        # A recipe with an autopilot has no commands of its own: it is flown for them.
        sailed = Sailed.of(
            file.sailed,
            path,
            truth,
            waves=file.waves,
            current=file.current,
            initial=None if file.initial is None else _state(initial),
            duration_s=file.duration_s,
            rate_hz=file.rate_hz,
            bottom_depth_m=file.bottom_depth_m,
            voltage_v=file.voltage_v,
        )
        return replace(recipe, sailed=sailed).with_seed(file.seed)

    def with_seed(self, seed: int) -> Recipe:
        """The same recipe with another seed; what an autopilot sails is flown again, in another sea.

        Raises
        ------
        TrialError
            It cannot be flown.
        """
        if self.sailed is None:
            return replace(self, seed=seed)
        flight = self.sailed.fly(seed)
        every = self.sailed.every(flight)
        rows = (len(flight.t) - 1) // every * every + 1
        return replace(
            self,
            seed=seed,
            flight=flight,
            t=flight.t[:rows:every],
            commands={name: values[:rows:every] for name, values in flight.commands.items()},
            voltage_v=None
            if self.voltage_v is None
            else np.full(len(range(0, rows, every)), self.voltage_v[0]),
        )

    @property
    def every(self) -> int:
        """Rows of `run` per row of the log: 1, or so many that a sensor may sample in between."""
        if self.sailed is not None and self.flight is not None:
            return self.sailed.every(self.flight)
        return finer(self.sensors.values(), self.t)

    @property
    def sensors(self) -> dict[str, Sensor]:
        """Those of the truth that log: on the tether cell, motors and supply, at sea all but the cell."""
        carried = self.truth.sensors
        if self.held:
            return {kind: sensor for kind, sensor in carried.items() if kind in ON_THE_TETHER}
        return at_sea(carried)

    def run(self) -> Run | Flight:
        """What the truth vehicle really did, with `every` rows per row of the log."""
        if self.flight is not None:
            return self.flight
        commands: dict[str, ArrayLike] = {name: held(y, self.every) for name, y in self.commands.items()}
        try:
            return self.truth.vehicle.simulate(
                times(self.t, self.every),
                commands,
                _state(self.initial),
                self.current,
                "" if self.held else "XYZKMN",
                voltage_v=self._fine_voltage,
                max_step_s=_STEP_S,
            )
        except DivergenceError as error:
            raise TrialError(f"{self.path}: the truth vehicle: {error}") from None

    def table(self, *, run: Run | Flight | None = None, seed: int | None = None) -> pl.DataFrame:
        """What its `sensors` logged, with canonical columns, the commands, and the supply as set.

        A supply that a voltage sensor measures is logged by it alone.

        Parameters
        ----------
        run : Run or Flight, optional
            An earlier result of `run`, which no seed changes where commands are given.
        seed : int, optional
            Seed of the sensors' noise and biases, and of the sea of a sailed trial; by default the recipe's.
        """
        if self.sailed is not None and seed not in (None, self.seed):
            return self.with_seed(seed).table()
        sensors = self.sensors
        inputs = {f"cmd.{name}": y for name, y in self.commands.items()}
        if self.sailed is not None:
            inputs |= {DITHER + name: y for name, y in self.sailed.added(self.t).items()}
        if self.voltage_v is not None and "voltage" not in sensors:
            inputs["voltage_v"] = self.voltage_v
        around = Surroundings(
            vehicle=self.truth.vehicle,
            current=self.current if self.flight is None else self.flight.current,
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

    def truth_table(self) -> pl.DataFrame:
        """What really happened, with canonical columns: motion, water, commands and actuators.

        Of a sailed trial it is the log of the flight, a row per control period, with what the autopilot
        measured and wanted beside it.
        """
        import polars as pl

        if self.flight is not None:
            return self.flight.table()
        run = self.run()
        assert not isinstance(run, Flight)
        table = motion_table(run, self.commands, self.every)
        water = zip(("north", "east", "down"), self.current, strict=True)
        return table.with_columns(**{f"current_{axis}_m_s": pl.lit(v) for axis, v in water})

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
    """Files that a generated trial is made of: recipe, truth, the truth's own vehicle file, what sails it."""
    recipe = Path(path)
    file = read_as(RecipeFile, recipe)
    truth = recipe.parent / file.truth
    named = [(truth, read_as(TruthFile, truth).vehicle)]
    if file.sailed is not None:
        named += [(recipe, getattr(file.sailed, key)) for key in ("autopilot", "mission", "sensors")]
        if file.sailed.dither is not None:
            named.append((recipe, file.sailed.dither))
    beside = (owner.parent / name for owner, name in named if name.endswith((".toml", ".csv")))
    return (recipe, truth, *beside)


def motion_table(run: Run, commands: Mapping[str, Array], every: int = 1) -> pl.DataFrame:
    """Canonical table of every so-many-th row of a run with the actuators behind their motors; `commands`
    (n,) are of the rows that stand in it.
    """
    import polars as pl

    angles = np.rad2deg(run.euler)[::every]
    nu, position = np.asarray(run.nu)[::every], np.asarray(run.position)[::every]
    columns: dict[str, ArrayLike] = {"t_s": np.asarray(run.t)[::every]}
    columns |= dict(zip(("x_m", "y_m", "z_m"), position.T, strict=True))
    columns |= dict(zip(("roll_deg", "pitch_deg", "yaw_deg"), angles.T, strict=True))
    columns |= dict(zip(("u_m_s", "v_m_s", "w_m_s"), nu[:, :3].T, strict=True))
    columns |= dict(zip(("p_deg_s", "q_deg_s", "r_deg_s"), np.rad2deg(nu[:, 3:]).T, strict=True))
    columns |= {f"cmd.{name}": values for name, values in commands.items()}
    columns |= {f"meas.{name}": values[::every] for name, values in run.actuators.items()}
    return pl.DataFrame(columns)


def write_generated(table: pl.DataFrame, path: str | Path, origin: str, description: str = "") -> None:
    """Write a table as a CSV file whose first lines say that it was generated, and from what."""
    lines = [f"GENERATED by seatrial from {origin}: no vehicle was at sea.", *description.splitlines()]
    write_table(table, path, comments="".join(f"# {line}\n" for line in lines))


def _state(start: Mapping[str, float]) -> State:
    """State at the start, of the recipe's keys."""
    from seatrial._core import State

    return State(
        position=[0.0, 0.0, start["depth_m"]],
        attitude=np.deg2rad([start["roll_deg"], start["pitch_deg"], start["yaw_deg"]]),
        nu=[start["surge_m_s"], 0.0, 0.0, 0.0, 0.0, 0.0],
    )


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
        # A row holds until a later one sets the same actuator.
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
