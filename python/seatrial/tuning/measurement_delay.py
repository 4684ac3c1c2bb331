"""How old the measurements are that each loop closes on, on the average: a dead time of the linear loop.

A sensor tells what was latency_s ago, and holds it until its next sample: 1/rate_hz later, so that the hold
adds half of that on the average. Sample and hold is taken as this dead time: its phase is the same, its fall
in magnitude is left out. A loop counts with the older of its measurements, of what it holds and of that
one's rate. A sensor without rate_hz is as fast as the control period. Source: Åström and Wittenmark,
*Computer-Controlled Systems* (1997), section 2. Held by tests/test_margin_sensors.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from seatrial.flight.sensor_channels import sensors_of

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.sensors.sensor import Sensor

__all__ = ["measurement_delays"]

_READ = {
    "surge": ("dvl",),
    "sway": ("dvl",),
    "heave": ("depth", "dvl"),
    "roll": ("attitude", "gyro"),
    "pitch": ("attitude", "gyro"),
    "heading": ("attitude", "gyro"),
}
"""Per loop the kinds of sensor that it closes on: of what it holds, and of its rate."""


def measurement_delays(
    sensors: Mapping[str, Sensor] | str | Path | None, vehicle: Vehicle
) -> dict[str, float]:
    """Mean age in s of the measurements of each loop, the older of those that it closes on.

    Parameters
    ----------
    sensors : mapping of str to Sensor, "typical" or a file, optional
        By kind; nothing is late where they are perfect (None), nor where a kind is missing.
    vehicle : Vehicle
        The one that carries them.

    Raises
    ------
    TrialError
        The file or a kind is not usable.

    Examples
    --------
    >>> import seatrial as st
    >>> found = measurement_delays("typical", st.Vehicle.load("cwolf"))
    >>> {loop: round(late, 3) for loop, late in found.items() if loop in ("surge", "heading")}
    {'surge': 0.22, 'heading': 0.07}
    """
    there = sensors_of(sensors, vehicle) or {}
    return {
        loop: max((_age(there[kind]) for kind in kinds if kind in there), default=0.0)
        for loop, kinds in _READ.items()
    }


def _age(sensor: Sensor) -> float:
    """Mean age of what a sensor shows, s."""
    return sensor.latency_s + (0.0 if sensor.rate_hz is None else 0.5 / sensor.rate_hz)
