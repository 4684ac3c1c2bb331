"""Truth vehicles, and the missions that they sail: what makes generated trials.

A truth file names a vehicle, factors on its coefficients or values instead of them, and the sensors that it
carries. Held by ``tests/sensors/test_sensors.py`` and ``tests/trial/test_truth.py``.

The table ``[sailed]`` of a recipe names autopilot and mission; the truth vehicle flies it in closed loop
(`seatrial.flight`), through waves and a current that changes. What its instruments would have logged of the
flight is then sampled as for any generated trial. The autopilot steers by instruments of the same kinds,
whose errors are sampled apart from those of the log. Held by ``tests/trial/test_sailed.py``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from seatrial.base.arrays import Array
from seatrial.base.errors import SeatrialError, TrialError, VehicleError, first_line, nearest
from seatrial.base.toml_file import Name, NotNegative, Number, Positive, Section
from seatrial.flight.conditions import Conditions, Water
from seatrial.flight.disturbances import SeaState
from seatrial.flight.flight import fly
from seatrial.flight.mission import Mission
from seatrial.sensors.log import at_sea
from seatrial.sensors.sensor import TYPICAL, Sensor, SensorFile, parse_sensors, read_as

if TYPE_CHECKING:
    from seatrial._core import Autopilot, State, Vehicle
    from seatrial.flight.flight import Flight


class TruthFile(SensorFile):
    """A truth vehicle: factors on, or values instead of, coefficients, and its sensors.

    ``vehicle_file`` holds tables that replace entries of the vehicle's file first, for what is no coefficient
    (limits of a motor).
    """

    file_kind = ""  # it need not have a key that tells it from a set of sensors

    vehicle: Name
    vehicle_file: dict[str, Any] = Field(default_factory=dict)
    factors: dict[str, Number] = Field(default_factory=dict)
    values: dict[str, Number] = Field(default_factory=dict)


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
        """Truth vehicle from its file: a built-in vehicle, or a file beside it, with other coefficients.

        Raises
        ------
        TrialError
            The file cannot be read, has unknown keys or names an unknown sensor.
        VehicleError
            The vehicle or a coefficient is unknown, or their values are impossible.
        """
        from seatrial._core import Vehicle

        path = Path(path)
        file = read_as(TruthFile, path)
        beside = file.vehicle.endswith(".toml")
        try:
            base = Vehicle.load(path.parent / file.vehicle if beside else file.vehicle)
        except VehicleError as error:
            raise VehicleError(f"{path}: key vehicle: {error}") from None
        if file.vehicle_file:
            base = _overlaid(base, file.vehicle_file, str(path))
        known = base.coefficients()
        for name in file.factors:
            if name not in known:
                raise VehicleError(f"{path}: factors: unknown coefficient {name!r}{nearest(name, known)}")
        changed = {name: factor * known[name] for name, factor in file.factors.items()} | file.values
        sensors = parse_sensors(file.sensors, str(path))
        return cls(file.description, base.with_coefficients(changed), base, tuple(changed), sensors)


def _overlaid(vehicle: Vehicle, tables: Mapping[str, Any], where: str) -> Vehicle:
    """The vehicle with tables put over those of its file."""
    import tomlkit

    from seatrial._core import Vehicle

    def over(below: dict[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
        merged = dict(below)
        for key, value in above.items():
            known = merged.get(key)
            merged[key] = (
                over(known, value) if isinstance(known, dict) and isinstance(value, Mapping) else value
            )
        return merged

    below = vehicle.to_dict()
    for kind in ("motors", "characteristics"):
        own, new = below.get(kind, {}), tables.get(kind)
        for name in new if isinstance(new, Mapping) else ():
            # A table that no actuator names would change nothing; what may name it is in arrays.
            if name not in own and not tables.keys() & {"thrusters", "fins"}:
                raise TrialError(
                    f"{where}: vehicle_file, {kind}: the vehicle {vehicle.name} has no {name!r}"
                    f"{nearest(name, own)}"
                )
    text = tomlkit.dumps(over(below, tables))
    return Vehicle.from_toml(text, f"{where}: vehicle_file")


DITHER = "dither."
"""Columns of a dither, before the actuator's name."""

OWN, PERFECT = "truth", "perfect"
"""Sensors that the autopilot steers by: those of the truth file, or such without error."""

_HOUR_S = 3600.0  # in which a mission counts the change of its current

_TICK = 1e-6  # s, and share of a ratio: rounding of times


class SailedTable(Section):
    """What sails the trial: an autopilot on a mission, by file or built-in name, and what it steers by."""

    autopilot: Name
    mission: Name
    sensors: Name = OWN
    dither: Name | None = None


class WavesTable(Section):
    """The sea that the vehicle meets."""

    height_m: NotNegative
    period_s: Positive
    toward_deg: Number = 0.0
    spreading_deg: NotNegative = 0.0
    peakedness: Positive = 3.3


class Current(Section):
    """Current over ground, NED: where the trial begins; the rest needs an autopilot.

    ``end_…`` is what it has grown to at the end of ``duration_s``, steadily; ``walk_m_s`` the standard
    deviation after an hour of a random walk, ``turbulence_m_s`` that of turbulence, both north and east.
    """

    north_m_s: Number = 0.0
    east_m_s: Number = 0.0
    down_m_s: Number = 0.0
    end_north_m_s: Number | None = None
    end_east_m_s: Number | None = None
    end_down_m_s: Number | None = None
    walk_m_s: NotNegative = 0.0
    turbulence_m_s: NotNegative = 0.0
    turbulence_times_s: Annotated[tuple[Positive, Positive], Field()] = (60.0, 2.0)

    @property
    def at_start(self) -> Array:
        """Velocity at the beginning (3,), m/s."""
        return np.array([self.north_m_s, self.east_m_s, self.down_m_s])

    @property
    def change(self) -> Array:
        """Steady change until the end (3,), m/s."""
        ends = (self.end_north_m_s, self.end_east_m_s, self.end_down_m_s)
        start = self.at_start
        return np.array([0.0 if end is None else end - start[axis] for axis, end in enumerate(ends)])

    @property
    def varies(self) -> bool:
        """Whether it is anything but steady."""
        return bool(self.change.any()) or self.walk_m_s > 0.0 or self.turbulence_m_s > 0.0


@dataclass(frozen=True)
class Sailed:
    """How a trial is sailed."""

    where: str  #: The recipe, for messages.
    #: The vehicle that sails; the autopilot believes in the one that the truth file starts from.
    truth: Truth
    #: What steers, and where to.
    autopilot: Autopilot
    mission: Mission
    #: What it steers by: {kind: sensor}, "typical", a path, or None for perfect ones.
    sensors: Mapping[str, Sensor] | str | Path | None
    #: The water.
    current: Current
    waves: SeaState | None
    initial: State | None  #: Where it begins; None: at rest at the mission's start.
    #: Longest duration and rate of the log.
    duration_s: float
    rate_hz: float
    #: As of any recipe.
    bottom_depth_m: float | None
    voltage_v: float | None
    #: ``times``, s, and what is added to the commands from each of them on; None: nothing.
    dither: Mapping[str, Array] | None = None

    @classmethod
    def of(
        cls, table: SailedTable, path: Path, truth: Truth, *, waves: WavesTable | None, **rest: Any
    ) -> Sailed:
        """Sailed trial of a recipe; files are relative to it."""
        from seatrial._core import Autopilot

        def beside(name: str) -> str | Path:
            return path.parent / name if name.endswith(".toml") else name

        with _said(f"{path}: sailed, key autopilot"):
            autopilot = Autopilot.load(beside(table.autopilot))
        with _said(f"{path}: sailed, key mission"):
            mission = Mission.load(beside(table.mission))
        with _said(f"{path}: waves"):
            sea = None if waves is None else SeaState(**waves.model_dump())
        sensors: Mapping[str, Sensor] | str | Path | None = at_sea(truth.sensors)
        if table.sensors != OWN:
            sensors = None if table.sensors == PERFECT else beside(table.sensors)
        if isinstance(sensors, str) and sensors != TYPICAL:
            raise TrialError(
                f'{path}: sailed, key sensors: expected "{OWN}", "{PERFECT}", "{TYPICAL}" or a file that ends'
                f" in .toml, found {sensors!r}"
            )
        dither = None
        if table.dither is not None:
            dither = read_dither(path.parent / table.dither, truth.vehicle, f"{path}: sailed, key dither")
        return cls(str(path), truth, autopilot, mission, sensors, waves=sea, dither=dither, **rest)

    def fly(self, seed: int) -> Flight:
        """Flight of the truth vehicle with this seed of waves, current and sensors' errors."""
        water = self.current
        with _said(self.where):
            flight = fly(
                self.truth.vehicle,
                self.autopilot,
                self.mission,
                conditions=Conditions(
                    model=self.truth.base,
                    sensors=self.sensors,
                    initial=self.initial,
                    voltage_v=self.voltage_v,
                    max_time_s=self.duration_s,
                    dither=self.dither,
                ),
                water=Water(
                    current=water.at_start,
                    current_trend=water.change * (_HOUR_S / self.duration_s),
                    current_walk=water.walk_m_s,
                    turbulence=water.turbulence_m_s,
                    turbulence_times_s=water.turbulence_times_s,
                    waves=self.waves,
                    seabed=self.bottom_depth_m,
                ),
                seed=seed,
            )
        if flight.diverged:
            raise TrialError(
                f"{self.where}: the flight diverges after {flight.t[-1]:.0f} s; check autopilot, sensors,"
                " waves and the truth's coefficients with seatrial fly"
            )
        return flight

    def added(self, t: Array) -> dict[str, Array]:
        """Dither by actuator at times (n,), s, in the unit of its command; empty without one."""
        if self.dither is None:
            return {}
        begun = np.searchsorted(self.dither["times"], t + _TICK, side="right")
        return {
            name: np.concatenate([[0.0], values])[begun]
            for name, values in self.dither.items()
            if name != "times"
        }

    def every(self, flight: Flight) -> int:
        """Control periods per row of the log."""
        ratio = 1.0 / (self.rate_hz * flight.period_s)
        if round(ratio) < 1 or abs(ratio - round(ratio)) > _TICK * ratio:
            raise TrialError(
                f"{self.where}: key rate_hz: expected that of the autopilot, {1.0 / flight.period_s:g} Hz, or"
                f" a whole fraction of it, found {self.rate_hz:g}"
            )
        return round(ratio)


def read_dither(path: Path, vehicle: Vehicle, where: str) -> dict[str, Array]:
    """Dither from a table of ``t_s`` and ``dither.ACTUATOR``, as `seatrial plan` writes it: ``times``, s, and
    by actuator what is added to its command, in its unit.
    """
    import polars as pl

    try:
        table = pl.read_csv(path, comment_prefix="#", infer_schema_length=None)
    except (OSError, pl.exceptions.PolarsError) as error:
        raise TrialError(
            f"{where}: {path} cannot be read ({first_line(error)}); name a table (CSV) of t_s and"
            f" {DITHER}ACTUATOR, as seatrial plan writes it"
        ) from None
    facts = vehicle.actuator_info()
    known = ["t_s", *(DITHER + name for name in facts)]
    for column in table.columns:
        if column not in known:
            raise TrialError(f'{where}: {path}: unknown column "{column}"{nearest(column, known)}')
    if "t_s" not in table.columns or table.width < 2 or table.height == 0:
        raise TrialError(
            f"{where}: {path}: expected columns t_s and {DITHER}ACTUATOR with at least one row, found"
            f" {', '.join(table.columns) or 'none'}"
        )
    columns: dict[str, Array] = {}
    for column in table.columns:
        cells = table[column]
        if not cells.dtype.is_numeric() or cells.is_null().any() or not np.isfinite(cells.to_numpy()).all():
            raise TrialError(f"{where}: {path}, column {column}: expected finite numbers; fill the gaps")
        columns[column.removeprefix(DITHER)] = cells.to_numpy().astype(float)
    times = columns.pop("t_s")
    if np.any(np.diff(times) <= 0.0):
        row = int(np.argmax(np.diff(times) <= 0.0)) + 2
        raise TrialError(f"{where}: {path}, row {row}: expected a t_s above that of the row before")
    for name, values in columns.items():
        most = max(facts[name]["maximum_ahead"], facts[name]["maximum_astern"])
        largest = float(np.abs(values).max())
        if largest > most:
            raise TrialError(
                f"{where}: {path}, column {DITHER}{name}: expected at most {most:g}"
                f" {facts[name]['unit']}, the actuator's range, found {largest:g}"
            )
    return {"times": times, **columns}


@contextmanager
def _said(where: str) -> Iterator[None]:
    """Errors inside, as one of the trial, begun with where it was."""
    try:
        yield
    except SeatrialError as error:
        raise TrialError(f"{where}: {error}") from None
