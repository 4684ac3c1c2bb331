"""Readers: a file in, one polars table out, with the file's own column names, units and frames.

A reader is a module with ``read(path) -> polars.DataFrame``. It converts nothing: the column map does, once
(`seatrial.trial.columns`). An empty cell (null) means "no sample at this time", so that a log of several
rates is one table; NaN means "the sensor gave no number". A further format is one more module and one more
row in `FORMATS`.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from seatrial.base.errors import TrialError, nearest

if TYPE_CHECKING:
    import polars as pl

__all__ = ["FORMATS", "Reader", "read_table"]

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
        from seatrial.trial.readers import frame

        return frame.read(source), "frame"
    path = Path(source)
    if not path.is_file():
        what = "is a folder" if path.is_dir() else "does not exist"
        raise TrialError(f"{path}: expected a recording, but this {what}; give the path of a file")
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
