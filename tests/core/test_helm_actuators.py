"""What `Helm` makes of actuators that fail without feedback: the table of docs/validation.md."""

from __future__ import annotations

import pytest

import seatrial as st
from tests.flight.actuator_faults import ALL, KINDS, failure, failures, table
from tests.flight.sensor_faults import FAULT_AT_S, VEHICLES, fly

BELOW_THE_LIMIT = {
    ("remus100", "astern", "propeller"): "it goes astern whatever the planes do, and nothing stops it"
}
"""Cells that go deeper than 1.2 times the limit, and why."""


@pytest.mark.parametrize(
    ("kind", "shown"),
    [("ahead", 1900.0), ("astern", 1100.0), ("zero", 1500.0), ("frozen", 1480.0), ("weak", 1550.0)],
)
def test_law_a_failure_rules_one_actuator_and_leaves_the_others_alone(kind: str, shown: float) -> None:
    names = st.Vehicle.load("bluerov2-heavy").actuators
    commands, before = dict.fromkeys(names, 1600.0), dict.fromkeys(names, 1480.0)
    obeyed = failure("bluerov2-heavy", kind, names[2])(commands, before)
    assert obeyed == commands | {names[2]: shown}


def test_law_all_dead_stops_every_actuator_and_stands_in_the_table_once() -> None:
    listed = list(failures("cwolf"))
    assert len(listed) == len(KINDS) * 6 + 1
    commands = dict.fromkeys(st.Vehicle.load("cwolf").actuators, 900.0)
    assert set(failure("cwolf", "zero", ALL)(commands, commands).values()) == {0.0}


@pytest.mark.parametrize(
    ("vehicle", "kind", "actuator"),
    [
        ("cwolf", "astern", "PL"),
        ("cwolf", "zero", ALL),
        ("remus100", "ahead", "propeller"),
        ("bluerov2-heavy", "ahead", "thruster_4"),
        ("bluerov2-heavy", "zero", ALL),
    ],
)
def test_law_the_motion_names_the_actuator_that_does_something_else(
    vehicle: str, kind: str, actuator: str
) -> None:
    """Without feedback, and none is named before or besides."""
    flown = fly(vehicle, seconds=FAULT_AT_S + 18.0, failure=failure(vehicle, kind, actuator))
    assert not any(flown.suspect[: round(FAULT_AT_S / 0.1)])
    assert set(flown.suspect) == {"", "all" if actuator == ALL else actuator}


def test_law_the_others_hold_the_depth_against_a_thruster_that_pushes_the_bow_down() -> None:
    flown = fly("cwolf", seconds=FAULT_AT_S + 40.0, failure=failure("cwolf", "ahead", "SbU"))
    assert flown.true[:, 2].max() < 16.0
    assert set(flown.reaction) == {"continue"}


@pytest.mark.long
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_law_no_other_actuator_leads_below_the_depth_limit(vehicle: str) -> None:
    deep = {(vehicle, row.kind, row.channel) for row in table(vehicle) if "depth" in row.unmet}
    assert deep == {key for key in BELOW_THE_LIMIT if key[0] == vehicle}
