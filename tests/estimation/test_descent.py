"""Gauss-Newton steps to the floor of a valley, on criteria whose optimum is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from seatrial.estimation.descent import Slopes, descend

Array = NDArray[np.float64]
Model = tuple[Callable[[Array], Array], Callable[[Array], Slopes]]


def criterion(
    simulate: Callable[[Array], Array], derive: Callable[[Array], Array], measured: Array, knee: float
) -> Model:
    """Batch criterion and slopes of a model: the mean loss over the samples."""
    share = np.full(len(measured), 1.0 / len(measured))

    def loss(error: Array) -> Array:
        if np.isinf(knee):
            return np.asarray(error**2)
        if knee == 0.0:
            return np.asarray(error)
        return np.asarray(np.where(error <= knee, error**2 / (2 * knee), error - knee / 2))

    def costs(candidates: Array) -> Array:
        return np.array([float(share @ loss(np.abs(measured - simulate(x)))) for x in candidates])

    return costs, lambda x: Slopes(measured - simulate(x), derive(x), share, knee)


def valley(knee: float = 0.0) -> Model:
    """Decay whose rate and amplitude trade against each other: a narrow curved valley, truth (2, 0.3)."""
    t = np.linspace(0.0, 2.0, 300)
    noise = np.random.default_rng(2).normal(0.0, 1e-3, len(t))

    def simulate(x: Array) -> Array:
        return np.asarray(x[0] * np.exp(-x[1] * t))

    def derive(x: Array) -> Array:
        shape = np.exp(-x[1] * t)
        return np.stack([shape, -x[0] * t * shape], axis=1)

    return criterion(simulate, derive, simulate(np.array([2.0, 0.3])) + noise, knee)


def linear(knee: float) -> tuple[Model, Array]:
    """A constant through data with outliers: its optimum is median, mean or between them."""
    measured = np.array([0.0, 0.1, 0.2, 0.3, 5.0])
    return criterion(lambda x: np.full(5, x[0]), lambda x: np.ones((5, 1)), measured, knee), measured


def test_descent_reaches_the_floor_of_a_valley() -> None:
    costs, slopes = valley()
    best = descend(costs, slopes, [0.6, 0.05], lower=[0.1, 0.0], upper=[10.0, 3.0])
    # Noise of 1e-3 over 300 samples: about 1e-4 in the amplitude, 2e-4 in the rate.
    assert best.x == pytest.approx([2.0, 0.3], abs=1e-3)
    assert best.cost < 1e-3 < best.start_cost
    assert len(best.history) <= 15
    assert {step.phase for step in best.history} == {"descent"}
    assert all(b.best <= a.best for a, b in zip(best.history, best.history[1:], strict=False))


def test_descent_stays_inside_the_bounds() -> None:
    costs, slopes = valley()
    best = descend(costs, slopes, [1.0, 0.1], lower=[0.1, 0.0], upper=[1.8, 3.0])
    assert best.x[0] == pytest.approx(1.8)
    # The best rate at that amplitude, from a fine grid.
    grid = np.linspace(0.0, 0.4, 4001)
    at_bound = costs(np.stack([np.full(len(grid), 1.8), grid], axis=1))
    assert best.x[1] == pytest.approx(grid[at_bound.argmin()], abs=2e-3)


@pytest.mark.parametrize("knee", [0.0, 0.5, np.inf])
def test_descent_minimises_absolute_squared_and_huber_losses(knee: float) -> None:
    (costs, slopes), measured = linear(knee)
    best = descend(costs, slopes, [3.0], lower=[-1.0], upper=[6.0], tolerance=1e-6)
    grid = np.linspace(-1.0, 6.0, 70001)
    exact = grid[costs(grid[:, None]).argmin()]
    # Reweighting takes absolute errors below a tenth of the mean as squares: near the median, not on it.
    assert best.x[0] == pytest.approx(exact, abs=0.06 if knee == 0.0 else 2e-3)
    assert exact == pytest.approx(np.median(measured) if knee == 0.0 else exact)


def test_parameter_without_influence_stays_where_it_is() -> None:
    (costs, slopes), _ = linear(np.inf)

    def wider(x: Array) -> Slopes:
        found = slopes(x[:1])
        return Slopes(found.residual, np.hstack([found.jacobian, np.zeros((5, 1))]), found.share, found.knee)

    best = descend(lambda x: costs(x[:, :1]), wider, [3.0, 0.25], lower=[-1.0, 0.0], upper=[6.0, 1.0])
    assert best.x == pytest.approx([1.12, 0.25], abs=1e-6)


def test_slopes_that_are_not_finite_end_the_descent() -> None:
    costs, slopes = valley()

    def broken(x: Array) -> Slopes:
        found = slopes(x)
        return Slopes(found.residual, np.full_like(found.jacobian, np.nan), found.share, found.knee)

    best = descend(costs, broken, [0.6, 0.05], lower=[0.1, 0.0], upper=[10.0, 3.0])
    assert best.x == pytest.approx([0.6, 0.05])
    assert best.cost == best.start_cost


def test_interrupt_keeps_the_best_so_far() -> None:
    costs, slopes = valley()

    def stop(_: object) -> None:
        raise KeyboardInterrupt

    best = descend(costs, slopes, [0.6, 0.05], lower=[0.1, 0.0], upper=[10.0, 3.0], watch=stop)
    assert best.interrupted
    assert len(best.history) == 1
    assert best.cost < best.start_cost
