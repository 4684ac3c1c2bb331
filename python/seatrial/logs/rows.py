"""Rows of several topics, gathered message by message and handed on in chunks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from seatrial.logs.log import CHUNK_ROWS, Chunk

LONGEST_ARRAY = 36
"""Longer arrays are images, point clouds or spectra: no channels of a trial. A covariance has 36."""


class Gathered:
    """Rows of the fields wanted, by topic."""

    def __init__(self, wanted: Mapping[str, Sequence[str]]) -> None:
        self.wanted = wanted
        self.rows: dict[str, list[list[float]]] = {topic: [] for topic in wanted}

    def add(self, topic: str, t: float, values: Mapping[str, float]) -> Chunk | None:
        """Take in a message; a chunk when enough are there."""
        rows = self.rows[topic]
        rows.append([t, *(values.get(name, math.nan) for name in self.wanted[topic])])
        return self._take(topic) if len(rows) >= CHUNK_ROWS else None

    def rest(self) -> Iterator[Chunk]:
        """What is left at the end of the file."""
        for topic, rows in self.rows.items():
            if rows:
                yield self._take(topic)

    def _take(self, topic: str) -> Chunk:
        values = np.array(self.rows[topic], float)
        self.rows[topic] = []
        return Chunk(topic, values[:, 0], values[:, 1:])


def number(value: object) -> float | None:
    """A number or truth value as a float; None for anything else.

    Examples
    --------
    >>> number(True), number(3), number("3"), number(2**2000)
    (1.0, 3.0, None, inf)
    """
    if isinstance(value, bool | int | float | np.number | np.bool_):
        try:
            return float(value)
        except OverflowError:
            return math.inf
    return None
