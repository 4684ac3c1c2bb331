"""Directions of thrusters from commands and motion, commands by the vehicle's names, stubs."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import seatrial as st
from seatrial.intake.survey import SurveyedLog
from seatrial.intake.vehicle_draft import (
    draft_vehicle,
    hull_inertia,
    matched,
    opposed,
    thruster_signs,
    turned,
)

AGAINST = ("thruster_3", "thruster_4", "thruster_6", "thruster_7")


def _trial(vehicle: st.Vehicle) -> st.Trial:
    """Recording of a mixer that drives surge, sway, heave, yaw and roll by slow random demands."""
    rng = np.random.default_rng(7)
    t = np.arange(0.0, 120.0, 0.1)
    demand = np.repeat(rng.normal(size=(6, 60)), 20, axis=1)
    demand[4] *= 0.2
    demand[3] *= 0.2
    mixed = np.sign(np.round(vehicle.allocation_matrix(), 3) * (np.abs(vehicle.allocation_matrix()) > 0.07))
    # Roll and pitch of the horizontal thrusters, by their depth, are not in the mixer's table.
    mixed[3:5, :4] = 0.0
    commands = mixed.T @ (40.0 * demand)
    named = {name: 1500.0 + y for name, y in zip(vehicle.actuators, commands, strict=True)}
    run = vehicle.simulate(t, named, voltage_v=np.full(len(t), 16.0))
    table = {"t_s": t, "voltage_v": np.full(len(t), 16.0)}
    table |= dict(zip(("q_w", "q_x", "q_y", "q_z"), run.attitude.T, strict=True))
    table |= dict(zip(("u_m_s", "v_m_s", "w_m_s"), run.nu[:, :3].T, strict=True))
    table |= {f"{c}_deg_s": np.rad2deg(run.nu[:, 3 + k]) for k, c in enumerate("pqr")}
    for name, y in named.items():
        table[f"cmd.{name}"] = 3000.0 - y if name in AGAINST else y
    return st.Trial.read(table, align=False)


def test_directions_come_from_the_commands_and_the_motion() -> None:
    vehicle = st.Vehicle.load("bluerov2-heavy")
    signs = thruster_signs(vehicle, _trial(vehicle), {})
    assert tuple(name for name, against in signs.items() if against) == AGAINST


def test_axes_that_point_to_port_and_upwards_answer_against_the_thrusters() -> None:
    vehicle = st.Vehicle.load("bluerov2-heavy")
    trial = _trial(vehicle)
    turned_back = {name: 3000.0 - y for name, y in trial.commands.items() if name in AGAINST}
    trial = replace(trial, commands=dict(trial.commands) | turned_back)
    assert opposed(vehicle, trial) == ""
    port_and_up = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
    against = opposed(vehicle, replace(trial, nu=trial.nu * port_and_up))
    assert set("YZN") <= set(against)
    assert "X" not in against


def test_parameters_of_the_log_decide_before_the_motion() -> None:
    vehicle = st.Vehicle.load("bluerov2-heavy")
    parameters = {f"MOT_{k}_DIRECTION": 1.0 if k == 1 else -1.0 for k in range(1, 9)}
    signs = thruster_signs(vehicle, _trial(vehicle), parameters)
    assert [name for name, against in signs.items() if against] == ["thruster_1"]


def test_turned_thrusters_push_the_other_way() -> None:
    vehicle = st.Vehicle.load("bluerov2-heavy")
    other = st.Vehicle.from_toml(turned(vehicle.to_toml(), {"thruster_2": True, "thruster_3": False}))
    assert other.actuator_info()["thruster_2"]["reversed"]
    assert not other.actuator_info()["thruster_3"]["reversed"]


@pytest.mark.parametrize(
    ("names", "actuator", "name"),
    [
        (["thruster_4"], "thruster_4", "thruster_4"),
        (["positive_width_us_0", "pwm_1", "pwm_2"], "thruster_0", "positive_width_us_0"),
        (["positive_width_us_0", "pwm_1", "pwm_2"], "thruster_2", "pwm_2"),
        (["vertical", "horizontal"], "thruster_1", "vertical"),
    ],
)
def test_commands_are_matched_by_name_group_or_number(names: list[str], actuator: str, name: str) -> None:
    assert matched(names, st.Vehicle.load("beluga"))[actuator] == name


@pytest.mark.parametrize(
    ("names", "planes"),
    [
        (["planes", "rudder"], "planes"),
        (["rudder", "elevator"], "elevator"),
        (["delta_s", "delta_r"], "delta_s"),
        (["rudder", "elevator", "planes"], None),  # which of them?
        (["rudder", "bow_planes"], None),
        (["rudder", "stern_plane_port"], None),  # half of them
    ],
)
def test_fins_take_the_usual_words_for_them(names: list[str], planes: str | None) -> None:
    found = matched(names, st.Vehicle.load("remus100"))
    assert found.get("stern_plane_starboard") == planes
    assert (
        found["rudder_upper"] == found["rudder_lower"] == next(n for n in names if n in ("rudder", "delta_r"))
    )


def test_stub_loads_once_its_measures_are_filled_in() -> None:
    log = SurveyedLog(Path("dive 1.csv"), "csv", (), (), (), (), (), {}, None)
    units = {"port": "us", "propeller": "rpm", "rudder": "deg"}
    stub = draft_vehicle([log], units, None)
    assert stub.vehicle is None
    measures = {"length_m": "1.6", "diameter_m": "0.2", "m": "30.0", "B": "294.3", "z_g": "0.02"}
    measures |= {
        "voltage_v": "[16.0]",
        "force_n": "[[-30.0, -9.0, 0.0, 0.0, 10.0, 40.0]]",
        "p1_ahead": "0.1",
        "area_m2": "0.006",
        "aspect_ratio": "2.0",
    }
    text = re.sub(
        r'(?m)^(\w+) = "FILL IN[^"]*"',
        lambda found: f"{found[1]} = {measures.get(found[1], '[0.0, -1.0, 0.0]')}",
        stub.text,
    )
    vehicle = st.Vehicle.from_toml(text)
    assert set(vehicle.actuators) == set(units)
    facts = vehicle.actuator_info()
    assert [facts[name]["unit"] for name in units] == ["us", "rpm", "rad"]


TAPE = """
format = 1
name = "tape"
controllable = ["X"]
[environment]
rho_kg_m3 = 1026.0
[geometry]
length_m = 1.6
diameter_m = 0.19
[coefficients]
m = 31.03
"""


def test_a_given_vehicle_without_inertia_gets_that_of_a_hull_as_full_as_it_is(tmp_path: Path) -> None:
    given = tmp_path / "tape.toml"
    given.write_text(TAPE)
    draft = draft_vehicle([], {}, given)
    assert draft.vehicle is not None
    found = draft.vehicle.coefficients()
    # As full as the spheroid of these axes: m (l^2 / 4 + r^2) / 5.
    assert found["I_y"] == found["I_z"] == pytest.approx(31.03 * (0.8**2 + 0.095**2) / 5.0, rel=0.01)
    assert draft.text.replace("\n".join(draft.text.split("\n")[10:14]) + "\n", "") == TAPE
    assert "67 % of its cylinder" in draft.source
    for own in ("I_y = 5.0\nI_z = 5.0\n", "B = 600.0\n", "B = 150.0\n"):
        given.write_text(TAPE + own)
        assert draft_vehicle([], {}, given).text == TAPE + own


def test_hulls_between_a_spheroid_and_a_cylinder() -> None:
    m, length, r = 30.0, 1.6, 0.1
    assert hull_inertia(m, length, r, 1.0) == pytest.approx(m * (length**2 + 3.0 * r**2) / 12.0)
    assert hull_inertia(m, length, r, 2.0 / 3.0) == pytest.approx(m * (length**2 / 4.0 + r**2) / 5.0)
    # A body of revolution with r(x)^2 = r^2 (1 - |2 x / l|^4), summed by slices.
    x = np.linspace(-0.5, 0.5, 20001) * length
    area = np.pi * r**2 * (1.0 - np.abs(2.0 * x / length) ** 4)
    slices = np.trapezoid(area * x**2 + area**2 / (4.0 * np.pi), x) / np.trapezoid(area, x)
    assert hull_inertia(m, length, r, 0.8) == pytest.approx(m * slices, rel=1e-6)
