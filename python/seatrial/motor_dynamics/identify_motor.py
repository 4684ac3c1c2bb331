"""Identification of a motor from step tests: start values, fit, certainty, what is not determined.

1. Plateaus give gain, limits and what happens below the minimum; steps give start values (`start_values`).
2. A grid over dead times, lags and ramps is judged by the criterion; least squares runs from the best of it.
3. The knee of the robust loss is set from the errors where the motor moves, and the fit is repeated.
4. Lift and dead band are both fitted where commands lie below the minimum; the lower cost decides.
5. What the data do not tell is taken out, one parameter at a time, and the rest refitted.
6. Intervals (`motor_certainty`), directions and actuators compared (`comparison`).

Source: Taubert et al. (2014), figures 6-8 and equation 34. Held by `tests/test_motor_dynamics.py` and
`tests/test_motor_coverage.py`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seatrial.errors import TrialError
from seatrial.motor_dynamics.comparison import compare_actuators, compare_directions
from seatrial.motor_dynamics.dead_band import bracket
from seatrial.motor_dynamics.elimination import Found, eliminated
from seatrial.motor_dynamics.motor_certainty import certainty
from seatrial.motor_dynamics.motor_estimate import MotorEstimate, MotorFitness
from seatrial.motor_dynamics.motor_fit import Loss, fit
from seatrial.motor_dynamics.motor_model import NAMES, RECIPROCAL, SIDES, MotorModel
from seatrial.motor_dynamics.motor_parameter import MotorParameter
from seatrial.motor_dynamics.plateaus import (
    Noise,
    Plateau,
    Statics,
    noise_of,
    plateaus,
    starts_in_motion,
    statics,
)
from seatrial.motor_dynamics.readings import readings
from seatrial.motor_dynamics.step_record import StepRecord

__all__ = ["identify_motor"]

Array = NDArray[np.float64]

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
    >>> from seatrial.motor_dynamics.motor_model import MotorModel
    >>> from seatrial.motor_dynamics.recommended_steps import recommended_steps
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
    read = readings(several, settled, shown, noise, robust)
    found = eliminated(read.better, noise, prior)
    return _estimate(found, several, noise, settled, shown, prior, read.ratio, trimmed, unit)


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
    found: Found,
    records: Sequence[StepRecord],
    noise: Noise,
    settled: Sequence[Plateau],
    shown: Statics,
    prior: MotorModel | None,
    ratio: float | None,
    trimmed: tuple[str, ...],
    unit: str,
) -> MotorEstimate:
    """The result's parts put together."""
    problem, best, known = found.problem, found.best, found.known
    model = problem.model(best.x)
    parameters = {
        name: _parameter(k, found, None if prior is None else prior.parameters()[name], unit)
        for k, name in enumerate(NAMES)
    }
    determined = {name: one.determined for name, one in parameters.items()}
    smooth = {name: told and bool(problem.free[NAMES.index(name)]) for name, told in determined.items()}
    actuators = tuple(dict.fromkeys(record.name for record in problem.records))
    alone = {}
    for actuator in actuators if len(actuators) > 1 else ():
        mine = replace(problem, records=tuple(r for r in problem.records if r.name == actuator), base=best.x)
        x = fit(mine, [best.x]).x
        alone[actuator] = (x, certainty(mine, x, noise))
    followed = {
        round(abs(one.command), 6)
        for one in settled
        for low, high in [(shown.n_min[one.command < 0], shown.n_max[one.command < 0])]
        if max(low, 1e-12) <= abs(one.command) <= high
    }
    return MotorEstimate(
        parameters=parameters,
        model=model,
        below_minimum=None if ratio is None else ("zero" if problem.dead_band else "lift"),
        below_minimum_ratio=ratio,
        fitness=MotorFitness.of(problem.records, model, noise),
        noise=noise,
        directions=compare_directions(best.x, known, smooth),
        actuators=actuators,
        left_out=sum(len(record.sampled[0]) for record in records)
        - sum(len(record.sampled[0]) for record in problem.records),
        trimmed=trimmed,
        differing=compare_actuators(alone, smooth),
        starts=best.starts,
        agreeing=best.agreeing,
        converged=best.converged,
        distinct_commands=len(followed),
        block_s=known.block_s,
        blocks=known.blocks,
        unit=unit,
    )


def _parameter(k: int, found: Found, kept: float | None, unit: str) -> MotorParameter:
    """What is known of the parameter with index k."""
    name, x, half = NAMES[k], float(found.best.x[k]), float(found.known.half[k])
    units = {"K_V": "1", "T_1": "s", "T_t": "s"}
    blank = MotorParameter(name, units.get(name, f"{unit}/s" if RECIPROCAL[k] else unit), kept=kept)
    if name in found.reasons:
        reason = found.reasons[name]
        return replace(blank, reason=reason.text, at_least=reason.at_least, at_most=reason.at_most)
    if name.startswith("n_min") and found.problem.dead_band:
        edge = bracket(found.problem.records, x, SIDES.index(name.rpartition("_")[2]))
        if edge is None:
            return replace(blank, reason="no command is dropped in this direction")
        sigma = (edge[1] - edge[0]) / math.sqrt(12.0)
        return replace(blank, value=sum(edge) / 2.0, sigma=sigma, lower=edge[0], upper=edge[1], dof=math.inf)
    blank = replace(blank, remark=found.remarks.get(name, ""))
    sigma, dof = float(found.known.sigma[k]), float(found.known.dof[k])
    if not math.isfinite(sigma):
        return replace(blank, reason="the records tell it only together with other parameters")
    lower, upper = max(x - half, 0.0), x + half
    if RECIPROCAL[k]:
        value, sigma = 1.0 / x, sigma / x**2
        lower, upper = 1.0 / upper, 1.0 / lower if lower > 0 else math.inf
    else:
        value = x
    return replace(blank, value=value, sigma=sigma, lower=lower, upper=upper, dof=dof)
