r"""Subset simulation: probability of a rare failure from few evaluations.

With a level function y(x, s) that is zero or less where something fails, x standard normal, the
probability is a product of likely ones:

    P(y <= 0) = P(y <= b_1) P(y <= b_2 | y <= b_1) ... P(y <= 0 | y <= b_m),

each level the tenth part of the one before (Au & Beck 2001, *Probabilistic Engineering Mechanics* 16:263).
The samples below a level are continued as Markov chains that keep the distribution inside it: conditional
sampling, x' = sqrt(1 - d^2) x + d z with z standard normal, its spread d led to an acceptance of 44 %
(Papaioannou, Betz, Zwirglmaier & Straub 2015, ibid. 41:89). Where not every x is possible, such a step stays
where it is.

The seed s of noise has no neighbourhood. It is drawn anew in a quarter of the steps and kept in the others,
which leaves its distribution as it is too.

**Interval** Several populations run from independent starts. The relative variance of one is
``sum_l (1 - p_l) / (p_l n) (1 + gamma_l)`` with the correlation gamma of its chains (Au & Beck, eq. 28); it
leaves out that levels depend on one another, for which the standard deviation is multiplied by 1.25. It is
no smaller than what the scatter of the populations says. The logarithm of the estimate is taken as normal.
How often such intervals hold a known probability stands in ``docs/validation.md``.

**Importance sampling** checks it: the failing samples of the last level are gathered about up to four
centres, and normal densities of unit covariance there are sampled independently.

Tests: ``tests/statistics/test_subset_simulation.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.base.plain import Plain

Level = Callable[[Array, Array], Array]
"""Level (k,) of samples (k, d), standard normal, and seeds (k,) from 0 to 1: zero or less where they fail."""


@dataclass(frozen=True)
class SubsetSettings:
    """How subset simulation walks from level to level, and how importance sampling checks it."""

    #: Share of a level's samples that is below the next level.
    level_share: float = 0.1
    #: Share of accepted steps that the spread of a chain is led to (Papaioannou et al.).
    accepted_share: float = 0.44
    #: Spread of the first steps.
    first_spread: float = 0.6
    #: Share of the steps that draw the noise anew.
    new_noise_share: float = 0.25
    #: Most levels, down to a probability of 1e-9: no model of a vehicle is as sure.
    most_levels: int = 9
    #: Factor on the standard deviation, for levels that depend on one another (at the head).
    between_levels: float = 1.25
    #: Share of a level's samples at or below the next one from which the levels stand still.
    still_share: float = 0.5
    #: Rounds of a first sample that must be possible.
    possible_rounds: int = 1000
    #: Most densities of the importance sampling.
    most_centres: int = 4
    #: Deviations between centres below which two are one region.
    centres_apart: float = 3.0
    #: Effective samples below which the check is too uncertain to disagree.
    least_effective: float = 100.0


SETTINGS = SubsetSettings()


@dataclass(frozen=True, eq=False)
class Population(Plain, only="estimate evaluations thresholds"):
    """One run of subset simulation.

    Attributes
    ----------
    estimate
        Probability of failure; 0 where the levels ended above zero.
    relative_variance
        Of the estimate, without what the levels have in common.
    evaluations
        Of the level function.
    thresholds
        Levels that were passed on the way, falling.
    samples, seeds
        Those of the last level that fail, (k, d) and (k,).
    stood_still
        Whether the levels ended because half of the samples or more share one value.
    reached
        Probability of the lowest level that was reached: failures are rarer where none was found.
    """

    estimate: float
    relative_variance: float
    evaluations: int
    thresholds: tuple[float, ...]
    samples: Array
    seeds: Array
    stood_still: bool = False
    reached: float = 1.0


def population(
    level: Level,
    dimensions: int,
    size: int,
    generator: np.random.Generator,
    *,
    possible: Callable[[Array], NDArray[np.bool_]] | None = None,
    watch: Callable[[int, float], None] | None = None,
) -> Population:
    """One population of subset simulation.

    `level`: zero or less where a sample (k, d) with seeds (k,) fails; not a number counts as failed.
    `dimensions`: d. `size`: samples of a level, a multiple of ten. `possible`: which samples (k, d) can be;
    all when omitted. `watch`: called with the number of a level and the largest threshold that it has still
    to pass.
    """
    chains, steps = round(SETTINGS.level_share * size), round(1.0 / SETTINGS.level_share)
    x = _possible_normals(generator, size, dimensions, possible)
    seeds = generator.random(size)
    y = _levels(level, x, seeds)
    evaluations, logarithm, variance = size, 0.0, 0.0
    spread = SETTINGS.first_spread
    thresholds: list[float] = []
    for number in range(SETTINGS.most_levels):
        ordered = np.argsort(y, kind="stable")
        # Half way to the next sample, so that no sample lies on the level itself.
        edge = 0.5 * (y[ordered[chains - 1]] + y[ordered[chains]])
        if edge == np.inf:
            return Population(0.0, math.inf, evaluations, tuple(thresholds), x[:0], seeds[:0], True)
        threshold = float(max(edge, 0.0))
        below = y <= threshold
        share = float(below.mean())
        # Most samples have one level: none separates them any more.
        if threshold > 0.0 and share > SETTINGS.still_share:
            return Population(0.0, math.inf, evaluations, tuple(thresholds), x[:0], seeds[:0], True)
        correlated = 1.0 if number == 0 else 1.0 + _correlation(below.reshape(steps, chains))
        logarithm += math.log(share)
        variance += (1.0 - share) / (share * size) * correlated
        # The failures themselves are likely enough: the last factor of the product.
        if threshold == 0.0:
            return Population(
                math.exp(logarithm), variance, evaluations, tuple(thresholds), x[below], seeds[below]
            )
        thresholds.append(threshold)
        if watch is not None:
            watch(number + 1, threshold)
        # Seeds of the chains follow the distribution inside the level already: no burn-in.
        chosen = generator.permutation(np.flatnonzero(below))[:chains]
        here, noise, value = x[chosen], seeds[chosen], y[chosen]
        parts = [(here, noise, value)]
        for step in range(1, steps):
            moved = math.sqrt(1.0 - spread**2) * here + spread * generator.standard_normal(here.shape)
            drawn = np.where(
                generator.random(chains) < SETTINGS.new_noise_share, generator.random(chains), noise
            )
            can = np.ones(chains, dtype=bool) if possible is None else possible(moved)
            tried = np.full(chains, np.inf)
            if can.any():
                tried[can] = _levels(level, moved[can], drawn[can])
            evaluations += int(can.sum())
            taken = tried <= threshold
            here = np.where(taken[:, None], moved, here)
            noise, value = np.where(taken, drawn, noise), np.where(taken, tried, value)
            parts.append((here, noise, value))
            # Robbins and Monro: corrections shrink, so that the chains' distribution settles.
            spread *= math.exp((float(taken.mean()) - SETTINGS.accepted_share) / math.sqrt(step))
            spread = min(max(spread, 0.01), 1.0)
        x, seeds, y = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return Population(
        0.0, variance, evaluations, tuple(thresholds), x[:0], seeds[:0], reached=math.exp(logarithm)
    )


@dataclass(frozen=True)
class Importance:
    """The check by importance sampling: estimate, its relative deviation, samples.

    ``effective`` is the effective number of failing ones, ``(sum w)^2 / sum w^2`` of their weights.
    """

    estimate: float
    relative_sd: float
    evaluations: int
    effective: float


@dataclass(frozen=True, eq=False)
class RareEvent(
    Plain,
    only="estimate interval confidence relative_sd evaluations plain_evaluations=plain populations"
    " check=checked stood_still",
):
    """Probability of a rare failure.

    Attributes
    ----------
    estimate
        Mean of the populations.
    interval
        With ``confidence``; from zero on where nothing failed.
    confidence
    relative_sd
        Standard deviation over the estimate.
    evaluations
        Of the level function, in all populations and the check.
    populations
    check
        None where there was nothing to start from.
    stood_still
        Whether the level function ended at a value that many samples share.
    """

    estimate: float
    interval: tuple[float, float]
    confidence: float
    relative_sd: float
    evaluations: int
    populations: tuple[Population, ...]
    check: Importance | None
    stood_still: bool

    @property
    def plain(self) -> float:
        """Evaluations with which plain sampling would know it as well."""
        if not 0.0 < self.estimate < 1.0:
            return math.nan
        return (1.0 - self.estimate) / (self.estimate * self.relative_sd**2)

    @property
    def agrees(self) -> bool | None:
        """Whether estimate and check are no further apart than two of their deviations together.

        None where there is nothing to compare, or the check rests on fewer than 100 effective samples: noise
        decides where failures are, or they are of too many kinds.
        """
        if self.check is None or self.estimate <= 0.0 or self.check.effective < SETTINGS.least_effective:
            return None
        size = math.sqrt(math.log1p(self.relative_sd**2) + math.log1p(self.check.relative_sd**2))
        return abs(math.log(self.check.estimate / self.estimate)) <= 2.0 * size

    @property
    def checked(self) -> dict[str, Any] | None:
        """The check, and whether it agrees; None without one."""
        return None if self.check is None else asdict(self.check) | {"agrees": self.agrees}


def rare_event(
    populations: tuple[Population, ...], check: Importance | None, *, confidence: float = 0.95
) -> RareEvent:
    """The probability that several populations and a check give."""
    values = np.array([population.estimate for population in populations])
    evaluations = sum(population.evaluations for population in populations) + (
        0 if check is None else check.evaluations
    )
    estimate = float(values.mean())
    still = any(population.stood_still for population in populations)
    if estimate <= 0.0:
        highest = 1.0 if still else _below(populations, confidence)
        return RareEvent(0.0, (0.0, highest), confidence, math.inf, evaluations, populations, check, still)
    own = [
        population.relative_variance * population.estimate**2
        for population in populations
        if population.estimate > 0.0
    ]
    within = SETTINGS.between_levels * math.sqrt(sum(own)) / len(values) / estimate
    between = float(values.std(ddof=1)) / math.sqrt(len(values)) / estimate if len(values) > 1 else 0.0
    # Of both the larger one: few populations scatter too little by chance.
    relative = max(within, between)
    width = _width(relative, confidence)
    interval = (estimate * math.exp(-width), min(estimate * math.exp(width), 1.0))
    return RareEvent(estimate, interval, confidence, relative, evaluations, populations, check, still)


def _width(relative: float, confidence: float) -> float:
    """Half the width of the interval of a logarithm."""
    from scipy.stats import norm

    return float(norm.isf(0.5 * (1.0 - confidence))) * math.sqrt(math.log1p(relative**2))


def _below(populations: tuple[Population, ...], confidence: float) -> float:
    """Upper end of the interval of the probability of the levels that were reached without a failure."""
    reached = np.array([population.reached for population in populations])
    within = math.sqrt(
        sum(population.relative_variance * population.reached**2 for population in populations)
    )
    relative = SETTINGS.between_levels * within / len(reached) / float(reached.mean())
    return min(float(reached.mean()) * math.exp(_width(relative, confidence)), 1.0)


def importance(
    level: Level,
    samples: Array,
    size: int,
    generator: np.random.Generator,
    *,
    possible: Callable[[Array], NDArray[np.bool_]] | None = None,
) -> Importance | None:
    """Probability of failure by `size` samples drawn about the centres of failing ones (k, d).

    The density is a mixture of normal ones with unit covariance. Coordinates whose mean is no further from
    zero than three of its deviations are left alone, lest chance in many of them spoils the weights. `level`
    and `possible` are as of `population`; the estimate is that of the distribution cut to what is possible.
    """
    from scipy.special import logsumexp

    if len(samples) < 20:
        return None
    centres, member = _regions(samples, generator)
    kept = [k for k in range(len(centres)) if np.count_nonzero(member == k) >= 10]
    if not kept:
        return None
    weight = np.array([np.count_nonzero(member == k) for k in kept], float)
    # Neighbours of a chain are alike: a tenth of the samples counts.
    spread = [samples[member == k].std(axis=0) for k in kept]
    error = [size_ / math.sqrt(0.1 * n) for size_, n in zip(spread, weight, strict=True)]
    centres = np.where(np.abs(centres[kept]) > 3.0 * np.array(error), centres[kept], 0.0)
    weight /= weight.sum()
    chosen = generator.choice(len(kept), size=size, p=weight)
    x = centres[chosen] + generator.standard_normal((size, samples.shape[1]))
    can = np.ones(size, dtype=bool) if possible is None else possible(x)
    y = np.full(size, np.inf)
    if can.any():
        y[can] = _levels(level, x[can], generator.random(int(can.sum())))
    # log of the mixture's density over the standard normal one
    ratio = x @ centres.T - 0.5 * (centres**2).sum(axis=1)
    ratio = logsumexp(ratio + np.log(weight), axis=1)
    w = np.where(y <= 0.0, np.exp(-ratio), 0.0)
    inside = 1.0
    if possible is not None:
        inside = float(possible(generator.standard_normal((4096, samples.shape[1]))).mean())
    estimate = float(w.mean()) / inside
    if estimate == 0.0:
        return Importance(0.0, math.inf, int(can.sum()), 0.0)
    deviation = float(w.std(ddof=1)) / math.sqrt(size) / float(w.mean())
    return Importance(estimate, deviation, int(can.sum()), float(w.sum() ** 2 / (w**2).sum()))


def _regions(samples: Array, generator: np.random.Generator) -> tuple[Array, NDArray[np.intp]]:
    """Centres (c, d) of the regions that samples lie in, and the region (k,) of each.

    As many, up to four, as are three deviations of a normal number apart from one another: k-means cuts a
    single region too, into pieces that are nearer.
    """
    from scipy.cluster.vq import kmeans2

    for count in range(min(SETTINGS.most_centres, max(len(samples) // 100, 1)), 1, -1):
        centres, member = kmeans2(samples, count, minit="++", seed=generator)
        apart = np.linalg.norm(centres[:, None] - centres[None], axis=2)[~np.eye(count, dtype=bool)]
        if apart.min() > SETTINGS.centres_apart:
            return centres, member
    return samples.mean(axis=0)[None], np.zeros(len(samples), dtype=np.intp)


def _levels(level: Level, x: Array, seeds: Array) -> Array:
    y = np.asarray(level(x, seeds), dtype=float)
    return np.where(np.isnan(y), -np.inf, y)


def _possible_normals(
    generator: np.random.Generator,
    size: int,
    dimensions: int,
    possible: Callable[[Array], NDArray[np.bool_]] | None,
) -> Array:
    x = generator.standard_normal((size, dimensions))
    if possible is None:
        return x
    wrong = np.flatnonzero(~possible(x))
    for _ in range(SETTINGS.possible_rounds):
        if not wrong.size:
            break
        x[wrong] = generator.standard_normal((len(wrong), dimensions))
        wrong = wrong[~possible(x[wrong])]
    return x


def _correlation(below: NDArray[np.bool_]) -> float:
    """Au & Beck's gamma of chains (steps, chains): by how much their indicator's variance is too small."""
    steps = len(below)
    inside = below.astype(float)
    mean = float(inside.mean())
    variance = mean * (1.0 - mean)
    if variance <= 0.0:
        return 0.0
    inflation = 0.0
    for lag in range(1, steps):
        covariance = float((inside[:-lag] * inside[lag:]).mean()) - mean**2
        inflation += 2.0 * (1.0 - lag / steps) * covariance / variance
    return max(inflation, 0.0)
