"""The speed over a staircase of set points with the start gains and with the tuned ones.

After the figure "Speed control optimization with constraint criteria" of Taubert et al. (2014): one time
course in which the set point u_d changes several times, through all modes of the autopilot. Held by
tests/test_tuning_gallery.py.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.plot.step_responses import Course, step_responses

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from seatrial._core import Autopilot
    from seatrial.tuning.tuning_plan import TuningPlan

__all__ = ["course_of_set_points", "speed_steps"]

Array = NDArray[np.float64]

_SHARES = (0.0, 0.3, 0.6, 0.9, 0.75, 0.45, 0.15)  # of the top speed, ahead
_ASTERN = 0.5  # of the slowest supporting point that is reached
_DEPTH_M = 20.0
_HOLD_S = (15.0, 40.0)  # of a set point: at least, and at most
_MAX_STEP_S = 0.02


def course_of_set_points(plan: TuningPlan) -> tuple[Array, Array]:
    """Times (n,), s, from which set points of the speed (n,), m/s, hold, and the time of the end as last.

    Parameters
    ----------
    plan : TuningPlan
    """
    slowest = min(plan.autopilot.speeds_m_s[place] for place in plan.places)
    ahead = [share * plan.top_m_s for share in _SHARES]
    if slowest < 0.0:
        levels = [*ahead, 0.0, _ASTERN * slowest, slowest, 0.0]
    else:  # a hull steered by fins: from its slowest supporting point on
        levels = [max(level, slowest) for level in ahead]
    hold = float(np.clip(plan.trials("surge").until_s, *_HOLD_S))
    times: Array = hold * np.arange(len(levels) + 1.0)
    return times, np.array(levels)


def speed_steps(plan: TuningPlan, start: Autopilot, tuned: Autopilot) -> Figure:
    """Figure of the speed ahead over set points that change, before and after a tuning, heading held.

    Parameters
    ----------
    plan : TuningPlan
        Its vehicle, as identified, in still water, with its sensors.
    start, tuned : Autopilot
    """
    times, levels = course_of_set_points(plan)
    found = [_flown(plan, autopilot, times, levels) for autopilot in (start, tuned)]
    t: Array = plan.autopilot.period_s * np.arange(float(max(len(one) for one in found)))
    before, after = (np.pad(one, (0, len(t) - len(one)), constant_values=np.nan) for one in found)
    set_point = levels[np.clip(np.searchsorted(times, t + 1e-9, side="right") - 1, 0, len(levels) - 1)]
    course = Course(
        name=f"{plan.vehicle.name}: speed over its set points",
        label="speed ahead u, m/s",
        t=t,
        set_point=set_point,
        before=before,
        after=after,
        remark=f"heading held, still water, sensors: {Path(plan.table.sensors).name}",
    )
    return step_responses([course])


def _flown(plan: TuningPlan, autopilot: Autopilot, times: Array, levels: Array) -> Array:
    """Speed ahead (n,), m/s, per control period."""
    from seatrial.flight import fly_batch
    from seatrial.mission import Mission

    mission = Mission.from_toml(
        f"""
        format = 1
        name = "set points"
        speed_m_s = 1.0
        acceptance_radius_m = 10.0
        start = {{ north_m = 0.0, east_m = 0.0, depth_m = {_DEPTH_M}, heading_deg = 0.0 }}
        legs = [{{ north_m = 1e6, east_m = 0.0, depth_m = {_DEPTH_M} }}]
        """
    )
    sensors = plan.table.sensors
    flights = fly_batch(
        plan.vehicle,
        autopilot,
        mission,
        sensors=None if sensors == "perfect" else sensors,
        set_points={"times": times[:-1], "speed": levels, "heading": np.zeros(len(levels))},
        voltage=plan.table.voltage_v,
        max_step=_MAX_STEP_S,
        max_time=float(times[-1]),
        logs=True,
    )
    log = np.asarray(flights.log(0))
    return np.asarray(log[:, flights.columns.index("u")])
