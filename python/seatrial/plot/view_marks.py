"""What stands in a view of a vehicle: hull, centres of gravity and buoyancy, thrust, and a legend."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.plot.style import CYCLE, HULL, HULL_EDGE, RESIDUAL

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial._core import Vehicle

__all__ = ["View", "centres", "hull", "legend", "thrust"]

Array = NDArray[np.float64]

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
