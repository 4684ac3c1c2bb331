"""Laws of attitudes: quaternion, matrix and Euler angles are one rotation."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as some

from seatrial.base import frames
from tests.trial import motion

ROUND_OFF = 1e-12  # a dozen operations on numbers of order one

angle = some.floats(-3.0, 3.0)
tilt = some.floats(-1.5, 1.5)


@given(angle, tilt, angle)
def test_law_euler_angles_survive_the_quaternion(roll: float, pitch: float, yaw: float) -> None:
    # arcsin loses half the digits near +/- pi/2, which 1.5 rad approaches
    back = frames.to_euler(frames.from_euler([roll, pitch, yaw]))
    np.testing.assert_allclose(back, [roll, pitch, yaw], atol=1e-10)


@given(angle, tilt, angle, angle, tilt, angle)
def test_law_product_of_quaternions_is_product_of_matrices(
    a: float, b: float, c: float, d: float, e: float, f: float
) -> None:
    first, second = frames.from_euler([a, b, c]), frames.from_euler([d, e, f])
    product = frames.matrix(frames.product(first, second))
    np.testing.assert_allclose(product, frames.matrix(first) @ frames.matrix(second), atol=ROUND_OFF)


def test_yaw_to_starboard_turns_forward_towards_east() -> None:
    forward = frames.matrix(frames.from_euler([0.0, 0.0, np.pi / 2])) @ [1.0, 0.0, 0.0]
    np.testing.assert_allclose(forward, [0.0, 1.0, 0.0], atol=ROUND_OFF)


def test_law_body_rates_are_the_derivative_of_the_attitude() -> None:
    t = np.linspace(0.0, 20.0, 7)
    step = 1e-5
    q_dot = (motion.pose(t + step)[1] - motion.pose(t - step)[1]) / (2.0 * step)
    rates = frames.body_rates(motion.pose(t)[1], q_dot)
    np.testing.assert_allclose(
        rates, motion.nu(t)[:, 3:], atol=1e-9
    )  # central difference: step^2 and 1e-16/step


def test_continuous_removes_sign_flips_and_counts_them() -> None:
    q = motion.pose(np.arange(0.0, 5.0, 0.1))[1]
    flipped = q * np.where(np.arange(len(q)) % 7 < 3, 1.0, -1.0)[:, None]
    smooth, flips = frames.continuous(flipped)
    np.testing.assert_array_equal(smooth, q)
    assert flips == 14


def test_angle_between_ignores_the_sign_of_a_quaternion() -> None:
    a, b = frames.from_euler([0.1, 0.0, 0.0]), frames.from_euler([0.4, 0.0, 0.0])
    np.testing.assert_allclose(frames.angle_between(a, -b), 0.3, atol=ROUND_OFF)
