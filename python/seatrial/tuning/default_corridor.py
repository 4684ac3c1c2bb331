"""The corridor of a loop for which the campaign gives none: what the vehicle's own limits allow, with room.

A step of size s that a largest acceleration a carries out takes at least ``s/a`` for a speed and ``2
sqrt(s/a)`` for a position, speeding up and slowing down; half of the demand is left to everything else.
Dead time, lag and reference filter come on top, and the rise time is twice as much: ``rise = 2 (t + 3 late
+ 3/omega)``. Water that damps the motion, and guidance's own limits of rates, slow it further.

Source: bang-bang control of a double integrator, e.g. Bryson and Ho, *Applied Optimal Control* (1975),
section 3.9. Held by tests/test_tuning_plan.py.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.control_design.authority import LOOPS as ORDER
from seatrial.control_design.authority import ROWS, delays, reach
from seatrial.tuning.corridor import Corridor
from seatrial.tuning.tuning_file import LOOPS, Weights

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle

__all__ = ["default_corridor"]

_LEFT = 0.5  # of the reach, to other loops
_ROOM = 2.0
_SHORTEST_S, _LONGEST_S = 2.0, 60.0
_PATHS = {"depth": "pitch", "cross_track": "heading"}
_SLOWEST_ROW = 1e-6


def default_corridor(
    vehicle: Vehicle, autopilot: Autopilot, loop: str, steps: Sequence[float], *, weights: Weights
) -> Corridor:
    """Corridor for the largest of some steps of a loop, in the file's unit.

    Parameters
    ----------
    vehicle : Vehicle
    autopilot : Autopilot
    loop : str
        A loop, or a path that rides on one.
    steps : sequence of float
        m/s, m or deg.
    weights : Weights

    Examples
    --------
    >>> import seatrial as st
    >>> cwolf, autopilot = st.Vehicle.load("cwolf"), st.Autopilot.load("cwolf")
    >>> default_corridor(cwolf, autopilot, "heading", [20.0], weights=Weights()).until_s > 10.0
    True
    """
    tables = tomllib.loads(autopilot.to_toml())
    rider = _PATHS.get(loop, loop)
    row = ROWS[ORDER.index(rider)]
    entry = LOOPS[loop]
    size = max(abs(step) for step in steps) * entry.to_si
    late = delays(vehicle, row)[row].total_s + autopilot.period_s
    omega = tables["loops"].get(rider, {}).get("reference_rad_s")
    late_s = 3.0 * late + (3.0 / omega if omega else 0.0)
    if loop in _PATHS:
        least = _along_a_path(tables, loop, size)
    else:
        ends = np.abs(reach(vehicle, 0.0, row)[row])
        tau = min(float(ends[ends > 0.0].min(initial=np.inf)), tables["loops"][rider]["tau_max"])
        inertia = float(np.asarray(vehicle.mass_matrix())[ROWS.index(row), ROWS.index(row)])
        most = max(_LEFT * tau / inertia, _SLOWEST_ROW)
        least = size / most if loop in ("surge", "sway") else 2.0 * float(np.sqrt(size / most))
        least = max(least, _by_rate(tables, loop, size))
    rise = float(np.clip(_ROOM * (least + late_s), _SHORTEST_S, _LONGEST_S))
    return Corridor.from_figures(
        rise_s=float(f"{rise:.2g}"),
        overshoot=0.15,
        settling_s=float(f"{2.5 * rise:.2g}"),
        settled=0.08,
        weight_lower=weights.lower,
        weight_upper=weights.upper,
    )


def _by_rate(tables: dict[str, dict[str, float]], loop: str, size: float) -> float:
    """Time that guidance's own limit of the rate asks for, s."""
    rate = np.deg2rad(tables["guidance"].get("pitch_rate_max_deg_s", np.inf)) if loop == "pitch" else np.inf
    return float(size / rate)


def _along_a_path(tables: dict[str, dict[str, float]], loop: str, size: float) -> float:
    """Time in which line of sight at 1 m/s takes up a step of the path, s: three lookahead distances."""
    key = "lookahead_vertical_m" if loop == "depth" else "lookahead_m"
    return 1.5 * float(tables["guidance"][key]) + size
