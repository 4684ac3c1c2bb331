"""`seatrial ardusub`: from a log of ArduSub to the parameters that its vehicle should fly with."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seatrial.cli.options import FigureFormat, Figures, Json, Threads, Verbose
from seatrial.cli.report import Page, reported

if TYPE_CHECKING:
    from seatrial.ardusub.from_log import LogTuning
    from seatrial.ardusub.log_replay import Replay


def ardusub(
    log: Annotated[Path, typer.Argument(help="DataFlash log of ArduSub, .BIN.")],
    parameters: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.param",
            help="The vehicle's own parameters: compared with those found, and taken where the log has none.",
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Run directory; runs/ardusub-NAME by default.")
    ] = None,
    replay_only: Annotated[
        bool, typer.Option("--replay-only", help="Replay the controllers and find the parameters; a second.")
    ] = False,
    vehicle: Annotated[
        str | None, typer.Option(help="Vehicle file or built-in vehicle to begin with; else by the frame.")
    ] = None,
    missions: Annotated[
        int, typer.Option(min=16, max=100_000, help="Missions with which before and after are judged.")
    ] = 1000,
    seed: Annotated[int, typer.Option(min=0, max=2**31, help="Of everything that is drawn.")] = 0,
    resume: Annotated[
        bool, typer.Option(help="Reuse what an earlier run finished from the same inputs.")
    ] = True,
    threads: Threads = None,
    figures: Figures = FigureFormat.PNG,
    page: Page = None,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Replay ArduSub's controllers from a log, identify the vehicle from it, tune and verify its parameters.

    The exit code is 0 when the law explains the log, the vehicle flies the log's mission inside the envelope,
    and what changes is better with margins kept; 1 when not, 2 for bad input. With --replay-only it is that
    of the replay. Ctrl-C keeps what is finished; the same command goes on.

    Example: seatrial ardusub dive.BIN
    """
    from seatrial.ardusub.from_log import tune_log
    from seatrial.ardusub.log_replay import replay
    from seatrial.ardusub.parameters import ParameterFile
    from seatrial.base.file_names import file_name
    from seatrial.base.run import check_writable
    from seatrial.cli.console import answer, long_work, print_json, say

    folder = out or Path("runs") / file_name(f"ardusub-{log.stem}")
    check_writable(folder, "replay" if replay_only else "ardusub")
    given = None if parameters is None else ParameterFile.load(parameters)
    found: Replay | LogTuning
    if replay_only:
        found = replay(log, parameters=given)
        found.save(folder)
        results = f"Results in {folder}: replay.json, summary.txt, found.param"
    else:
        try:
            with long_work("reading", quiet=json) as show:
                found = tune_log(
                    log, out=folder, parameters=given, vehicle=vehicle, missions=missions, seed=seed,
                    threads=threads, resume=resume, say=lambda share, words: show(share, words, ()),
                )  # fmt: skip
        except KeyboardInterrupt:
            if not json:
                say(f"Interrupted; what is finished is kept beside {folder}, and the same command goes on.")
            raise typer.Exit(130) from None
        results = f"Results in {folder}: changes.param, found.param, ardusub.json, replay.json, summary.txt"

    def drawn() -> list[Path]:
        from seatrial.report.plot import gallery

        return gallery(found, folder / "figures", formats=figures.endings(page))

    if json:
        print_json(found.to_dict() | {"run_directory": str(folder), "figures": [str(p) for p in drawn()]})
    else:
        answer(found.report(), verbose=verbose, results=results, draw=drawn)
    reported(page, [folder], quiet=json)
    if not found.held:
        raise typer.Exit(1)
