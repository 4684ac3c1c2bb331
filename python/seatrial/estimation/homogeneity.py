"""The homogeneous direction: mass, damping, restoring and thrust scaled together change no motion.

Both sides of ``M nu' = tau - C(nu) nu - D nu + tau_L - g + bias`` are of the first degree in mass, inertia,
added mass, damping, lift, weight, buoyancy, bias and thrust; centres, lags and dead times stay. Trials
therefore tell ratios only, and what a campaign holds decides the scale of all that it frees. Of mass and
added mass, of weight and buoyancy only the sums act: a mass held beside a free added mass holds nothing.

Source: Fossen (2011), equation 7.9, linear in its coefficients.
Tests: ``tests/estimation/test_anchor.py``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.channels import AXES, VELOCITIES
from seatrial.base.plain import Plain
from seatrial.base.report import wording
from seatrial.estimation.joint import joint_stage
from seatrial.problem.parameter import STRIPS, axes_of, coefficient_names, parameters
from seatrial.vehicle.actuators import actuator_groups, pushes

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.problem.problem import Problem

_CENTRES = frozenset(f"{axis}_{centre}" for axis in "xyz" for centre in "gb")

_CURVE = (
    *("p1_ahead", "p1_astern", "p2", "q1", "q2"),
    *(f"{name}_{side}" for name in ("a0", "a1", "a11") for side in ("ahead", "astern")),
)


@dataclass(frozen=True)
class HomogeneitySettings:
    """Thresholds of homogeneity."""

    lever: float = 1e-9  #: kg m, N m: a product smaller than this is zero


SETTINGS = HomogeneitySettings()


WRENCH, THRUST, LIFT, MASS, NET = "wrench", "thrust", "fin lift", "mass and inertia", "net weight"

RIGHTING, FORCES, STATIC = "righting moment", "damping, lift and bias", "static moment"


@dataclass(frozen=True)
class Held:
    """What a campaign holds of the homogeneous direction: its kind and its members as people write them."""

    kind: str
    members: tuple[str, ...]


@dataclass(frozen=True)
class Homogeneity(Plain, also="sentences"):
    """The homogeneous direction of a campaign: its members, which of them are free, what holds the scale."""

    #: Coefficients that scaled together change no motion.
    members: tuple[str, ...]
    #: Those of them that the campaign frees.
    free: tuple[str, ...]
    #: What is held and acts in the free axes, the most telling first; empty: the scale is arbitrary.
    held: tuple[Held, ...]

    @property
    def strong(self) -> dict[str, str]:
        """What of the held values sets the scale, by kind, the most telling first."""
        return {held.kind: ", ".join(held.members) for held in self.held if held.kind != STATIC}

    def sentences(self) -> list[str]:
        """Name of the direction, and what the scale rests on."""
        return list(wording("preparation").homogeneity(self))


def homogeneous_direction(vehicle: Vehicle) -> tuple[str, ...]:
    """Names of the coefficients that scaled together change no motion under the same commands.

    A thruster's thrust and torque are scaled by its gain; `scaled` divides its loss per newton.

    Examples
    --------
    >>> import seatrial as st
    >>> direction = homogeneous_direction(st.Vehicle.load("cwolf"))
    >>> "X_uu" in direction, "PL.gain" in direction, "z_b" in direction
    (True, True, False)
    """
    values = vehicle.coefficients()
    hull = [name for name, value in values.items() if "." not in name and name not in _CENTRES and value]
    return (*hull, *(f"{name}.gain" for name in vehicle.actuators))


def scaled(vehicle: Vehicle, factor: float) -> Vehicle:
    """Vehicle with the homogeneous direction scaled: it moves alike under the same commands."""
    values = vehicle.coefficients()
    together = {name: factor * values[name] for name in homogeneous_direction(vehicle) if name in values}
    per_newton = {name: value / factor for name, value in values.items() if name.endswith(".loss")}
    return vehicle.with_coefficients(together | per_newton)


def thrust_factors(vehicle: Vehicle, reference: Vehicle) -> dict[str, float]:
    """Thrust at rest of every actuator over that of a reference vehicle, mean of ahead and astern."""
    factors: dict[str, list[float]] = {}
    for push, other in zip(pushes(vehicle), pushes(reference), strict=True):
        size = float(np.linalg.norm(other.wrench))
        if size > 0.0:
            factors.setdefault(push.actuator, []).append(float(np.linalg.norm(push.wrench)) / size)
    return {name: float(np.mean(factor)) for name, factor in factors.items()}


def ratios(vehicle: Vehicle, reference: Vehicle) -> dict[str, float]:
    """What trials tell of the hull whatever the scale: its sums and coefficients over the mean thrust factor.

    Apparent masses and inertias, damping, lift and bias, net weight and the moments of weight and buoyancy,
    in SI per unit of thrust; zeros are left out.

    ``vehicle``: the identified one. ``reference``: that of the campaign, whose thrust is the unit.
    """
    thrust = float(np.mean(list(thrust_factors(vehicle, reference).values()) or [1.0]))
    values, mass = vehicle.coefficients(), np.asarray(vehicle.mass_matrix())
    weight, buoyancy = values["m"] * vehicle.environment()["g"], values.get("B", 0.0)
    sums = {f"{_own(axis)} - {_added(axis)}": float(mass[axis, axis]) for axis in range(6)}
    sums |= {name: values[name] for name in _coupling(vehicle)}
    sums["m g - B"] = weight - buoyancy
    for axis in "xyz":
        moment = weight * values.get(f"{axis}_g", 0.0) - buoyancy * values.get(f"{axis}_b", 0.0)
        sums[f"{axis}_g m g - {axis}_b B"] = moment
    return {name: value / thrust for name, value in sums.items() if value}


def homogeneity(problem: Problem) -> Homogeneity:
    """Homogeneous direction of a campaign, all of its stages taken together.

    Raises CampaignError: the joint estimate names what is not there.
    """
    vehicle, stage = problem.vehicle, joint_stage(problem)
    free = set(coefficient_names(parameters(stage, vehicle, f"{problem.source}: polish")))
    rows = stage.axes.free
    logged = all(problem.input_of(name) == "tau" for name in stage.trials)
    facts = vehicle.actuator_info()
    groups = actuator_groups(vehicle)
    acting = () if logged else tuple(_thrust(vehicle, free, rows))
    lifting = tuple(
        x for x in acting if all(facts[actuator]["kind"] == "fin" for actuator in groups.get(x, [x]))
    )
    directions = [
        Held(WRENCH, ("the logged wrench",) if logged else ()),
        Held(THRUST, tuple(name for name in acting if name not in lifting)),
        Held(LIFT, lifting),
        Held(MASS, tuple(_masses(free, rows))),
        Held(NET, tuple(_net_weight(vehicle, free, rows))),
        Held(RIGHTING, tuple(_righting(vehicle, free, rows))),
        Held(
            FORCES,
            tuple(name for name in _coupling(vehicle) if set(axes_of(name)) & set(rows) and name not in free),
        ),
        Held(STATIC, tuple(_static(vehicle, free, rows))),
    ]
    members = homogeneous_direction(vehicle)
    gains = [f"{name}.{key}" for name in vehicle.actuators for key in _CURVE]
    return Homogeneity(
        members=members,
        free=tuple(name for name in (*members, *gains) if name in free),
        held=tuple(direction for direction in directions if direction.members),
    )


def _thrust(vehicle: Vehicle, free: set[str], rows: str) -> Iterator[str]:
    """Groups, or actuators of a group, whose thrust is held and acts in the free rows."""
    values, matrix = vehicle.coefficients(), np.asarray(vehicle.allocation_matrix())
    acting = [AXES.index(row) for row in rows]
    held = []
    for k, name in enumerate(vehicle.actuators):
        curve = {f"{name}.{key}" for key in _CURVE if values.get(f"{name}.{key}")}
        if f"{name}.gain" in free or (curve & free) or not np.any(np.abs(matrix[acting, k]) > SETTINGS.lever):
            continue
        held.append(name)
    for group, members in actuator_groups(vehicle).items():
        own = [name for name in members if name in held]
        yield from [group] if len(own) == len(members) else own


def _masses(free: set[str], rows: str) -> Iterator[str]:
    """Diagonal of M: mass or inertia and added mass, both held."""
    for axis, row in enumerate(AXES):
        if row in rows and not {_own(axis), _added(axis)} & free:
            yield f"{_own(axis)} - {_added(axis)}"


def _net_weight(vehicle: Vehicle, free: set[str], rows: str) -> Iterator[str]:
    values = vehicle.coefficients()
    net = values["m"] * vehicle.environment()["g"] - values.get("B", 0.0)
    if "Z" in rows and abs(net) > SETTINGS.lever and not {"m", "B"} & free:
        yield "m g - B"


def _righting(vehicle: Vehicle, free: set[str], rows: str) -> Iterator[str]:
    """Moments of weight and buoyancy about O: ``r_g W - r_b B`` by component."""
    values = vehicle.coefficients()
    weight, buoyancy = values["m"] * vehicle.environment()["g"], values.get("B", 0.0)
    for axis, turned in (("x", "MN"), ("y", "KN"), ("z", "KM")):
        centres = {f"{axis}_g", f"{axis}_b"}
        moment = weight * values.get(f"{axis}_g", 0.0) - buoyancy * values.get(f"{axis}_b", 0.0)
        if set(turned) & set(rows) and abs(moment) > SETTINGS.lever and not ({"m", "B"} | centres) & free:
            yield f"{axis}_g m g - {axis}_b B"


def _coupling(vehicle: Vehicle) -> list[str]:
    """Names of damping, lift, bias and off-diagonal added mass: ``X_u``, ``Y_ur``, ``N_0``, ``C_Dy``."""
    diagonal = {_added(axis) for axis in range(6)}
    forces = tuple(f"{row}_" for row in AXES)
    return [
        name
        for name, value in vehicle.coefficients().items()
        if "." not in name and (name.startswith(forces) or name in STRIPS) and value and name not in diagonal
    ]


def _own(axis: int) -> str:
    return "m" if axis < 3 else f"I_{'xyz'[axis - 3]}"


def _added(axis: int) -> str:
    return f"{AXES[axis]}_{VELOCITIES[axis]}dot"


def _static(vehicle: Vehicle, free: set[str], rows: str) -> Iterator[str]:
    """Products of mass and centre of gravity, which couple translation and rotation."""
    values = vehicle.coefficients()
    for axis in "xyz":
        if abs(values.get(f"{axis}_g", 0.0)) > SETTINGS.lever and not {"m", f"{axis}_g"} & free and rows:
            yield f"m {axis}_g"
