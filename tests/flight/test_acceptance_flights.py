"""The built-in autopilots on a square with changes of depth, in 0.3 m/s of current from all four sides.

Errors are what guidance perceived (offsets of a position sensor are nobody's error here), on the last third
of every leg, where the integral has had five time constants.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

import seatrial as st
from seatrial._core import Vehicle
from seatrial.control_design.start_autopilot import start_autopilot
from tests.flight.acceptance import AUTOPILOTS, CURRENTS, LEG_M, RADIUS_M, STEADY, autopilot, flights, station

pytestmark = pytest.mark.long

SPEEDS = {
    "cwolf": (0.5, 1.0, 1.5, 2.6),
    "remus100": (1.6, 2.0, 2.2),
    "lauv": (0.9, 1.2, 1.65),
    "bluerov2-heavy": (0.45, 0.6),
    "beluga": (0.45, 0.6, 0.9),
}
"""The whole supporting range, m/s. BlueROV2 Heavy with 0.3 m/s ahead reaches its top speed of 0.83 m/s."""

USUAL = {"cwolf": 1.5, "remus100": 2.0, "lauv": 1.2, "bluerov2-heavy": 0.5, "beluga": 0.6}
EXAMPLES = Path(__file__).parents[2] / "examples"

BY_HAND = {"remus100": (("guidance", "turn_rate_max_deg_s"),)}
"""Table and key of what is not as `start_autopilot` makes it."""

EVERY = [(name, speed) for name, speeds in SPEEDS.items() for speed in speeds]
SENSORS = [None, "typical"]


@pytest.mark.parametrize("name", SPEEDS)
def test_the_steady_part_begins_after_five_time_constants_of_the_integral(name: str) -> None:
    table = tomllib.loads((AUTOPILOTS / f"{name}.toml").read_text())["guidance"]
    assert (1.0 - STEADY) * LEG_M[name] >= 10.0 * table["lookahead_m"]


@pytest.mark.parametrize("sensors", SENSORS)
@pytest.mark.parametrize(("name", "speed"), EVERY)
def test_issue_every_waypoint_is_reached_and_the_line_is_kept(
    name: str, speed: float, sensors: str | None
) -> None:
    for current, flown in zip(CURRENTS, flights(name, speed, sensors=sensors), strict=True):
        assert flown.outcome == "complete", current
        assert flown.waypoints == 4
        assert flown.missed_by <= RADIUS_M[name], current
        assert flown.cross_track < 0.5, current
        assert flown.vertical < 0.5, current
        assert flown.overshoot_percent < 5.0, current


@pytest.mark.parametrize("name", SPEEDS)
def test_issue_pure_pursuit_stays_metres_off_and_lookahead_its_offset(name: str) -> None:
    by_method = {
        method: max(flown.cross_track for flown in flights(name, USUAL[name], method=method))
        for method in ("pursuit", "lookahead", "integral")
    }
    assert by_method["pursuit"] > 2.0
    # The speed U over ground ahead is held, the drift V cos(crab) is not: U sin(crab) = V cos(crab)^2.
    table = tomllib.loads((AUTOPILOTS / f"{name}.toml").read_text())["guidance"]
    ratio = 0.3 / USUAL[name]
    crab = np.arcsin((np.sqrt(1.0 + 4.0 * ratio**2) - 1.0) / (2.0 * ratio))
    # What is left of the turn after two thirds of the leg, and the slip of the hull.
    share = min(1.0, max(0.5, USUAL[name] / table["lookahead_speed_m_s"]))
    assert by_method["lookahead"] == pytest.approx(share * table["lookahead_m"] * np.tan(crab), rel=0.1)
    assert by_method["integral"] < 0.5


def test_lauv_at_its_slowest_is_moved_by_the_trim_that_changes_at_a_turn() -> None:
    """At 0.7 m/s over ground the water comes at 1.0 m/s on one leg and at 0.4 m/s on the next.

    The lift that carries 1 N of buoyancy needs 1 deg of pitch, then 4 deg, which the vertical integral has to
    learn: the waypoints are reached, the depth is 0.5 m off for a while.
    """
    for flown in flights("lauv", 0.7):
        assert flown.outcome == "complete"
        assert flown.cross_track < 0.5
        assert flown.vertical < 0.5
        assert flown.overshoot_percent < 6.0


def test_remus_slower_than_its_lift_allows_is_told_by_its_file_and_does_not_keep_its_depth() -> None:
    """7 N of buoyancy: at 1.2 m/s the stern planes cannot hold the pitch that would carry it."""
    assert "below 1.5 m/s" in (AUTOPILOTS / "remus100.toml").read_text()
    found = flights("remus100", 1.2)
    assert max(flown.vertical for flown in found) > 1.0


@pytest.mark.parametrize("name", SPEEDS)
def test_start_values_fly_out_of_the_box(name: str) -> None:
    text = start_autopilot(Vehicle.load(name))
    for flown in flights(name, USUAL[name], sensors="typical", text=text):
        assert flown.outcome == "complete"
        assert flown.missed_by <= RADIUS_M[name]
        assert flown.cross_track < 0.5
        assert flown.overshoot_percent < 5.0
    # The built-in file is these values, but for what was finished by hand.
    made, built_in = tomllib.loads(text), tomllib.loads((AUTOPILOTS / f"{name}.toml").read_text())
    for key in ("name", "description"):
        del made[key], built_in[key]
    for table, key in BY_HAND.get(name, ()):
        assert made[table].pop(key, None) != built_in[table].pop(key)
    assert made == built_in


@pytest.mark.parametrize("sensors", SENSORS)
@pytest.mark.parametrize("name", ["cwolf", "bluerov2-heavy", "beluga", "remus100"])
def test_issue_no_limit_cycle_around_the_minimum_revolutions_under_way(
    name: str, sensors: str | None
) -> None:
    for flown in flights(name, USUAL[name], sensors=sensors):
        assert flown.starts_and_stops == 0.0
        # Thrusters about zero force follow the noise; without noise they rest.
        assert flown.reversals <= (0.0 if sensors is None else 20.0)


@pytest.mark.parametrize(("speed", "most"), [(0.5, 6.0), (0.6, 6.0), (0.7, 6.0)])
def test_issue_a_slow_leg_that_needs_less_than_the_least_thrust_starts_seldom(
    speed: float, most: float
) -> None:
    """CWolf with 0.3 m/s from astern: four propellers at 150 rpm push with 1.7 N, and 1 N or less is needed.

    Nothing but starts and stops gives that; per minute and actuator no more than ``most`` of them.
    """
    for sensors in SENSORS:
        for flown in flights("cwolf", speed, sensors=sensors):
            assert flown.starts_and_stops <= most


def test_start_gains_of_the_tuning_fly_in_cruise_and_overshoot_where_the_modes_change() -> None:
    """What the tuning begins from: see the head of the file."""
    text = (EXAMPLES / "cwolf" / "start_autopilot.toml").read_text()
    for flown in flights("cwolf", 1.5, sensors="typical", text=text):
        assert flown.outcome == "complete"
        assert flown.cross_track < 0.5
        assert flown.overshoot_percent < 5.0
    between = flights("cwolf", 1.0, sensors="typical", text=text)
    assert all(flown.outcome == "complete" for flown in between)
    assert 5.0 < max(flown.overshoot_percent for flown in between) < 20.0


def neutral(vehicle: Vehicle) -> Vehicle:
    """The vehicle as heavy as the water it displaces."""
    return vehicle.with_coefficients({"B": 9.81 * vehicle.coefficients()["m"]})


def test_issue_on_station_the_vertical_thrusters_carry_the_buoyancy_without_a_stop() -> None:
    starts, _ = station(Vehicle.load("cwolf"), autopilot("cwolf"), sensors="typical")
    assert not starts[:, 4:].any()
    # The stern propellers hold a place in still water: less than their least thrust.
    assert starts[:, :4].max() <= 6.0


def test_issue_neutral_trim_on_station_has_no_limit_cycle_of_its_own() -> None:
    cwolf = neutral(Vehicle.load("cwolf"))
    starts, _ = station(cwolf, autopilot("cwolf"), sensors=None, seeds=(1,))
    assert not starts[:, 4:].any()
    assert starts[:, :4].max() <= 6.0
    # Noise of depth and sinking is 0.35 N per thruster, the least thrust 0.46 N: started only from 1.8 N on
    # (`start_share` 2), noise still starts them; from the least thrust on, 130 times a minute.
    starts, _ = station(cwolf, autopilot("cwolf"), sensors="typical")
    assert starts.max() <= 70.0


def dead_band() -> Vehicle:
    """BlueROV2 Heavy whose speed controllers drop commands within 25 us of neutral."""
    text = Vehicle.load("bluerov2-heavy").to_toml()
    for old, new in (
        ("minimum_ahead = 0.0", "minimum_ahead = 25.0\nminimum_astern = 25.0"),
        ('below_minimum = "lift"', 'below_minimum = "zero"'),
    ):
        assert old in text
        text = text.replace(old, new)
    return Vehicle.from_toml(text)


def test_issue_a_dead_band_of_25_us_makes_no_limit_cycle() -> None:
    for vehicle in (dead_band(), neutral(dead_band())):
        starts, reversals = station(vehicle, autopilot("bluerov2-heavy"), sensors=None, seeds=(1,))
        assert not starts.any()
        assert not reversals.any()


@pytest.mark.parametrize("sensors", SENSORS)
@pytest.mark.parametrize("fault", [st.Fault("SbU", at_s=100.0), st.Fault("PL", at_s=150.0)])
def test_issue_a_dead_stern_propeller_is_found_and_the_mission_completed(
    fault: st.Fault, sensors: str | None
) -> None:
    for flown in flights("cwolf", 1.5, sensors=sensors, faults=(fault,)):
        assert flown.outcome == "complete"
        assert flown.missed_by <= RADIUS_M["cwolf"]
        assert flown.cross_track < 0.5
        assert flown.overshoot_percent < 5.0


def test_issue_a_dead_propeller_without_feedback_is_found_by_its_force_and_the_mission_completed() -> None:
    # Carried by the integrals alone its share costs 5 to 30 % of overshoot in depth; found by the momentum
    # that it does not give and taken out of the allocation, it costs what a reported stop does.
    for flown in flights("cwolf", 1.5, faults=(st.Fault("SbU", at_s=100.0),), feedback=False):
        assert flown.outcome == "complete"
        assert flown.missed_by <= RADIUS_M["cwolf"]
        assert flown.overshoot_percent < 5.0


@pytest.mark.parametrize("name", ["thruster_1", "thruster_5"])
@pytest.mark.parametrize("sensors", SENSORS)
def test_issue_a_dead_thruster_of_bluerov2_heavy_is_survived(name: str, sensors: str | None) -> None:
    for flown in flights("bluerov2-heavy", 0.5, sensors=sensors, faults=(st.Fault(name, at_s=30.0),)):
        assert flown.outcome == "complete"
        assert flown.missed_by <= RADIUS_M["bluerov2-heavy"]
        assert flown.vertical < 0.5
        # A horizontal one leaves three, which give less thrust ahead than 0.8 m/s through the water need.
        assert flown.cross_track < (1.0 if name == "thruster_1" else 0.5)


@pytest.mark.parametrize("number", [0, 3, 4, 7])
def test_a_dead_horizontal_thruster_does_not_push_beluga_aside(number: int) -> None:
    """In cruise no loop holds sway: the allocation keeps the row at zero, or three thrusters would push."""
    fault = st.Fault(Vehicle.load("beluga").actuators[number], at_s=20.0)
    for flown in flights("beluga", 0.6, sensors="typical", faults=(fault,)):
        assert flown.outcome == "complete"
        assert flown.missed_by <= RADIUS_M["beluga"]
        assert flown.cross_track < 0.5


STUCK_DEG = (0.0, 5.0, -5.0, 10.0, -13.6)


@pytest.mark.parametrize("angle", STUCK_DEG)
@pytest.mark.parametrize("fin", ["rudder_upper", "stern_plane_port"])
def test_issue_a_stuck_fin_is_found_and_buoyancy_brings_remus_up(fin: str, angle: float) -> None:
    """`[safety.actuator] reaction = "abort"`: half of the planes may not hold the bow up against 7 N."""
    fault = st.Fault(fin, at_s=100.0, stuck_at=float(np.deg2rad(angle)))
    for sensors in SENSORS:
        for flown in flights("remus100", 2.0, sensors=sensors, faults=(fault,)):
            assert flown.outcome == "aborted"
            assert flown.alert == "actuator"
            assert flown.surfaced
            # Found when something else is asked of it than what it does: in the third turn at the latest.
            assert flown.duration < 500.0


@pytest.mark.parametrize("angle", STUCK_DEG)
@pytest.mark.parametrize("fin", ["rudder_upper", "stern_plane_port"])
def test_issue_a_stuck_fin_without_feedback_is_flown_with_or_ends_at_a_limit(fin: str, angle: float) -> None:
    fault = st.Fault(fin, at_s=100.0, stuck_at=float(np.deg2rad(angle)))
    for flown in flights("remus100", 2.0, faults=(fault,), feedback=False, longest_s=1000.0):
        held = abs(angle) <= 5.0 if fin == "rudder_upper" else angle <= 0.0
        if held:
            # The other half of the pair has the reach for it.
            assert flown.outcome == "complete"
            assert flown.missed_by <= RADIUS_M["remus100"]
        else:
            # A rudder that holds the turn: no progress, or no more time. A plane that holds the bow down:
            # the depth limit.
            assert flown.outcome == ("surfaced" if fin == "rudder_upper" else "aborted")
            assert flown.alert in (("progress", "time") if fin == "rudder_upper" else ("depth",))
            # An abort is followed for two minutes, and 7 N bring it up by some tenths of a metre per second.
            assert flown.surfaced if fin == "rudder_upper" else flown.risen > 10.0


def test_issue_a_stuck_fin_may_be_flown_on_with_where_the_file_says_so() -> None:
    text = (AUTOPILOTS / "remus100.toml").read_text()
    assert 'reaction = "abort"' in text
    on = text.replace('reaction = "abort"', 'reaction = "continue"')
    for fin, angle in (("rudder_upper", 0.0), ("rudder_upper", 3.0), ("stern_plane_port", -3.0)):
        fault = st.Fault(fin, at_s=100.0, stuck_at=float(np.deg2rad(angle)))
        for flown in flights("remus100", 2.0, faults=(fault,), text=on):
            assert flown.outcome == "complete"
            assert flown.missed_by <= RADIUS_M["remus100"]


def test_issue_a_dead_propeller_brings_remus_up() -> None:
    for flown in flights("remus100", 2.0, faults=(st.Fault("propeller", at_s=100.0),)):
        assert flown.outcome == "aborted"
        assert flown.surfaced


def test_figures_tell_a_start_from_a_reversal() -> None:
    from tests.flight.acceptance import changes

    values = np.array([[0.0], [1.0], [-1.0], [0.0], [0.0]])
    every = np.ones(5, dtype=bool)
    assert changes(values != 0.0, every)[0] == 2.0
    assert changes(np.sign(values), every)[0] == 3.0
