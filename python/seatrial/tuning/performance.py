"""How an autopilot's responses keep to their corridors: every trial, nominal and over samples, and why not.

Why a response leaves its corridor tells the same step with perfect sensors, in still water: where it stays
inside, noise or latency is what is left; where not, its metrics tell which bound the loop cannot keep to.

Held by tests/tuning/test_tune.py, tests/tuning/test_performance_claims.py and
tests/tuning/test_tuning_words.py.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.plain import Plain
from seatrial.control_design.corridor import RISEN
from seatrial.control_design.tuning_table import LOOPS
from seatrial.tuning.criterion import step_metrics
from seatrial.tuning.objective import violated
from seatrial.tuning.step_trial import LoopTrials, Rig, Samples

if TYPE_CHECKING:
    from seatrial._core import Autopilot
    from seatrial.control_design.corridor import Corridor
    from seatrial.tuning.control_problem import ControlProblem, Group

_SHOWN = 9  # samples whose responses are kept for figures


@dataclass(frozen=True)
class StepPerformance:
    """A step of a loop at a speed, there and back.

    Attributes
    ----------
    loop, unit, speed_m_s, step
        Which; the step in the unit.
    nominal_s, worst_s
        Violation of the corridors, s: the largest of the vehicle itself in still water over several noises,
        and of all samples. Infinite where the answer diverges.
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
class Performance(
    Plain, without="autopilot responses", also="autopilot=autopilot.name nominal_s worst_s feasible"
):
    """How an autopilot's responses keep to their corridors.

    Attributes
    ----------
    name
        "start", "tuned".
    autopilot
        Which.
    trials
        A `StepPerformance` each.
    samples
        How many drawn vehicles with currents.
    responses
        Per loop, for figures.
    """

    name: str
    autopilot: Autopilot
    trials: tuple[StepPerformance, ...]
    samples: int
    responses: Mapping[str, Responses]

    @property
    def nominal_s(self) -> float:
        """Violation of all trials of the vehicle itself, s."""
        return sum(trial.nominal_s for trial in self.trials)

    @property
    def outside_s(self) -> dict[str, float]:
        """Violation of the vehicle itself per loop, over its trials, s."""
        outside: dict[str, float] = {}
        for trial in self.trials:
            outside[trial.loop] = outside.get(trial.loop, 0.0) + trial.nominal_s
        return outside

    @property
    def worst_s(self) -> float:
        """Largest violation of a trial by a sample, s."""
        return max((trial.worst_s for trial in self.trials), default=0.0)

    @property
    def feasible(self) -> bool:
        """Whether the vehicle itself violates no corridor."""
        return self.nominal_s == 0.0


def assess(
    plan: ControlProblem,
    name: str,
    rig: Rig,
    samples: Samples,
    *,
    only: Sequence[Group] | None = None,
    responses: bool = True,
) -> Performance:
    """How the responses of the rig's autopilot keep to the corridors of a plan.

    Parameters
    ----------
    plan : ControlProblem
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
    performances: list[StepPerformance] = []
    kept: dict[str, Responses] = {}
    for trials in (trials for group in only or plan.groups for trials in group.trials):
        sums, _, _ = rig.violations(trials, samples, {})
        total = np.where(_diverges(trials, sums)[0], np.inf, violated(trials, sums)[0])
        shown = None
        if responses:
            t, values = rig.responses(trials, _worst(samples, total), {})
            shown = kept[trials.loop] = Responses(trials, t, values[trials.names[0]])
        for k in range(len(trials)):
            performances.append(_step_performance(trials, k, (total[k], samples.nominal), shown))
    return Performance(name, rig.autopilot, tuple(performances), len(samples) - samples.nominal, kept)


def _diverges(trials: LoopTrials, sums: Array) -> Array:
    """Whether an answer is on the average further outside than an actuator at rest would leave it.

    A vehicle that never moves is outside by at most the whole step, there and back. Shape (k, trials,
    samples), of sums (k, trials, samples, corridors, 3).
    """
    outside = sums[..., 0, :2].sum(axis=-1)
    return np.asarray(~(outside <= 2.0 * trials.until_s))


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


def _step_performance(
    trials: LoopTrials, k: int, violations: tuple[Array, int], shown: Responses | None
) -> StepPerformance:
    total, nominal = violations
    drawn = total[nominal:] if len(total) > nominal else total
    entry = LOOPS[trials.loop]
    nan = float("nan")
    figures = dict.fromkeys(("rise_s", "overshoot", "settling_s", "steady_error"), nan)
    if shown is not None:
        since = shown.t - trials.settle_s
        there = since < trials.until_s
        metrics = asdict(step_metrics(since[there], shown.normalised(k)[0][there], band=trials.settled))
        figures = {key: metrics[key] for key in figures}
    return StepPerformance(
        loop=trials.loop,
        unit=entry.unit,
        speed_m_s=trials.speeds[k],
        step=float(f"{trials.sizes[k] / entry.to_si:.9g}"),  # as it stood in the file
        nominal_s=float(total[:nominal].max()),
        worst_s=float(total.max()),
        held=float((drawn == 0.0).mean()),
        **figures,
    )


_AWAY = 3.0  # steps beyond the set point, which no overshoot is


def assess_without_noise(plan: ControlProblem, rig: Rig) -> Performance:
    """How the vehicle itself keeps to its corridors in still water with perfect sensors, on a rig's gains."""
    return assess(plan, "without noise", replace(rig, sensors=None), Samples({}, np.zeros((1, 3)), (1,)))


def why_outside(quiet: StepPerformance, corridor: Corridor) -> str:
    """What makes a response leave its corridor, and what to do, from the same step with perfect sensors."""
    if quiet.nominal_s == 0.0:
        return (
            "with perfect sensors it stays inside, so sensor noise or latency is the cause; take larger"
            " steps, or raise settled and overshoot"
        )
    if not quiet.overshoot < _AWAY:  # nor where it diverged
        return "the motion grows at that speed; leave it out of speeds_m_s, or begin with gains that hold it"
    rise = next((time for time, bound in corridor.lower if bound >= RISEN), math.inf)
    lower, upper = corridor.sampled([corridor.until_s])
    most = max((bound for _, bound in corridor.upper), default=math.inf) - 1.0
    if quiet.rise_s > rise:
        reached = f"in {quiet.rise_s:.1f} s" if math.isfinite(quiet.rise_s) else "not at all"
        return f"it rises {reached}, {rise:g} s are asked; raise rise_s, or take smaller steps"
    if quiet.overshoot > most:
        return (
            f"it overshoots by {quiet.overshoot:.0%} without noise, too, {most:.0%} are allowed; raise"
            " overshoot, or rise_s for gentler gains"
        )
    if not math.isfinite(quiet.settling_s):
        return (
            f"it is not within {100.0 * (1.0 - lower[0]):.0f} % below and {100.0 * (upper[0] - 1.0):.0f} %"
            f" above its set point by {corridor.until_s:g} s; raise settled or until_s"
        )
    return "it settles late, there or on the way back; raise settling_s"
