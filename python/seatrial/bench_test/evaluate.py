"""A bench test evaluated: pulls and steps are read, fitted and written into the text of the vehicle file.

Motors come first: pulls are read behind the motors that the steps gave, because thrust over signal and signal
over command belong together. Held by ``tests/bench_test/test_bench.py`` and
``tests/bench_test/test_bench_steps.py``.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.errors import CampaignError, SeatrialError, TrialError, VehicleError, nearest
from seatrial.base.files import no_file, write_atomic, writing
from seatrial.base.finding import Finding
from seatrial.base.report import Reported, sentence_of, words_about
from seatrial.base.run import RunDirectory, run_facts, sha256, to_json
from seatrial.base.toml_file import file_path, is_path, text_of
from seatrial.base.work import Clock
from seatrial.bench_test.characteristic import UnitFit, curve_doubts, fit_unit, motor_doubts, pull_doubts
from seatrial.bench_test.file import BenchFile, Pull, Steps, Unit, listed, parse, read_bench_table, unit_of
from seatrial.bench_test.pulls import PullPoints, distance, read_pull
from seatrial.bench_test.vehicle_text import write_results
from seatrial.trial.generated import files_of

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.bench_test.motor_estimate import MotorEstimate
    from seatrial.bench_test.motor_model import StepRecord


def _read_steps(
    steps: Steps,
    unit: Unit,
    vehicle: Vehicle,
    path: Path,
    *,
    where: str,
    reader: str | None = None,
    columns: dict[str, Any] | None = None,
) -> list[StepRecord]:
    """Step records of the unit's actuators that have both a command and a measurement in the file."""
    from seatrial.bench_test.motor_model import StepRecord

    table = read_bench_table(
        path, vehicle, reader=steps.reader or reader, columns=(columns or {}) | steps.columns
    )
    if table.t is None:
        raise TrialError(f'{where}: no time in {table.file}; map a column as t_s, for example t_s = "Time"')
    both = [name for name in unit.actuators if name in table.commands and name in table.measured]
    if not both:
        raise TrialError(
            f"{where}: no actuator of {unit.name} has both its command and its revolutions; expected columns"
            f" cmd.{unit.actuators[0]} and meas.{unit.actuators[0]}; {table.file} gives"
            f" {listed([f'cmd.{n}' for n in table.commands] + [f'meas.{n}' for n in table.measured])}"
        )
    records = []
    for name in both:
        # Revolutions may have stamps of their own: empty cells between them are no samples.
        given = np.isfinite(table.measured[name])
        if not given.any():
            raise TrialError(
                f"{where}: meas.{name}: no cell of {table.file} is a number; check the column of the"
                " revolutions"
            )
        try:
            records.append(
                StepRecord(
                    table.t,
                    distance(vehicle, name, table.commands[name]),
                    distance(vehicle, name, table.measured[name])[given],
                    name,
                    table.t[given],
                )
            )
        except TrialError as error:
            raise TrialError(f"{where}: {error}") from None
    return records


def bench(source: str | Path, *, vehicle: Vehicle | None = None) -> BenchTest:
    r"""Characteristics and motors of a vehicle from its bench test.

    Parameters
    ----------
    source : str or Path
        Bench file.
    vehicle : Vehicle, optional
        Instead of the bench file's own.

    Returns
    -------
    BenchTest
        Fits with standard deviations, the vehicle with the results, its file with comments kept.

    Raises
    ------
    CampaignError
        The bench file cannot be read or names what is not there.
    TrialError
        A record cannot be read or used.
    VehicleError
        The vehicle cannot be loaded.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> _ = (folder / "ahead.csv").write_text(
    ...     "cmd.stern,load.X_n\n0,1.0\n500,19.6\n1000,75.8\n1500,168.4\n2000,299.6\n"
    ... )
    >>> _ = (folder / "bench.toml").write_text('''
    ... format = 1
    ... name = "basin"
    ... vehicle = "cwolf"
    ... regression = { order = "square" }
    ... pulls = [{ name = "ahead", file = "ahead.csv", group = "stern", axis = "X" }]
    ... ''')
    >>> found = bench(folder / "bench.toml")
    >>> found.pulls["stern"].directions["ahead"].fit.coefficients
    array([2.00e-05])
    >>> round(found.vehicle.coefficients()["SbU.p1_ahead"], 3)
    0.072
    """
    from seatrial._core import Vehicle

    path = Path(source)
    text = text_of(path, "a bench file")
    file = parse(text, str(path))
    base, vehicle_path, vehicle_text = _vehicle(file, path, vehicle)
    _check_units(file, base, str(path))
    clock = Clock()
    hashes: dict[str, str] = {}
    motors, steps = _motors(file, base, path, hashes)
    # Pulls are read behind the motors just found: thrust over signal and signal over command belong together.
    with_motors = write_results(
        vehicle_text,
        base,
        [],
        {name: (unit.actuators, motor.motor_table()) for name, (unit, motor) in motors.items()},
        name=file.name,
    )
    driven = (
        Vehicle.from_toml(with_motors.text, f"{base.name} with the motors of {file.name}") if motors else base
    )
    pulled = _pulls(file, driven, path, hashes)
    fits: dict[str, UnitFit] = {}
    for name, (unit, records) in pulled.items():
        fits[name] = fit_unit(unit, records, file.regression_of(name), where=f"{path}: {name}")
    written = write_results(
        with_motors.text, driven, list(fits.values()), {}, name=file.name, rho=file.rho_kg_m3
    )
    doubts = [doubt for name, (_, motor) in motors.items() for doubt in motor_doubts(name, motor)]
    doubts += [doubt for _, records in pulled.values() for doubt in pull_doubts(records)]
    doubts += [doubt for fit in fits.values() for doubt in curve_doubts(fit, driven)]
    return BenchTest(
        file=file,
        text=text,
        pulls=fits,
        records={record.name: record for _, records in pulled.values() for record in records},
        motors={name: motor for name, (_, motor) in motors.items()},
        step_records=steps,
        before=base,
        vehicle=Vehicle.from_toml(written.text, f"{base.name} with the results of {file.name}"),
        vehicle_path=vehicle_path,
        vehicle_text=written.text,
        findings=(*doubts, *written.refused),
        notes=(*with_motors.notes, *written.notes, *map(_warning, written.lost)),
        lost=written.lost,
        facts=run_facts(
            "bench test",
            file.name,
            clock=clock,
            inputs={"bench": sha256(text)} | {f"bench {name}": digest for name, digest in hashes.items()},
            options={"bench_file": str(path)},
        ),
    )


def fingerprint(source: str | Path) -> str:
    """SHA-256 of a bench file and of all files that its records are made of, for a result that is kept."""
    path = Path(source)
    text = text_of(path, "a bench file")
    digest = hashlib.sha256(text.encode())
    file = parse(text, str(path))
    for entry in (*file.pulls, *file.steps):
        record = file_path(entry.file, path.parent, f"{path}: {entry.name!r}, key file")
        recipe = (entry.reader or file.reader or record.suffix) in ("generated", ".toml")
        # The evaluation reports files that are missing.
        if record.is_file():
            for part in files_of(record) if recipe else (record,):
                digest.update(part.read_bytes() if part.is_file() else b"-")
    return digest.hexdigest()


def vehicle_of(source: str | Path) -> Vehicle:
    """Vehicle that a bench file names."""
    path = Path(source)
    return _vehicle(parse(text_of(path, "a bench file"), str(path)), path, None)[0]


def _vehicle(file: BenchFile, path: Path, given: Vehicle | None) -> tuple[Vehicle, Path | None, str]:
    """Vehicle, its file where it has one, and its text."""
    from seatrial._core import Vehicle

    if given is not None:
        return given, None, given.to_toml()
    name = file.vehicle
    own = file_path(name, path.parent, f"{path}: key vehicle") if is_path(name) else None
    try:
        loaded = Vehicle.load(str(own or name))
    except VehicleError as error:
        raise VehicleError(f"{path}: key vehicle: {error}") from None
    return loaded, own, loaded.to_toml() if own is None else text_of(own, "a vehicle file")


def _check_units(file: BenchFile, vehicle: Vehicle, source: str) -> None:
    """Refuse actuators under two names and regressions of what is not pulled, before anything is read."""
    pulled = _units(file.pulls, vehicle, f"{source}: pulls")
    _units(file.steps, vehicle, f"{source}: steps")
    for name in file.regressions:
        if name not in pulled:
            raise CampaignError(f"{source}: regressions, key {name}: no pull tests it{nearest(name, pulled)}")


def _units(entries: Sequence[Pull | Steps], vehicle: Vehicle, source: str) -> dict[str, Unit]:
    """Units of pulls or of steps by name; an actuator is in one of them only."""
    tested: dict[str, Unit] = {}
    for entry in entries:
        where = f"{source} {entry.name!r}"
        unit = unit_of(vehicle, entry.group, entry.actuators, where)
        for other in tested.values():
            shared = set(other.actuators) & set(unit.actuators)
            if other.name != unit.name and shared:
                raise CampaignError(
                    f"{where}: {', '.join(sorted(shared))} is also tested as {other.name}; name the same"
                    " group or actuators in both"
                )
        tested[unit.name] = unit
    return tested


def _pulls(
    file: BenchFile, vehicle: Vehicle, path: Path, hashes: dict[str, str]
) -> dict[str, tuple[Unit, list[PullPoints]]]:
    """Units and the points of their pulls, by name."""
    pulls: dict[str, tuple[Unit, list[PullPoints]]] = {}
    for pull in file.pulls:
        where = f"{path}: pulls {pull.name!r}"
        unit = unit_of(vehicle, pull.group, pull.actuators, where)
        source = _file(pull.file, path, where, hashes)
        points = read_pull(
            pull, unit, vehicle, source, where=where, reader=file.reader, columns=dict(file.columns)
        )
        pulls.setdefault(unit.name, (unit, []))[1].append(points)
    return pulls


def _motors(
    file: BenchFile, vehicle: Vehicle, path: Path, hashes: dict[str, str]
) -> tuple[dict[str, tuple[Unit, MotorEstimate]], dict[str, tuple[StepRecord, ...]]]:
    """Units with their motors, and the records behind each."""
    if not file.steps:
        return {}, {}
    from seatrial.bench_test.motor_identification import identify_motor

    units: dict[str, Unit] = {}
    records: dict[str, list[StepRecord]] = {}
    for steps in file.steps:
        where = f"{path}: steps {steps.name!r}"
        unit = unit_of(vehicle, steps.group, steps.actuators, where)
        source = _file(steps.file, path, where, hashes)
        units[unit.name] = unit
        records.setdefault(unit.name, []).extend(
            _read_steps(
                steps, unit, vehicle, source, where=where, reader=file.reader, columns=dict(file.columns)
            )
        )
    motors: dict[str, tuple[Unit, MotorEstimate]] = {}
    for name, own in records.items():
        unit, start = units[name], vehicle.motors()[units[name].actuators[0]]
        try:
            motors[name] = unit, identify_motor(own, start=start, unit=unit.command)
        except TrialError as error:
            raise TrialError(f"{path}: steps of {name}: {error}") from None
    return motors, {name: tuple(own) for name, own in records.items()}


def _file(text: str, bench: Path, where: str, hashes: dict[str, Any]) -> Path:
    path = file_path(text, bench.parent, f"{where}, key file")
    if wrong := no_file(path):
        raise CampaignError(f"{where}, key file: {wrong}; correct the path")
    hashes[text] = sha256(path.read_bytes())
    return path


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
    findings, notes, lost
        What looks wrong, what was written or left out, and what the vehicle file no longer says.
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
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]
    lost: tuple[Finding, ...]
    facts: Mapping[str, Any]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What looks wrong, in sentences."""
        return tuple(sentence_of(finding, "bench_test") for finding in self.findings)

    def sentences(self) -> list[str]:
        """What the test says, in sentences; warnings begin with WARNING."""
        return words_about(self, "bench_test")

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
        """Path of a run directory `run_dir` with the results: JSON, points, bench file, vehicle file.

        It is made when it does not exist; an earlier run's is replaced. Raises SeatrialError where it cannot
        be written; nothing is left half-written.
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
        """Vehicle file with the results, written to `path`, whole or not at all; a SeatrialError where there
        is such a file already and not `replace`, or it cannot be written.
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


def _warning(doubt: Finding) -> str:
    """What looks wrong, as a note."""
    return f"WARNING: {sentence_of(doubt, 'bench_test')}"


def _record_dict(record: PullPoints) -> dict[str, Any]:
    return {
        "file": record.file,
        "points": len(record.signal),
        "factors": {"+".join(names): factor for names, factor in record.factors.items()},
        "tare_n": record.tare,
        "tare_sd_n": record.zero_error,
        "notes": [*record.notes, *map(_warning, record.doubts)],
    }
