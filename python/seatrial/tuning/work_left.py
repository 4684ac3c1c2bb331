"""How much of a tuning is done, and how long the rest takes at most.

The work of a search is the time that its candidates fly if it uses its whole budget: what it costs to the
processor is about proportional to that. A second turn of all groups counts from the beginning and falls away
where it is not needed, so that the time left is one that may shorten and hardly ever grows. What an earlier
run left behind counts as done, but says nothing of the pace.

Held by tests/test_tuning_progress.py.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping

__all__ = ["WorkLeft"]

_PACE = 1.0 / 60_000.0  # s per s of flight before anything was measured: about two cores
_BEGUN = 0.02  # of all work, that the first guess of the pace counts as


class WorkLeft:
    """Work of named parts, done and to do.

    Parameters
    ----------
    parts : mapping of str to float
        Time flown at most by each part, s.
    clock : callable, optional
        Now, s.

    Examples
    --------
    >>> now = iter([0.0, 10.0])
    >>> work = WorkLeft({"heave": 1e6, "surge": 3e6}, clock=lambda: next(now))
    >>> work.begin("heave")
    >>> round(work.done("heave", 1.0), 2)
    0.25
    """

    def __init__(self, parts: Mapping[str, float], *, clock: Callable[[], float] = time.monotonic) -> None:
        self._left = dict(parts)
        self._all = max(sum(self._left.values()), 1e-9)
        self._clock = clock
        self._worked, self._took = 0.0, 0.0
        self._began = 0.0

    def begin(self, name: str) -> None:
        """A part is searched from now on; one that was not planned comes on top."""
        self._left.setdefault(name, 0.0)
        self._began = self._clock()

    def done(self, name: str, share: float) -> float:
        """Share of all work that is done, when of the part that was begun this share is."""
        return 1.0 - (self._sum() - share * self._left[name]) / self._all

    def left_s(self, name: str, share: float) -> float:
        """Time left, s, if every part uses its whole budget."""
        part = self._left[name]
        first = _BEGUN * self._all
        worked = self._worked + share * part
        took = self._took + (self._clock() - self._began if part > 0.0 else 0.0)
        pace = (_PACE * first + took) / (first + worked)
        return max(pace * (self._sum() - share * part), 0.0)

    def end(self, name: str, *, kept: bool = False) -> None:
        """A part is over, or was kept by an earlier run."""
        part = self._left.pop(name, 0.0)
        if not kept and part > 0.0:
            self._worked += part
            self._took += self._clock() - self._began

    def keep_only(self, names: Collection[str]) -> None:
        """Parts that are still to do; all others are not needed."""
        self._left = {name: part for name, part in self._left.items() if name in names}

    def _sum(self) -> float:
        return sum(self._left.values())
