"""The sensors one after the other: gyro and velocity against the pose, specific force against gravity.

Each is first assigned and brought to SI (`seatrial.trial.kinematic_axes`), then its delay, drift, mounting,
scale and biases are fitted together (`seatrial.trial.kinematic_fit`). What is found about one is applied
before the next.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import DEGREE
from seatrial.base.finding import Finding, Severity
from seatrial.base.frames import matrix
from seatrial.trial.kinematic_axes import (
    LEAST_MOTION,
    Assignment,
    alone,
    assigned,
    at_end,
    band,
    follows,
    lagged,
    unit_of,
)
from seatrial.trial.kinematic_fit import Fit, Parameter, fitted, robust_rms
from seatrial.trial.kinematics import (
    Channels,
    Curve,
    Grid,
    RatesResidual,
    VelocityResidual,
    earth_velocity,
    pose_velocity,
)
from seatrial.trial.signals import Series


@dataclass(frozen=True)
class SensorSettings:
    """Within what the delay and mounting of a sensor are searched, and what is too small to be proposed."""

    same_clock_s: float = 1.5  #: Delays within a file are searched up to here, s.
    other_clock_s: float = 60.0  #: Offsets of two clocks are searched up to here, s.
    least_delay_s: float = 0.015  #: Smallest delay that is proposed, s.
    least_tilt: float = 0.3 * DEGREE  #: Smallest tilt that is proposed, rad: 0.3 deg.
    least_heading: float = 1.0 * DEGREE  #: Smallest error of a heading that is proposed, rad: 1 deg.
    least_gyro_bias: float = 0.03 * DEGREE  #: Smallest bias of a gyro that is proposed, rad/s: 0.03 deg/s.
    #: What data sheets of Doppler logs allow beside a share of the speed, m/s.
    velocity_bias_m_s: float = 0.001
    least_force_bias: float = 0.03  #: Smallest bias of an accelerometer that is proposed, m/s^2.
    trusted_correlation: float = 0.6  #: Correlation of a comparison whose ratio of sizes is believed.
    clearly_moving: float = 4.0  #: Times as much must a velocity move as a position that stands still.
    shared_correlation: float = 0.3  #: Correlation from which a rough delay is believed.
    #: Times the interval of depth, velocity and attitude: a slower position is compared apart.
    slow_position: float = 2.0


SETTINGS = SensorSettings()


@dataclass(frozen=True)
class Found:
    """What was found about one sensor."""

    #: The sensor, and the comparison with its unit.
    group: str
    of: str
    fit: Fit | None  #: Fitted parameters; None where too little can be compared.
    assignment: Assignment | None = None  #: Axes and signs; None where correlation does not tell.
    #: Unit that the samples turned out to have and its size in SI, by group.
    unit: dict[str, tuple[str, float]] = field(default_factory=dict)
    other_clock: bool = False  #: Whether the sensor has another clock than the attitude.
    #: Residual's root mean square as recorded and after axes, signs and units.
    sizes: tuple[float, float] = (0.0, 0.0)
    middle: float = 0.0  #: Time at which a delay with a drift holds, s.
    why: Finding | None = None  #: Why there is no fit; None for too little in common.
    #: Of a velocity: root mean squares of the rates that it is compared with and of the velocity, m/s.
    motion: float = 0.0
    speed: float = 0.0
    shown: float = 0.0  #: Root mean square of the rates as velocity and attitude say, m/s.
    #: Whether position or depth move less than their noise while the velocity says clearly more.
    still: bool = False

    @property
    def pose(self) -> str:
        """What a velocity is compared with: "depth", "position" or "position and depth"."""
        return self.of.removeprefix("rates of ").removeprefix("rate of ").partition(" and the velocity")[0]


def _undated(group: str, clock: str, reference: str, delays: Sequence[float]) -> Finding:
    """Why sensors of two clocks are not compared."""
    values = {"clock": clock, "reference": reference, "delays_s": tuple(delays)}
    return Finding("clocks undated", Severity.NOTE, group, values)


def _at_end(what: str, delay: float, reach: float) -> Finding:
    """Why a delay at the end of the search range is none."""
    return Finding("delay at end", Severity.NOTE, what, {"delay_s": delay, "reach_s": reach})


def _reach(channels: Channels, group: str) -> tuple[float, bool]:
    other = channels.clock(group) != channels.clock("attitude")
    return (SETTINGS.other_clock_s if other else SETTINGS.same_clock_s), other


def _timing(channels: Channels, group: str, grid: Grid) -> list[Parameter]:
    """Delay of a sensor, and the drift of its clock where it has one of its own."""
    parameters = [
        Parameter(
            f"delay.{group}", 0.02, SETTINGS.least_delay_s, always=group in ("velocity", "rates"), shift=True
        )
    ]
    if channels.clock(group) != channels.clock("attitude"):
        span = float(grid.t[-1] - grid.t[0])
        parameters.append(Parameter(f"drift.{group}", 0.02 / span, 0.02 / span, shift=True))
    return parameters


def scaled(channels: Channels, names: Mapping[str, float]) -> None:
    """Bring channels to SI, in place."""
    for name, factor in names.items():
        if name in channels.curves:
            old = channels.curves[name]
            channels.curves[name] = Curve(Series(old.t, old.values * factor, old.clock))


def rates_found(channels: Channels) -> Found | None:
    """The gyro against the attitude's rates; None without either."""
    needed = {"p": ("roll",), "q": ("pitch",), "r": ("yaw",)}
    names = tuple(n for n, own in needed.items() if n in channels.curves and set(own) <= set(channels.curves))
    grid = channels.grid((*names, "roll", "pitch", "yaw"), 2.0) if names else None
    if grid is None:
        return None
    reach, other = _reach(channels, "rates")
    reach = min(reach, 0.2 * float(grid.t[-1] - grid.t[0]))
    residual = RatesResidual(channels, grid, names)
    of = "rates of the attitude and the gyro, rad/s"
    before = _rms(residual({}))
    shown = grid.low(np.stack([channels.curves[n](grid.t) for n in names], axis=1))
    good = residual({})[1]
    # Which channel shows which axis with which sign; rates that no channel shows may leak into it.
    unseen = [k for k, name in enumerate("pqr") if name not in names]
    assignment = assigned(
        names, residual.reference, shown, good, grid, reach, kind="rates", beside=residual.rates[:, unseen]
    )
    if assignment is None:
        return Found("rates", of, None, other_clock=other, sizes=(before, before))
    if at_end(assignment.delay, reach, grid.step):
        why = _at_end("gyro", assignment.delay, reach)
        return Found("rates", of, None, replace(assignment, axes={}), sizes=(before, before), why=why)
    channels.axes |= assignment.changed
    if other:
        y = np.stack([channels.at(n, grid.t, {}) for n in names], axis=1)
        a, b = (band(side, good, grid) for side in (residual.reference, grid.low(y)))
        twin = alone(a, b, grid.step, assignment.delay, reach)
        if twin is not None:
            why = _undated(
                "gyro", channels.clock("rates"), channels.clock("attitude"), (assignment.delay, twin)
            )
            return Found("rates", of, None, assignment, other_clock=True, sizes=(before, before), why=why)
    # A ratio of sizes that a unit explains is one; what is left over is fitted as delay, biases and scales.
    units = {}
    if (unit := unit_of(assignment.ratio, "rates")) is not None:
        units["rates"] = unit
        scaled(channels, dict.fromkeys("pqr", unit[1]))
    sizes = (before, _rms(residual({})))
    scales = tuple(Parameter(f"scale.{n}", 0.01, 0.02, material=0.02, factor=True) for n in names)
    biases = tuple(Parameter(f"bias.{n}", 0.1 * DEGREE, SETTINGS.least_gyro_bias) for n in names)
    channels.middle = float(grid.t.mean())
    parameters = [*_timing(channels, "rates", grid), *biases, *scales]
    fit = fitted(residual, parameters, grid, [{"delay.rates": assignment.delay}])
    if fit is not None and at_end(fit.values.get("delay.rates", 0.0), reach, grid.step):
        why = _at_end("gyro", fit.values["delay.rates"], reach)
        return Found("rates", of, None, assignment, units, other, sizes, channels.middle, why=why)
    _keep_delay(channels, "rates", fit)
    return Found("rates", of, fit, assignment, units, other, sizes, channels.middle)


def _keep_delay(channels: Channels, group: str, fit: Fit | None) -> None:
    """What is compared next sees this sensor at the right time, on average."""
    if fit is not None:
        channels.delay[group] = fit.values.get(f"delay.{group}", 0.0)


def velocity_found(channels: Channels) -> list[Found]:
    """The velocity against position and depth; empty where the log has not what it takes. A much slower
    position is compared apart: the depth, at its own rate, tells delay and tilt.
    """
    have = set(channels.curves)
    rows = []
    if {"x", "y", "u", "v", "yaw"} <= have:
        rows += [0, 1]
    if {"z", "u", "w", "pitch"} <= have:
        rows += [2]
    parts = [tuple(rows)] if rows else []
    if len(rows) == 3:
        step = {name: channels.curves[name].step for name in ("x", "z", "u", "pitch")}
        if step["x"] > SETTINGS.slow_position * max(step["z"], step["u"], step["pitch"]):
            parts = [(2,), (0, 1)]
    sensors = [
        _velocity(channels, part, timed=k == 0, sized=k == len(parts) - 1) for k, part in enumerate(parts)
    ]
    return [sensor for sensor in sensors if sensor is not None]


def _velocity(channels: Channels, rows: tuple[int, ...], *, timed: bool, sized: bool) -> Found | None:
    """The velocity against these rows of north, east and down; `timed`: with delay, `sized`: with scale."""
    used = tuple(["xyz"[k] for k in rows] + ["u", "v", "w", "roll", "pitch", "yaw"])
    grid = channels.grid(used, 2.0)
    if grid is None:
        return None
    residual = VelocityResidual(channels, grid, rows)
    before = _rms(residual({}))
    if (stopped := _still(residual, grid, rows, before)) is not None:
        return stopped
    reach, other = _reach(channels, "velocity")
    reach = min(reach, 0.2 * float(grid.t[-1] - grid.t[0]))
    good = residual({})[1]
    whole = len(rows) == 3
    known = channels.delay.get("velocity", 0.0)
    if whole:
        assignment, ratio = _by_axes(channels, grid, good, reach)
    else:
        assignment, ratio = _by_rows(channels, grid, residual, good, rows, reach)
    of = _compared(rows)
    units: dict[str, tuple[str, float]] = {}
    if (unit := unit_of(ratio, "velocity")) is not None:
        units["velocity"] = unit
        scaled(channels, dict.fromkeys("uvw", unit[1]))
    elif rows == (2,) and (unit := unit_of(1.0 / max(ratio, 1e-300), "depth")) is not None:
        units["depth"] = unit
        scaled(channels, {"z": unit[1]})
    if units and not whole:  # the rough delay was told from samples of another size
        residual = VelocityResidual(channels, grid, rows)
        assignment, _ = _by_rows(channels, grid, residual, good, rows, reach)
    if not timed:
        channels.delay["velocity"] = known
    residual = VelocityResidual(channels, grid, rows)
    if other and timed and (twin := _twin(channels, grid, residual, good, rows, reach)) is not None:
        rough = channels.delay.pop("velocity", 0.0)
        clocks = (channels.clock("velocity"), channels.clock("attitude"))
        why = _undated("velocity", *clocks, delays=(rough, twin))
        return Found("velocity", of, None, None, other_clock=True, sizes=(before, before), why=why)
    sizes = (before, _rms(residual({})))
    channels.middle = float(grid.t.mean())
    parameters = _velocity_parameters(channels, grid, rows)
    starts: list[dict[str, float]] = [{}]
    if timed:
        starts = [
            {"delay.velocity": delay} for delay in sorted({0.0, channels.delay.pop("velocity", 0.0)}, key=abs)
        ]
    else:
        parameters = [parameter for parameter in parameters if not parameter.shift]
    if not sized:
        parameters = [parameter for parameter in parameters if parameter.name != "scale.velocity"]
        parameters.append(Parameter("scale.depth", 0.01, 0.02, material=0.02, factor=True))
    fit = fitted(residual, parameters, grid, starts)
    if timed and fit is not None and at_end(fit.values.get("delay.velocity", 0.0), reach, grid.step):
        why = _at_end("velocity", fit.values["delay.velocity"], reach)
        return Found("velocity", of, None, assignment, units, other, sizes, channels.middle, why=why)
    for group in ("velocity", *{channels.group("xyz"[k]) for k in rows}) if timed else ():
        _keep_delay(channels, group, fit)
    motion = _rms(residual.rate({}))
    speed = robust_rms(np.stack([channels.at(name, grid.t, {}) for name in "uvw"], axis=1))
    return Found(
        "velocity", of, fit, assignment, units, other, sizes, channels.middle, motion=motion, speed=speed
    )


def _compared(rows: tuple[int, ...]) -> str:
    pose = {3: "rates of position and depth", 2: "rate of position", 1: "rate of depth"}[len(rows)]
    return f"{pose} and the velocity, m/s"


def _still(residual: VelocityResidual, grid: Grid, rows: tuple[int, ...], before: float) -> Found | None:
    """What is said where position and depth move less than their noise, which tells no sign or delay."""
    rate, _ = residual.rate({})
    y, good = residual({})
    if not good.any():
        return None
    moved, shown = (
        float(np.sqrt(np.mean(np.sum(band(side, good, grid)[good] ** 2, axis=1))))
        for side in (rate, rate - y)
    )
    if moved > LEAST_MOTION["velocity"]:
        return None
    clearly = shown > SETTINGS.clearly_moving * max(moved, LEAST_MOTION["velocity"])
    made = Found("velocity", _compared(rows), None, sizes=(before, before), motion=moved, shown=shown)
    return replace(made, still=clearly, why=Finding("too little motion", Severity.NOTE, made.of))


def _velocity_parameters(channels: Channels, grid: Grid, rows: tuple[int, ...]) -> list[Parameter]:
    have = set(channels.curves)
    parameters = _timing(channels, "velocity", grid)
    for group in sorted({channels.group("xyz"[k]) for k in rows}):
        if not channels.with_attitude("x" if group == "position" else "z"):
            parameters += _timing(channels, group, grid)
    angle = 0.3 * DEGREE
    if 2 in rows:
        parameters += [
            Parameter("tilt.pitch", angle, SETTINGS.least_tilt),
            Parameter("bias.w", 0.001, 0.0, SETTINGS.velocity_bias_m_s, always=True),
        ]
        if "v" in have:
            parameters.append(
                Parameter("tilt.roll" if "roll" in have else "list", angle, SETTINGS.least_tilt)
            )
    if 0 in rows:
        parameters.append(Parameter("heading", angle, SETTINGS.least_heading))
    parameters.append(Parameter("scale.velocity", 0.01, 0.02, material=0.02, factor=True))
    if 0 in rows or {"roll", "pitch"} <= have:
        axes = "xyz" if len(rows) == 3 else "xy"
        parameters += [Parameter(f"arm.{axis}", 0.02, 0.05) for axis in axes]
    return parameters


def _twin(
    channels: Channels,
    grid: Grid,
    residual: VelocityResidual,
    good: Mask,
    rows: tuple[int, ...],
    reach: float,
) -> float | None:
    """Another offset of the velocity's clock that fits as well as the rough one; None where there is none."""
    rough = channels.delay.get("velocity", 0.0)
    rate, _ = residual.rate({})
    still = np.zeros(len(grid.t))
    v = np.stack([channels.curves[name](grid.t) if name in channels.curves else still for name in "uvw"])
    if rows == (2,):  # the pitch has no delay of its own, see _by_rows
        typical = grid.low(float(np.median(v[0])) * residual.turns[:, 2, :1])
        least, sides = np.inf, None
        for factor in (1.0, -1.0):
            a, b = band(rate - factor * typical, good, grid), band(grid.low(v[2])[:, None], good, grid)
            _, rho = lagged(a, b, grid.step, reach)
            if -abs(rho[0, 0]) < least:
                least, sides = -abs(rho[0, 0]), (a, b * np.sign(rho[0, 0]))
        assert sides is not None
        return alone(*sides, grid.step, rough, reach)
    if len(rows) == 3:
        reference, _ = pose_velocity(channels, grid)
        shown = np.stack([channels.at(name, grid.t, {"delay.velocity": -rough}) for name in "uvw"], axis=1)
    else:
        reference, shown = rate, earth_velocity(channels.rotation(grid.t), v.T)[:, :2]
    a, b = band(reference, good, grid), band(grid.low(shown), good, grid)
    return alone(a, b, grid.step, rough, reach)


def _rms(compared: tuple[Array, Mask]) -> float:
    return robust_rms(compared[0][compared[1]])


def _by_axes(channels: Channels, grid: Grid, good: Mask, reach: float) -> tuple[Assignment | None, float]:
    """Axes, signs, rough delay and ratio of sizes from all three components in the body frame."""
    reference, _ = pose_velocity(channels, grid)
    names = tuple(name for name in "uvw" if name in channels.curves)
    shown = grid.low(np.stack([channels.curves[name](grid.t) for name in names], axis=1))
    reference = reference[:, ["uvw".index(name) for name in names]]
    assignment = assigned(names, reference, shown, good, grid, reach, kind="velocity")
    if assignment is None or at_end(assignment.delay, reach, grid.step):
        return None, 1.0
    channels.delay["velocity"] = assignment.delay
    channels.axes |= assignment.changed
    return assignment, assignment.ratio


def _by_rows(
    channels: Channels,
    grid: Grid,
    residual: VelocityResidual,
    good: Mask,
    rows: tuple[int, ...],
    reach: float,
) -> tuple[Assignment | None, float]:
    """The same where only the depth, or north and east, are known: signs that halve the residual."""
    rate, _ = residual.rate({})
    names = ("u", "w") if rows == (2,) else ("u", "v")
    u = channels.curves["u"](grid.t)
    if rows == (2,):
        # The pitch has no delay of its own: what it leaves of the depth's rate belongs to w.
        typical = grid.low(float(np.median(u)) * residual.turns[:, 2, :1])
        shown = grid.low(channels.curves["w"](grid.t))[:, None]
    else:
        typical = np.zeros((len(u), 2))
        level = np.stack([u, channels.curves["v"](grid.t), 0.0 * u], axis=1)
        shown = grid.low(earth_velocity(channels.rotation(grid.t), level)[:, :2])
    best: tuple[float, float, float] = (0.0, 0.0, 0.0)
    size = float(np.median(np.abs(rate[good]))) / max(float(np.median(np.abs(shown[good]))), 1e-300)
    for factor in (1.0, -1.0, *((size, -size) if not 0.2 < size < 5.0 else ())):
        a, b = band(rate - factor * typical, good, grid), band(shown, good, grid)
        delay, rho = lagged(a, b, grid.step, reach)
        strength = float(np.abs(np.diag(rho)).max())
        if strength > best[0]:
            best = (strength, delay, factor)
    known = best[0] > SETTINGS.shared_correlation and not at_end(best[1], reach, grid.step)
    channels.delay["velocity"] = best[1] if known else 0.0
    return _signs_by_rows(channels, grid, residual, names, rows)


def _signs_by_rows(
    channels: Channels, grid: Grid, residual: VelocityResidual, names: Sequence[str], rows: tuple[int, ...]
) -> tuple[Assignment, float]:
    """Signs of the components by what each adds, turned by the attitude, to the rate of depth or of north and
    east: one with a gain near minus one is reversed. With the ratio of sizes.
    """
    late = channels.delay["velocity"]
    residual.velocities = {}  # of another delay
    rate, _ = residual.rate({})
    y, use = residual({})
    parts = []
    every = [*names, *(name for name in "uvw" if name in channels.curves and name not in names)]
    for name in every:
        own = np.zeros((len(grid.t), 3))
        own[:, "uvw".index(name)] = channels.at(name, grid.t, {})
        parts.append(grid.low(earth_velocity(channels.rotation(grid.t), own)[:, list(rows)]))
    target = band(rate, use, grid, cut=False)
    added = [band(part, use, grid, cut=False) for part in parts]
    cut, whole = band(rate, use, grid), band(rate - y, use, grid)
    size = float(np.sqrt(np.sum(whole**2) / max(float(np.sum(cut**2)), 1e-300)))
    unit = unit_of(size, "velocity")
    if unit is None and rows == (2,) and (deep := unit_of(1.0 / max(size, 1e-300), "depth")) is not None:
        unit = deep[0], 1.0 / deep[1]
    factor = 1.0 if unit is None else unit[1]
    # North and east behind one another: rows of two equations with the same unknowns.
    motion = factor * np.concatenate([
        np.stack([part[:, k] for part in added], axis=1) for k in range(len(rows))
    ])
    both = np.concatenate([use] * len(rows))
    following = {
        name: follows(motion, k, target.T.ravel(), both, step=grid.step, kind="velocity", lag=late)
        for k, name in enumerate(names)
    }
    # Each is only a part of the sum: how much of the whole it explains says nothing of its sign.
    following = {name: replace(axis, whole=axis.share) for name, axis in following.items()}
    signs = {name: -1.0 if axis.reversed or axis.doubtful else 1.0 for name, axis in following.items()}
    channels.axes |= {name: (name, sign) for name, sign in signs.items() if sign < 0.0}
    residual.velocities = {}
    y, use = residual({})
    cut, whole = band(rate, use, grid), band(rate - y, use, grid)
    fit = float(np.sum(cut * whole) / np.sqrt(np.sum(cut**2) * np.sum(whole**2) + 1e-300))
    moved = float(np.sqrt(np.mean(cut[use] ** 2))) if use.any() else 0.0
    axes = {name: (name, sign) for name, sign in signs.items()}
    made = Assignment(late, axes, dict.fromkeys(names, fit), size, following)
    return made, size if fit > SETTINGS.trusted_correlation and moved > LEAST_MOTION["velocity"] else 1.0


def force_found(channels: Channels, g: float = 9.81) -> Found | None:
    """The specific force against gravity turned by the attitude and the velocity's change."""
    names = ("ax", "ay", "az")
    if not {*names, "roll", "pitch"} <= set(channels.curves):
        return None
    moving = {"u", "v", "w", "p", "q", "r"} <= set(channels.curves)
    used = (*names, "roll", "pitch", *(("u", "v", "w", "p", "q", "r") if moving else ()))
    grid = channels.grid(used, 2.0)
    if grid is None:
        return None
    of = "specific force, and gravity and acceleration, m/s^2"
    # At rest an accelerometer shows gravity turned upwards; under way the change of the velocity on top.
    expected = grid.low(-g * matrix(channels.rotation(grid.t))[:, 2, :])
    if moving:
        v = np.stack([channels.at(n, grid.t, {}) for n in "uvw"], axis=1)
        omega = np.stack([channels.at(n, grid.t, {}) for n in "pqr"], axis=1)
        expected = expected + grid.slope(v) + grid.low(np.cross(omega, v))
    known = grid.inside(channels.known(used, grid.t, {}))

    def residual(values: Mapping[str, float]) -> tuple[Array, Mask]:
        shown = np.stack(
            [channels.at(n, grid.t, values) - values.get(f"bias.{n}", 0.0) for n in names], axis=1
        )
        return grid.low(shown) - expected, known

    before = _rms(residual({}))
    # The median of the vertical component is gravity: its sign and size tell axes and unit.
    size = float(np.median(channels.curves["az"].values)) / -g
    units: dict[str, tuple[str, float]] = {}
    axes: dict[str, tuple[str, float]] = {}
    if size < 0.0:
        axes = {n: (n, -1.0) for n in names}
        channels.axes |= axes
    for unit, factor in (("g", g), ("mg", 1e-3 * g)):
        if abs(abs(size) * factor - 1.0) < 0.2:
            units["specific force"] = (unit, factor)
            scaled(channels, dict.fromkeys(names, factor))
    middle = _rms(residual({}))
    biases = [Parameter(f"bias.{n}", 0.01, SETTINGS.least_force_bias) for n in names]
    fit = fitted(residual, [*_timing(channels, "specific force", grid), *biases], grid)
    assignment = Assignment(0.0, {n: axes.get(n, (n, 1.0)) for n in names}, {}, abs(size), {})
    return Found("specific force", of, fit, assignment, units, False, (before, middle))
