"""Linearisation of a joint estimate: residuals and exact derivatives, from which an estimate is judged.

The rows are residuals in standard deviations of their channel; the columns are exact derivatives (dual
numbers) of what the instruments show. Each segment's initial conditions are unknown too; they are projected
out of its rows, so that what is left is the segment's information on the rest (variable projection, Golub &
Pereyra 1973).

The information is ``J' W J``: its inverse is the covariance if the errors are independent, its eigenvalues
are the squared singular values of ``sqrt(W) J``, its eigenvectors the right singular vectors. Unknowns are
eliminated by the Schur complement.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array


@dataclass(frozen=True)
class Unknown:
    """One number of the joint estimate.

    ``scale`` is its natural size: the width of a coefficient's bounds, the prior standard deviation of a
    nuisance parameter. A flat prior has ``prior_sd = inf``.
    """

    name: str
    kind: Literal["coefficient", "nuisance"]
    unit: str
    lower: float
    upper: float
    scale: float
    prior: float
    prior_sd: float


CONTRADICTED = 2.0
"""Deviations from which what is known beforehand of a coefficient pulls with a constant force: one wrong
belief (a propeller of another size) may not bend the others. One right belief of 20 is further off."""


def trust(unknowns: Sequence[Unknown], away: Array) -> Array:
    """Huber's weight (m,) of the priors of unknowns ``away`` (m,) from them, of coefficients only."""
    known = np.array([u.prior_sd if u.kind == "coefficient" else np.inf for u in unknowns])
    return np.asarray(CONTRADICTED / np.maximum(np.abs(away) / known, CONTRADICTED))


@dataclass(frozen=True)
class Piece:
    """One segment at the estimate: times (n,), residuals (n, C) and derivatives (n, C, m).

    Residuals are measured minus shown, derivatives those of what is shown, both in standard deviations of the
    channel and zero where a sample does not count. ``weight`` (n, C) is the robust loss's weight in [0, 1],
    ``nu`` (n, 6) the predicted velocity.
    """

    trial: str
    t: Array
    residual: Array
    counted: NDArray[np.bool_]
    weight: Array
    jacobian: Array
    nu: Array


@dataclass(frozen=True)
class Linearisation:
    """Residuals and their derivatives at one point of the unknowns.

    ``values`` (m,), ``noise`` (C,) standard deviation of each channel's residual in SI, ``dt`` seconds
    between samples, one `Piece` per segment, those of a trial in the order of time. For the words: letters of
    the axes ``XYZKMN`` that thrusters push directly, and the names of fins and of their groups. ``tempering``
    (m,) is the number of samples that count as one independent one beside the prior of each unknown
    (`seatrial.statistics.uncertainty.tempering`).
    """

    unknowns: tuple[Unknown, ...]
    values: Array
    channels: tuple[str, ...]
    noise: Array
    dt: float
    pieces: tuple[Piece, ...]
    pushed: str = "XYZKMN"
    fins: tuple[str, ...] = ()
    tempering: Array | float = 1.0

    @property
    def precision(self) -> Array:
        """Information (m,) of the priors in units of the samples' information: ``tempering / sd^2``."""
        away = self.values - [unknown.prior for unknown in self.unknowns]
        known = np.array([unknown.prior_sd**-2.0 for unknown in self.unknowns])
        return np.asarray(self.tempering * trust(self.unknowns, away) * known)

    def of_first(self, count: int) -> Linearisation:
        """The same without the unknowns behind the first."""
        pieces = tuple(replace(piece, jacobian=piece.jacobian[:, :, :count]) for piece in self.pieces)
        tempering = np.broadcast_to(self.tempering, len(self.unknowns))[:count]
        return replace(
            self,
            unknowns=self.unknowns[:count],
            values=self.values[:count],
            pieces=pieces,
            tempering=tempering,
        )

    def information(self) -> Array:
        """Information (m, m): ``sum J' W J`` and that of the priors."""
        total = np.diag(self.precision)
        for piece in self.pieces:
            rows = piece.jacobian.reshape(-1, len(self.unknowns))
            total = total + rows.T @ (piece.weight.reshape(-1, 1) * rows)
        return np.asarray(total)

    def gradient(self) -> Array:
        """Downhill gradient (m,) of half the cost: ``sum J' W r`` minus the pull of the priors."""
        centre = np.array([unknown.prior for unknown in self.unknowns])
        total = self.precision * (centre - self.values)
        for piece in self.pieces:
            rows = piece.jacobian.reshape(-1, len(self.unknowns))
            total = total + rows.T @ (piece.weight * piece.residual).ravel()
        return np.asarray(total)


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
