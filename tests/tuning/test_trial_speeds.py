"""Speeds of trials by default: at most three, apart, in a mode, within reach, and not below level flight."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as some

import seatrial as st
from seatrial.base.errors import CampaignError
from seatrial.control_design.tuning_table import TuningTable
from seatrial.identification.fitted import Fitted
from seatrial.tuning.control_problem import ControlProblem
from seatrial.tuning.loop_steps import SETTINGS as LOOP_STEP_SETTINGS
from seatrial.tuning.loop_steps import apart, thinned, tried_speeds
from seatrial.tuning.scope import slowest_level_m_s

EVERY = (-math.inf, math.inf)
SPEEDS = some.lists(some.floats(-4.0, 4.0), min_size=1, max_size=6, unique=True)


@given(SPEEDS, some.floats(-2.0, 2.0), some.floats(0.05, 1.0))
def test_law_speeds_are_few_apart_in_their_mode_and_within_reach(
    points: list[float], switch: float, spacing: float
) -> None:
    found = tried_speeds(
        sorted(points), [(switch, math.inf)], away_m_s=0.2, within_m_s=(-3.0, 3.0), apart_m_s=spacing
    )
    assert 1 <= len(found) <= LOOP_STEP_SETTINGS.most_speeds
    assert list(found) == sorted(found)
    # To the micrometre per second that speeds are rounded to.
    assert all(switch + 0.2 - 1e-6 <= speed <= 3.0 for speed in found)
    assert all(b - a >= spacing - 1e-9 for a, b in pairwise(found))


@given(SPEEDS)
def test_law_the_slowest_and_the_fastest_ahead_are_among_the_three(points: list[float]) -> None:
    found = thinned(sorted(points))
    assert set(found) <= set(points)
    assert len(found) <= LOOP_STEP_SETTINGS.most_speeds
    assert max(found) == max(points)
    assert min(map(abs, found)) == pytest.approx(min(map(abs, points)), abs=1e-6)


def test_a_mode_that_is_narrow_is_tried_in_its_middle() -> None:
    found = tried_speeds([0.0, 2.0], [(0.9, 1.2)], away_m_s=0.2, within_m_s=EVERY, apart_m_s=0.5)
    assert found == pytest.approx((1.05,))


def test_points_that_are_clipped_to_the_same_are_tried_once() -> None:
    assert apart([0.0, 1.0, 2.0]) == 0.5
    assert tried_speeds([0.0, 1.0, 2.0], [EVERY], away_m_s=0.1, within_m_s=(0.0, 1.2), apart_m_s=0.5) == (
        0.0,
        1.0,
    )


@pytest.mark.long
def test_a_vehicle_that_cannot_hover_has_a_slowest_speed() -> None:
    remus = ControlProblem.of_table(TuningTable(), Fitted.of("remus100"), st.Autopilot.load("remus100"))
    slowest = slowest_level_m_s(remus.vehicle, remus.autopilot)
    assert slowest is not None
    # The built-in autopilot's breakpoints begin there.
    assert slowest == pytest.approx(remus.autopilot.speeds_m_s[0], rel=0.01)
    assert min(remus.speeds_of("heading")) >= slowest + remus.current_m_s
    table = TuningTable.model_validate({"loops": {"heading": {"speeds_m_s": [0.0]}}})
    refused = ControlProblem.of_table(table, remus.fitted, remus.autopilot)
    with pytest.raises(CampaignError, match=r"heading.*at least 1\.54 m/s, the slowest.*found 0"):
        refused.trials("heading")
    assert slowest_level_m_s(st.Vehicle.load("cwolf"), st.Autopilot.load("cwolf")) is None
