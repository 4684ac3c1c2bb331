"""Result of a motor's identification: parameters with intervals, comparisons, keys of the vehicle file.

Directions and actuators are compared by Wald tests. Ahead against astern, from the joint covariance: ``z = (a
- b) / sd(a - b)`` with a Student factor. One actuator against the others of its group: each is fitted alone,
and its parameters are compared with the median of all, which one odd actuator does not move. With m
comparisons the level is 5 %/m (Bonferroni).

Held by
``tests/bench_test/test_motor_dynamics.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.plain import Plain
from seatrial.base.report import words_about
from seatrial.bench_test.motor_fit import MotorUncertainty
from seatrial.bench_test.motor_model import NAMES, RECIPROCAL, MotorModel, StepRecord
from seatrial.bench_test.motor_plateaus import Noise


@dataclass(frozen=True)
class MotorParameter(Plain, also="status"):
    """One parameter; ``value``, ``sigma`` and the 95 % interval are None where it is not determined.

    Attributes
    ----------
    name, unit
        As ``n_acc_ahead`` and ``rpm/s``; the unit of K_V is that of the measurement per that of the command.
    value, sigma, lower, upper
        Estimate, standard deviation, 95 % interval.
    dof
        Degrees of freedom of the interval, zero where there is none.
    reason
        Why it is not determined; empty where it is.
    at_least, at_most
        What the data say all the same of a parameter that is not determined.
    kept
        The vehicle's value, which stays where the parameter is not determined; None if there is none.
    remark
        What the value holds for, where it does not hold alone.
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
        """What is known, in one sentence.

        Examples
        --------
        >>> MotorParameter("T_t", "s", 0.1234, 0.0021, 0.119, 0.128, 12.0).sentence()
        'T_t = 0.1234 s ± 0.0021, 95 % interval 0.1190 to 0.1280 s.'
        """
        return words_about(self, "bench_sentences")[0]


@dataclass(frozen=True)
class MotorEstimateSettings:
    """Which parameters of a motor a record determines."""

    shortest_s: float = 1e-3  #: No motor and no logger shows a shorter time, s.
    level: float = 0.05  #: Chance of a false difference.
    many: float = 1e9  #: Degrees of freedom from which Student's distribution is the normal one.
    misfit: float = 10.0  #: Errors over the noise above which an interval means nothing.
    visible: float = 1e-4  #: Share of the motion that the errors must have for it.
    rough: float = 1.5  #: Errors over the measurement's own noise above which something is left out.
    worse: float = 1e-3  #: Share of the motion by which the written motor may miss more than the fitted one.


SETTINGS = MotorEstimateSettings()


@dataclass(frozen=True)
class Directions(Plain, also="differ"):
    """A parameter ahead against astern.

    ``pooled`` and ``sigma`` belong to one value for both, ``sigma`` no less than half the difference where
    they differ; ``p`` is the probability of a difference as large if there is none.
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
    """How well a motor fits: the paper's least absolute error and others, in the unit of the measurement.

    Attributes
    ----------
    absolute
        Mean absolute error.
    absolute_integral
        The paper's criterion, the integral of the absolute error over time.
    rms
        Root mean square error.
    r2
        ``1 - SSE/SST``.
    noise, quantum
        White noise of the measurement and step of its digits, as its second differences show them.
    samples
        Number of measurements.
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
    """Keys for the vehicle file, R² of the motor that the file then holds, and the rate written as a bound.

    ``least`` is the key of a rate limit that the records only bound, None where there is none.
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
    """An identified motor.

    Attributes
    ----------
    parameters
        `MotorParameter` by name, in the order K_V, T_1, T_t, n_min, n_max, n_acc, n_dec (ahead, astern).
    model
        The motor that fits best; where a rate limit is not determined, with the vehicle's if the data allow
        it and without one otherwise; without limits that no command reaches.
    below_minimum
        "lift" or "zero"; None where no command lies below the minimum.
    below_minimum_ratio
        Cost of the other of the two over that of this one; None likewise.
    fitness, noise
        `MotorFitness` and noise of the measurements.
    directions
        Ahead against astern, a `Directions` per limit that is determined in both.
    actuators, differing
        Names of the actuators, and in what one differs from the others.
    left_out
        Number of gross errors that were left out of fit and fitness.
    trimmed
        Names of the records that started in motion; their first transient is left out.
    starts, agreeing
        How many starts the search had, and how many found this minimum.
    converged
        Whether the search ended by its tolerances.
    distinct_commands
        Magnitudes of commands that were followed without a limit: the gain rests on them.
    block_s, blocks
        Length and number of the blocks of errors on which the intervals rest.
    unit
        Unit of command and measurement.
    written
        What goes into the vehicle file, and how that scores on the records.
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
        """Keys of the vehicle file's ``[motors.NAME]`` that the data determine, rounded to their precision.

        Keys of the other parameters are left out, so that merging keeps the vehicle's, but for those that the
        file would derive from a key that is written. The rate limits are those of both directions together.
        """
        return dict(self.written.table)

    def sentences(self) -> tuple[str, ...]:
        """What is known of each parameter, what differs, how well it fits; one sentence each."""
        return tuple(words_about(self, "bench_sentences"))
