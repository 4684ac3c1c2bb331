"""Corridors and their criterion: the shape, the erratum of (57), the laws of Q, figures of steps."""

from __future__ import annotations

import math

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from seatrial.base.errors import CampaignError, SimulationError
from seatrial.control_design.corridor import Corridor
from seatrial.tuning.criterion import criterion, normalised, step_metrics, time_weighted_error, violations

Array = NDArray[np.float64]

PERIOD = 0.1
T: Array = PERIOD * np.arange(400.0)
SURGE = Corridor.from_figures(rise_s=10.0, overshoot=0.1, settling_s=20.0, settled=0.05, steady=0.03)

responses = hnp.arrays(float, len(T), elements=st.floats(-3.0, 4.0))
shares = st.floats(0.0, 1.0)


def second_order(t: Array, damping: float, omega: float) -> Array:
    """Step response of a second-order loop with a damping ratio below 1."""
    own = omega * np.sqrt(1.0 - damping**2)
    return np.asarray(
        1.0 - np.exp(-damping * omega * t) * (np.cos(own * t) + damping * omega / own * np.sin(own * t))
    )


def printed(t: Array, y: Array, corridor: Corridor) -> float:
    """(57) as printed: the excess counts from the lower bound."""
    lower, upper = corridor.sampled(t)
    outside = np.where(y <= lower, lower - y, 0.0) + np.where(y >= upper, y - lower, 0.0)
    return float(outside.sum() * (t[1] - t[0]))


def test_figures_make_a_staircase_of_rise_settling_and_steady_state() -> None:
    assert SURGE.until_s == 40.0
    lower, upper = SURGE.sampled([0.0, 9.99, 10.0, 19.99, 20.0, 25.0, 30.0, 40.0])
    assert lower == pytest.approx([-0.1, -0.1, 0.9, 0.9, 0.95, 0.96, 0.97, 0.97])
    assert upper == pytest.approx([1.1, 1.1, 1.1, 1.1, 1.05, 1.04, 1.03, 1.03])


def test_a_jump_belongs_to_its_later_side_even_where_the_grid_is_rounded() -> None:
    corridor = Corridor([(0.0, 0.0), (0.3, 0.0), (0.3, 0.9), (1.0, 0.9)], [])
    grid = 0.1 * np.arange(5)
    assert grid[3] != 0.3  # 3 x 0.1 rounds away from 0.3
    assert corridor.sampled(grid)[0].tolist() == [0.0, 0.0, 0.0, 0.9, 0.9]
    assert corridor.sampled(np.nextafter(0.3, 0.0))[0] == 0.9
    assert corridor.sampled(0.3 - 1e-6)[0] == 0.0


def test_there_is_no_bound_before_the_step_before_a_first_point_and_after_the_end() -> None:
    lower, upper = Corridor([(2.0, 0.5), (4.0, 0.9)], [(0.0, 1.1), (6.0, 1.1)]).sampled([
        -1.0,
        1.0,
        3.0,
        5.0,
        7.0,
    ])
    assert lower.tolist() == [-math.inf, -math.inf, 0.7, 0.9, -math.inf]
    assert upper.tolist() == [math.inf, 1.1, 1.1, 1.1, math.inf]


def test_dead_time_moves_rise_and_settling_but_not_the_end() -> None:
    late = Corridor.from_figures(rise_s=10.0, settling_s=20.0, until_s=60.0, dead_s=5.0)
    assert late.until_s == 60.0
    assert late.sampled([14.9, 15.0, 24.9, 25.0])[0].round(9).tolist() == [-0.1, 0.9, 0.9, 0.95]


def test_an_overshoot_smaller_than_the_band_bounds_the_band() -> None:
    tight = Corridor.from_figures(rise_s=10.0, overshoot=0.02, settled=0.05, steady=0.03)
    assert tight.sampled(T)[1].max() == 1.02
    assert tight.sampled([25.0])[0] < 1.0 - 0.03


def test_a_band_beside_is_about_zero_and_goes_there() -> None:
    band = Corridor.beside(0.5, until_s=30.0, weight=2.0)
    assert band.target == 0.0
    assert criterion(T, np.where(T < 1.0, -0.7, 0.0), band) == pytest.approx(2.0 * 0.2 * 1.0)
    assert time_weighted_error(T, np.zeros_like(T), band) == 0.0


@given(
    rise=st.floats(0.1, 100.0),
    settling=st.floats(1.0, 5.0),
    rest=st.floats(1.01, 5.0),
    overshoot=shares,
    settled=st.floats(0.001, 0.1),
    steady=st.floats(0.01, 1.0),
    dead=st.floats(0.0, 20.0),
)
def test_law_consistent_figures_make_a_corridor_that_the_set_point_keeps_to(
    rise: float, settling: float, rest: float, overshoot: float, settled: float, steady: float, dead: float
) -> None:
    corridor = Corridor.from_figures(
        rise_s=rise,
        overshoot=overshoot,
        settling_s=settling * rise,
        settled=settled,
        steady=steady * settled,
        until_s=rest * (dead + settling * rise),
        dead_s=dead,
    )
    grid = np.linspace(0.0, corridor.until_s, 500)
    lower, upper = corridor.sampled(grid)
    assert (lower < upper).all()
    assert (np.diff(lower) >= -1e-12).all()  # a bound only ever narrows; rounding of a slope
    assert (np.diff(upper) <= 1e-12).all()
    assert criterion(grid, np.ones_like(grid), corridor) == 0.0


WRONG = {
    "nothing": (([], []), "excludes nothing"),
    "no end": (([(0.0, 0.5)], []), "ends at 0 s"),
    "falling": (([(0.0, 0.0), (5.0, 0.9), (3.0, 0.9)], []), "found 3 s after 5 s"),
    "early": (([(-2.0, 0.0), (5.0, 0.9)], []), "begins 2 s before the step"),
    "infinite": (([(0.0, math.nan), (5.0, 0.9)], []), "expected points"),
    "crossing": (([(0.0, 0.0), (10.0, 1.2)], [(0.0, 1.1), (10.0, 1.1)]), "cross: at 10 s"),
    # Crosses before the jump that parts the bounds again.
    "crossing before a jump": (
        ([(0.0, 0.0), (5.0, 1.5), (5.0, 0.0), (9.0, 0.5)], [(0.0, 1.1)]),
        "cross: at 5 s",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_bounds_that_are_none_are_refused_in_a_sentence(name: str) -> None:
    (lower, upper), words = WRONG[name]
    with pytest.raises(CampaignError, match=words):
        Corridor(lower, upper)


@pytest.mark.parametrize(
    ("figures", "words"),
    [
        ({"rise_s": 0.0}, "rise_s: expected more than 0"),
        ({"rise_s": math.nan}, "rise_s: expected more than 0"),
        ({"rise_s": 9.0, "settling_s": 5.0}, "settling_s = 5 is before rise_s = 9"),
        ({"rise_s": 9.0, "until_s": 18.0}, "until_s after the response has settled at 18 s"),
        ({"rise_s": 9.0, "settled": 0.2}, "settled = 0.2 is wider than the 0.1"),
        ({"rise_s": 9.0, "steady": 0.08}, "steady = 0.08 is wider than settled = 0.05"),
        ({"rise_s": 9.0, "steady": 0.0}, "steady: expected more than 0"),
        ({"rise_s": 9.0, "overshoot": -0.1}, "overshoot: expected 0 or more, found -0.1"),
        ({"rise_s": 9.0, "weight_lower": -1.0}, "weight of the lower bound: expected 0 or more"),
        ({"rise_s": 9.0, "weight_lower": 0.0, "weight_upper": 0.0}, "both weights"),
    ],
)
def test_figures_that_contradict_each_other_are_refused(figures: dict[str, float], words: str) -> None:
    with pytest.raises(CampaignError, match=words):
        Corridor.from_figures(**figures)


def test_a_band_needs_a_width_and_a_time() -> None:
    for width, until, words in ((0.0, 10.0, "expected more than 0, found 0"), (1.0, 0.0, "ends at 0 s")):
        with pytest.raises(CampaignError, match=words):
            Corridor.beside(width, until_s=until)


def test_errata_57_areas_agree_with_the_example_of_the_errata() -> None:
    # docs/errata.md: damping ratio 0.5 at 1 rad/s between 0.9 (from 3 s on) and 1.1, over 20 s.
    t: Array = 1e-3 * np.arange(20000.0)
    y = second_order(t, 0.5, 1.0)
    example = Corridor([(0.0, 0.0), (3.0, 0.0), (3.0, 0.9)], [(0.0, 1.1), (20.0, 1.1)])
    # Quoted digits; the sum over periods of 1 ms leaves 1e-4.
    assert float(criterion(t, y, example)) == pytest.approx(0.077, abs=1e-3)
    assert printed(t, y, example) == pytest.approx(0.593, abs=1e-3)


def test_errata_57_as_printed_jumps_where_a_response_touches_the_upper_bound() -> None:
    rising = np.minimum(T / 10.0, 1.0)
    inside, touching = (1.1 - 1e-9) * rising, 1.1 * rising
    band = Corridor([(0.0, -0.1), (10.0, -0.1), (10.0, 0.9), (40.0, 0.9)], [(0.0, 1.1)])
    assert criterion(T, inside, band) == criterion(T, touching, band) == 0.0
    # Width 0.2 times the 30 s that it rests there; nothing of it before.
    assert printed(T, inside, band) == 0.0
    assert printed(T, touching, band) == pytest.approx(0.2 * 30.0)


@given(y=responses)
def test_law_q_is_zero_exactly_inside(y: Array) -> None:
    lower, upper = SURGE.sampled(T)
    inside = bool(((lower <= y) & (y <= upper)).all())
    assert (float(criterion(T, y, SURGE)) == 0.0) == inside
    assert float(criterion(T, np.clip(y, lower, upper), SURGE)) == 0.0


@given(y=responses, weights=st.tuples(st.floats(0.01, 50.0), st.floats(0.01, 50.0)))
def test_law_q_is_the_weighted_sum_of_both_areas(y: Array, weights: tuple[float, float]) -> None:
    weighted = Corridor(SURGE.lower, SURGE.upper, *weights)
    # Two sums of the same terms in another order.
    assert float(criterion(T, y, weighted)) == pytest.approx(
        float(np.dot(weights, violations(T, y, SURGE))), rel=1e-12
    )


@given(y=responses, shift=hnp.arrays(float, len(T), elements=st.floats(-1.0, 1.0)))
def test_law_q_changes_no_more_than_the_response(y: Array, shift: Array) -> None:
    change = abs(float(criterion(T, y + shift, SURGE)) - float(criterion(T, y, SURGE)))
    assert change <= np.abs(shift).sum() * PERIOD + 1e-9  # Lipschitz with constant 1; rounding


@given(y=responses, other=responses, share=shares)
def test_law_q_is_convex_in_the_response(y: Array, other: Array, share: float) -> None:
    mixed = float(criterion(T, share * y + (1.0 - share) * other, SURGE))
    ends = share * float(criterion(T, y, SURGE)) + (1.0 - share) * float(criterion(T, other, SURGE))
    assert mixed <= ends + 1e-9  # rounding of sums of some 100 s


def test_law_the_sum_over_the_periods_is_the_integral_in_the_limit() -> None:
    # A line from 0 to 2 in 4 s between 0.5 and 1.5: two triangles with sides of 1 s and 0.5.
    band = Corridor([(0.0, 0.5), (4.0, 0.5)], [(0.0, 1.5), (4.0, 1.5)])
    errors = []
    for n in (40, 400, 4000):
        t = 4.0 / n * np.arange(n)
        errors.append(np.abs(violations(t, 0.5 * t, band) - 0.25).max())
    # First order in the period: half the jump of the violation at the ends times the period.
    assert errors == pytest.approx([0.025, 0.0025, 0.00025], rel=1e-6)


def test_a_batch_gives_the_numbers_of_its_rows_period_by_period() -> None:
    rng = np.random.default_rng(5)
    batch = rng.normal(0.9, 0.3, (2, 3, len(T)))
    areas, late = violations(T, batch, SURGE), time_weighted_error(T, batch, SURGE)
    lower, upper = SURGE.sampled(T)
    for i in range(2):
        for j in range(3):
            under = over = itae = 0.0
            for k, y in enumerate(batch[i, j]):  # as the core adds up
                under += PERIOD * max(lower[k] - y, 0.0)
                over += PERIOD * max(y - upper[k], 0.0)
                itae += PERIOD * T[k] * abs(y - 1.0)
            # Order of summation over 400 periods.
            np.testing.assert_allclose([*areas[i, j], late[i, j]], [under, over, itae], rtol=1e-12)


def test_time_before_the_step_and_after_the_end_does_not_count() -> None:
    early = np.where((T - 10.0 < 0.0) | (T - 10.0 > 20.0), 7.0, 1.0)
    short = Corridor.from_figures(rise_s=5.0, settling_s=10.0, until_s=20.0)
    y = np.where((T >= 10.0) & (T < 15.0), 0.5, early)
    assert float(criterion(T - 10.0, y, short)) == 0.0
    inside = (T >= 10.0) & (T < 15.0)
    expected = 0.5 * PERIOD * (T - 10.0)[inside].sum()
    assert float(time_weighted_error(T - 10.0, y, short)) == pytest.approx(expected)


def test_the_tie_breaker_orders_responses_inside() -> None:
    quick, slow = second_order(T, 0.8, 0.6), second_order(T, 0.8, 0.35)
    assert criterion(T, [quick, slow], SURGE).tolist() == [0.0, 0.0]
    first, second = time_weighted_error(T, [quick, slow], SURGE)
    assert first < second


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_diverged_response_costs_without_end_whatever_the_weights(value: float) -> None:
    y = np.where(T > 39.0, value, 1.0)
    one_sided = Corridor(SURGE.lower, SURGE.upper, weight_upper=0.0)
    assert violations(T, y, SURGE).tolist() == [math.inf, math.inf]
    assert float(criterion(T, y, one_sided)) == math.inf
    assert float(time_weighted_error(T, y, SURGE)) == math.inf


def test_grids_that_are_no_control_periods_are_refused() -> None:
    with pytest.raises(SimulationError, match=r"gaps from 0\.1 to 0\.2 s; resample"):
        criterion([0.0, 0.1, 0.3], [0.0, 0.0, 0.0], SURGE)
    with pytest.raises(SimulationError, match=r"found \(3,\) and \(2,\)"):
        criterion([0.0, 0.1, 0.2], [0.0, 0.0], SURGE)
    with pytest.raises(SimulationError, match="two or more periods"):
        criterion([0.0], [0.0], SURGE)
    with pytest.raises(SimulationError, match="the same before and after"):
        normalised([0.0, 1.0], 2.0, 2.0)


@given(y=responses, before=st.floats(-10.0, 10.0), size=st.sampled_from([-3.0, -0.2, 0.4, 5.0]))
def test_law_size_and_direction_of_a_step_do_not_matter(y: Array, before: float, size: float) -> None:
    # Offsets of 10 at steps of 0.2 cost two digits.
    np.testing.assert_allclose(normalised(before + size * y, before, before + size), y, atol=1e-12)


@pytest.mark.parametrize(("damping", "omega"), [(0.3, 0.5), (0.5, 1.0), (0.7, 0.8), (0.9, 2.0)])
def test_figures_of_a_step_agree_with_those_of_python_control(damping: float, omega: float) -> None:
    t: Array = 0.01 * np.arange(6000.0)
    y = second_order(t, damping, omega)
    found, other = step_metrics(t, y, band=0.02), control.step_info(y, t, yfinal=1.0)
    # control takes the next sample of 0.01 s, two of them for a rise.
    assert found.rise_10_90_s == pytest.approx(other["RiseTime"], abs=0.011)
    assert found.settling_s == pytest.approx(other["SettlingTime"], abs=0.011)
    assert found.overshoot == pytest.approx(other["Overshoot"] / 100.0, abs=1e-12)
    assert found.overshoot == pytest.approx(np.exp(-np.pi * damping / np.sqrt(1 - damping**2)), abs=1e-4)


def test_figures_of_a_late_first_order_answer_are_those_of_the_textbook() -> None:
    t = 0.01 * np.arange(4000)
    y = np.where(t < 2.0, 0.0, 1.0 - np.exp(-(t - 2.0) / 3.0))
    found = step_metrics(t, y)
    # Between samples of 0.01 s the curve is straight to 1e-5 of the step.
    assert found.dead_s == pytest.approx(2.0 - 3.0 * np.log(0.95), abs=1e-3)
    assert found.rise_s == pytest.approx(2.0 + 3.0 * np.log(10.0), abs=1e-3)
    assert found.rise_10_90_s == pytest.approx(3.0 * np.log(9.0), abs=1e-3)
    assert found.settling_s == pytest.approx(2.0 + 3.0 * np.log(20.0), abs=1e-3)
    assert (found.overshoot, found.undershoot) == (0.0, 0.0)


def test_figures_say_what_never_came() -> None:
    slow = step_metrics(T, -0.05 + 0.6 * (T / T[-1]))
    assert (slow.rise_s, slow.rise_10_90_s, slow.settling_s) == (math.inf, math.inf, math.inf)
    assert slow.undershoot == pytest.approx(0.05)
    assert slow.steady_error == pytest.approx(0.48, abs=1e-3)  # mean of the last tenth of a line
    diverged = step_metrics(T, np.where(T > 20.0, math.nan, 1.0))
    assert diverged.overshoot == diverged.settling_s == diverged.steady_error == math.inf
    at_once = step_metrics(T, np.ones_like(T))
    assert (at_once.rise_s, at_once.settling_s) == (0.0, 0.0)
    with pytest.raises(SimulationError, match="two or more rising times"):
        step_metrics([0.0, 0.0], [0.0, 1.0])


@given(damping=st.floats(0.6, 0.98), omega=st.floats(0.4, 2.0))
def test_law_a_response_with_the_figures_of_a_corridor_keeps_to_it(damping: float, omega: float) -> None:
    y = second_order(T, damping, omega)
    found = step_metrics(T, y, band=0.05)
    corridor = Corridor.from_figures(
        rise_s=found.rise_s + 1e-6,
        overshoot=found.overshoot + 1e-9,
        settling_s=max(found.settling_s, found.rise_s) + 1e-6,
        until_s=40.0,
    )
    # From a damping ratio of 0.6 on 90 % are not left again, and the slowest has settled after 15 s.
    assert float(criterion(T, y, corridor)) == 0.0
    hasty = Corridor.from_figures(rise_s=0.5 * found.rise_s, overshoot=1.0)
    assert violations(T, y, hasty)[0] > 0.0
