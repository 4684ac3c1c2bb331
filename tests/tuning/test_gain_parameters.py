"""Gains as factors of a search: which point goes with which, bounds, what stays."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st_

import seatrial as st
from seatrial.tuning.scope import GAINS, GainParameters, excited_points
from tests.tuning.tuning_campaigns import start

POINTS = (-5.0, -3.0, -1.0, 1.0, 3.0, 5.0)
SIX = st_.lists(st_.integers(0, 5), min_size=1, max_size=6, unique=True).map(sorted)


def surge(free: list[int], reached: list[int], taken: tuple[int, ...] = ()) -> GainParameters:
    return GainParameters.of_loop(
        "surge", start().gains(), free=free, taken=taken, reached=reached, bounds=(0.1, 10.0)
    )


def test_without_a_step_the_gains_are_those_of_the_start() -> None:
    # Where every point has its own factor, or goes with one of the same value.
    found = surge([2, 3, 4], [2, 3, 4])
    gains = {name: values[0] for name, values in found.gains(np.zeros((1, len(found)))).items()}
    for point in (3, 4, 5):
        for gain in ("K_P", "K_I"):
            name = f"surge.{gain}.{point}"
            assert gains[name] == start().gains()[name]


def test_a_point_out_of_reach_takes_the_value_of_the_nearest_in_reach() -> None:
    found = surge([2, 3, 4], [2, 3, 4])
    gains = found.gains(np.log([[2.0] * len(found)]))
    values = start().gains()
    assert gains["surge.K_P.1"][0] == gains["surge.K_P.2"][0] == pytest.approx(2.0 * values["surge.K_P.3"])
    assert gains["surge.K_P.6"][0] == pytest.approx(2.0 * values["surge.K_P.5"])
    assert values["surge.K_P.1"] != values["surge.K_P.3"]  # it is not merely scaled


def test_a_point_that_no_trial_moves_goes_with_its_nearest_and_keeps_its_proportion() -> None:
    found = surge([3], [2, 3, 4])
    assert found.names == ("surge.K_P.4", "surge.K_I.4")
    gains, values = found.gains(np.log([[3.0, 1.0]])), start().gains()
    for point in (3, 4, 5):
        name = f"surge.K_P.{point}"
        assert gains[name][0] == pytest.approx(3.0 * values[name]), name
    assert gains["surge.K_I.5"][0] == pytest.approx(values["surge.K_I.5"])


def test_a_gain_of_zero_stays_and_a_taken_point_is_left_alone() -> None:
    assert start().gains().get("surge.K_D.4", 0.0) == 0.0
    assert not any(".K_D." in name for name in surge([2, 3], [2, 3, 4]).names)
    found = surge([2, 3], [2, 3, 4], taken=(4,))
    # Point 6 is out of reach and follows 5, which another search sets.
    assert not {"surge.K_P.5", "surge.K_P.6"} & set(found.gains(np.zeros((1, len(found)))))


def test_candidates_are_logarithms_within_their_bounds() -> None:
    found = surge([2, 3], [2, 3, 4]) + GainParameters.of_number("surge.reference_rad_s", 2.0, (0.5, 4.0))
    lower, upper = found.bounds
    assert len(found) == len(found.names) == len(lower) == 5
    assert found.names[-1] == "surge.reference_rad_s"
    np.testing.assert_allclose(lower, np.log([0.1] * 4 + [0.5]))
    np.testing.assert_allclose(upper, np.log([10.0] * 4 + [4.0]))
    many = found.gains(np.stack([lower, upper, 0.0 * lower]))
    assert many["surge.reference_rad_s"] == pytest.approx([1.0, 8.0, 2.0])


def test_a_number_that_is_absent_has_no_factor() -> None:
    assert len(GainParameters.of_number("guidance.integral_gain_m_s", 0.0, (0.3, 3.0))) == 0


@given(free=SIX, reached=SIX, taken=SIX)
def test_law_a_gain_is_scaled_by_one_factor_and_never_at_a_taken_point(
    free: list[int], reached: list[int], taken: list[int]
) -> None:
    own = [point for point in free if point in reached and point not in taken]
    found = surge(own, reached, tuple(taken))
    scaled = [name for parameter in found.parameters for name in parameter.starts]
    assert len(scaled) == len(set(scaled))
    for name in scaled:
        point = int(name.rpartition(".")[2]) - 1
        assert point not in taken or point not in reached
    for parameter in found.parameters:
        # A factor has the name of a point that a trial tells of.
        assert int(parameter.name.rpartition(".")[2]) - 1 in own
        assert parameter.name in parameter.starts
    if own:
        # Every point is somebody's: of this search, or of the one that took its nearest in reach.
        missing = {f"surge.K_P.{p + 1}" for p in range(6)} - set(scaled)
        for name in missing:
            point = int(name.rpartition(".")[2]) - 1
            nearest = min(reached, key=lambda other: (abs(other - point), other))
            assert nearest in taken


@given(speed=st_.floats(-6.0, 6.0))
def test_law_a_trial_tells_of_the_one_or_two_points_about_its_speed(speed: float) -> None:
    found = excited_points([speed], POINTS)
    assert 1 <= len(found) <= 2
    nearest = int(np.argmin(np.abs(np.array(POINTS) - speed)))
    assert nearest in found
    assert all(abs(POINTS[point] - min(max(speed, -5.0), 5.0)) < 2.0 for point in found)


def test_a_point_counts_from_a_fifth_of_the_weight_on() -> None:
    assert excited_points([1.39], POINTS) == [3]
    assert excited_points([1.41], POINTS) == [3, 4]
    assert excited_points([-1.0, 3.0], POINTS) == [2, 4]


@pytest.mark.parametrize("vehicle", ["cwolf", "bluerov2-heavy", "lauv"])
def test_the_autopilot_takes_what_the_parameters_give(vehicle: str) -> None:
    autopilot = st.Autopilot.load(vehicle)
    loops = {name.partition(".")[0] for name in autopilot.gains() if ".K_P." in name}
    assert {"surge", "pitch", "heading"} <= loops
    for loop in loops:
        found = GainParameters.of_loop(
            loop, autopilot.gains(), free=[2, 3], reached=[2, 3, 4], bounds=(0.1, 10.0)
        )
        gains = {name: float(values[0]) for name, values in found.gains(np.full(len(found), 0.5)).items()}
        taken = autopilot.with_gains(gains).gains()
        for name, value in gains.items():
            assert taken[name] == pytest.approx(value, rel=1e-12), name
            assert name.split(".")[1] in GAINS


@given(
    st_.lists(st_.floats(0.1, 10.0), min_size=6, max_size=6),
    st_.lists(st_.integers(0, 5), min_size=1, max_size=3, unique=True),
)
def test_law_factors_go_through_the_gains_so_far_and_stay_within_their_bounds(
    factors: list[float], free: list[int]
) -> None:
    start = {f"surge.K_P.{i + 1}": 10.0 * (i + 1) for i in range(6)}
    now = {name: value * factor for (name, value), factor in zip(start.items(), factors, strict=True)}
    every = GainParameters.of_loop("surge", start, free=free, reached=range(6), bounds=(0.1, 10.0))
    through, x = every.through(now)
    found = through.gains(x[None, :])
    for name, value in now.items():
        assert found[name][0] == pytest.approx(value)
    lower, upper = through.bounds
    assert (lower < upper).all()
    assert ((lower <= x) & (x <= upper)).all()
    for corner in (lower, upper):
        for name, values in through.gains(corner[None, :]).items():
            # Half a per cent beyond, where gains at both bounds leave no room at all.
            assert 0.0994 <= values[0] / start[name] <= 10.06
