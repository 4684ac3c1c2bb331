"""Residuals between channels that kinematics ties: position and depth, velocity, attitude, rates.

``p' = R(Theta) (T v_S - omega x r)`` with the mounting T and place r of the velocity sensor, and ``omega =
T(Theta)^-1 Theta'`` (Fossen 2011, equations 2.18 and 2.26). A depth alone gives the third row: ``z' = -sin
theta u + cos theta sin phi v + cos theta cos phi w``. Every sensor has a delay and, on another clock than
the attitude, a drift; the attitude is the reference. Held by ``tests/intake/test_consistency.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.trial.kinematic_fit import Curve, Grid
from seatrial.trial.kinematic_series import CHANNEL_GROUPS, INPUTS

__all__ = ["Channels", "RatesResidual", "VelocityResidual", "attitude_rates", "ned_rows", "pose_velocity"]

Values = Mapping[str, float]


@dataclass
class Channels:
    """Curves by channel, the delay of each group that is already known, s, and the axes and signs of groups.

    ``axes`` maps a channel to the recorded one that holds it and the sign.
    """

    curves: dict[str, Curve]
    middle: float = 0.0
    delay: dict[str, float] = field(default_factory=dict)
    axes: dict[str, tuple[str, float]] = field(default_factory=dict)

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


def ned_rows(roll: Array, pitch: Array, yaw: Array, v: Array) -> Array:
    """Velocity (n, 3) north, east, down of a body velocity (n, 3) at these angles (n,), rad."""
    (cr, cp, cy), (sr, sp, sy) = (
        (np.cos(roll), np.cos(pitch), np.cos(yaw)),
        (np.sin(roll), np.sin(pitch), np.sin(yaw)),
    )
    u, s, w = v.T
    return np.stack(
        [
            cy * cp * u + (cy * sp * sr - sy * cr) * s + (cy * sp * cr + sy * sr) * w,
            sy * cp * u + (sy * sp * sr + cy * cr) * s + (sy * sp * cr - cy * sr) * w,
            -sp * u + cp * sr * s + cp * cr * w,
        ],
        axis=1,
    )


def _mounted(v: Array, values: Values) -> Array:
    """Body velocity (n, 3) of what a sensor turned by the tilt angles shows: ``R_z R_y R_x v_S``."""
    from seatrial.base.rotation import from_euler, matrix

    # A list of the hull where no roll is logged turns the velocity as a sensor that is turned does.
    angles = [values.get(name, 0.0) for name in ("tilt.roll", "tilt.pitch", "tilt.yaw")]
    angles[0] += values.get("list", 0.0)
    return np.asarray(v @ matrix(from_euler(angles)).T)


def attitude_rates(channels: Channels, grid: Grid) -> tuple[Array, Mask]:
    """Body rates (n, 3) in rad/s that the attitude implies, low-passed, and where they are known (n,)."""
    angles = [channels.at(name, grid.t, {}) for name in ("roll", "pitch", "yaw")]
    (roll, pitch, _), (roll_rate, pitch_rate, yaw_rate) = (
        [f(one) for one in angles] for f in (grid.low, grid.slope)
    )
    rates = np.stack(
        [
            roll_rate - np.sin(pitch) * yaw_rate,
            np.cos(roll) * pitch_rate + np.sin(roll) * np.cos(pitch) * yaw_rate,
            -np.sin(roll) * pitch_rate + np.cos(roll) * np.cos(pitch) * yaw_rate,
        ],
        axis=1,
    )
    return rates, grid.inside(channels.known(("roll", "pitch", "yaw"), grid.t, {}))


def pose_velocity(channels: Channels, grid: Grid) -> tuple[Array, Mask]:
    """Body velocity (n, 3) in m/s of position and attitude, low-passed, and where it is known (n,)."""
    roll, pitch, yaw = (grid.low(channels.at(name, grid.t, {})) for name in ("roll", "pitch", "yaw"))
    rate = grid.slope(np.stack([channels.at(name, grid.t, {}) for name in "xyz"], axis=1))
    known = grid.inside(channels.known(("x", "y", "z", "roll", "pitch", "yaw"), grid.t, {}))
    # Columns of R: the body components are the products with them.
    turned = [ned_rows(roll, pitch, yaw, np.tile(axis, (len(grid.t), 1))) for axis in np.eye(3)]
    return np.stack([np.sum(column * rate, axis=1) for column in turned], axis=1), known


class VelocityResidual:
    """Rate of position and depth less the velocity turned into the earth frame, m/s."""

    def __init__(self, channels: Channels, grid: Grid, rows: tuple[int, ...]) -> None:
        self.channels, self.grid, self.rows = channels, grid, rows
        self.attitude = [channels.at(name, grid.t, {}) for name in ("roll", "pitch", "yaw")]
        self.smooth = [grid.low(one) for one in self.attitude]
        self.rates, self.known = attitude_rates(channels, grid)
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
        heading = values.get("heading", 0.0)
        roll, pitch, yaw = self.attitude
        told = grid.low(ned_rows(roll, pitch, yaw + heading, v))
        arm = np.array([values.get(f"arm.{axis}", 0.0) for axis in "xyz"])
        if arm.any():
            roll, pitch, yaw = self.smooth
            told = told - ned_rows(roll, pitch, yaw + heading, np.cross(self.rates, arm))
        return rate - told[:, list(self.rows)], seen & known & self.known

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
        rates, self.known = attitude_rates(channels, grid)
        self.reference = rates[:, ["pqr".index(name) for name in names]]

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
