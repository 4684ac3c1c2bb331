"""What a loop does with the gains that it has, flown in still water: noise at rest, and figures of a step.

The noise at rest is what sensors, dead band and least thrust leave of a straight line: the standard deviation
of the answer over the second half of the time before the step, its trend taken out. No corridor is narrower
than five of them, and no step so small that this would be wider than its band. The figures of the step
(`seatrial.tuning.corridor_criterion.step_figures`) keep a default corridor from asking for more than the
vehicle can do.

Held by tests/test_tuning_plan.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.tuning.corridor_criterion import step_figures
from seatrial.tuning.loop_trials import LoopTrials, Samples

if TYPE_CHECKING:
    from seatrial.tuning.step_trial import Rig

__all__ = ["StartFigures", "start_figures"]

Array = NDArray[np.float64]

_SEEDS = (11, 12)
_UNSOUND = 1.0  # overshoot as a share of the step from which a response is no response
_AT_REST = 0.25  # of the step: what moves more at rest, as the deviation, is not held at all


@dataclass(frozen=True)
class StartFigures:
    """Figures of a loop over its trials; those that are not held at all are left out.

    Attributes
    ----------
    noise
        Largest standard deviation at rest, SI; 0 where no trial is held.
    rise_s, overshoot, settling_s
        Largest of the steps; overshoot as a share of the step. A step that never rises has no rise time, one
        that does not settle takes all of its time. 0 where nothing is held.
    """

    noise: float
    rise_s: float
    overshoot: float
    settling_s: float


def start_figures(rig: Rig, trials: LoopTrials) -> StartFigures:
    """Figures of a loop with the rig's gains, the vehicle itself in still water.

    Parameters
    ----------
    rig : Rig
    trials : LoopTrials
    """
    still = Samples({}, np.zeros((len(_SEEDS), 3)), _SEEDS, len(_SEEDS))
    t, answers = rig.responses(trials, still, {})
    values = answers[trials.names[0]]
    rest = (t > 0.5 * trials.settle_s) & (t <= trials.settle_s)
    there = (t >= trials.settle_s) & (t < trials.settle_s + trials.until_s)
    noises, steps = [0.0], []
    for trial, size in enumerate(trials.sizes):
        for each in values[trial]:
            deviation = _about_a_line(t[rest], each[rest])
            normalised = (each[there] - trials.base(trial)) / size
            if not (np.isfinite(normalised).all() and deviation < _AT_REST * abs(size)):
                continue
            noises.append(deviation)
            found = step_figures(t[there] - trials.settle_s, normalised, band=trials.settled)
            if found.overshoot < _UNSOUND:
                steps.append((found.rise_s, found.overshoot, min(found.settling_s, trials.until_s)))
    table = np.array(steps).reshape(-1, 3)
    largest = np.where(np.isfinite(table), table, 0.0).max(axis=0, initial=0.0)
    return StartFigures(max(noises), *(float(value) for value in largest))


def _about_a_line(t: Array, values: Array) -> float:
    """Standard deviation about the straight line that fits best."""
    if len(t) < 3 or not np.isfinite(values).all():
        return float("inf")
    return float(np.std(values - np.polyval(np.polyfit(t - t[0], values, 1), t - t[0])))
