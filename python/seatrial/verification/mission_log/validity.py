"""Whether a model still holds on a log: the share of it outside the 95 % band of the model's predictions.

What stays inside speaks for a model only where the log could have refuted it
(`seatrial.verification.mission_log.power`), and where the channels of the log tell of one motion
(`contradictions`). Held by ``tests/verification/test_recorded_validity.py`` and
``test_recorded_contradiction.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import CHANNELS
from seatrial.base.frames import from_euler, matrix, shorter
from seatrial.statistics.significance import holm
from seatrial.trial.trial import Trial
from seatrial.verification.mission_log.spread import (
    SPREAD_SETTINGS,
    ExpectedShare,
    PredictedLog,
    Spread,
    clustered_share,
    share_interval,
)


@dataclass(frozen=True)
class ValiditySettings:
    """When a log refutes a model or leaves a doubt."""

    level: float = 0.01  #: Chance of any false alarm, over all channels.
    doubt: float = 0.05  #: P-value below which a model is not called valid either.
    fewest_windows: int = 6  #: Fewer restarts than this tell nothing.
    offset_draws: int = 2048  #: Draws of the offsets of the sensors: a tail of 5 % is then known to 0.5 %.
    samples: int = 300  #: Samples of a channel that tell the share of a draw: neighbours say the same.


VALIDITY_SETTINGS = ValiditySettings()


@dataclass(frozen=True)
class ChannelValidity:
    """One channel: share of its samples outside the 95 % band, and whether that is more than chance.

    `channel`: its name. `outside`: share of the samples outside. `samples`, `effective`: samples that count,
    and how many independent ones they are worth. `p`: p-value, adjusted over the channels (Holm). `rms`,
    `spread`: root mean square of the error, and of the half-width of the band, SI. `signal`: root mean square
    of what the channel does after a restart: its change from the value there, SI. `fails`: whether the share
    is large and no chance.
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
        return (
            not self.fails and self.p < VALIDITY_SETTINGS.doubt and self.outside > SPREAD_SETTINGS.least_share
        )


@dataclass(frozen=True, eq=False)
class Validity:
    """Whether a model holds on a log.

    `channels`: a `ChannelValidity` per channel, by name. `log`: the windows. `half_width`: half-width of the
    band per window, (n, 12), SI. `spread`: the spread of a valid model's errors. `expected`: share outside
    that is to be expected, by channel. `draws`: number of draws of the coefficients; zero without a
    covariance.
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
    level: float = VALIDITY_SETTINGS.level,
) -> Validity:
    """Validity of a model on a log by the share of each channel outside the 95 % band.

    In windows restarted every few seconds the band about the prediction is ``b(t) = f sqrt(var_draws(t) +
    s(t)^2)``: the variance of the predictions for draws of the coefficients from their covariance and of the
    sensors' offsets, which err all windows alike, the spread s of a valid model's errors, and Student's
    factor f for the windows that s rests on. A valid model has 5 % of the samples outside; what a share is
    worth says `seatrial.verification.mission_log.spread.clustered_share`. All windows share one vehicle: had
    it the coefficients of draw j, its share outside would be x_j, and what is within the covariance is no
    reason to doubt the model. A p-value of a thousandth takes thousands of draws: they move the predictions
    by exact derivatives, to first order. Over the channels Holm's step-down holds the chance of any false
    alarm at the level. A channel fails by a p-value below the level and a share beyond ``least_share``: on an
    hour of log, 6 % outside may be certain and yet no reason for a day at sea.

    `spread`: of a valid model's errors. `draws`: draws of the coefficients from their covariance. `offsets`:
    standard deviation, SI, of the offset that the sensor of a channel has throughout a log. `level`: chance
    of any false alarm over all channels.
    """
    given = {} if draws is None else {name: np.asarray(values, float) for name, values in draws.items()}
    known = np.zeros(12) if offsets is None else np.array([offsets.get(name, 0.0) for name in CHANNELS])
    # The band: what draws and offsets move the prediction by, and the spread of a valid model's errors.
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
    # Over the channels the chance of any false alarm is held at the level.
    adjusted = holm([p for *_, p in found.values()])
    channels = {}
    for (name, (share, samples, effective, _)), p in zip(found.items(), adjusted, strict=True):
        c = CHANNELS.index(name)
        error = np.concatenate([e[m[:, c], c] for e, m in zip(log.residual, log.counted, strict=True)])
        band = np.concatenate([b[m[:, c], c] for b, m in zip(half, log.counted, strict=True)])
        rms, spread_of, signal = (
            float(np.sqrt(np.mean(part**2))) for part in (error, band, _change_since_restart(log, c))
        )
        fails = bool(p < level and share > SPREAD_SETTINGS.least_share)
        channels[name] = ChannelValidity(
            name, share, samples, effective, float(p), rms, spread_of, signal, fails
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
        self.count = VALIDITY_SETTINGS.offset_draws if offsets.any() else 0
        if names:
            self.count = len(draws[names[0]])
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
        every = max(1, int(sum(mask.sum() for mask in masks)) // VALIDITY_SETTINGS.samples)
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
        places = np.argsort(SPREAD_SETTINGS.initial_places)
        one = self.slopes[w]
        return np.concatenate([one.by_direction, one.by_start[:, :, places] - np.eye(12)], axis=2)


def _outside(away: Array, sigma: Array, half: Array) -> Array:
    """Mean over the first axis of the chance that a normal error about `away` is outside."""
    from scipy.special import ndtr

    return np.asarray(np.mean(ndtr((-half - away) / sigma) + ndtr((away - half) / sigma), axis=0))


_INTEGRALS = {
    "x": ("u", "v", "w"),
    "y": ("u", "v", "w"),
    "z": ("u", "v", "w"),
    "roll": ("p",),
    "pitch": ("q",),
    "yaw": ("r",),
}
"""Channels, and those whose integral they are."""


@dataclass(frozen=True)
class ContradictionSettings:
    """When channels of a log tell of two motions."""

    #: Time over which a change is taken, s: long against a delay of sensors, short against their drifts.
    window_s: float = 5.0
    #: Samples of the channel that a window holds at least: a slow fix is compared over a longer one.
    samples: int = 5
    #: Windows of a stretch: of twelve pairs that have nothing in common the correlation is beyond 0.5 by
    #: chance in one of ten stretches; what belongs together has more than 0.9.
    windows: int = 12
    #: What an unknown lever arm of a sensor adds to a change by turning, m per rad. Like the leak so chosen
    #: that a hover vehicle that spun in a tank, its Doppler log beside its centre, contradicts nothing.
    arm_m: float = 1.0
    leak: float = 0.1  #: Share of a rotation about the other axes that leaks into one, rad per rad.
    moving_ratio: float = 10.0  #: Changes over their own noise from which a channel moves.
    in_common: float = 0.5  #: Correlation and slope below which two changes have little in common.


CONTRADICTION = ContradictionSettings()


@dataclass(frozen=True)
class Contradiction:
    """A channel and those whose integral it is tell of two motions.

    `channel`, `against`: their names. `from_s`, `to_s`: first and last stretch in which they do, s of the
    log. `slope`: change of the channel per change that the others imply there: 1 where they agree.
    `evidence`: changes of the one that moves over the least that counts.
    """

    channel: str
    against: tuple[str, ...]
    from_s: float
    to_s: float
    slope: float
    evidence: float


def contradictions(trial: Trial, channels: Sequence[str]) -> tuple[Contradiction, ...]:
    """Contradictions between channels of a trial that judge a model, the one that explains others first."""
    contradicting = [
        contradiction
        for channel, rates in _INTEGRALS.items()
        if {channel, *rates} & set(channels)
        and (contradiction := _contradiction(trial, channel, rates)) is not None
    ]
    # A wrong angle turns the velocity as well, so that it contradicts the position: angles come first.
    return tuple(sorted(contradicting, key=lambda each: (len(each.against), -each.evidence)))


def _contradiction(trial: Trial, channel: str, rates: tuple[str, ...]) -> Contradiction | None:
    """Contradiction of a channel; None without one, or where it or one of the others is not in the log."""
    place = CHANNELS.index(channel)
    known = trial.valid[:, place]
    implied, rated = _implied_rate(trial, channel, rates)
    if known.sum() < CONTRADICTION.samples or rated.sum() < 2:
        return None
    t = trial.t
    values = trial.observed[known, place]
    values = np.unwrap(values) if channel in ("roll", "pitch", "yaw") else values
    position = np.interp(t, t[known], values)
    rate = np.interp(t, t[rated], implied[rated])
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t))])
    interval = float(np.median(np.diff(t[known])))
    step = max(round(max(CONTRADICTION.window_s, CONTRADICTION.samples * interval) / trial.dt), 1)
    begins = np.arange(0, len(t) - step, step)
    # A window across a gap of either would compare nothing with nothing.
    whole = _covered(known, begins, step) & _covered(rated, begins, step)
    change, expected = (series[begins + step] - series[begins] for series in (position, integral))
    noise = np.sqrt(2.0) * _noise(values)
    drift = _noise(implied[rated]) * np.sqrt(step) * trial.dt
    turned = np.concatenate([[0.0], np.cumsum(_turning(trial, channel, rates)[1:] * np.diff(t))])
    tolerated = (CONTRADICTION.arm_m if len(rates) > 1 else CONTRADICTION.leak) * (
        turned[begins + step] - turned[begins]
    )
    least = CONTRADICTION.moving_ratio * max(noise, drift)
    bad: list[tuple[int, float, float]] = []
    for first in range(0, len(begins) - CONTRADICTION.windows + 1, CONTRADICTION.windows // 2):
        rows = slice(first, first + CONTRADICTION.windows)
        if not whole[rows].all():
            continue
        a, b = change[rows] - change[rows].mean(), expected[rows] - expected[rows].mean()
        spread = float(np.std(a)), float(np.std(b))
        enough = max(least, float(np.sqrt(np.mean(tolerated[rows] ** 2))))
        if max(spread) <= enough:
            continue
        common = float(np.mean(a * b))
        # One that stands still beside one that moves has no correlation, and no slope on the one that moves.
        along = common / max(spread) ** 2
        together = common / (spread[0] * spread[1]) if min(spread) > 0.0 else 0.0
        if along < CONTRADICTION.in_common and together < CONTRADICTION.in_common:
            slope = common / spread[1] ** 2 if spread[1] > 0.0 else np.inf
            bad.append((first, slope, max(spread) / max(enough, 1e-12)))
    if not bad:
        return None
    last = min(bad[-1][0] + CONTRADICTION.windows - 1, len(begins) - 1)
    _, slopes, evidence = zip(*bad, strict=True)
    return Contradiction(
        channel=channel,
        against=rates,
        from_s=float(t[begins[bad[0][0]]]),
        to_s=float(t[begins[last] + step]),
        slope=float(np.median(slopes)),
        evidence=float(max(evidence)),
    )


def _implied_rate(trial: Trial, channel: str, rates: tuple[str, ...]) -> tuple[Array, Mask]:
    """Rate of a channel (n,) by those whose integral it is, and where it is known (n,); SI."""
    angles = ("roll", "pitch", "yaw") if channel != "z" else ("roll", "pitch")
    needed = [CHANNELS.index(name) for name in (*rates, *(angles if len(rates) > 1 else ()))]
    # Rates of Euler angles need the other two; without them the motion is near to level.
    known = np.asarray(trial.valid[:, needed].all(axis=1))
    motion = np.where(np.isfinite(trial.observed), trial.observed, 0.0)
    u_v_w, p_q_r, euler = motion[:, :3], motion[:, 3:6], motion[:, 9:]
    if len(rates) > 1:
        row = CHANNELS.index(channel) - 6
        return np.einsum("nj,nj->n", matrix(from_euler(euler))[:, row], u_v_w), known
    (p, q, r), (roll, pitch, _) = p_q_r.T, euler.T
    turning = q * np.sin(roll) + r * np.cos(roll)
    kinematics = {
        "roll": p + np.tan(pitch) * turning,
        "pitch": q * np.cos(roll) - r * np.sin(roll),
        "yaw": turning / np.maximum(np.cos(pitch), 0.1),
    }
    return kinematics[channel], known


def _turning(trial: Trial, channel: str, rates: tuple[str, ...]) -> Array:
    """Size of the turn rate (n,), rad/s, about axes that may disturb a channel: yaw does not change depth."""
    axes = ("p", "q") if channel == "z" else ("p", "q", "r")
    others = [CHANNELS.index(name) for name in axes if name not in rates]
    motion = np.where(np.isfinite(trial.observed[:, others]), trial.observed[:, others], 0.0)
    return np.asarray(np.linalg.norm(motion, axis=1))


def _covered(known: Mask, begins: NDArray[np.int_], step: int) -> Mask:
    """Whether each window holds some samples: a gap is longer than a window holds."""
    count = np.concatenate([[0], np.cumsum(known)])
    return np.asarray(count[begins + step] - count[begins] >= CONTRADICTION.samples - 1)


def _noise(y: Array) -> float:
    """Standard deviation of white noise on a series (n,), from its second differences."""
    if len(y) < 3:
        return 0.0
    # Three of four: a motion bends the series in some places more than its noise does.
    return float(np.quantile(np.abs(np.diff(y, 2)), 0.5) / (0.6745 * np.sqrt(6.0)))
