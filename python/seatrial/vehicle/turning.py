"""Turns in the horizontal plane: a steady turn by fins, and the tightest turn at a speed ahead.

By fins: rudders at half their largest angle, all that drives ahead at half power. The tightest turn:
thrusters give the largest yaw moment that leaves the thrust ahead and the other commanded rows as level
flight needs them (a linear programme over what each actuator reaches, `seatrial.vehicle.authority`), rudders
are hard over in the flow as it is in the turn; sway and yaw then settle while the speed is held. Roll, pitch
and heave are held in both. Held by ``tests/check/test_check_fins.py`` and
``tests/check/test_check_mission.py``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.vehicle.actuators import NOMINAL_V, command, largest, voltage_for
from seatrial.vehicle.steady_state import drivers, steady, without_pull

if TYPE_CHECKING:
    from seatrial._core import Vehicle

_SHARE = 0.5  # of the largest angle and thrust, as the head says
_STEERS = 0.5  # a fin steers if this share of its moment is about z


@dataclass(frozen=True)
class FinTurn:
    """A steady turn to starboard by fins; the radius is of the path of O.

    ``fin_deg`` is the size of the fins' angle, ``command`` the step from neutral in ``unit`` of what drives
    ahead; ``speed_m_s`` is that along the circle.
    """

    fin_deg: float
    command: float
    unit: str
    radius_m: float
    rate_deg_s: float
    speed_m_s: float


def rudders(vehicle: Vehicle) -> dict[str, float]:
    """Movable fins that turn the vehicle, with the sense (+1, -1) of the command to starboard."""
    matrix, facts = np.asarray(vehicle.allocation_matrix()), vehicle.actuator_info()
    moments = {
        name: matrix[3:, k] for k, name in enumerate(vehicle.actuators) if facts[name]["kind"] == "fin"
    }
    return {
        name: float(np.sign(moment[2]))
        for name, moment in moments.items()
        if abs(moment[2]) > _STEERS * max(float(np.linalg.norm(moment)), 1e-12)
    }


def fin_turn(vehicle: Vehicle, *, voltage_v: float = NOMINAL_V) -> FinTurn | None:
    """Steady turn by the fins that steer; None without such fins, without drive, or where it never settles.

    Tables of thrust are read at `voltage_v`, V.

    Examples
    --------
    >>> import seatrial as st
    >>> turn = fin_turn(st.Vehicle.load("lauv"))
    >>> 3.0 < turn.radius_m < 12.0
    True
    """
    steering, driving, facts = rudders(vehicle), drivers(vehicle), vehicle.actuator_info()
    if not steering or not driving:
        return None
    commands = {name: command(facts[name], _SHARE * sense) for name, sense in driving.items()}
    commands |= {name: command(facts[name], _SHARE * sense) for name, sense in steering.items()}
    turn = steady(vehicle, commands, free="XYN", voltage_v=voltage_v)
    speed, rate = float(np.hypot(turn.nu[0], turn.nu[1])), float(turn.nu[5])
    # A turn that swings, or a straight course, has no radius.
    if not turn.settled or abs(rate) < 1e-4:
        return None
    first, fin = next(iter(driving)), next(iter(steering))
    return FinTurn(
        fin_deg=float(np.rad2deg(_SHARE * largest(facts[fin], steering[fin]))),
        command=_SHARE * largest(facts[first], driving[first]),
        unit=str(facts[first]["unit"]),
        radius_m=speed / abs(rate),
        rate_deg_s=float(np.rad2deg(rate)),
        speed_m_s=speed,
    )


_SETTLES_S, _SAMPLES = 120.0, 241  # a turn settles within two minutes; a sample each half second
_STRAIGHT = 1e-6  # rad/s
_STARTS = 1e-3  # rad/s, so that an exact balance of an unstable hull does not stay straight


def turning_radius(vehicle: Vehicle, speed_m_s: float, *, voltage_v: float = NOMINAL_V) -> float | None:
    """Radius in m of the tightest circle at a speed ahead; None where it cannot turn and hold the speed.

    The speed is through the water; tables of thrust are read at `voltage_v`, V.

    Examples
    --------
    >>> import seatrial as st
    >>> radius = turning_radius(st.Vehicle.load("remus100"), 1.5)
    >>> 2.0 < radius < 8.0
    True
    """
    from scipy.optimize import linprog

    from seatrial._core import State
    from seatrial.vehicle.authority import ROWS, commandable, thrusts

    if not vehicle.actuators:
        return None
    missing = commandable(vehicle, speed_m_s, voltage_v=voltage_v)
    if "N" in missing:
        return None
    nu = np.array([speed_m_s, 0.0, 0.0, 0.0, 0.0, 0.0])
    drag = -float(sum(np.asarray(force)[0] for force in vehicle.forces(nu, np.zeros(3)).values()))
    matrix = np.asarray(vehicle.allocation_matrix())
    limits = list(map(tuple, thrusts(vehicle, speed_m_s, voltage_v=voltage_v)))
    # Rows that nothing commands cannot be asked for: the programme would have no solution.
    kept = [row for row in "XZKM" if row not in missing]
    demands = np.array([drag if row == "X" else 0.0 for row in kept])
    solution = linprog(
        -matrix[5], A_eq=matrix[[ROWS.index(row) for row in kept]], b_eq=demands, bounds=limits
    )
    if not solution.success or -solution.fun <= 0.0:
        return None
    facts, t = vehicle.actuator_info(), np.linspace(0.0, _SETTLES_S, _SAMPLES)
    hard_over = {
        name: np.full(len(t), command(facts[name], sense)) for name, sense in rudders(vehicle).items()
    }
    # Fins push by the flow of the turn itself, thrusters as the programme says.
    thrusting = np.array([facts[name]["kind"] != "fin" for name in vehicle.actuators])
    wrench = matrix @ np.where(thrusting, solution.x, 0.0)
    # Without a yaw rate the vehicle would stay on its straight course.
    nu[5] = _STARTS
    run = without_pull(vehicle).simulate(
        t,
        hard_over,
        State(nu=nu),
        free="YN",
        tau=np.tile(wrench, (len(t), 1)),
        voltage_v=voltage_for(vehicle, t, voltage_v),
    )
    u, v, *_, rate = np.asarray(run.nu)[-1]
    return float(np.hypot(u, v) / abs(rate)) if abs(rate) > _STRAIGHT else None
