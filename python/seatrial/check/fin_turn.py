"""A steady turn by movable fins: rudders at half their largest angle, all that drives ahead at half power.

In the horizontal plane, as the turns of `seatrial.check.performance`: roll, pitch and heave are held. Held by
tests/test_check_fins.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.check.actuators import NOMINAL_V, command, largest
from seatrial.check.performance import drivers
from seatrial.check.steady import steady

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["FinTurn", "fin_turn", "rudders"]

_SHARE = 0.5
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

    Parameters
    ----------
    vehicle : Vehicle
    voltage_v : float
        Supply voltage at which tables of thrust are read, V.

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
