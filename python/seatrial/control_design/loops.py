"""Straight level flight, the vehicle about it, sampled behind its actuators' lag and dead time, and closed.

State: the ten deviations z, roll, pitch, heading, u, v, w, p, q, r as far as they matter, the lag of each
commanded row and its past demands, and the integrals of the law. PID and regulator are one matrix K of the
fifteen `STATES`, tau = -K x. Quadratic damping counts by its secant over a small motion: at rest a tangent
would have none. Source: Åström and Wittenmark, *Computer-Controlled Systems* (1997), section 2.3. Held by
tests/control_design/test_control_design.py.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.vehicle.actuators import LOOPS, ROWS, Delay, mixing
from seatrial.vehicle.stability import neutral_fins

if TYPE_CHECKING:
    from seatrial._core import Vehicle


@dataclass(frozen=True)
class LinearMotionSettings:
    """How the motion about a trim is found and made linear."""

    #: Largest angle of a trim, rad: beyond it, the model and straight flight are not what they claim to be.
    largest_angle_rad: float = float(np.deg2rad(25.0))
    balanced_share: float = 1e-6  #: Force that is left of a trim, as a share of the mass times 1 m/s^2.
    #: Motion over which quadratic damping counts by its secant, m/s and rad/s; within it a hull that turns
    #: about by itself may wander.
    small_motion_m_s: float = 0.02
    #: Step of a slope, m/s and rad/s: small beside any motion, large beside rounding.
    tangent_step_m_s: float = 1e-5


SETTINGS = LinearMotionSettings()


ROW_OF, LOOP_OF = dict(zip(LOOPS, ROWS, strict=True)), dict(zip(ROWS, LOOPS, strict=True))
"""The row of the wrench that a loop commands, and the loop of a row."""


def rows_of(loops: Collection[str]) -> str:
    """Rows of the wrench that some loops command, in their order."""
    return "".join(row for row, loop in LOOP_OF.items() if loop in loops)


@dataclass(frozen=True)
class Trim:
    """Attitude (3,) roll, pitch, yaw in rad, nu (6,) in m/s and rad/s, and wrench tau (6,) of the actuators:
    of ``rows`` what is commanded, of the others what comes along.
    """

    speed_m_s: float
    rows: str
    attitude: Array
    nu: Array
    tau: Array
    actuators: tuple[str, ...] | None = None


def level(speed_m_s: float, rows: str, actuators: tuple[str, ...] | None = None) -> Trim:
    """Level motion at a speed in m/s without any wrench: it stands in where there is no trim."""
    nu = np.array([speed_m_s, 0.0, 0.0, 0.0, 0.0, 0.0])
    return Trim(speed_m_s, rows, np.zeros(3), nu, np.zeros(6), actuators)


def trim(
    vehicle: Vehicle, speed_m_s: float, rows: str, actuators: tuple[str, ...] | None = None
) -> Trim | None:
    """Straight flight at constant depth and speed over ground in still water; None where there is none.

    The commanded `rows` (letters of XYZKMN) take what the motion needs, whether or not the actuators reach
    it. Each other row needs an angle that brings its own force to zero: pitch for the heave force, drift for
    the sway force, heel for the roll moment. What the actuators (all by default) bring along counts. A
    negative speed is astern.

    Examples
    --------
    >>> import seatrial as st
    >>> flight = trim(st.Vehicle.load("cwolf"), 1.5, "XMN")
    >>> round(float(np.rad2deg(flight.attitude[1])), 2)  # 5 N too light: bow down
    -0.83
    """
    from scipy.optimize import least_squares

    # Pitch serves the heave force, and where that is commanded the pitch moment; -1 stands for the drift.
    serves = {"Y": -1, "K": 0, "Z": 1, "M": 1 if "Z" in rows else None}
    angles = sorted({angle for row, angle in serves.items() if row not in rows and angle is not None})
    mass = np.asarray(vehicle.mass_matrix())
    scale = np.diag(mass)
    idle = [k for k, row in enumerate(ROWS) if row not in rows]
    chosen = [ROWS.index(row) for row in rows]
    mixed = mixing(vehicle, rows, actuators) if chosen else np.zeros((6, 0))

    def flight(x: Array) -> Trim:
        attitude, drift = np.zeros(3), 0.0
        for angle, value in zip(angles, x, strict=True):
            if angle < 0:
                drift = float(value)
            else:
                attitude[angle] = value
        nu = np.concatenate([_body(attitude, drift) * speed_m_s, np.zeros(3)])
        force = sum(np.asarray(term) for term in vehicle.forces(nu, attitude).values())
        neutral = neutral_fins(vehicle, nu[None])[0]
        along = mixed @ -(force + neutral)[chosen]
        return Trim(speed_m_s, rows, attitude, nu, neutral + along, actuators)

    def residual(x: Array) -> Array:
        at = flight(x)
        rest = np.asarray(vehicle.acceleration(at.nu, at.attitude, at.tau))
        return np.asarray((mass @ rest / scale)[idle])

    solution = np.zeros(len(angles))
    if angles:
        solution = least_squares(residual, solution, bounds=(-1.5, 1.5), xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    left = residual(solution)
    if (
        np.abs(left).max(initial=0.0) > SETTINGS.balanced_share
        or np.abs(solution).max(initial=0.0) > SETTINGS.largest_angle_rad
    ):
        return None
    return flight(solution)


def _body(attitude: Array, drift: float) -> Array:
    """Unit vector of the course in the body frame; the course leads the heading by the drift angle."""
    roll, pitch = attitude[:2]
    north, east = np.cos(drift), np.sin(drift)
    ahead, down = np.cos(pitch) * north, np.sin(pitch) * north
    return np.array([
        ahead,
        np.cos(roll) * east + np.sin(roll) * down,
        -np.sin(roll) * east + np.cos(roll) * down,
    ])


Complex = NDArray[np.complex128]

STATES = ("z", "roll", "pitch", "heading", "u", "v", "w", "p", "q", "r",
          "int u", "int v", "int z", "int pitch", "int heading")  # fmt: skip
"""Columns of K: deviations "measured minus desired" in m, rad, m/s, rad/s, then integrals of some of them."""

PLAIN = 10  # states of the motion, before the integrals: depth, three angles, six velocities

HELD = {"surge": 4, "sway": 5, "heave": 0, "roll": 1, "pitch": 2, "heading": 3}
"""Per loop the state that it holds, as a column of K."""

RATE = {"heave": 6, "roll": 7, "pitch": 8, "heading": 9}
"""Per position loop the rate of that state."""

INTEGRATED = {"surge": (4, 10), "sway": (5, 11), "heave": (0, 12), "pitch": (2, 13), "heading": (3, 14)}
"""Per loop the state that is integrated and its integral, as columns of K."""


@dataclass(frozen=True)
class LoopGain:
    """K_P in N or N m per unit of the error (m/s, m, rad), K_I per s, K_D times s; bandwidth in rad/s."""

    k_p: float
    k_i: float
    k_d: float
    bandwidth: float


@dataclass(frozen=True)
class Plant:
    """x' = a x + b tau about a trim: a (n, n), b (n, rows); ``states`` (n,) are columns of K."""

    a: Array
    b: Array
    states: tuple[int, ...]
    rows: str


@dataclass(frozen=True)
class Sampled:
    """One step x+ = phi x + gamma tau of [plant, lags, past demands, integrals], whose ``columns`` (m,) of K
    are seen at the places ``seen`` (m,).
    """

    phi: Array
    gamma: Array
    columns: tuple[int, ...]
    seen: tuple[int, ...]
    rows: str
    period_s: float


def plant(
    vehicle: Vehicle, at: Trim, loops: tuple[str, ...], *, motion: float = SETTINGS.small_motion_m_s
) -> Plant:
    """Linear motion about a trim with the wrench rows of some loops as input, without the depth and heading
    that no loop holds. Quadratic damping counts by its secant over a ``motion`` in m/s and rad/s.
    """
    a, _ = vehicle.linearize(at.nu, at.attitude, at.tau, form="euler")
    mass = np.asarray(vehicle.mass_matrix())
    a = np.asarray(a).copy()
    tangent = _slope(vehicle, at.nu, np.full(6, SETTINGS.tangent_step_m_s))
    fins = _fin_slope(vehicle, at.nu, motion)
    a[6:, 6:] += np.linalg.solve(mass, _slope(vehicle, at.nu, np.full(6, motion)) - tangent + fins)
    rows = rows_of(loops)
    b = np.vstack([np.zeros((6, len(rows))), np.linalg.solve(mass, mixing(vehicle, rows, at.actuators))])
    dropped = {k for k, loop in ((0, "heave"), (3, "heading")) if loop not in loops}
    states = tuple(k for k in range(PLAIN) if k not in dropped)
    places = [k + 2 for k in states]
    return Plant(a[np.ix_(places, places)], b[places], states, rows)


def sampled(of: Plant, delays: Mapping[str, Delay], period_s: float, loops: tuple[str, ...]) -> Sampled:
    """The plant behind lag and dead time under demands held for a period, with the integrals of the loops."""
    from scipy.linalg import expm

    n, m = of.b.shape
    a = np.zeros((n + m, n + m))
    b = np.zeros((n + m, m))
    a[:n, :n], a[:n, n:] = of.a, of.b
    # The ramp of a rate limit is taken as a lag; the bound keeps one that is none finite.
    lags = [max(delays[row].lag_s + delays[row].ramp_s, 0.02 * period_s) for row in of.rows]
    a[n:, n:], b[n:] = -np.diag(1.0 / np.array(lags)), np.diag(1.0 / np.array(lags))

    def held(column: int, duration: float) -> tuple[Array, Array]:
        block = np.zeros((n + m + 1, n + m + 1))
        block[: n + m, : n + m], block[: n + m, -1] = a, b[:, column]
        step = expm(block * duration)
        return step[: n + m, : n + m], step[: n + m, -1]

    past = [int(np.ceil(delays[row].dead_s / period_s - 1e-9)) for row in of.rows]
    size, integrals = n + m + sum(past), [INTEGRATED[loop] for loop in loops if loop in INTEGRATED]
    phi = np.zeros((size + len(integrals), size + len(integrals)))
    gamma = np.zeros((size + len(integrals), m))
    phi[: n + m, : n + m] = held(0, period_s)[0]
    place = n + m
    for k, row in enumerate(of.rows):
        # Within a step the demand of `past` steps ago holds first, then the one after it.
        early = delays[row].dead_s - (past[k] - 1) * period_s if past[k] else 0.0
        late_step, late = held(k, period_s - early)
        _, first = held(k, early)
        chain = [place + i for i in range(past[k])]  # youngest first
        if chain:
            phi[: n + m, chain[-1]] = late_step @ first
            for older, younger in zip(chain[1:], chain[:-1], strict=True):
                phi[older, younger] = 1.0
            gamma[chain[0], k] = 1.0
        if past[k] > 1:
            phi[: n + m, chain[-2]] = late
        else:
            gamma[: n + m, k] = late
        place += past[k]
    seen, columns = list(range(n)), list(of.states)
    for k, (state, integral) in enumerate(integrals):
        phi[size + k, size + k] = 1.0
        phi[size + k, of.states.index(state)] = period_s
        seen.append(size + k)
        columns.append(integral)
    return Sampled(phi, gamma, tuple(columns), tuple(seen), of.rows, period_s)


def feedback(of: Sampled, gain: Array) -> Array:
    """K (rows, state) of a sampled plant from the law's K (6, 15)."""
    full = np.zeros(of.gamma.T.shape)
    full[:, of.seen] = gain[[ROWS.index(row) for row in of.rows]][:, of.columns]
    return full


def closed(of: Sampled, gain: Array) -> Array:
    """One step of the closed loop, phi - gamma K, of the law's K (6, 15)."""
    return of.phi - of.gamma @ feedback(of, gain)


def kind(loop: str) -> str:
    """Whether a loop controls a "speed" or a "position"."""
    return "speed" if loop in ("surge", "sway") else "position"


def law(gains: dict[str, LoopGain], speed_m_s: float) -> Array:
    """The loops as one matrix K (6, 15) of the deviations and integrals, tau = -K x, at a speed ahead: the
    rate of the depth is ``w - u pitch``.
    """
    full = np.zeros((6, len(STATES)))
    for loop, gain in gains.items():
        row = LOOPS.index(loop)
        full[row, HELD[loop]] = gain.k_p
        if loop in INTEGRATED:
            full[row, INTEGRATED[loop][1]] = gain.k_i
        if kind(loop) == "position":
            full[row, RATE[loop]] = gain.k_d
        if loop == "heave":
            full[row, STATES.index("pitch")] -= gain.k_d * speed_m_s
    return full


def restoring_law(vehicle: Vehicle, rows: str) -> Array:
    """The restoring feed-forward at the measured attitude as a law K (6, 15), for roll and pitch near level:
    it takes the hull's righting stiffness away, as late as the actuators are.
    """
    size, full = 1e-5, np.zeros((6, len(STATES)))
    for column in (1, 2):
        attitude = np.zeros((2, 3))
        attitude[:, column - 1] = [size, -size]
        force = np.asarray(vehicle.forces(np.zeros((2, 6)), attitude)["restoring"])
        full[:, column] = (force[0] - force[1]) / (2.0 * size)
    full[[k for k, row in enumerate(ROWS) if row not in rows]] = 0.0
    return full


def with_law(of: Sampled, gain: Array) -> Sampled:
    """The sampled plant with a law K (6, 15) at work in it."""
    return replace(of, phi=closed(of, gain))


def responses(of: Sampled, omega: Array) -> NDArray[np.complex128]:
    """What each row of the wrench moves, (zI - phi)^-1 gamma: (F, seen, rows) at omega (F,) in rad/s."""
    z = np.exp(1j * omega * of.period_s)[:, None, None]
    # All rows at once and by solutions: the poles of a chain of delays are defective.
    moved: NDArray[np.complex128] = np.linalg.solve(
        z * np.eye(len(of.phi)) - of.phi, of.gamma.astype(complex)
    )
    return moved[:, of.seen]


def step_response(of: Sampled, gain: Array, loop: str, seconds: float, *, known: float = 0.0) -> Array:
    """Answer (n,) of a loop's measurement to a unit step of its reference, one sample per period; ``known``
    is the part of the loop's own gain in K that does not act on the reference, of a feed-forward.
    """
    k = feedback(of, gain)
    place = of.seen[of.columns.index(HELD[loop])]
    integral = INTEGRATED.get(loop, (0, -1))[1]
    step, x = of.phi - of.gamma @ k, np.zeros(len(of.phi))
    drive = of.gamma @ (k[:, place] - known * np.eye(len(k))[of.rows.index(ROW_OF[loop])])
    if integral in of.columns:
        drive[of.seen[of.columns.index(integral)]] -= of.period_s
    track = []
    for _ in range(int(seconds / of.period_s)):
        x = step @ x + drive
        track.append(x[place])
    return np.array(track)


def reference_drive(
    of: Sampled, laws: tuple[Array, Array], loop: str, harmonic: tuple[complex, float]
) -> tuple[Array, NDArray[np.complex128]]:
    """Closed loop (state, state) and what a filtered reference e^(s t) of a position loop drives (state,), of
    the ``laws`` K (6, 15) without and with the feed-forward; ``harmonic`` is s in 1/s and the inertia that
    is fed forward.
    """
    s, inertia = harmonic
    own, fed = laws
    row = LOOPS.index(loop)
    column, rate = HELD[loop], RATE[loop]
    # A regulator answers with all of its rows; the acceleration is fed forward in the loop's own.
    rows = [ROWS.index(name) for name in of.rows]
    demand = np.asarray(own[rows, column] + s * own[rows, rate], dtype=complex)
    demand[of.rows.index(ROWS[row])] += s * s * inertia
    drive: NDArray[np.complex128] = of.gamma @ demand
    integral = INTEGRATED.get(loop, (0, -1))[1]
    if integral in of.columns:
        drive[of.seen[of.columns.index(integral)]] -= of.period_s
    return closed(of, fed), drive


def _slope(vehicle: Vehicle, nu: Array, size: Array) -> Array:
    """Slope (6, 6) of damping and lift over a motion of this size about nu."""
    moved = np.concatenate([nu + np.diag(size), nu - np.diag(size)])
    terms = vehicle.forces(moved, np.zeros(3))
    force = np.asarray(terms["damping"]) + np.asarray(terms["lift"])
    slope: Array = ((force[:6] - force[6:]) / (2.0 * size[:, None])).T
    return slope


def _fin_slope(vehicle: Vehicle, nu: Array, motion: float) -> Array:
    """Slope (6, 6) of the wrench of the fins at neutral, over a motion of this size."""
    size = np.full(6, motion)
    force = neutral_fins(vehicle, np.concatenate([nu + np.diag(size), nu - np.diag(size)]))
    slope: Array = ((force[:6] - force[6:]) / (2.0 * size[:, None])).T
    return slope
