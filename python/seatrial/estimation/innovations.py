"""Joint estimate with a noise model: prediction errors of a Kalman filter in place of those of a simulation.

Output error simulates a segment freely and takes all that it misses for sensor noise. In a log that was
sailed by an autopilot through waves that is wrong twice: waves move the vehicle, and the commands answer
them, so that the error is correlated with the input and bends the gains. With a model of the noise the
prediction errors of the right model are white and uncorrelated with the past; commands that are made from
the past then do no harm (Ljung 1999, theorem 8.3 and section 13.4).

A round linearises the model over every sample (`one_step`), improves the likelihood of the noise model
(`kalman`), runs the filter with the derivatives by the unknowns and takes a
Gauss-Newton step on the prediction errors a horizon ahead, one sample unless the campaign says otherwise.

Source: Maine & Iliff, *Application of Parameter Estimation to Aircraft Stability and Control* (NASA RP-1168,
1986); Ljung, *System Identification* (1999); Jategaonkar, *Flight Vehicle System Identification* (2015),
chapter 5 (filter error method).
Held by ``tests/estimation/test_innovations.py``.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from seatrial._core import initial_names
from seatrial.base.arrays import Array
from seatrial.base.channels import CHANNELS, deviations
from seatrial.base.errors import NumericalError
from seatrial.base.finding import is_numerical
from seatrial.base.work import Step
from seatrial.estimation import kalman
from seatrial.estimation.estimator import NoiseModel
from seatrial.estimation.instruments import Answers, answers, driven, drivers, instrumented, lag_s
from seatrial.estimation.joint import Joint
from seatrial.estimation.one_step import (
    ONE_STEP_SETTINGS,
    Errors,
    OneStep,
    Path,
    PredictionErrorCriterion,
    Span,
)
from seatrial.scoring.baselines import predicted_from_past
from seatrial.statistics.linearisation import Linearisation, Piece
from seatrial.trial.trial import Trial
from seatrial.vehicle.actuators import fins_and_groups, pushed_axes


@dataclass(frozen=True)
class InnovationSettings:
    """How a filter finds its noises, and when it has left the log."""

    #: Evaluations of the likelihood of the noises before the first round, in turn; the motion follows each.
    first_evaluations: tuple[int, int, int] = (10, 10, 30)
    #: Evaluations of it in each round.
    round_evaluations: int = 8
    #: Evaluations before the first round where another estimate of the same data left its noises.
    known_evaluations: tuple[int, int] = (8, 8)
    #: Evaluations for each frequency and breadth of the waves that is tried.
    wave_evaluations: int = 8
    #: Largest step, in standard deviations of the unknowns, that ends the rounds.
    close_sd: float = 0.5
    #: Time that the filter needs from the start of a span until its errors count, s.
    settling_s: float = 10.0
    #: Process noise over its own while the motion of given values is found anew, from the log in still water:
    #: derivatives about the log are far from those about the motion where a current is strong, and a filter
    #: that trusts them may leave it.
    settling_factors: tuple[float, ...] = (1e4, 1e2, 1.0, 1.0)
    #: Least deviation of a process noise then, a share of what one step of the model misses along the motion
    #: so far.
    missed_share: float = 0.3
    #: Error of half of a channel's predictions, over the spread of what was measured, from which the filter
    #: has left the log: its likelihood has no slope that leads back.
    diverged_spread: float = 1e3
    #: Least spread of a channel that hardly moves, m/s, rad/s, rad or m.
    least_spread: float = 0.01


SETTINGS = InnovationSettings()


_SUMS = ("mean", "filter", "hold last", "linear")

_RATES = {"roll": "p", "pitch": "q", "yaw": "r"}


@dataclass(frozen=True)
class Outcome:
    """Where the rounds ended: values (m,), noise (Y,) of the predictions, cost and likelihood.

    ``stopped`` says why a round had no result; the rest is that of the round before.
    """

    values: Array
    noise: Array
    cost: float
    start_cost: float
    samples: int
    rounds: int
    converged: bool
    interrupted: bool
    stopped: str = ""


class _Begun(NamedTuple):
    """A start (m,), its spans, and the noises and the path that go with it."""

    start: Array
    spans: list[Span]
    noise: NoiseModel
    path: Path


class Innovations:
    """Workspace of the joint estimate with a noise model; `steps` is the model over a sample along the data.

    ``held_out``: whether on the data that the campaign holds out, to judge, in place of those that it fits;
    None: on both.
    """

    def __init__(self, joint: Joint, *, held_out: bool | None = False) -> None:
        self.joint, self.held_out = joint, held_out
        self.steps = OneStep(joint, held_out=held_out)
        self.dt = joint.data.dt
        self._told = joint.noise_model is not None
        self._likeliest: _Begun | None = None
        self.seen = [self.steps.states.index(name) for name in self.steps.channels]
        self.criterion = PredictionErrorCriterion(joint)
        self.spread = np.maximum(_spread(joint.data.trials), SETTINGS.least_spread)

    def likelier(self, starts: Sequence[Array]) -> Array:
        """The start (m,) with which the log is most likely, each with noises of its own, which are kept.

        Where a simulation leaves the log the stages end anywhere, and the vehicle file may be nearer.
        """
        outcomes: list[tuple[float, _Begun]] = []
        for number, start in enumerate(starts, 1):
            self.joint.noise_model = None
            self.steps.follow_log()
            try:
                spans, _ = self._improved(start, self._begun(start), SETTINGS.first_evaluations)
            except NumericalError:
                if number == len(starts) and not outcomes:
                    raise
                continue
            likelihood = self._filters(spans).likelihood(self._noises)
            begun = _Begun(start, spans, self._noises, self.steps.path)
            outcomes.append((likelihood if math.isfinite(likelihood) else -math.inf, begun))
        _, best = max(outcomes, key=lambda outcome: outcome[0])
        self.joint.noise_model, self.steps.path, self._likeliest = best.noise, best.path, best
        return best.start

    def estimate(self, start: Array, rounds: int, watch: Callable[[Step], None] | None) -> Outcome:
        """The estimate that a start (m,) leads to.

        Raises NumericalError: the filter leaves the log at the start. Where it does after a step, the step is
        taken back.
        """
        began = time.monotonic()
        at, converged, interrupted, count, settled = start.copy(), False, False, 0, self._told
        stopped = ""
        ahead = self.samples(self.joint.polish.horizon_s)
        spans = self._first(at)
        errors = self.instrumented(spans, ahead)
        noise, first = self._followed(errors), None
        try:
            while True:
                safe = at, errors, noise, self.joint.noise_model, self.steps.path
                cost = self.criterion.cost(errors, noise)
                first = cost if first is None else first
                if watch is not None:
                    watch(Step("polish", count, rounds, count, cost, time.monotonic() - began))
                if count >= rounds or converged:
                    break
                taken = self.criterion.step(errors, noise, at, self.joint.centres(start))
                moved = np.clip(at + taken.step, self.criterion.lower, self.criterion.upper)
                size = np.sqrt(np.diag(np.linalg.pinv(taken.information)))
                converged = bool(np.all(np.abs(moved - at) < SETTINGS.close_sd * size)) and count > 0
                at, count = moved, count + 1
                spans = self._begun(at)
                # The derivatives of the next round follow the motion that this one finds.
                self._follow(spans, SETTINGS.round_evaluations)
                if converged and not settled:
                    # The waves are told apart from the errors of a right vehicle only.
                    waves, settled = self._waves(), True
                    spans = self._shaped(self.steps.linearised(at), at)
                    converged = self._waves() == waves
                errors = self.instrumented(spans, ahead)
                noise = self._followed(errors)
        except KeyboardInterrupt:
            interrupted = True
        except Exception as error:
            if count == 0 or not is_numerical(error):
                raise
            at, errors, noise, self.joint.noise_model, self.steps.path = safe
            converged, stopped = False, str(error)
        cost = self.criterion.cost(errors, noise)
        return Outcome(
            at,
            noise,
            cost,
            max(cost if first is None else first, cost),
            int(sum(part.counted.sum() for part in errors)),
            count,
            converged,
            interrupted,
            stopped,
        )

    def _followed(self, errors: Sequence[Errors]) -> Array:
        """Noise (Y,) of the prediction errors of a filter that follows the log.

        Raises NumericalError: half of the errors of a channel are `diverged_spread` times its spread, or no
        numbers.
        """
        noise = self.criterion.noise(errors)
        for column, channel in enumerate(self.steps.channels):
            settled = round(SETTINGS.settling_s / self.dt)
            measured = sum(int(part.span.valid[1:, column][settled:].sum()) for part in errors)
            counted = sum(int(part.counted[:, column].sum()) for part in errors)
            most = self.spread[CHANNELS.index(channel)]
            lost = 2 * counted < measured and counted < measured - settled * len(errors)
            if lost or (counted and not noise[column] < SETTINGS.diverged_spread * most):
                raise NumericalError(
                    f"the filter diverges: half of its predictions miss {channel} by {noise[column]:.2g} or"
                    f" more, and the log's {channel} varies by {most:.2g}"
                )
        return noise

    def linearisation(self, values: Array, extra: Sequence[str]) -> Linearisation:
        """Prediction errors and derivatives at a point, in the form in which an estimate is judged."""
        joint, size = self.joint, len(self.joint.unknowns) + len(extra)
        if self.joint.noise_model is None:
            self._first(values)
        # Errors and slopes along the motion that belongs to these values.
        spans = self.settled(values, extra)
        errors = self.instrumented(spans, self.samples(joint.polish.horizon_s))
        noise = self.criterion.noise(errors)
        pieces = []
        for part in errors:
            record = part.span.record
            trial = joint.data.trials[record]
            t = trial.t[part.span.last + 1 - len(part.error) : part.span.last + 1]
            residual = part.error / noise
            pieces.append(
                Piece(
                    trial=joint.data.names[record],
                    t=t,
                    residual=residual,
                    counted=part.counted,
                    weight=self.criterion.weight(residual),
                    jacobian=(part.instrument / noise[:, None]).reshape(*part.error.shape, size),
                    nu=trial.smooth_nu(t)[0],
                )
            )
        unknowns, values = joint.beside(values, extra)
        return Linearisation(
            unknowns=unknowns,
            values=values,
            channels=self.steps.channels,
            noise=noise,
            dt=self.dt,
            pieces=tuple(pieces),
            pushed=pushed_axes(joint.vehicle),
            fins=fins_and_groups(joint.vehicle),
        )

    def likelihoods(self, values: Array) -> Array:
        """Logarithm of the likelihood of these data by blocks of 20 s, with the noise model as it is.

        Without its constant. The motion that the derivatives are taken at is found anew, for the values (m,)
        of the unknowns.
        """
        length = max(round(ONE_STEP_SETTINGS.block_s / self.dt), 1)
        return np.array([
            part[k : k + length].sum()
            for part in self._filters(self.settled(values)).likelihoods(self._noises)
            for k in range(0, len(part), length)
        ])

    def prepare(self, values: Array) -> None:
        """Find the noise model that goes with the values (m,) of the unknowns; waves that are known stay."""
        self._first(values, SETTINGS.first_evaluations)

    def sums(self, values: Array, ahead_s: float) -> dict[str, dict[str, float]]:
        """Sums of squares by channel: of the motion about its mean ("mean") and of errors so far ahead.

        These are of the predictions ("filter"), of the measured value held from then ("hold last") and of a
        regression on the past of the training data ("linear"), NaN where these are too few. Where an angle
        was measured and its rate was not, the rate is the change of the angle over that time.

        The noise model stays as it is: on held-out data it is that of the training data. The motion that the
        derivatives are taken at is found anew, for these values.
        """
        table: dict[str, dict[str, float]] = {}
        steps, data = self.samples(ahead_s), self.joint.data
        errors = self.errors(self.settled(values), steps)
        learnt = [~self.joint.problem.held_out(name) for name in data.names]
        linear = predicted_from_past(data.trials, learnt, self.steps.channels, steps)
        for column, channel in enumerate(self.steps.channels):
            rows = [np.zeros((0, 4))]
            for part in errors:
                counted, record = part.counted[:, column], part.span.record
                at = part.span.last + 1 - len(part.error) + np.flatnonzero(counted)
                measured = data.trials[record].observed[:, CHANNELS.index(channel)]
                rivals = measured[at] - measured[at - steps], measured[at] - linear[record][at, column]
                rows.append(np.column_stack([measured[at], part.error[counted, column], *rivals]))
            motion, *missed = np.vstack(rows).T
            if motion.size and motion.std() > 0.0:
                sums = [float((error**2).sum()) for error in (motion - motion.mean(), *missed)]
                sums[1] = sums[1] if math.isfinite(sums[1]) else math.inf
                table[channel] = dict(zip(_SUMS, sums, strict=True))
        for angle, rate in _RATES.items():
            if angle in self.steps.channels and rate not in self.steps.channels:
                turned = self._turned(errors, angle, steps)
                if turned[0] > 0.0:
                    table[rate] = dict(zip(_SUMS, turned, strict=True))
        return table

    def _turned(self, errors: Sequence[Errors], angle: str, steps: int) -> tuple[float, ...]:
        """The sums of squares of an angle's rate, as its change over a horizon."""
        column, rows = self.steps.channels.index(angle), [np.zeros((0, 3))]
        for part in errors:
            trial, counted = self.joint.data.trials[part.span.record], part.counted[:, column]
            at = part.span.last + 1 - len(part.error) + np.flatnonzero(counted)
            turned = trial.filled(angle)
            if turned is None or not at.size:
                continue
            change = turned[at] - turned[at - steps]
            before = turned[at - steps] - turned[np.maximum(at - 2 * steps, 0)]
            rows.append(np.column_stack([change, part.error[counted, column], change - before]))
        change, error, held = np.vstack(rows).T / (steps * self.dt)
        about = change - change.mean() if change.size else change
        return (*(float((values**2).sum()) for values in (about, error, held)), math.nan)

    def followed(self, values: Array, ahead_s: float) -> dict[str, Trial]:
        """Trials by name with the states that the filter knew, and the current that it knew so long before.

        A simulation that restarts there and runs so far knows nothing of what comes after its start. The
        current, NED in m/s, is zero until the filter knows it; what was recorded of it is kept.
        """
        self.settled(values)
        late, trials = self.samples(ahead_s), {}
        data = self.joint.data
        for record, (name, trial) in enumerate(zip(data.names, data.trials, strict=True)):
            states, water = self.steps.known(record)
            current = np.zeros_like(water) if trial.current is None else trial.current.copy()
            current[late:] += water[:-late]
            trials[name] = replace(trial, current=current, states=states)
        return trials

    def initial(self) -> Array:
        """No initial conditions (segments, 12): the filter has them."""
        return np.zeros((len(self.joint.data.segments), len(initial_names())))

    def samples(self, horizon_s: float) -> int:
        """Samples of a horizon, one at least."""
        return max(round(horizon_s / self.dt), 1)

    @property
    def _noises(self) -> NoiseModel:
        assert self.joint.noise_model is not None
        return self.joint.noise_model

    def _first(self, values: Array, again: Sequence[int] = SETTINGS.known_evaluations) -> list[Span]:
        """The spans at a start, with a noise model that goes with it; waves that nobody told are sought.

        ``again`` are the evaluations where another estimate left its noises.
        """
        begun = self._likeliest
        if self._told:
            spans, followed = self._improved(values, self.settled(values), again)
            if followed:
                return spans
            # The noises of another estimate are too small for this start.
            self.joint.noise_model = None
            self.steps.follow_log()
        if begun is not None and np.array_equal(begun.start, values):
            spans = begun.spans
        else:
            spans, _ = self._improved(values, self._begun(values), SETTINGS.first_evaluations)
        self._told = True
        return self._shaped(spans, values)

    def _begun(self, values: Array) -> list[Span]:
        """The spans at a point, with a noise model to begin with where there is none."""
        spans = self.steps.linearised(values)
        if self.joint.noise_model is None:
            self._refuse_divergence(spans)
            self.joint.noise_model = kalman.begin(spans, len(self.steps.velocities), self.dt)
        return spans

    def _refuse_divergence(self, spans: Sequence[Span]) -> None:
        """Refuse a model that one sample takes away from the log, before its noises are sought for minutes.

        Raises NumericalError: it misses half of the samples by `diverged_spread` times the spread of what was
        measured.
        """
        missed = np.concatenate([np.abs(span.missed) for span in spans])
        finite = np.concatenate([np.isfinite(span.transition).all(axis=(1, 2)) for span in spans])
        for column, channel in enumerate(self.steps.states):
            most = self.spread[CHANNELS.index(channel)]
            if np.mean(finite & (missed[:, column] < SETTINGS.diverged_spread * most)) < 0.5:
                raise NumericalError(
                    f"the model diverges over one sample of {self.dt:g} s: it misses {channel} by"
                    f" {np.nanmedian(missed[:, column]):.2g}, and the log's {channel} varies by {most:.2g}"
                )

    def _improved(
        self, values: Array, spans: list[Span], improvements: Sequence[int]
    ) -> tuple[list[Span], bool]:
        """The spans at a point, the noise model and the motion brought along, and whether they could be."""
        for evaluations in improvements:
            if not self._follow(spans, evaluations):
                return spans, False
            spans = self.steps.linearised(values)
        return spans, True

    def _follow(self, spans: Sequence[Span], evaluations: int) -> bool:
        """Bring the noise model along, and the motion that the next derivatives are taken along.

        Both stay, and the answer is no, where the filter leaves the log.
        """
        likelihood, noise, motion = self._filters(spans).likeliest(self._noises, evaluations)
        if not math.isfinite(likelihood) or not self.steps.follow(motion):
            return False
        self.joint.noise_model = noise
        return True

    def _shaped(self, spans: Sequence[Span], values: Array) -> list[Span]:
        """The spans at a point, the waves of the noise model as fast and as broad as the log says."""
        self.joint.noise_model = kalman.shaped(
            spans, self._noises, self.dt, self.seen, SETTINGS.wave_evaluations, self.joint.threads
        )
        self.steps.follow(self._filters(spans).motion(self._noises))
        return self.steps.linearised(values)

    def settled(self, values: Array, extra: Sequence[str] = ()) -> list[Span]:
        """The spans at a point along a motion found anew for it, with the noise model as it is."""
        own, known = self._noises, self.joint.settled.get(self.held_out)
        if known is not None and known[0] is own and np.array_equal(known[1], values):
            self.steps.path = known[2]
            return self.steps.linearised(values, extra)
        self.steps.follow_log()
        for factor in SETTINGS.settling_factors:
            spans = self.steps.linearised(values)
            missed = np.concatenate([span.missed for span in spans]).std(axis=0)
            process = factor * own.process
            process[: len(missed)] = np.maximum(process[: len(missed)], (SETTINGS.missed_share * missed) ** 2)
            if not self.steps.follow(self._filters(spans).motion(replace(own, process=process))):
                break  # a model that diverges over a step
        self.joint.settled[self.held_out] = own, values.copy(), self.steps.path
        return self.steps.linearised(values, extra)

    def _waves(self) -> tuple[float | None, float, bool]:
        """Frequency, Hz, and damping ratio of the waves, as the filter has them, and whether they carry."""
        return self._noises.wave_hz, self._noises.damping, self._noises.carried

    def _filters(self, spans: Sequence[Span]) -> kalman.Filters:
        return kalman.Filters(spans, self._noises, self.dt, self.seen, self.joint.threads)

    def instrumented(self, spans: Sequence[Span], ahead: int) -> list[Errors]:
        """Prediction errors of the spans so many samples ahead, for an estimate.

        Over more than one sample with `seatrial.estimation.instruments`, for commands within the horizon may
        answer what the prediction misses.
        """
        late = self.errors(spans, ahead)
        if ahead == 1:
            return late
        known = [
            np.hstack([driving, self._velocities(span)])
            for span, driving in zip(spans, self._driving(spans), strict=True)
        ]
        lag = max(round(lag_s(self._noises.wave_hz) / self.dt), 1)
        return instrumented(late, self.errors(spans, 1), known, lag)

    def answers(self, spans: Sequence[Span]) -> Answers:
        """Which commands answer more than the log holds (`seatrial.estimation.instruments`)."""
        velocities = [self._velocities(span) for span in spans]
        names = drivers(self.joint.data.records)
        return answers(self._driving(spans), names, self.errors(spans, 1), velocities)

    def _driving(self, spans: Sequence[Span]) -> list[Array]:
        """What drives the vehicle along each span, (n, k)."""
        driving = driven(self.joint.data.records)
        return [driving[span.record][span.first : span.last + 1] for span in spans]

    def _velocities(self, span: Span) -> Array:
        """The velocities of the simulated axes that the filter knew at each sample of a span."""
        states, _ = self.steps.known(span.record)
        return states[2][span.first : span.last + 1][
            :, [CHANNELS.index(name) for name in self.steps.velocities]
        ]

    def errors(self, spans: Sequence[Span], ahead: int) -> list[Errors]:
        """Prediction errors of the spans so many samples ahead; every slope is its own instrument."""
        filters, parts = self._filters(spans), []
        for span, late in zip(spans, filters.predicted(self._noises, ahead), strict=True):
            counted = span.valid[ahead:] & np.isfinite(late).all(axis=2)
            counted[: round(SETTINGS.settling_s / self.dt)] = False
            error = np.where(counted, span.measured[ahead:] - late[..., 0], 0.0)
            slope = np.where(counted[..., None], late[..., 1:], 0.0)
            parts.append(Errors(span, error, counted, slope, slope))
        return parts


def _spread(trials: Sequence[Trial]) -> Array:
    """Standard deviation (12,) of each channel over all trials, the largest of them; zero without samples."""
    spread = np.zeros(len(CHANNELS))
    for trial in trials:
        for column, channel in enumerate(CHANNELS):
            values = trial.observed[trial.valid[:, column], column]
            if len(values):
                away = deviations(values, channel)
                spread[column] = max(spread[column], float(np.sqrt(np.mean(away**2))))
    return spread
