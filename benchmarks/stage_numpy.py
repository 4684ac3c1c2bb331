"""A stage of CWolf's identification in NumPy, twice: as the textbook has it, and as quick as NumPy allows.

`textbook_cost` flies one candidate through one segment after the other with the textbook's functions:
matrices in every evaluation, six equations, those of measured axes thrown away. `Vectorised` flies all
candidates through all segments at once: arrays (candidates, segments), the rows of free axes alone,
matrices known to be diagonal, thrust tabulated beforehand, and what the candidates share computed once for
all of them. It is what an engineer writes who knows this vehicle and wants it quick.

Both are RK4 on the grid of `StageArrays` and give the same cost as the core.
Held by tests/benchmarks/test_benchmarks.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks import textbook
from benchmarks.stage_arrays import StageArrays
from benchmarks.textbook_kinematics import euler, quaternion_rate, rotation
from benchmarks.textbook_thrusters import Polynomial, Quadratic
from benchmarks.textbook_vehicle import build

Array = NDArray[np.float64]

FORCES, VELOCITIES = "XYZKMN", "uvwpqr"
CHANNELS = ("u", "v", "w", "p", "q", "r", "x", "y", "z", "roll", "pitch", "yaw")
LIFT = {"Y": "vr", "Z": "wq", "M": "wq", "N": "vr"}
# Coriolis force on axis i: nu_a (M nu)_b - nu_c (M nu)_d, a row of indices per term.
CORIOLIS = {
    "X": ((5, 1), (4, 2)),
    "Y": ((3, 2), (5, 0)),
    "Z": ((4, 0), (3, 1)),
    "K": ((2, 1), (1, 2), (5, 4), (4, 5)),
    "M": ((0, 2), (2, 0), (3, 5), (5, 3)),
    "N": ((1, 0), (0, 1), (4, 3), (3, 4)),
}


def textbook_cost(stage: StageArrays, candidate: Array) -> float:
    """Return the cost of one candidate (m,), segment by segment."""
    values = dict(stage.parameters.coefficients) | dict(zip(stage.names, candidate, strict=True))
    model = build(replace(stage.parameters, coefficients=values))
    free = [i for i, axis in enumerate(FORCES) if axis in stage.free]
    total, h = 0.0, stage.h

    for s in range(stage.nu.shape[1]):

        def replayed(x: Array, node: int, s: int = s) -> Array:
            x = x.copy()
            x[7:] = [x[7 + i] if i in free else stage.measured[node, i, s] for i in range(6)]
            return x

        def rate(x: Array, node: int, s: int = s) -> Array:
            x = replayed(x, node)
            tau = textbook.actuator_wrench(model, x[7:], stage.signals[node, :, s], None)
            nu_rate = textbook.acceleration(
                model, x[7:], x[3:7], tau, free=stage.free, nu_rate=stage.measured_rate[node, :, s]
            )
            return np.concatenate([rotation(x[3:7]) @ x[7:10], quaternion_rate(x[3:7], x[10:]), nu_rate])

        x = replayed(np.concatenate([stage.position[:, s], stage.attitude[:, s], stage.nu[:, s]]), 0)
        for sample in range(1, stage.samples):
            for step in range(stage.substeps):
                node = 2 * ((sample - 1) * stage.substeps + step)
                k1 = rate(x, node)
                k2 = rate(x + h / 2 * k1, node + 1)
                k3 = rate(x + h / 2 * k2, node + 1)
                k4 = rate(x + h * k3, node + 2)
                x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
                x[3:7] /= np.linalg.norm(x[3:7])
                x = replayed(x, node + 2)
            shown = np.concatenate([x[7:], x[:3], euler(x[3:7])])
            error = stage.observed[sample, :, s] - shown
            error[9:] = (error[9:] + np.pi) % (2 * np.pi) - np.pi
            total += float(stage.weight[sample, :, s] @ np.abs(error))
    return total


class Vectorised:
    """Costs (k,) of candidates (k, m): every candidate through every segment in one array.

    Raises
    ------
    ValueError
        The vehicle is not of CWolf's kind: mass and damping matrices diagonal, centre of gravity at O,
        thrusters in rpm, quadratic or polynomial, without reaction torque, loss and astern ratio, no fins.
    """

    def __init__(self, stage: StageArrays) -> None:
        self.stage = stage
        self.values = dict(stage.parameters.coefficients)
        self.axes = [FORCES.index(axis) for axis in stage.free]
        self.used = [c for c in range(12) if stage.weight[:, c].any()]
        self.positioned = any(6 <= c < 9 for c in self.used)
        self._refuse_other_kinds()
        self.thrust, self.inflow = self._thrust()

    def _refuse_other_kinds(self) -> None:
        off_diagonal = [f"{f}_{a}{end}" for f in FORCES for a in VELOCITIES for end in ("", a, "dot")]
        own = {f"{f}_{a}{end}" for f, a in zip(FORCES, VELOCITIES, strict=True) for end in ("", a, "dot")}
        other = [
            *(set(off_diagonal) - own),
            "x_g",
            "y_g",
            "z_g",
            "I_xy",
            "I_xz",
            "I_yz",
            *(f"{f}_0" for f in FORCES),
        ]
        unknown = [name for name in other if self.values.get(name, 0.0) != 0.0 or name in self.stage.names]
        unknown += [fin.servo.name for fin in self.stage.parameters.fins]
        for thruster in self.stage.parameters.thrusters:
            c = thruster.characteristic
            if (
                not isinstance(c, Quadratic | Polynomial)
                or c.q1
                or c.q2
                or thruster.loss
                or thruster.astern_ratio != 1.0
                or thruster.unit != "rpm"
            ):
                unknown.append(thruster.name)
        if unknown:
            raise ValueError(f"expected a vehicle of CWolf's kind, found {', '.join(unknown)}")

    def _thrust(self) -> tuple[Array, Array]:
        """Return wrench (nodes, 6, S) without inflow and its change per velocity (nodes, 6, 6, S)."""
        thrusters, n = self.stage.parameters.thrusters, self.stage.signals / 60.0
        still, flow = np.empty((2, *n.shape))
        for i, thruster in enumerate(thrusters):
            c = thruster.characteristic
            assert isinstance(c, Quadratic | Polynomial)
            factor = thruster.gain * (1.0 - thruster.thrust_deduction)
            size, ahead = np.abs(n[:, i]), n[:, i] > 0.0
            if isinstance(c, Quadratic):
                bollard = np.where(ahead, c.p1_ahead, c.p1_astern) * size**2
            else:
                one, other = (np.polynomial.polynomial.polyval(60.0 * size, x) for x in (c.ahead, c.astern))
                bollard = np.where(ahead, one, other)
            still[:, i] = factor * np.sign(n[:, i]) * bollard
            flow[:, i] = factor * c.p2 * (1.0 - thruster.wake) * size
        wrench = np.array([thruster.wrench for thruster in thrusters])
        unit = np.array([thruster.unit_wrench for thruster in thrusters])
        axes = self.axes
        return (
            np.einsum("nas,ai->nis", still, wrench[:, axes]),
            np.einsum("nas,ai,aj->nijs", flow, wrench[:, axes], unit),
        )

    def __call__(self, candidates: Array) -> Array:
        """Return the costs (k,) of candidates (k, m), infinite where they are not finite."""
        stage = self.stage
        c: dict[str, Array | float] = dict(self.values)
        c |= {
            name: column[:, None] for name, column in zip(stage.names, np.asarray(candidates).T, strict=True)
        }
        model = _Rows(c, stage.free, stage.parameters.g)
        x = [*stage.attitude, *(stage.nu[axis] for axis in self.axes)]
        if self.positioned:
            x += list(stage.position)
        total = np.zeros(len(candidates))
        with np.errstate(all="ignore"):
            for sample in range(1, stage.samples):
                for step in range(stage.substeps):
                    x = self._step(model, x, 2 * ((sample - 1) * stage.substeps + step))
                total += self._errors(x, sample)
        return np.where(np.isfinite(total), total, np.inf)

    def _step(self, model: _Rows, x: list[Array], node: int) -> list[Array]:
        h = self.stage.h
        k1 = self._rate(model, x, node)
        k2 = self._rate(model, [a + 0.5 * h * b for a, b in zip(x, k1, strict=True)], node + 1)
        k3 = self._rate(model, [a + 0.5 * h * b for a, b in zip(x, k2, strict=True)], node + 1)
        k4 = self._rate(model, [a + h * b for a, b in zip(x, k3, strict=True)], node + 2)
        x = [
            a + h / 6.0 * (b1 + 2.0 * (b2 + b3) + b4)
            for a, b1, b2, b3, b4 in zip(x, k1, k2, k3, k4, strict=True)
        ]
        length = np.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2] + x[3] * x[3])
        return [*(a / length for a in x[:4]), *x[4:]]

    def _velocity(self, x: list[Array], node: int) -> list[Array]:
        nu = list(self.stage.measured[node])
        for axis, value in zip(self.axes, x[4:], strict=False):
            nu[axis] = value
        return nu

    def _rate(self, model: _Rows, x: list[Array], node: int) -> list[Array]:
        a, b, c, d = x[:4]
        nu = self._velocity(x, node)
        u, v, w, p, q, r = nu
        up = (2.0 * (b * d - a * c), 2.0 * (c * d + a * b), 1.0 - 2.0 * (b * b + c * c))
        found = [
            -0.5 * (b * p + c * q + d * r),
            0.5 * (a * p - d * q + c * r),
            0.5 * (d * p + a * q - b * r),
            0.5 * (-c * p + b * q + a * r),
        ]
        for row, axis in enumerate(self.axes):
            force = self.thrust[node, row]
            for j in range(6):
                force = force + self.inflow[node, row, j] * nu[j]
            found.append(model.acceleration(axis, nu, up, force))
        if self.positioned:
            found += [
                (1.0 - 2.0 * (c * c + d * d)) * u + 2.0 * (b * c - a * d) * v + 2.0 * (b * d + a * c) * w,
                2.0 * (b * c + a * d) * u + (1.0 - 2.0 * (b * b + d * d)) * v + 2.0 * (c * d - a * b) * w,
                up[0] * u + up[1] * v + up[2] * w,
            ]
        return found

    def _errors(self, x: list[Array], sample: int) -> Array:
        """Return the weighted errors (k,) at a sample, summed over segments and channels."""
        stage, total = self.stage, 0.0
        a, b, c, d = x[:4]
        nu = self._velocity(x, 2 * sample * stage.substeps)
        for channel in self.used:
            if channel < 6:
                shown = nu[channel]
            elif channel < 9:
                shown = x[4 + len(self.axes) + channel - 6]
            elif channel == 9:
                shown = np.arctan2(2.0 * (c * d + a * b), 1.0 - 2.0 * (b * b + c * c))
            elif channel == 10:
                shown = -np.arcsin(np.clip(2.0 * (b * d - a * c), -1.0, 1.0))
            else:
                shown = np.arctan2(2.0 * (b * c + a * d), 1.0 - 2.0 * (c * c + d * d))
            error = stage.observed[sample, channel] - shown
            if channel >= 9:
                error = (error + np.pi) % (2 * np.pi) - np.pi
            total = total + np.abs(error) @ stage.weight[sample, channel]
        return np.asarray(total)


class _Rows:
    """Rows of the equation of motion of a vehicle of CWolf's kind, coefficients per candidate or shared."""

    def __init__(self, c: Mapping[str, Array | float], free: str, g: float) -> None:
        inertia = (c["m"], c["m"], c["m"], c["I_x"], c["I_y"], c["I_z"])
        self.mass = [
            i - c.get(f"{f}_{a}dot", 0.0) for i, f, a in zip(inertia, FORCES, VELOCITIES, strict=True)
        ]
        self.linear = [c.get(f"{f}_{a}", 0.0) for f, a in zip(FORCES, VELOCITIES, strict=True)]
        self.quadratic = [c.get(f"{f}_{a}{a}", 0.0) for f, a in zip(FORCES, VELOCITIES, strict=True)]
        self.lift = {
            f: [(VELOCITIES.index(a), c.get(f"{f}_u{a}", 0.0)) for a in LIFT.get(f, "")] for f in free
        }
        buoyancy = c.get("B", 0.0)
        self.weight = c["m"] * g - buoyancy
        self.arm = [-buoyancy * c.get(name, 0.0) for name in ("x_b", "y_b", "z_b")]

    def acceleration(self, axis: int, nu: list[Array], up: tuple[Array, ...], force: Array) -> Array:
        """Return the acceleration of one axis; ``up`` is the third row of R, ``force`` the thrusters'."""
        name, velocity, mass = FORCES[axis], nu[axis], self.mass
        force = force + (self.linear[axis] + self.quadratic[axis] * np.abs(velocity)) * velocity
        terms = [mass[b] * (nu[a] * nu[b]) for a, b in CORIOLIS[name]]
        for plus, minus in zip(terms[::2], terms[1::2], strict=True):
            force = force + (plus - minus)
        if self.lift[name]:
            speed = np.abs(nu[0])
            for j, coefficient in self.lift[name]:
                force = force + coefficient * (speed * nu[j])
        if axis < 3:
            force = force + self.weight * up[axis]
        else:
            i, j = (axis - 2) % 3, (axis - 1) % 3
            force = force + (self.arm[i] * up[j] - self.arm[j] * up[i])
        return np.asarray(force / mass[axis])
