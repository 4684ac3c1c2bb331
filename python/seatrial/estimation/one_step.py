"""The model over one sample, linearised about the smoothed measured motion of the training data.

``x[k+1] = xs[k+1] + g[k] + F[k] (x[k] - xs[k]) + C[k] c + T[k] (theta - theta0)`` with xs the smoothed
measured motion, g by how much one step of the model from xs[k] misses xs[k+1], c the velocity of the water
(north, east, besides what was recorded) and theta the unknowns. The state is what the instruments show:
velocities of the simulated axes over ground, their angles, and depth or position where they were measured.
All derivatives are those of the core's own step, by dual numbers; every sample is a segment of its own, so
that one call to the core gives them all. The error of the linearisation is of second order in what the
smoothing left of the sensors' noise.

Held by ``tests/estimation/test_innovations.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import AXES, CHANNELS, VELOCITIES
from seatrial.base.errors import CampaignError
from seatrial.base.rotation import from_euler, shorter, to_euler
from seatrial.campaign.parameters import coefficient_names, expansion_matrix
from seatrial.estimation.joint import Joint
from seatrial.trial.record import Record, Replay, Segment

__all__ = ["OneStep", "Span"]

_ANGLES = ("roll", "pitch", "yaw")
_SLOWER = 1.5
"""A sensor with longer intervals than so many rows of the time base is slower than it."""

_CURRENT = ("current_north", "current_east")


@dataclass(frozen=True)
class Span:
    """Training samples ``first`` to ``last`` (both included) of one trial, without a gap.

    ``measured`` (n, Y) are the measured channels minus the smoothed motion, ``valid`` which of them count.
    ``transition`` (n-1, S, S), ``current`` (n-1, S, 2), ``unknowns`` (n-1, S, m) and ``missed`` (n-1, S) are
    F, C, T and g.
    """

    record: int
    first: int
    last: int
    measured: Array
    valid: Mask
    transition: Array
    current: Array
    unknowns: Array
    missed: Array


class OneStep:
    """The model over one sample along the training or held-out data of a joint estimate.

    Parameters
    ----------
    joint : Joint
    held_out : bool

    Attributes
    ----------
    states
        Channels (S) of the state: velocities first.
    channels
        Those (Y) of them that were measured: a rate or velocity that was derived from the pose is not.

    Raises
    ------
    CampaignError
        No axis is simulated whose velocity or angle was measured.
    """

    def __init__(self, joint: Joint, *, held_out: bool = False) -> None:
        self.joint = joint
        free, data = joint.stage.axes.free, joint.data
        self.velocities = tuple(CHANNELS[AXES.index(letter)] for letter in free)
        angles = [angle for letter, angle in zip("KMN", _ANGLES, strict=True) if letter in free]
        readings = [_readings(record) for record in data.records]
        sensed = [mask for _, mask in readings]
        # Depth integrates heave, and where that is replayed the error of its sensor: it tells nothing then.
        moved = [place for place, axes in (("x", "XY"), ("y", "XY"), ("z", "Z")) if set(axes) & set(free)]
        places = [p for p in moved if any(mask[:, CHANNELS.index(p)].any() for mask in sensed)]
        self.states = (*self.velocities, *angles, *places)
        columns = [CHANNELS.index(name) for name in self.states]
        kept = [c for c in columns if any(mask[:, c].any() for mask in sensed)]
        self.channels = tuple(CHANNELS[c] for c in kept)
        if not self.channels:
            raise CampaignError(
                f'{joint.campaign.source}: joint, key method: "innovations" needs a measured velocity or'
                ' angle of a simulated axis and found none; use method = "output"'
            )
        self._columns, self._shown = columns, kept
        self._spans, self._segments = joint.steps(held_out=held_out)
        self._ends = [self._at(record, last) for record, _, last in self._spans]
        self._readings = readings

    def linearised(self, values: Array, extra: Sequence[str] = ()) -> list[Span]:
        """The spans with the derivatives at the values (m,) of the unknowns, further coefficients last."""
        joint, m = self.joint, len(self.joint.parameters)
        present = joint.vehicle.coefficients()
        spread = expansion_matrix(joint.parameters)
        directions = np.zeros((m + len(extra), spread.shape[1] + len(extra)))
        directions[:m, : spread.shape[1]] = spread
        directions[m:, spread.shape[1] :] = np.eye(len(extra))
        at = [*(values[:m] @ spread), *(present.get(name, 0.0) for name in extra)]
        found = self._replay(tuple(extra)).tangents(
            at,
            directions,
            nuisances=_CURRENT,
            initials=[f"initial_{name}" for name in self.states],
            channels=self.states,
        )
        columns, count = self._columns, m + len(extra)
        shown = np.array([channels[:, columns] for channels, _ in found])
        slopes = np.array([derivatives for _, derivatives in found])
        # The core turns the attitude about the body's axes; what that does to the angles is seen in the first
        # sample.
        back = np.linalg.inv(slopes[:, 0, :, count + 2 :])
        transition = slopes[:, 1, :, count + 2 :] @ back
        spans: list[Span] = []
        place = 0
        for record, first, last in self._spans:
            here = slice(place, place + last - first)
            place = here.stop
            start = shown[here, 0]
            path = np.vstack([start, self._ends[len(spans)]])
            missed = self._difference(shown[here, 1], path[1:])
            observed, mask = self._readings[record]
            rows = slice(first, last + 1)
            seen = [columns.index(c) for c in self._shown]
            measured = self._difference(observed[rows][:, self._shown], path[:, seen], seen)
            valid = mask[rows][:, self._shown] & np.isfinite(measured)
            spans.append(
                Span(
                    record,
                    first,
                    last,
                    np.where(valid, measured, 0.0),
                    valid,
                    transition[here],
                    slopes[here, 1, :, count : count + 2],
                    slopes[here, 1, :, :count],
                    missed,
                )
            )
        return spans

    def follow(self, deviations: Sequence[Array]) -> None:
        """Linearise along another motion from now on: what a smoother found (n, S) beside the present one.

        The smoothed log holds the noise of its sensors, and a derivative taken there is correlated with it.
        The iterated smoother (Bell 1994) takes derivatives along its own estimate.
        """
        segments, place = list(self._segments), 0
        for span, (found, (_, first, last)) in enumerate(zip(deviations, self._spans, strict=True)):
            for k in range(last - first):
                segments[place + k] = self._beside(segments[place + k], found[k])
            place += last - first
            self._ends[span] = self._ends[span] + found[-1]
        self._segments = tuple(segments)

    def _beside(self, segment: Segment, deviation: Array) -> Segment:
        """A segment that starts so far (S,) beside its start."""
        start = np.concatenate([segment.nu, segment.position, to_euler(segment.attitude)])
        start[self._columns] += deviation
        return replace(
            segment,
            nu=tuple(start[:6].tolist()),
            position=tuple(start[6:9].tolist()),
            attitude=tuple(from_euler(start[9:]).tolist()),
        )

    def _difference(self, one: Array, other: Array, places: Sequence[int] | None = None) -> Array:
        """One minus another (n, channels), angles the shorter way round."""
        found = np.asarray(one - other)
        names = self.states if places is None else [self.states[i] for i in places]
        for column, name in enumerate(names):
            if name in _ANGLES:
                found[:, column] = shorter(found[:, column])
        return found

    def _at(self, record: int, sample: int) -> Array:
        """Smoothed state (S,) of a sample as the instruments show it."""
        position, attitude, nu = self.joint.data.trials[record].state(sample)
        return np.concatenate([nu, position, to_euler(attitude)])[self._columns]

    def _replay(self, extra: tuple[str, ...]) -> Replay:
        joint = self.joint
        records = tuple(
            Record(record.trial, record.input, np.ones_like(record.counted)) for record in joint.data.records
        )
        return Replay(
            joint.vehicle,
            records,
            self._segments,
            names=(*coefficient_names(joint.parameters), *extra),
            free=joint.stage.axes.free,
            measured=joint.stage.axes.measured,
            substeps=joint.substeps,
            threads=joint.threads,
            starts_count=True,
        )


def _readings(record: Record) -> tuple[Array, Mask]:
    """Channels (n, 12) at the samples that an instrument gave, and the mask (n, 12) of these.

    What was derived from other channels is none, nor is what the time base interpolates between the samples
    of a slower sensor: an interpolation knows the next sample, which a prediction may not. A sample of such a
    sensor counts once, at the nearest row of the time base, moved there along the smoothed motion.
    """
    trial = record.trial
    observed, mask = trial.observed.copy(), trial.valid.copy()
    for finding in trial.report.findings:
        if finding.message.startswith("derived from"):
            mask[:, [CHANNELS.index(name) for name in finding.channel.split() if name in VELOCITIES]] = False
    absent = [index for index, name in enumerate(CHANNELS) if name not in trial.channels]
    mask[:, absent] = False
    for name, (stamps, values) in trial.samples.items():
        if len(stamps) < 2 or np.median(np.diff(stamps)) < _SLOWER * trial.dt:
            continue  # the time base has a sample of its own at nearly every row
        column = CHANNELS.index(name)
        inside = (stamps > trial.t[0] - trial.dt / 2.0) & (stamps < trial.t[-1] + trial.dt / 2.0)
        row = np.round((stamps[inside] - trial.t[0]) / trial.dt).astype(np.intp)
        own = np.zeros(len(trial), dtype=bool)
        own[row] = True
        mask[:, column] &= own
        if name in VELOCITIES:
            moved = trial.smooth_nu(trial.t[row])[0] - trial.smooth_nu(stamps[inside])[0]
            observed[row, column] = values[inside] + moved[:, VELOCITIES.index(name)]
    return observed, mask
