"""Residual analysis: what the residuals say against the model, and what to do about it.

Three questions. Do the residuals look like the sensors' noise (`seatrial.diagnosis.residual_analysis`)? Which
coefficient that is held should be free (`seatrial.diagnosis.missing_terms`)? Which other signal do they
follow beside all that (`seatrial.diagnosis.residual_signals`)? A model that leaves structure is not true,
so its intervals are about the best model in its class; whether a suggested term is worth having is for the
hold-out score to say (`seatrial.campaign.suggestion`).

Where the fitted coefficients have bent far to stand for a missing term, its derivative there says little:
what is left looks like a lag of the motors rather than the lift that is missing. A few candidates are
therefore freed in turn and everything is estimated again (`refitted`); that of the largest gain is kept, and
the rest is tried beside it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.base.finding import Finding, Severity
from seatrial.base.plain import Plain
from seatrial.base.report import sentence_of
from seatrial.diagnosis.missing_terms import (
    Candidate,
    Suggestion,
    candidates,
    columns_of,
    fitted_places,
    independent_blocks,
    members,
    missing_terms,
    strongest,
    trial_forces,
)
from seatrial.diagnosis.residual_signals import (
    Autocorrelation,
    FollowedSignal,
    autocorrelations,
    followed_signals,
    motion_signals,
    recorded_signals,
    with_predicted_velocity,
)
from seatrial.estimation.joint_estimate import linearise
from seatrial.problem.parameter import coefficient_names
from seatrial.statistics.linearisation import Linearisation
from seatrial.statistics.significance import ScoreTests, score_tests

if TYPE_CHECKING:
    from seatrial.estimation.joint import Joint
import json
import math

from seatrial.diagnosis.roles import role
from seatrial.estimation.estimator import Polished
from seatrial.estimation.joint import Joint
from seatrial.estimation.joint_estimate import polish
from seatrial.problem.settings import Coefficient, JointSettings, Nuisance, Tie


@dataclass(frozen=True)
class ResidualSettings:
    """When residuals are more than noise."""

    #: Residuals over the noise from which they are warned of.
    excess: float = 1.5
    #: Level of the test of correlation, for several channels at once.
    unlikely_level: float = 0.01


SETTINGS = ResidualSettings()


@dataclass(frozen=True)
class ResidualAnalysis(Plain, also="structural warning"):
    """What the residuals say against the model; printed, sentences."""

    #: An `Autocorrelation` per channel.
    autocorrelations: tuple[Autocorrelation, ...]
    #: Coefficients to free, the one that gains most first; follow one at a time.
    suggestions: tuple[Suggestion, ...]
    #: Signals that the residuals follow beside what is fitted and suggested.
    signals: tuple[FollowedSignal, ...]
    #: Number of coefficients that were tried.
    tested: int
    #: Coefficients that could not be tried: the data cannot tell them from what is fitted, or do not show
    #: them at all.
    indistinguishable: tuple[str, ...]
    #: Length of the blocks behind the standard deviations, s.
    block_s: float

    @property
    def structural(self) -> bool:
        """Whether a term or signal was found, so that the truth lies outside the model class."""
        return bool(self.suggestions or self.signals)

    @property
    def coloured(self) -> list[Autocorrelation]:
        """Channels whose residual is more than the noise of its sensor, and remembers."""
        return [
            row
            for row in self.autocorrelations
            if row.excess > SETTINGS.excess and row.p < SETTINGS.unlikely_level
        ]

    @property
    def warning(self) -> str | None:
        """That the truth lies outside the model class; None where the residuals look like noise."""
        if not (self.coloured or self.structural):
            return None
        return sentence_of(Finding("residuals", Severity.WEAKNESS, values={"analysis": self}), "diagnosis")

    def __str__(self) -> str:
        finding = Finding("residual analysis", Severity.NOTE, values={"analysis": self})
        return sentence_of(finding, "diagnosis")


def analyse(
    lin: Linearisation,
    *,
    tried: Sequence[Candidate] = (),
    signals: Mapping[str, Sequence[Array]] | None = None,
    info: Mapping[str, Mapping[str, Any]] | None = None,
    sensor_noise: Mapping[str, float] | None = None,
    tested: int | None = None,
    level: float = 0.05,
) -> ResidualAnalysis:
    """Residual analysis of a model, linearised at its estimate. ``tried``: coefficients that might be
    missing, among its unknowns but not fitted. ``signals``: (n,) per segment besides those of the motion.
    ``sensor_noise``: SI by channel; else the white part of the residual. ``tested``: number of coefficients
    tried in all. ``level``: false discovery rate.
    """
    first = _first(lin, tried, info=info, tested=tested, level=level)
    by_name = {candidate.name: candidate.members for candidate in tried}
    suggested = {member for suggestion in first.suggestions for member in by_name[suggestion.name]}
    followed = followed_signals(
        lin,
        motion_signals(lin) | dict(signals or {}),
        fitted=[i for i, u in enumerate(lin.unknowns) if i in first.fitted or u.name in suggested],
        block=first.block,
        known=info or (),
        level=level,
    )
    correlations = autocorrelations(lin, sensor_noise=sensor_noise)
    return _analysis(first, correlations, first.suggestions, followed)


def analyse_joint(
    joint: Joint,
    values: Array,
    *,
    initial: Array | None = None,
    noise: Array | None = None,
    sensor_noise: Mapping[str, float] | None = None,
    level: float = 0.05,
    refits: int = 3,
    tried: Tried | None = None,
) -> ResidualAnalysis:
    """Residual analysis of a joint estimate: every coefficient and every recorded signal is tried.

    Parameters
    ----------
    joint : Joint
    values : ndarray, shape (m,)
        The estimate.
    initial : ndarray, shape (segments, 12), optional
        Initial conditions of the segments; by default they are found.
    noise : ndarray, shape (C,), optional
        Standard deviations of the channels' residuals; by default they are estimated.
    sensor_noise, level
        As in `analyse`.
    refits : int
        The first suggestions that are freed in turn and estimated again before one leads; each takes some
        rounds of a polish. With zero all numbers are of first order.
    tried : Tried, optional
        What `tried_terms` gives at the same values, where it is known already.

    Examples
    --------
    >>> import seatrial as st
    >>> from seatrial.estimation.joint import Joint
    >>> from seatrial.estimation.joint_estimate import polish
    >>> joint = Joint(st.Campaign.load("examples/cwolf/campaign.toml"))  # doctest: +SKIP
    >>> print(analyse_joint(joint, polish(joint).values))  # doctest: +SKIP
    """
    info = joint.vehicle.coefficient_info()
    trials = {name: joint.problem.trials[name] for name in joint.data.names}
    if tried is None:
        tried = tried_terms(joint, values, initial=initial, noise=noise)
    lin, held, count = tried.lin, tried.held, tried.count
    first = _first(lin, held, info=info, tested=count, level=level)
    suggestions, last = first.suggestions, lin
    # First-order numbers mislead where terms are alike: the best are freed in turn and estimated again.
    if suggestions and refits:
        followed = refitted(joint, values, suggestions, held, tested=count, level=level, refits=refits)
        suggestions, last, held = followed.suggestions, followed.lin, followed.tried
    # What the suggestions free counts as fitted: a signal must explain what is left beside them.
    freed = {
        member
        for suggestion in suggestions
        for c in held
        if c.name == suggestion.name
        for member in c.members
    }
    fitted = set(fitted_places(last, held)) | {i for i, u in enumerate(last.unknowns) if u.name in freed}
    last = with_predicted_velocity(last, trials)
    signals = followed_signals(
        last,
        motion_signals(last) | recorded_signals(last, trials),
        fitted=sorted(fitted),
        block=first.block,
        known=info,
        level=level,
    )
    suggestions = tuple(
        suggestion if suggestion.faster else replace(suggestion, line=campaign_line(suggestion, info))
        for suggestion in suggestions
    )
    return _analysis(first, autocorrelations(lin, sensor_noise=sensor_noise), suggestions, signals)


@dataclass(frozen=True)
class Tried:
    """Coefficients that might be missing, and the linearisation by which they are tried.

    ``lin`` has the unknowns of the joint estimate first, ``held`` the candidates of the largest gains, of
    ``count`` in all.
    """

    lin: Linearisation
    held: tuple[Candidate, ...]
    count: int


def tried_terms(
    joint: Joint, values: Array, *, initial: Array | None = None, noise: Array | None = None
) -> Tried:
    """Coefficients that a joint estimate holds and that might be missing, at its ``values`` (m,)."""
    tried = candidates(joint.vehicle, coefficient_names(joint.parameters), free=joint.stage.axes.free)
    if joint.comparison.simulates:
        estimated = [unknown.name for unknown in joint.unknowns]
        tried += trial_forces(joint.data.names, estimated, free=joint.stage.axes.free)
    held = strongest(joint, values, tried, initial=initial, noise=noise)
    lin = linearise(joint, values, initial=initial, noise=noise, extra=members(held))
    return Tried(lin, held, len(tried))


@dataclass(frozen=True)
class _First:
    """Suggestions of first order and what they rest on."""

    suggestions: tuple[Suggestion, ...]
    fitted: tuple[int, ...]
    block: Sequence[NDArray[np.intp]]
    block_s: float
    tested: int
    indistinguishable: tuple[str, ...]


def _first(
    lin: Linearisation,
    tried: Sequence[Candidate],
    *,
    info: Mapping[str, Mapping[str, Any]] | None,
    tested: int | None,
    level: float,
) -> _First:
    block, length = independent_blocks(lin, tried)
    fitted = fitted_places(lin, tried)
    alike: tuple[str, ...] = ()
    tests: ScoreTests | None = None
    if tried:
        tests = score_tests(lin, columns_of(lin, tried), fitted=fitted, block=block)
        alike = tuple(term.name for term, good in zip(tried, tests.testable, strict=True) if not good)
    count = max(tested or 0, len(tried)) - len(alike)
    suggestions = missing_terms(lin, tried, block=block, info=info, tests=tests, tested=count, level=level)
    return _First(suggestions, tuple(fitted), block, length, count, alike)


def _analysis(
    first: _First,
    correlations: tuple[Autocorrelation, ...],
    suggestions: tuple[Suggestion, ...],
    signals: tuple[FollowedSignal, ...],
) -> ResidualAnalysis:
    return ResidualAnalysis(
        autocorrelations=correlations,
        suggestions=suggestions,
        signals=signals,
        tested=first.tested,
        indistinguishable=first.indistinguishable,
        block_s=first.block_s,
    )


@dataclass(frozen=True)
class RefittingSettings:
    """How a suggested term is refitted."""

    #: Room for a freed term on either side of its suggested value, in its standard deviations.
    room_sd: float = 4.0
    #: Further terms that are looked for beside the freed one.
    beside: int = 4
    #: Rounds of a refit at most: it starts where all but one coefficient are at their best.
    rounds: int = 5


REFITTING_SETTINGS = RefittingSettings()


def suggested_bounds(suggestion: Suggestion, info: Mapping[str, Mapping[str, Any]]) -> tuple[float, float]:
    """Bounds for a suggested coefficient, in its unit, rounded outwards to two digits. They hold present
    value and estimate and beyond either four sigma or their distance, for the estimate is of first order. The
    vehicle's default bounds cut them where both lie inside, so that damping keeps its sign.
    """
    present, value = suggestion.present, suggestion.value
    room = max(REFITTING_SETTINGS.room_sd * suggestion.sigma, abs(value - present))
    lower, upper = _outwards(min(present, value) - room, -1), _outwards(max(present, value) + room, 1)
    facts = info.get(suggestion.name, {})
    least, most = facts.get("lower"), facts.get("upper")
    if least is not None and most is not None and least <= min(present, value) <= max(present, value) <= most:
        lower, upper = max(lower, float(least)), min(upper, float(most))
    if role(suggestion.name).part in ("T_1", "T_t"):
        lower = max(lower, 0.0)
    return lower + 0.0, upper + 0.0


def campaign_line(suggestion: Suggestion, info: Mapping[str, Mapping[str, Any]]) -> str:
    """Line of a campaign's coefficients that frees a suggested one within `suggested_bounds`; of a constant
    force of one trial that of ``[polish.nuisances]``.

    >>> from seatrial.diagnosis.missing_terms import Suggestion
    >>> one = Suggestion("C_Dy", "1", (), "v", "the cross-flow", 0.0, 0.8, 0.02, 9.0, 1e-9)
    >>> campaign_line(one, {"C_Dy": {"lower": 0.0, "upper": 2.0}})
    'C_Dy = [0.0, 1.6]'
    """
    if suggestion.nuisance is not None:
        trial, name = suggestion.nuisance
        return f"{name} = {{ trials = {json.dumps([trial])} }}"
    lower, upper = suggested_bounds(suggestion, info)
    if suggestion.relative:
        lower, upper = sorted((round(lower / suggestion.present, 3), round(upper / suggestion.present, 3)))
    key = f'"{suggestion.name}"' if "." in suggestion.name else suggestion.name
    written = f"[{lower!r}, {upper!r}]"
    if suggestion.relative:
        written = f"{{ bounds = {written}, relative = true }}"
    if suggestion.tied:
        written = f"{{ bounds = {written}, tie = {json.dumps(list(suggestion.tied))} }}"
    return f"{key} = {written}"


def freed(
    section: JointSettings, suggestion: Suggestion, info: Mapping[str, Mapping[str, Any]]
) -> JointSettings:
    """Settings of a joint estimate with what a suggestion frees; ``info`` as of `suggested_bounds`."""
    if suggestion.nuisance is not None:
        trial, key = suggestion.nuisance
        before = section.nuisances.get(key, Nuisance())
        force = before.model_copy(update={"trials": (*before.trials, trial)})
        return section.model_copy(update={"nuisances": {**section.nuisances, key: force}})
    lower, upper = suggested_bounds(suggestion, info)
    if suggestion.relative:
        lower, upper = sorted((lower / suggestion.present, upper / suggestion.present))
    entry = Coefficient(
        bounds=(lower, upper),
        start=1.0 if suggestion.relative else suggestion.present,
        relative=suggestion.relative,
        tie=tuple(Tie(name=name) for name in suggestion.tied),
    )
    return section.model_copy(update={"coefficients": {**section.coefficients, suggestion.name: entry}})


def _outwards(number: float, direction: int) -> float:
    """Number rounded to two digits, up (1) or down (-1)."""
    if number == 0.0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(abs(number))) - 1)
    rounded = (math.ceil if direction > 0 else math.floor)(number / unit - direction * 1e-9) * unit
    return float(f"{rounded:.6g}")


@dataclass(frozen=True)
class Refitted:
    """Suggestions, of which the first is refitted, and the linearisation with it free.

    ``tried`` are the candidates that are still held there.
    """

    suggestions: tuple[Suggestion, ...]
    lin: Linearisation
    tried: tuple[Candidate, ...]


@dataclass(frozen=True)
class _Fit:
    joint: Joint
    polished: Polished

    @property
    def samples(self) -> float:
        return float(sum(self.joint.data.counts[channel] for channel in self.joint.used))

    @property
    def cost(self) -> float:
        """Negative log-likelihood."""
        return float(self.polished.costs.min())


def refitted(
    joint: Joint,
    start: Array,
    suggestions: Sequence[Suggestion],
    tried: Sequence[Candidate],
    *,
    tested: int,
    level: float,
    refits: int,
    least_gain: float = 0.25,
) -> Refitted:
    """Suggestions after refits: of the first `refits` the one that gains most, then those beside it.
    ``start`` (m,): the estimate without them. ``tried``: all that may be suggested, ``tested`` how many were
    tried in all. ``least_gain``: percent of the mean square; where all gain less none is suggested.
    """
    begun = dict(zip((unknown.name for unknown in joint.unknowns), start.tolist(), strict=True))
    here = _fit(joint, joint.problem.joint or JointSettings(), begun)
    fits = [_freed(here, suggestion) for suggestion in suggestions[:refits]]
    best = int(np.argmin([fit.cost for fit in fits]))
    gain = -100.0 * math.expm1(2.0 * (fits[best].cost - here.cost) / here.samples)
    if gain < least_gain:
        return Refitted((), _linearised(here, tried), tuple(tried))
    chosen, here = suggestions[best], fits[best]
    taken = next(c for c in tried if c.name == chosen.name)
    # A force of one trial leaves the bias and the other trials' forces to be tried.
    left = tuple(
        c for c in tried if c is not taken and (taken.trial or not set(taken.members) & set(c.members))
    )
    lin = _linearised(here, left)
    block, _ = independent_blocks(lin, left)
    info = joint.vehicle.coefficient_info()
    beside = missing_terms(
        lin, left, block=block, info=info, tested=tested, level=level, most=REFITTING_SETTINGS.beside
    )
    return Refitted((_exact(lin, left, chosen, gain=gain), *beside), lin, left)


def _fit(joint: Joint, section: JointSettings, start: Mapping[str, float]) -> _Fit:
    """The joint estimate of a section, from one start by the names of its unknowns."""
    problem = joint.problem
    section = section.model_copy(update={"starts": 1})
    other = problem.with_joint(section)
    grown = Joint(other, joint.vehicle, threads=joint.threads, hidden=joint.hidden)
    values = np.array([start[unknown.name] for unknown in grown.unknowns])
    polished = polish(grown, start=values, rounds=REFITTING_SETTINGS.rounds)
    if polished.interrupted:
        raise KeyboardInterrupt
    return _Fit(grown, polished)


def _freed(here: _Fit, suggestion: Suggestion) -> _Fit:
    """The estimate with a suggested coefficient or force free, from where it is."""
    joint = here.joint
    names = [unknown.name for unknown in joint.unknowns]
    start = dict(zip(names, here.polished.values.tolist(), strict=True)) | {
        suggestion.name: 0.0 if suggestion.nuisance is not None else suggestion.present
    }
    section = joint.problem.joint or JointSettings()
    return _fit(joint, freed(section, suggestion, joint.vehicle.coefficient_info()), start)


def _linearised(here: _Fit, left: Sequence[Candidate]) -> Linearisation:
    polished = here.polished
    return linearise(
        here.joint, polished.values, initial=polished.initial, noise=polished.noise, extra=members(left)
    )


def _exact(
    lin: Linearisation, left: Sequence[Candidate], suggestion: Suggestion, *, gain: float
) -> Suggestion:
    """The suggestion with value, standard deviation and gain of the refit."""
    place = [unknown.name for unknown in lin.unknowns].index(suggestion.name)
    others = [i for i in fitted_places(lin, left) if i != place]
    block, _ = independent_blocks(lin, ())
    column = [piece.jacobian[:, :, [place]] for piece in lin.pieces]
    sigma = float(score_tests(lin, column, fitted=others, block=block).results().sigma[0])
    value = float(lin.values[place])
    return replace(suggestion, value=value, sigma=sigma, gain=gain)
