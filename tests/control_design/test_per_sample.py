"""Gains per sample against physical ones: the same controller, whatever the period."""

from __future__ import annotations

import numpy as np
import pytest

from seatrial.base.errors import VehicleError
from seatrial.control_design.start_gains import physical_gains


def test_law_both_forms_are_the_same_controller() -> None:
    period, rng = 0.1, np.random.default_rng(4)
    per_sample = {"KP": [32.8] * 6, "KI": [0.041] * 6, "KD": [812.0] * 6}
    gains = physical_gains({"heading": per_sample}, period_s=period)["heading"]
    error, measured = rng.standard_normal(50), rng.standard_normal(50).cumsum()
    step = np.diff(measured, prepend=measured[0])
    paper = 32.8 * error + 0.041 * error.cumsum() - 812.0 * step
    physical = (
        gains["K_P"][0] * error
        + gains["K_I_per_s"][0] * error.cumsum() * period
        - gains["K_D_s"][0] * step / period
    )
    np.testing.assert_allclose(physical, paper, rtol=1e-9)  # ten digits are kept


@pytest.mark.parametrize(
    ("loops", "period_s", "says"),
    [
        ({"surge": {"KP": [1.0] * 6, "KI": [1.0] * 5, "KD": [0.0] * 6}}, 0.1, "surge.KI: expected 6"),
        ({"surge": {"KP": [1.0] * 6, "KI": [1.0] * 6}}, 0.1, "surge.KD: expected 6"),
        ({}, 0.0, "period_s: expected a positive time"),
        ({}, float("nan"), "period_s: expected a positive time"),
    ],
)
def test_bad_gains_are_refused(loops: dict[str, dict[str, list[float]]], period_s: float, says: str) -> None:
    with pytest.raises(VehicleError, match=says.replace(".", r"\.")):
        physical_gains(loops, period_s=period_s)
