"""Which column is the time of a table, and what is no time of a recording."""

from __future__ import annotations

import sqlite3
import struct
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import seatrial as st
from seatrial.base.errors import TrialError
from seatrial.logs.log import open_log

T = np.arange(0.0, 40.0, 0.1)
UNIX_S = 1_700_000_000


def _span(path: Path) -> tuple[float, float]:
    [topic] = open_log(path).topics()
    return topic.start_s, topic.end_s


def _csv(path: Path, columns: dict[str, Any]) -> Path:
    pl.DataFrame(columns).write_csv(path)
    return path


@pytest.mark.parametrize("stamp", ["field.header.stamp", "/dvl/header/stamp"])
def test_the_stamp_of_a_message_comes_before_that_of_its_record(stamp: str, tmp_path: Path) -> None:
    record = ((UNIX_S + T + 0.3) * 1e9).astype(np.int64)
    header = ((UNIX_S + T) * 1e9).astype(np.int64)
    path = _csv(tmp_path / "dvl.csv", {"%time": record, stamp: header, "field.velocity.x": T})
    assert _span(path) == pytest.approx((UNIX_S, UNIX_S + 39.9), abs=1e-3)


@pytest.mark.parametrize("header", [np.zeros_like(T), T * 1e9 + 5e9])
def test_a_header_without_a_stamp_or_of_another_clock_leaves_that_of_the_record(
    header: np.ndarray, tmp_path: Path
) -> None:
    record = ((UNIX_S + T) * 1e9).astype(np.int64)
    path = _csv(tmp_path / "dvl.csv", {"%time": record, "field.header.stamp": header.astype(np.int64)})
    assert _span(path) == pytest.approx((UNIX_S, UNIX_S + 39.9), abs=1e-3)


def test_a_header_of_one_topic_of_several_is_not_the_time_of_all_rows(tmp_path: Path) -> None:
    every_second = [UNIX_S + t if k % 2 == 0 else None for k, t in enumerate(T.tolist())]
    path = _csv(
        tmp_path / "plot.csv",
        {"__time": UNIX_S + T, "/imu/header/stamp": every_second, "/imu/angular_velocity/x": T},
    )
    [topic] = open_log(path).topics()
    assert topic.end_s == pytest.approx(UNIX_S + 39.9)
    assert np.isfinite(open_log(path).read({"plot": []})["plot"].t).all()


def _clock(seconds: np.ndarray) -> list[str]:
    return [f"{int(s // 3600) % 24:02}:{int(s // 60) % 60:02}:{s % 60.0:06.3f}" for s in seconds]


MIDNIGHT = 86_380.0 + T
"""s of the day, from 20 s before midnight on."""


@pytest.mark.parametrize("kind", ["text", "time", "datetime", "duration", "date as text"])
@pytest.mark.parametrize("source", ["frame", "csv", "parquet"])
def test_law_times_of_day_and_dates_are_read_everywhere(source: str, kind: str, tmp_path: Path) -> None:
    stamps = {
        "text": pl.Series(_clock(MIDNIGHT)),
        "time": pl.Series(((MIDNIGHT % 86_400.0) * 1e9).round().astype(np.int64)).cast(pl.Time),
        "datetime": pl.Series(((UNIX_S + T) * 1e6).round().astype(np.int64)).cast(pl.Datetime("us")),
        "duration": pl.Series((T * 1e6).round().astype(np.int64)).cast(pl.Duration("us")),
        "date as text": pl.Series([f"2024-02-28T{clock}Z" for clock in _clock(3600.0 + T)]),
    }[kind]
    table = pl.DataFrame({"t_s": stamps, "z_m": np.sin(T)})
    if source == "csv" and kind == "duration":
        pytest.skip("a table of text holds no durations")
    path = tmp_path / f"log.{source}"
    if source == "csv":
        table.write_csv(path)
    elif source == "parquet":
        table.write_parquet(path)
    trial = st.Trial.read(table if source == "frame" else path)
    assert trial.t[-1] - trial.t[0] == pytest.approx(39.9, abs=1e-6)
    if source != "frame":
        start, end = _span(path)
        assert end - start == pytest.approx(39.9, abs=1e-6)


def test_midnight_within_a_large_table_counts_once(tmp_path: Path) -> None:
    t = 86_000.0 + 0.005 * np.arange(500_000)  # 42 min: several blocks of text
    path = _csv(tmp_path / "log.csv", {"time": _clock(t), "depth_m": np.zeros(len(t))})
    start, end = _span(path)
    assert end - start == pytest.approx(0.005 * 499_999, abs=1e-3)


@pytest.mark.parametrize("factor", [1e9, 1e6])
def test_a_t_s_that_counts_in_another_unit_is_refused_with_the_unit(factor: float, tmp_path: Path) -> None:
    path = _csv(tmp_path / "log.csv", {"t_s": (T * factor).astype(np.int64), "z_m": np.sin(T)})
    unit = {1e9: "ns", 1e6: "us"}[factor]
    for read in (st.Trial.read, st.import_logs):
        with pytest.raises(TrialError, match=rf"log.csv: t_s .* they look like {unit}"):
            read(path)


def test_days_are_no_times(tmp_path: Path) -> None:
    days = pl.Series(np.arange(len(T))).cast(pl.Date)
    path = tmp_path / "log.parquet"
    pl.DataFrame({"t_s": days, "z_m": np.sin(T)}).write_parquet(path)
    with pytest.raises(TrialError, match=r"t_s.*the day 1970-01-01 alone"):
        st.Trial.read(path)
    with pytest.raises(TrialError, match=r"days without a time, the first 1970-01-01"):
        st.import_logs(path)


def test_a_bag_without_messages_says_which_table_is_missing(tmp_path: Path) -> None:
    from tests.logs import log_files

    folder = log_files.bag2_sqlite(tmp_path)
    [file] = folder.glob("*.db3")
    with sqlite3.connect(file) as data:
        data.execute("DROP TABLE messages")
    for path in (folder, file):
        with pytest.raises(TrialError, match=r'no table "messages".*the messages are missing'):
            open_log(path)


def _ulog(folder: Path, formats: list[str], topic: str) -> Path:
    def frame(kind: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(kind)) + body

    frames = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0), frame("B", bytes(40))]
    frames += [frame("F", one.encode()) for one in formats]
    frames += [frame("A", struct.pack("<BH", 0, 7) + topic.encode()), frame("D", struct.pack("<HQ", 7, 0))]
    path = folder / "log.ulg"
    path.write_bytes(b"".join(frames))
    return path


@pytest.mark.parametrize(
    ("formats", "said"),
    [
        ([f"n{k}:n{k + 1} a;n{k + 1} b;" for k in range(40)] + ["n40:uint8_t a;"], "numbers"),
        (["n0:n1[65535] a;", "n1:n2[65535] a;", "n2:uint8_t[65535] a;"], "numbers"),
        (["n0:uint64_t timestamp;n1 a;", "n1:n0 a;"], "holds itself"),
    ],
)
def test_nested_types_that_no_message_can_hold_are_refused(
    formats: list[str], said: str, tmp_path: Path
) -> None:
    with pytest.raises(TrialError, match=said):
        open_log(_ulog(tmp_path, formats, "n0"))


@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan, 2.5])
def test_a_frame_that_is_no_number_of_one_is_refused_with_the_file(value: float, tmp_path: Path) -> None:
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    lines += ["FMT, 131, 20, ATT, Qfff, TimeUS,Roll,Pitch,Yaw", "FMT, 129, 31, PARM, QNf, TimeUS,Name,Value"]
    lines += [f"PARM, 0, FRAME_CONFIG, {value}"]
    lines += [f"ATT, {round(t * 1e6)}, {np.sin(t)}, 0, {t}" for t in T]
    path = tmp_path / "a.log"
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(TrialError, match=rf"a.log: parameter FRAME_CONFIG.* found {value:g}"):
        st.import_logs(path)


def _four_sensors() -> dict[str, tuple[np.ndarray, list[str]]]:
    names = [
        ["roll_deg", "pitch_deg", "yaw_deg"],
        ["u_m_s", "v_m_s", "w_m_s"],
        ["z_m"],
        ["p_deg_s", "q_deg_s"],
    ]
    jitter = np.random.default_rng(1).uniform(0.0, 0.005, (4, len(T)))
    return {str(k): (T + 0.013 * k + jitter[k], one) for k, one in enumerate(names)}


@pytest.mark.parametrize("missing", [None, np.nan])
def test_law_sensors_of_10_hz_in_rows_of_their_own_make_10_hz(missing: float | None) -> None:
    """Put together with empty cells, as text has them, and with NaN, as a data frame of pandas does."""
    parts = [
        pl.DataFrame({"t_s": t} | {name: np.sin(0.3 * t) for name in names})
        for t, names in _four_sensors().values()
    ]
    table = pl.concat(parts, how="diagonal").sort("t_s")
    table = table.fill_null(missing) if missing is not None else table
    trial = st.Trial.read(table)
    assert trial.dt == pytest.approx(0.1, rel=0.01)
    assert len(trial) <= len(T)


def test_rows_that_repeat_the_samples_of_slower_sensors_make_no_rate_of_their_own() -> None:
    """A logger that writes a row whenever one of four sensors speaks, with the last samples of all others."""
    parts = [
        pl.DataFrame({"t_s": t} | {name: np.sin(0.3 * t) for name in names})
        for t, names in _four_sensors().values()
    ]
    table = pl.concat(parts, how="diagonal").sort("t_s")
    held = table.select(pl.all().forward_fill()).drop_nulls()
    held = held.with_columns(pl.Series("cmd.fin", np.sign(np.sin(held["t_s"].to_numpy()))))
    trial = st.Trial.read(held)
    assert trial.dt == pytest.approx(0.1, rel=0.01)
    # A yaw rate that is new in every row is a sensor of that rate.
    every_row = held.with_columns(pl.Series("r_deg_s", np.sin(held["t_s"].to_numpy())))
    assert st.Trial.read(every_row.drop("p_deg_s", "q_deg_s")).dt < 0.05


def test_a_sensor_that_drops_out_has_samples_without_a_number() -> None:
    depth = np.sin(0.3 * T)
    depth[100:140] = np.nan
    trial = st.Trial.read({"t_s": T, "z_m": depth})
    said = " ".join(str(finding) for finding in trial.report.findings)
    assert "40 NaN or infinite samples; masked" in said
