"""Generated trials: recordings that no vehicle made, from a recipe that says how.

A recipe is a TOML file: a truth vehicle with its sensors (a second file, shared by the recipes of a
campaign), the commands over time, a seed. The same recipe gives the same table. The reader "generated" turns
it into a table like that of any log, so that a recipe stands in a campaign where a recording would.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, ValidationError

from seatrial.campaign_file import Name, Number, Positive, Section
from seatrial.errors import TrialError, VehicleError, nearest
from seatrial.sensors import Sensor, measure

if TYPE_CHECKING:
    import polars as pl

    from seatrial._core import Run, Vehicle

__all__ = ["Recipe", "Truth"]

Array = NDArray[np.float64]

_STEP_S = 0.01


class _TruthFile(Section):
    """The file of a truth vehicle: factors on, or values instead of, coefficients; sensors by kind."""

    format: Literal[1]
    vehicle: Name
    description: str = ""
    factors: dict[str, Number] = Field(default_factory=dict)
    values: dict[str, Number] = Field(default_factory=dict)
    sensors: dict[str, dict[str, Any]] = Field(default_factory=dict)


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


class _RecipeFile(Section):
    """The file of a generated trial."""

    format: Literal[1]
    description: str
    truth: Name
    seed: Annotated[int, Field(strict=True, ge=0)]
    duration_s: Positive
    rate_hz: Positive = 10.0
    initial: _Initial = _Initial()
    current: _Current = _Current()
    commands: tuple[dict[str, Number], ...] = ()


@dataclass(frozen=True)
class Truth:
    """A truth vehicle: the one behind generated trials, and the sensors that it carries."""

    description: str
    vehicle: Vehicle
    base: Vehicle
    changed: tuple[str, ...]
    sensors: Mapping[str, Sensor]

    @property
    def sailed(self) -> tuple[str, Mapping[str, Sensor]]:
        """What makes two truths the same one: the vehicle's file and the sensors."""
        return self.vehicle.to_toml(), self.sensors

    @classmethod
    def load(cls, path: str | Path) -> Truth:
        """Truth vehicle from its file: a built-in vehicle, or one beside it, with other coefficients.

        Raises
        ------
        TrialError
            The file cannot be read, has unknown keys or names an unknown sensor.
        VehicleError
            The vehicle or a coefficient is unknown, or their values are impossible.
        """
        from seatrial._core import Vehicle

        path = Path(path)
        file = _parse(path, _TruthFile)
        beside = file.vehicle.endswith(".toml")
        base = Vehicle.load(path.parent / file.vehicle if beside else file.vehicle)
        known = base.coefficients()
        for name in file.factors:
            if name not in known:
                raise VehicleError(f"{path}: factors: unknown coefficient {name!r}{nearest(name, known)}")
        changed = {name: factor * known[name] for name, factor in file.factors.items()} | file.values
        sensors = {kind: Sensor.parse(kind, table, str(path)) for kind, table in file.sensors.items()}
        return cls(file.description, base.with_coefficients(changed), base, tuple(changed), sensors)


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
        Steady current (3,), NED, m/s; the log does not tell it.
    """

    path: Path
    description: str
    seed: int
    truth: Truth
    t: Array
    commands: Mapping[str, Array]
    initial: Mapping[str, float]
    current: Array

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
            The recipe or its truth file cannot be read, or names an actuator that the vehicle has not.
        """
        path = Path(path)
        file = _parse(path, _RecipeFile)
        if truth is None:
            truth = Truth.load(path.parent / file.truth)
        t = np.arange(round(file.duration_s * file.rate_hz)) / file.rate_hz
        commands = _commands(file.commands, truth.vehicle, t, str(path))
        current = np.array([file.current.north_m_s, file.current.east_m_s, file.current.down_m_s])
        initial = file.initial.model_dump()
        return cls(path, file.description, file.seed, truth, t, commands, initial, current)

    def run(self) -> Run:
        """What the truth vehicle really did."""
        from seatrial._core import State

        start = self.initial
        state = State(
            position=[0.0, 0.0, start["depth_m"]],
            attitude=np.deg2rad([start["roll_deg"], start["pitch_deg"], start["yaw_deg"]]),
            nu=[start["surge_m_s"], 0.0, 0.0, 0.0, 0.0, 0.0],
        )
        commands: dict[str, ArrayLike] = dict(self.commands)
        return self.truth.vehicle.simulate(self.t, commands, state, self.current, max_step=_STEP_S)

    def table(self, *, run: Run | None = None, seed: int | None = None) -> pl.DataFrame:
        """What its sensors logged, with canonical columns, and the commands.

        Parameters
        ----------
        run : Run, optional
            An earlier result of `run`, which no seed changes.
        seed : int, optional
            Seed of the sensors' noise and biases; by default the recipe's.
        """
        import polars as pl

        sailed = self.run() if run is None else run
        logged = measure(sailed, self.truth.sensors, seed=self.seed if seed is None else seed)
        return logged.with_columns(pl.Series(f"cmd.{name}", y) for name, y in self.commands.items())

    def write_csv(self, path: str | Path) -> None:
        """Write the table as a CSV file whose first lines say that it was generated, and from what.

        Raises
        ------
        TrialError
            The file cannot be written.
        """
        label = (
            f"# GENERATED by seatrial from {self.path.name}, seed {self.seed}: no vehicle was at sea.\n"
            f"# {self.description}\n"
        )
        try:
            with Path(path).open("wb") as stream:
                stream.write(label.encode())
                self.table().write_csv(stream)
        except OSError as error:
            raise TrialError(f"{path}: cannot be written ({error.strerror}); choose another place") from None


def _commands(rows: tuple[dict[str, float], ...], vehicle: Vehicle, t: Array, where: str) -> dict[str, Array]:
    """Commands (n,) of every actuator; a row sets groups or actuators from its ``t_s`` on."""
    facts = vehicle.actuator_info()
    members = {name: [name] for name in vehicle.actuators}
    for name in vehicle.actuators:
        members.setdefault(str(facts[name]["group"]), []).append(name)
    commands = {name: np.full(len(t), float(facts[name]["neutral"])) for name in vehicle.actuators}
    last = -np.inf
    for number, row in enumerate(rows, 1):
        place = f"{where}: commands[{number}]"
        start = row.get("t_s")
        if start is None or start < last:
            raise TrialError(
                f"{place}: expected t_s, s, not before the row above; found {start}; sort the rows"
            )
        last = start
        for name, value in row.items():
            if name == "t_s":
                continue
            if name not in members:
                raise TrialError(f'{place}: unknown actuator or group "{name}"{nearest(name, members)}')
            for actuator in members[name]:
                commands[actuator][t >= start - 1e-9] = value
    return commands


_File = TypeVar("_File", bound=Section)


def _parse(path: Path, model: type[_File]) -> _File:
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise TrialError(
            f"{path}: not readable as the file of a generated trial ({error}); check the path"
        ) from None
    except tomllib.TOMLDecodeError as error:
        raise TrialError(f"{path}: not a TOML file: {error}") from None
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise TrialError("\n".join(f"{path}: {_complaint(detail)}" for detail in error.errors())) from None


def _complaint(detail: Any) -> str:
    place = ", ".join(str(part) for part in detail["loc"]) or "the file"
    return f"{place}: {str(detail['msg']).removeprefix('Value error, ')}"
