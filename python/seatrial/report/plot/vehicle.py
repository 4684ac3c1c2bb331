"""The vehicle from three sides: hull, centres of gravity and buoyancy, actuators with their thrust.

Side and top have one scale; the front, seen from ahead, has its own where the vehicle is slender. Actuators
that lie behind one another share a label; labels stand in rows above and below the hull, tied to their
positions by thin lines; the legend stands where there is room. Held by
`tests/report/test_vehicle_figures.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.report.plot import style as pen

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial._core import Vehicle


@dataclass(frozen=True)
class View:
    """A view: body axes that run to the right and up the page, with sign, and the one towards the viewer."""

    title: str
    across: int
    right: float
    upright: int
    up: float
    viewer: int
    towards: float
    labels: tuple[str, str]

    def page(self, vectors: Array) -> Array:
        """Body vectors (n, 3) on the page (n, 2), right and up."""
        return np.stack([self.right * vectors[:, self.across], self.up * vectors[:, self.upright]], axis=1)


def hull(axes: Axes, view: View, size: list[float], *, box_shaped: bool) -> None:
    """Outline: a box, or a torpedo with an elliptic nose and a parabolic tail; a circle from ahead."""
    length, diameter, height = (0.5 * x for x in size)
    half = {0: length, 1: diameter, 2: height}
    if box_shaped:
        a, b = half[view.across], half[view.upright]
        outline = np.array([[-a, -b], [a, -b], [a, b], [-a, b]])
    elif view.across == 0:
        x = length * np.sin(np.linspace(-0.5 * np.pi, 0.5 * np.pi, 161))
        nose, tail = 0.35 * length, 0.55 * length
        ahead = np.clip((x - (length - nose)) / nose, 0.0, 1.0)
        astern = np.clip((-length + tail - x) / tail, 0.0, 1.0)
        r = half[view.upright] * np.sqrt(1.0 - ahead**2) * (1.0 - 0.85 * astern**2)
        outline = np.concatenate([np.stack([x, r], axis=1), np.stack([x, -r], axis=1)[::-1]])
    else:
        angle = np.linspace(0.0, 2.0 * np.pi, 121)
        outline = np.stack([half[1] * np.cos(angle), half[2] * np.sin(angle)], axis=1)
    axes.fill(
        outline[:, 0], outline[:, 1], facecolor=pen.HULL, edgecolor=pen.HULL_EDGE, linewidth=0.8, zorder=1
    )


def centres(axes: Axes, view: View, vehicle: Vehicle) -> None:
    """Marks of the centres of gravity and of buoyancy."""
    values = vehicle.coefficients()
    for letter, marker, colour in (("g", "o", pen.INK), ("b", "^", pen.CYCLE[0])):
        place = [values.get(f"{axis}_{letter}", 0.0) for axis in "xyz"]
        axes.plot(
            place[view.across],
            place[view.upright],
            marker,
            color=colour,
            markersize=4.5,
            markerfacecolor="none" if letter == "g" else colour,
            markeredgewidth=0.9,
            zorder=4,
        )


def fins(axes: Axes, view: View, vehicle: Vehicle) -> None:
    """Fins as squares of their area, in the plane of chord and span; a line where seen edge-on."""
    for facts in vehicle.actuator_info().values():
        if facts["kind"] != "fin" or facts["position"] is None or not facts["area"]:
            continue
        chord, force = np.array(facts["chord"], float), np.array(facts["direction"], float)
        half = 0.5 * np.sqrt(float(facts["area"]))
        ahead, out = half * chord, half * np.cross(chord, force)
        square = np.array([ahead + out, ahead - out, -ahead - out, -ahead + out])
        corners = np.array(facts["position"], float) + square
        across, upright = corners[:, view.across], corners[:, view.upright]
        axes.fill(across, upright, facecolor=pen.HULL, edgecolor=pen.HULL_EDGE, linewidth=1.1, zorder=2)


def thrust(axes: Axes, view: View, places: Array, directions: Array, arrow: float, inch: float) -> None:
    """Arrows of positive thrust from the actuators' places; a circle where it points along the view."""
    radius = 0.045 / inch
    head = "-|>,head_width=0.14,head_length=0.28"
    pointed = {"arrowstyle": head, "color": pen.RESIDUAL, "linewidth": 0.9, "shrinkA": 0.0, "shrinkB": 0.0}
    for place, direction in zip(places, directions, strict=True):
        x, y = place[view.across], place[view.upright]
        dx, dy = direction[view.across], direction[view.upright]
        if np.hypot(dx, dy) < SETTINGS.along:
            from matplotlib.patches import Circle

            facing = direction[view.viewer] * view.towards > 0.0
            axes.add_patch(
                Circle((x, y), radius, facecolor="white", edgecolor=pen.RESIDUAL, linewidth=0.9, zorder=5)
            )
            axes.plot(
                x, y, "." if facing else "x", color=pen.RESIDUAL, markersize=3, markeredgewidth=0.8, zorder=6
            )
            continue
        axes.plot(x, y, "o", color=pen.RESIDUAL, markersize=2.6, zorder=5)
        axes.annotate("", (x + arrow * dx, y + arrow * dy), (x, y), zorder=5, arrowprops=pointed)


def legend(figure: Figure, corner: tuple[float, float] | None, *, fins: bool) -> None:
    """Legend with its upper left corner at a place in the figure, or in a row at the foot."""
    viewed: pen.Style = {"linestyle": "", "markersize": 7, "markeredgewidth": 0.2}
    positive = "positive thrust, fin force" if fins else "positive thrust"
    handles = [
        pen.stroke("centre of gravity", pen.INK, marker="o", linestyle="", markerfacecolor="none"),
        pen.stroke("centre of buoyancy", pen.CYCLE[0], marker="^", linestyle=""),
        pen.stroke(positive, pen.RESIDUAL, marker=r"$\rightarrow$", linestyle="", markersize=9),
        pen.stroke("towards the viewer", pen.RESIDUAL, marker=r"$\odot$", **viewed),
        pen.stroke("away", pen.RESIDUAL, marker=r"$\otimes$", **viewed),
    ]
    place: pen.Style = {"loc": "lower center", "ncols": 5, "handletextpad": 0.3, "columnspacing": 1.4}
    if corner is not None:
        place = {"loc": "upper left", "bbox_to_anchor": corner, "borderaxespad": 0.0, "borderpad": 0.0}
    figure.legend(handles=handles, **place)


@dataclass(frozen=True)
class ViewsSettings:
    """Layout of the page with the three views, inches where nothing else is said."""

    #: A direction with less than this share in the page is drawn as a point or a cross.
    along: float = 0.15
    left: float = 0.62  #: Left margin: ticks and label.
    right: float = 0.1  #: Right margin.
    top: float = 0.62  #: Top margin: the heading.
    gap: float = 0.68  #: Between side and front.
    bottom: float = 0.62  #: Below each view: ticks and label.
    foot: float = 0.46  #: Below the lowest view.
    tallest: float = 3.1  #: Height of a view at most.
    labels: float = 0.28  #: Height of a row of labels.
    label_row: float = 0.10  #: From the middle of a row of labels to the edge of the view.
    label_air: float = 0.09  #: Between two labels of a row.
    label_pt: float = 6.5  #: Usual size of a label.
    smallest_label_pt: float = 4.0  #: Where a row must shrink.
    legend: float = 1.05  #: Height of the legend as a column.
    legend_row: float = 0.2  #: Height of the legend as a row.


SETTINGS = ViewsSettings()


_SIDE = View("side", 0, 1.0, 2, -1.0, 1, 1.0, ("x forward, m", "z down, m"))

_TOP = View("top", 0, 1.0, 1, -1.0, 2, -1.0, ("x forward, m", "y starboard, m"))

_FRONT = View("front, seen from ahead", 1, -1.0, 2, -1.0, 0, 1.0, ("y starboard, m", "z down, m"))


@dataclass(frozen=True)
class _Layout:
    """Half extents (3,) of hull, actuators and arrows, and the length of an arrow, m."""

    reach: Array
    arrow: float

    @classmethod
    def of(cls, size: list[float], places: Array, directions: Array) -> _Layout:
        """Layout of a hull (length, breadth, height, m) and of actuators (n, 3)."""
        half = np.maximum(0.5 * np.array(size), np.abs(places).max(axis=0, initial=0.0))
        arrow = 0.3 * float(np.sort(half)[1]) + 0.09 * float(half.max())
        tips = np.abs(places + 1.35 * arrow * directions).max(axis=0, initial=0.0)
        return cls(np.maximum(half + 0.9 * arrow, tips), arrow)

    def window(self, view: View, room: float) -> tuple[float, float]:
        """Half width and half height of a view's axes, m."""
        return float(self.reach[view.across]), float(self.reach[view.upright]) + room


def three_views(vehicle: Vehicle) -> Figure:
    """Figure of a vehicle from the side, above and ahead; arrows, or dots to the viewer: positive thrust."""
    with pen.house_style():
        names, places, directions = _actuators(vehicle)
        measures = vehicle.geometry()
        size = [measures.get(key, 1.0) for key in ("length", "diameter", "height")]
        layout = _Layout.of(size, places, directions)
        boxes, scales, total, below = _boxes(layout)
        figure = pen.new_figure(total, constrained=False)
        for view, box, inch in zip((_SIDE, _TOP, _FRONT), boxes, scales, strict=True):
            axes = figure.add_axes((
                box[0] / pen.WIDTH_IN,
                box[1] / total,
                box[2] / pen.WIDTH_IN,
                box[3] / total,
            ))
            _axes(axes, view, layout.window(view, SETTINGS.labels / inch))
            if measures:
                hull(axes, view, size, box_shaped=vehicle.hull_shape in ("box", "frame"))
            fins(axes, view, vehicle)
            centres(axes, view, vehicle)
            thrust(axes, view, places, directions, layout.arrow, inch)
            page, arrows = view.page(places), view.page(directions)
            label_rows(axes, view, names, page, arrows, layout.window(view, SETTINGS.labels / inch), inch)
        # The legend stands below the front where that leaves room, else in a row at the foot.
        front = boxes[2]
        corner = (front[0] / pen.WIDTH_IN, (front[1] - SETTINGS.bottom) / total)
        steered = any(facts["kind"] == "fin" for facts in vehicle.actuator_info().values())
        legend(figure, corner if below else None, fins=steered)
        pen.page_heading(figure, vehicle.name, left_in=SETTINGS.left)
        upper_right = (1.0 - SETTINGS.right / pen.WIDTH_IN, 1.0 - 0.16 / total)
        remark = _remark(vehicle, names)
        figure.text(*upper_right, remark, fontsize=7.5, ha="right", va="center", color=pen.REMARK)
    return figure


def _boxes(layout: _Layout) -> tuple[list[tuple[float, float, float, float]], tuple[float, ...], float, bool]:
    """Boxes of side, top and front, scales, height of the figure, whether the legend fits below the front.

    A box is (left, bottom, width, height) in inches; scales are in inches per metre.
    """
    long_m, deep_m = layout.window(_SIDE, 0.0)
    broad_m = layout.window(_TOP, 0.0)[1]
    fixed = 2.0 * SETTINGS.labels
    free_in = pen.WIDTH_IN - SETTINGS.left - SETTINGS.gap - SETTINGS.right
    share = float(np.clip(long_m / (long_m + broad_m), 0.5, 0.68))
    scale = min(share * free_in / (2.0 * long_m), (SETTINGS.tallest - fixed) / (2.0 * max(deep_m, broad_m)))
    wide = 2.0 * long_m * scale
    side, top = 2.0 * deep_m * scale + fixed, 2.0 * broad_m * scale + fixed
    left = SETTINGS.left + wide + SETTINGS.gap
    front_wide = pen.WIDTH_IN - left - SETTINGS.right
    room = side + top + SETTINGS.bottom
    front_scale = min(front_wide / (2.0 * broad_m), (room - fixed) / (2.0 * deep_m))
    if long_m < 2.0 * broad_m:
        front_scale = min(front_scale, scale)
    front_wide = 2.0 * broad_m * front_scale
    front = 2.0 * deep_m * front_scale + fixed
    below = room - front > SETTINGS.legend + SETTINGS.bottom
    bottom = SETTINGS.foot + (0.0 if below else SETTINGS.legend_row)
    total = bottom + top + SETTINGS.bottom + side + SETTINGS.top
    boxes = [
        (SETTINGS.left, bottom + top + SETTINGS.bottom, wide, side),
        (SETTINGS.left, bottom, wide, top),
        (left, total - SETTINGS.top - front, front_wide, front),
    ]
    return boxes, (scale, scale, front_scale), total, below


def _actuators(vehicle: Vehicle) -> tuple[list[str], Array, Array]:
    """Names, places (n, 3) in m and directions (n, 3) of the actuators whose place is known."""
    facts = vehicle.actuator_info()
    placed = [name for name in vehicle.actuators if facts[name]["position"] is not None]
    places = np.array([facts[name]["position"] for name in placed], dtype=float).reshape(-1, 3)
    directions = np.array([facts[name]["direction"] for name in placed], dtype=float).reshape(-1, 3)
    return placed, places, directions


def _remark(vehicle: Vehicle, placed: list[str]) -> str:
    measures = vehicle.geometry()
    size = " \N{MULTIPLICATION SIGN} ".join(
        f"{measures[key]:g}" for key in ("length", "diameter", "height") if key in measures
    )
    missing = [name for name in vehicle.actuators if name not in placed]
    return (f"{size} m" if size else "no [geometry]") + (
        f"; without place: {', '.join(missing)}" if missing else ""
    )


def _axes(axes: Axes, view: View, window: tuple[float, float]) -> None:
    across, upright = window
    axes.set_xlim(-across * view.right, across * view.right)
    axes.set_ylim(-upright * view.up, upright * view.up)
    axes.set_xlabel(view.labels[0])
    axes.set_ylabel(view.labels[1])
    axes.locator_params(nbins=5)
    axes.grid(color="#F0F0F0")
    pen.panel_title(axes, view.title)


def label_rows(
    axes: Axes,
    view: View,
    names: Sequence[str],
    page: Array,
    arrows: Array,
    window: tuple[float, float],
    inch: float,
) -> None:
    """Label points in rows at the upper and lower edge of a view, one label for those at one place.

    `page` and `arrows` (n, 2) run to the right and up, in m; `window` is half of the view's width and height,
    m, and `inch` inches per metre.
    """
    across, upright = window
    tie = {"arrowstyle": "-", "color": pen.FAINT, "linewidth": 0.5, "shrinkA": 1.0, "shrinkB": 3.0}
    rows: dict[float, list[tuple[float, float, str]]] = {1.0: [], -1.0: []}
    for members in _together(page, 0.06 / inch):  # inches
        x, y = page[members].mean(axis=0)
        # On the centre line a label stands where the arrow does not point.
        side = y if abs(y) > 1e-3 else -arrows[members, 1].sum()
        rows[-1.0 if side < -1e-3 else 1.0].append((x, y, pen.joined([names[k] for k in members])))

    def width(row: Sequence[tuple[float, float, str]]) -> float:
        return sum(_width_in(axes, text) for _, _, text in row) / inch

    for side in (1.0, -1.0):
        _relieve(rows[side], rows[-side], width, room=2.0 * across)
    for side, row in rows.items():
        row.sort()
        widths = [width([entry]) for entry in row]
        shrink = min(1.0, 2.0 * across / sum(widths)) if widths else 1.0
        centres = side_by_side([x for x, _, _ in row], [shrink * width for width in widths], across)
        for (x, y, text), centre in zip(row, centres, strict=True):
            place = (view.right * x, view.up * y)
            label = (view.right * centre, view.up * side * (upright - SETTINGS.label_row / inch))
            size = max(shrink * SETTINGS.label_pt, SETTINGS.smallest_label_pt)
            axes.annotate(
                text, place, label, fontsize=size, ha="center", va="center", zorder=3, arrowprops=tie
            )


def _relieve(
    full: list[tuple[float, float, str]],
    other: list[tuple[float, float, str]],
    width: Callable[[Sequence[tuple[float, float, str]]], float],
    *,
    room: float,
) -> None:
    """Move labels out of a row that is too full, those nearest the centre line first, while it helps."""
    while width(full) > room:
        moved = min(full, key=lambda entry: (abs(entry[1]), entry[0]))
        if width([*other, moved]) >= width(full):
            return
        full.remove(moved)
        other.append(moved)


def side_by_side(wanted: Sequence[float], widths: Sequence[float], limit: float) -> list[float]:
    """Centres near those wanted (sorted), such that intervals of these widths do not overlap.

    They stay within plus and minus the limit where there is room.
    """
    if not wanted:
        return []
    size = np.asarray(widths, dtype=float)
    # Intervals that touch move as one block, placed where its members want to be on average.
    blocks: list[list[int]] = []
    offsets = np.concatenate([[0.0], np.cumsum(0.5 * (size[:-1] + size[1:]))])
    free = np.asarray(wanted, dtype=float) - offsets
    for k in range(len(free)):
        blocks.append([k])
        while len(blocks) > 1 and free[blocks[-2]].mean() > free[blocks[-1]].mean():
            last = blocks.pop()
            blocks[-1] += last
    centres = np.concatenate([np.full(len(block), free[block].mean()) for block in blocks]) + offsets
    centres += max(0.0, float(-limit - (centres[0] - 0.5 * size[0])))
    centres -= max(0.0, float(centres[-1] + 0.5 * size[-1] - limit))
    return [round(float(x), 9) for x in centres]


def _together(page: Array, distance: float) -> list[list[int]]:
    """Points grouped with the first one that is nearer than the distance."""
    groups: list[list[int]] = []
    for k in range(len(page)):
        near = next((group for group in groups if np.abs(page[group[0]] - page[k]).max() < distance), None)
        if near is None:
            groups.append([k])
        else:
            near.append(k)
    return groups


def _width_in(axes: Axes, text: str) -> float:
    """Width of a label in inches, with some air."""
    figure = axes.figure
    sample = figure.text(0.0, 0.0, text, fontsize=SETTINGS.label_pt)
    width = sample.get_window_extent().width / figure.dpi
    sample.remove()
    return float(width) + SETTINGS.label_air
