"""Coverage: how often intervals hold the truth, over many repetitions of generated trials.

A 95 % interval is a promise about repetitions: sail the same trials again, with other noise and other
biases of the sensors, and 95 of 100 intervals hold the right value. For recordings nobody can check it;
for generated trials (`seatrial.generated`) the right value is known. The start values and the bounds are
the campaign's: nothing of the truth enters the estimate.

A coefficient that is called identifiable passes when 44 of 50 intervals hold its truth: fewer would be
bad luck in one case of eighty (binomial distribution, other numbers of repetitions alike). A coefficient
that is called not identifiable is held at a value a quarter of its bounds' width away while all others
are estimated again: the data must not contradict it. Where the truth lies outside the model class there
is no right value to hold; such a campaign is judged by its hold-out, and by whether the model criticism
warns.

Tested by ``tests/test_coverage.py``.
"""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seatrial.coverage.coverage_result import Coverage, CoverageRow, rows
from seatrial.coverage.repetition import Draw, Held, draw, hold
from seatrial.coverage.resailing import Resailing
from seatrial.errors import CampaignError
from seatrial.joint import Joint
from seatrial.run_directory import RUN_FILE, RunDirectory, to_json

if TYPE_CHECKING:
    from seatrial.campaign import Campaign
    from seatrial.generated import Truth

__all__ = ["Coverage", "CoverageProgress", "CoverageRow", "coverage"]


@dataclass(frozen=True)
class CoverageProgress:
    """State of a coverage run: repetitions done and asked for, what runs, time so far and left in s."""

    done: int
    asked: int
    phase: str
    elapsed_s: float
    left_s: float


def coverage(
    campaign: Campaign,
    *,
    seeds: int = 50,
    first: int = 1,
    truth: Truth | None = None,
    criticised: int = 5,
    run_dir: str | Path | None = None,
    progress: Callable[[CoverageProgress], None] | None = None,
    resume: bool = True,
    threads: int | None = None,
) -> Coverage:
    """Coverage of a campaign of generated trials.

    Parameters
    ----------
    campaign : Campaign
        Its ``[polish]`` says what is estimated jointly.
    seeds : int
        Repetitions.
    first : int
        Seed of the first one; the others count on.
    truth : Truth, optional
        Sails the trials instead of the recipes' own.
    criticised : int
        Repetitions in which the model criticism is asked as well.
    run_dir : str or Path, optional
        Folder for the results. Finished repetitions are kept beside it while the run goes on.
    progress : callable, optional
        Called after every repetition and every round of a polish.
    resume : bool
        Reuse the repetitions that an earlier run in this folder finished from the same inputs.
    threads : int, optional
        Threads of the core; by default all. The result does not depend on it.

    Returns
    -------
    Coverage
        After Ctrl-C: that of the repetitions that are done, marked as interrupted.

    Raises
    ------
    CampaignError, TrialError, VehicleError
        A trial is a recording, or the campaign asks for what cannot be done.
    SeatrialError
        The run directory cannot be written.
    """
    if seeds < 1:
        raise CampaignError(f"coverage: expected at least one repetition, found seeds = {seeds}")
    resailing = Resailing(campaign, truth=truth)
    work = _Run(
        resailing, seeds, None if run_dir is None else RunDirectory(run_dir), progress, resume, threads
    )
    draws: list[Draw] = []
    held: tuple[Held, ...] = ()
    outside: dict[str, tuple[float, float]] = {}
    interrupted = False
    try:
        outside = resailing.outside(Joint(resailing.sail(first), threads=threads))
        for seed in range(first, first + seeds):
            draws.append(work.draw(seed, criticised=seed < first + criticised))
        if not outside:
            held = work.held(first, [row.name for row in rows(draws) if _doubted(row)])
    except KeyboardInterrupt:
        interrupted = True
    found = Coverage(
        campaign=campaign.name,
        truth=resailing.truth.description,
        rows=rows(draws),
        held=held,
        outside=outside,
        draws=tuple(draws),
        asked=seeds,
        interrupted=interrupted,
    )
    if work.directory is not None and not interrupted:
        facts = {"coverage": campaign.name, "inputs": work.inputs, "seeds": [first, first + seeds - 1]}
        work.directory.publish({"coverage.json": to_json(found.to_dict()), RUN_FILE: to_json(facts)})
    return found


def _doubted(row: CoverageRow) -> bool:
    return row.verdict == "not identifiable"


class _Run:
    """Workspace of a coverage run: what is kept, what time is left."""

    def __init__(
        self,
        resailing: Resailing,
        asked: int,
        directory: RunDirectory | None,
        progress: Callable[[CoverageProgress], None] | None,
        resume: bool,
        threads: int | None,
    ) -> None:
        self.resailing, self.asked, self.directory = resailing, asked, directory
        self.progress, self.resume, self.threads = progress, resume, threads
        self.inputs = _inputs(resailing)
        self.began = time.monotonic()
        self.done, self.sailed, self.spent = 0, 0, 0.0

    def draw(self, seed: int, *, criticised: bool) -> Draw:
        """A repetition, or what an earlier run kept of it."""
        name = f"seed-{seed}"
        kept = self._kept(name)
        if kept is not None and not (criticised and kept["criticism"] is None):
            found = Draw.from_dict(kept)
        else:
            found = draw(
                self.resailing,
                seed,
                criticised=criticised,
                threads=self.threads,
                watch=lambda _: self._show(name),
            )
            self.sailed += 1
            self.spent += found.wall_s
        self._keep(name, found.to_dict())
        self.done += 1
        self._show(name)
        return found

    def held(self, seed: int, names: Sequence[str]) -> tuple[Held, ...]:
        """Coefficients at wrong values."""
        if not names:
            return ()
        self._show(f"holding {', '.join(names)}")
        name = f"held-{'-'.join(names)}-seed-{seed}"
        kept = self._kept(name)
        if kept is not None:
            found = tuple(Held.from_dict(entry) for entry in kept["held"])
        else:
            found = hold(self.resailing, seed, names, threads=self.threads)
        self._keep(name, {"held": [one.to_dict() for one in found]})
        return found

    def _kept(self, name: str) -> dict[str, Any] | None:
        if self.directory is None or not self.resume:
            return None
        return self.directory.finished(name, self.inputs)

    def _keep(self, name: str, result: dict[str, Any]) -> None:
        if self.directory is not None:
            self.directory.keep(name, result | {"inputs": self.inputs})

    def _show(self, phase: str) -> None:
        if self.progress is None:
            return
        elapsed = time.monotonic() - self.began
        each = self.spent / self.sailed if self.sailed else math.nan
        self.progress(
            CoverageProgress(self.done, self.asked, phase, elapsed, each * (self.asked - self.done))
        )


def _inputs(resailing: Resailing) -> str:
    """SHA-256 of everything that a repetition depends on besides its seed."""
    campaign = resailing.campaign
    described = {
        "version": metadata.version("seatrial"),
        "campaign": campaign.text,
        "vehicle": campaign.vehicle.to_toml(),
        "truth": resailing.truth.vehicle.to_toml(),
        "sensors": {kind: asdict(sensor) for kind, sensor in resailing.truth.sensors.items()},
        "recipes": {name: campaign.file_hash(name) for name in resailing.recipes},
    }
    return hashlib.sha256(to_json(described).encode()).hexdigest()
