"""A problem by hand, without a file: the same question, the same numbers as with a campaign file."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import seatrial as st
from seatrial.identification.fitted import Fitted
from seatrial.problem.problem import Problem

T = np.arange(0.0, 60.0, 0.1)
TRUE = st.Vehicle.load("cwolf")
START = TRUE.with_coefficients({"X_uu": 0.7 * TRUE.coefficients()["X_uu"]})


def trial(name: str = "straight", level: float = 500.0, *, samples: int = len(T)) -> st.Trial:
    """A straight run of the true vehicle, all axes logged."""
    commands = {actuator: level + 300.0 * np.sign(np.sin(0.2 * T)) for actuator in TRUE.actuators}
    run = TRUE.simulate(T, commands)
    columns = dict(zip(("u_m_s", "v_m_s", "w_m_s"), run.nu[:, :3].T, strict=True))
    rates = dict(zip(("p_deg_s", "q_deg_s", "r_deg_s"), np.rad2deg(run.nu[:, 3:]).T, strict=True))
    logged = {f"cmd.{actuator}": signal for actuator, signal in commands.items()}
    table = {"t_s": T} | columns | rates | logged
    return st.Trial.read({column: values[:samples] for column, values in table.items()}, name=name)


@pytest.fixture(scope="module")
def fit() -> st.Identification:
    return st.identify(START, [trial()], free={"X_uu": (-40.0, -1.0)}, seed=3, work=st.Work(threads=1))


def test_truth_is_found_and_the_end_of_every_trial_judges(fit: st.Identification) -> None:
    assert fit.vehicle.coefficients()["X_uu"] == pytest.approx(TRUE.coefficients()["X_uu"], rel=1e-2)
    assert set(fit.scores) == {"fit", "hold_out"}
    assert fit.problem.held_out("straight").mean() == pytest.approx(0.2, abs=0.01)
    assert fit.sigma["X_uu"] > 0.0


def test_baselines_are_judged_on_the_windows_of_the_result(fit: st.Identification) -> None:
    assert list(fit.baselines) == ["hold last", "mean", "first order", "linear"]
    pooled = next(iter(fit.scores["hold_out"]["ahead"].values()))
    assert fit.baselines == pooled.baselines
    assert set(fit.baselines["linear"]) == {"u"}  # the other axes are replayed
    assert fit.to_dict()["baselines"] == fit.baselines
    assert "beside baselines, on held-out data" in fit.summary()
    assert "Does not beat" not in fit.summary()  # the true model class beats them all
    better = replace(pooled, baselines={"first order": {"u": 1.0}})
    beaten = replace(fit, scores={**fit.scores, "hold_out": {"ahead": {"straight": better}}})
    first = beaten.report().lines()[0]
    assert "Does not beat a baseline in u (R2 " in first
    assert "first order 1.0000)" in first
    calm = replace(beaten, assessment=None, choice=None, notes=())
    assert calm.report().worst.startswith("a baseline predicts as well as the model: u (R2 ")


def test_a_file_with_the_same_content_gives_the_same_numbers(fit: st.Identification) -> None:
    text = """
format = 1
name = "cwolf"
vehicle = "cwolf"
seed = 3
trials.straight = { file = "straight.csv", hold_out_s = [[47.92, 60.0]] }
polish = {}
[[stages]]
name = "all"
trials = ["straight"]
axes = { free = "X", measured = "YZKMN" }
coefficients = { X_uu = [-40.0, -1.0] }
"""
    campaign = st.Campaign.from_toml(text, trials={"straight": trial()}, vehicle=START)
    other = campaign.identify(work=st.Work(threads=1))
    assert other.vehicle.coefficients() == fit.vehicle.coefficients()
    assert other.sigma == fit.sigma
    again = st.Campaign.from_toml(fit.problem.text, trials={"straight": trial()}, vehicle=START)
    assert again.file.stages == fit.problem.stages


def test_patterns_groups_and_starts() -> None:
    campaign = Problem(TRUE, {"a": trial()}, free=["X_u*", "stern.gain"], start={"X_uu": -9.0}, hold_out=0.0)
    stage = campaign.stages[0]
    assert {"X_u", "X_uu", "stern.gain"} <= set(stage.coefficients)
    assert stage.coefficients["X_uu"].start == -9.0
    assert stage.axes.free == "X"
    assert not campaign.held_out("a").any()


def test_whole_trials_may_judge() -> None:
    campaign = Problem(TRUE, trial(), free="X_uu", hold_out=[trial("slow", 300.0)], joint=False)
    assert campaign.stages[0].trials == ("straight",)
    assert campaign.held_out("slow").all()
    assert campaign.joint is None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"free": "X_xx"}, "has no coefficient 'X_xx'"),
        ({"free": "X_uu", "start": {"X_u": -3.0}}, "start: 'X_u' is not free"),
        ({"free": "X_uu", "hold_out": 1.5}, "expected a share from 0 to below 1"),
        ({"free": "X_uu", "hold_out": [trial()]}, "'straight' is fitted and held out"),
        ({"free": "X_uu", "channels": ["speed"]}, "unknown channel 'speed'"),
    ],
)
def test_messages_name_what_is_wrong(options: dict[str, object], message: str) -> None:
    with pytest.raises(st.CampaignError, match=message):
        Problem(TRUE, trial(), **options)  # type: ignore[arg-type]


def test_trials_of_one_name_are_refused() -> None:
    with pytest.raises(st.CampaignError, match="two trials are named 'straight'"):
        st.identify(TRUE, [trial(), trial()], free="X_uu")


def test_a_campaign_takes_no_further_request(fit: st.Identification) -> None:
    with pytest.raises(st.CampaignError, match="free: the problem says that"):
        st.identify(fit.problem, free="X_uu")  # type: ignore[call-overload]
    with pytest.raises(st.CampaignError, match="its trials and free="):
        st.identify(TRUE)  # type: ignore[call-overload]


def test_results_are_saved_pickled_and_copied(fit: st.Identification, tmp_path: Path) -> None:
    fit.save(tmp_path / "run")
    known = st.Fitted.of(tmp_path / "run")
    np.testing.assert_array_equal(known.covariance, st.Fitted.of(fit).covariance)
    score = st.score(fit.vehicle, trial())
    compared = st.compare({"start": START, "fit": fit.vehicle}, trial())
    for one in (fit, known, score, compared):
        for other in (pickle.loads(pickle.dumps(one)), copy.deepcopy(one)):
            assert type(other) is type(one)
    other = pickle.loads(pickle.dumps(fit))
    assert other.to_dict() == fit.to_dict()
    assert other.summary() == fit.summary()
    assert pickle.loads(pickle.dumps(score)).to_dict() == score.to_dict()
    assert pickle.loads(pickle.dumps(compared)).to_dict() == compared.to_dict()
    assert pickle.loads(pickle.dumps(known)).draws(3, 1).keys() == known.draws(3, 1).keys()


@pytest.fixture(scope="module")
def early() -> st.Identification:
    """A fit of a vehicle whose file lacks 0.1 s of dead time, and not the same for every propeller."""
    dead = {f"{name}.T_t": 0.02 if name == "PL" else 0.0 for name in ("SbU", "SbL", "PU", "PL")}
    start = START.with_coefficients(dead)
    noisy = trial()
    noise = 1e-3 * np.random.default_rng(1).standard_normal(noisy.observed.shape)
    noisy = replace(noisy, observed=noisy.observed + noise)
    return st.identify(
        start, noisy, free={"X_uu": (-40.0, -1.0), "X_udot": (-40.0, -1.0)}, work=st.Work(threads=1)
    )


def test_a_missed_dead_time_of_a_group_with_unequal_values_is_named(early: st.Identification) -> None:
    assert early.assessment is not None
    first = early.assessment.residual_analysis.suggestions[0]
    assert first.name in ("stern.T_t", "stern.T_1")
    assert first.value > 0.05
    assert f"Free {first.name}" in early.summary()


def test_a_response_faster_than_the_file_heads_the_summary_as_such(early: st.Identification) -> None:
    assert early.assessment is not None
    analysis = early.assessment.residual_analysis
    faster = replace(analysis.suggestions[0], name="stern.T_1", present=0.4, value=0.0)
    assessment = replace(early.assessment, residual_analysis=replace(analysis, suggestions=(faster,)))
    said = replace(early, assessment=assessment).summary()
    assert "the actuator responds faster than the file says" in said
    assert "Lower stern.T_1 from 0.4 s (0 at least)" in said
    assert "ree stern.T_1" not in said


NUISANCE = """
format = 1
name = "cwolf"
vehicle = "cwolf"
trials.straight = { file = "straight.csv", hold_out_s = [[47.92, 60.0]] }
polish = { nuisances = { latency_u = 0.02 } }
[[stages]]
name = "all"
trials = ["straight"]
axes = { free = "X", measured = "YZKMN" }
coefficients = { X_uu = [-40.0, -1.0] }
"""


def test_a_nuisance_far_from_its_prior_heads_the_summary() -> None:
    shifted = trial()
    late = shifted.observed.copy()
    late[3:, 0] = late[:-3, 0]  # 0.3 s, fifteen deviations of the prior
    fit = st.Campaign.from_toml(
        NUISANCE, trials={"straight": replace(shifted, observed=late)}, vehicle=START
    ).identify(work=st.Work(threads=1))
    assert fit.assessment is not None
    (row,) = fit.assessment.nuisances()
    assert row["prior_sd"] == 0.02
    assert row["away"] == pytest.approx(row["estimate"] / 0.02)
    assert row["away"] > 3.0
    worst = fit.summary().splitlines()[1]
    assert (
        f"latency_u of all trials is {row['estimate']:.3g} s, {row['away']:.2g} standard deviations" in worst
    )
    assert "Compare the clock of this channel" in fit.summary().splitlines()[2]
    assert fit.assessment.to_dict()["nuisances"][0]["away"] == row["away"]


PRIORS = NUISANCE.replace("polish = { nuisances = { latency_u = 0.02 } }", "polish = {}").replace(
    "X_uu = [-40.0, -1.0] }",
    "X_uu = { bounds = [-40.0, -1.0], start = -38.0, sd = 0.5 },"
    " X_u = { bounds = [-20.0, 0.0], start = -1.0, sd = 0.01 } }",
)


def test_the_table_says_what_data_and_what_priors_tell_and_what_contradicts() -> None:
    fit = st.Campaign.from_toml(PRIORS, trials={"straight": trial()}, vehicle=START).identify(
        work=st.Work(threads=1)
    )
    rows = {row.name: row for row in fit.coefficients}
    quadratic, linear = rows["X_uu"], rows["X_u"]
    assert quadratic.prior == (-38.0, 0.5)
    assert quadratic.contradiction > 3.0
    assert linear.told is not None
    assert linear.told > 0.5
    assert linear.verdict != "identifiable"
    assert replace(quadratic, estimate=-38.2).contradiction == 0.0
    text = " ".join(fit.report().text(verbose=True).split())
    assert f"prior ({linear.told:.2f})" in text
    assert "standard deviations from what was known beforehand (-38 ± 0.5 N s2/m2)" in text


def test_replayed_axes_are_named_with_the_scores(fit: st.Identification) -> None:
    said = fit.report().text(verbose=True)
    replayed = "sway, heave, roll, pitch, yaw replayed, not predicted"
    assert f"Held-out data (straight; {replayed}" in said
    assert f"Scores of every trial; {replayed}" in said
    assert fit.to_dict()["replayed"] == list("YZKMN")


def test_impossible_vehicles_are_said_in_the_first_line(fit: st.Identification) -> None:
    known = fit.covariance
    assert known is not None
    wide = replace(known, matrix=known.matrix * 0.0 + known.at**2)
    wide_fit = Fitted(fit.vehicle, wide.names, wide.matrix)
    first = replace(fit, doubt=wide_fit.doubt()).summary().splitlines()[0]
    assert "% of the vehicles drawn from the standard deviations are physically impossible" in first
    assert "most often by X_uu, whose standard deviation is too large for its value" in first
    assert fit.doubt == fit.to_dict()["doubt"] == ""


SHORT = """
format = 1
name = "cwolf"
vehicle = "cwolf"
trials = { straight = { file = "straight.csv" }, short = { file = "short.csv" } }
budget = { generations = 20, simplex_rounds = 10 }
[[stages]]
name = "surge"
trials = ["straight"]
axes = { free = "X", measured = "YZKMN" }
coefficients = { X_uu = [-40.0, -1.0] }
[[stages]]
name = "heave"
trials = ["short"]
axes = { free = "Z", measured = "XYKMN" }
segment_s = 4.0
coefficients = { Z_ww = [-900.0, -100.0] }
"""


def test_one_short_trial_costs_only_its_own_standard_deviations() -> None:
    # 15 s, and the joint estimate cuts into 20 s.
    trials = {"straight": trial(), "short": trial("short", samples=150)}
    fit = st.Campaign.from_toml(SHORT, trials=trials, vehicle=START).identify(work=st.Work(threads=1))
    assert fit.sigma["X_uu"] > 0.0
    assert "Z_ww" not in fit.sigma
    (said,) = (note for note in fit.notes if "left out" in note)
    assert said.startswith("trial short is left out of the standard deviations, and there is none for Z_ww")
    assert "A trial needs at least 20 s (segment_s) in one piece" in said
    assert said in fit.before


def test_a_campaign_is_identified_by_its_own_method(fit: st.Identification) -> None:
    campaign = st.Campaign.from_toml(fit.problem.text, trials={"straight": trial()}, vehicle=START)
    with pytest.raises(st.CampaignError, match=r"use campaign\.identify\("):
        st.identify(campaign)  # type: ignore[call-overload]


def test_a_problem_of_a_table_in_three_lines(fit: st.Identification) -> None:
    commands = {f"cmd.{actuator}": 500.0 + 300.0 * np.sign(np.sin(0.2 * T)) for actuator in TRUE.actuators}
    run = TRUE.simulate(T, {name.removeprefix("cmd."): signal for name, signal in commands.items()})
    table = {"t_s": T, "u_m_s": run.nu[:, 0]} | commands
    for frame in (table, pl.DataFrame(table), pytest.importorskip("pandas").DataFrame(table)):
        problem = st.Problem(START, frame, free={"X_uu": (-40.0, -1.0)}, seed=3)
        assert list(problem.trials) == ["trial"]
        assert problem.stages[0].axes.free == "X"
    again = problem.identify(work=st.Work(threads=1))
    assert again.vehicle.coefficients()["X_uu"] == pytest.approx(TRUE.coefficients()["X_uu"], rel=1e-2)
    two = st.Problem(START, [pl.DataFrame(table), pl.DataFrame(table)], free="X_uu")
    assert list(two.trials) == ["trial 1", "trial 2"]


def test_the_text_of_a_problem_states_what_was_asked(fit: st.Identification) -> None:
    asked = st.Problem(
        START,
        [trial(), trial("slow", 300.0)],
        free={"X_uu": (-40.0, -1.0), "X_u": None},
        start={"X_uu": -9.0},
        hold_out=[trial("other", 400.0)],
        channels={"u": 2.0},
        joint=st.JointSettings(rounds=7),
        anchor=st.Anchor.model_validate({"dry_mass": {"mass_kg": 42.0}}),
    )
    trials = {name: asked.trials[name] for name in asked.trials}
    again = st.Campaign.from_toml(asked.text, trials=trials, vehicle=START).problem()
    assert again.described() == asked.described()


def test_an_attribute_that_a_problem_has_not_is_named(fit: st.Identification) -> None:
    asked = fit.problem
    known: dict[str, Any] = {
        "vehicle": asked.vehicle,
        "trials": asked.trials,
        "uses": asked.uses,
        "stages": asked.stages,
    }
    assert st.Problem.of(**known, joint=asked.joint, seed=3).described()["seed"] == 3
    with pytest.raises(st.CampaignError, match=r'unknown attribute .sead.; did you mean "seed"'):
        st.Problem.of(**known, sead=3)


def test_variants_leave_the_problem_as_it_was(fit: st.Identification) -> None:
    asked = fit.problem
    before = asked.described()
    assert asked.without_coefficients(["X_uu"]).stages == ()
    other = asked.with_uses({"straight": st.TrialUse(hold_out_s=((0.0, 5.0),))})
    assert other.held_out("straight").sum() == 50
    with pytest.raises(AttributeError, match="seed: a problem does not change"):
        asked.seed = 4
    assert asked.described() == before
    assert asked.part("straight", held_out=True) is not other.part("straight", held_out=True)


def test_a_table_may_judge_and_one_without_time_is_refused_as_a_table() -> None:
    table = {"t_s": T, "u_m_s": np.sin(0.1 * T)} | {
        f"cmd.{name}": 500.0 * np.cos(T) for name in TRUE.actuators
    }
    asked = st.Problem(TRUE, table, free="X_uu", hold_out=table)
    assert [asked.uses[name].hold_out for name in ("trial", "judging")] == [False, True]
    assert list(st.Problem(TRUE, {"a": table, "b": pl.DataFrame(table)}, free="X_uu").trials) == ["a", "b"]
    with pytest.raises(st.TrialError, match="t_s"):
        st.Problem(TRUE, {name: values for name, values in table.items() if name != "t_s"}, free="X_uu")
    with pytest.raises(st.CampaignError, match="expected a trial or several, found none"):
        st.Problem(TRUE, [], free="X_uu")
    for wrong in (5, [table, 5]):
        with pytest.raises(st.CampaignError, match="expected a trial, a table, a file"):
            st.Problem(TRUE, wrong, free="X_uu")


def test_what_was_judged_of_a_trial_goes_with_it() -> None:
    trials = [trial(), trial("slow", 300.0)]
    asked = st.Problem(START, trials, free="X_uu")
    assert list(asked.limits()) == ["straight", "slow"]
    rest, _ = asked.without_trial("slow")
    assert list(rest.limits()) == ["straight"]
    judged = asked.verdicts("slow")
    other = asked.with_trials({"straight": trials[0], "slow": trial("slow", 900.0)})
    assert other.verdicts("slow") is not judged
    assert asked.verdicts("slow") is judged
