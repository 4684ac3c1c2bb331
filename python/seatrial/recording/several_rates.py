"""Columns of one vector that several sensors logged, each at its own times, and the time base for all.

A row of such a log has cells of the sensors that sampled then and empty cells elsewhere. A depth that comes
at other times than north and east is another sensor's: a signal of its own. Other components that come apart
(a compass beside roll and pitch, a yaw gyro of its own rate) are brought to the stamps of the one with the
most samples, linearly between their own neighbours and nowhere else. Held by tests/test_several_rates.py.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from seatrial.recording.report import RecordingReport
from seatrial.recording.resampling import between, uniform
from seatrial.recording.signal import Signal

__all__ = ["common", "instruments", "together"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SHARED = 0.5  # of the samples of the busiest component: below, the components come from several sensors
_WHOLE = 0.9  # of the rows: a sensor with samples in these makes the rows a time base
_FEWEST = 10  # samples of a sensor that may set the time base
_MOVING = ("rates", "attitude", "velocity", "position", "depth", "water velocity")


def common(t: Array, signals: Mapping[str, Signal], rate_hz: float | None, report: RecordingReport) -> Array:
    """Uniform times (n,), s, from the first row on, at `rate_hz`, or else at a rate that suits the signals.

    Where a sensor has samples in nearly every row `t` it is the rate of the rows; where the rows are stamps
    of several sensors it is that of the fastest one that shows the motion, to three digits.
    """
    rows = max((len(signal.t) for signal in signals.values()), default=len(t))
    if rate_hz or rows >= _WHOLE * len(t):
        return uniform(t, rate_hz)
    able = [signal for signal in signals.values() if len(signal.t) >= _FEWEST]
    moving = [signal for signal in able if signal.name in _MOVING] or able
    if not moving:
        return uniform(t, None)
    fastest = min(moving, key=lambda signal: signal.step)
    rate = float(f"{1.0 / fastest.step:.3g}")
    report.add(
        "info",
        "time base",
        f"the sensors have stamps of their own; put on {rate:g} Hz, the rate of the {fastest.name}",
    )
    return uniform(t, rate)


def instruments(group: str, present: Mask) -> dict[str, list[int]]:
    """Components of a group's columns by the name of their signal; `present` (n, k): cells with a sample.

    They are one signal, but for a position whose depth has other stamps than north and east. A component
    without any sample belongs to none.
    """
    used = [k for k in range(present.shape[1]) if present[:, k].any()]
    level, depth = [k for k in used if k < 2], [k for k in used if k == 2]
    if group != "position" or not level or not depth or _one_sensor(present):
        return {group: used} if used else {}
    return {"position": level, "depth": depth}


def together(t: Array, y: Array, present: Mask, *, period: float | None = None) -> tuple[Array, Array] | None:
    """Times (m,) and components (m, k) at the stamps of the busiest one; None if they share their stamps.

    Parameters
    ----------
    t, y, present
        Rows (n,), components (n, k), and which cells hold a sample; NaN is a sample without a number.
    period
        Of an angle: it goes the shorter way round.
    """
    if _one_sensor(present):
        return None
    lead = present[:, int(np.argmax(present.sum(axis=0)))]
    result = np.full((int(lead.sum()), y.shape[1]), np.nan)
    for k in range(y.shape[1]):
        here = present[:, k]
        times, values = t[here], y[here, k]
        bad = ~np.isfinite(values)
        if period is not None and not bad.all():
            values = np.where(bad, 0.0, values)
            values[~bad] = np.unwrap(values[~bad], period=period)
        step = float(np.median(np.diff(times))) if len(times) > 1 else np.inf
        value, valid = between(times, values, bad, t[lead], step)
        result[:, k] = np.where(valid, value, np.nan)
    return t[lead], result


def _one_sensor(present: Mask) -> bool:
    """Whether the components that have samples (n, k) have most of them in the same rows."""
    counts = present.sum(axis=0)
    used = counts > 0
    shared = int(np.logical_and.reduce(present[:, used], axis=1).sum())
    return shared >= _SHARED * int(counts.max(initial=0))
