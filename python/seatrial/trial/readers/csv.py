"""Comma-separated values, and other tables of text, as their layout says (`seatrial.logs.layout`).

Columns whose first rows are numbers are read as numbers, which takes a quarter of the memory of text. Where a
later cell is none, every cell is read as text, so that the column map can name its row and its value.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from seatrial.base.errors import TrialError

if TYPE_CHECKING:
    import polars as pl

    from seatrial.logs.layout import Layout

_HEAD = 100
"""Rows that tell a column of numbers from one of text."""


def read(path: Path) -> pl.DataFrame:
    """Table of numbers and text, named by its row of names; an empty cell is null, a decimal comma a point.

    Raises
    ------
    TrialError
        If the file is no text, has no header or a row has more cells than the header.
    """
    import polars as pl

    from seatrial.logs.delimited import Table, stripped

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
        reason = str(error).splitlines()[0]
        raise TrialError(
            f"{path}: not readable as a table of values separated by {separator!r} ({reason}); "
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


def units(path: Path) -> dict[str, str]:
    """Units that a row of units or brackets behind a name state, by column."""
    layout = _layout(path)
    if layout is None:
        return {}
    return {name: unit for name, unit in zip(layout.names, layout.units, strict=True) if unit}


def twice(path: Path) -> Mapping[str, tuple[int, ...]]:
    """Places, from 1, of the columns that share a name, by the name."""
    layout = _layout(path)
    return {} if layout is None else layout.twice


def _layout(path: Path) -> Layout | None:
    """Layout of the table; None where it shows no row of numbers: what is wrong with it is said later."""
    from seatrial.logs.layout import encoding_of, layout_of

    encoding_of(path)
    try:
        return layout_of(path)
    except TrialError:
        return None


def _plain(layout: Layout) -> bool:
    """Whether it is a table of UTF-8 text that polars reads as it is."""
    simple = layout.encoding.startswith("utf-8") and layout.separator != " " and not layout.decimal_comma
    return simple and layout.plain
