"""Supporting points that a vehicle reaches, and the modes that can work at a speed.

Held by tests/test_margin_constraint.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.check.actuators import NOMINAL_V

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle

__all__ = ["reachable_points", "working_points"]


def reachable_points(
    vehicle: Vehicle, autopilot: Autopilot, *, voltage_v: float = NOMINAL_V
) -> NDArray[np.bool_]:
    """Whether each supporting point (6,) lies between the top speeds astern and ahead.

    Parameters
    ----------
    vehicle : Vehicle
    autopilot : Autopilot
    voltage_v : float, optional
        Supply at which tables of thrust are read, V.

    Examples
    --------
    >>> import seatrial as st
    >>> reachable_points(st.Vehicle.load("cwolf"), st.Autopilot.load("cwolf"))
    array([ True,  True,  True,  True,  True,  True])
    """
    from seatrial.control_design.mode_table import top_speeds

    astern, ahead = top_speeds(vehicle, voltage_v=voltage_v)
    speeds = np.asarray(autopilot.speeds_m_s)
    return np.asarray((speeds >= astern) & (speeds <= ahead))


def working_points(tables: dict[str, Any], speeds_m_s: Sequence[float]) -> list[tuple[str, float]]:
    """Mode and speed in m/s of every mode that can work at a speed, and of both at a switching speed.

    ``tables`` are those of the autopilot file. Between a switching speed and its hysteresis below it, either
    mode may be at work.
    """
    modes, found = tables["modes"], []
    switching = [float(mode["from_speed_m_s"]) for mode in modes[1:]]
    least, most = min(speeds_m_s), max(speeds_m_s)
    every = {float(u) for u in speeds_m_s} | {u for u in switching if least < u < most}
    for speed in sorted(every):
        for k, mode in enumerate(modes):
            begun = k == 0 or speed >= mode["from_speed_m_s"] - mode["hysteresis_m_s"]
            if begun and (k + 1 == len(modes) or speed <= modes[k + 1]["from_speed_m_s"]):
                found.append((str(mode["name"]), speed))
    return found
