"""Standard streams as a shell gives them: closed, full, cut by `head`, or able to show ASCII only.

Signs that a stream cannot show are spelt (± as +/-, ° as deg). What a closed stream would show is dropped. A
reader that goes away, as `head` does, ends the verb quietly with 141, the code of a process that a broken
pipe ends; files of the run are written all the same.
Held by ``tests/cli/test_streams.py``.
"""

from __future__ import annotations

import codecs
import contextlib
import errno
import io
import os
import sys
import unicodedata
from collections.abc import Iterator
from typing import TextIO

BAD_INPUT, INTERRUPTED, BROKEN_PIPE = 2, 130, 141  # the latter two are 128 and the number of the signal

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
    """Say of an error that standard output had it.

    Raises
    ------
    OSError
        It takes no more.
    """
    try:
        yield
        sys.stdout.flush()
    except OSError as error:
        raise OSError(error.errno, error.strerror, "standard output") from None


def note(line: str) -> None:
    """Print a line on standard error; one that cannot take it ends no work, only a reader that is gone does.

    Raises
    ------
    BrokenPipeError
        The reader is gone.
    """
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
        return BROKEN_PIPE
    if error.errno == errno.ENOENT and not error.filename and _nowhere():
        complain("the working directory is gone; change to a folder that is there, then run again")
        return BAD_INPUT
    full = error.errno in (errno.ENOSPC, errno.EDQUOT)
    where = f"{error.filename}: " if error.filename else ""
    advice = "free some space and run again" if full else "check the path and its permissions"
    complain(f"{where}{error.strerror or error}; {advice}")
    still()
    return BAD_INPUT
