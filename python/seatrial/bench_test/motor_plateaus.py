"""What a motor's records show before any fit: noise, plateaus, gain and limits, start values of the dynamics.

A plateau is the second half of a held command in which the revolutions no longer drift. The gain is the
ratio ``level / command`` on which most plateaus agree. The smallest commands above that line were lifted to
``n_min`` if they share a level, the largest below it clipped at ``n_max`` likewise, those at rest dropped by
a dead band; a motor that is merely not quite linear shows none of it.

From 20 to 80 % of a step a pure lag takes ``T_1 ln 4``, a pure ramp 0.6 of its length ``step * s`` (s the
reciprocal rate limit); their squares add nearly, as those of any two responses in a row, so that the widths
of steps of several sizes give T_1 and one s per direction by non-negative least squares. The dead time is no
later than the time to 20 %: a grid of fractions of a sample up to there is judged by the criterion, because
the cost has several minima in T_t, one between any two crossings of samples. Held by
``tests/bench_test/test_motor_dynamics.py``.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError
from seatrial.bench_test.motor_model import NAMES, MotorModel, StepRecord


@dataclass(frozen=True)
class MotorPlateauSettings:
    """What a plateau and a step of revolutions must show, and from which values the fit starts."""

    fewest_samples: int = 3  #: Of a plateau, which is the second half of a held command.
    agreeing_share: float = 0.005  #: Of a level within which a gain agrees; noise adds to it.
    calm_share: float = 0.8  #: Of the bends that count in the noise.
    calm_sd: float = 0.6616  #: Standard deviation of a normal bend that is cut there.
    caution: float = 1.1  #: Makes up for the tails with the largest scatter, which are left out.
    #: Of the plateaus that may turn against their command before the record is refused.
    stray_share: float = 0.1
    exact_share: float = 1e-6  #: Of the largest value: the least noise.
    moving: float = 8.0  #: Standard deviations of the noise above which revolutions have moved.
    gain_apart: float = 0.05  #: How far the gain of one command may lie from that of the others, relative.
    clear_step: float = 10.0  #: Standard deviations of the noise that a step must exceed.
    settled_share: float = 0.15  #: Of the step by which the revolutions may miss their level before it.
    delays_per_sample: int = 4  #: Points of the grid of dead times per sample.
    most_delays: int = 48  #: Of the grid, so that long dead times cost no more than short ones.
    #: On the first estimate, of which a ramp may be a part.
    lag_factors: tuple[float, ...] = (0.4, 0.75, 1.0, 1.5)
    #: On the first estimate, of which a lag may be a part.
    ramp_factors: tuple[float, float, float] = (1.0, 0.75, 0.3)


SETTINGS = MotorPlateauSettings()


@dataclass(frozen=True)
class Noise:
    """Standard deviation of the white part of the measurements and the step of their digits (0 if none)."""

    sd: float
    quantum: float

    @property
    def total(self) -> float:
        """Standard deviation of one sample, rounding of its digits included."""
        return math.hypot(self.sd, self.quantum / math.sqrt(12.0))


@dataclass(frozen=True)
class Plateau:
    """A settled stretch: the command, the median of the revolutions, its standard deviation, whose it is."""

    command: float
    level: float
    sd: float
    name: str


@dataclass(frozen=True)
class Statics:
    """Gain and static limits that plateaus show; pairs (ahead, astern). ``n_max`` is infinite and ``n_min``
    zero where none shows it; ``dropped`` is the largest command that left the motor at rest, else zero.
    """

    gain: float
    n_min: tuple[float, float]
    n_max: tuple[float, float]
    dropped: tuple[float, float]


def noise_of(records: Sequence[StepRecord]) -> Noise:
    """Noise and quantum of the measurements: the smaller of the noise in second differences, which a ramp
    hardly enters, and of the scatter in the second halves of held commands, where samples are few per
    step.
    """
    bends, scatter, values = [], [], []
    for record in records:
        measured = record.sampled[1]
        bends.append(np.abs(np.diff(measured, 2)))
        values.append(measured)
        scatter += [(float(np.var(tail, ddof=1)), len(tail) - 1) for _, tail in _tails(record)]
    quantum = _quantum(np.concatenate(values))
    # Steps and gaps make a few bends large: the rest of a normal distribution beyond its 80 % is left out.
    small = np.sort(np.concatenate(bends))
    small = small[: max(1, int(SETTINGS.calm_share * len(small)))]
    white = math.sqrt(float(np.mean(small**2)) / 6.0) / SETTINGS.calm_sd
    if scatter:
        variance, dof = np.array(sorted(scatter)).T
        calm = np.cumsum(dof) <= max(SETTINGS.calm_share * dof.sum(), dof[0])
        white = min(white, SETTINGS.caution * math.sqrt(float(np.average(variance[calm], weights=dof[calm]))))
    # Data without any noise, as a simulation gives them, still need a scale for their errors.
    least = 0.0 if quantum > 0 else SETTINGS.exact_share * float(np.abs(np.concatenate(values)).max())
    return Noise(max(math.sqrt(max(white**2 - quantum**2 / 12.0, 0.0)), least), quantum)


def _quantum(values: Array) -> float:
    """Step of the digits: what all values are multiples of, zero where there is no such number."""
    distinct = np.unique(values)
    if len(distinct) < 2 or len(distinct) > 0.8 * len(values):
        return 0.0
    step = float(np.diff(distinct).min())
    parts = (distinct - distinct[0]) / step
    return step if np.abs(parts - np.rint(parts)).max() < 1e-3 else 0.0


def plateaus(records: Sequence[StepRecord], noise: Noise) -> list[Plateau]:
    """Settled stretches of all records, in their order."""
    settled = []
    for record in records:
        for command, tail in _tails(record):
            early, late = np.array_split(tail, 2)
            # Medians: one missed count is no drift.
            drift = abs(float(np.median(late) - np.median(early)))
            level = float(np.median(tail))
            sd = noise.total / math.sqrt(len(tail))
            if drift <= 6.0 * sd + noise.quantum + SETTINGS.agreeing_share * abs(level):
                settled.append(Plateau(command, level, sd, record.name))
    return settled


def starts_in_motion(record: StepRecord, noise: Noise) -> StepRecord | None:
    """The record without its first transient where it starts in the midst of one; None where it does not: the
    first command counts as held long before.
    """
    starts = record.held[0]
    times, measured = record.sampled
    end = starts[1] if len(starts) > 1 else times[-1]
    first, tail = measured[times < end][:2], measured[(times >= 0.5 * (starts[0] + end)) & (times < end)]
    if len(first) < 2 or len(tail) < SETTINGS.fewest_samples:
        return None
    level = float(np.median(tail))
    if np.abs(first - level).min() <= SETTINGS.moving * noise.total + SETTINGS.agreeing_share * abs(level):
        return None
    kept = np.where(
        np.asarray(record.t_measured) < 0.5 * (starts[0] + end), np.nan, np.asarray(record.measured)
    )
    return replace(record, measured=kept)


def _tails(record: StepRecord) -> list[tuple[float, Array]]:
    """Held commands with the measurements of the second half of their time, where there are enough."""
    starts, commands = record.held
    times, measured = record.sampled
    ends = np.append(starts[1:], max(times[-1], starts[-1]))
    tails = []
    for start, end, command in zip(starts, ends, commands, strict=True):
        tail = measured[(times >= 0.5 * (start + end)) & (times <= end)]
        if len(tail) >= SETTINGS.fewest_samples:
            tails.append((float(command), tail))
    return tails


def statics(settled: Sequence[Plateau], noise: Noise) -> Statics:
    """Gain and static limits from plateaus."""
    rest = SETTINGS.moving * noise.total
    driven = [plateau for plateau in settled if plateau.command != 0.0]
    moving = [plateau for plateau in driven if abs(plateau.level) > rest]
    if not moving:
        raise TrialError(
            f"step record {settled[0].name}: the measured revolutions do not follow the command: they"
            " settle at zero or not at all; expected at least one command that is held until the motor turns"
            " steadily; check the column of the measurement, or hold commands for six samples and twice the"
            " transient"
        )
    # Some plateaus against their command are strays; a whole side or many are a wrong sign.
    against = [plateau for plateau in moving if plateau.level * plateau.command < 0]
    whole = [
        plateau
        for plateau in against
        if not any(plateau.command * o.command > 0 for o in moving if o not in against)
    ]
    if whole or len(against) > SETTINGS.stray_share * len(moving):
        _refuse(moving, against[0])
    moving = [plateau for plateau in moving if plateau.level * plateau.command > 0]
    gain = _agreed(moving, noise)
    low, high, dropped = [0.0, 0.0], [math.inf, math.inf], [0.0, 0.0]
    # Small commands that share a level were lifted to the minimum, large ones cut at the maximum.
    for side, sign in enumerate((1.0, -1.0)):
        mine = [plateau for plateau in driven if sign * plateau.command > 0 and plateau not in against]
        turning = sorted(
            (plateau for plateau in mine if abs(plateau.level) > rest),
            key=lambda plateau: abs(plateau.command),
        )
        lifted = _shared(turning, gain, noise, 1)
        clipped = _shared(turning[::-1], gain, noise, -1)
        if lifted:
            low[side] = float(np.median(lifted)) / gain
        if clipped:
            high[side] = float(np.median(clipped)) / gain
        still = [
            abs(plateau.command)
            for plateau in mine
            if abs(plateau.level) <= rest and gain * abs(plateau.command) > 2.0 * rest
        ]
        dropped[side] = max(still, default=0.0)
    return Statics(gain, (low[0], low[1]), (high[0], high[1]), (dropped[0], dropped[1]))


def _shared(ordered: Sequence[Plateau], gain: float, noise: Noise, way: int) -> list[float]:
    """Levels of the first plateaus that lie off the line in one way and share the level of the very first;
    one command alone a little off the line shows another gain, not a limit.
    """
    shared: list[float] = []
    commands: set[float] = set()
    for plateau in ordered:
        apart = abs(abs(plateau.level) - shared[0]) if shared else 0.0
        if _above(plateau, gain, noise) != way or apart > _slack(plateau, noise):
            break
        shared.append(abs(plateau.level))
        commands.add(round(abs(plateau.command), 9))
    alone = len(commands) == 1 and abs(shared[0] / (gain * commands.pop()) - 1.0) < SETTINGS.gain_apart
    return [] if alone else shared


def _above(plateau: Plateau, gain: float, noise: Noise) -> int:
    """1 where a level lies above the line of the gain, -1 below, 0 on it."""
    excess, slack = abs(plateau.level) - gain * abs(plateau.command), _slack(plateau, noise)
    return int(excess > slack) - int(excess < -slack)


def _slack(plateau: Plateau, noise: Noise) -> float:
    """How far levels may lie apart that are the same."""
    return (
        4.0 * plateau.sd
        + noise.quantum * (0.5 if noise.sd >= noise.quantum else 1.0)
        + SETTINGS.agreeing_share * abs(plateau.level)
    )


def _agreed(moving: Sequence[Plateau], noise: Noise) -> float:
    """Ratio on which most distinct commands agree; of equals that of the middle commands."""
    best: tuple[int, float, float] = (0, 0.0, 1.0)
    sizes = np.array([abs(plateau.command) for plateau in moving])
    middle = 0.5 * float(sizes.max())
    for plateau in moving:
        gain = abs(plateau.level / plateau.command)
        alike = {round(other.command, 9) for other in moving if _above(other, gain, noise) == 0}
        best = max(best, (len(alike), -abs(abs(plateau.command) - middle), gain))
    kept = [plateau for plateau in moving if _above(plateau, best[2], noise) == 0]
    weights = np.array([abs(plateau.command) for plateau in kept])
    ratios = np.array([abs(plateau.level / plateau.command) for plateau in kept])
    return float(np.average(ratios, weights=weights**2))


def _refuse(moving: Sequence[Plateau], plateau: Plateau) -> None:
    """Raise for revolutions whose sign does not fit the commands', with one plateau that shows it."""
    if all(other.level > 0 for other in moving) and any(other.command > 0 for other in moving):
        raise TrialError(
            f"step record {plateau.name}: the measured revolutions have no sign: command"
            f" {plateau.command:g} turns the motor at {plateau.level:g}, expected negative revolutions"
            " astern; give the measurement the sign of the rotation (a counter alone cannot tell a reversal)"
        )
    raise TrialError(
        f"step record {plateau.name}: the measured revolutions turn against the command: command"
        f" {plateau.command:g} settles at {plateau.level:g}; expected the same sign; set sign = -1 in the"
        " column map of one of them"
    )


_LN4 = math.log(4.0)  # a lag goes from 20 to 80 % of a step in ln 4 of its time constants


@dataclass(frozen=True)
class Transition:
    """A step from level to level of the limited command, s from the command's stamp; ``rate`` is the place of
    its rate limit among the parameters, None for a reversal.
    """

    size: float
    rate: int | None
    to_20: float
    to_80: float


def limited(command: float, low: tuple[float, float], high: tuple[float, float]) -> float:
    """Command after the static limits, lifted below the minimum."""
    side = int(command < 0)
    if command == 0:
        return 0.0
    return math.copysign(min(max(abs(command), low[side]), high[side]), command)


def transitions(records: Sequence[StepRecord], static: Statics, noise: Noise) -> list[Transition]:
    """Steps that start from a settled motor and reach 80 % before the next one."""
    kept = []
    for record in records:
        stamps, commands = record.held
        times, measured = record.sampled
        levels = [limited(float(c), static.n_min, static.n_max) for c in commands]
        for k in range(1, len(stamps)):
            before, after = levels[k - 1], levels[k]
            end = stamps[k + 1] if k + 1 < len(stamps) else math.inf
            rows = (times >= stamps[k]) & (times < end)
            clear = static.gain * abs(after - before) > SETTINGS.clear_step * noise.total
            if not clear or rows.sum() < 3:
                continue
            part = (measured[rows] / static.gain - before) / (after - before)
            if abs(part[0]) > SETTINGS.settled_share:
                continue
            passed = [_crossing(times[rows] - stamps[k], part, share) for share in (0.2, 0.8)]
            if all(math.isfinite(time) for time in passed):
                kept.append(Transition(abs(after - before), _rate(before, after), passed[0], passed[1]))
    return kept


def starts(
    records: Sequence[StepRecord],
    static: Statics,
    noise: Noise,
    *,
    cost: Callable[[Array], float],
    wanted: int,
) -> list[Array]:
    """The best start points (11,) of the grid by their cost, each in another place, best first."""
    seen = transitions(records, static, noise)
    sample = float(np.median([record.sample_s for record in records]))
    lag, ramps = _widths(seen, sample)
    latest = float(np.median([step.to_20 for step in seen])) if seen else 4.0 * sample
    delays = np.arange(0.0, latest + sample, sample / SETTINGS.delays_per_sample)
    delays = delays[:: max(1, math.ceil(len(delays) / SETTINGS.most_delays))]
    grid: list[tuple[float, int, Array]] = []
    for delay, longer, steeper in itertools.product(delays, SETTINGS.lag_factors, SETTINGS.ramp_factors):
        x = MotorModel(static.gain, longer * lag, float(delay), static.n_min, static.n_max).coordinates()
        x[7:] = steeper * ramps
        grid.append((cost(x), len(grid), x))
    grid.sort()
    kept: list[Array] = []
    for _, _, x in grid:
        # Starts that differ in neither dead time nor lag run into the same minimum.
        if all(abs(x[2] - y[2]) > 0.6 * sample or abs(x[1] / y[1] - 1.0) > 0.2 for y in kept):
            kept.append(x)
        if len(kept) == wanted:
            break
    return kept


def _rate(before: float, after: float) -> int | None:
    """Index of the rate limit that a step meets."""
    if before * after < 0:
        return None
    growing = abs(after) > abs(before)
    side = int(min(before, after) < 0)
    return NAMES.index("n_acc_ahead" if growing else "n_dec_ahead") + side


def _crossing(times: Array, part: Array, share: float) -> float:
    """Time at which a response first passes a share of its step, linear between samples."""
    above = np.flatnonzero(part >= share)
    if not len(above):
        return math.inf
    k = int(above[0])
    if k == 0:
        return float(times[0])
    return float(np.interp(share, part[[k - 1, k]], times[[k - 1, k]]))


def _widths(seen: Sequence[Transition], sample: float) -> tuple[float, Array]:
    """Time constant in s and reciprocal rates (4,) from the times between 20 and 80 %."""
    from scipy.optimize import nnls

    kept = [step for step in seen if step.rate is not None]
    ramps = np.zeros(4)
    if not kept:
        return sample, ramps
    rows = np.zeros((len(kept), 5))
    rows[:, 0] = 1.0
    top = max(step.size for step in kept)
    for row, step in zip(rows, kept, strict=True):
        row[1 + int(step.rate or 0) - 7] = (step.size / top) ** 2
    squares, _ = nnls(rows, np.array([(step.to_80 - step.to_20) ** 2 for step in kept]))
    ramps[:] = np.sqrt(squares[1:]) / (0.6 * top)
    return max(math.sqrt(squares[0]) / _LN4, 0.2 * sample), ramps
