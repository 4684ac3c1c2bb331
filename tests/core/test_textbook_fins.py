"""The textbook's fin against hand calculation: the reference of the core's fin is itself checked."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.textbook_fins import Fin, fin_wrench
from benchmarks.textbook_thrusters import Newton, Thruster

RUDDER = Fin(
    servo=Thruster(name="rudder", wrench=np.zeros(6), characteristic=Newton(), unit="rad"),
    place=np.array([-1.0, 0.0, 0.0]),
    chord=np.array([1.0, 0.0, 0.0]),
    normal=np.array([0.0, 1.0, 0.0]),
    area=0.02,
    C_La=3.0,
    C_Lmax=1.0,
    C_D0=0.01,
    C_D90=1.1,
    k_i=0.15,
)


def test_small_deflection_ahead_is_the_linear_lift() -> None:
    wrench = fin_wrench(RUDDER, 0.01, np.array([2.0, 0.0, 0.0, 0.0, 0.0, 0.0]), 1000.0)
    # 1/2 rho S V^2 = 40 N; lift 40 * 3 * 0.01, off by (2 alpha)^2 / 6.
    assert wrench[1] == pytest.approx(1.2, rel=1e-4)
    assert wrench[5] == pytest.approx(-1.2, rel=1e-4)
    assert wrench[0] == pytest.approx(-40.0 * (0.01 + 1.1e-4 + 0.15 * 0.03**2), rel=1e-3)


def test_across_the_flow_there_is_drag_only() -> None:
    wrench = fin_wrench(RUDDER, 0.0, np.array([0.0, 2.0, 0.0, 0.0, 0.0, 0.0]), 1000.0)
    assert wrench[1] == pytest.approx(-40.0 * 1.11, rel=1e-12)
    assert wrench[0] == pytest.approx(0.0, abs=1e-12)


def test_yaw_rate_alone_is_damped_by_the_fin() -> None:
    wrench = fin_wrench(RUDDER, 0.0, np.array([2.0, 0.0, 0.0, 0.0, 0.0, 0.2]), 1000.0)
    # The tail moves to port at 0.2 m/s: an angle of attack of 0.1 rad, lift to starboard.
    assert wrench[1] == pytest.approx(12.0, rel=0.02)
    assert wrench[5] < 0.0


def test_at_rest_there_is_no_force() -> None:
    assert not fin_wrench(RUDDER, 0.3, np.zeros(6), 1000.0).any()
