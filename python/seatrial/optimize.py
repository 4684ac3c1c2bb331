"""Bounded minimisation of a batch criterion: evolution strategy, then simplexes abreast.

The objective takes a whole batch of candidates ``(k, m)`` and gives ``(k,)`` costs, because the core
integrates eight candidates for the price of one. The evolution strategy (Hansen 2016, arXiv:1604.00772,
package ``cma``) asks for its population at once; simplexes start from its best distinct points.

Candidates are searched in the unit box: bounds map to 0 and 1. A cost that is not finite is a diverged
candidate; it ranks last and never stops the search. Ctrl-C ends the search and keeps the best candidate.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from seatrial.search import LANES, Array, Ledger, Objective, Optimum, Watch, join
from seatrial.simplex import DIVERGED, simplexes_abreast


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
) -> Optimum:
    """Optimum of a global search inside the bounds by an evolution strategy (CMA-ES).

    Parameters
    ----------
    objective : callable
        Costs ``(k,)`` of candidates ``(k, m)``.
    start : array_like, shape (m,)
        Centre of the first population.
    lower, upper : array_like, shape (m,)
        Bounds; no candidate lies outside.
    seed : int
        The same seed gives the same result.
    population : int, optional
        Candidates per generation; by default enough for m, rounded up to full lanes.
    generations : int
        Budget of generations.
    spread : float
        Standard deviation of the first population, a share of the box: small where the start is good already.
    tolerance : float
        Stop when the best cost has not improved by this fraction over the last generations.
    watch : callable, optional
        Called with a `Step` after every generation; a KeyboardInterrupt that it raises ends the search.

    Returns
    -------
    Optimum

    Examples
    --------
    >>> from seatrial.optimize import evolve
    >>> best = evolve(lambda x: ((x - 0.3) ** 2).sum(axis=1), [0.9, 0.9], lower=[0, 0], upper=[1, 1])
    >>> bool(abs(best.x - 0.3).max() < 0.02)
    True
    """
    import cma

    ledger = Ledger(objective, lower, upper, "evolution", generations, watch)
    first = ledger.to_box(start)
    size = batch_size(len(first), population)
    # The package does not search one dimension: a second one without effect takes its place.
    padded = np.append(first, 0.5) if len(first) == 1 else first
    generator = np.random.default_rng(seed)
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
    patience = 10 + math.ceil(30 * len(first) / size)

    def search() -> None:
        ledger.start_cost = float(ledger.costs(first[None, :])[0])
        strategy = cma.CMAEvolutionStrategy(padded, spread, options)
        while ledger.generation < generations and not strategy.stop():
            candidates = strategy.ask()
            costs = ledger.costs(np.array(candidates)[:, : len(first)])
            strategy.tell(candidates, np.where(np.isfinite(costs), costs, DIVERGED))
            ledger.close_generation()
            if ledger.stalled(patience, tolerance):
                break

    return ledger.run(search)


def refine(
    objective: Objective,
    starts: ArrayLike,
    *,
    lower: ArrayLike,
    upper: ArrayLike,
    rounds: int | None = None,
    tolerance: float = 1e-4,
    watch: Watch | None = None,
) -> Optimum:
    """Optimum of a fine search by simplexes (Nelder-Mead) abreast, one from each start.

    Every round evaluates one candidate of each simplex in a single batch. When all have collapsed, they start
    again around the best points. The search ends when 5 (m + 1) rounds gain less than the tolerance, a
    fraction of the cost, or the rounds are used up.

    Parameters
    ----------
    objective, lower, upper, tolerance, watch
        As for `evolve`.
    starts : array_like, shape (k, m)
        Start points, the best first; more than eight are ignored.
    rounds : int, optional
        Budget of batches, by default 80 (m + 1), at most 500.

    Returns
    -------
    Optimum

    Examples
    --------
    >>> from seatrial.optimize import refine
    >>> best = refine(lambda x: abs(x - 0.3).sum(axis=1), [[0.2, 0.4]], lower=[0, 0], upper=[1, 1])
    >>> bool(abs(best.x - 0.3).max() < 1e-3)
    True
    """
    points = np.atleast_2d(np.asarray(starts, dtype=float))
    budget = refine_rounds(points.shape[1]) if rounds is None else rounds
    ledger = Ledger(objective, lower, upper, "simplex", budget, watch)
    corners = np.array([ledger.to_box(point) for point in points[:LANES]])

    patience = 5 * (points.shape[1] + 1)

    def score(candidates: Array) -> Array:
        costs = ledger.costs(candidates)
        ledger.close_generation()
        if ledger.stalled(patience, tolerance):
            raise _Stalled
        return costs

    def search() -> None:
        nonlocal corners
        ledger.start_cost = float(ledger.costs(corners)[0])
        while ledger.generation < budget:
            before = ledger.best_cost
            try:
                simplexes_abreast(
                    score, corners, rounds=budget - ledger.generation, tolerance=tolerance * abs(before)
                )
            except _Stalled:
                break
            if not before - ledger.best_cost > tolerance * abs(before):
                break
            corners = ledger.elite()

    return ledger.run(search)


def minimize(
    objective: Objective,
    start: ArrayLike,
    *,
    lower: ArrayLike,
    upper: ArrayLike,
    seed: int = 0,
    population: int | None = None,
    generations: int = 200,
    rounds: int | None = None,
    tolerance: float = 1e-4,
    watch: Watch | None = None,
) -> Optimum:
    """Optimum inside the bounds: `evolve`, then `refine` from its best distinct candidates.

    Parameters
    ----------
    objective, start, lower, upper, seed, population, generations, tolerance, watch
        As for `evolve`.
    rounds : int, optional
        As for `refine`.

    Returns
    -------
    Optimum

    Examples
    --------
    >>> from seatrial.optimize import minimize
    >>> valley = lambda x: 100 * (x[:, 1] - x[:, 0] ** 2) ** 2 + (1 - x[:, 0]) ** 2
    >>> best = minimize(valley, [-1, 2], lower=[-2, -2], upper=[2, 2])
    >>> bool(abs(best.x - 1).max() < 1e-2)
    True
    """
    coarse = evolve(
        objective,
        start,
        lower=lower,
        upper=upper,
        seed=seed,
        population=population,
        generations=generations,
        tolerance=tolerance,
        watch=watch,
    )
    if coarse.interrupted:
        return coarse
    fine = refine(
        objective, coarse.elite, lower=lower, upper=upper, rounds=rounds, tolerance=tolerance, watch=watch
    )
    return join(coarse, fine)


class _Stalled(Exception):
    """Ends simplexes that gain nothing any more."""


def batch_size(parameters: int, population: int | None = None) -> int:
    """Candidates per generation: the asked number or one that suits the parameters, in full lanes."""
    wanted = 4 + 3 * math.log(parameters) if population is None else population
    return LANES * math.ceil(wanted / LANES)


def refine_rounds(parameters: int) -> int:
    """Budget of rounds: a simplex of few parameters collapses about twice; many are left to `evolve`."""
    return min(80 * (parameters + 1), 500)
