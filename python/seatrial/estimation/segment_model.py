"""Problem of an estimation: the records of a stage, cut into segments, and the parameters that are free.

A stage and the joint estimate ask the same of it: what do candidates show on the segments, how far is that
from what was measured, and how does it change with the parameters? What they make of the answers (weights,
losses, priors, nuisance parameters) is theirs. What is held out of the fit lies in no segment.

Tests: ``tests/campaign/test_campaign.py``, ``tests/estimation/test_step.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array, Mask, runs
from seatrial.base.channels import AXES, CHANNELS, deviations
from seatrial.base.errors import CampaignError
from seatrial.problem.parameter import Parameter, coefficient_names, expansion_matrix
from seatrial.problem.settings import Stage
from seatrial.scoring.record import Record, Replay, Segment, cut_spans, restarted

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.problem.problem import Problem
    from seatrial.trial.trial import Trial


@dataclass(frozen=True)
class StageData:
    """What a stage is fitted to.

    ``records`` hold the trials and the samples in the criterion, ``counts`` their number (12,) over all
    segments, ``scale`` the standard deviation (12,) of each channel over them, ``weights`` (12,) the
    campaign's weights, zero for a channel that does not count.
    """

    names: tuple[str, ...]
    records: tuple[Record, ...]
    segments: tuple[Segment, ...]
    counts: Array
    scale: Array
    weights: Array

    @property
    def trials(self) -> tuple[Trial, ...]:
        """Trials of the records."""
        return tuple(record.trial for record in self.records)

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
            np.nanquantile(np.abs(record.trial.nu[record.counted.any(axis=1)]), 0.999, axis=0)
            for record in self.records
        ]
        return np.asarray(np.nan_to_num(np.max(speeds, axis=0)))

    def of_segments(self, places: Sequence[int]) -> StageData:
        """The same data with some of the segments, by their places; the scale stays."""
        segments = tuple(self.segments[place] for place in places)
        return replace(self, segments=segments, counts=_counts(self.records, segments))


def cut(problem: Problem, stage: Stage) -> StageData:
    """Training data of a stage, cut into segments.

    Raises CampaignError: a channel is missing or does not move, everything is held out, or no segment fits.
    """
    where = problem.where(stage)
    weights = np.array([stage.weights().get(channel, 0.0) for channel in CHANNELS])
    counting = weights > 0
    records: list[Record] = []
    segments: list[Segment] = []
    for index, name in enumerate(stage.trials):
        record, pieces = _of_trial(problem, stage, name, index)
        records.append(record)
        segments += pieces
    scale = _scale(records)
    for channel, weight, counts in zip(CHANNELS, scale, counting, strict=True):
        if counts and not weight > 0:
            raise CampaignError(
                f"{where}, key channels: channel {channel!r} never moves in the training part of"
                f" {', '.join(stage.trials)}, so it cannot be scaled; leave it out"
            )
    counts = _counts(records, segments)
    return StageData(stage.trials, tuple(records), tuple(segments), counts, scale, weights)


def _counts(records: Sequence[Record], segments: Sequence[Segment]) -> Array:
    """Number (12,) of samples that count, in each channel over all segments."""
    counts = np.zeros(len(CHANNELS))
    for piece in segments:
        counts += records[piece.record].counted[piece.start + 1 : piece.stop].sum(axis=0)
    return counts


def unfit_trials(problem: Problem, stage: Stage) -> dict[str, str]:
    """Trials of a stage that cannot be cut into its segments, and why."""
    reasons = {}
    for name in stage.trials:
        try:
            _of_trial(problem, stage, name, 0)
        except CampaignError as error:
            reasons[name] = str(error)
    return reasons


def _of_trial(problem: Problem, stage: Stage, name: str, index: int) -> tuple[Record, list[Segment]]:
    """Record and segments of one trial of a stage."""
    trial, where = problem.trials[name], problem.where(stage)
    _check_channels(stage, trial, where)
    training = ~problem.held_out(name)
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
            f" {training.sum() * trial.dt:g} s. A trial needs at least {stage.segment_s:g} s (segment_s) in"
            " one piece besides what is held out: give a longer one or shorten segment_s"
        )
    counting = np.array([stage.weights().get(channel, 0.0) for channel in CHANNELS]) > 0
    return Record(trial, problem.input_of(name), trial.valid & training[:, None] & counting), pieces


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
    pieces: list[Segment] = []
    for first, end in runs(training):
        spans = cut_spans(trial, first, end, length, overlap=overlap, shortest=max(length // 2, 2))
        pieces += restarted(trial, spans, index)
    return pieces


def _scale(records: Sequence[Record]) -> Array:
    """Standard deviation (12,) of each channel about its mean in each trial, pooled over the trials."""
    squares, counts = np.zeros(len(CHANNELS)), np.zeros(len(CHANNELS))
    for record in records:
        for channel in range(len(CHANNELS)):
            values = record.trial.observed[record.counted[:, channel], channel]
            if len(values):
                squares[channel] += (deviations(values, CHANNELS[channel]) ** 2).sum()
                counts[channel] += len(values)
    return np.sqrt(squares / np.maximum(counts, 1))


@dataclass(frozen=True, eq=False)
class SegmentModel:
    """Segments of records and the parameters that are free: what candidates show, and how far off."""

    #: Gives what the parameters do not set.
    vehicle: Vehicle
    #: Axes, and what is compared.
    stage: Stage
    data: StageData
    #: The free ones (m of them); each sets one coefficient or several.
    parameters: tuple[Parameter, ...]
    #: Steps of the integration per sample.
    substeps: int
    #: Threads of the core, all when None; no result depends on it.
    threads: int | None = None
    #: Whether the first sample of a segment counts, as it does where the initial conditions are free too.
    starts_count: bool = False
    _replays: dict[tuple[str, ...], Replay] = field(default_factory=dict, init=False, repr=False)

    def started(self, nu: Array) -> SegmentModel:
        """The same problem with segments that start at other velocities (segments, 6)."""
        moved = tuple(
            replace(segment, nu=tuple(map(float, row)))
            for segment, row in zip(self.data.segments, nu, strict=True)
        )
        return replace(self, data=replace(self.data, segments=moved))

    def counted(self, index: int) -> Mask:
        """Samples (n, 12) of a segment that count."""
        return self._replay().counted(index)

    def losses(self, candidates: Array, *, weight: Array, loss: str, knee: float) -> Array:
        """Sums (k, segments, 12) of ``loss(weight * error)`` for candidates (k, m), infinite if diverged."""
        return self._replay().losses(candidates @ self._spread, weight=weight, loss=loss, knee=knee)

    def residuals(
        self, values: Array, *, nuisance: Array | None = None, initial: Array | None = None
    ) -> list[Array]:
        """Measured minus simulated (n, 12) per segment, SI, zero where it does not count.

        ``nuisance``, ``initial``: as for `seatrial.scoring.record.Replay`.
        """
        return self._replay().residuals(values @ self._spread, nuisance=nuisance, initial=initial)

    def sensitivities(
        self, values: Array, *, extra: Sequence[str] = (), held: bool = False, **options: Any
    ) -> list[tuple[Array, Array]]:
        """Residuals (n, 12) and derivatives (n, channels, d) of what is simulated, per segment.

        ``extra``: coefficients that are not free but differentiated too, after the parameters. ``held``:
        whether to leave out the derivatives by the parameters, which are most of the work. ``options``:
        nuisances, initials and channels of `seatrial.scoring.record.Replay.sensitivities`.
        """
        inside, width = 0 if held else len(self.parameters), self._spread.shape[1]
        directions = np.zeros((inside + len(extra), width + len(extra)))
        directions[:inside, :width] = self._spread[:inside]
        directions[inside:, width:] = np.eye(len(extra))
        present = self.vehicle.coefficients()
        varied = [*(values @ self._spread), *(present.get(name, 0.0) for name in extra)]
        return self._replay(tuple(extra)).sensitivities(varied, directions, **options)

    @cached_property
    def _spread(self) -> Array:
        """Matrix (m, coefficients): parameters times it are coefficients."""
        return expansion_matrix(self.parameters)

    def _replay(self, extra: tuple[str, ...] = ()) -> Replay:
        """The replay whose coefficients are the parameters' and the extra ones."""
        if extra not in self._replays:
            self._replays[extra] = Replay(
                self.vehicle,
                self.data.records,
                self.data.segments,
                names=(*coefficient_names(self.parameters), *extra),
                free=self.stage.axes.free,
                measured=self.stage.axes.measured,
                substeps=self.substeps,
                threads=self.threads,
                starts_count=self.starts_count,
            )
        return self._replays[extra]
