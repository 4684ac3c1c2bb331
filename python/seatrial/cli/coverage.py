"""`seatrial coverage`: how often intervals hold the truth of generated trials."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from seatrial.cli.console import Dask, Json, Threads, Verbose


def coverage(
    campaign: Annotated[Path, typer.Argument(help="Campaign file (TOML) whose trials are all generated.")],
    seeds: Annotated[int, typer.Option(min=1, help="Repetitions.")] = 50,
    first: Annotated[int, typer.Option(min=0, help="Seed of the first repetition.")] = 1,
    truth: Annotated[
        Path | None, typer.Option(help="Truth file for all trials instead of the recipes' own.")
    ] = None,
    analysed: Annotated[
        int, typer.Option(min=0, help="Repetitions that also run the residual analysis.")
    ] = 5,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Run directory; runs/NAME-coverage by default.")
    ] = None,
    resume: Annotated[
        bool, typer.Option(help="Reuse repetitions that an earlier run finished from the same inputs.")
    ] = True,
    threads: Threads = None,
    dask: Dask = None,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Count how often the 95 % intervals hold the truth, over repetitions with other noise and biases.

    Ctrl-C keeps what is done; the same command goes on from there.
    """
    from seatrial.campaign.campaign import Campaign
    from seatrial.cli.console import answer, print_json, search_progress, workers
    from seatrial.experiment.coverage import coverage as covered
    from seatrial.trial.truth import Truth

    loaded = Campaign.load(campaign)
    named = loaded.name if truth is None else f"{loaded.name}-{truth.stem}"
    folder = out or Path("runs") / f"{named}-coverage"
    with workers(dask) as fleet, search_progress("first repetition", quiet=json) as progress:
        found = covered(
            loaded,
            seeds=seeds,
            first=first,
            truth=None if truth is None else Truth.load(truth),
            analysed=analysed,
            run_dir=folder,
            progress=progress,
            resume=resume,
            threads=threads,
            executor=fleet,
        )
    if json:
        print_json(found.to_dict() | {"run_directory": str(folder)})
    else:
        answer(found.report(), verbose=verbose, results="" if found.interrupted else f"Results in {folder}")
    if found.interrupted:
        raise typer.Exit(130)
    if found.failures:
        raise typer.Exit(1)
