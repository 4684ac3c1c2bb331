"""Readers: a file in, one polars table out, with the file's own column names, units and frames.

A reader is a module with ``read(path) -> polars.DataFrame``. It converts nothing: the column map does, once
(`seatrial.trial.columns`). An empty cell (null) means "no sample at this time", so that a log of several
rates is one table; NaN means "the sensor gave no number". Logs of vehicles and middleware hold many topics:
of these only the fields in the column map are read (`seatrial.logs`), with the column names
``topic.field``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from seatrial.base.atomic_write import before_table
from seatrial.base.errors import TrialError, nearest
from seatrial.base.file_names import no_file
from seatrial.logs.formats import FORMATS as LOGS
from seatrial.logs.log import reading

if TYPE_CHECKING:
    import polars as pl

__all__ = ["Reader", "Recording", "read_table"]

Reader: TypeAlias = "Callable[[Path], pl.DataFrame]"

FORMATS: dict[str, tuple[str, ...]] = {
    "csv": (".csv", ".tsv", ".txt", ".dat"),
    "parquet": (".parquet", ".pq"),
    "generated": (".toml",),
} | {name: entry.endings for name, entry in LOGS.items() if name not in ("csv", "parquet")}
"""Name of the reader and the file endings it serves."""


class Recording(NamedTuple):
    """A recording's table, the name to call it by in messages, and what its header says of columns.

    Attributes
    ----------
    table, file
    units
        That it states, by column.
    twice
        Places, from 1, of the columns that share a name, by the name.
    """

    table: pl.DataFrame
    file: str
    units: Mapping[str, str] = {}
    twice: Mapping[str, tuple[int, ...]] = {}

    def refuse_twice(self, used: Iterable[str]) -> None:
        """Refuse a column that is used and shares its name with another one.

        Raises
        ------
        TrialError
            With the places of both.
        """
        from seatrial.logs.delimited import shared_name

        for name in used:
            if name in self.twice:
                raise TrialError(
                    f"{self.file}: {shared_name(name, self.twice[name])}, and it is used: which of them is"
                    " meant is not known; rename the others in the file"
                )


def read_table(source: Any, reader: str | Reader | None = None, columns: Iterable[str] = ()) -> Recording:
    """Table of a recording, its name and the units that it states.

    Parameters
    ----------
    source
        Path of a file, a polars or pandas frame, or a table that was read already.
    reader
        Name of a reader in `FORMATS`, or a function from a path to a table; by the file's ending when
        omitted.
    columns
        Columns that will be used: of a log with topics no others are read.

    Raises
    ------
    TrialError
        If there is no such file, no reader for it, or it cannot be read as what it says it is.
    """
    if isinstance(source, Recording):
        return source
    if not isinstance(source, str | Path):
        return Recording(_read_frame(source), "frame")
    before_table()
    path = Path(source)
    bag = reader in (None, "rosbag") and path.is_dir() and (path / "metadata.yaml").is_file()
    if not bag and (wrong := no_file(path)):
        raise TrialError(f"{path}: expected a recording, but {wrong}; give the path of a file")
    if not bag and path.stat().st_size == 0:
        raise TrialError(f"{path}: the file is empty; expected a header and rows of samples")
    if callable(reader):
        return Recording(reader(path), str(path))
    name = "rosbag" if bag else _name_of(path, reader)
    if name in LOGS and name not in ("csv", "parquet"):
        from seatrial.trial.readers import log

        return Recording(log.read(path, reader=name, columns=tuple(columns)), str(path))
    module = import_module(f"seatrial.trial.readers.{name}")
    if name == "generated":  # a flight, as long as the recipe says
        return Recording(module.read(path), str(path))
    with reading(path, LOGS[name].description, LOGS[name].budget):
        if name == "parquet":
            return Recording(module.read(path), str(path))
        return Recording(module.read(path), str(path), module.units(path), module.twice(path))


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
    """Table of a frame; a pandas index that has a name becomes a column.

    Raises
    ------
    TrialError
        If the object is no frame.
    """
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
        raise TrialError(f"frame: not readable as a table ({error})") from None
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
