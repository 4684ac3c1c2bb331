"""An autopilot before it steers: modes, gains and safety; on a vehicle, what it cannot do there.

The core refuses what does not fit (a loop whose row the vehicle file does not call controllable, an unknown
actuator). Here stand the doubts: breakpoints and speeds beyond reach, loops with little margin, rows that
nothing commands, demands larger than the actuators' reach, an abort of a vehicle that sinks. `seatrial
autopilot` and `seatrial check` show the same margins: sensors count as perfect, and what typical ones leave
stands beside, as `seatrial tune` counts them. Held by tests/check/test_check_autopilot.py and
tests/cli/test_cli_autopilot.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.finding import Finding, Severity
from seatrial.base.plain import Plain
from seatrial.base.report import Report, clause_of, report_of, writer_of
from seatrial.check.file_check import FileCheck, note, warning
from seatrial.control_design.margin_report import MarginRow, autopilot_margins, sound_speeds
from seatrial.control_design.operating_points import (
    AutopilotFacts,
    AutopilotMode,
    autopilot_facts,
    mode_at,
    reachable_points,
    refuse_misfit,
    top_speeds,
)
from seatrial.control_design.start_autopilot import least_lookahead_of, lookahead_share
from seatrial.flight.checks import mismatch
from seatrial.vehicle.actuators import LOOPS, NOMINAL_V, ROWS, reach, thrusts
from seatrial.vehicle.stability import statics
from seatrial.vehicle.steady_state import turning_radius

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle

_GAINS = ("K_P", "K_I_per_s", "K_D_s")

_TYPICAL = "typical"


@dataclass(frozen=True)
class AutopilotCheckSettings:
    """From where on an autopilot is doubted on a vehicle."""

    #: Smallest over largest singular value of the allocation: a row below it cannot be used in practice.
    least_singular_share: float = 1e-2
    #: Radius of a loiter circle over that of the tightest turn: room for control.
    loiter_ratio: float = 1.2
    #: Needed over given lookahead from which on a path nearly oscillates.
    lookahead_ratio: float = 1.2
    #: Last breakpoint over the top speed below which gains stay constant over a wide range.
    breakpoint_share: float = 0.7
    #: Demand of a loop over what the actuators reach: a few per cent are rounding of the file.
    demand_ratio: float = 1.05


SETTINGS = AutopilotCheckSettings()


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


@dataclass(frozen=True)
class AutopilotMargins(Plain, only="margins=rows margins_typical_sensors=typical sound_m_s=sound"):
    """Margins of an autopilot on a vehicle."""

    rows: tuple[MarginRow, ...]  #: Per breakpoint that the vehicle reaches, with perfect sensors.
    typical: tuple[MarginRow, ...]  #: The same with typical sensors.
    #: Range of speeds ahead at which the loops are sound with perfect sensors, m/s; None without any.
    sound: tuple[float, float] | None


@dataclass(frozen=True, repr=False)
class AutopilotCheck(
    FileCheck, without="findings watches hovers loiter_radius_m margins", also="notes warnings safety"
):
    """What was found about an autopilot; printed, a page of sentences."""

    #: Control period, and ``pid`` or ``lqr``.
    period_s: float
    control: str
    speeds_m_s: tuple[float, ...]  #: Breakpoints of the gains.
    #: The mode table, and the gains of the loops.
    modes: tuple[ModeRow, ...]
    gains: tuple[GainRow, ...]
    watches: Mapping[str, Any]  #: The table ``[safety]`` with its defaults.
    #: Whether a mode keeps the depth without speed; an autopilot without one circles instead.
    hovers: bool
    loiter_radius_m: float
    margins: AutopilotMargins | None = None  #: On a vehicle those of the loops; None without one.

    @property
    def safety(self) -> tuple[str, ...]:
        """A sentence per watch."""
        return tuple(writer_of(self).safety_sentences(self))

    def to_dict(self) -> dict[str, Any]:
        """The check as plain data for JSON."""
        return super().to_dict() | ({} if self.margins is None else self.margins.to_dict())

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
    >>> check = check_autopilot(Autopilot.load("cwolf"), vehicle=st.Vehicle.load("cwolf"))
    >>> [mode.name for mode in check.modes]
    ['hover', 'cruise']
    """
    facts = autopilot_facts(autopilot)
    findings = _by_itself(autopilot, facts)
    margins = None
    if vehicle is not None:
        refuse_misfit(autopilot, vehicle)
        margins = margins_on(autopilot, vehicle, voltage_v=voltage_v)
        findings += _on_vehicle(autopilot, facts, vehicle, margins, voltage_v)
    return AutopilotCheck(
        name=autopilot.name,
        description=autopilot.description,
        findings=tuple(findings),
        period_s=autopilot.period_s,
        control=facts.control,
        speeds_m_s=tuple(autopilot.speeds_m_s),
        modes=tuple(
            ModeRow(mode.name, mode.from_speed_m_s, mode.loops, mode.depth_by, mode.actuators)
            for mode in facts.modes
        ),
        gains=tuple(_gains(facts)),
        watches=facts.safety,
        hovers=facts.hovers,
        loiter_radius_m=facts.guidance["loiter_radius_m"],
        margins=margins,
    )


def _gains(facts: AutopilotFacts) -> list[GainRow]:
    """Gains that are not zero at every breakpoint."""
    values = {(loop, gain): facts.at_points(loop, gain) for loop in facts.loops for gain in _GAINS}
    return [GainRow(*of, tuple(map(float, row))) for of, row in values.items() if any(row)]


def _by_itself(autopilot: Autopilot, facts: AutopilotFacts) -> list[Finding]:
    """Notes on law, guidance and loops."""
    notes = [
        note("control law", facts.control.upper(), period_s=autopilot.period_s),
        note("guidance", **facts.guidance),
    ]
    for loop, table in facts.loops.items():
        shaped = {"reference_rad_s": table.get("reference_rad_s"), "anti_windup": table["anti_windup"]}
        notes.append(note("loop", loop, demand=table["tau_max"], unit=_unit(loop), **shaped))
    if facts.regulators:
        notes.append(note("regulators", ", ".join(facts.regulators)))
    if not facts.hovers:
        notes.append(note("no hovering", loiter_radius_m=facts.guidance["loiter_radius_m"]))
    return notes


def _unit(loop: str) -> str:
    """Unit of a loop's demand."""
    return "N" if ROWS[LOOPS.index(loop)] in "XYZ" else "N m"


def margins_on(autopilot: Autopilot, vehicle: Vehicle, *, voltage_v: float) -> AutopilotMargins:
    """Margins of an autopilot at the breakpoints that a vehicle reaches."""
    reached = reachable_points(vehicle, autopilot, voltage_v=voltage_v)
    speeds = [float(speed) for speed in np.asarray(autopilot.speeds_m_s)[reached]]
    return AutopilotMargins(
        rows=tuple(autopilot_margins(vehicle, autopilot, speeds_m_s=speeds)),
        typical=tuple(autopilot_margins(vehicle, autopilot, speeds_m_s=speeds, sensors=_TYPICAL)),
        sound=sound_speeds(vehicle, autopilot, voltage_v=voltage_v),
    )


def _on_vehicle(
    autopilot: Autopilot, facts: AutopilotFacts, vehicle: Vehicle, margins: AutopilotMargins, voltage_v: float
) -> list[Finding]:
    """What an autopilot cannot do on a vehicle."""
    # An autopilot of another vehicle explains most of what follows, and weak loops most of the rest.
    foreign = []
    if (doubt := mismatch(autopilot, vehicle)) is not None:
        foreign.append(warning("made for another vehicle", sentence=clause_of(doubt, "flight_findings")))
    weak = (
        [*weak_points(margins.rows, margins.sound), *_with_typical_sensors(margins)] if margins.rows else []
    )
    astern, top = top_speeds(vehicle, voltage_v=voltage_v)
    findings = [
        *_breakpoints(list(autopilot.speeds_m_s), astern, top),
        *_speed_limit(facts, top),
        *(finding for mode in facts.modes for finding in _mode(facts, mode, vehicle, top, voltage_v)),
    ]
    notes = [finding for finding in findings if finding.severity == Severity.NOTE]
    wrong = [finding for finding in findings if finding.severity > Severity.NOTE]
    return [
        *foreign,
        *notes,
        *weak,
        *wrong,
        *_paths(facts, vehicle, top),
        *_circle(facts, vehicle, voltage_v),
        *_abort(facts, vehicle),
    ]


def weak_points(margins: Sequence[MarginRow], sound: tuple[float, float] | None) -> list[Finding]:
    """Findings on breakpoints that are not sound; `sound` is the sound range, m/s."""
    weak = [row for row in margins if not row.sound]
    ahead = [row for row in weak if row.speed_m_s >= 0.0]
    astern = [row for row in weak if row.speed_m_s < 0.0]
    if sound is None:
        return [warning("no speed sound", rows=ahead)]
    findings = [note("astern not sound", rows=astern)] if astern else []
    if ahead:
        findings.append(warning("speeds not sound", low_m_s=sound[0], high_m_s=sound[1], rows=ahead))
    return findings


def _with_typical_sensors(margins: AutopilotMargins) -> list[Finding]:
    """Breakpoints that are sound with perfect sensors and not with typical ones; grave where motions grow."""
    sound = {row.speed_m_s for row in margins.rows if row.sound and row.speed_m_s >= 0.0}
    late = [row for row in margins.typical if not row.sound and row.speed_m_s in sound]
    if not late:
        return []
    worst = max(late, key=lambda row: (bool(row.grows), row.sensitivity))
    make = warning if any(row.grows for row in late) else note
    return [make("delay of sensors", rows=[worst], others=len(late) - 1)]


def _breakpoints(speeds: list[float], astern: float, top: float) -> list[Finding]:
    """What the breakpoints have to do with the speeds that the vehicle reaches."""
    inside = sum(astern <= speed <= top for speed in speeds)
    reached = {"inside": inside, "count": len(speeds), "astern_m_s": astern, "top_m_s": top}
    findings = [note("breakpoints", **reached)]
    if inside < 2:
        findings.append(warning("few breakpoints within reach", **reached))
    elif speeds[-1] < SETTINGS.breakpoint_share * top:
        findings.append(warning("breakpoints below top speed", last_m_s=speeds[-1], top_m_s=top))
    return findings


def _speed_limit(facts: AutopilotFacts, top: float) -> list[Finding]:
    """A limit of the speed beyond the top speed."""
    limit = facts.guidance["speed_max_m_s"]
    return [note("speed limit without effect", limit_m_s=limit, top_m_s=top)] if limit > top else []


def _mode(
    facts: AutopilotFacts, mode: AutopilotMode, vehicle: Vehicle, top: float, voltage_v: float
) -> list[Finding]:
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
    findings = [
        warning("row not commanded", mode.name, row=row, loop=LOOPS[ROWS.index(row)], m_s=speed)
        for row in _not_commanded(matrix, rows)
    ]
    if findings or mode.actuators:
        return findings
    for row, (low, high) in reach(vehicle, speed, "".join(rows), voltage_v=voltage_v).items():
        loop = LOOPS[ROWS.index(row)]
        asked = facts.loops.get(loop, {}).get("tau_max", 0.0)
        # A loop needs both directions, surge only that ahead.
        least = high if row == "X" else min(high, -low)
        if asked > SETTINGS.demand_ratio * least:
            demand = {"demand": asked, "reach": least, "unit": _unit(loop), "m_s": speed}
            findings.append(note("demand beyond reach", mode.name, loop=loop, **demand))
    return findings


def _not_commanded(matrix: Any, rows: Sequence[str]) -> list[str]:
    """Rows that the columns do not span independently of the rows before them, forces first."""
    kept: list[str] = []
    missing = []
    for row in sorted(rows, key="XNMZYK".index):
        chosen = matrix[["XYZKMN".index(r) for r in [*kept, row]]]
        sizes = np.linalg.norm(chosen, axis=1, keepdims=True)
        values = np.linalg.svd(chosen / np.maximum(sizes, 1e-12), compute_uv=False)
        dependent = len(values) < len(chosen) or values[-1] < SETTINGS.least_singular_share * values[0]
        if sizes.min() < 1e-9 or dependent:
            missing.append(row)
        else:
            kept.append(row)
    return missing


def _paths(facts: AutopilotFacts, vehicle: Vehicle, top: float) -> list[Finding]:
    """Lookahead distances behind which a path would oscillate at a breakpoint that the vehicle reaches."""
    findings = []
    holds = facts.guidance["lookahead_speed_m_s"]
    for loop, key in (("heading", "lookahead_m"), ("pitch", "lookahead_vertical_m")):
        worst = (SETTINGS.lookahead_ratio, 0.0, 0.0)
        for speed in (speed for speed in facts.speeds_m_s if 0.0 < speed <= top):
            mode = mode_at(facts, speed)
            if loop not in mode.loops or (loop == "pitch" and mode.depth_by != "pitch"):
                continue
            least = least_lookahead_of(vehicle, facts, loop, speed) / lookahead_share(speed, holds)
            if least > worst[0] * facts.guidance[key]:
                worst = (least / facts.guidance[key], speed, least)
        if worst[1]:
            distances = {"given_m": facts.guidance[key], "needed_m": worst[2], "m_s": worst[1]}
            findings.append(warning("short lookahead", loop, key=key, **distances))
    return findings


def _circle(facts: AutopilotFacts, vehicle: Vehicle, voltage_v: float) -> list[Finding]:
    """A loiter circle that is tighter than the vehicle turns."""
    if facts.hovers:
        return []
    radius = facts.guidance["loiter_radius_m"]
    speeds = [speed for speed in facts.speeds_m_s if speed > 0.0]
    radii = [r for speed in speeds if (r := turning_radius(vehicle, speed, voltage_v=voltage_v)) is not None]
    if radii and radius < SETTINGS.loiter_ratio * max(radii):
        return [warning("tight loiter circle", radius_m=radius, tightest_m=max(radii))]
    return []


def _abort(facts: AutopilotFacts, vehicle: Vehicle) -> list[Finding]:
    """A reaction that stops all actuators of a vehicle that sinks."""
    safety = facts.safety
    reactions = [value.get("reaction") if isinstance(value, dict) else value for value in safety.values()]
    heavy_n = -statics(vehicle).net_n
    sinks = "abort" in reactions and heavy_n > 0.0
    return [warning("abort sinks", vehicle.name, heavy_n=heavy_n)] if sinks else []
