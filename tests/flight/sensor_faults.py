"""Faults of one sensor channel in closed loop: what the autopilot notices, and where the vehicle goes.

``python -m tests.flight.sensor_faults [VEHICLE ...]`` prints the table of docs/validation.md.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np

import seatrial as st
from seatrial.base.arrays import Array
from seatrial.realtime.plant import Plant

MISSION = """format = 1
name = "zigzag"
speed_m_s = {speed}
acceptance_radius_m = 6.0
[limits]
max_depth_m = 25.0
max_time_s = 900.0
fence_m = [[-60.0, -80.0], [-60.0, 80.0], [400.0, 80.0], [400.0, -80.0]]
[[legs]]
north_m = 60.0
east_m = 0.0
depth_m = 6.0
[[legs]]
north_m = 140.0
east_m = 30.0
depth_m = 10.0
[[legs]]
north_m = 220.0
east_m = -30.0
depth_m = 8.0
[[legs]]
north_m = 340.0
east_m = 0.0
depth_m = 6.0
"""

CHANNELS = ("x", "y", "z", "roll", "pitch", "yaw", "u", "v", "w", "p", "q", "r")

NOISE = np.array([0.3, 0.3, 0.02, 0.003, 0.003, 0.006, 0.01, 0.01, 0.01, 0.002, 0.002, 0.002])
"""Standard deviations of a sample: GPS-like position, pressure depth, attitude, Doppler log, gyro."""

VEHICLES: dict[str, tuple[float, float | None]] = {
    "cwolf": (1.5, None),
    "remus100": (1.55, None),
    "bluerov2-heavy": (0.6, 16.0),
}
"""Speed of the mission, m/s, and supply, V."""

FAULT_AT_S = 40.0

SIZES = {"x": (30.0, 200.0, 50.0, 0.5), "y": (30.0, 200.0, 50.0, 0.5), "z": (5.0, 20.0, 8.0, 0.05)}
"""Noise, spikes and step of a channel in its unit, drift per second."""

Told = dict[str, float]
Fault = Callable[[Told, float, np.random.Generator], Told]
Failure = Callable[[Told, Told], Told]
"""What actuators do: by the commands, and by what the actuators did before."""


def fault(kind: str, channel: str) -> Fault:
    """What a fault makes of a whole sample, by the time since it began, s."""
    noise, spike, step, drift = SIZES.get(channel, (1.0, 2.0, 0.6, 0.01))
    past: list[float] = []

    def shown(value: float, since: float, rng: np.random.Generator) -> float:
        past.append(value)
        match kind:
            case "lost":
                return math.nan
            case "frozen":
                return past[0]
            case "frozen with noise":
                return past[0] + float(rng.normal(0.0, 1e-4))
            case "zero":
                return 0.0
            case "2 s late":
                return past[max(len(past) - 20, 0)]
            case "1e6":
                return 1e6
            case "infinite":
                return math.inf
            case "noisy":
                return value + float(rng.normal(0.0, noise))
            case "spikes":
                return value + (float(rng.choice([-spike, spike])) if rng.random() < 0.3 else 0.0)
            case "step":
                return value + step
            case "drift":
                return value + since * drift
            case "sign":
                return -value
            case _:
                return math.nan if since % 3.0 < 2.5 else value

    def of(told: Told, since: float, rng: np.random.Generator) -> Told:
        if kind == "missing":
            return {name: value for name, value in told.items() if name != channel}
        return told | {channel: shown(told[channel], since, rng)}

    return of


KINDS = (
    "lost", "missing", "frozen", "frozen with noise", "zero", "2 s late", "1e6", "infinite", "noisy",
    "spikes", "step", "drift", "sign", "intermittent",
)  # fmt: skip


@dataclass
class Flown:
    """A flight step by step: what the helm was told and did, and where the vehicle truly was."""

    told: list[Told]
    commands: list[dict[str, float]]
    reaction: list[str]
    cause: list[str]
    suspect: list[str]
    true: Array


def fly(
    vehicle: str,
    fault: Fault | None = None,
    *,
    seconds: float = 200.0,
    seed: int = 1,
    resets_at_s: tuple[float, ...] = (),
    failure: Failure | None = None,
) -> Flown:
    """The mission under `Helm` in a current, with noise of all sensors, and from 40 s on with a fault of a
    sensor or a failure of actuators."""
    speed, supply = VEHICLES[vehicle]
    boat, autopilot = st.Vehicle.load(vehicle), st.Autopilot.load(vehicle)
    helm = autopilot.engage(boat, st.Mission.from_toml(MISSION.format(speed=speed)))
    plant = Plant(boat, current=(0.0, 0.15, 0.0), voltage_v=supply)
    rng, motion, period = np.random.default_rng(seed), plant.motion, autopilot.period_s
    flown, true = Flown([], [], [], [], [], np.empty(0)), []
    obeyed: Told = {}
    for k in range(round(seconds / period)):
        now = np.array([*motion.position, *motion.euler, *motion.nu])
        true.append(now)
        told = dict(zip(CHANNELS, map(float, now + rng.normal(0.0, NOISE)), strict=True))
        since = k * period - FAULT_AT_S
        if fault is not None and since >= 0.0:
            told = fault(told, since, rng)
        flown.told.append(told)
        if any(abs(k * period - at) < 0.5 * period for at in resets_at_s):
            helm.reset()
        commands = helm.step(told | ({} if supply is None else {"voltage": supply}))
        flown.commands.append(commands)
        flown.reaction.append(str(helm.thought.get("reaction", "continue")))
        flown.cause.append(str(helm.thought.get("cause", "")))
        flown.suspect.append(str(helm.thought.get("suspect", "")))
        obeyed = commands if failure is None or since < 0.0 else failure(commands, obeyed)
        motion = plant.advance(obeyed, period)
    flown.true = np.array(true)
    return flown


@dataclass(frozen=True)
class Row:
    """What came of a fault: times after it began, s, and distances, m; None where it never was."""

    vehicle: str
    kind: str
    channel: str
    noticed_s: float | None
    off_course_s: float | None
    farthest_m: float
    deepest_m: float
    outside_m: float
    cause: str

    @property
    def unmet(self) -> str:
        """What of the goal is not met; empty where all is."""
        late = self.off_course_s is not None and (
            self.noticed_s is None or self.noticed_s > self.off_course_s + 10.0
        )
        broken = {"unnoticed": late, "depth": self.deepest_m > 30.0, "fence": self.outside_m > 0.0}
        return ", ".join(name for name, holds in broken.items() if holds)


def row(vehicle: str, kind: str, channel: str, usual: Flown, flown: Flown, period_s: float = 0.1) -> Row:
    """Judges a flight against the one without the fault."""
    first = round(FAULT_AT_S / period_s)
    off = np.linalg.norm(flown.true[:, :3] - usual.true[:, :3], axis=1)
    noticed = next((k for k in range(first, len(flown.cause)) if flown.cause[k]), None)
    left = np.flatnonzero(off > 2.0)
    x, y = flown.true[:, 0], flown.true[:, 1]
    outside = np.max(np.maximum.reduce([-60.0 - x, x - 400.0, np.abs(y) - 80.0]))
    return Row(
        vehicle, kind, channel,
        None if noticed is None else (noticed - first) * period_s,
        (left[0] - first) * period_s if len(left) else None,
        float(off.max()), float(flown.true[:, 2].max()), max(float(outside), 0.0),
        "" if noticed is None else flown.cause[noticed],
    )  # fmt: skip


def table(vehicle: str, kinds: tuple[str, ...] = KINDS, channels: tuple[str, ...] = CHANNELS) -> list[Row]:
    """The rows of a vehicle."""
    usual = fly(vehicle)
    pairs = product(kinds, channels)
    return [row(vehicle, kind, c, usual, fly(vehicle, fault(kind, c))) for kind, c in pairs]


def cell(row: Row) -> str:
    """Noticed after, s / farthest off the course, m / deepest, m, and what of the goal is not met."""
    noticed = "–" if row.noticed_s is None else f"{row.noticed_s:.0f}"
    unmet = f" **{row.unmet}**" if row.unmet else ""
    return f"{noticed} / {row.farthest_m:.0f} / {row.deepest_m:.0f}{unmet}"


if __name__ == "__main__":
    for vehicle in sys.argv[1:] or list(VEHICLES):
        rows = {(row.kind, row.channel): row for row in table(vehicle)}
        print(f"\n| {vehicle} | {' | '.join(CHANNELS)} |\n|---|{'---|' * len(CHANNELS)}")
        for kind in KINDS:
            print(f"| {kind} | {' | '.join(cell(rows[kind, c]) for c in CHANNELS)} |", flush=True)
