"""Reverts groups of gains to their start values where the search made a loop worse.

A group is searched beside the gains of the others, which may move afterwards, and its margins may have cost
it more than they are worth. Each time the group that improves most is reverted, until
no loop is further outside than with the start gains. What no group owns and the search of the margins has
moved is one more of them; all start gains are the last resort. What the vehicle itself keeps to, corridors
and margins in the weights of the search, is not given up: neither for one loop nor for the worst of the
drawn vehicles. And no tuning returns less than the start gains had of what was asked for
(`Standing.worse_than`): responses inside their corridors are not traded for margins that nobody asked for.

Held by tests/tuning/test_revert_gains.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from seatrial.tuning.objective import LACKING, OUTSIDE
from seatrial.tuning.performance import Performance, assess
from seatrial.tuning.search import ROUNDING, short_loops
from seatrial.tuning.step_trial import Samples

if TYPE_CHECKING:
    from seatrial.control_design.margin_constraint import MarginConstraint
    from seatrial.tuning.control_problem import ControlProblem

_STEP_S = 0.02  # longest step of the vehicle, s: that of the last assessment

_DIVERGED_S = 1e6  # a response that diverges counts as much: one fewer of them is better

_SAME_S = 1e-6  # s: less is rounding

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
    short
        Loops (mode, speed in m/s, loop) whose margins fall short, beyond rounding, or whose motion grows.
    inside
        Responses of the vehicle itself that stay within their corridors.
    growth
        Rate of the fastest motion that grows, 1/s; 0 where none does.
    """

    outside_s: Mapping[str, tuple[float, float]]
    lacking: float
    short: frozenset[tuple[str, float, str]] = frozenset()
    inside: int = 0
    growth: float = 0.0

    @property
    def own(self) -> float:
        """Seconds outside of the vehicle itself, and margins in the search's weights."""
        return sum(own for own, _ in self.outside_s.values()) + LACKING / OUTSIDE * self.lacking

    @property
    def score(self) -> float:
        """Seconds outside, the worst sample of every trial, and margins in the search's weights."""
        return sum(worst for _, worst in self.outside_s.values()) + LACKING / OUTSIDE * self.lacking

    def lost(self, start: Standing) -> frozenset[tuple[str, float, str]]:
        """Loops whose margins are short and were not with the start gains."""
        return self.short - start.short

    def worse_than(self, start: Standing, *, margins_asked: bool) -> bool:
        """Whether the start gains have more of what was asked for.

        A motion that grows counts before all, since no vehicle can be flown with it. Then the responses
        inside their corridors count, and where they are as many, the seconds outside of the vehicle itself.
        Margins count where the campaign states them: fewer loops that lack them are then worth a response.
        """
        if self.growth != start.growth:
            return self.growth > start.growth
        if margins_asked and self.short < start.short:
            return False
        if self.inside != start.inside:
            return self.inside < start.inside
        outside, begun = (sum(own for own, _ in each.outside_s.values()) for each in (self, start))
        return outside > begun + _SAME

    def worse(self, start: Standing) -> tuple[str, ...]:
        """Loops that leave their corridors further than with the start gains.

        The vehicle itself at all, or the worst of the drawn ones by more than chance makes of one sample.
        """
        loops = []
        for loop, (own, worst) in self.outside_s.items():
            own_start, worst_start = start.outside_s[loop]
            # The worst of the samples may be half worse, and 0.1 s of a step, by luck.
            if own > own_start + _SAME_S or worst > 1.5 * worst_start + 0.1:
                loops.append(loop)
        return tuple(loops)


def revert_gains(
    plan: ControlProblem,
    gains: Mapping[str, float],
    samples: Samples,
    *,
    first: Mapping[str, Mapping[str, float]] | None = None,
    threads: int | None = None,
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Gains with which no loop is worse than before, and the groups that have their start gains again.

    `first`: gains of the first turn, by the name of a group that had a second one.
    """
    start, kept = plan.autopilot.gains(), dict(gains)
    asked = "margins" in plan.table.model_fields_set
    now = standing(plan, kept, samples, threads=threads)
    if now.score == 0.0:
        return kept, ()
    begun = standing(plan, {}, samples, threads=threads)
    # A second turn that spoiled another loop gives way to the first one before the start gains do.
    for former in (first or {}).values():
        tried_first = kept | dict(former)
        if _is_better(
            found_first := standing(plan, tried_first, samples, threads=threads), now, begun, asked
        ):
            kept, now = tried_first, found_first
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
        standings = {group: standing(plan, each, samples, threads=threads) for group, each in tried.items()}
        better = [group for group, candidate in standings.items() if _is_better(candidate, now, begun, asked)]
        if not better:
            break
        best = min(better, key=lambda group: _order(standings[group], begun, asked))
        kept, now = tried[best], standings[best]
        back.append(best)
        del moved[best]
    if moved and _is_better(begun, now, begun, asked):
        return {name: start[name] for name in kept}, (*back, *moved)
    return kept, tuple(back)


def _order(candidate: Standing, start: Standing, margins_asked: bool) -> tuple[bool, int, int, float]:
    return (
        candidate.worse_than(start, margins_asked=margins_asked),
        len(candidate.lost(start)),
        len(candidate.worse(start)),
        candidate.score,
    )


def _is_better(candidate: Standing, now: Standing, start: Standing, margins_asked: bool) -> bool:
    """Whether some gains are to be preferred, and not at the price of the vehicle itself.

    What the start gains have of what was asked for comes first. Then margins that the start gains have are
    worth more than any corridor, but not than margins that they lack.
    """
    if _order(candidate, start, margins_asked) >= _order(now, start, margins_asked):
        return False
    if now.worse_than(start, margins_asked=margins_asked) > candidate.worse_than(
        start, margins_asked=margins_asked
    ):
        return True
    regained = len(candidate.lost(start)) < len(now.lost(start)) and candidate.lacking <= now.lacking
    return regained or candidate.own <= now.own + _SAME


def standing(
    plan: ControlProblem, gains: Mapping[str, float], samples: Samples, *, threads: int | None = None
) -> Standing:
    """How some gains stand, all others those of the start; the first samples are the vehicle itself."""
    autopilot = plan.autopilot.with_gains(dict(gains))
    rig = plan.rig(autopilot, max_step_s=_STEP_S, threads=threads)
    performance = assess(plan, "", rig, samples, responses=False)
    inside = sum(trial.nominal_s == 0.0 for trial in performance.trials)
    if plan.margins is None:
        return Standing(_outside(performance), 0.0, inside=inside)
    lacking, growth = (float(of(gains)[0]) for of in (plan.margins.shortfall, plan.margins.growth))
    return Standing(_outside(performance), lacking, _short(plan.margins, gains), inside, growth)


def _short(limits: MarginConstraint, gains: Mapping[str, float]) -> frozenset[tuple[str, float, str]]:
    """Loops (mode, speed in m/s, loop) whose margins fall short by more than rounding."""
    return frozenset(
        (point.mode, point.speed_m_s, loop)
        for point in limits.margins(gains)
        for loop in short_loops(point, limits, beyond=ROUNDING)
    )


def _outside(performance: Performance) -> dict[str, tuple[float, float]]:
    outside: dict[str, tuple[float, float]] = {}
    for trial in performance.trials:
        nominal, worst = outside.get(trial.loop, (0.0, 0.0))
        outside[trial.loop] = (
            nominal + min(trial.nominal_s, _DIVERGED_S),
            worst + min(trial.worst_s, _DIVERGED_S),
        )
    return outside
