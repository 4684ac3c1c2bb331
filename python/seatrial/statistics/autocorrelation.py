"""Memory of one sample: how much less a mean tells of samples that resemble the one before.

Of a first-order autoregression with correlation r, n samples tell as much as ``n (1 - r) / (1 + r)``
independent ones, so that the variance of their mean is that of independent ones times ``(1 + r) / (1 - r)``
(Bartlett 1946). About their own mean, independent samples correlate by -1/n, which is allowed for. Longer
memories want blocks: `seatrial.statistics.blocks`.

Held by `test_neighbours_that_resemble_widen_the_interval` and
`test_the_standard_error_allows_for_samples_that_remember`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array

__all__ = ["neighbours", "widening"]


def neighbours(residuals: Array, *, most: float, together: NDArray[np.bool_] | None = None) -> float:
    """Correlation r of neighbouring residuals (n,) about their mean, from 0 to `most`.

    Parameters
    ----------
    residuals : ndarray, shape (n,)
    most : float
        Above it a record is too short to tell its memory.
    together : ndarray of bool, shape (n - 1,), optional
        Which ones are neighbours of the one before; all when omitted.

    Examples
    --------
    >>> round(neighbours(np.array([1.0, 1.0, -1.0, -1.0]), most=0.9), 3)
    0.583
    """
    n, power = len(residuals), float(residuals @ residuals)
    before, after = residuals[:-1], residuals[1:]
    if together is not None:
        before, after = before[together], after[together]
    if power <= 0.0 or not len(after):
        return 0.0
    alike = float(after @ before) / len(after) / (power / n) + 1.0 / n
    return min(max(alike, 0.0), most)


def widening(correlation: float) -> float:
    """Factor (1 + r) / (1 - r) on the variance of a mean.

    Examples
    --------
    >>> widening(0.5)
    3.0
    """
    return (1.0 + correlation) / (1.0 - correlation)
