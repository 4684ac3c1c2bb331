"""`verify_log`: does a model still hold on the log of a mission, and did the mission do what it had to.

A current that was not recorded is no change of the vehicle: where it explains the log best, it is fitted to
the log (`seatrial.verification.mission_log.suspects`) and the model judged again in it. What such a fit could
hide counts as not shown.

Tests: ``test_recorded_verdict.py``, ``test_recorded_validity.py`` and ``test_recorded_current.py`` in
``tests/verification/``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.blas_threads import one_blas_thread
from seatrial.base.channels import AXES, CHANNELS
from seatrial.base.errors import CampaignError, SimulationError
from seatrial.base.work import Clock, takes
from seatrial.identification.fitted import Fitted
from seatrial.inspect.verdict import blind, judge_trial
from seatrial.trial.trial import Trial
from seatrial.verification.mission_log.candidates import PAYLOAD_DENSITY, Suspect, candidates
from seatrial.verification.mission_log.contradiction import Contradiction, contradictions
from seatrial.verification.mission_log.log import MissionLog, offsets_of
from seatrial.verification.mission_log.metrics import log_metrics, logged_steps
from seatrial.verification.mission_log.power import GROWN, UNEXPLAINED, Power, group_power
from seatrial.verification.mission_log.restarts import PredictedLog, restarts
from seatrial.verification.mission_log.spread import (
    Spread,
    spread_of_errors,
    spread_of_noise,
    spread_of_reference,
)
from seatrial.verification.mission_log.suspects import current_words, in_current, suspects
from seatrial.verification.mission_log.unknowns import HORIZON_S
from seatrial.verification.mission_log.validity import FEWEST_WINDOWS, LEVEL, Validity, validity
from seatrial.verification.mission_log.verdict import JudgedRequirement, LogVerdict, ModelState

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.control_design.corridor import Corridor
    from seatrial.flight.mission import Mission
    from seatrial.identification.identification import Identification
    from seatrial.trial.trial import Input
    from seatrial.verification.requirement import Requirement
    from seatrial.verification.table import Obstacle

_MUCH, _MOST_OF_IT = 2.0, 0.9
"""More than twice the usual error left, and no nine tenths explained, is no single change of the vehicle."""

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
    level: float = LEVEL
    payload_density_kg_m3: float = PAYLOAD_DENSITY


USUAL = LogSettings()
"""The whole log, with the usual draws."""


@dataclass(frozen=True, eq=False)
class ModelJudgement:
    """What a log says of the model; attributes as those of `LogVerdict`."""

    model: ModelState
    reason: str
    validity: Validity | None = None
    suspects: tuple[Suspect, ...] = ()
    power: Power | None = None
    notes: tuple[str, ...] = ()
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

    Raises
    ------
    TrialError
        The reference cannot be used.
    """
    count, ahead_s, level = len(windows.spans), settings.ahead_s, settings.level
    if not all(np.isfinite(one).all() for one in windows.predicted):
        reason = "The prediction diverges: the model cannot be this vehicle's, or its step is too long."
        return ModelJudgement("re-identify", reason)
    if count < FEWEST_WINDOWS:
        many = (
            f"{count} windows of {ahead_s:g} s are too few"
            if count > 1
            else f"One window of {ahead_s:g} s is too few"
        )
        reason = f"{many}; fly at least {2 * FEWEST_WINDOWS} of them, {2 * FEWEST_WINDOWS * ahead_s:g} s."
        return ModelJudgement("not judged", reason)
    spread, notes = _spread(reference, windows, ahead_s), []
    windows = windows.without(hidden)
    if not windows.channels:
        reason = "On every axis commands react to waves: no channel of the log can test a model."
        return ModelJudgement("not judged", reason)
    if reference is None:
        notes.append(
            "No reference was given: the band holds the log's own noise and the coefficients' spread, but not"
            " the usual error of a valid model; give a log on which the model is known to hold."
        )
    if not known.names:
        notes.append("The coefficients' covariance is not known: they count as exact.")
    notes.extend(known.notes)
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
    tried = candidates(
        known.vehicle, identified=known.names, payload_density_kg_m3=settings.payload_density_kg_m3
    )
    if not judged.failing:
        listed = suspects(windows, spread, tried, sigma=sigma, current=water) if power.refuted else ()
        return _not_failing(judged, power, tuple(notes), suspects=listed)
    guilty, current, lead = suspects(windows, spread, tried, sigma=sigma), None, ""
    if water:
        calm, fitted = in_current(windows, spread)
        in_it = validity(calm, spread, draws=drawn, offsets=offsets, level=level)
        first = guilty[0] if guilty else None
        if first is not None and first.kind == "surroundings":
            windows, judged, current, power = calm, in_it, fitted, power_on(calm)
            lead = f"In {current_words(current)}, which was not recorded and is fitted to this log: "
            if not judged.failing:
                listed = suspects(windows, spread, tried, sigma=sigma, current=False) if power.refuted else ()
                return _not_failing(judged, power, tuple(notes), current, lead, suspects=listed)
            guilty = suspects(windows, spread, tried, sigma=sigma, current=False)
        elif not in_it.failing:
            other = "" if first is None else f" as well as this change: {first.change}"
            reason = (
                f"The log cannot tell a changed vehicle from the water: {current_words(fitted)}, which"
                f" was not recorded, explains it{other}. Log the current (zero in a tank), or fly more than"
                " one heading."
            )
            return ModelJudgement(_QUIET, reason, judged, guilty, power_on(calm), tuple(notes))
    failing = judged.failing
    worst = "; ".join(one.sentence() for one in failing[:3])
    text = f"{lead}{'t' if lead else 'T'}he log leaves the model's band in {_some(len(failing))}: {worst}."
    unexplained = not guilty or (guilty[0].left > _MUCH and guilty[0].gain < _MOST_OF_IT)
    text += f" {_NOTHING_EXPLAINS}" if unexplained else f" Suspected first: {guilty[0].change}."
    return ModelJudgement("re-identify", text, judged, guilty, power, tuple(notes), current)


_NOTHING_EXPLAINS = (
    "No single change of the vehicle explains this log: check units, signs and the column map, the water's"
    " density and the supply, and that this vehicle flew it, before you identify anew."
)


def _not_failing(
    judged: Validity,
    power: Power,
    notes: tuple[str, ...],
    current: tuple[float, float] | None = None,
    lead: str = "",
    suspects: tuple[Suspect, ...] = (),
) -> ModelJudgement:
    """Inside the band: valid where the log could have refuted the model on each controlled axis."""
    model, reason = state_inside(judged, power)
    reason = f"{lead}{reason[0].lower()}{reason[1:]}" if lead else reason
    listed = suspects if model == "re-identify" else ()
    return ModelJudgement(model, reason, judged, listed, power, notes, current)


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


def state_inside(judged: Validity, power: Power) -> tuple[ModelState, str]:
    """State of a model whose log stays inside the band, and why."""
    if refuted := power.refuted:
        listed = "; ".join(
            f"{one.group.words} ({', '.join(one.group.names)}) {one.factor:.2g} times as much"
            f" (standard deviation {one.sigma:.2g}, p = {_p(one.p)})"
            for one in refuted[:3]
        )
        return "re-identify", (
            "The log stays inside the band that the references leave, and yet asks for other coefficients"
            f" than the stated intervals allow: {listed}."
        )
    # What the noise of the sensors explains within seconds is no doubt of the model.
    doubts = [one for name, one in judged.channels.items() if one.doubtful and power.doubts(name)]
    if doubtful := [one.sentence() for one in doubts]:
        return _QUIET, (
            "More of the log is outside the band than a valid model should leave, and less than would refute"
            f" it: {'; '.join(doubtful[:3])}. Fly longer, or give longer references."
        )
    if unexplained := power.unexplained:
        listed = ", ".join(
            f"{name} ({power.left[name]:.2g} times the noise, {power.grown[name]:.2g} times its pieces)"
            for name in unexplained
        )
        return "not judged", (
            "The model misses this log by more than the noise of the sensors and the stated intervals explain"
            f" (an error of more than {UNEXPLAINED:g} times the noise, or {GROWN:g} times larger in whole"
            f" windows than in pieces of {HORIZON_S:g} s), and no change of one group of coefficients"
            f" accounts for it: {listed}."
        )
    if unjudged := power.unjudged:
        return "not judged", (
            f"This log could not have refuted the model on every controlled axis: on {', '.join(unjudged)} no"
            " channel would have shown any group of coefficients halved and doubled with 95 % power. Record a"
            f" log that moves {'these axes' if len(unjudged) > 1 else 'this axis'}: change speed, heading,"
            " depth and attitude in steps."
        )
    seen = [one.group.words for one in power.tests if one.enough]
    unseen = [one.group.words for one in power.tests if not one.enough]
    reason = (
        f"{100.0 * judged.outside:.1f} % of the log is outside the model's 95 % band, no channel by more than"
        f" chance. It would have shown half and double of {', '.join(seen)}."
    )
    return "model still valid", f"{reason} It says nothing of {', '.join(unseen)}." if unseen else reason


def _p(p: float) -> str:
    return f"{p:.2g}" if p >= 1e-4 else "below 0.0001"


def _spread(reference: Any, windows: PredictedLog, ahead_s: float) -> Spread:
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


def _some(count: int) -> str:
    return "one channel" if count == 1 else f"{count} channels"


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
        known, record, flown = Fitted.of(fitted), _log(log), _loaded(mission)
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
            ModelJudgement("not judged", _contradicted(wrong[0]))
            if wrong
            else judge_model(known, windows, reference, settings, offsets=offsets, hidden=hidden)
        )
        steps = logged_steps(record, corridors or {})
        notes = [*judged.notes, *_without_steps(corridors or {}, [step.loop for step in steps])]
        envelope, pilot = None, _pilot(autopilot)
        # Only what was flown can be flown again, in the current that explains the log where none is given.
        if pilot is not None and flown is not None:
            from seatrial.verification.mission_log.envelope import mission_envelope

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
            reason=judged.reason + ("" if wrong else _hidden(hidden, record.trial)),
            contradictions=wrong,
            validity=judged.validity,
            suspects=judged.suspects,
            power=judged.power,
            metrics=metrics,
            requirements=tuple(_required(requirement, metrics) for requirement in requirements),
            steps=steps,
            envelope=envelope,
            notes=tuple(notes),
            current=judged.current,
            vehicle=known.vehicle,
            autopilot=pilot,
            mission=flown,
            clock=clock.stop(),
        )


def _contradicted(wrong: Contradiction) -> str:
    """A sentence on the channels that tell of two motions."""
    return f"{wrong.sentence()}: whatever the model, one of them is wrong."


def _hidden(axes: str, trial: Trial) -> str:
    """A sentence on the channels that do not judge the model."""
    own = [name for place, name in enumerate(CHANNELS) if AXES[place % 6] in axes and name in trial.channels]
    if not own:
        return ""
    return (
        f" Not judged: {', '.join(own)}: here the autopilot's commands answer disturbances and noise, which a"
        " replay does not have. Log preset steps, or a dither on top of the autopilot (seatrial plan with a"
        " campaign of this log)."
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


def _log(source: Any) -> MissionLog:
    if isinstance(source, MissionLog):
        return source
    return MissionLog.of(source) if isinstance(source, Trial) else MissionLog.read(source)


def _loaded(mission: Any) -> Mission | None:
    if mission is None:
        return None
    from seatrial.base.toml_file import loaded
    from seatrial.flight.mission import Mission

    found: Mission = loaded(Mission, mission)
    return found


def _pilot(autopilot: Any) -> Autopilot | None:
    if autopilot is None:
        return None
    from seatrial.verification.scenario import autopilot_of

    return autopilot_of(autopilot)


def _without_steps(corridors: Mapping[str, Corridor], seen: Sequence[str]) -> list[str]:
    """A sentence on corridors for which the log holds no step."""
    least = {name: one.until_s for name, one in corridors.items() if name not in seen}
    if not least:
        return []
    listed = ", ".join(f"{name} ({until:g} s)" for name, until in least.items())
    return [f"The log holds no set-point step that stands until its corridor ends: {listed}."]
