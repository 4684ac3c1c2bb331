"""The search: margins first, then each group of loops by evolution strategy and simplex, again where needed.

Where the start gains leave a motion unstable or short of its margins, the gains of the breakpoints
concerned are first brought to where all margins hold, as near to the start as that allows: a loop cannot be
tried while another one lets the vehicle tumble. Then the groups take their turn, each with the gains that
the others have found; those that violate a corridor after all had their turn are searched again.

Held by tests/tuning/test_tune.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.plain import Plain
from seatrial.base.progress import Step, Watch
from seatrial.estimation.search import Optimum, batch_size, evolve, join, refine
from seatrial.tuning.gain_parameters import GainParameters, excited_points
from seatrial.tuning.objective import Objective, Terms
from seatrial.tuning.race import Elsewhere, Here, Race
from seatrial.tuning.step_trial import Rig, Samples

if TYPE_CHECKING:
    from seatrial.base.fleet import Fleet
    from seatrial.control_design.margin_constraint import MarginConstraint, PointMargins
    from seatrial.tuning.control_problem import ControlProblem, Group

GUIDANCE_SEARCH = "guidance"
"""Name of the result that holds the numbers of guidance for the tuned loops."""

GENERATIONS, ROUNDS = 30, 25
"""Batches of the evolution strategy and of the simplexes where the campaign gives no budget."""

_TOLERANCE = 1e-2  # of the logarithms of the factors: 1 % of a gain

_SPREAD = 0.08  # of the box: what holds the margins is not to be lost at once

ROUNDING = 0.01
"""Of a margin's limit, what the frequency grid and four digits of a gain leave."""


@dataclass(frozen=True, eq=False)
class GroupResult(Plain):
    """What the search of one group found.

    Attributes
    ----------
    name
        Of the group.
    gains
        Found, by the names of `Autopilot.gains`.
    before, after
        Parts of the cost with the gains that the search began with, and with those found: violation (s),
        margin, time (s), roughness, effort (1/s).
    evaluations, flown_s
        Sets of gains that were tried, and the time that they flew, s.
    history
        A `Step` per batch.
    at_bound
        Factors that ended at a bound.
    interrupted
        Whether Ctrl-C ended it.
    """

    name: str
    gains: Mapping[str, float]
    before: Mapping[str, float]
    after: Mapping[str, float]
    evaluations: int
    flown_s: float
    history: tuple[Step, ...]
    at_bound: tuple[str, ...]
    interrupted: bool

    @classmethod
    def from_dict(cls, kept: Mapping[str, Any]) -> GroupResult:
        """Result as `to_dict` gave it."""
        fields = {key: kept[key] for key in cls.__dataclass_fields__}
        fields["history"] = tuple(Step(**step) for step in kept["history"])
        fields["at_bound"] = tuple(kept["at_bound"])
        return cls(**fields)


def search_margins(plan: ControlProblem, *, seed: int, watch: Watch | None = None) -> GroupResult | None:
    """Gains with sound margins, near those of the start; None where they are sound already."""
    limits = plan.margins
    if limits is None:
        return None
    weak = [point for point in limits.margins({}) if float(point.shortfall(limits.limits)[0]) > 0.0]
    if not weak:
        return None
    points = plan.autopilot.speeds_m_s
    free = [p for p in excited_points([point.speed_m_s for point in weak], points) if p in plan.places]
    # Loops that are neither tuned nor short keep their gains, unless the others cannot mend the margins.
    concerned = sorted({*plan.steered, *(loop for point in weak for loop in short_loops(point, limits))})
    every = sorted(limits.loops)
    # One factor per gain for all points first: where that is enough, a search in so few directions finds it,
    # and the schedule keeps its shape.
    stages = [
        _of_points(plan, loops, free, own=own)
        for loops in ([concerned] if concerned == every else [concerned, every])
        for own in ([free[:1], free] if len(free) > 1 else [free])
    ]
    stages = [parameters for parameters in stages if len(parameters)]
    if not stages:
        return None
    gains, evaluations, history = dict[str, float](), 0, tuple[Step, ...]()
    for parameters in stages:
        parameters, begin = parameters.through(gains)
        best = _nearest_sound(limits, parameters, begin, seed=seed, watch=watch)
        history += tuple(replace(step, evaluations=step.evaluations + evaluations) for step in best.history)
        evaluations += best.evaluations
        best = replace(best, evaluations=evaluations, history=history)
        gains = {name: float(value[0]) for name, value in parameters.gains(best.x).items()}
        after = float(limits.shortfall(parameters.gains(best.x))[0])
        # One factor per gain may leave 0.1 % of a limit.
        if best.interrupted or after < 1e-3:
            break
    before = {"margin": float(limits.shortfall({})[0])}
    return _result("margins", parameters, best, (before, {"margin": after}), flown_s=0.0)


def short_loops(point: PointMargins, limits: MarginConstraint, *, beyond: float = 0.0) -> list[str]:
    """Loops whose own margins fall short by more than a share of their limit; all where a motion grows."""
    if not limits.limits.at(point.speed_m_s).any:
        return []
    lacking = point.lacking(limits.limits)[0]
    grows = point.growth_per_s[0] > 0.0
    return [loop for loop, lack in zip(point.loops, lacking, strict=True) if grows or lack > beyond]


def _of_points(
    plan: ControlProblem, loops: Sequence[str], free: Sequence[int], *, own: Sequence[int]
) -> GainParameters:
    """Factors on the gains of some loops at free points, those of `own` their own, the others with these."""
    gains, parameters = plan.autopilot.gains(), GainParameters(())
    others = [p for p in plan.places if p not in free]
    for loop in loops:
        parameters += GainParameters.of_loop(
            loop, gains, free=own, taken=others, reached=plan.places, bounds=plan.table.bounds
        )
    return parameters


def _nearest_sound(
    limits: MarginConstraint, parameters: GainParameters, begin: Array, *, seed: int, watch: Watch | None
) -> Optimum:
    """Factors with the least shortfall of the margins, as near to 1 as that allows."""
    lower, upper = parameters.bounds

    def cost(x: Array) -> Array:
        # The mean square of ln(factor) weighs little beside the shortfall.
        near: Array = 0.01 * (x**2).mean(axis=1)
        return limits.shortfall(parameters.gains(x)) + near

    return evolve(
        cost,
        begin,
        lower=lower,
        upper=upper,
        seed=seed,
        population=32,  # margins take no flight, so that a search is cheap
        generations=100,
        tolerance=_TOLERANCE,
        watch=watch,
    )


def search_group(
    plan: ControlProblem,
    group: Group,
    rig: Rig,
    samples: Samples,
    *,
    seed: int,
    start: Mapping[str, float],
    watch: Watch | None = None,
    fleet: Fleet | None = None,
) -> GroupResult:
    """Gains of a group, all others as the rig's autopilot has them.

    `start`: gains so far, whose bounds stay those about the campaign's start gains. `watch` is called with a
    `Step` after every batch. Candidates fly in the fleet, or in this process.
    """
    parameters, begin = group.parameters.through(start)
    quantile = 1.0 if plan.table.robust == "worst" else float(plan.table.robust)
    objective = Objective(
        rig=rig,
        trials=group.trials,
        samples=samples,
        parameters=parameters,
        margins=plan.margins and plan.margins.beside(rig.autopilot.gains()),
        quantile=quantile,
        smoothness=plan.table.smoothness,
        reached=plan.reached,
        start=plan.autopilot.gains(),
    )
    lower, upper = parameters.bounds
    budget = plan.table.budget
    tolerance = budget.tolerance or _TOLERANCE
    fly = Here(objective) if fleet is None else Elsewhere(objective, fleet)
    # Of many samples those that are worst now: what one of them violates, all violate at least.
    race = Race(objective, fly)
    race.narrow(begin[None])
    optimum = evolve(
        race,
        begin,
        lower=lower,
        upper=upper,
        seed=seed,
        population=budget.population or batch_size(len(parameters)),
        generations=budget.generations or GENERATIONS,
        spread=_SPREAD,
        tolerance=tolerance,
        watch=watch,
        enough=race.enough,
    )
    # The simplex goes on where the evolution strategy ends outside the corridors.
    if not (optimum.interrupted or race.inside() or race.enough()):
        coarse = optimum
        race.narrow(coarse.elite)
        fine = refine(
            race.exactly,
            coarse.elite,
            lower=lower,
            upper=upper,
            rounds=budget.simplex_rounds or ROUNDS,
            tolerance=tolerance,
            watch=watch,
        )
        # With fewer samples the costs of the two do not compare: then all samples decide.
        optimum = join(coarse, fine) if fine.cost <= coarse.cost or race.narrowed else coarse
        if race.narrowed:
            optimum = _best(race, optimum, np.vstack([begin, coarse.elite, fine.elite]))
    elif race.narrowed:
        optimum = _best(race, optimum, np.vstack([begin, optimum.elite]))
    # Before and after without headroom, as the assessment counts.
    ends = [_terms(objective, parameters, x) for x in (begin, optimum.x)]
    return _result(group.name, parameters, optimum, (ends[0], ends[1]), flown_s=fly.flown_s)


def _best(race: Race, optimum: Optimum, candidates: Array) -> Optimum:
    """The best of some candidates with all samples."""
    costs = race.with_all(candidates)
    return replace(
        optimum,
        x=candidates[int(costs.argmin())],
        cost=float(costs.min()),
        evaluations=optimum.evaluations + len(candidates),
    )


def _terms(objective: Objective, parameters: GainParameters, x: Array) -> dict[str, float]:
    terms: Terms = objective.terms(parameters.gains(x), headroom=0.0)
    return {name: float(values[0]) for name, values in vars(terms).items()}


def _result(
    name: str,
    parameters: GainParameters,
    optimum: Optimum,
    ends: tuple[Mapping[str, float], Mapping[str, float]],
    *,
    flown_s: float,
) -> GroupResult:
    lower, upper = parameters.bounds
    near = 1e-3 * (upper - lower)
    at_bound = [
        factor
        for factor, x, low, high, width in zip(parameters.names, optimum.x, lower, upper, near, strict=True)
        if x - low < width or high - x < width
    ]
    return GroupResult(
        name=name,
        gains={key: float(values[0]) for key, values in parameters.gains(optimum.x).items()},
        before=ends[0],
        after=ends[1],
        evaluations=optimum.evaluations,
        flown_s=flown_s,
        history=optimum.history,
        at_bound=tuple(at_bound),
        interrupted=optimum.interrupted,
    )
