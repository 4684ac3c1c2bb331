"""What a tuning does before it is done: speeds, groups, default steps and corridors, samples, refusals."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
import tomlkit

import seatrial as st
from seatrial.base.errors import CampaignError
from seatrial.control_design.operating_points import autopilot_facts, reachable_points
from seatrial.control_design.tuning_table import LOOPS, TuningTable, Weights, default_steps
from seatrial.identification.fitted import Fitted
from seatrial.tuning.control_problem import ControlProblem
from seatrial.tuning.criterion import StartMetrics, default_corridor, start_metrics, steps_above_noise
from tests.tuning.tuning_campaigns import HEAD, plan, start

VEHICLES = ("cwolf", "bluerov2-heavy", "lauv", "remus100", "beluga")
SHORT = {"rise_s": 5.0, "until_s": 20.0}


@cache
def built_in(name: str) -> ControlProblem:
    # Supply of the BlueROV2's thrusters, on which the others do not depend.
    return ControlProblem.of_table(TuningTable(voltage_v=16.0), Fitted.of(name), st.Autopilot.load(name))


def with_loops(name: str = "cwolf", autopilot: st.Autopilot | None = None, **table: Any) -> ControlProblem:
    pilot = st.Autopilot.load(name) if autopilot is None else autopilot
    return ControlProblem.of_table(TuningTable.model_validate(table), Fitted.of(name), pilot)


def to_si(loop: str) -> float:
    return LOOPS[loop].to_si


def changed(name: str, change: Callable[[Any], None]) -> st.Autopilot:
    text = tomlkit.parse(st.Autopilot.load(name).to_toml())
    change(text)
    return st.Autopilot.from_toml(tomlkit.dumps(text))


@pytest.mark.long
@pytest.mark.parametrize("name", VEHICLES)
def test_a_vehicle_is_tuned_at_the_points_that_it_reaches(name: str) -> None:
    one = built_in(name)
    points = np.array(one.autopilot.speeds_m_s)
    np.testing.assert_array_equal(one.reached, reachable_points(one.vehicle, one.autopilot))
    assert one.places == np.flatnonzero(one.reached).tolist()
    # Heading works in every mode: slow, fast and between. A step of the speed has to be within reach as well,
    # against the current too.
    heading = one.trials("heading").speeds
    assert len(heading) == 3
    assert np.abs(np.array(heading)[:, None] - points[one.reached]).min(axis=1).max() < 1e-6
    assert max(heading) == pytest.approx(points[one.reached].max())
    surge = one.trials("surge")
    ends = np.array(surge.speeds) + np.array(surge.sizes)
    assert (np.maximum(ends, surge.speeds) <= 0.95 * one.top_m_s - one.current_m_s + 1e-6).all()
    assert one.current_m_s == pytest.approx(0.05 * one.top_m_s)
    for group in one.groups:
        assert len(group.parameters) > 0
        for trials in group.trials:
            assert max(trials.speeds) <= one.top_m_s
            assert len(trials.speeds) == len(trials.sizes) <= 3
            assert np.diff(trials.speeds).min() >= 0.5 * np.diff(points).mean() - 1e-6


@pytest.mark.parametrize("name", VEHICLES)
def test_default_corridors_are_what_a_vehicle_of_that_size_can_keep_to(name: str) -> None:
    one = built_in(name)
    for group in one.groups:
        for trials in group.trials:
            corridor = trials.corridor
            rise = next(time for time, value in corridor.lower if value >= 0.9)
            # From a nimble hull of half a metre to a long one that climbs by its fins.
            assert 2.0 <= rise <= 60.0
            assert 2.0 * rise <= corridor.until_s <= 8.0 * rise
            lower, upper = corridor.sampled([0.0, corridor.until_s])
            np.testing.assert_allclose(lower, [-0.1, 0.92], atol=0.021)
            assert upper[1] == pytest.approx(2.0 - lower[1])
            assert 1.15 <= upper[0] <= 1.3


@pytest.mark.parametrize("name", VEHICLES)
def test_a_default_band_has_room_for_the_noise_of_the_loop_at_rest(name: str) -> None:
    one = built_in(name)
    for group in one.groups:
        for trials in group.trials:
            noise = start_metrics(one.rig(one.autopilot, max_step_s=0.04), trials).noise
            least = min(abs(size) for size in trials.sizes)
            usual = default_steps(trials.loop, top_m_s=one.top_m_s)[0] * to_si(trials.loop)
            if least == pytest.approx(2.5 * usual, rel=0.01):
                continue  # as large as a step may become by itself
            # Five deviations; 40 % on top, since a larger step, with its longer settling, is other noise.
            assert 5.0 * noise <= 1.4 * trials.settled * least, trials.loop


def test_default_corridors_ask_for_a_little_less_than_the_start_gains_do() -> None:
    # Roll and hull of REMUS let its pitch overshoot beyond 15 %, whatever the limits of its fins say.
    one = built_in("remus100")
    trials = one.trials("pitch")
    figures = start_metrics(one.rig(one.autopilot, max_step_s=0.04), trials)
    overshoot = trials.corridor.sampled([0.0])[1][0] - 1.0
    assert overshoot == pytest.approx(0.95 * figures.overshoot, abs=0.02)
    # CWolf's surge keeps to what its limits allow: those decide.
    limits = default_corridor(
        built_in("cwolf").vehicle, start(), "surge", [0.4], weights=Weights(), start=None
    )
    still = StartMetrics(noise=0.0, rise_s=0.1, overshoot=0.01, settling_s=0.2)
    same = default_corridor(
        built_in("cwolf").vehicle, start(), "surge", [0.4], weights=Weights(), start=still
    )
    assert same == limits


@pytest.mark.parametrize(
    ("noise", "size"),
    # 5 x 0.008 m/s is 8 % of 0.5 m/s; at most 2.5 times the usual step.
    [(0.0, 0.3), (0.004, 0.3), (0.008, 0.5), (1.0, 0.75)],
)
def test_a_default_step_grows_with_the_noise_up_to_a_limit(noise: float, size: float) -> None:
    assert steps_above_noise("surge", noise, top_m_s=2.0) == pytest.approx((size, -size))


def test_top_speeds_are_those_of_the_supply() -> None:
    weak, strong = (
        ControlProblem.of_table(
            TuningTable(voltage_v=volt), Fitted.of("bluerov2-heavy"), st.Autopilot.load("bluerov2-heavy")
        )
        for volt in (10.0, 16.0)
    )
    assert weak.top_m_s < 0.8 * strong.top_m_s
    assert max(weak.speeds_of("surge")) < weak.top_m_s < max(strong.speeds_of("surge"))


def test_default_corridors_follow_the_size_of_the_step_and_the_force() -> None:
    def until(**table: Any) -> float:
        return with_loops(loops={"surge": table}).trials("surge").until_s

    assert until(steps=[0.2]) < until(steps=[0.8])
    weak = changed("cwolf", lambda text: text["loops"]["surge"].update(tau_max=30.0))
    assert with_loops(autopilot=weak, loops={"surge": {"steps": [0.2]}}).trials("surge").until_s > until(
        steps=[0.2]
    )


def test_the_built_in_autopilot_of_lauv_keeps_to_its_default_corridors_when_fast() -> None:
    one = with_loops("lauv", loops={"surge": {"speeds_m_s": [1.593]}, "pitch": {"speeds_m_s": [1.593]}})
    for loop in one.loops:
        # Start values for water at rest: neither needs half of the time that the corridor gives.
        sums, *_ = one.rig(one.autopilot, max_step_s=0.05).violations(
            one.trials(loop), one.samples(0, 1), {}, headroom=0.0
        )
        assert sums[..., :2].sum() == 0.0, loop


def test_a_loop_is_tried_where_a_mode_uses_it_and_beside_where_modes_change() -> None:
    one = built_in("cwolf")
    switch = 1.11
    away = one.current_m_s + 0.1
    assert max(one.trials("heave").speeds) == pytest.approx(switch - away)
    assert min(one.trials("pitch").speeds) == pytest.approx(switch + away)
    assert min(one.speeds_of("depth")) == pytest.approx(switch + away)
    assert min(one.speeds_of("cross_track")) > 0.0
    narrow = with_loops(current_m_s=0.0)
    assert narrow.autopilot.speeds_m_s[3] in narrow.trials("heave").speeds


def test_modes_beside_each_other_are_one_for_a_loop_that_both_use() -> None:
    one = built_in("cwolf")
    assert one.modes_of("surge") == [(-np.inf, np.inf)]
    assert one.modes_of("heave") == [(-np.inf, 1.11)]
    assert one.modes_of("pitch") == [(1.11, np.inf)]
    assert one.modes_of("depth") == [(1.11, np.inf)]
    assert one.modes_of("sway") == []
    assert built_in("bluerov2-heavy").modes_of("heave") == [(-np.inf, np.inf)]


def test_speeds_and_steps_of_the_file_are_taken() -> None:
    one = with_loops(
        settle_s=7.0, loops={"surge": {"steps": [0.4, -0.2], "speeds_m_s": [1.0, 2.0], "corridor": SHORT}}
    )
    trials = one.trials("surge")
    assert trials.speeds == (1.0, 1.0, 2.0, 2.0)
    assert trials.sizes == (0.4, -0.2, 0.4, -0.2)
    assert trials.duration_s == 7.0 + 2.0 * 20.0
    heading = with_loops(loops={"heading": {"steps": [20.0]}}).trials("heading")
    assert heading.sizes[0] == pytest.approx(np.deg2rad(20.0))


def test_a_speed_step_out_of_reach_is_left_out() -> None:
    one = with_loops(loops={"surge": {"steps": [0.4, -0.4], "speeds_m_s": [1.0, 3.0]}})
    # CWolf's top speed is 3.2 m/s.
    assert list(zip(one.trials("surge").speeds, one.trials("surge").sizes, strict=True)) == [
        (1.0, 0.4),
        (1.0, -0.4),
        (3.0, -0.4),
    ]


def test_interacting_loops_are_searched_together() -> None:
    one = plan(
        "[tuning.loops]\npitch = {}\ndepth = {}\nheading = {}\ncross_track = {}\nsurge = {}\nheave = {}"
    )
    groups = {group.name: group for group in one.groups}
    assert list(groups) == ["heave", "heading and cross_track", "surge", "pitch and depth"]
    assert "guidance.lookahead_vertical_m" in groups["pitch and depth"].parameters.names
    assert "guidance.lookahead_m" in groups["heading and cross_track"].parameters.names
    # Pitch levels the hull astern, where it is never stepped: it is set with heave there, and only there.
    assert any(name.startswith("pitch.K_P") for name in groups["heave"].parameters.names)
    every = [name for group in one.groups for part in group.parameters.parameters for name in part.starts]
    assert len(every) == len(set(every))


def test_the_path_alone_moves_the_loop_that_it_rides_on() -> None:
    (group,) = with_loops(loops={"depth": {"steps": [1.0]}}).groups
    assert group.name == "depth"
    assert {name.split(".")[0] for name in group.parameters.names} == {"pitch", "guidance"}


def test_samples_begin_with_the_vehicle_itself_in_still_water() -> None:
    fitted = Fitted.of("cwolf", percent={"X_uu": 10.0})
    one = ControlProblem.of_table(TuningTable(current_m_s=0.2), fitted, start())
    found = one.samples(12, 3)
    assert len(found) == 13
    assert found.coefficients["X_uu"][0] == fitted.vehicle.coefficients()["X_uu"]
    assert np.ptp(found.coefficients["X_uu"]) > 0.0
    np.testing.assert_array_equal(found.current[0], 0.0)
    np.testing.assert_allclose(np.linalg.norm(found.current[1:], axis=1), 0.2)
    # From all sides: no half of the compass is empty.
    bearing = np.sort(np.arctan2(found.current[1:, 1], found.current[1:, 0]))
    assert np.diff([*bearing, bearing[0] + 2.0 * np.pi]).max() < np.pi / 2.0
    assert len(set(found.seeds)) == 13
    again, other = one.samples(12, 3), one.samples(12, 4)
    np.testing.assert_array_equal(again.coefficients["X_uu"], found.coefficients["X_uu"])
    assert not set(other.seeds) & set(found.seeds)


def test_a_plan_is_plain_data_in_the_units_of_the_file() -> None:
    plain = json.loads(json.dumps(plan("[tuning.loops.heading]\nsteps = [20.0]").to_dict()))
    (group,) = plain["groups"]
    (trials,) = group["trials"]
    assert trials["unit"] == LOOPS["heading"].unit == "deg"
    assert trials["steps"] == pytest.approx([20.0] * len(trials["speeds_m_s"]))
    assert plain["reachable_speeds_m_s"] == pytest.approx([-1.0, 1.0, 3.0])


REFUSED = {
    "[tuning.loops.roll]": ["[tuning.loops.roll]", "the set point of roll does not move", "leave the table"],
    "[tuning.loops.sway]": ["[tuning.loops.sway]", "no mode of the autopilot cwolf start uses sway"],
    "[tuning.loops.surge]\ncorridor = { upper = [[0.0, 1.1], [0.35, 1.1]] }": [
        "at least 10 control periods, 1 s, found one that ends at 0.35 s"
    ],
    "[tuning.loops.pitch]\nsteps = [20.0]\nspeeds_m_s = [2.0]\ncorridor = { rise_s = 40.0 }": [
        "stay under water, 100 m deep",
        "climbs 109 m",
    ],
    "[tuning.loops.pitch]\nspeeds_m_s = [0.5]": [
        "a mode",
        "moves the set point of pitch, from 1",
        "found 0.5",
    ],
    "[tuning.loops.heave]\nspeeds_m_s = [3.0]": ["moves the set point of heave, below 1", "found 3"],
    "[tuning.loops.cross_track]\nspeeds_m_s = [0.0]": ["speeds above 0", "found 0"],
    "[tuning.loops.surge]\nsteps = [3.5]\nspeeds_m_s = [1.0]": [
        "[tuning.loops.surge]",
        "a step that the vehicle reaches, found none at 1 m/s",
        "smaller steps",
    ],
}


@pytest.mark.parametrize("text", REFUSED)
def test_what_cannot_be_tuned_is_refused_before_anything_is_flown(text: str) -> None:
    with pytest.raises(CampaignError) as caught:
        assert plan(text).groups
    said = str(caught.value)
    for words in REFUSED[text]:
        assert words in said, said


def test_a_loop_without_gains_is_refused_where_it_is_asked_for_and_left_out_where_not() -> None:
    def mute(text: Any) -> None:
        for key in ("K_P", "K_I_per_s", "K_D_s"):
            if key in text["loops"]["surge"]:
                text["loops"]["surge"][key] = [0.0] * 6
        text["loops"]["surge"].pop("reference_rad_s", None)

    still = changed("cwolf", mute)
    assert "surge" not in with_loops(autopilot=still).loops
    with pytest.raises(CampaignError, match=r"surge.*expected gains that a factor moves, found only zeros"):
        assert with_loops(autopilot=still, loops={"surge": {"steps": [0.2]}}).groups


def test_a_vehicle_with_other_actuators_is_refused() -> None:
    campaign = st.Campaign.from_toml(HEAD, source="small.toml")
    with pytest.raises(CampaignError, match=r"small\.toml: expected a fit of cwolf, found one of lauv"):
        campaign.control_problem("lauv")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[tuning]\nsensors = "tipical"\n', "key sensors: .*tipical"),
        ("[tuning]\ncurrent_m_s = 50.0\n", "key current_m_s: expected less than the top speed"),
        ("[tuning.loops.heading]\nspeeds_m_s = [9.0]\n", "heading.*expected speeds that cwolf reaches"),
    ],
)
def test_what_no_flight_could_do_is_refused_with_its_key(text: str, message: str) -> None:
    with pytest.raises(CampaignError, match=message):
        assert st.Campaign.from_toml(HEAD + text).control_problem().groups


def test_a_supply_that_is_missing_is_asked_for_by_its_key() -> None:
    text = HEAD.replace('vehicle = "cwolf"', 'vehicle = "bluerov2-heavy"')
    text = "\n".join(line for line in text.splitlines() if not line.startswith("autopilot"))
    with pytest.raises(CampaignError, match="add voltage_v"):
        st.Campaign.from_toml(text + "\n[tuning]\n").control_problem()


@pytest.mark.parametrize("name", VEHICLES)
def test_default_steps_stay_within_what_guidance_and_the_vehicle_allow(name: str) -> None:
    one = built_in(name)
    most = autopilot_facts(one.autopilot).guidance["pitch_max_deg"]
    for loop in one.loops:
        steps = one.trials(loop).to_dict()["steps"]
        assert max(map(abs, steps)) <= one.largest_step(loop) * (1.0 + 1e-9), loop
        if loop == "pitch":
            assert max(map(abs, steps)) <= most


@pytest.mark.parametrize("most", [1.0, 6.0, 15.0])
@pytest.mark.long
def test_pitch_steps_follow_the_largest_pitch(most: float) -> None:
    def gentle(text: Any) -> None:
        text["guidance"]["pitch_max_deg"] = most

    autopilot = changed("remus100", gentle)
    for given in ({}, {"corridor": SHORT}):
        pitch = with_loops("remus100", autopilot, loops={"pitch": given}).trials("pitch")
        assert pitch.to_dict()["steps"] == pytest.approx([most] * len(pitch))
    asked = with_loops("remus100", autopilot, loops={"pitch": {"steps": [most, most + 4.0]}})
    assert asked.trials("pitch").to_dict()["steps"] == pytest.approx([most] * len(asked.trials("pitch")))
    beyond = with_loops("remus100", autopilot, loops={"pitch": {"steps": [most + 4.0]}})
    with pytest.raises(CampaignError, match=rf"at most {most:g} deg, guidance.pitch_max_deg"):
        beyond.trials("pitch")


def test_a_step_sideways_stays_within_the_speed_sideways() -> None:
    one = built_in("bluerov2-heavy")
    top = one.top_of("sway")
    assert 0.0 < top < 0.8 * one.top_m_s
    # There the drag is what the loop may ask for, on the grid of 5 mm/s.
    terms = one.vehicle.forces(
        np.array([[0.0, top + at, 0.0, 0.0, 0.0, 0.0] for at in (0.0, 0.005)]), np.zeros(3)
    )
    drag = -(np.asarray(terms["damping"]) + np.asarray(terms["lift"]))[:, 1]
    assert drag[0] <= autopilot_facts(one.autopilot).loops["sway"]["tau_max"] < drag[1]
    assert max(map(abs, one.trials("sway").sizes)) <= 0.95 * top
    # A noisy sensor asks for a larger step: no larger than what is left of that.
    assert steps_above_noise("sway", 1.0, top_m_s=one.top_m_s, largest=0.2) == (0.2, -0.2)
