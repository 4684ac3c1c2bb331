"""`Flight`: one closed-loop flight, what came of it, and the files and words that tell it.

Metrics carry units in their names. Held by ``tests/flight/test_flight.py``, ``tests/cli/test_cli_fly.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial._core import autopilot_names
from seatrial.base.files import parquet
from seatrial.base.finding import Finding
from seatrial.base.report import Report, Reported, Section, clause_of, report_of, writer_of
from seatrial.base.run import RunDirectory, run_facts, sha256, to_json
from seatrial.base.work import Clock
from seatrial.flight import excesses
from seatrial.flight.findings import Result, findings
from seatrial.flight.log import FlightLog, log_fields
from seatrial.flight.metrics import (
    CODED,
    DIVERGED,
    ActuatorUse,
    Leg,
    Loop,
    actuators_of,
    ending_of,
    legs_of,
    loops_of,
    metrics_of,
)
from seatrial.flight.mismatch import mismatch
from seatrial.flight.reactions import Alert

if TYPE_CHECKING:
    import polars as pl

    from seatrial._core import Flights
    from seatrial.flight.cases import Cases
    from seatrial.flight.payload import Samples


@dataclass(frozen=True, eq=False, repr=False)
class Flight(Reported, FlightLog):
    """A flight of a vehicle with its autopilot on a mission: its log, and what came of it.

    Attributes
    ----------
    vehicle, autopilot, mission, route, circumstances, period_s, t, position, euler, nu, altitude, water
        Log of the flight, see `seatrial.flight.log.FlightLog`, and what it rests on.
    measured, desired, errors, distance, leg, holding, done, mode, modes, alert, cause
        What the autopilot was told, and what guidance and safety made of it.
    commands, actuators, demanded, achieved, power, battery
        What was asked of the actuators, and what became of it.
    outcome
        "complete", "surfaced", "aborted", "out of time" or "diverged".
    metrics
        Metrics of the whole flight, units in the names.
    clock
        When it was computed, and how long that took.
    samples
        What the payload logged; None without one.
    """

    outcome: str
    metrics: Mapping[str, float]
    clock: Clock = field(default_factory=Clock)
    samples: Samples | None = None

    @classmethod
    def of_case(cls, flights: Flights, cases: Cases, *, case: int = 0) -> Flight:
        """Flight of a case of a batch that kept its log.

        Parameters
        ----------
        flights : Flights
        cases : Cases
            What was flown; their circumstances are those of the case.
        case : int, optional
        """
        metrics = metrics_of(flights)
        return cls(
            vehicle=cases.vehicle,
            autopilot=cases.autopilot,
            mission=cases.mission,
            route=cases.route,
            circumstances=cases.circumstances,
            period_s=cases.autopilot.period_s,
            t=np.asarray(flights.t(case)),
            outcome=ending_of(metrics, case),
            metrics={name: float(values[case]) for name, values in metrics.items() if name not in CODED},
            **log_fields(flights, cases.vehicle, cases.autopilot, case),
        )

    def table(self) -> pl.DataFrame:
        """Log with the canonical columns of a trial, beside them what was measured, desired and sampled."""
        table = super().table()
        if self.samples is None:
            return table
        return table.with_columns(**self.samples.log_columns(len(self.t))).fill_nan(None)

    @property
    def diverged(self) -> bool:
        """Whether the motion ended in numbers that are none."""
        return self.outcome == DIVERGED

    @property
    def complete(self) -> bool:
        """Whether the mission was flown to its end, all waypoints reached, its distances and limits kept.

        Limits are those of depth and altitude, by the true motion.
        """
        return self.outcome == "complete" and all(leg.reached for leg in self.legs) and not self.unkept

    @property
    def unkept(self) -> tuple[str, ...]:
        """Distances and limits of the mission that the vehicle truly did not keep, by kind of excess."""
        kinds = excesses.unkept(self.metrics, self.mission.promised_m, self.mission.limits)
        return tuple(kind for kind, broken in kinds.items() if broken)

    @property
    def outcome_in_words(self) -> str:
        """How it ended; one that missed waypoints or kept no distance or limit is not called complete."""
        return str(writer_of(self).outcome(self))

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What makes the flight doubtful before anything flew: an autopilot of another vehicle."""
        mismatched = mismatch(self.autopilot, self.circumstances.model)
        return () if mismatched is None else (f"{clause_of(mismatched, 'flight_findings')}.",)

    @cached_property
    def alerts(self) -> tuple[Alert, ...]:
        """Reactions in the order in which they were called for."""
        names = autopilot_names()
        rows = np.flatnonzero(np.diff(self.alert, prepend=0) > 0)
        return tuple(
            Alert(
                float(self.t[row]), names["reactions"][self.alert[row]], names["watches"][self.cause[row] - 1]
            )
            for row in rows
        )

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """What went wrong with its causes, the gravest first; of a good flight what limits how good it is."""
        result = Result(self.outcome, self.outcome_in_words, self.metrics, self.legs, self.loops, self.alerts)
        return findings(self, result)

    @cached_property
    def legs(self) -> tuple[Leg, ...]:
        """What became of every leg, one per waypoint."""
        return legs_of(self)

    @cached_property
    def loops(self) -> dict[str, Loop]:
        """How the control loops did that were at work, by name."""
        return loops_of(self)

    @cached_property
    def actuator_use(self) -> dict[str, ActuatorUse]:
        """What was asked of every actuator, by name."""
        return actuators_of(self)

    def report(self, *, sections: Sequence[Section] = ()) -> Report:
        """How good the flight was, the worst problem, what to do next; then tables and sentences.

        Parameters
        ----------
        sections : sequence of Section, optional
            Further ones, such as that of many seeds.
        """
        return report_of(self, sections=sections)

    def sentences(self) -> list[str]:
        """What happened, in sentences for a reader of a report."""
        return list(self.report().section("What happened").sentences)

    def to_dict(self) -> dict[str, Any]:
        """Metrics, legs, loops, actuators, reactions and circumstances as plain data, without the log."""
        return {
            "vehicle": self.vehicle.name,
            "autopilot": self.autopilot.name,
            "mission": self.route.name,
            "outcome": self.outcome,
            "complete": self.complete,
            "warnings": list(self.warnings),
            "metrics": dict(self.metrics),
            "legs": [leg.to_dict() for leg in self.legs],
            "loops": {name: loop.to_dict() for name, loop in self.loops.items()},
            "actuators": {name: use.to_dict() for name, use in self.actuator_use.items()},
            "alerts": [asdict(alert) for alert in self.alerts],
            "circumstances": self.circumstances.to_dict(),
            "findings": [finding.to_dict() for finding in self.findings],
            "sentences": self.sentences(),
        } | ({} if self.samples is None else {"payload": self.samples.to_dict()})

    def save(self, folder: str | Path, *, beside: Mapping[str, bytes] | None = None) -> Path:
        """Path of a run directory with the flight: JSON, Parquet, summary and inputs.

        `plot` draws its figures.

        Parameters
        ----------
        folder : str or Path
            Made when it does not exist; an earlier run's is replaced.
        beside : mapping of str to bytes, optional
            Further files by name.

        Raises
        ------
        SeatrialError
            The directory cannot be written; nothing is left half-written.
        """
        with RunDirectory(folder) as run:
            return self.publish(run, beside=beside)

    def publish(self, run: RunDirectory, *, beside: Mapping[str, bytes] | None = None) -> Path:
        """As `save`, with files `beside` it by name, into a directory `run` that is held already."""
        files: dict[str, str | bytes] = {
            **{f"{name}.toml": text for name, text in _inputs(self).items()},
            "flight.json": to_json(self.to_dict()),
            **self.report().files(),
            "flight.parquet": parquet(self.table()),
            **_sampled(self),
            **(beside or {}),
        }
        return run.publish(_facts(self), files)


def _facts(flight: Flight) -> dict[str, Any]:
    """What a flight rests on: versions, machine, seed, hashes of the inputs."""
    return run_facts(
        "flight",
        flight.route.name,
        clock=flight.clock,
        inputs={name: sha256(text) for name, text in _inputs(flight).items()},
        seed=flight.circumstances.seed,
        options=flight.circumstances.to_dict(),
    )


def _inputs(flight: Flight) -> dict[str, str]:
    """Files of the inputs by name, as they were used."""
    texts = {
        "vehicle": flight.vehicle.to_toml(),
        "autopilot": flight.autopilot.to_toml(),
        "mission": flight.mission.to_toml(),
    }
    if flight.samples is not None:
        texts["payload"] = flight.samples.payload.text
    around = flight.circumstances
    models = {"model": around.model.to_toml()}
    if around.aboard is not None and (text := around.aboard.vehicle.to_toml()) != models["model"]:
        models["filter_model"] = text
    return texts | {name: text for name, text in models.items() if text != texts["vehicle"]}


def _sampled(flight: Flight) -> dict[str, bytes]:
    """Files of the samples by name."""
    if flight.samples is None:
        return {}
    table = flight.samples.table()
    return {"samples.parquet": parquet(table), "samples.csv": table.write_csv().encode()}
