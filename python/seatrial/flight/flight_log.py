"""From the columns of the core's log to the fields of a `Flight`.

Held by ``tests/test_flight.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial._core import autopilot_names

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Flights, Vehicle

__all__ = ["log_fields"]

Array = NDArray[np.float64]

_AXES = "XYZKMN"
_DESIRED = ("speed", "lateral", "heading", "pitch", "depth")


def log_fields(flights: Flights, vehicle: Vehicle, autopilot: Autopilot, case: int) -> dict[str, Any]:
    """Fields of a flight by name, from the log of a case; SI and rad."""
    columns = dict(zip(flights.columns, np.asarray(flights.log(case)).T, strict=True))
    modes = autopilot.modes

    def several(*names: str) -> Array:
        return np.stack([columns[name] for name in names], axis=1)

    def whole(name: str) -> NDArray[np.int64]:
        return np.asarray(np.nan_to_num(columns[name]).astype(np.int64))

    desired = {name: columns[f"desired_{name}"] for name in _DESIRED}
    mode = np.clip(whole("mode"), 0, len(modes) - 1)
    by_pitch = np.array([one["depth_by"] == "pitch" for one in modes])[mode]
    return {
        "position": several("x", "y", "z"),
        "euler": several("roll", "pitch", "yaw"),
        "nu": several("u", "v", "w", "p", "q", "r"),
        "altitude": columns["altitude"],
        "water": several("u_water", "v_water", "w_water"),
        "measured": {name: columns[f"measured_{name}"] for name in autopilot_names()["channels"]},
        "desired": desired,
        "errors": _errors(columns, desired, by_pitch),
        "distance": columns["distance"],
        "leg": whole("leg"),
        "holding": columns["holding"] > 0.5,
        "done": columns["done"] > 0.5,
        "mode": mode,
        "modes": tuple(str(one["name"]) for one in modes),
        "alert": whole("alert"),
        "cause": whole("cause"),
        "commands": {name: columns[f"cmd.{name}"] for name in vehicle.actuators},
        "actuators": {name: columns[f"act.{name}"] for name in vehicle.actuators},
        "demanded": several(*(f"demanded_{axis}" for axis in _AXES)),
        "achieved": several(*(f"achieved_{axis}" for axis in _AXES)),
        "power": columns["power"],
        "battery": columns["battery"],
    }


def _errors(
    columns: Mapping[str, Array], desired: Mapping[str, Array], by_pitch: NDArray[np.bool_]
) -> dict[str, Array]:
    """Errors of guidance as it saw them, and of the loops, desired less true."""
    pitch = np.where(by_pitch, desired["pitch"], 0.0)
    return {
        "cross_track": columns["cross_track"],
        "vertical": columns["vertical_error"],
        "surge": desired["speed"] - columns["u"],
        "sway": desired["lateral"] - columns["v"],
        "heave": desired["depth"] - columns["z"],
        "roll": -columns["roll"],
        "pitch": pitch - columns["pitch"],
        "heading": (desired["heading"] - columns["yaw"] + np.pi) % (2.0 * np.pi) - np.pi,
    }
