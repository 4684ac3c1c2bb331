"""Which random input drives the failures: each cause held against what failed and what did not.

Of every cause the area under the curve, AUC = P(value of a failed mission > value of a held one), ties half:
0.5 says nothing, 0 and 1 part them completely. Tests and their sources:

==========  ===========================================================  =====================================
cause       enough failures                                              too few: against the reserve
==========  ===========================================================  =====================================
number      Mann & Whitney (1947, Ann. Math. Stat. 18:50)                Spearman's rank correlation
direction   uniform scores: Wheeler & Watson (1964), Mardia (1967)       circular-linear ranks: Mardia (1976)
category    Fisher's exact test, each category against all others        Mann & Whitney of the reserve
==========  ===========================================================  =====================================

All p-values together are corrected by Holm (1979, Scand. J. Stat. 6:65), so that noise alone is named in at
most ``level`` of the campaigns. The inputs are drawn independently: what goes with failures also drives
them, but two causes that harm only together are each shown weaker than they are.

Held by `tests/test_causes.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.verification.cause_groups import Groups, grouped
from seatrial.verification.cause_tests import (
    circular_correlation,
    holm,
    mann_whitney,
    spearman,
    uniform_scores,
)
from seatrial.verification.cause_text import sentence

__all__ = ["Cause", "Influence", "find_causes"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Kind = Literal["number", "direction", "category"]

_MET = "yes"

FEW = 5
"""Failed, or held, missions below which the reserve is asked instead."""


@dataclass(frozen=True)
class Cause:
    """A random input of k missions.

    Parameters
    ----------
    name : str
        As a report calls it, such as "current speed" or "X_uu".
    values : array_like, shape (k,)
        Numbers; directions in rad, from north clockwise; or words of a category.
    unit : str
        Of the numbers, for the report.
    kind : {"number", "direction", "category"}
    usual : str
        Of a category: the value that is no cause, such as "none".
    """

    name: str
    values: ArrayLike
    unit: str = ""
    kind: Kind = "number"
    usual: str = "none"

    @classmethod
    def of_column(cls, column: str, values: ArrayLike) -> Cause:
        """Cause of a column "name, unit" of numbers; ones and zeros are a category that was met or not.

        Examples
        --------
        >>> Cause.of_column("fault of PtL", [0.0, 1.0, 0.0]).kind
        'category'
        >>> Cause.of_column("current speed, m/s", [0.1, 0.2]).unit
        'm/s'
        """
        numbers = np.asarray(values, dtype=np.float64)
        name, _, unit = column.partition(", ")
        if not unit and np.isin(numbers, (0.0, 1.0)).all():
            return cls(name, np.where(numbers > 0.0, _MET, "no"), kind="category", usual="no")
        return cls(name, numbers, unit)


@dataclass(frozen=True)
class Influence:
    """What a cause has to do with the failures; the rows of `find_causes`.

    Attributes
    ----------
    name, unit, kind : str
    category : str
        The category that was tested against all others, else empty.
    auc : float
        Area under the curve: of numbers as they are, of a direction by the nearness to that of the failures,
        of a category by whether it was met. Not a number with too few failures.
    correlation : float
        With the reserve (Spearman's, or its circular kin >= 0); negative where the reserve shrinks with it.
    odds : float
        Odds ratio of a category; else not a number.
    p_value, corrected : float
        Alone, and with regard to all causes that were tested.
    named : bool
        Whether ``corrected`` is within the level.
    by_failures : bool
        Whether failures were compared, or the reserve since they were too few.
    failed, held : float
        Mean of the failed and of the held missions (direction: rad; category: share that met it).
    groups : Groups
        Failures in fifths, in eight sectors, or by category.
    """

    name: str
    unit: str
    kind: Kind
    category: str
    auc: float
    correlation: float
    odds: float
    p_value: float
    corrected: float
    named: bool
    by_failures: bool
    failed: float
    held: float
    groups: Groups

    @property
    def strength(self) -> float:
        """How well it parts failed from held missions, or follows the reserve: 0 not at all, 1 fully."""
        return abs(2.0 * self.auc - 1.0) if self.by_failures else abs(self.correlation)

    @property
    def label(self) -> str:
        """Name as it stands beside a bar."""
        return f"{self.name}: {self.category}" if self.category not in ("", _MET) else self.name

    def __str__(self) -> str:
        """A sentence in plain words."""
        return sentence(self)


def find_causes(
    held: ArrayLike, reserve: ArrayLike, *, causes: Sequence[Cause], level: float = 0.05
) -> tuple[Influence, ...]:
    """Influences of all causes, the named ones first, the strongest of them first.

    Causes that are the same in all missions are left out; a mission without a value is left out of that
    cause.

    Parameters
    ----------
    held : array_like of bool, shape (k,)
    reserve : array_like, shape (k,)
        As of `seatrial.verification.requirement.Judgement`.
    causes : sequence of Cause
    level : float
        Chance to name any cause where there is none.

    Raises
    ------
    ValueError
        A cause has another number of missions.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> speed, drag = rng.uniform(0.0, 0.5, 400), rng.normal(-40.0, 4.0, 400)
    >>> reserve = 0.4 - speed + rng.normal(0.0, 0.02, 400)
    >>> causes = [Cause("X_uu", drag, "kg/m"), Cause("current speed", speed, "m/s")]
    >>> print(find_causes(reserve > 0.0, reserve, causes=causes)[0])
    failures go with current speed: 0.446 m/s on average against 0.197 m/s; AUC 0.99; 0 % of the missions
    fail in its lowest fifth, 89 % in its highest
    """
    kept, left = np.asarray(held, dtype=bool), np.asarray(reserve, dtype=np.float64)
    found: list[Influence] = []
    for cause in causes:
        values = np.asarray(cause.values)
        if values.shape != kept.shape:
            raise ValueError(f"{cause.name}: expected {len(kept)} values, found shape {values.shape}")
        if cause.kind == "category":
            found += _categories(cause, values.astype(str), kept, left)
        else:
            numbers = values.astype(np.float64)
            known = np.isfinite(numbers)
            if known.any() and np.ptp(numbers[known]) > 0.0:
                judge = _number if cause.kind == "number" else _direction
                found.append(judge(cause, numbers[known], kept[known], left[known]))
    corrected = holm([one.p_value for one in found])
    rows = [replace(one, corrected=p, named=p <= level) for one, p in zip(found, corrected, strict=True)]
    return tuple(sorted(rows, key=lambda row: (not row.named, -row.strength)))


def _number(cause: Cause, values: Array, held: Mask, reserve: Array) -> Influence:
    groups = grouped(values, ~held, kind="number")
    mean = _mean(values, ~held), _mean(values, held)
    if _enough(held):
        auc, p = mann_whitney(values[~held], values[held])
        return _influence(cause, groups, mean, p=p, auc=auc)
    rho, p = spearman(values, reserve)
    return _influence(cause, groups, mean, p=p, correlation=rho)


def _direction(cause: Cause, values: Array, held: Mask, reserve: Array) -> Influence:
    angle = np.mod(values, 2.0 * np.pi)
    groups = grouped(angle, ~held, kind="direction")
    mean = _heading(angle[~held]), _heading(angle[held])
    if _enough(held):
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
        if _enough(held):
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
) -> Influence:
    return Influence(
        name=cause.name, unit=cause.unit, kind=cause.kind, category=category, auc=auc,
        correlation=correlation, odds=odds, p_value=p, corrected=p, named=False,
        by_failures=bool(np.isfinite(auc)), failed=mean[0], held=mean[1], groups=groups,
    )  # fmt: skip


def _enough(held: Mask) -> bool:
    return FEW <= int(held.sum()) <= len(held) - FEW


def _mean(values: Array, where: Mask) -> float:
    return float(values[where].mean()) if where.any() else float("nan")


def _heading(angle: Array) -> float:
    """Mean direction, rad in 0 to 2 pi."""
    if not len(angle):
        return float("nan")
    return float(np.mod(np.arctan2(np.sin(angle).sum(), np.cos(angle).sum()), 2.0 * np.pi))
