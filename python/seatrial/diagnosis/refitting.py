"""Refits: the joint estimate with a suggested coefficient free, for values that are not of first order.

Where the fitted coefficients have bent far to stand for a missing term, its derivative there says little:
what is left looks like a lag of the motors rather than the lift that is missing. A few candidates are
therefore freed in turn and everything is estimated again; that of the largest gain is kept, and the rest is
tried beside it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.diagnosis.missing_terms import (
    Candidate,
    Suggestion,
    fitted_places,
    independent_blocks,
    members,
    missing_terms,
)
from seatrial.diagnosis.roles import role
from seatrial.estimation.estimator import Polished
from seatrial.estimation.joint import Joint
from seatrial.estimation.joint_estimate import linearise, polish
from seatrial.problem.settings import Coefficient, JointSettings, Nuisance, Tie
from seatrial.statistics.linearisation import Linearisation
from seatrial.statistics.score_test import score_tests


@dataclass(frozen=True)
class RefittingSettings:
    """How a suggested term is refitted."""

    #: Room for a freed term on either side of its suggested value, in its standard deviations.
    room_sd: float = 4.0
    #: Further terms that are looked for beside the freed one.
    beside: int = 4
    #: Rounds of a refit at most: it starts where all but one coefficient are at their best.
    rounds: int = 5


SETTINGS = RefittingSettings()


def suggested_bounds(suggestion: Suggestion, info: Mapping[str, Mapping[str, Any]]) -> tuple[float, float]:
    """Bounds for a suggested coefficient, in its unit; ``info`` is that of ``Vehicle.coefficient_info()``.

    They hold the present value and the estimate, and beyond either four sigma or the distance between the
    two, whichever is more: the estimate is of first order. The vehicle's default bounds cut them where both
    values lie inside, so that damping keeps its sign; lag and dead time are never negative. Rounded outwards
    to two digits.
    """
    present, value = suggestion.present, suggestion.value
    room = max(SETTINGS.room_sd * suggestion.sigma, abs(value - present))
    lower, upper = _outwards(min(present, value) - room, -1), _outwards(max(present, value) + room, 1)
    facts = info.get(suggestion.name, {})
    least, most = facts.get("lower"), facts.get("upper")
    if least is not None and most is not None and least <= min(present, value) <= max(present, value) <= most:
        lower, upper = max(lower, float(least)), min(upper, float(most))
    if role(suggestion.name).part in ("T_1", "T_t"):
        lower = max(lower, 0.0)
    return lower + 0.0, upper + 0.0


def campaign_line(suggestion: Suggestion, info: Mapping[str, Mapping[str, Any]]) -> str:
    """Line of a campaign's coefficients that frees a suggested one within `suggested_bounds`.

    Of a constant force of one trial the line of ``[polish.nuisances]``.

    Examples
    --------
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
    """Suggestions after refits: of the first few the one that gains most, then those beside it.

    ``start`` (m,): the estimate without any of them. ``suggestions``: of first order, at that estimate.
    ``tried``: all that may be suggested. ``tested``: number of coefficients tried in all. ``level``: false
    discovery rate. ``refits``: suggestions that are refitted. ``least_gain``: percent of the mean square that
    it gains at least; otherwise none is suggested.
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
        lin, left, block=block, info=info, tested=tested, level=level, most=SETTINGS.beside
    )
    return Refitted((_exact(lin, left, chosen, gain=gain), *beside), lin, left)


def _fit(joint: Joint, section: JointSettings, start: Mapping[str, float]) -> _Fit:
    """The joint estimate of a section, from one start by the names of its unknowns."""
    problem = joint.problem
    section = section.model_copy(update={"starts": 1})
    other = problem.with_joint(section)
    grown = Joint(other, joint.vehicle, threads=joint.threads, hidden=joint.hidden)
    values = np.array([start[unknown.name] for unknown in grown.unknowns])
    polished = polish(grown, start=values, rounds=SETTINGS.rounds)
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
