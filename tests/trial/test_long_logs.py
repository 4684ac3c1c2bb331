"""Logs of millions of rows: memory that a laptop has, and a word on how far the reading is."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from seatrial import Trial
from seatrial.base.errors import TrialError
from seatrial.base.work import Progress
from seatrial.cli.console import reading_progress

pytestmark = pytest.mark.long

ROWS = 400_000

PEAK = r"""
import re, sys
from pathlib import Path
from seatrial import Trial

def peak() -> int:
    # Of this program alone: what getrusage tells includes the peak of the process that started it.
    return 1024 * int(re.search(r"VmHWM:\s*(\d+)", Path("/proc/self/status").read_text())[1])

Trial.read(sys.argv[1], align=False)  # what is imported
before = peak()
trial = Trial.read(sys.argv[2], align=False)
print((peak() - before) / len(trial))
"""


def log(rows: int) -> pl.DataFrame:
    """A log of pose, velocities, rates and two commands."""
    t = 0.1 * np.arange(rows)
    yaw, u = 0.3 * np.sin(0.05 * t), 1.0 + 0.2 * np.sin(0.02 * t)
    columns = {
        "x_m": 0.1 * np.cumsum(u * np.cos(yaw)),
        "y_m": 0.1 * np.cumsum(u * np.sin(yaw)),
        "z_m": 5.0 + 0.5 * np.sin(0.03 * t),
        "roll_deg": np.sin(0.2 * t),
        "pitch_deg": np.sin(0.1 * t),
        "yaw_deg": np.degrees(yaw),
        "u_m_s": u,
        "v_m_s": 0.01 * np.sin(0.3 * t),
        "w_m_s": 0.015 * np.cos(0.03 * t),
        "p_deg_s": 0.2 * np.cos(0.2 * t),
        "q_deg_s": 0.1 * np.cos(0.1 * t),
        "r_deg_s": np.degrees(0.015 * np.cos(0.05 * t)),
        "cmd.stern": 0.5 + 0.1 * np.sin(0.02 * t),
        "cmd.rudder": 0.1 * np.sin(0.05 * t),
    }
    noise = np.random.default_rng(4)
    table = {name: y + 1e-3 * noise.standard_normal(rows) for name, y in columns.items()}
    return pl.DataFrame({"t_s": t} | table).select(pl.all().round(5))


def test_a_long_log_takes_five_times_the_memory_of_its_numbers(tmp_path: Path) -> None:
    log(200).write_csv(tmp_path / "short.csv")
    log(ROWS).write_csv(tmp_path / "long.csv")
    files = [str(tmp_path / name) for name in ("short.csv", "long.csv")]
    run = subprocess.run(
        [sys.executable, "-c", PEAK, *files], capture_output=True, text=True, check=True, timeout=300
    )
    # The trial itself takes 250 bytes a row, the signals beside it 150; comparing the channels takes 60 MB,
    # whatever the length. As text and with copies it took 1200; with the samples of every channel once more
    # at the stamps of the time base 690.
    assert float(run.stdout) < 620.0


def test_a_sensor_with_the_stamps_of_the_time_base_has_no_second_copy() -> None:
    table = log(300)
    slow = table.with_columns(pl.when(pl.int_range(300) % 3 == 0).then("z_m").alias("z_m"))
    assert Trial.read(table, align=False, level=False).samples == {}
    assert list(Trial.read(slow, align=False, level=False).samples) == ["z"]


def test_cells_that_become_text_late_are_still_named(tmp_path: Path) -> None:
    table = log(300).with_columns(pl.col("u_m_s").cast(pl.String))
    table[250, "u_m_s"] = "broken"
    table.write_csv(tmp_path / "late.csv")
    with pytest.raises(TrialError, match=r'row 251: expected a number, found the text "broken"'):
        Trial.read(tmp_path / "late.csv")


def test_numbers_and_text_give_the_same_samples(tmp_path: Path) -> None:
    table = log(300)
    table.write_csv(tmp_path / "numbers.csv")
    # A blank in front of a number makes it text.
    blank = [(" " + pl.col(name).cast(pl.String)).alias(name) for name in table.columns]
    table.select(blank).write_csv(tmp_path / "text.csv")
    numbers, text = (Trial.read(tmp_path / name) for name in ("numbers.csv", "text.csv"))
    np.testing.assert_array_equal(numbers.observed, text.observed)
    np.testing.assert_array_equal(numbers.commands["stern"], text.commands["stern"])


def test_reading_says_how_far_it_is() -> None:
    told: list[Progress] = []
    Trial.read(log(300), name="dive", progress=told.append)
    assert [one.detail for one in told][:2] == ["table", "units and frames"]
    assert {one.what for one in told} == {"reading dive"}
    shares = [one.fraction for one in told]
    assert shares == sorted(shares)
    assert shares[0] == 0.0
    assert shares[-1] < 1.0


def test_only_a_long_reading_is_worth_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    show = reading_progress()
    assert show is not None
    assert reading_progress(quiet=True) is None
    show(Progress("reading dive", 2, 5, 0.1, 0.5, 4.5, detail="defects"))
    assert capsys.readouterr().err == ""
    show(Progress("reading dive", 2, 5, 0.1, 3.0, 27.0, detail="defects"))
    assert capsys.readouterr().err == " 10 %  reading dive: defects, about 27 s left\n"
