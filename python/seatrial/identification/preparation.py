"""What an identification refuses or warns of before its first search; a check of the campaign asks the same.

Held by ``tests/check/test_check_campaign.py``.

Recordings that stand in a campaign under several names are no independent data: two trials hold the same
recording if their files have the same content, or if the same samples were read from them. Parts that share
no time are independent all the same (``tests/check/test_check_campaign.py``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError, TrialError
from seatrial.base.finding import Finding, Severity
from seatrial.base.report import sentence_of, words_of
from seatrial.base.run import sha256
from seatrial.diagnosis.assessment import conditioning
from seatrial.estimation.inputs import trained
from seatrial.estimation.joint import Joint
from seatrial.estimation.scale import judge_scale
from seatrial.estimation.stage import StagePlan, frozen_sentences, plan, start_cost, step_sentences
from seatrial.identification.held import Held, hold_untold, sentences
from seatrial.inspect.wiring import wiring
from seatrial.vehicle.actuators import actuator_groups, drivers

if TYPE_CHECKING:
    from seatrial.problem.problem import Problem
    from seatrial.trial.trial import Trial


@dataclass(frozen=True)
class Preparation:
    """What an identification runs, and what is known before.

    ``campaign`` frees nothing that is ``held``, ``whole`` does; ``plans`` are its stages, ``findings`` name
    what contradicts the vehicle file, ``sentences`` say this and what the data cannot tell, ``no_joint`` why
    there can be no joint estimate.
    """

    problem: Problem
    whole: Problem
    held: tuple[Held, ...]
    plans: tuple[StagePlan, ...]
    sentences: tuple[str, ...]
    no_joint: tuple[str, ...]
    findings: tuple[Finding, ...]


def prepare(problem: Problem, *, threads: int | None = None) -> Preparation:
    """Plan of an identification, with all that is refused before a search.

    Raises CampaignError and TrialError: the campaign asks for what cannot be done, or a recording lacks what
    it needs.
    """
    if not problem.stages:
        raise CampaignError(
            f"{problem.source}: expected [[stages]], found none: there is nothing to identify; the campaign"
            " only tunes or verifies an autopilot"
        )
    wired = _wired(problem)
    contradictions = (f"WARNING: {words_of(finding)}" for finding in wired)
    silent = (*contradictions, *repeated_sentences(problem), *_actuators_without_column(problem))
    whole, commandless = without_commandless(problem)
    problem, held = identifiable(whole)
    plans = plan(problem)
    judge_scale(problem)
    diverging = tuple(
        _warning("start diverges", stage_plan.stage.name)
        for stage_plan in plans
        if not stage_plan.stage.after and not math.isfinite(start_cost(problem, stage_plan, threads=threads))
    )
    conditions, no_joint = _conditioning(problem, threads, linear=not diverging)
    warnings = tuple(f"WARNING: {text}" for text in sentences(held))
    steps = (*step_sentences(plans), *frozen_sentences(plans))
    notes = (*warnings, *commandless, *silent, *diverging, *conditions, *steps)
    return Preparation(problem, whole, held, plans, notes, no_joint, wired)


def _warning(kind: str, subject: str = "", **values: Any) -> str:
    """A warning, in the words of `seatrial.report.results.preparation`."""
    return f"WARNING: {sentence_of(Finding(kind, Severity.PROBLEM, subject, values), 'preparation')}"


def identifiable(problem: Problem) -> tuple[Problem, tuple[Held, ...]]:
    """The campaign without what no command explains and what feedback hides in all trials, and the latter.

    Raises CampaignError: nothing is left.
    """
    rest, held = hold_untold(without_commandless(problem)[0])
    if not rest.stages:
        raise CampaignError(f"{problem.source}: nothing is left to identify. {' '.join(sentences(held))}")
    return rest, held


def without_commandless(problem: Problem) -> tuple[Problem, tuple[str, ...]]:
    """The campaign without the coefficients of axes whose actuators no trial commands, and what that is.

    Such an axis is driven, and nothing says by what: a fit would take the unknown force for damping.

    Raises CampaignError: nothing is left.
    """
    driven = drivers(problem.vehicle)
    notes, dropped = [], set()
    for axis, names in driven.items():
        freeing = [stage for stage in problem.stages if axis in stage.axes.free]
        trials = dict.fromkeys(name for stage in freeing for name in stage.trials)
        if not trials or any(_records(problem, trial, names) for trial in trials):
            continue
        freed = dict.fromkeys(
            parameter.name for stage in freeing for parameter in problem.parameters[stage.name]
        )
        own = [name for name in freed if name.startswith(f"{axis}_")]
        if not own:
            continue
        dropped |= set(own)
        notes.append(_warning("axis without commands", axis, drivers=names, kept=own))
    rest = problem.without_coefficients(dropped)
    if not rest.stages:
        raise CampaignError(f"{problem.source}: nothing is left to identify. {' '.join(notes)}")
    return rest, tuple(notes)


def _records(problem: Problem, trial: str, names: Sequence[str]) -> bool:
    """Whether a trial knows what one of these actuators does, or the wrench of all."""
    kind, recording = problem.input_of(trial), problem.trials[trial]
    recorded = {"commands": recording.commands, "measured": recording.measured}.get(kind)
    return recorded is None or any(name in recorded for name in names)


def _wired(problem: Problem) -> tuple[Finding, ...]:
    """Actuators of the trials that are fitted whose signs or places contradict the vehicle."""
    names = dict.fromkeys(name for stage in problem.stages for name in stage.trials)
    driven = [name for name in names if problem.input_of(name) == "commands"]
    judged = {name: wiring(problem.trials[name], problem.vehicle) for name in driven}
    return tuple(verdict.finding(name) for name, verdict in judged.items() if verdict is not None)


def _actuators_without_column(problem: Problem) -> tuple[str, ...]:
    """Sentences on groups of actuators that a trial does not record: they stand still in it.

    Raises CampaignError: part of a group is recorded: the rest is missing from the column map.
    """
    unlogged: dict[str, list[str]] = {}
    groups = actuator_groups(problem.vehicle)
    for name in dict.fromkeys(name for stage in problem.stages for name in stage.trials):
        trial, kind = problem.trials[name], problem.input_of(name)
        recorded = {"commands": trial.commands, "measured": trial.measured}.get(kind)
        if not recorded:
            continue
        prefix = "cmd" if kind == "commands" else "meas"
        for group, members in groups.items():
            missing = [member for member in members if member not in recorded]
            columns = ", ".join(f"{prefix}.{member}" for member in missing)
            if missing and len(missing) < len(members):
                raise CampaignError(
                    f"{problem.source}: trial {name!r}: no column {columns}, but others of the group"
                    f" {group!r} are recorded; map it, or add a column of zeros if it stood still"
                )
            if missing:
                unlogged.setdefault(columns, []).append(name)
    return tuple(_warning("columns missing", columns, trials=names) for columns, names in unlogged.items())


def _conditioning(
    problem: Problem, threads: int | None, *, linear: bool
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Sentences on what the data cannot tell, and why there can be no joint estimate, if so.

    A vehicle that diverges has no sensitivities: without `linear` only refusals are looked for.
    """
    try:
        left_out = tuple(Joint(problem, threads=threads).sentences())
        findings = conditioning(problem, threads=threads) if linear else []
        return (*left_out, *(sentence_of(finding, "diagnosis") for finding in findings)), ()
    except (CampaignError, TrialError) as error:
        if problem.joint is not None:
            raise
        return (), (f"no standard deviations: the trials cannot be judged jointly ({error})",)


_SAME = 0.49  # of the longer interval: samples this close in time are the same


def repeated_sentences(problem: Problem) -> tuple[str, ...]:
    """Warnings of trials that are fitted to the same samples.

    Raises CampaignError: a trial holds out samples that another one is fitted to.
    """
    fitted, warnings = set(trained(problem)), list[str]()
    for names in _alike(problem):
        used = [name for name in names if name in fitted]
        for name in names:
            _refuse_fitted(problem, name, [other for other in used if other != name])
        twice = [pair for pair in combinations(used, 2) if _share(problem, *pair)]
        if same := [name for name in used if any(name in pair for pair in twice)]:
            warnings.append(_warning("recording repeated", trials=same))
    return tuple(warnings)


def _refuse_fitted(problem: Problem, name: str, fitted: list[str]) -> None:
    """Refuse a trial that holds out what one of those with its recording is fitted to."""
    for other in fitted:
        if _meet(_times(problem, name, held_out=True), _times(problem, other, held_out=False)):
            raise CampaignError(
                f"{problem.source}: trial {name!r} holds out what trial {other!r} is fitted to: both are"
                " of one recording, so that its score would judge nothing; give another one, or hold the same"
                " times out of both with hold_out_s"
            )


def _share(problem: Problem, first: str, other: str) -> bool:
    """Whether two trials with the same recording are fitted to the same times."""
    return _meet(_times(problem, first, held_out=False), _times(problem, other, held_out=False))


def _times(problem: Problem, name: str, *, held_out: bool) -> tuple[Array, float]:
    """Times (n,) in s from the recording's first on that are held out, or not; and their interval."""
    trial = problem.trials[name]
    return trial.t[problem.held_out(name) == held_out] - trial.t[0], trial.dt


def _meet(first: tuple[Array, float], other: tuple[Array, float]) -> bool:
    """Whether some time of one lies at a time of the other."""
    (a, step), (b, wide) = first, other
    if not len(a) or not len(b):
        return False
    after = np.searchsorted(b, a)
    near = [np.abs(b[np.clip(k, 0, len(b) - 1)] - a) for k in (after - 1, after)]
    return bool(np.min(near) < _SAME * max(step, wide))


def _alike(problem: Problem) -> list[list[str]]:
    """Names of the trials with the same recording, where there are several."""
    groups: list[tuple[set[str], list[str]]] = []
    for name in problem.trials:
        keys = {_content(problem.trials[name])} | ({key} if (key := problem.file_hash(name)) else set())
        same = [group for group in groups if group[0] & keys]
        groups = [group for group in groups if group not in same]
        groups.append((keys.union(*(own for own, _ in same)), [*(n for _, of in same for n in of), name]))
    return [names for _, names in groups if len(names) > 1]


def _content(trial: Trial) -> str:
    """SHA-256 of what was recorded, whatever the trial's name and first time."""
    signals = (
        trial.t - trial.t[0],
        trial.observed,
        *(trial.commands[name] for name in sorted(trial.commands)),
    )
    return sha256(b"".join(np.round(signal, 9).tobytes() for signal in signals))
