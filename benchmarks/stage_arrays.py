"""One stage's logs as plain arrays, segments side by side: what an identification written in NumPy works on.

The signals of the propellers come from the textbook's motor on the half steps that RK4 visits; no motor
coefficient is sought, so they are the same for all candidates and are computed once. Measured axes are
given on the same grid. The weights hold the criterion's, so that a cost is a plain sum of weighted absolute
errors.
Held by tests/benchmarks/test_benchmarks.py: costs equal the core's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import seatrial as st
from benchmarks.textbook_thrusters import motor_response
from benchmarks.textbook_vehicle import Parameters, from_vehicle
from seatrial.base.channels import AXES
from seatrial.estimation.stage import StagePlan
from seatrial.trial.trial import Trial

Array = NDArray[np.float64]

MOTOR = (
    *("neutral", "reversed", "maximum_ahead", "maximum_astern", "minimum_ahead", "minimum_astern"),
    *("below_minimum", "n_acc", "n_dec", "K_V", "T_1", "T_t"),
)


@dataclass(frozen=True)
class StageArrays:
    """A stage of one trial: S segments of n samples, h seconds per step.

    ``names``, ``lower``, ``upper`` (m,) are the coefficients sought; ``free`` the axes that the model moves.
    Starts are ``position`` (3, S), ``attitude`` (4, S) and ``nu`` (6, S). ``signals`` (nodes, actuators, S),
    ``measured`` and ``measured_rate`` (nodes, 6, S) stand on half steps, ``observed`` and ``weight``
    (n, 12, S) on samples.
    """

    parameters: Parameters
    names: tuple[str, ...]
    lower: Array
    upper: Array
    free: str
    substeps: int
    h: float
    position: Array
    attitude: Array
    nu: Array
    signals: Array
    measured: Array
    measured_rate: Array
    observed: Array
    weight: Array

    @property
    def samples(self) -> int:
        """Return the samples per segment, the first one included."""
        return len(self.observed)

    @property
    def steps(self) -> int:
        """Return the time steps of one candidate through all segments."""
        return (self.samples - 1) * self.substeps * int(self.nu.shape[1])

    def part(self, samples: int, segments: int | None = None) -> StageArrays:
        """Return the first ``samples`` of the first ``segments``, of all of them by default."""
        s, nodes = slice(segments), 2 * self.substeps * (samples - 1) + 1
        on_nodes = {
            name: getattr(self, name)[:nodes, :, s] for name in ("signals", "measured", "measured_rate")
        }
        starts = {name: getattr(self, name)[:, s] for name in ("position", "attitude", "nu")}
        on_samples = {name: getattr(self, name)[:samples, :, s] for name in ("observed", "weight")}
        return replace(self, **on_nodes, **starts, **on_samples)


def arrays(plan: StagePlan, vehicle: st.Vehicle, substeps: int) -> StageArrays:
    """Return the arrays of a planned stage of one trial, for a vehicle and steps per sample.

    Raises
    ------
    ValueError
        The stage has several trials, a current, frozen axes, tied coefficients or another loss than absolute.
    """
    data, stage = plan.data, plan.stage
    alone = len(data.trials) == 1 and all(len(one.members) == 1 for one in plan.parameters)
    if (
        data.trials[0].current is not None
        or not alone
        or len(stage.axes.free + stage.axes.measured) != 6
        or stage.loss != "absolute"
    ):
        raise ValueError(
            f"{stage.name}: expected one trial in still water, no tie, no frozen axis, absolute errors"
        )
    trial, parameters = data.trials[0], from_vehicle(vehicle)
    starts = np.array([segment.start for segment in data.segments])
    stops = np.array([segment.stop for segment in data.segments])
    sample = starts + np.arange(int((stops - starts).max()))[:, None]
    inside = sample < stops
    sample = np.minimum(sample, len(trial) - 1)
    node = 2 * substeps * starts + np.arange(2 * substeps * (len(sample) - 1) + 1)[:, None]
    node = np.minimum(node, 2 * substeps * (len(trial) - 1))
    nu, nu_rate = trial.smooth_nu(np.linspace(trial.t[0], trial.t[-1], 2 * substeps * (len(trial) - 1) + 1))
    counting = data.weights > 0
    per_error = np.where(counting, data.weights / np.where(counting, data.scale, 1.0), 0.0)
    counted = data.records[0].counted * (per_error / float(data.weights @ data.counts))
    weight = np.where(inside[:, None, :], counted[sample].transpose(0, 2, 1), 0.0)
    weight[0] = 0.0
    return StageArrays(
        parameters=parameters,
        names=tuple(name for one in plan.parameters for name, _ in one.members),
        lower=np.array([one.lower for one in plan.parameters]),
        upper=np.array([one.upper for one in plan.parameters]),
        free="".join(axis for axis in AXES if axis in stage.axes.free),
        substeps=substeps,
        h=trial.dt / substeps,
        position=np.array([segment.position for segment in data.segments]).T,
        attitude=np.array([segment.attitude for segment in data.segments]).T,
        nu=np.array([segment.nu for segment in data.segments]).T,
        signals=signals(parameters, trial, substeps)[node].transpose(0, 2, 1),
        measured=nu[node].transpose(0, 2, 1),
        measured_rate=nu_rate[node].transpose(0, 2, 1),
        observed=np.nan_to_num(trial.observed)[sample].transpose(0, 2, 1),
        weight=weight,
    )


def signals(parameters: Parameters, trial: Trial, substeps: int) -> Array:
    """Return the actual revolutions (nodes, actuators), rpm, on half steps over the whole trial."""
    known: dict[tuple[object, ...], Array] = {}
    columns = []
    for thruster in parameters.thrusters:
        command = trial.commands[thruster.name]
        # Thrusters of the same motor that are driven together have one response.
        if (key := (command.tobytes(), *(getattr(thruster, name) for name in MOTOR))) not in known:
            known[key] = motor_response(thruster, command, trial.dt, substeps=substeps)
        columns.append(known[key])
    return np.array(columns).T
