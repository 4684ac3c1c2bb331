"""A group that a later one spoils is searched again, with the gains so far and under more noises."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
import pytest

import seatrial as st
from seatrial.tuning.control_problem import ControlProblem
from seatrial.tuning.result import assess
from tests.tuning.tuning_campaigns import HEADING, campaign, plan
from tests.tuning.tuning_runs import Told

GROUPS = ("heading", "surge", "pitch")
TEXT = HEADING.partition("[tuning.loops")[0] + "\n".join(
    f"[tuning.loops.{loop}]\nsteps = [{step}]\nspeeds_m_s = [3.0]\n"
    "corridor = { rise_s = 7.0, overshoot = 0.3, settling_s = 12.0, until_s = 15.0 }"
    for loop, step in (("heading", 20.0), ("surge", -0.3), ("pitch", 10.0))
)
GAIN = {group: f"{group}.K_P.5" for group in GROUPS}


@cache
def of() -> tuple[st.Campaign, ControlProblem]:
    return campaign(TEXT), plan(TEXT)


def moved(group: str, gains: Mapping[str, float]) -> bool:
    return gains[GAIN[group]] != of()[1].autopilot.gains()[GAIN[group]]


def larger(group: str, gains: Mapping[str, float]) -> dict[str, float]:
    """A search that makes its gain larger by a tenth of the start, whatever it was."""
    start = of()[1].autopilot.gains()[GAIN[group]]
    return {GAIN[group]: gains.get(GAIN[group], start) + 0.1 * start}


def spoilt_by_surge(group: str, gains: Mapping[str, float]) -> float:
    """Heading leaves its corridor when the gains of surge have moved, until its own move twice."""
    start = of()[1].autopilot.gains()[GAIN["heading"]]
    return 0.5 * (group == "heading" and moved("surge", gains) and gains[GAIN["heading"]] < 1.15 * start)


def names(found: Told) -> list[str]:
    return [search.group for search in found.searches]


def test_only_groups_that_leave_a_corridor_are_searched_again(monkeypatch: pytest.MonkeyPatch) -> None:
    told = Told(larger, spoilt_by_surge)
    tuning = told.run(monkeypatch, *of())
    assert names(told) == [*GROUPS, "heading"]
    assert [group.name for group in tuning.groups] == [*GROUPS, "heading, again (2)"]
    # Each group is looked at alone, after all have had their turn.
    assert [performance.groups for performance in told.assessments[:3]] == [(group,) for group in GROUPS]


def test_nothing_is_searched_again_where_all_corridors_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    told = Told(larger)
    told.run(monkeypatch, *of())
    assert names(told) == [*GROUPS]


def test_a_group_whose_search_gave_margins_away_is_searched_again(monkeypatch: pytest.MonkeyPatch) -> None:
    told = Told(larger, given_away={"surge": 0.3})
    told.run(monkeypatch, *of())
    assert names(told) == [*GROUPS, "surge"]


def test_there_is_a_second_turn_and_no_third(monkeypatch: pytest.MonkeyPatch) -> None:
    told = Told(larger, lambda group, gains: 1.0)
    told.run(monkeypatch, *of())
    assert names(told) == [*GROUPS, *GROUPS]


def test_a_search_goes_on_from_the_gains_that_all_the_others_found(monkeypatch: pytest.MonkeyPatch) -> None:
    told = Told(larger, spoilt_by_surge)
    tuning = told.run(monkeypatch, *of())
    before = of()[1].autopilot.gains()
    so_far: dict[str, float] = {}
    for search in told.searches:
        assert search.start == so_far
        assert search.rig.autopilot.gains() == before | so_far
        so_far |= larger(search.group, so_far)
    # What is handed out is the second find of heading, to the four digits that are written.
    after = tuning.autopilot.gains()
    assert after == before | {name: pytest.approx(value, rel=1e-3) for name, value in so_far.items()}
    assert so_far[GAIN["heading"]] == pytest.approx(1.2 * before[GAIN["heading"]])


def test_no_two_searches_share_their_random_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    told = Told(larger, lambda group, gains: 1.0)
    told.run(monkeypatch, *of())
    seeds = [search.seed for search in told.searches]
    assert len(set(seeds)) == len(seeds) == 6


def test_a_second_search_meets_the_vehicle_itself_with_several_noises(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    told = Told(larger, lambda group, gains: 1.0)
    told.run(monkeypatch, *of())
    first, second = (told.searches[place].samples for place in (0, len(GROUPS)))
    again = told.assessments[0].samples
    assert first.nominal == 1
    # One noise more or less decided that a group was searched again: one alone would not show why.
    assert again.nominal > 1
    # What shows who needs a second search is what it flies: vehicles, currents and noises.
    assert second.nominal == again.nominal
    np.testing.assert_array_equal(second.seeds, again.seeds)
    np.testing.assert_array_equal(second.current, again.current)
    for name, column in first.coefficients.items():
        np.testing.assert_array_equal(column[1:], second.coefficients[name][second.nominal :])


WIDE = HEADING.partition("[tuning.loops")[0] + "\n".join(
    f"[tuning.loops.{loop}]\nsteps = [{step}]\nspeeds_m_s = [3.0]\n"
    "corridor = { upper = [[0, 2]], lower = [[0, -1], [10, -1], [10, 0.6], [15, 0.6]] }"
    for loop, step in (("heading", 20.0), ("surge", -0.5))
)
"""Corridors that the start gains keep to with room to spare, and a hull that hardly turns does not."""


@pytest.mark.parametrize(("factor", "again"), [(0.02, ["heading"]), (1.0, [])])
def test_flights_tell_which_group_is_spoilt(
    factor: float, again: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    one = plan(WIDE)
    start = {name: value for name, value in one.autopilot.gains().items() if name.startswith("heading.K_P.")}

    def found(group: str, gains: Mapping[str, float]) -> dict[str, float]:
        # The search of surge brings the gains of heading with it that spoil it.
        return {name: (factor if group == "surge" else 1.0) * value for name, value in start.items()}

    told = Told(found)
    monkeypatch.setattr(told, "assess", assess)
    told.run(monkeypatch, campaign(WIDE), one)
    assert names(told)[2:] == again
