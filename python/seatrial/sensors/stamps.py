"""When sensors sample: in step with the log, or on a time base of their own.

A sensor of the log's rate, or of a whole fraction of it, samples in rows of the log. One with a phase, a
jitter or any other rate f has its own base: it samples at ``t_k = t_0 + phase + k / f`` what was true a
latency earlier, and stamps it ``t_k + jitter``. Stamps keep their order: jitter ends at 0.45 / f.

Held by tests/test_sensors_stamps.py.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from seatrial.sensors.sensor import Sensor

__all__ = ["asynchronous", "finer", "own_stamps", "rows"]

Array = NDArray[np.float64]

_LONGEST_S = 0.01  # between rows of the run that a sensor with its own base looks at
_LARGEST = 0.45  # of the interval: a larger jitter would change the order of stamps
_TICK = 1e-6


def asynchronous(sensor: Sensor, t: Array) -> bool:
    """Whether a sensor has a time base of its own beside the log's uniform times `t` (n,).

    Examples
    --------
    >>> t = np.arange(0.0, 10.0, 0.1)
    >>> [asynchronous(Sensor(rate_hz=rate), t) for rate in (5.0, 4.0, 20.0)]
    [False, True, True]
    """
    if sensor.phase_s > 0.0 or sensor.jitter_s > 0.0:
        return True
    if sensor.rate_hz is None or len(t) < 2:
        return False
    intervals = 1.0 / (sensor.rate_hz * _step(t))
    return round(intervals) < 1 or abs(intervals - round(intervals)) > _TICK * intervals


def finer(sensors: Iterable[Sensor], t: Array) -> int:
    """Rows of the run per row of the log `t` (n,): 1, or so many that a sensor may sample in between."""
    if not any(asynchronous(sensor, t) for sensor in sensors):
        return 1
    return max(1, math.ceil(_step(t) / _LONGEST_S - _TICK))


def rows(sensor: Sensor, t: Array) -> NDArray[np.bool_]:
    """Rows (n,) of the log in which a sensor in step with it gives a sample."""
    if sensor.rate_hz is None:
        return np.ones(len(t), bool)
    count = np.floor((t - t[0]) * sensor.rate_hz + _TICK)
    return np.concatenate([[True], np.diff(count) > 0.0])


def own_stamps(sensor: Sensor, t: Array, random: np.random.Generator) -> tuple[Array, Array]:
    """Stamps (m,) of a sensor with its own base within the log's times `t` (n,), and its regular times, s."""
    interval = _step(t) if sensor.rate_hz is None else 1.0 / sensor.rate_hz
    first = t[0] + sensor.phase_s
    count = max(int(np.floor((t[-1] - first) / interval + _TICK)) + 1, 0)
    regular = first + interval * np.arange(count)
    miss = np.clip(random.normal(0.0, sensor.jitter_s, count), -_LARGEST * interval, _LARGEST * interval)
    stamps = regular + miss
    logged = (stamps >= t[0]) & (stamps <= t[-1] + _TICK)
    return stamps[logged], regular[logged]


def _step(t: Array) -> float:
    return float(t[-1] - t[0]) / (len(t) - 1)
