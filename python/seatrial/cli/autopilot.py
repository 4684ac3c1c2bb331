"""`seatrial autopilot`: start gains for a vehicle as an autopilot file, with what they are worth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seatrial.base.errors import SeatrialError
from seatrial.cli.options import Json, Verbose

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.check.autopilot import AutopilotCheck

_CRUISE = 0.6  # of the largest speed that is asked for: where the authority is told for vehicles under way


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
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Write an autopilot with start gains from a vehicle's model, and say what they are worth.

    Example: seatrial autopilot vehicle.toml --out autopilot.toml
    """
    from seatrial._core import Autopilot, Vehicle
    from seatrial.base.atomic_write import write_atomic
    from seatrial.base.file_names import check_place
    from seatrial.check.autopilot import check_autopilot
    from seatrial.cli.console import answer, print_json
    from seatrial.control_design.start_autopilot import start_autopilot

    check_place(out, "--out", inputs={"the vehicle": vehicle})
    if out.exists() and not force:
        raise SeatrialError(
            f"--out {out}: this file exists and is not overwritten; give another name, or --force"
        )
    loaded = Vehicle.load(vehicle)
    text = start_autopilot(loaded, law=law, period_s=period_s)
    made = Autopilot.from_toml(text, str(out))
    found = check_autopilot(made, vehicle=loaded)
    told = [*_authority(loaded, found), *_left_out(text)]
    try:
        write_atomic(out, text.encode(), new=not force)
    except FileExistsError:
        raise SeatrialError(
            f"--out {out}: another program wrote this file meanwhile, and it is not overwritten; give another"
            " name, or --force"
        ) from None
    if json:
        print_json(found.to_dict() | {"authority": told, "file": str(out)})
        return
    report = found.report(told)
    supply = " --voltage VOLTS" if loaded.table_voltages() else ""
    after = f"seatrial check {out} --vehicle {vehicle}; then seatrial fly {vehicle} {out} MISSION{supply}"
    answer(replace(report, next_step=after), verbose=verbose, results=f"Autopilot in {out}")


def _authority(vehicle: Vehicle, found: AutopilotCheck) -> list[str]:
    """What the vehicle can command and what the loss of an actuator costs, at a speed it is used at."""
    from seatrial.vehicle.authority import authority_in_words

    hovers = any(mode.depth_by == "heave" for mode in found.modes)
    return authority_in_words(vehicle, 0.0 if hovers else round(_CRUISE * found.speeds_m_s[-1], 1))


def _left_out(text: str) -> list[str]:
    """Why there is no loop for a row, from the comments at the head of the file."""
    head = text.partition("\nformat")[0].splitlines()
    return [line.removeprefix("# ") for line in head if line.startswith("# No ")]
