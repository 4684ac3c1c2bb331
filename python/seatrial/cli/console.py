"""Where the command line prints: answers to standard output, progress and messages to standard error.

A verb prints its answer first (`answer`) and draws afterwards; rich fits tables to the width. Streams may be
closed, full, cut by `head`, or able to show ASCII only: signs that they cannot show are spelt (± as +/-, ° as
deg), and files of the run are written all the same. Held by ``tests/cli/test_streams.py``.
"""

from __future__ import annotations

import codecs
import contextlib
import errno
import io
import os
import sys
import time
import unicodedata
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import typer

from seatrial.base.errors import SeatrialError

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.console import Console
    from rich.table import Table as RichTable

    from seatrial.base.fleet import Fleet
    from seatrial.base.report import Report, Table
    from seatrial.base.work import Progress as State
    from seatrial.report.page.run_folder import RunFolder


class Code(IntEnum):
    """Exit codes beside 0; the last two are 128 and the number of the signal, as a shell has them."""

    NOT_HELD = 1
    BAD_INPUT = 2
    INTERRUPTED = 130
    BROKEN_PIPE = 141


@dataclass(frozen=True)
class ConsoleSettings:
    """How wide and how often the command line prints."""

    piped_width: int = 118  #: Columns where there is no terminal: the widest table, unbroken.
    line_every_s: float = 5.0  #: Progress without a terminal: a log of an hour stays readable, s.
    slow_s: float = 2.0  #: Recordings that are read faster need no word, s.
    #: Characters of a word that every column has room for; a longer one may go on in the next line.
    longest_word: int = 11


SETTINGS = ConsoleSettings()

_SPELT = {
    "\N{DEGREE SIGN}": "deg",
    "\N{PLUS-MINUS SIGN}": "+/-",
    "\N{MINUS SIGN}": "-",
    "\N{EN DASH}": "-",
    "\N{HORIZONTAL ELLIPSIS}": "...",
    "\N{MULTIPLICATION SIGN}": "x",
    "\N{MIDDLE DOT}": "*",
    "\N{DOT OPERATOR}": "*",
    "\N{RIGHTWARDS ARROW}": "->",
    "\N{LESS-THAN OR EQUAL TO}": "<=",
    "\N{GREATER-THAN OR EQUAL TO}": ">=",
    "\N{ALMOST EQUAL TO}": "~",
    "\N{SUPERSCRIPT TWO}": "2",
    "\N{SUPERSCRIPT THREE}": "3",
}


def _spell(error: UnicodeError) -> tuple[str | bytes, int]:
    """Signs that an encoding lacks, in letters that it has."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    signs = error.object[error.start : error.end]
    spelt = "".join(_SPELT.get(sign) or unicodedata.normalize("NFKD", sign) for sign in signs)
    return spelt.encode("ascii", "ignore").decode() or "?" * len(signs), error.end


def ready() -> None:
    """Make the standard streams such that nothing printed can fail for its letters or a closed stream."""
    for descriptor, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            # Else the next file that is opened gets the number of the stream.
            taken = os.open(os.devnull, os.O_RDWR)
            if taken != descriptor:
                os.dup2(taken, descriptor)
                os.close(taken)
            setattr(sys, name, open(descriptor, "r" if name == "stdin" else "w", encoding="utf-8"))  # noqa: SIM115, PTH123
    codecs.register_error("seatrial.spelt", _spell)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="seatrial.spelt")


def _takes(stream: TextIO) -> bool:
    """Whether a stream takes what is printed."""
    try:
        stream.flush()
    except (OSError, ValueError):  # full, closed, or its reader is gone: the answer to the question
        return False
    return True


def still() -> None:
    """Let the interpreter end without a word about streams that take no more."""
    for stream in (sys.stdout, sys.stderr):
        if not _takes(stream):
            with contextlib.suppress(OSError, ValueError):  # there is no stream left on which to say it
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, stream.fileno())
                os.close(nowhere)


@contextlib.contextmanager
def printing() -> Iterator[None]:
    """Say of an error that standard output had it."""
    try:
        yield
        sys.stdout.flush()
    except OSError as error:
        raise OSError(error.errno, error.strerror, "standard output") from None


def note(line: str) -> None:
    """Print a line on standard error; only a reader that is gone ends the work, not a full disk."""
    try:
        print(line, file=sys.stderr, flush=True)
    except BrokenPipeError:
        raise
    except OSError:  # there is no other stream on which to say it
        still()


def complain(message: str) -> None:
    """Print a message on standard error."""
    note(f"seatrial: {message}")


def _nowhere() -> bool:
    """Whether the working directory was removed under the process."""
    try:
        os.getcwd()  # noqa: PTH109
    except FileNotFoundError:
        return True
    return False


def exit_code(error: OSError) -> int:
    """Exit code after a file or a stream failed; what happened is said on standard error."""
    if error.errno == errno.EPIPE:
        still()
        return Code.BROKEN_PIPE
    if error.errno == errno.ENOENT and not error.filename and _nowhere():
        complain("the working directory is gone; change to a folder that is there, then run again")
        return Code.BAD_INPUT
    full = error.errno in (errno.ENOSPC, errno.EDQUOT)
    where = f"{error.filename}: " if error.filename else ""
    advice = "free some space and run again" if full else "check the path and its permissions"
    complain(f"{where}{error.strerror or error}; {advice}")
    still()
    return Code.BAD_INPUT


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
            ctx.exit(Code.INTERRUPTED)
        ctx.exit(Code.BAD_INPUT)
        return None


def output() -> Console:
    """Console of standard output, wide enough for tables when it is no terminal."""
    from rich.console import Console

    class Output(Console):
        def on_broken_pipe(self) -> None:
            raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))

    return Output(width=None if sys.stdout.isatty() else SETTINGS.piped_width, highlight=False)


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


def reported(
    page: Path | None, runs: Sequence[Path | RunFolder], *, title: str = "", quiet: bool = False
) -> None:
    """Write runs as a page where one was asked for, and say where it is."""
    if page is None:
        return
    from seatrial.report.page.page import PAGE_SETTINGS, write_page

    written = write_page(runs, page, title=title)
    size = written.stat().st_size
    if not quiet:
        large = "" if size <= PAGE_SETTINGS.largest_bytes else "; give fewer runs for a smaller one"
        say(f"Report: {written} ({size / 1e6:.1f} MB{large})")


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
        if state.elapsed_s > SETTINGS.slow_s:
            note(f"{100 * state.fraction:3.0f} %  {state.words}")

    return None if quiet else show


def _lines() -> Callable[[float, str, Sequence[str]], None]:
    last = time.monotonic()

    def show(share: float, words: str, notes: Sequence[str]) -> None:
        nonlocal last
        for sentence in notes:
            note(sentence)
        if time.monotonic() - last >= SETTINGS.line_every_s:
            last = time.monotonic()
            note(f"{100 * share:3.0f} %  {words}")

    return show


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
    return min(max((len(word) for cell in cells for word in cell.split()), default=0), SETTINGS.longest_word)


def _say(console: Console, text: str, *, style: str | None = None) -> None:
    """Print text as it is: no markup, no numbers in colour, lines wrapped by the terminal alone."""
    console.print(text, style=style, soft_wrap=True, markup=False, highlight=False)
