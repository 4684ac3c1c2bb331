"""What may have changed on a vehicle since its model was identified: single coefficients and linked groups.

A change at sea rarely moves one coefficient. A payload of wet mass m_w at r_p and of density rho_p has the
dry mass ``m_d = m_w / (1 - rho/rho_p)`` and moves mass, buoyancy, both centres and the inertias about O
(Fossen 2021, section 3.2; parallel axes):

    m' = m + m_d,  B' = B + g (m_d - m_w),  m' r_G' = m r_G + m_d r_p,  B' r_B' = B r_B + g (m_d - m_w) r_p,
    I_y' = I_y + m_d x_p^2,  I_z' = I_z + m_d x_p^2  (r_p on the x axis).

Its unknowns are m_w and ``m_w x_p``, in which it is linear but for the inertias.

Tests: ``tests/test_recorded_suspects.py``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.parameters import actuator_groups

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["PAYLOAD_DENSITY", "Candidate", "candidates", "payload"]

Array = NDArray[np.float64]

PAYLOAD_DENSITY = 2700.0
"""Density of a payload, kg/m3, where nothing else is known: aluminium, and housings with what they hold."""

_MASS = ("m", "B", "x_g", "y_g", "z_g", "I_x", "I_y", "I_z")
_HYDRO = re.compile(r"[XYZKMN]_([uvwpqr]{1,2}|[uvwpqr]dot|0)")
_DRAG = re.compile(r"[XYZKMN]_([uvwpqr])\1?")
_LIFT = re.compile(r"[YZMN]_u[vwqr]")
_STEP = 1e-4


@dataclass(frozen=True, eq=False)
class Candidate:
    """Something that may have changed.

    Attributes
    ----------
    name
        A coefficient, or what the group stands for.
    kind
        "coefficient", "group" or "surroundings".
    units
        Unit of every unknown.
    scale
        A natural size of every unknown, (d,).
    changes
        Coefficients {name: value} of the vehicle for values (d,) of the unknowns; the present ones for zero.
    words
        The change in words, for values (d,) of the unknowns.
    coefficients
        Names of the coefficients that it moves.
    """

    name: str
    kind: str
    units: tuple[str, ...]
    scale: Array
    changes: Callable[[Array], dict[str, float]]
    words: Callable[[Array], str]
    coefficients: tuple[str, ...]

    def directions(self) -> list[dict[str, float]]:
        """Changes of the coefficients with one unit of each unknown, to first order."""
        found = []
        zero = np.zeros(len(self.scale))
        for k, size in enumerate(_STEP * self.scale):
            step = np.zeros(len(self.scale))
            step[k] = size
            ahead, astern = self.changes(zero + step), self.changes(zero - step)
            found.append({name: (ahead[name] - astern[name]) / (2.0 * size) for name in ahead})
        return found


def candidates(
    vehicle: Vehicle, *, identified: Sequence[str] = (), payload_density: float = PAYLOAD_DENSITY
) -> list[Candidate]:
    """Candidates of a vehicle: its coefficients and the identified ones, then groups that change together.

    Parameters
    ----------
    vehicle : Vehicle
    identified : sequence of str, optional
        Coefficients that are tried even where they are zero.
    payload_density : float, optional
        Of a payload, kg/m3.
    """
    values = vehicle.coefficients()
    info = vehicle.coefficient_info()
    known = set(identified)
    singles = [
        name
        for name in info
        if name in _MASS
        or name in known
        or (values.get(name) and _HYDRO.fullmatch(name))
        or (name.endswith(".gain") and name in values)
    ]
    found = [_single(name, values.get(name, 0.0), str(info[name]["unit"]), values) for name in singles]
    drag = [name for name in values if _DRAG.fullmatch(name) and values[name]]
    axial = [name for name in drag if name in ("X_u", "X_uu")]
    lift = [name for name in values if _LIFT.fullmatch(name) and values[name]]
    found += [
        one
        for one in (
            _factor("drag ahead (X_u, X_uu)", axial, values),
            _factor("all drag", [name for name in drag if len(drag) > len(axial)], values),
            _factor("all lift", lift, values),
        )
        if one is not None and len(one.coefficients) > 1
    ]
    gains = {
        group: [f"{a}.gain" for a in members if f"{a}.gain" in values]
        for group, members in actuator_groups(vehicle).items()
    }
    for group, members in gains.items():
        if len(members) > 1:
            found.append(_thrust(f"thrust of the group {group}", members, values))
    every = [name for members in gains.values() for name in members]
    if len(gains) > 1 and len(every) > 1:
        found.append(_thrust("all thrust (supply)", every, values))
    found += [payload(vehicle, density=payload_density), _entrained(vehicle)]
    return found


def payload(vehicle: Vehicle, *, density: float = PAYLOAD_DENSITY) -> Candidate:
    """Point mass of wet mass m_w, kg, at x_p; its unknowns are m_w and m_w x_p, kg and kg m.

    Parameters
    ----------
    vehicle : Vehicle
    density : float, optional
        kg/m3, above that of the water.

    Examples
    --------
    >>> import seatrial as st
    >>> vehicle = st.Vehicle.load("cwolf")
    >>> heavier = vehicle.with_coefficients(payload(vehicle).changes(np.array([3.0, 1.2])))
    >>> round(heavier.coefficients()["m"], 2), round(heavier.coefficients()["x_g"], 4)
    (139.84, 0.0138)
    """
    around = vehicle.environment()
    rho, g = float(around["rho"]), float(around["g"])
    values = vehicle.coefficients()

    def changes(theta: Array) -> dict[str, float]:
        wet, moment = float(theta[0]), float(theta[1])
        dry = wet / (1.0 - rho / density)
        lifted = g * (dry - wet)
        m, b = values["m"] + dry, values["B"] + lifted
        share = dry / wet if wet else 1.0 / (1.0 - rho / density)
        # A moment without any weight is a mass moved along the vehicle.
        inertia = dry * (moment / wet) ** 2 if abs(wet) > 0.05 * abs(moment) else 0.0
        new = {
            "m": m,
            "B": b,
            "x_g": (values["m"] * values["x_g"] + share * moment) / m,
            "x_b": (values["B"] * values["x_b"] + g * (share - 1.0) * moment) / b,
            "I_y": values["I_y"] + inertia,
            "I_z": values["I_z"] + inertia,
        }
        new |= {name: values["m"] * values[name] / m for name in ("y_g", "z_g")}
        return new | {name: values["B"] * values[name] / b for name in ("y_b", "z_b")}

    def words(theta: Array) -> str:
        wet, moment = float(theta[0]), float(theta[1])
        if abs(wet) <= 0.02 * abs(moment):
            return f"a trim moment of {moment:+.2g} kg m: weight moved {'forward' if moment > 0 else 'aft'}"
        what = "a payload of" if wet > 0.0 else "buoyancy added, or weight lost, of"
        return f"{what} {wet:+.2g} kg in water at x = {moment / wet:.2g} m"

    length = max(float(np.sqrt(12.0 * values["I_y"] / values["m"])), 0.1)
    scale = 0.01 * values["m"] * np.array([1.0, 0.25 * length])
    return Candidate(
        "payload (m, B, x_g, x_b, I_y, I_z together)",
        "group",
        ("kg in water", "kg m"),
        scale,
        changes,
        words,
        ("m", "B", "x_g", "x_b", "I_y", "I_z"),
    )


def _entrained(vehicle: Vehicle) -> Candidate:
    """Water that goes along: mass with its own buoyancy."""
    values, g = vehicle.coefficients(), float(vehicle.environment()["g"])

    def changes(theta: Array) -> dict[str, float]:
        return {"m": values["m"] + float(theta[0]), "B": values["B"] + g * float(theta[0])}

    def words(theta: Array) -> str:
        verb = "more" if theta[0] > 0.0 else "less"
        return f"{abs(theta[0]):.3g} kg {verb} mass that is neutral in water, as of a flooded space"

    return Candidate(
        "neutral mass (m, B together)",
        "group",
        ("kg",),
        np.array([0.05 * values["m"]]),
        changes,
        words,
        ("m", "B"),
    )


def _single(name: str, value: float, unit: str, values: Mapping[str, float]) -> Candidate:
    plain = "" if unit == "1" else f" {unit}"

    def words(theta: Array) -> str:
        new = value + float(theta[0])
        if name == "B":
            return f"buoyancy {theta[0]:+.3g} N: {'lighter' if theta[0] > 0.0 else 'heavier'} in water"
        if name.endswith(".gain") and value:
            return f"{name.removesuffix('.gain')} gives {100.0 * theta[0] / value:+.0f} % thrust"
        change = f" ({100.0 * theta[0] / abs(value):+.0f} % in magnitude)" if value else ""
        if value:
            change = f" ({100.0 * (abs(new) - abs(value)) / abs(value):+.0f} % in magnitude)"
        return f"{name} {value:.3g} to {new:.3g}{plain}{change}"

    size = abs(value) or (0.02 if name[:2] in ("x_", "y_", "z_") else 1.0)
    if name == "B":
        size = 0.01 * abs(values["B"]) or 1.0
    return Candidate(
        name,
        "coefficient",
        (unit,),
        np.array([0.1 * size]),
        lambda theta: {name: value + float(theta[0])},
        words,
        (name,),
    )


def _factor(name: str, members: Sequence[str], values: Mapping[str, float]) -> Candidate | None:
    if not members:
        return None

    def changes(theta: Array) -> dict[str, float]:
        return {member: (1.0 + float(theta[0])) * values[member] for member in members}

    label = name.partition(" (")[0]
    return Candidate(
        name,
        "group",
        ("1",),
        np.array([0.1]),
        changes,
        lambda theta: f"{label} {100.0 * theta[0]:+.0f} %",
        tuple(members),
    )


def _thrust(name: str, members: Sequence[str], values: Mapping[str, float]) -> Candidate:
    made = _factor(name, members, values)
    assert made is not None
    return made
