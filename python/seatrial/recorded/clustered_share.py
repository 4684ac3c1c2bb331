"""A share of samples that come in windows, and how many independent samples it is worth.

Neighbouring samples err alike, so a window is a cluster. The share x of all samples has the variance of the
windows' sums (ratio estimator), widened where neighbouring windows correlate by r > 0, and is worth

    n* = x (1 - x) / var(x) (t_{n-1} / t_{B-1})^2

independent samples: at least one per window (fewer where they correlate), at most n. The interval of 95 % is
Clopper and Pearson's with these. Source: Korn & Graubard
(1998), Survey Methodology 24:193; the ratio estimator as in Cochran, *Sampling Techniques* (1977), chapter 9.

Tests: ``tests/test_recorded_validity.py``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["clustered_share", "share_interval"]


def clustered_share(outside: Sequence[NDArray[np.bool_]]) -> tuple[float, int, float]:
    """Share of true samples, number of samples, and how many independent ones they are worth.

    Parameters
    ----------
    outside : sequence of ndarray, shape (n,)
        A mask per window.

    Examples
    --------
    >>> whole = [np.full(100, window % 20 == 0) for window in range(200)]
    >>> share, samples, worth = clustered_share(whole)
    >>> share, samples, round(worth)
    (0.05, 20000, 200)
    """
    from scipy.stats import t as student

    sizes = np.array([len(one) for one in outside], dtype=float)
    hits = np.array([one.sum() for one in outside], dtype=float)[sizes > 0]
    sizes = sizes[sizes > 0]
    n, count = float(sizes.sum()), len(sizes)
    if count < 2:
        return float(hits.sum() / max(n, 1.0)), int(n), float(count)
    share = float(hits.sum() / n)
    away = hits - share * sizes
    variance = count / (count - 1.0) * float(away @ away) / n**2
    # Windows that follow one another may err alike; the correlation of neighbours widens the variance.
    r = float(away[1:] @ away[:-1]) / max(float(away @ away), 1e-300)
    r = min(max(r, 0.0), 0.9)
    variance *= (1.0 + r) / (1.0 - r)
    least = count * (1.0 - r) / (1.0 + r)
    if variance <= 0.0:
        return share, int(n), least
    ratio = student.ppf(0.975, n - 1.0) / student.ppf(0.975, count - 1.0)
    return share, int(n), float(np.clip(share * (1.0 - share) / variance * ratio**2, least, n))


def share_interval(share: float, effective: float) -> tuple[float, float]:
    """Interval of 95 % about a share of so many independent samples, which need be no whole number.

    Examples
    --------
    >>> low, high = share_interval(0.05, 100.0)
    >>> round(low, 3), round(high, 3)
    (0.016, 0.113)
    """
    from scipy.special import betaincinv

    hits, rest = share * effective, (1.0 - share) * effective
    low = float(betaincinv(hits, rest + 1.0, 0.025)) if hits > 0.0 else 0.0
    high = float(betaincinv(hits + 1.0, rest, 0.975)) if rest > 0.0 else 1.0
    return low, high
