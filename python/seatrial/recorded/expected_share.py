"""How large a share outside its band a valid model may leave, and when a share is larger than chance.

Of a valid model a share x of the samples lies outside the 95 % band: 5 % of them, or more where the vehicle
has coefficients, or the sensors offsets, that their covariance allows. With x_j the share of draw j of K, a
share of h/n* of n* independent samples has the predictive p-value (Box 1980, JRSS A 143:383)

    p = (1 + sum_j P(X >= h | n*, x_j)) / (1 + K),

X binomial, x_j at least 5 %. The ones are what K draws cannot tell: a vehicle further out than all of them
is possible, and p is never smaller than 1/(1 + K) (Davison & Hinkley 1997, *Bootstrap Methods*, section
4.2). Where the 5 % themselves rest on a reference worth n_r samples, x_j is Beta(n_r x_j, n_r (1 - x_j)).

Tests: ``tests/test_recorded_validity.py``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["LEAST_SHARE", "NOMINAL", "ExpectedShare"]

Array = NDArray[np.float64]

NOMINAL = 0.05
"""Share of a valid model's samples outside a band of 95 %."""

LEAST_SHARE = 0.10
"""Share of a channel outside the band below which nothing is called wrong."""

_GRID = 32
_BETA = 64


@dataclass(frozen=True, eq=False)
class ExpectedShare:
    """Shares (m,) that a valid model may leave outside, with their weights (m,), from so many draws."""

    shares: Array
    weights: Array
    draws: int

    @classmethod
    def of(cls, shares: Array | None, rests_on: float) -> ExpectedShare:
        """Expected share by draw, known from so many independent samples.

        Parameters
        ----------
        shares : (k,) ndarray or None
            Share of every draw; without draws the nominal one.
        rests_on : float
            Infinite where the nominal share is known.

        Examples
        --------
        >>> known = ExpectedShare.of(None, float("inf"))
        >>> round(known.p(0.2, 40.0), 4)
        0.0007
        """
        from scipy.special import betaincinv

        x = np.maximum(np.full(1, NOMINAL) if shares is None else shares, NOMINAL)
        grid: Array = np.geomspace(NOMINAL, max(float(x.max()), 1.01 * NOMINAL), _GRID)
        grid = np.minimum(grid, 1.0 - 1e-9)
        # The tail rises with x ever faster: to the neighbours on the grid is to the safe side.
        place = np.clip(np.searchsorted(grid, x, side="right") - 1, 0, _GRID - 2)
        part = np.clip((x - grid[place]) / (grid[place + 1] - grid[place]), 0.0, 1.0)
        low, high = np.bincount(place, 1.0 - part, _GRID), np.bincount(place + 1, part, _GRID)
        weights = np.asarray(low + high, dtype=float)
        held = weights > 0.0
        grid, weights = grid[held], weights[held] / len(x)
        if np.isfinite(rests_on):
            rank = (np.arange(_BETA) + 0.5) / _BETA
            spread = betaincinv(rests_on * grid[:, None], rests_on * (1.0 - grid[:, None]), rank)
            grid, weights = spread.ravel(), np.repeat(weights / _BETA, _BETA)
        return cls(grid, weights, 0 if shares is None else len(x))

    def p(self, share: float, effective: float) -> float:
        """P-value of a share outside of effectively so many independent samples."""
        from scipy.special import betainc

        hits = share * effective
        if hits <= 0.0:
            return 1.0
        tail = float(self.weights @ betainc(hits, effective - hits + 1.0, self.shares))
        return (1.0 + self.draws * tail) / (1.0 + self.draws) if self.draws else tail

    def needed(self, count: int, level: float) -> int:
        """Least number of samples outside, of so many, that is no chance; one more than all if none is."""
        least, most = int(LEAST_SHARE * count), count + 1
        while most - least > 1:
            middle = (least + most) // 2
            if self.p(middle / count, float(count)) < level:
                most = middle
            else:
                least = middle
        return most
