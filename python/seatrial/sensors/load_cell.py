"""Load cell of a tied vehicle: the force that it puts on its tether, as in a bollard test.

The tether balances everything else that acts on the vehicle, which does not move:

    load = tau_actuators + sum of the other forces at nu = 0   (body frame, N)

that is, the actuators' wrench and the restoring force; a current past the vehicle adds its drag. Positive is
a push forward, to starboard, down. Held by tests/test_sensors_load_cell.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.errors import TrialError
from seatrial.sensors.conditions import Conditions
from seatrial.sensors.sensor import Sensor

if TYPE_CHECKING:
    from seatrial._core import Run

__all__ = ["ON_THE_TETHER", "at_sea", "tether_force"]

Array = NDArray[np.float64]

ON_THE_TETHER = ("load_cell", "revolutions", "voltage")
"""Sensors that tell something of a tied vehicle."""


def at_sea(sensors: Mapping[str, Sensor]) -> dict[str, Sensor]:
    """Those of a vehicle's sensors that log while no tether holds it: all but the load cell."""
    return {kind: sensor for kind, sensor in sensors.items() if kind != "load_cell"}


def tether_force(run: Run, conditions: Conditions) -> Array:
    """Force (n, 3) of a held vehicle on its tether at the rows of its run, body frame, N.

    Raises
    ------
    TrialError
        The vehicle is not held.
    """
    if not conditions.held or conditions.vehicle is None:
        raise TrialError(
            "load_cell: a load cell shows the pull of a tied vehicle, and this one moves freely; hold it"
            " (held = true in a recipe, --held on the command line) or leave the load cell out"
        )
    count = len(run.t)
    at_rest = np.zeros((count, 6))
    terms = conditions.vehicle.forces(at_rest, np.asarray(run.attitude), conditions.water(count))
    wrench = np.asarray(run.tau) + np.sum(list(terms.values()), axis=0)
    return np.asarray(wrench[:, :3])
