"""Logs of a campaign: what is judged, what stands for a valid model, what the command leaves behind."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner, Result

import seatrial as st
from seatrial.base.errors import CampaignError, SeatrialError, TrialError
from seatrial.campaign.verification import campaign_log, campaign_reference, verify_campaign_log
from seatrial.cli import app
from seatrial.identification.fitted import Fitted
from seatrial.verification.mission_log.judge_log import verify_log
from seatrial.verification.mission_log.verdict import JudgedRequirement, LogVerdict
from tests.verification.recorded_logs import MISSION, flight

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
    flight(2).save(tmp_path / "today")
    return tmp_path


def call(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["verify-log", "campaign.toml", *map(str, arguments), "--figures", "none"])


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
    result = call("today")
    assert result.exit_code == 0, result.output
    run = Path("runs/box-log-today")
    data = json.loads((run / "verdict.json").read_text())
    assert data["outcome"] == "held"
    assert data["model"] == "model still valid"
    # The box mission has no farm.
    assert data["metrics"]["clearance_m"] is None or not np.isfinite(data["metrics"]["clearance_m"])
    assert data["envelope"]["flights"] == 64
    names = {path.name for path in run.iterdir()}
    assert names >= {"run.json", "campaign.toml", "vehicle.toml", "autopilot.toml", "mission.toml"}
    assert "log" in json.loads((run / "run.json").read_text())["sha256"]
    assert (run / "summary.txt").read_text().startswith("today: model still valid")
    assert result.stdout.startswith("today: model still valid (verdict: held). ")


@pytest.mark.usefixtures("here")
def test_a_changed_vehicle_is_exit_code_1() -> None:
    flight(2, (("SbU.gain", 0.8),)).save("today")
    result = call("today", "--json", "--reference", "box")
    assert result.exit_code == 1, result.output
    data = json.loads(result.stdout)
    assert data["outcome"] == "failed"
    assert data["suspects"][0]["name"] == "SbU.gain"


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["away"], "expected a recording, a run directory of `seatrial fly` or a trial"),
        (["today", "--reference", "away"], "away: expected a recording"),
        (["."], "expected flight.parquet"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(arguments: list[object], words: str) -> None:
    result = call(*arguments)
    assert result.exit_code == 2, result.output
    assert words in result.stderr
    assert not Path("runs").exists()


def change(table: pl.DataFrame, kind: str) -> pl.DataFrame:
    """A log with one thing wrong."""
    commands = [name for name in table.columns if name.startswith("cmd.")]
    if kind == "milliseconds":
        return table.with_columns(pl.col("t_s") * 1000.0)
    if kind == "no number":
        return table.with_columns(u_m_s=pl.lit(float("nan")))
    if kind == "commands alone":
        return table.select("t_s", *commands)
    if kind == "no commands":
        return table.drop(commands)
    return table.rename({name: name.replace("cmd.", "cmd.other_") for name in commands})


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("milliseconds", "put the unit into the column's name"),
        ("no number", "wrong: u: expected samples that are numbers"),
        ("commands alone", "no motion was recorded"),
        ("no commands", "no trial of campaign.toml has that input"),
        ("another vehicle", "commands of other_SbU"),
    ],
)
def test_a_log_that_cannot_be_judged_says_what_is_wrong(kind: str, words: str) -> None:
    change(pl.read_parquet("box.parquet"), kind).write_parquet("wrong.parquet")
    with pytest.raises(SeatrialError, match=re.escape(words)):
        verify_campaign_log(st.Campaign.load("campaign.toml"), "cwolf", "wrong.parquet")


@pytest.mark.usefixtures("here")
def test_without_trials_a_reference_is_asked_for() -> None:
    Path("box.parquet").unlink()
    campaign, fit = st.Campaign.load("campaign.toml"), Fitted.of("cwolf")
    judged = campaign_log(campaign, "today")
    with pytest.raises(CampaignError, match=r"no file box\.parquet, and .* or give --reference LOG"):
        campaign_reference(campaign, fit, judged, ahead_s=10.0)
    # The log itself tells nothing of what a valid model leaves.
    with pytest.raises(TrialError, match="found the one that is judged"):
        campaign_reference(campaign, fit, judged, ahead_s=10.0, names=["today"])
    other = flight(3).save("yesterday")
    assert "on yesterday (" in campaign_reference(campaign, fit, judged, ahead_s=10.0, names=[other]).source


@pytest.mark.usefixtures("here")
def test_a_fit_of_another_vehicle_is_refused() -> None:
    with pytest.raises(CampaignError, match="expected a fit of cwolf, found one of remus100"):
        verify_campaign_log(st.Campaign.load("campaign.toml"), "remus100", "today")


@pytest.mark.usefixtures("here")
@pytest.mark.long
def test_the_public_function_takes_a_campaign_as_the_verb_does() -> None:
    campaign = st.Campaign.load("campaign.toml")
    found = campaign.judge_log("cwolf", "today", settings=st.LogSettings(draws=1200, flights=40))
    same, _ = verify_campaign_log(campaign, "cwolf", "today", settings=st.LogSettings(draws=1200, flights=40))
    np.testing.assert_equal(found.to_dict(), same.to_dict())
    with pytest.raises(CampaignError, match=r"use campaign.judge_log\(fit, log\)"):
        st.verify_log(campaign, "today")  # type: ignore[arg-type]


@pytest.mark.usefixtures("here")
def test_the_file_of_a_trial_is_judged_as_that_trial() -> None:
    judged = campaign_log(st.Campaign.load("campaign.toml"), "box.parquet")
    assert judged.trial == "box"
    assert judged.span is not None


@pytest.mark.long
@pytest.mark.usefixtures("here")
def test_a_slow_log_is_held_against_references_as_slow() -> None:
    """At 1 Hz held commands and smoothed states err more; the model is no worse for it."""
    table = pl.read_parquet("box.parquet").gather_every(10)
    campaign, fit = st.Campaign.load("campaign.toml"), Fitted.of("cwolf")
    table.write_parquet("slow.parquet")
    judged = campaign_log(campaign, "slow.parquet")
    slow = campaign_reference(campaign, fit, judged, ahead_s=10.0, names=["short"])
    fast = campaign_reference(campaign, fit, campaign_log(campaign, "today"), ahead_s=10.0, names=["short"])
    assert np.isfinite(slow.sigma).all()  # no bin of the time since a restart is left empty
    assert (
        slow.sigma[:, 5].mean() > 1.5 * fast.sigma[:, 5].mean()
    )  # yaw rate: the commands change it in a second
    found = verify_log(fit, judged.log, reference=slow)
    assert found.model != "re-identify", found.summary()


@pytest.mark.parametrize(
    ("model", "missing", "verdict"),
    [
        ("model still valid", (), "held"),
        ("model still valid", ("missed_by_m",), "undecided"),
        ("model still valid", ("true_cross_track_p95_m",), "held"),
        ("log too short or too quiet to tell", (), "undecided"),
        ("not judged", (), "not judged"),
        ("re-identify", (), "failed"),
    ],
)
def test_what_the_log_cannot_tell_is_undecided(model: str, missing: tuple[str, ...], verdict: str) -> None:
    judged = LogVerdict.__new__(LogVerdict)
    asked = JudgedRequirement("a", "...", None if missing else True, 1.0, "m", missing)
    for name, value in {"model": model, "requirements": (asked,), "steps": ()}.items():
        object.__setattr__(judged, name, value)
    assert judged.outcome == verdict
    assert judged.held == (verdict == "held")
