"""Stamps of one sensor: their usual intervals, the step of a time base that suits them, and bursts.

Intervals of a sensor that alternate (0.1 and 0.2 s) or scatter have no one interval. What is a gap is
measured by their 85th percentile; a time base as fine as their 20th percentile has a place for nearly every
sample. Where a receiver hands over several samples at once, it stamps them alike: the samples of each burst
are spread over the time since the burst before, so that none is stamped later than it came. Held by
``tests/trial/test_time_base.py``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from seatrial.base.arrays import Array, Mask, runs

_LONG, _SHORT = 0.85, 0.2  # quantiles of the intervals
_IRREGULAR = 1.5  # ratio of the long to the short interval above which the median is no common interval
_FINEST = 0.25  # of the median: shorter intervals are an accident of the stamps
_TOGETHER = 0.1  # of the mean interval: stamps closer than this came in one burst
_BURSTS = 0.3  # share of such intervals that makes a burst evident
_STEADY = 1.6  # ratio of the time per sample among the bursts: a sensor that samples evenly
_LONGEST = 1.5  # times the usual time per sample: a longer one is a gap before the burst
_FEWEST = 20  # stamps that show bursts

_BLOCK, _FAR, _SLACK_S = 50, 10.0, 1.0
"""Stamps per block, and how far from its neighbours' medians, in their spread and in s, one is no time."""

_STRAYS, _IN_A_ROW = 0.01, 3  # share of damaged stamps, and rows in a row, above which they may be right


class Spread(NamedTuple):
    """Stamps of a burst spread over the time it took: times in s (n,), number of bursts, time per sample."""

    t: Array
    bursts: int
    step_s: float


def usual_interval(t: Array) -> float:
    """Longest usual interval of rising stamps in s; infinite for fewer than two.

    Examples
    --------
    >>> t = np.cumsum(np.tile([0.1, 0.2], 50))
    >>> round(usual_interval(t), 3), round(base_step(t), 3)
    (0.2, 0.1)
    """
    if len(t) < 2:
        return np.inf
    intervals = np.diff(t)
    return float(max(np.median(intervals), np.quantile(intervals, _LONG)))


def strays(t: Array) -> Mask:
    """Stamps (n,) far from those before and after them: single damaged rows.

    Examples
    --------
    >>> t = np.arange(500.0)
    >>> t[[90, 499]] = 1e18, -5e6
    >>> np.flatnonzero(strays(t)).tolist()
    [90, 499]
    """
    count = len(t) // _BLOCK
    if count < 2:
        return np.zeros(len(t), bool)
    middle = np.median(t[: count * _BLOCK].reshape(count, _BLOCK), axis=1)
    near = np.stack([np.r_[middle[0], middle[:-1]], middle, np.r_[middle[1:], middle[-1]]])
    least, most = near.min(axis=0), near.max(axis=0)
    slack = np.maximum(_SLACK_S, _FAR * (most - least))
    block = np.minimum(np.arange(len(t)) // _BLOCK, count - 1)
    far = (t < (least - slack)[block]) | (t > (most + slack)[block])
    few = far.mean() < _STRAYS and all(end - begin <= _IN_A_ROW for begin, end in runs(far))
    return np.asarray(far & few)


def base_step(t: Array) -> float:
    """Step in s of a time base that has a place for nearly every sample at the rising stamps `t`.

    The median interval; where intervals differ much, the short one, its rate to three digits.
    """
    if len(t) < 2:
        return np.inf
    intervals = np.diff(t)
    short, middle, long = np.quantile(intervals, [_SHORT, 0.5, _LONG])
    if _FINEST * middle < short and long > _IRREGULAR * short:
        return 1.0 / float(f"{1.0 / short:.3g}")
    return float(middle)


def spread_bursts(t: Array) -> Spread | None:
    """Stamps `t` (n,), which do not fall, spread evenly over each burst; None where no bursts are evident.

    Bursts are evident where many stamps are nearly the same and the time per sample, from one burst to the
    next, is steady all the same.

    Examples
    --------
    >>> spread = spread_bursts(np.repeat(np.arange(1.0, 21.0), 5))
    >>> spread.bursts, spread.t[5:10].round(2).tolist()
    (20, [1.2, 1.4, 1.6, 1.8, 2.0])
    """
    if len(t) < _FEWEST or t[-1] <= t[0]:
        return None
    intervals = np.diff(t)
    near = intervals < _TOGETHER * float(intervals.mean())
    if near.mean() < _BURSTS:
        return None
    last = np.append(np.flatnonzero(~near), len(t) - 1)  # of each burst
    sizes = np.diff(last, prepend=-1)
    received = t[last]
    each = np.diff(received) / sizes[1:]
    if len(each) < _FEWEST // 4 or np.quantile(each, 0.85) > _STEADY * np.quantile(each, 0.15):
        return None
    step = float(np.median(each))
    spacing = np.concatenate([[step], np.minimum(each, _LONGEST * step)])
    burst = np.repeat(np.arange(len(sizes)), sizes)
    behind = last[burst] - np.arange(len(t))
    return Spread(received[burst] - behind * spacing[burst], len(sizes), step)
