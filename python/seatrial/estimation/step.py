"""Step of a stage: an integer division of the log's step, the same for every candidate.

RK4 is stable to h|lambda| = 2.8; at h|lambda| <= 0.25 its error stays below the sensors' noise. The bound on
the fastest rate lambda is sought over the whole bounds box before the search: velocity and attitude dynamics
are linearised by finite differences at the largest measured speeds, for every coefficient at either bound and
for the worst of them together. One step for all makes a candidate's cost independent of its company.

The global search only ranks candidates: it takes h|lambda| <= 1, stable everywhere in the box. The fine
search flies its best ones again at h|lambda| <= 0.25, the bound sought over the part of the box around them:
corners of the whole box hold vehicles several times as fast as those that follow the log.

Tests: ``tests/estimation/test_step.py``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES
from seatrial.base.errors import CampaignError, SeatrialError
from seatrial.campaign.parameters import Parameter

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["RATE_LIMIT", "SEARCH_RATE_LIMIT", "StageStep", "around", "stage_step"]

RATE_LIMIT = 0.25
"""Largest h|lambda|."""

SEARCH_RATE_LIMIT = 1.0
"""Largest h|lambda| in the global search."""

_NEAR = 0.1

_MARGIN = 1.1

_SPEED_MARGIN = 1.2

_MOST_SUBSTEPS = 100

_DIFFERENCE = 1e-4


@dataclass(frozen=True)
class StageStep:
    """Substeps per sample of the log and the bound that asked for them, rad/s.

    ``search`` are the substeps of the global search, at most as many.
    """

    substeps: int
    rate: float
    search: int


def stage_step(
    vehicle: Vehicle, parameters: Sequence[Parameter], *, free: str, speeds: Array, dt: float, where: str
) -> StageStep:
    """Step for a vehicle whose parameters roam their bounds.

    Parameters
    ----------
    vehicle : Vehicle
    parameters : sequence of Parameter
        All that may differ from the vehicle's values, those of former stages included.
    free : str
        Letters of the free axes.
    speeds : ndarray, shape (6,)
        Largest measured speeds, m/s and rad/s.
    dt : float
        Step of the log, s.
    where : str
        Words for messages.

    Raises
    ------
    CampaignError
        The bounds admit a vehicle so light or so damped that no reasonable step follows it.
    """
    points = _operating_points(_SPEED_MARGIN * speeds)
    axes = [AXES.index(letter) for letter in free]

    def rate(values: dict[str, float]) -> float:
        try:
            return _fastest_rate(vehicle.with_coefficients(values), points, axes)
        except SeatrialError:
            return 0.0  # no vehicle at this corner: such a candidate diverges whatever the step

    worst: dict[str, float] = {}
    rates = [rate({})]
    for parameter in parameters:
        ends = [parameter.coefficients(bound) for bound in (parameter.lower, parameter.upper)]
        found = [rate(end) for end in ends]
        rates += found
        worst |= ends[int(np.argmax(found))]
    rates.append(rate(worst))
    bound = _MARGIN * max(rates)
    substeps, search = (max(math.ceil(dt * bound / limit), 1) for limit in (RATE_LIMIT, SEARCH_RATE_LIMIT))
    if substeps > _MOST_SUBSTEPS:
        raise CampaignError(
            f"{where}: the bounds admit a vehicle with a rate of {bound:.3g} rad/s, which needs {substeps}"
            f" steps per sample of {dt:g} s; keep the bounds of the inertias and added masses away from zero"
            " mass, or narrow those of the damping"
        )
    return StageStep(substeps, bound, search)


def around(parameters: Sequence[Parameter], points: Array) -> tuple[Parameter, ...]:
    """Parameters whose bounds are narrowed to points (k, m) and a tenth of the box on either side."""
    narrowed = []
    for parameter, values in zip(parameters, points.T, strict=True):
        margin = _NEAR * (parameter.upper - parameter.lower)
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
        nu[:, 2 * j, j] += _DIFFERENCE
        nu[:, 2 * j + 1, j] -= _DIFFERENCE
    for j in range(3):
        attitude[:, 12 + 2 * j, 1 + j] = 0.5 * _DIFFERENCE
        attitude[:, 13 + 2 * j, 1 + j] = -0.5 * _DIFFERENCE
    acceleration = vehicle.acceleration(
        nu.reshape(-1, 6), attitude.reshape(-1, 4), np.zeros((n * 18, 6))
    ).reshape(n, 9, 2, 6)
    slope = (acceleration[:, :, 0] - acceleration[:, :, 1]) / (2 * _DIFFERENCE)
    mass = np.asarray(vehicle.mass_matrix())
    force = np.einsum("ij,nkj->nik", mass, slope)  # (n, 6 forces, 9 states: nu and a small rotation)
    force[:, :, :6] += _inflow(vehicle)
    reduced = np.linalg.solve(mass[np.ix_(axes, axes)], force[:, axes, :])
    turning = [axis for axis in axes if axis >= 3]
    columns = [*axes, *(axis + 3 for axis in turning)]
    system = np.zeros((n, len(columns), len(columns)))
    system[:, : len(axes)] = reduced[:, :, columns]
    for row, axis in enumerate(turning):
        system[:, len(axes) + row, axes.index(axis)] = 1.0
    return float(np.abs(np.linalg.eigvals(system)).max())


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
