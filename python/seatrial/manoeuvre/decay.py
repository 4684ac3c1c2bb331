"""Free decay: let go from a heel or trim, or at depth, and left alone: damping, inertia and righting moment.

It needs no thrust, so that what it tells does not hang on the thrusters' calibration. Source: ITTC
7.5-02-07-04.5, *Numerical estimation of roll damping* (2011), section 6.4.1.
"""

from __future__ import annotations

import numpy as np

from seatrial.campaign_file import AXES
from seatrial.check.actuators import voltage_for
from seatrial.errors import VehicleError
from seatrial.manoeuvre.definition import SETTLE_S, Manoeuvre, Start, times
from seatrial.manoeuvre.drive import MOTIONS, Thrusters
from seatrial.search import Array

__all__ = ["free_decay", "steady_speed"]

_SPEEDS_UP_S = 120.0


def free_decay(
    thrusters: Thrusters, axis: str, *, duration_s: float, angle_deg: float = 20.0, ahead: str | None = None
) -> Manoeuvre:
    """Let go from a heel ("K") or trim ("M"), or at depth ("Z"): motors stopped, or steadily ahead.

    Parameters
    ----------
    thrusters : Thrusters
    axis : str
        "K", "M" or "Z".
    duration_s : float
    angle_deg : float
        Heel to starboard or trim bow up; of heave it says nothing.
    ahead : str, optional
        Keep this thrust ahead and begin at the speed that it gives.

    Raises
    ------
    VehicleError
        No such decay.
    """
    vehicle = thrusters.vehicle
    if axis not in "KMZ":
        raise VehicleError(f"free decay: expected axis K (roll), M (pitch) or Z (heave), found {axis!r}")
    t = times(duration_s)
    held = np.zeros(len(thrusters.names)) if ahead is None else thrusters.ahead(ahead) + thrusters.trim()
    surge = 0.0 if ahead is None else steady_speed(thrusters, held)
    motors = "motors stopped" if ahead is None else f"{ahead} ahead, {surge:.1f} m/s"
    if axis == "Z":
        start = Start(surge_m_s=surge, words=f"held at depth and let go, {motors}")
    else:
        tilt = np.deg2rad([angle_deg, 0.0, 0.0] if axis == "K" else [0.0, angle_deg, 0.0])
        moment = float(np.asarray(vehicle.forces(np.zeros(6), tilt)["restoring"])[AXES.index(axis)])
        way = "heeled to starboard" if axis == "K" else "trimmed bow up"
        words = f"{way} by {angle_deg:.0f} deg ({abs(moment):.2g} N m) and let go, {motors}"
        roll, pitch = (angle_deg, 0.0) if axis == "K" else (0.0, angle_deg)
        start = Start(roll_deg=roll, pitch_deg=pitch, surge_m_s=surge, words=words)
    way = f", {ahead} ahead" if ahead else ""
    size = "" if axis == "Z" else f", {angle_deg:.0f} deg"
    return Manoeuvre(
        name=f"free decay of {MOTIONS[axis]}{size}{way}",
        kind="free decay",
        words="let go, to either side in turn, and left alone until it is still" if axis != "Z" else "let go",
        t=t,
        commands=thrusters.commands(np.tile(held, (len(t), 1))),
        start=start,
        pause_s=SETTLE_S,
    )


def steady_speed(thrusters: Thrusters, thrusts: Array) -> float:
    """Speed ahead in m/s that constant thrusts (actuators,) at rest come to, on a straight course."""
    t = np.arange(0.0, _SPEEDS_UP_S, 0.25)
    commands = thrusters.commands(np.tile(thrusts, (len(t), 1)))
    voltage = voltage_for(thrusters.vehicle, t, thrusters.voltage_v)
    run = thrusters.vehicle.simulate(t, dict(commands), free="X", voltage=voltage)
    return float(np.asarray(run.nu)[-1, 0])
