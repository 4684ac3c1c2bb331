"""The conduct of a tuning: what cannot be tuned is refused, the run is made, its results are left behind.

The run itself is `seatrial.tuning.tuning_run`. Held by tests/test_tune.py.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from seatrial.errors import CampaignError, TrialError
from seatrial.flight.sensor_channels import sensors_of
from seatrial.progress import Progress
from seatrial.tuning.margin_constraint import refuse_other_laws
from seatrial.tuning.tuning_plan import TuningPlan
from seatrial.tuning.tuning_result import Tuning
from seatrial.tuning.tuning_run import TuningRun
from seatrial.whole_file import write_whole

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.campaign import Campaign
    from seatrial.fitted import Fitted
    from seatrial.identification import Identification
    from seatrial.run_directory import RunDirectory

__all__ = ["conduct", "plan_of"]

_ANY_MISSION = """
format = 1
name = "fit"
speed_m_s = 1.0
acceptance_radius_m = 1.0
[[legs]]
north_m = 100.0
east_m = 0.0
"""


def conduct(
    campaign: Campaign,
    fit: Identification | Fitted | Vehicle | str | Path | None,
    *,
    run_dir: str | Path | None,
    progress: Callable[[Progress], None] | None,
    resume: bool,
    relay: bool,
    threads: int | None,
) -> Tuning:
    """Tuning of a campaign; see `seatrial.tune`."""
    from seatrial.run_directory import RunDirectory

    plan = plan_of(campaign, fit)
    assert plan.groups is not None  # what cannot be tuned is refused before a directory is made
    directory = None if run_dir is None else RunDirectory(run_dir)
    try:
        found = TuningRun(campaign, plan, directory, progress, threads, resume).run(relay=relay)
    except BaseException:
        if directory is not None:
            directory.abandon()
        raise
    if directory is None:
        return found
    if found.interrupted:
        return _left_behind(found, directory)
    found.publish(directory)
    return found


def _left_behind(found: Tuning, directory: RunDirectory) -> Tuning:
    """An interrupted tuning, after the best gains so far are an autopilot file beside the finished groups."""
    if not found.groups:
        directory.abandon()
        return found
    path = directory.workspace / "autopilot.toml"
    try:
        write_whole(path, found.autopilot.to_toml().encode())
    except OSError:  # the gains are in what is returned all the same
        return found
    return replace(found, kept=path)


def plan_of(
    campaign: Campaign, fit: Identification | Fitted | Vehicle | str | Path | None = None
) -> TuningPlan:
    """What a tuning of a campaign does, before it is done. Takes and raises what `tune` does."""
    from seatrial.fitted import Fitted
    from seatrial.tuning.tuning_file import TuningTable

    table = campaign.file.tuning or TuningTable()
    fitted = Fitted.of(campaign.vehicle if fit is None else fit)
    sensors = table.sensors
    if sensors not in ("typical", "perfect"):
        table = table.model_copy(update={"sensors": str(campaign.beside(sensors, "tuning.sensors"))})
    autopilot = campaign.autopilot
    here = set(fitted.vehicle.actuators)
    if here != set(campaign.vehicle.actuators):
        raise CampaignError(
            f"{campaign.source}: expected a fit of {campaign.vehicle.name}, found one of"
            f" {fitted.vehicle.name} with other actuators; give the run directory of this campaign"
        )
    plan = TuningPlan(table, fitted, autopilot)
    _refuse_what_cannot_fly(plan, f"{campaign.source}: tuning")
    return plan


def _refuse_what_cannot_fly(plan: TuningPlan, where: str) -> None:
    """Refuse before the search, and before a directory is made, what its first flight would refuse."""
    from seatrial._core import Mission

    refuse_other_laws(plan.autopilot)
    plan.autopilot.engage(plan.vehicle, Mission.from_toml(_ANY_MISSION))
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
