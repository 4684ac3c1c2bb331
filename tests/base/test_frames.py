"""Laws of frames by name: a motion says the same in every frame."""

from __future__ import annotations

import numpy as np
import pytest

from seatrial.base import frames
from seatrial.base.errors import TrialError
from seatrial.base.frames import matrix, to_euler
from tests.trial import motion

ROUND_OFF = 1e-12


@pytest.mark.parametrize("name", ["FRD/NED", "FLU/NWU", "FLU/ENU", "FRD/ENU", "FLU/NED"])
def test_law_turning_then_renaming_is_renaming_then_turning(name: str) -> None:
    body, earth = name.split("/")
    q = motion.pose(np.arange(0.0, 10.0, 0.5))[1]
    vector = np.array([0.3, -1.2, 0.7])
    direct = matrix(q) @ vector @ frames.earth_matrix(earth, "").T
    renamed = matrix(frames.attitude_to_ned(q, name, "")) @ (frames.body_matrix(body, "") @ vector)
    np.testing.assert_allclose(renamed, direct, atol=ROUND_OFF)


@pytest.mark.parametrize(
    ("name", "expected"),
    [("FLU/NWU", [0.1, -0.2, -0.3]), ("FLU/ENU", [0.1, -0.2, np.pi / 2 - 0.3]), ("FRD/NED", [0.1, 0.2, 0.3])],
)
def test_lit_rep103_euler_angles_of_z_up_frames(name: str, expected: list[float]) -> None:
    from seatrial.base.frames import from_euler

    q = frames.attitude_to_ned(from_euler([0.1, 0.2, 0.3]), name, "")
    np.testing.assert_allclose(to_euler(q), expected, atol=ROUND_OFF)


def test_east_north_up_becomes_north_east_down() -> None:
    np.testing.assert_array_equal(frames.earth_matrix("ENU", "") @ [1.0, 2.0, 3.0], [2.0, 1.0, -3.0])


@pytest.mark.parametrize("name", ["FLU", "flu", "FLU -> FRD", "FLU → FRD", "z up", "z_up"])
def test_names_of_a_body_frame_with_z_up(name: str) -> None:
    np.testing.assert_array_equal(frames.body_matrix(name, ""), np.diag([1.0, -1.0, -1.0]))


def test_an_earth_frame_is_no_body_frame() -> None:
    with pytest.raises(TrialError, match=r'log\.csv: u_m_s: frame "NWU" is no body frame; expected "FRD"'):
        frames.body_matrix("NWU", "log.csv: u_m_s")


@pytest.mark.parametrize("name", ["XYZ", "FLU/XYZ", "NED/NWU", "FLU/NWU/ENU"])
def test_an_unknown_attitude_frame_is_refused(name: str) -> None:
    with pytest.raises(TrialError, match="expected body/earth"):
        frames.attitude_to_ned(np.array([[1.0, 0.0, 0.0, 0.0]]), name, "q_w")
