"""The search: margins first, then each group of loops by evolution strategy and simplex, again where needed.

Where the start gains leave a motion unstable or short of its margins, the gains of the breakpoints concerned
are first brought to where all margins hold, as near to the start as that allows: a loop cannot be tried while
another one lets the vehicle tumble. Those groups that violate a corridor after all had their turn are
searched again. Held by tests/tuning/test_tune.py; `Race`, which saves flights, by tests/tuning/test_race.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.base.chunks import Chunk, Shared, as_it_is, run_chunks
from seatrial.base.plain import Plain
from seatrial.base.run import RunDirectory, sha256
from seatrial.base.work import Step, Watch
from seatrial.estimation.search import SEARCH_SETTINGS, Optimum, batch_size, evolve, join, refine
from seatrial.tuning.objective import SETTINGS as OBJECTIVE_SETTINGS
from seatrial.tuning.objective import Flown, Objective, Still, Terms
from seatrial.tuning.scope import GainParameters, excited_points
from seatrial.tuning.step_trial import Rig, Samples

if TYPE_CHECKING:
    from seatrial.base.fleet import Fleet
    from seatrial.control_design.margin_constraint import MarginConstraint, PointMargins
    from seatrial.tuning.control_problem import ControlProblem, Group


@dataclass(frozen=True)
class GroupSearchSettings:
    """How many samples the search of a group meets, for how long, and what is worth further flights."""

    few_samples: int = 4  #: Samples up to which a search meets all of them.
    met_noises: int = 2  #: Noises of the vehicle itself that a search meets where there are more samples.
    met_vehicles: int = 3  #: Drawn vehicles that a search meets where there are more samples.
    #: Cost of corridors and margins up to which they count as kept: 1 ms of a step, or 0.03 % of a margin.
    kept_cost: float = 0.01
    #: Cost, of what only breaks ties, that is not worth further flights: 1 ms of a step.
    even_cost: float = 0.01
    patience_generations: int = 10  #: Generations without a gain after which a search ends.
    diverged_violation_s: float = 1e6  #: Violation that stands for a diverged candidate in sums, s.
    generations: int = 30  #: Generations of the evolution strategy where the campaign gives no budget.
    rounds: int = 25  #: Rounds of the simplexes where the campaign gives no budget.
    #: Change of the logarithms of the factors at which a search ends: 1 % of a gain.
    log_tolerance: float = 1e-2
    #: First spread of a search, as a share of the box: what holds the margins is not to be
    #: lost at once.
    first_spread: float = 0.08
    #: Share of a margin's limit that the frequency grid and four digits of a gain leave.
    margin_rounding: float = 0.01


SETTINGS = GroupSearchSettings()

Fly = Callable[[Array, Sequence[int]], Flown]
"""What candidates (k, m) do with some of all samples."""


class Race:
    """Costs of the candidates of one group by an objective with all samples.

    An evolution strategy learns from the better half of a generation, its parents. All candidates meet the
    sample that was the worst most often so far; those of the better half by that, and every other that may
    still be among them, meet the others too: what one sample violates, all samples violate at least. So the
    parents and their order are those of all samples; of the others only the order among themselves is a
    guess. A candidate that margins and roughness alone make worse than the last generation's parents does not
    fly at all.

    Where the samples are many, a search meets those that are worst for the gains that it begins with, and its
    simplexes those that are worst for the best that it has found. All samples have the last word (a
    cutting-set method: Mutapcic & Boyd, *Optimization Methods and Software* 24 (2009) 381).

    `fly` says how candidates are flown: here or by a fleet.
    """

    def __init__(self, objective: Objective, fly: Fly) -> None:
        self.objective, self.fly = objective, fly
        self.history: list[tuple[float, float, float]] = []  # of the best: cost, its corridors, its margins
        self.parents: list[float] = []  # lowest cost of a last parent
        self._meet(range(len(objective.samples)))

    @property
    def narrowed(self) -> bool:
        """Whether candidates meet fewer samples than there are."""
        return len(self.met) < len(self.objective.samples)

    def __call__(self, x: Array) -> Array:
        """Costs (k,) of a generation (k, m); of who is no parent, at least what it was flown for."""
        parents = len(x) // 2
        if not (parents and self.history) or len(self.met) == 1 or self.objective.quantile < 1.0:
            return self.exactly(x)
        still, flown = self._still(x), Flown.none(len(x), len(self.met))
        done = np.zeros((len(x), len(self.met)), dtype=bool)
        first = int(self.worst.argmax())
        rest = [place for place in range(len(self.met)) if place != first]

        def fly_on(rows: NDArray[np.intp], places: Sequence[int]) -> None:
            if len(rows):
                flown.put(rows, places, self._flown(x[rows], places))
                done[np.ix_(rows, np.asarray(places))] = True

        # What margins and roughness alone make worse than parents are is not flown.
        alone = self._costs(still, flown)
        begun = np.union1d(np.argsort(alone, kind="stable")[:parents], np.flatnonzero(alone <= self.limit))
        fly_on(begun, [first])
        guess = self._costs(still, Flown(*(np.tile(part[:, [first]], len(self.met)) for part in flown.parts)))
        fly_on(begun[np.argsort(guess[begun], kind="stable")][:parents], rest)
        # Who may still be among the parents by what it has met so far flies on.
        while True:
            costs, whole = self._costs(still, flown), done.all(axis=1)
            open_ = ~whole & (costs < np.sort(costs[whole])[parents - 1])
            if not open_.any():
                break
            fly_on(np.flatnonzero(open_ & done[:, first]), rest)
            fly_on(np.flatnonzero(open_ & ~done[:, first]), [first])
        return self._kept(still, flown, np.flatnonzero(whole))

    def exactly(self, x: Array) -> Array:
        """Costs (k,) of candidates (k, m), each with every sample that is met."""
        return self._kept(self._still(x), self._flown(x, range(len(self.met))), np.arange(len(x)))

    def with_all(self, x: Array) -> Array:
        """Costs (k,) of candidates (k, m) with all samples."""
        flown = self.fly(x, range(len(self.objective.samples)))
        return self.objective.joined(self._still(x), flown).cost(self.objective.smoothness)

    def narrow(self, x: Array) -> None:
        """Meet only the samples that are worst for candidates (k, m), of noises and of drawn vehicles."""
        samples = self.objective.samples
        if len(samples) <= SETTINGS.few_samples or self.objective.quantile < 1.0:
            return
        flown = self.fly(x, range(len(samples)))
        # Where nothing is violated, the one that is farthest off meanwhile tells most.
        size = np.minimum(flown.violation, SETTINGS.diverged_violation_s) + 1e-3 * np.minimum(
            flown.time, SETTINGS.diverged_violation_s
        )
        order = np.argsort(-size.max(axis=0), kind="stable").tolist()
        own = [place for place in order if place < samples.nominal][: SETTINGS.met_noises]
        drawn = [place for place in order if place >= samples.nominal][: SETTINGS.met_vehicles]
        self._meet(sorted(own + drawn))

    def inside(self) -> bool:
        """Whether corridors and margins are kept by the best so far."""
        return bool(self.history) and sum(self.history[-1][1:]) <= SETTINGS.kept_cost

    def enough(self) -> bool:
        """Whether corridors are kept, and the last generations gained next to nothing: the last parent counts
        as well as the best, as one lucky candidate of a wide generation stalls the best.
        """
        if len(self.parents) <= SETTINGS.patience_generations or self.history[-1][1] > SETTINGS.kept_cost:
            return False
        best = self.history[-1 - SETTINGS.patience_generations][0] - self.history[-1][0]
        last = self.parents[-1 - SETTINGS.patience_generations] - self.parents[-1]
        return best < SETTINGS.even_cost and last < 2.0 * SETTINGS.even_cost

    def _meet(self, places: Sequence[int]) -> None:
        self.met = list(places)
        self.here = self.objective.of_samples(self.met)
        self.worst = np.zeros(len(self.met))  # how often each was the worst of a candidate
        self.limit = np.inf  # cost of the last parent of the generation before
        self.history, self.parents = [], []

    def _still(self, x: Array) -> Still:
        return self.objective.still(self.objective.parameters.gains(x))

    def _flown(self, x: Array, places: Sequence[int]) -> Flown:
        return self.fly(x, [self.met[place] for place in places])

    def _costs(self, still: Still, flown: Flown) -> Array:
        return self.here.joined(still, flown).cost(self.objective.smoothness)

    def _kept(self, still: Still, flown: Flown, whole: NDArray[np.intp]) -> Array:
        """Costs (k,); remembered is how good the best is, and which samples were worst."""
        terms = self.here.joined(still, flown)
        costs = terms.cost(self.objective.smoothness)
        violation = flown.violation[whole]
        differ = violation.max(axis=1) > violation.min(axis=1)
        self.worst += np.bincount(violation[differ].argmax(axis=1), minlength=len(self.met))
        best = int(whole[costs[whole].argmin()])
        now = (
            float(costs[best]),
            float(OBJECTIVE_SETTINGS.outside_weight * terms.violation[best]),
            float(OBJECTIVE_SETTINGS.margin_weight * terms.margin[best]),
        )
        self.history.append(min(self.history[-1], now) if self.history else now)
        if parents := len(costs) // 2:
            self.limit = float(np.sort(costs[whole])[parents - 1])
            self.parents.append(min([self.limit, *self.parents[-1:]]))
        return costs


class Here:
    """Flights of candidates in this process, and the time that they took, s."""

    def __init__(self, objective: Objective) -> None:
        self._objective, self.flown_s = objective, 0.0
        self._each = sum(len(trials) * trials.duration_s for trials in objective.trials)

    def __call__(self, x: Array, places: Sequence[int]) -> Flown:
        """What candidates (k, m) do with some of the samples, counted."""
        self.flown_s += self._each * len(x) * len(places)
        return self.fly(x, places)

    def fly(self, x: Array, places: Sequence[int]) -> Flown:
        """What candidates (k, m) do with some of the samples."""
        return flights(self._objective, x, places)


class Elsewhere(Here):
    """Candidates that workers of a fleet fly: full lanes for each, the same bits as here."""

    def __init__(self, objective: Objective, fleet: Fleet) -> None:
        super().__init__(objective)
        self._fleet = fleet
        self._shared = Shared(replace(objective, rig=replace(objective.rig, threads=1)))

    def fly(self, x: Array, places: Sequence[int]) -> Flown:
        """What candidates (k, m) do with some of the samples."""
        pieces = min(max(self._fleet.slots, 1), math.ceil(len(x) / SEARCH_SETTINGS.lanes))
        each = SEARCH_SETTINGS.lanes * math.ceil(len(x) / SEARCH_SETTINGS.lanes / pieces)
        chosen = tuple(int(place) for place in places)
        chunks = (
            Chunk(
                f"candidates {k}",
                sha256(self._shared.packed + part.tobytes() + bytes(chosen)),
                flights,
                self._shared,
                (part, chosen),
            )
            for k, part in enumerate(x[k : k + each] for k in range(0, len(x), each))
        )
        chunks_flown = run_chunks(chunks, RunDirectory(None), as_it_is(), fleet=self._fleet)
        return Flown(*map(np.concatenate, zip(*(done.value.parts for done in chunks_flown), strict=True)))


def flights(objective: Objective, x: Array, places: Sequence[int]) -> Flown:
    """What candidates (k, m) do with some of the samples: a chunk of the work."""
    return objective.of_samples(places).flown(objective.parameters.gains(x))


GUIDANCE_SEARCH = "guidance"
"""Name of the result that holds the numbers of guidance for the tuned loops."""


@dataclass(frozen=True, eq=False)
class GroupResult(Plain):
    """What the search of one group found."""

    name: str  #: Of the group.
    gains: Mapping[str, float]  #: Found, by the names of `Autopilot.gains`.
    #: `before`, `after`: parts of the cost with the gains that the search began with, and with those found:
    #: violation (s), margin, time (s), roughness, effort (1/s).
    before: Mapping[str, float]
    after: Mapping[str, float]
    #: `evaluations`, `flown_s`: sets of gains that were tried, and the time that they flew, s.
    evaluations: int
    flown_s: float
    history: tuple[Step, ...]  #: A `Step` per batch.
    at_bound: tuple[str, ...]  #: Factors that ended at a bound.
    interrupted: bool  #: Whether Ctrl-C ended it.

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
        tolerance=SETTINGS.log_tolerance,
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
    """Gains of a group, all others as the rig's autopilot has them, from `start` on, within the bounds about
    the campaign's start gains; candidates fly in the fleet, or in this process.
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
    tolerance = budget.tolerance or SETTINGS.log_tolerance
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
        generations=budget.generations or SETTINGS.generations,
        spread=SETTINGS.first_spread,
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
            rounds=budget.simplex_rounds or SETTINGS.rounds,
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
