"""A flight as a table with the canonical columns of a trial, so that it reads back as one.

True motion under the trial's names, what the autopilot was told as ``measured.…``, what guidance wanted as
``desired.…``, the errors as ``error.…``; other columns are of no trial and are passed over when it is read.

Held by ``test_a_flight_reads_back_as_a_trial_of_its_vehicle`` in ``tests/test_flight.py``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.rotation import from_euler, matrix

if TYPE_CHECKING:
    import polars as pl

    from seatrial.flight.flight import Flight

__all__ = ["table"]

Array = NDArray[np.float64]

_DEG = 180.0 / math.pi
_UNIT = {"x": "m", "y": "m", "z": "m", "altitude": "m"}
_UNIT |= dict.fromkeys(("roll", "pitch", "yaw"), "deg") | dict.fromkeys(("p", "q", "r"), "deg_s")
_UNIT |= dict.fromkeys(("u", "v", "w", "u_water", "v_water", "w_water"), "m_s")
_DESIRED = {"speed": "m_s", "lateral": "m_s", "heading": "deg", "pitch": "deg", "depth": "m"}
_ERRORS = {"cross_track": "m", "vertical": "m", "surge": "m_s", "sway": "m_s", "heave": "m"}
_ERRORS |= dict.fromkeys(("roll", "pitch", "heading"), "deg")
_FORCES = ("X_n", "Y_n", "Z_n", "K_nm", "M_nm", "N_nm")


def table(flight: Flight) -> pl.DataFrame:
    """Log of a flight, a row per control period."""
    import polars as pl

    rows = len(flight.t)
    columns: dict[str, Any] = {"t_s": np.round(flight.t, 9)}
    true = np.column_stack([flight.position, flight.euler, flight.nu, flight.water])
    for name, values in zip(_TRUE, true.T, strict=True):
        columns[f"{name}_{_UNIT[name]}"] = _given(values, _UNIT[name])
    columns |= {f"cmd.{name}": values for name, values in flight.commands.items()}
    columns |= {f"meas.{name}": values for name, values in flight.actuators.items()}
    around = flight.circumstances
    for axis, values in zip(("north", "east", "down"), _current(flight).T, strict=True):
        columns[f"current_{axis}_m_s"] = values
    if around.voltage is not None:
        columns["voltage_v"] = np.full(rows, around.voltage)
    if np.isfinite(flight.altitude).all():
        columns["altitude_m"] = flight.altitude
    for name, values in flight.measured.items():
        columns[f"measured.{name}_{_UNIT[name]}"] = _given(values, _UNIT[name])
    for name, unit in _DESIRED.items():
        columns[f"desired.{name}_{unit}"] = _given(flight.desired[name], unit)
    for name, unit in _ERRORS.items():
        columns[f"error.{name}_{unit}"] = _given(flight.errors[name], unit)
    for k, name in enumerate(_FORCES):
        columns[f"demanded.{name}"] = flight.demanded[:, k]
        columns[f"achieved.{name}"] = flight.achieved[:, k]
    columns |= {"leg": flight.leg, "mode": [flight.modes[k] for k in flight.mode], "reaction": flight.alert}
    columns |= {"distance_m": flight.distance, "power_w": flight.power, "energy_wh": flight.energy_wh}
    return pl.DataFrame(columns | {"battery": flight.battery})


_TRUE = (
    *("x", "y", "z", "roll", "pitch", "yaw"),
    *("u", "v", "w", "p", "q", "r", "u_water", "v_water", "w_water"),
)


def _given(values: Array, unit: str) -> Array:
    """Values in the unit of their column."""
    return values * _DEG if unit.startswith("deg") else values


def _current(flight: Flight) -> Array:
    """Velocity of the water (n, 3), north, east, down, m/s: of a turbulent one, as met."""
    around = flight.circumstances
    if not any(around.turbulence):
        return np.tile(np.asarray(around.current, dtype=float), (len(flight.t), 1))
    turned = matrix(from_euler(flight.euler))
    return np.asarray(np.einsum("nij,nj->ni", turned, flight.nu[:, :3] - flight.water))
