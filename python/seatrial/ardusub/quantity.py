"""What a replay compares and what it finds: a logged quantity beside its replay, a parameter with its spread.

Held by ``tests/ardusub/test_replay.py``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from seatrial.base.arrays import Array

__all__ = ["LIMITS", "Found", "Quantity"]

LIMITS = {"term": 0.01, "pulse": 2.0}
"""Share of a term, and microseconds of a pulse, within which a replay counts as right."""


@dataclass(frozen=True)
class Found:
    """A parameter that was found from the log.

    Attributes
    ----------
    name, value
        ArduSub's name, and the value in its unit.
    sd
        Standard deviation of the value, NaN where none can be told.
    how
        From what it was found.
    """

    name: str
    value: float
    sd: float
    how: str


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
        Rows that were not used to find a gain, (n,).
    limit
        Within which 95 % of the judged rows are right, in the unit.
    why
        Why what is left is left; empty where nothing is.
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
    def holds(self) -> bool:
        """Whether 95 % of the rows are within the limit."""
        return self.p95 <= self.limit

    def to_dict(self) -> dict[str, Any]:
        """Plain data without the rows."""
        return {
            "controller": self.controller,
            "name": self.name,
            "unit": self.unit,
            "rows": len(self.error),
            "rms": self.rms,
            "p95": self.p95,
            "largest": float(np.abs(self.error).max(initial=0.0)),
            "limit": self.limit,
            "holds": self.holds,
            "why": self.why,
        }
