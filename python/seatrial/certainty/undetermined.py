"""What a linearised estimate leaves undetermined, and the sentence that says what would determine it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from seatrial.certainty.excitation import VELOCITIES, role
from seatrial.certainty.information import covariance, eliminate
from seatrial.certainty.manoeuvre_advice import absorbed, inseparable, scaled, unexcited
from seatrial.certainty.weak_combination import WEAK, Group, weak_groups
from seatrial.linearisation import Linearisation
from seatrial.search import Array

ROUNDING = 1e3
"""Standard deviation over natural size from which rounding speaks, not the data."""

_STILL = (0.02, 0.02, 0.02, 0.01, 0.01, 0.01)  # m/s and rad/s: noise of a Doppler log and of a small gyro
_HIDDEN = 2.0  # ratio of standard deviations with the nuisance parameters unknown and known


@dataclass(frozen=True)
class Undetermined:
    """Coefficients that the data cannot tell, and the sentence that says what would.

    ``kind`` is "unexcited" (not even if all others were known), "nuisance" (hidden by a nuisance parameter),
    "scale" (all forces together) or "combination". ``relative`` is the largest standard deviation among them
    over its natural size, infinite if the data tell nothing; of a scale that of the common factor.
    """

    kind: Literal["unexcited", "nuisance", "scale", "combination"]
    names: tuple[str, ...]
    relative: float
    sentence: str


def undetermined(
    lin: Linearisation, information: Array, *, relative: Mapping[str, float], size: Array, widening: Array
) -> tuple[Undetermined, ...]:
    """What is undetermined, each weak coefficient at least once; what nothing excites comes first.

    Parameters
    ----------
    lin : Linearisation
    information : ndarray, shape (k, k)
        On the coefficients, nuisance parameters unknown.
    relative : mapping
        Standard deviation of every coefficient over its natural size, in the order of the information.
    size, widening : ndarray, shape (k,)
        Natural sizes, and by how much the memory of the residuals widens each standard deviation.
    """
    names = tuple(relative)
    natural = size / widening
    inside = [i for i, one in enumerate(lin.unknowns) if one.kind == "coefficient"]
    sized = information * np.outer(natural, natural)
    groups = list(weak_groups(sized, [role(name) for name in names], lin.values[inside] / natural))
    told = {i for group in groups for i in group.places}
    groups += [
        Group("unexcited", (i,), relative[name])
        for i, name in enumerate(names)
        if relative[name] > WEAK and i not in told
    ]
    total = lin.information()
    found: list[Undetermined] = []
    single: list[str] = []
    for group in groups:
        members = tuple(names[i] for i in group.places)
        hidden = _hidden(lin, total, group, natural)
        if hidden:
            found.append(Undetermined("nuisance", members, _capped(group.sd), absorbed(members, hidden)))
        elif group.kind == "scale":
            factor_sd = _capped(group.sd * float(np.median(widening[list(group.places)])))
            found.append(Undetermined("scale", members, factor_sd, scaled(members, factor_sd)))
        elif group.kind == "combination":
            found.append(Undetermined("combination", members, _capped(group.sd), inseparable(members)))
        else:
            single += members
    blind = {name for name, value in zip(names, np.diag(sized), strict=True) if value * ROUNDING**2 < 1.0}
    return (*_unexcited(lin, [name for name in names if name in single], blind, relative), *found)


def _unexcited(
    lin: Linearisation, single: Sequence[str], blind: set[str], relative: Mapping[str, float]
) -> list[Undetermined]:
    moving = _moving(lin)
    silent = blind.intersection(single)
    locked = {role(name).force for name in silent if moving.issuperset(role(name).velocities)} - {""}
    sentences = unexcited(
        single,
        moving=moving,
        silent=silent | {name for name in single if role(name).force in locked},
        seen={name for name, value in relative.items() if value <= WEAK},
    )
    return [
        Undetermined("unexcited", members, max(relative[name] for name in members), sentence)
        for members, sentence in sentences.items()
    ]


def _hidden(lin: Linearisation, total: Array, group: Group, natural: Array) -> str | None:
    """Nuisance parameter that hides a group which the data would tell if all of these were known."""
    outside = [i for i, one in enumerate(lin.unknowns) if one.kind == "nuisance"]
    inside = [i for i, one in enumerate(lin.unknowns) if one.kind == "coefficient"]
    if not outside:
        return None
    chosen, sizes = [inside[i] for i in group.places], natural[list(group.places)]
    scale = np.outer(sizes, sizes)
    known = np.sqrt(np.diag(covariance(total[np.ix_(chosen, chosen)] * scale)))
    told = eliminate(total, chosen, outside) * scale
    unknown = np.sqrt(np.diag(covariance(told)))
    worst = int(unknown.argmax())
    if known.max() > WEAK or unknown[worst] < _HIDDEN * known[worst]:
        return None
    _, directions = np.linalg.eigh(told)
    along = directions[:, 0] * sizes
    own = np.diag(total)[outside]
    shared = (along @ total[np.ix_(chosen, outside)]) ** 2 / np.where(own > 0, own, np.inf)
    return lin.unknowns[outside[int(shared.argmax())]].name


def _moving(lin: Linearisation) -> set[str]:
    """Velocities whose root mean square in some segment is above what instruments show of a still vehicle."""
    rms = np.zeros(6)
    for piece in lin.pieces:
        rms = np.fmax(rms, np.sqrt(np.mean(piece.nu**2, axis=0)))
    return {letter for letter, value, still in zip(VELOCITIES, rms, _STILL, strict=True) if value > still}


def _capped(sd: float) -> float:
    return sd if sd <= ROUNDING else math.inf
