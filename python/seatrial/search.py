"""What a bounded search keeps: candidates and costs, the best distinct ones, history and elapsed time."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Objective = Callable[[Array], ArrayLike]

LANES = 8
"""Candidates that the core integrates abreast: batches are multiples of it."""

_DISTINCT = 0.02


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
class Optimum:
    """Best candidate of a search, in the objective's own units.

    ``elite`` (j, m) holds the best candidates that differ by at least 2 % of the box, the best first.
    """

    x: Array
    cost: float
    start_cost: float
    elite: Array
    evaluations: int
    history: tuple[Step, ...]
    interrupted: bool


Watch = Callable[[Step], None]


def join(first: Optimum, second: Optimum) -> Optimum:
    """Optimum of two searches of the same parameters, one after the other: histories joined, the last best.

    The last one counts even where its cost is higher, because the objective may have changed in between.
    """
    return replace(
        second,
        start_cost=first.start_cost,
        evaluations=first.evaluations + second.evaluations,
        history=first.history
        + tuple(replace(s, evaluations=s.evaluations + first.evaluations) for s in second.history),
    )


class Ledger:
    """Workspace of one search: evaluates, remembers every candidate, keeps the history."""

    def __init__(
        self,
        objective: Objective,
        lower: ArrayLike,
        upper: ArrayLike,
        phase: str,
        generations: int,
        watch: Watch | None,
    ) -> None:
        self.lower = np.atleast_1d(np.asarray(lower, dtype=float))
        self.width = np.atleast_1d(np.asarray(upper, dtype=float)) - self.lower
        if not (np.isfinite(self.lower).all() and (self.width > 0).all() and np.isfinite(self.width).all()):
            raise ValueError("bounds must be finite and every upper one above its lower one")
        self.objective, self.phase, self.generations, self.watch = objective, phase, generations, watch
        self.generation = 0
        self.start_cost = math.inf
        self.best_cost = math.inf
        self.candidates: list[Array] = []
        self.candidate_costs: list[Array] = []
        self.history: list[Step] = []
        self.began = time.monotonic()

    def to_box(self, x: ArrayLike) -> Array:
        """Candidate in the unit box, moved to its edge where it lies outside."""
        scaled = (np.atleast_1d(np.asarray(x, dtype=float)) - self.lower) / self.width
        return np.asarray(np.clip(scaled, 0.0, 1.0))

    def from_box(self, z: Array) -> Array:
        """Candidates in the objective's own units."""
        return np.asarray(self.lower + self.width * z)

    def costs(self, z: Array) -> Array:
        """Costs ``(k,)`` of candidates in the unit box, infinite where not finite; both are kept."""
        costs = np.asarray(self.objective(self.from_box(z)), dtype=float)
        costs = np.where(np.isfinite(costs), costs, math.inf)
        self.candidates.append(z)
        self.candidate_costs.append(costs)
        self.best_cost = min(self.best_cost, float(costs.min()))
        return costs

    def close_generation(self) -> None:
        """Append a `Step` to the history and show it to the watch."""
        self.generation += 1
        evaluations = sum(len(costs) for costs in self.candidate_costs)
        elapsed = time.monotonic() - self.began
        step = Step(self.phase, self.generation, self.generations, evaluations, self.best_cost, elapsed)
        self.history.append(step)
        if self.watch is not None:
            self.watch(step)

    def stalled(self, patience: int, tolerance: float) -> bool:
        """Whether the last generations gained less than the tolerance, a fraction of the cost."""
        if len(self.history) <= patience:
            return False
        before = self.history[-1 - patience].best
        return not before - self.best_cost > tolerance * abs(before)

    def elite(self) -> Array:
        """Best distinct candidates in the unit box, the best first."""
        candidates, costs = np.concatenate(self.candidates), np.concatenate(self.candidate_costs)
        chosen: list[Array] = []
        for index in np.argsort(costs, kind="stable"):
            point = candidates[index]
            if all(np.abs(point - other).max() >= _DISTINCT for other in chosen):
                chosen.append(point)
            if len(chosen) == LANES:
                break
        return np.array(chosen)

    def run(self, search: Callable[[], None]) -> Optimum:
        """Optimum after the search has run or was interrupted."""
        interrupted = False
        try:
            search()
        except KeyboardInterrupt:
            if not self.candidates:
                raise
            interrupted = True
        elite = self.elite()
        return Optimum(
            x=self.from_box(elite[0]),
            cost=self.best_cost,
            start_cost=self.start_cost,
            elite=self.from_box(elite),
            evaluations=sum(len(costs) for costs in self.candidate_costs),
            history=tuple(self.history),
            interrupted=interrupted,
        )
