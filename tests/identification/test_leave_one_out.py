"""Leave one out: a trial is predicted by a fit that did not see it; what one trial alone tells is named."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from seatrial.base.errors import CampaignError
from seatrial.base.work import Progress
from seatrial.campaign.campaign import Campaign
from seatrial.cli import app
from seatrial.identification.leave_one_out import LeaveOneOut, leave_one_out
from tests.identification.test_identify import HEAD, HEAVE, STERN, SURGE, TRUTH, VERTICAL, record

TRIALS = "\n".join(f'[trials.{name}]\nfile = "{name}.parquet"' for name in ("run", "again", "dive"))
TWICE = SURGE.replace('["run"]', '["run", "again"]')


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    recordings = {name: record(STERN, 0, 0.01, k) for k, name in enumerate(("run", "again"), 1)}
    recordings["dive"] = record(VERTICAL, 2, 0.005, 4)
    return Campaign.from_toml(HEAD + TRIALS + TWICE + HEAVE, source="made.toml", trials=recordings)


@pytest.fixture(scope="module")
def left_out(campaign: Campaign, tmp_path_factory: pytest.TempPathFactory) -> tuple[LeaveOneOut, Path]:
    folder = tmp_path_factory.mktemp("left out") / "run"
    calls = 0

    def interrupt(progress: Progress) -> None:
        nonlocal calls
        calls += "without again" in progress.what
        if calls > 2:
            raise KeyboardInterrupt

    first = leave_one_out(campaign.problem(), run_dir=folder, progress=interrupt, threads=1)
    assert first.interrupted
    assert [one.trial for one in first.left_out] == ["run"]
    said: list[str] = []
    sigma = {"X_uu": 0.01, "X_udot": 1.0}
    found = leave_one_out(
        campaign.problem(), sigma=sigma, run_dir=folder, progress=lambda p: said.append(p.what), threads=1
    )
    # Finished trials are not searched again.
    assert said
    assert all("without run" not in what for what in said)
    return found, folder


def test_a_trial_left_out_is_predicted_by_the_others(left_out: tuple[LeaveOneOut, Path]) -> None:
    found, _ = left_out
    assert [one.trial for one in found.left_out] == ["run", "again", "dive"]
    for name in ("run", "again"):
        assert set(found.r2[name]) == {"u"}  # judged on the axes that are freed on it
        assert found.r2[name]["u"] > 0.99
    one = found.left_out[0]
    assert one.coefficients["X_uu"] == pytest.approx(TRUTH["X_uu"], rel=0.03)
    rival = one.best_baseline("u")
    assert rival is not None
    assert rival[1] < found.r2["run"]["u"]


def test_scatter_over_the_fits_is_the_jackknife(left_out: tuple[LeaveOneOut, Path]) -> None:
    found, _ = left_out
    rows = {row["coefficient"]: row for row in found.coefficients()}
    values = np.array([one.coefficients["X_uu"] for one in found.left_out])
    k = len(values)
    expected = math.sqrt((k - 1) / k * np.sum((values - values.mean()) ** 2))
    assert rows["X_uu"]["jackknife"] == pytest.approx(expected)
    assert rows["X_uu"]["ratio"] == pytest.approx(expected / 0.01)
    assert f"X_uu scatters from trial to trial by {expected / 0.01:.2g} times" in found.summary()
    assert "what all fits share" in replace(found, sigma={"X_uu": 1e3}).summary()


def test_what_one_trial_alone_tells_is_named(left_out: tuple[LeaveOneOut, Path]) -> None:
    found, _ = left_out
    dive = found.left_out[-1]
    assert dive.lost == ("heave",)
    assert "Z_ww" not in dive.coefficients  # its start value is no estimate
    row = next(row for row in found.coefficients() if row["coefficient"] == "Z_ww")
    assert row["only_from"] == "dive"
    assert math.isnan(row["jackknife"])
    assert "only in dive" in found.summary()
    assert "Without dive there is no trial for stage heave" in found.summary()


def test_run_directory_holds_what_is_printed(left_out: tuple[LeaveOneOut, Path]) -> None:
    found, folder = left_out
    kept = json.loads((folder / "leave_one_out.json").read_text())
    assert [one["trial"] for one in kept["left_out"]] == list(found.r2)
    assert (folder / "summary.txt").read_text() == found.summary() + "\n"
    assert json.loads((folder / "run.json").read_text())["kind"] == "leave one out"


def test_a_joint_estimate_takes_what_a_stage_without_trials_frees(campaign: Campaign) -> None:
    text = (
        HEAD
        + TRIALS
        + TWICE
        + HEAVE
        + '[polish]\nfixed = ["Z_wdot"]\nnuisances = { bias_u = { trials = ["dive"] } }\n'
    )
    whole = Campaign.from_toml(text, source="made.toml", trials=dict(campaign.trials))
    rest, lost = whole.problem().without_trial("dive")
    assert lost == ("heave",)
    assert "dive" not in rest.trials
    joint = rest.joint
    assert joint is not None
    assert set(joint.coefficients) == {"Z_ww"}
    assert (joint.fixed, joint.nuisances) == ((), {})
    assert joint.axes is not None
    assert joint.axes.free == "XZ"
    same, none = whole.problem().without_trial("again")
    assert none == ()
    assert same.stages[0].trials == ("run",)


def test_one_trial_is_refused_before_a_folder_appears(campaign: Campaign, tmp_path: Path) -> None:
    single = Campaign.from_toml(HEAD + TRIALS + SURGE, source="made.toml", trials=dict(campaign.trials))
    with pytest.raises(CampaignError, match="expected two trials or more in the stages, found 1"):
        leave_one_out(single.problem(), run_dir=tmp_path / "run")
    assert not (tmp_path / "run").exists()
    with pytest.raises(CampaignError, match="there is no trial 'dve'"):
        single.problem().without_trial("dve")


@pytest.mark.long
def test_option_of_the_command_line(
    campaign: Campaign, left_out: tuple[LeaveOneOut, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The verb hands the fit's deviations on, shows the result and ends with 130 where it was interrupted."""
    asked: dict[str, Any] = {}

    def found(_campaign: Campaign, **options: Any) -> LeaveOneOut:
        asked.update(options)
        return replace(left_out[0], interrupted=bool(asked.get("again")))

    monkeypatch.setattr("seatrial.identification.leave_one_out.leave_one_out", found)
    monkeypatch.chdir(tmp_path)
    Path("made.toml").write_text(HEAD + TRIALS + SURGE)
    for name, trial in campaign.trials.items():
        trial.save(f"{name}.parquet")
    arguments = ["identify", "made.toml", "--out", "run", "--figures", "none", "--leave-one-out"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert asked["run_dir"] == Path("run-leave-one-out")
    assert set(asked["sigma"]) == {"X_udot", "X_uu"}
    assert "made, leave one out: judged." in result.stdout
    asked["again"] = True
    result = CliRunner().invoke(app, [*arguments, "--json"])
    assert result.exit_code == 130
    assert json.loads(result.stdout)["leave_one_out"]["interrupted"]
