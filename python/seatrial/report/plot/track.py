"""A view from above and its page: north up, east to the right, equal scale; planned path, profile, legend.

The planned path has straight legs, and circles joined where the vehicle meets them. A plan has a known place
and size on the page, so that its lines can be thinned to what a reader can tell apart. Held by
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
from seatrial.report.plot.style import HULL_EDGE, INK, MEASURED, THIRD, WIDTH_IN, Style

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
    look = Style(color=MEASURED, linewidth=0.9, linestyle=(0, (5, 2.5)), label="planned path")
    axes.plot(path.points[:, 1], path.points[:, 0], zorder=2.2, **look)
    places = path.places[1:]
    size = mark_size(len(places))
    label = waypoint_label(path)
    axes.plot(places[:, 1], places[:, 0], "s", color=MEASURED, markersize=size, zorder=2.4, label=label)
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
    place = Style(units="xy", offsets=places[seen, 1::-1], offset_transform=plan.axes.transData)
    look = Style(facecolors="none", edgecolors=HULL_EDGE, linewidths=0.7, zorder=2.1)
    circles = EllipseCollection(size, size, np.zeros(len(size)), **place, **look)
    plan.axes.add_collection(circles, autolim=False)
    ring = Style(color="none", markeredgecolor=HULL_EDGE, markersize=5.0)
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
            east, north, path.names[k], fontsize=6.5, color=INK, ha=ha, va="center_baseline", zorder=6
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
    wide = WIDTH_IN - left_in - SETTINGS.right
    longest = max(len(label) for label in labels)
    if north < SETTINGS.tall * east:
        columns = 4 if longest < 26 else 3 if longest < 40 else 2
        below = SETTINGS.legend_row * math.ceil(len(labels) / columns) + 0.12 + axis_in
        high = float(np.clip(wide * north / east, 1.5, 4.4))
        plan = (left_in, below + SETTINGS.profile + 0.3 + axis_in, wide, high)
        profile = (left_in, below, wide, SETTINGS.profile)
        return Layout(plan, profile, plan[1] + high + SETTINGS.top, (0.5 * WIDTH_IN, 0.04), columns)
    half = 0.5 * (WIDTH_IN - 2.0 * left_in - SETTINGS.right)
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
    return figure.add_axes((left / WIDTH_IN, bottom / page.height, wide / WIDTH_IN, high / page.height))


def current_arrow(figure: Figure, page: Layout, current: Sequence[float]) -> None:
    """Arrow of a current's direction, north up, with its speed, at the page's upper right."""
    from matplotlib.patches import FancyArrowPatch

    north, east = float(current[0]), float(current[1])
    speed = math.hypot(north, east)
    if speed == 0.0:
        return
    inches = np.array([WIDTH_IN, page.height])
    middle = np.array([WIDTH_IN - SETTINGS.right - 0.5 * SETTINGS.arrow, page.height - 0.19])
    half = 0.5 * SETTINGS.arrow * np.array([east, north]) / speed
    head = Style(arrowstyle="-|>,head_width=0.22,head_length=0.45", mutation_scale=8.0)
    look = Style(color=THIRD, linewidth=1.6, shrinkA=0.0, shrinkB=0.0, transform=figure.transFigure)
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
    foot = (page.legend[0] / WIDTH_IN, page.legend[1] / page.height)
    place = Style(loc="lower center", bbox_to_anchor=foot, borderaxespad=0.0, ncols=page.columns)
    tight = Style(fontsize=6.5, handlelength=1.8, columnspacing=1.4, labelspacing=0.25)
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
