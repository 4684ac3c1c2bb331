"""Lookahead and integral of guidance for tuned loops: near 2 U tau, damped, and written to the autopilot."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import seatrial as st
from seatrial.control_design.tuning_table import TuningTable
from seatrial.identification.fitted import Fitted
from seatrial.report.results.tuning import sentences
from seatrial.tuning.control_problem import ControlProblem
from seatrial.tuning.loop_steps import GUIDANCE, course_lookahead, path_trials, search_paths
from seatrial.tuning.step_trial import Samples
from seatrial.tuning.tuning_run import tune
from tests.tuning.tuning_campaigns import HEADING, campaign, plan

FAR_M = 51.0
"""A lookahead that suits far slower loops than those of any built-in vehicle."""

LEG = """
format = 1
name = "leg"
speed_m_s = {speed}
acceptance_radius_m = 5.0
start = {{ north_m = 0.0, east_m = 8.0, depth_m = 20.0, heading_deg = 0.0 }}
[[legs]]
north_m = 0.1
east_m = 0.0
depth_m = 20.0
[[legs]]
north_m = 200.0
east_m = 0.0
depth_m = 20.0
"""


@cache
def made(name: str, lookahead_m: float | None = None) -> ControlProblem:
    autopilot = st.Autopilot.load(name)
    if lookahead_m is not None:
        autopilot = autopilot.with_gains({"guidance.lookahead_m": lookahead_m})
    return ControlProblem.of_table(TuningTable(voltage_v=16.0, samples=0), Fitted.of(name), autopilot)


def rig(of: ControlProblem) -> Any:
    return of.rig(of.autopilot, max_step_s=0.04)


@pytest.mark.parametrize("name", ["cwolf", "remus100", "bluerov2-heavy"])
def test_the_lookahead_of_every_built_in_vehicle_goes_with_its_loops(name: str) -> None:
    one = made(name, FAR_M)
    paths = ("cross_track", "depth") if "pitch" in one.loops else ("cross_track",)
    assert set(one.followed) == set(paths)
    found = search_paths(one, rig(one), ("cross_track",), seed=3)
    distance, speed, tau = course_lookahead(one, one.autopilot, "cross_track")
    chosen = found.gains["guidance.lookahead_m"]
    assert 0.4 * distance <= chosen <= 2.0 * distance
    assert found.gains["guidance.integral_gain_m_s"] == pytest.approx(0.25 * speed)
    assert found.after["time"] < 0.6 * found.before["time"]
    # The vehicle itself in still water: no step swings more than 45 % over, where the search bounds 30 %.
    guided = one.rig(one.autopilot.with_gains(dict(found.gains)), max_step_s=0.04)
    trials = path_trials(one, "cross_track", distance, tau)
    t, answers = guided.responses(trials, Samples({}, np.zeros((1, 3)), (1,)), {})
    there = (t > trials.settle_s) & (t < trials.settle_s + trials.until_s)
    for trial, size in enumerate(trials.sizes):
        assert (answers["y"][trial, 0, there] / size).max() < 1.45, (name, trial)


def test_numbers_of_the_file_stay_where_they_are_as_good() -> None:
    one = made("remus100")
    found = search_paths(one, rig(one), ("depth",), seed=3)
    cost = {
        name: 10.0 * at["violation"] + at["time"] for name, at in vars(found).items() if "time" in str(at)
    }
    assert cost["after"] <= 1.05 * cost["before"]


def test_a_path_that_is_searched_with_its_loop_is_left_to_it_within_reach_of_what_fits() -> None:
    text = HEADING + "[tuning.loops.cross_track]\nsteps = [3.0]\nspeeds_m_s = [1.5]\n"
    one = plan(text)
    assert one.followed == ()
    table = TuningTable.model_validate({"loops": {"heading": {}, "cross_track": {}}})
    far = ControlProblem.of_table(table, Fitted.of("cwolf"), made("cwolf", FAR_M).autopilot)
    (group,) = far.groups
    (lookahead,) = (p for p in group.parameters.parameters if p.name == GUIDANCE["cross_track"][0])
    fits = course_lookahead(far, far.autopilot, "cross_track")[0]
    assert FAR_M * lookahead.lower < 0.6 * fits < FAR_M * lookahead.upper


def test_a_tuning_writes_the_lookahead_and_a_leg_is_joined_sooner() -> None:
    start = made("cwolf", FAR_M).autopilot
    loops = {"heading": {"steps": [20.0], "speeds_m_s": [1.5], "corridor": {"rise_s": 8.0}}}
    none = {"phase_deg": 0.0, "gain_db": 0.0, "delay_s": 0.0}
    budget = {"population": 8, "generations": 1, "simplex_rounds": 1}
    settings = {"samples": 0, "settle_s": 6.0, "budget": budget, "margins": none}
    found = tune("cwolf", start, loops=loops, settings=settings, work=st.Work(threads=1))
    assert [group.name for group in found.groups][-1] == "guidance"
    tuned = found.autopilot.gains()["guidance.lookahead_m"]
    assert tuned < 0.6 * FAR_M
    assert any(f"lookahead_m {tuned:.4g}, before 51" in line for line in sentences(found))
    mission = st.Mission.from_toml(LEG.format(speed=1.5))
    error = {
        name: st.fly("cwolf", autopilot, mission, water=st.Water(current=(0.0, 0.15, 0.0))).metrics[
            "cross_track_rms_m"
        ]
        for name, autopilot in (("start", start), ("tuned", found.autopilot))
    }
    assert error["tuned"] < 0.7 * error["start"]


def test_a_campaign_without_heading_leaves_guidance_alone() -> None:
    text = HEADING.replace("tuning.loops.heading", "tuning.loops.surge").replace(
        "steps = [20.0]", "steps = [-0.3]"
    )
    assert plan(text).followed == ()
    assert campaign(text) is not None
