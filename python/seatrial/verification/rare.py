"""`rare`: failures that are too rare to be met by flying drawn missions, found by subset simulation.

Everything that is drawn of a mission is a coordinate (`seatrial.verification.mission_space`). The level
function is a requirement's robustness (`seatrial.verification.robustness`); the probability is that of the
distributions of ``[verification]``, and no surer than these.

Tests: ``tests/verification/test_rare.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.chunks import Chunk, Format, Shared, run_chunks
from seatrial.base.errors import CampaignError
from seatrial.base.fleet import fleet_of, threads_of
from seatrial.base.progress import Clock, Progress
from seatrial.base.report import Report, Section, Table
from seatrial.base.run import RunDirectory, RunResult, run_facts, sha256, to_json
from seatrial.campaign.campaign import input_hashes
from seatrial.statistics.draws import generator
from seatrial.statistics.subset_simulation import Population, RareEvent, importance, population, rare_event
from seatrial.verification.campaign import verified_campaign
from seatrial.verification.mission_space import MissionSpace
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

__all__ = ["SIZE", "RareFailures", "RareRequirement", "rare_failures", "rare_population", "run_rare"]

_POPULATIONS, _CHECKED = 4, 1000

SIZE = 500
"""Missions of a level."""

_CAUSE = 5  # stream of these random numbers; 1 to 4 are those of the draws

_BATCH = 512

_SHOWN, _SHIFTED = 5, 0.8
"""How many common causes of failures are printed, and from which shift on, in standard deviations."""


@dataclass(frozen=True, eq=False)
class RareRequirement:
    """How rarely a requirement fails.

    Attributes
    ----------
    requirement
    event
        Probability, interval, missions spent; None where the robustness cannot be used.
    why_not
        Why it cannot; empty otherwise.
    likeliest
        What was drawn in the failing mission that is nearest to the middle of all draws, by readable names.
    nearest_deviations
        How far that is, in standard deviations.
    common
        What the failing missions have in common, by readable names, the most telling first: their mean, that
        of all draws, and by how many of its standard deviations it is shifted.
    sample, seed
        Its standard normal numbers (d,) and the seed of its noise, with which it is flown again.
    """

    requirement: Requirement
    event: RareEvent | None
    why_not: str = ""
    likeliest: Mapping[str, float] = field(default_factory=dict)
    nearest_deviations: float = math.nan
    common: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    sample: tuple[float, ...] = ()
    seed: float = math.nan

    @property
    def verdict(self) -> str:
        """Held or failed where the interval lies on one side of what is allowed; undecided else."""
        if self.event is None:
            return "not judged"
        low, high = self.event.interval
        if high <= self.requirement.allowed:
            return "held"
        return "failed" if low > self.requirement.allowed else "undecided"

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "name": self.requirement.name,
            "holds": self.requirement.holds,
            "allowed": self.requirement.allowed,
            "verdict": self.verdict,
            "event": None if self.event is None else self.event.to_dict(),
            "why_not": self.why_not,
            "likeliest": dict(self.likeliest),
            "nearest_deviations": self.nearest_deviations if self.likeliest else None,
            "common": {name: list(row) for name, row in self.common.items()},
            "sample": list(self.sample),
            "seed": self.seed if self.sample else None,
        }


@dataclass(frozen=True, eq=False)
class RareFailures(RunResult):
    """Failure probabilities of rare events; made by `run_rare`.

    Attributes
    ----------
    prepared
        The campaign that was flown.
    requirements
        A `RareRequirement` each.
    interrupted
        Whether Ctrl-C ended it early: requirements that were not finished are missing.
    facts
        What the result rests on.
    """

    prepared: VerifiedCampaign
    requirements: tuple[RareRequirement, ...]
    interrupted: bool
    facts: Mapping[str, Any] = field(default_factory=dict)

    @property
    def outcome(self) -> str:
        """The worst verdict: failed, not judged, undecided or held."""
        verdicts = {one.verdict for one in self.requirements}
        return next((one for one in ("failed", "not judged", "undecided") if one in verdicts), "held")

    @property
    def held(self) -> bool:
        """Whether all requirements are held."""
        return not self.interrupted and self.outcome == "held"

    def replay(self, name: str) -> Any:
        """Flight of the likeliest failing mission of a requirement, with its log.

        Parameters
        ----------
        name : str
            Of the requirement.

        Raises
        ------
        CampaignError
            There is no such requirement, or it did not fail.
        """
        [found] = named([name], {one.requirement.name: one for one in self.requirements})
        if not found.sample:
            raise CampaignError(f'requirement "{name}": no mission failed, there is none to fly again')
        space = MissionSpace(self.prepared.flights)
        drawn = space.draws(np.array([found.sample]), np.array([found.seed]))
        return self.prepared.flights.replay_drawn(drawn)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "campaign": self.prepared.campaign.name,
            "held": self.held,
            "interrupted": self.interrupted,
            "requirements": [one.to_dict() for one in self.requirements],
        }

    def files(self) -> dict[str, str | bytes]:
        """Files of the run directory by name, see `save`."""
        return {
            **input_files(self.prepared.campaign, self.prepared.flights),
            "rare.json": to_json(self.to_dict()),
            **self.report().files(),
        }

    def summary(self) -> str:
        """The report as text."""
        return self.report().text()

    def report(self) -> Report:
        """Three lines, a table of the requirements, the likeliest failing missions."""
        judged = [one for one in self.requirements if one.event is not None]
        held = sum(one.verdict == "held" for one in self.requirements)
        spent = sum(one.event.evaluations for one in judged if one.event is not None)
        worst, next_step = _worst(self)
        return Report(
            title=self.prepared.campaign.name,
            outcome=self.outcome + (" (interrupted)" if self.interrupted else ""),
            good=(
                f"{held} of {len(self.requirements)} requirements held by"
                f" {self.prepared.flights.autopilot.name} on {self.prepared.flights.fitted.vehicle.name};"
                f" {spent} missions flown"
            ),
            worst=worst,
            next_step=next_step,
            sections=(
                Section(tables=(_table(self.requirements),)),
                *(
                    Section(f"Failures of: {one.requirement.name}", tuple(_drawn(one)))
                    for one in judged
                    if one.likeliest
                ),
                Section("Not judged", tuple(one.why_not for one in self.requirements if one.why_not)),
                Section(
                    "Notes",
                    (
                        "The probability is that of the distributions in [verification] and of the"
                        " covariance; it is no surer than these.",
                        *self.prepared.notes,
                        *self.prepared.flights.left_out,
                    ),
                    details=True,
                ),
            ),
        )


def _worst(found: RareFailures) -> tuple[str, str]:
    """The worst problem, and what to do about it."""
    again = f"seatrial verify {found.prepared.campaign.source} --rare"
    if found.interrupted:
        return "Ctrl-C ended it early", "run the same command again; finished populations are kept"
    judged = [(one, one.event) for one in found.requirements if one.event is not None]
    apart = [one for one, event in judged if event.agrees is False]
    if apart:
        return (
            f"{apart[0].requirement.name}: importance sampling about the failures disagrees: failures"
            " of another kind may be missing",
            f"fly larger populations: {again} --population {2 * SIZE}",
        )
    failing = [(one, event) for one, event in judged if one.verdict != "held" and event.estimate > 0.0]
    if failing:
        one, event = max(failing, key=lambda pair: pair[1].estimate / pair[0].requirement.allowed)
        return (
            f"{one.requirement.name} fails in {event.estimate:.2g} of the missions"
            f" ({event.interval[0]:.2g} to {event.interval[1]:.2g}); {one.requirement.allowed:.2g} may",
            "look at what its failures have in common below, then tune, or change that",
        )
    if any(one.why_not for one in found.requirements):
        one = next(one for one in found.requirements if one.why_not)
        return one.why_not.partition("; ")[0], one.why_not.partition("; ")[2]
    if not judged:
        return "no requirement was judged", "state requirements in the campaign"
    one, event = max(judged, key=lambda pair: pair[1].interval[1])
    if one.verdict != "held":
        return (
            f"{one.requirement.name}: at most {event.interval[1]:.2g} of the missions fail, more than the"
            f" {one.requirement.allowed:.2g} that are allowed",
            f"fly larger populations: {again} --population {2 * SIZE}",
        )
    return (
        f"{one.requirement.name} fails most often, in at most {event.interval[1]:.2g} of the missions",
        "ask whether the distributions in [verification] are wide enough: the figure is no surer than they",
    )


def _table(requirements: Sequence[RareRequirement]) -> Table:
    rows = []
    for one in requirements:
        event = one.event
        if event is None:
            rows.append((
                one.requirement.name,
                one.verdict,
                "",
                "",
                f"{one.requirement.allowed:.2g}",
                "",
                "",
                "",
            ))
            continue
        low, high = event.interval
        check = event.check
        rows.append((
            one.requirement.name,
            one.verdict,
            f"{event.estimate:.2g}" if event.estimate else "none found",
            f"{low:.2g} to {high:.2g}",
            f"{one.requirement.allowed:.2g}",
            "" if check is None or event.agrees is None else f"{check.estimate:.2g}",
            f"{event.evaluations}",
            f"{event.plain:.2g}" if math.isfinite(event.plain) else "",
        ))
    head = (
        "requirement",
        "verdict",
        "fails in",
        f"{100 * (requirements[0].event.confidence if requirements and requirements[0].event else 0.95):g} %",
        "allowed",
        "check",
        "missions",
        "plain sampling",
    )
    return Table.of(
        "Failure probabilities", head, rows, left=2, note="plain sampling: missions for the same interval"
    )


def _drawn(one: RareRequirement) -> list[str]:
    """What failing missions have in common, and how far out the likeliest is."""
    said = [
        f"{name}: {mean:.3g} in the mean, {usual:.3g} in all draws ({shift:+.1f} sd);"
        f" {one.likeliest[name]:.3g} in the likeliest failure"
        for name, (mean, usual, shift) in list(one.common.items())[:_SHOWN]
        if abs(shift) >= _SHIFTED
    ]
    return [
        *(said or ["nothing that is drawn stands out: noise, gusts or many small things"]),
        f"the likeliest failure lies {one.nearest_deviations:.1f} standard deviations from the middle of all"
        " draws, besides noise and gusts",
    ]


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
    with RunDirectory(run_dir, resume=resume) as run, fleet_of(executor) as fleet:
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
                inputs=input_hashes(prepared.campaign, trials=False)
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
