"""Suspects: which change of the vehicle or its surroundings explains the misfit of a log, sorted by how much.

A change at sea rarely moves one coefficient: candidates are single coefficients and linked groups. Residuals
r and exact derivatives J are in units of a valid model's spread, without what the state at a restart explains
(`Whitening`). For every candidate alone

    theta = (J'J)^-1 J'r,   gain = (J'r)' (J'J)^-1 (J'r) / r'r,

its scatter by the jackknife over windows (`seatrial.statistics.significance`). The best ones are then
followed by Gauss-Newton steps with J held and the non-linear model simulated, and sorted by what they truly
explain, less Akaike's share for each unknown. Candidates whose columns run alike (90 % of one's square lies
in the span of the other's) cannot be told apart by the log and are named beside it. Beside the coefficients
stand:

*An actuator that did not do what its commands say*: a jam, a lost propeller or a command that was not logged
is no change of a coefficient; where the command says nothing, no gain explains a thrust. Each actuator in
turn is given a steady thrust of its own in each window. With c_w the whitened derivative of window w by that
thrust (a constant wrench along the actuator's, `X_0` ... `N_0`) and r_w its residual,

    f_w = c_w'r_w / c_w'c_w,   gain = sum_w (c_w'r_w)^2 / c_w'c_w

(structured residuals with one unknown input, Isermann, *Fault-Diagnosis Systems* (2006), chapter 10). It has
as many unknowns as windows and pays for them.

*An offset that a sensor has throughout the log*: it shows d more and starts every window d away, so that
measured less predicted moves by ``(e - dy/dx_0) d``, e one in its own channel.

*A steady current that was not logged*: north and east by Gauss-Newton steps on the whitened residuals. On one
heading a current cannot be told from thrust or drag; what it could hide is taken out of the chance that the
log would have shown it (`seatrial.verification.mission_log.verdict`).

Tests: ``tests/verification/test_recorded_suspects.py``, ``tests/verification/test_recorded_current.py``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.base.channels import CHANNELS
from seatrial.base.errors import SeatrialError
from seatrial.base.finding import Finding, Severity
from seatrial.base.plain import Plain
from seatrial.base.report import clause_of
from seatrial.statistics.linearisation import Linearisation, Piece
from seatrial.statistics.significance import ScoreTests, score_tests
from seatrial.vehicle.actuators import actuator_groups
from seatrial.verification.mission_log.spread import SPREAD_SETTINGS, PredictedLog, Slopes, Spread

if TYPE_CHECKING:
    from seatrial._core import Vehicle


_WRENCH = ("X_0", "Y_0", "Z_0", "K_0", "M_0", "N_0")
_SENSED = ("u", "v", "w", "p", "q", "r", "roll", "pitch", "yaw")
_MASS = ("m", "B", "x_g", "y_g", "z_g", "I_x", "I_y", "I_z")
_HYDRO = re.compile(r"[XYZKMN]_([uvwpqr]{1,2}|[uvwpqr]dot|0)|C_D[yz]")
_DRAG = re.compile(r"[XYZKMN]_([uvwpqr])\1?|C_D[yz]")
_LIFT = re.compile(r"[YZMN]_u[vwqr]")


@dataclass(frozen=True)
class SuspectSettings:
    """How candidates are followed, which changes count as suspects, and which cannot be told apart."""

    #: Density of a payload, kg/m3, where nothing else is known: aluminium, and housings with what they hold.
    payload_density: float = 2700.0
    #: Step of a difference over the size of a candidate: far above rounding, far below what bends.
    step: float = 1e-4
    reweightings: int = 4  #: Reweightings of Huber's loss.
    knee: float = 2.0  #: Knee of Huber's loss over the median size of a window's errors.
    alike_share: float = 0.9  #: Share of the gain from which another explanation is as likely.
    strongest_current_m_s: float = 3.0  #: Tidal streams are weaker, but for a few narrows.
    steps: int = 4  #: Gauss-Newton steps: the current enters nearly linearly.
    least_gain: float = 0.02  #: Share of the cost: less explains nothing that a user would see.
    listed: int = 8  #: Suspects that are listed: a joint gain is worked out for each, which costs a fit.


SUSPECT_SETTINGS = SuspectSettings()


@dataclass(frozen=True)
class Suspect(Plain, only="name kind change values units sigma gain left p sigmas alike coefficients"):
    """A change of the vehicle, or of its surroundings, that explains a part of the misfit.

    `name`, `kind`: of the candidate: a "coefficient", a "group", an "actuator", a "sensor" or the
    "surroundings". `finding`: what changed, with its size. `values`, `units`, `sigma`: the best values of its
    unknowns, their units, and the standard deviation over windows. `gain`: share of the misfit (sum of
    squares) that it explains, simulated anew. `left`: root mean square of what it leaves, in units of a valid
    model's error. `p`: of no change, jackknife over windows, times the number of unknowns that were tried
    (Bonferroni). `sigmas`: change over the identified standard deviation; None where that is not known.
    `alike`: candidates that this log cannot tell from it. `coefficients`: values {name: value} that it would
    give the vehicle.
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
        return clause_of(self.finding, "mission_log")


@dataclass(frozen=True, eq=False)
class Candidate:
    """Something that may have changed.

    `name`: a coefficient, or what the group stands for. `kind`: as of `Suspect`.
    `units`: unit of every unknown. `scale`: a natural size of every unknown, (d,). `changes`: coefficients
    {name: value} of the vehicle for values (d,) of the unknowns; the present ones for zero. `finding`: what
    changed, for values (d,) of the unknowns.
    """

    name: str
    kind: str
    units: tuple[str, ...]
    scale: Array
    changes: Callable[[Array], dict[str, float]]
    finding: Callable[[Array], Finding]

    def directions(self) -> list[dict[str, float]]:
        """Changes of the coefficients with one unit of each unknown, to first order."""
        found = []
        zero = np.zeros(len(self.scale))
        for k, size in enumerate(SUSPECT_SETTINGS.step * self.scale):
            step = np.zeros(len(self.scale))
            step[k] = size
            ahead, astern = self.changes(zero + step), self.changes(zero - step)
            found.append({name: (ahead[name] - astern[name]) / (2.0 * size) for name in ahead})
        return found


def candidates(
    vehicle: Vehicle,
    *,
    identified: Sequence[str] = (),
    payload_density_kg_m3: float = SUSPECT_SETTINGS.payload_density,
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


def payload(vehicle: Vehicle, *, density: float = SUSPECT_SETTINGS.payload_density) -> Candidate:
    """Point mass of wet mass m_w, kg, at x_p; its unknowns are m_w and m_w x_p, kg and kg m.

    At r_p and of a `density` rho_p, kg/m3, above that of the water, it has the dry mass ``m_d = m_w / (1 -
    rho/rho_p)`` and moves mass, buoyancy, both centres and the inertias about O (Fossen 2021, section 3.2;
    parallel axes):

        m' = m + m_d,  B' = B + g (m_d - m_w),  m' r_G' = m r_G + m_d r_p,
        B' r_B' = B r_B + g (m_d - m_w) r_p,  I_y' = I_y + m_d x_p^2,  I_z' = I_z + m_d x_p^2.

    In its unknowns it is linear but for the inertias.

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

    length = max(float(np.sqrt(12.0 * values["I_y"] / values["m"])), 0.1)
    scale = 0.01 * values["m"] * np.array([1.0, 0.25 * length])
    name, units = "payload (m, B, x_g, x_b, I_y, I_z together)", ("kg in water", "kg m")

    def finding(theta: Array) -> Finding:
        return changed("payload", wet_kg=float(theta[0]), moment_kg_m=float(theta[1]))

    return Candidate(name, "group", units, scale, changes, finding)


def _entrained(vehicle: Vehicle) -> Candidate:
    """Water that goes along: mass with its own buoyancy."""
    values, g = vehicle.coefficients(), float(vehicle.environment()["g"])

    def changes(theta: Array) -> dict[str, float]:
        return {"m": values["m"] + float(theta[0]), "B": values["B"] + g * float(theta[0])}

    name, scale = "neutral mass (m, B together)", np.array([0.05 * values["m"]])

    def finding(theta: Array) -> Finding:
        return changed("neutral mass", mass_kg=float(theta[0]))

    return Candidate(name, "group", ("kg",), scale, changes, finding)


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
    )


def _factor(name: str, members: Sequence[str], values: Mapping[str, float]) -> Candidate:
    """Coefficients that change by one factor."""

    def changes(theta: Array) -> dict[str, float]:
        return {member: (1.0 + float(theta[0])) * values[member] for member in members}

    def finding(theta: Array) -> Finding:
        return changed("factor", name.partition(" (")[0], factor=1.0 + float(theta[0]))

    return Candidate(name, "group", ("1",), np.array([0.1]), changes, finding)


def changed(kind: str, subject: str = "", **values: Any) -> Finding:
    """A change that is suspected, with its size."""
    return Finding(kind, Severity.PROBLEM, subject, values)


class Whitening:
    """Residuals and derivatives of a log in units of the spread, without what a start explains.

    Per window the residual r, in units of a valid model's spread, is ``r = J_theta theta + J_0 x_0 + e``: J
    exact derivatives, x_0 the error of the state at the restart, known to within the noise. With ``J_0 S_0``
    = U D V' the whitening ``I - U (1 - (1 + D^2)^-1/2) U'`` leaves unit noise (variable projection with a
    prior).

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
        self.weight = np.minimum(1.0, SUSPECT_SETTINGS.knee * np.median(sizes) / np.maximum(sizes, 1e-300))
        self.residual = self.of(log.residual)
        self.cost = sum(float((one**2).sum()) for one in self.residual)

    def of(self, parts: Sequence[Array]) -> list[Array]:
        """Residuals (n, C) of every window, whitened."""
        return [self._white(w, part[:, self.places, None])[:, :, 0] for w, part in enumerate(parts)]

    def columns(self, slopes: Sequence[Slopes]) -> list[Array]:
        """Derivatives (n, C, d) of every window, whitened."""
        return [self._white(w, slope.by_direction[:, self.places]) for w, slope in enumerate(slopes)]

    def followed(
        self, candidate: Candidate, columns: Sequence[Array], own: Sequence[int], theta: Array
    ) -> tuple[Array, float]:
        """Best values of a candidate on the non-linear model, and the fall of the sum of squares."""
        own_columns = [part[:, :, own].reshape(-1, len(own)) for part in columns]
        normal = sum(part.T @ part for part in own_columns)
        best, least = np.zeros(len(own)), self.cost
        step = theta
        for _ in range(SUSPECT_SETTINGS.reweightings):
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


def suspects(
    log: PredictedLog,
    spread: Spread,
    tried: Sequence[Candidate],
    *,
    sigma: Mapping[str, float] | None = None,
    current: bool = True,
) -> tuple[Suspect, ...]:
    """Suspects of a log, the one that explains most first.

    `spread`: of a valid model's errors. `sigma`: standard deviations of the identified coefficients.
    `current`: whether a steady current that was not recorded is tried too.
    """
    directions = [direction for candidate in tried for direction in candidate.directions()]
    slopes = log.slopes(directions, current=current)
    white = Whitening(log, spread, slopes)
    if not white.cost > 0.0:  # no channel has a spread to measure its error by
        return ()
    sensed = [name for name in log.channels if name in _SENSED]
    columns = [
        np.concatenate(pair, axis=2)
        for pair in zip(white.columns(slopes), white.columns(offset_slopes(log, slopes, sensed)), strict=True)
    ]
    tests = score_tests(
        _linearisation(white.residual, white.counted),
        columns,
        fitted=(),
        block=[np.full(len(part), w) for w, part in enumerate(columns)],
    )
    # The unknowns of every explanation, in the order of the columns.
    every = [*tried, *([_unlogged_current()] if current else []), *map(_sensor_offset, sensed)]
    edges = np.cumsum([0, *(len(candidate.scale) for candidate in every)]).tolist()
    places = [list(range(a, b)) for a, b in pairwise(edges)]
    squares = white.weight**2
    samples = float(sum(w * mask.sum() for w, mask in zip(squares, white.counted, strict=True)))
    # The score test thins long logs.
    part = white.cost / max(tests.cost, 1e-300)
    fits = [(theta, part * gain) for theta, gain in (_fit(tests, own) for own in places)]
    results = tests.results()
    order = sorted(range(len(places)), key=lambda i: -fits[i][1])
    # Errors of a window hang together: it is worth about one observation per channel.
    # Akaike (1974): two in twice the log-likelihood, per parameter.
    penalty = 2.0 * white.cost / (len(columns) * len(white.places))
    ranked: list[tuple[float, Suspect]] = []
    for i in order[: 2 * SUSPECT_SETTINGS.listed]:
        candidate, own, (theta, gain) = every[i], places[i], fits[i]
        if i < len(tried):  # the others are linear, or nearly
            theta, gain = white.followed(candidate, columns, own, theta)
        coefficients = candidate.changes(theta)
        if gain < SUSPECT_SETTINGS.least_gain * white.cost or not _plausible(log, coefficients):
            continue
        strongest = SUSPECT_SETTINGS.strongest_current_m_s
        if candidate.kind == "surroundings" and float(np.hypot(*theta)) > strongest:
            continue
        known = (sigma or {}).get(candidate.name)
        suspect = Suspect(
            name=candidate.name,
            kind=candidate.kind,
            finding=candidate.finding(theta),
            values=tuple(float(x) for x in theta),
            units=candidate.units,
            sigma=tuple(float(results.sigma[k]) for k in own),
            gain=gain / white.cost,
            left=float(np.sqrt(max(white.cost - gain, 0.0) / max(samples, 1.0))),
            p=min(1.0, edges[-1] * float(np.min(results.p[own]))),
            sigmas=None if not known else float(theta[0]) / known,
            alike=_alike(tests, places, i, ([one.name for one in every], [f[1] for f in fits])),
            coefficients=coefficients,
        )
        # Of two that explain the same, the one that is a thing rather than a number is read first.
        # A hundredth of the cost decides ties only.
        worth = gain - penalty * (len(own) - 1) + (0.01 * white.cost if candidate.kind == "group" else 0.0)
        ranked.append((worth, suspect))
    ranked += _unlogged_thrusts(log, white, samples, penalty)
    ranked.sort(key=lambda pair: -pair[0])
    return tuple(suspect for _, suspect in ranked[: SUSPECT_SETTINGS.listed])


def _unlogged_current() -> Candidate:
    """A steady current, m/s."""

    def finding(theta: Array) -> Finding:
        return changed("current", north_m_s=float(theta[0]), east_m_s=float(theta[1]))

    return Candidate("current", "surroundings", ("m/s", "m/s"), np.ones(2), lambda theta: {}, finding)


def _sensor_offset(channel: str) -> Candidate:
    """An offset that a sensor has throughout the log, SI."""
    unit = "rad" if channel in ("roll", "pitch", "yaw") else "rad/s" if channel in ("p", "q", "r") else "m/s"

    def finding(theta: Array) -> Finding:
        return changed("sensor offset", channel, offset=float(theta[0]))

    return Candidate(f"offset of {channel}", "sensor", (unit,), np.ones(1), lambda theta: {}, finding)


def _unlogged_thrusts(
    log: PredictedLog, white: Whitening, samples: float, penalty: float
) -> list[tuple[float, Suspect]]:
    """Every actuator with a steady thrust, N, of its own in each window that its commands do not tell.

    With what it is worth, the fall of the sum of squares less the `penalty` of every further unknown; none
    where a recorded wrench drives the vehicle. The p-value is that of an F-test with an observation per
    channel and window, times the actuators tried.
    """
    from scipy.stats import f as fisher

    if log.input == "tau":
        return []
    facts, names = log.vehicle.actuator_info(), list(log.vehicle.actuators)
    directions: list[Mapping[str, float]] = [
        dict(zip(_WRENCH, (float(x) for x in facts[name]["wrench"]), strict=True)) for name in names
    ]
    columns = white.columns(log.slopes(directions))
    pull = np.array([np.einsum("ncd,nc->d", one, r) for one, r in zip(columns, white.residual, strict=True)])
    square = np.array([np.einsum("ncd,ncd->d", one, one) for one in columns])  # (windows, actuators)
    known = square > 1e-12 * np.maximum(square.max(axis=0), 1e-300)
    thrusts = np.where(known, pull / np.where(known, square, 1.0), 0.0)
    gains = (thrusts * pull).sum(axis=0).tolist()
    windows = len(columns)
    free = max(windows * (len(white.places) - 1), 1)
    ranked = []
    for k, name in sorted(enumerate(names), key=lambda pair: -gains[pair[0]]):
        gain, thrust, left = gains[k], thrusts[:, k], max(white.cost - gains[k], 1e-300)
        if gain < SUSPECT_SETTINGS.least_gain * white.cost:
            continue
        # Actuators that explain nearly as much.
        least = SUSPECT_SETTINGS.alike_share * gain
        near = [(gains[j], other) for j, other in enumerate(names) if j != k and gains[j] > least]
        mean, rms = float(thrust.mean()), float(np.sqrt(np.mean(thrust**2)))
        finding = changed("unlogged thrust", name, rms_n=rms, mean_n=mean)
        suspect = Suspect(
            name=name,
            kind="actuator",
            finding=finding,
            values=(mean,),
            units=("N",),
            sigma=(float(thrust.std(ddof=1)) / windows**0.5,),
            gain=gain / white.cost,
            left=float(np.sqrt(max(white.cost - gain, 0.0) / max(samples, 1.0))),
            p=min(1.0, len(facts) * float(fisher.sf(gain / windows / (left / free), windows, free))),
            sigmas=None,
            alike=tuple(other for _, other in sorted(near, reverse=True)),
            coefficients={},
        )
        ranked.append((gain - penalty * (windows - 1), suspect))
    return ranked


def in_current(log: PredictedLog, spread: Spread) -> tuple[PredictedLog, tuple[float, float]]:
    """Log without a recorded current, with the steady one that suits it best, and that north and east, m/s.

    `spread` is that of a valid model's errors.
    """
    current = np.zeros(2)
    found = log.in_water(current)
    for _ in range(SUSPECT_SETTINGS.steps):
        slopes = found.slopes([], current=True)
        white = Whitening(found, spread, slopes)
        columns = np.concatenate([one.reshape(-1, 2) for one in white.columns(slopes)])
        residual = np.concatenate([one.ravel() for one in white.residual])
        step = np.linalg.lstsq(columns, residual, rcond=1e-9)[0]
        current = np.clip(
            current + step, -SUSPECT_SETTINGS.strongest_current_m_s, SUSPECT_SETTINGS.strongest_current_m_s
        )
        found = log.in_water(current)
        if float(np.abs(step).max()) < 1e-3:  # m/s: a step of the current that ends the search
            break
    return found, (float(current[0]), float(current[1]))


def offset_slopes(log: PredictedLog, slopes: Sequence[Slopes], channels: Sequence[str]) -> list[Slopes]:
    """Derivatives of measured less predicted by the offset of each channel, per window."""
    own = [CHANNELS.index(name) for name in channels]
    start = np.argsort(SPREAD_SETTINGS.initial_places)[own]
    unit = np.eye(len(CHANNELS))[:, own]
    return [
        Slopes(np.where(mask[:, :, None], unit - one.by_start[:, :, start], 0.0), one.by_start)
        for one, mask in zip(slopes, log.counted, strict=True)
    ]


def _plausible(log: PredictedLog, coefficients: Mapping[str, float]) -> bool:
    """Whether no coefficient changes its sign or becomes three times itself, and no actuator's gain twice."""
    present = log.vehicle.coefficients()
    signed = [
        (present[name], value)
        for name, value in coefficients.items()
        if present.get(name) and name[:2] not in ("x_", "y_", "z_")
    ]
    gains = [
        value / present[name]
        for name, value in coefficients.items()
        if name.endswith(".gain") and present[name]
    ]
    return (
        # Beyond three times its own value another vehicle is described.
        all(0.0 <= value / own <= 3.0 for own, value in signed)
        and max(gains, default=0.0) <= 2.0  # no actuator comes to give twice its thrust
    )


def _linearisation(residual: Sequence[Array], counted: Sequence[NDArray[np.bool_]]) -> Linearisation:
    pieces = tuple(
        Piece(
            trial="log",
            t=np.arange(len(one), dtype=float),
            residual=one,
            counted=mask,
            weight=np.ones_like(one),
            jacobian=np.zeros((*one.shape, 0)),
            nu=np.zeros((len(one), 6)),
        )
        for one, mask in zip(residual, counted, strict=True)
    )
    width = residual[0].shape[1]
    return Linearisation((), np.zeros(0), tuple("c" * width), np.ones(width), 1.0, pieces)


def _fit(tests: ScoreTests, own: Sequence[int]) -> tuple[Array, float]:
    """Values of the unknowns at places `own`, and the fall of the sum of squares, both to first order."""
    total = tests.reduced[0]
    normal, pull = total[np.ix_(own, own)], total[own, -1]
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal / np.outer(size, size) + 1e-9 * np.eye(len(own))
    theta = np.linalg.solve(scaled, pull / size) / size
    if not (np.diag(normal) > 1e-12 * tests.cost).all():
        return np.zeros(len(own)), 0.0
    return theta, float(theta @ pull)


def _alike(
    tests: ScoreTests, places: Sequence[list[int]], of: int, known: tuple[list[str], list[float]]
) -> tuple[str, ...]:
    """Candidates most of whose column lies in the span of this one's, and which explain nearly as much."""
    names, gains = known
    total, own = tests.reduced[0], places[of]
    normal = total[np.ix_(own, own)]
    found = []
    for i, other in enumerate(places):
        if i == of or len(other) > len(own) or gains[i] < SUSPECT_SETTINGS.alike_share * gains[of]:
            continue
        square = total[np.ix_(other, other)]
        cross = total[np.ix_(own, other)]
        if np.trace(square) <= 0.0 or np.trace(normal) <= 0.0:
            continue
        inside = cross.T @ np.linalg.lstsq(normal, cross, rcond=1e-9)[0]
        shares = np.linalg.lstsq(square, inside, rcond=1e-9)[0]
        share = float(np.trace(shares)) / len(other)
        if share > SUSPECT_SETTINGS.alike_share:
            found.append((share, names[i]))
    return tuple(name for _, name in sorted(found, reverse=True))
