"""Generated logs of a known motion: sensors with stamps, delays, mountings and noise of their own."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.frames import from_euler, matrix
from seatrial.trial.signals import Series


@dataclass
class Errors:
    """What is wrong with the sensors; delays in s, angles in rad."""

    velocity_late: float = 0.0
    rates_late: float = 0.0
    offset: float = 0.0
    drift: float = 0.0
    tilt: tuple[float, float, float] = (0.0, 0.0, 0.0)
    arm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    heading: float = 0.0
    velocity_scale: float = 1.0
    rates_scale: float = 1.0
    signs: dict[str, float] = field(default_factory=dict)
    axes: dict[str, str] = field(default_factory=dict)
    rates_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Motion:
    """A vehicle that cruises, turns, dives and rolls in waves; all channels as functions of time."""

    def __init__(self, seed: int, length_s: float = 300.0) -> None:
        random = np.random.default_rng(seed)
        self.t = np.arange(-5.0, length_s + 5.0, 0.01)
        t = self.t

        def waves(size: float, slow: float, fast: float) -> Array:
            periods = random.uniform(fast, slow, 6)
            phases = random.uniform(0.0, 2.0 * np.pi, 6)
            parts = [np.sin(2.0 * np.pi * t / p + f) for p, f in zip(periods, phases, strict=True)]
            return np.asarray(size / np.sqrt(6.0) * np.sum(parts, axis=0))

        roll = waves(0.06, 9.0, 4.0)
        pitch = waves(0.08, 30.0, 5.0)
        yaw = 2.0 * np.sin(2.0 * np.pi * t / 97.0 + random.uniform(0.0, 6.0)) + waves(0.3, 40.0, 6.0)
        self.angles = np.stack([roll, pitch, yaw], axis=1)
        self.v = np.stack(
            [1.3 + waves(0.25, 40.0, 6.0), waves(0.15, 25.0, 5.0), waves(0.08, 12.0, 4.0)], axis=1
        )
        rate = np.einsum("nij,nj->ni", matrix(from_euler(self.angles)), self.v)
        self.p = np.concatenate([np.zeros((1, 3)), np.cumsum(0.005 * (rate[1:] + rate[:-1]), axis=0)])
        slope = np.gradient(self.angles, t, axis=0)
        self.omega = np.stack(
            [
                slope[:, 0] - np.sin(pitch) * slope[:, 2],
                np.cos(roll) * slope[:, 1] + np.sin(roll) * np.cos(pitch) * slope[:, 2],
                -np.sin(roll) * slope[:, 1] + np.cos(roll) * np.cos(pitch) * slope[:, 2],
            ],
            axis=1,
        )

    def at(self, y: Array, t: Array) -> Array:
        return np.stack([np.interp(t, self.t, one) for one in y.T], axis=1)


def log(seed: int, errors: Errors | None = None, length_s: float = 300.0) -> dict[str, Series]:
    """Attitude and gyro at 20 Hz, position at 5 Hz with jitter, velocity at 6 Hz on its own file."""
    errors = errors or Errors()
    motion = Motion(seed, length_s)
    random = np.random.default_rng(1000 + seed)

    def noisy(y: Array, size: float) -> Array:
        return np.asarray(y + size * random.standard_normal(y.shape))

    def stamps(step: float) -> Array:
        t = np.arange(0.0, length_s, step)
        return np.asarray(t + 0.1 * step * random.uniform(-1.0, 1.0, len(t)))

    series = {}
    t = stamps(0.05)
    angles = noisy(motion.at(motion.angles, t), 0.002)
    angles[:, 2] -= errors.heading
    omega = errors.rates_scale * noisy(motion.at(motion.omega, t - errors.rates_late), 0.005)
    omega += np.array(errors.rates_bias)
    ends = (angles[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
    for name, value in zip(("roll", "pitch", "yaw"), (angles[:, 0], angles[:, 1], ends), strict=True):
        series[name] = Series(t, value, "ahrs")
    for name, value in zip("pqr", omega.T, strict=True):
        series[name] = Series(t, value, "ahrs")
    t = stamps(0.2)
    for name, value in zip("xyz", noisy(motion.at(motion.p, t), 0.01).T, strict=True):
        series[name] = Series(t, value, "ahrs")
    t = stamps(0.16)
    v = motion.at(motion.v + np.cross(motion.omega, np.array(errors.arm)), t - errors.velocity_late)
    v = noisy(v @ matrix(from_euler(np.array(errors.tilt))), 0.01) * errors.velocity_scale  # R^T v
    keep = random.uniform(size=len(t)) > 0.03  # lost pings
    clock = "dvl" if errors.offset or errors.drift else "ahrs"
    for name, value in zip("uvw", v.T, strict=True):
        series[name] = Series((t * (1.0 + errors.drift) + errors.offset)[keep], value[keep], clock)
    for name, sign in errors.signs.items():
        series[name] = Series(series[name].t, sign * series[name].value, series[name].clock)
    return series | {name: series[other] for name, other in errors.axes.items()}
