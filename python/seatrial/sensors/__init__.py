"""Sensor models: what a vehicle's instruments log of a motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.sensors.log import Surroundings as Surroundings
    from seatrial.sensors.log import measure as measure
    from seatrial.sensors.sensor import Sensor as Sensor
    from seatrial.sensors.sensor import load_sensors as load_sensors

__all__ = ["Sensor", "Surroundings", "load_sensors", "measure"]

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(
        __name__, {"Surroundings": "log", "Sensor": "sensor", "load_sensors": "sensor", "measure": "log"}
    )
