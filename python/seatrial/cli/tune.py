"""`seatrial tune`: a campaign in, an autopilot whose responses stay in their corridors out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seatrial.cli.options import Computing, Output, shared
from seatrial.cli.report import reported

if TYPE_CHECKING:
    from seatrial.campaign.campaign import Campaign
    from seatrial.identification.identification import Identification
    from seatrial.tuning.result import Tuning


@shared
def tune(
    campaign: Annotated[
        Path,
        typer.Argument(help="Campaign file (TOML) with [tuning]. Without that table, the defaults hold."),
    ],
    run: Annotated[
        Path | None,
        typer.Option(
            "--run",
            help="Run directory of `seatrial identify`, or a vehicle; runs/NAME where that is one, else the"
            " campaign's own vehicle.",
        ),
    ] = None,
    computing: Computing = Computing(),
    output: Output = Output(),
) -> None:
    """Tune an autopilot's gains until its responses stay within the corridors of a campaign.

    Example: seatrial tune campaign.toml --run runs/mine

    The exit code is 1 where a response leaves its corridor, or a margin falls short, after all. Ctrl-C keeps
    the best so far; the same command goes on with what is not finished.
    """
    from seatrial.campaign.campaign import Campaign
    from seatrial.cli.console import answer, print_json
    from seatrial.cli.streams import note

    loaded = Campaign.load(campaign)
    folder = output.out or Path("runs") / f"{loaded.name}-tuned"
    source = fitted_source(loaded, run)
    if not output.json:
        note(f"Vehicle: {source or loaded.vehicle.name}")
    found = tuned(loaded, source, folder, computing=computing, quiet=output.json)

    def drawn() -> list[Path]:
        from seatrial.report.plot import gallery

        return [] if found.interrupted else gallery(found, folder / "figures", formats=output.endings)

    if output.json:
        print_json(found.to_dict() | {"run_directory": str(folder), "figures": [str(p) for p in drawn()]})
    else:
        files = "autopilot.toml, tuning.json, summary.txt, Parquet tables"
        results = "" if found.interrupted else f"Results in {folder}: {files}"
        answer(found.report(), verbose=output.verbose, results=results, draw=drawn)
    if found.interrupted:
        raise typer.Exit(130)
    reported(output.page, [folder], quiet=output.json)
    if not found.held:
        raise typer.Exit(1)


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
