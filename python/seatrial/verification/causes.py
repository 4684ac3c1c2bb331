"""Which random input drives the failures: each cause held against what failed and what did not.

Of every cause the area under the curve, AUC = P(value of a failed mission > value of a held one), ties half:
0.5 says nothing, 0 and 1 part them completely. Tests and their sources:

==========  ===========================================================  =====================================
cause       enough failures                                              too few: against the reserve
==========  ===========================================================  =====================================
number      Mann & Whitney (1947, Ann. Math. Stat. 18:50), of the        Spearman's rank correlation, of the
            ranks and of their distance from the middle one              same two
direction   uniform scores: Wheeler & Watson (1964), Mardia (1967)       circular-linear ranks: Mardia (1976)
category    Fisher's exact test, each category against all others        Mann & Whitney of the reserve
==========  ===========================================================  =====================================

Where most missions share a number or a reserve, `seatrial.verification.cause_tests` stays exact.

The distance from the middle finds what harms to either side of a centre, as a current from port or starboard
does; of the two p-values of a number the smaller one counts twofold.

The p-values of all causes for all requirements of a verification are one family, corrected by Holm (1979,
Scand. J. Stat. 6:65): noise alone is named, anywhere in it, in at most ``level`` of the campaigns. The inputs
are drawn independently: what goes with failures also drives them, but two causes that harm only together are
each shown weaker than they are.

Held by `tests/test_causes.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.verification.cause_influence import enough, influences
from seatrial.verification.cause_tests import holm
from seatrial.verification.influence import MET, Influence, Kind

__all__ = ["Cause", "find_causes", "find_causes_of_all"]

_FROM_NORTH = "deg from north"
_UNITS = (_FROM_NORTH, "m/s", "m", "s", "deg", "sigmas")


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


def find_causes(
    held: ArrayLike, reserve: ArrayLike, *, causes: Sequence[Cause], level: float = 0.05
) -> tuple[Influence, ...]:
    """Influences of all causes on one requirement, the named ones first, the strongest of them first.

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
    return find_causes_of_all([(held, reserve)], causes=causes, level=level)[0]


def find_causes_of_all(
    judgements: Sequence[tuple[ArrayLike, ArrayLike]], *, causes: Sequence[Cause], level: float = 0.05
) -> tuple[tuple[Influence, ...], ...]:
    """Influences of all causes on each of several requirements, as of `find_causes`.

    A requirement without failures whose reserve is the same everywhere, as that of words is, asks nothing.

    Parameters
    ----------
    judgements : sequence of (held, reserve)
        Of each requirement, (k,) each.
    causes : sequence of Cause
    level : float
        Chance to name any cause of any requirement where there is none.

    Raises
    ------
    ValueError
        A cause has another number of missions.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> off, drag = rng.normal(0.0, 10.0, 400), rng.normal(-40.0, 4.0, 400)
    >>> reserve = 15.0 - np.abs(off)
    >>> causes = [Cause("X_uu", drag, "kg/m"), Cause("start heading off", off, "deg")]
    >>> path, calm = find_causes_of_all(
    ...     [(reserve > 0.0, reserve), (drag < 0.0, rng.normal(size=400))], causes=causes
    ... )
    >>> path[0].label, [one.named for one in calm]
    ('start heading off: both ends', [False, False])
    """
    found = [
        _of_one(causes, np.asarray(held, dtype=bool), np.asarray(reserve, dtype=np.float64))
        for held, reserve in judgements
    ]
    corrected = holm([one.p_value for rows in found for one in rows])
    ends = np.cumsum([len(rows) for rows in found]).tolist()
    return tuple(
        _judged(rows, corrected[end - len(rows) : end], level) for rows, end in zip(found, ends, strict=True)
    )


def _of_one(
    causes: Sequence[Cause], held: NDArray[np.bool_], reserve: NDArray[np.float64]
) -> list[Influence]:
    for cause in causes:
        if (shape := np.shape(cause.values)) != held.shape:
            raise ValueError(f"{cause.name}: expected {len(held)} values, found shape {shape}")
    if not enough(held) and (reserve == reserve[:1]).all():
        return []
    return [one for cause in causes for one in influences(cause, held, reserve)]


def _judged(rows: Sequence[Influence], corrected: Sequence[float], level: float) -> tuple[Influence, ...]:
    told = (replace(one, corrected=p, named=p <= level) for one, p in zip(rows, corrected, strict=True))
    return tuple(sorted(told, key=lambda row: (not row.named, -row.strength)))
