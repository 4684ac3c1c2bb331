"""Tuning of ArduSub's parameters: margins of its loops, corridors over drawn missions."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import seatrial as st
from seatrial._core import ardusub_defaults, ardusub_terms
from seatrial.ardusub.axes import AMPLE, SOUGHT, AxisVerdict, MarginModel, Margins, axis_verdicts, loop_law
from seatrial.ardusub.course import Cases, Rig, fly_course
from seatrial.ardusub.tuning import (
    SIZES_DEG,
    STEPS,
    corridors_of,
    draw_cases,
    fly_missions,
    rise_of,
    slew_of,
    step_courses,
    tune_parameters,
)
from seatrial.identification.estimate import plausible_masses
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
    courses = step_courses(("yaw",), 1.5, period_s=0.01)
    model = MarginModel(fitted, flown_log.RIG, period_s=0.01, voltage_v=16.0, draws=8)
    verdicts = tuple(AxisVerdict(loop, loop == "yaw", "", "") for loop in SOUGHT)
    found = tune_parameters(
        model, courses, poor, verdicts, cases=draw_cases(fitted, WANDER, 8, seed=1), generations=5
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
    courses = step_courses(STEPS, 1.5, period_s=0.02)
    model = MarginModel(fitted, flown_log.RIG, period_s=0.02, voltage_v=16.0, draws=4)
    verdicts = tuple(AxisVerdict(loop, False, "", "") for loop in SOUGHT)
    cases = draw_cases(fitted, WANDER, 8, seed=1)
    found = tune_parameters(model, courses, flown_log.GAINS, verdicts, cases=cases)
    assert not found.changes
    assert found.evaluations == 0


def test_a_faster_loop_rises_sooner(fitted: st.Fitted) -> None:
    slow, fast = (
        rise_of(fitted, flown_log.RIG, {**flown_log.GAINS, "ATC_ANG_YAW_P": p}, period_s=0.01)
        for p in (1.0, 5.0)
    )
    assert slow > fast


def test_a_step_of_yaw_is_flown_at_the_slew_of_its_target(fitted: st.Fitted) -> None:
    """A target turns with ATC_RATE_WPY_MAX, so that half of it doubles the way to 90 % of 90 deg."""
    still = Rig(flown_log.RIG.frame, flown_log.RIG.direction, noise=(0.0, 0.0))
    course, (step,) = step_courses(("yaw",), 2.0, period_s=0.01)[SIZES_DEG.index(-90.0)]
    risen = {}
    for slew in (60.0, 30.0):
        own = {**flown_log.GAINS, "ATC_RATE_WPY_MAX": slew}
        flown = fly_course(fitted.vehicle, still, course, own, cases=Cases.of(1))[0]
        after = course.t >= step.at_s
        yaw = -np.degrees(np.unwrap(flown[after, 5]))
        risen[slew] = float(course.t[after][np.flatnonzero(yaw >= 81.0)[0]] - step.at_s)
        # No sooner than its target, which needs as long and then the time constant of the input.
        assert 81.0 / slew < risen[slew] < 81.0 / slew + 1.0, risen
    assert risen[30.0] - risen[60.0] == pytest.approx(81.0 / 30.0 - 81.0 / 60.0, abs=0.25)


def test_corridors_of_larger_steps_rise_later_by_the_way_of_their_target() -> None:
    def rises(size_deg: float, slew: float) -> float:
        since = np.arange(0.0, 11.0, 0.01)
        lower, _ = corridors_of(2.0, size_deg=size_deg, slew_deg_s=slew)["yaw"].sampled(since)
        return float(since[np.flatnonzero(lower >= 0.9)[0]])

    assert rises(60.0, 60.0) == pytest.approx(2.0, abs=0.02)
    assert rises(-90.0, 60.0) == pytest.approx(2.0 + 0.9 * 30.0 / 60.0, abs=0.02)
    assert rises(30.0, 60.0) == pytest.approx(2.0 - 0.9 * 30.0 / 60.0, abs=0.02)
    assert rises(-90.0, 30.0) == pytest.approx(2.0 + 0.9 * 30.0 / 30.0, abs=0.02)
    assert slew_of({"ATC_RATE_WPY_MAX": 60.0, "ATC_RATE_Y_MAX": 0.0}) == 60.0
    assert slew_of({"ATC_RATE_WPY_MAX": 60.0, "ATC_RATE_Y_MAX": 45.0}) == 45.0


def test_law_targets_of_depth_and_place_move_within_speed_and_acceleration() -> None:
    """Place is the integral of velocity, and velocity that of acceleration; short ways have no full speed."""
    period = 0.002
    for course, steps in step_courses(("depth", "north"), 2.0, period_s=period):
        t = period * np.arange(len(course.targets))
        for step in steps:
            column = {"depth": 6, "north": 4}[step.channel]
            place, velocity, acceleration = (course.targets[:, column + k] for k in (0, 3, 6))
            begins = {"depth": 5.0, "north": 0.0}[step.channel]
            assert place[-1] - begins == pytest.approx(step.size)
            assert np.abs(velocity).max() == pytest.approx(min(0.4, math.sqrt(abs(step.size))), abs=2e-3)
            assert np.abs(acceleration).max() == 1.0
            assert np.abs(np.diff(place) / period - velocity[1:]).max() < 3.0 * period
            jump = np.abs(np.diff(velocity) / period - acceleration[1:])
            assert np.sort(jump)[-8] < 1e-9 if len(jump) else False
            assert (place[t < step.at_s] == begins).all()


def _identified(start: st.Vehicle, freed: dict[str, float]) -> tuple[Any, st.Fitted]:
    """What `axis_verdicts` reads of an identification that ended at some coefficients."""
    coefficients = tuple(
        SimpleNamespace(name=name, start=start.coefficients()[name], estimate=value, at_bound=None)
        for name, value in freed.items()
    )
    found = SimpleNamespace(
        problem=SimpleNamespace(vehicle=start), coefficients=coefficients, held=(), scores={}, baselines={}
    )
    return found, st.Fitted.of(start.with_coefficients(freed), percent={})


def test_plausible_inertias_are_the_rigid_body_and_its_added_mass_between_its_bounds() -> None:
    """BlueROV2 Heavy: I_z 0.37, N_rdot -0.222 kg m2; inertia 0.3 to 3 times where it is searched too."""
    vehicle = st.Vehicle.load("bluerov2-heavy")
    assert plausible_masses(vehicle)["N"] == pytest.approx((0.37 + 0.2 * 0.222, 0.37 + 5.0 * 0.222))
    freed = plausible_masses(vehicle, {"I_z"})
    assert freed["N"] == pytest.approx((0.3 * 0.37 + 0.2 * 0.222, 3.0 * 0.37 + 5.0 * 0.222))
    assert freed["X"] == plausible_masses(vehicle)["X"]


@pytest.mark.parametrize(
    ("n_rdot", "judged"),
    [(-0.02, False), (-0.05, True), (-0.222, True), (-1.1, True), (-1.2, False), (-3.02, False)],
)
def test_an_inertia_beyond_the_bounds_of_the_vehicle_file_is_refused(n_rdot: float, judged: bool) -> None:
    """Apparent inertias of 0.41 to 1.48 kg m2 are plausible: too little is refused as too much is."""
    found, fitted = _identified(st.Vehicle.load("bluerov2-heavy"), {"N_rdot": n_rdot, "N_rr": -1.5})
    yaw = next(one for one in axis_verdicts(found, fitted, draws=4) if one.loop == "yaw")
    assert (yaw.judged, yaw.implausible) == (judged, not judged)
    if not judged:
        assert f"is {(0.37 - n_rdot) / 0.592:.2g} times the 0.59 of the vehicle file" in yaw.why
        assert f"N_rdot {n_rdot / -0.222:.3g} times its start" in yaw.why
        assert "pulses of 1 s at full stick from rest" in yaw.trial
    else:
        assert yaw.why.startswith("identified: apparent inertia")


def test_an_added_mass_that_hardly_counts_may_be_several_times_that_of_the_file() -> None:
    """Surge of a slender hull: eight times a small added mass is an apparent mass within 30 %."""
    start = st.Vehicle.load("remus100")
    before = start.coefficients()["X_udot"]
    found, fitted = _identified(start, {"X_udot": 8.0 * before, "Y_vdot": start.coefficients()["Y_vdot"]})
    assert not next(one for one in axis_verdicts(found, fitted, draws=4) if one.loop == "place").implausible
