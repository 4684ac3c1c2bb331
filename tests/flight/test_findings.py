"""What went wrong on a flight comes in the order of its gravity, with the cause that the log shows."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import seatrial as st
from seatrial.base.finding import Severity
from seatrial.base.run import to_json
from seatrial.check.mission import check_mission
from seatrial.control_design.start_autopilot import start_autopilot
from seatrial.flight.findings import missed_waypoint, outside, overrun
from seatrial.flight.flight import fly_seeds
from seatrial.report.results.flight import seeds_sentence
from seatrial.report.results.flight_findings import problem, remedy
from tests.flight.flying import BOX, OUT, grouped

STEEP = """
format = 1
name = "steep"
speed_m_s = 1.5
acceptance_radius_m = 3.0
[start]
depth_m = 3.0
[[legs]]
label = "out"
north_m = 60.0
east_m = 0.0
depth_m = 3.0
[[legs]]
label = "down"
north_m = 80.0
east_m = 0.0
depth_m = 25.0
[[legs]]
label = "on"
north_m = 160.0
east_m = 0.0
depth_m = 25.0
"""


def _lines(mission: str, *, vehicle: str = "cwolf", **around: object) -> tuple[st.Flight, str, str]:
    flight = st.fly(vehicle, vehicle, st.Mission.from_toml(mission), **grouped(**around))
    said = flight.report()
    return flight, said.worst, said.next_step


def test_a_leg_that_is_steeper_than_guidance_dives_is_told_with_both_slopes_and_its_length() -> None:
    flight, worst, next_step = _lines(STEEP, vehicle="lauv")
    assert not flight.legs[1].reached
    slope = math.degrees(math.atan2(22.0, 20.0))
    assert f"the leg descends 22.0 m over 20.0 m, a slope of {slope:.0f} deg, where guidance allows" in worst
    limit = flight.autopilot.guidance()["pitch_max_deg"]
    assert f"(pitch_max_deg = {limit:g})" in worst
    least = math.ceil(22.0 / math.tan(math.radians(limit)))
    assert next_step.startswith(f"lengthen the leg to at least {least} m")
    assert "enlarge" not in next_step
    # As long as it is advised, the leg is flown.
    longer = STEEP.replace("north_m = 80.0", f"north_m = {60.0 + 1.1 * least}").replace("160.0", "260.0")
    assert _lines(longer, vehicle="lauv")[0].legs[1].reached


def test_fins_that_cannot_take_a_light_vehicle_down_are_cured_by_its_trim() -> None:
    vehicle = st.Vehicle.load("remus100")
    legs = "".join(f"[[legs]]\nnorth_m = {x}.0\neast_m = 0.0\ndepth_m = 12.0\n" for x in (150, 300))
    head = 'format = 1\nname = "down"\nspeed_m_s = 1.5\nacceptance_radius_m = 3.0\n'
    mission = st.Mission.from_toml(head + legs)
    values = vehicle.coefficients()
    weight = values["m"] * vehicle.environment()["g"]
    light = vehicle.with_coefficients({"B": 1.02 * values["B"]})
    report = st.fly(light, "remus100", mission).report()
    cause = f"the vehicle is too light by {1.02 * values['B'] - weight:.1f} N"
    assert re.search(rf"the pitch loop was saturated for \d+ % of the leg: {cause}", report.worst)
    assert report.next_step.startswith("trim the vehicle")
    trimmed = vehicle.with_coefficients({"B": weight})
    assert all(leg.reached for leg in st.fly(trimmed, "remus100", mission).legs)


def test_fins_that_carry_a_heavy_vehicle_at_their_limit_are_cured_by_its_trim() -> None:
    vehicle = st.Vehicle.load("remus100")
    mission = st.Mission.from_toml(
        'format = 1\nname = "up"\nspeed_m_s = 1.5\nacceptance_radius_m = 3.0\nstart = { depth_m = 12.0 }\n'
        "[[legs]]\nnorth_m = 60.0\neast_m = 0.0\ndepth_m = 6.0\n"
    )
    values = vehicle.coefficients()
    weight = values["m"] * vehicle.environment()["g"]
    heavy = vehicle.with_coefficients({"B": 0.94 * values["B"]})
    report = st.fly(heavy, "remus100", mission).report()
    assert f"the vehicle is too heavy by {weight - 0.94 * values['B']:.1f} N" in report.worst
    assert report.next_step.startswith("trim the vehicle")
    trimmed = st.fly(vehicle.with_coefficients({"B": weight}), "remus100", mission)
    assert trimmed.loops["pitch"].saturated < 0.1


def test_a_vehicle_that_dives_on_the_spot_is_late_by_the_same_leg() -> None:
    flight, worst, next_step = _lines(STEEP)
    assert flight.complete
    planned = flight.route.planned_time
    assert worst.startswith(f"it took {flight.metrics['duration_s']:.0f} s, ")
    assert f'the planned {planned:.0f} s, furthest behind its plan on the way to "down"' in worst
    assert "the rest was made on the spot" in worst
    assert next_step.startswith("lengthen the leg to at least")


def test_a_waypoint_missed_at_one_depth_is_no_question_of_the_dive() -> None:
    flight = st.fly("cwolf", "cwolf", st.Mission.from_toml(BOX.replace("5.0\n[[legs", "0.05\n[[legs", 1)))
    # The first leg dives, the second one stays at its depth.
    missed = next(k for k, leg in enumerate(flight.legs) if k > 0 and not leg.reached)
    leg = flight.legs[missed]
    finding = missed_waypoint(flight, missed, leg)
    assert "slope" not in problem(finding)
    assert remedy(finding).startswith(f"enlarge its acceptance radius beyond {leg.smallest_m:.1f} m")
    wrong = missed_waypoint(flight, missed, replace(leg, perceived_m=0.01, smallest_m=9.0))
    assert problem(wrong).endswith("its position was wrong by so much")
    assert "--navigation filter" in remedy(wrong)


def test_a_current_from_ahead_makes_a_flight_late_and_the_speed_made_good_is_told() -> None:
    mission = OUT.replace("north_m = 60.0", "north_m = 300.0")
    flight, worst, next_step = _lines(mission, current=(-2.2, 0.0, 0.0))
    made = 300.0 / flight.legs[0].time_s
    assert overrun(flight, flight.legs)
    assert f"({made:.2f} m/s made good, 1.5 m/s asked for)" in worst
    assert "the speed that the vehicle makes good" in next_step
    still = st.fly("cwolf", "cwolf", st.Mission.from_toml(mission))
    assert overrun(still, still.legs) is None


def test_a_time_limit_that_the_safety_lets_pass_is_told() -> None:
    text = st.Autopilot.load("cwolf").to_toml()
    calm = text.replace('time = "surface"', 'time = "continue"', 1)
    assert calm != text
    mission = st.Mission.from_toml(OUT.replace("[start]", "[limits]\nmax_time_s = 41.0\n[start]"))
    flight = st.fly("cwolf", st.Autopilot.from_toml(calm), mission, water=st.Water(current=(-1.0, 0.0, 0.0)))
    assert flight.complete
    assert "times the planned 40 s, and the mission allows 41 s" in flight.report().worst


@pytest.mark.parametrize(
    ("limits", "around", "words"),
    [
        ("", {"seabed": 25.1}, "lauv touched the bottom, at "),
        ("min_altitude_m = 1.9", {"seabed": 27.0}, "the mission's least altitude is 1.9 m"),
        ("max_depth_m = 25.1", {}, "the mission's largest depth is 25.1 m"),
        (
            "fence_m = [[-9.0, -9.0], [-9.0, 9.0], [165.0, 9.0], [165.0, -9.0]]",
            {},
            "m outside the mission's fence, at ",
        ),
    ],
)
def test_a_limit_that_is_broken_comes_before_a_waypoint_that_is_missed(
    limits: str, around: dict[str, float], words: str
) -> None:
    """The dive overshoots 25 m by 0.3 m and is finished in a circle of 20 m."""
    mission = STEEP.replace("[start]", f"[limits]\n{limits}\n[start]")
    flight, worst, _ = _lines(mission, vehicle="lauv", **around)
    first = worst.split("; the safety")[0].split('; "down" not reached')[0]
    assert words in first
    assert not flight.complete


def test_touching_the_bottom_is_no_complete_mission_whatever_the_safety_does() -> None:
    """All waypoints are reached; the bottom rises to the north and meets the turn beyond the first one."""
    mission = OUT.replace("60.0", "30.0") + "[[legs]]\nnorth_m = 0.0\neast_m = 0.0\ndepth_m = 5.0\n"
    text = st.Autopilot.load("cwolf").to_toml()
    calm = text.replace('altitude = "surface"', 'altitude = "continue"', 1)
    assert calm != text
    flight = st.fly(
        "cwolf",
        st.Autopilot.from_toml(calm),
        st.Mission.from_toml(mission),
        water=st.Water(seabed=(8.0, -0.099, 0.0)),
    )
    assert flight.outcome == "complete"
    assert all(leg.reached for leg in flight.legs)
    assert flight.report().worst.startswith("cwolf touched the bottom")
    assert flight.outcome_in_words == "flown to its end, the bottom touched"
    assert not flight.complete
    many = fly_seeds(
        "cwolf",
        st.Autopilot.from_toml(calm),
        st.Mission.from_toml(mission),
        count=2,
        first=4,
        **grouped(seabed=(8.0, -0.099, 0.0)),
    )
    assert many.touched == (4, 5)
    assert not many.all_complete
    assert "touched the bottom: seed 4, 5" in seeds_sentence(many)


def test_a_largest_depth_that_the_watch_does_not_see_broken_is_no_complete_mission() -> None:
    """The filter that is told of the waves takes them for noise; the vehicle truly goes beyond the limit."""
    text = st.Autopilot.load("cwolf").to_toml()
    calm = st.Autopilot.from_toml(text.replace('depth = "surface"', 'depth = "continue"', 1))
    mission = st.Mission.from_toml(OUT.replace("[start]", "[limits]\nmax_depth_m = 5.1\n[start]"))
    around: dict[str, Any] = {
        "sensors": "typical",
        "navigation": "filter",
        "waves": st.SeaState(height_m=1.0, period_s=8.0, toward_deg=90.0),
    }
    flight = st.fly("cwolf", calm, mission, **grouped(seed=1, **around))
    assert flight.outcome == "complete"
    assert all(leg.reached for leg in flight.legs)
    assert flight.outcome_in_words == "flown to its end, beyond the mission's largest depth"
    assert not flight.complete
    many = fly_seeds("cwolf", calm, mission, count=2, first=1, **grouped(**around))
    assert many.off_limits == (1, 2)
    assert not many.all_complete
    assert "beyond the mission's limits: seed 1, 2" in seeds_sentence(many)


def test_an_error_beyond_the_acceptance_radius_is_no_reason_to_verify() -> None:
    """A current of more than half the speed carries the vehicle off behind the turn."""
    mission = BOX.replace("acceptance_radius_m = 5.0", "acceptance_radius_m = 3.0")
    flight, worst, next_step = _lines(mission, current=(-0.9, 0.0, 0.0))
    assert flight.complete
    assert ", more than its acceptance radius of 3 m; the current of 0.9 m/s is 60 % of its 1.5 m/s" in worst
    gain = flight.autopilot.guidance()["integral_gain_m_s"]
    assert f"integral_gain_m_s ({gain:g}) and lookahead_m" in next_step
    assert "verify" not in next_step


def test_a_position_that_was_wrong_by_an_outage_is_told_by_it() -> None:
    flight = st.fly("cwolf", "cwolf", st.Mission.from_toml(OUT))
    lost = replace(
        flight,
        circumstances=replace(
            flight.circumstances, navigation="filter", outages=(st.Outage("gps", from_s=1.0),)
        ),
    )
    wrong = missed_waypoint(lost, 0, replace(flight.legs[0], perceived_m=0.01, smallest_m=9.0))
    assert problem(wrong).endswith("its position was wrong by so much (no samples of gps from 1 s on)")
    assert "position aid" in remedy(wrong)
    assert "--navigation filter" not in remedy(wrong)


def test_a_flight_along_the_bottom_without_touching_it_is_complete() -> None:
    flight, worst, _ = _lines(BOX, seabed=12.0)
    assert flight.complete
    assert "bottom" not in worst


def test_the_distance_outside_a_fence_is_that_to_its_nearest_side() -> None:
    """A notched square: points within, in the notch and beyond a corner."""
    fence = np.array([
        [0.0, 0.0],
        [0.0, 10.0],
        [10.0, 10.0],
        [10.0, 6.0],
        [4.0, 6.0],
        [4.0, 4.0],
        [10.0, 4.0],
        [10, 0],
    ])
    points = np.array([[2.0, 5.0], [8.0, 5.0], [13.0, 14.0], [5.0, -2.0], [np.nan, 0.0]])
    assert outside(points, fence).tolist() == pytest.approx([0.0, 1.0, 5.0, 2.0, 0.0])
    # The same whichever way the corners run.
    assert outside(points, fence[::-1]).tolist() == pytest.approx([0.0, 1.0, 5.0, 2.0, 0.0])


FRAME = """
format = 1
name = "frame"
controllable = ["X", "Y", "Z", "K", "N"]
[coefficients]
m = 12.0
I_x = 0.2
I_y = 0.25
I_z = 0.3
B = 119.0
z_b = -0.02
X_udot = -5.0
Y_vdot = -12.0
Z_wdot = -15.0
K_pdot = -0.1
M_qdot = -0.1
N_rdot = -0.1
X_u = -4.0
Y_v = -6.0
Z_w = -5.0
K_p = -0.07
M_q = -0.07
N_r = -0.07
X_uu = -18.0
Y_vv = -22.0
Z_ww = -37.0
K_pp = -1.5
M_qq = -1.5
N_rr = -1.5
[motors.small]
maximum_ahead = 400.0
T_1_s = 0.1
[characteristics.small]
kind = "table"
signal = [-400.0, -200.0, -30.0, 30.0, 200.0, 400.0]
force_n = [[-40.0, -14.0, 0.0, 0.0, 18.0, 51.0]]
"""
"""An open frame with the sizes of a small ROV, heavier in heave than in surge, its pitch left to buoyancy."""

PLACES = {
    "front_starboard": ([0.14, 0.1, 0.0], [0.7071, -0.7071, 0.0]),
    "front_port": ([0.14, -0.1, 0.0], [0.7071, 0.7071, 0.0]),
    "rear_starboard": ([-0.14, 0.1, 0.0], [-0.7071, -0.7071, 0.0]),
    "rear_port": ([-0.14, -0.1, 0.0], [-0.7071, 0.7071, 0.0]),
    "up_starboard": ([0.0, 0.11, 0.0], [0.0, 0.0, -1.0]),
    "up_port": ([0.0, -0.11, 0.0], [0.0, 0.0, -1.0]),
}

SQUARE = """
format = 1
name = "square"
speed_m_s = {speed:.3f}
acceptance_radius_m = 1.0
[start]
depth_m = 1.0
[[legs]]
north_m = 20.0
east_m = 0.0
depth_m = 5.0
[[legs]]
north_m = 20.0
east_m = 20.0
depth_m = 5.0
[[legs]]
north_m = 0.0
east_m = 20.0
depth_m = 2.0
"""


@pytest.fixture(scope="module")
def frame() -> tuple[st.Vehicle, st.Autopilot]:
    text = FRAME + "".join(
        f'[[thrusters]]\nname = "{name}"\ncommand = "us"\nneutral = 1500.0\nposition_m = {place}\n'
        f'direction = {direction}\nmotor = "small"\ncharacteristic = "small"\n'
        for name, (place, direction) in PLACES.items()
    )
    vehicle = st.Vehicle.from_toml(text)
    return vehicle, st.Autopilot.from_toml(start_autopilot(vehicle))


def test_a_hull_whose_pitch_nothing_holds_is_told_before_its_legs_and_both_remedies_help(
    frame: tuple[st.Vehicle, st.Autopilot],
) -> None:
    vehicle, autopilot = frame
    flight = st.fly(vehicle, autopilot, st.Mission.from_toml(SQUARE.format(speed=0.5)))
    report = flight.report()
    assert not flight.complete
    root = flight.findings[0].root
    assert (root.kind, flight.findings[0].kind) == ("pitch unstable", "waypoint missed")
    assert report.worst.startswith(f"pitch of frame is unstable above {root['from_m_s']:.2f} m/s")
    assert report.next_step.startswith("fly at 0.3")
    assert "lengthen" not in report.next_step
    # A longer leg, once the advice, changes nothing.
    longer = st.Mission.from_toml(SQUARE.format(speed=0.5).replace("20.0", "45.0"))
    assert not st.fly(vehicle, autopilot, longer).complete
    slower = st.fly(vehicle, autopilot, st.Mission.from_toml(SQUARE.format(speed=root["safe_m_s"])))
    stiff = vehicle.with_coefficients({"z_b": -root["b_over_g_needed_m"]})
    stiffer = st.fly(stiff, autopilot, st.Mission.from_toml(SQUARE.format(speed=0.5)))
    for mended in (slower, stiffer):
        assert mended.complete
        assert mended.metrics["pitch_largest_deg"] < 25.0
        assert not mended.findings or mended.findings[0].severity < Severity.PROBLEM


def test_a_check_of_the_mission_tells_the_root_as_the_flight_does(
    frame: tuple[st.Vehicle, st.Autopilot],
) -> None:
    vehicle, autopilot = frame
    mission = st.Mission.from_toml(SQUARE.format(speed=0.5))
    check = check_mission(mission, vehicle=vehicle, autopilot=autopilot, current=(0.1, 0.0, 0.0))
    flight = st.fly(vehicle, autopilot, mission)
    assert check.report().next_step == flight.report().next_step


def test_a_mode_without_a_pitch_loop_is_told_where_the_actuators_could_hold_it() -> None:
    heavy = st.Vehicle.load("bluerov2-heavy")
    text = st.Autopilot.load("bluerov2-heavy").to_toml()
    without = st.Autopilot.from_toml(text.replace('"pitch", "heading"]', '"heading"]'))
    mission = st.Mission.from_toml(SQUARE.format(speed=0.6))
    flight = st.fly(heavy, without, mission, conditions=st.Conditions(voltage_v=16.0))
    assert flight.findings[0].root.kind == "pitch not held"
    assert flight.report().next_step.startswith('add "pitch" to the loops of mode')
    held = st.fly(heavy, "bluerov2-heavy", mission, conditions=st.Conditions(voltage_v=16.0))
    assert held.metrics["pitch_largest_deg"] < 0.5 * flight.metrics["pitch_largest_deg"]


def test_findings_are_plain_data_with_their_causes() -> None:
    flight = st.fly("lauv", "lauv", st.Mission.from_toml(STEEP))
    data = json.loads(to_json(flight.to_dict()))["findings"][0]
    assert (data["kind"], data["severity"], data["subject"]) == ("waypoint missed", "problem", "down")
    assert data["cause"]["kind"] == "leg too steep"
    assert data["cause"]["values"]["needed_m"] > 20.0
