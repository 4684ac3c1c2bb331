"""An autopilot file for a vehicle, computed from its model; the public face of `seatrial.control_design`.

Held by tests/test_cli_autopilot.py.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from seatrial.errors import VehicleError

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["LAWS", "start_autopilot"]

LAWS = ("pid", "lqr")
SHORTEST_S, LONGEST_S = 0.005, 1.0
"""Control periods for which gains are made, s: the design samples the vehicle's motion."""


def start_autopilot(vehicle: Vehicle, *, law: str = "pid", period_s: float = 0.1) -> str:
    """TOML text of an autopilot file with start values for a vehicle, the reasons as comments.

    Parameters
    ----------
    vehicle : Vehicle
    law : str
        Control law: ``pid``, decoupled loops, or ``lqr``, all of a mode at once.
    period_s : float
        Control period, s.

    Raises
    ------
    VehicleError
        The vehicle cannot be steered, or law or period are none.

    Examples
    --------
    >>> import seatrial as st
    >>> text = st.start_autopilot(st.Vehicle.load("lauv"))
    >>> [mode["name"] for mode in st.Autopilot.from_toml(text).modes]
    ['cruise']
    """
    if law not in LAWS:
        raise VehicleError(f"law: expected pid or lqr, found {law!r}")
    if not (math.isfinite(period_s) and SHORTEST_S <= period_s <= LONGEST_S):
        raise VehicleError(
            f"period_s: expected a control period from {SHORTEST_S:g} to {LONGEST_S:g} s, found {period_s:g}"
        )
    from seatrial.control_design import lqr_autopilot
    from seatrial.control_design import start_autopilot as with_pid

    try:
        text = with_pid(vehicle, period_s=period_s)
        return lqr_autopilot(vehicle, text) if law == "lqr" else text
    except ValueError as error:
        raise VehicleError(f"{vehicle.name}: no autopilot can be made: {error}") from None
