"""From the table of a bench recording to numbers: loads, commands, measured revolutions, voltage.

The column map is that of a trial (`seatrial.recording.columns`) with the load cell's columns besides, and
with a group's name after ``cmd.`` or ``meas.`` for all its actuators at once. Nothing is resampled: an empty
cell stays NaN, so that a log of several rates is one table. Tests: ``tests/test_bench_records.py``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.errors import TrialError, nearest
from seatrial.parameters import actuator_groups
from seatrial.readers import read_table
from seatrial.recording import frames, units
from seatrial.recording.columns import Source, source_of
from seatrial.recording.table import numbers, time_base

if TYPE_CHECKING:
    import polars as pl

    from seatrial._core import Vehicle

__all__ = ["LOADS", "BenchTable", "read_bench_table"]

Array = NDArray[np.float64]

LOADS = ("load.X_n", "load.Y_n", "load.Z_n")
SINGLE = "load_n"


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
    voltage
        Supply voltage in V, where it is logged.
    frame
        The whole table, for columns without a canonical name.
    """

    file: str
    t: Array | None
    commands: Mapping[str, Array]
    measured: Mapping[str, Array]
    loads: Mapping[str, Array]
    voltage: Array | None
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
    """Table of a bench recording.

    Parameters
    ----------
    path : Path
    vehicle : Vehicle
        Gives the names of actuators and groups.
    reader : str, optional
        As in `seatrial.readers.read_table`.
    columns : mapping, optional
        ``{canonical: "column"}`` or ``{canonical: {from, unit, sign, frame}}``.

    Raises
    ------
    TrialError
        The file cannot be read, or the map names what is not there.
    """
    table, file = read_table(path, reader)
    if table.height == 0:
        raise TrialError(f"{file}: expected rows of samples, found the header only")
    sources = _sources(table.columns, columns or {}, vehicle, file)
    t = time_base(table, sources["t_s"], file) if "t_s" in sources else None
    return BenchTable(
        file=file,
        t=t,
        commands=_per_actuator(table, sources, "cmd.", file),
        measured=_per_actuator(table, sources, "meas.", file),
        loads=_loads(table, sources, file),
        voltage=_scalar(table, sources, "voltage_v", "V", file),
        frame=table,
    )


def _sources(
    present: list[str], columns: Mapping[str, Any], vehicle: Vehicle, file: str
) -> dict[str, Source]:
    """Source by canonical name; groups resolved to their actuators."""
    known = ["t_s", "voltage_v", SINGLE, *LOADS]
    members = actuator_groups(vehicle) | {name: [name] for name in vehicle.actuators}
    known += [f"{kind}.{name}" for kind in ("cmd", "meas") for name in members]
    given = {name: Source(name) for name in present if name in known}
    for canonical, entry in columns.items():
        if canonical not in known:
            raise TrialError(
                f'{file}: column map: "{canonical}" is no column of a bench test{nearest(canonical, known)}'
            )
        source = source_of(entry, f"{file}: column map, {canonical}")
        if source.column not in present:
            raise TrialError(
                f'{file}: column map, {canonical}: there is no column "{source.column}" in the recording'
                f"{nearest(source.column, present)}"
            )
        given[canonical] = source
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
    found = {}
    for canonical, source in sources.items():
        if canonical.startswith(prefix):
            _no_frame(canonical, source, file)
            where = f"{file}: {canonical}"
            scale = units.factor(source.unit, units.ACTUATOR_UNITS, where) if source.unit else 1.0
            found[canonical.removeprefix(prefix)] = (
                numbers(table[source.column], canonical, file) * scale * source.sign
            )
    return found


def _scalar(
    table: pl.DataFrame, sources: Mapping[str, Source], canonical: str, unit: str, file: str
) -> Array | None:
    source = sources.get(canonical)
    if source is None:
        return None
    _no_frame(canonical, source, file)
    return _scaled(table, source, canonical, unit, file)


def _scaled(table: pl.DataFrame, source: Source, canonical: str, unit: str, file: str) -> Array:
    scale = units.factor(source.unit, (unit,), f"{file}: {canonical}") if source.unit else 1.0
    return np.asarray(numbers(table[source.column], canonical, file) * scale * source.sign)


def _loads(table: pl.DataFrame, sources: Mapping[str, Source], file: str) -> dict[str, Array]:
    """Loads by axis; a frame may turn signs of single axes (FLU), mixing axes is refused."""
    found: dict[str, Array] = {}
    for row, canonical in enumerate(LOADS):
        if canonical in sources:
            source = sources[canonical]
            turn = frames.body_matrix(source.frame or "FRD", f"{file}: {canonical}")
            found["XYZ"[row]] = _scaled(table, source, canonical, "N", file) * turn[row, row]
    single = _scalar(table, sources, SINGLE, "N", file)
    return found | ({} if single is None else {"": single})


def _no_frame(canonical: str, source: Source, file: str) -> None:
    if source.frame:
        raise TrialError(f"{file}: {canonical}: a scalar has no frame; leave it out")


def listed(names: Iterable[str]) -> str:
    """Names for a message, or "none"."""
    return ", ".join(names) or "none"
