"""A requirement after the missions: failures, interval, verdict, worst missions, causes.

Tests: ``tests/test_verify.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from seatrial.verification import failure_probability
from seatrial.verification.causes import Cause, find_causes_of_all
from seatrial.verification.failure_probability import FailureProbability
from seatrial.verification.flown_missions import FlownMissions
from seatrial.verification.influence import Influence
from seatrial.verification.requirement import Judgement, Requirement

__all__ = ["JudgedRequirement", "WorstMission", "judged"]


@dataclass(frozen=True)
class WorstMission:
    """A mission that held a requirement least: how to find it again, and what it met.

    Attributes
    ----------
    number
        With which it is flown again.
    mission, seed
        Its name, and the seed of its noise.
    held, reserve
        Whether the requirement was held, and by how much.
    figures, drawn
        All its figures, and everything that was drawn, by name.
    """

    number: int
    mission: str
    seed: int
    held: bool
    reserve: float
    figures: dict[str, Any]
    drawn: dict[str, float]

    def to_dict(self) -> dict[str, Any]:
        """The same as plain data."""
        return {
            "number": self.number,
            "mission": self.mission,
            "seed": self.seed,
            "held": self.held,
            "reserve": self.reserve,
            "figures": dict(self.figures),
            "drawn": dict(self.drawn),
        }


@dataclass(frozen=True, eq=False)
class JudgedRequirement:
    """What the missions say of a requirement.

    Attributes
    ----------
    requirement, judgement
        What was asked, and which mission held it with which reserve.
    found
        Failures, runs, interval.
    by_mission
        The same of each mission, by name.
    causes
        Influences of what was drawn, those that are shown to matter first; with regard to all requirements of
        the verification.
    worst
        Missions with the least reserve, the worst first.
    """

    requirement: Requirement
    judgement: Judgement
    found: FailureProbability
    by_mission: dict[str, FailureProbability]
    causes: tuple[Influence, ...]
    worst: tuple[WorstMission, ...]

    @property
    def verdict(self) -> failure_probability.Verdict:
        """Held, failed or undecided."""
        return self.found.verdict(self.requirement.allowed)

    @property
    def sentence(self) -> str:
        """The verdict in words, with what it rests on."""
        return self.found.sentence(self.requirement.allowed)

    @property
    def further_runs(self) -> int | None:
        """Missions that will probably decide it, 0 where it is decided, None where a billion do not."""
        return failure_probability.further_runs(self.found, self.requirement.allowed)

    @property
    def named_causes(self) -> tuple[Influence, ...]:
        """Causes that are shown to matter."""
        return tuple(one for one in self.causes if one.named)

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        found = self.found
        return {
            "name": self.requirement.name,
            "holds": self.requirement.holds,
            "probability": self.requirement.probability,
            "verdict": self.verdict,
            "sentence": self.sentence,
            "failures": found.failures,
            "runs": found.runs,
            "failure_probability": found.estimate,
            "interval": list(found.interval),
            "at_least": found.at_least,
            "at_most": found.at_most,
            "confidence": found.confidence,
            "further_runs": self.further_runs,
            "smallest_reserve": float(np.min(self.judgement.reserve)),
            "unit": self.judgement.unit,
            "by_mission": {
                name: {"failures": one.failures, "runs": one.runs, "interval": list(one.interval)}
                for name, one in self.by_mission.items()
            },
            "causes": [
                {
                    "cause": one.label,
                    "where": one.where,
                    "named": one.named,
                    "p_value": one.p_value,
                    "corrected": one.corrected,
                    "auc": one.auc,
                    "correlation": one.correlation,
                    "odds": one.odds,
                    "sentence": str(one),
                }
                for one in self.causes
            ],
            "worst": [one.number for one in self.worst],
        }


def judged(
    requirements: Sequence[Requirement],
    flown: FlownMissions,
    *,
    missions: Sequence[str],
    confidence: float,
    keep_worst: int,
) -> tuple[JudgedRequirement, ...]:
    """What flown missions say of requirements, whose causes are found as one family.

    Parameters
    ----------
    requirements : sequence of Requirement
    flown : FlownMissions
        At least one.
    missions : sequence of str
        Names of the missions.
    confidence : float
    keep_worst : int
        How many of the worst missions to tell of.
    """
    judgements = [one.judge(flown.figures) for one in requirements]
    causes = find_causes_of_all(
        [(one.held, one.reserve) for one in judgements],
        causes=[Cause.of_column(name, values) for name, values in flown.causes.items()],
    )
    return tuple(
        JudgedRequirement(
            requirement=requirement,
            judgement=judgement,
            found=FailureProbability(judgement.failures, len(flown), confidence),
            by_mission=_by_mission(judgement, flown, missions, confidence),
            causes=found,
            worst=_worst(judgement, flown, missions, keep_worst),
        )
        for requirement, judgement, found in zip(requirements, judgements, causes, strict=True)
    )


def _by_mission(
    judgement: Judgement, flown: FlownMissions, missions: Sequence[str], confidence: float
) -> dict[str, FailureProbability]:
    apart: dict[str, FailureProbability] = {}
    for index, name in enumerate(missions):
        rows = flown.mission == index
        if rows.any():
            failures = int(np.count_nonzero(~judgement.held[rows]))
            apart[name] = FailureProbability(failures, int(rows.sum()), confidence)
    return apart


def _worst(
    judgement: Judgement, flown: FlownMissions, missions: Sequence[str], count: int
) -> tuple[WorstMission, ...]:
    return tuple(
        WorstMission(
            number=int(flown.numbers[row]),
            mission=missions[int(flown.mission[row])],
            seed=int(flown.seeds[row]),
            held=bool(judgement.held[row]),
            reserve=float(judgement.reserve[row]),
            figures={name: values[row].item() for name, values in flown.figures.items()},
            drawn={name: float(values[row]) for name, values in flown.causes.items()},
        )
        for row in judgement.worst(count)
        if not judgement.held[row] or np.isfinite(judgement.reserve[row])  # held by words: none is worst
    )
