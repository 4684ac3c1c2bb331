"""`rare`: failures that are too rare to be met by flying drawn missions, found by subset simulation.

Everything that is drawn of a mission is a coordinate (`seatrial.verification.mission_space`). The level
function is a requirement's robustness (`seatrial.verification.robustness`); the probability is that of the
distributions of ``[verification]``, and no surer than these.

Tests: ``tests/verification/test_rare.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.chunks import Chunk, Format, Shared, run_chunks
from seatrial.base.errors import CampaignError
from seatrial.base.fleet import fleet_of, threads_of
from seatrial.base.progress import Clock, Progress, callers_errors_pass
from seatrial.base.run import RunDirectory, run_facts, sha256
from seatrial.statistics.draws import generator
from seatrial.statistics.subset_simulation import Population, importance, population, rare_event
from seatrial.verification.campaign import verified_campaign
from seatrial.verification.mission_space import MissionSpace
from seatrial.verification.rare_result import SIZE, RareFailures, RareRequirement
from seatrial.verification.requirement import named
from seatrial.verification.robustness import robustness, unusable
from seatrial.verification.verification import input_files

if TYPE_CHECKING:
    from pathlib import Path

    from seatrial._core import Autopilot, Vehicle
    from seatrial.base.fleet import Fleet, Workers
    from seatrial.campaign.campaign import Campaign
    from seatrial.flight.mission import Mission
    from seatrial.identification.fitted import Fitted
    from seatrial.identification.identification import Identification
    from seatrial.tuning.result import Tuning
    from seatrial.verification.campaign import VerifiedCampaign
    from seatrial.verification.missions import CampaignFlights
    from seatrial.verification.requirement import Requirement

_POPULATIONS, _CHECKED = 4, 1000

_CAUSE = 5  # stream of these random numbers; 1 to 4 are those of the draws

_BATCH = 512


@callers_errors_pass
def rare_failures(
    campaign: Campaign,
    fit: Identification | Fitted | Vehicle | str | Path | None = None,
    gains: Tuning | Autopilot | str | Path | None = None,
    *,
    requirements: Sequence[str] = (),
    model: Vehicle | str | Path | None = None,
    missions: Sequence[Mission | str | Path] | None = None,
    population: int = SIZE,
    populations: int = _POPULATIONS,
    checked: int = _CHECKED,
    run_dir: str | Path | None = None,
    progress: Callable[[Progress], None] | None = None,
    resume: bool = True,
    threads: int | None = None,
    executor: Workers | None = None,
) -> RareFailures:
    """How rarely an autopilot fails its requirements, 1e-4 and below, from some ten thousand missions.

    Parameters
    ----------
    campaign, fit, gains, model, missions
        As of `seatrial.verify`.
    requirements : sequence of str
        Names of the campaign's requirements; all when empty.
    population : int
        Missions of a level, a multiple of ten from 100 on.
    populations : int
        Independent repetitions, two at least: their scatter is in the interval.
    checked : int
        Missions of the check by importance sampling; none with 0.
    run_dir : str or Path, optional
        Folder for the results. Finished populations are kept in it.
    progress : callable, optional
        Called after every level.
    resume : bool
        Reuse the populations that an earlier run in this folder finished from the same inputs.
    threads : int, optional
        Threads of the core; the result does not depend on it.
    executor : Executor or str, optional
        Where populations are flown, as of `seatrial.verify`: as many at a time as it has workers.

    Raises
    ------
    CampaignError
        As of `seatrial.verify`; an unknown requirement, or a size or number that cannot be.
    SeatrialError
        The run directory cannot be written.
    """
    prepared = verified_campaign(campaign, fit, gains, model=model, missions=missions)
    return run_rare(
        prepared,
        names=requirements,
        size=population,
        populations=populations,
        checked=checked,
        run_dir=run_dir,
        progress=progress,
        resume=resume,
        threads=threads,
        executor=executor,
    )


def run_rare(
    prepared: VerifiedCampaign,
    *,
    names: Sequence[str] = (),
    size: int = SIZE,
    populations: int = _POPULATIONS,
    checked: int = _CHECKED,
    run_dir: str | Path | None = None,
    progress: Callable[[Progress], None] | None = None,
    resume: bool = True,
    threads: int | None = None,
    executor: Workers | None = None,
) -> RareFailures:
    """Rare failures of a campaign that is ready to fly. See `rare_failures` for the parameters."""
    if size < 100 or size % 10:
        raise CampaignError(f"population: expected a multiple of ten from 100 on, found {size}")
    if populations < 2:
        raise CampaignError(f"populations: expected at least 2, found {populations}")
    known = {one.name: one for one in prepared.requirements}
    chosen = named(names or list(known), known)
    clock, found, interrupted = Clock(), [], False
    threads = threads_of(threads, executor)
    with RunDirectory(run_dir, "rare failures", resume=resume) as run, fleet_of(executor) as fleet:
        try:
            for place, requirement in enumerate(chosen):
                work = _Search(prepared, requirement, size, populations, checked, run, threads, fleet)
                found.append(work.run(_watch(progress, clock, requirement.name, place, len(chosen))))
        except KeyboardInterrupt:
            interrupted = True
        result = RareFailures(
            prepared=prepared,
            requirements=tuple(found),
            interrupted=interrupted,
            facts=run_facts(
                "rare failures",
                prepared.campaign.name,
                clock=clock,
                inputs=prepared.campaign.input_hashes(trials=False)
                | {
                    name: sha256(text)
                    for name, text in input_files(prepared.campaign, prepared.flights).items()
                },
                seed=prepared.flights.seed,
                options={"population": size, "populations": populations, "checked": checked},
                interrupted=interrupted,
            ),
        )
        if run_dir is not None and not interrupted:
            run.publish(result.facts, result.files())
    return result


@dataclass(frozen=True, eq=False)
class _Search:
    """The search for failures of one requirement."""

    prepared: VerifiedCampaign
    requirement: Requirement
    size: int
    populations: int
    checked: int
    run_directory: RunDirectory
    threads: int | None
    fleet: Fleet | None

    def run(self, watch: Callable[[float, str, int], None]) -> RareRequirement:
        flights, space = self.prepared.flights, MissionSpace(self.prepared.flights)
        first = flights.fly(np.arange(min(self.size, _BATCH)), threads=self.threads)
        if why := unusable(self.requirement, robustness(self.requirement, first, flights)):
            return RareRequirement(self.requirement, None, why)

        def level(x: Array, seeds: Array) -> Array:
            return space.robustness(self.requirement, x, seeds, threads=self.threads)

        parts = self._parts(watch)
        samples = np.vstack([one.samples for one in parts])
        seeds = np.concatenate([one.seeds for one in parts])
        check = None
        if self.checked and len(samples):
            own = generator(flights.seed, self.populations, cause=_CAUSE)
            check = importance(level, samples, self.checked, own, possible=space.possible)
        confidence = flights.table.confidence
        event = rare_event(tuple(parts), check, confidence=confidence)
        if event.stood_still:
            why = (
                f'"{self.requirement.name}" has no usable robustness: half of a level\'s missions share one'
                f" value; {self.requirement.holds} needs a number that falls on the way to a failure"
            )
            return RareRequirement(self.requirement, None, why)
        if not len(samples):
            return RareRequirement(self.requirement, event)
        # Of all that fail the nearest to the middle of the draws has the greatest density.
        nearest_one = int((samples**2).sum(axis=1).argmin())
        drawn_case = space.draws(samples[[nearest_one]], seeds[[nearest_one]])
        failing = space.draws(samples, seeds).causes
        drawn = generator(flights.seed, self.populations + 1, cause=_CAUSE)
        usual = space.draws(drawn.standard_normal((2 * _BATCH, space.dimensions)), drawn.random(2 * _BATCH))
        common = {
            name: (
                float(values.mean()),
                float(usual.causes[name].mean()),
                float((values.mean() - usual.causes[name].mean()) / usual.causes[name].std()),
            )
            for name, values in failing.items()
            if usual.causes[name].std() > 0.0
        }
        return RareRequirement(
            self.requirement,
            event,
            likeliest={name: float(values[0]) for name, values in drawn_case.causes.items()},
            nearest_deviations=float(np.sqrt((samples[nearest_one] ** 2).sum())),
            common=dict(sorted(common.items(), key=lambda item: -abs(item[1][2]))),
            sample=tuple(samples[nearest_one].tolist()),
            seed=float(seeds[nearest_one]),
        )

    def _parts(self, watch: Callable[[float, str, int], None]) -> list[Population]:
        """All populations, wherever they are flown."""
        flights = self.prepared.flights
        shared = Shared((flights, self.requirement, self.size))
        chunks = (
            Chunk(
                f"{self.requirement.name}, population {number} of {self.size}",
                sha256(flights.digest + self.requirement.holds),
                rare_population,
                shared,
                (number, self.threads),
            )
            for number in range(self.populations)
        )

        def here(chunk: Chunk[Population]) -> Population:
            """A population in this process, which tells how far it is."""
            number = chunk.arguments[0]

            def passed(levels: int, threshold: float) -> None:
                share = (number + levels / (levels + 2.0)) / (self.populations + 1)
                watch(share, f"level {levels}, robustness {threshold:.3g}", number + 1)

            return rare_population(shared.value, number, self.threads, passed)

        parts = []
        for done in run_chunks(chunks, self.run_directory, _FORMAT, fleet=self.fleet, here=here):
            parts.append(done.value)
            watch(len(parts) / (self.populations + 1), "flown", len(parts))
        return parts


def rare_population(
    shared: tuple[CampaignFlights, Requirement, int],
    number: int,
    threads: int | None,
    passed: Callable[[int, float], None] | None = None,
) -> Population:
    """A population of the search for failures: a chunk of it.

    Parameters
    ----------
    shared : tuple
        What is flown, the requirement, and the missions of a level.
    number : int
        Of the population.
    threads : int or None
    passed : callable, optional
        As ``watch`` of `seatrial.statistics.subset_simulation.population`.
    """
    flights, requirement, size = shared
    space = MissionSpace(flights)
    return population(
        lambda x, seeds: space.robustness(requirement, x, seeds, threads=threads),
        space.dimensions,
        size,
        generator(flights.seed, number, cause=_CAUSE),
        possible=space.possible,
        watch=passed,
    )


def _packed(found: Population) -> dict[str, Any]:
    told = {one.name: getattr(found, one.name) for one in fields(found)}
    return told | {
        "samples": found.samples.tolist(),
        "seeds": found.seeds.tolist(),
        "dimensions": found.samples.shape[1],
    }


def _unpacked(kept: Mapping[str, Any]) -> Population:
    values = {one.name: kept[one.name] for one in fields(Population)}
    if values["relative_variance"] is None:  # JSON has no infinite numbers
        values["relative_variance"] = math.inf
    samples = np.array(kept["samples"], float).reshape(-1, kept["dimensions"])
    seeds, thresholds = np.array(kept["seeds"], float), tuple(kept["thresholds"])
    return Population(**values | {"thresholds": thresholds, "samples": samples, "seeds": seeds})


_FORMAT: Format[Population] = Format(pack=_packed, unpack=_unpacked)


def _watch(
    progress: Callable[[Progress], None] | None, clock: Clock, name: str, place: int, count: int
) -> Callable[[float, str, int], None]:
    """What a search reports, as progress of the whole."""

    def watch(share: float, detail: str, number: int) -> None:
        if progress is None:
            return
        fraction = (place + share) / count
        progress(
            Progress(
                what=name,
                done=place,
                total=count,
                fraction=fraction,
                elapsed_s=clock.elapsed_s,
                left_s=clock.elapsed_s * (1.0 - fraction) / max(fraction, 1e-6),
                detail=f"population {number}, {detail}",
            )
        )

    return watch
