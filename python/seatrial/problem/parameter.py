"""Free parameters of a stage: coefficients, bounds, start values, and what is tied to them.

A parameter is one number of the search. It sets one coefficient or several: those of an actuator group
(``stern.gain``: every actuator of the group) and those tied by symmetry (``Z_ww`` follows ``Y_vv``).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES, VELOCITIES
from seatrial.base.errors import CampaignError, nearest
from seatrial.problem.settings import Coefficient, Stage
from seatrial.vehicle.actuators import actuator_groups

if TYPE_CHECKING:
    from seatrial._core import Vehicle

OF_AN_AXIS = re.compile(rf"([{AXES}])_(0|[{VELOCITIES}]dot|[{VELOCITIES}]{{1,2}})")
"""A coefficient of a force: the force's letter, and what it is proportional to."""

STRIPS = {"C_Dy": ("Y_vv", "Y_rr", "N_vv", "N_rr"), "C_Dz": ("Z_ww", "Z_qq", "M_ww", "M_qq")}
"""Drag coefficients of the strips of the hull, and the quadratic damping that they stand for."""


def axes_of(name: str) -> str:
    """Letters of the axes on which a coefficient of the hull acts alone; none for mass, centres, actuators.

    Examples
    --------
    >>> axes_of("N_rr"), axes_of("C_Dy"), axes_of("z_g")
    ('N', 'YN', '')
    """
    match = OF_AN_AXIS.fullmatch(name)
    return match[1] if match else {"C_Dy": "YN", "C_Dz": "ZM"}.get(name, "")


# Unit, start value and default bounds by coefficient, as the vehicle gives them: asked for once per stage.
_Facts = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True)
class Parameter:
    """One number of the search, in the unit of its first coefficient.

    ``members`` are the coefficients that it sets, each with its factor. ``sd`` is the standard deviation with
    which ``start`` is known beforehand, infinite where nothing is: a prior of the joint estimate.
    """

    name: str
    members: tuple[tuple[str, float], ...]
    unit: str
    start: float
    lower: float
    upper: float
    start_given: bool
    sd: float = math.inf

    def coefficients(self, value: float) -> dict[str, float]:
        """Coefficients that this value sets."""
        return {name: factor * value for name, factor in self.members}


def parameters(stage: Stage, vehicle: Vehicle, where: str) -> tuple[Parameter, ...]:
    """Parameters that a stage frees on a vehicle.

    Parameters
    ----------
    stage : Stage
    vehicle : Vehicle
        The campaign's vehicle: it gives start values, default bounds and the reference of relative bounds.
    where : str
        Words for messages: file and stage.

    Raises
    ------
    CampaignError
        An unknown coefficient, a coefficient freed twice, no default bounds, bounds that exclude the start.
    """
    known = vehicle.coefficient_info()
    freed = tuple(
        _parameter(name, entry, vehicle, known, f"{where}, coefficient {name!r}")
        for name, entry in stage.coefficients.items()
    )
    owner: dict[str, str] = {}
    for parameter in freed:
        for member, _ in parameter.members:
            if member in owner:
                raise CampaignError(
                    f"{where}: coefficient {member!r} is set by {owner[member]!r} and by {parameter.name!r};"
                    " free or tie it once"
                )
            owner[member] = parameter.name
    return freed


def coefficient_names(chosen: Sequence[Parameter]) -> list[str]:
    """Coefficients that the parameters set, in the order of `expansion_matrix`."""
    return [member for parameter in chosen for member, _ in parameter.members]


def expansion_matrix(chosen: Sequence[Parameter]) -> Array:
    """Matrix ``(m, n)``: parameters ``(k, m)`` times it are coefficient values ``(k, n)``."""
    matrix = np.zeros((len(chosen), sum(len(parameter.members) for parameter in chosen)))
    column = 0
    for row, parameter in enumerate(chosen):
        for _, factor in parameter.members:
            matrix[row, column] = factor
            column += 1
    return matrix


def coefficients(chosen: Sequence[Parameter], values: Sequence[float] | Array) -> dict[str, float]:
    """Coefficients that the parameters' values set."""
    return {
        name: value
        for parameter, x in zip(chosen, values, strict=True)
        for name, value in parameter.coefficients(float(x)).items()
    }


def _expand(name: str, vehicle: Vehicle, known: _Facts, where: str) -> list[str]:
    """Coefficients behind a name: itself, or that of every actuator of a group."""
    for candidate in (name, _transposed(name)):
        if candidate in known:
            return [candidate]
    groups = actuator_groups(vehicle)
    group, _, suffix = name.partition(".")
    members = [f"{actuator}.{suffix}" for actuator in groups.get(group, [])]
    if members and all(member in known for member in members):
        return members
    of_groups = [
        f"{key}.{member.partition('.')[2]}"
        for key, actuators in groups.items()
        for member in known
        if member.startswith(f"{actuators[0]}.")
    ]
    raise CampaignError(
        f"{where}: vehicle {vehicle.name!r} has no such coefficient{nearest(name, [*known, *of_groups])}"
    )


def _transposed(name: str) -> str:
    """The other name of an added-mass derivative: the matrix is symmetric, so N_vdot is Y_rdot."""
    force, _, velocity = name.removesuffix("dot").partition("_")
    if not name.endswith("dot") or force not in AXES or velocity not in VELOCITIES:
        return name
    return f"{AXES[VELOCITIES.index(velocity)]}_{VELOCITIES[AXES.index(force)]}dot"


def _parameter(name: str, entry: Coefficient, vehicle: Vehicle, known: _Facts, where: str) -> Parameter:
    values = vehicle.coefficients()
    own = _expand(name, vehicle, known, where)
    first = values.get(own[0], 0.0)
    if entry.relative and any(values.get(member, 0.0) == 0.0 for member in own):
        raise CampaignError(
            f"{where}: relative bounds need a value in the vehicle file, but {own[0]!r} is zero;"
            " give the value there or absolute bounds here"
        )
    members = [(member, values[member] / first if entry.relative else 1.0) for member in own]
    for tie in entry.tie:
        members += [(member, tie.factor) for member in _expand(tie.name, vehicle, known, f"{where}, tie")]

    facts = known[own[0]]
    unit = str(facts["unit"])
    scale = first if entry.relative else 1.0
    start = first if entry.start is None else scale * entry.start
    if entry.bounds is None:
        lower, upper = (math.nan if facts[s] is None else float(facts[s]) for s in ("lower", "upper"))
        if not (math.isfinite(lower) and math.isfinite(upper) and lower < upper):
            raise CampaignError(f"{where}: there are no default bounds; give [lower, upper] in {unit}")
    else:
        lower, upper = sorted(scale * bound for bound in entry.bounds)
    if not lower <= start <= upper:
        origin = "its start value" if entry.start is not None else "the vehicle's value"
        raise CampaignError(
            f"{where}: the bounds [{lower:g}, {upper:g}] exclude {origin} {start:g} {unit};"
            " widen the bounds or set start inside them"
        )
    sd = math.inf if entry.sd is None else abs(scale) * entry.sd
    return Parameter(name, tuple(members), unit, start, lower, upper, entry.start is not None, sd)
