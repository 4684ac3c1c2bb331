"""Intensities of the noises of a filter along the measured motion (`seatrial.estimation.kalman`)."""

from __future__ import annotations

from dataclasses import dataclass, replace

from seatrial.base.arrays import Array

__all__ = ["NoiseModel"]


@dataclass(frozen=True)
class NoiseModel:
    """Intensities of the noises.

    ``process`` (N,) variance per sample of what drives each state, ``sensors`` (Y,) variance of each measured
    channel, ``wave_hz`` the frequency of the waves, ``waved`` the axes (places among the velocities) that
    they push and ``water`` the directions (0 north, 1 east, 2 down) in which they carry the water.
    ``damping`` is the damping ratio of their shaping filters: the broader the spectrum, the larger.
    """

    process: Array
    sensors: Array
    wave_hz: float | None
    waved: tuple[int, ...]
    water: tuple[int, ...]
    damping: float

    def broadened(self, damping: float) -> NoiseModel:
        """The same waves with another damping ratio, their variances as they were."""
        first, last = len(self.process) - 2 - 2 * (len(self.waved) + len(self.water)), len(self.process) - 2
        process = self.process.copy()
        process[first:last] *= damping / self.damping
        return replace(self, process=process, damping=damping)
