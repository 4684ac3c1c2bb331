"""`verify_log`: does the model still hold on the log of a mission, and did the mission do what it had to.

Tests: ``tests/test_recorded_verdict.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from seatrial.errors import SimulationError
from seatrial.fitted import Fitted
from seatrial.recorded.candidates import PAYLOAD_DENSITY, candidates
from seatrial.recorded.log_figures import log_figures
from seatrial.recorded.log_verdict import JudgedRequirement, LogVerdict, Outcome
from seatrial.recorded.mission_log import MissionLog
from seatrial.recorded.offsets import offsets_of
from seatrial.recorded.power import detectable_changes
from seatrial.recorded.restarts import Restarts, restarts
from seatrial.recorded.set_point_steps import logged_steps
from seatrial.recorded.spread import Spread, spread_of_errors, spread_of_noise, spread_of_reference
from seatrial.recorded.suspects import Suspect, suspects
from seatrial.recorded.validity import FEWEST_WINDOWS, LEVEL, Validity, validity
from seatrial.recording.columns import CHANNELS
from seatrial.trial import Trial

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.identification import Identification
    from seatrial.mission import Mission
    from seatrial.recorded.log_verdict import Detectable
    from seatrial.trial import Input
    from seatrial.tuning.corridor import Corridor
    from seatrial.verification.requirement import Requirement
    from seatrial.verification.verification_file import Obstacle

__all__ = ["verify_log"]

_TOLD = 0.5
"""A log that would show none of the usual changes with this chance is too quiet."""


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
    notes: list[str] = []
    windows = restarts(
        known.vehicle, record.trial, ahead_s=ahead_s, start_s=start_s, stop_s=stop_s, input=input
    )
    flown = _loaded(mission)
    figures = log_figures(record, flown, known.vehicle, obstacles=obstacles)
    outcome, reason, judged, guilty, shown = _model(
        known,
        windows,
        reference,
        (draws, seed, level, payload_density, ahead_s),
        offsets_of("typical" if sensors is None else sensors, known.vehicle),
        notes,
    )
    steps = logged_steps(record, corridors or {})
    notes += _without_steps(corridors or {}, [step.loop for step in steps])
    envelope, pilot = None, _pilot(autopilot)
    if pilot is not None and flown is not None:
        from seatrial.recorded.envelope import mission_envelope

        envelope = mission_envelope(
            known, record, pilot, flown, flights=flights, seed=seed, sensors=sensors, current=current
        )
    return LogVerdict(
        log=record,
        outcome=outcome,
        reason=reason,
        validity=judged,
        suspects=guilty,
        detectable=shown,
        figures=figures,
        requirements=tuple(_required(one, figures) for one in requirements),
        steps=steps,
        envelope=envelope,
        notes=tuple(notes),
        vehicle=known.vehicle,
        autopilot=pilot,
        mission=flown,
    )


def _model(
    known: Fitted,
    windows: Restarts,
    reference: Any,
    settings: tuple[int, int, float, float, float],
    offsets: Mapping[str, float],
    notes: list[str],
) -> tuple[Outcome, str, Validity | None, tuple[Suspect, ...], tuple[Detectable, ...]]:
    """Outcome, reason, validity, suspects and what the log would have shown."""
    draws, seed, level, density, ahead_s = settings
    count = len(windows.spans)
    if not all(np.isfinite(one).all() for one in windows.predicted):
        reason = "The prediction diverges: the model cannot be this vehicle's, or its step is too long."
        return "re-identify", reason, None, (), ()
    if count < FEWEST_WINDOWS:
        reason = f"{count} windows of {ahead_s:g} s are too few; fly at least {2 * FEWEST_WINDOWS} of them."
        return "log too short or too quiet to tell", reason, None, (), ()
    spread = _spread(reference, windows, ahead_s)
    if reference is None:
        notes.append(
            "No reference was given: the band holds the log's own noise and the coefficients' spread, but not"
            " what every model leaves out; give a log on which the model is known to hold."
        )
    if not known.names:
        notes.append("The coefficients' covariance is not known: they count as exact.")
    notes.extend(known.notes)
    drawn = known.draws(draws, seed) if known.names else None
    judged = validity(windows, spread, draws=drawn, offsets=offsets, level=level)
    shown = detectable_changes(judged, level=level)
    failing = judged.failing
    if failing:
        sigma = dict(zip(known.names, np.sqrt(np.diag(known.covariance)), strict=True))
        tried = candidates(known.vehicle, identified=known.names, payload_density=density)
        guilty = suspects(windows, spread, tried, sigma=sigma)
        listed = "; ".join(one.sentence() for one in failing[:3])
        text = f"The log leaves the model's band in {_some(len(failing))}: {listed}."
        if guilty:
            text += f" Suspected first: {guilty[0].change}."
        return "re-identify", text, judged, guilty, shown
    if max((one.power for one in shown), default=0.0) < _TOLD:
        best = max(shown, key=lambda one: one.power)
        reason = (
            f"The log stays inside the band, but it would hardly have shown any change ({best.change} with a"
            f" chance of {100.0 * best.power:.0f} %): fly longer and faster, and change speed and depth."
        )
        return "log too short or too quiet to tell", reason, judged, (), shown
    blind = [one.change for one in shown if one.power < _TOLD]
    reason = (
        f"{100.0 * judged.outside:.1f} % of the log is outside the model's 95 % band,"
        " no channel by more than chance."
    )
    if blind:
        reason += f" It says nothing of {', '.join(blind)}."
    return "model still valid", reason, judged, (), shown


def _spread(reference: Any, windows: Restarts, ahead_s: float) -> Spread:
    if reference is None:
        return spread_of_noise(windows)
    if isinstance(reference, Spread):
        return reference
    if isinstance(reference, Mapping):
        return spread_of_errors(reference, windows)
    given = [reference] if isinstance(reference, Trial) else list(reference)
    return spread_of_reference([
        restarts(windows.vehicle, one, ahead_s=ahead_s, input=windows.input) for one in given
    ])


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


def _some(count: int) -> str:
    return "one channel" if count == 1 else f"{count} channels"
