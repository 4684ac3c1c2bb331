"""Autopilots on the same draws: which requirement each fails how often, and whether the difference is chance.

Mission i is the same for all of them (vehicle, water, noise, failures, start), so that the pairs decide: of
the missions that one autopilot held and the other failed, b, and those the other way round, c, equally many
are expected where they are equally good. The exact test of McNemar (1947, Psychometrika 12:153) is that of b
in b + c throws of a coin, on two sides; p-values of all requirements and autopilots together are corrected by
Holm.

Tests: ``tests/verification/test_verify.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.plain import Plain
from seatrial.statistics.multiple_testing import holm
from seatrial.statistics.proportions import FailureProbability
from seatrial.verification.flown_missions import FlownMissions
from seatrial.verification.requirement import Requirement

LEVEL = 0.05  # chance to name one of two that fail alike, after Holm's correction

_METRICS = (
    "true_cross_track_p95_m", "cross_track_p95_m", "vertical_p95_m", "energy_wh", "duration_s",
    "travel_per_s",
)  # fmt: skip


@dataclass(frozen=True)
class PairedRequirement(
    Plain,
    only="requirement other only_verified_failed=only_verified only_other_failed=only_other p_value corrected"
    " verdict=words",
):
    """A requirement for the verified autopilot and another one on the same missions.

    Attributes
    ----------
    requirement, other
        Names of the requirement and of the other autopilot.
    only_verified, only_other
        Missions that only the verified one failed, and only the other one.
    p_value, corrected
        Of McNemar's exact test, alone and with regard to all that were asked.
    """

    requirement: str
    other: str
    only_verified: int
    only_other: int
    p_value: float
    corrected: float

    @property
    def better(self) -> str | None:
        """The one that is shown to fail less: "verified" or the other's name; None where neither is."""
        if self.corrected > LEVEL:
            return None
        return "verified" if self.only_verified < self.only_other else self.other

    @property
    def words(self) -> str:
        """Which of them is better, or "no difference shown"."""
        return "no difference shown" if self.better is None else f"{self.better} is better"


@dataclass(frozen=True)
class FlownAutopilot:
    """How one autopilot did on the missions of a comparison.

    Attributes
    ----------
    name
        "verified", "start", or as it was given.
    failures
        Failures by requirement.
    metrics
        Median over the missions of some metrics.
    """

    name: str
    failures: dict[str, FailureProbability]
    metrics: dict[str, float]


@dataclass(frozen=True)
class AutopilotComparison:
    """Several autopilots on the same missions.

    Attributes
    ----------
    runs
        Number of missions.
    autopilots
        The verified one first.
    pairs
        Each requirement, the verified one against each other one.
    """

    runs: int
    autopilots: tuple[FlownAutopilot, ...]
    pairs: tuple[PairedRequirement, ...]

    def pair(self, requirement: str, other: str) -> PairedRequirement:
        """The verified autopilot against another one in a requirement."""
        return next(one for one in self.pairs if (one.requirement, one.other) == (requirement, other))

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "runs": self.runs,
            "autopilots": {
                one.name: {
                    "failures": {name: found.failures for name, found in one.failures.items()},
                    "intervals": {name: list(found.interval) for name, found in one.failures.items()},
                    "medians": dict(one.metrics),
                }
                for one in self.autopilots
            },
            "pairs": [one.to_dict() for one in self.pairs],
        }


def compared(
    requirements: Sequence[Requirement], flown: Mapping[str, FlownMissions], *, confidence: float
) -> AutopilotComparison:
    """Autopilots on the same missions: `flown` by name, the verified one first, all with the same numbers."""
    held = {
        name: {one.name: one.judge(missions.metrics).held for one in requirements}
        for name, missions in flown.items()
    }
    runs = len(next(iter(flown.values())))
    autopilots = tuple(
        FlownAutopilot(
            name,
            {
                title: FailureProbability(int(np.count_nonzero(~mask)), runs, confidence)
                for title, mask in held[name].items()
            },
            {metric: _median(missions.metrics[metric]) for metric in _METRICS if metric in missions.metrics},
        )
        for name, missions in flown.items()
    )
    verified, *others = flown
    raw = [
        (title, other, *mcnemar(held[verified][title], held[other][title]))
        for title in held[verified]
        for other in others
    ]
    corrected = holm([one[-1] for one in raw])
    pairs = tuple(
        PairedRequirement(title, other, b, c, p, float(sure))
        for (title, other, b, c, p), sure in zip(raw, corrected, strict=True)
    )
    return AutopilotComparison(runs, autopilots, pairs)


def mcnemar(held: NDArray[np.bool_], other: NDArray[np.bool_]) -> tuple[int, int, float]:
    """Missions that only the first failed, those that only the other failed, and the exact p-value.

    `held` and `other` (k,): whether each mission was held by the one and by the other.

    Examples
    --------
    >>> import numpy as np
    >>> first, second = np.array([True] * 10), np.array([True] * 4 + [False] * 6)
    >>> mcnemar(first, second)
    (0, 6, 0.03125)
    """
    from scipy.stats import binomtest

    b, c = int(np.count_nonzero(~held & other)), int(np.count_nonzero(held & ~other))
    return b, c, 1.0 if b + c == 0 else float(binomtest(b, b + c, 0.5).pvalue)


def _median(values: NDArray[Any]) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")
