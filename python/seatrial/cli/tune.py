"""`seatrial autopilot` and `tune`: start gains, and gains that keep all responses in their corridors."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seatrial.base.errors import SeatrialError
from seatrial.cli.options import Computing, Output, Printed, Run, end, shared

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.campaign.campaign import Campaign
    from seatrial.check.autopilot import AutopilotCheck
    from seatrial.identification.identification import Identification
    from seatrial.tuning.result import Tuning


@shared
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
    printed: Printed = Printed(),
) -> None:
    """Write an autopilot with start gains from a vehicle's model, and say what they are worth.

    Example: seatrial autopilot vehicle.toml --out autopilot.toml
    """
    from seatrial._core import Autopilot, Vehicle
    from seatrial.base.atomic_write import write_atomic
    from seatrial.base.file_names import check_place
    from seatrial.check.autopilot import check_autopilot
    from seatrial.control_design.start_autopilot import start_autopilot

    check_place(out, "--out", inputs={"the vehicle": vehicle})
    another = "and it is not overwritten; give another name, or --force"
    if out.exists() and not force:
        raise SeatrialError(f"--out {out}: this file exists, {another}")
    # The text is checked as it will be read, with the comments that say why a loop is missing.
    loaded = Vehicle.load(vehicle)
    text = start_autopilot(loaded, law=law, period_s=period_s)
    checked = check_autopilot(Autopilot.from_toml(text, str(out)), vehicle=loaded)
    remarks = [*_authority(loaded, checked), *_left_out(text)]
    try:
        write_atomic(out, text.encode(), new=not force)
    except FileExistsError:
        raise SeatrialError(f"--out {out}: another program wrote this file meanwhile, {another}") from None
    supply = " --voltage VOLTS" if loaded.table_voltages() else ""
    after = f"seatrial check {out} --vehicle {vehicle}; then seatrial fly {vehicle} {out} MISSION{supply}"
    report = replace(checked.report(remarks), next_step=after)
    facts = {"authority": remarks, "file": str(out)}
    printed.show(checked, facts, report=report, results=f"Autopilot in {out}")


def _authority(vehicle: Vehicle, checked: AutopilotCheck) -> list[str]:
    """What the vehicle can command and what the loss of an actuator costs, at a speed it is used at."""
    from seatrial.vehicle.authority import authority_in_words

    hovers = any(mode.depth_by == "heave" for mode in checked.modes)
    # A vehicle under way is judged at a cruise of 0.6 of the largest speed that is asked for.
    return authority_in_words(vehicle, 0.0 if hovers else round(0.6 * checked.speeds_m_s[-1], 1))


def _left_out(text: str) -> list[str]:
    """Why there is no loop for a row, from the comments at the head of the file."""
    head = text.partition("\nformat")[0].splitlines()
    return [line.removeprefix("# ") for line in head if line.startswith("# No ")]


@shared
def tune(
    campaign: Annotated[
        Path,
        typer.Argument(help="Campaign file (TOML) with [tuning]. Without that table, the defaults hold."),
    ],
    run: Run = None,
    computing: Computing = Computing(),
    output: Output = Output(),
) -> None:
    """Tune an autopilot's gains until its responses stay within the corridors of a campaign.

    Example: seatrial tune campaign.toml --run runs/mine

    The exit code is 1 where a response leaves its corridor, or a margin falls short, after all. Ctrl-C keeps
    the best so far; the same command goes on with what is not finished.
    """
    from seatrial.campaign.campaign import Campaign
    from seatrial.cli.console import note, reported

    loaded = Campaign.load(campaign)
    folder = output.out or Path("runs") / f"{loaded.name}-tuned"
    source = fitted_source(loaded, run)
    if not output.json:
        note(f"Vehicle: {source or loaded.vehicle.name}")
    tuning = tuned(loaded, source, folder, computing=computing, quiet=output.json)
    files = "autopilot.toml, tuning.json, summary.txt, Parquet tables"
    output.show(
        tuning,
        {"run_directory": str(folder)},
        results="" if tuning.interrupted else f"Results in {folder}: {files}",
        draw=partial(output.draw, tuning, folder / "figures"),
    )
    end(interrupted=tuning.interrupted)  # which leaves nothing that a page could show
    reported(output.page, [folder], quiet=output.json)
    end(held=tuning.held)


def fitted_source(campaign: Campaign, given: Path | None) -> Path | str | None:
    """What is known of the vehicle: what was given, else the campaign's run directory, else nothing."""
    if given is not None:
        return given if given.exists() else str(given)
    beside = Path("runs") / campaign.name
    return beside if (beside / "identification.json").is_file() else None


def tuned(
    campaign: Campaign,
    source: Identification | Path | str | None,
    folder: Path | None,
    *,
    computing: Computing = Computing(),
    quiet: bool = False,
) -> Tuning:
    """Tuning of a campaign into a run directory, with progress on standard error."""
    with computing.work(folder, "making ready", quiet=quiet) as work:
        return campaign.tune(source, work=work)
