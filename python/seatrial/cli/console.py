"""Where the command line prints: answers to standard output, progress and messages to standard error.

A verb prints its answer first (`answer`) and draws afterwards. A report is shown as three lines in bold, then
tables and sentences (`show`); rich fits tables to the width.
"""

from __future__ import annotations

import errno
import os
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from seatrial.base.errors import SeatrialError
from seatrial.cli.streams import BAD_INPUT, INTERRUPTED, complain, exit_code, note, printing

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.console import Console
    from rich.table import Table as RichTable

    from seatrial.base.fleet import Fleet
    from seatrial.base.report import Report, Table
    from seatrial.base.work import Progress as State

_PIPED_WIDTH = 118  # columns where there is no terminal: the widest table, unbroken

_LINE_EVERY_S = 5.0  # progress without a terminal: a log of an hour stays readable

_SLOW_S = 2.0
"""Recordings that are read faster need no word."""


class ExitCodes:
    """Mixin of a command or a group: what is raised on purpose becomes one message and an exit code."""

    def make_context(self, *given: Any, **options: Any) -> Any:
        """Context of what is called; help and version are printed here."""
        try:
            with printing():
                return super().make_context(*given, **options)  # type: ignore[misc]
        except OSError as error:
            raise typer.Exit(exit_code(error)) from None

    def invoke(self, ctx: Any) -> Any:
        """Result of what was called."""
        if callable(ctx.obj):
            ctx.obj()
        try:
            return super().invoke(ctx)  # type: ignore[misc]
        except SeatrialError as error:
            complain(str(error))
        except OSError as error:
            ctx.exit(exit_code(error))
        except KeyboardInterrupt:
            complain("interrupted")
            ctx.exit(INTERRUPTED)
        ctx.exit(BAD_INPUT)
        return None


def output() -> Console:
    """Console of standard output, wide enough for tables when it is no terminal."""
    from rich.console import Console

    class Output(Console):
        def on_broken_pipe(self) -> None:
            raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))

    return Output(width=None if sys.stdout.isatty() else _PIPED_WIDTH, highlight=False)


def answer(
    report: Report,
    *,
    verbose: bool = False,
    results: str | Callable[[], str] = "",
    draw: Callable[[], Sequence[Path]] | None = None,
) -> None:
    """Print a report, then where its files are; only then draw, and say where figures are.

    `results` is a sentence on the files that were written, or writes them after the report is shown; `draw`
    writes the figures and gives their paths.
    """
    console = output()
    try:
        with printing():
            show(report, console, verbose=verbose)
    finally:  # a reader that closes the pipe early loses no files
        if callable(results):
            results = results()
    if results:
        say(results)
    if draw is not None:
        list_figures(console, draw())


def say(line: str) -> None:
    """Print a line as it is on standard output."""
    with printing():
        output().print(line, soft_wrap=True, markup=False)


def workers(dask: str | None) -> AbstractContextManager[Fleet | None]:
    """Workers of the Dask cluster that was asked for; what is lost is told on standard error."""
    from seatrial.base.fleet import fleet_of

    return fleet_of(dask, tell=note)


def check_axes(free: str, option: str) -> None:
    """Refuse letters that are no axes, said twice, or none at all."""
    from seatrial.base.errors import TrialError

    if not free or set(free) - set("XYZKMN") or len(set(free)) < len(free):
        raise TrialError(f"{option} {free!r}: expected letters of XYZKMN, each once, at least one")


def print_json(value: Any) -> None:
    """Print plain data as JSON; numbers that are not finite become null."""
    from seatrial.base.run import to_json

    with printing():
        sys.stdout.write(to_json(value))


def list_figures(console: Console, written: Sequence[Path]) -> None:
    """Say where figures are, one line per folder."""
    for folder in dict.fromkeys(path.parent for path in written):
        names = [path.name for path in written if path.parent == folder]
        stems = dict.fromkeys(name.rsplit(".", 1)[0] for name in names)
        endings = " and ".join(dict.fromkeys(name.rsplit(".", 1)[1].upper() for name in names))
        console.print(f"Figures ({endings}) in {folder}: {', '.join(stems)}", soft_wrap=True, markup=False)


@contextmanager
def search_progress(first: str, *, quiet: bool = False) -> Iterator[Callable[[State], None]]:
    """Callback for long work that shows what runs, best cost and time left; `first` stands before that."""
    with long_work(first, quiet=quiet) as show:
        yield lambda state: show(
            state.fraction,
            state.words,
            [note if state.done else f"before the search: {note}" for note in state.notes],
        )


@contextmanager
def long_work(first: str, *, quiet: bool = False) -> Iterator[Callable[[float, str, Sequence[str]], None]]:
    """Callback that shows the share done, words on it and notes to keep; `first` stands before.

    A bar on a terminal, a line every few seconds elsewhere, nothing when quiet.
    """
    if quiet:
        yield lambda *_: None
        return
    if not sys.stderr.isatty():
        yield _lines()
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

    columns = (TextColumn("{task.description}"), BarColumn(bar_width=24), TaskProgressColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(first, total=1.0)

        def show(share: float, words: str, notes: Sequence[str]) -> None:
            for note in notes:
                bar.console.print(note, soft_wrap=True, markup=False, highlight=False)
            bar.update(task, completed=share, description=words)

        yield show


def reading_progress(*, quiet: bool = False) -> Callable[[State], None] | None:
    """Callback that says how far the reading of a recording is where it takes long; None when quiet."""

    def show(state: State) -> None:
        if state.elapsed_s > _SLOW_S:
            note(f"{100 * state.fraction:3.0f} %  {state.words}")

    return None if quiet else show


def _lines() -> Callable[[float, str, Sequence[str]], None]:
    last = time.monotonic()

    def show(share: float, words: str, notes: Sequence[str]) -> None:
        nonlocal last
        for sentence in notes:
            note(sentence)
        if time.monotonic() - last >= _LINE_EVERY_S:
            last = time.monotonic()
            note(f"{100 * share:3.0f} %  {words}")

    return show


_LONGEST_WORD = 11
"""Characters of a word that every column has room for; a longer one may go on in the next line."""


def show(report: Report, console: Console, *, verbose: bool = False) -> None:
    """Print a report; details only when `verbose`, else a line that says how many there are."""
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
