"""Apache Parquet: a table in columns, read in row groups.

The names and places of the columns stand at the end of the file: one that is cut off cannot be read. A part
of a column that is damaged is empty, with a note.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.budget import claim
from seatrial.base.errors import TrialError, first_line, printable
from seatrial.logs.clock import (
    Counter32,
    TimeColumn,
    after,
    clock_times,
    joined_names,
    time_column,
    time_fields,
)  # fmt: skip
from seatrial.logs.log import READING_SETTINGS, Chunk, Log, Share, stem_of

if TYPE_CHECKING:
    import polars as pl


def open_log(path: Path) -> Log:
    """Log of a Parquet file: one topic, called by the file's stem.

    Raises
    ------
    TrialError
        If the file is no Parquet file.
    """
    log = _Parquet(path, "parquet")
    log.fields  # noqa: B018 - a damaged file is refused here
    return log


@dataclass
class _Parquet(Log):
    @cached_property
    def _frame(self) -> pl.LazyFrame:
        import polars as pl

        return pl.scan_parquet(self.path, glob=False)

    @cached_property
    def _schema(self) -> pl.Schema:
        import polars as pl

        with self.path.open("rb") as stream:
            begun = stream.read(4) == b"PAR1"
            stream.seek(max(self.path.stat().st_size - 4, 0))
            ended = stream.read(4) == b"PAR1"
        if begun and not ended:
            raise TrialError(
                f"{self.path}: cut off: its end, which says what is in it, is missing; fetch or write the"
                " file again"
            )
        try:
            with _quiet():
                return self._frame.collect_schema()
        except (pl.exceptions.PolarsError, OSError, pl.exceptions.PanicException) as error:
            raise TrialError(
                f"{self.path}: not readable as Parquet ({first_line(error)}); is it another format?"
            ) from None

    @cached_property
    def fields(self) -> Mapping[str, Mapping[str, str]]:
        """Columns of numbers, times, and text that may be either."""
        for name, kind in self._schema.items():
            if kind.is_nested():
                self.note("no numbers", name, found=str(kind))
        kept = {
            name: ""
            for name, kind in self._schema.items()
            if kind.is_numeric()
            or kind.is_temporal()
            or kind.base_type().__name__ in ("Boolean", "Null", "String")
        }
        self.of_file.add(self.topic)
        return {self.topic: kept}

    @property
    def topic(self) -> str:
        """Name of the only topic."""
        return stem_of(self.path)

    @cached_property
    def _clock(self) -> TimeColumn | None:
        """Column of the time; None where there is none."""
        import polars as pl

        names = list(self.fields[self.topic])
        # Text is a time only where no number is.
        candidates = sorted(time_fields(names), key=lambda name: self._schema[name] == pl.String)
        typed = [name for name in names if self._schema[name].is_temporal() and name not in candidates]
        candidates += typed
        if not candidates:
            self.note("no time", why=None)
            return None
        pair = [name for name in joined_names(dict.fromkeys(names, "")) or () if name not in candidates]
        head = self._part(0, min(2_000, self._height), [*candidates, *pair])
        column, why = time_column(dict.fromkeys(names, ""), candidates, head, _numbers, first_row=1)
        if column is None:
            self.timeless = why
            self.note("no time", why=why)
            return None
        if column.scale is None:
            dated = clock_times(head[column.name])
            self.epoch_s = 0.0 if dated is not None and dated[1] else None
        elif column.scale.unix:
            self.epoch_s = 0.0
        if column.scale is not None and column.scale.how:
            self.remark("scale of time", f'time "{column.name}"', how=column.scale.how)
        return column

    def _part(self, begin: int, count: int, names: Sequence[str]) -> pl.DataFrame:
        """Some rows of some columns; empty, with a note, where a column is damaged."""
        import polars as pl

        try:
            with _quiet():
                return self._frame.select(names).slice(begin, count).collect()
        except (pl.exceptions.PolarsError, OSError, pl.exceptions.PanicException) as error:
            if len(names) == 1:
                self.note("column damaged", names[0], error=first_line(error))
                return pl.DataFrame({names[0]: [None] * count}, schema={names[0]: pl.Float64})
        columns = [self._part(begin, count, [name]) for name in names]
        rows = min(column.height for column in columns)
        return pl.concat([column.head(rows) for column in columns], how="horizontal")

    def _word(self, cells: pl.Series, numbers: Array) -> None:
        """Keep what a column without numbers holds instead."""
        if np.isfinite(numbers).any() or cells.null_count() == len(cells):
            return
        if cells.dtype.base_type().__name__ == "String":
            first = str(cells.drop_nulls()[0])
            self.words.setdefault((self.topic, cells.name), f'text, the first "{printable(first, 30)}"')

    @cached_property
    def _height(self) -> int:
        import polars as pl

        try:
            with _quiet():
                return int(self._frame.select(pl.len()).collect().item())
        except (pl.exceptions.PolarsError, OSError, pl.exceptions.PanicException) as error:
            raise TrialError(
                f"{self.path}: not readable as Parquet ({first_line(error)}); the file is damaged: fetch or"
                " write it again"
            ) from None

    def chunks(self, wanted: Mapping[str, Sequence[str]], share: Share | None = None) -> Iterator[Chunk]:
        """Samples of the columns wanted."""
        (topic, names), *_ = wanted.items()
        needed = list(names)
        clock, counter, last = self._clock, Counter32(), np.nan
        if clock is not None:
            needed += [name for name in (clock.name, clock.rest) if name and name not in needed]
        rows = self._height
        claim(8 * rows * len(needed))
        for begin in range(0, rows, READING_SETTINGS.chunk_rows):
            part = self._part(begin, min(READING_SETTINGS.chunk_rows, rows - begin), needed)
            values = [_numbers(part[name]) for name in names]
            for name, value in zip(names, values, strict=True):
                self._word(part[name], value)
            stamps = np.full(part.height, np.nan)
            if clock is not None and clock.scale is None:
                dated = clock_times(part[clock.name])
                if dated is not None:
                    stamps = dated[0] if dated[1] else after(dated[0], last)
                    last = float(np.nanmax(stamps))
            elif clock is not None and clock.scale is not None:
                with np.errstate(invalid="ignore", over="ignore"):  # damaged numbers
                    counts = counter.of(_numbers(part[clock.name]))
                    stamps = (counts - clock.scale.origin) * clock.scale.factor
                    if clock.rest is not None:
                        stamps = stamps + 1e-9 * _numbers(part[clock.rest])
            yield Chunk(topic, stamps, np.stack(values, axis=1) if values else np.empty((part.height, 0)))
            if share is not None:
                share(min(1.0, (begin + READING_SETTINGS.chunk_rows) / rows))


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep polars from writing the trace of each thread that a damaged file stops."""
    kept = os.dup(2)
    try:
        with Path(os.devnull).open("wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
            yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def _numbers(cells: pl.Series) -> Array:
    """Cells as numbers; dates as Unix times in s."""
    import polars as pl

    if cells.dtype.is_temporal():
        dated = clock_times(cells)
        return np.full(len(cells), np.nan) if dated is None else dated[0]
    return np.asarray(cells.cast(pl.Float64, strict=False).to_numpy().astype(float))
