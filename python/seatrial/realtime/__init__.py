"""Loops with a clock or a peer: the vehicle by steps, ArduPilot's simulator, real time, hardware in the
loop.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.realtime.ardupilot_link import SitlSession as SitlSession
    from seatrial.realtime.ardupilot_link import sitl as sitl
    from seatrial.realtime.plant import Plant as Plant

__all__ = ["Plant", "SitlSession", "sitl"]

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(
        __name__, {"Plant": "plant", "SitlSession": "ardupilot_link", "sitl": "ardupilot_link"}
    )
