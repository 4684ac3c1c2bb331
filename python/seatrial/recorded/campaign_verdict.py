"""A verdict on a log by what a campaign asks for: its vehicle, trials, requirements and corridors.

Tests: ``tests/test_recorded_campaign.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seatrial.errors import CampaignError
from seatrial.fitted import Fitted
from seatrial.recorded.campaign_log import CampaignLog, campaign_log
from seatrial.recorded.campaign_reference import campaign_reference
from seatrial.recorded.judge_log import verify_log
from seatrial.recorded.restarts import check_usable
from seatrial.sensors.sensor_file import TYPICAL
from seatrial.verification.checked_table import requirement_of, sensors_of_table

if TYPE_CHECKING:
    from seatrial._core import Autopilot
    from seatrial.campaign import Campaign
    from seatrial.mission import Mission
    from seatrial.recorded.log_verdict import LogVerdict
    from seatrial.tuning.corridor import Corridor

__all__ = ["verify_campaign_log"]

_LOGGED_LOOPS = ("surge", "sway", "heave", "pitch", "heading", "depth")


def verify_campaign_log(
    campaign: Campaign,
    fit: Any,
    source: str | Path,
    *,
    autopilot: Autopilot | str | Path | None = None,
    mission: Mission | str | Path | None = None,
    references: Sequence[str | Path] = (),
    ahead_s: float = 10.0,
    **options: Any,
) -> tuple[LogVerdict, CampaignLog]:
    """Verdict on a log by the requirements and corridors of a campaign, and what is known of the log.

    Parameters
    ----------
    campaign : Campaign
    fit : Fitted, Identification, Vehicle, str or Path
        What is known of the vehicle.
    source : str or Path
        As for `campaign_log`.
    autopilot, mission : optional
        What was flown, where it does not lie beside the log.
    references : sequence of str or Path, optional
        As names of `campaign_reference`.
    ahead_s : float, optional
        Time after which the prediction restarts from the log, s.
    options
        Further keywords of `seatrial.recorded.verify_log`.

    Raises
    ------
    TrialError, CampaignError, SimulationError, VehicleError
        Something cannot be used.
    """
    known = Fitted.of(fit)
    if set(known.vehicle.actuators) != set(campaign.vehicle.actuators):
        raise CampaignError(
            f"{campaign.source}: expected a fit of {campaign.vehicle.name}, found one of"
            f" {known.vehicle.name} with other actuators; give the run directory of this campaign"
        )
    judged = campaign_log(campaign, source)
    check_usable(judged.log.trial, ahead_s)  # before a reference of the same interval is refused
    table = campaign.file.verification
    asked = () if table is None else table.requirements
    start, stop = (None, None) if judged.span is None else judged.span
    found = verify_log(
        known,
        judged.log,
        reference=campaign_reference(campaign, known, judged, ahead_s=ahead_s, names=references),
        autopilot=judged.autopilot if autopilot is None else autopilot,
        mission=judged.mission if mission is None else mission,
        requirements=[requirement_of(campaign.source, one) for one in asked],
        corridors=_corridors(campaign),
        obstacles=None if table is None else table.obstacles,
        sensors=_sensors(campaign),
        ahead_s=ahead_s,
        start_s=start,
        stop_s=stop,
        input=judged.input,
        seed=campaign.seed,
        **options,
    )
    return found, judged


def _corridors(campaign: Campaign) -> dict[str, Corridor]:
    """Corridors that the campaign states, of loops whose set points a log may tell."""
    table = campaign.file.tuning
    given = {} if table is None else table.loops.given()
    return {
        loop: one.corridor.corridor(one.weights)
        for loop, one in given.items()
        if one.corridor is not None and loop in _LOGGED_LOOPS
    }


def _sensors(campaign: Campaign) -> str | Path | None:
    """Sensors of the campaign's verification: their offsets belong to the band."""
    table = campaign.file.verification
    return TYPICAL if table is None else sensors_of_table(campaign, table.sensors)
