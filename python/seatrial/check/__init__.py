"""Checks of files before use: vehicle, autopilot, mission, campaign."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.check.autopilot import check_autopilot as check_autopilot
    from seatrial.check.campaign import check_campaign as check_campaign
    from seatrial.check.mission import check_mission as check_mission
    from seatrial.check.vehicle import check_vehicle as check_vehicle

__all__ = ["check_autopilot", "check_campaign", "check_mission", "check_vehicle"]

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(
        __name__,
        {
            "check_autopilot": "autopilot",
            "check_campaign": "campaign",
            "check_mission": "mission",
            "check_vehicle": "vehicle",
        },
    )
