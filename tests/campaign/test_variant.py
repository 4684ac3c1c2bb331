"""Variants of a campaign: locked axes frozen or replayed, what frozen ones miss, the option of the verb."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from seatrial._core import Vehicle
from seatrial.base.errors import CampaignError
from seatrial.base.work import Work
from seatrial.campaign.campaign import Campaign
from seatrial.cli import app
from seatrial.estimation.stage import plan
from seatrial.identification.preparation import frozen_motion, frozen_sentences
from seatrial.problem.settings import Coefficient
from tests.identification.test_identify import HEAD

TEXT = (
    HEAD
    + """
# This comment stays.
[trials.turn]
file = "turn.parquet"
[[stages]]
name = "yaw"
trials = ["turn"]
axes = { free = "N", measured = "XYZKM" }  # and this one
segment_s = 20.0
[stages.coefficients]
N_rr = [-400.0, -50.0]
N_rdot = "default"
[[stages]]
name = "surge"
after = ["yaw"]
trials = ["turn"]
axes = { free = "X", measured = "YN", frozen = "Z" }
[stages.coefficients]
X_uu = [-30.0, -4.0]
"""
)


@pytest.fixture(scope="module")
def turn() -> pl.DataFrame:
    """Turns while the vehicle gains and loses speed: freezing surge misses that."""
    vehicle = Vehicle.load("cwolf").with_coefficients({"N_rr": -150.0, "X_uu": -12.0})
    t = np.arange(0.0, 120.0, 0.1)
    speed = 700.0 + 600.0 * np.sign(np.sin(2.0 * np.pi * t / 60.0))
    turning = 250.0 * np.sign(np.sin(2.0 * np.pi * t / 34.0))
    signs = {"SbU": -1.0, "SbL": -1.0, "PU": 1.0, "PL": 1.0}
    commands = {n: speed + signs[n] * turning if n in signs else np.zeros(len(t)) for n in vehicle.actuators}
    run = vehicle.simulate(t, commands, max_step_s=0.02)
    nu = np.asarray(run.nu) + np.random.default_rng(3).normal(0.0, 1e-3, (len(t), 6))
    frame = {"t_s": t}
    frame |= {f"{c}_m_s": nu[:, i] for i, c in enumerate("uvw")}
    frame |= {f"{c}_deg_s": np.rad2deg(nu[:, 3 + i]) for i, c in enumerate("pqr")}
    frame |= {
        f"{a}_deg": np.rad2deg(np.asarray(run.euler)[:, i]) for i, a in enumerate(("roll", "pitch", "yaw"))
    }
    return pl.DataFrame(frame | {f"cmd.{n}": c for n, c in commands.items()})


@pytest.fixture
def campaign(turn: pl.DataFrame) -> Campaign:
    return Campaign.from_toml(TEXT, source="made.toml", trials={"turn": turn})


def test_every_locked_axis_gets_the_mode_and_comments_stay(campaign: Campaign) -> None:
    frozen, measured = (campaign.with_locked_axes(mode) for mode in ("frozen", "measured"))
    assert [(s.axes.free, s.axes.measured, s.axes.frozen) for s in frozen.problem().stages] == [
        ("N", "", "XYZKM"),
        ("X", "", "YZKMN"),
    ]
    assert [(s.axes.free, s.axes.measured, s.axes.frozen) for s in measured.problem().stages] == [
        ("N", "XYZKM", ""),
        ("X", "YZKMN", ""),
    ]
    assert "# This comment stays." in frozen.text
    assert tomllib.loads(frozen.text)["stages"][0]["axes"] == {"free": "N", "frozen": "XYZKM"}
    # Nothing else changes, and the recording is not read again.
    plain, changed = tomllib.loads(campaign.text), tomllib.loads(frozen.text)
    for one in (*plain["stages"], *changed["stages"]):
        del one["axes"]
    assert plain == changed
    assert campaign.trials["turn"] is frozen.trials["turn"]
    assert campaign.problem().stages[0].axes.measured == "XYZKM"  # the campaign itself is as it was


def test_text_of_a_variant_is_a_campaign(campaign: Campaign, turn: pl.DataFrame) -> None:
    frozen = campaign.with_locked_axes("frozen")
    again = Campaign.from_toml(frozen.text, source="again.toml", trials={"turn": turn})
    assert again.file == frozen.file


@pytest.mark.parametrize("mode", ["frozen", "measured"])
def test_polish_stays_as_it_is(turn: pl.DataFrame, mode: str) -> None:
    from seatrial.estimation.joint import Joint

    text = TEXT + "[polish]\nrounds = 3\n"
    before = Campaign.from_toml(text, source="made.toml", trials={"turn": turn})
    after = before.with_locked_axes(mode)  # type: ignore[arg-type]
    own, other = Joint(before.problem()).stage.axes, Joint(after.problem()).stage.axes
    assert (own.free, own.measured) == (other.free, other.measured) == ("XN", "YZKM")


def test_unknown_mode_is_refused(campaign: Campaign) -> None:
    with pytest.raises(CampaignError, match="expected 'frozen' or 'measured', found 'frozn'; did you mean"):
        campaign.with_locked_axes("frozn")  # type: ignore[arg-type]


@pytest.mark.long
def test_variants_do_not_share_kept_stages(campaign: Campaign, tmp_path: Path) -> None:
    campaign.identify(work=Work(run_dir=tmp_path / "run", threads=1))
    other = campaign.with_locked_axes("frozen").identify(work=Work(run_dir=tmp_path / "run", threads=1))
    assert [stage.reused for stage in other.stages] == [False, False]
    again = campaign.with_locked_axes("frozen").identify(work=Work(run_dir=tmp_path / "run", threads=1))
    assert [stage.reused for stage in again.stages] == [True, True]


def test_frozen_axis_that_moves_is_named(campaign: Campaign) -> None:
    plans = plan(campaign.with_locked_axes("frozen").problem())
    moved = frozen_motion(plans[0])
    trial, segments = plans[0].data.trials[0], plans[0].data.segments
    away = np.concatenate([trial.nu[s.start : s.stop, 0] - s.nu[0] for s in segments])
    # The motion is that of the smoothed record, the sum here that of the noisy one: 1 mm/s of noise.
    assert moved["X"] == pytest.approx(np.sqrt(np.mean(away**2)), abs=2e-3)
    assert moved["X"] > 0.2
    sentences = list(frozen_sentences(plans))
    assert "stage 'yaw' freezes axes that move within its segments: X (u changes by" in sentences[0]
    assert "N (the attitude is turned by" in sentences[1]
    assert not list(frozen_sentences(plan(campaign.with_locked_axes("measured").problem())))


@pytest.mark.long
def test_replayed_axes_fit_better_than_frozen_ones_that_move(campaign: Campaign) -> None:
    frozen, measured = (
        campaign.with_locked_axes(mode).identify(work=Work(threads=1)).stages[0]
        for mode in ("frozen", "measured")
    )
    assert measured.cost < 0.5 * frozen.cost
    # The truth is -150; noise of 0.06 deg/s leaves a few per cent.
    assert measured.coefficients["N_rr"] == pytest.approx(-150.0, rel=0.05)
    assert abs(frozen.coefficients["N_rr"] + 150.0) > abs(measured.coefficients["N_rr"] + 150.0)


def test_option_of_the_command_line(
    tmp_path: Path, turn: pl.DataFrame, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    turn.write_parquet(tmp_path / "turn.parquet")
    (tmp_path / "campaign.toml").write_text(TEXT)
    arguments = ["identify", "campaign.toml", "--figures", "none", "--threads", "1", "--json"]
    result = CliRunner().invoke(app, [*arguments, "--locked-axes", "frozen"])
    assert result.exit_code == 0, result.output
    data = json.loads(result.stdout)
    assert data["run_directory"] == "runs/made-frozen"
    assert any("freezes axes that move" in text for text in data["before"])
    folder = tmp_path / "runs" / "made-frozen"
    assert 'frozen = "XYZKM"' in (folder / "campaign.toml").read_text()
    stages = Vehicle.load(str(folder / "vehicle_stages.toml")).coefficients()
    assert stages["N_rr"] == data["stages"][0]["coefficients"]["N_rr"]
    refused = CliRunner().invoke(app, [*arguments, "--locked-axes", "thawed"])
    assert refused.exit_code == 2
    assert "--locked-axes 'thawed': expected frozen or measured" in refused.stderr
    assert not (tmp_path / "runs" / "made-thawed").exists()


def test_strips_take_the_place_of_the_damping_that_they_make(campaign: Campaign) -> None:
    stage = campaign.problem().stages[0]
    both = stage.model_copy(
        update={"coefficients": {"Y_v": Coefficient(), "Y_vv": Coefficient(), "N_rr": Coefficient()}}
    )
    other = campaign.with_file(campaign.file.model_copy(update={"stages": (both,)}))
    changed = other.problem().with_strips("C_Dy", (0.0, 2.0), 0.8)
    assert [*changed.stages[0].coefficients] == ["Y_v", "C_Dy"]
    (drag,) = (one for one in changed.parameters[stage.name] if one.name == "C_Dy")
    assert (drag.lower, drag.start, drag.upper) == (0.0, 0.8, 2.0)
