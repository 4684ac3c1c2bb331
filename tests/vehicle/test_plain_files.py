"""What the core's objects say of their files as plain data: what a reader of their text would find."""

from __future__ import annotations

import tomllib
from typing import Any

import pytest

import seatrial as st
from seatrial._core import Mission as CoreMission

LEGS = """
format = 1
name = "legs"
speed_m_s = 1.5
acceptance_radius_m = 5.0
[[legs]]
north_m = 30.0
east_m = 0.0
depth_m = 5.0
[[legs]]
kind = "lawnmower"
north_m = 0.0
east_m = 50.0
heading_deg = 30.0
length_m = 80.0
width_m = 40.0
spacing_m = 10.0
[[legs]]
kind = "perimeter"
north_m = -200.0
east_m = -200.0
radius_m = 25.0
distance_m = 10.0
[[legs]]
north_m = 300.0
east_m = 150.0
[[legs]]
kind = "perimeter"
corners_m = [[200.0, 200.0], [260.0, 200.0], [260.0, 260.0], [200.0, 260.0]]
distance_m = 10.0
[[legs]]
north_m = 320.0
east_m = 230.0
"""


@pytest.mark.parametrize("name", st.Vehicle.names())
def test_a_vehicle_as_plain_data_is_its_text_read(name: str) -> None:
    vehicle = st.Vehicle.load(name).with_coefficients({"X_uu": -9.876})
    assert vehicle.to_dict() == tomllib.loads(vehicle.to_toml())


@pytest.mark.parametrize("name", st.Vehicle.names())
def test_motors_hull_and_voltages_are_those_of_the_file(name: str) -> None:
    vehicle = st.Vehicle.load(name)
    file = tomllib.loads(vehicle.to_toml())
    entries = [*file.get("thrusters", []), *file.get("fins", [])]
    assert vehicle.motors() == {
        e["name"]: file.get("motors", {}).get(e.get("motor", ""), {}) for e in entries
    }
    assert vehicle.hull_shape == file.get("geometry", {}).get("shape")
    tables = file.get("characteristics", {}).items()
    voltages = {key: (min(v), max(v)) for key, table in tables if (v := table.get("voltage_v"))}
    assert vehicle.table_voltages() == voltages


@pytest.mark.parametrize("name", st.Autopilot.names())
def test_an_autopilot_as_plain_data_is_its_text_read(name: str) -> None:
    autopilot = st.Autopilot.load(name)
    file: dict[str, Any] = tomllib.loads(autopilot.to_toml())
    assert autopilot.to_dict() == file
    assert autopilot.control == file["control"]
    assert autopilot.loops() == file["loops"]
    assert list(autopilot.loops()) == list(file["loops"])
    assert autopilot.guidance() == file["guidance"]
    assert autopilot.safety() == file["safety"]
    assert autopilot.feed_forward() == file["feed_forward"]
    for mode, written in zip(autopilot.modes, file["modes"], strict=True):
        assert mode["loop_names"] == written["loops"]
        assert mode["actuators"] == written.get("actuators")
        assert mode["hysteresis_m_s"] == written["hysteresis_m_s"]


def test_a_renamed_autopilot_is_the_same_but_for_its_name() -> None:
    autopilot = st.Autopilot.load("cwolf")
    renamed = autopilot.renamed("other", "for another vehicle")
    assert (renamed.name, renamed.description) == ("other", "for another vehicle")
    words = {"name": autopilot.name, "description": autopilot.description}
    assert renamed.to_dict() | words == autopilot.to_dict()


def test_a_mission_as_plain_data_is_its_text_read() -> None:
    mission = CoreMission.from_toml(LEGS)
    file = tomllib.loads(mission.to_toml())
    assert mission.to_dict() == file
    assert mission.legs == file["legs"]
    shapes = [{key: one[key] for key in one if key not in ("distance_m", "leg")} for one in mission.obstacles]
    assert shapes == [
        {"north_m": -200.0, "east_m": -200.0, "radius_m": 25.0},
        {"corners_m": [[200.0, 200.0], [260.0, 200.0], [260.0, 260.0], [200.0, 260.0]]},
    ]


def test_every_waypoint_knows_its_leg() -> None:
    mission = CoreMission.from_toml(LEGS)
    numbers = mission.leg_numbers
    assert len(numbers) == len(mission.waypoints["label"])
    assert sorted(set(numbers)) == [1, 2, 3, 4, 5, 6]
    assert numbers == sorted(numbers)
    assert (numbers.count(1), numbers.count(2), numbers.count(4), numbers.count(6)) == (1, 10, 1, 1)


@pytest.mark.parametrize("value", ["true", "false"])
def test_a_disturbance_observer_is_refused_with_what_to_use_instead(value: str) -> None:
    text = st.Autopilot.load("cwolf").to_toml()
    text = text.replace("[feed_forward]", f"[feed_forward]\ndisturbance = {value}")
    with pytest.raises(
        st.VehicleError, match=r"feed_forward\.disturbance: is not a key; delete it.*K_I_per_s"
    ):
        st.Autopilot.from_toml(text)
