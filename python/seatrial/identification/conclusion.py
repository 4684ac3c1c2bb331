"""What follows the stages of an identification, step by step: none of these steps takes the stages away.

The joint estimate refines what the stages found, the choice judges both, the assessment gives deviations, and
by-products follow: what rests on held values, where scores restart, the noise of a filter, the scores. Each
step begins with what was there before it and falls back to that where it fails
(`seatrial.base.finding`). Where the joint estimate is the result and cannot be assessed, the stages are
assessed and are the result.

Tests: ``tests/identification/test_fallbacks.py``, ``tests/identification/test_mutated_campaigns.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.errors import NumericalError
from seatrial.base.finding import Fallback, Fallbacks
from seatrial.diagnosis.assessment import Assessment, assess
from seatrial.estimation.estimator import Polished
from seatrial.estimation.joint_estimate import polish
from seatrial.identification.choice import Choice, choose, quadratic_or_strips, with_or_without_presumed
from seatrial.identification.held import Conditional, conditional, joint_estimate_of
from seatrial.identification.hold_out import PartScores, Restarts, part_scores
from seatrial.identification.noise_of_filter import with_model_error
from seatrial.identification.rounds import Proposal, in_rounds

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.base.work import Step
    from seatrial.estimation.joint import Joint
    from seatrial.estimation.stage import StageResult
    from seatrial.identification.preparation import Preparation
    from seatrial.problem.problem import Problem


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


def staged(problem: Problem, stages: Sequence[StageResult], fallbacks: Fallbacks) -> Vehicle:
    """The campaign's vehicle with what the stages found, without a stage that makes it impossible."""
    vehicle = problem.vehicle
    for stage in stages:
        vehicle = fallbacks.attempt(
            "stage impossible",
            lambda so_far=vehicle, stage=stage: so_far.with_coefficients(stage.coefficients),  # type: ignore[misc]
            vehicle,
            of=stage.name,
        )
    return vehicle


def concluded(
    ready: Preparation,
    start: Conclusion,
    *,
    stages: tuple[StageResult, ...],
    fallbacks: Fallbacks,
    spoilt: str = "",
    watch: Callable[[Step], None] | None,
    threads: int | None,
) -> Conclusion:
    """The result after the joint estimate and its assessment.

    ``start``: with the stages' vehicle. ``fallbacks``: takes what fails. ``spoilt``: why a joint estimate
    with a noise model identifies nothing from these data; mostly "". ``watch``, ``threads``: as of
    `seatrial.estimation.joint_estimate.polish`. Returns after Ctrl-C: the stages, marked as interrupted.
    """
    problem = start.problem

    def begun() -> Joint:
        return joint_estimate_of(problem, ready.whole, ready.held, start.vehicle, threads=threads)

    try:
        joint = fallbacks.attempt("joint estimate", begun, None)
        if joint is None:
            return start
        result, polished = start, None
        if problem.joint is not None and problem.joint.rounds:
            result, joint, polished = jointly(start, joint, stages, fallbacks, watch=watch, threads=threads)
        done = _assessed(ready, result, joint, polished, fallbacks, spoilt)
        if done is None and polished is not None:
            # The joint estimate cannot be assessed: the stages, whose deviations may be known.
            fresh = fallbacks.attempt("stages anew", begun, None)
            result = replace(start, interrupted=result.interrupted)
            done = None if fresh is None else _assessed(ready, result, fresh, None, fallbacks, spoilt)
        return result if done is None else done
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

    def improved() -> Polished:
        polished_again = _finite(polish(joint, watch=watch))
        if polished_again.rounds == 0 and not polished_again.interrupted:
            raise NumericalError("it took no step, because the model diverges where the stages ended")
        return polished_again

    polished = fallbacks.attempt("joint estimate", improved, None)
    if polished is None:
        return start, joint, None
    if polished.stopped:
        stopped = Fallback("round", "numerical", polished.stopped, str(polished.rounds))
        fallbacks.findings.append(stopped)
    problem, notes = start.problem, start.notes
    begun, best, dropped, why = fallbacks.attempt(
        "presumed",
        lambda: with_or_without_presumed(joint, polished, watch=watch),
        (joint, polished, tuple[str, ...](), ""),
    )
    if dropped:
        problem, notes = problem.without_coefficients(set(dropped)), (*notes, why)
    same: Callable[[Problem], Problem] = lambda problem: problem  # noqa: E731
    other, best_other, kind, compared = fallbacks.attempt(
        "strips",
        lambda: quadratic_or_strips(begun, best, watch=watch),
        (begun, best, same, tuple[str, ...]()),
    )
    rich, best_rich, accepted, proposals = fallbacks.attempt(
        "proposals",
        lambda: in_rounds(other, best_other, rounds=other.polish.proposal_rounds, watch=watch),
        (other, best_other, same, tuple[Proposal, ...]()),
    )
    changed = accepted(kind(problem))
    choice = fallbacks.attempt(
        "choice",
        lambda: choose(changed, rich, _finite(best_rich), stages=stages, begun=begun, threads=threads),
        None,
    )
    result = replace(
        start,
        problem=problem,
        notes=notes,
        choice=choice,
        proposals=proposals,
        interrupted=start.interrupted or best_rich.interrupted,
    )
    if choice is None or choice.result == "stages":
        return result, begun, None
    result = replace(
        result, problem=changed, notes=(*notes, *compared), nuisances=rich.records(best_rich.values)
    )
    return result, rich, best_rich


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

    def judged() -> tuple[Polished, Assessment]:
        estimate = _finite(polish(joint, rounds=0) if polished is None else polished)
        return estimate, assess(joint, estimate)

    # Each of the following may fail by itself and then costs only what rests on it.
    step = "deviations of the stages" if polished is None else "deviations"
    both = fallbacks.attempt(step, judged, None)
    if both is None:
        return None
    estimate, sure = both
    # Where these data identify nothing, no deviation counts.
    if spoilt and joint.comparison.models_noise:
        sure = replace(sure, spoilt=spoilt)
    rests: tuple[Conditional, ...] = fallbacks.attempt(
        "dependence", lambda: conditional(joint, estimate, ready.held, sure.uncertainty), ()
    )
    restarts = fallbacks.attempt(
        "restarts", lambda: Restarts.of(result.problem, joint, estimate.values, sure.vehicle), Restarts()
    )
    return replace(
        result,
        vehicle=sure.vehicle,
        notes=(*result.notes, *joint.sentences()),
        assessment=sure,
        conditional=rests,
        restarts=restarts,
    )


def scored(result: Conclusion, fallbacks: Fallbacks) -> tuple[Vehicle, PartScores]:
    """The vehicle with the noise of a filter on it in its file, and its scores."""
    problem, vehicle = result.problem, result.vehicle
    noisy = fallbacks.attempt(
        "filter noise", lambda: with_model_error(vehicle, problem), vehicle.without_model_error()
    )
    scores = fallbacks.attempt(
        "scores",
        lambda: part_scores(problem, noisy, nuisances=result.nuisances, restarts=result.restarts),
        PartScores({}, ()),
    )
    return noisy, scores


def _finite(polished: Polished) -> Polished:
    """The joint estimate.

    Raises NumericalError: a value is not finite, or the cost where the estimate took steps.
    """
    if not np.isfinite(polished.values).all() or not (np.isfinite(polished.cost) or polished.rounds == 0):
        raise NumericalError(
            "its values or its cost are not finite, because the model diverges on the trials"
        )
    return polished
