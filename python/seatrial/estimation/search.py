"""Bounded minimisation of a batch criterion: evolution strategy, then simplexes in lockstep.

The objective takes a whole batch of candidates ``(k, m)`` and gives ``(k,)`` costs, because the core
integrates eight candidates for the price of one. The evolution strategy (Hansen 2016, arXiv:1604.00772,
package ``cma``) asks for its population at once; simplexes start from its best distinct points.

Candidates are searched in the unit box: bounds map to 0 and 1. A cost that is not finite is a diverged
candidate; it ranks last and never stops the search. Ctrl-C ends the search and keeps the best candidate.

A simplex (Nelder & Mead 1965, ``scipy``) is sequential by nature. Each search runs in its own thread and
waits there for the cost of its candidate, while the caller's thread gathers one request of each into a batch.
A round answers every living search once, so that the course of a search depends on its start alone.

Tests: ``tests/estimation``.
"""

from __future__ import annotations

import math
import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.arrays import Array
from seatrial.base.work import Step, Watch

Objective = Callable[[Array], ArrayLike]


@dataclass(frozen=True)
class GlobalSearchSettings:
    """Sizes and lengths of the global search."""

    #: Candidates that the core integrates abreast: batches are multiples of it.
    lanes: int = 8
    #: Distance in the unit box below which two points are one start.
    distinct: float = 0.02
    #: Standard deviation of a restarted population, a share of the box.
    spread: float = 0.3
    #: Restarts that double the population.
    doublings: int = 2
    #: Generations after which a run without a single finite cost begins elsewhere.
    lost_generations: int = 4
    #: Cost that stands for an infinite one where the arithmetic of a search needs a number.
    diverged_cost: float = 1e30
    #: Edges of simplexes along the parameters' axes, shares of the box, in turn.
    edges: tuple[float, float, float] = (0.08, 0.04, 0.02)
    #: Edges of simplexes along the axes of a valley, in its standard deviations, in turn.
    valley_edges: tuple[float, ...] = (2.0, 1.0, 0.5, 4.0)
    #: Best candidates that tell the axes of a valley, per vertex of a simplex: fewer do not span it.
    shaping_candidates: int = 6
    #: Shortest axis of a valley, a share of the box: a simplex must not be flat.
    shortest_axis: float = 1e-6


SEARCH_SETTINGS = GlobalSearchSettings()


@dataclass(frozen=True)
class Optimum:
    """Best candidate of a search, in the objective's own units.

    ``elite`` (j, m) holds the best candidates that differ by at least 2 % of the box, the best first.
    ``axes`` (m, m) has in its columns the principal axes of the best candidates, each as long as their
    standard deviation along it: size and direction of the valley that was found.
    """

    x: Array
    cost: float
    start_cost: float
    elite: Array
    axes: Array
    evaluations: int
    history: tuple[Step, ...]
    interrupted: bool


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
            if all(np.abs(point - other).max() >= SEARCH_SETTINGS.distinct for other in chosen):
                chosen.append(point)
            if len(chosen) == SEARCH_SETTINGS.lanes:
                break
        return np.array(chosen)

    def axes(self) -> Array:
        """Principal axes (m, m) of the best candidates in the unit box, in columns, one deviation long."""
        candidates, costs = np.concatenate(self.candidates), np.concatenate(self.candidate_costs)
        best = candidates[
            np.argsort(costs, kind="stable")[: SEARCH_SETTINGS.shaping_candidates * (candidates.shape[1] + 1)]
        ]
        _, lengths, directions = np.linalg.svd(best - best.mean(axis=0))
        deviations = np.zeros(candidates.shape[1])
        deviations[: len(lengths)] = lengths / math.sqrt(len(best))
        return np.asarray(directions.T * np.maximum(deviations, SEARCH_SETTINGS.shortest_axis))

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
            cost=min(float(costs.min()) for costs in self.candidate_costs),
            start_cost=self.start_cost,
            elite=self.from_box(elite),
            axes=self.axes() * self.width[:, None],
            evaluations=sum(len(costs) for costs in self.candidate_costs),
            history=tuple(self.history),
            interrupted=interrupted,
        )


def simplexes_abreast(
    score: Callable[[Array], Array], simplexes: Array, *, rounds: int, tolerance: float
) -> None:
    """Ask for the costs of simplex searches in the unit box until all have collapsed.

    ``score``: costs ``(k,)`` of candidates ``(k, m)`` in the unit box; it keeps what it has seen.
    ``simplexes`` (k, m + 1, m): vertices of every simplex at its begin. ``rounds``: number of batches at
    most. ``tolerance``: spread of the costs at which a simplex has collapsed; its extent must be below 1e-4
    as well.
    """
    from scipy.optimize import minimize

    requests: queue.SimpleQueue[tuple[int, Array | BaseException | None]] = queue.SimpleQueue()
    answers: list[queue.SimpleQueue[float | None]] = [queue.SimpleQueue() for _ in simplexes]

    def search(index: int) -> None:
        def cost(z: Array) -> float:
            requests.put((index, z.copy()))
            answer = answers[index].get()
            if answer is None:
                raise _Halted
            return answer

        options = {
            "initial_simplex": simplexes[index],
            "xatol": 1e-4,
            "fatol": max(tolerance, 1e-13),
            "maxfev": rounds,
            "maxiter": rounds,
            "adaptive": True,
        }
        box = [(0.0, 1.0)] * simplexes.shape[2]
        end: BaseException | None = None
        try:
            minimize(cost, simplexes[index, 0], method="Nelder-Mead", bounds=box, options=options)
        except _Halted:
            pass
        except BaseException as error:  # raised again in the caller's thread
            end = error
        requests.put((index, end))

    threads = [threading.Thread(target=search, args=(i,), daemon=True) for i in range(len(simplexes))]
    living = set(range(len(simplexes)))
    for thread in threads:
        thread.start()
    try:
        while living:
            pending: dict[int, Array] = {}
            while len(pending) < len(living):
                index, request = requests.get()
                if isinstance(request, np.ndarray):
                    pending[index] = request
                else:
                    living.discard(index)
                    if request is not None:
                        raise request
            if pending:
                order = sorted(pending)
                costs = score(np.array([pending[index] for index in order]))
                for index, value in zip(order, costs, strict=True):
                    answers[index].put(
                        float(value) if math.isfinite(value) else SEARCH_SETTINGS.diverged_cost
                    )
    finally:
        for index in living:
            answers[index].put(None)
        for thread in threads:
            thread.join()


class _Halted(Exception):
    """Ends a search from outside."""


def _simplex(corner: Array, edges: Array) -> Array:
    """Vertices ``(m + 1, m)``: the corner and a step along every edge, a row of `edges`, inside the unit box.

    A step that would leave the box goes the other way; one that leaves it there too ends at its side, where
    a vertex that would fall on the corner is moved a little along the parameter that the edge changes most.
    """
    inside = [bool(np.all((corner + edge >= 0.0) & (corner + edge <= 1.0))) for edge in edges]
    steps = np.clip(corner + np.where(np.array(inside)[:, None], edges, -edges), 0.0, 1.0) - corner
    for step, edge in zip(steps, edges, strict=True):
        if np.abs(step).max() < 0.5 * np.abs(edge).max():
            most = int(np.abs(edge).argmax())
            step[most] = abs(edge[most]) if corner[most] < 0.5 else -abs(edge[most])
    return np.asarray(np.vstack([corner, np.clip(corner + steps, 0.0, 1.0)]), dtype=float)


def evolve(
    objective: Objective,
    start: ArrayLike,
    *,
    lower: ArrayLike,
    upper: ArrayLike,
    seed: int = 0,
    population: int | None = None,
    generations: int = 200,
    spread: float = 0.25,
    tolerance: float = 1e-4,
    watch: Watch | None = None,
    enough: Callable[[], bool] | None = None,
) -> Optimum:
    """Optimum of a global search inside the bounds by an evolution strategy (CMA-ES) with restarts.

    A run ends when neither its own best nor the median of its population has gained the tolerance over the
    last generations: one lucky candidate of a wide population would stall the best alone, and the start's
    cost does not count, which such a population takes long to reach. A search that ends above its start, or
    where everything diverges, begins again at a random place in the box with twice the population (Auger &
    Hansen 2005, IPOP), until the generations are used up. The history holds what the strategy found by
    itself; the optimum is the best candidate, the start among them.

    ``objective``: costs ``(k,)`` of candidates ``(k, m)``. ``start`` (m,): centre of the first population.
    ``lower``, ``upper`` (m,): bounds; no candidate lies outside. ``seed``: the same seed gives the same
    result. ``population``: candidates per generation; by default enough for m, rounded up to full lanes.
    ``generations``: budget of generations. ``spread``: standard deviation of the first population, a share of
    the box: small where the start is good already. ``tolerance``: end a run when its best and its median cost
    have not improved by this fraction over the last generations. ``watch``: called with a `Step` after every
    generation; a KeyboardInterrupt that it raises ends the search. ``enough``: asked after every generation;
    where it says so, the search ends.

    Examples
    --------
    >>> from seatrial.estimation.search import evolve
    >>> best = evolve(lambda x: ((x - 0.3) ** 2).sum(axis=1), [0.9, 0.9], lower=[0, 0], upper=[1, 1])
    >>> bool(abs(best.x - 0.3).max() < 0.02)
    True
    """
    import cma

    ledger = Ledger(objective, lower, upper, "evolution", generations, watch)
    first = ledger.to_box(start)
    size = batch_size(len(first), population)
    generator = np.random.default_rng(seed)

    def over() -> bool:
        return enough is not None and enough()

    def descend(centre: Array, sigma: float, size: int) -> float:
        """Best cost of one run, which ends when it has gained nothing for long or has contracted."""
        # The package does not search one dimension: a second one without effect takes its place.
        padded = np.append(centre, 0.5) if len(centre) == 1 else centre
        options: dict[str, Any] = {
            "bounds": [0.0, 1.0],
            "popsize": size,
            "seed": np.nan,  # leaves NumPy's global generator alone, which other threads may use
            "randn": lambda *shape: generator.standard_normal(shape),
            "tolflatfitness": 10,
            "verbose": -9,
            "verb_log": 0,
            "verb_disp": 0,
            "signals_filename": "",
        }
        patience = 10 + math.ceil(30 * len(centre) / size)
        strategy = cma.CMAEvolutionStrategy(padded, sigma, options)
        own, middle = list[float](), list[float]()  # lowest so far: cost, median cost of a population
        while ledger.generation < generations and not strategy.stop() and not over():
            candidates = strategy.ask()
            costs = ledger.costs(np.array(candidates)[:, : len(centre)])
            strategy.tell(candidates, np.where(np.isfinite(costs), costs, SEARCH_SETTINGS.diverged_cost))
            ledger.close_generation()
            own.append(min(own[-1] if own else math.inf, float(costs.min())))
            if len(own) >= SEARCH_SETTINGS.lost_generations and not math.isfinite(own[-1]):
                break
            middle.append(min(middle[-1] if middle else math.inf, float(np.median(costs))))
            if (
                len(own) > patience
                and _still(own, patience, tolerance)
                and _still(middle, patience, tolerance)
            ):
                break
        return own[-1] if own else math.inf

    def search() -> None:
        ledger.start_cost = float(ledger.costs(first[None, :])[0])
        ledger.best_cost = math.inf  # what the strategy finds, without its start
        best, run = descend(first, spread, size), 0
        good = min(ledger.start_cost * (1.0 + tolerance), SEARCH_SETTINGS.diverged_cost)
        while ledger.generation < generations and not best <= good and not over():
            run += 1
            centre = generator.uniform(0.0, 1.0, len(first))
            best = min(
                best, descend(centre, SEARCH_SETTINGS.spread, size * 2 ** min(run, SEARCH_SETTINGS.doublings))
            )

    return ledger.run(search)


def _still(lowest: list[float], patience: int, tolerance: float) -> bool:
    """Whether the lowest costs so far have gained less than the tolerance over the last generations."""
    before = lowest[-1 - patience]
    return math.isfinite(before) and not before - lowest[-1] > tolerance * abs(before)


def refine(
    objective: Objective,
    starts: ArrayLike,
    *,
    lower: ArrayLike,
    upper: ArrayLike,
    rounds: int | None = None,
    tolerance: float = 1e-4,
    watch: Watch | None = None,
    axes: ArrayLike | None = None,
) -> Optimum:
    """Optimum of a fine search by simplexes (Nelder-Mead) abreast.

    Every round evaluates one candidate of each simplex in a single batch. A simplex along the parameters' own
    axes takes more rounds to shrink into a narrow oblique valley than the search has: with the axes of the
    valley all begin at the best start and along them, in different lengths and directions. When all have
    collapsed, they start again around the best points. The search ends when it has gained less than the
    tolerance, a fraction of the cost, over 15 (m + 1) rounds, or over the first 5 (m + 1), or when the rounds
    are used up.

    ``objective``, ``lower``, ``upper``, ``tolerance``, ``watch``: as for `evolve`. ``starts`` (k, m): start
    points, the best first; more than eight are ignored. ``rounds``: budget of batches, by default 100 (m +
    1). ``axes`` (m, m): axes of the valley in columns, as in `Optimum`; left out, one simplex begins at each
    start.

    Examples
    --------
    >>> from seatrial.estimation.search import refine
    >>> best = refine(lambda x: abs(x - 0.3).sum(axis=1), [[0.2, 0.4]], lower=[0, 0], upper=[1, 1])
    >>> bool(abs(best.x - 0.3).max() < 1e-3)
    True
    """
    points = np.atleast_2d(np.asarray(starts, dtype=float))
    vertices = points.shape[1] + 1
    budget = refine_rounds(points.shape[1]) if rounds is None else rounds
    ledger = Ledger(objective, lower, upper, "simplex", budget, watch)
    corners = np.array([ledger.to_box(point) for point in points[: SEARCH_SETTINGS.lanes]])
    valley = None if axes is None else np.asarray(axes, dtype=float) / ledger.width[:, None]

    def score(candidates: Array) -> Array:
        costs = ledger.costs(candidates)
        ledger.close_generation()
        gained = ledger.start_cost - ledger.best_cost > tolerance * abs(ledger.start_cost)
        if ledger.stalled((15 if gained else 5) * vertices, tolerance):
            raise _Stalled
        return costs

    def search() -> None:
        nonlocal corners, valley
        ledger.start_cost = float(ledger.costs(corners[:1])[0])
        while ledger.generation < budget:
            before = ledger.best_cost
            try:
                simplexes_abreast(
                    score,
                    _along(corners[0], valley) if valley is not None else _from_each(corners),
                    rounds=budget - ledger.generation,
                    tolerance=tolerance * abs(before),
                )
            except _Stalled:
                break
            if not before - ledger.best_cost > tolerance * abs(before):
                break
            corners = ledger.elite()
            valley = None if valley is None else ledger.axes()

    return ledger.run(search)


def _from_each(corners: Array) -> Array:
    """Simplexes (k, m + 1, m) along the parameters' axes, one from each corner (k, m)."""
    edges = np.eye(corners.shape[1])
    return np.array([
        _simplex(corner, SEARCH_SETTINGS.edges[k % len(SEARCH_SETTINGS.edges)] * edges)
        for k, corner in enumerate(corners)
    ])


def _along(corner: Array, axes: Array) -> Array:
    """Simplexes (k, m + 1, m) of full lanes along the axes of a valley from one corner.

    The first ones differ in size. The others go both ways along the axes, by fixed random signs, since the
    optimum lies on one side of each.
    """
    simplexes = []
    for k in range(SEARCH_SETTINGS.lanes):
        signs = (
            np.random.default_rng(k).choice([-1.0, 1.0], len(corner))
            if k >= len(SEARCH_SETTINGS.valley_edges)
            else 1.0
        )
        simplexes.append(
            _simplex(
                corner, SEARCH_SETTINGS.valley_edges[k % len(SEARCH_SETTINGS.valley_edges)] * (axes * signs).T
            )
        )
    return np.array(simplexes)


class _Stalled(Exception):
    """Ends simplexes that gain nothing any more."""


def batch_size(parameters: int, population: int | None = None) -> int:
    """Candidates per generation: the asked number or one that suits the parameters, in full lanes."""
    wanted = 4 + 3 * math.log(parameters) if population is None else population
    return SEARCH_SETTINGS.lanes * math.ceil(wanted / SEARCH_SETTINGS.lanes)


def refine_rounds(parameters: int) -> int:
    """Budget of rounds: simplexes along the valley reach its floor in about 60 (m + 1), and begin again."""
    return 100 * (parameters + 1)
