"""What a flight was exposed to: water, sensors, failures, and the vehicle that the autopilot believes in."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from seatrial.flight.failures import Fault, Outage

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["TURBULENCE_TIMES_S", "Circumstances"]

TURBULENCE_TIMES_S = (60.0, 2.0)
"""Correlation time of a turbulent current, and the time in which eddies average out along the hull, s."""


@dataclass(frozen=True)
class Circumstances:
    """What a flight was exposed to.

    Attributes
    ----------
    current
        Mean, north, east, down, m/s.
    turbulence, turbulence_times
        Standard deviation of the current about its mean, m/s, and its two time constants, s.
    obstacles
        What stands in the water: north, east and radius of each cylinder, m.
    sensors
        Name of the set, and per kind its numbers; perfect ones without kinds.
    sensor_notes
        Where the sensors of the flight differ from those of the set.
    faults, outages
        What failed.
    seabed
        Depth of the bottom below the origin, m, and its slopes north and east; None: no bottom.
    seed
        Of the sensors' noise.
    model
        The vehicle that the autopilot believes in.
    voltage
        Supply, V; None where it does not matter.
    feedback
        Whether the autopilot sees what its actuators do.
    rho, g
        Density and gravity where they are not the vehicle file's.
    max_step, max_time
        Largest step of the integration and longest duration, s.
    sources
        Names or paths that were asked for, by "vehicle", "autopilot", "mission".
    """

    current: tuple[float, float, float]
    model: Vehicle
    max_step: float
    max_time: float
    turbulence: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turbulence_times: tuple[float, float] = TURBULENCE_TIMES_S
    obstacles: tuple[tuple[float, float, float], ...] = ()
    sensors: dict[str, Any] = field(default_factory=dict)
    sensor_notes: tuple[str, ...] = ()
    faults: tuple[Fault, ...] = ()
    outages: tuple[Outage, ...] = ()
    seabed: tuple[float, float, float] | None = None
    seed: int = 0
    voltage: float | None = None
    feedback: bool = True
    rho: float | None = None
    g: float | None = None
    sources: dict[str, str] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """The same as plain data; the model by its name."""
        return {
            "sources": dict(self.sources),
            "model": self.model.name,
            "current_m_s": list(self.current),
            "turbulence_m_s": list(self.turbulence),
            "turbulence_times_s": list(self.turbulence_times),
            "obstacles_m": [list(one) for one in self.obstacles],
            "sensors": self.sensors or "perfect",
            "sensor_notes": list(self.sensor_notes),
            "faults": [asdict(fault) for fault in self.faults],
            "outages": [asdict(outage) for outage in self.outages],
            "seabed": None if self.seabed is None else list(self.seabed),
            "seed": self.seed,
            "voltage_v": self.voltage,
            "feedback": self.feedback,
            "rho_kg_m3": self.rho,
            "g_m_s2": self.g,
            "max_step_s": self.max_step,
            "max_time_s": self.max_time,
        }
