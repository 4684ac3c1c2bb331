"""Step tests of motors with known truth, and an independent integration of the chain in small steps."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from seatrial.bench_test.motor_estimate import MotorEstimate
from seatrial.bench_test.motor_model import MotorModel, StepRecord, recommended_steps

Array = NDArray[np.float64]

TABLE = {
    "maximum_ahead": 2000.0,
    "minimum_ahead": 150.0,
    "n_acc_per_s": 2000.0,
    "n_dec_per_s": 4000.0,
    "T_1_s": 0.15,
    "T_t_s": 0.1,
}
TRUTH = MotorModel(0.98, 0.15, 0.137, (160.0, 140.0), (1950.0, 1880.0), (1900.0, 2100.0), (4200.0, 3600.0))


def any_motor(rng: np.random.Generator) -> MotorModel:
    """A motor near that for which the steps were designed, different in both directions."""
    gain, lag, delay = rng.uniform([0.9, 0.08, 0.02], [1.1, 0.3, 0.3])
    low, high = rng.uniform(120.0, 180.0, 2), rng.uniform(1800.0, 2000.0, 2)
    growth, shrink = rng.uniform(1500.0, 2500.0, 2), rng.uniform(3000.0, 5000.0, 2)
    n_min, n_max, n_acc, n_dec = ((float(a), float(b)) for a, b in (low, high, growth, shrink))
    return MotorModel(float(gain), float(lag), float(delay), n_min, n_max, n_acc, n_dec)


def measured(
    truth: MotorModel,
    steps: tuple[Array, Array],
    rng: np.random.Generator,
    *,
    sample_s: float = 0.1,
    noise: float = 6.0,
    quantum: float = 5.0,
    name: str = "SbU",
) -> StepRecord:
    """A record of the steps whose samples start at a random phase."""
    t, command = steps
    at = np.arange(sample_s * rng.random(), t[-1], sample_s)
    asked = StepRecord(t, command, np.zeros(len(at)), name, t_measured=at)
    shown = truth.response(asked, at) + noise * rng.normal(size=len(at))
    if quantum > 0:
        shown = quantum * np.round(shown / quantum)
    return StepRecord(t, command, shown, name, t_measured=at)


def steps_of(*commands: float, hold_s: float = 3.0) -> tuple[Array, Array]:
    """Commands, each held for the same time."""
    return hold_s * np.arange(len(commands) + 1.0), np.array([*commands, commands[-1]])


def designed() -> tuple[Array, Array]:
    return recommended_steps(TABLE)


def rng(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


def held(motor: MotorEstimate, truth: MotorModel) -> dict[str, bool]:
    """Whether the interval of each determined parameter, twice as wide, holds the truth."""
    found = {}
    for name, one in motor.parameters.items():
        if one.value is not None and one.lower is not None and one.upper is not None:
            below, above = one.value - one.lower, one.upper - one.value
            found[name] = one.value - 2.0 * below <= truth.parameters()[name] <= one.value + 2.0 * above
    return found


def with_signal(record: StepRecord, values: Array) -> StepRecord:
    """The record with other measurements."""
    return replace(record, measured=values)


def reference(motor: MotorModel, t: Array, command: Array, at: Array, step: float) -> Array:
    """Response by explicit steps: limits, ramp, delay line and forward Euler, written from the text."""
    number = math.ceil((at[-1] - t[0]) / step) + 1
    place = np.clip(np.searchsorted(t, t[0] + step * np.arange(number) + 1e-12, side="right") - 1, 0, None)
    asked = [_static(motor, float(c)) for c in command]
    ramp, slow = asked[0], motor.K_V * asked[0]
    line = [ramp] * (round(motor.T_t / step) + 1)
    out = np.empty(number)
    for k in range(number):
        out[k] = slow
        delayed = line[k % len(line)]
        slow += step * (motor.K_V * delayed - slow) / motor.T_1
        ramp = _ramped(motor, ramp, asked[place[k]], step)
        line[k % len(line)] = ramp
    return np.interp(at, t[0] + step * np.arange(number), out)


def _static(motor: MotorModel, command: float) -> float:
    side = 0 if command >= 0 else 1
    size = abs(command)
    if size == 0.0:
        return 0.0
    if size < motor.n_min[side]:
        size = 0.0 if motor.dead_band else motor.n_min[side]
    return math.copysign(min(size, motor.n_max[side]), command)


def _ramped(motor: MotorModel, ramp: float, asked: float, step: float) -> float:
    if ramp == asked:
        return ramp
    if ramp * asked < 0:
        asked = 0.0
    side = 0 if ramp + asked >= 0 else 1
    rate = motor.n_acc[side] if abs(asked) > abs(ramp) else motor.n_dec[side]
    return ramp + math.copysign(min(rate * step, abs(asked - ramp)), asked - ramp)
