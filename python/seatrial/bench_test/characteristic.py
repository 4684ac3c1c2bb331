"""Characteristic of a group: a regression per direction or a table, and what looks wrong in it.

Ahead and astern are fitted apart, because a propeller's blades are made for one of them; the astern fit is of
magnitudes. Points of all pulls of a group are pooled, each pull with the zero error of its own cell.

Between n_min and n_max thrust must not fall, push the wrong way or be extrapolated: checked on a fine grid
from the motor's smallest to its largest signal, or the tested ones where the motor has no limit. Held by
``tests/bench_test/test_bench.py`` and ``tests/bench_test/test_bench_coverage.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError
from seatrial.base.finding import Finding, Severity
from seatrial.bench_test.pulls import Points
from seatrial.bench_test.regression import (
    Candidate,
    LeastSquares,
    Term,
    ThrustTable,
    candidates,
    dead_band,
    from_points,
    from_surface,
    lack_of_fit,
    least_squares,
    outliers,
    terms_of,
)

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.bench_test.file import Regression, Unit
    from seatrial.bench_test.motor_estimate import MotorEstimate
    from seatrial.bench_test.pulls import PullPoints

SIDES = {"ahead": 1.0, "astern": -1.0}


@dataclass(frozen=True)
class CharacteristicSettings:
    """From where on a fitted characteristic is doubted, and how it is tabulated."""

    exponent_share: float = 0.05  #: Of the largest thrust: weaker points are noise in the exponent.
    exponent_error: float = 0.03  #: Relative error of a point in the exponent.
    table_points: int = 12  #: Points of a table of a fitted curve, per direction.
    points_per_term: int = 3  #: Points per coefficient that a cubic takes.
    #: Scatter of a cubic over that of the chosen order, below which the order is too low.
    misfit: float = 0.8
    fewest_alone: int = 2  #: Points of some actuators: a ratio from so few has no error.
    grid_points: int = 400  #: Of the grid on which a curve is checked.
    rounding: float = 1e-3  #: Of the largest thrust: rounding of a fit neither falls nor pushes back.
    beyond: float = 1.05  #: Over the largest tested signal: less far is no extrapolation.
    poor_r2: float = 0.9  #: R2 of a curve that is worth a warning.
    sagged: float = 1.05  #: Largest over smallest supply voltage: thrust differs by 10 %, as its square.
    quiet_points: int = 3  #: Points without thrust that make a dead band.
    slowest_s: float = 10.0  #: Lag, s: no propeller or servo of an underwater vehicle lags so long.


SETTINGS = CharacteristicSettings()


@dataclass(frozen=True, eq=False)
class DirectionFit:
    """Regression of one direction ("ahead" or "astern"), of magnitudes.

    `points` and `outliers` are places among the group's points (outliers are fitted too where they are kept);
    `candidates` the models compared on the fitted points, `judgement` the sentence on the order. `exponent`
    is the slope of log thrust over log signal with its standard deviation, from points above a twentieth of
    the largest thrust, weak ones counting less; 2 is thrust per n|n|.
    """

    side: str
    fit: LeastSquares
    points: NDArray[np.int_]
    outliers: NDArray[np.int_]
    candidates: tuple[Candidate, ...]
    judgement: str
    exponent: tuple[float, float]
    exponent_interval: tuple[float, float]

    def thrust(self, signal: Array, voltage_v: Array | None = None) -> Array:
        """Thrust (m,) in N, signed, at signals (m,) of this direction."""
        inputs = np.abs(signal)[:, None]
        if len(self.fit.scale) > 1:
            inputs = np.column_stack([inputs, np.asarray(voltage_v)])
        return SIDES[self.side] * self.fit.at(inputs)

    def to_dict(self) -> dict[str, Any]:
        """The fit as plain data for JSON."""
        return {
            "coefficients": dict(zip(self.fit.names, self.fit.coefficients.tolist(), strict=True)),
            "sigma": dict(zip(self.fit.names, self.fit.standard_deviations.tolist(), strict=True)),
            "interval_95": dict(zip(self.fit.names, self.fit.intervals().tolist(), strict=True)),
            "covariance": self.fit.covariance.tolist(),
            "residual_sd_n": self.fit.sigma,
            "degrees_of_freedom": self.fit.dof,
            "condition": self.fit.condition,
            "r2": self.fit.r2,
            "paper_b": self.fit.b,
            "exponent": self.exponent[0],
            "exponent_sd": self.exponent[1],
            "exponent_interval": list(self.exponent_interval),
            "points": len(self.points),
            "judgement": self.judgement,
            "candidates": [
                {"model": candidate.name, "aicc": candidate.aicc} for candidate in self.candidates
            ],
        }


@dataclass(frozen=True, eq=False)
class UnitFit:
    """Everything that the pulls told about one group: all points, fits by side (empty for a table of points),
    and the table where the characteristic is one.
    """

    unit: Unit
    regression: Regression
    points: Points
    directions: Mapping[str, DirectionFit]
    table: ThrustTable | None

    @property
    def kind(self) -> str:
        """Kind of characteristic that is written."""
        if self.table is not None:
            return "table"
        if self.regression.kind is not None:
            return self.regression.kind
        square = self.regression.order == "square" and self.unit.command == "rpm"
        return "quadratic" if square else "polynomial"

    @property
    def sides(self) -> tuple[str, ...]:
        """Directions that were tested."""
        tested = (side for side, sign in SIDES.items() if (sign * self.points.signal > 0.0).any())
        return tuple(tested)

    def thrust(self, signal: Array, voltage_v: Array | None = None) -> Array:
        """Fitted thrust (m,) in N of one actuator; NaN in a direction that was not tested."""
        if self.table is not None:
            return self.table.at(signal, voltage_v)
        result = np.where(signal == 0.0, 0.0, np.nan)
        for side, direction in self.directions.items():
            own = SIDES[side] * signal > 0.0
            if own.any():
                result[own] = direction.thrust(signal[own], None if voltage_v is None else voltage_v[own])
        return result


def actuator_ratios(fit: UnitFit) -> dict[tuple[str, ...], tuple[float, float]]:
    """Thrust over that of the group's curve and its standard deviation, per set of actuators that ran; empty
    where only one set ran.
    """
    points = fit.points
    fitted = fit.thrust(points.signal, points.voltage_v if fit.regression.with_voltage else None)
    ratios = {}
    for names in dict.fromkeys(points.running):
        own = np.array([other == names for other in points.running]) & np.isfinite(fitted)
        if own.sum() > SETTINGS.fewest_alone and fitted[own].any():
            ratio = least_squares(fitted[own, None], points.thrust[own], terms_of(1, 1, through_origin=True))
            ratios[names] = float(ratio.coefficients[0]), float(ratio.standard_deviations[0])
    return ratios if len(ratios) > 1 else {}


def fit_unit(unit: Unit, pulls: Sequence[PullPoints], regression: Regression, *, where: str) -> UnitFit:
    """Fit of a group from its pulls, of a regression without gaps but ``kind``, ``tolerance_n`` and
    ``table_voltage_v``; a TrialError, begun with `where`, for points that do not suit the order.
    """
    points = Points.pooled(pulls)
    if regression.kind == "quadratic" and unit.command != "rpm":
        raise TrialError(
            f'{where}: kind = "quadratic" is thrust per n|n| of revolutions, but {unit.name} is commanded in'
            f' {unit.command}; use order = 2 or order = "points"'
        )
    # A table needs no model of the curve; everything below fits one.
    if regression.order == "points":
        table = from_points(
            points.signal,
            points.thrust,
            points.voltage_v if regression.with_voltage else None,
            knots=regression.knots or SETTINGS.table_points,
            tolerance=regression.tolerance_n,
            where=where,
        )
        return UnitFit(unit, regression, points, {}, table)
    if regression.with_voltage and not np.isfinite(points.voltage_v).all():
        raise TrialError(
            f"{where}: the supply voltage is not known at every point; map a column voltage_v, give"
            ' voltage_v, or leave "voltage" out of the inputs'
        )
    directions = {}
    for side, sign in SIDES.items():
        own = np.flatnonzero(sign * points.signal > 0.0)
        if len(own):
            directions[side] = _direction(side, own, points, regression, f"{where}, {side}")
    made = UnitFit(unit, regression, points, directions, None)
    # The vehicle file has polynomials of second order in the signal alone; the rest becomes a table.
    wanted = regression.kind == "table" or regression.with_voltage or regression.order == 3
    return UnitFit(unit, regression, points, directions, _tabulated(made)) if wanted else made


def _direction(
    side: str, own: NDArray[np.int_], points: Points, regression: Regression, where: str
) -> DirectionFit:
    sign = SIDES[side]
    signal, thrust = np.abs(points.signal[own]), sign * points.thrust[own]
    if thrust.mean() < 0.0:
        what = "positive signals pull against" if sign > 0.0 else "negative signals pull along"
        raise TrialError(
            f"{where}: {what} the direction of the vehicle file (mean {sign * thrust.mean():+.3g} N); check"
            " axis or direction of the pull, the sign of the load column, and reversed in the vehicle file"
        )
    inputs = signal[:, None]
    if regression.with_voltage:
        inputs = np.column_stack([signal, points.voltage_v[own]])
    square = regression.order == "square"
    terms = terms_of(
        2 if square else int(regression.order or 2),
        inputs.shape[1],
        through_origin=bool(regression.through_origin),
        square=square,
    )
    # Outliers are always named; the bench file decides whether they are left out.
    out = _outliers(inputs, thrust, terms)
    used = ~out if regression.outliers == "drop" else np.ones(len(own), bool)
    try:
        # The scatter is needed to know the zero error of each cell, whose columns widen the second fit.
        sigma = least_squares(inputs[used], thrust[used], terms).sigma
        common = sign * points.zero_columns(sigma)[own][used]
        fit = least_squares(inputs[used], thrust[used], terms, common=common)
    except ValueError as error:
        raise TrialError(f"{where}: {error}") from None
    compared = candidates(signal[used], thrust[used]) if not regression.with_voltage else ()
    judgement = lack_of_fit(compared, terms, int(used.sum())) if compared else ""
    exponent, interval = _exponent(
        signal[used], thrust[used], min([fit.sigma, *(candidate.scatter for candidate in compared)])
    )
    return DirectionFit(side, fit, own[used], own[out], compared, judgement, exponent, interval)


def _outliers(inputs: Array, thrust: Array, terms: tuple[Term, ...]) -> NDArray[np.bool_]:
    """Outliers of the chosen order; where it misses the curve, only those of a cubic, too."""
    out = outliers(inputs, thrust, terms)
    flexible = terms_of(3, inputs.shape[1])
    if not out.any() or len(thrust) < SETTINGS.points_per_term * len(flexible):
        return out
    # Points that a stiff curve misses may be the curve's own shape: those of a cubic are wrong for both.
    beyond = outliers(inputs, thrust, flexible)
    rest = ~beyond
    stiff, cubic = (least_squares(inputs[rest], thrust[rest], t).sigma for t in (terms, flexible))
    return out & beyond if cubic < SETTINGS.misfit * stiff else out


def _exponent(
    signal: Array, thrust: Array, scatter: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Slope of log thrust over log signal and its standard deviation; its 95 % interval. A point errs by the
    scatter in N and by three per cent of its thrust, so that weak ones count less.
    """
    strong = thrust > SETTINGS.exponent_share * thrust.max()
    if strong.sum() < 4 or np.ptp(np.log(signal[strong])) < 1e-9:
        return (np.nan, np.nan), (np.nan, np.nan)
    weight = 1.0 / np.hypot(1.0, scatter / (SETTINGS.exponent_error * thrust[strong]))
    rows = weight[:, None] * np.column_stack([np.ones(len(weight)), np.log(signal[strong])])
    fit = least_squares(rows, weight * np.log(thrust[strong]), ((1, 0), (0, 1)))
    low, high = fit.intervals()[1]
    return (float(fit.coefficients[1]), float(fit.standard_deviations[1])), (float(low), float(high))


def _tabulated(made: UnitFit) -> ThrustTable:
    """The fitted curves or surfaces as a table, over the tested signals and voltages."""
    points, regression = made.points, made.regression
    grid: list[float] = [0.0]
    for side in made.sides:
        strongest = float(np.abs(points.signal[SIDES[side] * points.signal > 0.0]).max())
        grid += [
            SIDES[side] * strongest * (k + 1) / SETTINGS.table_points for k in range(SETTINGS.table_points)
        ]
    volts: tuple[float, ...] = ()
    if regression.with_voltage:
        low, high = float(points.voltage_v.min()), float(points.voltage_v.max())
        volts = regression.table_voltage_v or tuple(
            np.linspace(low, high, 6).tolist() if high > low else [low]
        )
    return from_surface(
        made.thrust,
        points.signal,
        points.thrust,
        points.voltage_v if regression.with_voltage else None,
        grid=sorted(grid),
        voltages=volts,
    )


def _doubt(kind: str, subject: str, **values: Any) -> Finding:
    """What looks wrong in a bench test; its words are in `seatrial.report.results.bench_test`."""
    return Finding(kind, Severity.PROBLEM, subject, values)


def motor_doubts(unit: str, motor: MotorEstimate) -> list[Finding]:
    """What looks wrong in a group's motor."""
    return [
        _doubt("no motor", unit, name=name, value_s=parameter.value)
        for name, parameter in motor.parameters.items()
        if name in ("T_1", "T_t") and parameter.value is not None and parameter.value > SETTINGS.slowest_s
    ]


def pull_doubts(records: Sequence[PullPoints]) -> list[Finding]:
    """Which of a group's pulls are no measurement of their own, or not of what they are called."""
    doubts = []
    for record in records:
        sign = SIDES.get(record.name.lower())
        if sign is not None and not (sign * record.signal > 0.0).any():
            doubts.append(_doubt("wrong side", record.name, file=record.file, side=record.name.lower()))
    for k, record in enumerate(records):
        same = [other.name for other in records[:k] if _equal(record, other)]
        if same:
            doubts.append(_doubt("points twice", record.name, other=same[0]))
    return doubts


def _equal(pull: PullPoints, other: PullPoints) -> bool:
    """Whether two pulls hold the same points, whatever side they are said to pull to."""
    return np.array_equal(pull.signal, other.signal) and np.array_equal(
        np.abs(pull.thrust), np.abs(other.thrust)
    )


def curve_doubts(fit: UnitFit, vehicle: Vehicle) -> list[Finding]:
    """What looks wrong in a group's characteristic."""
    facts = vehicle.actuator_info()[fit.unit.actuators[0]]
    unit, group, volts = fit.unit.command, fit.unit.name, fit.points.voltage_v
    doubts = []
    for side in fit.sides:
        sign = SIDES[side]
        tested = np.abs(fit.points.signal[sign * fit.points.signal > 0.0])
        low = float(facts[f"minimum_{side}"]) or float(tested.min())
        limit = float(facts[f"maximum_{side}"])
        high = limit if np.isfinite(limit) else float(tested.max())
        where = f"{group} {side}"
        if high > SETTINGS.beyond * tested.max():
            doubts.append(_doubt("untested range", where, tested=tested.max(), most=high, unit=unit))
        # From the least to the largest signal of the motor, not only where it was tested.
        grid = np.linspace(low, high, SETTINGS.grid_points)
        for voltage_v in _voltages(fit):
            at = None if voltage_v is None else np.full(SETTINGS.grid_points, voltage_v)
            thrust = sign * fit.thrust(sign * grid, at)
            known = {"unit": unit, "supply_v": voltage_v}
            rounding = SETTINGS.rounding * np.abs(thrust).max()
            # A polynomial may bend back between its points.
            below = np.flatnonzero(thrust < np.maximum.accumulate(thrust) - rounding)
            if len(below):
                top = int(thrust[: below[0] + 1].argmax())
                bottom = top + int(thrust[top : below[-1] + 1].argmin())
                doubts.append(_doubt("curve falls", where, top=grid[top], bottom=grid[bottom], **known))
            against = np.flatnonzero(thrust < -rounding)
            if len(against):
                doubts.append(_doubt("curve pushes back", where, up_to=grid[against[-1]], **known))
    low, high = dead_band(fit.points.signal, fit.points.thrust)
    inside = (fit.points.signal >= low) & (fit.points.signal <= high)
    if fit.directions and inside.sum() >= SETTINGS.quiet_points:
        doubts.append(_doubt("dead band smeared", group, low=low, high=high, unit=unit))
    # Revolutions say what the supply does to the thrust; pulses and shares do not.
    if unit != "rpm" and not fit.regression.with_voltage and np.isfinite(volts).all():
        low, high = float(volts.min()), float(volts.max())
        if high > SETTINGS.sagged * low:
            doubts.append(_doubt("supply sagged", group, low_v=low, high_v=high))
    for side, direction in fit.directions.items():
        if direction.fit.r2 < SETTINGS.poor_r2:
            doubts.append(_doubt("poor fit", f"{group} {side}", r2=direction.fit.r2))
    return doubts


def _voltages(fit: UnitFit) -> list[float | None]:
    if fit.table is not None and len(fit.table.voltage_v):
        return [float(v) for v in fit.table.voltage_v]
    return [None]
