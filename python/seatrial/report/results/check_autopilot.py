"""The words of an autopilot's check: margins, modes and warnings, the gravest first."""

from __future__ import annotations

from collections.abc import Sequence

from seatrial.base.report import Column, Report, Section, Table
from seatrial.check.autopilot import AutopilotCheck


def report(check: AutopilotCheck, *, authority: Sequence[str] = ()) -> Report:
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
    count = len(warnings)
    tables = [_mode_table(check), _gain_table(check)]
    if check.margins is not None:
        tables.append(check.margins.table())
    return Report(
        title=check.name,
        outcome=f"{count} warning{'s' if count > 1 else ''}" if count else "nothing looks wrong",
        good=_how_good(check),
        worst=worst,
        next_step=next_step,
        sections=(
            Section(check.description, tuple(authority), tuple(tables)),
            Section(sentences=(*(f"WARNING: {text}" for text in warnings), *check.notes)),
            Section("Safety", check.safety, details=True),
        ),
    )


def _how_good(check: AutopilotCheck) -> str:
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
