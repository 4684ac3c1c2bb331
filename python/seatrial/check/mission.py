"""A mission before it is flown: length, time, energy, and what a vehicle or its autopilot cannot do of it.

What is planned is straight between waypoints, in still water; energy is that of running ahead at the speeds
of the legs, and the hotel load. Of an autopilot the mode at the speed of a leg decides: with the depth by
pitch a slope is held up to ``pitch_max_deg``; with the depth by heave the desired depth changes at
``depth_rate_max_m_s`` at most.

What a plan on paper promises, a vehicle that turns, drifts and stops may not keep. Each flight takes some
milliseconds, so the check flies with vehicle and autopilot: in still water and in the current that it is
given, or in 0.3 m/s from all four sides. What holds, holds for these waters. Held by
tests/check/test_check_mission.py and tests/check/test_check_flown.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.errors import SimulationError
from seatrial.base.finding import Finding, Severity
from seatrial.base.plain import Plain
from seatrial.base.report import clause_of, report_of
from seatrial.check.file_check import FileCheck, note, warning
from seatrial.check.legs import LegRow, fence_findings, leg_rows, turn_findings
from seatrial.control_design.operating_points import AutopilotFacts, autopilot_facts, mode_at
from seatrial.flight.checks import mismatch
from seatrial.vehicle.actuators import NOMINAL_V, commandable
from seatrial.vehicle.steady_state import cruise, drivers, top_speed, turning_radius, unbounded

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.base.arrays import Array
    from seatrial.flight.flight import Flight
    from seatrial.flight.mission import Mission
    from seatrial.sensors.sensor import Sensor

Velocity = tuple[float, float, float]

PERFECT = "perfect sensors"
"""What a mission is flown with where nothing else is given."""


@dataclass(frozen=True)
class MissionCheckSettings:
    """From where on the plan of a mission is doubted."""

    #: Share of the battery that a careful person brings home.
    reserve_share: float = 0.2
    #: Steepest slope, deg, that is level for anybody.
    level_deg: float = 0.5
    #: deg or m/s: a slope at its limit is not beyond it.
    rounding: float = 1e-6
    #: Current from four sides in which a mission is flown where none is given, m/s: usual in coastal water.
    current_m_s: float = 0.3
    #: Planned time, s, beyond which a mission is not flown: flights with their logs stay below a gigabyte.
    longest_flown_s: float = 4.0 * 3600.0


SETTINGS = MissionCheckSettings()


@dataclass(frozen=True)
class Energy(Plain, also="total_wh"):
    """Energy of a mission in W h: driving ahead at the speeds of its legs, hotel load over all of its time.

    ``battery_wh`` is None where the vehicle file gives no battery.
    """

    driving_wh: float
    hotel_wh: float
    battery_wh: float | None

    @property
    def total_wh(self) -> float:
        """Sum of both, W h."""
        return self.driving_wh + self.hotel_wh


@dataclass(frozen=True)
class FlownCheck:
    """What came of the mission in one water."""

    current: Velocity  #: North, east, down, m/s.
    #: As of `seatrial.flight.flight.Flight`.
    outcome: str
    complete: bool
    #: Waypoints that were reached, and all.
    reached: int
    waypoints: int
    missed: str  #: The first of those that were not.
    #: Of the hull from what stands in the water, and beyond what the mission promises; infinite without.
    clearance_m: float
    reserve_m: float
    #: Of the flight.
    depth_largest_m: float
    duration_s: float
    #: The worst problem in words, of a complete flight whatever is largest; what to do about it.
    worst: str
    remedy: str = ""


@dataclass(frozen=True, repr=False)
class MissionCheck(FileCheck, without="findings", also="notes warnings"):
    """What was found about a mission; printed, a page of sentences."""

    #: Of the planned way.
    length_m: float
    planned_s: float
    waypoints: int  #: How many there are.
    legs: tuple[LegRow, ...]  #: The legs of the file.
    energy: Energy | None  #: None without a vehicle, or where its file gives no power.
    #: The tightest circle by speed in m/s; None where the vehicle cannot turn at that speed.
    turning_radius_m: dict[float, float | None]
    #: What came of it, flown beforehand in still water and in currents; none without vehicle and autopilot.
    flown: tuple[FlownCheck, ...] = ()
    sensors: str = PERFECT  #: With which it was flown, in words.
    remedy: str = ""  #: What to do about the first warning, where a flight shows its cause; empty otherwise.

    def to_dict(self) -> dict[str, Any]:
        """The check as plain data for JSON."""
        radii = {f"{speed:g}": radius for speed, radius in self.turning_radius_m.items()}
        return super().to_dict() | {"turning_radius_m": radii}


def check_mission(
    mission: Mission,
    *,
    vehicle: Vehicle | None = None,
    autopilot: Autopilot | None = None,
    voltage_v: float = NOMINAL_V,
    current: tuple[float, float, float] | None = None,
    sensors: Mapping[str, Sensor] | str | Path | None = None,
    seabed: float | None = None,
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
    current : (float, float, float), optional
        Velocity of the water in which vehicle and autopilot fly it besides still water, north, east, down,
        m/s; 0.3 m/s from four sides when omitted.
    sensors : mapping of str to Sensor, str or Path, optional
        With which they fly it; perfect ones when omitted.
    seabed : float, optional
        Depth of the bottom, m; missions along the bottom are flown with it only.

    Raises
    ------
    VehicleError
        The autopilot does not fit the vehicle.

    Examples
    --------
    >>> import seatrial as st
    >>> from seatrial.cli.new import EXAMPLES
    >>> mission = st.Mission.load(EXAMPLES / "missions" / "farm.toml")
    >>> check = check_mission(mission, vehicle=st.Vehicle.load("cwolf"))
    >>> round(check.length_m), check.warnings
    (536, ())
    """
    if vehicle is not None and autopilot is not None:
        autopilot.engage(vehicle, mission.core)
    speeds = [float(speed) for speed in np.unique(mission.waypoints["speed_m_s"])]
    powers = _powers(vehicle, speeds, voltage_v) if vehicle is not None else {}
    rows = leg_rows(mission, powers)
    circles = {u: turning_radius(vehicle, u, voltage_v=voltage_v) for u in speeds} if vehicle else {}
    energy = _energy(vehicle, rows) if vehicle is not None else None
    # The plan on paper: the mission by itself, then with its vehicle, then with its autopilot.
    planned = [*_path(mission), *_patterns(mission), *fence_findings(mission)]
    if vehicle is not None:
        planned += [*_energy_findings(vehicle, rows, energy), *_vehicle_limits(rows, vehicle, voltage_v)]
    if autopilot is not None:
        planned += _autopilot_limits(mission, rows, autopilot)
    if vehicle is not None:
        planned += _speed_reserve(vehicle, rows, current, voltage_v)
    # The flights, whose failures come before the doubts of the plan.
    flown: tuple[FlownCheck, ...] = ()
    flights: list[Finding] = []
    remedy, fitted = "", PERFECT
    if sensors is not None:
        fitted = f"{sensors if isinstance(sensors, str) else 'given'} sensors"
    if vehicle is not None and autopilot is not None:
        flown, refused = _fly_beforehand(
            mission, vehicle, autopilot, current=current, sensors=sensors, seabed=seabed, voltage_v=voltage_v
        )
        doubt = mismatch(autopilot, vehicle)
        foreign = []
        if doubt is not None:
            foreign.append(warning("made for another vehicle", sentence=clause_of(doubt, "flight_findings")))
        flights = [*foreign, *refused, *_flown_findings(flown, fitted)]
        # A remedy is that of the first warning: of a flight only where nothing stands before it.
        if doubt is None:
            remedy = next((flight.remedy for flight in flown if not flight.complete), "")
    turns = turn_findings(mission, circles, autopilot)
    if flown and all(flight.complete for flight in flown):
        # Turns that were flown well are no reason to warn.
        turns = [replace(finding, severity=Severity.NOTE) for finding in turns]
    notes = [finding for finding in planned if finding.severity == Severity.NOTE]
    doubts = [finding for finding in planned if finding.severity > Severity.NOTE]
    return MissionCheck(
        name=mission.name,
        description=mission.description,
        findings=(*notes, *flights, *doubts, *turns),
        length_m=mission.length,
        planned_s=mission.planned_time,
        waypoints=len(mission.waypoints["label"]),
        legs=rows,
        energy=energy,
        turning_radius_m=circles,
        flown=flown,
        sensors=fitted,
        remedy=remedy,
    )


def _path(mission: Mission) -> list[Finding]:
    """Notes on the path: length, steepest way, levels and their limits, start."""
    points, limits = mission.waypoints, mission.limits
    count = len(points["label"])
    notes = [note("path", length_m=mission.length, time_s=mission.planned_time, waypoints=count)]
    index, slope = mission.core.steepest
    if abs(slope) >= np.deg2rad(SETTINGS.level_deg):
        notes.append(note("steepest", points["label"][index], slope_deg=float(np.rad2deg(slope))))
    depths, altitudes = np.asarray(points["depth_m"]), np.asarray(points["altitude_m"])
    if np.isfinite(depths).any():
        notes.append(note("deepest", depth_m=np.nanmax(depths), limit_m=limits["max_depth_m"]))
    if np.isfinite(altitudes).any():
        notes.append(note("lowest", altitude_m=np.nanmin(altitudes), limit_m=limits["min_altitude_m"]))
    limited = {
        "depth": np.isfinite(limits["max_depth_m"]),
        "time": np.isfinite(limits["max_time_s"]),
        "place": len(mission.fence),
    }
    if free := [name for name, limit in limited.items() if not limit]:
        notes.append(note("no limit", ", ".join(free)))
    if mission.origin is not None:
        place = mission.geographic([mission.start["north_m"], mission.start["east_m"]])
        notes.append(note("start", latitude_deg=place[0], longitude_deg=place[1]))
    return notes


def _patterns(mission: Mission) -> list[Finding]:
    """What patterns became: lines and their distance, turns and that of their arms."""
    notes = []
    for number, leg in enumerate(mission.core.legs, start=1):
        spacing = leg.get("spacing_m")
        if leg.get("kind") == "lawnmower":
            gaps = max(int(np.ceil(leg["width_m"] / spacing - 1e-9)), 1)
            apart = leg["width_m"] / gaps
            notes.append(note("lawnmower", leg=number, lines=gaps + 1, apart_m=apart, asked_m=spacing))
        elif leg.get("kind") == "spiral" and spacing:
            turns = abs(leg["end_radius_m"] - leg["start_radius_m"]) / spacing
            notes.append(note("spiral", leg=number, turns=turns, apart_m=spacing))
    return notes


def _powers(vehicle: Vehicle, speeds: list[float], voltage_v: float) -> dict[float, float | None]:
    """Power at the actuators in W by speed in m/s; None where the vehicle cannot hold it, or has no power."""
    rows = {speed: cruise(vehicle, speed, voltage_v=voltage_v) for speed in speeds}
    return {speed: row.power_w if row is not None else None for speed, row in rows.items()}


def _energy(vehicle: Vehicle, rows: tuple[LegRow, ...]) -> Energy | None:
    """Energy of the legs; None where the vehicle file gives no power."""
    supply = vehicle.power()
    if not supply and all(row.power_w is None for row in rows):
        return None
    driving = sum((row.power_w or 0.0) * (row.time_s - row.hold_s) for row in rows)
    hotel = supply.get("hotel_w", 0.0) * sum(row.time_s for row in rows)
    return Energy(driving / 3600.0, hotel / 3600.0, supply.get("battery_wh"))


def _energy_findings(vehicle: Vehicle, rows: Sequence[LegRow], energy: Energy | None) -> list[Finding]:
    """What the mission takes of the battery, and what is missing from the sum."""
    if energy is None:
        return [note("energy unknown", vehicle.name)]
    battery = energy.battery_wh
    findings = [note("energy", energy=energy)]
    # Speeds that the vehicle cannot keep have no power, and their legs are missing from the sum.
    if silent := sorted({row.speed_m_s for row in rows if row.power_w is None and row.time_s > row.hold_s}):
        findings.append(note("energy without thrusters", speeds_m_s=silent))
    if any(row.hold_s for row in rows):
        findings.append(note("energy of station-keeping"))
    if battery is not None and energy.total_wh > battery:
        findings.append(warning("battery exceeded", total_wh=energy.total_wh, battery_wh=battery))
    elif battery is not None and energy.total_wh > (1.0 - SETTINGS.reserve_share) * battery:
        findings.append(
            warning("battery nearly empty", left_percent=100.0 * (1.0 - energy.total_wh / battery))
        )
    return findings


def _of_leg(kind: str, worst: LegRow, rows: Sequence[LegRow], **values: Any) -> Finding:
    """A warning about a leg, and how many further ones are meant."""
    return warning(kind, worst.label, leg=worst.number, m_s=worst.speed_m_s, further=len(rows) - 1, **values)


def _vehicle_limits(rows: Sequence[LegRow], vehicle: Vehicle, voltage_v: float) -> list[Finding]:
    """What the vehicle cannot do of the mission."""
    if not drivers(vehicle):
        return [warning("nothing drives ahead", vehicle.name)]
    if (fastest := top_speed(vehicle, voltage_v=voltage_v)) is None:
        return [warning("no top speed", sentence=unbounded(vehicle))]
    top = fastest.speed_m_s
    findings = []
    if fast := [row for row in rows if row.speed_m_s > top]:
        worst = max(fast, key=lambda row: row.speed_m_s)
        findings.append(_of_leg("leg too fast", worst, fast, top_m_s=top))
    stations = [row for row in rows if row.hold_s]
    # Station-keeping needs surge, heave and yaw at rest.
    lacking = [row for row in "XZN" if row in commandable(vehicle, 0.0, voltage_v=voltage_v)]
    if stations and lacking:
        rest = {"vehicle": vehicle.name, "lacking": " ".join(lacking)}
        findings.append(_of_leg("no station-keeping", stations[0], stations, **rest))
    asked = sorted({row.speed_m_s for row in rows if row.speed_m_s <= top})
    if unturned := [u for u in asked if "N" in commandable(vehicle, u, voltage_v=voltage_v)]:
        findings.append(warning("cannot turn", vehicle.name, speeds_m_s=unturned))
    return findings


def _speed_reserve(
    vehicle: Vehicle, rows: Sequence[LegRow], current: tuple[float, float, float] | None, voltage_v: float
) -> list[Finding]:
    """Legs whose speed over ground leaves nothing against the current."""
    if current is None or not any(current):
        return []
    if (fastest := top_speed(vehicle, voltage_v=voltage_v)) is None:
        return []
    against, top = float(np.hypot(current[0], current[1])), fastest.speed_m_s
    short = [row for row in rows if row.speed_m_s <= top < row.speed_m_s + against]
    if not short:
        return []
    worst = max(short, key=lambda row: row.speed_m_s)
    return [_of_leg("leg too fast against current", worst, short, current_m_s=against, top_m_s=top)]


def _autopilot_limits(mission: Mission, rows: Sequence[LegRow], autopilot: Autopilot) -> list[Finding]:
    """What the autopilot does not do as the mission is written."""
    facts = autopilot_facts(autopilot)
    fastest, slowest = facts.guidance["speed_max_m_s"], facts.speeds_m_s[0]
    findings = []
    if fast := [row for row in rows if row.speed_m_s > fastest]:
        findings.append(_of_leg("leg above speed limit", fast[0], fast, limit_m_s=fastest))
    if slow := [row for row in rows if row.speed_m_s < slowest]:
        findings.append(_of_leg("leg below breakpoints", slow[0], slow, first_m_s=slowest))
    if not facts.hovers and (stations := [row for row in rows if row.hold_s]):
        radius = facts.guidance["loiter_radius_m"]
        findings.append(_of_leg("no mode keeps station", stations[0], stations, radius_m=radius))
    return [*findings, *_steep(mission, facts)]


def _steep(mission: Mission, facts: AutopilotFacts) -> list[Finding]:
    """Ways that are steeper than the mode at their speed flies them, the worst of each kind."""
    points, guidance = mission.waypoints, facts.guidance
    slopes, speeds = np.asarray(points["slope"]), np.asarray(points["speed_m_s"])
    by = np.array([mode_at(facts, float(speed)).depth_by for speed in speeds])
    angles = np.rad2deg(np.abs(slopes))
    rates = np.where(angles < 90.0 - SETTINGS.rounding, speeds * np.abs(np.sin(slopes)), 0.0)

    def worst(kind: str, mode: str, sizes: Array, limit: float, **values: Any) -> list[Finding]:
        over = np.flatnonzero((by == mode) & (sizes > limit + SETTINGS.rounding))
        if not len(over):
            return []
        k = int(over[np.argmax(sizes[over])])
        numbers = {"size": float(sizes[k]), "limit": limit, "further": len(over) - 1}
        return [warning(kind, points["label"][k], **numbers, **values)]

    circle = None if facts.hovers else guidance["loiter_radius_m"]
    return [
        *worst("way too steep", "pitch", angles, guidance["pitch_max_deg"], circle_m=circle),
        *worst("depth changes too fast", "heave", rates, guidance["depth_rate_max_m_s"]),
    ]


def _fly_beforehand(
    mission: Mission,
    vehicle: Vehicle,
    autopilot: Autopilot,
    *,
    current: Velocity | None = None,
    sensors: Mapping[str, Sensor] | str | Path | None = None,
    seabed: float | None = None,
    voltage_v: float,
) -> tuple[tuple[FlownCheck, ...], list[Finding]]:
    """Flights of a mission in still water and in a `current` (north, east, down, m/s; 0.3 m/s from four sides
    when omitted); without any, why there are none.
    """
    from seatrial.flight.conditions import Conditions, Water
    from seatrial.flight.flight import fly

    if mission.planned_time > SETTINGS.longest_flown_s:
        return (), [note("too long to fly", longest_h=SETTINGS.longest_flown_s / 3600.0)]
    side = SETTINGS.current_m_s
    four = [(side, 0.0, 0.0), (-side, 0.0, 0.0), (0.0, side, 0.0), (0.0, -side, 0.0)]
    flown = []
    for water in [(0.0, 0.0, 0.0), *(four if current is None else [current] if any(current) else [])]:
        try:
            flight = fly(
                vehicle,
                autopilot,
                mission,
                water=Water(current=water, seabed=seabed),
                conditions=Conditions(sensors=sensors, voltage_v=voltage_v),
            )
        except SimulationError as error:
            # Without a bottom, a mission that follows it is not wrong.
            if seabed is None and "altitude" in mission.waypoints["vertical"]:
                return (), [note("not flown", why=str(error))]
            return (), [warning("cannot be flown", why=str(error))]
        flown.append(_checked(flight, water))
    return tuple(flown), []


def _checked(flight: Flight, current: Velocity) -> FlownCheck:
    """What came of a flight."""
    missed = [leg for leg in flight.legs if not leg.reached]
    names = ", ".join(f'"{leg.label}"' for leg in missed[:3])
    # An autopilot of another vehicle is named once, by the check itself.
    report = report_of(flight, doubted=False)
    return FlownCheck(
        current=current,
        outcome=flight.outcome_in_words,
        complete=flight.complete,
        reached=len(flight.legs) - len(missed),
        waypoints=len(flight.legs),
        missed=names + (f" and {len(missed) - 3} more" if len(missed) > 3 else ""),
        clearance_m=flight.metrics["clearance_m"],
        reserve_m=flight.metrics["clearance_reserve_m"],
        depth_largest_m=flight.metrics["depth_largest_m"],
        duration_s=flight.metrics["duration_s"],
        worst=report.worst,
        remedy=report.next_step,
    )


def _flown_findings(flown: tuple[FlownCheck, ...], sensors: str) -> list[Finding]:
    """In which waters the mission went as promised, and in which it did not; `sensors` in words."""
    kept = [flight for flight in flown if flight.complete]
    findings = []
    if kept:
        least = min(flight.clearance_m for flight in kept)
        slowest = max(flight.duration_s for flight in kept)
        currents = [flight.current for flight in kept]
        findings.append(
            note("flown as promised", sensors, currents=currents, clearance_m=least, slowest_s=slowest)
        )
    return findings + [
        warning("not flown as promised", sensors, flight=flight) for flight in flown if not flight.complete
    ]
