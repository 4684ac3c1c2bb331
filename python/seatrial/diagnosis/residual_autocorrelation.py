"""Memory of the residuals: their autocorrelation per channel, and blocks long enough to count as independent.

A model inside its class leaves the sensors' noise; a missing term leaves a residual that remembers.

Sources: Box & Jenkins, *Time Series Analysis* (1970); Ljung & Box, Biometrika 65 (1978).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.base.plain import Plain
from seatrial.statistics.blocks import autocorrelation
from seatrial.statistics.linearisation import Linearisation

LONGEST_S = 10.0
"""Longest lag of an autocorrelation, s."""

_LAGS_TESTED = 20
"""Lags whose correlations are tested together."""

_BLOCK = 4.0
"""Blocks of four correlation times are almost independent: exp(-4) is 2 %."""

_SHORTEST_S = 2.0
"""A block is no shorter, however white the residuals are."""

_FEWEST = 24
"""Blocks at least: 24 tell a standard deviation to 15 %."""

_MOST = 240
"""Blocks at most: 240 tell a standard deviation to 5 %."""


@dataclass(frozen=True)
class Autocorrelation(Plain, without="effective", also="effective_samples=effective excess"):
    """Autocorrelation of one channel's residual, pooled over the trials.

    Attributes
    ----------
    channel
        Its name.
    lag_s, rho
        Lags in s and autocorrelations, both (lags,), from one sample on.
    band
        White residuals stay within plus and minus this in 95 of 100 lags: ``1.96 / sqrt(samples)``.
    outside
        Share of the lags outside the band; 0.05 for white residuals.
    p
        Probability that white residuals correlate as much (Ljung-Box over the first lags).
    samples, effective
        Samples that count, and how many independent ones they are worth.
    correlation_s
        Correlation time, s.
    rms
        Root mean square of the residual, SI.
    noise
        Noise of the sensor, SI: as given, otherwise the white part of the residual (second differences).
    """

    channel: str
    lag_s: Array
    rho: Array
    band: float
    outside: float
    p: float
    samples: int
    effective: float
    correlation_s: float
    rms: float
    noise: float

    @property
    def excess(self) -> float:
        """Residual over noise: 1 where the model leaves nothing but the sensor's noise."""
        return self.rms / self.noise if self.noise > 0.0 else float("inf")


def autocorrelations(
    lin: Linearisation, *, longest_s: float = LONGEST_S, sensor_noise: Mapping[str, float] | None = None
) -> tuple[Autocorrelation, ...]:
    """Autocorrelation of the residual of every channel that has samples.

    What the robust loss weighs less counts less.

    Parameters
    ----------
    lin : Linearisation
    longest_s : float
        Longest lag, s; at most a quarter of the data.
    sensor_noise : mapping, optional
        Standard deviation per channel, SI, where it is known.
    """
    samples = sum(len(piece.t) for piece in lin.pieces)
    count = max(1, min(round(longest_s / lin.dt), samples // 4))
    rho = autocorrelation(lin, count)[:, 1:]
    channels = [
        _channel(lin, column, rho[column], known_noise=(sensor_noise or {}).get(channel))
        for column, channel in enumerate(lin.channels)
    ]
    return tuple(channel for channel in channels if channel is not None)


def block_length(correlations: tuple[Autocorrelation, ...], duration_s: float) -> float:
    """Length in s of blocks that are as good as independent: four times the longest correlation time.

    At least two seconds, and such that there are between two dozen blocks, without which there is no
    variance, and ten times as many, beyond which they tell nothing more.

    Examples
    --------
    >>> block_length((), 1200.0)
    5.0
    """
    memory = max((correlation.correlation_s for correlation in correlations), default=0.0)
    shortest = max(_SHORTEST_S, duration_s / _MOST)
    return float(max(shortest, min(_BLOCK * memory, duration_s / _FEWEST)))


def block_numbers(lin: Linearisation, length_s: float) -> list[NDArray[np.intp]]:
    """Block that each sample belongs to, per segment (n,), from 0 on.

    The blocks of a trial are equally long, about `length_s`, and cross the limits of its segments.
    """
    totals: dict[str, int] = {}
    for piece in lin.pieces:
        totals[piece.trial] = totals.get(piece.trial, 0) + len(piece.t)
    left: dict[str, NDArray[np.intp]] = {}
    first = 0
    for trial, total in totals.items():
        own = min(total, max(1, round(total * lin.dt / length_s)))
        left[trial] = first + np.arange(total) * own // total
        first += own
    numbers = []
    for piece in lin.pieces:
        numbers.append(left[piece.trial][: len(piece.t)])
        left[piece.trial] = left[piece.trial][len(piece.t) :]
    return numbers


def _channel(
    lin: Linearisation, column: int, rho: Array, *, known_noise: float | None
) -> Autocorrelation | None:
    """The autocorrelation of one channel from its values (lags,); None without samples."""
    from scipy.stats import chi2

    power, samples, curvature, triples = 0.0, 0, 0.0, 0
    for piece in lin.pieces:
        mask = piece.counted[:, column]
        held = np.where(mask, piece.weight[:, column] * piece.residual[:, column], 0.0)
        power, samples = power + float(held @ held), samples + int(mask.sum())
        # White noise has six times its power in second differences; smooth errors have next to none.
        bend = (held[:-2] - 2.0 * held[1:-1] + held[2:])[mask[:-2] & mask[1:-1] & mask[2:]]
        curvature, triples = curvature + float(bend @ bend), triples + len(bend)
    if samples == 0:
        return None
    # Correlations of white residuals of this number lie within the band with 95 %.
    band = 1.96 / float(np.sqrt(samples))
    inside = np.flatnonzero(rho < band)
    # Correlation time from the values before the first one inside the band.
    memory = rho[: inside[0]] if len(inside) else rho
    correlation_s = lin.dt * (1.0 + 2.0 * float(memory.sum()))
    # Ljung and Box: the squares of the first correlations together.
    lags = np.arange(1, min(_LAGS_TESTED, len(rho), samples - 1) + 1)
    statistic = samples * (samples + 2) * float((rho[: len(lags)] ** 2 / (samples - lags)).sum())
    rms = float(lin.noise[column] * np.sqrt(power / samples))
    white = float(lin.noise[column] * np.sqrt(curvature / triples / 6.0)) if triples else rms
    return Autocorrelation(
        channel=lin.channels[column],
        lag_s=np.asarray(lin.dt * np.arange(1, len(rho) + 1)),
        rho=rho,
        band=band,
        outside=float(np.mean(np.abs(rho) > band)),
        p=float(chi2.sf(statistic, len(lags))) if len(lags) else 1.0,
        samples=samples,
        effective=samples * lin.dt / correlation_s,
        correlation_s=correlation_s,
        rms=rms,
        noise=white if known_noise is None else known_noise,
    )
