"""Residual analysis of CWolf: the term that it misses ranks first, a truth inside the class is left alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from seatrial._core import State, Vehicle
from seatrial.campaign.campaign import Campaign
from seatrial.diagnosis.residual_analysis import ResidualAnalysis, analyse_joint
from seatrial.estimation.joint import Joint
from seatrial.estimation.joint_estimate import polish
from tests.statistics.linear_trials import memory

STERN = ("SbU", "SbL", "PU", "PL")
CAMPAIGN = """
format = 1
name = "made"
vehicle = "model.toml"
[trials.zigzag]
file = "zigzag.parquet"
[[stages]]
name = "turning"
trials = ["zigzag"]
axes = { free = "XYKN" }
[stages.coefficients]
X_udot = [-40.0, -1.0]
X_uu = [-30.0, -4.0]
Y_vdot = [-300.0, -50.0]
Y_vv = [-900.0, -100.0]
Y_uv = [-400.0, 0.0]
N_rdot = [-150.0, -10.0]
N_rr = [-500.0, -50.0]
N_ur = [-200.0, 0.0]
K_p = [-3.0, 0.0]
[polish]
channels = { u = 1.0, v = 1.0, p = 1.0, r = 1.0 }
"""


def analysed(folder: Path, seed: int, *, rho: float = 0.0, **truth: float) -> ResidualAnalysis:
    """Residual analysis of a joint estimate of CWolf without terms that the vehicle of the trial has."""
    vehicle = Vehicle.load("cwolf")
    (folder / "model.toml").write_text(vehicle.with_coefficients(dict.fromkeys(truth, 0.0)).to_toml())
    generator = np.random.default_rng(seed)
    # At 10 Hz the motors' dead time is one sample; where it is interpolated, the analysis sees it.
    t = np.arange(0.0, 160.0, 0.1)
    under_way = (
        t > 3.0
    )  # a record that begins amid a change of thrust does not say what the motors did before
    ahead = np.repeat(generator.uniform(400.0, 1500.0, 20), 80) * under_way
    turn = np.repeat(generator.uniform(-500.0, 500.0, 32), 50) * under_way
    side = {"SbU": 1.0, "SbL": 1.0, "PU": -1.0, "PL": -1.0}
    commands = {
        name: ahead + side[name] * turn if name in STERN else np.zeros(len(t)) for name in vehicle.actuators
    }
    moved = vehicle.with_coefficients(truth | {"X_uu": -12.0, "Y_vv": -380.0, "N_rr": -180.0})
    run = moved.simulate(t, dict(commands), State(), free="XYKN", max_step_s=0.02)
    noise = np.array([0.008, 0.008, 0.02, 0.02])  # m/s, deg/s
    seen = np.column_stack([run.nu[:, :2], np.rad2deg(run.nu[:, 3]), np.rad2deg(run.nu[:, 5])])
    seen = seen + noise * memory(generator.standard_normal(seen.shape), rho)
    columns = dict(zip(("u_m_s", "v_m_s", "p_deg_s", "r_deg_s"), seen.T, strict=True))
    columns |= dict(zip(("roll_deg", "pitch_deg", "yaw_deg"), np.rad2deg(run.euler).T, strict=True))
    frame = pl.DataFrame({"t_s": t, **columns, **{f"cmd.{name}": c for name, c in commands.items()}})
    campaign = Campaign.from_toml(CAMPAIGN, folder=folder, trials={"zigzag": frame})
    joint = Joint(campaign.problem(), threads=1)
    best = polish(joint)
    return analyse_joint(joint, best.values, initial=best.initial, noise=best.noise)


@pytest.mark.long
@pytest.mark.parametrize(("name", "truth"), [("Y_ur", 80.0), ("N_uv", 60.0), ("K_v", 2.0)])
def test_the_term_that_cwolf_misses_ranks_first_with_its_value(
    tmp_path: Path, name: str, truth: float
) -> None:
    found = analysed(tmp_path, 1, **{name: truth})
    first = found.suggestions[0]
    assert first.name == name
    assert f"free {name}" in first.sentence
    assert abs(first.value - truth) < 3.0 * first.sigma < 0.2 * truth
    assert first.gain > 5.0
    assert found.structural
    assert f"missing {name}" in (found.warning or "")
    assert "only the hold-out score" in (found.warning or "")
    # What is suggested explains all of it.
    assert len(found.suggestions) == 1
    assert not found.signals


@pytest.mark.parametrize(("seed", "rho"), [(1, 0.0), (2, 0.9)])
def test_a_truth_inside_the_class_is_left_alone(tmp_path: Path, seed: int, rho: float) -> None:
    found = analysed(tmp_path, seed, rho=rho)
    assert not found.structural
    # Noise with a memory is said, but not taken for a missing term.
    assert (found.warning is None) == (rho == 0.0)
