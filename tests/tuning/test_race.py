"""A race of candidates: the same parents as with all samples, at fewer flights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from seatrial.control_design.margin_constraint import MarginConstraint
from seatrial.tuning.objective import Flown, Objective
from seatrial.tuning.scope import GainParameters
from seatrial.tuning.search import SETTINGS as GROUP_SEARCH_SETTINGS
from seatrial.tuning.search import Race
from seatrial.tuning.step_trial import Samples
from tests.tuning.tuning_campaigns import rig, start, trials

Array = NDArray[np.float64]

HEADING = GainParameters.of_loop(
    "heading", start().gains(), free=[4], taken=[0, 1, 2, 3, 5], reached=range(6), bounds=(0.1, 10.0)
)
CANDIDATES = 16


class Lacking:
    """Margins of which a candidate lacks as much as its first gain was made larger."""

    def shortfall(self, gains: dict[str, Array]) -> Array:
        return np.maximum(np.log(gains["heading.K_P.5"] / start().gains()["heading.K_P.5"]), 0.0)


def objective(count: int, nominal: int = 1, margins: Any = None, quantile: float = 1.0) -> Objective:
    return Objective(
        rig(),
        (trials("heading", (1.0,), (0.3,), until_s=12.0),),
        Samples({}, np.zeros((count, 3)), tuple(range(count)), nominal),
        HEADING,
        cast("MarginConstraint | None", margins),
        quantile,
        0.0,
        np.ones(6, bool),
    )


class Flights:
    """What candidates do, known beforehand, and how many flights were asked for."""

    def __init__(self, violation: Array) -> None:
        self.violation, self.x = violation, np.zeros((0, 0))
        self.flown = np.zeros(violation.shape, dtype=int)

    def __call__(self, x: Array, places: Sequence[int]) -> Flown:
        rows = [int(np.flatnonzero((self.x == one).all(axis=1))[0]) for one in x]
        self.flown[np.ix_(np.asarray(rows), np.asarray(places))] += 1
        chosen = self.violation[np.ix_(np.asarray(rows), np.asarray(places))]
        return Flown(chosen, np.zeros_like(chosen), 0.1 * chosen, np.zeros_like(chosen))


def generation(seed: int, samples: int) -> tuple[Array, Flights]:
    rng = np.random.default_rng(seed)
    # Samples are alike, as common noise makes them, and none is beyond doubt the worst.
    hard = rng.gamma(1.0, 1.0, (CANDIDATES, 1)) * rng.uniform(0.3, 1.0, (CANDIDATES, samples))
    flights = Flights(hard)
    flights.x = rng.normal(0.0, 0.1, (CANDIDATES, len(HEADING)))
    return flights.x, flights


@pytest.mark.parametrize("seed", range(20))
def test_law_parents_and_their_costs_are_those_of_all_samples(seed: int) -> None:
    x, flights = generation(seed, GROUP_SEARCH_SETTINGS.few_samples)
    race = Race(objective(GROUP_SEARCH_SETTINGS.few_samples, margins=Lacking()), flights)
    whole = Race(objective(GROUP_SEARCH_SETTINGS.few_samples, margins=Lacking()), flights).exactly(x)
    race.exactly(x[:1])  # the start, as an evolution strategy asks for it
    flights.flown[:] = 0
    found = race(x)
    parents = np.argsort(whole, kind="stable")[: CANDIDATES // 2]
    np.testing.assert_array_equal(np.argsort(found, kind="stable")[: CANDIDATES // 2], parents)
    np.testing.assert_array_equal(found[parents], whole[parents])
    assert (found <= whole + 1e-12).all()  # of the others at least what some samples make of them
    assert flights.flown.max() == 1  # no flight twice


def test_a_race_saves_a_fifth_of_the_flights() -> None:
    flown = 0
    for seed in range(20):
        x, flights = generation(seed, GROUP_SEARCH_SETTINGS.few_samples)
        race = Race(objective(GROUP_SEARCH_SETTINGS.few_samples, margins=Lacking()), flights)
        race.exactly(x[:1])
        flights.flown[:] = 0
        race(x)
        flown += int(flights.flown.sum())
    assert flown < 0.8 * 20 * CANDIDATES * GROUP_SEARCH_SETTINGS.few_samples


def test_who_lacks_more_margin_than_parents_cost_is_not_flown() -> None:
    x, flights = generation(3, GROUP_SEARCH_SETTINGS.few_samples)
    race = Race(objective(GROUP_SEARCH_SETTINGS.few_samples, margins=Lacking()), flights)
    race(x)
    flights.x = x.copy()
    flights.x[:4] = 2.0  # e^2 times the gain: a cost of 60 without any flight
    flights.flown[:] = 0
    costs = race(flights.x)
    assert not flights.flown[:4].any()
    assert (costs[:4] >= 60.0).all()


def test_a_quantile_takes_all_samples_of_all_candidates() -> None:
    x, flights = generation(4, GROUP_SEARCH_SETTINGS.few_samples)
    race = Race(objective(GROUP_SEARCH_SETTINGS.few_samples, quantile=0.9), flights)
    race(x)
    race(x)
    assert (flights.flown == 2).all()


def test_of_many_samples_the_worst_noises_and_vehicles_are_met_and_all_have_the_last_word() -> None:
    x, flights = generation(5, 11)
    flights.violation[0] = [0.0, 0.3, 0.0, 0.0, 0.9, 0.0, 0.0, 0.0, 0.0, 0.5, 0.2]
    race = Race(objective(11, nominal=8), flights)
    race.narrow(x[:1])
    assert race.narrowed
    assert race.met == [1, 4, 8, 9, 10]
    costs = race.with_all(x)
    np.testing.assert_allclose(costs, Race(objective(11, nominal=8), flights).exactly(x))
    few = Race(objective(GROUP_SEARCH_SETTINGS.few_samples), flights)
    few.narrow(x[:1])
    assert not few.narrowed


def test_a_search_has_enough_when_corridors_are_kept_and_nothing_is_gained() -> None:
    x, flights = generation(6, 2)
    outside, inside = (Race(objective(2), flights) for _ in range(2))
    for _ in range(15):
        outside(x)
    assert not outside.enough()
    assert not outside.inside()
    flights.violation[:] = 0.0
    for count in range(15):
        assert not inside.enough() or count > 10
        inside(x)
    assert inside.enough()
    assert inside.inside()


def test_a_diverged_candidate_is_no_parent() -> None:
    x, flights = generation(7, GROUP_SEARCH_SETTINGS.few_samples)
    flights.violation[2] = np.inf
    race = Race(replace(objective(GROUP_SEARCH_SETTINGS.few_samples), margins=None), flights)
    race(x)
    costs = race(x)
    assert np.isinf(costs[2]) or costs[2] > np.sort(costs)[CANDIDATES // 2 - 1]
