"""`seatrial tune`: a campaign in, an autopilot whose responses stay in their corridors out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seatrial.cli.console import Dask, Figures, Json, Pdf, Threads, Verbose
from seatrial.cli.report import Page, reported

if TYPE_CHECKING:
    from collections.abc import Collection

    from seatrial.campaign.campaign import Campaign
    from seatrial.identification.identification import Identification
    from seatrial.tuning.result import Tuning


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
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Run directory; runs/NAME-tuned by default.")
    ] = None,
    resume: Annotated[
        bool, typer.Option(help="Reuse what an earlier run finished from the same inputs.")
    ] = True,
    threads: Threads = None,
    dask: Dask = None,
    figures: Figures = True,
    pdf: Pdf = False,
    page: Page = None,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Tune an autopilot's gains until its responses stay within the corridors of a campaign.

    The exit code is 1 where a response leaves its corridor, or a margin falls short, after all. Ctrl-C keeps
    the best so far; the same command goes on with what is not finished.
    """
    from seatrial.campaign.campaign import Campaign
    from seatrial.cli.console import answer, formats, print_json
    from seatrial.cli.streams import note

    loaded = Campaign.load(campaign)
    folder = out or Path("runs") / f"{loaded.name}-tuned"
    source = fitted_source(loaded, run)
    if not json:
        note(f"Vehicle: {source or loaded.vehicle.name}")
    found = tuned(loaded, source, folder, resume=resume, threads=threads, dask=dask, quiet=json)

    def drawn() -> list[Path]:
        return draw(found, folder, formats=formats(pdf, page)) if figures and not found.interrupted else []

    if json:
        print_json(found.to_dict() | {"run_directory": str(folder), "figures": [str(p) for p in drawn()]})
    else:
        files = "autopilot.toml, tuning.json, summary.txt, Parquet tables"
        results = "" if found.interrupted else f"Results in {folder}: {files}"
        answer(found.report(), verbose=verbose, results=results, draw=drawn)
    if found.interrupted:
        raise typer.Exit(130)
    reported(page, [folder], quiet=json)
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
    resume: bool = True,
    threads: int | None = None,
    dask: str | None = None,
    quiet: bool = False,
) -> Tuning:
    """Tuning of a campaign into a run directory, with progress on standard error."""
    from seatrial.cli.console import search_progress, workers

    with workers(dask) as fleet, search_progress("making ready", quiet=quiet) as progress:
        return campaign.tune(
            source, run_dir=folder, progress=progress, resume=resume, threads=threads, executor=fleet
        )


def draw(
    found: Tuning, folder: Path, *, formats: tuple[str, ...] = ("png",), loops: Collection[str] | None = None
) -> list[Path]:
    """Paths of the figures of a tuning in its run directory, of some loops or of all."""
    from seatrial.report.plot.tuning import tuning_gallery

    return tuning_gallery(found, folder / "figures", formats=formats, loops=loops)
