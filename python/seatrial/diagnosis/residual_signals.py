"""Memory of the residuals of a joint estimate, and signals that they follow.

A model inside its class leaves the sensors' noise; a missing term leaves a residual that remembers: its
autocorrelation, and blocks long enough to count as independent (Box & Jenkins 1970; Ljung & Box 1978).

The residual of each velocity is regressed on products of states, commands and time, taken as they are (what a
sensor does: a lever, a scale, a late channel) and through a first-order lag (what a force does). Every column
is tested beside all that is fitted (`seatrial.statistics.significance`), at a false discovery rate over all
channels, signals and lags.

Tests: ``tests/diagnosis/test_residual_analysis.py``.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES, VELOCITIES
from seatrial.base.finding import Finding, Severity
from seatrial.base.plain import Plain
from seatrial.base.report import sentence_of
from seatrial.statistics.blocks import autocorrelation
from seatrial.statistics.linearisation import Linearisation, Piece
from seatrial.statistics.significance import (
    ScoreTests,
    SingleTests,
    false_discovery,
    score_tests,
    single_tests,
)

if TYPE_CHECKING:
    from seatrial.trial.trial import Trial


@dataclass(frozen=True)
class SignalSettings:
    """Which lags are tested, and how long independent blocks are."""

    #: Lags through which signals are tried, s: 0 is the signal itself, infinity its integral.
    lags_s: tuple[float, ...] = (0.0, 2.0, 10.0, math.inf)
    #: Longest lag of an autocorrelation, s.
    longest_s: float = 10.0
    #: Lags whose correlations are tested together.
    lags_tested: int = 20
    #: Correlation times of a block: four are almost independent, exp(-4) is 2 %.
    block: float = 4.0
    #: Shortest block, s, however white the residuals are.
    shortest_s: float = 2.0
    #: Blocks at least: 24 tell a standard deviation to 15 %.
    fewest_blocks: int = 24
    #: Blocks at most: 240 tell a standard deviation to 5 %.
    most_blocks: int = 240


SETTINGS = SignalSettings()


_LEVERS = {
    ("u", "q"): "z",
    ("u", "r"): "y",
    ("v", "p"): "z",
    ("v", "r"): "x",
    ("w", "p"): "y",
    ("w", "q"): "x",
}


_CONSTANT = "a constant"

Status = Literal["estimated", "held", "unknown"]


@dataclass(frozen=True)
class FollowedSignal(Plain, without="coefficient status", also="sentence"):
    """A signal that a channel's residual follows."""

    #: Names.
    channel: str
    signal: str
    #: Lag between them, s: 0 for what a sensor does, infinite for an integral.
    lag_s: float
    #: Share of the channel's squared residual that it explains beside all that is fitted.
    r2: float
    #: P-value adjusted for all signals, lags and channels.
    p: float
    #: The one that has this form, and whether it is "estimated", "held" or "unknown" to the vehicle.
    coefficient: str
    status: Status

    @property
    def lever(self) -> str:
        """Axis of the sensor's lever that shows in this way; "" where none does."""
        return _LEVERS.get((self.channel, self.signal), "")

    @property
    def sentence(self) -> str:
        """What it means and what to do."""
        finding = Finding("signal followed", Severity.WEAKNESS, self.channel, {"signal": self})
        return sentence_of(finding, "diagnosis")


def with_predicted_velocity(lin: Linearisation, trials: Mapping[str, Trial]) -> Linearisation:
    """The linearisation with the model's own velocity in the channels that it shows: a measured one carries
    the noise of the very sensor whose residual is to follow it.
    """
    pieces = []
    for piece in lin.pieces:
        observed, nu = trials[piece.trial].observed[_samples(piece, trials)], piece.nu.copy()
        for place, channel in enumerate(lin.channels):
            if channel in VELOCITIES:
                axis = VELOCITIES.index(channel)
                shown = observed[:, axis] - lin.noise[place] * piece.residual[:, place]
                nu[:, axis] = np.where(piece.counted[:, place], shown, nu[:, axis])
        pieces.append(replace(piece, nu=nu))
    return replace(lin, pieces=tuple(pieces))


def motion_signals(lin: Linearisation) -> dict[str, list[Array]]:
    """Per name the signal (n,) of each segment: velocities, their rates, moduli and products, SI."""
    nu = [piece.nu for piece in lin.pieces]
    signals = {_CONSTANT: [np.ones(len(velocities)) for velocities in nu]}
    for i, name in enumerate(VELOCITIES):
        signals[name] = [velocities[:, i] for velocities in nu]
        signals[f"|{name}| {name}"] = [np.abs(velocities[:, i]) * velocities[:, i] for velocities in nu]
        signals[f"d{name}/dt"] = [np.gradient(velocities[:, i], lin.dt) for velocities in nu]
    for i, j in combinations(range(len(VELOCITIES)), 2):
        signals[f"{VELOCITIES[i]} {VELOCITIES[j]}"] = [
            velocities[:, i] * velocities[:, j] for velocities in nu
        ]
    return signals


def recorded_signals(lin: Linearisation, trials: Mapping[str, Trial]) -> dict[str, list[Array]]:
    """Per name the signal (n,) of each segment about its mean, zero where not recorded: commands, recorded
    wrench, voltage and time.
    """
    raw: dict[str, dict[int, Array]] = {}
    for index, piece in enumerate(lin.pieces):
        trial = trials[piece.trial]
        at = _samples(piece, trials)
        own = {f"command {name}": signal for name, signal in trial.commands.items()}
        if trial.tau is not None:
            own |= {
                f"wrench {axis}": force
                for axis, force in zip(AXES, trial.tau.T, strict=True)
                if np.ptp(force)
            }
        if trial.voltage_v is not None:
            own["voltage"] = trial.voltage_v
        own["time"] = trial.t - trial.t.mean()
        for name, signal in own.items():
            raw.setdefault(name, {})[index] = signal[at]
    levelled = {}
    for name, recorded in raw.items():
        signals = [recorded.get(index, np.full(len(p.t), np.nan)) for index, p in enumerate(lin.pieces)]
        level = float(np.nanmean(np.concatenate(signals)))
        levelled[name] = [np.nan_to_num(signal - level) for signal in signals]
    return levelled


def followed_signals(
    lin: Linearisation,
    signals: Mapping[str, Sequence[Array]],
    *,
    fitted: Sequence[int],
    block: Sequence[NDArray[np.intp]],
    known: Collection[str] = (),
    level: float = 0.05,
    least_r2: float = 0.02,
    most: int = 2,
) -> tuple[FollowedSignal, ...]:
    """Signals that the residuals follow, the one that explains most of its channel first. ``signals``: (n,)
    per segment. ``fitted``: places of the fitted unknowns. ``block`` (n,) per segment. ``known``:
    coefficients of the vehicle. ``level``: false discovery rate. ``least_r2``: share of the channel's squared
    residual at least. ``most`` per channel.
    """
    tests: dict[str, SingleTests | ScoreTests] = {}
    labels = [(name, lag) for lag in SETTINGS.lags_s for name in signals]
    columns: dict[str, list[Array]] = {}
    for channel in (channel for channel in lin.channels if channel in VELOCITIES):
        place = lin.channels.index(channel)
        alike = (c for c in columns if _counted_alike(lin, place, lin.channels.index(c)))
        like = next(alike, None)
        columns[channel] = _columns(lin, signals, place) if like is None else columns[like]
        tests[channel] = single_tests(lin, columns[channel], fitted=fitted, block=block, channel=place)
    # The false discovery rate counts all columns of all channels; each leader then counts as fitted.
    count = sum(int(test.testable.sum()) for test in tests.values())
    power = _power(lin)
    estimated = {lin.unknowns[i].name for i in fitted}
    followed: list[FollowedSignal] = []
    open_ = {channel: test.testable.copy() for channel, test in tests.items()}
    for _ in range(most):
        leaders = _leaders(tests, open_, power=power, count=count, level=level, least_r2=least_r2)
        for channel, (place, r2, p) in leaders.items():
            test = tests[channel]
            if isinstance(test, SingleTests):
                test = score_tests(
                    lin, columns[channel], fitted=fitted, block=block, channel=lin.channels.index(channel)
                )
            name, lag = labels[place]
            own = _coefficient(channel, name)
            status: Status = "estimated" if own in estimated else "held" if own in known else "unknown"
            followed.append(FollowedSignal(channel, name, lag, r2, p, own, status))
            open_[channel] &= np.array([label[0] != name for label in labels])
            tests[channel] = test.beside(place)
    return tuple(sorted(followed, key=lambda signal: -signal.r2))


def _leaders(
    tests: Mapping[str, SingleTests | ScoreTests],
    open_: Mapping[str, NDArray[np.bool_]],
    *,
    power: Mapping[str, float],
    count: int,
    level: float,
    least_r2: float,
) -> dict[str, tuple[int, float, float]]:
    """Per channel the place, R2 and adjusted p of the significant column that explains most."""
    results = {channel: test.results() for channel, test in tests.items()}
    joined = np.concatenate([results[channel].p[open_[channel]] for channel in tests] or [np.zeros(0)])
    adjusted, at = false_discovery(joined, count), 0
    leaders = {}
    for channel, test in tests.items():
        p = np.ones(len(open_[channel]))
        size = int(open_[channel].sum())
        p[open_[channel]], at = adjusted[at : at + size], at + size
        r2 = results[channel].gain * test.cost / power[channel]
        good = (p < level) & (r2 >= least_r2)
        if good.any():
            place = int(np.argmax(np.where(good, r2, 0.0)))
            leaders[channel] = (place, float(r2[place]), float(p[place]))
    return leaders


def _counted_alike(lin: Linearisation, first: int, other: int) -> bool:
    """Whether the same samples count in two channels, so that both would show the same of a signal."""
    return all(np.array_equal(piece.counted[:, first], piece.counted[:, other]) for piece in lin.pieces)


def _columns(lin: Linearisation, signals: Mapping[str, Sequence[Array]], place: int) -> list[Array]:
    """What a channel would show (n, 1, k) of the signals behind each of the lags, per segment."""
    columns = []
    for index, piece in enumerate(lin.pieces):
        counted = piece.counted[:, place]
        values = np.stack([np.asarray(of[index], dtype=float) for of in signals.values()], axis=1)
        shown = [_lagged(values, lag, lin.dt, counted) if lag > 0.0 else values for lag in SETTINGS.lags_s]
        columns.append(np.where(counted[:, None], np.concatenate(shown, axis=1), 0.0)[:, None, :])
    return columns


def _lagged(signal: Array, lag: float, dt: float, counted: NDArray[np.bool_]) -> Array:
    """Signals (n, k) through a first-order lag, without the decay from any initial value, which is free."""
    from scipy.signal import lfilter

    kept = math.exp(-dt / lag)
    driven = np.zeros_like(signal)
    driven[1:] = 0.5 * dt * (signal[1:] + signal[:-1])
    response = lfilter([1.0], [1.0, -kept], driven, axis=0)
    decay = kept ** np.arange(len(signal))
    size = float(decay[counted] @ decay[counted])
    if size > 0.0:
        response = response - np.outer(decay, decay[counted] @ response[counted] / size)
    return np.asarray(response)


def _samples(piece: Piece, trials: Mapping[str, Trial]) -> NDArray[np.intp]:
    """Places of a segment's samples in its trial."""
    trial = trials[piece.trial]
    places = np.round((piece.t - trial.t[0]) / trial.dt).astype(np.intp)
    return np.asarray(np.clip(places, 0, len(trial.t) - 1), dtype=np.intp)


def _power(lin: Linearisation) -> dict[str, float]:
    """Weighted sum of the squared residual per channel."""
    total = np.sum([(p.weight * p.counted * p.residual**2).sum(axis=0) for p in lin.pieces], axis=0)
    return {channel: max(float(value), 1e-300) for channel, value in zip(lin.channels, total, strict=True)}


def _coefficient(channel: str, signal: str) -> str:
    """Coefficient that multiplies a signal of the motion in the force that drives a channel."""
    axis, letters = AXES[VELOCITIES.index(channel)], "".join(signal.replace("|", "").split())
    if signal.startswith("d"):
        return f"{axis}_{signal[1]}dot"
    return f"{axis}_{'0' if signal == _CONSTANT else letters}"


@dataclass(frozen=True)
class Autocorrelation(Plain, without="effective", also="effective_samples=effective excess"):
    """Autocorrelation of one channel's residual, pooled over the trials."""

    #: Its name.
    channel: str
    #: Lags in s and autocorrelations, both (lags,), from one sample on.
    lag_s: Array
    rho: Array
    #: White residuals stay within plus and minus this in 95 of 100 lags: ``1.96 / sqrt(samples)``.
    band: float
    #: Share of the lags outside the band; 0.05 for white residuals.
    outside: float
    #: Probability that white residuals correlate as much (Ljung-Box over the first lags).
    p: float
    #: Samples that count, and how many independent ones they are worth.
    samples: int
    effective: float
    #: Correlation time, s.
    correlation_s: float
    #: Root mean square of the residual, SI.
    rms: float
    #: Noise of the sensor, SI: as given, otherwise the white part of the residual (second differences).
    noise: float

    @property
    def excess(self) -> float:
        """Residual over noise: 1 where the model leaves nothing but the sensor's noise."""
        return self.rms / self.noise if self.noise > 0.0 else float("inf")


def autocorrelations(
    lin: Linearisation,
    *,
    longest_s: float = SETTINGS.longest_s,
    sensor_noise: Mapping[str, float] | None = None,
) -> tuple[Autocorrelation, ...]:
    """Autocorrelation of the residual of every channel that has samples, as the robust loss weighs them, up
    to ``longest_s`` or a quarter of the data. ``sensor_noise``: SI by channel, where it is known.
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
    """Length in s of blocks that are as good as independent: four times the longest correlation time, at
    least two seconds, and such that there are between two dozen blocks and ten times as many.

    >>> block_length((), 1200.0)
    5.0
    """
    memory = max((correlation.correlation_s for correlation in correlations), default=0.0)
    shortest = max(SETTINGS.shortest_s, duration_s / SETTINGS.most_blocks)
    return float(max(shortest, min(SETTINGS.block * memory, duration_s / SETTINGS.fewest_blocks)))


def block_numbers(lin: Linearisation, length_s: float) -> list[NDArray[np.intp]]:
    """Block of each sample per segment (n,), from 0 on: equally long in a trial, across its segments."""
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
        weighted = np.where(mask, piece.weight[:, column] * piece.residual[:, column], 0.0)
        power, samples = power + float(weighted @ weighted), samples + int(mask.sum())
        # White noise has six times its power in second differences; smooth errors have next to none.
        bend = (weighted[:-2] - 2.0 * weighted[1:-1] + weighted[2:])[mask[:-2] & mask[1:-1] & mask[2:]]
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
    lags = np.arange(1, min(SETTINGS.lags_tested, len(rho), samples - 1) + 1)
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
