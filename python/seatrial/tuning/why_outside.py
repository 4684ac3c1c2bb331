"""Why a response of the vehicle itself leaves its corridor with the tuned gains, in words.

The same step is flown with perfect sensors, in still water. Where it stays inside, noise or latency is what
is left; where not, its figures tell which bound it is that the loop cannot keep to.

Held by tests/test_tune.py and tests/test_tuning_words.py.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from seatrial.tuning.corridor import RISEN
from seatrial.tuning.judged import Judged, JudgedTrial, judge
from seatrial.tuning.loop_trials import Samples

if TYPE_CHECKING:
    from seatrial.tuning.corridor import Corridor
    from seatrial.tuning.step_trial import Rig
    from seatrial.tuning.tuning_plan import TuningPlan

__all__ = ["judged_without_noise", "why_outside"]

_AWAY = 3.0  # steps beyond the set point, which no overshoot is


def judged_without_noise(plan: TuningPlan, rig: Rig) -> Judged:
    """How the vehicle itself keeps to its corridors in still water with perfect sensors.

    Parameters
    ----------
    plan : TuningPlan
    rig : Rig
        With the gains in question.
    """
    return judge(plan, "without noise", replace(rig, sensors=None), Samples({}, np.zeros((1, 3)), (1,)))


def why_outside(quiet: JudgedTrial, corridor: Corridor) -> str:
    """What makes a response leave its corridor, and what to do, from the same step with perfect sensors.

    Parameters
    ----------
    quiet : JudgedTrial
    corridor : Corridor
    """
    if quiet.nominal_s == 0.0:
        return (
            "with perfect sensors it stays inside, so noise or latency is what is left; take larger steps,"
            " or raise settled and overshoot"
        )
    if not quiet.overshoot < _AWAY:  # nor where it diverged
        return "the motion grows at that speed; leave it out of speeds_m_s, or begin with gains that hold it"
    rise = next((time for time, bound in corridor.lower if bound >= RISEN), math.inf)
    lower, upper = corridor.sampled([corridor.until_s])
    most = max((bound for _, bound in corridor.upper), default=math.inf) - 1.0
    if quiet.rise_s > rise:
        told = f"in {quiet.rise_s:.1f} s" if math.isfinite(quiet.rise_s) else "not at all"
        return f"it rises {told}, {rise:g} s are asked; raise rise_s, or take smaller steps"
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
