"""What a tuning says of its result: reasons, bounds, what is taken for granted."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from seatrial.base.work import Progress, Work
from seatrial.control_design.corridor import Corridor
from seatrial.control_design.margin_report import ReportedMargins
from seatrial.identification.fitted import Fitted
from seatrial.report.results.tuning import sentences, why_outside
from seatrial.tuning.control_problem import ControlProblem
from seatrial.tuning.result import Performance, StepPerformance, Tuning
from tests.tuning.tuning_campaigns import HEADING, campaign, plan, tuned


def test_it_is_told_whether_the_drawn_vehicles_are_others() -> None:
    # Of a built-in vehicle no covariance is known: each that is drawn is the vehicle itself.
    said = " ".join(sentences(tuned()))
    assert "every one of 24 currents and noises (its coefficients count as exact)" in said
    known = Fitted.of("cwolf", percent={"N_rdot": 5.0})
    plan = tuned().plan
    of_drawn = ControlProblem.of_table(plan.table, known, plan.autopilot, name=plan.name, seed=plan.seed)
    one = replace(tuned(), plan=of_drawn)
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

    one = campaign("").tune(work=Work(progress=stop, threads=1))
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
    return Tuning(one, one.autopilot, (), (), (), 0.0, interrupted=False)


def outside_by(name: str, tuning: Tuning, **loops: float) -> Performance:
    """An assessment in which loops are outside by so many s."""
    figures = (0.5, 9.0, 0.1, 9.0, 0.0)
    trials = tuple(
        StepPerformance(loop, "deg", 3.0, 20.0, value, value, *figures) for loop, value in loops.items()
    )
    return Performance(name, tuning.autopilot, trials, 24, {})


def reported(*, start: dict[str, float], tuned: dict[str, float], margins: bool) -> tuple[str, str]:
    """First and second line of the report on some results; with margins that were too little before."""
    none = tuning_of(HEADING.replace("phase_deg = 0.0", "phase_deg = 30.0"))
    row = ReportedMargins(
        "cruise", 3.0, "pitch", True, 9.0, 1.0, None, None, 20.0, 1.0, 0.5, 1.0, 0.9, 8.0, 50.0, 1.4
    )
    one = replace(none, performance=(outside_by("start", none, **start), outside_by("tuned", none, **tuned)))
    vars(one)["margins"] = {
        "start": [row if margins else replace(row, phase_deg=40.0)],
        "tuned": [replace(row, phase_deg=28.8 if margins else 40.0)],
    }
    told = one.report()
    return told.good, told.worst


def test_a_loop_that_is_worse_than_before_stands_in_the_first_line_with_what_it_was_traded_for() -> None:
    good, worst = reported(start={"pitch": 0.079}, tuned={"pitch": 0.89}, margins=True)
    assert (
        "pitch is worse than with the start gains (0.89 s against 0.079 s outside), traded for the"
        " phase margin of pitch in cruise at 3.00 m/s (20 deg, now 29 of 30)" in good
    )
    # The margin that is still missed stands beside the response that is outside.
    assert worst.endswith("Margin short of its limit, too: pitch in cruise at 3.00 m/s (29 deg of 30)"), worst
    good, worst = reported(
        start={"pitch": 0.0, "heading": 2.0}, tuned={"pitch": 0.02, "heading": 0.0}, margins=False
    )
    assert "(0.02 s against 0 s outside), traded for heading (0 s against 2 s)" in good
    assert "Margin short" not in worst
    good, _ = reported(start={"pitch": 0.1}, tuned={"pitch": 0.0}, margins=True)
    assert "worse" not in good


def test_loops_that_changed_untuned_stand_in_the_first_line() -> None:
    none = tuning_of(HEADING)
    moved = none.autopilot.with_gains({"surge.K_P.5": 1.5 * none.autopilot.gains()["surge.K_P.5"]})
    one = replace(none, autopilot=moved, performance=(outside_by("tuned", none, heading=0.0),))
    assert (
        "gains of surge, which no corridor tunes, changed to mend margins that the start gains lack"
        in one.report().good
    )
    assert "which no corridor tunes" not in replace(one, autopilot=none.autopilot).report().good
