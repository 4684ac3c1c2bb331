"""Rounds of proposals: what the residuals and the bounds ask for is tried, and kept where it predicts better.

A joint estimate names what its model lacks: coefficients that are held and should be free, forces of single
trials, bounds that the data contradict. In a round the strongest proposals are tried, each alone beside what
is kept already: the estimate is repeated with it, and both estimates predict parts of the log that they have
not seen. The proposal that gains most is kept where the gain is more than chance, and the next round begins
with it. What the campaign holds out stays unseen: it scores the result.

Parts not seen. The segments that are fitted are cut into parts of consecutive ones, longer than the residual
remembers. The estimate without part p follows from that on all by one step of Gauss and Newton,

    theta_p = theta + (H - H_p)^-1 (g - g_p),

with information H and gradient g of all parts and H_p, g_p of the left-out one; the model then simulates the
part at theta_p. Source: Rad and Maleki, *J. R. Stat. Soc. B* 82 (2020) 965 (approximate leave-out by a Newton
step).

More than chance. A part says of a channel ``(e - e') / mean(e)``, with the root mean square errors e before
and e' after, the mean over all parts: neither do calm parts count as much as those that move, as their ratios
would, nor does one stormy part decide alone, as its squared error would. The sum over the channels is tested
over the parts by Student's t, one-sided (Diebold and Mariano, *J. Bus. Econ. Stat.* 13 (1995) 253, for blocks
that are longer than the memory of the errors), and the p-value is multiplied by the number of proposals of
the round (Bonferroni).

Tests: ``tests/identification/test_rounds.py``.
"""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError, NumericalError
from seatrial.base.plain import Plain
from seatrial.diagnosis.assessment import contradicted_bounds
from seatrial.diagnosis.missing_terms import Suggestion, independent_blocks, missing_terms
from seatrial.diagnosis.residual_analysis import Tried, campaign_line, freed, tried_terms
from seatrial.estimation.estimator import Polished
from seatrial.estimation.gauss_newton import GaussNewton
from seatrial.estimation.joint import Joint
from seatrial.estimation.joint_estimate import polish
from seatrial.problem.settings import STRIPS, JointSettings
from seatrial.statistics.blocks import block_length
from seatrial.statistics.uncertainty import covariance

if TYPE_CHECKING:
    from seatrial.base.work import Step


@dataclass(frozen=True)
class RoundSettings:
    """Which proposals of the residuals are tried, and when one is kept."""

    #: Parts of a log at most: more tell no more, for a term shows in those alone whose motion it takes.
    most_parts: int = 60
    #: Parts from which a gain can be told from chance: with fewer, Student's t needs a gain of 2.6 times its
    #: standard deviation and more.
    fewest_parts: int = 6
    #: Chance of keeping any proposal of a round where none is true.
    level: float = 0.05
    #: Percent of the error of the parts, in the channel that a proposal improves most, below which a gain
    #: counts as none: at an R2 of 0.7 it is 0.006.
    least_gain_percent: float = 1.0
    #: Terms of a round, half of them usual ones: the next round asks again, beside what this one kept.
    tried: int = 4
    #: Percent of the cost that a term gains at first order before it is tried: it cannot come to more.
    worth_percent: float = 0.5
    #: Rounds of Gauss and Newton of a trial at most: all but one unknown are at their best already.
    refit_rounds: int = 6
    #: Largest squared error of a sample, in the noise: a model a thousand standard deviations off diverged.
    diverged: float = 1e6
    #: Segments on which proposals are tried, or some more: of a longer log every second or third.
    segments: int = 150


SETTINGS = RoundSettings()


_USUAL = re.compile(
    r".+\.(loss|T_1|T_t|lever_[KMN])|[KN]_v|M_u|[XYZKMN]_0|Y_u[rv]|N_u[rv]|Z_u[wq]|M_u[wq]|X_(vv|ww|rr)|K_vv"
)
"""Terms that vehicles often need: thrust lost in the wash of others, lag and levers, drag that acts off O,
lift and the Munk moment, the drag of a drift in surge (Fossen 2011, sections 6.3 to 6.4 and 8.1)."""


Verdict = Literal["kept", "within chance", "too little", "another gains more", "cannot be tried"]


@dataclass(frozen=True)
class Proposal(Plain):
    """A change of the model that an estimate asked for, and what parts that it had not seen said of it."""

    #: From 1.
    round: int
    #: The coefficient, the group's coefficient, or the force of a trial.
    name: str
    #: What is changed: a coefficient is freed ("term"), or a bound is widened ("bound").
    kind: Literal["term", "bound"]
    #: The line of the campaign's ``[polish.coefficients]`` or ``[polish.nuisances]`` that says it.
    line: str
    #: The channel that gains most.
    channel: str
    #: By how much its root mean square error falls on parts not seen, percent.
    gain: float
    #: Probability of a gain as large by chance, times the proposals of the round.
    p: float
    #: Whether it was kept, or why not.
    verdict: Verdict


@dataclass(frozen=True)
class _Change:
    """A proposal before it is tried: the settings that it makes, and where its coefficient starts."""

    name: str
    kind: Literal["term", "bound"]
    line: str
    section: JointSettings
    start: Mapping[str, float]


@dataclass(frozen=True)
class _Fit:
    """An estimate, and the parts when each is left out: (parts, C) sums of squared errors in the noise."""

    joint: Joint
    polished: Polished
    unseen: Array


def _fall(before: Array, after: Array) -> Array:
    """Fall (parts, C) of the root mean square error, over its mean, from sums (parts, C) of squares."""
    size = np.sqrt(before)
    mean = size.mean(axis=0)
    return np.asarray((size - np.sqrt(after)) / np.where(mean > 0.0, mean, np.inf))


def in_rounds(
    joint: Joint, polished: Polished, *, rounds: int, watch: Callable[[Step], None] | None = None
) -> tuple[Joint, Polished, tuple[Proposal, ...]]:
    """The joint estimate on all segments with the proposals that predict better, and all in their order.

    Predictions of a filter are left as they are. ``rounds``: most rounds; a round that keeps nothing is the
    last.
    """
    if not joint.comparison.simulates or polished.interrupted or not rounds:
        return joint, polished, ()
    sparse, places = _sparse(joint)
    here = replace(polished, initial=polished.initial[places])
    proposals: list[Proposal] = []
    kept = False
    try:
        for number in range(1, rounds + 1):
            judged, winner = _round(number, sparse, here, watch)
            proposals += judged
            if winner is None:
                break
            sparse, here, kept = winner.joint, winner.polished, True
    except KeyboardInterrupt:
        return joint, replace(polished, interrupted=True), tuple(proposals)
    if not kept:
        return joint, polished, tuple(proposals)
    # The estimate with all that was kept, on all segments, from where the trials ended.
    problem = joint.problem.with_joint(sparse.problem.joint)
    whole = Joint(problem, joint.vehicle, threads=joint.threads, hidden=joint.hidden)
    again = polish(whole, start=whole.started(sparse.named(here.values)), watch=watch)
    if again.interrupted:
        return joint, replace(polished, interrupted=True), tuple(proposals)
    return whole, again, tuple(proposals)


def _round(
    number: int, joint: Joint, polished: Polished, watch: Callable[[Step], None] | None
) -> tuple[list[Proposal], _Fit | None]:
    """Proposals of one round, and the estimate with the one that is kept; None where none is."""
    tried = tried_terms(joint, polished.values, initial=polished.initial, noise=polished.noise)
    parts, memory = _parts(joint, tried)
    changes = _changes(joint, polished, tried) if len(parts) >= SETTINGS.fewest_parts else []
    if not changes:
        return [], None
    before = _Fit(joint, polished, _unseen(joint, polished, parts, memory=memory))
    fits = [_tried(before, change, parts, memory, watch) for change in changes]
    judged = _judged(number, changes, before, fits)
    best = next((k for k, proposal in enumerate(judged) if proposal.verdict == "kept"), None)
    return judged, None if best is None else fits[best]


def _sparse(joint: Joint) -> tuple[Joint, NDArray[np.intp]]:
    """The estimate on the segments on which proposals are tried, at the step of the search; their places."""
    if len(joint.data.segments) < 2 * SETTINGS.segments:
        return joint.at_search_step(), np.arange(len(joint.data.segments))
    part, places = joint.thinned(SETTINGS.segments)
    return part.at_search_step(), places


def _parts(joint: Joint, tried: Tried) -> tuple[list[NDArray[np.intp]], float]:
    """Places of the segments of every part: consecutive ones of a trial, longer than the residual remembers.

    And how many samples stand for one independent one.
    """
    _, memory_s = independent_blocks(tried.lin, tried.held)
    segments = joint.data.segments
    lengths = np.array([(segment.stop - segment.start) * joint.data.dt for segment in segments])
    least_s = max(memory_s, float(lengths.sum()) / SETTINGS.most_parts)
    parts: list[NDArray[np.intp]] = []
    for record in dict.fromkeys(segment.record for segment in segments):
        own = np.array([k for k, segment in enumerate(segments) if segment.record == record])
        # Whole parts only: what is left at the end of a trial joins its last part.
        count = max(int(lengths[own].sum() / least_s), 1)
        parts += np.array_split(own, min(count, len(own)))
    effective = float(np.sum(block_length(tried.lin).effective))
    counted = sum(int(piece.counted.sum()) for piece in tried.lin.pieces)
    return parts, max(counted / max(effective, 1.0), 1.0)


def _changes(joint: Joint, polished: Polished, tried: Tried) -> list[_Change]:
    """Proposals of a round, the strongest first: bounds that the data contradict, then missing terms."""
    section = joint.problem.joint or JointSettings()
    known = tried.lin.of_first(len(joint.unknowns))
    start = joint.named(polished.values)
    changes = []
    contradicted = contradicted_bounds(known, covariance(known))
    pulls = {} if contradicted is None else contradicted.pulls
    widened = (_widened(joint, section, name, start) for name in sorted(pulls, key=lambda name: -pulls[name]))
    changes += [change for change in widened if change is not None][:1]
    info = joint.vehicle.coefficient_info()
    block, _ = independent_blocks(tried.lin, tried.held)
    # What vehicles often need is tried for its gain alone, and the parts judge: a single run may show it, in
    # too few blocks for a score test.
    usual = [candidate for candidate in tried.held if _USUAL.fullmatch(candidate.name)]
    suggestions = {
        suggestion.name: suggestion
        for family, count, level in ((usual, len(usual), math.inf), (tried.held, tried.count, SETTINGS.level))
        for suggestion in missing_terms(
            tried.lin,
            family,
            block=block,
            info=info,
            tested=count,
            level=level,
            least_gain=SETTINGS.worth_percent,
            most=SETTINGS.tried // 2,
        )
        # No delay is shorter than none; strips replace what is free, which is a choice of its own.
        if not suggestion.faster and suggestion.name not in STRIPS
    }
    return [*changes, *(_freed(joint, section, suggestion, start) for suggestion in suggestions.values())]


def _freed(
    joint: Joint, section: JointSettings, suggestion: Suggestion, start: Mapping[str, float]
) -> _Change:
    info = joint.vehicle.coefficient_info()
    own = 0.0 if suggestion.nuisance is not None else suggestion.present
    return _Change(
        suggestion.name,
        "term",
        campaign_line(suggestion, info),
        freed(section, suggestion, info),
        {**start, suggestion.name: own},
    )


def _widened(joint: Joint, section: JointSettings, name: str, start: Mapping[str, float]) -> _Change | None:
    """Bounds twice as wide on the side that was reached; None where that is zero, which has a meaning."""
    parameter = next(parameter for parameter in joint.parameters if parameter.name == name)
    entry = joint.stage.coefficients[name]
    lower, upper = parameter.lower, parameter.upper
    reached_upper = upper - start[name] < start[name] - lower
    end, width = (upper, upper - lower) if reached_upper else (lower, upper - lower)
    if end == 0.0:
        return None
    beyond = end + width if reached_upper else end - width
    # A sign is knowledge that a wider bound does not give up: damping takes energy out.
    if end * beyond < 0.0:
        beyond = 0.0
    lower, upper = (lower, beyond) if reached_upper else (beyond, upper)
    scale = 1.0
    if entry.relative:
        scale = joint.problem.vehicle.coefficients()[parameter.members[0][0]]
    bounds = tuple(sorted((float(f"{lower / scale:.4g}"), float(f"{upper / scale:.4g}"))))
    wider = entry.model_copy(update={"bounds": bounds})
    key = f'"{name}"' if "." in name else name
    return _Change(
        name,
        "bound",
        f"{key} = [{bounds[0]!r}, {bounds[1]!r}]",
        section.model_copy(update={"coefficients": {**section.coefficients, name: wider}}),
        start,
    )


def _tried(
    before: _Fit,
    change: _Change,
    parts: Sequence[NDArray[np.intp]],
    memory: float,
    watch: Callable[[Step], None] | None,
) -> _Fit | None:
    """The estimate with a change; None where it cannot be made."""
    joint = before.joint
    try:
        grown = Joint(
            joint.problem.with_joint(change.section),
            joint.vehicle,
            threads=joint.threads,
            method="output",
            hidden=joint.hidden,
        )
        sparse, _ = _sparse(grown)
        # Priors weigh as they did before the change, or the two estimates would differ by more than it.
        weights = joint.named(joint.tempering)
        sparse.tempering = np.array([weights.get(unknown.name, 1.0) for unknown in sparse.unknowns])
        polished = polish(
            sparse, start=sparse.started(change.start), rounds=SETTINGS.refit_rounds, near=True, watch=watch
        )
        if polished.interrupted:
            raise KeyboardInterrupt
        # Errors are counted in the noise of the estimate before, or a worse fit would weigh less.
        noise = before.polished.noise
        return _Fit(sparse, polished, _unseen(sparse, polished, parts, memory=memory, noise=noise))
    except (CampaignError, NumericalError, np.linalg.LinAlgError):
        return None


def _unseen(
    joint: Joint,
    polished: Polished,
    parts: Sequence[NDArray[np.intp]],
    *,
    memory: float,
    noise: Array | None = None,
) -> Array:
    """Sums of squared errors (parts, C), in the noise, of every part when the estimate has not seen it.

    ``memory`` is how many samples of the residual stand for one independent one: the width of a bound weighs
    as much more beside the rest of the log.
    """
    search = GaussNewton(joint)
    search.noise = (polished.noise if noise is None else noise).copy()
    segments = list(search.by_segment(polished.values, polished.initial))
    size = len(joint.unknowns)
    each = np.zeros((len(parts), size, size))
    slopes = np.zeros((len(parts), size))
    for part, places in enumerate(parts):
        for local, reduced, downhill in (segments[place] for place in places):
            each[part][np.ix_(local.places, local.places)] += reduced
            slopes[part, local.places] += downhill
    # Where the rest of the log tells a combination of unknowns hardly at all, the step stays inside what is
    # known beforehand, at least the widths of the bounds.
    stated = np.array([math.isfinite(unknown.prior_sd) for unknown in joint.unknowns])
    known = np.where(stated, 1.0, memory) * search.prior_sd**-2.0
    information = each.sum(axis=0) + np.diag(known)
    gradient = slopes.sum(axis=0) - search.drawn(polished.values - joint.centres(polished.values))
    # What lies at a bound and is pulled beyond it stays there.
    at_lower, at_upper = polished.values <= search.lower, polished.values >= search.upper
    free = np.flatnonzero(~(at_lower & (gradient < 0.0) | at_upper & (gradient > 0.0)))
    errors = np.zeros((len(parts), len(joint.channels)))
    for part, places in enumerate(parts):
        values = polished.values.copy()
        rest = (information - each[part])[np.ix_(free, free)]
        values[free] += np.linalg.solve(rest, (gradient - slopes[part])[free])
        values = np.clip(values, search.lower, search.upper)
        # Starts of the part's segments go with the step, as far as its own record says.
        locals_ = [segments[place][0] for place in places]
        begun = polished.initial[places].copy()
        for row, local in enumerate(locals_):
            step = (values - polished.values)[local.places]
            begun[row, search.initial_places] += local.toward - local.follow @ step
        errors[part] = _errors(joint, values, begun, places, search.noise)
    return errors


def _errors(joint: Joint, values: Array, initial: Array, places: NDArray[np.intp], noise: Array) -> Array:
    """Sums of squared errors (C,) of some segments, in the noise."""
    part = copy.copy(joint)
    part.data, part.noise = joint.data.of_segments(places.tolist()), noise.copy()
    part.model = replace(joint.model, data=part.data)
    residuals = np.concatenate(part.residuals(values, initial)) / noise
    # A part that diverges loses by a large, finite amount: one part then decides nothing by itself.
    return np.asarray(np.nansum(np.minimum(residuals**2, SETTINGS.diverged), axis=0))


def _judged(
    number: int, changes: Sequence[_Change], before: _Fit, fits: Sequence[_Fit | None]
) -> list[Proposal]:
    """The proposals of a round with their verdicts; at most one is kept."""
    from scipy.stats import t as student

    rows, sizes = [], []
    for fit in fits:
        if fit is None:
            rows.append(("", math.nan, 1.0))
            sizes.append(-math.inf)
            continue
        falls = _fall(before.unseen, fit.unseen)
        gained = falls.sum(axis=1)
        spread = float(gained.std(ddof=1)) / math.sqrt(len(gained))
        statistic = float(gained.mean()) / spread if spread > 0.0 else 0.0
        p = min(float(student.sf(statistic, len(gained) - 1)) * len(changes), 1.0)
        by_channel = 100.0 * falls.mean(axis=0)
        most = int(np.argmax(by_channel))
        rows.append((before.joint.channels[most], float(by_channel[most]), p))
        sizes.append(float(gained.mean()))
    able = [
        k for k, (_, gain, p) in enumerate(rows) if p < SETTINGS.level and gain >= SETTINGS.least_gain_percent
    ]
    best = max(able, key=lambda k: sizes[k]) if able else None
    judged = []
    for k, (change, (channel, gain, p)) in enumerate(zip(changes, rows, strict=True)):
        verdict: Verdict
        if fits[k] is None:
            verdict = "cannot be tried"
        elif k == best:
            verdict = "kept"
        elif k in able:
            verdict = "another gains more"
        else:
            verdict = "within chance" if p >= SETTINGS.level else "too little"
        judged.append(Proposal(number, change.name, change.kind, change.line, channel, gain, p, verdict))
    return judged
