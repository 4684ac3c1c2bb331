"""Margins of many candidates at once, held against those of the report and of the start gains, and laws."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st_
from numpy.typing import NDArray

import seatrial as st
from seatrial.base.errors import CampaignError
from seatrial.control_design.margin_constraint import MarginConstraint, PointMargins
from seatrial.control_design.margin_report import ReportedMargins, autopilot_margins, report_margins
from seatrial.control_design.margins import decibel
from seatrial.control_design.operating_points import reachable_points
from seatrial.control_design.tuning_table import Margins
from seatrial.report.results.tuning import margin_table
from tests.control_design.started import started

CWOLF = st.Vehicle.load("cwolf")
LAUV = st.Vehicle.load("lauv")
BUILT_IN = st.Autopilot.load("cwolf")
START = Path(__file__).parents[2] / "examples" / "cwolf" / "start_autopilot.toml"
AHEAD = (0.881, 1.951, 3.021)
PLACED = 0.005
"""Of a gain margin: 180 frequencies place a crossing within half a per cent, and in phase within 0.1 deg."""


@cache
def start() -> st.Autopilot:
    return st.Autopilot.load(START)


@cache
def constraint() -> MarginConstraint:
    return MarginConstraint(CWOLF, BUILT_IN, AHEAD)


def louder(loop: str, factor: float | NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """All gains of a loop times factors."""
    gains = BUILT_IN.gains()
    return {name: value * np.asarray(factor) for name, value in gains.items() if f"{loop}.K_" in name}


def without_feed_forward() -> MarginConstraint:
    text = BUILT_IN.to_toml()
    assert "restoring = true" in text
    return MarginConstraint(
        CWOLF, st.Autopilot.from_toml(text.replace("restoring = true", "restoring = false")), AHEAD
    )


def of_one(point: PointMargins, loop: str) -> dict[str, float]:
    """Margins of a loop of the only candidate, inf where none."""
    k = point.loops.index(loop)
    return {
        "phase_deg": float(point.of.phase_deg[0, k]),
        "gain_up_db": float(decibel(point.of.gain[0, k])),
        "gain_down_db": float(decibel(point.of.reduction[0, k])),
        "delay_s": float(point.of.delay_s[0, k]),
    }


@pytest.mark.parametrize(
    ("vehicle", "autopilot", "speeds"),
    [
        ("cwolf", "cwolf", (0.881, 3.021)),
        ("cwolf", str(START), (-1.0, 1.0)),
        ("bluerov2-heavy", "bluerov2-heavy", (0.5,)),
    ],
)
def test_margins_of_the_batch_are_those_of_the_report(
    vehicle: str, autopilot: str, speeds: tuple[float, ...]
) -> None:
    model, pilot = st.Vehicle.load(vehicle), st.Autopilot.load(autopilot)
    here = {
        (point.mode, point.speed_m_s): point for point in MarginConstraint(model, pilot, speeds).margins({})
    }
    rows = report_margins(model, pilot, speeds)
    assert {(row.mode, row.speed_m_s) for row in rows} == set(here)
    for row in rows:
        point = here[row.mode, row.speed_m_s]
        assert row.stable == (point.growth_per_s[0] == 0.0)
        found = of_one(point, row.loop)
        assert found["phase_deg"] == pytest.approx(row.phase_deg, abs=0.1)
        assert found["delay_s"] == pytest.approx(row.delay_s, rel=PLACED)
        for side in ("gain_up_db", "gain_down_db"):
            reported = getattr(row, side)
            assert found[side] == pytest.approx(np.inf if reported is None else reported, abs=0.05)


def test_margins_are_those_of_check() -> None:
    here = {(point.mode, point.speed_m_s): point for point in constraint().margins({})}
    rows = autopilot_margins(CWOLF, BUILT_IN, speeds_m_s=AHEAD)
    assert {row.speed_m_s for row in rows} == set(AHEAD)
    for row in rows:
        point = here[row.mode, row.speed_m_s]
        assert row.phase_deg == pytest.approx(point.of.phase_deg.min(), abs=0.1)
        assert row.gain == pytest.approx(point.of.gain.min(), rel=PLACED)
        assert row.delay_s == pytest.approx(point.of.delay_s.min(), rel=PLACED)


@settings(deadline=None, max_examples=15)
@given(
    loop=st_.sampled_from(["surge", "heave", "pitch", "heading"]),
    factor=st_.floats(0.5, 2.0),
    k=st_.integers(2, 5),
)
def test_law_gain_margin_of_a_row_falls_by_the_scale_of_its_gains(loop: str, factor: float, k: int) -> None:
    bare = _bare()
    for point in bare.margins(louder(loop, np.array([1.0] * k + [factor]))):
        if loop in point.loops:
            gain = decibel(point.of.gain[:, point.loops.index(loop)])
            assert gain[-1] == pytest.approx(gain[0] - 20.0 * np.log10(factor), abs=1e-6)


@cache
def _bare() -> MarginConstraint:
    """Without the feed-forward, which does not grow with the gains."""
    return without_feed_forward()


def test_law_beyond_its_gain_margin_a_row_is_unstable() -> None:
    bare = _bare()
    heading = louder("heading", 1.0)
    for k, point in enumerate(bare.margins(heading)):
        margin = float(point.of.gain[0, point.loops.index("heading")])
        within, beyond = (
            bare.margins(louder("heading", factor * margin))[k].growth_per_s[0] for factor in (0.99, 1.01)
        )
        assert within == 0.0
        assert beyond > 0.0


def test_margins_beside_other_gains_are_those_of_that_autopilot() -> None:
    first = MarginConstraint(CWOLF, BUILT_IN, AHEAD[:1])
    gains = {name: 1.7 * value for name, value in BUILT_IN.gains().items() if name.startswith("heading.K_")}
    louder = {"pitch.K_P.4": [1.0, 2.0]}
    there = MarginConstraint(CWOLF, BUILT_IN.with_gains(gains), AHEAD[:1])
    here = first.beside(gains)
    assert here.shortfall(louder).tolist() == there.shortfall(louder).tolist()
    # The first one stays what it was.
    of = [one.margins({})[0].of.phase_deg[0].tolist() for one in (first, here, there)]
    assert of[1] == of[2] != of[0]


def test_candidates_do_not_depend_on_their_neighbours() -> None:
    rng = np.random.default_rng(1)
    gains = {
        name: value * np.exp(rng.normal(0.0, 0.7, 70))
        for name, value in BUILT_IN.gains().items()
        if ".K_" in name
    }
    together = constraint().shortfall(gains)
    alone = [
        constraint().shortfall({name: values[i] for name, values in gains.items()})[0]
        for i in (0, 63, 64, 69)
    ]
    # Sums of the matrix product in another order.
    assert together[[0, 63, 64, 69]] == pytest.approx(alone, abs=1e-6)
    assert (together > 0.0).any()
    assert (together == 0.0).any()


def test_shortfall_is_zero_where_all_limits_hold_and_grows_through_the_edge_of_stability() -> None:
    coarse, fine = (
        constraint().shortfall(louder("heading", np.geomspace(1.0, 60.0, count))) for count in (301, 601)
    )
    assert fine[0] == 0.0
    assert (np.diff(fine) > -1e-6).all()
    assert fine[-1] > len(constraint().points)
    # Half the step, half the change: no jump where limits are missed, nor where motions begin to grow.
    assert np.diff(fine).max() < 0.55 * np.diff(coarse).max()
    early = fine[:-1] < 1.5
    assert np.diff(fine)[early].max() < 0.1


def test_an_unstable_candidate_ranks_by_its_growth() -> None:
    one = MarginConstraint(CWOLF, BUILT_IN, AHEAD[:1])
    gains = louder("pitch", np.geomspace(0.2, 30.0, 80))
    growth = one.margins(gains)[0].growth_per_s
    short = one.shortfall(gains)
    assert short[growth > 0.0].min() > 1.0
    # The largest of a stable one is below 1; 0.3 of each other loop comes on top.
    assert short[growth == 0.0].max() < 1.0 + 0.3 * (len(one.margins(gains)[0].loops) - 1)
    faster = np.argsort(growth[growth > 0.0])
    assert (np.diff(short[growth > 0.0][faster]) >= 0.0).all()


def test_the_shortfall_leads_from_an_unstable_point_to_one_that_holds_its_limits() -> None:
    # Astern at 1 m/s, where the start gains let pitch and heave double in 2.2 s: nothing but the best of 150.
    one = MarginConstraint(CWOLF, start(), (-1.0,))
    rng = np.random.default_rng(0)
    best = {name: value for name, value in start().gains().items() if ".K_" in name and name.endswith(".3")}
    assert one.shortfall(best)[0] > 1.0
    for _ in range(20):
        drawn = {name: value * np.exp(rng.normal(0.0, 0.4, 150)) for name, value in best.items()}
        short = one.shortfall(drawn)
        if short.min() < one.shortfall(best)[0]:
            best = {name: float(values[short.argmin()]) for name, values in drawn.items()}
    assert one.shortfall(best)[0] == 0.0


@pytest.mark.parametrize("limits", [Margins(phase_deg=80.0), Margins(gain_db=30.0), Margins(delay_s=5.0)])
def test_each_limit_counts(limits: Margins) -> None:
    strict = MarginConstraint(CWOLF, BUILT_IN, AHEAD[:1], limits=limits)
    loose = MarginConstraint(
        CWOLF, BUILT_IN, AHEAD[:1], limits=Margins(phase_deg=0.0, gain_db=0.0, delay_s=0.0)
    )
    assert 0.0 < strict.shortfall({})[0] < 1.9  # three loops: the largest below 1, and 0.3 of the others
    assert loose.shortfall({})[0] == 0.0


def test_unreachable_points_stand_aside_and_both_modes_count_where_they_change_over() -> None:
    assert reachable_points(CWOLF, start()).tolist() == [False, False, True, True, True, False]
    points = MarginConstraint(CWOLF, start()).points
    assert {speed for _, speed in points} == {-1.0, 1.0, 1.11, 3.0}
    assert [mode for mode, speed in points if speed == 1.11] == ["hover", "cruise"]
    # 1 m/s is within the hysteresis.
    assert [mode for mode, speed in points if speed == 1.0] == ["hover", "cruise"]


def test_the_start_gains_miss_their_limits_in_hover_where_cruise_takes_over() -> None:
    short = {
        (point.mode, point.speed_m_s): point.shortfall(Margins())[0]
        for point in MarginConstraint(CWOLF, start(), (1.0, 3.0)).margins({})
    }
    assert short["hover", 1.11] > 0.2
    assert all(value == 0.0 for point, value in short.items() if point != ("hover", 1.11))


def test_bad_input_is_named() -> None:
    with pytest.raises(CampaignError, match=r'no gain "heading\.KP\.3".*heading\.K_P\.3'):
        constraint().shortfall({"heading.KP.3": 1.0})
    with pytest.raises(CampaignError, match="as many values of each gain"):
        constraint().shortfall({"heading.K_P.3": [1.0, 2.0], "heading.K_P.4": [1.0, 2.0, 3.0]})
    with pytest.raises(CampaignError, match='found "lqr"'):
        MarginConstraint(LAUV, started("lauv", "lqr"))
    with pytest.raises(CampaignError, match="none"):
        MarginConstraint(CWOLF, BUILT_IN, [])


def test_the_table_of_the_report_says_what_is_unstable() -> None:
    row = ReportedMargins(
        "hover", -1.0, "surge", False, None, None, 3.0, 1.0, 40.0, 1.0, 0.5, 1.0, 0.9, 8.0, 50.0, 1.4
    )
    (cells,) = margin_table([row]).rows
    assert cells == ("hover", "-1.00", "surge", "-", "3.0", "40", "0.50", "0.90", "unstable")
    (cells,) = margin_table([replace(row, stable=True, gain_up_db=2.3)]).rows
    assert cells[-1] == "little margin: gain"
    # Words of the field are told below.
    note = margin_table([row]).note
    assert "disk: gain and phase changed at once (disk margin, at most 2)" in note
    assert "Sensitivity: how much the loop enlarges a disturbance at worst, accepted up to 2" in note


def test_a_constraint_at_some_of_its_points_is_that_of_these_points() -> None:
    whole = constraint()
    point = whole.points[1]
    one = whole.only([point])
    assert one.points == [point]
    assert one.shortfall({})[0] == whole.margins({})[1].shortfall(whole.limits)[0]
    assert one.growth({})[0] == whole.margins({})[1].growth_per_s[0]
    assert whole.growth({})[0] == max(each.growth_per_s[0] for each in whole.margins({}))
    assert whole.only([]).shortfall({"heading.K_P.3": [1.0, 2.0]}).tolist() == [0.0, 0.0]
