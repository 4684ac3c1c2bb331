"""Gauss-Newton steps to the floor of the valley that a global search has found.

Damping and lift of one axis trade against each other, so that the criterion is a long narrow valley: a
search by costs alone creeps along it and may end on its slope. A step solves the criterion with the model
linearised, ``min_d sum_i s_i L(r_i - J_i d)`` inside the bounds, the loss ``L`` by reweighted least squares
(Holland & Welsch 1977), and eight lengths of it are tried in one batch. Only a lower cost is accepted.

Held by `test_descent_reaches_the_floor_of_a_valley`, `test_descent_stays_inside_the_bounds` and
`test_descent_minimises_absolute_squared_and_huber_losses`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.arrays import Array
from seatrial.base.progress import Watch
from seatrial.estimation.search import Ledger, Objective, Optimum

DESCENT_ROUNDS = 15
"""Budget of steps; three to six are usual."""

_LENGTHS = np.array([1.0, 0.7, 0.5, 0.3, 0.15, 0.05, 0.01, 1.3])
"""Lengths of a step that are tried in one batch of eight lanes; one is beyond the full step."""

_SWEEPS = 8
"""Reweightings within a step."""

_FLOOR = 0.1  # of the mean error: below it an absolute error is taken as a square, as reweighting must


@dataclass(frozen=True)
class Slopes:
    """A criterion's residuals and their derivatives at a candidate.

    Attributes
    ----------
    residual
        Measured minus simulated (n,), in standard deviations of the channel.
    jacobian
        Derivative (n, m) of what is simulated by the parameters, in the same unit.
    share
        Share (n,) of every sample in the criterion.
    knee
        Up to here, in standard deviations, an error counts as its square: 0 for absolute, infinite for
        squared errors, between them Huber's loss.
    """

    residual: Array
    jacobian: Array
    share: Array
    knee: float


def descend(
    objective: Objective,
    slopes: Callable[[Array], Slopes],
    start: ArrayLike,
    *,
    lower: ArrayLike,
    upper: ArrayLike,
    rounds: int = DESCENT_ROUNDS,
    tolerance: float = 1e-4,
    watch: Watch | None = None,
) -> Optimum:
    """Optimum of a descent inside the bounds from one start.

    Parameters
    ----------
    objective : callable
        Costs ``(k,)`` of candidates ``(k, m)``.
    slopes : callable
        `Slopes` at a candidate ``(m,)``.
    start : array_like, shape (m,)
    lower, upper : array_like, shape (m,)
        Bounds; no candidate lies outside.
    rounds : int
        Steps at most.
    tolerance : float
        Stop when a step gains less than a tenth of this fraction of the cost.
    watch : callable, optional
        Called with a `Step` after every round; a KeyboardInterrupt that it raises ends the descent.

    Examples
    --------
    >>> import numpy as np
    >>> from seatrial.estimation.descent import Slopes, descend
    >>> model = lambda x: Slopes(np.array([1.0, 2.0]) - x, np.eye(2), np.full(2, 0.5), np.inf)
    >>> cost = lambda x: 0.5 * ((np.array([1.0, 2.0]) - x) ** 2).sum(axis=1)
    >>> descend(cost, model, [0.0, 0.0], lower=[-5, -5], upper=[5, 1.5]).x.round(6).tolist()
    [1.0, 1.5]
    """
    ledger = Ledger(objective, lower, upper, "descent", rounds, watch)

    def search() -> None:
        at = ledger.to_box(start)
        ledger.start_cost = float(ledger.costs(at[None, :])[0])
        while ledger.generation < rounds:
            here = slopes(ledger.from_box(at))
            jacobian = here.jacobian * ledger.width
            if not (np.isfinite(here.residual).all() and np.isfinite(jacobian).all()):
                break
            step = _step(here, jacobian, -at, 1.0 - at)
            before = ledger.best_cost
            candidates = np.clip(at + _LENGTHS[:, None] * step, 0.0, 1.0)
            costs = ledger.costs(candidates)
            if costs.min() < before:
                at = candidates[int(costs.argmin())]
            ledger.close_generation()
            if not before - ledger.best_cost > 0.1 * tolerance * abs(before):
                break

    return ledger.run(search)


def _step(slopes: Slopes, jacobian: Array, lower: Array, upper: Array) -> Array:
    """Step (m,) between the bounds that minimises the linearised criterion."""
    from scipy.optimize import lsq_linear

    floor = _FLOOR * float(slopes.share @ np.abs(slopes.residual)) / float(slopes.share.sum())
    knee = max(slopes.knee, floor, np.finfo(float).tiny)
    step: Array = np.zeros(jacobian.shape[1])
    for _ in range(_SWEEPS):
        if np.isinf(knee):
            weight = slopes.share
        else:
            weight = slopes.share / np.maximum(np.abs(slopes.residual - jacobian @ step), knee)
        weighted = weight[:, None] * jacobian
        normal = weighted.T @ jacobian
        # A direction that changes nothing must not spoil the others: it stays where it is.
        normal += np.eye(len(step)) * max(1e-10 * float(np.trace(normal)), np.finfo(float).tiny)
        factor = np.linalg.cholesky(normal)
        aim = np.linalg.solve(factor, weighted.T @ slopes.residual)
        bounds = (np.minimum(lower, 0.0) - 1e-12, np.maximum(upper, 0.0) + 1e-12)
        former, step = step, np.asarray(lsq_linear(factor.T, aim, bounds=bounds).x, dtype=float)
        if np.abs(step - former).max() < 1e-5:
            break
    return step
