"""Recordings of the hover AUV Beluga: what is known about their defects is found without being told."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seatrial.trial.trial import Trial

FOLDER = Path(os.environ.get("SEATRIAL_DATA", "/nonexistent")) / "beluga"

pytestmark = pytest.mark.skipif(
    not FOLDER.is_dir(), reason="the recordings of Beluga are not here; set SEATRIAL_DATA to their folder"
)

RUNS = ("surge-1", "sway-1", "random-1")
"""All five are in the long tests of tests/inspect/test_consistency_recordings.py."""

COLUMNS: dict[str, Any] = {
    "t_s": "Time",
    **{f"{axis}_m": {"from": f"position_{axis}", "frame": "NWU"} for axis in "xyz"},
    **{f"q_{part}": {"from": f"orientation_{part}", "frame": "FLU/NWU"} for part in "wxyz"},
    **{f"{a}_m_s": {"from": f"linear_{b}", "frame": "FLU"} for a, b in zip("uvw", "xyz", strict=True)},
    **{
        f"{a}_deg_s": {"from": f"angular_{b}", "unit": "rad/s", "frame": "FLU"}
        for a, b in zip("pqr", "xyz", strict=True)
    },
    "voltage_v": "voltage",
    "cmd.thruster_0": {"from": "positive_width_us_0", "unit": "us"},
    **{f"cmd.thruster_{k}": {"from": f"pwm_{k}", "unit": "us"} for k in range(1, 8)},
}


@cache
def trial(run: str) -> Trial:
    return Trial.read(FOLDER / f"synchronized-{run}.csv", columns=COLUMNS)


def counts(run: str, words: str) -> dict[str, int]:
    """Counts of the findings whose message has these words, by channel."""
    return {f.subject: f.count or 0 for f in trial(run).report.findings if words in f.message}


@pytest.mark.parametrize("run", RUNS)
def test_latencies_against_the_pose(run: str) -> None:
    latencies = trial(run).report.latencies
    # published for these recordings: 0.24 s and 0.075 s; a low-passed velocity has no single delay
    assert latencies["velocity"] == pytest.approx(0.24, abs=0.04)
    assert latencies["rates"] == pytest.approx(0.075, abs=0.005)


@pytest.mark.parametrize("run", RUNS)
def test_the_gyros_signs_about_x_and_y_are_reversed(run: str) -> None:
    assert set(counts(run, "sign reversed")) == {"p", "q"}


@pytest.mark.parametrize(("run", "frozen"), [("surge-1", 195), ("sway-1", 163), ("random-1", 28)])
def test_frozen_poses_are_counted_and_masked(run: str, frozen: int) -> None:
    assert counts(run, "frozen").get("position", 0) == frozen
    assert int((~trial(run).valid[:, 6]).sum()) >= frozen


@pytest.mark.parametrize("run", RUNS)
def test_quaternions_out_of_length_are_masked(run: str) -> None:
    # "1 to 20 per run", counted with another tolerance on the length
    assert 1 <= counts(run, "unit quaternion")["attitude"] <= 22
    np.testing.assert_allclose(np.linalg.norm(trial(run).attitude, axis=1), 1.0, atol=1e-12)


@pytest.mark.parametrize("run", RUNS)
def test_most_of_a_run_is_usable(run: str) -> None:
    assert trial(run).startable.mean() > 0.95
    assert trial(run).valid[:, :6].mean() > 0.97


def test_wrong_solutions_of_the_motion_capture_in_sway_are_masked() -> None:
    # Between 683 s and 701 s the recorded attitude turns over several times within seconds.
    wrong = (trial("sway-1").t > 683.5) & (trial("sway-1").t < 701.0)
    assert not trial("sway-1").valid[wrong, 9].any()
    attitude = np.where(trial("sway-1").valid[:, 9:11], trial("sway-1").observed[:, 9:11], 0.0)
    assert np.abs(attitude).max() < np.deg2rad(20.0)
