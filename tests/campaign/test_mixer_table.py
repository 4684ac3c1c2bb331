"""The table [mixer] of a campaign and of a trial: keys, ranges, and that it reaches the trial."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

import seatrial as st
from seatrial.base.errors import CampaignError
from seatrial.cli import app

CAMPAIGN = """
format = 1
name = "sticks"
vehicle = "bluerov2-heavy"
{head}
[trials.dive]
file = "dive.csv"
{trial}
[[stages]]
name = "surge"
trials = ["dive"]
axes = {{ free = "X" }}
[stages.coefficients]
X_uu = [-200.0, -50.0]
"""
MIXER = """
[mixer]
frame = "VECTORED_6DOF"
reversed = ["thruster_1", "thruster_2"]
supply_v = 15.0
[mixer.inputs]
forward = { column = "C5" }
yaw = { column = "C4", reversed = true, dead_zone = 10.0 }
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    t = np.arange(0.0, 20.0, 0.1)
    table = {"t_s": t, "u_m_s": 0.1 * t, "C4": 1500.0 + 0.0 * t, "C5": 1500.0 + 10.0 * t}
    pl.DataFrame(table).write_csv(tmp_path / "dive.csv")
    return tmp_path


def campaign(folder: Path, head: str = MIXER, trial: str = "") -> Path:
    path = folder / "campaign.toml"
    path.write_text(CAMPAIGN.format(head=head, trial=trial))
    return path


def test_sticks_of_a_campaign_drive_its_vehicle(folder: Path) -> None:
    trial = st.Campaign.load(campaign(folder)).trials["dive"]
    assert sorted(trial.commands) == [f"thruster_{k}" for k in range(1, 9)]
    # Motors 1 and 2 have the factor -1 of forward, and are reversed here.
    ahead = [trial.commands[f"thruster_{k}"][100] for k in range(1, 5)]
    assert ahead == pytest.approx([1600.0, 1600.0, 1600.0, 1600.0])
    assert trial.voltage_v is not None
    assert trial.voltage_v[0] == 15.0
    vehicle = st.Vehicle.load("bluerov2-heavy")
    assert set(vehicle.actuators) == set(trial.commands)


def test_the_mixer_of_a_trial_replaces_that_of_the_campaign(folder: Path) -> None:
    outputs = "{ rudder = { mix = { s = 1.0 }, full = 0.4 } }"
    own = f'mixer = {{ inputs = {{ s = {{ column = "C5" }} }}, outputs = {outputs} }}'
    trial = st.Campaign.load(campaign(folder, trial=own)).trials["dive"]
    assert list(trial.commands) == ["rudder"]


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("VECTORED_6DOF", "VECTORED_6DOFF", "key mixer: frame: unknown frame 'VECTORED_6DOFF'; did you mean"),
        ("supply_v = 15.0", "supply_v = -1.0", "key supply_v: expected greater than 0, found -1"),
        ("supply_v = 15.0", "supply_v = 1e6", "key supply_v: expected a number from 0.1 to 10000"),
        ("dead_zone = 10.0", "dead_zone = 500.0", "inputs.yaw: expected min < trim < max and a dead"),
        ("dead_zone", "deadzone", "key yaw: unknown key 'deadzone'; did you mean"),
        ("reversed = true", 'trim = "middle"', "key trim"),
        ('column = "C5"', 'column = "C5", max = 1e9', "key max: expected a number from -1e+06 to 1e+06"),
        ('"thruster_2"]', '"thruster_20"]', "reversed: unknown motor 'thruster_20'"),
    ],
)
def test_a_wrong_key_says_what_to_do(folder: Path, old: str, new: str, says: str) -> None:
    assert old in MIXER
    path = campaign(folder, MIXER.replace(old, new))
    with pytest.raises(CampaignError) as refusal:
        st.Campaign.load(path)
    assert says in str(refusal.value)
    answer = CliRunner().invoke(app, ["check", str(path)])
    assert answer.exit_code == 2
