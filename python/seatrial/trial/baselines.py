"""Baselines: what anybody could predict without a vehicle model, in the same windows as a score.

A score means something beside what costs nothing. Each baseline predicts the six velocities of a window from
the smoothed measured state at its start and from the recorded inputs:

- *hold last*: the velocity at the start;
- *mean*: the mean of the training part;
- *first order*: per axis ``T dnu/dt + nu = K s(t - d) + c``, with s the command or the generalised force of
  that axis that explains its velocity best on the training part;
- *linear*: ``dnu/dt = A nu + B s(t - d) + G (roll, pitch) + c`` of all axes, by least squares.

Time constant T and dead time d of the first-order response are searched on a grid and refined; K and c follow
exactly, because the response restarted from nu_0 at t_0 is linear in them: with f the input through the lag,
``nu(t) = c (1 - a) + K (f(t) - a f(t_0)) + a nu_0, a = exp(-(t - t_0) / T)``. The linear model is fitted to
changes over a horizon, ``nu(t + h) - nu(t) = A int nu + B int s + ...`` (the integrals damp sensor noise,
which would bend the derivative's regression); the horizon that predicts the training windows best is taken.

The generalised force is the recorded wrench, or that of the vehicle's actuators as its file gives them, held
at the mean velocity of the training part. Nothing of a fit of the vehicle enters.

Tests: ``tests/trial/test_baselines.py``.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES, CHANNELS, VELOCITIES
from seatrial.base.errors import SeatrialError
from seatrial.trial.ceiling import Unpredictable, judging
from seatrial.trial.trial import Input, Trial
from seatrial.trial.windows import Window, channel_errors, windows

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["BASELINES", "Baselines", "FirstOrder", "Linear", "fit_baselines", "not_beaten"]

BASELINES = ("hold last", "mean", "first order", "linear")
"""Names of the baselines, the simplest first."""

_AHEAD_S = 10.0
_MOST_SAMPLES = 4000  # of an axis in the search of T and d, evenly taken from all windows
_LONGEST_LAG_S, _LONGEST_DEAD_TIME_S = 60.0, 3.0
_LAGS, _DEAD_TIMES = 13, 9  # points of the first grid
_HORIZONS_S = (1.0, 2.0, 5.0, 10.0)
_SMALLEST = (1e-6, 1e-2)  # singular values of the scaled regression below this part of the largest count as 0
_BETTER = 0.98  # of a baseline's error variance: a model has to be below it to beat that baseline
_MOST_CHANGES = 50_000  # of a trial in the regression of the linear model
_PARTS = 30  # samples per parameter below which the linear model is not fitted


@dataclass(frozen=True)
class FirstOrder:
    """First-order response of one axis, ``lag_s dnu/dt + nu = gain s(t - dead_time_s) + offset``, SI.

    ``signal`` names the input s: a command, or a component of the wrench such as "force X".
    """

    signal: str
    gain: float
    offset: float
    lag_s: float
    dead_time_s: float

    def filtered(self, s: Array, dt: float) -> Array:
        """The input s (m,) behind lag and dead time."""
        return _delayed(_lagged(s, self.lag_s, dt), self.dead_time_s / dt)

    def predicted(self, times: Array, start: float, f: Array) -> Array:
        """Velocity (n,) at `times` s after its value `start`, under the `filtered` input f (n,)."""
        a = np.exp(-times / self.lag_s)
        shown: Array = self.offset * (1.0 - a) + self.gain * (f - a * f[0]) + a * start
        return shown


@dataclass(frozen=True, eq=False)
class Linear:
    """Linear model ``dx/dt = A x + B e``, x the free velocities and angles, e what drives them, and 1.

    Attributes
    ----------
    states, inputs
        Names (n,), (m,) of x and e; a velocity among the inputs is replayed.
    a, b
        (n, n) and (n, m + 1), SI; the last column of b is constant.
    dead_time_s
        Of forces and commands.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    a: Array
    b: Array
    dead_time_s: float

    def predicted(self, start: Array, driven: Array, dt: float) -> Array:
        """States (samples, windows, n) from `start` (windows, n) under inputs (samples, windows, m)."""
        from scipy.linalg import expm

        n = len(self.states)
        whole = np.zeros((n + self.b.shape[1],) * 2)
        whole[:n] = np.hstack([self.a, self.b])
        shown = np.empty((len(driven), *start.shape))
        shown[0] = start
        with np.errstate(all="ignore"):  # an unstable model in a long window
            step = expm(whole * dt)
            phi, gamma = step[:n, :n].T, step[:n, n:].T
            pushed = driven @ gamma[:-1] + gamma[-1]
            for k in range(1, len(driven)):
                shown[k] = shown[k - 1] @ phi + pushed[k - 1]
        # What diverged is wrong, not unknown.
        shown[~np.isfinite(shown)] = np.inf
        return shown


@dataclass(frozen=True, eq=False)
class Baselines:
    """Baselines of one set of training trials, made by `fit_baselines`.

    Attributes
    ----------
    trials
        Names of the training trials; none where only "hold last" is known.
    mean
        Mean of each velocity over the training part (6,), SI; NaN where absent.
    first_order
        Response by velocity channel.
    linear
        None where the data do not allow it.
    free, measured
        Letters of the axes that are predicted, and of those replayed from the trial.
    """

    trials: tuple[str, ...]
    mean: Array
    first_order: Mapping[str, FirstOrder]
    linear: Linear | None
    vehicle: Vehicle | None
    input: Input | None
    free: str
    measured: str
    _read: dict[int, _Driven] = field(default_factory=dict, init=False, repr=False)
    _shown: dict[Any, list[Window]] = field(default_factory=dict, init=False, repr=False)

    def read(self, trial: Trial) -> _Driven:
        """What the baselines read of a trial, kept for the next score of it."""
        if id(trial) not in self._read:  # the entry keeps the trial, and so its id
            self._read[id(trial)] = _Driven.of(trial, self)
        return self._read[id(trial)]

    @property
    def names(self) -> tuple[str, ...]:
        """Those of `BASELINES` that are known."""
        known = (True, bool(self.trials), bool(self.first_order), self.linear is not None)
        return tuple(name for name, here in zip(BASELINES, known, strict=True) if here)

    def predict(self, name: str, trial: Trial, spans: Sequence[tuple[int, int]]) -> list[Window]:
        """Windows of one baseline on spans (start, stop) of a trial; NaN in channels that it cannot predict.

        Parameters
        ----------
        name : str
            One of `names`.
        trial : Trial
        spans : sequence of (int, int)
            In samples, as `seatrial.trial.windows.windows` gives them.
        """
        own, key = self.read(trial), (name, id(trial), tuple(spans))
        if key not in self._shown:
            self._shown[key] = _predicted(self, name, own, spans)
        return self._shown[key]

    def r2(
        self,
        judged: Sequence[Window],
        channels: Iterable[str],
        limits: Mapping[str, Unpredictable] | None = None,
    ) -> dict[str, dict[str, float]]:
        """R2 by baseline and channel on the windows of a score, pooled; without what cannot be predicted.

        Parameters
        ----------
        judged : sequence of Window
            Of a score: their simulated motion is not looked at.
        channels : iterable of str
            Those that are velocities of a free axis count.
        limits : mapping, optional
            By trial what no model can predict: axes that feedback dominates are not judged.
        """
        wanted = [c for c in channels if c in VELOCITIES and AXES[VELOCITIES.index(c)] in self.free]
        parts = {id(window.trial): [w for w in judged if w.trial is window.trial] for window in judged}
        found: dict[str, dict[str, float]] = {}
        for name in self.names:
            shown = [
                Window(one.trial, one.start, one.stop, one.simulated, judged[0].own_stamps)
                for part in parts.values()
                for one in self.predict(name, part[0].trial, [(w.start, w.stop) for w in part])
            ]
            rows = {c: _r2(c, judging(c, shown, limits or {})) for c in wanted}
            found[name] = {c: value for c, value in rows.items() if value == value}
        return {name: row for name, row in found.items() if row}

    def to_dict(self) -> dict[str, object]:
        """Parameters of the baselines as plain data."""
        from dataclasses import asdict

        linear = self.linear
        return {
            "trained_on": list(self.trials),
            "mean": {c: float(v) for c, v in zip(VELOCITIES, self.mean, strict=True) if np.isfinite(v)},
            "first_order": {channel: asdict(one) for channel, one in self.first_order.items()},
            "linear": None
            if linear is None
            else asdict(linear) | {"a": linear.a.tolist(), "b": linear.b.tolist()},
        }


def fit_baselines(
    trials: Sequence[Trial] = (),
    *,
    vehicle: Vehicle | None = None,
    input: Input | None = None,
    free: str = "XYZKMN",
    measured: str = "",
    ahead_s: float = _AHEAD_S,
) -> Baselines:
    """Baselines fitted to training trials; without any, only "hold last".

    Parameters
    ----------
    trials : sequence of Trial
        Masked samples do not count, so that a held-out part is masked.
    vehicle : Vehicle, optional
        Turns commands into generalised forces, as its file gives them; without, commands are taken.
    input : "commands", "measured" or "tau", optional
        What drives the motion; the first of these that every trial has by default.
    free, measured : str
        Letters of the axes that are predicted, and of those replayed from the trial.
    ahead_s : float
        Length of the windows of the fit, s.
    """
    plain = Baselines((), np.full(6, np.nan), {}, None, vehicle, input, free, measured)
    usable = [(trial, cut) for trial in trials if (cut := _spans(trial, ahead_s))]
    if not usable:
        return plain
    mean = np.full(6, np.nan)
    for i, channel in enumerate(VELOCITIES):
        values = [trial.observed[trial.valid[:, i], i] for trial, _ in usable if channel in trial.channels]
        if any(len(one) for one in values):
            mean[i] = np.concatenate(values).mean()
    known = Baselines(
        tuple(trial.name for trial, _ in usable), mean, {}, None, vehicle, input, free, measured
    )
    driven = [known.read(trial) for trial, _ in usable]
    spans = [own_spans for _, own_spans in usable]
    filtered: _Filtered = {}
    first_order = {
        VELOCITIES[i]: found
        for i in range(6)
        if AXES[i] in free and (found := _fit_first_order(i, driven, spans, filtered)) is not None
    }
    known = Baselines(known.trials, mean, first_order, None, vehicle, input, free, measured)
    linear = _fit_linear(known, driven, spans)
    fitted = Baselines(known.trials, mean, first_order, linear, vehicle, input, free, measured)
    fitted._read.update({id(own.trial): own for own in driven})
    return fitted


def not_beaten(r2: Mapping[str, float], baselines: Mapping[str, Mapping[str, float]]) -> str:
    """Where a baseline predicts as well as a model or better: channels with both R2; empty if nowhere.

    Parameters
    ----------
    r2
        Of the model by channel.
    baselines
        R2 by baseline and channel on the same windows.
    """
    found = []
    for channel, own in r2.items():
        rivals = {name: row[channel] for name, row in baselines.items() if channel in row}
        if own != own or not rivals:
            continue
        best = max(rivals, key=rivals.__getitem__)
        if 1.0 - own >= _BETTER * (1.0 - rivals[best]):
            found.append((channel, own, best, rivals[best]))
    # The worst first; the simulation that diverged before all.
    found.sort(key=lambda one: one[1] - one[3])
    return ", ".join(f"{c} (R2 {_short(own)}, {name} {_short(best)})" for c, own, name, best in found)


def _short(value: float) -> str:
    return "diverged" if np.isneginf(value) else f"{value:.2f}" if value < 0.985 else f"{value:.4f}"


def _spans(trial: Trial, ahead_s: float) -> list[tuple[int, int]]:
    """Windows of a training trial; none where none can start."""
    try:
        return windows(trial, ahead_s)[0]
    except SeatrialError:
        return []


@dataclass(frozen=True, eq=False)
class _Driven:
    """A trial with what the baselines read of it.

    `signals` by name (n,): commands and generalised forces; smoothed velocities `nu` (n, 6); `angles`, roll
    and pitch (n, 2) in rad.
    """

    trial: Trial
    signals: Mapping[str, Array]
    nu: Array
    angles: Array

    @classmethod
    def of(cls, trial: Trial, known: Baselines) -> _Driven:
        from seatrial.base.rotation import to_euler

        signals = _signals(trial, known) if known.trials else {}
        return cls(trial, signals, trial.smooth_nu(trial.t)[0], to_euler(trial.attitude)[:, :2])

    def named(self, name: str) -> Array | None:
        """Signal, replayed velocity or angle (n,) of that name; None where the trial has none."""
        if name in VELOCITIES:
            return self.nu[:, VELOCITIES.index(name)] if name in self.trial.channels else None
        if name in _ANGLES:
            return self.angles[:, _ANGLES.index(name)] if name in self.trial.channels else None
        return self.signals.get(name)


_ANGLES = ("roll", "pitch")

_FORCES = ("force X", "force Y", "force Z", "moment K", "moment M", "moment N")


def _signals(trial: Trial, known: Baselines) -> dict[str, Array]:
    """Commands, or what was measured of the actuators, and generalised forces of a trial (n,) by name."""
    chosen = known.input
    if chosen is None:
        chosen = next((one for one in ("commands", "measured", "tau") if one in trial.inputs), None)
    own = {"commands": trial.commands, "measured": trial.measured}.get(chosen or "", {})
    wrench = trial.tau if chosen == "tau" else _wrench(trial, own, known)
    forces = {} if wrench is None else dict(zip(_FORCES, np.asarray(wrench).T, strict=True))
    return {name: np.asarray(y) for name, y in (own | forces).items() if np.isfinite(y).all()}


def _wrench(trial: Trial, own: Mapping[str, Array], known: Baselines) -> Array | None:
    """Generalised force (n, 6) of the vehicle's actuators at the mean velocity; None where it is unknown."""
    from seatrial._core import State

    if known.vehicle is None or not all(name in own for name in known.vehicle.actuators):
        return None
    held = State(nu=np.where(np.isfinite(known.mean), known.mean, 0.0))
    commands = {name: own[name] for name in known.vehicle.actuators}
    try:
        run = known.vehicle.simulate(trial.t, commands, held, free="", voltage_v=trial.voltage_v)
    except (SeatrialError, ValueError):  # thrust tables without a supply voltage
        return None
    return np.asarray(run.tau)


def _r2(channel: str, shown: Sequence[Window]) -> float:
    """R2 of one channel over windows; NaN where a sample is not predicted or nothing moves."""
    error, away = (np.concatenate([np.zeros(0), *one]) for one in channel_errors(channel, shown))
    sst = float(away @ away)
    if not sst > 0.0 or np.isnan(error).any():
        return float("nan")
    with np.errstate(over="ignore"):
        return 1.0 - float(error @ error) / sst


def _predicted(known: Baselines, name: str, own: _Driven, spans: Sequence[tuple[int, int]]) -> list[Window]:
    """Windows of a baseline; channels that it does not predict are NaN."""
    trial = own.trial
    shown = [np.full((stop - start, len(CHANNELS)), np.nan) for start, stop in spans]
    lengths = {stop - start for start, stop in spans}
    for channel, response in known.first_order.items() if name == "first order" else ():
        i = VELOCITIES.index(channel)
        s = own.named(response.signal) if response.signal else np.zeros(len(trial))
        if s is None:
            continue
        f = response.filtered(s, trial.dt)
        for track, (start, stop) in zip(shown, spans, strict=True):
            times = trial.t[start:stop] - trial.t[start]
            track[:, i] = response.predicted(times, own.nu[start, i], f[start:stop])
    for i in range(6) if name in ("hold last", "mean") else ():
        for track, (start, _) in zip(shown, spans, strict=True):
            track[:, i] = own.nu[start, i] if name == "hold last" else known.mean[i]
    if name == "linear" and known.linear is not None:
        driven = _exogenous(known.linear, own)
        states = [own.named(one) for one in known.linear.states]
        if driven is not None and all(one is not None for one in states):
            start_of = np.column_stack([one for one in states if one is not None])
            columns = [CHANNELS.index(one) for one in known.linear.states]
            for length in lengths:
                chosen = [k for k, (start, stop) in enumerate(spans) if stop - start == length]
                places = np.array([spans[k][0] for k in chosen])
                e = np.stack([driven[p : p + length] for p in places], axis=1)
                tracks = known.linear.predicted(start_of[places], e, trial.dt)
                for place, k in enumerate(chosen):
                    shown[k][:, columns] = tracks[:, place]
    return [Window(trial, start, stop, track) for track, (start, stop) in zip(shown, spans, strict=True)]


def _exogenous(linear: Linear, own: _Driven) -> Array | None:
    """What drives the linear model (n, m): forces and commands after the dead time, replayed motion."""
    columns = []
    for name in linear.inputs:
        y = own.named(name)
        if y is None:
            return None
        replayed = name in VELOCITIES or name in _ANGLES
        columns.append(y if replayed else _delayed(y, linear.dead_time_s / own.trial.dt))
    return np.column_stack(columns) if columns else np.zeros((len(own.trial), 0))


def _lagged(s: Array, lag_s: float, dt: float) -> Array:
    """Input (n,) held from sample to sample behind a first-order lag, at rest at its first value."""
    from scipy.signal import lfilter

    a = float(np.exp(-dt / lag_s))
    return np.asarray(lfilter([0.0, 1.0 - a], [1.0, -a], s, zi=[s[0]])[0])


def _delayed(f: Array, samples: float) -> Array:
    """Signal (n,) some samples later, between samples linearly, its first value before it begins."""
    if samples == 0.0:
        return f
    return np.asarray(np.interp(np.arange(len(f)) - samples, np.arange(len(f)), f))


def _varying(name: str, driven: Sequence[_Driven]) -> bool:
    """Whether a signal is there in every training trial and not constant over them."""
    signals = [one.named(name) for one in driven]
    if any(s is None for s in signals):
        return False
    values = np.concatenate([s for s in signals if s is not None])
    return bool(np.ptp(values) > 1e-9 * max(1.0, float(np.abs(values).max())))


_Filtered = dict[tuple[str, float, int], Array]
"""Signals behind a lag, by name, lag and trial: every axis tries the same ones."""


def _fit_first_order(
    i: int, driven: Sequence[_Driven], spans: Sequence[Sequence[tuple[int, int]]], filtered: _Filtered
) -> FirstOrder | None:
    """Response of one axis on the training windows; None where the velocity is not recorded."""
    kept = [k for k, own in enumerate(driven) if VELOCITIES[i] in own.trial.channels]
    samples = [_Samples.of(i, driven[k], spans[k]) for k in kept]
    total = sum(len(one.y) for one in samples)
    if not total:
        return None
    samples = [one.thinned(max(1, total // _MOST_SAMPLES)) for one in samples]
    own = [driven[k] for k in kept]
    names = [
        name
        for name in dict.fromkeys(itertools.chain.from_iterable(one.signals for one in own))
        if name not in _FORCES or name == _FORCES[i]
        if _varying(name, own)
    ]
    dt = min(one.trial.dt for one in own)
    lags = np.geomspace(min(dt, 0.5 * _LONGEST_LAG_S), _LONGEST_LAG_S, _LAGS)
    dead = np.linspace(0.0, _LONGEST_DEAD_TIME_S, _DEAD_TIMES)

    def behind(name: str, lag: float) -> list[Array]:
        for one in own:
            if (key := (name, lag, id(one))) not in filtered:
                s = one.named(name) if name else None
                filtered[key] = np.zeros(len(one.trial)) if s is None else _lagged(s, lag, one.trial.dt)
        return [filtered[name, lag, id(one)] for one in own]

    coarse = {name: _search(partial(behind, name), samples, lags, dead) for name in names}
    # The decay alone, for an axis that nothing drives.
    coarse[""] = _search(partial(behind, ""), samples, lags, dead[:1])
    best = min(coarse, key=lambda name: coarse[name][0])
    found = coarse[best]
    ratio, step = lags[1] / lags[0], dead[1]
    for _ in range(3):
        around = found[3] * ratio ** np.linspace(-1.0, 1.0, 7)
        near = np.clip(found[4] + step * np.linspace(-1.0, 1.0, 7), 0.0, _LONGEST_DEAD_TIME_S)
        finer = _search(partial(behind, best), samples, around, np.unique(near) if best else dead[:1])
        found = min(found, finer)
        ratio, step = ratio ** (1.0 / 3.0), step / 3.0
    _, gain, offset, lag, dead_time = found
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
    def of(cls, i: int, own: _Driven, spans: Sequence[tuple[int, int]]) -> _Samples:
        trial = own.trial
        at = [a + 1 + np.flatnonzero(trial.valid[a + 1 : b, i]) for a, b in spans]
        begin = np.concatenate([np.full(len(one), a) for one, (a, _) in zip(at, spans, strict=True)])
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
    y = np.concatenate([one.y for one in samples])
    start = np.concatenate([one.start for one in samples])
    elapsed = np.concatenate([(one.at - one.begin) * one.dt for one in samples])
    best = (np.inf, 0.0, 0.0, float(lags[0]), 0.0)
    first = np.cumsum([0, *(len(s) for s in behind(float(lags[0])))])[:-1].tolist()
    at, begin = [one.at for one in samples], [one.begin for one in samples]
    earlier = []
    for dead_time in dead.tolist():
        by = [dead_time / one.dt for one in samples]
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
    known: Baselines, driven: Sequence[_Driven], spans: Sequence[Sequence[tuple[int, int]]]
) -> Linear | None:
    """Linear model that predicts the training windows best among some horizons and two dead times."""
    recorded = [c for c in (*VELOCITIES, *_ANGLES) if all(c in own.trial.channels for own in driven)]
    axis = {c: AXES[CHANNELS.index(c) % 6] for c in recorded}  # of an angle that of its rate
    states = [c for c in recorded if axis[c] in known.free and (c in VELOCITIES or _rate(c) in recorded)]
    if not states:
        return None
    replayed = [c for c in recorded if axis[c] in known.measured]
    forces = [name for name in _FORCES if _varying(name, driven)]
    commands = [name for name in driven[0].signals if name not in _FORCES and _varying(name, driven)]
    dead_times = [one.dead_time_s for one in known.first_order.values() if one.signal]
    typical = {0.0, float(np.median(dead_times)) if dead_times else 0.0}
    judged = [one for own, of in zip(driven, spans, strict=True) for one in _Judged.of(own, of, states)]
    best: tuple[float, Linear | None] = (np.inf, None)
    for pushing in [one for one in (forces, commands) if one] or [[]]:
        for dead_time, horizon in itertools.product(sorted(typical), _HORIZONS_S):
            for tried in _regressions(tuple(states), (*replayed, *pushing), driven, dead_time, horizon):
                best = min(best, (_training_error(tried, judged), tried), key=lambda one: one[0])
    return best[1]


def _rate(angle: str) -> str:
    """Velocity channel whose integral an angle is, for small angles."""
    return VELOCITIES[CHANNELS.index(angle) - 6]


def _regressions(
    states: tuple[str, ...],
    inputs: tuple[str, ...],
    driven: Sequence[_Driven],
    dead_time_s: float,
    horizon_s: float,
) -> list[Linear]:
    """Least squares of the changes over a horizon, one per `_SMALLEST`; none with too few samples."""
    velocities = [c for c in states if c in VELOCITIES]
    empty = Linear(states, inputs, np.zeros((0, 0)), np.zeros((0, 0)), dead_time_s)
    rows, changes = [], []
    for own in driven:
        dt, count = own.trial.dt, max(1, round(horizon_s / own.trial.dt))
        e = _exogenous(empty, own)
        x = [one for name in states if (one := own.named(name)) is not None]
        if e is None or len(x) < len(states) or len(own.trial) <= count:
            continue
        bad = ~np.logical_and.reduce(own.trial.valid[:, [CHANNELS.index(c) for c in states]], axis=1)
        masked = np.concatenate([[0], np.cumsum(bad)])
        # Neighbouring changes over a second or more tell alike: long logs are thinned.
        first = np.arange(0, len(own.trial) - count, max(1, len(own.trial) // _MOST_CHANGES))
        first = first[masked[first + count + 1] == masked[first]]
        z = np.column_stack(x)
        moved = np.concatenate([np.zeros((1, z.shape[1])), np.cumsum(0.5 * dt * (z[1:] + z[:-1]), axis=0)])
        pushed = np.concatenate([np.zeros((1, e.shape[1])), np.cumsum(dt * e[:-1], axis=0)])
        changed = [part[first + count] - part[first] for part in (moved, pushed)]
        rows.append(np.hstack([*changed, np.full((len(first), 1), count * dt)]))
        changes.append((z[first + count] - z[first])[:, : len(velocities)])
    design = np.concatenate(rows) if rows else np.zeros((0, 1))
    if len(design) < _PARTS * design.shape[1]:
        return []
    size = np.sqrt(np.mean(design**2, axis=0))
    size[size == 0.0] = 1.0
    design /= size
    # Normal equations serve: what they lose is far below the smallest singular value that counts.
    square, vectors = np.linalg.eigh(design.T @ design)
    right = vectors.T @ (design.T @ np.concatenate(changes))
    n, found = len(states), []
    for smallest in _SMALLEST:
        kept = square > max(smallest**2, 1e-12) * square[-1]
        solved = (vectors[:, kept] @ (right[kept] / square[kept, None])).T / size
        a, b = np.zeros((n, n)), np.zeros((n, len(inputs) + 1))
        a[: len(velocities)], b[: len(velocities)] = solved[:, :n], solved[:, n:]
        for row, name in enumerate(states):
            if name in _ANGLES:
                a[row, states.index(_rate(name))] = 1.0
        found.append(Linear(states, inputs, a, b, dead_time_s))
    return found


@dataclass(frozen=True, eq=False)
class _Judged:
    """Training windows of one length that judge linear models: their places (w,), states (w, n) at the start,
    measured states (samples, w, n) after it, and those of them that count.
    """

    own: _Driven
    places: NDArray[np.intp]
    start: Array
    seen: Array
    counted: NDArray[np.bool_]

    @classmethod
    def of(cls, own: _Driven, spans: Sequence[tuple[int, int]], states: Sequence[str]) -> list[_Judged]:
        """Some of a trial's windows, by their length."""
        chosen = spans[:: max(1, len(spans) // _MOST_WINDOWS)]
        columns = [CHANNELS.index(name) for name in states]
        seen, counted = own.trial.observed[:, columns], own.trial.valid[:, columns]
        start = np.column_stack([one for name in states if (one := own.named(name)) is not None])
        found = []
        for length in dict.fromkeys(stop - first for first, stop in chosen):
            places = np.array([first for first, stop in chosen if stop - first == length], dtype=np.intp)
            rows = places + np.arange(1, length)[:, None]
            found.append(cls(own, places, start[places], seen[rows], counted[rows]))
        return found


def _training_error(linear: Linear, judged: Sequence[_Judged]) -> float:
    """Mean over the velocities of ln(SSE / SST) on the training windows; infinite where one diverges.

    The logarithm lets no single channel decide that nothing predicts well.
    """
    shown = []
    for one in judged:
        driven = _exogenous(linear, one.own)
        if driven is None:
            return float("inf")
        rows = one.places + np.arange(len(one.seen) + 1)[:, None]
        shown.append(linear.predicted(one.start, driven[rows], one.own.trial.dt)[1:])
    errors = []
    for column in (i for i, name in enumerate(linear.states) if name in VELOCITIES):
        kept = [one.counted[:, :, column] for one in judged]
        seen = np.concatenate([one.seen[:, :, column][own] for one, own in zip(judged, kept, strict=True)])
        found = np.concatenate([one[:, :, column][own] for one, own in zip(shown, kept, strict=True)])
        sst = float(np.sum((seen - seen.mean()) ** 2)) if len(seen) else 0.0
        if sst > 0.0:
            with np.errstate(over="ignore"):
                errors.append(float(np.sum((found - seen) ** 2)) / sst)
    return float(np.mean(np.log(np.maximum(errors, 1e-12)))) if errors else float("inf")


_MOST_WINDOWS = 60  # of a trial that judge a linear model in the choice of its horizon
