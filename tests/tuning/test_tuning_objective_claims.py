"""The cost of a set of gains from sums that are given: how samples, trials, loops and terms add up."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from seatrial.control_design.margin_constraint import MarginConstraint
from seatrial.tuning.objective import SETTINGS as OBJECTIVE_SETTINGS
from seatrial.tuning.objective import Objective, Terms
from seatrial.tuning.scope import GainParameters
from seatrial.tuning.step_trial import LoopTrials, Rig, Samples
from tests.tuning.tuning_campaigns import rig, start, trials

Array = NDArray[np.float64]

HEADING = GainParameters.of_loop(
    "heading", start().gains(), free=[4], taken=[0, 1, 2, 3, 5], reached=range(6), bounds=(0.1, 10.0)
)
"""Factors of the fifth point alone; another search sets the others."""
TERMS = ("violation", "margin", "offset", "time", "roughness", "effort")
SAMPLES = Samples({}, np.zeros((3, 3)), (1, 2, 3), nominal=1)
# Of two sets of gains and three samples: two trials of the heading, one of the surge. Below, above, late.
SUMS = {
    "heading": np.array([
        [
            [[1.0, 0.0, 12.0], [0.0, 2.0, 24.0], [0.0, 0.0, 0.0]],
            [[0.0, 0.0, 6.0], [4.0, 1.0, 3.0], [0.0] * 3],
        ],
        [[[0.0, 0.0, 1.0]] * 3, [[0.0, 0.5, 2.0]] * 3],
    ])[..., None, :],
    "surge": np.array([[[[0.0, 3.0, 5.0], [1.0, 0.0, 7.0], [6.0, 0.0, 9.0]]], [[[0.0, 0.0, 4.0]] * 3]])[
        ..., None, :
    ],
}
TRAVEL = {name: sums[..., 0, :].sum(axis=-1) + 1.0 for name, sums in SUMS.items()}
OFFSET = {name: 0.03 * travel for name, travel in TRAVEL.items()}
UNTIL_S = {"heading": 12.0, "surge": 20.0}


class Told:
    """Sums in place of flights, and what was asked for."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.headrooms, self.samples = list[float](), list[Samples]()
        monkeypatch.setattr(Rig, "violations", lambda _, *given, **more: self.violations(*given, **more))

    def violations(
        self, of: LoopTrials, samples: Samples, gains: Mapping[str, Array], *, headroom: float
    ) -> tuple[Array, Array, Array]:
        self.headrooms.append(headroom)
        self.samples.append(samples)
        return SUMS[of.loop], TRAVEL[of.loop], OFFSET[of.loop]


def objective(margins: Any = None, quantile: float = 1.0) -> Objective:
    loops = (
        trials("heading", (1.0, 2.0), (0.3, 0.3), until_s=UNTIL_S["heading"]),
        trials("surge", (1.0,), (0.3,), until_s=UNTIL_S["surge"]),
    )
    return Objective(
        rig(),
        loops,
        SAMPLES,
        HEADING,
        cast("MarginConstraint | None", margins),
        quantile,
        0.05,
        np.ones(6, bool),
    )


def terms(told: Told, **given: Any) -> Terms:
    return objective(**given).terms(HEADING.gains(np.zeros((2, len(HEADING)))))


def test_each_term_costs_by_its_weight_and_none_is_a_gain() -> None:
    # J = 10 Q + 30 M + 0.05 (O + T) + s S + 0.1 E
    for name, weight in zip(TERMS, (10.0, 30.0, 0.05, 0.05, 0.7, 0.1), strict=True):
        one = Terms(**{other: np.array([float(other == name)]) for other in TERMS})
        assert one.cost(0.7).tolist() == [weight], name


def test_the_violation_is_the_mean_over_trials_and_loops_of_the_worst_sample(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = terms(Told(monkeypatch)).violation
    # Per sample the mean of the heading's two trials, of the surge's one, and of the two loops.
    each = [(0.5 + 3.0) / 2.0, (3.5 + 1.0) / 2.0, (0.0 + 6.0) / 2.0]
    assert found[0] == pytest.approx(max(each) + 0.1 * np.mean(each), rel=1e-12)
    assert found[1] == pytest.approx(1.1 * 0.25 / 2.0, rel=1e-12)


def test_a_quantile_is_one_of_the_drawn_vehicles_and_never_less_than_the_vehicle_itself(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = terms(Told(monkeypatch), quantile=0.0).violation
    each = [1.75, 2.25, 3.0]  # the vehicle itself, and two drawn ones
    assert found[0] == pytest.approx(2.25 + 0.1 * np.mean(each), rel=1e-12)


def test_the_time_is_that_of_all_samples_and_trials_as_a_share_of_their_length(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = terms(Told(monkeypatch)).time
    heading = (12.0 + 24.0 + 0.0 + 6.0 + 3.0 + 0.0) / 6.0 / UNTIL_S["heading"]
    surge = (5.0 + 7.0 + 9.0) / 3.0 / UNTIL_S["surge"]
    assert found[0] == pytest.approx((heading + surge) / 2.0, rel=1e-12)
    assert found[1] == pytest.approx((1.5 / UNTIL_S["heading"] + 4.0 / UNTIL_S["surge"]) / 2.0, rel=1e-12)


def test_the_effort_is_the_mean_of_all_flights_of_a_loop_and_of_the_loops(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = terms(Told(monkeypatch)).effort
    assert found[0] == pytest.approx(
        (TRAVEL["heading"][0].mean() + TRAVEL["surge"][0].mean()) / 2.0, rel=1e-12
    )
    assert found[1] == pytest.approx((TRAVEL["heading"][1].mean() + 5.0) / 2.0, rel=1e-12)


def test_the_search_has_a_headroom_and_the_report_none(monkeypatch: pytest.MonkeyPatch) -> None:
    told = Told(monkeypatch)
    one = objective()
    one(np.zeros((2, len(HEADING))))
    one.terms(HEADING.gains(np.zeros((2, len(HEADING)))), headroom=0.0)
    assert told.headrooms == [OBJECTIVE_SETTINGS.headroom_share, OBJECTIVE_SETTINGS.headroom_share, 0.0, 0.0]
    assert OBJECTIVE_SETTINGS.headroom_share > 0.0
    assert all(samples is SAMPLES for samples in told.samples)


def test_what_the_margins_lack_is_taken_at_the_same_gains(monkeypatch: pytest.MonkeyPatch) -> None:
    class Limits:
        def shortfall(self, gains: Mapping[str, Array]) -> Array:
            return gains["heading.K_P.5"]

    found = terms(Told(monkeypatch), margins=Limits()).margin
    np.testing.assert_array_equal(found, [start().gains()["heading.K_P.5"]] * 2)
    assert terms(Told(monkeypatch)).margin.tolist() == [0.0, 0.0]


def test_the_roughness_counts_points_that_another_group_sets(monkeypatch: pytest.MonkeyPatch) -> None:
    assert {name.rpartition(".")[2] for name in HEADING.gains(np.zeros(len(HEADING)))} == {"5"}
    Told(monkeypatch)
    one = objective()
    x = np.log([[1.0] * len(HEADING), [5.0] * len(HEADING)])
    smooth, peaked = one.terms(HEADING.gains(x)).roughness
    assert peaked > smooth + 1.0


def test_the_steady_offset_counts_beyond_a_hundredth_of_the_step(monkeypatch: pytest.MonkeyPatch) -> None:
    found = terms(Told(monkeypatch)).offset
    each = {
        name: (np.maximum(off - 0.01, 0.0) * UNTIL_S[name]).mean(axis=(1, 2)) for name, off in OFFSET.items()
    }
    np.testing.assert_allclose(found, 0.5 * (each["heading"] + each["surge"]), rtol=1e-12)
    assert (found > 0.0).all()
