"""What a random input has to do with the failures of a requirement: size, side, p-value, failures along it.

Held by `tests/test_causes.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from seatrial.verification.cause_groups import Groups
from seatrial.verification.cause_text import sentence

__all__ = ["MET", "Influence", "Kind", "Where"]

Kind = Literal["number", "direction", "category"]
Where = Literal["", "both ends", "middle"]

MET = "yes"
"""Category of what was met, where there is nothing but to be met or not."""


@dataclass(frozen=True)
class Influence:
    """What a cause has to do with the failures; the rows of `seatrial.verification.causes.find_causes`.

    Attributes
    ----------
    name, unit, kind : str
    category : str
        The category that was tested against all others, else empty.
    where : {"", "both ends", "middle"}
        Of a number that harms to either side of its median, or near to it, rather than towards one end: then
        ``auc``, ``correlation``, ``failed`` and ``held`` are of the distance from the median.
    auc : float
        Area under the curve: of numbers as they are, of a direction by the nearness to that of the failures,
        of a category by whether it was met. Not a number with too few failures.
    correlation : float
        With the reserve (Spearman's, or its circular kin >= 0); negative where the reserve shrinks with it.
    odds : float
        Odds ratio of a category; else not a number.
    p_value, corrected : float
        Alone, and with regard to all causes of all requirements that were tested.
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
        """How well it parts failed from held missions, or follows the reserve: 0 not at all, 1 fully."""
        return abs(2.0 * self.auc - 1.0) if self.by_failures else abs(self.correlation)

    @property
    def label(self) -> str:
        """Name as it stands beside a bar."""
        category = "" if self.category == MET else self.category
        part = self.where if self.where and self.named else category
        return f"{self.name}: {part}" if part else self.name

    def __str__(self) -> str:
        """A sentence in plain words."""
        return sentence(self)
