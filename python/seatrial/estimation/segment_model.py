"""Records of a stage cut into segments, the step of their simulation, and the parameters that are free.

A stage and the joint estimate ask the same: what do candidates show on the segments, how far is that from
what was measured, and how does it change with the parameters? What they make of the answers (weights, losses,
priors, nuisance parameters) is theirs. What is held out of the fit lies in no segment.

**Step.** An integer division of the log's step, the same for every candidate: a candidate's cost is then
independent of its company. RK4 is stable to h|lambda| = 2.8; at h|lambda| <= 0.25 its error stays below the
sensors' noise. The bound on the fastest rate lambda is sought over the whole bounds box before the search:
velocity and attitude dynamics are linearised by finite differences at the largest measured speeds, for every
coefficient at either bound and for the worst of them together. The global search only ranks candidates: it
takes h|lambda| <= 1, stable everywhere in the box. The fine search flies its best ones again at h|lambda| <=
0.25, the bound sought over the part of the box around them: corners of the whole box hold vehicles several
times as fast as those that follow the log. Bounds that admit almost no mass hold vehicles of any rate: the
search takes `most_search` steps per sample at most; what is faster diverges there and ranks last. Which
coefficients admit such vehicles, and the bounds from which none is left, is said before the search.

Tests: ``tests/campaign/test_campaign.py``, ``tests/estimation/test_step.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array, Mask, runs
from seatrial.base.channels import AXES, CHANNELS, deviations
from seatrial.base.errors import CampaignError, SeatrialError
from seatrial.base.report import wording
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


@dataclass(frozen=True)
class StepSettings:
    """How short a step the fastest motion asks for."""

    #: Largest h|lambda| of the fine search: its error stays below the noise of sensors.
    rate_limit: float = 0.25
    #: Largest h|lambda| of the global search, which only ranks: stable everywhere in the box.
    search_rate_limit: float = 1.0
    #: Largest h|lambda| of derivatives that judge an estimate: an error of a thousandth in them.
    slope_rate_limit: float = 0.5
    #: Margin about the points of a search, a share of the width of the bounds.
    near_share: float = 0.1
    #: Bound on the rates over the highest that was found.
    margin: float = 1.1
    #: Speeds at which rates are judged, over the recorded ones.
    speed_margin: float = 1.2
    #: Steps per sample at most, of the fine search and of derivatives.
    most_substeps: int = 100
    #: Steps per sample at most of the global search: what is faster diverges there and ranks last.
    most_search: int = 40
    #: Halvings that find a bound to 1e-9 of its interval.
    bisections: int = 30
    #: Half of the finite differences of speeds, SI, and of attitude.
    difference: float = 1e-4
    #: Rate that stands for one without a number, rad/s: no step follows it.
    fastest: float = 1e9


STEP_SETTINGS = StepSettings()


@dataclass(frozen=True)
class StageStep:
    """Substeps per sample of the log and the bound that asked for them, rad/s.

    ``search`` are the substeps of the global search and ``slopes`` those of derivatives that judge, at most
    as many. ``fast`` names what admits vehicles that they do not follow: coefficient, its bound, and the
    bound that leaves none; the coefficient is empty where the vehicle itself is one of them.
    """

    substeps: int
    rate: float
    search: int
    slopes: int
    fast: tuple[tuple[str, float, float], ...] = ()

    def sentence(self, dt: float) -> str:
        """What the search will not follow, and the bounds that mend it; empty where it follows all."""
        return str(wording("estimates").step(self, dt))


def stage_step(
    vehicle: Vehicle, parameters: Sequence[Parameter], *, free: str, speeds: Array, dt: float
) -> StageStep:
    """Step for a vehicle whose parameters roam their bounds.

    ``parameters``: all that may differ from the vehicle's values, those of former stages included. ``free``:
    letters of the free axes. ``speeds`` (6,): largest measured speeds, m/s and rad/s. ``dt``: step of the
    log, s.
    """
    points = _operating_points(STEP_SETTINGS.speed_margin * speeds)
    axes = [AXES.index(letter) for letter in free]

    def rate(values: Mapping[str, float]) -> float:
        try:
            return _fastest_rate(vehicle.with_coefficients(dict(values)), points, axes)
        except SeatrialError:
            return 0.0  # no vehicle at this corner: such a candidate diverges whatever the step

    corner: dict[str, float] = {}
    rates = [rate({})]
    for parameter in parameters:
        ends = (parameter.lower, parameter.upper)
        rates_at_ends = [rate(parameter.coefficients(end)) for end in ends]
        rates += rates_at_ends
        corner[parameter.name] = ends[int(np.argmax(rates_at_ends))]
    rates.append(rate(_values(parameters, corner)))
    bound = STEP_SETTINGS.margin * max(rates)
    limits = (STEP_SETTINGS.rate_limit, STEP_SETTINGS.slope_rate_limit, STEP_SETTINGS.search_rate_limit)
    fine, slopes, search = (max(math.ceil(dt * bound / limit), 1) for limit in limits)
    fast: tuple[tuple[str, float, float], ...] = ()
    if search > STEP_SETTINGS.most_search:
        limit = STEP_SETTINGS.most_search * STEP_SETTINGS.search_rate_limit / (dt * STEP_SETTINGS.margin)
        fast = _too_fast(parameters, corner, rate, limit)
    return StageStep(
        min(fine, STEP_SETTINGS.most_substeps),
        bound,
        min(search, STEP_SETTINGS.most_search),
        min(slopes, STEP_SETTINGS.most_substeps),
        fast,
    )


def _values(parameters: Sequence[Parameter], chosen: Mapping[str, float]) -> dict[str, float]:
    """Coefficients that the chosen values of parameters set."""
    values: dict[str, float] = {}
    for parameter in parameters:
        if parameter.name in chosen:
            values |= parameter.coefficients(chosen[parameter.name])
    return values


def _too_fast(
    parameters: Sequence[Parameter],
    corner: Mapping[str, float],
    rate: Callable[[Mapping[str, float]], float],
    limit: float,
) -> tuple[tuple[str, float, float], ...]:
    """Parameters whose bounds admit faster vehicles than the limit, rad/s, with the bounds that do not.

    The one whose start value slows the fastest corner most goes first; where it does not suffice, it stays
    there and the next one is sought.
    """
    by_name = {parameter.name: parameter for parameter in parameters}
    # Each parameter's own fast end counts as well as the corner of all of them together.
    left = {name: end for name, end in corner.items() if by_name[name].start != end}
    fast: list[tuple[str, float, float]] = []
    while left:

        def at(name: str, value: float, others: Mapping[str, float] = left) -> float:
            return max(
                rate(_values(parameters, {**others, name: value})), rate(_values(parameters, {name: value}))
            )

        slowest = min(left, key=lambda name: at(name, by_name[name].start))
        bound, good, bad = left[slowest], by_name[slowest].start, left[slowest]
        if at(slowest, bound) <= limit:
            break
        if at(slowest, good) <= limit:
            for _ in range(STEP_SETTINGS.bisections):
                middle = 0.5 * (good + bad)
                good, bad = (middle, bad) if at(slowest, middle) <= limit else (good, middle)
        fast.append((slowest, bound, good))
        del left[slowest]
        if good != by_name[slowest].start:
            break
    return tuple(fast) if fast and rate({}) <= limit else (("", 0.0, 0.0),)


def sound_digits(value: float, bound: float) -> str:
    """A value rounded to three digits away from the bound that it replaces."""
    if value == 0.0:
        return "0"
    unit = 10.0 ** (math.floor(math.log10(abs(value))) - 2)
    rounded = math.floor(value / unit) if value < bound else math.ceil(value / unit)
    return f"{rounded * unit:.3g}"


def around(parameters: Sequence[Parameter], points: Array) -> tuple[Parameter, ...]:
    """Parameters whose bounds are narrowed to points (k, m) and a tenth of the box on either side."""
    narrowed = []
    for parameter, values in zip(parameters, points.T, strict=True):
        margin = STEP_SETTINGS.near_share * (parameter.upper - parameter.lower)
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
        nu[:, 2 * j, j] += STEP_SETTINGS.difference
        nu[:, 2 * j + 1, j] -= STEP_SETTINGS.difference
    for j in range(3):
        attitude[:, 12 + 2 * j, 1 + j] = 0.5 * STEP_SETTINGS.difference
        attitude[:, 13 + 2 * j, 1 + j] = -0.5 * STEP_SETTINGS.difference
    acceleration = vehicle.acceleration(
        nu.reshape(-1, 6), attitude.reshape(-1, 4), np.zeros((n * 18, 6))
    ).reshape(n, 9, 2, 6)
    slope = (acceleration[:, :, 0] - acceleration[:, :, 1]) / (2 * STEP_SETTINGS.difference)
    mass = np.asarray(vehicle.mass_matrix())
    force = np.einsum("ij,nkj->nik", mass, slope)  # (n, 6 forces, 9 states: nu and a small rotation)
    force[:, :, :6] += _inflow(vehicle)
    try:
        reduced = np.linalg.solve(mass[np.ix_(axes, axes)], force[:, axes, :])
    except np.linalg.LinAlgError:  # the free axes have no mass
        return STEP_SETTINGS.fastest
    turning = [axis for axis in axes if axis >= 3]
    columns = [*axes, *(axis + 3 for axis in turning)]
    system = np.zeros((n, len(columns), len(columns)))
    system[:, : len(axes)] = reduced[:, :, columns]
    for row, axis in enumerate(turning):
        system[:, len(axes) + row, axes.index(axis)] = 1.0
    # Coefficients near the largest number overflow on the way.
    if not np.isfinite(system).all():
        return STEP_SETTINGS.fastest
    try:
        return min(float(np.abs(np.linalg.eigvals(system)).max()), STEP_SETTINGS.fastest)
    except np.linalg.LinAlgError:
        return STEP_SETTINGS.fastest


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
