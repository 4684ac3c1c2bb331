"""Set-point steps of one loop on the full non-linear closed loop, held against their corridors.

A trial is a flight at a speed: the loop settles at its set point, steps, and after the corridor's end steps
back, so that it counts in both directions. Heading, speed and, where the loop is none of them, depth stay
with guidance on a straight level leg north; what may happen to them meanwhile are corridors beside it.
A path is stepped by moving the whole plan: guidance and the loop answer together. All candidates fly
in lockstep with the same noise (`seatrial.flight.flight`; the core adds up the sums).

Sensors have their noise, digits, rates and delays, but no offset, no drift and no drop-outs: an offset that
is constant through a flight moves the answer, a log that falls silent in the middle of a step leaves any
gains blind, and neither is a property of the gains. `seatrial.verify` flies with all of them.

Source: Taubert et al. (2014), section "Constraint Criteria Optimization". Held by
tests/tuning/test_step_trial.py.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.base.arrays import Array
from seatrial.control_design.corridor import Corridor
from seatrial.control_design.tuning_table import LOOPS
from seatrial.flight.cases import Cases
from seatrial.flight.conditions import Conditions
from seatrial.flight.mission import Mission

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Flights, Vehicle
    from seatrial.sensors.sensor import Sensor

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


@dataclass(frozen=True)
class StepTrialSettings:
    """Where and how a trial of a step is flown."""

    depth_m: float = 100.0  #: Depth of every trial, m: room for a pitch step to dive and climb.
    #: Last share of the corridor, in which a loop with an integral has come to rest.
    rest_share: float = 0.25
    leg_m: float = 1e6  #: Length of the leg, m: no trial comes to its end.


SETTINGS = StepTrialSettings()


@dataclass(frozen=True, eq=False)
class Samples:
    """What each candidate meets: s vehicles, currents and noises."""

    coefficients: Mapping[str, Array]  #: Of the vehicle that flies, {name: (s,)}, SI.
    current: Array  #: North, east, down, (s, 3), m/s; trials head north.
    seeds: tuple[int, ...]  #: Of the sensors' noise, (s,).
    nominal: int = 1  #: So many of the first are the vehicle itself in still water, each with its own noise.

    def __len__(self) -> int:
        return len(self.seeds)

    def of(self, places: Sequence[int]) -> Samples:
        """Some of them, by their places in rising order."""
        chosen = list(places)
        kept = {name: np.asarray(values)[chosen] for name, values in self.coefficients.items()}
        seeds = tuple(self.seeds[place] for place in chosen)
        return Samples(kept, self.current[chosen], seeds, sum(place < self.nominal for place in chosen))


@dataclass(frozen=True, eq=False)
class LoopTrials:
    """Steps of a loop, and what its answers are held against."""

    loop: str  #: Key of `CHANNELS`.
    corridor: Corridor  #: Of the loop's own answer.
    beside: Mapping[str, float]  #: Half-width of the band that another channel keeps to, by channel, SI.
    #: `speeds`, `sizes`: per trial the desired speed, m/s, and the step, SI.
    speeds: tuple[float, ...]
    sizes: tuple[float, ...]
    settle_s: float  #: Time before the first step.

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
        held = {"surge": self.speeds[trial], "heave": SETTINGS.depth_m, "depth": SETTINGS.depth_m}
        return held.get(self.loop, 0.0)

    def grid(self, period_s: float) -> Array:
        """Times of the control periods, (p,), s."""
        # A flight goes on to the end of the period in which its time is up.
        return np.asarray(period_s * np.arange(math.ceil(self.duration_s / period_s - 1e-6) + 1))

    def rests(self, period_s: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Control periods (p,) in which an answer should be at rest: the last quarter there, and back."""
        since = self.grid(period_s) - self.settle_s
        there, back = (
            (since > (1.0 - SETTINGS.rest_share) * self.until_s + after - 1e-9)
            & (since < self.until_s + after - 1e-9)
            for after in (0.0, self.until_s)
        )
        return there, back

    def rest_s(self, period_s: float) -> tuple[float, float]:
        """Time at rest, there and back, s."""
        there, back = self.rests(period_s)
        return period_s * int(there.sum()), period_s * int(back.sum())

    def bounds(self, period_s: float, *, headroom: float = 0.0) -> tuple[Array, Array, Array, Array]:
        """Lower and upper bound, target and clock of the normalised answer per control period, (p,) each;
        both bounds move inwards by `headroom`, a share of the step, as far as they leave room.
        """
        t = self.grid(period_s)
        lower, upper = np.full(len(t), -np.inf), np.full(len(t), np.inf)
        target, clock = np.zeros(len(t)), np.zeros(len(t))
        for place, back in ((self.settle_s, False), (self.settle_s + self.until_s, True)):
            since = t - place
            rows = (since > -1e-9) & (since < self.until_s - 1e-9)
            low, high = self.corridor.sampled(since[rows])
            room = np.minimum(headroom, 0.25 * (high - low))
            low, high = low + room, high - room
            lower[rows], upper[rows] = (1.0 - high, 1.0 - low) if back else (low, high)
            target[rows] = 0.0 if back else 1.0
            clock[rows] = since[rows]
        return lower, upper, target, clock


_OFFSETS = [1, 2]  # offset and drift among the errors of a channel

_SILENCE = [3, 4]  # time between drop-outs and their duration in the timing of a group


@dataclass(frozen=True, eq=False)
class Rig:
    """The closed loop in which trials are flown."""

    vehicle: Vehicle  #: That flies, unless the samples say otherwise.
    model: Vehicle  #: The autopilot's own model: the best values.
    autopilot: Autopilot  #: Whose gains the candidates change.
    #: By kind, "typical" or a file; None for perfect ones.
    sensors: Mapping[str, Sensor] | str | None = "typical"
    max_step_s: float = 0.05  #: Of the integration, s.
    voltage_v: float | None = None  #: Supply, V, where thrust depends on it.
    threads: int | None = None  #: All by default.

    @cached_property
    def _ready(self) -> dict[tuple[float, float], Cases]:
        return {}

    def violations(
        self, trials: LoopTrials, samples: Samples, gains: Mapping[str, ArrayLike], *, headroom: float = 0.0
    ) -> tuple[Array, Array, Array]:
        """What k candidates violate, how much their commands move, and how far off they come to rest.

        Violations (k, trials, samples, corridors, 3): below, above (s), and time-weighted deviation (s^2);
        infinite for what diverged. Travel (k, trials, samples): mean rate of the commands, shares of an
        actuator's range per s. Offset (k, trials, samples): mean distance from the set point over the last
        quarter of the corridor, a share of the step, the larger of there and back; noise is averaged out of
        it.
        """
        columns = {name: np.atleast_1d(np.asarray(values, float)) for name, values in gains.items()}
        k = len(next(iter(columns.values()))) if columns else 1
        violations = np.empty((k, len(trials), len(samples), 1 + len(trials.beside), 3))
        travel = np.empty((k, len(trials), len(samples)))
        offset = np.empty((k, len(trials), len(samples)))
        for chosen, flights in self._flights(trials, samples, columns, k, headroom=headroom, logs=False):
            shape = (len(chosen), len(samples), k)
            judged, ends = np.split(np.asarray(flights.violations), [-_ENDS], axis=1)
            sums = _there_and_back(judged).reshape(*shape, -1, 3)
            violations[:, chosen] = np.moveaxis(sums, 2, 0)
            off = _offset(ends, trials.rest_s(self.autopilot.period_s)).reshape(shape)
            offset[:, chosen] = np.moveaxis(off, 2, 0)
            moved = np.asarray(flights.figures["travel"]).reshape(shape)
            travel[:, chosen] = np.moveaxis(moved, 2, 0)
        return violations, travel, offset

    def responses(
        self, trials: LoopTrials, samples: Samples, gains: Mapping[str, float]
    ) -> tuple[Array, dict[str, Array]]:
        """Times (p,), s, and per channel of the corridors the answers (trials, samples, p), SI."""
        columns = {name: np.array([float(value)]) for name, value in gains.items()}
        t = trials.grid(self.autopilot.period_s)
        answers = {name: np.full((len(trials), len(samples), len(t)), np.nan) for name in trials.names}
        for chosen, flights in self._flights(trials, samples, columns, 1, headroom=0.0, logs=True):
            names = flights.columns
            for case, (trial, sample) in enumerate(np.ndindex(len(chosen), len(samples))):
                log = np.asarray(flights.log(case))
                for name, into in answers.items():
                    into[chosen[trial], sample, : len(log)] = log[:, names.index(name)]
        return t, answers

    def _flights(
        self,
        trials: LoopTrials,
        samples: Samples,
        gains: Mapping[str, Array],
        k: int,
        *,
        headroom: float,
        logs: bool,
    ) -> list[tuple[list[int], Flights]]:
        """Flights of some trials at a time: those that share a mission. Candidates are the fastest index."""
        speeds = np.array(trials.speeds)
        # Guidance scales its lookahead with the speed of the leg, so that a path needs a leg for each speed.
        legs = sorted(set(np.abs(speeds).tolist())) if trials.loop in PATHS else [1.0]
        flights = []
        for leg in legs:
            every = trials.loop not in PATHS
            chosen = [i for i, speed in enumerate(speeds) if every or abs(speed) == leg]
            flights.append((chosen, self._fly(trials, samples, gains, (chosen, leg, k), headroom, logs)))
        return flights

    def _fly(
        self,
        trials: LoopTrials,
        samples: Samples,
        gains: Mapping[str, Array],
        which: tuple[list[int], float, int],
        headroom: float,
        logs: bool,
    ) -> Flights:
        chosen, leg, k = which
        # Half a period short of the last time of the grid: as many periods, whatever its digits.
        ready = self._on_leg(
            leg, float(trials.grid(self.autopilot.period_s)[-1]) - 0.5 * self.autopilot.period_s
        )
        count, s = len(chosen), len(samples)

        def per_trial(values: ArrayLike) -> Array:
            return np.repeat(np.asarray(values, float), s * k, axis=0)

        def per_sample(values: ArrayLike) -> Array:
            return np.tile(np.repeat(np.asarray(values, float), k, axis=0), (count, 1))

        speed, size = np.array(trials.speeds)[chosen], np.array(trials.sizes)[chosen]
        set_point, channel = CHANNELS[trials.loop]
        before = np.array([trials.base(trial) for trial in chosen])
        start = np.zeros(count) if trials.loop in PATHS else before
        steps = start[:, None] + size[:, None] * np.array([0.0, 1.0, 0.0])
        set_points: dict[str, Any] = {
            "times": [0.0, trials.settle_s, trials.settle_s + trials.until_s],
            "speed": per_trial(np.tile(speed[:, None], 3)),
            set_point: per_trial(steps),
        }
        if trials.loop != "cross_track" and trials.loop != "depth":
            set_points.setdefault("heading", np.zeros(3))
        lower, upper, target, clock = trials.bounds(self.autopilot.period_s, headroom=headroom)
        base, scale = per_trial(before), per_trial(size)
        there = target == 1.0
        # There and back apart: what is a shortfall there is an excess on the way back.
        corridors: list[Any] = [
            (
                channel,
                base,
                scale,
                np.where(phase, lower, -np.inf),
                np.where(phase, upper, np.inf),
                target,
                np.where(phase, clock, 0.0),
            )
            for phase in (there, ~there)
        ]
        still = np.zeros(len(lower))
        bounded = np.isfinite(lower) | np.isfinite(upper)
        for name, half in trials.beside.items():
            level = {"u": speed, "z": np.full(count, SETTINGS.depth_m)}.get(name, np.zeros(count))
            inside = 1.0 - min(headroom, 0.25)
            low, high = np.where(bounded, -inside, -np.inf), np.where(bounded, inside, np.inf)
            corridors.append((name, per_trial(level), np.full(count * s * k, half), low, high, still, clock))
        # Bounds that meet in the set point: what lies below, less what lies above, is a mean with its sign.
        for phase in trials.rests(self.autopilot.period_s):
            low, high = np.where(phase, target, -np.inf), np.where(phase, target, np.inf)
            corridors.append((channel, base, scale, low, high, target, still))
        nu = np.zeros((count * s * k, 6))
        nu[:, 0] = per_trial(speed)
        if trials.loop == "surge":
            nu[:, 0] = per_trial(steps[:, 0])
        flown = replace(
            ready,
            seeds=np.tile(np.repeat(np.asarray(samples.seeds), k), count).tolist(),
            current=per_sample(samples.current),
            nu=nu,
            coefficients={
                name: per_sample(np.asarray(x)[:, None])[:, 0] for name, x in samples.coefficients.items()
            },
            gains={name: np.tile(values, count * s) for name, values in gains.items()},
            set_points=set_points,
            corridors=corridors,
            logs=logs,
        )
        return flown.fly(threads=self.threads)

    def _on_leg(self, speed: float, duration_s: float) -> Cases:
        """A straight level leg north that nobody reaches the end of."""
        if (speed, duration_s) not in self._ready:
            depth = SETTINGS.depth_m
            mission = Mission.from_toml(
                f"""
                format = 1
                name = "trial"
                speed_m_s = {speed!r}
                acceptance_radius_m = 10.0
                start = {{ north_m = 0.0, east_m = 0.0, depth_m = {depth}, heading_deg = 0.0 }}
                legs = [{{ north_m = {SETTINGS.leg_m}, east_m = 0.0, depth_m = {depth} }}]
                """
            )
            ready = Cases.of(
                self.vehicle,
                self.autopilot,
                mission,
                conditions=Conditions(
                    model=self.model,
                    sensors=self.sensors,
                    voltage_v=self.voltage_v,
                    max_step_s=self.max_step_s,
                    max_time_s=duration_s,
                ),
            )
            # What is constant through a flight, and what falls silent, is no property of the gains.
            errors = ready.channels.errors.copy()
            errors[:, _OFFSETS] = 0.0
            timing = ready.channels.timing.copy()
            timing[:, _SILENCE] = np.inf, 0.0
            steady = replace(ready.channels, errors=errors, timing=timing)
            self._ready[speed, duration_s] = replace(ready, channels=steady)
        return self._ready[speed, duration_s]


_ENDS = 2  # corridors at the end of the list: at rest there, and back


def _offset(sums: Array, rest_s: tuple[float, float]) -> Array:
    """Mean distance (cases,) from the set point, a share of the step, of sums (cases, 2, 3) of both ends."""
    with np.errstate(invalid="ignore"):
        mean = np.abs(sums[..., 0] - sums[..., 1]) / rest_s
    return np.asarray(np.where(np.isfinite(mean), mean, np.inf).max(axis=-1))


def _there_and_back(sums: Array) -> Array:
    """Sums (cases, corridors, 3): those of the way back, the second corridor, added to the first; the answer
    is mirrored there, so that a shortfall of the step is an excess in the channel.
    """
    there, back = sums[:, 0], sums[:, 1][:, [1, 0, 2]]
    return np.concatenate([(there + back)[:, None], sums[:, 2:]], axis=1)
