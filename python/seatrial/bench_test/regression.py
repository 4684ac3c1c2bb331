"""Polynomial regression by QR: covariance and bands, outliers, and the choice of the order.

Model (Taubert et al. 2014, equation 36), second order in k inputs u with all products:

    y = a_0 + sum_i a_i u_i + sum_(i<j) a_ij u_i u_j + sum_i a_ii u_i^2

Equation 37 solves the normal equations on raw revolutions, whose condition is 5e13 for 21 points from 150 to
2000 rpm. Here every input is scaled to one and the design matrix is factorised, U = Q R, a = R^-1 Q' y:
condition 26. With e = y - U a, p coefficients and n points:

    s^2 = e'e/(n - p),  cov a = s^2 (U'U)^-1 + sum_j v_j (U^+ c_j)(U^+ c_j)'

The second term is the zero error of each load cell: it moves all its points together by c_j, with variance
v_j. Confidence band of the curve ``t sqrt(x' cov x)``, prediction band ``t sqrt(s^2 + x' cov x)``. Equation
38 calls two different numbers B: the squared correlation of y and its estimate, and SSR/SST. Both equal
``R^2 = 1 - SSE/SST`` only for least squares with intercept on its own data; R^2 decides, `paper_b` is shown.

Outliers: a robust first fit (iteratively reweighted, Tukey's biweight with the median of the absolute
residuals as scale; Huber and Ronchetti 2009, *Robust Statistics*, chapter 7) marks suspects, however many.
Each suspect is then judged by the fit to all that are not suspected: its deleted residual

    t = (y - x'a) / (s sqrt(1 + x' (U'U)^-1 x))

is Student distributed for a point of the model. It is an outlier beyond the two-sided 5 % point of Student's
distribution divided by the number of points (Bonferroni), so that one test in twenty has a false outlier.
Suspects that pass are used again.

Order (square, through the origin, free, cubic): ``AICc = n ln(SSE/n) + 2k + 2k(k + 1)/(n - k - 1)``, k = p +
1 (Hurvich and Tsai 1989, Biometrika 76:297). Two models less than 2 apart are as good as each other; then the
one with fewer coefficients is recommended. The F test asks whether a larger model of the same chain explains
more than the chosen one. Held by ``tests/bench_test/test_bench_regression.py``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.base.arrays import Array

Term = tuple[int, ...]


@dataclass(frozen=True)
class RegressionSettings:
    """Intervals, outliers and choice of the order of a regression."""

    level: float = 0.95  #: Probability of all intervals and bands.
    false_alarm: float = 0.05  #: Chance that a test has a false outlier, as the head says.
    biweight: float = 4.685  #: Deviations: 95 % efficiency for normal errors.
    rounds: int = 50  #: Of reweighting, where it does not settle before.
    suspect: float = 3.0  #: Robust deviations: every suspect is judged again.
    as_good: float = 2.0  #: Difference of AICc within which the simpler order is taken.


SETTINGS = RegressionSettings()


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """A fitted polynomial.

    Attributes
    ----------
    terms
        Exponents of the inputs per coefficient.
    scale
        (k,) what the inputs were divided by.
    scaled, factor
        Coefficients (p,) of the scaled inputs, and ``W`` (p, p) with covariance ``W W'``.
    residual
        (n,) N.
    leverage
        (n,) diagonal of the hat matrix.
    sigma, dof
        Residual standard deviation in N and its degrees of freedom.
    condition
        Of the scaled design matrix.
    r2, b
        1 - SSE/SST, and the squared correlation of equation 38.
    """

    terms: tuple[Term, ...]
    scale: Array
    scaled: Array
    factor: Array
    residual: Array
    leverage: Array
    sigma: float
    dof: int
    condition: float
    r2: float
    b: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients as the paper indexes them."""
        return tuple(coefficient_name(term) for term in self.terms)

    @property
    def coefficients(self) -> Array:
        """Coefficients (p,) of the inputs in their own units."""
        return np.asarray(self.scaled / self._powers)

    @property
    def covariance(self) -> Array:
        """Covariance (p, p) of the coefficients in their own units."""
        own = self.factor / self._powers[:, None]
        return np.asarray(own @ own.T)

    @property
    def standard_deviations(self) -> Array:
        """Standard deviations (p,) of the coefficients."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def quantile(self) -> float:
        """Student's t of the 95 % intervals."""
        return _student(self.dof)

    def intervals(self) -> Array:
        """95 % intervals (p, 2) of the coefficients."""
        half = self.quantile * self.standard_deviations
        return np.column_stack([self.coefficients - half, self.coefficients + half])

    def at(self, inputs: ArrayLike) -> Array:
        """Fitted values (m,) at inputs (m, k)."""
        return np.asarray(design(np.asarray(inputs) / self.scale, self.terms) @ self.scaled)

    def bands(self, inputs: ArrayLike) -> tuple[Array, Array]:
        """Half widths (m,) of the 95 % confidence band of the curve and of the prediction band of a point."""
        x = design(np.asarray(inputs) / self.scale, self.terms) @ self.factor
        curve = (x**2).sum(axis=1)
        return self.quantile * np.sqrt(curve), self.quantile * np.sqrt(self.sigma**2 + curve)

    @property
    def _powers(self) -> Array:
        return np.array([np.prod(self.scale ** np.array(term)) for term in self.terms])


def terms_of(
    order: int, inputs: int, *, through_origin: bool = False, square: bool = False
) -> tuple[Term, ...]:
    """Exponents of every coefficient: all products up to the order.

    Through the origin are those that contain the first input: no signal, no thrust at any voltage.

    Examples
    --------
    >>> [coefficient_name(term) for term in terms_of(2, 2)]
    ['a0', 'a1', 'a2', 'a11', 'a12', 'a22']
    >>> [coefficient_name(term) for term in terms_of(2, 2, through_origin=True)]
    ['a1', 'a11', 'a12']
    """
    if square:
        return ((2,) + (0,) * (inputs - 1),)
    every = [t for t in product(range(order + 1), repeat=inputs) if sum(t) <= order]
    every.sort(key=lambda t: (sum(t), tuple(-e for e in t)))
    return tuple(t for t in every if t[0] > 0 or not through_origin)


def coefficient_name(term: Term) -> str:
    """Name of a coefficient: its inputs' numbers, 0 for the intercept."""
    return "a" + ("".join(str(k + 1) * e for k, e in enumerate(term)) or "0")


def design(inputs: Array, terms: Sequence[Term]) -> Array:
    """Design matrix (n, p) of inputs (n, k)."""
    return np.column_stack([np.prod(inputs ** np.array(term), axis=1) for term in terms])


def least_squares(
    inputs: ArrayLike, y: ArrayLike, terms: Sequence[Term], *, common: ArrayLike | None = None
) -> LeastSquares:
    """Fit of values (n,) at inputs (n, k) by QR on inputs scaled to one; the terms are those of `terms_of`.

    `common` (n, m) has columns of one standard deviation each of errors that move points together: a cell's
    zero. A `ValueError` where the inputs do not determine the coefficients.

    Examples
    --------
    >>> fit = least_squares([[500.0], [1000.0], [1500.0], [2000.0]], [5.1, 20.2, 44.8, 80.0], terms_of(2, 1))
    >>> fit.names, round(fit.r2, 4)
    (('a0', 'a1', 'a11'), 1.0)
    """
    u, values = np.asarray(inputs, dtype=float), np.asarray(y, dtype=float)
    n, p = len(values), len(terms)
    if n <= p:
        raise ValueError(f"{n} operating points for {p} coefficients; expected at least {p + 1}")
    # Inputs of size one: the condition falls from 5e13 to some tens, as the head says.
    scale = np.abs(u).max(axis=0)
    scale[scale == 0.0] = 1.0
    matrix = design(u / scale, terms)
    q, r = np.linalg.qr(matrix)
    singular = np.linalg.svd(r, compute_uv=False)
    if singular[-1] <= 1e-10 * singular[0]:
        raise ValueError(
            "the operating points do not determine the coefficients (condition above 1e10); test more"
            " different commands and voltages, or lower the order"
        )
    inverse = np.linalg.solve(r, np.eye(p))
    scaled = inverse @ (q.T @ values)
    residual = values - matrix @ scaled
    dof = n - p
    sigma = float(np.sqrt(residual @ residual / dof))
    # The factor's columns times themselves are the covariance: scatter, then the zero of each cell.
    columns = [sigma * inverse]
    if common is not None:
        columns.append(inverse @ (q.T @ np.asarray(common, dtype=float)))
    fitted = values - residual
    return LeastSquares(
        terms=tuple(terms),
        scale=scale,
        scaled=scaled,
        factor=np.hstack(columns),
        residual=residual,
        leverage=(q**2).sum(axis=1),
        sigma=sigma,
        dof=dof,
        condition=float(singular[0] / singular[-1]),
        r2=r_squared(values, fitted),
        b=paper_b(values, fitted),
    )


def r_squared(measured: ArrayLike, fitted: ArrayLike) -> float:
    """1 - SSE/SST: what the model explains of the scatter about the mean; it may be negative.

    Examples
    --------
    >>> r_squared([0.0, 1.0, 4.0, 9.0], [0.0, 1.2, 4.8, 10.8])
    0.92
    """
    y, estimate = np.asarray(measured, dtype=float), np.asarray(fitted, dtype=float)
    total = float(((y - y.mean()) ** 2).sum())
    return 1.0 - float(((y - estimate) ** 2).sum()) / total if total > 0.0 else np.nan


def paper_b(measured: ArrayLike, fitted: ArrayLike) -> float:
    """Squared correlation of measured and fitted values, equation 38: blind to a wrong gain.

    Examples
    --------
    >>> paper_b([0.0, 1.0, 4.0, 9.0], [0.0, 1.2, 4.8, 10.8])
    1.0
    """
    y, estimate = np.asarray(measured, dtype=float), np.asarray(fitted, dtype=float)
    y, estimate = y - y.mean(), estimate - estimate.mean()
    power = float((y @ y) * (estimate @ estimate))
    return float((y @ estimate) ** 2 / power) if power > 0.0 else np.nan


def _student(dof: int, probability: float = 0.5 * (1.0 + SETTINGS.level)) -> float:
    """Quantile of Student's distribution."""
    from scipy.stats import t

    return float(t.ppf(probability, dof))


def outliers(inputs: Array, y: Array, terms: Sequence[Term]) -> NDArray[np.bool_]:
    """Mask (n,) of the points at inputs (n, k) that are outliers of a polynomial with these terms."""
    matrix = design(inputs / np.maximum(np.abs(inputs).max(axis=0), 1e-300), terms)
    n, p = matrix.shape
    nobody = np.zeros(n, bool)
    if n < p + 3:
        return nobody
    suspect = _suspects(matrix, y)
    most = max(1, min(n // 4, n - p - 2))
    while suspect.any():
        clean = ~suspect
        if suspect.sum() > most:
            return nobody  # so many suspects mean a wrong model, not wrong points
        q, r = np.linalg.qr(matrix[clean])
        if np.abs(np.diag(r)).min() <= 1e-10 * np.abs(np.diag(r)).max():
            return nobody
        coefficients = np.linalg.solve(r, q.T @ y[clean])
        residual = y - matrix @ coefficients
        dof = int(clean.sum()) - p
        sigma = float(np.sqrt(residual[clean] @ residual[clean] / dof))
        if sigma <= 1e-12 * np.abs(y).max():
            return nobody if np.abs(residual).max() <= 1e-9 * np.abs(y).max() else suspect
        lever = (np.linalg.solve(r.T, matrix.T) ** 2).sum(axis=0)
        tests = np.abs(residual) / (sigma * np.sqrt(1.0 + lever))
        limit = _student(dof, 1.0 - 0.5 * SETTINGS.false_alarm / n)
        honest = suspect & (tests <= limit)
        if not honest.any():
            return suspect
        suspect[np.argmin(np.where(honest, tests, np.inf))] = False
    return nobody


def _suspects(matrix: Array, y: Array) -> NDArray[np.bool_]:
    """Points beyond three robust standard deviations of a robust fit."""
    n, p = matrix.shape
    weight = np.ones(n)
    scale, residual = 0.0, y
    for _ in range(SETTINGS.rounds):
        root = np.sqrt(weight)
        coefficients = np.linalg.lstsq(root[:, None] * matrix, root * y, rcond=None)[0]
        former, residual = residual, y - matrix @ coefficients
        scale = 1.4826 * float(np.median(np.abs(residual))) * np.sqrt(n / (n - p))
        if scale <= 1e-12 * np.abs(y).max() or np.abs(residual - former).max() <= 1e-9 * scale:
            break
        weight = np.where(
            np.abs(residual) < SETTINGS.biweight * scale,
            (1.0 - (residual / (SETTINGS.biweight * scale)) ** 2) ** 2,
            0.0,
        )
    return np.asarray(np.abs(residual) > max(SETTINGS.suspect * scale, 1e-9 * float(np.abs(y).max())))


MODELS: dict[str, tuple[tuple[Term, ...], str]] = {
    "square": (terms_of(2, 1, square=True), 'order = "square"'),
    "second order through the origin": (
        terms_of(2, 1, through_origin=True),
        "order = 2, through_origin = true",
    ),
    "second order, free": (terms_of(2, 1), "order = 2, through_origin = false"),
    "third order, free": (terms_of(3, 1), "order = 3, through_origin = false"),
}
"""Models that are compared: terms and the keys that ask for them, each contained in the next."""


@dataclass(frozen=True)
class Candidate:
    """One model on the same points.

    Attributes
    ----------
    name, keys
        In words, and what to write in the bench file.
    terms
        Its coefficients.
    sse, scatter, aicc
        Sum of squares in N², standard deviation of the residuals in N, and the criterion; lower is better.
    """

    name: str
    keys: str
    terms: tuple[Term, ...]
    sse: float
    scatter: float
    aicc: float


def candidates(signal: Array, thrust: Array) -> tuple[Candidate, ...]:
    """Candidates that the points (n,) can determine, by AICc, the best one first."""
    models = []
    n = len(thrust)
    for name, (terms, keys) in MODELS.items():
        k = len(terms) + 1
        if n - k - 1 < 1:
            continue
        try:
            fit = least_squares(signal[:, None], thrust, terms)
        except ValueError:
            continue
        # Exact data have no scatter: rounding of the load is then the floor.
        sse = max(float(fit.residual @ fit.residual), n * (1e-9 * float(np.abs(thrust).max())) ** 2)
        aicc = n * math.log(sse / n) + 2 * k + 2 * k * (k + 1) / (n - k - 1)
        models.append(Candidate(name, keys, terms, sse, fit.sigma, aicc))
    return tuple(sorted(models, key=lambda model: model.aicc))


def recommended(models: tuple[Candidate, ...]) -> Candidate:
    """Candidate with the fewest coefficients among those as good as the best."""
    good = [model for model in models if model.aicc - models[0].aicc < SETTINGS.as_good]
    return min(good, key=lambda model: len(model.terms))


def lack_of_fit(models: tuple[Candidate, ...], chosen: tuple[Term, ...], n: int) -> str:
    """Sentence on whether the chosen terms fit the n points, and what would fit better."""
    if not models:
        return "too few points to compare orders"
    best = recommended(models)
    own = next((model for model in models if model.terms == chosen), None)
    if own is None:
        return f"of the usual models {best.name} describes the points best ({best.keys})"
    if own.aicc - best.aicc < SETTINGS.as_good:
        fewer = len(best.terms) < len(own.terms)
        name = "thrust per n|n|" if own.name == "square" else own.name
        return f"{name} fits" + (f"; {best.name} as well, with fewer coefficients" if fewer else "")
    if set(best.terms) < set(own.terms):
        return (
            f"{best.name} fits as well, with fewer coefficients ({best.keys}): the intervals would be"
            " narrower"
        )
    return (
        f"{best.name} describes the points better ({best.keys}): they scatter by {best.scatter:.2g} N instead"
        f" of {own.scatter:.2g} N, AICc lower by {own.aicc - best.aicc:.1f}{_f_words(own, best, n)}; the"
        " intervals stand for a curve of the order asked for"
    )


def _f_words(small: Candidate, large: Candidate, n: int) -> str:
    if not set(small.terms) < set(large.terms):
        return ""
    from scipy.stats import f

    more, dof = len(large.terms) - len(small.terms), n - len(large.terms)
    ratio = (small.sse - large.sse) / more / (large.sse / dof)
    p = float(f.sf(ratio, more, dof))
    return f", F test p {'below 0.001' if p < 0.001 else f'= {p:.2g}'}"
