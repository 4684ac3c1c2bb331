"""A recording as signals on their own stamps: in SI and NED/FRD, defects masked, corrections applied."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from seatrial.base.arrays import Array
from seatrial.logs.clock import scale_of
from seatrial.logs.units import misfit_of
from seatrial.trial import defects, resampling, table
from seatrial.trial.columns import Source, columns_of, parse
from seatrial.trial.corrections import Corrections, corrected, parse_corrections, parse_positions
from seatrial.trial.misread import report_unit_changes
from seatrial.trial.mixer import Mixer
from seatrial.trial.readers import Reader, read_table
from seatrial.trial.signals import RecordingReport, Signal

_TELLING_ROWS = 2000
"""Rows whose times tell their unit."""


@dataclass(frozen=True)
class Recording:
    """What was read of a source.

    Attributes
    ----------
    file
        Where it came from.
    signals
        By sensor, as the corrections given say and not otherwise corrected.
    time
        Stamps of the rows, s.
    sources
        Column map.
    positions
        Where sensors sit, (3,) in m from O.
    corrections
        What was given.
    report
        What was found so far.
    """

    file: str
    signals: dict[str, Signal]
    time: Array
    sources: dict[str, Source]
    positions: dict[str, Array]
    corrections: Corrections
    report: RecordingReport


def recording(
    source: Any,
    reader: str | Reader | None = None,
    *,
    columns: Mapping[str, Any] | None = None,
    sensor_positions: Mapping[str, Sequence[float]] | None = None,
    corrections: Mapping[str, Any] | None = None,
    mixer: Mixer | None = None,
    begin: Callable[[str], None] = lambda step: None,
) -> Recording:
    """Signals of a log or table; the parameters are those of `seatrial.trial.trial.Trial.read`, and
    ``begin`` is called with the name of each step before it.

    Raises
    ------
    TrialError
        If the recording, its column map or its corrections cannot be used.
    """
    begin("table")
    sticks = [] if mixer is None else mixer.columns
    read = read_table(source, reader, [*columns_of(columns), *sticks])
    cells, file = read.table, read.file
    if mixer is not None:
        cells = mixer.mixed(cells, file, columns)
    report = RecordingReport(file)
    given = parse_corrections(corrections, f"{file}: corrections")
    sources = parse(columns, cells.columns, file, read.units)
    read.refuse_twice([*(source.column for source in sources.values()), *sticks])
    positions = parse_positions(sensor_positions, file)
    begin("units and frames")
    time = table.time_base(cells, sources["t_s"], file)
    _note_time(time, sources["t_s"], report)
    signals = table.signals(cells, time, sources, file, report)
    used = {source.column for source in sources.values()} | set(sticks)
    unused = [f'"{column}"' for column in cells.columns if column and column not in used]
    if unused:
        report.add("info", "columns", f"not used: {', '.join(unused)}")
    for column in cells.columns:
        if column not in used and (misfit := misfit_of(column)) is not None:
            report.add(
                "warning",
                "columns",
                f'"{column}" is not used: called as {misfit[0]}, and {misfit[1]} is no unit of it; map it, or'
                " rename it",
            )
    del cells, read  # a long log is large: nothing below needs its cells
    begin("defects")
    signals, time = resampling.evenly_stamped(signals, time, report)
    report_unit_changes(signals, time, report)
    signals = defects.mark(signals, report)
    signals = corrected(signals, given, report)
    defects.report_height(signals, report)
    return Recording(file, signals, time, sources, positions, given, report)


def _note_time(t: Array, source: Source, report: RecordingReport) -> None:
    """Say where the times of the rows, read as s, look like a smaller unit."""
    scale = scale_of("", "", t[:_TELLING_ROWS])
    if scale.factor < 1.0:
        unit = {1e-3: "ms", 1e-6: "us", 1e-9: "ns"}[scale.factor]
        report.add(
            "error" if scale.unix else "warning",
            "time",
            f"read as s, {(len(t) - 1) / (t[-1] - t[0]):.3g} Hz, and looks like {unit} ({scale.how}); state"
            f' the unit in the column map: t_s = {{ from = "{source.column}", unit = "{unit}" }}',
        )
