"""Initial velocities of the segments as nuisance parameters: one Gauss-Newton step per segment.

A segment that starts from one noisy velocity is wrong from its first sample on, and the coefficients would be
bent to repair that. Given the coefficients, the free axes' initial velocity of every segment is corrected so
that the segment's residuals fall, held near its smoothed value by a prior as wide as the sensor's noise.
"""

from __future__ import annotations

import numpy as np

from seatrial.campaign_file import AXES
from seatrial.criterion import Criterion
from seatrial.recording.columns import CHANNELS
from seatrial.search import Array
from seatrial.segments import StageData

_SWEEPS = 5
_FLOOR = 0.1
_LEAST_NOISE = 0.03  # of the largest speed: a sensor that repeats its samples looks better than it is


def estimate_initial_velocities(criterion: Criterion, candidate: Array, prior: Array) -> None:
    """Move the criterion's segments to better initial velocities; a segment that gains nothing stays.

    Parameters
    ----------
    criterion : Criterion
    candidate : ndarray, shape (m,)
        Parameters, held fixed.
    prior : ndarray, shape (segments, 6)
        Smoothed velocities, m/s and rad/s.
    """
    axes = [AXES.index(letter) for letter in criterion.stage.axes.free]
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
    before = criterion.per_segment(candidate)
    after = criterion.per_segment(candidate, criterion.started(moved))
    criterion.start_at(np.where((after < before)[:, None], moved, criterion.nu))


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
    lagged = np.sum([(one[1:] * one[:-1]).sum(axis=0) for one in residuals], axis=0)
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
