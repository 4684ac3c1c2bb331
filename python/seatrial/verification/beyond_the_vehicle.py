"""Notes on what no autopilot could fly: missions cut short, speeds and currents beyond the top speed.

A verdict on such a campaign is one on the campaign. The top speed is that of the identified vehicle straight
ahead (`seatrial.control_design.mode_table`), at the table's supply voltage.

Tests: ``tests/test_verification_messages.py``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from seatrial.check.actuators import NOMINAL_V

if TYPE_CHECKING:
    from seatrial.verification.campaign_flights import CampaignFlights
    from seatrial.verification.cases import Cases
    from seatrial.verification.flown_missions import FlownMissions

__all__ = ["beyond_the_vehicle"]

_MANY = 0.5
"""Share of the missions without an end from which their time is spoken of."""


def beyond_the_vehicle(flights: CampaignFlights, cases: Cases, flown: FlownMissions) -> tuple[str, ...]:
    """Sentences on missions that time, speed or current keep from being flown, whatever the autopilot does.

    Parameters
    ----------
    flights : CampaignFlights
        What was flown.
    cases : Cases
        What was drawn.
    flown : FlownMissions
        What came of it, of the same numbers.
    """
    return (*_time(flights, flown), *_speed(flights, cases))


def _time(flights: CampaignFlights, flown: FlownMissions) -> list[str]:
    late = flown.figures["ending"] == "out of time"
    count = int(np.count_nonzero(late))
    if count < _MANY * len(flown):
        return []
    given = flights.table.max_time_s
    planned = max(flights.missions[k].planned_time for k in np.unique(flown.mission[late]).tolist())
    limit = "the longest time allowed" if given is None else f"max_time_s = {given:g}"
    return [
        f"{count} of {len(flown)} missions end out of time, by {limit}; flying them is planned to take"
        f" {planned:.0f} s."
    ]


def _speed(flights: CampaignFlights, cases: Cases) -> list[str]:
    from seatrial.control_design.mode_table import top_speeds

    vehicle = flights.fitted.vehicle
    top = top_speeds(vehicle, voltage_v=flights.table.voltage_v or NOMINAL_V)[1]
    if top <= 0.0:
        return []
    said = []
    for title, mission in zip(flights.titles, flights.missions, strict=True):
        asked = float(np.max(mission.waypoints["speed_m_s"]))
        if asked > top:
            said.append(
                f"{title} asks for {asked:g} m/s, more than the top speed of {vehicle.name}, {top:.2f} m/s."
            )
    fast = int(np.count_nonzero(np.hypot(cases.current[:, 0], cases.current[:, 1]) > top))
    if fast:
        said.append(
            f"In {fast} of {len(cases)} missions the current is faster than the top speed of {vehicle.name},"
            f" {top:.2f} m/s."
        )
    return said
