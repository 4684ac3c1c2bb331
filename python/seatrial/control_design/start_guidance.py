"""The table of the guidance that goes with start gains: distances, limits, station-keeping.

Lookahead distances are twice the speed times the delay of the course (`seatrial.control_design.following`),
the integral gains a quarter of the speed in the horizontal plane (critical damping) and a tenth in the
vertical one, where only trim and lift are to be learnt. Turns and accelerations take a share of the largest
demands.
Held by tests/test_control_design_start.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.control_design.authority import ROWS, reach
from seatrial.control_design.closed_loop import Array
from seatrial.control_design.following import lookahead
from seatrial.control_design.loop_gains import three_digits
from seatrial.control_design.mode_table import Mode, flies
from seatrial.control_design.start_gains import StartGains

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["CRUISE", "guidance"]

CRUISE = 0.6
"""Cruising speed as a share of the top speed."""

_INTEGRAL, _INTEGRAL_VERTICAL = 0.25, 0.1  # of the cruising speed
_LEAST_LENGTHS = 2.0  # of lookahead
_PITCH_DEG, _HELD = 20.0, 0.5  # largest pitch asked for; share of the reach that holds it
_TURN_DEG_S = 20.0
_SHARE = 0.5  # of the largest demand, for what the guidance asks
_START_S = 4.0  # to the cruising speed, at the least
_TURN_SHARE = 0.2  # of the speed while the bow is a right angle off: who can stop turns on the spot
_HOLD_RADIUS_M, _WATCH = 2.0, 2.5  # largest; watch radius over hold radius
_WEATHERVANE = 5.0  # times the hold gain: well damped in currents from 0.2 m/s on


def guidance(vehicle: Vehicle, start: StartGains) -> tuple[dict[str, Any], dict[str, float]]:
    """Table of the guidance, in m, m/s and deg, and the course's delay in s per "heading" and "pitch"."""
    cruise = CRUISE * start.top_m_s[1]
    mass = float(np.asarray(vehicle.mass_matrix())[0, 0])
    length = vehicle.geometry().get("length", 1.0)
    mode = next(m for m in start.modes if flies(m, start.modes, cruise))
    by_pitch = mode.depth_by == "pitch"
    surge, heading = start.loops["surge"], start.loops["heading"]
    turn = _steady_turn(vehicle, cruise, _SHARE * heading.tau_max)
    table: dict[str, Any] = {"method": "integral"}
    late: dict[str, float] = {}
    for key, loop in (("lookahead_m", "heading"), ("lookahead_vertical_m", "pitch")):
        if loop == "heading" or by_pitch:
            distance, late[loop] = _lookahead(vehicle, start, mode, loop)
            table[key] = max(distance, _LEAST_LENGTHS * length)
    hold = min(0.2 * float(np.median([gain.bandwidth for gain in surge.gains])), 0.2)
    table |= {
        "lookahead_speed_m_s": start.speeds_m_s[_nearest(start, cruise)],
        "integral_gain_m_s": _INTEGRAL * cruise,
        "integral_gain_vertical_m_s": _INTEGRAL_VERTICAL * cruise,
        "speed_max_m_s": 0.9 * start.speeds_m_s[-1],
        "acceleration_max_m_s2": min(0.5 * _SHARE * surge.tau_max / mass, cruise / _START_S),
        "turn_rate_max_deg_s": float(min(_TURN_DEG_S, np.rad2deg(turn))),
        "loiter_radius_m": max(5.0, 1.5 * cruise / max(min(turn, np.deg2rad(_TURN_DEG_S)), 1e-3)),
        "hold_gain_per_s": hold,
    }
    if "heave" in start.loops:
        radius = float(np.clip(length, 0.5, _HOLD_RADIUS_M))
        table |= {"hold_radius_m": radius, "watch_radius_m": _WATCH * radius}
        table["depth_rate_max_m_s"] = _steady_heave(vehicle, _SHARE * start.loops["heave"].tau_max)
        if "sway" in start.loops:
            table["turn_speed_share"] = _TURN_SHARE
        else:
            table["weathervane_gain_rad_m"] = _WEATHERVANE * hold
    if by_pitch:
        table["pitch_max_deg"] = _largest_pitch(vehicle, start, cruise)
        pitch = start.loops["pitch"].gains[_nearest(start, cruise)].bandwidth
        table["pitch_rate_max_deg_s"] = 0.5 * table["pitch_max_deg"] * pitch
    return {
        key: value if isinstance(value, str) else three_digits(value) for key, value in table.items()
    }, late


def _lookahead(vehicle: Vehicle, start: StartGains, mode: Mode, loop: str) -> tuple[float, float]:
    """Lookahead distance in m of a loop at the cruising speed, and the delay of the course in s."""
    k = _nearest(start, CRUISE * start.top_m_s[1])
    flight = mode, start.speeds_m_s[k], {name: of.gains[k] for name, of in start.loops.items()}, start.late
    return lookahead(vehicle, flight, loop, start.loops[loop].reference_rad_s, start.period_s)


def _nearest(start: StartGains, speed: float) -> int:
    """Index of the supporting point nearest to a speed."""
    return int(np.argmin(np.abs(np.array(start.speeds_m_s) - speed)))


def _largest_pitch(vehicle: Vehicle, start: StartGains, speed: float) -> float:
    """Pitch in deg that half of the reach holds against the righting moment at a speed, at most 20."""
    rows = "".join(row for row in ROWS if row not in start.left_out and row != "Z")
    low, high = reach(vehicle, speed, rows)["M"]
    angles = np.deg2rad(np.arange(1.0, _PITCH_DEG + 0.5))
    attitude = np.stack([0.0 * angles, angles, 0.0 * angles], axis=1)
    righting = np.asarray(vehicle.forces(np.zeros((len(angles), 6)), attitude)["restoring"])[:, 4]
    held = np.abs(righting) <= _HELD * min(high, -low)
    return float(np.rad2deg(angles[held][-1])) if held.any() else 1.0


def _steady_turn(vehicle: Vehicle, speed: float, moment: float) -> float:
    """Turning rate in rad/s at which damping balances a yaw moment, the hull not drifting."""
    return _balance(vehicle, np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0]), 5, moment)


def _steady_heave(vehicle: Vehicle, force: float) -> float:
    """Sinking speed in m/s at which damping balances a heave force."""
    return _balance(vehicle, np.zeros(6), 2, force)


def _balance(vehicle: Vehicle, nu: Array, axis: int, force: float) -> float:
    velocities = np.linspace(0.0, 2.0, 401)
    motion = np.tile(nu, (len(velocities), 1))
    motion[:, axis] = velocities
    terms: Mapping[str, Any] = vehicle.forces(motion, np.zeros(3))
    damping = -(np.asarray(terms["damping"]) + np.asarray(terms["lift"]))[:, axis]
    return float(velocities[np.searchsorted(np.maximum.accumulate(damping), force, side="right") - 1])
