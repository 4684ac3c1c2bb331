"""A flight over time: track with the planned path and the depth.

The parts that all time courses share come first: thinned lines, legs, events, modes, settled spans. Held by
`tests/report/test_flight_figures.py`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array, Mask, runs
from seatrial.report.plot import style as pen
from seatrial.report.plot.track import (
    BOTTOM,
    FENCE_DASHES,
    current_arrow,
    draw_obstacles,
    extent,
    layout,
    mark_size,
    new_plan,
    outlines,
    page_legend,
    planned_path,
    profile_axes,
    waypoint_label,
    waypoints,
)
from seatrial.report.results.flight_findings import cause

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.flight.flight import Flight
    from seatrial.report.plot.track import Plan, PlannedPath


@dataclass(frozen=True)
class CourseSettings:
    """How much of a flight its figures show."""

    most_points: int = 2400  #: Points of a line: more than a panel has dots.
    most_events: int = 7  #: Events with a marker each.
    most_legs: int = 50  #: Legs that are numbered: more run into one another.
    letter_in: float = 0.056  #: Width of a letter of a remark, inches.
    grid: int = 201  #: Places a side at which the distance to obstacles is promised.


SETTINGS = CourseSettings()

_EVENT_MARKS = "XPD*v^<>"

_EVENT: pen.Style = {"color": pen.RESIDUAL, "markeredgecolor": "white", "linestyle": "none", "zorder": 6}

_MODES: tuple[tuple[str, float, Any], ...] = (
    (pen.THIRD, 2.2, "-"),
    (pen.SIMULATED, 1.2, "-"),
    (pen.FOURTH, 1.2, (0, (4, 1.2))),
    (pen.MEASURED, 1.2, (0, (1.4, 1.2))),
)


@dataclass(frozen=True)
class Event:
    """Something that happened: time in s, words, the marker that shows it."""

    t_s: float
    words: str
    mark: str


def mode_style(mode: int, count: int) -> dict[str, Any]:
    """Line of a mode: colour, width and dashes, which a grey print tells apart."""
    colour, width, dashes = _MODES[1 if count == 1 else min(mode, len(_MODES) - 1)]
    return {"color": colour, "linewidth": width, "linestyle": dashes}


def thinned(t: Array, y: Array) -> tuple[Array, Array]:
    """A curve with so few points as a page can show: the least and the largest of every short while."""
    size = math.ceil(2 * len(t) / SETTINGS.most_points)
    if size < 4:
        return t, y
    full = len(t) // size * size
    rows = np.arange(full).reshape(-1, size)
    low = np.where(np.isnan(y), np.inf, y)[rows].argmin(axis=1)
    high = np.where(np.isnan(y), -np.inf, y)[rows].argmax(axis=1)
    picked = np.sort(np.stack([rows[:, 0] + low, rows[:, 0] + high], axis=1), axis=1).ravel()
    kept = np.unique(np.concatenate([[0], picked, np.arange(full, len(t)), [len(t) - 1]]))
    return t[kept], y[kept]


def line(axes: Axes, t: Array, y: Array, **style: Any) -> None:
    """Curve over time, thinned."""
    axes.plot(*thinned(t, y), **style)


def spans(t: Array, mask: Mask) -> list[tuple[float, float]]:
    """Beginning and duration, s, of every time over which a mask (n,) holds."""
    step = float(t[1] - t[0]) if len(t) > 1 else 1.0
    return [(float(t[first]), (last - first) * step) for first, last in runs(mask)]


def shade(axes: Axes, t: Array, mask: Mask, colour: str) -> None:
    """Times over which a mask (n,) holds as one shade behind a panel; what a page cannot part is joined."""
    least = 0.001 * float(t[-1] - t[0])
    joined: list[tuple[float, float]] = []
    for begin, duration in spans(t, mask):
        if joined and begin - sum(joined[-1]) < least:
            joined[-1] = (joined[-1][0], begin + duration - joined[-1][0])
        else:
            joined.append((begin, duration))
    axes.broken_barh(
        joined, (0.0, 1.0), facecolors=colour, linewidth=0, zorder=0.5, transform=axes.get_xaxis_transform()
    )


def settled(flight: Flight) -> Mask:
    """Rows on the second half of a straight leg, where the errors of guidance count, (n,)."""
    path = flight.route
    half = np.array([
        0.0 if stop.task == "circle" else 0.5 * math.hypot(*(stop.position[:2] - path.before(k)[:2]))
        for k, stop in enumerate(path.stops)
    ])
    leg = np.clip(flight.leg, 0, len(half) - 1)
    return np.asarray(flight.under_way & ~flight.holding & (flight.distance < half[leg]))


def leg_lines(axes: Axes, flight: Flight, *, numbers: bool = False, room: float = 0.028) -> None:
    """Where legs begin, with their numbers above the panel no closer than `room`, a share of its width."""
    rows = np.flatnonzero(np.diff(flight.leg) != 0) + 1
    few = len(rows) <= SETTINGS.most_legs
    if few:
        for row in rows:
            axes.axvline(float(flight.t[row]), color=pen.FAINT, linewidth=0.5, zorder=0.9)
    if not numbers:
        return
    begins = np.concatenate([[0], rows])
    ends = np.concatenate([rows, [len(flight.t) - 1]])
    least, last = room * float(flight.t[-1] - flight.t[0]), -math.inf
    for first, end in zip(begins, ends, strict=True):
        middle = 0.5 * float(flight.t[first] + flight.t[end])
        if middle - last < least:
            continue
        # The word stands before the first number: left of the panel are the labels of its axis.
        alone = last > -math.inf
        _above(axes, middle, str(flight.leg[first] + 1) if alone else f"leg {flight.leg[first] + 1}")
        last = middle if alone else middle + 0.5 * least


def _above(axes: Axes, t: float, text: str) -> None:
    """Small print above a panel."""
    place: pen.Style = {"xycoords": axes.get_xaxis_transform(), "textcoords": "offset points"}
    axes.annotate(text, (t, 1.0), (0, 1.5), ha="center", fontsize=5.5, color="#595959", **place)


def events(flight: Flight) -> list[Event]:
    """Faults, outages and reactions of a flight in order of time; of many the first."""
    what = flight.circumstances
    timed = [(fault.at_s, fault.sentence()) for fault in what.faults]
    timed += [(outage.from_s, outage.sentence()) for outage in what.outages]
    timed += [
        (alert.t_s, f"{alert.reaction} at {alert.t_s:.0f} s: {cause(alert.cause)}") for alert in flight.alerts
    ]
    timed = sorted(entry for entry in timed if entry[0] <= flight.t[-1])[: SETTINGS.most_events]
    return [Event(t, words, mark) for (t, words), mark in zip(timed, _EVENT_MARKS, strict=False)]


def flight_heading(figure: Figure, flight: Flight) -> None:
    """Vehicle and mission above a figure."""
    pen.heading(figure, f"{flight.vehicle.name}: {flight.mission.name}")


def flight_legend(figure: Figure, flight: Flight, handles: Sequence[Artist], columns: int) -> None:
    """Legend below a figure, which says what happened."""
    marks = [
        pen.stroke(event.words, pen.RESIDUAL, marker=event.mark, linestyle="none", markersize=4)
        for event in events(flight)
    ]
    pen.legend_below(figure, [*handles, *marks], columns, fontsize=6.5, columnspacing=1.4)


def event_lines(axes: Axes, flight: Flight) -> None:
    """Times of the events, with their markers at the panel's upper edge."""
    for event in events(flight):
        axes.axvline(event.t_s, color=pen.RESIDUAL, linewidth=0.7, linestyle=(0, (2, 1.5)), zorder=1.2)
        place: pen.Style = {"transform": axes.get_xaxis_transform(), "clip_on": False}
        axes.plot(event.t_s, 0.97, marker=event.mark, markersize=4.0, markeredgewidth=0.4, **_EVENT, **place)


def strip_rows(flight: Flight) -> list[tuple[str, Mask, str]]:
    """Rows of the strip: modes, station-keeping and reactions that occur, when, and in which colour."""
    count = len(flight.modes)
    rows = [
        (name, flight.mode == k, str(mode_style(k, count)["color"]))
        for k, name in enumerate(flight.modes)
        if (flight.mode == k).any()
    ]
    held = flight.holding & ~flight.done
    if held.any():
        rows.append(("holding", held, "#7A8791"))
    names = {1: "hold", 2: "surface", 3: "abort"}
    rows += [
        (f"reaction: {name}", flight.alert == level, pen.RESIDUAL)
        for level, name in names.items()
        if (flight.alert == level).any()
    ]
    return rows


def mode_strip(axes: Axes, flight: Flight) -> None:
    """Modes, station-keeping and reactions over time, a row each."""
    rows = strip_rows(flight)
    for k, (_, mask, colour) in enumerate(rows):
        axes.broken_barh(
            spans(flight.t, mask), (len(rows) - 1 - k - 0.36, 0.72), facecolors=colour, linewidth=0
        )
    axes.set_yticks(range(len(rows))[::-1], [name for name, _, _ in rows])
    axes.set_ylim(-0.55, len(rows) - 0.45)
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False)
    axes.set_xlabel("time, s")


def flight_track(flight: Flight) -> Figure:
    """Figure of a flight's track: from above with plan, modes and events, and the depth over time."""
    what = flight.circumstances
    path = planned_path(flight.mission, seabed=what.seabed)
    acceptance = np.array([stop.acceptance for stop in flight.route.stops])
    reach = np.concatenate([path.places[1:] + acceptance[:, None], path.places[1:] - acceptance[:, None]])
    flown = flight.position[np.isfinite(flight.position).all(axis=1)]
    farms = outlines(flight.mission, what.obstacles)
    corners = extent(path.points, flown, reach, *farms)
    page = layout(corners, _labels(flight, path))
    with pen.house_style():
        figure = pen.new_figure(page.height, constrained=False)
        plan = new_plan(figure, page.plan, corners)
        waypoints(plan, path, acceptance, flown)
        _obstacles(plan, flight, farms)
        _flown(plan, flight)
        pen.panel_title(
            plan.axes, "track", _remark(flight, int(page.plan[2] / SETTINGS.letter_in) - len("track   "))
        )
        profile = profile_axes(figure, page)
        _depth(profile, flight, path)
        pen.page_heading(figure, f"{flight.vehicle.name}: {flight.mission.name}", below_in=0.13)
        current_arrow(figure, page, what.current)
        page_legend(figure, (plan.axes, profile), page)
    return figure


def _labels(flight: Flight, path: PlannedPath) -> list[str]:
    """Words that the legend will have, as many and as long."""
    flown = [f"flown: {flight.modes[k]}" for k in np.unique(flight.mode)]
    beside = ["net or obstacle", "promised distance", "closest: hull 10.0 m away"]
    shown = beside if math.isfinite(flight.metrics["clearance_m"]) else []
    plan = ["planned path", waypoint_label(path), "sphere of acceptance", "start", "end", "station kept"]
    depth = ["desired depth", "flown depth", "depth limit", "bottom"]
    return [*shown, *plan, *depth, *flown, *(event.words for event in events(flight))]


def _obstacles(plan: Plan, flight: Flight, farms: list[Array]) -> None:
    """What stands in the water, the distance that the mission promises, and where the flight came closest."""
    draw_obstacles(plan, farms)
    axes, mission = plan.axes, flight.mission
    if mission.promised_m > 0.0:
        (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
        easts, norths = np.meshgrid(
            np.linspace(west, east, SETTINGS.grid), np.linspace(south, north, SETTINGS.grid)
        )
        places = np.column_stack([norths.ravel(), easts.ravel(), np.zeros(easts.size)])
        reserve = mission.core.clearance(None, places, np.zeros_like(places))[:, 1].reshape(easts.shape)
        dotted: pen.Style = {"colors": pen.RESIDUAL, "linewidths": 0.8, "linestyles": "dotted"}
        axes.contour(easts, norths, reserve, levels=[0.0], zorder=1.6, **dotted)
        axes.plot([], [], ":", color=pen.RESIDUAL, linewidth=0.8, label="promised distance")
    if math.isfinite(clear := flight.metrics["clearance_m"]):
        row = int(np.argmin(np.abs(flight.t - flight.metrics["clearance_time_s"])))
        mark: pen.Style = {
            "marker": "D",
            "color": "white",
            "markeredgecolor": pen.RESIDUAL,
            "markersize": 5.0,
        }
        label = f"closest: hull {clear:.1f} m away"
        axes.plot(*flight.position[row, [1, 0]], label=label, linestyle="none", zorder=5.5, **mark)


def _remark(flight: Flight, most: int) -> str:
    """How it ended, how far and how long, of so many letters at most: it shares its line with a name."""
    far = flight.metrics.get("distance_m", math.nan)
    length = f"{far / 1e3:.2f} km" if far >= 1e3 else f"{far:.0f} m"
    way = f"{length} in {flight.t[-1]:.0f} s"
    verdict = flight.outcome_in_words.removeprefix("flown to its end, ")
    first = verdict.partition(" and ")[0]
    remarks = [f"{words}, {way}" for words in (verdict, first, "not complete")]
    return next((remark for remark in remarks if len(remark) <= most), way)


def _flown(plan: Plan, flight: Flight) -> None:
    """Track by mode, start and end, stations kept, events."""
    axes, place = plan.axes, flight.position
    keep = _apart(plan.page(place), 0.004)
    for k, name in enumerate(flight.modes):
        style = mode_style(k, len(flight.modes))
        mask = flight.mode == k
        if not mask.any():
            continue
        joined = mask | np.concatenate([[False], mask[:-1]])
        rows = keep | (joined & ~np.roll(joined, 1)) | (joined & ~np.roll(joined, -1))
        east, north = (np.where(joined, place[:, i], np.nan)[rows] for i in (1, 0))
        axes.plot(east, north, label=f"flown: {name}", zorder=3.0 + 0.1 * k, **style)
    held = [round(t / flight.period_s) for t, _ in spans(flight.t, flight.holding & ~flight.done)]
    if held:
        ring: pen.Style = {
            "color": "white",
            "markeredgecolor": pen.INK,
            "markersize": 4.5,
            "markeredgewidth": 0.9,
        }
        axes.plot(place[held, 1], place[held, 0], "o", label="station kept", zorder=4.5, **ring)
    finite = np.flatnonzero(np.isfinite(place).all(axis=1))
    ends = ((0, "o", "start"), (int(finite[-1]), "s", "end"))
    for row, mark, label in ends:
        axes.plot(place[row, 1], place[row, 0], mark, color=pen.INK, markersize=4.5, label=label, zorder=5)
    for event in events(flight):
        row = min(round(event.t_s / flight.period_s), int(finite[-1]))
        size: pen.Style = {"markersize": 6.0, "markeredgewidth": 0.5}
        east, north = place[row, 1], place[row, 0]
        axes.plot(east, north, marker=event.mark, label=event.words, **size, **_EVENT)


def _depth(axes: Axes, flight: Flight, path: PlannedPath) -> None:
    """Depth over time: waypoints as planned, desired and flown; bottom and limit where there are any."""
    t, depth = flight.t, flight.position[:, 2]
    leg_lines(axes, flight, numbers=True, room=0.045)
    rows = np.flatnonzero((np.diff(flight.leg) != 0) | (np.diff(flight.done.astype(int)) > 0)) + 1
    planned = path.places[flight.leg[rows - 1] + 1, 2]
    begins, depths = np.append(t[0], t[rows]), np.append(path.places[0, 2], planned)
    axes.plot(begins, depths, "s", color=pen.MEASURED, markersize=mark_size(len(rows)), zorder=4)
    wanted = np.where(flight.done | (flight.alert >= 3), np.nan, flight.desired["depth"])
    line(axes, t, wanted, color=pen.SECOND, linewidth=1.9, label="desired depth")
    line(axes, t, depth, color=pen.SIMULATED, linewidth=1.0, label="flown depth")
    finite = depth[np.isfinite(depth)]
    lowest = float(max(np.nanmax(path.places[:, 2]), finite.max()))
    bottom = depth + flight.altitude
    if np.isfinite(bottom).any():
        lowest = max(lowest, float(np.nanmax(bottom[np.isfinite(bottom)])))
    limit = flight.mission.limits["max_depth_m"]
    air = max(0.06 * lowest, 0.3)
    if np.isfinite(limit) and limit < 1.5 * lowest + 1.0:
        axes.axhline(limit, color=pen.RESIDUAL, linewidth=0.9, linestyle=FENCE_DASHES, label="depth limit")
        lowest = max(lowest, limit)
    axes.set_ylim(lowest + 1.6 * air, min(float(finite.min()), float(np.nanmin(path.places[:, 2]))) - air)
    if np.isfinite(bottom).any():
        pen.band(axes, t, bottom, lowest + 1.6 * air, BOTTOM, label="bottom", zorder=0.8)
    event_lines(axes, flight)
    axes.set_xlim(t[0], t[-1])
    axes.set_xlabel("time, s")
    axes.set_ylabel("depth, m")
    axes.set_title("depth", loc="left", fontweight="bold", pad=9)


def _apart(page: Array, step_in: float) -> NDArray[np.bool_]:
    """Rows of a line on the page that a reader can tell apart, (n,)."""
    steps = np.nan_to_num(np.hypot(*np.diff(page, axis=0).T))
    cell = np.floor(np.concatenate([[0.0], np.cumsum(steps)]) / step_in)
    return np.asarray(np.concatenate([[True], np.diff(cell) > 0.0]) | ~np.isfinite(page).all(axis=1))
