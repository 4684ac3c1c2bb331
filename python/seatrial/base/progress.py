"""What long work reports while it runs."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Self

__all__ = ["Clock", "Progress", "Step", "Watch"]


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

    def left_s(self, fraction: float) -> float:
        """Time left, s, when the rest of the work takes as long as the fraction that is done."""
        return self.elapsed_s * (1.0 - fraction) / max(fraction, 1e-6)


@dataclass(frozen=True)
class Progress:
    """State of an identification after one batch of candidates of one stage.

    ``best`` is that stage's best cost, ``fraction`` the share of all stages' work that is done and ``left_s``
    the time left, s, if every search uses its whole budget. ``notes`` are sentences to show at once: what the
    data cannot determine, known before the search.
    """

    stage: str
    phase: str
    generation: int
    generations: int
    evaluations: int
    best: float
    stages_done: int
    stages: int
    fraction: float
    elapsed_s: float
    left_s: float
    notes: tuple[str, ...] = ()


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


Watch = Callable[[Step], None]
