"""Step of a stage: an integer division of the log's step, the same for every candidate.

RK4 is stable to h|lambda| = 2.8; at h|lambda| <= 0.25 its error stays below the sensors' noise. The bound on
the fastest rate lambda is sought over the whole bounds box before the search: velocity and attitude dynamics
are linearised by finite differences at the largest measured speeds, for every coefficient at either bound and
for the worst of them together. One step for all makes a candidate's cost independent of its company.

The global search only ranks candidates: it takes h|lambda| <= 1, stable everywhere in the box. The fine
search flies its best ones again at h|lambda| <= 0.25, the bound sought over the part of the box around them:
corners of the whole box hold vehicles several times as fast as those that follow the log.

Bounds that admit almost no mass hold vehicles of any rate. The search takes `most_search` steps per sample
at most; what is faster diverges there and ranks last. Which coefficients admit such vehicles, and the bounds
from which none is left, is said before the search. All of it follows from the bounds alone, so that the same
campaign is answered alike in every run.

Tests: ``tests/estimation/test_step.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES
from seatrial.base.errors import SeatrialError
from seatrial.base.report import wording
from seatrial.problem.parameter import Parameter

if TYPE_CHECKING:
    from seatrial._core import Vehicle


@dataclass(frozen=True)
class StepSettings:
    """How short a step the fastest motion asks for."""

    #: Largest h|lambda| of the fine search: its error stays below the noise of sensors.
    rate_limit: float = 0.25
    #: Largest h|lambda| of the global search, which only ranks: stable everywhere in the box.
    search_rate_limit: float = 1.0
    #: Largest h|lambda| of derivatives that judge an estimate: an error of a thousandth in them.
    slope_rate_limit: float = 0.5
    #: Margin about the points of a search, a share of the width of the bounds.
    near_share: float = 0.1
    #: Bound on the rates over the highest that was found.
    margin: float = 1.1
    #: Speeds at which rates are judged, over the recorded ones.
    speed_margin: float = 1.2
    #: Steps per sample at most, of the fine search and of derivatives.
    most_substeps: int = 100
    #: Steps per sample at most of the global search: what is faster diverges there and ranks last.
    most_search: int = 40
    #: Halvings that find a bound to 1e-9 of its interval.
    bisections: int = 30
    #: Half of the finite differences of speeds, SI, and of attitude.
    difference: float = 1e-4
    #: Rate that stands for one without a number, rad/s: no step follows it.
    fastest: float = 1e9


STEP_SETTINGS = StepSettings()


@dataclass(frozen=True)
class StageStep:
    """Substeps per sample of the log and the bound that asked for them, rad/s.

    ``search`` are the substeps of the global search and ``slopes`` those of derivatives that judge, at most
    as many. ``fast`` names what admits vehicles that they do not follow: coefficient, its bound, and the
    bound that leaves none; the coefficient is empty where the vehicle itself is one of them.
    """

    substeps: int
    rate: float
    search: int
    slopes: int
    fast: tuple[tuple[str, float, float], ...] = ()

    def sentence(self, dt: float) -> str:
        """What the search will not follow, and the bounds that mend it; empty where it follows all."""
        return str(wording("estimates").step(self, dt))


def stage_step(
    vehicle: Vehicle, parameters: Sequence[Parameter], *, free: str, speeds: Array, dt: float
) -> StageStep:
    """Step for a vehicle whose parameters roam their bounds.

    ``parameters``: all that may differ from the vehicle's values, those of former stages included. ``free``:
    letters of the free axes. ``speeds`` (6,): largest measured speeds, m/s and rad/s. ``dt``: step of the
    log, s.
    """
    points = _operating_points(STEP_SETTINGS.speed_margin * speeds)
    axes = [AXES.index(letter) for letter in free]

    def rate(values: Mapping[str, float]) -> float:
        try:
            return _fastest_rate(vehicle.with_coefficients(dict(values)), points, axes)
        except SeatrialError:
            return 0.0  # no vehicle at this corner: such a candidate diverges whatever the step

    corner: dict[str, float] = {}
    rates = [rate({})]
    for parameter in parameters:
        ends = (parameter.lower, parameter.upper)
        rates_at_ends = [rate(parameter.coefficients(end)) for end in ends]
        rates += rates_at_ends
        corner[parameter.name] = ends[int(np.argmax(rates_at_ends))]
    rates.append(rate(_values(parameters, corner)))
    bound = STEP_SETTINGS.margin * max(rates)
    limits = (STEP_SETTINGS.rate_limit, STEP_SETTINGS.slope_rate_limit, STEP_SETTINGS.search_rate_limit)
    fine, slopes, search = (max(math.ceil(dt * bound / limit), 1) for limit in limits)
    fast: tuple[tuple[str, float, float], ...] = ()
    if search > STEP_SETTINGS.most_search:
        limit = STEP_SETTINGS.most_search * STEP_SETTINGS.search_rate_limit / (dt * STEP_SETTINGS.margin)
        fast = _too_fast(parameters, corner, rate, limit)
    return StageStep(
        min(fine, STEP_SETTINGS.most_substeps),
        bound,
        min(search, STEP_SETTINGS.most_search),
        min(slopes, STEP_SETTINGS.most_substeps),
        fast,
    )


def _values(parameters: Sequence[Parameter], chosen: Mapping[str, float]) -> dict[str, float]:
    """Coefficients that the chosen values of parameters set."""
    values: dict[str, float] = {}
    for parameter in parameters:
        if parameter.name in chosen:
            values |= parameter.coefficients(chosen[parameter.name])
    return values


def _too_fast(
    parameters: Sequence[Parameter],
    corner: Mapping[str, float],
    rate: Callable[[Mapping[str, float]], float],
    limit: float,
) -> tuple[tuple[str, float, float], ...]:
    """Parameters whose bounds admit faster vehicles than the limit, rad/s, with the bounds that do not.

    The one whose start value slows the fastest corner most goes first; where it does not suffice, it stays
    there and the next one is sought.
    """
    by_name = {parameter.name: parameter for parameter in parameters}
    # Each parameter's own fast end counts as well as the corner of all of them together.
    left = {name: end for name, end in corner.items() if by_name[name].start != end}
    fast: list[tuple[str, float, float]] = []
    while left:

        def at(name: str, value: float, others: Mapping[str, float] = left) -> float:
            return max(
                rate(_values(parameters, {**others, name: value})), rate(_values(parameters, {name: value}))
            )

        slowest = min(left, key=lambda name: at(name, by_name[name].start))
        bound, good, bad = left[slowest], by_name[slowest].start, left[slowest]
        if at(slowest, bound) <= limit:
            break
        if at(slowest, good) <= limit:
            for _ in range(STEP_SETTINGS.bisections):
                middle = 0.5 * (good + bad)
                good, bad = (middle, bad) if at(slowest, middle) <= limit else (good, middle)
        fast.append((slowest, bound, good))
        del left[slowest]
        if good != by_name[slowest].start:
            break
    return tuple(fast) if fast and rate({}) <= limit else (("", 0.0, 0.0),)


def sound_digits(value: float, bound: float) -> str:
    """A value rounded to three digits away from the bound that it replaces."""
    if value == 0.0:
        return "0"
    unit = 10.0 ** (math.floor(math.log10(abs(value))) - 2)
    rounded = math.floor(value / unit) if value < bound else math.ceil(value / unit)
    return f"{rounded * unit:.3g}"


def around(parameters: Sequence[Parameter], points: Array) -> tuple[Parameter, ...]:
    """Parameters whose bounds are narrowed to points (k, m) and a tenth of the box on either side."""
    narrowed = []
    for parameter, values in zip(parameters, points.T, strict=True):
        margin = STEP_SETTINGS.near_share * (parameter.upper - parameter.lower)
        lower = max(parameter.lower, float(values.min()) - margin)
        upper = min(parameter.upper, float(values.max()) + margin)
        narrowed.append(replace(parameter, lower=lower, upper=upper))
    return tuple(narrowed)


def _operating_points(speeds: Array) -> Array:
    """Velocities (n, 6): at rest, each axis alone, all axes with several signs."""
    signs = [(1, 1, 1, 1, 1, 1), (1, 1, 1, -1, -1, -1), (1, -1, 1, 1, -1, 1), (-1, 1, 1, -1, 1, 1)]
    rows = [np.zeros(6), *np.diag(speeds), *-np.diag(speeds), *(np.array(sign) * speeds for sign in signs)]
    return np.array(rows)


def _fastest_rate(vehicle: Vehicle, points: Array, axes: list[int]) -> float:
    """Largest |eigenvalue| of the free axes' velocity and attitude dynamics, rad/s."""
    n = len(points)
    nu = np.repeat(points, 18, axis=0).reshape(n, 18, 6)
    attitude = np.zeros((n, 18, 4))
    attitude[..., 0] = 1.0
    for j in range(6):
        nu[:, 2 * j, j] += STEP_SETTINGS.difference
        nu[:, 2 * j + 1, j] -= STEP_SETTINGS.difference
    for j in range(3):
        attitude[:, 12 + 2 * j, 1 + j] = 0.5 * STEP_SETTINGS.difference
        attitude[:, 13 + 2 * j, 1 + j] = -0.5 * STEP_SETTINGS.difference
    acceleration = vehicle.acceleration(
        nu.reshape(-1, 6), attitude.reshape(-1, 4), np.zeros((n * 18, 6))
    ).reshape(n, 9, 2, 6)
    slope = (acceleration[:, :, 0] - acceleration[:, :, 1]) / (2 * STEP_SETTINGS.difference)
    mass = np.asarray(vehicle.mass_matrix())
    force = np.einsum("ij,nkj->nik", mass, slope)  # (n, 6 forces, 9 states: nu and a small rotation)
    force[:, :, :6] += _inflow(vehicle)
    try:
        reduced = np.linalg.solve(mass[np.ix_(axes, axes)], force[:, axes, :])
    except np.linalg.LinAlgError:  # the free axes have no mass
        return STEP_SETTINGS.fastest
    turning = [axis for axis in axes if axis >= 3]
    columns = [*axes, *(axis + 3 for axis in turning)]
    system = np.zeros((n, len(columns), len(columns)))
    system[:, : len(axes)] = reduced[:, :, columns]
    for row, axis in enumerate(turning):
        system[:, len(axes) + row, axes.index(axis)] = 1.0
    # Coefficients near the largest number overflow on the way.
    if not np.isfinite(system).all():
        return STEP_SETTINGS.fastest
    try:
        return min(float(np.abs(np.linalg.eigvals(system)).max()), STEP_SETTINGS.fastest)
    except np.linalg.LinAlgError:
        return STEP_SETTINGS.fastest


def _inflow(vehicle: Vehicle) -> Array:
    """Force per velocity (6, 6) that the inflow costs the thrusters at full revolutions: p2 |n| w w'."""
    total = np.zeros((6, 6))
    values = vehicle.coefficients()
    for name, facts in vehicle.actuator_info().items():
        p2 = values.get(f"{name}.p2", 0.0)
        if p2 and facts["unit"] == "rpm":
            fastest = max(abs(facts["maximum_ahead"]), abs(facts["maximum_astern"])) / 60.0
            wrench = np.asarray(facts["wrench"], dtype=float)
            total += p2 * fastest * np.outer(wrench, wrench)
    return total
