"""A report on a terminal: three lines in bold, then tables and sentences; rich fits tables to the width."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console
    from rich.table import Table as RichTable

    from seatrial.base.report import Report, Table

_LONGEST_WORD = 11
"""Characters of a word that every column has room for; a longer one may go on in the next line."""


def show(report: Report, console: Console, *, verbose: bool = False) -> None:
    """Print a report; details only when `verbose`, else a line that says how many there are.

    Parameters
    ----------
    report : Report
    console : Console
        Of rich.
    verbose : bool, optional
        Whether to print details too.
    """
    for line in report.lines():
        _say(console, line, style="bold")
    for section in report.shown(verbose=verbose):
        console.print()
        if section.title:
            _say(console, section.title, style="bold")
        for table in section.tables:
            console.print(rich_table(table, width=console.width), crop=False)
            if table.note:
                _say(console, table.note)
                console.print()
        for sentence in section.sentences:
            _say(console, f"- {sentence}")
    console.print()
    if not verbose and report.hidden:
        _say(console, f"{report.hidden} more tables and remarks: --verbose")


def rich_table(table: Table, *, width: int) -> RichTable:
    """A table of rich for a terminal of so many columns, without columns that are empty in every row."""
    from rich import box
    from rich.table import Table as Made

    shown = table.filled()
    # Where a terminal is too narrow, heads of numbers break at spaces, then at hyphens and with less space
    # between columns; text wraps, and neither short words nor numbers are broken: lines are then too long.
    heads = [column.head for column in shown.columns]
    for broken in (" ", "-"):
        if tight := _width(heads, shown) > width:
            heads = [
                head.replace(broken, broken.strip() + "\n") if column.align == "right" else head
                for head, column in zip(heads, shown.columns, strict=True)
            ]
    narrowest = [_narrowest(head, k, shown) for k, head in enumerate(heads)]
    least = sum(narrowest) + (2 if tight else 3) * len(heads)
    made = Made(
        title=shown.title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False,
        collapse_padding=tight, width=least if least > width else None,
    )  # fmt: skip
    for head, column, own in zip(heads, shown.columns, narrowest, strict=True):
        whole = column.align == "right"
        made.add_column(head, justify=column.align, no_wrap=whole, overflow="fold", min_width=own)
    for row in shown.rows:
        made.add_row(*row)
    return made


def _width(heads: Sequence[str], table: Table) -> int:
    """Width of a table with these heads, of several lines each, with three spaces between columns."""
    cells = [[*head.split("\n"), *(row[k] for row in table.rows)] for k, head in enumerate(heads)]
    return sum(max(map(len, column)) for column in cells) + 3 * len(cells)


def _narrowest(head: str, place: int, table: Table) -> int:
    """Least width of a column: of the widest number, or of the longest word."""
    cells = [head, *(row[place] for row in table.rows)]
    if table.columns[place].align == "right":
        return max(len(line) for cell in cells for line in cell.split("\n"))
    return min(max((len(word) for cell in cells for word in cell.split()), default=0), _LONGEST_WORD)


def _say(console: Console, text: str, *, style: str | None = None) -> None:
    """Print text as it is: no markup, no numbers in colour, lines wrapped by the terminal alone."""
    console.print(text, style=style, soft_wrap=True, markup=False, highlight=False)
