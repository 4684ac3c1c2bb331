"""What is said of a reaction of the safety: its cause, what came of the vehicle, and what to do first."""

from __future__ import annotations

from typing import Any

import numpy as np

import seatrial as st
from tests.flight.flying import grouped

MISSION = """
format = 1
name = "limits"
speed_m_s = 1.8
acceptance_radius_m = 4.0
[start]
depth_m = 5.0
[limits]
max_depth_m = 6.2
fence_m = [[-30.0, -30.0], [120.0, -30.0], [120.0, 120.0], [-30.0, 120.0]]
[[legs]]
north_m = 100.0
east_m = 0.0
depth_m = 6.0
[[legs]]
north_m = 100.0
east_m = 100.0
depth_m = 6.0
"""


def _report(vehicle: str, **around: Any) -> tuple[st.Flight, str, str]:
    flight = st.fly(vehicle, vehicle, st.Mission.from_toml(MISSION), **grouped(**around))
    said = flight.report()
    return flight, said.worst, said.next_step


def test_a_vehicle_that_sinks_after_an_abort_is_told_before_the_limit() -> None:
    """The water goes down faster than one newton of buoyancy brings the vehicle up."""
    flight, worst, next_step = _report("lauv", current=(0.0, 0.0, 0.1))
    deep = float(flight.position[-1, 2])
    assert deep > 10.0
    assert worst.startswith("the safety called for abort at ")
    assert f"lauv did not come up in the 120 s after: it sank from 6.2 to {deep:.1f} m" in worst
    assert next_step.startswith('let it come up under power (depth = "surface" under [safety]')
    assert "raise the mission's largest depth" not in next_step
    assert any("lauv did not come up" in said for said in flight.sentences())


def test_a_vehicle_that_still_rises_after_an_abort_is_told_without_another_remedy() -> None:
    flight, worst, next_step = _report("lauv", faults=[st.Fault("propeller", 30.3183)])
    assert flight.outcome == "aborted"
    assert "propeller is dead from 30.32 s on" in str(flight)
    assert " m deep, and rose at " in worst
    assert next_step.startswith("repair it")


def test_the_watch_of_the_depth_believes_the_sensor_where_a_filter_takes_waves_for_noise() -> None:
    """The estimate without waves stays above the limit, the vehicle and its depth sensor do not."""
    waves = st.SeaState(height_m=2.0, period_s=8.0, toward_deg=180.0)
    flight, _, _ = _report("lauv", sensors="typical", navigation="filter", waves=waves)
    called = flight.t <= flight.alerts[0].t_s
    assert np.max(flight.measured["z"][called]) < 6.2 < np.max(flight.position[called, 2])
    assert (flight.outcome, flight.alerts[0].cause) == ("aborted", "depth")


def test_a_lost_position_comes_before_the_fence_that_it_led_through() -> None:
    outage = st.Outage("position", 20.0)
    flight, worst, next_step = _report("remus100", sensors="typical", outages=[outage])
    assert worst.startswith("the safety called for surface at ")
    assert "arrived for too long (no samples of position from 20 s on)" in worst
    assert "outside the mission's fence" in worst
    assert next_step.startswith("shorten stale_position.after_s (60 s) under [safety]")
    assert "widen" not in next_step
    assert flight.outcome == "surfaced"
