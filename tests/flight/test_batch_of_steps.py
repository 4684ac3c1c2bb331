"""Set points and corridors of a batch: cases from their shapes, whole periods, and what is refused."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import seatrial as st
from seatrial._core import Vehicle, fly
from seatrial.base.errors import SimulationError
from tests.flight.flying import OUT, grouped, mission

SECONDS = 4.0
STILL = np.zeros(41)  # a value per control period


def batch(**options: Any) -> st.Flights:
    return st.fly_batch("cwolf", "cwolf", mission(OUT), **grouped(max_time_s=SECONDS, **options))


def yaw(**parts: Any) -> list[Any]:
    row = {"base": 0.0, "scale": 1.0, "lower": STILL, "upper": STILL, "target": STILL, "clock": STILL}
    return [("yaw", *(row | parts).values())]


@pytest.mark.parametrize(
    "options",
    [
        {"set_points": {"times": [0.0, 2.0], "heading": [[0.0, 0.1], [0.0, 0.2], [0.0, 0.3]]}},
        {"set_points": {"times": [0.0], "heading": [0.1, 0.2, 0.3]}},
        {"corridors": yaw(base=[0.1, 0.2, 0.3])},
        {"corridors": yaw(scale=[0.1, 0.2, 0.3])},
    ],
)
def test_what_is_stepped_or_judged_per_case_makes_the_cases(options: dict[str, Any]) -> None:
    flights = batch(**options)
    assert len(flights) == 3
    if "corridors" in options:
        assert flights.violations.shape == (3, 1, 3)
        assert len(np.unique(flights.violations[:, 0, :2].sum(axis=1))) == 3
    else:
        assert len(np.unique(flights.figures["distance"])) == 3


def test_one_corridor_and_one_set_point_hold_for_all_cases() -> None:
    flights = batch(seeds=[1, 2], set_points={"times": [0.0], "heading": [0.1]}, corridors=yaw(base=[0.1]))
    assert flights.violations.shape == (2, 1, 3)
    np.testing.assert_array_equal(flights.violations[0], flights.violations[1])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"set_points": "heading"}, "set_points: expected {name: values}"),
        ({"set_points": {"times": [0.0], "heading": "north"}}, "set_points: heading: expected numbers"),
        ({"set_points": {"times": [math.nan], "heading": [0.1]}}, "times: expected rising times"),
        (
            {"set_points": {"times": [0.0], "heading": [[0.1]] * 3}, "seeds": [1, 2]},
            "seeds: expected 3 values",
        ),
        ({"corridors": 5}, "corridors: expected a list"),
        ({"corridors": [("yaw", 0.0, 1.0)]}, r"corridors\[0\]: expected \(channel, base, scale"),
        ({"corridors": yaw(lower=["low"] * 41)}, r"corridors\[0\]: lower: expected numbers"),
        ({"corridors": yaw(base=math.nan)}, r"corridors\[0\]: base: expected finite numbers"),
        ({"corridors": yaw(target=STILL + math.inf)}, r"corridors\[0\]: expected a finite target and clock"),
        ({"corridors": yaw(clock=STILL + math.inf)}, r"corridors\[0\]: expected a finite target and clock"),
    ],
)
def test_what_is_no_step_and_no_corridor_is_answered_in_a_sentence(
    options: dict[str, Any], words: str
) -> None:
    with pytest.raises(SimulationError, match=words):
        batch(**options)


@pytest.mark.parametrize(("period_s", "periods"), [(0.1, 7), (0.3, 7), (0.15, 23), (0.02, 7)])
def test_a_flight_lasts_so_many_whole_periods_as_it_was_given(period_s: float, periods: int) -> None:
    built_in = st.Autopilot.load("cwolf")
    text = built_in.to_toml().replace(f"period_s = {built_in.period_s}", f"period_s = {period_s}")
    autopilot = st.Autopilot.from_toml(text)
    assert autopilot.period_s == period_s
    # The quotient of the two is a rounding above a whole number: 2.1 s over 0.3 s.
    flights = st.fly_batch(
        "cwolf",
        autopilot,
        mission(OUT),
        conditions=st.Conditions(max_time_s=round(periods * period_s, 6)),
        logs=True,
    )
    assert len(flights.log(0)) == periods + 1
    assert flights.figures["duration"][0] == pytest.approx(periods * period_s)


def test_flights_without_logs_have_logs_of_no_rows() -> None:
    flights = batch()
    assert flights.log(0).shape == (0, len(flights.columns))
    assert flights.t(0).shape == (0,)


def test_a_group_of_channels_that_there_is_not_is_refused_by_the_core() -> None:
    ideal = np.tile([1.0, 1.0, 0.0, np.inf, 0.0], (7, 1))
    with pytest.raises(SimulationError, match="outages: expected a group below 7, found 7"):
        fly(
            Vehicle.load("cwolf"),
            st.Autopilot.load("cwolf"),
            mission(OUT).core,
            [1],
            position=[0.0, 0.0, 5.0],
            attitude=[0.0, 0.0, 0.0],
            nu=np.zeros(6),
            current=np.zeros(3),
            errors=np.zeros((16, 4)),
            timing=ideal,
            outages=[(7, 0.0, 1.0)],
            max_time_s=1.0,
        )


def test_the_number_of_threads_changes_no_bit() -> None:
    options: dict[str, Any] = {
        "seeds": range(24),
        "turbulence": 0.1,
        "sensors": "typical",
        "corridors": yaw(),
    }
    one, two = (batch(threads=threads, **options) for threads in (1, 2))
    np.testing.assert_array_equal(one.violations, two.violations)
    for name, values in one.figures.items():
        np.testing.assert_array_equal(values, two.figures[name], err_msg=name)


@pytest.mark.parametrize(("name", "speed"), [("remus100", 1.7), ("lauv", 1.3), ("cwolf", 1.8)])
def test_a_depth_that_is_set_acts_over_pitch_and_counts_as_the_path(name: str, speed: float) -> None:
    after_s, by_m = 20.0, 4.0
    far = mission(OUT.replace("1.5", str(speed)).replace("60.0", "9000.0").replace("= 5.0\n[[", "= 20.0\n[["))
    flights = st.fly_batch(
        name,
        name,
        far,
        conditions=st.Conditions(
            initial=st.State([0.0, 0.0, 20.0], [0.0, 0.0, 0.0], [speed, 0.0, 0.0, 0.0, 0.0, 0.0]),
            max_time_s=110.0,
        ),
        set_points={"times": [0.0, after_s], "depth": [[20.0, 20.0], [20.0, 20.0 + by_m]]},
        logs=True,
    )
    level_z, stepped = (flights.log(case)[:, flights.columns.index("z")] for case in range(2))
    assert abs(level_z[-1] - 20.0) < 0.1
    assert abs(stepped[-1] - (20.0 + by_m)) < 0.1
    # A step of the path is one cascade with the loop: no more than a quarter beyond, as of a path that moves.
    assert stepped.max() < 20.0 + 1.25 * by_m
    error = flights.log(1)[:, flights.columns.index("vertical_error")]
    at = round(after_s / 0.1) + 1
    assert error[at] == pytest.approx(stepped[at] - (20.0 + by_m), abs=0.05)
