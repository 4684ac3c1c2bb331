"""The linear-quadratic design: margins behind lag and dead time, loads removed, honest refusals."""

from __future__ import annotations

import tomllib
from functools import cache

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

import seatrial as st
from seatrial._core import Vehicle
from seatrial.control_design.loops import Plant, closed, plant, restoring_law, sampled, step_response, trim
from seatrial.control_design.lqr import SETTINGS, Tolerances, _gain, design_lqr, lqr_autopilot, lqr_tables
from seatrial.control_design.margins import least_margins
from seatrial.control_design.start_gains import start_gains
from seatrial.vehicle.actuators import LOOPS, ROWS, Delay, delays
from tests.docs.pages import ROOT
from tests.flight.acceptance import AUTOPILOTS, RADIUS_M, flights


@pytest.mark.long
@pytest.mark.parametrize("name", ["cwolf", "remus100", "lauv", "bluerov2-heavy", "beluga"])
def test_law_every_gain_has_its_margins_behind_lag_and_dead_time(name: str) -> None:
    vehicle = Vehicle.load(name)
    start = start_gains(vehicle)
    limits = {loop: values.tau_max for loop, values in start.loops.items()}
    modes = {mode.name: mode.loops for mode in start.modes}
    speeds = [u for u in start.speeds_m_s if u > -0.2]
    for mode, gains in design_lqr(vehicle, speeds, modes, tau_max=limits).items():
        rows = "".join(ROWS[LOOPS.index(loop)] for loop in gains.loops)
        for k, speed in enumerate(speeds):
            reached = gains.margins[k]
            assert reached.stable
            if gains.borrowed[k]:
                # REMUS turns about by itself faster than its fins can answer with the margin.
                assert name == "remus100"
                assert speed > 1.85
                continue
            assert reached.phase_deg >= SETTINGS.margin_targets[-1][0]
            assert reached.sensitivity <= SETTINGS.margin_targets[-1][1]
            at = trim(vehicle, speed, rows)
            if at is None:
                assert not gains.trimmed[k]
                continue
            # Again, on a plant that is sampled twice as fast as the law was designed for and read out anew.
            late = delays(vehicle, rows)
            system = sampled(
                plant(vehicle, at, gains.loops, motion=SETTINGS.design_motion_m_s), late, 0.05, gains.loops
            )
            law = gains.gain[k] + restoring_law(vehicle, rows)
            assert np.abs(np.linalg.eigvals(closed(system, law))).max() < 1.0, f"{mode} at {speed}"
            assert least_margins(system, law).phase_deg > reached.phase_deg - 3.0


def test_law_rows_and_states_of_other_loops_have_no_gain() -> None:
    gain = design_lqr(Vehicle.load("cwolf"), [1.0, 2.0], {"cruise": ["surge", "pitch", "heading"]})[
        "cruise"
    ].gain
    assert gain.shape == (2, 6, 15)
    assert not gain[:, [1, 2, 3]].any()  # rows Y Z K
    assert not gain[:, :, [0, 11, 12]].any()  # depth and the integrals of sway and depth
    assert np.all(gain[:, [0, 4, 5], [4, 2, 3]] > 0.0)  # every row acts against its own error


def test_law_integrals_remove_a_constant_load() -> None:
    vehicle = Vehicle.load("cwolf")
    loops = ("surge", "heave", "pitch", "heading")
    gains = design_lqr(vehicle, [0.5], {"hover": loops}, restoring=False)["hover"].gain[0]
    at = trim(vehicle, 0.5, "XZMN")
    assert at is not None
    system = sampled(plant(vehicle, at, loops), delays(vehicle, "XZMN"), 0.1, loops)
    step, load = closed(system, gains), system.gamma @ np.array([10.0, 5.0, 2.0, 2.0])
    x = np.linalg.solve(np.eye(len(step)) - step, load)
    shown = {
        name: x[system.seen[system.columns.index(k)]]
        for k, name in ((0, "z"), (2, "pitch"), (3, "heading"), (4, "u"))
    }
    assert max(map(abs, shown.values())) < 1e-9
    answer = step_response(system, gains, "heave", 120.0)
    assert answer.max() < 1.3
    assert answer[-1] == pytest.approx(1.0, abs=0.02)


def test_lit_anderson_moore_without_lag_it_is_the_regulator() -> None:
    """A double integrator sampled fast, without lag: the gain of the Riccati equation."""
    quick = sampled(
        Plant(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]]), (3, 9), "N"),
        {"N": Delay(0.0, 0.0, 0.0)},
        0.001,
        (),
    )
    tolerances = Tolerances(heading_deg=np.rad2deg(0.5), rate_deg_s=np.rad2deg(1.0))
    gain = _gain(quick, tolerances, np.array([2.0]))
    a, b = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    p = solve_continuous_are(a, b, np.diag([4.0, 1.0]), np.array([[0.25]]))
    # The first is 2 over 0.5; sampling at 1 ms changes them by about its ratio to the loop's 0.5 s.
    assert gain[5, [3, 9]] == pytest.approx((4.0 * b.T @ p)[0], rel=1e-2)
    assert gain[5, 3] == pytest.approx(4.0, rel=1e-2)


def test_a_later_actuator_gets_a_slower_loop() -> None:
    vehicle = Vehicle.load("cwolf")
    late = vehicle.with_coefficients({f"{name}.T_t": 0.6 for name in vehicle.actuators})
    modes = {"cruise": ["surge", "pitch", "heading"]}
    quick, slow = (
        design_lqr(v, [1.5], modes, tau_max=dict.fromkeys(modes["cruise"], 60.0))["cruise"]
        for v in (vehicle, late)
    )
    assert slow.gain[0, 5, 3] < quick.gain[0, 5, 3]
    assert slow.margins[0].phase_deg >= 40.0
    # The quick gain on the late vehicle would not have kept the margin.
    at = trim(late, 1.5, "XMN")
    assert at is not None
    loops = quick.loops
    system = sampled(plant(late, at, loops), delays(late, "XMN"), 0.1, loops)
    assert (
        least_margins(system, quick.gain[0] + restoring_law(late, "XMN")).phase_deg
        < slow.margins[0].phase_deg
    )


def test_a_speed_that_no_gain_holds_borrows_the_nearest_and_says_so() -> None:
    """Astern at 2.3 m/s CWolf's hull turns about faster than its thrusters answer."""
    gains = design_lqr(
        Vehicle.load("cwolf"), [-2.33, 0.5], {"hover": ["surge", "heave", "pitch", "heading"]}
    )["hover"]
    assert gains.borrowed == (True, False)
    assert np.array_equal(gains.gain[0], gains.gain[1])
    assert not gains.margins[0].stable
    assert gains.margins[1].phase_deg >= 40.0


def test_tables_are_those_of_the_autopilot_file() -> None:
    gains = design_lqr(Vehicle.load("lauv"), [1.0, 1.5], {"cruise": ["surge", "pitch", "heading"]})
    (table,) = lqr_tables(gains)
    assert table["mode"] == "cruise"
    assert np.array(table["gain"]) == pytest.approx(gains["cruise"].gain, rel=1e-4)


@cache
def regulated(name: str) -> str:
    text = (AUTOPILOTS / f"{name}.toml").read_text()
    return lqr_autopilot(Vehicle.load(name), text)


def test_a_file_with_the_regulator_keeps_all_but_the_law() -> None:
    text, plain = regulated("cwolf"), (AUTOPILOTS / "cwolf.toml").read_text()
    made, given = tomllib.loads(text), tomllib.loads(plain)
    assert made["control"] == "lqr"
    assert [table["mode"] for table in made.pop("lqr")] == ["hover", "cruise"]
    assert made | {"control": "pid"} == given
    assert "[C] 2 U tau" in text  # comments stay
    added = lqr_autopilot(Vehicle.load("lauv"), lauv_without_law())
    assert st.Autopilot.from_toml(added).name == "lauv"
    with pytest.raises(ValueError, match=r"without gains of a regulator, found some; remove \[\[lqr\]\]"):
        lqr_autopilot(Vehicle.load("cwolf"), text)


def lauv_without_law() -> str:
    return (AUTOPILOTS / "lauv.toml").read_text().replace('control = "pid"\n', "")


def test_law_where_heave_is_held_the_gain_of_w_is_one_of_the_rate_of_depth() -> None:
    """K_w w = K_w (z' + u pitch): the same demand for the same motion."""
    modes = {"cruise": ("surge", "heave", "roll", "pitch", "heading")}
    gains = design_lqr(Vehicle.load("beluga"), [0.6], modes)
    told = np.array(lqr_tables(gains)[0]["gain"])[0]
    motion = np.zeros(15)
    motion[[2, 6]] = 0.1, 0.07
    seen = motion.copy()
    seen[6] = 0.07 - 0.6 * 0.1
    # Five digits are written.
    assert told @ seen == pytest.approx(gains["cruise"].gain[0] @ motion, rel=1e-3, abs=1e-4)


def test_law_a_drift_over_ground_is_fed_back_only_where_sway_is_held() -> None:
    for name, fed_back in (("cwolf", False), ("lauv", False), ("bluerov2-heavy", True)):
        gains = np.array(tomllib.loads(regulated(name))["lqr"][-1]["gain"])
        sway_of_hover = np.array(tomllib.loads(regulated(name))["lqr"][0]["gain"])[:, :, 5]
        assert bool(sway_of_hover.any()) == fed_back
        # In a rolled turn a current across shows in w, too; where the depth is held, w is its rate.
        assert bool(gains[:, :, 6].any()) == fed_back


@pytest.mark.parametrize("sensors", [None, "typical"])
@pytest.mark.parametrize(
    ("name", "speed"), [("cwolf", 1.5), ("remus100", 1.6), ("lauv", 1.2), ("bluerov2-heavy", 0.45)]
)
def test_the_regulator_flies_the_missions_of_the_pid(name: str, speed: float, sensors: str | None) -> None:
    for flown in flights(name, speed, sensors=sensors, text=regulated(name)):
        assert flown.outcome == "complete"
        assert flown.missed_by <= RADIUS_M[name]
        assert flown.cross_track < 0.5
        assert flown.vertical < 0.5
        assert flown.overshoot_percent < 5.0
        assert flown.starts_and_stops == 0.0


def test_bad_input_is_refused_with_what_to_do() -> None:
    vehicle = Vehicle.load("remus100")
    with pytest.raises(
        ValueError, match=r"modes\['cruise'\]: expected names among surge, .*found \['serge'\]"
    ):
        design_lqr(vehicle, [1.5], {"cruise": ["serge"]})
    with pytest.raises(ValueError, match="expected a largest demand for heading, found none"):
        design_lqr(vehicle, [1.5], {"cruise": ["surge", "heading"]}, tau_max={"surge": 8.0})
    with pytest.raises(ValueError, match="expected rows with a reach, found M, N without"):
        design_lqr(vehicle, [0.0], {"cruise": ["surge", "pitch", "heading"]})


def test_the_regulator_tracks_short_and_curved_legs_better() -> None:
    """CWolf about the net and up and down the lawn: docs/theory/lqr.md has 0.49 and 0.21, 0.76 and 0.38 m."""
    pid = st.Autopilot.load("cwolf")
    regulator = st.Autopilot.from_toml(lqr_autopilot(st.Vehicle.load("cwolf"), pid.to_toml()))
    for mission in ("cage_survey.toml", "lawnmower.toml"):
        path = ROOT / "examples" / "missions" / mission
        rms = [
            np.median(flights.figures["cross_track_rms"])
            for flights in (
                st.fly_batch("cwolf", law, path, seeds=[0, 1, 2], conditions=st.Conditions(sensors="typical"))
                for law in (pid, regulator)
            )
        ]
        assert rms[1] < 0.7 * rms[0], (mission, rms)
