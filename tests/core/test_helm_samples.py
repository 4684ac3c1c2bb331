"""What `Helm` makes of samples that are lost, impossible, frozen, jump, or come at odd times."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import seatrial as st
from seatrial._core import Helm
from seatrial.base.errors import SimulationError

MISSION = """
format = 1
name = "out"
speed_m_s = 1.5
acceptance_radius_m = 5.0
[[legs]]
north_m = 300.0
east_m = 0.0
depth_m = 5.0
"""

MOVING = {
    "x": 0.0,
    "y": 0.0,
    "z": 3.0,
    "roll": 0.0,
    "pitch": 0.0,
    "yaw": 0.0,
    "u": 1.0,
    "v": 0.0,
    "w": 0.0,
    "p": 0.0,
    "q": 0.0,
    "r": 0.0,
}


def helm(name: str = "cwolf", mission: str = MISSION) -> Helm:
    return st.Autopilot.load(name).engage(st.Vehicle.load(name), st.Mission.from_toml(mission))


def sample(k: int) -> dict[str, float]:
    """Of a vehicle under way: every sensor has its noise, and so never repeats a value."""
    noise = np.random.default_rng(k).normal(0.0, 1e-3, len(MOVING))
    values = {name: value + float(e) for (name, value), e in zip(MOVING.items(), noise, strict=True)}
    return values | {"x": values["x"] + 0.1 * k, "voltage": 14.8}


def react(one: Helm, lost: str, *, seconds: float = 70.0) -> tuple[float, dict[str, Any]] | None:
    """When it reacted after `lost` was lost at 5 s, and what it thought; None if it did not."""
    for k in range(round((5.0 + seconds) / 0.1)):
        told = sample(k)
        if k >= 50:
            told.pop(lost)
        one.step(told)
        if one.thought["reaction"] != "continue":
            return k * 0.1 - 4.9, one.thought
    return None


@pytest.mark.parametrize(
    ("channel", "watch", "after_s"),
    [
        ("x", "stale_position", 60.0),
        ("y", "stale_position", 60.0),
        ("z", "stale_depth", 5.0),
        ("roll", "stale_attitude", 2.0),
        ("pitch", "stale_attitude", 2.0),
        ("yaw", "stale_attitude", 2.0),
        ("u", "stale_velocity", 20.0),
        ("v", "stale_velocity", 20.0),
        ("w", "stale_velocity", 20.0),
        ("q", "stale_rates", 2.0),
        ("r", "stale_rates", 2.0),
    ],
)
def test_law_one_channel_that_is_lost_is_missed_whatever_else_of_its_group_arrives(
    channel: str, watch: str, after_s: float
) -> None:
    found = react(helm(), channel)
    assert found is not None
    late, thought = found
    assert (thought["cause"], thought["channel"]) == (watch, channel)
    assert after_s - 0.05 < late < after_s + 0.25  # a period of sampling, one of looking


@pytest.mark.parametrize("channel", ["v", "w", "p"])
def test_a_torpedo_goes_on_without_what_none_of_its_loops_reads(channel: str) -> None:
    assert react(helm("remus100"), channel, seconds=25.0) is None


@pytest.mark.parametrize("channel", ["v", "p"])
def test_a_vehicle_of_six_loops_misses_the_same_channels(channel: str) -> None:
    assert react(helm("bluerov2-heavy"), channel, seconds=25.0) is not None


def test_it_waits_for_every_channel_that_it_needs() -> None:
    one = helm()
    for k in range(50):
        told = sample(k)
        told.pop("yaw")
        assert set(one.step(told).values()) == {0.0}
    assert one.waiting_for == ["attitude"]
    assert one.ages["yaw"] == math.inf
    assert one.ages["roll"] == 0.0
    one.step(sample(50))
    assert one.waiting_for == []
    # Its roll has no loop.
    torpedo = helm("remus100")
    torpedo.step({name: value for name, value in sample(0).items() if name not in ("p", "v", "w")})
    assert torpedo.waiting_for == []
    assert "v" not in torpedo.ages


@pytest.mark.parametrize(
    ("channel", "value", "says"),
    [
        ("yaw", 270.0, "expected -6.3 to 6.3 rad, found 270"),
        ("u", 1e4, "expected -50 to 50 m/s, found 10000"),
        ("pitch", -45.0, "rad"),
        ("z", 1e9, "m, found 1000000000"),
        ("r", np.inf, "found inf"),
        ("x", -np.inf, "found -inf"),
        ("altitude", -np.inf, "found -inf"),
        ("battery", 85.0, "from 0 to 1, found 85"),
        ("voltage", -3.0, "positive supply"),
    ],
)
def test_what_cannot_be_true_under_way_was_not_measured_and_is_counted(
    channel: str, value: float, says: str
) -> None:
    one, without = helm(), helm()
    one.step(sample(0))
    without.step(sample(0))
    for k in range(1, 10):
        told = sample(k)
        garbled = one.step(told | {channel: value})
        told.pop(channel, None)
        assert garbled == without.step(told)
    count, why = one.refused[channel]
    assert count == 9
    assert says in why
    assert without.refused == {}


def test_heading_may_be_unwrapped_as_long_as_it_does_not_jump() -> None:
    one = helm()
    for k in range(400):
        one.step(sample(k) | {"yaw": 0.05 * k, "r": 0.5})
    assert one.refused == {}
    assert one.ages["yaw"] == 0.0


@pytest.mark.parametrize("value", ["abc", "1.0", [1.0, 2.0], {}, 1j, object()])
def test_what_is_no_number_is_refused_by_its_name_and_nothing_is_taken(value: Any) -> None:
    one = helm()
    with pytest.raises(SimulationError, match="yaw: expected"):
        one.step(sample(0) | {"yaw": value})
    assert one.waiting_for == ["position", "depth", "attitude", "rates"]


def test_a_measurement_that_is_no_mapping_of_names_is_refused() -> None:
    one: Any = helm()
    with pytest.raises(SimulationError, match="expected numbers by name"):
        one.step(5)
    with pytest.raises(SimulationError, match="expected names as text"):
        one.step({1: 2.0})


@pytest.mark.parametrize("nothing", [None, np.nan])
def test_nothing_is_no_sample(nothing: Any) -> None:
    one: Any = helm()
    one.step(sample(0))
    one.step(sample(1) | {"yaw": nothing})
    assert one.ages["yaw"] == pytest.approx(0.1)
    assert one.refused == {}


def test_law_time_that_is_told_is_the_time_that_is_counted() -> None:
    plain, stamped, spaced = helm(), helm(), helm()
    for k in range(100):
        expected = plain.step(sample(k))
        assert stamped.step(sample(k), time_s=1e3 + 0.1 * k) == expected
        assert spaced.step(sample(k), dt_s=0.1) == expected


def test_ages_count_irregular_intervals_and_pauses() -> None:
    one = helm()
    one.step(sample(0), time_s=10.0)
    told = {name: value for name, value in sample(1).items() if name != "yaw"}
    for time_s in (10.1, 10.35, 10.4, 11.0):
        one.step(told, time_s=time_s)
        assert one.ages["yaw"] == pytest.approx(time_s - 10.0)
    one.step(told, time_s=11.95)
    assert one.thought["reaction"] == "continue"
    one.step(told, time_s=12.05)
    assert (one.thought["cause"], one.thought["channel"]) == ("stale_attitude", "yaw")
    paused = helm()
    paused.step(sample(0), time_s=10.0)
    commands = paused.step(sample(1), time_s=40.0)  # all is there again: no reason to stop
    assert paused.thought["reaction"] == "continue"
    assert np.isfinite(list(commands.values())).all()
    paused.step({"battery": 0.9}, time_s=43.0)
    assert paused.thought["reaction"] == "abort"


def test_samples_between_two_periods_keep_the_commands() -> None:
    one = helm()
    commands = one.step(sample(0), time_s=0.0)
    assert one.step(sample(1), time_s=0.04) == commands
    assert one.ages["yaw"] == 0.0
    assert one.step(sample(2), time_s=0.1) != commands


@pytest.mark.parametrize(
    ("when", "says"),
    [
        ({"time_s": 4.9}, "time_s: expected a time after that of the last step, 5 s, found 4.9"),
        ({"time_s": 5.0}, "time_s"),
        ({"time_s": math.nan}, "time_s: expected a finite time"),
        ({"dt_s": 0.0}, "dt_s: expected a positive time"),
        ({"dt_s": -0.1}, "dt_s"),
        ({"dt_s": math.inf}, "dt_s"),
        ({"dt_s": 0.1, "time_s": 5.1}, "found both"),
    ],
)
def test_a_time_that_does_not_advance_is_refused_and_nothing_is_taken(
    when: dict[str, float], says: str
) -> None:
    one = helm()
    one.step(sample(0), time_s=5.0)
    before = one.ages
    with pytest.raises(SimulationError, match=says):
        one.step(sample(1), **when)  # type: ignore[arg-type]
    assert one.ages == before
