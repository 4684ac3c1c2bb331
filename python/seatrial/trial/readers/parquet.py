"""Apache Parquet: a typed table in columns."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from seatrial.base.budget import claim
from seatrial.base.errors import TrialError

if TYPE_CHECKING:
    import polars as pl


def read(path: Path) -> pl.DataFrame:
    """Table with the file's own column names.

    Raises
    ------
    TrialError
        If the file is no Parquet file.
    """
    import polars as pl

    try:
        table = pl.scan_parquet(path, glob=False)
        claim(8 * len(table.collect_schema()) * table.select(pl.len()).collect().item())
        return table.collect()
    except (pl.exceptions.PolarsError, OSError) as error:
        reason = str(error).splitlines()[0]
        raise TrialError(f"{path}: not readable as Parquet ({reason}); is it another format?") from None
