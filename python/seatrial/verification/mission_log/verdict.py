"""The verdict on a log: is the model still valid, what is suspected, and did the mission hold what it had to.

A log on which nothing could have been noticed does not speak for the model: where a controlled axis is left
unjudged, or the errors exceed what noise and stated intervals explain, the verdict is "not judged": exit code
1, an outcome of its own in JSON, an error in JUnit. Held by ``test_recorded_verdict.py``,
``test_recorded_campaign.py`` and ``test_recorded_validity.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from seatrial.base.finding import Finding
from seatrial.base.plain import Plain
from seatrial.base.report import Reported, writer_of
from seatrial.base.run import RunDirectory, run_facts, sha256, to_json
from seatrial.base.work import Clock
from seatrial.verification.mission_log.power import Power
from seatrial.verification.mission_log.validity import Validity

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.flight.mission import Mission
    from seatrial.problem.problem import Problem
    from seatrial.verification.mission_log.candidates import Suspect
    from seatrial.verification.mission_log.log import Envelope, MissionLog
    from seatrial.verification.mission_log.metrics import LoggedStep
    from seatrial.verification.mission_log.validity import Contradiction

ModelState = Literal["model still valid", "re-identify", "log too short or too quiet to tell", "not judged"]

LogOutcome = Literal["held", "failed", "undecided", "not judged"]


@dataclass(frozen=True)
class JudgedRequirement:
    """A requirement on the log's own mission: whether it was held, and its reserve in `unit`.

    ``held`` is None where the log does not tell a metric that it needs; ``missing`` names those.
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


@dataclass(frozen=True, eq=False, repr=False)
class LogVerdict(
    Reported,
    Plain,
    only="log=log.trial.name outcome held model reason validity suspects contradictions power metrics"
    " requirements steps envelope current_m_s=current notes",
):
    """What a log says of the model and of the mission.

    Attributes
    ----------
    log
        What was judged.
    model
        "model still valid", "re-identify", "log too short or too quiet to tell" where a doubt is left, or
        "not judged" where the log could not have refuted the model on every controlled axis.
    cause
        Why; ``reason`` says it in words.
    validity
        Share outside the 95 % band per channel; None where no window could be judged.
    suspects
        What may have changed, the one that explains most first; empty where
        nothing fails.
    power
        What this log would have shown of each group of coefficients, and what it refutes; None where no
        window could be judged.
    metrics
        Of the log's own mission, by the names of `Flight.metrics`.
    requirements, steps
        Requirements on them, and set-point steps against their corridors.
    envelope
        Of the mission in closed loop; None where it was not asked for.
    contradictions
        Channels of the log that tell of two motions: a sensor is wrong, and the model is not judged.
    remarks
        What was not known; ``notes`` says it in sentences.
    hidden
        Channels that do not judge the model, since commands answer waves and noise on their axes.
    current
        Steady current north and east, m/s, that was fitted to a log which tells none; else None.
    vehicle, autopilot, mission
        The model, and what was flown where that was given.
    clock
        When it was judged, and how long that took.
    """

    log: MissionLog
    model: ModelState
    cause: Finding
    validity: Validity | None
    suspects: tuple[Suspect, ...]
    power: Power | None
    metrics: Mapping[str, Any]
    requirements: tuple[JudgedRequirement, ...]
    steps: tuple[LoggedStep, ...]
    envelope: Envelope | None
    remarks: tuple[Finding, ...]
    vehicle: Vehicle
    autopilot: Autopilot | None = None
    mission: Mission | None = None
    current: tuple[float, float] | None = None
    contradictions: tuple[Contradiction, ...] = ()
    hidden: tuple[str, ...] = ()
    clock: Clock = field(default_factory=Clock)

    @property
    def reason(self) -> str:
        """Why the model has its state, in words."""
        return str(writer_of(self).reason(self))

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on what was not known."""
        return tuple(writer_of(self).notes(self))

    @property
    def valid(self) -> bool:
        """Whether the log speaks for the model."""
        return self.model == "model still valid"

    @property
    def outcome(self) -> LogOutcome:
        """Of model and mission together.

        "failed" where the model is refuted or a requirement or corridor broken, "not judged" where the log
        could not have refuted the model, "undecided" where it leaves a doubt or tells no metric that a
        requirement needs, otherwise "held". Requirements on the truth (``true_...``) do not count.
        """
        broken = any(requirement.held is False for requirement in self.requirements)
        if self.model == "re-identify" or broken or any(step.criterion > 0.0 for step in self.steps):
            return "failed"
        if self.model == "not judged":
            return "not judged"
        known = all(asked.held is not None or asked.beyond_logs for asked in self.requirements)
        return "held" if self.valid and known else "undecided"

    @property
    def held(self) -> bool:
        """Whether the outcome is "held": what was not shown does not pass."""
        return self.outcome == "held"

    def junit(self) -> str:
        """JUnit XML with a case for the model, and one per requirement and step of a set point."""
        return str(writer_of(self).junit(self))

    def inputs(self) -> dict[str, str]:
        """Text of the files that were judged with, by name: vehicle, autopilot, mission."""
        found = {"vehicle.toml": self.vehicle.to_toml()}
        if self.autopilot is not None:
            found["autopilot.toml"] = self.autopilot.to_toml()
        if self.mission is not None:
            found["mission.toml"] = self.mission.to_toml()
        return found

    def save(self, folder: str | Path, *, problem: Problem | None = None, source: str | Path = "") -> Path:
        """Path of a run directory with the verdict, a summary, the inputs and their hashes.

        `plot` draws its figures.

        Parameters
        ----------
        folder : str or Path
            Made when it does not exist; an earlier run's is replaced.
        problem : Problem, optional
            That of the campaign, where one judged.
        source : str or Path, optional
            The log, as it was named; by default the name of its trial.

        Raises
        ------
        SeatrialError
            The directory cannot be written; nothing is left half-written.
        """
        facts = _facts(self, problem, source or self.log.trial.name)
        with RunDirectory(folder) as run:
            return run.publish(facts, _files(self, problem))


def _files(found: LogVerdict, problem: Problem | None) -> dict[str, str | bytes]:
    """Files of a run directory by name."""
    return {
        **_inputs(found, problem),
        "verdict.json": to_json(found.to_dict()),
        "junit.xml": found.junit(),
        **found.report().files(),
    }


def _facts(found: LogVerdict, problem: Problem | None, source: str | Path) -> dict[str, Any]:
    """What the verdict rests on."""
    hashes = {} if problem is None else problem.input_hashes(trials=False)
    hashes |= {name: sha256(text) for name, text in _inputs(found, problem).items()}
    if (log := _file(source)) is not None:
        hashes["log"] = sha256(log.read_bytes())
    return run_facts(
        "log verdict",
        found.log.trial.name if problem is None else problem.name,
        clock=found.clock,
        inputs=hashes,
        seed=None if problem is None else problem.seed,
        options={"log": str(source)},
    )


def _inputs(found: LogVerdict, problem: Problem | None) -> dict[str, str]:
    return found.inputs() if problem is None else {"campaign.toml": problem.text, **found.inputs()}


def _file(source: str | Path) -> Path | None:
    path = Path(source)
    path = path / "flight.parquet" if path.is_dir() else path
    return path if path.is_file() else None
