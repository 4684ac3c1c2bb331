"""Events: which stretches of a command count, and which do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import seatrial as st
from seatrial.inspect.feedback import EventLimits, events

LIMIT = 0.2374  # rad, of the rudder of REMUS 100


def recording(rudder: np.ndarray, dt: float = 0.1) -> st.Trial:
    """A trial at 1.7 m/s with this rudder; its motion does not matter here."""
    t = np.arange(len(rudder)) * dt
    columns = {"t_s": t, "u_m_s": np.full(len(t), 1.7), "v_m_s": 0.0 * t, "yaw_deg": 0.0 * t}
    rudders = {f"cmd.rudder_{side}": rudder for side in ("upper", "lower")}
    return st.Trial.read(columns | rudders, name="log", align=False)


def answering(t: np.ndarray, seed: int = 1) -> np.ndarray:
    """A rudder that answers waves of 5 s: a degree about its middle, never at rest."""
    noise = np.random.default_rng(seed).normal(size=len(t)).cumsum()
    return np.asarray(0.015 * np.sin(1.2 * t) + 0.002 * (noise - noise.mean()) / noise.std())


def test_a_rudder_at_its_limit_is_an_event_and_one_that_answers_waves_is_none() -> None:
    t = np.arange(0.0, 200.0, 0.1)
    rudder = answering(t)
    for start, sign in ((40.0, 1.0), (90.0, -1.0), (150.0, 1.0)):
        rudder[(t >= start) & (t < start + 12.0)] = sign * LIMIT
    found = events(recording(rudder), st.Vehicle.load("remus100"), "N")
    assert [event.start_s for event in found] == pytest.approx([40.1, 90.1, 150.1], abs=0.06)
    assert [event.stop_s - event.start_s for event in found] == pytest.approx([11.8] * 3, abs=0.2)
    assert [event.command for event in found] == pytest.approx([LIMIT, -LIMIT, LIMIT])
    assert {event.kind for event in found} == {"limit"}
    assert not events(recording(answering(t)), st.Vehicle.load("remus100"), "N")


def test_an_event_is_as_long_as_its_limits_say_and_a_small_step_is_none() -> None:
    t = np.arange(0.0, 200.0, 0.1)
    rudder = answering(t)
    for start, length in ((30.0, 4.0), (60.0, 60.0)):
        rudder[(t >= start) & (t < start + length)] = LIMIT
    rudder[(t >= 150.0) & (t < 162.0)] = rudder[1500]
    remus = st.Vehicle.load("remus100")
    (long,) = events(recording(rudder), remus, "N")
    assert long.stop_s - long.start_s == pytest.approx(20.0, abs=0.2)
    brief = events(recording(rudder), remus, "N", limits=EventLimits(least_s=3.0))
    assert [round(event.start_s) for event in brief] == [30, 60]


def test_what_is_held_out_is_in_no_event_nor_the_moment_before_it() -> None:
    t = np.arange(0.0, 100.0, 0.1)
    rudder = answering(t)
    rudder[(t >= 40.0) & (t < 60.0)] = LIMIT
    trial, remus = recording(rudder), st.Vehicle.load("remus100")
    assert len(events(trial, remus, "N", t < 55.0)) == 1
    assert not events(trial, remus, "N", t > 39.0)
    assert not events(trial, remus, "N", t < 43.0)


def test_a_gap_of_the_log_is_no_command_that_is_held() -> None:
    t = np.arange(0.0, 100.0, 0.1)
    rudder = answering(t)
    gap = (t >= 40.0) & (t < 60.0)
    rudder[gap] = LIMIT
    assert not events(replace(recording(rudder), silent=gap), st.Vehicle.load("remus100"), "N")


def test_a_command_that_creeps_is_not_held() -> None:
    t = np.arange(0.0, 100.0, 0.1)
    rudder = answering(t)
    inside = (t >= 40.0) & (t < 60.0)
    rudder[inside] = LIMIT - 0.008 * (t[inside] - 40.0)
    assert not events(recording(rudder), st.Vehicle.load("remus100"), "N")


def test_an_axis_without_commands_has_no_events() -> None:
    t = np.arange(0.0, 20.0, 0.1)
    assert not events(recording(0.0 * t), st.Vehicle.load("remus100"), "N")
    assert not events(recording(answering(t)), st.Vehicle.load("remus100"), "X")
