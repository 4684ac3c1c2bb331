"""What gz-sim knows of a vehicle: mass, buoyancy, added mass and damping, in the body frame of vehicle files.

Everything is about O in forward-right-down. A matrix in gz-sim's forward-left-up becomes ``T A T`` with
T = diag(1, -1, -1, 1, -1, -1); inertia about the centre of gravity becomes that about O by
``I_O = I_C + m (c'c E - c c')`` (Fossen 2011, equation 3.36). Damping keeps Fossen's signs here: derivatives
of the force on the vehicle. Held by ``tests/simulators/test_convert.py``.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import tomlkit

from seatrial._core import Vehicle
from seatrial.base.arrays import Array
from seatrial.base.channels import MOTIONS
from seatrial.base.errors import VehicleError

FLIP = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
"""Signs between forward-left-up and forward-right-down."""

_FORCES, _VELOCITIES = "XYZKMN", "uvwpqr"

_MOTIONS = tuple(MOTIONS.values())


@dataclass(frozen=True)
class BodySettings:
    """What of a model is rounding, and what is a mistake."""

    #: Difference of mirrored entries, as a share of the larger: files hold some seven digits.
    symmetry_share: float = 1e-6
    #: Difference of buoyancy and weight, as a share of the weight: vehicles are trimmed more closely, so more
    #: is a mistake in the file.
    buoyancy_share: float = 0.05
    zero_share: float = 1e-12  #: Entry that turning the axes leaves of a zero.


SETTINGS = BodySettings()


def _zeros() -> Array:
    return np.zeros((6, 6))


@dataclass(frozen=True, eq=False)
class Body:
    """A body in water, forward-right-down about O, SI."""

    name: str
    #: `mass`, `gravity_centre`, `inertia`: kg; (3,), m; (3, 3) about O, kg m2.
    mass: float
    gravity_centre: Array = field(default_factory=lambda: np.zeros(3))
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))
    #: `buoyancy`, `buoyancy_centre`: N, None where the file does not tell it; (3,), m.
    buoyancy: float | None = None
    buoyancy_centre: Array = field(default_factory=lambda: np.zeros(3))
    #: (6, 6), the matrix itself: positive definite where it is right.
    added_mass: Array = field(default_factory=_zeros)
    #: `linear`, `quadratic`: (6, 6), derivatives of the force: entry i, j by nu_j and by ``|nu_j| nu_j``.
    linear: Array = field(default_factory=_zeros)
    quadratic: Array = field(default_factory=_zeros)
    #: `rho`, `g`: kg/m3, m/s2.
    rho: float = 1025.0
    g: float = 9.81
    size: tuple[float, float, float] | None = None  #: Length, width and height, m, where the file tells them.
    round: bool = False  #: Whether the hull is round about its long axis.

    def coefficients(self) -> dict[str, float]:
        """Coefficients of the vehicle file; zeros left out but for those that the file must have."""
        values: dict[str, float] = {"m": self.mass}
        for name, value in zip(("x_g", "y_g", "z_g"), self.gravity_centre, strict=True):
            values[name] = float(value)
        for name, value in zip(("x_b", "y_b", "z_b"), self.buoyancy_centre, strict=True):
            values[name] = float(value)
        values["B"] = self.mass * self.g if self.buoyancy is None else self.buoyancy
        for k, axis in enumerate("xyz"):
            values[f"I_{axis}"] = float(self.inertia[k, k])
        for i, j, name in ((0, 1, "I_xy"), (0, 2, "I_xz"), (1, 2, "I_yz")):
            values[name] = -float(self.inertia[i, j])
        known = _names()
        for i, force in enumerate(_FORCES):
            for j, velocity in enumerate(_VELOCITIES):
                values[f"{force}_{velocity}"] = float(self.linear[i, j])
                values[f"{force}_{velocity * 2}"] = float(self.quadratic[i, j])
                if j >= i:
                    name = f"{force}_{velocity}dot"
                    if name not in known:
                        name = f"{_FORCES[j]}_{_VELOCITIES[i]}dot"
                    values[name] = -float(self.added_mass[i, j])
        needed = {"m", "B", "I_x", "I_y", "I_z", "z_b"}
        # A geometry would fill what is left out.
        for force, velocity in zip(_FORCES, _VELOCITIES, strict=True):
            needed |= {f"{force}_{velocity}{end}" for end in ("", velocity, "dot")}
        return {
            name: value
            for name, value in values.items()
            if name in needed or abs(value) > SETTINGS.zero_share
        }

    def toml(self, comments: tuple[str, ...] = ()) -> str:
        """Vehicle file without actuators.

        Raises `VehicleError`: the numbers are no vehicle.
        """
        document = tomlkit.document()
        for line in comments:
            document.add(tomlkit.comment(" ".join(line.split())))
        data: dict[str, Any] = {"format": 1, "name": self.name, "controllable": []}
        data["environment"] = {"rho_kg_m3": self.rho, "g_m_s2": self.g}
        if self.size is not None:
            length, width, height = self.size
            shape = "spheroid" if self.round else "box"
            data["geometry"] = {"shape": shape, "length_m": length, "diameter_m": width, "height_m": height}
        data["coefficients"] = self.coefficients()
        for key, value in data.items():
            document.add(key, value)
        text = tomlkit.dumps(document)
        Vehicle.from_toml(text, self.name)
        return text


def _names() -> set[str]:
    """Names of the added masses that vehicle files have."""
    every = Vehicle.load("bluerov2-heavy").coefficient_info()
    return {name for name in every if name.endswith("dot")}


def body_of(vehicle: Vehicle) -> Body:
    """What gz-sim takes of a vehicle: mass, buoyancy, added mass, damping.

    Raises `VehicleError`: it has no mass.
    """
    given = vehicle.coefficients()
    if not given.get("m", 0.0) > 0.0:
        raise VehicleError(f"{vehicle.name}: expected a mass m, found none")

    def of(*names: str) -> Array:
        return np.array([given.get(name, 0.0) for name in names])

    inertia = np.diag(of("I_x", "I_y", "I_z"))
    for i, j, name in ((0, 1, "I_xy"), (0, 2, "I_xz"), (1, 2, "I_yz")):
        inertia[i, j] = inertia[j, i] = -given.get(name, 0.0)
    # Vehicle files name an added mass off the diagonal once, by either of its two names.
    added, linear, quadratic = _zeros(), _zeros(), _zeros()
    for i, force in enumerate(_FORCES):
        for j, velocity in enumerate(_VELOCITIES):
            linear[i, j] = given.get(f"{force}_{velocity}", 0.0)
            quadratic[i, j] = given.get(f"{force}_{velocity * 2}", 0.0)
            other = f"{_FORCES[j]}_{_VELOCITIES[i]}dot"
            added[i, j] = -given.get(f"{force}_{velocity}dot", given.get(other, 0.0))
    geometry = vehicle.geometry()
    size = None
    if geometry:
        size = (geometry["length"], geometry["diameter"], geometry.get("height", geometry["diameter"]))
    environment = vehicle.environment()
    return Body(
        name=vehicle.name,
        mass=given["m"],
        gravity_centre=of("x_g", "y_g", "z_g"),
        inertia=inertia,
        buoyancy=given.get("B"),
        buoyancy_centre=of("x_b", "y_b", "z_b"),
        added_mass=added,
        linear=linear,
        quadratic=quadratic,
        rho=environment["rho"],
        g=environment["g"],
        size=size,
        round=vehicle.hull_shape == "spheroid",
    )


def contradictions(body: Body) -> tuple[Body, list[str]]:
    """The body as physics allows it, and what contradicted that: signs, symmetry, buoyancy, stability.

    A damping or an added mass on the diagonal with the sign that feeds energy is turned, an added mass that
    is not symmetric is replaced by its symmetric part; the rest is only told.
    """
    sentences: list[str] = []
    linear = _dissipating(body.linear, "linear damping", "", sentences)
    quadratic = _dissipating(body.quadratic, "quadratic damping", "|nu|", sentences)
    added = body.added_mass.copy()
    negative = [k for k in range(6) if added[k, k] < 0.0]
    if negative:
        for k in negative:
            sentences.append(
                f"added mass in {_MOTIONS[k]} is {added[k, k]:.4g}: an added mass is positive; its sign was"
                " turned."
            )
        if all(added[k, k] <= 0.0 for k in range(6)):
            added = -added  # the whole matrix in the other convention
        else:
            for k in negative:
                added[k, k] = -added[k, k]
    unequal = np.abs(added - added.T)
    larger = np.maximum(np.abs(added), np.abs(added.T))
    if (unequal > SETTINGS.symmetry_share * larger).any():
        i, j = np.unravel_index(int(unequal.argmax()), (6, 6))
        sentences.append(
            f"added mass is not symmetric: entry {i + 1},{j + 1} is {added[i, j]:.6g}, entry {j + 1},{i + 1}"
            f" {added[j, i]:.6g}; the mean was taken."
        )
        added = (added + added.T) / 2.0
    smallest = float(np.linalg.eigvalsh(added)[0])
    if smallest < -1e-9 * max(1.0, float(np.abs(added).max())):
        sentences.append(
            f"added mass is not positive: its smallest eigenvalue is {smallest:.4g}; off-diagonal terms"
            " are too large for the diagonal. Taken as it is."
        )
    body = replace(body, linear=linear, quadratic=quadratic, added_mass=added)
    sentences += _rigid_sentences(body)
    return body, sentences


def _dissipating(matrix: Array, what: str, power: str, sentences: list[str]) -> Array:
    matrix = matrix.copy()
    for k, axis in enumerate(_MOTIONS):
        if matrix[k, k] > 0.0:
            sentences.append(
                f"{what} in {axis} is {matrix[k, k]:+.4g}: a force of that sign drives the vehicle on; its"
                " sign was turned."
            )
            matrix[k, k] = -matrix[k, k]
    return matrix


def _rigid_sentences(body: Body) -> list[str]:
    sentences = []
    weight = body.mass * body.g
    if body.buoyancy is None:
        sentences.append("the file tells no buoyancy: neutral was taken, B = W.")
    elif abs(body.buoyancy - weight) > SETTINGS.buoyancy_share * weight:
        volume = body.buoyancy / (body.rho * body.g)
        word = "rises" if body.buoyancy > weight else "sinks"
        sentences.append(
            f"buoyancy {body.buoyancy:.4g} N ({volume:.4g} m3 of water) and weight {weight:.4g} N differ by"
            f" {100 * abs(body.buoyancy - weight) / weight:.0f} %: the vehicle {word}."
        )
    if body.buoyancy_centre[2] > body.gravity_centre[2] + 1e-9:
        low = body.buoyancy_centre[2] - body.gravity_centre[2]
        sentences.append(
            f"the centre of buoyancy is {low:.3g} m below that of gravity: the vehicle turns over."
        )
    if body.mass > 0.0:
        c = body.gravity_centre
        centred = body.inertia - body.mass * (c @ c * np.eye(3) - np.outer(c, c))
        principal = np.sort(np.linalg.eigvalsh((centred + centred.T) / 2.0))
        if principal[0] <= 0.0 or principal[0] + principal[1] < principal[2] * (1.0 - 1e-9):
            sentences.append(
                f"principal moments of inertia {', '.join(f'{value:.4g}' for value in principal)} kg m2 are"
                " those of no body: each must be positive and at most the sum of the others."
            )
    still = [axis for k, axis in enumerate(_MOTIONS) if not (body.linear[k, k] or body.quadratic[k, k])]
    if still:
        sentences.append(f"there is no damping in {', '.join(still)}.")
    return sentences
