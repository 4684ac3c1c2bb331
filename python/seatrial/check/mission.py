"""A mission before it is flown: length, time, energy, and what a vehicle or its autopilot cannot do of it.

What is planned is straight between waypoints, in still water; energy is that of running ahead at the speeds
of the legs, and the hotel load. Held by tests/test_check_mission.py.
"""

from __future__ import annotations

import tomllib
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.check.actuators import NOMINAL_V
from seatrial.check.fence import fence_sentences
from seatrial.check.legs import LegRow, leg_rows
from seatrial.check.mission_turns import turn_sentences
from seatrial.check.turning import turning_radius

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.mission import Mission

__all__ = ["Energy", "MissionCheck", "check_mission", "duration"]


@dataclass(frozen=True)
class Energy:
    """Energy of a mission in W h: driving ahead at the speeds of its legs, hotel load over all of its time.

    ``battery_wh`` is None where the vehicle file tells no battery.
    """

    driving_wh: float
    hotel_wh: float
    battery_wh: float | None

    @property
    def total_wh(self) -> float:
        """Sum of both, W h."""
        return self.driving_wh + self.hotel_wh


@dataclass(frozen=True)
class MissionCheck:
    """What was found about a mission; printed, a page of sentences.

    Attributes
    ----------
    name, description
        Of the mission.
    length_m, planned_s
        Of the planned way.
    waypoints
        How many there are.
    legs
        The legs of the file.
    energy
        None without a vehicle, or where its file tells no power.
    turning_radius_m
        The tightest circle by speed in m/s; None where the vehicle cannot turn at that speed.
    notes, warnings
        Sentences about what is worth knowing, and about what will not go as written.
    """

    name: str
    description: str
    length_m: float
    planned_s: float
    waypoints: int
    legs: tuple[LegRow, ...]
    energy: Energy | None
    turning_radius_m: dict[float, float | None]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """The check as plain data for JSON."""
        data = asdict(self)
        if self.energy is not None:
            data["energy"]["total_wh"] = self.energy.total_wh
        data["turning_radius_m"] = {f"{speed:g}": radius for speed, radius in self.turning_radius_m.items()}
        return data

    def __str__(self) -> str:
        parts = [f"{self.name}: {self.description}".rstrip(": "), *self.notes]
        return "\n".join([*parts, *(f"WARNING {text}" for text in self.warnings)])


def check_mission(
    mission: Mission,
    *,
    vehicle: Vehicle | None = None,
    autopilot: Autopilot | None = None,
    voltage_v: float = NOMINAL_V,
) -> MissionCheck:
    """Check of a mission, by itself or for a vehicle and its autopilot.

    Parameters
    ----------
    mission : Mission
    vehicle : Vehicle, optional
        Tells energy, top speed, turning circle and whether it can keep station.
    autopilot : Autopilot, optional
        Tells largest pitch, speed and rates.
    voltage_v : float
        Supply voltage at which tables of thrust are read, V.

    Raises
    ------
    VehicleError
        The autopilot does not fit the vehicle.

    Examples
    --------
    >>> import seatrial as st
    >>> from seatrial.cli.new import EXAMPLES
    >>> mission = st.Mission.load(EXAMPLES / "missions" / "farm.toml")
    >>> found = check_mission(mission, vehicle=st.Vehicle.load("cwolf"))
    >>> round(found.length_m), found.warnings
    (454, ())
    """
    if vehicle is not None and autopilot is not None:
        autopilot.engage(vehicle, mission.core)
    speeds = [float(speed) for speed in np.unique(mission.waypoints["speed_m_s"])]
    powers = _powers(vehicle, speeds, voltage_v) if vehicle is not None else {}
    rows = leg_rows(mission, powers)
    circles = {u: turning_radius(vehicle, u, voltage_v=voltage_v) for u in speeds} if vehicle else {}
    energy = _energy(vehicle, rows) if vehicle is not None else None
    notes = [*_notes(mission, rows), *_pattern_notes(mission)]
    near, close = fence_sentences(mission)
    notes += near
    warnings = list(close)
    if vehicle is not None:
        from seatrial.check.mission_vehicle import energy_sentences, vehicle_warnings

        told, empty = energy_sentences(vehicle, rows, energy)
        notes += told
        warnings += [*empty, *vehicle_warnings(rows, vehicle, voltage_v)]
    if autopilot is not None:
        from seatrial.check.mission_autopilot import autopilot_warnings

        warnings += autopilot_warnings(mission, rows, autopilot)
    turned, tight = turn_sentences(mission, circles, autopilot)
    return MissionCheck(
        name=mission.name,
        description=mission.description,
        length_m=mission.length,
        planned_s=mission.planned_time,
        waypoints=len(mission.waypoints["label"]),
        legs=rows,
        energy=energy,
        turning_radius_m=circles,
        notes=(*notes, *turned),
        warnings=(*warnings, *tight),
    )


def duration(seconds: float) -> str:
    """Time as people say it.

    Examples
    --------
    >>> duration(42.0), duration(576.3), duration(7300.0)
    ('42 s', '9 min 36 s', '2 h 1 min')
    """
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


def _powers(vehicle: Vehicle, speeds: list[float], voltage_v: float) -> dict[float, float | None]:
    from seatrial.check.performance import cruise

    rows = {speed: cruise(vehicle, speed, voltage_v=voltage_v) for speed in speeds}
    return {speed: row.power_w if row is not None else None for speed, row in rows.items()}


def _energy(vehicle: Vehicle, rows: tuple[LegRow, ...]) -> Energy | None:
    supply = vehicle.power()
    if not supply and all(row.power_w is None for row in rows):
        return None
    driving = sum((row.power_w or 0.0) * (row.time_s - row.hold_s) for row in rows)
    hotel = supply.get("hotel_w", 0.0) * sum(row.time_s for row in rows)
    return Energy(driving / 3600.0, hotel / 3600.0, supply.get("battery_wh"))


def _notes(mission: Mission, rows: tuple[LegRow, ...]) -> list[str]:
    count = len(mission.waypoints["label"])
    notes = [
        f"Path: {mission.length:.0f} m in {duration(mission.planned_time)}, {count} waypoints; straight, at"
        " the speeds of its legs, in still water"
    ]
    index, slope = mission.core.steepest
    if abs(slope) >= np.deg2rad(0.5):
        way = "up" if slope > 0.0 else "down"
        label = mission.waypoints["label"][index]
        notes.append(f'Steepest: {abs(np.rad2deg(slope)):.0f} deg {way} on the way to "{label}"')
    limits = mission.limits
    depths = np.asarray(mission.waypoints["depth_m"])
    if np.isfinite(depths).any():
        limit = "no limit" if np.isinf(limits["max_depth_m"]) else f"limit {limits['max_depth_m']:g} m"
        notes.append(f"Deepest: {np.nanmax(depths):g} m, {limit}")
    altitudes = np.asarray(mission.waypoints["altitude_m"])
    if np.isfinite(altitudes).any():
        limit = f"limit {limits['min_altitude_m']:g} m" if limits["min_altitude_m"] else "no limit"
        notes.append(f"Lowest above the bottom: {np.nanmin(altitudes):g} m, {limit}")
    free = [
        word
        for word, none in (
            ("depth", np.isinf(limits["max_depth_m"])),
            ("time", np.isinf(limits["max_time_s"])),
            ("place", not len(mission.fence)),
        )
        if none
    ]
    if free:
        notes.append(
            f"No limit of {', '.join(free)}: the autopilot has none to watch; give it under [limits]"
        )
    if mission.origin is not None:
        place = mission.geographic([mission.start["north_m"], mission.start["east_m"]])
        notes.append(f"Start: latitude {place[0]:.6f}, longitude {place[1]:.6f} deg")
    return notes


def _pattern_notes(mission: Mission) -> list[str]:
    """What a pattern became: lines and their distance."""
    notes = []
    for number, leg in enumerate(tomllib.loads(mission.to_toml())["legs"], start=1):
        if leg.get("kind") == "lawnmower":
            gaps = max(int(np.ceil(leg["width_m"] / leg["spacing_m"] - 1e-9)), 1)
            apart = leg["width_m"] / gaps
            asked = leg["spacing_m"]
            notes.append(f"Leg {number}: {gaps + 1} lines {apart:.3g} m apart, at most {asked:g} m asked for")
        elif leg.get("kind") == "spiral" and leg.get("spacing_m"):
            turns = abs(leg["end_radius_m"] - leg["start_radius_m"]) / leg["spacing_m"]
            notes.append(f"Leg {number}: a spiral of {turns:.3g} turns, arms {leg['spacing_m']:g} m apart")
    return notes
