"""What an identification takes from events: stretches of a closed loop whose commands answer no motion.

An autopilot that answers waves exchanges cause and effect (`seatrial.inspect.verdict`). A routine mission
still holds open-loop experiments (`seatrial.inspect.feedback`), on which output error is consistent
(`seatrial.estimation.event_fit`). Angles are compared and not their rates, which most logs smooth from them:
smoothing makes an error that no stationary noise describes.

Quadratic damping and cross-flow drag by strips are both estimated; each event is predicted by the estimate
from the others (one step of Gauss and Newton), and its likelihood there weighs the two. The result is the
likelier, its variance that of the mixture (Hoeting et al., *Stat. Sci.* 14 (1999) 382).

Tests: ``tests/identification/test_event_estimates.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import t as student

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES, MOTIONS
from seatrial.base.plain import Plain
from seatrial.diagnosis.assessment import SETTINGS as ASSESSMENT_SETTINGS
from seatrial.diagnosis.identifiability import SETTINGS as IDENTIFIABILITY_SETTINGS
from seatrial.estimation.estimator import method_of
from seatrial.estimation.event_fit import ANGLE_OF, SETTINGS, EventFit, EventWindows, estimate_on_events
from seatrial.identification.choice import slender
from seatrial.inspect.feedback import EVENT_LIMITS, Event, events
from seatrial.problem.parameter import Parameter, coefficients
from seatrial.problem.settings import STRIPS

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.problem.problem import Problem
    from seatrial.problem.settings import Stage


@dataclass(frozen=True)
class EventEstimate(Plain, without="parameters covariance"):
    """What the events of a stage tell of its coefficients."""

    #: Its name, or that of a motion that no stage frees.
    stage: str
    #: Letters of the axes whose commands answer the motion.
    axes: str
    #: What it was estimated from, or what there is where that is too little.
    events: tuple[Event, ...]
    #: Free ones, with strips in place of quadratic damping where these predict better; none where the events
    #: carry too little.
    parameters: tuple[Parameter, ...] = ()
    #: Estimates (m,), covariance (m, m), and per parameter the value and deviation known beforehand, SI.
    values: tuple[float, ...] = ()
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    prior: tuple[tuple[float, float], ...] = ()
    #: Per parameter, as of `seatrial.diagnosis.identifiability`.
    verdicts: tuple[str, ...] = ()
    #: "quadratic" or "strips".
    damping: str = ""
    #: By how much that form predicts the left-out events better than the other, log-likelihood; zero where
    #: one form alone was estimated.
    likelier: float = 0.0
    #: ``C_Dy`` or ``C_Dz`` where strips were taken, else "".
    strips: str = ""

    @property
    def upper(self) -> float:
        """Upper bound of the drag coefficient of the strips; 0 without strips."""
        return max((p.upper for p in self.parameters if p.name == self.strips), default=0.0)

    @property
    def enough(self) -> bool:
        """Whether the coefficients of the stage are taken from its events."""
        return bool(self.parameters)

    def known(self, place: int) -> dict[str, Any]:
        """Estimate, sigma, 95 % interval, verdict and prior of a parameter, as `Assessment.of` gives them."""
        value, sigma = self.values[place], math.sqrt(self.covariance[place, place])
        # Student's factor of as many events: their scatter is what the deviation rests on.
        factor = float(student.ppf(0.975, len(self.events) - 1))
        centre, prior_sd = self.prior[place]
        return {
            "estimate": value,
            "sigma": sigma,
            "lower": value - factor * sigma,
            "upper": value + factor * sigma,
            "verdict": self.verdicts[place],
            "prior": centre,
            "prior_sd": prior_sd,
        }


@dataclass(frozen=True)
class EventEstimates:
    """What events tell, and the problem that is left."""

    #: The problem that was asked.
    whole: Problem
    #: By stage, those that carry too little too.
    estimates: tuple[EventEstimate, ...] = ()

    @cached_property
    def taken(self) -> tuple[EventEstimate, ...]:
        """Estimates of stages that are taken from events."""
        return tuple(estimate for estimate in self.estimates if estimate.enough)

    @cached_property
    def values(self) -> dict[str, float]:
        """Coefficients that events set."""
        return {
            name: value
            for estimate in self.taken
            for name, value in coefficients(estimate.parameters, estimate.values).items()
        } | {
            name: 0.0
            for estimate in self.taken
            if estimate.strips
            for name in (STRIPS[estimate.strips][0], STRIPS[estimate.strips][-1])
        }

    @cached_property
    def rest(self) -> Problem:
        """The problem without what events tell: its vehicle has their values, their axes are replayed."""
        if not self.taken:
            return self.whole
        names = {name for estimate in self.taken for name in self._stage(estimate.stage).coefficients}
        vehicle = self.whole.vehicle.with_coefficients(self.values)
        return self.whole.without_coefficients(names).with_vehicle(vehicle)

    def restored(self, rest: Problem) -> Problem:
        """The whole problem again, with what the rest of the identification made of the others' stages."""
        if not self.taken:
            return rest
        whole = self._damped
        own = {stage.name: stage for stage in rest.stages}
        names = {estimate.stage for estimate in self.taken}
        stages = [
            stage if stage.name in names else own[stage.name]
            for stage in whole.stages
            if stage.name in names or stage.name in own
        ]
        return rest.with_vehicle(self.whole.vehicle).with_stages(stages)

    def again(self, vehicle: Vehicle, *, threads: int | None = None) -> EventEstimates:
        """The estimates once more beside what the rest of the identification found.

        ``X_udot`` is in the Munk moment of sway and yaw: events tell their sum with ``N_uv``.

        ``vehicle``: with the result of the rest.
        """
        known = self._damped.with_vehicle(vehicle)
        stages = {stage.name: stage for stage in known.stages}
        estimates = []
        for estimate in self.estimates:
            if estimate.enough:
                stage = stages[estimate.stage]
                fit = _with_damping(known, stage, estimate.events, estimate.strips, threads, estimate)
                estimate = replace(estimate, values=tuple(fit.values.tolist()))
            estimates.append(estimate)
        return replace(self, estimates=tuple(estimates))

    @cached_property
    def _damped(self) -> Problem:
        """The whole problem with the damping that events prefer."""
        whole = self.whole
        for estimate in self.taken:
            if estimate.strips:
                whole = whole.with_strips(estimate.strips, (0.0, estimate.upper), SETTINGS.drag[0])
        return whole

    def _stage(self, name: str) -> Stage:
        return next(stage for stage in self.whole.stages if stage.name == name)


def from_events(
    problem: Problem, *, threads: int | None = None, watch: Callable[[str], None] | None = None
) -> EventEstimates:
    """Coefficients of axes whose commands answer the motion, from the events of their trials.

    Only where the joint estimate would otherwise be by innovations: a simulation of the whole log is biased
    there. What the campaign holds out is not used.

    ``threads``: of the core; the result does not depend on it. ``watch``: gets the name of each stage whose
    events are estimated.
    """
    if problem.joint is None or problem.joint.method == "output":
        return EventEstimates(problem)
    closed = {stage.name: _closed(problem, stage.trials) & set(stage.axes.free) for stage in problem.stages}
    everywhere = _closed(problem, problem.fitted).difference(*closed.values())
    estimates = []
    for stage in problem.stages:
        if closed[stage.name]:
            if watch is not None:
                watch(stage.name)
            chosen = _events(problem, stage.trials, closed[stage.name])
            estimates.append(on_events(problem, stage, chosen, threads))
    # Motions that no stage frees: what there is to estimate them from.
    for axis in (axis for axis in AXES if axis in everywhere):
        estimates.append(EventEstimate(MOTIONS[axis], axis, _events(problem, problem.fitted, {axis})))
    return EventEstimates(problem, tuple(estimates))


def _closed(problem: Problem, trials: Sequence[str]) -> set[str]:
    """Axes whose commands answer the motion in all of these trials, in waves that bias a simulation."""
    if any(problem.input_of(name) != "commands" for name in trials):
        return set()
    if not method_of(problem, trials).comparison.models_noise:
        return set()
    verdicts = [problem.verdicts(name) for name in trials]
    return {axis for axis in AXES if all(axis in own and own[axis].kind != "open" for own in verdicts)}


def _events(problem: Problem, trials: Sequence[str], axes: set[str]) -> tuple[Event, ...]:
    """Events of some axes in what is fitted of some trials, each stretch once."""
    chosen = {
        (event.trial, event.start_s): event
        for name in trials
        for axis in sorted(axes)
        for event in events(problem.trials[name], problem.vehicle, axis, ~problem.held_out(name))
    }
    # One covariance holds for all, so that all have the time base of most.
    bases = [round(problem.trials[name].dt, 6) for name, _ in chosen]
    usual = max(bases, key=bases.count, default=0.0)
    alike = [event for event, dt in zip(chosen.values(), bases, strict=True) if dt == usual]
    return tuple(alike[:: math.ceil(len(alike) / SETTINGS.most)] if alike else ())


def on_events(
    problem: Problem, stage: Stage, chosen: tuple[Event, ...], threads: int | None
) -> EventEstimate:
    """What the events of a stage tell."""
    few = EventEstimate(stage.name, "".join(dict.fromkeys(event.axis for event in chosen)), chosen)
    if len(chosen) < SETTINGS.fewest:
        return few
    # Quadratic damping, and strips in place of it where a slender hull's is free.
    forms, info = {"": (problem, stage)}, problem.vehicle.coefficient_info()
    for name, made in STRIPS.items() if slender(problem.vehicle) else ():
        upper = info.get(name, {}).get("upper")
        if {made[0], made[-1]} <= stage.coefficients.keys() and upper is not None:
            change = problem.with_strips(name, (0.0, float(upper)), SETTINGS.drag[0])
            forms[name] = change, next(other for other in change.stages if other.name == stage.name)
    fits = {name: _with_damping(*form, chosen, name, threads) for name, form in forms.items()}
    strips = min(fits, key=lambda name: float(fits[name].unseen.sum()))
    best, rivals = fits[strips], [fit for name, fit in fits.items() if name != strips]
    likelier = min((0.5 * float((fit.unseen - best.unseen).sum()) for fit in rivals), default=0.0)
    estimate = EventEstimate(
        stage.name,
        few.axes,
        chosen,
        best.windows.parameters,
        tuple(best.values.tolist()),
        _mixed(best, rivals),
        tuple(zip(best.prior[0].tolist(), best.prior[1].tolist(), strict=True)),
        (),
        "strips" if strips else "quadratic",
        likelier,
        strips,
    )
    estimate = replace(estimate, verdicts=_verdicts(best, estimate.covariance))
    gains = [
        verdict
        for parameter, verdict in zip(estimate.parameters, estimate.verdicts, strict=True)
        if parameter.name.endswith(".gain")
    ]
    # A motion that the simulation hardly shows is that of the waves, whatever its coefficients.
    shown = best.windows.explained(best.point, few.axes) >= SETTINGS.explained
    known = "identifiable" in (gains or estimate.verdicts) and set(gains) <= {"identifiable"}
    return estimate if shown and known else few


def _with_damping(
    problem: Problem,
    stage: Stage,
    chosen: Sequence[Event],
    strips: str,
    threads: int | None,
    begun: EventEstimate | None = None,
) -> EventFit:
    """Estimate of a stage on events: of their first half, which is nearly linear, then of all.

    On all at once where an estimate is ``begun``, whose priors stay.
    """
    vehicle = problem.vehicle
    if strips:
        replaced = (STRIPS[strips][0], STRIPS[strips][-1])
        vehicle = vehicle.with_coefficients(dict.fromkeys(replaced, 0.0) | {strips: SETTINGS.drag[0]})
    channels = dict.fromkeys(
        ANGLE_OF[channel] if all(ANGLE_OF.get(channel) in problem.trials[n].channels for n in stage.trials)
        else channel
        for channel in stage.weights()
    )  # fmt: skip
    stage = stage.model_copy(update={"channels": dict.fromkeys(channels, 1.0)})
    windows = EventWindows(problem, stage, chosen, vehicle, threads)
    if begun is not None:
        centre, sd = np.array(begun.prior).T
        return estimate_on_events(windows, np.array(begun.values), (centre, sd))
    known = _known(windows.parameters)
    start = np.array([parameter.start for parameter in windows.parameters])
    # Without linear damping a hull that the file makes unstable runs away: the second start has some.
    damped = [float(p.start == p.upper == 0.0) * SETTINGS.damped * p.lower for p in windows.parameters]
    brief = [
        replace(event, stop_s=min(event.stop_s, event.start_s + EVENT_LIMITS.most_s / 2)) for event in chosen
    ]
    short = EventWindows(problem, stage, brief, vehicle, threads)
    both = [estimate_on_events(short, at, known, rounds=2) for at in (start, start + damped)]
    first = min(both, key=lambda fit: float(fit.deviances.sum()))
    return estimate_on_events(windows, first.values, known)


def _known(chosen: Sequence[Parameter]) -> tuple[Array, Array]:
    """Prior values and deviations (m,): stated, of cross-flow drag, else the width of the bounds."""
    made = {name for strips in STRIPS.values() for name in (strips[0], strips[-1])}
    centre = np.array([parameter.start for parameter in chosen])
    sd = np.array([min(parameter.upper - parameter.lower, parameter.sd) for parameter in chosen])
    for place, parameter in enumerate(chosen):
        if math.isfinite(parameter.sd):
            continue
        if parameter.name in STRIPS:
            centre[place], sd[place] = SETTINGS.drag
        elif parameter.name in made and parameter.start:
            # The vehicle file's own value, or that of its geometry.
            sd[place] = SETTINGS.damping * abs(parameter.start)
    return centre, sd


def _mixed(best: EventFit, rivals: Sequence[EventFit]) -> Array:
    """Covariance (m, m) of the likelier estimate, as much wider as the other forms of damping make it."""
    names = [parameter.name for parameter in best.windows.parameters]
    weights = np.exp(-0.5 * np.array([(fit.unseen - best.unseen).sum() for fit in rivals]))
    share = weights / (1.0 + weights.sum())
    own = np.diag(best.covariance)
    variance = own * (1.0 - share.sum())
    for weight, fit in zip(share.tolist(), rivals, strict=True):
        others = {parameter.name: place for place, parameter in enumerate(fit.windows.parameters)}
        for place, name in enumerate(names):
            other = others.get(name)
            away = 0.0 if other is None else fit.values[other] - best.values[place]
            spread = own[place] if other is None else fit.covariance[other, other]
            variance[place] += weight * (spread + away**2)
    wider = np.sqrt(np.maximum(variance / own, 1.0))
    return np.asarray(best.covariance * np.outer(wider, wider))


def _verdicts(fit: EventFit, covariance: Array) -> tuple[str, ...]:
    """Verdict per parameter: deviation over natural size, and over what was known beforehand."""
    width = fit.windows.upper - fit.windows.lower
    size = np.clip(np.abs(fit.values), 0.1 * width, width / math.sqrt(12.0))
    sigma = np.sqrt(np.diag(covariance))
    verdicts = []
    known = zip(fit.inside & ~fit.bent, sigma / size, sigma / fit.prior[1], strict=True)
    for sound, relative, share in known:
        if not sound or relative >= IDENTIFIABILITY_SETTINGS.absent:
            verdicts.append("not identifiable")
        else:
            verdicts.append(
                "identifiable"
                if relative <= IDENTIFIABILITY_SETTINGS.weak and share <= ASSESSMENT_SETTINGS.told_share
                else "weak"
            )
    return tuple(verdicts)
