"""Baselines: what anybody could predict without a vehicle model, in the same windows as a score.

A score means something beside what costs nothing. Each baseline predicts the six velocities of a window from
the smoothed measured state at its start and from the recorded inputs:

- *hold last*: the velocity at the start;
- *mean*: the mean of the training part;
- *first order*: per axis ``T dnu/dt + nu = K s(t - d) + c``, with s the command or the generalised force of
  that axis that explains its velocity best on the training part;
- *linear*: ``dnu/dt = A nu + B s(t - d) + G (roll, pitch) + c`` of all axes, by least squares.

The generalised force is the recorded wrench, or that of the vehicle's actuators as its file gives them, held
at the mean velocity of the training part. Nothing of a fit of the vehicle enters.

`seatrial.scoring.baseline_fit` fits them.

Tests: ``tests/scoring/test_baselines.py``.

A prediction from the state of a filter, some samples ahead, has another rival: a linear regression on the
past, ``y[k] = c + sum_j sum_i w_ij s_j[k - h - i d]`` for every channel y by itself
(`predicted_from_past`). The signals s_j are velocities, angles, depth and commands, h is the horizon and d
a fifth of a second, for two seconds back; ridge regression on standardised signals. It knows the controller
and the period of waves as well as the vehicle. Held by ``tests/scoring/test_linear_predictor.py``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial._core import State
from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import CHANNELS, VELOCITIES
from seatrial.base.errors import SeatrialError
from seatrial.base.frames import to_euler
from seatrial.scoring.windows import Unpredictable, Window, axis_of, channel_errors, judging
from seatrial.trial.trial import Input, Trial

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.trial.trial import Trial

BASELINES = ("hold last", "mean", "first order", "linear")
"""Names of the baselines, the simplest first."""


@dataclass(frozen=True)
class PredictorSettings:
    """What a baseline has to be beaten by, and the past that the linear predictor sees."""

    #: Of a baseline's error variance: a model has to be below it to beat that baseline.
    better_share: float = 0.98
    apart_s: float = 0.2  #: Between the past samples of the linear predictor, s.
    lags: int = 10  #: Past samples: two seconds, as the head says.
    ridge: float = 1e-4  #: Per sample, of standardised signals.
    fewest_samples: int = 4  #: Training samples per regressor.


SETTINGS = PredictorSettings()


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
        return _delayed(lagged(s, self.lag_s, dt), self.dead_time_s / dt)

    def predicted(self, times: Array, start: float, f: Array) -> Array:
        """Velocity (n,) at `times` s after its value `start`, under the `filtered` input f (n,)."""
        a = np.exp(-times / self.lag_s)
        shown: Array = self.offset * (1.0 - a) + self.gain * (f - a * f[0]) + a * start
        return shown


@dataclass(frozen=True, eq=False)
class Linear:
    """Linear model ``dx/dt = A x + B e``, x the free velocities and angles, e what drives them, and 1.

    `states`, `inputs`: names (n,), (m,) of x and e; a velocity among the inputs is replayed. `a`, `b`: (n, n)
    and (n, m + 1), SI; the last column of b is constant. `dead_time_s`: of forces and commands.
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

    `trials`: names of the training trials; none where only "hold last" is known. `mean`: mean of each
    velocity over the training part (6,), SI; NaN where absent. `first_order`: response by velocity channel.
    `linear`: None where the data do not allow it. `free`, `measured`: letters of the axes that are predicted,
    and of those replayed from the trial.
    """

    trials: tuple[str, ...]
    mean: Array
    first_order: Mapping[str, FirstOrder]
    linear: Linear | None
    vehicle: Vehicle | None
    input: Input | None
    free: str
    measured: str
    _read: dict[int, Driven] = field(default_factory=dict, init=False, repr=False)
    _shown: dict[Any, list[Window]] = field(default_factory=dict, init=False, repr=False)

    def read(self, trial: Trial) -> Driven:
        """What the baselines read of a trial, kept for the next score of it."""
        if id(trial) not in self._read:  # the entry keeps the trial, and so its id
            self._read[id(trial)] = Driven.of(trial, self)
        return self._read[id(trial)]

    def remember(self, driven: Iterable[Driven]) -> None:
        """Keep what was read of trials already."""
        self._read.update({id(own.trial): own for own in driven})

    @property
    def names(self) -> tuple[str, ...]:
        """Those of `BASELINES` that are known."""
        known = (True, bool(self.trials), bool(self.first_order), self.linear is not None)
        return tuple(name for name, here in zip(BASELINES, known, strict=True) if here)

    def predict(self, name: str, trial: Trial, spans: Sequence[tuple[int, int]]) -> list[Window]:
        """Windows of one baseline on spans (start, stop) of a trial; NaN in channels that it cannot predict.

        Spans are in samples, as `seatrial.scoring.windows.windows` gives them.
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

        The windows' simulated motion is not looked at. Channels that are velocities of a free axis count, on
        the axes that feedback does not dominate by `limits`.
        """
        wanted = [c for c in channels if c in VELOCITIES and axis_of(c) in self.free]
        parts = {id(window.trial): [w for w in judged if w.trial is window.trial] for window in judged}
        by_baseline: dict[str, dict[str, float]] = {}
        for name in self.names:
            shown = [
                Window(window.trial, window.start, window.stop, window.simulated, judged[0].own_stamps)
                for part in parts.values()
                for window in self.predict(name, part[0].trial, [(w.start, w.stop) for w in part])
            ]
            rows = {c: _r2(c, judging(c, shown, limits or {})) for c in wanted}
            by_baseline[name] = {c: value for c, value in rows.items() if value == value}
        return {name: row for name, row in by_baseline.items() if row}

    def to_dict(self) -> dict[str, object]:
        """Parameters of the baselines as plain data."""
        linear = self.linear
        return {
            "trained_on": list(self.trials),
            "mean": {c: float(v) for c, v in zip(VELOCITIES, self.mean, strict=True) if np.isfinite(v)},
            "first_order": {channel: asdict(response) for channel, response in self.first_order.items()},
            "linear": None
            if linear is None
            else asdict(linear) | {"a": linear.a.tolist(), "b": linear.b.tolist()},
        }


def not_beaten(r2: Mapping[str, float], baselines: Mapping[str, Mapping[str, float]]) -> str:
    """Where a baseline predicts as well as a model or better: channels with both R2; empty if nowhere."""
    beaten = []
    for channel, own in r2.items():
        rivals = {name: row[channel] for name, row in baselines.items() if channel in row}
        if own != own or not rivals:
            continue
        best = max(rivals, key=rivals.__getitem__)
        if 1.0 - own >= SETTINGS.better_share * (1.0 - rivals[best]):
            beaten.append((channel, own, best, rivals[best]))
    # The worst first; the simulation that diverged before all.
    beaten.sort(key=lambda entry: entry[1] - entry[3])
    return ", ".join(f"{c} (R2 {_short(own)}, {name} {_short(best)})" for c, own, name, best in beaten)


def _short(value: float) -> str:
    return "diverged" if np.isneginf(value) else f"{value:.2f}" if value < 0.985 else f"{value:.4f}"


@dataclass(frozen=True, eq=False)
class Driven:
    """A trial with what the baselines read of it.

    `signals` by name (n,): commands and generalised forces; smoothed velocities `nu` (n, 6); `angles`, roll
    and pitch (n, 2) in rad.
    """

    trial: Trial
    signals: Mapping[str, Array]
    nu: Array
    angles: Array

    @classmethod
    def of(cls, trial: Trial, known: Baselines) -> Driven:
        """The signals of a trial that baselines are driven by."""
        signals = _signals(trial, known) if known.trials else {}
        return cls(trial, signals, trial.smooth_nu(trial.t)[0], to_euler(trial.attitude)[:, :2])

    def named(self, name: str) -> Array | None:
        """Signal, replayed velocity or angle (n,) of that name; None where the trial has none."""
        if name in VELOCITIES:
            return self.nu[:, VELOCITIES.index(name)] if name in self.trial.channels else None
        if name in ANGLES:
            return self.angles[:, ANGLES.index(name)] if name in self.trial.channels else None
        return self.signals.get(name)


ANGLES = ("roll", "pitch")
FORCES = ("force X", "force Y", "force Z", "moment K", "moment M", "moment N")


def _signals(trial: Trial, known: Baselines) -> dict[str, Array]:
    """Commands, or what was measured of the actuators, and generalised forces of a trial (n,) by name."""
    chosen = known.input
    if chosen is None:
        chosen = next((name for name in ("commands", "measured", "tau") if name in trial.inputs), None)
    own = {"commands": trial.commands, "measured": trial.measured}.get(chosen or "", {})
    wrench = trial.tau if chosen == "tau" else _wrench(trial, own, known)
    forces = {} if wrench is None else dict(zip(FORCES, np.asarray(wrench).T, strict=True))
    return {name: np.asarray(y) for name, y in (own | forces).items() if np.isfinite(y).all()}


def _wrench(trial: Trial, own: Mapping[str, Array], known: Baselines) -> Array | None:
    """Generalised force (n, 6) of the vehicle's actuators at the mean velocity; None where it is unknown."""
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
    error, away = (np.concatenate([np.zeros(0), *parts]) for parts in channel_errors(channel, shown))
    sst = float(away @ away)
    if not sst > 0.0 or np.isnan(error).any():
        return float("nan")
    with np.errstate(over="ignore"):
        return 1.0 - float(error @ error) / sst


def _predicted(known: Baselines, name: str, own: Driven, spans: Sequence[tuple[int, int]]) -> list[Window]:
    """Windows of a baseline; channels that it does not predict are NaN."""
    trial = own.trial
    shown = [np.full((stop - start, len(CHANNELS)), np.nan) for start, stop in spans]
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
        driven = exogenous(known.linear, own)
        states = [own.named(name) for name in known.linear.states]
        if driven is not None and all(name is not None for name in states):
            start_of = np.column_stack([name for name in states if name is not None])
            columns = [CHANNELS.index(name) for name in known.linear.states]
            # Windows of one length are predicted side by side.
            for length in {stop - start for start, stop in spans}:
                chosen = [k for k, (start, stop) in enumerate(spans) if stop - start == length]
                places = np.array([spans[k][0] for k in chosen])
                e = driven[places + np.arange(length)[:, None]]
                tracks = known.linear.predicted(start_of[places], e, trial.dt)
                for place, k in enumerate(chosen):
                    shown[k][:, columns] = tracks[:, place]
    return [Window(trial, start, stop, track) for track, (start, stop) in zip(shown, spans, strict=True)]


def exogenous(linear: Linear, own: Driven) -> Array | None:
    """What drives the linear model (n, m): forces and commands after the dead time, replayed motion."""
    columns = []
    for name in linear.inputs:
        y = own.named(name)
        if y is None:
            return None
        replayed = name in VELOCITIES or name in ANGLES
        columns.append(y if replayed else _delayed(y, linear.dead_time_s / own.trial.dt))
    return np.column_stack(columns) if columns else np.zeros((len(own.trial), 0))


def lagged(s: Array, lag_s: float, dt: float) -> Array:
    """Input (n,) held from sample to sample behind a first-order lag, at rest at its first value."""
    from scipy.signal import lfilter

    a = float(np.exp(-dt / lag_s))
    return np.asarray(lfilter([0.0, 1.0 - a], [1.0, -a], s, zi=[s[0]])[0])


def _delayed(f: Array, samples: float) -> Array:
    """Signal (n,) some samples later, between samples linearly, its first value before it begins."""
    if samples == 0.0:
        return f
    return np.asarray(np.interp(np.arange(len(f)) - samples, np.arange(len(f)), f))


_SIGNALS = ("u", "v", "w", "p", "q", "r", "z", "roll", "pitch")


def predicted_from_past(
    trials: Sequence[Trial], training: Sequence[Mask], channels: Sequence[str], ahead: int
) -> list[Array]:
    """Channels (n, C) of every trial, foretold `ahead` samples before from what was logged until then.

    The trials share a time step; the regression learns from the samples `training` (n,) of each. NaN where
    there is no past long enough, everywhere where the training data are too few.
    """
    names = [c for c in _SIGNALS if all(trial.filled(c) is not None for trial in trials)]
    commands = [name for name in trials[0].commands if all(name in trial.commands for trial in trials)]
    apart = max(1, round(SETTINGS.apart_s / trials[0].dt))
    first = ahead + apart * (SETTINGS.lags - 1)
    regressors, known = [], []
    for trial, chosen in zip(trials, training, strict=True):
        signals = [trial.filled(c) for c in names] + [trial.commands[name] for name in commands]
        now = np.column_stack([signal for signal in signals if signal is not None])
        past = [now[first - ahead - apart * i : len(now) - ahead - apart * i] for i in range(SETTINGS.lags)]
        regressors.append(
            np.hstack(past) if len(now) > first else np.zeros((0, now.shape[1] * SETTINGS.lags))
        )
        known.append(chosen[first:])
    x, usable = np.vstack(regressors), np.concatenate(known)
    predicted = [np.full((len(trial), len(channels)), np.nan) for trial in trials]
    if usable.sum() < SETTINGS.fewest_samples * x.shape[1]:
        return predicted
    # Ridge regression on standardised signals, channel by channel; what stands still tells nothing.
    mean, spread = x[usable].mean(axis=0), x[usable].std(axis=0)
    moving = spread > 0.0
    x = (x[:, moving] - mean[moving]) / spread[moving]
    for column, channel in enumerate(channels):
        measured = [trial.filled(channel) for trial in trials]
        if any(values is None for values in measured):
            continue
        y = np.concatenate([values[first:] for values in measured if values is not None])
        centre = float(y[usable].mean())
        gram = x[usable].T @ x[usable] + SETTINGS.ridge * usable.sum() * np.eye(x.shape[1])
        weights = np.linalg.solve(gram, x[usable].T @ (y[usable] - centre))
        place = 0
        for row, own in zip(predicted, regressors, strict=True):
            row[first : first + len(own), column] = centre + x[place : place + len(own)] @ weights
            place += len(own)
    return predicted
