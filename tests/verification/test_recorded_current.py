"""A current that a log does not tell: fitted to it, never taken for a changed vehicle."""

from __future__ import annotations

import re

import pytest

import seatrial as st
from seatrial.verification.mission_log.judge_log import verify_log
from seatrial.verification.mission_log.log import MissionLog
from seatrial.verification.mission_log.verdict import LogVerdict
from tests.verification.recorded_logs import MISSION, fitted, log

AHEAD = st.Mission.from_toml("""
format = 1
name = "ahead"
speed_m_s = 1.6
acceptance_radius_m = 5.0
[[legs]]
north_m = 200.0
east_m = 0.0
depth_m = 6.0
label = "out"
""")


def judged(mission: st.Mission, current: list[float], thrust: float = 1.0) -> LogVerdict:
    """Verdict on a log in a current that neither the log nor its water velocity tells."""
    base = st.Vehicle.load("cwolf")
    gains = {name: thrust * value for name, value in base.coefficients().items() if name.endswith(".gain")}
    flight = st.fly(
        base.with_coefficients(gains),
        "cwolf",
        mission,
        conditions=st.Conditions(sensors="typical", model=base),
        seed=5,
        water=st.Water(current=current),
    )
    table = flight.table()
    hidden = [name for name in table.columns if "current_" in name or "water_m_s" in name]
    return verify_log(
        fitted(),
        MissionLog.read(table.drop(hidden)),
        reference=log(100).trial,
        settings=st.LogSettings(draws=2048),
    )


@pytest.mark.long
def test_a_current_that_was_not_recorded_is_no_changed_vehicle() -> None:
    found = judged(MISSION, [0.2, 0.1, 0.0])
    assert found.model == "model still valid", found.summary()
    # The Doppler log is good to 8 mm/s and the headings of a box differ: a centimetre or two per second.
    assert found.current == pytest.approx((0.2, 0.1), abs=0.02)
    assert re.search(r"0\.2[1-4] m/s towards 2\d deg", found.reason)
    assert found.to_dict()["current_m_s"] == list(found.current or ())


@pytest.mark.long
def test_a_change_is_found_beside_a_current_that_was_not_recorded() -> None:
    found = judged(MISSION, [0.2, 0.1, 0.0], thrust=0.85)
    assert found.model == "re-identify"
    assert found.current is not None
    assert found.suspects[0].change.startswith(("all thrust -1", "thrust of the group stern -1"))


@pytest.mark.long
def test_on_one_heading_less_thrust_and_a_current_are_not_told_apart() -> None:
    found = judged(AHEAD, [0.0, 0.0, 0.0], thrust=0.85)
    assert found.outcome == "undecided", found.summary()
    assert "cannot tell a changed vehicle from the water" in found.reason
    assert found.power is not None
    thrust = next(one for one in found.power.tests if one.group.kind == "thrust of stern")
    assert not thrust.refuted
