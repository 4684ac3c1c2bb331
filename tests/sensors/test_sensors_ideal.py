"""What perfect sensors show: lever arms, through water against over ground, GPS, range, supply."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from numpy.typing import NDArray

from seatrial._core import Run, State, Vehicle
from seatrial.base.errors import TrialError
from seatrial.base.frames import from_euler, matrix
from seatrial.sensors.log import Surroundings, measure
from seatrial.sensors.sensor import Sensor, parse_sensors
from tests.sensors.sailing import turning_dive

Array = NDArray[np.float64]

PLACE = (0.8, -0.1, 0.25)
ROUNDED = 6e-7  # the table has six digits


@pytest.fixture(scope="module")
def run() -> Run:
    return turning_dive()


def columns(table: pl.DataFrame, *names: str) -> Array:
    return table.select(names).to_numpy()


def body(run: Run, vector: Array) -> Array:
    """A NED vector (3,) in the body frame at each row, (n, 3)."""
    return np.asarray(np.einsum("nji,j->ni", matrix(run.attitude), vector))


def test_law_a_doppler_log_off_the_origin_shows_the_velocity_of_its_place(run: Run) -> None:
    logged = columns(measure(run, {"dvl": Sensor(position=PLACE)}, seed=1), "u_m_s", "v_m_s", "w_m_s")
    u, v, w, p, q, r = np.asarray(run.nu).T
    x, y, z = PLACE
    # v_O + omega x r, written out.
    expected = np.stack([u + q * z - r * y, v + r * x - p * z, w + p * y - q * x], axis=1)
    np.testing.assert_allclose(logged, expected, atol=ROUNDED)
    # The turns make the lever arm tell: 0.8 m at 5 deg/s are 7 cm/s.
    assert np.abs(logged - np.asarray(run.nu)[:, :3]).max() > 0.03


def test_the_velocity_of_a_place_is_the_rate_of_its_position(run: Run) -> None:
    table = measure(
        run,
        parse_sensors({
            kind: {"position_m": list(PLACE), "noise_m_s" if kind == "dvl" else "noise_m": 0.0}
            for kind in ("dvl", "position", "depth")
        }),
        seed=1,
    )
    step = float(run.t[1])
    path = columns(table, "x_m", "y_m", "z_m")
    rate = (path[2:] - path[:-2]) / (2.0 * step)
    velocity = columns(table, "u_m_s", "v_m_s", "w_m_s")
    earth = np.einsum("nij,nj->ni", matrix(run.attitude), velocity)[1:-1]
    # Central differences: a sixth of step^2 times the third derivative of the path, some 0.3 m/s^3 at steps.
    assert np.abs(rate - earth).max() < 3e-3


def test_gyro_and_attitude_do_not_depend_on_a_place() -> None:
    for kind in ("gyro", "attitude", "revolutions", "load_cell", "voltage"):
        with pytest.raises(TrialError, match='unknown key "position_m"'):
            parse_sensors({kind: {"position_m": [0, 0, 0]}})


@pytest.mark.parametrize("kind", ["position", "gps"])
def test_a_position_is_that_of_its_place(kind: str) -> None:
    attitude = [0.3, -0.2, 2.0]
    t = np.arange(0.0, 2.0, 0.1)
    start = State(position=[10.0, -5.0, -1.0], attitude=attitude)
    run = Vehicle.load("cwolf").simulate(t, {}, start, free="")
    logged = columns(measure(run, {kind: Sensor(position=PLACE)}, seed=1), "x_m", "y_m")
    expected = np.array([10.0, -5.0, -1.0]) + matrix(from_euler(attitude)) @ np.array(PLACE)
    np.testing.assert_allclose(logged, np.tile(expected[:2], (len(t), 1)), atol=ROUNDED)


def test_through_water_and_over_ground_differ_by_the_current() -> None:
    run = turning_dive(60.0)
    current = np.array([0.25, -0.4, 0.03])
    table = measure(
        run,
        {"dvl": Sensor(position=PLACE), "dvl_water": Sensor(position=PLACE)},
        seed=1,
        conditions=Surroundings(current=current),
    )
    ground = columns(table, "u_m_s", "v_m_s", "w_m_s")
    water = columns(table, "u_water_m_s", "v_water_m_s", "w_water_m_s")
    np.testing.assert_allclose(ground - water, body(run, current), atol=2 * ROUNDED)


def test_in_still_water_both_velocities_are_one(run: Run) -> None:
    table = measure(run, {"dvl": Sensor(), "dvl_water": Sensor()}, seed=1)
    ground = columns(table, "u_m_s", "v_m_s", "w_m_s")
    np.testing.assert_array_equal(ground, columns(table, "u_water_m_s", "v_water_m_s", "w_water_m_s"))


def test_gps_is_silent_while_its_antenna_is_under_water() -> None:
    t = np.arange(0.0, 120.0, 0.1)
    down = np.where(t < 30.0, 0.0, np.where(t < 70.0, 1500.0, -1500.0))
    start = State(position=[0.0, 0.0, 0.4])
    run = Vehicle.load("cwolf").simulate(t, {"VTB": down, "VTS": down}, start)
    mast = (0.5, 0.0, -0.6)
    table = measure(run, {"gps": Sensor(noise=1.0, position=mast)}, seed=1)
    antenna = np.asarray(run.position) + np.einsum("nij,j->ni", matrix(run.attitude), np.array(mast))
    above = antenna[:, 2] < 0.0
    assert 0.1 < above.mean() < 0.9
    np.testing.assert_array_equal(table["x_m"].is_not_null().to_numpy(), above)
    np.testing.assert_array_equal(table["y_m"].is_not_null().to_numpy(), above)


def test_bottom_track_is_lost_out_of_range_and_through_water_is_not(run: Run) -> None:
    z = np.asarray(run.position)[:, 2]
    bottom, most = float(z.max()) + 20.0, 25.0
    table = measure(
        run,
        {"dvl": Sensor(max_range_m=most), "dvl_water": Sensor()},
        seed=1,
        conditions=Surroundings(bottom_depth_m=bottom),
    )
    tilt = matrix(run.attitude)[:, 2, 2]
    reached = bottom - z <= most * tilt
    assert 0.1 < reached.mean() < 0.9
    np.testing.assert_array_equal(table["u_m_s"].is_not_null().to_numpy(), reached)
    assert table["u_water_m_s"].null_count() == 0


def test_a_run_through_the_bottom_is_refused(run: Run) -> None:
    with pytest.raises(TrialError, match=r"goes down to .* m, below the bottom at 15 m"):
        measure(run, {"dvl": Sensor(max_range_m=50.0)}, seed=1, conditions=Surroundings(bottom_depth_m=15.0))


def test_a_voltage_sensor_shows_the_held_supply_and_needs_one(run: Run) -> None:
    supply = np.where(np.arange(len(run.t)) < 600, 16.0, 14.0)
    table = measure(run, {"voltage": Sensor()}, seed=1, conditions=Surroundings(voltage_v=supply))
    np.testing.assert_array_equal(table["voltage_v"].to_numpy(), supply)
    with pytest.raises(TrialError, match="no supply voltage is known"):
        measure(run, {"voltage": Sensor()}, seed=1)
