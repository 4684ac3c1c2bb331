"""Result of a bench test: fits per group, motors, the vehicle with both written in, sentences, files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.errors import SeatrialError
from seatrial.base.files import write_atomic, writing
from seatrial.base.report import Reported, words_about
from seatrial.base.run import RunDirectory, to_json

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.bench_test.characteristic import UnitFit
    from seatrial.bench_test.file import BenchFile
    from seatrial.bench_test.motor_estimate import MotorEstimate
    from seatrial.bench_test.motor_model import StepRecord
    from seatrial.bench_test.pulls import PullPoints


@dataclass(frozen=True, eq=False, repr=False)
class BenchTest(Reported):
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
        return words_about(self, "bench_sentences")

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
        files = {
            "bench.toml": self.text,
            "bench.json": to_json(self.to_dict()),
            "vehicle.toml": self.vehicle_text,
            **self.report().files(),
            "points.csv": self.points_csv(),
        }
        with RunDirectory(run_dir) as run:
            return run.publish(self.facts, files)

    def points_csv(self) -> str:
        """Operating points of all groups as CSV, with what was fitted and which are outliers."""
        import io

        import polars as pl

        rows: list[dict[str, Any]] = []
        for unit, fit in self.pulls.items():
            points = fit.points
            volts = points.voltage_v if fit.regression.with_voltage else None
            fitted = fit.thrust(points.signal, volts)
            named = {int(k) for direction in fit.directions.values() for k in direction.outliers}
            rows += [
                {
                    "group": unit,
                    "pull": points.pull[k],
                    "place": points.label[k],
                    f"signal_{fit.unit.command}": points.signal[k],
                    "voltage_v": None if np.isnan(points.voltage_v[k]) else points.voltage_v[k],
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

    def save_vehicle(self, path: str | Path, *, replace: bool = False) -> Path:
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
        with writing(target):
            write_atomic(target, self.vehicle_text.encode())
        return target


def _unit_dict(fit: UnitFit) -> dict[str, Any]:
    points = fit.points
    unit: dict[str, Any] = {
        "actuators": list(fit.unit.actuators),
        "unit": fit.unit.command,
        "kind": fit.kind,
        "order": fit.regression.order,
        "points": len(points.signal),
        "directions": {
            side: direction.to_dict()
            | {"outliers": [f"pull {points.pull[k]}, {points.label[k]}" for k in direction.outliers]}
            for side, direction in fit.directions.items()
        },
    }
    if fit.table is not None:
        unit["table"] = {
            "signal": fit.table.signal,
            "voltage_v": fit.table.voltage_v,
            "force_n": fit.table.force,
            "dead_band": list(fit.table.dead_band),
            "errors": fit.table.errors(),
        }
    return unit


def _record_dict(record: PullPoints) -> dict[str, Any]:
    return {
        "file": record.file,
        "points": len(record.signal),
        "factors": {"+".join(names): factor for names, factor in record.factors.items()},
        "tare_n": record.tare,
        "tare_sd_n": record.zero_error,
        "notes": list(record.notes),
    }
