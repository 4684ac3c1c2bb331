"""Subset simulation against probabilities that are known in closed form."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import binom, norm

from seatrial.base.arrays import Array
from seatrial.statistics.subset_simulation import (
    Level,
    Population,
    RareEvent,
    importance,
    population,
    rare_event,
)

Possible = Callable[[Array], NDArray[np.bool_]]


def linear(probability: float) -> Level:
    """A plane at the distance that gives the probability, askew to every axis."""
    distance = float(norm.isf(probability))
    return lambda x, _: distance - x.sum(axis=1) / np.sqrt(x.shape[1])


def two_sided(probability: float) -> Level:
    """Two planes at right angles: failures of two kinds."""
    distance = float(norm.isf(1.0 - np.sqrt(1.0 - probability)))
    return lambda x, _: np.minimum(distance - x[:, 0], distance + x[:, 1])


def noisy(probability: float) -> Level:
    """A plane of which the seed's noise decides a part."""
    distance = float(norm.isf(probability))
    return lambda x, seeds: distance - 0.95 * x[:, 0] - np.sqrt(1.0 - 0.95**2) * norm.ppf(seeds)


def found(level: Level, seed: int, *, dimensions: int, possible: Possible | None = None) -> RareEvent:
    generator = np.random.default_rng([17, seed])
    parts = tuple(population(level, dimensions, 500, generator, possible=possible) for _ in range(4))
    samples = np.vstack([one.samples for one in parts])
    return rare_event(parts, importance(level, samples, 1000, generator, possible=possible))


@pytest.mark.parametrize(
    ("level", "truth", "dimensions"),
    [(linear(1e-5), 1e-5, 10), (linear(1e-4), 1e-4, 40), (two_sided(1e-5), 1e-5, 20), (noisy(1e-4), 1e-4, 5)],
)
def test_intervals_hold_a_known_probability(level: Level, truth: float, dimensions: int) -> None:
    events = [found(level, seed, dimensions=dimensions) for seed in range(25)]
    inside = sum(low <= truth <= high for low, high in (one.interval for one in events))
    # Honest intervals of 95 % would fail this in 1 of 300 tests.
    assert inside >= binom.ppf(1.0 / 300.0, 25, 0.95)
    ratios = np.array([one.estimate / truth for one in events])
    assert 0.8 < ratios.mean() < 1.3
    compared = [one.agrees for one in events if one.agrees is not None]
    assert not compared or np.mean(compared) > 0.7
    assert np.median([one.plain / one.evaluations for one in events]) > 10.0


def test_a_distribution_that_is_cut_is_that_of_what_is_possible() -> None:
    # Cutting one coordinate leaves the probability of a plane across another one as it is.
    distance = float(norm.isf(1e-4))
    event = found(
        lambda x, _: distance - x[:, 0], 1, dimensions=6, possible=lambda x: np.asarray(x[:, 1] > -0.5)
    )
    assert event.interval[0] <= 1e-4 <= event.interval[1]
    assert event.agrees
    assert all((one.samples[:, 1] > -0.5).all() for one in event.populations)


def test_what_never_fails_is_said_to_be_rarer_than_the_last_level() -> None:
    one = population(lambda x, _: 100.0 - x[:, 0], 3, 200, np.random.default_rng(1))
    event = rare_event((one, one), None)
    assert event.estimate == 0.0
    assert one.reached == pytest.approx(1e-9, rel=0.2)
    assert 1e-9 < event.interval[1] < 1e-7


def test_levels_that_stand_still_end_and_say_so() -> None:
    # Half of the missions share a value: nothing leads on from there.
    one = population(lambda x, _: np.where(x[:, 0] > 0.0, 1.0, 2.0), 3, 200, np.random.default_rng(1))
    assert one.stood_still
    assert rare_event((one, one), None).interval == (0.0, 1.0)
    infinite = population(lambda x, _: np.full(len(x), np.inf), 3, 200, np.random.default_rng(1))
    assert infinite.stood_still


def test_a_frequent_failure_needs_no_levels() -> None:
    one = population(linear(0.3), 4, 1000, np.random.default_rng(2))
    assert one.thresholds == ()
    assert one.evaluations == 1000
    assert one.estimate == pytest.approx(0.3, abs=0.05)


def test_a_level_that_is_no_number_has_failed() -> None:
    def level(x: Array, _: Array) -> Array:
        return np.where(x[:, 0] > 1.0, np.nan, 1.0 - x[:, 0] + 1.0)

    one = population(level, 2, 1000, np.random.default_rng(3))
    assert isinstance(one, Population)
    assert one.estimate == pytest.approx(float(norm.sf(1.0)), rel=0.3)
