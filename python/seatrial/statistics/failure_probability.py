"""Failure probability p from k failures in n missions, of one condition or over one or two variables.

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

**Over one or two variables** the failure probability at x is Phi(f(x)), f a Gaussian process with a constant,
a linear and a squared exponential part; k of n missions fail at a place, binomial. The posterior is Laplace's
approximation (Rasmussen and Williams 2006, *Gaussian Processes for Machine Learning*, sections 3.4 and
3.7.3), the sizes of the parts and the lengths maximise the marginal likelihood with weak priors. The boundary
is where f crosses ``Phi^-1(allowed)``; a place counts as safe or unsafe where f lies on one side of it with
the confidence asked for, and between is the uncertainty of the boundary. Places are chosen where the side is
least known and the boundary near: the largest ``q sd - |f - level|`` (the straddle heuristic; Bryan et al.
2005, NIPS 18:163), several at a time, each with the variance that those before will leave.

Tests: ``tests/statistics/test_failure_probability.py``, ``tests/statistics/test_failure_boundary.py``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

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


@dataclass(frozen=True)
class FailureSurfaceSettings:
    """Grid, priors and search of the Gaussian process behind a failure boundary."""

    #: Values along an axis by the number of variables: about 1,000 points in the plane.
    values_per_axis: tuple[int, int] = (201, 33)
    #: Values of the first places along each axis by the number of variables.
    start_values: tuple[int, int] = (9, 5)
    #: Standard deviation of the constant part of f: Phi(-2 .. 2) covers shares of 2 to 98 %.
    constant_sd: float = 2.0
    prior_size: float = 1.0  #: Centre of the prior of the size of the smooth part.
    prior_slope: float = 3.0  #: Centre of the prior of the slope.
    prior_length: float = 0.3  #: Centre of the prior of a length, over the range.
    #: Standard deviation of the priors' logarithms: a factor of 3.3.
    prior_log_sd: float = 1.2
    newton_steps: int = 60  #: Most Newton steps to the mode.
    least_gain: float = 1e-8  #: Gain of a step that ends them.


SURFACE_SETTINGS = FailureSurfaceSettings()


@dataclass(frozen=True)
class Place:
    """Missions flown at a place x of the unit cube, and how many of them failed."""

    x: tuple[float, ...]
    runs: int
    failures: int


@dataclass(frozen=True)
class Crossing:
    """A value, from 0 to 1 along an axis, at which the failure probability crosses what is allowed.

    `at`: best value. `interval`: between which values it lies with the confidence; an end at 0 or 1 may be
    the end of the range. `rising`: whether the values below it are the safe ones.
    """

    at: float
    interval: tuple[float, float]
    rising: bool


@dataclass(frozen=True, eq=False)
class BoundarySurface:
    """Failure probability over the unit cube.

    `axis`: values along an axis, (m,), the same on each. `mean`, `sd`: of f = Phi^-1(failure probability),
    (m,) or (m, m), the first variable along rows. `level`: Phi^-1 of the failure probability that is allowed.
    `quantile`: normal quantile of the confidence.
    """

    axis: Array
    mean: Array
    sd: Array
    level: float
    quantile: float

    @property
    def probability(self) -> Array:
        """Failure probability at the median of f, of the shape of ``mean``."""
        from scipy.special import ndtr

        return np.asarray(ndtr(self.mean))

    @property
    def sides(self) -> NDArray[np.int_]:
        """1 where surely safe, -1 where surely not, 0 where it is not known."""
        off = (self.level - self.mean) / np.maximum(self.sd, 1e-12)
        return np.where(off > self.quantile, 1, np.where(off < -self.quantile, -1, 0))

    def crossings(self, second: float | None = None) -> tuple[Crossing, ...]:
        """Boundaries along the first variable, at a value of the second where there are two."""
        mean, sd = self.mean, self.sd
        if second is not None:
            mean, sd = (
                np.array([np.interp(second, self.axis, row) for row in values]) for values in (mean, sd)
            )
        over, beyond = mean - self.level, np.abs(mean - self.level) - self.quantile * sd
        crossings = []
        for k in np.flatnonzero(np.sign(over[:-1]) * np.sign(over[1:]) < 0.0).tolist():
            at = _zero(self.axis, over, k)
            low = next((_zero(self.axis, beyond, i) for i in range(k, -1, -1) if beyond[i] > 0.0), 0.0)
            high = next(
                (_zero(self.axis, beyond, i - 1) for i in range(k + 1, len(over)) if beyond[i] > 0.0), 1.0
            )
            crossings.append(Crossing(at, (min(low, at), max(high, at)), bool(over[k + 1] > 0.0)))
        return tuple(crossings)


def _zero(axis: Array, values: Array, k: int) -> float:
    """Where the line through two neighbours is zero; between them."""
    a, b = float(values[k]), float(values[k + 1])
    share = 0.5 if a == b else min(max(a / (a - b), 0.0), 1.0)
    return float(axis[k] + share * (axis[k + 1] - axis[k]))


def start_places(dimensions: int) -> Array:
    """Places (n, d) of the unit cube to begin with: a grid with the ends."""
    return _grid(np.linspace(0.0, 1.0, SURFACE_SETTINGS.start_values[dimensions - 1]), dimensions)


def _grid(axis: Array, dimensions: int) -> Array:
    return np.stack(np.meshgrid(*[axis] * dimensions, indexing="ij"), axis=-1).reshape(-1, dimensions)


def surface_of(places: list[Place], *, allowed: float, confidence: float) -> BoundarySurface:
    """Failure probability over the unit cube from two or more places that were flown.

    `allowed` is the failure probability that is allowed; with `confidence`, two-sided, a place is called safe
    or not.
    """
    return _posterior(places, allowed, confidence)[0]


def places_to_fly(places: list[Place], *, allowed: float, confidence: float, count: int, runs: int) -> Array:
    """The next places (count, d) of the unit cube, at each of which `runs` missions will be flown.

    `allowed` and `confidence` are as for `surface_of`.
    """
    surface, grid, covariance = _posterior(places, allowed, confidence)
    mean = surface.mean.ravel()
    weight = runs * float(_curvature(np.array([surface.level]), np.array([allowed]), np.array([1.0]))[0])
    chosen = []
    for _ in range(count):
        sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        k = int(np.argmax(surface.quantile * sd - np.abs(mean - surface.level)))
        chosen.append(grid[k])
        # What missions there would leave of the variance, whatever they say.
        column = covariance[:, k]
        covariance = covariance - np.outer(column, column) / (covariance[k, k] + 1.0 / weight)
    return np.array(chosen)


def _posterior(
    places: list[Place], allowed: float, confidence: float
) -> tuple[BoundarySurface, Array, Array]:
    """Surface, its grid (m, d), and the covariance (m, m) of f on it."""
    from scipy.optimize import minimize
    from scipy.special import ndtri

    x = np.array([place.x for place in places])
    runs = np.array([place.runs for place in places], dtype=float)
    failures = np.array([place.failures for place in places], dtype=float)
    dimensions = x.shape[1]
    # Sizes are logarithms, and their priors normal about the centre.
    priors = (
        SURFACE_SETTINGS.prior_size,
        SURFACE_SETTINGS.prior_slope,
        *(SURFACE_SETTINGS.prior_length,) * dimensions,
    )
    centre = np.array([math.log(prior) for prior in priors])

    def cost(sizes: Array) -> float:
        evidence = _mode(_kernel(x, x, sizes), failures, runs)[2]
        return 0.5 * float(np.sum(((sizes - centre) / SURFACE_SETTINGS.prior_log_sd) ** 2)) - evidence

    best = minimize(cost, centre, method="Nelder-Mead", options={"maxiter": 80, "xatol": 0.03, "fatol": 0.03})
    own = _kernel(x, x, best.x)
    gradient, weight, _ = _mode(own, failures, runs)
    axis = np.linspace(0.0, 1.0, SURFACE_SETTINGS.values_per_axis[dimensions - 1])
    grid = _grid(axis, dimensions)
    cross = _kernel(x, grid, best.x)
    # Rasmussen and Williams, algorithm 3.2: B = I + W^1/2 K W^1/2 is well conditioned whatever K is.
    root = np.sqrt(weight)
    inner = np.eye(len(x)) + root[:, None] * own * root
    spread = np.linalg.solve(np.linalg.cholesky(inner), root[:, None] * cross)
    covariance = _kernel(grid, grid, best.x) - spread.T @ spread
    shape = (len(axis),) * dimensions
    surface = BoundarySurface(
        axis=axis,
        mean=(gradient @ cross).reshape(shape),
        sd=np.sqrt(np.maximum(np.diag(covariance), 0.0)).reshape(shape),
        level=float(ndtri(allowed)),
        quantile=float(ndtri(0.5 + 0.5 * confidence)),
    )
    return surface, grid, covariance


def _kernel(a: Array, b: Array, sizes: Array) -> Array:
    """Covariance (n, m) of f: a constant, a slope about the middle, and what is smooth; logarithmic sizes."""
    size, slope, lengths = math.exp(sizes[0]), math.exp(sizes[1]), np.exp(sizes[2:])
    apart = (a[:, None, :] - b[None, :, :]) / lengths
    smooth = size**2 * np.exp(-0.5 * np.sum(apart**2, axis=2))
    return np.asarray(SURFACE_SETTINGS.constant_sd**2 + slope**2 * ((a - 0.5) @ (b - 0.5).T) + smooth)


def _mode(kernel: Array, failures: Array, runs: Array) -> tuple[Array, Array, float]:
    """Gradient of the log likelihood and its curvature (n,) at the mode of f, and the log evidence.

    Newton's method of Rasmussen and Williams (2006), algorithm 3.1, with steps halved where they overshoot.
    """
    from scipy.special import log_ndtr

    def gain(alpha: Array) -> float:
        f = kernel @ alpha
        likelihood = np.sum(failures * log_ndtr(f) + (runs - failures) * log_ndtr(-f))
        return float(likelihood - 0.5 * alpha @ f)

    alpha = np.zeros(len(runs))
    best = gain(alpha)
    for _ in range(SURFACE_SETTINGS.newton_steps):
        f = kernel @ alpha
        weight, slope = _curvature(f, failures / runs, runs), _slope(f, failures, runs)
        root = np.sqrt(weight)
        inner = np.eye(len(f)) + root[:, None] * kernel * root
        b = weight * f + slope
        target = b - root * np.linalg.solve(inner, root * (kernel @ b))
        # A full Newton step may overshoot where failures are rare: it is halved until it gains.
        share, value = 1.0, gain(target)
        while value < best and share > 1e-3:
            share *= 0.5
            value = gain(alpha + share * (target - alpha))
        if value <= best + SURFACE_SETTINGS.least_gain:
            break
        alpha, best = alpha + share * (target - alpha), value
    # Laplace's evidence: the likelihood at the mode less half the log determinant there.
    f = kernel @ alpha
    weight = _curvature(f, failures / runs, runs)
    root = np.sqrt(weight)
    sign, logarithm = np.linalg.slogdet(np.eye(len(f)) + root[:, None] * kernel * root)
    return alpha, weight, best - 0.5 * float(sign * logarithm)


def _ratio(f: Array) -> Array:
    """phi(f) / Phi(f)."""
    from scipy.special import log_ndtr

    return np.asarray(np.exp(-0.5 * f**2 - 0.5 * math.log(2.0 * math.pi) - log_ndtr(f)))


def _slope(f: Array, failures: Array, runs: Array) -> Array:
    return np.asarray(failures * _ratio(f) - (runs - failures) * _ratio(-f))


def _curvature(f: Array, share: Array, runs: Array) -> Array:
    """Minus the second derivative of the log likelihood, (n,), above zero."""
    up, down = _ratio(f), _ratio(-f)
    curvature = runs * (share * up * (up + f) + (1.0 - share) * down * (down - f))
    return np.asarray(np.maximum(curvature, 1e-10))
