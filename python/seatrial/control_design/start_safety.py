"""The table of the reactions that goes with start gains: what the vehicle can still do when something fails.

The core's defaults suit a vehicle that is lighter than water, hovers, and has a substitute for every
actuator. Where one of these is not so, other reactions are written. Held by
tests/test_control_design_start.py and tests/test_acceptance_flights.py.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.control_design.authority import LOOPS
from seatrial.control_design.loop_gains import three_digits
from seatrial.control_design.start_gains import StartGains

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["heavy", "safety", "without_substitute"]

_FASTER = 1.1  # than the slowest level flight, while surfacing
_DOPPLER_S = 20.0
_ALONE = 0.02  # smallest over largest singular value of what is left


def safety(vehicle: Vehicle, start: StartGains) -> dict[str, Any]:
    """Table of the reactions that differ from the core's defaults."""
    table: dict[str, Any] = {}
    hovers = start.modes[0].depth_by == "heave"
    if not hovers:
        table["surface_speed_m_s"] = three_digits(_FASTER * start.speeds_m_s[0])
    table["stale_velocity"] = {"after_s": _DOPPLER_S, "reaction": "surface"}
    if heavy(vehicle):
        for group, after in (("depth", 5.0), ("attitude", 2.0), ("rates", 2.0)):
            table[f"stale_{group}"] = {"after_s": after, "reaction": "surface" if hovers else "abort"}
    elif not hovers:
        table["depth"] = "abort"
    if without_substitute(vehicle, start):
        sinks_or_hovers = hovers or heavy(vehicle)
        reaction = "surface" if sinks_or_hovers else "abort"
        table["actuator"] = {"deviation": 0.2, "after_s": 2.0, "reaction": reaction}
    return table


def heavy(vehicle: Vehicle) -> bool:
    """Whether the vehicle sinks with all actuators at rest."""
    return bool(np.asarray(vehicle.forces(np.zeros((1, 6)), np.zeros(3))["restoring"])[0, 2] > 0.0)


def without_substitute(vehicle: Vehicle, start: StartGains) -> tuple[str, ...]:
    """Actuators without which the rows of the first mode cannot be commanded any more."""
    rows = [LOOPS.index(loop) for loop in start.modes[0].loops]
    matrix = np.asarray(vehicle.allocation_matrix())[rows]
    matrix = matrix / np.abs(matrix).max(axis=1, keepdims=True)
    found = []
    for k, name in enumerate(vehicle.actuators):
        values = np.linalg.svd(np.delete(matrix, k, axis=1), compute_uv=False)
        if len(values) < len(rows) or values[-1] < _ALONE * values[0]:
            found.append(name)
    return tuple(found)
