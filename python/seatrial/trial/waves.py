"""Waves in a recording: their period, what they do to each channel, and how that fades with depth.

A swell of nearly one frequency is a line on the spectra of the velocities. Broader waves are a peak on what
neither motion nor commands explain of them (`seatrial.trial.unexplained`), where a swell hides: two signals
of one frequency explain any third. The amplitude of a channel is ``sqrt(2 P)``, with P its power in the band
around the frequency, and without a line the part of it that nothing explains of the axis. Linear waves in
deep water fade as ``exp(-k z)``, ``k = omega^2 / g`` (Fossen 2011, section 8.2). Held by
``tests/trial/test_wave_recipes.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.trial.unexplained import BROAD, Spectra, peak, spectra, unexplained

if TYPE_CHECKING:
    from seatrial.trial.trial import Trial

_LINE, _LINE_IN_ALL = 20.0, 8.0
"""Least prominence of waves on the motion itself, of one or two translations and of all three.

Set points and own periods move the vehicle in one plane: a busy mission's heave reached 17 in calm water, the
mean over surge, sway and heave 4.
"""
_BAND = 1.35  # around the peak, as a factor of its frequency
_SEEN = ("u", "v", "w", "p", "q", "r", "z", "roll", "pitch", "yaw")
_WATER = "uvw"  # water moves in all directions
_AXIS = dict(zip(_SEEN, "XYZKMNZKMN", strict=True))
_SHORTEST_S = 40.0  # of a recording
_TOGETHER = 0.5
_SHARE = 0.02  # of a channel's variance: less is no wave


@dataclass(frozen=True)
class Waves:
    """What waves do in a recording.

    Attributes
    ----------
    period_s
        Of the spectral peak, as the vehicle meets the waves.
    line
        Whether they are a line on the motion itself; otherwise a peak on what a crude regression on state and
        commands leaves of it, which may be motion that it did not explain.
    amplitude
        By channel in SI: m/s, rad/s, m, rad; channels that show the peak.
    share
        By channel: part of its variance in the wave band.
    decay_1_m
        Rate at which the motion fades with depth, 1/m, and `decay_deviation_1_m`; NaN where the depth hardly
        changed.
    """

    period_s: float
    line: bool
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
    if len(trial) * trial.dt < _SHORTEST_S:
        return None
    signals = {c: y for c in _SEEN if (y := trial.filled(c)) is not None and y.std() > 0.0}
    if not signals:
        return None
    seen = spectra(np.column_stack([*signals.values()]), trial.dt)
    parts = dict.fromkeys(signals, 1.0)
    water = [c in _WATER for c in signals]
    found = peak(seen.of(water), _LINE_IN_ALL if sum(water) == len(_WATER) else _LINE)
    line = found is not None
    if found is None:
        left = unexplained(trial)
        found = None if left is None else peak(left[1].of([c in _WATER for c in left[0]]), BROAD)
        if left is None or found is None:
            return None
        parts = _unexplained_parts(found, left, seen, signals)
    inside = (seen.hz > found / _BAND) & (seen.hz < found * _BAND)
    amplitude, share = {}, {}
    for column, (channel, y) in enumerate(signals.items()):
        power = float(seen.power[inside, column].sum() * seen.hz[0]) * parts.get(channel, 0.0)
        if (of_all := power / float(np.var(y))) > _SHARE:
            amplitude[channel], share[channel] = math.sqrt(2.0 * power), of_all
    if not set(amplitude) & {*_WATER, "z"}:
        return None  # a peak in angles and rates alone is the vehicle's own period
    decay = _decay(trial, found, amplitude)
    return Waves(1.0 / found, line, amplitude, share, *decay)


def _unexplained_parts(
    frequency: float, left: tuple[str, Spectra], seen: Spectra, signals: Mapping[str, Array]
) -> dict[str, float]:
    """By channel: which part of its power around a frequency nothing explains, by its axis."""
    names, motion = left
    inside = (seen.hz > frequency / _BAND) & (seen.hz < frequency * _BAND)
    parts = {}
    for column, velocity in enumerate(names):
        whole = float(seen.power[inside, list(signals).index(velocity)].sum())
        parts[_AXIS[velocity]] = min(float(motion.power[inside, column].sum()) / max(whole, 1e-300), 1.0)
    return {channel: parts[_AXIS[channel]] for channel in signals if _AXIS[channel] in parts}


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
