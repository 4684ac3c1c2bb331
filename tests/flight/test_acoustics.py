"""USBL, ranges, sonar and GPS of a flight: what its navigation filter makes of them, and refusals."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import seatrial as st
from seatrial.base.errors import SimulationError, TrialError, VehicleError
from seatrial.sensors.log import measure
from seatrial.sensors.sensor import Sensor, load_sensors, parse_sensors
from tests.flight.flying import grouped

SURVEY = """
format = 1
name = "cage survey"
speed_m_s = 1.0
acceptance_radius_m = 3.0
[start]
north_m = -45.0
east_m = 0.0
depth_m = 5.0
[[landmarks]]
kind = "pen"
name = "net"
north_m = 0.0
east_m = 0.0
radius_m = 25.0
[[landmarks]]
kind = "beacon"
name = "A"
north_m = 60.0
east_m = 60.0
depth_m = 15.0
[[landmarks]]
kind = "beacon"
name = "B"
north_m = -60.0
east_m = 60.0
depth_m = 15.0
[[legs]]
kind = "perimeter"
north_m = 0.0
east_m = 0.0
radius_m = 25.0
distance_m = 3.0
margin_m = 7.0
depths_m = [5.0]
start_bearing_deg = 180.0
"""

USBL = Sensor(
    noise=0.5,
    rate_hz=0.5,
    latency_s=1.0,
    outlier_share=0.05,
    outlier=20.0,
    dropout_every_s=60.0,
    dropout_s=6.0,
)
SONAR = {
    "range": Sensor(noise=0.2, rate_hz=1.0, max_range_m=40.0, outlier_share=0.05, outlier=10.0),
    "bearing": Sensor(noise=1.0, rate_hz=1.0, max_range_m=40.0),
}


def around(sensors: dict[str, Sensor], mission: str = SURVEY, seeds: int = 4) -> dict[str, np.ndarray]:
    """Figures of flights about the cage on the filter's estimate, in a current, without a Doppler log."""
    basic = load_sensors("typical", st.Vehicle.load("cwolf"))
    told = {kind: basic[kind] for kind in ("attitude", "gyro", "depth", "gps", "dvl")}
    outages = [st.Outage("velocity", from_s=30.0)]
    flights = st.fly_batch(
        "cwolf",
        "cwolf",
        st.Mission.from_toml(mission),
        conditions=st.Conditions(sensors=told | sensors, navigation="filter", outages=outages),
        seeds=list(range(seeds)),
        water=st.Water(current=[0.1, 0.1, 0.0]),
    )
    return flights.figures


def test_acoustics_hold_the_way_about_a_cage_and_outliers_are_refused() -> None:
    without = around({})["true_cross_track_rms"]
    usbl, sonar = around({"usbl": USBL}), around(SONAR)
    # The fix of the start is 1.5 m off, and nothing but acoustics sees the current after 30 s.
    for figures, kind in ((usbl, "usbl"), (sonar, "range")):
        assert figures["true_cross_track_rms"].max() < 1.5
        assert np.mean(figures["true_cross_track_rms"]) < 0.6 * np.mean(without)
        assert np.mean(figures[f"navigation_{kind}_refused"]) > 1.0
        assert 0.6 < np.mean(figures[f"navigation_{kind}_nis"]) < 1.4
    clean = around({"usbl": replace(USBL, outlier_share=0.0)})
    assert np.sum(clean["navigation_usbl_refused"]) < 0.2 * np.sum(usbl["navigation_usbl_refused"])
    assert "navigation_usbl_samples" not in sonar


def test_a_flight_alone_hears_what_it_hears_among_others() -> None:
    vehicle = st.Vehicle.load("cwolf")
    told = load_sensors("typical", vehicle) | {"usbl": USBL} | SONAR
    common: dict[str, Any] = {"sensors": told, "navigation": "filter", "max_time_s": 60.0}
    mission = st.Mission.from_toml(SURVEY)
    both = st.fly_batch(vehicle, "cwolf", mission, **grouped(seeds=[5, 6], **common))
    for case, seed in enumerate((5, 6)):
        alone = st.fly_batch(vehicle, "cwolf", mission, **grouped(seeds=[seed], **common))
        for name in ("navigation_usbl_samples", "navigation_range_samples"):
            assert alone.figures[name][0] == both.figures[name][case]
        assert alone.figures["distance"][0] == pytest.approx(both.figures["distance"][case], rel=1e-6)


def test_a_gps_tells_at_the_surface_only_and_reach_ends_what_is_heard() -> None:
    vehicle = st.Vehicle.load("cwolf")
    told = {kind: s for kind, s in load_sensors("typical", vehicle).items() if kind != "dvl_water"}
    for depth, fixes in ((0.0, True), (5.0, False)):
        mission = st.Mission.from_toml(SURVEY.replace("depth_m = 5.0", f"depth_m = {depth}", 1))
        flights = st.fly_batch(
            vehicle,
            "cwolf",
            mission,
            conditions=st.Conditions(sensors=told, navigation="filter", max_time_s=20.0),
        )
        assert ("navigation_gps_samples" in flights.figures) == fixes
    near = told | {"usbl": replace(USBL, max_range_m=10.0)}
    flights = st.fly_batch(
        vehicle,
        "cwolf",
        st.Mission.from_toml(SURVEY),
        conditions=st.Conditions(sensors=near, navigation="filter", max_time_s=20.0),
    )
    assert "navigation_usbl_samples" not in flights.figures


def test_without_a_filter_acoustics_are_said_to_be_left_out() -> None:
    told = load_sensors("typical", st.Vehicle.load("cwolf")) | {"usbl": USBL}
    flight = st.fly(
        "cwolf", "cwolf", st.Mission.from_toml(SURVEY), conditions=st.Conditions(sensors=told, max_time_s=5.0)
    )
    assert any("usbl is left out: only a navigation filter" in line for line in flight.sentences())
    filtered = st.fly(
        "cwolf",
        "cwolf",
        st.Mission.from_toml(SURVEY),
        conditions=st.Conditions(sensors=told, max_time_s=20.0, navigation="filter"),
    )
    assert "Navigation filter; normalised innovation squared" in filtered.report().text()


def test_what_is_no_acoustic_sensor_or_landmark_is_refused() -> None:
    told = load_sensors("typical", st.Vehicle.load("cwolf")) | {"range": SONAR["range"]}
    with pytest.raises(SimulationError, match="expected sensors of both kinds, range and bearing"):
        st.fly(
            "cwolf",
            "cwolf",
            st.Mission.from_toml(SURVEY),
            conditions=st.Conditions(sensors=told, navigation="filter"),
        )
    run = st.Vehicle.load("cwolf").simulate(np.arange(0.0, 2.0, 0.1))
    with pytest.raises(TrialError, match="usbl: only the navigation filter of a flight reads it"):
        measure(run, {"usbl": USBL}, seed=1)
    with pytest.raises(TrialError, match="outlier_share: expected a share of the samples from 0 to 1"):
        parse_sensors({"usbl": {"outlier_share": 5.0}})
    with pytest.raises(VehicleError, match='landmark 3: name: expected a name of its own, found "A" twice'):
        st.Mission.from_toml(SURVEY.replace('name = "B"', 'name = "A"'))
    with pytest.raises(VehicleError, match="radius_m"):
        st.Mission.from_toml(SURVEY.replace("radius_m = 25.0\n[[landmarks]]", "[[landmarks]]", 1))


def test_landmarks_in_degrees_become_metres() -> None:
    text = SURVEY.replace("[start]", "[origin]\nlatitude_deg = 63.0\nlongitude_deg = 10.0\n[start]").replace(
        "north_m = 60.0\neast_m = 60.0", "latitude_deg = 63.001\nlongitude_deg = 10.0"
    )
    mark = st.Mission.from_toml(text).landmarks[1]
    assert mark["name"] == "A"
    assert mark["north_m"] == pytest.approx(111.5, abs=0.5)
