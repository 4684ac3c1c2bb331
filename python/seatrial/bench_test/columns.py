"""The table of a bench recording: loads, commands, measured revolutions, voltage, and what was driven.

The column map is that of a trial (`seatrial.trial.columns`) with the load cell's columns besides, and
with a group's name after ``cmd.`` or ``meas.`` for all its actuators at once. Nothing is resampled: an empty
cell stays NaN, so that a log of several rates is one table. A `Unit` is the group, or the actuators, that
share one characteristic. Held by ``tests/bench_test/test_bench_records.py`` and
``tests/bench_test/test_bench_file.py``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base import frames
from seatrial.base.arrays import Array
from seatrial.base.channels import ACTUATOR_UNITS, unit_factor
from seatrial.base.errors import CampaignError, TrialError, nearest
from seatrial.trial.columns import Source, columns_of, mapped
from seatrial.trial.readers import read_table
from seatrial.trial.table import numbers, time_base
from seatrial.vehicle.actuators import actuator_groups

if TYPE_CHECKING:
    import polars as pl

    from seatrial._core import Vehicle

_LOADS = ("load.X_n", "load.Y_n", "load.Z_n")

_SINGLE = "load_n"


@dataclass(frozen=True)
class BenchTable:
    """Columns (n,) of a recording; NaN where a cell is empty.

    Attributes
    ----------
    file
        What to call it in messages.
    t
        Time in s; None where the table has no time: every row is then one operating point.
    commands, measured
        Per actuator in its command's unit, as logged.
    loads
        By letter of the axis, N, force of the vehicle on its tether in body axes; by ``""`` a single cell's.
    voltage_v
        Supply voltage in V, where it is logged.
    frame
        The whole table, for columns without a canonical name.
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
    """Table of a bench recording; the vehicle gives the names of actuators and groups.

    `reader` is as in `seatrial.trial.readers.read_table`, `columns` ``{canonical: "column"}`` or
    ``{canonical: {from, unit, sign, frame}}``. Raises TrialError where the file cannot be read, or the map
    names what is not there.
    """
    read = read_table(path, reader, columns_of(columns))
    table, file = read.table, read.file
    if table.height == 0:
        raise TrialError(f"{file}: expected rows of samples, found the header only")
    sources = _sources(table.columns, columns or {}, vehicle, file)
    read.refuse_twice(source.column for source in sources.values())
    t = time_base(table, sources["t_s"], file) if "t_s" in sources else None
    return BenchTable(
        file=file,
        t=t,
        commands=_per_actuator(table, sources, "cmd.", file),
        measured=_per_actuator(table, sources, "meas.", file),
        loads=_loads(table, sources, file),
        voltage_v=_scalar(table, sources, "voltage_v", "V", file),
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
    columns = {}
    for canonical, source in sources.items():
        if canonical.startswith(prefix):
            _no_frame(canonical, source, file)
            where = f"{file}: {canonical}"
            scale = unit_factor(source.unit, ACTUATOR_UNITS, where) if source.unit else 1.0
            columns[canonical.removeprefix(prefix)] = (
                numbers(table[source.column], canonical, file) * scale * source.sign
            )
    return columns


def _scalar(
    table: pl.DataFrame, sources: Mapping[str, Source], canonical: str, unit: str, file: str
) -> Array | None:
    source = sources.get(canonical)
    if source is None:
        return None
    _no_frame(canonical, source, file)
    return _scaled(table, source, canonical, unit, file)


def _scaled(table: pl.DataFrame, source: Source, canonical: str, unit: str, file: str) -> Array:
    scale = unit_factor(source.unit, (unit,), f"{file}: {canonical}") if source.unit else 1.0
    return np.asarray(numbers(table[source.column], canonical, file) * scale * source.sign)


def _loads(table: pl.DataFrame, sources: Mapping[str, Source], file: str) -> dict[str, Array]:
    """Loads by axis; a frame may turn signs of single axes (FLU), mixing axes is refused."""
    loads: dict[str, Array] = {}
    for row, canonical in enumerate(_LOADS):
        if canonical in sources:
            source = sources[canonical]
            turn = frames.body_matrix(source.frame or "FRD", f"{file}: {canonical}")
            loads["XYZ"[row]] = _scaled(table, source, canonical, "N", file) * turn[row, row]
    single = _scalar(table, sources, _SINGLE, "N", file)
    return loads | ({} if single is None else {"": single})


def _no_frame(canonical: str, source: Source, file: str) -> None:
    if source.frame:
        raise TrialError(f"{file}: {canonical}: a scalar has no frame; leave it out")


def listed(names: Iterable[str]) -> str:
    """Names for a message, or "none"."""
    return ", ".join(names) or "none"


@dataclass(frozen=True)
class Unit:
    """Actuators that share one characteristic in this test: a whole group, or some that are named.

    Attributes
    ----------
    name
        The group's name; names of the actuators joined by ``+`` where they are not a whole group.
    actuators
        In the vehicle's order.
    command
        Unit of their command: rpm, us or N.
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
