"""Responses of a loop to a staircase of set points before and after tuning, in one time course.

After the figure "Speed control optimization with constraint criteria" of Taubert et al. (2014), for any loop
and any number of vehicles: the first row is the nominal one, the others span a band. Held by
`tests/test_corridor_figures.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.errors import SimulationError
from seatrial.plot.flight_time import line
from seatrial.plot.style import MEASURED, SECOND, SIMULATED, THIRD, house_style, new_figure, panel_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.tuning.corridor import Corridor

__all__ = ["Course", "SetPointStep", "step_responses"]

Array = NDArray[np.float64]

_HEIGHT_IN, _LEGEND_IN = 2.2, 0.5
_IN_A_COLUMN = 3  # more courses stand in two, and all of them on a page
_PAGE_IN = 9.8
_CORRIDOR = "#DDEBDD"
_MARGIN, _MOST = 0.08, 0.5  # around what is shown, and how far a wild response may widen it
_PER_STEP = 240  # points of a bound
_ALONE_IN = 0.8  # more height for the only panel
_MOSTLY = 0.4


@dataclass(frozen=True)
class SetPointStep:
    """A step of the set point: time in s, values before and after in the unit drawn, and its corridor."""

    at_s: float
    before: float
    after: float
    corridor: Corridor


@dataclass(frozen=True, eq=False)
class Course:
    """Time course of one loop.

    Parameters
    ----------
    name : str
        Title of the panel.
    label : str
        Of the vertical axis, with the unit.
    t : array, shape (n,)
        Time, s.
    set_point : array, shape (n,)
        In the unit drawn; blank where there is none.
    before, after : array, shape (n,) or (k, n)
        Responses with the start gains and with the tuned ones; the first row is the nominal vehicle.
    steps : sequence of SetPointStep
        Steps whose corridors are shaded.
    down : bool
        Whether the axis points downwards, as of a depth.
    remark : str
        At the right of the title.
    """

    name: str
    label: str
    t: Array
    set_point: Array
    before: Array
    after: Array
    steps: Sequence[SetPointStep] = ()
    down: bool = False
    remark: str = ""


def step_responses(courses: Sequence[Course]) -> Figure:
    """Figure with a panel per loop: set points, corridors, responses before and after tuning.

    Parameters
    ----------
    courses : sequence of Course
        At least one.

    Raises
    ------
    SimulationError
        There is nothing to draw.
    """
    if not courses:
        raise SimulationError("no step responses to draw; give at least one time course")
    columns = 1 if len(courses) <= _IN_A_COLUMN else 2
    rows = -(-len(courses) // columns)
    with house_style():
        alone = _ALONE_IN if len(courses) == 1 else 0.0
        figure = new_figure(min(_HEIGHT_IN * rows + _LEGEND_IN + alone, _PAGE_IN))
        grid = figure.subplots(rows, columns, squeeze=False)
        panels = list(grid.flat)
        for axes, course in zip(panels, courses, strict=False):
            _panel(axes, course, narrow=columns > 1)
        for axes in panels[len(courses) :]:
            axes.set_axis_off()
        for axes in panels[len(courses) - columns : len(courses)]:
            axes.set_xlabel("time, s")
        for column in grid.T:
            figure.align_ylabels(list(column))
        _legend(figure, courses)
    return figure


def _panel(axes: Axes, course: Course, *, narrow: bool) -> None:
    edges = _corridors(axes, course)
    line(axes, course.t, course.set_point, color=SECOND, linewidth=1.8, drawstyle="steps-post", zorder=2.1)
    low, high = _window(course, edges)
    styles = ((course.before, MEASURED, (0, (3, 1.2)), 1.0), (course.after, SIMULATED, "-", 1.3))
    for responses, colour, dashes, width in styles:
        bundle = np.atleast_2d(np.asarray(responses, dtype=float))
        bundle = np.where(np.isfinite(bundle), bundle, np.nan)
        if len(bundle) > 1:
            ends = np.fmin.reduce(bundle, axis=0), np.fmax.reduce(bundle, axis=0)
            # A span that is mostly wider than the panel would hide all else and say no more than that.
            if (ends[1] - ends[0] > high - low).mean() < _MOSTLY:
                axes.fill_between(course.t, *ends, color=colour, alpha=0.22, linewidth=0.0, zorder=2.2)
        line(axes, course.t, bundle[0], color=colour, linewidth=width, linestyle=dashes, zorder=2.4)
    axes.set_xlim(course.t[0], course.t[-1])
    axes.set_ylim(low, high)
    if course.down:
        axes.invert_yaxis()
    axes.set_ylabel(course.label)
    remark = course.remark
    first = np.atleast_2d(course.before)[0]
    if not ((first >= low) & (first <= high)).any():
        remark = f"{remark or 'start gains'}, out of view"
    if not narrow:
        panel_title(axes, course.name, remark)
        return
    # Name and remark have no room beside each other.
    axes.set_title(course.name, loc="left", fontweight="bold", pad=14 if remark else None)
    if remark:
        axes.text(0.0, 1.03, remark, fontsize=7, color="#404040", transform=axes.transAxes)


def _corridors(axes: Axes, course: Course) -> list[float]:
    """Shade the corridors up to the next step; ends of what they span, in the unit drawn."""
    steps = sorted(course.steps, key=lambda step: step.at_s)
    ends: list[float] = []
    for k, step in enumerate(steps):
        until = steps[k + 1].at_s if k + 1 < len(steps) else float(course.t[-1])
        last = min(step.corridor.until_s, until - step.at_s)
        times = np.unique(np.concatenate([np.linspace(0.0, last, _PER_STEP), _jumps(step.corridor, last)]))
        bounds = [step.before + (step.after - step.before) * side for side in step.corridor.sampled(times)]
        both = np.isfinite(bounds).all(axis=0)
        axes.fill_between(
            step.at_s + times, bounds[0], bounds[1], where=both, color=_CORRIDOR, linewidth=0.0, zorder=0.6
        )
        for bound in bounds:
            finite = np.where(np.isfinite(bound), bound, np.nan)
            axes.plot(step.at_s + times, finite, color=THIRD, linewidth=0.5, alpha=0.7, zorder=0.7)
            ends += [float(x) for x in bound[np.isfinite(bound)]]
    return ends


def _jumps(corridor: Corridor, last: float) -> Array:
    times = np.array([time for points in (corridor.lower, corridor.upper) for time, _ in points])
    times = np.concatenate([times, times - 1e-6])
    return np.asarray(times[(times >= 0.0) & (times <= last)])


def _window(course: Course, edges: Sequence[float]) -> tuple[float, float]:
    """Vertical limits: set points and corridors, and the responses, of which a wild one is cut."""
    kept = np.concatenate([np.asarray(edges), course.set_point[np.isfinite(course.set_point)]])
    seen = np.concatenate([np.ravel(course.before), np.ravel(course.after)])
    seen = seen[np.isfinite(seen)]
    kept, seen = (kept if len(kept) else seen), (seen if len(seen) else kept)
    span = float(np.ptp(kept)) or 1.0
    low = max(min(kept.min(), seen.min()), kept.min() - _MOST * span)
    high = min(max(kept.max(), seen.max()), kept.max() + _MOST * span)
    return float(low - _MARGIN * span), float(high + _MARGIN * span)


def _legend(figure: Figure, courses: Sequence[Course]) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Line2D | Patch] = [
        Line2D([], [], color=SECOND, linewidth=1.8, label="set point"),
        Line2D([], [], color=MEASURED, linewidth=1.0, linestyle=(0, (3, 1.2)), label="start gains"),
        Line2D([], [], color=SIMULATED, linewidth=1.3, label="tuned"),
    ]
    if any(np.ndim(one.before) > 1 or np.ndim(one.after) > 1 for one in courses):
        handles.append(Patch(color=SIMULATED, alpha=0.22, linewidth=0.0, label="span of the samples"))
    if any(one.steps for one in courses):
        handles.append(Patch(facecolor=_CORRIDOR, edgecolor=THIRD, linewidth=0.5, label="corridor"))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), columnspacing=1.4)
