"""The limit cycle that a relay keeps up: period, amplitude and the ultimate gain that they tell.

By the describing function a relay of amplitude d is, for a sine of amplitude a, the gain ``4 d/(pi a)``;
where the loop oscillates by itself this is the ultimate gain K_u, and the period is T_u. Here the gain is
the ratio of the first harmonics of what the actuators were asked for and of what was measured: the same
number where the cycle is symmetric and a sine, and the gain of the plant at the frequency of the cycle where
a constant load (weight, drag) makes the relay stay longer on one side, ``(4 d/pi) sin(pi duty)`` instead of
``4 d/pi``, or where noise makes it chatter.

That frequency is the phase crossover only as far as first harmonics are all that matters. A relay under a
load has even harmonics, too, and cycles more slowly, where the plant turns by less than 180 deg; one that is
sampled switches late. The first harmonics say by how many degrees. A relay that switches by
``y + lead dy/dt`` cycles faster, at another point of the plant's frequency response; along it the
logarithms of gain and period go almost straight with the phase, and what they are at -180 deg lies between
the two (`at_crossover`).

Source: Åström and Hägglund (1984), "Automatic tuning of simple regulators with specifications on phase and
amplitude margins", Automatica 20(5): other points of the frequency response by other phases in the loop.
Held by tests/test_relay.py and tests/test_relay_load.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

__all__ = ["LEAST_CYCLES", "Cycle", "at_crossover", "crossover_lead_s", "relay_cycle"]

Array = NDArray[np.float64]

LEAST_CYCLES = 5
"""Cycles that must be seen."""

_LEAST_LEAD_DEG = 4.0  # less would lock in with the same sample
_LEAST_PART = 0.7  # of the phase of a cycle that another must be away for a line between them
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
        Share of the time that the relay spends on its upper side: a half without a load.
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
        # Propellers that do not reverse switch between nothing and ahead.
        duty=float(np.mean(wrench[whole] > 0.5 * (wrench[whole].max() + wrench[whole].min()))),
        cycles=len(periods),
    )


def crossover_lead_s(cycle: Cycle) -> float:
    """Time in s by which a relay must switch ahead to cycle at the phase crossover, or 4 deg further on.

    Examples
    --------
    >>> round(crossover_lead_s(Cycle(6.283, 0.0, 0.1, 0.0, 250.0, 10.0, 0.3, 12)), 3)  # tan(10 deg)
    0.176
    """
    turned = math.radians(max(cycle.phase_deg, _LEAST_LEAD_DEG))
    return math.tan(turned) * cycle.period_s / (2.0 * math.pi)


def at_crossover(cycle: Cycle, ahead: Cycle) -> Cycle | None:
    """Cycle at the phase crossover between a relay's and that of one that switches ahead.

    Period, amplitude and gain on a straight line of their logarithms over the phase; None where the phases
    lie too close together for a line.

    Parameters
    ----------
    cycle : Cycle
        Of the relay itself.
    ahead : Cycle
        Of the one with a lead, at the same amplitude of the relay.

    Examples
    --------
    >>> late = Cycle(17.0, 0.0, 1.2, 0.0, 0.8, 8.0, 0.25, 12)
    >>> found = at_crossover(late, Cycle(12.4, 0.0, 0.7, 0.0, 1.3, -5.0, 0.25, 12))
    >>> round(found.period_s, 1), round(found.ultimate_gain, 2), found.phase_deg
    (14.0, 1.08, 0.0)
    """
    apart = cycle.phase_deg - ahead.phase_deg
    if abs(apart) < _LEAST_PART * abs(cycle.phase_deg) or apart == 0.0:
        return None
    part = cycle.phase_deg / apart

    def between(one: float, other: float) -> float:
        return one * math.pow(other / one, part)

    return replace(
        cycle,
        period_s=between(cycle.period_s, ahead.period_s),
        period_scatter=max(cycle.period_scatter, ahead.period_scatter),
        amplitude=between(cycle.amplitude, ahead.amplitude),
        amplitude_scatter=max(cycle.amplitude_scatter, ahead.amplitude_scatter),
        ultimate_gain=between(cycle.ultimate_gain, ahead.ultimate_gain),
        phase_deg=0.0,
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
