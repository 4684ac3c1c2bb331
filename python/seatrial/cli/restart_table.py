"""Table of random starts: spread of the ends per coefficient, a sentence per stage."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from seatrial.cli.console import table

if TYPE_CHECKING:
    from rich.console import Console

    from seatrial.restart_result import Restarts


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
