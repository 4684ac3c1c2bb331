"""Criterion of a stage: mean weighted error per sample, in standard deviations of the channel.

``Q = sum_c W_c sum_i loss(|y - y_hat| / s_c) / sum_c W_c N_c``: least absolute error by default (Taubert et
al. 2014, eq. 48), each channel scaled by its standard deviation s_c over the N_c samples that count.

Initial velocities of the segments are nuisance parameters. A segment that starts from one noisy velocity is
wrong from its first sample on, and the coefficients would be bent to repair that. Given the coefficients, one
Gauss-Newton step corrects the free axes' initial velocity of every segment so that its residuals fall, held
near the smoothed value by a prior as wide as the sensor's noise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES, CHANNELS
from seatrial.estimation.descent import Slopes
from seatrial.estimation.segment_model import SegmentModel, StageData


class Criterion:
    """Costs ``(k,)`` of candidates ``(k, m)`` over the segments of a stage.

    Parameters
    ----------
    problem : Problem
        Of the stage. The costs do not depend on its threads.
    """

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


_SWEEPS = 5
"""Reweightings of the absolute residuals."""

_FLOOR = 0.1
"""Part of the mean residual below which residuals are taken as squares."""

_LEAST_NOISE = 0.03  # of the largest speed: a sensor that repeats its samples looks better than it is


def with_initial_velocities(criterion: Criterion, candidate: Array, prior: Array) -> Criterion:
    """The criterion with segments at better initial velocities; a segment that gains nothing stays.

    Parameters
    ----------
    criterion : Criterion
    candidate : ndarray, shape (m,)
        Parameters, held fixed.
    prior : ndarray, shape (segments, 6)
        Smoothed velocities, m/s and rad/s.
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
    return np.asarray(np.maximum(np.mean(widths, axis=0), _LEAST_NOISE * largest))


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
    floor = np.tile(_FLOOR * known, len(residual))
    for _ in range(_SWEEPS):
        robust = weight / np.maximum(np.abs(flat + jacobian @ delta), floor)
        normal = jacobian.T @ (robust[:, None] * jacobian) + np.eye(len(delta))
        delta = np.asarray(-np.linalg.solve(normal, jacobian.T @ (robust * flat) + away), dtype=float)
    return np.clip(delta, -3.0, 3.0)
