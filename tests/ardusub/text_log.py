"""A DataFlash log as text of a vehicle with the Vectored frame, computed here row by row.

The controllers run 200 times a second, the log has every twentieth of their rows, as on the vehicle. Angles
stay so small that the angle controllers are those of three axes by themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter

from seatrial.base.arrays import Array

GAINS = {"RLL": (0.11, 0.08), "PIT": (0.13, 0.05), "YAW": (0.22, 0.03)}
"""P and I of the rate controllers."""

ANGLE_P = {"RLL": 5.0, "PIT": 5.5, "YAW": 4.5}

DIRECTION = (1, 1, -1, -1, 1, -1)

SHARES = np.array([
    [0.0, 0.0, 1.0, 0.0, -1.0, 1.0],
    [0.0, 0.0, -1.0, 0.0, -1.0, -1.0],
    [0.0, 0.0, -1.0, 0.0, 1.0, 1.0],
    [0.0, 0.0, 1.0, 0.0, 1.0, -1.0],
    [1.0, 0.0, 0.0, -1.0, 0.0, 0.0],
    [-1.0, 0.0, 0.0, -1.0, 0.0, 0.0],
])
"""Roll, pitch, yaw, throttle, forward, lateral of the motors of ArduSub's Vectored frame."""

Topics = dict[str, dict[str, Array]]
"""Columns of every topic, with the times as ``t``."""

_EVERY = 20

_DT = 0.005


def write(
    path: Path,
    *,
    minutes: float = 4.0,
    p_term: float = 1.0,
    frame_noise_us: float = 0.0,
    modes: Sequence[tuple[float, int]] = (),
    edit: Callable[[Topics], None] = lambda topics: None,
    parameters: Mapping[str, float] | None = None,
) -> Path:
    """Write the log.

    `p_term` scales what is logged as P term of the yaw controller on the second half, `frame_noise_us` adds
    noise to the pulses. `modes` are times and numbers of the modes of flight, `edit` changes the topics
    before they are written, `parameters` are those that the log itself has.
    """
    n = round(60.0 * minutes / _DT)
    t, draw = np.arange(n) * _DT, np.random.default_rng(7)
    rows = slice(_EVERY - 1, None, _EVERY)
    topics: Topics = {}
    wanted, angles, outputs = {}, {}, {}
    for axis, (name, (p, i)) in enumerate(GAINS.items()):
        target = np.where(np.arange(n) // round(8.0 / _DT) % 2, 3.0, 0.0) * (axis == 2)
        angle = _followed(target) + 0.3 * np.sin(0.9 * t + axis) * np.sin(0.11 * t)
        angles[name] = (target, angle)
        wanted[name] = ANGLE_P[name] * (target - angle)
        gyro = np.gradient(angle, _DT) + 0.05 * draw.standard_normal(n)
        error = np.radians(wanted[name] - gyro)
        integral = np.cumsum(i * error * _DT)
        logged = p * error * np.where(t > 0.5 * t[-1], p_term if name == "YAW" else 1.0, 1.0)
        outputs[name] = p * error + integral
        columns = (np.radians(wanted[name]), np.radians(gyro), error, logged, integral, 0.0 * t, 0.0 * t)
        topics[f"PID{'RPY'[axis]}"] = _columns(f"PID{'RPY'[axis]}", t[rows], [one[rows] for one in columns])
        wanted[f"{name} gyro"] = gyro
    throttle = 0.5 + 0.1 * np.sin(0.3 * t)
    forward, lateral = (np.round(100.0 * np.sin(k * t)) / 400.0 for k in (0.21, 0.13))
    demands = np.stack([*outputs.values(), 2.0 * throttle - 1.0, forward, lateral], 1)
    pulses = pulses_of(demands)[rows]
    pulses += frame_noise_us * draw.standard_normal(pulses.shape)
    rates = [
        one[rows]
        for name in GAINS
        for one in (wanted[name], wanted[f"{name} gyro"], outputs[name])
    ]  # fmt: skip
    still = np.zeros(len(t[rows]))
    topics["ANG"] = _columns("ANG", t[rows], [one[rows] for pair in angles.values() for one in pair])
    topics["RATE"] = _columns("RATE", t[rows], [*rates, still, still, throttle[rows]])
    topics["RCOU"] = _columns("RCOU", t[rows], list(pulses.T))
    sticks = [1500.0 + still] * 4 + [1500.0 + 400.0 * forward[rows], 1500.0 + 400.0 * lateral[rows]]
    topics["RCIN"] = _columns("RCIN", t[rows], sticks)
    if modes:
        times, numbers = (np.array(column, float) for column in zip(*modes, strict=True))
        topics["MODE"] = {"t": times, "Mode": numbers}
    edit(topics)
    lines = [
        line
        for name, own in topics.items()
        for line in rows_of_text(name, own["t"], *(column for key, column in own.items() if key != "t"))
    ]
    lines.sort(key=lambda one: one[0])
    head = [_form(k, name, own) for k, (name, own) in enumerate(topics.items())]
    head += [f"PARM, 1, {name}, {value:g}" for name, value in (parameters or {}).items()]
    path.write_text("\n".join([*_FORMS, *head, *(line for _, line in lines)]) + "\n")
    return path


def pulses_of(demands: Array) -> Array:
    """Pulses (n, 6), us, of demands (n, 6), as the frame has them below its limits."""
    return np.asarray(np.floor(1500.0 + 400.0 * np.clip(demands @ SHARES.T, -1.0, 1.0) * DIRECTION))


def demands_of(topics: Topics) -> Array:
    """Demands (n, 6) of the rows of a log whose forward and lateral are the sticks."""
    rate, sticks = topics["RATE"], topics["RCIN"]
    own = [rate["ROut"], rate["POut"], rate["YOut"], 2.0 * rate["AOut"] - 1.0]
    return np.stack([*own, *(sticks[name] / 400.0 - 3.75 for name in ("C5", "C6"))], 1)


_COLUMNS = {
    "PIDR": "Tar,Act,Err,P,I,D,FF",
    "PIDP": "Tar,Act,Err,P,I,D,FF",
    "PIDY": "Tar,Act,Err,P,I,D,FF",
    "ANG": "DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw",
    "RATE": "RDes,R,ROut,PDes,P,POut,YDes,Y,YOut,ADes,A,AOut",
    "RCOU": "C1,C2,C3,C4,C5,C6",
    "RCIN": "C1,C2,C3,C4,C5,C6",
}

_FORMS = [
    "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
    "FMT, 129, 31, PARM, QNf, TimeUS,Name,Value",
]


def _columns(topic: str, t: Any, values: Sequence[Any]) -> dict[str, Array]:
    names = ("t", *_COLUMNS[topic].split(","))
    return {name: np.array(column, float) for name, column in zip(names, (t, *values), strict=True)}


def _form(number: int, name: str, columns: Mapping[str, Array]) -> str:
    """Format message of a topic."""
    names = [key for key in columns if key != "t"]
    return (
        f"FMT, {140 + number}, {11 + 4 * len(names)}, {name}, Q{'f' * len(names)}, TimeUS,{','.join(names)}"
    )


def _followed(target: Any) -> Array:
    """A target as a vehicle follows it, with a time constant of a second."""
    return np.asarray(lfilter([_DT], [1.0, _DT - 1.0], target))


def rows_of_text(topic: str, t: Any, *columns: Any) -> list[tuple[float, str]]:
    """Time and text of each row of a topic."""
    return [
        (stamp, f"{topic}, {round(stamp * 1e6)}, " + ", ".join(f"{value:.9g}" for value in values))
        for stamp, *values in zip(t.tolist(), *(column.tolist() for column in columns), strict=True)
    ]
