"""What `seatrial check` says of a mission: sums as the core plans them, geometry, what cannot be flown."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner, Result

from seatrial._core import Autopilot, Vehicle
from seatrial.check.legs import beyond, clearance, corners, ways
from seatrial.check.mission import MissionCheck, check_mission
from seatrial.cli import app
from seatrial.flight.mission import Mission
from seatrial.vehicle.steady_state import FinTurn, Turn, cruise, fin_turn, speeds, turning_radius, turns

EXAMPLES = Path(__file__).parents[2] / "examples" / "missions"
CWOLF, REMUS, ROV = (Vehicle.load(name) for name in ("cwolf", "remus100", "bluerov2-heavy"))
HEAD = 'format = 1\nname = "made"\nspeed_m_s = {speed}\nacceptance_radius_m = {radius}\n'

AUTOPILOT = """
format = 1
name = "made"
period_s = 0.1
[schedule]
speeds_m_s = [-2.0, -1.0, 0.0, 1.0, 2.0, 3.0]
[loops]
surge = { K_P = 100.0, tau_max = 100.0 }
heave = { K_P = 20.0, tau_max = 20.0 }
pitch = { K_P = 40.0, tau_max = 5.0 }
heading = { K_P = 30.0, tau_max = 5.0 }
[[modes]]
name = "hover"
loops = ["surge", "heave", "pitch", "heading"]
depth_by = "heave"
[[modes]]
name = "cruise"
loops = ["surge", "pitch", "heading"]
depth_by = "pitch"
from_speed_m_s = 0.8
[guidance]
pitch_max_deg = 20.0
depth_rate_max_m_s = 0.4
loiter_radius_m = 20.0
turn_rate_max_deg_s = 15.0
"""


def made(*legs: str, speed: float = 1.5, radius: float = 2.0, top: str = "") -> Mission:
    body = "".join(f"[[legs]]\n{leg}\n" for leg in legs)
    return Mission.from_toml(HEAD.format(speed=speed, radius=radius) + top + body)


def at(north: float, east: float, more: str = "") -> str:
    return f"north_m = {north}\neast_m = {east}\n{more}"


def lawnmower(spacing: float) -> str:
    return (
        'kind = "lawnmower"\nnorth_m = 20.0\neast_m = 0.0\nheading_deg = 0.0\nlength_m = 100.0\n'
        f"width_m = 60.0\nspacing_m = {spacing}\n"
    )


def said(found: MissionCheck, words: str) -> bool:
    return any(words in text for text in (*found.notes, *found.warnings))


def warned(found: MissionCheck, words: str) -> bool:
    return any(words in text for text in found.warnings)


def call(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.toml")), ids=lambda path: path.stem)
def test_legs_add_up_to_what_the_core_plans(path: Path) -> None:
    mission = Mission.load(path)
    way, found = ways(mission), check_mission(mission)
    assert way.length.sum() == pytest.approx(mission.length, rel=1e-12)
    assert sum(row.length_m for row in found.legs) == pytest.approx(mission.length, rel=1e-12)
    assert sum(row.time_s for row in found.legs) == pytest.approx(mission.planned_time, rel=1e-12)
    assert sum(row.waypoints for row in found.legs) == found.waypoints == len(mission.waypoints["label"])


places = st.tuples(st.integers(-9, 9), st.integers(-9, 9), st.integers(0, 5), st.booleans())


@settings(max_examples=40)
@given(st.lists(places, min_size=1, max_size=6, unique_by=lambda p: p[:2]), st.floats(0.1, 3.0))
def test_law_ways_are_those_of_the_core(found: list[tuple[int, int, int, bool]], turns: float) -> None:
    legs = [
        at(
            50.0 * north,
            50.0 * east,
            f"depth_m = {depth}\n" + (f"circle_radius_m = 12.0\nturns = {turns}\n" if circle else ""),
        )
        for north, east, depth, circle in found
    ]
    mission = made(at(1000.0, 0.0), *legs)
    way = ways(mission)
    assert way.length.sum() == pytest.approx(mission.length, rel=1e-12)
    assert way.travel_s.sum() == pytest.approx(mission.planned_time, rel=1e-12)


def test_every_waypoint_knows_its_leg() -> None:
    spiral = 'kind = "spiral"\nnorth_m = 300.0\neast_m = 0.0\nspacing_m = 10.0\n'
    spiral += "start_radius_m = 0.0\nend_radius_m = 20.0"
    mission = made(at(10.0, 0.0), lawnmower(20.0), at(200.0, 0.0), spiral, at(0.0, 0.0))
    numbers = mission.core.leg_numbers
    labels = mission.waypoints["label"]
    assert [numbers[k] for k, label in enumerate(labels) if "lawnmower" in label] == [2] * 8
    assert {numbers[k] for k, label in enumerate(labels) if label.startswith("spiral")} == {4}
    assert (numbers[0], numbers[9], numbers[-1]) == (1, 3, 5)


# Vehicles whose turns need nobody to hold roll or pitch meanwhile.
@pytest.mark.parametrize("name", ["cwolf", "remus100", "lauv"])
def test_no_steady_turn_of_the_whole_chain_is_tighter(name: str) -> None:
    vehicle = Vehicle.load(name)
    found: list[Turn | FinTurn] = [turn for turn in turns(vehicle) if turn.kind != "on the spot"]
    by_fins = fin_turn(vehicle)
    whole = found if by_fins is None else [*found, by_fins]
    assert whole
    for turn in whole:
        tightest = turning_radius(vehicle, turn.speed_m_s)
        # The speed along the circle is that ahead over the cosine of the drift, a few per cent more.
        assert tightest is not None
        assert tightest < 1.05 * turn.radius_m


def test_rudders_hard_over_halve_the_circle_of_half_their_angle() -> None:
    half, whole = fin_turn(REMUS), turning_radius(REMUS, 1.5)
    assert half is not None
    assert whole is not None
    # Linear in the angle but for the drift, which grows with the turn.
    assert 0.4 < whole / half.radius_m < 1.0


def test_a_vehicle_that_steers_by_thrust_turns_wider_as_it_runs_faster() -> None:
    top = speeds(CWOLF)[-1].speed_m_s
    radii = [turning_radius(CWOLF, share * top) for share in (0.3, 0.6, 0.9)]
    assert all(radius is not None for radius in radii)
    assert radii == sorted(radii, key=lambda radius: radius or 0.0)
    assert turning_radius(CWOLF, 1.05 * top) is None


@given(st.floats(1.0, 50.0), st.floats(0.1, 3.1), st.floats(0.0, 5.0))
def test_law_beyond_is_the_end_of_the_circle_seen_from_the_next_leg(
    radius: float, turn: float, acceptance: float
) -> None:
    # Ahead is x, to the side of the turn y; the corner is the origin.
    end = np.array([-acceptance + radius * np.sin(turn), radius * (1.0 - np.cos(turn))])
    leg = np.array([np.cos(turn), np.sin(turn)])
    across = leg[0] * end[1] - leg[1] * end[0]
    # Inside of the turn is where the circle's centre lies.
    assert beyond(radius, turn, acceptance) == pytest.approx(-across, abs=1e-9)
    assert beyond(radius, -turn, acceptance) == beyond(radius, turn, acceptance)


def test_a_right_angle_has_half_of_its_shorter_way_as_room() -> None:
    found = corners(made(at(100.0, 0.0), at(100.0, 30.0), at(0.0, 30.0)))
    assert [corner.index for corner in found] == [0, 1]
    assert [corner.room_m for corner in found] == pytest.approx([15.0, 15.0])
    assert [corner.turn for corner in found] == pytest.approx([np.pi / 2, np.pi / 2])


def test_a_stop_is_no_corner() -> None:
    assert corners(made(at(100.0, 0.0, "hold_s = 5.0\n"), at(100.0, 30.0))) == []


def test_lines_closer_than_the_turning_circle_are_told() -> None:
    radius = turning_radius(REMUS, 1.5)
    assert radius is not None
    narrow, wide = (check_mission(made(lawnmower(gap)), vehicle=REMUS) for gap in (5.0, 20.0))
    assert 5.0 < 2.0 * radius < 20.0
    assert warned(narrow, "24 of 24 turns are tighter")
    assert not wide.warnings
    assert said(narrow, "13 lines 5 m apart")


def test_lines_are_spread_evenly_over_the_width() -> None:
    assert said(check_mission(made(lawnmower(25.0))), "4 lines 20 m apart, at most 25 m asked for")


def test_small_turns_of_a_round_count_only_where_they_follow_one_another() -> None:
    round_ = (
        'kind = "perimeter"\nnorth_m = 100.0\neast_m = 0.0\nradius_m = {}\ndistance_m = 1.0\n'
        "depths_m = [5.0]\nstart_bearing_deg = 180.0\n"
    )
    # Begun along the round, clockwise from its southern end.
    narrow, wide = (
        check_mission(made(at(99.0 - r, 40.0), round_.format(r)), vehicle=REMUS) for r in (3.0, 30.0)
    )
    assert warned(narrow, "turns are tighter than the vehicle's circle")
    assert not wide.warnings


def test_a_circle_about_a_waypoint_is_compared_too() -> None:
    legs = [at(100.0, 0.0, f"circle_radius_m = {radius}\nturns = 1.0\n") for radius in (2.0, 20.0)]
    small, large = (check_mission(made(leg), vehicle=REMUS) for leg in legs)
    assert warned(small, 'the circle of 2 m about "waypoint 1" is tighter')
    assert not large.warnings


def test_energy_is_power_times_time_and_the_hotel_load() -> None:
    mission = made(at(900.0, 0.0), at(900.0, 300.0, "hold_s = 600.0\n"), speed=1.5)
    row, supply = cruise(CWOLF, 1.5), CWOLF.power()
    assert row is not None
    assert row.power_w is not None
    found = check_mission(mission, vehicle=CWOLF).energy
    assert found is not None
    assert found.driving_wh == pytest.approx(row.power_w * 800.0 / 3600.0, rel=1e-9)
    assert found.hotel_wh == pytest.approx(supply["hotel_w"] * 1400.0 / 3600.0, rel=1e-9)
    assert found.battery_wh == supply["battery_wh"]


def test_a_battery_that_does_not_suffice_is_told() -> None:
    text = CWOLF.to_toml().replace("battery_wh = 860.0", "battery_wh = {}")
    mission = made(at(900.0, 0.0), speed=1.5)
    full = check_mission(mission, vehicle=CWOLF).energy
    assert full is not None
    for share, words in ((0.9, "more than the battery"), (1.1, "only 9 % of the battery is left"), (2.0, "")):
        small = Vehicle.from_toml(text.format(share * full.total_wh))
        found = check_mission(mission, vehicle=small)
        assert warned(found, words) if words else not found.warnings, words


def test_no_power_is_said_and_not_made_up() -> None:
    found = check_mission(Mission.load(EXAMPLES / "hover.toml"), vehicle=ROV)
    assert found.energy is None
    assert said(found, "Energy: unknown")


def test_a_speed_beyond_the_top_speed_is_told_with_its_leg() -> None:
    mission = made(at(100.0, 0.0), at(200.0, 0.0, 'speed_m_s = 4.0\nlabel = "dash"\n'))
    found = check_mission(mission, vehicle=CWOLF)
    assert warned(found, 'leg 2 "dash" asks for 4 m/s, more than the top speed of 3.18 m/s')


def test_a_vehicle_without_a_steady_speed_is_told() -> None:
    driven = CWOLF.with_coefficients({"X_uu": 9.781})
    assert warned(check_mission(made(at(100.0, 0.0)), vehicle=driven), "cwolf reaches no steady speed")


def test_a_vehicle_that_cannot_stop_is_not_asked_to() -> None:
    mission = made(at(100.0, 0.0, 'hold_s = 10.0\nlabel = "sample"\n'))
    assert warned(check_mission(mission, vehicle=REMUS), 'leg 1 "sample" asks for station-keeping')
    assert not check_mission(mission, vehicle=CWOLF).warnings
    assert not check_mission(
        made(at(2.0, 0.0, "hold_s = 9.0\n"), radius=0.5, speed=0.3), vehicle=ROV
    ).warnings


def test_steep_ways_are_judged_by_the_mode_at_their_speed() -> None:
    autopilot = Autopilot.from_toml(AUTOPILOT)
    under_way = check_mission(made(at(20.0, 0.0, "depth_m = 15.0\n")), autopilot=autopilot)
    assert warned(
        under_way, "37 deg steep, more than pitch_max_deg = 20: the rest of its depth is made on the spot"
    )
    quick = check_mission(made(at(1.0, 0.0, "depth_m = 10.0\n"), speed=0.7, radius=1.0), autopilot=autopilot)
    assert warned(quick, "changes the depth at 0.70 m/s, faster than depth_rate_max_m_s = 0.4")
    slow = check_mission(made(at(1.0, 0.0, "depth_m = 10.0\n"), speed=0.3, radius=1.0), autopilot=autopilot)
    assert not slow.warnings


def test_an_autopilot_that_does_not_hover_circles() -> None:
    hover, cruise_ = AUTOPILOT.index("[[modes]]"), AUTOPILOT.rindex("[[modes]]")
    text = AUTOPILOT[:hover] + AUTOPILOT[cruise_:].replace("from_speed_m_s = 0.8\n", "")
    autopilot = Autopilot.from_toml(text)
    mission = made(at(60.0, 0.0, "depth_m = 30.0\nhold_s = 10.0\n"))
    found = check_mission(mission, autopilot=autopilot)
    assert warned(found, "it circles at loiter_radius_m = 20 m")
    assert warned(found, "made in circles of 20 m")


def test_a_speed_beyond_that_of_the_autopilot_is_told() -> None:
    autopilot = Autopilot.from_toml(AUTOPILOT + "speed_max_m_s = 1.0\n")
    assert warned(
        check_mission(made(at(100.0, 0.0)), autopilot=autopilot), "speed_max_m_s of the autopilot is 1"
    )


def test_the_way_to_a_fence_is_measured_at_its_nearest_place() -> None:
    square = np.array([[-10.0, -10.0], [-10.0, 10.0], [30.0, 10.0], [30.0, -10.0]])
    path = np.array([[0.0, 0.0], [20.0, 7.0], [0.0, -4.0]])
    distance, leg = clearance(path, square)
    assert distance == pytest.approx(3.0)
    assert leg == 0
    # A dent's corner is nearest to the middle of a way.
    dented = np.array([[-10.0, -10.0], [-10.0, 10.0], [10.0, 1.0], [30.0, 10.0], [30.0, -10.0]])
    distance, _ = clearance(np.array([[0.0, 0.0], [20.0, 0.0]]), dented)
    assert distance == pytest.approx(1.0)


def test_a_way_along_the_fence_is_told() -> None:
    fence = "[limits]\nfence_m = [[-9.0, -1.5], [-9.0, 50.0], [150.0, 50.0], [150.0, -1.5]]\n"
    assert warned(check_mission(made(at(100.0, 0.0), top=fence)), "comes within 1.5 m of the fence")
    assert said(
        check_mission(made(at(100.0, 0.0), radius=1.0, top=fence)), "Fence: 1.5 m from the nearest way"
    )


def test_what_has_no_limit_is_said() -> None:
    assert said(check_mission(made(at(100.0, 0.0))), "No limit of depth, time, place")
    limits = "[limits]\nmax_depth_m = 9.0\nmax_time_s = 999.0\n"
    assert said(check_mission(made(at(100.0, 0.0), top=limits)), "No limit of place")


def test_altitudes_are_told_apart_from_depths() -> None:
    limits = "[limits]\nmin_altitude_m = 2.0\n"
    found = check_mission(
        made(at(50.0, 0.0, "depth_m = 5.0\n"), at(90.0, 0.0, "altitude_m = 3.0\n"), top=limits)
    )
    assert said(found, "Lowest above the bottom: 3 m, limit 2 m")
    assert said(found, "Deepest: 5 m, no limit")
    assert [row.vertical for row in found.legs] == ["depth", "altitude"]


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.toml")), ids=lambda path: path.stem)
def test_examples_have_no_warning_for_their_vehicle(path: Path) -> None:
    vehicle = next(
        v
        for v in (REMUS, ROV, CWOLF)
        if v.name in path.read_text().lower().replace(" ", "").replace("bluerov2heavy", "bluerov2-heavy")
    )
    assert check_mission(Mission.load(path), vehicle=vehicle).warnings == ()


def test_the_verb_prints_legs_in_80_columns_and_sentences(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = call(
        "check", EXAMPLES / "farm.toml", "--vehicle", "cwolf", "--autopilot", "cwolf", "--figures", "none"
    )
    assert result.exit_code == 0, result.output
    assert list(tmp_path.iterdir()) == []
    rows = result.stdout[result.stdout.index("Legs") : result.stdout.index("Path:")].splitlines()
    assert max(map(len, map(str.rstrip, rows))) <= 80
    assert any("perimeter" in row and "49" in row for row in rows)
    assert "Path: 536 m in 16 min 49 s" in result.stdout
    assert "nothing looks wrong" in result.stdout


def test_the_verb_prints_json() -> None:
    result = call("check", EXAMPLES / "farm.toml", "--vehicle", "cwolf", "--figures", "none", "--json")
    data = json.loads(result.stdout)
    assert data["legs"][1]["kind"] == "perimeter"
    assert data["energy"]["total_wh"] == pytest.approx(31.8, abs=0.1)
    assert data["warnings"] == []


def test_the_verb_draws_the_plan_and_writes_the_file_in_metres(tmp_path: Path) -> None:
    result = call("check", EXAMPLES / "farm_geographic.toml", "--out", tmp_path / "plan")
    assert result.exit_code == 0, result.output
    assert {path.name for path in (tmp_path / "plan").iterdir()} == {
        "mission_plan.png",
        "mission_metres.toml",
    }
    metres = Mission.load(tmp_path / "plan" / "mission_metres.toml")
    assert metres.length == pytest.approx(Mission.load(EXAMPLES / "farm_geographic.toml").length, rel=1e-12)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ("cwolf", "--vehicle", "lauv"),
            "--vehicle is for a mission or an autopilot, and cwolf is a vehicle",
        ),
        ((EXAMPLES / "farm.toml", "--speed-kn", "3"), "--speed-kn is for a vehicle"),
        ((EXAMPLES / "farm.toml", "--vehicle", "cwlf"), "cwlf"),
        ((EXAMPLES / "farm.toml", "--autopilot", "cwlf"), "cwlf"),
    ],
)
def test_options_that_do_not_belong_are_refused(arguments: tuple[str | Path, ...], words: str) -> None:
    result = call("check", *arguments)
    assert result.exit_code == 2
    assert words in result.stderr
    assert "Traceback" not in result.output


def test_one_waypoint_is_no_plural() -> None:
    told = check_mission(made(at(50.0, 0.0))).report().text()
    assert ": nothing looks wrong. 1 waypoint, 50 m" in told
    assert "1 waypoints" not in told
