"""Modes and breakpoints that suit a vehicle, from the rows that its actuators can command.

A vehicle that commands the heave force hovers. A frame that also commands the sway force cruises as it
hovers, without swaying; any other pitches under way, with its depth by pitch, by the actuators that drive
it and its fins: a vertical thruster that only helped the pitch moment would keep crossing its minimum
revolutions. The breakpoints span 95 % of the reachable range; those of a vehicle that cannot hover
begin where it flies level. Held by tests/control_design/test_control_design_start.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.errors import VehicleError
from seatrial.control_design.loops import Trim, level, trim
from seatrial.vehicle.actuators import LOOPS, NOMINAL_V, ROWS, command, reach
from seatrial.vehicle.steady_state import drivers, steady, unbounded

if TYPE_CHECKING:
    from seatrial._core import Vehicle

POINTS = 6
"""Number of breakpoints, that of the core."""


@dataclass(frozen=True)
class ModeTableSettings:
    """Which speeds and modes suit a vehicle."""

    #: Share of the reachable speeds that the breakpoints span: at the very end nothing is left to control
    #: with.
    speed_range_share: float = 0.95
    cruise_from_share: float = 0.3  #: Share of the top speed from which cruise takes over from hover.
    slowest_share: float = 0.25  #: Share of the top speed below which fins do not bite any more.
    level_pitch_rad: float = float(np.deg2rad(10.0))  #: Largest pitch of level flight, rad.
    held_share: float = 0.9  #: Share of the actuators' reach that must hold level flight.
    #: Pitch at which cruise may take over from hover, rad: guidance has to learn it, which moves the depth.
    take_over_pitch_rad: float = float(np.deg2rad(1.5))


MODE_TABLE_SETTINGS = ModeTableSettings()


@dataclass(frozen=True)
class Mode:
    """A row of the mode table."""

    name: str
    loops: tuple[str, ...]
    depth_by: str
    from_speed_m_s: float | None = None
    actuators: tuple[str, ...] | None = None
    """Those at work; all when missing."""


def top_speeds(vehicle: Vehicle, *, voltage_v: float = NOMINAL_V) -> tuple[float, float]:
    """Top speeds astern (not positive) and ahead, m/s, straight at the largest commands.

    Raises `VehicleError`: the speed grows beyond all bounds.
    """
    facts, extremes = vehicle.actuator_info(), []
    for share in (-1.0, 1.0):
        commands = {name: command(facts[name], share * sense) for name, sense in drivers(vehicle).items()}
        extremes.append(
            float(steady(vehicle, commands, free="X", voltage_v=voltage_v).nu[0]) if commands else 0.0
        )
    if not np.isfinite(extremes).all():
        raise VehicleError(unbounded(vehicle))
    return min(extremes[0], 0.0), extremes[1]


def breakpoint_speeds(vehicle: Vehicle, rows: str, top: tuple[float, float]) -> list[float]:
    """Six breakpoints in m/s over 95 % of the reachable range; without hovering, of level flight."""
    if "Z" in rows:
        slowest = MODE_TABLE_SETTINGS.speed_range_share * top[0]
    else:
        slowest = _slowest(vehicle, rows, top[1])
    return [float(u) for u in np.linspace(slowest, MODE_TABLE_SETTINGS.speed_range_share * top[1], POINTS)]


def _slowest(
    vehicle: Vehicle, rows: str, top: float, pitch: float = MODE_TABLE_SETTINGS.level_pitch_rad
) -> float:
    """Least speed of level flight that the actuators can hold, a quarter of the top speed or more.

    The trim needs no more than ``pitch`` in rad.
    """
    commanded = rows.replace("Z", "")
    for share in np.linspace(MODE_TABLE_SETTINGS.slowest_share, 0.8, 23):
        flight = trim(vehicle, share * top, commanded)
        if flight is None or abs(flight.attitude[1]) > pitch:
            continue
        low, high = reach(vehicle, share * top, commanded)["M"] if "M" in commanded else (-np.inf, np.inf)
        if MODE_TABLE_SETTINGS.held_share * low < flight.tau[4] < MODE_TABLE_SETTINGS.held_share * high:
            return float(share * top)
    return 0.8 * top


def mode_table(vehicle: Vehicle, rows: str, top: tuple[float, float]) -> tuple[Mode, ...]:
    """The modes for the commanded rows and the top speeds astern and ahead (m/s)."""
    hovers, cruise_from = "Z" in rows, MODE_TABLE_SETTINGS.cruise_from_share * top[1]
    every = tuple(LOOPS[ROWS.index(row)] for row in rows)
    cruising = tuple(loop for loop in every if loop not in ("heave", "sway"))
    modes = [Mode("hover", every, "heave")] if hovers else []
    if hovers and "Y" in rows:
        # A frame with thrusters all around goes down as it is; it only stops to sway.
        without = tuple(loop for loop in every if loop != "sway")
        modes.append(Mode("cruise", without, "heave", cruise_from))
    elif "M" in rows:
        start = driving = None
        if hovers:
            start = max(_slowest(vehicle, rows, top[1], MODE_TABLE_SETTINGS.take_over_pitch_rad), cruise_from)
            driving = _driving(vehicle, "".join(ROWS[LOOPS.index(loop)] for loop in cruising))
        modes.append(Mode("cruise", cruising, "pitch", start, driving))
    return tuple(modes)


def _driving(vehicle: Vehicle, rows: str) -> tuple[str, ...] | None:
    """Actuators that drive, and fins, where they are not all and command the rows without the others."""
    facts = vehicle.actuator_info()
    names = [name for name in vehicle.actuators if name in drivers(vehicle) or facts[name]["kind"] == "fin"]
    matrix = np.asarray(vehicle.allocation_matrix())[[ROWS.index(row) for row in rows]]
    matrix = matrix[:, [vehicle.actuators.index(name) for name in names]]
    alone = np.linalg.matrix_rank(matrix, tol=0.1 * float(np.abs(matrix).max())) == len(rows)
    return tuple(names) if alone and len(names) < len(vehicle.actuators) else None


def flies(mode: Mode, modes: tuple[Mode, ...], speed: float) -> bool:
    """Whether a mode works at this desired speed: hover astern and up to where cruise takes over."""
    if len(modes) == 1:
        return True
    start = modes[-1].from_speed_m_s or 0.0
    return speed >= start if mode is modes[-1] else speed < start


def mode_trim(vehicle: Vehicle, speed_m_s: float, mode: Mode) -> Trim:
    """The trim of a mode at a speed in m/s, or level motion where there is none."""
    rows = "".join(ROWS[LOOPS.index(loop)] for loop in LOOPS if loop in mode.loops)
    return trim(vehicle, speed_m_s, rows, mode.actuators) or level(speed_m_s, rows, mode.actuators)
