"""The cost of a set of gains: zero terms where feasible, robust over samples, infinite for what diverges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st_

from seatrial.control_design.corridor import Corridor
from seatrial.control_design.margin_constraint import MarginConstraint
from seatrial.control_design.tuning_table import Margins
from seatrial.tuning.objective import Objective, Terms, robust, violated
from seatrial.tuning.scope import GainParameters
from seatrial.tuning.step_trial import LoopTrials
from tests.tuning.tuning_campaigns import cwolf, rig, start, still

FREE = [2, 3, 4]
REACHED = np.array([False, False, True, True, True, False])
HEADING = GainParameters.of_loop("heading", start().gains(), free=FREE, reached=[2, 3, 4], bounds=(0.1, 10.0))
WIDE = Corridor([(0.0, -0.5), (14.0, -0.5), (14.0, 0.6)], [(0.0, 1.5), (20.0, 1.5)])


def objective(corridor: Corridor = WIDE, margins: Margins | None = None) -> Objective:
    trials = LoopTrials("heading", corridor, {}, (1.5,), (0.3,), settle_s=4.0)
    limits = None if margins is None else MarginConstraint(cwolf(), start(), (3.0,), limits=margins)
    return Objective(rig(), (trials,), still(2), HEADING, limits, 1.0, 0.05, REACHED)


def gains(*factors: float) -> dict[str, np.ndarray]:
    return HEADING.gains(np.log(np.outer(factors, np.ones(len(HEADING)))))


def test_violation_and_margin_are_zero_for_feasible_gains_and_only_then() -> None:
    terms = objective(margins=Margins()).terms(gains(1.0, 0.12))
    assert terms.violation[0] == 0.0
    assert terms.margin[0] == 0.0
    # A tenth of the gains does not turn the hull in time.
    assert terms.violation[1] > 0.1
    # The same gains lack a margin that nobody has.
    assert objective(margins=Margins(gain_db=60.0)).terms(gains(1.0)).margin[0] > 0.1


def test_the_search_is_held_against_a_narrower_corridor() -> None:
    # Grown by less than the headroom, the corridor holds the answer: inside it, but not by the headroom.
    trials = objective().trials[0]
    t, answers = rig().responses(trials, still(2), {})
    y = answers["yaw"][0, 0] / trials.sizes[0]
    since = t - trials.settle_s
    peak = float(y[(since > 0.0) & (since < trials.until_s)].max())
    end = float(y[(since > 18.0) & (since < trials.until_s)].min())
    assert end > 0.6
    tight = Corridor([(0.0, -0.5), (18.0, -0.5), (18.0, 0.5), (20.0, 0.5)], [(0.0, peak + 0.005)])
    one = objective(tight)
    assert one.terms(gains(1.0)).violation[0] > 0.0
    assert one.terms(gains(1.0), headroom=0.0).violation[0] == 0.0


def test_the_call_is_the_cost_of_the_terms() -> None:
    one = objective()
    x = np.log([[1.0] * len(HEADING), [0.12] * len(HEADING)])
    np.testing.assert_array_equal(one(x), one.terms(HEADING.gains(x)).cost(0.05))


def test_ties_order_feasible_gains_and_never_outweigh_a_violation() -> None:
    one = objective()
    terms = one.terms(gains(1.0, 1.5))
    assert (terms.violation == 0.0).all()
    cost = terms.cost(0.05)
    # Stiffer gains are there sooner.
    assert terms.time[1] < terms.time[0]
    assert cost[0] != cost[1]
    slack = Terms(
        *(np.array(x) for x in ([0.0, 1.0], [0.0, 0.0], [0.0, 0.0], [9.0, 0.0], [9.0, 0.0], [9.0, 0.0]))
    )
    assert slack.cost(0.05)[0] < slack.cost(0.05)[1]


def test_gains_with_which_a_sample_diverges_cost_without_end() -> None:
    samples = still(2, X_uu=[-20.0, 400.0])  # drag that pushes
    terms = replace(objective(), samples=samples).terms(gains(1.0))
    assert np.isinf(terms.violation[0])
    assert np.isinf(terms.cost(0.05)[0])


def test_what_wears_the_actuators_and_what_jumps_costs() -> None:
    terms = objective().terms(gains(1.0, 4.0))
    assert terms.effort[1] > terms.effort[0] > 0.0
    uneven = gains(1.0)
    uneven["heading.K_P.5"] = 9.0 * uneven["heading.K_P.5"]
    assert objective().terms(uneven).roughness[0] > objective().terms(gains(1.0)).roughness[0]


def test_both_sides_and_what_lies_beside_are_added_with_their_weights() -> None:
    corridor = Corridor.from_figures(rise_s=5.0, weight_lower=2.0, weight_upper=3.0)
    trials = LoopTrials("heading", corridor, {"z": 0.1}, (1.0,), (0.3,), settle_s=4.0)
    sums = np.zeros((1, 1, 1, 2, 3))
    sums[..., 0, :] = [10.0, 100.0, 7.0]
    sums[..., 1, :] = [1.0, 0.5, 7.0]
    assert violated(trials, sums)[0, 0, 0] == pytest.approx(2.0 * 10.0 + 3.0 * 100.0 + 1.0 + 0.5)


def test_the_worst_or_a_quantile_and_a_tenth_of_the_mean_decide() -> None:
    total = np.array([[0.0, 1.0, 5.0], [0.0, 0.0, 0.0], [2.0, 2.0, 2.0]])
    np.testing.assert_allclose(robust(total, 1.0), [5.2, 0.0, 2.2])
    np.testing.assert_allclose(robust(total, 0.5), [1.2, 0.0, 2.2])
    # The vehicle itself, the first ones, counts whatever the quantile: a tuning is feasible by it.
    own = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    np.testing.assert_allclose(robust(own, 0.5, nominal=2), [1.025, 1.025, 0.525])
    np.testing.assert_array_equal(robust(np.array([[0.0, np.inf], [0.0, np.nan]]), 0.5), [np.inf, np.inf])


@given(
    st_.lists(st_.floats(0.0, 1e6), min_size=2, max_size=8),
    st_.floats(0.0, 1.0),
    st_.integers(0, 7),
    st_.floats(0.0, 1e3),
)
def test_law_a_violation_more_never_costs_less(
    total: list[float], quantile: float, place: int, more: float
) -> None:
    before = np.array([total])
    after = before.copy()
    after[0, place % len(total)] += more
    slack = 1e-9 * (1.0 + max(total))  # rounding of a weighted mean
    assert robust(after, quantile)[0] >= robust(before, quantile)[0] - slack
    assert (robust(before, 1.0)[0] == 0.0) == (max(total) == 0.0)


def test_an_integral_that_is_too_slow_for_its_corridor_costs() -> None:
    # Wide enough for 10 % of the step at its end, which start gains without integral hold as well.
    corridor = Corridor.from_figures(rise_s=6.0, overshoot=0.15, settling_s=15.0, settled=0.1, until_s=20.0)
    trials = LoopTrials("surge", corridor, {}, (1.0,), (0.4,), settle_s=15.0)
    surge = GainParameters.of_loop(
        "surge", start().gains(), free=FREE, reached=[2, 3, 4], bounds=(0.01, 10.0)
    )
    one = replace(objective(), trials=(trials,), parameters=surge, rig=rig("typical"))
    values = start().gains()
    moved = {name: np.array([0.1, 1.0]) * values[name] for name in values if name.startswith("surge.K_I.")}
    terms = one.terms(moved, headroom=0.0)
    # The feed-forward knows this vehicle, so that the weak integral shows in no response of it.
    assert (terms.violation < 0.03).all()
    assert terms.offset[0] > terms.offset[1] + 1.0
    assert terms.cost(0.0)[0] > terms.cost(0.0)[1]


@pytest.mark.parametrize(("k_p", "k_i"), [(1.0, 1.0), (0.5, 0.5), (2.0, 4.0)])
def test_an_integral_as_fast_as_at_the_start_costs_nothing(k_p: float, k_i: float) -> None:
    trials = LoopTrials("surge", WIDE, {}, (1.0, 2.0), (0.4, 0.4), settle_s=5.0)
    one = replace(objective(), trials=(trials,), start=start().gains())
    values = start().gains()
    scale = {"K_P": k_p, "K_I": k_i, "K_D": 1.0}
    moved = {
        name: np.array([1.0, 0.1 if ".K_I." in name else 1.0]) * scale[name.split(".")[1]] * value
        for name, value in values.items()
        if name.startswith("surge.K_")
    }
    slow = one._slow_integral(trials, moved)
    # Ten times as slow: 0.1 x 20 s x ln of how far beyond the slower of start and corridor.
    assert slow[0] == 0.0
    assert slow[1] > 0.1 * 20.0 * np.log(10.0 * k_p / k_i * 4.5 / 7.0)
    none = {name: 0.0 * value for name, value in moved.items()}
    assert replace(one, start=dict.fromkeys(values, 0.0))._slow_integral(trials, none).tolist() == [0.0, 0.0]
