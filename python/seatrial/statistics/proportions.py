"""Failure probability p from k failures in n missions: estimate, exact interval, verdict.

Clopper & Pearson (1934, Biometrika 26:404): the bounds are those p at which k or fewer failures, or k or
more, would be as rare as alpha,

    sum_{i<=k} C(n,i) p_U^i (1-p_U)^(n-i) = alpha,    p_U = quantile 1-alpha of Beta(k+1, n-k)
    sum_{i>=k} C(n,i) p_L^i (1-p_L)^(n-i) = alpha,    p_L = quantile alpha of Beta(k, n-k+1)

alpha = 1 - confidence for a bound on one side, half of it for each side of an interval. Whatever p is, they
cover it at least as often as they say, for a number of missions that was fixed beforehand: who adds
missions until the verdict suits looks several times and errs more often. Look j at the risk alpha/2^j errs
with at most alpha over all looks (Bonferroni's inequality), so that the advice of an undecided verdict is
given at half the risk. With no failure p_U = 1 - alpha^(1/n), about 3/n at 95 %: the rule of three (Hanley
& Lippman-Hand 1983, JAMA 249:1743).

A verdict takes the bounds on one side: "held" where the upper one does not exceed what is allowed, "failed"
where the lower one does. The missions that a verdict needs at least are those of Wilks (1941, Ann. Math.
Stat. 12:91).

Held by `tests/statistics/test_failure_probability.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.arrays import Array
from seatrial.base.plain import Plain

Verdict = Literal["held", "failed", "undecided"]


@dataclass(frozen=True)
class ProportionSettings:
    """How the number of missions that a verdict needs is searched."""

    #: Quantiles of the failure probability that stand for its distribution.
    quantiles: int = 400
    #: Missions beyond which a verdict is not worth waiting for.
    most_missions: int = 10**9


SETTINGS = ProportionSettings()


def clopper_pearson(failures: ArrayLike, runs: ArrayLike, *, confidence: float = 0.95) -> tuple[Array, Array]:
    """Lower and upper end of the exact interval of a probability, half of the risk on each side.

    `failures`, `runs`: of one or many campaigns; 0 <= failures <= runs, runs > 0. `confidence`: share of
    campaigns whose interval holds the probability, at least.

    Examples
    --------
    >>> lower, upper = clopper_pearson(3, 2000)
    >>> print(f"{100 * lower:.2f} to {100 * upper:.2f} %")
    0.03 to 0.44 %
    """
    k, n = np.broadcast_arrays(np.asarray(failures, float), np.asarray(runs, float))
    _countable(k, n, confidence)
    return _bounds(k, n, 0.5 * (1.0 - confidence))


def wilson(failures: ArrayLike, runs: ArrayLike, *, confidence: float = 0.95) -> tuple[Array, Array]:
    """Ends of the score interval of Wilson (1927, JASA 22:209): covers on average, not always.

    It is shorter than the exact one and serves for error bars of many small groups; never for a verdict.
    """
    from scipy.special import ndtri

    k, n = np.broadcast_arrays(np.asarray(failures, float), np.asarray(runs, float))
    _countable(k, n, confidence)
    z = float(ndtri(0.5 * (1.0 + confidence)))
    p, part = k / n, z * z / n
    centre = (p + 0.5 * part) / (1.0 + part)
    half = z * np.sqrt(p * (1.0 - p) / n + 0.25 * part / n) / (1.0 + part)
    return np.where(k == 0, 0.0, centre - half), np.where(k == n, 1.0, centre + half)


@dataclass(frozen=True)
class FailureProbability(Plain, only="failures runs interval"):
    """Failure probability from ``failures`` in ``runs`` missions: interval and bounds at a ``confidence``.

    Raises
    ------
    ValueError
        More failures than runs, no run, or a confidence outside (0, 1).

    Examples
    --------
    >>> found = FailureProbability(3, 2000)
    >>> print(found)
    3 of 2000 missions failed: 0.15 % (0.03 to 0.44 %)
    >>> found.verdict(0.01), found.verdict(0.001)
    ('held', 'undecided')
    """

    failures: int
    runs: int
    confidence: float = 0.95

    def __post_init__(self) -> None:
        _countable(np.asarray(float(self.failures)), np.asarray(float(self.runs)), self.confidence)

    @property
    def estimate(self) -> float:
        """Share of the missions that failed."""
        return self.failures / self.runs

    @property
    def interval(self) -> tuple[float, float]:
        """Ends of the exact interval."""
        lower, upper = clopper_pearson(self.failures, self.runs, confidence=self.confidence)
        return float(lower), float(upper)

    @property
    def at_least(self) -> float:
        """Lower bound on one side: with this confidence the failure probability is not smaller."""
        return float(_bounds(self.failures, self.runs, 1.0 - self.confidence)[0])

    @property
    def at_most(self) -> float:
        """Upper bound on one side: with this confidence the failure probability is not larger."""
        return float(_bounds(self.failures, self.runs, 1.0 - self.confidence)[1])

    @property
    def looked_at_again(self) -> FailureProbability:
        """The same count at half the risk: what a further look at a growing number of missions may spend."""
        return replace(self, confidence=0.5 * (1.0 + self.confidence))

    def verdict(self, allowed: float) -> Verdict:
        """Held, failed or undecided against the allowed failure probability."""
        if self.at_most <= allowed:
            return "held"
        return "failed" if self.at_least > allowed else "undecided"

    def __str__(self) -> str:
        """Count, share and interval; without a failure the bound on one side and the rule of three."""
        counted = f"{self.failures} of {self.runs} missions failed"
        lower, upper = self.interval
        if self.failures == 0:
            rule = f", rule of three: 3/{self.runs}" if self.confidence == 0.95 and self.runs >= 30 else ""
            bound = share(self.at_most, "up")
            return f"{counted}: at most {bound} ({100.0 * self.confidence:g} % confidence{rule})"
        nearest = 100.0 * min(
            distance for distance in (self.estimate - lower, upper - self.estimate) if distance > 0.0
        )
        digits = max(0, 1 - math.floor(math.log10(nearest)))
        shown = [f"{100.0 * value:.{digits}f}" for value in (self.estimate, lower, upper)]
        return f"{counted}: {shown[0]} % ({shown[1]} to {shown[2]} %)"


def runs_needed(allowed: float, *, failures: int = 0, confidence: float = 0.95) -> int:
    """Least number of missions of which so many may fail and the requirement is still held.

    Examples
    --------
    >>> runs_needed(0.01), runs_needed(0.05, failures=1)
    (299, 93)
    """
    _open("allowed", allowed)
    _open("confidence", confidence)
    enough = failures + 1
    while _most_held(enough, allowed, confidence) < failures:
        enough *= 2
    short = enough // 2
    while enough - short > 1:
        middle = (enough + short) // 2
        if _most_held(middle, allowed, confidence) >= failures:
            enough = middle
        else:
            short = middle
    return enough


def further_runs(estimate: FailureProbability, allowed: float, *, chance: float = 0.8) -> int | None:
    """Number of further missions that decide with this chance whether it is held, zero if it is decided.

    They are a further look at what was flown, so that they are judged at half the risk.
    The failures to come are foretold from those seen (Jeffreys' prior, Beta(k + 1/2, n - k + 1/2)): the share
    itself is not known, and where it is close to the allowed one many missions are needed.

    None if a billion missions do not.
    """
    from scipy.stats import beta

    _open("allowed", allowed)
    _open("chance", chance)
    if estimate.verdict(allowed) != "undecided":
        return 0
    estimate = estimate.looked_at_again
    ranks = (np.arange(SETTINGS.quantiles) + 0.5) / SETTINGS.quantiles
    likely = beta.ppf(ranks, estimate.failures + 0.5, estimate.runs - estimate.failures + 0.5)

    def decides(more: int) -> bool:
        return _chance(estimate, likely, more, allowed) >= chance

    enough = max(16, estimate.runs // 8)
    while not decides(enough):
        enough *= 2
        if enough > SETTINGS.most_missions:
            return None
    short = enough // 2
    # The chance rises in small teeth: two figures are all that is meant.
    while enough - short > max(1, enough // 50):
        middle = (enough + short) // 2
        if decides(middle):
            enough = middle
        else:
            short = middle
    return enough


def share(probability: float, towards: Literal["nearest", "up", "down"] = "nearest") -> str:
    """A probability in per cent with two figures, a bound rounded to its safe side.

    Examples
    --------
    >>> share(0.0014967), share(0.01), share(0.01003, "up"), share(0.9985)
    ('0.15 %', '1 %', '1.1 %', '99.85 %')
    """
    percent = 100.0 * probability
    small = min(percent, 100.0 - percent)
    if small <= 0.0:
        return f"{percent:.0f} %"
    digits = max(0, 1 - math.floor(math.log10(small)))
    scaled = percent * 10.0**digits
    # A hair of rounding in the bound itself is no reason for another digit.
    rounded = {"nearest": round(scaled), "up": math.ceil(scaled - 1e-6), "down": math.floor(scaled + 1e-6)}
    text = f"{rounded[towards] / 10.0**digits:.{digits}f}"
    return f"{text.rstrip('0').rstrip('.') if '.' in text else text} %"


def _bounds(failures: ArrayLike, runs: ArrayLike, risk: float) -> tuple[Array, Array]:
    """Lower and upper bound, each with this risk."""
    from scipy.stats import beta

    k, n = np.asarray(failures, float), np.asarray(runs, float)
    with np.errstate(invalid="ignore"):
        lower = np.where(k == 0, 0.0, beta.ppf(risk, k, n - k + 1.0))
        upper = np.where(k == n, 1.0, beta.isf(risk, k + 1.0, n - k))
    return lower, upper


def _chance(estimate: FailureProbability, likely: Array, more: int, allowed: float) -> float:
    """Chance that so many more missions decide, the mean over the likely shares."""
    from scipy.stats import binom

    total = estimate.runs + more
    good = _most_held(total, allowed, estimate.confidence) - estimate.failures
    bad = int(binom.isf(1.0 - estimate.confidence, total, allowed)) + 1 - estimate.failures
    return float(np.mean(binom.cdf(good, more, likely) + binom.sf(bad - 1, more, likely)))


def _most_held(runs: int, allowed: float, confidence: float) -> int:
    """Most failures with which it is held, -1 if none: P(failures or fewer | allowed) <= 1 - confidence."""
    from scipy.stats import binom

    least = int(binom.ppf(1.0 - confidence, runs, allowed))
    rare = bool(binom.cdf(least, runs, allowed) <= 1.0 - confidence)
    return least if rare else least - 1


def _countable(failures: Array, runs: Array, confidence: float) -> None:
    _open("confidence", confidence)
    if np.any(runs < 1.0) or np.any(failures < 0.0) or np.any(failures > runs):
        raise ValueError(
            f"expected at least one run and between none and all of them failed, found {failures} of {runs}"
        )


def _open(name: str, value: float) -> None:
    if not 0.0 < value < 1.0:
        raise ValueError(f"{name}: expected a number above 0 and below 1, found {value:g}")
