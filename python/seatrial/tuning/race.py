"""Costs of the candidates of a search at fewer flights: who cannot be a parent is not flown to the end.

An evolution strategy learns from the better half of a generation, its parents. All candidates meet the sample
that was the worst most often so far, those of the better half by that meet the others too, and so does every
other that may still be among them: what one sample violates, all samples violate at least. The parents and
their order are therefore those of all samples; of the others only the order among themselves is a guess. What
margins and roughness alone make worse than the last generation's parents does not fly at all.

Where the samples are many, such as the noises of the second turn, a search meets those that are worst for the
gains that it begins with, and its simplexes those that are worst for the best that it has found. All samples
have the last word (a cutting-set method: Mutapcic & Boyd, *Optimization Methods and Software* 24 (2009)
381).

Held by tests/tuning/test_race.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.base.chunks import Chunk, Shared, as_it_is, run_chunks
from seatrial.base.run import RunDirectory, sha256
from seatrial.estimation.search import LANES
from seatrial.tuning.objective import LACKING, OUTSIDE, Flown, Objective, Still

if TYPE_CHECKING:
    from seatrial.base.fleet import Fleet

FEW = 4
"""Samples up to which a search meets all of them."""

_NOISES, _DRAWN = 2, 3
"""Noises of the vehicle itself and drawn vehicles that a search meets where there are more samples."""

_INSIDE = 0.01
"""Cost of corridors and margins up to which they count as kept: 1 ms of a step, or 0.03 % of a margin."""

_EVEN = 0.01
"""Cost, of what only breaks ties, that is not worth further flights: 1 ms of a step."""

_PATIENCE = 10  # generations without a gain after which a search ends

_DIVERGED_S = 1e6  # violation in s that stands for a diverged candidate in sums

Fly = Callable[[Array, Sequence[int]], Flown]
"""What candidates (k, m) do with some of all samples."""


class Race:
    """Costs of the candidates of one group by an objective with all samples.

    `fly` says how candidates are flown: here or by a fleet.
    """

    def __init__(self, objective: Objective, fly: Fly) -> None:
        self.objective, self.fly = objective, fly
        self.history: list[tuple[float, float, float]] = []  # of the best: cost, its corridors, its margins
        self.parents: list[float] = []  # lowest cost of a last parent
        self._meet(range(len(objective.samples)))

    @property
    def narrowed(self) -> bool:
        """Whether candidates meet fewer samples than there are."""
        return len(self.met) < len(self.objective.samples)

    def __call__(self, x: Array) -> Array:
        """Costs (k,) of a generation (k, m); of who is no parent, at least what it was flown for."""
        parents = len(x) // 2
        if not (parents and self.history) or len(self.met) == 1 or self.objective.quantile < 1.0:
            return self.exactly(x)
        still, flown = self._still(x), Flown.none(len(x), len(self.met))
        done = np.zeros((len(x), len(self.met)), dtype=bool)
        first = int(self.worst.argmax())
        rest = [place for place in range(len(self.met)) if place != first]

        def fly_on(rows: NDArray[np.intp], places: Sequence[int]) -> None:
            if len(rows):
                flown.put(rows, places, self._flown(x[rows], places))
                done[np.ix_(rows, np.asarray(places))] = True

        # What margins and roughness alone make worse than parents are is not flown.
        alone = self._costs(still, flown)
        begun = np.union1d(np.argsort(alone, kind="stable")[:parents], np.flatnonzero(alone <= self.limit))
        fly_on(begun, [first])
        guess = self._costs(still, Flown(*(np.tile(part[:, [first]], len(self.met)) for part in flown.parts)))
        fly_on(begun[np.argsort(guess[begun], kind="stable")][:parents], rest)
        # Who may still be among the parents by what it has met so far flies on.
        while True:
            costs, whole = self._costs(still, flown), done.all(axis=1)
            open_ = ~whole & (costs < np.sort(costs[whole])[parents - 1])
            if not open_.any():
                break
            fly_on(np.flatnonzero(open_ & done[:, first]), rest)
            fly_on(np.flatnonzero(open_ & ~done[:, first]), [first])
        return self._kept(still, flown, np.flatnonzero(whole))

    def exactly(self, x: Array) -> Array:
        """Costs (k,) of candidates (k, m), each with every sample that is met."""
        return self._kept(self._still(x), self._flown(x, range(len(self.met))), np.arange(len(x)))

    def with_all(self, x: Array) -> Array:
        """Costs (k,) of candidates (k, m) with all samples."""
        flown = self.fly(x, range(len(self.objective.samples)))
        return self.objective.joined(self._still(x), flown).cost(self.objective.smoothness)

    def narrow(self, x: Array) -> None:
        """Meet only the samples that are worst for candidates (k, m), of noises and of drawn vehicles."""
        samples = self.objective.samples
        if len(samples) <= FEW or self.objective.quantile < 1.0:
            return
        flown = self.fly(x, range(len(samples)))
        # Where nothing is violated, the one that is farthest off meanwhile tells most.
        size = np.minimum(flown.violation, _DIVERGED_S) + 1e-3 * np.minimum(flown.time, _DIVERGED_S)
        order = np.argsort(-size.max(axis=0), kind="stable").tolist()
        own = [place for place in order if place < samples.nominal][:_NOISES]
        drawn = [place for place in order if place >= samples.nominal][:_DRAWN]
        self._meet(sorted(own + drawn))

    def inside(self) -> bool:
        """Whether corridors and margins are kept by the best so far."""
        return bool(self.history) and sum(self.history[-1][1:]) <= _INSIDE

    def enough(self) -> bool:
        """Whether corridors are kept, and the last generations gained next to nothing.

        The last parent counts as well as the best: one lucky candidate of a wide generation stalls the best.
        """
        if len(self.parents) <= _PATIENCE or self.history[-1][1] > _INSIDE:
            return False
        best = self.history[-1 - _PATIENCE][0] - self.history[-1][0]
        last = self.parents[-1 - _PATIENCE] - self.parents[-1]
        return best < _EVEN and last < 2.0 * _EVEN

    def _meet(self, places: Sequence[int]) -> None:
        self.met = list(places)
        self.here = self.objective.of_samples(self.met)
        self.worst = np.zeros(len(self.met))  # how often each was the worst of a candidate
        self.limit = np.inf  # cost of the last parent of the generation before
        self.history, self.parents = [], []

    def _still(self, x: Array) -> Still:
        return self.objective.still(self.objective.parameters.gains(x))

    def _flown(self, x: Array, places: Sequence[int]) -> Flown:
        return self.fly(x, [self.met[place] for place in places])

    def _costs(self, still: Still, flown: Flown) -> Array:
        return self.here.joined(still, flown).cost(self.objective.smoothness)

    def _kept(self, still: Still, flown: Flown, whole: NDArray[np.intp]) -> Array:
        """Costs (k,); remembered is how good the best is, and which samples were worst."""
        terms = self.here.joined(still, flown)
        costs = terms.cost(self.objective.smoothness)
        violation = flown.violation[whole]
        differ = violation.max(axis=1) > violation.min(axis=1)
        self.worst += np.bincount(violation[differ].argmax(axis=1), minlength=len(self.met))
        best = int(whole[costs[whole].argmin()])
        now = (
            float(costs[best]),
            float(OUTSIDE * terms.violation[best]),
            float(LACKING * terms.margin[best]),
        )
        self.history.append(min(self.history[-1], now) if self.history else now)
        if parents := len(costs) // 2:
            self.limit = float(np.sort(costs[whole])[parents - 1])
            self.parents.append(min([self.limit, *self.parents[-1:]]))
        return costs


class Here:
    """Flights of candidates in this process, and the time that they took, s."""

    def __init__(self, objective: Objective) -> None:
        self._objective, self.flown_s = objective, 0.0
        self._each = sum(len(trials) * trials.duration_s for trials in objective.trials)

    def __call__(self, x: Array, places: Sequence[int]) -> Flown:
        """What candidates (k, m) do with some of the samples, counted."""
        self.flown_s += self._each * len(x) * len(places)
        return self.fly(x, places)

    def fly(self, x: Array, places: Sequence[int]) -> Flown:
        """What candidates (k, m) do with some of the samples."""
        return flights(self._objective, x, places)


class Elsewhere(Here):
    """Candidates that workers of a fleet fly: full lanes for each, the same bits as here."""

    def __init__(self, objective: Objective, fleet: Fleet) -> None:
        super().__init__(objective)
        self._fleet = fleet
        self._shared = Shared(replace(objective, rig=replace(objective.rig, threads=1)))

    def fly(self, x: Array, places: Sequence[int]) -> Flown:
        """What candidates (k, m) do with some of the samples."""
        pieces = min(max(self._fleet.slots, 1), math.ceil(len(x) / LANES))
        each = LANES * math.ceil(len(x) / LANES / pieces)
        chosen = tuple(int(place) for place in places)
        chunks = (
            Chunk(
                f"candidates {k}",
                sha256(self._shared.packed + part.tobytes() + bytes(chosen)),
                flights,
                self._shared,
                (part, chosen),
            )
            for k, part in enumerate(x[k : k + each] for k in range(0, len(x), each))
        )
        chunks_flown = run_chunks(chunks, RunDirectory(None), as_it_is(), fleet=self._fleet)
        return Flown(*map(np.concatenate, zip(*(done.value.parts for done in chunks_flown), strict=True)))


def flights(objective: Objective, x: Array, places: Sequence[int]) -> Flown:
    """What candidates (k, m) do with some of the samples: a chunk of the work."""
    return objective.of_samples(places).flown(objective.parameters.gains(x))
