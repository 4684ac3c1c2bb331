"""`verify_log`: does the model still hold on the log of a mission, and did the mission do what it had to.

Tests: ``tests/test_recorded_verdict.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from seatrial.errors import SimulationError
from seatrial.fitted import Fitted
from seatrial.recorded.candidates import PAYLOAD_DENSITY
from seatrial.recorded.judge_model import judge_model
from seatrial.recorded.log_figures import log_figures
from seatrial.recorded.log_verdict import JudgedRequirement, LogVerdict
from seatrial.recorded.mission_log import MissionLog
from seatrial.recorded.offsets import offsets_of
from seatrial.recorded.restarts import restarts
from seatrial.recorded.set_point_steps import logged_steps
from seatrial.recorded.validity import LEVEL
from seatrial.recording.columns import CHANNELS
from seatrial.trial import Trial

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.identification import Identification
    from seatrial.mission import Mission
    from seatrial.recorded.spread import Spread
    from seatrial.trial import Input
    from seatrial.tuning.corridor import Corridor
    from seatrial.verification.requirement import Requirement
    from seatrial.verification.verification_file import Obstacle

__all__ = ["verify_log"]


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
    payload_density: float = PAYLOAD_DENSITY,
) -> LogVerdict:
    """Verdict on a log: is the model still valid, what is suspected, what did the mission hold.

    Parameters
    ----------
    fitted : Fitted, Identification, Vehicle, str or Path
        The model, with its covariance where there is one.
    log : MissionLog, Trial, str or Path
        What was recorded, with commands; closed or open loop.
    reference : Trial, sequence of Trial, Spread or mapping, optional
        Logs on which the model is known to hold, or the root mean square error of each channel there, SI.
        Without it the log's own noise counts alone, which suits no real vehicle well.
    autopilot, mission : optional
        What was flown; both together give the closed-loop envelope, the mission alone the figures.
    requirements : sequence of Requirement, optional
        On the figures of the log's own mission.
    corridors : mapping of str to Corridor, optional
        By loop, for the steps of logged set points.
    obstacles : sequence of Obstacle, optional
        What stands in the water, for ``clearance_m``; the mission's farms when omitted.
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
    payload_density : float, optional
        kg/m3, of a suspected payload.

    Raises
    ------
    TrialError
        The log has no inputs, or cannot be read.
    SimulationError, CampaignError, VehicleError
        A part of the mission is not usable.
    """
    if draws < len(CHANNELS) / level:
        raise SimulationError(
            f"draws: expected at least {len(CHANNELS) / level:.0f}, for a p-value of {level:g} over"
            f" {len(CHANNELS)} channels, found {draws}; draw more"
        )
    known = Fitted.of(fitted)
    record = _log(log)
    windows = restarts(
        known.vehicle, record.trial, ahead_s=ahead_s, start_s=start_s, stop_s=stop_s, input=input
    )
    flown = _loaded(mission)
    figures = log_figures(record, flown, known.vehicle, obstacles=obstacles)
    judged = judge_model(
        known,
        windows,
        reference,
        draws=draws,
        seed=seed,
        level=level,
        payload_density=payload_density,
        ahead_s=ahead_s,
        offsets=offsets_of("typical" if sensors is None else sensors, known.vehicle),
    )
    steps = logged_steps(record, corridors or {})
    notes = [*judged.notes, *_without_steps(corridors or {}, [step.loop for step in steps])]
    envelope, pilot = None, _pilot(autopilot)
    if pilot is not None and flown is not None:
        from seatrial.recorded.envelope import mission_envelope

        if current is None and judged.current is not None:
            current = [*judged.current, 0.0]
        envelope = mission_envelope(
            known, record, pilot, flown, flights=flights, seed=seed, sensors=sensors, current=current
        )
    return LogVerdict(
        log=record,
        outcome=judged.outcome,
        reason=judged.reason,
        validity=judged.validity,
        suspects=judged.suspects,
        detectable=judged.detectable,
        figures=figures,
        requirements=tuple(_required(one, figures) for one in requirements),
        steps=steps,
        envelope=envelope,
        notes=tuple(notes),
        current=judged.current,
        vehicle=known.vehicle,
        autopilot=pilot,
        mission=flown,
    )


def _required(requirement: Requirement, figures: Mapping[str, Any]) -> JudgedRequirement:
    """A requirement on the one mission of the log."""
    requirement.check()
    missing = tuple(name for name in requirement.figures if name not in figures)
    if missing:
        return JudgedRequirement(requirement.name, requirement.holds, None, float("nan"), "", missing)
    found = requirement.judge({name: [figures[name]] for name in requirement.figures})
    reserve = float(found.reserve[0])
    return JudgedRequirement(requirement.name, requirement.holds, bool(found.held[0]), reserve, found.unit)


def _log(source: Any) -> MissionLog:
    if isinstance(source, MissionLog):
        return source
    return MissionLog.of(source) if isinstance(source, Trial) else MissionLog.read(source)


def _loaded(mission: Any) -> Mission | None:
    if mission is None:
        return None
    from seatrial.file_kind import loaded
    from seatrial.mission import Mission

    found: Mission = loaded(Mission, mission)
    return found


def _pilot(autopilot: Any) -> Autopilot | None:
    if autopilot is None:
        return None
    from seatrial.verification.verified_campaign import autopilot_of

    return autopilot_of(autopilot)


def _without_steps(corridors: Mapping[str, Corridor], seen: Sequence[str]) -> list[str]:
    """A sentence on corridors for which the log holds no step."""
    least = {name: one.until_s for name, one in corridors.items() if name not in seen}
    if not least:
        return []
    listed = ", ".join(f"{name} ({until:g} s)" for name, until in least.items())
    return [f"The log holds no set-point step that stands until its corridor ends: {listed}."]
