"""`falsify`: the worst mission in the ranges of a verification, and the least disturbance that still fails.

Plain numbers behind the draws (`seatrial.verification.chosen_missions`) are searched within so many
standard deviations by an evolution strategy (CMA-ES; Hansen 2016, arXiv:1604.00772) for the least robustness
of a requirement. What fails is then made small: one number after the other goes back to the middle as long as
the mission still fails, the one first that costs the least robustness; the rest is scaled down together. The
seed of noise and gusts stays what it is.

Tests: ``tests/verification/test_falsify.py``.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError
from seatrial.base.finding import Finding
from seatrial.base.plain import Plain
from seatrial.base.run import RunDirectory, RunResult, to_json
from seatrial.base.work import HERE, Clock, Work
from seatrial.verification.chosen_missions import MissionSpace, case_text, searched
from seatrial.verification.judgement import robustness, unusable
from seatrial.verification.requirement import named

if TYPE_CHECKING:
    from seatrial.flight.flight import Flight
    from seatrial.verification.draws import Draws
    from seatrial.verification.requirement import Requirement
    from seatrial.verification.scenario import Scenario


@dataclass(frozen=True)
class FalsifySettings:
    """Where and how long the worst mission is searched."""

    within: float = 3.0  #: Standard deviations of every draw within which is searched.
    missions: int = 2000  #: Missions in all.
    generation: int = 32  #: Missions of a generation of CMA-ES: four times the core's eight lanes.
    generations_after: int = 10  #: Generations beyond the first failure, to find what is really bad.
    seed: float = 0.5  #: Seed of noise and gusts, from 0 to 1.
    rounding: float = 1e-9  #: Largest difference of a value that is back in the middle of its range.


SETTINGS = FalsifySettings()


@dataclass(frozen=True, eq=False)
class FalsifiedRequirement(
    Plain,
    without="requirement worst",
    also="name=requirement.name holds=requirement.holds falsified worst_robustness=worst",
):
    """The worst mission that was found for a requirement.

    `worst`: least robustness that was found. `missions`: flown in the search and to make the disturbance
    small. `robustness`: of the mission below; NaN where none failed. `sample`: its numbers (d,) in standard
    deviations; zero where the middle of the range is bad enough. `disturbance`: by readable names: its value,
    that of the middle, in the units of the name; empty where the middle fails itself. `middle`: values of the
    middle by readable names. `case`: TOML of the entry ``[[verification.cases]]``; empty where none failed.
    `why_not`: why the requirement cannot be searched.
    """

    requirement: Requirement
    worst: float
    missions: int
    robustness: float = float("nan")
    sample: tuple[float, ...] = ()
    disturbance: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    middle: Mapping[str, float] = field(default_factory=dict)
    case: str = ""
    why_not: Finding | None = None

    @property
    def falsified(self) -> bool:
        """Whether a failing mission was found."""
        return bool(self.sample)


@dataclass(frozen=True, eq=False, repr=False)
class Falsification(
    RunResult,
    Plain,
    only="campaign=scenario.name within interrupted warnings=scenario.flights.warnings requirements",
):
    """Worst missions of requirements; made by `falsify`.

    `scenario`: what was flown. `requirements`: a `FalsifiedRequirement` each. `within`: standard deviations
    within which was searched. `interrupted`: whether Ctrl-C ended it early. `facts`: what the result rests
    on.
    """

    scenario: Scenario
    requirements: tuple[FalsifiedRequirement, ...]
    within: float
    interrupted: bool
    facts: Mapping[str, Any] = field(default_factory=dict)

    @property
    def falsified(self) -> tuple[FalsifiedRequirement, ...]:
        """Requirements that a mission was found to fail."""
        return tuple(requirement for requirement in self.requirements if requirement.falsified)

    def drawn(self, name: str) -> Draws:
        """The failing mission of a requirement, with the least disturbance.

        `name`: of the requirement. Raises CampaignError: there is no such requirement, or none of its
        missions failed.
        """
        [result] = named([name], {entry.requirement.name: entry for entry in self.requirements})
        if not result.falsified:
            raise CampaignError(f'requirement "{name}": no mission failed, there is none to fly again')
        space = MissionSpace(self.scenario.flights)
        return space.draws(np.array([result.sample]), np.array([SETTINGS.seed]))

    def replay(self, name: str) -> Flight:
        """Flight of that mission, with its log.

        `name`: of the requirement.
        """
        return self.scenario.flights.replay_drawn(self.drawn(name))

    def cases(self) -> str:
        """TOML to add to the campaign, so that `verify` flies the failing missions again."""
        return "\n".join(requirement.case for requirement in self.falsified)

    def files(self) -> dict[str, str | bytes]:
        """Files of the run directory by name, see `save`."""
        return {
            **self.scenario.files(),
            "falsified.json": to_json(self.to_dict()),
            "cases.toml": self.cases(),
            **self.report().files(),
        }


@dataclass(frozen=True, kw_only=True)
class Falsify:
    """Strategy of `seatrial.verify`: the worst mission of each requirement, as harmless as it can be made.

    It flies in this process and keeps no parts of a search.

    Attributes
    ----------
    requirements : sequence of str
        Names of the scenario's requirements; all when empty.
    within : float
        Standard deviations of every draw within which is searched; of a uniform range 3 leave out 0.1 % at
        its ends.
    budget : int
        Missions that a search may fly, from 100 on.

    Raises
    ------
    CampaignError
        A number that cannot be; of `survey` an unknown requirement.

    Examples
    --------
    >>> import seatrial as st
    >>> st.Falsify(within=2.0).requirements
    ()
    """

    requirements: Sequence[str] = ()
    within: float = SETTINGS.within
    budget: int = SETTINGS.missions

    def __post_init__(self) -> None:
        if not 0.1 <= self.within <= 8.0:
            raise CampaignError(f"within: expected 0.1 to 8 standard deviations, found {self.within:g}")
        if self.budget < 100:
            raise CampaignError(f"budget: expected at least 100 missions, found {self.budget}")

    def survey(self, scenario: Scenario, work: Work = HERE) -> Falsification:
        """The worst missions of a scenario; see `seatrial.verify` for errors.

        `scenario`: what is flown. `work`: threads, folder of the results and progress.
        """
        chosen = scenario.chosen(self.requirements)
        clock, options = Clock(), {"within": self.within, "budget": self.budget}
        with RunDirectory(work.run_dir, "falsification", resume=False) as run:
            worst, interrupted = searched(
                chosen,
                lambda asked, watch: _Search(scenario, asked, self, work.threads).run(watch),
                work.progress,
            )
            facts = scenario.facts("falsification", clock=clock, options=options, interrupted=interrupted)
            result = Falsification(scenario, worst, self.within, interrupted, facts)
            if work.run_dir is not None and not interrupted:
                run.publish(result.facts, result.files())
        return result


class _Search:
    """The search for the worst mission of one requirement."""

    def __init__(
        self, scenario: Scenario, requirement: Requirement, asked: Falsify, threads: int | None
    ) -> None:
        self.flights, self.requirement = scenario.flights, requirement
        self.space, self.within, self.budget = MissionSpace(scenario.flights), asked.within, asked.budget
        self.threads, self.flown = threads, 0

    def run(self, watch: Callable[[float, str], None]) -> FalsifiedRequirement:
        flights = self.flights
        first = flights.fly(np.arange(64), threads=self.threads)
        if why := unusable(self.requirement, robustness(self.requirement, first, flights)):
            return FalsifiedRequirement(self.requirement, np.inf, 0, why_not=why)
        worst, at = self._worst(watch)
        if at is None or worst > 0.0:
            return FalsifiedRequirement(self.requirement, worst, self.flown)
        watch(0.9, "making the disturbance small")
        small, value = self._small(at, worst)
        drawn = self.space.draws(small[None], np.array([SETTINGS.seed]))
        middle = self.space.draws(np.zeros((1, len(small))), np.array([SETTINGS.seed])).causes
        differs = {
            name: (float(values[0]), float(middle[name][0]))
            for name, values in drawn.causes.items()
            if abs(float(values[0]) - float(middle[name][0])) > SETTINGS.rounding
        }
        name = f"falsified: {self.requirement.name}"
        return FalsifiedRequirement(
            self.requirement,
            worst,
            self.flown,
            value,
            tuple(small.tolist()),
            differs,
            {name: float(values[0]) for name, values in middle.items()},
            case_text(name, self.requirement.name, drawn, flights),
        )

    def _robustness(self, x: Array) -> Array:
        """Robustness (k,) of samples (k, d); infinite where no vehicle can be."""
        can = self.space.possible(x)
        robustness = np.full(len(x), np.inf)
        if can.any():
            seeds = np.full(int(can.sum()), SETTINGS.seed)
            robustness[can] = self.space.robustness(self.requirement, x[can], seeds, threads=self.threads)
        self.flown += int(can.sum())
        return robustness

    def _worst(self, watch: Callable[[float, str], None]) -> tuple[float, Array | None]:
        """The least robustness that was found, and where."""
        import cma

        best, at = np.inf, None
        restart, after = 0, 0
        while self.flown < self.budget and after < SETTINGS.generations_after:
            options = {
                "bounds": [-self.within, self.within],
                "popsize": SETTINGS.generation,
                "seed": self.flights.seed % 2**31 + restart + 1,
                "verbose": -9,
                "maxiter": max((self.budget - self.flown) // SETTINGS.generation, 1),
            }
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                search = cma.CMAEvolutionStrategy(np.zeros(self.space.dimensions), self.within / 3.0, options)
                while not search.stop() and self.flown < self.budget and after < SETTINGS.generations_after:
                    tried = np.array(search.ask())
                    values = self._robustness(tried)
                    search.tell(list(tried), np.clip(np.nan_to_num(values, nan=-1e9), -1e9, 1e9).tolist())
                    k = int(values.argmin())
                    if values[k] < best or at is None:
                        best, at = float(values[k]), tried[k]
                    after += best <= 0.0
                    share = max(self.flown / self.budget, after / SETTINGS.generations_after)
                    watch(0.9 * share, f"{self.flown} missions, least robustness {best:.3g}")
            restart += 1
        return best, at

    def _small(self, at: Array, value: float) -> tuple[Array, float]:
        """The least disturbance that still fails, and its robustness."""
        x = at.copy()
        while (open_ := np.flatnonzero(x)).size:
            tried = np.repeat(x[None], len(open_), axis=0)
            tried[np.arange(len(open_)), open_] = 0.0
            values = self._robustness(tried)
            failing = np.flatnonzero(values <= 0.0)
            if not failing.size:
                break
            k = int(failing[values[failing].argmin()])
            x, value = tried[k], float(values[k])
        low, high = 0.0, 1.0
        for _ in range(2):
            scales = np.linspace(low, high, 17)[1:]  # sixteen at once, twice
            values = self._robustness(scales[:, None] * x[None])
            failing = np.flatnonzero(values <= 0.0)
            if not failing.size:
                break
            k = int(failing[0])
            value = float(values[k])
            low, high = (float(scales[k - 1]) if k else low), float(scales[k])
        return high * x, value
