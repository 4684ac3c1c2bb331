"""Outliers of a regression: points that no other point believes.

A robust first fit (iteratively reweighted, Tukey's biweight with the median of the absolute residuals as
scale; Huber and Ronchetti 2009, *Robust Statistics*, chapter 7) marks suspects, however many there are. Each
suspect is then judged by the fit to all that are not suspected: its deleted residual

    t = (y - x'a) / (s sqrt(1 + x' (U'U)^-1 x))

is Student distributed for an honest point. It is an outlier beyond the two-sided 5 % point of Student's
distribution divided by the number of points (Bonferroni), so that one test in twenty accuses an honest point
at all. What passes is taken back.

Tests: ``tests/test_bench_regression.py``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from seatrial.bench_test.least_squares import Term, design, student

__all__ = ["outliers"]

Array = NDArray[np.float64]

_ALARM = 0.05
_BIWEIGHT = 4.685
_ROUNDS = 50
_SUSPECT = 3.0


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
            return nobody  # so many against the model accuse the model, not the points
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
        limit = student(dof, 1.0 - 0.5 * _ALARM / n)
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
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)
        coefficients = np.linalg.lstsq(root[:, None] * matrix, root * y, rcond=None)[0]
        former, residual = residual, y - matrix @ coefficients
        scale = 1.4826 * float(np.median(np.abs(residual))) * np.sqrt(n / (n - p))
        if scale <= 1e-12 * np.abs(y).max() or np.abs(residual - former).max() <= 1e-9 * scale:
            break
        weight = np.where(
            np.abs(residual) < _BIWEIGHT * scale, (1.0 - (residual / (_BIWEIGHT * scale)) ** 2) ** 2, 0.0
        )
    return np.asarray(np.abs(residual) > max(_SUSPECT * scale, 1e-9 * float(np.abs(y).max())))
