"""A run with rows between those of its log, for sensors that sample in between.

Commands, supply and wrench hold from row to row of the log, a current is linear in between, so that the finer
run is the same motion.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["held", "linear", "times"]

Array = NDArray[np.float64]


def times(t: Array, every: int) -> Array:
    """Uniform times with `every` rows per row of `t` (n,), ((n - 1) every + 1,).

    Examples
    --------
    >>> times(np.array([0.0, 0.1, 0.2]), 2).tolist()
    [0.0, 0.05, 0.1, 0.15, 0.2]
    """
    return np.asarray(np.linspace(t[0], t[-1], (len(t) - 1) * every + 1)) if every > 1 else t


def held(values: ArrayLike, every: int) -> Array:
    """Rows of `values` (n, ...) each repeated `every` times, but for the last."""
    rows = np.asarray(values, float)
    return np.repeat(rows, every, axis=0)[: (len(rows) - 1) * every + 1]


def linear(values: ArrayLike, every: int) -> Array:
    """Rows of `values` (n, k) with straight lines in between."""
    rows = np.asarray(values, float)
    index = np.arange((len(rows) - 1) * every + 1) / every
    return np.stack([np.interp(index, np.arange(len(rows)), column) for column in rows.T], axis=1)
