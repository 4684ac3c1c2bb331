"""What is a defect of a sensor and what is a motion: spikes against decays, frozen samples against gaps."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl
import pytest
from numpy.typing import NDArray

from seatrial.base.channels import CHANNELS
from seatrial.trial.trial import Trial

Array = NDArray[np.float64]

P, Q, R = (CHANNELS.index(channel) for channel in "pqr")
ROLL, PITCH, YAW = (CHANNELS.index(channel) for channel in ("roll", "pitch", "yaw"))

ANGLES = ("roll_deg", "pitch_deg", "yaw_deg")
RATES = ("p_deg_s", "q_deg_s", "r_deg_s")

RELEASES = 20.0 + 40.0 * np.arange(4)


def decays(
    omega: float, damping: float, *, late: float = 0.0, rate_hz: float = 10.0, seed: int = 0
) -> tuple[dict[str, Any], Array]:
    """Quiet record of 180 s with four roll decays from 35 deg, and its true roll rate, deg/s."""
    t = np.arange(0.0, 180.0, 1.0 / rate_hz)
    roll, rate = np.zeros_like(t), np.zeros_like(t)
    sigma, damped = damping * omega, omega * np.sqrt(1.0 - damping**2)
    for release in RELEASES + late:
        x = np.maximum(t - release, 0.0)
        fall = 35.0 * np.exp(-sigma * x) * (t >= release)
        roll += fall * (np.cos(damped * x) + sigma / damped * np.sin(damped * x))
        rate -= fall * omega**2 / damped * np.sin(damped * x)
        push = np.clip((t - release + 4.0) / 4.0, 0.0, 1.0)
        held = (push > 0.0) & (t < release)
        roll += held * 17.5 * (1.0 - np.cos(np.pi * push))
        rate += held * 17.5 * np.pi / 4.0 * np.sin(np.pi * push)
    random = np.random.default_rng(seed)
    attitude = np.stack([roll, 0.0 * t, 0.0 * t], axis=1) + 0.2 * random.standard_normal((len(t), 3))
    gyro = np.stack([rate, 0.0 * t, 0.0 * t], axis=1) + 0.5 * random.standard_normal((len(t), 3))
    table: dict[str, Any] = {"t_s": t}
    table |= dict(zip(ANGLES, attitude.T, strict=True)) | dict(zip(RATES, gyro.T, strict=True))
    return table, rate


def findings(trial: Trial, channel: str) -> str:
    return "\n".join(str(finding) for finding in trial.report.findings if finding.subject == channel)


@pytest.mark.parametrize("sensors", ["gyro", "attitude", "both"])
@pytest.mark.parametrize("omega", [4.0, 6.5, 9.0])
@pytest.mark.parametrize(
    ("damping", "late", "rate_hz"), [(0.1, 0.07, 10.0), (0.4, 0.03, 10.0), (0.25, 0.0, 25.0)]
)
def test_a_roll_decay_in_a_quiet_record_is_no_defect(
    sensors: str, omega: float, damping: float, late: float, rate_hz: float
) -> None:
    table, _ = decays(omega, damping, late=late, rate_hz=rate_hz)
    for name in {"gyro": ANGLES, "attitude": RATES, "both": ()}[sensors]:
        del table[name]
    trial = Trial.read(table, align=False)
    used = {"gyro": [P, Q, R], "attitude": [ROLL, PITCH, YAW], "both": [P, Q, R, ROLL, PITCH, YAW]}[sensors]
    assert trial.valid[:, used].all()


def test_the_samples_of_a_fast_decay_are_kept() -> None:
    # A release as a gyro of 10 Hz showed it: a half swing of three samples, then the way back.
    t = np.arange(0.0, 300.0, 0.1)
    noise = 0.4 * np.random.default_rng(4).standard_normal((3, len(t)))
    table = {"t_s": t} | dict(zip(RATES, noise, strict=True))
    for start in (700, 1500, 2300):
        table["p_deg_s"][start : start + 8] += [-78.0, -106.0, -90.0, 37.0, 33.0, -12.0, -10.0, 4.0]
    assert Trial.read(table, align=False).valid[:, [P, Q, R]].all()


@pytest.mark.parametrize("length", [1, 2, 3])
@pytest.mark.parametrize("attitude", [True, False])
def test_spikes_beside_decays_are_masked_in_their_own_channel(length: int, attitude: bool) -> None:
    table, _ = decays(6.5, 0.2)
    for name in () if attitude else ANGLES:
        del table[name]
    at = np.array([280, 350, 680, 750, 1080, 1150, 1480, 1550])  # s/10, all after the decays
    for start in at:
        table["p_deg_s"][start : start + length] += 40.0
    trial = Trial.read(table, align=False)
    wrong = (at[:, None] + np.arange(length)).ravel()
    np.testing.assert_array_equal(np.flatnonzero(~trial.valid[:, P]), wrong)
    assert trial.valid[:, [Q, R]].all()
    assert "spikes masked" in findings(trial, "p")


def test_a_spike_of_a_doppler_log_that_no_position_shows_is_masked_and_a_jerk_that_it_shows_is_not() -> None:
    t = np.arange(0.0, 200.0, 0.1)
    speed = 0.3 + 0.5 * np.exp(-(((t - 100.0) / 0.12) ** 2))
    table = {
        "t_s": t,
        "x_m": np.cumsum(0.1 * speed),
        "y_m": 0.002 * np.sin(t),
        "z_m": 0.002 * np.cos(t),
        "yaw_deg": 0.1 * np.sin(t),
        "u_m_s": speed + 1e-3 * np.sin(7.0 * t),
        "v_m_s": 1e-3 * np.cos(5.0 * t),
    }
    table["u_m_s"][500] += 0.5
    trial = Trial.read(table, align=False)
    np.testing.assert_array_equal(np.flatnonzero(~trial.valid[:, 0]), [500])
    assert trial.valid[:, 1].all()


def test_a_roll_that_is_missing_leaves_pitch_and_yaw() -> None:
    table, _ = decays(4.0, 0.3)
    yaw = (np.asarray(table["yaw_deg"]) + 3.0 * table["t_s"] + 180.0) % 360.0 - 180.0
    table["yaw_deg"] = yaw
    gap = slice(600, 809)
    roll = np.array(table["roll_deg"])
    roll[gap] = np.nan
    trial = Trial.read(table | {"roll_deg": roll}, align=False)
    assert not trial.valid[gap, ROLL].any()
    assert trial.valid[:, [PITCH, YAW]].all()
    np.testing.assert_allclose(np.rad2deg(trial.channel("yaw"))[gap], yaw[gap], atol=1e-9)
    # No segment may start where the attitude as a whole is unknown.
    assert not trial.startable[gap].any()


def test_cells_without_a_number_are_no_frozen_samples() -> None:
    table, _ = decays(4.0, 0.3)
    for name in RATES:
        table[name][600:809] = np.nan
    trial = Trial.read(table, align=False)
    assert not trial.valid[600:809, [P, Q, R]].any()
    assert "frozen" not in str(trial.report)
    assert "209 NaN or infinite samples" in findings(trial, "p_deg_s")


def test_rows_that_a_logger_repeats_are_a_gap_not_a_frozen_sensor() -> None:
    table, _ = decays(4.0, 0.05)
    for name in (*ANGLES, *RATES):
        table[name][600:809] = table[name][599]
        table[name][809:] += 15.0 if name in ANGLES else 5.0
    trial = Trial.read(table, align=False)
    used = [P, Q, R, ROLL, PITCH, YAW]
    assert not trial.valid[600:809, used].any()
    assert "frozen" not in str(trial.report)
    assert "209 rows repeat the row before in every sensor: gaps that the logger filled" in findings(
        trial, "log"
    )
    assert "the longest 21.00 s" in findings(trial, "log")


def test_one_sensor_that_repeats_is_frozen() -> None:
    table, _ = decays(4.0, 0.05)
    for name in RATES:
        table[name][600:650] = table[name][599]
    trial = Trial.read(table, align=False)
    np.testing.assert_array_equal(np.flatnonzero(~trial.valid[:, P]), np.arange(600, 650))
    assert trial.valid[:, [ROLL, PITCH, YAW]].all()
    assert "50 frozen samples in 1 drop-out" in findings(trial, "rates")


def test_a_rounded_depth_without_position_repeats_by_chance() -> None:
    t = np.arange(0.0, 600.0, 0.1)
    depth = 5.0 + 2.0 * np.sin(0.05 * t) + 0.02 * np.random.default_rng(1).standard_normal(len(t))
    trial = Trial.read(pl.DataFrame({"t_s": t, "z_m": depth.round(3), "u_m_s": np.sin(0.1 * t)}), align=False)
    assert trial.valid[:, CHANNELS.index("z")].all()


def test_an_impossible_pulse_width_holds_the_one_before() -> None:
    t = np.arange(0.0, 20.0, 0.1)
    pulses = np.where(t < 10.0, 1500.0, 1600.0)
    pulses[[50, 120]] = 34268.0, 65535.0
    trial = Trial.read({"t_s": t, "u_m_s": np.sin(t), "cmd.thruster_1": pulses}, align=False)
    assert np.ptp(trial.commands["thruster_1"]) == 100.0
    assert trial.commands["thruster_1"][120] == 1600.0
    assert "2 pulse widths above 3000 us; the one before is held instead" in str(trial.report)


@pytest.mark.parametrize("other", [-900.0, 3500.0])
def test_revolutions_in_the_range_of_pulse_widths_stay(other: float) -> None:
    t = np.arange(0.0, 60.0, 0.1)
    revolutions = np.where(t % 20.0 < 15.0, 1500.0, other)
    trial = Trial.read({"t_s": t, "u_m_s": np.sin(t), "cmd.propeller": revolutions}, align=False)
    assert np.unique(trial.commands["propeller"]).size == 2


def test_gaps_of_a_depth_alone_are_not_those_of_a_position() -> None:
    t = np.arange(0.0, 120.0, 0.1)
    t = t[(t < 50.0) | (t > 52.0)]
    table = {"t_s": t, "z_m": 5.0 + np.sin(0.05 * t), "u_m_s": np.sin(0.1 * t)}
    said = str(Trial.read(table, align=False).report)
    assert "depth: 1 gap in time" in said
    assert "position" not in said


@pytest.mark.parametrize("angle", ["pitch", "yaw"])
def test_a_stuck_angle_is_reported_and_an_angle_that_was_not_recorded_is_not(angle: str) -> None:
    t = np.arange(0.0, 60.0, 0.1)
    table = {"t_s": t, "roll_deg": 0.0 * t, "pitch_deg": 3.0 * np.sin(t), "yaw_deg": 20.0 * np.sin(0.2 * t)}
    assert "constant" not in str(Trial.read(table).report)
    trial = Trial.read(table | {f"{angle}_deg": np.full_like(t, 10.0)})
    assert "constant at 0.174533 rad" in findings(trial, angle)
    assert "roll: constant" not in str(trial.report)


def test_angles_in_degrees_that_are_called_rad_are_an_error() -> None:
    t = np.arange(0.0, 300.0, 0.1)
    heading = 180.0 + 2.0 * t
    table = {"t_s": t, "pitch": 8.0 * np.sin(t), "yaw": heading % 360.0}

    def read(unit: str, factor: float = 1.0, **other: Array) -> Trial:
        columns = {f"{name}_deg": {"from": name, "unit": unit} for name in ("pitch", "yaw")}
        cells = {name: y if name == "t_s" else factor * y for name, y in (table | other).items()}
        return Trial.read(cells, columns=columns)

    assert [one for one in read("rad").report.errors if 'yaw_deg = { from = "yaw", unit = "deg" }' in one]
    # Yaw alone, and a yaw in degrees that does not pass north.
    assert read("rad", pitch=0.001 * t).report.errors
    assert read("rad", pitch=0.001 * t, yaw=np.clip(heading, 180.0, 350.0)).report.errors
    assert not read("deg").report.errors
    assert not read("rad", np.pi / 180.0).report.errors
    # Radians counted over two turns are no degrees.
    assert not read("rad", np.pi / 180.0, yaw=heading).report.errors
