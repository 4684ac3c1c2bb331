"""Verification: what a campaign of missions says of an autopilot, for people, for machines and as files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seatrial.run_directory import RunDirectory
from seatrial.verification import failure_probability
from seatrial.verification.campaign_flights import CampaignFlights
from seatrial.verification.comparison_of_autopilots import AutopilotComparison
from seatrial.verification.flown_missions import FlownMissions
from seatrial.verification.judged_requirement import JudgedRequirement

if TYPE_CHECKING:
    import polars as pl

    from seatrial.campaign import Campaign
    from seatrial.flight.flight import Flight

__all__ = ["Verification"]


@dataclass(frozen=True, eq=False)
class Verification:
    """What missions flown by drawn vehicles say of an autopilot; made by `seatrial.verify`.

    Attributes
    ----------
    campaign
        What was asked for.
    flights
        What was flown, and how to fly any of it again.
    flown
        All missions: figures, what was drawn, times.
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
    """

    campaign: Campaign
    flights: CampaignFlights
    flown: FlownMissions
    requirements: tuple[JudgedRequirement, ...]
    comparison: AutopilotComparison | None
    asked: int
    interrupted: bool
    notes: tuple[str, ...]

    @property
    def verdict(self) -> failure_probability.Verdict:
        """Held where every requirement is, failed where any is, undecided otherwise.

        That all are held is wrong at most as often as a single one (Berger 1982, Technometrics 24:295): no
        correction is needed. Of m requirements that just hold, up to m times the risk are called failed.
        """
        verdicts = {one.verdict for one in self.requirements}
        if "failed" in verdicts:
            return "failed"
        return "undecided" if "undecided" in verdicts else "held"

    @property
    def held(self) -> bool:
        """Whether every requirement is held."""
        return self.verdict == "held"

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
        """Flight of a mission by its number, with its log; figures are those of the verification to the bit.

        Parameters
        ----------
        number : int
            From 0 on; also one beyond those that were flown.
        """
        return self.flights.replay(number)

    def table(self) -> pl.DataFrame:
        """Table with a row per mission: figures and what was drawn."""
        return self.flown.table(self.flights.titles)

    def summary(self) -> str:
        """Text that a control engineer reads: verdicts, causes, worst missions and how to fly them again."""
        from seatrial.verification.verification_text import summary

        return summary(self)

    def to_dict(self) -> dict[str, Any]:
        """Everything but the missions as plain data."""
        return {
            "campaign": self.campaign.name,
            "verdict": self.verdict,
            "interrupted": self.interrupted,
            "missions": {"asked": self.asked, "flown": len(self.flown), "of": list(self.flights.titles)},
            "vehicle": self.flights.fitted.vehicle.name,
            "autopilot": self.flights.autopilot.name,
            "seed": self.flights.seed,
            "requirements": [one.to_dict() for one in self.requirements],
            "comparison": None if self.comparison is None else self.comparison.to_dict(),
            "time": {
                "flown_s": self.flown.flown_s,
                "wall_s": self.flown.wall_s,
                "real_time_factor": self.flown.real_time_factor,
                "missions_per_s": self.flown.per_second,
            },
            "notes": list(self.notes),
            "left_out": list(self.flights.left_out),
        }

    def junit(self) -> str:
        """JUnit XML with a case per requirement; undecided is a failure."""
        from seatrial.verification.verification_files import junit

        return junit(self)

    def save(self, run_dir: str | Path) -> Path:
        """Path of a run directory with JSON, Parquet, JUnit XML, summary, worst missions and inputs.

        Parameters
        ----------
        run_dir : str or Path
            Made when it does not exist; an earlier run's is replaced.

        Raises
        ------
        SeatrialError
            The directory cannot be written; nothing is left half-written.
        """
        return self.publish(RunDirectory(run_dir))

    def publish(self, directory: RunDirectory) -> Path:
        """Path of an opened run directory after the results are in it. See `save`.

        Parameters
        ----------
        directory : RunDirectory
        """
        from seatrial.verification.verification_files import files

        return directory.publish(files(self))

    def worst(self) -> Mapping[str, list[int]]:
        """Numbers of the worst missions by requirement, the worst first."""
        return {one.requirement.name: [run.number for run in one.worst] for one in self.requirements}

    def __str__(self) -> str:
        return self.summary()
