"""Records of trials, cut into segments and replayed by a vehicle: the one place that compares model and log.

A long open-loop run drifts away whatever the model. A record is therefore cut into segments of some seconds;
each restarts from the smoothed measured state and is driven by what was recorded. Stages, the joint estimate,
`seatrial.score` and the check of a mission's log all compare this way. They differ in the weights, the loss
and the coefficients that vary, which they give at the call.

Angles are compared the shorter way round; samples that do not count have the error zero.

Tests: ``tests/scoring/test_score.py``, ``tests/estimation/test_step.py`` and
``tests/estimation/test_polish.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeAlias, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import CHANNELS
from seatrial.base.frames import shorter
from seatrial.trial.trial import Input, Trial

if TYPE_CHECKING:
    from seatrial._core import OpenLoop, Vehicle
    from seatrial._core import Record as CoreRecord


@dataclass(frozen=True, eq=False)
class Record:
    """A trial as a model is compared with it: what drives the model, and the samples (n, 12) that count."""

    trial: Trial
    input: Input
    counted: Mask
    _packed: dict[tuple[int, bool], CoreRecord] = field(default_factory=dict, init=False, repr=False)

    def packed(
        self, *, substeps: int = 1, motion: bool = False, weight: ArrayLike | None = None
    ) -> CoreRecord:
        """The record as the core reads it, with integration steps per sample.

        Measured velocities, which only replayed axes need (`motion`), are given at the half steps. `weight`
        (12,) is that of the channels in the core's sum of errors; one when omitted. Raises TrialError if the
        input was not recorded.
        """
        if weight is None and (substeps, motion) in self._packed:  # as every simulation asks for it
            return self._packed[substeps, motion]
        weights = np.where(self.counted, 1.0 if weight is None else np.asarray(weight), 0.0)
        packed = self.trial.record(weight=weights, substeps=substeps, input=self.input, motion=motion)
        if weight is None:
            self._packed[substeps, motion] = packed
        return packed

    def __getstate__(self) -> dict[str, Any]:
        """What the core reads is packed again where it is needed."""
        return self.__dict__ | {"_packed": {}}


@dataclass(frozen=True)
class Segment:
    """Samples ``start`` to ``stop`` (exclusive) of a record, by its place, and the state at its start."""

    record: int
    start: int
    stop: int
    position: tuple[float, ...]
    attitude: tuple[float, ...]
    nu: tuple[float, ...]


def cut_spans(
    trial: Trial, first: int, end: int, length: int, *, overlap: int = 0, shortest: int = 2
) -> list[tuple[int, int]]:
    """Spans (start, stop) of a part of a trial, one after the other; the last may be shorter.

    A span starts at the first sample from which it may (`Trial.startable`) once the one before has ended.
    Neighbours share the sample between them, and `overlap` more. No span runs on where the command is unknown
    (`Trial.silent`). The part excludes `end`; `length` and `shortest` are samples of a whole span and of the
    last one.
    """
    starts = np.flatnonzero(trial.startable)
    spans: list[tuple[int, int]] = []
    planned = first
    while planned < end:
        following = starts[np.searchsorted(starts, planned) :]
        if not len(following) or following[0] >= end:
            break
        start = int(following[0])
        stop = min(start + length, end)
        if trial.silent is not None and trial.silent[start:stop].any():
            stop = start + int(np.argmax(trial.silent[start:stop]))
            if stop - start >= shortest:
                spans.append((start, stop))
            planned = stop
            continue
        if stop - start < shortest:
            break
        spans.append((start, stop))
        if stop == end:
            break
        planned = max(stop - 1 - overlap, start + 1)
    return spans


def restarted(trial: Trial, spans: Sequence[tuple[int, int]], record: int = 0) -> list[Segment]:
    """Segments of spans (start, stop), each from the smoothed measured state at its start."""
    if not spans:
        return []
    states = (part.tolist() for part in trial.state(np.array([start for start, _ in spans])))
    return [
        Segment(record, start, stop, *map(tuple, state))
        for (start, stop), *state in zip(spans, *states, strict=True)
    ]


class Varied(TypedDict, total=False):
    """What derivatives are by beside coefficients, and what is added, as of `Replay.simulated`."""

    nuisances: Sequence[str]
    initials: Sequence[str]
    nuisance: ArrayLike | None
    initial: ArrayLike | None


Starts: TypeAlias = tuple[Array, Array, Array, Array]
"""Positions (k, 3), attitudes (k, 4), velocities (k, 6) and steady currents (k, 3) of segments."""


@dataclass(frozen=True, eq=False)
class Replay:
    """What a vehicle shows on the segments of records, and how far that is from what was measured.

    `vehicle`: gives all coefficients that are not varied. `names`: coefficients that vary, in the order of
    the values (m,). `free`, `measured`: letters of the axes that are simulated, and of those replayed from
    the record; others keep the velocity of the segment's start. `substeps`: steps of the integration per
    sample. `threads`: of the core, all when None; no result depends on it. `starts_count`: whether the first
    sample of a segment counts; by default not, the smoothed start is made of it. `starts`: what the segments
    start with in place of their own (`along`).
    """

    vehicle: Vehicle
    records: tuple[Record, ...]
    segments: tuple[Segment, ...]
    names: tuple[str, ...] = ()
    free: str = "XYZKMN"
    measured: str = ""
    substeps: int = 1
    threads: int | None = None
    starts_count: bool = False
    starts: Starts | None = None
    _loops: dict[Any, OpenLoop] = field(default_factory=dict, init=False, repr=False)

    def counted(self, index: int) -> Mask:
        """Samples (n, 12) of a segment that count."""
        segment = self.segments[index]
        mask = self.records[segment.record].counted[segment.start : segment.stop]
        if not self.starts_count:
            mask = mask.copy()
            mask[0] = False
        return mask

    def simulated(
        self, values: ArrayLike = (), *, nuisance: ArrayLike | None = None, initial: ArrayLike | None = None
    ) -> list[Array]:
        """Channels (n, 12) per segment that the vehicle shows, SI, with values (m,) of the coefficients that
        vary.

        Nuisance parameters (records, 38) and initial conditions (segments, 12), in the core's order, are
        added to the record and to the smoothed start; zero when omitted.
        """
        loop = self._loop()
        shown = loop.predict(np.asarray(values, float), nuisance, initial, threads=self.threads)
        return [np.asarray(part) for part in shown]

    def residuals(
        self, values: ArrayLike = (), *, nuisance: ArrayLike | None = None, initial: ArrayLike | None = None
    ) -> list[Array]:
        """Measured minus simulated (n, 12) per segment, SI, zero where it does not count.

        Parameters are those of `simulated`.
        """
        return self.errors_of(self.simulated(values, nuisance=nuisance, initial=initial))

    def errors_of(self, simulated: Sequence[Array]) -> list[Array]:
        """Measured minus what was simulated (n, 12) per segment, SI, zero where it does not count."""
        return [self._error(index, shown) for index, shown in enumerate(simulated)]

    def sensitivities(
        self,
        values: ArrayLike,
        directions: ArrayLike,
        *,
        channels: Sequence[str] = CHANNELS,
        **varied: Unpack[Varied],
    ) -> list[tuple[Array, Array]]:
        """Residuals (n, 12) and exact derivatives (n, channels, d) of what is simulated, per segment.

        The derivatives are by directions of the coefficients (k, m), then by `nuisances`, then by `initials`;
        zero where the sample does not count. Other parameters are those of `simulated`.
        """
        columns = [CHANNELS.index(channel) for channel in channels]
        shown, slopes = self.tangents(values, directions, channels=channels, **varied)
        errors = []
        edges = np.cumsum([0, *(segment.stop - segment.start for segment in self.segments)])
        for index, rows in enumerate(map(slice, edges, edges[1:])):
            mask = self.counted(index)[:, columns]
            own = slopes[rows] if mask.all() else np.where(mask[:, :, None], slopes[rows], 0.0)
            errors.append((self._error(index, shown[rows]), own))
        return errors

    def tangents(
        self,
        values: ArrayLike,
        directions: ArrayLike,
        *,
        channels: Sequence[str] = CHANNELS,
        **varied: Unpack[Varied],
    ) -> tuple[Array, Array]:
        """Channels (samples, 12) and their exact derivatives (samples, channels, d), whatever was measured.

        Of all segments in a row. Parameters are those of `sensitivities`.
        """
        return self._loop().tangents(values, directions, channels=channels, threads=self.threads, **varied)

    def along(self, starts: Starts) -> Replay:
        """The same segments from other starts, each in a steady current of its own besides the logged one."""
        other = replace(self, starts=starts)
        other._loops[None] = self._loop().along(*starts)
        return other

    def losses(self, values: ArrayLike, *, weight: Array, loss: str, knee: float) -> Array:
        """Sums (k, segments, 12) of ``loss(weight * error)`` for candidates (k, m), infinite if diverged.

        `weight` is per channel (12,) in inverse SI units; the loss is "absolute", "squared" or "huber" with
        its knee.
        """
        return np.asarray(self._loop(weight, loss, knee).errors(values, threads=self.threads))

    def _error(self, index: int, shown: Array) -> Array:
        segment = self.segments[index]
        observed = self.records[segment.record].trial.observed[segment.start : segment.stop]
        with np.errstate(invalid="ignore", over="ignore"):  # a simulation that diverged
            error = np.where(self.counted(index), observed - shown, 0.0)
            if not np.abs(error[:, 9:]).max(initial=0.0) < np.pi:
                error[:, 9:] = shorter(error[:, 9:])
        return error

    def _loop(self, weight: Array | None = None, loss: str = "absolute", knee: float = 1.0) -> OpenLoop:
        """The core's batch for a weight and a loss; what it simulates depends on neither."""
        from seatrial._core import OpenLoop

        key = None if weight is None else (weight.tobytes(), loss, knee)
        if key not in self._loops:
            records = [
                record.packed(substeps=self.substeps, motion=bool(self.measured), weight=weight)
                for record in self.records
            ]
            loop = OpenLoop(
                self.vehicle,
                records,
                [(s.record, s.start, s.stop, s.position, s.attitude, s.nu) for s in self.segments],
                names=self.names,
                free=self.free,
                measured=self.measured,
                loss=loss,
                knee=knee,
                substeps=self.substeps,
            )
            self._loops[key] = loop if self.starts is None else loop.along(*self.starts)
        return self._loops[key]

    def __getstate__(self) -> dict[str, Any]:
        """The core's batches are packed again where they are needed."""
        return self.__dict__ | {"_loops": {}}
