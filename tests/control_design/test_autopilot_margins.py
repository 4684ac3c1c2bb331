"""Margins of an autopilot on a vehicle's model, held against gains that are moved and against flights."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

import seatrial as st
from seatrial.control_design.lqr import design_lqr
from seatrial.control_design.margin_report import MarginRow, autopilot_margins, sound_speeds
from seatrial.control_design.margins import small
from seatrial.control_design.tuning_table import ACCEPTED, LeastMargins
from tests.control_design.started import started

CWOLF = st.Vehicle.load("cwolf")
STARTER_FILE = str(Path(__file__).parents[2] / "examples" / "starter" / "vehicle.toml")
STARTER = st.Vehicle.load(STARTER_FILE)
LOOPS = {"hover": ("surge", "heave", "pitch", "heading"), "cruise": ("surge", "pitch", "heading")}
LEG = """
format = 1
name = "leg"
speed_m_s = {speed}
acceptance_radius_m = 4.0
[start]
depth_m = 5.0
[[legs]]
north_m = 80.0
east_m = 0.0
depth_m = 5.0
"""


def without_feed_forward() -> st.Autopilot:
    text = started("cwolf").to_toml()
    assert "restoring = true" in text
    return st.Autopilot.from_toml(text.replace("restoring = true", "restoring = false"))


def louder(autopilot: st.Autopilot, loop: str, factor: float) -> st.Autopilot:
    """The autopilot with all gains of a loop times a factor."""
    gains = {
        name: value * factor for name, value in autopilot.gains().items() if name.startswith(f"{loop}.K_")
    }
    assert gains
    return autopilot.with_gains(gains)


def grows(autopilot: st.Autopilot, speed: float) -> bool:
    (row,) = autopilot_margins(CWOLF, autopilot, speeds_m_s=[speed])
    return row.doubles_s is not None


@pytest.mark.parametrize("point", [2, 3, 4])
def test_law_beyond_the_gain_margin_a_motion_grows_and_within_it_none(point: int) -> None:
    autopilot = without_feed_forward()
    speed = autopilot.speeds_m_s[point]
    (row,) = autopilot_margins(CWOLF, autopilot, speeds_m_s=[speed])
    loops = LOOPS[row.mode]
    # 400 frequencies over three to four decades place a crossing within some per mille.
    assert not any(grows(louder(autopilot, loop, 0.98 * row.gain), speed) for loop in loops)
    assert any(grows(louder(autopilot, loop, 1.02 * row.gain), speed) for loop in loops)


def test_the_supporting_points_are_where_the_modes_of_the_file_work() -> None:
    autopilot = started("cwolf")
    rows = autopilot_margins(CWOLF, autopilot)
    assert [row.speed_m_s for row in rows] == list(autopilot.speeds_m_s)
    start = autopilot.modes[1]["from_speed_m_s"]
    assert {row.mode for row in rows if row.speed_m_s >= start} == {"cruise"}
    assert {row.mode for row in rows if row.speed_m_s < start} == {"hover"}


def test_law_margins_of_a_regulators_file_are_those_of_its_design() -> None:
    lauv = st.Vehicle.load("lauv")
    autopilot = started("lauv", "lqr")
    loops = tomllib.loads(autopilot.to_toml())["loops"]
    designed = design_lqr(
        lauv,
        autopilot.speeds_m_s,
        {"cruise": ["surge", "pitch", "heading"]},
        tau_max={name: loop["tau_max"] for name, loop in loops.items()},
    )["cruise"]
    assert len(designed.margins) == len(autopilot.speeds_m_s)
    for row, margin in zip(autopilot_margins(lauv, autopilot), designed.margins, strict=True):
        # The design counts quadratic damping over a larger motion: with LAUV's, a degree.
        assert row.phase_deg == pytest.approx(margin.phase_deg, abs=2.0)
        assert row.delay_s == pytest.approx(margin.delay_s, rel=0.1)


def test_an_undamped_roll_that_nothing_commands_does_not_count() -> None:
    assert STARTER.coefficients()["K_p"] == STARTER.coefficients()["K_pp"] == 0.0
    autopilot = started(STARTER_FILE)
    (row,) = autopilot_margins(STARTER, autopilot, speeds_m_s=[0.2])
    assert row.doubles_s is None


def test_law_flights_are_level_at_sound_speeds_and_pitch_up_beyond() -> None:
    autopilot = started(STARTER_FILE)
    between = sound_speeds(STARTER, autopilot)
    assert between is not None
    pitch = {}
    for speed in (0.8 * between[1], 1.5 * between[1]):
        mission = st.Mission.from_toml(LEG.format(speed=speed))
        flight = st.fly(STARTER, autopilot, mission, conditions=st.Conditions(sensors="typical"))
        pitch[speed] = flight.metrics["pitch_largest_deg"]
    within, beyond = pitch.values()
    assert within < 5.0
    assert beyond > 3.0 * within
    (row,) = autopilot_margins(STARTER, autopilot, speeds_m_s=[1.5 * between[1]])
    assert "pitch" in row.grows
    assert "x2 in" in row.verdict


def test_accepted_margins_are_the_default_limits_of_a_tuning() -> None:
    limits = LeastMargins()
    assert (limits.phase_deg, limits.gain_db) == (ACCEPTED.phase_deg, ACCEPTED.gain_db)
    gain = 10.0 ** (limits.gain_db / 20.0)
    assert gain == pytest.approx(2.0, rel=0.01)
    assert small(limits.phase_deg, limits.gain_db, ACCEPTED.sensitivity) == ()
    assert small(0.99 * limits.phase_deg, 0.99 * limits.gain_db, 1.01 * ACCEPTED.sensitivity) == (
        "phase",
        "gain",
        "sensitivity",
    )


@pytest.mark.parametrize("name", ["cwolf", "remus100", "lauv", "bluerov2-heavy", "beluga"])
def test_sound_loops_bear_twice_their_gain(name: str) -> None:
    vehicle, autopilot = st.Vehicle.load(name), st.Autopilot.load(name)
    rows = [row for row in autopilot_margins(vehicle, autopilot) if row.sound]
    assert rows
    # Loud by ten per cent less than twice: nothing grows yet.
    double = autopilot.with_gains({
        key: 1.8 * value for key, value in autopilot.gains().items() if ".K_" in key
    })
    for row, loud in zip(
        rows, autopilot_margins(vehicle, double, speeds_m_s=[row.speed_m_s for row in rows]), strict=True
    ):
        assert row.gain >= 1.99
        assert row.sensitivity <= 2.0
        assert loud.doubles_s is None


def test_verdicts() -> None:
    def row(phase: float, doubles: float | None, gain: float = 3.0, sensitivity: float = 1.5) -> MarginRow:
        return MarginRow(
            "hover", 1.0, phase, gain, 0.5, sensitivity, doubles, "pitch" if doubles else "", True
        )

    assert row(40.0, None).verdict == "sound"
    assert row(30.0, None, gain=2.0, sensitivity=2.0).sound
    assert row(29.0, None).verdict == "little margin: phase"
    # A loop that 30 % more gain makes unstable is not sound, whatever its phase.
    assert row(61.0, None, gain=1.3, sensitivity=4.3).verdict == "little margin: gain, sensitivity"
    assert not row(61.0, None, sensitivity=2.1).sound
    assert row(40.0, 2.0).verdict == "pitch: x2 in 2 s"
    assert not row(40.0, 2.0).sound
