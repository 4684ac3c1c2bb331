"""What the search of a group is told, and which of its two searches has the last word."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from seatrial.base.work import Step
from seatrial.control_design.margin_constraint import MarginConstraint
from seatrial.estimation.search import Optimum
from seatrial.tuning import search as group_search
from seatrial.tuning.objective import Objective
from seatrial.tuning.search import GroupResult, Race, search_group, search_margins
from tests.tuning.tuning_campaigns import HEADING, plan

Array = NDArray[np.float64]

COARSE, FINE = 0.3, 0.5
"""ln(factor) that the evolution strategy and the simplexes find."""


@dataclass
class Searches:
    """Both searches, told what they find, and what they were given."""

    costs: tuple[float, float]
    interrupted: bool = False
    given: list[dict[str, Any]] = field(default_factory=list)
    objectives: list[Objective] = field(default_factory=list)

    def _found(self, phase: int, race: Race, begin: Array, given: dict[str, Any]) -> Optimum:
        self.objectives.append(race.objective)
        self.given.append(given)
        x = np.full(len(given["lower"]), (COARSE, FINE)[phase])
        step = Step("", 1, 1, 10, self.costs[phase], 0.0)
        return Optimum(x, self.costs[phase], 9.0, x[None], np.eye(len(x)), 10, (step,), self.interrupted)

    def evolve(self, cost: Race, begin: Array, **given: Any) -> Optimum:
        return self._found(0, cost, begin, given)

    def refine(self, cost: Any, begin: Array, **given: Any) -> Optimum:
        np.testing.assert_array_equal(begin, np.full((1, len(given["lower"])), COARSE))
        return self._found(1, cost.__self__, begin, given)

    def of(self, monkeypatch: pytest.MonkeyPatch, text: str = HEADING) -> GroupResult:
        monkeypatch.setattr(group_search, "evolve", self.evolve)
        monkeypatch.setattr(group_search, "refine", self.refine)
        monkeypatch.setattr(group_search, "_terms", lambda *_: {})
        one = plan(text)
        rig = one.rig(one.autopilot, threads=1)
        return search_group(one, one.groups[0], rig, one.samples(1, 5), seed=11, start={})


def factor(result: GroupResult) -> float:
    return result.gains["heading.K_P.5"] / plan().autopilot.gains()["heading.K_P.5"]


@pytest.mark.parametrize(("costs", "x"), [((2.0, 1.0), FINE), ((1.0, 2.0), COARSE), ((1.0, 1.0), FINE)])
def test_the_better_of_both_searches_is_taken(
    costs: tuple[float, float], x: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = Searches(costs).of(monkeypatch)
    assert factor(result) == pytest.approx(np.exp(x), rel=1e-12)
    # The candidates of both count where the second one has the last word.
    assert result.evaluations == (20 if x == FINE else 10)


def test_ctrl_c_in_the_first_search_ends_both(monkeypatch: pytest.MonkeyPatch) -> None:
    searches = Searches((2.0, 1.0), interrupted=True)
    result = searches.of(monkeypatch)
    assert result.interrupted
    assert len(searches.given) == 1
    assert factor(result) == pytest.approx(np.exp(COARSE), rel=1e-12)


def test_the_search_is_held_against_what_the_file_says(monkeypatch: pytest.MonkeyPatch) -> None:
    searches = Searches((2.0, 1.0))
    text = HEADING.replace("samples = 1", "samples = 1\nrobust = 0.75\nsmoothness = 0.3\nbounds = [0.2, 3.0]")
    text = text.replace("phase_deg = 0.0", "phase_deg = 41.0")
    searches.of(monkeypatch, text)
    for objective in searches.objectives:
        assert objective.quantile == 0.75
        assert objective.smoothness == 0.3
        assert objective.margins is not None
        assert objective.margins.limits.phase_deg == 41.0
        assert [trials.loop for trials in objective.trials] == ["heading"]
        assert len(objective.samples) == 2
    first, second = searches.given
    assert (first["population"], first["generations"], second["rounds"]) == (8, 6, 3)
    assert first["seed"] == 11
    names = searches.objectives[0].parameters.names
    ends = dict(zip(names, np.exp([first["lower"], first["upper"]]).T.tolist(), strict=True))
    assert ends["heading.K_P.5"] == pytest.approx([0.2, 3.0])
    assert ends["heading.reference_rad_s"] == pytest.approx([0.3, 3.0])


def test_without_a_word_the_worst_sample_counts_and_no_margin_where_none_is_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    searches = Searches((2.0, 1.0))
    searches.of(monkeypatch)
    assert searches.objectives[0].quantile == 1.0
    assert searches.objectives[0].margins is None


def test_of_gains_whose_margins_hold_those_nearest_to_the_start_are_sought(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    costs: list[Array] = []

    def evolve(cost: Any, begin: Array, **given: Any) -> Optimum:
        x = np.outer([0.0, 0.5, -1.0], np.ones(len(begin)))
        costs.append(cost(x))
        return Optimum(begin, 0.0, 0.0, begin[None], np.eye(len(begin)), 3, (), interrupted=True)

    monkeypatch.setattr(group_search, "evolve", evolve)
    # The start gains are short at one point, so that there is a search; any other gains are not.
    monkeypatch.setattr(
        MarginConstraint, "shortfall", lambda _, gains: np.zeros(len(next(iter(gains.values()), [0.0])))
    )
    search_margins(plan("[tuning]\nmargins = { phase_deg = 60.0 }\n[tuning.loops.heading]"), seed=1)
    (found,) = costs
    assert found[0] == 0.0
    # By the square of the logarithm of the factor.
    assert found[2] == pytest.approx(4.0 * found[1])
    assert 0.0 < found[2] < 0.1  # far less than a margin that is used up


def test_a_factor_at_a_bound_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    wide = Searches((2.0, 1.0)).of(monkeypatch)
    assert wide.at_bound == ()
    text = HEADING.replace("samples = 1", f"samples = 1\nbounds = [0.1, {np.exp(FINE)}]")
    tight = Searches((2.0, 1.0)).of(monkeypatch, text)
    assert "heading.K_P.5" in tight.at_bound
    assert "heading.reference_rad_s" not in tight.at_bound
