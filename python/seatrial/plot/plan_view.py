"""Parts of a view from above: north up, east to the right, equal scale; waypoints, labels, current.

A plan has a known place and size on the page, so that what is drawn in it can be thinned to what a reader
can tell apart. Held by `tests/test_flight_figures.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.plot.style import HULL_EDGE, MEASURED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.plot.planned_path import PlannedPath

__all__ = ["Plan", "extent", "mark_size", "new_plan", "waypoint_label", "waypoints"]

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

_INK = "#262626"
_AIR = 0.07
_LETTER_IN, _LINE_IN = 0.062, 0.12
_LEAST_CIRCLE_IN = 0.03
_MOST_CIRCLES = 60


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
    rows = np.concatenate([np.asarray(one, dtype=float)[:, :2] for one in places])
    rows = rows[np.isfinite(rows).all(axis=1)]
    low, high = rows.min(axis=0), rows.max(axis=0)
    air = np.maximum(_AIR * float((high - low).max()), 0.5)
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
    return 3.0 if count <= _MOST_CIRCLES else 1.6 if count <= 2 * _MOST_CIRCLES else 0.9


def waypoint_label(path: PlannedPath) -> str:
    """Word of the legend for the squares of waypoints; it says what a number beside one is."""
    return "waypoint with its number" if any(name.isdigit() for name in path.names) else "waypoint"


def waypoints(plan: Plan, path: PlannedPath, acceptance: ArrayLike, *avoid: ArrayLike) -> None:
    """Planned path with its waypoints, their spheres of acceptance and as many names as find room.

    Parameters
    ----------
    plan : Plan
    path : PlannedPath
    acceptance : array, shape (n,)
        Radii, m.
    *avoid : array, shape (m, 2+)
        Lines (north, east, m) that names keep clear of, if it can be.
    """
    axes = plan.axes
    axes.plot(
        path.points[:, 1],
        path.points[:, 0],
        color=MEASURED,
        linewidth=0.9,
        linestyle=(0, (5, 2.5)),
        label="planned path",
        zorder=2.2,
    )
    places = path.places[1:]
    size = mark_size(len(places))
    label = waypoint_label(path)
    axes.plot(places[:, 1], places[:, 0], "s", color=MEASURED, markersize=size, zorder=2.4, label=label)
    _spheres(plan, places, np.asarray(acceptance, dtype=float))
    _names(plan, path, [path.points, *avoid])


def _spheres(plan: Plan, places: Array, acceptance: Array) -> None:
    """Circles of acceptance where they can be seen."""
    from matplotlib.collections import EllipseCollection

    seen = acceptance / plan.m_per_in >= _LEAST_CIRCLE_IN
    if not seen.any() or len(places) > _MOST_CIRCLES:
        return
    circles = EllipseCollection(
        2.0 * acceptance[seen],
        2.0 * acceptance[seen],
        np.zeros(int(seen.sum())),
        units="xy",
        offsets=places[seen, 1::-1],
        offset_transform=plan.axes.transData,
        facecolors="none",
        edgecolors=HULL_EDGE,
        linewidths=0.7,
        zorder=2.1,
    )
    plan.axes.add_collection(circles, autolim=False)
    plan.axes.plot(
        [], [], "o", color="none", markeredgecolor=HULL_EDGE, markersize=5.0, label="sphere of acceptance"
    )


def _names(plan: Plan, path: PlannedPath, lines: Sequence[ArrayLike]) -> None:
    """Names beside their waypoints, clear of each other, of waypoints and, if it can be, of the path."""
    page, wide, high = plan.page(path.places), plan.box_in[2], plan.box_in[3]
    way = np.concatenate([_dense(plan.page(one), 0.06) for one in lines])
    taken: list[Box] = []
    order = [0, len(path.names) - 1, *range(1, len(path.names) - 1)]
    for k in dict.fromkeys(order):
        if not path.names[k]:
            continue
        x, y = page[k]
        length = _LETTER_IN * len(path.names[k]) + 0.02
        best: tuple[int, Box, int] | None = None
        for right, up in ((1, 1), (-1, 1), (1, -1), (-1, -1), (1, 0), (-1, 0), (0, 1), (0, -1)):
            corner = (
                x + (0.07 if right > 0 else -0.07 - length if right < 0 else -0.5 * length),
                y + (0.05 if up > 0 else -0.05 - _LINE_IN if up < 0 else -0.5 * _LINE_IN),
            )
            box = (*corner, corner[0] + length, corner[1] + _LINE_IN)
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
        plan.axes.text(
            east, north, path.names[k], fontsize=6.5, color=_INK, ha=ha, va="center_baseline", zorder=6
        )


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


def _meet(one: Box, other: Box) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]
