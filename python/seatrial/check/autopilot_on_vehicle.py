"""An autopilot on a vehicle: speeds beyond reach, margins, rows that nothing commands, demands beyond reach.

`seatrial autopilot` and `seatrial check` show the same margins: sensors count as perfect, and what typical
ones leave stands beside, as `seatrial tune` counts them. Held by tests/check/test_check_autopilot.py and
tests/cli/test_cli_autopilot.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.plain import Plain
from seatrial.base.report import Column, Table, listed
from seatrial.control_design.margin_report import SENSITIVITY_NOTE, MarginRow, autopilot_margins, sound_speeds
from seatrial.control_design.mode_table import top_speeds
from seatrial.control_design.operating_points import (
    AutopilotFacts,
    AutopilotMode,
    mode_at,
    reachable_points,
    refuse_misfit,
)
from seatrial.control_design.start_guidance import least_lookahead_of, lookahead_share
from seatrial.flight.mismatch import mismatch
from seatrial.vehicle.authority import LOOPS, ROWS, reach, thrusts
from seatrial.vehicle.stability import statics
from seatrial.vehicle.steady_state import turning_radius

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
        doubt = (
            "typical sensors, whose delay seatrial tune counts, leave less margin than the perfect ones of"
            f" this table: {_weakness([worst])}{others}"
        )
        if any(row.grows for row in late):
            return notes, [*warnings, doubt]
        return [*notes, f"{doubt[0].upper()}{doubt[1:]}"], warnings

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
    speeds_by_cause: dict[object, tuple[str, list[str]]] = {}
    for row in rows:
        # One and the same motion, whatever moves most in it.
        cause = frozenset(row.grows.split(" and ")) if row.grows else row.weakness
        speeds_by_cause.setdefault(cause, (row.weakness, []))[1].append(f"{row.speed_m_s:.2f}")
    return "; ".join(f"at {listed(speeds)} m/s {why}" for why, speeds in speeds_by_cause.values())


_RANK = 1e-2  # of the largest singular value: what cannot be used in practice
_LOITER = 1.2  # of the tightest circle: room for control
_SHORT = 1.2  # needed over given lookahead from which on a path nearly oscillates


def on_vehicle(
    autopilot: Autopilot, facts: AutopilotFacts, vehicle: Vehicle, *, voltage_v: float
) -> tuple[list[str], list[str], AutopilotMargins]:
    """Notes and warnings about an autopilot on a vehicle, and the margins of its loops.

    Raises
    ------
    VehicleError
        The autopilot does not fit the vehicle.
    """
    refuse_misfit(autopilot, vehicle)
    doubt = mismatch(autopilot, vehicle)
    astern, top = top_speeds(vehicle, voltage_v=voltage_v)
    notes, warnings = _points(list(autopilot.speeds_m_s), astern, top)
    fastest = facts.guidance["speed_max_m_s"]
    if fastest > top:
        notes.append(
            f"speed_max_m_s = {fastest:g} is more than the top speed of {top:.2f} m/s: it limits nothing"
        )
    for mode in facts.modes:
        beside, wrong = _mode(facts, mode, vehicle, top, voltage_v)
        notes, warnings = notes + beside, warnings + wrong
    margins = margins_on(autopilot, vehicle, voltage_v=voltage_v)
    beside, weak = margins.told()
    # An autopilot of another vehicle explains most of what follows.
    warnings = [
        *([doubt] if doubt else []),
        *weak,
        *warnings,
        *_paths(facts, vehicle, top),
        *_circle(facts, vehicle, voltage_v),
        *_buoyancy(facts, vehicle),
    ]
    return notes + beside, warnings, margins


def _points(speeds: list[float], astern: float, top: float) -> tuple[list[str], list[str]]:
    """What the breakpoints have to do with the speeds that the vehicle reaches."""
    inside = [speed for speed in speeds if astern <= speed <= top]
    notes = [
        f"Breakpoints: {len(inside)} of {len(speeds)} within the {astern:.2f} to {top:.2f} m/s that the"
        " vehicle reaches; gains are linear between points and constant beyond the ends"
    ]
    if len(inside) < 2:
        return notes, [
            f"{len(inside)} of the {len(speeds)} breakpoints lie within {astern:.2f} to {top:.2f} m/s:"
            " the gains hardly adapt to the speed; set schedule.speeds_m_s over that range"
        ]
    if speeds[-1] < 0.7 * top:
        return notes, [
            f"the last breakpoint, {speeds[-1]:g} m/s, is far below the top speed of {top:.2f} m/s;"
            " gains stay constant above it"
        ]
    return notes, []


def _mode(
    facts: AutopilotFacts, mode: AutopilotMode, vehicle: Vehicle, top: float, voltage_v: float
) -> tuple[list[str], list[str]]:
    """Rows of the mode's loops that its actuators cannot command, and demands beyond their reach."""
    info = vehicle.actuator_info()
    at_work = [
        not mode.actuators or name in mode.actuators or info[name]["group"] in mode.actuators
        for name in vehicle.actuators
    ]
    # Where the mode works: at rest if it hovers, else at half of the top speed, where fins have a force.
    speed = max(mode.from_speed_m_s, 0.0 if mode.depth_by == "heave" else 0.5 * top)
    strength = np.abs(thrusts(vehicle, speed, voltage_v=voltage_v)).max(axis=1) * at_work
    # By what each actuator can give: one without limit would hide all others.
    matrix = np.asarray(vehicle.allocation_matrix()) * np.minimum(strength, 1e6)
    rows = [ROWS[LOOPS.index(loop)] for loop in mode.loops]
    weak = _not_commanded(matrix, rows)
    warnings = [
        f'mode "{mode.name}": its actuators do not command {row} ({LOOPS[ROWS.index(row)]}) independently at'
        f" {speed:.2f} m/s; leave the loop out or add actuators"
        for row in weak
    ]
    if weak or mode.actuators:
        return [], warnings
    notes = []
    for row, (low, high) in reach(vehicle, speed, "".join(rows), voltage_v=voltage_v).items():
        loop = LOOPS[ROWS.index(row)]
        asked = facts.loops.get(loop, {}).get("tau_max", 0.0)
        # A loop needs both directions, surge only that ahead.
        least = high if row == "X" else min(high, -low)
        if asked > 1.05 * least:
            unit = "N" if row in "XYZ" else "N m"
            notes.append(
                f'Mode "{mode.name}": {loop} may ask for {asked:g} {unit}, and the actuators reach'
                f" {least:.3g} {unit} at {speed:.2f} m/s; anti-windup then works"
            )
    return notes, warnings


def _not_commanded(matrix: Any, rows: Sequence[str]) -> list[str]:
    """Rows that the columns do not span independently of the rows before them, forces first."""
    kept: list[str] = []
    missing = []
    for row in sorted(rows, key="XNMZYK".index):
        chosen = matrix[["XYZKMN".index(r) for r in [*kept, row]]]
        sizes = np.linalg.norm(chosen, axis=1, keepdims=True)
        values = np.linalg.svd(chosen / np.maximum(sizes, 1e-12), compute_uv=False)
        if sizes.min() < 1e-9 or len(values) < len(chosen) or values[-1] < _RANK * values[0]:
            missing.append(row)
        else:
            kept.append(row)
    return missing


def _paths(facts: AutopilotFacts, vehicle: Vehicle, top: float) -> list[str]:
    """Lookahead distances behind which a path would oscillate at a breakpoint that the vehicle reaches."""
    warnings = []
    holds = facts.guidance["lookahead_speed_m_s"]
    for loop, key in (("heading", "lookahead_m"), ("pitch", "lookahead_vertical_m")):
        worst = (_SHORT, 0.0, 0.0)
        for speed in (speed for speed in facts.speeds_m_s if 0.0 < speed <= top):
            mode = mode_at(facts, speed)
            if loop not in mode.loops or (loop == "pitch" and mode.depth_by != "pitch"):
                continue
            least = least_lookahead_of(vehicle, facts, loop, speed) / lookahead_share(speed, holds)
            if least > worst[0] * facts.guidance[key]:
                worst = (least / facts.guidance[key], speed, least)
        if worst[1]:
            warnings.append(
                f"at {worst[1]:.2f} m/s the {'course' if loop == 'heading' else 'depth'} nearly oscillates"
                f" about a path: {key} = {facts.guidance[key]:g} is short of the {worst[2]:.3g} m that the"
                f" {loop} loop needs; raise it or fly slower"
            )
    return warnings


def _circle(facts: AutopilotFacts, vehicle: Vehicle, voltage_v: float) -> list[str]:
    """A loiter circle that is tighter than the vehicle turns."""
    if facts.hovers:
        return []
    radius = facts.guidance["loiter_radius_m"]
    speeds = [speed for speed in facts.speeds_m_s if speed > 0.0]
    radii = [r for speed in speeds if (r := turning_radius(vehicle, speed, voltage_v=voltage_v)) is not None]
    if radii and radius < _LOITER * max(radii):
        return [
            f"loiter_radius_m = {radius:g} leaves little room beside the vehicle's tightest circle of"
            f" {max(radii):.1f} m; widen it"
        ]
    return []


def _buoyancy(facts: AutopilotFacts, vehicle: Vehicle) -> list[str]:
    """A reaction that stops all actuators of a vehicle that sinks."""
    safety = facts.safety
    reactions = [value.get("reaction") if isinstance(value, dict) else value for value in safety.values()]
    rest = statics(vehicle)
    if "abort" in reactions and rest.net_n < 0.0:
        return [
            f"abort stops all actuators, and {vehicle.name} is {-rest.net_n:.3g} N heavy: it sinks; choose"
            " surface, or trim it buoyant"
        ]
    return []
