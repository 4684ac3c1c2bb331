"""Current from velocity over ground and through water, against a known one."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import seatrial as st
from seatrial.rotation import matrix

Array = NDArray[np.float64]

T = np.arange(0.0, 240.0, 0.1)
NOISE = 0.01


def _log(current: Array, *, drop: slice | None = None) -> dict[str, Array]:
    """A vehicle that circles at 1 m/s through water in a current (n, 3), with noise on both velocities."""
    random = np.random.default_rng(3)
    euler = np.stack([0.1 * np.sin(0.3 * T), 0.2 * np.cos(0.2 * T), 0.08 * T], axis=1)
    cr, sr = np.cos(euler / 2.0).T, np.sin(euler / 2.0).T
    q = np.stack(
        [
            cr[0] * cr[1] * cr[2] + sr[0] * sr[1] * sr[2],
            sr[0] * cr[1] * cr[2] - cr[0] * sr[1] * sr[2],
            cr[0] * sr[1] * cr[2] + sr[0] * cr[1] * sr[2],
            cr[0] * cr[1] * sr[2] - sr[0] * sr[1] * cr[2],
        ],
        axis=1,
    )
    through = np.tile([1.0, 0.1, -0.05], (len(T), 1))
    over = through + np.einsum("nji,nj->ni", matrix(q), current)
    table = {"t_s": T}
    for k, name in enumerate(("roll_deg", "pitch_deg", "yaw_deg")):
        table[name] = np.rad2deg(euler[:, k])
    for k, axis in enumerate("uvw"):
        table[f"{axis}_m_s"] = over[:, k] + random.normal(0.0, NOISE, len(T))
        water = through[:, k] + random.normal(0.0, NOISE, len(T))
        if drop is not None:
            water[drop] = np.nan
        table[f"{axis}_water_m_s"] = water
    return table


def test_a_steady_current_is_found_within_its_deviation() -> None:
    current = np.tile([0.21, -0.13, 0.02], (len(T), 1))
    trial = st.Trial.read(_log(current))
    assert trial.current is not None
    assert np.ptp(trial.current, axis=0) == pytest.approx(0.0)
    # Noise of both velocities over 2400 samples: median's efficiency 1.25, so 0.36 mm/s; four of them.
    assert np.abs(trial.current[0] - current[0]).max() < 4.0 * 1.2533 * np.sqrt(2.0) * NOISE / np.sqrt(len(T))
    assert any("from velocity over ground" in str(finding) for finding in trial.report.findings)


def test_a_changing_current_is_followed() -> None:
    current = np.stack([0.1 + 0.1 * T / T[-1], np.full(len(T), 0.05), np.zeros(len(T))], axis=1)
    trial = st.Trial.read(_log(current))
    assert trial.current is not None
    # Linear between the medians of four parts, held outside their middles: an eighth of the span of 0.1 m/s.
    assert np.abs(trial.current - current).max() < 0.0125 + 0.004
    assert "changing" in str(trial.report)


def test_drop_outs_of_the_water_track_do_not_count() -> None:
    current = np.tile([0.2, 0.0, 0.0], (len(T), 1))
    trial = st.Trial.read(_log(current, drop=slice(300, 1500)))
    assert trial.current is not None
    assert trial.current[0, 0] == pytest.approx(0.2, abs=0.003)


def test_a_recorded_current_is_left_and_too_little_water_track_is_said() -> None:
    current = np.tile([0.2, 0.0, 0.0], (len(T), 1))
    told = _log(current) | {"current_north_m_s": np.full(len(T), 0.5)}
    recorded = st.Trial.read(told).current
    assert recorded is not None
    assert recorded[0, 0] == 0.5
    silent = st.Trial.read(_log(current, drop=slice(20, None)))
    assert silent.current is None
    assert "too few samples" in str(silent.report)
