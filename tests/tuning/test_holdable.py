"""Operating points that no gains hold: found, left out of the margins, told."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

import seatrial as st
from seatrial.control_design.margin_constraint import MarginConstraint
from seatrial.control_design.tuning_table import Loops, LoopTable, TuningTable
from seatrial.identification.fitted import Fitted
from seatrial.report.results.tuning import sentences
from seatrial.tuning.control_problem import ControlProblem, beyond_gains
from seatrial.tuning.result import Tuning
from seatrial.tuning.search import search_margins
from tests.tuning.tuning_campaigns import cwolf, plan, start

STARTER = Path(__file__).parents[2] / "examples" / "starter" / "vehicle.toml"

BOUNDS = (0.1, 10.0)

RESTING = ("hover", -0.118)
"""The point of the starter at which nothing upsets its hull."""


@cache
def tender() -> ControlProblem:
    """A tuning of the heading of a hull that hardly rights itself, without an actuator for pitch."""
    whole = st.Vehicle.load(STARTER)
    vehicle = whole.with_coefficients({"z_b": 0.2 * whole.coefficients()["z_b"]})
    autopilot = st.Autopilot.from_toml(st.start_autopilot(whole))
    table = TuningTable(loops=Loops(heading=LoopTable(speeds_m_s=(0.3,))))
    return ControlProblem.of_table(table, Fitted.of(vehicle), autopilot)


def test_points_that_no_gains_hold_are_found_and_others_are_not() -> None:
    limits = MarginConstraint(tender().vehicle, tender().autopilot)
    rates = {point: limits.only([point]).growth({})[0] for point in limits.points}
    assert rates[RESTING] == 0.0 < rates["hover", 2.497]
    found = beyond_gains(limits, tender().autopilot.gains(), bounds=BOUNDS)
    assert set(found) == {point for point in limits.points if point != RESTING}
    # None of many gains holds them, indeed.
    rng = np.random.default_rng(1)
    tried = {
        name: value * np.exp(rng.uniform(np.log(0.1), np.log(10.0), 300))
        for name, value in tender().autopilot.gains().items()
        if ".K_" in name
    }
    for point in found:
        assert limits.only([point]).growth(tried).min() > 0.0


def test_what_other_gains_hold_is_no_such_point() -> None:
    limits = MarginConstraint(cwolf(), start())
    assert limits.only([("hover", -1.0)]).growth({})[0] > 0.0
    assert beyond_gains(limits, start().gains(), bounds=BOUNDS) == ()


def test_margins_count_where_gains_can_hold_the_motion_and_no_gain_moves_for_the_others() -> None:
    one = tender()
    assert len(one.beyond_gains) == 5
    assert one.margins is not None
    assert one.margins.points == [RESTING]
    found = search_margins(one, seed=1)
    moved = set() if found is None else set(found.gains)
    assert not {name for name in moved if name.endswith(".6")}
    assert one.margins.shortfall({})[0] < 1.0


def test_such_points_are_told_with_what_to_do() -> None:
    one = tender()
    tuning = Tuning(one, one.autopilot, (), (), (), 0.0, interrupted=False)
    short = tuning.short_margins
    # Ahead first: missions do not go astern.
    assert short[0] == "hover at 0.75 m/s (unstable, with any gains within the bounds)"
    assert len(short) == 5
    assert not tuning.held
    assert any("unstable, with any gains within the bounds" in line for line in sentences(tuning))


def test_loops_that_are_neither_tuned_nor_short_keep_their_gains() -> None:
    astern = "astern = { phase_deg = 0.0, gain_db = 0.0, delay_s = 0.0 }"
    one = plan(f"[tuning]\nmargins = {{ {astern} }}\n[tuning.loops.heading]\n")
    # Where hover ends heave and pitch are short.
    found = search_margins(one, seed=1)
    assert found is not None
    assert found.after["margin"] < 0.01 * found.before["margin"]
    assert {name.partition(".")[0] for name in found.gains} == {"heading", "heave", "pitch"}


def test_no_margin_asked_for_leaves_no_point_out() -> None:
    # CWolf's start gains leave it unstable astern.
    assert not plan().table.margins.any_at_all
    assert plan().beyond_gains == ()


def test_bounds_that_leave_no_room_leave_out_what_the_start_gains_do_not_hold() -> None:
    limits = MarginConstraint(cwolf(), start())
    assert beyond_gains(limits, start().gains(), bounds=(1.0, 1.0001)) == (("hover", -1.0),)
