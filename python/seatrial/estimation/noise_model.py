"""Intensities of the noises of a filter along the measured motion (`seatrial.estimation.kalman`)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from seatrial.base.arrays import Array


@dataclass(frozen=True)
class NoiseModel:
    """Intensities of the noises.

    ``process`` (N,) variance per sample of what drives each state, ``sensors`` (Y,) variance of each measured
    channel, ``wave_hz`` the frequency of the waves, ``waved`` the axes (places among the velocities) that
    they push and ``water`` the directions (0 north, 1 east, 2 down) in which they carry the water.
    ``damping`` is the damping ratio of their shaping filters: the broader the spectrum, the larger.
    ``toward`` is where the waves go, rad from north over east: a vehicle meets them at another frequency on
    every course then, and ``wave_hz`` is that of a point adrift. Without it they are met at ``wave_hz``.
    ``carried`` says whether the water of the waves carries the vehicle along, or flows past it.
    """

    process: Array
    sensors: Array
    wave_hz: float | None
    waved: tuple[int, ...]
    water: tuple[int, ...]
    damping: float
    toward: float | None = None
    carried: bool = True

    def shaped(self, wave_hz: float, damping: float) -> NoiseModel:
        """The same waves with another frequency and damping ratio, their rates' variances as they were."""
        assert self.wave_hz is not None
        first, last = len(self.process) - 2 - 2 * (len(self.waved) + len(self.water)), len(self.process) - 2
        process = self.process.copy()
        process[first:last] *= damping * wave_hz / (self.damping * self.wave_hz)
        return replace(self, process=process, wave_hz=wave_hz, damping=damping)

    def waves(self) -> dict[str, float | bool | None] | None:
        """Period, s, where they go, degrees from north over east, damping ratio and whether they carry.

        None without waves.
        """
        if self.wave_hz is None:
            return None
        toward_deg = None if self.toward is None else math.degrees(self.toward) % 360.0
        return {
            "period_s": 1.0 / self.wave_hz,
            "toward_deg": toward_deg,
            "damping_ratio": self.damping,
            "carried": self.carried if self.water else None,
        }
