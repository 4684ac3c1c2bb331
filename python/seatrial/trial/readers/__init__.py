"""Readers: a file in, one polars table out, with the file's own column names, units and frames.

A reader is a module with ``read(path) -> polars.DataFrame``. It converts nothing: the column map does, once
(`seatrial.trial.columns`). An empty cell (null) means "no sample at this time", so that a log of several
rates is one table; NaN means "the sensor gave no number". A further format is one more module and one more
row in `FORMATS`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from seatrial.base.errors import TrialError, nearest
from seatrial.base.file_names import no_file
from seatrial.base.forked import before_table

if TYPE_CHECKING:
    import polars as pl

__all__ = ["Reader", "read_table"]

Reader: TypeAlias = "Callable[[Path], pl.DataFrame]"

FORMATS: dict[str, tuple[str, ...]] = {
    "csv": (".csv", ".tsv", ".txt"),
    "parquet": (".parquet", ".pq"),
    "generated": (".toml",),
}
"""Name of the reader (its module in this package) and the file endings it serves."""


def read_table(source: Any, reader: str | Reader | None = None) -> tuple[pl.DataFrame, str]:
    """Table of a recording and the name to call it by in messages.

    Parameters
    ----------
    source
        Path of a file, or a polars or pandas frame.
    reader
        Name of a reader in `FORMATS`, or a function from a path to a table; by the file's ending when
        omitted.

    Raises
    ------
    TrialError
        If there is no such file, no reader for it, or it cannot be read as what it says it is.
    """
    if not isinstance(source, str | Path):
        return _read_frame(source), "frame"
    before_table()
    path = Path(source)
    if wrong := no_file(path):
        raise TrialError(f"{path}: expected a recording, but {wrong}; give the path of a file")
    if path.stat().st_size == 0:
        raise TrialError(f"{path}: the file is empty; expected a header and rows of samples")
    return _reader_of(path, reader)(path), str(path)


def _reader_of(path: Path, reader: str | Reader | None) -> Reader:
    if callable(reader):
        return reader
    if reader is None:
        matching = [name for name, endings in FORMATS.items() if path.suffix.lower() in endings]
        if not matching:
            raise TrialError(
                f'{path}: no reader for the ending "{path.suffix}"; expected one of '
                f"{', '.join(sum(FORMATS.values(), ()))}, or name the reader: reader={'|'.join(FORMATS)}"
            )
        reader = matching[0]
    if reader not in FORMATS:
        raise TrialError(f'{path}: unknown reader "{reader}"{nearest(reader, FORMATS)}')
    read: Reader = import_module(f"seatrial.trial.readers.{reader}").read
    return read


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
            return pl.DataFrame(dict(source), strict=False)
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


def _series(name: str, column: Any) -> pl.Series:
    """A pandas column as it is; one of mixed objects as text, so that a text cell can be named later."""
    import polars as pl

    values = column.to_numpy()
    if values.dtype.kind != "O":
        return pl.Series(name, values, nan_to_null=False)
    missing = column.isna().to_numpy()
    return pl.Series(name, [None if gone else str(cell) for cell, gone in zip(values, missing, strict=True)])
