"""Lookahead distance and integral gain of guidance that go with the tuned loops.

A lookahead is made for the delay of the course (`seatrial.control_design.start_guidance`): that of the start
gains is too long for loops that a tuning has made faster, and too short for those that it has calmed. After
the loops each path over one of them, the cross-track error over heading and the depth over pitch, gets its
own, unless the campaign has the path searched together with its loop:

1. Delta_0 = 2 U tau with the delay tau of the course that the tuned loop has, sensors included.
2. Candidates: 0.4 to 4 Delta_0, each with the integral gain that goes with the speed (a quarter of it, a
   tenth in the vertical plane), and what the file has.
3. Each flies steps of the path, sideways or down, small and as large as Delta_0, there and back, at the
   speeds of the path's trials; in still water and in a current from all sides, with drawn vehicles and the
   sensors of the tuning. The first step comes at once, so that the approach has to learn the current.
4. The least 10 Q + T counts, as in the search of the gains: Q is the time beyond an overshoot of 30 % of the
   step in still water, T the time-weighted error, means over all flights, in s; of equals (5 %) the longest
   lookahead.

An overshoot is part of an integral line of sight: with kappa = U/4 and no delay it is e^-2 = 13.5 % of the
step (y = (1 - a t) e^(-a t), a = U/2 Delta). Within 30 % every swing is less than a third of the one before.

Sources: Børhaug, Pavlov and Pettersen (2008), equations 8 and 9; Fossen (2011), section 10.3. Held by
tests/tuning/test_path_following.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.control_design.autopilot_facts import autopilot_facts
from seatrial.control_design.corridor import Corridor
from seatrial.control_design.operating_points import measurement_delays
from seatrial.control_design.start_guidance import CRUISE_LEG, INTEGRAL_SHARES, LEAST_LENGTHS, lookahead_of
from seatrial.control_design.tuning_table import LOOPS, default_steps
from seatrial.tuning.loop_steps import usual_speeds
from seatrial.tuning.objective import OUTSIDE, violated
from seatrial.tuning.step_trial import RIDES_ON, LoopTrials, Rig, Samples

if TYPE_CHECKING:
    from seatrial._core import Autopilot
    from seatrial.tuning.scope import TuningScope

GUIDANCE = {
    "depth": ("guidance.lookahead_vertical_m", "guidance.integral_gain_vertical_m_s"),
    "cross_track": ("guidance.lookahead_m", "guidance.integral_gain_m_s"),
}
"""Lookahead and integral gain of each path, by the names of `Autopilot.gains`."""

_FACTORS = np.geomspace(0.4, 4.0, 11)  # of the usual lookahead: steps of a quarter

_CANDIDATES = len(_FACTORS) + 1  # that of the file included

_OVERSHOOT = 0.3  # of the step across the path, that is accepted

_DELAYS, _SHORTEST_S, _LONGEST_S = 24.0, 30.0, 150.0  # a path settles within 24 delays: 6 times 2 Delta/U

_SETTLE_S = 1.0  # the step comes before a drift is learnt: how soon it is counts as well

_LARGE = 3.0  # the large step over the usual one, at least

_FEW = 2  # drawn vehicles and currents, at least: still water tells nothing of an integral


def course_lookahead(scope: TuningScope, autopilot: Autopilot, path: str) -> tuple[float, float, float]:
    """Lookahead in m that goes with an autopilot's gains, the speed in m/s and the delay in s it is for."""
    given = float(autopilot_facts(autopilot).guidance["lookahead_speed_m_s"])
    speeds = usual_speeds(scope, path)
    speed = float(np.clip(given or CRUISE_LEG * scope.top_m_s, min(speeds), max(speeds)))
    late = measurement_delays(scope.sensors, scope.vehicle)
    distance, tau = lookahead_of(scope.vehicle, autopilot, RIDES_ON[path], speed, late_s=late)
    return max(distance, LEAST_LENGTHS * scope.vehicle.geometry().get("length", 0.0)), speed, tau


def path_trials(scope: TuningScope, path: str, distance_m: float, delay_s: float) -> LoopTrials:
    """Small and large steps of "cross_track" or "depth" at its speeds, against a bound of the overshoot.

    They are made for the lookahead `distance_m` and the delay `delay_s` of the course.
    """
    small = default_steps(path, top_m_s=scope.top_m_s)[0] * LOOPS[path].to_si
    large = min(max(_LARGE * small, distance_m), 30.0)  # m: a larger step across the path is another mission
    speeds = usual_speeds(scope, path)
    # Time for two and a half ways of the large step at the slowest speed.
    until_s = max(_DELAYS * delay_s, 2.5 * large / min(speeds))
    until_s = float(f"{np.clip(until_s, _SHORTEST_S, _LONGEST_S):.3g}")
    return LoopTrials(
        loop=path,
        corridor=Corridor((), ((0.0, 1.0 + _OVERSHOOT), (until_s, 1.0 + _OVERSHOOT))),
        beside={},
        speeds=tuple(np.repeat(speeds, 2).tolist()),
        sizes=(small, large) * len(speeds),
        settle_s=_SETTLE_S,
    )


@dataclass(frozen=True)
class PathNumbers:
    """What was chosen for some paths.

    Attributes
    ----------
    gains
        By the names of `Autopilot.gains`.
    before, after
        Violation and time-weighted error, s, with what the file had and with what was chosen.
    evaluations, flown_s
        Sets of numbers that were tried, and the time that they flew, s.
    """

    gains: Mapping[str, float]
    before: Mapping[str, float]
    after: Mapping[str, float]
    evaluations: int
    flown_s: float


def path_work_s(scope: TuningScope, paths: Sequence[str]) -> float:
    """Time that `search_paths` flies at most, s."""
    flights = _CANDIDATES * (1 + max(scope.table.samples, _FEW)) * 2
    return sum(flights * len(usual_speeds(scope, path)) * 3.0 * _LONGEST_S for path in paths)


def search_paths(scope: TuningScope, rig: Rig, paths: Sequence[str], *, seed: int) -> PathNumbers:
    """Numbers of guidance for the paths, "cross_track" and "depth", of a rig with the tuned gains."""
    samples = scope.samples(max(scope.table.samples, _FEW), seed)
    gains = dict[str, float]()
    before, after = dict.fromkeys(("violation", "time"), 0.0), dict.fromkeys(("violation", "time"), 0.0)
    tried, flown_s = 0, 0.0
    for path in paths:
        distance, speed, tau = course_lookahead(scope, rig.autopilot, path)
        trials = path_trials(scope, path, distance, tau)
        numbers = _candidates(rig.autopilot, path, distance, INTEGRAL_SHARES[path] * speed)
        judged = _judged(rig, trials, samples, numbers)
        chosen = judged.best(numbers[GUIDANCE[path][0]])
        gains |= {name: float(values[chosen]) for name, values in numbers.items()}
        for ends, place in ((before, -1), (after, chosen)):
            ends["violation"] += float(judged.outside[place])
            ends["time"] += float(judged.late[place])
        tried += len(judged.late)
        flown_s += len(judged.late) * len(samples) * len(trials) * trials.duration_s
    return PathNumbers(gains, before, after, tried, flown_s)


def _candidates(autopilot: Autopilot, path: str, distance: float, integral: float) -> dict[str, Array]:
    """Lookaheads and integral gains (k,) by name, those of the file last."""
    own = autopilot.gains()
    grid = _FACTORS * distance, np.full(len(_FACTORS), integral)
    return {name: np.append(values, own[name]) for name, values in zip(GUIDANCE[path], grid, strict=True)}


@dataclass(frozen=True, eq=False)
class _Judged:
    """Candidates (k,): mean time beyond the bound of the overshoot, and mean time-weighted error, s."""

    outside: Array
    late: Array

    def best(self, distances: Array) -> int:
        """The candidate to take, of lookaheads (k,) in m."""
        cost = OUTSIDE * self.outside + self.late
        # What differs by less than 5 % of the least cost is as good.
        equal = np.flatnonzero(cost <= 1.05 * cost.min())
        return int(equal[np.argmax(distances[equal])])


def _judged(rig: Rig, trials: LoopTrials, samples: Samples, numbers: Mapping[str, Array]) -> _Judged:
    sums, _, _ = rig.violations(trials, samples, numbers)
    late = sums[..., 0, 2].mean(axis=(1, 2)) / trials.until_s
    own = violated(trials, sums)[..., : samples.nominal]  # a current that is not learnt yet is no overshoot
    return _Judged(own.mean(axis=(1, 2)), np.where(np.isfinite(late), late, np.inf))
