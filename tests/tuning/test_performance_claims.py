"""What an assessment says of given violations: by the vehicle itself, by the drawn ones, of a group."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from seatrial.report.results.tuning import comparison_rows, on_another_vehicle, trial_rows
from seatrial.tuning.control_problem import ControlProblem
from seatrial.tuning.result import Performance, assess
from seatrial.tuning.step_trial import LoopTrials, Rig, Samples
from tests.tuning.tuning_campaigns import plan

Array = NDArray[np.float64]

TEXT = """
[tuning]
margins = { phase_deg = 0.0, gain_db = 0.0, delay_s = 0.0 }
[tuning.loops.heading]
steps = [20.0]
speeds_m_s = [2.0, 3.0]
corridor = { rise_s = 7.0 }
[tuning.loops.surge]
steps = [-0.3]
speeds_m_s = [3.0]
corridor = { rise_s = 6.0 }
"""
SAMPLES = Samples({"X_uu": np.arange(6.0)}, np.arange(18.0).reshape(6, 3), (1, 2, 3, 4, 5, 6), nominal=2)
"""Two noises of the vehicle itself, and four drawn vehicles."""

OUTSIDE = {
    "heading": np.array([[0.1, 0.4, 0.0, 0.0, 0.0, 2.0], [0.0, 0.0, 0.0, 3.0, 1.0, 5.0]]),
    "surge": np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0]]),
}
"""Violation of each trial by each sample, s."""


@cache
def made() -> ControlProblem:
    return plan(TEXT)


def performance(monkeypatch: pytest.MonkeyPatch, **given: Any) -> Performance:
    def violations(_: Rig, trials: LoopTrials, *__: object, headroom: float = 0.0) -> tuple[Array, ...]:
        assert headroom == 0.0  # what is told has none
        below = OUTSIDE[trials.loop][None, ..., None, None]
        none = np.zeros((1, len(trials), 6))
        return np.concatenate([below, 0.0 * below, 9.0 + below], axis=-1), none, none

    monkeypatch.setattr(Rig, "violations", violations)
    one = made()
    return assess(one, "tuned", one.rig(one.autopilot), SAMPLES, **given)


def test_the_vehicle_itself_and_the_drawn_ones_are_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    slow, fast, surge = performance(monkeypatch, responses=False).trials
    # The largest of the vehicle's own noises; the largest of all; of the drawn ones the share that is inside.
    assert (slow.nominal_s, slow.worst_s, slow.held) == (0.4, 2.0, 0.75)
    assert (fast.nominal_s, fast.worst_s, fast.held) == (0.0, 5.0, 0.25)
    assert (surge.nominal_s, surge.worst_s, surge.held) == (0.0, 0.0, 1.0)


def test_an_assessment_is_feasible_by_the_vehicle_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    one = performance(monkeypatch, responses=False)
    assert one.samples == 4
    assert one.nominal_s == 0.4
    assert one.worst_s == 5.0
    assert not one.feasible
    monkeypatch.setitem(OUTSIDE, "heading", np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 2.0]] * 2))
    assert performance(monkeypatch, responses=False).feasible


def test_only_the_groups_that_are_asked_for_are_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    for group in made().groups:
        found = performance(monkeypatch, responses=False, only=(group,)).trials
        assert {trial.loop for trial in found} == {group.name}


def test_the_responses_that_are_kept_are_the_vehicle_s_own_and_then_the_worst(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen: dict[str, Samples] = {}

    def responses(_: Rig, trials: LoopTrials, samples: Samples, __: object) -> tuple[Array, dict[str, Array]]:
        seen[trials.loop] = samples
        t = trials.grid(0.1)
        return t, {trials.names[0]: np.zeros((len(trials), len(samples), len(t)))}

    monkeypatch.setattr(Rig, "responses", responses)
    performance(monkeypatch)
    met = seen["heading"]
    assert met.seeds == (1, 6, 4, 5, 2, 3)
    # Vehicle, current and noise of a sample stay together.
    np.testing.assert_array_equal(met.coefficients["X_uu"], np.array(met.seeds) - 1.0)
    np.testing.assert_array_equal(met.current[:, 0], 3.0 * (np.array(met.seeds) - 1.0))


def test_an_answer_further_outside_than_none_at_all_diverges_and_ranks_last(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    until_s = made().trials("heading").until_s
    lost, found = 2.0 * until_s + 0.1, 2.0 * until_s
    told = np.array([[lost, 0.0, 0.0, 0.0, 0.0, 0.0], [found, 0.0, lost, 0.0, 0.0, 0.0]])
    monkeypatch.setitem(OUTSIDE, "heading", told)
    one = performance(monkeypatch, responses=False)
    slow, fast, surge = one.trials
    assert slow.nominal_s == slow.worst_s == one.nominal_s == np.inf
    assert (fast.nominal_s, fast.worst_s) == (found, np.inf)
    assert max(one.trials, key=lambda trial: trial.nominal_s) is slow
    outside = {row[0]: row[1] for row in comparison_rows([one])}
    assert outside == {"heading": "diverges", "surge": "0"}
    assert [row[3] for row in trial_rows(one)] == ["diverges", f"{found:.2g}", "0"]
    said = on_another_vehicle(one)
    assert "heading at 2.00 m/s, step of +20 deg, diverges" in said
    assert surge.nominal_s == 0.0
