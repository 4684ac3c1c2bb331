"""Smoothness of gains along the breakpoints."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st_

from seatrial.base.errors import CampaignError
from seatrial.tuning.objective import roughness

SPEEDS = (-5.0, -3.0, -1.0, 1.0, 3.0, 5.0)
ALL = (True,) * 6


@settings(deadline=None)
@given(
    base=st_.floats(0.1, 100.0),
    growth=st_.floats(-1.0, 1.0),
    steps=st_.lists(st_.floats(0.2, 3.0), min_size=5, max_size=5),
)
def test_law_gains_that_grow_by_equal_factors_per_speed_are_smooth(
    base: float, growth: float, steps: list[float]
) -> None:
    speeds = np.concatenate([[0.0], np.cumsum(steps)])
    gains = {f"pitch.K_P.{i + 1}": base * np.exp(growth * u) for i, u in enumerate(speeds)}
    # Rounding of the logarithms, over steps that differ by up to 15 times.
    assert roughness(gains, ALL, speeds_m_s=speeds)[0] == pytest.approx(0.0, abs=1e-20 * 1e4)


def test_roughness_is_the_second_difference_and_does_not_know_units() -> None:
    kinked = {f"pitch.K_P.{i}": np.array([20.0, 20.0 * math.e if i == 3 else 20.0]) for i in range(1, 7)}
    assert roughness(kinked, ALL, speeds_m_s=SPEEDS) == pytest.approx([0.0, 1.0 + 4.0 + 1.0])
    thousand = {name: 1e-3 * value for name, value in kinked.items()}
    assert roughness(thousand, ALL, speeds_m_s=np.array(SPEEDS) / 1852.0) == pytest.approx([0.0, 6.0])


def test_zero_gains_and_unreachable_points_stand_aside() -> None:
    gains = {f"pitch.K_I.{i}": [0.0 if i == 6 else 1.0, 50.0 if i == 1 else 1.0] for i in range(1, 7)}
    assert roughness(gains, ALL, speeds_m_s=SPEEDS)[0] == 0.0
    assert roughness(gains, ALL, speeds_m_s=SPEEDS)[1] > 1.0
    assert roughness(gains, (False, *ALL[1:]), speeds_m_s=SPEEDS).tolist() == [0.0, 0.0]
    assert roughness({"guidance.lookahead_m": [3.0, 4.0]}, ALL, speeds_m_s=SPEEDS).tolist() == [0.0, 0.0]


def test_points_and_speeds_of_different_numbers_are_refused() -> None:
    with pytest.raises(CampaignError, match="as many points"):
        roughness({"pitch.K_P.1": 1.0}, [True] * 5, speeds_m_s=SPEEDS)
