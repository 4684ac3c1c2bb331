"""`seatrial check` of a mission or an autopilot file: tables and sentences."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from seatrial._core import Vehicle
    from seatrial.check.autopilot import AutopilotCheck
    from seatrial.check.legs import LegRow
    from seatrial.check.mission import MissionCheck

_LABEL = 22  # characters: the table of legs stays within 80 columns
_MOST_LEGS = 60


def check_mission_file(
    target: str,
    vehicle: str | None,
    autopilot: str | None,
    *,
    voltage_v: float,
    out: Path | None,
    figures: bool,
    json: bool,
) -> None:
    """Check a mission file, and draw its plan."""
    from seatrial._core import Autopilot, Vehicle
    from seatrial.check.mission import check_mission
    from seatrial.cli.console import list_figures, output, print_json
    from seatrial.file_kind import loaded
    from seatrial.mission import Mission

    mission = Mission.load(target)
    found = check_mission(
        mission,
        vehicle=None if vehicle is None else loaded(Vehicle, vehicle, "--vehicle"),
        autopilot=None if autopilot is None else loaded(Autopilot, autopilot, "--autopilot"),
        voltage_v=voltage_v,
    )
    folder = out or Path("runs") / f"check-{Path(target).stem}"
    written: list[Path] = []
    if figures:
        from seatrial.plot.mission_plan import mission_plan
        from seatrial.plot.style import save

        written = save(mission_plan(mission), folder / "mission_plan")
    metres = None
    if mission.origin is not None and (figures or out is not None):
        metres = folder / "mission_metres.toml"
        folder.mkdir(parents=True, exist_ok=True)
        metres.write_text(mission.to_toml(), encoding="utf-8")
    if json:
        print_json(found.to_dict() | {"figures": [str(path) for path in written]})
        return
    console = output()
    _print_mission(console, found)
    if metres is not None:
        console.print(f"In metres, as the autopilot reads it: {metres}", soft_wrap=True, markup=False)
    list_figures(console, written)


def check_autopilot_file(target: str, vehicle: str | None, *, voltage_v: float, json: bool) -> None:
    """Check an autopilot file."""
    from seatrial._core import Autopilot, Vehicle
    from seatrial.check.autopilot import check_autopilot
    from seatrial.cli.console import output, print_json
    from seatrial.file_kind import loaded

    on: Vehicle | None = None if vehicle is None else loaded(Vehicle, vehicle, "--vehicle")
    found = check_autopilot(Autopilot.load(target), vehicle=on, voltage_v=voltage_v)
    if json:
        print_json(found.to_dict())
        return
    _print_autopilot(output(), found)


def _print_mission(console: Console, found: MissionCheck) -> None:
    from seatrial.check.mission import duration
    from seatrial.cli.console import table

    _title(console, found.name, found.description)
    powered = any(row.power_w is not None for row in found.legs)
    head = ["leg", "what", "points", "m", "deg", "depth, m", "m/s", "time", *(["W"] if powered else [])]
    shown, left_out = found.legs, 0
    if len(found.legs) > _MOST_LEGS:
        shown, left_out = found.legs[:_MOST_LEGS], len(found.legs) - _MOST_LEGS
    rows = [
        [
            str(row.number),
            _shortened(row.label),
            str(row.waypoints),
            f"{row.length_m:.0f}",
            f"{row.slope_deg:+.0f}" if abs(row.slope_deg) >= 0.5 else "0",
            _level(row),
            f"{row.speed_m_s:g}",
            duration(row.time_s),
            *([_power(row)] if powered else []),
        ]
        for row in shown
    ]
    console.print(table("Legs", head, rows, left=2))
    if left_out:
        console.print(f"and {left_out} legs more: --json tells all of them", markup=False)
    if any(row.vertical == "altitude" for row in found.legs):
        console.print("^ above the bottom", markup=False)
    _print_sentences(console, found.notes, found.warnings)


def _print_autopilot(console: Console, found: AutopilotCheck) -> None:
    _title(console, found.name, found.description)
    print_modes_and_gains(console, found)
    _print_sentences(console, [*found.notes, *found.safety], found.warnings)


def print_modes_and_gains(console: Console, found: AutopilotCheck) -> None:
    """Print the mode table and, of a PID, its gains."""
    from seatrial.cli.console import table

    rows = [
        [
            mode.name,
            f"{mode.from_speed_m_s:g}",
            mode.depth_by,
            " ".join(mode.loops),
            " ".join(mode.actuators) or "all",
        ]
        for mode in found.modes
    ]
    console.print(table("Modes", ["mode", "from m/s", "depth by", "loops", "actuators"], rows))
    if found.gains and found.control == "pid":
        gains = [[row.loop, row.gain, *(f"{value:.3g}" for value in row.values)] for row in found.gains]
        head = ["loop", "at m/s", *(f"{speed:.3g}" for speed in found.speeds_m_s)]
        console.print(table("Gains", head, gains, left=2))


def _title(console: Console, name: str, description: str) -> None:
    console.print(
        f"{name}: {description}" if description else name, soft_wrap=True, markup=False, style="bold"
    )
    console.print()


def _print_sentences(console: Console, notes: Sequence[str], warnings: Sequence[str]) -> None:
    for note in notes:
        console.print(note, soft_wrap=True, markup=False)
    for warning in warnings:
        console.print(f"WARNING: {warning}", soft_wrap=True, markup=False, style="yellow")
    if not warnings:
        console.print("Nothing looks wrong.")


def _shortened(text: str) -> str:
    return text if len(text) <= _LABEL else text[: _LABEL - 1] + "…"


def _level(row: LegRow) -> str:
    low, high = row.level_m
    mark = "^" if row.vertical == "altitude" else ""
    return f"{low:.3g}{mark}" if high - low < 0.05 else f"{low:.3g}-{high:.3g}{mark}"


def _power(row: LegRow) -> str:
    return "" if row.power_w is None else f"{row.power_w:.0f}"
