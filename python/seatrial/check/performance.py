"""Speed against revolutions, top speed, turning and endurance, from simulations of the vehicle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.check.actuators import NOMINAL_V, command, largest, voltage_for

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["Speed", "Turn", "speeds", "turns"]

Array = NDArray[np.float64]

KNOT_M_S = 1852.0 / 3600.0
_DRIVES = 0.3  # an actuator drives ahead if this share of its thrust points along x
_LONG_S, _SAMPLE_S = 240.0, 0.25
_SHARES = (0.2, 0.4, 0.6, 0.8, 1.0)
_STEADY = 0.02


@dataclass(frozen=True)
class Speed:
    """Steady speed ahead on a straight course; power, endurance and range where the vehicle file tells them.

    ``command`` is the step from neutral in ``unit``; thrust is along x in N at that speed.
    """

    command: float
    unit: str
    speed_m_s: float
    thrust_n: float
    power_w: float | None
    endurance_h: float | None

    @property
    def speed_kn(self) -> float:
        """Speed in knots."""
        return self.speed_m_s / KNOT_M_S

    @property
    def range_km(self) -> float | None:
        """Distance until the battery is empty."""
        return None if self.endurance_h is None else 3.6 * self.speed_m_s * self.endurance_h


@dataclass(frozen=True)
class Turn:
    """A steady turn to starboard in the horizontal plane; the radius is of the path of O."""

    kind: str
    command: float
    unit: str
    radius_m: float
    rate_deg_s: float
    speed_m_s: float


def drivers(vehicle: Vehicle) -> dict[str, float]:
    """Actuators that drive ahead, with the sense (+1, -1) in which they do."""
    matrix = np.asarray(vehicle.allocation_matrix())
    sizes = np.linalg.norm(matrix[:3], axis=0)
    return {
        name: float(np.sign(matrix[0, k]))
        for k, name in enumerate(vehicle.actuators)
        if abs(matrix[0, k]) > _DRIVES * max(sizes[k], 1e-12)
    }


def speeds(vehicle: Vehicle, *, voltage_v: float = NOMINAL_V) -> tuple[Speed, ...]:
    """Steady speeds at shares of the largest command, all that drive ahead together; empty if none does."""
    driving = drivers(vehicle)
    facts = vehicle.actuator_info()
    rows = []
    for share in _SHARES if driving else ():
        commands = {name: command(facts[name], share * sense) for name, sense in driving.items()}
        nu, tau, revolutions = _steady(vehicle, commands, free="X", voltage_v=voltage_v)
        first = next(iter(driving))
        power = _power(vehicle, revolutions)
        rows.append(
            Speed(
                command=share * largest(facts[first], driving[first]),
                unit=str(facts[first]["unit"]),
                speed_m_s=float(nu[0]),
                thrust_n=float(tau[0]),
                power_w=power,
                endurance_h=_endurance(vehicle, power),
            )
        )
    return tuple(rows)


def turns(vehicle: Vehicle, *, voltage_v: float = NOMINAL_V) -> tuple[Turn, ...]:
    """Turns by different thrust on both sides: under way (inner half of outer) and on the spot (opposed)."""
    driving = drivers(vehicle)
    facts = vehicle.actuator_info()
    matrix = np.asarray(vehicle.allocation_matrix())
    yaw = {name: driving[name] * matrix[5, vehicle.actuators.index(name)] for name in driving}
    strongest = max((abs(moment) for moment in yaw.values()), default=0.0)
    if strongest < 1e-3 or not (min(yaw.values()) < 0.0 < max(yaw.values())):
        return ()
    found = []
    for kind, outer, inner in (("under way", 0.5, 0.25), ("on the spot", 0.5, -0.5)):
        shares = {name: (outer if yaw[name] > 0.0 else inner) * sense for name, sense in driving.items()}
        commands = {name: command(facts[name], share) for name, share in shares.items()}
        nu, _, _ = _steady(vehicle, commands, free="XYN", voltage_v=voltage_v)
        speed, rate = float(np.hypot(nu[0], nu[1])), float(nu[5])
        if not np.isfinite(nu).all() or abs(rate) < 1e-4:
            continue
        first = next(iter(driving))
        found.append(
            Turn(
                kind=kind,
                command=outer * largest(facts[first], driving[first]),
                unit=str(facts[first]["unit"]),
                radius_m=speed / abs(rate),
                rate_deg_s=float(np.rad2deg(rate)),
                speed_m_s=speed,
            )
        )
    return tuple(found)


def _steady(
    vehicle: Vehicle, commands: dict[str, float], *, free: str, voltage_v: float
) -> tuple[Array, Array, dict[str, float]]:
    """Mean velocities (6,), wrench (6,) and actuators over the last tenth of a long run from rest."""
    t = np.arange(0.0, _LONG_S, _SAMPLE_S)
    held: dict[str, ArrayLike] = {name: np.full(len(t), value) for name, value in commands.items()}
    run = vehicle.simulate(t, held, free=free, voltage=voltage_for(vehicle, t, voltage_v))
    last = slice(-len(t) // 10, None)
    signals = {name: float(np.asarray(y)[-1]) for name, y in run.actuators.items()}
    return np.asarray(run.nu)[last].mean(axis=0), np.asarray(run.tau)[last].mean(axis=0), signals


def _power(vehicle: Vehicle, revolutions: dict[str, float]) -> float | None:
    """Electrical power in W of all actuators at these revolutions per minute; None where it is not known."""
    facts = vehicle.actuator_info()
    total = 0.0
    for name, value in revolutions.items():
        turning = abs(value - float(facts[name]["neutral"])) > 1e-9
        factor = facts[name]["power_w_s3"]
        if turning and factor is None:
            return None
        total += float(factor or 0.0) * abs(value / 60.0) ** 3
    return total


def _endurance(vehicle: Vehicle, power_w: float | None) -> float | None:
    """Time in h until the battery is empty; None where power or battery are not known."""
    supply = vehicle.power()
    if power_w is None or not supply.get("battery_wh"):
        return None
    return float(supply["battery_wh"] / (power_w + supply.get("hotel_w", 0.0)))
