"""Recordings with known errors: a foreign simulator's mission with its truth, and Beluga's five runs."""

from __future__ import annotations

import gzip
import os
import re
from functools import cache
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from seatrial.base.arrays import Array
from seatrial.base.frames import to_euler
from seatrial.inspect.consistency import consistency
from seatrial.inspect.corrections import Consistency, Correction
from seatrial.trial.signals import Series

DATA = Path(os.environ.get("SEATRIAL_DATA", "/nonexistent"))
FIELD, BELUGA = DATA / "field_torpedo", DATA / "beluga"

needs_field = pytest.mark.skipif(not FIELD.is_dir(), reason="field_torpedo is not here; set SEATRIAL_DATA")
needs_beluga = pytest.mark.skipif(not BELUGA.is_dir(), reason="beluga is not here; set SEATRIAL_DATA")

FILES = {
    "attitude": ("yaw", "pitch"),
    "depth": ("z",),
    "dvl": ("u", "v", "w"),
    "fins": ("cmd.rudder", "cmd.planes", "cmd.propeller"),
}


@cache
def field() -> Consistency:
    """The bare numbers of the four files, in the units of the files."""
    series: dict[str, Series] = {}
    for file, channels in FILES.items():
        rows = np.genfromtxt(FIELD / f"{file}.csv", delimiter=",", skip_header=3)
        series |= {name: Series(rows[:, 0], rows[:, k + 1], file) for k, name in enumerate(channels)}
    return consistency(series)


@cache
def beluga(run: str) -> Consistency:
    """The run with its frame (forward, left, up) turned to NED and FRD and nothing else."""
    rows = pl.read_csv(BELUGA / f"synchronized-{run}.csv")

    def columns(name: str, parts: str, signs: tuple[float, ...]) -> Array:
        return np.stack(
            [sign * rows[f"{name}{part}"].to_numpy() for part, sign in zip(parts, signs, strict=True)], axis=1
        )

    q = columns("orientation_", "wxyz", (1.0, 1.0, -1.0, -1.0))
    turned = (1.0, -1.0, -1.0)
    values = {
        ("x", "y", "z"): columns("position_", "xyz", turned),
        ("roll", "pitch", "yaw"): to_euler(q / np.linalg.norm(q, axis=1)[:, None]),
        ("u", "v", "w"): columns("linear_", "xyz", turned),
        ("p", "q", "r"): columns("angular_", "xyz", turned),
    }
    t = rows["Time"].to_numpy()
    return consistency({n: Series(t, y[:, k]) for names, y in values.items() for k, n in enumerate(names)})


def of(found: Consistency, key: str) -> Correction:
    return next(one for one in found.corrections if one.key == key)


@pytest.mark.long
@needs_field
def test_the_doppler_logs_unit_tilt_and_clock_are_found() -> None:
    found = field()
    assert {one.key for one in found.corrections} == {
        "scale.velocity",
        "tilt_deg.velocity",
        "dvl.offset_s",
        "dvl.drift",
    }
    assert of(found, "scale.velocity").value == 1e-3
    assert of(found, "tilt_deg.velocity").value[1] == pytest.approx(0.9, abs=0.2)
    assert of(found, "dvl.offset_s").value == pytest.approx(0.37 + 0.12, abs=0.02)
    assert of(found, "dvl.drift").value == pytest.approx(40e-6, abs=20e-6)


@pytest.mark.long
@needs_field
def test_missing_roll_is_said_and_the_list_that_follows() -> None:
    said = " ".join(field().missing)
    assert "no roll" in said
    assert "no p q r" in said
    found = re.search(r"mean list of (\S+) deg", said)
    assert found
    assert float(found[1]) == pytest.approx(0.55, abs=0.1)  # truth


@needs_field
def test_the_slow_current_is_within_three_centimetres_a_second() -> None:
    found = field().current
    assert found is not None
    with gzip.open(FIELD / "truth.csv.gz") as file:
        truth = np.genfromtxt(file, delimiter=",", names=True)
    names = ("current_north_m_s", "current_east_m_s")
    known = np.stack([np.interp(found.t, truth["t_s"], truth[name]) for name in names], axis=1)
    assert np.sqrt(np.mean((found.velocity - known) ** 2)) < 0.03
    assert found.after[0] < 0.2 * found.before[0]
    assert found.after[1] < 0.3 * found.before[1]


@needs_beluga
@pytest.mark.parametrize("run", ["surge-1", "sway-1", "heave-1", "yaw-1", "random-1"])
@pytest.mark.long
def test_belugas_gyro_signs_and_delays_are_found(run: str) -> None:
    found = beluga(run)
    keys = {one.key for one in found.corrections} - {"tilt_deg.frame"}
    assert keys == {"signs.p", "signs.q", "delay_s.velocity", "delay_s.rates"}
    # published: 0.24 s and 0.075 s; a low-passed velocity has no single delay
    assert of(found, "delay_s.velocity").value == pytest.approx(0.24, abs=0.04)
    assert of(found, "delay_s.rates").value == pytest.approx(0.075, abs=0.005)


@pytest.mark.long
@needs_beluga
@pytest.mark.parametrize("run", ["surge-1", "yaw-1", "random-1"])
def test_the_tilt_of_belugas_frame_is_found(run: str) -> None:
    angle = np.hypot(*of(beluga(run), "tilt_deg.frame").value)
    assert angle == pytest.approx(3.8, abs=0.6)  # of the session; one run knows it to 0.4 deg
