"""Coverage: how often intervals hold the truth, over many repetitions of generated trials.

A 95 % interval is a promise about repetitions: run the same trials again, with other noise and other biases
of the sensors, and 95 of 100 intervals hold the true value. Recordings cannot check it; of generated trials
(`seatrial.trial.generated`) the true value is known. Start values and bounds are the campaign's: nothing of
the truth enters the estimate.

A coefficient that is called identifiable passes when 44 of 50 intervals hold its truth: fewer would be bad
luck in one case of eighty (binomial distribution, other numbers of repetitions alike). A coefficient that is
called not identifiable is held at a value a quarter of its bounds' width away while all others are estimated
again: the data must not contradict it. Where the truth lies outside the model class there is no true value to
hold; such a campaign is judged by its hold-out, and by whether the residual analysis warns.

Held by ``tests/experiment/test_coverage.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seatrial._core import checked_threads
from seatrial.base.chunks import RECORDS, Chunk, Format, Shared, run_chunks
from seatrial.base.errors import CampaignError
from seatrial.base.fleet import fleet_of, threads_of
from seatrial.base.progress import Clock, Progress, callers_errors_pass
from seatrial.base.run import RunDirectory, run_facts, sha256, to_json, version
from seatrial.estimation.joint import Joint
from seatrial.experiment.coverage_result import Coverage, CoverageRow, rows
from seatrial.experiment.generated_trials import GeneratedTrials
from seatrial.experiment.repetition import Held, Repetition, hold_at_wrong_values, run_repetition

if TYPE_CHECKING:
    from seatrial.base.fleet import Fleet, Workers
    from seatrial.campaign.campaign import Campaign
    from seatrial.trial.truth import Truth


@callers_errors_pass
def coverage(
    campaign: Campaign,
    *,
    seeds: int = 50,
    first: int = 1,
    truth: Truth | None = None,
    analysed: int = 5,
    run_dir: str | Path | None = None,
    progress: Callable[[Progress], None] | None = None,
    resume: bool = True,
    threads: int | None = None,
    executor: Workers | None = None,
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
        Simulates the trials instead of the recipes' own.
    analysed : int
        Repetitions that also run the residual analysis.
    run_dir : str or Path, optional
        Folder for the results. Finished repetitions are kept beside it while the run goes on.
    progress : callable, optional
        Called after every repetition and every round of a polish.
    resume : bool
        Reuse the repetitions that an earlier run in this folder finished from the same inputs.
    threads : int, optional
        Threads of the core; by default all, with an executor one per worker. The result does not depend on
        it.
    executor : Executor, str or distributed.Client, optional
        Where repetitions are estimated; see `seatrial.verify`.

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
    checked_threads(threads)
    if seeds < 1:
        raise CampaignError(f"coverage: expected at least one repetition, found seeds = {seeds}")
    generated = GeneratedTrials(campaign, truth=truth)
    clock = Clock()
    repetitions: list[Repetition] = []
    held: tuple[Held, ...] = ()
    outside: dict[str, tuple[float, float]] = {}
    interrupted = False
    threads = threads_of(threads, executor)
    with RunDirectory(run_dir, "coverage", resume=resume) as run, fleet_of(executor) as fleet:
        work = _Repetitions(generated, seeds, run, clock, progress, threads, fleet)
        try:
            outside = generated.outside(Joint(generated.logged(first), threads=threads))
            for found in work.repetitions(first, analysed):
                repetitions.append(found)
            if not outside:
                held = work.held(first, [row.name for row in rows(repetitions) if _doubted(row)])
        except KeyboardInterrupt:
            interrupted = True
        result = Coverage(
            campaign=campaign.name,
            truth=generated.truth.description,
            rows=rows(repetitions),
            held=held,
            outside=outside,
            repetitions=tuple(repetitions),
            asked=seeds,
            interrupted=interrupted,
            facts=run_facts(
                "coverage",
                campaign.name,
                clock=clock,
                inputs=campaign.input_hashes() | {"truth": sha256(generated.truth.vehicle.to_toml())},
                seed=first,
                options={"repetitions": seeds, "analysed": analysed},
                interrupted=interrupted,
            ),
        )
        if run_dir is not None and not interrupted:
            run.publish(result.facts, result.files() | {RECORDS: to_json(work.records)})
    return result


def _doubted(row: CoverageRow) -> bool:
    return row.verdict == "not identifiable"


class _Repetitions:
    """Repetitions of a coverage run: run once, kept, and what time is left."""

    def __init__(
        self,
        generated: GeneratedTrials,
        asked: int,
        run: RunDirectory,
        clock: Clock,
        progress: Callable[[Progress], None] | None,
        threads: int | None,
        fleet: Fleet | None,
    ) -> None:
        self.generated, self.asked, self.run, self.clock = generated, asked, run, clock
        self.progress, self.threads, self.fleet = progress, threads, fleet
        self.inputs = _inputs(generated)
        self.done, self.fresh = 0, 0
        self.records: list[Mapping[str, Any]] = []

    def repetitions(self, first: int, analysed: int) -> Iterator[Repetition]:
        """Repetitions, or what an earlier run kept of them."""
        shared = Shared(self.generated)
        chunks = (
            Chunk(f"seed-{seed}", self.inputs, repeat, shared, (seed, seed < first + analysed, self.threads))
            for seed in range(first, first + self.asked)
        )
        for done in run_chunks(chunks, self.run, _FORMAT, fleet=self.fleet, here=self._here):
            self.records.append(done.record)
            self.fresh += 0 if done.kept else 1
            self.done += 1
            self._show(done.chunk.part)
            yield done.value

    def _here(self, chunk: Chunk[Repetition]) -> Repetition:
        """A repetition in this process, which tells that it goes on."""
        seed, analysed, threads = chunk.arguments
        return run_repetition(
            self.generated, seed, analysed=analysed, threads=threads, watch=lambda _: self._show(chunk.part)
        )

    def held(self, seed: int, names: Sequence[str]) -> tuple[Held, ...]:
        """Coefficients at wrong values."""
        if not names:
            return ()
        self._show(f"holding {', '.join(names)}")
        name = f"held-{'-'.join(names)}-seed-{seed}"
        kept = self.run.finished(name, self.inputs)
        if kept is not None:
            return tuple(Held.from_dict(entry) for entry in kept["held"])
        found = hold_at_wrong_values(self.generated, seed, names, threads=self.threads)
        self.run.keep(name, self.inputs, {"held": [one.to_dict() for one in found]})
        return found

    def _show(self, what: str) -> None:
        if self.progress is None:
            return
        self.progress(
            Progress(
                what=what,
                done=self.done,
                total=self.asked,
                fraction=self.done / self.asked,
                elapsed_s=self.clock.elapsed_s,
                left_s=self.clock.left_s(self.fresh, self.asked - self.done),
            )
        )


def repeat(generated: GeneratedTrials, seed: int, analysed: bool, threads: int | None) -> Repetition:
    """Repetition with one seed: a chunk of the work."""
    return run_repetition(generated, seed, analysed=analysed, threads=threads)


_FORMAT: Format[Repetition] = Format(
    pack=Repetition.to_dict,
    unpack=Repetition.from_dict,
    suits=lambda chunk, kept: kept.residual_analysis is not None or not chunk.arguments[1],
)


def _inputs(generated: GeneratedTrials) -> str:
    """SHA-256 of everything that a repetition depends on besides its seed."""
    campaign = generated.campaign
    described = {
        "version": version("seatrial"),
        "campaign": campaign.text,
        "vehicle": campaign.vehicle.to_toml(),
        "truth": generated.truth.vehicle.to_toml(),
        "sensors": {kind: asdict(sensor) for kind, sensor in generated.truth.sensors.items()},
        "recipes": {name: campaign.problem().file_hash(name) for name in generated.recipes},
    }
    return sha256(to_json(described))
