"""What `Helm` makes of recorded sensors: no false alarm, and true ones where motion capture lost it.

Nobody flies by its commands here, so what it says of speed and actuators is not judged.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import seatrial as st
from seatrial._core import Helm
from seatrial.base.arrays import Array
from seatrial.base.frames import to_euler
from seatrial.logs.log import open_log

DATA = Path(os.environ.get("SEATRIAL_DATA", "/nonexistent"))
BELUGA, BLUEROV = DATA / "beluga", DATA / "bluerov2_heavy" / "00000029_filtered.BIN"

needs_beluga = pytest.mark.skipif(not BELUGA.is_dir(), reason="beluga is not here; set SEATRIAL_DATA")
needs_bluerov = pytest.mark.skipif(not BLUEROV.exists(), reason="bluerov2 is not here; set SEATRIAL_DATA")

STATION = """
format = 1
name = "station"
speed_m_s = 0.3
acceptance_radius_m = 6.0
limits.max_time_s = 1e5
[[legs]]
north_m = {x}
east_m = {y}
depth_m = 1.0
hold_s = 9e4
"""

OF_COMMANDS = ("", "speed", "actuator")

BLUEROV_CHANNELS = {
    "ATT": {"roll": "Roll", "pitch": "Pitch", "yaw": "Yaw"},
    "IMU[0]": {"p": "GyrX", "q": "GyrY", "r": "GyrZ"},
    "VISO": {"u": "PosDX", "v": "PosDY", "w": "PosDZ"},
    "BARO[1]": {"z": "Alt"},
    "XKF1[0]": {"x": "PN", "y": "PE"},
}
"""Sensors as they are, but for the position: the log has that of its own filter alone."""


def alarms(vehicle: str, t: Array, told: Mapping[str, Array]) -> tuple[list[tuple[float, str]], Helm]:
    """Time since the begin, s, and cause of each alarm about sensors; told (n,), NaN where none came."""
    station = STATION.format(x=told["x"][0], y=told["y"][0])
    helm = st.Autopilot.load(vehicle).engage(st.Vehicle.load(vehicle), st.Mission.from_toml(station))
    causes = [""]
    for k, time_s in enumerate(t):
        helm.step(
            {name: float(values[k]) for name, values in told.items()} | {"voltage": 15.0}, time_s=time_s
        )
        causes.append(str(helm.thought.get("cause", "")))
    begun = [now if now != before and now not in OF_COMMANDS else "" for before, now in pairwise(causes)]
    return [(float(t[k] - t[0]), cause) for k, cause in enumerate(begun) if cause], helm


@cache
def bluerov() -> tuple[Array, dict[str, Array]]:
    """Attitude's times, s, and what came since the last of them: m, rad, m/s and rad/s."""
    pytest.importorskip("pymavlink")
    wanted = {topic: tuple(fields.values()) for topic, fields in BLUEROV_CHANNELS.items()}
    log = open_log(BLUEROV).read(wanted | {"VISO": ("dt", *wanted["VISO"])})
    t, told = log["ATT"].t[1:], {}
    for topic, fields in BLUEROV_CHANNELS.items():
        newest = np.searchsorted(log[topic].t, t, side="right") - 1
        old = np.diff(newest, prepend=-1) == 0
        for name, field in fields.items():
            values = log[topic].fields[field]
            values = values / log[topic].fields["dt"] if topic == "VISO" else values
            told[name] = np.where(old, np.nan, values[newest])
    angles = {name: np.deg2rad(told[name]) for name in ("roll", "pitch", "yaw")}
    return t, told | angles | {"z": -told["z"]}


@needs_bluerov
def test_sensors_of_a_recorded_dive_give_no_alarm() -> None:
    found, helm = alarms("bluerov2-heavy", *bluerov())
    assert found == []
    assert helm.refused == {}


@needs_bluerov
@pytest.mark.parametrize(
    ("channel", "cause"), [("r", "attitude"), ("yaw", "position"), ("u", "position"), ("w", "depth")]
)
def test_a_wrong_sign_in_a_recorded_dive_is_told(channel: str, cause: str) -> None:
    t, told = bluerov()
    found, _ = alarms("bluerov2-heavy", t, told | {channel: -told[channel]})
    assert f"contradicted_{cause}" in {each for _, each in found}


@needs_beluga
@pytest.mark.parametrize(
    ("run", "true"),
    [
        ("surge-1", []),
        # The pose leaps by up to 180 deg for four seconds; the gyro reads 0.7 rad/s at most.
        ("sway-1", [(685, "stale_attitude")]),
        ("heave-1", []),
        ("yaw-1", []),
        # Back after a gap of 0.4 s the pitch is off by 12 deg for a sample; the gyro reads -4 deg/s.
        ("random-1", [(110, "contradicted_attitude")]),
    ],
)
def test_belugas_sensors_give_alarms_where_motion_capture_lost_it_alone(
    run: str, true: list[tuple[int, str]]
) -> None:
    rows = pl.read_csv(BELUGA / f"synchronized-{run}.csv")

    def columns(name: str, parts: str, signs: tuple[float, ...]) -> Array:
        signed = zip(parts, signs, strict=True)
        return np.stack([sign * rows[f"{name}{part}"].to_numpy() for part, sign in signed], axis=1)

    q, turned = columns("orientation_", "wxyz", (1.0, 1.0, -1.0, -1.0)), (1.0, -1.0, -1.0)
    position, angles = columns("position_", "xyz", turned), to_euler(q / np.linalg.norm(q, axis=1)[:, None])
    # The gyro's signs about x and y are reversed.
    rates = columns("angular_", "xyz", (-1.0, 1.0, -1.0))
    values = np.hstack([position, angles, columns("linear_", "xyz", turned), rates])
    fresh = np.append(True, np.any(np.diff(position, axis=0) != 0.0, axis=1))
    names = ("x", "y", "z", "roll", "pitch", "yaw", "u", "v", "w", "p", "q", "r")
    told = dict(zip(names, values[fresh].T, strict=True))
    found, _ = alarms("beluga", rows["Time"].to_numpy()[fresh], told)
    assert [(round(t), cause) for t, cause in found] == true
