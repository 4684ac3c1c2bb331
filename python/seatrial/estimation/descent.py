"""Criterion of a stage, and Gauss-Newton steps to the floor of the valley that its global search has found.

``Q = sum_c W_c sum_i loss(|y - y_hat| / s_c) / sum_c W_c N_c``: least absolute error by default (Taubert et
al. 2014, eq. 48), each channel scaled by its standard deviation s_c over the N_c samples that count. Initial
velocities of the segments are nuisance parameters: given the coefficients, one Gauss-Newton step corrects
those of the free axes, held near the smoothed value by a prior as wide as the sensor's noise.

Damping and lift of one axis trade against each other, so that the criterion is a long narrow valley. A step
solves it with the model linearised, ``min_d sum_i s_i L(r_i - J_i d)`` inside the bounds, the loss by
reweighted least squares (Holland & Welsch 1977); eight lengths of it are tried in one batch, and only a lower
cost is accepted.

Tests: ``tests/estimation/test_descent.py``, ``tests/estimation/test_step.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES, CHANNELS
from seatrial.base.work import Watch
from seatrial.estimation.search import Ledger, Objective, Optimum
from seatrial.estimation.segment_model import SegmentModel, StageData


@dataclass(frozen=True)
class DescentSettings:
    """How a descent of a stage steps, and what it takes for noise."""

    #: Steps of a descent at most; three to six are usual.
    rounds: int = 15
    #: Reweightings of a step at most; the step has settled to 1e-5 before.
    sweeps: int = 8
    #: Share of the mean error below which an absolute error counts as its square: reweighting divides by it.
    square_below: float = 0.1
    #: Reweightings of a correction of initial velocities.
    start_sweeps: int = 5
    #: Share of the mean residual below which it counts as its square in such a correction.
    start_square_below: float = 0.1
    #: Least noise of a velocity, a share of the largest speed: a sensor that repeats its samples looks better
    #: than it is.
    least_noise: float = 0.03


SETTINGS = DescentSettings()


_LENGTHS = np.array([1.0, 0.7, 0.5, 0.3, 0.15, 0.05, 0.01, 1.3])
"""Lengths of a step that are tried in one batch of eight lanes; one is beyond the full step."""


@dataclass(frozen=True)
class Slopes:
    """A criterion's residuals and their derivatives at a candidate."""

    #: Measured minus simulated (n,), in standard deviations of the channel.
    residual: Array
    #: Derivative (n, m) of what is simulated by the parameters, in the same unit.
    jacobian: Array
    #: Share (n,) of every sample in the criterion.
    share: Array
    #: Up to here, in standard deviations, an error counts as its square: 0 for absolute, infinite for squared
    #: errors, between them Huber's loss.
    knee: float


def descend(
    objective: Objective,
    slopes: Callable[[Array], Slopes],
    start: ArrayLike,
    *,
    lower: ArrayLike,
    upper: ArrayLike,
    rounds: int = SETTINGS.rounds,
    tolerance: float = 1e-4,
    watch: Watch | None = None,
) -> Optimum:
    """Optimum of a descent inside the bounds from one start.

    ``objective``: costs ``(k,)`` of candidates ``(k, m)``. ``slopes``: `Slopes` at a candidate ``(m,)``.
    ``lower``, ``upper`` (m,): bounds; no candidate lies outside. ``rounds``: steps at most. ``tolerance``:
    stop when a step gains less than a tenth of this fraction of the cost. ``watch``: called with a `Step`
    after every round; a KeyboardInterrupt that it raises ends the descent.

    Examples
    --------
    >>> import numpy as np
    >>> from seatrial.estimation.descent import Slopes, descend
    >>> model = lambda x: Slopes(np.array([1.0, 2.0]) - x, np.eye(2), np.full(2, 0.5), np.inf)
    >>> cost = lambda x: 0.5 * ((np.array([1.0, 2.0]) - x) ** 2).sum(axis=1)
    >>> descend(cost, model, [0.0, 0.0], lower=[-5, -5], upper=[5, 1.5]).x.round(6).tolist()
    [1.0, 1.5]
    """
    ledger = Ledger(objective, lower, upper, "descent", rounds, watch)

    def search() -> None:
        at = ledger.to_box(start)
        ledger.start_cost = float(ledger.costs(at[None, :])[0])
        while ledger.generation < rounds:
            here = slopes(ledger.from_box(at))
            jacobian = here.jacobian * ledger.width
            if not (np.isfinite(here.residual).all() and np.isfinite(jacobian).all()):
                break
            step = _step(here, jacobian, -at, 1.0 - at)
            before = ledger.best_cost
            candidates = np.clip(at + _LENGTHS[:, None] * step, 0.0, 1.0)
            costs = ledger.costs(candidates)
            if costs.min() < before:
                at = candidates[int(costs.argmin())]
            ledger.close_generation()
            if not before - ledger.best_cost > 0.1 * tolerance * abs(before):
                break

    return ledger.run(search)


def _step(slopes: Slopes, jacobian: Array, lower: Array, upper: Array) -> Array:
    """Step (m,) between the bounds that minimises the linearised criterion."""
    from scipy.optimize import lsq_linear

    floor = SETTINGS.square_below * float(slopes.share @ np.abs(slopes.residual)) / float(slopes.share.sum())
    knee = max(slopes.knee, floor, np.finfo(float).tiny)
    step: Array = np.zeros(jacobian.shape[1])
    for _ in range(SETTINGS.sweeps):
        if np.isinf(knee):
            weight = slopes.share
        else:
            weight = slopes.share / np.maximum(np.abs(slopes.residual - jacobian @ step), knee)
        weighted = weight[:, None] * jacobian
        normal = weighted.T @ jacobian
        # A direction that changes nothing must not spoil the others: it stays where it is.
        normal += np.eye(len(step)) * max(1e-10 * float(np.trace(normal)), np.finfo(float).tiny)
        factor = np.linalg.cholesky(normal)
        aim = np.linalg.solve(factor, weighted.T @ slopes.residual)
        bounds = (np.minimum(lower, 0.0) - 1e-12, np.maximum(upper, 0.0) + 1e-12)
        former, step = step, np.asarray(lsq_linear(factor.T, aim, bounds=bounds).x, dtype=float)
        if np.abs(step - former).max() < 1e-5:
            break
    return step


class Criterion:
    """Costs ``(k,)`` of candidates ``(k, m)`` over the segments of a stage."""

    def __init__(self, model: SegmentModel) -> None:
        self.model, self.data = model, model.data
        counting = self.data.weights > 0
        self._scale = np.where(counting, self.data.scale, 1.0)
        self._weight = np.where(counting, 1.0 / self._scale, 0.0)
        self._share = self.data.weights / float(self.data.weights @ self.data.counts)

    @property
    def nu(self) -> Array:
        """Velocities (segments, 6) at which the segments start."""
        return np.array([segment.nu for segment in self.model.data.segments])

    def started(self, nu: Array) -> Criterion:
        """The same criterion with segments that start at the velocities (segments, 6)."""
        return Criterion(self.model.started(nu))

    def __call__(self, candidates: Array) -> Array:
        """Costs (k,) of candidates (k, m), infinite where the simulation diverges."""
        errors = self._losses(candidates)
        with np.errstate(invalid="ignore"):
            costs = errors.sum(axis=1) @ self._share
        return np.where(np.isfinite(errors).all(axis=(1, 2)), costs, np.inf)

    def per_segment(self, candidate: Array) -> Array:
        """Cost (segments,) of one candidate, summed over samples: they add up to the cost."""
        errors = self._losses(candidate[None, :])[0]
        return np.asarray(np.where(np.isfinite(errors).all(axis=1), errors @ self._share, np.inf))

    def residuals(self, candidate: Array) -> list[Array]:
        """Measured minus simulated (n_i, 12) per segment, in standard deviations, zero where not counted."""
        return [error / self._scale for error in self.model.residuals(candidate)]

    def linearised(self, candidate: Array) -> Slopes:
        """Residuals of all samples that count and their derivatives by the parameters (m,)."""
        used = np.flatnonzero(self.data.weights > 0)
        segments = self.model.sensitivities(candidate, channels=[CHANNELS[c] for c in used])
        residuals, jacobians, shares = [], [], []
        for index, (error, jacobian) in enumerate(segments):
            counted = self.model.counted(index)[:, used]
            residuals.append((error / self._scale)[:, used][counted])
            jacobians.append((jacobian / self._scale[used, None])[counted])
            shares.append(np.broadcast_to(self._share[used], counted.shape)[counted])
        stage = self.model.stage
        knee = {"absolute": 0.0, "squared": np.inf, "huber": stage.knee}[stage.loss]
        return Slopes(np.concatenate(residuals), np.concatenate(jacobians), np.concatenate(shares), knee)

    def slopes(self, candidate: Array, initials: Sequence[str]) -> list[Array]:
        """Derivatives (n_i, 12, k) of what segments show by initial conditions, scaled as residuals."""
        segments = self.model.sensitivities(candidate, held=True, initials=initials)
        return [jacobian / self._scale[:, None] for _, jacobian in segments]

    def _losses(self, candidates: Array) -> Array:
        """Losses (k, segments, 12) of candidates in the stage's units."""
        stage = self.model.stage
        return self.model.losses(candidates, weight=self._weight, loss=stage.loss, knee=stage.knee)


def with_initial_velocities(criterion: Criterion, candidate: Array, prior: Array) -> Criterion:
    """The criterion with segments at better initial velocities; a segment that gains nothing stays.

    ``candidate`` (m,): parameters, held fixed. ``prior`` (segments, 6): smoothed velocities, m/s and rad/s.
    """
    axes = [AXES.index(letter) for letter in criterion.model.stage.axes.free]
    noise = velocity_noise(criterion.data)[axes]
    residuals = criterion.residuals(candidate)
    slopes = criterion.slopes(candidate, [f"initial_{CHANNELS[axis]}" for axis in axes])
    mean, thinning = _spread(residuals)
    moved = criterion.nu.copy()
    for index, residual in enumerate(residuals):
        jacobian = -(slopes[index] * noise).reshape(-1, len(axes))
        away = (criterion.nu[index] - prior[index])[axes] / noise
        delta = _correction(residual, jacobian, mean, thinning, away)
        moved[index, axes] += delta * noise
    better = criterion.started(moved).per_segment(candidate) < criterion.per_segment(candidate)
    return criterion.started(np.where(better[:, None], moved, criterion.nu))


def velocity_noise(data: StageData) -> Array:
    """Standard deviation (6,) of measured about smoothed velocity; without one a tenth of the largest."""
    largest = np.maximum(data.largest_speeds(), 1e-3)
    widths = []
    for trial in data.trials:
        difference = trial.observed[:, :6] - trial.smooth_nu(trial.t)[0]
        with np.errstate(invalid="ignore"):
            known = trial.valid[:, :6] & np.isfinite(difference)
            count = known.sum(axis=0)
            squares = (np.where(known, difference, 0.0) ** 2).sum(axis=0)
        widths.append(np.where(count > 0, np.sqrt(squares / np.maximum(count, 1)), 0.1 * largest))
    return np.asarray(np.maximum(np.mean(widths, axis=0), SETTINGS.least_noise * largest))


def _spread(residuals: list[Array]) -> tuple[Array, Array]:
    """Mean absolute residual (12,) and the fraction (12,) of them that are independent.

    Neighbouring residuals of an imperfect model repeat one another; n of them with correlation r from one to
    the next tell as much as n (1 - r) / (1 + r) independent ones.
    """
    stacked = np.concatenate(residuals)
    power = (stacked**2).sum(axis=0)
    lagged = np.sum([(residual[1:] * residual[:-1]).sum(axis=0) for residual in residuals], axis=0)
    correlation = np.clip(lagged / np.where(power > 0, power, 1.0), 0.0, 0.99)
    mean = np.abs(stacked).sum(axis=0) / np.maximum((stacked != 0).sum(axis=0), 1)
    return mean, (1 - correlation) / (1 + correlation)


def _correction(residual: Array, jacobian: Array, mean: Array, thinning: Array, away: Array) -> Array:
    """Step (axes,) in the prior's widths that minimises absolute residuals plus prior, linearised.

    Absolute values by reweighted least squares; below a tenth of the mean they are taken as squares.
    """
    flat = residual.ravel()
    delta: Array = np.zeros(jacobian.shape[1])
    if not (np.isfinite(flat).all() and np.isfinite(jacobian).all()):
        return delta
    known = np.where(mean > 0, mean, 1.0)
    weight = np.tile(np.where(mean > 0, thinning / known, 0.0), len(residual))
    floor = np.tile(SETTINGS.start_square_below * known, len(residual))
    for _ in range(SETTINGS.start_sweeps):
        robust = weight / np.maximum(np.abs(flat + jacobian @ delta), floor)
        normal = jacobian.T @ (robust[:, None] * jacobian) + np.eye(len(delta))
        delta = np.asarray(-np.linalg.solve(normal, jacobian.T @ (robust * flat) + away), dtype=float)
    return np.clip(delta, -3.0, 3.0)
