"""Random starts: whether the search ends in the same optimum, wherever in the bounds it begins.

Every start draws the start values of all stages uniformly inside their bounds and runs the whole order of the
stages with random numbers of its own. A stage's end is *at the optimum* where

1. its criterion lies within 0.1 % of the lowest one found, and
2. every estimate lies within 1 % of its bounds' width of that of the lowest one, or, where its standard
   deviation is known, within a quarter of that, at most 5 %: closer together than the data can tell.

Ends that meet the first rule alone lie along a direction that the criterion hardly tells; it is the first
principal axis of their estimates in the box of the bounds, and its coefficients are named.

Held by `test_random_starts_find_the_same_optimum`, `test_an_end_elsewhere_is_named_with_its_cost` and
`test_a_flat_direction_is_named`.
"""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from seatrial.errors import CampaignError
from seatrial.progress import Progress
from seatrial.restart_result import Restarts, StageRestarts
from seatrial.run_directory import RunDirectory
from seatrial.stage import StageResult, plan
from seatrial.stage_order import StageOrder
from seatrial.variant import started

if TYPE_CHECKING:
    from seatrial.campaign import Campaign

__all__ = ["restarts", "start_values"]


def restarts(
    campaign: Campaign,
    *,
    starts: int = 10,
    seed: int | None = None,
    sigma: Mapping[str, float] | None = None,
    run_dir: str | Path | None = None,
    progress: Callable[[Progress], None] | None = None,
    resume: bool = True,
    threads: int | None = None,
) -> Restarts:
    """Ends of all stages from random starts inside the bounds, and whether they are one optimum.

    Parameters
    ----------
    campaign : Campaign
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
        Threads of the core; the result does not depend on it.

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
    >>> from seatrial.random_starts import restarts
    >>> campaign = st.Campaign.load("examples/cwolf/campaign.toml")  # doctest: +SKIP
    >>> print(restarts(campaign, starts=10))  # doctest: +SKIP
    """
    if starts < 2:
        raise CampaignError(
            f"random starts: expected two or more, found {starts}; one has nothing to agree with"
        )
    seed = campaign.seed if seed is None else seed
    plan(campaign)  # refuses a bad campaign before a folder appears
    directory = None if run_dir is None else RunDirectory(run_dir)
    began = time.monotonic()
    rows: list[tuple[StageResult, ...]] = []
    interrupted = False
    try:
        for number in range(starts):
            own = started(campaign, start_values(campaign, seed, number), seed=_stream(seed, number))
            order = StageOrder(
                own,
                plan(own),
                None if directory is None else directory.part(f"start {number + 1}"),
                progress=None if progress is None else _whole(progress, number, starts, began),
                resume=resume,
                threads=threads,
            )
            found = order.stages()
            if order.stop.is_set():
                raise KeyboardInterrupt
            rows.append(found)
    except KeyboardInterrupt:
        interrupted = True
    return _gathered(campaign, rows, seed, sigma or {}, interrupted, directory)


def start_values(campaign: Campaign, seed: int, number: int) -> dict[str, dict[str, float]]:
    """Start values by stage and parameter, SI, of one random start: uniform inside the bounds."""
    found = {}
    for stage in campaign.stages:
        generator = np.random.default_rng([seed, number, zlib.crc32(stage.name.encode())])
        found[stage.name] = {
            p.name: float(generator.uniform(p.lower, p.upper)) for p in campaign.parameters[stage.name]
        }
    return found


def _stream(seed: int, number: int) -> int:
    """Seed of the search from one start."""
    return int(np.random.SeedSequence([seed, number]).generate_state(1)[0])


def _whole(
    progress: Callable[[Progress], None], number: int, starts: int, began: float
) -> Callable[[Progress], None]:
    """What one start reports, as progress of all of them."""

    def show(state: Progress) -> None:
        elapsed = time.monotonic() - began
        fraction = (number + state.fraction) / starts
        progress(
            replace(
                state,
                stage=f"start {number + 1} of {starts}, {state.stage}",
                fraction=fraction,
                elapsed_s=elapsed,
                left_s=elapsed * (1.0 - fraction) / max(fraction, 1e-6),
            )
        )

    return show


def _gathered(
    campaign: Campaign,
    rows: list[tuple[StageResult, ...]],
    seed: int,
    sigma: Mapping[str, float],
    interrupted: bool,
    directory: RunDirectory | None,
) -> Restarts:
    """Ends by stage, written where they are wanted."""
    stages = tuple(
        StageRestarts.of([row[index] for row in rows], campaign.parameters[stage.name], sigma)
        for index, stage in enumerate(campaign.stages)
        if rows
    )
    found = Restarts(campaign.name, stages, seed, interrupted)
    if directory is not None and rows and not interrupted:
        found.publish(directory, text=campaign.text)
    return found
