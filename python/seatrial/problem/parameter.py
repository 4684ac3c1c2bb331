"""Free parameters: coefficients with bounds, start values and what is tied to them, and nuisance parameters.

A parameter is one number of the search. It sets one coefficient or several: those of an actuator group
(``stern.gain``: every actuator of the group) and those tied by symmetry (``Z_ww`` follows ``Y_vv``).

Nuisance parameters are what a trial adds to its record, estimated lest the coefficients absorb it: a current,
a motion-capture frame that was not levelled, the position of the velocity sensor, a late channel, a biased
one, a constant force. The core applies them (``observation.rs``); here stands how far each may plausibly lie
from zero, which trials it belongs to and whether they share it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial._core import nuisance_names
from seatrial.base.arrays import Array
from seatrial.base.channels import AXES, VELOCITIES
from seatrial.base.errors import CampaignError, nearest
from seatrial.problem.settings import Coefficient, JointSettings, Stage
from seatrial.vehicle.actuators import actuator_groups

if TYPE_CHECKING:
    from seatrial._core import Vehicle


NUISANCES: tuple[str, ...] = tuple(nuisance_names())
"""Names of nuisance parameters in the core's order."""

OF_AN_AXIS = re.compile(rf"([{AXES}])_(0|[{VELOCITIES}]dot|[{VELOCITIES}]{{1,2}})")
"""A coefficient of a force: the force's letter, and what it is proportional to."""


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
    """Parameters that a stage frees on a vehicle, which gives start values, default and relative bounds.

    ``where``: file and stage, for messages. Raises CampaignError: an unknown coefficient, a coefficient freed
    twice, no default bounds, bounds that exclude the start.
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


_SPREAD = {  # plausible distance from zero, its unit, whether all trials share it
    "current": (0.3, "m/s", False),
    "tilt": (0.05, "rad", False),
    "lever": (0.3, "m", True),
    "latency": (0.1, "s", True),
}

_FORCE = {"XYZ": (5.0, "N"), "KMN": (2.0, "N m")}

_BIAS = {"uvw": (0.02, "m/s"), "pqr": (0.01, "rad/s"), "xyz": (0.2, "m"), "angles": (0.05, "rad")}


@dataclass(frozen=True)
class Nuisance:
    """One nuisance parameter: its column in the core's row, the trials that it belongs to, its prior.

    The prior is centred at zero; ``sd`` is in ``unit``.
    """

    name: str
    key: str
    column: int
    trials: tuple[int, ...]
    unit: str
    sd: float


def nuisances(polish: JointSettings, trials: Sequence[str], where: str) -> tuple[Nuisance, ...]:
    """Nuisance parameters that a campaign asks for on its trials.

    ``trials``: the trials of the joint estimate, in its order. ``where``: words for messages. Raises
    CampaignError: an unknown nuisance parameter or trial.
    """
    parameters = []
    for key, entry in polish.nuisances.items():
        if key not in NUISANCES:
            raise CampaignError(
                f"{where}, key nuisances: unknown nuisance parameter {key!r}{nearest(key, NUISANCES)};"
                f" there are {', '.join(NUISANCES)}"
            )
        for name in entry.trials:
            if name not in trials:
                raise CampaignError(
                    f"{where}, key nuisances, {key}: trial {name!r} is not in the joint estimate"
                    + nearest(name, trials)
                )
        sd, unit, shared = nuisance_prior(key)
        chosen = [index for index, name in enumerate(trials) if not entry.trials or name in entry.trials]
        together = shared if entry.shared is None else entry.shared
        for group in [tuple(chosen)] if together else [(index,) for index in chosen]:
            label = key if len(group) == len(trials) else f"{', '.join(trials[i] for i in group)}: {key}"
            parameters.append(Nuisance(label, key, NUISANCES.index(key), group, unit, entry.sd or sd))
    return tuple(parameters)


def nuisance_rows(parameters: Sequence[Nuisance], values: Array, trials: int) -> Array:
    """Core's rows (trials, 38) of the values of nuisance parameters."""
    table = np.zeros((trials, len(NUISANCES)))
    for nuisance, value in zip(parameters, values, strict=True):
        table[list(nuisance.trials), nuisance.column] = value
    return table


def nuisance_prior(key: str) -> tuple[float, str, bool]:
    """Standard deviation, unit, and whether all trials share it, unless the campaign says otherwise."""
    kind, _, channel = key.partition("_")
    if kind in _SPREAD:
        return _SPREAD[kind]
    if kind == "force":
        return *next(entry for axes, entry in _FORCE.items() if channel in axes), False
    sd, unit = next((entry for channels, entry in _BIAS.items() if channel in channels), _BIAS["angles"])
    return sd, unit, False
