"""What a search and an identification report while they run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

__all__ = ["Progress", "Step", "Watch"]


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
