"""How near evolution strategy and simplex come to the optimum of a stage without the descent by derivatives.

``python -m benchmarks.stage_search`` prints, for each stage of CWolf's example and ten random starts, the
criterion as a multiple of its optimum after either search, and the candidates that each took, with the
shipped settings. The optimum is where the descent ends that begins at the best of all. Held by
``test_strategy_and_simplex_reach_the_optimum_from_ten_random_starts``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

import seatrial as st
from benchmarks.four_stages import EXAMPLE
from seatrial.estimation import stage as stages
from seatrial.estimation.descent import Criterion, descend
from seatrial.estimation.search import evolve, refine
from seatrial.estimation.segment_model import SegmentModel
from seatrial.problem.parameter import coefficients

CAMPAIGN = EXAMPLE / "campaign.toml"

STARTS = 10


@dataclass(frozen=True)
class Searched:
    """Costs as multiples of the optimum's, and candidates, of one random start of a stage."""

    stage: str
    seed: int
    start: float
    strategy: float
    strategy_candidates: int
    simplex: float
    simplex_candidates: int


def searched(starts: int = STARTS, names: tuple[str, ...] = ()) -> Iterator[Searched]:
    """Every stage of the campaign, or those of `names`, from random starts inside its bounds."""
    campaign = st.Campaign.load(CAMPAIGN)
    vehicle = campaign.vehicle
    for plan in stages.plan(campaign.problem()):
        criterion = Criterion(
            SegmentModel(vehicle, plan.stage, plan.data, plan.parameters, plan.step.search, None)
        )
        lower, upper = (np.array([getattr(p, end) for p in plan.parameters]) for end in ("lower", "upper"))
        box: dict[str, Any] = {"lower": lower, "upper": upper, "tolerance": plan.tolerance}
        found = []
        for seed in range(starts if not names or plan.stage.name in names else 1):
            start = np.random.default_rng([seed, plan.seed]).uniform(lower, upper)
            coarse = evolve(
                criterion,
                start,
                seed=plan.seed + seed,
                population=plan.population,
                generations=plan.generations,
                **box | {"tolerance": max(plan.tolerance, stages.STAGE_RUN_SETTINGS.coarse_gain)},
            )
            fine = refine(criterion, coarse.elite, rounds=plan.rounds, axes=coarse.axes, **box)
            found.append((coarse, fine))
        best = min((fine for _, fine in found), key=lambda one: one.cost)
        optimum = descend(criterion, criterion.linearised, best.x, **box | {"tolerance": 1e-6})
        vehicle = vehicle.with_coefficients(coefficients(plan.parameters, optimum.x))
        for seed, (coarse, fine) in enumerate(found):
            if not names or plan.stage.name in names:
                yield Searched(
                    plan.stage.name,
                    seed,
                    coarse.start_cost / optimum.cost,
                    coarse.cost / optimum.cost,
                    coarse.evaluations,
                    fine.cost / optimum.cost,
                    fine.evaluations,
                )


def main() -> None:
    """Print a row per stage and start."""
    table = Table(title="criterion over that of the optimum; candidates")
    for head in ("stage", "seed", "start", "strategy", "candidates", "and simplex", "candidates"):
        table.add_column(head, justify="left" if head == "stage" else "right")
    for one in searched():
        table.add_row(
            one.stage,
            str(one.seed),
            f"{one.start:.1f}",
            f"{one.strategy:.4f}",
            str(one.strategy_candidates),
            f"{one.simplex:.4f}",
            str(one.simplex_candidates),
        )
    Console().print(table)


if __name__ == "__main__":
    main()
