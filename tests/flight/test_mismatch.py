"""An autopilot of another vehicle is told before the flight is judged, by its file or by its loops."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import seatrial as st
from seatrial.flight.checks import made_for, mismatch, tuned_for
from seatrial.report.results.flight_findings import problem
from tests.flight.flying import OUT


def _words(autopilot: st.Autopilot, vehicle: st.Vehicle) -> str:
    """The doubt about an autopilot on a vehicle; empty without one."""
    doubt = mismatch(autopilot, vehicle)
    return "" if doubt is None else problem(doubt)


@pytest.mark.parametrize("name", st.Vehicle.names())
def test_built_in_vehicles_and_their_own_autopilots_belong_together(name: str) -> None:
    """By name, and by their loops where the file does not say for which vehicle it is."""
    vehicle, own = st.Vehicle.load(name), st.Autopilot.load(name)
    assert mismatch(own, vehicle) is None
    assert mismatch(own.renamed("mine", "of my own"), vehicle) is None


@pytest.mark.long
@pytest.mark.parametrize("law", ["pid", "lqr"])
def test_a_start_autopilot_and_a_tuned_one_say_their_vehicle(law: str) -> None:
    start = st.Autopilot.from_toml(st.start_autopilot(st.Vehicle.load("cwolf"), law=law))
    assert made_for(start) == "cwolf"
    for vehicle in ("my-vehicle", "ours on loan"):
        tuned = start.renamed("dive tuned", tuned_for(start.name, vehicle, "the campaign dive"))
        assert made_for(tuned) == vehicle


@pytest.mark.parametrize(
    ("autopilot", "vehicle", "doubt"),
    [
        ("beluga", "bluerov2-heavy", r"pitch loop the delay of this vehicle costs \d+ deg of phase"),
        ("remus100", "lauv", r"pitch loop the delay of this vehicle costs \d+ deg of phase"),
        ("lauv", "cwolf", r"ask for at most \d+ % of what the actuators of this vehicle give"),
        ("lauv", "remus100", ""),
    ],
)
def test_another_vehicles_autopilot_is_told_by_name_and_where_its_loops_show_it(
    autopilot: str, vehicle: str, doubt: str
) -> None:
    one, flown = st.Autopilot.load(autopilot), st.Vehicle.load(vehicle)
    said = _words(one, flown)
    assert said.startswith(f"the autopilot was made for {autopilot}, and {vehicle} flies")
    assert re.search(doubt, said)
    nameless = _words(one.renamed("mine", ""), flown)
    assert bool(nameless) == bool(doubt)
    assert re.search(doubt, nameless)


def test_a_renamed_copy_of_a_vehicle_is_that_vehicle(tmp_path: Path) -> None:
    """A changed mass is another vehicle, to which the built-in autopilot does not belong."""
    text = st.Vehicle.load("lauv").to_toml().replace('name = "lauv"', 'name = "our-auv"', 1)
    copy = st.Vehicle.from_toml(text)
    assert mismatch(st.Autopilot.load("lauv"), copy) is None
    heavy = copy.with_coefficients({"m": 2.0 * copy.coefficients()["m"]})
    assert _words(st.Autopilot.load("lauv"), heavy).startswith("the autopilot was made for lauv")


def test_a_flight_says_so_in_its_first_lines_and_as_data() -> None:
    mission = st.Mission.from_toml(OUT)
    flight = st.fly("lauv", "remus100", mission)
    first, worst, next_step = flight.report().lines()
    assert "the autopilot was made for remus100, and lauv flies" in worst.lower()
    assert "seatrial autopilot VEHICLE" in next_step
    assert flight.to_dict()["warnings"] == list(flight.warnings)
    assert flight.warnings[0] in flight.sentences()
    assert first.startswith("lauv on out")
    own = st.fly("lauv", "lauv", mission)
    assert own.warnings == ()
    # What counts is the vehicle that the autopilot believes in: another one may fly to try its robustness.
    text = st.Vehicle.load("lauv").to_toml().replace('name = "lauv"', 'name = "heavy"', 1)
    heavy = st.Vehicle.from_toml(text)
    heavy = heavy.with_coefficients({"Y_vdot": 3.0 * heavy.coefficients()["Y_vdot"]})
    assert st.fly(heavy, "lauv", mission).warnings
    assert st.fly(heavy, "lauv", mission, conditions=st.Conditions(model="lauv")).warnings == ()


def test_what_went_wrong_comes_before_the_doubt_about_the_autopilot() -> None:
    """A waypoint is missed; a margin of 45 deg is left, whatever gains and mass alone say."""
    mission = st.Mission.from_toml(OUT.replace("acceptance_radius_m = 5.0", "acceptance_radius_m = 0.001"))
    said = st.fly("lauv", "remus100", mission).report()
    assert said.worst.startswith('"waypoint 1" not reached')
    assert "; the autopilot was made for remus100, and lauv flies: " in said.worst
    assert "may leave little margin" in said.worst
    assert "no margin is left" not in said.worst
    assert "; and " in said.next_step
