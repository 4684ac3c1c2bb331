"""`Work`: on what a run computes, where it keeps its results, and whom it informs.

`takes` marks functions that take such objects in place of stacks of keywords: a keyword that is a field of
one is refused with the call that replaces it. Held by ``tests/base/test_work.py``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from seatrial.base.progress import Progress

if TYPE_CHECKING:
    from seatrial.base.fleet import Workers

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


def takes(**kinds: type[Any]) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator of a function whose parameters of these names hold dataclasses of these kinds.

    Parameters
    ----------
    **kinds : dataclass by parameter name

    Raises
    ------
    TypeError
        Of the decorated function: a keyword is a field of one of them, or an object is of another kind.

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
                        f"{function.__name__}: {keyword} is a field of st.{kind.__name__}; give"
                        f" {parameter}=st.{kind.__name__}({keyword}=...)"
                    )
                if keyword in kinds and not isinstance(value, kinds[keyword]):
                    name = kinds[keyword].__name__
                    raise TypeError(
                        f"{function.__name__}: {keyword}: expected an st.{name}, found {value!r}; give"
                        f" {keyword}=st.{name}(...)"
                    )
            return function(*args, **kwargs)

        return checked

    return decorated
