"""One uniform time base: continuous channels linearly between neighbours, commands held, gaps left open.

A point of the base is valid where both neighbouring samples are good and no further apart than `GAP` times
the sensor's own interval; elsewhere the value is a fill that no criterion may use.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from seatrial.recording.signal import Signal
from seatrial.rotation import continuous

__all__ = ["GAP", "between", "held", "linear", "uniform"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

GAP = 1.9
"""Longest distance between neighbours that is no gap, in median intervals: one lost sample is a gap."""

_TICK = 1e-6  # two times closer than this share of an interval are the same


def uniform(t: Array, rate_hz: float | None) -> Array:
    """Uniform times in s from the first sample on, shape (n,), at `rate_hz` or the median interval of `t`."""
    step = 1.0 / rate_hz if rate_hz else float(np.median(np.diff(t)))
    if not rate_hz:
        # The mean interval of an evenly sampled log is exact where the median carries the clock's rounding.
        mean = (t[-1] - t[0]) / (len(t) - 1)
        step = mean if abs(mean - step) * len(t) < 0.1 * step else step
    count = int(np.floor((t[-1] - t[0]) / step + 1e-3)) + 1
    return np.asarray(t[0] + step * np.arange(count))


def held(signal: Signal, t: Array) -> Array:
    """Last sample at or before each time, shape (n, k); before the first one, the first."""
    index = np.searchsorted(signal.t, t + _TICK * np.min(np.diff(t)), side="right") - 1
    return signal.y[np.maximum(index, 0)]


def linear(signal: Signal, t: Array) -> tuple[Array, Mask]:
    """Values (n, k) at the times `t` and which of them are valid (n, k)."""
    if signal.name == "attitude":
        return _attitude(signal, t)
    columns = [
        between(signal.t, signal.y[:, k], signal.bad[:, k], t, signal.step) for k in range(signal.y.shape[1])
    ]
    return np.stack([y for y, _ in columns], axis=1), np.stack([valid for _, valid in columns], axis=1)


def _attitude(signal: Signal, t: Array) -> tuple[Array, Mask]:
    """Chord between neighbouring attitudes, normalised: at ordinary rates the great circle to 1e-6 rad."""
    good = signal.good
    if not good.any():
        return np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)), np.zeros((len(t), 4), bool)
    q, _ = continuous(signal.y[good])
    times = signal.t[good]
    value = np.stack([np.interp(t, times, q[:, k]) for k in range(4)], axis=1)
    value /= np.linalg.norm(value, axis=1)[:, None]
    _, valid = between(signal.t, signal.y[:, 0], signal.bad[:, 0], t, signal.step)
    return value, np.repeat(valid[:, None], 4, axis=1)


def between(times: Array, y: Array, bad: Mask, t: Array, step: float) -> tuple[Array, Mask]:
    """Values (n,) at the times `t` of samples `y` (m,) at `times`, `step` apart, and which are valid."""
    good = ~bad
    if not good.any():
        return np.zeros(len(t)), np.zeros(len(t), bool)
    last = len(times) - 1
    tick = _TICK * step
    before = np.clip(np.searchsorted(times, t + tick, side="right") - 1, 0, last)
    after = np.clip(np.searchsorted(times, t - tick, side="left"), 0, last)
    inside = (t >= times[0] - tick) & (t <= times[-1] + tick)
    near = times[after] - times[before] <= GAP * step
    return np.interp(t, times[good], y[good]), inside & near & good[before] & good[after]
