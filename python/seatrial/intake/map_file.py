"""The map of an import (map.toml): which field of the logs is which column of a trial, and its clock.

Columns and actuators have the entries of a campaign's column map, with ``topic.field`` as their source,
and two more keys: `why` for the reader of the file, and `convert` for what is more than a unit. This model is
the only owner of the format. Held by ``tests/intake/test_import_map.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from seatrial.base.channels import ACTUATOR_UNITS, unit_factor
from seatrial.base.errors import TrialError, nearest
from seatrial.base.plain import Plain
from seatrial.base.toml_file import Name, Number, Section, checked, tables, text_of
from seatrial.logs.join import Clock
from seatrial.trial.columns import GROUPS, check_canonical, source_of

CONVERSIONS = {
    "latitude": "x_m",
    "longitude": "y_m",
    "pressure": "z_m",
    "north": "u_m_s",
    "east": "v_m_s",
    "down": "w_m_s",
}
"""Conversions by name and the column that each gives."""


@dataclass(frozen=True)
class Column(Plain, only="from=source unit frame sign convert why certain"):
    """One column of a trial: the field it comes from, as a column map states it, and how sure that is."""

    source: str  #: ``topic.field`` or ``topic.field/other``.
    #: As in a column map; "" and 1 for those of the canonical column.
    unit: str = ""
    frame: str = ""
    sign: int = 1
    convert: str = ""  #: A key of `CONVERSIONS`; "" for none.
    why: str = ""  #: What it was told from.
    certain: bool = True  #: Whether the log documents it.

    def entry(self, name: str) -> dict[str, Any]:
        """Entry of a campaign's column map for the column `name` of a recording."""
        given: dict[str, Any] = {"from": name}
        given |= {key: value for key, value in (("unit", self.unit), ("frame", self.frame)) if value}
        return given | ({"sign": self.sign} if self.sign != 1 else {})


class MapClock(Section):
    """Reading of a file's clock at the time zero of the first file's, and by how much faster it runs."""

    offset_s: Number = 0.0
    drift: Number = 0.0


class MapTrial(Section):
    """A recording: its files, and from when to when it is used, s."""

    logs: tuple[Name, ...] = ()
    start_s: Number | None = None
    stop_s: Number | None = None

    @model_validator(mode="after")
    def _forwards(self) -> MapTrial:
        if self.start_s is not None and self.stop_s is not None and self.start_s >= self.stop_s:
            raise ValueError(
                f"start_s = {self.start_s:g} is not before stop_s = {self.stop_s:g}; exchange or correct them"
            )
        return self


class MapFile(Section):
    """The whole file."""

    format: Literal[1]
    columns: dict[str, Any] = Field(default_factory=dict)
    actuators: dict[str, Any] = Field(default_factory=dict)
    clocks: dict[str, MapClock] = Field(default_factory=dict)
    trials: dict[str, MapTrial] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _some_column(self) -> MapFile:
        if not self.columns:
            raise ValueError('columns is missing; add [columns], for example yaw_deg = "ATT.Yaw"')
        return self


@dataclass(frozen=True)
class ImportMap:
    """A map ready to use: columns by canonical name (actuators as cmd.<actuator>), clocks, trials."""

    source: str
    columns: Mapping[str, Column]
    clocks: Mapping[str, Clock]
    trials: Mapping[str, MapTrial]


def load_map(path: str | Path) -> ImportMap:
    """Map of an import from its file."""
    return parse_map(text_of(path, "a map of an import", error=TrialError), str(path))


def parse_map(text: str, source: str) -> ImportMap:
    """Map of an import from its text; `source` is what messages call it.

    Examples
    --------
    >>> made = parse_map('format = 1' + chr(10) + 'columns = { z_m = "nav.depth" }', "map.toml")
    >>> made.columns["z_m"].source
    'nav.depth'
    """
    file = checked(MapFile, tables(text, source, error=TrialError), source, error=TrialError)
    columns = {}
    for canonical, entry in file.columns.items():
        if canonical.startswith("cmd."):
            raise TrialError(
                f'{source}: columns, key "{canonical}": expected a measured column; commands stand under'
                f" [actuators]: {canonical.removeprefix('cmd.')} = ..."
            )
        columns[canonical] = _column(canonical, entry, f"{source}: columns, key {canonical}", source)
    for name, entry in file.actuators.items():
        where = f"{source}: actuators, key {name}"
        columns[f"cmd.{name}"] = _column(f"cmd.{name}", entry, where, source)
    clocks = {name: Clock(clock.offset_s, clock.drift) for name, clock in file.clocks.items()}
    return ImportMap(source, columns, clocks, file.trials)


def _column(canonical: str, entry: Any, where: str, source: str) -> Column:
    if canonical == "t_s":
        raise TrialError(f"{where}: the time comes with every topic; remove this key")
    check_canonical(canonical, source)
    given = dict(entry) if isinstance(entry, Mapping) else {"from": entry}
    why, convert = given.pop("why", ""), given.pop("convert", "")
    if not isinstance(why, str):
        raise TrialError(f"{where}: why: expected text in quotes, found {why!r}")
    if convert and convert not in CONVERSIONS:
        raise TrialError(
            f"{where}: convert: unknown conversion {convert!r}{nearest(str(convert), CONVERSIONS)}"
        )
    if convert and CONVERSIONS[convert] != canonical:
        raise TrialError(f'{where}: convert: "{convert}" gives {CONVERSIONS[convert]}, not {canonical}')
    stated = source_of(given, where)
    if stated.unit and not convert:
        group = next((group for group in GROUPS if canonical in group.columns), None)
        own = ACTUATOR_UNITS if group is None else (group.unit or "dimensionless",)
        unit_factor(stated.unit, own, where)
    return Column(stated.column, stated.unit or "", stated.frame or "", int(stated.sign), convert, why)
