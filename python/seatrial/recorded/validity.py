"""Whether a model still holds on a log: the share of it outside the 95 % band of the model's predictions.

In windows restarted every few seconds the band about the prediction is

    b(t) = f sqrt( var_draws(t) + s(t)^2 ),

var_draws the variance of the predictions for draws of the coefficients from their covariance and of the
sensors' offsets, which err all windows alike, s the spread of
a valid model's errors (`seatrial.recorded.spread`), f Student's factor for the windows that s rests on. A
valid model has 5 % of the samples outside. Neighbouring samples err alike, so a sample is no observation:
the windows are clusters, and the share has the variance of their means, which makes n samples worth

    n* = x (1 - x) / var(x) (t_{n-1} / t_{B-1})^2

independent ones (Korn & Graubard 1998, Survey Methodology 24:193), at least one per window and at most n.
All windows share one vehicle: had it the coefficients of draw j, its share outside would be x_j. The
p-value is the mean over the draws of the binomial tails ``P(X >= n* x | n*, max(x_j, 5 %))``: what is
within the covariance is no reason to doubt the model (predictive p-value; Box 1980, JRSS A 143:383). Where
the band rests on a reference worth n_r samples, its 5 % are Beta(n_r x_j, n_r (1 - x_j)). Over the channels
Holm's step-down holds the chance of any false alarm at the level.

"re-identify" needs both a p-value below the level and a share beyond `LEAST_SHARE`: on an hour of log, 6 %
outside may be certain and yet no reason for a day at sea.

Tests: ``tests/test_recorded_validity.py``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import repeat
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seatrial.channel import readable
from seatrial.recorded.clustered_share import clustered_share
from seatrial.recorded.restarts import Restarts
from seatrial.recorded.spread import INITIAL_PLACES, Spread
from seatrial.recording.columns import CHANNELS

__all__ = ["FEWEST_WINDOWS", "LEAST_SHARE", "LEVEL", "ChannelValidity", "Validity", "validity"]

Array = NDArray[np.float64]

LEVEL = 0.01
"""Chance of any false alarm, over all channels."""

LEAST_SHARE = 0.10
"""Share of a channel outside the band below which nothing is called wrong."""

FEWEST_WINDOWS = 6
"""Fewer restarts than this tell nothing."""

_NOMINAL = 0.05
_BETA = 64
_OFFSET_DRAWS = 32


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
    fails: bool

    def sentence(self) -> str:
        """The channel in words."""
        scale, unit = readable(self.channel)
        return (
            f"{self.channel}: {100.0 * self.outside:.0f} % outside the 95 % band (error"
            f" {scale * self.rms:.2g} {unit} rms, band ±{scale * self.spread:.2g} {unit}; p = {_p(self.p)})"
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
        Share outside had the vehicle and the sensors the values of a draw, (k, 12).
    draws
        Number of draws of the coefficients; zero without a covariance.
    """

    channels: Mapping[str, ChannelValidity]
    log: Restarts
    half_width: tuple[Array, ...]
    spread: Spread
    expected: Array
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
            "channels": {name: asdict(one) for name, one in self.channels.items()},
        }


def validity(
    log: Restarts,
    spread: Spread,
    *,
    draws: Mapping[str, Array] | None = None,
    offsets: Mapping[str, float] | None = None,
    level: float = LEVEL,
) -> Validity:
    """Validity of a model on a log by the share of each channel outside the 95 % band.

    Parameters
    ----------
    log : Restarts
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
    pulls = _pulls(log) if known.any() else [np.zeros((len(one), 12, 12)) for one in log.predicted]
    variance, sound = _variance(log, _deviations(log, given, known, pulls))
    sigma = [spread.at(log.since_restart(w)) for w in range(len(log.spans))]
    factor = spread.factor
    half = tuple(factor * np.sqrt(v + s**2) for v, s in zip(variance, sigma, strict=True))
    expected = _expected(_deviations(log, given, known, pulls), sound, (half, sigma))
    found: dict[str, tuple[float, int, float, float]] = {}
    for name in log.channels:
        c = CHANNELS.index(name)
        if not np.isfinite(half[0][:, c]).all():
            continue
        out = [
            (np.abs(error[:, c]) > band[:, c])[mask[:, c]]
            for error, band, mask in zip(log.residual, half, log.counted, strict=True)
        ]
        share, samples, effective = clustered_share(out)
        found[name] = (
            share,
            samples,
            effective,
            _tail(share, effective, (expected[:, c], float(spread.effective[c]))),
        )
    adjusted = _holm(np.array([p for *_, p in found.values()]))
    channels = {}
    for (name, (share, samples, effective, _)), p in zip(found.items(), adjusted, strict=True):
        c = CHANNELS.index(name)
        error = np.concatenate([e[m[:, c], c] for e, m in zip(log.residual, log.counted, strict=True)])
        band = np.concatenate([b[m[:, c], c] for b, m in zip(half, log.counted, strict=True)])
        fails = bool(p < level and share > LEAST_SHARE)
        size = [float(np.sqrt(np.mean(one**2))) for one in (error, band)]
        channels[name] = ChannelValidity(
            name, share, samples, effective, float(p), rms=size[0], spread=size[1], fails=fails
        )
    return Validity(channels, log, half, spread, expected, int(sound.sum()) if given else 0)


def power(of: Validity, change: list[Array], *, level: float = LEVEL) -> float:
    """Chance that a change of the vehicle is noticed, which moves the predictions by (n, 12) per window.

    The largest over the channels: of a binomial count of as many samples as the channel is worth, held
    against the count that `validity` would call no chance.
    """
    from scipy.stats import binom

    best = 0.0
    sigma = [of.spread.at(of.log.since_restart(w)) for w in range(len(change))]
    for name, one in of.channels.items():
        c = CHANNELS.index(name)
        share = _share([d[:, c] for d in change], [s[:, c] for s in sigma], [b[:, c] for b in of.half_width])
        count = max(1, round(min(one.effective, 4.0 * len(change))))
        known = of.expected[:, c], float(of.spread.effective[c])
        needed = _needed(count, known, level / len(of.channels))
        best = max(best, float(binom.sf(needed - 1, count, share)))
    return best


def _needed(count: int, known: tuple[Array, float], level: float) -> int:
    """Least number of samples outside, of so many, that is no chance; one more than there are if none is."""
    least, most = int(LEAST_SHARE * count), count + 1
    while most - least > 1:
        middle = (least + most) // 2
        if _tail(middle / count, float(count), known) < level:
            most = middle
        else:
            least = middle
    return most


def _deviations(
    log: Restarts, draws: Mapping[str, Array], offsets: Array, pulls: Sequence[Array]
) -> Iterator[list[Array]]:
    """What vehicles and sensors that may be true would show about the prediction, (n, 12) per window."""
    shown: Iterable[Sequence[Array]] = log.drawn(draws) if draws else repeat(log.predicted)
    count = len(next(iter(draws.values()))) if draws else (_OFFSET_DRAWS if offsets.any() else 0)
    rng = np.random.default_rng(0)
    for _, one in zip(range(count), shown, strict=False):
        offset = offsets * rng.standard_normal(12)
        yield [
            _apart(part, nominal) + pull @ offset
            for part, nominal, pull in zip(one, log.predicted, pulls, strict=True)
        ]


def _variance(log: Restarts, deviations: Iterable[list[Array]]) -> tuple[list[Array], NDArray[np.bool_]]:
    """Variance (n, 12) per window of deviations, and which of them did not diverge."""
    total = [np.zeros_like(one) for one in log.predicted]
    sound = []
    for away in deviations:
        sound.append(all(np.isfinite(one).all() for one in away))
        if sound[-1]:
            for sums, one in zip(total, away, strict=True):
                sums += one**2
    return [one / max(sum(sound), 1) for one in total], np.array(sound, dtype=bool)


def _expected(
    deviations: Iterable[list[Array]], sound: NDArray[np.bool_], bands: tuple[tuple[Array, ...], list[Array]]
) -> Array:
    """Share (k, 12) outside the band had the vehicle and the sensors the values of each draw."""
    half, sigma = bands
    rows = [
        [_share(*([part[:, c] for part in some] for some in (away, sigma, half))) for c in range(12)]
        for away, good in zip(deviations, sound, strict=True)
        if good
    ]
    return np.maximum(np.array(rows), _NOMINAL) if rows else np.full((1, 12), _NOMINAL)


def _share(away: list[Array], sigma: list[Array], half: list[Array]) -> float:
    """Expected share outside a band of half-width `half` for normal errors of spread `sigma` about `away`."""
    from scipy.special import ndtr

    d, s, b = (np.concatenate(part) for part in (away, sigma, half))
    if not np.isfinite(s).all():
        return _NOMINAL
    return float(np.mean(ndtr((-b - d) / s) + ndtr((d - b) / s)))


def _tail(share: float, effective: float, known: tuple[Array, float]) -> float:
    """Mean binomial tail of a share of effectively so many samples over expected shares (k,).

    The expected shares are themselves known from as many samples as the spread is worth: a Beta distribution.
    """
    from scipy.special import betainc, betaincinv

    expected, rests_on = known
    hits = share * effective
    if hits <= 0.0:
        return 1.0
    x = np.clip(expected, 0.0, 1.0 - 1e-9)
    if np.isfinite(rests_on):
        rank = (np.arange(_BETA) + 0.5) / _BETA
        x = betaincinv(rests_on * x[:, None], rests_on * (1.0 - x[:, None]), rank)
    return float(np.mean(betainc(hits, effective - hits + 1.0, x)))


def _holm(p: Array) -> Array:
    """P-values (m,) adjusted by Holm's step-down."""
    order = np.argsort(p, kind="stable")
    raw = np.minimum((len(p) - np.arange(len(p))) * p[order], 1.0)
    adjusted = np.empty(len(p))
    adjusted[order] = np.maximum.accumulate(raw)
    return adjusted


def _pulls(log: Restarts) -> list[Array]:
    """What an offset of each channel does to predicted less measured, (n, 12, 12) per window."""
    places = np.argsort(INITIAL_PLACES)  # a start is told by the same sensors
    return [one.by_start[:, :, places] - np.eye(12) for one in log.slopes([])]


def _apart(shown: Array, nominal: Array) -> Array:
    from seatrial.rotation import shorter

    away = shown - nominal
    away[:, 9:] = shorter(away[:, 9:])
    return np.asarray(away)


def _p(value: float) -> str:
    return f"{value:.2g}" if value >= 1e-4 else "below 0.0001"
