"""Plates of the gallery on the autopilot: its structure, the line of sight, and a flight with its mission.

Held by `tests/test_flight_figures.py`.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

from seatrial.errors import SeatrialError
from seatrial.plot.plates import Plate

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.flight.flight import Flight

__all__ = ["autopilot_plates", "demonstration", "flight_plates"]

_MISSION = """
format = 1
name = "box with a dive"
speed_m_s = {speed:.3f}
acceptance_radius_m = {radius:.3f}
[[legs]]
north_m = {side:.1f}
east_m = 0.0
depth_m = 10.0
[[legs]]
north_m = {side:.1f}
east_m = {side:.1f}
depth_m = 10.0
[[legs]]
north_m = 0.0
east_m = {side:.1f}
depth_m = 5.0
[[legs]]
north_m = 0.0
east_m = 0.0
depth_m = 5.0
"""
_SPEED_SHARE, _FASTEST_M_S = 0.6, 1.5
_CURRENT_SHARE, _STRONGEST_M_S = 0.2, 0.3
_LEG_S, _RADIUS_S = 80.0, 3.0


def autopilot_plates(vehicle: Vehicle) -> Iterator[Plate]:
    """Plates of the autopilot, and of a flight where there is a built-in one of the vehicle's name."""
    from seatrial._core import Autopilot
    from seatrial.plot.control_structure import control_structure
    from seatrial.plot.guidance_geometry import guidance_geometry

    if not vehicle.actuators:
        yield Plate("control_structure", f"{vehicle.name} has no actuators, so nothing is controlled", None)
        return
    yield Plate(
        "control_structure",
        "Structure of the autopilot: guidance, reference filters, decoupled adaptive PID controllers,"
        " allocation and inverse characteristic, with the mode table and safety; below, one controller with"
        " scheduled gains, derivative on the measurement, anti-windup, reset bias and feed-forward.",
        control_structure,
    )
    yield Plate(
        "guidance",
        "Line of sight in both planes: cross-track error (positive to starboard), vertical error (positive"
        " below), lookahead distance, desired heading and pitch, sphere and plane of acceptance.",
        guidance_geometry,
    )
    if vehicle.name not in Autopilot.names():
        yield Plate("flight_track", f"no flight: {vehicle.name} has no built-in autopilot", None)
        return
    try:
        flight = demonstration(vehicle)
    except SeatrialError as error:
        yield Plate("flight_track", f"no flight: {error}", None)
        return
    yield from flight_plates(flight)


def demonstration(vehicle: Vehicle) -> Flight:
    """Flight of a box with a dive in a cross current by the vehicle's built-in autopilot.

    Raises
    ------
    SeatrialError
        The autopilot does not fit the vehicle, or nothing drives it ahead.
    """
    from seatrial._core import Autopilot
    from seatrial.check.actuators import NOMINAL_V
    from seatrial.check.performance import drivers, speeds
    from seatrial.flight.fly import fly
    from seatrial.mission import Mission

    if not drivers(vehicle):
        raise SeatrialError(f"nothing drives {vehicle.name} ahead")
    top = speeds(vehicle, shares=[1.0])[-1].speed_m_s
    speed = min(_SPEED_SHARE * top, _FASTEST_M_S)
    current = min(_CURRENT_SHARE * speed, _STRONGEST_M_S)
    text = _MISSION.format(speed=speed, side=_LEG_S * speed, radius=max(_RADIUS_S * speed, 1.0))
    needed = any(facts["needs_voltage"] for facts in vehicle.actuator_info().values())
    return fly(
        vehicle,
        Autopilot.load(vehicle.name),
        Mission.from_toml(text),
        current=(0.0, current, 0.0),
        voltage=NOMINAL_V if needed else None,
    )


def flight_plates(flight: Flight) -> Iterator[Plate]:
    """Plates of a flight: mission, track, errors, loops, actuators."""
    from seatrial.plot.flight_actuators import flight_actuators
    from seatrial.plot.flight_errors import flight_errors
    from seatrial.plot.flight_loops import flight_loops
    from seatrial.plot.flight_track import flight_track
    from seatrial.plot.mission_plan import mission_plan

    data = f"Data: simulated flight of {flight.vehicle.name} on the mission {flight.mission.name}."
    yield Plate(
        "mission",
        f"Mission {flight.mission.name} as planned: view from above and profile along the way.",
        partial(mission_plan, flight.mission, seabed=flight.circumstances.seabed),
    )
    yield Plate(
        "flight_track",
        f"Track of the flight beside the planned path, and depth over time. {data}",
        partial(flight_track, flight),
    )
    yield Plate(
        "flight_errors",
        "Cross-track and vertical error over time; shaded, the second half of each straight leg, over which"
        f" the errors are distributed as at the right (line: mean; dashed: 95 %). {data}",
        partial(flight_errors, flight),
    )
    yield Plate(
        "flight_loops",
        "Control loops: desired and actual values, demanded forces and moments and what the allocation"
        f" reached of them, modes. {data}",
        partial(flight_loops, flight),
    )
    yield Plate(
        "flight_actuators",
        f"Commands and signals of the actuators with their limits, and electrical power. {data}",
        partial(flight_actuators, flight),
    )
