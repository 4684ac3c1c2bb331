"""Verification: what many missions say of an autopilot, for people, for machines and as files.

Tests: ``tests/verification/test_verify.py``, ``tests/cli/test_cli_verify.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.chunks import RECORDS
from seatrial.base.report import writer_of
from seatrial.base.run import Content, RunResult, to_json
from seatrial.flight.excesses import KINDS, Excess, excesses, sentences
from seatrial.statistics import proportions
from seatrial.verification.comparison import AutopilotComparison
from seatrial.verification.flown_missions import FlownMissions
from seatrial.verification.judgement import JudgedRequirement
from seatrial.verification.regression import FlownCase

if TYPE_CHECKING:
    import polars as pl

    from seatrial.flight.flight import Flight
    from seatrial.flight.mission import Mission
    from seatrial.verification.missions import CampaignFlights
    from seatrial.verification.scenario import Scenario


@dataclass(frozen=True, eq=False, repr=False)
class Verification(RunResult):
    """What missions flown by drawn vehicles say of an autopilot; made by `seatrial.verify`.

    Attributes
    ----------
    scenario
        What was flown, and how to fly any of it again.
    flown
        All missions: metrics, what was drawn, times.
    requirements
        A `JudgedRequirement` each: failures, interval, verdict, worst missions, causes.
    comparison
        Other autopilots on the same draws; None where none was asked for.
    asked
        Missions that were asked for.
    interrupted
        Whether Ctrl-C ended them early: the verdict is that of the missions until then.
    notes
        Sentences on what is assumed and what was drawn; ``flights.left_out`` says more.
    doubt
        Heading where many of the drawn vehicles were physically impossible; empty otherwise.
    facts
        What the result rests on, see `seatrial.base.run.run_facts`.
    cases
        The regression cases of the campaign, flown.
    records
        Where and how each chunk of missions was flown, see `seatrial.base.chunks`.
    """

    scenario: Scenario
    flown: FlownMissions
    requirements: tuple[JudgedRequirement, ...]
    comparison: AutopilotComparison | None
    asked: int
    interrupted: bool
    notes: tuple[str, ...]
    doubt: str
    facts: Mapping[str, Any]
    cases: tuple[FlownCase, ...] = ()
    records: tuple[Mapping[str, Any], ...] = ()

    @property
    def flights(self) -> CampaignFlights:
        """What was flown."""
        return self.scenario.flights

    @property
    def outcome(self) -> proportions.Verdict:
        """Held where every requirement and regression case is, failed where any is, undecided otherwise.

        That all are held is wrong at most as often as a single one (Berger 1982, Technometrics 24:295): no
        correction is needed. Of m requirements that just hold, up to m times the risk are called failed.
        """
        verdicts = {one.verdict for one in self.requirements}
        if "failed" in verdicts or not all(one.held for one in self.cases):
            return "failed"
        return "undecided" if "undecided" in verdicts else "held"

    @property
    def held(self) -> bool:
        """Whether every requirement is held."""
        return self.outcome == "held"

    @cached_property
    def excesses(self) -> tuple[Excess, ...]:
        """What every user would call a failure of a mission, required or not."""
        flown = self.flown
        missions = self.flights.missions

        def of_each(value: Callable[[Mission], float]) -> Array:
            return np.array([value(mission) for mission in missions])[flown.mission]

        return tuple(
            excesses(
                flown.metrics,
                of_each(lambda mission: mission.promised_m),
                max_depth_m=of_each(lambda mission: mission.limits["max_depth_m"]),
                min_altitude_m=of_each(lambda mission: mission.limits["min_altitude_m"]),
                complete=flown.metrics["ending"] == "complete",
                battery_wh=self.flights.fitted.vehicle.power().get("battery_wh", math.inf),
            )
        )

    @property
    def reservations(self) -> tuple[Excess, ...]:
        """Excesses on which no requirement decides: with them, "held" is said with a reservation."""
        asked = {name for one in self.requirements for name in one.requirement.metrics}
        return tuple(excess for excess in self.excesses if not asked & set(KINDS[excess.kind].metrics))

    def requirement(self, name: str) -> JudgedRequirement:
        """The requirement with a name.

        Parameters
        ----------
        name : str

        Raises
        ------
        KeyError
            There is none.
        """
        for one in self.requirements:
            if one.requirement.name == name:
                return one
        raise KeyError(name)

    def replay(self, number: int) -> Flight:
        """Flight of a mission by its number, with its log; metrics are those of the verification to the bit.

        Parameters
        ----------
        number : int
            From 0 on; also one beyond those that were flown.
        """
        return self.flights.replay(number)

    def table(self) -> pl.DataFrame:
        """Table with a row per mission: metrics and what was drawn."""
        return self.flown.table(self.flights.titles)

    def to_dict(self) -> dict[str, Any]:
        """Everything but the missions as plain data."""
        return {
            "campaign": self.scenario.name,
            "outcome": self.outcome,
            "reservations": [
                excess.to_dict() | {"worst": int(self.flown.numbers[excess.worst]), "sentence": sentence}
                for excess, sentence in zip(
                    self.reservations, excess_sentences(self, self.reservations), strict=True
                )
            ],
            "interrupted": self.interrupted,
            "missions": {"asked": self.asked, "flown": len(self.flown), "of": list(self.flights.titles)},
            "vehicle": self.flights.fitted.vehicle.name,
            "autopilot": self.flights.autopilot.name,
            "seed": self.flights.seed,
            "requirements": [one.to_dict() for one in self.requirements],
            "comparison": None if self.comparison is None else self.comparison.to_dict(),
            "cases": [one.to_dict() for one in self.cases],
            "time": {
                "flown_s": self.flown.flown_s,
                "wall_s": self.flown.wall_s,
                "real_time_factor": self.flown.real_time_factor,
                "missions_per_s": self.flown.per_second,
            },
            "notes": list(self.notes),
            "doubt": self.doubt,
            "warnings": self.flights.warnings,
            "left_out": list(self.flights.left_out),
        }

    def junit(self) -> str:
        """JUnit XML with a case per requirement; undecided is a failure."""
        return str(writer_of(self).junit(self))

    def files(self) -> dict[str, Content]:
        """Files of the run directory by name, see `save`."""
        worst = {one.requirement.name: [run.to_dict() for run in one.worst] for one in self.requirements}
        return {
            **self.scenario.files(),
            "verification.json": to_json(self.to_dict()),
            **self.report().files(),
            "junit.xml": self.junit(),
            "worst_runs.json": to_json(worst),
            "missions.parquet": partial(self.flown.write_table, self.flights.titles),
            RECORDS: to_json(self.records),
        }

    def worst(self) -> Mapping[str, list[int]]:
        """Numbers of the worst missions by requirement, the worst first."""
        return {one.requirement.name: [run.number for run in one.worst] for one in self.requirements}


def excess_sentences(found: Verification, several: Sequence[Excess]) -> list[str]:
    """A sentence for each excess: how many missions, the worst one and when."""
    flown, titles = found.flown, found.flights.titles

    def name(row: int) -> str:
        of = f" ({titles[flown.mission[row]]})" if len(titles) > 1 else ""
        return f"mission {flown.numbers[row]}{of}"

    return sentences(several, name)
