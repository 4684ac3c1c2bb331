"""The missions of `examples/missions` fly: vehicles reach every waypoint with their built-in autopilots."""

from __future__ import annotations

from pathlib import Path

import pytest

import seatrial as st

MISSIONS = Path(__file__).parents[2] / "examples" / "missions"
VEHICLES = {
    "cage_survey": "cwolf",
    "farm": "cwolf",
    "farm_geographic": "cwolf",
    "hover": "bluerov2-heavy",
    "lawnmower": "remus100",
}
CURRENTS = {"still": (0.0, 0.0, 0.0), "across": (0.0, 0.2, 0.0)}


def test_every_example_has_its_vehicle() -> None:
    assert {path.stem for path in MISSIONS.glob("*.toml")} == set(VEHICLES)


@pytest.mark.parametrize("current", CURRENTS)
@pytest.mark.parametrize("name", VEHICLES)
def test_every_waypoint_is_reached(name: str, current: str) -> None:
    vehicle = VEHICLES[name]
    flight = st.fly(vehicle, vehicle, MISSIONS / f"{name}.toml", current=CURRENTS[current], voltage_v=16.0)
    missed = [leg.label for leg in flight.legs if not leg.reached]
    assert flight.complete, f"{flight.outcome}, missed {missed}"
