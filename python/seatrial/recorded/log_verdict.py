"""The verdict on a log: is the model still valid, what is suspected, and did the mission hold what it had to.

Tests: ``tests/test_recorded_verdict.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.mission import Mission
    from seatrial.recorded.envelope import Envelope
    from seatrial.recorded.mission_log import MissionLog
    from seatrial.recorded.set_point_steps import LoggedStep
    from seatrial.recorded.suspect import Suspect
    from seatrial.recorded.validity import Validity
    from seatrial.verification.failure_probability import Verdict

__all__ = ["Detectable", "JudgedRequirement", "LogVerdict", "Outcome"]

Outcome = Literal["model still valid", "re-identify", "log too short or too quiet to tell"]


@dataclass(frozen=True)
class Detectable:
    """A change of the vehicle and the chance that this log would have shown it."""

    change: str
    power: float


@dataclass(frozen=True)
class JudgedRequirement:
    """A requirement on the log's own mission: whether it was held, and its reserve in `unit`.

    ``held`` is None where the log does not tell a figure that it needs; ``missing`` names those.
    """

    name: str
    holds: str
    held: bool | None
    reserve: float
    unit: str
    missing: tuple[str, ...] = ()

    @property
    def beyond_logs(self) -> bool:
        """Whether it needs the truth, which no log tells: it is none of the log's business."""
        return any(name.startswith("true_") for name in self.missing)


@dataclass(frozen=True, eq=False)
class LogVerdict:
    """What a log says of the model and of the mission.

    Attributes
    ----------
    log
        What was judged.
    outcome
        "model still valid", "re-identify" or "log too short or too quiet to tell".
    reason
        A sentence.
    validity
        Share outside the 95 % band per channel; None where no window could be judged.
    suspects
        What may have changed, the one that explains most first; empty where
        nothing fails.
    detectable
        What this log would have shown, with the chance.
    figures
        Of the log's own mission, by the names of `Flight.figures`.
    requirements, steps
        Requirements on them, and set-point steps against their corridors.
    envelope
        Of the mission in closed loop; None where it was not asked for.
    notes
        Sentences on what was not known.
    current
        Steady current north and east, m/s, that was fitted to a log which tells none; else None.
    vehicle, autopilot, mission
        The model, and what was flown where that was given.
    """

    log: MissionLog
    outcome: Outcome
    reason: str
    validity: Validity | None
    suspects: tuple[Suspect, ...]
    detectable: tuple[Detectable, ...]
    figures: Mapping[str, Any]
    requirements: tuple[JudgedRequirement, ...]
    steps: tuple[LoggedStep, ...]
    envelope: Envelope | None
    notes: tuple[str, ...]
    vehicle: Vehicle
    autopilot: Autopilot | None = None
    mission: Mission | None = None
    current: tuple[float, float] | None = None

    @property
    def valid(self) -> bool:
        """Whether the log speaks for the model."""
        return self.outcome == "model still valid"

    @property
    def verdict(self) -> Verdict:
        """Of model and mission together, in the words of a verification.

        "failed" where the model is refuted or a requirement or corridor broken, "undecided" where the log
        cannot tell one of them, otherwise "held". Requirements on the truth (``true_...``) do not count.
        """
        broken = any(one.held is False for one in self.requirements)
        if self.outcome == "re-identify" or broken or any(step.criterion > 0.0 for step in self.steps):
            return "failed"
        told = self.valid and all(one.held is not None or one.beyond_logs for one in self.requirements)
        return "held" if told else "undecided"

    @property
    def passed(self) -> bool:
        """Whether the verdict is "held": what was not shown does not pass."""
        return self.verdict == "held"

    def summary(self) -> str:
        """Text that a control engineer reads."""
        from seatrial.recorded.verdict_text import summary

        return summary(self)

    def to_dict(self) -> dict[str, Any]:
        """Everything but the samples as plain data."""
        return {
            "log": self.log.trial.name,
            "outcome": self.outcome,
            "reason": self.reason,
            "verdict": self.verdict,
            "passed": self.passed,
            "validity": None if self.validity is None else self.validity.to_dict(),
            "suspects": [one.to_dict() for one in self.suspects],
            "detectable": [{"change": one.change, "power": one.power} for one in self.detectable],
            "figures": dict(self.figures),
            "requirements": [
                {
                    "name": one.name,
                    "holds": one.holds,
                    "held": one.held,
                    "reserve": one.reserve,
                    "unit": one.unit,
                    "missing": list(one.missing),
                }
                for one in self.requirements
            ],
            "steps": [step.to_dict() for step in self.steps],
            "envelope": None if self.envelope is None else self.envelope.to_dict(),
            "current_m_s": None if self.current is None else list(self.current),
            "notes": list(self.notes),
        }

    def inputs(self) -> dict[str, str]:
        """Text of the files that were judged with, by name: vehicle, autopilot, mission."""
        found = {"vehicle.toml": self.vehicle.to_toml()}
        if self.autopilot is not None:
            found["autopilot.toml"] = self.autopilot.to_toml()
        if self.mission is not None:
            found["mission.toml"] = self.mission.to_toml()
        return found

    def save_figures(self, folder: str | Path, *, formats: tuple[str, ...] = ("png", "pdf")) -> list[Path]:
        """Paths of the figures: residuals, suspects, envelope, those that there are.

        Parameters
        ----------
        folder : str or Path
            Made when it does not exist.
        formats : tuple of str, optional
            Endings.

        Raises
        ------
        SeatrialError
            The folder cannot be written.
        """
        from seatrial.plot.envelope import envelope_page, residual_page, suspect_bars
        from seatrial.plot.style import save

        written: list[Path] = []
        if self.validity is not None:
            written += save(residual_page(self), Path(folder) / "residuals", formats=formats)
        if self.suspects:
            written += save(suspect_bars(self), Path(folder) / "suspects", formats=formats)
        if self.envelope is not None:
            written += save(envelope_page(self), Path(folder) / "envelope", formats=formats)
        return written

    def __str__(self) -> str:
        return self.summary()
