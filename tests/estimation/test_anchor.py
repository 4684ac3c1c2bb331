"""The homogeneous direction, what holds the scale in a campaign, and what absolute anchors imply."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seatrial._core import State, Vehicle
from seatrial.base.errors import CampaignError
from seatrial.campaign.campaign import Campaign
from seatrial.estimation.scale import (
    added_mass_factor,
    homogeneity,
    homogeneous_direction,
    implied,
    judge_scale,
    ratios,
    scaled,
)
from seatrial.problem.settings import Anchor
from seatrial.vehicle.actuators import bollard

VEHICLES = [*Vehicle.names(), str(Path(__file__).parents[1] / "core" / "every_term.toml")]
CENTRES = {f"{axis}_{centre}" for axis in "xyz" for centre in "gb"}
BELUGA = Vehicle.load("beluga")

CAMPAIGN = """
format = 1
name = "tank"
vehicle = "beluga"
{top}
[trials.run]
file = "run.csv"
[[stages]]
name = "all"
trials = ["run"]
axes = {{ free = "{free}" }}
[stages.coefficients]
{coefficients}
"""
SURGE = "X_udot = [-300.0, -1.0]\nX_u = [-90.0, 0.0]\nX_uu = [-300.0, 0.0]\n"


def campaign(coefficients: str = SURGE, *, free: str = "X", top: str = "", anchor: str = "") -> Campaign:
    t = np.arange(0.0, 30.0, 0.1)
    frame = {"t_s": t, "voltage_v": np.full(len(t), 14.8)}
    frame |= {name: np.sin(0.3 * t) for name in ("u_m_s", "v_m_s", "w_m_s", "p_deg_s", "q_deg_s", "r_deg_s")}
    frame |= {f"cmd.{name}": 1580.0 + 100.0 * np.sin(0.3 * t) for name in BELUGA.actuators}
    frame |= {f"tau.{row}": np.sin(0.3 * t) for row in ("X_n", "Y_n", "Z_n", "K_nm", "M_nm", "N_nm")}
    text = CAMPAIGN.format(top=top, free=free, coefficients=coefficients) + anchor
    return Campaign.from_toml(text, source="tank.toml", trials={"run": frame})


def anchors(**sections: Any) -> Anchor:
    return Anchor.model_validate(sections)


@pytest.mark.parametrize("name", VEHICLES)
@given(factor=st.floats(0.05, 20.0), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_law_scaling_every_member_changes_no_acceleration(name: str, factor: float, seed: int) -> None:
    vehicle = Vehicle.load(name)
    random = np.random.default_rng(seed)
    nu, attitude = random.normal(size=(8, 6)), random.uniform(-1.0, 1.0, (8, 3))
    tau, current = 50.0 * random.normal(size=(8, 6)), 0.3 * random.normal(size=3)
    expected = vehicle.acceleration(nu, attitude, tau, current)
    found = scaled(vehicle, factor).acceleration(nu, attitude, factor * tau, current)
    # Rounding of the mass matrix's inverse, whose condition is some hundreds.
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", VEHICLES)
def test_law_the_scaled_vehicle_moves_alike_under_the_same_commands(name: str) -> None:
    vehicle = Vehicle.load(name)
    t, random = np.arange(0.0, 10.0, 0.1), np.random.default_rng(1)
    commands: dict[str, Any] = {}
    for actuator, facts in vehicle.actuator_info().items():
        step = facts["maximum_ahead"] if np.isfinite(facts["maximum_ahead"]) else 50.0
        commands[actuator] = facts["neutral"] + np.repeat(random.uniform(-0.7, 0.7, 5), 20) * step
    needs = any(facts["needs_voltage"] for facts in vehicle.actuator_info().values())
    voltage = np.full(len(t), 15.0) if needs else None
    start = State(nu=[0.5, 0.1, -0.1, 0.05, 0.02, -0.1])
    runs = [one.simulate(t, commands, start, voltage_v=voltage) for one in (vehicle, scaled(vehicle, 0.29))]
    # Rounding, grown over 100 samples of a motion without exponential growth.
    np.testing.assert_allclose(runs[0].nu, runs[1].nu, atol=1e-9)
    np.testing.assert_allclose(runs[0].position, runs[1].position, atol=1e-8)
    np.testing.assert_allclose(0.29 * runs[0].tau, runs[1].tau, atol=1e-8)


@pytest.mark.parametrize("name", VEHICLES)
def test_law_no_member_may_stay_behind(name: str) -> None:
    """Each hull coefficient of the direction acts: left out, the motion changes."""
    vehicle = Vehicle.load(name)
    random = np.random.default_rng(2)
    nu, attitude = random.normal(size=(20, 6)), random.uniform(-1.0, 1.0, (20, 3))
    expected = np.asarray(vehicle.acceleration(nu, attitude, np.zeros(6)))
    direction, values = homogeneous_direction(vehicle), vehicle.coefficients()
    hull = {name for name, value in values.items() if "." not in name and value}
    assert {name for name in direction if "." not in name} == hull - CENTRES
    for member in hull - CENTRES:
        behind = scaled(vehicle, 1.2).with_coefficients({member: values[member]})
        assert np.abs(behind.acceleration(nu, attitude, np.zeros(6)) - expected).max() > 1e-6, member


@pytest.mark.parametrize("name", VEHICLES)
@given(factor=st.floats(0.1, 10.0))
@settings(max_examples=5, deadline=None)
def test_law_ratios_to_the_thrust_do_not_depend_on_the_scale(name: str, factor: float) -> None:
    vehicle = Vehicle.load(name)
    found = ratios(scaled(vehicle, factor), vehicle)
    expected = ratios(vehicle, vehicle)
    assert found.keys() == expected.keys()
    # W - B is a difference of like numbers: rounding beside the weight, not beside itself.
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert expected["m - X_udot"] == pytest.approx(vehicle.mass_matrix()[0][0])


def test_thrust_that_is_held_carries_the_scale_though_the_mass_is_held_too() -> None:
    found = homogeneity(campaign().problem())
    # Mass acts in surge only beside the free added mass.
    assert [one.kind for one in found.held] == ["thrust", "static moment"]
    assert found.held[0].members == ("horizontal",)
    assert found.free == ("X_u", "X_udot", "X_uu")
    assert "The scale rests on the thrust of horizontal as in the vehicle file" in found.sentences()


def test_with_free_gains_the_mass_carries_the_scale_where_added_mass_is_held() -> None:
    found = homogeneity(
        campaign('X_u = [-90.0, 0.0]\nX_uu = [-300.0, 0.0]\n"horizontal.gain" = [0.2, 2.0]').problem()
    )
    assert found.held[0].members == ("m - X_udot",)
    assert "The scale rests on m - X_udot" in found.sentences()


def test_with_gains_and_added_mass_free_nothing_carries_the_scale() -> None:
    found = homogeneity(campaign(SURGE + '"horizontal.gain" = [0.2, 2.0]').problem())
    assert [one.kind for one in found.held] == ["static moment"]
    assert "Nothing is held fixed" in " ".join(found.sentences())


def test_one_thruster_of_a_group_that_is_held_carries_the_scale() -> None:
    free = "".join(f'"thruster_{k}.gain" = [0.2, 2.0]\n' for k in (0, 3, 4))
    assert homogeneity(campaign(SURGE + free).problem()).held[0].members == ("thruster_7",)


def test_what_is_held_beside_the_thrust_is_named() -> None:
    found = homogeneity(campaign("X_udot = [-300.0, -1.0]\nX_u = [-90.0, 0.0]\n", free="XZ").problem())
    held = {one.kind: one.members for one in found.held}
    assert held["thrust"] == ("horizontal", "vertical")
    assert held["mass and inertia"] == ("m - Z_wdot",)
    assert held["net weight"] == ("m g - B",)
    assert held["damping, lift and bias"] == ("X_uu", "Z_w", "Z_ww")
    assert "Also held at the vehicle file's values: m - Z_wdot" in " ".join(found.sentences())


def test_a_logged_wrench_carries_the_scale() -> None:
    found = homogeneity(campaign(top='input = "tau"').problem())
    assert found.held[0].members == ("the logged wrench",)
    assert "The scale rests on the logged wrench" in found.sentences()


def test_golden_added_mass_of_ellipsoids() -> None:
    assert added_mass_factor((1.0, 1.0, 1.0), 1) == pytest.approx(0.5)
    # Lamb's factors of a prolate spheroid of l/d = 8.33, as the core has them: printed digits.
    hull = (25.0 / 3.0, 1.0, 1.0)
    assert added_mass_factor(hull, 0) == pytest.approx(0.02748, abs=5e-6)
    assert added_mass_factor(hull, 1) == pytest.approx(0.94791, abs=5e-6)


@given(st.tuples(*[st.floats(0.1, 10.0)] * 3))
def test_law_potentials_of_an_ellipsoid_sum_to_two(semi_axes: tuple[float, float, float]) -> None:
    """Poisson's equation inside the ellipsoid: alpha_0 + beta_0 + gamma_0 = 2 (Lamb, section 114)."""
    k = [added_mass_factor(semi_axes, axis) for axis in range(3)]
    assert sum(2.0 * one / (1.0 + one) for one in k) == pytest.approx(2.0, rel=1e-9)


TRUE = 0.31
"""True over identified forces of the vehicles below."""


def test_law_a_bollard_pull_gives_the_factor_back() -> None:
    commands = {"thruster_0": 1700.0, "thruster_3": 1690.0, "vertical": 1600.0}
    every = {"thruster_0": 1700.0, "thruster_3": 1690.0} | {f"thruster_{k}": 1600.0 for k in (1, 2, 5, 6)}
    force = bollard(scaled(BELUGA, TRUE), every, voltage_v=15.5)
    for i, axis in enumerate("XY"):
        pull = {"commands": commands, "voltage_v": 15.5, "axis": axis, "force_n": float(force[i])}
        (found,) = implied(BELUGA, anchors(bollard=pull | {"sd_percent": 5.0}))
        assert found.factor.value == pytest.approx(TRUE)
        assert found.factor.lower == pytest.approx(0.9 * TRUE)  # two standard deviations
        assert found.gains == pytest.approx({"horizontal": TRUE, "vertical": TRUE})


def test_law_a_ballast_that_sinks_gives_the_factor_back() -> None:
    weight = 7.0
    t = np.arange(0.0, 60.0, 0.1)
    tau = np.tile([0.0, 0.0, weight, 0.0, 0.0, 0.0], (len(t), 1))
    run = scaled(BELUGA, TRUE).simulate(t, {}, free="Z", tau=tau, voltage_v=np.full(len(t), 15.0))
    sink = float(np.asarray(run.nu)[-1, 2])
    ballast = {"mass_kg": weight / 9.81 + 0.2, "volume_m3": 2e-4, "sink_m_s": sink}
    # After 60 s, many time constants, the speed is steady to rounding.
    (found,) = implied(BELUGA, anchors(ballast=ballast))
    assert found.factor.value == pytest.approx(TRUE, rel=1e-6)


@pytest.mark.parametrize("key", ["roll_deg", "pitch_deg"])
def test_law_an_inclining_test_gives_the_factor_back(key: str) -> None:
    vehicle = BELUGA.with_coefficients({"x_g": 0.0, "x_b": 0.0, "y_g": 0.0, "y_b": 0.0})
    values, angle = vehicle.coefficients(), math.radians(11.0)
    righting = values["m"] * 9.81 * values["z_g"] - values["B"] * values["z_b"]
    x, y, z = 0.3, 0.25, 0.05
    # Moment of a weight w at [x, y, z] about the horizontal axis through O: w times its horizontal distance.
    arm = y * math.cos(angle) - z * math.sin(angle)
    if key == "pitch_deg":
        arm, angle = x * math.cos(-angle) + z * math.sin(-angle), -angle  # a weight at the bow: bow down
    weight = TRUE * righting * math.sin(abs(angle)) / arm
    ballast = {"mass_kg": weight / 9.81, key: math.degrees(angle), "position_m": [x, y, z]}
    (found,) = implied(vehicle, anchors(ballast=ballast))
    assert found.factor.value == pytest.approx(TRUE)


def test_law_commands_that_hold_a_ballast_give_the_factor_back() -> None:
    true = scaled(BELUGA, TRUE)
    up = -float(bollard(true, {f"thruster_{k}": 1700.0 for k in (2, 6)}, voltage_v=16.0)[2])
    values = true.coefficients()
    weight = up - (values["m"] * 9.81 - values["B"])
    ballast = {
        "mass_kg": weight / 9.81,
        "commands": {"thruster_2": 1700.0, "thruster_6": 1700.0},
        "voltage_v": 16.0,
    }
    (found,) = implied(BELUGA, anchors(ballast=ballast))
    assert found.factor.value == pytest.approx(TRUE)


def test_law_the_dry_mass_and_the_true_added_mass_give_the_factor_back() -> None:
    apparent = float(BELUGA.mass_matrix()[0][0])
    ratio = TRUE * apparent / 20.0 - 1.0
    dry = {"mass_kg": 18.0, "water_kg": 2.0, "added": [ratio, ratio]}
    (found,) = implied(BELUGA, anchors(dry_mass=dry))
    assert found.factor.value == pytest.approx(TRUE)
    assert found.mass_kg == 20.0
    assert found.added_kg["surge"] == pytest.approx(ratio * 20.0)


def test_dry_mass_of_beluga_makes_its_thrust_a_fraction_of_the_table() -> None:
    """What docs/validation.md finds: 153.9, 128.1 and 147.9 kg apparent mass at the table's thrust."""
    found = {"X_udot": -129.9, "Y_vdot": -104.1, "Z_wdot": -123.9, "B": 228.66, "z_b": -0.114}
    vehicle = BELUGA.with_coefficients(found | {"thruster_6.gain": 1.636})
    (one,) = implied(vehicle, anchors(dry_mass={"mass_kg": 24.0}), reference=BELUGA)
    # A study outside this project found 0.23 to 0.40 from 125 to 140 kg in surge.
    assert 0.18 < one.factor.lower < 0.24
    assert 0.32 < one.factor.upper < 0.42
    assert one.gains["horizontal"] == pytest.approx(one.factor.value)
    assert one.gains["thruster_6"] == pytest.approx(1.636 * one.factor.value)
    # 27 mm against the file's 10.6 mm; 1.8 N of 235 N net weight.
    assert 0.02 < one.centre_height_m < 0.04
    assert one.file_height_m == pytest.approx(0.0106)
    assert one.net_weight_n == pytest.approx(one.factor.value * (24.0 * 9.81 - 228.66))
    assert one.warnings == ()
    text = " ".join(one.sentences())
    assert "It implies thrust gains horizontal 0.26" in text
    assert "of 0.32 to 1.2 times 24 kg" in text


@pytest.mark.parametrize(
    ("change", "factor", "words"),
    [
        ({}, 0.1, "added mass in surge would be"),
        ({}, 0.1, "thrust gains outside 0.2 to 1.5: horizontal 0.1, vertical 0.1"),
        ({}, 2.0, "thrust gains outside 0.2 to 1.5"),
        ({"z_b": 0.01}, 0.5, "centre of gravity would lie above"),
        ({"B": 150.0}, 0.5, "net weight would be"),
    ],
)
def test_what_cannot_be_is_said(change: dict[str, float], factor: float, words: str) -> None:
    vehicle = BELUGA.with_coefficients(dict(change))
    force = factor * float(bollard(vehicle, {"thruster_0": 1800.0})[0])
    pull = {"commands": {"thruster_0": 1800.0}, "force_n": force}
    (found,) = implied(vehicle, anchors(bollard=pull))
    assert any(words in text for text in found.warnings), found.warnings


def test_a_plausible_anchor_is_no_cause_for_a_warning() -> None:
    force = 0.4 * float(bollard(BELUGA, {"thruster_0": 1800.0})[0])
    (found,) = implied(BELUGA, anchors(bollard={"commands": {"thruster_0": 1800.0}, "force_n": force}))
    assert found.warnings == ()


def test_an_anchor_with_the_wrong_sign_contradicts_the_vehicle() -> None:
    ballast = {"mass_kg": 0.5, "roll_deg": -10.0, "position_m": [0.0, 0.3, 0.0]}
    (found,) = implied(BELUGA, anchors(ballast=ballast))
    assert math.isnan(found.factor.value)
    assert "contradicts" in found.warnings[0]
    assert found.sentences()[0].endswith("no factor")


def test_without_an_anchor_one_is_asked_for() -> None:
    said = judge_scale(campaign().problem()).sentences()
    assert any(text.startswith("No absolute anchor is given") for text in said)


def test_before_the_identification_only_the_thrust_is_judged() -> None:
    force = 0.5 * float(bollard(BELUGA, {"thruster_0": 1700.0})[0])
    text = f"[anchor]\nbollard = {{ commands = {{ thruster_0 = 1700.0 }}, force_n = {force} }}\n"
    report = judge_scale(campaign(anchor=text + "dry_mass = { mass_kg = 24.0 }\n").problem())
    said = " ".join(report.sentences())
    assert "true thrust is 0.5 of the file's" in said
    assert "Judged after the identification: Dry mass" in said
    assert "added mass surge" not in said
    assert "No absolute anchor" not in said
    assert report.ratios == {}


def test_after_the_identification_everything_is_told_and_disagreement_is_a_warning() -> None:
    force = 1.2 * float(bollard(BELUGA, {"thruster_0": 1700.0})[0])
    text = f"[anchor]\nbollard = [{{ commands = {{ thruster_0 = 1700.0 }}, force_n = {force} }}]\n"
    planned = campaign(anchor=text + "dry_mass = { mass_kg = 24.0 }\n")
    report = judge_scale(planned.problem(), BELUGA)
    assert [one.factor.anchor for one in report.implied] == ["Bollard pull", "Dry mass"]
    said = " ".join(report.sentences())
    # 1.2 by the pull, 0.32 to 0.50 by the dry mass beside 104 kg.
    assert "WARNING the anchors disagree: bollard pull 1.2 and dry mass" in said
    assert "Divided by the thrust gain, for any scale: m - X_udot 104" in said
    json.dumps(report.to_dict())


def test_anchors_that_agree_are_said_to() -> None:
    one = bollard(BELUGA, {"thruster_0": 1700.0})[0]
    pulls = [{"commands": {"thruster_0": 1700.0}, "force_n": float(share * one)} for share in (0.40, 0.44)]
    lines = [f"{{ commands = {{ thruster_0 = 1700.0 }}, force_n = {pull['force_n']} }}" for pull in pulls]
    report = judge_scale(campaign(anchor=f"[anchor]\nbollard = [{', '.join(lines)}]\n").problem(), BELUGA)
    assert any(text.startswith("The anchors agree") for text in report.sentences())


@pytest.mark.parametrize(
    ("section", "words"),
    [
        ("ballast = { mass_kg = 1.0 }", "give one answer to the ballast"),
        ("ballast = { mass_kg = 1.0, sink_m_s = 0.1, roll_deg = 3.0 }", "found roll_deg and sink_m_s"),
        ("ballast = { mass_kg = 1.0, roll_deg = 3.0 }", "roll_deg needs position_m"),
        ("dry_mass = { mass_kg = 0.0 }", "anchor, dry_mass, key mass_kg"),
        ("dry_mas = { mass_kg = 24.0 }", 'did you mean "dry_mass"?'),
        ("bollard = { commands = {}, force_n = 3.0 }", "anchor, bollard[1], key commands"),
    ],
)
def test_a_broken_anchor_is_named_with_its_key(section: str, words: str) -> None:
    with pytest.raises(CampaignError) as caught:
        campaign(anchor=f"[anchor]\n{section}\n")
    assert str(caught.value).startswith("tank.toml: ")
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("section", "words"),
    [
        ({"bollard": {"commands": {"thruster_9": 1700.0}, "force_n": 3.0}}, "unknown actuator 'thruster_9'"),
        ({"bollard": {"commands": {"vertical": 1700.0}, "force_n": 3.0}}, "no force along X"),
        ({"ballast": {"mass_kg": 1.0, "commands": {"vertikal": 1.0}}}, 'did you mean "vertical"?'),
    ],
)
def test_an_anchor_that_does_not_fit_the_vehicle_is_refused(section: dict[str, Any], words: str) -> None:
    with pytest.raises(CampaignError, match="anchor") as caught:
        implied(BELUGA, anchors(**section))
    assert words in str(caught.value)


def test_without_measures_of_the_hull_the_added_mass_is_asked_for() -> None:
    vehicle = Vehicle.load(VEHICLES[-1])
    with pytest.raises(CampaignError, match=r"give added = \[least, most\]"):
        implied(vehicle, anchors(dry_mass={"mass_kg": 100.0}))
