"""An autopilot before it steers: modes, gains, safety in words; with a vehicle what it cannot do there.

The core refuses what does not fit (a loop whose row the vehicle file does not call controllable, an unknown
actuator); here stands what is possible and probably not meant. Held by tests/check/test_check_autopilot.py.

An autopilot on a vehicle: reachable speeds, rows that nothing commands, demands beyond the actuators.

Held by tests/check/test_check_autopilot.py.

What an autopilot does when something goes wrong, in sentences. Held by tests/check/test_check_autopilot.py.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.report import Column, Report, Section, Table
from seatrial.vehicle.actuators import NOMINAL_V
from seatrial.vehicle.stability import statics

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.control_design.margin_report import MarginRow

__all__ = [
    "AutopilotCheck",
    "GainRow",
    "ModeRow",
    "StartGains",
    "check_autopilot",
    "on_vehicle",
    "safety_sentences",
    "weak_points",
]

_REACTIONS = {
    "continue": "the mission goes on",
    "hold": "keep station",
    "surface": "surface under control",
    "abort": "stop all actuators",
}

_GROUPS = {
    "position": "position",
    "depth": "depth",
    "attitude": "attitude",
    "velocity": "velocity over ground",
    "rates": "turn rates",
    "altitude": "altitude",
}

_LIMITS = {
    "depth": "Deeper than the mission's limit",
    "altitude": "Nearer to the bottom than the mission's limit",
    "fence": "Outside the mission's fence",
    "time": "Longer than the mission's limit",
}


def safety_sentences(safety: Mapping[str, Any], *, hovers: bool, loiter_radius_m: float) -> list[str]:
    """A sentence per watch of the table ``[safety]``.

    Parameters
    ----------
    safety : mapping
        The table with its defaults.
    hovers : bool
        Whether a mode keeps the depth without speed; a vehicle that cannot circles instead.
    loiter_radius_m : float
        Radius of that circle, m.

    Examples
    --------
    >>> from seatrial._core import Autopilot
    >>> import tomllib
    >>> table = tomllib.loads(Autopilot.load("cwolf").to_toml())["safety"]
    >>> safety_sentences(table, hovers=True, loiter_radius_m=20.0)[0]
    'No position for 60 s: surface under control'
    """
    words = dict(_REACTIONS)
    if not hovers:
        words["hold"] = f"circle at {loiter_radius_m:g} m"
    said = []
    for key, name in _GROUPS.items():
        stale = safety[f"stale_{key}"]
        where = " on a leg that follows the bottom" if key == "altitude" else ""
        said.append(f"No {name} for {stale['after_s']:g} s{where}: {words[stale['reaction']]}")
    said += [f"{sentence}: {words[safety[key]]}" for key, sentence in _LIMITS.items()]
    battery, actuator = safety["battery"], safety["actuator"]
    said.append(f"Battery below {100.0 * battery['below']:g} %: {words[battery['reaction']]}")
    said.append(
        f"An actuator {100.0 * actuator['deviation']:g} % of its largest signal off for"
        f" {actuator['after_s']:g} s: allocate without it, and {words[actuator['reaction']]}"
    )
    stalled = safety["progress"]
    said.append(f"No nearer to the waypoint for {stalled['after_s']:g} s: {words[stalled['reaction']]}")
    said.append(
        f"Surfacing: at {safety['surface_speed_m_s']:g} m/s until {safety['surfaced_above_m']:g} m of depth"
    )
    return said


_UNITS = {"surge": "N", "sway": "N", "heave": "N", "roll": "N m", "pitch": "N m", "heading": "N m"}

_GAINS = ("K_P", "K_I_per_s", "K_D_s")

_POINTS = 6


@dataclass(frozen=True)
class ModeRow:
    """A row of the mode table; no actuators means all."""

    name: str
    from_speed_m_s: float
    loops: tuple[str, ...]
    depth_by: str
    actuators: tuple[str, ...]


@dataclass(frozen=True)
class GainRow:
    """A gain of a loop at the six supporting points, physical: N or N m per m/s, m or rad."""

    loop: str
    gain: str
    values: tuple[float, ...]


@dataclass(frozen=True)
class AutopilotCheck:
    """What was found about an autopilot; printed, a page of sentences.

    Attributes
    ----------
    name, description
        Of the autopilot.
    period_s, control
        Control period, and ``pid`` or ``lqr``.
    speeds_m_s
        Supporting points of the gains.
    modes, gains
        The mode table, and the gains of the loops.
    safety
        A sentence per watch.
    notes, warnings
        Sentences about what is worth knowing, and about what is probably not meant.
    """

    name: str
    description: str
    period_s: float
    control: str
    speeds_m_s: tuple[float, ...]
    modes: tuple[ModeRow, ...]
    gains: tuple[GainRow, ...]
    safety: tuple[str, ...]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """The check as plain data for JSON."""
        return asdict(self)

    def report(self, start: StartGains | None = None) -> Report:
        """Loops and speeds, the worst problem, what to do next; then modes, gains, margins and notes.

        Parameters
        ----------
        start : StartGains, optional
            Of gains that were just made: their margins, and what the vehicle can command.
        """
        return _report(self, start)

    def summary(self) -> str:
        """The report as text."""
        return self.report().text()

    def __str__(self) -> str:
        return self.summary()


@dataclass(frozen=True)
class StartGains:
    """What start gains are worth.

    Attributes
    ----------
    authority
        What the vehicle can command, what the loss of an actuator costs, why a row has no loop.
    margins
        Per mode and breakpoint.
    sound
        Range of speeds ahead at which the loops are sound, m/s; None where there is none.
    """

    authority: tuple[str, ...]
    margins: tuple[MarginRow, ...]
    sound: tuple[float, float] | None


_MANY = 100.0  # a gain margin beyond it is no limit


def _report(check: AutopilotCheck, start: StartGains | None) -> Report:
    """Three lines, modes, gains, margins, notes; what the safety watches as details."""
    notes, warnings = list(check.notes), list(check.warnings)
    if start is not None:
        more, short = weak_points(start.margins, start.sound)
        notes, warnings = notes + more, warnings + short
    worst, next_step = "no warning: limits, gains and safety fit each other", "fly a mission: seatrial fly"
    if warnings:
        worst, next_step = (
            warnings[0],
            ("stay within these limits in the missions, or change the file and check again"),
        )
    elif start is None and not any("reaches" in text for text in notes):
        next_step = "check it on its vehicle: seatrial check AUTOPILOT --vehicle VEHICLE"
    count = len(warnings)
    tables = [_mode_table(check), _gain_table(check)]
    if start is not None:
        tables.append(_margins(start.margins))
    return Report(
        title=check.name,
        outcome=f"{count} warning{'s' if count > 1 else ''}" if count else "nothing looks wrong",
        good=_how_good(check, start),
        worst=worst,
        next_step=next_step,
        sections=(
            Section(check.description, () if start is None else start.authority, tuple(tables)),
            Section(sentences=(*(f"WARNING: {text}" for text in warnings), *notes)),
            Section("Safety", check.safety, details=True),
        ),
    )


def _how_good(check: AutopilotCheck, start: StartGains | None) -> str:
    """Law, modes, breakpoints; the range of sound speeds and the least phase margin of start gains."""
    speeds = check.speeds_m_s
    count = len(check.modes)
    said = f"{check.control.upper()} every {check.period_s:g} s, {count} mode{'s' if count > 1 else ''}"
    if speeds:
        said += f", gains at {len(speeds)} speeds from {speeds[0]:.3g} to {speeds[-1]:.3g} m/s"
    if start is None or start.sound is None:
        return said
    low, high = start.sound
    inside = [row.phase_deg for row in start.margins if row.sound and low <= row.speed_m_s <= high]
    least = f", phase margin at least {min(inside):.0f} deg" if inside else ""
    return f"{said}; sound from {low:.2f} to {high:.2f} m/s{least}"


def _mode_table(check: AutopilotCheck) -> Table:
    rows = [
        (
            mode.name,
            f"{mode.from_speed_m_s:g}",
            mode.depth_by,
            " ".join(mode.loops),
            " ".join(mode.actuators) or "all",
        )
        for mode in check.modes
    ]
    texts = (Column(name, align="left") for name in ("depth by", "loops", "actuators"))
    return Table.of("Modes", ("mode", "from m/s", *texts), rows)


def _gain_table(check: AutopilotCheck) -> Table:
    rows = [(row.loop, row.gain, *(f"{value:.3g}" for value in row.values)) for row in check.gains]
    head = ("loop", "at m/s", *(f"{speed:.3g}" for speed in check.speeds_m_s))
    return Table.of("Gains", head, rows if check.control == "pid" else (), left=2)


def _margins(margins: Sequence[MarginRow]) -> Table:
    rows = []
    for row in margins:
        numbers = ("", "", "")  # margins of an unstable loop mean nothing
        if row.doubles_s is None:
            gain = f"{row.gain:.1f}" if row.gain < _MANY else "any"
            delay = f"{row.delay_s:.2f}" if row.delay_s < _MANY else "any"
            numbers = (f"{row.phase_deg:.0f}", gain, delay)
        rows.append((row.mode, f"{row.speed_m_s:.2f}", *numbers, row.verdict))
    head = ("mode", "at m/s", "phase, deg", "gain", "delay, s", Column("verdict", align="left"))
    return Table.of("Margins: phase, factor of the gain, delay; the least of all loops", head, rows)


def weak_points(
    margins: Sequence[MarginRow], sound: tuple[float, float] | None
) -> tuple[list[str], list[str]]:
    """Notes and warnings about breakpoints that are not sound; `sound` is the sound range, m/s."""
    weak = [row for row in margins if not row.sound]
    if sound is None:
        return [], ["no speed ahead is sound; look at what is not commanded"]
    ahead = [row for row in weak if row.speed_m_s >= 0.0]
    notes = []
    if len(ahead) < len(weak):
        least = max(row.speed_m_s for row in weak if row.speed_m_s < 0.0)
        notes.append(f"Astern at {-least:.2f} m/s and faster it is not sound; a mission does not go astern")
    if not ahead:
        return notes, []
    low, high = sound
    grows = list(dict.fromkeys(row.grows for row in ahead if row.grows))
    why = f"a motion grows ({', '.join(grows)})" if grows else "the margins are small"
    return notes, [f"keep the speed of missions between {low:.2f} and {high:.2f} m/s; elsewhere {why}"]


def check_autopilot(
    autopilot: Autopilot, *, vehicle: Vehicle | None = None, voltage_v: float = NOMINAL_V
) -> AutopilotCheck:
    """Check of an autopilot, by itself or on a vehicle.

    Parameters
    ----------
    autopilot : Autopilot
    vehicle : Vehicle, optional
        On which it is to work.
    voltage_v : float
        Supply voltage at which tables of thrust are read, V.

    Raises
    ------
    VehicleError
        The autopilot does not fit the vehicle.

    Examples
    --------
    >>> import seatrial as st
    >>> from seatrial._core import Autopilot
    >>> found = check_autopilot(Autopilot.load("cwolf"), vehicle=st.Vehicle.load("cwolf"))
    >>> [mode.name for mode in found.modes]
    ['hover', 'cruise']
    """
    tables: dict[str, Any] = tomllib.loads(autopilot.to_toml())
    guidance = tables["guidance"]
    modes = tuple(
        ModeRow(
            name=mode["name"],
            from_speed_m_s=mode.get("from_speed_m_s", 0.0),
            loops=tuple(mode["loops"]),
            depth_by=mode["depth_by"],
            actuators=tuple(mode.get("actuators", ())),
        )
        for mode in tables["modes"]
    )
    hovers = any(mode.depth_by == "heave" for mode in modes)
    notes = [
        f"Control: {tables['control'].upper()} every {autopilot.period_s:g} s",
        f"Guidance: {guidance['method']}, lookahead {guidance['lookahead_m']:g} m, pitch to"
        f" {guidance['pitch_max_deg']:g} deg, speed to {guidance['speed_max_m_s']:g} m/s",
        *_loop_notes(tables),
    ]
    if not hovers:
        notes.append(
            "No mode keeps the depth without speed: station-keeping is a circle of"
            f" {guidance['loiter_radius_m']:g} m"
        )
    warnings: list[str] = []
    if vehicle is not None:
        told, wrong = on_vehicle(autopilot, tables, modes, vehicle, voltage_v=voltage_v)
        notes, warnings = notes + told, wrong
    return AutopilotCheck(
        name=autopilot.name,
        description=autopilot.description,
        period_s=autopilot.period_s,
        control=tables["control"],
        speeds_m_s=tuple(autopilot.speeds_m_s),
        modes=modes,
        gains=tuple(_gains(tables)),
        safety=tuple(
            safety_sentences(tables["safety"], hovers=hovers, loiter_radius_m=guidance["loiter_radius_m"])
        ),
        notes=tuple(notes),
        warnings=tuple(warnings),
    )


def _gains(tables: dict[str, Any]) -> list[GainRow]:
    """Gains that are not zero at every point."""
    rows = []
    for loop, table in tables["loops"].items():
        for gain in _GAINS:
            value = table.get(gain, 0.0)
            values = tuple(map(float, np.broadcast_to(value, _POINTS)))
            if any(values):
                rows.append(GainRow(loop, gain, values))
    return rows


def _loop_notes(tables: dict[str, Any]) -> list[str]:
    notes = []
    for loop, table in tables["loops"].items():
        shaped = table.get("reference_rad_s")
        reference = f"reference filtered at {shaped:g} rad/s" if shaped else "reference not filtered"
        notes.append(
            f"{loop.capitalize()}: at most {table['tau_max']:g} {_UNITS[loop]}, {reference}, anti-windup"
            f" {table['anti_windup']}"
        )
    if tables.get("lqr"):
        notes.append(f"LQR: gains of {', '.join(table['mode'] for table in tables['lqr'])}")
    return notes


_RANK = 1e-2  # of the largest singular value: what cannot be used in practice

_LOITER = 1.2  # of the tightest circle: room for control

_PLACE = """
format = 1
name = "fit"
speed_m_s = 1.0
acceptance_radius_m = 1.0
[[legs]]
north_m = 100.0
east_m = 0.0
"""


def on_vehicle(
    autopilot: Autopilot,
    tables: dict[str, Any],
    modes: Sequence[ModeRow],
    vehicle: Vehicle,
    *,
    voltage_v: float,
) -> tuple[list[str], list[str]]:
    """Notes and warnings about an autopilot on a vehicle.

    Raises
    ------
    VehicleError
        The autopilot does not fit the vehicle.
    """
    from seatrial._core import Mission
    from seatrial.control_design.mode_table import top_speeds

    autopilot.engage(vehicle, Mission.from_toml(_PLACE))
    astern, top = top_speeds(vehicle, voltage_v=voltage_v)
    notes, warnings = _points(list(autopilot.speeds_m_s), astern, top)
    fastest = tables["guidance"]["speed_max_m_s"]
    if fastest > top:
        notes.append(
            f"speed_max_m_s = {fastest:g} is more than the top speed of {top:.2f} m/s: it limits nothing"
        )
    for mode in modes:
        told, wrong = _mode(tables, mode, vehicle, top, voltage_v)
        notes, warnings = notes + told, warnings + wrong
    return notes, [*warnings, *_circle(tables, modes, vehicle, voltage_v), *_buoyancy(tables, vehicle)]


def _points(speeds: list[float], astern: float, top: float) -> tuple[list[str], list[str]]:
    """What the supporting points have to do with the speeds that the vehicle reaches."""
    inside = [speed for speed in speeds if astern <= speed <= top]
    notes = [
        f"Supporting points: {len(inside)} of {len(speeds)} within the {astern:.2f} to {top:.2f} m/s that the"
        " vehicle reaches; gains are linear between points and constant beyond the ends"
    ]
    if len(inside) < 2:
        return notes, [
            f"{len(inside)} of the {len(speeds)} supporting points lie within {astern:.2f} to {top:.2f} m/s:"
            " the gains hardly adapt to the speed; set schedule.speeds_m_s over that range"
        ]
    if speeds[-1] < 0.7 * top:
        return notes, [
            f"the last supporting point, {speeds[-1]:g} m/s, is far below the top speed of {top:.2f} m/s;"
            " gains stay constant above it"
        ]
    return notes, []


def _mode(
    tables: dict[str, Any], mode: ModeRow, vehicle: Vehicle, top: float, voltage_v: float
) -> tuple[list[str], list[str]]:
    """Rows of the mode's loops that its actuators cannot command, and demands beyond their reach."""
    from seatrial.vehicle.authority import LOOPS, ROWS, reach, thrusts

    facts = vehicle.actuator_info()
    at_work = [
        not mode.actuators or name in mode.actuators or facts[name]["group"] in mode.actuators
        for name in vehicle.actuators
    ]
    speed = max(mode.from_speed_m_s, 0.0 if mode.depth_by == "heave" else 0.5 * top)
    strength = np.abs(thrusts(vehicle, speed, voltage_v=voltage_v)).max(axis=1) * at_work
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
        asked = tables["loops"].get(loop, {}).get("tau_max", 0.0)
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


def _circle(
    tables: dict[str, Any], modes: Sequence[ModeRow], vehicle: Vehicle, voltage_v: float
) -> list[str]:
    """A loiter circle that is tighter than the vehicle turns."""
    from seatrial.vehicle.turning import turning_radius

    if any(mode.depth_by == "heave" for mode in modes):
        return []
    radius = tables["guidance"]["loiter_radius_m"]
    speeds = [speed for speed in tables["schedule"]["speeds_m_s"] if speed > 0.0]
    found = [r for speed in speeds if (r := turning_radius(vehicle, speed, voltage_v=voltage_v)) is not None]
    if found and radius < _LOITER * max(found):
        return [
            f"loiter_radius_m = {radius:g} leaves little room beside the vehicle's tightest circle of"
            f" {max(found):.1f} m; widen it"
        ]
    return []


def _buoyancy(tables: dict[str, Any], vehicle: Vehicle) -> list[str]:
    """A reaction that stops all actuators of a vehicle that sinks."""
    safety = tables["safety"]
    reactions = [value["reaction"] if isinstance(value, dict) else value for value in safety.values()]
    rest = statics(vehicle)
    if "abort" in reactions and rest.net_n < 0.0:
        return [
            f"abort stops all actuators, and {vehicle.name} is {-rest.net_n:.3g} N heavy: it sinks; choose"
            " surface, or trim it buoyant"
        ]
    return []
