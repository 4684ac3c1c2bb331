"""What an identification refuses, warns of or holds before its first search, as a check of a campaign asks.

Recordings that stand in a campaign under several names are no independent data: two trials hold the same
recording if their files have the same content, or if the same samples were read from them. Parts that share
no time are independent all the same.

Where an autopilot answers waves, a fit finds the controller's inverse (`seatrial.inspect.verdict`). What only
such an axis could tell is not estimated: gains of its actuators, its damping, lift and added mass. One trial
that tells the axis frees them again. Coefficients that are tied to one that is told follow it.

A frozen axis keeps the velocity that it has at the start of a segment (V_const = 0: Taubert et al. 2014,
equation 6). Where the vehicle changes it within the segment, the damping, lift and inflow that it causes are
wrong, and a frozen rate turns the attitude away, weight and buoyancy with it. The stage's coefficients absorb
the difference, so that such an axis is named (`test_frozen_axis_that_moves_is_named`).

Tests: ``tests/check/test_check_campaign.py``, ``tests/identification/test_held.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES, CHANNELS, DEGREE
from seatrial.base.errors import CampaignError, TrialError
from seatrial.base.finding import Finding, Severity
from seatrial.base.report import sentence_of, words_of
from seatrial.base.run import sha256
from seatrial.diagnosis.assessment import conditioning
from seatrial.estimation.joint import Joint
from seatrial.estimation.scale import ScaleReport, judge_scale
from seatrial.estimation.stage import StagePlan, plan, start_cost
from seatrial.inspect.verdict import best, untold
from seatrial.inspect.wiring import wiring
from seatrial.problem.parameter import parameters
from seatrial.vehicle.actuators import actuator_groups, drivers

if TYPE_CHECKING:
    from seatrial.problem.problem import Problem


@dataclass(frozen=True)
class PreparationSettings:
    """What is said of estimates before and after they rest on what is held or frozen."""

    #: Error of a held value whose effect is told, over the value.
    error_share: float = 0.2
    #: Information over the widths of the bounds, over its largest, below which nothing is told.
    rank: float = 1e-10
    #: Share of the largest speed of all trials by which a frozen velocity may move without a word.
    frozen_share: float = 0.1
    #: Angle by which a frozen rate may turn the attitude away without a word, rad.
    frozen_angle: float = 3.0 * DEGREE
    #: Share of the longer interval within which two samples are the same.
    same_time: float = 0.49


HELD_SETTINGS = PreparationSettings()


@dataclass(frozen=True)
class Held:
    """A coefficient that was to be identified and keeps the value of the vehicle file."""

    #: Of the coefficient, SI.
    name: str
    value: float
    unit: str
    #: Its name in the campaign: the coefficient's own, or that of its group.
    parameter: str
    #: Letter of the axis that alone could tell it.
    axis: str
    #: The verdict on that axis, with its evidence.
    why: str
    #: Which trial tells it.
    trial: str


@dataclass(frozen=True)
class Preparation:
    """What an identification runs, and what is known before."""

    #: What is asked without what is held, and with it.
    problem: Problem
    whole: Problem
    held: tuple[Held, ...]
    #: Stages of ``problem``.
    plans: tuple[StagePlan, ...]
    #: What contradicts the vehicle file and what the data cannot tell.
    sentences: tuple[str, ...]
    #: Why there can be no joint estimate.
    no_joint: tuple[str, ...]
    #: What contradicts the vehicle file.
    findings: tuple[Finding, ...]
    #: What the scale of all forces rests on before the search.
    scale: ScaleReport


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
    # What the recordings contradict or lack.
    silent = (*_repeated(problem), *_actuators_without_column(problem))
    driven = [name for name in problem.fitted if problem.input_of(name) == "commands"]
    judged = {name: wiring(problem.trials[name], problem.vehicle) for name in driven}
    wired = tuple(verdict.finding(name) for name, verdict in judged.items() if verdict is not None)
    contradictions = tuple(f"WARNING: {words_of(finding)}" for finding in wired)
    # What is left to identify, in stages that are planned as they will run.
    whole, commandless = without_commandless(problem)
    rest, held = identifiable(whole)
    plans = plan(rest)
    scale = judge_scale(rest)
    diverging = tuple(
        _warning("start diverges", stage.stage.name)
        for stage in plans
        if not stage.stage.after and not math.isfinite(start_cost(rest, stage, threads=threads))
    )
    # What the data cannot tell of it; a vehicle that diverges has no sensitivities.
    conditions, no_joint = _conditioning(rest, threads, linear=not diverging)
    steps = ((stage.stage.name, stage.step.sentence(stage.data.dt)) for stage in plans)
    notes = (
        *(f"WARNING: {text}" for text in sentences(held)),
        *(*commandless, *contradictions, *silent, *diverging, *conditions),
        *(f"stage {name!r}: {sentence}" for name, sentence in steps if sentence),
        *frozen_sentences(plans),
    )
    return Preparation(rest, whole, held, plans, notes, no_joint, wired, scale)


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
    notes, dropped = [], set[str]()
    recorded = {name: _recorded(problem, name) for name in problem.fitted}
    for axis, actuators in drivers(problem.vehicle).items():
        freeing = [stage for stage in problem.stages if axis in stage.axes.free]
        inputs = [recorded[name] for stage in freeing for name in stage.trials]
        # A wrench that was logged explains every axis.
        if not inputs or any(known is None or not known.isdisjoint(actuators) for known in inputs):
            continue
        names = dict.fromkeys(p.name for stage in freeing for p in problem.parameters[stage.name])
        if own := [name for name in names if name.startswith(f"{axis}_")]:
            dropped |= set(own)
            notes.append(_warning("axis without commands", axis, drivers=actuators, kept=own))
    rest = problem.without_coefficients(dropped)
    if not rest.stages:
        raise CampaignError(f"{problem.source}: nothing is left to identify. {' '.join(notes)}")
    return rest, tuple(notes)


def _recorded(problem: Problem, name: str) -> frozenset[str] | None:
    """Actuators of which a trial knows what they do; None for the wrench of all."""
    kind, trial = problem.input_of(name), problem.trials[name]
    signals = {"commands": trial.commands, "measured": trial.measured}.get(kind)
    return None if signals is None else frozenset(signals)


def _actuators_without_column(problem: Problem) -> tuple[str, ...]:
    """Warnings of groups of actuators that a trial does not record: they stand still in it.

    Raises CampaignError: part of a group is recorded: the rest is missing from the column map.
    """
    unlogged: dict[str, list[str]] = {}
    groups = actuator_groups(problem.vehicle)
    for name in problem.fitted:
        recorded = _recorded(problem, name)
        if not recorded:
            continue
        prefix = "cmd" if problem.input_of(name) == "commands" else "meas"
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

    Without `linear` only refusals are looked for.
    """
    try:
        left_out = tuple(Joint(problem, threads=threads).sentences())
        findings = conditioning(problem, threads=threads) if linear else []
        return (*left_out, *(sentence_of(finding, "diagnosis") for finding in findings)), ()
    except (CampaignError, TrialError) as error:
        if problem.joint is not None:
            raise
        return (), (f"no standard deviations: the trials cannot be judged jointly ({error})",)


def _repeated(problem: Problem) -> tuple[str, ...]:
    """Warnings of trials that are fitted to the same samples.

    Raises CampaignError: a trial holds out samples that another one is fitted to.
    """
    used, warnings = problem.trained, list[str]()
    for names in _alike(problem):
        # Times from the recording's first on, s, that are fitted and that are held out, and their interval.
        trials = {name: problem.trials[name] for name in names}
        masks = {name: problem.held_out(name) for name in names}
        away = {name: trial.t - trial.t[0] for name, trial in trials.items()}
        fitted = {name: (away[name][~masks[name]], trials[name].dt) for name in names}
        fitting = [name for name in names if name in used]
        for name in names:
            unseen = away[name][masks[name]], trials[name].dt
            for other in fitting:
                if other != name and _meet(unseen, fitted[other]):
                    raise CampaignError(
                        f"{problem.source}: trial {name!r} holds out what trial {other!r} is fitted to: both"
                        " are of one recording, so that its score would judge nothing; give another one, or"
                        " hold the same times out of both with hold_out_s"
                    )
        twice = [pair for pair in combinations(fitting, 2) if _meet(fitted[pair[0]], fitted[pair[1]])]
        if same := [name for name in fitting if any(name in pair for pair in twice)]:
            warnings.append(_warning("recording repeated", trials=same))
    return tuple(warnings)


def _meet(first: tuple[Array, float], other: tuple[Array, float]) -> bool:
    """Whether a time of the one lies at a time of the other; each with its interval, s."""
    (a, step), (b, wide) = first, other
    if not len(a) or not len(b):
        return False
    after = np.searchsorted(b, a)
    near = [np.abs(b[np.clip(k, 0, len(b) - 1)] - a) for k in (after - 1, after)]
    return bool(np.min(near) < HELD_SETTINGS.same_time * max(step, wide))


def _alike(problem: Problem) -> list[list[str]]:
    """Names of the trials with the same recording, where there are several."""
    groups: list[tuple[set[str], list[str]]] = []
    for name, trial in problem.trials.items():
        # What was recorded, whatever the trial's name and first time, and its file.
        commands = (trial.commands[actuator] for actuator in sorted(trial.commands))
        signals = (trial.t - trial.t[0], trial.observed, *commands)
        content = sha256(b"".join(np.round(signal, 9).tobytes() for signal in signals))
        keys: set[str] = {content, problem.file_hash(name) or content}
        same = [group for group in groups if group[0] & keys]
        groups = [group for group in groups if group not in same]
        groups.append((keys.union(*(own for own, _ in same)), [*(n for _, of in same for n in of), name]))
    return [names for _, names in groups if len(names) > 1]


def hold_untold(problem: Problem) -> tuple[Problem, tuple[Held, ...]]:
    """The campaign without what feedback hides in all trials that it fits, and what that is.

    Trials whose forces are measured have no commands and tell every axis.
    """
    names = dict.fromkeys((*problem.fitted, *(() if problem.joint is None else problem.joint.trials)))
    if any(problem.input_of(name) != "commands" for name in names):
        return problem, ()
    verdicts = best(problem.verdicts(name) for name in names)
    if not any(verdict.dominated for verdict in verdicts.values()):
        return problem, ()
    freed = {parameter.name: parameter for own in problem.parameters.values() for parameter in own}
    vehicle = problem.vehicle
    if problem.joint is not None:
        jointly = parameters(problem.joint_stage(), vehicle, f"{problem.source}: polish")
        freed |= {parameter.name: parameter for parameter in jointly}
    members = dict.fromkeys(member for parameter in freed.values() for member, _ in parameter.members)
    axis_of = {name: axis for axis, own in untold(members, verdicts, vehicle).items() for name in own}
    values, info = vehicle.coefficients(), vehicle.coefficient_info()
    # A parameter is held where no trial tells any of the coefficients that it sets.
    rows = []
    for parameter in freed.values():
        own = [name for name, _ in parameter.members]
        if all(name in axis_of for name in own):
            for name, verdict in ((name, verdicts[axis_of[name]]) for name in own):
                value, unit = values.get(name, 0.0), info[name]["unit"]
                rows.append(Held(name, value, unit, parameter.name, verdict.axis, verdict.why, verdict.trial))
    return problem.without_coefficients({row.parameter for row in rows}), tuple(rows)


def sentences(held: Sequence[Held]) -> tuple[str, ...]:
    """Per axis: why it is dominated, what keeps its value, what that means for the rest, what would tell."""
    texts = []
    for axis in dict.fromkeys(row.axis for row in held):
        own = [row for row in held if row.axis == axis]
        kept = ", ".join(dict.fromkeys(row.parameter for row in own))
        texts.append(
            f"{own[0].why}. Not identified, kept at the vehicle file's values: {kept}. Other estimates on"
            f" this axis may depend on these; {own[0].trial}"
        )
    return tuple(texts)


def frozen_motion(stage: StagePlan) -> dict[str, float]:
    """Motion that a stage's frozen axes miss, by letter: rms over its segments.

    Of a velocity its change since the start of the segment, m/s; of a rate the integral of that, rad. Axes
    whose velocity is not recorded are left out.
    """
    axes, trials = stage.stage.axes, stage.data.trials
    squares, samples = np.zeros(6), 0
    for piece in stage.data.segments:
        trial = trials[piece.record]
        away = trial.smooth_nu(trial.t[piece.start : piece.stop])[0] - np.asarray(piece.nu)
        away[:, 3:] = np.cumsum(away[:, 3:], axis=0) * trial.dt
        squares += np.nansum(away**2, axis=0)
        samples += len(away)
    return {
        axis: float(np.sqrt(squares[k] / samples))
        for k, axis in enumerate(AXES)
        if axis not in axes.free + axes.measured and all(CHANNELS[k] in trial.channels for trial in trials)
    }


def frozen_sentences(plans: Sequence[StagePlan]) -> Iterator[str]:
    """A sentence per stage whose frozen axes move noticeably in its recordings."""
    largest = max((float(stage.data.largest_speeds()[:3].max()) for stage in plans), default=0.0)
    for stage in plans:
        if named := _moving(frozen_motion(stage), largest):
            yield (
                f"stage {stage.stage.name!r} freezes axes that move within its segments: {', '.join(named)};"
                " its coefficients absorb that. Replay them (measured) or shorten segment_s"
            )


def _moving(motion: Mapping[str, float], largest: float) -> list[str]:
    """Frozen axes that move more than a tenth of the largest speed, m/s, or turn by 3 degrees, in words."""
    named = []
    for axis, moved in motion.items():
        if axis in "XYZ" and moved > HELD_SETTINGS.frozen_share * largest:
            named.append(f"{axis} ({CHANNELS[AXES.index(axis)]} changes by {moved:.2g} m/s)")
        elif axis in "KMN" and moved > HELD_SETTINGS.frozen_angle:
            named.append(f"{axis} (the attitude is turned by {moved / DEGREE:.2g} deg)")
    return named
