"""The actuator chain of the textbook model, NumPy only: command -> limits -> rate limit -> dead time -> lag
-> characteristic -> force.

All of the chain up to the actual revolutions is independent of the hull, so it runs first, over a whole
record, on the grid of half steps that RK4 visits. The delay comes behind the rate limit, where there is one,
and reads its ramp linearly between the half steps; else it comes first, which a pure delay allows.

Source: Taubert et al., OCEANS 2014 Taipei, static and dynamic behaviour, (34), (35), (36).
Held by tests/core/test_textbook_thrusters.py.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Quadratic:
    """F = p1 |n| n + p2 |n| V_a (35), n in rev/s; torque about the direction q1 |n| n + q2 |n| V_a."""

    p1_ahead: float
    p1_astern: float
    p2: float = 0.0
    q1: float = 0.0
    q2: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Polynomial:
    """|F| = a0 + a1 |n| + a11 |n|^2 (36), one set per direction, n in the own unit; F = 0 at n = 0.

    Inflow and torque as in `Quadratic`, where the own unit is rpm.
    """

    ahead: tuple[float, float, float]
    astern: tuple[float, float, float]
    p2: float = 0.0
    q1: float = 0.0
    q2: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Table:
    """Force (v, s) in N over ``voltage`` (v,) and ``signal`` (s,): bilinear, held beyond the edges.

    A table of one supply voltage has an empty ``voltage`` and one row.
    """

    signal: Array
    voltage: Array
    force: Array


@dataclass(frozen=True, kw_only=True)
class Newton:
    """The command is the force itself, in newtons."""


Characteristic: TypeAlias = Quadratic | Polynomial | Table | Newton


@dataclass(frozen=True, kw_only=True)
class Thruster:
    """One thruster: limits and motor in its own unit and s, wrench per newton in the body frame.

    A signal is the distance of a command from neutral, positive ahead; where ``reversed``, a command above
    neutral is astern.
    """

    name: str
    wrench: Array
    characteristic: Characteristic
    unit: Literal["rpm", "us", "N", "rad"] = "rpm"
    neutral: float = 0.0
    reversed: bool = False
    maximum_ahead: float = np.inf
    maximum_astern: float = np.inf
    minimum_ahead: float = 0.0
    minimum_astern: float = 0.0
    below_minimum: Literal["lift", "zero"] = "lift"
    n_acc: float = np.inf
    n_dec: float = np.inf
    K_V: float = 1.0
    T_1: float = 0.0
    T_t: float = 0.0
    gain: float = 1.0
    wake: float = 0.0
    thrust_deduction: float = 0.0
    astern_ratio: float = 1.0
    loss: float = 0.0
    group: str = ""
    # Of a force of one newton along d, and d itself; zero where the wrench has no force.
    unit_wrench: Array = field(init=False)
    direction: Array = field(init=False)

    def __post_init__(self) -> None:
        length = float(np.linalg.norm(self.wrench[:3]))
        unit = self.wrench / length if length > 0.0 else np.zeros(6)
        object.__setattr__(self, "unit_wrench", unit)
        object.__setattr__(self, "direction", unit[:3])

    @property
    def ideal(self) -> bool:
        """Whether the actual value jumps with the command: neither rate limit nor lag."""
        return self.T_1 == 0.0 and bool(np.isinf(self.n_acc) and np.isinf(self.n_dec))

    def inflow(self, nu_r: Array) -> float:
        """Return u_a = d . (v_r + omega x r) in m/s: by virtual power, wrench of a unit force times nu_r."""
        return float(self.unit_wrench @ nu_r)

    def signal(self, command: ArrayLike) -> Array:
        """Return the signals of commands, in the own unit."""
        distance = np.asarray(command, dtype=float) - self.neutral
        return -distance if self.reversed else distance

    def command(self, signal: ArrayLike) -> Array:
        """Return the commands of signals, in the own unit."""
        distance = np.asarray(signal, dtype=float)
        return self.neutral + (-distance if self.reversed else distance)


def wrench_per_newton(position: ArrayLike, direction: ArrayLike) -> Array:
    """Return [d; r x d] (6,) of a thruster at ``position`` (m) along the unit ``direction``, body frame."""
    d = np.asarray(direction, dtype=float)
    return np.concatenate([d, np.cross(np.asarray(position, dtype=float), d)])


def static_limits(thruster: Thruster, command: ArrayLike) -> Array:
    """Return the signals (n,) that the motor controller asks for, in the own unit."""
    n = thruster.signal(command)
    lowest = np.where(n > 0.0, thruster.minimum_ahead, thruster.minimum_astern)
    highest = np.where(n > 0.0, thruster.maximum_ahead, thruster.maximum_astern)
    size = np.abs(n)
    below = lowest if thruster.below_minimum == "lift" else np.zeros_like(lowest)
    size = np.where((size > 0.0) & (size < lowest), below, np.minimum(size, highest))
    return np.asarray(np.sign(n) * size)


def delayed(held: Array, steps: float, before: float) -> Array:
    """Return ``held`` (n,) delayed by ``steps`` of its grid, linear between samples, after ``before``."""
    whole = int(np.floor(steps))
    part = steps - whole
    history = np.concatenate([np.full(whole + 1, before), held])
    n = len(held)
    return np.asarray((1.0 - part) * history[1 : n + 1] + part * history[:n])


def rate_limited(r: float, target: float, h: float, n_acc: float, n_dec: float) -> float:
    """Return the rate-limited command ``h`` seconds after ``r``, heading for ``target`` (unit/s limits).

    |n| grows by n_acc and shrinks by n_dec; a reversal brakes to 0 first and grows in the time that is left.
    """
    if r * target < 0.0:
        braking = abs(r) / n_dec
        if braking >= h:
            return float(r - np.sign(r) * n_dec * h)
        r, h = 0.0, h - braking
    if abs(target) >= abs(r):
        size = min(abs(target), abs(r) + n_acc * h)
    else:
        size = max(abs(target), abs(r) - n_dec * h)
    return float(np.sign(target if target != 0.0 else r) * size)


def lag(n: float, u: float, u_next: float, h: float, K_V: float, T_1: float) -> float:
    """Return n(t + h) of T_1 n' + n = K_V u, exact for u that runs linearly from ``u`` to ``u_next`` (34)."""
    a = np.exp(-h / T_1) if T_1 > 0.0 else 0.0
    return float(a * n + K_V * ((1.0 - a) * u + (1.0 - (T_1 / h) * (1.0 - a)) * (u_next - u)))


def motor_response(
    thruster: Thruster, command: ArrayLike, dt: float, *, substeps: int = 1, initial: float | None = None
) -> Array:
    """Return the actual value (2 substeps (n - 1) + 1,) in the own unit, half steps apart.

    Parameters
    ----------
    thruster : Thruster
    command : (n,)
        Recorded command in the own unit, held from sample to sample ``dt`` (s) apart.
    dt : float
        Sampling time of the record in s.
    substeps : int
        Steps of RK4 between two samples.
    initial : float, optional
        Actual value at the first sample; the command before the record is the one that holds it. Neutral by
        default.
    """
    h = dt / substeps
    n = 0.0 if initial is None else float(thruster.signal(initial))
    r = n / thruster.K_V
    held = np.repeat(static_limits(thruster, command)[:-1], substeps)
    if np.isinf(thruster.n_acc) and np.isinf(thruster.n_dec):
        # The lag sees the held command itself, not a ramp towards it.
        starts = ends = np.repeat(delayed(held, thruster.T_t / h, r), 2)
    else:
        ramp = [r]
        for target in np.repeat(held, 2):
            ramp.append(rate_limited(ramp[-1], target, h / 2, thruster.n_acc, thruster.n_dec))
        late = delayed(np.array(ramp), thruster.T_t / (h / 2), r)
        starts, ends = late[:-1], late[1:]
    response = [n]
    for u, u_next in zip(starts, ends, strict=True):
        response.append(lag(response[-1], u, u_next, h / 2, thruster.K_V, thruster.T_1))
    return thruster.command(response)


def at_half_steps(samples: ArrayLike, substeps: int) -> Array:
    """Return ``samples`` (n, ...) linearly on the grid of half steps (2 substeps (n - 1) + 1, ...)."""
    x = np.asarray(samples, dtype=float)
    part = np.arange(2 * substeps).reshape(-1, *[1] * (x.ndim - 1)) / (2 * substeps)
    between = x[:-1, None] + part * (x[1:, None] - x[:-1, None])
    return np.concatenate([between.reshape(-1, *x.shape[1:]), x[-1:]])


def thrust(characteristic: Characteristic, signal: float, *, V_a: float, voltage: float | None) -> float:
    """Return the thrust (N) along the axis at the actual ``signal`` (own unit), before gain and deduction.

    Raises
    ------
    ValueError
        A table of several supply voltages is used without a voltage.
    """
    if isinstance(characteristic, Quadratic):
        n = signal / 60.0
        p1 = characteristic.p1_ahead if n > 0.0 else characteristic.p1_astern
        return float(p1 * abs(n) * n + characteristic.p2 * abs(n) * V_a)
    if isinstance(characteristic, Polynomial):
        a0, a1, a11 = characteristic.ahead if signal > 0.0 else characteristic.astern
        bollard = np.sign(signal) * (a0 + a1 * abs(signal) + a11 * signal**2)
        return float(bollard + characteristic.p2 * abs(signal / 60.0) * V_a)
    if isinstance(characteristic, Table):
        return bilinear(characteristic, signal, voltage)
    return float(signal)


def bilinear(table: Table, signal: float, voltage: float | None) -> float:
    """Return the force (N) of the table between its grid points; beyond the edges the edge's value.

    Raises
    ------
    ValueError
        The table has several voltages and none is given.
    """
    if len(table.force) == 1:
        return float(np.interp(signal, table.signal, table.force[0]))
    if voltage is None:
        raise ValueError("the table has several supply voltages: expected a voltage, found none")
    at_voltage = [np.interp(voltage, table.voltage, column) for column in table.force.T]
    return float(np.interp(signal, table.signal, at_voltage))


def force_and_torque(
    thruster: Thruster, value: float, *, inflow: float, voltage: float | None, density_ratio: float
) -> tuple[float, float]:
    """Return the force (N) on the vehicle along the axis and the reaction torque (N m) about it.

    ``value`` is the actual one in the own unit, ``inflow`` the relative water velocity u_a along the axis
    (m/s), ``density_ratio`` rho over the reference's: it scales all thrusts but those commanded in newtons.
    """
    c, signal = thruster.characteristic, float(thruster.signal(value))
    scale = thruster.gain * (1.0 if isinstance(c, Newton) else density_ratio)
    if thrust(c, signal, V_a=0.0, voltage=voltage) < 0.0:
        scale *= thruster.astern_ratio
    V_a = (1.0 - thruster.wake) * inflow
    force = scale * (1.0 - thruster.thrust_deduction) * thrust(c, signal, V_a=V_a, voltage=voltage)
    if not isinstance(c, Quadratic | Polynomial):
        return force, 0.0
    n = signal / 60.0
    # The hull's suction takes thrust, not torque: no deduction here.
    return force, scale * (c.q1 * abs(n) * n + c.q2 * abs(n) * V_a)
