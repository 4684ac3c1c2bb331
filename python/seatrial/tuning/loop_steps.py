"""The steps of a loop: at which speeds, how large, within which corridor, of the file or by default.

A speed that the file asks for is one that the vehicle reaches, at which a mode moves the loop's set point,
and at which a vehicle that cannot hover does not sink. What the file leaves open follows from the vehicle's
limits and from what the loop does with its start gains, which are flown for it: once with the usual step,
from which the noise at rest tells how large the step has to be.

Held by tests/tuning/test_tuning_plan.py.

Speeds at which a loop is tried where the file gives none, and the least at which a vehicle flies level.

At most three: that nearest to rest, the fastest and one between. Six that the vehicle reaches cost twice as
much and tell little more, and no mission goes astern faster than a brake does; where there are no more than
three, all are tried. A trial keeps away from a switching speed, so that a current does not change the mode
under way, and one of the speed stays within reach against the current. A vehicle that cannot hover falls
below its path when it is slower than level flight needs, whatever its gains.

Held by tests/tuning/test_trial_speeds.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.errors import CampaignError
from seatrial.campaign.tuning_table import LOOPS, default_steps
from seatrial.tuning.corridors import StartFigures, default_corridor, start_figures, steps_above_noise
from seatrial.tuning.step_trial import DEPTH_M, RIDES_ON, LoopTrials

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.campaign.corridor import Corridor
    from seatrial.tuning.plan import TuningPlan

__all__ = ["apart", "slowest_level_m_s", "steps_of", "thinned", "tried_speeds", "usual_speeds"]

MOST = 3
"""Speeds per loop, at most."""

_APART = 0.5  # of the mean spacing of the supporting points: speeds that are nearer tell the same

_ROUNDING = 0.005  # supporting points have four digits


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
        Supporting points that count for the loop.
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
    found: list[float] = []
    for wanted in wanted_m_s:
        near = [float(np.clip(wanted, *_inside(mode, away_m_s))) for mode in modes_m_s]
        at = near[int(np.argmin(np.abs(np.array(near) - wanted)))]
        at = round(float(np.clip(at, *within_m_s)), 6)
        used = any(begin <= at < end for begin, end in modes_m_s)
        if used and not any(abs(at - other) < apart_m_s for other in found):
            found.append(at)
    return tuple(thinned(sorted(found)))


def _inside(mode_m_s: tuple[float, float], away_m_s: float) -> tuple[float, float]:
    """Speeds of a mode away from its ends; the middle of one that is narrower."""
    begin, end = mode_m_s[0] + away_m_s, mode_m_s[1] - away_m_s
    return (begin, end) if begin <= end else (0.5 * (begin + end),) * 2


def apart(points_m_s: Sequence[float]) -> float:
    """How near two speeds may be for both to be tried, m/s, from the supporting points."""
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


def slowest_level_m_s(vehicle: Vehicle, autopilot: Autopilot) -> float | None:
    """Least speed ahead at which the vehicle holds its depth, m/s; None where a mode of it hovers.

    Examples
    --------
    >>> import seatrial as st
    >>> round(slowest_level_m_s(st.Vehicle.load("remus100"), st.Autopilot.load("remus100")), 2)
    1.54
    >>> slowest_level_m_s(st.Vehicle.load("cwolf"), st.Autopilot.load("cwolf")) is None
    True
    """
    from seatrial.control_design.mode_table import breakpoint_speeds, top_speeds
    from seatrial.vehicle.authority import ROWS

    modes = autopilot.modes
    if any(mode["depth_by"] != "pitch" for mode in modes):
        return None
    used = np.max([mode["loops"] for mode in modes], axis=0) > 0.5
    rows = "".join(row for row, at_work in zip(ROWS, used, strict=True) if at_work)
    slowest = breakpoint_speeds(vehicle, rows, top_speeds(vehicle))[0]
    return slowest * (1.0 - _ROUNDING)


_BESIDE_MODE_M_S = 0.1  # how far a trial keeps from a switching speed, beside the current

_SETTLE_S = 15.0  # at least; a loop that settles in its corridor has settled at its start as well

_SETTLE = 1.6  # over the end of a default corridor: the trim at the start takes longer than the step

_PERIODS = 10  # of control: the shortest corridor that tells of a motion

_BELOW_M = 10.0  # of the surface

_START_STEP_S = 0.04  # of the integration, where the start gains are tried


def usual_speeds(plan: TuningPlan, loop: str) -> tuple[float, ...]:
    """Speeds at which a loop is tried where the file gives none, m/s.

    Parameters
    ----------
    plan : TuningPlan
    loop : str
    """
    points = [plan.autopilot.speeds_m_s[place] for place in plan.places]
    if plan.slowest_m_s is not None:
        # Fins feel the water: with the current from astern less of it passes them.
        least = plan.slowest_m_s + plan.current_m_s
        points = [point for point in points if point >= least] or [min(least, plan.top_m_s)]
    return tried_speeds(
        [point for point in points if point > 0.0 or loop not in RIDES_ON],  # guidance goes ahead
        plan.modes_of(loop),
        away_m_s=plan.current_m_s + _BESIDE_MODE_M_S,
        # A speed through the water has to be within reach against the current, too.
        within_m_s=_in_reach(plan) if loop == "surge" else (-np.inf, plan.top_m_s),
        apart_m_s=apart(plan.autopilot.speeds_m_s),
    )


def steps_of(plan: TuningPlan, loop: str) -> LoopTrials:
    """Steps of a loop at its speeds.

    Parameters
    ----------
    plan : TuningPlan
    loop : str

    Raises
    ------
    CampaignError
        Speeds or steps that the vehicle or its modes cannot do.
    """
    table = plan.loops[loop]
    speeds = table.speeds_m_s or usual_speeds(plan, loop)
    _refuse_speeds(plan, loop, speeds)
    if table.corridor is not None:
        steps = table.steps or steps_above_noise(loop, 0.0, top_m_s=plan.top_m_s)
        return _stepped(plan, loop, speeds, steps, table.corridor.corridor(table.weights))
    usual = table.steps or default_steps(loop, top_m_s=plan.top_m_s)
    first = _stepped(plan, loop, speeds, usual, _default(plan, loop, speeds, usual))
    start = start_figures(plan.rig(plan.autopilot, max_step=_START_STEP_S), first)
    steps = table.steps or steps_above_noise(loop, start.noise, top_m_s=plan.top_m_s)
    return _stepped(plan, loop, speeds, steps, _default(plan, loop, speeds, steps, start))


def _default(
    plan: TuningPlan,
    loop: str,
    speeds: Sequence[float],
    steps: Sequence[float],
    start: StartFigures | None = None,
) -> Corridor:
    return default_corridor(
        plan.vehicle,
        plan.autopilot,
        loop,
        steps,
        weights=plan.loops[loop].weights,
        speeds_m_s=speeds,
        voltage_v=plan.supply_v,
        start=start,
    )


def _stepped(
    plan: TuningPlan, loop: str, speeds: Sequence[float], steps: Sequence[float], corridor: Corridor
) -> LoopTrials:
    """Every step that lies within reach, at every speed."""
    table = plan.loops[loop]
    each = []
    for speed in speeds:
        possible = [(float(speed), float(step)) for step in steps if _within(plan, loop, speed, step)]
        # The step back is the other direction: one sign will do where the file does not ask for both.
        each += possible if table.steps else possible[:1]
    if not each:
        raise CampaignError(
            f"[tuning.loops.{loop}]: expected a step that the vehicle reaches, found none at"
            f" {', '.join(f'{u:g}' for u in speeds)} m/s; take smaller steps, or give speeds_m_s"
        )
    _refuse_what_tells_nothing(plan, loop, each, corridor)
    settle = corridor.until_s * (_SETTLE if table.corridor is None else 1.0)
    return LoopTrials(
        loop=loop,
        corridor=corridor,
        beside=table.beside.half_widths(),
        speeds=tuple(speed for speed, _ in each),
        sizes=tuple(step * LOOPS[loop].to_si for _, step in each),
        settle_s=plan.table.settle_s or max(_SETTLE_S, float(f"{settle:.6g}")),
    )


def _refuse_what_tells_nothing(
    plan: TuningPlan, loop: str, each: Sequence[tuple[float, float]], corridor: Corridor
) -> None:
    """Refuse a corridor that ends before the vehicle has moved, and a trial that would leave the water."""
    least = _PERIODS * plan.autopilot.period_s
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
        if climb > DEPTH_M - _BELOW_M:
            raise CampaignError(
                f"[tuning.loops.{loop}]: expected trials that stay under water, {DEPTH_M:g} m deep at their"
                f" start; a step of {step:g} {LOOPS[loop].unit} at {speed:g} m/s climbs {climb:.0f} m; take"
                " smaller steps, or let the corridor end sooner"
            )


def _in_reach(plan: TuningPlan) -> tuple[float, float]:
    """Least and largest speed over ground, m/s, that the vehicle holds against the current."""
    from seatrial.control_design.mode_table import RANGE

    astern, ahead = plan.top_speeds
    return RANGE * astern + plan.current_m_s, RANGE * ahead - plan.current_m_s


def _within(plan: TuningPlan, loop: str, speed: float, step: float) -> bool:
    """Whether the end of a step of the speed lies within reach."""
    if loop != "surge":
        return True
    least, most = _in_reach(plan)
    return least <= speed + step <= most


def _refuse_speeds(plan: TuningPlan, loop: str, speeds: Sequence[float]) -> None:
    """Refuse a speed that nothing brings about, at which the loop has no set point, or the hull sinks."""
    where, mend = f"[tuning.loops.{loop}]: speeds_m_s", "correct or remove it"
    astern, ahead = plan.top_speeds
    if not speeds:
        raise CampaignError(
            f"[tuning.loops.{loop}]: expected supporting points (schedule.speeds_m_s of"
            f" {plan.autopilot.name}) at which it can be tried, found none between {astern:.2f} and"
            f" {ahead:.2f} m/s, the top speeds of {plan.vehicle.name}; correct them, or give speeds_m_s"
        )
    for speed in speeds:
        if not astern <= speed <= ahead:
            raise CampaignError(
                f"{where}: expected speeds that {plan.vehicle.name} reaches, {astern:.2f} to {ahead:.2f} m/s,"
                f" found {speed:g}; {mend}"
            )
        modes = plan.modes_of(loop)
        if not any(begin <= speed < end for begin, end in modes):
            raise CampaignError(
                f"{where}: expected speeds at which a mode of {plan.autopilot.name} moves the set point of"
                f" {RIDES_ON.get(loop, loop)}, {' or '.join(_range(*each) for each in modes)}, found"
                f" {speed:g}; {mend}"
            )
        if loop in RIDES_ON and speed <= 0.0:
            raise CampaignError(
                f"{where}: expected speeds above 0, as guidance follows a path ahead, found {speed:g}; {mend}"
            )
        if plan.slowest_m_s is not None and speed < plan.slowest_m_s:
            raise CampaignError(
                f"{where}: expected at least {plan.slowest_m_s:.2f} m/s, the slowest at which"
                f" {plan.vehicle.name} holds its depth (no mode of {plan.autopilot.name} uses heave), found"
                f" {speed:g}; {mend}"
            )


def _range(begin: float, end: float) -> str:
    """Speeds of a mode in words."""
    words = [f"from {begin:g}"] if np.isfinite(begin) else []
    words += [f"below {end:g}"] if np.isfinite(end) else []
    return " ".join([*words, "m/s"]) if words else "any"
