"""`RareFailures`: how rarely each requirement fails, what its failures have in common, and what to do.

Tests: ``tests/verification/test_rare.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.errors import CampaignError
from seatrial.base.plain import Plain
from seatrial.base.report import Report, Section, Table
from seatrial.base.run import RunResult, to_json
from seatrial.statistics.subset_simulation import RareEvent
from seatrial.verification.mission_space import MissionSpace
from seatrial.verification.requirement import named

if TYPE_CHECKING:
    from seatrial.verification.requirement import Requirement
    from seatrial.verification.scenario import Scenario

SIZE = 500
"""Missions of a level."""

_SHOWN, _SHIFTED = 5, 0.8
"""How many common causes of failures are printed, and from which shift on, in standard deviations."""


@dataclass(frozen=True, eq=False)
class RareRequirement:
    """How rarely a requirement fails.

    Attributes
    ----------
    requirement
    event
        Probability, interval, missions spent; None where the robustness cannot be used.
    why_not
        Why it cannot; empty otherwise.
    likeliest
        What was drawn in the failing mission that is nearest to the middle of all draws, by readable names.
    nearest_deviations
        How far that is, in standard deviations.
    common
        What the failing missions have in common, by readable names, the most telling first: their mean, that
        of all draws, and by how many of its standard deviations it is shifted.
    sample, seed
        Its standard normal numbers (d,) and the seed of its noise, with which it is flown again.
    """

    requirement: Requirement
    event: RareEvent | None
    why_not: str = ""
    likeliest: Mapping[str, float] = field(default_factory=dict)
    nearest_deviations: float = math.nan
    common: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    sample: tuple[float, ...] = ()
    seed: float = math.nan

    @property
    def verdict(self) -> str:
        """Held or failed where the interval lies on one side of what is allowed; undecided else."""
        if self.event is None:
            return "not judged"
        low, high = self.event.interval
        if high <= self.requirement.allowed:
            return "held"
        return "failed" if low > self.requirement.allowed else "undecided"

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "name": self.requirement.name,
            "holds": self.requirement.holds,
            "allowed": self.requirement.allowed,
            "verdict": self.verdict,
            "event": None if self.event is None else self.event.to_dict(),
            "why_not": self.why_not,
            "likeliest": dict(self.likeliest),
            "nearest_deviations": self.nearest_deviations if self.likeliest else None,
            "common": {name: list(row) for name, row in self.common.items()},
            "sample": list(self.sample),
            "seed": self.seed if self.sample else None,
        }


@dataclass(frozen=True, eq=False)
class RareFailures(
    RunResult,
    Plain,
    only="campaign=scenario.name held interrupted warnings=scenario.flights.warnings requirements",
):
    """Failure probabilities of rare events; made by `st.Rare`.

    Attributes
    ----------
    scenario
        What was flown.
    requirements
        A `RareRequirement` each.
    interrupted
        Whether Ctrl-C ended it early: requirements that were not finished are missing.
    facts
        What the result rests on.
    """

    scenario: Scenario
    requirements: tuple[RareRequirement, ...]
    interrupted: bool
    facts: Mapping[str, Any] = field(default_factory=dict)

    @property
    def outcome(self) -> str:
        """The worst verdict: failed, not judged, undecided or held."""
        verdicts = {one.verdict for one in self.requirements}
        return next((one for one in ("failed", "not judged", "undecided") if one in verdicts), "held")

    @property
    def held(self) -> bool:
        """Whether all requirements are held."""
        return not self.interrupted and self.outcome == "held"

    def replay(self, name: str) -> Any:
        """Flight of the likeliest failing mission of a requirement, with its log.

        Parameters
        ----------
        name : str
            Of the requirement.

        Raises
        ------
        CampaignError
            There is no such requirement, or it did not fail.
        """
        [found] = named([name], {one.requirement.name: one for one in self.requirements})
        if not found.sample:
            raise CampaignError(f'requirement "{name}": no mission failed, there is none to fly again')
        space = MissionSpace(self.scenario.flights)
        drawn = space.draws(np.array([found.sample]), np.array([found.seed]))
        return self.scenario.flights.replay_drawn(drawn)

    def files(self) -> dict[str, str | bytes]:
        """Files of the run directory by name, see `save`."""
        return {**self.scenario.files(), "rare.json": to_json(self.to_dict()), **self.report().files()}

    def summary(self) -> str:
        """The report as text."""
        return self.report().text()

    def report(self) -> Report:
        """Three lines, a table of the requirements, the likeliest failing missions."""
        judged = [one for one in self.requirements if one.event is not None]
        held = sum(one.verdict == "held" for one in self.requirements)
        spent = sum(one.event.evaluations for one in judged if one.event is not None)
        worst, next_step = self.scenario.flights.doubting(*_worst(self))
        return Report(
            title=self.scenario.name,
            outcome=self.outcome + (" (interrupted)" if self.interrupted else ""),
            good=(
                f"{held} of {len(self.requirements)} requirements held by"
                f" {self.scenario.flights.autopilot.name} on {self.scenario.flights.fitted.vehicle.name};"
                f" {spent} missions flown"
            ),
            worst=worst,
            next_step=next_step,
            sections=(
                Section(tables=(_table(self.requirements),)),
                *(
                    Section(f"Failures of: {one.requirement.name}", tuple(_drawn(one)))
                    for one in judged
                    if one.likeliest
                ),
                Section("Not judged", tuple(one.why_not for one in self.requirements if one.why_not)),
                Section(
                    "Notes",
                    (
                        "The probability is that of the distributions in [verification] and of the"
                        " covariance; it is no surer than these.",
                        *self.scenario.notes,
                        *self.scenario.flights.left_out,
                    ),
                    details=True,
                ),
            ),
        )


def _worst(found: RareFailures) -> tuple[str, str]:
    """The worst problem, and what to do about it."""
    again = f"seatrial rare {found.scenario.source}"
    if found.interrupted:
        return "Ctrl-C ended it early", "run the same command again; finished populations are kept"
    judged = [(one, one.event) for one in found.requirements if one.event is not None]
    apart = [one for one, event in judged if event.agrees is False]
    if apart:
        return (
            f"{apart[0].requirement.name}: importance sampling about the failures disagrees: failures"
            " of another kind may be missing",
            f"fly larger populations: {again} --population {2 * SIZE}",
        )
    failing = [(one, event) for one, event in judged if one.verdict != "held" and event.estimate > 0.0]
    if failing:
        one, event = max(failing, key=lambda pair: pair[1].estimate / pair[0].requirement.allowed)
        return (
            f"{one.requirement.name} fails in {event.estimate:.2g} of the missions"
            f" ({event.interval[0]:.2g} to {event.interval[1]:.2g}); {one.requirement.allowed:.2g} is"
            " allowed",
            "see below what its failures have in common, then change that or tune",
        )
    if any(one.why_not for one in found.requirements):
        one = next(one for one in found.requirements if one.why_not)
        return one.why_not.partition("; ")[0], one.why_not.partition("; ")[2]
    if not judged:
        return "no requirement was judged", "state requirements in the campaign"
    one, event = max(judged, key=lambda pair: pair[1].interval[1])
    if one.verdict != "held":
        return (
            f"{one.requirement.name}: at most {event.interval[1]:.2g} of the missions fail, more than the"
            f" {one.requirement.allowed:.2g} that are allowed",
            f"fly larger populations: {again} --population {2 * SIZE}",
        )
    return (
        f"{one.requirement.name} fails most often, in at most {event.interval[1]:.2g} of the missions",
        "ask whether the distributions in [verification] are wide enough: the figure is no surer than they",
    )


def _table(requirements: Sequence[RareRequirement]) -> Table:
    rows = []
    for one in requirements:
        event = one.event
        if event is None:
            rows.append((
                one.requirement.name,
                one.verdict,
                "",
                "",
                f"{one.requirement.allowed:.2g}",
                "",
                "",
                "",
            ))
            continue
        low, high = event.interval
        check = event.check
        rows.append((
            one.requirement.name,
            one.verdict,
            f"{event.estimate:.2g}" if event.estimate else "none found",
            f"{low:.2g} to {high:.2g}",
            f"{one.requirement.allowed:.2g}",
            "" if check is None or event.agrees is None else f"{check.estimate:.2g}",
            f"{event.evaluations}",
            f"{event.plain:.2g}" if math.isfinite(event.plain) else "",
        ))
    head = (
        "requirement",
        "verdict",
        "fails in",
        f"{100 * (requirements[0].event.confidence if requirements and requirements[0].event else 0.95):g} %",
        "allowed",
        "check",
        "missions",
        "plain sampling",
    )
    return Table.of(
        "Failure probabilities", head, rows, left=2, note="plain sampling: missions for the same interval"
    )


def _drawn(one: RareRequirement) -> list[str]:
    """What failing missions have in common, and how far out the likeliest is."""
    said = [
        f"{name}: mean {mean:.3g} in failures, {usual:.3g} in all draws ({shift:+.1f} sd);"
        f" {one.likeliest[name]:.3g} in the likeliest failure"
        for name, (mean, usual, shift) in list(one.common.items())[:_SHOWN]
        if abs(shift) >= _SHIFTED
    ]
    return [
        *(said or ["nothing that is drawn stands out: noise, gusts or many small things"]),
        f"the likeliest failure lies {one.nearest_deviations:.1f} standard deviations from the middle of all"
        " draws, besides noise and gusts",
    ]
