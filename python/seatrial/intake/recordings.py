"""Which logs make one recording, and the table of a recording as the trials of a project hold it.

The table is sparse: rows are all stamps, a cell is empty where its topic has no sample then, and columns keep
the names ``topic.field`` of the log, so that a campaign's column map shows where each comes from. Only what
more than a unit separates from a column is converted here: latitude, longitude and pressure.

The map of an import (map.toml) says which field of the logs is which column of a trial, and its clock.
Columns and actuators have the entries of a campaign's column map, with ``topic.field`` as their source, and
two more keys: `why` for the reader of the file, and `convert` for what is more than a unit. Held by
``tests/intake/test_import_map.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from seatrial.base.arrays import Array
from seatrial.base.channels import ACTUATOR_UNITS, unit_factor
from seatrial.base.errors import TrialError, nearest
from seatrial.base.files import file_name, free_name
from seatrial.base.frames import LocalFrame
from seatrial.base.plain import Plain
from seatrial.base.toml_file import Name, Number, Section, checked, tables, text_of
from seatrial.intake.survey import SurveyedLog, chosen
from seatrial.logs.join import Clock, Wanted, find_field, join
from seatrial.logs.log import Log, Note, listed, open_log
from seatrial.logs.recognise import of_estimator
from seatrial.trial.columns import GROUPS, check_canonical, parse, source_of
from seatrial.trial.signals import RecordingReport, linear
from seatrial.trial.table import signals

if TYPE_CHECKING:
    import polars as pl


@dataclass(frozen=True)
class IntakeSettings:
    """Which pressures are the surface's, how long a trial may be, which logs are parts of one dive."""

    surface_pa: tuple[float, float] = (8e4, 1.1e5)  #: Pa, pressures of the air at the surface
    #: Pa, ten centimetres of water: nobody dives less, so that smaller pressures have another unit
    least_pa: float = 1e3
    most_samples: int = 200_000  #: of a trial: a longer one is thinned
    least_rate_hz: float = 10.0  #: Hz that a thinned trial keeps: no vehicle that is steered shows more
    #: of the shorter of two logs by which they overlap as parts of one dive; the files of a logger that
    #: begins another one meet by less
    overlap_share: float = 0.1


INTAKE_SETTINGS = IntakeSettings()


_AIR_PA = 101_325.0  # standard atmosphere


_LARGER_UNITS = {"kPa": 1e3, "dbar": 1e4, "bar": 1e5}

_WATER_KG_M3, _GRAVITY_M_S2 = 1025.0, 9.81  # sea water, as the note says


_VELOCITY, _EARTH = ("u_m_s", "v_m_s", "w_m_s"), ("north", "east", "down")

_ATTITUDE = ("roll_deg", "pitch_deg", "yaw_deg", "q_w", "q_x", "q_y", "q_z")

_SHARED = ("voltage_v",)  # columns that logs of one recording may all have


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


@dataclass(frozen=True)
class Recording:
    """Logs of one time, by the name of the trial, and the part of it that is used."""

    name: str
    logs: tuple[SurveyedLog, ...]
    start_s: float | None = None
    stop_s: float | None = None


@dataclass(frozen=True)
class Recorded:
    """A recording as a table."""

    table: pl.DataFrame  #: Rows of all stamps, ``t_s`` and the columns of the log.
    #: Column map of a campaign for it; columns with canonical names need no entry.
    columns: dict[str, dict[str, Any]]
    clocks: dict[str, str]  #: By canonical column, the file whose clock stamped it.
    absent: tuple[str, ...]  #: Canonical columns whose field this recording has not.
    notes: tuple[Note, ...]  #: What the readers, the join and the conversions did or could not do.
    events: tuple[tuple[float, str], ...]  #: Changes of mode on the table's clock: time in s and name.


def recordings(logs: Sequence[SurveyedLog], given: Mapping[str, MapTrial] | None = None) -> list[Recording]:
    """Recordings by name: files that hold different channels are one, files that hold the same are several.

    Logs that share a clock (Unix time) and overlap are one recording in any case.
    """
    if given:
        return [_of_map(name, use, logs) for name, use in given.items()]
    made: list[Recording] = []
    for group in _dives(logs):
        folders = {log.path.resolve().parent for log in group}
        named = folders.pop().name if len(group) > 1 and len(folders) == 1 and len(group) == len(logs) else ""
        name = free_name(
            file_name(named or group[0].path.name.partition(".")[0]), [recording.name for recording in made]
        )
        made.append(Recording(name, tuple(group)))
    return made


def _dives(logs: Sequence[SurveyedLog]) -> list[list[SurveyedLog]]:
    """Logs of one dive together, in the order given.

    Logs with Unix time that overlap are one, in any number and over any other; so are logs of which each
    holds other channels than the others, where not all have Unix time.
    """
    offered = [set(chosen(log)) - set(_SHARED) for log in logs]
    if any(log.epoch_s is None for log in logs):
        together = sum(map(len, offered)) == len(set().union(*offered))
        return [list(logs)] if together else [[log] for log in logs]
    spans = [tuple(t + (log.epoch_s or 0.0) for t in log.span_s) for log in logs]
    groups: list[list[int]] = []
    for k, (start, stop) in enumerate(spans):
        near = [
            group
            for group in groups
            if any(
                min(stop, spans[other][1]) - max(start, spans[other][0])
                > INTAKE_SETTINGS.overlap_share * min(stop - start, spans[other][1] - spans[other][0])
                for other in group
            )
        ]
        groups = [group for group in groups if group not in near]
        groups.append(sorted([k, *(other for group in near for other in group)]))
    return [[logs[k] for k in group] for group in sorted(groups)]


def _of_map(name: str, use: MapTrial, logs: Sequence[SurveyedLog]) -> Recording:
    by_name = {log.path.name: log for log in logs}
    for file in use.logs:
        if file not in by_name:
            raise TrialError(
                f'map, trials {name!r}, key logs: there is no log "{file}"{nearest(file, by_name)}'
            )
    used = tuple(by_name[file] for file in use.logs) or tuple(logs)
    return Recording(file_name(name), used, use.start_s, use.stop_s)


def proposed_columns(made: Sequence[Recording]) -> dict[str, Column]:
    """Columns that the logs offer, the first log's before the others'.

    Where each recording is one table of its own name, columns are named without it, so that one map serves
    all of them.
    """
    logs = [log for recording in made for log in recording.logs]
    alike = len(made) > 1 and all(len(log.topics) == 1 for log in logs)
    columns: dict[str, Column] = {}
    offered = [(log, canonical, proposal) for log in logs for canonical, proposal in chosen(log).items()]
    # A velocity over the earth, as of an estimator, is offered where no log has one in the body's axes; only
    # an attitude turns it there.
    measured = any(canonical in _VELOCITY and not proposal.convert for _, canonical, proposal in offered)
    if measured or not any(canonical in ("q_w", "yaw_deg") for _, canonical, _ in offered):
        offered = [entry for entry in offered if not (entry[1] in _VELOCITY and entry[2].convert)]
    for log, canonical, proposal in offered:
        alone = len(log.topics) == 1 and not proposal.topic.isprintable()
        source = proposal.name if alike or alone else proposal.source
        if not source.isprintable() or not canonical.isprintable():
            continue
        source += f"/{proposal.per}" if proposal.per else ""
        columns.setdefault(
            canonical,
            Column(
                source,
                proposal.unit,
                proposal.frame,
                proposal.sign,
                proposal.convert,
                proposal.why,
                proposal.certain,
            ),
        )
    return columns


def table_of(
    recording: Recording, wanted: ImportMap, share: Callable[[float], None] | None = None
) -> Recorded:
    """Table of a recording with the columns of a map; only their fields are read."""
    import polars as pl

    logs = [open_log(log.path) for log in recording.logs]
    homes: dict[str, tuple[Wanted, Log]] = {}
    absent = []
    for canonical, column in wanted.columns.items():
        home = next(((w, log) for log in logs if (w := find_field(log, column.source))), None)
        if home is None:
            absent.append(canonical)
        else:
            homes[canonical] = home
    if not homes:
        raise TrialError(
            f"{wanted.source}: columns: {', '.join(log.path.name for log in logs)} has none of these fields;"
            f" its topics are {listed([topic for log in logs for topic in log.fields])}"
        )
    _refuse_twins(homes, logs)
    clocks = dict(wanted.clocks)
    # Every sample stays at its own stamp; what reading left out is noted.
    joined = join(logs, list(dict.fromkeys(w for w, _ in homes.values())), clocks, share)
    table, notes = joined.table, list(joined.notes)
    notes += [Note.of("of file", log.path.name, note=note) for log in logs for note in log.findings]
    # A map that names a field without its topic finds it under that name in the table.
    plain = {c for c, (w, _) in homes.items() if wanted.columns[c].source in (w.name, f"{w.name}/{w.per}")}
    columns: dict[str, dict[str, Any]] = {}
    fixes: dict[str, tuple[str, Array]] = {}  # latitude and longitude: canonical column, values in degrees
    for canonical, (field, log) in homes.items():
        column = wanted.columns[canonical]
        name = field.column
        if column.convert in _EARTH:  # turned below, when the attitude is known
            continue
        if column.convert == "pressure":
            pressure = _numbers(table[name]) * unit_factor(
                column.unit or "Pa", ("Pa",), f"{log.path}: {canonical}"
            )
            table = table.with_columns(pl.Series(canonical, _depth(pressure, notes), nan_to_null=True))
            continue
        if column.convert:
            fixes[column.convert] = (
                canonical,
                _numbers(table[name])
                * unit_factor(column.unit or "deg", ("deg",), f"{log.path}: {canonical}"),
            )
            continue
        if canonical in plain:
            name = column.source
            if name not in table.columns:
                table = table.with_columns(table[field.column].alias(name))
        columns[canonical] = column.entry(name)
    # Latitude and longitude become metres together.
    if fixes:
        if "latitude" not in fixes:
            raise TrialError(
                f"{wanted.source}: {fixes['longitude'][0]}: no latitude is known from which metres count;"
                " map x_m with convert, too"
            )
        table = table.with_columns(_metres(_numbers(table["t_s"]), fixes, notes))
    table, lost = _with_body_velocity(table, columns, wanted, homes, notes, str(logs[0].path))
    absent += lost
    kept = ["t_s", *dict.fromkeys(entry["from"] for entry in columns.values())]
    kept += [c for c in homes if wanted.columns[c].convert and c not in lost]
    table = table.select(kept)
    # The map may ask for a part of the recording.
    start, stop = recording.start_s, recording.stop_s
    if start is not None or stop is not None:
        table = _cut(table, start, stop, recording.name)
    return Recorded(
        table,
        columns,
        {canonical: log.path.name for canonical, (_, log) in homes.items()},
        tuple(absent),
        tuple(note for k, note in enumerate(notes) if note not in notes[:k]),
        tuple(_events(recording, clocks, joined.epoch_s)),
    )


def _with_body_velocity(
    table: pl.DataFrame,
    columns: Mapping[str, Mapping[str, Any]],
    wanted: ImportMap,
    homes: Mapping[str, tuple[Wanted, Log]],
    notes: list[Note],
    file: str,
) -> tuple[pl.DataFrame, list[str]]:
    """The table with u, v and w from velocities north, east and down, and the columns it lacks for it."""
    import polars as pl

    from seatrial.base.frames import matrix

    over_earth = [c for c in _VELOCITY if c in homes and wanted.columns[c].convert in _EARTH]
    if not over_earth:
        return table, []
    attitude = {c: entry for c, entry in columns.items() if c in _ATTITUDE}
    if len(over_earth) < len(_VELOCITY) or not attitude:
        notes.append(Note.of("velocity not used", components=len(over_earth)))
        return table, over_earth
    cells = [
        _numbers(table[homes[c][0].column])
        * unit_factor(wanted.columns[c].unit or "m/s", ("m/s",), f"{file}: {c}")
        * wanted.columns[c].sign
        for c in _VELOCITY
    ]
    over_ground = np.column_stack(cells)
    t = np.asarray(table["t_s"].to_numpy(), float)
    sources = parse(attitude, table.columns, file)
    signal = signals(table, t, {c: sources[c] for c in attitude}, file, RecordingReport(file))["attitude"]
    sampled = np.isfinite(over_ground).all(axis=1)
    q, valid = linear(signal, t[sampled])
    body = np.full(over_ground.shape, np.nan)
    body[sampled] = np.einsum("nij,ni->nj", matrix(q), over_ground[sampled])
    body[np.flatnonzero(sampled)[~valid.all(axis=1)]] = np.nan
    field, log = homes[over_earth[0]]
    estimated = f"{field.topic}.{field.name}" if of_estimator(log.format, field.topic) else ""
    notes.append(Note.of("velocity turned", estimated=estimated))
    return table.with_columns(pl.Series(c, body[:, k], nan_to_null=True) for k, c in enumerate(_VELOCITY)), []


def rate_of_long(table: pl.DataFrame) -> float | None:
    """Rate in Hz for a recording with very many samples; None for one that keeps its own.

    No vehicle that is steered moves faster than `least_rate_hz` can show; a million samples only take time.
    """
    busiest = max(table.height - column.null_count() for column in table.iter_columns())
    if busiest <= INTAKE_SETTINGS.most_samples:
        return None
    span = float(table["t_s"][-1]) - float(table["t_s"][0])
    rate = float(f"{max(INTAKE_SETTINGS.least_rate_hz, INTAKE_SETTINGS.most_samples / span):.2g}")
    return rate if rate < busiest / span else None


def _refuse_twins(homes: Mapping[str, tuple[Wanted, Log]], logs: Sequence[Log]) -> None:
    """Refuse a topic that two joined files have: the join would take the first one's without a word."""
    for wanted, log in homes.values():
        for other in logs:
            twin = other is not log and wanted.name in other.fields.get(wanted.topic, {})
            if twin and other.format == log.format == "csv":
                raise TrialError(
                    f'{other.path}: topic "{wanted.topic}" is also in {log.path}; rename one of the files'
                )


def _cut(table: pl.DataFrame, start: float | None, stop: float | None, name: str) -> pl.DataFrame:
    t = table["t_s"]
    first, last = float(t[0]), float(t[-1])
    kept = table.filter((t >= (first if start is None else start)) & (t <= (last if stop is None else stop)))
    if not kept.height:
        raise TrialError(
            f"map, trials {name!r}: no sample from {start} to {stop} s; the recording lasts from {first:.6g}"
            f" to {last:.6g} s"
        )
    return kept


def _events(
    recording: Recording, clocks: Mapping[str, Clock], epoch_s: float | None
) -> list[tuple[float, str]]:
    """Changes of mode on the clock of the joined table."""
    events = []
    for log in recording.logs:
        clock = clocks.get(log.path.name, Clock())
        offset = 0.0 if epoch_s is None else (log.epoch_s or 0.0) - epoch_s
        for event in log.events:
            if event.kind == "mode" and event.text.isprintable():
                events.append(((event.t - clock.offset_s) / (1.0 + clock.drift) + offset, event.text))
    return sorted(events)


def _numbers(cells: pl.Series) -> Array:
    return np.asarray(cells.cast(float).fill_null(float("nan")).to_numpy())


def _depth(pressure: Array, notes: list[Note]) -> Array:
    """Depth in m of pressures in Pa, absolute, or above the air's where they are less than it."""
    known = pressure[np.isfinite(pressure)]
    # Single samples without a reading tell nothing of the surface.
    low, high = np.quantile(known, [0.01, 0.99]) if len(known) else (_AIR_PA, _AIR_PA)
    surface, taken = _AIR_PA, "air"
    if INTAKE_SETTINGS.surface_pa[0] < low < INTAKE_SETTINGS.surface_pa[1]:
        surface = float(
            known[known > INTAKE_SETTINGS.surface_pa[0]].min(initial=INTAKE_SETTINGS.surface_pa[1])
        )
        taken = "lowest"
    elif low < INTAKE_SETTINGS.surface_pa[0]:
        surface, taken = 0.0, "gauge"
    weight = _WATER_KG_M3 * _GRAVITY_M_S2
    values = {"surface_pa": surface, "lowest_pa": float(low), "rho_kg_m3": _WATER_KG_M3}
    notes.append(Note.of("depth", "", surface=taken, **values))
    if surface == 0.0 and high < INTAKE_SETTINGS.least_pa:
        size = {"highest_pa": float(high), "depth_m": float(high / weight)}
        notes.append(Note.of("pressure too small", "", units=_LARGER_UNITS, **size))
    return np.asarray((pressure - surface) / weight)


def _metres(t: Array, fixes: Mapping[str, tuple[str, Array]], notes: list[Note]) -> list[pl.Series]:
    """North and east in m of fixes in degrees, from the first fix, in the projection that missions use.

    Latitude and longitude need not share their stamps: where one is sampled, the other is interpolated. Empty
    cells stay empty.
    """
    import polars as pl

    latitude = fixes["latitude"][1]
    longitude = fixes["longitude"][1] if "longitude" in fixes else None
    if longitude is None:
        latitude = np.where(latitude == 0.0, np.nan, latitude)  # a receiver without a fix writes zeros
        both = np.stack([latitude, np.zeros_like(latitude)], axis=-1)
    else:
        nowhere = (latitude == 0.0) & (longitude == 0.0)
        both = np.stack([np.where(nowhere, np.nan, latitude), np.where(nowhere, np.nan, longitude)], axis=-1)
    sampled = np.isfinite(both)
    both[sampled[:, 1], 1] = np.unwrap(both[sampled[:, 1], 1], period=360.0)
    for column in both.T:
        known = np.isfinite(column)
        if known.any():
            column[~known] = np.interp(t[~known], t[known], column[known])
    if not sampled.any(axis=0).all():
        metres = np.full_like(both, np.nan)
    else:
        origin = both[np.argmax(sampled.any(axis=1))]
        metres = np.where(sampled, LocalFrame(*origin).metres(both), np.nan)
        east = None if longitude is None else float(origin[1])
        notes.append(Note.of("metres", latitude_deg=float(origin[0]), longitude_deg=east))
    return [
        pl.Series(fixes[kind][0], metres[:, axis], nan_to_null=True)
        for axis, kind in enumerate(("latitude", "longitude"))
        if kind in fixes
    ]
