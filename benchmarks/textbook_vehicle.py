"""From flat coefficients (Fossen's names and signs, SI) or a vehicle file to the textbook model's matrices.

Source: T. I. Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, chapters 3, 6 and 7;
(8), (14), (23).
Held by tests/core/test_textbook.py and tests/core/test_scalar_textbook.py.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from benchmarks.textbook import FORCES, NO_STRIPS, Model, Strips, rigid_body_mass
from benchmarks.textbook_fins import Fin
from benchmarks.textbook_thrusters import (
    Characteristic,
    Newton,
    Polynomial,
    Quadratic,
    Table,
    Thruster,
    wrench_per_newton,
)

VELOCITIES = "uvwpqr"
LIFT_TERMS = ("Y_uv", "Y_ur", "Z_uw", "Z_uq", "M_uw", "M_uq", "N_uv", "N_ur")


@dataclass(frozen=True)
class Parameters:
    """A vehicle: flat coefficients in SI, actuators, density (kg/m3) and gravity (m/s2) they hold for, and
    the hull's strips: places (m), areas seen from the side and from above (m2), as rows."""

    coefficients: Mapping[str, float]
    thrusters: Sequence[Thruster] = ()
    fins: Sequence[Fin] = ()
    rho: float = 1025.0
    g: float = 9.81
    strips: Strips = field(default_factory=lambda: NO_STRIPS)


def build(parameters: Parameters, *, rho: float | None = None, g: float | None = None) -> Model:
    """Return the constant matrices in water of density ``rho`` (kg/m3) under gravity ``g`` (m/s2).

    The hydrodynamic coefficients and B scale with rho, B also with g, W = m g; the bias wrench with nothing.

    Raises
    ------
    ValueError
        Both names of a symmetric pair of added masses are given and differ.
    """
    c = parameters.coefficients
    rho = parameters.rho if rho is None else rho
    g = parameters.g if g is None else g
    density_ratio = rho / parameters.rho
    m = c["m"]
    r_g = np.array([c.get(k, 0.0) for k in ("x_g", "y_g", "z_g")])
    r_b = np.array([c.get(k, 0.0) for k in ("x_b", "y_b", "z_b")])
    I_xy, I_xz, I_yz = (c.get(k, 0.0) for k in ("I_xy", "I_xz", "I_yz"))
    I_O = np.array([[c["I_x"], -I_xy, -I_xz], [-I_xy, c["I_y"], -I_yz], [-I_xz, -I_yz, c["I_z"]]])
    M_A, D_l, D_q, L = np.zeros((4, 6, 6))
    for i, force in enumerate(FORCES):
        for j, velocity in enumerate(VELOCITIES):
            M_A[i, j] = -added_mass_derivative(c, i, j)
            D_l[i, j] = -c.get(f"{force}_{velocity}", 0.0)
            D_q[i, j] = -c.get(f"{force}_{velocity}{velocity}", 0.0)
            if f"{force}_u{velocity}" in LIFT_TERMS:
                L[i, j] = c.get(f"{force}_u{velocity}", 0.0)
    return Model(
        m=m,
        r_g=r_g,
        r_b=r_b,
        I_O=I_O,
        M_RB=rigid_body_mass(m, r_g, I_O),
        M_A=density_ratio * M_A,
        D_l=density_ratio * D_l,
        D_q=density_ratio * D_q,
        L=density_ratio * L,
        W=m * g,
        B=c.get("B", 0.0) * density_ratio * g / parameters.g,
        bias=np.array([c.get(f"{force}_0", 0.0) for force in FORCES]),
        thrusters=tuple(parameters.thrusters),
        density_ratio=density_ratio,
        rho=rho,
        fins=tuple(parameters.fins),
        strips=parameters.strips,
        cross_flow=(0.5 * rho * c.get("C_Dy", 0.0), 0.5 * rho * c.get("C_Dz", 0.0)),
    )


def added_mass_derivative(c: Mapping[str, float], i: int, j: int) -> float:
    """Return dF_i/dnu'_j (SI); M_A is symmetric, so that either name of a pair gives both.

    Raises
    ------
    ValueError
        Both names are given and differ.
    """
    one, other = f"{FORCES[i]}_{VELOCITIES[j]}dot", f"{FORCES[j]}_{VELOCITIES[i]}dot"
    values = {c[name] for name in (one, other) if c.get(name, 0.0) != 0.0}
    if len(values) > 1:
        found = f"{one} = {c[one]} and {other} = {c[other]}"
        raise ValueError(f"{found}: expected equal values, M_A is symmetric")
    return values.pop() if values else 0.0


class FilledVehicle(Protocol):
    """What the adapter reads of a vehicle: flat coefficients and the filled file."""

    def coefficients(self) -> dict[str, float]: ...

    def to_toml(self) -> str: ...


def from_vehicle(vehicle: FilledVehicle) -> Parameters:
    """Return a vehicle's parameters: coefficients as it lists them, thrusters' shapes from its file."""
    return from_file(tomllib.loads(vehicle.to_toml()), vehicle.coefficients())


def from_file(file: Mapping[str, Any], coefficients: Mapping[str, float]) -> Parameters:
    """Return the parameters of a parsed vehicle file with the flat ``coefficients`` that hold for it (SI)."""
    environment = file.get("environment", {})
    return Parameters(
        coefficients={name: value for name, value in coefficients.items() if "." not in name},
        thrusters=[thruster(file, entry, coefficients) for entry in file.get("thrusters", [])],
        fins=[fin(file, entry, coefficients) for entry in file.get("fins", [])],
        rho=environment.get("rho_kg_m3", 1025.0),
        g=environment.get("g_m_s2", 9.81),
        strips=hull_strips(file),
    )


def hull_strips(file: Mapping[str, Any]) -> Strips:
    """Return the strips of a parsed vehicle file: Gauss and Legendre's sixteen between tail and nose."""
    table: Mapping[str, Any]
    if "cross_flow" in file:
        table = file["cross_flow"]
    elif "geometry" in file:
        geometry = file["geometry"]
        half, width = 0.5 * geometry["length_m"], geometry["diameter_m"]
        table = {
            "x_m": [-half, half],
            "diameter_m": [width, width],
            "height_m": [geometry.get("height_m", width)] * 2,
        }
    else:
        return NO_STRIPS
    node, weight = np.polynomial.legendre.leggauss(16)
    tail, nose = table["x_m"][0], table["x_m"][-1]
    x = 0.5 * (tail + nose) + 0.5 * (nose - tail) * node
    length = 0.5 * (nose - tail) * weight
    measures = table.get("height_m") or table["diameter_m"], table["diameter_m"]
    return np.stack([x, *(length * np.interp(x, table["x_m"], one) for one in measures)])


def thruster(
    file: Mapping[str, Any], entry: Mapping[str, Any], coefficients: Mapping[str, float]
) -> Thruster:
    """Return one thruster of a parsed vehicle file."""
    own = own_coefficients(entry["name"], coefficients)
    if "wrench_per_newton" in entry:
        wrench = np.array(entry["wrench_per_newton"], dtype=float)
    else:
        direction = np.array(entry["direction"], dtype=float)
        wrench = wrench_per_newton(entry["position_m"], direction / np.linalg.norm(direction))
    wrench[3:] = [own.get(f"lever_{axis}", 0.0) for axis in "KMN"]
    return Thruster(
        wrench=wrench,
        characteristic=characteristic(file["characteristics"][entry["characteristic"]], own),
        unit=entry["command"],
        **drive(file, entry, own),
        gain=own.get("gain", 0.0),
        wake=own.get("w", 0.0),
        thrust_deduction=own.get("t", 0.0),
        astern_ratio=own.get("astern_ratio", 1.0),
        loss=own.get("loss", 0.0),
        group=entry.get("group", entry["name"]),
    )


def own_coefficients(name: str, coefficients: Mapping[str, float]) -> dict[str, float]:
    """Return the coefficients of one actuator by their short names."""
    prefix = f"{name}."
    return {k.removeprefix(prefix): v for k, v in coefficients.items() if k.startswith(prefix)}


def drive(file: Mapping[str, Any], entry: Mapping[str, Any], own: Mapping[str, float]) -> dict[str, Any]:
    """Return name, neutral, limits and dynamics of an actuator's motor or servo."""
    motor = file.get("motors", {}).get(entry.get("motor"), {})
    ahead = {
        side: motor.get(f"{side}_ahead", limit) for side, limit in (("maximum", np.inf), ("minimum", 0.0))
    }
    return {
        "name": entry["name"],
        "neutral": entry.get("neutral", 0.0),
        "reversed": entry.get("reversed", False),
        "maximum_ahead": ahead["maximum"],
        "maximum_astern": motor.get("maximum_astern", ahead["maximum"]),
        "minimum_ahead": ahead["minimum"],
        "minimum_astern": motor.get("minimum_astern", ahead["minimum"]),
        "below_minimum": motor.get("below_minimum", "lift"),
        "n_acc": own.get("n_acc", np.inf),
        "n_dec": own.get("n_dec", np.inf),
        "K_V": own.get("K_V", 0.0),
        "T_1": own.get("T_1", 0.0),
        "T_t": own.get("T_t", 0.0),
    }


def fin(file: Mapping[str, Any], entry: Mapping[str, Any], coefficients: Mapping[str, float]) -> Fin:
    """Return one fin of a parsed vehicle file."""
    own = own_coefficients(entry["name"], coefficients)
    chord, normal = (np.array(entry[key], dtype=float) for key in ("chord", "normal"))
    servo = Thruster(wrench=np.zeros(6), characteristic=Newton(), unit="rad", **drive(file, entry, own))
    return Fin(
        servo=servo,
        place=np.array(entry["position_m"], dtype=float),
        chord=chord / np.linalg.norm(chord),
        normal=normal / np.linalg.norm(normal),
        area=entry["area_m2"],
        gain=own.get("gain", 0.0),
        **{name: own.get(name, 0.0) for name in ("C_La", "C_Lmax", "C_D0", "C_D90", "k_i", "offset")},
    )


def characteristic(shape: Mapping[str, Any], own: Mapping[str, float]) -> Characteristic:
    """Return a characteristic of the file's ``shape`` with the thruster's ``own`` coefficients.

    Raises
    ------
    ValueError
        The file names a kind that this model does not have.
    """

    def side(name: str) -> tuple[float, float, float]:
        return (own.get(f"a0_{name}", 0.0), own.get(f"a1_{name}", 0.0), own.get(f"a11_{name}", 0.0))

    match shape["kind"]:
        case "quadratic":
            names = ("p1_ahead", "p1_astern", "p2", "q1", "q2")
            return Quadratic(**{name: own.get(name, 0.0) for name in names})
        case "polynomial":
            flow = {name: own.get(name, 0.0) for name in ("p2", "q1", "q2")}
            return Polynomial(ahead=side("ahead"), astern=side("astern"), **flow)
        case "table":
            axes = {
                name: np.array(shape.get(name, []), dtype=float)
                for name in ("signal", "voltage_v", "force_n")
            }
            return Table(signal=axes["signal"], voltage=axes["voltage_v"], force=axes["force_n"])
        case "direct":
            return Newton()
    raise ValueError(f"kind: expected quadratic, polynomial, table or direct, found {shape['kind']}")
