"""Random starts: whether the search ends in the same optimum, wherever in the bounds it begins.

Every start draws the start values of all stages uniformly inside their bounds and runs all stages in their
order with random numbers of its own. `seatrial.identification.restarts_result` judges where they end.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial._core import checked_threads
from seatrial.base.chunks import RECORDS, Chunk, Format, Shared, run_chunks
from seatrial.base.errors import CampaignError, SimulationError
from seatrial.base.fleet import fleet_of, threads_of
from seatrial.base.progress import Clock, Progress, callers_errors_pass, part_of
from seatrial.base.run import RunDirectory, run_facts, sha256, to_json, version
from seatrial.estimation.stage import StageResult, plan
from seatrial.identification.identify import StageOrder
from seatrial.identification.preparation import identifiable
from seatrial.identification.restarts_result import Restarts, StageRestarts
from seatrial.problem.problem import stated

if TYPE_CHECKING:
    from seatrial.base.fleet import Workers
    from seatrial.problem.problem import Asks, Problem

Stages = tuple[StageResult, ...]


@callers_errors_pass
def restarts(
    asked: Problem | Asks,
    *,
    starts: int = 10,
    seed: int | None = None,
    sigma: Mapping[str, float] | None = None,
    run_dir: str | Path | None = None,
    progress: Callable[[Progress], None] | None = None,
    resume: bool = True,
    threads: int | None = None,
    executor: Workers | None = None,
) -> Restarts:
    """Ends of all stages from random starts inside the bounds, and whether they are one optimum.

    Parameters
    ----------
    asked : Problem or Campaign
    starts : int
        Number of random starts, at least two.
    seed : int, optional
        Seed of the starts; by default the campaign's. The same seed gives the same starts and ends, and the
        first of many starts are those of few.
    sigma : mapping, optional
        Standard deviation of coefficients by name, SI, as `Identification.sigma` gives them.
    run_dir : str or Path, optional
        Folder for the results. Finished stages of every start are kept beside it while the run goes on.
    progress : callable, optional
        Called in the caller's thread with a `Progress` of the whole after every batch of candidates.
    resume : bool
        Reuse what an earlier run in this folder finished from the same inputs.
    threads : int, optional
        Threads of the core, with an executor one per worker by default; the result does not depend on it.
    executor : Executor, str or distributed.Client, optional
        Where starts are searched, each as a whole; see `seatrial.verify`.

    Returns
    -------
    Restarts
        After Ctrl-C: the starts that were finished, marked as interrupted.

    Raises
    ------
    CampaignError, TrialError
        Fewer than two starts, or the campaign asks for what cannot be done.
    SeatrialError
        The run directory cannot be written.

    Examples
    --------
    >>> import seatrial as st
    >>> from seatrial.identification.restarts import restarts
    >>> campaign = st.Campaign.load("examples/cwolf/campaign.toml")  # doctest: +SKIP
    >>> print(restarts(campaign, starts=10))  # doctest: +SKIP
    """
    checked_threads(threads)
    problem = stated(asked)
    if starts < 2:
        raise CampaignError(
            f"random starts: expected two or more, found {starts}; a single one has nothing to be"
            " compared with"
        )
    seed = problem.seed if seed is None else seed
    problem, _ = identifiable(problem)
    plan(problem)  # refuses a bad campaign before a folder appears
    clock = Clock()
    rows: list[Stages] = []
    records: list[Mapping[str, Any]] = []
    interrupted = False
    threads = threads_of(threads, executor)
    with RunDirectory(run_dir, "random starts", resume=resume) as run, fleet_of(executor) as fleet:
        shared, inputs = Shared(problem), _inputs(problem, seed)

        def part(number: int) -> str:
            return f"start {number + 1} of {starts}"

        def here(chunk: Chunk[Stages]) -> Stages:
            """One start in this process, whose stages are kept one by one and tell how far they are."""
            number = chunk.arguments[1]
            told = None if progress is None else part_of(progress, part(number), number, starts, clock)
            return _stages(problem, seed, number, run=run, progress=told, threads=threads)

        chunks = (
            Chunk(f"start {number + 1}", inputs, search_start, shared, (seed, number, threads))
            for number in range(starts)
        )
        try:
            for done in run_chunks(chunks, run, _FORMAT, fleet=fleet, here=here):
                rows.append(done.value)
                records.append(done.record)
                if progress is not None and fleet is not None and not done.kept:
                    over = len(rows) - 1
                    part_of(progress, part(over), over, starts, clock)(_finished(done.value))
        except KeyboardInterrupt:
            interrupted = True
        ends = Restarts(
            problem.name,
            tuple(
                StageRestarts.of([row[index] for row in rows], problem.parameters[stage.name], sigma or {})
                for index, stage in enumerate(problem.stages)
                if rows
            ),
            seed,
            interrupted,
            problem.text,
            run_facts(
                "random starts",
                problem.name,
                clock=clock,
                inputs=problem.input_hashes(),
                seed=seed,
                options={"starts": starts},
                interrupted=interrupted,
            ),
        )
        if run_dir is not None and rows and not interrupted:
            run.publish(ends.facts, ends.files() | {RECORDS: to_json(records)})
    return ends


def search_start(problem: Problem, seed: int, number: int, threads: int | None) -> Stages:
    """Ends of all stages from one random start: a chunk of the work."""
    return _stages(problem, seed, number, run=RunDirectory(None), progress=None, threads=threads)


def _stages(
    problem: Problem,
    seed: int,
    number: int,
    *,
    run: RunDirectory,
    progress: Callable[[Progress], None] | None,
    threads: int | None,
) -> Stages:
    own = problem.with_start_values(start_values(problem, seed, number), seed=_stream(seed, number))
    part = f"start {number + 1}, "
    order = StageOrder(own, plan(own), run, part=part, progress=progress, threads=threads)
    found = order.stages()
    if order.stop.is_set():
        raise KeyboardInterrupt
    if order.failed:
        raise SimulationError(f"random starts: start {number + 1}: {order.fallbacks.findings[0].sentence}")
    return found


def _inputs(problem: Problem, seed: int) -> str:
    """SHA-256 of everything that a start depends on besides its number."""
    return sha256(to_json([version("seatrial"), seed, problem.input_hashes(), problem.described()]))


def _finished(stages: Stages) -> Progress:
    """A start that is over."""
    return Progress(stages[-1].name, len(stages), len(stages), 1.0, 0.0, 0.0)


def start_values(problem: Problem, seed: int, number: int) -> dict[str, dict[str, float]]:
    """Start values by stage and parameter, SI, of one random start: uniform inside the bounds."""
    found = {}
    for stage in problem.stages:
        generator = np.random.default_rng([seed, number, zlib.crc32(stage.name.encode())])
        found[stage.name] = {
            p.name: float(generator.uniform(p.lower, p.upper)) for p in problem.parameters[stage.name]
        }
    return found


def _stream(seed: int, number: int) -> int:
    """Seed of the search from one start."""
    return int(np.random.SeedSequence([seed, number]).generate_state(1)[0])


_FORMAT: Format[Stages] = Format(
    pack=lambda stages: {"stages": [stage.to_dict() for stage in stages]},
    unpack=lambda kept: tuple(replace(StageResult.from_dict(one), reused=True) for one in kept["stages"]),
)
