"""Start gains that are better than what a search found: a tuning hands out nothing worse than what there was.

A group is searched beside the gains of the others, which may move afterwards, and its margins may have cost
it more than they are worth. Group by group the start gains are tried again beside all others, and stay
where everything together is better with them.

Held by tests/test_take_back.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from seatrial.tuning.group_search import constraint
from seatrial.tuning.judged import judge
from seatrial.tuning.objective import LACKING, OUTSIDE

if TYPE_CHECKING:
    from seatrial.tuning.loop_trials import Samples
    from seatrial.tuning.tuning_plan import TuningPlan

__all__ = ["score", "take_back"]

_STEP_S = 0.04
_DIVERGED_S = 1e6  # a response that diverges counts as much: one fewer of them is better


def take_back(
    plan: TuningPlan, gains: Mapping[str, float], samples: Samples, *, threads: int | None = None
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Gains of which no group is worse than its start, and the groups that have their start gains again.

    Parameters
    ----------
    plan : TuningPlan
    gains : mapping of str to float
        Found, by the names of `Autopilot.gains`.
    samples : Samples
    threads : int, optional
        All by default.
    """
    start, kept = plan.autopilot.gains(), dict(gains)
    best = score(plan, kept, samples, threads=threads)
    back = []
    for group in plan.groups:
        if best == 0.0:
            break
        names = {name for parameter in group.parameters.parameters for name in parameter.starts}
        tried = kept | {name: start[name] for name in names}
        found = score(plan, tried, samples, threads=threads)
        if found < best:
            kept, best = tried, found
            back.append(group.name)
    return kept, tuple(back)


def score(
    plan: TuningPlan, gains: Mapping[str, float], samples: Samples, *, threads: int | None = None
) -> float:
    """Seconds outside the corridors, the worst sample of every trial, and margins in the search's weights."""
    autopilot = plan.autopilot.with_gains(dict(gains))
    rig = plan.rig(autopilot, max_step=_STEP_S, threads=threads)
    judged = judge(plan, "", rig, samples, responses=False)
    limits = constraint(plan, autopilot)
    lacking = 0.0 if limits is None else float(limits.shortfall({})[0])
    outside = sum(min(trial.worst_s, _DIVERGED_S) for trial in judged.trials)
    return outside + LACKING / OUTSIDE * lacking
