"""Result of a bench test: fits per group, motors, the vehicle with both written in, sentences, files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.bench_test.bench_text import motor_sentences, pull_sentences
from seatrial.errors import SeatrialError, reason
from seatrial.run_directory import RUN_FILE, RunDirectory, to_json
from seatrial.whole_file import write_whole

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.bench_test.bench_file import BenchFile
    from seatrial.bench_test.pull_points import PullPoints
    from seatrial.bench_test.unit_fit import UnitFit
    from seatrial.motor_dynamics import MotorEstimate, StepRecord

__all__ = ["BenchTest"]


@dataclass(frozen=True, eq=False)
class BenchTest:
    """A bench test, evaluated.

    Attributes
    ----------
    file, text
        The bench file, and its text.
    pulls
        Per group (or actuators tested alone) the fitted characteristic.
    records
        Per pull its operating points.
    motors
        Per group the motor that follows from its steps.
    step_records
        Per group the records behind its motor.
    before, vehicle
        The vehicle as it was, and with the results.
    vehicle_path
        File of the vehicle; None for a built-in one or one that was given.
    vehicle_text
        Its file with the results written in, comments kept.
    warnings, notes
        What looks wrong, and what was written or left out.
    facts
        Versions and hashes of the inputs.
    """

    file: BenchFile
    text: str
    pulls: Mapping[str, UnitFit]
    records: Mapping[str, PullPoints]
    motors: Mapping[str, MotorEstimate]
    step_records: Mapping[str, tuple[StepRecord, ...]]
    before: Vehicle
    vehicle: Vehicle
    vehicle_path: Path | None
    vehicle_text: str
    warnings: tuple[str, ...]
    notes: tuple[str, ...]
    facts: Mapping[str, Any]

    def sentences(self) -> list[str]:
        """What the test says, in sentences; warnings begin with WARNING."""
        said = []
        for record in self.records.values():
            said += [f"pull {record.name}: {note}" for note in record.notes]
        for unit, fit in self.pulls.items():
            own = [record for record in self.records.values() if record.name in fit.points.pull]
            said += pull_sentences(unit, fit, own)
        for unit, motor in self.motors.items():
            said += motor_sentences(unit, motor)
        return said + [f"WARNING: {text}" for text in self.warnings] + list(self.notes)

    def to_dict(self) -> dict[str, Any]:
        """All of it as plain data for JSON."""
        return {
            "name": self.file.name,
            "vehicle": self.before.name,
            "facts": dict(self.facts),
            "pulls": {unit: _unit_dict(fit) for unit, fit in self.pulls.items()},
            "records": {name: _record_dict(record) for name, record in self.records.items()},
            "motors": {unit: motor.to_dict() for unit, motor in self.motors.items()},
            "sentences": self.sentences(),
            "warnings": list(self.warnings),
        }

    def save(self, run_dir: str | Path) -> Path:
        """Path of a run directory with the results: JSON, points, bench file, vehicle file.

        Parameters
        ----------
        run_dir : str or Path
            Made when it does not exist; an earlier run's is replaced.

        Raises
        ------
        SeatrialError
            The directory cannot be written; nothing is left half-written.
        """
        directory = RunDirectory(run_dir)
        files = {
            RUN_FILE: to_json(self.facts),
            "bench.toml": self.text,
            "bench.json": to_json(self.to_dict()),
            "vehicle.toml": self.vehicle_text,
            "summary.txt": "\n".join(self.sentences()) + "\n",
            "points.csv": self.points_csv(),
        }
        try:
            return directory.publish(files)
        except BaseException:  # Ctrl-C too: nothing here is worth resuming
            directory.discard()
            raise

    def points_csv(self) -> str:
        """Operating points of all groups as CSV, with what was fitted and which are outliers."""
        import io

        import polars as pl

        rows: list[dict[str, Any]] = []
        for unit, fit in self.pulls.items():
            points = fit.points
            volts = points.voltage if fit.regression.with_voltage else None
            fitted = fit.thrust(points.signal, volts)
            named = {int(k) for one in fit.directions.values() for k in one.outliers}
            rows += [
                {
                    "group": unit,
                    "pull": points.pull[k],
                    "place": points.place[k],
                    f"signal_{fit.unit.command}": points.signal[k],
                    "voltage_v": None if np.isnan(points.voltage[k]) else points.voltage[k],
                    "thrust_n": points.thrust[k],
                    "standard_error_n": None if np.isnan(points.error[k]) else points.error[k],
                    "fitted_n": fitted[k],
                    "outlier": k in named,
                }
                for k in range(len(points.signal))
            ]
        stream = io.BytesIO()
        pl.DataFrame(rows, infer_schema_length=None).write_csv(stream)
        return stream.getvalue().decode()

    def write_vehicle(self, path: str | Path, *, replace: bool = False) -> Path:
        """Path of the vehicle file with the results after it was written, whole or not at all.

        Parameters
        ----------
        path : str or Path
        replace : bool
            Whether a file of that name may be replaced.

        Raises
        ------
        SeatrialError
            There is such a file already, or it cannot be written.
        """
        target = Path(path)
        if target.exists() and not replace:
            raise SeatrialError(
                f"{target}: this file exists and is not overwritten; give another name, or --in-place for the"
                " vehicle file of the bench test"
            )
        try:
            write_whole(target, self.vehicle_text.encode())
        except OSError as error:
            raise SeatrialError(
                f"{target}: cannot be written ({reason(error)}); choose a place that you may write to"
            ) from None
        return target


def _unit_dict(fit: UnitFit) -> dict[str, Any]:
    points = fit.points
    found: dict[str, Any] = {
        "actuators": list(fit.unit.actuators),
        "unit": fit.unit.command,
        "kind": fit.kind,
        "order": fit.regression.order,
        "points": len(points.signal),
        "directions": {
            side: one.to_dict()
            | {"outliers": [f"pull {points.pull[k]}, {points.place[k]}" for k in one.outliers]}
            for side, one in fit.directions.items()
        },
    }
    if fit.table is not None:
        found["table"] = {
            "signal": fit.table.signal,
            "voltage_v": fit.table.voltage,
            "force_n": fit.table.force,
            "dead_band": list(fit.table.dead_band),
            "errors": fit.table.errors(),
        }
    return found


def _record_dict(record: PullPoints) -> dict[str, Any]:
    return {
        "file": record.file,
        "points": len(record.signal),
        "factors": {"+".join(names): factor for names, factor in record.factors.items()},
        "tare_n": record.tare,
        "tare_sd_n": record.zero_error,
        "notes": list(record.notes),
    }
