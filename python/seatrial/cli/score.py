"""`seatrial score`: how well a vehicle predicts recorded trials."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from seatrial.trial import Trial


def score(
    vehicle: Annotated[str, typer.Argument(help="Vehicle file or built-in vehicle.")],
    trials: Annotated[
        list[str], typer.Argument(help="Recordings, or names of trials of the campaign.", metavar="TRIAL...")
    ],
    columns_from: Annotated[
        Path | None, typer.Option(help="Campaign file whose reader and column map the recordings follow.")
    ] = None,
    ahead: Annotated[float, typer.Option(min=0.01, help="Restart the simulation after this time, s.")] = 10.0,
    free_run: Annotated[bool, typer.Option("--free-run", help="Never restart it.")] = False,
    free: Annotated[str, typer.Option(help="Axes that are simulated; the others are replayed.")] = "XYZKMN",
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Score a vehicle on trials: R2 and errors per channel, some seconds ahead again and again."""
    from seatrial._core import Vehicle
    from seatrial.cli.console import output, print_json
    from seatrial.score import score as scored

    loaded = Vehicle.load(vehicle)
    found = scored(
        loaded,
        _read(trials, columns_from),
        ahead_s=ahead,
        free_run=free_run,
        free=free,
        measured="".join(axis for axis in "XYZKMN" if axis not in free),
    )
    if json:
        print_json(found.to_dict())
    else:
        output().print(str(found), markup=False)


def _read(trials: list[str], columns_from: Path | None) -> list[Trial]:
    """Trials, each a file or a name that the campaign knows."""
    if columns_from is None:
        from seatrial.trial import Trial

        return [Trial.read(path) for path in trials]
    from seatrial.campaign import Campaign

    known = Campaign.load(columns_from).trials
    names = [name if name in known else Path(name).stem for name in trials]
    files = {name: path for name, path in zip(names, trials, strict=True) if path not in known}
    campaign = Campaign.load(columns_from, trials=files)
    return [campaign.trials[name] for name in names]
