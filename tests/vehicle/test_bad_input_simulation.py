"""Simulations and facts of a vehicle: what no vehicle or water has is refused, or its run is no number."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import seatrial as st
from seatrial.base.errors import SimulationError

CWOLF = st.Vehicle.load("cwolf")
ROV = st.Vehicle.load("bluerov2-heavy")
T = np.arange(0.0, 2.0, 0.1)


def test_a_candidate_that_no_vehicle_is_has_a_run_that_is_no_number() -> None:
    ahead = {"SbU": 500.0}
    runs = st.simulate_batch(CWOLF, {"m": [135.0, -1.0], "SbU.w": [0.1, 0.1]}, T, ahead)
    assert np.isfinite(runs.nu[0]).all()
    assert np.isnan(runs.nu[1, 1:]).any(axis=1).all()
    runs = st.simulate_batch(CWOLF, {"SbU.gain": [1.0, math.inf]}, T, ahead)
    assert np.isfinite(runs.nu[0]).all()
    assert not np.isfinite(runs.nu[1, -1]).all()


@pytest.mark.parametrize("speed", [math.nan, math.inf, -math.inf])
def test_authority_is_told_at_a_speed_that_is_a_number(speed: float) -> None:
    for ask in (CWOLF.authority, CWOLF.authority_sentences):
        with pytest.raises(SimulationError, match="speed_m_s: expected a finite number in m/s"):
            ask(speed)


def test_a_supply_is_a_series_or_one_number() -> None:
    commands = dict.fromkeys(ROV.actuators[:4], 1600.0)
    one, each = (ROV.simulate(T, commands, voltage_v=v) for v in (15.0, np.full(len(T), 15.0)))
    np.testing.assert_array_equal(one.nu, each.nu)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"rho": 1.025}, "rho: expected a number from 500.0 to 2000.0, found 1.025"),
        ({"rho": -1.0}, "rho: expected a positive number, found -1"),
        ({"current": np.zeros((3, 3))}, "current: expected 1 or 20 rows, found 3"),
    ],
)
def test_what_does_not_fit_is_refused(given: dict[str, Any], words: str) -> None:
    with pytest.raises(SimulationError, match=words):
        CWOLF.simulate(T, {}, **given)
