"""The recorded attitude: which convention it has, and how its earth frame is tilted against gravity.

*Convention*, from the gyro and from velocity, position and depth. A quaternion holds its scalar first or
last, turns the body into the earth frame or the earth into the body, and names its axes
forward-starboard-down and north-east-down or otherwise; four columns say none of it. Read with another
convention than its own it turns about other axes than the gyro shows. Its body rates (Fossen 2011, equation
2.26) depend on order, direction and body frame; the earth frame shows in the velocity, of which position or
depth are the integral. Every convention is tried, and one is told where it alone explains what moves and
the one that was read explains little. Where the gyro may be the one with another body frame and nothing
else tells, that is said. Held by ``tests/trial/test_attitude_convention.py``.

*Tilt*, from the attitude at different headings. A vehicle at rest in the water holds one line of its body
upright: c = [a, b, 1], its trim. Turned into an earth frame of which z is gravity, ``R c`` points down at
every heading. A frame that a motion-capture system took from its own markers is a few degrees off: there
``R c = n`` at every heading, with n beside [0, 0, 1] by the tilt, while trim turns with the vehicle. The
first two rows are linear in a, b, n_1, n_2 and are solved with bounded influence of what swings (Huber
1981). The uncertainty comes from leaving out one eighth of the record at a time (jackknife). Uncorrected,
gravity and buoyancy pull the model over by some newton metres that turn with the heading. Held by the
``test_law_`` functions of ``tests/trial/test_tilt.py``.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import DEGREE
from seatrial.base.frames import attitude_to_ned, conjugate, matrix, product
from seatrial.trial.kinematic_axes import LEAST_MOTION, band
from seatrial.trial.kinematics import Channels, Grid, differences, rotation_rates
from seatrial.trial.signals import RecordingReport, Signal


@dataclass(frozen=True)
class AttitudeSettings:
    """When another convention of the attitude or a tilt of its earth frame is believed."""

    right_share: float = 0.8  #: of the motion that the right convention explains at least
    wrong_share: float = 0.4  #: of the motion that a wrong convention explains at most
    clearly_worse: float = 2.0  #: another convention must leave so many times as much unexplained
    #: by which the mean of the vertical's cosine may fall: vehicles are upright, mostly
    upright_loss: float = 0.1
    telling_share: float = 0.5  #: that some convention must explain of a sensor for it to be asked
    equal_share: float = 1e-4  #: shares that differ by less are those of one convention
    largest_delay_s: float = 1.5  #: s, between the sensors where they are compared
    #: rad: an attitude sensor or a frame of markers may be off by so much anyway
    smallest_tilt_rad: float = 0.5 * DEGREE
    certain_deviations: float = 5.0  #: deviations by which a tilt must differ from zero
    widest_deviation_rad: float = 0.5 * DEGREE  #: rad, deviation of a tilt that is worth correcting
    #: mean resultant length of headings within some 40 deg: they tell no tilt
    concentrated_headings: float = 0.95
    huber_deviations: float = 1.3  #: robust deviations from which a sample counts linearly
    jackknife_blocks: int = 8  #: parts of the record that are left out in turn
    most_reweightings: int = 20  #: rounds of the weights at most
    fewest_samples: int = 200  #: fewer tell no tilt


SETTINGS = AttitudeSettings()


_ANGLES = ("roll", "pitch", "yaw")


_FRAMES = ("FRD/NED", "FLU/NWU", "FLU/ENU")
"""Pairs of body and earth frame in use: inside, ROS by the names of Beluga's bridge, ROS by REP 103."""


@dataclass(frozen=True)
class AttitudeConvention:
    """The convention of an attitude that was read as scalar first, body to earth, FRD to NED."""

    last: bool  #: Whether the scalar is the last of the four columns.
    inverse: bool  #: Whether it turns the earth into the body.
    frame: str  #: Body and earth frame, as a column map names them.
    #: Share of the motion that gyro and velocity show which it explains, and which the one read explains.
    share: float = 1.0
    before: float = 0.0
    #: Whether the gyro's frame may be the wrong one instead: nothing else in the log tells.
    either: bool = False
    frames: tuple[str, ...] = ()  #: All frames that explain it alike.

    @property
    def order(self) -> bool:
        """Whether nothing but the place of the scalar differs, so that four columns exchanged are right."""
        return self.last and not self.inverse and self.frame == _FRAMES[0]

    @property
    def facts(self) -> dict[str, Any]:
        """How it differs from the one read, and how sure that is, as values of a finding."""
        return {
            "scalar_last": self.last,
            "inverse": self.inverse,
            "frames": (self.frames or (self.frame,)) if self.frame != _FRAMES[0] else (),
            "gyro_instead": self.either,
            "share": self.share,
            "before": self.before,
        }

    @property
    def sentence(self) -> str:
        """The same in words."""
        words = importlib.import_module("seatrial.report.results.trial_findings")
        return str(words.convention(self.facts))


def as_convention(q: Array, convention: AttitudeConvention) -> Array:
    """Quaternions (n, 4), scalar first, body FRD to NED, of what was read so and has this convention."""
    turned = q[:, [3, 0, 1, 2]] if convention.last else q
    turned = conjugate(turned) if convention.inverse else turned
    return attitude_to_ned(turned, convention.frame, "attitude")


def attitude_convention(channels: Channels, *, quaternion: bool = True) -> AttitudeConvention | None:
    """The convention that an attitude of three angles has if it is not the one read; None where it is, or
    none is told. Of angles that are no `quaternion` only the frame is asked.
    """
    if not set(_ANGLES) <= set(channels.curves):
        return None
    read = AttitudeConvention(False, False, _FRAMES[0])
    witnesses = [witness for witness in (_by_gyro(channels), _by_velocity(channels)) if witness is not None]
    if not witnesses or min(witness.share(read) for witness in witnesses) > SETTINGS.wrong_share:
        return None
    several = _axes_moving(channels) > 1
    every = list(_conventions(several=several, quaternion=quaternion))
    shares = np.array([[witness.share(convention) for convention in every] for witness in witnesses])
    # What no convention explains has another fault, and tells nothing of this one.
    tells = shares.max(axis=1) > SETTINGS.telling_share
    if not tells.any():
        return None
    total = shares[tells].min(axis=0)
    best = int(np.argmax(total))
    if best == 0 or total[best] < SETTINGS.right_share or total[0] > SETTINGS.wrong_share:
        return None
    if _upright(witnesses[0], every[best]) < _upright(witnesses[0], read) - SETTINGS.upright_loss:
        return None
    # Earth frames that differ by a heading alone are one to gyro and depth: the first stands for both.
    alike = np.abs(shares[tells] - shares[tells][:, [best]]).max(axis=0) < SETTINGS.equal_share
    others = total[~alike]
    if 1.0 - float(others.max(initial=0.0)) < SETTINGS.clearly_worse * (1.0 - float(total[best])):
        return None
    only_gyro = [witness.of for witness, here in zip(witnesses, tells, strict=True) if here] == ["gyro"]
    chosen = every[best]
    return replace(
        chosen,
        share=float(total[best]),
        before=max(float(total[0]), 0.0),
        either=only_gyro and not chosen.last and not chosen.inverse,
        frames=tuple(
            every[k].frame
            for k in np.flatnonzero(alike)
            if (every[k].last, every[k].inverse) == (chosen.last, chosen.inverse)
        ),
    )


def _upright(witness: _Told, convention: AttitudeConvention) -> float:
    """Mean cosine between the body's vertical and the earth's."""
    q = as_convention(witness.channels.rotation(witness.grid.t), convention)
    return float(np.mean(matrix(q)[:, 2, 2]))


@dataclass(frozen=True)
class _Told:
    """One comparison: attitudes as read on a grid, and what another sensor shows."""

    of: str
    channels: Channels
    grid: Grid
    shown: Array
    good: Mask
    used: Array

    @cached_property
    def changes(self) -> Array:
        """What the sensor shows about its slow offsets, (n, k)."""
        return band(self.shown, self.good, self.grid)

    @cached_property
    def velocity(self) -> Array:
        """Body velocity (n, 3) on the grid, m/s."""
        return np.stack([self.channels.at(name, self.grid.t, {}) for name in "uvw"], axis=1)

    def share(self, convention: AttitudeConvention) -> float:
        """Share of what the sensor shows that the attitude in this convention explains, with its sign."""
        from scipy.fft import irfft, next_fast_len, rfft

        q = as_convention(self.channels.rotation(self.grid.t), convention)
        if self.of == "gyro":
            implied = self.grid.low(rotation_rates(q, self.grid), differenced=True)
        else:
            implied = self.grid.low(np.einsum("nij,nj->ni", matrix(q), self.velocity))
        implied = implied[:, self.used]
        a, b = band(implied, self.good, self.grid), self.changes
        # All axes in one sum and with their signs: an exchange or a reversal of one of them does not count.
        n, most = len(a), min(SETTINGS.largest_delay_s, 0.2 * float(np.ptp(self.grid.t)))
        reach = max(1, round(most / self.grid.step))
        size = next_fast_len(n + reach + 1, real=True)
        both = np.conj(rfft(a, size, axis=0)) * rfft(b, size, axis=0)
        across = irfft(np.sum(both, axis=1), size)
        best = float(max(across[: reach + 1].max(), across[-reach:].max()))
        cosine = best / (np.sqrt(float(np.sum(a**2)) * float(np.sum(b**2))) + 1e-300)
        return float(cosine * abs(cosine))


def _conventions(*, several: bool, quaternion: bool) -> Iterator[AttitudeConvention]:
    """Every convention, the one read first. Of a single axis (not `several`) only the place of the scalar: a
    yaw is reversed by inverse, frame with z up and the sign of a gyro alike.
    """
    for last in (False, True) if quaternion else (False,):
        for inverse in (False, True) if several and quaternion else (False,):
            for frame in _FRAMES if several else _FRAMES[:1]:
                yield AttitudeConvention(last, inverse, frame)


def _by_gyro(channels: Channels) -> _Told | None:
    names = [name for name in "pqr" if name in channels.curves]
    grid = channels.grid((*names, "roll", "pitch", "yaw"), 2.0) if names else None
    if grid is None:
        return None
    shown = grid.low(np.stack([channels.at(name, grid.t, {}) for name in names], axis=1))
    known = grid.inside(channels.known((*names, *_ANGLES), grid.t, {}))
    if _moving(shown, known, grid) < LEAST_MOTION["rates"]:
        return None
    return _Told("gyro", channels, grid, shown, known, np.array(["pqr".index(name) for name in names]))


def _by_velocity(channels: Channels) -> _Told | None:
    """Rates of depth, and of the position where it is known, against the velocity."""
    have = set(channels.curves)
    if not {"u", "w"} <= have or "z" not in have:
        return None
    rows = [0, 1, 2] if {"x", "y", "v"} <= have else [2]
    names = ["xyz"[k] for k in rows]
    grid = channels.grid((*names, "u", "v", "w", "roll", "pitch", "yaw"), 2.0)
    if grid is None:
        return None
    rate = differences(np.stack([channels.at(name, grid.t, {}) for name in names], axis=1), grid)
    shown = grid.low(rate, differenced=True)
    known = grid.inside(channels.known((*names, "u", "v", "w", *_ANGLES), grid.t, {}))
    if _moving(shown, known, grid) < LEAST_MOTION["velocity"]:
        return None
    return _Told("velocity", channels, grid, shown, known, np.array(rows))


def _moving(shown: Array, known: Mask, grid: Grid) -> float:
    """Root mean square of the changes of all axes together."""
    changes = band(shown, known, grid)[known]
    return float(np.sqrt(np.mean(np.sum(changes**2, axis=1)))) if len(changes) else 0.0


def _axes_moving(channels: Channels) -> int:
    """How many axes of the attitude, as read, or of the gyro turn by more than noise."""
    grid = channels.grid(("roll", "pitch", "yaw"), 2.0)
    if grid is None:
        return 0
    rates = [grid.low(rotation_rates(channels.rotation(grid.t), grid), differenced=True)]
    gyro = [name for name in "pqr" if name in channels.curves]
    if gyro:
        rates = [grid.low(np.stack([channels.at(name, grid.t, {}) for name in gyro], axis=1))]
    size = np.sqrt(np.mean(band(rates[0], np.ones(len(grid.t), bool), grid) ** 2, axis=0))
    return int(np.sum((size > LEAST_MOTION["rates"]) & (size > 0.05 * size.max())))


LARGEST = 10.0 * DEGREE
"""More is no tilt of a frame but another frame: it is reported and left."""


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
    Without a whole position the attitude is taken for that of an inertial sensor, which knows gravity.
    """
    levelled = dict(signals)
    if "attitude" not in signals or "position" not in signals or len(signals["position"].channels) < 3:
        return levelled
    attitude = signals["attitude"]
    tilted = certain_tilt(attitude.y[attitude.good])
    if tilted is None:
        return levelled
    size: dict[str, Any] = {"angle_deg": tilted.angle / DEGREE, "sd_deg": tilted.deviation / DEGREE}
    if not tilted.trusted or not remove:
        report.warning("frame tilted", "attitude", turned=False, **size)
        return levelled
    report.tilt = (float(tilted.direction[0]), float(tilted.direction[1]))
    report.info("frame tilted", "attitude", turned=True, **size)
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
    if (
        tilted is None
        or tilted.angle - SETTINGS.certain_deviations * tilted.deviation < SETTINGS.smallest_tilt_rad
    ):
        return None
    return tilted


def tilt(q: Array) -> Tilt | None:
    """Tilt of the frame of the quaternions (n, 4); None if they are few or their headings lie together."""
    if len(q) < SETTINGS.fewest_samples:
        return None
    turned = matrix(q)
    if np.hypot(turned[:, 0, 0].mean(), turned[:, 1, 0].mean()) > SETTINGS.concentrated_headings:
        return None
    direction = _direction(turned)
    blocks = np.array_split(np.arange(len(q)), SETTINGS.jackknife_blocks)
    left_out = np.array([_direction(np.delete(turned, block, axis=0)) for block in blocks])
    scatter = (
        (SETTINGS.jackknife_blocks - 1)
        / SETTINGS.jackknife_blocks
        * np.sum((left_out - left_out.mean(axis=0)) ** 2, axis=0)
    )
    deviation = float(np.sqrt(scatter.max()))
    trusted = deviation < SETTINGS.widest_deviation_rad and float(np.linalg.norm(direction)) < np.sin(LARGEST)
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
    for _ in range(SETTINGS.most_reweightings):
        normal = design.T @ (weight[:, None] * design)
        before = solution
        # Without its only turn a block's remainder may be singular: least norm, and a large deviation.
        solution = np.asarray(np.linalg.lstsq(normal, design.T @ (weight * goal), rcond=None)[0], float)
        if np.abs(solution - before).max() < 1e-9:
            break
        # Huber's weights: swinging at the turns of a zigzag must not pass for a tilt.
        residual = np.abs(goal - design @ solution)
        knee = SETTINGS.huber_deviations * 1.4826 * float(np.median(residual)) + 1e-12
        weight = 1.0 / np.maximum(residual / knee, 1.0)
    a, b = solution[:2]
    return np.asarray(solution[2:] / np.sqrt(1.0 + a * a + b * b))
