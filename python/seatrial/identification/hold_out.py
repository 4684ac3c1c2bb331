"""Scores of an identified vehicle on what it was fitted to and on what was held out, and what it leaves.

The axes that any stage freed are simulated, the others replayed from the trial, so that a vehicle of which
only surge is known is judged on surge. A trial of a stage is judged on the axes that were freed on it: where
an axis was not excited, R2 compares the model with noise. Other trials, and all together, are judged on every
simulated axis.

The noise of a navigation filter (`residual_noise`) is what the model leaves unexplained: from every fitted
sample it takes one step. What it misses of the smoothed velocities, over the step, is a residual acceleration
a(t), and F = M a the force that it lacks. Two processes stand for it (Farrell 2008, section 4.6): a
Gauss-Markov force with the memory that the residual shows between one and three seconds, and for what is left
white acceleration with the same area under its autocovariance. The mean is kept: a constant force that the
model misses is part of the force. Residuals of held-out samples are not looked at. What smoothing takes out
of the residual is missing: the force comes out some 10 % low (``docs/validation.md``, "Navigation filter").

Tests: ``tests/scoring/test_noise_limit.py``, ``tests/identification/test_noise_of_filter.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import AXES, CHANNELS, VELOCITIES
from seatrial.base.errors import NumericalError, TrialError
from seatrial.estimation.innovations import Innovations
from seatrial.estimation.joint import Joint
from seatrial.estimation.segment_model import STEP_SETTINGS, stage_step
from seatrial.inspect.feedback import judged_s
from seatrial.inspect.verdict import blind
from seatrial.problem.problem import Problem
from seatrial.scoring.baseline_fit import fit_baselines
from seatrial.scoring.baselines import Baselines
from seatrial.scoring.record import Record, Replay, Segment
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
    missing: list[str] = []
    scores: dict[str, dict[str, dict[str, Score]]] = {}
    training = problem.parts(problem.fitted, held_out=False) if "fit" in parts or baselines else {}
    restarts = restarts or Restarts()
    options: dict[str, Any] = {
        "ahead_s": restarts.ahead_s,
        "nuisances": nuisances,
        "training": _baselines(problem, training, restarts.ahead_s) if baselines else None,
        "limits": problem.limits() if restarts.limits is None else restarts.limits,
    }
    for part in parts:
        trials = training if part == "fit" else problem.parts(problem.trials, held_out=True)
        for name in restarts.trials.keys() & trials.keys():
            trials[name] = replace(restarts.trials[name], valid=trials[name].valid)
        if trials:
            scores[part] = {
                kind: _scores(problem, vehicle, trials, missing, free_run=kind == "free", **options)
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
    problem: Problem, rest: Problem, vehicle: Vehicle, name: str, nuisances: Mapping[str, Mapping[str, float]]
) -> Score:
    """Score ten seconds ahead of a trial that a fit left out, beside baselines that did not see it either.

    ``problem``: with the trial: it says on which axes the trial is judged. ``rest``: without it: what vehicle
    and baselines learnt from. ``nuisances``: of the other trials' records; those that all of them share hold
    here, too. Raises TrialError: nothing of it can be scored.
    """
    shared = (
        set.intersection(*({*shift.items()} for shift in nuisances.values())) if len(nuisances) > 1 else ()
    )
    trial = problem.trials[name]
    return score(
        vehicle,
        trial,
        channels=_channels(problem.judged[name], [trial]),
        input=problem.input_of(name),
        free=problem.freed,
        measured=problem.replayed,
        nuisances={name: dict(shared)},
        training=_baselines(problem, rest.parts(rest.fitted, held_out=False)),
        limits=problem.limits(),
    )


def _baselines(problem: Problem, training: Mapping[str, Trial], ahead_s: float = AHEAD_S) -> Baselines:
    """Baselines of the training part; forces are those of the vehicle before its identification."""
    inputs = {problem.input_of(name) for name in training}
    return fit_baselines(
        list(training.values()),
        vehicle=problem.vehicle,
        input=inputs.pop() if len(inputs) == 1 else None,
        free=problem.freed,
        measured=problem.replayed,
        ahead_s=ahead_s,
    )


def _scores(
    problem: Problem, vehicle: Vehicle, trials: Mapping[str, Trial], missing: list[str], **options: Any
) -> dict[str, Score]:
    """Scores of trials by name, and of all together; those that cannot be scored are named in ``missing``."""
    free, measured, judged = problem.freed, problem.replayed, problem.judged
    scores: dict[str, Score] = {}
    for name, trial in trials.items():
        channels = _channels(judged[name], [trial])
        own: dict[str, Any] = {
            "channels": channels,
            "input": problem.input_of(name),
            "free": free,
            "measured": measured,
        }
        try:
            scores[name] = score(vehicle, trial, **own, **options)
        except TrialError as error:
            missing.append(f"not scored: {error}")
    # Errors are pooled only over trials that are driven alike.
    if len(scores) < 2 or len({problem.input_of(name) for name in scores}) > 1:
        return scores
    everything = pooled(
        list(scores.values()),
        channels=_channels(free, [trials[name] for name in scores]),
        measured=measured,
        training=options["training"],
        limits=options["limits"],
    )
    return scores | {POOLED: everything}


def _channels(axes: str, trials: Sequence[Trial]) -> list[str]:
    """Channels of some axes that any of the trials has."""
    own = [channel for i, channel in enumerate(CHANNELS) if AXES[i % 6] in axes]
    return [channel for channel in own if any(channel in trial.channels for trial in trials)]


@dataclass(frozen=True)
class FilterNoiseSettings:
    """How the noise of a navigation filter is read from what one step of the model misses."""

    #: Shorter lag between which the memory of the force is read, s: beyond what the smoothing of velocities
    #: joins.
    near_s: float = 1.0
    #: Longer lag, s.
    far_s: float = 3.0
    #: Longest step of the simulation, s, where no rate of the vehicle asks for a shorter one.
    substep_s: float = 0.05
    #: Substeps of a sample at most: poles up to 2,500 1/s at 10 Hz.
    most_substeps: int = 1000
    #: Distance from the log after one step, over the reach of the log's velocities, that tells nothing: the
    #: model diverges there, and the square of what it misses may be no number.
    diverged_reach: float = 1e3
    #: Shortest and longest time constant that is told, s: no memory, and a constant force.
    memory_s: tuple[float, float] = (0.5, 300.0)
    #: Least white noise, m/s and rad/s after a second.
    least_white: float = 5e-4
    #: Default of a filter for the force of a velocity that no trial measures
    #: (``docs/theory/navigation_filter.md``).
    default_force: float = 0.03
    #: Its default for the white acceleration.
    default_white: float = 0.005


SETTINGS = FilterNoiseSettings()


_LEAST = np.array([0.005, 0.005, 0.005, 0.004, 0.001, 0.001])
"""Least deviation of the force over the diagonal of the mass matrix, m/s^2 and rad/s^2: of an exact model."""


class FilterNoise(TypedDict):
    """Keywords of `seatrial.NavigationFilter`: force (6,), its time constant, white acceleration (6,); SI."""

    force: Array
    force_time_s: float
    acceleration: Array


def with_model_error(vehicle: Vehicle, problem: Problem) -> Vehicle:
    """The identified vehicle with ``[model_error]`` in its file: `filter_noise` of its campaign.

    Without the table where no trial has enough fitted samples.
    """
    try:
        return vehicle.with_model_error(**residual_noise(vehicle, fitted_records(problem)))
    except TrialError:
        return vehicle.without_model_error()


def fitted_records(problem: Problem) -> list[Record]:
    """Trials of a campaign, of which the fitted samples count."""
    records = []
    for name in problem.trials:
        trial = problem.trials[name]
        fitted = ~problem.held_out(name)[: len(trial.t)] & trial.startable
        records.append(Record(trial, problem.input_of(name), trial.valid & fitted[:, None]))
    return records


def residual_noise(vehicle: Vehicle, records: Iterable[Record]) -> FilterNoise:
    """The same of a vehicle on records, of which the samples of a velocity count where it does.

    Raises TrialError: no record has three seconds of samples that count without a gap. Raises NumericalError:
    the vehicle diverges over one sample of so many that none of three seconds is left.
    """
    mass = np.asarray(vehicle.mass_matrix())
    lags = ("none", "sample", "near", "far")
    sums = {lag: np.zeros((3, 6)) for lag in lags}  # products of accelerations, of forces, and their number
    steps = []
    lost = 0
    for record in records:
        dt = record.trial.dt
        steps.append(dt)
        acceleration, known, diverged = _residual(vehicle, record)
        lost += diverged
        force = acceleration @ mass.T
        counts = (0, 1, round(SETTINGS.near_s / dt), round(SETTINGS.far_s / dt))
        for lag, count in zip(lags, counts, strict=True):
            both: Mask = np.asarray(known[: len(known) - count] & known[count:])
            products = [_products(series, count, both) for series in (acceleration, force)]
            sums[lag] = sums[lag] + [*products, both.sum(axis=0)]
    covered: Mask = np.asarray(sums["far"][2] >= 2)
    if not covered.any() and lost:
        raise NumericalError(f"the vehicle diverges over one sample at {lost} samples of the log")
    if not covered.any():
        raise TrialError(
            f"filter noise: expected a trial with {SETTINGS.far_s:g} s of fitted samples without a gap, found"
            " none; hold out less, or give NavigationFilter its force and acceleration"
        )
    moved, forced = (
        {lag: np.where(covered, row[k] / np.maximum(row[2], 1), 0.0) for lag, row in sums.items()}
        for k in (0, 1)
    )
    dt = float(np.mean(steps))
    time_s = _memory(moved)
    slow = np.clip(forced["near"] * math.exp(SETTINGS.near_s / time_s), 0.0, forced["none"])
    share = np.divide(slow, forced["none"], out=np.zeros(6), where=forced["none"] > 0.0)
    # What the slow force leaves of the acceleration, and for how long it remembers itself.
    fast = moved["none"] * (1.0 - share)
    after = moved["sample"] - moved["none"] * share * math.exp(-dt / time_s)
    kept = np.clip(np.divide(after, fast, out=np.zeros(6), where=fast > 0.0), 0.1, 0.9)
    white = np.sqrt(2.0 * fast * dt / -np.log(kept))
    inertia = np.diag(mass)
    return FilterNoise(
        force=np.where(
            covered, np.maximum(np.sqrt(slow), _LEAST * inertia), SETTINGS.default_force * inertia
        ),
        force_time_s=time_s,
        acceleration=np.where(covered, np.maximum(white, SETTINGS.least_white), SETTINGS.default_white),
    )


def _products(series: Array, lag: int, both: Mask) -> Array:
    """Sum (6,) of the products of values that lie a lag apart, where both are known (n, 6)."""
    return np.asarray((series[: len(series) - lag] * series[lag:] * both).sum(axis=0))


def _memory(moved: dict[str, Array]) -> float:
    """Time constant in s from the autocovariances (6,) at the two lags, every axis in units of its own."""
    scale = np.where(moved["none"] > 0.0, moved["none"], np.inf)
    near, far = (float((moved[lag] / scale).clip(0.0).sum()) for lag in ("near", "far"))
    if near <= 0.0:
        return SETTINGS.memory_s[0]
    if far >= near:
        return SETTINGS.memory_s[1]
    decay = math.log(near / max(far, 1e-9 * near))
    return float(np.clip((SETTINGS.far_s - SETTINGS.near_s) / decay, *SETTINGS.memory_s))


def _residual(vehicle: Vehicle, record: Record) -> tuple[Array, Mask, int]:
    """Acceleration (n, 6) that a step of the model misses, m/s^2 and rad/s^2, and where it is known.

    And at how many samples it is not, because the model diverges.
    """
    trial = record.trial
    counted = record.counted[:, :6]
    known = np.vstack([counted[:-1] & counted[1:], np.zeros((1, 6), bool)])
    places = np.flatnonzero(known.any(axis=1))
    residual = np.zeros(counted.shape)
    if not len(places):
        return residual, known, 0
    states = trial.state(slice(None))
    begun = zip(*(map(tuple, part[places].tolist()) for part in states), strict=True)
    segments = tuple(Segment(0, k, k + 2, *state) for k, state in zip(places.tolist(), begun, strict=True))
    whole = Record(trial, record.input, np.ones_like(record.counted))
    substeps = _substeps(vehicle, record)
    shown = Replay(vehicle, (whole,), segments, substeps=substeps, starts_count=True).simulated()
    after = np.array([channels[1, :6] for channels in shown])
    residual[places] = (states[2][places + 1] - after) / trial.dt
    reach = np.maximum(np.abs(np.where(counted, states[2], 0.0)).max(axis=0), 1e-3)
    near = np.abs(residual) * trial.dt < SETTINGS.diverged_reach * reach  # false where it is no number
    finite: Mask = np.asarray(near.all(axis=1))[:, None]
    diverged = int((known.any(axis=1) & ~finite[:, 0]).sum())
    return np.where(finite, residual, 0.0), np.asarray(known & finite), diverged


def _substeps(vehicle: Vehicle, record: Record) -> int:
    """Steps of a sample that follow the vehicle's fastest pole at the speeds of the record."""
    trial = record.trial
    speeds = np.nan_to_num(np.abs(trial.nu)).max(axis=0)
    rate = stage_step(vehicle, (), free="".join(AXES), speeds=speeds, dt=trial.dt).rate
    needed = max(trial.dt / SETTINGS.substep_s, trial.dt * rate / STEP_SETTINGS.search_rate_limit)
    return int(min(max(math.ceil(needed - 1e-9), 1), SETTINGS.most_substeps))
