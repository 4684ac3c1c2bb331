"""`verify`: an autopilot judged by many missions of drawn vehicles, and how such a run goes.

Tests: ``tests/verification/test_verify.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from seatrial._core import checked_threads
from seatrial.base.errors import CampaignError
from seatrial.base.fleet import fleet_of, threads_of
from seatrial.base.progress import Clock, Progress, callers_errors_pass
from seatrial.base.run import RunDirectory, run_facts, sha256
from seatrial.verification.comparison import AutopilotComparison, compared
from seatrial.verification.judgement import (
    beyond_the_vehicle,
    judged,
    metrics_without_value,
    perceived_and_true,
)
from seatrial.verification.missions import fly_series
from seatrial.verification.regression import fly_cases
from seatrial.verification.verification import Verification, input_files

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.base.fleet import Fleet, Workers
    from seatrial.campaign.campaign import Campaign
    from seatrial.flight.mission import Mission
    from seatrial.identification.fitted import Fitted
    from seatrial.identification.identification import Identification
    from seatrial.tuning.result import Tuning
    from seatrial.verification.campaign import VerifiedCampaign
    from seatrial.verification.flown_missions import FlownMissions
    from seatrial.verification.requirement import Requirement

_SHARE, _LEAST = 10, 200  # of the missions, a tenth and at least so many, fly with other autopilots too

_TOLD = 8192  # missions whose draws are looked at for notes

_VERIFIED = "verified"


@overload
def verify(
    campaign: Campaign,
    fit: Identification | Fitted | Vehicle | str | Path | None = None,
    gains: Tuning | Autopilot | str | Path | None = None,
    *,
    model: Vehicle | str | Path | None = None,
    runs: int | None = None,
    missions: Sequence[Mission | str | Path] | None = None,
    threads: int | None = None,
    executor: Workers | None = None,
    run_dir: str | Path | None = None,
    progress: Callable[[Progress], None] | None = None,
    resume: bool = True,
    compare: bool | Mapping[str, Any] = False,
    navigation: str | None = None,
) -> Verification: ...


@overload
def verify(
    vehicle: Identification | Fitted | Vehicle | str | Path,
    autopilot: Tuning | Autopilot | str | Path,
    missions: Sequence[Mission | str | Path],
    /,
    *,
    requirements: Sequence[Requirement] = (),
    settings: Mapping[str, Any] | None = None,
    name: str | None = None,
    seed: int = 0,
    model: Vehicle | str | Path | None = None,
    runs: int | None = None,
    threads: int | None = None,
    executor: Workers | None = None,
    run_dir: str | Path | None = None,
    progress: Callable[[Progress], None] | None = None,
    resume: bool = True,
    compare: Mapping[str, Any] | None = None,
    navigation: str | None = None,
) -> Verification: ...


@callers_errors_pass
def verify(
    campaign: Campaign | Identification | Fitted | Vehicle | str | Path,
    fit: Any = None,
    gains: Any = None,
    *,
    requirements: Sequence[Requirement] | None = None,
    settings: Mapping[str, Any] | None = None,
    name: str | None = None,
    seed: int | None = None,
    model: Vehicle | str | Path | None = None,
    runs: int | None = None,
    missions: Sequence[Mission | str | Path] | None = None,
    threads: int | None = None,
    executor: Workers | None = None,
    run_dir: str | Path | None = None,
    progress: Callable[[Progress], None] | None = None,
    resume: bool = True,
    compare: bool | Mapping[str, Any] | None = False,
    navigation: str | None = None,
) -> Verification:
    """Verdict on an autopilot from many missions of vehicles that are drawn from what is known of one.

    ``verify(campaign, fit, gains)`` or, without a file, ``verify(vehicle, autopilot, missions, ...)``.

    Every mission has its own vehicle, water, noise, failures and start, as the table ``[verification]`` of
    the campaign says; the autopilot believes in the identified vehicle. Mission i depends on the campaign's
    seed and on i alone. Requirements are read before anything flies.

    Parameters
    ----------
    campaign : Campaign; or Identification, Fitted, Vehicle, str or Path
        With a table ``[verification]``. Without a campaign: what is known of the vehicle.
    fit : Identification, Fitted, Vehicle, str or Path; or Tuning, Autopilot, str or Path
        The vehicle and how well it is known: a result of `seatrial.identify`, its run directory, or a
        vehicle, whose coefficients count as exact; by default the campaign's vehicle. Without a campaign: the
        autopilot.
    gains : Tuning, Autopilot, str or Path; or sequence of Mission, str or Path
        The autopilot: a result of `seatrial.tune` or its run directory, an autopilot, a built-in name or a
        file; by default the campaign's. Without a campaign: the missions.
    requirements : sequence of Requirement, optional
        Without a campaign: what must hold; by default that missions are complete and paths are kept.
    settings : mapping, optional
        Without a campaign: the other keys of ``[verification]``, for example current, faults, sensors.
    name : str, optional
        Without a campaign: of the result; that of the vehicle by default.
    seed : int, optional
        Without a campaign: of all draws.
    model : Vehicle, str or Path, optional
        The vehicle that the autopilot believes in; by default the best values of ``fit``. With it, ``fit``
        may be a vehicle that the autopilot does not know: the truth of generated trials, or another one of
        its class.
    runs : int, optional
        Number of missions instead of the table's, which is 1000 where it says nothing.
    missions : sequence of Mission, str or Path, optional
        Instead of the campaign's.
    threads : int, optional
        Threads of the core; by default all, with an executor one per worker. The result does not depend on
        it.
    executor : Executor, str or distributed.Client, optional
        Where chunks of 512 missions are flown: a `concurrent.futures` executor, the address of a Dask
        scheduler ("tcp://HOST:8786"), "local" or "local:N" for a Dask cluster on this machine.
    run_dir : str or Path, optional
        Folder for the results. Finished missions are kept in it, and in its sibling while the run goes on.
    progress : callable, optional
        Called in the caller's thread with a `Progress` after every 512 missions.
    resume : bool
        Reuse the missions that an earlier run in this folder flew from the same inputs.
    compare : bool or mapping of str to autopilot
        Fly some of the missions with the campaign's autopilot ("start") as well, or with those given by
        name: a tenth of them, at least 200.
    navigation : str, optional
        What the autopilot goes by, "sensors" or "filter", as for `seatrial.fly`, instead of the table's.

    Returns
    -------
    Verification
        After Ctrl-C: the verdict on the missions until then, marked as interrupted.

    Raises
    ------
    CampaignError
        There is no table ``[verification]``, a requirement cannot be read, or nothing stands to compare with.
    SimulationError, TrialError, VehicleError
        A mission, sensor, failure or number is not usable.
    SeatrialError
        The run directory cannot be written.

    Examples
    --------
    >>> import seatrial as st
    >>> campaign = st.Campaign.load("examples/cwolf/campaign.toml")  # doctest: +SKIP
    >>> found = st.verify(campaign, "runs/cwolf", "runs/cwolf-tuned")  # doctest: +SKIP
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
    >>> found = st.verify("cwolf", "cwolf", [mission], requirements=[ends], settings=water, runs=64)
    >>> found.outcome, found.requirement("is complete").found.failures
    ('held', 0)
    """
    from seatrial.campaign.campaign import Campaign
    from seatrial.identification.fitted import Fitted
    from seatrial.verification.campaign import campaign_of, verified_campaign

    checked_threads(threads)

    if isinstance(campaign, Campaign):
        alone = {"requirements": requirements, "settings": settings, "name": name, "seed": seed}
        if named := [key for key, value in alone.items() if value is not None]:
            raise CampaignError(
                f"{named[0]}: expected only without a campaign, found it beside {campaign.source}; write it"
                " into the campaign's file"
            )
    else:
        if fit is None or (gains is None and missions is None):
            raise CampaignError(
                "verify: expected a Campaign, or a vehicle, its autopilot and missions, found"
                f" {'a vehicle alone' if fit is None else 'no missions'}; give verify(vehicle, autopilot,"
                " [mission])"
            )
        known, fit, gains, missions = Fitted.of(campaign), None, fit, gains if missions is None else missions
        campaign = campaign_of(
            known.vehicle,
            missions,
            requirements=requirements or (),
            settings=settings or {},
            name=name,
            seed=0 if seed is None else seed,
        )
        fit = known
    prepared = verified_campaign(
        campaign,
        fit,
        gains,
        model=model,
        runs=runs,
        missions=missions,
        compare=compare or False,
        navigation=navigation,
    )
    return run_verification(
        prepared, run_dir=run_dir, progress=progress, resume=resume, threads=threads, executor=executor
    )


def run_verification(
    prepared: VerifiedCampaign,
    *,
    run_dir: str | Path | None = None,
    progress: Callable[[Progress], None] | None = None,
    resume: bool = True,
    threads: int | None = None,
    executor: Workers | None = None,
) -> Verification:
    """Verification of a campaign. See `seatrial.verify` for the parameters.

    Raises
    ------
    SimulationError
        There is no such number of threads.
    SeatrialError
        The run directory cannot be written.
    KeyboardInterrupt
        Before the first missions were finished.
    """
    clock = Clock()
    threads = threads_of(threads, executor)
    with RunDirectory(run_dir, "verification", resume=resume) as run, fleet_of(executor) as fleet:
        found = _verified(prepared, run, clock, progress=progress, threads=threads, fleet=fleet)
        if run_dir is not None:
            run.publish(found.facts, found.files())
    return found


def _verified(
    prepared: VerifiedCampaign,
    run: RunDirectory,
    clock: Clock,
    *,
    progress: Callable[[Progress], None] | None,
    threads: int | None,
    fleet: Fleet | None,
) -> Verification:
    series = fly_series(
        prepared.flights,
        prepared.runs,
        autopilot=_VERIFIED,
        run=run,
        progress=progress,
        threads=threads,
        fleet=fleet,
    )
    if series.flown is None:
        raise KeyboardInterrupt
    flown, comparison, interrupted = series.flown, None, series.interrupted
    if prepared.others and not interrupted:
        comparison, interrupted = _compared(
            prepared, flown, run=run, progress=progress, threads=threads, fleet=fleet
        )
    draws = prepared.flights.draws(min(len(flown), _TOLD))
    cases = (
        ()
        if interrupted
        else fly_cases(prepared.flights.table.cases, prepared.flights, prepared.requirements, threads=threads)
    )
    return Verification(
        campaign=prepared.campaign,
        flights=prepared.flights,
        flown=flown,
        requirements=judged(
            prepared.requirements,
            flown,
            missions=prepared.flights.titles,
            confidence=prepared.flights.table.confidence,
            keep_worst=prepared.flights.table.keep_worst,
        ),
        comparison=comparison,
        cases=cases,
        asked=prepared.runs,
        interrupted=interrupted,
        doubt=draws.doubt,
        notes=tuple(
            dict.fromkeys([
                *prepared.notes,
                *draws.notes,
                *beyond_the_vehicle(prepared.flights, draws, flown),
                *metrics_without_value(prepared.requirements, flown),
                *perceived_and_true(prepared.requirements, flown),
            ])
        ),
        records=series.records,
        facts=run_facts(
            "verification",
            prepared.campaign.name,
            clock=clock,
            inputs=prepared.campaign.input_hashes(trials=False)
            | {name: sha256(text) for name, text in input_files(prepared.campaign, prepared.flights).items()},
            seed=prepared.flights.seed,
            options={
                "missions": len(flown),
                "verification": prepared.flights.table.model_dump(mode="json", exclude_none=True),
            },
            interrupted=interrupted,
        ),
    )


def _compared(
    prepared: VerifiedCampaign,
    flown: FlownMissions,
    *,
    run: RunDirectory,
    progress: Callable[[Progress], None] | None,
    threads: int | None,
    fleet: Fleet | None,
) -> tuple[AutopilotComparison | None, bool]:
    """Other autopilots on the first missions; nothing where Ctrl-C ended one of them early."""
    runs = min(len(flown), max(_LEAST, prepared.runs // _SHARE))
    every = {_VERIFIED: flown.first(runs)}
    for name, autopilot in prepared.others.items():
        series = fly_series(
            prepared.flights.with_autopilot(autopilot),
            runs,
            autopilot=name,
            run=run,
            progress=progress,
            threads=threads,
            fleet=fleet,
        )
        if series.interrupted or series.flown is None:
            return None, True
        every[name] = series.flown
    confidence = prepared.flights.table.confidence
    return compared(prepared.requirements, every, confidence=confidence), False
