"""A mission flown beforehand: in still water and in a current, by the vehicle with its autopilot.

What a plan on paper promises, a vehicle that turns, drifts and stops may not keep. Each flight takes some
milliseconds, so the check flies: in still water and in the current that it is given, or in 0.3 m/s from all
four sides; with perfect sensors, or those that it is given. What holds, holds for these waters.

Held by tests/check/test_check_flown.py.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from seatrial.base.errors import SimulationError
from seatrial.base.report import Table, report_of

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.flight.mission import Mission
    from seatrial.sensors.sensor import Sensor

USUAL_M_S = 0.3
"""Current of the check where none is given, m/s."""

_LONGEST_S = 4.0 * 3600.0  # of the plan: its flights with their logs stay below a gigabyte
_DEEPER_M = 1e-2  # below it a depth is the planned one

Velocity = tuple[float, float, float]


@dataclass(frozen=True)
class FlownCheck:
    """What came of the mission in one water.

    Attributes
    ----------
    current
        North, east, down, m/s.
    outcome, complete
        As of `seatrial.flight.flight.Flight`.
    reached, waypoints
        Waypoints that were reached, and all.
    missed
        Sentences on the first of those that were not.
    clearance_m, reserve_m
        Of the hull from what stands in the water, and beyond what the mission promises; infinite without.
    depth_largest_m, duration_s
        Of the flight.
    worst, remedy
        The worst problem in words, of a complete flight whatever is largest; what to do about it.
    """

    current: Velocity
    outcome: str
    complete: bool
    reached: int
    waypoints: int
    missed: str
    clearance_m: float
    reserve_m: float
    depth_largest_m: float
    duration_s: float
    worst: str
    remedy: str = ""

    @property
    def water(self) -> str:
        """The water in words.

        Examples
        --------
        >>> FlownCheck((0.0, -0.3, 0.0), "complete", True, 1, 1, "", 1.0, 0.0, 4.0, 60.0, "").water
        'a current of 0.3 m/s to the west'
        """
        north, east, down = self.current
        if not any(self.current):
            return "still water"
        speed = math.sqrt(north**2 + east**2 + down**2)
        sides = (("north", north), ("south", -north), ("east", east), ("west", -east))
        names = [name for name, x in sides if x > 0.0]
        if len(names) == 1 and down == 0.0:
            return f"a current of {speed:g} m/s to the {names[0]}"
        return f"a current of {speed:.2g} m/s (north {north:g}, east {east:g}, down {down:g})"


def fly_beforehand(
    mission: Mission,
    vehicle: Vehicle,
    autopilot: Autopilot,
    *,
    current: Velocity | None = None,
    sensors: Mapping[str, Sensor] | str | Path | None = None,
    seabed: float | None = None,
    voltage_v: float,
) -> tuple[tuple[FlownCheck, ...], list[str], list[str]]:
    """Flights of a mission in still water and in currents; a note where it was not flown, why it cannot be.

    `current` is north, east, down, m/s; 0.3 m/s from four sides when omitted. The others are as for
    `seatrial.fly`.
    """
    from seatrial.flight.conditions import Conditions, Water
    from seatrial.flight.fly import fly

    if mission.planned_time > _LONGEST_S:
        return (
            (),
            [f"Not flown here: planned to take more than {_LONGEST_S / 3600.0:g} h; fly it (seatrial fly)"],
            [],
        )
    side = USUAL_M_S
    waters: Sequence[Velocity] = (
        [(side, 0.0, 0.0), (-side, 0.0, 0.0), (0.0, side, 0.0), (0.0, -side, 0.0)]
        if current is None
        else [current]
    )
    found = []
    for water in [(0.0, 0.0, 0.0), *(one for one in waters if any(one))]:
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
                return (), [f"Not flown here: {error}"], []
            return (), [], [f"it cannot be flown: {error}"]
        missed = [leg for leg in flight.legs if not leg.reached]
        # An autopilot of another vehicle is told once, by the check itself.
        said = report_of(flight, doubted=False)
        found.append(
            FlownCheck(
                current=water,
                outcome=flight.outcome_in_words,
                complete=flight.complete,
                reached=len(flight.legs) - len(missed),
                waypoints=len(flight.legs),
                missed=", ".join(f'"{leg.label}"' for leg in missed[:3])
                + (f" and {len(missed) - 3} more" if len(missed) > 3 else ""),
                clearance_m=flight.metrics["clearance_m"],
                reserve_m=flight.metrics["clearance_reserve_m"],
                depth_largest_m=flight.metrics["depth_largest_m"],
                duration_s=flight.metrics["duration_s"],
                worst=said.worst,
                remedy=said.next_step,
            )
        )
    return tuple(found), [], []


def flown_sentences(flown: Sequence[FlownCheck], sensors: str) -> tuple[list[str], list[str]]:
    """Notes and warnings about a mission that was flown beforehand; `sensors` in words."""
    if not flown:
        return [], []
    kept = [one for one in flown if one.complete]
    notes = []
    if kept:
        slowest = max(one.duration_s for one in kept)
        clear = min(one.clearance_m for one in kept)
        near = f", at least {clear:.1f} m clear" if math.isfinite(clear) else ""
        waters = "; ".join(one.water for one in kept)
        notes.append(
            f"Flown with {sensors}: every waypoint reached{near}, at most {slowest:.0f} s, in {waters}"
        )
    warnings = []
    for one in flown:
        if one.complete:
            continue
        said = [one.outcome, f"{one.reached} of {one.waypoints} waypoints reached"]
        said += [f"missed {one.missed}"] if one.missed else []
        warnings.append(f"flown in {one.water} with {sensors}: {'; '.join(said)}; {one.worst}")
    return notes, warnings


def flown_table(flown: Sequence[FlownCheck], sensors: str) -> Table:
    """A row per water."""
    rows = [
        (
            one.water.removeprefix("a current of "),
            one.outcome if len(one.outcome) < 24 else "not as promised",
            f"{one.reached}/{one.waypoints}",
            f"{one.clearance_m:.1f}" if math.isfinite(one.clearance_m) else "",
            f"{one.depth_largest_m:.1f}",
            f"{one.duration_s:.0f}",
        )
        for one in flown
    ]
    head = ("water", "outcome", "reached", "clear, m", "deepest, m", "time, s")
    return Table.of(f"Flown beforehand with {sensors}", head, rows, left=2)
