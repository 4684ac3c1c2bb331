"""`seatrial report`: runs in, one HTML file out, in which the vehicle and its autopilot still fly."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from seatrial.report.page.run_folder import RunFolder


def _place(given: Path | None) -> Path | None:
    """The page to be, refused at once where it cannot be written."""
    if given is not None:
        from seatrial.report.page.page import check_place

        check_place(given)
    return given


Page = Annotated[
    Path | None,
    typer.Option(
        "--report",
        metavar="FILE.html",
        callback=_place,
        help="Write the run as one HTML file too, with its figures as SVG.",
    ),
]
"""Option of the verbs that write a run."""


def report(
    runs: Annotated[
        list[Path], typer.Argument(metavar="RUN...", help="Run directories, in order of telling.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE.html",
            callback=_place,
            help="The page to write; without it two runs of a kind are compared here.",
        ),
    ] = None,
    title: Annotated[str, typer.Option(help="Heading; the names of the runs by default.")] = "",
) -> None:
    """Write runs as one HTML file that opens anywhere without a network: results, evidence, inputs.

    Vehicle, autopilot, mission and campaign files are inside; `seatrial new --from-report` takes them out.
    Two runs of a kind are compared, before and after; without --out on the terminal only.

    Example: seatrial report runs/mine runs/mine-tuned --out mine.html
    """
    if out is not None:
        reported(out, runs, title=title)
        return
    from seatrial.base.errors import SeatrialError
    from seatrial.cli.console import answer
    from seatrial.report.page.compare import compared
    from seatrial.report.page.run_folder import RunFolder

    if (both := compared([RunFolder.read(run) for run in runs])) is None:
        raise SeatrialError(
            "--out: expected the page to write, found none; give --out FILE.html, or two runs of a kind to"
            " compare"
        )
    answer(both)


def reported(
    page: Path | None,
    runs: Sequence[Path | RunFolder],
    *,
    draw: Callable[[], object] | None = None,
    title: str = "",
    quiet: bool = False,
) -> None:
    """Write a page where one was asked for, and say where it is.

    `draw` writes the figures first, where nothing else has drawn them.
    """
    if page is None:
        return
    from seatrial.cli.console import say
    from seatrial.report.page.page import LARGEST_BYTES, write_page

    if draw is not None:
        draw()
    written = write_page(runs, page, title=title)
    size = written.stat().st_size
    if not quiet:
        large = "" if size <= LARGEST_BYTES else "; give fewer runs for a smaller one"
        say(f"Report: {written} ({size / 1e6:.1f} MB{large})")
