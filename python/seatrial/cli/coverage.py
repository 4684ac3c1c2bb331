"""`seatrial coverage`: how often intervals hold the truth of generated trials."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from seatrial.experiment.coverage import Coverage, CoverageRow

__all__ = ["coverage", "print_coverage"]


def coverage(
    campaign: Annotated[Path, typer.Argument(help="Campaign file (TOML) whose trials are all generated.")],
    seeds: Annotated[int, typer.Option(min=1, help="Repetitions.")] = 50,
    first: Annotated[int, typer.Option(min=0, help="Seed of the first repetition.")] = 1,
    truth: Annotated[
        Path | None, typer.Option(help="Truth file that sails all trials instead of the recipes' own.")
    ] = None,
    analysed: Annotated[
        int, typer.Option(min=0, help="Repetitions in which the residual analysis is asked as well.")
    ] = 5,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Run directory; runs/NAME of the campaign by default.")
    ] = None,
    resume: Annotated[
        bool, typer.Option(help="Reuse repetitions that an earlier run finished from the same inputs.")
    ] = True,
    threads: Annotated[int | None, typer.Option(min=1, help="Threads; all processors by default.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Count how often the 95 % intervals hold the truth, over repetitions with other noise and biases.

    Ctrl-C keeps what is done; the same command goes on from there.
    """
    from seatrial.campaign.campaign import Campaign
    from seatrial.cli.console import output, print_json, search_progress
    from seatrial.experiment.coverage import coverage as covered
    from seatrial.trial.truth import Truth

    loaded = Campaign.load(campaign)
    named = loaded.name if truth is None else f"{loaded.name}-{truth.stem}"
    folder = out or Path("runs") / named
    with search_progress("first repetition", quiet=json) as progress:
        found = covered(
            loaded,
            seeds=seeds,
            first=first,
            truth=None if truth is None else Truth.load(truth),
            analysed=analysed,
            run_dir=folder,
            progress=progress,
            resume=resume,
            threads=threads,
        )
    if json:
        print_json(found.to_dict() | {"run_directory": str(folder)})
    else:
        print_coverage(output(), found)
    if found.interrupted:
        raise typer.Exit(130)
    if found.failures:
        raise typer.Exit(1)


def print_coverage(console: Console, found: Coverage) -> None:
    """Print the table of a coverage run and what follows from it."""
    from seatrial.cli.console import table

    if found.rows:
        console.print(_table(found))
    scores = found.hold_out()
    if any(scores.values()):
        channels = list(next(iter(scores.values())))
        body = [[name, *(f"{of[channel]:.3f}" for channel in channels)] for name, of in scores.items()]
        console.print(table("Held-out trials, R2 ten seconds ahead, mean", ["vehicle", *channels], body))
    for line in _sentences(found):
        console.print(f"- {line}", soft_wrap=True, markup=False)


def _table(found: Coverage) -> Table:
    from seatrial.cli.console import table

    head = ["unknown", "unit", "truth", "mean", "bias/sd", "sigma", "scatter", "inside", "verdict"]
    title = f"{found.campaign}: 95 % intervals over {len(found.draws)} repetitions"
    return table(title, head, [_cells(row) for row in found.rows], left=2)


def _cells(row: CoverageRow) -> list[str]:
    """Bias is over its standard error; digits follow sigma."""
    digits = 4
    if math.isfinite(row.sigma) and row.sigma > 0.0 and row.mean:
        digits = max(math.floor(math.log10(abs(row.mean))) - math.floor(math.log10(row.sigma)) + 2, 3)

    def number(value: float, places: int = digits) -> str:
        return "" if math.isnan(value) else f"{value:#.{places}g}".rstrip(".")

    often = row.verdicts[row.verdict]
    verdict = row.verdict if often == row.n else f"{row.verdict} {often}/{row.n}"
    return [
        row.name,
        row.unit,
        number(row.truth) or "drawn",
        number(row.mean) if math.isfinite(row.truth) else "",
        number(row.bias_t, 2),
        number(row.sigma, 2),
        number(row.scatter, 2),
        f"{row.inside}/{row.n}",
        verdict,
    ]


def _sentences(found: Coverage) -> list[str]:
    from seatrial.experiment.repetition import unmodelled

    total, lines = len(found.draws), []
    if found.outside:
        lines.append(
            f"the truth is outside the model class: {unmodelled(found.outside)}; the coefficients have no"
            " right value, judge the model by its hold-out alone"
        )
    lines += [
        f"{one.name} held at {one.value:.4g} {one.unit} instead of {one.estimate:.4g}: the log-likelihood"
        f" ratio is {2.0 * one.rise:.2f}, {'above' if one.contradicted else 'below'} 3.84 of 95 %"
        for one in found.held
    ]
    if found.analysed:
        lines.append(f"the residual analysis warns in {found.warned} of {found.analysed} repetitions")
        warned = next((one for one in found.draws if one.residual_analysis), None)
        if warned is not None and warned.residual_analysis:
            lines += [f"seed {warned.seed}: {text}" for text in warned.residual_analysis]
    slow = [one.seed for one in found.draws if not one.converged]
    if slow:
        lines.append(f"not converged within the rounds of the polish: seeds {', '.join(map(str, slow))}")
    lines += [f"FAILED: {text}" for text in found.failures]
    if found.interrupted:
        lines.append(f"interrupted after {total} of {found.asked} repetitions; run again to go on")
    return lines
