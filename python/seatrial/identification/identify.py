"""Identification: what is asked prepared, stages searched, all estimated jointly, the result judged and kept.

`identify` is the public function, with a vehicle and its trials or with a `Problem`. The joint estimate
refines what the stages found, the choice judges both, the assessment gives deviations, and by-products
follow: what rests on held values, where scores restart, the noise of a filter, the scores. Each step begins
with what was there before it and falls back to that where it fails (`seatrial.base.finding`). Where the joint
estimate is the result and cannot be assessed, the stages are assessed and are the result.

With the information H of the joint estimate, its coefficients as theta and the held ones as psi, an error of
psi moves theta by ``d theta = -H_tt^-1 H_tp d psi`` (`conditional`).

Tests: ``tests/identification/test_identify.py``, ``tests/identification/test_fallbacks.py``,
``tests/identification/test_mutated_campaigns.py``, ``tests/identification/test_held.py``,
``tests/problem/test_by_hand.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack, overload

import numpy as np

from seatrial._core import checked_threads
from seatrial.base.errors import CampaignError, NumericalError
from seatrial.base.finding import Fallback, Fallbacks
from seatrial.base.fleet import fleet_of
from seatrial.base.report import words_of
from seatrial.base.run import RunDirectory, run_facts
from seatrial.base.work import HERE, Clock, Progress, Step, Work, callers_errors_pass, takes
from seatrial.diagnosis.assessment import Assessment, assess
from seatrial.estimation.estimator import Polished
from seatrial.estimation.joint import Joint
from seatrial.estimation.joint_estimate import linearise, polish
from seatrial.estimation.scale import judge_scale
from seatrial.estimation.stage import StageOrder, StageResult
from seatrial.identification.choice import Choice, choose, quadratic_or_strips, with_or_without_presumed
from seatrial.identification.estimate import estimates
from seatrial.identification.events import EventEstimates, from_events
from seatrial.identification.fitted import Fitted
from seatrial.identification.hold_out import PartScores, Restarts, part_scores, with_model_error
from seatrial.identification.identification import Conditional, Identification
from seatrial.identification.preparation import HELD_SETTINGS, Held, Preparation, prepare
from seatrial.identification.rounds import Proposal, in_rounds
from seatrial.inspect.consistency import late_velocity
from seatrial.problem.by_hand import Asked, Trials
from seatrial.problem.problem import Problem

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.base.fleet import Fleet
    from seatrial.statistics.uncertainty import Uncertainty


@overload
def identify(problem: Problem, *, work: Work = HERE) -> Identification: ...


@overload
def identify(
    vehicle: Vehicle | str | Path, trials: Trials, /, *, work: Work = HERE, **asked: Unpack[Asked]
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
    with (
        fleet_of(work.executor) as fleet,
        RunDirectory(work.run_dir, "identification", resume=work.resume) as run,
    ):
        fit = run_identification(problem, work, run, fleet)
        if work.run_dir is not None:
            run.publish(fit.facts, fit.files())
    return fit


@dataclass(frozen=True)
class Conclusion:
    """The result so far: campaign, vehicle, and what is known of them.

    The fields are those of `seatrial.identification.identification.Identification`; ``nuisances`` are the
    nuisance parameters of the trials' records, by trial and name, ``proposals`` what was tried in rounds.
    """

    problem: Problem
    vehicle: Vehicle
    notes: tuple[str, ...] = ()
    assessment: Assessment | None = None
    choice: Choice | None = None
    nuisances: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    conditional: tuple[Conditional, ...] = ()
    restarts: Restarts = field(default_factory=Restarts)
    proposals: tuple[Proposal, ...] = ()
    interrupted: bool = False


def run_identification(
    problem: Problem, work: Work, run: RunDirectory, fleet: Fleet | None
) -> Identification:
    """Every stage run, the result estimated jointly and judged; finished stages are kept in the run."""
    clock, threads, tell, fallbacks = Clock(), work.threads, work.progress, Fallbacks()
    # What cannot be done is refused before a search, and what spoils every estimate is known.
    ready = prepare(problem, threads=threads)
    fitted = {name: problem.trials[name] for name in problem.fitted}
    late = late_velocity(fitted, problem.recordings, problem=str(problem.source))
    late_words = "" if late is None else words_of(late.finding)
    spoilt = late_words if late is not None and late.spoils else ""
    # Open-loop stretches of a closed loop first; what is late biases an event as it does the whole log.
    by_events = EventEstimates(problem)
    with fallbacks.step("events"):
        by_events = (
            by_events
            if spoilt
            else from_events(problem, threads=threads, watch=_events_shown(tell, ready, clock))
        )
    if by_events.taken and by_events.rest.stages:
        ready = prepare(by_events.rest, threads=threads)
    elif by_events.taken:  # events tell all that was asked
        ready = replace(ready, problem=by_events.rest, whole=by_events.rest, held=(), plans=())
    problem, before = ready.problem, (*filter(None, [late_words]), *ready.sentences)
    # Stages in their order, then all coefficients jointly.
    order = StageOrder(problem, ready.plans, run, work, fleet=fleet, fallbacks=fallbacks)
    if tell is not None and before and ready.plans:
        tell(replace(order.state(ready.plans[0], None), notes=before))
    stages = order.stages()
    end = Conclusion(
        problem, staged(problem, stages, fallbacks), ready.no_joint, interrupted=order.stop.is_set()
    )
    if not end.interrupted and not ready.no_joint and ready.plans:
        watch = None if tell is None else lambda step: tell(order.joint_state(step))
        if tell is not None:
            tell(order.joint_state())
        end = concluded(ready, end, stages, fallbacks, spoilt=spoilt, watch=watch, threads=threads)
    # Events once more beside what all others found.
    if by_events.taken:
        with fallbacks.step("events"):
            by_events = by_events if end.interrupted else by_events.again(end.vehicle, threads=threads)
        vehicle = end.vehicle.with_coefficients(by_events.values)
        end = replace(end, problem=by_events.restored(end.problem), vehicle=vehicle)
    vehicle, judged = scored(end, fallbacks)
    problem, scale = end.problem, ready.scale
    with fallbacks.step("scale"):
        scale = judge_scale(problem, vehicle)
    fit = Identification(
        problem=problem,
        vehicle=vehicle,
        coefficients=estimates(problem, stages, end.assessment, failed=order.failed, events=by_events.taken),
        stages=stages,
        assessment=end.assessment,
        scores=judged.scores,
        before=before,
        findings=(*(() if late is None else (late.finding,)), *ready.findings),
        held=ready.held,
        conditional=end.conditional,
        scale=scale,
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
    doubt = ""
    with fallbacks.step("draws"):
        doubt = Fitted.of(fit).doubt()
    return replace(fit, doubt=doubt, fallbacks=tuple(fallbacks.findings))


def _events_shown(
    tell: Callable[[Progress], None] | None, ready: Preparation, clock: Clock
) -> Callable[[str], None] | None:
    """Shows whose events are estimated, before any stage is searched."""
    if tell is None:
        return None
    total = len(ready.plans)
    return lambda stage: tell(Progress(f"{stage}: events", 0, total, 0.0, clock.elapsed_s, math.nan))


def staged(problem: Problem, stages: Sequence[StageResult], fallbacks: Fallbacks) -> Vehicle:
    """The campaign's vehicle with what the stages found, without a stage that makes it impossible."""
    vehicle = problem.vehicle
    for stage in stages:
        with fallbacks.step("stage impossible", of=stage.name):
            vehicle = vehicle.with_coefficients(stage.coefficients)
    return vehicle


def joint_estimate_of(
    problem: Problem, whole: Problem, held: Sequence[Held], vehicle: Vehicle, *, threads: int | None = None
) -> Joint:
    """The joint estimate beside held coefficients, from a vehicle on.

    With a noise model they are nuisance parameters of it: its predictions tell them in part, and held at a
    wrong value they bend what another axis tells. Output error keeps them as they are.
    """
    joint = Joint(problem, vehicle, threads=threads)
    if not held or not joint.comparison.models_noise:
        return joint
    return Joint(whole, vehicle, threads=threads, hidden={row.parameter for row in held})


def concluded(
    ready: Preparation,
    start: Conclusion,
    stages: tuple[StageResult, ...],
    fallbacks: Fallbacks,
    *,
    spoilt: str = "",
    watch: Callable[[Step], None] | None,
    threads: int | None,
) -> Conclusion:
    """The result after the joint estimate and its assessment; after Ctrl-C the stages, marked as interrupted.

    ``start``: with the stages' vehicle. ``spoilt``: why a joint estimate with a noise model identifies
    nothing from these data; mostly "".
    """
    problem, result, joint, polished = start.problem, start, None, None
    try:
        with fallbacks.step("joint estimate"):
            joint = joint_estimate_of(problem, ready.whole, ready.held, start.vehicle, threads=threads)
        if joint is None:
            return start
        if problem.joint is not None and problem.joint.rounds:
            result, joint, polished = jointly(start, joint, stages, fallbacks, watch=watch, threads=threads)
        assessed = _assessed(ready, result, joint, polished, fallbacks, spoilt)
        if assessed is None and polished is not None:
            # The joint estimate cannot be assessed: the stages, whose deviations may be known.
            result, joint = replace(start, interrupted=result.interrupted), None
            with fallbacks.step("stages anew"):
                joint = joint_estimate_of(problem, ready.whole, ready.held, start.vehicle, threads=threads)
            if joint is not None:
                assessed = _assessed(ready, result, joint, None, fallbacks, spoilt)
        return assessed or result
    except KeyboardInterrupt:
        # The stages are the best so far; a second Ctrl-C ends the run.
        return replace(start, interrupted=True)


def jointly(
    start: Conclusion,
    joint: Joint,
    stages: tuple[StageResult, ...],
    fallbacks: Fallbacks,
    *,
    watch: Callable[[Step], None] | None,
    threads: int | None,
) -> tuple[Conclusion, Joint, Polished | None]:
    """What the joint estimate makes of the stages; where they stay the result, without an estimate."""
    polished = None
    with fallbacks.step("joint estimate"):
        polished = _finite(polish(joint, watch=watch), moved=True)
    if polished is None:
        return start, joint, None
    if polished.stopped:
        fallbacks.findings.append(Fallback("round", "numerical", polished.stopped, str(polished.rounds)))
    # Without what only a prior bounds, where that predicts better.
    problem, notes = start.problem, start.notes
    begun, best, dropped, why = joint, polished, tuple[str, ...](), ""
    with fallbacks.step("presumed"):
        begun, best, dropped, why = with_or_without_presumed(joint, polished, watch=watch)
    if dropped:
        problem, notes = problem.without_coefficients(set(dropped)), (*notes, why)
    # With another damping, and with terms that the residuals ask for, where these are likelier.
    rich, compared, proposals = begun, tuple[str, ...](), tuple[Proposal, ...]()
    with fallbacks.step("strips"):
        rich, best, compared = quadratic_or_strips(begun, best, watch=watch)
    with fallbacks.step("proposals"):
        rich, best, proposals = in_rounds(rich, best, rounds=rich.polish.proposal_rounds, watch=watch)
    changed = rich.problem.without_coefficients(rich.hidden)
    # Stages or joint estimate, on data outside the fit.
    choice = None
    with fallbacks.step("choice"):
        choice = choose(changed, rich, _finite(best), stages=stages, begun=begun, threads=threads)
    interrupted = start.interrupted or best.interrupted
    result = replace(
        start, problem=problem, notes=notes, choice=choice, proposals=proposals, interrupted=interrupted
    )
    if choice is None or choice.result == "stages":
        return result, begun, None
    nuisances = rich.records(best.values)
    result = replace(result, problem=changed, notes=(*notes, *compared), nuisances=nuisances)
    return result, rich, best


def _assessed(
    ready: Preparation,
    result: Conclusion,
    joint: Joint,
    polished: Polished | None,
    fallbacks: Fallbacks,
    spoilt: str,
) -> Conclusion | None:
    """The result with deviations and what follows from them; None where it has none.

    Without an estimate the start of the joint estimate, which the stages found, is judged.
    """
    # Each of the following may fail by itself and then costs only what rests on it.
    assessment = None
    with fallbacks.step("deviations of the stages" if polished is None else "deviations"):
        polished = _finite(polish(joint, rounds=0) if polished is None else polished)
        assessment = assess(joint, polished)
    if assessment is None or polished is None:
        return None
    # Where these data identify nothing, no deviation counts.
    if spoilt and joint.comparison.models_noise:
        assessment = replace(assessment, spoilt=spoilt)
    rests, restarts = tuple[Conditional, ...](), Restarts()
    with fallbacks.step("dependence"):
        rests = conditional(joint, polished, ready.held, assessment.uncertainty)
    with fallbacks.step("restarts"):
        restarts = Restarts.of(result.problem, joint, polished.values, assessment.vehicle)
    return replace(
        result,
        vehicle=assessment.vehicle,
        notes=(*result.notes, *joint.sentences()),
        assessment=assessment,
        conditional=rests,
        restarts=restarts,
    )


def conditional(
    joint: Joint, polished: Polished, held: Sequence[Held], known: Uncertainty
) -> tuple[Conditional, ...]:
    """Estimates that would move by a standard deviation or more were a held value a fifth larger.

    Those that ended at a bound cannot move. To first order, at the estimate. None where the held values are
    nuisance parameters of the estimate.
    """
    if not held or joint.hidden:
        return ()
    names = [row.name for row in held]
    lin = linearise(joint, polished.values, initial=polished.initial, noise=polished.noise, extra=names)
    count = len(joint.unknowns)
    free = [place for place, bound in enumerate(known.at_bound) if bound is None]
    size = np.array([joint.unknowns[place].scale for place in free])
    whole = lin.information()
    inside = np.linalg.pinv(
        size[:, None] * whole[np.ix_(free, free)] * size, rcond=HELD_SETTINGS.rank, hermitian=True
    )
    changes = []
    for name in dict.fromkeys(row.parameter for row in held):
        more = np.array([HELD_SETTINGS.error_share * row.value * (row.parameter == name) for row in held])
        moved = -size * (inside @ (size * (whole[np.ix_(free, range(count, len(whole)))] @ more)))
        for place, change in zip(free, moved.tolist(), strict=True):
            away = change / float(known.sigma[place])
            if abs(away) >= 1.0:
                unknown = joint.unknowns[place]
                changes.append(Conditional(unknown.name, unknown.unit, name, change, away))
    return tuple(sorted(changes, key=lambda change: -abs(change.deviations)))


def scored(result: Conclusion, fallbacks: Fallbacks) -> tuple[Vehicle, PartScores]:
    """The vehicle with the noise of a filter on it in its file, and its scores."""
    vehicle, scores = result.vehicle.without_model_error(), PartScores({}, ())
    with fallbacks.step("filter noise"):
        vehicle = with_model_error(result.vehicle, result.problem)
    with fallbacks.step("scores"):
        scores = part_scores(result.problem, vehicle, nuisances=result.nuisances, restarts=result.restarts)
    return vehicle, scores


def _finite(polished: Polished, *, moved: bool = False) -> Polished:
    """The joint estimate.

    Raises NumericalError: a value is not finite, or the cost where the estimate took steps; or it took none
    and should have `moved`.
    """
    if not np.isfinite(polished.values).all() or not (np.isfinite(polished.cost) or polished.rounds == 0):
        raise NumericalError(
            "its values or its cost are not finite, because the model diverges on the trials"
        )
    if moved and polished.rounds == 0 and not polished.interrupted:
        raise NumericalError("it took no step, because the model diverges where the stages ended")
    return polished
