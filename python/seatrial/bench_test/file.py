"""The bench file's format and the table of a recording: loads, commands, revolutions, voltage.

These models are the only owner of the format; unknown keys are refused with the nearest known name. The
column map is that of a trial (`seatrial.trial.columns`) with the load cell's columns besides, and with a
group's name after ``cmd.`` or ``meas.`` for all its actuators at once. Nothing is resampled: an empty cell
stays NaN. Held by ``tests/bench_test/test_bench_file.py`` and ``tests/bench_test/test_bench_records.py``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from seatrial.base import frames
from seatrial.base.arrays import Array
from seatrial.base.channels import ACTUATOR_UNITS, unit_factor
from seatrial.base.errors import CampaignError, TrialError, nearest
from seatrial.base.toml_file import (
    FolderName,
    Name,
    NotNegative,
    Number,
    Positive,
    Section,
    checked,
    tables,
    twice,
)
from seatrial.trial.columns import Source, columns_of, mapped, numbers
from seatrial.trial.recording import read_table
from seatrial.trial.table import time_base
from seatrial.vehicle.actuators import actuator_groups

if TYPE_CHECKING:
    import polars as pl

    from seatrial._core import Vehicle

SENSES = {
    "ahead": ("X", 1.0),
    "astern": ("X", -1.0),
    "starboard": ("Y", 1.0),
    "port": ("Y", -1.0),
    "down": ("Z", 1.0),
    "up": ("Z", -1.0),
}
"""Axis and sign of what a single cell measures, by the direction in which the vehicle pulls."""

Density = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=500.0, le=2000.0)]
"""kg/m3; the limits catch a density in g/cm3 or a specific gravity."""

Names = Annotated[tuple[Name, ...], Field(min_length=1)]


class _Driven(Section):
    """A recording and the actuators that were driven in it."""

    name: Name
    """Unique."""
    file: Name
    """Record; with a column ``t_s``, or without time: then every row is a steady operating point."""
    reader: str | None = None
    """As of all files, instead of its own."""
    columns: dict[str, Any] = Field(default_factory=dict)
    """Entries beside or instead of those of all files."""
    group: Name | None = None
    """Group that was driven; or ``actuators``."""
    actuators: Names | None = None
    """Actuators that were driven, where not a whole group."""

    @model_validator(mode="after")
    def _one_choice(self) -> _Driven:
        if (self.group is None) == (self.actuators is None):
            raise ValueError('give what was driven, either group = "NAME" or actuators = ["NAME", ...]')
        if (name := twice(self.actuators or ())) is not None:
            raise ValueError(f"actuators names {name!r} twice; name it once")
        return self


class SignOf(Section):
    """The column whose side of neutral is the sign of revolutions that were logged without one."""

    column: Name
    """Column of the recording, by its own name."""
    neutral: Number = 0.0
    """Above it revolutions are ahead, below astern."""


class Pull(_Driven):
    """A load-cell record."""

    axis: Annotated[str, Field(min_length=1)] | None = None
    """Axes of the load cell: columns ``load.X_n`` …, force of the vehicle on its tether in body axes; or
    ``direction``."""
    direction: Literal["ahead", "astern", "starboard", "port", "down", "up"] | None = None
    """Where a single cell over pulleys is pulled: column ``load_n``, positive."""
    use: Literal["command", "measured"] = "command"
    """Thrust over the command behind the motor's limits, or over logged revolutions (``meas.…``)."""
    sign_of: SignOf | None = None
    """For revolutions logged without sign."""
    tare: Annotated[bool, Field(strict=True)] | None = None
    """Subtract the mean load of the plateaus at zero signal; by default where there are rests."""
    settle_s: NotNegative = 2.0
    """Time after a change of the command that is left out, s."""
    voltage_v: Positive | None = None
    """Supply voltage, V, where no column ``voltage_v`` gives it."""

    @model_validator(mode="after")
    def _one_cell(self) -> Pull:
        if (self.axis is None) == (self.direction is None):
            raise ValueError(
                'give the load, either axis = "X" (columns load.X_n ..., body axes) or, for a single cell'
                ' (column load_n), direction = "ahead"'
            )
        for letter in self.axis or "":
            if letter not in "XYZ" or (self.axis or "").count(letter) > 1:
                raise ValueError(f"axis holds letters of XYZ, each once, found {self.axis!r}")
        if self.sign_of is not None and self.use != "measured":
            raise ValueError('sign_of gives measured revolutions their sign; it needs use = "measured"')
        return self


class Regression(Section):
    """The model of the characteristic. What is absent in a group's own is that of all groups."""

    order: Literal[1, 2, 3, "square", "points"] | None = None
    """Polynomial per direction, thrust per n|n|, or a table of the points themselves; by default 2."""
    through_origin: Annotated[bool, Field(strict=True)] | None = None
    """Without a constant: no signal, no thrust; by default false."""
    inputs: tuple[Literal["signal", "voltage"], ...] | None = None
    """What thrust depends on; with the voltage all products up to the order; by default ``["signal"]``."""
    outliers: Literal["drop", "keep"] | None = None
    """Left out or kept, and named in either case; by default ``"drop"``."""
    kind: Literal["quadratic", "polynomial", "table"] | None = None
    """Kind of characteristic that is written; quadratic for ``"square"`` of revolutions, table for order
    3, points and voltage, polynomial otherwise."""
    knots: Annotated[int, Field(strict=True, ge=4)] | None = None
    """Most signals of a table of points; by default 25."""
    tolerance_n: Positive | None = None
    """Error at which a table of points gets no further knot, N; a quarter of it at rest; by default 1 %
    of the largest thrust."""
    table_voltage_v: Annotated[tuple[Positive, ...], Field(min_length=1)] | None = None
    """Voltages of the table of a fitted surface; by default six over the tested ones."""

    @model_validator(mode="after")
    def _consistent(self) -> Regression:
        if self.inputs is not None and self.inputs not in (("signal",), ("signal", "voltage")):
            raise ValueError('inputs is ["signal"] or ["signal", "voltage"]')
        if self.order == "points" and self.kind not in (None, "table"):
            raise ValueError('order = "points" makes a table; leave kind out')
        if self.order == "square" and self.with_voltage:
            raise ValueError('order = "square" knows the signal only; use order = 2, or inputs = ["signal"]')
        if self.kind == "quadratic" and self.order not in (None, "square"):
            raise ValueError('kind = "quadratic" is thrust per n|n|; it needs order = "square"')
        if self.kind in ("quadratic", "polynomial") and self.with_voltage:
            raise ValueError(f'kind = "{self.kind}" knows no voltage; use kind = "table"')
        if self.kind == "polynomial" and self.order == 3:
            raise ValueError('kind = "polynomial" ends at order 2, found 3; use kind = "table"')
        return self

    @property
    def with_voltage(self) -> bool:
        """Whether the supply voltage is an input."""
        return self.inputs is not None and "voltage" in self.inputs


class Steps(_Driven):
    """A record of commanded and measured revolutions, for the motor's dynamics."""


_DEFAULT = Regression(
    order=2, through_origin=False, inputs=("signal",), outliers="drop", knots=25, tolerance_n=None
)
"""What holds where a bench file says nothing."""


class BenchFile(Section):
    """The whole file."""

    file_kind = "a bench file"

    format: Literal[1]
    """Version of the format: 1."""
    name: FolderName
    """Name of the test and, under ``runs/bench-``, of its results."""
    vehicle: Name
    """Built-in name or path of a vehicle file."""
    description: str = ""
    """What was tested, where."""
    rho_kg_m3: Density | None = None
    """Density of the water of the test; thrust is converted to the vehicle's; by default the vehicle's."""
    reader: str | None = None
    """A reader of read a log, or ``generated``; for all files; by default by file ending."""
    columns: dict[str, Any] = Field(default_factory=dict)
    """Column map of all files."""
    pulls: tuple[Pull, ...] = ()
    """Load-cell records."""
    steps: tuple[Steps, ...] = ()
    """Records of commanded and measured revolutions."""
    regression: Regression = Regression()
    """How all groups are fitted."""
    regressions: dict[str, Regression] = Field(default_factory=dict)
    """How one group is fitted, where it differs; actuators tested alone are called ``SbU`` or ``SbU+PL``."""

    @model_validator(mode="after")
    def _something(self) -> BenchFile:
        if not (self.pulls or self.steps):
            raise ValueError("holds no test; add [[pulls]] (load cell) or [[steps]] (revolutions)")
        for kind, entries in (("pulls", self.pulls), ("steps", self.steps)):
            if (name := twice(entry.name for entry in entries)) is not None:
                raise ValueError(f"two {kind} are called {name!r}; rename one")
        return self

    def regression_of(self, unit: str) -> Regression:
        """Regression of a group, or of actuators tested alone, by name; nothing is None but ``kind``."""
        return self.regressions.get(unit, Regression()).over(self.regression.over(_DEFAULT))


def parse(text: str, source: str) -> BenchFile:
    """Bench file from its text; a `CampaignError` lists all that is wrong in it."""
    return checked(BenchFile, tables(text, source), source)


_LOADS = ("load.X_n", "load.Y_n", "load.Z_n")

_SINGLE = "load_n"


@dataclass(frozen=True)
class BenchTable:
    """Columns (n,) of a recording; NaN where a cell is empty.

    `t` in s; None where every row is one operating point. `commands` and `measured` per actuator in its
    command's unit, as logged; `loads` in N by axis, force of the vehicle on its tether in body axes, by
    ``""`` a single cell's. `frame`: the whole table, `file` what to call it.
    """

    file: str
    t: Array | None
    commands: Mapping[str, Array]
    measured: Mapping[str, Array]
    loads: Mapping[str, Array]
    voltage_v: Array | None
    frame: pl.DataFrame

    def column(self, name: str, where: str) -> Array:
        """Column (n,) by the recording's own name."""
        if name not in self.frame.columns:
            raise TrialError(
                f'{where}: there is no column "{name}" in {self.file}{nearest(name, self.frame.columns)}'
            )
        return numbers(self.frame[name], name, self.file)


def read_bench_table(
    path: Path, vehicle: Vehicle, *, reader: str | None = None, columns: Mapping[str, Any] | None = None
) -> BenchTable:
    """Table of a bench recording; the vehicle gives the names of actuators and groups. `reader` is as in
    `seatrial.trial.recording.read_table`, `columns` ``{canonical: "column"}`` or ``{canonical: {from,
    unit, sign, frame}}``.
    """
    read = read_table(path, reader, columns_of(columns))
    table, file = read.table, read.file
    if table.height == 0:
        raise TrialError(f"{file}: expected rows of samples, found the header only")
    sources = _sources(table.columns, columns or {}, vehicle, file)
    read.refuse_twice(source.column for source in sources.values())
    t = time_base(table, sources["t_s"], file) if "t_s" in sources else None
    supply = sources.get("voltage_v")
    return BenchTable(
        file=file,
        t=t,
        commands=_per_actuator(table, sources, "cmd.", file),
        measured=_per_actuator(table, sources, "meas.", file),
        loads=_loads(table, sources, file),
        voltage_v=_scalar(table, supply, "voltage_v", ("V",), file) if supply else None,
        frame=table,
    )


def _sources(
    present: list[str], columns: Mapping[str, Any], vehicle: Vehicle, file: str
) -> dict[str, Source]:
    """Source by canonical name; groups resolved to their actuators."""
    known = ["t_s", "voltage_v", _SINGLE, *_LOADS]
    members = actuator_groups(vehicle) | {name: [name] for name in vehicle.actuators}
    known += [f"{kind}.{name}" for kind in ("cmd", "meas") for name in members]
    given = {name: Source(name) for name in present if name in known}
    for canonical, entry in columns.items():
        if canonical not in known:
            raise TrialError(
                f'{file}: column map: "{canonical}" is no column of a bench test{nearest(canonical, known)}'
            )
        given[canonical] = mapped(canonical, entry, present, file)
    sources: dict[str, Source] = {}
    for canonical, source in given.items():
        kind, dot, name = canonical.partition(".")
        if kind in ("cmd", "meas") and dot:
            for actuator in members[name]:
                # An actuator's own column goes before that of its group.
                if name == actuator or f"{kind}.{actuator}" not in sources:
                    sources[f"{kind}.{actuator}"] = source
        else:
            sources[canonical] = source
    return sources


def _per_actuator(
    table: pl.DataFrame, sources: Mapping[str, Source], prefix: str, file: str
) -> dict[str, Array]:
    return {
        canonical.removeprefix(prefix): _scalar(table, source, canonical, ACTUATOR_UNITS, file)
        for canonical, source in sources.items()
        if canonical.startswith(prefix)
    }


def _scalar(table: pl.DataFrame, source: Source, canonical: str, units: tuple[str, ...], file: str) -> Array:
    if source.frame:
        raise TrialError(f"{file}: {canonical}: a scalar has no frame; leave it out")
    return _scaled(table, source, canonical, units, file)


def _scaled(table: pl.DataFrame, source: Source, canonical: str, units: tuple[str, ...], file: str) -> Array:
    scale = unit_factor(source.unit, units, f"{file}: {canonical}") if source.unit else 1.0
    return np.asarray(numbers(table[source.column], canonical, file) * scale * source.sign)


def _loads(table: pl.DataFrame, sources: Mapping[str, Source], file: str) -> dict[str, Array]:
    """Loads by axis; a frame may turn signs of single axes (FLU), mixing axes is refused."""
    loads: dict[str, Array] = {}
    for row, canonical in enumerate(_LOADS):
        if canonical in sources:
            source = sources[canonical]
            turn = frames.body_matrix(source.frame or "FRD", f"{file}: {canonical}")
            loads["XYZ"[row]] = _scaled(table, source, canonical, ("N",), file) * turn[row, row]
    if _SINGLE in sources:
        loads[""] = _scalar(table, sources[_SINGLE], _SINGLE, ("N",), file)
    return loads


def listed(names: Iterable[str]) -> str:
    """Names for a message, or "none"."""
    return ", ".join(names) or "none"


@dataclass(frozen=True)
class Unit:
    """Actuators that share one characteristic in this test: a group, or some that are named, joined by ``+``,
    in the vehicle's order; and the unit of their command: rpm, us or N.
    """

    name: str
    actuators: tuple[str, ...]
    command: str


def unit_of(vehicle: Vehicle, group: str | None, actuators: Sequence[str] | None, where: str) -> Unit:
    """Unit of a group or of named actuators; a `CampaignError` that begins with `where` for any that are
    none.
    """
    facts = vehicle.actuator_info()
    thrusters = [name for name in vehicle.actuators if facts[name]["kind"] == "thruster"]
    members_of = {
        name: [member for member in members if member in thrusters]
        for name, members in actuator_groups(vehicle).items()
    }
    groups = {name: members for name, members in members_of.items() if members}
    if group is not None:
        if group not in groups:
            raise CampaignError(f"{where}, key group: unknown group {group!r}{nearest(group, groups)}")
        members = groups[group]
    else:
        for name in actuators or ():
            if name not in thrusters:
                raise CampaignError(
                    f"{where}, key actuators: unknown thruster {name!r}{nearest(name, thrusters)}"
                )
        members = [name for name in thrusters if name in (actuators or ())]
    units = {str(facts[name]["unit"]) for name in members}
    if len(units) > 1:
        raise CampaignError(
            f"{where}: {', '.join(members)} are commanded in different units ({', '.join(sorted(units))});"
            " test those of each unit on their own"
        )
    # Actuators that make up a group bear its name, so that results of both kinds meet.
    whole = next((name for name, own in groups.items() if own == members), None)
    return Unit(whole or "+".join(members), tuple(members), units.pop())
