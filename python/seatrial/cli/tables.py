"""Tables of an identification for a control engineer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from seatrial.channel import readable
from seatrial.cli.console import table
from seatrial.hold_out import POOLED
from seatrial.identification import derived
from seatrial.identification_text import advice, distinct, plus_minus

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from seatrial.identification import Identification
    from seatrial.score import Score


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
