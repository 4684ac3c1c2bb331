"""Coverage: repetitions are reproducible and resumable, the table counts right, recordings are refused."""

from __future__ import annotations

import json
import math
import pickle
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from seatrial.base.errors import CampaignError
from seatrial.base.progress import Progress
from seatrial.campaign.campaign import Campaign
from seatrial.cli import app
from seatrial.estimation.joint import Joint
from seatrial.experiment import coverage as coverage_module
from seatrial.experiment.coverage import coverage
from seatrial.experiment.coverage_result import Coverage
from seatrial.experiment.generated_trials import GeneratedTrials, sensor_seed
from seatrial.experiment.repetition import Repetition
from seatrial.experiment.repetition import run_repetition as original
from seatrial.trial.generated import Recipe
from seatrial.trial.trial import Trial
from seatrial.trial.truth import Truth

pytestmark = pytest.mark.long

CWOLF = Path(__file__).parents[2] / "examples" / "cwolf"

TRUTH = """
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

BACK = "[initial]\nyaw_deg = 180.0\n"

COEFFICIENTS = ("X_udot", "X_u", "X_uu")
SEEDS = 8


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign on the surge axis: two trials on opposite courses and one that is held out."""
    place = tmp_path_factory.mktemp("ahead")
    (place / "truth.toml").write_text(TRUTH)
    (place / "there.toml").write_text(RECIPE)
    for name in ("back", "unseen"):
        (place / f"{name}.toml").write_text(RECIPE + BACK)
    (place / "campaign.toml").write_text(CAMPAIGN)
    return place


@pytest.fixture(scope="module")
def campaign(folder: Path) -> Campaign:
    return Campaign.load(folder / "campaign.toml")


@pytest.fixture(scope="module")
def found(campaign: Campaign, folder: Path) -> Coverage:
    return coverage(campaign, seeds=SEEDS, analysed=1, run_dir=folder / "run", threads=1)


def test_identifiable_coefficients_and_the_current_lie_in_their_intervals(found: Coverage) -> None:
    table = {row.name: row for row in found.rows}
    assert found.failures == ()
    for name in (*COEFFICIENTS, "current_north"):
        row = table[name]
        assert row.verdict == "identifiable"
        assert row.inside >= row.required == 6  # of 8: fewer is bad luck in one case of 170
        # Eight repetitions tell the scatter to 27 % (one standard deviation); a factor of 2.2 is beyond four.
        assert 1 / 2.2 < row.sigma / row.scatter < 2.2
        assert abs(row.bias_t) < 5.4  # Student's t with 7 degrees of freedom: one case of a thousand
    assert {row.name: row.truth for row in found.rows}["X_u"] == pytest.approx(1.25 * -3.0)
    assert table["current_north"].truth == 0.1


def test_what_no_channel_shows_is_called_so_and_may_be_set_at_will(found: Coverage) -> None:
    row = next(row for row in found.rows if row.name == "I_x")
    assert row.verdict == "not identifiable"
    assert {one.name for one in found.held} == {"I_x"}
    assert len(found.held) == 2
    assert all(abs(one.value - one.estimate) > 0.6 for one in found.held)
    # It enters no free axis: what is left is where the refit stopped, well below 3.84 / 2 of 95 %.
    assert all(abs(one.rise) < 0.1 and not one.contradicted for one in found.held)


def test_biases_are_drawn_anew_and_counted_together(found: Coverage) -> None:
    row = next(row for row in found.rows if row.name == "bias_u")
    assert row.n == 2 * SEEDS
    assert math.isnan(row.truth)
    assert row.inside >= row.required
    drawn = [draw.truth[draw.names.index("there: bias_u")] for draw in found.repetitions]
    assert len(set(drawn)) == SEEDS


def test_the_held_out_trial_scores_the_estimate_like_the_truth(found: Coverage) -> None:
    scores = found.hold_out()
    assert scores["estimate"]["u"] > scores["start"]["u"]
    assert (
        abs(scores["estimate"]["u"] - scores["truth"]["u"]) < 0.002
    )  # a difference below 0.02 means nothing


def test_the_same_seed_gives_the_same_repetition(campaign: Campaign, found: Coverage) -> None:
    with ThreadPoolExecutor(2) as pool:  # as workers do it
        second = coverage(campaign, seeds=1, first=2, analysed=0, executor=pool)
    assert timeless(second.repetitions[0]) == timeless(found.repetitions[1])
    assert found.repetitions[0].estimate != found.repetitions[1].estimate


def test_an_interrupted_run_goes_on_and_equals_an_undisturbed_one(
    campaign: Campaign, found: Coverage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_seeds: list[int] = []

    def counted(generated: GeneratedTrials, seed: int, **options: Any) -> Repetition:
        run_seeds.append(seed)
        if run_seeds == [1, 2, 3]:
            raise KeyboardInterrupt
        return original(generated, seed, **options)

    monkeypatch.setattr(coverage_module, "run_repetition", counted)

    def run() -> Coverage:
        return coverage(campaign, seeds=4, analysed=0, run_dir=tmp_path / "run", threads=1)

    part = run()
    assert part.interrupted
    assert [one.seed for one in part.repetitions] == [1, 2]
    assert not (tmp_path / "run").exists()
    whole = run()
    assert run_seeds == [1, 2, 3, 3, 4]
    assert [timeless(one) for one in whole.repetitions] == [timeless(one) for one in found.repetitions[:4]]
    kept = json.loads((tmp_path / "run" / "coverage.json").read_text())
    assert [one["seed"] for one in kept["repetitions"]] == [1, 2, 3, 4]


def timeless(one: Repetition) -> Repetition:
    """The draw without its wall time and what only some are asked."""
    return replace(one, wall_s=0.0, residual_analysis=None)


def test_a_published_run_is_reused_unless_told_otherwise(
    campaign: Campaign, found: Coverage, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: Any, **__: Any) -> Repetition:
        raise AssertionError("the repetition was kept")

    monkeypatch.setattr(coverage_module, "run_repetition", never)
    shutil.copytree(folder / "run", tmp_path / "run")
    shown: list[Progress] = []
    again = coverage(campaign, seeds=3, analysed=1, run_dir=tmp_path / "run", progress=shown.append)
    assert again.repetitions == found.repetitions[:3]
    assert shown[-1].done == 3
    with pytest.raises(AssertionError):
        coverage(campaign, seeds=3, run_dir=tmp_path / "run", resume=False)


def test_a_coverage_is_saved_as_a_run_and_survives_pickling(found: Coverage, tmp_path: Path) -> None:
    run = found.save(tmp_path / "run")
    names = sorted(path.name for path in run.iterdir())
    assert names == ["coverage.json", "report.json", "run.json", "summary.txt"]
    facts = json.loads((run / "run.json").read_text())
    assert (facts["kind"], facts["name"], facts["seed"]) == ("coverage", found.campaign, 1)
    assert (run / "summary.txt").read_text() == f"{found.summary()}\n"
    for words in ("intervals", "Worst: ", "Next: ", "X_uu", "R2 ten seconds ahead"):
        assert words in found.summary()
    assert pickle.loads(pickle.dumps(found)).summary() == found.summary()


def test_a_recording_is_refused(folder: Path) -> None:
    table = Recipe.load(folder / "there.toml").table()
    given = Campaign.load(folder / "campaign.toml", trials={"there": table})
    with pytest.raises(CampaignError, match=r"'there' is a recording \(a table\).*needs generated"):
        coverage(given, seeds=1)
    table.write_csv(folder / "there.csv")
    recorded = Campaign.load(folder / "campaign.toml", trials={"there": folder / "there.csv"})
    with pytest.raises(CampaignError, match=r"there\.csv"):
        coverage(recorded, seeds=1)


def test_a_campaign_without_trials_is_refused(tmp_path: Path) -> None:
    """One that only verifies has none."""
    text = 'format = 1\nname = "deep"\nvehicle = "cwolf"\nautopilot = "cwolf"\n'
    text += (
        '[verification]\nmissions = ["deep.toml"]\nruns = 10\n[[verification.requirements]]\nname = "end"\n'
    )
    text += 'holds = "complete"\nprobability = 0.9\n'
    (tmp_path / "campaign.toml").write_text(text)
    shown = CliRunner().invoke(
        app, ["coverage", str(tmp_path / "campaign.toml"), "--out", str(tmp_path / "run")]
    )
    assert shown.exit_code == 2, shown.output
    assert "[trials]: expected at least one generated trial, found none" in " ".join(shown.output.split())


def test_two_truths_are_refused(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "truth.toml").write_text(TRUTH.replace("1.25", "1.30"))
    (tmp_path / "other.toml").write_text(RECIPE)
    mixed = Campaign.load(folder / "campaign.toml", trials={"back": tmp_path / "other.toml"})
    with pytest.raises(CampaignError, match="'back' has another truth vehicle than 'there'"):
        coverage(mixed, seeds=1)


def test_a_truth_outside_the_model_class_is_named_and_warned_of(campaign: Campaign, folder: Path) -> None:
    other = TRUTH + "[values]\n" + "".join(f'"{name}.T_1" = 0.6\n' for name in ("SbU", "SbL", "PU", "PL"))
    (folder / "outside.toml").write_text(other)
    result = coverage(campaign, seeds=2, truth=Truth.load(folder / "outside.toml"), analysed=1, threads=1)
    assert result.outside == {f"{name}.T_1": (0.15, 0.6) for name in ("PL", "PU", "SbL", "SbU")}
    assert (result.analysed, result.warned) == (1, 1)
    residual_analysis = result.repetitions[0].residual_analysis
    assert residual_analysis is not None
    assert "outside the model class" in residual_analysis[0]
    assert "stern.T_1" in residual_analysis[0]
    assert result.held == ()
    assert result.failures == ()
    scores = result.hold_out()
    assert scores["start"]["u"] < scores["estimate"]["u"] < scores["truth"]["u"]


def test_bounds_that_exclude_the_truth_put_it_outside(folder: Path) -> None:
    narrow = Campaign.from_toml(CAMPAIGN.replace("[-15.0, 0.0]", "[-3.5, 0.0]"), folder=folder)
    generated = GeneratedTrials(narrow)
    assert list(generated.outside(Joint(generated.logged(1)))) == ["X_u"]


def test_a_current_carries_the_vehicle_and_the_log_does_not_tell_it(folder: Path) -> None:
    still = (RECIPE.split("commands")[0]).replace("north_m_s = 0.1", "north_m_s = 0.2, east_m_s = -0.1")
    (folder / "drift.toml").write_text(still.replace("80.0", "400.0") + "[initial]\nyaw_deg = 90.0\n")
    position = np.asarray(Recipe.load(folder / "drift.toml").run().position)
    # Drag of 3.75 N s/m on 140 kg: after ten time constants the water has taken the vehicle along.
    np.testing.assert_allclose((position[-1] - position[-101])[:2] / 10.0, [0.2, -0.1], atol=0.005)
    assert Trial.read(folder / "drift.toml").current is None


def test_another_seed_changes_the_noise_and_nothing_else(folder: Path) -> None:
    recipe = Recipe.load(folder / "there.toml")
    run = recipe.run()
    first, second = recipe.table(run=run, seed=1), recipe.table(run=run, seed=2)
    assert first["cmd.SbU"].equals(second["cmd.SbU"])
    assert not first["u_m_s"].equals(second["u_m_s"])
    assert recipe.table(run=run).equals(recipe.table())
    assert sensor_seed("there", 1) != sensor_seed("back", 1) != sensor_seed("back", 2)


def test_the_command_prints_the_table_and_its_exit_code_tells_the_verdict(
    folder: Path, found: Coverage
) -> None:
    path, out = str(folder / "campaign.toml"), str(folder / "run")
    arguments = ["coverage", path, "--seeds", str(SEEDS), "--analysed", "1", "--threads", "1", "--out", out]
    shown = CliRunner().invoke(app, arguments)
    assert shown.exit_code == 0
    assert "X_uu" in shown.output
    assert "I_x held at" in shown.output
    plain = CliRunner().invoke(app, [*arguments, "--json"])
    data = json.loads(plain.stdout)
    assert data["rows"][1]["inside"] == found.rows[1].inside
    kept = Path(out) / "coverage.json"
    assert json.loads(kept.read_text())["failures"] == []


def test_the_shipped_campaign_has_its_truth_inside_the_class_and_the_other_outside() -> None:
    shipped = Campaign.load(CWOLF / "coverage.toml")
    generated = GeneratedTrials(shipped)
    joint = Joint(generated.logged(1))
    assert generated.outside(joint) == {}
    assert np.isfinite(generated.true_values(joint, 1)).all()
    other = GeneratedTrials(shipped, truth=Truth.load(CWOLF / "coverage_outside.toml"))
    assert {"Y_rdot", "Z_qdot", "N_vv", "PU.T_1"} <= set(other.outside(joint))
