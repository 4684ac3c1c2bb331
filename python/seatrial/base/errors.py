"""The one tree of errors: a message names file, key or row, what was expected and found, what to do.

Each class is also a subclass of a builtin, so that callers may catch either. The command line turns them all
into exit code 2. A diverged simulation of one vehicle is a `DivergenceError`; among candidates of a search
and as the outcome of a flight it is a number.
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


class SeatrialError(Exception):
    r"""Base of every error that seatrial raises on purpose.

    Its message may quote names from a stranger's file: signs that a terminal would obey are spelt out.

    Examples
    --------
    >>> str(SeatrialError("topic \x1b[2J\u202eabc: no time"))
    'topic \\x1b[2J\\u202eabc: no time'
    """

    def __str__(self) -> str:
        """The message in signs that can be shown."""
        text = super().__str__()
        if text.replace("\n", "").isprintable():
            return text
        return "".join(sign if sign.isprintable() or sign == "\n" else repr(sign)[1:-1] for sign in text)


class VehicleError(SeatrialError, ValueError):
    """A vehicle, autopilot or mission file, or a value for one, is not usable."""


class TrialError(SeatrialError, ValueError):
    """A recording, its column map or the use made of it is not usable."""


class CampaignError(SeatrialError, ValueError):
    """A campaign file, or what it asks for, is not usable."""


class SimulationError(SeatrialError, RuntimeError):
    """A simulation cannot be started with these inputs."""


class NumericalError(SeatrialError, ArithmeticError):
    """A calculation has no finite result: a filter that diverges, a model that no step can follow."""


class DivergenceError(SimulationError):
    """A simulated motion diverged: when, in which axis, the likely cause, and what to do."""


def reason(error: Exception) -> str:
    """Why a file cannot be read or written, as the operating system says it, without its number.

    Examples
    --------
    >>> try:
    ...     open("nowhere/log.csv")
    ... except OSError as error:
    ...     print(reason(error))
    No such file or directory
    """
    if isinstance(error, UnicodeDecodeError):
        return "not a text file in UTF-8"
    return str(getattr(error, "strerror", None) or error)


def nearest(name: str, known: Iterable[str]) -> str:
    """Clause "; did you mean ...?" for an unknown `name`, or all known names if none is near.

    Examples
    --------
    >>> nearest("u_ms", ["u_m_s", "v_m_s"])
    '; did you mean "u_m_s"?'
    """
    names = list(known)
    folded = {candidate.casefold(): candidate for candidate in names}
    close = get_close_matches(name.casefold(), folded, n=1, cutoff=0.6)
    if close:
        return f'; did you mean "{folded[close[0]]}"?'
    return "; known: " + ", ".join(names)


def printable(name: str, longest: int = 60) -> str:
    """A name from a file as it may be shown: no control characters, not too long."""
    plain = name if name.isprintable() else repr(name)[1:-1]
    return plain if len(plain) <= longest else plain[: longest - 3] + "..."


def first_line(error: BaseException) -> str:
    """What a package says first of a damaged file; it may quote the file at any length."""
    return printable((str(error).splitlines() or [type(error).__name__])[0], 200)


def foreign(error: BaseException) -> str:
    """What a package says that a damaged file upset, in one line."""
    words = printable(" ".join(str(error).split()), 200)
    return f"{type(error).__name__}: {words}" if words else type(error).__name__
