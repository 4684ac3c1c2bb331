"""Laws of the smoothing spline."""

from __future__ import annotations

import numpy as np
import pytest

from seatrial.trial.assembly import smooth, spline

H = 0.1
T = np.linspace(0.0, 399 * H, 400)
EVERYWHERE = np.ones(len(T), bool)


def test_law_a_parabola_is_left_as_it_is() -> None:
    y = (3.0 - 0.5 * T + 0.02 * T**2)[:, None]
    np.testing.assert_allclose(smooth(y, EVERYWHERE), y, atol=1e-6)  # solved with a condition of 1e9


def test_law_noise_falls_and_slow_motion_stays() -> None:
    truth = np.stack([np.sin(0.5 * T), 0.3 * np.cos(0.8 * T)], axis=1)
    noise = 0.05 * np.random.default_rng(0).standard_normal(truth.shape)
    error = smooth(truth + noise, EVERYWHERE) - truth
    assert np.std(error) < 0.4 * np.std(noise)


def test_law_derivative_is_that_of_the_values() -> None:
    curve = spline(T, np.sin(0.7 * T)[:, None], EVERYWHERE)
    inner = T[20:-20]
    # linear fit per sample of an interpolating spline at 10 Hz: (omega h)^3
    np.testing.assert_allclose(curve(inner, 1)[:, 0], 0.7 * np.cos(0.7 * inner), atol=1e-3)


def test_masked_samples_have_no_say() -> None:
    truth = np.sin(0.5 * T)[:, None]
    valid = EVERYWHERE.copy()
    valid[100:103] = valid[250:265] = False
    wrong = np.where(valid[:, None], truth, 1e3)
    smoothed = smooth(wrong, valid)
    assert np.abs(smoothed - truth).max() < 0.05
    assert np.abs(smoothed - truth)[:90].max() < 1e-3


def test_nothing_valid_gives_zeros() -> None:
    np.testing.assert_array_equal(smooth(np.ones((20, 2)), np.zeros(20, bool)), 0.0)


@pytest.mark.parametrize("n", [10, 2000])
def test_short_and_long_records(n: int) -> None:
    y = np.sin(0.05 * np.arange(n))[:, None]
    np.testing.assert_allclose(smooth(y, np.ones(n, bool)), y, atol=5e-3)
