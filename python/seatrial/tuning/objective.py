"""The cost of a set of gains: what its responses violate, what its margins lack, what orders the feasible.

    J = 10 Q + 30 M + 0.05 T + s S + 0.1 E

Q is the constraint criterion in s (eq. 55-57 of Taubert et al., 2014, (57) corrected), the mean over
trials, and of the samples the worst or a quantile; M is the shortfall of the margins; both are zero for
feasible gains. T, the time-weighted error over the time, and E, the rate at which commands move, break the
tie, and S, the roughness along the supporting points, keeps a schedule from jumping. An integral of
violations grows with the square of how far a response leaves its corridor, so that a search would settle a
little outside: it is held against a corridor that is narrower by a reserve.

Held by tests/test_tuning_objective.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.tuning.gain_parameters import GainParameters
from seatrial.tuning.loop_trials import LoopTrials, Samples
from seatrial.tuning.smoothness import roughness
from seatrial.tuning.step_trial import Rig

if TYPE_CHECKING:
    from seatrial.tuning.margin_constraint import MarginConstraint

__all__ = ["LACKING", "OUTSIDE", "RESERVE", "Objective", "Terms", "robust", "violated"]

Array = NDArray[np.float64]

RESERVE = 0.02
"""By how much the search's corridors are narrower, as a share of the step."""

OUTSIDE, LACKING = 10.0, 30.0
"""How much a second outside the corridors, and a margin that is used up, count against what breaks ties."""

_TIME, _EFFORT = 0.05, 0.1
_SPREAD = 0.1  # of the mean over samples, beside the worst: every one that gets better counts


@dataclass(frozen=True, eq=False)
class Terms:
    """Parts of the cost of k candidates, (k,) each: Q (s), M, T (s), S and E (1/s)."""

    violation: Array
    margin: Array
    time: Array
    roughness: Array
    effort: Array

    def cost(self, smoothness: float) -> Array:
        """J, (k,)."""
        ties = _TIME * self.time + smoothness * self.roughness + _EFFORT * self.effort
        return np.asarray(OUTSIDE * self.violation + LACKING * self.margin + ties)


@dataclass(frozen=True, eq=False)
class Objective:
    """Cost of candidates of some gains, all others as they are.

    Attributes
    ----------
    rig
        The closed loop with the gains that are not searched.
    trials
        One per loop or path of the search.
    samples
        What each candidate meets.
    parameters
        What is searched.
    margins
        Limits of the margins; None for none.
    quantile
        Over the samples; 1.0 is the worst.
    smoothness
        Weight of the roughness.
    reached
        Whether the vehicle reaches each supporting point.
    """

    rig: Rig
    trials: tuple[LoopTrials, ...]
    samples: Samples
    parameters: GainParameters
    margins: MarginConstraint | None
    quantile: float
    smoothness: float
    reached: NDArray[np.bool_]

    def __call__(self, x: Array) -> Array:
        """Costs (k,) of candidates (k, m)."""
        return self.terms(self.parameters.gains(x)).cost(self.smoothness)

    def terms(self, gains: Mapping[str, Array], *, reserve: float = RESERVE) -> Terms:
        """Parts of the cost of k sets of gains."""
        k = len(next(iter(gains.values())))
        total = np.zeros((k, len(self.samples)))
        time, effort = np.zeros(k), np.zeros(k)
        for trials in self.trials:
            sums, travel = self.rig.violations(trials, self.samples, gains, reserve=reserve)
            total += violated(trials, sums).mean(axis=1) / len(self.trials)
            time += sums[..., 0, 2].mean(axis=(1, 2)) / trials.until_s / len(self.trials)
            effort += travel.mean(axis=(1, 2)) / len(self.trials)
        loops = {name.partition(".")[0] for name in gains}
        # Points that another group sets belong to the schedule all the same.
        every = {name: np.full(1, value) for name, value in self.rig.autopilot.gains().items()}
        every = {name: values for name, values in every.items() if name.partition(".")[0] in loops} | dict(
            gains
        )
        named = {name: values for name, values in every.items() if name.rpartition(".")[2].isdigit()}
        rough = (
            roughness(named, self.reached, speeds_m_s=self.rig.autopilot.speeds_m_s) if named else np.zeros(1)
        )
        lacking = np.zeros(k) if self.margins is None else self.margins.shortfall(gains)
        over_samples = robust(total, self.quantile, nominal=self.samples.nominal)
        return Terms(over_samples, lacking, time, np.broadcast_to(rough, (k,)), effort)


def violated(trials: LoopTrials, sums: Array) -> Array:
    """Weighted violation, s, (k, trials, samples), of sums (k, trials, samples, corridors, 3)."""
    weights = np.ones((sums.shape[-2], 2))
    weights[0] = trials.corridor.weight_lower, trials.corridor.weight_upper
    sides = sums[..., :2]
    counted = np.where(np.isfinite(sides) & (weights > 0.0), sides, 0.0)
    diverged = np.isinf(sides).any(axis=(-1, -2))
    return np.where(diverged, np.inf, (counted * weights).sum(axis=(-1, -2)))


def robust(total: Array, quantile: float, *, nominal: int = 0) -> Array:
    """Worst or a quantile over the samples, and a tenth of their mean, (k,), of violations (k, samples).

    Parameters
    ----------
    total : (k, samples) array
    quantile : float
        1 is the worst.
    nominal : int, optional
        So many of the first are the vehicle itself, whose worst counts at any quantile: it is what a
        tuning is feasible by.
    """
    sound = np.isfinite(total).all(axis=1)
    bounded = np.where(np.isfinite(total), total, 0.0)
    own, drawn = bounded[:, :nominal], bounded[:, nominal:]
    worst = own.max(axis=1, initial=0.0)
    if drawn.shape[1]:
        worst = np.maximum(worst, np.quantile(drawn, quantile, axis=1))
    found = worst + _SPREAD * bounded.mean(axis=1)
    return np.where(sound, found, np.inf)
