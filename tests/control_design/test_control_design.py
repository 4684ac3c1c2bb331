"""Trims, what the actuators reach, and the sampled closed loop with its margins."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from seatrial._core import State, Vehicle
from seatrial.base.arrays import Array
from seatrial.control_design.loops import (
    STATES,
    Plant,
    closed,
    feedback,
    plant,
    restoring_law,
    sampled,
    step_response,
    trim,
    with_law,
)
from seatrial.control_design.margins import least_margins
from seatrial.vehicle.actuators import Delay, commandable, delays, mixing, reach
from seatrial.vehicle.stability import neutral_fins
from seatrial.vehicle.steady_state import cruise

NAMES = ("cwolf", "remus100", "lauv", "bluerov2-heavy", "beluga")
CWOLF, REMUS, LAUV, ROV, BELUGA = (Vehicle.load(name) for name in NAMES)


@pytest.mark.parametrize(
    ("vehicle", "speed", "rows"),
    [
        (CWOLF, 1.5, "XMN"),
        (CWOLF, 0.0, "XZMN"),
        (REMUS, 1.8, "XMN"),
        (LAUV, 1.5, "XKMN"),
        (ROV, 0.5, "XYZKMN"),
    ],
)
def test_law_nothing_accelerates_at_a_trim(vehicle: Vehicle, speed: float, rows: str) -> None:
    at = trim(vehicle, speed, rows)
    assert at is not None
    rest = np.asarray(vehicle.acceleration(at.nu, at.attitude, at.tau))
    # The root is sought to 1e-6 m/s^2 times inertia over row inertia.
    assert np.abs(rest).max() < 2e-5
    t = np.array([0.0, 0.01])
    held = np.tile(at.tau, (2, 1)) - _neutral(vehicle, at.nu)
    run = vehicle.simulate(t, {}, State(nu=at.nu, attitude=at.attitude), tau=held, voltage_v=np.full(2, 14.8))
    assert np.abs(np.asarray(run.nu)[-1] - at.nu).max() < 1e-6
    # Straight and level: the velocity over ground has no component down.
    assert abs(np.asarray(run.position)[-1, 2]) < 1e-9


def _neutral(vehicle: Vehicle, nu: Array) -> Array:
    return np.asarray(neutral_fins(vehicle, nu[None])[0])


def test_trim_is_the_cruise_of_the_performance_check() -> None:
    found, at = cruise(CWOLF, 1.5), trim(CWOLF, 1.5, "XZMN")
    assert found is not None
    assert at is not None
    assert at.tau[0] == pytest.approx(found.thrust_n, rel=1e-6)


def test_a_light_vehicle_flies_bow_down_and_too_slow_not_at_all() -> None:
    """REMUS is 7 N too light; its lift carries that from about 0.5 m/s on."""
    pitches = []
    for speed in (1.0, 1.5, 2.0):
        at = trim(REMUS, speed, "XMN")
        assert at is not None
        pitches.append(float(at.attitude[1]))
    assert pitches[0] < pitches[1] < pitches[2] < 0.0
    assert trim(REMUS, 0.3, "XMN") is None
    assert trim(CWOLF, 0.0, "XMN") is None


def test_rows_that_a_vehicle_cannot_command_are_named() -> None:
    left_out = {name: "".join(commandable(Vehicle.load(name), 1.0)) for name in NAMES}
    assert left_out == {"cwolf": "YK", "remus100": "YZK", "lauv": "YZ", "bluerov2-heavy": "", "beluga": ""}
    assert "no reach" in commandable(REMUS, 0.0)["N"]  # fins do nothing at rest


def test_reach_is_what_the_actuators_give() -> None:
    # Four stern propellers of 82.67 N, cos 15 deg each way; a fin's force grows with the square.
    assert reach(CWOLF, 0.0, "XZMN")["X"][1] == pytest.approx(4.0 * 82.67 * 0.9330, rel=2e-3)
    slow, fast = (reach(LAUV, speed, "XMN")["N"][1] for speed in (0.75, 1.5))
    assert fast == pytest.approx(4.0 * slow, rel=1e-3)
    assert mixing(REMUS, "XMN")[2, 1] == pytest.approx(
        1.0 / 0.638, rel=1e-9
    )  # the stern planes' force over their lever
    late = delays(CWOLF, "XN")["N"]
    assert [late.lag_s, late.dead_s, late.ramp_s] == pytest.approx([0.15, 0.1, 0.1])


def double_integrator() -> Plant:
    """Heading and yaw rate of an inertia of 2 kg m^2."""
    return Plant(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [0.5]]), (3, 9), "N")


def law(k_p: float, k_d: float, k_i: float = 0.0) -> Array:
    full = np.zeros((6, len(STATES)))
    full[5, [3, 9, 14]] = k_p, k_d, k_i
    return full


@pytest.mark.parametrize("dead_s", [0.0, 0.04, 0.1, 0.17, 0.23])
def test_law_sampling_with_lag_and_dead_time_is_the_continuous_motion(dead_s: float) -> None:
    """Against small exact steps of the same chain, for demands that change every period."""
    period, fine = 0.1, 0.01
    system = sampled(double_integrator(), {"N": Delay(0.15, dead_s, 0.05)}, period, ())
    a = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.5], [0.0, 0.0, -5.0]])
    step = expm(np.block([[a, np.array([[0.0], [0.0], [5.0]])], [np.zeros((1, 4))]]) * fine)
    demands = np.random.default_rng(3).standard_normal(40)
    x, y = np.zeros(len(system.phi)), np.zeros(3)
    per = round(period / fine)
    for k in range(40 * per):
        late = k - round(dead_s / fine)
        y = step[:3, :3] @ y + step[:3, 3] * (demands[late // per] if late >= 0 else 0.0)
        if (k + 1) % per == 0:
            x = system.phi @ x + system.gamma[:, 0] * demands[k // per]
            # Rounding of some hundred matrix products.
            assert x[:3] == pytest.approx(y, abs=1e-10)


def test_lit_astrom_wittenmark_margins_of_a_double_integrator() -> None:
    """PD on 1/(J s^2) in continuous time: |L| = 1 at w^2 = (d^2 + sqrt(d^4 + 4 k^2))/2, k and d over J."""
    k_p, k_d, inertia = 0.5, 1.8, 2.0
    k, d = k_p / inertia, k_d / inertia
    crossover = np.sqrt((d**2 + np.sqrt(d**4 + 4.0 * k**2)) / 2.0)
    phase = np.rad2deg(np.arctan2(d * crossover, k))
    system = sampled(double_integrator(), {"N": Delay(0.0, 0.0, 0.0)}, 0.005, ())
    found = least_margins(system, law(k_p, k_d))
    # The grid of frequencies is 0.6 % wide; sampling takes half a period, 0.14 deg.
    assert found.phase_deg == pytest.approx(phase, abs=0.5)
    assert found.delay_s == pytest.approx(np.deg2rad(phase) / crossover, rel=1e-2)
    assert found.stable


def test_law_a_delay_beyond_the_margin_is_unstable() -> None:
    gain = law(0.5, 1.8, 0.05)
    margin = least_margins(
        sampled(double_integrator(), {"N": Delay(0.0, 0.0, 0.0)}, 0.02, ("heading",)), gain
    ).delay_s
    for share, stable in ((0.95, True), (1.05, False)):
        system = sampled(double_integrator(), {"N": Delay(0.0, share * margin, 0.0)}, 0.02, ("heading",))
        assert least_margins(system, gain).stable == stable


def test_law_an_integral_brings_the_step_response_to_its_reference() -> None:
    system = sampled(double_integrator(), {"N": Delay(0.1, 0.1, 0.0)}, 0.1, ("heading",))
    answer = step_response(system, law(0.5, 1.8, 0.02), "heading", 300.0)
    # The slowest pole, -0.04 1/s, leaves e^(-12).
    assert answer[-1] == pytest.approx(1.0, abs=1e-4)
    assert answer.max() < 1.25


def test_law_the_restoring_feed_forward_takes_the_stiffness_away() -> None:
    level = trim(ROV, 0.0, "XYZKMN")
    assert level is not None
    loops = ("surge", "sway", "heave", "roll", "pitch", "heading")
    quick = dict.fromkeys("XYZKMN", Delay(0.0, 0.0, 0.0))
    system = sampled(plant(ROV, level, loops), quick, 0.001, loops)
    fed = with_law(system, restoring_law(ROV, "XYZKMN"))
    tilted = np.zeros(len(system.phi))
    tilted[[system.columns.index(1), system.columns.index(2)]] = 0.1
    rates = [system.columns.index(7), system.columns.index(8)]
    own, free = tilted.copy(), tilted.copy()
    for _ in range(200):
        own, free = system.phi @ own, fed.phi @ free
    # After 0.2 s the hull alone has turned back; with its stiffness gone only the period's delay is left.
    assert np.abs(free[rates]).max() < 0.05 * np.abs(own[rates]).min()
    assert np.array_equal(closed(system, restoring_law(ROV, "XYZKMN")), fed.phi)
    assert feedback(system, restoring_law(ROV, "X")).max() == 0.0
