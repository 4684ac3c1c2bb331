"""A view from above and its page, north up and in one scale; the plan of a mission and its profile.

The planned path has straight legs, and circles joined where the vehicle meets them. A plan has a known place
and size on the page, so that its lines can be thinned to what a reader can tell apart. `mission_plan` shows a
mission with fence, farms, patterns and stops, and the depth along the way. Held by
`tests/report/test_flight_figures.py` and `tests/report/test_mission_plan.py`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.base.arrays import Array
from seatrial.report.plot import style as pen

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.flight.mission import Mission


Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class PlanSettings:
    """Layout of a plan with its profile, inches where nothing else is said."""

    air: float = 0.07  #: At the edge of a track, as a share of its extent.
    most_circles: int = 60  #: Waypoints that are drawn with their sphere of acceptance.
    letter: float = 0.062  #: Width of a letter of a waypoint's name.
    line: float = 0.12  #: Height of a waypoint's name.
    away: tuple[float, ...] = (0.07, 0.14, 0.22)  #: From a waypoint to its name: the nearest that is clear.
    left: float = 0.55  #: Left margin: the ticks and the label of the axis.
    right: float = 0.2  #: Right margin.
    top: float = 0.56  #: Top margin: the heading.
    axis: float = 0.42  #: Below a panel: its ticks and label.
    profile: float = 1.45  #: Height of the profile below a plan.
    legend_row: float = 0.15  #: Height of a row of the legend.
    tall: float = 0.85  #: A track higher than this share of its width stands beside its profile.
    arrow: float = 0.3  #: Length of the arrow of the current.


SETTINGS = PlanSettings()


@dataclass(frozen=True)
class Plan:
    """Axes of a view from above, and their scale."""

    axes: Axes
    box_in: Box
    m_per_in: float

    def page(self, places: ArrayLike) -> Array:
        """Places (n, 2+) north, east in m as inches from the lower left of the axes, (n, 2)."""
        points = np.asarray(places, dtype=float)
        corner = np.array([self.axes.get_xlim()[0], self.axes.get_ylim()[0]])
        return np.asarray((points[:, 1::-1] - corner) / self.m_per_in)


def extent(*places: ArrayLike) -> tuple[Array, Array]:
    """Lower and upper corner (north, east) of all finite places (n, 2+), m; never without any width."""
    rows = np.concatenate([np.asarray(points, dtype=float)[:, :2] for points in places])
    rows = rows[np.isfinite(rows).all(axis=1)]
    low, high = rows.min(axis=0), rows.max(axis=0)
    air = np.maximum(SETTINGS.air * float((high - low).max()), 0.5)
    return low - air, high + air


def new_plan(figure: Figure, box_in: Box, corners: tuple[Array, Array]) -> Plan:
    """Plan in a box (left, bottom, width, height) in inches that shows all between two corners."""
    width, height = figure.get_size_inches()
    left, bottom, wide, high = box_in
    axes = figure.add_axes((left / width, bottom / height, wide / width, high / height))
    low, top = corners
    scale = float(max((top - low)[1] / wide, (top - low)[0] / high))
    middle = 0.5 * (low + top)
    axes.set_xlim(middle[1] - 0.5 * scale * wide, middle[1] + 0.5 * scale * wide)
    axes.set_ylim(middle[0] - 0.5 * scale * high, middle[0] + 0.5 * scale * high)
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel("east, m")
    axes.set_ylabel("north, m")
    return Plan(axes, box_in, scale)


def mark_size(count: int) -> float:
    """Size of so many waypoints' squares, points."""
    return 3.0 if count <= SETTINGS.most_circles else 1.6 if count <= 2 * SETTINGS.most_circles else 0.9


def waypoint_label(path: PlannedPath) -> str:
    """Word of the legend for the squares of waypoints; it says what a number beside one is."""
    return "waypoint with its number" if any(name.isdigit() for name in path.names) else "waypoint"


def waypoints(plan: Plan, path: PlannedPath, acceptance: ArrayLike, *avoid: ArrayLike) -> None:
    """Planned path with its waypoints, their spheres of acceptance and as many names as find room.

    `acceptance` (n,) are radii, m; names keep clear of the lines `avoid` (m, 2+), m, if it can be.
    """
    axes = plan.axes
    look = pen.Style(color=pen.MEASURED, linewidth=0.9, linestyle=(0, (5, 2.5)), label="planned path")
    axes.plot(path.points[:, 1], path.points[:, 0], zorder=2.2, **look)
    places = path.places[1:]
    size = mark_size(len(places))
    label = waypoint_label(path)
    axes.plot(places[:, 1], places[:, 0], "s", color=pen.MEASURED, markersize=size, zorder=2.4, label=label)
    _spheres(plan, places, np.asarray(acceptance, dtype=float))
    rims = []
    if len(places) <= SETTINGS.most_circles:
        rims = [_rim(*place) for place in zip(places, np.asarray(acceptance, dtype=float), strict=True)]
    _names(plan, path, [path.points, *avoid, *rims])


def _rim(place: Array, radius_m: float) -> Array:
    """Points of the circle of a sphere of acceptance, north and east, m."""
    angle = np.linspace(0.0, 2.0 * np.pi, 33)
    return np.column_stack([place[0] + radius_m * np.cos(angle), place[1] + radius_m * np.sin(angle)])


def _spheres(plan: Plan, places: Array, acceptance: Array) -> None:
    """Circles of acceptance where they can be seen."""
    from matplotlib.collections import EllipseCollection

    seen = acceptance / plan.m_per_in >= 0.03  # inches: smaller ones are dots
    if not seen.any() or len(places) > SETTINGS.most_circles:
        return
    size = 2.0 * acceptance[seen]
    place = pen.Style(units="xy", offsets=places[seen, 1::-1], offset_transform=plan.axes.transData)
    look = pen.Style(facecolors="none", edgecolors=pen.HULL_EDGE, linewidths=0.7, zorder=2.1)
    circles = EllipseCollection(size, size, np.zeros(len(size)), **place, **look)
    plan.axes.add_collection(circles, autolim=False)
    ring = pen.Style(color="none", markeredgecolor=pen.HULL_EDGE, markersize=5.0)
    plan.axes.plot([], [], "o", label="sphere of acceptance", **ring)


# Right and up of a place, in the order in which a name tries them.
_SIDES = ((1, 1), (-1, 1), (1, -1), (-1, -1), (1, 0), (-1, 0), (0, 1), (0, -1))


def _names(plan: Plan, path: PlannedPath, lines: Sequence[ArrayLike]) -> None:
    """Names beside their waypoints, clear of each other, of waypoints and, if it can be, of the path."""
    from matplotlib.patheffects import withStroke

    page, wide, high = plan.page(path.places), plan.box_in[2], plan.box_in[3]
    way = np.concatenate([_dense(plan.page(line), 0.06) for line in lines])
    taken: list[Box] = []
    order = [0, len(path.names) - 1, *range(1, len(path.names) - 1)]
    for k in dict.fromkeys(order):
        if not path.names[k]:
            continue
        x, y = page[k]
        length = SETTINGS.letter * len(path.names[k]) + 0.02
        best: tuple[int, Box, int] | None = None
        for away, (right, up) in product(SETTINGS.away, _SIDES):
            aside, above = (away, 0.7 * away) if right and up else (away, away)
            corner = (
                x + (aside if right > 0 else -aside - length if right < 0 else -0.5 * length),
                y + (above if up > 0 else -above - SETTINGS.line if up < 0 else -0.5 * SETTINGS.line),
            )
            box = (*corner, corner[0] + length, corner[1] + SETTINGS.line)
            if box[0] < 0.0 or box[1] < 0.0 or box[2] > wide or box[3] > high:
                continue
            if any(_meet(box, other) for other in taken) or _inside(box, page):
                continue
            crossed = _inside(box, way)
            if best is None or crossed < best[0]:
                best = (crossed, box, right)
        if best is None:
            continue
        _, box, side = best
        taken.append(box)
        low = np.array([plan.axes.get_xlim()[0], plan.axes.get_ylim()[0]])
        edge = {1: box[0], 0: 0.5 * (box[0] + box[2]), -1: box[2]}[side]
        east, north = low + plan.m_per_in * np.array([edge, 0.5 * (box[1] + box[3])])
        ha: Any = {1: "left", 0: "center", -1: "right"}[side]
        text = plan.axes.text(
            east, north, path.names[k], fontsize=6.5, color=pen.INK, ha=ha, va="center_baseline", zorder=6
        )
        # A name may have to stand on a line: it stays readable on a white edge.
        text.set_path_effects([withStroke(linewidth=1.8, foreground="white")])


def _dense(page: Array, step_in: float) -> Array:
    """Points of a line on the page at most so far apart."""
    page = page[np.isfinite(page).all(axis=1)]
    if len(page) < 2:
        return page
    steps = np.hypot(*np.diff(page, axis=0).T)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.linspace(0.0, way[-1], min(int(way[-1] / step_in) + 2, 20_000))
    return np.column_stack([np.interp(at, way, page[:, 0]), np.interp(at, way, page[:, 1])])


def _inside(box: Box, points: Array) -> int:
    """How many points lie in a box (x0, y0, x1, y1)."""
    x, y = points.T
    return int(((box[0] < x) & (x < box[2]) & (box[1] < y) & (y < box[3])).sum())


def _meet(box: Box, other: Box) -> bool:
    return box[0] < other[2] and other[0] < box[2] and box[1] < other[3] and other[1] < box[3]


BOTTOM = "#C8B99A"


@dataclass(frozen=True)
class Layout:
    """Places on the page, in: plan and profile (left, bottom, width, height), and the figure's height.

    Where the legend stands: the middle of its lower edge, and how many columns it may have.
    """

    plan: tuple[float, float, float, float]
    profile: tuple[float, float, float, float]
    height: float
    legend: tuple[float, float]
    columns: int


def layout(corners: tuple[Array, Array], labels: Sequence[str]) -> Layout:
    """Plan above its profile and the legend where it is wide; beside both where it is tall."""
    left_in, axis_in = SETTINGS.left, SETTINGS.axis
    north, east = corners[1] - corners[0]
    wide = pen.WIDTH_IN - left_in - SETTINGS.right
    longest = max(len(label) for label in labels)
    if north < SETTINGS.tall * east:
        columns = 4 if longest < 26 else 3 if longest < 40 else 2
        below = SETTINGS.legend_row * math.ceil(len(labels) / columns) + 0.12 + axis_in
        high = float(np.clip(wide * north / east, 1.5, 4.4))
        plan = (left_in, below + SETTINGS.profile + 0.3 + axis_in, wide, high)
        profile = (left_in, below, wide, SETTINGS.profile)
        return Layout(plan, profile, plan[1] + high + SETTINGS.top, (0.5 * pen.WIDTH_IN, 0.04), columns)
    half = 0.5 * (pen.WIDTH_IN - 2.0 * left_in - SETTINGS.right)
    columns = 2 if longest < 26 else 1
    legend = SETTINGS.legend_row * math.ceil(len(labels) / columns) + 0.2
    high = float(np.clip(half * north / east, SETTINGS.profile + axis_in + legend, 5.6))
    left, deep = 2.0 * left_in + half, min(high - legend - axis_in + 0.3, 2.7)
    return Layout(
        (left_in, axis_in, half, high),
        (left, axis_in + high - deep, half, deep),
        axis_in + high + SETTINGS.top,
        (left + 0.5 * half - 0.15, axis_in + high - deep - axis_in - legend + 0.1),
        columns,
    )


def profile_axes(figure: Figure, page: Layout) -> Axes:
    """Axes of the profile."""
    left, bottom, wide, high = page.profile
    return figure.add_axes((
        left / pen.WIDTH_IN,
        bottom / page.height,
        wide / pen.WIDTH_IN,
        high / page.height,
    ))


def current_arrow(figure: Figure, page: Layout, current: Sequence[float]) -> None:
    """Arrow of a current's direction, north up, with its speed, at the page's upper right."""
    from matplotlib.patches import FancyArrowPatch

    north, east = float(current[0]), float(current[1])
    speed = math.hypot(north, east)
    if speed == 0.0:
        return
    inches = np.array([pen.WIDTH_IN, page.height])
    middle = np.array([pen.WIDTH_IN - SETTINGS.right - 0.5 * SETTINGS.arrow, page.height - 0.19])
    half = 0.5 * SETTINGS.arrow * np.array([east, north]) / speed
    head = pen.Style(arrowstyle="-|>,head_width=0.22,head_length=0.45", mutation_scale=8.0)
    look = pen.Style(color=pen.THIRD, linewidth=1.6, shrinkA=0.0, shrinkB=0.0, transform=figure.transFigure)
    tail, tip = tuple((middle - half) / inches), tuple((middle + half) / inches)
    figure.add_artist(FancyArrowPatch(tail, tip, **head, **look))
    x, y = (middle - np.array([0.5 * SETTINGS.arrow + 0.08, 0.0])) / inches
    figure.text(x, y, f"current {speed:.2g} m/s", fontsize=7, ha="right", va="center")


def page_legend(figure: Figure, panels: tuple[Axes, Axes], page: Layout) -> None:
    """One legend of both panels; what happened stands in it in words."""
    known: dict[str, Artist] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            known.setdefault(label, handle)
    foot = (page.legend[0] / pen.WIDTH_IN, page.legend[1] / page.height)
    place = pen.Style(loc="lower center", bbox_to_anchor=foot, borderaxespad=0.0, ncols=page.columns)
    tight = pen.Style(fontsize=6.5, handlelength=1.8, columnspacing=1.4, labelspacing=0.25)
    figure.legend(list(known.values()), list(known), **place, **tight)


Seabed = tuple[float, float, float]

_PLAIN = re.compile(r"waypoint \d+")

_OF_PATTERN = re.compile(r"(?:to )?(?P<stem>.+?) (?:\d+(?:/\d+)?|(?:round|stop) \d+.*)")


@dataclass(frozen=True, eq=False)
class PlannedPath:
    """A mission's path: points (m, 3) in order of travel, NED in m, and the waypoints on it.

    Attributes
    ----------
    points, leg
        North, east and depth along the path (the depth is nan where an altitude is kept above an unknown
        bottom), (m, 3), and the leg that each is on, (m,).
    places, names
        Start and waypoints, (n + 1, 3), and a short name each, empty inside a pattern.
    along
        Horizontal way up to each point, (m,), m.
    """

    points: Array
    leg: NDArray[np.int64]
    places: Array
    names: tuple[str, ...]

    @property
    def along(self) -> Array:
        """Horizontal way up to each point, (m,), m."""
        steps = np.hypot(*np.diff(self.points[:, :2], axis=0).T)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def way_of(self, waypoint: int) -> float:
        """Horizontal way up to the end of a leg, m."""
        return float(self.along[np.flatnonzero(self.leg == waypoint)[-1]])


def planned_path(mission: Mission, *, seabed: Seabed | None = None) -> PlannedPath:
    """Path of a mission; `seabed`: depth of the bottom at the origin, m, and its slopes north and east."""
    columns, start = mission.waypoints, mission.start
    here = np.array([start["north_m"], start["east_m"], start["depth_m"]])
    points, legs, places = [here], [0], [here]
    for k in range(len(columns["label"])):
        centre = np.array([columns["north_m"][k], columns["east_m"][k], columns["depth_m"][k]])
        if columns["vertical"][k] == "altitude":
            centre[2] = bottom_depth(centre, seabed) - columns["altitude_m"][k]
        for point in _way(here, centre, columns["circle_radius_m"][k], columns["turns"][k]):
            points.append(point)
            legs.append(k)
        here = points[-1]
        places.append(centre)
    return PlannedPath(np.array(points), np.array(legs), np.array(places), _waypoint_names(columns["label"]))


def bottom_depth(place: Array, seabed: Seabed | None) -> float:
    """Depth of the bottom below a place (north, east, ...), m; nan where it is not known."""
    if seabed is None:
        return math.nan
    return float(seabed[0] + seabed[1] * place[0] + seabed[2] * place[1])


def patterns(names: Sequence[str]) -> list[tuple[str, int, int]]:
    """Runs of waypoints whose labels differ in their number only: (name, first, last)."""
    stems = [match["stem"] if (match := _OF_PATTERN.fullmatch(name)) else name for name in names]
    runs: list[tuple[str, int, int]] = []
    for k, stem in enumerate(stems):
        if runs and runs[-1][0] == stem:
            runs[-1] = (stem, runs[-1][1], k)
        else:
            runs.append((stem, k, k))
    return [(stem, first, last) for stem, first, last in runs if last > first and stem != "waypoint"]


def _way(here: Array, centre: Array, radius: float, turns: float) -> list[Array]:
    """Points after `here` to a waypoint, or to its circle at the nearest point and about it."""
    if radius <= 0.0:
        return [centre]
    out = here[:2] - centre[:2]
    bearing = math.atan2(out[1], out[0])
    count = max(2, math.ceil(abs(turns) * math.tau / math.radians(5.0)))  # 5 deg of an arc per straight piece
    angles = bearing + np.linspace(0.0, turns * math.tau, count + 1)
    return [
        np.array([centre[0] + radius * math.cos(a), centre[1] + radius * math.sin(a), centre[2]])
        for a in angles
    ]


def _waypoint_names(labels: Sequence[str]) -> tuple[str, ...]:
    """Short names: numbers or the labels of the file; within a pattern none but at its ends."""
    inside = {k for _, first, last in patterns(labels) for k in range(first, last + 1)}
    ends = {k for _, first, last in patterns(labels) for k in (first, last)}
    short = [
        "" if k in inside - ends else str(k + 1) if _PLAIN.fullmatch(label) or k in inside else label
        for k, label in enumerate(labels)
    ]
    return ("start", *short)


_FARM, _UNKNOWN = "#D9CFE3", "#E9E4D4"

FENCE_DASHES: Any = (0, (6, 1.5, 1, 1.5))
"""Offset, then lengths of line and gap in points, as matplotlib takes them."""

_PATTERN_DASHES: tuple[Any, ...] = ((0, (4, 1.2)), (0, (1.4, 1.2)), (0, (4, 1.2, 1.2, 1.2)))
"""Of each pattern its own."""


def mission_plan(mission: Mission, *, seabed: Seabed | None = None) -> Figure:
    """Figure of a mission as planned: view from above and profile; `seabed` as of `planned_path`."""
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
    with pen.house_style():
        figure = pen.new_figure(page.height, constrained=False)
        plan = new_plan(figure, page.plan, corners)
        _surroundings(plan, mission, farms)
        heading = _heading(plan, path, float(mission.start["heading"]))
        waypoints(plan, path, acceptance, heading)
        _patterns(plan.axes, path, runs)
        _directions(plan, path)
        _start(plan, heading)
        _stops(plan.axes, path, columns)
        pen.panel_title(plan.axes, "plan", _remark(mission))
        profile = profile_axes(figure, page)
        _profile(profile, mission, path, seabed)
        pen.page_heading(figure, f"mission {mission.name}", below_in=0.13)
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
        look: pen.Style = {"facecolor": _FARM, "edgecolor": pen.MEASURED, "linewidth": 0.7, "hatch": "////"}
        label = None if k else "net or obstacle"
        plan.axes.fill(outline[:, 1], outline[:, 0], alpha=0.8, label=label, zorder=1.5, **look)


def _surroundings(plan: Plan, mission: Mission, farms: list[Array]) -> None:
    """Farms and the fence."""
    draw_obstacles(plan, farms)
    if len(mission.fence):
        closed = np.concatenate([mission.fence, mission.fence[:1]])
        look: pen.Style = {"color": pen.RESIDUAL, "linewidth": 1.1, "linestyle": FENCE_DASHES}
        plan.axes.plot(closed[:, 1], closed[:, 0], label="fence", **look)


def _patterns(axes: Axes, path: PlannedPath, runs: list[tuple[str, int, int]]) -> None:
    """Runs of waypoints that a pattern made, each in its own line."""
    for k, (name, first, last) in enumerate(runs):
        rows = np.flatnonzero((path.leg >= first) & (path.leg <= last))
        rows = rows[1:] if first == 0 else rows
        dashes: Any = "-" if k == 0 else _PATTERN_DASHES[(k - 1) % len(_PATTERN_DASHES)]
        look: pen.Style = {"color": pen.CYCLE[k % len(pen.CYCLE)], "linewidth": 1.3, "linestyle": dashes}
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
        arrow = {"arrowstyle": "-|>", "color": pen.MEASURED, "linewidth": 0.1, "mutation_scale": 6}
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
    plan.axes.plot(*place, "o", color=pen.INK, markersize=4.5, label="start and heading", zorder=5)
    arrow = {"arrowstyle": "-|>", "color": pen.INK, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0}
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
        "markeredgecolor": pen.INK,
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
        axes.plot(np.repeat(at, 2)[1:-1], np.repeat(above, 2), color=pen.SIMULATED)
        pen.band(axes, at[[0, -1]], -0.15 * above.max(), 0.0, BOTTOM, label="bottom")
        least = mission.limits["min_altitude_m"]
        if least > 0.0:
            axes.axhline(least, color=pen.RESIDUAL, linestyle=FENCE_DASHES, label="altitude limit")
        axes.set_ylim(-0.15 * above.max(), 1.15 * above.max())
        axes.set_ylabel("altitude, m")
        axes.set_title("altitude above the bottom", loc="left", fontweight="bold")
        axes.set_xlim(0.0, at[-1])
        return
    # Else depth: the path, the bottom below it, and where only the altitude is known.
    depth = path.points[:, 2]
    axes.plot(along, depth, color=pen.SIMULATED)
    size = mark_size(len(at))
    axes.plot(at, path.places[:, 2], "s", color=pen.MEASURED, markersize=size, zorder=4, clip_on=False)
    deepest = float(np.nanmax(path.places[:, 2]))
    bottom = np.array([bottom_depth(point, seabed) for point in path.points])
    deepest = max(deepest, float(np.nanmax(bottom))) if seabed is not None else deepest
    limit = mission.limits["max_depth_m"]
    if np.isfinite(limit):
        deepest = max(deepest, float(limit))
        axes.axhline(limit, color=pen.RESIDUAL, linewidth=0.9, linestyle=FENCE_DASHES, label="depth limit")
    low = 1.08 * deepest + 0.3
    axes.set_ylim(low, min(float(np.nanmin(path.places[:, 2])), 0.0) - 0.05 * deepest)
    if seabed is not None:
        pen.band(axes, along, bottom, low, BOTTOM, label="bottom", zorder=0.8)
    unknown = np.isnan(path.places[1:, 2]) | np.isnan(path.places[:-1, 2])
    for k in np.flatnonzero(unknown):
        axes.axvspan(at[k], at[k + 1], color=_UNKNOWN, linewidth=0, zorder=0.6)
    if unknown.any():
        axes.fill_between([], [], color=_UNKNOWN, label="altitude kept, bottom not known")
    axes.set_xlim(0.0, at[-1])
    axes.set_ylabel("depth, m")
    axes.set_title("depth", loc="left", fontweight="bold", pad=9)
