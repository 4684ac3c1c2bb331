"""What `Helm` makes of actuators that fail without feedback: the table of docs/validation.md."""

from __future__ import annotations

import pytest

import seatrial as st
from tests.flight.actuator_faults import ALL, KINDS, failure, failures, table
from tests.flight.sensor_faults import VEHICLES, fly, row

BELOW_THE_LIMIT = {
    ("cwolf", "ahead", "PU"): "the allocation goes on with a thruster that pushes the bow down",
    ("cwolf", "ahead", "SbU"): "the allocation goes on with a thruster that pushes the bow down",
    (
        "remus100",
        "astern",
        "propeller",
    ): "it goes astern whatever the planes do, and no reaction stops the propeller",
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


@pytest.mark.parametrize(("vehicle", "within_s"), [("cwolf", 15.0), ("remus100", 15.0)])
def test_law_a_vehicle_whose_actuators_have_all_stopped_is_told_by_its_speed(
    vehicle: str, within_s: float
) -> None:
    dead = fly(vehicle, seconds=60.0, failure=failure(vehicle, "zero", ALL))
    judged = row(vehicle, "zero", ALL, fly(vehicle, seconds=60.0), dead)
    assert judged.cause == "speed"
    assert judged.noticed_s is not None
    assert judged.noticed_s < within_s


@pytest.mark.long
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_law_no_other_actuator_leads_below_the_depth_limit(vehicle: str) -> None:
    deep = {(vehicle, row.kind, row.channel) for row in table(vehicle) if "depth" in row.unmet}
    assert deep == {key for key in BELOW_THE_LIMIT if key[0] == vehicle}
