"""Reading a trial: formats, one time base, masks, derived motion, and bad input answered clearly."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from seatrial.base.channels import CHANNELS
from seatrial.base.errors import TrialError
from seatrial.logs.log import open_log
from seatrial.scoring.windows import Predictions
from seatrial.trial.trial import Trial
from seatrial.verification.mission_log.log import MissionLog
from tests.trial import motion

T = np.arange(0.0, 20.0, 0.1)


def findings(trial: Trial, channel: str) -> str:
    return "\n".join(str(finding) for finding in trial.report.findings if finding.subject == channel)


@pytest.fixture
def table() -> dict[str, Any]:
    return motion.columns(T) | {"cmd.stern": np.where(T < 10.0, 0.0, 500.0), "voltage_v": 15.0 - 0.01 * T}


@pytest.mark.parametrize("source", ["csv", "semicolon", "parquet", "polars", "lazy", "pandas", "mapping"])
def test_every_source_gives_the_same_trial(source: str, table: dict[str, Any], tmp_path: Path) -> None:
    frame = pl.DataFrame(table)
    given: Any = {"polars": frame, "lazy": frame.lazy(), "mapping": table}.get(source)
    if source == "pandas":
        pd = pytest.importorskip("pandas")
        given = pd.DataFrame(table)
    elif given is None:
        given = tmp_path / ("run.parquet" if source == "parquet" else "run.csv")
        if source == "parquet":
            frame.write_parquet(given)
        else:
            frame.write_csv(given, separator=";" if source == "semicolon" else ",")
    trial = Trial.read(given, align=False)
    position, attitude = motion.pose(T)
    np.testing.assert_allclose(trial.position, position, atol=1e-12)
    np.testing.assert_allclose(np.abs(np.sum(trial.attitude * attitude, axis=1)), 1.0, atol=1e-12)
    np.testing.assert_allclose(trial.nu, motion.nu(T), atol=1e-12)
    np.testing.assert_array_equal(trial.commands["stern"], table["cmd.stern"])
    assert trial.voltage_v is not None
    np.testing.assert_allclose(trial.voltage_v, table["voltage_v"])
    assert trial.channels == list(CHANNELS)
    assert trial.valid.all()
    assert trial.startable.all()
    assert len(trial) == len(T)
    assert trial.dt == pytest.approx(0.1)


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_a_written_trial_reads_back_with_its_masks(
    ending: str, table: dict[str, Any], tmp_path: Path
) -> None:
    table["u_m_s"][50:53] = np.nan
    table |= {f"tau.{axis}": 0.1 * T for axis in ("X_n", "Y_n", "Z_n", "K_nm", "M_nm", "N_nm")}
    trial = Trial.read(table, align=False, name="first")
    trial.save(tmp_path / f"again{ending}")
    again = Trial.read(tmp_path / f"again{ending}", align=False)
    np.testing.assert_allclose(again.observed[again.valid], trial.observed[trial.valid], atol=1e-12)
    np.testing.assert_array_equal(again.valid, trial.valid)
    assert again.tau is not None
    assert trial.tau is not None
    np.testing.assert_allclose(again.tau, trial.tau)
    np.testing.assert_array_equal(again.commands["stern"], trial.commands["stern"])
    assert again.name == "again"


def test_nan_and_infinity_are_masked_and_reported(table: dict[str, Any]) -> None:
    table["v_m_s"][10], table["v_m_s"][20] = np.nan, np.inf
    trial = Trial.read(table, align=False)
    np.testing.assert_array_equal(np.flatnonzero(~trial.valid[:, CHANNELS.index("v")]), [10, 20])
    assert trial.valid[:, CHANNELS.index("u")].all()
    assert np.isfinite(trial.nu).all()
    assert "2 NaN or infinite samples; masked" in findings(trial, "v_m_s")
    assert not trial.startable[10]


def test_gaps_in_time_are_masked_not_bridged(table: dict[str, Any]) -> None:
    kept = (T < 5.0 - 1e-9) | (T > 7.0 + 1e-9)
    trial = Trial.read({name: values[kept] for name, values in table.items()}, align=False)
    assert len(trial) == len(T)
    np.testing.assert_array_equal(trial.valid.all(axis=1), kept)
    assert "1 gap in time, the longest 2.20 s; masked" in findings(trial, "position")


def test_a_clock_that_jumped_is_told_from_a_pause() -> None:
    t = np.arange(0.0, 60.0, 0.1)
    way = {"x_m": 0.8 * t, "y_m": 5.0 * np.sin(0.05 * t), "z_m": 3.0 + 0.0 * t}
    noise = np.random.default_rng(1).normal(0.0, 0.005, len(t))
    told = {}
    for name, jump, x in (
        ("jump", 37.0, way["x_m"] + noise),
        ("pause", 37.0, way["x_m"] + np.where(t < 30.0, 0.0, 30.0) + noise),
        ("at rest", 37.0, noise),
    ):
        stamps = t + np.where(t < 30.0, 0.0, jump)
        y = way["y_m"] if name != "at rest" else noise[::-1]
        table = {"t_s": stamps, "x_m": x, "y_m": y, "z_m": way["z_m"]}
        told[name] = findings(Trial.read(table, align=False), "position")
    assert all("1 gap in time, the longest 37.10 s" in one for one in told.values())
    assert [name for name, one in told.items() if "clock may have jumped" in one] == ["jump"]


def test_commands_are_held_and_channels_interpolated() -> None:
    t = np.arange(0.0, 4.0, 0.2)
    trial = Trial.read({"t_s": t, "u_m_s": t, "cmd.a": np.floor(t)}, rate_hz=20.0)
    np.testing.assert_allclose(trial.channel("u"), trial.t, atol=1e-12)
    np.testing.assert_array_equal(trial.commands["a"], np.floor(np.floor(trial.t / 0.2 + 1e-6) * 0.2 + 1e-9))


def test_a_log_of_two_rates_in_one_table() -> None:
    slow = np.arange(len(T)) % 5 == 0
    speed = [float(value) if here else None for value, here in zip(T, slow, strict=True)]
    trial = Trial.read(pl.DataFrame({"t_s": T, "u_m_s": speed, "r_deg_s": np.sin(T)}))
    np.testing.assert_allclose(trial.channel("u")[:196], T[:196], atol=1e-12)
    np.testing.assert_array_equal(trial.valid[:, 0], np.arange(len(T)) <= 195)


def test_epoch_times_in_uneven_steps_get_a_uniform_base() -> None:
    t = 1.6e9 + T + 0.004 * np.sin(50.0 * T)
    trial = Trial.read({"t_s": t, "u_m_s": 0.5 * (t - t[0])})
    assert trial.t[0] == t[0]
    np.testing.assert_allclose(np.diff(trial.t), trial.dt, atol=1e-6)  # spacing of doubles at 1.6e9 is 2.4e-7
    np.testing.assert_allclose(trial.channel("u"), 0.5 * (trial.t - t[0]), atol=1e-6)


def test_motion_that_was_not_recorded_is_derived_from_the_pose(table: dict[str, Any]) -> None:
    pose_only = {
        name: values for name, values in table.items() if name[0] not in "uvwpr" and name != "q_deg_s"
    }
    trial = Trial.read(pose_only)
    inner = slice(10, -10)
    # smoothing differentiation of exact samples at 10 Hz: the third difference of the pose is 1e-4 of it
    np.testing.assert_allclose(trial.nu[inner], motion.nu(T)[inner], atol=2e-3)
    assert "derived from the attitude" in findings(trial, "p q r")
    assert "derived from position and attitude" in findings(trial, "u v w")


def test_nothing_is_derived_from_too_little() -> None:
    trial = Trial.read({"t_s": T, "z_m": T, "u_m_s": T})
    assert trial.channels == ["u", "z"]
    assert "p q r" in findings(trial, "channels")
    np.testing.assert_array_equal(trial.nu[:, 1:], 0.0)


def test_state_and_smoothed_velocities_follow_the_truth_closer_than_the_samples() -> None:
    noisy = motion.columns(T, noise=0.02, seed=3)
    trial = Trial.read(noisy, align=False)
    nu, nu_rate = trial.smooth_nu(T)
    truth = motion.nu(T)
    sampled = np.std(trial.nu - truth, axis=0)
    assert np.all(np.std(nu - truth, axis=0) < 0.5 * sampled)
    position, attitude, start = trial.state(100)
    assert np.linalg.norm(position - motion.pose(T)[0][100]) < 0.02
    np.testing.assert_allclose(start, nu[100])
    assert np.linalg.norm(attitude) == pytest.approx(1.0)
    step = 1e-4
    difference = (trial.smooth_nu(T[50:60] + step)[0] - trial.smooth_nu(T[50:60] - step)[0]) / (2.0 * step)
    np.testing.assert_allclose(nu_rate[50:60], difference, atol=1e-6)  # of one spline: step^2 only


def test_frozen_pose_then_jump_is_masked(table: dict[str, Any]) -> None:
    for name in ("x_m", "y_m", "z_m", "q_w", "q_x", "q_y", "q_z"):
        table[name][60:75] = table[name][59]
    trial = Trial.read(table, align=False)
    np.testing.assert_array_equal(np.flatnonzero(~trial.valid[:, 6]), np.arange(60, 75))
    np.testing.assert_array_equal(np.flatnonzero(~trial.valid[:, 9]), np.arange(60, 75))
    assert trial.valid[:, :6].all()
    assert "15 frozen samples in 1 drop-out; masked" in findings(trial, "position")


def test_a_vehicle_at_rest_in_a_record_without_noise_is_not_frozen(table: dict[str, Any]) -> None:
    for values in table.values():
        if values is not table["t_s"]:
            values[:50] = values[50]
    assert Trial.read(table, align=False).valid.all()


def test_a_rounded_sensor_in_steady_motion_is_not_frozen() -> None:
    speed = 0.4 * (1.0 - np.exp(-T))
    table = {"t_s": T, "x_m": 0.4 * (T + np.exp(-T)), "y_m": 0.0 * T, "z_m": 0.0 * T, "u_m_s": speed.round(3)}
    table |= {
        "v_m_s": (0.001 * np.sin(T)).round(3),
        "w_m_s": 0.0 * T,
        "yaw_deg": np.sin(T),
        "r_deg_s": np.cos(T),
    }
    assert Trial.read(table, align=False).valid[:, :9].all(where=np.isin(CHANNELS[:9], list("uvwrxyz")))


def test_false_poses_between_jumps_are_masked(table: dict[str, Any]) -> None:
    for name in ("x_m", "y_m"):
        table[name][80:90] += 1.5
    trial = Trial.read(table, align=False)
    wrong = np.flatnonzero(~trial.valid[:, 6])
    assert set(range(80, 90)) <= set(wrong.tolist()) <= set(range(79, 91))
    assert "2 jumps" in findings(trial, "position")


def test_a_jerk_that_the_gyro_confirms_is_no_jump() -> None:
    t = np.arange(0.0, 600.0, 0.1)
    rate = 3.0 * np.exp(-(((t - 300.0) / 0.15) ** 4))
    noise = 1e-3 * np.random.default_rng(2).standard_normal((3, len(t)))
    yaw = np.cumsum(0.1 * rate) + noise[0]
    table = {"t_s": t, "roll_deg": noise[1], "pitch_deg": noise[2], "yaw_deg": np.rad2deg(yaw)}
    gyro = {
        name: np.rad2deg(value) for name, value in zip(("p_deg_s", "q_deg_s", "r_deg_s"), noise, strict=True)
    }
    gyro["r_deg_s"] = gyro["r_deg_s"] + np.rad2deg(rate)
    assert Trial.read(table | gyro, align=False).valid[:, 9:].all()
    # without the gyro nothing tells the jerk from a wrong solution
    assert not Trial.read(table, align=False).valid[:, 9:].all()


def test_spikes_of_a_velocity_sensor_are_masked(table: dict[str, Any]) -> None:
    table["w_m_s"][33] += 4.0
    trial = Trial.read(table, align=False)
    np.testing.assert_array_equal(np.flatnonzero(~trial.valid[:, 2]), [33])
    assert "1 spike masked" in findings(trial, "w")
    # A Doppler log that loses one axis keeps the others.
    assert trial.valid[:, [0, 1]].all()


def test_quaternions_flip_sign_and_lose_length(table: dict[str, Any]) -> None:
    names = ("q_w", "q_x", "q_y", "q_z")
    for name in names:
        table[name][90:] *= -1.0
        table[name][90] *= 0.2
    trial = Trial.read(table, align=False)
    np.testing.assert_array_equal(np.flatnonzero(~trial.valid[:, 11]), [90])
    assert np.all(np.sum(trial.attitude[1:] * trial.attitude[:-1], axis=1) > 0.9)
    assert "1 sign flip " in findings(trial, "attitude")


def test_constant_sensors_and_saturated_commands_are_reported(table: dict[str, Any]) -> None:
    table["w_m_s"] = np.zeros(len(T))
    table["cmd.bow"] = np.clip(1500.0 + 900.0 * np.sin(T), 1100.0, 1900.0)
    table["cmd.idle"] = np.full(len(T), 1500.0)
    trial = Trial.read(table, align=False)
    assert "constant at 0" in findings(trial, "w")
    commands = findings(trial, "commands")
    assert "idle" in commands
    assert "bow 1900" in commands
    assert "stern" not in commands


def test_the_report_is_readable_and_plain_data(table: dict[str, Any]) -> None:
    import json

    table["u_m_s"][5] = np.nan
    trial = Trial.read(table)
    lines = str(trial.report).splitlines()
    assert lines[0] == "frame: 200 samples, 19.9 s at 10 Hz"
    assert lines[1].startswith("masked   u 1 (0.5 %)")
    assert json.loads(json.dumps(trial.report.to_dict()))["masked"]["u"] == 1


def test_a_channel_that_does_not_exist_is_named() -> None:
    trial = Trial.read({"t_s": T, "u_m_s": T})
    with pytest.raises(TrialError, match='"yow" is no channel; did you mean "yaw"'):
        trial.channel("yow")


ROWS = [f"{0.1 * i:.1f},{i}" for i in range(20)]


def write(path: Path, rows: list[str], header: str = "t_s,u_m_s") -> Path:
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([*ROWS[:5], "0.5,fast", *ROWS[6:]], r'u_m_s \(column "u_m_s"\): row 6: .* the text "fast" \(1 such'),
        (
            [*ROWS[:5], "0.3,5", *ROWS[6:]],
            r"row 6: expected a time after 0\.4 s, found 0\.3 s \(time running",
        ),
        (
            [*ROWS[:5], "0.4,5", *ROWS[6:]],
            r"row 6: expected a time after 0\.4 s, found 0\.4 s \(the same time",
        ),
        ([*ROWS[:5], "nan,5", *ROWS[6:]], r"t_s .* row 6: expected a time, found nan"),
        ([*ROWS[:5], "noon,5", *ROWS[6:]], r't_s .* row 6: expected a number, found the text "noon"'),
        ([*ROWS[:5], "0.5,5,7", *ROWS[6:]], r"not readable as a table"),
        (ROWS[:4], r"too short: expected at least 10 rows of samples, found 4"),
        ([], r"too short: expected at least 10 rows of samples, found 0"),
        ([row.split(",")[0] + "," for row in ROWS], r"u_m_s: every cell is empty"),
    ],
)
def test_bad_cells_are_answered_with_file_row_and_value(
    rows: list[str], message: str, tmp_path: Path
) -> None:
    path = write(tmp_path / "log.csv", rows)
    with pytest.raises(TrialError, match=message) as caught:
        Trial.read(path)
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize("form", ["quoted", "blanks", "text below", "tabs"])
def test_an_empty_cell_is_no_sample_in_any_layout(form: str, tmp_path: Path) -> None:
    """law: quotes, blanks and the separator change nothing of a log of two rates."""
    rows = [f"{0.1 * k:.1f},{0.05 * k if k % 4 == 0 else ''},{k}" for k in range(200)]
    header = "t_s,u_m_s,cmd.stern"
    plain = Trial.read(write(tmp_path / "plain.csv", rows, header))
    if form == "text below":  # every column is read as text
        other = [f'{row},"{"" if k < 150 else "a"}"' for k, row in enumerate(rows)]
        read = Trial.read(write(tmp_path / "log.csv", other, f"{header},word"))
    else:
        turned: Callable[[str], str] = {
            "quoted": lambda row: ",".join(f'"{cell}"' for cell in row.split(",")),
            "blanks": lambda row: row.replace(",", ", "),
            "tabs": lambda row: row.replace(",", "\t"),
        }[form]
        read = Trial.read(write(tmp_path / "log.csv", [turned(row) for row in rows], turned(header)))
    np.testing.assert_array_equal(read.t, plain.t)
    np.testing.assert_array_equal(read.valid, plain.valid)
    np.testing.assert_array_equal(read.observed, plain.observed)


def test_a_size_that_no_vehicle_reaches_is_no_sample(
    tmp_path: Path, recwarn: pytest.WarningsRecorder
) -> None:
    rows = [
        f"{0.1 * k:.1f},{'1e300' if k == 30 else 0.05 * k},{'-1e300' if k == 40 else k}" for k in range(200)
    ]
    trial = Trial.read(write(tmp_path / "log.csv", rows, "t_s,u_m_s,cmd.stern"))
    assert "1 samples of 1e+300 stand for no sample" in findings(trial, "u_m_s")
    assert "1 samples of -1e+300 stand for no sample" in findings(trial, "cmd.stern")
    assert np.flatnonzero(~trial.valid[:, CHANNELS.index("u")]).tolist() == [30]
    assert trial.commands["stern"][40] == 39.0
    assert not recwarn.list


@pytest.mark.parametrize(
    ("start", "step", "said"),
    [
        (
            1.7e12,
            50.0,
            "error    time: read as s, 0.02 Hz, and looks like ms (Unix time in ms); state the unit",
        ),
        (0.0, 50.0, "warning  time: read as s, 0.02 Hz, and looks like ms (whole numbers that rise"),
        (0.0, 0.1, ""),
        (1.7e9, 0.1, ""),
    ],
)
def test_times_in_another_unit_than_s_are_said(tmp_path: Path, start: float, step: float, said: str) -> None:
    rows = [f"{start + step * k!r},{0.05 * k}" for k in range(100)]
    path = write(tmp_path / "log.csv", rows)
    found = findings(Trial.read(path, align=False), "time")
    assert said in found if said else not found
    if said.startswith("error"):
        in_ms = Trial.read(path, columns={"t_s": {"from": "t_s", "unit": "ms"}}, align=False)
        assert not findings(in_ms, "time")


@pytest.mark.parametrize(
    ("start", "step", "said"),
    [
        (1.7e12, 100.0, r"the rows are 100 s apart; .* they look like ms \(Unix time in ms\)"),
        (1.7e15, 1e5, r"they look like us \(Unix time in us\)"),
        (0.0, 100.0, r"they look like ms \(whole numbers that rise"),
    ],
)
def test_times_further_apart_than_any_motion_shows_are_refused(
    tmp_path: Path, start: float, step: float, said: str
) -> None:
    path = write(tmp_path / "log.csv", [f"{start + step * k!r},{0.05 * k}" for k in range(100)])
    with pytest.raises(TrialError, match=said):
        Trial.read(path, align=False)


def test_columns_of_one_name_are_refused_where_they_are_used(tmp_path: Path) -> None:
    rows = [f"{0.1 * k:.1f},{0.05 * k},1,{0.04 * k},2" for k in range(20)]
    path = write(tmp_path / "log.csv", rows, "t_s,u_m_s,note,u_m_s,note")
    words = 'columns 2 and 4 have one name, "u_m_s", and it is used.*rename the others in the file'
    for call in (Trial.read, Predictions.read, MissionLog.read):
        with pytest.raises(TrialError, match=words):
            call(path)
    with pytest.raises(TrialError, match='columns 3 and 5 have one name, "note"'):
        Trial.read(path, columns={"v_m_s": "note"})
    other = write(tmp_path / "other.csv", [row[:-2] for row in rows], "t_s,u_m_s,note,note")
    assert Trial.read(other).valid[:, CHANNELS.index("u")].all()
    assert open_log(path).notes[0].startswith('columns 2 and 4 have one name, "u_m_s"')


def test_lines_that_end_in_a_carriage_return_alone_are_said(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(b"t_s,u_m_s\r" + b"".join(b"%d,1\r" % k for k in range(20)))
    with pytest.raises(TrialError, match=r"its lines end in a carriage return alone; .*save it"):
        Trial.read(path)


def test_quaternions_of_zeros_are_masked_and_most_of_them_refused(table: dict[str, Any]) -> None:
    for name in ("q_w", "q_x", "q_y", "q_z"):
        table[name][7] = 0.0
    assert not Trial.read(table, align=False).valid[7, 9:].any()
    for name in ("q_w", "q_x", "q_y", "q_z"):
        table[name][7:] = 0.0
    with pytest.raises(TrialError, match=r"row 8: expected a unit quaternion, found all zeros"):
        Trial.read(table)


def test_text_in_a_pandas_frame_is_named() -> None:
    pd = pytest.importorskip("pandas")
    speed: list[Any] = list(range(20))
    speed[3] = "fast"
    with pytest.raises(TrialError, match=r'row 4: expected a number, found the text "fast"'):
        Trial.read(pd.DataFrame({"t_s": T[:20], "u_m_s": speed}))


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    empty = tmp_path / "empty.csv"
    empty.write_text("")
    with pytest.raises(TrialError, match=r"empty\.csv: the file is empty"):
        Trial.read(empty)
    with pytest.raises(TrialError, match="there is no file"):
        Trial.read(tmp_path / "nowhere.csv")
    with pytest.raises(TrialError, match="is a folder, not a file"):
        Trial.read(tmp_path)
    other = write(tmp_path / "log.xyz", ROWS)
    with pytest.raises(TrialError, match=r'no reader for the ending "\.xyz"; expected one of \.csv'):
        Trial.read(other)
    assert len(Trial.read(other, reader="csv")) == 20
    with pytest.raises(TrialError, match=r'unknown reader "cvs"; did you mean "csv"'):
        Trial.read(other, reader="cvs")
    fake = tmp_path / "log.parquet"
    fake.write_text("no table")
    with pytest.raises(TrialError, match="not readable as Parquet"):
        Trial.read(fake)
    with pytest.raises(
        TrialError, match=r"expected the path of a file or a polars or pandas frame, found .*int"
    ):
        Trial.read(3)


def test_a_reader_may_be_a_function(tmp_path: Path) -> None:
    path = write(tmp_path / "log.bin", ROWS)
    assert len(Trial.read(path, reader=lambda file: pl.read_csv(file))) == 20


@pytest.mark.parametrize("key", ["rate_hz", "rho", "g"])
def test_settings_that_make_no_sense_are_refused(key: str) -> None:
    settings: dict[str, Any] = {key: -1.0}
    with pytest.raises(TrialError, match=f"{key}: expected a positive number, found -1.0"):
        Trial.read({"t_s": T, "u_m_s": T}, **settings)


def test_a_trial_is_written_only_where_it_can_be(tmp_path: Path) -> None:
    trial = Trial.read({"t_s": T, "u_m_s": T})
    with pytest.raises(TrialError, match=r"expected the ending \.csv or \.parquet"):
        trial.save(tmp_path / "trial.xlsx")
    with pytest.raises(TrialError, match="cannot be written"):
        trial.save(tmp_path / "no folder" / "trial.csv")
