"""One sensor's samples on its own time base, in SI and in NED/FRD, with a mark on every bad sample."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

__all__ = ["Signal"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Signal:
    """Samples `y` (m, k) at times `t` (m,) of the `channels` (k names); `bad` (m, k) marks those of no use.

    The attitude is a unit quaternion: four columns q_w q_x q_y q_z that are good or bad together.
    """

    name: str
    channels: tuple[str, ...]
    t: Array
    y: Array
    bad: Mask

    @property
    def good(self) -> Mask:
        """Rows (m,) of which every channel is good."""
        return np.asarray(np.logical_and.reduce(~self.bad, axis=1))

    @property
    def step(self) -> float:
        """Median sampling interval, s."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else np.inf

    def masked(self, bad: Mask) -> Signal:
        """The same samples with more of them marked bad; `bad` is (m,) for all channels or (m, k)."""
        return replace(self, bad=self.bad | (bad[:, None] if bad.ndim == 1 else bad))

    def earlier(self, latency: float) -> Signal:
        """The same samples stamped `latency` seconds earlier."""
        return replace(self, t=self.t - latency)
