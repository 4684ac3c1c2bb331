"""Sensors away from O against rigid-body kinematics."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import seatrial as st
from seatrial.base.frames import matrix

Array = NDArray[np.float64]

T = np.arange(0.0, 60.0, 0.1)
ARM = np.array([0.8, -0.2, 0.15])


def _run() -> st.Run:
    """CWolf turning and diving."""
    vehicle = st.Vehicle.load("cwolf")
    commands = {"SbU": 600.0, "SbL": 900.0, "PU": 1100.0, "PL": 1400.0, "VTB": 500.0}
    return vehicle.simulate(T, {name: np.full(len(T), n) for name, n in commands.items()})


def _log(run: st.Run, place: Array) -> dict[str, Array]:
    nu, angles = np.asarray(run.nu), np.rad2deg(run.euler)
    velocity = nu[:, :3] + np.cross(nu[:, 3:], place)
    position = np.asarray(run.position) + matrix(np.asarray(run.attitude)) @ place
    table = {"t_s": T}
    for k in range(3):
        table[("roll_deg", "pitch_deg", "yaw_deg")[k]] = angles[:, k]
        table[("p_deg_s", "q_deg_s", "r_deg_s")[k]] = np.rad2deg(nu[:, 3 + k])
        table[("u_m_s", "v_m_s", "w_m_s")[k]] = velocity[:, k]
        table[("x_m", "y_m", "z_m")[k]] = position[:, k]
    return table


def _read(table: dict[str, Array], positions: Any) -> st.Trial:
    return st.Trial.read(table, sensor_positions=positions, align=False, level=False)


def test_law_velocity_and_position_of_a_rigid_body_come_back_to_o() -> None:
    run = _run()
    trial = _read(_log(run, ARM), {"velocity": ARM, "position": ARM})
    # Angles go through degrees and a chord between equal samples: rounding of 60 m.
    assert np.abs(trial.observed[:, :3] - np.asarray(run.nu)[:, :3]).max() < 1e-10
    assert np.abs(trial.observed[:, 6:9] - np.asarray(run.position)).max() < 1e-9
    assert sum("moved to O" in str(finding) for finding in trial.report.findings) == 2
    # Left where it is, the sensor shows a sway and a depth that the vehicle has not.
    left = _read(_log(run, ARM), None)
    assert np.abs(left.observed[:, 1] - np.asarray(run.nu)[:, 1]).max() > 0.02
    assert np.abs(left.observed[:, 8] - np.asarray(run.position)[:, 2]).max() > 0.05


def test_the_depth_cell_has_a_lever_arm_of_its_own() -> None:
    run = _run()
    table = _log(run, np.zeros(3))
    aft = np.array([-1.0, 0.0, 0.0])
    table["z_m"] = table["z_m"] + (matrix(np.asarray(run.attitude)) @ aft)[:, 2]
    trial = _read(table, {"depth": aft, "position": [0.0, 0.0, 0.0]})
    # Rounding of 60 m.
    assert np.abs(trial.observed[:, 6:9] - np.asarray(run.position)).max() < 1e-9


def test_without_a_gyro_the_velocity_stays_and_the_report_says_so() -> None:
    run = _run()
    table = {name: y for name, y in _log(run, ARM).items() if name[1:] != "_deg_s"}
    trial = _read(table, {"velocity": ARM})
    assert np.abs(trial.observed[:, 0] - table["u_m_s"]).max() == 0.0
    assert "lever arm ignored: moving the sensor to O needs the rates" in str(trial.report)


@pytest.mark.parametrize(
    ("positions", "words"),
    [
        ({"velcity": [0.0, 0.0, 0.0]}, 'unknown sensor "velcity"; did you mean "velocity"'),
        ({"velocity": [0.0, 0.0]}, "expected three numbers"),
        ({"depth": "aft"}, "expected three numbers"),
        ({"depth": [0.0, np.nan, 0.0]}, "expected three numbers"),
    ],
)
def test_a_bad_position_is_refused(positions: Any, words: str) -> None:
    with pytest.raises(st.TrialError, match=words.replace("?", ".")):
        _read(_log(_run(), ARM), positions)
