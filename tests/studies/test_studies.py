"""Studies of the method on small cases; who asks seatrial for one is told where it is."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import seatrial as st
from seatrial.campaign.campaign import Campaign
from seatrial.cli import app
from seatrial.estimation.joint import Joint
from seatrial.trial.truth import Truth
from studies import coverage, random_starts
from tests.identification.test_identify import HEAD, HEAVE, STERN, SURGE, TRIALS, TRUTH, VERTICAL, record

AHEAD = """
format = 1
vehicle = "cwolf"
description = "more drag"
[factors]
X_udot = 1.4
X_u = 1.25
X_uu = 1.3
[sensors.dvl]
noise_m_s = 0.01
bias_m_s = 0.003
[sensors.attitude]
noise_deg = 0.1
[sensors.gyro]
noise_deg_s = 0.1
"""

RECIPE = """
format = 1
description = "steps ahead and astern"
truth = "truth.toml"
seed = 1
duration_s = 80.0
current = { north_m_s = 0.1 }
commands = [
    { t_s = 2.0, stern = 1000.0 },
    { t_s = 22.0, stern = 1800.0 },
    { t_s = 35.0, stern = 300.0 },
    { t_s = 50.0, stern = -800.0 },
    { t_s = 62.0, stern = 1400.0 },
]
"""

# Nothing rolls or yaws freely: I_x acts on no channel.
CAMPAIGN = """
format = 1
name = "ahead"
vehicle = "cwolf"
[trials]
there = { file = "there.toml" }
back = { file = "back.toml" }
unseen = { file = "unseen.toml", hold_out = true }
[[stages]]
name = "ahead"
trials = ["there", "back"]
axes = { free = "X", measured = "YZKMN" }
segment_s = 20.0
[stages.coefficients]
I_x = [0.5, 3.0]
X_udot = [-60.0, -0.1]
X_u = [-15.0, 0.0]
X_uu = "default"
[polish]
segment_s = 20.0
loss = "squared"
[polish.nuisances]
current_north = { sd = 0.2, shared = true }
bias_u = { sd = 0.003 }
"""


@pytest.mark.long
def test_coverage_of_a_campaign_on_the_surge_axis(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "truth.toml").write_text(AHEAD)
    (tmp_path / "there.toml").write_text(RECIPE)
    for name in ("back", "unseen"):
        (tmp_path / f"{name}.toml").write_text(RECIPE + "[initial]\nyaw_deg = 180.0\n")
    (tmp_path / "campaign.toml").write_text(CAMPAIGN)
    generated = coverage.GeneratedTrials(Campaign.load(tmp_path / "campaign.toml"))
    repetitions = [coverage.repetition(generated, seed) for seed in range(1, 9)]
    table = {row.name: row for row in coverage.rows(repetitions)}
    for name in ("X_udot", "X_u", "X_uu", "current_north"):
        row = table[name]
        assert row.verdict == "identifiable"
        assert row.inside >= coverage.required(8) == 6  # of 8: fewer is bad luck in one case of 170
        # Eight repetitions tell the scatter to 27 % (one standard deviation); a factor of 2.2 is beyond four.
        assert 1 / 2.2 < row.sigma / row.scatter < 2.2
        assert abs(row.bias_t) < 5.4  # Student's t with 7 degrees of freedom: one case of a thousand
    assert table["X_u"].truth == pytest.approx(1.25 * -3.0)
    assert table["current_north"].truth == 0.1
    # The biases of both trials, drawn anew each time, share a row.
    assert table["bias_u"].n == 16
    assert math.isnan(table["bias_u"].truth)
    # What enters no free axis may be set at will.
    assert table["I_x"].verdict == "not identifiable"
    ratios = dict(coverage.held_at_wrong_values(generated, 1, ["I_x"]))
    assert abs(ratios["I_x"]) < 0.2
    scores = repetitions[0].hold_out
    assert scores["start values"]["u"] < scores["estimate"]["u"]
    assert abs(scores["estimate"]["u"] - scores["the truth itself"]["u"]) < 0.002
    again = coverage.repetition(generated, 2)
    assert again.estimate.tolist() == repetitions[1].estimate.tolist() != repetitions[0].estimate.tolist()
    # The command, with a truth outside of the model class.
    lags = "".join(f'"{name}.T_1" = 0.6\n' for name in ("SbU", "SbL", "PU", "PL"))
    (tmp_path / "outside.toml").write_text(f"{AHEAD}[values]\n{lags}")
    with pytest.raises(typer.Exit) as done:
        coverage.study(
            tmp_path / "campaign.toml", truth=tmp_path / "outside.toml", seeds=1, first=1, analysed=1
        )
    assert done.value.exit_code == 0
    shown = capsys.readouterr().out
    assert "outside the model class: PL.T_1 0.6 (assumed 0.15)" in shown
    assert "the residual analysis warns in 1 of 1 repetitions" in shown
    assert "stern.T_1" in shown


@pytest.mark.long
def test_random_starts_find_the_same_optimum() -> None:
    recordings: dict[str, Any] = {"run": record(STERN, 0, 0.01, 1), "dive": record(VERTICAL, 2, 0.005, 2)}
    campaign = Campaign.from_toml(HEAD + TRIALS + SURGE + HEAVE, source="made.toml", trials=recordings)
    problem = campaign.problem()
    runs = [random_starts.stages_from(problem, 7, number) for number in range(3)]
    for ends in random_starts.compared(problem, runs):
        assert ends.above < 1e-3
        assert max(ends.spread.values()) < 0.01
    surge = [stages[0] for stages in runs]
    # As far from the truth as the noise of one search of these trials: see test_identify.
    assert [stage.estimates["X_uu"] for stage in surge] == pytest.approx([TRUTH["X_uu"]] * 3, rel=0.03)
    assert np.ptp([stage.starts["X_uu"] for stage in surge]) > 1.0


def test_the_shipped_campaign_has_its_truth_inside_the_class_and_the_other_outside() -> None:
    shipped = Campaign.load(coverage.CAMPAIGN)
    generated = coverage.GeneratedTrials(shipped)
    joint = Joint(generated.logged(1))
    assert generated.outside(joint) == {}
    assert np.isfinite(generated.true_values(joint, 1)).all()
    other = coverage.GeneratedTrials(
        shipped, truth=Truth.load(coverage.CAMPAIGN.with_name("truth_outside.toml"))
    )
    assert {"Y_rdot", "Z_qdot", "N_vv", "PU.T_1"} <= set(other.outside(joint))


def test_required_intervals() -> None:
    assert [coverage.required(n) for n in (50, 8)] == [44, 6]


@pytest.mark.parametrize(
    ("arguments", "study"),
    [
        (["coverage", "ahead.toml"], "studies.coverage"),
        (["identify", "ahead.toml", "--random-starts", "3"], "studies.random_starts"),
        (["identify", "ahead.toml", "--random-starts=3"], "studies.random_starts"),
    ],
)
def test_a_call_of_what_is_a_study_is_told_so(arguments: list[str], study: str) -> None:
    refused = CliRunner().invoke(app, arguments)
    assert refused.exit_code == 2
    assert f"python -m {study}" in " ".join(refused.stderr.split())


@pytest.mark.parametrize(("name", "study"), [("coverage", "coverage"), ("restarts", "random_starts")])
def test_a_name_that_is_a_study_is_told_so(name: str, study: str) -> None:
    with pytest.raises(AttributeError, match=rf"python -m studies\.{study}"):
        getattr(st, name)
