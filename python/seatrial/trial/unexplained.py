"""Motion that neither the vehicle's state nor its commands explain, and the peak that waves leave on it.

The spectrum of a motion shows what the autopilot and the vehicle's own periods make of waves and set points:
a mission with depth steps has peaks of its own in calm water, and waves of 8 s and longer drown among them. A
regression of each measured acceleration on velocities, angles and commands, linear and quadratic, takes the
vehicle out, roughly and without a model file. What is left is noise of the sensors, errors of that crude
model, whose powers are smooth, and the forces of waves.

The prominence of a frequency f is the mean power from 0.8 f to 1.25 f over the geometric mean of those from
0.35 f to 0.65 f and from 1.6 f to 2.5 f: one for any power of the frequency. Waves move the water in all
directions, so that the translations vote together. Held by ``tests/trial/test_wave_recipes.py``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import VELOCITIES

if TYPE_CHECKING:
    from seatrial.trial.trial import Trial

BROAD = 2.0
"""Least prominence of waves on what nothing explains; calm water and basins show at most 1.6."""

_STILL, _TINY = 1e-9, 1e-100  # of a signal's size, and of all sizes: a spread below is rounding

_BAND_HZ = (0.05, 0.5)  # of waves
_FEWEST_PERIODS = 10.0  # in a recording
_WINDOW_S = 100.0  # of a spectrum
_APART_S = 15.0  # of recording per regressor: more would explain slow errors whatever they are
_SMOOTHED_S = 0.3  # standard deviation of the smoothing before the differences
_NEAR, _LOW, _HIGH = (0.8, 1.25), (0.35, 0.65), (1.6, 2.5)  # factors of a frequency
_FALSE_ALARM, _TRIED = 1e-4, 10.0  # chance of all bands of waves that do not overlap, and how many those are


@dataclass(frozen=True)
class Spectra:
    """Power densities (F, C) of some channels at frequencies (F,), Hz, each the mean over so many windows."""

    hz: Array
    power: Array
    windows: float

    def of(self, chosen: Sequence[bool] | Mask) -> Spectra:
        """Those of some channels (C,) alone."""
        return Spectra(self.hz, self.power[:, np.asarray(chosen, bool)], self.windows)

    def integrated(self) -> Spectra:
        """Those of the integrals: of velocities where these are of accelerations."""
        return Spectra(self.hz, self.power / (2.0 * math.pi * self.hz[:, None]) ** 2, self.windows)


def spectra(signals: Array, dt: float) -> Spectra:
    """Spectra of signals (n, C) by Welch's method, without the mean."""
    from scipy.signal import welch

    count = min(len(signals), max(256, round(_WINDOW_S / dt)))
    hz, power = welch(signals, 1.0 / dt, nperseg=count, detrend="linear", axis=0)
    return Spectra(hz[1:], power[1:], (len(signals) - count // 2) / (count - count // 2))


def unexplained(trial: Trial) -> tuple[str, Spectra] | None:
    """Velocity channels of a trial, and the spectra of what nothing explains of them, SI; None without any.

    Each derivative is regressed on all velocities, roll and pitch, commands and forces, then on products of
    these with their own size, with surge and, as fins push, with its square, while the recording is long
    enough for so many.
    """
    from scipy.ndimage import gaussian_filter1d

    def smooth(channel: Array) -> Array:
        return np.asarray(gaussian_filter1d(channel, _SMOOTHED_S / trial.dt, axis=0))

    measured = {c: y for c in VELOCITIES if (y := trial.filled(c)) is not None and y.std() > 0.0}
    if not measured:
        return None
    velocities = smooth(np.column_stack([*measured.values()]))
    angles = [smooth(y) for c in ("roll", "pitch") if (y := trial.filled(c)) is not None]
    inputs = [smooth(y) for y in (*trial.commands.values(), *([] if trial.tau is None else trial.tau.T))]
    pushed = np.column_stack(inputs) if inputs else np.zeros((len(trial), 0))
    parts = [np.column_stack([velocities, *angles]), pushed, np.abs(velocities) * velocities]
    if "u" in measured:
        surge = velocities[:, [list(measured).index("u")]]
        parts += [surge * velocities, surge**2 * pushed]
    parts.append(np.abs(pushed) * pushed)
    regressors = np.ones((len(trial), 1))
    for part in parts:
        moving = part[:, part.std(axis=0) > _STILL * np.abs(part).max(axis=0, initial=_TINY)]
        if regressors.shape[1] + moving.shape[1] > len(trial) * trial.dt / _APART_S:
            break
        regressors = np.column_stack([regressors, (moving - moving.mean(axis=0)) / moving.std(axis=0)])
    derivatives = np.gradient(velocities, trial.dt, axis=0)
    fitted = regressors @ np.linalg.lstsq(regressors, derivatives, rcond=1e-8)[0]
    found = spectra(derivatives - fitted, trial.dt)
    # Smoothing and central differences damp high frequencies; uncorrected that would leave a peak below.
    gain = np.exp(-2.0 * (math.pi * found.hz * _SMOOTHED_S) ** 2) * np.sinc(2.0 * found.hz * trial.dt)
    power = found.power / np.maximum(gain**2, 1e-3)[:, None]
    return "".join(measured), Spectra(found.hz, power, found.windows).integrated()


def peak(motion: Spectra, prominent: float) -> float | None:
    """Frequency of the waves in spectra of velocities, Hz; None where no peak is so prominent.

    The prominence is the geometric mean over the channels. It must also be more than the scatter of smooth
    spectra reaches once in ten thousand recordings: the logarithm of a mean over m independent powers has the
    variance of that of a chi-squared variable of 2 m degrees of freedom, the trigamma function of m. The
    frequency is the centroid of the energy above the power law.
    """
    from scipy.special import polygamma
    from scipy.stats import norm

    hz, power = motion.hz, np.maximum(motion.power, np.finfo(float).tiny)
    if not power.shape[1]:
        return None
    duration = 0.5 * (motion.windows + 1.0) / hz[0]  # windows overlap by a half
    lowest, highest = max(_BAND_HZ[0], _FEWEST_PERIODS / duration), min(_BAND_HZ[1], 0.4 * hz[-1])
    best: tuple[float, float] | None = None
    for at in hz[(hz > lowest) & (hz < highest)]:
        bands = [(hz > a * at) & (hz < b * at) for a, b in (_NEAR, _LOW, _HIGH)]
        if not all(band.any() for band in bands):
            continue
        near, low, high = (np.log(power[band].mean(axis=0)) for band in bands)
        height = float(np.mean(near - 0.5 * (low + high)))
        # Hann's window makes neighbours depend on each other: three count as two.
        counts = [max(motion.windows * band.sum() / 1.5, 1.0) for band in bands]
        scatter = polygamma(1, counts[0]) + 0.25 * (polygamma(1, counts[1]) + polygamma(1, counts[2]))
        chance = _TRIED * norm.sf(height / math.sqrt(scatter / power.shape[1]))
        if height > math.log(prominent) and chance < _FALSE_ALARM and (best is None or height > best[1]):
            best = float(at), height
    if best is None:
        return None
    return _centroid(motion, best[0])


def _centroid(motion: Spectra, at: float) -> float:
    """Centroid of the energy about a peak above that power of the frequency, Hz."""
    hz, power = motion.hz, np.maximum(motion.power, np.finfo(float).tiny)
    ends = [(hz > a * at) & (hz < b * at) for a, b in (_LOW, _HIGH)]
    low, high = (np.log(power[band].mean(axis=0)) for band in ends)
    apart = math.log(math.sqrt((_HIGH[0] * _HIGH[1]) / (_LOW[0] * _LOW[1])))
    around = (hz > _LOW[0] * at) & (hz < _HIGH[0] * at)
    place = np.log(hz[around] / (at * math.sqrt(_LOW[0] * _LOW[1]))) / apart
    above = np.maximum(power[around] - np.exp(low + place[:, None] * (high - low)), 0.0)
    near = np.log(power[(hz > _NEAR[0] * at) & (hz < _NEAR[1] * at)].mean(axis=0))
    weight = np.maximum(near - 0.5 * (low + high), 0.0)  # channels vote with their prominence
    energy = (weight * above / np.maximum(above.sum(axis=0), np.finfo(float).tiny)).sum(axis=1)
    return float(hz[around] @ energy / energy.sum())
