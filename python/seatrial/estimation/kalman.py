"""Kalman filter along the measured motion: what the model and all measurements so far say of the state.

The state is that of `seatrial.estimation.one_step` as a deviation from the motion that the derivatives are
taken at, and what drives it besides the model:

- per simulated axis a white acceleration;
- per axis a slow one, first-order Gauss-Markov (`NoiseSettings.slow_s`): gusts, bias of the model;
- a slow velocity of the water, north and east, a random walk;
- where the log shows waves, at the frequency of its peak, the velocity of the water in them, north, east and
  down, and per axis an acceleration: what a wave pushes besides. Each is the rate of a shaping filter
  ``s'' + 2 zeta omega s' + omega^2 s = noise`` (Fossen 2021, section 10.2). A vehicle that sails through
  waves of omega_0 meets them at ``omega = |omega_0 - omega_0^2 / g (v . d)|``, with v its velocity through
  the water and d where they go, so that omega changes from leg to leg; the bandwidth ``zeta omega`` stays.
  What waves do at a depth z is ``exp(-k z)`` of what they do at the surface, ``k = omega_0^2 / g``.

Water that moves as a whole carries a vehicle with it that displaces its own mass: the pressure gradient that
drives the water drives the vehicle. Beside this water the vehicle moves as in still water. A velocity of the
state is therefore that beside the water of the waves, and the measured one the sum of both. Without that,
waves push each axis for a reason of its own, and the fins that answer them look weak. A hull that is long
beside the waves, or heavy for its volume, is not carried: the water flows past it and acts by drag and lift
alone. In a turn, where the cross-flow is strong already, that disturbs the motion far more than on a straight
leg. Which of the two it is the likelihood says (``NoiseModel.carried``).

The intensities of all noises are those of the largest likelihood of the innovations, whose exact slopes the
core gives (Koopman 1993). Expectation maximisation has the same fixed point and shrinks a noise that is
hardly there by a tenth per step. Derivatives of the state by the unknowns run through the same recursion
with the gains held (Ljung 1999, chapter 7), so that a parameter does not gain from what the filter corrects
anyway.

Held by ``tests/estimation/test_kalman.py``, ``tests/estimation/test_innovations.py``.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np

from seatrial.base.arrays import Array
from seatrial.estimation.estimator import FilterLayout, NoiseModel
from seatrial.estimation.one_step import Motion, Span
from seatrial.inspect.waves import BROAD, peak, spectra

if TYPE_CHECKING:
    from seatrial._core import LinearModel


_T = TypeVar("_T")

GRAVITY = 9.81
"""Acceleration of gravity, m/s2."""


@dataclass(frozen=True)
class NoiseSettings:
    """The noises that a filter begins with, and how far they are sought."""

    #: Time constant of the slow accelerations, s: gusts, and bias of the model.
    slow_s: float = 30.0
    #: Damping ratio of a wave's shaping filter to begin with.
    damping: float = 0.05
    #: Factor between the damping ratios that are compared.
    broader: float = 1.7
    #: Least and largest damping ratio.
    damping_range: tuple[float, float] = (0.01, 0.4)
    #: Factor between the frequencies that are compared.
    faster: float = 1.06
    #: Directions of the waves that are compared first.
    courses: int = 8
    #: Turn between the directions that follow, rad.
    turn: float = math.pi / 16.0
    #: Spread of the frequencies of encounter, over their own, from which they tell a direction.
    least_encounters: float = 0.01
    #: Lowest frequency of encounter that is taken, a share of the waves' own.
    slowest_encounter: float = 0.5
    #: Log-likelihood by which another model of the waves must be better.
    worth: float = 1.0
    #: Turns in which breadth, frequency and direction are sought.
    turns: int = 3
    #: Standard deviation of the velocity of the water at the start of a span, m/s.
    current_sd: float = 0.3
    #: Standard deviation of its change to begin with, m/s per sample.
    walk: float = 1e-4
    #: Standard deviation of the velocity of the water in waves to begin with, m/s.
    orbit: float = 0.1
    #: What places and angles miss of their rates to begin with, m/s and rad/s.
    slip: float = 1e-3
    #: Shortest span in which waves are sought, s.
    shortest_s: float = 80.0
    #: What the smoothed motion may be off where a span begins, m/s, rad/s, rad or m.
    start_sd: float = 0.3
    #: Largest fall of the logarithm of a variance in a search.
    down: float = 12.0
    #: Largest rise of it.
    up: float = 6.0
    #: Variance that stands for none: its logarithm is finite.
    nothing: float = 1e-14
    #: Largest change of a logarithm in the first step of a search. The search takes the steepest slope for
    #: it, up to the bounds: with the likelihood's own slopes of thousands all variances would be tried at
    #: their bounds, where the filter has no numbers, and the search ends.
    first_step: float = 2.0
    #: Cost above the best, in units of the search, of noises with which a filter diverges.
    impossible: float = 100.0


SETTINGS = NoiseSettings()


def wave_frequency(spans: Sequence[Span], velocities: int, dt: float) -> float | None:
    """Frequency of the waves, Hz; None where the log shows none.

    What one step of the model misses, as an acceleration, has the spectrum of what it does not know, and
    waves leave a `peak` on it, of the translations where any is simulated.
    """
    longest = max(spans, key=lambda span: len(span.missed))
    if len(longest.missed) * dt < SETTINGS.shortest_s:
        return None
    motion = spectra(longest.missed[:, :velocities] / dt, dt).integrated()
    carried = np.abs(spans[0].afloat[:, :velocities]).max(axis=(0, 2)) > 0.5  # along with the water
    return peak(motion.of(carried) if any(carried) else motion, BROAD)


def begin(spans: Sequence[Span], velocities: int, dt: float) -> NoiseModel:
    """A noise model to start from: shares of what one step of the model misses."""
    wave_hz = wave_frequency(spans, velocities, dt)
    waved = tuple(range(velocities)) if wave_hz is not None else ()
    carried = np.abs(spans[0].afloat[:, :velocities]).max(axis=(0, 1)) > 0.5  # in these directions
    water = tuple(np.flatnonzero(carried).tolist()) if wave_hz is not None else ()
    states = spans[0].transition.shape[1]
    missed = np.concatenate([span.missed for span in spans])
    size = np.maximum(missed.std(axis=0)[:velocities] / dt, 1e-6)
    at = FilterLayout(states, velocities, len(waved), len(water))
    process = np.zeros(at.width)
    process[at.speeds] = (0.3 * size * dt) ** 2
    process[at.poses] = (SETTINGS.slip * dt) ** 2
    process[at.slow] = (0.3 * size) ** 2 * 2.0 * dt / SETTINGS.slow_s
    omega = 2.0 * math.pi * (wave_hz or 0.0)
    for push, axis in zip(at.pushes, waved, strict=True):
        process[push + 1] = (0.5 * size[axis]) ** 2 * 4.0 * SETTINGS.damping * omega * dt
    process[at.orbit_rates] = _orbit(wave_hz or 0.0, SETTINGS.damping, dt)
    process[at.current] = SETTINGS.walk**2
    sensors = np.full(spans[0].measured.shape[1], 1e-4)
    for column in range(len(sensors)):
        jumps = np.concatenate([np.diff(span.measured[span.valid[:, column], column]) for span in spans])
        if len(jumps):
            sensors[column] = max(float(np.mean(jumps**2)) / 2.0, 1e-8)
    return NoiseModel(process, sensors, wave_hz, waved, water, SETTINGS.damping)


def shaped(
    spans: Sequence[Span],
    noise: NoiseModel,
    dt: float,
    seen: Sequence[int],
    evaluations: int,
    threads: int | None,
) -> NoiseModel:
    """The noise model with the direction, frequency and damping ratio of the waves of largest likelihood.

    The peak of a spectrum is not the frequency that foretells best, a sea is broader or narrower than the
    ratio that the filter begins with, and it is met at another frequency on every course. The autopilot
    answers what of its waves the filter does not foresee, so that a wrong model of them bends the gains.
    Values a step apart are compared in turn, upwards first, each with so many evaluations of the likelihood
    for its intensities. Whether the water of the waves carries the vehicle or flows past it is tried first.
    """
    if noise.wave_hz is None:
        return noise

    def improved(model: NoiseModel) -> tuple[float, NoiseModel]:
        likelihood, better, _ = Filters(spans, model, dt, seen, threads).likeliest(model, evaluations)
        return likelihood, better

    def towards(best: tuple[float, NoiseModel], step: _Step) -> tuple[float, NoiseModel]:
        """The best along one line, or the same."""
        while True:
            moved = step.of(best[1])
            if not SETTINGS.damping_range[0] <= moved.damping <= SETTINGS.damping_range[1]:
                return best
            other = improved(moved)
            if not other[0] > best[0] + SETTINGS.worth:
                return best
            best = other

    # Intensities first, then whether the water of the waves carries the vehicle or flows past it.
    best = improved(noise)
    if noise.water:
        other = improved(_otherwise(best[1], dt))
        best = other if other[0] > best[0] + SETTINGS.worth else best
    # A direction of the waves explains why they are met at another frequency on every course.
    if noise.toward is None:
        courses = [
            _towards(spans, best[1], 2.0 * math.pi * k / SETTINGS.courses) for k in range(SETTINGS.courses)
        ]
        known = [course for course in courses if course is not None]
        if known:
            other = improved(
                max(known, key=lambda course: Filters(spans, course, dt, seen, threads).likelihood(course))
            )
            best = other if other[0] > best[0] + SETTINGS.worth else best
    # Line searches along breadth, frequency and direction in turn, until none of them gains.
    steps = [_Step(broader=SETTINGS.broader), _Step(faster=SETTINGS.faster)]
    if best[1].toward is not None:
        steps.insert(0, _Step(turned=SETTINGS.turn))
    for _ in range(SETTINGS.turns):
        before = best[0]
        for step in steps:
            along = towards(best, step)
            best = towards(best, step.back()) if along is best else along
        if best[0] == before:
            break
    return best[1]


class _Step(NamedTuple):
    """From one model of the waves to the next: factors of damping ratio and frequency, and a turn, rad."""

    broader: float = 1.0
    faster: float = 1.0
    turned: float = 0.0

    def of(self, noise: NoiseModel) -> NoiseModel:
        assert noise.wave_hz is not None
        model = noise.shaped(noise.wave_hz * self.faster, noise.damping * self.broader)
        return model if model.toward is None else replace(model, toward=model.toward + self.turned)

    def back(self) -> _Step:
        return _Step(1.0 / self.broader, 1.0 / self.faster, -self.turned)


def _otherwise(noise: NoiseModel, dt: float) -> NoiseModel:
    """The same waves, whose water flows past the vehicle in place of carrying it, or the other way round."""
    assert noise.wave_hz is not None
    process = noise.process.copy()
    process[noise.layout(0).orbit_rates] = _orbit(noise.wave_hz, noise.damping, dt)
    return replace(noise, process=process, carried=not noise.carried)


def _orbit(wave_hz: float, damping: float, dt: float) -> float:
    """Variance per sample that keeps the water of waves at `orbit`."""
    return SETTINGS.orbit**2 * 4.0 * damping * 2.0 * math.pi * wave_hz * dt


def _towards(spans: Sequence[Span], noise: NoiseModel, toward: float) -> NoiseModel | None:
    """The same waves, going somewhere and met at the same frequency on average; None on one course only."""
    assert noise.wave_hz is not None
    along = np.concatenate([span.through for span in spans]) @ [math.cos(toward), math.sin(toward)]
    slower = 2.0 * math.pi * noise.wave_hz / GRAVITY * along
    if not slower.std() >= SETTINGS.least_encounters:  # nor where the velocity is not a number
        return None
    return replace(noise.shaped(noise.wave_hz * (1.0 + float(slower.mean())), noise.damping), toward=toward)


class Filters:
    """The filters of some spans with the noises of one kind, whose variances are given at each call.

    ``dt``: time between samples, s. ``seen``: places of the measured channels in the state. ``threads``: all
    processors when None; no result depends on it.
    """

    def __init__(
        self,
        spans: Sequence[Span],
        noise: NoiseModel,
        dt: float,
        seen: Sequence[int],
        threads: int | None = None,
    ) -> None:
        self.spans, self.dt, self.threads = spans, dt, threads
        self.states = spans[0].transition.shape[1]
        sizes = _sizes(spans, noise)
        self._models = [_model(span, noise, dt, seen, size) for span, size in zip(spans, sizes, strict=True)]

    def predicted(self, noise: NoiseModel, ahead: int) -> list[Array]:
        """Per span what the channels are predicted to show so many samples after each measurement.

        (n - ahead, Y, 1 + m): as deviations from the motion that the derivatives are taken at, then the
        derivatives by the unknowns.
        """
        start = self._start(noise)
        return self._each(lambda model: np.asarray(model.predict(noise.process, noise.sensors, start, ahead)))

    def likeliest(self, noise: NoiseModel, evaluations: int) -> tuple[float, NoiseModel, list[Motion]]:
        """Intensities of larger likelihood than those of a noise model, with it, and per span the motion.

        A quasi-Newton search over the logarithms of the variances.
        """
        from scipy.optimize import minimize

        driven = noise.process > 0.0
        sensed = np.any([span.valid.any(axis=0) for span in self.spans], axis=0)
        tried: list[tuple[float, NoiseModel, list[Motion]]] = []
        scale: list[float] = []

        def negative(logarithms: Array) -> tuple[float, Array]:
            process, sensors = noise.process.copy(), noise.sensors.copy()
            process[driven], sensors[sensed] = np.split(np.exp(logarithms), [int(driven.sum())])
            model = replace(noise, process=process, sensors=sensors)
            likelihood, by_process, by_sensors, motion = self._judged(model)
            # An impossible model is worse than the best so far, with no slope: the line search turns back.
            if not math.isfinite(likelihood) and tried:
                return SETTINGS.impossible - tried[0][0] / scale[0], np.zeros_like(logarithms)
            tried.append((likelihood, model, motion))
            best = max(tried, key=lambda trial: trial[0])
            tried[:] = [best]
            slope = np.concatenate([(by_process * process)[driven], (by_sensors * sensors)[sensed]])
            # Scaled so that the first step changes no logarithm of a variance by more than is sensible.
            if not scale:
                largest = float(np.abs(slope).max(initial=0.0)) / SETTINGS.first_step
                scale.append(largest if 0.0 < largest < math.inf else 1.0)
            return -likelihood / scale[0], -slope / scale[0]

        start = np.log(np.concatenate([noise.process[driven], noise.sensors[sensed]]))
        minimize(
            negative,
            start,
            jac=True,
            method="L-BFGS-B",
            bounds=[(max(at - SETTINGS.down, math.log(SETTINGS.nothing)), at + SETTINGS.up) for at in start],
            options={"maxfun": evaluations, "maxcor": 20},
        )
        return tried[0]

    def likelihood(self, noise: NoiseModel) -> float:
        """Logarithm of the likelihood of all spans with a noise model, without its constant."""
        return float(sum(values.sum() for values in self.likelihoods(noise)))

    def likelihoods(self, noise: NoiseModel) -> list[Array]:
        """What each sample of every span adds to it."""
        start = self._start(noise)
        return self._each(lambda model: model.likelihood(noise.process, noise.sensors, start))

    def motion(self, noise: NoiseModel) -> list[Motion]:
        """The motion of each span with a noise model."""
        return self._judged(noise)[-1]

    def _judged(self, noise: NoiseModel) -> tuple[float, Array, Array, list[Motion]]:
        """Likelihood of a noise model, its slopes by the process and sensor variances, and the motion."""
        start, current = self._start(noise), noise.layout(self.states).current
        # The core gives the states of the model and the current; what lies between them is no motion.
        kept = [*range(self.states), *range(current.start, current.stop)]
        judged = self._each(lambda model: model.judge(noise.process, noise.sensors, start, kept))
        motion = [
            Motion(*np.split(smoothed, [self.states], axis=1), *np.split(known, [self.states], axis=1))
            for *_, smoothed, known in judged
        ]
        return (
            sum(row[0] for row in judged),
            np.sum([row[1] for row in judged], axis=0),
            np.sum([row[2] for row in judged], axis=0),
            motion,
        )

    def _start(self, noise: NoiseModel) -> Array:
        """Variances (N,) of the first state of a span."""
        at, start = noise.layout(self.states), np.zeros(len(noise.process))
        start[: self.states] = SETTINGS.start_sd**2
        start[at.slow] = np.maximum(noise.process[at.slow] * SETTINGS.slow_s / (2.0 * self.dt), 0.0)
        for wave in (*at.pushes, *at.orbits):  # displacement, and the rate behind it
            omega = 2.0 * math.pi * (noise.wave_hz or 0.0)
            start[wave + 1] = noise.process[wave + 1] / (4.0 * noise.damping * omega * self.dt)
            start[wave] = start[wave + 1] / omega**2
        start[at.current] = SETTINGS.current_sd**2
        return start

    def _each(self, work: Callable[[LinearModel], _T]) -> list[_T]:
        count = min(len(self._models), self.threads or os.cpu_count() or 1)
        if count <= 1:
            return [work(model) for model in self._models]
        with ThreadPoolExecutor(count) as pool:
            return list(pool.map(work, self._models))


def _sizes(spans: Sequence[Span], noise: NoiseModel) -> list[Array]:
    """What waves do at the depth of each sample (n,) per span, of their root mean square over all of them.

    A span whose depth was not measured counts as one at that mean.
    """
    number = (2.0 * math.pi * (noise.wave_hz or 0.0)) ** 2 / GRAVITY
    depth = np.concatenate([span.depth for span in spans])
    depth = depth[np.isfinite(depth)]
    least = float(depth.min(initial=math.inf))
    mean = float(np.sqrt(np.mean(np.exp(-2.0 * number * (depth - least))))) if depth.size else 1.0
    return [np.nan_to_num(np.exp(-number * (span.depth - least)) / mean, nan=1.0) for span in spans]


def _model(span: Span, noise: NoiseModel, dt: float, places_seen: Sequence[int], size: Array) -> LinearModel:
    """The model of a span and of what drives it, as the core reads it; waves are of a ``size`` (n,)."""
    from seatrial._core import LinearModel

    steps, states = span.missed.shape
    at = noise.layout(states)
    transition = np.zeros((steps, states, at.width))
    transition[:, :, :states] = span.transition
    transition[:, :, at.current] = span.current[:, :, :2]
    # An acceleration acts throughout the step, on the angles too: the mean of what it does at both ends.
    push = 0.5 * dt * (np.eye(states) + span.transition)[:, :, : at.velocities]
    slow = math.exp(-dt / SETTINGS.slow_s)
    turn = _turns(span, noise, dt)
    mean = (0.5 * size[:-1, None] * (turn[:, 1] + np.array([0.0, 1.0])))[:, None]
    places: list[tuple[int, int]] = []
    driven: list[Array] = []

    def drive(row: int, column: int, values: Array | float) -> None:
        places.append((row - states, column))
        driven.append(np.broadcast_to(values, steps))

    for place in range(at.slow.start, at.slow.stop):
        drive(place, place, slow)
    transition[:, :, at.slow] = 0.5 * (1.0 + slow) * push
    for wave in (*at.pushes, *at.orbits):
        for row, column in np.ndindex(2, 2):
            drive(wave + row, wave + column, turn[:, row, column])
    for place in range(at.current.start, at.current.stop):
        drive(place, place, 1.0)
    # What a channel shows: its own state and, of a velocity, the water of the waves.
    seen: list[tuple[int, int]] = []
    shown: list[Array] = []

    def show(channel: int, column: int, values: Array | float) -> None:
        seen.append((channel, column))
        shown.append(np.broadcast_to(values, steps + 1))

    water = list(zip(at.orbits, noise.water, strict=True))
    for channel, state in enumerate(places_seen):
        show(channel, state, 1.0)
        if state < at.velocities and noise.carried:
            # The state's velocity is that beside the water of the waves, the measured one that over ground.
            for orbit, direction in water:
                show(channel, orbit + 1, size * span.afloat[:, state, direction])
    for wave, axis in zip(at.pushes, noise.waved, strict=True):
        transition[:, :, wave : wave + 2] = push[:, :, axis, None] * mean
    for orbit, direction in water:
        if noise.carried:  # places move with the water too
            moving = span.afloat[:-1, at.velocities :, direction, None]
            transition[:, at.poses, orbit : orbit + 2] = moving * (dt * mean)
        else:
            transition[:, :, orbit : orbit + 2] = span.current[:, :, direction, None] * mean
    drift = np.zeros((steps, at.width))
    drift[:, :states] = span.missed
    drift[:, at.current] = -np.diff(span.water, axis=0)  # the state is the water beside that
    start = np.zeros(at.width)
    start[at.current] = -span.water[0]
    return LinearModel(
        transition=transition,
        places=places,
        driven=np.stack(driven, axis=1),
        seen=seen,
        shown=np.stack(shown, axis=1),
        measured=span.measured,
        valid=span.valid,
        drift=drift,
        slopes=span.unknowns,
        start=start,
    )


def _turns(span: Span, noise: NoiseModel, dt: float) -> Array:
    """Transition (n - 1, 2, 2) of a wave's shaping filter over each step of a span."""
    omega_0 = 2.0 * math.pi * (noise.wave_hz or 1.0)
    met = np.full(len(span.missed), omega_0)
    if noise.toward is not None:
        along = span.through[:-1] @ [math.cos(noise.toward), math.sin(noise.toward)]
        met = np.maximum(np.abs(omega_0 - omega_0**2 / GRAVITY * along), SETTINGS.slowest_encounter * omega_0)
    decay = noise.damping * omega_0
    damped = np.sqrt(met**2 - decay**2)
    cosine, sine = np.cos(damped * dt), np.sin(damped * dt) / damped
    rows = [[cosine + decay * sine, sine], [-(met**2) * sine, cosine - decay * sine]]
    return np.asarray(math.exp(-decay * dt) * np.moveaxis(np.array(rows), 2, 0))
