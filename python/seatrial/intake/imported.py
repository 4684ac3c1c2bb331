"""What an import made of some logs, and its report: what there is, the worst, what is missing, what next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seatrial.base.report import Reported
from seatrial.inspect.consistency_result import Consistency
from seatrial.inspect.kind_of_data import KindOfData
from seatrial.intake.map_file import Column
from seatrial.intake.survey import Survey

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.trial.trial import Trial


@dataclass(frozen=True, eq=False)
class ImportedTrial:
    """A trial of the project.

    Attributes
    ----------
    name
        Its name in the campaign.
    trial
        As read from its file with the column map.
    hold_out_s
        Proposed part to hold out (start, stop), s; None for none.
    why
        Why that part.
    modes
        Changes of mode: time in s and name.
    consistency
        Whether its channels tell one motion.
    kind
        What was done in it and what spoils it.
    notes
        What the readers and the join did or could not do.
    absent
        Columns of the map whose field its logs have not.
    logs
        Names of its logs.
    """

    name: str
    trial: Trial
    hold_out_s: tuple[float, float] | None
    why: str
    modes: tuple[tuple[float, str], ...]
    consistency: Consistency
    kind: KindOfData
    notes: tuple[str, ...]
    absent: tuple[str, ...]
    logs: tuple[str, ...]


@dataclass(frozen=True, eq=False, repr=False)
class Imported(Reported):
    """What an import made of some logs.

    Attributes
    ----------
    folder
        The project; None where nothing was written.
    survey
        Every topic and field.
    columns
        The map by canonical column (actuators as cmd.<actuator>).
    trials
        In the order of the campaign.
    vehicle
        The vehicle, None while its file is a stub; `vehicle_source` says where it comes from and
        `vehicle_certain` whether the log or the user says so.
    reversed_thrusters
        Those that push against the built-in vehicle's direction; the vehicle file says so.
    unmatched
        Actuators of the vehicle without a command.
    map_source
        The file of the map, or "proposed".
    twice
        Delays that the map's clocks remove and the edited campaign, too.
    refused
        Recordings that made no trial, and why.
    kept
        Files of the project that were edited since the last import and left as they are.
    """

    folder: Path | None
    survey: Survey
    columns: Mapping[str, Column]
    trials: tuple[ImportedTrial, ...]
    vehicle: Vehicle | None
    vehicle_source: str
    vehicle_certain: bool
    reversed_thrusters: tuple[str, ...]
    unmatched: tuple[str, ...]
    refused: tuple[str, ...]
    kept: tuple[str, ...]
    map_source: str
    twice: tuple[str, ...] = ()

    def summary(self) -> str:
        """The report as text."""
        return self.report().text(verbose=False)

    def to_dict(self) -> dict[str, Any]:
        """The import as plain data for JSON."""
        return {
            "folder": None if self.folder is None else str(self.folder),
            "map": self.map_source,
            "columns": {canonical: column.to_dict() for canonical, column in self.columns.items()},
            "trials": [
                {
                    "name": trial.name,
                    "start_s": float(trial.trial.t[0]),
                    "end_s": float(trial.trial.t[-1]),
                    "rate_hz": 1.0 / trial.trial.dt,
                    "channels": trial.trial.channels,
                    "hold_out_s": trial.hold_out_s,
                    "hold_out_why": trial.why,
                    "modes": [{"t": t, "mode": mode} for t, mode in trial.modes],
                    "report": trial.trial.report.to_dict(),
                    "consistency": {
                        key: value
                        for key, value in trial.consistency.to_dict().items()
                        if key in ("corrections", "missing", "compared")
                    },
                    "kind_of_data": trial.kind.to_dict(),
                    "notes": list(trial.notes),
                    "absent": list(trial.absent),
                }
                for trial in self.trials
            ],
            "vehicle": {
                "source": self.vehicle_source,
                "certain": self.vehicle_certain,
                "complete": self.vehicle is not None,
                "reversed": list(self.reversed_thrusters),
                "without_command": list(self.unmatched),
            },
            "refused": list(self.refused),
            "kept": list(self.kept),
            "survey": self.survey.to_dict(),
        }
