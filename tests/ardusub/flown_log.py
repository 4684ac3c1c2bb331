"""A DataFlash log as text of a flight under ArduSub's cascade: gains and vehicle are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import seatrial as st
from seatrial._core import Vehicle, ardusub_pulses, ardusub_rates
from seatrial.ardusub.course import Cases, Course, Rig, fly_course, still_targets
from seatrial.base.arrays import Array
from seatrial.base.frames import from_euler, matrix
from tests.ardusub.text_log import rows_of_text

GAINS = {
    "ATC_ANG_RLL_P": 6.0, "ATC_ANG_PIT_P": 6.0, "ATC_ANG_YAW_P": 5.0, "ATC_RAT_YAW_P": 0.2,
    "PSC_D_POS_P": 1.5, "PSC_D_VEL_P": 6.0, "PSC_NE_POS_P": 1.2, "PSC_NE_VEL_P": 3.0, "PSC_NE_VEL_I": 0.4,
}  # fmt: skip

RIG = Rig("Vectored_6DOF", (-1,) * 8)
"""With it the built-in vehicle pushes where its frame is told."""

PERIOD_S = 0.005

_COLUMNS = {
    "ANG": "DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,Dt",
    "RATE": "RDes,R,ROut,PDes,P,POut,YDes,Y,YOut,ADes,A,AOut",
    "PIDR": "Tar,Act,Err,P,I,D,FF",
    "PIDP": "Tar,Act,Err,P,I,D,FF",
    "PIDY": "Tar,Act,Err,P,I,D,FF",
    "PIDA": "Tar,Act,Err,P,I,D,FF",
    "PSCD": "TPD,PD,DVD,TVD,VD,DAD,TAD",
    "PSCN": "TPN,PN,DVN,TVN,VN,DAN,TAN",
    "PSCE": "TPE,PE,DVE,TVE,VE,DAE,TAE",
    "CTUN": "ThI,ThH",
    "XKF1": "VN,VE,VD",
    "RCIN": "C5,C6",
    "RCOU": "C1,C2,C3,C4,C5,C6,C7,C8",
    "BAT": "Volt",
}


def vehicle() -> Vehicle:
    """The built-in vehicle whose frame is that of `RIG`."""
    return st.Vehicle.load("bluerov2-heavy")


def course(seconds: float = 60.0) -> Course:
    """Yaw that ramps there and back, a depth and a place that move."""
    n = round(seconds / PERIOD_S)
    t: Array = np.asarray(PERIOD_S * np.arange(n), float)
    targets = still_targets(n)
    targets[:, 19] = 0.0  # these are targets, as a log has them
    rate = np.where((t > 8.0) & (t < 10.0), 0.4, 0.0) - np.where((t > 25.0) & (t < 29.0), 0.4, 0.0)
    targets[:, 2], targets[:, 3] = np.cumsum(rate) * PERIOD_S, rate
    for column, speed, from_s, to_s in ((6, 0.1, 14.0, 19.0), (4, 0.3, 33.0, 38.0), (5, -0.2, 42.0, 47.0)):
        moving = np.where((t > from_s) & (t < to_s), speed, 0.0)
        targets[:, column] += np.cumsum(moving) * PERIOD_S
        targets[:, column + 3] = moving
    return Course(
        "made", t[::20], targets, PERIOD_S, np.array([0.0, 0.0, 5.0]), np.zeros(3), np.zeros(6), np.zeros(7)
    )


def flown(made: Course, *, seed: int = 1, wander: float = 0.0) -> Array:
    """Rows (n, 20) of one flight."""
    still = Rig(RIG.frame, RIG.direction, noise=(0.0, 0.0))
    size = wander * np.array([2.0, 2.0, 2.0, 0.1, 0.1, 0.1])
    return np.asarray(fly_course(vehicle(), still, made, GAINS, cases=Cases.of(1, seed=seed, wander=size))[0])


def write(path: Path, made: Course, rows: Array) -> Path:
    """Write the log of a flight; it names no mode."""
    wanted, t = made.targets[::20], made.t
    zero, one = np.zeros(len(t)), np.ones(len(t))
    euler, gyro = rows[:, 3:6], rows[:, 9:12]
    ground = np.einsum("nij,nj->ni", matrix(from_euler(euler)), rows[:, 6:9])
    turning = np.stack([zero, zero, wanted[:, 3]], 1)
    p = [GAINS["ATC_ANG_RLL_P"], GAINS["ATC_ANG_PIT_P"], GAINS["ATC_ANG_YAW_P"]]
    most = np.radians([1100.0] * 3)
    rates = np.asarray(ardusub_rates(wanted[:, :3], euler, turning, gyro, p, most, PERIOD_S))
    demands = rows[:, 12:18]
    throttle = 0.5 * demands[:, 3] + 0.5
    pulses = np.asarray(ardusub_pulses(RIG.frame, demands, np.array(RIG.direction, float)))
    position = {"N": (4, 0, "PSC_NE_POS_P"), "E": (5, 1, "PSC_NE_POS_P"), "D": (6, 2, "PSC_D_POS_P")}
    topics = {
        "ANG": [x for k in range(3) for x in (np.degrees(wanted[:, k]), np.degrees(euler[:, k]))]
        + [0.005 * one],
        "RATE": [
            x for k in range(3) for x in (np.degrees(rates[:, k]), np.degrees(gyro[:, k]), demands[:, k])
        ]
        + [zero, zero, throttle],
        "PIDA": [zero] * 7,
        "CTUN": [throttle, 0.5 * one],
        "XKF1": [ground[:, k] for k in range(3)],
        "RCIN": [1500.0 * one] * 2,
        "RCOU": [pulses[:, k] for k in range(8)],
        "BAT": [16.0 * one],
    }
    for k, letter in enumerate("RPY"):
        error = rates[:, k] - gyro[:, k]
        topics[f"PID{letter}"] = [rates[:, k], gyro[:, k], error, 0.2 * error, zero, zero, zero]
    for letter, (target, own, gain) in position.items():
        velocity = GAINS[gain] * (wanted[:, target] - rows[:, own]) + wanted[:, target + 3]
        topics[f"PSC{letter}"] = [
            wanted[:, target], rows[:, own], wanted[:, target + 3], velocity, ground[:, own], zero, zero,
        ]  # fmt: skip
    lines = [line for name, columns in topics.items() for line in rows_of_text(name, t + 1.0, *columns)]
    forms = [
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
        *(
            f"FMT, {140 + k}, {11 + 4 * (columns.count(',') + 1)}, {name}, Q{'f' * (columns.count(',') + 1)},"
            f" TimeUS,{columns}"
            for k, (name, columns) in enumerate(_COLUMNS.items())
        ),
    ]
    path.write_text("\n".join([*forms, *(line for _, line in sorted(lines))]) + "\n")
    return path
