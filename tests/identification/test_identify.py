"""Identification of a vehicle from trials that a known one made: what is found, kept, resumed and refused."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from seatrial._core import State, Vehicle
from seatrial.base.errors import CampaignError, SeatrialError, SimulationError
from seatrial.base.work import Progress, Work
from seatrial.campaign.campaign import Campaign
from seatrial.check.campaign import check_campaign
from seatrial.estimation.descent import Criterion
from seatrial.identification.fitted import filter_noise
from seatrial.identification.identification import Identification
from seatrial.identification.identify import identify
from tests.base.killed import kill

TRUTH = {"X_udot": -9.0, "X_uu": -14.0, "Z_ww": -450.0, "Z_wdot": -160.0}

HEAD = """
format = 1
name = "made"
vehicle = "cwolf"
seed = 11
"""
SURGE = """
[[stages]]
name = "surge"
trials = ["run"]
axes = { free = "X" }
[stages.coefficients]
X_udot = [-30.0, -1.0]
X_uu = [-30.0, -4.0]
"""
HEAVE = """
[[stages]]
name = "heave"
trials = ["dive"]
axes = { free = "Z" }
[stages.coefficients]
Z_wdot = { bounds = [0.5, 2.0], relative = true }
Z_ww = [-900.0, -100.0]
"""
TRIALS = """
[trials.run]
file = "run.parquet"
hold_out_s = [[60.0, 80.0]]
[trials.dive]
file = "dive.parquet"
"""
STERN = ("SbU", "SbL", "PU", "PL")
VERTICAL = ("VTB", "VTS")


def record(actuators: tuple[str, ...], axis: int, noise: float, seed: int) -> pl.DataFrame:
    """A noisy log at 10 Hz of the true vehicle: stepped revolutions of some actuators, one axis free."""
    generator = np.random.default_rng(seed)
    vehicle = Vehicle.load("cwolf").with_coefficients(TRUTH)
    t = np.arange(0.0, 80.0, 0.1)
    steps = np.repeat(generator.uniform(-1500.0, 1500.0, 16), 50)
    commands = {name: steps if name in actuators else np.zeros(len(t)) for name in vehicle.actuators}
    run = vehicle.simulate(t, commands, State(), free="XYZKMN"[axis], max_step_s=0.02)
    speed = np.asarray(run.nu)[:, axis] + generator.normal(0.0, noise, len(t))
    column = ("u_m_s", "v_m_s", "w_m_s")[axis]
    return pl.DataFrame({"t_s": t, column: speed, **{f"cmd.{name}": c for name, c in commands.items()}})


@pytest.fixture(scope="module")
def recordings() -> dict[str, pl.DataFrame]:
    return {"run": record(STERN, 0, 0.01, 1), "dive": record(VERTICAL, 2, 0.005, 2)}


@pytest.fixture
def campaign(recordings: dict[str, pl.DataFrame]) -> Callable[..., Campaign]:
    def made(*stages: str, trials: str = TRIALS) -> Campaign:
        return Campaign.from_toml(HEAD + trials + "".join(stages), source="made.toml", trials=recordings)

    return made


def found(fit: Identification) -> dict[str, float]:
    return {row.name: row.estimate for row in fit.coefficients}


def outcome(fit: Identification) -> list[Any]:
    return [(s.name, s.cost, s.evaluations, s.estimates, [h.best for h in s.history]) for s in fit.stages]


def test_true_coefficients_are_found_again(campaign: Callable[..., Campaign]) -> None:
    fit = campaign(SURGE, HEAVE).identify()
    # Noise of 1 % of the speeds over 600 to 800 samples, smoothed starts: a few per cent.
    assert found(fit)["X_uu"] == pytest.approx(TRUTH["X_uu"], rel=0.03)
    assert found(fit)["Z_ww"] == pytest.approx(TRUTH["Z_ww"], rel=0.03)
    assert found(fit)["Z_wdot"] == pytest.approx(TRUTH["Z_wdot"], rel=0.05)
    # 5 kg of added mass beside 135 kg of dry mass: within 2 % of the apparent mass.
    assert found(fit)["X_udot"] == pytest.approx(TRUTH["X_udot"], abs=2.8)
    assert fit.vehicle.coefficients()["X_uu"] == found(fit)["X_uu"]
    assert all(stage.cost < 0.5 * stage.start_cost for stage in fit.stages)
    assert fit.scores["hold_out"]["ahead"]["run"]["u"].r2 > 0.99
    assert set(fit.scores["fit"]["ahead"]) == {"run", "dive", "all"}
    # 20 of the 80 s are held out, at 10 Hz; the first sample of a window does not count.
    assert 190 <= fit.scores["hold_out"]["free"]["run"]["u"].n < 200
    assert 590 <= fit.scores["fit"]["free"]["run"]["u"].n < 600


def test_the_vehicle_file_says_what_the_model_leaves_unexplained(campaign: Callable[..., Campaign]) -> None:
    fit = campaign(SURGE, HEAVE).identify()
    told = Vehicle.from_toml(str(fit.files()["vehicle.toml"])).to_dict()["model_error"]
    noise = filter_noise(fit)
    assert told == {name: np.asarray(value).tolist() for name, value in noise.items()}
    # Noise of the sensors alone: less than the default, which what no log measured has.
    default = 0.03 * np.diag(fit.vehicle.mass_matrix())
    assert noise["force"][[1, 3, 4, 5]] == pytest.approx(default[[1, 3, 4, 5]])
    assert np.all(noise["force"][[0, 2]] < default[[0, 2]])
    assert "model_error" not in fit.stages_vehicle.to_dict()
    # The next identification starts from the file and finds its own.
    again = identify(fit.vehicle, fit.problem.trials["run"], free={"X_uu": None})
    assert again.vehicle.to_dict()["model_error"]["force"][2] == pytest.approx(default[2])


@pytest.mark.long
def test_same_seed_same_result_whatever_the_threads_and_the_company(
    campaign: Callable[..., Campaign],
) -> None:
    first = outcome(campaign(SURGE, HEAVE).identify(work=Work(threads=1)))
    assert outcome(campaign(SURGE, HEAVE).identify(work=Work(threads=2))) == first
    with ThreadPoolExecutor(2) as pool:  # as workers do it
        assert outcome(campaign(SURGE, HEAVE).identify(work=Work(executor=pool))) == first
    assert outcome(campaign(HEAVE).identify(work=Work(threads=2))) == first[1:]


@pytest.mark.long
def test_estimated_initial_velocities_lower_the_cost(campaign: Callable[..., Campaign]) -> None:
    smoothed = campaign(SURGE).identify()
    estimated = campaign(SURGE.replace("axes", 'start = "estimated"\naxes')).identify()
    assert estimated.stages[0].cost < smoothed.stages[0].cost
    assert found(estimated)["X_uu"] == pytest.approx(TRUTH["X_uu"], rel=0.03)  # as for smoothed starts


def test_dependent_stage_starts_from_the_former_estimate(campaign: Callable[..., Campaign]) -> None:
    again = SURGE.replace('"surge"', '"again"').replace("axes", 'after = ["surge"]\naxes')
    fit = campaign(SURGE, again).identify()
    former, latter = fit.stages
    assert latter.starts == former.estimates
    assert latter.start_cost == former.cost
    rows = {row.name: row for row in fit.coefficients}
    assert rows["X_uu"].stage == "again"
    assert rows["X_uu"].start == Vehicle.load("cwolf").coefficients()["X_uu"]


def test_bound_that_was_hit_is_said(campaign: Callable[..., Campaign]) -> None:
    fit = campaign(SURGE.replace("[-30.0, -4.0]", "[-12.0, -4.0]")).identify()
    rows = {row.name: row for row in fit.coefficients}
    assert rows["X_uu"].at_bound == "lower"
    assert rows["X_udot"].at_bound is None
    assert "X_uu is not identified, it ended at its lower bound" in fit.summary()
    assert (rows["X_uu"].verdict, rows["X_uu"].sigma, rows["X_uu"].interval) == (
        "not identifiable",
        math.inf,
        None,
    )
    assert rows["X_udot"].sigma is not None
    assert math.isfinite(rows["X_udot"].sigma)


def test_run_directory_holds_the_results(campaign: Callable[..., Campaign], tmp_path: Path) -> None:
    fit = campaign(SURGE).identify(work=Work(run_dir=tmp_path / "run"))
    folder = tmp_path / "run"
    assert Vehicle.load(str(folder / "vehicle.toml")).coefficients() == fit.vehicle.coefficients()
    table = pl.read_parquet(folder / "coefficients.parquet")
    assert dict(zip(table["name"], table["estimate"], strict=True)) == found(fit)
    assert len(pl.read_parquet(folder / "history.parquet")) == len(fit.stages[0].history)
    assert {"part", "kind", "trial", "channel", "r2"} <= set(
        pl.read_parquet(folder / "scores.parquet").columns
    )
    assert [entry.name for entry in tmp_path.iterdir()] == ["run"]


def test_finished_stages_are_reused_and_changed_ones_run_again(
    campaign: Callable[..., Campaign], tmp_path: Path
) -> None:
    first = campaign(SURGE, HEAVE).identify(work=Work(run_dir=tmp_path / "run"))
    again = campaign(SURGE, HEAVE).identify(work=Work(run_dir=tmp_path / "run"))
    assert [stage.reused for stage in again.stages] == [True, True]
    assert outcome(again) == outcome(first)
    changed = campaign(SURGE, HEAVE.replace("-900.0", "-800.0")).identify(work=Work(run_dir=tmp_path / "run"))
    assert [stage.reused for stage in changed.stages] == [True, False]
    afresh = campaign(SURGE, HEAVE).identify(work=Work(run_dir=tmp_path / "run", resume=False))
    assert [stage.reused for stage in afresh.stages] == [False, False]


def test_interrupt_keeps_the_best_so_far_and_the_run_goes_on_later(
    campaign: Callable[..., Campaign], tmp_path: Path
) -> None:
    later = HEAVE.replace("axes", 'after = ["surge"]\naxes')
    seen: list[Progress] = []

    def interrupt(progress: Progress) -> None:
        seen.append(progress)
        if progress.what == "heave":
            raise KeyboardInterrupt

    fit = campaign(SURGE, later).identify(work=Work(run_dir=tmp_path / "run", progress=interrupt))
    assert fit.interrupted
    assert [stage.interrupted for stage in fit.stages] == [False, True]
    assert fit.stages[1].cost <= fit.stages[1].start_cost
    assert "Interrupted" in fit.summary()
    assert all(0.0 <= p.fraction <= 1.0 and not p.left_s < 0.0 for p in seen)
    resumed = campaign(SURGE, later).identify(work=Work(run_dir=tmp_path / "run"))
    assert [stage.reused for stage in resumed.stages] == [True, False]
    assert outcome(resumed) == outcome(campaign(SURGE, later).identify())


def test_interrupt_of_the_joint_estimate_keeps_the_stages(
    campaign: Callable[..., Campaign], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = campaign(SURGE)
    with monkeypatch.context() as patch:

        def interrupted(*_: Any, **__: Any) -> None:
            raise KeyboardInterrupt

        patch.setattr("seatrial.identification.identify.joint_estimate_of", interrupted)
        fit = asked.identify(work=Work(run_dir=tmp_path / "run"))
    assert fit.interrupted
    assert fit.assessment is None
    assert fit.not_run == ()
    assert fit.vehicle.coefficients()["X_uu"] == fit.stages[0].coefficients["X_uu"]
    assert (tmp_path / "run" / "vehicle.toml").is_file()
    again = asked.identify(work=Work(run_dir=tmp_path / "run"))
    assert not again.interrupted
    assert again.assessment is not None
    assert again.stages[0].reused


@pytest.mark.long
def test_a_killed_identification_goes_on_and_equals_an_undisturbed_one(
    campaign: Callable[..., Campaign], recordings: dict[str, pl.DataFrame], tmp_path: Path
) -> None:
    """kill -9 in the second stage."""
    later = HEAVE.replace("axes", 'after = ["surge"]\naxes')
    for name, table in recordings.items():
        table.write_parquet(tmp_path / f"{name}.parquet")
    (tmp_path / "made.toml").write_text(HEAD + TRIALS + SURGE + later)
    kill(
        """
        import seatrial as st
        def watch(state):
            if state.what == "heave":
                die()
        campaign = st.Campaign.load(folder / "made.toml")
        campaign.identify(work=st.Work(run_dir=folder / "run", progress=watch))
        """,
        tmp_path,
    )
    assert not (tmp_path / "run").exists()
    made = Campaign.load(tmp_path / "made.toml")
    resumed = made.identify(work=Work(run_dir=tmp_path / "run"))
    assert [stage.reused for stage in resumed.stages] == [True, False]
    undisturbed = campaign(SURGE, later).identify()
    assert outcome(resumed) == outcome(undisturbed)
    assert found(resumed) == found(undisturbed)
    again = json.loads((tmp_path / "run" / "run.json").read_text())
    assert (again["kind"], again["name"], again["interrupted"]) == ("identification", "made", False)
    assert not list(tmp_path.glob("run.[!p]*"))
    assert not (tmp_path / "run.partial").exists()


def test_stage_that_waits_for_an_interrupted_one_is_named(campaign: Callable[..., Campaign]) -> None:
    def interrupt(progress: Progress) -> None:
        raise KeyboardInterrupt

    fit = campaign(SURGE, HEAVE.replace("axes", 'after = ["surge"]\naxes')).identify(
        work=Work(progress=interrupt)
    )
    assert fit.not_run == ("heave",)


def test_error_of_a_display_ends_the_run(campaign: Callable[..., Campaign]) -> None:
    def broken(progress: Progress) -> None:
        raise ZeroDivisionError("in the display")

    with pytest.raises(ZeroDivisionError, match="in the display"):
        campaign(SURGE, HEAVE).identify(work=Work(progress=broken))


def test_coefficient_without_influence_is_refused(campaign: Callable[..., Campaign]) -> None:
    with pytest.raises(CampaignError, match="'N_rr' changes nothing in this stage"):
        campaign(SURGE + "N_rr = [-200.0, -100.0]\n").identify()


def test_directory_that_cannot_be_written_is_refused_before_the_search(
    campaign: Callable[..., Campaign], tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    seen: list[Progress] = []
    with pytest.raises(SeatrialError, match="cannot be written"):
        campaign(SURGE).identify(work=Work(run_dir=tmp_path / "file" / "run", progress=seen.append))
    assert not seen


def test_all_candidates_diverged(campaign: Callable[..., Campaign], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Criterion, "__call__", lambda self, candidates: np.full(len(candidates), np.inf))
    with pytest.raises(SimulationError, match="candidates diverged; check the units"):
        campaign(SURGE).identify()


def test_a_start_vehicle_that_diverges_is_said_and_searched_away_from(
    recordings: dict[str, pl.DataFrame],
) -> None:
    """Damping with the wrong sign: every segment runs away, and so do the derivatives."""
    drag = SURGE.replace("[-30.0, -4.0]", "[-30.0, 90.0]")
    start = Vehicle.load("cwolf").with_coefficients({"X_uu": 80.0})
    made = Campaign.from_toml(
        HEAD + TRIALS + drag + "[polish]\n", source="made.toml", trials=recordings, vehicle=start
    )
    check = check_campaign(made)
    assert any("'surge': the vehicle that the search starts from diverges" in line for line in check.warnings)
    fit = made.identify()
    assert any("'surge': the vehicle that the search starts from diverges" in line for line in fit.before)
    assert found(fit)["X_uu"] == pytest.approx(TRUTH["X_uu"], rel=0.03)
