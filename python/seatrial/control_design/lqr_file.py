"""An autopilot file with the linear-quadratic regulator in place of the PID: same modes, limits, guidance.

The gains are designed for the file's own supporting speeds, modes, actuators at work and largest demands;
everything else stays as written, comments included. Held by tests/test_control_design_lqr.py.
"""

from __future__ import annotations

import re
import tomllib
from typing import TYPE_CHECKING

from seatrial.control_design.lqr_design import Tolerances, design_lqr, lqr_tables

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["lqr_autopilot"]


def lqr_autopilot(
    vehicle: Vehicle, text: str, *, tolerances: Tolerances | None = None, tracking_s: float = 5.0
) -> str:
    """TOML text of an autopilot file with `control = "lqr"` and its gains, from one with PID loops.

    Parameters
    ----------
    vehicle : Vehicle
        The autopilot's model of the vehicle.
    text : str
        TOML text of an autopilot file.
    tolerances : Tolerances
        Weights of the cost in physical units.
    tracking_s : float
        Time constant of the anti-windup, s.

    Raises
    ------
    ValueError
        The file has gains of a regulator already, or a mode that no gain makes stable.

    Examples
    --------
    >>> import seatrial as st
    >>> from seatrial.control_design import start_autopilot
    >>> lauv = st.Vehicle.load("lauv")
    >>> autopilot = st.Autopilot.from_toml(lqr_autopilot(lauv, start_autopilot(lauv)))
    >>> 'control = "lqr"' in autopilot.to_toml()
    True
    """
    import tomlkit

    file = tomllib.loads(text)
    if "lqr" in file:
        raise ValueError(
            "lqr: expected an autopilot file without gains of a regulator, found some; remove [[lqr]]"
        )
    gains = design_lqr(
        vehicle,
        file["schedule"]["speeds_m_s"],
        {mode["name"]: mode["loops"] for mode in file["modes"]},
        actuators={
            mode["name"]: _actuators(vehicle, mode["actuators"])
            for mode in file["modes"]
            if "actuators" in mode
        },
        tau_max={name: loop["tau_max"] for name, loop in file["loops"].items()},
        tolerances=tolerances,
        restoring=file.get("feed_forward", {}).get("restoring", True),
        period_s=file["period_s"],
    )
    switched, found = re.subn(r"(?m)^control\s*=.*$", 'control = "lqr"', text, count=1)
    if not found:
        switched = re.sub(r"(?m)^period_s", 'control = "lqr"\nperiod_s', text, count=1)
    tables = tomlkit.dumps({"lqr": lqr_tables(gains, tracking_s=tracking_s)})
    return f"{switched.rstrip()}\n\n{tables}"


def _actuators(vehicle: Vehicle, names: list[str]) -> tuple[str, ...]:
    """Actuators of names and groups."""
    facts = vehicle.actuator_info()
    return tuple(name for name in vehicle.actuators if name in names or facts[name]["group"] in names)
