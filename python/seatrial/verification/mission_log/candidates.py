"""What may have changed on a vehicle since its model was identified: single coefficients and linked groups.

A change at sea rarely moves one coefficient. A payload of wet mass m_w at r_p and of density rho_p has the
dry mass ``m_d = m_w / (1 - rho/rho_p)`` and moves mass, buoyancy, both centres and the inertias about O
(Fossen 2021, section 3.2; parallel axes):

    m' = m + m_d,  B' = B + g (m_d - m_w),  m' r_G' = m r_G + m_d r_p,  B' r_B' = B r_B + g (m_d - m_w) r_p,
    I_y' = I_y + m_d x_p^2,  I_z' = I_z + m_d x_p^2  (r_p on the x axis).

Its unknowns are m_w and ``m_w x_p``, in which it is linear but for the inertias.

Candidates are tried on whitened residuals: in units of a valid model's errors, without what the state at a
restart explains. Per window the residual r, in units of a valid model's spread, is ``r = J_theta theta + J_0
x_0 + e``: J exact derivatives, x_0 the error of the state at the restart, known to within the noise. With
``J_0 S_0`` = U D V' the whitening ``I - U (1 - (1 + D^2)^-1/2) U'`` leaves unit noise (variable projection
with a prior).

Tests: ``tests/verification/test_recorded_suspects.py``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import CHANNELS
from seatrial.base.finding import Finding, Severity
from seatrial.base.plain import Plain
from seatrial.base.report import clause_of
from seatrial.vehicle.actuators import actuator_groups
from seatrial.verification.mission_log.spread import SPREAD_SETTINGS, PredictedLog, Slopes, Spread

if TYPE_CHECKING:
    from seatrial._core import Vehicle


@dataclass(frozen=True)
class Suspect(Plain, only="name kind change values units sigma gain left p sigmas alike coefficients"):
    """A change of the vehicle, or of its surroundings, that explains a part of the misfit.

    Attributes
    ----------
    name, kind
        Of the candidate: a "coefficient", a "group", an "actuator", a "sensor" or the "surroundings".
    finding
        What changed, with its size.
    values, units, sigma
        The best values of its unknowns, their units, and the standard deviation over windows.
    gain
        Share of the misfit (sum of squares) that it explains, simulated anew.
    left
        Root mean square of what it leaves, in units of a valid model's error.
    p
        Of no change, jackknife over windows, times the number of unknowns that were tried (Bonferroni).
    sigmas
        Change over the identified standard deviation; None where that is not known.
    alike
        Candidates that this log cannot tell from it.
    coefficients
        Values {name: value} that it would give the vehicle.
    """

    name: str
    kind: str
    finding: Finding
    values: tuple[float, ...]
    units: tuple[str, ...]
    sigma: tuple[float, ...]
    gain: float
    left: float
    p: float
    sigmas: float | None
    alike: tuple[str, ...]
    coefficients: Mapping[str, float]

    @property
    def change(self) -> str:
        """The change in words."""
        return clause_of(self.finding, "mission_log_findings")


@dataclass(frozen=True)
class CandidateSettings:
    """How candidates are differentiated and followed."""

    #: Density of a payload, kg/m3, where nothing else is known: aluminium, and housings with what they hold.
    payload_density: float = 2700.0
    #: Step of a difference over the size of a candidate: far above rounding, far below what bends.
    step: float = 1e-4
    #: Reweightings of Huber's loss.
    reweightings: int = 4
    #: Knee of Huber's loss over the median size of a window's errors.
    knee: float = 2.0


CANDIDATE_SETTINGS = CandidateSettings()


_MASS = ("m", "B", "x_g", "y_g", "z_g", "I_x", "I_y", "I_z")

_HYDRO = re.compile(r"[XYZKMN]_([uvwpqr]{1,2}|[uvwpqr]dot|0)|C_D[yz]")

_DRAG = re.compile(r"[XYZKMN]_([uvwpqr])\1?|C_D[yz]")

_LIFT = re.compile(r"[YZMN]_u[vwqr]")


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
    finding
        What changed, for values (d,) of the unknowns.
    coefficients
        Names of the coefficients that it moves.
    """

    name: str
    kind: str
    units: tuple[str, ...]
    scale: Array
    changes: Callable[[Array], dict[str, float]]
    finding: Callable[[Array], Finding]
    coefficients: tuple[str, ...]

    def directions(self) -> list[dict[str, float]]:
        """Changes of the coefficients with one unit of each unknown, to first order."""
        found = []
        zero = np.zeros(len(self.scale))
        for k, size in enumerate(CANDIDATE_SETTINGS.step * self.scale):
            step = np.zeros(len(self.scale))
            step[k] = size
            ahead, astern = self.changes(zero + step), self.changes(zero - step)
            found.append({name: (ahead[name] - astern[name]) / (2.0 * size) for name in ahead})
        return found


def candidates(
    vehicle: Vehicle,
    *,
    identified: Sequence[str] = (),
    payload_density_kg_m3: float = CANDIDATE_SETTINGS.payload_density,
) -> list[Candidate]:
    """Candidates of a vehicle: its coefficients and the identified ones, then groups that change together.

    Those in `identified` are tried even where they are zero.
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
    gains = {
        group: [f"{a}.gain" for a in members if f"{a}.gain" in values]
        for group, members in actuator_groups(vehicle).items()
    }
    groups = {
        "drag ahead (X_u, X_uu)": axial,
        "all drag": drag if len(drag) > len(axial) else [],
        "all lift": lift,
        **{f"thrust of the group {group}": members for group, members in gains.items()},
        "all thrust (supply)": [name for members in gains.values() for name in members if len(gains) > 1],
    }
    # A group of one is that coefficient.
    found += [_factor(name, members, values) for name, members in groups.items() if len(members) > 1]
    found += [payload(vehicle, density=payload_density_kg_m3), _entrained(vehicle)]
    return found


def payload(vehicle: Vehicle, *, density: float = CANDIDATE_SETTINGS.payload_density) -> Candidate:
    """Point mass of wet mass m_w, kg, at x_p; its unknowns are m_w and m_w x_p, kg and kg m.

    `density`, kg/m3, is above that of the water.

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

    def found(theta: Array) -> Finding:
        return changed("payload", wet_kg=float(theta[0]), moment_kg_m=float(theta[1]))

    length = max(float(np.sqrt(12.0 * values["I_y"] / values["m"])), 0.1)
    scale = 0.01 * values["m"] * np.array([1.0, 0.25 * length])
    return Candidate(
        "payload (m, B, x_g, x_b, I_y, I_z together)",
        "group",
        ("kg in water", "kg m"),
        scale,
        changes,
        found,
        ("m", "B", "x_g", "x_b", "I_y", "I_z"),
    )


def _entrained(vehicle: Vehicle) -> Candidate:
    """Water that goes along: mass with its own buoyancy."""
    values, g = vehicle.coefficients(), float(vehicle.environment()["g"])

    def changes(theta: Array) -> dict[str, float]:
        return {"m": values["m"] + float(theta[0]), "B": values["B"] + g * float(theta[0])}

    return Candidate(
        "neutral mass (m, B together)",
        "group",
        ("kg",),
        np.array([0.05 * values["m"]]),
        changes,
        lambda theta: changed("neutral mass", mass_kg=float(theta[0])),
        ("m", "B"),
    )


def _single(name: str, value: float, unit: str, values: Mapping[str, float]) -> Candidate:
    """A coefficient with another value."""
    size = abs(value) or (0.02 if name[:2] in ("x_", "y_", "z_") else 1.0)
    if name == "B":
        size = 0.01 * abs(values["B"]) or 1.0
    return Candidate(
        name,
        "coefficient",
        (unit,),
        np.array([0.1 * size]),
        lambda theta: {name: value + float(theta[0])},
        lambda theta: changed("coefficient", name, present=value, change=float(theta[0]), unit=unit),
        (name,),
    )


def _factor(name: str, members: Sequence[str], values: Mapping[str, float]) -> Candidate:
    """Coefficients that change by one factor."""

    def changes(theta: Array) -> dict[str, float]:
        return {member: (1.0 + float(theta[0])) * values[member] for member in members}

    return Candidate(
        name,
        "group",
        ("1",),
        np.array([0.1]),
        changes,
        lambda theta: changed("factor", name.partition(" (")[0], factor=1.0 + float(theta[0])),
        tuple(members),
    )


def changed(kind: str, subject: str = "", **values: Any) -> Finding:
    """A change that is suspected, with its size."""
    return Finding(kind, Severity.PROBLEM, subject, values)


class Whitening:
    """Residuals and derivatives of a log in units of the spread, without what a start explains.

    `residual`, `counted`: per window (n, C): residuals, and which of them count. `weight`: of every window.
    `cost`: sum of squares. `places`: channels that count, as places in `CHANNELS`.
    """

    def __init__(self, log: PredictedLog, spread: Spread, slopes: Sequence[Slopes]) -> None:
        self.log = log
        self.places = [k for k, name in enumerate(CHANNELS) if name in log.channels]
        start = np.where(np.isfinite(spread.noise), spread.noise, 0.0)[list(SPREAD_SETTINGS.initial_places)]
        self.counted = [mask[:, self.places] for mask in log.counted]
        self.scale, self.shrink = [], []
        for w, slope in enumerate(slopes):
            scale = 1.0 / spread.at(log.since_restart(w))[:, self.places]
            self.scale.append(scale)
            by_start = slope.by_start[:, self.places] * start * scale[:, :, None]
            u, d, _ = np.linalg.svd(by_start.reshape(-1, 12), full_matrices=False)
            self.shrink.append((u, 1.0 - 1.0 / np.sqrt(1.0 + d**2)))
        self.weight = np.ones(len(slopes))
        sizes = np.array([float(np.sqrt(np.mean(one**2))) for one in self.of(log.residual)])
        # Huber's weights for whole windows: a few wild ones shall not name the suspect.
        self.weight = np.minimum(1.0, CANDIDATE_SETTINGS.knee * np.median(sizes) / np.maximum(sizes, 1e-300))
        self.residual = self.of(log.residual)
        self.cost = sum(float((one**2).sum()) for one in self.residual)

    def of(self, parts: Sequence[Array]) -> list[Array]:
        """Residuals (n, C) of every window, whitened."""
        return [self._white(w, part[:, self.places, None])[:, :, 0] for w, part in enumerate(parts)]

    def columns(self, slopes: Sequence[Slopes]) -> list[Array]:
        """Derivatives (n, C, d) of every window, whitened."""
        return [self._white(w, slope.by_direction[:, self.places]) for w, slope in enumerate(slopes)]

    def followed(
        self, candidate: Candidate, columns: Sequence[Array], own: Sequence[int], theta: Array, linear: float
    ) -> tuple[Array, float]:
        """Best values of a candidate on the non-linear model, and the fall of the sum of squares."""
        own_columns = [part[:, :, own].reshape(-1, len(own)) for part in columns]
        normal = sum(part.T @ part for part in own_columns)
        best, least = np.zeros(len(own)), self.cost
        step = theta
        for _ in range(CANDIDATE_SETTINGS.reweightings):
            at, reach = best + step, None
            for _ in range(3):  # a step too far is halved
                reach = self._cost(candidate, at)
                if reach is not None and reach[0] < least:
                    break
                at = 0.5 * (at + best)
            if reach is None or reach[0] >= least:
                break
            gained, best, least = least - reach[0], at, reach[0]
            pull = sum(part.T @ r.ravel() for part, r in zip(own_columns, reach[1], strict=True))
            step = np.linalg.solve(np.atleast_2d(normal), np.atleast_1d(pull))
            if gained < 1e-3 * self.cost:
                break
        return best, self.cost - least

    def _cost(self, candidate: Candidate, theta: Array) -> tuple[float, list[Array]] | None:
        from seatrial.base.errors import SeatrialError

        try:
            parts = self.log.of(candidate.changes(theta))
        except SeatrialError:  # no vehicle has such coefficients
            return None
        if not all(np.isfinite(part).all() for part in parts):
            return None
        white = self.of(parts)
        return sum(float((one**2).sum()) for one in white), white

    def _white(self, w: int, part: Array) -> Array:
        scaled = np.where(self.counted[w][:, :, None], part * self.scale[w][:, :, None], 0.0)
        flat = scaled.reshape(-1, part.shape[2])
        u, shrink = self.shrink[w]
        flat = flat - u @ (shrink[:, None] * (u.T @ flat))
        return np.asarray(self.weight[w] * flat.reshape(scaled.shape))
