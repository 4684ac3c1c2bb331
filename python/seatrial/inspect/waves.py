"""Waves in a recording: their period, what they do to each channel, and how that fades with depth.

A swell of nearly one frequency is a line on the spectra of the velocities. Broader waves are a peak on what
neither motion nor commands explain of them (`unexplained`), where a swell hides: two signals of one
frequency explain any third. The amplitude of a channel is ``sqrt(2 P)``, with P its power in the band
around the frequency, and without a line the part of it that nothing explains of the axis. Linear waves in
deep water fade as ``exp(-k z)``, ``k = omega^2 / g`` (Fossen 2011, section 8.2).

The spectrum of a motion shows what the autopilot and the vehicle's own periods make of waves and set
points: a mission with depth steps has peaks of its own in calm water, and waves of 8 s and longer drown
among them. A regression of each measured acceleration on velocities, angles and commands, linear and
quadratic, takes the vehicle out, roughly and without a model file. What is left is noise of the sensors,
errors of that crude model, whose powers are smooth, and the forces of waves.

The prominence of a frequency f is the mean power from 0.8 f to 1.25 f over the geometric mean of those from
0.35 f to 0.65 f and from 1.6 f to 2.5 f: one for any power of the frequency. Waves move the water in all
directions, so that the translations vote together. Held by ``tests/inspect/test_wave_recipes.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import VELOCITIES

if TYPE_CHECKING:
    from seatrial.trial.trial import Trial

_SEEN = ("u", "v", "w", "p", "q", "r", "z", "roll", "pitch", "yaw")
_WATER = "uvw"  # water moves in all directions
_AXIS = dict(zip(_SEEN, "XYZKMNZKMN", strict=True))


@dataclass(frozen=True)
class WaveSettings:
    """Thresholds from which an oscillation is taken for waves."""

    #: Least prominence on the motion itself, of one or two translations and of all three. Set points and own
    #: periods move the vehicle in one plane: a busy mission's heave reached 17 in calm water, the mean over
    #: surge, sway and heave 4.
    line: float = 20.0
    line_in_all: float = 8.0
    broad: float = 2.0  #: Least prominence on what nothing explains; calm water and basins show at most 1.6.
    #: Chance that the scatter of a smooth spectrum reaches the prominence anywhere.
    false_alarm: float = 1e-4
    share: float = 0.02  #: Part of a channel's variance from which it shows the waves.
    together: float = 0.5  #: Coherence with a command from which that explains the oscillation.
    #: Least length of a recording, s, and in periods of the waves.
    shortest_s: float = 40.0
    fewest_periods: float = 10.0
    band: float = 1.35  #: Band around the peak, as a factor of its frequency.
    still: float = 1e-9  #: Of a signal's size: a spread below is rounding.
    tiny: float = 1e-100  #: Of all sizes: a spread below is rounding.
    band_hz: tuple[float, float] = (0.05, 0.5)  #: Frequencies of waves, Hz: periods of 2 to 20 s.
    window_s: float = 100.0  #: Of a spectrum, s: five of the longest periods.
    apart_s: float = 15.0  #: Of recording per regressor, s: more would explain slow errors whatever they are.
    smoothed_s: float = 0.3  #: Deviation of the smoothing before the differences, s.
    near: tuple[float, float] = (0.8, 1.25)  #: Around a frequency, as factors of it.
    low: tuple[float, float] = (0.35, 0.65)  #: Below a frequency, as factors of it.
    high: tuple[float, float] = (1.6, 2.5)  #: Above a frequency, as factors of it.
    tried: float = 10.0  #: Bands of waves that do not overlap: so many chances of a false alarm.


SETTINGS = WaveSettings()
"""Those of every judgement that is given no others."""

BROAD = SETTINGS.broad
"""Least prominence on what nothing explains, where the noise model of a filter looks for waves."""


@dataclass(frozen=True)
class Waves:
    """What waves do in a recording."""

    period_s: float  #: Of the spectral peak, as the vehicle meets the waves.
    #: Whether they are a line on the motion itself; otherwise a peak on what a crude regression on state and
    #: commands leaves of it, which may be motion that it did not explain.
    line: bool
    amplitude: dict[str, float]  #: By channel in SI: m/s, rad/s, m, rad; channels that show the peak.
    share: dict[str, float]  #: By channel: part of its variance in the wave band.
    #: Rate at which the motion fades with depth, 1/m, and `decay_deviation_1_m`; NaN where the depth hardly
    #: changed.
    decay_1_m: float
    decay_deviation_1_m: float


def waves(trial: Trial, settings: WaveSettings = SETTINGS) -> Waves | None:
    """Waves in a recording; None where no channel shows any."""
    if len(trial) * trial.dt < settings.shortest_s:
        return None
    signals = {c: y for c in _SEEN if (y := trial.filled(c)) is not None and y.std() > 0.0}
    if not signals:
        return None
    seen = spectra(np.column_stack([*signals.values()]), trial.dt)
    parts = dict.fromkeys(signals, 1.0)
    water = [c in _WATER for c in signals]
    least = settings.line_in_all if sum(water) == len(_WATER) else settings.line
    frequency = peak(seen.of(water), least, settings)
    line = frequency is not None
    if frequency is None:
        left = unexplained(trial)
        if left is None:
            return None
        frequency = peak(left[1].of([c in _WATER for c in left[0]]), settings.broad, settings)
        if frequency is None:
            return None
        parts = _unexplained_parts(frequency, left, seen, signals)
    inside = (seen.hz > frequency / SETTINGS.band) & (seen.hz < frequency * SETTINGS.band)
    amplitude, share = {}, {}
    for column, (channel, y) in enumerate(signals.items()):
        power = float(seen.power[inside, column].sum() * seen.hz[0]) * parts.get(channel, 0.0)
        if (of_all := power / float(np.var(y))) > settings.share:
            amplitude[channel], share[channel] = math.sqrt(2.0 * power), of_all
    if not set(amplitude) & {*_WATER, "z"}:
        return None  # a peak in angles and rates alone is the vehicle's own period
    decay = _decay(trial, frequency, amplitude)
    return Waves(1.0 / frequency, line, amplitude, share, *decay)


def _unexplained_parts(
    frequency: float, left: tuple[str, Spectra], seen: Spectra, signals: Mapping[str, Array]
) -> dict[str, float]:
    """By channel: which part of its power around a frequency nothing explains, by its axis."""
    names, motion = left
    inside = (seen.hz > frequency / SETTINGS.band) & (seen.hz < frequency * SETTINGS.band)
    parts = {}
    for column, velocity in enumerate(names):
        whole = float(seen.power[inside, list(signals).index(velocity)].sum())
        parts[_AXIS[velocity]] = min(float(motion.power[inside, column].sum()) / max(whole, 1e-300), 1.0)
    return {channel: parts[_AXIS[channel]] for channel in signals if _AXIS[channel] in parts}


def commanded(trial: Trial, swell: Waves, settings: WaveSettings = SETTINGS) -> bool:
    """Whether a command goes together with the oscillation: preset ones explain it, a closed loop may answer
    it.
    """
    from scipy.signal import coherence

    inputs = [*trial.commands.values(), *([] if trial.tau is None else trial.tau.T)]
    # Eight windows at least, of three periods at least: fewer agree by chance.
    count = max(round(3.0 * swell.period_s / trial.dt), len(trial) // 8)
    for channel in swell.amplitude:
        y = trial.filled(channel)
        for u in inputs:
            if y is None or np.ptp(u) == 0.0 or len(y) < 4 * count:
                continue
            f, together = coherence(u, y, 1.0 / trial.dt, nperseg=count)
            if together[int(np.argmin(np.abs(f - 1.0 / swell.period_s)))] > settings.together:
                return True
    return False


def _decay(trial: Trial, frequency: float, amplitude: dict[str, float]) -> tuple[float, float]:
    """Rate of decay with depth and its deviation, 1/m, from the band's power in windows of some periods."""
    from scipy.signal import butter, sosfiltfilt

    channels = [c for c in ("w", "q", "pitch", "p", "v") if c in amplitude]
    depth = trial.filled("z")
    if not channels or depth is None:
        return math.nan, math.nan
    y = trial.filled(channels[0])
    assert y is not None
    limits = [frequency / SETTINGS.band, min(frequency * SETTINGS.band, 0.45 / trial.dt)]
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

    count = min(len(signals), max(256, round(SETTINGS.window_s / dt)))
    hz, power = welch(signals, 1.0 / dt, nperseg=count, detrend="linear", axis=0)
    return Spectra(hz[1:], power[1:], (len(signals) - count // 2) / (count - count // 2))


def unexplained(trial: Trial) -> tuple[str, Spectra] | None:
    """Velocity channels and the spectra of what nothing explains of them, SI; None without any. Each
    derivative is regressed on velocities, roll and pitch, commands and forces, then on their products with
    their own size, with surge and its square, while the recording is long enough for so many.
    """
    from scipy.ndimage import gaussian_filter1d

    def smooth(channel: Array) -> Array:
        return np.asarray(gaussian_filter1d(channel, SETTINGS.smoothed_s / trial.dt, axis=0))

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
        moving = part[:, part.std(axis=0) > SETTINGS.still * np.abs(part).max(axis=0, initial=SETTINGS.tiny)]
        if regressors.shape[1] + moving.shape[1] > len(trial) * trial.dt / SETTINGS.apart_s:
            break
        regressors = np.column_stack([regressors, (moving - moving.mean(axis=0)) / moving.std(axis=0)])
    derivatives = np.gradient(velocities, trial.dt, axis=0)
    fitted = regressors @ np.linalg.lstsq(regressors, derivatives, rcond=1e-8)[0]
    remainder = spectra(derivatives - fitted, trial.dt)
    # Smoothing and central differences damp high frequencies; uncorrected that would leave a peak below.
    gain = np.exp(-2.0 * (math.pi * remainder.hz * SETTINGS.smoothed_s) ** 2) * np.sinc(
        2.0 * remainder.hz * trial.dt
    )
    power = remainder.power / np.maximum(gain**2, 1e-3)[:, None]
    return "".join(measured), Spectra(remainder.hz, power, remainder.windows).integrated()


def peak(motion: Spectra, prominent: float, settings: WaveSettings = SETTINGS) -> float | None:
    """Frequency of the waves in spectra of velocities, Hz, the centroid above the power law; None where the
    geometric mean of the channels' prominence is too small, or may be scatter: the logarithm of a mean over m
    independent powers has the variance of that of a chi-squared variable of 2 m degrees of freedom, the
    trigamma function of m.
    """
    from scipy.special import polygamma
    from scipy.stats import norm

    hz, power = motion.hz, np.maximum(motion.power, np.finfo(float).tiny)
    if not power.shape[1]:
        return None
    duration = 0.5 * (motion.windows + 1.0) / hz[0]  # windows overlap by a half
    lowest, highest = (
        max(SETTINGS.band_hz[0], settings.fewest_periods / duration),
        min(SETTINGS.band_hz[1], 0.4 * hz[-1]),
    )
    best: tuple[float, float] | None = None
    for at in hz[(hz > lowest) & (hz < highest)]:
        bands = [(hz > a * at) & (hz < b * at) for a, b in (SETTINGS.near, SETTINGS.low, SETTINGS.high)]
        if not all(band.any() for band in bands):
            continue
        near, low, high = (np.log(power[band].mean(axis=0)) for band in bands)
        height = float(np.mean(near - 0.5 * (low + high)))
        # Hann's window makes neighbours depend on each other: three count as two.
        counts = [max(motion.windows * band.sum() / 1.5, 1.0) for band in bands]
        scatter = polygamma(1, counts[0]) + 0.25 * (polygamma(1, counts[1]) + polygamma(1, counts[2]))
        chance = SETTINGS.tried * norm.sf(height / math.sqrt(scatter / power.shape[1]))
        if (
            height > math.log(prominent)
            and chance < settings.false_alarm
            and (best is None or height > best[1])
        ):
            best = float(at), height
    if best is None:
        return None
    return _centroid(motion, best[0])


def _centroid(motion: Spectra, at: float) -> float:
    """Centroid of the energy about a peak above that power of the frequency, Hz."""
    hz, power = motion.hz, np.maximum(motion.power, np.finfo(float).tiny)
    ends = [(hz > a * at) & (hz < b * at) for a, b in (SETTINGS.low, SETTINGS.high)]
    low, high = (np.log(power[band].mean(axis=0)) for band in ends)
    apart = math.log(math.sqrt((SETTINGS.high[0] * SETTINGS.high[1]) / (SETTINGS.low[0] * SETTINGS.low[1])))
    around = (hz > SETTINGS.low[0] * at) & (hz < SETTINGS.high[0] * at)
    place = np.log(hz[around] / (at * math.sqrt(SETTINGS.low[0] * SETTINGS.low[1]))) / apart
    above = np.maximum(power[around] - np.exp(low + place[:, None] * (high - low)), 0.0)
    near = np.log(power[(hz > SETTINGS.near[0] * at) & (hz < SETTINGS.near[1] * at)].mean(axis=0))
    weight = np.maximum(near - 0.5 * (low + high), 0.0)  # channels vote with their prominence
    energy = (weight * above / np.maximum(above.sum(axis=0), np.finfo(float).tiny)).sum(axis=1)
    return float(hz[around] @ energy / energy.sum())
