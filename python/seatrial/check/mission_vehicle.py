"""What a vehicle cannot do of a mission, and what the mission takes from its battery.

Held by tests/test_check_mission.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.check.legs import LegRow
    from seatrial.check.mission import Energy

__all__ = ["energy_sentences", "vehicle_warnings"]

_LEFT = 0.2  # share of the battery that a careful person brings home


def energy_sentences(
    vehicle: Vehicle, rows: Sequence[LegRow], energy: Energy | None
) -> tuple[list[str], list[str]]:
    """Notes and warnings about the energy of a mission."""
    if energy is None:
        return [f"Energy: not known, {vehicle.name} tells neither power_w_s3 nor [power]"], []
    silent = sorted({row.speed_m_s for row in rows if row.power_w is None and row.time_s > row.hold_s})
    parts = f"{energy.driving_wh:.1f} W h driving, {energy.hotel_wh:.1f} W h hotel load"
    notes = [f"Energy: {energy.total_wh:.1f} W h ({parts})"]
    if silent:
        spoken = ", ".join(f"{speed:g}" for speed in silent)
        notes.append(f"Energy: without driving at {spoken} m/s, of which the model tells no power")
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
            f"the battery of {energy.battery_wh:g} W h does not suffice for {energy.total_wh:.0f} W h;"
            " shorten the mission or fly slower"
        ]
    if energy.total_wh > (1.0 - _LEFT) * energy.battery_wh:
        left = 100.0 * (1.0 - energy.total_wh / energy.battery_wh)
        return notes, [f"only {left:.0f} % of the battery are left at the end, and a current takes more"]
    return notes, []


def vehicle_warnings(rows: Sequence[LegRow], vehicle: Vehicle, voltage_v: float) -> list[str]:
    """Sentences about what the vehicle cannot do of the mission."""
    from seatrial.check.performance import drivers, speeds
    from seatrial.control_design.authority import commandable

    if not drivers(vehicle):
        return [f"no actuator of {vehicle.name} drives ahead"]
    top = speeds(vehicle, voltage_v=voltage_v, shares=(1.0,))[-1].speed_m_s
    fast = [row for row in rows if row.speed_m_s > top]
    sentences = []
    if fast:
        worst = max(fast, key=lambda row: row.speed_m_s)
        sentences.append(
            f'leg {worst.number} "{worst.label}" asks for {worst.speed_m_s:g} m/s, more than the top speed of'
            f" {top:.2f} m/s{_others(fast)}; fly slower"
        )
    held = [row for row in rows if row.hold_s]
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


def _turns(vehicle: Vehicle, speed: float, voltage_v: float) -> bool:
    from seatrial.control_design.authority import commandable

    return "N" not in commandable(vehicle, speed, voltage_v=voltage_v)


def _others(rows: Sequence[LegRow]) -> str:
    """How many further legs are meant."""
    more = len(rows) - 1
    return f" (and {more} further {'leg' if more == 1 else 'legs'})" if more else ""
