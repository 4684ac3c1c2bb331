"""Certainty of a motor's estimate: sandwich covariance with blocks, and what rounded plateaus hide.

Errors of a motor are coloured: the rotor has dynamics that a PT1 lacks, and they repeat with every step.
`seatrial.certainty.uncertainty.covariance` sums scores over blocks that outlast that memory.

Blocks cannot see one thing. On a plateau whose noise is small against the step of the digits, rounding is
one constant error, which a limit or the gain follows exactly and leaves no residual. Its variance is at most
``q^2/12`` and falls with the noise as ``exp(-4 pi^2 sd^2/q^2)`` (the first harmonic of the sawtooth of
rounding: Widrow and Kollár, *Quantization Noise*, 2008, chapter 5); each level's error is carried to the
parameters and added.

A limit that two or three plateaus show rests on as many blocks, whose sums may agree by chance: no standard
deviation is taken smaller than that of errors which have their mean square and memory throughout.
Held by `tests/test_motor_coverage.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seatrial.certainty.uncertainty import covariance
from seatrial.certainty.whitened import whitened
from seatrial.linearisation import Linearisation, Piece, Unknown
from seatrial.motor_dynamics.motor_fit import Problem
from seatrial.motor_dynamics.motor_model import NAMES
from seatrial.motor_dynamics.plateaus import Noise

__all__ = ["NORMAL", "MotorCertainty", "certainty"]

Array = NDArray[np.float64]

NORMAL = 1.959964
"""Standard deviations of half a 95 % interval of a normal distribution."""

_LEVEL = 0.2  # of a quantum: modelled levels closer than this are one


@dataclass(frozen=True)
class MotorCertainty:
    """How sure the coordinates (11,) of a motor are; infinite where they were not free or not determined.

    ``half`` is half the 95 % interval, ``covariance`` (11, 11) zero where a coordinate was not free,
    ``block_s`` the length of a block.
    """

    sigma: Array
    half: Array
    dof: Array
    covariance: Array
    block_s: float
    blocks: int


def certainty(problem: Problem, x: Array, noise: Noise) -> MotorCertainty:
    """Standard deviations and intervals of the free coordinates at a minimum (11,)."""
    free = np.flatnonzero(problem.free)
    errors, slopes = problem.errors(x), problem.slopes(x)
    scale = max(float(np.sqrt(np.mean(errors**2))), noise.total)
    weight = problem.weights(errors)
    pieces, first = [], 0
    for number, record in enumerate(problem.records):
        times = record.sampled[0]
        rows = slice(first, first + len(times))
        first += len(times)
        pieces.append(
            Piece(
                trial=str(number),
                t=times,
                residual=errors[rows, None] / scale,
                counted=np.ones((len(times), 1), bool),
                weight=weight[rows, None],
                jacobian=slopes[rows, None, :] / scale,
                nu=np.zeros((len(times), 6)),
            )
        )
    unknowns = tuple(
        Unknown(NAMES[k], "coefficient", "", -math.inf, math.inf, 1.0, 0.0, math.inf) for k in free
    )
    sample = float(np.median([record.sample_s for record in problem.records]))
    lin = Linearisation(unknowns, x[free], ("revolutions",), np.array([scale]), sample, tuple(pieces))
    view = whitened(lin)
    found = covariance(lin, length=view.length)
    even = np.sqrt(np.diag(view.transform @ view.coloured @ view.transform.T))
    with np.errstate(invalid="ignore"):
        student = np.where(found.sigma > 0, (found.upper - found.estimate) / found.sigma, NORMAL)
    hidden = _hidden(problem, x, noise, slopes, weight)
    unseen = np.sqrt(np.diag(hidden))
    sigma, half = np.full(len(NAMES), np.inf), np.full(len(NAMES), np.inf)
    sigma[free] = np.hypot(np.maximum(found.sigma, even), unseen)
    half[free] = np.hypot(np.maximum(student * found.sigma, NORMAL * even), NORMAL * unseen)
    sigma[np.isnan(sigma)] = half[np.isnan(half)] = np.inf
    dof, matrix = np.zeros(len(NAMES)), np.zeros((len(NAMES), len(NAMES)))
    dof[free] = found.dof
    # Wider standard deviations leave the correlations as they are.
    wider = np.where(found.sigma > 0, np.maximum(even / np.maximum(found.sigma, 1e-300), 1.0), 1.0)
    matrix[np.ix_(free, free)] = found.covariance * np.outer(wider, wider) + hidden
    return MotorCertainty(sigma, half, dof, matrix, found.block_s, found.blocks)


def _hidden(problem: Problem, x: Array, noise: Noise, slopes: Array, weight: Array) -> Array:
    """Covariance (f, f) that the rounding of settled levels gives the free coordinates."""
    none = np.zeros((slopes.shape[1], slopes.shape[1]))
    if noise.quantum <= 0:
        return none
    variance = noise.quantum**2 / 12.0 * math.exp(-((2.0 * math.pi * noise.sd / noise.quantum) ** 2))
    model = problem.model(x)
    levels, steady = [], []
    for record in problem.records:
        at, near = record.sampled[0], 0.5 * record.sample_s
        change = model.response(record, at + near) - model.response(record, at - near)
        levels.append(model.response(record, at))
        steady.append(np.abs(change) < _LEVEL * noise.quantum)
    still = np.concatenate(steady)
    _, owner = np.unique(
        np.rint(np.concatenate(levels)[still] / (_LEVEL * noise.quantum)), return_inverse=True
    )
    if not len(owner):
        return none
    pulls = np.zeros((int(owner.max()) + 1, slopes.shape[1]))
    np.add.at(pulls, owner, (weight[:, None] * slopes)[still])
    size = np.sqrt(np.maximum((weight[:, None] * slopes**2).sum(axis=0), 1e-300))
    information = (slopes / size).T @ (weight[:, None] * slopes / size)
    moved = pulls / size @ np.linalg.pinv(information, rcond=1e-11, hermitian=True) / size
    return np.asarray(variance * moved.T @ moved)
