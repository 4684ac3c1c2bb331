"""Stages of an identification: plan, search and result of each, and the order of their run.

A global search ranks candidates with a coarse step; where the campaign asks for it the segments' initial
velocities are estimated; a descent and simplexes with a fine step find the floor of the valley. `StageOrder`
runs dependent stages one after the other and independent ones side by side; finished ones are kept, so that
an interrupted run goes on where it stopped.

Tests: ``tests/identification/test_identify.py``, ``tests/estimation/test_step.py``.
"""

from __future__ import annotations

import contextlib
import hashlib
import math
import queue
import threading
import time
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.chunks import Chunk, Shared, as_it_is, run_chunks
from seatrial.base.errors import CampaignError, SimulationError, VehicleError
from seatrial.base.finding import Fallbacks, is_numerical
from seatrial.base.fleet import threads_of
from seatrial.base.plain import Plain
from seatrial.base.run import RunDirectory, to_json, version
from seatrial.base.work import Clock, Progress, Step, Work
from seatrial.estimation.descent import Criterion, descend, with_initial_velocities
from seatrial.estimation.search import SEARCH_SETTINGS, batch_size, evolve, join, refine, refine_rounds
from seatrial.estimation.segment_model import SegmentModel, StageData, StageStep, around, cut, stage_step
from seatrial.problem.parameter import Parameter, coefficients
from seatrial.problem.settings import Stage

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.base.fleet import Fleet
    from seatrial.problem.problem import Problem


@dataclass(frozen=True)
class StageRunSettings:
    """How a stage is searched."""

    #: Share of the criterion that the last rounds must gain, unless the campaign says otherwise.
    tolerance: float = 1e-4
    #: Candidates that are tried where the start diverges: half of them anywhere between the bounds, half at
    #: all distances from the start, down to 1e-12 of the box. They cost as much as a few generations of the
    #: search.
    probed: int = 1024
    #: Gain at which the global search ends: what is left in its valley is found by descent and simplex.
    coarse_gain: float = 0.1


STAGE_RUN_SETTINGS = StageRunSettings()


@dataclass(frozen=True)
class StagePlan:
    """What a stage will do, known before its search: data, step, budget."""

    stage: Stage
    parameters: tuple[Parameter, ...]
    data: StageData
    step: StageStep
    seed: int
    population: int
    generations: int
    rounds: int
    tolerance: float

    @property
    def work(self) -> float:
        """Eight-candidate steps of the core if the whole budget is used."""
        return self._batches * self._search + self.rounds * self._fine

    def done(self, step: Step) -> float:
        """Part of the work that is done after a step."""
        if step.phase == "evolution":
            return self._batches * self._search * step.generation / self.generations
        refined = step.generation if step.phase == "simplex" else 0  # the descent between takes no time
        return self._batches * self._search + self._fine * refined

    @property
    def _batches(self) -> float:
        """Batches of eight in the global search."""
        return self.generations * self.population / SEARCH_SETTINGS.lanes

    @property
    def _search(self) -> float:
        """Steps of a batch in the global search."""
        return float(self.data.samples * self.step.search)

    @property
    def _fine(self) -> float:
        """Steps of a batch in the fine search."""
        return float(self.data.samples * self.step.substeps)


@dataclass(frozen=True)
class StageResult(Plain):
    """What a stage found.

    ``estimates`` maps the campaign's parameter names to values, ``coefficients`` every coefficient that they
    set. Costs are mean weighted errors per sample in standard deviations; ``history`` has a row per batch.
    ``inputs`` is the SHA-256 of all that the result depends on.
    """

    name: str
    trials: tuple[str, ...]
    starts: dict[str, float]
    estimates: dict[str, float]
    coefficients: dict[str, float]
    start_cost: float
    cost: float
    evaluations: int
    history: tuple[Step, ...]
    segments: int
    samples: int
    substeps: int
    step_s: float
    rate: float
    wall_s: float
    inputs: str
    interrupted: bool
    reused: bool = False

    @property
    def phases(self) -> dict[str, float]:
        """Best cost that each phase of the search found by itself, each in its own criterion.

        The global search has a longer step, and the segments' starts may be estimated after it.
        """
        return {step.phase: step.best for step in self.history}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> StageResult:
        """Result from what `to_dict` gave."""
        plain = dict(data)
        plain["trials"] = tuple(plain["trials"])
        plain["start_cost"] = _number(plain["start_cost"])
        plain["history"] = tuple(Step(**row | {"best": _number(row["best"])}) for row in plain["history"])
        return cls(**plain)


def plan(problem: Problem) -> tuple[StagePlan, ...]:
    """Plans of all stages in the order of their run; everything that can be refused is refused here.

    Raises CampaignError and TrialError: a trial cannot be read or does not suit its stage.
    """
    plans: dict[str, StagePlan] = {}
    roaming: dict[str, tuple[Parameter, ...]] = {}
    for stage in problem.stages:
        data = cut(problem, stage)
        own = problem.parameters[stage.name]
        earlier = {p.name: p for name in stage.after for p in roaming[name]}
        roaming[stage.name] = (*(earlier | {p.name: p for p in own}).values(),)
        step = stage_step(
            problem.vehicle,
            roaming[stage.name],
            free=stage.axes.free,
            speeds=data.largest_speeds(),
            dt=data.dt,
        )
        budget = problem.budget(stage)
        plans[stage.name] = StagePlan(
            stage=stage,
            parameters=own,
            data=data,
            step=step,
            seed=problem.seed << 32 | zlib.crc32(stage.name.encode()),
            population=batch_size(len(own), budget.population),
            generations=budget.generations or 100 + 15 * len(own),
            rounds=budget.simplex_rounds or refine_rounds(len(own)),
            tolerance=budget.tolerance or STAGE_RUN_SETTINGS.tolerance,
        )
    return tuple(plans.values())


@dataclass(frozen=True, eq=False)
class StageSearch:
    """What the search of a stage needs, wherever it runs."""

    problem: Problem
    plan: StagePlan
    #: Estimates of the stages before: they replace the vehicle file's values as start values.
    earlier: Mapping[str, float]

    @cached_property
    def vehicle(self) -> Vehicle:
        """The problem's vehicle with the estimates of the stages before."""
        return self.problem.vehicle.with_coefficients(dict(self.earlier))

    @cached_property
    def inputs(self) -> str:
        """SHA-256 of everything that the result depends on."""
        plan, data = self.plan, self.plan.data
        described = {
            "version": version("seatrial"),
            "stage": plan.stage.model_dump(),
            "inputs": [self.problem.input_of(name) for name in plan.stage.trials],
            "vehicle": self.vehicle.to_toml(),
            "found": self.earlier,
            "plan": [
                *(plan.seed, plan.population, plan.generations, plan.rounds, plan.tolerance),
                *(plan.step.substeps, plan.step.search),
            ],
            "segments": [astuple(segment) for segment in data.segments],
            "environment": [(trial.rho, trial.g, trial.surface) for trial in data.trials],
        }
        digest = hashlib.sha256(to_json(described).encode())
        for record in data.records:
            trial = record.trial
            signals = (trial.t, trial.observed, record.counted, trial.nu, trial.tau, trial.voltage_v)
            for values in (*signals, trial.current, *trial.commands.values(), *trial.measured.values()):
                digest.update(b"-" if values is None else np.ascontiguousarray(values).tobytes())
        return digest.hexdigest()


def run_stage(
    search: StageSearch, threads: int | None, watch: Callable[[Step], None] = lambda step: None
) -> StageResult:
    """Result of a stage: global search, initial velocities where they are estimated, descent, fine search.

    ``watch``: called after every batch of candidates; it may raise KeyboardInterrupt.
    """
    began = time.monotonic()
    problem, plan, vehicle = search.problem, search.plan, search.vehicle
    stage, chosen = plan.stage, plan.parameters
    start = np.array([_start(parameter, search.earlier) for parameter in chosen])

    def stepped(substeps: int) -> Criterion:
        return Criterion(SegmentModel(vehicle, stage, plan.data, chosen, substeps, threads))

    criterion = stepped(plan.step.search)
    box: dict[str, Any] = {
        "lower": [parameter.lower for parameter in chosen],
        "upper": [parameter.upper for parameter in chosen],
        "tolerance": plan.tolerance,
        "watch": watch,
    }
    _check_influence(criterion, chosen, start, problem.where(stage))
    first = search_start(criterion, chosen, start, seed=plan.seed)
    best = evolve(
        criterion,
        start if first is None else first,
        seed=plan.seed,
        population=plan.population,
        generations=plan.generations,
        **box | {"tolerance": max(plan.tolerance, STAGE_RUN_SETTINGS.coarse_gain)},
    )
    step = _fine_step(plan, vehicle, best.elite)
    if step.substeps != plan.step.search:
        criterion = stepped(step.substeps)
    estimated = stage.start == "estimated"
    smoothed = criterion.nu
    valley = best.axes
    shares = (plan.rounds // 2, plan.rounds - plan.rounds // 2) if estimated else (plan.rounds,)
    for rounds in shares:
        if best.interrupted or not math.isfinite(best.cost):
            break
        elite = best.elite
        try:
            if estimated:
                criterion = with_initial_velocities(criterion, best.x, smoothed)
            best = join(best, descend(criterion, criterion.linearised, best.x, **box))
        except Exception as error:
            # Derivatives without numbers end the descent; the simplexes need none.
            if not is_numerical(error):
                raise
        if not best.interrupted:
            starts = np.vstack([best.x, elite])
            best = join(best, refine(criterion, starts, rounds=max(rounds, 1), axes=valley, **box))
    if not math.isfinite(best.cost) and not best.interrupted:
        raise SimulationError(
            f"{problem.where(stage)}: every one of {best.evaluations} candidates diverged; check the units"
            " and signs of the commands, the vehicle's masses and the bounds"
        )
    values = _possible(vehicle, chosen, np.vstack([best.x, best.elite]))
    return StageResult(
        name=stage.name,
        trials=stage.trials,
        starts={p.name: float(x) for p, x in zip(chosen, start, strict=True)},
        estimates={p.name: float(x) for p, x in zip(chosen, values, strict=True)},
        coefficients=coefficients(chosen, values),
        start_cost=best.start_cost if first is not None and first is start else math.inf,
        cost=best.cost,
        evaluations=best.evaluations,
        history=best.history,
        segments=len(plan.data.segments),
        samples=plan.data.samples,
        substeps=step.substeps,
        step_s=plan.data.dt / step.substeps,
        rate=step.rate,
        wall_s=time.monotonic() - began,
        inputs=search.inputs,
        interrupted=best.interrupted,
    )


def _possible(vehicle: Vehicle, chosen: tuple[Parameter, ...], candidates: Array) -> Array:
    """The first of some candidates (k, m) that is a vehicle: bounds may admit a lag below zero.

    Raises VehicleError: none is; the error is that of the first one.
    """
    first: VehicleError | None = None
    for candidate in candidates:
        try:
            vehicle.with_coefficients(coefficients(chosen, candidate))
        except VehicleError as error:
            first = first or error
        else:
            return np.asarray(candidate)
    assert first is not None
    raise first


def refitted_stage(
    problem: Problem, plan: StagePlan, optimum: StageResult, *, vehicle: Vehicle, threads: int | None = None
) -> dict[str, float]:
    """Coefficients of a stage on other data, by a descent from its optimum at the step of the global search.

    ``problem``: with the other data. ``plan``: of the stage in that campaign. ``optimum``: of the stage on
    the data that it was searched with. ``vehicle``: with the estimates of the stages before. ``threads``:
    threads of the core.
    """
    start = np.array([optimum.estimates[parameter.name] for parameter in plan.parameters])
    substeps = _fine_step(plan, vehicle, start[None, :]).search
    model = SegmentModel(vehicle, plan.stage, plan.data, plan.parameters, substeps, threads)
    criterion = Criterion(model)
    if plan.stage.start == "estimated":
        criterion = with_initial_velocities(criterion, start, criterion.nu)
    lower, upper = ([getattr(p, end) for p in plan.parameters] for end in ("lower", "upper"))
    minimum = descend(
        criterion, criterion.linearised, start, lower=lower, upper=upper, tolerance=plan.tolerance
    )
    return coefficients(plan.parameters, minimum.x)


def search_start(
    criterion: Criterion, chosen: Sequence[Parameter], start: Array, *, seed: int
) -> Array | None:
    """Where a search begins (m,): the start, or where that diverges the best of `probed` candidates.

    None where all of them diverge. The same seed gives the same candidates.
    """
    if math.isfinite(float(criterion(start[None, :])[0])):
        return start
    lower, upper = (np.array([getattr(p, end) for p in chosen]) for end in ("lower", "upper"))
    generator = np.random.default_rng([seed, STAGE_RUN_SETTINGS.probed])
    anywhere = generator.uniform(0.0, 1.0, (STAGE_RUN_SETTINGS.probed // 2, len(start)))
    away = generator.choice([-1.0, 1.0], anywhere.shape) * 10.0 ** generator.uniform(
        -12.0, 0.0, anywhere.shape
    )
    tried = np.vstack([lower + (upper - lower) * anywhere, start + (upper - lower) * away])
    tried = np.clip(tried, lower, upper)
    costs = criterion(tried)
    best = int(np.argmin(costs))
    return tried[best] if math.isfinite(float(costs[best])) else None


def start_cost(problem: Problem, plan: StagePlan, *, threads: int | None = None) -> float:
    """Cost of a stage's start values in the campaign's vehicle, infinite where it diverges.

    Raises CampaignError: a coefficient changes nothing in this stage. Raises SimulationError: the start
    diverges, and so does all that `search_start` tries.
    """
    start = np.array([_start(parameter, {}) for parameter in plan.parameters])
    model = SegmentModel(problem.vehicle, plan.stage, plan.data, plan.parameters, plan.step.search, threads)
    criterion = Criterion(model)
    _check_influence(criterion, plan.parameters, start, problem.where(plan.stage))
    cost = float(criterion(start[None, :])[0])
    if not math.isfinite(cost) and search_start(criterion, plan.parameters, start, seed=plan.seed) is None:
        raise SimulationError(
            f"{problem.where(plan.stage)}: the start vehicle and every one of {STAGE_RUN_SETTINGS.probed}"
            f" candidates diverged;"
            " check the units and signs of the commands, the vehicle's masses and the bounds"
        )
    return cost


def _fine_step(plan: StagePlan, vehicle: Vehicle, elite: Array) -> StageStep:
    """Step of the fine search, from a bound around what the global search found."""
    step = stage_step(
        vehicle,
        around(plan.parameters, elite),
        free=plan.stage.axes.free,
        speeds=plan.data.largest_speeds(),
        dt=plan.data.dt,
    )
    return replace(step, substeps=max(step.substeps, plan.step.search))


def _check_influence(criterion: Criterion, chosen: tuple[Parameter, ...], start: Array, where: str) -> None:
    """Refuse a parameter that changes nothing: its estimate would be arbitrary."""
    ends = np.tile(start, (2 * len(chosen), 1))
    for i, parameter in enumerate(chosen):
        ends[2 * i, i], ends[2 * i + 1, i] = parameter.lower, parameter.upper
    costs = criterion(ends)
    for i, parameter in enumerate(chosen):
        lower, upper = costs[2 * i], costs[2 * i + 1]
        if math.isfinite(lower) and lower == upper:
            raise CampaignError(
                f"{where}: coefficient {parameter.name!r} changes nothing in this stage, so it cannot be"
                " identified here; free an axis that it acts on, use a trial that excites it, or remove it"
            )


def _number(value: float | None) -> float:
    """A cost from JSON, which has no infinity."""
    return math.inf if value is None else value


def _start(parameter: Parameter, earlier: Mapping[str, float]) -> float:
    """Start value: the campaign's own, else an earlier stage's estimate in the bounds, else the vehicle's."""
    member, factor = parameter.members[0]
    if parameter.start_given or member not in earlier:
        return parameter.start
    return min(max(earlier[member] / factor, parameter.lower), parameter.upper)


_WORTH_SAYING_S = 10.0
"""Stages that took longer than this are followed by a joint estimate that takes long too."""


class StageOrder:
    """Workspace of the stages: one thread per running stage, the caller's thread directs them.

    `part` begins the names under which finished stages are kept.
    """

    def __init__(
        self,
        problem: Problem,
        plans: tuple[StagePlan, ...],
        run: RunDirectory,
        work: Work,
        *,
        part: str = "",
        fleet: Fleet | None = None,
        fallbacks: Fallbacks | None = None,
    ) -> None:
        self.problem, self.plans, self.run, self.work = problem, plans, run, work
        self.part, self.fleet = part, fleet
        self.fallbacks = fallbacks or Fallbacks()
        self.stop = threading.Event()
        self.steps: queue.SimpleQueue[tuple[StagePlan, Step] | None] = queue.SimpleQueue()
        self.outcomes: dict[str, StageResult | BaseException] = {}
        self.results: dict[str, StageResult] = {}
        self.failed: list[str] = []
        self.clock = Clock()

    def stages(self) -> tuple[StageResult, ...]:
        """Results of the stages that ran, in the order of the campaign.

        A stage that fails (every candidate diverges, a coefficient changes nothing) keeps the values from
        before it, and those after it go on from there: `failed` names it, `fallbacks` say why.
        """
        waiting, progress = list(self.plans), self.work.progress
        running: list[StagePlan] = []
        failure: BaseException | None = None
        while running or (waiting and not self.stop.is_set()):
            try:
                for plan in [plan for plan in waiting if self._ready(plan) and not self.stop.is_set()]:
                    waiting.remove(plan)
                    running.append(plan)
                    threading.Thread(target=self._run, args=(plan,), daemon=True).start()
                # Outcomes wait in a dict, not in the queue: an interrupt may lose what the queue just gave.
                with contextlib.suppress(queue.Empty):
                    step = self.steps.get(timeout=0.5)
                    if step is not None and progress is not None and not self.stop.is_set():
                        progress(self.state(*step))
                for plan in [plan for plan in running if plan.stage.name in self.outcomes]:
                    running.remove(plan)
                    self._finish(plan.stage.name, self.outcomes[plan.stage.name])
            except KeyboardInterrupt:
                if self.stop.is_set() and failure is None:
                    raise
                self.stop.set()
            except BaseException as error:  # raised when the other stages have ended
                failure = failure or error
                self.stop.set()
        if failure is not None:
            raise failure
        return tuple(self.results[p.stage.name] for p in self.plans if p.stage.name in self.results)

    def _ready(self, plan: StagePlan) -> bool:
        return all(name in self.results or name in self.failed for name in plan.stage.after)

    def _finish(self, name: str, outcome: StageResult | BaseException) -> None:
        if isinstance(outcome, StageResult):
            self.results[outcome.name] = outcome
            if outcome.interrupted:
                self.stop.set()
            elif not outcome.reused:
                self.run.keep(f"{self.part}{outcome.name}", outcome.inputs, outcome.to_dict())
        elif not isinstance(outcome, KeyboardInterrupt):
            self.fallbacks.add("stage", outcome, of=name)
            self.failed.append(name)

    def _run(self, plan: StagePlan) -> None:
        """One stage, in its own thread: kept by an earlier run, searched here or by a worker of the fleet."""

        def stop_if_asked() -> None:
            if self.stop.is_set():
                raise KeyboardInterrupt

        def watch(step: Step) -> None:
            self.steps.put((plan, step))
            stop_if_asked()

        name, threads = plan.stage.name, self.work.threads
        try:
            earlier: dict[str, float] = {}
            for before in self.problem.stages_before(plan.stage):
                earlier |= {} if before in self.failed else self.results[before].coefficients
            search = StageSearch(self.problem, plan, earlier)
            kept = self.run.finished(f"{self.part}{name}", search.inputs)
            if kept is not None:
                self.outcomes[name] = replace(StageResult.from_dict(kept), reused=True)
            elif self.fleet is None:
                self.outcomes[name] = run_stage(search, threads, watch)
            else:
                shared, own = Shared(search), (threads_of(threads, self.fleet),)
                chunk = Chunk(f"{self.part}{name}", search.inputs, run_stage, shared, own)
                nowhere = RunDirectory(None)
                (done,) = run_chunks([chunk], nowhere, as_it_is(), fleet=self.fleet, waiting=stop_if_asked)
                self.outcomes[name] = done.value
        except BaseException as error:  # raised again in the caller's thread
            self.outcomes[name] = error
        self.steps.put(None)

    def state(self, plan: StagePlan, step: Step | None) -> Progress:
        """Progress of the whole after a step of a stage, or before the first one."""
        planned = {p.stage.name: p.work for p in self.plans}
        planned |= {name: 0.0 for name, result in self.results.items() if result.reused}
        done = sum(planned[name] for name in (*self.results, *self.failed))
        done += plan.done(step) if step else 0.0
        fraction = min(done / max(sum(planned.values()), done, 1.0), 1.0)
        return Progress(
            what=plan.stage.name,
            done=len(self.results) + len(self.failed),
            total=len(self.plans),
            fraction=fraction,
            elapsed_s=self.clock.elapsed_s,
            left_s=self.clock.left_s(fraction, 1.0 - fraction),
            step=step,
        )

    def joint_state(self, step: Step | None = None) -> Progress:
        """Progress of the whole where the joint estimate begins, or after a step of it."""
        stages, elapsed_s = len(self.plans), self.clock.elapsed_s
        text = f"Stages found after {elapsed_s:.0f} s; the joint estimate follows. Ctrl-C keeps the stages."
        return Progress(
            what="joint estimate",
            done=stages,
            total=stages + 1,
            fraction=0.0 if step is None else step.generation / max(step.generations, 1),
            elapsed_s=elapsed_s,
            left_s=math.nan if step is None else step.left_s,
            step=step,
            notes=(text,) if step is None and elapsed_s > _WORTH_SAYING_S else (),
        )
