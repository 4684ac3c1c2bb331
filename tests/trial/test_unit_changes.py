"""A unit that changes within a channel is named with its row; what a vehicle does is no change of a unit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from seatrial.base.channels import DEGREE
from seatrial.trial.recording import recording
from seatrial.trial.signals import RecordingFinding
from seatrial.trial.trial import Trial
from tests.inspect.logs import Motion

Array = NDArray[np.float64]

ANGLES = ("roll_deg", "pitch_deg", "yaw_deg")
RATES = ("p_deg_s", "q_deg_s", "r_deg_s")
SPEEDS = ("u_m_s", "v_m_s", "w_m_s")
PLACES = ("x_m", "y_m", "z_m")

SIZES = dict.fromkeys(ANGLES, 0.1) | dict.fromkeys(RATES, 0.3) | dict.fromkeys((*SPEEDS, *PLACES), 0.01)
"""Noise of the sensors in the units of their columns."""


def log(seed: int, *, rate_hz: float = 10.0, noise: float = 1.0, rest_s: float = 0.0) -> dict[str, Any]:
    """A vehicle that cruises, turns and dives, 200 s, at rest for a while before."""
    motion, random = Motion(seed, 200.0), np.random.default_rng(seed)
    t = np.arange(0.0, 200.0, 1.0 / rate_hz)
    moved = np.maximum(t - rest_s, 0.0)
    moves = (t >= rest_s)[:, None]
    parts = {
        ANGLES: np.rad2deg(motion.at(motion.angles, moved)),
        RATES: np.rad2deg(motion.at(motion.omega, moved)) * moves,
        SPEEDS: motion.at(motion.v, moved) * moves,
        PLACES: motion.at(motion.p, moved) + np.array([0.0, 0.0, 20.0]),
    }
    table: dict[str, Any] = {"t_s": t}
    for names, values in parts.items():
        for name, y in zip(names, values.T, strict=True):
            table[name] = y + noise * SIZES[name] * random.standard_normal(len(t))
    return table


def changes(table: dict[str, Any]) -> list[RecordingFinding]:
    return [one for one in recording(table).report.findings if "the unit changes" in one.message]


@pytest.mark.parametrize(
    ("names", "factor", "words"),
    [
        (RATES, DEGREE, "times smaller, as rad/s after deg/s would be (57.3 times)"),
        (RATES, 1.0 / DEGREE, "times larger, as deg/s after rad/s"),
        (("r_deg_s",), DEGREE, "times smaller, as rad/s after deg/s"),
        (ANGLES, DEGREE, "times smaller, as rad after deg"),
        (SPEEDS, 1000.0, "times larger, as mm/s after m/s"),
        (SPEEDS, 0.01, "times smaller, as m/s after cm/s"),
        (SPEEDS, 1.943844, "times larger, as kn after m/s"),
        (SPEEDS, 1.0 / 3.6, "times smaller, as m/s after km/h"),
        (PLACES, 0.001, "times smaller, as m after mm"),
        (("z_m",), 1000.0, "times larger, as mm after m"),
        (("z_m",), 3.28084, "times larger, as ft after m"),
    ],
)
@pytest.mark.parametrize("seed", [1, 2])
def test_a_unit_that_changes_is_named_with_its_row(
    names: tuple[str, ...], factor: float, words: str, seed: int
) -> None:
    table, at = log(seed), 1000 + 90 * seed
    for name in names:
        table[name] = np.where(np.arange(len(table["t_s"])) < at, table[name], factor * table[name])
    (found,) = changes(table)
    assert found.level == "error"
    assert set(found.subject.split()) <= {name.split("_")[0] for name in names}
    # The first row counts one; of rates around zero the row is known to a few.
    row = int(found.message.split("from row ")[1].split()[0])
    assert abs(row - (at + 1)) <= 3
    assert f"(t = {table['t_s'][row - 1]:.6g} s)" in found.message
    assert words in found.message
    seen = float(found.message.split(" values are ")[1].split()[0])
    assert abs(np.log(seen / max(factor, 1.0 / factor))) < 0.3


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    "how",
    [
        {},
        {"rate_hz": 25.0},
        {"noise": 0.05},
        {"noise": 0.0},
        {"noise": 5.0},
        {"rest_s": 100.0},
        {"rest_s": 100.0, "noise": 0.05},
        {"rest_s": 100.0, "noise": 0.0},
    ],
)
def test_motion_noise_and_a_start_from_rest_are_none(seed: int, how: dict[str, float]) -> None:
    assert changes(log(seed, **how)) == []


@pytest.mark.parametrize("factor", [57.3, 1000.0, 100.0])
def test_a_motion_that_begins_with_such_a_factor_is_none(factor: float) -> None:
    # Only the steps from sample to sample grow by the factor; the noise of the sensor stays.
    random = np.random.default_rng(5)
    t = np.arange(0.0, 200.0, 0.1)
    noise = 0.001 * random.standard_normal((4, len(t)))
    ramp = np.maximum(t - 100.0, 0.0) * factor * 0.008
    table = {"t_s": t, "z_m": ramp + noise[0], "u_m_s": ramp + noise[1], "r_deg_s": np.sin(ramp) + noise[2]}
    assert changes(table) == []


def test_a_sensor_that_gets_louder_with_all_others_is_none() -> None:
    # A motor that starts shakes every sensor.
    table = log(3)
    random = np.random.default_rng(9)
    late = np.arange(len(table["t_s"])) >= 1100
    for name in (*RATES, *ANGLES, *SPEEDS):
        shaken = np.where(late, 57.3, 1.0) * SIZES[name] * random.standard_normal(len(late))
        table[name] = 0.0 * table[name] + shaken
    for name in PLACES:
        table[name] = table[name] + np.where(late, 0.5, 0.0) * random.standard_normal(len(late))
    assert changes(table) == []


def test_an_offset_and_a_spike_are_none() -> None:
    table = log(4)
    late = np.arange(len(table["t_s"])) >= 1000
    table["z_m"] = table["z_m"] + np.where(late, 50.0, 0.0)
    table["u_m_s"][700] *= 100.0
    table["x_m"] = np.where(late, 2.2 * table["x_m"], table["x_m"])  # no two units differ so
    assert changes(table) == []


def test_two_sensors_that_change_in_one_row_are_both_named() -> None:
    table = log(6)
    late = np.arange(len(table["t_s"])) >= 1200
    for name in (*SPEEDS, *PLACES):
        table[name] = np.where(late, 1000.0 * table[name], table[name])
    named = " ".join(one.subject for one in changes(table)).split()
    assert {"u", "z"} <= set(named)


@pytest.mark.parametrize(("sign", "said"), [(1.0, False), (-1.0, True)])
def test_a_depth_with_the_wrong_sign_is_said(sign: float, said: bool) -> None:
    table = {**log(2), "z_m": sign * (5.0 + log(2)["z_m"] * 0.0)}
    table["z_m"] = table["z_m"] + 0.01 * np.random.default_rng(1).standard_normal(len(table["t_s"]))
    words = str(Trial.read(table, align=False).report)
    assert ("z: above the surface in 100 % of the record (-5 m at the median" in words) == said
    # What the sentence proposes settles it.
    if said:
        columns = {"z_m": {"from": "z_m", "sign": -1}}
        assert "above the surface" not in str(Trial.read(table, columns=columns, align=False).report)


def test_a_vehicle_that_breaks_the_surface_is_no_wrong_sign() -> None:
    table = log(2)
    t = table["t_s"]
    table["z_m"] = np.maximum(2.0 * np.sin(0.1 * t), -0.2) - 0.3 * np.sin(2.0 * t)
    assert "above the surface" not in str(Trial.read(table, align=False).report)
