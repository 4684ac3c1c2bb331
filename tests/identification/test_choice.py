"""Stages against the joint estimate outside the fit: which is the result, and what is said of the other."""

from __future__ import annotations

from functools import cache

import numpy as np
import polars as pl
import pytest

from seatrial._core import State, Vehicle
from seatrial.base.work import Work
from seatrial.campaign.campaign import Campaign
from seatrial.estimation.joint import Joint
from seatrial.estimation.joint_estimate import polish
from seatrial.identification.identification import Identification
from seatrial.problem.problem import Problem

TRUTH = {"X_uu": -13.0, "N_rr": -180.0, "N_rdot": -75.0}

HEAD = """
format = 1
name = "made"
vehicle = "cwolf"
budget = { generations = 20, simplex_rounds = 10 }
[trials.turn]
file = "turn.parquet"
[trials.leg]
file = "leg.parquet"
[[stages]]
name = "surge"
trials = ["leg"]
axes = { free = "X", measured = "YN" }
[stages.coefficients]
X_uu = [-30.0, -4.0]
[[stages]]
name = "yaw"
trials = ["turn"]
axes = { free = "N", measured = "XY" }
[stages.coefficients]
N_rr = [-3000.0, -40.0]
N_rdot = [-800.0, -7.0]
[polish]
segment_s = 15.0
"""
HELD_OUT = HEAD.replace('"turn.parquet"', '"turn.parquet"\nhold_out_s = [[90.0, 120.0]]')


@cache
def recordings(*, waves: bool) -> dict[str, pl.DataFrame]:
    """Turning circles in still water, and a leg on which a controller answers the yaw moment of the waves.

    Its thrust cancels the waves, so that the commands turn and the vehicle does not: to a model without waves
    the actuators seem weak and the damping strong.
    """
    generator = np.random.default_rng(5)
    vehicle = Vehicle.load("cwolf").with_coefficients(TRUTH)
    found = {}
    for name, length in (("turn", 120.0), ("leg", 240.0)):
        t = np.arange(0.0, length, 0.1)
        level = np.repeat(generator.uniform(500.0, 1400.0, len(t) // 100), 100)
        steps = np.repeat(generator.uniform(-500.0, 500.0, len(t) // 50), 50)
        wave = 400.0 * np.sin(2 * np.pi * t / 6.0) + 300.0 * np.sin(2 * np.pi * t / 7.3)
        answered = waves and name == "leg"
        turn = wave if answered else steps
        commands = {"SbU": level - turn, "SbL": level - turn, "PU": level + turn, "PL": level + turn}
        commands |= {"VTB": np.zeros(len(t)), "VTS": np.zeros(len(t))}
        free = "X" if answered else "XN"
        run = vehicle.simulate(t, commands, State(), free=free, max_step_s=0.02)
        u, r = np.asarray(run.nu)[:, 0], np.asarray(run.nu)[:, 5]
        found[name] = pl.DataFrame({
            "t_s": t,
            "u_m_s": u + generator.normal(0.0, 0.01, len(t)),
            "v_m_s": generator.normal(0.0, 0.002, len(t)),
            "r_deg_s": np.rad2deg(r + generator.normal(0.0, 0.002, len(t))),
            **{f"cmd.{actuator}": command for actuator, command in commands.items()},
        })
    return found


@cache
def identified(text: str, *, waves: bool) -> Identification:
    return Campaign.from_toml(text, source="made.toml", trials=recordings(waves=waves)).identify(
        work=Work(threads=2)
    )


@pytest.mark.long
@pytest.mark.parametrize(("text", "words"), [(HELD_OUT, "held-out data"), (HEAD, "last 20 % of every trial")])
def test_a_joint_estimate_that_predicts_worse_is_not_the_result(text: str, words: str) -> None:
    fit = identified(text, waves=True)
    assert fit.choice is not None
    assert fit.choice.result == "stages"
    assert words in fit.choice.judged_on
    assert fit.choice.stages["r"] > 0.95
    assert fit.choice.joint["r"] < fit.choice.stages["r"] - 0.1
    assert fit.vehicle.coefficients() == fit.stages_vehicle.coefficients()
    # The coefficients have their deviations all the same, and the summary says first what happened.
    assert all(row.sigma is not None for row in fit.coefficients)
    assert "joint estimate predicts worse outside its fit" in fit.summary().split("\n")[0]
    assert fit.choice.sentence() in fit.summary()
    assert f"r {fit.choice.stages['r']:.2f} to {fit.choice.joint['r']:.2f}" in fit.choice.sentence()
    assert fit.to_dict()["choice"]["result"] == "stages"


def test_the_held_out_score_of_the_result_is_that_of_the_better_one() -> None:
    fit = identified(HELD_OUT, waves=True)
    assert fit.choice is not None
    assert fit.scores["hold_out"]["ahead"]["turn"]["r"].r2 == pytest.approx(fit.choice.stages["r"], abs=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("text", [HELD_OUT, HEAD])
def test_a_joint_estimate_of_the_right_model_is_the_result(text: str) -> None:
    fit = identified(text, waves=False)
    assert fit.choice is not None
    assert fit.choice.result == "joint estimate"
    assert fit.choice.polished.converged
    found = fit.vehicle.coefficients()
    assert {name: found[name] for name in TRUTH} == pytest.approx(TRUTH, rel=0.05)


def test_a_joint_estimate_without_convergence_heads_the_summary() -> None:
    # One round from the stages' optimum moves by more than a third of a standard deviation.
    fit = identified(HELD_OUT + "rounds = 1\n", waves=True)
    assert fit.choice is not None
    assert not fit.choice.polished.converged
    assert "did not converge in 1 round" in fit.summary().split("\n")[0]


def test_the_cost_of_a_joint_estimate_never_rises_with_its_rounds() -> None:
    campaign = Campaign.from_toml(HEAD, source="made.toml", trials=recordings(waves=True))
    joint = Joint(campaign.problem(), threads=2)
    found = [polish(joint, rounds=rounds) for rounds in range(5)]
    costs = [float(one.costs.min()) for one in found]
    assert costs == sorted(costs, reverse=True)
    assert all(one.cost <= one.start_cost for one in found)


@pytest.mark.long
def test_more_coefficients_do_not_end_at_a_higher_cost() -> None:
    data = recordings(waves=True)
    free = "{ bounds = [-300.0, 300.0] }"
    extra = f'[polish.coefficients]\nN_ur = {free}\nX_rr = {free}\n"stern.gain" = [0.2, 2.0]\n'
    costs = []
    for text in (HEAD, HEAD + extra):
        campaign = Campaign.from_toml(text, source="made.toml", trials=data)
        costs.append(float(polish(Joint(campaign.problem(), threads=2)).costs.min()))
    assert costs[1] <= costs[0]


GAINS = "[polish.coefficients]\n" + "".join(
    f'"{name}.gain" = {{ bounds = [0.5, 1.5], sd = 0.1 }}\n' for name in ("SbU", "SbL", "PU", "PL")
)


@pytest.mark.long
def test_gains_with_a_prior_stay_in_a_joint_estimate_that_predicts_with_them() -> None:
    fit = identified(HELD_OUT + GAINS, waves=False)
    gains = {row.name: row for row in fit.coefficients if row.name.endswith(".gain")}
    assert len(gains) == 4
    # Two thrusters of a side push in one line: their difference is told by the prior alone.
    for row in gains.values():
        assert abs(row.estimate - 1.0) < 0.1
        assert row.sigma is not None
        assert 0.03 < row.sigma < 0.13
    assert np.mean([row.estimate for row in gains.values()]) == pytest.approx(1.0, abs=0.05)


@pytest.mark.long
def test_gains_with_a_prior_leave_a_joint_estimate_that_predicts_worse_with_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def outside(problem: Problem, *_: object) -> tuple[object, ...]:
        freed = problem.joint is not None and problem.joint.coefficients
        return "held-out", {"r": 0.3}, {"r": 0.2 if freed else 0.1}, {}

    monkeypatch.setattr("seatrial.identification.choice._outside", outside)
    campaign = Campaign.from_toml(HELD_OUT + GAINS, source="made.toml", trials=recordings(waves=False))
    fit = campaign.identify(work=Work(threads=2))
    assert not [row.name for row in fit.coefficients if row.name.endswith(".gain")]
    assert any(note.startswith("SbU.gain, SbL.gain, PU.gain, PL.gain stay at") for note in fit.notes)
    assert any("(R2 r 0.90 to 0.80 when freed)" in note for note in fit.notes)


def test_a_tight_prior_holds_a_coefficient_that_the_data_would_move() -> None:
    free = Campaign.from_toml(HEAD, source="made.toml", trials=recordings(waves=False))
    held = HEAD + "[polish.coefficients]\nN_rr = { bounds = [-3000.0, -40.0], start = -150.0, sd = 0.01 }\n"
    tight = Campaign.from_toml(held, source="made.toml", trials=recordings(waves=False))
    found = {}
    for name, campaign in (("free", free), ("tight", tight)):
        joint = Joint(campaign.problem(), threads=2)
        values = polish(joint).values
        found[name] = joint.coefficients(values)["N_rr"]
    assert found["free"] == pytest.approx(TRUTH["N_rr"], rel=0.05)
    assert found["tight"] == pytest.approx(-150.0, rel=0.01)
