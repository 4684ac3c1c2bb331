"""The plain NumPy actuator chain against closed-form responses."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from benchmarks.textbook_thrusters import (
    Newton,
    Polynomial,
    Quadratic,
    Table,
    Thruster,
    force_and_torque,
    motor_response,
    rate_limited,
    static_limits,
    thrust,
    wrench_per_newton,
)

PROPELLER = Quadratic(p1_ahead=0.0744, p1_astern=0.0531, p2=-0.602, q1=0.002, q2=-0.01)
STERN = Thruster(
    name="stern",
    wrench=wrench_per_newton([-1.0, 0.1, 0.0], [1.0, 0.0, 0.0]),
    characteristic=PROPELLER,
    maximum_ahead=2000.0,
    maximum_astern=1500.0,
    minimum_ahead=150.0,
    minimum_astern=100.0,
    n_acc=2000.0,
    n_dec=4000.0,
    T_1=0.15,
    T_t=0.1,
)
# Closed forms are compared after about a hundred exact updates of size 1e3 rpm.
ROUNDING = 1e-9


def test_static_limits_lift_clip_and_keep_zero() -> None:
    command = [2500.0, -2500.0, 10.0, -10.0, 0.0, 500.0]
    np.testing.assert_array_equal(static_limits(STERN, command), [2000.0, -1500.0, 150.0, -100.0, 0.0, 500.0])


def test_static_limits_dead_band() -> None:
    thruster = dataclasses.replace(STERN, below_minimum="zero")
    np.testing.assert_array_equal(
        static_limits(thruster, [10.0, -10.0, 150.0, -99.0]), [0.0, 0.0, 150.0, 0.0]
    )


def test_static_limits_count_from_neutral() -> None:
    thruster = dataclasses.replace(STERN, unit="us", neutral=1500.0, maximum_ahead=400.0, minimum_ahead=25.0)
    np.testing.assert_array_equal(static_limits(thruster, [1500.0, 1510.0, 1950.0]), [0.0, 25.0, 400.0])


def test_reversal_brakes_before_it_grows() -> None:
    assert rate_limited(1000.0, -1000.0, 0.1, 2000.0, 4000.0) == 600.0
    assert rate_limited(200.0, -1000.0, 0.1, 2000.0, 4000.0) == pytest.approx(-100.0, abs=ROUNDING)
    assert rate_limited(200.0, 0.0, 0.1, 2000.0, 4000.0) == 0.0
    assert rate_limited(0.0, -50.0, 0.1, 2000.0, 4000.0) == -50.0


def test_dead_time_between_samples_interpolates() -> None:
    thruster = dataclasses.replace(STERN, n_acc=np.inf, n_dec=np.inf, T_1=0.0, T_t=0.25)
    response = motor_response(thruster, np.full(6, 1000.0), 0.1)
    # 2.5 steps late: the third interval sees half the command; the value at a sample is the interval's end.
    np.testing.assert_allclose(response[::2], [0.0, 0.0, 0.0, 500.0, 1000.0, 1000.0], atol=ROUNDING)


@pytest.mark.parametrize("substeps", [1, 4])
def test_lit_pt1_step_response_is_exact(substeps: int) -> None:
    thruster = dataclasses.replace(STERN, n_acc=np.inf, n_dec=np.inf, T_t=0.0, K_V=0.9)
    response = motor_response(thruster, np.full(11, 1000.0), 0.1, substeps=substeps)
    halves = np.arange(len(response)) * 0.05 / substeps
    np.testing.assert_allclose(response, 900.0 * (1.0 - np.exp(-halves / 0.15)), atol=ROUNDING)


def test_lit_pt1_ramp_response_is_exact() -> None:
    thruster = dataclasses.replace(STERN, T_t=0.0)
    response = motor_response(thruster, np.full(10, 2000.0), 0.1)
    t = np.arange(len(response)) * 0.05
    ramp = 2000.0 * (t - 0.15 * (1.0 - np.exp(-t / 0.15)))
    np.testing.assert_allclose(response[t <= 0.9], ramp[t <= 0.9], atol=ROUNDING)


def test_initial_signal_is_held_through_the_dead_time() -> None:
    thruster = dataclasses.replace(STERN, K_V=0.9)
    response = motor_response(thruster, np.full(6, 100.0), 0.1, initial=450.0)
    np.testing.assert_allclose(response[:3], 450.0, atol=ROUNDING)
    assert response[4] < 440.0


def test_signal_does_not_depend_on_what_comes_later() -> None:
    command = np.array([0.0, 900.0, -1200.0, 300.0, 0.0, 2000.0, -2000.0])
    whole = motor_response(STERN, command, 0.1, substeps=2)
    np.testing.assert_array_equal(whole[:17], motor_response(STERN, command[:5], 0.1, substeps=2))


def test_quadratic_takes_revolutions_per_second_and_inflow() -> None:
    assert thrust(PROPELLER, 1200.0, V_a=1.5, voltage=None) == pytest.approx(0.0744 * 400 - 0.602 * 20 * 1.5)
    assert thrust(PROPELLER, -1200.0, V_a=1.5, voltage=None) == pytest.approx(
        -0.0531 * 400 - 0.602 * 20 * 1.5
    )
    assert thrust(PROPELLER, 0.0, V_a=1.5, voltage=None) == 0.0


def test_polynomial_has_one_set_per_direction() -> None:
    curve = Polynomial(ahead=(1.0, 0.1, 0.02), astern=(2.0, 0.2, 0.01))
    assert thrust(curve, 10.0, V_a=0.0, voltage=None) == pytest.approx(4.0)
    assert thrust(curve, -10.0, V_a=0.0, voltage=None) == pytest.approx(-5.0)
    assert thrust(curve, 0.0, V_a=0.0, voltage=None) == 0.0


def test_table_is_bilinear_and_held_at_the_edges() -> None:
    table = Table(
        signal=np.array([-400.0, 0.0, 400.0]),
        voltage=np.array([12.0, 16.0]),
        force=np.array([[-20.0, 0.0, 24.0], [-30.0, 0.0, 40.0]]),
    )
    assert thrust(table, 200.0, V_a=0.0, voltage=13.0) == pytest.approx(14.0)
    assert thrust(table, 700.0, V_a=0.0, voltage=18.0) == 40.0
    with pytest.raises(ValueError, match="expected a voltage"):
        thrust(table, 200.0, V_a=0.0, voltage=None)


def test_force_and_torque_scale_with_gain_deduction_wake_and_density() -> None:
    thruster = dataclasses.replace(STERN, gain=0.8, thrust_deduction=0.1, wake=0.25)
    force, torque = force_and_torque(thruster, 1200.0, inflow=2.0, voltage=None, density_ratio=0.97)
    assert force == pytest.approx(0.97 * 0.8 * 0.9 * (0.0744 * 400 - 0.602 * 20 * 1.5))
    assert torque == pytest.approx(0.97 * 0.8 * (0.002 * 400 - 0.01 * 20 * 1.5))
    newton = Thruster(name="n", wrench=np.zeros(6), characteristic=Newton(), unit="N")
    assert force_and_torque(newton, 12.0, inflow=2.0, voltage=None, density_ratio=0.97) == (12.0, 0.0)
