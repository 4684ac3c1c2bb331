"""A state machine flies `Helm` with arbitrary losses, frozen values, jumps and garbage in every channel.

Whatever arrives: no exception, commands finite and within the limits of the actuators, and no channel in use
goes without a good sample for longer than its watch (and a step) before a reaction is called for.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from hypothesis import settings
from hypothesis import strategies as some
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

import seatrial as st
from seatrial._core import Helm, Vehicle

MISSION = """
format = 1
name = "out"
speed_m_s = 1.0
acceptance_radius_m = 5.0
[limits]
max_depth_m = 60.0
[[legs]]
north_m = 500.0
east_m = 200.0
depth_m = 10.0
"""

CHANNELS = ("x", "y", "z", "roll", "pitch", "yaw", "u", "v", "w", "p", "q", "r")

WATCHES = {
    **dict.fromkeys("xy", "stale_position"),
    "z": "stale_depth",
    **dict.fromkeys(("roll", "pitch", "yaw"), "stale_attitude"),
    **dict.fromkeys("uvw", "stale_velocity"),
    **dict.fromkeys("pqr", "stale_rates"),
}

VEHICLES = {name: Vehicle.load(name) for name in ("cwolf", "remus100", "lauv", "bluerov2-heavy")}

PERIOD_S = 0.1

ROUNDING = 1e-6  # of a command, in its unit

FARTHEST = 1e8  # no channel may be as large

GARBAGE = some.one_of(
    some.floats(),
    some.none(),
    some.sampled_from([1e4, -1e4, 270.0, 1e300, -1e300, 5e-324, math.inf, -math.inf]),
)


class HelmAtSea(RuleBasedStateMachine):
    """A vehicle that wanders as it likes; what its sensors tell of it is broken channel by channel."""

    @initialize(name=some.sampled_from(sorted(VEHICLES)), seed=some.integers(0, 2**32))
    def cast_off(self, name: str, seed: int) -> None:
        self.vehicle = VEHICLES[name]
        self.helm: Helm = st.Autopilot.load(name).engage(self.vehicle, st.Mission.from_toml(MISSION))
        safety: Any = st.Autopilot.load(name).safety()
        self.after_s = {watch: safety[watch]["after_s"] for watch in WATCHES.values()}
        self.random = np.random.default_rng(seed)
        self.true = dict.fromkeys(CHANNELS, 0.0) | {"z": 2.0, "u": 0.5}
        self.broken: dict[str, Any] = {}
        self.good_s = dict.fromkeys(
            CHANNELS, 0.0
        )  # when the last sample came that was neither lost nor garbage
        self.now_s = 0.0
        self.reacted = False
        self.commands: dict[str, float] = {}
        self.step(PERIOD_S)
        assert self.helm.waiting_for == []

    def step(self, dt_s: float) -> None:
        self.now_s += dt_s
        true = self.true
        true["yaw"] = math.remainder(true["yaw"] + dt_s * true["r"], math.tau)
        true["x"] += dt_s * true["u"] * math.cos(true["yaw"])
        true["y"] += dt_s * true["u"] * math.sin(true["yaw"])
        noise = self.random.normal(0.0, 1e-3, len(CHANNELS))
        told: dict[str, Any] = {name: true[name] + float(e) for name, e in zip(CHANNELS, noise, strict=True)}
        for name in CHANNELS:
            if name not in self.broken:
                self.good_s[name] = self.now_s
            elif self.broken[name] == "lost":
                told.pop(name)
            elif self.broken[name] == "wild":
                told[name] = float(self.random.uniform(-1e6, 1e6))
            else:
                told[name] = self.broken[name][0]
                if not self.impossible(name):
                    self.good_s[name] = self.now_s  # it may be: only the rest of the motion could tell
        self.commands = self.helm.step(told | {"voltage": 14.8, "battery": 0.9}, dt_s=dt_s)
        self.reacted = self.reacted or self.helm.thought["reaction"] != "continue"

    @rule(steps=some.integers(1, 40), dt_s=some.sampled_from([0.05, 0.1, 0.13, 0.5]))
    def go_on(self, steps: int, dt_s: float) -> None:
        for _ in range(steps):
            self.step(dt_s)

    @rule(channel=some.sampled_from(CHANNELS))
    def lose(self, channel: str) -> None:
        self.broken[channel] = "lost"

    @rule(channel=some.sampled_from(CHANNELS))
    def go_wild(self, channel: str) -> None:
        self.broken[channel] = "wild"

    @rule(channel=some.sampled_from(CHANNELS), value=GARBAGE)
    def show_garbage(self, channel: str, value: float | None) -> None:
        self.broken[channel] = (value,)

    @rule(channel=some.sampled_from(CHANNELS))
    def freeze(self, channel: str) -> None:
        self.broken[channel] = (self.true[channel],)

    @precondition(lambda self: self.broken)
    @rule()
    def mend(self) -> None:
        self.broken.popitem()

    @rule(turn=some.floats(-0.3, 0.3), speed=some.floats(-0.5, 2.0), jump=some.floats(-50.0, 50.0))
    def move(self, turn: float, speed: float, jump: float) -> None:
        self.true |= {"r": turn, "u": speed, "z": min(max(self.true["z"] + jump, 0.0), 50.0)}

    @rule(pause_s=some.floats(1.0, 300.0))
    def pause(self, pause_s: float) -> None:
        self.step(pause_s)

    def impossible(self, channel: str) -> bool:
        shown = self.broken.get(channel)
        return isinstance(shown, tuple) and not (shown[0] is not None and abs(shown[0]) < FARTHEST)

    @invariant()
    def commands_are_possible(self) -> None:
        for name, value in self.commands.items():
            facts: Any = self.vehicle.actuator_info()[name]
            signal = (value - facts["neutral"]) * (-1.0 if facts["reversed"] else 1.0)
            within = -facts["maximum_astern"] - ROUNDING <= signal <= facts["maximum_ahead"] + ROUNDING
            assert within, (name, value)  # a number, too

    @invariant()
    def nothing_in_use_is_lost_unnoticed(self) -> None:
        if self.reacted:
            return
        for name in self.helm.ages:
            if self.broken.get(name) in ("lost", "wild") or self.impossible(name):
                silent = self.now_s - self.good_s[name]
                assert silent <= self.after_s[WATCHES[name]] + 0.6, (name, silent)


TestHelmAtSea = HelmAtSea.TestCase
TestHelmAtSea.settings = settings(max_examples=40, stateful_step_count=30, deadline=None)
