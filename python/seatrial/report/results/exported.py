"""The words of what was exported to other machines and exchanged with simulators.

Held by ``tests/export/test_c.py``, ``tests/export/test_fmu.py`` and ``tests/simulators/test_convert.py``.
"""

from __future__ import annotations

from functools import singledispatch

from seatrial.base.report import Report, Section, Table
from seatrial.export.c_code import CExport
from seatrial.export.fmu import FmuExport, platform
from seatrial.simulators.convert import ExportedModel, ImportedModel


@singledispatch
def report(result: object) -> Report:
    """Report of an export, or of an exchange with a simulator."""
    raise TypeError(f"expected an export, found {type(result).__name__}")


_CALLS = {"motors": "_predict: motors", "model": "_predict: model"}


@report.register
def _of_c(made: CExport) -> Report:
    """The files, their operations and their numbers."""
    programs = made.programs.all()
    kinds = ("simple", "quotients", "functions", "decisions", "tables", "all")
    rows = [
        (f"{program.prefix}{_CALLS.get(function, f'_{function}')}", *(str(counts[kind]) for kind in kinds))
        for program in programs
        for function, counts in program.operations.items()
    ]
    head = ["function", "+ - *", "/ sqrt", "sin exp …", "compare, select", "tables", "all"]
    parts = ("parameters", "state", "inputs", "outputs")
    sizes = [(program.prefix, *(str(len(getattr(program, part))) for part in parts)) for program in programs]
    last = made.programs.autopilot or made.programs.vehicle
    steps = last.operations["step"]["all"]
    return Report(
        title=str(made.folder),
        outcome="exported as C99",
        good=f"{len(made.files)} files that need math.h alone; {steps} operations in a step of {last.prefix}",
        worst=_left_out(made),
        next_step=f"compile with gcc -std=c99 -O2 -c {made.files[-1].name}; -DSEATRIAL_FLOAT for float",
        sections=(
            Section(
                tables=(
                    Table.of("Operations of a call", head, rows),
                    Table.of("Numbers of the interface", ("program", *parts), sizes),
                )
            ),
        ),
    )


def _left_out(made: CExport) -> str:
    """What is fixed in the files."""
    fixed = "dead times, limits, tables and zero coefficients"
    if made.programs.autopilot is not None:
        fixed += ", the mission and the autopilot's model of the vehicle"
    if made.programs.filter is not None:
        fixed += ", the filter's period and kinds of sensors"
    return f"{fixed} are part of the program; to change them, export again"


@report.register
def _of_units(made: FmuExport) -> Report:
    """The units, what they hold and what runs them."""
    none = "sources only: no C compiler is there" if made.binary else "sources only, as asked for"
    binary = f"binary for {platform()} by {made.compiler}" if made.compiler else none
    rows = [
        (
            program.prefix,
            f"{program.step_s:g}",
            *(str(len(part)) for part in (program.parameters, program.inputs, program.outputs)),
        )
        for program in made.programs.all()
    ]
    head = ["unit", "step, s", "parameters", "inputs", "outputs"]
    sets = f", {made.samples} parameter sets of the covariance" if made.samples else ""
    return Report(
        title=", ".join(path.name for path in made.files),
        outcome="exported",
        good=f"{len(made.files)} units of FMI 2.0 and 3.0 with sources, {binary}{sets}",
        worst="a communication step is a whole number of steps of the unit; others are refused",
        next_step=f"check with fmpy validate {made.files[0]}; step the autopilot first, then the vehicle",
        sections=(Section(tables=(Table.of("Units", head, rows),)),),
    )


@report.register
def _of_import(read: ImportedModel) -> Report:
    """Report on the import."""
    values = read.vehicle.coefficients()
    count = sum(1 for name, value in values.items() if value)
    doubts = len(read.contradictions)
    worst = read.contradictions[0] if doubts else "no contradiction was found in signs, symmetry and buoyancy"
    rows = [[name, f"{value:.6g}"] for name, value in sorted(values.items()) if value]
    return Report(
        title=read.source,
        outcome="read as a model of gz-sim",
        good=f"{count} coefficients, forward-right-down about the link's origin; {doubts} contradictions",
        worst=worst,
        next_step="add thrusters to the vehicle file, then seatrial check",
        sections=(
            Section("Contradictions", read.contradictions),
            Section("Not taken", read.left),
            Section("Coefficients", (), (Table.of("", ["name", "value"], rows),)),
        ),
    )


@report.register
def _of_model(made: ExportedModel, out: str = "") -> Report:
    """Report on the export."""
    return Report(
        title=made.vehicle.name,
        outcome="written for gz-sim",
        good=f"mass, inertia, buoyancy, added mass and damping in {out or 'the model'}, frames turned"
        " where gz-sim has others",
        worst=made.lost[0] if made.lost else "nothing is lost",
        next_step="add thrusters and sensors in the words of gz-sim",
        sections=(Section("Lost", made.lost),),
    )
