"""The words of a bench test: thrust curves, motors, how well they are known, and what to measure next."""

from __future__ import annotations

import numpy as np

from seatrial.base.report import Report, Section, Table
from seatrial.bench_test.evaluate import BenchTest
from seatrial.report.results.bench_sentences import exponent_text, share, verb_of, warned

WRITE = (
    "write the results into the vehicle file (seatrial bench FILE --in-place, or --write FILE), then"
    " run seatrial check on it"
)
"""What to do next as long as the results stand in no vehicle file."""


def report(test: BenchTest) -> Report:
    """Three lines, regression, fit, motors; sentences as details."""
    worst, next_step = _worst(test)
    statements = test.sentences()
    return Report(
        title=test.file.name,
        outcome=f"bench test of {test.before.name}",
        good=_how_good(test),
        worst=worst,
        next_step=next_step,
        sections=(
            Section(
                sentences=tuple(warned(test)),
                tables=(_regression_table(test), _fit_table(test), _table_errors(test), _motor_table(test)),
            ),
            Section("Remarks", tuple(statements), details=True),
        ),
    )


def _how_good(test: BenchTest) -> str:
    """Fit of the pulls, the worst direction named; fit of the motors."""
    parts = []
    fits = {
        f"{unit} {side}": direction.fit
        for unit, fit in test.pulls.items()
        for side, direction in fit.directions.items()
    }
    if fits:
        worst = min(fits, key=lambda name: fits[name].r2)
        parts.append(
            f"thrust of {len(test.pulls)} group{'s' if len(test.pulls) > 1 else ''} fitted with"
            f" R2 {verb_of(share(fits[worst].r2)).removeprefix('= ')} or better ({worst} is the worst; points"
            f" scatter by {fits[worst].sigma:.2g} N)"
        )
    elif test.pulls:
        rms = max(
            row["rms_n"] for fit in test.pulls.values() if fit.table is not None for row in fit.table.errors()
        )
        plural = "s" if len(test.pulls) > 1 else ""
        parts.append(
            f"thrust table{plural} of {len(test.pulls)} group{plural}, points within {rms:.2g} N rms"
        )
    for unit, motor in test.motors.items():
        known = sum(parameter.determined for parameter in motor.parameters.values())
        parts.append(
            f"motor of {unit}: {known} of {len(motor.parameters)} parameters determined, mean error"
            f" {motor.fitness.absolute:.3g} {motor.unit}"
        )
    return "; ".join(parts)


def _worst(test: BenchTest) -> tuple[str, str]:
    """The worst problem of a bench test, and what to do about it."""
    write = WRITE
    if test.warnings:
        return test.warnings[
            0
        ], "correct this in the bench file or repeat the test before the results are used"
    for unit, motor in test.motors.items():
        if missing := [parameter for parameter in motor.parameters.values() if not parameter.determined]:
            names = ", ".join(parameter.name for parameter in missing)
            return (
                f"{unit} motor: {names} not determined: {missing[0].reason}",
                "record the steps that this asks for, or keep the vehicle file's values; then use --in-place",
            )
    named = [
        (f"{unit} {side}", len(direction.outliers), len(direction.points))
        for unit, fit in test.pulls.items()
        for side, direction in fit.directions.items()
        if len(direction.outliers)
    ]
    if named:
        where, count, points = max(named, key=lambda row: row[1])
        return f"{where}: {count} outlier{'s' if count > 1 else ''} beside {points} fitted points", (
            f"look at the pulls named below, then {write}"
        )
    bent = [
        (
            abs(direction.exponent[0] - 2.0),
            f"largest departure from n|n|: {unit} {side}, {exponent_text(direction)}",
        )
        for unit, fit in test.pulls.items()
        for side, direction in fit.directions.items()
        if np.isfinite(direction.exponent[0])
        and not direction.exponent_interval[0] <= 2.0 <= direction.exponent_interval[1]
    ]
    return (max(bent)[1] if bent else "no outlier and no undetermined parameter found"), write


def _regression_table(test: BenchTest) -> Table:
    rows = [
        (
            f"{unit} {side}" if k == 0 else "",
            name,
            _coefficient_unit(direction.fit.terms[k], fit.unit.command),
            f"{direction.fit.coefficients[k]:.5g}",
            f"{direction.fit.standard_deviations[k]:.2g}",
            "{:.4g} to {:.4g}".format(*direction.fit.intervals()[k]),
        )
        for unit, fit in test.pulls.items()
        for side, direction in fit.directions.items()
        for k, name in enumerate(direction.fit.names)
    ]
    head = ("group", "coefficient", "unit", "estimate", "sd", "95 % interval")
    return Table.of("Regression per direction, of a single actuator", head, rows, left=3)


def _fit_table(test: BenchTest) -> Table:
    rows = [
        (
            f"{unit} {side}",
            str(len(direction.points)),
            str(len(direction.outliers)),
            share(direction.fit.r2).replace(" ", ""),
            share(direction.fit.b).replace(" ", ""),
            f"{direction.fit.sigma:.2g}",
            f"{direction.fit.condition:.2g}",
        )
        for unit, fit in test.pulls.items()
        for side, direction in fit.directions.items()
    ]
    head = ("group", "points", "outliers", "R2", "squared correlation", "scatter, N", "condition")
    return Table.of(
        "How well the points fit (R2 = 1 - SSE/SST; a squared correlation is blind to a wrong gain)",
        head,
        rows,
    )


def _table_errors(test: BenchTest) -> Table:
    rows = [
        (
            unit,
            "" if np.isnan(row["voltage_v"]) or not len(fit.table.voltage_v) else f"{row['voltage_v']:.4g}",
            f"{row['points']:.0f}",
            f"{row['rms_n']:.2g}",
            f"{row['largest_n']:.2g}",
        )
        for unit, fit in test.pulls.items()
        if fit.table is not None
        for row in fit.table.errors()
    ]
    return Table.of(
        "Points against the table", ("group", "supply, V", "points", "rms, N", "largest, N"), rows
    )


def _motor_table(test: BenchTest) -> Table:
    rows = [
        (
            unit if k == 0 else "",
            parameter.name,
            parameter.unit,
            "" if parameter.value is None else f"{parameter.value:.6g}",
            "" if parameter.sigma is None else f"{parameter.sigma:.2g}",
            "not determined"
            if parameter.lower is None or parameter.upper is None
            else f"{parameter.lower:.6g} to {parameter.upper:.6g}",
        )
        for unit, motor in test.motors.items()
        for k, parameter in enumerate(motor.parameters.values())
    ]
    return Table.of("Motors", ("group", "parameter", "unit", "estimate", "sd", "95 % interval"), rows, left=3)


def _coefficient_unit(term: tuple[int, ...], command: str) -> str:
    """Unit of a coefficient: newton per powers of the command's unit and volt."""
    below = [
        f"{name}{'²³'[e - 2] if e > 1 else ''}" for name, e in zip((command, "V"), term, strict=False) if e
    ]
    return "N" + ("/" + "/".join(below) if below else "")
