"""Logs of sensors with stamps of their own: one time base, neighbours only, gaps open, latency found."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from numpy.typing import ArrayLike, NDArray

from seatrial._core import State, Vehicle
from seatrial.base.channels import CHANNELS
from seatrial.base.errors import TrialError
from seatrial.scoring.score import score
from seatrial.sensors.log import held, measure, times
from seatrial.sensors.sensor import parse_sensors
from seatrial.trial.generated import write_generated
from seatrial.trial.trial import Trial
from tests.sensors.sailing import turning_dive
from tests.trial import motion

Array = NDArray[np.float64]

EVERY = 10
T = np.arange(0.0, 200.0, 0.1)

SENSORS: dict[str, dict[str, Any]] = {
    "dvl": {
        "noise_m_s": 0.005,
        "rate_hz": 5.0,
        "phase_s": 0.03,
        "jitter_s": 0.003,
        "latency_s": 0.2,
        "dropout_every_s": 40.0,
        "dropout_s": 3.0,
    },
    "gyro": {"noise_deg_s": 0.02, "rate_hz": 10.0, "phase_s": 0.012},
    "attitude": {"noise_deg": 0.03, "rate_hz": 10.0, "phase_s": 0.047},
    "depth": {"noise_m": 0.01, "rate_hz": 5.0, "phase_s": 0.09},
    "position": {"noise_m": 0.02, "rate_hz": 4.0, "phase_s": 0.06, "jitter_s": 0.002},
}


def commands() -> dict[str, Array]:
    side, pace = np.sign(np.sin(2.0 * np.pi * T / 16.0)), np.sign(np.sin(2.0 * np.pi * T / 22.0))
    found = dict.fromkeys(("SbU", "SbL"), 1000.0 + 400.0 * side + 300.0 * pace)
    found |= dict.fromkeys(("PU", "PL"), 1000.0 - 400.0 * side + 300.0 * pace)
    return found | {"VTB": 600.0 * pace, "VTS": 600.0 * side}


@pytest.fixture(scope="module")
def log() -> pl.DataFrame:
    given: dict[str, ArrayLike] = {name: held(values, EVERY) for name, values in commands().items()}
    run = Vehicle.load("cwolf").simulate(times(T, EVERY), given, State(position=[0.0, 0.0, 30.0]))
    inputs = {f"cmd.{name}": values for name, values in commands().items()}
    return measure(run, parse_sensors(SENSORS), seed=2, inputs=inputs, every=EVERY)


def rows(*tables: dict[str, Array]) -> pl.DataFrame:
    """Samples of several sensors, each with its own t_s, as the rows of one log."""
    return pl.concat([pl.DataFrame(table) for table in tables], how="diagonal").sort("t_s")


def findings(trial: Trial, channel: str) -> str:
    return "\n".join(str(finding) for finding in trial.report.findings if finding.subject == channel)


def test_the_time_base_is_that_of_the_fastest_sensor_of_the_motion(log: pl.DataFrame) -> None:
    trial = Trial.read(log)
    assert trial.dt == pytest.approx(0.1)
    assert "stamps of their own; put on 10 Hz" in findings(trial, "time base")
    assert trial.channels == list(CHANNELS)
    assert Trial.read(log, rate_hz=20.0).dt == pytest.approx(0.05)


def test_the_latency_of_the_doppler_log_is_found_again(log: pl.DataFrame) -> None:
    trial = Trial.read(log)
    # 0.2 s, a whole sample of this log; what it states for itself is 0.01 s, of position noise of 2 cm.
    assert trial.report.latencies["velocity"] == pytest.approx(0.2, abs=0.03)
    # The gyro is on time to 1 ms: nothing to remove, or hardly anything.
    assert abs(trial.report.latencies.get("rates", 0.0)) < 0.003


def test_commands_are_held_and_the_vehicle_that_sailed_predicts_its_log(log: pl.DataFrame) -> None:
    trial = Trial.read(log)
    for name, values in commands().items():
        np.testing.assert_array_equal(trial.commands[name], values[: len(trial)])
    r2 = score(Vehicle.load("cwolf"), trial, ahead_s=10.0).r2
    # Truth and model are one vehicle: noise alone keeps these from 1.
    assert min(r2[name] for name in ("u", "q", "r", "z", "yaw")) > 0.98, r2


def test_sensors_all_over_the_vehicle_come_to_o() -> None:
    places = {"velocity": [0.8, -0.1, 0.25], "depth": [0.3, 0.0, 0.1], "position": [-0.4, 0.0, -0.5]}
    kinds = {"velocity": "dvl", "depth": "depth", "position": "position"}
    sensors: dict[str, dict[str, Any]] = {
        kind: {"rate_hz": 10.0, "phase_s": 0.01 + 0.02 * k} for k, kind in enumerate(SENSORS)
    }
    for name, place in places.items():
        sensors[kinds[name]] |= {"position_m": place}
    run = turning_dive(every=EVERY)
    log = measure(run, parse_sensors(sensors), seed=1, every=EVERY)
    trial = Trial.read(log, sensor_positions=places)
    inside = slice(20, -20)
    t = trial.t[inside]
    u, v, w = (np.interp(t, run.t, column) for column in np.asarray(run.nu)[:, :3].T)
    # Chords over 0.1 s: an eighth of a hundredth of the second derivative, some 2 m/s^3 after a step.
    np.testing.assert_allclose(trial.nu[inside, :3], np.stack([u, v, w], axis=1), atol=4e-3)
    path = np.stack([np.interp(t, run.t, column) for column in np.asarray(run.position).T], axis=1)
    np.testing.assert_allclose(trial.position[inside], path, atol=2e-3)
    # Nobody tells the places: a sway against the pose's, which no sign cures and none is changed for.
    left = Trial.read(log)
    assert "sign reversed" not in str(left.report)
    assert "correlation 0.62) is not certain" in str(left.report)
    assert np.abs(left.nu[inside, 1] - v).max() > 0.05


def test_a_csv_of_it_reads_back_as_the_same_trial(log: pl.DataFrame, tmp_path: Path) -> None:
    write_generated(log, tmp_path / "log.csv", "test", "two\nlines")
    assert (tmp_path / "log.csv").read_text().startswith("# GENERATED by seatrial from test: no vehicle")
    from_frame, from_file = Trial.read(log), Trial.read(tmp_path / "log.csv")
    np.testing.assert_array_equal(from_frame.observed, from_file.observed)
    np.testing.assert_array_equal(from_frame.valid, from_file.valid)


def test_drop_outs_are_masked_and_said(log: pl.DataFrame) -> None:
    trial = Trial.read(log, align=False)
    stamps = log.select("t_s", "u_m_s").drop_nulls()["t_s"].to_numpy()
    gaps = np.flatnonzero(np.diff(stamps) > 0.5)
    assert len(gaps) >= 1
    for gap in gaps:
        inside = (trial.t > stamps[gap] + 1e-6) & (trial.t < stamps[gap + 1] - 1e-6)
        assert not trial.valid[inside, :3].any()
    assert "gaps in time, the longest" in findings(trial, "velocity")
    # Elsewhere nothing is lost but the ends.
    share = (stamps[1:] - stamps[:-1])[gaps].sum() / T[-1]
    assert trial.valid[:, 0].mean() == pytest.approx(1.0 - share, abs=0.01)


def test_samples_are_linear_between_their_own_neighbours_only() -> None:
    fast, slow = 0.013 + np.arange(0.0, 60.0, 0.1), np.arange(0.0, 60.0, 0.5)
    slow = slow[(slow < 20.0) | (slow > 30.0)]
    trial = Trial.read(rows({"t_s": fast, "r_deg_s": np.sin(fast)}, {"t_s": slow, "u_m_s": 0.3 * slow}))
    valid = trial.valid[:, CHANNELS.index("u")]
    known = (trial.t <= 19.5 + 1e-9) | ((trial.t >= 30.5 - 1e-9) & (trial.t <= 59.5 + 1e-9))
    np.testing.assert_array_equal(valid, known)
    np.testing.assert_allclose(trial.channel("u")[valid], 0.3 * trial.t[valid], atol=1e-12)


def test_a_depth_of_its_own_stamps_is_a_sensor_of_its_own() -> None:
    fix, depth = np.arange(0.0, 100.0, 0.2), 0.05 + np.arange(0.0, 99.0, 0.1)
    trial = Trial.read(
        rows({"t_s": fix, "x_m": 0.5 * fix, "y_m": -0.2 * fix}, {"t_s": depth, "z_m": np.sin(0.1 * depth)})
    )
    inside = slice(2, -15)
    assert trial.valid[inside, 6:9].all()
    np.testing.assert_allclose(trial.position[inside, 0], 0.5 * trial.t[inside], atol=1e-9)
    # Chords of a sine of 0.1 rad/s over 0.1 s.
    np.testing.assert_allclose(trial.position[inside, 2], np.sin(0.1 * trial.t[inside]), atol=2e-5)


def test_fixes_at_the_surface_keep_no_segment_from_starting() -> None:
    t = np.arange(0.0, 100.0, 0.1)
    fix = np.arange(0.03, 20.0, 1.0)
    depth = np.where(t < 20.0, 0.0, 0.1 * (t - 20.0))
    trial = Trial.read(
        rows({"t_s": t, "z_m": depth, "u_m_s": 0.5 + 0.1 * np.sin(t)}, {"t_s": fix, "x_m": fix, "y_m": fix})
    )
    assert not trial.valid[:, 6:8].any()
    assert "x y: known in 1" in str(trial.report)
    assert trial.startable.mean() > 0.95
    # The depth under way is the recorded one, not a bridge between fixes.
    assert trial.state(600)[0][2] == pytest.approx(depth[600], abs=0.02)


def test_a_position_that_is_mostly_known_is_used() -> None:
    t = np.arange(0.0, 100.0, 0.1)
    fix = np.arange(0.03, 80.0, 0.5)
    trial = Trial.read(rows({"t_s": t, "z_m": 0.1 * t}, {"t_s": fix, "x_m": fix, "y_m": fix}))
    assert trial.valid[:, 6].mean() == pytest.approx(0.79, abs=0.02)


def test_sensors_without_a_sample_are_left_out_and_named() -> None:
    t = np.arange(0.0, 20.0, 0.1)
    empty: list[float | None] = [None] * len(t)
    table = pl.DataFrame({"t_s": t, "z_m": t, "x_m": empty, "y_m": empty, "u_m_s": empty})
    trial = Trial.read(table)
    assert trial.channels == ["z"]
    assert "no sample of u_m_s: every cell is empty" in findings(trial, "velocity")
    assert "no sample of x_m, y_m" in findings(trial, "position")


def test_a_compass_beside_roll_and_pitch_and_a_yaw_gyro_of_its_own() -> None:
    t = np.arange(0.0, 60.0, 0.1)
    own = 0.04 + np.arange(0.0, 59.0, 0.1)
    slow = 0.02 + np.arange(0.0, 59.0, 0.2)
    yaw = (np.rad2deg(0.2 * own) + 180.0) % 360.0 - 180.0
    trial = Trial.read(
        rows(
            {"t_s": t, "roll_deg": 3.0 * np.sin(t), "pitch_deg": 2.0 * np.cos(t), "p_deg_s": np.sin(t)},
            {"t_s": own, "yaw_deg": yaw},
            {"t_s": slow, "r_deg_s": np.cos(0.1 * slow)},
        ),
        align=False,
    )
    inside = slice(5, -15)
    assert trial.valid[inside, 9:].all()
    # Chords over 0.1 s of 3 deg at 1 rad/s: 4e-3 deg; the compass is straight.
    assert np.abs(np.rad2deg(trial.channel("roll")[inside]) - 3.0 * np.sin(trial.t[inside])).max() < 0.01
    turned = np.unwrap(trial.channel("yaw")[inside]) - 0.2 * trial.t[inside]
    assert np.abs(turned - turned[0]).max() < 1e-4
    rate = np.rad2deg(trial.channel("r")[inside])
    np.testing.assert_allclose(rate, np.cos(0.1 * trial.t[inside]), atol=1e-3)
    assert "stamps of their own" in findings(trial, "rates")
    assert "stamps of their own" in findings(trial, "euler")


def test_a_log_of_one_time_base_is_read_as_ever() -> None:
    t = np.arange(0.0, 30.0, 0.1)
    table = motion.columns(t, noise=1e-3)
    here = np.arange(len(t)) % 7 != 0
    table["z_m"] = np.where(here, table["z_m"], np.nan)
    frame = pl.DataFrame(table).with_columns(pl.col("z_m").fill_nan(None))
    trial = Trial.read(frame, align=False)
    # Single lost cells of one positioning system: masked where they are, no sensor of its own.
    np.testing.assert_array_equal(trial.valid[:, 8], here)
    assert trial.valid[:, 6:8].all()
    assert "time base" not in str(trial.report)


def test_a_gap_that_no_time_base_can_hold_is_refused_with_its_row() -> None:
    t = np.arange(0.0, 50.0, 0.1)
    t[300:] += 1e9
    with pytest.raises(
        TrialError, match=r"1e\+10 samples for 500 rows; the longest gap, 1e\+09 s, comes after row 300"
    ):
        Trial.read({"t_s": t, "u_m_s": np.sin(t)})
    # A night between two dives is only a gap.
    t[300:] += 36_000.0 - 1e9
    assert len(Trial.read({"t_s": t, "u_m_s": np.sin(t)})) == 360_500
    with pytest.raises(TrialError, match="give a lower rate_hz"):
        Trial.read({"t_s": np.arange(0.0, 50.0, 0.1), "u_m_s": np.sin(t)}, rate_hz=1e6)
