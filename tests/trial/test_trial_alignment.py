"""Latency and signs of velocity and rate sensors against the recorded pose."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl
import pytest

from seatrial.trial.signals import most_moving
from seatrial.trial.trial import Trial
from tests.trial import motion

T = np.arange(0.0, 120.0, 0.1)


@pytest.mark.parametrize(("velocity_late", "rates_late"), [(0.24, 0.075), (-0.13, 0.31), (0.05, -0.02)])
def test_latencies_are_found_between_the_samples_and_removed(velocity_late: float, rates_late: float) -> None:
    table = motion.columns(T, velocity_late=velocity_late, rates_late=rates_late, noise=1e-3)
    trial = Trial.read(table)
    # a hundredth of a sample: noise of 1 mm/s against a velocity of 0.5 m/s that changes within seconds
    assert trial.report.latencies["velocity"] == pytest.approx(velocity_late, abs=2e-3)
    assert trial.report.latencies["rates"] == pytest.approx(rates_late, abs=2e-3)
    inner = slice(5, -5)
    truth = motion.nu(T)[inner]
    assert np.abs(trial.nu[inner] - truth).max() < 0.01
    assert not trial.valid[-1, 0] or velocity_late < 0.0


def test_a_long_record_is_compared_where_it_moves() -> None:
    t = np.arange(0.0, 6000.0, 0.1)
    moving = motion.columns(t[:3000], noise=1e-3)
    still = {name: np.full(len(t) - 3000, y[0] if name != "u_m_s" else 0.0) for name, y in moving.items()}
    table = {name: np.concatenate([still[name], y]) for name, y in moving.items()} | {"t_s": t}
    table["u_m_s"] = -table["u_m_s"]
    messages = [finding.message for finding in Trial.read(table).report.findings if finding.subject == "u"]
    assert any("sign reversed here" in message for message in messages)


def test_the_stretch_that_moves_most_keeps_the_rate_of_every_channel() -> None:
    t = np.arange(0.0, 1000.0, 0.1)
    fast = np.where((t > 700.0) & (t < 900.0), np.sin(t), 0.01 * np.sin(t))
    found = most_moving({"yaw": (t, fast), "z": (t[::5], fast[::5])}, 2000)
    assert found["yaw"][0][[0, -1]] == pytest.approx([700.0, 900.0], abs=5.0)
    assert found["z"][0][[0, -1]] == pytest.approx([700.0, 900.0], abs=5.0)
    assert np.diff(found["yaw"][0]) == pytest.approx(0.1)
    assert len(found["yaw"][0]) <= 2000


def test_latencies_stay_on_request() -> None:
    table = motion.columns(T, velocity_late=0.24)
    trial = Trial.read(table, align=False)
    assert trial.report.latencies == {}
    np.testing.assert_allclose(trial.channel("u"), table["u_m_s"])


def test_sensors_on_time_are_left_alone() -> None:
    trial = Trial.read(motion.columns(T, noise=1e-3))
    assert trial.report.latencies == {}
    assert trial.valid.all()


def test_a_sensor_that_does_not_follow_the_pose_is_neither_shifted_nor_reversed() -> None:
    table = motion.columns(T)
    random = np.random.default_rng(1)
    for name in ("u_m_s", "v_m_s", "w_m_s"):
        table[name] = random.standard_normal(len(T))
    trial = Trial.read(table)
    assert "velocity" not in trial.report.latencies
    assert "sign reversed" not in str(trial.report)
    assert "u: does not follow the recorded pose" in str(trial.report)


@pytest.mark.parametrize(("rate", "yaw"), [(0.0, 0.0), (0.0, 7.0), (1.5, 0.0)])
def test_no_latency_is_estimated_of_a_sensor_that_never_moves(rate: float, yaw: float) -> None:
    t = np.arange(0.0, 60.0, 0.1)
    still = 0.0 * t
    names = ("p_deg_s", "q_deg_s", "r_deg_s", "roll_deg", "pitch_deg", "yaw_deg")
    values = dict.fromkeys(names, still) | {"r_deg_s": still + rate, "yaw_deg": still + yaw}
    trial = Trial.read(pl.DataFrame({"t_s": t, **values}))
    assert trial.report is not None
    assert "rates: latency not estimated: too little motion" in str(trial.report)


def test_opposite_signs_are_reversed_and_the_map_entry_given() -> None:
    table = motion.columns(T, rates_late=0.08, noise=1e-3)
    gyro = {"gyro": -table.pop("p_deg_s"), "v_m_s": -table["v_m_s"]}
    trial = Trial.read(table | gyro, columns={"p_deg_s": {"from": "gyro", "unit": "deg/s"}})
    inner = slice(5, -5)
    assert np.abs(trial.nu[inner] - motion.nu(T)[inner]).max() < 0.01
    report = str(trial.report)
    assert 'p_deg_s = { from = "gyro", unit = "deg/s", sign = -1 }' in report
    assert 'v_m_s = { from = "v_m_s", sign = -1 }' in report
    assert trial.report.latencies["rates"] == pytest.approx(0.08, abs=2e-3)


@pytest.mark.parametrize(
    ("columns", "factor", "unit"),
    [
        (("u_m_s", "v_m_s", "w_m_s"), 1e3, "mm/s"),
        (("u_m_s", "v_m_s", "w_m_s"), 3600.0 / 1852.0, "knot"),
        (("u_m_s", "v_m_s", "w_m_s"), 3.6, "km/h"),
        (("p_deg_s", "q_deg_s", "r_deg_s"), np.pi / 180.0, "rad/s"),
    ],
)
def test_a_unit_that_the_pose_contradicts_is_named_with_the_line(
    columns: tuple[str, ...], factor: float, unit: str
) -> None:
    table = motion.columns(np.arange(0.0, 60.0, 0.1), velocity_late=0.2, noise=1e-3)
    assert "times what the derivative" not in str(Trial.read(table).report)
    report = str(Trial.read(table | {name: factor * table[name] for name in columns}).report)
    for name in columns:
        assert f'{unit}? State it in the column map: {name} = {{ from = "{name}", unit = "{unit}"' in report
    # What the line says is right.
    entries = {name: {"from": name, "unit": unit} for name in columns}
    stated = Trial.read(table | {name: factor * table[name] for name in columns}, columns=entries)
    assert "times what the derivative" not in str(stated.report)


@pytest.mark.parametrize(("unit", "size"), [("mm/s", 1e-3), ("knot", 1852.0 / 3600.0), ("m/s", 1.0)])
@pytest.mark.parametrize("fixes", [False, True])
def test_a_velocity_in_another_unit_is_told_by_the_depth_alone(unit: str, size: float, fixes: bool) -> None:
    t = np.arange(0.0, 300.0, 0.1)
    pitch, roll = 0.2 * np.sin(0.07 * t), 0.1 * np.sin(0.11 * t)
    u, v, w = 1.4 + 0.1 * np.sin(0.05 * t), 0.1 * np.sin(0.2 * t), 0.3 * np.cos(0.13 * t)
    sink = -np.sin(pitch) * u + np.cos(pitch) * (np.sin(roll) * v + np.cos(roll) * w)
    columns: dict[str, Any] = {
        "t_s": t,
        "z_m": 30.0 + np.cumsum(sink) * 0.1,
        "roll_deg": np.degrees(roll),
        "pitch_deg": np.degrees(pitch),
        "yaw_deg": 0.0 * t,
        **{f"{name}_m_s": y / size for name, y in (("u", u), ("v", v), ("w", w))},
    }
    if fixes:  # at the surface alone
        columns |= {
            name: np.array([at if at % 20.0 < 0.05 else None for at in t.tolist()], object)
            for name in ("x_m", "y_m")
        }
    found = [str(one) for one in Trial.read(columns).report.findings if "of the recorded depth" in str(one)]
    if unit == "m/s":
        assert found == []
    else:
        assert len(found) == 3
        assert f'{unit}? State it in the column map: u_m_s = {{ from = "u_m_s", unit = "{unit}"' in found[0]
