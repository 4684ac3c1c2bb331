"""What `Helm` believes: jumps, resets that stay, and sensors that repeat one value under way."""

from __future__ import annotations

import numpy as np
import pytest

import seatrial as st
from seatrial._core import Helm, Run

MISSION = """
format = 1
name = "out"
speed_m_s = 1.5
acceptance_radius_m = 5.0
[limits]
max_depth_m = 25.0
[[legs]]
north_m = 400.0
east_m = 0.0
depth_m = 20.0
"""

LEVEL = MISSION.replace("depth_m = 20.0", "depth_m = 0.0")

HOLD = MISSION.replace("north_m = 400.0", "north_m = 1.0\nhold_s = 600.0").replace(
    "depth_m = 20.0", "depth_m = 2.0"
)

PERIOD_S = 0.1

CHANNELS = ("x", "y", "z", "roll", "pitch", "yaw", "u", "v", "w", "p", "q", "r")

NOISE = np.array([0.1, 0.1, 0.01] + [1e-3] * 3 + [5e-3] * 3 + [1e-3] * 3)


class Boat:
    """A simulated vehicle under a helm, a control period at a time."""

    def __init__(self, name: str = "remus100", mission: str = MISSION, *, noise: float = 1.0) -> None:
        self.vehicle = st.Vehicle.load(name)
        self.helm: Helm = st.Autopilot.load(name).engage(self.vehicle, st.Mission.from_toml(mission))
        self.neutral = dict.fromkeys(self.vehicle.actuators, np.zeros(2))
        self.random, self.noise = np.random.default_rng(1), noise * NOISE
        self.supply = {"voltage": 14.8} if name == "bluerov2-heavy" else {}
        self.voltage = np.full(2, 14.8) if self.supply else None
        start = st.State(nu=np.array([1.5, 0, 0, 0, 0, 0])) if name == "remus100" else None
        self.run: Run = self.vehicle.simulate([0.0, 1e-3], self.neutral, start, voltage_v=self.voltage)
        self.commands: dict[str, float] = {}

    def told(self) -> dict[str, float]:
        true = np.concatenate([self.run.position[-1], self.run.euler[-1], self.run.nu[-1]])
        noisy = true + self.noise * self.random.normal(size=12)
        return dict(zip(CHANNELS, map(float, noisy), strict=True)) | self.supply

    def go(self, seconds: float, /, **instead: float) -> None:
        self.go_off(seconds, {}, **instead)

    def go_off(self, seconds: float, off: dict[str, float], /, **instead: float) -> None:
        """With errors `off` in some channels, and others shown as they are given."""
        for _ in range(round(seconds / PERIOD_S)):
            told = self.told()
            told |= {name: told[name] + error for name, error in off.items()}
            self.commands = self.helm.step(told | instead)
            held = {name: np.full(2, value) for name, value in self.commands.items()}
            self.run = self.vehicle.simulate(
                [0.0, PERIOD_S], held, self.run.final_state, max_step_s=0.05, voltage_v=self.voltage
            )

    @property
    def reaction(self) -> tuple[object, object, object]:
        thought = self.helm.thought
        return thought["reaction"], thought["cause"], thought["channel"]

    @property
    def depth(self) -> float:
        return float(self.run.position[-1, 2])


def test_law_a_frozen_depth_does_not_lead_through_the_depth_limit() -> None:
    boat = Boat()
    boat.go(10.0)
    frozen = boat.told()["z"]
    boat.go(12.0, z=frozen)
    assert boat.reaction == ("abort", "stale_depth", "z")
    assert boat.depth < 15.0
    count, why = boat.helm.refused["z"]
    assert count > 20
    assert "the other sensors say that it must have changed" in why


@pytest.mark.parametrize(
    ("channel", "cause", "seconds"),
    [
        ("x", "contradicted_position", 63.0),
        ("pitch", "stale_attitude", 15.0),
        ("q", "stale_rates", 15.0),
        ("w", None, 15.0),
    ],
)
def test_a_channel_that_repeats_while_the_vehicle_moves_grows_as_old_as_its_value(
    channel: str, cause: str | None, seconds: float
) -> None:
    boat = Boat(mission=LEVEL if channel == "x" else MISSION)
    boat.go(3.0)
    boat.go(seconds, **{channel: boat.told()[channel]})
    assert boat.helm.thought["cause"] == (cause or "")
    assert boat.helm.thought["channel"] == (channel if cause else "")


def test_a_heading_that_repeats_in_a_turn_is_found() -> None:
    around = LEVEL.replace("north_m = 400.0\neast_m = 0.0", "north_m = 0.0\neast_m = 400.0")
    for channel, cause in (("yaw", "stale_attitude"), ("r", "stale_rates")):
        boat = Boat(mission=around)
        boat.go(2.0)
        boat.go(15.0, **{channel: boat.told()[channel]})
        assert boat.reaction == ("abort", cause, channel)


@pytest.mark.parametrize("name", ["remus100", "bluerov2-heavy", "cwolf"])
@pytest.mark.parametrize("digits", [0.0, 1.0])
def test_law_perfect_and_coarse_sensors_are_not_frozen(name: str, digits: float) -> None:
    coarse = dict(zip(CHANNELS, [1.0, 1.0, 0.1, *[0.0175] * 3, *[0.05] * 3, *[0.0175] * 3], strict=True))
    boat = Boat(name, HOLD if name != "remus100" else MISSION, noise=0.0)
    for _ in range(60):
        shown = boat.told()
        if digits:
            shown |= {k: round(shown[k] / d) * d for k, d in coarse.items()}
        boat.go(PERIOD_S, **shown)
    boat.go(40.0) if not digits else None
    assert boat.helm.thought["reaction"] == "continue"
    assert boat.helm.refused == {}


def test_a_vehicle_that_lies_still_may_repeat_everything() -> None:
    one = st.Autopilot.load("cwolf").engage(st.Vehicle.load("cwolf"), st.Mission.from_toml(LEVEL))
    still = dict.fromkeys(CHANNELS, 0.0)
    for _ in range(600):
        one.step(still)
    assert one.thought["reaction"] == "continue"
    assert one.refused == {}


def test_a_depth_that_is_held_between_slow_samples_is_not_frozen() -> None:
    boat = Boat()
    for _ in range(20):
        boat.go(1.0, z=boat.told()["z"])
    assert boat.helm.thought["reaction"] == "continue"


def test_frozen_after_a_year_is_never() -> None:
    text = st.Autopilot.load("remus100").to_toml().replace("frozen_after_s = 2.0", "frozen_after_s = 3.15e7")
    boat = Boat()
    boat.helm = st.Autopilot.from_toml(text).engage(boat.vehicle, st.Mission.from_toml(MISSION))
    boat.go(10.0)
    boat.go(10.0, z=boat.told()["z"])
    assert boat.helm.thought["reaction"] == "continue"


@pytest.mark.parametrize(
    ("channel", "jump"), [("z", 40.0), ("yaw", 1.5708), ("u", 5.0), ("r", 3.0), ("x", 300.0)]
)
def test_law_one_sample_that_jumps_does_not_shake_the_boat(channel: str, jump: float) -> None:
    boat, other = Boat(), Boat()
    boat.go(10.0)
    other.go(10.0)
    boat.go_off(PERIOD_S, {channel: jump})
    other.go(PERIOD_S, **{channel: np.nan})
    assert boat.commands == other.commands  # as if it had not been measured
    boat.go(PERIOD_S)
    assert boat.helm.ages[channel] == 0.0
    count, why = boat.helm.refused[channel]
    assert (count, why) == (1, "changed faster than any vehicle")


@pytest.mark.parametrize(("channel", "jump", "most"), [("z", -15.0, 0.25), ("yaw", 1.5708, 0.25)])
def test_law_a_jump_that_stays_is_believed_after_a_second_and_smoothly(
    channel: str, jump: float, most: float
) -> None:
    boat = Boat(mission=LEVEL)
    boat.go(10.0)
    changes = []
    # Later on a heading that is a right angle off contradicts position and velocity: a reaction follows.
    for k in range(60):
        before = boat.commands
        boat.go_off(PERIOD_S, {channel: jump})
        fins = [name for name in boat.commands if name != "propeller"]
        changes.append(max(abs(boat.commands[name] - before[name]) for name in fins))
        assert (boat.helm.ages[channel] > 0.0) == (k < 10), k
    assert boat.helm.thought["reaction"] == "continue"
    assert boat.helm.refused[channel][0] == 10
    # A fin may go from stop to stop in seconds, not in a period.
    assert max(changes) < most, max(changes)


def test_garbage_that_jumps_about_ends_in_the_reaction_of_its_watch() -> None:
    boat = Boat(mission=LEVEL)
    boat.go(5.0)
    for k in range(25):
        boat.go(PERIOD_S, yaw=(1.4, -1.4, 2.9)[k % 3])
    assert boat.reaction == ("abort", "stale_attitude", "yaw")
