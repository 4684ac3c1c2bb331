"""What an identification reports while it runs."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Progress"]


@dataclass(frozen=True)
class Progress:
    """State of an identification after one batch of candidates of one stage.

    ``best`` is that stage's best cost, ``fraction`` the share of all stages' work that is done and ``left_s``
    the time left, s, if every search uses its whole budget. ``notes`` are sentences to show at once: what the
    data cannot tell, known before the search.
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
