"""Criterion of a stage: mean weighted error per sample, in standard deviations of the channel.

``Q = sum_c W_c sum_i loss(|y - y_hat| / s_c) / sum_c W_c N_c``: least absolute error by default (Taubert et
al. 2014, eq. 48), each channel scaled by its standard deviation s_c over the N_c samples that count.

Initial velocities of the segments as nuisance parameters: one Gauss-Newton step per segment.

A segment that starts from one noisy velocity is wrong from its first sample on, and the coefficients would be
bent to repair that. Given the coefficients, the free axes' initial velocity of every segment is corrected so
that the segment's residuals fall, held near its smoothed value by a prior as wide as the sensor's noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from seatrial import _core
from seatrial.base.arrays import Array
from seatrial.base.channels import AXES, CHANNELS
from seatrial.base.rotation import shorter
from seatrial.campaign.file import Stage
from seatrial.campaign.parameters import Parameter, names, spread
from seatrial.estimation.descent import Slopes
from seatrial.estimation.segments import StageData

if TYPE_CHECKING:
    from seatrial.campaign.campaign import Campaign

__all__ = ["Criterion", "estimate_initial_velocities", "velocity_noise"]


class Criterion:
    """Costs ``(k,)`` of candidates ``(k, m)`` over the segments of a stage.

    Parameters
    ----------
    campaign : Campaign
    stage : Stage
    vehicle : Vehicle
        Gives what the parameters do not set.
    parameters : sequence of Parameter
    data : StageData
    substeps : int
        Steps per sample of the log.
    threads : int, optional
        Threads of the batch call; the costs do not depend on it.
    """

    def __init__(
        self,
        campaign: Campaign,
        stage: Stage,
        *,
        vehicle: _core.Vehicle,
        parameters: Sequence[Parameter],
        data: StageData,
        substeps: int,
        threads: int | None = None,
    ) -> None:
        self.stage, self.vehicle, self.data, self.threads = stage, vehicle, data, threads
        self.substeps = substeps
        self.names = names(parameters)
        self.spread = spread(parameters)
        self.nu = np.array([segment.nu for segment in data.segments])
        self._share = data.weights / float(data.weights @ data.counts)
        counting = data.weights > 0
        inverse = np.where(counting, 1.0 / np.where(counting, data.scale, 1.0), 0.0)
        self.records = [
            trial.record(weight=mask * inverse, substeps=substeps, input=campaign.input_of(name))
            for name, trial, mask in zip(data.names, data.trials, data.counted, strict=True)
        ]
        self.open_loop = self.started(self.nu)

    def started(self, nu: ArrayLike) -> _core.OpenLoop:
        """Open loop whose segments start at the velocities (segments, 6)."""
        segments = [
            (piece.trial, piece.start, piece.stop, piece.position, piece.attitude, tuple(map(float, row)))
            for piece, row in zip(self.data.segments, np.asarray(nu), strict=True)
        ]
        return _core.OpenLoop(
            self.vehicle,
            self.records,
            segments,
            free=self.stage.axes.free,
            measured=self.stage.axes.measured,
            loss=self.stage.loss,
            knee=self.stage.knee,
            substeps=self.substeps,
            names=self.names,
        )

    def start_at(self, nu: Array) -> None:
        """Start the segments at other velocities (segments, 6)."""
        self.nu = nu
        self.open_loop = self.started(nu)

    def __call__(self, candidates: Array) -> Array:
        """Costs (k,) of candidates (k, m), infinite where the simulation diverges."""
        errors = np.asarray(self.open_loop.errors(candidates @ self.spread, threads=self.threads))
        with np.errstate(invalid="ignore"):
            costs = errors.sum(axis=1) @ self._share
        return np.where(np.isfinite(errors).all(axis=(1, 2)), costs, np.inf)

    def per_segment(self, candidate: Array, open_loop: _core.OpenLoop | None = None) -> Array:
        """Cost (segments,) of one candidate, summed over samples: they add up to the cost."""
        loop = self.open_loop if open_loop is None else open_loop
        errors = np.asarray(loop.errors(candidate[None, :] @ self.spread, threads=self.threads))[0]
        return np.asarray(np.where(np.isfinite(errors).all(axis=1), errors @ self._share, np.inf))

    def residuals(self, candidate: Array, open_loop: _core.OpenLoop | None = None) -> list[Array]:
        """Measured minus simulated (n_i, 12) per segment, in standard deviations, zero where not counted."""
        loop = self.open_loop if open_loop is None else open_loop
        found = []
        for piece, simulated in zip(self.data.segments, loop.predict(candidate @ self.spread), strict=True):
            trial = self.data.trials[piece.trial]
            mask = self.data.counted[piece.trial][piece.start : piece.stop]
            error = np.where(mask, trial.observed[piece.start : piece.stop] - simulated, 0.0)
            error[:, 9:] = shorter(error[:, 9:])
            error[0] = 0.0
            scale = np.where(self.data.weights > 0, self.data.scale, 1.0)
            found.append(error / scale)
        return found

    def linearised(self, candidate: Array) -> Slopes:
        """Residuals of all samples that count and their derivatives by the parameters (m,)."""
        scale = np.where(self.data.weights > 0, self.data.scale, 1.0)
        used = np.flatnonzero(self.data.weights > 0)
        residuals, jacobians, shares = [], [], []
        shown = self.open_loop.sensitivities(
            candidate @ self.spread, self.spread, channels=[CHANNELS[c] for c in used], threads=self.threads
        )
        for piece, residual, (_, jacobian) in zip(
            self.data.segments, self.residuals(candidate), shown, strict=True
        ):
            counted = self.data.counted[piece.trial][piece.start : piece.stop, used].copy()
            counted[0] = False
            residuals.append(residual[:, used][counted])
            jacobians.append((jacobian / scale[used, None])[counted])
            shares.append(np.broadcast_to(self._share[used], counted.shape)[counted])
        knee = {"absolute": 0.0, "squared": np.inf, "huber": self.stage.knee}[self.stage.loss]
        return Slopes(np.concatenate(residuals), np.concatenate(jacobians), np.concatenate(shares), knee)

    def slopes(self, candidate: Array, initials: Sequence[str]) -> list[Array]:
        """Derivatives (n_i, 12, k) of what segments show by initial conditions, scaled as residuals."""
        values = candidate @ self.spread
        found = []
        shown = self.open_loop.sensitivities(
            values, np.zeros((0, len(values))), initials=initials, threads=self.threads
        )
        for piece, (_, jacobian) in zip(self.data.segments, shown, strict=True):
            counted = self.data.counted[piece.trial][piece.start : piece.stop].copy()
            counted[0] = False
            scale = np.where(self.data.weights > 0, self.data.scale, 1.0)
            found.append(np.where(counted[:, :, None], jacobian / scale[:, None], 0.0))
        return found


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
