"""Truth vehicles: what a truth file may change."""

from __future__ import annotations

from pathlib import Path

import pytest

import seatrial as st
from seatrial.trial.truth import Truth

HEAD = 'format = 1\nvehicle = "cwolf"\n'


def _truth(folder: Path, text: str) -> Truth:
    path = folder / "truth.toml"
    path.write_text(HEAD + text)
    return Truth.load(path)


def test_tables_go_over_the_vehicles_file_before_the_factors(tmp_path: Path) -> None:
    truth = _truth(
        tmp_path,
        '[factors]\n"SbU.T_1" = 2.0\nX_uu = 1.3\n'
        "[vehicle_file.motors.propeller]\nminimum_ahead = 180.0\nT_1_s = 0.2\n",
    )
    facts = truth.vehicle.actuator_info()["SbU"]
    assert (facts["minimum_ahead"], facts["maximum_ahead"]) == (180.0, 2000.0)
    assert truth.vehicle.coefficients()["SbU.T_1"] == pytest.approx(0.4)
    cwolf = st.Vehicle.load("cwolf").coefficients()
    assert truth.vehicle.coefficients()["X_uu"] == pytest.approx(1.3 * cwolf["X_uu"])
    assert truth.vehicle.coefficients()["Y_vv"] == cwolf["Y_vv"]


def test_a_wrong_table_is_answered_as_in_a_vehicle_file(tmp_path: Path) -> None:
    with pytest.raises(st.VehicleError, match=r"truth.toml: vehicle_file.*minimum_ahaed"):
        _truth(tmp_path, "[vehicle_file.motors.propeller]\nminimum_ahaed = 180.0\n")
