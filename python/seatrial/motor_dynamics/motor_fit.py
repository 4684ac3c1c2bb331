"""Least squares of a motor's response from several starts, with a robust loss and exact responses.

The residual is measured minus modelled, over the knee of the loss; derivatives are central differences of
the exact response with steps far below a sample, so that a kink (a sample that meets the end of the dead
time) enters at most one of them. Held by `tests/test_motor_dynamics.py`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from seatrial.motor_dynamics.motor_model import NAMES, RECIPROCAL, MotorModel
from seatrial.motor_dynamics.step_record import StepRecord

__all__ = ["Fit", "Loss", "Problem", "fit"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Loss = Literal["huber", "soft_l1", "none"]

_STEP = 1e-4  # of a coordinate's natural size
_COARSE, _END = 1e-5, 1e-9  # relative tolerances, to choose a start and of the result
_SAME = 1e-3  # relative cost within which two starts found the same minimum


@dataclass(frozen=True)
class Problem:
    """What is fitted: records, which coordinates are free, how errors count.

    ``knee`` is the error in the unit of the measurement beyond which a robust loss bends; ``base`` (11,)
    holds the coordinates that are not ``free`` (11,).
    """

    records: tuple[StepRecord, ...]
    base: Array
    free: Mask
    knee: float
    loss: Loss
    dead_band: bool

    def model(self, x: Array) -> MotorModel:
        """Motor of the coordinates (11,)."""
        return MotorModel.from_coordinates(x, dead_band=self.dead_band)

    def errors(self, x: Array) -> Array:
        """Measured minus modelled (k,) of all records."""
        model = self.model(x)
        return np.concatenate([r.sampled[1] - model.response(r, r.sampled[0]) for r in self.records])

    def cost(self, x: Array) -> float:
        """Half the sum of the losses of errors over the knee."""
        square = (self.errors(x) / self.knee) ** 2
        return 0.5 * float(np.sum(_rho(square, self.loss)))

    def weights(self, errors: Array) -> Array:
        """Weight (k,) of each error: one for small ones and without a robust loss."""
        square = (errors / self.knee) ** 2
        if self.loss == "huber":
            return np.asarray(1.0 / np.sqrt(np.maximum(square, 1.0)))
        if self.loss == "soft_l1":
            return np.asarray(1.0 / np.sqrt(1.0 + square))
        return np.ones_like(errors)

    def sizes(self) -> Array:
        """Natural sizes (11,) of the coordinates: a tenth of a sample, a hundredth of the range."""
        span = max(float(np.abs(record.held[1]).max()) for record in self.records)
        sample = min(record.sample_s for record in self.records)
        size = np.full(len(NAMES), 0.01 * span)
        size[0] = 0.01 * max(abs(float(self.base[0])), 1e-9)
        size[1:3] = 0.1 * sample
        size[RECIPROCAL] = 0.1 * sample / span
        return size

    def slopes(self, x: Array) -> Array:
        """Derivatives (k, f) of the modelled revolutions by the free coordinates."""
        size = self.sizes()
        columns = []
        for index in np.flatnonzero(self.free):
            # The last digits of the step are those that the sum can hold.
            up, down = x.copy(), x.copy()
            up[index] += _STEP * size[index]
            down[index] = max(down[index] - _STEP * size[index], 0.0)
            columns.append((self.errors(down) - self.errors(up)) / (up[index] - down[index]))
        return np.stack(columns, axis=1)


@dataclass(frozen=True)
class Fit:
    """A minimum: coordinates (11,), cost, how many of the starts found it, whether the search converged."""

    x: Array
    cost: float
    agreeing: int
    starts: int
    converged: bool


def fit(problem: Problem, points: Sequence[Array], *, evaluations: int = 60) -> Fit:
    """The best of the minima that are reached from several starts (11,); only the best is run to the end."""
    found = [_descent(problem, point, evaluations, _COARSE) for point in points] if len(points) > 1 else []
    best = min(range(len(found)), key=lambda k: (found[k].cost, k), default=0)
    end = _descent(problem, found[best].x if found else points[0], evaluations, _END)
    agreeing = sum(other.cost <= end.cost * (1.0 + _SAME) + 1e-12 for other in found)
    return replace(end, agreeing=agreeing, starts=len(found)) if found else end


def _descent(problem: Problem, point: Array, evaluations: int, tolerance: float) -> Fit:
    """The minimum that is reached from a start (11,), to a relative tolerance of the cost."""
    from scipy.optimize import least_squares

    size = problem.sizes()[problem.free]
    start = np.where(problem.free, point, problem.base)

    def full(inner: Array) -> Array:
        whole = start.copy()
        whole[problem.free] = inner
        return whole

    result: Any = least_squares(
        lambda inner: problem.errors(full(inner)) / problem.knee,
        np.maximum(start[problem.free], 1e-3 * size),
        jac=lambda inner: -problem.slopes(full(inner)) / problem.knee,
        bounds=(0.0, np.inf),
        x_scale=size,
        loss="linear" if problem.loss == "none" else problem.loss,
        xtol=tolerance,
        ftol=tolerance,
        max_nfev=evaluations,
    )
    return Fit(full(np.asarray(result.x)), float(result.cost), 1, 1, bool(result.status > 0))


def _rho(square: Array, loss: Loss) -> Array:
    """Loss of squared errors over the knee, as in SciPy's least_squares."""
    if loss == "huber":
        return np.where(square <= 1.0, square, 2.0 * np.sqrt(np.maximum(square, 1.0)) - 1.0)
    if loss == "soft_l1":
        return np.asarray(2.0 * (np.sqrt(1.0 + square) - 1.0))
    return square


def spread(errors: Array) -> float:
    """Standard deviation of the greater part of the errors: 1.4826 times their median magnitude.

    Examples
    --------
    >>> import numpy as np
    >>> spread(np.array([-1.0, 1.0, 1.0, 500.0]))
    1.48
    """
    return 1.4826 * float(np.median(np.abs(errors))) if len(errors) else math.nan
