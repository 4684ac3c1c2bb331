"""Residuals between channels that kinematics ties: position and depth, velocity, attitude, rates.

``p' = R (T v_S - omega x r)`` with the rotation R of the attitude, the mounting T and place r of the velocity
sensor, and omega the increment of R over time (Fossen 2011, equations 2.18 and 2.26). A depth alone gives the
third row. Every sensor has a delay and, on another clock than the attitude, a drift; the attitude is the
reference. The attitude is a rotation throughout, interpolated as one: a vehicle that tumbles passes pitch 90
deg, where roll and yaw jump by half a turn and no angle can be interpolated or differentiated by itself. Held
by ``tests/inspect/test_consistency.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.frames import conjugate, continuous, from_euler, matrix, product
from seatrial.trial.signals import CHANNEL_GROUPS, INPUTS, Series

Values = Mapping[str, float]

_GAP = 4.5  # median intervals: a longer distance between samples is not bridged

_ANGLES = CHANNEL_GROUPS["attitude"]

_ONE_SENSOR = 0.9  # share of stamps that angles of one attitude have in common, lost samples aside


class Curve:
    """A series between its samples: cubic spline of the values, and where it is known."""

    def __init__(self, series: Series, *, angle: bool = False) -> None:
        from scipy.interpolate import CubicSpline

        value = np.unwrap(series.value) if angle else series.value
        self.t, self.step = series.t, float(np.median(np.diff(series.t)))
        self.clock, self.values = series.clock, value
        self._spline = CubicSpline(series.t, value)

    def __call__(self, t: Array) -> Array:
        """Values (n,) at times (n,), held beyond the ends."""
        return np.asarray(self._spline(np.clip(t, self.t[0], self.t[-1])))

    def known(self, t: Array) -> Mask:
        """Where samples on both sides are near enough, (n,)."""
        after = np.clip(np.searchsorted(self.t, t), 1, len(self.t) - 1)
        near = self.t[after] - self.t[after - 1] <= _GAP * self.step
        return np.asarray(near & (t >= self.t[0]) & (t <= self.t[-1]))


@dataclass(frozen=True)
class Grid:
    """Uniform times (n,) in s and the width in s of the low-pass that both sides of a comparison pass."""

    t: Array
    width: float

    @classmethod
    def of(cls, curves: Sequence[Curve], margin: float = 0.0) -> Grid | None:
        """Grid for these channels, fine enough for the slowest; None where they hardly overlap."""
        step = max(curve.step for curve in curves)
        start, stop = max(c.t[0] for c in curves) + margin, min(c.t[-1] for c in curves) - margin
        h = 0.5 * step
        if not stop - start > 100.0 * h:
            return None
        return cls(np.arange(start, stop, h), 2.0 * step)

    @property
    def step(self) -> float:
        """Interval, s."""
        return float(self.t[1] - self.t[0])

    def low(self, y: Array, *, differenced: bool = False) -> Array:
        """The low-passed values (n, ...). Where they are `differenced`, means over two intervals already
        (variance a third of the interval's square), the Gaussian is narrower by that, so that both sides are
        filtered alike.
        """
        from scipy.ndimage import gaussian_filter1d

        wide = self.width / self.step
        wide = float(np.sqrt(wide**2 - 1.0 / 3.0)) if differenced else wide
        return np.asarray(gaussian_filter1d(y, wide, axis=0, mode="nearest"))

    def slope(self, y: Array) -> Array:
        """Derivative of the low-passed values (n, ...), per s."""
        from scipy.ndimage import gaussian_filter1d

        filtered = gaussian_filter1d(y, self.width / self.step, axis=0, order=1, mode="nearest")
        return np.asarray(filtered) / self.step

    def inside(self, known: Mask) -> Mask:
        """Where all samples that the low-pass takes are known, (n,)."""
        from scipy.ndimage import minimum_filter1d

        reach = 2 * int(np.ceil(2.5 * self.width / self.step)) + 1
        return np.asarray(minimum_filter1d(known.astype(np.uint8), reach, mode="constant")).astype(bool)


@dataclass
class Channels:
    """Curves by channel, the delay of each group that is already known, s, and the axes and signs of groups.

    ``axes`` maps a channel to the recorded one that holds it and the sign.
    """

    curves: dict[str, Curve]
    middle: float = 0.0
    delay: dict[str, float] = field(default_factory=dict)
    axes: dict[str, tuple[str, float]] = field(default_factory=dict)
    _turns: tuple[tuple[Curve, ...], _RotationCurve] | None = field(default=None, repr=False)

    def rotation(self, t: Array) -> Array:
        """Unit quaternions (n, 4), body to NED, at times (n,); an angle that is not recorded is zero."""
        known = {name: self.curves[name] for name in _ANGLES if name in self.curves}
        if not known:
            return np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
        curves = tuple(known.values())
        if (
            self._turns is None
            or len(self._turns[0]) != len(curves)
            or any(a is not b for a, b in zip(self._turns[0], curves, strict=True))
        ):
            self._turns = curves, _RotationCurve(known)
        return self._turns[1](t)

    def group(self, channel: str) -> str:
        """Sensor of a channel; a depth with the stamps of the position is the position's."""
        if channel == "z" and "x" in self.curves and np.array_equal(self.curves["z"].t, self.curves["x"].t):
            return "position"
        return next(group for group, channels in CHANNEL_GROUPS.items() if channel in channels)

    def with_attitude(self, channel: str) -> bool:
        """Whether a channel has the stamps of the attitude: they are then one instrument's, one pose."""
        return np.array_equal(
            self.curves[channel].t, self.curves["yaw" if "yaw" in self.curves else "pitch"].t
        )

    def clock(self, group: str) -> str:
        """Name of a group's clock."""
        first = next(c for c in self.curves if not c.startswith(INPUTS) and self.group(c) == group)
        return self.curves[first].clock

    def at(self, channel: str, t: Array, values: Values) -> Array:
        """Values (n,) of a channel at the attitude's times (n,); zero where it is not recorded."""
        recorded, sign = self.axes.get(channel, (channel, 1.0))
        if recorded not in self.curves:
            return np.zeros(len(t))
        return sign * self.curves[recorded](self._stamps(channel, t, values))

    def known(self, channels: tuple[str, ...], t: Array, values: Values) -> Mask:
        """Where all the recorded ones of some channels are known, (n,)."""
        mask = np.ones(len(t), bool)
        for channel in channels:
            recorded, _ = self.axes.get(channel, (channel, 1.0))
            if recorded in self.curves:
                mask &= self.curves[recorded].known(self._stamps(channel, t, values))
        return mask

    def _stamps(self, channel: str, t: Array, values: Values) -> Array:
        group = self.group(channel)
        if group == "attitude":
            return t
        late = self.delay.get(group, 0.0) + values.get(f"delay.{group}", 0.0)
        return t + late + values.get(f"drift.{group}", 0.0) * (t - self.middle)

    def grid(self, channels: tuple[str, ...], margin: float) -> Grid | None:
        """Grid over the times that these channels share."""
        curves = [self.curves[name] for name in channels if name in self.curves]
        return Grid.of(curves, margin) if curves else None


class _RotationCurve:
    """A rotation between the samples of its angles: a spline of the continuous quaternion, normalised."""

    def __init__(self, known: Mapping[str, Curve]) -> None:
        from scipy.interpolate import CubicSpline

        curves = list(known.values())
        stamps = curves[0].t
        for curve in curves[1:]:
            stamps = stamps if np.array_equal(stamps, curve.t) else np.intersect1d(stamps, curve.t)
        # Angles of several instruments (a compass beside an inclinometer) share no stamps: each on its own.
        self._apart = known if len(stamps) < _ONE_SENSOR * max(len(curve.t) for curve in curves) else None
        if self._apart is None:
            angles = np.zeros((len(stamps), 3))
            for name, curve in known.items():
                angles[:, _ANGLES.index(name)] = curve.values[np.searchsorted(curve.t, stamps)]
            self._first, self._last = stamps[0], stamps[-1]
            self._spline = CubicSpline(stamps, continuous(from_euler(angles))[0])

    def __call__(self, t: Array) -> Array:
        """Unit quaternions (n, 4) at times (n,), held beyond the ends."""
        if self._apart is not None:
            angles = np.zeros((len(t), 3))
            for name, curve in self._apart.items():
                angles[:, _ANGLES.index(name)] = curve(t)
            return continuous(from_euler(angles))[0]
        q = np.asarray(self._spline(np.clip(t, self._first, self._last)))
        return np.asarray(q / np.linalg.norm(q, axis=1)[:, None])


def earth_velocity(q: Array, v: Array) -> Array:
    """Velocity (n, 3) north, east, down of a body velocity (n, 3) at these attitudes (n, 4)."""
    return np.asarray(np.einsum("nij,nj->ni", matrix(q), v))


def _mounted(v: Array, values: Values) -> Array:
    """Body velocity (n, 3) of what a sensor turned by the tilt angles shows: ``R_z R_y R_x v_S``."""
    # A list of the hull where no roll is logged turns the velocity as a sensor that is turned does.
    angles = [values.get(name, 0.0) for name in ("tilt.roll", "tilt.pitch", "tilt.yaw")]
    angles[0] += values.get("list", 0.0)
    return np.asarray(v @ matrix(from_euler(angles)).T)


def differences(y: Array, grid: Grid) -> Array:
    """Central differences (n, ...) per s of values on the grid: means over two intervals, see `Grid.low`."""
    rate = np.empty_like(y)
    rate[1:-1] = 0.5 * (y[2:] - y[:-2])
    rate[0], rate[-1] = y[1] - y[0], y[-1] - y[-2]
    return np.asarray(rate / grid.step)


def rotation_rates(q: Array, grid: Grid) -> Array:
    """Body rates (n, 3) in rad/s of attitudes (n, 4) on the grid, not low-passed: turns of whole intervals
    add up whatever their size; the derivative of a low-passed attitude does not follow fast turns.
    """
    between = product(conjugate(q[:-1]), q[1:])
    between = between * np.where(between[:, :1] < 0.0, -1.0, 1.0)
    size = np.linalg.norm(between[:, 1:], axis=1)
    angle = 2.0 * np.arctan2(size, between[:, 0])
    turns = between[:, 1:] * (angle / np.maximum(size, 1e-300))[:, None] / grid.step
    turns = np.where(size[:, None] > 0.0, turns, 0.0)
    whole = np.concatenate([turns[:1], turns, turns[-1:]])
    return np.asarray(0.5 * (whole[1:] + whole[:-1]))


def attitude_rates(channels: Channels, grid: Grid) -> tuple[Array, Mask]:
    """Body rates (n, 3) in rad/s that the attitude implies, low-passed, and where they are known (n,)."""
    rates = grid.low(rotation_rates(channels.rotation(grid.t), grid), differenced=True)
    return rates, grid.inside(channels.known(_ANGLES, grid.t, {}))


def pose_velocity(channels: Channels, grid: Grid) -> tuple[Array, Mask]:
    """Body velocity (n, 3) in m/s of position and attitude, low-passed, and where it is known (n,)."""
    rate = differences(np.stack([channels.at(name, grid.t, {}) for name in "xyz"], axis=1), grid)
    known = grid.inside(channels.known(("x", "y", "z", *_ANGLES), grid.t, {}))
    body = np.einsum("nji,nj->ni", matrix(channels.rotation(grid.t)), rate)
    return grid.low(np.asarray(body), differenced=True), known


class VelocityResidual:
    """Rate of position and depth less the velocity turned into the earth frame, m/s."""

    def __init__(self, channels: Channels, grid: Grid, rows: tuple[int, ...]) -> None:
        self.channels, self.grid, self.rows = channels, grid, rows
        self.turns = matrix(channels.rotation(grid.t))
        omega = rotation_rates(channels.rotation(grid.t), grid)
        # Velocity north, east, down (n, 3, 3) that turning adds to a sensor a metre off along each axis.
        arms = np.einsum("nij,nkj->nik", self.turns, np.cross(omega[:, None, :], np.eye(3)))
        self.arms = grid.low(np.asarray(arms), differenced=True)
        self.known = grid.inside(channels.known(_ANGLES, grid.t, {}))
        self._positions: dict[tuple[float, ...], tuple[Array, Mask]] = {}
        self.velocities: dict[tuple[float, ...], tuple[Array, Mask]] = {}

    def __call__(self, values: Values) -> tuple[Array, Mask]:
        """Residuals (n, k) and where they may be used."""
        t, grid, channels = self.grid.t, self.grid, self.channels
        rate, seen = self.rate(values)
        key = tuple(values.get(f"{kind}.velocity", 0.0) for kind in ("delay", "drift"))
        if key not in self.velocities:
            names = ("u", "v", "w")
            v = np.stack([channels.at(name, t, values) for name in names], axis=1)
            self.velocities = {key: (v, grid.inside(channels.known(names, t, values)))}
        v, known = self.velocities[key]
        v = _mounted(v, values) * (1.0 + values.get("scale.velocity", 0.0))
        v = v - np.array([0.0, 0.0, values.get("bias.w", 0.0)])
        velocity = grid.low(np.einsum("nij,nj->ni", self.turns, v))
        velocity = velocity - self.arms @ np.array([values.get(f"arm.{axis}", 0.0) for axis in "xyz"])
        if heading := values.get("heading", 0.0):
            velocity = velocity @ matrix(from_euler([0.0, 0.0, heading])).T
        return rate - velocity[:, list(self.rows)], seen & known & self.known

    def rate(self, values: Values) -> tuple[Array, Mask]:
        """Low-passed rates (n, k) of position and depth, m/s, and where they are known (n,)."""
        names = tuple("xyz"[k] for k in self.rows)
        groups = {self.channels.group(name) for name in names}
        key = tuple(
            values.get(f"{kind}.{group}", 0.0) for group in sorted(groups) for kind in ("delay", "drift")
        )
        if key not in self._positions:
            t = self.grid.t
            p = np.stack([self.channels.at(name, t, values) for name in names], axis=1)
            known = self.grid.inside(self.channels.known(names, t, values))
            self._positions = {key: (self.grid.slope(p), known)}
        rate, known = self._positions[key]
        size = np.array([1.0 + values.get("scale.depth", 0.0) if k == 2 else 1.0 for k in self.rows])
        return rate * size, known


class RatesResidual:
    """Rates of the attitude less those of the gyro, rad/s."""

    def __init__(self, channels: Channels, grid: Grid, names: tuple[str, ...]) -> None:
        self.channels, self.grid, self.names = channels, grid, names
        self.rates, self.known = attitude_rates(channels, grid)
        self.reference = self.rates[:, ["pqr".index(name) for name in names]]

    def __call__(self, values: Values) -> tuple[Array, Mask]:
        """Residuals (n, k) and where they may be used."""
        t, grid = self.grid.t, self.grid
        shown = np.stack(
            [
                (self.channels.at(name, t, values) - values.get(f"bias.{name}", 0.0))
                * (1.0 + values.get(f"scale.{name}", 0.0))
                for name in self.names
            ],
            axis=1,
        )
        known = grid.inside(self.channels.known(self.names, t, values))
        return self.reference - grid.low(shown), known & self.known
