"""`check mission` flies what it promises, and says in which water the promise holds."""

from __future__ import annotations

import math

import pytest

import seatrial as st
from seatrial._core import Autopilot, Vehicle
from seatrial.check.mission import MissionCheck, check_mission

HEAD = 'format = 1\nname = "past the pile"\nspeed_m_s = 1.0\nacceptance_radius_m = 2.0\n'
PILE = "[[obstacles]]\nnorth_m = 30.0\neast_m = 4.6\nradius_m = 1.0\ndistance_m = 3.0\n"
LEGS = "[[legs]]\nnorth_m = 60.0\neast_m = 0.0\ndepth_m = 3.0\n"


def checked(text: str, name: str = "cwolf", **water: object) -> MissionCheck:
    mission = st.Mission.from_toml(text)
    return check_mission(
        mission,
        vehicle=Vehicle.load(name),
        autopilot=Autopilot.load(name),
        **water,  # type: ignore[arg-type]
    )


def test_a_promise_is_flown_in_still_water_and_in_a_current_from_four_sides() -> None:
    found = checked(HEAD + PILE + LEGS)
    assert [one.current[:2] for one in found.flown] == [(0, 0), (0.3, 0), (-0.3, 0), (0, 0.3), (0, -0.3)]
    still = found.flown[0]
    assert still.complete
    assert 3.0 < still.clearance_m < 4.0
    assert still.reserve_m == pytest.approx(still.clearance_m - 3.0)
    east = found.flown[3]  # towards the pile
    assert east.clearance_m < still.clearance_m
    assert not east.complete
    assert found.warnings[0].startswith("flown in a current of 0.3 m/s to the east with perfect sensors")
    assert "the mission promises 3 m" in found.warnings[0]
    assert any("in still water" in note for note in found.notes)


def test_the_current_is_the_one_that_is_given() -> None:
    found = checked(HEAD + LEGS, current=(0.0, 1.2, 0.0))
    assert len(found.flown) == 2
    assert found.flown[0].complete
    assert not found.flown[1].complete
    assert math.isinf(found.flown[1].clearance_m)
    assert "1.2 m/s to the east" in found.warnings[0]


def test_a_leg_without_a_reserve_against_the_current_is_told() -> None:
    fast = (HEAD + LEGS).replace("speed_m_s = 1.0", "speed_m_s = 2.6")
    found = checked(fast, current=(-0.8, 0.0, 0.0))
    assert any("3.40 m/s through the water, more than the top speed" in text for text in found.warnings)


def test_a_mission_along_the_bottom_is_not_flown_without_one() -> None:
    text = HEAD + "[[legs]]\nnorth_m = 60.0\neast_m = 0.0\naltitude_m = 3.0\n"
    found = checked(text)
    assert found.flown == ()
    assert any("Not flown here" in note for note in found.notes)
    assert checked(text, seabed=12.0).flown


def test_a_mission_below_the_bottom_is_wrong() -> None:
    text = HEAD + "[[legs]]\nnorth_m = 60.0\neast_m = 0.0\ndepth_m = 8.0\n"
    assert checked(text, seabed=12.0).flown
    found = checked(text, seabed=6.0)
    assert found.flown == ()
    assert "above the bottom, which is at 6 m there, found it at a depth of 8 m" in found.warnings[0]
    assert "above the bottom" in found.report().worst


def test_an_obstacle_on_the_way_is_refused_and_survives_the_expansion() -> None:
    with pytest.raises(st.VehicleError, match="obstacle 1"):
        st.Mission.from_toml(HEAD + PILE.replace("4.6", "2.0") + LEGS)
    mission = st.Mission.from_toml(HEAD + PILE + LEGS)
    again = st.Mission.from_toml(mission.to_toml(expanded=True))
    assert again.obstacles == mission.obstacles
    assert mission.promised_m == 3.0


def test_contact_is_no_success() -> None:
    into = HEAD + LEGS
    flight = st.fly(
        "cwolf", "cwolf", st.Mission.from_toml(into), water=st.Water(obstacles=[(30.0, 0.0, 2.0)])
    )
    assert flight.outcome == "complete"
    assert not flight.complete
    first = str(flight).splitlines()
    assert "too near to an obstacle" in first[0]
    assert "m inside an obstacle" in first[1]


def test_a_vehicle_that_leaves_the_water_is_told_when_and_where() -> None:
    vehicle = Vehicle.load("remus100")
    cork = vehicle.with_coefficients({"B": 2.0 * vehicle.coefficients()["B"]})
    flight = st.fly(cork, "remus100", st.Mission.from_toml(HEAD + "[start]\ndepth_m = 12.0\n" + LEGS))
    assert flight.metrics["depth_smallest_m"] < -0.1
    row = flight.position[:, 2].argmin()
    assert flight.metrics["depth_smallest_time_s"] == flight.t[row]
    assert "above the surface" in str(flight).splitlines()[1]
