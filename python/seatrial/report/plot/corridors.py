"""Step responses in their corridors: error areas, a staircase of set points, the speed through all modes.

After Taubert et al. (2014), figure 19 (corridor) and figure 20 (speed control). Of a bundle of drawn
vehicles the first row is the nominal one; the worst response is drawn strongly and its areas are filled, the
others span a band. Held by `tests/report/test_corridor_figures.py` and
`tests/report/test_tuning_gallery.py`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError
from seatrial.report.plot import style as pen
from seatrial.report.plot.flight import line
from seatrial.tuning.criterion import criterion, time_weighted_error, violations

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial._core import Autopilot
    from seatrial.control_design.corridor import Corridor
    from seatrial.tuning.control_problem import ControlProblem


@dataclass(frozen=True)
class CorridorFigureSettings:
    """Layout of corridors and responses, and the flight of the speed's set points."""

    panel_in: float = 2.65  #: Height of a panel of a corridor, inches.
    margin: float = 0.12  #: Beyond the bounds of a corridor, at least, as a share of their range.
    most: float = 0.6  #: Beyond the bounds, at most: a wild response is cut.
    smallest_s: float = 0.001  #: An area below is given as less than that, s.
    course_in: float = 2.2  #: Height of a panel of responses, inches.
    page_in: float = 9.8  #: Height of a figure of responses, at most, inches.
    course_margin: float = 0.08  #: Around what is shown of responses, as a share of its range.
    course_most: float = 0.5  #: How far a wild response may widen its panel, as a share of the range.
    #: Set points of the speed, as shares of the top speed ahead.
    shares: tuple[float, ...] = (0.0, 0.3, 0.6, 0.9, 0.75, 0.45, 0.15)
    astern: float = 0.5  #: The first set point astern, as a share of the slowest breakpoint that is reached.
    depth_m: float = 20.0  #: Away from surface and waves, m.
    hold_s: tuple[float, float] = (15.0, 40.0)  #: How long a set point is held, at least and at most, s.
    max_step_s: float = 0.02  #: Of the vehicle, as in the last assessment of a tuning, s.


SETTINGS = CorridorFigureSettings()


@dataclass(frozen=True, eq=False)
class InCorridor:
    """Normalised responses (n,) or (k, n) to be drawn in a corridor, over an even grid since the step, s.

    `name` is the panel's title with a remark at its right, `each` what a response of a bundle is called.
    """

    name: str
    corridor: Corridor
    t: Array
    responses: Array
    remark: str = ""
    label: str = "share of the step"
    each: str = "responses"


def worst_response(shown: InCorridor) -> int:
    """Index of the response with the largest criterion; among equals, of the largest time-weighted error."""
    bundle = np.atleast_2d(shown.responses)
    cost = criterion(shown.t, bundle, shown.corridor)
    equal = cost == cost.max()
    late = time_weighted_error(shown.t, bundle, shown.corridor)
    return int(np.argmax(np.where(equal, late, -1.0)))


def corridor_figure(shown: Sequence[InCorridor]) -> Figure:
    """Figure with corridors two side by side: bounds, responses, and the areas outside with their sizes."""
    if not shown:
        raise SimulationError("no response to draw in a corridor; give at least one")
    columns = min(len(shown), 2)
    rows = -(-len(shown) // 2)
    with pen.house_style():
        figure = pen.new_figure(
            SETTINGS.panel_in * rows, width_in=pen.COLUMN_IN if columns == 1 else pen.WIDTH_IN
        )
        grid = pen.grid_of(figure, len(shown), columns)
        for row, panels in enumerate(grid):
            beside = shown[2 * row : 2 * row + 2]
            window = _common(beside)
            for axes, response in zip(panels, beside, strict=False):
                if axes is not panels[0]:
                    axes.sharey(panels[0])  # equal limits alone leave each panel ticks of its own
                _panel(axes, response, window)
        # The width of tick labels is known after a first layout: without it a panel's label leaves the page.
        figure.draw_without_rendering()
    return figure


def _common(beside: Sequence[InCorridor]) -> tuple[float, float]:
    """Vertical limits of panels that stand side by side: the eye compares their heights."""
    ends = [
        _window(panel.corridor, np.atleast_2d(panel.responses)[worst_response(panel)]) for panel in beside
    ]
    return min(low for low, _ in ends), max(high for _, high in ends)


def _panel(axes: Axes, panel: InCorridor, window: tuple[float, float]) -> None:
    bundle = np.atleast_2d(np.asarray(panel.responses, dtype=float))
    worst = worst_response(panel)
    areas = violations(panel.t, bundle[worst], panel.corridor)
    period = float(panel.t[1] - panel.t[0])  # the last sample stands for the period after it
    end = min(panel.corridor.until_s, float(panel.t[-1]) + period)
    low, high = window
    _excluded(axes, panel.corridor, end, low, high)
    axes.axhline(panel.corridor.target, color=pen.FAINT, linewidth=0.7, linestyle=(0, (4, 2)))
    # At most 60 responses of a bundle are drawn, evenly taken from those there are.
    for k in np.unique(np.linspace(0, len(bundle) - 1, min(len(bundle), 60)).astype(int)):
        if k != worst:
            axes.plot(panel.t, _drawn(bundle[k]), color=pen.SIMULATED, linewidth=0.5, alpha=0.35, zorder=2.2)
    _areas(axes, panel, bundle[worst], areas)
    label = "response" if len(bundle) == 1 else f"worst of {len(bundle)} {panel.each}"
    label += _beyond(bundle[worst], low, high)
    axes.plot(panel.t, _drawn(bundle[worst]), color=pen.SIMULATED, linewidth=1.4, zorder=3, label=label)
    axes.set_xlim(min(0.0, float(panel.t[0])), end)
    axes.set_ylim(low, high)
    axes.set_xlabel("time since the step, s")
    axes.set_ylabel(panel.label)
    pen.panel_title(axes, panel.name, panel.remark)
    handles, labels = axes.get_legend_handles_labels()
    first = [labels.index(label), labels.index("corridor")]
    order = [*first, *(k for k in range(len(labels)) if k not in first)]
    place: pen.Style = {"loc": "upper center", "bbox_to_anchor": (0.48, -0.23), "borderaxespad": 0.0}
    ordered = [handles[k] for k in order], [labels[k] for k in order]
    axes.legend(*ordered, ncols=2, fontsize=7, columnspacing=1.2, **place)


def _excluded(axes: Axes, corridor: Corridor, end: float, low: float, high: float) -> None:
    """Both bounds, and beyond them a light shade."""
    grid = _fine(corridor, np.array([0.0, end]))
    label = "corridor"
    for bound, edge in zip(corridor.sampled(grid), (low, high), strict=True):
        if np.isfinite(bound).any():
            edges = np.where(np.isfinite(bound), bound, np.nan)
            pen.band(axes, grid, edges, edge, pen.SHADE, alpha=0.75, zorder=0.6)
            axes.plot(grid, edges, color=pen.MEASURED, linewidth=0.9, zorder=2.5, label=label)
            label = "_"


def _areas(axes: Axes, panel: InCorridor, response: Array, areas: Array) -> None:
    """Areas outside the corridor, with their sizes in the legend."""
    grid = _fine(panel.corridor, panel.t)
    y = np.interp(grid, panel.t, _drawn(response))
    sides = (
        ("below", areas[0], np.minimum, pen.SECOND, "////"),
        ("above", areas[1], np.maximum, pen.RESIDUAL, "\\\\\\\\"),
    )
    weights = panel.corridor.weight_lower, panel.corridor.weight_upper
    for bound, weight, (word, area, beyond, colour, hatch) in zip(
        panel.corridor.sampled(grid), weights, sides, strict=True
    ):
        edge = np.where(np.isfinite(bound), bound, np.nan)
        look: pen.Style = {"facecolor": colour, "edgecolor": "white", "hatch": hatch, "linewidth": 0.0}
        label = f"{word}: {_size(float(area), weight)}"
        axes.fill_between(grid, edge, beyond(edge, y), alpha=0.85, zorder=2.0, label=label, **look)


def _size(area: float, weight: float) -> str:
    if not math.isfinite(area):
        return "no end (diverged)"
    if area <= 0.0:
        return "none"
    times = "" if weight == 1.0 else f"{weight:g} × "
    if area < SETTINGS.smallest_s:
        return f"{times}below {SETTINGS.smallest_s:g} s"
    return f"{times}{area:.3g} s" if area < 1e3 else f"{times}{area:.0f} s"


def _beyond(response: Array, low: float, high: float) -> str:
    """Where a response goes that leaves the panel, for the legend; empty for one that does not."""
    seen = response[np.isfinite(response)]
    if not len(seen):
        return " (diverges at once)"
    ends = [float(end) for end in (seen.min(), seen.max()) if not low <= end <= high]
    return f" (to {max(ends, key=abs):.2g})".replace("-", "\N{MINUS SIGN}") if ends else ""


def _window(corridor: Corridor, response: Array) -> tuple[float, float]:
    """Vertical limits: a margin around bounds and response, of which a wild one is cut."""
    values = np.array([value for points in (corridor.lower, corridor.upper) for _, value in points])
    ends = np.array([min(values.min(), 0.0), max(values.max(), corridor.target)])
    span = float(ends[1] - ends[0]) or 1.0
    seen = response[np.isfinite(response)] if np.isfinite(response).any() else ends
    low = min(ends[0] - SETTINGS.margin * span, float(seen.min()) - 0.5 * SETTINGS.margin * span)
    high = max(ends[1] + SETTINGS.margin * span, float(seen.max()) + 0.5 * SETTINGS.margin * span)
    return max(low, float(ends[0]) - SETTINGS.most * span), min(high, float(ends[1]) + SETTINGS.most * span)


def _fine(corridor: Corridor, t: Array) -> Array:
    """Grid with the times of all bounds, and just before them, so that jumps are upright."""
    grid = np.concatenate([t, _jumps(corridor, t[0], t[-1])])
    return np.unique(grid)


def _drawn(response: Array) -> Array:
    """The response without what is not finite: a gap in the line."""
    return np.where(np.isfinite(response), response, np.nan)


_CORRIDOR = "#DDEBDD"


@dataclass(frozen=True)
class SetPointStep:
    """A step of the set point: time in s, values before and after in the unit drawn, and its corridor."""

    at_s: float
    before: float
    after: float
    corridor: Corridor


@dataclass(frozen=True, eq=False)
class Course:
    """Time course of one loop, in the unit that is drawn; the axis of a depth points down.

    Responses `before` and `after` tuning are (n,) or (k, n), the first row of the nominal vehicle; the set
    point (n,) is blank where there is none. The corridors of the steps are shaded.
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
    """Figure with a panel per loop: set points, corridors, responses before and after tuning."""
    if not courses:
        raise SimulationError("no step responses to draw; give at least one time course")
    columns = 1 if len(courses) <= 3 else 2  # more courses stand in two, and all of them on a page
    rows = -(-len(courses) // columns)
    with pen.house_style():
        alone = 0.8 if len(courses) == 1 else 0.0  # inches of more height for the only panel
        figure = pen.new_figure(min(SETTINGS.course_in * rows + 0.5 + alone, SETTINGS.page_in))
        grid = pen.grid_of(figure, len(courses), columns)
        panels = list(grid.flat)
        for axes, course in zip(panels, courses, strict=False):
            _step_responses_panel(axes, course, narrow=columns > 1)
        for axes in panels[len(courses) - columns : len(courses)]:
            axes.set_xlabel("time, s")
        for column in grid.T:
            figure.align_ylabels(list(column))
        _legend(figure, courses)
    return figure


def _step_responses_panel(axes: Axes, course: Course, *, narrow: bool) -> None:
    edges = _corridors(axes, course)
    line(
        axes, course.t, course.set_point, color=pen.SECOND, linewidth=1.8, drawstyle="steps-post", zorder=2.1
    )
    low, high = _step_responses_window(course, edges)
    styles = ((course.before, pen.MEASURED, (0, (3, 1.2)), 1.0), (course.after, pen.SIMULATED, "-", 1.3))
    for responses, colour, dashes, width in styles:
        bundle = np.atleast_2d(np.asarray(responses, dtype=float))
        bundle = np.where(np.isfinite(bundle), bundle, np.nan)
        if len(bundle) > 1:
            ends = np.fmin.reduce(bundle, axis=0), np.fmax.reduce(bundle, axis=0)
            # A span that is mostly wider than the panel would hide all else and say no more than that; one
            # that is wider for less than two fifths of the time is seen.
            if (ends[1] - ends[0] > high - low).mean() < 0.4:
                pen.band(axes, course.t, *ends, colour, alpha=0.22, zorder=2.2)
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
        pen.panel_title(axes, course.name, remark)
        return
    # Name and remark have no room beside each other.
    axes.set_title(course.name, loc="left", fontweight="bold", pad=14 if remark else None)
    if remark:
        axes.text(0.0, 1.03, remark, fontsize=7, color=pen.REMARK, transform=axes.transAxes)


def _corridors(axes: Axes, course: Course) -> list[float]:
    """Shade the corridors up to the next step; ends of what they span, in the unit drawn."""
    steps = sorted(course.steps, key=lambda step: step.at_s)
    ends: list[float] = []
    for k, step in enumerate(steps):
        until = steps[k + 1].at_s if k + 1 < len(steps) else float(course.t[-1])
        last = min(step.corridor.until_s, until - step.at_s)
        times = np.unique(np.concatenate([np.linspace(0.0, last, 240), _jumps(step.corridor, 0.0, last)]))
        bounds = [step.before + (step.after - step.before) * side for side in step.corridor.sampled(times)]
        both = np.isfinite(bounds).all(axis=0)
        pen.band(axes, step.at_s + times, bounds[0], bounds[1], _CORRIDOR, where=both, zorder=0.6)
        for bound in bounds:
            finite = np.where(np.isfinite(bound), bound, np.nan)
            axes.plot(step.at_s + times, finite, color=pen.THIRD, linewidth=0.5, alpha=0.7, zorder=0.7)
            ends += [float(x) for x in bound[np.isfinite(bound)]]
    return ends


def _jumps(corridor: Corridor, first: float, last: float) -> Array:
    """Times of all bounds within a span, and 1 us before each, which draws a jump upright."""
    times = np.array([time for points in (corridor.lower, corridor.upper) for time, _ in points])
    times = np.concatenate([times, times - 1e-6])
    return np.asarray(times[(times >= first) & (times <= last)])


def _step_responses_window(course: Course, edges: Sequence[float]) -> tuple[float, float]:
    """Vertical limits: set points and corridors, and the responses, of which a wild one is cut."""
    kept = np.concatenate([np.asarray(edges), course.set_point[np.isfinite(course.set_point)]])
    seen = np.concatenate([np.ravel(course.before), np.ravel(course.after)])
    seen = seen[np.isfinite(seen)]
    kept, seen = (kept if len(kept) else seen), (seen if len(seen) else kept)
    span = float(np.ptp(kept)) or 1.0
    low = max(min(kept.min(), seen.min()), kept.min() - SETTINGS.course_most * span)
    high = min(max(kept.max(), seen.max()), kept.max() + SETTINGS.course_most * span)
    return float(low - SETTINGS.course_margin * span), float(high + SETTINGS.course_margin * span)


def _legend(figure: Figure, courses: Sequence[Course]) -> None:
    handles: list[Artist] = [
        pen.stroke("set point", pen.SECOND, linewidth=1.8),
        pen.stroke("start gains", pen.MEASURED, linewidth=1.0, linestyle=(0, (3, 1.2))),
        pen.stroke("tuned", pen.SIMULATED, linewidth=1.3),
    ]
    if any(np.ndim(course.before) > 1 or np.ndim(course.after) > 1 for course in courses):
        handles.append(pen.field("span of the samples", pen.SIMULATED, alpha=0.22, linewidth=0.0))
    if any(course.steps for course in courses):
        handles.append(pen.field("corridor", _CORRIDOR, edgecolor=pen.THIRD, linewidth=0.5))
    pen.legend_below(figure, handles, columnspacing=1.4)


def course_of_set_points(plan: ControlProblem) -> tuple[Array, Array]:
    """Times (n,), s, from which set points of the speed (n,), m/s, hold, and the time of the end as last."""
    slowest = min(plan.autopilot.speeds_m_s[place] for place in plan.places)
    ahead = [share * plan.top_m_s for share in SETTINGS.shares]
    if slowest < 0.0:
        levels = [*ahead, 0.0, SETTINGS.astern * slowest, slowest, 0.0]
    else:  # a hull steered by fins: from its slowest breakpoint on
        levels = [max(level, slowest) for level in ahead]
    hold = float(np.clip(plan.trials("surge").until_s, *SETTINGS.hold_s))
    times: Array = hold * np.arange(len(levels) + 1.0)
    return times, np.array(levels)


def speed_steps(plan: ControlProblem, start: Autopilot, tuned: Autopilot) -> Figure:
    """Figure of the speed ahead over set points, before and after a tuning; still water, heading held."""
    times, levels = course_of_set_points(plan)
    flown = [_flown(plan, autopilot, times, levels) for autopilot in (start, tuned)]
    t: Array = plan.autopilot.period_s * np.arange(float(max(len(speeds) for speeds in flown)))
    before, after = (np.pad(speeds, (0, len(t) - len(speeds)), constant_values=np.nan) for speeds in flown)
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


def _flown(plan: ControlProblem, autopilot: Autopilot, times: Array, levels: Array) -> Array:
    """Speed ahead (n,), m/s, per control period."""
    from seatrial.flight.conditions import Conditions
    from seatrial.flight.flight import fly_batch
    from seatrial.flight.mission import Mission

    # A leg so long that no flight ends it: set points take the place of guidance.
    mission = Mission.from_toml(
        f"""
        format = 1
        name = "set points"
        speed_m_s = 1.0
        acceptance_radius_m = 10.0
        start = {{ north_m = 0.0, east_m = 0.0, depth_m = {SETTINGS.depth_m}, heading_deg = 0.0 }}
        legs = [{{ north_m = 1e6, east_m = 0.0, depth_m = {SETTINGS.depth_m} }}]
        """
    )
    sensors = plan.table.sensors
    flights = fly_batch(
        plan.vehicle,
        autopilot,
        mission,
        conditions=Conditions(
            sensors=None if sensors == "perfect" else sensors,
            voltage_v=plan.table.voltage_v,
            max_step_s=SETTINGS.max_step_s,
            max_time_s=float(times[-1]),
        ),
        set_points={"times": times[:-1], "speed": levels, "heading": np.zeros(len(levels))},
        logs=True,
    )
    log = np.asarray(flights.log(0))
    return np.asarray(log[:, flights.columns.index("u")])
