"""The missions of `examples/missions` keep what they say: every waypoint, and the distance that they promise.

Each is flown by the vehicle that it is for and by every other built-in one that can, in still water and in
0.3 m/s from all four sides, with perfect and with typical sensors. Who cannot is told so beforehand.
"""

from __future__ import annotations

from pathlib import Path

import pytest

import seatrial as st
from seatrial.check.mission import check_mission

MISSIONS = Path(__file__).parents[2] / "examples" / "missions"
FLOWN_BY = {
    "cage_survey": ("cwolf", "lauv", "remus100", "beluga"),
    "farm": ("cwolf", "beluga", "bluerov2-heavy"),
    "farm_geographic": ("cwolf", "beluga", "bluerov2-heavy"),
    "hover": ("bluerov2-heavy", "beluga"),
    "lawnmower": ("remus100", "lauv", "cwolf"),
}
"""The vehicle that a mission is for, then others."""

CURRENTS = ((0.0, 0.0), (0.3, 0.0), (-0.3, 0.0), (0.0, 0.3), (0.0, -0.3))
SEED = 4
"""Dead reckoning drifts: with typical sensors some seeds in a hundred come nearer than promised."""

FLIGHTS = [(name, vehicle) for name, vehicles in FLOWN_BY.items() for vehicle in vehicles]


def test_every_example_has_its_vehicle() -> None:
    assert {path.stem for path in MISSIONS.glob("*.toml")} == set(FLOWN_BY)


@pytest.mark.long
@pytest.mark.parametrize("sensors", [None, "typical"])
@pytest.mark.parametrize(("name", "vehicle"), FLIGHTS)
def test_every_waypoint_is_reached_and_the_promised_distance_kept(
    name: str, vehicle: str, sensors: str | None
) -> None:
    mission = st.Mission.load(MISSIONS / f"{name}.toml")
    for north, east in CURRENTS:
        flight = st.fly(
            vehicle,
            vehicle,
            mission,
            water=st.Water(current=(north, east, 0.0)),
            conditions=st.Conditions(sensors=sensors, voltage_v=16.0, max_step_s=0.05),
            seed=SEED,
        )
        missed = [leg.label for leg in flight.legs if not leg.reached]
        assert flight.complete, f"current {north}, {east}: {flight.outcome_in_words}, missed {missed}"
        if mission.obstacles:
            promised = mission.promised_m
            assert promised > 0.0
            assert flight.metrics["clearance_reserve_m"] >= 0.0, (north, east)
            assert flight.metrics["clearance_m"] >= promised


@pytest.mark.parametrize("vehicle", ["lauv", "remus100"])
def test_who_cannot_stop_is_told_beforehand_that_the_farm_is_not_for_it(vehicle: str) -> None:
    mission = st.Mission.load(MISSIONS / "farm.toml")
    found = check_mission(
        mission,
        vehicle=st.Vehicle.load(vehicle),
        autopilot=st.Autopilot.load(vehicle),
        current=(0.0, 0.3, 0.0),
    )
    assert not any(one.complete for one in found.flown)
    assert found.warnings[0].startswith("flown in still water")
    assert any("it circles at loiter_radius_m" in text for text in found.warnings)
    flight = st.fly(vehicle, vehicle, mission)
    assert not flight.complete
    assert any("cannot stop" in text for text in flight.sentences())
