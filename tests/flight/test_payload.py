"""Payload: the water's properties, the plume, samples along a flight and at its stops."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

import seatrial as st
from seatrial.base.errors import SimulationError
from seatrial.flight.payload import CHANNELS, UNDER_WAY, Payload, Plume, conductivity, density, properties
from seatrial.report.plot.flight_errors import flight_samples

WATER = """
format = 1
rate_hz = 2.0
[water]
nitrate_mg_l = 0.3
salinity = 32.0
temperature_c = 9.0
salinity_per_m = 0.05
"""

PLUME = """
[[plumes]]
north_m = 0.0
east_m = 0.0
depth_m = 5.0
discharge_m3_s = 0.05
nitrate_mg_l = 40.0
salinity = 5.0
temperature_c = 12.0
"""

PERFECT = "".join(
    f"[sensors.{name}]\nresponse_s = 0.0\nnoise = 0.0\n"
    for name in ("nitrate", "density", "conductivity", "salinity")
)

MISSION = """
format = 1
name = "one stop"
speed_m_s = 1.0
acceptance_radius_m = 3.0
[start]
depth_m = 5.0
[[legs]]
label = "downstream"
north_m = 12.0
east_m = 0.0
depth_m = 5.0
hold_s = 30.0
[[legs]]
north_m = 20.0
east_m = 0.0
depth_m = 5.0
"""

CURRENT = (0.2, 0.0, 0.0)


@pytest.fixture(scope="module")
def flown() -> st.Flight:
    """A flight through a plume, with typical sensors of the vehicle and the payload's own."""
    return fly(Payload.from_toml(WATER + PLUME), sensors="typical")


def fly(payload: Payload | None, sensors: str | None = None) -> st.Flight:
    mission = st.Mission.from_toml(MISSION)
    return st.fly(
        "cwolf",
        "cwolf",
        mission,
        water=st.Water(current=CURRENT),
        conditions=st.Conditions(sensors=sensors),
        payload=payload,
        seed=3,
    )


def test_lit_unesco_density_and_conductivity() -> None:
    """Check values of UNESCO 44 (1983): density at one atmosphere, salinity of conductivity ratios."""
    s, t = np.array([0.0, 0.0, 35.0, 35.0]), np.array([5.0, 25.0, 5.0, 25.0])
    np.testing.assert_allclose(density(s, t), [999.96675, 997.04796, 1027.67547, 1023.34306], atol=6e-6)
    s, t = np.array([35.0, 37.245628, 27.995347]), np.array([15.0, 20.0, 5.0])
    ratio = conductivity(s, t, np.array([0.0, 2000.0, 1500.0])) / 4.2914
    np.testing.assert_allclose(ratio, [1.0, 1.2, 0.65], atol=1e-6)


@pytest.mark.parametrize("x", [0.0, 10.0, 200.0])
def test_law_a_plume_carries_what_is_discharged(x: float) -> None:
    """The effluent through any plane across the current is the discharge: the surface sends it back."""
    plume = Plume(
        north_m=3.0,
        east_m=-4.0,
        depth_m=2.0,
        discharge_m3_s=0.02,
        nitrate_mg_l=40.0,
        salinity=5.0,
        temperature_c=12.0,
    )
    direction = np.array([0.6, 0.8])
    y, z = np.linspace(-60.0, 60.0, 601), np.linspace(0.0, 30.0, 601)
    across, down = np.meshgrid(y, z, indexing="ij")
    centre = np.array([3.0, -4.0]) + x * direction
    places = np.stack([centre[0] - 0.8 * across, centre[1] + 0.6 * across, down], axis=-1).reshape(-1, 3)
    share = plume.share(places, 0.3 * direction).reshape(across.shape)
    carried = 0.3 * np.trapezoid(np.trapezoid(share, z, axis=1), y)
    assert carried == pytest.approx(0.02, rel=1e-4)  # of the sums on the grid
    assert (
        plume.share(np.array([[3.0, -4.0, 2.0] - np.append(20.0 * direction, 0.0)]), 0.3 * direction) < 1e-12
    )


def test_effluent_mixes_in_proportion() -> None:
    payload = Payload.from_toml(WATER + PLUME)
    place = np.array([[30.0, 0.0, 5.0]])
    share = payload.plumes[0].share(place, CURRENT)
    nitrate, _, _, salinity = properties(payload.water, payload.plumes, place, CURRENT)[0]
    assert nitrate == pytest.approx(0.3 + share[0] * 39.7)
    assert salinity == pytest.approx(32.25 + share[0] * (5.0 - 32.25))


def test_samples_change_nothing_of_the_flight_and_stand_in_its_log(flown: st.Flight) -> None:
    assert flown.samples is not None
    np.testing.assert_array_equal(fly(None, sensors="typical").position, flown.position)
    table = flown.samples.table()
    assert np.diff(table["t_s"]).tolist() == pytest.approx([0.5] * (len(table) - 1))
    log = flown.table()
    assert log["payload.nitrate_mg_l"].drop_nulls().to_list() == table["nitrate_mg_l"].to_list()
    # The fix has 1.5 m; dead reckoning adds to it.
    assert table["north_deviation_m"][0] == pytest.approx(1.5)
    assert table["north_deviation_m"][-1] > table["north_deviation_m"][0]


def test_a_stop_has_the_mean_of_its_samples(flown: st.Flight) -> None:
    assert flown.samples is not None
    stop, under_way = flown.samples.stops
    assert (stop.label, under_way.label) == ("downstream", UNDER_WAY)
    table = flown.samples.table().filter(pl.col("stop") == "downstream", pl.col("settled"))
    table = table.filter(pl.col("t_s") >= stop.begin_s)
    assert stop.sensors_settled
    assert len(table) == stop.count
    for name in CHANNELS:
        assert stop.values[name].mean == pytest.approx(table[name].mean())
    nitrate = stop.values["nitrate_mg_l"]
    assert nitrate.mean == pytest.approx(table["true.nitrate_mg_l"].mean(), abs=4.0 * nitrate.deviation)
    assert nitrate.mean > 0.5
    assert "downstream" in flown.summary()
    assert flown.to_dict()["payload"]["stops"][0]["nitrate_mg_l"]["mean"] == nitrate.mean


def test_a_sensor_follows_with_its_response_time() -> None:
    at_once = fly(Payload.from_toml(WATER + PLUME + PERFECT)).samples
    assert at_once is not None
    np.testing.assert_allclose(at_once.values, at_once.true)
    slow = PERFECT.replace("response_s = 0.0", "response_s = 6.0", 1)
    late = fly(Payload.from_toml(WATER + PLUME + slow)).samples
    assert late is not None
    y, x = late.values[:, 0], late.true[:, 0]
    # y' = (x - y) / 6 s, by central differences.
    rate = (y[2:] - y[:-2]) / (late.t[2:] - late.t[:-2])
    np.testing.assert_allclose(rate, (x - y)[1:-1] / 6.0, atol=0.05 * np.abs(rate).max())


def test_files_and_figure_of_the_samples(flown: st.Flight, tmp_path: Path) -> None:
    flown.save(tmp_path / "run")
    names = {path.name for path in (tmp_path / "run").iterdir()}
    assert {"samples.parquet", "samples.csv", "payload.toml"} <= names
    saved = pl.read_parquet(tmp_path / "run" / "samples.parquet")
    assert flown.samples is not None
    assert saved.equals(flown.samples.table())
    figure = flight_samples(flown)
    texts = [text.get_text() for text in figure.axes[0].texts]
    assert any(text.startswith("downstream: ") for text in texts)


def test_a_plume_needs_a_current() -> None:
    with pytest.raises(SimulationError, match=r"current of at least 0\.01 m/s .*--current"):
        st.fly("cwolf", "cwolf", st.Mission.from_toml(MISSION), payload=Payload.from_toml(WATER + PLUME))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            WATER.replace("salinity = 32.0", "salinity = 320.0"),
            r"key salinity: expected a number from 0 to 42",
        ),
        (WATER.replace("salinity =", "salinty ="), r"unknown key 'salinty'; did you mean .salinity."),
        (WATER.replace("rate_hz = 2.0", "rate_hz = 0.0"), r"key rate_hz"),
        (WATER + "[sensors.oxygen]\nnoise = 1.0\n", r"unknown key 'oxygen'"),
        (PLUME, r"key format: this key is required"),
        (WATER + PLUME.replace("0.05", "5e9"), r"key discharge_m3_s: .* give it in m3/s"),
    ],
)
def test_a_wrong_payload_file_is_named(text: str, said: str) -> None:
    with pytest.raises(SimulationError, match=said):
        Payload.from_toml(text, "farm.toml")


DEEP = """
format = 1
name = "deep stop"
speed_m_s = 0.8
acceptance_radius_m = 3.0
[start]
depth_m = 2.0
[[legs]]
north_m = 12.0
east_m = 0.0
depth_m = 2.0
[[legs]]
label = "deep"
north_m = 18.0
east_m = 0.0
depth_m = 8.0
hold_s = {hold_s}
"""


@pytest.mark.parametrize("hold_s", [4.0, 18.0, 60.0])
def test_law_samples_of_a_stop_show_the_water_of_the_stop(hold_s: float) -> None:
    """What a vehicle passes on its way down to a stop is left out, and counted."""
    water = WATER.replace("salinity_per_m = 0.05", "salinity_per_m = 0.5\nnitrate_per_m = 0.1")
    flight = st.fly(
        "cwolf",
        "cwolf",
        st.Mission.from_toml(DEEP.format(hold_s=hold_s)),
        payload=Payload.from_toml(water),
        conditions=st.Conditions(sensors="typical"),
        seed=2,
    )
    assert flight.samples is not None
    stop = flight.samples.stops[0]
    table = flight.samples.table().filter(pl.col("stop") == "deep")
    assert stop.label == "deep"
    assert stop.on_the_way > 5
    assert stop.count + stop.on_the_way + stop.unsettled == len(table)
    assert stop.sensors_settled == (hold_s == 60.0)
    if hold_s == 4.0:
        assert stop.count == 0
        assert 'No sample counts at "deep"' in flight.summary()
        return
    # 0.25 m of depth: the offset of the gauge and what the loop still corrects.
    np.testing.assert_allclose(table.filter(pl.col("settled"))["depth_m"], 8.0, atol=0.25)
    if hold_s == 18.0:
        assert "The sensors had not settled" in flight.summary()
    else:
        expected = 0.3 + 0.1 * 8.0
        assert stop.values["nitrate_mg_l"].mean == pytest.approx(expected, abs=0.25 * 0.1 + 0.01)
