"""Result of a bench test: fits per group, motors, the vehicle with both written in, sentences, files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.atomic_write import write_atomic, writing
from seatrial.base.errors import SeatrialError
from seatrial.base.report import Reported
from seatrial.base.run import RunDirectory, to_json
from seatrial.bench_test.characteristic import actuator_ratios
from seatrial.bench_test.vehicle_text import PER_MINUTE

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.bench_test.characteristic import DirectionFit, UnitFit
    from seatrial.bench_test.file import BenchFile
    from seatrial.bench_test.motor_estimate import MotorEstimate
    from seatrial.bench_test.motor_model import StepRecord
    from seatrial.bench_test.pulls import PullPoints


_MOST = 4  # outliers that a sentence names


def pull_sentences(unit: str, fit: UnitFit, records: Sequence[PullPoints]) -> list[str]:
    """What the pulls of a group say: factors, curve, exponent, order, outliers."""
    lines = [f"{unit}: {text}" for text in _factors(records)]
    for side, direction in fit.directions.items():
        lines.append(f"{unit} {side}: {_largest(fit, side)}; {_goodness(direction)}")
        if fit.kind == "quadratic":
            p1, sd = (
                PER_MINUTE * float(x[0])
                for x in (direction.fit.coefficients, direction.fit.standard_deviations)
            )
            lines.append(f"{unit} {side}: p1 = {p1:.5g} ± {sd:.2g} N s², thrust per n|n| with n in rev/s")
        if np.isfinite(direction.exponent[0]) and not fit.regression.with_voltage:
            lines.append(f"{unit} {side}: {exponent_text(direction)}")
        if direction.judgement:
            lines.append(f"{unit} {side}: {direction.judgement}")
        lines += [f"{unit} {side}: {text}" for text in _outliers(fit, direction)]
    if fit.table is not None:
        lines += [f"{unit}: {text}" for text in _table(fit)]
    ratios = [
        f"{'+'.join(names)} {ratio:.3f} ± {sd:.2g}" for names, (ratio, sd) in actuator_ratios(fit).items()
    ]
    if ratios:
        lines.append(f"{unit}: thrust over that of the common curve: {', '.join(ratios)}")
    return lines


def motor_sentences(unit: str, motor: MotorEstimate) -> list[str]:
    """What the steps of a group say."""
    return [f"{unit} motor: {text.removesuffix('.')}" for text in motor.sentences()]


def share(value: float, digits: int = 5) -> str:
    """A share of the scatter in decimals; what would round to one is shown as above the largest one below it.

    Examples
    --------
    >>> share(0.9999), share(0.9999999)
    ('0.99990', '> 0.99999')
    """
    short = f"{value:.{digits}f}"
    return f"> {1.0 - 10.0**-digits:.{digits}f}" if value < 1.0 and float(short) == 1.0 else short


def _factors(records: Sequence[PullPoints]) -> list[str]:
    lines: dict[str, None] = {}
    for record in records:
        for names, factor in record.factors.items():
            many = (
                f"{len(names)} actuators ({', '.join(names)}) pull" if len(names) > 1 else f"{names[0]} pulls"
            )
            lines[f"{many} {factor:.4g} N along the load cell per newton of one"] = None
    return list(lines)


def _largest(fit: UnitFit, side: str) -> str:
    own = fit.points.signal > 0.0 if side == "ahead" else fit.points.signal < 0.0
    k = int(np.flatnonzero(own)[np.abs(fit.points.thrust[own]).argmax()])
    volts = f" and {fit.points.voltage_v[k]:.3g} V" if fit.regression.with_voltage else ""
    return f"{abs(fit.points.thrust[k]):.3g} N at {fit.points.signal[k]:+.4g} {fit.unit.command}{volts}"


def _goodness(direction: DirectionFit) -> str:
    fit = direction.fit
    return (
        f"R2 = 1 - SSE/SST {verb_of(share(fit.r2))} (squared correlation, blind to a wrong gain,"
        f" {verb_of(share(fit.b))}); points scatter by {fit.sigma:.2g} N (standard"
        f" deviation, {fit.dof} degrees of freedom)"
    )


def verb_of(value: str) -> str:
    """The value behind "=", or as it is where it begins with ">"."""
    return value if value.startswith(">") else f"= {value}"


def exponent_text(one: DirectionFit) -> str:
    """Power of the signal with which thrust grows, and whether it is that of n|n|."""
    value, sd = one.exponent
    low, high = one.exponent_interval
    said = (
        f"thrust grows with the {value:.3f} ± {sd:.2g} power of the signal, 95 % interval {low:.2f} to"
        f" {high:.2f}"
    )
    if low <= 2.0 <= high:
        return f"{said}: n|n| (2) lies in it"
    return (
        f'{said}: it differs from n|n| (2); compare order = 2 and order = "points" (a dead band or an offset'
        " of the load cell bends weak points most)"
    )


def _outliers(fit: UnitFit, direction: DirectionFit) -> list[str]:
    if not len(direction.outliers):
        return []
    points = fit.points
    kept = fit.regression.outliers == "keep"
    shown = [
        f"pull {points.pull[k]}, {points.label[k]} ({points.signal[k]:+.4g} {fit.unit.command},"
        f" {points.thrust[k]:+.3g} N)"
        for k in direction.outliers[:_MOST]
    ]
    more = f" and {len(direction.outliers) - _MOST} more" if len(direction.outliers) > _MOST else ""
    return [f"WARNING: outliers, {'kept' if kept else 'left out of the fit'}: {'; '.join(shown)}{more}"]


def _table(fit: UnitFit) -> list[str]:
    table = fit.table
    assert table is not None
    rms = float(np.sqrt(np.mean(table.residual**2)))
    worst = int(np.abs(table.residual).argmax())
    lines = [
        f"table of {len(table.signal)} signals"
        + (f" at {len(table.voltage_v)} voltages" if len(table.voltage_v) else "")
        + f": the points lie {rms:.2g} N (rms) from it, at most {abs(table.residual[worst]):.2g} N"
        f" at {fit.points.signal[worst]:+.4g} {fit.unit.command}"
    ]
    low, high = table.dead_band
    if low < 0.0 or high > 0.0:
        lines.append(f"dead band: no thrust from {low:+.4g} to {high:+.4g} {fit.unit.command}")
    return lines


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
        lines = []
        for record in self.records.values():
            lines += [f"pull {record.name}: {note}" for note in record.notes]
        for unit, fit in self.pulls.items():
            own = [record for record in self.records.values() if record.name in fit.points.pull]
            lines += pull_sentences(unit, fit, own)
        for unit, motor in self.motors.items():
            lines += motor_sentences(unit, motor)
        return lines + [f"WARNING: {text}" for text in self.warnings] + list(self.notes)

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
