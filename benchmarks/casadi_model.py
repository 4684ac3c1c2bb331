"""The CWolf chain as CasADi expressions: what a symbolic tool chain makes of the same model.

One RK4 step of hull and motors is one straight-line expression. What is constant for a candidate (inverse
mass matrix, decay of the lags, thrust per revolution squared) is an expression of its own, and terms whose
coefficient the vehicle does not have are left out: the leanest code that CasADi gives.

Scope: any centre of gravity and inertia, diagonal and off-diagonal derivatives, cross-flow drag by
strips, lift, restoring, constant current, quadratic thrusters with inflow and their whole motor chain.
The static limits and the dead time act on the record, before the step.

Sources: as in ``textbook``; here with cross products in place of matrices.
Held by tests/core/test_casadi_model.py: trajectories equal the textbook model's to 1e-9.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from benchmarks.textbook import FORCES
from benchmarks.textbook_thrusters import Quadratic, Thruster
from benchmarks.textbook_vehicle import LIFT_TERMS, VELOCITIES, Parameters

# Untyped: CasADi's stubs differ between versions and refuse its own idioms.
ca: Any = importlib.import_module("casadi")
Expression: TypeAlias = Any
Symbols: TypeAlias = Mapping[str, Expression]

STATES = 13
CHANNELS = 12
THRUSTER_NAMES = ("gain", "p1_ahead", "p1_astern", "p2", "K_V", "T_1", "T_t")


@dataclass(frozen=True)
class Expressions:
    """Functions of one vehicle and one step length, and the order of the coefficients ``p``.

    ``constants(p)`` is what a candidate keeps; ``step(x, motors, u, tau, v_c, p, constants)`` gives the
    next state and motors from the delayed commands u; ``channels(x)`` gives u v w p q r x y z roll pitch
    yaw.
    """

    names: tuple[str, ...]
    values: np.ndarray[Any, np.dtype[np.float64]]
    thrusters: tuple[Thruster, ...]
    h: float
    constants: Expression
    step: Expression
    channels: Expression


def coefficient_values(parameters: Parameters) -> dict[str, float]:
    """Return the flat coefficients that are not zero, those of the thrusters included (SI)."""
    values = {k: float(v) for k, v in parameters.coefficients.items() if v != 0.0 and "." not in k}
    for thruster in parameters.thrusters:
        own = {**vars(thruster), **vars(thruster.characteristic)}
        values |= {f"{thruster.name}.{k}": float(own[k]) for k in THRUSTER_NAMES if own[k] != 0.0}
    return values


def expressions(
    parameters: Parameters, h: float, *, motors: bool = True, current: bool = False, hoisted: bool = True
) -> Expressions:
    """Return the expressions of a vehicle for steps of a fixed length.

    Parameters
    ----------
    parameters : Parameters
    h : float
        Step in s.
    motors : bool
        With the actuators; otherwise the direct wrench alone drives the hull.
    current : bool
        With an ocean current, constant in NED.
    hoisted : bool
        Keep what a candidate's coefficients alone determine; otherwise every step computes it again, as
        CasADi's own integrators do.

    Raises
    ------
    ValueError
        A thruster's characteristic is not the quadratic one.
    """
    thrusters = tuple(parameters.thrusters) if motors else ()
    for thruster in thrusters:
        if not isinstance(thruster.characteristic, Quadratic):
            raise ValueError(f"{thruster.name}: expected a quadratic characteristic")
    values = coefficient_values(Parameters(parameters.coefficients, thrusters))
    p = {name: ca.SX.sym(name) for name in values}
    lasting = lasting_expressions(p, thrusters, h)
    kept = {name: ca.SX.sym(name, value.sparsity()) for name, value in lasting.items()} if hoisted else {}
    x, motor = ca.SX.sym("x", STATES), ca.SX.sym("motor", 2 * len(thrusters))
    u, tau, v_c = ca.SX.sym("u", len(thrusters)), ca.SX.sym("tau", 6), ca.SX.sym("v_c", 3)
    hull = Hull(p, kept or lasting, thrusters, parameters, v_c if current else None)
    pack = [ca.vertcat(*p.values()), nonzeros(kept)]
    packed = nonzeros(lasting) if hoisted else ca.SX(0, 1)
    return Expressions(
        names=tuple(values),
        values=np.array(list(values.values())),
        thrusters=thrusters,
        h=h,
        constants=ca.Function("model_constants", [pack[0]], ca.cse([packed])),
        step=ca.Function(
            "model_step", [x, motor, u, tau, v_c, *pack], ca.cse(step(hull, x, motor, u, tau, h))
        ),
        channels=ca.Function("model_channels", [x], ca.cse([channels(x)])),
    )


def nonzeros(matrices: Symbols) -> Expression:
    """Return the entries of all matrices that are not zero by structure, in one column."""
    return ca.vertcat(*(entry for value in matrices.values() for entry in value.nonzeros()))


def lasting_expressions(p: Symbols, thrusters: tuple[Thruster, ...], h: float) -> dict[str, Expression]:
    """Return what the coefficients alone determine: inverse of M, constants of thrust and lag."""
    mass = rigid_body_mass(p) + added_mass(p)
    diagonal = mass.sparsity().is_diag()
    lasting = {"inverse": ca.diag(1.0 / ca.diag(mass)) if diagonal else ca.inv(mass)}
    for t in thrusters:
        own = {name: p.get(f"{t.name}.{name}", ca.SX(0.0)) for name in THRUSTER_NAMES}
        factor = own["gain"] * (1.0 - t.thrust_deduction)
        lasting[f"{t.name}.ahead"] = factor * own["p1_ahead"] / 3600.0
        lasting[f"{t.name}.astern"] = factor * own["p1_astern"] / 3600.0
        if t.characteristic.p2 != 0.0:  # type: ignore[union-attr]
            lasting[f"{t.name}.inflow"] = factor * own["p2"] * (1.0 - t.wake) / 60.0
        decay = ca.exp(-0.5 * h / own["T_1"]) if t.T_1 > 0.0 else ca.SX(0.0)
        lasting[f"{t.name}.decay"] = decay
        lasting[f"{t.name}.held"] = own["K_V"] * (1.0 - decay)
        lasting[f"{t.name}.ramped"] = own["K_V"] * (1.0 - own["T_1"] / (0.5 * h) * (1.0 - decay))
    return lasting


def matrix(p: Symbols, name: str, sign: float) -> Expression:
    """Return the sparse 6x6 of the derivatives ``name`` (a format of force and velocity) times ``sign``."""
    result = ca.SX(6, 6)
    for i, force in enumerate(FORCES):
        for j, velocity in enumerate(VELOCITIES):
            if (key := name.format(i=force, j=velocity)) in p:
                result[i, j] = sign * p[key]
    return result


def added_mass(p: Symbols) -> Expression:
    """Return M_A (6,6), sparse."""
    result = matrix(p, "{i}_{j}dot", -1.0)
    for i in range(6):
        for j in range(6):
            if result.has_nz(i, j) and not result.has_nz(j, i):
                result[j, i] = result[i, j]
    return result


def lever(p: Symbols, axis: str) -> Expression:
    """Return the sparse vector x_axis, y_axis, z_axis in m."""
    result = ca.SX(3, 1)
    for i, name in enumerate("xyz"):
        if f"{name}_{axis}" in p:
            result[i] = p[f"{name}_{axis}"]
    return result


def inertia(p: Symbols) -> Expression:
    """Return I_O (3,3), sparse."""
    result = ca.diag(ca.vertcat(p["I_x"], p["I_y"], p["I_z"]))
    for (i, j), name in {(0, 1): "I_xy", (0, 2): "I_xz", (1, 2): "I_yz"}.items():
        if name in p:
            result[i, j] = result[j, i] = -p[name]
    return result


def rigid_body_mass(p: Symbols) -> Expression:
    """Return M_RB (6,6), sparse."""
    S = ca.sparsify(p["m"] * ca.skew(ca.densify(lever(p, "g"))))
    return ca.sparsify(ca.blockcat([[p["m"] * ca.SX.eye(3), -S], [S, inertia(p)]]))


class Hull:
    """The equation of motion with the coefficients ``p`` and the constants ``c``."""

    def __init__(
        self,
        p: Symbols,
        c: Symbols,
        thrusters: tuple[Thruster, ...],
        parameters: Parameters,
        v_c: Expression | None,
    ) -> None:
        self.p, self.c, self.thrusters, self.v_c = p, c, thrusters, v_c
        self.W, self.B = p["m"] * parameters.g, p.get("B", 0.0)
        self.r_g, self.r_b, self.I_O = lever(p, "g"), lever(p, "b"), inertia(p)
        self.M_A = added_mass(p)
        self.D_l, self.D_q = matrix(p, "{i}_{j}", -1.0), matrix(p, "{i}_{j}{j}", -1.0)
        self.L = matrix({k: v for k, v in p.items() if k in LIFT_TERMS}, "{i}_u{j}", 1.0)
        self.strips, self.rho = parameters.strips, parameters.rho
        self.bias = ca.vertcat(*(p.get(f"{force}_0", 0.0) for force in FORCES))

    def rate(self, x: Expression, n: Expression, tau: Expression) -> Expression:
        """Return x' at the revolutions ``n`` and the direct wrench ``tau``."""
        q, nu = x[3:7], x[7:]
        v, omega = nu[:3], nu[3:]
        R = rotation(q)
        zero = ca.SX(3, 1)
        f = tau + self.bias - self.rigid_body(v, omega)
        nu_r = nu
        if self.v_c is not None:
            v_cb = ca.mtimes(R.T, self.v_c)
            nu_r = nu - ca.vertcat(v_cb, zero)
            f += ca.mtimes(self.M_A, ca.vertcat(ca.cross(v_cb, omega), zero))
        momentum = ca.mtimes(self.M_A, nu_r)
        turning = ca.cross(omega, momentum[3:]) + ca.cross(nu_r[:3], momentum[:3])
        f -= ca.vertcat(ca.cross(omega, momentum[:3]), turning)
        f -= ca.mtimes(self.D_l + ca.mtimes(self.D_q, ca.diag(ca.fabs(nu_r))), nu_r)
        f += ca.fabs(nu_r[0]) * ca.mtimes(self.L, nu_r)
        if "C_Dy" in self.p or "C_Dz" in self.p:
            f -= self.cross_flow(nu_r)
        down = R[2, :].T
        f += ca.vertcat((self.W - self.B) * down, ca.cross(self.r_g * self.W - self.r_b * self.B, down))
        for i, t in enumerate(self.thrusters):
            f += ca.SX(ca.sparsify(ca.DM(t.wrench))) * self.thrust(t, n[i], nu_r)
        nu_rate = ca.mtimes(self.c["inverse"], f)
        return ca.vertcat(ca.mtimes(R, v), quaternion_rate(q, omega), nu_rate)

    def rigid_body(self, v: Expression, omega: Expression) -> Expression:
        """Return C_RB(nu) nu by Newton and Euler."""
        m, turning = self.p["m"], ca.cross(omega, v)
        force = m * turning
        moment = ca.cross(omega, ca.mtimes(self.I_O, omega))
        if self.r_g.nnz():
            force += m * ca.cross(omega, ca.cross(omega, self.r_g))
            moment += m * ca.cross(self.r_g, turning)
        return ca.vertcat(force, moment)

    def cross_flow(self, nu_r: Expression) -> Expression:
        """Return the drag of the strips, against the motion."""
        x, side, above = (ca.DM(row) for row in self.strips)
        across, down = nu_r[1] + x * nu_r[5], nu_r[2] - x * nu_r[4]
        sway = 0.5 * self.rho * self.p.get("C_Dy", 0.0) * side * ca.fabs(across) * across
        heave = 0.5 * self.rho * self.p.get("C_Dz", 0.0) * above * ca.fabs(down) * down
        return ca.vertcat(0.0, ca.sum1(sway), ca.sum1(heave), 0.0, -ca.dot(x, heave), ca.dot(x, sway))

    def thrust(self, t: Thruster, n: Expression, nu_r: Expression) -> Expression:
        """Return the thrust in N at ``n`` rpm."""
        p1 = ca.if_else(n < 0.0, self.c[f"{t.name}.astern"], self.c[f"{t.name}.ahead"])
        thrust = p1 * n
        if f"{t.name}.inflow" in self.c:
            thrust += self.c[f"{t.name}.inflow"] * ca.dot(ca.SX(ca.sparsify(ca.DM(t.wrench))), nu_r)
        return ca.fabs(n) * thrust


def rotation(q: Expression) -> Expression:
    """Return R (3,3), body to NED."""
    w, x, y, z = (q[i] for i in range(4))
    return ca.blockcat([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


def quaternion_rate(q: Expression, omega: Expression) -> Expression:
    """Return q' (4,)."""
    w, e = 0.5 * q[0], 0.5 * q[1:]
    return ca.vertcat(-ca.dot(e, omega), w * omega + ca.cross(e, omega))


def motor_half_step(hull: Hull, motor: Expression, u: Expression, half: float) -> Expression:
    """Return ramps and revolutions [ramp, n, ramp, n ...] ``half`` s later under delayed commands ``u``."""
    result = []
    for i, t in enumerate(hull.thrusters):
        ramp, n, target = motor[2 * i], motor[2 * i + 1], u[i]
        if np.isinf(t.n_acc) and np.isinf(t.n_dec):
            start = ramp_next = target
        else:
            start, ramp_next = ramp, rate_limited(ramp, target, t.n_acc * half, t.n_dec * half)
        c = {name: hull.c[f"{t.name}.{name}"] for name in ("decay", "held", "ramped")}
        result += [ramp_next, c["decay"] * n + c["held"] * start + c["ramped"] * (ramp_next - start)]
    return ca.vertcat(*result)


def rate_limited(ramp: Expression, target: Expression, growth: float, shrink: float) -> Expression:
    """Return the ramp after one interval in which |n| may grow by ``growth`` or shrink by ``shrink``."""
    side = ca.if_else(ramp < 0.0, -1.0, 1.0)
    size, wanted = side * ramp, side * target
    braked = size - shrink
    reversed_ = ca.fmax(wanted, ca.fmin(braked * (growth / shrink), 0.0))
    falling = ca.fmax(ca.if_else(wanted < 0.0, ca.if_else(braked < 0.0, reversed_, braked), wanted), braked)
    falling = ca.if_else(ca.logic_and(wanted < 0.0, braked < 0.0), reversed_, falling)
    return side * ca.if_else(size < wanted, ca.fmin(wanted, size + growth), falling)


def step(
    hull: Hull, x: Expression, motor: Expression, u: Expression, tau: Expression, h: float
) -> list[Expression]:
    """Return state and motors one RK4 step of ``h`` s later, the quaternion of unit length again."""
    middle = motor_half_step(hull, motor, u, h / 2)
    end = motor_half_step(hull, middle, u, h / 2)
    k1 = hull.rate(x, motor[1::2], tau)
    k2 = hull.rate(x + h / 2 * k1, middle[1::2], tau)
    k3 = hull.rate(x + h / 2 * k2, middle[1::2], tau)
    k4 = hull.rate(x + h * k3, end[1::2], tau)
    x = x + h / 6 * (k1 + 2 * (k2 + k3) + k4)
    return [ca.vertcat(x[:3], x[3:7] / ca.norm_2(x[3:7]), x[7:]), end]


def channels(x: Expression) -> Expression:
    """Return u v w p q r x y z roll pitch yaw (12,), SI."""
    R = rotation(x[3:7])
    roll = ca.atan2(R[2, 1], R[2, 2])
    pitch = ca.atan2(-R[2, 0], ca.sqrt(R[2, 1] ** 2 + R[2, 2] ** 2))
    return ca.vertcat(x[7:], x[:3], roll, pitch, ca.atan2(R[1, 0], R[0, 0]))
