"""Sentences of a bench test for a control engineer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.bench_test.unit_fit import unlike
from seatrial.bench_test.vehicle_entry import PER_MINUTE

if TYPE_CHECKING:
    from seatrial.bench_test.pull_points import PullPoints
    from seatrial.bench_test.unit_fit import DirectionFit, UnitFit
    from seatrial.motor_dynamics import MotorEstimate

__all__ = ["motor_sentences", "pull_sentences"]

_MOST = 4
_TWO = 0.15


def pull_sentences(unit: str, fit: UnitFit, records: Sequence[PullPoints]) -> list[str]:
    """What the pulls of a group say: factors, curve, exponent, order, outliers."""
    said = [f"{unit}: {text}" for text in _factors(records)]
    for side, one in fit.directions.items():
        said.append(f"{unit} {side}: {_largest(fit, side)}; {_goodness(one)}")
        if fit.kind == "quadratic":
            p1, sd = (PER_MINUTE * float(x[0]) for x in (one.fit.coefficients, one.fit.standard_deviations))
            said.append(f"{unit} {side}: p1 = {p1:.5g} ± {sd:.2g} N s², thrust per n|n| with n in rev/s")
        if np.isfinite(one.exponent[0]) and not fit.regression.with_voltage:
            said.append(f"{unit} {side}: {_exponent(one)}")
        if one.judgement:
            said.append(f"{unit} {side}: {one.judgement}")
        said += [f"{unit} {side}: {text}" for text in _outliers(fit, one)]
    if fit.table is not None:
        said += [f"{unit}: {text}" for text in _table(fit)]
    ratios = [f"{'+'.join(names)} {ratio:.3f} ± {sd:.2g}" for names, (ratio, sd) in unlike(fit).items()]
    if ratios:
        said.append(f"{unit}: thrust over that of the common curve: {', '.join(ratios)}")
    return said


def motor_sentences(unit: str, motor: MotorEstimate) -> list[str]:
    """What the steps of a group say."""
    return [f"{unit} motor: {text.removesuffix('.')}" for text in motor.sentences()]


def share(value: float, digits: int = 5) -> str:
    """A share of the scatter in decimals; what would round to one is said to be above the last of them.

    Examples
    --------
    >>> share(0.9999), share(0.9999999)
    ('0.99990', '> 0.99999')
    """
    short = f"{value:.{digits}f}"
    return f"> {1.0 - 10.0**-digits:.{digits}f}" if value < 1.0 and float(short) == 1.0 else short


def _factors(records: Sequence[PullPoints]) -> list[str]:
    said: dict[str, None] = {}
    for record in records:
        for names, factor in record.factors.items():
            many = (
                f"{len(names)} actuators ({', '.join(names)}) pull" if len(names) > 1 else f"{names[0]} pulls"
            )
            said[f"{many} {factor:.4g} N along the load cell per newton of one"] = None
    return list(said)


def _largest(fit: UnitFit, side: str) -> str:
    own = fit.points.signal > 0.0 if side == "ahead" else fit.points.signal < 0.0
    k = int(np.flatnonzero(own)[np.abs(fit.points.thrust[own]).argmax()])
    volts = f" and {fit.points.voltage[k]:.3g} V" if fit.regression.with_voltage else ""
    return f"{abs(fit.points.thrust[k]):.3g} N at {fit.points.signal[k]:+.4g} {fit.unit.command}{volts}"


def _goodness(one: DirectionFit) -> str:
    fit = one.fit
    return (
        f"R2 = 1 - SSE/SST {_is(share(fit.r2))} decides (the paper's B, blind to a wrong gain,"
        f" {_is(share(fit.b))}); points scatter by {fit.sigma:.2g} N (standard"
        f" deviation, {fit.dof} degrees of freedom)"
    )


def _is(value: str) -> str:
    return value if value.startswith(">") else f"= {value}"


def _exponent(one: DirectionFit) -> str:
    value, sd = one.exponent
    near = abs(value - 2.0) < max(_TWO, 3.0 * sd)
    return f"thrust grows with the {value:.3f} ± {sd:.2g} power of the signal" + (
        ", so nearly as n|n|" if near else ", so not as n|n|"
    )


def _outliers(fit: UnitFit, one: DirectionFit) -> list[str]:
    if not len(one.outliers):
        return []
    points = fit.points
    kept = fit.regression.outliers == "keep"
    shown = [
        f"pull {points.pull[k]}, {points.place[k]} ({points.signal[k]:+.4g} {fit.unit.command},"
        f" {points.thrust[k]:+.3g} N)"
        for k in one.outliers[:_MOST]
    ]
    more = f" and {len(one.outliers) - _MOST} more" if len(one.outliers) > _MOST else ""
    return [f"WARNING: outliers, {'kept' if kept else 'left out of the fit'}: {'; '.join(shown)}{more}"]


def _table(fit: UnitFit) -> list[str]:
    table = fit.table
    assert table is not None
    rms = float(np.sqrt(np.mean(table.residual**2)))
    worst = int(np.abs(table.residual).argmax())
    said = [
        f"table of {len(table.signal)} signals"
        + (f" at {len(table.voltage)} voltages" if len(table.voltage) else "")
        + f": the points lie {rms:.2g} N (rms) from it, at most {abs(table.residual[worst]):.2g} N"
        f" at {fit.points.signal[worst]:+.4g} {fit.unit.command}"
    ]
    low, high = table.dead_band
    if low < 0.0 or high > 0.0:
        said.append(f"dead band: no thrust from {low:+.4g} to {high:+.4g} {fit.unit.command}")
    return said
