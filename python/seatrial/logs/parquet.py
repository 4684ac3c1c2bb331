"""Apache Parquet: a table in columns, read in row groups."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError
from seatrial.logs.clock import TimeScale, scale_of, time_fields
from seatrial.logs.log import CHUNK_ROWS, Chunk, Log, Share

if TYPE_CHECKING:
    import polars as pl

__all__ = ["open_log"]


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

        try:
            return self._frame.collect_schema()
        except (pl.exceptions.PolarsError, OSError) as error:
            why = str(error).splitlines()[0]
            raise TrialError(f"{self.path}: not readable as Parquet ({why}); is it another format?") from None

    @cached_property
    def fields(self) -> Mapping[str, Mapping[str, str]]:
        """Columns of numbers and times."""
        kept = {
            name: ""
            for name, kind in self._schema.items()
            if kind.is_numeric() or kind.is_temporal() or kind.base_type().__name__ in ("Boolean", "Null")
        }
        return {self.path.stem: kept}

    @cached_property
    def _clock(self) -> tuple[str, TimeScale | None] | None:
        """Column of the time and its scale (None: it holds dates)."""
        names = list(self.fields[self.path.stem])
        dated = [name for name in names if self._schema[name].is_temporal()]
        candidates = dated + time_fields(names)
        if not candidates:
            self.note("no column is a time: name one in the map, or this file cannot be used")
            return None
        name = candidates[0]
        if self._schema[name].is_temporal():
            self.epoch_s = 0.0
            return name, None
        head = self._part(0, 2_000, [name])[name]
        scale = scale_of(name, "", _numbers(head))
        if scale.unix:
            self.epoch_s = 0.0
        if scale.how:
            self.note(f'time "{name}": {scale.how}')
        return name, scale

    def _part(self, begin: int, count: int, names: Sequence[str]) -> pl.DataFrame:
        import polars as pl

        try:
            return self._frame.select(names).slice(begin, count).collect()
        except (pl.exceptions.PolarsError, OSError, pl.exceptions.PanicException) as error:
            why = str(error).splitlines()[0]
            raise TrialError(
                f"{self.path}: row {begin + 1}: not readable ({why}); the file is damaged"
            ) from None

    def chunks(self, wanted: Mapping[str, Sequence[str]], share: Share | None = None) -> Iterator[Chunk]:
        """Samples of the columns wanted."""
        import polars as pl

        (topic, names), *_ = wanted.items()
        needed = list(names)
        if self._clock is not None and self._clock[0] not in needed:
            needed.append(self._clock[0])
        rows = int(self._frame.select(pl.len()).collect().item())
        for begin in range(0, rows, CHUNK_ROWS):
            part = self._part(begin, CHUNK_ROWS, needed)
            values = [_numbers(part[name]) for name in names]
            stamps = np.full(part.height, np.nan)
            if self._clock is not None:
                name, scale = self._clock
                stamps = _numbers(part[name])
                if scale is not None:
                    stamps = (stamps - scale.origin) * scale.factor
            yield Chunk(topic, stamps, np.stack(values, axis=1) if values else np.empty((part.height, 0)))
            if share is not None:
                share(min(1.0, (begin + CHUNK_ROWS) / rows))


def _numbers(cells: pl.Series) -> Array:
    """Cells as numbers; dates as Unix times in s."""
    import polars as pl

    if cells.dtype.is_temporal():
        unit = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}.get(str(getattr(cells.dtype, "time_unit", "")), 1e-9)
        unit = 86_400.0 if cells.dtype == pl.Date else unit
        return np.asarray(cells.to_physical().cast(pl.Float64).to_numpy().astype(float) * unit)
    return np.asarray(cells.cast(pl.Float64, strict=False).to_numpy().astype(float))
