"""Comma-separated values: one header line, then rows; also tabs and semicolons, found from the header.

Every cell is read as text, so that the column map can name the row and the value of a cell that is no number.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from seatrial.base.errors import TrialError

if TYPE_CHECKING:
    import polars as pl

__all__ = ["read"]

_HEAD = 4096


def read(path: Path) -> pl.DataFrame:
    """Table of text cells with the header's names; an empty cell is null.

    Raises
    ------
    TrialError
        If the file is no text, has no header or a row has more cells than the header.
    """
    import polars as pl

    with path.open("rb") as stream:
        if b"\0" in stream.read(_HEAD):
            raise TrialError(
                f"{path}: not a text file in UTF-8 (it holds null bytes); expected one header line and rows"
                " of values; save it as UTF-8 text, or name its reader"
            )
    with path.open(encoding="utf-8", errors="replace") as file:
        header = next((line for line in file if line.strip() and not line.startswith("#")), "")
    separator = max(",;\t", key=header.count)
    try:
        # A bracket in a file's name is no pattern.
        return pl.read_csv(path, separator=separator, infer_schema=False, comment_prefix="#", glob=False)
    except pl.exceptions.PolarsError as error:
        reason = str(error).splitlines()[0]
        raise TrialError(
            f"{path}: not readable as a table of values separated by {separator!r} ({reason}); "
            "expected one header line and rows with as many cells; repair the file or name its reader"
        ) from None
