"""Missions that the built-in autopilots must fly, and what is read off their logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import seatrial as st
from seatrial._core import Flights, Vehicle

Array = NDArray[np.float64]

AUTOPILOTS = Path(__file__).parents[2] / "crates" / "seatrial" / "autopilots"
VOLTAGE = {"bluerov2-heavy": 14.8, "beluga": 14.8}
CURRENTS = ((0.3, 0.0, 0.0), (-0.3, 0.0, 0.0), (0.0, 0.3, 0.0), (0.0, -0.3, 0.0))
"""0.3 m/s from all four sides, m/s: of the four legs two have it across, one ahead, one astern."""

LEG_M = {"cwolf": 300.0, "remus100": 300.0, "lauv": 250.0, "bluerov2-heavy": 60.0, "beluga": 80.0}
DEPTH_M = {"cwolf": 10.0, "remus100": 10.0, "lauv": 10.0, "bluerov2-heavy": 6.0, "beluga": 5.0}
RADIUS_M = {"cwolf": 5.0, "remus100": 8.0, "lauv": 8.0, "bluerov2-heavy": 1.0, "beluga": 1.0}
STEADY = 1.0 / 3.0
"""Errors are steady on this last part of a leg: by then the integral has had five time constants.

It is critically damped at U/(2 Delta), so that five are ten lookahead distances of way.
"""


def autopilot(name: str, method: str = "integral") -> st.Autopilot:
    """A built-in autopilot, as its file stands, with a method of guidance."""
    text = (AUTOPILOTS / f"{name}.toml").read_text()
    assert 'method = "integral"' in text
    return st.Autopilot.from_toml(text.replace('method = "integral"', f'method = "{method}"'), name)


def mission(name: str, speed_m_s: float, *, longest_s: float = 4000.0) -> st.Mission:
    """A square: down by 70 % of the depth, level, up by half of it, level."""
    leg, depth = LEG_M[name], DEPTH_M[name]
    corners = ((leg, 0.0, depth), (leg, leg, depth), (0.0, leg, 0.5 * depth), (0.0, 0.0, 0.5 * depth))
    legs = "".join(f"[[legs]]\nnorth_m = {n}\neast_m = {e}\ndepth_m = {z}\n" for n, e, z in corners)
    return st.Mission.from_toml(
        f'format = 1\nname = "square"\nspeed_m_s = {speed_m_s}\nacceptance_radius_m = {RADIUS_M[name]}\n'
        f"[limits]\nmax_depth_m = {depth + 15.0}\nmax_time_s = {longest_s}\n"
        f"[start]\ndepth_m = {0.3 * depth}\n{legs}"
    )


@dataclass(frozen=True)
class Figures:
    """What became of one flight; errors in m over the steady parts, switches per minute in them.

    ``risen`` is the way in m from the largest depth up to the last one.

    ``starts_and_stops`` and ``reversals`` are those of the actuator that has most of them.
    """

    outcome: str
    waypoints: int
    missed_by: float
    cross_track: float
    vertical: float
    overshoot_percent: float
    starts_and_stops: float
    reversals: float
    surfaced: bool
    risen: float
    alert: str
    duration: float


@cache
def flights(
    name: str,
    speed_m_s: float,
    *,
    method: str = "integral",
    sensors: str | None = None,
    faults: tuple[st.Fault, ...] = (),
    feedback: bool = True,
    text: str | None = None,
    longest_s: float = 4000.0,
) -> tuple[Figures, ...]:
    """The square in the four currents; the seeds of the sensors differ."""
    vehicle = Vehicle.load(name)
    pilot = autopilot(name, method) if text is None else st.Autopilot.from_toml(text, name)
    hovers = pilot.modes[0]["depth_by"] == "heave"
    start = st.State(
        [0.0, 0.0, 0.3 * DEPTH_M[name]],
        [0.0, 0.0, 0.0],
        [0.0 if hovers else min(speed_m_s, 1.5), 0.0, 0.0, 0.0, 0.0, 0.0],
    )
    flown = st.fly_batch(
        vehicle,
        pilot,
        mission(name, speed_m_s, longest_s=longest_s),
        water=st.Water(current=CURRENTS),
        seeds=(1, 2, 3, 4),
        conditions=st.Conditions(
            sensors=sensors,
            faults=faults,
            feedback=feedback,
            initial=start,
            voltage_v=VOLTAGE.get(name),
            max_step_s=0.05,
        ),
        logs=True,
    )
    return tuple(_figures(flown, case, name, vehicle) for case in range(len(CURRENTS)))


def _figures(flown: Flights, case: int, name: str, vehicle: Vehicle) -> Figures:
    names = st._core.autopilot_names()
    log, t = flown.log(case), np.asarray(flown.t(case))
    column = {key: log[:, k] for k, key in enumerate(flown.columns)}
    figures = {key: float(values[case]) for key, values in flown.figures.items()}
    under_way = (column["done"] == 0.0) & (column["alert"] == 0.0)
    same_leg = np.concatenate([[False], np.diff(column["leg"]) == 0.0])
    steady = under_way & same_leg & (column["distance"] < STEADY * LEG_M[name])
    minutes = max(float(steady.sum()) * float(t[1] - t[0]) / 60.0, 1e-9)
    commands = signals(flown, case, vehicle)
    facts = vehicle.actuator_info()
    thrusters = [k for k, actuator in enumerate(vehicle.actuators) if facts[actuator]["kind"] != "fin"]
    ending = names["endings"][int(figures["ending"])]
    assert ending != "complete" or steady.any()  # else the largest of no errors is zero
    return Figures(
        outcome=ending,
        waypoints=int(figures["waypoints"]),
        missed_by=figures["missed_by"],
        cross_track=float(np.abs(column["cross_track"][steady]).max(initial=0.0)),
        vertical=float(np.abs(column["vertical_error"][steady]).max(initial=0.0)),
        overshoot_percent=_overshoot(column, under_way, DEPTH_M[name]),
        starts_and_stops=float(changes(commands != 0.0, steady)[thrusters].max()) / minutes,
        reversals=float(changes(np.sign(commands), steady)[thrusters].max()) / minutes,
        surfaced=bool(column["z"][-1] < 0.6),  # counted from 0.5 m on, at the next look
        risen=float(column["z"].max() - column["z"][-1]),
        alert=names["watches"][int(figures["alert_cause"]) - 1] if figures["alert_cause"] > 0.0 else "",
        duration=figures["duration"],
    )


def signals(flown: Flights, case: int, vehicle: Vehicle) -> Array:
    """Commands (n, actuators) of a flight from neutral; what rounding leaves of neutral is zero."""
    facts, count = vehicle.actuator_info(), len(vehicle.actuators)
    neutral = np.array([float(facts[name]["neutral"]) for name in vehicle.actuators])
    away = np.asarray(flown.log(case))[:, -2 * count : -count] - neutral
    return np.where(np.abs(away) < 1e-9, 0.0, away)


def changes(values: NDArray[Any], where: NDArray[np.bool_]) -> Array:
    """How often each column of (n, m) changes within the rows of a mask."""
    changed = (values[1:] != values[:-1]) & where[1:, None] & where[:-1, None]
    return np.asarray(changed.sum(axis=0), dtype=np.float64)


def _overshoot(column: dict[str, Array], under_way: NDArray[np.bool_], depth: float) -> float:
    """Largest way beyond a new depth until the next change, % of the change."""
    found = [0.0]
    for leg, to, step in ((0, depth, 0.7 * depth), (2, 0.5 * depth, -0.5 * depth)):
        rows = under_way & (column["leg"] >= leg) & (column["leg"] <= leg + 1)
        beyond = np.sign(step) * (column["z"][rows] - to)
        found.append(100.0 * float(beyond.max(initial=0.0)) / abs(step))
    return max(found)


def station(
    vehicle: Vehicle, pilot: st.Autopilot, *, sensors: str | None, seeds: Sequence[int] = (1, 2, 3)
) -> tuple[Array, Array]:
    """Four minutes on station in still water: starts and stops, and reversals, per minute (cases, actuators).

    The first two minutes are left out.
    """
    hold = st.Mission.from_toml(
        'format = 1\nname = "hold"\nspeed_m_s = 0.5\nacceptance_radius_m = 3.0\n[start]\ndepth_m = 5.0\n'
        "[[legs]]\nnorth_m = 10.0\neast_m = 0.0\ndepth_m = 5.0\nhold_s = 360.0\n"
    )
    voltage = VOLTAGE.get(vehicle.name)
    flown = st.fly_batch(
        vehicle,
        pilot,
        hold,
        seeds=list(seeds),
        conditions=st.Conditions(sensors=sensors, voltage_v=voltage, max_time_s=600.0),
        logs=True,
    )
    found = []
    for case in range(len(seeds)):
        log, t = np.asarray(flown.log(case)), np.asarray(flown.t(case))
        held = (t > 120.0) & (log[:, flown.columns.index("holding")] > 0.0)
        assert flown.figures["ending"][case] == 1.0
        away = signals(flown, case, vehicle)
        minutes = float(held.sum()) * pilot.period_s / 60.0
        found.append([changes(away != 0.0, held) / minutes, changes(np.sign(away), held) / minutes])
    both = np.array(found)
    return both[:, 0], both[:, 1]
