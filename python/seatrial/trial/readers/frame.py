"""Frames in memory: polars (eager or lazy), pandas, or a mapping of names to arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from seatrial.base.errors import TrialError

if TYPE_CHECKING:
    import polars as pl

__all__ = ["read"]


def read(source: Any) -> pl.DataFrame:
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
