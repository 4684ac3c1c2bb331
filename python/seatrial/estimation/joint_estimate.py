"""Joint estimate: Gauss-Newton on all coefficients, nuisance parameters and initial conditions at once.

The rounds are those of `seatrial.estimation.gauss_newton`. Here they follow one another, from one start or
several, until a round promises nothing more. The loss is squared or Huber's, its knee in standard deviations
of the channel's residual, which are estimated on the way.

Tests: ``tests/estimation/test_polish.py``.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.progress import Step
from seatrial.estimation.gauss_newton import INITIALS, GaussNewton
from seatrial.estimation.joint import Joint
from seatrial.statistics.linearisation import Linearisation

__all__ = ["Polished", "linearise", "polish"]

_CLOSE = 0.1
"""A round that gains less than this many units of twice the log-likelihood ends the polish: a step of a third
of a standard deviation in all unknowns together."""

_SETTLE = 3

_SPREAD = 0.1


@dataclass(frozen=True)
class Polished:
    """What the joint polish found.

    ``values`` (m,) of the unknowns, ``initial`` (segments, 12) initial conditions, ``noise`` (C,) standard
    deviation of each channel's residual, ``cost`` and ``start_cost`` half the robust sum of squares and
    priors in these units, at the end and at the start, over the ``samples`` that count in all channels.
    ``spread`` (starts, m) is where the starts ended, ``costs`` (starts,) the negative log-likelihood there.
    """

    values: Array
    initial: Array
    noise: Array
    cost: float
    start_cost: float
    samples: int
    rounds: int
    evaluations: int
    converged: bool
    interrupted: bool
    wall_s: float
    spread: Array
    costs: Array

    def rms(self, cost: float) -> float:
        """Root mean square residual in its standard deviation, outliers bounded, that a cost stands for."""
        return float(np.sqrt(2.0 * cost / max(self.samples, 1)))

    def to_dict(self, names: Sequence[str]) -> dict[str, Any]:
        """The polish as plain numbers, values by the unknowns' names."""
        costs = ("cost", "start_cost", "samples")
        kept = (*costs, "rounds", "evaluations", "converged", "interrupted", "wall_s")
        return {key: getattr(self, key) for key in kept} | {
            "values": dict(zip(names, self.values.tolist(), strict=True)),
            "noise": self.noise.tolist(),
            "starts": [
                {"cost": cost, "values": dict(zip(names, row, strict=True))}
                for cost, row in zip(self.costs.tolist(), self.spread.tolist(), strict=True)
            ],
        }


def polish(
    joint: Joint,
    *,
    start: Array | None = None,
    fixed: Sequence[int] = (),
    rounds: int | None = None,
    watch: Callable[[Step], None] | None = None,
) -> Polished:
    """Joint estimate from a start, and from others around it where the campaign asks for several.

    Parameters
    ----------
    joint : Joint
    start : ndarray, shape (m,), optional
        By default the joint estimate's own start.
    fixed : sequence of int
        Places of unknowns that keep their start value (for a profile).
    rounds : int, optional
        Rounds at most; by default the campaign's. None is taken with zero: the start is judged.
    watch : callable, optional
        Called after every round; it may raise KeyboardInterrupt.
    """
    began = time.monotonic()
    first = joint.start if start is None else np.asarray(start, dtype=float)
    limit = joint.polish.rounds if rounds is None else rounds
    search = _Descent(joint, frozenset(fixed), limit, watch)
    found = [search.run(first)]
    generator = np.random.default_rng(joint.campaign.seed)
    for _ in range(joint.polish.starts - 1):
        if found[-1].interrupted:
            break
        found.append(search.run(search.scattered(first, generator)))
    best = min(found, key=lambda one: search.judge(one))
    return replace(
        best,
        start_cost=found[0].start_cost,
        evaluations=sum(one.evaluations for one in found),
        interrupted=found[-1].interrupted,
        wall_s=time.monotonic() - began,
        spread=np.array([one.values for one in found]),
        costs=np.array([search.judge(one) for one in found]),
    )


def linearise(
    joint: Joint,
    values: Array,
    *,
    initial: Array | None = None,
    noise: Array | None = None,
    extra: Sequence[str] = (),
) -> Linearisation:
    """Linearisation at the values of the unknowns, initial conditions at their best.

    Parameters
    ----------
    joint : Joint
    values : ndarray, shape (m,)
    initial : ndarray, shape (segments, 12), optional
        Initial conditions; by default they are found.
    noise : ndarray, shape (C,), optional
        Standard deviations of the channels' residuals; by default they are estimated.
    extra : sequence of str
        Coefficients that are not estimated but differentiated too, appended to the unknowns.
    """
    search = GaussNewton(joint)
    if noise is not None:
        search.noise = noise
    if initial is None:
        initial = np.zeros((len(joint.data.segments), 12))
        for _ in range(_SETTLE if joint.initials else 1):
            if noise is None:
                search.estimate_noise(joint.residuals(values, initial))
            initial = initial + search.settled(values, initial)
    return search.linearisation(values, initial, extra)


class _Descent:
    """Workspace of one polish from one start or several."""

    def __init__(
        self, joint: Joint, fixed: frozenset[int], limit: int, watch: Callable[[Step], None] | None
    ) -> None:
        self.joint, self.limit, self.watch = joint, limit, watch
        self.rounds = GaussNewton(joint, fixed)
        self.began = time.monotonic()

    def run(self, start: Array) -> Polished:
        """The optimum that one start leads to."""
        joint = self.joint
        values, centre = start.copy(), start.copy()
        centre[len(joint.parameters) :] = 0.0
        self.rounds.noise = joint.noise.copy()
        initial = np.zeros((len(joint.data.segments), len(INITIALS)))
        self.rounds.estimate_noise(joint.residuals(values, initial))
        if joint.initials:
            initial = initial + self.rounds.settled(values, initial)
            self.rounds.estimate_noise(joint.residuals(values, initial))
        before = initial
        rounds, evaluations, converged, interrupted = 0, self.rounds.evaluations, False, False
        try:
            while rounds < self.limit and not converged:
                rounds += 1
                values, initial, promised = self.rounds.round(values, initial, centre)
                noise = self.rounds.noise.copy()
                self.rounds.estimate_noise(joint.residuals(values, initial))
                settled = bool(np.all(np.abs(self.rounds.noise / noise - 1) < _SPREAD))
                converged = settled and promised < _CLOSE
                self._show(rounds, values, initial, centre)
        except KeyboardInterrupt:
            interrupted = True
        return Polished(
            values=values,
            initial=initial,
            noise=self.rounds.noise.copy(),
            cost=self.rounds.cost(values, initial, centre),
            start_cost=self.rounds.cost(start, before, centre),
            samples=sum(int(joint.counted(i).sum()) for i in range(len(joint.data.segments))),
            rounds=rounds,
            evaluations=self.rounds.evaluations - evaluations,
            converged=converged,
            interrupted=interrupted,
            wall_s=time.monotonic() - self.began,
            spread=values[None],
            costs=np.zeros(1),
        )

    def scattered(self, start: Array, generator: np.random.Generator) -> Array:
        """Another start: coefficients anywhere in the middle half of their bounds."""
        count = len(self.joint.parameters)
        other = start.copy()
        inside = generator.uniform(0.25, 0.75, count)
        other[:count] = self.rounds.lower[:count] + inside * (
            self.rounds.upper[:count] - self.rounds.lower[:count]
        )
        return other

    def judge(self, one: Polished) -> float:
        """Cost of a result in the noise of the first one's channels, so that results compare."""
        counts = [self.joint.data.counts[c] for c in self.joint.used]
        return one.cost + float(np.asarray(counts) @ np.log(one.noise))

    def _show(self, rounds: int, values: Array, initial: Array, centre: Array) -> None:
        if self.watch is not None:
            self.watch(
                Step(
                    "polish",
                    rounds,
                    self.limit,
                    self.rounds.evaluations,
                    self.rounds.cost(values, initial, centre),
                    time.monotonic() - self.began,
                )
            )
