"""The plan of a mission: what is planned is drawn where it is, named once, and can be printed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from seatrial.report.plot.track import bottom_depth, mission_plan, patterns, planned_path, waypoint_label
from tests.flight.flying import BOX, OUT, STATION, mission
from tests.report.figures import assert_legends_beside, assert_on_page, line, panel

FARM = """
format = 1
name = "farm"
speed_m_s = 1.0
acceptance_radius_m = 3.0
[start]
north_m = -80.0
heading_deg = 30.0
[limits]
max_depth_m = 20.0
fence_m = [[-150.0, -150.0], [150.0, -150.0], [150.0, 300.0], [-150.0, 300.0]]
[[legs]]
kind = "perimeter"
north_m = 0.0
east_m = 0.0
radius_m = 40.0
distance_m = 10.0
depths_m = [5.0, 10.0]
stops = 4
stop_s = 30.0
start_bearing_deg = 180.0
[[legs]]
kind = "lawnmower"
north_m = -60.0
east_m = 120.0
heading_deg = 0.0
length_m = 120.0
width_m = 100.0
spacing_m = 20.0
depth_m = 12.0
"""
CIRCLE = """
format = 1
name = "circle"
speed_m_s = 1.0
acceptance_radius_m = 3.0
[[legs]]
north_m = 100.0
east_m = 0.0
depth_m = 10.0
circle_radius_m = 20.0
turns = 1.25
[[legs]]
north_m = 100.0
east_m = 100.0
altitude_m = 4.0
"""


def test_a_planned_circle_is_joined_at_its_nearest_point() -> None:
    path = planned_path(mission(CIRCLE), seabed=(30.0, 0.0, 0.1))
    on = path.points[path.leg == 0][1:]
    assert np.hypot(on[:, 0] - 100.0, on[:, 1]) == pytest.approx(20.0)
    assert on[0, :2] == pytest.approx([80.0, 0.0])
    # Clockwise from the south: a turn and a quarter ends in the west.
    assert on[-1, :2] == pytest.approx([100.0, -20.0], abs=1e-6)
    assert on[5, 1] < 0.0
    assert path.places[2, 2] == pytest.approx(30.0 + 0.1 * 100.0 - 4.0)
    assert math.isnan(planned_path(mission(CIRCLE)).places[2, 2])
    assert bottom_depth(np.zeros(3), None) != bottom_depth(np.zeros(3), None)
    assert path.way_of(0) == pytest.approx(80.0 + 1.25 * math.tau * 20.0, rel=1e-3)  # chords of 5 degrees


def test_patterns_are_named_once() -> None:
    labels = list(mission(FARM).waypoints["label"])
    names = [name for name, _, _ in patterns(labels)]
    assert names == ["farm", "lawnmower"]
    short = planned_path(mission(FARM)).names
    assert sum(bool(name) for name in short) == 5  # start, and both ends of both patterns
    assert waypoint_label(planned_path(mission(FARM))) == "waypoint with its number"
    assert patterns(["waypoint 1", "waypoint 2", "buoy"]) == []


@pytest.mark.parametrize("text", [BOX, STATION, FARM, CIRCLE, OUT.replace("depth_m = 5.0\n", "", 1)])
def test_missions_can_be_printed(text: str) -> None:
    for seabed in (None, (40.0, 0.01, 0.0)):
        figure = mission_plan(mission(text), seabed=seabed)
        assert_on_page(figure)
        assert_legends_beside(figure)


def test_the_plan_of_a_mission_shows_fence_farm_limit_stops_and_heading() -> None:
    figure = mission_plan(mission(FARM))
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    for said in (
        "fence",
        "net or obstacle",
        "depth limit",
        "station kept, 30 s",
        "start and heading",
        "lawnmower",
    ):
        assert said in legend
    plan = panel(figure, "plan")
    assert line(plan, "fence")[0].tolist() == [-150.0, -150.0]
    length = mission(FARM).length
    assert f"{length / 1e3:.2f} km" in plan.get_title(loc="right")


def test_an_altitude_above_an_unknown_bottom_is_drawn_as_one() -> None:
    text = (
        OUT
        .replace("depth_m = 5.0\n", "", 1)
        .replace("depth_m = 5.0", "altitude_m = 3.0")
        .replace("[start]\n", "")
    )
    assert panel(mission_plan(mission(text)), "altitude above the bottom").get_ylabel() == "altitude, m"
