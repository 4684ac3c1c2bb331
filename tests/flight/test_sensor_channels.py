"""From sensors by kind to the channels of the closed loop: units, times, and what is said to be left out."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import seatrial as st
from seatrial import _core
from seatrial.base.errors import TrialError
from seatrial.flight.sensor_channels import (
    GROUP_OF_KIND,
    SensorChannels,
    perfect,
    sensor_channels,
    sensors_of,
)
from seatrial.sensors.sensor import KINDS, Sensor

PERIOD_S = 0.1
NAMES = _core.autopilot_names()


def row(channels: SensorChannels, name: str) -> list[float]:
    return [float(x) for x in channels.errors[NAMES["channels"].index(name)]]


def timing(channels: SensorChannels, group: str) -> list[float]:
    return [float(x) for x in channels.timing[NAMES["groups"].index(group)]]


def said(channels: SensorChannels) -> str:
    return "\n".join(channels.sentences)


def test_perfect_sensors_show_every_channel_at_every_period() -> None:
    channels = sensor_channels(None, PERIOD_S)
    assert not channels.errors.any()
    assert np.array_equal(channels.timing, np.tile([1.0, 1.0, 0.0, np.inf, 0.0], (7, 1)))
    assert channels.sentences == ()
    assert np.array_equal(perfect().timing, channels.timing)


def test_degrees_become_radians_and_metres_stay() -> None:
    sensors = {
        "gyro": Sensor(noise=0.5, bias=0.25, quantum=0.01),
        "attitude": Sensor(noise=1.0, bias=2.0),
        "depth": Sensor(noise=0.01, bias=0.03, quantum=0.001),
        "dvl": Sensor(noise=0.008),
        "position": Sensor(noise=0.4, bias=1.0),
    }
    channels = sensor_channels(sensors, PERIOD_S)
    for name in ("p", "q", "r"):
        assert row(channels, name) == pytest.approx([
            math.radians(0.5),
            math.radians(0.25),
            0.0,
            math.radians(0.01),
        ])
    assert row(channels, "yaw") == pytest.approx([math.radians(1.0), math.radians(2.0), 0.0, 0.0])
    assert row(channels, "z") == [0.01, 0.03, 0.0, 0.001]
    assert row(channels, "v") == [0.008, 0.0, 0.0, 0.0]
    assert row(channels, "y") == [0.4, 1.0, 0.0, 0.0]
    assert row(channels, "altitude") == [0.0, 0.0, 0.0, 0.0]


def test_every_kind_that_moves_goes_to_the_group_of_its_columns() -> None:
    channel_of = {"x_m": "position", "z_m": "depth", "roll_deg": "attitude", "u_m_s": "velocity"}
    channel_of |= {"p_deg_s": "rates", "u_water_m_s": "water"}
    for kind, group in GROUP_OF_KIND.items():
        assert channel_of[KINDS[kind].columns[0]] == group, kind
    aboard = {kind for kind in KINDS if KINDS[kind].aboard}
    assert set(GROUP_OF_KIND) == set(KINDS) - {"revolutions", "voltage", "load_cell"} - aboard


def test_rates_and_latencies_become_whole_control_periods_and_rounding_is_said() -> None:
    even = sensor_channels({"depth": Sensor(rate_hz=5.0, latency_s=0.2)}, PERIOD_S)
    assert timing(even, "depth") == [1.0, 2.0, 2.0, math.inf, 0.0]
    assert "depth:" not in said(even)
    odd = sensor_channels({"depth": Sensor(rate_hz=4.0, latency_s=0.12)}, PERIOD_S)
    assert timing(odd, "depth")[:3] == [1.0, 2.0, 1.0]
    assert "depth: 4 Hz becomes a sample every 0.2 s" in said(odd)
    assert "depth: a latency of 0.12 s becomes 0.1 s" in said(odd)
    fast = sensor_channels({"gyro": Sensor(rate_hz=100.0)}, PERIOD_S)
    assert timing(fast, "rates")[1] == 1.0


def test_drop_outs_are_carried_over() -> None:
    channels = sensor_channels({"dvl": Sensor(dropout_every_s=90.0, dropout_s=2.0)}, PERIOD_S)
    assert timing(channels, "velocity") == [1.0, 1.0, 0.0, 90.0, 2.0]
    assert timing(channels, "altitude") == timing(channels, "velocity")
    assert timing(channels, "position")[3:] == [math.inf, 0.0]


def test_position_without_its_sensor_is_dead_reckoning_from_the_doppler_log() -> None:
    sensors = {"dvl": Sensor(noise=0.02, rate_hz=5.0), "gps": Sensor(noise=1.0, bias=1.5)}
    channels = sensor_channels(sensors, PERIOD_S)
    # White noise of 0.02 m/s per sample, 0.2 s apart: after n samples the variance is n (0.02 * 0.2)^2.
    assert row(channels, "x") == pytest.approx([0.0, 1.5, 0.02 * 0.2 * math.sqrt(5.0), 0.0])
    assert "dead reckoning from a GPS fix with an offset of 1.5 m" in said(channels)
    alone = sensor_channels({"gps": Sensor(noise=1.0)}, PERIOD_S)
    assert timing(alone, "position")[0] == 0.0
    assert "no dvl carries its last one on" in said(alone)


def test_what_a_closed_loop_cannot_represent_is_said() -> None:
    channels = sensor_channels(
        {
            "dvl": Sensor(phase_s=0.03, position=(0.4, 0.0, 0.1), max_range_m=75.0),
            "gyro": Sensor(jitter_s=0.001),
            "revolutions": Sensor(noise=2.0),
            "voltage": Sensor(noise=0.1),
            "load_cell": Sensor(noise=0.1),
        },
        PERIOD_S,
    )
    assert "Phase and jitter of dvl and gyro are left out" in said(channels)
    assert "Lever arms of dvl are left out" in said(channels)
    assert "The range of dvl is left out" in said(channels)
    for kind in ("revolutions", "voltage", "load_cell"):
        assert f"{kind} is left out" in said(channels)
    assert "No sensor measures depth and attitude" in said(channels)


def test_typical_sensors_tell_all_that_an_autopilot_needs() -> None:
    sensors = sensors_of("typical", st.Vehicle.load("cwolf"))
    channels = sensor_channels(sensors, PERIOD_S)
    assert channels.timing[:, 0].tolist() == [1.0] * 7
    assert "No sensor measures" not in said(channels)
    assert row(channels, "roll")[1] == pytest.approx(math.radians(0.2))


def test_sensors_that_are_none_are_refused(tmp_path: Path) -> None:
    cwolf = st.Vehicle.load("cwolf")
    with pytest.raises(TrialError, match='unknown sensor "dvll"; did you mean "dvl"'):
        sensors_of({"dvll": Sensor()}, cwolf)
    with pytest.raises(TrialError, match=r"gyro: expected a seatrial\.sensors\.sensor\.Sensor, found 0\.1"):
        sensors_of({"gyro": 0.1}, cwolf)  # type: ignore[dict-item]
    with pytest.raises(TrialError, match="position and gps both log x_m"):
        sensors_of({"position": Sensor(), "gps": Sensor()}, cwolf)
    with pytest.raises(TrialError, match="expected at least one, found none"):
        sensor_channels({}, PERIOD_S)
    with pytest.raises(TrialError, match=r"none\.toml"):
        sensors_of(tmp_path / "none.toml", cwolf)
