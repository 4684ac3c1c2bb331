"""Loops with a clock or a peer: the vehicle by steps, ArduPilot's simulator, real time, hardware in the
loop.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.realtime.ardupilot_link import SitlSession as SitlSession
    from seatrial.realtime.ardupilot_link import sitl as sitl
    from seatrial.realtime.flight import RealtimeFlight as RealtimeFlight
    from seatrial.realtime.flight import fly_realtime as fly_realtime
    from seatrial.realtime.hardware import Hardware as Hardware
    from seatrial.realtime.hardware import command_packet as command_packet
    from seatrial.realtime.hardware import sensor_packet as sensor_packet
    from seatrial.realtime.live import Live as Live
    from seatrial.realtime.plant import Plant as Plant

_HOMES = {
    "Hardware": "hardware",
    "Live": "live",
    "Plant": "plant",
    "RealtimeFlight": "flight",
    "SitlSession": "ardupilot_link",
    "command_packet": "hardware",
    "fly_realtime": "flight",
    "sensor_packet": "hardware",
    "sitl": "ardupilot_link",
}

__all__ = sorted(_HOMES)

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(__name__, _HOMES)
