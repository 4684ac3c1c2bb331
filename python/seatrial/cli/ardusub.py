"""`seatrial ardusub`: ArduSub's controllers replayed from a log, and its parameters found from it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from seatrial.cli.console import Figures, Json, Pdf, Verbose
from seatrial.cli.report import Page, reported

__all__ = ["ardusub"]


def ardusub(
    log: Annotated[Path, typer.Argument(help="DataFlash log of ArduSub, .BIN.")],
    parameters: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.param", help="The vehicle's own parameters, with which those found are compared."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Run directory; runs/ardusub-NAME by default.")
    ] = None,
    figures: Figures = True,
    pdf: Pdf = False,
    page: Page = None,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Replay ArduSub's controllers from a log, and find the parameters that it flew with.

    The exit code is 0 when every logged term and pulse is what the law makes of the logged inputs, 1 when one
    is not, 2 for bad input.
    """
    from seatrial.ardusub.log_replay import replay
    from seatrial.ardusub.parameters import ParameterFile
    from seatrial.base.file_names import file_name
    from seatrial.base.run import check_writable
    from seatrial.cli.console import answer, formats, print_json

    folder = out or Path("runs") / file_name(f"ardusub-{log.stem}")
    check_writable(folder)
    given = None if parameters is None else ParameterFile.load(parameters)
    found = replay(log, parameters=given)
    found.save(folder)

    def drawn() -> list[Path]:
        from seatrial.report.plot.ardusub import replay_gallery

        return replay_gallery(found, folder / "figures", formats=formats(pdf, page)) if figures else []

    if json:
        print_json(found.to_dict() | {"run_directory": str(folder), "figures": [str(p) for p in drawn()]})
    else:
        results = f"Results in {folder}: replay.json, summary.txt, found.param"
        answer(found.report(), verbose=verbose, results=results, draw=drawn)
    reported(page, [folder], quiet=json)
    if not found.held:
        raise typer.Exit(1)
