"""How an autopilot's responses keep to their corridors: every trial, nominal and over samples.

Held by tests/test_tune.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.tuning.corridor_criterion import step_figures
from seatrial.tuning.loop_trials import LoopTrials, Samples
from seatrial.tuning.objective import violated
from seatrial.tuning.step_trial import Rig
from seatrial.tuning.tuning_file import LOOPS

if TYPE_CHECKING:
    from seatrial._core import Autopilot
    from seatrial.tuning.tuning_plan import Group, TuningPlan

__all__ = ["Judged", "JudgedTrial", "Responses", "judge"]

Array = NDArray[np.float64]

_SHOWN = 9  # samples whose responses are kept for figures


@dataclass(frozen=True)
class JudgedTrial:
    """A step of a loop at a speed, there and back.

    Attributes
    ----------
    loop, unit, speed_m_s, step
        Which; the step in the unit.
    nominal_s, worst_s
        Violation of the corridors, s: the largest of the vehicle itself in still water over several noises,
        and of all samples.
    held
        Share of the drawn vehicles that violate nothing.
    rise_s, overshoot, settling_s, steady_error
        Of the nominal response there; shares of the step, times in s, inf: never.
    """

    loop: str
    unit: str
    speed_m_s: float
    step: float
    nominal_s: float
    worst_s: float
    held: float
    rise_s: float
    overshoot: float
    settling_s: float
    steady_error: float


@dataclass(frozen=True, eq=False)
class Responses:
    """Answers of a loop for figures: times (p,), s, and values (trials, samples, p), SI.

    The samples are the nominal one, then those that leave the corridors furthest.
    """

    trials: LoopTrials
    t: Array
    values: Array

    def normalised(self, trial: int) -> Array:
        """Answers (samples, p) of a trial as shares of its step: 0 before, 1 at the new set point."""
        return np.asarray((self.values[trial] - self.base(trial)) / self.trials.sizes[trial])

    def base(self, trial: int) -> float:
        """Set point before the step, SI."""
        return self.trials.base(trial)


@dataclass(frozen=True, eq=False)
class Judged:
    """An autopilot's responses, judged.

    Attributes
    ----------
    name
        "start", "relay", "tuned".
    autopilot
        Which.
    trials
        A `JudgedTrial` each.
    samples
        How many drawn vehicles with currents.
    responses
        Per loop, for figures.
    """

    name: str
    autopilot: Autopilot
    trials: tuple[JudgedTrial, ...]
    samples: int
    responses: Mapping[str, Responses]

    @property
    def nominal_s(self) -> float:
        """Violation of all trials of the vehicle itself, s."""
        return sum(trial.nominal_s for trial in self.trials)

    @property
    def worst_s(self) -> float:
        """Largest violation of a trial by a sample, s."""
        return max((trial.worst_s for trial in self.trials), default=0.0)

    @property
    def feasible(self) -> bool:
        """Whether the vehicle itself violates no corridor."""
        return self.nominal_s == 0.0

    def to_dict(self) -> dict[str, Any]:
        """All of it as plain data, without responses."""
        return {
            "name": self.name,
            "autopilot": self.autopilot.name,
            "samples": self.samples,
            "nominal_s": self.nominal_s,
            "worst_s": self.worst_s,
            "feasible": self.feasible,
            "trials": [asdict(trial) for trial in self.trials],
        }


def judge(
    plan: TuningPlan,
    name: str,
    rig: Rig,
    samples: Samples,
    *,
    only: Sequence[Group] | None = None,
    responses: bool = True,
) -> Judged:
    """How the responses of the rig's autopilot keep to the corridors of a plan.

    Parameters
    ----------
    plan : TuningPlan
    name : str
        What to call it.
    rig : Rig
    samples : Samples
        The first are the nominal ones.
    only : sequence of Group, optional
        The groups to try; all by default.
    responses : bool, optional
        Whether to keep responses and take their figures.
    """
    found: list[JudgedTrial] = []
    kept: dict[str, Responses] = {}
    for trials in (trials for group in only or plan.groups for trials in group.trials):
        sums, _ = rig.violations(trials, samples, {})
        total = violated(trials, sums)[0]
        shown = None
        if responses:
            t, values = rig.responses(trials, _worst(samples, total), {})
            shown = kept[trials.loop] = Responses(trials, t, values[trials.names[0]])
        for k in range(len(trials)):
            found.append(_judged(trials, k, (total[k], samples.nominal), shown))
    return Judged(name, rig.autopilot, tuple(found), len(samples) - samples.nominal, kept)


def _worst(samples: Samples, total: Array) -> Samples:
    """The first of some samples and those that violate most, of violations (trials, samples)."""
    worst = total.max(axis=0)
    worst[0] = np.inf
    rows = np.argsort(-worst, kind="stable")[:_SHOWN]
    return Samples(
        {name: np.asarray(values)[rows] for name, values in samples.coefficients.items()},
        samples.current[rows],
        tuple(samples.seeds[row] for row in rows),
    )


def _judged(
    trials: LoopTrials, k: int, violations: tuple[Array, int], shown: Responses | None
) -> JudgedTrial:
    total, nominal = violations
    drawn = total[nominal:] if len(total) > nominal else total
    entry = LOOPS[trials.loop]
    nan = float("nan")
    figures = dict.fromkeys(("rise_s", "overshoot", "settling_s", "steady_error"), nan)
    if shown is not None:
        since = shown.t - trials.settle_s
        there = since < trials.until_s
        found = asdict(step_figures(since[there], shown.normalised(k)[0][there], band=trials.settled))
        figures = {key: found[key] for key in figures}
    return JudgedTrial(
        loop=trials.loop,
        unit=entry.unit,
        speed_m_s=trials.speeds[k],
        step=float(f"{trials.sizes[k] / entry.to_si:.9g}"),  # as it stood in the file
        nominal_s=float(total[:nominal].max()),
        worst_s=float(total.max()),
        held=float((drawn == 0.0).mean()),
        **figures,
    )
