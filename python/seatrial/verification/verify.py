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
from seatrial.verification.judgement import (
    beyond_the_vehicle,
    judged,
    metrics_without_value,
    perceived_and_true,
)
from seatrial.verification.missions import Flyer, fly_series
from seatrial.verification.regression import fly_cases
from seatrial.verification.scenario import Scenario, autopilot_of
from seatrial.verification.verification import AutopilotComparison, Verification, compared

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.flight.mission import Mission
    from seatrial.identification.fitted import Fitted
    from seatrial.identification.identification import Identification
    from seatrial.tuning.result import Tuning
    from seatrial.verification.flown_missions import FlownMissions


@dataclass(frozen=True)
class VerifySettings:
    """How many missions are compared, and looked at for notes."""

    #: Other autopilots fly one of so many missions.
    compared_part: int = 10
    #: Missions that other autopilots fly at least.
    least_compared: int = 200
    #: Missions whose draws are looked at for notes.
    noted_draws: int = 8192


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
    ... [[legs]]
    ... north_m = 60.0
    ... east_m = 0.0
    ... depth_m = 5.0
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
