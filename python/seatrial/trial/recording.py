"""A recording: from a file to signals on their own stamps, in SI and NED/FRD, defects masked, corrections
applied.

A reader makes one polars table with the file's own names, units and frames; the column map converts, once
(`seatrial.trial.columns`). An empty cell means "no sample at this time", so that a log of several rates is
one table; NaN means "the sensor gave no number". Of a log of topics only the fields ``topic.field`` in the
column map are read (`seatrial.logs`); a recipe of a generated trial is simulated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError, first_line, nearest
from seatrial.base.files import before_table, no_file
from seatrial.logs.clock import scale_of
from seatrial.logs.log import FORMATS as LOGS
from seatrial.logs.log import Log, listed, open_log, reading
from seatrial.logs.names import misfit_of
from seatrial.trial import defects, table
from seatrial.trial.columns import Mixer, Source, columns_of, parse
from seatrial.trial.corrections import Corrections, corrected, parse_corrections, parse_positions
from seatrial.trial.misread import report_unit_changes
from seatrial.trial.signals import RecordingReport, Signal, evenly_stamped

if TYPE_CHECKING:
    import polars as pl

    from seatrial.logs.delimited import Layout
    from seatrial.logs.join import Wanted

Reader: TypeAlias = "Callable[[Path], pl.DataFrame]"

FORMATS: dict[str, tuple[str, ...]] = {
    "csv": (".csv", ".tsv", ".txt", ".dat"),
    "parquet": (".parquet", ".pq"),
    "generated": (".toml",),
} | {name: entry.endings for name, entry in LOGS.items() if name not in ("csv", "parquet")}
"""Name of the reader and the file endings it serves."""


_HEAD = 100
"""Rows that tell a column of numbers from one of text."""


class RawTable(NamedTuple):
    """A recording's table, the name to call it by in messages, and what its header says of columns."""

    table: pl.DataFrame
    file: str
    units: Mapping[str, str] = {}  #: That it states, by column.
    #: Places, from 1, of the columns that share a name, by the name.
    twice: Mapping[str, tuple[int, ...]] = {}

    def refuse_twice(self, used: Iterable[str]) -> None:
        """Refuse a column that is used and shares its name with another one."""
        from seatrial.logs.delimited import shared_name

        for name in used:
            if name in self.twice:
                raise TrialError(
                    f"{self.file}: {shared_name(name, self.twice[name])}, and it is used: which of them is"
                    " meant is not known; rename the others in the file"
                )


def read_table(source: Any, reader: str | Reader | None = None, columns: Iterable[str] = ()) -> RawTable:
    """Table of a recording (a path, a polars or pandas frame, or a table that was read), its name and the
    units that it states. `reader`: a name in `FORMATS` or a function from path to table; by the file's ending
    when omitted. `columns`: of a log with topics no others are read.
    """
    if isinstance(source, RawTable):
        return source
    if not isinstance(source, str | Path):
        return RawTable(_read_frame(source), "frame")
    before_table()
    path = Path(source)
    bag = reader in (None, "rosbag") and path.is_dir() and (path / "metadata.yaml").is_file()
    if not bag and (wrong := no_file(path)):
        raise TrialError(f"{path}: expected a recording, but {wrong}; give the path of a file")
    if not bag and path.stat().st_size == 0:
        raise TrialError(f"{path}: the file is empty; expected a header and rows of samples")
    if callable(reader):
        return RawTable(reader(path), str(path))
    name = "rosbag" if bag else _name_of(path, reader)
    if name in LOGS and name not in ("csv", "parquet"):
        return RawTable(_read_log(path, name, tuple(columns)), str(path))
    if name == "generated":  # a flight, as long as the recipe says
        from seatrial.trial.generated import Recipe

        return RawTable(Recipe.load(path).table(), str(path))
    with reading(path, LOGS[name].description, LOGS[name].budget):
        if name == "parquet":
            return RawTable(_read_parquet(path), str(path))
        return _read_csv(path)


def _name_of(path: Path, reader: str | None) -> str:
    """Name of the reader of a file."""
    if reader is None:
        matching = [name for name, endings in FORMATS.items() if path.name.lower().endswith(endings)]
        if not matching:
            raise TrialError(
                f'{path}: no reader for the ending "{path.suffix}"; expected one of '
                f"{', '.join(sum(FORMATS.values(), ()))}, or name the reader: reader={'|'.join(FORMATS)}"
            )
        reader = matching[0]
    if reader not in FORMATS:
        raise TrialError(f'{path}: unknown reader "{reader}"{nearest(reader, FORMATS)}')
    return reader


def _read_frame(source: Any) -> pl.DataFrame:
    """Table of a frame; a pandas index that has a name becomes a column."""
    import polars as pl

    if isinstance(source, pl.DataFrame):
        return source
    if isinstance(source, pl.LazyFrame):
        return source.collect()
    kind = f"{type(source).__module__}.{type(source).__qualname__}"
    try:
        if isinstance(source, Mapping):
            return pl.DataFrame({name: _cells(column) for name, column in source.items()}, strict=False)
        if kind.startswith("pandas.") and hasattr(source, "index"):
            named = all(name is not None for name in source.index.names)
            frame = source.reset_index() if named else source
            # NaN stays NaN: in a pandas frame it may be a missing cell or a sensor without a number.
            return pl.DataFrame([_series(str(name), frame[name]) for name in frame.columns])
    except (TypeError, ValueError, pl.exceptions.PolarsError) as error:
        raise TrialError(f"frame: not readable as a table ({first_line(error)})") from None
    raise TrialError(
        f"frame: expected the path of a file or a polars or pandas frame, found an object of {kind}"
    )


def _cells(column: Any) -> Any:
    """A column of a mapping; an array of objects as a list, whose cells polars can read one by one."""
    return column.tolist() if getattr(getattr(column, "dtype", None), "kind", "") == "O" else column


def _series(name: str, column: Any) -> pl.Series:
    """A pandas column as it is; one of mixed objects as text, so that a text cell can be named later."""
    import polars as pl

    values = column.to_numpy()
    if values.dtype.kind != "O":
        return pl.Series(name, values, nan_to_null=False)
    missing = column.isna().to_numpy()
    return pl.Series(name, [None if gone else str(cell) for cell, gone in zip(values, missing, strict=True)])


def _read_csv(path: Path) -> RawTable:
    """A table of text with the units that a row of units, or brackets behind its names, state."""
    layout = _layout(path)
    cells = _cells_of_csv(path, layout)
    if layout is None:
        return RawTable(cells, str(path))
    units = {name: unit for name, unit in zip(layout.names, layout.units, strict=True) if unit}
    return RawTable(cells, str(path), units, layout.twice)


def _cells_of_csv(path: Path, layout: Layout | None) -> pl.DataFrame:
    """Table of numbers and text, named by its row of names; an empty cell is null. Columns whose first rows
    are numbers are read as numbers, a quarter of the memory of text; where a later cell is none, all are
    text, so that the column map can name its row and value.
    """
    import polars as pl

    from seatrial.logs.delimited import Table, stripped

    if layout is not None and not _plain(layout):
        parts = list(Table(path, "csv", layout=layout).cells())
        table = pl.concat(parts) if parts else pl.DataFrame(schema=dict.fromkeys(layout.names, pl.String))
        return (
            table.with_columns(pl.all().str.replace(",", ".", literal=True))
            if layout.decimal_comma
            else table
        )
    # A plain table is read by polars at once: numbers where the first rows hold some, text otherwise.
    with path.open(encoding="utf-8", errors="replace") as file:
        header = next((line for line in file if line.strip() and not line.startswith("#")), "")
    separator = max(",;\t", key=header.count)

    def cells(types: dict[str, type[pl.DataType]], rows: int | None = None) -> pl.DataFrame:
        # A bracket in a file's name is no pattern.
        return stripped(
            pl.read_csv(
                path,
                separator=separator,
                infer_schema=False,
                schema_overrides=types,
                n_rows=rows,
                comment_prefix="#",
                glob=False,
            )
        )

    try:
        head = cells({}, _HEAD)
        try:
            table = cells({name: pl.Float64 for name in head.columns if _numeric(head[name])})
        except pl.exceptions.PolarsError:
            table = cells({})
    except pl.exceptions.PolarsError as error:
        raise TrialError(
            f"{path}: not readable as a table of values separated by {separator!r} ({first_line(error)}); "
            "expected one header line and rows with as many cells; repair the file or name its reader"
        ) from None
    return table.rename(dict(zip(table.columns, _names(table.columns, layout), strict=True)))


def _names(header: list[str], layout: Layout | None) -> list[str]:
    """Names of the columns without blanks around them; the layout numbers those that share one."""
    named = layout.names if layout is not None and len(layout.names) == len(header) else header
    # A column without a name stays so, as the index of a frame.
    return [name.strip() if given.strip() else given for given, name in zip(header, named, strict=True)]


def _numeric(column: pl.Series) -> bool:
    """Whether all cells of a column of text are numbers, and some are there."""
    import polars as pl

    empty = column.null_count()
    return empty < len(column) and column.cast(pl.Float64, strict=False).null_count() == empty


def _layout(path: Path) -> Layout | None:
    """Layout of the table; None where it shows no row of numbers: what is wrong with it is said later."""
    from seatrial.logs.delimited import encoding_of, layout_of

    encoding_of(path)
    try:
        return layout_of(path)
    except TrialError:
        return None


def _plain(layout: Layout) -> bool:
    """Whether it is a table of UTF-8 text that polars reads as it is."""
    simple = layout.encoding.startswith("utf-8") and layout.separator != " " and not layout.decimal_comma
    return simple and layout.plain


def _read_log(path: Path, reader: str, columns: Sequence[str]) -> pl.DataFrame:
    """Table of a log's fields ``topic.field``; ``topic.field/other`` is divided by another field of the
    topic.
    """
    from seatrial.logs.join import join

    log = open_log(path, reader)
    wanted = [_wanted(log, column) for column in columns if column != "t_s"]
    if not wanted:
        topic, fields = next(iter(log.fields.items()))
        raise TrialError(
            f"{path}: a log of topics needs a column map, for example"
            f' columns={{"yaw_deg": "{topic}.{next(iter(fields))}"}}; its topics are'
            f" {listed(list(log.fields))}"
        )
    return join([log], wanted).table


def _wanted(log: Log, column: str) -> Wanted:
    from seatrial.logs.join import find_field

    wanted = find_field(log, column)
    if wanted is not None:
        return wanted
    present = [f"{topic}.{field}" for topic, names in log.fields.items() for field in names]
    near = nearest(column, present[:5000])
    where = near if len(present) < 40 or "did you mean" in near else ""
    raise TrialError(
        f'{log.path}: column map: there is no field "{column}" in the log{where}'
        + ("" if where else f"; its topics are {listed(list(log.fields))}")
    )


def _read_parquet(path: Path) -> pl.DataFrame:
    """Table with the file's own column names."""
    import polars as pl

    from seatrial.base.budget import claim

    try:
        table = pl.scan_parquet(path, glob=False)
        claim(8 * len(table.collect_schema()) * table.select(pl.len()).collect().item())
        return table.collect()
    except (pl.exceptions.PolarsError, OSError) as error:
        raise TrialError(f"{path}: not readable as Parquet ({first_line(error)}); another format?") from None


_TELLING_ROWS = 2000
"""Rows whose times tell their unit."""


@dataclass(frozen=True)
class Recording:
    """What was read of a source."""

    file: str  #: Where it came from.
    signals: dict[str, Signal]  #: By sensor, as the corrections given say and not otherwise corrected.
    time: Array  #: Stamps of the rows, s.
    sources: dict[str, Source]  #: Column map.
    positions: dict[str, Array]  #: Where sensors sit, (3,) in m from O.
    corrections: Corrections  #: What was given.
    report: RecordingReport  #: What was found so far.


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
    unused = [column for column in cells.columns if column and column not in used]
    if unused:
        report.info("columns unused", "columns", columns=unused)
    for column in cells.columns:
        if column not in used and (misfit := misfit_of(column)) is not None:
            canonical, unit = misfit
            report.warning("column of another unit", "columns", column=column, canonical=canonical, unit=unit)
    del cells, read  # a long log is large: nothing below needs its cells
    begin("defects")
    signals, time = evenly_stamped(signals, time, report)
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
        note = report.error if scale.unix else report.warning
        rate = (len(t) - 1) / (t[-1] - t[0])
        note("time unit", "time", rate_hz=rate, unit=unit, how=scale.how, column=source.column)
