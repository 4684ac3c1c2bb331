"""Smoothness of gains along the supporting points.

Over each three neighbouring points the divided second difference of ln g with the speed x, in units of the
mean spacing h of the points:

    d_i = 2 h^2 [(ln g_{i+1} - ln g_i)/(x_{i+1} - x_i) - (ln g_i - ln g_{i-1})/(x_i - x_{i-1})]
          / (x_{i+1} - x_{i-1})

The penalty is the sum of d_i^2 over all gains: 0 where a gain grows by equal factors, and for the ratio of
two neighbours it is the same whether the gain is in N or kN. Three neighbours of which one is zero (no
integral there) stand aside, and so do points that are not reached. Source: Whittaker (1923), *On a new method
of graduation*, for the sum of squared differences. Held by tests/test_gain_smoothness.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.errors import CampaignError

__all__ = ["roughness"]

Array = NDArray[np.float64]
Gains = Mapping[str, ArrayLike]

_NEIGHBOURS = 3


def roughness(gains: Gains, reachable: ArrayLike, *, speeds_m_s: ArrayLike) -> Array:
    """Sum of squared second differences of ln(gain) along the points, (k,), dimensionless.

    Parameters
    ----------
    gains : mapping of str to array-like
        Values (k,) or one for all by the names of `Autopilot.gains`; those without a point in their name, and
        gains with fewer than three reached points, cost nothing.
    reachable : array-like of bool
        Whether each supporting point (6,) is reached.
    speeds_m_s : array-like
        Supporting points (6,), m/s, unevenly if need be.

    Examples
    --------
    >>> steady = {f"heading.K_P.{i}": 30.0 * 2.0**i for i in range(1, 7)}
    >>> kinked = steady | {"heading.K_P.3": [240.0, 240.0 * np.e]}
    >>> roughness(kinked, [True] * 6, speeds_m_s=range(6)).round(6)
    array([0., 6.])
    """
    reached, speeds = _points(reachable, speeds_m_s)
    spacing = float(np.diff(speeds).mean())
    count = max((len(np.atleast_1d(np.asarray(values))) for values in gains.values()), default=1)
    total = np.zeros(count)
    for points in _by_gain(gains).values():
        named = [i for i in sorted(points) if i < len(reached) and reached[i]]
        if len(named) < _NEIGHBOURS:
            continue
        values = np.array([np.broadcast_to(np.asarray(gains[points[i]], float), count) for i in named])
        given = values > 0.0
        logarithm = np.log(np.where(given, values, 1.0))
        x = speeds[named, None] / spacing
        slope = np.diff(logarithm, axis=0) / np.diff(x, axis=0)
        second = 2.0 * np.diff(slope, axis=0) / (x[2:] - x[:-2])
        total += np.sum(np.where(given[:-2] & given[1:-1] & given[2:], second, 0.0) ** 2, axis=0)
    return total


def _points(reachable: ArrayLike, speeds_m_s: ArrayLike | Sequence[float]) -> tuple[NDArray[np.bool_], Array]:
    """Both as arrays of the same length."""
    reached, speeds = np.asarray(reachable, dtype=bool), np.asarray(speeds_m_s, dtype=float)
    if reached.shape != speeds.shape or reached.ndim != 1:
        raise CampaignError(
            f"expected as many points reached or not as supporting speeds, found {reached.shape} and"
            f" {speeds.shape}; give one of each per point"
        )
    return reached, speeds


def _by_gain(gains: Gains) -> dict[str, dict[int, str]]:
    """Per gain ("heading.K_P") the names of its points by their place from 0."""
    found: dict[str, dict[int, str]] = {}
    for name in gains:
        gain, _, point = name.rpartition(".")
        if gain and point.isdecimal():
            found.setdefault(gain, {})[int(point) - 1] = name
    return found
