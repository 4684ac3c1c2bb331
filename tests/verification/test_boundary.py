"""The failure boundary of missions: which side is safe, what is refused, how a run is taken up again."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from seatrial.base.errors import CampaignError
from seatrial.base.work import Work
from seatrial.cli import app
from seatrial.verification.boundary import Boundary, FailureBoundary
from seatrial.verification.scenario import Scenario
from tests.cli.test_cli_rare import CAMPAIGN
from tests.verification.test_rare import OUT, prepared

HOLDS = "true_cross_track_largest_m <= 4.5"


def asked(runs: int = 600) -> Scenario:
    return prepared(HOLDS, "duration_s <= 1000", probability=0.9, runs=runs)


@cache
def along_the_current() -> FailureBoundary:
    return Boundary({"current_speed_m_s": (0.0, 1.2)}).survey(asked())


@pytest.mark.long
def test_the_boundary_lies_where_plain_sampling_finds_the_allowed_failures() -> None:
    found = along_the_current()
    ((value, low, high, rising),) = found.crossings("number 0")
    assert rising
    assert low <= value <= high
    for speed, fails_more in ((max(low - 0.05, 0.0), False), (high + 0.1, True)):
        water = prepared(HOLDS, probability=0.9, current={"speed_m_s": speed})
        flown = water.flights.fly(np.arange(400))
        share = float((flown.metrics["true_cross_track_largest_m"] > 4.5).mean())
        assert (share > 0.1) is fails_more, (speed, share)


def test_a_requirement_without_a_boundary_says_on_which_side_it_is() -> None:
    found = along_the_current()
    assert found.requirement("number 1").side in ("safe", "probably safe")
    assert not found.crossings("number 1")
    text = found.summary()
    assert "number 0" in text
    assert "holds up to current_speed_m_s" in text.replace("Holds", "holds")
    plain = json.loads(json.dumps(found.to_dict()))
    assert plain["missions"] == len(found.places) * found.runs_per_place
    with pytest.raises(CampaignError, match='unknown "number"'):
        found.requirement("number")


def test_two_variables_and_finished_places_are_taken_up_again(tmp_path: Path) -> None:
    ranges = {"X_uu": (-40.0, -8.0), "payload_kg": (-5.0, 10.0)}
    first = Boundary(ranges).survey(asked(400), Work(run_dir=tmp_path / "run"))
    again = Boundary(ranges).survey(asked(400), Work(run_dir=tmp_path / "run"))
    assert again.to_dict() == first.to_dict()
    assert first.places.min(axis=0) == pytest.approx([-40.0, -5.0])
    assert (tmp_path / "run" / "boundary.json").is_file()


@pytest.mark.parametrize(
    ("variables", "words"),
    [
        ({"current_sped_m_s": (0.0, 1.0)}, "current_speed_m_s"),
        ({"current_speed_m_s": (1.0, 0.0)}, "FROM below TO"),
        ({"payload_kg": (-500.0, 1.0)}, "mass of"),
        ({}, "one or two variables"),
        ({"X_uu": (-9.0, -8.0), "*_uu": (-9.0, -8.0)}, "set the same coefficient"),
    ],
)
def test_what_cannot_be_varied_is_refused(variables: dict[str, tuple[float, float]], words: str) -> None:
    with pytest.raises(CampaignError, match=words):
        Boundary(variables).survey(asked())


def test_the_verb_draws_and_refuses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out.toml").write_text(OUT)
    (tmp_path / "short.toml").write_text(CAMPAIGN)
    arguments = ["boundary", "short.toml", "sensor_latency_s=0:3", "--runs", "200"]
    arguments += ["--report", "short.html"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert list((tmp_path / "runs" / "short-boundary" / "figures").glob("boundary*.png"))
    assert (tmp_path / "short.html").is_file()
    for wrong, words in (("sensor_latency_s", "FROM:TO"), ("sensor_latency_s=a:b", "FROM:TO")):
        result = CliRunner().invoke(app, ["boundary", "short.toml", wrong])
        assert result.exit_code == 2
        assert words in result.output
