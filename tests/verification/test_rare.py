"""Rare failures of missions: against plain sampling, what is refused, and how a run is taken up again."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seatrial as st
from seatrial.base.errors import CampaignError
from seatrial.base.work import Work
from seatrial.identification.fitted import Fitted
from seatrial.verification.boundary import FailureBoundary
from seatrial.verification.chosen_missions import MissionSpace
from seatrial.verification.falsify import Falsification
from seatrial.verification.judgement import completion, robustness
from seatrial.verification.rare import Rare, RareFailures
from seatrial.verification.scenario import Scenario

OUT = """
format = 1
name = "out"
speed_m_s = 1.5
acceptance_radius_m = 3.0
[[legs]]
north_m = 30.0
east_m = 0.0
depth_m = 3.0
[[legs]]
north_m = 45.0
east_m = 15.0
depth_m = 4.0
"""


def prepared(*holds: str, probability: float = 0.999, **settings: Any) -> Scenario:
    """A short mission of CWolf in a current, with uncertain drag and thrust."""
    requirements = [st.Requirement(f"number {k}", one, probability) for k, one in enumerate(holds)]
    fitted = Fitted.of("cwolf", percent={"X_uu": 10.0, "N_rr": 15.0, "stern.gain": 5.0})
    missions = [st.Mission.from_toml(OUT)]
    water = {"current": {"speed_m_s": {"normal": [0.2, 0.08]}}}
    conditions = {"start": {"heading_deg": [-20.0, 20.0]}}
    for home, keys in ((water, ("current", "waves")), (conditions, ("faults", "outages", "sensors"))):
        home |= {key: settings.pop(key) for key in keys if key in settings}
    return Scenario(
        fitted,
        "cwolf",
        missions,
        requirements=requirements,
        water=water,
        conditions=conditions,
        seed=3,
        **settings,
    )


LIMIT_M = 7.0
HOLDS = f"true_cross_track_largest_m <= {LIMIT_M}"


@cache
def rare() -> RareFailures:
    return Rare(checked=300).survey(prepared(HOLDS, "not abort"))


@pytest.mark.long
def test_the_interval_holds_what_plain_sampling_finds() -> None:
    one = rare().requirements[0]
    assert one.event is not None
    flown = prepared(HOLDS).flights.fly(np.arange(8_000))
    failures = int((flown.metrics["true_cross_track_largest_m"] > LIMIT_M).sum())
    low, high = one.event.interval
    # Failures are counted, too: their own interval is about two roots wide.
    assert 4 <= failures <= 200
    assert low <= (failures + 2.0 * np.sqrt(failures)) / 8_000
    assert high >= (failures - 2.0 * np.sqrt(failures)) / 8_000
    assert one.event.evaluations < 8_000


@pytest.mark.long
def test_the_likeliest_failure_is_one_and_can_be_flown_again() -> None:
    found = rare()
    one = found.requirements[0]
    space = MissionSpace(found.scenario.flights)
    value = space.robustness(one.requirement, np.array([one.sample]), np.array([one.seed]))
    assert value[0] <= 0.0
    flight = found.replay("number 0")
    assert flight.metrics["true_cross_track_largest_m"] == pytest.approx(LIMIT_M - value[0], rel=1e-9)
    # The flight has the gusts, too.
    speed = float(np.hypot(*flight.current[:, :2].mean(axis=0)))
    assert one.likeliest["current speed, m/s"] == pytest.approx(speed, rel=0.3)
    with pytest.raises(CampaignError, match='unknown "number"'):
        found.replay("number")


@pytest.mark.long
def test_what_has_no_distance_is_refused_with_the_reason() -> None:
    found = rare()
    one = found.requirements[1]
    assert one.event is None
    assert one.why_not is not None
    assert one.why_not.kind == "no distance"
    assert "no usable robustness" in found.report().text()
    assert one.verdict == "not judged"
    assert found.outcome in ("failed", "not judged")
    assert "number 1" in found.report().text()


@pytest.mark.long
def test_the_report_says_probability_interval_and_what_plain_sampling_would_take() -> None:
    found = rare()
    event = found.requirements[0].event
    assert event is not None
    text = found.summary()
    assert f"{event.estimate:.2g}" in text
    assert "Failures of: number 0" in text
    # Guidance believes an offset position.
    assert any("offset of the measured" in name for name in list(found.requirements[0].common)[:3])
    plain = json.loads(json.dumps(found.to_dict()))["requirements"][0]["event"]
    assert plain["estimate"] == event.estimate
    assert plain["check"]["evaluations"] <= 300


def test_missions_of_normal_numbers_are_distributed_as_those_that_are_drawn() -> None:
    flights = prepared(HOLDS).flights
    space = MissionSpace(flights)
    generator = np.random.default_rng(5)
    drawn = space.draws(generator.standard_normal((4000, space.dimensions)), generator.random(4000))
    plain = flights.draws(4000)
    for name in ("current speed, m/s", "start heading off to starboard, deg", "coefficient X_uu, sigmas"):
        edges = np.quantile(plain.causes[name], [0.1, 0.5, 0.9])
        assert np.quantile(drawn.causes[name], [0.1, 0.5, 0.9]) == pytest.approx(
            edges, abs=0.15 * np.ptp(edges)
        )


def test_faults_and_outages_are_coordinates_too() -> None:
    faults = [{"actuator": "any", "probability": 0.01}]
    outages = [{"sensor": "velocity", "probability": 0.02, "duration_s": [1.0, 5.0]}]
    space = MissionSpace(prepared(HOLDS, faults=faults, outages=outages).flights)
    x = np.zeros((2, space.dimensions))
    common, of_faults, *_ = space.widths
    x[1, common] = -3.0
    x[1, common + of_faults] = -3.0
    drawn = space.draws(x, np.array([0.3, 0.3]))
    assert [row[0] for row in drawn.faults] == [1]
    assert [row[0] for row in drawn.outages] == [1]
    assert drawn.seeds[0] == drawn.seeds[1]


def test_completion_has_a_grade() -> None:
    flights = prepared('ending == "complete"').flights
    flown = flights.fly(np.arange(16))
    grade = completion(flown, flights)
    assert ((grade > 0.0) == (flown.metrics["ending"] == "complete")).all()
    values = robustness(st.Requirement("ends", 'ending == "complete"'), flown, flights)
    assert values == pytest.approx(grade)
    slow = robustness(st.Requirement("ends", 'ending == "complete" and duration_s <= 300'), flown, flights)
    assert np.isfinite(slow).all()


def test_finished_populations_are_taken_up_again(tmp_path: Path) -> None:
    asked, search = prepared(HOLDS), Rare(population=100, populations=2, checked=0)
    first = search.survey(asked, Work(run_dir=tmp_path / "run"))
    kept = sorted(path.name for path in (tmp_path / "run").rglob("*population*"))
    assert len(kept) == 2
    again = search.survey(asked, Work(run_dir=tmp_path / "run"))
    assert again.to_dict() == first.to_dict()
    assert json.loads((tmp_path / "run" / "rare.json").read_text()) == first.to_dict()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"population": 105}, "multiple of ten"),
        ({"population": 50}, "from 100 on"),
        ({"populations": 1}, "at least 2"),
        ({"requirements": ["nunber 0"]}, 'unknown "nunber 0"'),
    ],
)
def test_bad_arguments_are_refused(arguments: dict[str, object], words: str) -> None:
    with pytest.raises(CampaignError, match=words):
        Rare(**arguments).survey(prepared(HOLDS))  # type: ignore[arg-type]


def test_an_autopilot_of_another_vehicle_is_said_first() -> None:
    """By what is searched as by what is verified."""
    asked = prepared(HOLDS)
    other = asked.with_flights(asked.flights.with_autopilot(st.Autopilot.load("remus100")))
    for one, doubted in ((asked, False), (other, True)):
        for found in (
            RareFailures(one, (), False),
            Falsification(one, (), 2.0, False),
            FailureBoundary(one, {"current_speed_m_s": (0.0, 1.0)}, (), np.zeros((0, 1)), 1, False),
        ):
            _, worst, next_step = found.report().lines()
            assert worst.startswith("Worst: The autopilot was made for remus100, and ") is doubted
            assert ("seatrial autopilot VEHICLE" in next_step) is doubted
            assert len(found.to_dict()["warnings"]) == doubted
