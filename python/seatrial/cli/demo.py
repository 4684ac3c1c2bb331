"""`seatrial demo`: from trials to a verdict for CWolf, and Beluga identified where its recordings are."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seatrial.cli.new import EXAMPLES

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import Console

    from seatrial._core import Vehicle
    from seatrial.campaign import Campaign
    from seatrial.identification import Identification


def demo(
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for results.")] = Path("runs/demo"),
    threads: Annotated[int | None, typer.Option(min=1, help="Threads; all processors by default.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the results as JSON.")] = False,
) -> None:
    """Identify CWolf from generated trials, tune and verify its autopilot; identify the AUV Beluga.

    Beluga's turn comes where its recordings are at hand. The exit code is 1 where CWolf's verdict is not
    held.
    """
    from seatrial.cli.console import output, print_json
    from seatrial.cli.demo_autopilot import demonstrate

    console = output()
    fit, truth = _cwolf(console, out / "cwolf", threads=threads, quiet=json)
    results = {"cwolf": fit.to_dict()}
    interrupted, held = fit.interrupted, True
    asked = fit.campaign.file
    if not interrupted and asked.tuning is not None and asked.verification is not None:
        chain = demonstrate(console, fit, truth, out, threads=threads, quiet=json)
        results |= chain.results
        interrupted, held = chain.interrupted, chain.held
    if not interrupted and (campaign := _beluga(console, quiet=json)) is not None:
        beluga = _identified(console, campaign, out / "beluga", threads=threads, quiet=json)
        results["beluga"] = beluga.to_dict()
        interrupted = beluga.interrupted
    if json:
        print_json(results)
    if interrupted:
        raise typer.Exit(130)
    if not held:
        raise typer.Exit(1)


def _cwolf(
    console: Console, folder: Path, *, threads: int | None, quiet: bool
) -> tuple[Identification, Vehicle]:
    """CWolf identified, and the vehicle that sailed its trials."""
    from seatrial.campaign import Campaign
    from seatrial.generated import Recipe, Truth

    example = EXAMPLES / "cwolf"
    truth = Truth.load(example / "truth.toml")
    campaign = Campaign.load(example / "campaign.toml")
    if not quiet:
        console.rule(
            "CWolf: four stages of Taubert et al. (2014), trials GENERATED from a truth vehicle", align="left"
        )
    fit = _identified(
        console, campaign, folder, threads=threads, quiet=quiet, truth=truth.vehicle.coefficients()
    )
    logs = folder / "trials"
    logs.mkdir(exist_ok=True)
    for name in campaign.trials:
        if (path := campaign.path_of(name)) is not None:
            Recipe.load(path).write_csv(logs / f"generated-{name}.csv")
    if not quiet:
        console.print(f"Generated trials in {logs}\n", soft_wrap=True, markup=False)
    return fit, truth.vehicle


def _beluga(console: Console, *, quiet: bool) -> Campaign | None:
    """Campaign of Beluga where its recordings are at hand, else a word on how to get them."""
    from seatrial.campaign import Campaign

    path = EXAMPLES / "beluga" / "campaign.toml"
    data = os.environ.get("SEATRIAL_DATA", "")
    if not path.is_file():
        return None
    if not data or not (Path(data) / "beluga").is_dir():
        if not quiet:
            console.print(
                "The AUV Beluga is left out: its recordings are not here. Set SEATRIAL_DATA to the folder"
                " that holds beluga/ (from github.com/michoy/system_identification, data/synchronized).",
                soft_wrap=True,
            )
        return None
    if not quiet:
        console.rule("Beluga: recorded trials of a real vehicle (Vortex NTNU, 2021)", align="left")
    return Campaign.load(path)


def _identified(
    console: Console,
    campaign: Campaign,
    folder: Path,
    *,
    threads: int | None,
    quiet: bool,
    truth: Mapping[str, float] | None = None,
) -> Identification:
    from seatrial.cli.console import list_figures
    from seatrial.cli.identify import draw, run
    from seatrial.cli.tables import print_identification

    began = time.monotonic()
    fit = run(campaign, folder, threads=threads, resume=False, quiet=quiet)
    took = time.monotonic() - began
    written = [] if fit.interrupted else draw(fit, folder, formats=("png",))
    if not quiet:
        print_identification(console, fit, truth=truth)
        console.print(f"Identified in {took:.1f} s; results in {folder}", soft_wrap=True, markup=False)
        list_figures(console, written)
    return fit
