"""Samples at the stamps of their own sensors: what a score may be judged on instead of the time base.

Between the samples of a slow sensor the time base holds straight lines, which no vehicle follows. Held by
``tests/trial/test_predictions.py``.
"""

from __future__ import annotations

from collections.abc import Mapping

from seatrial.base.arrays import Array
from seatrial.base.channels import ANGLES, CHANNELS
from seatrial.base.rotation import to_euler
from seatrial.trial.signals import Signal

__all__ = ["own_samples"]


def own_samples(by_name: Mapping[str, Signal]) -> dict[str, tuple[Array, Array]]:
    """Good samples of each channel at the stamps of its sensor: times in s and values in SI (m,)."""
    found: dict[str, tuple[Array, Array]] = {}
    for name in ("position", "depth", "velocity", "rates"):
        if (signal := by_name.get(name)) is None:
            continue
        for k, channel in enumerate(signal.channels):
            good = ~signal.bad[:, k]
            found[channel] = signal.t[good], signal.y[good, k]
    if (attitude := by_name.get("attitude")) is not None:
        angles = to_euler(attitude.y)
        for k, channel in enumerate(ANGLES):
            good = attitude.good if attitude.unknown is None else ~attitude.unknown[:, k]
            if channel in attitude.channels:
                found[channel] = attitude.t[good], angles[good, k]
    return {channel: found[channel] for channel in CHANNELS if channel in found}
