"""Segments of a stage: pieces of its trials, each restarted from a smoothed measured state.

A long open-loop run drifts away whatever the model; the error of a piece of some seconds is the coefficients'
own. What is held out of the fit lies in no segment.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.campaign_file import AXES, Stage
from seatrial.channel import deviations
from seatrial.errors import CampaignError
from seatrial.recording.columns import CHANNELS
from seatrial.search import Array

if TYPE_CHECKING:
    from seatrial.campaign import Campaign
    from seatrial.trial import Trial


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
    where = campaign.place(stage)
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
