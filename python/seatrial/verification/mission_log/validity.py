"""Whether a model still holds on a log: the share of it outside the 95 % band of the model's predictions.

In windows restarted every few seconds the band about the prediction is

    b(t) = f sqrt( var_draws(t) + s(t)^2 ),

var_draws the variance of the predictions for draws of the coefficients from their covariance and of the
sensors' offsets, which err all windows alike, s the spread of a valid model's errors
(`seatrial.verification.mission_log.spread`), f Student's factor for the windows that s rests on. A valid
model has 5 % of the samples outside. Neighbouring samples err alike, so a sample is no observation: the
windows are clusters, and the share has the variance of their means, which makes n samples worth

    n* = x (1 - x) / var(x) (t_{n-1} / t_{B-1})^2

independent ones (Korn & Graubard 1998, Survey Methodology 24:193), at least one per window and at most n. All
windows share one vehicle: had it the coefficients of draw j, its share outside would be x_j, and what is
within the covariance is no reason to doubt the model. A p-value of a thousandth takes thousands of draws:
they move the predictions by exact derivatives, to first order. Over the channels Holm's step-down holds the
chance of any false alarm at the level.

The band holds what a reference leaves, and a reference on which the model is wrong makes it wide: what
stays inside speaks for a model only where the log could have refuted it
(`seatrial.verification.mission_log.power`).

Between the level and a p-value of 5 % a log neither refutes the model nor speaks for it.

"re-identify" needs both a p-value below the level and a share beyond `LEAST_SHARE`: on an hour of log, 6 %
outside may be certain and yet no reason for a day at sea.

Tests: ``tests/verification/test_recorded_validity.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import CHANNELS, readable
from seatrial.base.frames import shorter
from seatrial.statistics.multiple_testing import holm
from seatrial.verification.mission_log.restarts import PredictedLog
from seatrial.verification.mission_log.spread import (
    INITIAL_PLACES,
    LEAST_SHARE,
    ExpectedShare,
    Spread,
    clustered_share,
    share_interval,
)

LEVEL = 0.01
"""Chance of any false alarm, over all channels."""

DOUBT = 0.05
"""P-value below which a model is not called valid either."""

FEWEST_WINDOWS = 6
"""Fewer restarts than this tell nothing."""

_OFFSET_DRAWS = 2048  # a tail of 5 % is then known to 0.5 %

_SAMPLES = 300
"""Samples of a channel that tell the share of a draw: neighbours say the same."""


@dataclass(frozen=True)
class ChannelValidity:
    """One channel: share of its samples outside the 95 % band, and whether that is more than chance.

    Attributes
    ----------
    channel
        Its name.
    outside
        Share of the samples outside.
    samples, effective
        Samples that count, and how many independent ones they are worth.
    p
        P-value, adjusted over the channels (Holm).
    rms, spread
        Root mean square of the error, and of the half-width of the band, SI.
    signal
        Root mean square of what the channel does after a restart: its change from the value there, SI.
    fails
        Whether the share is large and no chance.
    """

    channel: str
    outside: float
    samples: int
    effective: float
    p: float
    rms: float
    spread: float
    signal: float
    fails: bool

    @property
    def band_over_signal(self) -> float:
        """Half-width of the band over what the channel does; infinite where it does nothing."""
        return self.spread / self.signal if self.signal > 0.0 else math.inf

    @property
    def interval(self) -> tuple[float, float]:
        """Interval of 95 % of the share outside, by what the samples are worth."""
        return share_interval(self.outside, self.effective)

    @property
    def doubtful(self) -> bool:
        """Whether the share is large and hardly chance, though it does not refute the model."""
        return not self.fails and self.p < DOUBT and self.outside > LEAST_SHARE

    @property
    def p_text(self) -> str:
        """The p-value as text."""
        return f"{self.p:.2g}" if self.p >= 1e-4 else "below 0.0001"

    def sentence(self) -> str:
        """The channel in words."""
        scale, unit = readable(self.channel)
        return (
            f"{self.channel}: {100.0 * self.outside:.0f} % outside the 95 % band (error"
            f" {scale * self.rms:.2g} {unit} rms, band ±{scale * self.spread:.2g} {unit}; p = {self.p_text})"
        )


@dataclass(frozen=True, eq=False)
class Validity:
    """Whether a model holds on a log.

    Attributes
    ----------
    channels
        A `ChannelValidity` per channel, by name.
    log
        The windows.
    half_width
        Half-width of the band per window, (n, 12), SI.
    spread
        The spread of a valid model's errors.
    expected
        Share outside that is to be expected, by channel.
    draws
        Number of draws of the coefficients; zero without a covariance.
    """

    channels: Mapping[str, ChannelValidity]
    log: PredictedLog
    half_width: tuple[Array, ...]
    spread: Spread
    expected: Mapping[str, ExpectedShare]
    draws: int

    @property
    def failing(self) -> list[ChannelValidity]:
        """Channels that fail, the largest share first."""
        return sorted((one for one in self.channels.values() if one.fails), key=lambda one: -one.outside)

    @property
    def outside(self) -> float:
        """Share of all samples outside the band."""
        samples = sum(one.samples for one in self.channels.values())
        return sum(one.outside * one.samples for one in self.channels.values()) / max(samples, 1)

    def to_dict(self) -> dict[str, Any]:
        """The same as plain data, without the samples."""
        return {
            "outside": self.outside,
            "windows": len(self.log.spans),
            "draws": self.draws,
            "spread": self.spread.source,
            "channels": {
                name: asdict(one) | {"interval": list(one.interval), "band_over_signal": one.band_over_signal}
                for name, one in self.channels.items()
            },
        }


def validity(
    log: PredictedLog,
    spread: Spread,
    *,
    draws: Mapping[str, Array] | None = None,
    offsets: Mapping[str, float] | None = None,
    level: float = LEVEL,
) -> Validity:
    """Validity of a model on a log by the share of each channel outside the 95 % band.

    Parameters
    ----------
    log : PredictedLog
    spread : Spread
        Of a valid model's errors.
    draws : mapping of str to (k,) ndarray, optional
        Draws of the coefficients from their covariance.
    offsets : mapping of str to float, optional
        Standard deviation, SI, of the offset that the sensor of a channel has throughout a log.
    level : float, optional
        Chance of any false alarm over all channels.
    """
    given = {} if draws is None else {name: np.asarray(values, float) for name, values in draws.items()}
    known = np.zeros(12) if offsets is None else np.array([offsets.get(name, 0.0) for name in CHANNELS])
    moved = _Moved(log, given, known)
    sigma = [spread.at(log.since_restart(w)) for w in range(len(log.spans))]
    factor = spread.factor
    half = tuple(factor * np.sqrt(v + s**2) for v, s in zip(moved.variance(), sigma, strict=True))
    expected: dict[str, ExpectedShare] = {}
    found: dict[str, tuple[float, int, float, float]] = {}
    for name in log.channels:
        c = CHANNELS.index(name)
        if not np.isfinite(half[0][:, c]).all():
            continue
        out = [
            (np.abs(error[:, c]) > band[:, c])[mask[:, c]]
            for error, band, mask in zip(log.residual, half, log.counted, strict=True)
        ]
        expected[name] = ExpectedShare.of(moved.shares(c, half, sigma), float(spread.effective[c]))
        share, samples, effective = clustered_share(out)
        found[name] = share, samples, effective, expected[name].p(share, effective)
    adjusted = holm([p for *_, p in found.values()])
    channels = {}
    for (name, (share, samples, effective, _)), p in zip(found.items(), adjusted, strict=True):
        c = CHANNELS.index(name)
        error = np.concatenate([e[m[:, c], c] for e, m in zip(log.residual, log.counted, strict=True)])
        band = np.concatenate([b[m[:, c], c] for b, m in zip(half, log.counted, strict=True)])
        moved_by = _change_since_restart(log, c)
        fails = bool(p < level and share > LEAST_SHARE)
        size = [float(np.sqrt(np.mean(one**2))) for one in (error, band, moved_by)]
        channels[name] = ChannelValidity(
            name,
            share,
            samples,
            effective,
            float(p),
            rms=size[0],
            spread=size[1],
            signal=size[2],
            fails=fails,
        )
    return Validity(channels, log, half, spread, expected, moved.count if given else 0)


def _change_since_restart(log: PredictedLog, c: int) -> Array:
    """Measured less its value at the restart, (n,), SI: what a channel does where it counts."""
    found = []
    for predicted, residual, mask in zip(log.predicted, log.residual, log.counted, strict=True):
        change = predicted[:, c] + residual[:, c] - predicted[0, c]
        found.append(change[mask[:, c]])
    all_changes = np.concatenate(found)
    return shorter(all_changes) if CHANNELS[c] in ("roll", "pitch", "yaw") else all_changes


class _Moved:
    """What vehicles and sensors that may be true would show about the prediction, to first order."""

    def __init__(self, log: PredictedLog, draws: Mapping[str, Array], offsets: Array) -> None:
        present = log.vehicle.coefficients()
        names = list(draws)
        self.log = log
        self.count = len(draws[names[0]]) if names else (_OFFSET_DRAWS if offsets.any() else 0)
        self.slopes = log.slopes([{name: 1.0} for name in names]) if self.count else ()
        rng = np.random.default_rng(0)
        self.amounts = np.stack(
            [draws[name] - present.get(name, 0.0) for name in names]
            + list(offsets[:, None] * rng.standard_normal((12, self.count)))
        )  # (d + 12, k)

    def variance(self) -> list[Array]:
        """Variance (n, 12) per window of what is shown about the prediction."""
        if not self.count:
            return [np.zeros_like(one) for one in self.log.predicted]
        moment = self.amounts @ self.amounts.T / self.count
        found = []
        for w in range(len(self.log.spans)):
            basis = self._basis(w)
            found.append(np.einsum("ncd,ncd->nc", basis @ moment, basis))
        return found

    def shares(self, c: int, half: Sequence[Array], sigma: Sequence[Array]) -> Array | None:
        """Share (k,) of a channel outside the band had vehicle and sensors the values of each draw."""
        if not self.count:
            return None
        masks = [mask[:, c] for mask in self.log.counted]
        every = max(1, int(sum(mask.sum() for mask in masks)) // _SAMPLES)
        basis, b, s = (
            np.concatenate([part[mask] for part, mask in zip(parts, masks, strict=True)])[::every]
            for parts in (
                [self._basis(w)[:, c] for w in range(len(masks))],
                [one[:, c] for one in half],
                [one[:, c] for one in sigma],
            )
        )
        return _outside(basis @ self.amounts, s[:, None], b[:, None])

    def _basis(self, w: int) -> Array:
        """Derivatives (n, 12, d + 12) of a window by coefficients and by the sensors' offsets."""
        # A start is told by the same sensors, and what is measured moves as well.
        places = np.argsort(INITIAL_PLACES)
        one = self.slopes[w]
        return np.concatenate([one.by_direction, one.by_start[:, :, places] - np.eye(12)], axis=2)


def _outside(away: Array, sigma: Array, half: Array) -> Array:
    """Mean over the first axis of the chance that a normal error about `away` is outside."""
    from scipy.special import ndtr

    return np.asarray(np.mean(ndtr((-half - away) / sigma) + ndtr((away - half) / sigma), axis=0))
