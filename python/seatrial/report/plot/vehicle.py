"""The vehicle from three sides: hull, centres of gravity and buoyancy, actuators with their thrust.

Side and top have one scale; the front, seen from ahead, has its own where the vehicle is slender. Actuators
that lie behind one another share a label; labels stand in rows above and below the hull, tied to their
positions by thin lines; the legend stands where there is room. Held by
`tests/report/test_vehicle_figures.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.report.plot.style import (
    CYCLE,
    HULL,
    HULL_EDGE,
    RESIDUAL,
    WIDTH_IN,
    house_style,
    label_rows,
    new_figure,
    panel_title,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial._core import Vehicle

_ALONG = 0.15  # a direction with less than this share in the page is drawn as a point or a cross


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
    axes.fill(outline[:, 0], outline[:, 1], facecolor=HULL, edgecolor=HULL_EDGE, linewidth=0.8, zorder=1)


def centres(axes: Axes, view: View, vehicle: Vehicle) -> None:
    """Marks of the centres of gravity and of buoyancy."""
    values = vehicle.coefficients()
    for letter, marker, colour in (("g", "o", "#262626"), ("b", "^", CYCLE[0])):
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
        corners = np.array(facts["position"], float) + np.array([
            ahead + out,
            ahead - out,
            -ahead - out,
            -ahead + out,
        ])
        across, upright = corners[:, view.across], corners[:, view.upright]
        axes.fill(across, upright, facecolor=HULL, edgecolor=HULL_EDGE, linewidth=1.1, zorder=2)


def thrust(axes: Axes, view: View, places: Array, directions: Array, arrow: float, inch: float) -> None:
    """Arrows of positive thrust from the actuators' places; a circle where it points along the view."""
    radius = 0.045 / inch
    for place, direction in zip(places, directions, strict=True):
        x, y = place[view.across], place[view.upright]
        dx, dy = direction[view.across], direction[view.upright]
        if np.hypot(dx, dy) < _ALONG:
            from matplotlib.patches import Circle

            facing = direction[view.viewer] * view.towards > 0.0
            axes.add_patch(
                Circle((x, y), radius, facecolor="white", edgecolor=RESIDUAL, linewidth=0.9, zorder=5)
            )
            axes.plot(
                x, y, "." if facing else "x", color=RESIDUAL, markersize=3, markeredgewidth=0.8, zorder=6
            )
            continue
        axes.plot(x, y, "o", color=RESIDUAL, markersize=2.6, zorder=5)
        axes.annotate(
            "",
            (x + arrow * dx, y + arrow * dy),
            (x, y),
            zorder=5,
            arrowprops={
                "arrowstyle": "-|>,head_width=0.14,head_length=0.28",
                "color": RESIDUAL,
                "linewidth": 0.9,
                "shrinkA": 0.0,
                "shrinkB": 0.0,
            },
        )


def legend(figure: Figure, corner: tuple[float, float] | None, *, fins: bool) -> None:
    """Legend with its upper left corner at a place in the figure, or in a row at the foot."""
    from matplotlib.lines import Line2D

    handles = [
        Line2D(
            [],
            [],
            marker="o",
            linestyle="",
            color="#262626",
            markerfacecolor="none",
            label="centre of gravity",
        ),
        Line2D([], [], marker="^", linestyle="", color=CYCLE[0], label="centre of buoyancy"),
        Line2D(
            [],
            [],
            marker=r"$\rightarrow$",
            linestyle="",
            color=RESIDUAL,
            markersize=9,
            label="positive thrust, fin force" if fins else "positive thrust",
        ),
        Line2D(
            [],
            [],
            marker=r"$\odot$",
            linestyle="",
            color=RESIDUAL,
            markersize=7,
            markeredgewidth=0.2,
            label="towards the viewer",
        ),
        Line2D(
            [],
            [],
            marker=r"$\otimes$",
            linestyle="",
            color=RESIDUAL,
            markersize=7,
            markeredgewidth=0.2,
            label="away",
        ),
    ]
    if corner is None:
        figure.legend(
            handles=handles, loc="lower center", ncols=len(handles), handletextpad=0.3, columnspacing=1.4
        )
    else:
        figure.legend(
            handles=handles, loc="upper left", bbox_to_anchor=corner, borderaxespad=0.0, borderpad=0.0
        )


_LEFT_IN, _GAP_IN, _BOTTOM_IN, _FOOT_IN, _TOP_IN, _RIGHT_IN = (
    0.62,
    0.68,
    0.62,
    0.46,
    0.62,
    0.1,
)  # layout, inches

_LABELS_IN = 0.28  # height of a row of labels

_LEGEND_IN, _LEGEND_ROW_IN = 1.05, 0.2  # as a column, as a row

_TALLEST_IN = 3.1  # of a view

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
    """Figure of a vehicle from the side, from above and from ahead.

    An arrow shows the direction of positive thrust; a dot in a circle points at the viewer, a cross away.
    """
    with house_style():
        names, places, directions = _actuators(vehicle)
        measures = vehicle.geometry()
        size = [measures.get(key, 1.0) for key in ("length", "diameter", "height")]
        layout = _Layout.of(size, places, directions)
        boxes, scales, total, below = _boxes(layout)
        figure = new_figure(total, constrained=False)
        for view, box, inch in zip((_SIDE, _TOP, _FRONT), boxes, scales, strict=True):
            axes = figure.add_axes((box[0] / WIDTH_IN, box[1] / total, box[2] / WIDTH_IN, box[3] / total))
            _axes(axes, view, layout.window(view, _LABELS_IN / inch))
            if measures:
                hull(axes, view, size, box_shaped=vehicle.hull_shape in ("box", "frame"))
            fins(axes, view, vehicle)
            centres(axes, view, vehicle)
            thrust(axes, view, places, directions, layout.arrow, inch)
            signs = np.array([view.right, view.up])
            page, arrows = view.page(places), view.page(directions)
            label_rows(
                axes,
                names,
                page,
                arrows,
                signs=signs,
                window=layout.window(view, _LABELS_IN / inch),
                inch=inch,
            )
        front = boxes[2]
        corner = (front[0] / WIDTH_IN, (front[1] - _BOTTOM_IN) / total)
        steered = any(facts["kind"] == "fin" for facts in vehicle.actuator_info().values())
        legend(figure, corner if below else None, fins=steered)
        figure.text(
            _LEFT_IN / WIDTH_IN, 1.0 - 0.16 / total, vehicle.name, fontweight="bold", fontsize=10, va="center"
        )
        figure.text(
            1.0 - _RIGHT_IN / WIDTH_IN,
            1.0 - 0.16 / total,
            _remark(vehicle, names),
            fontsize=7.5,
            ha="right",
            va="center",
            color="#404040",
        )
    return figure


def _boxes(layout: _Layout) -> tuple[list[tuple[float, float, float, float]], tuple[float, ...], float, bool]:
    """Boxes of side, top and front, scales, height of the figure, whether the legend fits below the front.

    A box is (left, bottom, width, height) in inches; scales are in inches per metre.
    """
    long_m, deep_m = layout.window(_SIDE, 0.0)
    broad_m = layout.window(_TOP, 0.0)[1]
    fixed = 2.0 * _LABELS_IN
    free_in = WIDTH_IN - _LEFT_IN - _GAP_IN - _RIGHT_IN
    share = float(np.clip(long_m / (long_m + broad_m), 0.5, 0.68))
    scale = min(share * free_in / (2.0 * long_m), (_TALLEST_IN - fixed) / (2.0 * max(deep_m, broad_m)))
    wide = 2.0 * long_m * scale
    side, top = 2.0 * deep_m * scale + fixed, 2.0 * broad_m * scale + fixed
    left = _LEFT_IN + wide + _GAP_IN
    front_wide = WIDTH_IN - left - _RIGHT_IN
    room = side + top + _BOTTOM_IN
    front_scale = min(front_wide / (2.0 * broad_m), (room - fixed) / (2.0 * deep_m))
    if long_m < 2.0 * broad_m:
        front_scale = min(front_scale, scale)
    front_wide = 2.0 * broad_m * front_scale
    front = 2.0 * deep_m * front_scale + fixed
    below = room - front > _LEGEND_IN + _BOTTOM_IN
    bottom = _FOOT_IN + (0.0 if below else _LEGEND_ROW_IN)
    total = bottom + top + _BOTTOM_IN + side + _TOP_IN
    boxes = [
        (_LEFT_IN, bottom + top + _BOTTOM_IN, wide, side),
        (_LEFT_IN, bottom, wide, top),
        (left, total - _TOP_IN - front, front_wide, front),
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
    panel_title(axes, view.title)
