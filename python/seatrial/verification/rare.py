"""`Rare`: failures that are too rare to be met by flying drawn missions, found by subset simulation.

Everything that is drawn of a mission is a coordinate (`seatrial.verification.chosen_missions`). The level
function is a requirement's robustness (`seatrial.verification.judgement`); the probability is that of the
distributions of ``[verification]``, and no surer than these.

`RareFailures` holds what the failures of a requirement have in common, too. Tests:
``tests/verification/test_rare.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.chunks import Chunk, Format, Shared, run_chunks
from seatrial.base.errors import CampaignError
from seatrial.base.finding import Finding, Severity
from seatrial.base.fleet import fleet_of, threads_of
from seatrial.base.plain import Plain
from seatrial.base.run import RunDirectory, RunResult, sha256, to_json
from seatrial.base.work import HERE, Clock, Work
from seatrial.identification.fitted import generator
from seatrial.statistics.subset_simulation import Population, RareEvent, importance, population, rare_event
from seatrial.verification.chosen_missions import MissionSpace, searched
from seatrial.verification.judgement import robustness, unusable
from seatrial.verification.requirement import named

if TYPE_CHECKING:
    from seatrial.base.fleet import Fleet
    from seatrial.verification.missions import CampaignFlights
    from seatrial.verification.requirement import Requirement
    from seatrial.verification.scenario import Scenario


_KIND: Final = "rare failures"  # of the run


@dataclass(frozen=True)
class RareSettings:
    """How many missions subset simulation flies, and which random numbers it takes."""

    population: int = 500  #: Missions of a level.
    populations: int = 4  #: Independent populations, from whose scatter the interval comes too.
    checked: int = 1000  #: Missions of the importance sampling that checks the estimate.
    stream: int = 5  #: Stream of these random numbers; 1 to 4 are those of the draws.
    batch: int = 512  #: Missions in memory at once.


SETTINGS = RareSettings()


@dataclass(frozen=True, eq=False)
class RareRequirement(
    Plain,
    only="name=requirement.name holds=requirement.holds allowed=requirement.allowed verdict event why_not"
    " likeliest nearest_deviations common sample seed",
):
    """How rarely a requirement fails.

    `event`: probability, interval, missions spent; None where the robustness cannot be used. `why_not`: why
    it cannot. `likeliest`: what was drawn in the failing mission that is nearest to the middle of all draws,
    by readable names. `nearest_deviations`: how far that is, in standard deviations. `common`: what the
    failing missions have in common, by readable names, the most telling first: their mean, that of all draws,
    and by how many of its standard deviations it is shifted. `sample`, `seed`: its standard normal numbers
    (d,) and the seed of its noise, with which it is flown again.
    """

    requirement: Requirement
    event: RareEvent | None
    why_not: Finding | None = None
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


@dataclass(frozen=True, eq=False, repr=False)
class RareFailures(
    RunResult,
    Plain,
    only="campaign=scenario.name held interrupted warnings=scenario.flights.warnings requirements",
):
    """Failure probabilities of rare events; made by `st.Rare`.

    `scenario`: what was flown. `requirements`: a `RareRequirement` each. `interrupted`: whether Ctrl-C ended
    it early: requirements that were not finished are missing. `facts`: what the result rests on.
    """

    scenario: Scenario
    requirements: tuple[RareRequirement, ...]
    interrupted: bool
    facts: Mapping[str, Any] = field(default_factory=dict)

    @property
    def outcome(self) -> str:
        """The worst verdict: failed, not judged, undecided or held."""
        verdicts = {requirement.verdict for requirement in self.requirements}
        return next((v for v in ("failed", "not judged", "undecided") if v in verdicts), "held")

    @property
    def held(self) -> bool:
        """Whether all requirements are held."""
        return not self.interrupted and self.outcome == "held"

    def replay(self, name: str) -> Any:
        """Flight of the likeliest failing mission of a requirement, with its log.

        `name`: of the requirement. Raises CampaignError: there is no such requirement, or it did not fail.
        """
        [worst] = named([name], {entry.requirement.name: entry for entry in self.requirements})
        if not worst.sample:
            raise CampaignError(f'requirement "{name}": no mission failed, there is none to fly again')
        space = MissionSpace(self.scenario.flights)
        drawn = space.draws(np.array([worst.sample]), np.array([worst.seed]))
        return self.scenario.flights.replay_drawn(drawn)

    def files(self) -> dict[str, str | bytes]:
        """Files of the run directory by name, see `save`."""
        return {**self.scenario.files(), "rare.json": to_json(self.to_dict()), **self.report().files()}


@dataclass(frozen=True, kw_only=True)
class Rare:
    """Strategy of `seatrial.verify`: how rarely requirements fail, 1e-4 and below, by subset simulation.

    Some ten thousand missions. A run directory keeps finished populations; an executor flies as many of them
    at a time as it has workers.

    Attributes
    ----------
    requirements : sequence of str
        Names of the scenario's requirements; all when empty.
    population : int
        Missions of a level, a multiple of ten from 100 on.
    populations : int
        Independent repetitions, two at least: their scatter is in the interval.
    checked : int
        Missions of the check by importance sampling; none with 0.

    Raises
    ------
    CampaignError
        A size or number that cannot be; of `survey` an unknown requirement.

    Examples
    --------
    >>> import seatrial as st
    >>> st.Rare(population=200).populations
    4
    """

    requirements: Sequence[str] = ()
    population: int = SETTINGS.population
    populations: int = SETTINGS.populations
    checked: int = SETTINGS.checked

    def __post_init__(self) -> None:
        if self.population < 100 or self.population % 10:
            raise CampaignError(
                f"population: expected a multiple of ten from 100 on, found {self.population}"
            )
        if self.populations < 2:
            raise CampaignError(f"populations: expected at least 2, found {self.populations}")

    def survey(self, scenario: Scenario, work: Work = HERE) -> RareFailures:
        """Failure probabilities of a scenario; see `seatrial.verify` for errors.

        `scenario`: what is flown. `work`: threads, folder of the results and progress.
        """
        chosen = scenario.chosen(self.requirements)
        clock, threads = Clock(), threads_of(work.threads, work.executor)
        options = {name: getattr(self, name) for name in ("population", "populations", "checked")}
        with RunDirectory(work.run_dir, _KIND, resume=work.resume) as run, fleet_of(work.executor) as fleet:
            judged, interrupted = searched(
                chosen,
                lambda asked, watch: _Search(scenario, asked, self, run, threads, fleet).run(watch),
                work.progress,
            )
            facts = scenario.facts(_KIND, clock=clock, options=options, interrupted=interrupted)
            result = RareFailures(scenario, judged, interrupted, facts)
            if work.run_dir is not None and not interrupted:
                run.publish(result.facts, result.files())
        return result


@dataclass(frozen=True, eq=False)
class _Search:
    """The search for failures of one requirement."""

    scenario: Scenario
    requirement: Requirement
    asked: Rare
    run_directory: RunDirectory
    threads: int | None
    fleet: Fleet | None

    def run(self, watch: Callable[[float, str], None]) -> RareRequirement:
        flights, space = self.scenario.flights, MissionSpace(self.scenario.flights)
        first = flights.fly(np.arange(min(self.asked.population, SETTINGS.batch)), threads=self.threads)
        if why := unusable(self.requirement, robustness(self.requirement, first, flights)):
            return RareRequirement(self.requirement, None, why)

        def level(x: Array, seeds: Array) -> Array:
            return space.robustness(self.requirement, x, seeds, threads=self.threads)

        parts = self._parts(watch)
        samples = np.vstack([part.samples for part in parts])
        seeds = np.concatenate([part.seeds for part in parts])
        check = None
        if self.asked.checked and len(samples):
            own = generator(flights.seed, self.asked.populations, cause=SETTINGS.stream)
            check = importance(level, samples, self.asked.checked, own, possible=space.possible)
        confidence = flights.table.confidence
        event = rare_event(tuple(parts), check, confidence=confidence)
        if event.stood_still:
            values = {"holds": self.requirement.holds}
            why = Finding("values shared", Severity.PROBLEM, self.requirement.name, values)
            return RareRequirement(self.requirement, None, why)
        if not len(samples):
            return RareRequirement(self.requirement, event)
        # Of all that fail the nearest to the middle of the draws has the greatest density.
        nearest_one = int((samples**2).sum(axis=1).argmin())
        drawn_case = space.draws(samples[[nearest_one]], seeds[[nearest_one]])
        failing = space.draws(samples, seeds).causes
        drawn = generator(flights.seed, self.asked.populations + 1, cause=SETTINGS.stream)
        usual = space.draws(
            drawn.standard_normal((2 * SETTINGS.batch, space.dimensions)), drawn.random(2 * SETTINGS.batch)
        )
        common = {}
        for name, column in failing.items():
            mean, middle, sd = column.mean(), usual.causes[name].mean(), usual.causes[name].std()
            if sd > 0.0:
                common[name] = float(mean), float(middle), float((mean - middle) / sd)
        return RareRequirement(
            self.requirement,
            event,
            likeliest={name: float(values[0]) for name, values in drawn_case.causes.items()},
            nearest_deviations=float(np.sqrt((samples[nearest_one] ** 2).sum())),
            common=dict(sorted(common.items(), key=lambda item: -abs(item[1][2]))),
            sample=tuple(samples[nearest_one].tolist()),
            seed=float(seeds[nearest_one]),
        )

    def _parts(self, watch: Callable[[float, str], None]) -> list[Population]:
        """All populations, wherever they are flown."""
        flights = self.scenario.flights
        shared = Shared((flights, self.requirement, self.asked.population))
        chunks = (
            Chunk(
                f"{self.requirement.name}, population {number} of {self.asked.population}",
                sha256(flights.digest + self.requirement.holds),
                rare_population,
                shared,
                (number, self.threads),
            )
            for number in range(self.asked.populations)
        )

        def here(chunk: Chunk[Population]) -> Population:
            """A population in this process, which tells how far it is."""
            number = chunk.arguments[0]

            def passed(levels: int, threshold: float) -> None:
                share = (number + levels / (levels + 2.0)) / (self.asked.populations + 1)
                watch(share, f"population {number + 1}, level {levels}, robustness {threshold:.3g}")

            return rare_population(shared.value, number, self.threads, passed)

        parts = []
        for done in run_chunks(chunks, self.run_directory, _FORMAT, fleet=self.fleet, here=here):
            parts.append(done.value)
            watch(len(parts) / (self.asked.populations + 1), f"population {len(parts)}, flown")
        return parts


def rare_population(
    shared: tuple[CampaignFlights, Requirement, int],
    number: int,
    threads: int | None,
    passed: Callable[[int, float], None] | None = None,
) -> Population:
    """A population of the search for failures: a chunk of it.

    `shared`: what is flown, the requirement, and the missions of a level. `passed` is the ``watch`` of
    `seatrial.statistics.subset_simulation.population`.
    """
    flights, requirement, size = shared
    space = MissionSpace(flights)
    return population(
        lambda x, seeds: space.robustness(requirement, x, seeds, threads=threads),
        space.dimensions,
        size,
        generator(flights.seed, number, cause=SETTINGS.stream),
        possible=space.possible,
        watch=passed,
    )


def _packed(population: Population) -> dict[str, Any]:
    values = {key.name: getattr(population, key.name) for key in fields(population)}
    return values | {
        "samples": population.samples.tolist(),
        "seeds": population.seeds.tolist(),
        "dimensions": population.samples.shape[1],
    }


def _unpacked(kept: Mapping[str, Any]) -> Population:
    values = {key.name: kept[key.name] for key in fields(Population)}
    if values["relative_variance"] is None:  # JSON has no infinite numbers
        values["relative_variance"] = math.inf
    samples = np.array(kept["samples"], float).reshape(-1, kept["dimensions"])
    seeds, thresholds = np.array(kept["seeds"], float), tuple(kept["thresholds"])
    return Population(**values | {"thresholds": thresholds, "samples": samples, "seeds": seeds})


_FORMAT: Format[Population] = Format(pack=_packed, unpack=_unpacked)
