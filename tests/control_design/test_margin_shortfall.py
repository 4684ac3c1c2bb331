"""By how much margins fall short of their limits: numbers by hand, one margin at a time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seatrial.control_design.margin_constraint import PointMargins
from seatrial.control_design.margin_report import ReportedMargins
from seatrial.control_design.margins import LoopMargins
from seatrial.control_design.tuning_table import LeastMargins, Margins
from seatrial.tuning.result import Tuning
from tests.tuning.tuning_campaigns import HEADING, plan, start

LIMITS = Margins(phase_deg=40.0, gain_db=8.0, delay_s=0.5)
AMPLE = {"phase_deg": 80.0, "gain": 10.0, "reduction": 10.0, "delay_s": 5.0}
RAD_S = ("phase_rad_s", "gain_rad_s", "reduction_rad_s", "delay_rad_s")
HALF = {"phase_deg": 20.0, "gain": 10.0**0.2, "reduction": 10.0**0.2, "delay_s": 0.25}
"""Half of each limit: 4 dB are the factor 10^0.2."""


def point(*loops: dict[str, float], speed_m_s: float = 1.0, growth_per_s: float = 0.0) -> PointMargins:
    """One candidate whose loops have these margins."""
    of = {name: np.array([[loop[name] for loop in loops]]) for name in AMPLE}
    names = ("surge", "heave", "pitch", "heading")[: len(loops)]
    rad_s = dict.fromkeys(RAD_S, np.ones((1, len(loops))))
    margins = LoopMargins(**of, **rad_s, sensitivity=np.ones((1, len(loops))))
    return PointMargins("hover", speed_m_s, names, margins, np.array([growth_per_s]))


def test_margins_that_hold_fall_short_of_nothing() -> None:
    assert point(AMPLE, AMPLE).shortfall(LIMITS).tolist() == [0.0]


@pytest.mark.parametrize("margin", list(AMPLE))
def test_each_margin_alone_at_half_its_limit_is_half_short(margin: str) -> None:
    short = AMPLE | {margin: HALF[margin]}
    assert point(AMPLE, short).shortfall(LIMITS)[0] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("limit", "margins"),
    [("phase_deg", ["phase_deg"]), ("gain_db", ["gain", "reduction"]), ("delay_s", ["delay_s"])],
)
def test_a_limit_of_zero_asks_for_none_of_its_margins(limit: str, margins: list[str]) -> None:
    short = AMPLE | {margin: 1e-3 + (margin in ("gain", "reduction")) for margin in margins}
    assert point(short).shortfall(LIMITS)[0] > 0.9
    assert point(short).shortfall(LIMITS.model_copy(update={limit: 0.0}))[0] == 0.0


def test_the_shortest_margin_of_a_loop_counts_not_their_sum() -> None:
    short = AMPLE | {"phase_deg": 30.0, "delay_s": 0.2}  # 0.25 and 0.6 short
    assert point(short).shortfall(LIMITS)[0] == pytest.approx(0.6)


def test_of_several_short_loops_the_others_count_by_three_tenths() -> None:
    loops = [AMPLE | {"phase_deg": phase} for phase in (20.0, 30.0, 36.0)]  # 0.5, 0.25 and 0.1 short
    assert point(*loops, AMPLE).shortfall(LIMITS)[0] == pytest.approx(0.5 + 0.3 * (0.25 + 0.1))


def test_an_unstable_point_counts_by_its_growth_and_the_loops_beside_the_largest() -> None:
    loops = [AMPLE | {"phase_deg": phase} for phase in (20.0, 30.0)]
    short = point(*loops, growth_per_s=0.2).shortfall(LIMITS)
    assert short[0] == pytest.approx(1.0 + 10.0 * 0.2 + 0.3 * 0.25)


def test_limits_astern_are_those_of_a_desired_speed_below_zero() -> None:
    limits = LIMITS.model_copy(update={"astern": LeastMargins(phase_deg=25.0, gain_db=0.0, delay_s=0.0)})
    assert [limits.at(speed).phase_deg for speed in (-1.0, 0.0, 1.0)] == [25.0, 40.0, 40.0]
    assert [LIMITS.at(speed).phase_deg for speed in (-1.0, 1.0)] == [40.0, 40.0]
    loop = AMPLE | {"phase_deg": 20.0}
    assert point(loop, speed_m_s=-1.0).shortfall(limits)[0] == pytest.approx(0.2)
    assert point(loop, speed_m_s=1.0).shortfall(limits)[0] == pytest.approx(0.5)
    assert point(loop, speed_m_s=-1.0).shortfall(LIMITS)[0] == pytest.approx(0.5)


def test_where_no_margin_is_asked_for_a_point_may_be_unstable() -> None:
    none = LeastMargins(phase_deg=0.0, gain_db=0.0, delay_s=0.0)
    limits = LIMITS.model_copy(update={"astern": none})
    assert point(AMPLE, speed_m_s=-1.0, growth_per_s=0.2).shortfall(limits).tolist() == [0.0]
    assert point(AMPLE, speed_m_s=1.0, growth_per_s=0.2).shortfall(limits)[0] > 1.0


GOOD = ReportedMargins(
    "hover", 1.0, "pitch", True, 20.0, 3.0, 20.0, 0.5, 80.0, 1.0, 5.0, 1.0, 1.0, 10.0, 50.0, 1.3
)  # fmt: skip
ASKED = HEADING.replace(
    "margins = { phase_deg = 0.0, gain_db = 0.0, delay_s = 0.0 }",
    "margins = { phase_deg = 40.0, gain_db = 8.0, delay_s = 0.5, astern = { phase_deg = 25.0 } }",
)


def named(*rows: ReportedMargins) -> tuple[str, ...]:
    """What a tuning says of margins."""
    one = Tuning(plan(ASKED), start(), (), (), (), 0.0, False)
    vars(one)["margins"] = {"tuned": list(rows)}
    return one.short_margins


@pytest.mark.parametrize(
    ("short", "words"),
    [
        (replace(GOOD, phase_deg=30.0), "30 deg of 40"),
        (replace(GOOD, gain_up_db=6.5), "6.5 dB of 8"),
        (replace(GOOD, gain_down_db=4.9), "4.9 dB down of 8"),
        (replace(GOOD, delay_s=0.3), "0.3 s of 0.5"),
    ],
)
def test_a_margin_that_falls_short_is_named_with_its_limit(short: ReportedMargins, words: str) -> None:
    assert named(GOOD, short) == (f"pitch in hover at 1.00 m/s ({words})",)


def test_only_what_rounding_does_not_explain_is_short() -> None:
    # Four digits of a gain and the grid of frequencies leave less than 1 %.
    assert named(replace(GOOD, phase_deg=39.7, gain_up_db=7.95, gain_down_db=7.95, delay_s=0.497)) == ()
    (words,) = named(replace(GOOD, phase_deg=39.5, gain_up_db=7.9, gain_down_db=7.9, delay_s=0.49))
    assert words.count(" of ") == 4


def test_limits_astern_and_margins_that_nothing_bounds_and_unstable_points_are_told() -> None:
    astern = replace(GOOD, speed_m_s=-1.0, phase_deg=30.0, gain_up_db=None, gain_down_db=None)
    assert named(astern) == ()
    assert named(replace(astern, phase_deg=20.0)) == ("pitch in hover at -1.00 m/s (20 deg of 25)",)
    # Margins of an unstable loop are distances from the other side.
    assert named(replace(GOOD, stable=False, phase_deg=3.0)) == ("hover at 1.00 m/s (unstable)",)
