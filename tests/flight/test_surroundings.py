"""Turbulence and obstacles: what is taken, what is refused, and that they reach the flight."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st_

import seatrial as st
from seatrial.base.errors import SimulationError
from seatrial.flight.checks import checked_obstacles, checked_times, checked_turbulence
from tests.flight.flying import OUT, grouped, mission

CURRENT = (0.0, 0.2, 0.0)


def out(**options: Any) -> st.Flight:
    return st.fly("cwolf", "cwolf", mission(OUT), **grouped(current=CURRENT, **options))


@given(st_.floats(0.0, 5.0))
def test_one_number_is_the_deviation_of_both_horizontal_components(sigma: float) -> None:
    assert checked_turbulence(sigma) == (sigma, sigma, 0.0)
    assert checked_turbulence([sigma, 0.0, 0.1]) == (sigma, 0.0, 0.1)
    assert checked_turbulence(np.array([sigma, sigma, sigma])) == (sigma,) * 3


@pytest.mark.parametrize("given_", [-0.1, 6.0, float("nan"), "0.1", [0.1, 0.1], [0.1, 0.1, -0.1], None, True])
def test_a_turbulence_that_is_none_is_refused(given_: Any) -> None:
    with pytest.raises(SimulationError, match="turbulence: expected a standard deviation from 0 to 5 m/s"):
        checked_turbulence(given_)


def test_two_times_are_taken() -> None:
    assert checked_times((60, 2.0)) == (60.0, 2.0)
    assert checked_times([0.01, 1e5]) == (0.01, 1e5)


@pytest.mark.parametrize("given_", [60.0, (60.0,), (60.0, 0.0), (60.0, float("inf")), ("60", 2.0), (1, 2, 3)])
def test_times_that_are_none_are_refused(given_: Any) -> None:
    with pytest.raises(SimulationError, match=r"turbulence_times_s: expected two times.*\(60\.0, 2\.0\)"):
        checked_times(given_)


def test_obstacles_are_rows_of_north_east_and_radius() -> None:
    assert checked_obstacles([(1, 2.0, 3), [0.0, 0.0, 0.5]]) == ((1.0, 2.0, 3.0), (0.0, 0.0, 0.5))
    assert checked_obstacles(np.array([[1.0, 2.0, 3.0]])) == ((1.0, 2.0, 3.0),)
    assert checked_obstacles([]) == ()
    assert checked_obstacles([(1.0, 2.0, 0.0)]) == ((1.0, 2.0, 0.0),)  # a point


@pytest.mark.parametrize("row", [(1.0, 2.0), (1.0, 2.0, -1.0), (1.0, float("nan"), 1.0), "abc", 5.0])
def test_an_obstacle_that_is_none_is_named_by_its_place(row: Any) -> None:
    with pytest.raises(SimulationError, match=r"obstacles\[1\]: expected north, east and a radius"):
        checked_obstacles([(0.0, 0.0, 1.0), row])


def test_eddies_move_about_the_mean_current_with_their_deviation() -> None:
    flight = out(turbulence=(0.1, 0.05, 0.02), turbulence_times_s=(4.0, 0.5), seed=3)
    # Hull's velocity over ground minus through the water, turned into north, east, down.
    drift = flight.nu[:, :3] - flight.water
    roll, pitch, yaw = flight.euler.T
    assert np.abs(np.rad2deg([roll, pitch])).max() < 30.0
    north = (
        np.cos(yaw) * np.cos(pitch) * drift[:, 0]
        + (np.cos(yaw) * np.sin(pitch) * np.sin(roll) - np.sin(yaw) * np.cos(roll)) * drift[:, 1]
        + (np.sin(yaw) * np.sin(roll) + np.cos(yaw) * np.cos(roll) * np.sin(pitch)) * drift[:, 2]
    )
    # Some ten independent values in 45 s: within half of its size.
    assert north.std() == pytest.approx(0.1, rel=0.5)
    assert north.mean() == pytest.approx(0.0, abs=0.08)
    again, other = (out(turbulence=(0.1, 0.05, 0.02), turbulence_times_s=(4.0, 0.5), seed=k) for k in (3, 4))
    np.testing.assert_array_equal(again.position, flight.position)
    assert not np.array_equal(other.position[:100], flight.position[:100])


def test_without_turbulence_the_current_is_the_mean() -> None:
    flight = out(turbulence=0.0)
    speed = np.linalg.norm(flight.nu[:, :3] - flight.water, axis=1)
    np.testing.assert_allclose(speed, 0.2, atol=1e-9)


def test_the_clearance_is_to_the_edge_of_the_nearest_obstacle() -> None:
    rows = [(30.0, 8.0, 2.0), (10.0, -20.0, 1.0), (55.0, -5.0, 0.0)]
    flight = out(obstacles=rows)
    # A capsule: points on the line between bow and stern, as thick as the hull.
    size = flight.vehicle.geometry()
    radius = 0.5 * size["diameter"]
    way = np.linspace(-1.0, 1.0, 2001) * (0.5 * size["length"] - radius)
    yaw, level = flight.euler[:, 2], np.cos(flight.euler[:, 1])
    ahead = np.stack([np.cos(yaw) * level, np.sin(yaw) * level], axis=1)
    edge = np.inf
    for north, east, own in rows:
        place = flight.position[:, None, :2] + way[None, :, None] * ahead[:, None] - (north, east)
        edge = min(edge, float(np.linalg.norm(place, axis=2).min()) - own - radius)
    assert flight.metrics["clearance_m"] == pytest.approx(edge, abs=1e-5)
    assert np.isinf(out().metrics["clearance_m"]) or np.isnan(out().metrics["clearance_m"])


def test_an_obstacle_without_a_promise_keeps_no_reserve_within() -> None:
    far = "[[obstacles]]\nnorth_m = 30.0\neast_m = 300.0\nradius_m = 2.0\ndistance_m = 3.0\n"
    here = "[[obstacles]]\nnorth_m = 30.0\neast_m = 0.0\nradius_m = 6.0\n"
    for text in (here, here + far):
        flight = st.fly("cwolf", "cwolf", mission(OUT + text))
        assert flight.metrics["clearance_m"] < -1.0
        assert flight.metrics["clearance_reserve_m"] == flight.metrics["clearance_m"]
        # What is promised of the other one was kept.
        assert "promises" not in flight.report().worst


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"turbulence": -1.0}, "turbulence:"),
        ({"turbulence_times_s": (0.0, 1.0)}, "turbulence_times_s:"),
        ({"obstacles": [(1.0, 2.0)]}, r"obstacles\[0\]"),
    ],
)
def test_a_flight_refuses_what_is_no_surrounding(options: dict[str, Any], says: str) -> None:
    with pytest.raises(SimulationError, match=says):
        out(**options)
