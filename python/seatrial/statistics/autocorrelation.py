"""Correlation of neighbouring samples, and how much it inflates the variance of their mean.

Of a first-order autoregression with correlation r, n samples carry the information of ``n (1 - r) / (1 + r)``
independent ones, so that the variance of their mean is that of independent ones times ``(1 + r) / (1 - r)``
(Bartlett 1946). About their own mean, independent samples correlate by -1/n, which is allowed for. Longer
memories need blocks: `seatrial.statistics.blocks`. Held by
``test_neighbours_that_resemble_widen_the_interval`` and
``test_the_standard_error_allows_for_samples_that_remember``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array


def lag_one_correlation(residuals: Array, *, most: float, together: NDArray[np.bool_] | None = None) -> float:
    """Correlation r of neighbouring residuals (n,) about their mean, from 0 to `most`.

    Parameters
    ----------
    residuals : ndarray, shape (n,)
    most : float
        Upper limit: beyond it a record is too short to show its memory.
    together : ndarray of bool, shape (n - 1,), optional
        Which samples follow the one before without a gap; all when omitted.

    Examples
    --------
    >>> round(lag_one_correlation(np.array([1.0, 1.0, -1.0, -1.0]), most=0.9), 3)
    0.583
    """
    n, power = len(residuals), float(residuals @ residuals)
    before, after = residuals[:-1], residuals[1:]
    if together is not None:
        before, after = before[together], after[together]
    if power <= 0.0 or not len(after):
        return 0.0
    correlation = float(after @ before) / len(after) / (power / n) + 1.0 / n
    return min(max(correlation, 0.0), most)


def variance_inflation(correlation: float) -> float:
    """Factor (1 + r) / (1 - r) on the variance of a mean.

    Examples
    --------
    >>> variance_inflation(0.5)
    3.0
    """
    return (1.0 + correlation) / (1.0 - correlation)
