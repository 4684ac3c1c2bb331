"""Where in one or two variables a failure probability exceeds what is allowed, from failures at places.

The failure probability at x is Phi(f(x)), f a Gaussian process with a constant, a linear and a squared
exponential part; k of n missions fail at a place, binomial. The posterior is Laplace's approximation
(Rasmussen and Williams 2006, *Gaussian Processes for Machine Learning*, sections 3.4 and 3.7.3), the sizes of
the parts and the lengths maximise the marginal likelihood with weak priors. The boundary is where f crosses
``Phi^-1(allowed)``; a place counts as safe or unsafe where f lies on one side of it with the confidence asked
for, and between is the uncertainty of the boundary.

Places are chosen where the side is least known and the boundary near: the largest ``q sd - |f - level|`` (the
straddle heuristic; Bryan, Nichol, Genovese, Schneider, Miller and Wasserman 2005, NIPS 18:163), several at a
time, each with the variance that those before will leave.

Tests: ``tests/statistics/test_failure_boundary.py``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array


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


SETTINGS = FailureSurfaceSettings()


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
    return _grid(np.linspace(0.0, 1.0, SETTINGS.start_values[dimensions - 1]), dimensions)


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
    priors = (SETTINGS.prior_size, SETTINGS.prior_slope, *(SETTINGS.prior_length,) * dimensions)
    centre = np.array([math.log(prior) for prior in priors])

    def cost(sizes: Array) -> float:
        evidence = _mode(_kernel(x, x, sizes), failures, runs)[2]
        return 0.5 * float(np.sum(((sizes - centre) / SETTINGS.prior_log_sd) ** 2)) - evidence

    best = minimize(cost, centre, method="Nelder-Mead", options={"maxiter": 80, "xatol": 0.03, "fatol": 0.03})
    own = _kernel(x, x, best.x)
    gradient, weight, _ = _mode(own, failures, runs)
    axis = np.linspace(0.0, 1.0, SETTINGS.values_per_axis[dimensions - 1])
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
    return np.asarray(SETTINGS.constant_sd**2 + slope**2 * ((a - 0.5) @ (b - 0.5).T) + smooth)


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
    for _ in range(SETTINGS.newton_steps):
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
        if value <= best + SETTINGS.least_gain:
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
