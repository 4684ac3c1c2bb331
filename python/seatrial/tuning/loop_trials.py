"""Set-point steps of a loop as data: what is stepped, how far, at which speeds, and what the answers meet.

Held by tests/test_step_trial.py.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seatrial.tuning.corridor import Corridor
from seatrial.tuning.tuning_file import LOOPS

__all__ = ["CHANNELS", "DEPTH_M", "PATHS", "RIDES_ON", "LoopTrials", "Samples"]

Array = NDArray[np.float64]

CHANNELS = {
    "surge": ("speed", "u"),
    "sway": ("lateral", "v"),
    "heave": ("depth", "z"),
    "pitch": ("pitch", "pitch"),
    "heading": ("heading", "yaw"),
    "depth": ("down", "z"),
    "cross_track": ("east", "y"),
}
"""Set point and channel of the answer, per loop or path. Roll is held level: its set point does not move."""

PATHS = ("depth", "cross_track")

RIDES_ON = {"depth": "pitch", "cross_track": "heading"}
"""The loop under each path."""

DEPTH_M = 100.0
"""Depth of every trial, m: room for a pitch step to dive and climb."""


@dataclass(frozen=True, eq=False)
class Samples:
    """What each candidate meets: s vehicles, currents and noises.

    Attributes
    ----------
    coefficients
        Of the vehicle that flies, {name: (s,)}, SI.
    current
        North, east, down, (s, 3), m/s; trials head north.
    seeds
        Of the sensors' noise, (s,).
    nominal
        So many of the first are the vehicle itself in still water, each with its own noise.
    """

    coefficients: Mapping[str, Array]
    current: Array
    seeds: tuple[int, ...]
    nominal: int = 1

    def __len__(self) -> int:
        return len(self.seeds)

    def first(self, count: int) -> Samples:
        """The first of them."""
        kept = {name: np.asarray(values)[:count] for name, values in self.coefficients.items()}
        return Samples(kept, self.current[:count], self.seeds[:count], min(self.nominal, count))


@dataclass(frozen=True, eq=False)
class LoopTrials:
    """Steps of a loop, and what its answers are held against.

    Attributes
    ----------
    loop
        Key of `CHANNELS`.
    corridor
        Of the loop's own answer.
    beside
        Half-width of the band that another channel keeps to, by channel, SI.
    speeds, sizes
        Per trial the desired speed, m/s, and the step, SI.
    settle_s
        Time before the first step.
    """

    loop: str
    corridor: Corridor
    beside: Mapping[str, float]
    speeds: tuple[float, ...]
    sizes: tuple[float, ...]
    settle_s: float

    def __len__(self) -> int:
        return len(self.speeds)

    @property
    def until_s(self) -> float:
        """Time from step to step."""
        return self.corridor.until_s

    @property
    def duration_s(self) -> float:
        """Time of a trial: settle, step, step back."""
        return self.settle_s + 2.0 * self.until_s

    @property
    def names(self) -> tuple[str, ...]:
        """Channels of the corridors: the loop's own first."""
        return CHANNELS[self.loop][1], *self.beside

    def to_dict(self) -> dict[str, Any]:
        """The trials as plain data, steps in the unit of the campaign file."""
        entry = LOOPS[self.loop]
        return {
            "loop": self.loop,
            "speeds_m_s": list(self.speeds),
            "steps": [size / entry.to_si for size in self.sizes],
            "unit": entry.unit,
            "settle_s": self.settle_s,
            "until_s": self.until_s,
            "lower": [list(point) for point in self.corridor.lower],
            "upper": [list(point) for point in self.corridor.upper],
            "beside": dict(self.beside),
        }

    @property
    def settled(self) -> float:
        """Half-width of the band in which the answer ends, as a share of the step."""
        lower, upper = self.corridor.sampled([self.until_s])
        half = float(min(1.0 - lower[0], upper[0] - 1.0))
        return half if 0.0 < half < 0.2 else 0.05

    def base(self, trial: int) -> float:
        """Set point of a trial before its step, SI."""
        held = {"surge": self.speeds[trial], "heave": DEPTH_M, "depth": DEPTH_M}
        return held.get(self.loop, 0.0)

    def grid(self, period_s: float) -> Array:
        """Times of the control periods, (p,), s."""
        # A flight goes on to the end of the period in which its time is up.
        return np.asarray(period_s * np.arange(math.ceil(self.duration_s / period_s - 1e-6) + 1))

    def bounds(self, period_s: float, *, reserve: float = 0.0) -> tuple[Array, Array, Array, Array]:
        """Lower and upper bound, target and clock of the normalised answer per control period, (p,) each.

        Parameters
        ----------
        period_s : float
        reserve : float
            By how much both bounds move inwards, as a share of the step, as far as they leave room.
        """
        t = self.grid(period_s)
        lower, upper = np.full(len(t), -np.inf), np.full(len(t), np.inf)
        target, clock = np.zeros(len(t)), np.zeros(len(t))
        for place, back in ((self.settle_s, False), (self.settle_s + self.until_s, True)):
            since = t - place
            rows = (since > -1e-9) & (since < self.until_s - 1e-9)
            low, high = self.corridor.sampled(since[rows])
            room = np.minimum(reserve, 0.25 * (high - low))
            low, high = low + room, high - room
            lower[rows], upper[rows] = (1.0 - high, 1.0 - low) if back else (low, high)
            target[rows] = 0.0 if back else 1.0
            clock[rows] = since[rows]
        return lower, upper, target, clock
