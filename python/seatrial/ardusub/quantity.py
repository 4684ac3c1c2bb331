"""What a replay compares and what it finds: a logged quantity beside its replay, a parameter with its spread.

Held by ``tests/ardusub/test_replay.py``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.plain import Plain

LIMITS = {"term": 0.01, "pulse": 2.0}
"""Share of a term, and microseconds of a pulse, within which a replay counts as right."""

LONGEST_S = 1.0
"""What follows from its own row alone may be off for so long at a stretch, s: a row that was logged
between two periods is off by itself, what fails stays off."""

_GAP_S = 0.5  # between rows of one stretch


@dataclass(frozen=True)
class Found:
    """A parameter that was found from the log: its value, or a bound of it.

    Attributes
    ----------
    name, value
        ArduSub's name, and the value in its unit.
    sd
        Standard deviation of the value, NaN where none can be told.
    how
        From what it was found.
    bound
        ``"at least"`` or ``"at most"`` where the log tells no more than that; then `value` is the bound and
        nothing to load. Empty for a value.
    """

    name: str
    value: float
    sd: float
    how: str
    bound: str = ""

    def agrees(self, other: float) -> bool:
        """Whether another value of the parameter is compatible with what was found.

        Values agree within a hundredth or three standard deviations; a bound with all on its side of it.
        """
        spread = max(0.01 * abs(other), 0.0 if math.isnan(self.sd) else 3.0 * self.sd)
        if self.bound == "at least":
            return other >= self.value - spread
        if self.bound == "at most":
            return other <= self.value + spread
        return abs(self.value - other) <= spread

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        kind = self.bound.replace(" ", "_") or "value"
        return {"name": self.name, "value": None, "sd": self.sd, "how": self.how} | {kind: self.value}


@dataclass(frozen=True)
class Impossible(Plain, without="partly"):
    """A check that the modes of the log ask for and that cannot be made.

    Attributes
    ----------
    controller, name
        As of a `Quantity`.
    why
        What is in the way.
    topic
        The topic that is missing; empty where another thing is in the way.
    partly
        Whether the topic is missing for part of the log only.
    """

    controller: str
    name: str
    why: str
    topic: str = ""
    partly: bool = False


@dataclass(frozen=True, eq=False)
class Quantity:
    """A logged quantity beside its replay.

    Attributes
    ----------
    controller, name, unit
    t
        Times of the rows, s.
    logged, replayed
        (n,) each.
    judged
        Rows that count, (n,).
    limit
        Within which 95 % of the judged rows are right, in the unit.
    why
        Why what is left is left; empty where nothing is.
    exact
        Whether each row follows from itself alone: then none may be off for longer than `LONGEST_S` either.
    """

    controller: str
    name: str
    unit: str
    t: Array
    logged: Array
    replayed: Array
    judged: Any
    limit: float
    why: str = ""
    exact: bool = False

    @property
    def error(self) -> Array:
        """Replayed minus logged on the judged rows."""
        return np.asarray((self.replayed - self.logged)[self.judged])

    @property
    def rms(self) -> float:
        """Of what was logged, about its mean."""
        return float(np.std(self.logged[self.judged]))

    @property
    def p95(self) -> float:
        """Error that 95 % of the judged rows stay within."""
        return float(np.percentile(np.abs(self.error), 95)) if len(self.error) else math.nan

    @property
    def off(self) -> tuple[float, float]:
        """First and last time of the longest stretch of judged rows beyond the limit, s; NaN without one."""
        t, beyond = self.t[self.judged], np.abs(self.error) > self.limit
        best = (math.nan, math.nan)
        if not beyond.any():
            return best
        # A stretch ends where a row is within the limit, or where rows are missing.
        ends = np.concatenate([[True], ~beyond[:-1] | (np.diff(t) > _GAP_S)])
        stretch = np.cumsum(ends | ~beyond)
        for number in np.unique(stretch[beyond]):
            rows = np.flatnonzero(beyond & (stretch == number))
            if math.isnan(best[0]) or t[rows[-1]] - t[rows[0]] > best[1] - best[0]:
                best = float(t[rows[0]]), float(t[rows[-1]])
        return best

    @property
    def holds(self) -> bool:
        """Whether 95 % of the rows are within the limit and, of what is exact, none is off for long."""
        if not self.p95 <= self.limit:
            return False
        first, last = self.off
        return not (self.exact and last - first > LONGEST_S)

    def to_dict(self) -> dict[str, Any]:
        """Plain data without the rows."""
        first, last = self.off
        return {
            "controller": self.controller,
            "name": self.name,
            "unit": self.unit,
            "rows": len(self.error),
            "rms": self.rms,
            "p95": self.p95,
            "largest": float(np.abs(self.error).max(initial=0.0)),
            "limit": self.limit,
            "longest_off_s": 0.0 if math.isnan(first) else last - first,
            "holds": self.holds,
            "why": self.why,
        }
