"""Result of a motor's identification: parameters with intervals, comparisons, keys of the vehicle file.

Directions and actuators are compared by Wald tests. Ahead against astern, from the joint covariance: ``z = (a
- b) / sd(a - b)`` with a Student factor. One actuator against the others of its group: each is fitted alone,
and its parameters are compared with the median of all, which one odd actuator does not move. With m
comparisons the level is 5 %/m (Bonferroni).

Only what is determined is written as keys of ``[motors.NAME]``, so that merging keeps the rest. But the file
lets an absent key follow its partner (astern as ahead, shrinking as growing). Where only one rate limit is
determined, the other is taken as the vehicle had it, left to follow, left out with its partner, or, last,
written as the least that the records allow: the first of these whose motor follows the records about as well
as the best does. A limit that the records merely bound can be far below the motor's own. The file has one
rate limit for both directions: the mean of the two, weighted by their precision.

Held by ``tests/bench_test/test_motor_dynamics.py`` and ``tests/bench_test/test_motor_table.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.plain import Plain
from seatrial.base.report import words_about
from seatrial.bench_test.motor_fit import MotorUncertainty
from seatrial.bench_test.motor_model import NAMES, RECIPROCAL, SIDES, MotorModel, StepRecord
from seatrial.bench_test.motor_plateaus import Noise


@dataclass(frozen=True)
class MotorParameter(Plain, also="status"):
    """One parameter; ``value``, ``sigma`` and the 95 % interval are None where it is not determined.

    ``reason`` says why it is not, ``at_least`` and ``at_most`` what the data say all the same; ``kept`` is
    the vehicle's value, which then stays, ``remark`` what the value holds for where it does not hold alone.
    The unit of K_V is that of the measurement per that of the command; ``dof`` are the interval's degrees of
    freedom, zero without one.
    """

    name: str
    unit: str
    value: float | None = None
    sigma: float | None = None
    lower: float | None = None
    upper: float | None = None
    dof: float = 0.0
    reason: str = ""
    at_least: float | None = None
    at_most: float | None = None
    kept: float | None = None
    remark: str = ""

    @property
    def determined(self) -> bool:
        """Whether the data determine it."""
        return self.value is not None

    @property
    def status(self) -> str:
        """Whether it is determined, and if not, why not."""
        return "determined" if self.determined else f"not determined: {self.reason}"

    @property
    def contradicted(self) -> bool:
        """Whether the data rule out the value that is kept."""
        if self.kept is None or self.determined:
            return False
        slack = 1e-9 * abs(self.kept)
        below = self.at_least is not None and self.kept < self.at_least - slack
        return below or (self.at_most is not None and self.kept > self.at_most + slack)

    def sentence(self) -> str:
        """What is known, in one sentence."""
        return words_about(self, "bench_test")[0]


@dataclass(frozen=True)
class MotorEstimateSettings:
    """Which parameters of a motor a record determines."""

    shortest_s: float = 1e-3  #: No motor and no logger shows a shorter time, s.
    level: float = 0.05  #: Chance of a false difference.
    many: float = 1e9  #: Degrees of freedom from which Student's distribution is the normal one.
    misfit: float = 10.0  #: Errors over the noise above which an interval means nothing.
    visible: float = 1e-4  #: Share of the motion that the errors must have for it.
    rough: float = 1.5  #: Errors over the measurement's own noise above which something is left out.
    as_good: float = 1.1  #: Root mean square errors that are about as small as the smallest.
    worse: float = 1e-3  #: Share of the motion by which the written motor may miss more than the fitted one.


SETTINGS = MotorEstimateSettings()


@dataclass(frozen=True)
class Directions(Plain, also="differ"):
    """A parameter ahead against astern: ``pooled`` and ``sigma`` belong to one value for both, ``sigma`` no
    less than half the difference where they differ; ``p`` is the probability of as large a difference if
    there is none.
    """

    name: str
    ahead: float
    astern: float
    p: float
    pooled: float
    sigma: float

    @property
    def differ(self) -> bool:
        """Whether the difference is more than chance, at 5 %."""
        return self.p < SETTINGS.level


@dataclass(frozen=True)
class ActuatorDifference(Plain):
    """A parameter in which one actuator of a group differs from the others' ``median``."""

    actuator: str
    name: str
    value: float
    median: float
    p: float


def compare_directions(
    x: Array, known: MotorUncertainty, determined: Mapping[str, bool]
) -> tuple[Directions, ...]:
    """Tests of the parameters that are determined both ahead and astern, at coordinates (11,)."""
    from scipy.special import stdtr

    comparisons = []
    for limit in ("n_min", "n_max", "n_acc", "n_dec"):
        k = NAMES.index(f"{limit}_ahead")
        if not (determined[NAMES[k]] and determined[NAMES[k + 1]]):
            continue
        block = known.covariance[k : k + 2, k : k + 2]
        variance = max(float(block[0, 0] + block[1, 1] - 2.0 * block[0, 1]), 1e-300)
        dof = min(max(float(known.dof[k : k + 2].min()), 1.0), SETTINGS.many)
        p = 2.0 * float(stdtr(dof, -abs(x[k] - x[k + 1]) / math.sqrt(variance)))
        weights = 1.0 / np.diag(block)
        weights /= weights.sum()
        pooled, sigma = float(weights @ x[k : k + 2]), math.sqrt(float(weights @ block @ weights))
        ahead, astern = float(x[k]), float(x[k + 1])
        if RECIPROCAL[k]:
            ahead, astern, pooled, sigma = 1.0 / ahead, 1.0 / astern, 1.0 / pooled, sigma / pooled**2
        if p < SETTINGS.level:
            sigma = max(sigma, 0.5 * abs(ahead - astern))
        comparisons.append(Directions(limit, ahead, astern, p, pooled, sigma))
    return tuple(comparisons)


def compare_actuators(
    alone: Mapping[str, tuple[Array, MotorUncertainty]], determined: Mapping[str, bool]
) -> tuple[ActuatorDifference, ...]:
    """Differences of single actuators, each fitted alone: coordinates (11,) and uncertainty by name."""
    from scipy.special import stdtr

    differences = []
    names = list(alone)
    kept = [k for k, name in enumerate(NAMES) if determined[name]]
    level = SETTINGS.level / max(len(names) * len(kept), 1)
    for k in kept:
        values = np.array([alone[name][0][k] for name in names])
        sigma = np.array([alone[name][1].sigma[k] for name in names])
        known = np.isfinite(sigma) & (sigma > 0)
        if known.sum() < 2:
            continue
        median = float(np.median(values[known]))
        # The median of m values scatters by sqrt(pi/2m) of one.
        shared = math.sqrt(math.pi / (2.0 * known.sum()) * float(np.mean(sigma[known] ** 2)))
        for i in np.flatnonzero(known):
            dof = min(max(float(alone[names[i]][1].dof[k]), 1.0), SETTINGS.many)
            z = abs(values[i] - median) / math.hypot(sigma[i], shared)
            p = 2.0 * float(stdtr(dof, -z))
            if p < level:
                value, middle = float(values[i]), median
                if RECIPROCAL[k]:
                    value, middle = (math.inf if size <= 0 else 1.0 / size for size in (value, middle))
                differences.append(ActuatorDifference(names[i], NAMES[k], value, middle, p))
    return tuple(differences)


@dataclass(frozen=True)
class MotorFitness:
    """How well a motor fits, in the unit of the measurement: mean absolute error, its integral over time (the
    paper's criterion), root mean square error, ``1 - SSE/SST``; white noise of the measurement and step of
    its digits.
    """

    absolute: float
    absolute_integral: float
    rms: float
    r2: float
    noise: float
    quantum: float
    samples: int

    @property
    def misfit(self) -> float | None:
        """Errors over the measurement's noise where the chain clearly misses the motor, else None."""
        ratio = self.rms / max(math.hypot(self.noise, self.quantum / math.sqrt(12.0)), 1e-12)
        return ratio if ratio > SETTINGS.misfit and 1.0 - self.r2 > SETTINGS.visible else None

    @classmethod
    def of(cls, records: tuple[StepRecord, ...], model: MotorModel, noise: Noise) -> MotorFitness:
        """Fitness of a motor to records."""
        errors, values, integral = [], [], 0.0
        for record in records:
            times, measured = record.sampled
            error = measured - model.response(record, times)
            integral += float(np.trapezoid(np.abs(error), times))
            errors.append(error)
            values.append(measured)
        error, value = np.concatenate(errors), np.concatenate(values)
        square = float(np.sum((value - value.mean()) ** 2))
        return cls(
            absolute=float(np.mean(np.abs(error))),
            absolute_integral=integral,
            rms=float(np.sqrt(np.mean(error**2))),
            r2=1.0 - float(np.sum(error**2)) / square if square > 0 else math.nan,
            noise=noise.sd,
            quantum=noise.quantum,
            samples=len(error),
        )


@dataclass(frozen=True)
class WrittenMotor:
    """Keys for the vehicle file, R² of the motor that the file then holds, and the key of a rate limit
    (``least``) that the records only bound.
    """

    table: dict[str, float | str]
    r2: float
    least: str | None


@dataclass(frozen=True)
class MotorEstimate(
    Plain,
    only="unit parameters motor_table motor_table_r2=written.r2 below_minimum below_minimum_ratio fitness"
    " directions actuators differing left_out trimmed starts agreeing converged distinct_commands block_s"
    " blocks sentences",
):
    """An identified motor: `MotorParameter` by name, in the order K_V, T_1, T_t, n_min, n_max, n_acc, n_dec
    (ahead, astern).

    `model` fits best; a rate limit that is not determined is the vehicle's if the data allow it.
    `below_minimum` is "lift" or "zero", its ratio the cost of the other over that of this one; None where no
    command lies below the minimum. `directions` and `differing`: limits ahead against astern, and in what an
    actuator differs from the others. `left_out` gross errors count in neither fit nor fitness, nor does the
    first transient of the `trimmed` records. `agreeing` of so many `starts` of the search found this minimum,
    `converged` by its tolerances. The gain rests on so many `distinct_commands`, the intervals on `blocks` of
    errors, `block_s` long. `written` goes into the vehicle file.
    """

    parameters: Mapping[str, MotorParameter]
    model: MotorModel
    below_minimum: str | None
    below_minimum_ratio: float | None
    fitness: MotorFitness
    noise: Noise
    directions: tuple[Directions, ...]
    actuators: tuple[str, ...]
    differing: tuple[ActuatorDifference, ...]
    left_out: int
    trimmed: tuple[str, ...]
    starts: int
    agreeing: int
    converged: bool
    distinct_commands: int
    block_s: float
    blocks: int
    unit: str
    written: WrittenMotor

    def __getitem__(self, name: str) -> MotorParameter:
        """A parameter by its name."""
        return self.parameters[name]

    def fitted(self, record: StepRecord) -> Array:
        """Modelled revolutions (k,) at the times of a record's measurements."""
        return self.model.response(record, np.asarray(record.t_measured))

    def motor_table(self) -> dict[str, float | str]:
        """Keys of the vehicle file's ``[motors.NAME]`` that the data determine, rounded to their precision;
        keys that are left out stay the vehicle's when they are merged.
        """
        return dict(self.written.table)

    def sentences(self) -> tuple[str, ...]:
        """What is known of each parameter, what differs, how well it fits; one sentence each."""
        return tuple(words_about(self, "bench_test"))


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
    """What to write of a motor, merged into the vehicle file's entry `start`, chosen by how the motor of the
    file would follow the records.
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
