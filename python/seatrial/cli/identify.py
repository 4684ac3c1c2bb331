"""`seatrial identify`: a campaign in, an identified vehicle and how good it is out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from seatrial.campaign import Campaign
    from seatrial.identification import Identification
    from seatrial.restart_result import Restarts
    from seatrial.variant import LockedAxes


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
        list[str] | None,
        typer.Option("--trial", metavar="NAME=FILE", help="Another recording for a trial; repeatable."),
    ] = None,
    figures: Annotated[bool, typer.Option(help="Write figures (PNG and PDF) into the run directory.")] = True,
    locked_axes: Annotated[
        str | None,
        typer.Option(
            metavar="frozen|measured",
            help="Mode of the axes that a stage does not free, instead of the campaign's; runs/NAME-MODE.",
        ),
    ] = None,
    random_starts: Annotated[
        int | None,
        typer.Option(
            min=2,
            help="Then search every stage from so many random starts; into the folder beside the run's.",
        ),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Identify a vehicle from the trials of a campaign.

    Ctrl-C keeps the best so far; the same command goes on with the stages that are not finished.
    """
    from seatrial.campaign import Campaign
    from seatrial.cli.console import output, print_json
    from seatrial.cli.restart_table import print_restarts
    from seatrial.cli.tables import print_identification
    from seatrial.run_directory import RunDirectory

    loaded = Campaign.load(campaign, trials=_replacements(trial or []))
    name = loaded.name
    if locked_axes is not None:
        loaded, name = loaded.with_locked_axes(_mode(locked_axes)), f"{name}-{locked_axes}"
    folder = out or Path("runs") / name
    beside = folder.with_name(f"{folder.name}-random-starts")
    if random_starts is not None:
        RunDirectory(beside).abandon()  # refused now rather than after the search
    fit = run(loaded, folder, threads=threads, resume=resume, quiet=json)
    written = draw(fit, folder) if figures and not fit.interrupted else []
    if not json:
        from seatrial.cli.console import list_figures

        console = output()
        print_identification(console, fit)
        console.print(
            f"Results in {folder}: vehicle.toml, identification.json, summary.txt, Parquet tables",
            soft_wrap=True,
            markup=False,
        )
        list_figures(console, written)
    again: Restarts | None = None
    if random_starts is not None and not fit.interrupted:
        again = _restart(fit, beside, random_starts, threads=threads, resume=resume, quiet=json)
        drawn = _draw_starts(again, beside) if figures and not again.interrupted else []
        if not json:
            print_restarts(console, again, beside, asked=random_starts)
            list_figures(console, drawn)
    if json:
        found = fit.to_dict() | {"run_directory": str(folder), "figures": [str(path) for path in written]}
        print_json(found | ({} if again is None else {"random_starts": again.to_dict()}))
    if fit.interrupted or (again is not None and again.interrupted):
        raise typer.Exit(130)


def _mode(text: str) -> LockedAxes:
    """Mode of locked axes that was asked for."""
    from seatrial.errors import CampaignError, nearest

    if text == "frozen":
        return "frozen"
    if text == "measured":
        return "measured"
    raise CampaignError(
        f"--locked-axes {text!r}: expected frozen or measured{nearest(text, ('frozen', 'measured'))}"
    )


def _restart(
    fit: Identification, folder: Path, starts: int, *, threads: int | None, resume: bool, quiet: bool
) -> Restarts:
    """Random starts of an identified campaign, with progress on standard error."""
    from seatrial.cli.console import identification_progress
    from seatrial.random_starts import restarts

    with identification_progress(quiet=quiet) as progress:
        return restarts(
            fit.campaign,
            starts=starts,
            sigma=fit.sigma,
            run_dir=folder,
            progress=progress,
            resume=resume,
            threads=threads,
        )


def _draw_starts(found: Restarts, folder: Path) -> list[Path]:
    from seatrial.plot.random_starts import random_starts
    from seatrial.plot.style import save

    return save(random_starts(found), folder / "figures" / "random_starts")


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
        if not Path(path).is_file():
            raise CampaignError(f"--trial {entry}: there is no file {path}; correct the path")
        found[name] = path
    return found
