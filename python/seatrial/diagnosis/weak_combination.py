"""Weak combinations: the smallest groups of coefficients that data cannot tell apart.

A group is weak when one of its members stays uncertain even if everything outside the group were known. The
smallest such group is found, the member that a bench test would give is taken as known, and the search goes
on with the rest until nothing is uncertain: a reduced echelon form of the weak subspace, one readable group
at a time.

Before groups of two and more comes the one direction that every vehicle has. The equation of motion is
homogeneous in its coefficients: masses, damping, restoring and thrust may all be multiplied by one factor,
and the motion stays the same.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.diagnosis.advice import Role, anchor
from seatrial.statistics.information import NULL, covariance, eliminate, regression

ABSENT = 1.0
"""Standard deviation over natural size from which a coefficient is not identifiable: its sign is a guess."""

WEAK = 0.25
"""Standard deviation over natural size above which it is weak: 95 % lie within half the value at best."""

_HALF = 0.5
"""Part of a standard deviation that a group must explain; the rest is a little of many others."""

_NEAR = 100.0
"""Information on one force alone over that on all forces together, from which they count as scaling together.

It is a condition index of ten, where dependence begins to matter (Belsley, Kuh & Welsch 1980, section 3.2).
"""

_CARRIED = 2.0
"""Rise of the misfit when one force stays behind from which it belongs to those that scale together."""

_TRIED = 3
"""Members up to which all groups are tried; larger ones grow along the strongest correlations."""

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
    """Smallest groups that the data cannot tell apart, those that nothing excites first.

    Parameters
    ----------
    information : ndarray, shape (k, k)
        Of the coefficients, each in its natural size.
    roles : sequence of Role
    values : ndarray, shape (k,)
        Of the coefficients, in their natural sizes.
    """
    left, groups = list(range(len(roles))), []
    while left:
        part, kinds = information[np.ix_(left, left)], [roles[i] for i in left]
        sd = np.sqrt(np.diag(covariance(part)))
        if not (sd > WEAK).any():
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
    return np.flatnonzero((sd > WEAK) & (own_sd >= _limit(sd)))


def _limit(sd: Array) -> Array:
    """Standard deviation that a group must give a member: enough for its verdict, or half of its own."""
    return np.minimum(np.where(sd >= ABSENT, ABSENT, WEAK), _HALF * sd)


def _scale(information: Array, roles: Sequence[Role], values: Array) -> tuple[Group, int] | None:
    """What scales together and the place of the force that a bench test gives; None if nothing nearly does.

    Drag, lift and thrust take the common factor or do not move; masses, weights and biases move as the data
    like best, for the fixed ones among them are part of the same sums.
    """
    drives = [i for i, role in enumerate(roles) if role.kind in _DRIVE]
    drives = drives or [i for i, role in enumerate(roles) if role.kind in _UPRIGHT][:1]
    best, most = None, _NEAR
    for drive in drives:
        follow = [i for i, role in enumerate(roles) if role.kind in _FOLLOW and i != drive]
        forced = [i for i, role in enumerate(roles) if i == drive or _takes_factor(role)]
        at, factor = forced.index(drive), values[forced]
        misfit = eliminate(information, forced, follow) * np.outer(factor, factor)
        chosen, least = _common_factor(misfit, at)
        carried = [
            i
            for i in np.flatnonzero(chosen)
            if i != at and _turned(misfit, chosen, int(i)) > _CARRIED * least
        ]
        step = np.zeros(len(roles))
        step[forced] = chosen * factor
        step[follow] = -regression(information, forced, follow) @ step[forced]
        drag = any(roles[forced[i]].kind in _DRAG for i in carried)
        if not drag or misfit[at, at] < most * least or np.abs(step).max() <= WEAK * np.sqrt(least):
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
    for count in range(2, min(_TRIED, len(sd)) + 1):
        groups = np.array(list(itertools.combinations(range(len(sd)), count)))
        blocks = unit[groups[:, :, None], groups[:, None, :]] + NULL * count * np.eye(count)
        own = np.sqrt(np.abs(np.diagonal(np.linalg.inv(blocks), axis1=1, axis2=2)))
        over = np.where(sd[groups] > WEAK, own / limit[groups], 0.0).max(axis=1)
        if over.max() >= 1.0:
            return tuple(int(i) for i in groups[int(over.argmax())])
    worst, inverse = int(sd.argmax()), covariance(information)
    order = sorted(range(len(sd)), key=lambda i: (i != worst, -abs(inverse[i, worst]) / sd[i]))
    for count in range(_TRIED + 1, len(sd)):
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
