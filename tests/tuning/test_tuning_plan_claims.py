"""Bounds of factors, times and reach of a tuning's trials, each where it decides."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from seatrial.control_design.tuning_table import TuningTable
from seatrial.identification.fitted import Fitted
from seatrial.tuning.control_problem import ControlProblem
from tests.tuning.tuning_campaigns import start


def of(**table: Any) -> ControlProblem:
    return ControlProblem.of_table(TuningTable.model_validate(table), Fitted.of("cwolf"), start())


def corridor(until_s: float) -> dict[str, float]:
    return {"rise_s": 4.0, "settling_s": 8.0, "until_s": until_s}


HEADING = {"steps": [20.0], "speeds_m_s": [3.0], "corridor": corridor(12.0)}


def test_gains_have_the_bounds_of_the_file_filters_and_lookaheads_a_third_to_three() -> None:
    path = {"steps": [1.0], "speeds_m_s": [3.0], "corridor": corridor(30.0)}
    (group,) = of(bounds=[0.02, 40.0], loops={"heading": HEADING, "cross_track": path}).groups
    ends = {one.name: (one.lower, one.upper) for one in group.parameters.parameters}
    assert {name for name in ends if not name.startswith("heading.K_")} == {
        "heading.reference_rad_s",
        "guidance.lookahead_m",
        "guidance.integral_gain_m_s",
    }
    # A filter or a lookahead sets the time scale that a corridor asks for: no search may give it up.
    for name, bounds in ends.items():
        assert bounds == ((0.02, 40.0) if name.startswith("heading.K_") else (0.3, 3.0)), name


@pytest.mark.parametrize(
    ("table", "settle_s"),
    [
        # Up to 15 s there is no hurry; a slower loop has as much as its corridor; the file decides otherwise.
        ({"corridor": corridor(12.0)}, 15.0),
        ({"corridor": corridor(40.0)}, 40.0),
    ],
)
def test_a_loop_settles_as_long_as_its_corridor_and_at_least_fifteen_seconds(
    table: dict[str, Any], settle_s: float
) -> None:
    loops = {"heading": HEADING | table}
    assert of(loops=loops).trials("heading").settle_s == settle_s
    assert of(loops=loops, settle_s=7.0).trials("heading").settle_s == 7.0


@pytest.mark.parametrize(
    ("current_m_s", "speed", "steps", "flown"),
    [
        # CWolf reaches 95 % of 3.18 m/s ahead and of 2.45 m/s astern, less what comes against it.
        (0.0, 2.0, [0.4, 0.9], [0.4, 0.9]),
        (0.5, 2.0, [0.4, 0.9], [0.4]),
        (0.0, -1.0, [-0.5, -1.2], [-0.5, -1.2]),
        (0.5, -1.0, [-0.5, -1.2], [-0.5]),
    ],
)
def test_a_speed_step_ends_within_reach_against_the_current(
    current_m_s: float, speed: float, steps: list[float], flown: list[float]
) -> None:
    table = {"steps": steps, "speeds_m_s": [speed], "corridor": corridor(12.0)}
    assert list(of(current_m_s=current_m_s, loops={"surge": table}).trials("surge").sizes) == flown


def test_currents_come_from_all_sides_whatever_the_seed() -> None:
    one = of(current_m_s=0.3)
    for seed in (0, 5, 996, 997):
        current = one.samples(8, seed, nominal=3).current
        np.testing.assert_array_equal(current[:3], 0.0)
        np.testing.assert_allclose(np.linalg.norm(current[3:], axis=1), 0.3)
        # Eight steps of the golden angle leave no gap of a right angle.
        bearing = np.sort(np.arctan2(current[3:, 1], current[3:, 0]))
        assert np.diff([*bearing, bearing[0] + 2.0 * np.pi]).max() < np.pi / 2.0
