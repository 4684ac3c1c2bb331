"""How far a valid model may miss a log: the spread of its predictions beside that of the coefficients.

A model predicts no better than it did where it was known to hold: sensors err, the state at a restart errs
with them, the water moves, and every model leaves something out. Where that is known from

| source | spread of a channel at time t since the restart |
|---|---|
| logs on which the model is known to hold | rms there, at least the 95 % quantile of the error over 1.96 |
| an error per channel, as of `score` | ``rms sqrt(1/2 + t/T)``: half constant, half a random walk |
| nothing but the log itself | noise n of the first moments after a restart, and what it does to a start |

it is that; in the last case ``s^2 = n^2 + sum_k (dy/dx0_k n_k)^2`` has no room for what every model leaves
out, so that it suits generated logs and very good models, and says so.

*Worth of a share.* Neighbouring samples err alike, so a window is a cluster. The share x of all samples has
the variance of the windows' sums (ratio estimator), widened where neighbouring windows correlate by r > 0,
and is worth

    n* = x (1 - x) / var(x) (t_{n-1} / t_{B-1})^2

independent samples: at least one per window (fewer where they correlate), at most n. The interval of 95 % is
Clopper and Pearson's with these. Source: Korn & Graubard (1998), Survey Methodology 24:193; the ratio
estimator as in Cochran, *Sampling Techniques* (1977), chapter 9.

*Chance of a share.* Of a valid model a share x of the samples lies outside the 95 % band: 5 % of them, or
more where the vehicle has coefficients, or the sensors offsets, that their covariance allows. With x_j the
share of draw j of K, a share of h/n* of n* independent samples has the predictive p-value (Box 1980, JRSS A
143:383)

    p = (1 + sum_j P(X >= h | n*, x_j)) / (1 + K),

X binomial, x_j at least 5 %. The ones are what K draws cannot tell: a vehicle further out than all of them
is possible, and p is never smaller than 1/(1 + K) (Davison & Hinkley 1997, *Bootstrap Methods*, section
4.2). Where the 5 % themselves rest on a reference worth n_r samples, x_j is Beta(n_r x_j, n_r (1 - x_j)).

Tests: ``tests/verification/test_recorded_validity.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.base.channels import CHANNELS
from seatrial.base.errors import TrialError, nearest
from seatrial.verification.mission_log.restarts import PredictedLog


def clustered_share(outside: Sequence[NDArray[np.bool_]]) -> tuple[float, int, float]:
    """Share of true samples, number of samples, and how many independent ones they are worth.

    `outside`: a mask (n,) per window.

    Examples
    --------
    >>> whole = [np.full(100, window % 20 == 0) for window in range(200)]
    >>> share, samples, worth = clustered_share(whole)
    >>> share, samples, round(worth)
    (0.05, 20000, 200)
    """
    from scipy.stats import t as student

    sizes = np.array([len(one) for one in outside], dtype=float)
    hits = np.array([one.sum() for one in outside], dtype=float)[sizes > 0]
    sizes = sizes[sizes > 0]
    n, count = float(sizes.sum()), len(sizes)
    if count < 2:
        return float(hits.sum() / max(n, 1.0)), int(n), float(count)
    share = float(hits.sum() / n)
    away = hits - share * sizes
    variance = count / (count - 1.0) * float(away @ away) / n**2
    # Windows that follow one another may err alike; the correlation of neighbours widens the variance.
    r = float(away[1:] @ away[:-1]) / max(float(away @ away), 1e-300)
    r = min(max(r, 0.0), 0.9)
    variance *= (1.0 + r) / (1.0 - r)
    least = count * (1.0 - r) / (1.0 + r)
    if variance <= 0.0:
        return share, int(n), least
    ratio = student.ppf(0.975, n - 1.0) / student.ppf(0.975, count - 1.0)
    return share, int(n), float(np.clip(share * (1.0 - share) / variance * ratio**2, least, n))


def share_interval(share: float, effective: float) -> tuple[float, float]:
    """Interval of 95 % about a share of so many independent samples, which need be no whole number.

    Examples
    --------
    >>> low, high = share_interval(0.05, 100.0)
    >>> round(low, 3), round(high, 3)
    (0.016, 0.113)
    """
    from scipy.special import betaincinv

    hits, rest = share * effective, (1.0 - share) * effective
    low = float(betaincinv(hits, rest + 1.0, 0.025)) if hits > 0.0 else 0.0
    high = float(betaincinv(hits + 1.0, rest, 0.975)) if rest > 0.0 else 1.0
    return low, high


_BINS = 12  # of the time since a restart

_NORMAL_95 = 1.959964  # quantile of the normal distribution

INITIAL_PLACES = (6, 7, 8, 9, 10, 11, 0, 1, 2, 3, 4, 5)
"""Channel of every initial condition in the core's order: position, attitude, velocity."""


@dataclass(frozen=True, eq=False)
class Spread:
    """Standard deviation of a valid model's errors by the time since a restart.

    Attributes
    ----------
    since_s, sigma
        Times (b,) in s, and the spread of each of `CHANNELS` there, (b, 12), SI; infinite where unknown.
    noise
        The same in the first moments after a restart, (12,), SI.
    windows
        How many windows it rests on.
    source
        Where it comes from, in words.
    effective
        How many independent samples each channel rests on, (12,); infinite where it is taken for known.
    """

    since_s: Array
    sigma: Array
    noise: Array
    windows: int
    source: str
    effective: Array = field(default_factory=lambda: np.full(12, np.inf))

    def at(self, since_s: Array) -> Array:
        """Spread (n, 12) at times (n,) since a restart, SI."""
        columns = [np.interp(since_s, self.since_s, column) for column in self.sigma.T]
        return np.stack(columns, axis=1)

    @property
    def factor(self) -> float:
        """Half-width of the 95 % band in units of the spread: Student's, for as few windows as there are."""
        from scipy.stats import t as student

        return float(student.ppf(0.975, max(self.windows - 1, 2)))


def spread_of_reference(references: Sequence[PredictedLog]) -> Spread:
    """Spread over logs on which the model is known to hold, (b, 12), SI.

    Raises
    ------
    TrialError
        There is no log, or fewer than six windows.
    """
    count = sum(len(one.spans) for one in references)
    if count < 6:
        raise TrialError(
            f"reference: expected logs of at least six windows on which the model is known to hold, found"
            f" {count}; give a longer log, or leave it out"
        )
    since = np.concatenate([one.since_restart(w) for one in references for w in range(len(one.spans))])
    error = np.concatenate([part for one in references for part in one.residual])
    counted = np.concatenate([part for one in references for part in one.counted])
    edges = np.linspace(0.0, since.max() + 1e-9, _BINS + 1)
    sigma = np.full((_BINS, 12), np.inf)
    for b in range(_BINS):
        rows = (since >= edges[b]) & (since < edges[b + 1])
        for c in range(12):
            sizes = np.abs(error[rows, c][counted[rows, c]])
            if len(sizes):
                tail = float(np.quantile(sizes, 0.95)) / _NORMAL_95
                sigma[b, c] = max(float(np.sqrt(np.mean(sizes**2))), tail)
    centres = 0.5 * (edges[1:] + edges[:-1])
    for c in range(12):  # a slow log, or fixes now and then, leave bins empty
        here = np.isfinite(sigma[:, c])
        if here.any():
            sigma[:, c] = np.interp(centres, centres[here], sigma[here, c])
    noise = _noise(references)
    names = ", ".join(dict.fromkeys(one.trial.name for one in references))
    found = Spread(centres, sigma, noise, count, f"the model's errors on {names} ({count} windows)")
    return replace(found, effective=_worth(references, found))


def spread_of_errors(rms: Mapping[str, float], log: PredictedLog, source: str = "the errors given") -> Spread:
    """Spread (b, 12) from a root mean square error per channel over windows of the same length, SI.

    Raises
    ------
    TrialError
        A channel is unknown or its error no positive number.
    """
    for name, value in rms.items():
        if name not in CHANNELS:
            raise TrialError(f'reference: "{name}" is no channel{nearest(name, CHANNELS)}')
        if not (np.isfinite(value) and value > 0.0):
            raise TrialError(f"reference: {name}: expected a positive error in SI, found {value!r}")
    longest = max(log.since_restart(w)[-1] for w in range(len(log.spans)))
    share = np.linspace(0.0, 1.0, _BINS)
    level = np.array([rms.get(name, np.inf) for name in CHANNELS])
    sigma = np.where(np.isfinite(level), level, np.inf) * np.sqrt(0.5 + share)[:, None]
    return Spread(longest * share, sigma, np.minimum(_noise([log]), sigma[0]), 1_000_000, source)


def spread_of_noise(log: PredictedLog) -> Spread:
    """Spread (b, 12) from the log's own noise and what it does to the state at a restart, SI."""
    noise = _noise([log])
    slopes = log.slopes([])
    width = max(len(one.by_start) for one in slopes)
    total, seen = np.zeros((width, 12)), np.zeros((width, 1))
    start = np.nan_to_num(noise[list(INITIAL_PLACES)])
    for one in slopes:
        with np.errstate(over="ignore"):  # an unstable model forgets its start the other way round
            total[: len(one.by_start)] += ((one.by_start * start) ** 2).sum(axis=2)
        seen[: len(one.by_start)] += 1.0
    variance = total / np.maximum(seen, 1.0)
    since = np.arange(width) * log.trial.dt
    keep = np.unique(np.linspace(0, width - 1, 4 * _BINS).astype(int))
    sigma = np.sqrt(noise**2 + variance[keep])
    sigma[:, ~np.isfinite(noise)] = np.inf
    source = "the log's own noise alone, without room for the usual error of a valid model"
    return Spread(since[keep], sigma, noise, len(log.spans), source)


def _worth(references: Sequence[PredictedLog], spread: Spread) -> Array:
    """How many independent samples (12,) the tail of each channel rests on."""
    found = np.full(12, np.inf)
    bands = [
        _NORMAL_95 * spread.at(one.since_restart(w)) for one in references for w in range(len(one.spans))
    ]
    errors = [error for one in references for error in one.residual]
    masks = [mask for one in references for mask in one.counted]
    for c in np.flatnonzero(np.isfinite(spread.sigma).all(axis=0)):
        found[c] = clustered_share([
            (np.abs(e[:, c]) > b[:, c])[m[:, c]] for e, b, m in zip(errors, bands, masks, strict=True)
        ])[2]
    return found


def _noise(logs: Sequence[PredictedLog]) -> Array:
    """Root mean square (12,) of the errors in the first moments after a restart; infinite without any."""
    squares, samples = np.zeros(12), np.zeros(12)
    for log in logs:
        # In the first half second no model error has had the time to show: what is seen is noise.
        rows = max(2, 1 + round(0.5 / log.trial.dt))
        for error, mask in zip(log.residual, log.counted, strict=True):
            squares += (error[:rows] ** 2).sum(axis=0)
            samples += mask[:rows].sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        noise = np.sqrt(squares / samples)
    # A channel that repeats exactly has the noise of its last digit, which is not nothing.
    return np.where(samples > 0, np.maximum(noise, 1e-6), np.inf)


NOMINAL = 0.05
"""Share of a valid model's samples outside a band of 95 %."""

LEAST_SHARE = 0.10
"""Share of a channel outside the band below which nothing is called wrong."""

_GRID = 32  # shares at which the tail is computed; between them it is nearly straight

_BETA = 64  # quantiles that stand for the distribution of a share


@dataclass(frozen=True, eq=False)
class ExpectedShare:
    """Shares (m,) that a valid model may leave outside, with their weights (m,), from so many draws."""

    shares: Array
    weights: Array
    draws: int

    @classmethod
    def of(cls, shares: Array | None, rests_on: float) -> ExpectedShare:
        """Expected share by draw (k,), nominal without draws, known from so many independent samples.

        `rests_on` is infinite where the nominal share is known.

        Examples
        --------
        >>> known = ExpectedShare.of(None, float("inf"))
        >>> round(known.p(0.2, 40.0), 4)
        0.0007
        """
        from scipy.special import betaincinv

        x = np.maximum(np.full(1, NOMINAL) if shares is None else shares, NOMINAL)
        grid: Array = np.geomspace(NOMINAL, max(float(x.max()), 1.01 * NOMINAL), _GRID)
        grid = np.minimum(grid, 1.0 - 1e-9)
        # The tail rises with x ever faster: to the neighbours on the grid is to the safe side.
        place = np.clip(np.searchsorted(grid, x, side="right") - 1, 0, _GRID - 2)
        part = np.clip((x - grid[place]) / (grid[place + 1] - grid[place]), 0.0, 1.0)
        low, high = np.bincount(place, 1.0 - part, _GRID), np.bincount(place + 1, part, _GRID)
        weights = np.asarray(low + high, dtype=float)
        held = weights > 0.0
        grid, weights = grid[held], weights[held] / len(x)
        if np.isfinite(rests_on):
            rank = (np.arange(_BETA) + 0.5) / _BETA
            spread = betaincinv(rests_on * grid[:, None], rests_on * (1.0 - grid[:, None]), rank)
            grid, weights = spread.ravel(), np.repeat(weights / _BETA, _BETA)
        return cls(grid, weights, 0 if shares is None else len(x))

    def p(self, share: float, effective: float) -> float:
        """P-value of a share outside of effectively so many independent samples."""
        from scipy.special import betainc

        hits = share * effective
        if hits <= 0.0:
            return 1.0
        tail = float(self.weights @ betainc(hits, effective - hits + 1.0, self.shares))
        return (1.0 + self.draws * tail) / (1.0 + self.draws) if self.draws else tail
