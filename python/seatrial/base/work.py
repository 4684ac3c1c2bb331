"""`Work`: on what a run computes, where it keeps its results, and whom it informs of its `Progress`.

`takes` marks functions that take such objects in place of stacks of keywords: a keyword that is a field of
one is refused with the call that replaces it.

Linear algebra of NumPy and SciPy gets one thread: its matrices have tens of rows, and a second thread waits
for the next product by spinning, which costs everybody else's time. The command line sets the variables that
the libraries read when they are loaded (`one_for_this_process`); used as a library, NumPy is loaded already,
and `one_blas_thread` limits it while a function works. A number that the user has set stays in both. Held by
``tests/base/test_work.py`` and ``tests/base/test_blas_threads.py``.
"""

from __future__ import annotations

import contextlib
import html
import math
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from datetime import UTC, datetime, timedelta
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, Self, TypeVar, cast

if TYPE_CHECKING:
    from seatrial.base.fleet import Workers


class Clock:
    """Time since some work began."""

    def __init__(self) -> None:
        self.started = datetime.now(UTC)  #: When it began, UTC.
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
    """State of long work: a search, a series of missions, repetitions, a plan."""

    what: str  #: Part of the work that is under way: stage, group of gains, autopilot, repetition, trial.
    #: `done`, `total`: parts (or missions, repetitions) that are finished, and all of them.
    done: int
    total: int
    fraction: float  #: Share of all work that is done.
    elapsed_s: float  #: Time so far, s.
    #: Time left, s; of a search, if it uses its whole budget. NaN while nothing is known of it.
    left_s: float
    step: Step | None = None  #: State of the search that is under way; None where nothing is searched.
    detail: str = ""  #: More words on it.
    #: Sentences to show at once: what the data cannot determine, known before the search.
    notes: tuple[str, ...] = ()

    @property
    def best(self) -> float:
        """Best cost of the search so far; NaN where nothing is searched."""
        return math.nan if self.step is None else self.step.best

    @property
    def words(self) -> str:
        """What runs, how far, the best cost and the time left, in a line."""
        head, step = self.what, self.step
        if self.total and not self.detail:
            head += f" [{min(self.done + 1, self.total)}/{self.total}]"
        words = [self.detail] if self.detail else []
        if step is not None:
            what = ["round"] if step.phase == "polish" else [step.phase, "generation"]
            words += [*what[:-1], f"{what[-1]} {step.generation} of at most {step.generations}"]
            words.append(f"best {step.best:.4g}")
        # The first generations load and warm up what the later ones find ready.
        if math.isfinite(self.left_s) and (step is None or step.generation >= 5):
            left = f"{self.left_s:.0f} s" if self.left_s < 90 else f"{self.left_s / 60:.0f} min"
            words.append(f"{'about' if step is None else 'at most'} {left} left")
        return f"{head}: {', '.join(words)}" if words else head


class ProgressBar:
    """Progress of a run as a bar, in a notebook or on a terminal: ``st.Work(progress=st.ProgressBar())``.

    In a notebook the bar stands in the cell's output; elsewhere a line on standard error takes its place.

    Parameters
    ----------
    every_s : float
        Least time between two states that are shown, s: a notebook keeps every one.
    """

    def __init__(self, *, every_s: float = 0.2) -> None:
        self._every_s = every_s
        ipython = sys.modules.get("IPython")  # nobody else has loaded it than a notebook or its shell
        shell = ipython.get_ipython() if ipython is not None else None
        self._display = ipython.display if ipython is not None and hasattr(shell, "kernel") else None
        self._begin()

    def _begin(self) -> None:
        self._cell: Any = None
        self._clock: Clock | None = None
        self._last = -math.inf

    def __call__(self, state: Progress) -> None:
        """Show the state of the work, where the one before is old enough."""
        self._clock = self._clock or Clock()
        if time.monotonic() - self._last >= self._every_s:
            self._last = time.monotonic()
            self._show(state.fraction, state.words)

    def finish(self) -> None:
        """Show that the work is done and what it took, s; the next one has a bar of its own."""
        if self._clock is not None:
            self._show(1.0, f"done, {self._clock.elapsed_s:.0f} s", end="\n")
        self._begin()

    def _show(self, fraction: float, words: str, *, end: str = "") -> None:
        text = f"{100 * fraction:3.0f} %  {words}"
        if self._display is None:
            print(f"\r{text[:110]:110}", end=end, file=sys.stderr, flush=True)
            return
        bar = self._display.HTML(f"<progress value={fraction:.4f}></progress> {html.escape(text)}")
        if self._cell is None:
            self._cell = self._display.display(bar, display_id=True)
        else:
            self._cell.update(bar)


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
            result = function(*args, **kwargs)
        except _OfTheCaller as carried:
            if carried.call is not call:
                raise
            error = carried.error
        else:
            if isinstance(given, ProgressBar):
                given.finish()
            return result
        raise error  # outside of the handler, so that it has the context that it was raised with

    return passing


def part_of(
    progress: Callable[[Progress], None], part: str, number: int, count: int, clock: Clock
) -> Callable[[Progress], None]:
    """Callback for one of `count` equal parts of long work, from 0, which reports the progress of the whole.

    What the part reports itself follows its name; `clock` is that of the whole.
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


P = ParamSpec("P")
R = TypeVar("R")


@dataclass(frozen=True, eq=False, kw_only=True)
class Work:
    """How the work of a run is done. No result depends on threads or executor.

    Attributes
    ----------
    threads : int, optional
        Threads of the core; by default all, with an executor one per worker.
    executor : Executor, str or distributed.Client, optional
        Where parts of the work are done: a `concurrent.futures` executor, the address of a Dask scheduler
        ("tcp://HOST:8786"), "local" or "local:N" for a Dask cluster on this machine.
    run_dir : str or Path, optional
        Folder for the results. Finished parts are kept in it, and in its sibling while the run goes on.
    resume : bool
        Reuse the parts that an earlier run in this folder finished from the same inputs.
    progress : callable, optional
        Called in the caller's thread with a `Progress` after every part.

    Examples
    --------
    >>> import seatrial as st
    >>> st.Work(threads=2, run_dir="runs/cwolf").resume
    True
    """

    threads: int | None = None
    executor: Workers | None = None
    run_dir: str | Path | None = None
    resume: bool = True
    progress: Callable[[Progress], None] | None = None


HERE = Work()
"""All threads of this process, nothing kept."""


def tell(work: Work, fraction: float, what: str) -> None:
    """Report the share of a work that is done, and what is being done."""
    if work.progress is not None:
        work.progress(Progress(what, 0, 0, fraction, math.nan, math.nan))


def within(work: Work, first: float, last: float) -> Work:
    """Work on a part of a whole: its progress from 0 to 1 is reported as that from `first` to `last`."""
    whole = work.progress
    if whole is None:
        return work
    return replace(
        work, progress=lambda state: whole(replace(state, fraction=first + (last - first) * state.fraction))
    )


def takes(**kinds: type[Any]) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator of a function whose parameters of these names hold dataclasses of these kinds.

    Raises `TypeError`: of the decorated function: a keyword is a field of one of them, or an object is of
    another kind.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Water:
    ...     current: float = 0.0
    >>> @takes(water=Water)
    ... def fly(*, water=Water()):
    ...     return water.current
    >>> fly(current=0.3)
    Traceback (most recent call last):
    TypeError: fly: current is a field of st.Water; give water=st.Water(current=...)
    """

    def decorated(function: Callable[P, R]) -> Callable[P, R]:
        called = function.__qualname__.removesuffix(".__init__").rpartition(".")[2]
        # A field that is a parameter of the function, too, is its own.
        names = set(function.__annotations__)
        homes = {
            field.name: (parameter, kind)
            for parameter, kind in kinds.items()
            for field in fields(kind)
            if field.name not in names
        }

        @wraps(function)
        def checked(*args: P.args, **kwargs: P.kwargs) -> R:
            for keyword, value in kwargs.items():
                if keyword in homes:
                    parameter, kind = homes[keyword]
                    raise TypeError(
                        f"{called}: {keyword} is a field of st.{kind.__name__}; give"
                        f" {parameter}=st.{kind.__name__}({keyword}=...)"
                    )
                if keyword in kinds and not isinstance(value, kinds[keyword]):
                    name = kinds[keyword].__name__
                    raise TypeError(
                        f"{called}: {keyword}: expected an st.{name}, found {value!r}; give"
                        f" {keyword}=st.{name}(...)"
                    )
            return function(*args, **kwargs)

        return checked

    return decorated


VARIABLES = (
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "OMP_NUM_THREADS",
)
"""What OpenBLAS, MKL, BLIS and Accelerate read; the last counts for most where their own is absent."""


def one_for_this_process() -> None:
    """Set one thread for the linear algebra of this process and its children, before NumPy is loaded.

    Does nothing where the user has set a number for any of the libraries.
    """
    if not any(name in os.environ for name in VARIABLES):
        os.environ.update(dict.fromkeys(VARIABLES[:-1], "1"))


class _Limit:
    """The limit of this process, shared by all threads that work under it."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.users = 0
        self.limiter: Any = None

    def enter(self) -> None:
        """Limit the libraries for the first of the users."""
        with self.lock:
            if self.users == 0:
                # SciPy brings a library of its own, which is limited only once it is loaded.
                import scipy.linalg  # noqa: F401
                from threadpoolctl import threadpool_limits

                self.limiter = threadpool_limits(limits=1, user_api="blas")
            self.users += 1

    def leave(self) -> None:
        """Give the threads back after the last of the users."""
        with self.lock:
            self.users -= 1
            if self.users == 0:
                self.limiter.restore_original_limits()
                self.limiter = None


_LIMIT = _Limit()


@contextlib.contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit the linear algebra of this process to one thread for as long as any of these contexts is open.

    Does nothing where the environment says how many threads to use.
    """
    if any(name in os.environ for name in VARIABLES):
        yield
        return
    _LIMIT.enter()
    try:
        yield
    finally:
        _LIMIT.leave()
