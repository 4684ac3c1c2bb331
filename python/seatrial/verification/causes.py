"""Which random inputs drive the failures of a requirement: size, side, p-value and failures along each.

For every cause the area under the curve, AUC = P(value of a failed mission > value of a held one), ties half:
0.5 says nothing, 0 and 1 separate them completely. Tests and their sources:

==========  ===========================================================  =====================================
cause       enough failures                                              too few: against the reserve
==========  ===========================================================  =====================================
number      Mann & Whitney (1947, Ann. Math. Stat. 18:50), of the        Spearman's rank correlation, of the
            ranks and of their distance from the middle one              same two
direction   uniform scores: Wheeler & Watson (1964), Mardia (1967)       circular-linear ranks: Mardia (1976)
category    Fisher's exact test, each category against all others        Mann & Whitney of the reserve
==========  ===========================================================  =====================================

What harms on either side of a centre, as a current from port or starboard does, has an AUC of one half: a
number is therefore tested twice, by its ranks and by their distance from the median. The smaller of the two
p-values counts twofold (Bonferroni) and says which of the two the influence is of.

The p-values of all causes for all requirements of a verification are one family, corrected by Holm (1979,
Scand. J. Stat. 6:65): noise alone is named, anywhere in it, in at most ``level`` of the campaigns. The inputs
are drawn independently: what goes with failures also drives them, but two causes that harm only together are
each shown weaker than they are. The tests themselves, exact where most missions share a value, are in
`seatrial.statistics.significance`. Held by ``tests/verification/test_causes.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.base.arrays import Array, Mask
from seatrial.base.plain import Plain
from seatrial.base.report import clause_of
from seatrial.statistics.significance import (
    circular_correlation,
    holm,
    mann_whitney,
    spearman,
    uniform_scores,
)

_SECTORS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")


@dataclass(frozen=True)
class Groups:
    """Groups of missions along a cause: their names, their missions, and how many of these failed.

    ``edges`` are the ends of the fifths of a number, one more than groups, else empty.
    """

    labels: tuple[str, ...]
    runs: tuple[int, ...]
    failures: tuple[int, ...]
    edges: tuple[float, ...] = ()

    @property
    def rates(self) -> tuple[float, ...]:
        """Share of failures of each group, not a number of an empty one."""
        return tuple(k / n if n else math.nan for k, n in zip(self.failures, self.runs, strict=True))


def grouped(values: NDArray[Any], failed: NDArray[np.bool_], *, kind: str) -> Groups:
    """Groups of k missions by finite numbers, directions in rad within 0 to 2 pi, or words."""
    edges: NDArray[Any] = np.empty(0)
    if kind == "category":
        names, place = np.unique(values, return_inverse=True)
        labels = [str(name) for name in names]
    elif kind == "direction":
        labels = list(_SECTORS)
        place = np.rint(values / (0.25 * np.pi)).astype(int) % len(_SECTORS)
    else:
        # Fifths: fewer hide a hump, more are too small to count failures in. Values that are often met may
        # fill several of them: fewer groups are left.
        edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, 6)))
        if len(edges) == 2:
            return _apart(values, failed, least=float(edges[0]), most=float(edges[1]))
        place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
        # A thousandth of the range is enough: no 9.5e-05 beside 0.1.
        digits = max(0, 2 - math.floor(math.log10(edges[-1] - edges[0])))
        shown = [f"{round(float(edge), digits) + 0.0:.4g}" for edge in edges]
        labels = [f"{low} to {high}" for low, high in pairwise(shown)]
    runs, lost = (np.bincount(of, minlength=len(labels)).tolist() for of in (place, place[failed]))
    return Groups(tuple(labels), tuple(runs), tuple(lost), tuple(map(float, edges)))


def _apart(values: NDArray[Any], failed: NDArray[np.bool_], *, least: float, most: float) -> Groups:
    """Two groups of numbers that nearly all are the smallest or the largest one: these, and the others."""
    usual = least if np.sum(values == least) >= np.sum(values == most) else most
    same = values == usual
    labels = (f"{usual:.3g}", f"above {usual:.3g}" if usual == least else f"below {usual:.3g}")
    runs, lost = (tuple(int(of[part].sum()) for part in (same, ~same)) for of in (np.ones(len(same)), failed))
    return Groups(labels, runs, lost)


Kind = Literal["number", "direction", "category"]
Where = Literal["", "both ends", "middle"]
MET = "yes"
"""Category of what was met, where there is nothing but to be met or not."""

FEW = 5
"""Failed, or held, missions below which the robustness is asked instead."""

_FROM_NORTH = "deg from north"
_UNITS = (_FROM_NORTH, "m/s", "m", "s", "deg", "sigmas")


@dataclass(frozen=True)
class Cause:
    """A random input of k missions.

    `name`: as a report calls it, such as "current speed" or "X_uu". `values` (k,): numbers; directions in
    rad, from north clockwise; or words of a category. `unit`: of the numbers, for the report. `usual`: of a
    category: the value that is no cause, such as "none".
    """

    name: str
    values: ArrayLike
    unit: str = ""
    kind: Kind = "number"
    usual: str = "none"

    @classmethod
    def of_column(cls, column: str, values: ArrayLike) -> Cause:
        """Cause of a column "name, unit" of numbers.

        Ones and zeros without a unit are a category that was met or not, "deg from north" is a direction.
        A comma before anything but a unit belongs to the name, as that of a mission may.

        Examples
        --------
        >>> Cause.of_column("fault of PtL", [0.0, 1.0, 0.0]).kind
        'category'
        >>> Cause.of_column("current speed, m/s", [0.1, 0.2]).unit
        'm/s'
        >>> Cause.of_column("current towards, deg from north", [10.0, 350.0]).kind
        'direction'
        """
        numbers = np.asarray(values, dtype=np.float64)
        name, _, unit = column.rpartition(", ")
        if unit not in _UNITS:
            name, unit = column, ""
        if unit == _FROM_NORTH:
            return cls(name, np.radians(numbers), kind="direction")
        if not unit and np.isin(numbers, (0.0, 1.0)).all():
            return cls(name, np.where(numbers > 0.0, MET, "no"), kind="category", usual="no")
        return cls(name, numbers, unit)


@dataclass(frozen=True)
class Influence(
    Plain, only="cause=label where named p_value corrected auc correlation odds sentence=__str__"
):
    """What a cause has to do with the failures; the rows of `seatrial.verification.causes.find_causes`.

    `category`: the category that was tested against all others, else empty. `where`: of a number that harms
    to either side of its median, or near to it, rather than towards one end: then ``auc``, ``correlation``,
    ``failed`` and ``held`` are of the distance from the median. `auc`: area under the curve: of numbers as
    they are, of a direction by the nearness to that of the failures, of a category by whether it was met. Not
    a number with too few failures. `correlation`: with the reserve (Spearman's, or its circular kin >= 0);
    negative where the reserve shrinks with it. `odds`: odds ratio of a category; else not a number.
    `p_value`, `corrected`: alone, and with regard to all causes of all requirements that were tested.
    `named`: whether ``corrected`` is within the level. `by_failures`: whether failures were compared, or the
    reserve since they were too few. `failed`, `held`: mean of the failed and of the held missions (direction:
    rad; category: share that met it). `groups`: failures in fifths, in eight sectors, or by category.
    """

    name: str
    unit: str
    kind: Kind
    category: str
    where: Where
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
        """How well it parts failed from held missions, or follows the robustness: 0 not at all, 1 fully."""
        return abs(2.0 * self.auc - 1.0) if self.by_failures else abs(self.correlation)

    @property
    def label(self) -> str:
        """Name as it stands beside a bar."""
        category = "" if self.category == MET else self.category
        part = self.where if self.where and self.named else category
        return f"{self.name}: {part}" if part else self.name

    def __str__(self) -> str:
        """A clause in plain words."""
        return clause_of(self, "verification")


def find_causes(
    held: ArrayLike, reserve: ArrayLike, *, causes: Sequence[Cause], level: float = 0.05
) -> tuple[Influence, ...]:
    """Influences of all causes on one requirement, the named ones first, the strongest of them first.

    Causes that are the same in all missions are left out; a mission without a value is left out of that
    cause.

    `reserve`: as of `seatrial.verification.requirement.Judgement`. `level`: chance to name any cause where
    there is none. Raises ValueError where a cause has another number of missions.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> speed, drag = rng.uniform(0.0, 0.5, 400), rng.normal(-40.0, 4.0, 400)
    >>> reserve = 0.4 - speed + rng.normal(0.0, 0.02, 400)
    >>> causes = [Cause("X_uu", drag, "kg/m"), Cause("current speed", speed, "m/s")]
    >>> print(find_causes(reserve > 0.0, reserve, causes=causes)[0])
    failures go with current speed: mean 0.446 m/s in failures, 0.197 m/s otherwise; AUC 0.99; 0 % of the
    missions fail in its lowest fifth, 89 % in its highest
    """
    return find_causes_of_all([(held, reserve)], causes=causes, level=level)[0]


def find_causes_of_all(
    judgements: Sequence[tuple[ArrayLike, ArrayLike]], *, causes: Iterable[Cause], level: float = 0.05
) -> tuple[tuple[Influence, ...], ...]:
    """Influences of all causes on each of several requirements, as of `find_causes`.

    A requirement without failures whose reserve is the same everywhere, as that of words is, asks nothing.

    `judgements`: of each requirement, (k,) each. `causes`: asked for one by one, so that memory holds no more
    than one. `level`: chance to name any cause of any requirement where there is none. Raises ValueError: a
    cause has another number of missions.
    """
    asked = [
        (np.asarray(held, dtype=bool), np.asarray(reserve, dtype=np.float64)) for held, reserve in judgements
    ]
    tested: list[list[Influence]] = [[] for _ in asked]
    for cause in causes:
        for rows, (held, reserve) in zip(tested, asked, strict=True):
            if (shape := np.shape(cause.values)) != held.shape:
                raise ValueError(f"{cause.name}: expected {len(held)} values, found shape {shape}")
            if enough(held) or not (reserve == reserve[:1]).all():
                rows += influences(cause, held, reserve)
    # All of them are one family, in which Holm's step-down holds the level.
    corrected = iter(holm([row.p_value for rows in tested for row in rows]))
    judged = []
    for rows in tested:
        own = [(row, next(corrected)) for row in rows]
        named = [replace(row, corrected=p, named=p <= level) for row, p in own]
        judged.append(tuple(sorted(named, key=lambda row: (not row.named, -row.strength))))
    return tuple(judged)


def influences(cause: Cause, held: Mask, reserve: Array) -> list[Influence]:
    """Influences of a cause, their p-values not corrected; of a category that has several, one each.

    `held` (k,) and `reserve` (k,) are of one requirement. None where the cause is the same in all missions; a
    mission without a value is left out.
    """
    if cause.kind == "category":
        return _categories(cause, np.asarray(cause.values).astype(str), held, reserve)
    numbers = np.asarray(cause.values, dtype=np.float64)
    known = np.isfinite(numbers)
    if not known.any() or np.ptp(numbers[known]) == 0.0:
        return []
    judge = _number_influence if cause.kind == "number" else _direction_influence
    return [judge(cause, numbers[known], held[known], reserve[known])]


def enough(held: Mask) -> bool:
    """Whether enough missions failed, and enough held, to be compared."""
    return FEW <= int(held.sum()) <= len(held) - FEW


def _number_influence(cause: Cause, values: Array, held: Mask, reserve: Array) -> Influence:
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


def _direction_influence(cause: Cause, values: Array, held: Mask, reserve: Array) -> Influence:
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
    cause: Cause, groups: Groups, mean: tuple[float, float], *, p: float, **found: Any
) -> Influence:
    """An influence that is not judged yet, with the means of failed and held missions."""
    sizes: dict[str, Any] = {
        "auc": np.nan,
        "correlation": np.nan,
        "odds": np.nan,
        "category": "",
        "where": "",
    } | found
    return Influence(
        name=cause.name, unit=cause.unit, kind=cause.kind, p_value=p, corrected=p, named=False,
        by_failures=bool(np.isfinite(sizes["auc"])), failed=mean[0], held=mean[1], groups=groups, **sizes,
    )  # fmt: skip


def _mean(values: Array, where: Mask) -> float:
    return float(values[where].mean()) if where.any() else float("nan")


def _heading(angle: Array) -> float:
    """Mean direction, rad in 0 to 2 pi."""
    if not len(angle):
        return float("nan")
    return float(np.mod(np.arctan2(np.sin(angle).sum(), np.cos(angle).sum()), 2.0 * np.pi))
