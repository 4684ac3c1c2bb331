"""How well the control loops and the actuators of a flight did.

The error of a loop is what was desired less what the vehicle really did, over the time in which the loop was
at work. A demand is saturated where it stands at the loop's limit, or where what the actuators reach differs
from it by more than a hundredth of that limit.

Held by ``tests/test_flight.py``.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial._core import autopilot_names

if TYPE_CHECKING:
    from seatrial.flight.flight import Flight

__all__ = ["ActuatorUse", "Loop", "actuators_of", "loops_of", "switches"]

Array = NDArray[np.float64]

_DEG = 180.0 / math.pi
_UNITS = (("m/s", "N"), ("m/s", "N"), ("m", "N"), ("deg", "N m"), ("deg", "N m"), ("deg", "N m"))
_AT_LIMIT, _SHORT = 0.999, 0.01


@dataclass(frozen=True)
class Loop:
    """A control loop over the time in which it was at work.

    Attributes
    ----------
    name, time_s
        Its name and for how long it was at work.
    error_unit, error_rms, error_largest
        Desired less true.
    demand_unit, demand_rms, demand_largest
        What it asked of the actuators.
    saturated
        Share of its time in which the demand was limited, or reached in part only.
    """

    name: str
    time_s: float
    error_unit: str
    error_rms: float
    error_largest: float
    demand_unit: str
    demand_rms: float
    demand_largest: float
    saturated: float

    def to_dict(self) -> dict[str, Any]:
        """The same as plain data."""
        return asdict(self)


@dataclass(frozen=True)
class ActuatorUse:
    """What was asked of an actuator.

    Attributes
    ----------
    name, unit
        Its name and the unit of its command.
    rms, largest
        Of the command from neutral.
    at_limit, running
        Share of the time at its largest command, and away from neutral.
    switches_per_minute
        Starts and stops: how often the command went to or from neutral.
    """

    name: str
    unit: str
    rms: float
    largest: float
    at_limit: float
    running: float
    switches_per_minute: float

    def to_dict(self) -> dict[str, Any]:
        """The same as plain data."""
        return asdict(self)


def loops_of(flight: Flight) -> dict[str, Loop]:
    """Figures of the loops that were at work, by name."""
    tables = tomllib.loads(flight.autopilot.to_toml())["loops"]
    found = {}
    for i, name in enumerate(autopilot_names()["loops"]):
        rows = flight.active[:, i]
        if not rows.any():
            continue
        error_unit, demand_unit = _UNITS[i]
        scale = _DEG if error_unit == "deg" else 1.0
        error, demand = scale * flight.errors[name][rows], flight.demanded[rows, i]
        reached = flight.achieved[rows, i]
        limit = float(tables.get(name, {}).get("tau_max", np.max(np.abs(demand))))
        limited = np.abs(demand) >= _AT_LIMIT * limit
        short = np.abs(demand - reached) > _SHORT * limit
        found[name] = Loop(
            name=name,
            time_s=float(rows.sum() * flight.period_s),
            error_unit=error_unit,
            error_rms=_rms(error),
            error_largest=float(np.max(np.abs(error))),
            demand_unit=demand_unit,
            demand_rms=_rms(demand),
            demand_largest=float(np.max(np.abs(demand))),
            saturated=float(np.mean((limited | short) & (limit > 0.0))),
        )
    return found


def actuators_of(flight: Flight) -> dict[str, ActuatorUse]:
    """What was asked of every actuator, by name."""
    facts = flight.vehicle.actuator_info()
    found = {}
    minutes = max(float(flight.t[-1] - flight.t[0]), 1e-9) / 60.0
    for name, commands in flight.commands.items():
        fact = facts[name]
        away = commands - float(fact["neutral"])
        signal = -away if fact["reversed"] else away
        limit = np.where(signal < 0.0, float(fact["maximum_astern"]), float(fact["maximum_ahead"]))
        found[name] = ActuatorUse(
            name=name,
            unit=str(fact["unit"]),
            rms=_rms(away),
            largest=float(np.max(np.abs(away))),
            at_limit=float(np.mean((np.abs(away) >= _AT_LIMIT * limit) & (limit > 0.0))),
            running=float(np.mean(running(away))),
            switches_per_minute=switches(away) / minutes,
        )
    return found


def running(away: Array) -> NDArray[np.bool_]:
    """Where a command (n,), from neutral, is none of neutral's."""
    return np.asarray(np.abs(away) > 1e-9)


def switches(away: Array) -> int:
    """Starts and stops of a command (n,), from neutral."""
    return int(np.count_nonzero(np.diff(running(away).astype(int))))


def _rms(values: Array) -> float:
    with np.errstate(over="ignore"):  # a flight that diverges ends in numbers without bounds
        return float(np.sqrt(np.mean(values**2)))
