"""Prediction errors of a filter: the criterion of an estimate, and its Gauss-Newton step.

The step d solves ``sum (Z' W S) d = sum Z' W e`` with e the errors, S their slopes by the unknowns, W the
weight of Huber's loss and Z the instruments: what of the slopes was known when the prediction was made
(`seatrial.estimation.instruments`). One sample ahead all of it is known, Z is S, and the step is that of
Gauss and Newton.

Held by ``tests/estimation/test_innovations.py``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.estimation.joint import Joint
from seatrial.estimation.one_step import Span
from seatrial.statistics.linearisation import trust

BLOCK_S = 20.0
"""Length of the blocks of time over which sums are taken for standard deviations, s."""


@dataclass(frozen=True)
class Errors:
    """Prediction errors (n, Y) of a span, what counts, their slopes (n, Y, m) and instruments (n, Y, m)."""

    span: Span
    error: Array
    counted: Mask
    slope: Array
    instrument: Array


class GaussNewtonStep(NamedTuple):
    """A step (m,) of an estimate within its bounds.

    ``information`` (m, m) of the errors and priors; ``influence`` (b, m) of each block of time: the step that
    its errors alone would give.
    """

    step: Array
    information: Array
    influence: Array


class PredictionErrorCriterion:
    """Robust sum of squares of prediction errors, with the bounds, priors and loss of a joint estimate.

    Parameters
    ----------
    joint : Joint
    """

    def __init__(self, joint: Joint) -> None:
        self.unknowns = joint.unknowns
        self.lower = np.array([u.lower for u in joint.unknowns])
        self.upper = np.array([u.upper for u in joint.unknowns])
        self.scale = np.array([u.scale for u in joint.unknowns])
        # A bound's width is a weak prior, as in output error.
        self.prior_sd = np.minimum([u.prior_sd for u in joint.unknowns], self.scale)
        self.knee = math.inf if joint.polish.loss == "squared" else joint.polish.knee
        self.block = max(round(BLOCK_S / joint.data.dt), 1)

    def noise(self, errors: Sequence[Errors]) -> Array:
        """Standard deviation (Y,) of the prediction errors, from their median."""
        noise = np.empty(errors[0].error.shape[1])
        for column in range(len(noise)):
            sizes = np.concatenate([np.abs(part.error[part.counted[:, column], column]) for part in errors])
            noise[column] = 1.4826 * float(np.median(sizes)) if len(sizes) else math.inf
        return np.maximum(noise, 1e-12)

    def weight(self, residual: Array) -> Array:
        """Weight of Huber's loss for residuals over their noise."""
        if math.isinf(self.knee):
            return np.ones_like(residual)
        return np.asarray(self.knee / np.maximum(np.abs(residual), self.knee))

    def cost(self, errors: Sequence[Errors], noise: Array) -> float:
        """Half the robust sum of squares of the prediction errors."""
        total = 0.0
        for part in errors:
            size = np.abs(part.error / noise)
            inner = np.minimum(size, self.knee)
            total += float((inner * (size - 0.5 * inner)).sum())
        return total

    def step(
        self,
        errors: Sequence[Errors],
        noise: Array,
        at: Array,
        centre: Array,
        fixed: Sequence[int] = (),
        overlap: int = 1,
    ) -> GaussNewtonStep:
        """The step from a point (m,) with priors around another one; what is fixed stays.

        Predictions over a horizon of ``overlap`` samples overlap, and so many of them tell as much as one:
        the priors weigh accordingly more.
        """
        from scipy.optimize import lsq_linear

        precision = overlap * trust(self.unknowns, at - centre) * self.prior_sd**-2.0
        metric, information = np.diag(precision), np.diag(precision)
        blocks = []
        instrumented = any(part.instrument is not part.slope for part in errors)
        for part in errors:
            residual = part.error / noise
            weight = self.weight(residual)
            slope, known = part.slope / noise[:, None], part.instrument / noise[:, None]
            metric = metric + np.einsum("kc,kci,kcj->ij", weight, known, known, optimize=True)
            if instrumented:
                information = information + np.einsum("kc,kci,kcj->ij", weight, known, slope, optimize=True)
            pull = np.einsum("kc,kci->ki", weight * residual, known)
            blocks += [pull[k : k + self.block].sum(axis=0) for k in range(0, len(pull), self.block)]
        if not instrumented:
            information = metric
        gradient = np.sum(blocks, axis=0) - precision * (at - centre)
        free = np.array([i for i in range(len(at)) if i not in set(fixed)], dtype=np.intp)
        scale = self.scale[free]
        # The equations in the metric in which they are independent, so that a bound costs what it should.
        scaled = metric[np.ix_(free, free)] * np.outer(scale, scale)
        size = np.sqrt(np.diag(scaled))
        factor = np.linalg.cholesky(scaled / np.outer(size, size) + 1e-10 * np.eye(len(free))).T * size
        rows = factor
        if instrumented:
            rows = np.linalg.solve(factor.T, information[np.ix_(free, free)] * np.outer(scale, scale))
        target = np.linalg.solve(factor.T, gradient[free] * scale)
        away = [(bound[free] - at[free]) / scale for bound in (self.lower, self.upper)]
        solution = lsq_linear(rows, target, (np.minimum(away[0], -1e-12), np.maximum(away[1], 1e-12)))
        step = np.zeros(len(at))
        step[free] = solution.x * scale
        return GaussNewtonStep(step, information, np.linalg.solve(information, np.array(blocks).T).T)
