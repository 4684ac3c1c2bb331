"""`verify_log`: a verdict on the log of a mission, with a campaign or without.

Tests: ``test_recorded_verdict.py`` and ``test_recorded_campaign.py`` in ``tests/verification/``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from numpy.typing import ArrayLike

from seatrial.base.blas_threads import one_blas_thread
from seatrial.base.errors import CampaignError
from seatrial.campaign.campaign import Campaign
from seatrial.verification.mission_log.campaign import verify_campaign_log
from seatrial.verification.mission_log.candidates import PAYLOAD_DENSITY
from seatrial.verification.mission_log.judge_log import judge_log
from seatrial.verification.mission_log.validity import LEVEL

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.campaign.verification_table import Obstacle
    from seatrial.control_design.corridor import Corridor
    from seatrial.flight.mission import Mission
    from seatrial.identification.fitted import Fitted
    from seatrial.identification.identification import Identification
    from seatrial.trial.trial import Input, Trial
    from seatrial.verification.mission_log.log import MissionLog
    from seatrial.verification.mission_log.spread import Spread
    from seatrial.verification.mission_log.verdict import LogVerdict
    from seatrial.verification.requirement import Requirement

_OF_A_CAMPAIGN = (
    *("reference", "requirements", "corridors", "obstacles", "sensors"),
    *("start_s", "stop_s", "input", "seed"),
)
"""What a campaign says itself."""


@overload
def verify_log(
    fitted: Fitted | Identification | Vehicle | str | Path,
    log: MissionLog | Trial | str | Path,
    *,
    reference: Trial | Sequence[Trial] | Spread | Mapping[str, float] | None = None,
    autopilot: Autopilot | str | Path | None = None,
    mission: Mission | str | Path | None = None,
    requirements: Sequence[Requirement] = (),
    corridors: Mapping[str, Corridor] | None = None,
    obstacles: Sequence[Obstacle] | None = None,
    sensors: Any = None,
    current: ArrayLike | None = None,
    ahead_s: float = 10.0,
    start_s: float | None = None,
    stop_s: float | None = None,
    input: Input | None = None,
    draws: int = 4096,
    flights: int = 64,
    seed: int = 0,
    level: float = LEVEL,
    payload_density_kg_m3: float = PAYLOAD_DENSITY,
) -> LogVerdict: ...


@overload
def verify_log(
    campaign: Campaign,
    fit: Fitted | Identification | Vehicle | str | Path,
    log: str | Path,
    /,
    *,
    references: Sequence[str | Path] = (),
    autopilot: Autopilot | str | Path | None = None,
    mission: Mission | str | Path | None = None,
    current: ArrayLike | None = None,
    ahead_s: float = 10.0,
    draws: int = 4096,
    flights: int = 64,
    level: float = LEVEL,
    payload_density_kg_m3: float = PAYLOAD_DENSITY,
) -> LogVerdict: ...


def verify_log(
    fitted: Any,
    log: Any,
    recorded: str | Path | None = None,
    *,
    references: Sequence[str | Path] = (),
    autopilot: Autopilot | str | Path | None = None,
    mission: Mission | str | Path | None = None,
    current: ArrayLike | None = None,
    ahead_s: float = 10.0,
    draws: int = 4096,
    flights: int = 64,
    level: float = LEVEL,
    payload_density_kg_m3: float = PAYLOAD_DENSITY,
    **own: Any,
) -> LogVerdict:
    """Verdict on a log: is the model still valid, what is suspected, what did the mission hold.

    ``verify_log(fitted, log, ...)`` or, by a campaign's trials, requirements, corridors and sensors,
    ``verify_log(campaign, fit, log, ...)``.

    Parameters
    ----------
    fitted : Fitted, Identification, Vehicle, str or Path; or Campaign
        The model, with its covariance where there is one. With a campaign, the model comes next.
    log : MissionLog, Trial, str or Path; or what is known of the vehicle
        What was recorded, with commands; closed or open loop.
    recorded : str or Path
        With a campaign: the log. A run directory of `seatrial fly`, a file, or the name of a trial, of which
        the part is judged that was held out.
    references : sequence of str or Path, optional
        With a campaign: logs on which the model is known to hold, instead of the campaign's trials.
    reference : Trial, sequence of Trial, Spread or mapping, optional
        Logs on which the model is known to hold, or the root mean square error of each channel there, SI.
        Without it the log's own noise counts alone, which suits no real vehicle well.
    autopilot, mission : optional
        What was flown; both together give the closed-loop envelope, the mission alone the metrics.
    requirements : sequence of Requirement, optional
        On the metrics of the log's own mission.
    corridors : mapping of str to Corridor, optional
        By loop, for the steps of logged set points.
    obstacles : sequence of Obstacle, optional
        What stands in the water besides the mission's own, for ``clearance_m``.
    sensors, current : optional
        As for `seatrial.fly`. The sensors' offsets belong to the band, those of "typical" ones when omitted;
        both are those of the envelope.
    ahead_s : float, optional
        Time after which the prediction restarts from the log, s.
    start_s, stop_s : float, optional
        Part of the log to judge the model by.
    input : str, optional
        What drives the model: "commands", "measured" or "tau".
    draws, flights, seed : int, optional
        Draws of the coefficients, at least 12 over the level; flights of the envelope.
    level : float, optional
        Chance of a false alarm, over all channels.
    payload_density_kg_m3 : float, optional
        kg/m3, of a suspected payload.

    Raises
    ------
    TrialError
        The log has no inputs, or cannot be read.
    SimulationError, CampaignError, VehicleError
        A part of the mission is not usable.
    """
    shared: dict[str, Any] = {
        "autopilot": autopilot,
        "mission": mission,
        "current": current,
        "ahead_s": ahead_s,
        "draws": draws,
        "flights": flights,
        "level": level,
        "payload_density_kg_m3": payload_density_kg_m3,
    }
    if not isinstance(fitted, Campaign):
        if recorded is not None or references:
            raise CampaignError(
                "verify_log: expected a Campaign before a vehicle and a log, found"
                f" {type(fitted).__name__}; give verify_log(fitted, log, reference=...) without a campaign"
            )
        with one_blas_thread():
            return judge_log(fitted, log, **shared, **own)
    if recorded is None:
        raise CampaignError("verify_log: expected verify_log(campaign, fit, log), found no log; give it last")
    if given := [key for key in _OF_A_CAMPAIGN if key in own]:
        raise CampaignError(
            f"{given[0]}: expected only without a campaign, found it beside {fitted.source}; write it into"
            " the campaign's file"
        )
    with one_blas_thread():
        return verify_campaign_log(fitted, log, recorded, references=references, **shared, **own)[0]
