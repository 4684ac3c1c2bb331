"""One repetition of generated trials: logged with a seed, estimated jointly, compared with the truth.

Held by ``tests/experiment/test_coverage.py``.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.diagnosis.identifiability import judge
from seatrial.diagnosis.residual_analysis import analyse_joint
from seatrial.diagnosis.weak_combination import WEAK
from seatrial.estimation.gauss_newton import GaussNewton
from seatrial.estimation.joint import Joint
from seatrial.estimation.joint_estimate import Polished, linearise, polish
from seatrial.experiment.generated_trials import GeneratedTrials
from seatrial.problem.problem import Problem
from seatrial.statistics.uncertainty import covariance

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.base.progress import Step

_AWAY = 0.25  # of the width of the bounds

_COST_95 = 1.92  # half the 95 % quantile of chi-squared with one degree of freedom

_SETTLE = 3

_AHEAD_S = 10.0


@dataclass(frozen=True)
class Repetition:
    """What one repetition found; lists over the unknowns, in their units.

    Attributes
    ----------
    seed
        Of the sensors' noise and biases.
    names, units, kinds
        Of the unknowns; kinds are "coefficient" and "nuisance".
    truth
        Right values, NaN where there is none.
    estimate, sigma, lower, upper
        Estimates, standard deviations and 95 % intervals.
    verdict
        Of `seatrial.diagnosis.identifiability.judge`; for a nuisance parameter "prior" where the data add
        little.
    residual_analysis
        What the residual analysis says; empty if it has nothing to say, None if it was not asked.
    hold_out
        R2 by vehicle ("start", "estimate", "truth") and channel on the held-out trials, ten seconds ahead.
    converged, rounds, wall_s
        How the joint estimate ended.
    """

    seed: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    kinds: tuple[str, ...]
    truth: tuple[float, ...]
    estimate: tuple[float, ...]
    sigma: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    verdict: tuple[str, ...]
    residual_analysis: tuple[str, ...] | None
    hold_out: Mapping[str, Mapping[str, float]]
    converged: bool
    rounds: int
    wall_s: float

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, texts, lists and dicts."""
        return asdict(self)

    @classmethod
    def from_dict(cls, kept: Mapping[str, Any]) -> Repetition:
        """The draw that `to_dict` wrote; JSON has no infinity and no NaN, null stands for both."""
        values = {name: kept[name] for name in cls.__dataclass_fields__}
        for name in ("names", "units", "kinds", "verdict"):
            values[name] = tuple(values[name])
        values["residual_analysis"] = (
            None if kept["residual_analysis"] is None else tuple(kept["residual_analysis"])
        )
        missing = {"truth": math.nan, "estimate": math.nan, "sigma": math.inf}
        missing |= {"lower": -math.inf, "upper": math.inf}
        for name, value in missing.items():
            values[name] = tuple(value if x is None else float(x) for x in values[name])
        values["hold_out"] = {
            vehicle: {channel: -math.inf if r2 is None else float(r2) for channel, r2 in of.items()}
            for vehicle, of in kept["hold_out"].items()
        }
        return cls(**values)


@dataclass(frozen=True)
class Held:
    """A coefficient held at a wrong value and everything else estimated again.

    ``rise`` is what that costs, half the log-likelihood ratio; below 1.92 the data do not contradict the
    value at the level of 95 %.
    """

    name: str
    unit: str
    estimate: float
    value: float
    rise: float

    @property
    def contradicted(self) -> bool:
        """Whether the data tell that the value is wrong."""
        return not self.rise < _COST_95

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and texts."""
        return asdict(self)

    @classmethod
    def from_dict(cls, kept: Mapping[str, Any]) -> Held:
        """The result that `to_dict` wrote; a refit that diverged is null."""
        return cls(**(dict(kept) | {"rise": math.inf if kept["rise"] is None else kept["rise"]}))


def run_repetition(
    generated: GeneratedTrials,
    seed: int,
    *,
    analysed: bool = False,
    threads: int | None = None,
    watch: Callable[[Step], None] | None = None,
) -> Repetition:
    """Repetition with one seed, estimated from the campaign's start values.

    Parameters
    ----------
    generated : GeneratedTrials
    seed : int
    analysed : bool
        Whether to ask the residual analysis too, which takes longer than the estimate.
    threads : int, optional
        Threads of the core; the result does not depend on it.
    watch : callable, optional
        Called after every round of the polish.

    Raises
    ------
    KeyboardInterrupt
        The polish was interrupted: half a repetition is none.
    """
    began = time.monotonic()
    problem = generated.logged(seed)
    joint = Joint(problem, threads=threads)
    polished = polish(joint, watch=watch)
    if polished.interrupted:
        raise KeyboardInterrupt
    lin = linearise(joint, polished.values, initial=polished.initial, noise=polished.noise)
    found = covariance(lin)
    said = {
        one.name: one.verdict
        for one in judge(lin, dict(zip(found.names, found.sigma, strict=True))).coefficients
    }
    vehicles = {
        "start": problem.vehicle,
        "estimate": joint.identified(polished.values),
        "truth": generated.truth.vehicle,
    }
    return Repetition(
        seed=seed,
        names=found.names,
        units=found.units,
        kinds=tuple(unknown.kind for unknown in lin.unknowns),
        truth=_floats(generated.true_values(joint, seed)),
        estimate=_floats(found.estimate),
        sigma=_floats(found.sigma),
        lower=_floats(found.lower),
        upper=_floats(found.upper),
        verdict=tuple(
            said[one.name] if one.kind == "coefficient" else _told(sd / one.prior_sd)
            for one, sd in zip(lin.unknowns, found.sigma, strict=True)
        ),
        residual_analysis=_analysis(joint, polished) if analysed else None,
        hold_out={name: _hold_out(problem, joint, vehicle) for name, vehicle in vehicles.items()},
        converged=polished.converged,
        rounds=polished.rounds,
        wall_s=time.monotonic() - began,
    )


def hold_at_wrong_values(
    generated: GeneratedTrials, seed: int, names: Sequence[str], *, threads: int | None = None
) -> tuple[Held, ...]:
    """Each coefficient held a quarter of its bounds' width beside its estimate, the rest fitted again.

    A coefficient that the data do not determine may be set to such a value without any loss, however wrong it
    is. A value beyond a bound is left out.
    """
    joint = Joint(generated.logged(seed), threads=threads)
    free = polish(joint)
    if free.interrupted:
        raise KeyboardInterrupt
    least = _cost(joint, free, free.noise)
    places = {unknown.name: index for index, unknown in enumerate(joint.unknowns)}
    found = []
    for name in names:
        index, one = places[name], joint.unknowns[places[name]]
        for side in (-1.0, 1.0):
            value = free.values[index] + side * _AWAY * (one.upper - one.lower)
            if not one.lower <= value <= one.upper:
                continue
            start = free.values.copy()
            start[index] = value
            refit = polish(joint, start=start, fixed=[index])
            if refit.interrupted:
                raise KeyboardInterrupt
            rise = _cost(joint, refit, free.noise) - least
            found.append(Held(name, one.unit, float(free.values[index]), float(value), rise))
    return tuple(found)


def _analysis(joint: Joint, found: Polished) -> tuple[str, ...]:
    """What the residual analysis says, its warning first."""
    said = analyse_joint(joint, found.values, initial=found.initial, noise=found.noise)
    if said.warning is None:
        return ()
    return (said.warning, *(one.sentence for one in said.suggestions))


def _cost(joint: Joint, found: Polished, noise: Array) -> float:
    """Half the robust sum of squares of a result in this noise (C,), initial conditions at their best."""
    rounds, initial = GaussNewton(joint), found.initial
    rounds.noise = noise
    for _ in range(_SETTLE):
        initial = initial + rounds.settled(found.values, initial)
    centre = found.values.copy()
    centre[len(joint.parameters) :] = 0.0
    return rounds.cost(found.values, initial, centre)


def _hold_out(problem: Problem, joint: Joint, vehicle: Vehicle) -> dict[str, float]:
    """R2 by channel on all trials that are held out as a whole, pooled, some seconds ahead."""
    from seatrial.trial.score import score

    names = [name for name in problem.trials if problem.uses[name].hold_out]
    if not names:
        return {}
    axes = joint.stage.axes
    found = score(
        vehicle,
        [problem.trials[name] for name in names],
        ahead_s=_AHEAD_S,
        training=None,
        channels=joint.channels,
        input=problem.input_of(names[0]),
        free=axes.free,
        measured=axes.measured,
    )
    return found.r2


def _told(relative: float) -> str:
    """Verdict on a nuisance parameter from its standard deviation over that of its prior."""
    return "identifiable" if relative <= WEAK else "weak" if relative < 0.5 * (1.0 + WEAK) else "prior"


def _floats(values: np.ndarray[Any, Any]) -> tuple[float, ...]:
    return tuple(map(float, values))
