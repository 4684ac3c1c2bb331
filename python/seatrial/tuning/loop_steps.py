"""The steps of a loop: at which speeds, how large, within which corridor, of the file or by default.

A speed that the file asks for is one that the vehicle reaches, at which a mode moves the loop's set point,
and at which a vehicle that cannot hover does not sink. What the file leaves open follows from the vehicle's
limits and from what the loop does with its start gains, which are flown for it: once with the usual step,
from which the noise at rest tells how large the step has to be.

Held by tests/test_tuning_plan.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.errors import CampaignError
from seatrial.tuning.default_corridor import default_corridor, steps_above_noise
from seatrial.tuning.loop_trials import DEPTH_M, RIDES_ON, LoopTrials
from seatrial.tuning.start_figures import StartFigures, start_figures
from seatrial.tuning.trial_speeds import apart, tried_speeds
from seatrial.tuning.tuning_file import LOOPS, default_steps

if TYPE_CHECKING:
    from seatrial.tuning.corridor import Corridor
    from seatrial.tuning.tuning_plan import TuningPlan

__all__ = ["steps_of", "usual_speeds"]

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
