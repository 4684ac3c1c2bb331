"""Comma-separated values, and other tables of text, as their layout says (`seatrial.logs.delimited`).

Every cell is read as text, so that the column map can name the row and the value of a cell that is no number.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from seatrial.base.errors import TrialError

if TYPE_CHECKING:
    import polars as pl

    from seatrial.logs.delimited import Layout

__all__ = ["read", "units"]


def read(path: Path) -> pl.DataFrame:
    """Table of text cells with the names of its row of names; an empty cell is null, a decimal comma a point.

    Raises
    ------
    TrialError
        If the file is no text, has no header or a row has more cells than the header.
    """
    import polars as pl

    from seatrial.logs.delimited import Table

    layout = _layout(path)
    if layout is not None and not _plain(layout):
        parts = list(Table(path, "csv", layout=layout).cells())
        table = pl.concat(parts) if parts else pl.DataFrame(schema=dict.fromkeys(layout.names, pl.String))
        return (
            table.with_columns(pl.all().str.replace(",", ".", literal=True))
            if layout.decimal_comma
            else table
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


def units(path: Path) -> dict[str, str]:
    """Units that a row of units or brackets behind a name state, by column."""
    layout = _layout(path)
    if layout is None:
        return {}
    return {name: unit for name, unit in zip(layout.names, layout.units, strict=True) if unit}


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
