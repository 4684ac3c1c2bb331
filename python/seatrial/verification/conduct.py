"""The conduct of a verification: missions flown, with other autopilots too, all of them judged and kept.

Tests: ``tests/test_verify.py``.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from seatrial.flight.checked_numbers import checked_threads
from seatrial.run_directory import RunDirectory
from seatrial.verification.beyond_the_vehicle import beyond_the_vehicle
from seatrial.verification.comparison_of_autopilots import AutopilotComparison, compared
from seatrial.verification.figures_without_value import figures_without_value
from seatrial.verification.judged_requirement import judged
from seatrial.verification.mission_series import MissionsFlown, fly_series
from seatrial.verification.seen_and_true import seen_and_true
from seatrial.verification.verification_result import Verification

if TYPE_CHECKING:
    from seatrial.verification.flown_missions import FlownMissions
    from seatrial.verification.verified_campaign import VerifiedCampaign

__all__ = ["conduct"]

_VERIFIED = "verified"
_SHARE, _LEAST = 10, 200


def conduct(
    prepared: VerifiedCampaign,
    *,
    run_dir: str | Path | None = None,
    progress: Callable[[MissionsFlown], None] | None = None,
    resume: bool = True,
    threads: int | None = None,
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
    checked_threads(threads)
    directory = None if run_dir is None else RunDirectory(run_dir)
    try:
        series = fly_series(
            prepared.flights,
            prepared.runs,
            autopilot=_VERIFIED,
            store=directory,
            resume=resume,
            progress=progress,
            threads=threads,
        )
        if series.flown is None:
            raise KeyboardInterrupt
        flown, comparison, interrupted = series.flown, None, series.interrupted
        if prepared.others and not interrupted:
            comparison, interrupted = _compared(
                prepared, flown, store=directory, progress=progress, resume=resume, threads=threads
            )
    except BaseException:
        if directory is not None:
            directory.abandon()
        raise
    cases = prepared.flights.cases(len(flown))
    found = Verification(
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
        asked=prepared.runs,
        interrupted=interrupted,
        notes=tuple(
            dict.fromkeys([
                *prepared.notes,
                *cases.notes,
                *beyond_the_vehicle(prepared.flights, cases, flown),
                *figures_without_value(prepared.requirements, flown),
                *seen_and_true(prepared.requirements, flown),
            ])
        ),
    )
    if directory is not None:
        found.publish(directory)
    return found


def _compared(
    prepared: VerifiedCampaign,
    flown: FlownMissions,
    *,
    store: RunDirectory | None,
    progress: Callable[[MissionsFlown], None] | None,
    resume: bool,
    threads: int | None,
) -> tuple[AutopilotComparison | None, bool]:
    """Other autopilots on the first missions; nothing where Ctrl-C ended one of them early."""
    runs = min(len(flown), max(_LEAST, prepared.runs // _SHARE))
    every = {_VERIFIED: flown.first(runs)}
    for name, autopilot in prepared.others.items():
        series = fly_series(
            prepared.flights.with_autopilot(autopilot),
            runs,
            autopilot=name,
            store=store,
            resume=resume,
            progress=progress,
            threads=threads,
        )
        if series.interrupted or series.flown is None:
            return None, True
        every[name] = series.flown
    confidence = prepared.flights.table.confidence
    return compared(prepared.requirements, every, confidence=confidence), False
