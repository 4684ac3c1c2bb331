"""Smoothing spline of masked samples: values and derivatives for restarts and for measured axes.

Penalised least squares on the uniform base, ``min sum w (y - f)^2 + lambda sum (third difference of f)^2``
(Whittaker 1923; Eilers, Anal. Chem. 75 (2003) 3631), then the cubic spline through f. Without masks its gain
is ``1 / (1 + lambda (2 sin(omega h / 2))^6)``: a zero-phase low-pass. lambda is chosen by generalised
cross-validation with the effective degrees of freedom counted 1.4-fold, which guards against under-smoothing
(Kim and Gu, J. R. Stat. Soc. B 66 (2004) 337). Held by the ``test_law_`` functions of
``tests/trial/test_smoothing.py``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array, Mask

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

_CAUTION = 1.4  # factor on the effective degrees of freedom

_FILL_WEIGHT = 1e-3  # weight of a straight bridge over masked samples: it bounds the swing over a long gap

# Cut-off periods searched, in samples; the equations of longer ones are ill-conditioned.
_SHORTEST, _LONGEST = 2.5, 200.0


def smooth(y: Array, valid: Mask) -> Array:
    """Smoothed columns, shape (n, k), of uniform samples `y` (n, k) of one smoothness, `valid` (n,).

    Columns are one vector (a velocity, a quaternion): they get the same low-pass, scaled by their common
    noise.
    """
    from scipy.linalg import solveh_banded

    n = len(y)
    good = np.flatnonzero(valid)
    if len(good) < 5 or np.ptp(y[good], axis=0).max() == 0.0:
        return _bridged(y, good)
    # Masked samples get a weak straight bridge, so that the spline does not swing over a gap.
    filled = _bridged(y, good)
    weight = np.where(valid, 1.0, _FILL_WEIGHT)
    penalty = _penalty_bands(n)
    frequency = (2.0 * np.sin(0.5 * np.pi * np.arange(n) / n)) ** 6

    def solve(strength: float) -> tuple[float, Array]:
        bands = strength * penalty
        bands[-1] += weight
        f: Array = solveh_banded(bands, weight[:, None] * filled, check_finite=False)
        # Trace of the smoother from its gain at the frequencies of the uniform base, instead of an inverse.
        freedom = _CAUTION * np.sum(1.0 / (1.0 + strength * frequency)) / n
        residual = np.mean((y[good] - f[good]) ** 2)
        return (float(residual / (1.0 - freedom) ** 2) if freedom < 1.0 else np.inf), f

    periods = np.geomspace(_SHORTEST, _LONGEST, 24)
    strengths = (2.0 * np.sin(np.pi / periods)) ** -6.0
    return min((solve(strength) for strength in strengths), key=lambda result: result[0])[1]


def spline(t: Array, y: Array, valid: Mask) -> CubicSpline:
    """Cubic spline through the smoothed columns of `y` (n, k) over the uniform times `t` (n,)."""
    from scipy.interpolate import CubicSpline

    return CubicSpline(t, smooth(y, valid), axis=0)


def _bridged(y: Array, good: NDArray[np.intp]) -> Array:
    """Samples with straight bridges over what is not good, constant at the ends, zero where nothing is."""
    if len(good) == 0:
        return np.zeros_like(y)
    index = np.arange(len(y))
    return np.stack([np.interp(index, good, y[good, k]) for k in range(y.shape[1])], axis=1)


def _penalty_bands(n: int) -> Array:
    """Upper bands (4, n) of D'D, D the third difference, as `scipy.linalg.solveh_banded` wants them."""
    difference = np.array([-1.0, 3.0, -3.0, 1.0])
    bands = np.zeros((4, n))
    for i in range(4):
        for j in range(i, 4):
            # D'D[r + i, r + j] collects the product of the two entries from each row r of D.
            bands[3 - (j - i), j : n - 3 + j] += difference[i] * difference[j]
    return bands
