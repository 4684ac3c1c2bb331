"""From the sensors of a vehicle to the sixteen channels of the closed loop.

The core samples seven groups of channels at whole control periods: white noise, an offset drawn once per
flight, a random walk, digits, a sampling interval, a latency and drop-outs. Sensors are described by kind
in the units of their columns (`seatrial.sensors`); here degrees become radians and seconds become control
periods. What a closed loop cannot represent is said in `SensorChannels.sentences`, never dropped in silence.

| kind | group |
|---|---|
| `position`, else dead reckoning from `dvl` | position |
| `depth`, `attitude`, `gyro`, `dvl`, `dvl_water` | depth, attitude, rates, velocity, water |
| `dvl` | altitude too, without error |

A Doppler log whose velocity has white noise of deviation s per sample, T seconds apart, integrates to a
random walk of deviation s √T after one second: the drift of dead reckoning. It begins with the offset of a
GPS fix.

Tests: ``tests/flight/test_sensor_channels.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from seatrial._core import autopilot_names
from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError, nearest
from seatrial.base.report import listed
from seatrial.sensors.sensor import KINDS, Sensor, load_sensors, one_each

if TYPE_CHECKING:
    from seatrial._core import Vehicle

GROUP_OF_KIND = {
    "position": "position",
    "gps": "position",
    "depth": "depth",
    "attitude": "attitude",
    "dvl": "velocity",
    "gyro": "rates",
    "dvl_water": "water",
}
"""The group that a kind of sensor tells."""

CHANNELS_OF_GROUP = {
    "position": (0, 1),
    "depth": (2,),
    "attitude": (3, 4, 5),
    "velocity": (6, 7, 8),
    "rates": (9, 10, 11),
    "altitude": (12,),
    "water": (13, 14, 15),
}
"""The channels of a group, by their places among those of the autopilot."""

_TICK = 1e-6  # of an interval, or s: rounding of times is no deviation
_MOST_LATE = 10_000  # control periods that the core keeps


@dataclass(frozen=True, eq=False)
class SensorChannels:
    """Sensors as the closed loop takes them.

    `errors` (16, 4): per channel noise, offset, random walk after one second and digit, SI and rad. `timing`
    (7, 5): per group whether it is there, interval and latency in control periods, mean time between
    drop-outs and their mean duration in s. `sentences`: what differs from the sensors as described.
    `acoustics`: per kind that only a navigation filter reads, GPS included, its numbers (17,); `transceiver`:
    where that of the acoustic positioning is, m.
    """

    errors: Array
    timing: Array
    sentences: tuple[str, ...] = ()
    acoustics: Mapping[str, Array] = field(default_factory=dict)
    transceiver: tuple[float, float, float] = (0.0, 0.0, 0.0)


def perfect() -> SensorChannels:
    """Channels without error at every control period."""
    return SensorChannels(np.zeros((16, 4)), np.tile([1.0, 1.0, 0.0, np.inf, 0.0], (7, 1)))


def sensors_of(
    source: Mapping[str, Sensor] | str | Path | None, vehicle: Vehicle
) -> dict[str, Sensor] | None:
    """Sensors by kind of "typical", a file or a mapping; None for perfect ones. A TrialError where they are
    not usable.
    """
    if source is None:
        return None
    if isinstance(source, str | Path):
        return load_sensors(source, vehicle)
    if not isinstance(source, Mapping):
        raise TrialError(f'sensors: expected {{kind: sensor}}, "typical" or a path, found {source!r}')
    for kind, sensor in source.items():
        if kind not in KINDS:
            raise TrialError(f'sensors: unknown sensor "{kind}"{nearest(kind, KINDS)}')
        if not isinstance(sensor, Sensor):
            raise TrialError(f"sensors: {kind}: expected a seatrial.sensors.sensor.Sensor, found {sensor!r}")
    one_each(source)
    return dict(source)


def sensor_channels(sensors: Mapping[str, Sensor] | None, period_s: float) -> SensorChannels:
    """Channels that the sensors tell at a control period, s; perfect ones for None."""
    if sensors is None:
        return perfect()
    if not sensors:
        raise TrialError(
            "sensors: expected at least one, found none; leave the argument out for perfect ones"
        )
    errors, timing = np.zeros((16, 4)), np.tile([0.0, 1.0, 0.0, np.inf, 0.0], (7, 1))
    groups = autopilot_names()["groups"]
    notes: list[str] = []
    for kind, sensor in sensors.items():
        group = GROUP_OF_KIND.get(kind)
        if group is None or kind == "gps":
            continue
        scale = math.pi / 180.0 if KINDS[kind].unit.startswith("deg") else 1.0
        for channel in CHANNELS_OF_GROUP[group]:
            errors[channel] = scale * np.array([sensor.noise, sensor.bias, 0.0, sensor.quantum])
        timing[groups.index(group)] = _timing(kind, sensor, period_s, notes)
    # A DVL that sees the bottom measures its distance, too.
    if "dvl" in sensors:
        timing[groups.index("altitude")] = timing[groups.index("velocity")]
    if "position" not in sensors:
        notes += _dead_reckoning(sensors, errors, timing, groups)
    notes += _left_out(sensors)
    # A group with an interval of zero has no samples at all.
    measured = {groups[k] for k in np.flatnonzero(timing[:, 0])}
    blind = [
        group for group in ("position", "depth", "attitude", "velocity", "rates") if group not in measured
    ]
    if blind:
        notes.append(f"No sensor measures {listed(blind)}: the autopilot will report that as missing.")
    return SensorChannels(errors, timing, tuple(notes), *_acoustics(sensors, period_s))


def _acoustics(
    sensors: Mapping[str, Sensor], period_s: float
) -> tuple[dict[str, Array], tuple[float, float, float]]:
    """Rows (17,) of what only a navigation filter reads, GPS included, as the core takes them, and the usbl's
    transceiver.
    """
    rows: dict[str, Array] = {}
    transceiver = (0.0, 0.0, 0.0)
    for kind, sensor in sensors.items():
        if not (KINDS[kind].aboard or kind == "gps"):
            continue
        scale = math.pi / 180.0 if KINDS[kind].unit.startswith("deg") else 1.0
        _, every, late, gap, length = _timing(kind, sensor, period_s, [])
        rows[kind] = np.array([
            *(scale * np.array([sensor.noise, sensor.bias, sensor.quantum])),
            *(every, float(round(sensor.phase_s / period_s)), late),
            *(gap, length),
            np.inf if sensor.max_range_m is None else sensor.max_range_m,
            *(sensor.outlier_share, scale * sensor.outlier),
            *sensor.position,
            *sensor.tilt,
        ])
        if kind == "usbl":
            transceiver = sensor.transceiver
    return rows, transceiver


def _timing(kind: str, sensor: Sensor, period_s: float, notes: list[str]) -> list[float]:
    """Row of the group; what was rounded is said."""
    interval = period_s if sensor.rate_hz is None else 1.0 / sensor.rate_hz
    every = max(1, round(interval / period_s))
    if abs(every * period_s - interval) > _TICK * interval:
        notes.append(
            f"{kind}: {sensor.rate_hz:g} Hz becomes a sample every {every * period_s:.3g} s, a whole number"
            f" of control periods of {period_s:g} s."
        )
    if sensor.latency_s > _MOST_LATE * period_s:
        raise TrialError(
            f"sensors: {kind}, key latency_s: expected at most {_MOST_LATE * period_s:g} s, found"
            f" {sensor.latency_s:g}"
        )
    late = round(sensor.latency_s / period_s)
    if abs(late * period_s - sensor.latency_s) > _TICK:
        notes.append(
            f"{kind}: a latency of {sensor.latency_s:g} s becomes {late * period_s:.3g} s, whole"
            " control periods."
        )
    silence = (np.inf, 0.0) if sensor.dropout_every_s is None else (sensor.dropout_every_s, sensor.dropout_s)
    return [1.0, float(every), float(late), float(silence[0]), float(silence[1] or 0.0)]


def _dead_reckoning(
    sensors: Mapping[str, Sensor], errors: Array, timing: Array, groups: list[str]
) -> list[str]:
    """Position from the Doppler log, begun at a GPS fix where there is one."""
    fix = sensors.get("gps")
    log = sensors.get("dvl")
    if log is None:
        return [] if fix is None else ["gps: under water it has no fix, and no dvl carries its last one on."]
    velocity = groups.index("velocity")
    walk = log.noise * math.sqrt(1.0 if log.rate_hz is None else 1.0 / log.rate_hz)
    offset = 0.0 if fix is None else fix.bias
    errors[[0, 1]] = [0.0, offset, walk, 0.0]
    timing[groups.index("position")] = [1.0, timing[velocity, 1], timing[velocity, 2], np.inf, 0.0]
    begins = "the true start" if fix is None else f"a GPS fix with an offset of {offset:g} m"
    return [
        f"Position is dead reckoning from {begins}: noise of the dvl makes a random walk of {walk:.2g} m"
        " after one second; its offset, that of the heading and its drop-outs are left out."
    ]


def _left_out(sensors: Mapping[str, Sensor]) -> list[str]:
    """Sentences on what sensors have and a closed loop has not."""
    carried = {kind: sensor for kind, sensor in sensors.items() if kind in GROUP_OF_KIND and kind != "gps"}
    notes = []
    clocks = [kind for kind, sensor in carried.items() if sensor.phase_s > 0.0 or sensor.jitter_s > 0.0]
    if clocks:
        notes.append(f"Phase and jitter of {listed(clocks)} are left out: samples come at control periods.")
    placed = [kind for kind, sensor in carried.items() if any(sensor.position)]
    if placed:
        notes.append(f"Lever arms of {listed(placed)} are left out: they show the motion of O.")
    tilted = [kind for kind, sensor in carried.items() if any(sensor.tilt)]
    if tilted:
        notes.append(f"The tilt of {listed(tilted)} is left out: in a flight they show the axes of the body.")
    ranged = [kind for kind, sensor in carried.items() if sensor.max_range_m is not None]
    if ranged:
        notes.append(f"The range of {listed(ranged)} is left out: the bottom is always within it.")
    if "dvl" in carried:
        notes.append("Where there is a bottom, the dvl measures the altitude too, without error.")
    for kind, why in (
        ("revolutions", "the autopilot sees the actuators' signals without error"),
        ("voltage", "the autopilot knows the supply without error"),
        ("load_cell", "a flight has no tether"),
    ):
        if kind in sensors:
            notes.append(f"{kind} is left out: {why}.")
    return notes
