"""The 6-DOF model of an underwater vehicle in plain NumPy, as a reader of the textbook writes it.

    (M_RB + M_A) nu' = tau - C_RB(nu) nu - C_A(nu_r) nu_r - D(nu_r) nu_r + tau_L(nu_r) - g + M_A nu_c'

Independent of the compiled core on purpose: the tests compare the two, and the benchmarks take this one
as the baseline. Matrices that depend on the state are built in every evaluation, as printed; the constant
ones are kept. ``textbook_vehicle.build`` makes the ``Model`` from flat coefficients.

Conventions: NED earth frame n, body frame b with origin O (x forward, y starboard, z down), SI, radians.
``R`` maps body to earth, ``skew(a) @ b = a x b``, ``nu = [u v w p q r]``, ``tau = [X Y Z K M N]``,
quaternions ``[w x y z]`` body to NED. Coefficients carry Fossen's names and signs: derivatives of the force
on the vehicle.

References: T. I. Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control (2011), chapters 2, 3, 6
and 7; numbers in brackets are equations of Taubert et al., OCEANS 2014 Taipei,
doi 10.1109/OCEANS-TAIPEI.2014.6964475.
Held by tests/core/test_textbook.py (published numbers, conservation laws).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmarks.textbook_fins import Fin, fin_wrench
from benchmarks.textbook_kinematics import quaternion_rate, rotation, skew
from benchmarks.textbook_thrusters import Thruster, at_half_steps, force_and_torque, motor_response

Array: TypeAlias = NDArray[np.float64]

FORCES = "XYZKMN"
# Coasting down into denormal numbers is a hundred times slower than computing.
SMALLEST = 1e-30
# Places (m), areas seen from the side and from above (m2) of the hull's strips, as rows (3,n).
Strips: TypeAlias = Array
NO_STRIPS: Strips = np.zeros((3, 0))


@dataclass(frozen=True)
class Model:
    """Constant matrices and vectors of one vehicle in one water (body frame, about O, SI)."""

    m: float
    r_g: Array
    r_b: Array
    I_O: Array
    M_RB: Array
    M_A: Array
    D_l: Array
    D_q: Array
    L: Array
    W: float
    B: float
    bias: Array
    thrusters: tuple[Thruster, ...]
    # Ratio of the water's density to the one that the coefficients hold for: it scales the thrusts.
    density_ratio: float
    rho: float = 1025.0
    fins: tuple[Fin, ...] = ()
    strips: Strips = field(default_factory=lambda: NO_STRIPS)
    # Half the density times the cross-flow drag coefficient, sideways and downwards.
    cross_flow: tuple[float, float] = (0.0, 0.0)
    M: Array = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "M", self.M_RB + self.M_A)

    @property
    def drives(self) -> tuple[Thruster, ...]:
        """Motors of the thrusters, then servos of the fins: the order of commands and actual values."""
        return (*self.thrusters, *(fin.servo for fin in self.fins))


@dataclass(frozen=True)
class Trajectory:
    """A simulated run on the command grid: ``t`` (n,) s, ``position`` (n,3) NED m, ``attitude`` (n,4),
    ``nu`` (n,6) body, ``actuators`` {name: (n,)} in their own unit, ``tau`` (n,6) of thrusters and direct
    wrench in the body frame, N and N m."""

    t: Array
    position: Array
    attitude: Array
    nu: Array
    actuators: dict[str, Array]
    tau: Array


def blocks(upper_left: Array, upper_right: Array, lower_left: Array, lower_right: Array) -> Array:
    """Return the matrix (6,6) of four blocks (3,3)."""
    result = np.empty((6, 6))
    result[:3, :3], result[:3, 3:] = upper_left, upper_right
    result[3:, :3], result[3:, 3:] = lower_left, lower_right
    return result


def rigid_body_mass(m: float, r_g: Array, I_O: Array) -> Array:
    """Return M_RB (6,6) of (8), about O."""
    return blocks(m * np.eye(3), -m * skew(r_g), m * skew(r_g), I_O)


def rigid_body_coriolis(nu: Array, m: float, r_g: Array, I_O: Array) -> Array:
    """Return C_RB(nu) (6,6) of (21), skew-symmetric, about O."""
    v, omega = nu[:3], nu[3:]
    upper_right = -m * skew(v) - m * skew(omega) @ skew(r_g)
    lower_left = -m * skew(v) + m * skew(r_g) @ skew(omega)
    return blocks(np.zeros((3, 3)), upper_right, lower_left, -skew(I_O @ omega))


def added_mass_coriolis(nu_r: Array, M_A: Array) -> Array:
    """Return C_A(nu_r) (6,6) of any symmetric M_A; (22) when M_A is diagonal."""
    v, omega = nu_r[:3], nu_r[3:]
    linear = skew(M_A[:3, :3] @ v + M_A[:3, 3:] @ omega)
    angular = skew(M_A[3:, :3] @ v + M_A[3:, 3:] @ omega)
    return blocks(np.zeros((3, 3)), -linear, -linear, -angular)


def damping(nu_r: Array, D_l: Array, D_q: Array) -> Array:
    """Return D(nu_r) (6,6) of (23): the force on the vehicle is -D nu_r."""
    return np.asarray(D_l + D_q * np.abs(nu_r))


def cross_flow(nu_r: Array, strips: Strips, pressure: tuple[float, float]) -> Array:
    """Return the wrench (6,) of the cross-flow drag on the strips, body frame (N, N m)."""
    x, side, above = strips
    _, v, w, _, q, r = nu_r
    across, down = v + x * r, w - x * q
    sway, heave = -pressure[0] * side * abs(across) * across, -pressure[1] * above * abs(down) * down
    return np.array([0.0, sway.sum(), heave.sum(), 0.0, -(x @ heave), x @ sway])


def restoring(R: Array, model: Model) -> Array:
    """Return g (6,) of (32), left-hand side: the wrench on the vehicle is -g (body frame, N and N m)."""
    f_G = R.T @ np.array([0.0, 0.0, model.W])
    f_B = -R.T @ np.array([0.0, 0.0, model.B])
    return np.asarray(-np.concatenate([f_G + f_B, skew(model.r_g) @ f_G + skew(model.r_b) @ f_B]))


def current_in_body(R: Array, omega: Array, v_c: Array, v_c_rate: Array) -> tuple[Array, Array]:
    """Return nu_c and nu_c' (6,), body frame, of a uniform current and its rate in NED (m/s, m/s2)."""
    v_cb = R.T @ v_c
    zero = np.zeros(3)
    return np.concatenate([v_cb, zero]), np.concatenate([-skew(omega) @ v_cb + R.T @ v_c_rate, zero])


def forces(
    model: Model,
    nu: Array,
    R: Array,
    *,
    v_c: ArrayLike = (0.0, 0.0, 0.0),
    v_c_rate: ArrayLike = (0.0, 0.0, 0.0),
) -> dict[str, Array]:
    """Return the wrenches (6,) on the vehicle, body frame (N, N m), by origin; their sum + tau = M nu'."""
    v_c, v_c_rate = np.asarray(v_c, dtype=float), np.asarray(v_c_rate, dtype=float)
    nu_c, nu_c_rate = current_in_body(R, nu[3:], v_c, v_c_rate)
    nu_r = nu - nu_c
    return {
        "rigid_body": -rigid_body_coriolis(nu, model.m, model.r_g, model.I_O) @ nu,
        "added_mass": -added_mass_coriolis(nu_r, model.M_A) @ nu_r + model.M_A @ nu_c_rate,
        "damping": cross_flow(nu_r, model.strips, model.cross_flow)
        - damping(nu_r, model.D_l, model.D_q) @ nu_r,
        "lift": abs(nu_r[0]) * (model.L @ nu_r),
        "restoring": -restoring(R, model),
        "bias": model.bias,
    }


def acceleration(
    model: Model,
    nu: ArrayLike,
    q: ArrayLike,
    tau: ArrayLike,
    *,
    v_c: ArrayLike = (0.0, 0.0, 0.0),
    v_c_rate: ArrayLike = (0.0, 0.0, 0.0),
    free: str = FORCES,
    nu_rate: ArrayLike | None = None,
) -> Array:
    """Return nu' (6,) in the body frame (m/s2, rad/s2) at quaternion ``q`` under the wrench ``tau``.

    Axes that are not in ``free`` accelerate by ``nu_rate`` (zero where not given): the reduced system
    nu'_F = M_FF^-1 (f_F - M_FC nu'_C).
    """
    nu = np.asarray(nu, dtype=float)
    on_vehicle = forces(model, nu, rotation(q), v_c=v_c, v_c_rate=v_c_rate)
    f = np.asarray(tau, dtype=float) + sum(on_vehicle.values())
    result = np.zeros(6) if nu_rate is None else np.array(nu_rate, dtype=float)
    F = [i for i in range(6) if FORCES[i] in free]
    C = [i for i in range(6) if FORCES[i] not in free]
    if F:
        result[F] = np.linalg.solve(model.M[np.ix_(F, F)], f[F] - model.M[np.ix_(F, C)] @ result[C])
    return result


def actuator_wrench(model: Model, nu_r: Array, actual: ArrayLike, voltage: float | None) -> Array:
    """Return tau (6,) of thrusters and fins, body frame (N, N m), at their ``actual`` values (own units).

    The wash of the other groups takes ``loss`` of a thrust per newton that they push without inflow.
    """
    every = [float(value) for value in np.asarray(actual, dtype=float)]
    values, deflections = every[: len(model.thrusters)], every[len(model.thrusters) :]

    def pushed(thruster: Thruster, value: float, inflow: float) -> tuple[float, float]:
        ratio = model.density_ratio
        return force_and_torque(thruster, value, inflow=inflow, voltage=voltage, density_ratio=ratio)

    still = [abs(pushed(t, value, 0.0)[0]) for t, value in zip(model.thrusters, values, strict=True)]
    tau = np.zeros(6)
    for thruster, value in zip(model.thrusters, values, strict=True):
        thrust, torque = pushed(thruster, value, thruster.inflow(nu_r))
        others = sum(
            size for t, size in zip(model.thrusters, still, strict=True) if t.group != thruster.group
        )
        left = max(1.0 - thruster.loss * others, 0.0)
        tau += left * thruster.wrench * thrust
        tau[3:] += left * thruster.direction * torque
    for fin, value in zip(model.fins, deflections, strict=True):
        tau += fin_wrench(fin, float(fin.servo.signal(value)), nu_r, model.rho)
    return tau


def simulate(
    model: Model,
    t: ArrayLike,
    commands: Mapping[str, ArrayLike],
    *,
    position: ArrayLike = (0.0, 0.0, 0.0),
    attitude: ArrayLike = (1.0, 0.0, 0.0, 0.0),
    nu: ArrayLike = (0.0,) * 6,
    actuators: Mapping[str, float] | None = None,
    measured_actuators: Mapping[str, ArrayLike] | None = None,
    current: ArrayLike = (0.0, 0.0, 0.0),
    free: str = FORCES,
    tau: ArrayLike | None = None,
    voltage: ArrayLike | None = None,
    measured: Mapping[str, tuple[ArrayLike, ArrayLike]] | None = None,
    substeps: int = 1,
) -> Trajectory:
    """Return the motion by RK4 under commands and direct wrench that are held from sample to sample.

    Parameters
    ----------
    model : Model
    t : (n,)
        Uniform time in s.
    commands : {name: (n,)}
        In the thruster's own unit; neutral where absent.
    position, attitude, nu : (3,), (4,), (6,)
        Initial state: NED m, unit quaternion body to NED, body velocities m/s and rad/s.
    actuators : {name: float}, optional
        Initial actual values, neutral where absent.
    measured_actuators : {name: (n,)}, optional
        Actual values that replace the motor chain, between samples linearly.
    current : (3,) or (n, 3)
        Of the water, NED m/s, between samples linearly.
    free : str
        The axes that move freely; the others keep their initial velocity, or follow ``measured``.
    tau : (n, 6), optional
        Direct wrench, body frame, added to the thrusters'.
    voltage : (n,), optional
        Supply voltage in V, held from sample to sample.
    measured : {axis: (nu, nu')}, optional
        Velocity and its rate of replayed axes on the grid of half steps (2 substeps (n - 1) + 1,).
    substeps : int
        Steps of RK4 between two samples.
    """
    t = np.asarray(t, dtype=float)
    n, dt = len(t), float(t[1] - t[0])
    h = dt / substeps
    names = [thruster.name for thruster in model.drives]
    u = np.empty((2 * substeps * (n - 1) + 1, len(names)))
    jumps: dict[int, Array] = {}
    for i, thruster in enumerate(model.drives):
        if measured_actuators is not None and thruster.name in measured_actuators:
            u[:, i] = at_half_steps(measured_actuators[thruster.name], substeps)
            continue
        command = np.asarray(commands.get(thruster.name, np.full(n, thruster.neutral)), dtype=float)
        initial = (actuators or {}).get(thruster.name)
        # One sample more, for the jump of an ideal motor at the last one.
        longer = np.append(command, command[-1])
        response = motor_response(thruster, longer, dt, substeps=substeps, initial=initial)
        u[:, i] = response[: len(u)]
        if thruster.ideal:
            jumps[i] = response[1 : len(u) + 1 : 2]
    # At the start of a step an ideal motor has the value of the step, at its end still that value.
    u_start = u[::2].copy()
    for i, values in jumps.items():
        u_start[:, i] = values
    v_c = np.broadcast_to(np.asarray(current, dtype=float), (n, 3))
    v_c_half, v_c_rates = at_half_steps(v_c, substeps), np.diff(v_c, axis=0) / dt
    outside = np.zeros((n, 6)) if tau is None else np.asarray(tau, dtype=float)
    replayed = {FORCES.index(axis): np.asarray(pair, dtype=float) for axis, pair in (measured or {}).items()}

    def supply(k: int) -> float | None:
        return None if voltage is None else float(np.asarray(voltage)[k])

    def replay(x: Array, half: int) -> Array:
        x = x.copy()
        for axis, (velocity, _) in replayed.items():
            x[7 + axis] = velocity[half]
        return x

    def wrench(x: Array, k: int, half: int, signals: Array) -> Array:
        nu_c, _ = current_in_body(rotation(x[3:7]), x[10:], v_c_half[half], np.zeros(3))
        acting: Array = outside[k] + actuator_wrench(model, x[7:] - nu_c, signals, supply(k))
        return acting

    def rate(x: Array, k: int, half: int, signals: Array) -> Array:
        x = replay(x, half)
        q, velocity = x[3:7], x[7:]
        given = np.zeros(6)
        for axis, (_, slope) in replayed.items():
            given[axis] = slope[half]
        nu_rate = acceleration(
            model,
            velocity,
            q,
            wrench(x, k, half, signals),
            v_c=v_c_half[half],
            v_c_rate=v_c_rates[k],
            free=free,
            nu_rate=given,
        )
        position_rate: Array = rotation(q) @ velocity[:3]
        rates: Array = np.concatenate([position_rate, quaternion_rate(q, velocity[3:]), nu_rate])
        return rates

    x = replay(np.concatenate([position, attitude, nu]).astype(float), 0)
    states, wrenches = [x], []
    for k in range(n - 1):
        wrenches.append(wrench(x, k, 2 * substeps * k, u_start[substeps * k]))
        for half in range(2 * substeps * k, 2 * substeps * (k + 1), 2):
            k1 = rate(x, k, half, u_start[half // 2])
            k2 = rate(x + h / 2 * k1, k, half + 1, u[half + 1])
            k3 = rate(x + h / 2 * k2, k, half + 1, u[half + 1])
            k4 = rate(x + h * k3, k, half + 2, u[half + 2])
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            x[3:7] /= np.linalg.norm(x[3:7])
            x[np.abs(x) < SMALLEST] = 0.0
            x = replay(x, half + 2)
        states.append(x)
    wrenches.append(wrench(x, n - 1, len(u) - 1, u_start[-1]))
    run = np.array(states)
    return Trajectory(
        t=t,
        position=run[:, :3],
        attitude=run[:, 3:7],
        nu=run[:, 7:],
        actuators={name: u_start[::substeps, i] for i, name in enumerate(names)},
        tau=np.array(wrenches),
    )
