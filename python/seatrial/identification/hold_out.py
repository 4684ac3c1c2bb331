"""Scores of an identified vehicle on what it was fitted to and on what was held out.

The axes that any stage freed are simulated, the others replayed from the trial, so that a vehicle of which
only surge is known is judged on surge. A trial of a stage is judged on the axes that were freed on it: where
an axis was not excited, R2 compares the model with noise. Other trials, and all together, are judged on every
simulated axis.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES, CHANNELS, VELOCITIES
from seatrial.base.errors import TrialError
from seatrial.estimation.innovations import Innovations
from seatrial.estimation.joint import Joint
from seatrial.inspect.feedback import judged_s
from seatrial.inspect.verdict import blind
from seatrial.problem.problem import Problem
from seatrial.scoring.baseline_fit import fit_baselines
from seatrial.scoring.baselines import Baselines
from seatrial.scoring.score import Score, pooled, score
from seatrial.scoring.windows import Unpredictable
from seatrial.trial.trial import Trial

if TYPE_CHECKING:
    from seatrial._core import Vehicle

AHEAD_S = 10.0
"""How far ahead a result is judged, s, unless its vehicle runs away."""

POOLED = "all"
"""Name under which the scores of all trials together stand."""


@dataclass(frozen=True)
class PartScores:
    """Scores by part ("fit", "hold_out"), kind ("ahead", "free") and trial; and why a part has none."""

    scores: Mapping[str, Mapping[str, Mapping[str, Score]]]
    missing: tuple[str, ...]


@dataclass(frozen=True)
class Restarts:
    """Where the simulations of scores restart, how far they run, and what they cannot judge."""

    #: By name, with the states and the current that a filter knew (`Innovations.followed`); others restart
    #: from their smoothed log.
    trials: Mapping[str, Trial] = field(default_factory=dict)
    #: How far a simulation runs, s.
    ahead_s: float = AHEAD_S
    #: By trial what no model can predict; None: `Campaign.limits`.
    limits: Mapping[str, Unpredictable] | None = None

    @classmethod
    def of(cls, problem: Problem, joint: Joint, values: Array, vehicle: Vehicle) -> Restarts:
        """Restarts after a joint estimate: from its filter, if it has a noise model.

        Waves that no spectrum shows but the filter found leave the axes whose commands answer them without a
        score.

        ``values``: of the joint estimate's unknowns (m,). ``vehicle``: the result.
        """
        if joint.noise_model is None:
            return cls()
        begun, free = problem.vehicle, joint.stage.axes.free
        ahead_s = judged_s((begun, vehicle), joint.data.trials, free, AHEAD_S)
        limits = None
        if joint.noise_model.wave_hz is not None:
            limits = {
                name: replace(limit, blind=blind(problem.verdicts(name), waves=True))
                for name, limit in problem.limits().items()
            }
        return cls(Innovations(joint, held_out=None).followed(values, ahead_s), ahead_s, limits)

    @property
    def sentences(self) -> tuple[str, ...]:
        """Why the simulations are shorter than usual; none where they are not."""
        if self.ahead_s >= AHEAD_S:
            return ()
        return (
            f"predictions are judged {self.ahead_s:g} s ahead: with fixed controls, deviations from straight,"
            " level motion grow tenfold in that time, and later a simulation shows only the error of its"
            " initial state",
        )


def part_scores(
    problem: Problem,
    vehicle: Vehicle,
    *,
    nuisances: Mapping[str, Mapping[str, float]] | None = None,
    restarts: Restarts | None = None,
    parts: Sequence[str] = ("fit", "hold_out"),
    kinds: Sequence[str] = ("ahead", "free"),
    baselines: bool = True,
) -> PartScores:
    """Scores on the fitted and the held-out part of every trial, some seconds ahead and for a free run.

    ``nuisances``: nuisance parameters of the trials' records by trial and name, SI (`Assessment.records`).
    ``restarts``: by default every ten seconds from the smoothed log. ``parts``, ``kinds``: those that are
    wanted. ``baselines``: whether the baselines are fitted to the training part and judged on the same
    windows.
    """
    fitted = list(dict.fromkeys(name for stage in problem.stages for name in stage.trials))
    missing: list[str] = []
    scores: dict[str, dict[str, dict[str, Score]]] = {}
    training = _part(problem, fitted, "fit") if "fit" in parts or baselines else {}
    restarts = restarts or Restarts()
    ahead_s = restarts.ahead_s
    simple = _baselines(problem, training, ahead_s) if baselines else None
    limits = problem.limits() if restarts.limits is None else restarts.limits
    for part in parts:
        trials = training if part == "fit" else _part(problem, list(problem.trials), part)
        trials = {
            name: trial if known is None else replace(known, valid=trial.valid)
            for name, trial in trials.items()
            for known in (restarts.trials.get(name),)
        }
        if trials:
            scores[part] = {
                kind: _scores(
                    problem, vehicle, trials, ahead_s, kind == "free", nuisances, missing, simple, limits
                )
                for kind in kinds
            }
    return PartScores(scores, tuple(dict.fromkeys(missing)))


def likelihood_gain(scores: Mapping[str, Mapping[str, Mapping[str, Score]]]) -> dict[str, tuple[str, float]]:
    """Best baseline by velocity channel, and how much likelier than by it the model makes a sample.

    The log-likelihood per sample is Gaussian with the error variance s^2 of the training part of the same
    trial, ``-ln s - MSE / (2 s^2)``: a model that is much surer of itself than it proves to be loses by it.
    An error variance that is lower by 10 % in both parts is worth 0.05. Trials that are held out as a
    whole have no such variance and do not count.

    ``scores``: as of `PartScores`, with baselines.
    """
    trained, judged = (scores.get(part, {}).get("ahead", {}) for part in ("fit", "hold_out"))
    both = [(trained[name], judged[name]) for name in judged if name in trained and name != POOLED]
    gains = {}
    for channel in VELOCITIES:
        pairs = [(b, a) for b, a in both if channel in b.evidence and channel in a.evidence]
        if not pairs:
            continue
        model = _total(channel, [(b, a, b.evidence, a.evidence) for b, a in pairs])
        rivals = {
            name: _total(channel, [(b, a, b.baselines[name], a.baselines[name]) for b, a in pairs])
            for name in pairs[0][0].baselines
            if all(channel in scored.baselines.get(name, {}) for pair in pairs for scored in pair)
        }
        best = max(rivals, key=rivals.__getitem__, default=None)
        if best is not None and math.isfinite(model) and math.isfinite(rivals[best]):
            samples = sum(after.channels[channel].n for _, after in pairs)
            gains[channel] = (best, (model - rivals[best]) / samples)
    return gains


def _total(
    channel: str, parts: Sequence[tuple[Score, Score, Mapping[str, float], Mapping[str, float]]]
) -> float:
    """Log-likelihood over trials of what has these R2 on the training part and on what is held out."""
    return sum(
        after.channels[channel].n * _log_likelihood(before, after, channel, first[channel], second[channel])
        for before, after, first, second in parts
    )


def _log_likelihood(trained: Score, judged: Score, channel: str, r2_trained: float, r2: float) -> float:
    """Log-likelihood per sample of errors with these R2, up to a constant; the scores give the variances."""
    errors = []
    for part, value in ((trained, r2_trained), (judged, r2)):
        entry = part.channels[channel]
        if not (math.isfinite(entry.r2) and math.isfinite(value) and entry.r2 < 1.0 and value < 1.0):
            return -math.inf
        errors.append(entry.rmse**2 * (1.0 - value) / (1.0 - entry.r2))
    return -0.5 * (math.log(errors[0]) + errors[1] / errors[0])


def left_out_score(
    problem: Problem,
    rest: Problem,
    vehicle: Vehicle,
    name: str,
    *,
    nuisances: Mapping[str, Mapping[str, float]],
) -> Score:
    """Score ten seconds ahead of a trial that a fit left out, beside baselines that did not see it either.

    ``problem``: with the trial: it says on which axes the trial is judged. ``rest``: without it: what vehicle
    and baselines learnt from. ``name``: of the trial. ``nuisances``: of the other trials' records; those that
    all of them share hold here, too. Raises TrialError: nothing of it can be scored.
    """
    fitted = list(dict.fromkeys(trial for stage in rest.stages for trial in stage.trials))
    shared = (
        set.intersection(*({*shift.items()} for shift in nuisances.values())) if len(nuisances) > 1 else ()
    )
    axes = freed(problem, name) or freed(problem)
    trial = problem.trials[name]
    return score(
        vehicle,
        trial,
        channels=[c for i, c in enumerate(CHANNELS) if AXES[i % 6] in axes and c in trial.channels],
        input=problem.input_of(name),
        free=freed(problem),
        measured=replayed(problem),
        nuisances={name: dict(shared)},
        training=_baselines(problem, _part(rest, fitted, "fit")),
        limits=problem.limits(),
    )


def _part(problem: Problem, names: Sequence[str], part: str) -> dict[str, Trial]:
    """Trials of which some samples belong to a part ("fit", "hold_out"), the others masked."""
    parts = {name: problem.part(name, held_out=part != "fit") for name in names}
    return {name: trial for name, trial in parts.items() if trial is not None}


def _baselines(problem: Problem, training: Mapping[str, Trial], ahead_s: float = AHEAD_S) -> Baselines:
    """Baselines of the training part; forces are those of the vehicle before its identification."""
    inputs = {problem.input_of(name) for name in training}
    return fit_baselines(
        list(training.values()),
        vehicle=problem.vehicle,
        input=inputs.pop() if len(inputs) == 1 else None,
        free=freed(problem),
        measured=replayed(problem),
        ahead_s=ahead_s,
    )


def _scores(
    problem: Problem,
    vehicle: Vehicle,
    trials: Mapping[str, Trial],
    ahead_s: float,
    free_run: bool,
    nuisances: Mapping[str, Mapping[str, float]] | None,
    missing: list[str],
    simple: Baselines | None,
    limits: Mapping[str, Unpredictable],
) -> dict[str, Score]:
    free, measured = freed(problem), replayed(problem)

    def judged(names: Iterable[str], axes: str) -> list[str]:
        own = [channel for i, channel in enumerate(CHANNELS) if AXES[i % 6] in axes]
        return [c for c in own if any(c in trials[name].channels for name in names)]

    # A trial that cannot be scored is named and costs the others nothing.
    scores: dict[str, Score] = {}
    for name, trial in trials.items():
        try:
            scores[name] = score(
                vehicle,
                trial,
                ahead_s=ahead_s,
                channels=judged([name], freed(problem, name) or free),
                free_run=free_run,
                input=problem.input_of(name),
                free=free,
                measured=measured,
                nuisances=nuisances,
                training=simple,
                limits=limits,
            )
        except TrialError as error:
            missing.append(f"not scored: {error}")
    # Errors are pooled only over trials that are driven alike.
    if len(scores) < 2 or len({problem.input_of(name) for name in scores}) > 1:
        return scores
    everything = pooled(
        list(scores.values()),
        channels=judged(scores, free),
        measured=measured,
        training=simple,
        limits=limits,
    )
    return scores | {POOLED: everything}


def replayed(problem: Problem) -> str:
    """Letters of the axes that no stage freed: every score replays them from the recording."""
    free = freed(problem)
    return "".join(axis for axis in AXES if axis not in free)


def freed(problem: Problem, trial: str | None = None) -> str:
    """Letters of the axes that some stage freed, on this trial or on any."""
    stages = [stage for stage in problem.stages if trial is None or trial in stage.trials]
    return "".join(axis for axis in AXES if any(axis in stage.axes.free for stage in stages))
