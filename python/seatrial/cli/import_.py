"""`seatrial import`: from logs to a project with map, vehicle, campaign and trials."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from seatrial.cli.options import Drawn, shared


@shared
def import_(
    logs: Annotated[
        list[Path],
        typer.Argument(help="Logs of any format that is read; or one model of gz-sim.", metavar="LOG|MODEL"),
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="PROJECT", help="Folder of the project; without it, only list."),
    ] = None,
    map: Annotated[
        Path | None, typer.Option("--map", help="Map to use instead of a proposed one: map.toml, edited.")
    ] = None,
    vehicle: Annotated[
        str | None, typer.Option(help="Vehicle file or built-in vehicle; else by the log, or a stub.")
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Overwrite an imported project; files that you edited are kept.")
    ] = False,
    output: Drawn = Drawn(),
) -> None:
    """List what logs hold, and draft a project from them: map, vehicle, campaign and trials.

    Without --out it lists every topic and field with rate, range, unit and what it is taken for. A model of
    gz-sim (.sdf, .world, .xml) becomes a vehicle file, --out FILE.toml, with a report on what contradicts
    itself.

    Example: seatrial import dive.BIN --out dive
    """
    from seatrial.simulators.convert import ENDINGS

    # A single file that gz-sim would read is a model, all others are logs.
    if len(logs) == 1 and logs[0].suffix.lower() in ENDINGS:
        _model(logs[0], out, force=force, output=output)
        return
    from seatrial.cli.console import long_work
    from seatrial.intake.import_logs import import_logs
    from seatrial.intake.survey import survey

    with long_work("survey", quiet=output.json) as show:

        def progress(share: float, words: str) -> None:
            show(share, words, ())

        if out is None and map is None:
            surveyed = survey(logs, share=progress)
        else:
            made = import_logs(logs, out=out, map=map, vehicle=vehicle, force=force, progress=progress)
    if out is None and map is None:
        output.show(surveyed)
        return
    files = "map.toml, vehicle.toml, campaign.toml, trials/, import.json"
    written = "" if out is None else f"Written to {out}: {files}"
    output.show(made, results=written, draw=lambda: [] if out is None else output.draw(made, out / "figures"))


def _model(model: Path, out: Path | None, *, force: bool, output: Drawn) -> None:
    """Read a model of gz-sim, and write the vehicle file where --out says."""
    from seatrial.base.errors import VehicleError
    from seatrial.base.file_names import check_place
    from seatrial.simulators.convert import import_model, write_text

    imported = import_model(model)
    if out is not None:
        check_place(out, "--out", endings=(".toml",))
        if out.exists() and not force:
            raise VehicleError(f"{out}: is there already; choose another name or give --force")
        write_text(out, imported.text)
    written = "" if out is None else f"Vehicle file in {out}"
    output.show(imported, {"file": None if out is None else str(out)}, results=written)
