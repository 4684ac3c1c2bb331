"""Random starts: whether the search of all stages ends in the same optimum, wherever in the bounds it begins.

``python -m studies.random_starts CAMPAIGN`` draws the start values of all stages uniformly inside their
bounds and runs all stages in their order with random numbers of its own. It prints per stage how far the ends
lie apart: criteria above the lowest one, estimates by the width of their bounds.

Held by ``tests/studies/test_studies.py``.
"""

from __future__ import annotations

import sys
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from seatrial.base.run import RunDirectory
from seatrial.base.work import HERE
from seatrial.campaign.campaign import Campaign
from seatrial.estimation.stage import StageOrder, StageResult, plan
from seatrial.identification.preparation import identifiable
from seatrial.problem.problem import Problem

CAMPAIGN = Path(__file__).parents[1] / "examples" / "cwolf" / "campaign.toml"


@dataclass(frozen=True)
class Ends:
    """How far the ends of one stage lie apart.

    ``above`` is the highest criterion above the lowest, as a part of it; ``spread`` the distance between the
    outermost estimates by parameter, as a part of the width of its bounds.
    """

    stage: str
    lowest: float
    above: float
    spread: dict[str, float]


def stages_from(problem: Problem, seed: int, number: int) -> tuple[StageResult, ...]:
    """Ends of all stages from one random start; the first of many starts are those of few."""
    starts = {}
    for stage in problem.stages:
        generator = np.random.default_rng([seed, number, zlib.crc32(stage.name.encode())])
        starts[stage.name] = {
            parameter.name: float(generator.uniform(parameter.lower, parameter.upper))
            for parameter in problem.parameters[stage.name]
        }
    stream = int(np.random.SeedSequence([seed, number]).generate_state(1)[0])
    problem = problem.with_start_values(starts, seed=stream)
    order = StageOrder(problem, plan(problem), RunDirectory(None), HERE)
    results = order.stages()
    if order.stop.is_set():
        raise KeyboardInterrupt
    return results


def compared(problem: Problem, runs: Sequence[tuple[StageResult, ...]]) -> list[Ends]:
    """How far the ends of each stage lie apart."""
    table = []
    for results in zip(*runs, strict=True):
        costs = [result.cost for result in results]
        name = results[0].name
        spread = {
            parameter.name: float(np.ptp([result.estimates[parameter.name] for result in results]))
            / (parameter.upper - parameter.lower)
            for parameter in problem.parameters[name]
        }
        table.append(Ends(name, min(costs), max(costs) / min(costs) - 1.0, spread))
    return table


def study(
    campaign: Annotated[Path, typer.Argument(help="Campaign file.")] = CAMPAIGN,
    starts: Annotated[int, typer.Option(min=2, help="Random starts.")] = 10,
) -> None:
    """Print how far the ends of every stage lie apart."""
    problem, _ = identifiable(Campaign.load(campaign).problem())
    runs = []
    for number in range(starts):
        runs.append(stages_from(problem, problem.seed, number))
        print(f"\r{number + 1} of {starts}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    print(
        "| stage | lowest criterion | highest above it, % | widest spread, % of bounds |\n|---|---|---|---|"
    )
    for ends in compared(problem, runs):
        widest = max(ends.spread, key=ends.spread.__getitem__)
        print(
            f"| {ends.stage} | {ends.lowest:.5g} | {100 * ends.above:.2g} |"
            f" {100 * ends.spread[widest]:.2g} (`{widest}`) |"
        )


if __name__ == "__main__":
    typer.run(study)
