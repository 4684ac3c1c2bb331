"""Identifiability: what the data tell, what only in combination, and what would tell it apart.

The information of all samples on the coefficients, with the nuisance parameters unknown (Schur complement),
is judged on two scales. Over the width of the bounds it gives singular values and vectors: a singular value
s says that the data fix its direction to 1/s of the bounds. Over each coefficient's natural size it gives
the verdict:

    natural size = |value|, at least a tenth of the width of the bounds, at most their width / sqrt(12)

A tenth, because a coefficient that is small beside its bounds need not be known to a part of itself;
1/sqrt(12), because that is the standard deviation of a number somewhere inside the bounds: data that tell
less add nothing. With a standard deviation above `weak` of it a coefficient is weak, from `absent` on not
identifiable (`IdentifiabilitySettings`).

What is not identifiable is described by its smallest combinations (`seatrial.diagnosis.identifiability`)
in one sentence each, with what would determine it. All of it is local: it holds for the linearised model at
one point, and for a model of the right structure.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.base.channels import VELOCITIES
from seatrial.base.finding import Finding, Severity
from seatrial.base.plain import Plain
from seatrial.base.report import sentence_of
from seatrial.base.run import to_json
from seatrial.diagnosis.roles import Role, anchor, manoeuvre, role, unexcited
from seatrial.problem.settings import STRIPS
from seatrial.statistics.linearisation import (
    NULL,
    Linearisation,
    Unknown,
    correlation,
    covariance,
    eliminate,
    inflation,
    regression,
    singular,
)


@dataclass(frozen=True)
class IdentifiabilitySettings:
    """When data tell a coefficient, and which are weak only together."""

    #: Standard deviation over natural size from which a coefficient is not identifiable: its sign is a guess.
    absent: float = 1.0
    #: Standard deviation over natural size above which it is weak: 95 % lie within half the value at best.
    weak: float = 0.25
    #: Share of a standard deviation that a group must explain; the rest is a little of many others.
    group_share: float = 0.5
    #: Information on one force alone over that on all forces together, from which they count as scaling
    #: together. It is a condition index of ten, where dependence begins to matter (Belsley, Kuh & Welsch
    #: 1980, section 3.2).
    common_scale: float = 100.0
    #: Rise of the misfit when one force stays behind from which it belongs to those that scale together.
    carried: float = 2.0
    #: Members up to which all groups are tried; larger ones grow along the strongest correlations.
    tried_members: int = 3
    #: Standard deviation over natural size from which rounding speaks, not the data.
    rounding: float = 1e3
    #: Velocity below which an axis stands still, m/s and rad/s: noise of a Doppler log and of a small gyro.
    still: tuple[float, ...] = (0.02, 0.02, 0.02, 0.01, 0.01, 0.01)
    #: Standard deviation over the value above which no estimate is identifiable: 95 % reach to zero.
    open: float = 0.5
    #: Ratio of the standard deviations with nuisance parameters unknown and known from which these hide a
    #: coefficient.
    hidden: float = 2.0
    #: Condition number from which a warning is due: the information's is its square, half of double
    #: precision.
    ill_conditioned: float = 1e4
    #: Least natural size over the width of the bounds; default bounds of damping are four to ten times the
    #: value wide.
    small: float = 0.1
    #: Standard deviation of a uniform distribution over an interval of width one.
    uniform_sd: float = 12.0**-0.5
    #: Component of a singular vector that is worth a name.
    named_component: float = 0.1
    #: Factor by which the memory of residuals may widen a standard deviation at most.
    widest: float = 1e3


SETTINGS = IdentifiabilitySettings()


_FOLLOW = ("mass", "inertia", "added mass", "gravity", "buoyancy", "buoyancy centre", "bias")

_DRAG = ("linear", "quadratic", "strips", "lift")

_DRIVE = ("thrust", "torque")

_UPRIGHT = ("buoyancy centre", "gravity", "buoyancy")


@dataclass(frozen=True)
class Group:
    """Coefficients by place that the data cannot tell.

    ``sd`` is the standard deviation, over the natural size, of the worst of them; where all scale together,
    of their common factor.
    """

    kind: Literal["unexcited", "scale", "combination"]
    places: tuple[int, ...]
    sd: float


def weak_groups(information: Array, roles: Sequence[Role], values: Array) -> tuple[Group, ...]:
    """Smallest groups that the data cannot tell apart, those that nothing excites first. ``information`` (k,
    k) and ``values`` (k,) of the coefficients, in their natural sizes.
    """
    left, groups = list(range(len(roles))), []
    while left:
        part, kinds = information[np.ix_(left, left)], [roles[i] for i in left]
        sd = np.sqrt(np.diag(covariance(part)))
        if not (sd > SETTINGS.weak).any():
            break
        single = _alone(part, sd)
        if len(single):
            groups += [Group("unexcited", (left[i],), float(sd[i])) for i in single]
            left = [place for i, place in enumerate(left) if i not in single]
            continue
        together = _scale(part, kinds, values[left])
        if together:
            group, known = together
            groups.append(Group("scale", tuple(left[i] for i in group.places), group.sd))
        else:
            members = _smallest(part, sd)
            groups.append(
                Group("combination", tuple(left[i] for i in members), float(sd[list(members)].max()))
            )
            measured = anchor([kinds[i].name for i in members])
            worst = max(members, key=lambda i: float(sd[i]))
            known = next((i for i in members if kinds[i].name == measured), worst)
        del left[known]
    return _merged(groups, roles)


def _alone(information: Array, sd: Array) -> NDArray[np.intp]:
    """Places of what stays uncertain, or half as uncertain, with all others known."""
    own = np.diag(information)
    own_sd = np.where(own > 0, 1.0 / np.sqrt(np.where(own > 0, own, 1.0)), np.inf)
    return np.flatnonzero((sd > SETTINGS.weak) & (own_sd >= _limit(sd)))


def _limit(sd: Array) -> Array:
    """Standard deviation that a group must give a member: enough for its verdict, or half of its own."""
    return np.minimum(
        np.where(sd >= SETTINGS.absent, SETTINGS.absent, SETTINGS.weak), SETTINGS.group_share * sd
    )


def _scale(information: Array, roles: Sequence[Role], values: Array) -> tuple[Group, int] | None:
    """What scales together and the place of the force that a bench test gives; None if nothing nearly does.
    Drag, lift and thrust take the common factor or stay; masses, weights and biases move as the data like
    best, for the fixed ones among them are part of the same sums.
    """
    drives = [i for i, role in enumerate(roles) if role.kind in _DRIVE]
    drives = drives or [i for i, role in enumerate(roles) if role.kind in _UPRIGHT][:1]
    best, most = None, SETTINGS.common_scale
    for drive in drives:
        follow = [i for i, role in enumerate(roles) if role.kind in _FOLLOW and i != drive]
        forced = [i for i, role in enumerate(roles) if i == drive or _takes_factor(role)]
        at, factor = forced.index(drive), values[forced]
        misfit = eliminate(information, forced, follow) * np.outer(factor, factor)
        chosen, least = _common_factor(misfit, at)
        carried = [
            i
            for i in np.flatnonzero(chosen)
            if i != at and _turned(misfit, chosen, int(i)) > SETTINGS.carried * least
        ]
        step = np.zeros(len(roles))
        step[forced] = chosen * factor
        step[follow] = -regression(information, forced, follow) @ step[forced]
        drag = any(roles[forced[i]].kind in _DRAG for i in carried)
        if not drag or misfit[at, at] < most * least or np.abs(step).max() <= SETTINGS.weak * np.sqrt(least):
            continue
        moved = [i for i in follow if step[i] ** 2 * information[i, i] > least]
        places = sorted([drive, *moved, *(forced[i] for i in carried)])
        best, most = (Group("scale", tuple(places), float(least**-0.5)), drive), misfit[at, at] / least
    return best


def _takes_factor(role: Role) -> bool:
    """Whether a force is proportional to the coefficient; wake, deduction and levers are ratios."""
    return role.kind in _DRAG or role.kind in _DRIVE or role.part == "p2"


def _common_factor(misfit: Array, at: int) -> tuple[NDArray[np.bool_], float]:
    """Which forces take the factor of the one at a place so that the misfit is least, and that misfit."""
    best, least = np.arange(len(misfit)) == at, float(misfit[at, at])
    for chosen in (np.ones(len(misfit), dtype=bool), best):
        lowest = float(chosen @ misfit @ chosen)
        while True:
            turned = [(_turned(misfit, chosen, i), i) for i in range(len(misfit)) if i != at]
            value, place = min(turned, default=(np.inf, at))
            if value >= lowest * (1 - 1e-9):
                break
            lowest, chosen = value, chosen ^ (np.arange(len(misfit)) == place)
        if lowest < least:
            best, least = chosen, lowest
    return best, max(least, NULL * len(misfit) * float(misfit[at, at]))


def _turned(misfit: Array, chosen: NDArray[np.bool_], place: int) -> float:
    """Misfit with one choice turned round."""
    other = chosen.copy()
    other[place] = not other[place]
    return float(other @ misfit @ other)


def _smallest(information: Array, sd: Array) -> tuple[int, ...]:
    """Places of the smallest group that explains why one of its members is uncertain."""
    size = np.sqrt(np.diag(information))
    unit, limit = information / np.outer(size, size), _limit(sd) * size
    for count in range(2, min(SETTINGS.tried_members, len(sd)) + 1):
        groups = np.array(list(itertools.combinations(range(len(sd)), count)))
        blocks = unit[groups[:, :, None], groups[:, None, :]] + NULL * count * np.eye(count)
        own = np.sqrt(np.abs(np.diagonal(np.linalg.inv(blocks), axis1=1, axis2=2)))
        over = np.where(sd[groups] > SETTINGS.weak, own / limit[groups], 0.0).max(axis=1)
        if over.max() >= 1.0:
            return tuple(int(i) for i in groups[int(over.argmax())])
    worst, inverse = int(sd.argmax()), covariance(information)
    order = sorted(range(len(sd)), key=lambda i: (i != worst, -abs(inverse[i, worst]) / sd[i]))
    for count in range(SETTINGS.tried_members + 1, len(sd)):
        part = order[:count]
        if covariance(information[np.ix_(part, part)])[0, 0] >= _limit(sd)[worst] ** 2:
            return tuple(sorted(part))
    return tuple(range(len(sd)))


def _merged(groups: Sequence[Group], roles: Sequence[Role]) -> tuple[Group, ...]:
    """Combinations of one kind of coefficient that share members as one, after what nothing excites."""
    merged: list[Group] = []
    for group in sorted(groups, key=lambda group: group.kind != "unexcited"):
        kinds = {roles[i].kind for i in group.places}
        for at, other in enumerate(merged):
            same = (
                group.kind == other.kind == "combination" and {roles[i].kind for i in other.places} == kinds
            )
            if same and set(group.places) & set(other.places):
                places = sorted({*group.places, *other.places})
                merged[at] = Group("combination", tuple(places), max(group.sd, other.sd))
                break
        else:
            merged.append(group)
    return tuple(merged)


@dataclass(frozen=True)
class Undetermined(Plain, without="values", also="sentence"):
    """Coefficients that the data cannot tell, with what their words need to say what would.

    ``kind`` is "unexcited" (not even if all others were known), "nuisance" (hidden by a nuisance parameter),
    "scale" (all forces together), "combination" or "small" (known beside its bounds, not beside its own
    value). ``relative`` is the largest standard deviation among them
    over its natural size, infinite if the data tell nothing; of a scale that of the common factor.
    """

    kind: Literal["unexcited", "nuisance", "scale", "combination", "small"]
    names: tuple[str, ...]
    relative: float
    values: Mapping[str, Any] = field(default_factory=dict)

    @property
    def finding(self) -> Finding:
        """As a finding, for `seatrial.report.results.diagnosis`."""
        absent = self.kind != "small" and self.relative >= SETTINGS.absent
        severity = Severity.PROBLEM if absent else Severity.WEAKNESS
        return Finding(self.kind, severity, values={"names": self.names, **self.values})

    @property
    def sentence(self) -> str:
        """What hides them, and what would tell them."""
        return sentence_of(self.finding, "diagnosis")


def undetermined(
    lin: Linearisation, information: Array, *, relative: Mapping[str, float], size: Array, widening: Array
) -> tuple[Undetermined, ...]:
    """What is undetermined, each weak coefficient at least once; what nothing excites comes first.
    ``relative``: standard deviation over natural size, in the order of the ``information`` (k, k). ``size``,
    ``widening`` (k,): natural sizes, and by how much the memory of the residuals widens each deviation.
    """
    names = tuple(relative)
    natural = size / widening
    inside = [i for i, unknown in enumerate(lin.unknowns) if unknown.kind == "coefficient"]
    sized = information * np.outer(natural, natural)
    # Groups that only together are weak, then what the memory of the residuals alone makes weak.
    groups = list(weak_groups(sized, [role(name) for name in names], lin.values[inside] / natural))
    grouped = {i for group in groups for i in group.places}
    groups += [
        Group("unexcited", (i,), relative[name])
        for i, name in enumerate(names)
        if relative[name] > SETTINGS.weak and i not in grouped
    ]
    total = lin.information()
    weak: list[Undetermined] = []
    single: list[str] = []
    for group in groups:
        members = tuple(names[i] for i in group.places)
        # A nuisance parameter that hides a group is its reason, whatever its kind.
        hidden = _hidden(lin, total, group, natural)
        if hidden:
            weak.append(Undetermined("nuisance", members, _capped(group.sd), {"nuisance": hidden}))
        elif group.kind == "scale":
            factor_sd = _capped(group.sd * float(np.median(widening[list(group.places)])))
            weak.append(Undetermined("scale", members, factor_sd, {"factor_sd": factor_sd, "fins": lin.fins}))
        elif group.kind == "combination":
            vehicle = {"pushed": lin.pushed, "fins": lin.fins}
            weak.append(Undetermined("combination", members, _capped(group.sd), vehicle))
        else:
            single += members
    blind = {
        name for name, value in zip(names, np.diag(sized), strict=True) if value * SETTINGS.rounding**2 < 1.0
    }
    return (*_unexcited(lin, [name for name in names if name in single], blind, relative), *weak)


def _unexcited(
    lin: Linearisation, single: Sequence[str], blind: set[str], relative: Mapping[str, float]
) -> list[Undetermined]:
    moving = _moving(lin)
    silent = blind.intersection(single)
    locked = {role(name).force for name in silent if moving.issuperset(role(name).velocities)} - {""}
    groups = unexcited(
        single,
        moving=moving,
        silent=silent | {name for name in single if role(name).force in locked},
        seen={name for name, value in relative.items() if value <= SETTINGS.weak},
        pushed=lin.pushed,
        fins=lin.fins,
    )
    return [
        Undetermined("unexcited", group.names, max(relative[name] for name in group.names), {"group": group})
        for group in groups
    ]


def _hidden(lin: Linearisation, total: Array, group: Group, natural: Array) -> str | None:
    """Nuisance parameter that hides a group which the data would tell if all of these were known."""
    outside = [i for i, unknown in enumerate(lin.unknowns) if unknown.kind == "nuisance"]
    inside = [i for i, unknown in enumerate(lin.unknowns) if unknown.kind == "coefficient"]
    if not outside:
        return None
    chosen, sizes = [inside[i] for i in group.places], natural[list(group.places)]
    scale = np.outer(sizes, sizes)
    known = np.sqrt(np.diag(covariance(total[np.ix_(chosen, chosen)] * scale)))
    remaining = eliminate(total, chosen, outside) * scale
    unknown = np.sqrt(np.diag(covariance(remaining)))
    worst = int(unknown.argmax())
    if known.max() > SETTINGS.weak or unknown[worst] < SETTINGS.hidden * known[worst]:
        return None
    _, directions = np.linalg.eigh(remaining)
    along = directions[:, 0] * sizes
    own = np.diag(total)[outside]
    shared = (along @ total[np.ix_(chosen, outside)]) ** 2 / np.where(own > 0, own, np.inf)
    return lin.unknowns[outside[int(shared.argmax())]].name


def _moving(lin: Linearisation) -> set[str]:
    """Velocities whose root mean square in some segment is above what instruments show of a still vehicle."""
    rms = np.zeros(6)
    for piece in lin.pieces:
        rms = np.fmax(rms, np.sqrt(np.mean(piece.nu**2, axis=0)))
    return {
        letter for letter, value, still in zip(VELOCITIES, rms, SETTINGS.still, strict=True) if value > still
    }


def _capped(sd: float) -> float:
    return sd if sd <= SETTINGS.rounding else math.inf


@dataclass(frozen=True)
class Judgement:
    """Verdict on one coefficient.

    ``sd`` is its standard deviation in ``unit``, ``relative`` that over its natural size (infinite where the
    data tell nothing), ``correlation`` the multiple correlation coefficient with all others, ``inflation``
    the variance inflation factor ``1/(1 - correlation^2)``.
    """

    name: str
    unit: str
    value: float
    sd: float
    relative: float
    verdict: Literal["identifiable", "weak", "not identifiable"]
    correlation: float
    inflation: float


@dataclass(frozen=True)
class Identifiability(Plain, without="names"):
    """What the data tell of the coefficients."""

    #: Coefficients (k), in the order of all arrays.
    names: tuple[str, ...]
    #: Of the sensitivities scaled by the width of the bounds (k,), largest first.
    singular_values: Array
    #: Right singular vectors (k, k), a row each, in widths of the bounds.
    vectors: Array
    #: Largest over smallest singular value; infinite where the smallest is rounding.
    condition: float
    #: Matrix (k, k); zero beside coefficients without any information.
    correlation: Array
    #: A `Judgement` per coefficient.
    coefficients: tuple[Judgement, ...]
    #: An `Undetermined` for everything that is weak or not identifiable.
    combinations: tuple[Undetermined, ...]

    @property
    def sentences(self) -> tuple[str, ...]:
        """One sentence per combination."""
        return tuple(combination.sentence for combination in self.combinations)

    @property
    def verdicts(self) -> dict[str, str]:
        """Verdict by coefficient."""
        return {coefficient.name: coefficient.verdict for coefficient in self.coefficients}

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain numbers, texts, lists and dicts; an infinite number is None."""
        return dict(json.loads(to_json(super().to_dict())))


def judge(lin: Linearisation, sigma: Mapping[str, float] | None = None) -> Identifiability:
    """What a linearised estimate tells of its coefficients.

    Parameters
    ----------
    lin : Linearisation
        At the estimate, or at the start values before it. Priors count as information.
    sigma : mapping, optional
        Standard deviations by name that allow for residuals with a memory
        (`seatrial.statistics.uncertainty`). Of these and those of the information alone the larger counts;
        the correlations are those of the information.
    """
    inside = [i for i, unknown in enumerate(lin.unknowns) if unknown.kind == "coefficient"]
    outside = [i for i, unknown in enumerate(lin.unknowns) if unknown.kind == "nuisance"]
    unknowns = [lin.unknowns[i] for i in inside]
    names = tuple(unknown.name for unknown in unknowns)
    values = np.asarray(lin.values, dtype=float)[inside]
    information = eliminate(lin.information(), inside, outside)
    width, size = _sizes(unknowns, values)
    inverse = covariance(information)
    sd = np.sqrt(np.diag(inverse))
    given = np.array([math.nan if sigma is None else sigma.get(name, math.nan) for name in names])
    known = np.isfinite(given) & np.isfinite(sd)
    widening = (np.where(known, given, 1.0) / np.where(known, sd, 1.0)).clip(1.0, SETTINGS.widest)
    relative = np.fmax(sd, given) / size
    relative = np.where(relative > SETTINGS.rounding, np.inf, relative)
    # Start values before a search may be zero for want of anything better: of them this says nothing.
    is_open = (np.fmax(sd, given) > SETTINGS.open * np.abs(values)) & (sigma is not None)
    factors = inflation(information, inverse)
    judged = tuple(
        Judgement(
            name=unknown.name,
            unit=unknown.unit,
            value=float(values[i]),
            sd=float(relative[i] * size[i]),
            relative=float(relative[i]),
            verdict=_verdict(float(relative[i]), is_open=bool(is_open[i])),
            correlation=math.sqrt(1.0 - 1.0 / float(factors[i])),
            inflation=float(factors[i]),
        )
        for i, unknown in enumerate(unknowns)
    )
    spectrum, vectors, condition = singular(information * np.outer(width, width))
    return Identifiability(
        names=names,
        singular_values=spectrum,
        vectors=vectors,
        condition=condition,
        correlation=correlation(inverse),
        coefficients=judged,
        combinations=(
            *undetermined(
                lin,
                information,
                relative={judgement.name: judgement.relative for judgement in judged},
                size=size,
                widening=widening,
            ),
            *_small(lin, judged),
        ),
    )


def _small(lin: Linearisation, judged: Sequence[Judgement]) -> list[Undetermined]:
    """Coefficients that are weak for their small values alone."""
    return [
        Undetermined(
            "small",
            (row.name,),
            row.relative,
            {"judgement": row, "manoeuvre": manoeuvre(role(row.name, pushed=lin.pushed, fins=lin.fins))},
        )
        for row in judged
        if row.verdict == "weak" and row.relative <= SETTINGS.weak
    ]


def warnings_before(lin: Linearisation) -> list[Finding]:
    """What to know before a search, at its start values: what must not both be free, ill-conditioning, what
    the data will not tell.
    """
    identifiability = judge(lin)
    names = identifiability.names
    findings = [
        Finding("strips twice", Severity.PROBLEM, name, {"both": both})
        for name, made in STRIPS.items()
        if name in names and (both := [member for member in made if member in names])
    ]
    if identifiability.condition > SETTINGS.ill_conditioned:
        spectrum = identifiability.singular_values
        astray = spectrum * SETTINGS.ill_conditioned < spectrum[0]
        component = np.abs(identifiability.vectors[astray]).max(axis=0)
        along = [names[i] for i in np.flatnonzero(component > SETTINGS.named_component)]
        values = {"condition": identifiability.condition, "along": along}
        findings.append(Finding("ill-conditioned", Severity.WEAKNESS, values=values))
    return findings + [combination.finding for combination in identifiability.combinations]


def _sizes(unknowns: Sequence[Unknown], values: Array) -> tuple[Array, Array]:
    """Widths of the bounds and natural sizes (k,); without bounds the value is both, or one."""
    bounded = np.array(
        [math.isfinite(unknown.scale) and unknown.scale > 0 for unknown in unknowns], dtype=bool
    )
    width = np.where(bounded, [unknown.scale for unknown in unknowns], np.abs(values))
    width = np.where(width > 0, width, 1.0)
    size = np.minimum(np.maximum(np.abs(values), SETTINGS.small * width), SETTINGS.uniform_sd * width)
    return width, np.where(bounded, size, width)


def _verdict(relative: float, *, is_open: bool) -> Literal["identifiable", "weak", "not identifiable"]:
    if relative <= SETTINGS.weak:
        return "weak" if is_open else "identifiable"
    return "weak" if relative < SETTINGS.absent else "not identifiable"
