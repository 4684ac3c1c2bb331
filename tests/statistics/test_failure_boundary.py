"""The boundary of a failure probability that is known, from binomial failures at chosen places."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import norm

from seatrial.base.arrays import Array
from seatrial.statistics.failure_probability import (
    BoundarySurface,
    Place,
    places_to_fly,
    start_places,
    surface_of,
)

ALLOWED = 0.05

Probability = Callable[[Array], float]


def steep(x: Array) -> float:
    """Crosses what is allowed at 0.6."""
    return float(norm.cdf((x[0] - 0.6) / 0.05 + norm.ppf(ALLOWED)))


def gentle(x: Array) -> float:
    """Crosses what is allowed at 0.4."""
    return float(norm.cdf((x[0] - 0.4) / 0.3 + norm.ppf(ALLOWED)))


def bent(x: Array) -> float:
    """Crosses what is allowed where ``x + y^2 / 2 = 0.7``."""
    return float(norm.cdf((x[0] + 0.5 * x[1] ** 2 - 0.7) / 0.1 + norm.ppf(ALLOWED)))


def found(probability: Probability, seed: int, *, dimensions: int, missions: int) -> BoundarySurface:
    generator, runs = np.random.default_rng([5, seed]), 16
    places: list[Place] = []
    waiting = list(start_places(dimensions))
    while sum(one.runs for one in places) + runs * len(waiting) <= missions:
        for x in waiting:
            failures = int(generator.binomial(runs, probability(x)))
            places.append(Place(tuple(x.tolist()), runs, failures))
        waiting = list(places_to_fly(places, allowed=ALLOWED, confidence=0.95, count=8, runs=runs))
    return surface_of(places, allowed=ALLOWED, confidence=0.95)


@pytest.mark.long
@pytest.mark.parametrize(("probability", "truth"), [(steep, 0.6), (gentle, 0.4)])
def test_intervals_hold_a_known_boundary(probability: Probability, truth: float) -> None:
    inside, values = 0, []
    for seed in range(8):
        crossings = [
            one for one in found(probability, seed, dimensions=1, missions=700).crossings() if one.rising
        ]
        assert crossings, seed
        nearest = min(crossings, key=lambda one: abs(one.at - truth))
        inside += nearest.interval[0] <= truth <= nearest.interval[1]
        values.append(nearest.at)
    # Honest intervals of 95 % would fail this in 1 of 170 tests.
    assert inside >= 6
    assert abs(np.mean(values) - truth) < 0.1


def test_a_boundary_in_two_variables_is_bent() -> None:
    surface = found(bent, 1, dimensions=2, missions=900)
    for second in (0.2, 0.8):
        (one,) = (each for each in surface.crossings(second) if each.rising)
        assert one.at == pytest.approx(0.7 - 0.5 * second**2, abs=0.12)
    assert {-1, 0, 1} == set(np.unique(surface.sides).tolist())


def test_what_never_fails_has_no_boundary() -> None:
    surface = found(lambda _: 0.0, 2, dimensions=1, missions=700)
    assert not surface.crossings()
    assert (surface.mean < surface.level).all()
