"""Result of a motor's identification: parameters with intervals, how well they fit, what they go into."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seatrial.motor_dynamics.comparison import ActuatorDifference, Directions
from seatrial.motor_dynamics.motor_model import MotorModel
from seatrial.motor_dynamics.motor_parameter import MotorParameter
from seatrial.motor_dynamics.plateaus import Noise
from seatrial.motor_dynamics.step_record import StepRecord
from seatrial.motor_dynamics.vehicle_keys import rates, vehicle_keys

__all__ = ["MotorEstimate", "MotorFitness"]

Array = NDArray[np.float64]

_ROUGH = 1.5  # errors over the measurement's own noise above which something is left out


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
class MotorEstimate:
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

    def __getitem__(self, name: str) -> MotorParameter:
        """A parameter by its name."""
        return self.parameters[name]

    def fitted(self, record: StepRecord) -> Array:
        """Modelled revolutions (k,) at the times of a record's measurements."""
        return self.model.response(record, np.asarray(record.t_measured))

    def motor_table(self) -> dict[str, float | str]:
        """Keys of the vehicle file's ``[motors.NAME]`` that the data determine, rounded to what they tell.

        Keys of the other parameters are left out, so that merging keeps the vehicle's, but for those that the
        file would derive from a key that is written. The rate limits are those of both directions together.
        """
        return vehicle_keys(self.parameters, self.directions, self.below_minimum)

    def sentences(self) -> tuple[str, ...]:
        """What is known of each parameter, what differs, how well it fits; one sentence each."""
        fit, unit = self.fitness, self.unit
        said = [one.sentence() for one in self.parameters.values()]
        if self.below_minimum is not None and self.below_minimum_ratio is not None:
            what = "lifted to it" if self.below_minimum == "lift" else "dropped to zero"
            said.append(
                f"Commands below the minimum are {what}: the other reading costs"
                f" {self.below_minimum_ratio:.3g} times as much."
            )
        if self.distinct_commands == 1:
            said.append(
                "K_V rests on commands of one magnitude; a limit there would look the same, and commands of"
                " other magnitudes would tell."
            )
        for pair in self.directions:
            if pair.differ:
                shared = pair.name in ("n_acc", "n_dec")
                pooled = f"; the vehicle file has one for both: {pair.pooled:.4g}" if shared else ""
                said.append(
                    f"{pair.name} differs between the directions: {pair.ahead:.4g} ahead, {pair.astern:.4g}"
                    f" astern (p = {pair.p:.2g}){pooled}."
                )
        for limit, (rate, origin) in rates(self.parameters, self.directions).items():
            if origin == "least":
                said.append(
                    f"{limit}_per_s is written as {rate:g}, the least that the records allow: the vehicle"
                    " file would take the other rate limit for both."
                )
        said += [one.sentence() for one in self.differing]
        if self.left_out:
            said.append(
                f"{self.left_out} of {self.left_out + fit.samples} measurements are gross errors and are left"
                " out."
            )
        for name in self.trimmed:
            said.append(
                f"Record {name} starts in motion under a constant command: its first transient is left out;"
                " give the command that was held before."
            )
        said.append(
            f"Mean absolute error {fit.absolute:.3g} {unit}, R\N{SUPERSCRIPT TWO} {fit.r2:.5f}, over"
            f" {fit.samples} samples."
        )
        own = max(self.noise.total, 1e-12)
        if fit.rms > _ROUGH * own:
            said.append(
                f"The errors ({fit.rms:.3g} {unit} rms) are {fit.rms / own:.1f} times the measurement's own"
                " noise: the motor does something that the chain leaves out, or single values are wrong; look"
                " at the figure."
            )
        if not self.converged or self.agreeing < 2:
            said.append(
                f"Of {self.starts} starts {self.agreeing} found this minimum: compare the figure before use."
            )
        return tuple(said)

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain numbers, texts, lists and dicts."""
        return {
            "unit": self.unit,
            "parameters": {name: one.to_dict() for name, one in self.parameters.items()},
            "motor_table": self.motor_table(),
            "below_minimum": self.below_minimum,
            "below_minimum_ratio": self.below_minimum_ratio,
            "fitness": vars(self.fitness),
            "directions": [one.to_dict() for one in self.directions],
            "actuators": list(self.actuators),
            "differing": [one.to_dict() for one in self.differing],
            "left_out": self.left_out,
            "trimmed": list(self.trimmed),
            "starts": self.starts,
            "agreeing": self.agreeing,
            "converged": self.converged,
            "distinct_commands": self.distinct_commands,
            "block_s": self.block_s,
            "blocks": self.blocks,
            "sentences": list(self.sentences()),
        }
