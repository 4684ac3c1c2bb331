"""Waves in a recording: their period, what they do to each channel, and how that fades with depth.

A spectrum (Welch's method, windows of about a minute) of a vehicle that steers falls smoothly with
frequency; waves are a peak on it at periods from 2 to 20 s. The amplitude of a channel is ``sqrt(2 P)``,
with P its power in the band around the peak above the smooth spectrum. Linear waves in deep water fade as
``exp(-k z)``, ``k = omega^2 / g`` (Fossen 2011, section 8.2). Held by ``tests/trial/test_wave_recipes.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array, Mask

if TYPE_CHECKING:
    from seatrial.trial.trial import Trial

__all__ = ["Waves", "commanded", "waves"]

_LONGEST_S, _SHORTEST_S = 20.0, 2.0
_WINDOW_S = 100.0
_PROMINENT = 6.0  # times the smooth spectrum, at least
_FALSE_ALARM = 1e-3  # of a recording without waves, where few windows scatter more than that
_SMOOTH = 1.7  # an octave and a half around a frequency, as a factor
_BAND = 1.35  # around the peak, as a factor of its frequency
_SEEN = ("u", "v", "w", "p", "q", "r", "z", "roll", "pitch", "yaw")
_AXIS = dict(zip(_SEEN, "XYZKMNZKMN", strict=True))
_FEWEST_PERIODS = 20
_TOGETHER = 0.5
_SHARE = 0.02  # of a channel's variance: less is no wave


@dataclass(frozen=True)
class Waves:
    """What waves do in a recording.

    Attributes
    ----------
    period_s
        Of the spectral peak, as the vehicle meets the waves.
    amplitude
        By channel in SI: m/s, rad/s, m, rad; channels that show the peak.
    share
        By channel: part of its variance in the wave band.
    decay_1_m
        Rate at which the motion fades with depth, 1/m, and `decay_deviation_1_m`; NaN where the depth hardly
        changed.
    """

    period_s: float
    amplitude: dict[str, float]
    share: dict[str, float]
    decay_1_m: float
    decay_deviation_1_m: float


def waves(trial: Trial) -> Waves | None:
    """Waves in a recording; None where no channel shows any.

    Parameters
    ----------
    trial
        On its uniform time base.
    """
    spectra: dict[str, tuple[Array, Array, Array, int]] = {}
    if len(trial) * trial.dt < _FEWEST_PERIODS * _SHORTEST_S:
        return None
    for channel in _SEEN:
        y = trial.filled(channel)
        if y is not None and y.std() > 0.0:
            spectra[channel] = (y, *_spectrum(y, trial.dt))
    peaks = {c: p for c, (_, f, power, n) in spectra.items() if (p := _peak(f, power, n)) is not None}
    if not peaks:
        return None
    # The channels vote with the height of their peaks over the smooth spectrum.
    logs = np.log([f for f, *_ in peaks.values()])
    weights = np.log([height for _, height, _ in peaks.values()])
    order = np.argsort(logs)
    middle = np.searchsorted(np.cumsum(weights[order]), 0.5 * weights.sum())
    frequency = float(np.exp(logs[order][min(middle, len(order) - 1)]))
    if _chance(peaks, frequency) * len({_AXIS[c] for c in spectra}) > _FALSE_ALARM:
        return None
    amplitude, share = {}, {}
    for channel in peaks:
        y, f, power, _ = spectra[channel]
        inside = (f > frequency / _BAND) & (f < frequency * _BAND)
        step = f[1] - f[0]
        above = float(np.sum(power[inside] - _background(f, power, inside)) * step)
        part = above / float(np.var(y))
        if part > _SHARE:
            amplitude[channel], share[channel] = math.sqrt(2.0 * above), part
    if not set(amplitude) & {"u", "v", "w", "z"}:
        return None  # a peak in angles and rates alone is the vehicle's own period
    decay = _decay(trial, frequency, amplitude)
    return Waves(1.0 / frequency, amplitude, share, *decay)


def commanded(trial: Trial, found: Waves) -> bool:
    """Whether a command goes together with the oscillation: coherence above a half at its frequency.

    Then preset commands explain it; those of a closed loop may answer it.
    """
    from scipy.signal import coherence

    inputs = [*trial.commands.values(), *([] if trial.tau is None else trial.tau.T)]
    # Eight windows at least, of three periods at least: fewer agree by chance.
    count = max(round(3.0 * found.period_s / trial.dt), len(trial) // 8)
    for channel in found.amplitude:
        y = trial.filled(channel)
        for u in inputs:
            if y is None or np.ptp(u) == 0.0 or len(y) < 4 * count:
                continue
            f, together = coherence(u, y, 1.0 / trial.dt, nperseg=count)
            if together[int(np.argmin(np.abs(f - 1.0 / found.period_s)))] > _TOGETHER:
                return True
    return False


def _spectrum(y: Array, dt: float) -> tuple[Array, Array, int]:
    """Frequencies in Hz, one-sided power density, and the number of windows that it is the mean of."""
    from scipy.signal import welch

    count = min(len(y), max(256, round(_WINDOW_S / dt)))
    f, power = welch(y, 1.0 / dt, nperseg=count, detrend="linear")
    return f[1:], power[1:], (len(y) - count // 2) // (count - count // 2)


def _background(f: Array, power: Array, where: Mask) -> Array:
    """Smooth spectrum at some frequencies: median of the logarithm over an octave and a half around each."""
    log = np.log(np.maximum(power, 1e-300))
    low = np.searchsorted(f, f[where] / _SMOOTH)
    high = np.searchsorted(f, f[where] * _SMOOTH, side="right")
    return np.asarray(np.exp([np.median(log[a:b]) for a, b in zip(low, high, strict=True)]))


def _chance(peaks: Mapping[str, tuple[float, float, float]], frequency: float) -> float:
    """Probability that peaks as high as those at a frequency arise in calm water.

    Those of several axes add up by Fisher's method; channels of one axis show one motion.
    """
    from scipy.stats import chi2

    least: dict[str, float] = {}
    for channel, (own, _, chance) in peaks.items():
        if abs(math.log(own / frequency)) < math.log(_BAND):
            least[_AXIS[channel]] = min(chance, least.get(_AXIS[channel], 1.0))
    return float(chi2.sf(-2.0 * sum(math.log(max(one, 1e-300)) for one in least.values()), 2 * len(least)))


def _peak(f: Array, power: Array, windows: int) -> tuple[float, float, float] | None:
    """Frequency of the highest peak in the band of waves, its height over the smooth spectrum, its chance.

    The chance is that of calm water. The mean over windows and neighbours is that of about 1.7 exponential
    variables per window, the median is as good as the mean of half of its frequencies: their ratio follows
    Fisher's distribution (Percival & Walden 1993, section 6.6).
    """
    from scipy.stats import f as fisher
    from scipy.stats import gamma

    inside = np.flatnonzero((f > 1.0 / _LONGEST_S) & (f < min(1.0 / _SHORTEST_S, 0.8 * f[-1])))
    if len(inside) < 5:
        return None
    near_band = np.zeros(len(f), bool)  # with the neighbours of its ends, for the smoothing
    near_band[max(inside[0] - 1, 0) : inside[-1] + 2] = True
    ratio = np.zeros(len(f))
    ratio[near_band] = power[near_band] / _background(f, power, near_band)
    # Neighbours agree on a peak that is no accident of one frequency.
    smooth = np.convolve(ratio, [0.25, 0.5, 0.25], mode="same")
    best = inside[int(np.argmax(smooth[inside]))]
    around = int(np.count_nonzero((f > f[best] / _SMOOTH) & (f < f[best] * _SMOOTH)))
    if best in (inside[0], inside[-1]) or smooth[best] < _PROMINENT:
        return None
    height = smooth[best] * gamma.median(windows, scale=1.0 / windows)
    chance = len(inside) * fisher.sf(height, 3.4 * windows, around * windows)
    near = slice(max(best - 2, 0), best + 3)
    frequency = float(np.sum(f[near] * power[near]) / np.sum(power[near]))
    return frequency, float(smooth[best]), min(float(chance), 1.0)


def _decay(trial: Trial, frequency: float, amplitude: dict[str, float]) -> tuple[float, float]:
    """Rate of decay with depth and its deviation, 1/m, from the band's power in windows of some periods."""
    from scipy.signal import butter, sosfiltfilt

    channels = [c for c in ("w", "q", "pitch", "p", "v") if c in amplitude]
    depth = trial.filled("z")
    if not channels or depth is None:
        return math.nan, math.nan
    y = trial.filled(channels[0])
    assert y is not None
    limits = [frequency / _BAND, min(frequency * _BAND, 0.45 / trial.dt)]
    band = sosfiltfilt(butter(2, limits, "bandpass", fs=1.0 / trial.dt, output="sos"), y)
    count = max(8, round(6.0 / frequency / trial.dt))
    windows = len(y) // count
    if windows < 8:
        return math.nan, math.nan
    power = (band[: windows * count].reshape(windows, count) ** 2).mean(axis=1)
    z = depth[: windows * count].reshape(windows, count).mean(axis=1)
    if z.std() < 0.5:
        return math.nan, math.nan
    design = np.column_stack([np.ones(windows), -z])
    fit, residual, *_ = np.linalg.lstsq(design, 0.5 * np.log(np.maximum(power, 1e-300)), rcond=None)
    spread = float(residual[0]) / (windows - 2) if len(residual) else 0.0
    covariance = np.linalg.inv(design.T @ design) * spread
    return float(fit[1]), float(np.sqrt(covariance[1, 1]))
