"""A mission before it is flown: length, time, energy, and what a vehicle or its autopilot cannot do of it.

What is planned is straight between waypoints, in still water; energy is that of running ahead at the speeds
of the legs, and the hotel load. Of an autopilot the mode at the speed of a leg decides: with the depth by
pitch a slope is held up to ``pitch_max_deg``; with the depth by heave the desired depth changes at
``depth_rate_max_m_s`` at most. With vehicle and autopilot the mission is flown (`seatrial.check.flown`). Held
by tests/check/test_check_mission.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.report import Report, Reported, Section
from seatrial.check.flown import FlownCheck, flown_sentences, flown_table, fly_beforehand
from seatrial.check.legs import LegRow, fence_sentences, leg_rows, legs_table, turn_sentences
from seatrial.control_design.operating_points import AutopilotFacts, autopilot_facts, mode_at
from seatrial.flight.mismatch import mismatch
from seatrial.vehicle.actuators import NOMINAL_V
from seatrial.vehicle.steady_state import turning_radius

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.flight.mission import Mission
    from seatrial.sensors.sensor import Sensor

_LEFT = 0.2  # share of the battery that a careful person brings home


def energy_sentences(
    vehicle: Vehicle, rows: Sequence[LegRow], energy: Energy | None
) -> tuple[list[str], list[str]]:
    """Notes and warnings about the energy of a mission."""
    if energy is None:
        return [f"Energy: unknown, as the file of {vehicle.name} gives neither power_w_s3 nor [power]"], []
    # Speeds that the vehicle cannot keep have no power, and their legs are missing from the sum.
    silent = sorted({row.speed_m_s for row in rows if row.power_w is None and row.time_s > row.hold_s})
    parts = f"{energy.driving_wh:.1f} W h driving, {energy.hotel_wh:.1f} W h hotel load"
    notes = [f"Energy: {energy.total_wh:.1f} W h ({parts})"]
    if silent:
        spoken = ", ".join(f"{speed:g}" for speed in silent)
        notes.append(f"Energy: without the thrusters at {spoken} m/s, for which the model gives no power")
    if any(row.hold_s for row in rows):
        notes.append("Energy: station-keeping counts with the hotel load alone")
    if energy.battery_wh is None:
        return notes, []
    notes[0] += (
        f", {100.0 * energy.total_wh / energy.battery_wh:.0f} % of the {energy.battery_wh:g} W h of the"
        " battery"
    )
    if energy.total_wh > energy.battery_wh:
        return notes, [
            f"the mission takes {energy.total_wh:.0f} W h, more than the battery holds ({energy.battery_wh:g}"
            " W h); shorten the mission or fly slower"
        ]
    if energy.total_wh > (1.0 - _LEFT) * energy.battery_wh:
        left = 100.0 * (1.0 - energy.total_wh / energy.battery_wh)
        return notes, [
            f"only {left:.0f} % of the battery is left at the end in still water; a current takes more"
        ]
    return notes, []


def vehicle_warnings(rows: Sequence[LegRow], vehicle: Vehicle, voltage_v: float) -> list[str]:
    """Sentences about what the vehicle cannot do of the mission."""
    from seatrial.vehicle.authority import commandable
    from seatrial.vehicle.steady_state import drivers, top_speed, unbounded

    if not drivers(vehicle):
        return [f"no actuator of {vehicle.name} drives ahead"]
    if (fastest := top_speed(vehicle, voltage_v=voltage_v)) is None:
        return [unbounded(vehicle)]
    top = fastest.speed_m_s
    fast = [row for row in rows if row.speed_m_s > top]
    sentences = []
    if fast:
        worst = max(fast, key=lambda row: row.speed_m_s)
        sentences.append(
            f'leg {worst.number} "{worst.label}" asks for {worst.speed_m_s:g} m/s, more than the top speed of'
            f" {top:.2f} m/s{_others(fast)}; fly slower"
        )
    held = [row for row in rows if row.hold_s]
    # Station-keeping needs surge, heave and yaw at rest.
    lacking = [row for row in "XZN" if row in commandable(vehicle, 0.0, voltage_v=voltage_v)]
    if held and lacking:
        sentences.append(
            f'leg {held[0].number} "{held[0].label}" asks for station-keeping, and {vehicle.name} commands no'
            f" {' '.join(lacking)} at rest{_others(held)}; it circles there instead; better plan"
            " circle_radius_m and turns"
        )
    asked = sorted({row.speed_m_s for row in rows if row.speed_m_s <= top})
    unturned = [speed for speed in asked if not _turns(vehicle, speed, voltage_v)]
    if unturned:
        spoken = ", ".join(f"{speed:g}" for speed in unturned)
        sentences.append(f"{vehicle.name} cannot turn while it runs at {spoken} m/s; fly slower or faster")
    return sentences


def speed_reserve(
    vehicle: Vehicle, rows: Sequence[LegRow], current: tuple[float, float, float] | None, voltage_v: float
) -> list[str]:
    """Sentence about legs whose speed over ground leaves nothing against the current."""
    from seatrial.vehicle.steady_state import top_speed

    if current is None or not any(current):
        return []
    if (fastest := top_speed(vehicle, voltage_v=voltage_v)) is None:
        return []
    against, top = float(np.hypot(current[0], current[1])), fastest.speed_m_s
    if short := [row for row in rows if row.speed_m_s <= top < row.speed_m_s + against]:
        worst = max(short, key=lambda row: row.speed_m_s)
        return [
            f'leg {worst.number} "{worst.label}" asks for {worst.speed_m_s:g} m/s over ground; against the'
            f" current of {against:.2g} m/s that is {worst.speed_m_s + against:.2f} m/s through the water,"
            f" more than the top speed of {top:.2f} m/s{_others(short)}; fly slower than"
            f" {max(top - against, 0.0):.2f} m/s"
        ]
    return []


def _turns(vehicle: Vehicle, speed: float, voltage_v: float) -> bool:
    from seatrial.vehicle.authority import commandable

    return "N" not in commandable(vehicle, speed, voltage_v=voltage_v)


def _others(rows: Sequence[LegRow]) -> str:
    """How many further legs are meant."""
    more = len(rows) - 1
    return f" (and {more} further {'leg' if more == 1 else 'legs'})" if more else ""


_ROUNDING = 1e-6  # deg or m/s: a slope at its limit is not beyond it


def autopilot_warnings(mission: Mission, rows: Sequence[LegRow], autopilot: Autopilot) -> list[str]:
    """Sentences about what the autopilot does not do as the mission is written."""
    facts = autopilot_facts(autopilot)
    guidance = facts.guidance
    sentences = []
    fastest = guidance["speed_max_m_s"]
    if fast := [row for row in rows if row.speed_m_s > fastest]:
        sentences.append(
            f'leg {fast[0].number} "{fast[0].label}" asks for {fast[0].speed_m_s:g} m/s, and speed_max_m_s of'
            f" the autopilot is {fastest:g}; it flies at that speed"
        )
    slowest = facts.speeds_m_s[0]
    if slow := [row for row in rows if row.speed_m_s < slowest]:
        sentences.append(
            f'leg {slow[0].number} "{slow[0].label}" asks for {slow[0].speed_m_s:g} m/s, below the first'
            f" breakpoint of the gains at {slowest:g} m/s; fly faster"
        )
    if not facts.hovers and (held := [row for row in rows if row.hold_s]):
        sentences.append(
            f'leg {held[0].number} "{held[0].label}" asks for station-keeping, and no mode of the autopilot'
            f" keeps the depth by heave: it circles at loiter_radius_m = {guidance['loiter_radius_m']:g} m"
        )
    return [*sentences, *_steep(mission, facts)]


def _steep(mission: Mission, facts: AutopilotFacts) -> list[str]:
    """Ways that are steeper than the mode at their speed flies them, the worst of each kind."""
    points, guidance = mission.waypoints, facts.guidance
    slopes, speeds = np.asarray(points["slope"]), np.asarray(points["speed_m_s"])
    by = np.array([mode_at(facts, float(speed)).depth_by for speed in speeds])
    sentences = []
    angles = np.rad2deg(np.abs(slopes))
    largest = guidance["pitch_max_deg"]
    steep = np.flatnonzero((by == "pitch") & (angles > largest + _ROUNDING))
    if len(steep):
        k = int(steep[np.argmax(angles[steep])])
        end = "on the spot" if facts.hovers else f"in circles of {guidance['loiter_radius_m']:g} m"
        sentences.append(
            f'the way to "{points["label"][k]}" is {angles[k]:.0f} deg steep, more than pitch_max_deg ='
            f" {largest:g}{_further(steep)}: the rest of its depth is made {end}; begin earlier or"
            " lengthen the leg"
        )
    rates = np.where(angles < 90.0 - _ROUNDING, speeds * np.abs(np.sin(slopes)), 0.0)
    limit = guidance["depth_rate_max_m_s"]
    quick = np.flatnonzero((by == "heave") & (rates > limit + _ROUNDING))
    if len(quick):
        k = int(quick[np.argmax(rates[quick])])
        sentences.append(
            f'the way to "{points["label"][k]}" changes the depth at {rates[k]:.2f} m/s, faster than'
            f" depth_rate_max_m_s = {limit:g}{_further(quick)}; it lags, fly slower or lengthen the leg"
        )
    return sentences


def _further(ways: Any) -> str:
    more = len(ways) - 1
    return f" (and {more} further {'way' if more == 1 else 'ways'})" if more else ""


@dataclass(frozen=True)
class Energy:
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


@dataclass(frozen=True, repr=False)
class MissionCheck(Reported):
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
        None without a vehicle, or where its file gives no power.
    turning_radius_m
        The tightest circle by speed in m/s; None where the vehicle cannot turn at that speed.
    notes, warnings
        Sentences about what is worth knowing, and about what will not go as written.
    flown
        What came of it, flown beforehand in still water and in currents; none without vehicle and autopilot.
    sensors
        With which it was flown, in words.
    remedy
        What to do about the first warning, where a flight shows its cause; empty otherwise.
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
    flown: tuple[FlownCheck, ...] = ()
    sensors: str = "perfect sensors"
    remedy: str = ""

    def to_dict(self) -> dict[str, Any]:
        """The check as plain data for JSON."""
        data = asdict(self)
        if self.energy is not None:
            data["energy"]["total_wh"] = self.energy.total_wh
        data["turning_radius_m"] = {f"{speed:g}": radius for speed, radius in self.turning_radius_m.items()}
        return data

    def report(self) -> Report:
        """Length and time, the worst problem, what to do next; then legs and notes."""
        worst, next_step = "nothing stands out: legs, limits and fence fit each other", "fly it: seatrial fly"
        if self.flown:
            worst = f"nothing stands out in {self.flown[0].water}"
            if len(self.flown) > 1:
                waters = "currents from four sides" if len(self.flown) > 2 else self.flown[1].water
                worst += f" and in {waters}"
        if self.warnings:
            worst = self.warnings[0]
            next_step = self.remedy or "change the mission or the vehicle's limits, and check again"
        count = len(self.warnings)
        energy = "" if self.energy is None else f", {self.energy.total_wh:.3g} Wh"
        return Report(
            title=self.name,
            outcome=f"{count} warning{'s' if count > 1 else ''}" if count else "nothing looks wrong",
            good=(
                f"{_waypoints(self.waypoints)}, {self.length_m:.0f} m, planned to take"
                f" {duration(self.planned_s)}{energy}"
            ),
            worst=worst,
            next_step=next_step,
            sections=(
                Section(
                    self.description,
                    (*(f"WARNING: {text}" for text in self.warnings), *self.notes),
                    (
                        legs_table(self.legs, duration),
                        *((flown_table(self.flown, self.sensors),) if self.flown else ()),
                    ),
                ),
            ),
        )


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
    >>> found = check_mission(mission, vehicle=st.Vehicle.load("cwolf"))
    >>> round(found.length_m), found.warnings
    (536, ())
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
        beside, empty = energy_sentences(vehicle, rows, energy)
        notes += beside
        warnings += [*empty, *vehicle_warnings(rows, vehicle, voltage_v)]
    if autopilot is not None:
        warnings += autopilot_warnings(mission, rows, autopilot)
    flown: tuple[FlownCheck, ...] = ()
    remedy = ""
    fitted = "perfect sensors"
    if sensors is not None:
        fitted = f"{sensors} sensors" if isinstance(sensors, str) else "given sensors"
    if vehicle is not None:
        warnings += speed_reserve(vehicle, rows, current, voltage_v)
    if vehicle is not None and autopilot is not None:
        flown, left_out, refused = fly_beforehand(
            mission, vehicle, autopilot, current=current, sensors=sensors, seabed=seabed, voltage_v=voltage_v
        )
        beside, short = flown_sentences(flown, fitted)
        notes += [*left_out, *beside]
        doubt = mismatch(autopilot, vehicle)
        failed = next((flight for flight in flown if not flight.complete), None)
        # It is of the first warning, and that is of a flight where nothing stands before it.
        remedy = failed.remedy if failed is not None and not doubt and not refused else ""
        warnings = [*([doubt] if doubt else []), *refused, *short, *warnings]
    turned, tight = turn_sentences(mission, circles, autopilot)
    flown_well = bool(flown) and all(flight.complete for flight in flown)
    return MissionCheck(
        name=mission.name,
        description=mission.description,
        length_m=mission.length,
        planned_s=mission.planned_time,
        waypoints=len(mission.waypoints["label"]),
        legs=rows,
        energy=energy,
        turning_radius_m=circles,
        # Turns that were flown well are no reason to warn.
        notes=(*notes, *turned, *(tight if flown_well else ())),
        warnings=(*warnings, *(() if flown_well else tight)),
        flown=flown,
        sensors=fitted,
        remedy=remedy,
    )


def _waypoints(count: int) -> str:
    return f"{count} waypoint{'' if count == 1 else 's'}"


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
    from seatrial.vehicle.steady_state import cruise

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
        f"Path: {mission.length:.0f} m in {duration(mission.planned_time)}, {_waypoints(count)}; straight, at"
        " the speeds of its legs, in still water"
    ]
    index, slope = mission.core.steepest
    # Less is level for anybody.
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
            f"No limit of {', '.join(free)}: the mission sets none, so the autopilot watches none;"
            " add it under [limits]"
        )
    if mission.origin is not None:
        place = mission.geographic([mission.start["north_m"], mission.start["east_m"]])
        notes.append(f"Start: latitude {place[0]:.6f}, longitude {place[1]:.6f} deg")
    return notes


def _pattern_notes(mission: Mission) -> list[str]:
    """What a pattern became: lines and their distance."""
    notes = []
    for number, leg in enumerate(mission.core.legs, start=1):
        if leg.get("kind") == "lawnmower":
            gaps = max(int(np.ceil(leg["width_m"] / leg["spacing_m"] - 1e-9)), 1)
            apart = leg["width_m"] / gaps
            asked = leg["spacing_m"]
            notes.append(f"Leg {number}: {gaps + 1} lines {apart:.3g} m apart, at most {asked:g} m asked for")
        elif leg.get("kind") == "spiral" and leg.get("spacing_m"):
            turns = abs(leg["end_radius_m"] - leg["start_radius_m"]) / leg["spacing_m"]
            notes.append(f"Leg {number}: a spiral of {turns:.3g} turns, arms {leg['spacing_m']:g} m apart")
    return notes
