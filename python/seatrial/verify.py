"""Verification of an autopilot by many missions: the public function.

The work is in `seatrial.verification.conduct`, loaded at the call: `import seatrial` stays light.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.campaign import Campaign
    from seatrial.fitted import Fitted
    from seatrial.identification import Identification
    from seatrial.mission import Mission
    from seatrial.verification.mission_series import MissionsFlown
    from seatrial.verification.verification_result import Verification

__all__ = ["verify"]


def verify(
    campaign: Campaign,
    fit: Identification | Fitted | Vehicle | str | Path | None = None,
    gains: Any = None,
    *,
    model: Vehicle | str | Path | None = None,
    runs: int | None = None,
    missions: Sequence[Mission | str | Path] | None = None,
    threads: int | None = None,
    run_dir: str | Path | None = None,
    progress: Callable[[MissionsFlown], None] | None = None,
    resume: bool = True,
    compare: bool | Mapping[str, Any] = False,
) -> Verification:
    """Verdict on an autopilot from many missions of vehicles that are drawn from what is known of one.

    Every mission has its own vehicle, water, noise, failures and start, as the table ``[verification]`` of
    the campaign says; the autopilot believes in the identified vehicle. Mission i depends on the campaign's
    seed and on i alone. Requirements are read before anything flies.

    Parameters
    ----------
    campaign : Campaign
        With a table ``[verification]``.
    fit : Identification, Fitted, Vehicle, str or Path, optional
        The vehicle and how well it is known: a result of `seatrial.identify`, its run directory, or a
        vehicle, whose coefficients count as exact; by default the campaign's vehicle.
    gains : Tuning, Autopilot, str or Path, optional
        The autopilot: a result of `seatrial.tune` or its run directory, an autopilot, a built-in name or a
        file; by default the campaign's.
    model : Vehicle, str or Path, optional
        The vehicle that the autopilot believes in; by default the best values of ``fit``. With it, ``fit``
        may be a vehicle that the autopilot does not know: the truth of generated trials, or another one of
        its class.
    runs : int, optional
        Number of missions instead of the table's.
    missions : sequence of Mission, str or Path, optional
        Instead of the table's.
    threads : int, optional
        Threads of the core; by default all. The result does not depend on it.
    run_dir : str or Path, optional
        Folder for the results. Finished missions are kept in it, and in its sibling while the run goes on.
    progress : callable, optional
        Called in the caller's thread with a `MissionsFlown` after every 512 missions.
    resume : bool
        Reuse the missions that an earlier run in this folder flew from the same inputs.
    compare : bool or mapping of str to autopilot
        Fly some of the missions with the campaign's autopilot ("start") as well, or with those given by
        name: a tenth of them, at least 200.

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
    >>> found.verdict, found.requirement("keeps its path").found.interval  # doctest: +SKIP
    """
    from seatrial.verification.conduct import conduct
    from seatrial.verification.verified_campaign import verified_campaign

    prepared = verified_campaign(
        campaign, fit, gains, model=model, runs=runs, missions=missions, compare=compare
    )
    return conduct(prepared, run_dir=run_dir, progress=progress, resume=resume, threads=threads)
