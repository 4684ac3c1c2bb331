"""What a tuning says of its result: reasons, bounds, what is taken for granted."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from seatrial.base.progress import Progress
from seatrial.campaign.corridor import Corridor
from seatrial.identification.fitted import Fitted
from seatrial.tuning.performance import StepPerformance, why_outside
from seatrial.tuning.result import Tuning, sentences
from seatrial.tuning.tune import tune
from tests.tuning.tuning_campaigns import HEADING, campaign, plan, tuned


def test_it_is_told_whether_the_drawn_vehicles_are_others() -> None:
    # Of a built-in vehicle no covariance is known: each that is drawn is the vehicle itself.
    said = " ".join(sentences(tuned()))
    assert "every one of 24 currents and noises (its coefficients count as exact)" in said
    known = Fitted.of("cwolf", percent={"N_rdot": 5.0})
    one = replace(tuned(), plan=replace(tuned().plan, fitted=known))
    assert "every one of 24 others that were drawn" in " ".join(sentences(one))


def test_factors_at_a_bound_are_those_that_the_last_search_left_there() -> None:
    one = tuned()
    group, _ = one.groups
    moved = next(iter(group.gains))
    margins = replace(group, name="margins", at_bound=(moved, "roll.K_P.1"))
    said = " ".join(sentences(replace(one, groups=(margins, replace(group, at_bound=())))))
    assert "roll.K_P.1; widen [tuning] bounds" in said
    assert moved not in said
    assert repr(one) == "Tuning(small: feasible=True, searched: heading, guidance)"


@pytest.mark.parametrize(
    ("quiet", "words"),
    [
        ({"nominal_s": 0.0}, "with perfect sensors it stays inside, so sensor noise or latency is the cause"),
        ({"rise_s": 6.5}, "it rises in 6.5 s, 5 s are asked"),
        ({"rise_s": float("inf")}, "it rises not at all, 5 s are asked"),
        ({"overshoot": 0.12}, "it overshoots by 12% without noise, too, 10% are allowed"),
        ({"overshoot": 56.85}, "the motion grows at that speed"),
        ({"overshoot": float("nan"), "rise_s": 4.0}, "the motion grows at that speed"),
        ({"settling_s": float("inf")}, "it is not within 5 % below and 5 % above its set point by 20 s"),
        ({}, "it settles late"),
    ],
)
def test_the_bound_that_a_response_cannot_keep_to_is_told(quiet: dict[str, Any], words: str) -> None:
    corridor = Corridor.from_figures(rise_s=5.0, overshoot=0.1, settling_s=10.0)
    inside = StepPerformance("heading", "deg", 1.0, 20.0, 0.1, 0.1, 0.0, 4.0, 0.05, 9.0, 0.0)
    assert words in why_outside(replace(inside, **quiet), corridor)


def test_a_campaign_without_a_table_is_told_that_defaults_are_searched() -> None:
    seen = list[Progress]()

    def stop(state: Progress) -> None:
        seen.append(state)
        if state.step is not None and state.step.generation > 1:
            raise KeyboardInterrupt

    one = tune(campaign(""), progress=stop, threads=1)
    assert one.interrupted
    notes = [note for state in seen for note in state.notes]
    assert len(notes) == 1  # once, and at once
    assert seen[0].notes == tuple(notes)
    assert "The campaign has no [tuning]" in notes[0]
    assert notes[0] in sentences(one)
    assert not any("has no [tuning]" in line for line in sentences(tuned()))


def test_an_unstable_motion_falls_short_where_no_margin_is_asked_for_too() -> None:
    # CWolf's start gains leave it unstable astern.
    none = tuning_of(HEADING)
    assert not none.plan.table.margins.phase_deg
    assert [words for words in none.short_margins if "unstable" in words] == list(none.short_margins) != []


def tuning_of(text: str) -> Tuning:
    """A tuning that has changed nothing."""
    one = plan(text)
    return Tuning(campaign(text), one, one.autopilot, (), (), None, (), 0.0, interrupted=False)
