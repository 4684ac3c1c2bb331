"""`verify_log`: does a model still hold on the log of a mission, and did the mission do what it had to.

A current that was not recorded is no change of the vehicle: where it explains the log best, it is fitted to
the log and the model judged again in it. What such a fit could hide counts as not shown. Held by
``test_recorded_verdict.py``, ``test_recorded_validity.py`` and ``test_recorded_current.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.channels import AXES, CHANNELS
from seatrial.base.errors import CampaignError, SimulationError
from seatrial.base.finding import Finding, Severity
from seatrial.base.toml_file import loaded
from seatrial.base.work import Clock, one_blas_thread, takes
from seatrial.flight.mission import Mission
from seatrial.identification.fitted import Fitted
from seatrial.inspect.verdict import blind, judge_trial
from seatrial.trial.trial import Trial
from seatrial.verification.mission_log.log import MissionLog, log_metrics, logged_steps, offsets_of
from seatrial.verification.mission_log.power import Power, group_power
from seatrial.verification.mission_log.spread import (
    PredictedLog,
    Spread,
    restarts,
    spread_of_errors,
    spread_of_noise,
    spread_of_reference,
)
from seatrial.verification.mission_log.suspects import (
    SUSPECT_SETTINGS,
    Suspect,
    candidates,
    in_current,
    suspects,
)
from seatrial.verification.mission_log.validity import VALIDITY_SETTINGS, Validity, contradictions, validity
from seatrial.verification.mission_log.verdict import (
    JudgedRequirement,
    LogVerdict,
    ModelState,
    mission_envelope,
)
from seatrial.verification.scenario import autopilot_of

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.control_design.corridor import Corridor
    from seatrial.identification.identification import Identification
    from seatrial.trial.trial import Input
    from seatrial.verification.requirement import Requirement
    from seatrial.verification.table import Obstacle


@dataclass(frozen=True)
class JudgementSettings:
    """When no single change of the vehicle explains a log: both must hold."""

    left_ratio: float = 2.0  #: Error that the best suspect leaves, over the usual error of a valid model.
    explained_share: float = 0.9  #: Share of the misfit that the best suspect explains at least.


SETTINGS = JudgementSettings()

_QUIET: ModelState = "log too short or too quiet to tell"


@dataclass(frozen=True, kw_only=True)
class LogSettings:
    """How a log judges a model.

    Attributes
    ----------
    ahead_s : float
        Time after which the prediction restarts from the log, s.
    start_s, stop_s : float, optional
        Part of the log to judge the model by.
    input : str, optional
        What drives the model: "commands", "measured" or "tau".
    draws, flights, seed : int
        Draws of the coefficients, at least 12 over the level; flights of the envelope.
    level : float
        Chance of a false alarm, over all channels.
    payload_density_kg_m3 : float
        kg/m3, of a suspected payload.

    Examples
    --------
    >>> import seatrial as st
    >>> st.LogSettings(stop_s=60.0).ahead_s
    10.0
    """

    ahead_s: float = 10.0
    start_s: float | None = None
    stop_s: float | None = None
    input: Input | None = None
    draws: int = 4096
    flights: int = 64
    seed: int = 0
    level: float = VALIDITY_SETTINGS.level
    payload_density_kg_m3: float = SUSPECT_SETTINGS.payload_density


USUAL = LogSettings()
"""The whole log, with the usual draws."""


@dataclass(frozen=True, eq=False)
class ModelJudgement:
    """What a log says of the model; attributes as those of `LogVerdict`."""

    model: ModelState
    cause: Finding
    validity: Validity | None = None
    suspects: tuple[Suspect, ...] = ()
    power: Power | None = None
    remarks: tuple[Finding, ...] = ()
    current: tuple[float, float] | None = None


def judge_model(
    known: Fitted,
    windows: PredictedLog,
    reference: Any,
    settings: LogSettings,
    *,
    offsets: Mapping[str, float],
    hidden: str = "",
) -> ModelJudgement:
    """Judgement of a model by a log, as `seatrial.verify_log` explains its parameters.

    Raises TrialError where the reference cannot be used.
    """
    count, ahead_s, level = len(windows.spans), settings.ahead_s, settings.level
    if not all(np.isfinite(shown).all() for shown in windows.predicted):
        return ModelJudgement("re-identify", _because("prediction diverges"))
    if count < (fewest := VALIDITY_SETTINGS.fewest_windows):
        cause = _because("too few windows", windows=count, ahead_s=ahead_s, needed=2 * fewest)
        return ModelJudgement("not judged", cause)
    spread = _spread(reference, windows, ahead_s)
    windows = windows.without(hidden)
    if not windows.channels:
        return ModelJudgement("not judged", _because("every axis answers waves"))
    # What was not known of the model and of its usual error.
    missing = {"no reference": reference is None, "covariance unknown": not known.names}
    remarks = (
        *(Finding(kind, Severity.NOTE) for kind, lacks in missing.items() if lacks),
        *(Finding("fit", Severity.NOTE, values={"note": note}) for note in known.notes),
    )
    drawn = known.draws(settings.draws, settings.seed) if known.names else None
    stated = reference if isinstance(reference, Mapping) else None
    water = windows.trial.current is None

    def power_on(log: PredictedLog) -> Power:
        return group_power(
            known,
            log,
            offsets=offsets,
            level=level,
            stated=stated,
            hidden=hidden,
            water=water,
            lacking=reference is not None,
        )

    judged, power = validity(windows, spread, draws=drawn, offsets=offsets, level=level), power_on(windows)
    if reference is None:
        judged = settled(judged, power)
    sigma = dict(zip(known.names, np.sqrt(np.diag(known.covariance)), strict=True))
    density = settings.payload_density_kg_m3
    tried = candidates(known.vehicle, identified=known.names, payload_density_kg_m3=density)
    if not judged.failing:
        listed = suspects(windows, spread, tried, sigma=sigma, current=water) if power.refuted else ()
        return _not_failing(judged, power, remarks, listed)
    guilty, current = suspects(windows, spread, tried, sigma=sigma), None
    if water:
        # A current that was not recorded is no change of the vehicle: it is fitted, and the model judged in
        # it.
        calm, fitted = in_current(windows, spread)
        in_it = validity(calm, spread, draws=drawn, offsets=offsets, level=level)
        if guilty and guilty[0].kind == "surroundings":
            windows, judged, current, power = calm, in_it, fitted, power_on(calm)
            if not judged.failing:
                listed = suspects(windows, spread, tried, sigma=sigma, current=False) if power.refuted else ()
                return _not_failing(judged, power, remarks, listed, current)
            guilty = suspects(windows, spread, tried, sigma=sigma, current=False)
        elif not in_it.failing:
            cause = _because("vehicle or water", north_m_s=fitted[0], east_m_s=fitted[1])
            return ModelJudgement(_QUIET, cause, judged, guilty, power_on(calm), remarks)
    explained = bool(guilty) and (
        guilty[0].left <= SETTINGS.left_ratio or guilty[0].gain >= SETTINGS.explained_share
    )
    cause = _because("outside the band", explained=explained)
    return ModelJudgement("re-identify", cause, judged, guilty, power, remarks, current)


def _because(kind: str, **values: Any) -> Finding:
    """Why a model has its state."""
    return Finding(kind, Severity.PROBLEM, values=values)


def _not_failing(
    judged: Validity,
    power: Power,
    remarks: tuple[Finding, ...],
    suspects: tuple[Suspect, ...],
    current: tuple[float, float] | None = None,
) -> ModelJudgement:
    """Inside the band: valid where the log could have refuted the model on each controlled axis."""
    model, cause = state_inside(judged, power)
    listed = suspects if model == "re-identify" else ()
    return ModelJudgement(model, cause, judged, listed, power, remarks, current)


def settled(judged: Validity, power: Power) -> Validity:
    """Validity without a reference, where no channel fails whose error within seconds is that of its noise.

    Such a band holds what the noise does to a start. The smoothed start of a vehicle that turns and rolls
    quickly errs by more, which grows until the next restart; `power` fits each start and does not err by it.
    """
    channels = {
        name: channel if power.doubts(name) else replace(channel, fails=False)
        for name, channel in judged.channels.items()
    }
    return replace(judged, channels=channels)


def state_inside(judged: Validity, power: Power) -> tuple[ModelState, Finding]:
    """State of a model whose log stays inside the band, and why."""
    if power.refuted:
        return "re-identify", _because("coefficients refuted")
    # What the noise of the sensors explains within seconds is no doubt of the model.
    doubts = [name for name, channel in judged.channels.items() if channel.doubtful and power.doubts(name)]
    if doubts:
        return _QUIET, _because("channels in doubt", channels=doubts)
    if power.unexplained:
        return "not judged", _because("error unexplained")
    if power.unjudged:
        return "not judged", _because("axes unjudged")
    return "model still valid", Finding("inside the band", Severity.NOTE)


def _spread(reference: Any, windows: PredictedLog, ahead_s: float) -> Spread:
    """Spread of a valid model's errors by what was given as reference."""
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


@takes(settings=LogSettings)
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
    settings: LogSettings = USUAL,
) -> LogVerdict:
    """Verdict on a log: is the model still valid, what is suspected, what did the mission hold.

    By a campaign's trials, requirements, corridors and sensors: ``Campaign.load(file).judge_log(fit, log)``.

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
        What was flown; both together give the closed-loop envelope, the mission alone the metrics.
    requirements : sequence of Requirement, optional
        On the metrics of the log's own mission.
    corridors : mapping of str to Corridor, optional
        By loop, for the steps of logged set points.
    obstacles : sequence of Obstacle, optional
        What stands in the water besides the mission's own, for ``clearance_m``.
    sensors, current : optional
        As of `Conditions` and `Water`. The sensors' offsets belong to the band, those of "typical" ones when
        omitted; both are those of the envelope.
    settings : LogSettings, optional
        Which part of the log is judged, and how.

    Raises
    ------
    TrialError
        The log has no inputs, or cannot be read.
    SimulationError, CampaignError, VehicleError
        A part of the mission is not usable.
    """
    if callable(getattr(fitted, "judge_log", None)):
        raise CampaignError("verify_log: found a campaign; use campaign.judge_log(fit, log)")
    if settings.draws < len(CHANNELS) / settings.level:
        raise SimulationError(
            f"draws: expected at least {len(CHANNELS) / settings.level:.0f}, for a p-value of"
            f" {settings.level:g} over {len(CHANNELS)} channels, found {settings.draws}; draw more"
        )
    with one_blas_thread():
        clock = Clock()
        known = Fitted.of(fitted)
        flown = None if mission is None else loaded(Mission, mission)
        if isinstance(log, MissionLog):
            record = log
        else:
            record = MissionLog.of(log) if isinstance(log, Trial) else MissionLog.read(log)
        hidden = blind(judge_trial(record.trial, known.vehicle))
        windows = restarts(
            known.vehicle,
            record.trial,
            ahead_s=settings.ahead_s,
            start_s=settings.start_s,
            stop_s=settings.stop_s,
            input=settings.input,
        )
        metrics = log_metrics(record, flown, known.vehicle, obstacles=obstacles)
        offsets = offsets_of("typical" if sensors is None else sensors, known.vehicle)
        # Sensors that contradict one another judge no model.
        wrong = contradictions(record.trial, windows.channels)
        judged = (
            ModelJudgement("not judged", _because("sensors contradict"))
            if wrong
            else judge_model(known, windows, reference, settings, offsets=offsets, hidden=hidden)
        )
        steps = logged_steps(record, corridors or {})
        remarks = (*judged.remarks, *_without_steps(corridors or {}, [step.loop for step in steps]))
        envelope, pilot = None, None if autopilot is None else autopilot_of(autopilot)
        # Only what was flown can be flown again, in the current that explains the log where none is given.
        if pilot is not None and flown is not None:
            if current is None and judged.current is not None:
                current = [*judged.current, 0.0]
            envelope = mission_envelope(
                known,
                record,
                pilot,
                flown,
                flights=settings.flights,
                seed=settings.seed,
                sensors=sensors,
                current=current,
            )
        return LogVerdict(
            log=record,
            model=judged.model,
            cause=judged.cause,
            hidden=() if wrong else _unjudging(hidden, record.trial),
            contradictions=wrong,
            validity=judged.validity,
            suspects=judged.suspects,
            power=judged.power,
            metrics=metrics,
            requirements=tuple(_required(requirement, metrics) for requirement in requirements),
            steps=steps,
            envelope=envelope,
            remarks=remarks,
            current=judged.current,
            vehicle=known.vehicle,
            autopilot=pilot,
            mission=flown,
            clock=clock.stop(),
        )


def _unjudging(axes: str, trial: Trial) -> tuple[str, ...]:
    """Channels of axes whose commands answer waves and noise, which a replay does not have."""
    return tuple(
        name for place, name in enumerate(CHANNELS) if AXES[place % 6] in axes and name in trial.channels
    )


def _required(requirement: Requirement, metrics: Mapping[str, Any]) -> JudgedRequirement:
    """A requirement on the one mission of the log."""
    requirement.check()
    missing = tuple(name for name in requirement.metrics if name not in metrics)
    if missing:
        return JudgedRequirement(requirement.name, requirement.holds, None, float("nan"), "", missing)
    found = requirement.judge({name: [metrics[name]] for name in requirement.metrics})
    reserve = float(found.reserve[0])
    return JudgedRequirement(requirement.name, requirement.holds, bool(found.held[0]), reserve, found.unit)


def _without_steps(corridors: Mapping[str, Corridor], seen: Sequence[str]) -> list[Finding]:
    """Corridors for which the log holds no step."""
    least = {name: corridor.until_s for name, corridor in corridors.items() if name not in seen}
    return [Finding("no step", Severity.NOTE, values={"until_s": least})] if least else []
