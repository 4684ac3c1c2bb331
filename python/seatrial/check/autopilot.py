"""An autopilot before it steers: modes, gains and safety in sentences; on a vehicle, what it cannot do there.

The core refuses what does not fit (a loop whose row the vehicle file does not call controllable, an unknown
actuator). Here stand the doubts: breakpoints and speeds beyond reach, loops with little margin, rows that
nothing commands, demands larger than the actuators' reach, an abort of a vehicle that sinks. Held by
tests/check/test_check_autopilot.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from seatrial.base.report import Report, Reported, report_of
from seatrial.check.autopilot_on_vehicle import on_vehicle
from seatrial.control_design.operating_points import AutopilotFacts, autopilot_facts
from seatrial.flight.reactions import GROUPS
from seatrial.vehicle.actuators import NOMINAL_V

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.check.autopilot_on_vehicle import AutopilotMargins

_REACTIONS = {
    "continue": "the mission goes on",
    "hold": "keep station",
    "surface": "surface under control",
    "abort": "stop all actuators",
}

_LIMITS = {
    "depth": "Deeper than the mission's limit",
    "altitude": "Nearer to the bottom than the mission's limit",
    "fence": "Outside the mission's fence",
    "time": "Longer than the mission's limit",
}


def safety_sentences(safety: Mapping[str, Any], *, hovers: bool, loiter_radius_m: float) -> list[str]:
    """A sentence per watch of the table ``[safety]`` with its defaults.

    `hovers`: whether a mode keeps the depth without speed; a vehicle that cannot circles instead, with a
    radius in m.

    Examples
    --------
    >>> import seatrial as st
    >>> table = autopilot_facts(st.Autopilot.load("cwolf")).safety
    >>> safety_sentences(table, hovers=True, loiter_radius_m=20.0)[0]
    'No position for 60 s: surface under control'
    """
    words = dict(_REACTIONS)
    if not hovers:
        words["hold"] = f"circle at {loiter_radius_m:g} m"
    lines = []
    for key, name in GROUPS.items():
        stale = safety[f"stale_{key}"]
        where = " on a leg that follows the bottom" if key == "altitude" else ""
        lines.append(f"No {name} for {stale['after_s']:g} s{where}: {words[stale['reaction']]}")
    lines += [f"{sentence}: {words[safety[key]]}" for key, sentence in _LIMITS.items()]
    battery, actuator = safety["battery"], safety["actuator"]
    lines.append(f"Battery below {100.0 * battery['below']:g} %: {words[battery['reaction']]}")
    lines.append(
        f"An actuator {100.0 * actuator['deviation']:g} % of its largest signal off for"
        f" {actuator['after_s']:g} s: allocate without it, and {words[actuator['reaction']]}"
    )
    stalled = safety["progress"]
    lines.append(f"No nearer to the waypoint for {stalled['after_s']:g} s: {words[stalled['reaction']]}")
    contrary, speed = safety["contradiction"], safety["speed"]
    limits = {
        "position": f"{contrary['position_m']:g} m",
        "depth": f"{contrary['depth_m']:g} m",
        "attitude": f"{contrary['angle_deg']:g} deg",
    }
    for key, limit in limits.items():
        reaction = words[safety[f"stale_{key}"]["reaction"]]
        lines.append(
            f"The {GROUPS[key]} {limit} from what its rates say, for {contrary['after_s']:g} s: {reaction}"
        )
    lines.append(
        f"A velocity that changes by {contrary['roughness_m_s']:g} m/s from step to step: told, and"
        f" {words['continue']}"
    )
    lines.append(
        f"The speed {speed['off_m_s']:g} m/s off for {speed['after_s']:g} s: {words[speed['reaction']]}"
    )
    lines.append(f"An unused channel or the battery silent: told, and {words['continue']}")
    aborts = safety["stale_depth"]["reaction"] == "abort"
    lines.append(
        f"No higher after {safety['ascent_after_s']:g} s of surfacing:"
        f" {words['abort' if aborts else 'continue']}"
    )
    lines.append(
        f"Surfacing: at {safety['surface_speed_m_s']:g} m/s until {safety['surfaced_above_m']:g} m of depth"
    )
    return lines


_UNITS = {"surge": "N", "sway": "N", "heave": "N", "roll": "N m", "pitch": "N m", "heading": "N m"}

_GAINS = ("K_P", "K_I_per_s", "K_D_s")


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
    """A gain of a loop at the six breakpoints, physical: N or N m per m/s, m or rad."""

    loop: str
    gain: str
    values: tuple[float, ...]


@dataclass(frozen=True, repr=False)
class AutopilotCheck(Reported):
    """What was found about an autopilot; printed, a page of sentences.

    Attributes
    ----------
    name, description
        Of the autopilot.
    period_s, control
        Control period, and ``pid`` or ``lqr``.
    speeds_m_s
        Breakpoints of the gains.
    modes, gains
        The mode table, and the gains of the loops.
    safety
        A sentence per watch.
    notes, warnings
        Sentences about what is worth knowing, and about what is probably not meant.
    margins
        On a vehicle those of the loops; None without one.
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
    margins: AutopilotMargins | None = None

    def to_dict(self) -> dict[str, Any]:
        """The check as plain data for JSON."""
        plain = asdict(self)
        del plain["margins"]
        return plain | ({} if self.margins is None else self.margins.to_dict())

    def report(self, authority: Sequence[str] = ()) -> Report:
        """Loops and speeds, the worst problem, what to do next; then modes, gains, margins and notes.

        Parameters
        ----------
        authority : sequence of str, optional
            Of gains that were just made: what the vehicle can command, what the loss of an actuator costs,
            why a row has no loop.
        """
        return report_of(self, authority=authority)


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
    facts = autopilot_facts(autopilot)
    guidance = facts.guidance
    modes = tuple(
        ModeRow(mode.name, mode.from_speed_m_s, mode.loops, mode.depth_by, mode.actuators)
        for mode in facts.modes
    )
    notes = [
        f"Control: {facts.control.upper()} every {autopilot.period_s:g} s",
        f"Guidance: {guidance['method']}, lookahead {guidance['lookahead_m']:g} m, pitch to"
        f" {guidance['pitch_max_deg']:g} deg, speed to {guidance['speed_max_m_s']:g} m/s",
        *_loop_notes(facts),
    ]
    if not facts.hovers:
        notes.append(
            "No mode keeps the depth without speed: station-keeping is a circle of"
            f" {guidance['loiter_radius_m']:g} m"
        )
    warnings: list[str] = []
    margins = None
    if vehicle is not None:
        beside, wrong, margins = on_vehicle(autopilot, facts, vehicle, voltage_v=voltage_v)
        notes, warnings = notes + beside, wrong
    return AutopilotCheck(
        name=autopilot.name,
        description=autopilot.description,
        period_s=autopilot.period_s,
        control=facts.control,
        speeds_m_s=tuple(autopilot.speeds_m_s),
        modes=modes,
        gains=tuple(_gains(facts)),
        safety=tuple(
            safety_sentences(facts.safety, hovers=facts.hovers, loiter_radius_m=guidance["loiter_radius_m"])
        ),
        notes=tuple(notes),
        warnings=tuple(warnings),
        margins=margins,
    )


def _gains(facts: AutopilotFacts) -> list[GainRow]:
    """Gains that are not zero at every breakpoint."""
    rows = []
    for loop in facts.loops:
        for gain in _GAINS:
            values = tuple(map(float, facts.at_points(loop, gain)))
            if any(values):
                rows.append(GainRow(loop, gain, values))
    return rows


def _loop_notes(facts: AutopilotFacts) -> list[str]:
    notes = []
    for loop, table in facts.loops.items():
        shaped = table.get("reference_rad_s")
        reference = f"reference filtered at {shaped:g} rad/s" if shaped else "reference not filtered"
        notes.append(
            f"{loop.capitalize()}: at most {table['tau_max']:g} {_UNITS[loop]}, {reference}, anti-windup"
            f" {table['anti_windup']}"
        )
    if facts.regulators:
        notes.append(f"LQR: gains of {', '.join(facts.regulators)}")
    return notes
