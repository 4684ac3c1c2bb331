"""Whether commands follow measurements: a closed loop, its gain and its lag.

A command that an autopilot or a pilot makes from measurements can be foretold from them; one of a preset
manoeuvre only from its own past. Two autoregressions foretell each change of a command, one from its past
changes, one from those and the past changes of the measurements; the second is better by a part
``1 - s2^2 / s1^2`` of the variance, judged on blocks of time outside the fit (Granger 1969). Both see means
over 0.4 s and what lies behind them: at a log's full rate an autopilot's answer to the noise of its own
sensors hides the loop, and a measurement at the same time may be the answer to the command. Changes leave
out what is constant: offsets and set points between their steps; samples at an end of the command's range
say nothing and are left out. A recorded wrench is judged like a command, axis by axis: of a vehicle whose
allocator spreads one axis over many thrusters it shows the loop most clearly. The measurement that alone
improves it most is named, with the slope from it to the command and the lag at which it explains the
command best. Held by ``tests/trial/test_feedback.py``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import CHANNELS
from seatrial.trial.mixer import WRENCH

if TYPE_CHECKING:
    from seatrial.trial.trial import Trial

_CLOSED = 0.2  # part of the variance that measurements explain of what the past does not
_LAGS = 6
_SETTLED = 150  # means, at most a tenth of the log: a transient at the start is no loop
_BLOCKS = 6
_RIDGE = 1e-2
_RATE_HZ = 10.0  # of the slope
_MEAN_S = 0.4  # of the autoregressions
_LONGEST_LAG_S = 2.0
_FEWEST = 200
LEAST_S = _FEWEST * _MEAN_S
"""Length of a trial below which no loop is seen, s."""

_AT_THE_END = 0.01  # of the command's range
_OUTLIER = 3.0  # robust deviations
_TALL = 4.0  # deviations of a regressor
_APART_S = 1.0
_SEEN = ("yaw", "pitch", "roll", "z", "u", "v", "w", "p", "q", "r")


@dataclass(frozen=True)
class Feedback:
    """How one command depends on what was measured.

    Attributes
    ----------
    command
        Name of the actuator, or column of the wrench (``tau.Z_n``).
    explained
        Part of the command's unpredicted variance that the measurements foretell, on data outside the fit.
    channel
        The measurement that foretells it best; "" where the loop is open.
    gain
        Slope of the command on that measurement, command's unit (rad for angles) per SI unit.
    lag_s
        How long the command is behind that measurement.
    """

    command: str
    explained: float
    channel: str
    gain: float
    lag_s: float

    @property
    def closed(self) -> bool:
        """Whether the command follows measurements."""
        return self.explained > _CLOSED


def feedback(trial: Trial) -> list[Feedback]:
    """How each command and component of a wrench that changes depends on the measurements, in their order.

    Parameters
    ----------
    trial
        On its uniform time base.
    """
    result = []
    wrench = {} if trial.tau is None else dict(zip(WRENCH, trial.tau.T, strict=True))
    for name, command in (trial.commands | wrench).items():
        found = _judge(name, command, trial)
        if found is not None:
            result.append(found)
    return result


def explained(trial: Trial, command: Array) -> Feedback:
    """How one signal (n,), made of commands, depends on the measurements; open where too little is known."""
    return _judge("", command, trial) or Feedback("", 0.0, "", math.nan, math.nan)


def _judge(name: str, command: Array, trial: Trial) -> Feedback | None:
    stride = max(1, round(_MEAN_S / trial.dt))
    count = len(trial) // stride

    def means(y: Array) -> Array:
        return np.asarray(y[: count * stride].reshape(count, stride).mean(axis=1))

    recorded = {c: y for c in _SEEN if (y := trial.filled(c)) is not None and y.std() > 0.0}
    if not recorded or count < _FEWEST or np.ptp(command) == 0.0:
        return None
    good = np.logical_and.reduce([trial.valid[:, CHANNELS.index(c)] for c in recorded])
    low, high = float(command.min()), float(command.max())
    margin = _AT_THE_END * (high - low)
    free = good & (command > low + margin) & (command < high - margin)
    # A mean counts where most of its samples and of those before it do.
    usable = np.convolve(means(free.astype(float)) < 0.5, np.ones(2), mode="full")[:count] == 0
    usable[: max(_LAGS + 2, min(_SETTLED, count // 10))] = False
    y, seen = means(command), {c: means(m) for c, m in recorded.items()}
    change = np.diff(y, prepend=y[0])
    if usable.sum() < _FEWEST or not change[usable].any():
        return Feedback(name, 0.0, "", math.nan, math.nan)
    own = _past(change)
    plain = _unpredicted([own], change, usable)
    past = {channel: _past(np.diff(m, prepend=m[0])) for channel, m in seen.items()}
    if plain <= 0.0:
        return Feedback(name, 0.0, "", math.nan, math.nan)
    # All together foretell a loop over several channels; on a short log one alone is not lost among them.
    alone = {channel: _unpredicted([own, one], change, usable) for channel, one in past.items()}
    best = min(alone, key=lambda channel: alone[channel])
    part = 1.0 - min(_unpredicted([own, *past.values()], change, usable), alone[best]) / plain
    if part <= _CLOSED:
        return Feedback(name, max(part, 0.0), "", math.nan, math.nan)
    thin = max(1, math.ceil(1.0 / (_RATE_HZ * trial.dt) - 0.01))
    gain, lag = _slope(command[::thin], recorded[best][::thin], free[::thin], thin * trial.dt)
    return Feedback(name, part, best, gain, lag)


def _past(y: Array) -> Array:
    """The `_LAGS` samples before each, (n, k)."""
    return np.column_stack([np.concatenate([np.zeros(k), y[: len(y) - k]]) for k in range(1, _LAGS + 1)])


def _unpredicted(parts: list[Array], y: Array, usable: Mask) -> float:
    """Mean square of what the regression leaves of y (n,) on blocks outside its fit, robust against steps."""
    limit = _OUTLIER * 1.4826 * float(np.median(np.abs(y[usable])))
    if limit == 0.0:  # preset steps: most changes are none
        low, high = np.quantile(y[usable], [0.01, 0.99])
        limit = _OUTLIER * float(np.sqrt(np.mean(np.clip(y[usable], low, high) ** 2))) or np.inf
    regressors = np.hstack(parts)
    tall = _TALL * regressors[usable].std(axis=0)
    left = unforetold(np.clip(regressors, -tall, tall), np.clip(y, -limit, limit), usable)
    return float(np.mean(left[usable] ** 2))


def unforetold(regressors: Array, y: Array, usable: Mask) -> Array:
    """What a ridge regression leaves of y (n,), each block of time judged by a fit to the others.

    Zero where `usable` is false.
    """
    spread = float(y[usable].std()) or 1.0
    x = (regressors - regressors[usable].mean(axis=0)) / (regressors[usable].std(axis=0) + 1e-12)
    target = (y - y[usable].mean()) / spread
    left = np.zeros(len(y))
    samples = np.flatnonzero(usable)
    whole, moment = x[usable].T @ x[usable], x[usable].T @ target[usable]
    for block in np.array_split(samples, _BLOCKS):
        own, aim = x[block], target[block]
        ridge = _RIDGE * (len(samples) - len(block)) * np.eye(x.shape[1])
        left[block] = aim - own @ np.linalg.solve(whole - own.T @ own + ridge, moment - own.T @ aim)
    return left * spread


def _slope(y: Array, m: Array, usable: Mask, dt: float) -> tuple[float, float]:
    """Slope of the command on a measurement and the lag in s at which they go together best.

    Slow parts (set points, offsets) are taken out by differences over a second.
    """
    apart = max(1, round(_APART_S / dt))
    best = (0.0, math.nan, math.nan)
    for k in range(max(2, round(_LONGEST_LAG_S / dt)) + 1):
        a = y[apart + k :] - y[k : len(y) - apart]
        b = m[apart : len(m) - k] - m[: len(m) - apart - k]
        use = usable[apart + k :] & usable[k : len(y) - apart]
        if use.sum() < _FEWEST // 2:
            continue
        a, b = a[use], b[use]
        limit = np.quantile(np.abs(a), 0.98)
        kept = np.abs(a) <= limit  # without the steps of set points
        a, b = a[kept], b[kept]
        power = float(b @ b)
        if power == 0.0:
            continue
        correlation = abs(float(a @ b)) / math.sqrt(power * float(a @ a) + 1e-300)
        if correlation > best[0]:
            best = (correlation, float(a @ b) / power, k * dt)
    return best[1], best[2]
