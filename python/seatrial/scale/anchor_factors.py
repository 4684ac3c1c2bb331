"""Scale by an absolute anchor: one known force or mass over the same one in an identified vehicle.

* bollard: force measured at rest over that of the model's thrusters under the same commands;
* ballast: its weight in water over the force that the model needs for the answer that was seen: a steady
  sinking (damping), an angle at rest (righting moment) or commands that hold depth (thrust);
* dry mass: m (1 + a) over the identified apparent mass, in surge m - X_udot. The ratio a of added mass is
  an assumption: by default between Lamb's factor k times the water that the mass itself displaces and k times
  the water in the ellipsoid of the hull's measures, for water inside an open frame moves along or does not.

Source: Lamb, *Hydrodynamics* (1932), sections 114 and 121a: ``k = alpha_0/(2 - alpha_0)``, the integral
alpha_0 by Carlson's R_D (Carlson, *Numerical Algorithms* 10, 1995, 13).
Tests: ``tests/test_anchor.py``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.campaign_file import Ballast, Bollard, DryMass
from seatrial.check.actuators import NOMINAL_V, bollard
from seatrial.errors import CampaignError, nearest
from seatrial.parameters import actuator_groups

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["MOTIONS", "Factor", "added_mass_factor", "ballast_factor", "bollard_factor", "dry_mass_factor"]

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
    force = _thrust(vehicle, pull)["XYZ".index(pull.axis)]
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
            needed -= float(_thrust(vehicle, ballast)[2])
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


def _thrust(vehicle: Vehicle, test: Bollard | Ballast) -> list[float]:
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
