"""Which model is the result: stages or joint estimate, with what is presumed, and which damping.

Stages fit a few axes at a time, the joint estimate all at once: the better one where the model class holds.
Where it does not (waves, feedback, a missing term), one badly modelled axis bends coefficients that another
had right. Data outside the fit decide (`choose`), ten seconds ahead, by what the campaign holds out; with
innovations by predictions over the longest horizon up to half a second, for a replay of commands that answer
waves judges no model; where nothing is held out by the last fifth of every trial after fits without it.

Per channel e = SSE / SST = 1 - R2, pooled over trials, each judged on the axes that were freed on it. The
negative log-likelihood per sample is ``0.5 ln e``; a tenth of that where the mean predicts better (e > 1).
The joint estimate is the result unless its mean over the channels is higher by more than a margin, or a
channel that the stages predict loses much of R2 (`ChoiceSettings`).

By the same rule coefficients that only a prior bounds leave the joint estimate where it predicts worse with
them. Where a noise model is estimated along, quadratic damping stands against cross-flow drag by strips, by
the likelihood of held-out data: a slender hull that sideslips and turns at once is damped by neither velocity
alone. What both say differently of a coefficient is not identified (`seatrial.estimation.joint_estimate`).

Tests: ``tests/identification/test_choice.py``, ``tests/identification/test_damping.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from seatrial._core import Vehicle
from seatrial.base.arrays import Array
from seatrial.base.channels import VELOCITIES
from seatrial.base.errors import SeatrialError
from seatrial.base.finding import Finding, Severity
from seatrial.base.report import wording
from seatrial.base.work import Step
from seatrial.estimation.estimator import NoiseModel, Polished
from seatrial.estimation.innovations import Innovations
from seatrial.estimation.joint import Joint
from seatrial.estimation.joint_estimate import other_damping, polish
from seatrial.estimation.stage import StageResult, plan, refitted_stage
from seatrial.identification.hold_out import AHEAD_S, POOLED, part_scores
from seatrial.problem.problem import Problem
from seatrial.problem.settings import STRIPS

if TYPE_CHECKING:
    pass


@dataclass(frozen=True)
class ChoiceSettings:
    """From where on one model predicts better than another."""

    #: Share of every trial, at its end, that judges where the campaign holds nothing out.
    judging_share: float = 0.2
    #: Difference of the negative log-likelihood per sample that counts as none: 2 % of the error variance.
    even: float = 0.01
    #: Loss of R2 from which one channel decides alone, if its error grows as well.
    lost_r2: float = 0.05
    #: Growth of the error variance from which it does.
    more_error: float = 1.5
    #: Loss of R2 that heads the summary.
    spoilt_r2: float = 0.1
    #: SSE / SST that stands for a simulation that diverged.
    diverged: float = 1e6
    #: Weight of the logarithm of e where the mean predicts better.
    unpredicted_weight: float = 0.1
    #: Longest horizon that is compared, s: within a longer one the commands answer the waves.
    longest_s: float = 0.5
    #: Difference of R2 below which it means nothing.
    telling_r2: float = 0.02
    #: Log-likelihood of all held-out data from which the other damping is the result.
    likelier: float = 10.0
    #: Standard deviations of a difference over blocks of time that chance makes.
    chance_sd: float = 3.0
    #: Rounds after which strips are given up where they are far less likely.
    strip_rounds: int = 6
    #: How far: so many times what chance makes, or the log-likelihood above.
    far_times: float = 2.0
    #: Length over the larger of diameter and height from which strips are tried: a shorter hull has hardly a
    #: strip that the flow crosses as it crosses a long cylinder. The limit is a choice.
    slender: float = 3.0
    #: Cross-flow drag coefficient to begin with: a cylinder of finite length (White 2011, table 7.3).
    strip_drag: float = 0.8


CHOICE_SETTINGS = ChoiceSettings()


Evidence = Literal["held-out", "filter", "ends", "replay", "interrupted", "none"]
"""Data that judge: held out, the same ahead of a filter, ends of trials; or why there are none: a replay of
commands judges nothing, the estimate was interrupted, nothing is left."""


@dataclass(frozen=True)
class Choice:
    """Stages and joint estimate judged on data outside the fit."""

    #: "joint estimate" or "stages": whose coefficients the vehicle has.
    result: Literal["joint estimate", "stages"]
    #: Which data judged, or why none did.
    evidence: Evidence
    #: R2 so many seconds ahead per channel, pooled over the trials.
    stages: Mapping[str, float]
    joint: Mapping[str, float]
    #: Negative log-likelihood per sample and channel, joint estimate minus stages; negative where the joint
    #: estimate is better.
    likelihood: float
    #: How the joint estimate went, whether or not it is the result.
    polished: Polished
    #: How far ahead was predicted, s.
    ahead_s: float = AHEAD_S
    #: Where predictions of a filter were judged: R2 by channel of what knows no vehicle, the measured value
    #: held so long ("hold last") and a regression on the past of the log ("linear").
    rivals: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @property
    def chosen(self) -> Mapping[str, float]:
        """R2 per channel of the result."""
        return self.joint if self.result == "joint estimate" else self.stages

    @property
    def fallen(self) -> tuple[str, ...]:
        """Channels that the joint estimate predicts worse than the stages, by 0.02 of R2 or more."""
        return tuple(c for c in self.stages if self.stages[c] - self.joint[c] >= CHOICE_SETTINGS.telling_r2)

    @property
    def spoilt(self) -> tuple[str, ...]:
        """Those among them that lose a tenth of R2 or more."""
        return tuple(c for c in self.fallen if self.stages[c] - self.joint[c] >= CHOICE_SETTINGS.spoilt_r2)

    @property
    def judged_on(self) -> str:
        """Which data judged, in words."""
        return str(wording("estimates").judged_on(self.evidence, self.ahead_s))

    def sentence(self) -> str:
        """Which of the two is the result, why, and the figures of the other."""
        return str(wording("estimates").chosen(self))

    def to_dict(self) -> dict[str, Any]:
        """The choice as plain data; the joint estimate without its values."""
        kept = ("cost", "start_cost", "rounds", "converged", "interrupted")
        plain = {key: value for key, value in asdict(self).items() if key not in ("polished", "evidence")}
        return plain | {
            "judged_on": self.judged_on,
            "sentence": self.sentence(),
            "joint_estimate": {key: getattr(self.polished, key) for key in kept},
        }


def choose(
    problem: Problem,
    joint: Joint,
    polished: Polished,
    *,
    stages: tuple[StageResult, ...],
    begun: Joint | None = None,
    threads: int | None = None,
) -> Choice:
    """Choice between the stages, at which the joint estimate began, and the joint estimate.

    ``joint``: with the stages' vehicle. ``begun``: the one that starts at the stages' values, where another
    one was taken.
    """
    evidence, first, second, rivals = _outside(problem, joint, polished, begun)
    if joint.comparison.models_noise and not first:
        return Choice("joint estimate", "replay", {}, {}, 0.0, polished)
    if not first.keys() & second.keys():
        if polished.interrupted:
            return Choice("stages", "interrupted", {}, {}, 0.0, polished)
        evidence = "ends"
        first, second = _refitted(problem, stages, joint.named(polished.values), threads)
    judged = [channel for channel in first if channel in second]
    # Positions and angles barely move in ten seconds and score well with any model: velocities tell.
    judged = [channel for channel in judged if channel in VELOCITIES] or judged
    if not judged:
        return Choice("joint estimate", "none", {}, {}, 0.0, polished)
    likelihood, worse = _compared(first, second, judged)
    return Choice(
        "stages" if worse else "joint estimate",
        evidence,
        {c: 1.0 - first[c] for c in judged},
        {c: 1.0 - second[c] for c in judged},
        likelihood,
        polished,
        AHEAD_S if joint.comparison.simulates else _horizon(joint),
        {name: {c: 1.0 - row[c] for c in judged if c in row} for name, row in rivals.items()},
    )


def with_or_without_presumed(
    joint: Joint, polished: Polished, *, watch: Callable[[Step], None] | None = None
) -> tuple[Joint, Polished, tuple[str, ...], str]:
    """The joint estimate with or without coefficients of its own that have a prior (``sd``).

    Returns the joint estimate that predicts held-out data better, how it went, the names of what it leaves
    out, and a sentence on that; with them where nothing is held out.
    """
    # Only what a presumption adds: coefficients with a prior that no stage frees.
    names = tuple(joint.problem.presumed)
    if not names or polished.interrupted:
        return joint, polished, (), ""
    evidence, _, rich, _ = _outside(joint.problem, joint, polished)
    problem = joint.problem.without_coefficients(set(names))
    # The same estimate without them, from the same vehicle and by the same method.
    plain = joint.of_problem(problem)
    again = polish(plain, watch=watch) if rich else polished
    if not rich or again.interrupted:
        return joint, polished, (), ""
    _, _, poor, _ = _outside(problem, plain, again)
    judged = [channel for channel in poor if channel in rich]
    judged = [channel for channel in judged if channel in VELOCITIES] or judged
    _, worse = _compared(poor, rich, judged)
    if not worse or all(rich[channel] - poor[channel] < CHOICE_SETTINGS.telling_r2 for channel in judged):
        return joint, polished, (), ""
    r2 = {channel: (1.0 - poor[channel], 1.0 - rich[channel]) for channel in judged}
    return plain, again, names, wording("estimates").presumed(names, evidence, _horizon(joint), r2)


def _compared(
    first: Mapping[str, float], second: Mapping[str, float], judged: Sequence[str]
) -> tuple[float, bool]:
    """How much less likely the second's errors are per sample and channel, and whether it is worse."""
    nats = float(np.mean([_nats(second[c]) - _nats(first[c]) for c in judged])) if judged else 0.0
    spoilt = any(
        first[c] < 1.0
        and second[c] > max(CHOICE_SETTINGS.more_error * first[c], first[c] + CHOICE_SETTINGS.lost_r2)
        for c in judged
    )
    return nats, nats > CHOICE_SETTINGS.even or spoilt


def _outside(
    problem: Problem, joint: Joint, polished: Polished, begun: Joint | None = None
) -> tuple[Evidence, dict[str, float], dict[str, float], dict[str, dict[str, float]]]:
    """What judges; errors of stages, joint estimate and rivals on it."""
    if joint.comparison.simulates:
        start, end = joint.identified(joint.start), joint.identified(polished.values)
        return (
            "held-out",
            _errors(problem, start, None),
            _errors(problem, end, joint.records(polished.values)),
            {},
        )
    ahead_s = _horizon(joint)
    if not joint.steps(held_out=True)[0]:
        return "filter", {}, {}, {}
    ratios = []
    begun = joint if begun is None else begun
    for estimated, values in ((joint, polished.values), (begun, begun.start)):
        own = estimated.noise_model
        if values is begun.start:
            Innovations(estimated).prepare(values)
        sums = Innovations(estimated, held_out=True).sums(values, ahead_s)
        estimated.noise_model = own
        ratios.append({
            channel: min(row["filter"] / row["mean"], CHOICE_SETTINGS.diverged)
            for channel, row in sums.items()
        })
    rivals = {
        name: {c: row[name] / row["mean"] for c, row in sums.items() if math.isfinite(row[name])}
        for name in ("hold last", "linear")
    }
    return "filter", ratios[1], ratios[0], rivals


def _horizon(joint: Joint) -> float:
    """The horizon of the predictions from the state of a filter that are judged, s.

    The longest that is compared, up to `longest_s`: within a longer one the commands answer the waves, and
    gains that are bent by that predict better than the right ones.
    """
    compared = [ahead_s for ahead_s in joint.polish.horizons_s if ahead_s <= CHOICE_SETTINGS.longest_s]
    return max(joint.polish.horizon_s, joint.data.dt, *compared)


def _nats(error: float) -> float:
    """Negative log-likelihood per sample of an error variance over that about the mean."""
    size = math.log(max(error, 1e-12))
    return 0.5 * (size if size < 0.0 else CHOICE_SETTINGS.unpredicted_weight * size)


def _errors(
    problem: Problem, vehicle: Vehicle, nuisances: Mapping[str, Mapping[str, float]] | None
) -> dict[str, float]:
    """SSE / SST per channel ten seconds ahead on what is held out, pooled over trials."""
    scores = part_scores(
        problem, vehicle, nuisances=nuisances, parts=("hold_out",), kinds=("ahead",), baselines=False
    ).scores
    errors: dict[str, list[tuple[float, float]]] = {}
    for trial, judged in scores.get("hold_out", {}).get("ahead", {}).items():
        for channel, entry in judged.items() if trial != POOLED else ():
            if entry.n and math.isfinite(entry.r2):
                sse = entry.rmse**2 * entry.n
                errors.setdefault(channel, []).append((sse, sse / max(1.0 - entry.r2, 1e-12)))
            elif entry.n and not math.isnan(entry.r2):
                errors.setdefault(channel, []).append((CHOICE_SETTINGS.diverged, 1.0))
    pooled = {channel: np.sum(sums, axis=0) for channel, sums in errors.items()}
    return {
        c: float(min(sse / sst, CHOICE_SETTINGS.diverged)) for c, (sse, sst) in pooled.items() if sst > 0.0
    }


def _refitted(
    problem: Problem, stages: tuple[StageResult, ...], optimum: Mapping[str, float], threads: int | None
) -> tuple[dict[str, float], dict[str, float]]:
    """Errors of both on the last part of every trial after fits without it; empty where that cannot be.

    Both fits go on from the optimum on all data, which lies near their own, and take the steps of the global
    search, which move an estimate by too little to change a prediction.
    """
    try:
        shorter = _without_ends(problem)
        vehicle = shorter.vehicle
        optima = {stage.name: stage for stage in stages}
        for stage_plan in plan(shorter):
            if stage_plan.stage.name not in optima:  # it failed on all data
                continue
            coefficients = refitted_stage(
                shorter, stage_plan, optima[stage_plan.stage.name], vehicle=vehicle, threads=threads
            )
            vehicle = vehicle.with_coefficients(coefficients)
        joint = Joint(shorter, vehicle, threads=threads).at_search_step()
        polished = polish(joint, start=joint.started(optimum), near=True)
        return (
            _errors(shorter, joint.identified(joint.start), None),
            _errors(shorter, joint.identified(polished.values), joint.records(polished.values)),
        )
    except SeatrialError:  # a trial too short for segments without its end
        return {}, {}


def _without_ends(problem: Problem) -> Problem:
    """The problem with the last part of every trial held out."""
    uses = {}
    for name, trial in problem.trials.items():
        stop = float(trial.t[-1])
        start = stop - CHOICE_SETTINGS.judging_share * (stop - float(trial.t[0]))
        uses[name] = replace(problem.uses[name], hold_out_s=((start, stop + trial.dt),))
    return problem.with_uses(uses)


def quadratic_or_strips(
    joint: Joint, polished: Polished, *, watch: Callable[[Step], None] | None = None
) -> tuple[Joint, Polished, tuple[str, ...]]:
    """The joint estimate with quadratic damping, or with cross-flow drag by strips in place of it.

    Each plane whose quadratic damping is free in both axes (``Y_vv`` and ``N_rr``, ``Z_ww`` and ``M_qq``) is
    estimated again with one drag coefficient for all strips of the hull. It is the result where it makes
    held-out data, or all where nothing is held out, more likely by `likelier` and by more than chance:
    three standard deviations of the difference over blocks of time. Output error is left as it is: its
    residual analysis names strips that are missing.

    Returns the joint estimate that is likelier, how it went, and a sentence for each plane that was compared.
    """
    if not joint.comparison.models_noise or polished.interrupted or not slender(joint.vehicle):
        return joint, polished, ()
    notes: list[str] = []
    for name, made in STRIPS.items():
        free = {unknown.name for unknown in joint.unknowns} - joint.hidden
        upper = joint.vehicle.coefficient_info().get(name, {}).get("upper")
        if not {made[0], made[-1]} <= free or upper is None:
            continue
        replaced, drag = (made[0], made[-1]), CHOICE_SETTINGS.strip_drag
        other = joint.of_problem(
            joint.problem.with_strips(name, (0.0, float(upper)), drag),
            joint.vehicle.with_coefficients(dict.fromkeys(replaced, 0.0) | {name: drag}),
        )
        noises: list[NoiseModel | None] = [None] if joint.noise_model is None else [joint.noise_model, None]
        held_out = bool(joint.steps(held_out=True)[0])
        ended = other.started(joint.named(polished.values))
        # A few rounds tell whether strips are far less likely; only otherwise they go to their end.
        for rounds in (CHOICE_SETTINGS.strip_rounds, other.polish.rounds):
            again = _likeliest(other, noises, ended, min(rounds, other.polish.rounds), watch)
            if again.interrupted:
                return joint, replace(polished, interrupted=True), tuple(notes)
            ended, noises = again.values, [other.noise_model]
            quadratic, strips = (
                Innovations(model, held_out=held_out).likelihoods(end.values)
                for model, end in ((joint, polished), (other, again))
            )
            better, chance = likelier_by(quadratic, strips)
            least = max(CHOICE_SETTINGS.likelier, chance)
            if again.converged or better < -CHOICE_SETTINGS.far_times * least:
                break
        values = {
            "strips": name,
            "replaced": replaced,
            "better": better,
            "sd": chance / CHOICE_SETTINGS.chance_sd,
            "significant": abs(better) > least,
            "taken": better > least,
            "held_out": held_out,
        }
        notes.append(wording("estimates").damping(Finding("damping compared", Severity.NOTE, name, values)))
        if better > least:
            joint, polished = other, again
        elif abs(better) <= least:
            rival = other_damping(name, replaced, (joint, polished.values), (other, again.values))
            polished = replace(polished, others=(*polished.others, rival))
    return joint, polished, tuple(notes)


def slender(vehicle: Vehicle) -> bool:
    """Whether a hull is so long that strips of it see a cross-flow; a hull without measures may be."""
    measures = vehicle.geometry()
    return not measures or measures["length"] >= CHOICE_SETTINGS.slender * max(
        measures["diameter"], measures["height"]
    )


def _likeliest(
    joint: Joint,
    noises: Sequence[NoiseModel | None],
    start: Array,
    rounds: int,
    watch: Callable[[Step], None] | None,
) -> Polished:
    """The likeliest of the estimates that noise models lead to, which is left with its own."""
    best: tuple[float, Polished, NoiseModel | None] | None = None
    for noise in noises:
        joint.noise_model = noise
        candidate = polish(joint, start=start, rounds=rounds, watch=watch)
        if candidate.interrupted:
            return candidate
        likely = float(Innovations(joint).likelihoods(candidate.values).sum()) if len(noises) > 1 else 0.0
        likely = likely if math.isfinite(likely) else -math.inf
        if best is None or likely > best[0]:
            best = likely, candidate, joint.noise_model
    assert best is not None
    joint.noise_model = best[2]
    return best[1]


def likelier_by(before: Array, after: Array) -> tuple[float, float]:
    """By how much a log-likelihood (blocks,) by blocks of time grew, and how much chance makes of it.

    The latter is three standard deviations of the difference, nil where one of them is of a model that
    diverged.
    """
    if not np.isfinite(after).all():
        return -math.inf, 0.0
    if not np.isfinite(before).all():
        return math.inf, 0.0
    gain = after - before
    return float(gain.sum()), CHOICE_SETTINGS.chance_sd * float(gain.std() * math.sqrt(len(gain)))
