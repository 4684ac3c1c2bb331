"""The limit cycle that a relay keeps up: period, amplitude and the ultimate gain that they tell.

By the describing function a relay of amplitude d is, for a sine of amplitude a, the gain ``4 d/(pi a)``;
where the loop oscillates by itself this is the ultimate gain K_u, and the period is T_u. Here the gain is
the ratio of the first harmonics of what the actuators were asked for and of what was measured: the same
number where the cycle is symmetric and a sine, and still right where a constant load (weight, drag) makes
the relay stay longer on one side, ``(4 d/pi) sin(pi duty)`` instead of ``4 d/pi``, or where noise makes it
chatter.

Source: Åström and Hägglund (1984), "Automatic tuning of simple regulators with specifications on phase and
amplitude margins", Automatica 20(5). Held by tests/test_relay.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

__all__ = ["LEAST_CYCLES", "Cycle", "relay_cycle"]

Array = NDArray[np.float64]

LEAST_CYCLES = 5
"""Cycles that must be seen."""

_HYSTERESIS = 0.3
"""Share of the root mean square that a signal must pass on either side of its mean to have crossed it."""


@dataclass(frozen=True)
class Cycle:
    """A limit cycle; amplitude in the unit of the measurement (m/s, m, rad), period in s.

    Attributes
    ----------
    period_s
        Median over the cycles.
    period_scatter
        Standard deviation of the period over the cycles, as a share of it.
    amplitude
        Half the distance from peak to peak, median over the cycles.
    amplitude_scatter
        The same of the amplitude.
    ultimate_gain
        N or N m per unit of the measurement, by the first harmonics.
    phase_deg
        Phase of the measurement against the wrench, beyond -180 deg: zero at the phase crossover.
    duty
        Share of the time in which the relay pushes ahead: a half without a load.
    cycles
        How many.
    """

    period_s: float
    period_scatter: float
    amplitude: float
    amplitude_scatter: float
    ultimate_gain: float
    phase_deg: float
    duty: float
    cycles: int


def relay_cycle(t: Array, measured: Array, wrench: Array) -> Cycle | None:
    """Limit cycle of the settled part of a relay trial; None where fewer than five cycles are seen.

    Parameters
    ----------
    t : (n,)
        Time, s, evenly spaced.
    measured : (n,)
        What the loop controls: m/s, m or rad, angles without jumps.
    wrench : (n,)
        What the relay asked for and the allocation reached, N or N m.

    Examples
    --------
    >>> t = np.arange(0.0, 60.0, 0.1)
    >>> relay = -10.0 * np.sign(np.sin(2.0 * np.pi / 6.0 * (t + 0.05)))
    >>> cycle = relay_cycle(t, 0.1 * np.sin(2.0 * np.pi / 6.0 * (t + 0.05)), relay)
    >>> round(cycle.period_s, 2), round(cycle.ultimate_gain, 1)  # 4 d/(pi a)
    (6.0, 127.4)
    """
    starts = _upward(measured - 0.5 * (measured.max() + measured.min()))
    if len(starts) < LEAST_CYCLES + 1:
        return None
    middle = float(measured[starts[0] : starts[-1]].mean())
    times = _crossing_times(t, measured - middle, starts)
    periods = np.diff(times)
    halves = [0.5 * float(np.ptp(measured[one:next_])) for one, next_ in pairwise(starts)]
    period, amplitude = float(np.median(periods)), float(np.median(halves))
    whole = slice(int(starts[0]), int(starts[-1]))
    # The mean period keeps whole cycles in the sums: a median that is 1 % off loses phase over many cycles.
    turning = np.exp(-2j * np.pi / float(periods.mean()) * t[whole])
    answer = np.mean((measured[whole] - middle) * turning)
    drive = np.mean((wrench[whole] - wrench[whole].mean()) * turning)
    if min(abs(answer), abs(drive)) == 0.0:
        return None
    return Cycle(
        period_s=period,
        period_scatter=float(np.std(periods)) / period,
        amplitude=amplitude,
        amplitude_scatter=float(np.std(halves)) / amplitude,
        ultimate_gain=float(abs(drive) / abs(answer)),
        phase_deg=float(np.rad2deg(np.angle(-answer / drive))),
        duty=float(np.mean(wrench[whole] > 0.0)),
        cycles=len(periods),
    )


def _upward(signal: Array) -> NDArray[np.int64]:
    """Rows at which a signal comes above zero, between being well below and well above it."""
    band = _HYSTERESIS * float(np.sqrt(np.mean(signal**2)))
    side = np.where(signal > band, 1, np.where(signal < -band, -1, 0))
    known = np.flatnonzero(side)
    rising = np.flatnonzero((side[known[:-1]] < 0) & (side[known[1:]] > 0))
    found = []
    for k in rising:
        before, after = int(known[k]), int(known[k + 1])
        above = np.flatnonzero(signal[before : after + 1] > 0.0)
        found.append(before + int(above[0]))
    return np.asarray(found, dtype=np.int64)


def _crossing_times(t: Array, signal: Array, rows: NDArray[np.int64]) -> Array:
    """Times at which a signal passes zero next to some rows, between the samples, s."""
    before, after = signal[rows - 1], signal[rows]
    rise = np.where(after - before > 0.0, after - before, 1.0)
    share = np.clip(-before / rise, 0.0, 1.0)
    times: Array = t[rows - 1] + share * (t[rows] - t[rows - 1])
    return times
