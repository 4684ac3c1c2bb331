"""A hull that only its autopilot keeps straight."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

import seatrial as st
from seatrial.inspect.feedback import judged_s, runs_away
from seatrial.vehicle.stability import growth
from tests.trial import motion


def ahead(speed: float) -> st.Trial:
    table = motion.columns(np.arange(0.0, 20.0, 0.1))
    table["u_m_s"] = np.full(200, speed)
    return st.Trial.read(table, align=False)


def test_a_torpedo_that_yaws_away_is_told_with_speed_and_time() -> None:
    vehicle = st.Vehicle.load("remus100")
    said = runs_away(vehicle, [ahead(1.5)], "XYN")
    time = math.log(10.0) / growth(vehicle, 1.5, "course")
    assert re.search(
        rf"yaws off a straight course at 1\.5 m/s, and deviations grow tenfold in {time:.1f} s", said
    )


@pytest.mark.parametrize(
    ("name", "speed", "free", "segment_s"),
    [
        ("remus100", 1.5, "N", 20.0),  # sway held: no Munk moment acts
        ("remus100", 1.5, "YN", 4.0),  # a short segment stays near the log
        ("remus100", 0.0, "YN", 20.0),
        ("lauv", 1.5, "YNZM", 20.0),
        ("bluerov2-heavy", 0.2, "XYZN", 20.0),
    ],
)
def test_what_stays_near_its_course_for_a_segment_is_not(
    name: str, speed: float, free: str, segment_s: float
) -> None:
    assert runs_away(st.Vehicle.load(name), [ahead(speed)], free, segment_s) == ""


def test_what_runs_away_is_judged_until_a_disturbance_has_grown_tenfold() -> None:
    torpedo, stable = st.Vehicle.load("remus100"), st.Vehicle.load("lauv")
    trials = [ahead(1.5)]
    time = math.log(10.0) / growth(torpedo, 1.5, "course")
    assert judged_s([torpedo, stable], trials, "XYN", 10.0) == pytest.approx(time, abs=0.25)
    assert judged_s([stable], trials, "XYN", 10.0) == 10.0
    assert judged_s([torpedo], trials, "XN", 10.0) == 10.0
    assert judged_s([torpedo], trials, "XYN", 3.0) == 3.0  # grows by less than ten thousand
