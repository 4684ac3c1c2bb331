"""Tables of thrust: least squares at the knots, dead band, voltages, surfaces."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from seatrial.base.errors import TrialError
from seatrial.bench_test.regression import from_points, from_surface, levels

Array = NDArray[np.float64]
SIGNAL = np.linspace(-400.0, 400.0, 161)


def pulse(signal: Array, volts: float = 12.0) -> Array:
    """Thrust of a made-up speed controller with a dead band of 30 us."""
    beyond = np.maximum(np.abs(signal) - 30.0, 0.0)
    return np.asarray(np.sign(signal) * beyond**1.6 * volts / 1200.0 * np.where(signal < 0.0, 0.8, 1.0))


def test_the_table_stays_within_its_tolerance_with_few_knots() -> None:
    thrust = pulse(SIGNAL)
    found = from_points(SIGNAL, thrust, None, knots=60, tolerance=1.3, where="test")
    assert np.abs(found.residual).max() <= 1.3
    # At rest a quarter of it is allowed, so the chords are shorter there.
    assert np.abs(found.residual[np.abs(SIGNAL) < 60.0]).max() <= 0.25 * 1.3 + 0.75 * 1.3 * 3.0 / 128.0
    assert len(found.signal) < 30
    np.testing.assert_allclose(thrust - found.at(SIGNAL), found.residual, atol=1e-12)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_table_of_one_direction_has_no_thrust_at_rest(side: float) -> None:
    signal = side * np.linspace(40.0, 400.0, 37)
    found = from_points(signal, pulse(signal), None, knots=25, tolerance=None, where="test")
    assert found.at(np.array([0.0, -side * 100.0])).tolist() == [0.0, 0.0]
    # One per cent of the largest thrust, as is the default.
    assert np.abs(found.residual).max() <= 0.01 * np.abs(pulse(signal)).max()


def test_no_more_knots_than_allowed() -> None:
    found = from_points(SIGNAL, pulse(SIGNAL), None, knots=8, tolerance=1e-6, where="test")
    assert len(found.signal) == 8


def test_thrust_is_exactly_zero_in_the_dead_band_in_spite_of_noise() -> None:
    noisy = pulse(SIGNAL) + 0.02 * np.random.default_rng(1).standard_normal(161)
    found = from_points(SIGNAL, noisy, None, knots=25, tolerance=None, where="test")
    # What pulls less than 0.2 % of the largest thrust, 0.26 N, counts as nothing: 35 us give 0.13 N.
    assert found.dead_band == (-35.0, 35.0)
    np.testing.assert_array_equal(found.at(np.linspace(-30.0, 30.0, 13)), 0.0)
    assert (found.at(np.linspace(31.0, 400.0, 50)) >= 0.0).all()
    assert (found.at(np.linspace(-400.0, -31.0, 50)) <= 0.0).all()


def test_noise_is_averaged_not_copied() -> None:
    rng = np.random.default_rng(2)
    noisy = pulse(SIGNAL) + 0.5 * rng.standard_normal(161)
    found = from_points(SIGNAL, noisy, None, knots=25, tolerance=None, where="test")
    # 25 free numbers of 161 points leave sqrt(25/161) = 0.39 of the noise, 0.2 N; the chords err by as much.
    assert np.sqrt(np.mean((found.at(SIGNAL) - pulse(SIGNAL)) ** 2)) < 0.3


def test_levels_of_voltage_share_one_grid_and_are_bilinear_between() -> None:
    signal = np.tile(SIGNAL, 3)
    voltage = np.repeat([10.0, 12.0, 16.0], 161)
    thrust = np.concatenate([pulse(SIGNAL, v) for v in (10.0, 12.0, 16.0)])
    found = from_points(signal, thrust, voltage, knots=30, tolerance=None, where="test")
    np.testing.assert_allclose(found.voltage_v, [10.0, 12.0, 16.0])
    assert found.force.shape == (3, len(found.signal))
    # Thrust is proportional to the voltage here, so linear in between; held beyond.
    middle = found.at(SIGNAL, np.full(161, 14.0))
    np.testing.assert_allclose(
        middle, 0.5 * (found.force_at(1, SIGNAL) + found.force_at(2, SIGNAL)), atol=1e-12
    )
    np.testing.assert_allclose(found.at(SIGNAL, np.full(161, 99.0)), found.force_at(2, SIGNAL), atol=1e-12)
    assert [row["points"] for row in found.errors()] == [161.0, 161.0, 161.0]


def test_a_gap_at_one_voltage_is_bridged() -> None:
    some = (SIGNAL < 100.0) | (SIGNAL > 300.0)
    signal = np.concatenate([SIGNAL, SIGNAL[some]])
    voltage = np.concatenate([np.full(161, 10.0), np.full(int(some.sum()), 12.0)])
    thrust = np.concatenate([pulse(SIGNAL, 10.0), pulse(SIGNAL[some], 12.0)])
    found = from_points(signal, thrust, voltage, knots=25, tolerance=None, where="test")
    gap = np.array([150.0, 200.0, 250.0])
    # A chord from 100 to 300 us is up to 3.8 N off, straight on from one side would be 20 N off.
    np.testing.assert_allclose(found.force_at(1, gap), pulse(gap, 12.0), atol=4.0)


def test_a_voltage_that_sags_has_no_levels_and_a_surface_needs_none() -> None:
    with pytest.raises(TrialError, match=r"voltage has no distinct levels .*from 14.00 to 16.00 V"):
        levels(np.linspace(14.0, 16.0, 50), "test")
    with pytest.raises(TrialError, match="not known at every point"):
        levels(np.array([12.0, np.nan]), "test")
    voltage = np.linspace(14.0, 16.0, 161)
    thrust = 1e-4 * SIGNAL * np.abs(SIGNAL) * voltage
    found = from_surface(
        lambda s, v: 1e-4 * s * np.abs(s) * v,
        SIGNAL,
        thrust,
        voltage,
        grid=np.linspace(-400.0, 400.0, 33).tolist(),
        voltages=[14.0, 15.0, 16.0],
    )
    # Chords of a parabola over 25 us: f'' h²/8 = 2e-4 x 16 x 25² / 8.
    assert np.abs(found.residual).max() < 0.26


@pytest.mark.parametrize(
    ("signal", "thrust", "words"),
    [
        (np.array([-1.0, 0.0, 1.0]), np.array([-1.0, 0.0, 1.0]), "at least 4 different signals, found 3"),
        (SIGNAL, 0.0 * SIGNAL, "no point has any thrust"),
    ],
)
def test_points_that_make_no_table_are_refused(signal: Array, thrust: Array, words: str) -> None:
    with pytest.raises(TrialError, match=words):
        from_points(signal, thrust, None, knots=10, tolerance=None, where="test")
