"""Tilt of the pose's earth frame against gravity."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from seatrial.base.frames import angle_between, conjugate, from_euler, matrix, product
from seatrial.trial.attitude import LARGEST, tilt
from seatrial.trial.trial import Trial
from tests.trial import motion

Array = NDArray[np.float64]

T = np.arange(0.0, 300.0, 0.1)
TRIM = np.deg2rad([2.0, -3.0])
OFF = np.deg2rad([2.5, -1.8])  # roll and pitch of the frame


def hovering(swing: float = np.deg2rad(1.0), turns: float = 2.0, seed: int = 0) -> Array:
    """Attitudes (n, 4) of a vehicle that turns about, trimmed and swinging by so many rad."""
    random = np.random.default_rng(seed)
    swinging = np.array([
        np.convolve(random.standard_normal(len(T)), np.ones(30) / np.sqrt(30.0), "same") for _ in "xy"
    ])
    yaw = np.pi * turns * np.sin(2.0 * np.pi * T / T[-1] * 1.5)
    return from_euler(np.stack([TRIM[0] + swing * swinging[0], TRIM[1] + swing * swinging[1], yaw], axis=1))


def frame(roll: float, pitch: float) -> Array:
    """Rotation (4,) from the frame of gravity to one that is off by two angles."""
    return from_euler([roll, pitch, 0.0])


def recorded(q: Array) -> dict[str, Array]:
    """Recording with canonical columns of attitudes and a resting position."""
    place = np.tile([1.0, 2.0, 3.0], (len(q), 1)) + 1e-3 * np.random.default_rng(1).standard_normal((
        len(q),
        3,
    ))
    names = ["q_w", "q_x", "q_y", "q_z", "x_m", "y_m", "z_m"]
    return {"t_s": T} | dict(zip(names, np.hstack([q, place]).T, strict=True))


def test_law_a_level_frame_has_no_tilt_whatever_the_trim() -> None:
    found = tilt(hovering(swing=0.0))
    assert found is not None
    # a constant trim solves the equations exactly; only rounding is left
    assert found.angle < 1e-7


def test_law_gravity_points_down_after_the_turn() -> None:
    found = tilt(product(frame(*OFF), hovering(swing=0.0)))
    assert found is not None
    assert found.trusted
    gravity = matrix(frame(*OFF))[:, 2]
    np.testing.assert_allclose(found.direction, gravity[:2], atol=1e-7)
    np.testing.assert_allclose(matrix(found.turn) @ gravity, [0.0, 0.0, 1.0], atol=1e-7)


def test_a_swinging_vehicle_tells_the_tilt_within_its_deviation() -> None:
    found = tilt(product(frame(*OFF), hovering(swing=np.deg2rad(1.5))))
    assert found is not None
    assert found.trusted
    error = np.abs(found.direction - matrix(frame(*OFF))[:2, 2]).max()
    # the largest of two errors in units of the larger deviation
    assert error < 3.0 * found.deviation
    assert found.deviation < np.deg2rad(0.5)


def test_headings_close_together_tell_nothing() -> None:
    assert tilt(product(frame(*OFF), hovering(turns=0.05))) is None


def test_a_trial_is_turned_upright_and_says_so() -> None:
    truth = hovering()
    trial = Trial.read(recorded(product(frame(*OFF), truth)))
    assert "tilted by 3.1 deg" in str(trial.report)
    assert trial.report.tilt is not None
    # both frames are upright: they differ by a turn about the vertical alone
    between = matrix(product(trial.attitude, conjugate(truth)))
    # a swing of 1 deg with some hundred turning points leaves 0.1 to 0.2 deg
    assert between[:, 2, 2].min() > np.cos(np.deg2rad(0.3))
    # the position is turned by the same rotation, and keeps its distance from the frame's origin
    assert np.linalg.norm(trial.position[0]) == pytest.approx(np.linalg.norm([1.0, 2.0, 3.0]), abs=0.01)
    assert abs(trial.position[0, 2] - 3.0) > 0.02


def test_the_written_trial_is_upright() -> None:
    trial = Trial.read(recorded(product(frame(*OFF), hovering())))
    again = Trial.read(trial.table)
    assert again.report.tilt is None
    np.testing.assert_allclose(again.observed[:, 9:11], trial.observed[:, 9:11], atol=1e-5)


def test_a_tilt_stays_on_request_and_is_named() -> None:
    q = product(frame(*OFF), hovering())
    trial = Trial.read(recorded(q), level=False)
    assert trial.report.tilt is None
    assert "left as recorded" in str(trial.report)
    assert angle_between(trial.attitude, q).max() < 1e-6


def test_a_large_tilt_is_another_frame_and_left() -> None:
    trial = Trial.read(recorded(product(frame(1.5 * LARGEST, 0.0), hovering())))
    assert trial.report.tilt is None
    assert "left as recorded" in str(trial.report)


def test_an_attitude_without_position_is_an_inertial_sensors() -> None:
    table = recorded(product(frame(*OFF), hovering()))
    trial = Trial.read({name: y for name, y in table.items() if name not in ("x_m", "y_m", "z_m")})
    assert trial.report.tilt is None


def test_a_level_recording_is_left_alone() -> None:
    t = np.arange(0.0, 120.0, 0.1)
    assert "tilted" not in str(Trial.read(motion.columns(t)).report)
