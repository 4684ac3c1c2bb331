"""Motors as figures show them: groups of actuators that are driven alike, with the numbers of their chain."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.check.actuators import NOMINAL_V, voltage_for

if TYPE_CHECKING:
    from collections.abc import Mapping

    from seatrial._core import Vehicle

__all__ = ["Motor", "behind_motor", "drives", "motors"]

Array = NDArray[np.float64]
Pair = tuple[float, float]

_FAST = 1e9
_USUAL = {"rad": 0.5}


@dataclass(frozen=True)
class Motor:
    """A motor and the actuators that have it; pairs are (ahead, astern), magnitudes from neutral.

    ``unit`` is the command's; limits that are absent are infinite or zero, rates are per second.
    """

    group: str
    actuators: tuple[str, ...]
    unit: str
    neutral: float
    maximum: Pair
    minimum: Pair
    lifts: bool
    n_acc: float
    n_dec: float
    K_V: float
    T_1: float
    T_t: float
    characteristic: str

    @property
    def letter(self) -> str:
        """Letter of the signal: n for revolutions, F for a force, delta for a fin, s for any other."""
        return {"rpm": "n", "N": "F", "rad": r"\delta"}.get(self.unit, "s")

    @property
    def printed_unit(self) -> str:
        """Unit as it is printed."""
        return {"us": "\N{MICRO SIGN}s"}.get(self.unit, self.unit)

    @property
    def limited(self) -> bool:
        """Whether it has a static limit."""
        return math.isfinite(min(self.maximum)) or max(self.minimum) > 0.0

    @property
    def delayed(self) -> bool:
        """Whether it has a rate limit, a lag or a dead time."""
        return math.isfinite(min(self.n_acc, self.n_dec)) or max(self.T_1, self.T_t) > 0.0

    @property
    def largest(self) -> float:
        """Largest command from neutral, either way; a round number where it is not limited."""
        known = [limit for limit in self.maximum if math.isfinite(limit)]
        return max(known) if known else _USUAL.get(self.unit, 2.0 * max(*self.minimum, 50.0))


def motors(vehicle: Vehicle) -> list[Motor]:
    """A `Motor` per group of actuators with equal numbers, in the vehicle's order."""
    facts, values = vehicle.actuator_info(), vehicle.coefficients()
    described = tomllib.loads(vehicle.to_toml())
    tables: Mapping[str, Any] = described.get("motors", {})
    entries = (*described.get("thrusters", ()), *described.get("fins", ()))
    table_of = {entry["name"]: entry.get("motor", "") for entry in entries}
    found: dict[Motor, list[str]] = {}
    for name in vehicle.actuators:
        one, table = facts[name], tables.get(table_of.get(name, ""), {})
        n_acc = values.get(f"{name}.n_acc", float(table.get("n_acc_per_s", math.inf)))
        key = Motor(
            group=str(one["group"]) or name,
            actuators=(),
            unit=str(one["unit"]),
            neutral=float(one["neutral"]),
            maximum=(_limit(one["maximum_ahead"]), _limit(one["maximum_astern"])),
            minimum=(float(one["minimum_ahead"] or 0.0), float(one["minimum_astern"] or 0.0)),
            lifts=table.get("below_minimum", "lift") == "lift",
            n_acc=n_acc,
            n_dec=values.get(f"{name}.n_dec", float(table.get("n_dec_per_s", n_acc))),
            K_V=values.get(f"{name}.K_V", float(table.get("K_V", 1.0))),
            T_1=values.get(f"{name}.T_1", float(table.get("T_1_s", 0.0))),
            T_t=values.get(f"{name}.T_t", float(table.get("T_t_s", 0.0))),
            characteristic="fin" if one["kind"] == "fin" else str(one["characteristic"]),
        )
        found.setdefault(key, []).append(name)
    return [replace(key, actuators=tuple(members)) for key, members in found.items()]


def drives(vehicle: Vehicle) -> list[tuple[list[str], Motor]]:
    """Motors that differ, whatever they drive: names of their groups, and one of them."""
    found: dict[Motor, list[str]] = {}
    for motor in motors(vehicle):
        plain = replace(motor, group="", actuators=(), characteristic="")
        found.setdefault(plain, []).append(motor.group)
    first = {group: motor for motor in reversed(motors(vehicle)) for group in [motor.group]}
    return [(list(dict.fromkeys(groups)), first[groups[0]]) for groups in found.values()]


def behind_motor(
    vehicle: Vehicle,
    motor: Motor,
    t: ArrayLike,
    command: ArrayLike,
    *,
    rate_limit: bool = True,
    lag: bool = True,
) -> Array:
    """Signal (n,) behind a motor, from neutral, for a command (n,) from neutral held from sample to sample.

    The vehicle is tied. The sense is that of the command, whether or not the actuator is mounted reversed.

    Parameters
    ----------
    vehicle : Vehicle
    motor : Motor
    t, command : array, shape (n,)
        Times in s, uniform; command in the motor's unit.
    rate_limit, lag : bool
        Whether the rate limit, and the lag with its dead time, are in the chain.
    """
    name = motor.actuators[0]
    ideal: dict[str, float] = {}
    if not rate_limit:
        ideal |= dict.fromkeys((f"{name}.n_acc", f"{name}.n_dec"), _FAST)
    if not lag:
        ideal |= {f"{name}.K_V": 1.0, f"{name}.T_1": 0.0, f"{name}.T_t": 0.0}
    known = vehicle.coefficients()
    vehicle = vehicle.with_coefficients({key: x for key, x in ideal.items() if key in known})
    times = np.asarray(t, dtype=float)
    sense = -1.0 if vehicle.actuator_info()[name]["reversed"] else 1.0
    run = vehicle.simulate(
        times,
        {name: motor.neutral + sense * np.asarray(command, dtype=float)},
        free="",
        voltage=voltage_for(vehicle, times, NOMINAL_V),
        max_step=0.01,
    )
    return np.asarray(sense * (np.asarray(run.actuators[name]) - motor.neutral))


def _limit(value: float | None) -> float:
    return math.inf if value is None else float(value)
