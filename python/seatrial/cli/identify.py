"""`seatrial identify`: a campaign in, an identified vehicle and how good it is out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from seatrial.campaign import Campaign
    from seatrial.identification import Identification


def identify(
    campaign: Annotated[Path, typer.Argument(help="Campaign file (TOML).")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Run directory; runs/NAME of the campaign by default.")
    ] = None,
    resume: Annotated[
        bool, typer.Option(help="Reuse stages that an earlier run finished from the same inputs.")
    ] = True,
    threads: Annotated[int | None, typer.Option(min=1, help="Threads; all processors by default.")] = None,
    trial: Annotated[
        list[str] | None, typer.Option("--trial", help="NAME=FILE: another recording for a trial.")
    ] = None,
    figures: Annotated[bool, typer.Option(help="Write figures (PNG and PDF) into the run directory.")] = True,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Identify a vehicle from the trials of a campaign.

    Ctrl-C keeps the best so far; the same command goes on with the stages that are not finished.
    """
    from seatrial.campaign import Campaign
    from seatrial.cli.console import output, print_json
    from seatrial.cli.tables import print_identification

    loaded = Campaign.load(campaign, trials=_replacements(trial or []))
    folder = out or Path("runs") / loaded.name
    fit = run(loaded, folder, threads=threads, resume=resume, quiet=json)
    written = draw(fit, folder) if figures and not fit.interrupted else []
    if json:
        print_json(fit.to_dict() | {"run_directory": str(folder), "figures": [str(path) for path in written]})
    else:
        from seatrial.cli.console import list_figures

        console = output()
        print_identification(console, fit)
        console.print(f"Results in {folder}: vehicle.toml, identification.json, summary.txt, Parquet tables")
        list_figures(console, written)
    if fit.interrupted:
        raise typer.Exit(130)


def run(
    campaign: Campaign, folder: Path, *, threads: int | None = None, resume: bool = True, quiet: bool = False
) -> Identification:
    """Identification of a campaign into a run directory, with progress on standard error."""
    from seatrial.cli.console import identification_progress
    from seatrial.identify import identify as identified

    with identification_progress(quiet=quiet) as progress:
        return identified(campaign, run_dir=folder, progress=progress, resume=resume, threads=threads)


def draw(fit: Identification, folder: Path, *, formats: tuple[str, ...] = ("png", "pdf")) -> list[Path]:
    """Paths of the figures of an identification in its run directory."""
    from seatrial.plot.gallery import gallery

    return gallery(fit, folder / "figures", formats=formats)


def _replacements(entries: list[str]) -> dict[str, str]:
    """Trial names and files from NAME=FILE."""
    from seatrial.errors import CampaignError

    found: dict[str, str] = {}
    for entry in entries:
        name, equals, path = entry.partition("=")
        if not equals or not name or not path:
            raise CampaignError(f"--trial {entry!r}: expected NAME=FILE, for example --trial surge=log.csv")
        found[name] = path
    return found
