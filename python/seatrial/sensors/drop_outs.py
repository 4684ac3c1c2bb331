"""Drop-outs: a sensor works and is silent by turns, each for an exponentially distributed time.

With the means `every` and `length` it is silent for the share ``length / (every + length)`` of the time, and
so likely at the start (the stationary state of the two-state Markov process). Held by
tests/test_sensors_drop_outs.py.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from seatrial.sensors.sensor import Sensor

__all__ = ["silent"]

Array = NDArray[np.float64]


def silent(sensor: Sensor, t: Array, random: np.random.Generator) -> NDArray[np.bool_]:
    """Samples (m,) at the rising times `t` (m,), s, that a sensor's drop-outs swallow."""
    every, length = sensor.dropout_every_s, sensor.dropout_s
    if every is None or not length or len(t) == 0:
        return np.zeros(len(t), bool)
    off = bool(random.random() < length / (every + length))
    now = float(t[0])
    begins, states = [now], [off]
    while now <= t[-1]:
        now += float(random.exponential(length if off else every))
        off = not off
        begins.append(now)
        states.append(off)
    return np.array(states)[np.searchsorted(begins, t, side="right") - 1]
