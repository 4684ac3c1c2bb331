"""`python -m paper`: the figures of a paper about a vehicle, from one command."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer.core import TyperCommand

from seatrial.cli.console import ExitCodes

if TYPE_CHECKING:
    from paper.gallery import PaperGallery
    from seatrial.bench_test.evaluate import BenchTest
    from seatrial.campaign.campaign import Campaign
    from seatrial.identification.identification import Identification


def gallery(
    target: Annotated[
        str | None,
        typer.Argument(
            help="Campaign file, vehicle file or built-in vehicle; CWolf's example campaign by default.",
            metavar="[CAMPAIGN|VEHICLE]",
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for the figures; runs/gallery-NAME by default.")
    ] = None,
    formats: Annotated[
        str, typer.Option(help="Formats of the figures, some of png, pdf and svg, with commas.")
    ] = "png,pdf",
    bench: Annotated[
        Path | None,
        typer.Option(help="Bench file of the vehicle's motors and pulls; the campaign's own by default."),
    ] = None,
    run: Annotated[
        Path | None,
        typer.Option(help="Run directory whose finished stages are reused; runs/NAME by default."),
    ] = None,
    threads: Annotated[int | None, typer.Option(min=1, help="Threads; all processors by default.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the list of figures as JSON.")] = False,
) -> None:
    """Draw outline, block diagrams, motors, stages and convergence, with a page of captions.

    A campaign is identified first; stages that an earlier run finished from the same inputs are reused.
    """
    from paper.gallery import check_formats, draw_gallery
    from seatrial.cli.check import is_campaign
    from seatrial.cli.console import print_json
    from seatrial.cli.new import EXAMPLES

    chosen = check_formats(tuple(part.strip() for part in formats.split(",") if part.strip()))
    if target is None or is_campaign(target):
        fit, campaign, folder = _identified(
            target or str(EXAMPLES / "cwolf" / "campaign.toml"), out, run, threads, json
        )
        made = draw_gallery(fit, folder, campaign=campaign, bench=_bench(bench), formats=chosen)
    else:
        from seatrial._core import Vehicle

        vehicle = Vehicle.load(target)
        folder = out or Path("runs") / f"gallery-{vehicle.name}"
        made = draw_gallery(vehicle, folder, bench=_bench(bench), formats=chosen)
    if json:
        print_json(_plain(made))
    else:
        _print(made)


def _identified(
    target: str, out: Path | None, earlier: Path | None, threads: int | None, quiet: bool
) -> tuple[Identification, Campaign, Path]:
    """Identification of a campaign, that campaign, its run directory inside the folder of the figures."""
    from seatrial.campaign.campaign import Campaign
    from seatrial.cli.identify import run_identification as identified
    from seatrial.cli.options import Computing

    campaign = Campaign.load(target)
    folder = out or Path("runs") / f"gallery-{campaign.name}"
    own = folder / "run"
    _bring(campaign, earlier or Path("runs") / campaign.name, own)
    fit = identified(campaign, own, computing=Computing(threads=threads), quiet=quiet)
    if fit.interrupted:
        raise typer.Exit(130)
    return fit, campaign, folder


def _bring(campaign: Campaign, earlier: Path, own: Path) -> None:
    """Copy the stages of an earlier run to where this one looks for finished ones.

    The earlier run itself stays as it is. A stage from other inputs does no harm: its hash does not fit.
    """
    from seatrial.base.run import RunDirectory

    with RunDirectory(own, "identification") as run:
        for stage in campaign.problem().stages:
            run.bring(earlier, stage.name)


def _bench(path: Path | None) -> BenchTest | None:
    """Bench test of a file; None without one."""
    if path is None:
        return None
    from seatrial.bench_test.evaluate import bench

    return bench(path)


def _plain(made: PaperGallery) -> dict[str, object]:
    return {
        "title": made.title,
        "figures": [
            {
                "number": figure.number,
                "name": figure.name,
                "caption": figure.caption,
                "files": [str(path) for path in figure.files],
            }
            for figure in made.figures
        ],
        "left_out": list(made.left_out),
        "index": str(made.index),
    }


def _print(made: PaperGallery) -> None:
    from seatrial.cli.console import list_figures, output

    console = output()
    console.print(made.title, style="bold", markup=False)
    for figure in made.figures:
        console.print(f"Fig. {figure.number:2d}  {_short(figure.caption)}", soft_wrap=True, markup=False)
    for sentence in made.left_out:
        console.print(f"- not drawn: {sentence}", soft_wrap=True, markup=False)
    list_figures(console, [path for figure in made.figures for path in figure.files])
    console.print(f"Captions in {made.index}", soft_wrap=True, markup=False)


def _short(caption: str) -> str:
    """First part of a caption, up to its first colon, comma or full stop."""
    return re.split(r"[:.;,] ", caption, maxsplit=1)[0]


class _Command(ExitCodes, TyperCommand):
    """The gallery with the exit codes of the verbs."""


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)

app.command(cls=_Command)(gallery)

if __name__ == "__main__":
    app(prog_name="python -m paper")
