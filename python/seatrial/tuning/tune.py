"""`tune`: from a vehicle as well as it is known to an autopilot whose responses stay in their corridors.

Margins first, then group after group by evolution strategy and simplex on the full non-linear closed loop
with limits, dead band, dead time, sensor noise, currents and drawn vehicles; at last everything is assessed
again on samples that the search never saw, beside the start gains and a relay autotuning
(`seatrial.tuning.tuning_run`). What cannot be tuned is refused before the search.

Source: Taubert et al. (2014), section "Constraint Criteria Optimization". Held by tests/tuning/test_tune.py.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from seatrial._core import Autopilot, checked_threads
from seatrial.base.errors import CampaignError, SeatrialError, TrialError
from seatrial.base.fleet import fleet_of
from seatrial.base.progress import Progress, callers_errors_pass
from seatrial.base.run import RunDirectory, sha256
from seatrial.base.toml_file import checked, loaded
from seatrial.campaign.campaign import Campaign
from seatrial.campaign.tuning_table import TuningTable
from seatrial.control_design.autopilot_facts import refuse_misfit, refuse_other_laws
from seatrial.flight.sensor_channels import sensors_of
from seatrial.identification.fitted import Fitted
from seatrial.tuning.plan import TuningPlan
from seatrial.tuning.result import Tuning
from seatrial.tuning.tuning_run import TuningRun

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.base.fleet import Workers
    from seatrial.identification.identification import Identification


@overload
def tune(
    campaign: Campaign,
    fit: Identification | Fitted | Vehicle | str | Path | None = None,
    *,
    run_dir: str | Path | None = None,
    progress: Callable[[Progress], None] | None = None,
    resume: bool = True,
    relay: bool = False,
    threads: int | None = None,
    executor: Workers | None = None,
) -> Tuning: ...


@overload
def tune(
    vehicle: Identification | Fitted | Vehicle | str | Path,
    autopilot: Autopilot | str | Path,
    /,
    *,
    loops: Mapping[str, Mapping[str, Any]] | None = None,
    settings: Mapping[str, Any] | None = None,
    name: str | None = None,
    seed: int = 0,
    run_dir: str | Path | None = None,
    progress: Callable[[Progress], None] | None = None,
    resume: bool = True,
    relay: bool = False,
    threads: int | None = None,
    executor: Workers | None = None,
) -> Tuning: ...


@callers_errors_pass
def tune(
    campaign: Campaign | Identification | Fitted | Vehicle | str | Path,
    fit: Any = None,
    *,
    loops: Mapping[str, Mapping[str, Any]] | None = None,
    settings: Mapping[str, Any] | None = None,
    name: str | None = None,
    seed: int | None = None,
    run_dir: str | Path | None = None,
    progress: Callable[[Progress], None] | None = None,
    resume: bool = True,
    relay: bool = False,
    threads: int | None = None,
    executor: Workers | None = None,
) -> Tuning:
    """Tuning: an autopilot with tuned gains, how its responses keep to their corridors, and its margins.

    ``tune(campaign, fit)`` or, without a file, ``tune(vehicle, autopilot, loops=...)``.

    Parameters
    ----------
    campaign : Campaign; or Identification, run directory, Vehicle, built-in name or file
        Its ``[tuning]`` says what the loops shall do, its ``autopilot`` gives the start gains. Without a
        campaign: what is known of the vehicle.
    fit : Identification, run directory, Vehicle, built-in name or file; or Autopilot, built-in name or file
        What is known of the vehicle; the campaign's own vehicle, taken as exact, when missing. Without a
        campaign: the autopilot with the start gains.
    loops : mapping, optional
        Without a campaign: the loops to tune, each with its steps, speeds_m_s, corridor, weights and
        beside, as in the tables ``[tuning.loops.NAME]``; every loop at work, in default corridors, when
        missing.
    settings : mapping, optional
        Without a campaign: the other keys of ``[tuning]``, for example samples, sensors, margins, budget.
    name : str, optional
        Without a campaign: of the result; that of the vehicle by default.
    seed : int, optional
        Without a campaign: of draws and searches.
    run_dir : str or Path, optional
        Where the results go, and where finished groups are kept for a run that resumes this one.
    progress : callable, optional
        Called with a `Progress` after every batch of candidates.
    resume : bool, optional
        Whether groups that an earlier run finished from the same inputs are reused.
    relay : bool, optional
        Whether a relay autotuning of the same loops is assessed beside.
    threads : int, optional
        All when omitted; the result does not depend on it.
    executor : Executor, str or distributed.Client, optional
        Where the candidates of the searches fly; see `seatrial.verify`.

    Returns
    -------
    Tuning
        ``interrupted`` after Ctrl-C, with the best gains so far.

    Raises
    ------
    CampaignError
        The campaign or its tables ask for what the vehicle or the autopilot cannot do.
    VehicleError, TrialError
        A file is not usable.
    SeatrialError
        The run directory cannot be written.

    Examples
    --------
    >>> import seatrial as st
    >>> campaign = st.Campaign.load("examples/cwolf/campaign.toml")  # doctest: +SKIP
    >>> tuning = st.tune(campaign, campaign.identify())  # doctest: +SKIP
    >>> tuning.autopilot.gains()["surge.K_P.4"]  # doctest: +SKIP

    Without a file, and with a search that is much too short:

    >>> corridor = {"rise_s": 5.0, "overshoot": 0.3, "settling_s": 10.0, "settled": 0.1}
    >>> tuning = st.tune(
    ...     "remus100",
    ...     "remus100",
    ...     loops={"heading": {"steps": [20.0], "speeds_m_s": [2.0], "corridor": corridor}},
    ...     settings={
    ...         "samples": 0,
    ...         "settle_s": 6.0,
    ...         "budget": {"population": 8, "generations": 1, "simplex_rounds": 1},
    ...     },
    ... )
    >>> [group.name for group in tuning.groups[:2]]
    ['margins', 'heading']
    """
    checked_threads(threads)
    if isinstance(campaign, Campaign):
        given = {"loops": loops, "settings": settings, "name": name, "seed": seed}
        if named := [key for key, value in given.items() if value is not None]:
            raise CampaignError(
                f"{named[0]}: expected only without a campaign, found it beside {campaign.source}; write it"
                " into the campaign's file"
            )
        of, plan = campaign, plan_of(campaign, fit)
        inputs = campaign.input_hashes(trials=False)
    else:
        if fit is None:
            raise CampaignError(
                "tune: expected a Campaign, or a vehicle and its autopilot, found a vehicle alone; give an"
                " Autopilot, a built-in name or a file as second argument"
            )
        of, plan = None, _plan_without_file(campaign, fit, {"loops": loops or {}} | dict(settings or {}))
        plan = replace(plan, name=name or plan.vehicle.name, seed=seed or 0)
        inputs = {
            "autopilot": sha256(plan.autopilot.to_toml()),
            "tuning": sha256(plan.table.model_dump_json()),
            "vehicle": sha256(plan.vehicle.to_toml()),
        }
    assert plan.groups is not None  # what cannot be tuned is refused before a directory is made
    with RunDirectory(run_dir, "tuning", resume=resume) as run, fleet_of(executor) as fleet:
        found = TuningRun(
            plan, run, campaign=of, inputs=inputs, progress=progress, threads=threads, fleet=fleet
        ).run(relay=relay)
        if found.interrupted and found.groups:
            with contextlib.suppress(SeatrialError):  # the gains are in what is returned all the same
                # The best gains so far are an autopilot file beside the finished groups.
                found = replace(found, kept=run.leave("autopilot.toml", found.autopilot.to_toml()))
        elif run_dir is not None and not found.interrupted:
            run.publish(found.facts, found.files())
    return found


def plan_of(
    campaign: Campaign, fit: Identification | Fitted | Vehicle | str | Path | None = None
) -> TuningPlan:
    """What a tuning of a campaign does, before it is done. Takes and raises what `tune` does."""
    table = campaign.file.tuning or TuningTable()
    fitted = Fitted.of(campaign.vehicle if fit is None else fit)
    sensors = table.sensors
    if sensors not in ("typical", "perfect"):
        table = table.model_copy(update={"sensors": str(campaign.resolve(sensors, "tuning.sensors"))})
    autopilot = campaign.autopilot
    here = set(fitted.vehicle.actuators)
    if here != set(campaign.vehicle.actuators):
        raise CampaignError(
            f"{campaign.source}: expected a fit of {campaign.vehicle.name}, found one of"
            f" {fitted.vehicle.name} with other actuators; give the run directory of this campaign"
        )
    plan = TuningPlan(table, fitted, autopilot, campaign.name, campaign.seed, f"the campaign {campaign.name}")
    _refuse_what_cannot_fly(plan, f"{campaign.source}: tuning")
    return plan


def _plan_without_file(
    vehicle: Identification | Fitted | Vehicle | str | Path,
    autopilot: Autopilot | str | Path,
    table: dict[str, Any],
) -> TuningPlan:
    """What a tuning of a vehicle and an autopilot does; ``table`` is that of ``[tuning]``."""
    fitted = Fitted.of(vehicle)
    plan = TuningPlan(
        checked(TuningTable, table, "tune"),
        fitted,
        loaded(Autopilot, autopilot),
        origin=f"the vehicle {fitted.vehicle.name}",
    )
    _refuse_what_cannot_fly(plan, "tune")
    return plan


def _refuse_what_cannot_fly(plan: TuningPlan, where: str) -> None:
    """Refuse before the search, and before a directory is made, what its first flight would refuse."""
    refuse_other_laws(plan.autopilot)
    refuse_misfit(plan.autopilot, plan.vehicle)
    try:
        sensors_of(plan.sensors, plan.vehicle)
    except TrialError as error:
        raise CampaignError(f"{where}, key sensors: {error}") from None
    needed = [name for name, facts in plan.vehicle.actuator_info().items() if facts["needs_voltage"]]
    if needed and plan.table.voltage_v is None:
        raise CampaignError(
            f"{where}: the thrust of {plan.vehicle.name} ({needed[0]}) depends on the supply voltage; add"
            " voltage_v, in V"
        )
    if plan.current_m_s >= plan.top_m_s:
        raise CampaignError(
            f"{where}, key current_m_s: expected less than the top speed of {plan.vehicle.name},"
            f" {plan.top_m_s:.2f} m/s, found {plan.current_m_s:g}; no set point is reached against it"
        )
