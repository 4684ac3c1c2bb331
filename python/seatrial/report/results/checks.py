"""The words of checks before use: of a vehicle, an autopilot, a mission, a campaign, the gravest first.

What was found is in `seatrial.report.results.check_findings` in words. Held by ``tests/check``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import singledispatch
from typing import TYPE_CHECKING

from seatrial.base.finding import Finding, Severity
from seatrial.base.report import Column, Report, Section, Table
from seatrial.check.autopilot import AutopilotCheck, AutopilotMargins
from seatrial.check.campaign import CampaignCheck
from seatrial.check.legs import LegRow
from seatrial.check.mission import FlownCheck, MissionCheck
from seatrial.check.vehicle import VehicleCheck
from seatrial.flight.findings import GROUPS
from seatrial.inspect.consistency import accepted
from seatrial.inspect.corrections import NO_MOTION
from seatrial.report.results import trial_findings
from seatrial.report.results.check_findings import duration, water
from seatrial.report.results.check_findings import sentence as sentence
from seatrial.report.results.trial_findings import correction_table, current_sentence
from seatrial.report.results.tuning import SENSITIVITY_NOTE
from seatrial.vehicle.steady_state import Speed

if TYPE_CHECKING:
    from seatrial.inspect.corrections import Consistency


@singledispatch
def report(check: object) -> Report:
    """Report of a check of one file."""
    raise TypeError(f"expected a check of a file, found {type(check).__name__}")


def _outcome(warnings: Sequence[str]) -> str:
    """How many warnings a file has."""
    count = len(warnings)
    return f"{count} warning{'s' if count > 1 else ''}" if count else "nothing looks wrong"


@report.register
def _autopilot(check: AutopilotCheck, *, authority: Sequence[str] = ()) -> Report:
    """Three lines, modes, gains, margins, notes; what the safety watches as details."""
    warnings = check.warnings
    worst, next_step = (
        "nothing stands out: limits, gains and safety fit each other",
        "fly a mission: seatrial fly",
    )
    if warnings:
        worst, next_step = (
            warnings[0],
            ("stay within these limits in the missions, or change the file and check again"),
        )
    elif check.margins is None:
        next_step = "check it on its vehicle: seatrial check AUTOPILOT --vehicle VEHICLE"
    tables = [_mode_table(check), _gain_table(check)]
    if check.margins is not None:
        tables.append(_margin_table(check.margins))
    return Report(
        title=check.name,
        outcome=_outcome(warnings),
        good=_law(check),
        worst=worst,
        next_step=next_step,
        sections=(
            Section(check.description, tuple(authority), tuple(tables)),
            Section(sentences=(*(f"WARNING: {text}" for text in warnings), *check.notes)),
            Section("Safety", check.safety, details=True),
        ),
    )


def _law(check: AutopilotCheck) -> str:
    """Law, modes, breakpoints; on a vehicle the range of sound speeds and the least phase margin."""
    speeds = check.speeds_m_s
    count = len(check.modes)
    words = f"{check.control.upper()} every {check.period_s:g} s, {count} mode{'s' if count > 1 else ''}"
    if speeds:
        words += f", gains at {len(speeds)} speeds from {speeds[0]:.3g} to {speeds[-1]:.3g} m/s"
    sound = "" if check.margins is None else _sound(check.margins)
    return f"{words}; {sound}" if sound else words


def _sound(margins: AutopilotMargins) -> str:
    """Range of sound speeds and the least phase margin there, in a clause; nothing where none is."""
    if margins.sound is None:
        return ""
    low, high = margins.sound
    inside = [row.phase_deg for row in margins.rows if row.sound and low <= row.speed_m_s <= high]
    least = f", phase margin at least {min(inside):.0f} deg" if inside else ""
    return f"sound from {low:.2f} to {high:.2f} m/s with perfect sensors{least}"


def _margin_table(margins: AutopilotMargins) -> Table:
    """A row per breakpoint; margins of an unstable loop mean nothing."""

    def bounded(margin: float, digits: int) -> str:
        # A larger gain or delay is no limit.
        return f"{margin:.{digits}f}" if margin < 100.0 else "any"

    rows = [
        (
            row.mode,
            f"{row.speed_m_s:.2f}",
            *(
                (f"{row.phase_deg:.0f}", bounded(row.gain, 1), bounded(row.delay_s, 2))
                if row.doubles_s is None
                else ("", "", "")
            ),
            row.verdict,
        )
        for row in margins.rows
    ]
    head = ("mode", "at m/s", "phase, deg", "gain", "delay, s", Column("verdict", align="left"))
    note = f"Gain: by which factor it may rise. {SENSITIVITY_NOTE}"
    return Table.of("Margins with perfect sensors, the least of all loops", head, rows, note=note)


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


@report.register
def _vehicle(check: VehicleCheck) -> Report:
    """Three lines, what every actuator does, speeds and turns, notes."""
    worst = "nothing stands out: signs, buoyancy, damping and stability are plausible"
    next_step = (
        "compare the force of each actuator below with the real vehicle; then write start gains (seatrial"
        " autopilot) or identify it from trials (seatrial identify)"
    )
    if check.warnings:
        worst, next_step = check.warnings[0], _next_step(check.warned)
    straight = [
        _speed_table(
            "Speed on a straight course", "all ahead", [(_command(row), row) for row in check.speeds]
        ),
        _speed_table("What a speed takes", "speed", [(f"{row.speed_kn:g} kn", row) for row in check.cruises]),
    ]
    pushes = [
        statement
        for first, *others in check.by_actuator()
        for statement in (str(first), *(f"{push.size}: {push.words}" for push in others))
    ]
    return Report(
        title=check.name,
        outcome=_outcome(check.warnings),
        good=_what_it_can(check),
        worst=worst,
        next_step=next_step,
        sections=(
            Section(check.description, sentences=tuple(pushes)),
            Section(
                sentences=(*(f"WARNING: {text}" for text in check.warnings), *check.notes),
                tables=(*straight, _turn_table(check)),
            ),
        ),
    )


def _next_step(warned: Sequence[Finding]) -> str:
    """What to do about warnings; a vehicle may rightly be unstable on its course or in pitch by itself."""
    if all(finding.kind == "plane stable up to" for finding in warned):
        return "write start gains (seatrial autopilot), and fly missions no faster than that"
    if all(finding.kind == "plane unstable" and finding["fins"] for finding in warned):
        return (
            "where the real vehicle is stable, correct the vehicle file and check it again; where it is not,"
            " go on: an autopilot holds it (seatrial autopilot), and its margins tell whether well enough"
        )
    return "correct the vehicle file and check it again before use"


def _what_it_can(check: VehicleCheck) -> str:
    """Top speed, what can be commanded, net buoyancy."""
    fastest = max(check.speeds, key=lambda row: row.speed_m_s, default=None)
    top = (
        "No steady speed ahead"
        if fastest is None
        else (f"Top speed {fastest.speed_m_s:.2f} m/s at {_command(fastest)}")
    )
    able = (
        f"commands {' '.join(check.rows)} independently" if check.rows else "commands no axis independently"
    )
    count = len(check.by_actuator())
    actuators = "1 actuator" if count == 1 else f"{count} actuators"
    return f"{top}; {actuators}, {able}; net buoyancy {check.statics.net_n:+.3g} N"


_TURN_HEADS = {
    "under way": "inner side at half",
    "inner side stopped": "stopped",
    "inner side half astern": "half astern",
    "on the spot": "opposed",
}


def _speed_table(title: str, first: str, rows: Sequence[tuple[str, Speed]]) -> Table:
    """Table of speeds; a column that no row fills is left out when shown."""
    cells = [
        (
            label,
            _command(row) if first == "speed" else "",
            f"{row.speed_m_s:.2f}",
            "" if first == "speed" else f"{row.speed_kn:.1f}",
            f"{row.thrust_n:.3g}",
            "" if row.power_w is None else _rounded(row.power_w),
            "" if row.endurance_h is None else f"{row.endurance_h:.2g}",
            "" if row.range_km is None else _rounded(row.range_km),
        )
        for label, row in rows
    ]
    head = (first, "all ahead", "m/s", "kn", "thrust, N", "power, W", "endurance, h", "range, km")
    return Table.of(title, head, cells)


def _turn_table(check: VehicleCheck) -> Table:
    """One row per command of the outer side, one cell per kind of turn."""
    kinds = list(dict.fromkeys(turn.kind for turn in check.turns))
    cells: dict[str, dict[str, str]] = {}
    for turn in check.turns:
        digits = 2 if turn.radius_m < 10.0 else 1
        cells.setdefault(f"{turn.command:.4g} {turn.unit}", {})[turn.kind] = (
            f"{turn.radius_m:.{digits}f} m {abs(turn.rate_deg_s):.1f}°/s"
        )
    rows = [(command, *(row.get(kind, "") for kind in kinds)) for command, row in cells.items()]
    head = ("outer side", *(_TURN_HEADS[kind] for kind in kinds))
    return Table.of("Steady turns: radius and rate", head, rows)


def _command(row: Speed) -> str:
    """The command as a person sets it: whole revolutions and microseconds, newtons in three digits."""
    return f"{row.command:.3g} N" if row.unit == "N" else f"{row.command:.0f} {row.unit}"


def _rounded(value: float) -> str:
    """Two digits of what is small, no decimals of what is not."""
    return f"{value:.2g}" if value < 9.95 else f"{value:.0f}"


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


def safety_sentences(check: AutopilotCheck) -> list[str]:
    """A sentence per watch of an autopilot, and how it surfaces."""
    safety, words = check.watches, dict(_REACTIONS)
    if not check.hovers:
        words["hold"] = f"circle at {check.loiter_radius_m:g} m"
    battery, actuator, progress = safety["battery"], safety["actuator"], safety["progress"]
    contrary, speed = safety["contradiction"], safety["speed"]
    lines = []
    for key, name in GROUPS.items():
        stale = safety[f"stale_{key}"]
        where = " on a leg that follows the bottom" if key == "altitude" else ""
        lines.append(f"No {name} for {stale['after_s']:g} s{where}: {words[stale['reaction']]}")
    lines += [f"{limit}: {words[safety[key]]}" for key, limit in _LIMITS.items()]
    lines += [
        f"Battery below {100.0 * battery['below']:g} %: {words[battery['reaction']]}",
        f"An actuator {100.0 * actuator['deviation']:g} % of its largest signal off for"
        f" {actuator['after_s']:g} s: allocate without it, and {words[actuator['reaction']]}",
        f"No nearer to the waypoint for {progress['after_s']:g} s: {words[progress['reaction']]}",
    ]
    # A measurement that contradicts its rates counts as lost.
    limits = {"position": ("position_m", "m"), "depth": ("depth_m", "m"), "attitude": ("angle_deg", "deg")}
    for key, (limit, unit) in limits.items():
        reaction = words[safety[f"stale_{key}"]["reaction"]]
        lines.append(
            f"The {GROUPS[key]} {contrary[limit]:g} {unit} from what its rates say, for"
            f" {contrary['after_s']:g} s: {reaction}"
        )
    aborts = safety["stale_depth"]["reaction"] == "abort"
    return [
        *lines,
        f"A velocity that changes by {contrary['roughness_m_s']:g} m/s from step to step: told, and"
        f" {words['continue']}",
        f"The speed {speed['off_m_s']:g} m/s off for {speed['after_s']:g} s: {words[speed['reaction']]}",
        f"An unused channel or the battery silent: told, and {words['continue']}",
        f"No higher after {safety['ascent_after_s']:g} s of surfacing:"
        f" {words['abort' if aborts else 'continue']}",
        f"Surfacing: at {safety['surface_speed_m_s']:g} m/s until {safety['surfaced_above_m']:g} m of depth",
    ]


@report.register
def _mission(check: MissionCheck) -> Report:
    """Length and time, the worst problem, what to do next; then legs and notes."""
    worst, next_step = "nothing stands out: legs, limits and fence fit each other", "fly it: seatrial fly"
    if check.flown:
        worst = "nothing stands out in still water"
        if len(check.flown) > 1:
            four = len(check.flown) > 2
            worst += f" and in {'currents from four sides' if four else water(check.flown[1].current)}"
    if check.warnings:
        worst = check.warnings[0]
        next_step = check.remedy or "change the mission or the vehicle's limits, and check again"
    energy = "" if check.energy is None else f", {check.energy.total_wh:.3g} Wh"
    tables = [_leg_table(check.legs)]
    if check.flown:
        tables.append(_flown_table(check.flown, check.sensors))
    return Report(
        title=check.name,
        outcome=_outcome(check.warnings),
        good=(
            f"{check.waypoints} waypoint{'' if check.waypoints == 1 else 's'}, {check.length_m:.0f} m,"
            f" planned to take {duration(check.planned_s)}{energy}"
        ),
        worst=worst,
        next_step=next_step,
        sections=(
            Section(
                check.description,
                (*(f"WARNING: {text}" for text in check.warnings), *check.notes),
                tuple(tables),
            ),
        ),
    )


_LABEL = 22  # characters: the table of legs stays within 80 columns

_MOST_LEGS = 60  # rows that fit two screens


def _leg_table(legs: Sequence[LegRow]) -> Table:
    """A row per leg of the file, the first of very many."""
    rows = [
        (
            str(row.number),
            row.label if len(row.label) <= _LABEL else row.label[: _LABEL - 1] + "…",
            str(row.waypoints),
            f"{row.length_m:.0f}",
            f"{row.slope_deg:+.0f}" if abs(row.slope_deg) >= 0.5 else "0",
            _level(row),
            f"{row.speed_m_s:g}",
            duration(row.time_s),
            "" if row.power_w is None else f"{row.power_w:.0f}",
        )
        for row in legs[:_MOST_LEGS]
    ]
    notes = []
    if len(legs) > _MOST_LEGS:
        notes.append(f"and {len(legs) - _MOST_LEGS} more legs; --json lists them all")
    if any(row.vertical == "altitude" for row in legs):
        notes.append("^ above the bottom")
    head = ("leg", "what", "points", "m", "deg", "depth, m", "m/s", "time", "W")
    return Table.of("Legs", head, rows, left=2, note="; ".join(notes))


def _level(row: LegRow) -> str:
    low, high = row.level_m
    mark = "^" if row.vertical == "altitude" else ""
    return f"{low:.3g}{mark}" if high - low < 0.05 else f"{low:.3g}-{high:.3g}{mark}"


def _flown_table(flown: Sequence[FlownCheck], sensors: str) -> Table:
    """A row per water."""
    rows = [
        (
            water(flight.current).removeprefix("a current of "),
            flight.outcome if len(flight.outcome) < 24 else "not as promised",
            f"{flight.reached}/{flight.waypoints}",
            f"{flight.clearance_m:.1f}" if math.isfinite(flight.clearance_m) else "",
            f"{flight.depth_largest_m:.1f}",
            f"{flight.duration_s:.0f}",
        )
        for flight in flown
    ]
    head = ("water", "outcome", "reached", "clear, m", "deepest, m", "time, s")
    return Table.of(f"Flown beforehand with {sensors}", head, rows, left=2)


_READY = {True: "Ready to identify", False: "Nothing to identify: it only tunes or verifies an autopilot"}


@report.register
def _campaign(check: CampaignCheck) -> Report:
    """Three lines, trials, stages, inputs; what was found about each trial as details."""
    worst, next_step = _worst_of_campaign(check)
    inputs = () if check.inputs is None else tuple(check.inputs.sentences())
    scale = () if check.scale is None else tuple(check.scale.sentences())
    free = tuple(f"{stage.name}: {', '.join(stage.coefficients)}" for stage in check.stages)
    findings = tuple(
        Section(f"Trial {name}", tuple(str(read).splitlines()), details=True)
        for name, read in check.reports.items()
    )
    samples = sum(stage.samples for stage in check.stages)
    minutes = sum(read.duration_s for read in check.reports.values()) / 60.0
    count = sum(len(stage.coefficients) for stage in check.stages)
    return Report(
        title=check.name,
        outcome="not ready" if check.problems else _READY[bool(check.stages)],
        good=(
            f"{len(check.reports)} trial{'s' if len(check.reports) != 1 else ''} of {check.vehicle}"
            f" ({minutes:.0f} min); {len(check.stages)} stages free {count} coefficients on {samples} samples"
        ),
        worst=worst,
        next_step=next_step,
        sections=(
            Section(sentences=(*check.problems, *check.warnings)),
            Section(sentences=free, tables=(_trial_table(check), _stage_table(check))),
            Section(
                # More are among the details.
                "Corrections proposed",
                tuple(proposal.text for proposal in check.proposals[:6]),
            ),
            Section("Kind of data", check.data),
            Section("Inputs over what is fitted", inputs, (_input_table(check),)),
            Section("Scale of all forces", scale),
            *findings,
            *(_consistency(name, consistency) for name, consistency in check.consistency.items()),
            *(Section(f"Motion of trial {n}", k.details, details=True) for n, k in check.kinds.items()),
        ),
    )


def warnings(check: CampaignCheck) -> list[str]:
    """Channels that contradict one another, then what an identification says before its first search."""
    unlike = [
        f"WARNING: trial {name}: {text}"
        for name, consistency in check.consistency.items()
        for text in consistency.contradictions
    ]
    return [*unlike, *check.prepared]


def data(check: CampaignCheck) -> list[str]:
    """What kind of data the trials are, the worst first; then hold-outs for trials that have none."""
    kinds = check.kinds
    lines = [f"trial {name}: {text}" for name, kind in kinds.items() for text in kind.warnings]
    for weak in check.weak:
        most, trials = weak["most"], ", ".join(weak["trials"])
        lines.append(
            f"stage {weak.subject}: {most.channel} hardly moves in {trials} ({most.over_noise:.1f} times its"
            f" noise): record a manoeuvre, or leave axis {weak['axis']} out"
        )
    still = trial_findings.sentence(NO_MOTION)
    lines += [f"trial {name}: {still}" for name, kind in kinds.items() if kind.still]
    lines += [f"trial {name}: {kind.done}" for name, kind in kinds.items()]
    return [*lines, *(f"trial {name}: {kinds[name].windows.sentence}" for name in check.unsplit)]


def _consistency(name: str, consistency: Consistency) -> Section:
    """Everything about the channels of one trial, as details."""
    statements = [*(correction.sentence for correction in consistency.corrections), *consistency.missing]
    if (current := accepted(consistency)) is not None:
        statements.append(
            f"a slow current, {current_sentence(current)}: [trials.{name}.corrections] {current.line}"
        )
    return Section(
        f"Consistency of trial {name}", tuple(statements), (correction_table(consistency),), details=True
    )


def _worst_of_campaign(check: CampaignCheck) -> tuple[str, str]:
    """The worst problem of a campaign, and what to do about it."""
    if check.problems:
        return check.problems[0], "correct the campaign or the recording and check again"
    identify = "run seatrial identify on this campaign"
    if not check.stages:
        identify = "run seatrial tune or seatrial verify on this campaign"
    correct = f"correct the trial or its column map if it is used; then {identify}"
    findings = [
        (finding, f"trial {name}: {finding.line}")
        for name, read in check.reports.items()
        for finding in read.findings
    ]
    open_ = [proposal.text for proposal in check.proposals if not proposal.done]
    unlike = [
        f"trial {name}: {contradiction}"
        for name, channels in check.consistency.items()
        for contradiction in channels.contradictions
    ]
    impossible = [
        replace(finding, subject=name) for name, kind in check.kinds.items() for finding in kind.impossible
    ]
    mapped = [text for finding, text in findings if finding.kind in ("uncommanded", "mostly masked")]
    if (
        text := next((text for finding, text in findings if finding.severity == Severity.PROBLEM), None)
    ) is not None:
        return text, correct
    if unlike:
        return unlike[0], correct
    if impossible:
        problem, remedy = trial_findings.problem(impossible[0]), trial_findings.remedy(impossible[0])
        return problem, f"{remedy}; then {identify}"
    if mapped:
        return mapped[0], correct
    if open_:
        return open_[0], f"paste the corrections that you accept into the campaign; then {identify}"
    if warned := [text for finding, text in findings if finding.severity == Severity.WEAKNESS]:
        return warned[0], correct
    scale_sentences = [] if check.scale is None else check.scale.sentences()
    for statement in (
        *check.warnings,
        *([] if check.inputs is None else check.inputs.sentences()),
        *scale_sentences,
    ):
        if statement.startswith("WARNING"):
            return statement.removeprefix("WARNING").strip(" :"), f"settle this first; then {identify}"
    return "no warning about recordings, inputs or scale", identify


def _trial_table(check: CampaignCheck) -> Table:
    rows = [
        (
            name,
            f"{read.duration_s:.1f}",
            f"{read.rate_hz:.4g}",
            str(read.samples),
            str(max(read.masked.values(), default=0)),
            str(sum(finding.severity > Severity.NOTE for finding in read.findings) or ""),
        )
        for name, read in check.reports.items()
    ]
    return Table.of("Trials", ("trial", "duration, s", "rate, Hz", "samples", "masked", "warnings"), rows)


def _stage_table(check: CampaignCheck) -> Table:
    rows = [
        (
            stage.name,
            ", ".join(stage.trials),
            stage.free,
            str(len(stage.coefficients)),
            str(stage.segments),
            str(stage.samples),
            f"{1e3 * stage.step_s:.3g}",
        )
        for stage in check.stages
    ]
    head = ("stage", "trials", "free", "coefficients", "segments", "samples", "step, ms")
    return Table.of("Stages in the order of their run", head, rows, left=3)


def _input_table(check: CampaignCheck) -> Table:
    drives = () if check.inputs is None else check.inputs.drives
    rows = [
        (drive.actuator, drive.group, f"{drive.rms_n:.3g}", f"{100.0 * drive.ahead:.0f}") for drive in drives
    ]
    head = ("actuator", "group", "thrust about its mean, N", "impulse ahead, %")
    return Table.of("", head, rows, left=2)
