"""Margins of an autopilot on a vehicle for a glance: a table, the range of sound speeds, what to beware of.

`seatrial autopilot` and `seatrial check` tell the same. Sensors count as perfect; what typical ones leave is
told beside, as `seatrial tune` counts them. Held by tests/check/test_check_autopilot.py and
tests/cli/test_cli_autopilot.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.plain import Plain
from seatrial.base.report import Column, Table, listed
from seatrial.control_design.margin_report import SENSITIVITY_NOTE, MarginRow, autopilot_margins, sound_speeds
from seatrial.control_design.operating_points import reachable_points

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle

_MANY = 100.0  # a gain margin beyond it is no limit

_TYPICAL = "typical"


@dataclass(frozen=True)
class AutopilotMargins(Plain, only="margins=rows margins_typical_sensors=typical sound_m_s=sound"):
    """Margins of an autopilot on a vehicle.

    Attributes
    ----------
    rows
        Per breakpoint that the vehicle reaches, with perfect sensors.
    typical
        The same with typical sensors.
    sound
        Range of speeds ahead at which the loops are sound with perfect sensors, m/s; None without any.
    """

    rows: tuple[MarginRow, ...]
    typical: tuple[MarginRow, ...]
    sound: tuple[float, float] | None

    def told(self) -> tuple[list[str], list[str]]:
        """Notes and warnings."""
        if not self.rows:
            return [], []
        notes, warnings = weak_points(self.rows, self.sound)
        sound = {row.speed_m_s for row in self.rows if row.sound and row.speed_m_s >= 0.0}
        late = [row for row in self.typical if not row.sound and row.speed_m_s in sound]
        if not late:
            return notes, warnings
        worst = max(late, key=lambda row: (bool(row.grows), row.sensitivity))
        others = f", and {len(late) - 1} more breakpoints are short" if len(late) > 1 else ""
        said = (
            "typical sensors, whose delay seatrial tune counts, leave less margin than the perfect ones of"
            f" this table: {_weakness([worst])}{others}"
        )
        if any(row.grows for row in late):
            return notes, [*warnings, said]
        return [*notes, f"{said[0].upper()}{said[1:]}"], warnings

    def how_good(self) -> str:
        """Range of sound speeds and the least phase margin there, in a clause; nothing where none is."""
        if self.sound is None:
            return ""
        low, high = self.sound
        inside = [row.phase_deg for row in self.rows if row.sound and low <= row.speed_m_s <= high]
        least = f", phase margin at least {min(inside):.0f} deg" if inside else ""
        return f"sound from {low:.2f} to {high:.2f} m/s with perfect sensors{least}"

    def table(self) -> Table:
        """A row per breakpoint."""
        rows = []
        for row in self.rows:
            numbers = ("", "", "")  # margins of an unstable loop mean nothing
            if row.doubles_s is None:
                gain = f"{row.gain:.1f}" if row.gain < _MANY else "any"
                delay = f"{row.delay_s:.2f}" if row.delay_s < _MANY else "any"
                numbers = (f"{row.phase_deg:.0f}", gain, delay)
            rows.append((row.mode, f"{row.speed_m_s:.2f}", *numbers, row.verdict))
        head = ("mode", "at m/s", "phase, deg", "gain", "delay, s", Column("verdict", align="left"))
        note = f"Gain: by which factor it may rise. {SENSITIVITY_NOTE}"
        return Table.of("Margins with perfect sensors, the least of all loops", head, rows, note=note)


def margins_on(autopilot: Autopilot, vehicle: Vehicle, *, voltage_v: float) -> AutopilotMargins:
    """Margins of an autopilot at the breakpoints that a vehicle reaches."""
    reached = reachable_points(vehicle, autopilot, voltage_v=voltage_v)
    speeds = [float(speed) for speed in np.asarray(autopilot.speeds_m_s)[reached]]
    return AutopilotMargins(
        rows=tuple(autopilot_margins(vehicle, autopilot, speeds_m_s=speeds)),
        typical=tuple(autopilot_margins(vehicle, autopilot, speeds_m_s=speeds, sensors=_TYPICAL)),
        sound=sound_speeds(vehicle, autopilot, voltage_v=voltage_v),
    )


def weak_points(
    margins: Sequence[MarginRow], sound: tuple[float, float] | None
) -> tuple[list[str], list[str]]:
    """Notes and warnings about breakpoints that are not sound; `sound` is the sound range, m/s."""
    weak = [row for row in margins if not row.sound]
    ahead = [row for row in weak if row.speed_m_s >= 0.0]
    if sound is None:
        why = f": {_weakness(ahead)}" if ahead else ""
        return [], [f"no speed ahead is sound{why}; look at what is not commanded, or tune (seatrial tune)"]
    notes = []
    if len(ahead) < len(weak):
        astern = [row for row in weak if row.speed_m_s < 0.0]
        least = max(row.speed_m_s for row in astern)
        notes.append(
            f"Astern at {-least:.2f} m/s and faster {_in_short(astern)}; a mission does not go astern"
        )
    if not ahead:
        return notes, []
    low, high = sound
    return notes, [
        f"keep the speed of missions between {low:.2f} and {high:.2f} m/s, or tune the gains (seatrial tune):"
        f" {_weakness(ahead)}"
    ]


def _in_short(rows: Sequence[MarginRow]) -> str:
    """Why breakpoints are not sound: motions that grow, or else small margins."""
    grows = list(dict.fromkeys(row.grows for row in rows if row.grows))
    return f"a motion grows ({', '.join(grows)})" if grows else "the margins are small"


def _weakness(rows: Sequence[MarginRow]) -> str:
    """Why breakpoints are not sound, by speed: what grows, or the loop and its margins that fall short."""
    found: dict[object, tuple[str, list[str]]] = {}
    for row in rows:
        # One and the same motion, whatever moves most in it.
        cause = frozenset(row.grows.split(" and ")) if row.grows else row.weakness
        found.setdefault(cause, (row.weakness, []))[1].append(f"{row.speed_m_s:.2f}")
    return "; ".join(f"at {listed(speeds)} m/s {why}" for why, speeds in found.values())
