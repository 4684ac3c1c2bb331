"""The words of the checks before use: of an autopilot and of a vehicle, the gravest warning first."""

from __future__ import annotations

from collections.abc import Sequence
from functools import singledispatch

from seatrial.base.report import Column, Report, Section, Table
from seatrial.check.autopilot import AutopilotCheck
from seatrial.check.vehicle import IF_STABLE, SLOWER, VehicleCheck
from seatrial.vehicle.steady_state import Speed


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
        tables.append(check.margins.table())
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
    sound = "" if check.margins is None else check.margins.how_good()
    return f"{words}; {sound}" if sound else words


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
        worst, next_step = check.warnings[0], _next_step(check.warnings)
    straight = [
        _speed_table(
            "Speed on a straight course", "all ahead", [(_command(row), row) for row in check.speeds]
        ),
        _speed_table("What a speed takes", "speed", [(f"{row.speed_kn:g} kn", row) for row in check.cruises]),
    ]
    pushes = [
        sentence
        for first, *others in check.by_actuator()
        for sentence in (str(first), *(f"{push.size}: {push.words}" for push in others))
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


def _next_step(warnings: Sequence[str]) -> str:
    """What to do about warnings; a vehicle may rightly be unstable on its course or in pitch by itself."""
    if all(SLOWER in text for text in warnings):
        return "write start gains (seatrial autopilot), and fly missions no faster than that"
    if all("unstable at" in text and IF_STABLE in text for text in warnings):
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
