"""Generated logs of closed-loop missions for the tests of recorded missions."""

from __future__ import annotations

from functools import cache

import seatrial as st
from seatrial.identification.fitted import Fitted
from seatrial.verification.mission_log.judge_log import verify_log
from seatrial.verification.mission_log.log import MissionLog
from seatrial.verification.mission_log.verdict import LogVerdict

MISSION = st.Mission.from_toml("""
format = 1
name = "box"
speed_m_s = 1.6
acceptance_radius_m = 5.0
[[legs]]
north_m = 80.0
east_m = 0.0
depth_m = 6.0
label = "dive"
[[legs]]
north_m = 80.0
east_m = 60.0
depth_m = 6.0
label = "across"
[[legs]]
north_m = 0.0
east_m = 60.0
depth_m = 3.0
label = "back"
""")

PERCENT = {
    "X_uu": 3.0, "X_u": 10.0, "Z_ww": 5.0, "Y_vv": 5.0, "N_rr": 5.0, "M_qq": 5.0, "N_rdot": 3.0,
    "Y_vdot": 3.0, "Z_wdot": 3.0, "M_uw": 3.0, "N_uv": 3.0, "B": 0.02,
}  # fmt: skip


@cache
def fitted() -> Fitted:
    """CWolf as a fit would leave it: the truth, known to some percent."""
    return Fitted.of("cwolf", percent=PERCENT)


@cache
def flight(seed: int, changes: tuple[tuple[str, float], ...] = ()) -> st.Flight:
    """A flight of a changed CWolf under the unchanged autopilot, with typical sensors."""
    base = st.Vehicle.load("cwolf")
    vehicle = base.with_coefficients(dict(changes)) if changes else base
    return st.fly(
        vehicle, "cwolf", MISSION, conditions=st.Conditions(sensors="typical", model=base), seed=seed
    )


@cache
def log(seed: int, changes: tuple[tuple[str, float], ...] = ()) -> MissionLog:
    """What the flight's sensors told."""
    return MissionLog.read(flight(seed, changes).table(), name=f"seed {seed}")


@cache
def compared(seed: int, changes: tuple[tuple[str, float], ...] = ()) -> LogVerdict:
    """Verdict on a log, held against one of the vehicle that the model is."""
    return verify_log(fitted(), log(seed, changes), reference=log(100).trial)
