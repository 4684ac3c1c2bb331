"""Output error on events: generalised least squares of stretches in which a command is held, in waves.

Each event is simulated from a second before its command changes, with its own start and current as nuisance
parameters. The waves stay in the residual. Least squares would take their narrow band for white noise and
count a hundred samples of one wave as a hundred measurements. The residuals of each channel are weighted by
the inverse of a stationary covariance, a sum of non-negative terms fitted to their autocovariance
(non-negative least squares, Lawson and Hanson 1974): white noise, slow errors ``(1 + tau/b) exp(-tau/b)``,
and waves ``exp(-tau/a) cos(omega tau)`` on a grid of frequencies. Estimate and covariance are found in turn
(feasible generalised least squares, Greene, *Econometric Analysis* (2012), section 9.3).

Deviations are the larger of the inverse information and of a jackknife over the events.

Tests: ``tests/identification/test_event_estimates.py``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from seatrial._core import initial_names, nuisance_names
from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import AXES, CHANNELS, deviations
from seatrial.estimation.segment_model import SegmentModel, StageData, cut, stage_step
from seatrial.inspect.feedback import EVENT_LIMITS, Event
from seatrial.problem.parameter import parameters
from seatrial.scoring.record import restarted

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.problem.problem import Problem
    from seatrial.problem.settings import Stage


@dataclass(frozen=True)
class EventSettings:
    """Thresholds of an estimate on events."""

    #: Events from which their scatter tells a deviation: the jackknife of fewer has under four degrees of
    #: freedom.
    fewest: int = 5
    #: Events at most, spread over the trials: of more, every second or third.
    most: int = 20
    #: Part of an axis' motion within its events that the simulation has to show: of less, waves are most.
    explained: float = 0.5
    #: Decay of the waves' covariance and memory of slow errors, s: a swell keeps its phase for some periods,
    #: a wind sea for less.
    decays_s: tuple[float, ...] = (4.0, 10.0, 25.0)
    memories_s: tuple[float, ...] = (0.3, 1.0, 3.0, 10.0)
    #: Frequencies of waves: periods of 2 to 16 s, closer than the width that a decay of 25 s smears.
    waves_rad_s: tuple[float, ...] = tuple(np.linspace(0.4, 3.2, 15).tolist())
    #: Prior deviations of an event's own current, m/s, and of its start: m/s and rad/s, rad, m. They are
    #: wide; the event tells them.
    current: float = 0.1
    velocity: float = 0.3
    angle: float = 0.1
    place: float = 0.5
    #: Cross-flow drag coefficient of a hull known beforehand, value and deviation: 0.7 to 1.2, cylinders and
    #: ellipses of finite length (White 2011, table 7.3; Hoerner 1965, chapter 3).
    drag: tuple[float, float] = (0.95, 0.25)
    #: Deviation of quadratic damping about the vehicle's value, over it: that of ``drag``.
    damping: float = 0.3
    #: Distance from a bound, over the width of the bounds, from which a value lies inside them.
    at_bound: float = 1e-3
    #: Deviations beyond a bound from which the data contradict it; deviations and part of its value by which
    #: a coefficient moves without such bounds that makes up for them: as in `seatrial.diagnosis.assessment`.
    beyond: float = 3.0
    moved: tuple[float, float] = (2.0, 0.05)
    #: Linear damping of the second start, over its lower bound: an unstable hull without any runs away.
    damped: float = 0.05
    #: Largest error or derivative, SI: beyond it the simulation of an event has diverged.
    diverged: float = 1e6
    #: Estimates and covariances in turn at most (three settle it), and the change of an estimate, in its
    #: deviations, from which a round is the last.
    rounds: int = 6
    settled: float = 0.1
    #: Steps of a round at most, and the part of its cost that its last one gains: the covariance changes
    #: more.
    steps: int = 25
    little: float = 1e-5


SETTINGS = EventSettings()

_NUISANCES, _INITIALS = tuple(nuisance_names()), tuple(initial_names())

_CURRENTS = ("current_north", "current_east")

ANGLE_OF = {"p": "roll", "q": "pitch", "r": "yaw"}


class EventWindows:
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
            channel = velocity if velocity in self.channels else ANGLE_OF.get(velocity, "")
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
    # Without it interpolated samples, whose autocovariance has no jump at lag zero, would weigh infinitely.
    bends = np.concatenate([np.diff(error, 2) for error in errors])
    fitted[0] += max(float(bends @ bends) / (6.0 * len(bends)) - share[0], 1e-4 * total[0] / counts[0], 1e-18)
    return np.asarray(cholesky(toeplitz(fitted), lower=True))


@dataclass(frozen=True)
class EventFit:
    """Estimate on events.

    ``point`` are all unknowns, ``prior`` centres and deviations (m,); per event, without its own unknowns,
    the ``information`` (events, m, m), the downhill ``gradients`` (events, m) and ``deviances`` (events,),
    minus twice the log-likelihood; priors are in none of these.
    """

    windows: EventWindows
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


def estimate_on_events(
    windows: EventWindows, start: Array, known: tuple[Array, Array], rounds: int = SETTINGS.rounds
) -> EventFit:
    """Generalised least squares on events from a start (m,), with prior values and deviations (m,)."""
    from scipy.linalg import block_diag, solve_triangular
    from scipy.optimize import least_squares

    count, own = len(start), len(windows.own_sd)
    x = np.concatenate([np.clip(start, windows.lower, windows.upper), np.zeros(windows.events * own)])
    free = np.full(windows.events * own, np.inf)
    bounds = np.concatenate([windows.lower, -free]), np.concatenate([windows.upper, free])
    prior_sd = np.concatenate([known[1], np.tile(windows.own_sd, windows.events)])
    centre = np.concatenate([known[0], np.zeros(len(free))])
    scale = windows.model.data.scale[windows.used]
    n = max(map(len, windows.counted))
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

    for turn in range(rounds):
        if turn:
            errors = windows.errors(x)
            factors = [
                _covariance([e[m[:, c], c] for e, m in zip(errors, windows.counted, strict=True)], windows.dt)
                for c in range(len(scale))
            ]
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
        change, x = np.abs(result.x[:count] - x[:count]), result.x
        deviation = np.sqrt(np.diag(np.linalg.inv(result.jac.T @ result.jac))[:count])
        # The first covariance is white and the second that of its residuals: a third may be like it.
        if turn and np.all(change <= SETTINGS.settled * deviation):
            break
    return _reduced(windows, x, known, whitened(windows.errors(x)), whitened(windows.slopes(x)), factors)


def _reduced(
    windows: EventWindows,
    x: Array,
    known: tuple[Array, Array],
    errors: Sequence[Array],
    slopes: Sequence[Array],
    factors: Sequence[Array],
) -> EventFit:
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
    return EventFit(windows, x, known, np.array(information), np.array(gradients), np.array(deviances))
