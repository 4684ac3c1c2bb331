"""The autopilot file of start values: TOML text, with what the vehicle cannot do in its comments.

The keys are those of the core's autopilot file. Guidance follows from the loops: a lookahead of three
time constants of the heading at cruising speed, a pitch that the fins can hold, turns and accelerations
within the largest demands. Held by tests/test_control_design_start.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.control_design.authority import LOOPS, ROWS, reach
from seatrial.control_design.closed_loop import Array
from seatrial.control_design.loop_gains import LoopGain
from seatrial.control_design.start_gains import LoopStart, StartGains, start_gains

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["autopilot_tables", "autopilot_text", "start_autopilot"]

CRUISE = 0.6  # of the top speed
_PITCH_DEG, _HELD = 20.0, 0.5  # largest pitch asked for; share of the reach that holds it
_TURN_DEG_S = 20.0
_SHARE = 0.5  # of the largest demand, for what the guidance asks


def start_autopilot(vehicle: Vehicle, *, period_s: float = 0.1) -> str:
    """TOML text of an autopilot file with start values for a vehicle.

    Parameters
    ----------
    vehicle : Vehicle
    period_s : float
        Control period, s.

    Raises
    ------
    ValueError
        A vehicle that cannot be steered.

    Examples
    --------
    >>> import seatrial as st
    >>> print(start_autopilot(st.Vehicle.load("remus100")).splitlines()[0])
    # Start values for remus100, computed from its model; tune them before they fly at sea.
    """
    start = start_gains(vehicle, period_s=period_s)
    return autopilot_text(vehicle, start)


def autopilot_text(vehicle: Vehicle, start: StartGains) -> str:
    """TOML text of the autopilot file of some start values."""
    import tomlkit

    notes = [f"Start values for {vehicle.name}, computed from its model; tune them before they fly at sea."]
    notes += [f"No {LOOPS[ROWS.index(row)]} loop: {why}." for row, why in start.left_out.items()]
    notes += [f"Weak: {place}: little margin or much overshoot; keep away from it." for place in start.weak]
    body = tomlkit.dumps(autopilot_tables(vehicle, start))
    return "".join(f"# {note}\n" for note in notes) + body


def autopilot_tables(vehicle: Vehicle, start: StartGains) -> dict[str, Any]:
    """Tables of the autopilot file of some start values, as nested dictionaries."""
    modes = []
    for mode in start.modes:
        row: dict[str, Any] = {"name": mode.name, "loops": list(mode.loops), "depth_by": mode.depth_by}
        if mode.from_speed_m_s is not None:
            row["from_speed_m_s"] = _round(mode.from_speed_m_s)
            row["hysteresis_m_s"] = _round(0.15 * mode.from_speed_m_s)
        modes.append(row)
    return {
        "format": 1,
        "name": f"{vehicle.name} start",
        "description": f"Start values for {vehicle.name}, from its model",
        "period_s": start.period_s,
        "control": "pid",
        "schedule": {"speeds_m_s": [round(u, 3) for u in start.speeds_m_s]},
        "modes": modes,
        "loops": {name: _loop(loop) for name, loop in start.loops.items()},
        "feed_forward": {"restoring": True, "drag": True, "acceleration": True},
        "guidance": guidance(vehicle, start),
    }


def guidance(vehicle: Vehicle, start: StartGains) -> dict[str, Any]:
    """Table of the guidance: distances in m, speeds in m/s, angles in deg."""
    length = max(vehicle.geometry().get("length", 1.0), 0.5)
    top = start.speeds_m_s[-1]
    cruise = CRUISE * start.top_m_s[1]
    mass = np.asarray(vehicle.mass_matrix())

    def lookahead(loop: str) -> float:
        bandwidth = _at(start, start.loops[loop], cruise).bandwidth
        return float(max(3.0 * length, 3.0 * cruise * 2.0 / bandwidth))

    vertical = "pitch" if any(mode.depth_by == "pitch" for mode in start.modes) else "heave"
    surge, heading = start.loops["surge"], start.loops["heading"]
    turn = _steady_turn(vehicle, cruise, _SHARE * heading.tau_max)
    table: dict[str, Any] = {
        "method": "integral",
        "lookahead_m": lookahead("heading"),
        "lookahead_vertical_m": lookahead(vertical),
        "integral_gain_m_s": 0.2 * cruise,
        "integral_gain_vertical_m_s": 0.1 * cruise,
        "speed_max_m_s": 0.9 * top,
        "acceleration_max_m_s2": _SHARE * surge.tau_max / float(mass[0, 0]) * 0.5,
        "turn_rate_max_deg_s": float(min(_TURN_DEG_S, np.rad2deg(turn))),
        "loiter_radius_m": max(5.0, 1.5 * cruise / max(min(turn, np.deg2rad(_TURN_DEG_S)), 1e-3)),
        "hold_gain_per_s": 0.2 * float(np.median([gain.bandwidth for gain in surge.gains])),
    }
    table["hold_gain_per_s"] = min(table["hold_gain_per_s"], 0.2)
    if vertical == "pitch":
        table["pitch_max_deg"] = _largest_pitch(vehicle, start, cruise)
        pitch = _at(start, start.loops["pitch"], cruise).bandwidth
        table["pitch_rate_max_deg_s"] = 0.5 * table["pitch_max_deg"] * pitch
    if "heave" in start.loops:
        heave = start.loops["heave"]
        table["depth_rate_max_m_s"] = _steady_heave(vehicle, _SHARE * heave.tau_max)
    return {key: value if isinstance(value, str) else _round(value) for key, value in table.items()}


def _at(start: StartGains, loop: LoopStart, speed: float) -> LoopGain:
    """The gains at the supporting point nearest to a speed."""
    return loop.gains[int(np.argmin(np.abs(np.array(start.speeds_m_s) - speed)))]


def _loop(loop: LoopStart) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for key, values in (
        ("K_P", [gain.k_p for gain in loop.gains]),
        ("K_I_per_s", [gain.k_i for gain in loop.gains]),
        ("K_D_s", [gain.k_d for gain in loop.gains]),
    ):
        rounded = [_round(value) for value in values]
        if any(rounded):
            table[key] = rounded[0] if len(set(rounded)) == 1 else rounded
    table["tau_max"] = _round(loop.tau_max)
    table["anti_windup"] = "back-calculation"
    table["reference_rad_s"] = _round(loop.reference_rad_s)
    return table


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


def _round(value: float) -> float:
    """Three digits: start values are no more certain."""
    return float(f"{value:.3g}")
