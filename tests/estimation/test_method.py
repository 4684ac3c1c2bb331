"""A joint estimate takes the filter where commands answer waves, and a simulation elsewhere."""

from __future__ import annotations

from dataclasses import replace

import pytest

from seatrial.campaign.campaign import Campaign
from seatrial.estimation.estimator import method_of
from seatrial.estimation.joint import Joint
from seatrial.estimation.joint_estimate import polish
from seatrial.identification.choice import choose
from tests.inspect.test_verdict import sailed

TEXT = """
format = 1
name = "made"
vehicle = "remus100"
[trials.log]
file = "log.csv"
input = "commands"
{keys}
[[stages]]
name = "yaw"
trials = ["log"]
axes = {{ free = "N" }}
channels = {{ r = 1.0 }}
[stages.coefficients]
N_rr = [-900.0, -1.0]
{joint}
"""
AUTOMATIC = '[joint]\nmethod = "automatic"'


def campaign(*, closed: bool = True, waves: float = 0.02, keys: str = "", joint: str = AUTOMATIC) -> Campaign:
    log = sailed(1, turns=True, closed=closed, waves=waves)
    return Campaign.from_toml(
        TEXT.format(keys=keys, joint=joint), source="made.toml", trials={"log": log, "steps": log}
    )


def test_commands_that_answer_waves_call_for_a_filter() -> None:
    found = method_of(campaign().problem(), ["log"])
    assert found.method == "innovations"
    assert found.why.startswith("in trial log feedback drives rudder_upper, rudder_lower, in waves of")


@pytest.mark.parametrize(
    ("closed", "waves", "joint"), [(False, 0.02, AUTOMATIC), (True, 0.0, "[joint]"), (True, 0.02, "")]
)
def test_open_loops_turns_in_calm_water_and_deviations_alone_take_a_simulation(
    closed: bool, waves: float, joint: str
) -> None:
    found = method_of(campaign(closed=closed, waves=waves, joint=joint).problem(), ["log"])
    assert (found.method, found.why) == ("output", "")


def test_a_calm_loop_calls_for_a_filter_unless_another_trial_is_open() -> None:
    calm = campaign(waves=0.0, keys='[trials.steps]\nfile = "steps.csv"\ninput = "commands"')
    told = calm.problem().verdicts("log")["N"]
    calm.problem()._verdicts["log"] = {"N": replace(told, told=0.3)}
    found = method_of(calm.problem(), ["log"])
    assert found.method == "innovations"
    assert found.why == (
        "feedback drives rudder_upper, rudder_lower in every trial, and commands independent of"
        " feedback drive only 30 % of an axis' motion"
    )
    calm.problem()._verdicts["steps"] = {"N": replace(told, kind="open")}
    assert method_of(calm.problem(), ["log", "steps"]).method == "output"


def test_a_campaign_that_asks_has_its_way_and_hears_what_speaks_against_it() -> None:
    told = method_of(campaign(joint='[joint]\nmethod = "output"').problem(), ["log"])
    assert told.method == "output"
    assert told.why.endswith('which biases gains: compare with method = "innovations"')
    asked = method_of(campaign(closed=False, joint='[joint]\nmethod = "innovations"').problem(), ["log"])
    assert (asked.method, asked.why) == ("innovations", "the campaign asks for it")


def test_nuisance_parameters_keep_a_simulation_and_say_so() -> None:
    found = method_of(
        campaign(joint=AUTOMATIC + '\n[joint.nuisances]\nlatency_r = "default"').problem(), ["log"]
    )
    assert found.method == "output"
    assert "cannot estimate latency_r" in found.why


@pytest.mark.long
def test_stages_and_joint_estimate_are_compared_from_the_state_of_a_filter() -> None:
    one = campaign(keys="hold_out_s = [[400.0, 600.0]]")
    joint = Joint(one.problem())
    assert joint.method == "innovations"
    good = polish(joint, rounds=2)
    found = choose(one.problem(), joint, good, stages=())
    assert found.ahead_s == 0.5
    assert "0.5 s ahead from the state of a filter" in found.judged_on
    assert found.result == "joint estimate"
    assert found.joint["r"] > found.stages["r"] - 0.01
    unfit = joint.start.copy()
    unfit[:] = joint.unknowns[0].lower
    joint.start, worse = good.values, unfit
    again = choose(one.problem(), joint, type(good)(**{**vars(good), "values": worse}), stages=())
    assert again.result == "stages"
    assert again.joint["r"] < again.stages["r"]
