"""A report on a terminal: three lines in bold, then tables and sentences; rich fits tables to the width."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table as RichTable

    from seatrial.base.report import Report, Table

__all__ = ["rich_table", "show"]


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
            console.print(rich_table(table, width=console.width))
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
    longest = [
        max(len(text) for text in (column.head, *(row[k] for row in shown.rows)))
        for k, column in enumerate(shown.columns)
    ]
    narrow = sum(longest) + 3 * len(longest) > width
    made = Made(
        title=shown.title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False,
        collapse_padding=narrow,
    )  # fmt: skip
    for column in shown.columns:
        # Where a terminal is too narrow, heads break at spaces and hyphens, the space between columns shrinks
        # and text wraps; numbers are never broken.
        number = column.align == "right"
        head = column.head.replace("-", "-\n").replace(" ", "\n") if number and narrow else column.head
        made.add_column(head, justify=column.align, no_wrap=number, overflow="fold")
    for row in shown.rows:
        made.add_row(*row)
    return made


def _say(console: Console, text: str, *, style: str | None = None) -> None:
    """Print text as it is: no markup, no numbers in colour, lines wrapped by the terminal alone."""
    console.print(text, style=style, soft_wrap=True, markup=False, highlight=False)
