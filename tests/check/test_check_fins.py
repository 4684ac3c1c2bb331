"""What `seatrial check` says of vehicles with movable fins and of vehicles that are not slender."""

from __future__ import annotations

import numpy as np
import pytest

from seatrial._core import State, Vehicle
from seatrial.check.vehicle import check_vehicle, stability
from seatrial.report.results.check_findings import sentence
from seatrial.vehicle.actuators import pushes
from seatrial.vehicle.stability import damping_gain, growth, neutral_fins
from seatrial.vehicle.steady_state import fin_turn, rudders, turn_kinds

REMUS, LAUV, ROV = (Vehicle.load(name) for name in ("remus100", "lauv", "bluerov2-heavy"))


def without_fins(vehicle: Vehicle) -> Vehicle:
    return vehicle.with_coefficients({
        name: 0.0 for name in vehicle.coefficients() if name.endswith((".C_La", ".C_D90"))
    })


def test_law_growth_with_fins_is_that_of_the_simulated_disturbance() -> None:
    """The linearised rate against a run of the whole chain, sway and yaw free, motors stopped."""
    t = np.arange(0.0, 8.0, 0.05)
    run = REMUS.simulate(t, {}, State(nu=[1.543, 1e-9, 0.0, 0.0, 0.0, 0.0]), free="YN")
    v = np.abs(np.asarray(run.nu)[:, 1])
    rate = np.log(v[140] / v[80]) / 3.0
    # After 4 s the other mode is gone; below 1e-4 m/s the quadratic terms are 1e-3 of the linear ones.
    assert rate == pytest.approx(growth(REMUS, 1.543, "course"), rel=1e-2)


def test_prestero_growth_of_the_whole_vehicle() -> None:
    # The published derivatives of sway and yaw give 1.02 1/s at 3 kn
    # (tests/vehicle/test_published_vehicles.py).
    assert growth(REMUS, 1.543, "course") == pytest.approx(1.02, abs=0.01)
    assert growth(without_fins(REMUS), 1.543, "course") > 1.5 * growth(REMUS, 1.543, "course")


def test_fins_make_the_difference_between_stable_and_not() -> None:
    assert growth(LAUV, 1.97, "course") < 0.0 < growth(without_fins(LAUV), 1.97, "course")
    assert not any("unstable" in text for text in check_vehicle(LAUV).warnings)
    warnings = check_vehicle(without_fins(LAUV)).warnings
    assert any("course unstable" in text and "C_L_alpha of rudder" in text for text in warnings)


def test_law_a_fin_at_neutral_only_takes_energy() -> None:
    nu = np.random.default_rng(1).standard_normal((200, 6)) * [2.0, 1.0, 1.0, 0.5, 0.5, 0.5]
    power = np.einsum("ij,ij->i", nu, neutral_fins(LAUV, nu))
    # Lift stands across the flow at the fin, drag against it: power is negative up to rounding.
    assert power.max() < 1e-9 * np.abs(power).max()


def test_energy_is_judged_with_the_fins() -> None:
    """REMUS's hull coefficients are what is left of the published sums without the fins."""
    assert damping_gain(without_fins(REMUS), [2.57]) is not None
    assert damping_gain(REMUS, [2.57]) is None
    assert not any("add energy" in text for text in check_vehicle(REMUS).warnings)


def test_vehicles_without_fins_have_no_wrench_of_fins() -> None:
    assert not neutral_fins(ROV, np.ones((3, 6))).any()


def test_a_vehicle_that_is_not_slender_is_not_told_to_grow_fins() -> None:
    found = check_vehicle(ROV)
    assert found.warnings == ()
    assert sum("its actuators can hold it" in text for text in found.notes) == 2


def test_a_direction_without_thrust_gets_no_line() -> None:
    own = [push.step for push in pushes(LAUV) if push.actuator == "propeller"]
    assert own == [7.0]
    found = check_vehicle(LAUV)
    assert len(found.by_actuator()[0]) == 1
    assert len(found.by_actuator()) == len(LAUV.actuators)
    assert not any("no force" in str(push) for push in found.pushes)


def test_the_turn_by_rudder_is_that_of_a_run() -> None:
    turn = fin_turn(LAUV)
    assert turn is not None
    assert set(rudders(LAUV)) == {"rudder_upper", "rudder_lower"}
    # A positive rudder turns LAUV to port, so that a turn to starboard takes a negative angle.
    t = np.arange(0.0, 120.0, 0.05)
    angle = np.full(len(t), -np.deg2rad(turn.fin_deg))
    commands = {"propeller": np.full(len(t), turn.command), "rudder_upper": angle, "rudder_lower": angle}
    nu = np.asarray(LAUV.simulate(t, commands, free="XYN").nu)[-1]
    # The run is steady to 1e-6 by then.
    assert np.rad2deg(nu[5]) == pytest.approx(turn.rate_deg_s, rel=1e-4)
    assert np.hypot(nu[0], nu[1]) / nu[5] == pytest.approx(turn.radius_m, rel=1e-4)
    assert any(text.startswith("Turn by rudder at 15 deg") for text in check_vehicle(LAUV).notes)


def test_without_astern_thrust_no_turn_needs_it() -> None:
    text = Vehicle.load("cwolf").to_toml()
    assert len(turn_kinds(Vehicle.load("cwolf"))) == 4
    limits = "maximum_ahead = 2000.0\nmaximum_astern = 0.0"
    ahead_only = Vehicle.from_toml(text.replace("maximum_ahead = 2000.0", limits))
    assert list(turn_kinds(ahead_only)) == ["under way", "inner side stopped"]


def test_endurance_that_is_not_known_is_said_in_words() -> None:
    assert any(
        "thrust commanded in newtons says nothing about power" in text for text in check_vehicle(LAUV).notes
    )
    assert any("a table of thrust says nothing about power" in text for text in check_vehicle(ROV).notes)


def test_a_pitch_that_no_actuator_holds_needs_no_fins_on_an_open_frame() -> None:
    """Advice on the lift of a slender hull does not fit an open frame."""
    values = {"Z_wdot": 20.0 * ROV.coefficients()["Z_wdot"], "z_b": 0.0}
    findings = stability(ROV.with_coefficients(values), [1.0, 1.5], "XYZN")
    (pitch,) = [sentence(finding) for finding in findings if finding.kind == "plane stable up to"]
    assert "Munk" not in pitch
    assert "fin" not in pitch
    assert "no actuator holds it above" in pitch


def test_a_supply_beyond_the_table_is_said() -> None:
    assert not any("lies outside" in text for text in check_vehicle(ROV).warnings)
    assert any("1 V lies outside the" in text for text in check_vehicle(ROV, voltage_v=1.0).warnings)


def test_rows_left_out_of_controllable_are_a_note() -> None:
    assert "The actuators can also command K; controllable leaves it out" in check_vehicle(REMUS).notes
