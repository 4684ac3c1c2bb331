"""`verify`: an autopilot judged by many missions of drawn vehicles, and how such a run goes.

Tests: ``tests/verification/test_verify.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, overload

from seatrial._core import Autopilot, checked_threads
from seatrial.base.errors import CampaignError
from seatrial.base.finding import Finding, Severity
from seatrial.base.fleet import fleet_of, threads_of
from seatrial.base.run import RunDirectory
from seatrial.base.work import HERE, Clock, Work, callers_errors_pass, takes
from seatrial.verification.chosen_missions import fly_cases
from seatrial.verification.judgement import (
    beyond_the_vehicle,
    judged,
    metrics_without_value,
    perceived_and_true,
)
from seatrial.verification.missions import Flyer, fly_series
from seatrial.verification.scenario import Scenario, autopilot_of

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.flight.mission import Mission
    from seatrial.identification.fitted import Fitted
    from seatrial.identification.identification import Identification
    from seatrial.tuning.result import Tuning
    from seatrial.verification.flown_missions import FlownMissions
import math
from collections.abc import Callable
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.base.chunks import RECORDS
from seatrial.base.plain import Plain
from seatrial.base.report import clause_of, writer_of
from seatrial.base.run import Content, RunResult, to_json
from seatrial.flight.excesses import KINDS, Excess, excesses
from seatrial.statistics import failure_probability
from seatrial.statistics.failure_probability import FailureProbability
from seatrial.statistics.significance import holm
from seatrial.verification.chosen_missions import FlownCase
from seatrial.verification.flown_missions import FlownMissions
from seatrial.verification.judgement import JudgedRequirement
from seatrial.verification.requirement import Requirement

if TYPE_CHECKING:
    import polars as pl

    from seatrial.flight.flight import Flight
    from seatrial.flight.mission import Mission
    from seatrial.verification.missions import CampaignFlights
    from seatrial.verification.scenario import Scenario


@dataclass(frozen=True)
class VerifySettings:
    """How many missions are compared, and looked at for notes."""

    compared_part: int = 10  #: Other autopilots fly one of so many missions.
    least_compared: int = 200  #: Missions that other autopilots fly at least.
    noted_draws: int = 8192  #: Missions whose draws are looked at for notes.


SETTINGS = VerifySettings()
_VERIFIED = "verified"
_R = TypeVar("_R")
_S = TypeVar("_S", covariant=True)


class Strategy(Protocol[_S]):
    """How a scenario is surveyed: `Rare`, `Falsify` or `Boundary`."""

    def survey(self, scenario: Scenario, work: Work) -> _S:
        """Result of the survey."""
        ...


@overload
def verify(
    fit: Scenario | Identification | Fitted | Vehicle | str | Path,
    autopilot: Tuning | Autopilot | str | Path | None = None,
    missions: Sequence[Mission | str | Path] | None = None,
    *,
    strategy: None = None,
    compare: Mapping[str, Any] | None = None,
    work: Work = HERE,
    **stated: Any,
) -> Verification: ...


@overload
def verify(
    fit: Scenario | Identification | Fitted | Vehicle | str | Path,
    autopilot: Tuning | Autopilot | str | Path | None = None,
    missions: Sequence[Mission | str | Path] | None = None,
    *,
    strategy: Strategy[_R],
    work: Work = HERE,
    **stated: Any,
) -> _R: ...


@takes(work=Work)
@callers_errors_pass
def verify(
    fit: Scenario | Identification | Fitted | Vehicle | str | Path,
    autopilot: Tuning | Autopilot | str | Path | None = None,
    missions: Sequence[Mission | str | Path] | None = None,
    *,
    strategy: Strategy[Any] | None = None,
    compare: Mapping[str, Any] | None = None,
    work: Work = HERE,
    **stated: Any,
) -> Any:
    """Verdict on an autopilot from many missions of vehicles that are drawn from what is known of one.

    ``verify(fit, autopilot, missions, ...)`` flies the `Scenario` of these; ``verify(scenario)`` one that was
    made before; ``Campaign.load(file).verify(fit, gains)`` the one that a campaign file states.

    Parameters
    ----------
    fit : Identification, Fitted, Vehicle, str or Path; or Scenario
        What is known of the vehicle, as of `Scenario`; or the whole scenario.
    autopilot : Tuning, Autopilot, str or Path
        Beside a vehicle: as of `Scenario`.
    missions : sequence of Mission, str or Path
        Beside a vehicle: as of `Scenario`.
    strategy : Rare, Falsify or Boundary, optional
        How to survey the scenario: how rarely it fails, the worst that can happen, or in which values of a
        variable requirements hold. By default by as many missions as the scenario asks for.
    compare : mapping of str to autopilot, optional
        Without a strategy: other autopilots by name, which fly some of the missions as well: a tenth of them,
        at least 200.
    work : Work, optional
        Threads, executor, run directory and progress. Finished missions are kept in the run directory.
    **stated
        Beside a vehicle: requirements, water, conditions, name, seed, runs and the other keywords of
        `Scenario`.

    Returns
    -------
    Verification; or RareFailures, Falsification, FailureBoundary
        After Ctrl-C: the verdict on the missions until then, marked as interrupted.

    Raises
    ------
    CampaignError
        A key is unknown, a requirement cannot be read, or there are no missions.
    SimulationError, TrialError, VehicleError
        A mission, sensor, failure or number is not usable.
    SeatrialError
        The run directory cannot be written.

    Examples
    --------
    >>> import seatrial as st
    >>> campaign = st.Campaign.load("examples/cwolf/campaign.toml")  # doctest: +SKIP
    >>> found = campaign.verify("runs/cwolf", "runs/cwolf-tuned")  # doctest: +SKIP
    >>> found.outcome, found.requirement("keeps its path").found.interval  # doctest: +SKIP

    Without a file:

    >>> mission = st.Mission.from_toml('''
    ... format = 1
    ... name = "out"
    ... speed_m_s = 1.5
    ... acceptance_radius_m = 5.0
    ... legs = [{ north_m = 60.0, east_m = 0.0, depth_m = 5.0 }]
    ... ''')
    >>> ends = st.Requirement("is complete", 'ending == "complete"', probability=0.9)
    >>> water = {"current": {"speed_m_s": [0.0, 0.3]}}
    >>> found = st.verify("cwolf", "cwolf", [mission], requirements=[ends], water=water, runs=64)
    >>> found.outcome, found.requirement("is complete").found.failures
    ('held', 0)
    """
    checked_threads(work.threads)
    scenario = _asked(fit, autopilot, missions, stated)
    if strategy is not None:
        if compare:
            raise CampaignError("compare: a strategy chooses its missions; leave one of them out")
        return strategy.survey(scenario, work)
    others = {str(name): autopilot_of(source) for name, source in (compare or {}).items()}
    if _VERIFIED in others:
        raise CampaignError(f'compare: "{_VERIFIED}" is the autopilot that is verified; use another name')
    for other in others.values():
        scenario.flights.with_autopilot(other).check()
    with (
        RunDirectory(work.run_dir, "verification", resume=work.resume) as run,
        fleet_of(work.executor) as fleet,
    ):
        flyer = Flyer(run, work.progress, threads_of(work.threads, work.executor), fleet)
        verification = _verified(scenario, others, flyer)
        if work.run_dir is not None:
            run.publish(verification.facts, verification.files())
    return verification


def _asked(fit: Any, autopilot: Any, missions: Any, stated: Mapping[str, Any]) -> Scenario:
    """The scenario that was given, or that of a vehicle, its autopilot and missions."""
    if isinstance(fit, Scenario):
        given = {"autopilot": autopilot, "missions": missions, **stated}
        for name, value in given.items():
            if value is not None:
                raise CampaignError(f"verify: {name}: the scenario says that; give it only beside a vehicle")
        return fit
    if callable(getattr(fit, "scenario", None)):
        raise CampaignError("verify: found a campaign; use campaign.verify(fit, gains, ...)")
    if autopilot is None or missions is None:
        raise CampaignError(
            "verify: expected a Scenario, or a vehicle, its autopilot and missions, found"
            f" {'a vehicle alone' if autopilot is None else 'no missions'}; give verify(vehicle, autopilot,"
            " [mission])"
        )
    return Scenario(fit, autopilot, missions, **stated)


def _verified(scenario: Scenario, others: Mapping[str, Autopilot], flyer: Flyer) -> Verification:
    clock = Clock()
    flights, requirements = scenario.flights, scenario.requirements
    series = fly_series(flights, scenario.runs, flyer, autopilot=_VERIFIED)
    if series.flown is None:
        raise KeyboardInterrupt
    # After Ctrl-C the verdict is that of the missions until then, without others and without cases.
    flown, comparison, interrupted = series.flown, None, series.interrupted
    if others and not interrupted:
        comparison, interrupted = _compared(scenario, others, flown, flyer)
    draws = flights.draws(min(len(flown), SETTINGS.noted_draws))
    cases = (
        () if interrupted else fly_cases(flights.table.cases, flights, requirements, threads=flyer.threads)
    )
    return Verification(
        scenario=scenario,
        flown=flown,
        requirements=judged(
            requirements,
            flown,
            missions=flights.titles,
            confidence=flights.table.confidence,
            keep_worst=flights.table.keep_worst,
        ),
        comparison=comparison,
        cases=cases,
        asked=scenario.runs,
        interrupted=interrupted,
        doubt=draws.doubt,
        remarks=(
            *scenario.remarks,
            *(Finding("told", Severity.NOTE, values={"sentence": note}) for note in draws.notes),
            *beyond_the_vehicle(flights, draws, flown),
            *metrics_without_value(requirements, flown),
            *perceived_and_true(requirements, flown),
        ),
        records=series.records,
        facts=scenario.facts(
            "verification",
            clock=clock,
            options={
                "missions": len(flown),
                "verification": flights.table.model_dump(mode="json", exclude_none=True),
            },
            interrupted=interrupted,
        ),
    )


def _compared(
    scenario: Scenario, others: Mapping[str, Autopilot], flown: FlownMissions, flyer: Flyer
) -> tuple[AutopilotComparison | None, bool]:
    """Other autopilots on the first missions; nothing where Ctrl-C ended one of them early."""
    runs = min(len(flown), max(SETTINGS.least_compared, scenario.runs // SETTINGS.compared_part))
    every = {_VERIFIED: flown.first(runs)}
    for name, autopilot in others.items():
        series = fly_series(scenario.flights.with_autopilot(autopilot), runs, flyer, autopilot=name)
        if series.interrupted or series.flown is None:
            return None, True
        every[name] = series.flown
    confidence = scenario.flights.table.confidence
    return compared(scenario.requirements, every, confidence=confidence), False


LEVEL = 0.05  # chance to name one of two that fail alike, after Holm's correction

_METRICS = (
    "true_cross_track_p95_m", "cross_track_p95_m", "vertical_p95_m", "energy_wh", "duration_s",
    "travel_per_s",
)  # fmt: skip


@dataclass(frozen=True)
class PairedRequirement(
    Plain,
    only="requirement other only_verified_failed=only_verified only_other_failed=only_other p_value corrected"
    " verdict=words",
):
    """A requirement for the verified autopilot and another one on the same missions.

    `requirement`, `other`: names of the requirement and of the other autopilot. `only_verified`,
    `only_other`: missions that only the verified one failed, and only the other one. `p_value`, `corrected`:
    of McNemar's exact test, alone and with regard to all that were asked.
    """

    requirement: str
    other: str
    only_verified: int
    only_other: int
    p_value: float
    corrected: float

    @property
    def better(self) -> str | None:
        """The one that is shown to fail less: "verified" or the other's name; None where neither is."""
        if self.corrected > LEVEL:
            return None
        return "verified" if self.only_verified < self.only_other else self.other

    @property
    def words(self) -> str:
        """Which of them is better, or "no difference shown"."""
        return "no difference shown" if self.better is None else f"{self.better} is better"


@dataclass(frozen=True)
class FlownAutopilot:
    """How one autopilot did on the missions of a comparison.

    `name`: "verified", "start", or as it was given. `failures`: failures by requirement. `metrics`: median
    over the missions of some metrics.
    """

    name: str
    failures: dict[str, FailureProbability]
    metrics: dict[str, float]


@dataclass(frozen=True)
class AutopilotComparison:
    """Several autopilots on the same missions.

    `runs`: number of missions. `autopilots`: the verified one first. `pairs`: each requirement, the verified
    one against each other one.
    """

    runs: int
    autopilots: tuple[FlownAutopilot, ...]
    pairs: tuple[PairedRequirement, ...]

    def pair(self, requirement: str, other: str) -> PairedRequirement:
        """The verified autopilot against another one in a requirement."""
        return next(pair for pair in self.pairs if (pair.requirement, pair.other) == (requirement, other))

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "runs": self.runs,
            "autopilots": {
                pilot.name: {
                    "failures": {name: rate.failures for name, rate in pilot.failures.items()},
                    "intervals": {name: list(rate.interval) for name, rate in pilot.failures.items()},
                    "medians": dict(pilot.metrics),
                }
                for pilot in self.autopilots
            },
            "pairs": [pair.to_dict() for pair in self.pairs],
        }


def compared(
    requirements: Sequence[Requirement], flown: Mapping[str, FlownMissions], *, confidence: float
) -> AutopilotComparison:
    """Autopilots on the same missions: `flown` by name, the verified one first, all with the same numbers.

    Mission i is the same for all of them (vehicle, water, noise, failures, start), so that the pairs decide:
    of the missions that one held and the other failed, b, and those the other way round, c, equally many are
    expected where they are equally good. The exact test of McNemar (1947, Psychometrika 12:153) is that of b
    in b + c throws of a coin, on two sides; p-values of all requirements and autopilots are corrected by
    Holm.
    """
    held_by_name = {
        name: {asked.name: asked.judge(missions.metrics).held for asked in requirements}
        for name, missions in flown.items()
    }
    runs = len(next(iter(flown.values())))
    autopilots = tuple(
        FlownAutopilot(
            name,
            {
                title: FailureProbability(int(np.count_nonzero(~mask)), runs, confidence)
                for title, mask in held_by_name[name].items()
            },
            {metric: _median(missions.metrics[metric]) for metric in _METRICS if metric in missions.metrics},
        )
        for name, missions in flown.items()
    )
    # The verified one against each other one, requirement by requirement, and all of them as one family.
    verified, *others = flown
    raw = [
        (title, other, *mcnemar(held_by_name[verified][title], held_by_name[other][title]))
        for title in held_by_name[verified]
        for other in others
    ]
    corrected = holm([one[-1] for one in raw])
    pairs = tuple(
        PairedRequirement(title, other, b, c, p, float(sure))
        for (title, other, b, c, p), sure in zip(raw, corrected, strict=True)
    )
    return AutopilotComparison(runs, autopilots, pairs)


def mcnemar(held: NDArray[np.bool_], other: NDArray[np.bool_]) -> tuple[int, int, float]:
    """Missions that only the first failed, those that only the other failed, and the exact p-value.

    `held` and `other` (k,): whether each mission was held by the one and by the other.

    Examples
    --------
    >>> import numpy as np
    >>> first, second = np.array([True] * 10), np.array([True] * 4 + [False] * 6)
    >>> mcnemar(first, second)
    (0, 6, 0.03125)
    """
    from scipy.stats import binomtest

    b, c = int(np.count_nonzero(~held & other)), int(np.count_nonzero(held & ~other))
    return b, c, 1.0 if b + c == 0 else float(binomtest(b, b + c, 0.5).pvalue)


def _median(values: NDArray[Any]) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")


@dataclass(frozen=True, eq=False, repr=False)
class Verification(RunResult):
    """What missions flown by drawn vehicles say of an autopilot; made by `seatrial.verify`.

    `scenario`: what was flown, and how to fly any of it again. `flown`: all missions: metrics, what was
    drawn, times. `requirements`: a `JudgedRequirement` each: failures, interval, verdict, worst missions,
    causes. `comparison`: other autopilots on the same draws; None where none was asked for. `asked`: missions
    that were asked for. `interrupted`: whether Ctrl-C ended them early: the verdict is that of the missions
    until then. `remarks`: what is assumed and what was drawn; ``notes`` says it in sentences,
    ``flights.left_out`` says more. `doubt`: heading where many of the drawn vehicles were physically
    impossible; empty otherwise. `facts`: what the result rests on, see `seatrial.base.run.run_facts`.
    `cases`: the regression cases of the campaign, flown. `records`: where and how each chunk of missions was
    flown, see `seatrial.base.chunks`.
    """

    scenario: Scenario
    flown: FlownMissions
    requirements: tuple[JudgedRequirement, ...]
    comparison: AutopilotComparison | None
    asked: int
    interrupted: bool
    remarks: tuple[Finding, ...]
    doubt: str
    facts: Mapping[str, Any]
    cases: tuple[FlownCase, ...] = ()
    records: tuple[Mapping[str, Any], ...] = ()

    @property
    def flights(self) -> CampaignFlights:
        """What was flown."""
        return self.scenario.flights

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on what is assumed and what was drawn."""
        sentences = (clause_of(remark, "verification") for remark in self.remarks)
        return tuple(dict.fromkeys(sentences))

    @property
    def outcome(self) -> failure_probability.Verdict:
        """Held where every requirement and regression case is, failed where any is, undecided otherwise.

        That all are held is wrong at most as often as a single one (Berger 1982, Technometrics 24:295): no
        correction is needed. Of m requirements that just hold, up to m times the risk are called failed.
        """
        verdicts = {one.verdict for one in self.requirements}
        if "failed" in verdicts or not all(one.held for one in self.cases):
            return "failed"
        return "undecided" if "undecided" in verdicts else "held"

    @property
    def held(self) -> bool:
        """Whether every requirement is held."""
        return self.outcome == "held"

    @cached_property
    def excesses(self) -> tuple[Excess, ...]:
        """What every user would call a failure of a mission, required or not."""
        flown = self.flown
        missions = self.flights.missions

        def of_each(value: Callable[[Mission], float]) -> Array:
            return np.array([value(mission) for mission in missions])[flown.mission]

        return tuple(
            excesses(
                flown.metrics,
                of_each(lambda mission: mission.promised_m),
                max_depth_m=of_each(lambda mission: mission.limits["max_depth_m"]),
                min_altitude_m=of_each(lambda mission: mission.limits["min_altitude_m"]),
                complete=flown.metrics["ending"] == "complete",
                battery_wh=self.flights.fitted.vehicle.power().get("battery_wh", math.inf),
            )
        )

    @property
    def reservations(self) -> tuple[Excess, ...]:
        """Excesses on which no requirement decides: with them, "held" is said with a reservation."""
        asked = {name for one in self.requirements for name in one.requirement.metrics}
        return tuple(excess for excess in self.excesses if not asked & set(KINDS[excess.kind].metrics))

    def requirement(self, name: str) -> JudgedRequirement:
        """The requirement with a name.

        Raises KeyError: there is none.
        """
        return {judged.requirement.name: judged for judged in self.requirements}[name]

    def replay(self, number: int) -> Flight:
        """Flight of a mission by its number, with its log; metrics are those of the verification to the bit.

        `number`: from 0 on; also one beyond those that were flown.
        """
        return self.flights.replay(number)

    def table(self) -> pl.DataFrame:
        """Table with a row per mission: metrics and what was drawn."""
        return self.flown.table(self.flights.titles)

    def to_dict(self) -> dict[str, Any]:
        """Everything but the missions as plain data."""
        return {
            "campaign": self.scenario.name,
            "outcome": self.outcome,
            "reservations": [
                excess.to_dict() | {"worst": int(self.flown.numbers[excess.worst]), "sentence": sentence}
                for excess, sentence in zip(
                    self.reservations, writer_of(self).excess_sentences(self, self.reservations), strict=True
                )
            ],
            "interrupted": self.interrupted,
            "missions": {"asked": self.asked, "flown": len(self.flown), "of": list(self.flights.titles)},
            "vehicle": self.flights.fitted.vehicle.name,
            "autopilot": self.flights.autopilot.name,
            "seed": self.flights.seed,
            "requirements": [one.to_dict() for one in self.requirements],
            "comparison": None if self.comparison is None else self.comparison.to_dict(),
            "cases": [one.to_dict() for one in self.cases],
            "time": {
                "flown_s": self.flown.flown_s,
                "wall_s": self.flown.wall_s,
                "real_time_factor": self.flown.real_time_factor,
                "missions_per_s": self.flown.per_second,
            },
            "notes": list(self.notes),
            "doubt": self.doubt,
            "warnings": self.flights.warnings,
            "left_out": list(self.flights.left_out),
        }

    def junit(self) -> str:
        """JUnit XML with a case per requirement; undecided is a failure."""
        return str(writer_of(self).junit(self))

    def files(self) -> dict[str, Content]:
        """Files of the run directory by name, see `save`."""
        worst = {one.requirement.name: [run.to_dict() for run in one.worst] for one in self.requirements}
        return {
            **self.scenario.files(),
            "verification.json": to_json(self.to_dict()),
            **self.report().files(),
            "junit.xml": self.junit(),
            "worst_runs.json": to_json(worst),
            "missions.parquet": partial(self.flown.write_table, self.flights.titles),
            RECORDS: to_json(self.records),
        }

    def worst(self) -> Mapping[str, list[int]]:
        """Numbers of the worst missions by requirement, the worst first."""
        return {one.requirement.name: [run.number for run in one.worst] for one in self.requirements}
