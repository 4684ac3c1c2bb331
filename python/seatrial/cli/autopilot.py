"""`seatrial autopilot`: start gains for a vehicle as an autopilot file, with what they are worth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seatrial.base.errors import SeatrialError

if TYPE_CHECKING:
    from rich.console import Console

    from seatrial._core import Vehicle
    from seatrial.check.autopilot import AutopilotCheck
    from seatrial.control_design.margin_report import MarginRow

__all__ = ["authority", "autopilot", "weak_points"]

_CRUISE = 0.6  # of the largest speed that is asked for: where the authority is told for vehicles under way

_MANY = 100.0  # a gain margin beyond it is no limit


def autopilot(
    vehicle: Annotated[str, typer.Argument(help="Vehicle file or built-in vehicle.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Autopilot file to write.")] = Path(
        "autopilot.toml"
    ),
    law: Annotated[
        str, typer.Option(metavar="pid|lqr", help="Decoupled PID loops, or a linear-quadratic regulator.")
    ] = "pid",
    period_s: Annotated[float, typer.Option(help="Control period, s.")] = 0.1,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Write an autopilot with start gains from a vehicle's model, and say what they are worth."""
    from seatrial._core import Autopilot, Vehicle
    from seatrial.base.atomic_write import write_atomic
    from seatrial.check.autopilot import check_autopilot
    from seatrial.cli.console import output, print_json
    from seatrial.control_design.margin_report import autopilot_margins, sound_speeds
    from seatrial.control_design.start_autopilot import start_autopilot

    _check_place(out, force=force)
    loaded = Vehicle.load(vehicle)
    text = start_autopilot(loaded, law=law, period_s=period_s)
    made = Autopilot.from_toml(text, str(out))
    found = check_autopilot(made, vehicle=loaded)
    margins = autopilot_margins(loaded, made)
    between = sound_speeds(loaded, made)
    told = [*authority(loaded, found), *_left_out(text)]
    write_atomic(out, text.encode())
    if json:
        rows = [vars(row) | {"verdict": row.verdict} for row in margins]
        beside = {"authority": told, "margins": rows, "sound_m_s": between, "file": str(out)}
        print_json(found.to_dict() | beside)
        return
    _print(output(), found, told)
    _print_margins(output(), found, margins, between)
    _print_next(output(), vehicle, out)


def authority(vehicle: Vehicle, found: AutopilotCheck) -> list[str]:
    """What the vehicle can command and what the loss of an actuator costs, at a speed it is used at."""
    hovers = any(mode.depth_by == "heave" for mode in found.modes)
    return vehicle.authority_sentences(0.0 if hovers else round(_CRUISE * found.speeds_m_s[-1], 1))


def _left_out(text: str) -> list[str]:
    """Why there is no loop for a row, from the comments at the head of the file."""
    head = text.partition("\nformat")[0].splitlines()
    return [line.removeprefix("# ") for line in head if line.startswith("# No ")]


def _check_place(out: Path, *, force: bool) -> None:
    if out.is_dir():
        raise SeatrialError(f"--out {out}: expected a file, found a folder; give a file name")
    if out.exists() and not force:
        raise SeatrialError(
            f"--out {out}: this file exists and is not overwritten; give another name, or --force"
        )
    if not out.absolute().parent.is_dir():
        raise SeatrialError(f"--out {out}: there is no folder {out.parent}; make it or give another name")


def _print(console: Console, found: AutopilotCheck, told: list[str]) -> None:
    from seatrial.cli.check import print_modes_and_gains

    for sentence in told:
        console.print(sentence, soft_wrap=True, markup=False)
    console.print()
    print_modes_and_gains(console, found)


def _print_margins(
    console: Console, found: AutopilotCheck, margins: list[MarginRow], between: tuple[float, float] | None
) -> None:
    from seatrial.cli.console import table

    rows = [[row.mode, f"{row.speed_m_s:.2f}", *_numbers(row), row.verdict] for row in margins]
    head = ["mode", "at m/s", "phase, deg", "gain", "delay, s", "verdict"]
    console.print(table("Margins: phase, factor of the gain, delay; the least of all loops", head, rows))
    notes, warnings = weak_points(margins, between)
    for sentence in (*found.notes, *notes):
        console.print(sentence, soft_wrap=True, markup=False)
    for sentence in (*found.warnings, *warnings):
        console.print(f"WARNING: {sentence}", soft_wrap=True, markup=False, style="yellow")


def _numbers(row: MarginRow) -> list[str]:
    """Margins of what is stable; of what is not they mean nothing."""
    if row.doubles_s is not None:
        return ["", "", ""]
    gain = f"{row.gain:.1f}" if row.gain < _MANY else "any"
    return [f"{row.phase_deg:.0f}", gain, f"{row.delay_s:.2f}" if row.delay_s < _MANY else "any"]


def weak_points(margins: list[MarginRow], between: tuple[float, float] | None) -> tuple[list[str], list[str]]:
    """Notes and warnings about supporting points that are not sound; `between` is the sound range, m/s."""
    weak = [row for row in margins if not row.sound]
    if between is None:
        return [], ["no speed ahead is sound; look at what is not commanded"]
    ahead = [row for row in weak if row.speed_m_s >= 0.0]
    notes = []
    if len(ahead) < len(weak):
        least = max(row.speed_m_s for row in weak if row.speed_m_s < 0.0)
        notes.append(f"Astern at {-least:.2f} m/s and faster it is not sound; a mission does not go astern")
    if not ahead:
        return notes, []
    low, high = between
    grows = list(dict.fromkeys(row.grows for row in ahead if row.grows))
    why = f"a motion grows ({', '.join(grows)})" if grows else "the margins are small"
    return notes, [f"keep the speed of missions between {low:.2f} and {high:.2f} m/s; elsewhere {why}"]


def _print_next(console: Console, vehicle: str, out: Path) -> None:
    console.print(f"Autopilot in {out}", soft_wrap=True, markup=False)
    console.print(f"Next:  seatrial check {out} --vehicle {vehicle}", soft_wrap=True, markup=False)
    console.print(f"       seatrial fly {vehicle} {out} MISSION", soft_wrap=True, markup=False)
