"""Baselines fitted to training trials: where a score takes them from.

Time constant T and dead time d of the first-order response are searched on a grid and refined; K and c follow
exactly, because the response restarted from nu_0 at t_0 is linear in them: with f the input through the lag,
``nu(t) = c (1 - a) + K (f(t) - a f(t_0)) + a nu_0, a = exp(-(t - t_0) / T)``. The linear model is fitted to
changes over a horizon, ``nu(t + h) - nu(t) = A int nu + B int s + ...`` (the integrals damp sensor noise,
which would bend the derivative's regression); the horizon that predicts the training windows best is taken.

Tests: ``tests/scoring/test_baselines.py``.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES, CHANNELS, VELOCITIES
from seatrial.base.errors import SeatrialError
from seatrial.scoring.baselines import (
    ANGLES,
    FORCES,
    Baselines,
    Driven,
    FirstOrder,
    Linear,
    exogenous,
    lagged,
)
from seatrial.scoring.windows import windows
from seatrial.trial.trial import Input, Trial

if TYPE_CHECKING:
    from seatrial._core import Vehicle


@dataclass(frozen=True)
class BaselineSettings:
    """How the simple predictors are fitted."""

    ahead_s: float = 10.0  #: Length of the windows, s, as a score has it.
    most_samples: int = 4000  #: Of an axis in the search of T and d, evenly taken from all windows.
    longest_lag_s: float = 60.0  #: Longest lag T that is tried, s.
    longest_dead_time_s: float = 3.0  #: Longest dead time d that is tried, s.
    lags: int = 13  #: Lags of the first grid.
    dead_times: int = 9  #: Dead times of the first grid.
    #: Horizons among which the linear model's is chosen, s.
    horizons_s: tuple[float, ...] = (1.0, 2.0, 5.0, 10.0)
    #: Singular values of the scaled regression below this part of the largest count as 0, by tries.
    smallest: tuple[float, float] = (1e-6, 1e-2)
    most_changes: int = 50_000  #: Of a trial in the regression of the linear model.
    samples_per_parameter: int = 30  #: Samples per parameter below which the linear model is not fitted.
    most_windows: int = 60  #: Of a trial that judge a linear model in the choice of its horizon.


SETTINGS = BaselineSettings()
_Filtered = dict[tuple[str, float, int], Array]
"""Signals behind a lag, by name, lag and trial: every axis tries the same ones."""


def fit_baselines(
    trials: Sequence[Trial] = (),
    *,
    vehicle: Vehicle | None = None,
    input: Input | None = None,
    free: str = "XYZKMN",
    measured: str = "",
    ahead_s: float = SETTINGS.ahead_s,
) -> Baselines:
    """Baselines fitted to training trials; without any, only "hold last".

    Masked samples do not count, so that a held-out part is masked. The vehicle turns commands into
    generalised forces; without it the commands themselves are inputs. `input` is the first of "commands",
    "measured" and "tau" that every trial has by default. `free` and `measured` are letters of the axes that
    are predicted and of those replayed; `ahead_s` is the length of the windows of the fit.
    """
    known = Baselines((), np.full(6, np.nan), {}, None, vehicle, input, free, measured)
    usable = [(trial, cut) for trial in trials if (cut := _spans(trial, ahead_s))]
    if not usable:
        return known
    mean = np.full(6, np.nan)
    for i, channel in enumerate(VELOCITIES):
        values = [trial.observed[trial.valid[:, i], i] for trial, _ in usable if channel in trial.channels]
        if any(len(samples) for samples in values):
            mean[i] = np.concatenate(values).mean()
    known = replace(known, trials=tuple(trial.name for trial, _ in usable), mean=mean)
    # Forces are taken at the mean velocity, and the linear model's dead time from the first-order responses.
    driven = [known.read(trial) for trial, _ in usable]
    spans = [own_spans for _, own_spans in usable]
    filtered: _Filtered = {}
    first_order = {
        VELOCITIES[i]: response
        for i in range(6)
        if AXES[i] in free and (response := _fit_first_order(i, driven, spans, filtered)) is not None
    }
    known = replace(known, first_order=first_order)
    fitted = replace(known, linear=_fit_linear(known, driven, spans))
    fitted.remember(driven)
    return fitted


def _spans(trial: Trial, ahead_s: float) -> list[tuple[int, int]]:
    """Windows of a training trial; none where none can start."""
    try:
        return windows(trial, ahead_s)[0]
    except SeatrialError:
        return []


def _varying(name: str, driven: Sequence[Driven]) -> bool:
    """Whether a signal is there in every training trial and not constant over them."""
    signals = [one.named(name) for one in driven]
    if any(s is None for s in signals):
        return False
    values = np.concatenate([s for s in signals if s is not None])
    return bool(np.ptp(values) > 1e-9 * max(1.0, float(np.abs(values).max())))


def _fit_first_order(
    i: int, driven: Sequence[Driven], spans: Sequence[Sequence[tuple[int, int]]], filtered: _Filtered
) -> FirstOrder | None:
    """Response of one axis on the training windows; None where the velocity is not recorded."""
    kept = [k for k, own in enumerate(driven) if VELOCITIES[i] in own.trial.channels]
    samples = [_Samples.of(i, driven[k], spans[k]) for k in kept]
    total = sum(len(part.y) for part in samples)
    if not total:
        return None
    samples = [part.thinned(max(1, total // SETTINGS.most_samples)) for part in samples]
    own = [driven[k] for k in kept]
    names = [
        name
        for name in dict.fromkeys(itertools.chain.from_iterable(record.signals for record in own))
        if name not in FORCES or name == FORCES[i]
        if _varying(name, own)
    ]
    dt = min(record.trial.dt for record in own)
    lags = np.geomspace(min(dt, 0.5 * SETTINGS.longest_lag_s), SETTINGS.longest_lag_s, SETTINGS.lags)
    dead = np.linspace(0.0, SETTINGS.longest_dead_time_s, SETTINGS.dead_times)

    def behind(name: str, lag: float) -> list[Array]:
        for record in own:
            if (key := (name, lag, id(record))) not in filtered:
                s = record.named(name) if name else None
                filtered[key] = np.zeros(len(record.trial)) if s is None else lagged(s, lag, record.trial.dt)
        return [filtered[name, lag, id(record)] for record in own]

    coarse = {name: _search(partial(behind, name), samples, lags, dead) for name in names}
    # The decay alone, for an axis that nothing drives.
    coarse[""] = _search(partial(behind, ""), samples, lags, dead[:1])
    best = min(coarse, key=lambda name: coarse[name][0])
    refined = coarse[best]
    ratio, step = lags[1] / lags[0], dead[1]
    for _ in range(3):
        around = refined[3] * ratio ** np.linspace(-1.0, 1.0, 7)
        near = np.clip(refined[4] + step * np.linspace(-1.0, 1.0, 7), 0.0, SETTINGS.longest_dead_time_s)
        finer = _search(partial(behind, best), samples, around, np.unique(near) if best else dead[:1])
        refined = min(refined, finer)
        ratio, step = ratio ** (1.0 / 3.0), step / 3.0
    _, gain, offset, lag, dead_time = refined
    return FirstOrder(best, gain, offset, lag, dead_time)


@dataclass(frozen=True, eq=False)
class _Samples:
    """Samples of one velocity in windows: value y, value `start` at the window's start, places of both."""

    y: Array
    start: Array
    at: NDArray[np.intp]
    begin: NDArray[np.intp]
    dt: float

    @classmethod
    def of(cls, i: int, own: Driven, spans: Sequence[tuple[int, int]]) -> _Samples:
        trial = own.trial
        at = [a + 1 + np.flatnonzero(trial.valid[a + 1 : b, i]) for a, b in spans]
        begin = np.concatenate([np.full(len(places), a) for places, (a, _) in zip(at, spans, strict=True)])
        places = np.concatenate(at)
        return cls(trial.observed[places, i], own.nu[begin, i], places, begin, trial.dt)

    def thinned(self, stride: int) -> _Samples:
        """Every stride-th of the samples."""
        return _Samples(
            self.y[::stride], self.start[::stride], self.at[::stride], self.begin[::stride], self.dt
        )


def _search(
    behind: Callable[[float], Sequence[Array]], samples: Sequence[_Samples], lags: Array, dead: Array
) -> tuple[float, float, float, float, float]:
    """Least sum of squares over lags and dead times: the sum, gain, offset, lag in s, dead time in s.

    ``behind`` gives the signals (n,) of all trials behind a lag.
    """
    y = np.concatenate([part.y for part in samples])
    start = np.concatenate([part.start for part in samples])
    elapsed = np.concatenate([(part.at - part.begin) * part.dt for part in samples])
    best = (np.inf, 0.0, 0.0, float(lags[0]), 0.0)
    first = np.cumsum([0, *(len(s) for s in behind(float(lags[0])))])[:-1].tolist()
    at, begin = [part.at for part in samples], [part.begin for part in samples]
    earlier = []
    for dead_time in dead.tolist():
        by = [dead_time / part.dt for part in samples]
        earlier.append((dead_time, _Earlier.of(at, first, by), _Earlier.of(begin, first, by)))
    for lag in lags.tolist():
        a = np.exp(-elapsed / lag)
        target, rest = y - a * start, 1.0 - a
        rr, rt, tt = float(rest @ rest), float(rest @ target), float(target @ target)
        signal = np.concatenate(behind(lag))
        for dead_time, now, begun in earlier:
            f = now.read(signal) - a * begun.read(signal)
            ff, fr, ft = float(f @ f), float(f @ rest), float(f @ target)
            determinant = ff * rr - fr * fr
            driven = determinant > 1e-9 * ff * rr
            gain = (ft * rr - fr * rt) / determinant if driven else 0.0
            offset = (rt - gain * fr) / rr if rr > 0.0 else 0.0
            best = min(best, (tt - gain * ft - offset * rt, gain, offset, lag, dead_time))
    return best


@dataclass(frozen=True, eq=False)
class _Earlier:
    """Where signals of several trials, one behind the other, are read some samples before given places.

    Linear between the samples ``near`` and ``far`` (m,) by the part (m,), constant before a trial's first.
    """

    near: NDArray[np.intp]
    far: NDArray[np.intp]
    part: Array

    @classmethod
    def of(
        cls, places: Sequence[NDArray[np.intp]], first: Sequence[int], samples: Sequence[float]
    ) -> _Earlier:
        """So many samples before the places of each trial, whose own first sample lies at ``first``."""
        near, far = (
            np.concatenate([
                np.maximum(at - int(by) - further, 0) + start
                for at, start, by in zip(places, first, samples, strict=True)
            ])
            for further in (0, 1)
        )
        part = [np.full(len(at), by - int(by)) for at, by in zip(places, samples, strict=True)]
        return cls(near, far, np.concatenate(part))

    def read(self, signal: Array) -> Array:
        """The signals at these places (m,)."""
        near = signal[self.near]
        if not self.part.any():
            return np.asarray(near)
        return np.asarray((1.0 - self.part) * near + self.part * signal[self.far])


def _fit_linear(
    known: Baselines, driven: Sequence[Driven], spans: Sequence[Sequence[tuple[int, int]]]
) -> Linear | None:
    """Linear model that predicts the training windows best among some horizons and two dead times."""
    recorded = [c for c in (*VELOCITIES, *ANGLES) if all(c in own.trial.channels for own in driven)]
    axis = {c: AXES[CHANNELS.index(c) % 6] for c in recorded}  # of an angle that of its rate
    states = [c for c in recorded if axis[c] in known.free and (c in VELOCITIES or _rate(c) in recorded)]
    if not states:
        return None
    replayed = [c for c in recorded if axis[c] in known.measured]
    forces = [name for name in FORCES if _varying(name, driven)]
    commands = [name for name in driven[0].signals if name not in FORCES and _varying(name, driven)]
    dead_times = [response.dead_time_s for response in known.first_order.values() if response.signal]
    typical = {0.0, float(np.median(dead_times)) if dead_times else 0.0}
    judged = [window for own, of in zip(driven, spans, strict=True) for window in _Judged.of(own, of, states)]
    best: tuple[float, Linear | None] = (np.inf, None)
    for pushing in [inputs for inputs in (forces, commands) if inputs] or [[]]:
        for dead_time, horizon in itertools.product(sorted(typical), SETTINGS.horizons_s):
            for tried in _regressions(tuple(states), (*replayed, *pushing), driven, dead_time, horizon):
                best = min(best, (_training_error(tried, judged), tried), key=lambda attempt: attempt[0])
    return best[1]


def _rate(angle: str) -> str:
    """Velocity channel whose integral an angle is, for small angles."""
    return VELOCITIES[CHANNELS.index(angle) - 6]


def _regressions(
    states: tuple[str, ...],
    inputs: tuple[str, ...],
    driven: Sequence[Driven],
    dead_time_s: float,
    horizon_s: float,
) -> list[Linear]:
    """Least squares of the changes over a horizon, one per part of `smallest`; none with too few samples."""
    velocities = [c for c in states if c in VELOCITIES]
    empty = Linear(states, inputs, np.zeros((0, 0)), np.zeros((0, 0)), dead_time_s)
    rows, changes = [], []
    for own in driven:
        dt, count = own.trial.dt, max(1, round(horizon_s / own.trial.dt))
        e = exogenous(empty, own)
        x = [state for name in states if (state := own.named(name)) is not None]
        if e is None or len(x) < len(states) or len(own.trial) <= count:
            continue
        bad = ~np.logical_and.reduce(own.trial.valid[:, [CHANNELS.index(c) for c in states]], axis=1)
        masked = np.concatenate([[0], np.cumsum(bad)])
        # Neighbouring changes over a second or more tell alike: long logs are thinned.
        first = np.arange(0, len(own.trial) - count, max(1, len(own.trial) // SETTINGS.most_changes))
        first = first[masked[first + count + 1] == masked[first]]
        z = np.column_stack(x)
        moved = np.concatenate([np.zeros((1, z.shape[1])), np.cumsum(0.5 * dt * (z[1:] + z[:-1]), axis=0)])
        pushed = np.concatenate([np.zeros((1, e.shape[1])), np.cumsum(dt * e[:-1], axis=0)])
        changed = [part[first + count] - part[first] for part in (moved, pushed)]
        rows.append(np.hstack([*changed, np.full((len(first), 1), count * dt)]))
        changes.append((z[first + count] - z[first])[:, : len(velocities)])
    design = np.concatenate(rows) if rows else np.zeros((0, 1))
    if len(design) < SETTINGS.samples_per_parameter * design.shape[1]:
        return []
    size = np.sqrt(np.mean(design**2, axis=0))
    size[size == 0.0] = 1.0
    design /= size
    # Normal equations serve: what they lose is far below the smallest singular value that counts.
    square, vectors = np.linalg.eigh(design.T @ design)
    right = vectors.T @ (design.T @ np.concatenate(changes))
    n, models = len(states), []
    for smallest in SETTINGS.smallest:
        kept = square > max(smallest**2, 1e-12) * square[-1]
        solved = (vectors[:, kept] @ (right[kept] / square[kept, None])).T / size
        a, b = np.zeros((n, n)), np.zeros((n, len(inputs) + 1))
        a[: len(velocities)], b[: len(velocities)] = solved[:, :n], solved[:, n:]
        for row, name in enumerate(states):
            if name in ANGLES:
                a[row, states.index(_rate(name))] = 1.0
        models.append(Linear(states, inputs, a, b, dead_time_s))
    return models


@dataclass(frozen=True, eq=False)
class _Judged:
    """Training windows of one length that judge linear models: their places (w,), states (w, n) at the start,
    measured states (samples, w, n) after it, and those of them that count.
    """

    own: Driven
    places: NDArray[np.intp]
    start: Array
    seen: Array
    counted: NDArray[np.bool_]

    @classmethod
    def of(cls, own: Driven, spans: Sequence[tuple[int, int]], states: Sequence[str]) -> list[_Judged]:
        """Some of a trial's windows, by their length."""
        chosen = spans[:: max(1, len(spans) // SETTINGS.most_windows)]
        columns = [CHANNELS.index(name) for name in states]
        seen, counted = own.trial.observed[:, columns], own.trial.valid[:, columns]
        start = np.column_stack([state for name in states if (state := own.named(name)) is not None])
        groups = []
        for length in dict.fromkeys(stop - first for first, stop in chosen):
            places = np.array([first for first, stop in chosen if stop - first == length], dtype=np.intp)
            rows = places + np.arange(1, length)[:, None]
            groups.append(cls(own, places, start[places], seen[rows], counted[rows]))
        return groups


def _training_error(linear: Linear, judged: Sequence[_Judged]) -> float:
    """Mean over the velocities of ln(SSE / SST) on the training windows; infinite where one diverges.

    The logarithm lets no single channel decide that nothing predicts well.
    """
    shown = []
    for group in judged:
        driven = exogenous(linear, group.own)
        if driven is None:
            return float("inf")
        rows = group.places + np.arange(len(group.seen) + 1)[:, None]
        shown.append(linear.predicted(group.start, driven[rows], group.own.trial.dt)[1:])
    errors = []
    for column in (i for i, name in enumerate(linear.states) if name in VELOCITIES):
        kept = [group.counted[:, :, column] for group in judged]
        seen = np.concatenate([
            group.seen[:, :, column][own] for group, own in zip(judged, kept, strict=True)
        ])
        predicted = np.concatenate([
            prediction[:, :, column][own] for prediction, own in zip(shown, kept, strict=True)
        ])
        sst = float(np.sum((seen - seen.mean()) ** 2)) if len(seen) else 0.0
        if sst > 0.0:
            with np.errstate(over="ignore"):
                errors.append(float(np.sum((predicted - seen) ** 2)) / sst)
    return float(np.mean(np.log(np.maximum(errors, 1e-12)))) if errors else float("inf")
