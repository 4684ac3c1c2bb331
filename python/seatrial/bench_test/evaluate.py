"""A bench test evaluated: pulls and steps are read, fitted and written into the text of the vehicle file.

Motors come first: pulls are read behind the motors that the steps gave, because thrust over signal and signal
over command belong together. Held by ``tests/bench_test/test_bench.py`` and
``tests/bench_test/test_bench_steps.py``.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.errors import CampaignError, TrialError, VehicleError, nearest
from seatrial.base.files import no_file
from seatrial.base.run import run_facts, sha256
from seatrial.base.toml_file import file_path, is_path, text_of
from seatrial.base.work import Clock
from seatrial.bench_test.characteristic import (
    UnitFit,
    curve_warnings,
    fit_unit,
    motor_warnings,
    pull_warnings,
)
from seatrial.bench_test.file import BenchFile, Pull, Steps, Unit, listed, parse, read_bench_table, unit_of
from seatrial.bench_test.pulls import PullPoints, distance, read_pull
from seatrial.bench_test.result import BenchTest
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
    warnings = [text for name, (_, motor) in motors.items() for text in motor_warnings(name, motor)]
    warnings += [text for _, records in pulled.values() for text in pull_warnings(records)]
    warnings += [text for fit in fits.values() for text in curve_warnings(fit, driven)]
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
        warnings=(*warnings, *written.refused),
        notes=(*with_motors.notes, *written.notes),
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
        unit = units[name]
        try:
            motor = identify_motor(own, start=vehicle.motors()[unit.actuators[0]], unit=unit.command)
        except TrialError as error:
            raise TrialError(f"{path}: steps of {name}: {error}") from None
        motors[name] = (unit, motor)
    return motors, {name: tuple(own) for name, own in records.items()}


def _file(text: str, bench: Path, where: str, hashes: dict[str, Any]) -> Path:
    path = file_path(text, bench.parent, f"{where}, key file")
    if wrong := no_file(path):
        raise CampaignError(f"{where}, key file: {wrong}; correct the path")
    hashes[text] = sha256(path.read_bytes())
    return path
