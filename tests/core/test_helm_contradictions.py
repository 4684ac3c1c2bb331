"""What `Helm` makes of sensors that tell of two motions, of reactions that do not work, and of what stops."""

from __future__ import annotations

import math
from itertools import product

import pytest

from tests.flight.sensor_faults import CHANNELS, FAULT_AT_S, KINDS, VEHICLES, Flown, fault, fly, row

SLOW = "it drifts by 0.05 m/s, the offset that is allowed: told 2 s late, at 2.6 m"
SPEED = "the speed repeats the value that is wanted; the vehicle is up to 14 m along its course behind"
LAG = "2 s of the vehicle's speed across are less than the 3 m of a contradiction, and so is what comes of it"
LEISURE = "at 0.6 m/s the 3 m of a contradiction take longer than the 2 m off the course and ten seconds"
GAPS = "gaps of 2.5 s are those of a slow position sensor"
DRIFT = "the fence is seen, and the vehicle circles its last position in a current until it surfaces"
BEYOND_GOAL: dict[tuple[str, str, str], str] = {
    **{(name, "drift", "z"): SLOW for name in VEHICLES},
    **{(name, kind, "u"): SPEED for name in VEHICLES for kind in ("frozen", "frozen with noise")},
    **{(name, "2 s late", "y"): LAG for name in VEHICLES},
    **{(name, "intermittent", channel): GAPS for name in VEHICLES for channel in "xy"},
    **{("bluerov2-heavy", kind, "y"): LEISURE for kind in ("frozen", "frozen with noise", "zero")},
    **{("remus100", kind, "y"): DRIFT for kind in ("lost", "missing", "infinite", "zero")},
}
"""Cells of the table that miss the goal, and why."""


@pytest.fixture(scope="module")
def usual() -> Flown:
    return fly("cwolf")


@pytest.mark.parametrize("seed", [2, 3])
def test_law_sensors_of_one_motion_do_not_contradict_each_other(seed: int) -> None:
    for vehicle in VEHICLES:
        flown = fly(vehicle, seconds=120.0, seed=seed)
        assert set(flown.cause) == {""}, vehicle


@pytest.mark.parametrize(
    ("kind", "channel", "cause"),
    [
        ("frozen with noise", "z", "contradicted_depth"),
        ("frozen with noise", "y", "contradicted_position"),
        ("frozen with noise", "yaw", "contradicted_attitude"),
        ("sign", "z", "contradicted_depth"),
        ("noisy", "u", "contradicted_velocity"),
        ("drift", "y", "contradicted_position"),
        ("step", "x", "contradicted_position"),
    ],
)
def test_law_a_sensor_that_contradicts_the_others_is_told_and_the_vehicle_stays_within_its_limits(
    usual: Flown, kind: str, channel: str, cause: str
) -> None:
    found = row("cwolf", kind, channel, usual, fly("cwolf", fault(kind, channel)))
    assert found.cause == cause
    assert found.unmet == ""


def test_a_contradiction_that_ends_is_told_no_more() -> None:
    late = fault("frozen with noise", "z")
    flown = fly("cwolf", lambda told, since, rng: late(told, since, rng) if since < 11.0 else told)
    told = [cause == "contradicted_depth" for cause in flown.cause]
    assert any(told)
    assert not told[-1]
    assert set(flown.reaction) == {"continue"}  # shorter than `after_s`


@pytest.mark.parametrize("value", [math.nan, -1.0, 5.0])
def test_a_battery_that_shows_nothing_possible_is_told(value: float) -> None:
    flown = fly("cwolf", lambda told, since, _: told | {"battery": 0.8 if since < 1.0 else value})
    first = flown.cause.index("unread") * 0.1 - FAULT_AT_S
    assert 120.0 < first < 122.0
    assert set(flown.reaction) == {"continue"}


@pytest.mark.long
@pytest.mark.parametrize("vehicle", list(VEHICLES))
def test_law_no_fault_of_a_sensor_leads_far_and_none_stays_unnoticed(vehicle: str) -> None:
    usual = fly(vehicle)
    missed = {}
    for kind, channel in product(KINDS, CHANNELS):
        found = row(vehicle, kind, channel, usual, fly(vehicle, fault(kind, channel)))
        if found.unmet:
            missed[vehicle, kind, channel] = found
    expected = {key for key in BEYOND_GOAL if key[0] == vehicle}
    assert set(missed) <= expected, missed
