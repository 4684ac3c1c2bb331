"""The steps of a loop: at which speeds, how large, within which corridor, of the file or by default.

A speed that the file asks for is one that the vehicle reaches, at which a mode moves the loop's set point,
and at which a vehicle that cannot hover does not sink. What the file leaves open follows from the vehicle's
limits and from what the loop does with its start gains, which are flown for it: once with the usual step,
from which the noise at rest tells how large the step has to be.

Where the file gives no speeds there are at most three: that nearest to rest, the fastest and one between.
All that the vehicle reaches would cost twice as much and tell little more, and no mission goes astern
faster than a brake does. A trial keeps away from a switching speed, so that a current does not change the
mode under way, and one of the speed stays within reach against the current. Where the mode that works at a
breakpoint does not use the loop, it is tried at the nearest speed where one does. A vehicle that cannot
hover falls below its path when it is slower than level flight needs, whatever its gains.

Held by tests/tuning/test_tuning_plan.py and tests/tuning/test_trial_speeds.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.errors import CampaignError
from seatrial.control_design.mode_table import RANGE
from seatrial.control_design.tuning_table import LOOPS, default_steps
from seatrial.tuning.corridors import StartMetrics, default_corridor, start_metrics, steps_above_noise
from seatrial.tuning.step_trial import DEPTH_M, RIDES_ON, LoopTrials

if TYPE_CHECKING:
    from seatrial.control_design.corridor import Corridor
    from seatrial.control_design.tuning_table import LoopTable
    from seatrial.tuning.scope import TuningScope

MOST = 3
"""Speeds per loop, at most."""

_APART = 0.5  # of the mean spacing of the breakpoints: speeds that are nearer tell the same


def tried_speeds(
    wanted_m_s: Sequence[float],
    modes_m_s: Sequence[tuple[float, float]],
    *,
    away_m_s: float,
    within_m_s: tuple[float, float],
    apart_m_s: float,
) -> tuple[float, ...]:
    """Speeds of a loop's trials, m/s, rising.

    Parameters
    ----------
    wanted_m_s : sequence of float
        Breakpoints that count for the loop.
    modes_m_s : sequence of (float, float)
        Speeds from and to which a mode uses the loop.
    away_m_s : float
        How far a trial keeps from a switching speed.
    within_m_s : (float, float)
        Least and largest speed of a trial.
    apart_m_s : float
        Of speeds that are nearer to each other the first is tried.

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
    return _APART * float(np.mean(np.diff(points_m_s)))


def thinned(speeds_m_s: Sequence[float]) -> list[float]:
    """Of some speeds at most three: that nearest to rest, the fastest, the one nearest to their middle.

    Examples
    --------
    >>> thinned([-0.8, -0.5, -0.2, 0.2, 0.5, 0.8])
    [0.2, 0.5, 0.8]
    >>> thinned([-1.0, 1.0, 3.0])
    [-1.0, 1.0, 3.0]
    >>> thinned([-0.8, -0.5, -0.2, 0.1])
    [-0.2, 0.1]
    """
    if len(speeds_m_s) <= MOST:
        return list(speeds_m_s)
    slow = min(speeds_m_s, key=lambda speed: (round(abs(speed), 6), -speed))
    fast = max(speeds_m_s)
    if fast == slow:  # all others are astern
        return sorted([fast, min((speed for speed in speeds_m_s if speed != fast), key=abs)])
    middle = 0.5 * (slow + fast)
    between = [speed for speed in speeds_m_s if slow < speed < fast]
    chosen = [min(between, key=lambda speed: (round(abs(speed - middle), 6), -speed))] if between else []
    return [slow, *chosen, fast]


_BESIDE_MODE_M_S = 0.1  # how far a trial keeps from a switching speed, beside the current

_SETTLE_S = 15.0  # at least; a loop that settles in its corridor has settled at its start as well

_SETTLE = 1.6  # over the end of a default corridor: the trim at the start takes longer than the step

_PERIODS = 10  # of control: the shortest corridor that tells of a motion


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
        away_m_s=scope.current_m_s + _BESIDE_MODE_M_S,
        # A speed through the water has to be within reach against the current, too.
        within_m_s=_in_reach(scope) if loop == "surge" else (-np.inf, scope.top_m_s),
        apart_m_s=apart(scope.autopilot.speeds_m_s),
    )


def steps_of(scope: TuningScope, loop: str, table: LoopTable) -> LoopTrials:
    """Steps of a loop at its speeds, by what the file says of the loop.

    Raises CampaignError for speeds or steps that the vehicle or its modes cannot do.
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
    settle = corridor.until_s * (_SETTLE if table.corridor is None else 1.0)
    return LoopTrials(
        loop=loop,
        corridor=corridor,
        beside=table.beside.half_widths(),
        speeds=tuple(speed for speed, _ in each),
        sizes=tuple(step * LOOPS[loop].to_si for _, step in each),
        settle_s=scope.table.settle_s or max(_SETTLE_S, float(f"{settle:.6g}")),
    )


def _refuse_what_tells_nothing(
    scope: TuningScope, loop: str, each: Sequence[tuple[float, float]], corridor: Corridor
) -> None:
    """Refuse a corridor that ends before the vehicle has moved, and a trial that would leave the water."""
    least = _PERIODS * scope.autopilot.period_s
    if corridor.until_s < least:
        raise CampaignError(
            f"[tuning.loops.{loop}]: expected a corridor of at least {_PERIODS} control periods,"
            f" {least:g} s, found one that ends at {corridor.until_s:g} s, before the vehicle has moved; let"
            " it end later (until_s)"
        )
    for speed, step in each:
        climb = {
            "pitch": abs(speed) * corridor.until_s * abs(np.sin(step * LOOPS[loop].to_si)),
            "heave": abs(step),
            "depth": abs(step),
        }.get(loop, 0.0)
        if climb > DEPTH_M - 10.0:  # 10 m below the surface
            raise CampaignError(
                f"[tuning.loops.{loop}]: expected trials that stay under water, {DEPTH_M:g} m deep at their"
                f" start; a step of {step:g} {LOOPS[loop].unit} at {speed:g} m/s climbs {climb:.0f} m; take"
                " smaller steps, or let the corridor end sooner"
            )


def _in_reach(scope: TuningScope) -> tuple[float, float]:
    """Least and largest speed over ground, m/s, that the vehicle holds against the current."""
    astern, ahead = scope.top_speeds
    return RANGE * astern + scope.current_m_s, RANGE * ahead - scope.current_m_s


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
