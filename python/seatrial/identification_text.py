"""An identification in words and tables: what `Identification.summary` prints."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from seatrial.identification import Estimate, derived
from seatrial.recording.columns import CHANNELS
from seatrial.text_table import text_table

if TYPE_CHECKING:
    from seatrial.identification import Identification


def summary(fit: Identification) -> str:
    """Text that a control engineer reads: stages, coefficients, what they mean, scores, advice."""
    parts = [_stage_table(fit), _coefficient_table(fit), _nuisance_table(fit), _meaning(fit)]
    parts += [_score_table(fit), "\n".join(advice(fit))]
    return "\n\n".join(part for part in parts if part)


def _stage_table(fit: Identification) -> str:
    rows = [
        (
            stage.name + (" (interrupted)" if stage.interrupted else " (kept)" if stage.reused else ""),
            ", ".join(stage.trials),
            f"{stage.start_cost:.4g}",
            f"{stage.cost:.4g}",
            f"{stage.evaluations}",
            f"{1e3 * stage.step_s:.3g} ms",
            f"{stage.wall_s:.1f} s",
        )
        for stage in fit.stages
    ]
    head = ("Stage", "trials", "cost at start", "best", "candidates", "step", "time")
    return text_table(head, rows)


def _coefficient_table(fit: Identification) -> str:
    rows = [
        (
            row.name,
            row.unit,
            f"{row.start:.4g}",
            plus_minus(row.estimate, row.sigma),
            row.verdict or "",
            "" if row.factor is None else f"{row.factor:.3g}",
            f"[{row.lower + 0.0:.4g}, {row.upper + 0.0:.4g}]"
            + (f" at {row.at_bound}" if row.at_bound else ""),
            row.stage,
        )
        for row in distinct(fit)
    ]
    return text_table(
        ("Coefficient", "unit", "start", "estimate", "verdict", "factor", "bounds", "stage"), rows
    )


def distinct(fit: Identification) -> tuple[Estimate, ...]:
    """Rows with one for the equal coefficients of an actuator group, under the group's name."""
    names = {row.name for row in fit.coefficients}
    rows: dict[tuple[str, float], Estimate] = {}
    for row in fit.coefficients:
        name = row.name if row.parameter in names else row.parameter
        rows.setdefault((name, row.estimate), replace(row, name=name))
    return tuple(rows.values())


def _meaning(fit: Identification) -> str:
    return text_table(
        ("Quantity", "value"), [(name, f"{value:.4g}") for name, value in derived(fit.vehicle).items()]
    )


def _score_table(fit: Identification) -> str:
    titles = {"ahead": "10 s ahead", "free": "free run"}
    scored = {row["channel"] for row in fit.score_rows()}
    channels = [channel for channel in CHANNELS if channel in scored]
    rows = []
    for part, kinds in fit.scores.items():
        for kind, per_trial in kinds.items():
            for trial, score in per_trial.items():
                cells = (f"{score.r2[c]:.3f}" if c in score.r2 else "" for c in channels)
                rows.append((f"R2 {part.replace('_', ' ')}, {titles[kind]}", trial, *cells))
    return text_table(("Score", "trial", *channels), rows) if rows else ""


def advice(fit: Identification) -> list[str]:
    """Sentences: bounds that were hit, what the data cannot tell, what the model lacks, what did not run."""
    lines = [
        f"{row.name} lies at its {row.at_bound} bound: widen it if the value makes sense; otherwise the data"
        " cannot tell this coefficient"
        for row in distinct(fit)
        if row.at_bound
    ]
    if fit.certainty is not None:
        lines += fit.certainty.sentences()
    lines += fit.scale.sentences()
    lines += fit.notes
    if fit.interrupted:
        lines.append(
            "Interrupted: the best so far is shown"
            + (f"; not run: {', '.join(fit.not_run)}" if fit.not_run else "")
            + ". Run again with the same run directory to go on"
        )
    return lines


def _nuisance_table(fit: Identification) -> str:
    found = [] if fit.certainty is None else fit.certainty.nuisances()
    rows = [(row["name"], row["unit"], plus_minus(row["estimate"], row["sigma"])) for row in found]
    return text_table(("Nuisance parameter", "unit", "estimate"), rows)


def plus_minus(estimate: float, sigma: float | None) -> str:
    """Estimate ± sigma with two digits of sigma; "undetermined" where it is infinite."""
    if sigma is None:
        return f"{estimate:.4g}"
    if not math.isfinite(sigma):
        return f"{estimate:.4g} (undetermined)"
    digits = max(1 - math.floor(math.log10(sigma)), 0) if sigma > 0 else 4
    return f"{estimate:.{digits}f} ± {sigma:.{digits}f}"
