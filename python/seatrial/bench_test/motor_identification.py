"""Identification of a motor from step tests: start values, fit, uncertainty, and a test that suffices.

1. Plateaus give gain, limits and what happens below the minimum; steps give start values (`motor_plateaus`).
2. A grid over dead times, lags and ramps is judged by the criterion; least squares runs from the best of it.
3. The knee of the robust loss is set from the errors where the motor moves, and the fit is repeated.
4. Lift and dead band are both fitted where commands lie below the minimum; the lower cost decides.
5. What the data do not determine is removed, one parameter at a time, and the rest refitted.
6. Intervals, directions and actuators compared (`motor_fit`, `motor_estimate`).

`recommended_steps` is a step test that determines every parameter: a staircase of small commands (n_min),
steps too small for the rate limit to matter (T_1, T_t), large steps to both sides (n_acc, n_dec), beyond the
limits (n_max), and full reversals, each held until the motor has settled.

Only what is determined is written as keys of ``[motors.NAME]``, so that merging keeps the rest. But the file
lets an absent key follow its partner (astern as ahead, shrinking as growing). Where only one rate limit is
determined, the other is taken as the vehicle had it, left to follow, left out with its partner, or, last,
written as the least that the records allow: the first of these whose motor follows the records about as well
as the best does. A limit that the records merely bound can be far below the motor's own. The file has one
rate limit for both directions: the mean of the two, weighted by their precision.

Source: Taubert et al. (2014), equation 34 and figures 4-6 (static behaviour, rate limits, step response).
Held by ``tests/bench_test/test_motor_dynamics.py``, ``tests/bench_test/test_motor_table.py`` and
``tests/bench_test/test_motor_coverage.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError, VehicleError
from seatrial.bench_test.motor_elimination import Reduced, bracket, eliminated, readings
from seatrial.bench_test.motor_estimate import (
    Directions,
    MotorEstimate,
    MotorFitness,
    MotorParameter,
    WrittenMotor,
    compare_actuators,
    compare_directions,
)
from seatrial.bench_test.motor_fit import Loss, fit, uncertainty
from seatrial.bench_test.motor_model import NAMES, RECIPROCAL, SIDES, MotorModel, StepRecord
from seatrial.bench_test.motor_plateaus import (
    Noise,
    Plateau,
    Statics,
    noise_of,
    plateaus,
    starts_in_motion,
    statics,
)

_LOSSES = ("huber", "soft_l1", "none")


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
    >>> from seatrial.bench_test.motor_identification import recommended_steps
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
    reduced = eliminated(read.better, noise, prior)
    return _estimate(reduced, several, noise, settled, shown, start or {}, read.ratio, trimmed, unit)


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
    ratio: float | None,
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
    below = None if ratio is None else ("zero" if problem.dead_band else "lift")
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
        below_minimum_ratio=ratio,
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
class MotorTestSettings:
    """Which steps are recommended for a motor, and which losses are as good."""

    unknown_lag_s: float = 0.3  #: Where the records do not tell the lag, s.
    rest_s: float = 1.5  #: Length of a plateau, s, or `rest_samples` if that is longer.
    rest_samples: float = 8.0  #: Length of a plateau in samples.
    stagger: float = 0.6180339887  #: Golden section: steps meet the samples at evenly spread phases.
    as_good: float = 1.1  #: Root mean square errors that are about as small as the smallest.


SETTINGS = MotorTestSettings()


def recommended_steps(
    motor: Mapping[str, Any], *, sample_s: float = 0.1, stagger: bool = True
) -> tuple[Array, Array]:
    """Times (n,) in s and commands (n,) of a step test, each command held until the next time.

    Parameters
    ----------
    motor : mapping
        What is known or guessed of the motor, as in the vehicle file's ``[motors.NAME]``; ``maximum_ahead``
        is needed.
    sample_s : float
        Time between samples of the log, s.
    stagger : bool
        Let the steps fall between the samples at ever other phases. Without it they fall on samples, for a
        logger that can do no other.

    Raises
    ------
    VehicleError
        There is no largest command, or the sample time is not positive.

    Examples
    --------
    >>> t, command = recommended_steps({"maximum_ahead": 2000.0, "minimum_ahead": 150.0})
    >>> print(command.max(), command.min())
    2300.0 -2300.0
    """
    known = MotorModel.from_table(motor)
    if not all(math.isfinite(limit) and limit > 0 for limit in known.n_max):
        raise VehicleError(
            "a step test needs the largest command; found no maximum_ahead in the motor's table; give"
            " maximum_ahead (and maximum_astern where it differs) in the unit of the command"
        )
    if not sample_s > 0:
        raise VehicleError(f"a step test needs a sample time above zero, found sample_s = {sample_s:g} s")
    sides = [_sequence(known, side) for side in (0, 1)]
    ahead, astern = (known.n_max[side] for side in (0, 1))
    # Full reversals take the longest way: they show the rate limits of both directions.
    reversals = [0.9 * ahead, -0.9 * astern, 0.9 * ahead, -0.9 * astern, 0.0]
    commands = np.array([0.0, *sides[0], *sides[1], *reversals])
    rest = max(SETTINGS.rest_s, SETTINGS.rest_samples * sample_s)
    holds = [_hold(known, commands[max(k - 1, 0)], commands[k]) + rest for k in range(len(commands))]
    t = np.concatenate([[0.0], np.cumsum(holds)[:-1]])
    # Commands change at samples; the stagger moves them within, which tells the dead time to a part of one.
    t = np.ceil(t / sample_s) * sample_s
    if stagger:
        t[1:] += sample_s * ((SETTINGS.stagger * np.arange(1, len(t))) % 1.0)
    return np.append(t, t[-1] + holds[-1]), np.append(commands, 0.0)


def _sequence(known: MotorModel, side: int) -> list[float]:
    """Commands of one direction, beginning and ending at the smallest command."""
    sign = 1.0 - 2.0 * side
    top = known.n_max[side]
    low = known.n_min[side] or 0.1 * top
    # A change that the rate limit passes in a third of the time constant shows the lag alone.
    rate = min(known.n_acc[side], known.n_dec[side], 10.0 * top)
    small = min(max(rate * (known.T_1 or SETTINGS.unknown_lag_s) / 3.0, 0.04 * top), 0.15 * top)
    middle = max(0.5 * top, 2.0 * low)
    staircase = [0.3 * low, 0.0, 0.6 * low, 0.9 * low, 1.3 * low, 2.0 * low, 0.0]
    fine = [middle, middle + small, middle, middle - small, middle, middle + small]
    large = [0.0, 0.9 * top, 1.15 * top, 0.7 * top, 0.0, 0.8 * top, 0.25 * top, 1.15 * top, 0.0]
    return [sign * command for command in (*staircase, *fine, *large)]


def _hold(known: MotorModel, before: float, after: float) -> float:
    """Time in s until the motor has settled."""
    sides = (0, 1)
    slowest = min(min(known.n_acc[side], known.n_dec[side]) for side in sides)
    ramp = abs(after - before) / slowest if math.isfinite(slowest) else 0.0
    return known.T_t + ramp + 5.0 * (known.T_1 or SETTINGS.unknown_lag_s)


Keys = dict[str, float | str]

_KEYS = {"n_max_ahead": "maximum_ahead", "n_max_astern": "maximum_astern", "n_min_ahead": "minimum_ahead"}

_KEYS |= {"n_min_astern": "minimum_astern", "K_V": "K_V", "T_1": "T_1_s", "T_t": "T_t_s"}

_PARTNER = {"n_acc": "n_dec", "n_dec": "n_acc"}


def written_motor(
    parameters: Mapping[str, MotorParameter],
    directions: Sequence[Directions],
    below_minimum: str | None,
    records: Sequence[StepRecord],
    start: Mapping[str, Any],
) -> WrittenMotor:
    """What to write of a motor, chosen by how the motor of the file would follow the records.

    `below_minimum` is "lift" or "zero", where the records tell; the keys are merged into the vehicle file's
    entry `start`.
    """
    base = _static_keys(parameters, below_minimum)
    limits = {limit: _common(limit, parameters, directions) for limit in _PARTNER}
    rates: Keys = {f"{limit}_per_s": rate for limit, rate in limits.items() if rate is not None}
    choices: list[tuple[Keys, str | None]] = [(base | rates, None)]
    missing = [limit for limit, rate in limits.items() if rate is None]
    # The file lets the absent rate follow its partner: several readings, judged by the records below.
    if len(missing) == 1:
        key, both = f"{missing[0]}_per_s", [parameters[f"{missing[0]}_{side}"] for side in SIDES]
        kept = both[0].kept
        if kept is not None and math.isfinite(kept):
            choices.insert(0, (base | rates | {key: kept}, None))
        choices.append((dict(base), None))
        least = [parameter.at_least for parameter in both if parameter.at_least is not None]
        if least:
            choices.append((base | rates | {key: float(f"{max(least):.3g}")}, key))
    errors = [_rms(MotorModel.from_table(dict(start) | table), records) for table, _ in choices]
    # The first that is about as good: choices are ordered by how little they claim.
    best = next(k for k, error in enumerate(errors) if error <= SETTINGS.as_good * min(errors))
    scatter = float(np.std(np.concatenate([record.sampled[1] for record in records])))
    r2 = 1.0 - (errors[best] / scatter) ** 2 if scatter > 0.0 else math.nan
    return WrittenMotor(choices[best][0], r2, choices[best][1])


def _rms(model: MotorModel, records: Sequence[StepRecord]) -> float:
    """Root mean square error of a motor over records."""
    errors = [record.sampled[1] - model.response(record, record.sampled[0]) for record in records]
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))


def _static_keys(parameters: Mapping[str, MotorParameter], below_minimum: str | None) -> Keys:
    """Keys but those of the rate limits, with their values rounded to their precision."""
    table: Keys = {}
    for name, key in _KEYS.items():
        parameter = parameters[name]
        if parameter.value is not None:
            table[key] = _rounded(parameter.value, parameter.sigma)
    for limit in ("maximum", "minimum"):
        astern = parameters[f"n_{limit[:3]}_astern"]
        missing = f"{limit}_ahead" in table and f"{limit}_astern" not in table
        if missing and astern.kept is not None and math.isfinite(astern.kept) and not astern.contradicted:
            table[f"{limit}_astern"] = astern.kept
    if below_minimum is not None:
        table["below_minimum"] = below_minimum
    return table


def _common(
    limit: str, parameters: Mapping[str, MotorParameter], directions: Sequence[Directions]
) -> float | None:
    """One rate limit for both directions, of those that are determined."""
    for pair in directions:
        if pair.name == limit:
            return _rounded(pair.pooled, pair.sigma)
    values = [parameter for side in SIDES if (parameter := parameters[f"{limit}_{side}"]).value is not None]
    return _rounded(values[0].value or 0.0, values[0].sigma) if values else None


def _rounded(value: float, sigma: float | None) -> float:
    """Value to a tenth of its standard deviation or finer; to four digits where there is none."""
    if sigma is None:
        return float(f"{value:.4g}")
    if not sigma > 0:
        return value
    return round(value, 1 - math.floor(math.log10(sigma)))
