"""The words of a bench test: thrust curves, motors, how well they are known, what to measure next.

`sentences` say it one by one, of a test, a motor or a parameter. Held by ``tests/bench_test``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import singledispatch

import numpy as np

from seatrial.base.finding import Finding
from seatrial.base.report import Report, Section, Table
from seatrial.bench_test.characteristic import DirectionFit, UnitFit, actuator_ratios
from seatrial.bench_test.evaluate import BenchTest
from seatrial.bench_test.motor_estimate import SETTINGS as MOTOR_SETTINGS
from seatrial.bench_test.motor_estimate import ActuatorDifference, MotorEstimate, MotorParameter, WrittenMotor
from seatrial.bench_test.motor_model import symbol
from seatrial.bench_test.pulls import PullPoints
from seatrial.bench_test.vehicle_text import PER_MINUTE

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


_MOST_OUTLIERS = 4  # that a sentence names


@singledispatch
def sentences(result: object) -> list[str]:
    """Sentences about a bench test, a motor or a parameter of one."""
    raise TypeError(f"expected a bench test or a motor, found {type(result).__name__}")


@sentences.register
def _of_test(test: BenchTest) -> list[str]:
    """What a test says; warnings begin with WARNING."""
    lines = []
    for record in test.records.values():
        lines += [f"pull {record.name}: {note}" for note in (*record.notes, *map(_warning, record.doubts))]
    for unit, fit in test.pulls.items():
        own = [record for record in test.records.values() if record.name in fit.points.pull]
        lines += _pull(unit, fit, own)
    for unit, motor in test.motors.items():
        lines += [f"{unit} motor: {text.removesuffix('.')}" for text in _of_motor(motor)]
    return lines + [_warning(doubt) for doubt in test.findings] + list(test.notes)


def warned(test: BenchTest) -> list[str]:
    """What looks wrong in a test, with the pull or curve that it is about."""
    lines = [
        f"pull {record.name}: {_warning(doubt)}"
        for record in test.records.values()
        for doubt in record.doubts
    ]
    for unit, fit in test.pulls.items():
        for side, direction in fit.directions.items():
            lines += [f"{unit} {side}: {text}" for text in _outliers(fit, direction)]
    return lines + [_warning(doubt) for doubt in (*test.findings, *test.lost)]


_DOUBTS = {
    "no motor": "{subject} motor: {name} = {value_s:.3g} s is not that of a motor; is t_s in seconds?",
    "wrong side": "pull {subject}: no point of {file} lies {side}; is it the right record?",
    "points twice": "pull {subject} holds the points of pull {other} once more: they count twice, and the"
    " standard deviations come out too small; remove one",
    "untested range": "{subject}: tested up to {tested:.4g} of {most:.4g} {unit}; beyond, the curve is a"
    " guess",
    "curve falls": "{subject}: the curve falls between {top:.4g} and {bottom:.4g} {unit}{at}, which no"
    " propeller does; more points there, or a lower order",
    "curve pushes back": "{subject}: the curve pushes the wrong way up to {up_to:.4g} {unit}{at}; try"
    " through_origin = true, or tare the cell",
    "dead band smeared": "{subject}: no thrust from {low:+.4g} to {high:+.4g} {unit}, a dead band that a"
    ' polynomial smears; take order = "points"',
    "supply sagged": "{subject}: the supply ran from {low_v:.3g} to {high_v:.3g} V and thrust follows it;"
    ' take inputs = ["signal", "voltage"]',
    "poor fit": "{subject}: R2 is only {r2:.3f}; the order does not fit, or the load is noisy",
    "not written": "{subject} is not written into the vehicle file: {why}",
    "inflow dropped": "kind {kind} knows no inflow: {keys} of {subject} dropped",
    "log without time": "{rows} rows in a row have the same signal; if this is a log, map its time as t_s:"
    " its samples err alike, and intervals of rows taken as points are too narrow",
    "load across": "{share_percent:.0f} % of the load acts across the direction of the vehicle file; check"
    " direction of the actuators and alignment of the cell",
}
"""Words of the findings of a bench test, by their kind."""


def sentence(finding: Finding) -> str:
    """A finding of a bench test in words."""
    supply_v = finding.values.get("supply_v")
    at = "" if supply_v is None else f" at {supply_v:.3g} V"
    return _DOUBTS[finding.kind].format(subject=finding.subject, at=at, **finding.values)


def _warning(finding: Finding) -> str:
    return f"WARNING: {sentence(finding)}"


def _pull(unit: str, fit: UnitFit, records: Sequence[PullPoints]) -> list[str]:
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


def exponent_text(direction: DirectionFit) -> str:
    """Power of the signal with which thrust grows, and whether it is that of n|n|."""
    value, sd = direction.exponent
    low, high = direction.exponent_interval
    words = (
        f"thrust grows with the {value:.3f} ± {sd:.2g} power of the signal, 95 % interval {low:.2f} to"
        f" {high:.2f}"
    )
    if low <= 2.0 <= high:
        return f"{words}: n|n| (2) lies in it"
    return (
        f'{words}: it differs from n|n| (2); compare order = 2 and order = "points" (a dead band or an offset'
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
        for k in direction.outliers[:_MOST_OUTLIERS]
    ]
    more = (
        f" and {len(direction.outliers) - _MOST_OUTLIERS} more"
        if len(direction.outliers) > _MOST_OUTLIERS
        else ""
    )
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


@sentences.register
def _of_parameter(parameter: MotorParameter) -> list[str]:
    """What is known of a parameter of a motor, in one sentence."""
    return [_parameter(parameter)]


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def _parameter(parameter: MotorParameter) -> str:
    label, unit = symbol(parameter.name), "" if parameter.unit == "1" else f" {parameter.unit}"
    if parameter.value is not None and parameter.sigma is not None:
        if parameter.name in ("T_1", "T_t") and _number(parameter.upper) < MOTOR_SETTINGS.shortest_s:
            return f"{label} is zero to {MOTOR_SETTINGS.shortest_s:g} s."
        digits = 4 if parameter.sigma <= 0 else max(0, 1 - math.floor(math.log10(parameter.sigma)))
        lower, upper = (f"{_number(edge):.{digits}f}" for edge in (parameter.lower, parameter.upper))
        return (
            f"{label} = {parameter.value:.{digits}f}{unit} ± {parameter.sigma:.{digits}f}, 95 % interval"
            f" {lower} to {upper}{unit}{parameter.remark and f'; {parameter.remark}'}."
        )
    # A value without a deviation: the remark says why.
    if parameter.value is not None:
        return f"{label} = {parameter.value:.4g}{unit}, {parameter.remark}."
    text = f"{label} is not determined: {parameter.reason}"
    for known, word in ((parameter.at_least, "at least"), (parameter.at_most, "at most")):
        if known is not None:
            text += f"; it is {word} {known:.4g}{unit}"
    if parameter.kept is None:
        return text + "."
    if math.isinf(parameter.kept):
        return text + "; the vehicle file has no such limit."
    if parameter.contradicted:
        return text + f"; this contradicts the vehicle file's {parameter.kept:.4g}{unit}: correct it by hand."
    return text + f"; the vehicle file's {parameter.kept:.4g}{unit} is kept."


def _difference(difference: ActuatorDifference) -> str:
    return (
        f"{difference.actuator} differs from its group in {symbol(difference.name)}: {difference.value:.4g}"
        f" against {difference.median:.4g} (p = {difference.p:.2g}); give it a motor of its own."
    )


def _written(written: WrittenMotor, fitted_r2: float) -> list[str]:
    """What is written though it is not determined, and whether the file's motor is worse than the fit."""
    lines = []
    if written.least is not None:
        lines.append(
            f"{written.least} is written as {written.table[written.least]:g}, the least that the records"
            " allow: without it the vehicle file would reuse the other rate limit, which the records exclude."
        )
    if fitted_r2 - written.r2 > MOTOR_SETTINGS.worse:
        lines.append(
            f"The motor as written to the vehicle file follows the records with R\N{SUPERSCRIPT TWO}"
            f" {written.r2:.4f}, the fit with {fitted_r2:.4f}: a limit that the file keeps, or shares"
            " between directions, is wrong; compare its keys with the sentences above."
        )
    return lines


@sentences.register
def _of_motor(motor: MotorEstimate) -> list[str]:
    """What is known of each parameter, what differs, how well it fits; one sentence each."""
    fit, unit = motor.fitness, motor.unit
    lines = [_parameter(parameter) for parameter in motor.parameters.values()]
    if motor.below_minimum is not None and motor.below_minimum_ratio is not None:
        what = "lifted to it" if motor.below_minimum == "lift" else "dropped to zero"
        lines.append(
            f"Commands below the minimum are {what}: the opposite assumption gives"
            f" {motor.below_minimum_ratio:.3g} times the cost."
        )
    if motor.distinct_commands == 1:
        lines.append(
            "K_V rests on commands of one magnitude; a limit there would look the same, and commands of"
            " other magnitudes would decide."
        )
    for pair in motor.directions:
        if pair.differ:
            shared = pair.name in ("n_acc", "n_dec")
            pooled = f"; the vehicle file has one for both: {pair.pooled:.4g}" if shared else ""
            lines.append(
                f"{pair.name} differs between the directions: {pair.ahead:.4g} ahead, {pair.astern:.4g}"
                f" astern (p = {pair.p:.2g}){pooled}."
            )
    lines += _written(motor.written, fit.r2)
    lines += [_difference(difference) for difference in motor.differing]
    if motor.left_out:
        lines.append(
            f"{motor.left_out} of {motor.left_out + fit.samples} measurements are gross errors and are left"
            " out."
        )
    for name in motor.trimmed:
        lines.append(
            f"Record {name} starts in motion under a constant command: its first transient is left out;"
            " give the command that was held before."
        )
    lines.append(
        f"Mean absolute error {fit.absolute:.3g} {unit}, R\N{SUPERSCRIPT TWO} {fit.r2:.5f}, over"
        f" {fit.samples} samples."
    )
    # Errors well above the noise of the measurement are the model's.
    own = max(motor.noise.total, 1e-12)
    if fit.rms > MOTOR_SETTINGS.rough * own:
        lines.append(
            f"The errors ({fit.rms:.3g} {unit} rms) are {fit.rms / own:.1f} times the measurement's own"
            " noise: the motor does something that the chain leaves out, or single values are wrong; look"
            " at the figure."
        )
    if not motor.converged or motor.agreeing < 2:
        lines.append(
            f"Of {motor.starts} starts {motor.agreeing} found this minimum: compare the figure before use."
        )
    return lines
