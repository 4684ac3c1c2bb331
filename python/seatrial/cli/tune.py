"""`seatrial tune`: a campaign in, an autopilot whose responses stay in their corridors out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Collection

    from rich.console import Console

    from seatrial.campaign.campaign import Campaign
    from seatrial.tuning.result import Tuning

__all__ = ["draw", "fitted_source", "print_tuning", "tune", "tuned"]


def tune(
    campaign: Annotated[Path, typer.Argument(help="Campaign file (TOML) with [tuning].")],
    run: Annotated[
        Path | None,
        typer.Option(
            "--run",
            help="Run directory of `seatrial identify`, or a vehicle; runs/NAME where that is one, else the"
            " campaign's own vehicle.",
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Run directory; runs/NAME-tuned by default.")
    ] = None,
    relay: Annotated[bool, typer.Option(help="Judge a relay autotuning of the same loops beside.")] = False,
    resume: Annotated[
        bool, typer.Option(help="Reuse what an earlier run finished from the same inputs.")
    ] = True,
    threads: Annotated[int | None, typer.Option(min=1, help="Threads; all processors by default.")] = None,
    figures: Annotated[bool, typer.Option(help="Write figures (PNG and PDF) into the run directory.")] = True,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Tune an autopilot's gains until its responses stay within the corridors of a campaign.

    The exit code is 1 where a response leaves its corridor, or a margin falls short, after all. Ctrl-C keeps
    the best so far; the same command goes on with what is not finished.
    """
    from seatrial.campaign.campaign import Campaign
    from seatrial.cli.console import list_figures, output, print_json

    loaded = Campaign.load(campaign)
    folder = out or Path("runs") / f"{loaded.name}-tuned"
    source = fitted_source(loaded, run)
    console = output()
    if not json:
        console.print(f"Vehicle: {source or loaded.vehicle.name}", soft_wrap=True, markup=False)
    found = tuned(loaded, source, folder, relay=relay, resume=resume, threads=threads, quiet=json)
    written = draw(found, folder) if figures and not found.interrupted else []
    if json:
        print_json(found.to_dict() | {"run_directory": str(folder), "figures": [str(p) for p in written]})
    else:
        print_tuning(console, found)
        if not found.interrupted:
            console.print(
                f"Results in {folder}: autopilot.toml, tuning.json, summary.txt, Parquet tables",
                soft_wrap=True,
                markup=False,
            )
        list_figures(console, written)
    if found.interrupted:
        raise typer.Exit(130)
    if not found.held:
        raise typer.Exit(1)


def fitted_source(campaign: Campaign, given: Path | None) -> Path | str | None:
    """What is known of the vehicle: what was given, else the campaign's run directory, else nothing."""
    if given is not None:
        return given if given.exists() else str(given)
    beside = Path("runs") / campaign.name
    return beside if (beside / "identification.json").is_file() else None


def tuned(
    campaign: Campaign,
    source: object,
    folder: Path | None,
    *,
    relay: bool = False,
    resume: bool = True,
    threads: int | None = None,
    quiet: bool = False,
) -> Tuning:
    """Tuning of a campaign into a run directory, with progress on standard error."""
    from seatrial.cli.console import search_progress
    from seatrial.tuning.tune import tune as tuning

    with search_progress("making ready", quiet=quiet) as progress:
        return tuning(
            campaign,
            source,  # type: ignore[arg-type]
            run_dir=folder,
            progress=progress,
            relay=relay,
            resume=resume,
            threads=threads,
        )


def draw(
    found: Tuning, folder: Path, *, formats: tuple[str, ...] = ("png",), loops: Collection[str] | None = None
) -> list[Path]:
    """Paths of the figures of a tuning in its run directory, of some loops or of all."""
    from seatrial.report.plot.tuning import tuning_gallery

    return tuning_gallery(found, folder / "figures", formats=formats, loops=loops)


def print_tuning(console: Console, found: Tuning) -> None:
    """Print responses before and after, gains, margins and what they mean."""
    from seatrial.cli.console import table
    from seatrial.tuning.result import (
        COMPARISON_TITLE,
        GAIN_HEAD,
        TRIAL_HEAD,
        comparison_head,
        comparison_rows,
        gain_rows,
        sentences,
        trial_rows,
    )

    if (judged := found.of("tuned")) is not None:
        title = f"{found.plan.vehicle.name}: responses with the tuned gains (times in s)"
        console.print(table(title, TRIAL_HEAD, trial_rows(judged)))
        console.print(table(COMPARISON_TITLE, comparison_head(found), comparison_rows(found)))
    console.print(
        table("Gains at the supporting points that are reached", GAIN_HEAD, gain_rows(found), left=2)
    )
    if not found.interrupted:
        rows = [
            (
                row.mode,
                f"{row.speed_m_s:.2f}",
                row.loop,
                _number(row.gain_up_db, 1),
                _number(row.gain_down_db, 1),
                _number(row.phase_deg, 0),
                _number(row.delay_s, 2),
                "" if row.stable else "unstable",
            )
            for row in found.margins["tuned"]
        ]
        head = ("mode", "m/s", "loop", "up, dB", "down, dB", "phase, deg", "delay, s", "")
        console.print(table("Margins with the tuned gains", head, rows))
    for line in sentences(found):
        console.print(f"- {line}", soft_wrap=True, markup=False)
    flown = sum(group.flown_s for group in found.groups)
    console.print(
        f"Tuned in {found.elapsed_s:.1f} s: {sum(g.evaluations for g in found.groups)} sets of gains,"
        f" {flown / 3600.0:.0f} h of flight.",
        soft_wrap=True,
        markup=False,
    )


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
