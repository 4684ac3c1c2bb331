"""Whether commands follow measurements: a closed loop, its gain and its lag.

A command that an autopilot or a pilot makes from measurements can be foretold from them; one of a preset
manoeuvre only from its own past. Two autoregressions foretell each change of a command, one from its past
changes, one from those and the changes of the measurements; the second is better by a part ``1 - s2^2 /
s1^2`` of the variance, judged on blocks of time outside the fit (Granger 1969). Changes leave out what is
constant: offsets and set points between their steps; samples at an end of the command's range say nothing
and are left out. The measurement that alone improves it most is named, with the slope from it to the
command and the lag at which it explains the command best. Held by ``tests/trial/test_feedback.py``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import CHANNELS

if TYPE_CHECKING:
    from seatrial.trial.trial import Trial

__all__ = ["Feedback", "feedback"]

_CLOSED = 0.15  # part of the variance that measurements explain of what the past does not
_LAGS = 6
_BLOCKS = 6
_RATE_HZ = 10.0
_LONGEST_LAG_S = 2.0
_FEWEST = 200
_AT_THE_END = 0.01  # of the command's range
_OUTLIER = 3.0  # robust deviations
_APART_S = 1.0
_SEEN = ("yaw", "pitch", "roll", "z", "u", "v", "w", "p", "q", "r")


@dataclass(frozen=True)
class Feedback:
    """How one command depends on what was measured.

    Attributes
    ----------
    command
        Name of the actuator.
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
    """How each command that changes depends on the measurements, in the order of the commands.

    Parameters
    ----------
    trial
        On its uniform time base.
    """
    stride = max(1, math.ceil(1.0 / (_RATE_HZ * trial.dt) - 0.01))
    seen = {c: y[::stride] for c in _SEEN if (y := trial.filled(c)) is not None and y.std() > 0.0}
    good = np.logical_and.reduce(
        [trial.valid[::stride, CHANNELS.index(c)] for c in seen] or [np.zeros(0, bool)]
    )
    result = []
    for name, command in trial.commands.items():
        y = command[::stride]
        if not seen or len(y) < _FEWEST or y.std() == 0.0:
            continue
        result.append(_judge(name, y, seen, good, stride * trial.dt))
    return result


def _judge(name: str, y: Array, seen: dict[str, Array], good: Mask, dt: float) -> Feedback:
    low, high = float(y.min()), float(y.max())
    margin = _AT_THE_END * (high - low)
    free = good & (y > low + margin) & (y < high - margin)
    usable = np.convolve(~free, np.ones(_LAGS + 2), mode="full")[: len(y)] == 0
    usable[: _LAGS + 2] = False
    change = np.diff(y, prepend=y[0])
    if usable.sum() < _FEWEST or not change[usable].any():
        return Feedback(name, 0.0, "", math.nan, math.nan)
    own = _past(change, 1)
    plain = _unpredicted([own], change, usable)
    past = {channel: _past(np.diff(m, prepend=m[0]), 0) for channel, m in seen.items()}
    explained = 1.0 - _unpredicted([own, *past.values()], change, usable) / plain if plain > 0.0 else 0.0
    if explained <= _CLOSED:
        return Feedback(name, max(explained, 0.0), "", math.nan, math.nan)
    alone = {channel: _unpredicted([own, part], change, usable) for channel, part in past.items()}
    best = min(alone, key=lambda channel: alone[channel])
    gain, lag = _slope(y, seen[best], usable, dt)
    return Feedback(name, explained, best, gain, lag)


def _past(y: Array, first: int) -> Array:
    """Samples `first` to `_LAGS` before each in standard deviations, (n, k)."""
    spread = y.std()
    scaled = y / spread if spread > 0.0 else y
    return np.column_stack([
        np.concatenate([np.zeros(k), scaled[: len(y) - k]]) for k in range(first, _LAGS + 1)
    ])


def _unpredicted(parts: list[Array], y: Array, usable: Mask) -> float:
    """Variance of what the regression leaves on blocks outside its fit, in robust deviations of `y`."""
    design = np.column_stack([np.ones(len(y)), *parts])
    spread = float(np.sqrt(np.mean(np.clip(y[usable], *np.quantile(y[usable], [0.01, 0.99])) ** 2))) or 1.0
    target = np.clip(y / spread, -_OUTLIER, _OUTLIER)  # steps of a set point are foretold by nothing
    left = []
    samples = np.flatnonzero(usable)
    for block in np.array_split(samples, _BLOCKS):
        fit = usable.copy()
        fit[block[0] : block[-1] + 1] = False
        if fit.sum() < 3 * design.shape[1]:
            continue
        ridge = 1e-4 * fit.sum() * np.eye(design.shape[1])
        x = np.linalg.solve(design[fit].T @ design[fit] + ridge, design[fit].T @ target[fit])
        left.append(np.clip(np.abs(target[block] - design[block] @ x), 0.0, _OUTLIER) ** 2)
    return float(np.concatenate(left).mean()) if left else 0.0


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
