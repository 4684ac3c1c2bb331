"""`seatrial import`: from logs to a project with map, vehicle, campaign and trials."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seatrial.cli.options import FigureFormat, Figures, Json, Verbose

if TYPE_CHECKING:
    pass


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
    figures: Figures = FigureFormat.PNG,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """List what logs hold, and draft a project from them: map, vehicle, campaign and trials.

    Without --out it lists every topic and field with rate, range, unit and what it is taken for. A model of
    gz-sim (.sdf, .world, .xml) becomes a vehicle file, --out FILE.toml, with a report on what contradicts
    itself.

    Example: seatrial import dive.BIN --out dive
    """
    from seatrial.simulators.convert import ENDINGS

    if len(logs) == 1 and logs[0].suffix.lower() in ENDINGS:
        _model(logs[0], out, force=force, verbose=verbose, json=json)
        return
    from seatrial.cli.console import answer, long_work, print_json
    from seatrial.intake.import_logs import import_logs
    from seatrial.intake.survey import survey

    with long_work("survey", quiet=json) as show:

        def progress(share: float, words: str) -> None:
            show(share, words, ())

        if out is None and map is None:
            seen = survey(logs, share=progress)
        else:
            made = import_logs(logs, out=out, map=map, vehicle=vehicle, force=force, progress=progress)
    if out is None and map is None:
        if json:
            print_json(seen.to_dict())
        else:
            answer(seen.report(), verbose=verbose)
        return

    def drawn() -> list[Path]:
        from seatrial.report.plot import gallery

        return [] if out is None else gallery(made, out / "figures", formats=figures.endings())

    if json:
        print_json(made.to_dict() | {"figures": [str(path) for path in drawn()]})
        return
    results = ""
    if out is not None:
        results = f"Written to {out}: map.toml, vehicle.toml, campaign.toml, trials/, import.json"
    answer(made.report(), verbose=verbose, results=results, draw=drawn)


def _model(model: Path, out: Path | None, *, force: bool, verbose: bool, json: bool) -> None:
    """Read a model of gz-sim, and write the vehicle file where --out says."""
    from seatrial.base.errors import VehicleError
    from seatrial.base.file_names import check_place
    from seatrial.cli.console import answer, print_json
    from seatrial.simulators.convert import import_model, write_text

    imported = import_model(model)
    if out is not None:
        check_place(out, "--out", endings=(".toml",))
        if out.exists() and not force:
            raise VehicleError(f"{out}: is there already; choose another name or give --force")
        write_text(out, imported.text)
    if json:
        print_json(imported.to_dict() | {"file": None if out is None else str(out)})
        return
    answer(imported.report(), verbose=verbose, results="" if out is None else f"Vehicle file in {out}")
