"""Information matrices, and information criteria for models of correlated residuals.

The information is ``J' W J`` of sensitivities in standard deviations. Its inverse is the covariance if the
errors are independent; its eigenvalues are the squared singular values of ``sqrt(W) J``, its eigenvectors
the right singular vectors. Unknowns are eliminated by the Schur complement.

The criteria compare models of the same data: ``-2 ln L = sum n_c ln s_c^2`` for Gaussian errors, with the
mean square s_c^2 of each channel's residual. Correlated samples must not count in full, or every term that is
freed looks significant: n_c is the number of independent samples, those that count over the integrated
autocorrelation time (`seatrial.statistics.blocks`). AIC adds 2 k (Akaike 1974), BIC ``k ln sum n_c`` (Schwarz
1978); k is the number of determined combinations less the part that priors hold, ``tr H^-1 sum H_b`` (Moody
1992). Correlation between channels is not counted. Initial conditions of segments are left out of k: models
of the same segments have the same number of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.arrays import Array
from seatrial.base.plain import Plain
from seatrial.statistics.blocks import block_length, determined, information_of
from seatrial.statistics.linearisation import Linearisation

NULL = 1e-14
"""Eigenvalue of an information matrix with unit diagonal that is rounding.

Sums of 1e4 to 1e6 products of either sign round to some 1e-15; without this floor a null direction would come
out with any variance, or a negative one.
"""


def covariance(information: Array) -> Array:
    """Inverse (k, k) of an information matrix; null directions count as rounding would show them.

    Variances along a null direction are therefore lower limits; that of an unknown without any information is
    infinite.

    Examples
    --------
    >>> covariance(np.array([[4.0, 0.0], [0.0, 0.0]])).diagonal()
    array([0.25, inf])
    """
    return _inverse(information, np.maximum)


def eliminate(information: Array, keep: Sequence[int], drop: Sequence[int]) -> Array:
    """Information (k, k) on what is kept while what is dropped is unknown: the Schur complement.

    Examples
    --------
    >>> eliminate(np.array([[2.0, 1.0], [1.0, 1.0]]), [0], [1])
    array([[1.]])
    """
    kept = information[np.ix_(keep, keep)]
    reduced = kept - information[np.ix_(keep, drop)] @ regression(information, keep, drop)
    # What is left of an unknown after the subtraction may be rounding: then it is absorbed by the others.
    absorbed = np.diag(reduced) <= NULL * len(information) * np.diag(kept)
    reduced[absorbed, :] = reduced[:, absorbed] = 0.0
    return np.asarray(0.5 * (reduced + reduced.T))


def regression(information: Array, keep: Sequence[int], drop: Sequence[int]) -> Array:
    """Regression (d, k) of the dropped unknowns on the kept ones: minus their best-fitting change.

    Nothing moves along null directions of the dropped ones: the data do not determine it, rounding would.
    """
    inverse = _inverse(
        information[np.ix_(drop, drop)], lambda values, null: np.where(values > null, values, np.inf)
    )
    inverse[~np.isfinite(inverse)] = 0.0
    return np.asarray(inverse @ information[np.ix_(drop, keep)])


def _inverse(information: Array, determined: Callable[[Array, float], Array]) -> Array:
    """Inverse (k, k); `determined` maps the eigenvalues, and the size of rounding, to those that are used."""
    # A unit diagonal first, so that units decide nothing about which direction is null.
    diagonal = np.diag(information)
    blind = ~(diagonal > 0)
    size = np.sqrt(np.where(blind, 1.0, diagonal))
    unit = information / np.outer(size, size)
    unit[blind, :] = unit[:, blind] = 0.0
    unit[blind, blind] = 1.0
    values, vectors = np.linalg.eigh(unit)
    inverse = (vectors / determined(values, NULL * len(values))) @ vectors.T / np.outer(size, size)
    inverse[blind, blind] = np.inf
    return np.asarray(inverse)


def correlation(inverse: Array) -> Array:
    """Correlations (k, k) of a covariance; none with what is infinite."""
    sd = np.sqrt(np.diag(inverse))
    both = np.outer(np.isfinite(sd), np.isfinite(sd))
    matrix = np.where(both, inverse, 0.0) / np.where(both, np.outer(sd, sd), 1.0)
    np.fill_diagonal(matrix, 1.0)
    return np.asarray(matrix)


def inflation(information: Array, inverse: Array) -> Array:
    """Variance inflation factors (k,): variance over that with all others known; 1 without information."""
    variance = np.diag(inverse)
    known = np.isfinite(variance)
    return np.maximum(np.where(known, np.diag(information) * np.where(known, variance, 0.0), 1.0), 1.0)


def singular(information: Array) -> tuple[Array, Array, float]:
    """Singular values (k,), largest first, right singular vectors (k, k) as rows, and the condition number.

    The largest component of every vector is positive. The condition number is infinite where the smallest
    singular value is rounding.
    """
    if not len(information):
        return np.zeros(0), np.zeros((0, 0)), 1.0
    squares, columns = np.linalg.eigh(information)
    squares, vectors = squares[::-1], columns[:, ::-1].T
    largest = np.abs(vectors).argmax(axis=1)
    vectors = vectors * np.sign(vectors[np.arange(len(vectors)), largest])[:, None]
    values = np.sqrt(np.maximum(squares, 0.0))
    sound = squares[-1] > len(squares) * np.finfo(float).eps * squares[0]
    return values, vectors, float(values[0] / values[-1]) if sound else math.inf


@dataclass(frozen=True)
class InformationCriteria(Plain):
    """Smaller is better; only differences between models of the same data mean something.

    ``parameters`` is the effective number of parameters, ``effective`` (C,) that of independent samples.
    """

    aic: float
    bic: float
    parameters: float
    effective: tuple[float, ...]


def information_criteria(lin: Linearisation, *, effective: ArrayLike | None = None) -> InformationCriteria:
    """AIC and BIC of the model that was linearised at its estimate.

    Parameters
    ----------
    lin : Linearisation
    effective : array_like, shape (C,), optional
        Independent samples per channel. Models are compared with the same numbers: those of the largest one.
        By default this model's own.

    Raises
    ------
    CampaignError
        No sample counts.
    """
    # Correlated samples count by their effective number.
    length = block_length(lin)
    samples = length.effective if effective is None else np.asarray(effective, dtype=float)
    counts = np.maximum(np.sum([piece.counted.sum(axis=0) for piece in lin.pieces], axis=0), 1)
    squares = np.sum(
        [(piece.counted * piece.weight * piece.residual**2).sum(axis=0) for piece in lin.pieces], axis=0
    )
    size = np.where(samples > 0, squares / counts, 1.0) * lin.noise**2
    twice = float(samples @ np.log(np.where(samples > 0, np.maximum(size, 1e-300), 1.0)))
    information = information_of(lin)
    transform, _ = determined(information + np.diag(lin.precision))
    # A parameter that its prior determines counts in part, as the share of its information from data.
    parameters = float(np.trace(transform.T @ information @ transform))
    return InformationCriteria(
        aic=twice + 2.0 * parameters,
        bic=twice + float(np.log(samples.sum())) * parameters,
        parameters=parameters,
        effective=tuple(samples.tolist()),
    )
