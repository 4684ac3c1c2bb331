"""Progress of long work: what it reports while it runs, and how the time left is estimated."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import wraps
from typing import Any, ParamSpec, Self, TypeVar, cast

P = ParamSpec("P")
R = TypeVar("R")


class Clock:
    """Time since some work began.

    Attributes
    ----------
    started
        When it began, UTC.
    """

    def __init__(self) -> None:
        self.started = datetime.now(UTC)
        self._began = time.monotonic()
        self._wall_s: float | None = None

    @property
    def elapsed_s(self) -> float:
        """Time since then, s; until `stop`, after it."""
        return time.monotonic() - self._began if self._wall_s is None else self._wall_s

    @property
    def reached(self) -> datetime:
        """The time now, UTC; that of `stop`, after it."""
        return self.started + timedelta(seconds=self.elapsed_s)

    def stop(self) -> Self:
        """The clock itself, which goes on no further."""
        self._wall_s = self.elapsed_s
        return self

    def left_s(self, done: float, to_do: float) -> float:
        """Time left, s, if what is to do goes on as fast as what was done; NaN where nothing was done yet."""
        return self.elapsed_s * to_do / done if done > 0.0 else math.nan


@dataclass(frozen=True)
class Step:
    """State of a search after one batch: what a progress display needs and the history keeps."""

    phase: str
    generation: int
    generations: int
    evaluations: int
    best: float
    elapsed_s: float

    @property
    def left_s(self) -> float:
        """Time left in this phase, s, if it uses its whole budget."""
        return self.elapsed_s * (self.generations - self.generation) / max(self.generation, 1)


@dataclass(frozen=True)
class Progress:
    """State of long work: a search, a series of missions, repetitions, a plan.

    Attributes
    ----------
    what
        Part of the work that is under way: stage, group of gains, autopilot, repetition, trial.
    done, total
        Parts (or missions, repetitions) that are finished, and all of them.
    fraction
        Share of all work that is done.
    elapsed_s
        Time so far, s.
    left_s
        Time left, s; of a search, if it uses its whole budget. NaN while nothing is known of it.
    step
        State of the search that is under way; None where nothing is searched.
    detail
        More words on it.
    notes
        Sentences to show at once: what the data cannot determine, known before the search.
    """

    what: str
    done: int
    total: int
    fraction: float
    elapsed_s: float
    left_s: float
    step: Step | None = None
    detail: str = ""
    notes: tuple[str, ...] = ()

    @property
    def best(self) -> float:
        """Best cost of the search so far; NaN where nothing is searched."""
        return math.nan if self.step is None else self.step.best


Watch = Callable[[Step], None]


class _OfTheCaller(BaseException):
    """Carries an exception of a caller's function past every ``except Exception`` on the way."""

    def __init__(self, call: object, error: Exception) -> None:
        super().__init__()
        self.call, self.error = call, error


def callers_errors_pass(function: Callable[P, R]) -> Callable[P, R]:
    """The function, of which what the caller's `progress` or `share` raises comes back as it was raised.

    On its way it passes blocks that make a sentence of all that a damaged file raises, or go on where numbers
    fail: an error of the caller is neither.

    Examples
    --------
    >>> @callers_errors_pass
    ... def work(*, progress=None):
    ...     try:
    ...         progress(0.5)
    ...     except Exception:
    ...         return "went on"
    >>> work(progress=lambda share: 1 / 0)
    Traceback (most recent call last):
    ZeroDivisionError: division by zero
    """

    @wraps(function)
    def passing(*args: P.args, **kwargs: P.kwargs) -> R:
        name = "share" if "share" in kwargs else "progress"
        work: Any = kwargs.get("work")  # an `st.Work`, which holds the function
        given = cast("Callable[..., None] | None", getattr(work, "progress", kwargs.get(name)))
        if given is None:
            return function(*args, **kwargs)
        call = object()  # of nested calls each hands on what its own caller raised

        def progress(*state: Any) -> None:
            try:
                given(*state)
            except Exception as error:
                raise _OfTheCaller(call, error) from None

        if work is None:
            kwargs[name] = progress
        else:
            kwargs["work"] = replace(work, progress=progress)
        try:
            return function(*args, **kwargs)
        except _OfTheCaller as carried:
            if carried.call is not call:
                raise
            error = carried.error
        raise error  # outside of the handler, so that it has the context that it was raised with

    return passing


def part_of(
    progress: Callable[[Progress], None], part: str, number: int, count: int, clock: Clock
) -> Callable[[Progress], None]:
    """Callback for one of several equal parts of long work, which reports the progress of the whole.

    Parameters
    ----------
    progress
        What the whole reports to.
    part
        Name of the part; what it reports itself follows.
    number, count
        Place of the part, from 0, and number of parts.
    clock
        Of the whole.
    """

    def show(state: Progress) -> None:
        fraction = (number + state.fraction) / count
        progress(
            replace(
                state,
                what=f"{part}, {state.what}",
                fraction=fraction,
                elapsed_s=clock.elapsed_s,
                left_s=clock.left_s(fraction, 1.0 - fraction),
            )
        )

    return show
