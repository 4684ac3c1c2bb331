"""Direct regression: a polynomial in k inputs by QR, with covariance, bands and measures of fit.

Model (Taubert et al. 2014, equation 36), second order in k inputs u with all products:

    y = a_0 + sum_i a_i u_i + sum_(i<j) a_ij u_i u_j + sum_i a_ii u_i^2

Equation 37 solves the normal equations on raw revolutions, whose condition is 5e13 for 21 points from 150 to
2000 rpm. Here every input is scaled to one and the design matrix is factorised, U = Q R, a = R^-1 Q' y:
condition 26. With e = y - U a, p coefficients and n points:

    s^2 = e'e/(n - p),  cov a = s^2 (U'U)^-1 + sum_j v_j (U^+ c_j)(U^+ c_j)'

The second term is the zero error of each load cell: it moves all its points together by c_j, with variance
v_j. Confidence band of the curve ``t sqrt(x' cov x)``, prediction band ``t sqrt(s^2 + x' cov x)``.

Equation 38 calls two unlike numbers B: the squared correlation of y and its estimate, and SSR/SST. Both equal
``R^2 = 1 - SSE/SST`` only for least squares with intercept on its own data; R^2 decides, `paper_b` is shown.

Tests: ``tests/test_bench_regression.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["LeastSquares", "coefficient_name", "least_squares", "paper_b", "r_squared", "terms_of"]

Array = NDArray[np.float64]
Term = tuple[int, ...]

LEVEL = 0.95
"""Probability of all intervals and bands."""


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
        return student(self.dof)

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
    """Fit of values (n,) at inputs (n, k) by QR on inputs scaled to one.

    Parameters
    ----------
    inputs : array, shape (n, k)
    y : array, shape (n,)
    terms : sequence of tuple
        Of `terms_of`.
    common : array, shape (n, m), optional
        Columns of one standard deviation each of errors that move points together: a cell's zero.

    Raises
    ------
    ValueError
        There are no more points than coefficients, or the inputs do not tell the coefficients apart.

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
    scale = np.abs(u).max(axis=0)
    scale[scale == 0.0] = 1.0
    matrix = design(u / scale, terms)
    q, r = np.linalg.qr(matrix)
    singular = np.linalg.svd(r, compute_uv=False)
    if singular[-1] <= 1e-10 * singular[0]:
        raise ValueError(
            "the operating points do not tell the coefficients apart (condition above 1e10); test more"
            " different commands and voltages, or lower the order"
        )
    inverse = np.linalg.solve(r, np.eye(p))
    scaled = inverse @ (q.T @ values)
    residual = values - matrix @ scaled
    dof = n - p
    sigma = float(np.sqrt(residual @ residual / dof))
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


def student(dof: int, probability: float = 0.5 * (1.0 + LEVEL)) -> float:
    """Quantile of Student's distribution."""
    from scipy.stats import t

    return float(t.ppf(probability, dof))
