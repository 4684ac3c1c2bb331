"""`seatrial identify`: a campaign in, an identified vehicle and how good it is out.

Tables of an identification for a control engineer.

Table of random starts: spread of the ends per coefficient, a sentence per stage.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from seatrial.base.channels import readable
from seatrial.cli.console import table
from seatrial.identification.hold_out import POOLED
from seatrial.identification.identification import advice, derived, distinct, plus_minus

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from seatrial.campaign.campaign import Campaign
    from seatrial.campaign.variants import LockedAxes
    from seatrial.identification.identification import Identification
    from seatrial.identification.restarts import Restarts
    from seatrial.trial.score import Score

__all__ = [
    "coefficients",
    "draw",
    "held_out",
    "identify",
    "meaning",
    "nuisances",
    "number",
    "print_identification",
    "print_restarts",
    "run",
    "stages",
]


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
    from seatrial.base.run import RunDirectory
    from seatrial.campaign.campaign import Campaign
    from seatrial.cli.console import output, print_json

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
    from seatrial.base.errors import CampaignError, nearest

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
    from seatrial.identification.restarts import restarts

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
    from seatrial.report.plot.restarts import random_starts
    from seatrial.report.plot.style import save

    return save(random_starts(found), folder / "figures" / "random_starts")


def run(
    campaign: Campaign, folder: Path, *, threads: int | None = None, resume: bool = True, quiet: bool = False
) -> Identification:
    """Identification of a campaign into a run directory, with progress on standard error."""
    from seatrial.cli.console import identification_progress
    from seatrial.identification.identify import identify as identified

    with identification_progress(quiet=quiet) as progress:
        return identified(campaign, run_dir=folder, progress=progress, resume=resume, threads=threads)


def draw(fit: Identification, folder: Path, *, formats: tuple[str, ...] = ("png", "pdf")) -> list[Path]:
    """Paths of the figures of an identification in its run directory."""
    from seatrial.report.plot.identification import gallery

    return gallery(fit, folder / "figures", formats=formats)


def _replacements(entries: list[str]) -> dict[str, str]:
    """Trial names and files from NAME=FILE."""
    from seatrial.base.errors import CampaignError

    found: dict[str, str] = {}
    for entry in entries:
        name, equals, path = entry.partition("=")
        if not equals or not name or not path:
            raise CampaignError(f"--trial {entry!r}: expected NAME=FILE, for example --trial surge=log.csv")
        if not Path(path).is_file():
            raise CampaignError(f"--trial {entry}: there is no file {path}; correct the path")
        found[name] = path
    return found


def print_identification(
    console: Console, fit: Identification, *, truth: Mapping[str, float] | None = None
) -> None:
    """Print coefficients, scores, what they mean, and advice; the truth is known for generated trials."""
    console.print(coefficients(fit, truth))
    if (trials := nuisances(fit)) is not None:
        console.print(trials)
    console.print(stages(fit))
    if (scores := held_out(fit)) is not None:
        console.print(scores)
    console.print(meaning(fit))
    for line in advice(fit):
        console.print(f"- {line}", soft_wrap=True, markup=False)


def coefficients(fit: Identification, truth: Mapping[str, float] | None = None) -> Table:
    """Coefficient, unit, (truth,) start, estimate ± standard deviation, factor, verdict, bound, stage."""
    head = ["coefficient", "unit", *(["truth"] if truth else []), "start", "estimate", "factor"]
    head += [*(["error"] if truth else []), "verdict", "bound", "stage"]
    rows = []
    for row in distinct(fit):
        cells = [row.name, row.unit]
        if truth:
            cells.append(f"{truth.get(row.name, 0.0):.4g}")
        factor = "" if row.factor is None else f"{row.factor:.3g}"
        cells += [f"{row.start:.4g}", plus_minus(row.estimate, row.sigma), factor]
        if truth:
            true = truth.get(row.name, 0.0)
            cells.append(f"{round(100.0 * (row.estimate / true - 1.0), 1) + 0.0:+.1f} %" if true else "")
        verdict = "" if row.verdict == "identifiable" else row.verdict or ""
        rows.append([*cells, verdict, f"at {row.at_bound}" if row.at_bound else "", row.stage])
    # What is said of no coefficient takes no room: the table is to fit 80 columns.
    silent = {
        k for k, name in enumerate(head) if name in ("verdict", "bound") and not any(r[k] for r in rows)
    }
    head, *rows = ([cell for k, cell in enumerate(row) if k not in silent] for row in (head, *rows))
    return table(f"{fit.vehicle.name}: identified coefficients", head, rows, left=2)


def nuisances(fit: Identification) -> Table | None:
    """What the trials added to their records, estimated with the coefficients."""
    found = [] if fit.certainty is None else fit.certainty.nuisances()
    rows = [[row["name"], row["unit"], plus_minus(row["estimate"], row["sigma"])] for row in found]
    head = ["nuisance parameter", "unit", "estimate"]
    return table("Trials: what the coefficients need not absorb", head, rows, left=2) if rows else None


def stages(fit: Identification) -> Table:
    """Stages with cost before and after, candidates and time."""
    rows = [
        [
            stage.name + (" (interrupted)" if stage.interrupted else " (kept)" if stage.reused else ""),
            f"{stage.start_cost:.4g}",
            f"{stage.cost:.4g}",
            str(stage.evaluations),
            f"{stage.samples}",
            f"{1e3 * stage.step_s:.3g} ms",
            f"{stage.wall_s:.1f} s",
        ]
        for stage in fit.stages
    ]
    if fit.certainty is not None and fit.certainty.polished.rounds:
        polished = fit.certainty.polished
        cells = [
            "joint polish (rms in sd of the residual)",
            f"{polished.rms(polished.start_cost):.4g}",
            f"{polished.rms(polished.cost):.4g}",
            str(polished.evaluations),
        ]
        rows.append([*cells, "", "", f"{polished.wall_s:.1f} s"])
    head = ["stage", "cost at start", "best", "candidates", "samples", "step", "time"]
    return table("Stages (cost: mean weighted error in standard deviations)", head, rows, left=0)


def held_out(fit: Identification) -> Table | None:
    """Scores per channel on the part that was held out, over all trials that have one."""
    kinds = fit.scores.get("hold_out", {})
    ahead, free = _pooled(kinds.get("ahead", {})), _pooled(kinds.get("free", {}))
    if ahead is None:
        return None
    rows = []
    for channel, one in ahead.items():
        scale, unit = readable(channel)
        run = free[channel].r2 if free is not None and channel in free else np.nan
        rows.append([channel, unit, number(one.r2), number(run), f"{scale * one.mae:.3g}", str(one.n)])
    head = ["channel", "unit", "R2 10 s ahead", "R2 free run", "mean error 10 s ahead", "samples"]
    trials = ", ".join(ahead.trials)
    return table(
        f"Held-out data ({trials}; R2 = 1 is perfect, 0 no better than the mean)", head, rows, left=2
    )


def meaning(fit: Identification) -> Table:
    """Apparent masses, net buoyancy, gains and lags."""
    rows = [[name, f"{value:.4g}"] for name, value in derived(fit.vehicle).items()]
    return table("What the coefficients mean", ["quantity", "value"], rows)


def number(value: float) -> str:
    """A score in three decimals; what is far below zero in short."""
    if not np.isfinite(value):
        return "none" if np.isnan(value) else "diverged"
    return f"{value:.3f}" if value > -10.0 else f"{value:.0f}"


def _pooled(scores: Mapping[str, Score]) -> Score | None:
    """Score over all trials together, or the only one there is."""
    return scores.get(POOLED) or next(iter(scores.values()), None)


def print_restarts(console: Console, found: Restarts, folder: Path, *, asked: int) -> None:
    """Print where random starts ended, stage by stage, and what that says."""
    rows = []
    for stage in found.stages:
        rows_of = list(stage.rows())
        for row in rows_of:
            ratio = row["scatter_in_sigma"]
            rows.append([
                stage.name if row is rows_of[0] else "",
                row["parameter"],
                row["unit"],
                f"{row['least']:.5g} to {row['most']:.5g}",
                f"{row['range_percent_of_bounds']:.2g}",
                "" if math.isnan(ratio) else f"{ratio:.2g}",
            ])
    if rows:
        head = ["stage", "coefficient", "unit", "ends", "% of bounds", "scatter in sd"]
        console.print(table(f"Ends of {found.starts} random starts (seed {found.seed})", head, rows, left=3))
    for line in found.sentences():
        console.print(f"- {line}", soft_wrap=True, markup=False)
    if found.interrupted:
        console.print(
            f"- Interrupted after {found.starts} of {asked} random starts; the same command goes on",
            soft_wrap=True,
        )
    else:
        console.print(
            f"Random starts in {folder}: random_starts.json, Parquet tables, summary.txt",
            soft_wrap=True,
            markup=False,
        )
