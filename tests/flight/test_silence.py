"""What a report says of samples that a watch missed: whether they came, and why not."""

from __future__ import annotations

import seatrial as st
from seatrial.sensors.sensor import Sensor, load_sensors

MISSION = """
format = 1
name = "out"
speed_m_s = 1.5
acceptance_radius_m = 5.0
[[legs]]
north_m = 150.0
east_m = 0.0
depth_m = 3.0
"""


def reaction(noise: float, dropout: dict[str, float], *outages: st.Outage) -> str:
    """The sentence on the reaction of a flight with such a Doppler log."""
    own = {"noise_m_s": noise, "rate_hz": 5.0} | dropout
    sensors = load_sensors("typical", st.Vehicle.load("cwolf")) | {"dvl": Sensor.parse("dvl", own)}
    flight = st.fly(
        "cwolf",
        "cwolf",
        st.Mission.from_toml(MISSION),
        conditions=st.Conditions(sensors=sensors, outages=outages, max_time_s=90.0),
        seed=3,
    )
    return next((said for said in flight.sentences() if said.startswith("Reaction")), "")


def test_a_silent_sensor_is_not_called_refused() -> None:
    said = reaction(0.008, {}, st.Outage("velocity", 20.0, 45.0))
    assert "stale" not in said
    assert "gave no sample from 19.8 s until 45" in said
    assert said.endswith("; none was refused.")
    assert "drop-outs" not in said


def test_drop_outs_that_follow_an_outage_are_told_from_it() -> None:
    often = {"dropout_every_s": 4.0, "dropout_s": 60.0}
    said = reaction(0.008, often, st.Outage("dvl", 1.0, 12.0))
    assert "beyond the outage that ended at 12.0 s, by drop-outs of its own" in said, said


def test_a_sensor_without_noise_may_repeat_a_value() -> None:
    said = reaction(0.0, {}, st.Outage("velocity", 20.0, 45.0))
    assert said.endswith("arrived for too long."), said
