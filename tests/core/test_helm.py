"""Helm: an autopilot at work, one step at a time, as a vehicle at sea would run it."""

from __future__ import annotations

import numpy as np
import pytest

import seatrial as st
from seatrial._core import Helm
from seatrial.base.errors import SimulationError

MISSION = """
format = 1
name = "out"
speed_m_s = 1.5
acceptance_radius_m = 5.0
[[legs]]
north_m = 100.0
east_m = 0.0
depth_m = 5.0
"""

COMPLETE = {"x": 0.0, "y": 0.0, "z": 1.0, "roll": 0.0, "pitch": 0.0, "yaw": 0.0, "p": 0.0, "q": 0.0, "r": 0.0}
STILL = COMPLETE | {"u": 0.0, "v": 0.0, "w": 0.0}


def helm(name: str = "cwolf") -> Helm:
    return st.Autopilot.load(name).engage(st.Vehicle.load(name), st.Mission.from_toml(MISSION))


def test_it_waits_for_what_it_needs_and_then_begins() -> None:
    one = helm()
    assert set(one.step({}).values()) == {0.0}
    assert one.waiting_for == ["position", "depth", "attitude", "rates"]
    assert one.thought == {}
    one.step({"x": 0.0, "y": 0.0, "z": 1.0})
    assert one.waiting_for == ["attitude", "rates"]
    for _ in range(100):  # ten seconds of start-up are no reason to abort
        one.step({})
    commands = one.step(STILL)
    assert one.waiting_for == []
    assert one.thought["reaction"] == "continue"
    assert one.thought["mode"] == "hover"
    assert any(value != 0.0 for value in commands.values())


def test_law_it_commands_what_a_flight_commands() -> None:
    flight = st.fly(
        "cwolf",
        "cwolf",
        st.Mission.from_toml(MISSION),
        conditions=st.Conditions(feedback=False, max_time_s=30.0),
    )
    one = helm()
    measured = flight.measured
    names = ("x", "y", "z", "roll", "pitch", "yaw", "u", "v", "w", "p", "q", "r")
    for k in range(200):
        sample = {name: float(measured[name][k]) for name in names}
        sample |= {f"{name}_water": float(measured[f"{name}_water"][k]) for name in "uvw"}
        commands = one.step(sample)
        expected = {name: values[k] for name, values in flight.commands.items()}
        # The same code on the same numbers; only the battery is not told.
        assert commands == pytest.approx(expected, abs=1e-9), f"step {k}"


@pytest.mark.parametrize("channel", ["yaw", "x", "z", "u"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_number_that_is_not_finite_was_not_measured(channel: str, value: float) -> None:
    one, other = helm(), helm()
    for k in range(20):
        one.step(STILL | {channel: value} if k == 10 else STILL)
        other.step(STILL)
    found, expected = one.step(STILL), other.step(STILL)
    assert all(np.isfinite(list(found.values())))
    # One sample fewer of a resting vehicle changes nothing to speak of.
    assert found == pytest.approx(expected, abs=1.0)


def test_an_actuator_is_given_up_and_trusted_again() -> None:
    one = helm()
    one.step(STILL)
    one.declare_failed("PL")
    assert one.step(STILL)["PL"] == 0.0
    assert one.thought["given_up"] == "PL"
    one.declare_failed("PL", False)
    one.step(STILL)
    assert one.thought["given_up"] == ""


@pytest.mark.parametrize(
    ("measurement", "signals", "says"),
    [
        ({"jaw": 0.1}, None, 'unknown channel "jaw"; did you mean "yaw"'),
        ({"battery": 85.0}, None, "battery: expected the share left, from 0 to 1, found 85"),
        ({"voltage": -3.0}, None, "voltage: expected a positive supply"),
        ({}, {"PLX": 0.0}, 'no actuator "PLX"; did you mean "PL"'),
    ],
)
def test_bad_input_is_refused_and_nothing_is_taken(
    measurement: dict[str, float], signals: dict[str, float] | None, says: str
) -> None:
    one = helm()
    with pytest.raises(SimulationError, match=says):
        one.step(COMPLETE | measurement, signals)
    assert one.waiting_for == ["position", "depth", "attitude", "rates"]


def test_a_thrust_table_asks_for_the_supply() -> None:
    one = helm("bluerov2-heavy")
    with pytest.raises(SimulationError, match="voltage: expected the supply in V with the first measurement"):
        one.step(STILL)
    assert np.isfinite(list(one.step(STILL | {"voltage": 14.8}).values())).all()


def test_set_points_by_hand_take_the_place_of_guidance_where_they_are_named() -> None:
    one = helm()
    for _ in range(20):
        one.step(STILL)
    guided = one.thought
    assert guided["speed"] > 0.0
    one.step(STILL, set_points={"speed": 0.4, "heading": 0.5, "depth": 3.0})
    by_hand = one.thought
    assert by_hand["speed"] == pytest.approx(0.4)
    assert by_hand["heading"] == pytest.approx(0.5)
    assert by_hand["depth"] == pytest.approx(3.0)
    assert by_hand["waypoint"] == guided["waypoint"]


def test_hands_off_gives_the_vehicle_back_to_guidance() -> None:
    one, other = helm(), helm()
    for k in range(60):
        one.step(STILL, set_points={"heading": 0.5} if 10 <= k < 20 else None)
        other.step(STILL)
    assert one.thought["heading"] == pytest.approx(other.thought["heading"], abs=1e-9)
    assert one.thought["speed"] == pytest.approx(other.thought["speed"], abs=1e-9)


def test_a_heading_by_hand_turns_the_vehicle_the_shorter_way() -> None:
    port, starboard = helm(), helm()
    for _ in range(5):
        left = port.step(STILL, set_points={"speed": 0.0, "heading": -0.5})
        right = starboard.step(STILL, set_points={"speed": 0.0, "heading": 0.5})
    # Mirrored set points of a hull that is all but a mirror image of itself.
    assert left["SbU"] - left["PU"] == pytest.approx(right["PU"] - right["SbU"], rel=0.05)
    assert abs(left["SbU"] - left["PU"]) > 100.0


def test_north_east_and_down_move_the_plan() -> None:
    one, other = helm(), helm()
    for _ in range(20):
        one.step(STILL | {"x": 10.0, "y": 3.0, "z": 2.0}, set_points={"north": 4.0, "east": 3.0, "down": 1.0})
        other.step(STILL | {"x": 6.0, "y": 0.0, "z": 1.0})
    for name in ("heading", "speed", "cross_track"):
        assert one.thought[name] == pytest.approx(other.thought[name], abs=1e-9), name
    assert one.thought["depth"] == pytest.approx(other.thought["depth"] + 1.0, abs=1e-9)


@pytest.mark.parametrize(
    ("set_points", "says"),
    [({"speeds": 1.0}, "speeds"), ({"heading": np.nan}, "heading"), ({"depth": np.inf}, "depth")],
)
def test_a_set_point_that_is_none_is_refused(set_points: dict[str, float], says: str) -> None:
    one = helm()
    with pytest.raises(SimulationError, match=says):
        one.step(STILL, set_points=set_points)


def test_a_reaction_takes_the_place_of_set_points() -> None:
    here = st.Mission.from_toml(
        MISSION + "[limits]\nfence_m = [[-50.0, -50.0], [150.0, -50.0], [150.0, 50.0], [-50.0, 50.0]]\n"
    )
    one = st.Autopilot.load("cwolf").engage(st.Vehicle.load("cwolf"), here)
    outside = STILL | {"y": 60.0}
    for _ in range(20):
        one.step(outside, set_points={"speed": 1.5, "heading": 1.5, "depth": 9.0})
    held = one.thought
    assert (held["reaction"], held["cause"]) == ("hold", "fence")
    # Where it stands it has nowhere to go: neither ahead, nor down to 9 m.
    assert held["speed"] == pytest.approx(0.0, abs=1e-6)
    assert held["depth"] == pytest.approx(1.0, abs=0.05)


def test_a_heading_by_hand_may_be_any_turn_further() -> None:
    one, other = helm(), helm()
    for _ in range(20):
        far = one.step(STILL, set_points={"heading": 0.5 + 4.0 * np.pi})
        near = other.step(STILL, set_points={"heading": 0.5})
    assert one.thought["heading"] == pytest.approx(0.5)
    assert far == pytest.approx(near, abs=1e-6)


def test_a_signal_that_is_not_finite_was_not_measured() -> None:
    one = helm()
    for _ in range(50):
        one.step(STILL, {"PL": np.inf})
    assert one.thought["given_up"] == ""
