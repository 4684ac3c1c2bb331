"""The homogeneous direction: mass, damping, restoring and thrust scaled together change no motion.

Both sides of ``M nu' = tau - C(nu) nu - D nu + tau_L - g + bias`` are of the first degree in mass, inertia,
added mass, damping, lift, weight, buoyancy, bias and thrust; centres, lags and dead times stay. Trials
therefore tell ratios only, and what a campaign holds decides the scale of all that it frees. Of mass and
added mass, of weight and buoyancy only the sums act: a mass held beside a free added mass holds nothing.

Source: Fossen (2011), equation 7.9, linear in its coefficients.
Tests: ``tests/estimation/test_anchor.py``.

What an absolute anchor implies for an identified vehicle: a sanity check, printed.

An identified vehicle is right up to one factor on all forces (`seatrial.estimation.scale`). The factor of
an anchor (`seatrial.estimation.scale`) turns it into true values: thrust gains, added masses, net
weight, height of the centre of gravity. What cannot be is said. Without an anchor one is asked for.

Source: Fossen (2011), section 4.1.2 (righting moment), equation 7.9.
Tests: ``tests/estimation/test_anchor.py``.

Scale by an absolute anchor: one known force or mass over the same one in an identified vehicle.

* bollard: force measured at rest over that of the model's thrusters under the same commands;
* ballast: its weight in water over the force that the model needs for the answer that was seen: a steady
  sinking (damping), an angle at rest (righting moment) or commands that hold depth (thrust);
* dry mass: m (1 + a) over the identified apparent mass, in surge m - X_udot. The ratio a of added mass is
  an assumption: by default between Lamb's factor k times the water that the mass itself displaces and k times
  the water in the ellipsoid of the hull's measures, for water inside an open frame moves along or does not.

Source: Lamb, *Hydrodynamics* (1932), sections 114 and 121a: ``k = alpha_0/(2 - alpha_0)``, the integral
alpha_0 by Carlson's R_D (Carlson, *Numerical Algorithms* 10, 1995, 13).
Tests: ``tests/estimation/test_anchor.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.channels import AXES, VELOCITIES
from seatrial.base.errors import CampaignError, nearest
from seatrial.campaign.file import Anchor, Ballast, Bollard, DryMass
from seatrial.campaign.parameters import coefficient_names, parameters
from seatrial.estimation.joint import joint_stage
from seatrial.vehicle.actuators import NOMINAL_V, actuator_groups, bollard, pushes

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.campaign.campaign import Campaign

__all__ = [
    "MOTIONS",
    "Factor",
    "Held",
    "Homogeneity",
    "Implied",
    "ScaleReport",
    "added_mass_factor",
    "ballast_factor",
    "bollard_factor",
    "dry_mass_factor",
    "homogeneity",
    "homogeneous_direction",
    "implied",
    "judge_scale",
    "ratios",
    "scaled",
    "thrust_factors",
]

_CENTRES = frozenset(f"{axis}_{centre}" for axis in "xyz" for centre in "gb")

_CURVE = (
    *("p1_ahead", "p1_astern", "p2", "q1", "q2"),
    *(f"{name}_{side}" for name in ("a0", "a1", "a11") for side in ("ahead", "astern")),
)

_LEVER = 1e-9  # kg m, N m: a product smaller than this is zero

WRENCH, THRUST, MASS, NET = "wrench", "thrust", "mass and inertia", "net weight"

RIGHTING, FORCES, STATIC = "righting moment", "damping, lift and bias", "static moment"


@dataclass(frozen=True)
class Held:
    """What a campaign holds of the homogeneous direction: its kind and its members as people write them."""

    kind: str
    members: tuple[str, ...]


@dataclass(frozen=True)
class Homogeneity:
    """The homogeneous direction of a campaign: its members, which of them are free, what holds the scale.

    Attributes
    ----------
    members
        Coefficients that scaled together change no motion.
    free
        Those of them that the campaign frees.
    held
        What is held and acts in the free axes, the most telling first; empty: the scale is arbitrary.
    """

    members: tuple[str, ...]
    free: tuple[str, ...]
    held: tuple[Held, ...]

    def to_dict(self) -> dict[str, Any]:
        """The direction as plain data for JSON."""
        return asdict(self) | {"sentences": self.sentences()}

    def sentences(self) -> list[str]:
        """Name of the direction, and what the scale rests on."""
        said = [
            "Scaled together, mass and added mass, damping, lift, weight in water, bias and thrust change no"
            " motion: trials tell ratios, and the scale rests on what is held"
        ]
        found = {one.kind: ", ".join(one.members) for one in self.held}
        strong = [kind for kind in found if kind != STATIC]
        if not strong:
            weak = f" but {found[STATIC]}, which tell little" if found else ""
            return [
                *said,
                f"Nothing is held{weak}: the estimates may grow or shrink together until one meets a bound."
                " Hold a thrust gain, or mass and added mass of one axis",
            ]
        first = strong[0]
        words = f"the thrust of {found[first]} as in the vehicle file" if first == THRUST else found[first]
        said.append(f"The scale rests on {words}")
        if beside := [found[kind] for kind in strong[1:]]:
            said.append(
                f"Held at the vehicle file's values beside it: {'; '.join(beside)}. If the scale is wrong, so"
                " is their share: free them or scale them too"
            )
        return said


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
    for one, other in zip(pushes(vehicle), pushes(reference), strict=True):
        size = float(np.linalg.norm(other.wrench))
        if size > 0.0:
            factors.setdefault(one.actuator, []).append(float(np.linalg.norm(one.wrench)) / size)
    return {name: float(np.mean(found)) for name, found in factors.items()}


def ratios(vehicle: Vehicle, reference: Vehicle) -> dict[str, float]:
    """What trials tell of the hull whatever the scale: its sums and coefficients over the mean thrust factor.

    Apparent masses and inertias, damping, lift and bias, net weight and the moments of weight and buoyancy,
    in SI per unit of thrust; zeros are left out.

    Parameters
    ----------
    vehicle : Vehicle
        The identified one.
    reference : Vehicle
        That of the campaign, whose thrust is the unit.
    """
    thrust = float(np.mean(list(thrust_factors(vehicle, reference).values()) or [1.0]))
    values, mass = vehicle.coefficients(), np.asarray(vehicle.mass_matrix())
    weight, buoyancy = values["m"] * vehicle.environment()["g"], values.get("B", 0.0)
    found = {f"{_own(axis)} - {_added(axis)}": float(mass[axis, axis]) for axis in range(6)}
    found |= {name: values[name] for name in _coupling(vehicle)}
    found["m g - B"] = weight - buoyancy
    for axis in "xyz":
        moment = weight * values.get(f"{axis}_g", 0.0) - buoyancy * values.get(f"{axis}_b", 0.0)
        found[f"{axis}_g m g - {axis}_b B"] = moment
    return {name: value / thrust for name, value in found.items() if value}


def homogeneity(campaign: Campaign) -> Homogeneity:
    """Homogeneous direction of a campaign, all of its stages taken together.

    Raises
    ------
    CampaignError
        The joint estimate names what is not there.
    """
    vehicle, stage = campaign.vehicle, joint_stage(campaign)
    free = set(coefficient_names(parameters(stage, vehicle, f"{campaign.source}: polish")))
    rows = stage.axes.free
    logged = all(campaign.input_of(name) == "tau" for name in stage.trials)
    found = [
        Held(WRENCH, ("the logged wrench",)) if logged else Held(THRUST, tuple(_thrust(vehicle, free, rows))),
        Held(MASS, tuple(_masses(free, rows))),
        Held(NET, tuple(_net_weight(vehicle, free, rows))),
        Held(RIGHTING, tuple(_righting(vehicle, free, rows))),
        Held(FORCES, tuple(name for name in _coupling(vehicle) if name[0] in rows and name not in free)),
        Held(STATIC, tuple(_static(vehicle, free, rows))),
    ]
    members = homogeneous_direction(vehicle)
    gains = [f"{name}.{key}" for name in vehicle.actuators for key in _CURVE]
    return Homogeneity(
        members=members,
        free=tuple(name for name in (*members, *gains) if name in free),
        held=tuple(one for one in found if one.members),
    )


def _thrust(vehicle: Vehicle, free: set[str], rows: str) -> Iterator[str]:
    """Groups, or actuators of a group, whose thrust is held and acts in the free rows."""
    values, matrix = vehicle.coefficients(), np.asarray(vehicle.allocation_matrix())
    acting = [AXES.index(row) for row in rows]
    held = []
    for k, name in enumerate(vehicle.actuators):
        curve = {f"{name}.{key}" for key in _CURVE if values.get(f"{name}.{key}")}
        if f"{name}.gain" in free or (curve & free) or not np.any(np.abs(matrix[acting, k]) > _LEVER):
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
    if "Z" in rows and abs(net) > _LEVER and not {"m", "B"} & free:
        yield "m g - B"


def _righting(vehicle: Vehicle, free: set[str], rows: str) -> Iterator[str]:
    """Moments of weight and buoyancy about O: ``r_g W - r_b B`` by component."""
    values = vehicle.coefficients()
    weight, buoyancy = values["m"] * vehicle.environment()["g"], values.get("B", 0.0)
    for axis, turned in (("x", "MN"), ("y", "KN"), ("z", "KM")):
        centres = {f"{axis}_g", f"{axis}_b"}
        moment = weight * values.get(f"{axis}_g", 0.0) - buoyancy * values.get(f"{axis}_b", 0.0)
        if set(turned) & set(rows) and abs(moment) > _LEVER and not ({"m", "B"} | centres) & free:
            yield f"{axis}_g m g - {axis}_b B"


def _coupling(vehicle: Vehicle) -> list[str]:
    """Names of damping, lift, bias and off-diagonal added mass: ``X_u``, ``Y_ur``, ``N_0``, ``Y_rdot``."""
    diagonal = {_added(axis) for axis in range(6)}
    forces = tuple(f"{row}_" for row in AXES)
    return [
        name
        for name, value in vehicle.coefficients().items()
        if "." not in name and name.startswith(forces) and value and name not in diagonal
    ]


def _own(axis: int) -> str:
    return "m" if axis < 3 else f"I_{'xyz'[axis - 3]}"


def _added(axis: int) -> str:
    return f"{AXES[axis]}_{VELOCITIES[axis]}dot"


def _static(vehicle: Vehicle, free: set[str], rows: str) -> Iterator[str]:
    """Products of mass and centre of gravity, which couple translation and rotation."""
    values = vehicle.coefficients()
    for axis in "xyz":
        if abs(values.get(f"{axis}_g", 0.0)) > _LEVER and not {"m", f"{axis}_g"} & free and rows:
            yield f"m {axis}_g"


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

    Raises
    ------
    CampaignError
        An unknown actuator, or commands that give no force along the axis.
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

    Raises
    ------
    CampaignError
        An unknown actuator.
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

    Raises
    ------
    CampaignError
        The hull's measures are missing, and the ratio of added mass is not given.
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


_GAINS = (0.2, 1.5)
"""Plausible thrust over a bollard table: mounting, wake and voltage drop cost much, nothing adds half."""

_NET_SHARE = 0.05
"""Of the weight: a submerged vehicle is trimmed to a few tenths of a per cent."""

_UNSTATED = 0.1
"""An anchor without standard deviation is taken to be good to ten per cent when anchors are compared."""


@dataclass(frozen=True)
class Implied:
    """What an anchor implies for an identified vehicle.

    Attributes
    ----------
    factor
        True over identified forces.
    mass_kg
        Mass beside which added mass is told, and by which the centre of gravity is placed: dry mass and water
        where they are given, else the vehicle's m.
    apparent_kg
        True mass plus added mass in surge, sway and heave.
    gains
        True thrust over that of the campaign's vehicle, per group, or per actuator where they differ.
    net_weight_n
        True ``W - B``.
    centre_height_m, file_height_m
        Centre of gravity below the centre of buoyancy, as implied and in the campaign's vehicle.
    """

    factor: Factor
    mass_kg: float
    apparent_kg: dict[str, float]
    gains: dict[str, float]
    net_weight_n: float
    centre_height_m: float
    file_height_m: float
    g: float

    @property
    def added_kg(self) -> dict[str, float]:
        """True added mass in surge, sway and heave."""
        return {motion: mass - self.mass_kg for motion, mass in self.apparent_kg.items()}

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences about what cannot be."""
        if not math.isfinite(self.factor.value):
            return ("the anchor contradicts the vehicle: its answer has the other sign; check its signs",)
        found = [
            f"added mass in {motion} would be {mass:.3g} kg, negative: anchor or apparent mass is wrong"
            for motion, mass in self.added_kg.items()
            if mass < 0.0
        ]
        found += self.thrust_warnings
        if self.centre_height_m <= 0.0:
            found.append("the centre of gravity would lie above the centre of buoyancy: check z_g, z_b, B")
        if abs(self.net_weight_n) > _NET_SHARE * self.mass_kg * self.g:
            share = 100.0 * self.net_weight_n / (self.mass_kg * self.g)
            found.append(f"net weight would be {share:+.2g} % of the weight: check B and m")
        return tuple(found)

    @property
    def thrust_warnings(self) -> list[str]:
        """The sentence about gains that no bollard table is wrong by."""
        least, most = _GAINS
        odd = [f"{name} {gain:.2g}" for name, gain in self.gains.items() if not least <= gain <= most]
        if not odd:
            return []
        return [
            f"thrust gains outside {least:g} to {most:g}: {', '.join(odd)}; check characteristic, supply"
            " voltage and anchor"
        ]

    def to_dict(self) -> dict[str, Any]:
        """The consequences as plain data for JSON."""
        return asdict(self) | {"added_kg": self.added_kg, "warnings": list(self.warnings)}

    def sentences(self, *, identified: bool = True) -> list[str]:
        """The factor, what follows from it, what cannot be; before an identification of the thrust alone."""
        said = [f"{self.factor.anchor} ({self.factor.assumption}): {_factor_words(self.factor, identified)}"]
        if not identified:
            return said + [f"WARNING {text}" for text in self.thrust_warnings]
        if math.isfinite(self.factor.value):
            gains = ", ".join(f"{name} {gain:.2g}" for name, gain in self.gains.items())
            added = ", ".join(f"{motion} {mass:.3g}" for motion, mass in self.added_kg.items())
            side = "below" if self.centre_height_m > 0.0 else "above"
            said.append(
                f"It implies thrust gains {gains or '(no thruster)'}; added mass {added} kg beside"
                f" {self.mass_kg:.4g} kg; net weight {self.net_weight_n:+.2g} N; centre of gravity"
                f" {1e3 * abs(self.centre_height_m):.3g} mm {side} that of buoyancy"
                f" (vehicle file: {1e3 * self.file_height_m:.3g} mm)"
            )
        return said + [f"WARNING {text}" for text in self.warnings]


@dataclass(frozen=True)
class ScaleReport:
    """The scale of all forces: what it rests on, what the anchors imply, coefficients free of it.

    Attributes
    ----------
    homogeneity
        The homogeneous direction of the campaign.
    implied
        One per anchor: of an identified vehicle all, before that bollard pulls only.
    waiting
        Anchors that are judged once the vehicle is identified.
    ratios
        What trials tell whatever the scale, over the mean thrust factor; empty before the identification.
    identified
        Whether it is an identified vehicle that was judged.
    tested
        Groups or actuators whose thrust the campaign's bench test measured.
    """

    homogeneity: Homogeneity
    implied: tuple[Implied, ...]
    waiting: tuple[str, ...]
    ratios: dict[str, float]
    identified: bool
    tested: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """The report as plain data for JSON."""
        return {
            "homogeneity": self.homogeneity.to_dict(),
            "implied": [one.to_dict() for one in self.implied],
            "waiting": list(self.waiting),
            "ratios": self.ratios,
            "tested": list(self.tested),
            "sentences": self.sentences(),
        }

    def sentences(self) -> list[str]:
        """What the scale rests on, what the anchors imply; where there is none, a request for one."""
        said = self.homogeneity.sentences()
        for one in self.implied:
            said += one.sentences(identified=self.identified)
        said += self._disagreement()
        if self.waiting:
            said.append(f"Judged after the identification: {', '.join(self.waiting)}")
        if self.tested:
            said.append(
                f"The bench test measured the thrust of {', '.join(self.tested)} on a load cell: an absolute"
                " anchor, as good as that cell"
            )
        elif not self.implied and not self.waiting:
            said.append(
                "No absolute anchor is given; one is needed for true values. Give it under [anchor]: bollard"
                " (a pull at rest under known commands), ballast (a known weight, and the sinking, the angle"
                " or the commands that answer it) or dry_mass (beside an assumed added mass)"
            )
        if self.ratios:
            told = ", ".join(f"{name} {value:.4g}" for name, value in self.ratios.items())
            said.append(f"Over the thrust gain, whatever the scale: {told}")
        return said

    def _disagreement(self) -> list[str]:
        known = [one.factor for one in self.implied if math.isfinite(one.factor.value)]
        if len(known) < 2:
            return []
        lower = max(min(one.lower, one.value * (1.0 - _UNSTATED)) for one in known)
        upper = min(max(one.upper, one.value * (1.0 + _UNSTATED)) for one in known)
        values = " and ".join(f"{one.anchor.lower()} {one.value:.2g}" for one in known)
        if lower <= upper:
            return [f"The anchors agree: {values}"]
        return [f"WARNING the anchors disagree: {values}; one of them, or what it assumes, is wrong"]


def judge_scale(campaign: Campaign, vehicle: Vehicle | None = None) -> ScaleReport:
    """Judgement of a campaign's scale.

    Parameters
    ----------
    campaign : Campaign
    vehicle : Vehicle, optional
        The identified one; without it only bollard pulls are judged, on the thrust of the vehicle file.

    Raises
    ------
    CampaignError
        An anchor names an unknown actuator, commands without force or a hull without measures.
    """
    direction, anchor = homogeneity(campaign), campaign.file.anchor
    tested = () if campaign.bench is None else tuple(campaign.bench.pulls)
    if vehicle is None:
        try:
            every = implied(campaign.vehicle, anchor)  # refuses here what could not be judged later
        except CampaignError as error:
            raise CampaignError(f"{campaign.source}: {error}") from None
        waiting = [one.factor.anchor for one in every[len(anchor.bollard) :]]
        return ScaleReport(direction, every[: len(anchor.bollard)], tuple(waiting), {}, False, tested)
    known = implied(vehicle, anchor, reference=campaign.vehicle)
    return ScaleReport(direction, known, (), ratios(vehicle, campaign.vehicle), True, tested)


def implied(vehicle: Vehicle, anchor: Anchor, *, reference: Vehicle | None = None) -> tuple[Implied, ...]:
    """What every anchor implies for a vehicle: bollard pulls first, ballasts, then the dry mass.

    Parameters
    ----------
    vehicle : Vehicle
        The identified one.
    anchor : Anchor
        The ``[anchor]`` section of a campaign.
    reference : Vehicle, optional
        Thrust gains are relative to its thrust; to the vehicle's own without its gains when omitted.

    Raises
    ------
    CampaignError
        An anchor names an unknown actuator, commands without force or a hull without measures.

    Examples
    --------
    >>> import seatrial as st
    >>> from seatrial.campaign.file import Anchor
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


def _factor_words(factor: Factor, identified: bool) -> str:
    if not math.isfinite(factor.value):
        return "no factor"
    size = f"{factor.value:.2g}"
    if factor.upper > factor.lower:
        size += f" ({factor.lower:.2g} to {factor.upper:.2g})"
    return (
        f"true forces are {size} of the identified" if identified else f"true thrust is {size} of the file's"
    )
