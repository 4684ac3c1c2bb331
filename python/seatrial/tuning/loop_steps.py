"""The steps of a loop, at which speeds, how large, within which corridor; and those of a path over a loop.

A speed that the file asks for is one that the vehicle reaches, at which a mode moves the loop's set point,
and at which a vehicle that cannot hover does not sink. What the file leaves open follows from the vehicle's
limits and from what the loop does with its start gains, which are flown for it. Held by
tests/tuning/test_tuning_plan.py, test_trial_speeds.py and test_path_following.py beside them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError
from seatrial.control_design.corridor import Corridor
from seatrial.control_design.operating_points import SETTINGS as MODE_TABLE_SETTINGS
from seatrial.control_design.operating_points import autopilot_facts, measurement_delays
from seatrial.control_design.start_autopilot import INTEGRAL_SHARES, lookahead_of
from seatrial.control_design.start_autopilot import SETTINGS as START_GUIDANCE_SETTINGS
from seatrial.control_design.tuning_table import LOOPS, default_steps
from seatrial.tuning.criterion import StartMetrics, default_corridor, start_metrics, steps_above_noise
from seatrial.tuning.objective import SETTINGS as OBJECTIVE_SETTINGS
from seatrial.tuning.objective import violated
from seatrial.tuning.step_trial import RIDES_ON, LoopTrials, Rig, Samples
from seatrial.tuning.step_trial import SETTINGS as STEP_TRIAL_SETTINGS

if TYPE_CHECKING:
    from seatrial._core import Autopilot
    from seatrial.control_design.tuning_table import LoopTable
    from seatrial.tuning.scope import TuningScope


@dataclass(frozen=True)
class LoopStepSettings:
    """At which speeds loops and paths are tried, and for how long."""

    most_speeds: int = 3  #: Most speeds per loop.
    #: Least distance of two speeds, as a share of the mean spacing of the breakpoints: nearer ones tell the
    #: same.
    spacing_share: float = 0.5
    #: How far a trial keeps from a switching speed, m/s, beside the current.
    switching_distance_m_s: float = 0.1
    #: Least time at the set point before a step, s: a loop that settles in its corridor has settled at its
    #: start as well.
    least_settle_s: float = 15.0
    #: The same over the end of a default corridor: the trim at the start takes longer than the step.
    settle_ratio: float = 1.6
    least_periods: int = 10  #: Control periods of the shortest corridor that tells of a motion.
    path_overshoot: float = 0.3  #: Overshoot across a path that is accepted, as a share of the step.
    path_delays: float = 24.0  #: Delays of the course within which a path settles: 6 times 2 Delta/U.
    shortest_path_s: float = 30.0  #: Shortest time for a step of a path, s.
    longest_path_s: float = 150.0  #: Longest time for a step of a path, s.
    #: Time before the step of a path, s: it comes before a drift is learnt, because how soon it is counts as
    #: well.
    path_settle_s: float = 1.0
    large_step_ratio: float = 3.0  #: The large step of a path over the usual one, at least.
    #: Least number of drawn vehicles and currents: still water tells nothing of an integral.
    least_samples: int = 2


SETTINGS = LoopStepSettings()


def tried_speeds(
    wanted_m_s: Sequence[float],
    modes_m_s: Sequence[tuple[float, float]],
    *,
    away_m_s: float,
    within_m_s: tuple[float, float],
    apart_m_s: float,
) -> tuple[float, ...]:
    """Speeds of a loop's trials, m/s, rising: of the breakpoints that count at most three, that nearest to
    rest, the fastest and one between.

    All that the vehicle reaches would cost twice as much and tell little more. A trial keeps away from a
    switching speed, so that a current does not change the mode under way; where the mode at a breakpoint does
    not use the loop, it is tried at the nearest speed where one does. `modes_m_s`: speeds from and to which a
    mode uses the loop.

    Examples
    --------
    >>> every = (-float("inf"), float("inf"))
    >>> points = [-2.0, -1.0, 0.0, 1.0, 2.0, 3.0]
    >>> tried_speeds(points, [every], away_m_s=0.1, within_m_s=every, apart_m_s=0.5)
    (0.0, 2.0, 3.0)
    >>> tried_speeds(points, [(1.2, every[1])], away_m_s=0.1, within_m_s=every, apart_m_s=0.5)
    (1.3, 2.0, 3.0)
    """
    tried: list[float] = []
    for wanted in wanted_m_s:
        near = [float(np.clip(wanted, *_inside(mode, away_m_s))) for mode in modes_m_s]
        at = near[int(np.argmin(np.abs(np.array(near) - wanted)))]
        at = round(float(np.clip(at, *within_m_s)), 6)
        used = any(begin <= at < end for begin, end in modes_m_s)
        if used and not any(abs(at - other) < apart_m_s for other in tried):
            tried.append(at)
    return tuple(thinned(sorted(tried)))


def _inside(mode_m_s: tuple[float, float], away_m_s: float) -> tuple[float, float]:
    """Speeds of a mode away from its ends; the middle of one that is narrower."""
    begin, end = mode_m_s[0] + away_m_s, mode_m_s[1] - away_m_s
    return (begin, end) if begin <= end else (0.5 * (begin + end),) * 2


def apart(points_m_s: Sequence[float]) -> float:
    """How near two speeds may be for both to be tried, m/s, from the breakpoints."""
    return SETTINGS.spacing_share * float(np.mean(np.diff(points_m_s)))


def thinned(speeds_m_s: Sequence[float]) -> list[float]:
    """Of some speeds at most three: that nearest to rest, the fastest, the one nearest to their middle."""
    if len(speeds_m_s) <= SETTINGS.most_speeds:
        return list(speeds_m_s)
    slow = min(speeds_m_s, key=lambda speed: (round(abs(speed), 6), -speed))
    fast = max(speeds_m_s)
    if fast == slow:  # all others are astern
        return sorted([fast, min((speed for speed in speeds_m_s if speed != fast), key=abs)])
    middle = 0.5 * (slow + fast)
    between = [speed for speed in speeds_m_s if slow < speed < fast]
    chosen = [min(between, key=lambda speed: (round(abs(speed - middle), 6), -speed))] if between else []
    return [slow, *chosen, fast]


def usual_speeds(scope: TuningScope, loop: str) -> tuple[float, ...]:
    """Speeds at which a loop is tried where the file gives none, m/s."""
    points = [scope.autopilot.speeds_m_s[place] for place in scope.places]
    if scope.slowest_m_s is not None:
        # Fins feel the water: with the current from astern less of it passes them.
        least = scope.slowest_m_s + scope.current_m_s
        points = [point for point in points if point >= least] or [min(least, scope.top_m_s)]
    return tried_speeds(
        [point for point in points if point > 0.0 or loop not in RIDES_ON],  # guidance goes ahead
        scope.modes_of(loop),
        away_m_s=scope.current_m_s + SETTINGS.switching_distance_m_s,
        # A speed through the water has to be within reach against the current, too.
        within_m_s=_in_reach(scope) if loop == "surge" else (-np.inf, scope.top_m_s),
        apart_m_s=apart(scope.autopilot.speeds_m_s),
    )


def steps_of(scope: TuningScope, loop: str, table: LoopTable) -> LoopTrials:
    """Steps of a loop at its speeds, by what the file says of the loop; a CampaignError for what the vehicle
    or its modes cannot do.
    """
    speeds = table.speeds_m_s or usual_speeds(scope, loop)
    _refuse_speeds(scope, loop, speeds)
    top_m_s, largest = scope.top_m_s, scope.largest_step(loop)
    if table.corridor is not None:
        steps = table.steps or default_steps(loop, top_m_s=top_m_s, largest=largest)
        return _stepped(scope, loop, table, speeds, steps, table.corridor.corridor(table.weights))
    usual = table.steps or default_steps(loop, top_m_s=top_m_s, largest=largest)

    def corridor(steps: Sequence[float], start: StartMetrics | None = None) -> Corridor:
        return default_corridor(
            scope.vehicle,
            scope.autopilot,
            loop,
            steps,
            weights=table.weights,
            speeds_m_s=speeds,
            voltage_v=scope.supply_v,
            start=start,
        )

    # Twice: what the start gains do with the usual steps says how much noise and how slow a rise to allow.
    first = _stepped(scope, loop, table, speeds, usual, corridor(usual))
    start = start_metrics(scope.rig(scope.autopilot, max_step_s=0.04), first)  # integrated in long steps
    steps = table.steps or steps_above_noise(loop, start.noise, top_m_s=top_m_s, largest=largest)
    return _stepped(scope, loop, table, speeds, steps, corridor(steps, start))


_LIMIT = {"pitch": ", guidance.pitch_max_deg of the autopilot"}


def _stepped(
    scope: TuningScope,
    loop: str,
    table: LoopTable,
    speeds: Sequence[float],
    steps: Sequence[float],
    corridor: Corridor,
) -> LoopTrials:
    """Every step that lies within reach, at every speed."""
    each = []
    for speed in speeds:
        possible = [(float(speed), float(step)) for step in steps if _within(scope, loop, speed, step)]
        # The step back is the other direction: one sign will do where the file does not ask for both.
        each += possible if table.steps else possible[:1]
    if not each:
        most = scope.largest_step(loop)
        why = f" (at most {most:.3g} {LOOPS[loop].unit}{_LIMIT.get(loop, '')})" if np.isfinite(most) else ""
        raise CampaignError(
            f"[tuning.loops.{loop}]: expected a step that the vehicle reaches{why}, found none at"
            f" {', '.join(f'{u:g}' for u in speeds)} m/s; take smaller steps, or give speeds_m_s"
        )
    _refuse_what_tells_nothing(scope, loop, each, corridor)
    settle = corridor.until_s * (SETTINGS.settle_ratio if table.corridor is None else 1.0)
    return LoopTrials(
        loop=loop,
        corridor=corridor,
        beside=table.beside.half_widths(),
        speeds=tuple(speed for speed, _ in each),
        sizes=tuple(step * LOOPS[loop].to_si for _, step in each),
        settle_s=scope.table.settle_s or max(SETTINGS.least_settle_s, float(f"{settle:.6g}")),
    )


def _refuse_what_tells_nothing(
    scope: TuningScope, loop: str, each: Sequence[tuple[float, float]], corridor: Corridor
) -> None:
    """Refuse a corridor that ends before the vehicle has moved, and a trial that would leave the water."""
    periods, depth = SETTINGS.least_periods, STEP_TRIAL_SETTINGS.depth_m
    least = periods * scope.autopilot.period_s
    if corridor.until_s < least:
        raise CampaignError(
            f"[tuning.loops.{loop}]: expected a corridor of at least {periods} control periods,"
            f" {least:g} s, found one that ends at {corridor.until_s:g} s, before the vehicle has moved; let"
            " it end later (until_s)"
        )
    for speed, step in each:
        climb = {
            "pitch": abs(speed) * corridor.until_s * abs(np.sin(step * LOOPS[loop].to_si)),
            "heave": abs(step),
            "depth": abs(step),
        }.get(loop, 0.0)
        if climb > depth - 10.0:  # 10 m below the surface
            raise CampaignError(
                f"[tuning.loops.{loop}]: expected trials that stay under water, {depth:g} m deep at their"
                f" start; a step of {step:g} {LOOPS[loop].unit} at {speed:g} m/s climbs {climb:.0f} m; take"
                " smaller steps, or let the corridor end sooner"
            )


def _in_reach(scope: TuningScope) -> tuple[float, float]:
    """Least and largest speed over ground, m/s, that the vehicle holds against the current."""
    astern, ahead = scope.top_speeds
    return (
        MODE_TABLE_SETTINGS.speed_range_share * astern + scope.current_m_s,
        MODE_TABLE_SETTINGS.speed_range_share * ahead - scope.current_m_s,
    )


def _within(scope: TuningScope, loop: str, speed: float, step: float) -> bool:
    """Whether the end of a step lies within what guidance asks for, of a speed within reach."""
    if loop != "surge":
        return abs(step) <= scope.largest_step(loop)
    least, most = _in_reach(scope)
    return least <= speed + step <= most


def _refuse_speeds(scope: TuningScope, loop: str, speeds: Sequence[float]) -> None:
    """Refuse a speed that nothing brings about, at which the loop has no set point, or the hull sinks."""
    where, mend = f"[tuning.loops.{loop}]: speeds_m_s", "correct or remove it"
    astern, ahead = scope.top_speeds
    if not speeds:
        raise CampaignError(
            f"[tuning.loops.{loop}]: expected breakpoints (schedule.speeds_m_s of"
            f" {scope.autopilot.name}) at which it can be tried, found none between {astern:.2f} and"
            f" {ahead:.2f} m/s, the top speeds of {scope.vehicle.name}; correct them, or give speeds_m_s"
        )
    for speed in speeds:
        if not astern <= speed <= ahead:
            raise CampaignError(
                f"{where}: expected speeds that {scope.vehicle.name} reaches, {astern:.2f} to {ahead:.2f}"
                f" m/s, found {speed:g}; {mend}"
            )
        modes = scope.modes_of(loop)
        if not any(begin <= speed < end for begin, end in modes):
            raise CampaignError(
                f"{where}: expected speeds at which a mode of {scope.autopilot.name} moves the set point of"
                f" {RIDES_ON.get(loop, loop)}, {' or '.join(_range(*each) for each in modes)}, found"
                f" {speed:g}; {mend}"
            )
        if loop in RIDES_ON and speed <= 0.0:
            raise CampaignError(
                f"{where}: expected speeds above 0, as guidance follows a path ahead, found {speed:g}; {mend}"
            )
        if scope.slowest_m_s is not None and speed < scope.slowest_m_s:
            raise CampaignError(
                f"{where}: expected at least {scope.slowest_m_s:.2f} m/s, the slowest at which"
                f" {scope.vehicle.name} holds its depth (no mode of {scope.autopilot.name} uses heave), found"
                f" {speed:g}; {mend}"
            )


def _range(begin: float, end: float) -> str:
    """Speeds of a mode in words."""
    words = [f"from {begin:g}"] if np.isfinite(begin) else []
    words += [f"below {end:g}"] if np.isfinite(end) else []
    return " ".join([*words, "m/s"]) if words else "any"


GUIDANCE = {
    "depth": ("guidance.lookahead_vertical_m", "guidance.integral_gain_vertical_m_s"),
    "cross_track": ("guidance.lookahead_m", "guidance.integral_gain_m_s"),
}
"""Lookahead and integral gain of each path, by the names of `Autopilot.gains`."""

_FACTORS = np.geomspace(0.4, 4.0, 11)  # of the usual lookahead: steps of a quarter

_CANDIDATES = len(_FACTORS) + 1  # that of the file included


def course_lookahead(scope: TuningScope, autopilot: Autopilot, path: str) -> tuple[float, float, float]:
    """Lookahead in m that goes with an autopilot's gains, the speed in m/s and the delay in s it is for."""
    given = float(autopilot_facts(autopilot).guidance["lookahead_speed_m_s"])
    speeds = usual_speeds(scope, path)
    speed = float(
        np.clip(given or START_GUIDANCE_SETTINGS.cruise_share * scope.top_m_s, min(speeds), max(speeds))
    )
    late = measurement_delays(scope.sensors, scope.vehicle)
    distance, tau = lookahead_of(scope.vehicle, autopilot, RIDES_ON[path], speed, late_s=late)
    return (
        max(
            distance, START_GUIDANCE_SETTINGS.lookahead_lengths * scope.vehicle.geometry().get("length", 0.0)
        ),
        speed,
        tau,
    )


def path_trials(scope: TuningScope, path: str, distance_m: float, delay_s: float) -> LoopTrials:
    """Small and large steps of "cross_track" or "depth" at its speeds, against a bound of the overshoot, for
    a lookahead in m and a delay of the course in s.
    """
    small = default_steps(path, top_m_s=scope.top_m_s)[0] * LOOPS[path].to_si
    large = min(
        max(SETTINGS.large_step_ratio * small, distance_m), 30.0
    )  # m: a larger step across the path is another mission
    speeds = usual_speeds(scope, path)
    # Time for two and a half ways of the large step at the slowest speed.
    until_s = max(SETTINGS.path_delays * delay_s, 2.5 * large / min(speeds))
    until_s = float(f"{np.clip(until_s, SETTINGS.shortest_path_s, SETTINGS.longest_path_s):.3g}")
    return LoopTrials(
        loop=path,
        corridor=Corridor(
            (), ((0.0, 1.0 + SETTINGS.path_overshoot), (until_s, 1.0 + SETTINGS.path_overshoot))
        ),
        beside={},
        speeds=tuple(np.repeat(speeds, 2).tolist()),
        sizes=(small, large) * len(speeds),
        settle_s=SETTINGS.path_settle_s,
    )


@dataclass(frozen=True)
class PathNumbers:
    """What was chosen for some paths."""

    gains: Mapping[str, float]  #: By the names of `Autopilot.gains`.
    #: `before`, `after`: violation and time-weighted error, s, with what the file had and with what was
    #: chosen.
    before: Mapping[str, float]
    after: Mapping[str, float]
    #: `evaluations`, `flown_s`: sets of numbers that were tried, and the time that they flew, s.
    evaluations: int
    flown_s: float


def path_work_s(scope: TuningScope, paths: Sequence[str]) -> float:
    """Time that `search_paths` flies at most, s."""
    flights = _CANDIDATES * (1 + max(scope.table.samples, SETTINGS.least_samples)) * 2
    return sum(flights * len(usual_speeds(scope, path)) * 3.0 * SETTINGS.longest_path_s for path in paths)


def search_paths(scope: TuningScope, rig: Rig, paths: Sequence[str], *, seed: int) -> PathNumbers:
    """Numbers of guidance for the paths, "cross_track" and "depth", of a rig with the tuned gains.

    A lookahead is made for the delay of the course (`seatrial.control_design.start_autopilot`): that of the
    start gains does not suit loops that a tuning has made faster or calmer.

    1. Delta_0 = 2 U tau with the delay tau of the course that the tuned loop has, sensors included.
    2. Candidates: 0.4 to 4 Delta_0, each with the integral gain that goes with the speed (a quarter of it, a
       tenth in the vertical plane), and what the file has.
    3. Each flies steps of the path, sideways or down, small and as large as Delta_0, there and back, at the
       speeds of the path's trials; in still water and in a current from all sides, with drawn vehicles and
       the sensors of the tuning. The first step comes at once, so that the approach has to learn the current.
    4. The least 10 Q + T counts, as in the search of the gains: Q is the time beyond an overshoot of 30 % of
       the step in still water, T the time-weighted error, means over all flights, in s; of equals (5 %) the
       longest lookahead.

    An overshoot is part of an integral line of sight: with kappa = U/4 and no delay it is e^-2 = 13.5 % of
    the step (y = (1 - a t) e^(-a t), a = U/2 Delta). Within 30 % every swing is less than a third of the one
    before. Sources: Børhaug, Pavlov and Pettersen (2008), equations 8 and 9; Fossen (2011), section 10.3.
    """
    samples = scope.samples(max(scope.table.samples, SETTINGS.least_samples), seed)
    gains = dict[str, float]()
    before, after = dict.fromkeys(("violation", "time"), 0.0), dict.fromkeys(("violation", "time"), 0.0)
    tried, flown_s = 0, 0.0
    for path in paths:
        distance, speed, tau = course_lookahead(scope, rig.autopilot, path)
        trials = path_trials(scope, path, distance, tau)
        numbers = _candidates(rig.autopilot, path, distance, INTEGRAL_SHARES[path] * speed)
        outside, late = _judged(rig, trials, samples, numbers)
        # What differs by less than 5 % of the least cost is as good: then the longest lookahead counts.
        cost = OBJECTIVE_SETTINGS.outside_weight * outside + late
        equal = np.flatnonzero(cost <= 1.05 * cost.min())
        chosen = int(equal[np.argmax(numbers[GUIDANCE[path][0]][equal])])
        gains |= {name: float(values[chosen]) for name, values in numbers.items()}
        for ends, place in ((before, -1), (after, chosen)):
            ends["violation"] += float(outside[place])
            ends["time"] += float(late[place])
        tried += len(late)
        flown_s += len(late) * len(samples) * len(trials) * trials.duration_s
    return PathNumbers(gains, before, after, tried, flown_s)


def _candidates(autopilot: Autopilot, path: str, distance: float, integral: float) -> dict[str, Array]:
    """Lookaheads and integral gains (k,) by name, those of the file last."""
    own = autopilot.gains()
    grid = _FACTORS * distance, np.full(len(_FACTORS), integral)
    return {name: np.append(values, own[name]) for name, values in zip(GUIDANCE[path], grid, strict=True)}


def _judged(
    rig: Rig, trials: LoopTrials, samples: Samples, numbers: Mapping[str, Array]
) -> tuple[Array, Array]:
    """Of candidates (k,) the mean time beyond the bound of the overshoot, and mean time-weighted error, s."""
    sums, _, _ = rig.violations(trials, samples, numbers)
    late = sums[..., 0, 2].mean(axis=(1, 2)) / trials.until_s
    own = violated(trials, sums)[..., : samples.nominal]  # a current that is not learnt yet is no overshoot
    return own.mean(axis=(1, 2)), np.where(np.isfinite(late), late, np.inf)
