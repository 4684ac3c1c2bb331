"""Flights under ArduSub's cascade along courses of logs: made from a known vehicle, and recorded."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seatrial as st
from seatrial import TrialError
from seatrial.ardusub.course import Cases, Course, Rig, fly_course, logged_courses
from seatrial.ardusub.reflight import refly
from seatrial.base.arrays import Array
from seatrial.logs.log import open_log
from tests.ardusub import flown_log

pytest.importorskip("pymavlink")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = flown_log.course(45.0)
    rows = flown_log.flown(made, wander=1.0)
    return flown_log.write(tmp_path_factory.mktemp("flown") / "flown.log", made, rows)


@pytest.fixture(scope="module")
def course(log: Path) -> Course:
    (found,) = logged_courses(open_log(log), flown_log.GAINS)
    return found


def test_a_flight_that_was_logged_is_flown_again(tmp_path: Path) -> None:
    """Without wander and noise the errors of the flight come back from ten rows a second."""
    made = flown_log.course(30.0)
    path = flown_log.write(tmp_path / "still.log", made, flown_log.flown(made))
    (course,) = logged_courses(open_log(path), flown_log.GAINS)
    assert course.channels == ("roll", "pitch", "yaw", "depth", "north", "east")
    still = Rig(flown_log.RIG.frame, flown_log.RIG.direction, noise=(0.0, 0.0))
    rows = fly_course(flown_log.vehicle(), still, course, flown_log.GAINS, cases=Cases.of(1))
    for channel, errors in course.errors(rows).items():
        size = np.sqrt(np.mean(course.measured[channel] ** 2))
        left = np.sqrt(np.mean((errors[0] - course.measured[channel]) ** 2))
        assert left < 0.25 * size + 0.02, f"{channel}: {left} of {size}"


@pytest.mark.long
def test_the_envelope_of_drawn_vehicles_holds_the_log(course: Course) -> None:
    fitted = st.Fitted.of(flown_log.vehicle(), percent={"N_rdot": 20.0, "Z_wdot": 20.0, "X_udot": 20.0})
    found = refly(
        fitted, flown_log.RIG, [course], flown_log.GAINS, hold_out_s=(31.0, 46.0), flights=32, seed=3
    )  # fmt: skip
    assert {one.channel for one in found.shares} == set(course.channels)
    assert all(one.rows > 100 for one in found.shares)
    yaw, depth = found.share("yaw"), found.share("depth")
    assert yaw is not None
    assert yaw.inside
    assert depth is not None
    assert depth.inside
    # An envelope that holds everything tells nothing: it is of the errors' own size.
    assert all(one.width < 12.0 * one.rms for one in found.shares)


def test_a_vehicle_with_another_inertia_leaves_the_envelope(course: Course) -> None:
    """A sceptic's check: a vehicle five times as hard to turn does not turn as the log did."""
    heavy = flown_log.vehicle().with_coefficients({"N_rdot": -3.0})
    rows = fly_course(heavy, flown_log.RIG, course, flown_log.GAINS, cases=Cases.of(8))
    own = fly_course(flown_log.vehicle(), flown_log.RIG, course, flown_log.GAINS, cases=Cases.of(8))
    miss = [np.std(course.errors(one)["yaw"].mean(axis=0) - course.measured["yaw"]) for one in (rows, own)]
    assert miss[0] > 1.5 * miss[1], miss


def test_cases_do_not_depend_on_their_neighbours(course: Course) -> None:
    wander = np.array([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])
    cases = Cases.of(10, coefficients={"N_rdot": -np.linspace(0.1, 0.6, 10)}, wander=wander)
    p = np.linspace(0.1, 0.3, 10)

    def rows(which: Any) -> Array:
        gains: dict[str, Any] = {**flown_log.GAINS, "ATC_RAT_YAW_P": p[which]}
        return fly_course(flown_log.vehicle(), flown_log.RIG, course, gains, cases=cases.take(which))

    part = np.arange(8, 10)
    whole, some = rows(np.arange(10)), rows(part)
    assert np.array_equal(whole[part], some)
    assert not np.array_equal(whole[0], whole[1])


def test_what_cannot_be_flown_is_refused(course: Course, tmp_path: Path) -> None:
    with pytest.raises(TrialError, match="ATC_RAT_YAW_Q: expected a parameter of ArduSub's controllers"):
        fly_course(flown_log.vehicle(), flown_log.RIG, course, {"ATC_RAT_YAW_Q": 1.0}, cases=Cases.of(1))
    with pytest.raises(st.SimulationError, match="expected the 6 motors of Vectored, found 8"):
        fly_course(flown_log.vehicle(), Rig("Vectored", (1,) * 6), course, {}, cases=Cases.of(1))
    bare = tmp_path / "bare.log"
    bare.write_text(
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nFMT, 140, 15, BAT, Qf, TimeUS,Volt\n"
    )
    with pytest.raises(TrialError, match="ANG, RATE, XKF1, CTUN"):
        logged_courses(open_log(bare), {})
