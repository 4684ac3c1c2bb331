"""`seatrial ardusub`: from a log of ArduSub to the parameters that its vehicle should fly with."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seatrial.cli.options import Output, Resume, Threads, end, shared

if TYPE_CHECKING:
    from seatrial.ardusub.from_log import LogTuning
    from seatrial.ardusub.log_replay import Replay


@dataclass(frozen=True)
class Draws:
    """How many missions judge the parameters, and how they are drawn."""

    missions: Annotated[
        int, typer.Option(min=16, max=100_000, help="Missions with which before and after are judged.")
    ] = 1000
    seed: Annotated[int, typer.Option(min=0, max=2**31, help="Of everything that is drawn.")] = 0


@shared
def ardusub(
    log: Annotated[Path, typer.Argument(help="DataFlash log of ArduSub, .BIN.")],
    parameters: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.param",
            help="The vehicle's own parameters: compared with those found, and taken where the log has none.",
        ),
    ] = None,
    replay_only: Annotated[
        bool, typer.Option("--replay-only", help="Replay the controllers and find the parameters; a second.")
    ] = False,
    vehicle: Annotated[
        str | None, typer.Option(help="Vehicle file or built-in vehicle to begin with; else by the frame.")
    ] = None,
    draws: Draws = Draws(),
    resume: Resume = True,
    threads: Threads = None,
    output: Output = Output(),
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
    from seatrial.cli.console import Code, long_work, reported, say

    folder = output.out or Path("runs") / file_name(f"ardusub-{log.stem}")
    check_writable(folder, "replay" if replay_only else "ardusub")
    given = None if parameters is None else ParameterFile.load(parameters)
    result: Replay | LogTuning
    if replay_only:
        result = replay(log, parameters=given)
        result.save(folder)
        files = "replay.json, summary.txt, found.param"
    else:
        try:
            with long_work("reading", quiet=output.json) as show:
                result = tune_log(
                    log,
                    out=folder,
                    parameters=given,
                    vehicle=vehicle,
                    missions=draws.missions,
                    seed=draws.seed,
                    threads=threads,
                    resume=resume,
                    say=lambda share, words: show(share, words, ()),
                )
        except KeyboardInterrupt:
            if not output.json:
                say(f"Interrupted; what is finished is kept beside {folder}, and the same command goes on.")
            raise typer.Exit(Code.INTERRUPTED) from None
        files = "changes.param, found.param, ardusub.json, replay.json, summary.txt"
    output.show(
        result,
        {"run_directory": str(folder)},
        results=f"Results in {folder}: {files}",
        draw=partial(output.draw, result, folder / "figures"),
    )
    reported(output.page, [folder], quiet=output.json)
    end(held=result.held)
