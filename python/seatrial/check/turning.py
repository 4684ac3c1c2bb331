"""The tightest turn that a vehicle flies at a speed ahead.

Thrusters give the largest yaw moment that leaves the thrust ahead and the other commanded rows as level
flight needs them (a linear programme over what each actuator reaches, `seatrial.control_design.authority`);
rudders are hard over, in the flow as it is in the turn. Sway and yaw then settle while the speed is held.
Held by tests/test_check_mission.py.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from seatrial.check.actuators import NOMINAL_V, command, voltage_for
from seatrial.check.fin_turn import rudders

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["turning_radius"]

_SETTLES_S, _SAMPLES = 120.0, 241
_STRAIGHT = 1e-6  # rad/s
_STARTS = 1e-3  # rad/s, so that an exact balance of an unstable hull does not stay straight


def turning_radius(vehicle: Vehicle, speed_m_s: float, *, voltage_v: float = NOMINAL_V) -> float | None:
    """Radius in m of the tightest circle at a speed ahead; None where it cannot turn and hold the speed.

    Parameters
    ----------
    vehicle : Vehicle
    speed_m_s : float
        Speed through the water, held in the turn, m/s.
    voltage_v : float
        Supply voltage at which tables of thrust are read, V.

    Examples
    --------
    >>> import seatrial as st
    >>> radius = turning_radius(st.Vehicle.load("remus100"), 1.5)
    >>> 2.0 < radius < 8.0
    True
    """
    from scipy.optimize import linprog

    from seatrial._core import State
    from seatrial.control_design.authority import ROWS, commandable, thrusts

    if not vehicle.actuators:
        return None
    missing = commandable(vehicle, speed_m_s, voltage_v=voltage_v)
    if "N" in missing:
        return None
    nu = np.array([speed_m_s, 0.0, 0.0, 0.0, 0.0, 0.0])
    drag = -float(sum(np.asarray(force)[0] for force in vehicle.forces(nu, np.zeros(3)).values()))
    matrix = np.asarray(vehicle.allocation_matrix())
    limits = list(map(tuple, thrusts(vehicle, speed_m_s, voltage_v=voltage_v)))
    kept = [row for row in "XZKM" if row not in missing]
    demands = np.array([drag if row == "X" else 0.0 for row in kept])
    found = linprog(-matrix[5], A_eq=matrix[[ROWS.index(row) for row in kept]], b_eq=demands, bounds=limits)
    if not found.success or -found.fun <= 0.0:
        return None
    facts, t = vehicle.actuator_info(), np.linspace(0.0, _SETTLES_S, _SAMPLES)
    hard_over = {
        name: np.full(len(t), command(facts[name], sense)) for name, sense in rudders(vehicle).items()
    }
    thrusting = np.array([facts[name]["kind"] != "fin" for name in vehicle.actuators])
    wrench = matrix @ np.where(thrusting, found.x, 0.0)
    nu[5] = _STARTS
    run = vehicle.simulate(
        t,
        hard_over,
        State(nu=nu),
        free="YN",
        tau=np.tile(wrench, (len(t), 1)),
        voltage=voltage_for(vehicle, t, voltage_v),
    )
    u, v, *_, rate = np.asarray(run.nu)[-1]
    return float(np.hypot(u, v) / abs(rate)) if abs(rate) > _STRAIGHT else None
