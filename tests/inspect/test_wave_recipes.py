"""Waves are found with their period, amplitude and decay, and nothing is found in calm water."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from seatrial.inspect.waves import waves
from seatrial.trial.trial import Trial

DT = 0.1


def recording(amplitude: float, period: float, seed: int, decay: float = 0.0) -> Trial:
    """Heave in random waves of a narrow band around a period, over coloured noise."""
    rng = np.random.default_rng(seed)
    t = DT * np.arange(12_000)
    slow = np.zeros(len(t))
    for k in range(1, len(t)):
        slow[k] = 0.98 * slow[k - 1] + rng.normal(0.0, 0.004)
    depth = 3.0 + 2.0 * (np.sin(2.0 * np.pi * t / 600.0) + 1.0)
    parts = 2.0 * np.pi / (period * rng.uniform(0.97, 1.03, 12))
    phases = rng.uniform(0.0, 2.0 * np.pi, 12)
    swell = np.cos(parts[:, None] * t + phases[:, None]).sum(axis=0) / np.sqrt(12.0)
    heave = slow + amplitude * swell * np.exp(-decay * (depth - 3.0)) + rng.normal(0.0, 0.002, len(t))
    return Trial.read({"t_s": t, "w_m_s": heave, "z_m": depth}, align=False)


@pytest.mark.parametrize("period", [4.0, 6.0, 10.0])
@pytest.mark.parametrize("seed", range(3))
def test_period_and_amplitude(period: float, seed: int) -> None:
    found = waves(recording(0.1, period, seed))
    assert found is not None
    assert found.period_s == pytest.approx(period, rel=0.08)
    assert found.amplitude["w"] == pytest.approx(0.1, rel=0.35)
    assert found.share["w"] > 0.3


@pytest.mark.parametrize("seed", range(5))
def test_calm_water_has_no_waves(seed: int) -> None:
    assert waves(recording(0.0, 6.0, seed)) is None


def test_motion_fades_with_depth() -> None:
    omega = 2.0 * np.pi / 6.0
    found = waves(recording(0.2, 6.0, 1, decay=omega**2 / 9.81))
    assert found is not None
    assert abs(found.decay_1_m - omega**2 / 9.81) < 3.0 * found.decay_deviation_1_m < 0.15


def short(seconds: float, amplitude: float, seed: int) -> Trial:
    """A minute or two of six velocities that wander, three of them in a sea of a broad band."""
    random = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, DT)
    parts = 2.0 * np.pi / (random.uniform(5.0, 9.0) * random.uniform(0.85, 1.15, 20))
    swell = np.cos(parts[:, None] * t + random.uniform(0.0, 2.0 * np.pi, (20, 1))).sum(axis=0) / np.sqrt(20.0)
    table = {"t_s": t}
    for name, keeps, size, wave in (
        ("u_m_s", 0.98, 0.004, 0.0),
        ("v_m_s", 0.98, 0.004, 1.0),
        ("w_m_s", 0.98, 0.004, 1.0),
        ("p_deg_s", 0.95, 0.1, 0.0),
        ("q_deg_s", 0.95, 0.1, 30.0),
        ("r_deg_s", 0.95, 0.1, 0.0),
    ):
        wandering = lfilter([1.0], [1.0, -keeps], random.normal(0.0, size, len(t)))
        noise = random.normal(0.0, 0.5 * size, len(t))
        table[name] = wandering + noise + amplitude * wave * swell
    return Trial.read(table, align=False)


@pytest.mark.long
@pytest.mark.parametrize("seconds", [60.0, 120.0])
def test_law_a_short_log_of_calm_water_seldom_shows_waves(seconds: float) -> None:
    # Held without waves in 299 of 300; the bound is that of a rate of 1 % in 40, once in a thousand.
    assert sum(waves(short(seconds, 0.0, seed)) is not None for seed in range(40)) <= 3


def test_law_waves_that_several_axes_show_are_found_in_two_minutes() -> None:
    found = [waves(short(120.0, 0.1, seed)) for seed in range(40)]
    assert sum(one is not None and 4.0 < one.period_s < 10.5 for one in found) >= 38
