"""Latitude and longitude in mission files: against published geodesics and the projection of PROJ itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Geod, Transformer

from seatrial.base.errors import VehicleError
from seatrial.base.frames import FARTHEST_M, LocalFrame
from seatrial.flight.mission import Mission

HEAD = 'format = 1\nname = "there"\nspeed_m_s = 1.5\nacceptance_radius_m = 3.0\n'
ORIGIN = "[origin]\nlatitude_deg = 63.82\nlongitude_deg = 8.91\n"
LEG = "[[legs]]\nlatitude_deg = 63.83\nlongitude_deg = 8.92\n"

latitudes = st.floats(-85.0, 85.0)
longitudes = st.floats(-180.0, 180.0)
azimuths = st.floats(-np.pi, np.pi)


def refused(text: str, *words: str) -> None:
    with pytest.raises(VehicleError) as error:
        Mission.from_toml(text, "there.toml")
    for word in ("there.toml", *words):
        assert word in str(error.value)


def test_lit_flinders_peak_to_buninyon() -> None:
    # Geocentric Datum of Australia, Technical Manual, worked example on GRS 80, whose flattening differs
    # from that of WGS 84 by 2e-11: 54 972.271 m at 306° 52' 05.37".
    flinders = (-(37.0 + 57.0 / 60.0 + 3.7203 / 3600.0), 144.0 + 25.0 / 60.0 + 29.5244 / 3600.0)
    buninyon = (-(37.0 + 39.0 / 60.0 + 10.1561 / 3600.0), 143.0 + 55.0 / 60.0 + 35.3839 / 3600.0)
    north, east = LocalFrame(*flinders).metres(buninyon)
    assert np.hypot(north, east) == pytest.approx(54972.271, abs=1e-3)
    bearing = np.rad2deg(np.arctan2(east, north)) % 360.0
    assert bearing == pytest.approx(306.0 + 52.0 / 60.0 + 5.37 / 3600.0, abs=0.01 / 3600.0)


def test_lit_a_degree_of_latitude_at_the_equator_and_the_pole() -> None:
    # WGS 84: 110 574 m from the equator on, 111 694 m to the pole (NIMA TR8350.2), half a metre in rounding.
    assert LocalFrame(0.0, 30.0).metres([0.5, 30.0]) == pytest.approx([110574.0 / 2.0, 0.0], abs=1.0)
    assert LocalFrame(89.5, 30.0).metres([90.0, 30.0]) == pytest.approx([111694.0 / 2.0, 0.0], abs=1.0)


@given(latitudes, longitudes, azimuths, st.floats(0.0, FARTHEST_M))
def test_law_it_is_the_azimuthal_equidistant_projection(
    latitude: float, longitude: float, azimuth: float, distance: float
) -> None:
    frame = LocalFrame(latitude, longitude)
    point = distance * np.array([np.cos(azimuth), np.sin(azimuth)])
    place = frame.geographic(point)
    projection = Transformer.from_pipeline(
        f"+proj=aeqd +ellps=WGS84 +lat_0={latitude:.12f} +lon_0={longitude:.12f}"
    )
    east, north = projection.transform(place[1], place[0])
    # The origin's 12 digits are a tenth of a micrometre; PROJ's own inverse is good to a nanometre.
    assert [north, east] == pytest.approx(point, abs=1e-5)


@given(latitudes, longitudes, st.lists(st.tuples(azimuths, st.floats(0.0, FARTHEST_M)), max_size=5))
def test_law_geographic_is_the_inverse_of_metres(
    latitude: float, longitude: float, there: list[tuple[float, float]]
) -> None:
    frame = LocalFrame(latitude, longitude)
    points = np.array([[s * np.cos(a), s * np.sin(a)] for a, s in there]).reshape(-1, 2)
    # Karney (2013): geodesics to 15 nm, either way.
    assert frame.metres(frame.geographic(points)) == pytest.approx(points, abs=1e-7)


@given(st.floats(-80.0, 80.0), azimuths, azimuths)
def test_law_lengths_ten_kilometres_away_are_true_to_five_millimetres_in_ten_kilometres(
    latitude: float, azimuth: float, direction: float
) -> None:
    frame = LocalFrame(latitude, 10.0)
    a = 10e3 * np.array([np.cos(azimuth), np.sin(azimuth)])
    b = a + 100.0 * np.array([np.cos(direction), np.sin(direction)])
    (lat_a, lon_a), (lat_b, lon_b) = frame.geographic([a, b])
    _, _, true = Geod(ellps="WGS84").inv(lon_a, lat_a, lon_b, lat_b)
    # (s/R)²/6 = 0.41 ppm at 10 km and R = 6371 km; 2 % for the longer step's own end and the flattening.
    assert abs(true - 100.0) < 1.05 * 100.0 * (10.1e3 / 6335e3) ** 2 / 6.0


def test_every_place_of_a_file_is_converted() -> None:
    text = (
        HEAD + ORIGIN + "[start]\nlatitude_deg = 63.8205\nlongitude_deg = 8.9105\ndepth_m = 1.0\n"
        "[limits]\nfence_deg = [[63.80, 8.88], [63.80, 8.96], [63.86, 8.96], [63.86, 8.88]]\n"
        + LEG
        + '[[legs]]\nkind = "spiral"\nlatitude_deg = 63.84\nlongitude_deg = 8.93\nstart_radius_m = 5.0\n'
        "end_radius_m = 20.0\nspacing_m = 5.0\n"
        '[[legs]]\nkind = "lawnmower"\nlatitude_deg = 63.845\nlongitude_deg = 8.93\nheading_deg = 0.0\n'
        "length_m = 50.0\nwidth_m = 20.0\nspacing_m = 10.0\n"
        '[[legs]]\nkind = "perimeter"\ncorners_deg = [[63.85, 8.92], [63.85, 8.94], [63.852, 8.93]]\n'
        "distance_m = 10.0\ndepths_m = [5.0]\nstart_bearing_deg = 180.0\n"
        "[[legs]]\nnorth_m = 10.0\neast_m = 0.0\n"
    )
    mission = Mission.from_toml(text)
    frame = LocalFrame(63.82, 8.91)
    # The file keeps tenths of millimetres.
    assert [mission.start["north_m"], mission.start["east_m"]] == pytest.approx(
        frame.metres([63.8205, 8.9105]), abs=1e-4
    )
    assert mission.fence == pytest.approx(
        frame.metres([[63.80, 8.88], [63.80, 8.96], [63.86, 8.96], [63.86, 8.88]]), abs=1e-4
    )
    points = mission.waypoints
    places = np.stack([points["north_m"], points["east_m"]], axis=1)
    assert places[0] == pytest.approx(frame.metres([63.83, 8.92]), abs=1e-4)
    corner = points["label"].index("to lawnmower 1/3")
    assert places[corner] == pytest.approx(frame.metres([63.845, 8.93]), abs=1e-4)
    assert places[-1] == pytest.approx([10.0, 0.0])
    farm = frame.metres([[63.85, 8.92], [63.85, 8.94], [63.852, 8.93]]).mean(axis=0)
    round_ = [k for k, label in enumerate(points["label"]) if label.startswith("farm")]
    assert np.hypot(*(places[round_] - farm).T).max() < 600.0
    assert mission.geographic(places[0]) == pytest.approx([63.83, 8.92], abs=1e-8)


def test_the_file_in_metres_is_the_same_mission() -> None:
    mission = Mission.from_toml(HEAD + ORIGIN + LEG)
    again = Mission.from_toml(mission.to_toml())
    assert "latitude_deg = 63.83" not in mission.to_toml()
    assert again.origin == mission.origin == (63.82, 8.91)
    assert again.length == mission.length
    assert again.waypoints["north_m"] == pytest.approx(mission.waypoints["north_m"], abs=0.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HEAD + LEG, ("origin: expected latitude_deg and longitude_deg", "add [origin]")),
        (HEAD + "[origin]\nlatitude_deg = 63.82\n" + LEG, ("origin", "longitude_deg")),
        (HEAD + ORIGIN.replace("63.82", "95.0") + LEG, ("origin.latitude_deg", "from -90 to 90", "95.0")),
        (HEAD + ORIGIN + LEG.replace("63.83", "-90.1"), ("leg 1: latitude_deg", "-90.1")),
        (HEAD + ORIGIN + LEG.replace("8.92", "181"), ("leg 1: longitude_deg", "from -180 to 180")),
        (HEAD + ORIGIN + LEG.replace("8.92", '"8 E"'), ("leg 1: longitude_deg", "'8 E'")),
        (HEAD + ORIGIN + LEG.replace("63.83", "true"), ("leg 1: latitude_deg", "True")),
        (HEAD + ORIGIN + LEG.replace("63.83", "nan"), ("leg 1: latitude_deg", "nan")),
        (HEAD + ORIGIN + LEG.replace("63.83", "64.83"), ("leg 1", "within 100 km", "113 km")),
        (HEAD + ORIGIN + LEG.replace("latitude_deg = 63.83\n", ""), ("leg 1: latitude_deg", "found none")),
        (HEAD + ORIGIN + LEG + "north_m = 3.0\n", ("leg 1: north_m", "found both")),
        (
            HEAD + ORIGIN + "[limits]\nfence_deg = [63.8, 8.9]\n" + LEG,
            ("limits.fence_deg", "[latitude, longitude]"),
        ),
        (
            HEAD + ORIGIN + "[limits]\nfence_deg = [[8.9, 63.8], [8.9, 63.9], [8.8, 63.8]]\n" + LEG,
            ("limits.fence_deg", "latitude comes first"),
        ),
        (
            HEAD + ORIGIN + "[limits]\nfence_deg = []\nfence_m = []\n" + LEG,
            ("limits.fence_deg", "found both"),
        ),
        (HEAD + ORIGIN + LEG + "speed_ms = 1.0\n", ("leg 1", "speed_ms", 'did you mean "speed_m_s"')),
    ],
)
def test_a_place_that_cannot_be_meant_is_refused_in_a_sentence(text: str, words: tuple[str, ...]) -> None:
    refused(text, *words)


def test_a_mission_in_metres_has_no_place_on_the_earth() -> None:
    mission = Mission.from_toml(HEAD + "[[legs]]\nnorth_m = 30.0\neast_m = 0.0\n")
    with pytest.raises(VehicleError, match="expected \\[origin\\]"):
        mission.geographic([0.0, 0.0])
