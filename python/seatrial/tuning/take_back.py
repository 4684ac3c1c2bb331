"""Start gains that are better than what a search found: a tuning hands out nothing worse than what there was.

A group is searched beside the gains of the others, which may move afterwards, and its margins may have cost
it more than they are worth. Where a loop leaves its corridors further than with the start gains, or where
everything together is worse, groups get their start gains again, each time the one that mends most, until no
loop is worse. What no group owns and the search of the margins has moved is one more of them; all start gains
are the last resort. What the vehicle itself keeps to, corridors and margins in the weights of the search, is
not given up: neither for one loop nor for the worst of the drawn vehicles.

Held by tests/test_take_back.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from seatrial.tuning.group_search import constraint
from seatrial.tuning.judged import Judged, judge
from seatrial.tuning.objective import LACKING, OUTSIDE

if TYPE_CHECKING:
    from seatrial.tuning.loop_trials import Samples
    from seatrial.tuning.tuning_plan import TuningPlan

__all__ = ["Standing", "standing", "take_back"]

_STEP_S = 0.02
_DIVERGED_S = 1e6  # a response that diverges counts as much: one fewer of them is better
_SAME_S = 1e-6
_LUCK, _LUCK_S = 1.5, 0.1  # of one sample: share, and s of a step
_SAME = 0.03  # s outside, as much as a hundredth of a margin
_OTHERS = "what no loop of the search owns"


@dataclass(frozen=True)
class Standing:
    """How a set of gains stands.

    Attributes
    ----------
    outside_s
        Per loop the violation of the vehicle itself, and that of the worst sample, summed over trials, s.
    lacking
        Shortfall of the margins.
    """

    outside_s: Mapping[str, tuple[float, float]]
    lacking: float

    @property
    def own(self) -> float:
        """Seconds outside of the vehicle itself, and margins in the search's weights."""
        return sum(own for own, _ in self.outside_s.values()) + LACKING / OUTSIDE * self.lacking

    @property
    def score(self) -> float:
        """Seconds outside, the worst sample of every trial, and margins in the search's weights."""
        return sum(worst for _, worst in self.outside_s.values()) + LACKING / OUTSIDE * self.lacking

    def worse(self, start: Standing) -> tuple[str, ...]:
        """Loops that leave their corridors further than with the start gains.

        The vehicle itself at all, or the worst of the drawn ones by more than chance makes of one sample.
        """
        found = []
        for loop, (own, worst) in self.outside_s.items():
            own_start, worst_start = start.outside_s[loop]
            if own > own_start + _SAME_S or worst > _LUCK * worst_start + _LUCK_S:
                found.append(loop)
        return tuple(found)


def take_back(
    plan: TuningPlan, gains: Mapping[str, float], samples: Samples, *, threads: int | None = None
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Gains with which no loop is worse than before, and the groups that have their start gains again.

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
    now = standing(plan, kept, samples, threads=threads)
    if now.score == 0.0:
        return kept, ()
    begun = standing(plan, {}, samples, threads=threads)

    groups = {
        group.name: {name for parameter in group.parameters.parameters for name in parameter.starts}
        for group in plan.groups
    }
    owned = set().union(*groups.values())
    groups[_OTHERS] = {name for name in kept if name not in owned}
    moved = {
        group: names
        for group, names in groups.items()
        if any(kept.get(name, start[name]) != start[name] for name in names)
    }
    back: list[str] = []
    while moved:
        tried = {
            group: kept | {name: start[name] for name in names if name in kept}
            for group, names in moved.items()
        }
        found = {group: standing(plan, each, samples, threads=threads) for group, each in tried.items()}
        better = [group for group, one in found.items() if _is_better(one, now, begun)]
        if not better:
            break
        best = min(better, key=lambda group: _order(found[group], begun))
        kept, now = tried[best], found[best]
        back.append(best)
        del moved[best]
    if moved and _is_better(begun, now, begun):
        return {name: start[name] for name in kept}, (*back, *moved)
    return kept, tuple(back)


def _order(one: Standing, start: Standing) -> tuple[int, float]:
    return len(one.worse(start)), one.score


def _is_better(one: Standing, now: Standing, start: Standing) -> bool:
    """Whether some gains are to be preferred, and not at the price of the vehicle itself."""
    return one.own <= now.own + _SAME and _order(one, start) < _order(now, start)


def standing(
    plan: TuningPlan, gains: Mapping[str, float], samples: Samples, *, threads: int | None = None
) -> Standing:
    """How some gains stand, all others those of the start.

    Parameters
    ----------
    plan : TuningPlan
    gains : mapping of str to float
    samples : Samples
        The first are the vehicle itself.
    threads : int, optional
        All by default.
    """
    autopilot = plan.autopilot.with_gains(dict(gains))
    rig = plan.rig(autopilot, max_step=_STEP_S, threads=threads)
    judged = judge(plan, "", rig, samples, responses=False)
    limits = constraint(plan, autopilot)
    lacking = 0.0 if limits is None else float(limits.shortfall({})[0])
    return Standing(_outside(judged), lacking)


def _outside(judged: Judged) -> dict[str, tuple[float, float]]:
    found: dict[str, tuple[float, float]] = {}
    for trial in judged.trials:
        nominal, worst = found.get(trial.loop, (0.0, 0.0))
        found[trial.loop] = (
            nominal + min(trial.nominal_s, _DIVERGED_S),
            worst + min(trial.worst_s, _DIVERGED_S),
        )
    return found
