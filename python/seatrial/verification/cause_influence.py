"""A random input held against what failed and what did not: the influence of one cause on one requirement.

The tests are listed in `seatrial.verification.causes`. What harms to either side of a centre has an AUC of
one half, so that a number is asked twice: by its ranks, and by their distance from that of the median. The
smaller p-value counts twofold (Bonferroni), and says which of the two the influence is of.

Held by `tests/test_causes.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.verification.cause_groups import Groups, grouped
from seatrial.verification.cause_tests import circular_correlation, mann_whitney, spearman, uniform_scores
from seatrial.verification.influence import Influence, Where

if TYPE_CHECKING:
    from seatrial.verification.causes import Cause

__all__ = ["FEW", "enough", "influences"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FEW = 5
"""Failed, or held, missions below which the reserve is asked instead."""


def influences(cause: Cause, held: Mask, reserve: Array) -> list[Influence]:
    """Influences of a cause, their p-values not corrected; of a category that has several, one each.

    None where the cause is the same in all missions; a mission without a value is left out.

    Parameters
    ----------
    cause : Cause
    held : ndarray of bool, shape (k,)
    reserve : ndarray, shape (k,)
    """
    if cause.kind == "category":
        return _categories(cause, np.asarray(cause.values).astype(str), held, reserve)
    numbers = np.asarray(cause.values, dtype=np.float64)
    known = np.isfinite(numbers)
    if not known.any() or np.ptp(numbers[known]) == 0.0:
        return []
    judge = _number if cause.kind == "number" else _direction
    return [judge(cause, numbers[known], held[known], reserve[known])]


def enough(held: Mask) -> bool:
    """Whether enough missions failed, and enough held, to be compared."""
    return FEW <= int(held.sum()) <= len(held) - FEW


def _number(cause: Cause, values: Array, held: Mask, reserve: Array) -> Influence:
    from scipy.stats import rankdata

    rank, compared = rankdata(values), enough(held)
    # Of most missions that share a value, the median rank is theirs: they are the centre.
    away = np.abs(rank - np.median(rank))
    along, apart = (
        mann_whitney(one[~held], one[held]) if compared else spearman(one, reserve) for one in (rank, away)
    )
    folded = apart[1] < along[1]
    found, p = apart if folded else along
    where: Where = ""
    if folded:
        where = "both ends" if (found > 0.5 if compared else found < 0.0) else "middle"
    size = np.abs(values - np.median(values)) if folded else values
    return _influence(
        cause,
        grouped(values, ~held, kind="number"),
        (_mean(size, ~held), _mean(size, held)),
        p=min(1.0, 2.0 * p),
        auc=found if compared else np.nan,
        correlation=np.nan if compared else found,
        where=where,
    )


def _direction(cause: Cause, values: Array, held: Mask, reserve: Array) -> Influence:
    angle = np.mod(values, 2.0 * np.pi)
    groups = grouped(angle, ~held, kind="direction")
    mean = _heading(angle[~held]), _heading(angle[held])
    if enough(held):
        near = np.cos(angle - mean[0])
        auc = mann_whitney(near[~held], near[held])[0]
        return _influence(cause, groups, mean, p=uniform_scores(angle, ~held), auc=auc)
    rho, p = circular_correlation(angle, reserve)
    return _influence(cause, groups, mean, p=p, correlation=rho)


def _categories(cause: Cause, values: NDArray[Any], held: Mask, reserve: Array) -> list[Influence]:
    from scipy.stats import fisher_exact

    names = [str(name) for name in np.unique(values)]
    groups = grouped(values, ~held, kind="category")
    if len(names) < 2:
        return []
    tested = [name for name in names if name != cause.usual]
    found = []
    # Two categories are one question.
    for name in tested[:1] if len(names) == 2 else tested:
        met = values == name
        shares = _mean(met.astype(np.float64), ~held), _mean(met.astype(np.float64), held)
        if enough(held):
            table = [[int((met & ~held).sum()), int((met & held).sum())]]
            table += [[int((~met & ~held).sum()), int((~met & held).sum())]]
            odds, p = fisher_exact(table)
            auc = 0.5 * (1.0 + shares[0] - shares[1])
            row = _influence(cause, groups, shares, p=float(p), auc=auc, odds=float(odds), category=name)
        else:
            auc, p = mann_whitney(reserve[met], reserve[~met])
            row = _influence(cause, groups, shares, p=p, correlation=2.0 * auc - 1.0, category=name)
        found.append(row)
    return found


def _influence(
    cause: Cause,
    groups: Groups,
    mean: tuple[float, float],
    *,
    p: float,
    auc: float = np.nan,
    correlation: float = np.nan,
    odds: float = np.nan,
    category: str = "",
    where: Where = "",
) -> Influence:
    return Influence(
        name=cause.name, unit=cause.unit, kind=cause.kind, category=category, where=where, auc=auc,
        correlation=correlation, odds=odds, p_value=p, corrected=p, named=False,
        by_failures=bool(np.isfinite(auc)), failed=mean[0], held=mean[1], groups=groups,
    )  # fmt: skip


def _mean(values: Array, where: Mask) -> float:
    return float(values[where].mean()) if where.any() else float("nan")


def _heading(angle: Array) -> float:
    """Mean direction, rad in 0 to 2 pi."""
    if not len(angle):
        return float("nan")
    return float(np.mod(np.arctan2(np.sin(angle).sum(), np.cos(angle).sum()), 2.0 * np.pi))
