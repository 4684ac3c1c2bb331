"""Logs of a campaign: what is judged, what stands for a valid model, what the command leaves behind."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import seatrial as st
from seatrial.cli import app
from seatrial.errors import TrialError
from seatrial.fitted import Fitted
from seatrial.recorded.campaign_log import campaign_log, campaign_reference
from seatrial.recorded.log_verdict import JudgedRequirement, LogVerdict
from tests.recorded_logs import MISSION, flight

CAMPAIGN = """
format = 1
name = "box"
vehicle = "cwolf"
[trials]
box = { file = "box.parquet", hold_out_s = [[120.0, 1000.0]] }
short = { file = "short.parquet" }
[[stages]]
name = "surge"
trials = ["box"]
axes = { free = "X", measured = "YZKMN" }
[stages.coefficients]
X_uu = "default"
[verification]
missions = ["mission.toml"]
[[verification.requirements]]
name = "keeps its path"
holds = "cross_track_p95_m <= 100 and clearance_m > 2"
"""


@cache
def measured(seed: int) -> bytes:
    """Parquet of what a flight's sensors told, under the canonical names."""
    import io

    table = flight(seed).table()
    told = {c: c.removeprefix("measured.") for c in table.columns if c.startswith("measured.")}
    told.pop("measured.altitude_m", None)
    table = table.drop([name for name in told.values() if name in table.columns]).rename(told)
    stream = io.BytesIO()
    table.write_parquet(stream)
    return stream.getvalue()


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with a campaign, its trials and the log of a mission."""
    monkeypatch.chdir(tmp_path)
    Path("campaign.toml").write_text(CAMPAIGN)
    Path("mission.toml").write_text(MISSION.to_toml())
    Path("box.parquet").write_bytes(measured(100))
    Path("short.parquet").write_bytes(measured(101))
    flight(2).write(tmp_path / "today", figures=False)
    return tmp_path


def call(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["verify", "campaign.toml", "--no-figures", *map(str, arguments)])


@pytest.mark.usefixtures("here")
def test_of_a_trial_the_held_out_part_is_judged_by_the_rest_of_it() -> None:
    campaign = st.Campaign.load("campaign.toml")
    judged = campaign_log(campaign, "box")
    assert judged.span is not None
    assert judged.span[0] == pytest.approx(120.0)
    spread = campaign_reference(campaign, Fitted.of("cwolf"), judged, ahead_s=10.0)
    assert "box (12 windows)" in spread.source
    assert campaign_log(campaign, "short").span is None
    # Nothing of a trial that is judged as a whole stands for a valid model.
    other = campaign_reference(campaign, Fitted.of("cwolf"), campaign_log(campaign, "short"), ahead_s=10.0)
    assert "on box (" in other.source


@pytest.mark.usefixtures("here")
def test_a_foreign_log_is_judged_by_all_trials_or_by_those_named() -> None:
    campaign = st.Campaign.load("campaign.toml")
    judged = campaign_log(campaign, "today")
    assert judged.mission == Path("today/mission.toml")
    fit = Fitted.of("cwolf")
    assert "on box, short (" in campaign_reference(campaign, fit, judged, ahead_s=10.0).source
    named = campaign_reference(campaign, fit, judged, ahead_s=10.0, names=["short"])
    assert "on short (" in named.source
    with pytest.raises(TrialError, match='none; did you mean "box"'):
        campaign_log(campaign, "bux")


@pytest.mark.usefixtures("here")
def test_a_valid_log_is_exit_code_0_and_leaves_a_run_directory() -> None:
    result = call("--log", "today")
    assert result.exit_code == 0, result.output
    run = Path("runs/box-log-today")
    data = json.loads((run / "verdict.json").read_text())
    assert data["verdict"] == "held"
    assert data["outcome"] == "model still valid"
    # The box mission has no farm.
    assert data["figures"]["clearance_m"] is None or not np.isfinite(data["figures"]["clearance_m"])
    assert data["envelope"]["flights"] == 64
    names = {path.name for path in run.iterdir()}
    assert names >= {"run.json", "campaign.toml", "vehicle.toml", "autopilot.toml", "mission.toml"}
    assert "log" in json.loads((run / "run.json").read_text())["sha256"]
    assert (run / "summary.txt").read_text().startswith("today: model still valid")
    assert "VERDICT: held" in result.stdout


@pytest.mark.usefixtures("here")
def test_a_changed_vehicle_is_exit_code_1() -> None:
    flight(2, (("SbU.gain", 0.8),)).write("today", figures=False)
    result = call("--log", "today", "--json", "--reference", "box")
    assert result.exit_code == 1, result.output
    data = json.loads(result.stdout)
    assert data["verdict"] == "failed"
    assert data["suspects"][0]["name"] == "SbU.gain"


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--log", "away"], "expected a recording, a run directory of `seatrial fly` or a trial"),
        (["--log", "today", "--runs", 8], "--runs: --log judges a recorded mission"),
        (["--log", "today", "--mission", "mission.toml", "--mission", "x.toml"], "a log is one mission"),
        (["--log", "today", "--reference", "away"], "away: expected a recording"),
        (["--reference", "box"], "give that with --log"),
        (["--log", "."], "expected flight.parquet"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(arguments: list[object], words: str) -> None:
    result = call(*arguments)
    assert result.exit_code == 2, result.output
    assert words in result.stderr
    assert not Path("runs").exists()


@pytest.mark.parametrize(
    ("outcome", "missing", "verdict"),
    [
        ("model still valid", (), "held"),
        ("model still valid", ("missed_by_m",), "undecided"),
        ("model still valid", ("true_cross_track_p95_m",), "held"),
        ("log too short or too quiet to tell", (), "undecided"),
        ("re-identify", (), "failed"),
    ],
)
def test_what_the_log_cannot_tell_is_undecided(outcome: str, missing: tuple[str, ...], verdict: str) -> None:
    judged = LogVerdict.__new__(LogVerdict)
    asked = JudgedRequirement("a", "...", None if missing else True, 1.0, "m", missing)
    for name, value in {"outcome": outcome, "requirements": (asked,), "steps": ()}.items():
        object.__setattr__(judged, name, value)
    assert judged.verdict == verdict
    assert judged.passed == (verdict == "held")
