"""Current from velocity over ground and through water, against a known one."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import seatrial as st
from seatrial.base.frames import from_euler, matrix
from seatrial.trial.assembly import water_current

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


@pytest.mark.parametrize("also", [True, False])
def test_a_log_mounted_the_wrong_way_round_gives_the_same_current(also: bool) -> None:
    table = _log(np.tile([0.2, -0.1, 0.0], (len(T), 1)))
    euler = np.deg2rad(np.stack([table[name] for name in ("roll_deg", "pitch_deg", "yaw_deg")], axis=1))
    over = np.stack([table[name] for name in ("u_m_s", "v_m_s", "w_m_s")], axis=1)
    places = np.cumsum(np.einsum("nij,nj->ni", matrix(from_euler(euler)), over), axis=0) * 0.1
    table |= dict(zip(("x_m", "y_m", "z_m"), places.T, strict=True))
    right = st.Trial.read(table).current
    wrong = table | {"u_m_s": -table["u_m_s"]}
    # Where only the velocity over ground has a wrong sign, that through the water stays.
    trial = st.Trial.read(wrong | ({"u_water_m_s": -table["u_water_m_s"]} if also else {}))
    assert right is not None
    assert trial.current is not None
    np.testing.assert_allclose(trial.current, right, atol=1e-9)
    assert ("u_water_m_s = { from" in str(trial.report)) == also


@pytest.mark.parametrize("noise", [0.1, 0.2])
def test_noise_alone_is_no_change_of_the_current(noise: float) -> None:
    t = np.arange(0.0, 3600.0, 0.2)
    upright = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    steady = 0
    for seed in range(20):
        random = np.random.default_rng(seed)
        difference = np.array([0.2, -0.1, 0.0]) + random.normal(0.0, noise, (len(t), 3))
        found = water_current(t, difference, upright, t >= 0.0)
        assert found is not None
        steady += found.steady
    # 180 medians, each four deviations away in one case of 16000: in one hour out of 90.
    assert steady >= 18


def test_velocities_that_fit_no_water_are_a_warning() -> None:
    table = _log(np.tile([0.2, -0.1, 0.0], (len(T), 1)))
    assert not [f for f in st.Trial.read(table).report.findings if f.level == "warning"]
    wrong = st.Trial.read(table | {"u_water_m_s": -table["u_water_m_s"]})
    assert any(
        f.level == "warning" and "check sign, unit and frame of both" in str(f) for f in wrong.report.findings
    )
