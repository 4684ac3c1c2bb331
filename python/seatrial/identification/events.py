"""Events: stretches of a closed-loop log in which the command does not answer the motion, and their estimate.

An autopilot that answers waves exchanges cause and effect (`seatrial.inspect.verdict`). A routine mission
still holds open-loop experiments: the rudder at its limit at the beginning of every leg, a set point that
steps. There the command is constant whatever the waves do, so that output error is consistent: a simulation
from a second before the command changes, with the event's own start and current as nuisance parameters.

The waves stay in the residual. Least squares would take their narrow band for white noise and count a hundred
samples of one wave as a hundred measurements. The residuals of each channel are weighted by the inverse of a
stationary covariance, a sum of non-negative terms fitted to their autocovariance (non-negative least squares,
Lawson and Hanson 1974): white noise, slow errors ``(1 + tau/b) exp(-tau/b)``, and waves
``exp(-tau/a) cos(omega tau)`` on a grid of frequencies. Estimate and covariance are found in turn (feasible
generalised least squares, Greene, *Econometric Analysis* (2012), section 9.3). Angles are compared and not
their rates, which most logs smooth from them: smoothing makes an error that no stationary noise describes.

Deviations are the larger of the inverse information and of a jackknife over the events. Quadratic damping and
cross-flow drag by strips are both estimated; each event is foretold by the estimate from the others (one step
of Gauss and Newton), and its likelihood there weighs the two. The result is the likelier, its variance that
of the mixture (Hoeting et al., *Stat. Sci.* 14 (1999) 382).

Tests: ``tests/identification/test_event_estimates.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import t as student

from seatrial._core import initial_names, nuisance_names
from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import AXES, CHANNELS, MOTIONS, deviations
from seatrial.base.plain import Plain
from seatrial.diagnosis.assessment import TOLD
from seatrial.diagnosis.weak_combination import ABSENT, WEAK
from seatrial.estimation.method import method_of
from seatrial.estimation.segment_model import SegmentModel, StageData, cut
from seatrial.estimation.step import stage_step
from seatrial.identification.damping import slender
from seatrial.inspect.events import EVENT_LIMITS, Event, events
from seatrial.problem.parameter import STRIPS, Parameter, coefficients, parameters
from seatrial.problem.settings import Stage
from seatrial.scoring.record import restarted

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.problem.problem import Problem


@dataclass(frozen=True)
class EventSettings:
    """Thresholds of an estimate on events.

    Attributes
    ----------
    fewest
        Events from which their scatter tells a deviation: the jackknife of fewer has under four degrees of
        freedom.
    most
        Events at most, spread over the trials: of more, every second or third.
    explained
        Part of an axis' motion within its events that the simulation has to show: of less, waves are most.
    decays_s, memories_s
        Decay of the waves' covariance and memory of slow errors, s: a swell keeps its phase for some
        periods, a wind sea for less.
    waves_rad_s
        Frequencies of waves: periods of 2 to 16 s, closer than the width that a decay of 25 s smears.
    current, velocity, angle, place
        Prior deviations of an event's own current, m/s, and of its start: m/s and rad/s, rad, m. They are
        wide; the event tells them.
    drag
        Cross-flow drag coefficient of a hull known beforehand, value and deviation: 0.7 to 1.2, cylinders and
        ellipses of finite length (White 2011, table 7.3; Hoerner 1965, chapter 3).
    damping
        Deviation of quadratic damping about the vehicle's value, over it: that of ``drag``.
    at_bound
        Distance from a bound, over the width of the bounds, from which a value lies inside them.
    beyond, moved
        Deviations beyond a bound from which the data contradict it; deviations and part of its value by which
        a coefficient moves without such bounds that makes up for them: as in `seatrial.diagnosis.assessment`.
    damped
        Linear damping of the second start, over its lower bound: an unstable hull without any runs away.
    diverged
        Largest error or derivative, SI: beyond it the simulation of an event has diverged.
    rounds, settled
        Estimates and covariances in turn at most (three settle it), and the change of an estimate, in its
        deviations, from which a round is the last.
    steps, little
        Steps of a round at most, and the part of its cost that its last one gains: the covariance changes
        more.
    """

    fewest: int = 5
    most: int = 20
    explained: float = 0.5
    decays_s: tuple[float, ...] = (4.0, 10.0, 25.0)
    memories_s: tuple[float, ...] = (0.3, 1.0, 3.0, 10.0)
    waves_rad_s: tuple[float, ...] = tuple(np.linspace(0.4, 3.2, 15).tolist())
    current: float = 0.1
    velocity: float = 0.3
    angle: float = 0.1
    place: float = 0.5
    drag: tuple[float, float] = (0.95, 0.25)
    damping: float = 0.3
    at_bound: float = 1e-3
    beyond: float = 3.0
    moved: tuple[float, float] = (2.0, 0.05)
    damped: float = 0.05
    diverged: float = 1e6
    rounds: int = 6
    settled: float = 0.1
    steps: int = 25
    little: float = 1e-5


SETTINGS = EventSettings()

_NUISANCES, _INITIALS = tuple(nuisance_names()), tuple(initial_names())

_CURRENTS = ("current_north", "current_east")

_ANGLE = {"p": "roll", "q": "pitch", "r": "yaw"}


class _Windows:
    """Events as segments of a replay with a record each, so that each has a current of its own.

    An unknown vector is the coefficients (m,), then per event its current north and east and its initial
    conditions.
    """

    def __init__(
        self, problem: Problem, stage: Stage, chosen: Sequence[Event], vehicle: Vehicle, threads: int | None
    ) -> None:
        data = cut(problem, stage)
        records = dict(zip(data.names, data.records, strict=True))
        segments = []
        for place, event in enumerate(chosen):
            trial = records[event.trial].trial
            first, last = np.searchsorted(trial.t, (event.start_s - EVENT_LIMITS.before_s, event.stop_s))
            starts = np.flatnonzero(trial.startable[first:last])
            segments += restarted(trial, [(int(first + starts[0]), int(last + 1))], place)
        data = StageData(
            tuple(event.trial for event in chosen),
            tuple(replace(records[event.trial]) for event in chosen),
            tuple(segments),
            data.counts,
            data.scale,
            data.weights,
        )
        self.parameters = parameters(stage, vehicle, problem.where(stage))
        step = stage_step(vehicle, (), free=stage.axes.free, speeds=data.largest_speeds(), dt=data.dt)
        self.model = SegmentModel(
            vehicle, stage, data, self.parameters, step.search, threads, starts_count=True
        )
        self.used = [CHANNELS.index(channel) for channel in stage.channels]
        self.channels = tuple(stage.channels)
        self.dt = data.dt
        self.counted = [self.model.counted(i)[:, self.used] for i in range(len(segments))]
        names = {f"initial_{CHANNELS[AXES.index(axis)]}": SETTINGS.velocity for axis in stage.axes.free}
        names |= {f"initial_{c}": SETTINGS.angle for c in ("roll", "pitch", "yaw") if c in self.channels}
        names |= {f"initial_{c}": SETTINGS.place for c in "xyz" if c in self.channels}
        self.initials = tuple(names)
        self.own_sd = np.array([SETTINGS.current, SETTINGS.current, *names.values()])
        self.lower = np.array([parameter.lower for parameter in self.parameters])
        self.upper = np.array([parameter.upper for parameter in self.parameters])

    @property
    def events(self) -> int:
        """Number of events."""
        return len(self.counted)

    def _placed(self, x: Array) -> tuple[Array, Array, Array]:
        """Coefficients (m,), the core's rows of nuisances (events, k) and initial conditions (events, 12)."""
        count = len(self.parameters)
        own = x[count:].reshape(self.events, -1)
        nuisance = np.zeros((self.events, len(_NUISANCES)))
        nuisance[:, [_NUISANCES.index(name) for name in _CURRENTS]] = own[:, :2]
        initial = np.zeros((self.events, len(_INITIALS)))
        initial[:, [_INITIALS.index(name) for name in self.initials]] = own[:, 2:]
        return x[:count], nuisance, initial

    def explained(self, x: Array, axes: str) -> float:
        """Least part over the axes of the motion within events that a simulation shows, 1 for all of it."""
        parts, errors = [], self.errors(x)
        for axis in axes:
            velocity = CHANNELS[AXES.index(axis)]
            channel = velocity if velocity in self.channels else _ANGLE.get(velocity, "")
            if channel not in self.channels:
                continue
            place = self.channels.index(channel)
            left = moved = 0.0
            for error, mask, segment in zip(errors, self.counted, self.model.data.segments, strict=True):
                trial = self.model.data.trials[segment.record]
                shown = trial.observed[segment.start : segment.stop, CHANNELS.index(channel)]
                shown = shown[len(shown) - len(mask) :][mask[:, place]]
                left += float((error[mask[:, place], place] ** 2).sum())
                moved += float((deviations(shown, channel) ** 2).sum())
            parts.append(1.0 - left / max(moved, 1e-12))
        return min(parts, default=0.0)

    def errors(self, x: Array) -> list[Array]:
        """Measured minus simulated (n, C) per event, SI, zero where not counted."""
        values, nuisance, initial = self._placed(x)
        residuals = self.model.residuals(values, nuisance=nuisance, initial=initial)
        # A simulation that diverged is as far off as a number may be: a step back is always better.
        return [_bounded(np.take(error, self.used, axis=1)) for error in residuals]

    def slopes(self, x: Array) -> list[Array]:
        """Derivatives (n, C, m + own) of what each event shows, by coefficients and its own unknowns."""
        values, nuisance, initial = self._placed(x)
        pieces = self.model.sensitivities(
            values,
            nuisances=_CURRENTS,
            initials=self.initials,
            channels=self.channels,
            nuisance=nuisance,
            initial=initial,
        )
        return [_bounded(jacobian) for _, jacobian in pieces]


def _bounded(numbers: Array) -> Array:
    most = SETTINGS.diverged
    return np.asarray(np.clip(np.nan_to_num(numbers, nan=most), -most, most))


def _covariance(errors: Sequence[Array], dt: float) -> Array:
    """Cholesky factor (n, n) of the covariance of residuals (n_i,) that are stationary and alike."""
    from scipy.linalg import cholesky, toeplitz
    from scipy.optimize import nnls

    longest = max(map(len, errors))
    total, counts = np.zeros(longest), np.zeros(longest)
    for error in errors:
        n = len(error)
        spectrum = np.fft.rfft(error, 2 * n)
        total[:n] += np.fft.irfft(spectrum * spectrum.conj())[:n]
        counts[:n] += n - np.arange(n)
    lag = np.arange(longest) * dt
    terms = [np.where(lag == 0.0, 1.0, 0.0)]
    terms += [(1.0 + lag / memory) * np.exp(-lag / memory) for memory in SETTINGS.memories_s]
    terms += [
        np.exp(-lag / decay) * np.cos(w * lag) for decay in SETTINGS.decays_s for w in SETTINGS.waves_rad_s
    ]
    basis = np.column_stack(terms)
    # Long lags come from few pairs: the far half is left out, the rest weighs by its pairs.
    use = slice(0, max(longest // 2, 2))
    weight = np.sqrt(counts[use])
    share, _ = nnls(basis[use] * weight[:, None], total[use] / counts[use] * weight)
    fitted = basis @ share
    # The least white noise is what second differences show: 6 times its variance (of slower errors little).
    # Without it interpolated samples, whose autocovariance has no jump at nil, would weigh infinitely.
    bends = np.concatenate([np.diff(error, 2) for error in errors])
    fitted[0] += max(float(bends @ bends) / (6.0 * len(bends)) - share[0], 1e-4 * total[0] / counts[0], 1e-18)
    return np.asarray(cholesky(toeplitz(fitted), lower=True))


@dataclass(frozen=True)
class _Fit:
    """Estimate on events.

    ``point`` are all unknowns, ``prior`` centres and deviations (m,); per event, without its own unknowns,
    the ``information`` (events, m, m), the downhill ``gradients`` (events, m) and ``deviances`` (events,),
    minus twice the log-likelihood; priors are in none of these.
    """

    windows: _Windows
    point: Array
    prior: tuple[Array, Array]
    information: Array
    gradients: Array
    deviances: Array

    @cached_property
    def values(self) -> Array:
        """Coefficients (m,), without the events' own unknowns."""
        return self.point[: len(self.prior[0])]

    @cached_property
    def _whole(self) -> Array:
        return np.asarray(self.information.sum(axis=0) + np.diag(self.prior[1] ** -2.0))

    @cached_property
    def inside(self) -> Mask:
        """Which values (m,) lie inside their bounds; the others stay there."""
        width = self.windows.upper - self.windows.lower
        away = np.minimum(self.values - self.windows.lower, self.windows.upper - self.values)
        return np.asarray(away > SETTINGS.at_bound * width)

    @cached_property
    def bent(self) -> Mask:
        """Which values (m,) make up for bounds that the data contradict: released, they move far."""
        downhill = self.gradients.sum(axis=0) - (self.values - self.prior[0]) / self.prior[1] ** 2
        inner = [*np.flatnonzero(self.inside)]

        def released(places: list[np.intp]) -> tuple[Array, Array]:
            """Step of the inner values and these, and its deviations."""
            free = np.ix_([*inner, *places], [*inner, *places])
            inverse = np.linalg.inv(self._whole[free])
            return inverse @ downhill[[*inner, *places]], np.sqrt(np.diag(inverse))

        against = []
        for place in np.flatnonzero(~self.inside):
            step, sd = released([place])
            middle = 0.5 * (self.windows.lower[place] + self.windows.upper[place])
            outward = math.copysign(1.0, self.values[place] - middle)
            if outward * step[-1] > SETTINGS.beyond * sd[-1]:
                against.append(place)
        moved = np.zeros(len(self.values))
        if against:
            moved[inner] = released(against)[0][: len(inner)]
        far = np.abs(moved) > SETTINGS.moved[0] * np.sqrt(np.diag(self.covariance))
        return np.asarray(far & (np.abs(moved) > SETTINGS.moved[1] * np.abs(self.values)))

    @cached_property
    def left_out(self) -> Array:
        """Estimates (events, m) without one event each, by a step of Gauss and Newton."""
        free = np.flatnonzero(self.inside)
        pull = self.gradients.sum(axis=0) - (self.values - self.prior[0]) / self.prior[1] ** 2
        values = np.tile(self.values, (len(self.gradients), 1))
        for row, own, gradient in zip(values, self.information, self.gradients, strict=True):
            row[free] += np.linalg.solve((self._whole - own)[np.ix_(free, free)], (pull - gradient)[free])
        return np.clip(values, self.windows.lower, self.windows.upper)

    @cached_property
    def covariance(self) -> Array:
        """Covariance (m, m): correlations of the information, deviations of the wider of it and jackknife."""
        inverse = np.linalg.inv(self._whole)
        count = len(self.left_out)
        scatter = (count - 1) / count * ((self.left_out - self.left_out.mean(axis=0)) ** 2).sum(axis=0)
        sd = np.sqrt(np.diag(inverse))
        wider = np.maximum(np.sqrt(scatter) / sd, 1.0)
        return np.asarray(inverse * np.outer(wider, wider))

    @cached_property
    def unseen(self) -> Array:
        """Minus twice the log-likelihood (events,) of each event after the estimate from the others."""
        moved = self.left_out - self.values
        linear = np.einsum("em,em->e", moved, self.gradients)
        square = np.einsum("em,emn,en->e", moved, self.information, moved)
        return np.asarray(self.deviances - 2.0 * linear + square)


def _estimate(
    windows: _Windows, start: Array, known: tuple[Array, Array], rounds: int = SETTINGS.rounds
) -> _Fit:
    """Generalised least squares on events from a start (m,), with prior values and deviations (m,)."""
    from scipy.linalg import block_diag, solve_triangular
    from scipy.optimize import least_squares

    count, own = len(start), len(windows.own_sd)
    x = np.concatenate([np.clip(start, windows.lower, windows.upper), np.zeros(windows.events * own)])
    free = np.full(windows.events * own, np.inf)
    bounds = np.concatenate([windows.lower, -free]), np.concatenate([windows.upper, free])
    prior_sd = np.concatenate([known[1], np.tile(windows.own_sd, windows.events)])
    centre = np.concatenate([known[0], np.zeros(len(free))])
    errors = windows.errors(x)
    scale = windows.model.data.scale[windows.used]
    n = max(map(len, errors))
    factors = [0.1 * size * np.eye(n) for size in scale]

    def white(column: Array, channel: int, rows: Mask) -> Array:
        # A sample that does not count is not there: its row and column of the covariance are left out.
        places = np.flatnonzero(rows)
        if len(places) == len(rows):
            factor = factors[channel][: len(rows), : len(rows)]
        else:
            factor = np.linalg.cholesky(factors[channel][places] @ factors[channel][places].T)
        return np.asarray(solve_triangular(factor, column[places], lower=True))

    def whitened(pieces: Sequence[Array]) -> list[Array]:
        """Per event the rows of all channels, whitened."""
        return [
            np.concatenate([white(piece[:, c], c, mask[:, c]) for c in range(len(scale))])
            for piece, mask in zip(pieces, windows.counted, strict=True)
        ]

    def residual(z: Array) -> Array:
        rows = np.concatenate(whitened(windows.errors(z)))
        return np.append(rows, (centre - z) / prior_sd)

    def jacobian(z: Array) -> Array:
        pieces = whitened(windows.slopes(z))
        rows = np.hstack([
            np.vstack([piece[:, :count] for piece in pieces]),
            block_diag(*[piece[:, count:] for piece in pieces]),
        ])
        return -np.vstack([rows, np.diag(1.0 / prior_sd)])

    deviation = np.full(count, np.inf)
    for turn in range(rounds):
        inside = np.clip(x, bounds[0] + 1e-9, bounds[1] - 1e-9)
        result = least_squares(
            residual,
            inside,
            jacobian,
            bounds=bounds,
            x_scale=prior_sd,
            max_nfev=SETTINGS.steps,
            ftol=SETTINGS.little,
        )
        change = np.abs(result.x[:count] - x[:count])
        x = result.x
        if turn and np.all(change <= SETTINGS.settled * deviation):
            break
        errors = windows.errors(x)
        factors = [
            _covariance([e[m[:, c], c] for e, m in zip(errors, windows.counted, strict=True)], windows.dt)
            for c in range(len(scale))
        ]
        rows = jacobian(x)
        deviation = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows))[:count])
    return _reduced(windows, x, known, whitened(windows.errors(x)), whitened(windows.slopes(x)), factors)


def _reduced(
    windows: _Windows,
    x: Array,
    known: tuple[Array, Array],
    errors: Sequence[Array],
    slopes: Sequence[Array],
    factors: Sequence[Array],
) -> _Fit:
    """The estimate with each event's own unknowns eliminated (Schur complement)."""
    count = len(known[0])
    own = x[count:].reshape(windows.events, -1)
    information, gradients, deviances = [], [], []
    for error, slope, inside, mask in zip(errors, slopes, own, windows.counted, strict=True):
        shared, local = slope[:, :count], slope[:, count:]
        normal = local.T @ local + np.diag(windows.own_sd**-2.0)
        follow = np.linalg.solve(normal, local.T @ shared)
        toward = np.linalg.solve(normal, local.T @ error - inside / windows.own_sd**2)
        information.append(shared.T @ shared - shared.T @ local @ follow)
        gradients.append(shared.T @ error - shared.T @ local @ toward)
        size = sum(2.0 * np.log(np.diag(f)[: m.sum()]).sum() for f, m in zip(factors, mask.T, strict=True))
        deviances.append(float(error @ error + ((inside / windows.own_sd) ** 2).sum() + size))
    return _Fit(windows, x, known, np.array(information), np.array(gradients), np.array(deviances))


@dataclass(frozen=True)
class EventEstimate(Plain, without="parameters covariance"):
    """What the events of a stage tell of its coefficients.

    Attributes
    ----------
    stage
        Its name, or that of a motion that no stage frees.
    axes
        Letters of the axes whose commands answer the motion.
    events
        What it was estimated from, or what there is where that is too little.
    parameters
        Free ones, with strips in place of quadratic damping where these foretell better; none where the
        events carry too little.
    values, covariance, prior
        Estimates (m,), covariance (m, m), and per parameter the value and deviation known beforehand, SI.
    verdicts
        Per parameter, as of `seatrial.diagnosis.identifiability`.
    damping
        "quadratic" or "strips".
    likelier
        By how much that form foretells the left-out events better than the other, log-likelihood; nil where
        one form alone was estimated.
    strips
        ``C_Dy`` or ``C_Dz`` where strips were taken, else "".
    """

    stage: str
    axes: str
    events: tuple[Event, ...]
    parameters: tuple[Parameter, ...] = ()
    values: tuple[float, ...] = ()
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    prior: tuple[tuple[float, float], ...] = ()
    verdicts: tuple[str, ...] = ()
    damping: str = ""
    likelier: float = 0.0
    strips: str = ""

    @property
    def upper(self) -> float:
        """Upper bound of the drag coefficient of the strips; 0 without strips."""
        return max((p.upper for p in self.parameters if p.name == self.strips), default=0.0)

    @property
    def enough(self) -> bool:
        """Whether the coefficients of the stage are taken from its events."""
        return bool(self.parameters)

    def known(self, place: int) -> dict[str, Any]:
        """Estimate, sigma, 95 % interval, verdict and prior of a parameter, as `Assessment.of` gives them."""
        value, sigma = self.values[place], math.sqrt(self.covariance[place, place])
        # Student's factor of as many events: their scatter is what the deviation rests on.
        factor = float(student.ppf(0.975, len(self.events) - 1))
        centre, prior_sd = self.prior[place]
        return {
            "estimate": value,
            "sigma": sigma,
            "lower": value - factor * sigma,
            "upper": value + factor * sigma,
            "verdict": self.verdicts[place],
            "prior": centre,
            "prior_sd": prior_sd,
        }


@dataclass(frozen=True)
class Told:
    """What events tell, and the problem that is left.

    Attributes
    ----------
    whole
        The problem that was asked.
    estimates
        By stage, those that carry too little too.
    """

    whole: Problem
    estimates: tuple[EventEstimate, ...] = ()

    @cached_property
    def taken(self) -> tuple[EventEstimate, ...]:
        """Estimates of stages that are taken from events."""
        return tuple(estimate for estimate in self.estimates if estimate.enough)

    @cached_property
    def values(self) -> dict[str, float]:
        """Coefficients that events set."""
        return {
            name: value
            for estimate in self.taken
            for name, value in coefficients(estimate.parameters, estimate.values).items()
        } | {
            name: 0.0
            for estimate in self.taken
            if estimate.strips
            for name in (STRIPS[estimate.strips][0], STRIPS[estimate.strips][-1])
        }

    @cached_property
    def rest(self) -> Problem:
        """The problem without what events tell: its vehicle has their values, their axes are replayed."""
        if not self.taken:
            return self.whole
        names = {name for estimate in self.taken for name in self._stage(estimate.stage).coefficients}
        vehicle = self.whole.vehicle.with_coefficients(self.values)
        return self.whole.without_coefficients(names).with_vehicle(vehicle)

    def restored(self, rest: Problem) -> Problem:
        """The whole problem again, with what the rest of the identification made of the others' stages."""
        if not self.taken:
            return rest
        whole = self._damped
        own = {stage.name: stage for stage in rest.stages}
        names = {estimate.stage for estimate in self.taken}
        stages = [
            stage if stage.name in names else own[stage.name]
            for stage in whole.stages
            if stage.name in names or stage.name in own
        ]
        return rest.with_vehicle(self.whole.vehicle).with_stages(stages)

    def again(self, vehicle: Vehicle, *, threads: int | None = None) -> Told:
        """The estimates once more beside what the rest of the identification found.

        ``X_udot`` is in the Munk moment of sway and yaw: events tell their sum with ``N_uv``.

        Parameters
        ----------
        vehicle
            With the result of the rest.
        """
        known = self._damped.with_vehicle(vehicle)
        stages = {stage.name: stage for stage in known.stages}
        estimates = []
        for estimate in self.estimates:
            if estimate.enough:
                stage = stages[estimate.stage]
                fit = _with_damping(known, stage, estimate.events, estimate.strips, threads, estimate.values)
                estimate = replace(estimate, values=tuple(fit.values.tolist()))
            estimates.append(estimate)
        return replace(self, estimates=tuple(estimates))

    @cached_property
    def _damped(self) -> Problem:
        """The whole problem with the damping that events prefer."""
        whole = self.whole
        for estimate in self.taken:
            if estimate.strips:
                whole = whole.with_strips(estimate.strips, (0.0, estimate.upper), SETTINGS.drag[0])
        return whole

    def _stage(self, name: str) -> Stage:
        return next(stage for stage in self.whole.stages if stage.name == name)


def from_events(
    problem: Problem, *, threads: int | None = None, watch: Callable[[str], None] | None = None
) -> Told:
    """Coefficients of axes whose commands answer the motion, from the events of their trials.

    Only where the joint estimate would otherwise be by innovations: a simulation of the whole log is biased
    there. What the campaign holds out is not used.

    Parameters
    ----------
    problem : Problem
    threads : int, optional
        Of the core; the result does not depend on it.
    watch : callable, optional
        Gets the name of each stage whose events are estimated.
    """
    if problem.joint is None or problem.joint.method == "output":
        return Told(problem)
    estimates, judged = [], set[str]()
    for stage in problem.stages:
        closed = _closed(problem, stage.trials) & set(stage.axes.free)
        if closed:
            if watch is not None:
                watch(stage.name)
            estimates.append(on_events(problem, stage, _events(problem, stage.trials, closed), threads))
            judged |= closed
    trials = tuple(dict.fromkeys(name for stage in problem.stages for name in stage.trials))
    for axis in AXES:
        if axis in _closed(problem, trials) - judged:
            estimates.append(EventEstimate(MOTIONS[axis], axis, _events(problem, trials, {axis})))
    return Told(problem, tuple(estimates))


def _closed(problem: Problem, trials: Sequence[str]) -> set[str]:
    """Axes whose commands answer the motion in all of these trials, in waves that bias a simulation."""
    if any(problem.input_of(name) != "commands" for name in trials):
        return set()
    if method_of(problem, trials).method != "innovations":
        return set()
    verdicts = [problem.verdicts(name) for name in trials]
    return {axis for axis in AXES if all(axis in own and own[axis].kind != "open" for own in verdicts)}


def _events(problem: Problem, trials: Sequence[str], axes: set[str]) -> tuple[Event, ...]:
    """Events of some axes in what is fitted of some trials, each stretch once."""
    chosen = {
        (event.trial, event.start_s): event
        for name in trials
        for axis in sorted(axes)
        for event in events(problem.trials[name], problem.vehicle, axis, ~problem.held_out(name))
    }
    # One covariance holds for all, so that all have the time base of most.
    bases = [round(problem.trials[name].dt, 6) for name, _ in chosen]
    usual = max(bases, key=bases.count, default=0.0)
    alike = [event for event, dt in zip(chosen.values(), bases, strict=True) if dt == usual]
    return tuple(alike[:: math.ceil(len(alike) / SETTINGS.most)] if alike else ())


def on_events(
    problem: Problem, stage: Stage, chosen: tuple[Event, ...], threads: int | None
) -> EventEstimate:
    """What the events of a stage tell."""
    few = EventEstimate(stage.name, "".join(dict.fromkeys(event.axis for event in chosen)), chosen)
    if len(chosen) < SETTINGS.fewest:
        return few
    fits = {"": _with_damping(problem, stage, chosen, "", threads)}
    info = problem.vehicle.coefficient_info()
    for name, made in STRIPS.items():
        upper = info.get(name, {}).get("upper")
        if (
            {made[0], made[-1]} <= stage.coefficients.keys()
            and slender(problem.vehicle)
            and upper is not None
        ):
            change = problem.with_strips(name, (0.0, float(upper)), SETTINGS.drag[0])
            other = next(s for s in change.stages if s.name == stage.name)
            fits[name] = _with_damping(change, other, chosen, name, threads)
    strips = min(fits, key=lambda name: float(fits[name].unseen.sum()))
    best, rivals = fits[strips], [fit for name, fit in fits.items() if name != strips]
    likelier = min((0.5 * float((fit.unseen - best.unseen).sum()) for fit in rivals), default=0.0)
    estimate = EventEstimate(
        stage.name,
        few.axes,
        chosen,
        best.windows.parameters,
        tuple(best.values.tolist()),
        _mixed(best, rivals),
        tuple(zip(best.prior[0].tolist(), best.prior[1].tolist(), strict=True)),
        (),
        "strips" if strips else "quadratic",
        likelier,
        strips,
    )
    estimate = replace(estimate, verdicts=_verdicts(best, estimate.covariance))
    gains = [
        verdict
        for parameter, verdict in zip(estimate.parameters, estimate.verdicts, strict=True)
        if parameter.name.endswith(".gain")
    ]
    # A motion that the simulation hardly shows is that of the waves, whatever its coefficients.
    shown = best.windows.explained(best.point, few.axes) >= SETTINGS.explained
    known = "identifiable" in (gains or estimate.verdicts) and set(gains) <= {"identifiable"}
    return estimate if shown and known else few


def _with_damping(
    problem: Problem,
    stage: Stage,
    chosen: Sequence[Event],
    strips: str,
    threads: int | None,
    begun: Sequence[float] = (),
) -> _Fit:
    """Estimate of a stage on events: of their first half, which is nearly linear, then of all.

    From values that are ``begun`` on all at once.
    """
    vehicle = problem.vehicle
    if strips:
        replaced = (STRIPS[strips][0], STRIPS[strips][-1])
        vehicle = vehicle.with_coefficients(dict.fromkeys(replaced, 0.0) | {strips: SETTINGS.drag[0]})
    channels = dict.fromkeys(
        _ANGLE[channel] if all(_ANGLE.get(channel) in problem.trials[n].channels for n in stage.trials)
        else channel
        for channel in stage.weights()
    )  # fmt: skip
    stage = stage.model_copy(update={"channels": dict.fromkeys(channels, 1.0)})
    windows = _Windows(problem, stage, chosen, vehicle, threads)
    known = _known(windows.parameters)
    if len(begun):
        return _estimate(windows, np.array(begun), known)
    start = np.array([parameter.start for parameter in windows.parameters])
    # Without linear damping a hull that the file makes unstable runs away: the second start has some.
    damped = [float(p.start == p.upper == 0.0) * SETTINGS.damped * p.lower for p in windows.parameters]
    brief = [
        replace(event, stop_s=min(event.stop_s, event.start_s + EVENT_LIMITS.most_s / 2)) for event in chosen
    ]
    short = _Windows(problem, stage, brief, vehicle, threads)
    both = [_estimate(short, at, known, rounds=2) for at in (start, start + damped)]
    first = min(both, key=lambda fit: float(fit.deviances.sum()))
    return _estimate(windows, first.values, known)


def _known(chosen: Sequence[Parameter]) -> tuple[Array, Array]:
    """Prior values and deviations (m,): stated, of cross-flow drag, else the width of the bounds."""
    made = {name for strips in STRIPS.values() for name in (strips[0], strips[-1])}
    centre = np.array([parameter.start for parameter in chosen])
    sd = np.array([min(parameter.upper - parameter.lower, parameter.sd) for parameter in chosen])
    for place, parameter in enumerate(chosen):
        if math.isfinite(parameter.sd):
            continue
        if parameter.name in STRIPS:
            centre[place], sd[place] = SETTINGS.drag
        elif parameter.name in made and parameter.start:
            # The vehicle file's own value, or that of its geometry.
            sd[place] = SETTINGS.damping * abs(parameter.start)
    return centre, sd


def _mixed(best: _Fit, rivals: Sequence[_Fit]) -> Array:
    """Covariance (m, m) of the likelier estimate, as much wider as the other forms of damping make it."""
    names = [parameter.name for parameter in best.windows.parameters]
    weights = np.exp(-0.5 * np.array([(fit.unseen - best.unseen).sum() for fit in rivals]))
    share = weights / (1.0 + weights.sum())
    own = np.diag(best.covariance)
    variance = own * (1.0 - share.sum())
    for weight, fit in zip(share.tolist(), rivals, strict=True):
        others = {parameter.name: place for place, parameter in enumerate(fit.windows.parameters)}
        for place, name in enumerate(names):
            other = others.get(name)
            away = 0.0 if other is None else fit.values[other] - best.values[place]
            spread = own[place] if other is None else fit.covariance[other, other]
            variance[place] += weight * (spread + away**2)
    wider = np.sqrt(np.maximum(variance / own, 1.0))
    return np.asarray(best.covariance * np.outer(wider, wider))


def _verdicts(fit: _Fit, covariance: Array) -> tuple[str, ...]:
    """Verdict per parameter: deviation over natural size, and over what was known beforehand."""
    width = fit.windows.upper - fit.windows.lower
    size = np.clip(np.abs(fit.values), 0.1 * width, width / math.sqrt(12.0))
    sigma = np.sqrt(np.diag(covariance))
    verdicts = []
    known = zip(fit.inside & ~fit.bent, sigma / size, sigma / fit.prior[1], strict=True)
    for sound, relative, share in known:
        if not sound or relative >= ABSENT:
            verdicts.append("not identifiable")
        else:
            verdicts.append("identifiable" if relative <= WEAK and share <= TOLD else "weak")
    return tuple(verdicts)
