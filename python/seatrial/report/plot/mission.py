"""The plan of a mission: from above with fence, farms, patterns and stops, and the depth along the way.

Held by `tests/report/test_mission_plan.py`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.report.plot.style import (
    CYCLE,
    INK,
    MEASURED,
    RESIDUAL,
    SIMULATED,
    Style,
    band,
    house_style,
    new_figure,
    page_heading,
    panel_title,
)
from seatrial.report.plot.track import (
    BOTTOM,
    bottom_depth,
    extent,
    layout,
    mark_size,
    new_plan,
    page_legend,
    patterns,
    planned_path,
    profile_axes,
    waypoint_label,
    waypoints,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.flight.mission import Mission
    from seatrial.report.plot.track import Plan, PlannedPath, Seabed

_FARM, _UNKNOWN = "#D9CFE3", "#E9E4D4"

FENCE_DASHES: Any = (0, (6, 1.5, 1, 1.5))
"""Offset, then lengths of line and gap in points, as matplotlib takes them."""

_PATTERN_DASHES: tuple[Any, ...] = ((0, (4, 1.2)), (0, (1.4, 1.2)), (0, (4, 1.2, 1.2, 1.2)))
"""Of each pattern its own."""


def mission_plan(mission: Mission, *, seabed: Seabed | None = None) -> Figure:
    """Figure of a mission as planned: view from above and profile.

    `seabed`: depth of the bottom at the origin, m, and its slopes north and east.
    """
    path = planned_path(mission, seabed=seabed)
    columns = mission.waypoints
    acceptance = np.asarray(columns["acceptance_radius_m"], dtype=float)
    runs = patterns(columns["label"])[:5]  # more labels cover the plan
    farms = outlines(mission)
    around = [path.places[1:] + acceptance[:, None], path.places[1:] - acceptance[:, None]]
    fence = [mission.fence] if len(mission.fence) else []
    corners = extent(path.points, *around, *fence, *farms)
    labels = ["start and heading", "sphere of acceptance", "planned path", waypoint_label(path)]
    page = layout(corners, [*labels, *_extra(mission, farms), *(name for name, _, _ in runs)])
    with house_style():
        figure = new_figure(page.height, constrained=False)
        plan = new_plan(figure, page.plan, corners)
        _surroundings(plan, mission, farms)
        heading = _heading(plan, path, float(mission.start["heading"]))
        waypoints(plan, path, acceptance, heading)
        _patterns(plan.axes, path, runs)
        _directions(plan, path)
        _start(plan, heading)
        _stops(plan.axes, path, columns)
        panel_title(plan.axes, "plan", _remark(mission))
        profile = profile_axes(figure, page)
        _profile(profile, mission, path, seabed)
        page_heading(figure, f"mission {mission.name}", below_in=0.13)
        page_legend(figure, (plan.axes, profile), page)
    return figure


def _remark(mission: Mission) -> str:
    """Length, time and speeds, in the title."""
    length, minutes = mission.length, mission.planned_time / 60.0
    way = f"{length / 1e3:.2f} km" if length >= 1e3 else f"{length:.0f} m"
    time = f"{minutes / 60.0:.1f} h" if minutes >= 120.0 else f"{minutes:.0f} min"
    speeds = np.unique(np.round(mission.waypoints["speed_m_s"], 3))
    pace = f"{speeds[0]:g}" if len(speeds) == 1 else f"{speeds[0]:g} to {speeds[-1]:g}"
    return f"{way}, {time} at {pace} m/s"


def _extra(mission: Mission, farms: list[Array]) -> list[str]:
    """Words of the legend that only some missions have."""
    words = ["station kept"] if np.any(np.asarray(mission.waypoints["hold_s"]) > 0.0) else []
    words += ["fence"] if len(mission.fence) else []
    words += ["net or obstacle"] if farms else []
    words += ["depth limit"] if np.isfinite(mission.limits["max_depth_m"]) else []
    return words + (["bottom not known"] if "altitude" in mission.waypoints["vertical"] else [])


def outlines(mission: Mission, cylinders: Sequence[tuple[float, float, float]] = ()) -> list[Array]:
    """Outlines (n, 2) of what stands in the water, north and east in m; cylinders: north, east, radius."""
    lines = []
    further = [{"north_m": n, "east_m": e, "radius_m": r} for n, e, r in cylinders]
    for farm in [*mission.obstacles, *further]:
        if "corners_m" in farm:
            lines.append(np.asarray(farm["corners_m"], dtype=float))
        else:
            angles = np.linspace(0.0, math.tau, 73)
            circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
            lines.append(np.array([farm["north_m"], farm["east_m"]]) + farm["radius_m"] * circle)
    return lines


def draw_obstacles(plan: Plan, farms: list[Array]) -> None:
    """What stands in the water, from above."""
    for k, outline in enumerate(farms):
        look: Style = {"facecolor": _FARM, "edgecolor": MEASURED, "linewidth": 0.7, "hatch": "////"}
        label = None if k else "net or obstacle"
        plan.axes.fill(outline[:, 1], outline[:, 0], alpha=0.8, label=label, zorder=1.5, **look)


def _surroundings(plan: Plan, mission: Mission, farms: list[Array]) -> None:
    """Farms and the fence."""
    draw_obstacles(plan, farms)
    if len(mission.fence):
        closed = np.concatenate([mission.fence, mission.fence[:1]])
        look: Style = {"color": RESIDUAL, "linewidth": 1.1, "linestyle": FENCE_DASHES}
        plan.axes.plot(closed[:, 1], closed[:, 0], label="fence", **look)


def _patterns(axes: Axes, path: PlannedPath, runs: list[tuple[str, int, int]]) -> None:
    """Runs of waypoints that a pattern made, each in its own line."""
    for k, (name, first, last) in enumerate(runs):
        rows = np.flatnonzero((path.leg >= first) & (path.leg <= last))
        rows = rows[1:] if first == 0 else rows
        dashes: Any = "-" if k == 0 else _PATTERN_DASHES[(k - 1) % len(_PATTERN_DASHES)]
        look: Style = {"color": CYCLE[k % len(CYCLE)], "linewidth": 1.3, "linestyle": dashes}
        axes.plot(path.points[rows, 1], path.points[rows, 0], label=name, zorder=2.3, **look)


def _directions(plan: Plan, path: PlannedPath) -> None:
    """Small arrows on the path, so far apart that they can be told apart."""
    page = plan.page(path.points)
    steps = np.hypot(*np.diff(page, axis=0).T)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    spacing = max(0.5, float(way[-1]) / 60.0)  # inches: at most 60 arrows
    for at in np.arange(0.5 * spacing, way[-1], spacing):
        k = min(int(np.searchsorted(way, at)), len(way) - 1)
        if steps[k - 1] < 0.02:
            continue
        share = (at - way[k - 1]) / steps[k - 1]
        place = path.points[k - 1, :2] + share * (path.points[k, :2] - path.points[k - 1, :2])
        toward = place + 0.02 * plan.m_per_in * (page[k] - page[k - 1])[::-1] / steps[k - 1]
        arrow = {"arrowstyle": "-|>", "color": MEASURED, "linewidth": 0.1, "mutation_scale": 6}
        plan.axes.annotate("", toward[::-1], place[::-1], arrowprops=arrow, zorder=2.5)


def _heading(plan: Plan, path: PlannedPath, heading: float) -> Array:
    """Both ends (2, 2) of the arrow of the start's heading, north and east in m."""
    place = path.places[0, :2]
    length = 0.24 * plan.m_per_in  # 0.24 inches on the page
    way = length * np.array([math.cos(heading), math.sin(heading)])
    return np.stack([place, place + way])


def _start(plan: Plan, heading: Array) -> None:
    """Start with an arrow along the heading."""
    place, ahead = heading[:, ::-1]
    plan.axes.plot(*place, "o", color=INK, markersize=4.5, label="start and heading", zorder=5)
    arrow = {"arrowstyle": "-|>", "color": INK, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0}
    plan.axes.annotate("", ahead, place, arrowprops=arrow, zorder=5)


def _stops(axes: Axes, path: PlannedPath, columns: dict[str, Any]) -> None:
    """Places where station is kept."""
    rows = 1 + np.flatnonzero(np.asarray(columns["hold_s"]) > 0.0)
    if not len(rows):
        return
    longest, least = np.max(columns["hold_s"]), np.min(np.asarray(columns["hold_s"])[rows - 1])
    seconds = f"{least:g} s" if least == longest else f"{least:g} to {longest:g} s"
    ring: dict[str, Any] = {
        "color": "none",
        "markeredgecolor": INK,
        "markersize": 6.5,
        "markeredgewidth": 1.0,
    }
    label = f"station kept, {seconds}"
    axes.plot(path.places[rows, 1], path.places[rows, 0], "o", label=label, zorder=4.5, **ring)


def _profile(axes: Axes, mission: Mission, path: PlannedPath, seabed: Seabed | None) -> None:
    """Depth along the way; or altitude, where nothing but that is planned."""
    columns, along = mission.waypoints, path.along
    at = np.array([0.0, *(path.way_of(k) for k in range(len(columns["label"])))])
    above = np.asarray(columns["altitude_m"], dtype=float)
    axes.set_xlabel("way along the path, m")
    # A mission that keeps its altitude over an unknown bottom has no depths.
    if seabed is None and np.isfinite(above).all():
        axes.plot(np.repeat(at, 2)[1:-1], np.repeat(above, 2), color=SIMULATED)
        band(axes, at[[0, -1]], -0.15 * above.max(), 0.0, BOTTOM, label="bottom")
        least = mission.limits["min_altitude_m"]
        if least > 0.0:
            axes.axhline(least, color=RESIDUAL, linestyle=FENCE_DASHES, label="altitude limit")
        axes.set_ylim(-0.15 * above.max(), 1.15 * above.max())
        axes.set_ylabel("altitude, m")
        axes.set_title("altitude above the bottom", loc="left", fontweight="bold")
        axes.set_xlim(0.0, at[-1])
        return
    # Else depth: the path, the bottom below it, and where only the altitude is known.
    depth = path.points[:, 2]
    axes.plot(along, depth, color=SIMULATED)
    size = mark_size(len(at))
    axes.plot(at, path.places[:, 2], "s", color=MEASURED, markersize=size, zorder=4, clip_on=False)
    deepest = float(np.nanmax(path.places[:, 2]))
    bottom = np.array([bottom_depth(point, seabed) for point in path.points])
    deepest = max(deepest, float(np.nanmax(bottom))) if seabed is not None else deepest
    limit = mission.limits["max_depth_m"]
    if np.isfinite(limit):
        deepest = max(deepest, float(limit))
        axes.axhline(limit, color=RESIDUAL, linewidth=0.9, linestyle=FENCE_DASHES, label="depth limit")
    low = 1.08 * deepest + 0.3
    axes.set_ylim(low, min(float(np.nanmin(path.places[:, 2])), 0.0) - 0.05 * deepest)
    if seabed is not None:
        band(axes, along, bottom, low, BOTTOM, label="bottom", zorder=0.8)
    unknown = np.isnan(path.places[1:, 2]) | np.isnan(path.places[:-1, 2])
    for k in np.flatnonzero(unknown):
        axes.axvspan(at[k], at[k + 1], color=_UNKNOWN, linewidth=0, zorder=0.6)
    if unknown.any():
        axes.fill_between([], [], color=_UNKNOWN, label="altitude kept, bottom not known")
    axes.set_xlim(0.0, at[-1])
    axes.set_ylabel("depth, m")
    axes.set_title("depth", loc="left", fontweight="bold", pad=9)
