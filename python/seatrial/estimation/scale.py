"""Absolute scale of an identified vehicle: what trials cannot tell, what an anchor implies, what was held.

Both sides of ``M nu' = tau - C(nu) nu - D nu + tau_L - g + bias`` are of the first degree in mass, inertia,
added mass, damping, lift, weight, buoyancy, bias and thrust; centres, lags and dead times stay. Scaled
together they change no motion (the homogeneous direction): trials tell ratios only, and what a campaign holds
decides the scale of all that it frees. Of mass and added mass, of weight and buoyancy only the sums act: a
mass held beside a free added mass holds nothing.

An anchor is one known force or mass; over the same one in the identified vehicle it gives the factor:

* bollard: force measured at rest over that of the model's thrusters under the same commands;
* ballast: its weight in water over the force that the model needs for the answer that was seen: a steady
  sinking (damping), an angle at rest (righting moment) or commands that hold depth (thrust);
* dry mass: m (1 + a) over the identified apparent mass, in surge m - X_udot. The ratio a of added mass is
  an assumption: by default between Lamb's factor k times the water that the mass itself displaces and k times
  the water in the ellipsoid of the hull's measures, for water inside an open frame moves along or does not.

The factor turns the vehicle into true values: thrust gains, added masses, net weight, height of the centre of
gravity. Values that cannot be are named. Without an anchor one is asked for.

Source: Lamb, *Hydrodynamics* (1932), sections 114 and 121a: ``k = alpha_0/(2 - alpha_0)``, the integral
alpha_0 by Carlson's R_D (Carlson, *Numerical Algorithms* 10, 1995, 13); Fossen (2011), section 4.1.2
(righting moment), equation 7.9.
Tests: ``tests/estimation/test_anchor.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.channels import AXES, VELOCITIES
from seatrial.base.errors import CampaignError, nearest
from seatrial.base.plain import Plain
from seatrial.base.report import wording, words_about
from seatrial.problem.parameter import axes_of, coefficient_names, parameters
from seatrial.problem.settings import STRIPS, Anchor, Ballast, Bollard, DryMass
from seatrial.vehicle.actuators import NOMINAL_V, actuator_groups, bollard, pushes

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.problem.problem import Problem


MOTIONS = {"X": "surge", "Y": "sway", "Z": "heave"}


@dataclass(frozen=True)
class Factor:
    """True over identified forces by one anchor, what it rests on, and where it lies.

    ``lower`` and ``upper`` are two standard deviations away, or follow from the assumption. ``value`` is not
    a number where the anchor contradicts the sign of the vehicle's answer.
    """

    anchor: str
    assumption: str
    value: float
    lower: float
    upper: float


def bollard_factor(vehicle: Vehicle, pull: Bollard) -> Factor:
    """Factor by a bollard pull.

    Raises CampaignError: an unknown actuator, or commands that give no force along the axis.
    """
    force = _thrust_factor(vehicle, pull)["XYZ".index(pull.axis)]
    if abs(force) < 1e-9:
        raise CampaignError(
            f"anchor bollard: the commands give no force along {pull.axis}; correct commands or axis"
        )
    return _spread(
        "Bollard pull", f"{pull.force_n:g} N along {pull.axis}", pull.force_n / force, pull.sd_percent
    )


def ballast_factor(vehicle: Vehicle, ballast: Ballast) -> Factor:
    """Factor by a ballast: its weight in water over the force that the model needs for the same answer.

    Raises CampaignError: an unknown actuator.
    """
    water = vehicle.environment()
    weight = (ballast.mass_kg - water["rho"] * ballast.volume_m3) * water["g"]
    if ballast.roll_deg is not None:
        needed, answer = _inclining(vehicle, ballast), f"roll {ballast.roll_deg:g} deg"
    elif ballast.pitch_deg is not None:
        needed, answer = _inclining(vehicle, ballast), f"pitch {ballast.pitch_deg:g} deg"
    else:
        sink = ballast.sink_m_s or 0.0
        terms = vehicle.forces(np.array([0.0, 0.0, sink, 0.0, 0.0, 0.0]), np.zeros(3))
        needed = -sum(float(np.asarray(terms[key])[2]) for key in terms)
        answer = f"sinks at {sink:g} m/s"
        if ballast.commands:
            needed -= float(_thrust_factor(vehicle, ballast)[2])
            answer = "depth held by thrust"
    factor = weight / needed if weight * needed > 0.0 else math.nan
    return _spread("Ballast", f"{weight:.3g} N in water, {answer}", factor, ballast.sd_percent)


def dry_mass_factor(vehicle: Vehicle, dry: DryMass) -> Factor:
    """Factor by the dry mass and an assumed added mass.

    Raises CampaignError: the hull's measures are missing, and the ratio of added mass is not given.
    """
    mass, axis = dry.mass_kg + dry.water_kg, "XYZ".index(dry.axis)
    least, most = sorted(dry.added or _added_ratio(vehicle, mass, axis))
    source = "" if dry.added else ", between its own displacement and the ellipsoid of the hull's measures"
    identified = float(np.asarray(vehicle.mass_matrix())[axis, axis])
    lower, upper = mass * (1.0 + least) / identified, mass * (1.0 + most) / identified
    spread = 2e-2 * (dry.sd_percent or 0.0)
    return Factor(
        "Dry mass",
        f"assumes added mass in {MOTIONS[dry.axis]} of {least:.2g} to {most:.2g} times {mass:.4g} kg{source}",
        math.sqrt(lower * upper),
        lower * (1.0 - spread),
        upper * (1.0 + spread),
    )


def added_mass_factor(semi_axes: tuple[float, float, float], axis: int) -> float:
    """Lamb's factor k of an ellipsoid: added mass over displaced water, moving along one of its axes.

    Examples
    --------
    >>> round(added_mass_factor((0.5, 0.5, 0.5), 0), 12)
    0.5
    """
    from scipy.special import elliprd

    a, b, c = (semi_axes[(axis + i) % 3] for i in range(3))
    alpha = 2.0 / 3.0 * a * b * c * float(elliprd(b * b, c * c, a * a))
    return alpha / (2.0 - alpha)


def _added_ratio(vehicle: Vehicle, mass: float, axis: int) -> tuple[float, float]:
    hull = vehicle.geometry()
    if not hull:
        raise CampaignError(
            f"anchor dry_mass: vehicle {vehicle.name!r} has no [geometry] to take added mass from; give"
            " added = [least, most], added mass over mass"
        )
    half = (0.5 * hull["length"], 0.5 * hull["diameter"], 0.5 * hull["height"])
    k = added_mass_factor(half, axis)
    return k, k * vehicle.environment()["rho"] * 4.0 / 3.0 * math.pi * math.prod(half) / mass


def _thrust_factor(vehicle: Vehicle, test: Bollard | Ballast) -> list[float]:
    """Force (3,) at rest under a test's commands, those of a group given to each of its actuators, N."""
    groups = actuator_groups(vehicle)
    commands: dict[str, float] = {}
    for name, value in test.commands.items():
        if name not in groups and name not in vehicle.actuators:
            known = [*vehicle.actuators, *groups]
            raise CampaignError(f"anchor, key commands: unknown actuator {name!r}{nearest(name, known)}")
        commands |= dict.fromkeys(groups.get(name, [name]), value)
    return [float(x) for x in bollard(vehicle, commands, voltage_v=test.voltage_v or NOMINAL_V)[:3]]


def _inclining(vehicle: Vehicle, ballast: Ballast) -> float:
    """Downward force at the ballast's place, N, that holds the model at the angle; zero without an arm."""
    roll, pitch = (math.radians(angle or 0.0) for angle in (ballast.roll_deg, ballast.pitch_deg))
    terms = vehicle.forces(np.zeros(6), np.array([roll, pitch, 0.0]))
    x, y, z = ballast.position_m or (0.0, 0.0, 0.0)
    axis, arm = (
        (3, y * math.cos(roll) - z * math.sin(roll))
        if ballast.roll_deg is not None
        else (4, -x * math.cos(pitch) - z * math.sin(pitch))
    )
    return -float(np.asarray(terms["restoring"])[axis]) / arm if arm else 0.0


def _spread(anchor: str, words: str, value: float, sd_percent: float | None) -> Factor:
    spread = 2e-2 * (sd_percent or 0.0)
    return Factor(anchor, words, value, value * (1.0 - spread), value * (1.0 + spread))


@dataclass(frozen=True)
class ScaleSettings:
    """What thrust and weight of a vehicle are plausible."""

    #: Plausible thrust over a bollard table: mounting, wake and voltage drop cost much, nothing adds half.
    gains: tuple[float, float] = (0.2, 1.5)
    #: Net buoyancy over the weight: a submerged vehicle is trimmed to a few tenths of a per cent.
    net_share: float = 0.05
    #: Relative standard deviation of an anchor that states none, where anchors are compared.
    unstated_sd: float = 0.1


SCALE_SETTINGS = ScaleSettings()


@dataclass(frozen=True)
class Implied(Plain, also="added_kg warnings"):
    """What an anchor implies for an identified vehicle."""

    #: True over identified forces.
    factor: Factor
    #: Mass beside which added mass is told, and by which the centre of gravity is placed: dry mass and water
    #: where they are given, else the vehicle's m.
    mass_kg: float
    #: True mass plus added mass in surge, sway and heave.
    apparent_kg: dict[str, float]
    #: True thrust over that of the campaign's vehicle, per group, or per actuator where they differ.
    gains: dict[str, float]
    #: True ``W - B``.
    net_weight_n: float
    #: Centre of gravity below the centre of buoyancy, as implied and in the campaign's vehicle.
    centre_height_m: float
    file_height_m: float
    g: float

    @property
    def added_kg(self) -> dict[str, float]:
        """True added mass in surge, sway and heave."""
        return {motion: mass - self.mass_kg for motion, mass in self.apparent_kg.items()}

    @property
    def odd_gains(self) -> dict[str, float]:
        """Gains that no bollard table is wrong by."""
        least, most = SCALE_SETTINGS.gains
        return {name: gain for name, gain in self.gains.items() if not least <= gain <= most}

    @property
    def heavy(self) -> bool:
        """Whether the net weight is more than a vehicle is trimmed to."""
        return abs(self.net_weight_n) > SCALE_SETTINGS.net_share * self.mass_kg * self.g

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences about what cannot be."""
        return tuple(wording("preparation").warnings(self))

    def sentences(self, *, identified: bool = True) -> list[str]:
        """The factor, what follows from it, what cannot be; before an identification of the thrust alone."""
        return list(wording("preparation").implied(self, identified=identified))


@dataclass(frozen=True)
class ScaleReport(Plain, without="identified", also="sentences"):
    """The scale of all forces: what it rests on, what the anchors imply, coefficients free of it."""

    #: The homogeneous direction of the campaign.
    homogeneity: Homogeneity
    #: One per anchor: of an identified vehicle all, before that bollard pulls only.
    implied: tuple[Implied, ...]
    #: Anchors that are judged once the vehicle is identified.
    waiting: tuple[str, ...]
    #: What trials tell whatever the scale, over the mean thrust factor; empty before the identification.
    ratios: dict[str, float]
    #: Whether it is an identified vehicle that was judged.
    identified: bool
    #: Groups or actuators whose thrust the campaign's bench test measured.
    tested: tuple[str, ...] = ()

    @property
    def agreement(self) -> bool | None:
        """Whether all anchors can hold at once; None of fewer than two."""
        known = self.factors
        if len(known) < 2:
            return None
        lower = max(min(factor.lower, factor.value * (1.0 - SCALE_SETTINGS.unstated_sd)) for factor in known)
        upper = min(max(factor.upper, factor.value * (1.0 + SCALE_SETTINGS.unstated_sd)) for factor in known)
        return lower <= upper

    @property
    def factors(self) -> list[Factor]:
        """Factors of the anchors that do not contradict the vehicle."""
        return [implied.factor for implied in self.implied if math.isfinite(implied.factor.value)]

    def sentences(self) -> list[str]:
        """What the scale rests on, what the anchors imply; where there is none, a request for one."""
        return words_about(self, "preparation")


def judge_scale(problem: Problem, vehicle: Vehicle | None = None) -> ScaleReport:
    """Judgement of a campaign's scale.

    Parameters
    ----------
    problem : Problem
    vehicle : Vehicle, optional
        The identified one; without it only bollard pulls are judged, on the thrust of the vehicle file.

    Raises
    ------
    CampaignError
        An anchor names an unknown actuator, commands without force or a hull without measures.
    """
    direction, anchor = homogeneity(problem), problem.anchor
    tested = () if problem.bench is None else tuple(problem.bench.pulls)
    if vehicle is None:
        try:
            every = implied(problem.vehicle, anchor)  # refuses here what could not be judged later
        except CampaignError as error:
            raise CampaignError(f"{problem.source}: {error}") from None
        waiting = [implied.factor.anchor for implied in every[len(anchor.bollard) :]]
        return ScaleReport(direction, every[: len(anchor.bollard)], tuple(waiting), {}, False, tested)
    known = implied(vehicle, anchor, reference=problem.vehicle)
    return ScaleReport(direction, known, (), ratios(vehicle, problem.vehicle), True, tested)


def implied(vehicle: Vehicle, anchor: Anchor, *, reference: Vehicle | None = None) -> tuple[Implied, ...]:
    """What every anchor implies for a vehicle: bollard pulls first, ballasts, then the dry mass.

    ``vehicle``: the identified one. ``anchor``: the ``[anchor]`` section of a campaign. ``reference``: thrust
    gains are relative to its thrust; to the vehicle's own without its gains when omitted. Raises
    CampaignError: an anchor names an unknown actuator, commands without force or a hull without measures.

    Examples
    --------
    >>> import seatrial as st
    >>> from seatrial.problem.settings import Anchor
    >>> [one] = implied(st.Vehicle.load("cwolf"), Anchor.model_validate({"dry_mass": {"mass_kg": 135.0}}))
    >>> round(one.factor.value, 2)
    1.0
    """
    factors = [bollard_factor(vehicle, pull) for pull in anchor.bollard]
    factors += [ballast_factor(vehicle, ballast) for ballast in anchor.ballast]
    dry, values = anchor.dry_mass, vehicle.coefficients()
    if dry is not None:
        factors.append(dry_mass_factor(vehicle, dry))
    if not factors:
        return ()
    mass = dry.mass_kg + dry.water_kg if dry is not None else values["m"]
    gains = {name: values.get(f"{name}.gain", 0.0) for name in vehicle.actuators}
    thrust = gains if reference is None else thrust_factors(vehicle, reference)
    file = (reference or vehicle).coefficients()
    height = file.get("z_g", 0.0) - file.get("z_b", 0.0)
    return tuple(_implied(vehicle, factor, mass, thrust, height) for factor in factors)


def _implied(
    vehicle: Vehicle, factor: Factor, mass: float, thrust: Mapping[str, float], file_height_m: float
) -> Implied:
    values, g = vehicle.coefficients(), vehicle.environment()["g"]
    weight, buoyancy = values["m"] * g, values.get("B", 0.0)
    righting = weight * values.get("z_g", 0.0) - buoyancy * values.get("z_b", 0.0)
    diagonal, s = np.asarray(vehicle.mass_matrix()).diagonal(), factor.value
    gains: dict[str, float] = {}
    for group, members in actuator_groups(vehicle).items():
        own = {name: s * thrust[name] for name in members if name in thrust}
        alike = own and max(own.values()) - min(own.values()) <= 1e-6 * abs(max(own.values()))
        gains |= {group: max(own.values())} if alike else own
    return Implied(
        factor=factor,
        mass_kg=mass,
        apparent_kg={motion: float(s * diagonal[i]) for i, motion in enumerate(MOTIONS.values())},
        gains=gains,
        net_weight_n=s * (weight - buoyancy),
        centre_height_m=s * righting / (mass * g),
        file_height_m=file_height_m,
        g=g,
    )


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
    in SI per unit of the thrust of a reference vehicle; zeros are left out.
    """
    thrust = float(np.mean(list(thrust_factors(vehicle, reference).values()) or [1.0]))
    values, mass, g = vehicle.coefficients(), np.asarray(vehicle.mass_matrix()), vehicle.environment()["g"]
    sums = {_mass(axis): float(mass[axis, axis]) for axis in range(6)}
    sums |= {name: values[name] for name in _coupling(values)}
    sums["m g - B"] = values["m"] * g - values.get("B", 0.0)
    sums |= _moments(values, g)
    return {name: value / thrust for name, value in sums.items() if value}


def homogeneity(problem: Problem) -> Homogeneity:
    """Homogeneous direction of a campaign, all of its stages taken together.

    Raises CampaignError: the joint estimate names what is not there.
    """
    vehicle, stage = problem.vehicle, problem.joint_stage()
    free = set(coefficient_names(parameters(stage, vehicle, f"{problem.source}: polish")))
    rows = stage.axes.free
    logged = all(problem.input_of(name) == "tau" for name in stage.trials)
    values, facts, groups = vehicle.coefficients(), vehicle.actuator_info(), actuator_groups(vehicle)
    g, least = vehicle.environment()["g"], SETTINGS.lever
    acting = () if logged else _thrust(vehicle, groups, free, rows)
    lifting = [x for x in acting if all(facts[actuator]["kind"] == "fin" for actuator in groups.get(x, [x]))]
    net, trimmed = values["m"] * g - values.get("B", 0.0), bool({"m", "B"} & free)
    # Each kind with those of its members that are held and act in the free axes, the most telling first.
    kinds: dict[str, Iterable[str]] = {
        WRENCH: ["the logged wrench"] if logged else [],
        THRUST: [name for name in acting if name not in lifting],
        LIFT: lifting,
        # Diagonal of M: mass or inertia and added mass, both held.
        MASS: [_mass(k) for k in range(6) if AXES[k] in rows and not {_own(k), _added(k)} & free],
        NET: ["m g - B"] if "Z" in rows and abs(net) > least and not trimmed else [],
        RIGHTING: [
            name
            for name, moment in _moments(values, g).items()
            if set({"x": "MN", "y": "KN", "z": "KM"}[name[0]]) & set(rows)
            and abs(moment) > least
            and not trimmed
            and not {f"{name[0]}_g", f"{name[0]}_b"} & free
        ],
        FORCES: [name for name in _coupling(values) if set(axes_of(name)) & set(rows) and name not in free],
        # Products of mass and centre of gravity couple translation and rotation.
        STATIC: [
            f"m {axis}_g"
            for axis in "xyz"
            if abs(values.get(f"{axis}_g", 0.0)) > least and not {"m", f"{axis}_g"} & free and rows
        ],
    }
    members = homogeneous_direction(vehicle)
    gains = [f"{name}.{key}" for name in vehicle.actuators for key in _CURVE]
    return Homogeneity(
        members=members,
        free=tuple(name for name in (*members, *gains) if name in free),
        held=tuple(Held(kind, tuple(names)) for kind, names in kinds.items() if names),
    )


def _thrust(vehicle: Vehicle, groups: Mapping[str, list[str]], free: set[str], rows: str) -> list[str]:
    """Groups, or actuators of a group, whose thrust is held and acts in the free rows."""
    values, matrix = vehicle.coefficients(), np.asarray(vehicle.allocation_matrix())
    acting = [AXES.index(row) for row in rows]
    held = []
    for k, name in enumerate(vehicle.actuators):
        curve = {f"{name}.{key}" for key in _CURVE if values.get(f"{name}.{key}")}
        if f"{name}.gain" in free or (curve & free) or not np.any(np.abs(matrix[acting, k]) > SETTINGS.lever):
            continue
        held.append(name)
    names = []
    for group, members in groups.items():
        own = [name for name in members if name in held]
        names += [group] if len(own) == len(members) else own
    return names


def _moments(values: Mapping[str, float], g: float) -> dict[str, float]:
    """Moments of weight and buoyancy about O by name: ``r_g W - r_b B`` by component, N m."""
    weight, buoyancy = values["m"] * g, values.get("B", 0.0)
    return {
        f"{axis}_g m g - {axis}_b B": weight * values.get(f"{axis}_g", 0.0)
        - buoyancy * values.get(f"{axis}_b", 0.0)
        for axis in "xyz"
    }


def _coupling(values: Mapping[str, float]) -> list[str]:
    """Names of damping, lift, bias and off-diagonal added mass: ``X_u``, ``Y_ur``, ``N_0``, ``C_Dy``."""
    diagonal = {_added(axis) for axis in range(6)}
    forces = tuple(f"{row}_" for row in AXES)
    return [
        name
        for name, value in values.items()
        if "." not in name and (name.startswith(forces) or name in STRIPS) and value and name not in diagonal
    ]


def _own(axis: int) -> str:
    return "m" if axis < 3 else f"I_{'xyz'[axis - 3]}"


def _added(axis: int) -> str:
    return f"{AXES[axis]}_{VELOCITIES[axis]}dot"


def _mass(axis: int) -> str:
    return f"{_own(axis)} - {_added(axis)}"
