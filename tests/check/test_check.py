"""What `seatrial check` says of a vehicle: words that follow the signs, published numbers, warnings."""

from __future__ import annotations

import tomllib
from typing import Any

import numpy as np
import pytest
import tomlkit
from hypothesis import given
from hypothesis import strategies as st

from seatrial._core import State, Vehicle
from seatrial.check.vehicle import VehicleCheck, check_vehicle, implausible
from seatrial.report.results.check_findings import sentence
from seatrial.vehicle.actuators import bollard, command, commanded_rows, pushes
from seatrial.vehicle.stability import damping_gain, growth, statics
from seatrial.vehicle.steady_state import KNOT_M_S, speeds, turns

CWOLF = Vehicle.load("cwolf")

THRUSTER = """
[[thrusters]]
name = "{name}"
command = "N"
position_m = {position}
direction = {direction}
characteristic = "direct"
"""


def made(*thrusters: tuple[str, list[float], list[float]], top: str = "", **coefficients: float) -> Vehicle:
    """A neutrally buoyant torpedo of 2 m whose thrusters are commanded in newtons."""
    values = {
        "m": 50.0,
        "z_b": -0.02,
        "X_u": -5.0,
        "Y_v": -50.0,
        "Z_w": -50.0,
        "K_p": -2.0,
        "M_q": -50.0,
        "N_r": -50.0,
    }
    lines = [f"{name} = {value}" for name, value in (values | coefficients).items()]
    text = f'format = 1\nname = "made"\n{top}\n[geometry]\nlength_m = 2.0\ndiameter_m = 0.2\n[coefficients]\n'
    text += "\n".join(lines) + '\n[characteristics.direct]\nkind = "direct"\n'
    for name, position, direction in thrusters:
        text += THRUSTER.format(name=name, position=position, direction=direction)
    return Vehicle.from_toml(text)


@pytest.fixture(scope="module")
def cwolf() -> VehicleCheck:
    return check_vehicle(CWOLF)


def doubts(vehicle: Vehicle) -> list[str]:
    return [sentence(finding) for finding in implausible(vehicle)]


def warned(vehicle: Vehicle, words: str) -> bool:
    return any(words in text for text in check_vehicle(vehicle).warnings)


def test_a_sentence_per_actuator_names_force_and_turn(cwolf: VehicleCheck) -> None:
    assert [push.actuator for push in cwolf.pushes[::2]] == CWOLF.actuators
    first = str(cwolf.pushes[0])
    assert first.startswith("+1000 rpm on SbU: 19 N ahead, bow to port")
    # 20.66 N at 1000 rpm along [0.933, 0.25, -0.259]: eqs. 35, 39.
    assert "5.2 N to starboard" in first
    assert "5.3 N up" in first
    assert str(cwolf.pushes[8]) == "+1000 rpm on VTB: 7.1 N down, bow down"
    assert len(cwolf.by_actuator()) == 6


@pytest.mark.parametrize(
    ("position", "direction", "words"),
    [
        ([-1.0, 0.3, 0.0], [1.0, 0.0, 0.0], "ahead, bow to port"),
        ([-1.0, -0.3, 0.0], [1.0, 0.0, 0.0], "ahead, bow to starboard"),
        ([-1.0, 0.3, 0.0], [-1.0, 0.0, 0.0], "astern, bow to starboard"),
        ([0.8, 0.0, 0.0], [0.0, 0.0, 1.0], "down, bow down"),
        ([0.8, 0.0, 0.0], [0.0, 0.0, -1.0], "up, bow up"),
        ([0.0, 0.3, 0.0], [0.0, 0.0, 1.0], "down, heel to starboard"),
        ([0.8, 0.0, 0.0], [0.0, 1.0, 0.0], "to starboard, bow to starboard"),
    ],
)
def test_words_follow_place_and_direction(position: list[float], direction: list[float], words: str) -> None:
    push = pushes(made(("one", position, direction)))[0]
    assert push.words == f"50 N {words}"


def test_a_reversed_actuator_is_told_as_it_is_commanded() -> None:
    ahead, astern = (p for p in pushes(Vehicle.load("beluga")) if p.actuator == "thruster_4")
    assert ahead.step == 200.0
    assert "astern" in ahead.words
    assert "ahead" in astern.words


def test_bollard_force_is_that_of_the_chain() -> None:
    # p1 n|n| with n = 1500/60 rev/s and p1 = 0.0743904 N s^2; four propellers at cos 15 deg cos 15 deg.
    commands = dict.fromkeys(("SbU", "SbL", "PU", "PL"), 1500.0)
    expected = 4 * 0.0743904 * 25.0**2 * CWOLF.allocation_matrix()[0, 0]
    # The lag leaves exp(-(10 s)/(0.15 s)) of the step: nothing.
    assert bollard(CWOLF, commands)[0] == pytest.approx(expected, rel=1e-6)


def test_lit_taubert_2014_table_1_speed_and_endurance() -> None:
    rows = speeds(CWOLF)
    # Table I: 6 kn. The built-in vehicle's drag and propellers are partly assumed: 5 %.
    assert rows[-1].speed_kn == pytest.approx(6.0, rel=0.05)
    endurance = np.interp(3.0, [row.speed_kn for row in rows], [row.endurance_h or 0.0 for row in rows])
    # Table I: 3 h at 3 kn; five rows are joined by straight lines: 20 %.
    assert endurance == pytest.approx(3.0, rel=0.2)


def test_law_speed_balances_thrust_and_drag() -> None:
    values, rows = CWOLF.coefficients(), speeds(CWOLF)
    assert rows
    for row in rows:
        u = row.speed_kn * KNOT_M_S
        drag = -(values["X_u"] * u + values["X_uu"] * u * u)
        # The last tenth of the run is averaged; the approach to the steady speed leaves less than this.
        assert row.thrust_n == pytest.approx(drag, rel=1e-4)


def test_turns_are_to_starboard_and_obey_v_is_r_times_radius() -> None:
    found = turns(CWOLF)
    assert found
    for turn in found:
        assert turn.rate_deg_s > 0.0
        assert turn.speed_m_s == pytest.approx(np.deg2rad(turn.rate_deg_s) * turn.radius_m, rel=1e-9)


def test_a_vehicle_without_actuators_is_checked_too() -> None:
    found = check_vehicle(made())
    assert found.pushes == ()
    assert found.speeds == ()
    assert "no actuator drives ahead" in str(found)


def test_law_natural_period_of_roll() -> None:
    values = CWOLF.coefficients()
    # z_g = 0: only the buoyancy, 20 mm above O, rights the vehicle.
    stiffness = -values["z_b"] * values["B"]
    period = 2.0 * np.pi * np.sqrt((values["I_x"] - values["K_pdot"]) / stiffness)
    # The stiffness is a central difference over 1e-5 rad.
    assert statics(CWOLF).roll_period_s == pytest.approx(period, rel=1e-6)


def test_built_in_vehicles_pass_but_for_what_their_files_say(cwolf: VehicleCheck) -> None:
    assert cwolf.warnings == ()
    # Beluga's file itself records 24 kg against 23 kg of displaced water.
    assert all("B - m g" in text for text in check_vehicle(Vehicle.load("beluga")).warnings)


def test_without_lift_a_slender_hull_is_course_unstable() -> None:
    lift = ("Y_uv", "Y_ur", "N_uv", "N_ur", "Z_uw", "Z_uq", "M_uw", "M_uq")
    pure = CWOLF.with_coefficients(dict.fromkeys(lift, 0.0))
    assert growth(CWOLF, 1.5, "course") < 0.0 < growth(pure, 1.5, "course")
    assert warned(pure, "course unstable")


def test_law_growth_is_that_of_the_simulated_disturbance() -> None:
    """The linearised rate against a run of the full model, CWolf without lift, sway and yaw free."""
    pure = CWOLF.with_coefficients(dict.fromkeys(("Y_uv", "Y_ur", "N_uv", "N_ur"), 0.0))
    t = np.arange(0.0, 12.0, 0.1)
    run = pure.simulate(t, {}, State(nu=[1.5, 1e-9, 0.0, 0.0, 0.0, 0.0]), free="YN")
    v = np.abs(np.asarray(run.nu)[:, 1])
    rate = np.log(v[100] / v[60]) / 4.0
    # After 6 s the other mode is gone; below 1e-4 m/s the quadratic terms are 1e-3 of the linear ones.
    assert rate == pytest.approx(growth(pure, 1.5, "course"), rel=1e-2)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"z_b": 0.02},
            "roll and pitch not stable at rest: the centre of buoyancy is 20 mm below the centre",
        ),
        ({"z_b": 0.0}, "the centre of buoyancy is not above the centre of gravity"),
        ({"B": 800.0}, "of the weight"),
        ({"B": 5.3}, "N is -100 % of the weight"),
        ({"X_u": 3.0}, "X_u = +3 is positive"),
        ({"N_uv": 600.0}, "damping and lift add energy"),
    ],
)
def test_what_is_not_stable_or_drives_on_is_warned_of(change: dict[str, float], words: str) -> None:
    assert warned(CWOLF.with_coefficients(dict(change)), words)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"m": 3.0, "B": 29.43}, "of the 230.6 kg of water"),
        ({"I_z": 7.1e4}, "I_z = 7.1e+04 kg m2"),
        ({"X_udot": -3710.0}, "X_udot = -3710 against 135"),
        ({"z_b": -20.0}, "centre of buoyancy lies outside the hull"),
        ({"I_x": 3.0, "I_y": 30.0, "I_z": 71.0}, "I_z = 71 kg m2 is more than I_x + I_y = 33"),
        ({"I_x": 3.0, "I_y": 71.0, "I_z": 30.0}, "I_y = 71 kg m2 is more than I_x + I_z = 33"),
        ({"SbU.p2": 0.5, "PU.p2": 0.5}, "of SbU and PU is positive"),
    ],
)
def test_implausible_coefficients_are_named(change: dict[str, float], words: str) -> None:
    assert any(words in text for text in doubts(CWOLF.with_coefficients(dict(change))))


def test_damping_that_drives_on_without_end_is_named_beside_what_can_still_be_said() -> None:
    """Drag of the wrong sign: no speed at all is steady."""
    check = check_vehicle(CWOLF.with_coefficients({"X_uu": 9.781}))
    assert check.speeds == check.cruises == ()
    assert any("X_uu = +9.781 is positive" in text for text in check.warnings)
    assert any("reaches no steady speed" in text for text in check.notes)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "minimum_ahead = 150.0",
            "minimum_ahead = 3000.0",
            "minimum_ahead = 3000 above maximum_ahead = 2000",
        ),
        ("rho_kg_m3 = 1025.0", "rho_kg_m3 = 1.025", "rho_kg_m3 = 1.025 is not the density of water"),
    ],
)
def test_what_cannot_be_meant_in_a_file_is_named(old: str, new: str, words: str) -> None:
    text = CWOLF.to_toml()
    assert old in text
    assert any(words in text for text in doubts(Vehicle.from_toml(text.replace(old, new))))


def test_a_density_of_other_units_does_not_doubt_the_mass() -> None:
    text = CWOLF.to_toml().replace("rho_kg_m3 = 1025.0", "rho_kg_m3 = 1.025")
    assert not any("m = 135 kg" in text for text in doubts(Vehicle.from_toml(text)))


def test_energy_is_added_in_the_direction_that_is_named() -> None:
    vehicle = CWOLF.with_coefficients({"N_uv": 600.0})
    gain = damping_gain(vehicle, [1.0, 2.0])
    assert gain is not None
    nu = 1e-3 * np.array(gain.direction) + [gain.speed_m_s, 0.0, 0.0, 0.0, 0.0, 0.0]
    terms = vehicle.forces(nu, np.zeros(3))
    straight = vehicle.forces([gain.speed_m_s, 0.0, 0.0, 0.0, 0.0, 0.0], np.zeros(3))
    force = sum(np.asarray(terms[key]) - np.asarray(straight[key]) for key in ("damping", "lift"))
    assert float(force @ (nu - [gain.speed_m_s, 0, 0, 0, 0, 0])) > 0.0


@given(st.lists(st.floats(0.0, 1e3), min_size=12, max_size=12))
def test_law_negative_diagonal_damping_never_adds_energy(sizes: list[float]) -> None:
    names = [f"{row}_{v}" for row, v in zip("XYZKMN", "uvwpqr", strict=True)]
    names += [f"{row}_{v}{v}" for row, v in zip("XYZKMN", "uvwpqr", strict=True)]
    lift = dict.fromkeys(("Y_uv", "Y_ur", "N_uv", "N_ur", "Z_uw", "Z_uq", "M_uw", "M_uq"), 0.0)
    changes = lift | {name: -size for name, size in zip(names, sizes, strict=True)}
    assert damping_gain(CWOLF.with_coefficients(dict(changes)), [1.0]) is None


def test_rows_that_cannot_be_commanded_are_named() -> None:
    # Sway comes only with yaw and roll has a singular value of 0.002 (docs/theory/allocation.md).
    assert commanded_rows(CWOLF) == ["X", "Z", "M", "N"]
    data = tomllib.loads(CWOLF.to_toml())
    text = CWOLF.to_toml().replace(
        f"controllable = {str(data['controllable']).replace(chr(39), chr(34))}", 'controllable = ["X", "K"]'
    )
    assert 'controllable = ["X", "K"]' in text
    assert any("K counts as controllable" in text for text in doubts(Vehicle.from_toml(text)))


def test_a_row_that_is_listed_twice_is_named() -> None:
    vehicle = made(("one", [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]), top='controllable = ["X", "X"]')
    assert "controllable lists X 2 times; name each row once" in doubts(vehicle)


def test_an_actuator_far_outside_the_hull_is_named() -> None:
    vehicle = made(("one", [-100.0, 0.0, 0.0], [1.0, 0.0, 0.0]), top='controllable = ["X"]')
    assert any("far outside the hull" in text for text in doubts(vehicle))


def test_the_check_is_plain_data(cwolf: VehicleCheck) -> None:
    import json

    data: dict[str, Any] = json.loads(json.dumps(cwolf.to_dict()))
    assert data["pushes"][0]["sentence"] == str(cwolf.pushes[0])
    assert data["statics"]["net_n"] == pytest.approx(5.0)


def test_a_slow_motor_is_waited_for() -> None:
    rates = {f"{name}.{key}": 60.0 for name in CWOLF.actuators for key in ("n_acc", "n_dec")}
    commands = dict.fromkeys(("SbU", "SbL", "PU", "PL"), 2000.0)
    # Lags of 0.15 s settle within 5 s to the last digit.
    assert bollard(CWOLF.with_coefficients(rates), commands) == pytest.approx(bollard(CWOLF, commands))


def test_law_a_reversed_motor_pushes_as_far_with_commands_of_the_other_sign() -> None:
    table = tomllib.loads(CWOLF.to_toml())
    table["motors"]["propeller"]["maximum_astern"] = 1000.0
    straight = Vehicle.from_toml(tomlkit.dumps(table), "straight")
    for thruster in table["thrusters"]:
        thruster["reversed"] = True
    turned = Vehicle.from_toml(tomlkit.dumps(table), "reversed")
    for share in (1.0, 0.5, -0.5, -1.0):
        commands = [
            {name: command(vehicle.actuator_info()[name], share) for name in ("SbU", "SbL", "PU", "PL")}
            for vehicle in (straight, turned)
        ]
        assert commands[1] == {name: -value for name, value in commands[0].items()}
        assert bollard(turned, commands[1]) == pytest.approx(bollard(straight, commands[0]))
    assert [(p.step, p.wrench) for p in pushes(turned)][:2] == [
        (-p.step, p.wrench) for p in reversed(pushes(straight)[:2])
    ]
    assert [one.speed_m_s for one in speeds(turned)] == pytest.approx([
        one.speed_m_s for one in speeds(straight)
    ])


def test_a_tether_that_does_nothing_is_named() -> None:
    table = "[tether]\nposition_m = [-1.0, 0.0, 0.0]\n"
    (said,) = [text for text in doubts(made(top=table)) if "tether" in text]
    assert "no effect" in said
    assert not [text for text in doubts(made(top=table, A_tether=0.1)) if "tether" in text]
    assert not [text for text in doubts(made()) if "tether" in text]


def test_a_vehicle_that_may_rightly_be_unstable_is_not_to_be_corrected_at_any_rate() -> None:
    remus = Vehicle.load("remus100")
    said = check_vehicle(remus).report()
    assert said.worst.lower().startswith("course unstable")
    assert said.next_step.startswith("where the real vehicle is stable, correct the vehicle file")
    assert "where it is not, go on" in said.next_step
    other = check_vehicle(remus.with_coefficients({"B": 1.4 * remus.coefficients()["B"]})).report()
    assert other.next_step == "correct the vehicle file and check it again before use"
