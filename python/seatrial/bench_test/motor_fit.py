"""Least squares of a motor's response: robust fit from several starts, covariance, undetermined parameters.

The residual is measured minus modelled, over the knee of the loss; derivatives are central differences of
the exact response with steps far below a sample, so that a kink (a sample that meets the end of the dead
time) enters at most one of them.

The covariance is a sandwich over blocks (`seatrial.statistics.uncertainty`): errors of a motor are coloured,
because the rotor has dynamics that a PT1 lacks, and they repeat with every step. Blocks miss one error: on a
plateau whose noise is small against the step of the digits, rounding is one constant error, which a limit or
the gain follows exactly and leaves no residual. Its variance is at most ``q^2/12`` and falls with the noise
as ``exp(-4 pi^2 sd^2/q^2)`` (the first harmonic of the sawtooth of rounding: Widrow and Kollár, *Quantization
Noise*, 2008, chapter 5); each level's error is carried to the parameters and added. A limit that two or three
plateaus show rests on as many blocks, whose sums may agree by chance: no standard deviation is taken smaller
than that of errors which have their mean square and memory throughout.

A parameter is left out of the fit where the commands never reach it: a direction that was not driven, a
limit that no command reaches, a rate that no step meets. After the fit a rate limit is dropped where the
interval of its reciprocal reaches zero (no limit would fit as well), and a time where its interval is wider
than itself and than a sample. Held by ``tests/bench_test/test_motor_dynamics.py`` and
``tests/bench_test/test_motor_coverage.py``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array, Mask
from seatrial.bench_test.motor_model import NAMES, RECIPROCAL, SIDES, MotorModel, StepRecord
from seatrial.bench_test.motor_plateaus import Noise, Plateau, Statics, limited
from seatrial.statistics.blocks import whitened
from seatrial.statistics.linearisation import Linearisation, Piece, Unknown
from seatrial.statistics.uncertainty import covariance

Loss = Literal["huber", "soft_l1", "none"]


@dataclass(frozen=True)
class MotorFitSettings:
    """Steps and tolerances of the search for a motor's parameters."""

    step: float = 1e-4  #: Of a coordinate's natural size: difference quotients.
    coarse: float = 1e-5  #: Relative tolerance to choose a start.
    end: float = 1e-9  #: Relative tolerance of the result.
    same_cost: float = 1e-3  #: Relative cost within which two starts found the same minimum.
    same_level: float = 0.2  #: Of a quantum: modelled levels closer than this are equal.
    gain_width: float = 0.1  #: Of the gain: a wider interval is of no use.


SETTINGS = MotorFitSettings()


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
            up[index] += SETTINGS.step * size[index]
            down[index] = max(down[index] - SETTINGS.step * size[index], 0.0)
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
    ends = (
        [_descent(problem, point, evaluations, SETTINGS.coarse) for point in points]
        if len(points) > 1
        else []
    )
    best = min(range(len(ends)), key=lambda k: (ends[k].cost, k), default=0)
    end = _descent(problem, ends[best].x if ends else points[0], evaluations, SETTINGS.end)
    agreeing = sum(other.cost <= end.cost * (1.0 + SETTINGS.same_cost) + 1e-12 for other in ends)
    return replace(end, agreeing=agreeing, starts=len(ends)) if ends else end


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
    """Standard deviation of the greater part of the errors: 1.4826 times their median magnitude."""
    return 1.4826 * float(np.median(np.abs(errors))) if len(errors) else math.nan


NORMAL = 1.959964
"""Standard deviations of half a 95 % interval of a normal distribution."""


@dataclass(frozen=True)
class MotorUncertainty:
    """How sure the coordinates (11,) of a motor are: standard deviation, half of the 95 % interval; infinite
    where they were not free or not determined, where the ``covariance`` (11, 11) is zero.
    """

    sigma: Array
    half: Array
    dof: Array
    covariance: Array
    block_s: float
    blocks: int


def uncertainty(problem: Problem, x: Array, noise: Noise) -> MotorUncertainty:
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
    sandwich = covariance(lin, length=view.length)
    even = np.sqrt(np.diag(view.transform @ view.coloured @ view.transform.T))
    with np.errstate(invalid="ignore"):
        student = np.where(sandwich.sigma > 0, (sandwich.upper - sandwich.estimate) / sandwich.sigma, NORMAL)
    hidden = _hidden(problem, x, noise, slopes, weight)
    unseen = np.sqrt(np.diag(hidden))
    sigma, half = np.full(len(NAMES), np.inf), np.full(len(NAMES), np.inf)
    sigma[free] = np.hypot(np.maximum(sandwich.sigma, even), unseen)
    half[free] = np.hypot(np.maximum(student * sandwich.sigma, NORMAL * even), NORMAL * unseen)
    sigma[np.isnan(sigma)] = half[np.isnan(half)] = np.inf
    dof, matrix = np.zeros(len(NAMES)), np.zeros((len(NAMES), len(NAMES)))
    dof[free] = sandwich.dof
    # Wider standard deviations leave the correlations as they are.
    wider = np.where(sandwich.sigma > 0, np.maximum(even / np.maximum(sandwich.sigma, 1e-300), 1.0), 1.0)
    matrix[np.ix_(free, free)] = sandwich.covariance * np.outer(wider, wider) + hidden
    return MotorUncertainty(sigma, half, dof, matrix, sandwich.block_s, sandwich.blocks)


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
        steady.append(np.abs(change) < SETTINGS.same_level * noise.quantum)
    still = np.concatenate(steady)
    _, owner = np.unique(
        np.rint(np.concatenate(levels)[still] / (SETTINGS.same_level * noise.quantum)), return_inverse=True
    )
    if not len(owner):
        return none
    pulls = np.zeros((int(owner.max()) + 1, slopes.shape[1]))
    np.add.at(pulls, owner, (weight[:, None] * slopes)[still])
    size = np.sqrt(np.maximum((weight[:, None] * slopes**2).sum(axis=0), 1e-300))
    information = (slopes / size).T @ (weight[:, None] * slopes / size)
    moved = pulls / size @ np.linalg.pinv(information, rcond=1e-11, hermitian=True) / size
    return np.asarray(variance * moved.T @ moved)


@dataclass(frozen=True)
class Reason:
    """Why a parameter is not determined, and what bounds it all the same."""

    text: str
    at_least: float | None = None
    at_most: float | None = None


def reachable(
    records: Sequence[StepRecord], settled: Sequence[Plateau], static: Statics, *, dead_band: bool
) -> dict[str, Reason]:
    """Reasons by name of the parameters that the commands cannot determine. With a dead band n_min is found
    by search.
    """
    reasons: dict[str, Reason] = {}
    commands = np.concatenate([record.held[1] for record in records])
    growing, shrinking = _moves(records, static)
    for side, (sign, where) in enumerate(zip((1.0, -1.0), SIDES, strict=True)):
        mine = sign * commands[sign * commands > 0]
        if not len(mine):
            for limit in ("n_min", "n_max", "n_acc", "n_dec"):
                reasons[f"{limit}_{where}"] = Reason(f"the records hold no command {where}")
            continue
        followed = [abs(plateau.command) for plateau in settled if sign * plateau.command > 0]
        if math.isinf(static.n_max[side]):
            reasons[f"n_max_{where}"] = _unreached(float(mine.max()), followed, where, largest=True)
        if not static.n_min[side] > 0 and not (dead_band and static.dropped[side] > 0):
            reasons[f"n_min_{where}"] = _unreached(float(mine.min()), followed, where, largest=False)
        if not growing[side]:
            reasons[f"n_acc_{where}"] = Reason(f"no step grows {where}")
        if not shrinking[side]:
            reasons[f"n_dec_{where}"] = Reason(f"no step shrinks {where}")
    return reasons


def unseen_rates(x: Array, known: MotorUncertainty, free: NDArray[np.bool_]) -> dict[str, Reason]:
    """Reasons by name of the rate limits that a fit without them would not miss, the least seen first."""
    doubtful = []
    for k in np.flatnonzero(free & RECIPROCAL):
        if x[k] > known.half[k]:
            continue
        side = NAMES[k].rpartition("_")[2]
        verb = "grow" if NAMES[k].startswith("n_acc") else "shrink"
        slowest = x[k] + known.half[k]
        text = f"the steps that {verb} {side} look the same without it, given lag and dead time"
        reason = Reason(text, at_least=1.0 / slowest if math.isfinite(slowest) else None)
        doubtful.append((x[k] / known.half[k] if known.half[k] > 0 else 0.0, NAMES[k], reason))
    doubtful.sort(key=lambda rate: rate[:2])
    return {name: reason for _, name, reason in doubtful}


def wide(x: Array, known: MotorUncertainty, sample: float) -> dict[str, Reason]:
    """Reasons by name of gain and times whose interval is too wide to be of use."""
    reasons = {}
    if not known.half[0] <= SETTINGS.gain_width * x[0]:
        reasons["K_V"] = Reason("its interval is wider than a tenth of it")
    for k in (1, 2):
        if not known.half[k] <= max(x[k], sample):
            upper = x[k] + known.half[k]
            reasons[NAMES[k]] = Reason(
                "its interval is wider than the time itself and than a sample; steps of several sizes, some"
                " too small for the rate limit to matter, would determine it",
                at_most=float(upper) if math.isfinite(upper) else None,
            )
    return reasons


def _unreached(asked: float, followed: Sequence[float], where: str, *, largest: bool) -> Reason:
    """Why n_max or n_min is not determined, of the extreme command and those that settled without a limit."""
    if not followed:
        return Reason(f"no command {where} is held until the motor settles")
    bound, edge = ("at_least", max(followed)) if largest else ("at_most", min(followed))
    if (asked > edge) if largest else (asked < edge):
        side = "above" if largest else "below"
        text = f"the commands {where} {side} {edge:g} are not held until the motor settles"
        return Reason(text, **{bound: edge})
    what = "reaches it: the largest" if largest else "lies below it: the smallest"
    return Reason(f"no command {where} {what}, {asked:g}, is still followed", **{bound: asked})


def _moves(records: Sequence[StepRecord], static: Statics) -> tuple[list[bool], list[bool]]:
    """Whether the limited command grows and shrinks, ahead and astern."""
    growing, shrinking = [False, False], [False, False]
    for record in records:
        levels = np.array([limited(float(c), static.n_min, static.n_max) for c in record.held[1]])
        for side, sign in enumerate((1.0, -1.0)):
            change = np.diff(np.maximum(sign * levels, 0.0))
            growing[side] |= bool((change > 0).any())
            shrinking[side] |= bool((change < 0).any())
    return growing, shrinking
