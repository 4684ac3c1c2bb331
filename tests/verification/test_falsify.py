"""The worst mission, the least disturbance that still fails, and the case that it becomes."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import seatrial as st
from seatrial.base.errors import CampaignError
from seatrial.base.work import Work
from seatrial.report.results.surveys import disturbance
from seatrial.verification.chosen_missions import check_cases, draws_of, fly_cases
from seatrial.verification.falsify import Falsification, Falsify
from seatrial.verification.scenario import Scenario
from seatrial.verification.table import CaseTable, parse_verification
from tests.verification.test_rare import prepared

HOLDS = "true_cross_track_largest_m <= 4"


@cache
def falsified() -> Falsification:
    return Falsify(budget=600).survey(prepared(HOLDS, "not abort", "duration_s <= 1000"))


def with_cases(asked: Scenario, text: str) -> Scenario:
    cases = parse_verification(f'[verification]\nmissions = ["out.toml"]\n{text}', "cases").cases
    table = asked.flights.table.model_copy(update={"cases": cases, "runs": 64})
    return asked.with_flights(replace(asked.flights, table=table))


def test_the_least_disturbance_fails_and_less_does_not() -> None:
    one = falsified().requirements[0]
    assert one.falsified
    sample = np.array(one.sample)
    # An offset of the position is enough: guidance believes it. The limit is 4 m, the deviation 1.5 m.
    assert np.count_nonzero(sample) <= 3
    assert any("offset of the measured" in name for name in one.disturbance)
    assert -1.0 < one.robustness <= 0.0
    assert one.worst <= one.robustness
    space_value = falsified().replay("number 0").metrics["true_cross_track_largest_m"]
    assert space_value == pytest.approx(4.0 - one.robustness, rel=1e-9)


def test_what_cannot_be_searched_and_what_withstands_is_said() -> None:
    found = falsified()
    reason = found.requirements[1].why_not
    assert reason is not None
    assert reason.kind == "no distance"
    assert not found.requirements[2].falsified
    assert found.requirements[2].worst > 0.0
    text = found.summary()
    assert "Least disturbance that fails: number 0" in text
    assert "no usable robustness" in text
    assert found.report().outcome == "falsified"
    with pytest.raises(CampaignError, match="none to fly again"):
        found.replay("number 2")


def test_a_case_is_flown_as_it_was_found() -> None:
    found = falsified()
    asked = with_cases(found.scenario, found.cases())
    drawn, case = found.drawn("number 0"), draws_of(asked.flights.table.cases, asked.flights)
    for name in (
        "mission",
        "current",
        "turbulence",
        "waves",
        "position",
        "attitude",
        "nu",
        "seeds",
        "offsets",
    ):
        assert getattr(case, name) == pytest.approx(getattr(drawn, name), abs=1e-12), name
    flown = fly_cases(asked.flights.table.cases, asked.flights, asked.requirements)
    assert flown[0].robustness["number 0"] == pytest.approx(found.requirements[0].robustness, abs=1e-6)
    assert not flown[0].held


def test_verify_fails_with_a_case_that_fails_and_holds_with_one_that_holds() -> None:
    asked = with_cases(prepared("true_cross_track_largest_m <= 12", probability=0.9), "")
    assert st.verify(asked).cases == ()
    text = falsified().cases()
    held = st.verify(with_cases(asked, text))
    assert [one.held for one in held.cases] == [True]
    strict = with_cases(prepared(HOLDS, probability=0.05), text)
    failed = st.verify(strict)
    assert failed.requirements[0].verdict == "held"
    assert failed.outcome == "failed"
    assert "regression case falsified: number 0" in failed.report().worst
    assert "case falsified: number 0" in failed.junit()
    assert failed.to_dict()["cases"][0]["held"] is False


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"mission": "ot"}, "key mission: unknown 'ot'"),
        ({"requirements": ("nothing",)}, "key requirements: unknown 'nothing'"),
        ({"coefficients": {"X_uuu": 1.0}}, "key coefficients: unknown 'X_uuu'"),
        ({"sensor_offsets": {"yew": 1.0}}, "key sensor_offsets: unknown 'yew'"),
        ({"faults": ({"actuator": "bow", "at_s": 3.0},)}, "bow"),
        ({"outages": ({"sensor": "gpss", "from_s": 1.0, "until_s": 2.0},)}, "gpss"),
    ],
)
def test_cases_that_cannot_be_flown_are_refused(given: dict[str, object], words: str) -> None:
    asked = prepared(HOLDS)
    case = CaseTable.model_validate({"name": "one"} | given)
    with pytest.raises(CampaignError, match=words):
        check_cases([case], asked.flights, asked.requirements, "campaign.toml")


def test_faults_and_outages_of_a_case_are_its_own() -> None:
    asked = prepared(HOLDS)
    faults = ({"actuator": "PL", "at_s": 3.0, "command": 0.0}, {"actuator": "PU", "at_s": 4.0})
    outages = ({"sensor": "velocity", "from_s": 1.0, "until_s": 2.0},)
    plain = CaseTable(name="plain")
    case = CaseTable.model_validate({"name": "one", "faults": faults, "outages": outages})
    drawn = draws_of([plain, case], asked.flights)
    assert [(row[0], row[1], row[2]) for row in drawn.faults] == [(1, "PL", 3.0), (1, "PU", 4.0)]
    assert np.isnan(drawn.faults[1][3])
    assert [row[0] for row in drawn.outages] == [1]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [({"within": 0.0}, "0.1 to 8"), ({"budget": 10}, "at least 100"), ({"requirements": ["x"]}, "unknown")],
)
def test_bad_arguments_are_refused(arguments: dict[str, object], words: str) -> None:
    with pytest.raises(CampaignError, match=words):
        Falsify(**arguments).survey(prepared(HOLDS))  # type: ignore[arg-type]


def test_the_run_directory_holds_the_case(tmp_path: Path) -> None:
    found = Falsify(budget=300).survey(prepared(HOLDS), Work(run_dir=tmp_path / "run"))
    text = (tmp_path / "run" / "cases.toml").read_text()
    assert text == found.cases()
    assert "[[verification.cases]]" in text


def test_where_the_middle_of_all_ranges_fails_its_values_are_named() -> None:
    one = falsified().requirements[0]
    assert one.middle
    assert {name: middle for name, (_, middle) in one.disturbance.items()}.items() <= one.middle.items()
    already = replace(one, disturbance={}, middle={"current north, m/s": 0.3, "gain of stern": 1.0})
    assert disturbance(already) == [
        "the middle of all ranges fails already: current north, m/s 0.3, gain of stern 1"
    ]
