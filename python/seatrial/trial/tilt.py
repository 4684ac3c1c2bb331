"""Tilt of the pose's earth frame against gravity, from the attitude at different headings.

A vehicle at rest in the water holds one line of its body upright: c = [a, b, 1], its trim. Turned into an
earth frame of which z is gravity, ``R c`` points down at every heading. A frame that a motion-capture system
took from its own markers is a few degrees off: there ``R c = n`` at every heading, with n beside [0, 0, 1]
by the tilt, while trim turns with the vehicle. The first two rows are linear in a, b, n_1, n_2 and are
solved with bounded influence of what swings (Huber 1981). The uncertainty comes from leaving out one eighth
of the record at a time (jackknife). Held by the ``test_law_`` functions of tests/trial/test_tilt.py.

Uncorrected, gravity and buoyancy pull the model over by some newton metres that turn with the heading.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import DEGREE
from seatrial.base.rotation import matrix, product
from seatrial.trial.signals import RecordingReport, Signal

LARGEST = 10.0 * DEGREE
"""More is no tilt of a frame but another frame: it is reported and left."""

_SMALLEST = 0.5 * DEGREE  # what an attitude sensor or a marker frame may be off anyway

_CERTAIN = 5.0  # deviations

_WIDEST = 0.5 * DEGREE  # deviation of a tilt that is worth correcting

_CONCENTRATED = 0.95  # mean resultant length of headings that lie too close together, within some 40 deg

_HUBER = 1.3

_BLOCKS = 8

_SWEEPS = 20

_FEWEST = 200  # samples


@dataclass(frozen=True)
class Tilt:
    """Gravity's direction in the pose's frame, (2,) north and east of its z, rad, with its deviation, rad.

    ``trusted`` says whether to correct the frame.
    """

    direction: Array
    deviation: float
    trusted: bool

    @property
    def angle(self) -> float:
        """Angle between the frame's z and gravity, rad."""
        return float(np.arcsin(min(float(np.linalg.norm(self.direction)), 1.0)))

    @property
    def turn(self) -> Array:
        """Quaternion (4,) of the shortest rotation from the pose's frame to one whose z is gravity."""
        north, east = self.direction
        down = np.sqrt(max(1.0 - north**2 - east**2, 0.0))
        q = np.array([1.0 + down, east, -north, 0.0])
        return np.asarray(q / np.linalg.norm(q))


def level(
    signals: Mapping[str, Signal], report: RecordingReport, *, remove: bool = True
) -> dict[str, Signal]:
    """The same signals with position and attitude in a frame whose z is gravity, where the tilt is certain.

    Body velocities and rates do not depend on it. Without a whole position the attitude is taken for that of
    an inertial sensor, which knows gravity.
    """
    levelled = dict(signals)
    if "attitude" not in signals or "position" not in signals or len(signals["position"].channels) < 3:
        return levelled
    attitude = signals["attitude"]
    tilted = certain_tilt(attitude.y[attitude.good])
    if tilted is None:
        return levelled
    text = (
        f"the earth frame is tilted by {tilted.angle / DEGREE:.1f} deg"
        f" (+/- {tilted.deviation / DEGREE:.1f} deg) against gravity, as the measured attitude"
        " at different headings shows"
    )
    if not tilted.trusted or not remove:
        report.add("warning", "attitude", f"{text}; left as recorded")
        return levelled
    report.tilt = (float(tilted.direction[0]), float(tilted.direction[1]))
    report.add("info", "attitude", f"{text}; position and attitude turned upright")
    return turned_upright(levelled, tilted)


def turned_upright(signals: Mapping[str, Signal], tilted: Tilt) -> dict[str, Signal]:
    """The same signals with attitude and whole position in the frame whose z is gravity."""
    turned = dict(signals)
    attitude, position = signals["attitude"], signals["position"]
    turned["attitude"] = replace(attitude, y=product(tilted.turn, attitude.y))
    if len(position.channels) == 3:
        turned["position"] = replace(position, y=position.y @ matrix(tilted.turn).T)
    return turned


def certain_tilt(q: Array) -> Tilt | None:
    """Tilt of the frame of the quaternions (n, 4) if it is certainly more than a sensor may be off anyway."""
    tilted = tilt(q)
    if tilted is None or tilted.angle - _CERTAIN * tilted.deviation < _SMALLEST:
        return None
    return tilted


def tilt(q: Array) -> Tilt | None:
    """Tilt of the frame of the quaternions (n, 4); None if they are few or their headings lie together."""
    if len(q) < _FEWEST:
        return None
    turned = matrix(q)
    if np.hypot(turned[:, 0, 0].mean(), turned[:, 1, 0].mean()) > _CONCENTRATED:
        return None
    direction = _direction(turned)
    blocks = np.array_split(np.arange(len(q)), _BLOCKS)
    left_out = np.array([_direction(np.delete(turned, block, axis=0)) for block in blocks])
    scatter = (_BLOCKS - 1) / _BLOCKS * np.sum((left_out - left_out.mean(axis=0)) ** 2, axis=0)
    deviation = float(np.sqrt(scatter.max()))
    trusted = deviation < _WIDEST and float(np.linalg.norm(direction)) < np.sin(LARGEST)
    return Tilt(direction, deviation, trusted)


def _direction(turned: Array) -> Array:
    """Horizontal part (2,) of the upright line of the body in the earth frame, from rotations (n, 3, 3)."""
    n = len(turned)
    # Unknowns a, b (trim) and n_1, n_2 (tilt): the first two rows of R [a, b, 1] - n = 0.
    columns = np.zeros((2, n, 4))
    columns[:, :, :2] = turned[:, :2, :2].transpose(1, 0, 2)
    columns[0, :, 2] = columns[1, :, 3] = -1.0
    design, goal = columns.reshape(2 * n, 4), -turned[:, :2, 2].T.ravel()
    weight = np.ones(2 * n)
    solution: Array = np.zeros(4)
    for _ in range(_SWEEPS):
        normal = design.T @ (weight[:, None] * design)
        before = solution
        # Without its only turn a block's remainder may be singular: least norm, and a large deviation.
        solution = np.asarray(np.linalg.lstsq(normal, design.T @ (weight * goal), rcond=None)[0], float)
        if np.abs(solution - before).max() < 1e-9:
            break
        # Huber's weights: swinging at the turns of a zigzag must not pass for a tilt.
        residual = np.abs(goal - design @ solution)
        knee = _HUBER * 1.4826 * float(np.median(residual)) + 1e-12
        weight = 1.0 / np.maximum(residual / knee, 1.0)
    a, b = solution[:2]
    return np.asarray(solution[2:] / np.sqrt(1.0 + a * a + b * b))
