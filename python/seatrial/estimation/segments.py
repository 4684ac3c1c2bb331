"""Segments of a stage: pieces of its trials, each restarted from a smoothed measured state.

A long open-loop run drifts away whatever the model; the error of a piece of some seconds is the coefficients'
own. What is held out of the fit lies in no segment.

Step of a stage: an integer division of the log's step, the same for every candidate.

RK4 is stable to h|lambda| = 2.8; at h|lambda| <= 0.25 its error stays below the sensors' noise. The bound on
the fastest rate lambda is sought over the whole bounds box before the search: velocity and attitude dynamics
are linearised by finite differences at the largest measured speeds, for every coefficient at either bound and
for the worst of them together. One step for all makes a candidate's cost independent of its company.

The global search only ranks candidates: it takes h|lambda| <= 1, stable everywhere in the box. The fine
search flies its best ones again at h|lambda| <= 0.25, the bound sought over the part of the box around them:
corners of the whole box hold vehicles several times as fast as those that follow the log.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES, CHANNELS, deviations
from seatrial.base.errors import CampaignError, SeatrialError
from seatrial.campaign.file import Stage
from seatrial.campaign.parameters import Parameter

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.campaign.campaign import Campaign
    from seatrial.trial.trial import Trial

__all__ = [
    "RATE_LIMIT",
    "SEARCH_RATE_LIMIT",
    "Segment",
    "StageData",
    "StageStep",
    "around",
    "cut",
    "stage_step",
]


@dataclass(frozen=True)
class Segment:
    """Samples ``start`` to ``stop`` (exclusive) of a trial and the state at its start."""

    trial: int
    start: int
    stop: int
    position: tuple[float, ...]
    attitude: tuple[float, ...]
    nu: tuple[float, ...]


@dataclass(frozen=True)
class StageData:
    """What a stage is fitted to.

    ``counted`` holds a mask (n, 12) per trial of the samples in the criterion, ``counts`` their number (12,)
    over all segments, ``scale`` the standard deviation (12,) of each channel over them, ``weights`` (12,) the
    campaign's weights, zero for a channel that does not count.
    """

    names: tuple[str, ...]
    trials: tuple[Trial, ...]
    segments: tuple[Segment, ...]
    counted: tuple[NDArray[np.bool_], ...]
    counts: Array
    scale: Array
    weights: Array

    @property
    def samples(self) -> int:
        """Samples integrated for one candidate."""
        return sum(segment.stop - segment.start for segment in self.segments)

    @property
    def dt(self) -> float:
        """Longest step of the trials' time bases, s."""
        return max(trial.dt for trial in self.trials)

    def largest_speeds(self) -> Array:
        """Largest measured speed (6,) per axis over the training part, m/s and rad/s."""
        speeds = [
            np.nanquantile(np.abs(trial.nu[mask.any(axis=1)]), 0.999, axis=0)
            for trial, mask in zip(self.trials, self.counted, strict=True)
        ]
        return np.asarray(np.nan_to_num(np.max(speeds, axis=0)))


def cut(campaign: Campaign, stage: Stage) -> StageData:
    """Training data of a stage, cut into segments.

    Raises
    ------
    CampaignError
        A channel is missing or does not move, everything is held out, or no segment fits.
    """
    where = campaign.where(stage)
    weights = np.array([stage.weights().get(channel, 0.0) for channel in CHANNELS])
    counting = weights > 0
    trials, segments, counted = [], [], []
    for index, name in enumerate(stage.trials):
        trial = campaign.trials[name]
        _check_channels(stage, trial, where)
        training = ~campaign.held_out(name)
        if not training.any():
            raise CampaignError(
                f"{where}: the hold-out of trial {name!r} covers all of it; leave a part to fit to"
            )
        pieces = _pieces(trial, training, stage, index)
        longest = max((piece.stop - piece.start for piece in pieces), default=0)
        if longest < _length(stage, trial):
            raise CampaignError(
                f"{where}, key segment_s: trial {name!r} has no piece of {stage.segment_s:g} s that is not"
                f" held out and starts from valid samples; its training part lasts"
                f" {training.sum() * trial.dt:g} s. Shorten segment_s or give a longer trial"
            )
        trials.append(trial)
        segments += pieces
        counted.append(trial.valid & training[:, None] & counting)
    scale = _scale(trials, counted)
    for channel, one, counts in zip(CHANNELS, scale, counting, strict=True):
        if counts and not one > 0:
            raise CampaignError(
                f"{where}, key channels: channel {channel!r} never moves in the training part of"
                f" {', '.join(stage.trials)}, so it cannot be scaled; leave it out"
            )
    counts = np.zeros(len(CHANNELS))
    for piece in segments:
        counts += counted[piece.trial][piece.start + 1 : piece.stop].sum(axis=0)
    return StageData(stage.trials, tuple(trials), tuple(segments), tuple(counted), counts, scale, weights)


def _check_channels(stage: Stage, trial: Trial, where: str) -> None:
    has = f"it has {', '.join(trial.channels) or 'none'}"
    for channel in stage.weights():
        if channel not in trial.channels:
            raise CampaignError(
                f"{where}, key channels: trial {trial.name!r} has no channel {channel!r}; {has}."
                " Leave the channel out or map a column to it"
            )
    for axis in stage.axes.measured:
        channel = CHANNELS[AXES.index(axis)]
        if channel not in trial.channels:
            raise CampaignError(
                f"{where}, key axes: axis {axis} is measured but trial {trial.name!r} has no channel"
                f" {channel!r}; {has}. Freeze the axis or map a column to the channel"
            )


def _length(stage: Stage, trial: Trial) -> int:
    """Samples of a whole segment, both ends included."""
    return max(round(stage.segment_s / trial.dt), 1) + 1


def _pieces(trial: Trial, training: NDArray[np.bool_], stage: Stage, index: int) -> list[Segment]:
    """Segments of one trial; the last one before a gap may be shorter, down to half."""
    length = _length(stage, trial)
    overlap = round(stage.overlap_s / trial.dt)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], training.astype(np.int8), [0]])))
    pieces = []
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        start = int(first)
        while True:
            ahead = np.flatnonzero(trial.startable[start:end])
            if not len(ahead):
                break
            start += int(ahead[0])
            stop = min(start + length, int(end))
            if stop - start < max(length // 2, 2):
                break
            state = [tuple(map(float, part)) for part in trial.state(start)]
            pieces.append(Segment(index, start, stop, *state))
            start = max(stop - 1 - overlap, start + 1)
            if stop == end:
                break
    return pieces


def _scale(trials: list[Trial], counted: list[NDArray[np.bool_]]) -> Array:
    """Standard deviation (12,) of each channel about its mean in each trial, pooled over the trials."""
    squares, counts = np.zeros(len(CHANNELS)), np.zeros(len(CHANNELS))
    for trial, mask in zip(trials, counted, strict=True):
        for channel in range(len(CHANNELS)):
            values = trial.observed[mask[:, channel], channel]
            if len(values):
                squares[channel] += (deviations(values, CHANNELS[channel]) ** 2).sum()
                counts[channel] += len(values)
    return np.sqrt(squares / np.maximum(counts, 1))


RATE_LIMIT = 0.25
"""Largest h|lambda|."""

SEARCH_RATE_LIMIT = 1.0
"""Largest h|lambda| in the global search."""

_NEAR = 0.1

_MARGIN = 1.1

_SPEED_MARGIN = 1.2

_MOST_SUBSTEPS = 100

_DIFFERENCE = 1e-4


@dataclass(frozen=True)
class StageStep:
    """Substeps per sample of the log and the bound that asked for them, rad/s.

    ``search`` are the substeps of the global search, at most as many.
    """

    substeps: int
    rate: float
    search: int


def stage_step(
    vehicle: Vehicle, parameters: Sequence[Parameter], *, free: str, speeds: Array, dt: float, where: str
) -> StageStep:
    """Step for a vehicle whose parameters roam their bounds.

    Parameters
    ----------
    vehicle : Vehicle
    parameters : sequence of Parameter
        All that may differ from the vehicle's values, those of former stages included.
    free : str
        Letters of the free axes.
    speeds : ndarray, shape (6,)
        Largest measured speeds, m/s and rad/s.
    dt : float
        Step of the log, s.
    where : str
        Words for messages.

    Raises
    ------
    CampaignError
        The bounds admit a vehicle so light or so damped that no reasonable step follows it.
    """
    points = _operating_points(_SPEED_MARGIN * speeds)
    axes = [AXES.index(letter) for letter in free]

    def rate(values: dict[str, float]) -> float:
        try:
            return _fastest_rate(vehicle.with_coefficients(values), points, axes)
        except SeatrialError:
            return 0.0  # no vehicle at this corner: such a candidate diverges whatever the step

    worst: dict[str, float] = {}
    rates = [rate({})]
    for parameter in parameters:
        ends = [parameter.coefficients(bound) for bound in (parameter.lower, parameter.upper)]
        found = [rate(end) for end in ends]
        rates += found
        worst |= ends[int(np.argmax(found))]
    rates.append(rate(worst))
    bound = _MARGIN * max(rates)
    substeps, search = (max(math.ceil(dt * bound / limit), 1) for limit in (RATE_LIMIT, SEARCH_RATE_LIMIT))
    if substeps > _MOST_SUBSTEPS:
        raise CampaignError(
            f"{where}: the bounds admit a vehicle with a rate of {bound:.3g} rad/s, which needs {substeps}"
            f" steps per sample of {dt:g} s; keep the bounds of the inertias and added masses away from zero"
            " mass, or narrow those of the damping"
        )
    return StageStep(substeps, bound, search)


def around(parameters: Sequence[Parameter], points: Array) -> tuple[Parameter, ...]:
    """Parameters whose bounds are narrowed to points (k, m) and a tenth of the box on either side."""
    narrowed = []
    for parameter, values in zip(parameters, points.T, strict=True):
        margin = _NEAR * (parameter.upper - parameter.lower)
        lower = max(parameter.lower, float(values.min()) - margin)
        upper = min(parameter.upper, float(values.max()) + margin)
        narrowed.append(replace(parameter, lower=lower, upper=upper))
    return tuple(narrowed)


def _operating_points(speeds: Array) -> Array:
    """Velocities (n, 6): at rest, each axis alone, all axes with several signs."""
    signs = [(1, 1, 1, 1, 1, 1), (1, 1, 1, -1, -1, -1), (1, -1, 1, 1, -1, 1), (-1, 1, 1, -1, 1, 1)]
    rows = [np.zeros(6), *np.diag(speeds), *-np.diag(speeds), *(np.array(sign) * speeds for sign in signs)]
    return np.array(rows)


def _fastest_rate(vehicle: Vehicle, points: Array, axes: list[int]) -> float:
    """Largest |eigenvalue| of the free axes' velocity and attitude dynamics, rad/s."""
    n = len(points)
    nu = np.repeat(points, 18, axis=0).reshape(n, 18, 6)
    attitude = np.zeros((n, 18, 4))
    attitude[..., 0] = 1.0
    for j in range(6):
        nu[:, 2 * j, j] += _DIFFERENCE
        nu[:, 2 * j + 1, j] -= _DIFFERENCE
    for j in range(3):
        attitude[:, 12 + 2 * j, 1 + j] = 0.5 * _DIFFERENCE
        attitude[:, 13 + 2 * j, 1 + j] = -0.5 * _DIFFERENCE
    acceleration = vehicle.acceleration(
        nu.reshape(-1, 6), attitude.reshape(-1, 4), np.zeros((n * 18, 6))
    ).reshape(n, 9, 2, 6)
    slope = (acceleration[:, :, 0] - acceleration[:, :, 1]) / (2 * _DIFFERENCE)
    mass = np.asarray(vehicle.mass_matrix())
    force = np.einsum("ij,nkj->nik", mass, slope)  # (n, 6 forces, 9 states: nu and a small rotation)
    force[:, :, :6] += _inflow(vehicle)
    reduced = np.linalg.solve(mass[np.ix_(axes, axes)], force[:, axes, :])
    turning = [axis for axis in axes if axis >= 3]
    columns = [*axes, *(axis + 3 for axis in turning)]
    system = np.zeros((n, len(columns), len(columns)))
    system[:, : len(axes)] = reduced[:, :, columns]
    for row, axis in enumerate(turning):
        system[:, len(axes) + row, axes.index(axis)] = 1.0
    return float(np.abs(np.linalg.eigvals(system)).max())


def _inflow(vehicle: Vehicle) -> Array:
    """Force per velocity (6, 6) that the inflow costs the thrusters at full revolutions: p2 |n| w w'."""
    total = np.zeros((6, 6))
    values = vehicle.coefficients()
    for name, facts in vehicle.actuator_info().items():
        p2 = values.get(f"{name}.p2", 0.0)
        if p2 and facts["unit"] == "rpm":
            fastest = max(abs(facts["maximum_ahead"]), abs(facts["maximum_astern"])) / 60.0
            wrench = np.asarray(facts["wrench"], dtype=float)
            total += p2 * fastest * np.outer(wrench, wrench)
    return total
