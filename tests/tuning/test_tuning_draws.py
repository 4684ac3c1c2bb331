"""What searches, assessment and verification of a tuning draw: nothing of it twice."""

from __future__ import annotations

from functools import cache
from itertools import combinations

import pytest

import seatrial as st
from seatrial.identification.fitted import Fitted
from seatrial.tuning import tuning_run
from seatrial.tuning.control_problem import ControlProblem
from seatrial.tuning.step_trial import Samples
from seatrial.verification.draws import draw_missions
from seatrial.verification.table import parse_verification
from tests.flight.flying import OUT, mission
from tests.tuning.tuning_campaigns import HEADING, campaign, plan
from tests.tuning.tuning_runs import Told, values

RUNS = 200
"""Flights of the verification: more than a tuning draws, in case both take theirs from one row of numbers."""


@cache
def made() -> tuple[st.Campaign, ControlProblem]:
    """A tuning of a vehicle whose drag is known to a tenth."""
    text = HEADING.replace("samples = 1", "samples = 6")
    given, one = campaign(text), plan(text)
    fitted = Fitted.of("cwolf", percent={"X_uu": 10.0})
    return given, ControlProblem.of_table(one.table, fitted, one.autopilot, name=given.name, seed=given.seed)


def test_responses_are_assessed_in_finer_steps_of_integration_than_they_are_searched_in(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    told = Told()
    told.run(monkeypatch, *made())
    finest = min(search.rig.max_step_s for search in told.searches)
    assert all(
        performance.rig.max_step_s <= 0.5 * finest for performance in told.assessments if performance.name
    )
    assert [performance.name for performance in told.assessments if performance.name] == ["start", "tuned"]


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch) -> dict[str, list[Samples]]:
    """Samples of both turns of the search, of the start gains' last chance and of the assessment."""
    told, taken = Told(outside_s=lambda group, gains: 1.0), list[Samples]()

    def revert_gains(
        _: ControlProblem, gains: dict[str, float], samples: Samples, **__: object
    ) -> tuple[dict[str, float], tuple[str, ...]]:
        taken.append(samples)
        return dict(gains), ()

    monkeypatch.setattr(tuning_run, "revert_gains", revert_gains)
    told.run(monkeypatch, *made())
    return {
        "search": [search.samples for search in told.searches],
        "again": [performance.samples for performance in told.assessments if not performance.name],
        "revert": taken,
        "performance": [performance.samples for performance in told.assessments if performance.name],
    }


def test_the_assessment_s_vehicles_and_noises_are_none_that_a_search_met(
    flown: dict[str, list[Samples]],
) -> None:
    seen = flown["search"] + flown["again"]
    assert len(flown["search"]) == 2
    for last in flown["performance"]:
        assert len(last) - last.nominal == 24
        assert len(values(last)) == 24
        for met in seen:
            assert len(values(met)) == 6
            assert not values(met) & values(last)
            assert not set(met.seeds) & set(last.seeds)


def test_all_autopilots_are_assessed_on_the_same_and_gains_are_reverted_on_it(
    flown: dict[str, list[Samples]],
) -> None:
    first, *others = [*flown["performance"], *flown["revert"]]
    assert len(others) == 2  # start and tuned, and what is reverted
    for other in others:
        assert other.seeds == first.seeds
        assert other.nominal == first.nominal > 1
        assert values(other) == values(first)
        assert (other.current == first.current).all()


def test_a_verification_flies_vehicles_and_noises_that_no_tuning_met(flown: dict[str, list[Samples]]) -> None:
    given, one = made()
    table = parse_verification('[verification]\nmissions = ["out.toml"]\n', "campaign.toml")
    cases = draw_missions(table, one.fitted, [mission(OUT)], seed=given.seed, numbers=RUNS)
    drawn = set(cases.coefficients["X_uu"].tolist())
    assert len(drawn) == RUNS
    for samples in (samples for part in flown.values() for samples in part):
        assert not values(samples) & drawn
        assert not set(samples.seeds) & set(cases.seeds.tolist())


def test_law_noises_of_two_seeds_have_nothing_in_common() -> None:
    _, one = made()
    each = [set(one.samples(24, seed, nominal=8).seeds) for seed in (0, 1, 2, 7919, 7920)]
    assert all(len(seeds) == 32 for seeds in each)
    assert not any(a & b for a, b in combinations(each, 2))
