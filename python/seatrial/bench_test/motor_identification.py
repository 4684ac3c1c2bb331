"""Identification of a motor from step tests: start values, fit, uncertainty, and a test that suffices.

1. Plateaus give gain, limits and what happens below the minimum; steps give start values (`motor_plateaus`).
2. A grid over dead times, lags and ramps is judged by the criterion; least squares runs from the best of it.
3. The knee of the robust loss is set from the errors where the motor moves, and the fit is repeated.
4. Lift and dead band are both fitted where commands lie below the minimum; the lower cost decides.
5. What the data do not determine is removed, one parameter at a time, and the rest refitted.
6. Intervals, directions and actuators compared (`motor_fit`, `motor_estimate`).

Each record is read twice, with lift and with a dead band. The knee of the robust loss comes from the errors
of the first reading where the motor moves: on plateaus alone it would be the measurement's noise, and what
rotors do beside a PT1 would count as outliers. A dead band has no slope: the response depends only on which
commands it drops, so its edge is searched over the commands that were given and lies between the largest
dropped and the smallest not dropped.

With a robust loss, single gross errors are left out of the better reading: missed counts read zero, all on
one side, and Huber's loss limits their pull but keeps it. A run of such values is no missed count but
something that the chain does not model; it stays.

A rate limit whose interval reaches "no limit" is held at the vehicle's value if the data allow that, and at
no limit otherwise. A time constant near zero has no slope (a short lag delays a ramp as a dead time does):
its interval is that of the profile, where the cost with T_1 held and all others refitted rises by what chance
would. What then holds only beside a held parameter says so.

Source: Taubert et al. (2014), equation 34 and figures 4-6 (static behaviour, rate limits, step response).
Held by ``tests/bench_test/test_motor_dynamics.py`` and
``tests/bench_test/test_motor_coverage.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array, runs
from seatrial.base.errors import TrialError
from seatrial.bench_test.motor_estimate import (
    MotorEstimate,
    MotorFitness,
    MotorParameter,
    compare_actuators,
    compare_directions,
    written_motor,
)
from seatrial.bench_test.motor_fit import (
    NORMAL,
    Fit,
    Loss,
    MotorUncertainty,
    Problem,
    Reason,
    fit,
    reachable,
    spread,
    uncertainty,
    unseen_rates,
    wide,
)
from seatrial.bench_test.motor_model import NAMES, RECIPROCAL, SIDES, MotorModel, StepRecord, symbol
from seatrial.bench_test.motor_plateaus import (
    Noise,
    Plateau,
    Statics,
    noise_of,
    plateaus,
    starts,
    starts_in_motion,
    statics,
)

_LOSSES = ("huber", "soft_l1", "none")

_LAG, _DELAY = NAMES.index("T_1"), NAMES.index("T_t")

_MINIMUM = [NAMES.index("n_min_ahead"), NAMES.index("n_min_astern")]


def identify_motor(
    records: StepRecord | Sequence[StepRecord],
    *,
    start: Mapping[str, Any] | None = None,
    robust: Loss = "huber",
    unit: str = "rpm",
) -> MotorEstimate:
    """Gain, lag, dead time and limits of a motor, with standard deviations and 95 % intervals.

    Parameters
    ----------
    records : StepRecord or sequence of StepRecord
        Of one actuator, or of several that share a motor: each is then held against the others.
    start : mapping, optional
        The vehicle file's ``[motors.NAME]``. Its values are kept where the records do not determine them.
    robust : {"huber", "soft_l1", "none"}
        Loss of the errors. Its knee is 1.5 standard deviations of them, so that spikes and missed counts
        do not pull.
    unit : str
        Unit of command and revolutions, for the texts.

    Raises
    ------
    TrialError
        No record, a command that never changes or is never held, revolutions that do not follow, turn the
        other way or carry no sign; an unknown loss.

    Examples
    --------
    >>> import numpy as np
    >>> from seatrial.bench_test.motor_model import MotorModel
    >>> from seatrial.bench_test.motor_model import recommended_steps
    >>> table = {"maximum_ahead": 2000.0, "minimum_ahead": 150.0, "n_acc_per_s": 2000.0,
    ...          "n_dec_per_s": 4000.0, "T_1_s": 0.15, "T_t_s": 0.137}
    >>> t, command = recommended_steps(table)
    >>> at = np.arange(0.0, t[-1], 0.1)
    >>> asked = StepRecord(t, command, np.zeros(len(at)), "SbU", t_measured=at)
    >>> shown = np.round(MotorModel.from_table(table).response(asked, at) / 5.0) * 5.0
    >>> motor = identify_motor(StepRecord(t, command, shown, "SbU", t_measured=at))
    >>> round(motor["T_t"].value, 2), motor.below_minimum
    (0.14, 'lift')
    """
    several = (records,) if isinstance(records, StepRecord) else tuple(records)
    _refuse(several, robust)
    noise = noise_of(several)
    # A motor that turns at the beginning has a past that the record does not hold.
    cut = [starts_in_motion(record, noise) for record in several]
    trimmed = tuple(old.name for old, new in zip(several, cut, strict=True) if new is not None)
    several = tuple(old if new is None else new for old, new in zip(several, cut, strict=True))
    settled = plateaus(several, noise)
    if not settled:
        raise TrialError(
            f"step record {several[0].name}: no command is held long enough for the motor to settle; expected"
            " steps held for at least six samples and twice their transient; log a step test (seatrial's"
            " recommended_steps gives one)"
        )
    prior = None if start is None else MotorModel.from_table(start)
    shown = statics(settled, noise)
    # Commands below the minimum can be read in two ways; the lower cost decides.
    read = readings(several, settled, shown, noise, robust)
    reduced = eliminated(read, noise, prior)
    return _estimate(reduced, several, noise, settled, shown, start or {}, trimmed, unit)


def _refuse(records: Sequence[StepRecord], robust: str) -> None:
    """Raise for records from which nothing can be found."""
    if robust not in _LOSSES:
        raise TrialError(f'robust = "{robust}" is no loss; expected one of {", ".join(_LOSSES)}')
    if not records:
        raise TrialError("a motor needs at least one step record, found none")
    for record in records:
        if len(record.sampled[0]) < 20:
            raise TrialError(
                f"step record {record.name}: the record is too short: {len(record.sampled[0])} measurements"
                " from its first command on, expected at least 20; check that both run on one clock"
            )
        times, commands = record.held
        if len(commands) < 2 or not (times[1:] < record.sampled[0][-1]).any():
            raise TrialError(
                f"step record {record.name}: the command is {commands[0]:g} throughout; expected at least one"
                " step while revolutions are measured; leave the record out or log a step test"
            )


def _estimate(
    reduced: Reduced,
    records: Sequence[StepRecord],
    noise: Noise,
    settled: Sequence[Plateau],
    shown: Statics,
    start: Mapping[str, Any],
    trimmed: tuple[str, ...],
    unit: str,
) -> MotorEstimate:
    """The result's parts put together."""
    problem, best, known = reduced.problem, reduced.best, reduced.known
    prior = MotorModel.from_table(start).parameters() if start else None
    model = problem.model(best.x)
    fitness = MotorFitness.of(problem.records, model, noise)
    parameters = {
        name: _parameter(k, reduced, None if prior is None else prior[name], unit)
        for k, name in enumerate(NAMES)
    }
    if fitness.misfit is not None:
        parameters = {
            name: _without_interval(parameter, fitness.misfit) for name, parameter in parameters.items()
        }
    # Comparisons rest on intervals, which a chain that misses the motion does not have.
    clear = fitness.misfit is None
    determined = {name: parameter.determined for name, parameter in parameters.items()}
    smooth = {name: fitted and bool(problem.free[NAMES.index(name)]) for name, fitted in determined.items()}
    directions = compare_directions(best.x, known, smooth) if clear else ()
    below = None if reduced.ratio is None else ("zero" if problem.dead_band else "lift")
    actuators = tuple(dict.fromkeys(record.name for record in problem.records))
    # Actuators of a group are fitted alone, from the common estimate on, to see which one differs.
    alone = {}
    for actuator in actuators if len(actuators) > 1 else ():
        mine = replace(problem, records=tuple(r for r in problem.records if r.name == actuator), base=best.x)
        x = fit(mine, [best.x]).x
        alone[actuator] = (x, uncertainty(mine, x, noise))
    # Commands within the limits tell the gain; one magnitude alone may be a limit itself.
    followed = {
        round(abs(plateau.command), 6)
        for plateau in settled
        for low, high in [(shown.n_min[plateau.command < 0], shown.n_max[plateau.command < 0])]
        if max(low, 1e-12) <= abs(plateau.command) <= high
    }
    return MotorEstimate(
        parameters=parameters,
        model=model,
        below_minimum=below,
        below_minimum_ratio=reduced.ratio,
        fitness=fitness,
        noise=noise,
        directions=directions,
        actuators=actuators,
        left_out=sum(len(record.sampled[0]) for record in records)
        - sum(len(record.sampled[0]) for record in problem.records),
        trimmed=trimmed,
        differing=compare_actuators(alone, smooth) if clear else (),
        starts=best.starts,
        agreeing=best.agreeing,
        converged=best.converged,
        distinct_commands=len(followed),
        block_s=known.block_s,
        blocks=known.blocks,
        unit=unit,
        written=written_motor(parameters, directions, below, problem.records, start),
    )


def _without_interval(parameter: MotorParameter, ratio: float) -> MotorParameter:
    """A parameter of a chain that misses what the motor does: its scatter says nothing about its error."""
    if not parameter.determined:
        return parameter
    remark = f"no interval: the errors are {ratio:.0f} times the measurement's noise: the chain misses it"
    return replace(parameter, sigma=None, lower=None, upper=None, dof=0.0, remark=remark)


def _parameter(k: int, reduced: Reduced, kept: float | None, unit: str) -> MotorParameter:
    """What is known of the parameter with index k."""
    name, x, half = NAMES[k], float(reduced.best.x[k]), float(reduced.known.half[k])
    units = {"K_V": "1", "T_1": "s", "T_t": "s"}
    blank = MotorParameter(name, units.get(name, f"{unit}/s" if RECIPROCAL[k] else unit), kept=kept)
    if name in reduced.reasons:
        reason = reduced.reasons[name]
        return replace(blank, reason=reason.text, at_least=reason.at_least, at_most=reason.at_most)
    if name.startswith("n_min") and reduced.problem.dead_band:
        edge = bracket(reduced.problem.records, x, SIDES.index(name.rpartition("_")[2]))
        if edge is None:
            return replace(blank, reason="no command is dropped in this direction")
        sigma = (edge[1] - edge[0]) / math.sqrt(12.0)
        return replace(blank, value=sum(edge) / 2.0, sigma=sigma, lower=edge[0], upper=edge[1], dof=math.inf)
    blank = replace(blank, remark=reduced.remarks.get(name, ""))
    sigma, dof = float(reduced.known.sigma[k]), float(reduced.known.dof[k])
    if not math.isfinite(sigma):
        return replace(blank, reason="the records determine it only together with other parameters")
    lower, upper = max(x - half, 0.0), x + half
    if RECIPROCAL[k]:
        value, sigma = 1.0 / x, sigma / x**2
        lower, upper = 1.0 / upper, 1.0 / lower if lower > 0 else math.inf
    else:
        value = x
    return replace(blank, value=value, sigma=sigma, lower=lower, upper=upper, dof=dof)


@dataclass(frozen=True)
class EliminationSettings:
    """How robustly motor dynamics are fitted, and where their edges are searched."""

    most_edges: int = 24  #: Edges of a dead band that are tried: each costs a solution of the problem.
    starts: int = 4  #: For a problem with several minima: each costs a solution.
    knee: float = 1.5  #: Standard deviations: Huber's loss keeps 96 % of the efficiency for normal errors.
    gross: float = 8.0  #: Standard deviations of a gross error.
    gross_share: float = 0.1  #: Largest part of the values that may be gross errors.
    missed_run: int = 3  #: Values in a row that may be missed counts.
    #: Rise of the squared errors, in variances; doubled because errors are coloured.
    chance: float = 2.0 * NORMAL**2
    longest_samples: float = 40.0  #: Samples at which the search for the longest lag ends.


SETTINGS = EliminationSettings()


def _edges(problem: Problem, x: Array) -> Array:
    """Coordinates (11,) with the edges of the dead band (ahead, astern) that cost least."""
    best = x.copy()
    problem = replace(problem, dead_band=True)
    for side in (0, 1):
        sizes = _sizes(problem.records, side)
        cuts = np.concatenate([[0.0], 0.5 * (sizes[:-1] + sizes[1:])])[: SETTINGS.most_edges]
        costs = []
        for cut in cuts:
            best[_MINIMUM[side]] = cut
            costs.append(problem.cost(best))
        best[_MINIMUM[side]] = cuts[int(np.argmin(costs))]
    return best


def bracket(records: Sequence[StepRecord], edge: float, side: int) -> tuple[float, float] | None:
    """Largest command that an edge drops and smallest that it lets pass; None where it drops none."""
    sizes = _sizes(records, side)
    dropped, passed = sizes[sizes < edge], sizes[sizes >= edge]
    if not len(dropped) or not len(passed):
        return None
    return float(dropped.max()), float(passed.min())


def _sizes(records: Sequence[StepRecord], side: int) -> Array:
    """Distinct magnitudes of the commands of one direction, rising."""
    commands = np.concatenate([record.held[1] for record in records])
    sign = 1.0 - 2.0 * side
    return np.unique(sign * commands[sign * commands > 0])


@dataclass(frozen=True)
class Reading:
    """A problem with its best fit, and the reasons of parameters that were not free."""

    problem: Problem
    best: Fit
    reasons: dict[str, Reason]


@dataclass(frozen=True)
class Readings:
    """The better reading, and the cost of the other over its own; None where there is no other."""

    better: Reading
    ratio: float | None


def readings(
    records: tuple[StepRecord, ...], settled: Sequence[Plateau], shown: Statics, noise: Noise, loss: Loss
) -> Readings:
    """The better reading of commands below the minimum, or the only one where there are no such commands."""
    reasons = reachable(records, settled, shown, dead_band=False)
    free = np.array([name not in reasons for name in NAMES])
    base = MotorModel(shown.gain, 0.0, 0.0, shown.n_min, shown.n_max).coordinates()
    problem = Problem(records, base, free, SETTINGS.knee * noise.total, loss, dead_band=False)
    points = starts(records, shown, noise, cost=problem.cost, wanted=SETTINGS.starts)
    first = fit(problem, points)
    problem = replace(problem, knee=SETTINGS.knee * _size_of_errors(problem, first.x, noise))
    again = fit(problem, [first.x])
    lift = Reading(problem, replace(again, starts=first.starts, agreeing=first.agreeing), reasons)
    if max(*shown.n_min, *shown.dropped) <= 0:
        return Readings(_cleaned(lift, noise), None)
    free = free.copy()
    free[_MINIMUM] = False
    problem = replace(problem, base=_edges(problem, lift.best.x), free=free, dead_band=True)
    best = fit(problem, [np.where(free, x, problem.base) for x in (lift.best.x, *points[:1])])
    drop = Reading(problem, best, reachable(records, settled, shown, dead_band=True))
    better, other = sorted([lift, drop], key=lambda reading: reading.best.cost)
    return Readings(_cleaned(better, noise), other.best.cost / max(better.best.cost, 1e-12))


def _cleaned(reading: Reading, noise: Noise) -> Reading:
    """The reading refitted without single gross errors, where the loss is robust."""
    problem, best = reading.problem, reading.best
    limit = SETTINGS.gross * _size_of_errors(problem, best.x, noise)
    if problem.loss == "none":
        return reading
    kept, dropped = [], 0
    for record in problem.records:
        times, measured = record.sampled
        bad = _single(np.abs(measured - problem.model(best.x).response(record, times)) > limit)
        dropped += int(bad.sum())
        stamps = np.asarray(record.t_measured)
        values = np.where(np.isin(stamps, times[bad]), np.nan, np.asarray(record.measured))
        kept.append(replace(record, measured=values) if bad.mean() <= SETTINGS.gross_share else record)
    if not dropped:
        return reading
    problem = replace(problem, records=tuple(kept))
    again = fit(problem, [best.x])
    return replace(reading, problem=problem, best=replace(again, starts=best.starts, agreeing=best.agreeing))


def _single(far: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Marks of values in runs that are short enough for missed counts."""
    kept = np.zeros_like(far)
    for start, end in runs(far):
        kept[start:end] = end - start <= SETTINGS.missed_run
    return kept


def _size_of_errors(problem: Problem, x: Array, noise: Noise) -> float:
    """Standard deviation of the errors, the greater of all and of those while the motor moves."""
    errors, model = problem.errors(x), problem.model(x)
    moving = []
    for record in problem.records:
        at, near = record.sampled[0], 0.5 * record.sample_s
        change = model.response(record, at + near) - model.response(record, at - near)
        moving.append(np.abs(change) > 2.0 * noise.total)
    moved = errors[np.concatenate(moving)]
    return max(spread(errors), spread(moved) if len(moved) else 0.0, noise.total)


@dataclass(frozen=True)
class Reduced:
    """A fit without what is not determined: reasons by name, remarks on the others, ratio of `Readings`."""

    problem: Problem
    best: Fit
    known: MotorUncertainty
    reasons: dict[str, Reason]
    remarks: dict[str, str]
    ratio: float | None


def eliminated(read: Readings, noise: Noise, prior: MotorModel | None) -> Reduced:
    """The better reading without rate limits and a time constant that the data do not determine."""
    problem, best, reasons = read.better.problem, read.better.best, dict(read.better.reasons)
    sample = float(np.median([record.sample_s for record in problem.records]))
    known = uncertainty(problem, best.x, noise)
    blurred = set(wide(best.x, known, sample))
    held: list[str] = []
    while unseen := unseen_rates(best.x, known, problem.free):
        name, reasons[name] = next(iter(unseen.items()))
        problem, best = _hold(problem, best, NAMES.index(name), prior, otherwise=0.0)
        known = uncertainty(problem, best.x, noise)
        held.append(symbol(name))
    if "T_1" in wide(best.x, known, sample):
        problem, best, known = _near_zero(problem, best, noise, prior, sample, reasons)
    reasons |= {name: reason for name, reason in wide(best.x, known, sample).items() if name not in reasons}
    beside = f"it holds for {', '.join(held)} as in the fit" if held else ""
    remarks = {name: beside for name in blurred if beside and name not in reasons}
    return Reduced(problem, best, known, reasons, remarks, read.ratio)


def _near_zero(
    problem: Problem,
    best: Fit,
    noise: Noise,
    prior: MotorModel | None,
    sample: float,
    reasons: dict[str, Reason],
) -> tuple[Problem, Fit, MotorUncertainty]:
    """The fit with T_1 held, and T_1's interval from its profile where that is shorter than a sample."""
    longest = _longest_lag(problem, best, sample)
    if longest <= sample:
        problem, best = _hold(problem, best, _LAG, None, otherwise=float(best.x[_LAG]))
    else:
        reasons["T_1"] = Reason(
            "a longer one fits as well with another dead time and other rates; steps of several sizes, some"
            " too small for the rate limit to matter, would determine it",
            at_most=longest if math.isfinite(longest) else None,
        )
        problem, best = _hold(problem, best, _LAG, prior, otherwise=float(best.x[_LAG]))
    known = uncertainty(problem, best.x, noise)
    sigma, half, dof = known.sigma.copy(), known.half.copy(), known.dof.copy()
    sigma[_LAG], half[_LAG], dof[_LAG] = longest / NORMAL, max(longest - best.x[_LAG], 0.0), math.inf
    # What the lag may be longer, the dead time is shorter.
    sigma[_DELAY], half[_DELAY] = math.hypot(sigma[_DELAY], sigma[_LAG]), math.hypot(half[_DELAY], half[_LAG])
    return problem, best, replace(known, sigma=sigma, half=half, dof=dof)


def _longest_lag(problem: Problem, best: Fit, sample: float) -> float:
    """Longest time constant in s that the data allow with all others refitted; infinite if all are."""
    length = max(float(best.x[_LAG]), 0.02 * sample)
    while _allowed(problem, best, _LAG, length):
        length *= 2.0
        if length > SETTINGS.longest_samples * sample:
            return math.inf
    shorter = float(best.x[_LAG])
    for _ in range(8):  # halvings of the interval: to half a per cent of it
        middle = 0.5 * (shorter + length)
        if _allowed(problem, best, _LAG, middle):
            shorter = middle
        else:
            length = middle
    return length


def _hold(
    problem: Problem, best: Fit, k: int, prior: MotorModel | None, *, otherwise: float
) -> tuple[Problem, Fit]:
    """The problem with a coordinate held at the vehicle's if the data allow it, and its fit."""
    value = otherwise
    if prior is not None:
        kept = float(prior.coordinates()[k])
        value = kept if math.isfinite(kept) and _allowed(problem, best, k, kept) else otherwise
    return _refitted(problem, best, k, value)


def _allowed(problem: Problem, best: Fit, k: int, value: float) -> bool:
    """Whether the cost with a coordinate held rises by no more than chance."""
    held = _refitted(problem, best, k, value)[1]
    size = max(spread(problem.errors(best.x)), 1e-12)
    return 2.0 * (held.cost - best.cost) * (problem.knee / size) ** 2 <= SETTINGS.chance


def _refitted(problem: Problem, best: Fit, k: int, value: float) -> tuple[Problem, Fit]:
    """The problem with a coordinate held at a value, and its fit from the present one."""
    base, free = best.x.copy(), problem.free.copy()
    base[k], free[k] = value, False
    problem = replace(problem, base=base, free=free)
    points = [np.where(free, best.x, base)]
    if k == _LAG:
        # A longer lag wants a shorter dead time: start there too.
        moved = points[0].copy()
        moved[_DELAY] = max(moved[_DELAY] + float(best.x[k]) - value, 0.0)
        points.append(np.where(free, moved, base))
    again = fit(problem, points)
    return problem, replace(again, starts=best.starts, agreeing=best.agreeing)
