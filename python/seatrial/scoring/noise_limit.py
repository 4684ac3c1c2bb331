"""What no model of the vehicle can predict of a recording: noise of the sensors and motion by waves.

The R2 that a perfect model of the vehicle, which knows no waves, could reach on a set of samples is

    R2 at most = 1 - sum (sigma_noise^2 + sigma_wave^2) / SST,

summed over the samples that count, each with the variances of its trial and channel.

Noise is white: its differences of order k have ``binomial(2 k, k)`` times its variance, those of the motion
next to nothing (von Neumann et al., *Ann. Math. Stat.* 12 (1941) 153, for the first difference). The median
absolute difference is taken, which steps of the motion do not move, of the order from 2 to 5 that gives
least. It is looked for in the samples of the sensor itself; between two of them the straight line of the time
base has less, ``(1 - f)^2 + f^2`` of it. Coloured noise and the noise of a rate that was differentiated from
angles are underestimated: the figure is an upper limit.

The variance by waves is the power that they have in their band (`seatrial.inspect.waves`), none
where open-loop commands oscillate alike. Where there is such a peak, a score is split in two bands at the
frequency below it: the cosine transform (DCT-II, orthonormal) of a window's errors and of its measured
deviations parts both sums of squares exactly.

Tests: ``tests/scoring/test_noise_limit.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES, CHANNELS, VELOCITIES
from seatrial.inspect.feedback import LEAST_S, feedback
from seatrial.inspect.verdict import Verdict, blind, judge_trial
from seatrial.inspect.waves import commanded, waves
from seatrial.scoring.windows import Window, channel_errors

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.trial.trial import Trial

_NORMAL = 1.4826  # deviation of a normal distribution over its median absolute value


@dataclass(frozen=True)
class NoiseLimitSettings:
    """How noise and waves are told apart from motion."""

    orders: tuple[int, ...] = (2, 3, 4, 5)  #: Of the differences that leave the noise.
    fewest_samples: int = 10  #: Samples that tell a noise.
    #: A wave peak begins at its frequency divided by this, as in `seatrial.inspect.waves`.
    below_peak: float = 1.35


SETTINGS = NoiseLimitSettings()


@dataclass(frozen=True)
class Unpredictable:
    """Variances by velocity channel, SI: of sensor noise and of motion by waves; period of these, s.

    ``period_s`` is None where no waves are seen. ``blind`` has the letters of the axes whose commands
    answer waves: a replay of them without the waves judges no model (`seatrial.inspect.verdict.blind`).
    """

    noise: Mapping[str, float]
    wave: Mapping[str, float]
    period_s: float | None
    blind: str = ""


@dataclass(frozen=True)
class Band:
    """R2 of one channel below wave frequencies and from there on; NaN where nothing moves."""

    below: float
    at: float


_CALM = Unpredictable({}, {}, None)


def unpredictable(trial: Trial, verdicts: Mapping[str, Verdict]) -> Unpredictable:
    """What no model of the vehicle can predict of a whole trial: a part of it may be too short to see waves.

    `verdicts` are of `seatrial.inspect.verdict.judge_trial` on it; empty without a vehicle.
    """
    noise = {c: _noise(trial, c) for c in trial.channels if c in VELOCITIES}
    swell = waves(trial)
    if swell is not None and commanded(trial, swell) and not any(loop.closed for loop in feedback(trial)):
        swell = None
    if swell is None:
        return Unpredictable(noise, {}, None, blind(verdicts))
    wave = {c: 0.5 * a**2 for c, a in swell.amplitude.items() if c in VELOCITIES}
    return Unpredictable(noise, wave, swell.period_s, blind(verdicts))


def limits_of(trials: Sequence[Trial], vehicle: Vehicle | None) -> dict[str, Unpredictable]:
    """By trial what no model can predict; without a vehicle no axis is left out."""
    limits = {}
    for trial in trials:
        long = (bool(trial.commands) or trial.tau is not None) and len(trial) * trial.dt >= LEAST_S
        limits[trial.name] = unpredictable(
            trial, judge_trial(trial, vehicle) if vehicle is not None and long else {}
        )
    return limits


def judging(channel: str, judged: Sequence[Window], limits: Mapping[str, Unpredictable]) -> list[Window]:
    """Windows of those trials on which a replay can judge a model in this channel."""
    axis = AXES[CHANNELS.index(channel) % 6]
    return [w for w in judged if (own := limits.get(w.trial.name)) is None or axis not in own.blind]


def ceiling(
    judged: Sequence[Window], channels: Iterable[str], limits: Mapping[str, Unpredictable]
) -> dict[str, float]:
    """R2 at most by velocity channel on the windows of a score, at least zero.

    `limits` go by the name of the trial; a channel is left out where a trial has none.
    """
    reachable = {}
    for channel in channels:
        windows = judging(channel, judged, limits)
        away = channel_errors(channel, windows)[1] if channel in VELOCITIES else []
        sst = sum(float(deviation @ deviation) for deviation in away)
        known = [limits.get(window.trial.name) for window in windows]
        if not sst > 0.0 or any(limit is None or channel not in limit.noise for limit in known):
            continue
        lost = sum(
            len(y) * (limit.noise[channel] + limit.wave.get(channel, 0.0))
            for y, limit in zip(away, known, strict=True)
            if limit is not None
        )
        reachable[channel] = max(1.0 - lost / sst, 0.0)
    return reachable


def bands(
    judged: Sequence[Window], channels: Iterable[str], limits: Mapping[str, Unpredictable]
) -> dict[str, Band]:
    """R2 by velocity channel below wave frequencies and from there on, where the channel shows the waves."""
    from scipy.fft import dct

    wavy = {name: limit for name, limit in limits.items() if limit.period_s is not None}
    by_channel = {}
    for channel in channels:
        windows = [
            w for w in judging(channel, judged, limits) if channel in wavy.get(w.trial.name, _CALM).wave
        ]
        if channel not in VELOCITIES or not windows:
            continue
        sums = np.zeros((2, 2))  # errors and deviations, below and from the waves on
        for window, error, away in zip(windows, *channel_errors(channel, windows), strict=True):
            if not len(error):
                continue
            period_s = wavy[window.trial.name].period_s
            assert period_s is not None
            edge = 1.0 / (SETTINGS.below_peak * period_s)
            low = np.arange(len(error)) < 2.0 * edge * len(error) * window.trial.dt
            for row, values in enumerate((error, away)):
                with np.errstate(invalid="ignore", over="ignore"):  # a simulation that diverged
                    power = dct(values, norm="ortho") ** 2
                sums[row] += power[low].sum(), power[~low].sum()
        if sums[1].any():
            with np.errstate(divide="ignore", invalid="ignore"):
                by_channel[channel] = Band(*(1.0 - sums[0] / sums[1]).tolist())
    return by_channel


def _noise(trial: Trial, channel: str) -> float:
    """Variance of the white noise in the samples of a velocity on the time base, SI."""
    good = trial.valid[:, CHANNELS.index(channel)]
    # Where a sensor's own samples are not known the time base is taken for its stamps.
    stamps, own = trial.samples.get(channel, (trial.t[good], trial.channel(channel)[good]))
    if len(own) < SETTINGS.fewest_samples or not good.any():
        return 0.0
    at = trial.t[good]
    after = np.clip(np.searchsorted(stamps, at - 1e-9), 1, len(stamps) - 1)
    f = np.clip((at - stamps[after - 1]) / np.maximum(np.diff(stamps)[after - 1], 1e-9), 0.0, 1.0)
    return _white(own) * float(np.mean((1.0 - f) ** 2 + f**2))


def _white(y: Array) -> float:
    """Variance of white noise in samples (n,) of a smooth motion."""
    # Neighbours over a gap are no neighbours, but few beside the others: the median does not see them.
    variances = [
        float(np.median(np.abs(np.diff(y, order)))) ** 2 / math.comb(2 * order, order)
        for order in SETTINGS.orders
    ]
    return _NORMAL**2 * min(variances)
