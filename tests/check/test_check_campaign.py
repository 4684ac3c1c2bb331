"""A check of a campaign finds in seconds what an identification refuses, in the same words."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from seatrial._core import Vehicle
from seatrial.base.errors import SeatrialError
from seatrial.campaign.campaign import Campaign
from seatrial.check.campaign import check_campaign

T = np.arange(0.0, 60.0, 0.1)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    vehicle = Vehicle.load("cwolf")
    side = 400.0 * np.sign(np.sin(0.2 * T))
    commands = dict.fromkeys(("SbU", "SbL"), 500.0 + side) | dict.fromkeys(("PU", "PL"), 500.0 - side)
    commands |= dict.fromkeys(("VTB", "VTS"), 0.0 * T)
    run = vehicle.simulate(T, commands)
    noise = 0.005 * np.random.default_rng(1).standard_normal(len(T))
    log = {"t_s": T, "u_m_s": run.nu[:, 0] + noise, "r_deg_s": np.rad2deg(run.nu[:, 5])}
    log |= {f"cmd.{name}": values for name, values in commands.items()}
    pl.DataFrame(log).write_csv(tmp_path / "zigzag.csv")
    return tmp_path


def campaign(
    folder: Path, *, head: str = "", coefficients: str = "X_uu = [-40.0, -1.0]", vehicle: str = "cwolf"
) -> Campaign:
    (folder / "campaign.toml").write_text(f"""
format = 1
name = "sea"
vehicle = "{vehicle}"
{head}
[trials.zigzag]
file = "zigzag.csv"
[[stages]]
name = "surge"
trials = ["zigzag"]
axes = {{ free = "X" }}
channels = {{ u = 1.0 }}
segment_s = 10.0
coefficients = {{ {coefficients} }}
""")
    return Campaign.load(folder / "campaign.toml")


def without(folder: Path, *columns: str) -> None:
    pl.read_csv(folder / "zigzag.csv").drop(*columns).write_csv(folder / "zigzag.csv")


def refused_by_both(made: Campaign) -> str:
    """The one problem that a check finds, which is the identification's refusal."""
    problems = check_campaign(made).problems
    assert len(problems) == 1
    with pytest.raises(SeatrialError) as refusal:
        made.identify()
    assert problems[0] == str(refusal.value)
    return problems[0]


def test_a_campaign_without_faults_is_ready(folder: Path) -> None:
    found = check_campaign(campaign(folder))
    assert found.problems == ()
    assert not [text for text in found.warnings if "column" in text or "diverges" in text]


def test_a_command_beyond_its_actuator_is_the_worst(folder: Path) -> None:
    table = pl.read_csv(folder / "zigzag.csv").with_columns(pl.col("cmd.SbU") * 100.0)
    table.write_csv(folder / "zigzag.csv")
    worst = check_campaign(campaign(folder)).report().worst
    assert worst.startswith("trial zigzag: command of SbU reaches 90000, and its limit is 2000 (beyond it in")


def test_commands_that_fall_silent_are_the_worst(folder: Path) -> None:
    log = pl.read_csv(folder / "zigzag.csv")
    names = [name for name in log.columns if name.startswith("cmd.")]
    silent = [pl.when(pl.col("t_s") < 30.0).then(pl.col(name)) for name in names]
    log.with_columns(silent).write_csv(folder / "zigzag.csv")
    assert ": no command from 29.9 to " in check_campaign(campaign(folder)).report().worst


def test_a_missing_command_column_of_a_group_is_refused(folder: Path) -> None:
    without(folder, "cmd.PL")
    assert "trial 'zigzag': no column cmd.PL, but others of the group 'stern'" in refused_by_both(
        campaign(folder)
    )


def test_a_group_that_no_column_commands_is_said(folder: Path) -> None:
    without(folder, "cmd.VTB", "cmd.VTS")
    found = check_campaign(campaign(folder))
    assert found.problems == ()
    assert any("no column cmd.VTB" in text and "taken to stand still" in text for text in found.warnings)
    assert "no column cmd.VTB" in found.summary()


def test_an_axis_that_is_driven_without_a_command_is_not_identified(folder: Path) -> None:
    log = pl.read_csv(folder / "zigzag.csv").with_columns(w_m_s=0.1 * pl.col("t_s").sin())
    log.write_csv(folder / "zigzag.csv")
    campaign(folder)
    heave = """
[[stages]]
name = "heave"
trials = ["zigzag"]
axes = { free = "Z" }
channels = { w = 1.0 }
segment_s = 10.0
coefficients = { Z_ww = [-2000.0, -1.0] }
"""
    file = folder / "campaign.toml"
    file.write_text(file.read_text() + heave)
    assert not [text for text in check_campaign(Campaign.load(file)).warnings if "driven by" in text]
    without(folder, "cmd.VTB", "cmd.VTS")
    warned = "heave is driven by VTB, VTS, of which no trial records a command: Z_ww not identified"
    assert any(warned in text for text in check_campaign(Campaign.load(file)).warnings)
    fit = Campaign.load(file).identify()
    assert [one.name for one in fit.coefficients] == ["X_uu"]


@pytest.mark.parametrize("nuisance", ["bias_nothing", "bias_w"])
def test_a_nuisance_that_the_estimate_refuses(folder: Path, nuisance: str) -> None:
    made = campaign(folder, head=f"[polish]\nnuisances = {{ {nuisance} = {{}} }}")
    if nuisance == "bias_w":  # of a channel that no trial has: accepted by both or refused by both
        assert check_campaign(made).problems == ()
    else:
        assert "bias_nothing" in refused_by_both(made)


def test_a_coefficient_that_changes_nothing_is_refused_before_a_search(folder: Path) -> None:
    made = campaign(folder, coefficients="X_uu = [-40.0, -1.0], N_r = [-100.0, -1.0]")
    assert "coefficient 'N_r' changes nothing in this stage" in refused_by_both(made)


def test_a_trial_shorter_than_a_segment_is_refused(folder: Path) -> None:
    pl.read_csv(folder / "zigzag.csv").head(50).write_csv(folder / "zigzag.csv")
    assert "has no piece of 10 s" in refused_by_both(campaign(folder))


def test_a_start_vehicle_that_diverges_is_said_before_a_search(folder: Path) -> None:
    text = Vehicle.load("cwolf").with_coefficients({"X_uu": 3000.0}).to_toml()
    (folder / "driven.toml").write_text(text)
    made = campaign(folder, coefficients="X_udot = [-400.0, -1.0]", vehicle="driven.toml")
    found = check_campaign(made)
    said = " ".join((*found.problems, *found.warnings))
    assert "every one of 1024 candidates diverged; check the units and signs of the commands" in said
    # The search itself finds vehicles that do not.
    damped = campaign(folder, coefficients="X_uu = { bounds = [-40.0, 4000.0] }", vehicle="driven.toml")
    assert any("diverges" in text for text in check_campaign(damped).warnings)


def again(folder: Path, lines: str, *, trials: str = '["zigzag"]') -> Campaign:
    """The campaign of `folder` with further trials and those of its stage."""
    campaign(folder)
    text = (folder / "campaign.toml").read_text()
    text = text.replace('trials = ["zigzag"]', f"trials = {trials}")
    text = text.replace('file = "zigzag.csv"', f'file = "zigzag.csv"\nhold_out_s = [[40.0, 60.0]]\n{lines}')
    (folder / "campaign.toml").write_text(text)
    return Campaign.load(folder / "campaign.toml")


@pytest.mark.parametrize(("file", "end"), [("zigzag.csv", 40), ("copy.csv", 140)])
def test_the_same_recording_under_two_names_counts_twice(folder: Path, file: str, end: int) -> None:
    log = pl.read_csv(folder / "zigzag.csv").with_columns(pl.col("t_s") + 100.0)
    if file == "copy.csv":  # the same rows, written in another way
        log.select(sorted(log.columns)).write_csv(folder / "copy.csv")
    lines = f'[trials.more]\nfile = "{file}"\nhold_out_s = [[{end}.0, {end + 20}.0]]'
    made = again(folder, lines, trials='["zigzag", "more"]')
    (said,) = [text for text in check_campaign(made).warnings if "same recording" in text]
    assert said.startswith("WARNING: trials zigzag and more hold the same recording, which counts 2 times")


def test_training_data_cannot_be_held_out_under_another_name(folder: Path) -> None:
    words = "trial 'judge' holds out what trial 'zigzag' is fitted to"
    whole = again(folder, '[trials.judge]\nfile = "zigzag.csv"\nhold_out = true')
    assert words in refused_by_both(whole)
    part = again(folder, '[trials.judge]\nfile = "zigzag.csv"\nhold_out_s = [[40.0, 60.0]]')
    assert check_campaign(part).problems == ()
    assert not [text for text in check_campaign(part).warnings if "same recording" in text]
