"""Tuning of ArduSub's parameters: margins of its loops, corridors over drawn missions."""

from __future__ import annotations

import math

import numpy as np
import pytest

import seatrial as st
from seatrial._core import ardusub_defaults, ardusub_terms
from seatrial.ardusub.axes import AMPLE, SOUGHT, AxisVerdict, MarginModel, Margins, loop_law
from seatrial.ardusub.tuning import (
    corridors_of,
    draw_cases,
    fly_missions,
    rise_of,
    step_courses,
    tune_parameters,
)
from tests.ardusub import flown_log

WANDER = np.array([0.5, 0.5, 0.5, 0.02, 0.02, 0.02])


@pytest.fixture(scope="module")
def fitted() -> st.Fitted:
    return st.Fitted.of(flown_log.vehicle(), percent={"N_rdot": 20.0, "N_rr": 20.0})


def test_the_linear_law_is_what_the_controller_does() -> None:
    """A turn rate that swings at 1 Hz, through the core's controller and through the transfer function."""
    values = {**ardusub_defaults(), "ATC_RAT_RLL_P": 0.2, "ATC_RAT_RLL_I": 0.3, "ATC_RAT_RLL_D": 0.01}
    dt, omega = 0.0005, 2.0 * math.pi
    t = np.arange(0.0, 12.0, dt)
    gains = [values[f"ATC_RAT_RLL_{x}"] for x in ("P", "I", "D", "FF")] + [0.0, math.inf]
    filters = [values[f"ATC_RAT_RLL_{x}"] for x in ("FLTT", "FLTE", "FLTD")]
    terms = np.asarray(
        ardusub_terms(
            np.zeros(len(t)), -np.cos(omega * t), np.full(len(t), dt), np.zeros(len(t)), gains, filters
        )
    )
    late = t > 6.0
    output = terms[:, 2:6].sum(axis=1)[late]
    waves = np.stack([np.cos(omega * t[late]), -np.sin(omega * t[late]), np.ones(late.sum())], 1)
    (real, imaginary, _), *_ = np.linalg.lstsq(waves, output, rcond=None)
    inner = loop_law("roll", {**values, "ATC_ANG_RLL_P": 0.0}, np.array([1j * omega]))[0]
    assert complex(real, imaginary) == pytest.approx(inner, rel=0.01)


def test_margins_fall_with_the_gain_and_are_kept_by_their_measure(fitted: st.Fitted) -> None:
    model = MarginModel(fitted, flown_log.RIG, period_s=0.005, voltage_v=16.0, draws=8)
    gentle, harsh = (model.of("yaw", {"ATC_RAT_YAW_P": 0.1, "ATC_ANG_YAW_P": p}) for p in (3.0, 12.0))
    assert gentle.phase_deg > harsh.phase_deg
    assert gentle.sensitivity < harsh.sensitivity
    ample = Margins("yaw", AMPLE[0] + 20.0, AMPLE[1] + 10.0, 1.1)
    assert Margins("yaw", *AMPLE).lacking(ample) == 0.0
    assert Margins("yaw", 40.0, 12.0, 1.5).lacking(ample) > 0.0
    assert Margins("yaw", 40.0, 12.0, 1.5).lacking(Margins("yaw", 35.0, 12.0, 1.5)) == 0.0


def test_a_poor_loop_is_tuned_and_what_cannot_be_judged_stays(fitted: st.Fitted) -> None:
    poor = {**flown_log.GAINS, "ATC_RAT_YAW_P": 0.06, "ATC_ANG_YAW_P": 4.0}
    corridors = corridors_of(1.5)
    courses = step_courses({"yaw": corridors["yaw"]}, period_s=0.01)
    model = MarginModel(fitted, flown_log.RIG, period_s=0.01, voltage_v=16.0, draws=8)
    verdicts = tuple(AxisVerdict(loop, loop == "yaw", "", "") for loop in SOUGHT)
    found = tune_parameters(
        fitted, flown_log.RIG, courses, poor, verdicts, model, cases=draw_cases(fitted, WANDER, 8, seed=1),
        generations=5,
    )  # fmt: skip
    assert found.changes
    assert {one.name for one in found.changes} <= set(SOUGHT["yaw"])
    for one in found.changes:
        assert one.bounds is not None
        assert one.bounds[0] <= one.after <= one.bounds[1]
        assert "without this change" in one.why
    before, after = found.margins["yaw"]
    assert after.lacking(before) <= before.lacking(before)
    cases = draw_cases(fitted, WANDER, 24, seed=9)
    was, now = (
        fly_missions(fitted, flown_log.RIG, courses, values, cases=cases) for values in (poor, found.after)
    )
    assert now.worst("yaw") < was.worst("yaw")
    again = type(now).of_dict(now.to_dict())
    assert again.row("yaw") == pytest.approx(now.row("yaw"), abs=1e-5)


def test_nothing_is_sought_where_no_loop_can_be_judged(fitted: st.Fitted) -> None:
    courses = step_courses(corridors_of(1.5), period_s=0.02)
    model = MarginModel(fitted, flown_log.RIG, period_s=0.02, voltage_v=16.0, draws=4)
    verdicts = tuple(AxisVerdict(loop, False, "", "") for loop in SOUGHT)
    cases = draw_cases(fitted, WANDER, 8, seed=1)
    found = tune_parameters(fitted, flown_log.RIG, courses, flown_log.GAINS, verdicts, model, cases=cases)
    assert not found.changes
    assert found.evaluations == 0


def test_a_faster_loop_rises_sooner(fitted: st.Fitted) -> None:
    slow, fast = (
        rise_of(fitted, flown_log.RIG, {**flown_log.GAINS, "ATC_ANG_YAW_P": p}, period_s=0.01)
        for p in (1.0, 5.0)
    )
    assert slow > fast
