"""`FlightLog`: what was desired, done and achieved at every control period of a flight, and its table.

Arrays are SI and rad, a row per control period. The table has the canonical columns of a trial, so that it
reads back as one: true motion under the trial's names, what the autopilot was told as ``measured.…``, what
guidance wanted as ``desired.…``, the errors as ``error.…``. Other columns are passed over when it is read.

Held by ``test_a_flight_reads_back_as_a_trial_of_its_vehicle`` in ``tests/flight/test_flight.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial._core import autopilot_names
from seatrial.base.arrays import Array, Mask
from seatrial.base.frames import from_euler, matrix

if TYPE_CHECKING:
    import polars as pl

    from seatrial._core import Autopilot, Flights, Vehicle
    from seatrial.flight.conditions import Circumstances
    from seatrial.flight.mission import Mission, Route

Numbers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class FlightLog:
    """Log of a flight with what it rests on: n rows, a control period each; SI and rad.

    `position` (NED), `euler` and `nu` (n, 6) are the true motion, `water` (n, 3) is the velocity through the
    water, `altitude` (n,) infinite without a bottom. By name (n,): what the autopilot was told (`measured`),
    what guidance wanted (`desired`), the errors that guidance perceived and those of the loops, desired less
    true (`errors`), what was asked of the actuators (`commands`) and done by them (`actuators`), in the unit
    of the command. `demanded` and `achieved` (n, 6) are the wrench of the loops and what the allocation
    reached of it. `leg` and `distance` are those of the active waypoint, `holding` and `done` tell whether
    station was kept and whether all was done, `mode` is a place in `modes`; `alert` and `cause` are the level
    of the safety reaction and the number of the watch that called for it; `power` is electrical, W, `battery`
    the share of the charge that is left.
    """

    vehicle: Vehicle
    autopilot: Autopilot
    mission: Mission
    route: Route
    circumstances: Circumstances
    period_s: float
    t: Array
    position: Array
    euler: Array
    nu: Array
    altitude: Array
    water: Array
    measured: Mapping[str, Array]
    desired: Mapping[str, Array]
    errors: Mapping[str, Array]
    distance: Array
    leg: Numbers
    holding: Mask
    done: Mask
    mode: Numbers
    modes: tuple[str, ...]
    alert: Numbers
    cause: Numbers
    commands: Mapping[str, Array]
    actuators: Mapping[str, Array]
    demanded: Array
    achieved: Array
    power: Array
    battery: Array

    @property
    def under_way(self) -> Mask:
        """Rows on the mission: not complete yet and without any reaction, (n,)."""
        return np.asarray((self.alert == 0) & ~self.done & np.isfinite(self.position).all(axis=1))

    @cached_property
    def active(self) -> Mask:
        """Loops at work, (n, 6), in the order surge, sway, heave, roll, pitch, heading."""
        table = np.array([mode["loops"] for mode in self.autopilot.modes]) > 0.5
        # From the third level of the reaction on no loop is at work.
        live = (self.alert < 3) & np.isfinite(self.nu).all(axis=1)
        return np.asarray(table[self.mode] & live[:, None])

    @cached_property
    def energy_wh(self) -> Array:
        """Electrical energy used up to each row, (n,), Wh."""
        used = np.cumsum(self.power[:-1]) * self.period_s / 3600.0
        return np.concatenate([[0.0], used])

    @cached_property
    def attitude(self) -> Array:
        """Unit quaternions (n, 4), body to NED."""
        return from_euler(self.euler)

    @cached_property
    def current(self) -> Array:
        """Velocity of the water (n, 3), north, east, down, m/s: of one that varies, as met."""
        around = self.circumstances
        varies = any((*around.turbulence, *around.current_trend, *around.current_walk))
        if not varies and around.waves is None:
            return np.tile(np.asarray(around.current, dtype=float), (len(self.t), 1))
        relative = self.nu[:, :3] - self.water
        return np.asarray(np.einsum("nij,nj->ni", matrix(self.attitude), relative))

    @property
    def loiter_radius(self) -> float:
        """Radius of the circle that is flown where station cannot be kept, m; 0 for a vehicle that can."""
        can_stop = self.autopilot.modes[0]["depth_by"] == "heave"
        return 0.0 if can_stop else float(self.autopilot.gains().get("guidance.loiter_radius_m", 0.0))

    def table(self) -> pl.DataFrame:
        """Log with the canonical columns of a trial, and beside them what was measured and desired."""
        import polars as pl

        return pl.DataFrame(_columns(self))


_AXES = "XYZKMN"

_DESIRED = ("speed", "lateral", "heading", "pitch", "depth")


def log_fields(flights: Flights, vehicle: Vehicle, autopilot: Autopilot, case: int) -> dict[str, Any]:
    """Fields of a `FlightLog` by name, from the columns that the core kept of a case; SI and rad."""
    columns = dict(zip(flights.columns, np.asarray(flights.log(case)).T, strict=True))
    modes = autopilot.modes

    def several(*names: str) -> Array:
        return np.stack([columns[name] for name in names], axis=1)

    def whole(name: str) -> NDArray[np.int64]:
        return np.asarray(np.nan_to_num(columns[name]).astype(np.int64))

    desired = {name: columns[f"desired_{name}"] for name in _DESIRED}
    # A row that diverged has no mode, yet every row has to name one.
    mode = np.clip(whole("mode"), 0, len(modes) - 1)
    by_pitch = np.array([entry["depth_by"] == "pitch" for entry in modes])[mode]
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
        "modes": tuple(str(entry["name"]) for entry in modes),
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
    """Errors of guidance as it perceived them, and of the loops, desired less true."""
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


_DEG = 180.0 / math.pi  # degrees in a radian

_UNIT = {"x": "m", "y": "m", "z": "m", "altitude": "m"}

_UNIT |= dict.fromkeys(("roll", "pitch", "yaw"), "deg") | dict.fromkeys(("p", "q", "r"), "deg_s")

_UNIT |= dict.fromkeys(("u", "v", "w", "u_water", "v_water", "w_water"), "m_s")

_DESIRED_COLUMNS = {"speed": "m_s", "lateral": "m_s", "heading": "deg", "pitch": "deg", "depth": "m"}

_ERRORS = {"cross_track": "m", "vertical": "m", "surge": "m_s", "sway": "m_s", "heave": "m"}

_ERRORS |= dict.fromkeys(("roll", "pitch", "heading"), "deg")

_FORCES = ("X_n", "Y_n", "Z_n", "K_nm", "M_nm", "N_nm")


def _columns(flight: FlightLog) -> dict[str, Any]:
    """Columns of the table by name, a row per control period."""
    rows = len(flight.t)
    columns: dict[str, Any] = {"t_s": np.round(flight.t, 9)}
    true = np.column_stack([flight.position, flight.euler, flight.nu, flight.water])
    for name, values in zip(_TRUE, true.T, strict=True):
        columns[f"{name}_{_UNIT[name]}"] = _given(values, _UNIT[name])
    columns |= {f"cmd.{name}": values for name, values in flight.commands.items()}
    columns |= {f"meas.{name}": values for name, values in flight.actuators.items()}
    around = flight.circumstances
    for axis, values in zip(("north", "east", "down"), flight.current.T, strict=True):
        columns[f"current_{axis}_m_s"] = values
    if around.voltage_v is not None:
        columns["voltage_v"] = np.full(rows, around.voltage_v)
    if np.isfinite(flight.altitude).all():
        columns["altitude_m"] = flight.altitude
    for name, values in flight.measured.items():
        columns[f"measured.{name}_{_UNIT[name]}"] = _given(values, _UNIT[name])
    for name, unit in _DESIRED_COLUMNS.items():
        columns[f"desired.{name}_{unit}"] = _given(flight.desired[name], unit)
    for name, unit in _ERRORS.items():
        columns[f"error.{name}_{unit}"] = _given(flight.errors[name], unit)
    for k, name in enumerate(_FORCES):
        columns[f"demanded.{name}"] = flight.demanded[:, k]
        columns[f"achieved.{name}"] = flight.achieved[:, k]
    columns |= {"leg": flight.leg, "mode": [flight.modes[k] for k in flight.mode], "reaction": flight.alert}
    columns |= {"distance_m": flight.distance, "power_w": flight.power, "energy_wh": flight.energy_wh}
    return columns | {"battery": flight.battery}


_TRUE = (
    *("x", "y", "z", "roll", "pitch", "yaw"),
    *("u", "v", "w", "p", "q", "r", "u_water", "v_water", "w_water"),
)


def _given(values: Array, unit: str) -> Array:
    """Values in the unit of their column."""
    return values * _DEG if unit.startswith("deg") else values
