"""Kalman filter along the measured motion: what the model and all measurements so far say of the state.

The state is that of `seatrial.estimation.one_step` as a deviation from the smoothed motion, and what drives
it besides the model, per simulated axis as an acceleration:

- a white part;
- a slow one, first-order Gauss-Markov with the time constant `SLOW_S`: gusts, bias of the model;
- where the log shows waves, a shaping filter ``w'' + 2 zeta omega w' + omega^2 w = noise`` whose rate acts
  (Fossen 2021, section 10.2), at the frequency of the log's peak;
- the velocity of the water, north and east, a random walk.

Their intensities and those of the measurements are found by expectation maximisation of the likelihood of
the innovations (Shumway & Stoffer 1982), with the Rauch-Tung-Striebel smoother. Derivatives of the state by
the unknowns run through the same recursion with the gains held (Ljung 1999, chapter 7), so that a parameter
does not gain from what the filter corrects anyway.

Held by ``tests/estimation/test_innovations.py``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from seatrial.base.arrays import Array
from seatrial.estimation.noise_model import NoiseModel
from seatrial.estimation.one_step import Span

__all__ = ["Filtered", "ahead", "begin", "filtered", "improved", "wave_frequency"]

SLOW_S = 30.0
"""Time constant of the slow accelerations, s."""

DAMPING = 0.05
"""Damping ratio of a wave's shaping filter."""

_CURRENT_SD, _WALK = 0.3, 1e-4  # m/s, and m/s per sample to begin with

_SLIP = 1e-3  # m/s and rad/s: what places and angles miss of their rates to begin with

_CLIP = 4.0  # standard deviations from which an innovation counts as an outlier

_WINDOW_S = 40.0  # of the spectrum in which waves are sought

_BAND, _PROMINENT = (0.08, 0.6), 3.0  # Hz; power of a wave's peak over that beside it

_START_SD = 0.3  # m/s, rad/s, rad or m: what the smoothed motion may be off where a span begins

_NOTHING = 1e-14


@dataclass(frozen=True)
class Filtered:
    """Estimates after each sample of a span.

    ``state`` (n, N, 1 + m): deviation from the smoothed motion, then its derivatives by the unknowns.
    ``likelihood`` is the logarithm of that of the innovations, without its constant.
    """

    state: Array
    likelihood: float


def wave_frequency(spans: Sequence[Span], velocities: int, dt: float) -> float | None:
    """Frequency of the waves, Hz; None where the log shows none.

    What one step of the model misses, as an acceleration, has the spectrum of what it does not know. A wave
    stands out where the power around the peak of an axis is `_PROMINENT` times the geometric mean of those
    below and above it, which is one for a power of the frequency: slow forces alone are no wave.
    """
    from scipy.signal import welch

    longest = max(spans, key=lambda span: len(span.missed))
    window = round(_WINDOW_S / dt)
    if len(longest.missed) < 2 * window:
        return None
    hz, power = welch(longest.missed[:, :velocities] / dt, 1.0 / dt, nperseg=window, axis=0)
    best, found = _PROMINENT, None
    for peak in hz[(hz >= _BAND[0]) & (hz <= min(_BAND[1], 0.2 / dt))]:
        near = (hz > 0.8 * peak) & (hz < 1.25 * peak)
        around = power[near].mean(axis=0)
        below = power[(hz > 0.35 * peak) & (hz < 0.65 * peak)].mean(axis=0)
        above = power[(hz > 1.6 * peak) & (hz < 2.5 * peak)].mean(axis=0)
        prominence = around / np.maximum(np.sqrt(below * above), np.finfo(float).tiny)
        axis = int(prominence.argmax())
        if prominence[axis] > best:
            best = float(prominence[axis])
            found = float(hz[near] @ power[near, axis] / power[near, axis].sum())
    return found


def begin(spans: Sequence[Span], velocities: int, dt: float) -> NoiseModel:
    """A noise model to start from: shares of what one step of the model misses."""
    wave_hz = wave_frequency(spans, velocities, dt)
    waved = tuple(range(velocities)) if wave_hz is not None else ()
    states = spans[0].transition.shape[1]
    missed = np.concatenate([span.missed for span in spans])
    size = np.maximum(missed.std(axis=0)[:velocities] / dt, 1e-6)
    process = np.zeros(_width(states, velocities, waved))
    process[:velocities] = (0.3 * size * dt) ** 2
    process[velocities:states] = (_SLIP * dt) ** 2
    process[states : states + velocities] = (0.3 * size) ** 2 * 2.0 * dt / SLOW_S
    for k, axis in enumerate(waved):
        omega = 2.0 * math.pi * (wave_hz or 0.0)
        process[states + velocities + 2 * k + 1] = (0.5 * size[axis]) ** 2 * 4.0 * DAMPING * omega * dt
    process[-2:] = _WALK**2
    sensors = np.full(spans[0].measured.shape[1], 1e-4)
    for column in range(len(sensors)):
        jumps = np.concatenate([np.diff(span.measured[span.valid[:, column], column]) for span in spans])
        if len(jumps):
            sensors[column] = max(float(np.mean(jumps**2)) / 2.0, 1e-8)
    return NoiseModel(process, sensors, wave_hz, waved)


def filtered(
    span: Span, noise: NoiseModel, dt: float, seen: Sequence[int], *, derivatives: bool = True
) -> Filtered:
    """Estimates along a span; `seen` are the places of the measured channels in the state."""
    forward = _Forward(span, noise, dt, seen)
    return forward.run(1 + span.unknowns.shape[2] if derivatives else 1)


def improved(
    spans: Sequence[Span], noise: NoiseModel, dt: float, seen: Sequence[int]
) -> tuple[NoiseModel, list[Array]]:
    """One step of expectation maximisation over all spans, and the smoothed states (n, S) that it used."""
    driven, kept = np.zeros(len(noise.process)), np.zeros(len(noise.sensors))
    steps, samples = 0, np.zeros(len(noise.sensors))
    states = []
    for span in spans:
        forward = _Forward(span, noise, dt, seen)
        forward.run(1, keep=True)
        one, residuals, counted, path = forward.smoothed()
        states.append(path[:, : span.transition.shape[1]])
        driven, kept = driven + one, kept + residuals
        steps, samples = steps + len(span.missed), samples + counted
    process = np.where(noise.process > 0.0, np.maximum(driven / steps, _NOTHING), 0.0)
    sensors = np.where(samples > 0, np.maximum(kept / np.maximum(samples, 1), 1e-12), noise.sensors)
    return replace(noise, process=process, sensors=sensors), states


def ahead(span: Span, state: Array, noise: NoiseModel, dt: float, steps: int) -> Array:
    """States (n - steps, N, 1 + m) so many samples after those of the estimates, without measurements."""
    forward = _Forward(span, noise, dt, ())
    at = state[: len(state) - steps]
    for k in range(steps):
        at = forward.moved(slice(k, k + len(at)), at)
    return np.asarray(at)


def _width(states: int, velocities: int, waved: Sequence[int]) -> int:
    return states + velocities + 2 * len(waved) + 2


class _Forward:
    """Workspace of one run along a span."""

    def __init__(self, span: Span, noise: NoiseModel, dt: float, seen: Sequence[int]) -> None:
        from scipy.linalg import expm

        self.span, self.noise, self.seen = span, noise, np.asarray(seen, dtype=np.intp)
        steps, states = span.missed.shape
        velocities = (len(noise.process) - 2 - 2 * len(noise.waved)) - states
        width = len(noise.process)
        self.matrix = np.zeros((steps, width, width))
        self.matrix[:, :states, :states] = span.transition
        self.matrix[:, :states, -2:] = span.current
        # An acceleration acts throughout the step, on the angles too: the mean of what it does at both ends.
        push = 0.5 * dt * (np.eye(states) + span.transition)[:, :, :velocities]
        slow = math.exp(-dt / SLOW_S)
        omega = 2.0 * math.pi * (noise.wave_hz or 0.0)
        turn = expm(np.array([[0.0, 1.0], [-(omega**2), -2.0 * DAMPING * omega]]) * dt)
        own = np.zeros((width, width))
        for axis in range(velocities):
            own[states + axis, states + axis] = slow
            self.matrix[:, :states, states + axis] = 0.5 * (1.0 + slow) * push[:, :, axis]
        for k, axis in enumerate(noise.waved):
            at = states + velocities + 2 * k
            own[at : at + 2, at : at + 2] = turn
            mean = 0.5 * (turn[1] + np.array([0.0, 1.0]))
            self.matrix[:, :states, at : at + 2] = push[:, :, axis, None] * mean
        own[-2, -2] = own[-1, -1] = 1.0
        self.matrix += own
        self.driven = np.zeros((steps, width, 1 + span.unknowns.shape[2]))
        self.driven[:, :states, 0] = span.missed
        self.driven[:, :states, 1:] = span.unknowns
        start = np.zeros(width)
        start[:states] = _START_SD**2
        start[states:-2] = np.maximum(noise.process[states:-2] * SLOW_S / (2.0 * dt), 0.0)
        for k in range(len(noise.waved)):  # displacement and rate of a wave
            at = states + velocities + 2 * k
            start[at + 1] = noise.process[at + 1] / (4.0 * DAMPING * omega * dt)
            start[at] = start[at + 1] / omega**2
        start[-2:] = _CURRENT_SD**2
        self.start = start

    def moved(self, where: slice, state: Array) -> Array:
        """States one sample later, for samples side by side."""
        return np.asarray(self.matrix[where] @ state + self.driven[where][..., : state.shape[-1]])

    def run(self, columns: int, *, keep: bool = False) -> Filtered:
        """The filter; with `keep` what the smoother needs."""
        span, count = self.span, len(self.span.measured)
        width = len(self.start)
        state, spread = np.zeros((width, columns)), np.diag(self.start)
        every = np.empty((count, width, columns))
        self.predicted = np.empty((count, width)) if keep else None
        self.spreads = np.empty((2, count, width, width)) if keep else None
        likelihood = 0.0
        noise = np.diag(self.noise.process)
        for k in range(count):
            if self.predicted is not None and self.spreads is not None:
                self.predicted[k], self.spreads[0, k] = state[:, 0], spread
            here = np.flatnonzero(span.valid[k])
            if len(here):
                rows = self.seen[here]
                cross = spread[:, rows]
                size = cross[rows] + np.diag(self.noise.sensors[here])
                error = span.measured[k, here] - state[rows, 0]
                # An outlier moves the estimate no further than its bound: a bad ping does not throw it off.
                bound = _CLIP * np.sqrt(np.diag(size))
                error = np.clip(error, -bound, bound)
                inverse = np.linalg.inv(size)
                gain = cross @ inverse
                change = -state[rows]
                change[:, 0] = error
                state = state + gain @ change
                spread = spread - gain @ cross.T
                likelihood -= 0.5 * (float(error @ inverse @ error) + np.linalg.slogdet(size)[1])
            every[k] = state
            if self.spreads is not None:
                self.spreads[1, k] = spread
            if k + 1 < count:
                a = self.matrix[k]
                state = a @ state + self.driven[k, :, :columns]
                spread = a @ spread @ a.T + noise
                spread = 0.5 * (spread + spread.T)
        self.every = every
        return Filtered(every, likelihood)

    def smoothed(self) -> tuple[Array, Array, Array, Array]:
        """E[w^2] (N,) of the driving noise and E[v^2] (Y,) of sensors, summed over the span; states (n, N).

        The third entry counts the sensors' samples (Y,).
        """
        assert self.spreads is not None
        assert self.predicted is not None
        span, process = self.span, self.noise.process
        before, after = self.spreads
        state, spread = self.every[-1, :, 0], after[-1]
        driven, residuals = np.zeros(len(process)), np.zeros(span.measured.shape[1])
        ridge = 1e-12 * np.eye(len(process))
        path = np.empty((len(span.measured), len(process)))
        path[-1] = state

        def sensors(k: int) -> Array:
            error = np.abs(span.measured[k] - state[self.seen])
            error = np.minimum(error, _CLIP * np.sqrt(self.noise.sensors))
            return np.where(span.valid[k], error**2 + np.diag(spread)[self.seen], 0.0)

        residuals += sensors(len(span.measured) - 1)
        for k in range(len(span.missed) - 1, -1, -1):
            inverse = np.linalg.inv(before[k + 1] + ridge)
            step, loss = state - self.predicted[k + 1], before[k + 1] - spread
            share = process[:, None] * inverse  # Q P^-1: what of a step the driving noise explains
            w = share @ step
            driven += w**2 + process - np.einsum("ij,ij->i", share @ loss, share)
            back = after[k] @ self.matrix[k].T @ inverse
            state = self.every[k, :, 0] + back @ step
            spread = after[k] - back @ loss @ back.T
            residuals += sensors(k)
            path[k] = state
        return driven, residuals, span.valid.sum(axis=0).astype(float), path
