"""Samples at the stamps of their own sensors: what a score may be judged on instead of the time base.

Between the samples of a slow sensor the time base holds straight lines, which no vehicle follows. Held by
``tests/trial/test_predictions.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import ANGLES, CHANNELS
from seatrial.base.rotation import to_euler
from seatrial.trial.signals import Signal

_BLOCKS = 200  # parts of a record whose motion is compared

_TICK = 1e-6  # two stamps closer than this share of an interval are the same


def own_samples(
    by_name: Mapping[str, Signal], base: Array | None = None, silent: Mask | None = None
) -> dict[str, tuple[Array, Array]]:
    """Good samples of each channel at the stamps of its sensor: times in s and values in SI (m,).

    A sensor whose stamps are those of the time base `base` (n,) has no others than the base: it is left out,
    for a second copy of a long log would take as much memory as the trial. Samples next to those of the base
    at which the command is unknown (`silent`, (n,)) are left out.
    """
    found: dict[str, tuple[Array, Array]] = {}
    for name in ("position", "depth", "velocity", "rates"):
        if (signal := by_name.get(name)) is None or _same(signal.t, base):
            continue
        for k, channel in enumerate(signal.channels):
            found[channel] = _kept(signal.t, signal.y[:, k], ~signal.bad[:, k])
    if (attitude := by_name.get("attitude")) is not None and not _same(attitude.t, base):
        angles = to_euler(attitude.y)
        for k, channel in enumerate(ANGLES):
            good = attitude.good if attitude.unknown is None else ~attitude.unknown[:, k]
            if channel in attitude.channels:
                found[channel] = _kept(attitude.t, angles[:, k], good)
    if base is not None and silent is not None:
        for channel, (t, y) in found.items():
            after = np.clip(np.searchsorted(base, t), 1, len(base) - 1)
            found[channel] = _kept(t, y, ~(silent[after] | silent[after - 1]))
    return {channel: found[channel] for channel in CHANNELS if channel in found}


def most_moving(samples: Mapping[str, tuple[Array, Array]], most: int) -> dict[str, tuple[Array, Array]]:
    """The samples of the stretch of time in which the channels move most, `most` of each at the most.

    Times in s and values (m,) by channel. A channel's motion is its standard deviation within each of
    `_BLOCKS` equal parts of the record, as a share of their sum, so that every channel counts alike. A record
    that is short enough stays as it is.
    """
    longest = max((len(t) for t, _ in samples.values()), default=0)
    if longest <= most:
        return dict(samples)
    edges = np.linspace(
        min(t[0] for t, _ in samples.values() if len(t)),
        max(t[-1] for t, _ in samples.values() if len(t)),
        _BLOCKS + 1,
    )
    motion = np.zeros(_BLOCKS)
    bounds = {channel: np.searchsorted(t, edges) for channel, (t, _) in samples.items()}
    for channel, (_, y) in samples.items():
        # A heading that turns round and round would be as still as none by its wrapped values.
        y = np.unwrap(y) if channel in ANGLES else y
        parts = [y[a:b] for a, b in pairwise(bounds[channel])]
        spread = np.array([np.std(part) if len(part) > 1 else 0.0 for part in parts])
        motion += spread / max(float(spread.sum()), 1e-300)
    # As many blocks as the densest stretch of any channel allows, one at least.
    counts = np.stack([np.diff(limits) for limits in bounds.values()])
    wide = next((k for k in range(_BLOCKS, 1, -1) if _sums(counts, k).max() <= most), 1)
    first = int(np.argmax(_sums(motion[None], wide)[0]))
    return {
        channel: (t[a:b][:most], y[a:b][:most])
        for channel, (t, y) in samples.items()
        for a, b in [(bounds[channel][first], bounds[channel][first + wide])]
    }


def _sums(values: Array, wide: int) -> Array:
    """Sums (k, n - wide + 1) over `wide` neighbours of values (k, n)."""
    return np.asarray(np.lib.stride_tricks.sliding_window_view(values, wide, axis=1).sum(axis=2))


def _same(t: Array, base: Array | None) -> bool:
    """Whether stamps are those of the time base."""
    if base is None or len(t) != len(base) or len(t) < 2:
        return False
    return bool(np.max(np.abs(t - base)) <= _TICK * (base[1] - base[0]))


def _kept(t: Array, y: Array, good: Mask) -> tuple[Array, Array]:
    """Good samples, without a copy where all are."""
    return (t, y) if good.all() else (t[good], y[good])
