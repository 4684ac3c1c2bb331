"""Frames that a format documents, against gravity in the same message."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pytest

from seatrial.intake.survey import by_gravity, points_down
from seatrial.logs.log import Field, Topic
from seatrial.logs.recognise import propose

Q = {"w": (0.6, 0.3), "x": (0.01, 0.02), "y": (0.0, 0.02), "z": (0.1, 0.7)}  # upright, z alike
OVER = {"w": (0.01, 0.02), "x": (0.6, 0.3), "y": (0.1, 0.7), "z": (0.0, 0.02)}  # z of body and earth opposed


def topic(name: str, fields: Sequence[Field]) -> Topic:
    return Topic(name, 500, 0.0, 100.0, 0.2, 0.2, 0, tuple(fields))


def imu(gravity: float, q: Mapping[str, tuple[float, float]], deviation: float = 0.2) -> dict[str, str]:
    """Frames by column that a ROS message sensor_msgs/Imu is read with."""
    fields = [
        Field(f"orientation.{axis}", "", 500, -1.0, 1.0, mean, sd, 0.0) for axis, (mean, sd) in q.items()
    ]
    fields += [Field(f"angular_velocity.{axis}", "", 500, -0.5, 0.5, 0.0, 0.1, 0.0) for axis in "xyz"]
    fields += [Field(f"linear_acceleration.{axis}", "", 500, -0.5, 0.5, 0.0, 0.1, 0.0) for axis in "xy"]
    fields.append(
        Field("linear_acceleration.z", "", 500, gravity - 1.0, gravity + 1.0, gravity, deviation, 0.0)
    )
    topics = [topic("/imu/data", fields)]
    found = by_gravity("rosbag", topics, propose("rosbag", topics, {}))
    return {one.canonical: one.frame for one in found}


@pytest.mark.parametrize(
    ("gravity", "q", "body", "attitude"),
    [
        (9.8, Q, "FLU", "FLU/ENU"),  # as REP 103 says
        (-9.8, Q, "", ""),  # forward, starboard, down against north, east, down
        (-9.8, OVER, "", "FRD/ENU"),
        (9.8, OVER, "FLU", "FLU/NED"),
        (-1.0, Q, "", ""),  # in g
        (0.2, Q, "FLU", "FLU/ENU"),  # without gravity nothing is told
    ],
)
def test_gravity_in_the_same_message_says_where_z_points(
    gravity: float, q: Mapping[str, tuple[float, float]], body: str, attitude: str
) -> None:
    frames = imu(gravity, q)
    assert {frames[name] for name in ("p_deg_s", "q_deg_s", "r_deg_s")} == {body}
    assert {frames[name] for name in ("q_w", "q_x", "q_y", "q_z")} == {attitude}


def test_a_vehicle_that_tumbles_tells_no_frame() -> None:
    assert imu(-9.0, Q, deviation=6.0)["r_deg_s"] == "FLU"
    assert points_down(Field("linear_acceleration.z", "", 500, -10.0, 10.0, -7.5, 5.0, 0.0)) is None


def test_a_board_of_ardusub_that_points_up_is_said() -> None:
    fields = [Field(f"Gyr{axis}", "rad/s", 500, -1.0, 1.0, 0.0, 0.1, 0.0) for axis in "XYZ"]
    fields.append(Field("AccZ", "m/s/s", 500, 9.0, 10.5, 9.79, 0.1, 0.0))
    topics = [topic("IMU[0]", fields)]
    (first, *_) = by_gravity("dataflash", topics, propose("dataflash", topics, {}))
    assert first.frame == "FLU"
    assert "z points up" in first.why
    assert not first.certain
