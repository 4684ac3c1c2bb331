"""The model over one sample, linearised about a smoothed motion, and the criterion of its prediction errors.

``x[k+1] = xs[k+1] + g[k] + F[k] (x[k] - xs[k]) + C[k] (c - cs[k]) + T[k] (theta - theta0)`` with xs a
smoothed motion, g by how much one step of the model from xs[k] misses xs[k+1], c the velocity of the water
(north, east, down, besides what was recorded; cs is the one that belongs to xs) and theta the unknowns. The
state is what the instruments show: velocities of the simulated axes over ground, their angles, and depth or
position where they were measured. All derivatives are those of the core's own step, by dual numbers; every
sample is a segment of its own, so that one call to the core gives them all. The error of the linearisation is
of second order in what the smoothing left of the sensors' noise.

The Gauss-Newton step d solves ``sum (Z' W S) d = sum Z' W e`` with e the prediction errors, S their slopes by
the unknowns, W the weight of Huber's loss and Z the instruments (`seatrial.estimation.instruments`); one
sample ahead Z is S.

Tests: ``tests/estimation/test_innovations.py``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import AXES, CHANNELS, VELOCITIES
from seatrial.base.errors import CampaignError
from seatrial.base.frames import from_euler, matrix, shorter, to_euler
from seatrial.estimation.joint import Joint
from seatrial.estimation.segment_model import STEP_SETTINGS
from seatrial.problem.parameter import coefficient_names, expansion_matrix
from seatrial.scoring.record import Record, Replay
from seatrial.statistics.linearisation import trust

_ANGLES = ("roll", "pitch", "yaw")


@dataclass(frozen=True)
class OneStepSettings:
    """How finely one sample is simulated, and which sensor is slower than it."""

    #: Rows of the time base within the interval of a sensor from which it is slower than the time base.
    slower: float = 1.5
    #: Largest h|lambda|: one sample needs fewer steps than a simulation of seconds; derivatives err by 0.3 %.
    rate_limit: float = 0.5
    #: Length of the blocks of time over which sums are taken for standard deviations, s.
    block_s: float = 20.0


ONE_STEP_SETTINGS = OneStepSettings()


_CURRENT = ("current_north", "current_east", "current_down")


@dataclass(frozen=True)
class Span:
    """Training samples ``first`` to ``last`` (both included) of one trial, without a gap.

    ``measured`` (n, Y) are the measured channels minus the motion at which derivatives are taken, ``valid``
    which of them count. ``transition`` (n-1, S, S), ``current`` (n-1, S, 3), ``unknowns`` (n-1, S, m) and
    ``missed`` (n-1, S) are F, C, T and g. ``water`` (n, 2) is the velocity of the water, north and east, that
    the derivatives are taken at. ``afloat`` (n, S, 3) is what a velocity of the water (north, east, down)
    adds to the states' velocities over ground, and to the rates of their places, where it carries the vehicle
    along. ``through`` (n, 2) is the velocity through that water, north and east, m/s. ``depth`` (n,) is the
    smoothed depth, m; NaN where none was measured.
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
    water: Array
    afloat: Array
    through: Array
    depth: Array


class Motion(NamedTuple):
    """Estimates along a span beside those that its derivatives were taken at.

    ``states`` (n, S) and the velocity of the ``water`` (n, 2) are smoothed; ``known`` (n, S) and
    ``known_water`` (n, 2) are what the filter knew at each sample.
    """

    states: Array
    water: Array
    known: Array
    known_water: Array


class _Motion(NamedTuple):
    """A motion along which derivatives are taken.

    Per segment, which is a sample, ``position`` (k, 3), ``attitude`` (k, 4) and velocities ``nu`` (k, 6); per
    record the velocity of the water (n, 3).
    """

    position: Array
    attitude: Array
    nu: Array
    water: tuple[Array, ...]


class Path(NamedTuple):
    """The motions that derivatives are taken along: smoothed, with the ``ends`` of its spans, and known."""

    smoothed: _Motion
    ends: tuple[Array, ...]
    known: _Motion


class OneStep:
    """The model over one sample along training data, held-out data or the whole trials of a joint estimate.

    `states` are the channels (S) of the state, velocities first, `channels` those (Y) of them that were
    measured: a rate or velocity that was derived from the pose is not. `path` holds the motions that
    derivatives are taken along from now on. Raises CampaignError: no axis is simulated whose velocity or
    angle was measured, or no trial is measured for long enough.
    """

    def __init__(self, joint: Joint, *, held_out: bool | None = False) -> None:
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
                f'{joint.problem.source}: joint, key method: "innovations" needs a measured velocity or'
                ' angle of a simulated axis and found none; use method = "output"'
            )
        self._columns, self._shown = columns, kept
        self._substeps = max(
            math.ceil(joint.substeps * STEP_SETTINGS.rate_limit / ONE_STEP_SETTINGS.rate_limit), 1
        )
        self._spans, self._segments = joint.steps(held_out=held_out)
        if not self._spans and not held_out:
            raise CampaignError(
                f'{joint.problem.source}: joint, key method: "innovations" needs'
                f" {joint.stage.segment_s:g} s of a trial without a long gap and found none; use method ="
                ' "output"'
            )
        states = [
            data.trials[record].state(np.arange(first, last)) for record, first, last in self._spans
        ] or [data.trials[0].state(np.arange(0))]
        position, attitude, nu = (np.concatenate(part) for part in zip(*states, strict=True))
        still = tuple(np.zeros((len(record.trial), 3)) for record in data.records)
        self._log = _Motion(position, attitude, nu, still)
        self._readings = readings
        self._replays: dict[tuple[str, ...], Replay] = {}
        self.follow_log()

    def linearised(self, values: Array, extra: Sequence[str] = ()) -> list[Span]:
        """The spans with the derivatives at the values (m,) of the unknowns, further coefficients last."""
        joint, m = self.joint, len(self.joint.parameters)
        present = joint.vehicle.coefficients()
        spread = expansion_matrix(joint.parameters)
        directions = np.zeros((m + len(extra), spread.shape[1] + len(extra)))
        directions[:m, : spread.shape[1]] = spread
        directions[m:, spread.shape[1] :] = np.eye(len(extra))
        at = [*(values[:m] @ spread), *(present.get(name, 0.0) for name in extra)]
        seen, slopes = self._replay(tuple(extra), self.path.smoothed).tangents(
            at,
            directions[:0],
            nuisances=_CURRENT,
            initials=[f"initial_{name}" for name in self.states],
            channels=self.states,
        )
        columns = self._columns
        # A segment has two samples.
        shown, slopes = (
            seen[:, columns].reshape(-1, 2, len(columns)),
            slopes.reshape(-1, 2, *slopes.shape[1:]),
        )
        waters = len(_CURRENT)
        # The core turns the attitude about the body's axes; what that does to the angles is seen in the first
        # sample.
        back = np.linalg.inv(slopes[:, 0, :, waters:])
        with np.errstate(invalid="ignore"):  # where the model diverges over a step
            transition = slopes[:, 1, :, waters:] @ back
        replay = self._replay(tuple(extra), self.path.known)
        unknowns = replay.tangents(at, directions, channels=self.states)[1][1::2]
        spans: list[Span] = []
        place = 0
        for record, first, last in self._spans:
            here = slice(place, place + last - first)
            place = here.stop
            path = np.vstack([shown[here, 0], self.path.ends[len(spans)]])
            missed = self._difference(shown[here, 1], path[1:])
            observed, mask = self._readings[record]
            rows = slice(first, last + 1)
            places = [columns.index(c) for c in self._shown]
            measured = self._difference(observed[rows][:, self._shown], path[:, places], places)
            valid = mask[rows][:, self._shown] & np.isfinite(measured)
            spans.append(
                Span(
                    record,
                    first,
                    last,
                    np.where(valid, measured, 0.0),
                    valid,
                    transition[here],
                    slopes[here, 1, :, :waters],
                    unknowns[here],
                    missed,
                    self.path.smoothed.water[record][rows, :2],
                    self._afloat(record, first, last),
                    self._through(record, first, last),
                    self._depth(record, first, last),
                )
            )
        return spans

    def known(self, record: int) -> tuple[tuple[Array, Array, Array], Array]:
        """What the filter knew at each sample of a record, from those before.

        Position (n, 3), attitude (n, 4) and velocities (n, 6), smoothed where they are no states, and the
        current (n, 3), NED in m/s, besides what was recorded.
        """
        states = tuple(part.copy() for part in self.joint.data.trials[record].state(slice(None)))
        place = 0
        for span_record, first, last in self._spans:
            here, place = slice(place, place + last - first), place + last - first
            if span_record == record:
                for part, own in zip(states, self.path.known[:3], strict=True):
                    part[first:last] = own[here]
        return (states[0], states[1], states[2]), self.path.known.water[record]

    def follow_log(self) -> None:
        """Linearise along the smoothed log from now on, in still water."""
        ends = tuple(self._at(record, last) for record, _, last in self._spans)
        self.path = Path(self._log, ends, self._log)

    def follow(self, motion: Sequence[Motion]) -> bool:
        """Linearise along another motion from now on, found beside the present one.

        The present one stays, and the answer is no, where the other is no motion: a model that diverges.

        The smoothed log holds the noise of its sensors, and a derivative taken there is correlated with it.
        The iterated smoother (Bell 1994) takes derivatives along its own estimate. Those by the unknowns are
        taken along what the filter knew at each sample, because a smoothed motion knows the errors that they
        are to explain.
        """
        if not all(np.isfinite(part).all() for states in motion for part in states):
            return False
        known = self._beside([(course.known, course.known_water) for course in motion])
        smoothed = self._beside([(course.states, course.water) for course in motion])
        ends = tuple(end + course.states[-1] for end, course in zip(self.path.ends, motion, strict=True))
        self.path = Path(smoothed, ends, known)
        return True

    def _beside(self, beside: Sequence[tuple[Array, Array]]) -> _Motion:
        """The smoothed motion so far, with states (n, S) and water (n, 2) per span beside it."""
        path = self.path.smoothed
        water = [water.copy() for water in path.water]
        for (record, first, last), (_, current) in zip(self._spans, beside, strict=True):
            water[record][first : last + 1, :2] += current
        starts = np.hstack([path.nu, path.position, to_euler(path.attitude)])
        starts[:, self._columns] += np.concatenate([states[:-1] for states, _ in beside])
        return _Motion(starts[:, 6:9], from_euler(starts[:, 9:]), starts[:, :6], tuple(water))

    def _difference(self, values: Array, other: Array, places: Sequence[int] | None = None) -> Array:
        """One minus another (n, channels), angles the shorter way round."""
        difference = np.asarray(values - other)
        names = self.states if places is None else [self.states[i] for i in places]
        for column, name in enumerate(names):
            if name in _ANGLES:
                difference[:, column] = shorter(difference[:, column])
        return difference

    def _at(self, record: int, sample: int) -> Array:
        """Smoothed state (S,) of a sample as the instruments show it."""
        position, attitude, nu = self.joint.data.trials[record].state(sample)
        return np.concatenate([nu, position, to_euler(attitude)])[self._columns]

    def _afloat(self, record: int, first: int, last: int) -> Array:
        """What a velocity of the water adds to the states' velocities and the rates of their places."""
        trial = self.joint.data.trials[record]
        turned = matrix(trial.state(slice(first, last + 1))[1])
        velocities = np.zeros((len(turned), len(self.states), 3))
        for column, name in enumerate(self.states):
            if name in "uvw":
                velocities[:, column] = turned[:, :, "uvw".index(name)]
            elif name in "xyz":
                velocities[:, column, "xyz".index(name)] = 1.0
        return velocities

    def _through(self, record: int, first: int, last: int) -> Array:
        """Horizontal velocity (n, 2) through the water, of the smoothed log in the water as it is known."""
        trial, rows = self.joint.data.trials[record], slice(first, last + 1)
        _, attitude, nu = trial.state(rows)
        over_ground = np.einsum("nij,nj->ni", matrix(attitude), nu[:, :3])[:, :2]
        recorded = 0.0 if trial.current is None else trial.current[rows, :2]
        return np.asarray(over_ground - recorded - self.path.smoothed.water[record][rows, :2])

    def _depth(self, record: int, first: int, last: int) -> Array:
        """Smoothed depth (n,) of the log; NaN where it was not measured."""
        trial = self.joint.data.trials[record]
        if "z" not in trial.channels:
            return np.full(last + 1 - first, np.nan)
        return np.asarray(trial.state(slice(first, last + 1))[0][:, 2])

    def _replay(self, extra: tuple[str, ...], motion: _Motion) -> Replay:
        """The model over one sample along a motion, with further coefficients that vary."""
        joint = self.joint
        if extra not in self._replays:
            self._replays[extra] = Replay(
                joint.vehicle,
                tuple(
                    Record(record.trial, record.input, np.ones_like(record.counted))
                    for record in joint.data.records
                ),
                self._segments,
                names=(*coefficient_names(joint.parameters), *extra),
                free=joint.stage.axes.free,
                measured=joint.stage.axes.measured,
                substeps=self._substeps,
                threads=joint.threads,
                starts_count=True,
            )
        water = [motion.water[record][first:last] for record, first, last in self._spans]
        current = np.vstack([np.zeros((0, 3)), *water])
        return self._replays[extra].along((motion.position, motion.attitude, motion.nu, current))


def _readings(record: Record) -> tuple[Array, Mask]:
    """Channels (n, 12) at the samples that an instrument gave, and the mask (n, 12) of these.

    What was derived from other channels is none, nor is what the time base interpolates between the samples
    of a slower sensor: an interpolation knows the next sample, which a prediction may not. A sample of such a
    sensor counts once, at the nearest row of the time base, moved there along the smoothed motion.
    """
    trial = record.trial
    observed, mask = trial.observed.copy(), trial.valid.copy()
    for finding in trial.report.findings:
        if finding.kind == "derived":
            mask[:, [CHANNELS.index(name) for name in finding.subject.split() if name in VELOCITIES]] = False
    absent = [index for index, name in enumerate(CHANNELS) if name not in trial.channels]
    mask[:, absent] = False
    for name, (stamps, values) in trial.samples.items():
        if len(stamps) < 2 or np.median(np.diff(stamps)) < ONE_STEP_SETTINGS.slower * trial.dt:
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


@dataclass(frozen=True)
class Errors:
    """Prediction errors (n, Y) of a span, what counts, their slopes (n, Y, m) and instruments (n, Y, m)."""

    span: Span
    error: Array
    counted: Mask
    slope: Array
    instrument: Array


class GaussNewtonStep(NamedTuple):
    """A step (m,) of an estimate within its bounds.

    ``information`` (m, m) of the errors and priors; ``influence`` (b, m) of each block of time: the step that
    its errors alone would give.
    """

    step: Array
    information: Array
    influence: Array


class PredictionErrorCriterion:
    """Robust sum of squares of prediction errors, with the bounds, priors and loss of a joint estimate."""

    def __init__(self, joint: Joint) -> None:
        self.unknowns = joint.unknowns
        self.lower = np.array([u.lower for u in joint.unknowns])
        self.upper = np.array([u.upper for u in joint.unknowns])
        self.scale = np.array([u.scale for u in joint.unknowns])
        # A bound's width is a weak prior, as in output error.
        self.prior_sd = np.minimum([u.prior_sd for u in joint.unknowns], self.scale)
        self.knee = math.inf if joint.polish.loss == "squared" else joint.polish.knee
        self.block = max(round(ONE_STEP_SETTINGS.block_s / joint.data.dt), 1)

    def noise(self, errors: Sequence[Errors]) -> Array:
        """Standard deviation (Y,) of the prediction errors, from their median."""
        noise = np.empty(errors[0].error.shape[1])
        for column in range(len(noise)):
            sizes = np.concatenate([np.abs(part.error[part.counted[:, column], column]) for part in errors])
            noise[column] = 1.4826 * float(np.median(sizes)) if len(sizes) else math.inf
        return np.maximum(noise, 1e-12)

    def weight(self, residual: Array) -> Array:
        """Weight of Huber's loss for residuals over their noise."""
        if math.isinf(self.knee):
            return np.ones_like(residual)
        return np.asarray(self.knee / np.maximum(np.abs(residual), self.knee))

    def cost(self, errors: Sequence[Errors], noise: Array) -> float:
        """Half the robust sum of squares of the prediction errors."""
        total = 0.0
        for part in errors:
            size = np.abs(part.error / noise)
            inner = np.minimum(size, self.knee)
            total += float((inner * (size - 0.5 * inner)).sum())
        return total

    def step(
        self, errors: Sequence[Errors], noise: Array, at: Array, centre: Array, overlap: int = 1
    ) -> GaussNewtonStep:
        """The step from a point (m,) with priors around another one.

        Predictions over a horizon of ``overlap`` samples overlap, and so many of them tell as much as one:
        the priors weigh accordingly more.
        """
        from scipy.optimize import lsq_linear

        precision = overlap * trust(self.unknowns, at - centre) * self.prior_sd**-2.0
        metric, information = np.diag(precision), np.diag(precision)
        blocks = []
        instrumented = any(part.instrument is not part.slope for part in errors)
        for part in errors:
            residual = part.error / noise
            weight = self.weight(residual)
            slope, known = part.slope / noise[:, None], part.instrument / noise[:, None]
            metric = metric + np.einsum("kc,kci,kcj->ij", weight, known, known, optimize=True)
            if instrumented:
                information = information + np.einsum("kc,kci,kcj->ij", weight, known, slope, optimize=True)
            pull = np.einsum("kc,kci->ki", weight * residual, known)
            blocks += [pull[k : k + self.block].sum(axis=0) for k in range(0, len(pull), self.block)]
        if not instrumented:
            information = metric
        gradient = np.sum(blocks, axis=0) - precision * (at - centre)
        # The equations in the metric in which they are independent, so that a bound costs what it should.
        scale, units = self.scale, np.outer(self.scale, self.scale)
        scaled = metric * units
        size = np.sqrt(np.diag(scaled))
        factor = np.linalg.cholesky(scaled / np.outer(size, size) + 1e-10 * np.eye(len(at))).T * size
        rows = np.linalg.solve(factor.T, information * units) if instrumented else factor
        target = np.linalg.solve(factor.T, gradient * scale)
        away = [(bound - at) / scale for bound in (self.lower, self.upper)]
        solution = lsq_linear(rows, target, (np.minimum(away[0], -1e-12), np.maximum(away[1], 1e-12)))
        step = solution.x * scale
        return GaussNewtonStep(step, information, np.linalg.solve(information, np.array(blocks).T).T)
