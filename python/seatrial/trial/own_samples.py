"""Samples at the stamps of their own sensors: what a score may be judged on instead of the time base.

Between the samples of a slow sensor the time base holds straight lines, which no vehicle follows. Held by
``tests/trial/test_predictions.py``.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import ANGLES, CHANNELS
from seatrial.base.rotation import to_euler
from seatrial.trial.signals import Signal

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


def _same(t: Array, base: Array | None) -> bool:
    """Whether stamps are those of the time base."""
    if base is None or len(t) != len(base) or len(t) < 2:
        return False
    return bool(np.max(np.abs(t - base)) <= _TICK * (base[1] - base[0]))


def _kept(t: Array, y: Array, good: Mask) -> tuple[Array, Array]:
    """Good samples, without a copy where all are."""
    return (t, y) if good.all() else (t[good], y[good])
