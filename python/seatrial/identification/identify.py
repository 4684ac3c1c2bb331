"""Identification: data judged, stages searched, result estimated jointly, assessed and kept.

`identify` is the public function, with a vehicle and its trials or with a `Problem`. `StageOrder` runs
dependent stages one after the other and independent ones side by side; finished ones are kept, so that an
interrupted run goes on where it stopped.

Tests: ``tests/identification/test_identify.py``, ``tests/problem/test_by_hand.py``.
"""

from __future__ import annotations

import contextlib
import hashlib
import math
import queue
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from seatrial._core import Vehicle, checked_threads
from seatrial.base.chunks import Chunk, Shared, as_it_is, run_chunks
from seatrial.base.errors import CampaignError
from seatrial.base.finding import Fallbacks
from seatrial.base.fleet import fleet_of, threads_of
from seatrial.base.report import words_of
from seatrial.base.run import RunDirectory, run_facts, to_json, version
from seatrial.base.work import HERE, Clock, Progress, Step, Work, callers_errors_pass, takes
from seatrial.estimation.scale import judge_scale
from seatrial.estimation.stage import StagePlan, StageResult, run_stage
from seatrial.identification.conclusion import Conclusion, concluded, scored, staged
from seatrial.identification.estimate import estimates
from seatrial.identification.events import EventEstimates, from_events
from seatrial.identification.fitted import Fitted
from seatrial.identification.identification import Identification
from seatrial.identification.preparation import prepare
from seatrial.inspect.consistency import late_velocity
from seatrial.problem.by_hand import Bounds, Trials
from seatrial.problem.problem import Problem

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.base.fleet import Fleet
    from seatrial.bench_test.evaluate import BenchTest
    from seatrial.problem.settings import Anchor, JointSettings
    from seatrial.trial.trial import Input


@overload
def identify(problem: Problem, *, work: Work = HERE) -> Identification: ...


@overload
def identify(
    vehicle: Vehicle | str | Path,
    trials: Trials,
    /,
    *,
    free: str | Sequence[str] | Mapping[str, Bounds | None],
    start: Mapping[str, float] | None = None,
    hold_out: float | Trials = 0.2,
    axes: str | None = None,
    channels: Sequence[str] | Mapping[str, float] | None = None,
    input: Input | None = None,
    segment_s: float = 10.0,
    joint: bool | JointSettings = True,
    anchor: Anchor | None = None,
    bench: BenchTest | None = None,
    name: str | None = None,
    seed: int = 0,
    work: Work = HERE,
) -> Identification: ...


@takes(work=Work)
@callers_errors_pass
def identify(
    problem: Problem | Vehicle | str | Path, trials: Trials | None = None, *, work: Work = HERE, **asked: Any
) -> Identification:
    """Identification of a vehicle from its trials.

    ``identify(vehicle, trials, free=...)`` is ``Problem(vehicle, trials, free=...).identify()``: one stage
    that frees the coefficients on all trials, then the joint estimate. A campaign file can ask for more
    (stages in an order, ties, anchors of the scale, nuisance parameters): ``Campaign.load(file).identify()``.

    Parameters
    ----------
    problem : Problem; or Vehicle, str or Path
        What is asked; or the vehicle, its built-in name or its file.
    trials : Trial, frame, str or Path, or several
        With a vehicle: a trial, a list, or a dict by name, as of `Problem`.
    free, start, hold_out, axes, channels, input, segment_s, joint, anchor, bench, name, seed
        With a vehicle: as of `Problem`.
    work : Work, optional
        Threads, executor, run directory and progress. Finished stages are kept in the run directory; an
        executor searches stages side by side that do not need each other, the joint estimate stays here.

    Returns
    -------
    Identification
        After Ctrl-C: the best so far, marked as interrupted.

    Raises
    ------
    CampaignError, TrialError, VehicleError
        What is asked for cannot be done.
    SimulationError
        The start vehicle diverges, and so does everything that was tried between the bounds before the
        search. What fails after that is a `Fallback` of the result.
    SeatrialError
        The run directory cannot be written.

    Examples
    --------
    >>> import numpy as np
    >>> import seatrial as st
    >>> t = np.arange(0.0, 60.0, 0.1)
    >>> true = st.Vehicle.load("cwolf")
    >>> commands = {name: 400.0 * np.sign(np.sin(0.2 * t)) + 500.0 for name in true.actuators}
    >>> run = true.simulate(t, commands)
    >>> logged = {f"cmd.{name}": signal for name, signal in commands.items()}
    >>> table = {"t_s": t, "u_m_s": run.nu[:, 0]} | logged
    >>> start = true.with_coefficients({"X_uu": 0.7 * true.coefficients()["X_uu"]})
    >>> fit = st.identify(start, table, free={"X_uu": (-40.0, -1.0)})
    >>> round(fit.vehicle.coefficients()["X_uu"] / true.coefficients()["X_uu"], 2)
    1.0

    >>> fit = st.Campaign.load("examples/cwolf/campaign.toml").identify()  # doctest: +SKIP
    >>> print(fit.summary())  # doctest: +SKIP
    """
    checked_threads(work.threads)
    if not isinstance(problem, Problem):
        if callable(getattr(problem, "problem", None)):
            raise CampaignError("identify: found a campaign; use campaign.identify(work=st.Work(...))")
        if trials is None or "free" not in asked:
            raise CampaignError("identify: expected a Problem, or a vehicle, its trials and free=[names]")
        problem = Problem(problem, trials, **asked)
    elif trials is not None or asked:
        given = "trials" if trials is not None else next(iter(asked))
        raise CampaignError(f"identify: {given}: the problem says that; give it only beside a vehicle")
    with fleet_of(work.executor) as fleet:
        return run_identification(problem, work, fleet=fleet)


_WORTH_SAYING_S = 10.0
"""Stages that took longer than this are followed by a joint estimate that takes long too."""


@dataclass(frozen=True, eq=False)
class _Stage:
    """What the search of a stage needs, wherever it runs."""

    problem: Problem
    plan: StagePlan
    vehicle: Vehicle
    coefficients: Mapping[str, float]
    inputs: str


def search_stage(
    stage: _Stage, threads: int | None, watch: Callable[[Step], None] = lambda step: None
) -> StageResult:
    """Result of a stage: a chunk of the work."""
    return run_stage(
        stage.problem,
        stage.plan,
        vehicle=stage.vehicle,
        earlier=stage.coefficients,
        inputs=stage.inputs,
        watch=watch,
        threads=threads,
    )


class StageOrder:
    """Workspace of one identification: one thread per running stage, the caller's thread directs them."""

    def __init__(
        self,
        problem: Problem,
        plans: tuple[StagePlan, ...],
        run: RunDirectory,
        *,
        part: str = "",
        progress: Callable[[Progress], None] | None,
        threads: int | None,
        fleet: Fleet | None = None,
    ) -> None:
        self.fleet = fleet
        self.problem, self.plans, self.run, self.part = problem, plans, run, part
        self.progress, self.threads = progress, threads
        self.stop = threading.Event()
        self.steps: queue.SimpleQueue[tuple[StagePlan, Step] | None] = queue.SimpleQueue()
        self.outcomes: dict[str, StageResult | BaseException] = {}
        self.results: dict[str, StageResult] = {}
        self.failed: list[str] = []
        self.fallbacks = Fallbacks()
        self.clock = Clock()

    def stages(self) -> tuple[StageResult, ...]:
        """Results of the stages that ran, in the order of the campaign.

        A stage that fails (every candidate diverges, a coefficient changes nothing) keeps the values from
        before it, and those after it go on from there: `failed` names it, `fallbacks` say why.
        """
        waiting = list(self.plans)
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
                    if step is not None and self.progress is not None and not self.stop.is_set():
                        self.progress(self.state(*step))
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
        """One stage, in its own thread."""

        def watch(step: Step) -> None:
            self.steps.put((plan, step))
            if self.stop.is_set():
                raise KeyboardInterrupt

        name = plan.stage.name
        try:
            coefficients: dict[str, float] = {}
            for earlier in self.problem.stages_before(plan.stage):
                coefficients |= {} if earlier in self.failed else self.results[earlier].coefficients
            vehicle = self.problem.vehicle.with_coefficients(coefficients)
            inputs = _inputs(self.problem, plan, vehicle, coefficients)
            kept = self.run.finished(f"{self.part}{name}", inputs)
            if kept is not None:
                self.outcomes[name] = replace(StageResult.from_dict(kept), reused=True)
            else:
                search = self._here if self.fleet is None else self._elsewhere
                self.outcomes[name] = search(_Stage(self.problem, plan, vehicle, coefficients, inputs), watch)
        except BaseException as error:  # raised again in the caller's thread
            self.outcomes[name] = error
        self.steps.put(None)

    def _here(self, stage: _Stage, watch: Callable[[Step], None]) -> StageResult:
        return search_stage(stage, self.threads, watch)

    def _elsewhere(self, stage: _Stage, watch: Callable[[Step], None]) -> StageResult:
        """Result of a stage that a worker of the fleet searches."""

        def waiting() -> None:
            if self.stop.is_set():
                raise KeyboardInterrupt

        chunk = Chunk(
            f"{self.part}{stage.plan.stage.name}",
            stage.inputs,
            search_stage,
            Shared(stage),
            (threads_of(self.threads, self.fleet),),
        )
        (done,) = run_chunks([chunk], RunDirectory(None), as_it_is(), fleet=self.fleet, waiting=waiting)
        result: StageResult = done.value
        return result

    def state(self, plan: StagePlan, step: Step | None) -> Progress:
        """Progress of the whole after a step of a stage, or before the first one."""
        planned = {p.stage.name: p.work for p in self.plans}
        for name, result in self.results.items():
            if result.reused:
                planned[name] = 0.0
        done = sum(planned[name] for name in (*self.results, *self.failed)) + (
            plan.done(step) if step else 0.0
        )
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


def _inputs(problem: Problem, plan: StagePlan, vehicle: Vehicle, coefficients: Mapping[str, float]) -> str:
    """SHA-256 of everything that the result of a stage depends on."""
    data = plan.data
    digest = hashlib.sha256()
    described = {
        "version": version("seatrial"),
        "stage": plan.stage.model_dump(),
        "inputs": [problem.input_of(name) for name in plan.stage.trials],
        "vehicle": vehicle.to_toml(),
        "found": coefficients,
        "plan": [
            plan.seed,
            plan.population,
            plan.generations,
            plan.rounds,
            plan.tolerance,
            plan.step.substeps,
            plan.step.search,
        ],
        "segments": [astuple(segment) for segment in data.segments],
        "environment": [(trial.rho, trial.g, trial.surface) for trial in data.trials],
    }
    digest.update(to_json(described).encode())
    for record in data.records:
        trial = record.trial
        signals = [
            trial.t,
            trial.observed,
            record.counted,
            trial.nu,
            trial.tau,
            trial.voltage_v,
            trial.current,
        ]
        for values in (*signals, *trial.commands.values(), *trial.measured.values()):
            digest.update(b"-" if values is None else np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


def run_identification(problem: Problem, work: Work, *, fleet: Fleet | None = None) -> Identification:
    """Identification of the campaign's vehicle: every stage run, the result polished and judged."""
    clock, threads, progress = Clock(), work.threads, work.progress
    with RunDirectory(work.run_dir, "identification", resume=work.resume) as run:
        ready = prepare(problem, threads=threads)  # refuses a bad campaign before a search
        fitted = dict.fromkeys(name for plan in ready.plans for name in plan.stage.trials)
        late = late_velocity(
            {name: problem.trials[name] for name in fitted}, problem.recordings, problem=str(problem.source)
        )
        spoilt = words_of(late.finding) if late is not None and late.spoils else ""
        early, by_events = Fallbacks(), EventEstimates(problem)

        def watch_events(stage: str) -> None:
            if progress is not None:
                progress(Progress(f"{stage}: events", 0, len(ready.plans), 0.0, clock.elapsed_s, math.nan))

        if not spoilt:  # what is late biases an event as it does the whole log
            ask = partial(from_events, problem, threads=threads, watch=watch_events)
            by_events = early.attempt("events", ask, by_events)
        if by_events.taken and by_events.rest.stages:
            ready = prepare(by_events.rest, threads=threads)
        elif by_events.taken:  # events tell all that was asked
            ready = replace(ready, problem=by_events.rest, whole=by_events.rest, held=(), plans=())
        problem, plans, before, notes = ready.problem, ready.plans, ready.sentences, ready.no_joint
        findings = (*(() if late is None else (late.finding,)), *ready.findings)
        before = (*(() if late is None else (words_of(late.finding),)), *before)
        order = StageOrder(problem, plans, run, progress=progress, threads=threads, fleet=fleet)
        if progress is not None and before and plans:
            progress(replace(order.state(plans[0], None), notes=before))
        stages, fallbacks = order.stages(), order.fallbacks
        fallbacks.findings[:0] = early.findings
        end = Conclusion(problem, staged(problem, stages, fallbacks), notes, interrupted=order.stop.is_set())
        if not end.interrupted and not notes and plans:
            if progress is not None:
                progress(_joint_progress(order))
            end = concluded(
                ready,
                end,
                stages=stages,
                fallbacks=fallbacks,
                spoilt=spoilt,
                watch=_watch(order, progress),
                threads=threads,
            )
        if by_events.taken:
            again = partial(by_events.again, end.vehicle, threads=threads)
            by_events = by_events if end.interrupted else fallbacks.attempt("events", again, by_events)
            vehicle = end.vehicle.with_coefficients(by_events.values)
            end = replace(end, problem=by_events.restored(end.problem), vehicle=vehicle)
        vehicle, judged = scored(end, fallbacks)
        problem, sure = end.problem, end.assessment
        fit = Identification(
            problem=problem,
            vehicle=vehicle,
            coefficients=estimates(problem, stages, sure, failed=order.failed, events=by_events.taken),
            stages=stages,
            assessment=sure,
            scores=judged.scores,
            before=before,
            findings=findings,
            held=ready.held,
            conditional=end.conditional,
            scale=fallbacks.attempt("scale", lambda: judge_scale(problem, vehicle), judge_scale(problem)),
            notes=(*end.notes, *end.restarts.sentences, *judged.missing),
            facts=run_facts(
                "identification",
                problem.name,
                clock=clock,
                inputs=problem.input_hashes(),
                seed=problem.seed,
                interrupted=end.interrupted,
            ),
            interrupted=end.interrupted,
            not_run=tuple(s.name for s in problem.stages if s.name not in {stage.name for stage in stages}),
            choice=end.choice,
            restarts=end.restarts,
            proposals=end.proposals,
            events=by_events.estimates,
        )
        fit = replace(fit, doubt=fallbacks.attempt("draws", lambda: Fitted.of(fit).doubt(), ""))
        fit = replace(fit, fallbacks=tuple(fallbacks.findings))
        if work.run_dir is not None:
            run.publish(fit.facts, fit.files())
    return fit


def _watch(order: StageOrder, progress: Callable[[Progress], None] | None) -> Callable[[Step], None] | None:
    """What the joint estimate reports, as progress of the whole."""
    if progress is None:
        return None

    def watch(step: Step) -> None:
        progress(_joint_progress(order, step))

    return watch


def _joint_progress(order: StageOrder, step: Step | None = None) -> Progress:
    """Progress of the whole where the joint estimate begins, or after a step of it."""
    stages, elapsed_s = len(order.plans), order.clock.elapsed_s
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
