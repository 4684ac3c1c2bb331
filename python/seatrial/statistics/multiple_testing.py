"""Rank tests of one suspected cause (two samples, correlation, direction), and Holm's correction for many.

Where more than half of the missions share a value (no outage; a requirement on words that is held), ranks
are ties, and the normal approximation calls a coincidence of two rare things proof: one failure of 200 that
met an outage of a tenth of them has p = 0.003 by it, and 0.1 in truth. Such numbers are tested twice: whether
they have the common value (Fisher's exact test), and by the ranks of the others; the smaller p-value counts
twofold. Held by ``tests/verification/test_causes.py``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array

_EXACT = 20_000  # pairs up to which the exact distribution is cheap


def holm(p_values: Sequence[float]) -> list[float]:
    """P-values corrected for their number, each step down (Holm 1979).

    Examples
    --------
    >>> holm([0.01, 0.04, 0.03])
    [0.03, 0.06, 0.06]
    """
    corrected, largest = [1.0] * len(p_values), 0.0
    for rank, index in enumerate(np.argsort(p_values, kind="stable")):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[index]))
        corrected[index] = largest
    return corrected


def mann_whitney(values: Array, other: Array) -> tuple[float, float]:
    """AUC, P(values > other), and two-sided p-value."""
    from scipy.stats import mannwhitneyu

    pairs = len(values) * len(other)
    if pairs == 0:
        return 0.5, 1.0
    tested = mannwhitneyu(values, other, method="auto" if pairs <= _EXACT else "asymptotic")
    auc = float(tested.statistic) / pairs
    common = _common_value(np.concatenate([values, other]))
    if common is not None:
        return auc, _with_common_value(values, other, common)
    p = float(tested.pvalue)
    return auc, p if p == p else 1.0


def uniform_scores(angle: Array, chosen: NDArray[np.bool_]) -> float:
    """P-value that the chosen directions, rad, are not others than the rest (Wheeler & Watson 1964).

    The ranks are spread evenly over the circle; R is the length of the sum over the chosen ones, and
    2 (k-1) R^2 / (n (k-n)) has a chi-square distribution with two degrees of freedom.
    """
    score, k, n = _scores(angle), len(angle), int(chosen.sum())
    pull = np.sum(np.cos(score[chosen])) ** 2 + np.sum(np.sin(score[chosen])) ** 2
    return float(np.exp(-(k - 1.0) * pull / (n * (k - n))))


def circular_correlation(angle: Array, values: Array) -> tuple[float, float]:
    """Rank correlation, 0 to 1, of directions, rad, with numbers, and p-value.

    After Mardia (1976, Biometrika 63:403).
    """
    from scipy.stats import rankdata

    score, rank = _scores(angle), rankdata(values)
    # The scores are spread evenly: their cosine and sine are uncorrelated.
    squared = min(1.0, _pearson(rank, np.cos(score)) ** 2 + _pearson(rank, np.sin(score)) ** 2)
    return float(np.sqrt(squared)), float(np.exp(-0.5 * (len(angle) - 1.0) * squared))


def spearman(values: Array, other: Array) -> tuple[float, float]:
    """Rank correlation, -1 to 1, and p-value; infinite values have a rank as any other."""
    from scipy.stats import rankdata
    from scipy.stats import t as student

    k = len(values)
    if k < 4:
        return 0.0, 1.0
    rho = _pearson(rankdata(values), rankdata(other))
    for ranked, against in ((values, other), (other, values)):
        common = _common_value(ranked)
        if common is not None:
            apart = ranked != common
            ps = [mann_whitney(against[apart], against[~apart])[1]]
            if len(np.unique(ranked[apart])) > 1:
                ps.append(spearman(values[apart], other[apart])[1])
            return rho, min(1.0, len(ps) * min(ps))
    left = max(1.0 - rho * rho, np.finfo(np.float64).eps)
    return rho, float(2.0 * student.sf(abs(rho) * np.sqrt((k - 2.0) / left), k - 2))


def _common_value(values: Array) -> float | None:
    """The value that more than half of them have, None without one."""
    middle = float(np.sort(values)[len(values) // 2])
    return middle if 2 * np.count_nonzero(values == middle) > len(values) else None


def _with_common_value(values: Array, other: Array, common: float) -> float:
    """P-value of two samples that mostly share one value: how often they differ from it, and by how much."""
    from scipy.stats import fisher_exact

    rare = [part[part != common] for part in (values, other)]
    if not any(len(part) for part in rare):
        return 1.0
    counts = [[len(left), len(part) - len(left)] for left, part in zip(rare, (values, other), strict=True)]
    ps = [float(fisher_exact(counts).pvalue)]
    # Only over values other than the common one: how often these occur is what the first test decides.
    if len(np.unique(np.concatenate(rare))) > 1:
        ps.append(mann_whitney(*rare)[1])
    return min(1.0, len(ps) * min(ps))


def _scores(angle: Array) -> Array:
    from scipy.stats import rankdata

    return np.asarray(2.0 * np.pi * rankdata(angle) / len(angle))


def _pearson(x: Array, y: Array) -> float:
    x, y = x - x.mean(), y - y.mean()
    size = float(np.sqrt((x @ x) * (y @ y)))
    return float(x @ y) / size if size > 0.0 else 0.0
