"""Block diagrams: boxes, summing points, arrows and words on a page that is measured in inches.

The origin is at the lower left. Text that is wider than its box is set smaller until it fits, so that a
vehicle with many actuators or long names can be drawn too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from seatrial.report.plot.style import new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Text

INK, PALE, ABSENT = "#262626", "#F3F6F8", "#8A9299"

HEAD_PT, LINE_PT, SMALLEST_PT = 7.5, 6.5, 4.5

_HEAD_IN, _LINE_IN = 0.165, 0.125

_MARGIN_IN = 0.05

Point = tuple[float, float]


@dataclass(frozen=True)
class Block:
    """A box on the page: centre and size, in; its sides are points where arrows end."""

    x: float
    y: float
    width: float
    height: float

    @property
    def left(self) -> Point:
        """Middle of the left side."""
        return self.x - 0.5 * self.width, self.y

    @property
    def right(self) -> Point:
        """Middle of the right side."""
        return self.x + 0.5 * self.width, self.y

    @property
    def top(self) -> Point:
        """Middle of the upper side."""
        return self.x, self.y + 0.5 * self.height

    @property
    def bottom(self) -> Point:
        """Middle of the lower side."""
        return self.x, self.y - 0.5 * self.height


def page(width_in: float, height_in: float) -> tuple[Figure, Axes]:
    """Empty figure and its only axes, whose data are inches; call it inside `house_style`."""
    figure = new_figure(height_in, width_in=width_in, constrained=False)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_xlim(0.0, width_in)
    axes.set_ylim(0.0, height_in)
    axes.set_axis_off()
    return figure, axes


def block(
    axes: Axes,
    centre: Point,
    size: Point,
    head: str,
    lines: Sequence[str] = (),
    *,
    absent: bool = False,
    shift: float = 0.0,
    bold: bool = False,
) -> Block:
    """Box with a head and lines of small print below it; an absent one is dashed and grey.

    Parameters
    ----------
    axes : Axes
        Of a `page`.
    centre, size : tuple of float
        In inches.
    head : str
        One line or several; nothing where it is empty.
    lines : sequence of str
    absent : bool
        Whether the vehicle has no such part.
    shift : float
        Inches by which the text stands below the middle, for a picture above it.
    bold : bool
        Whether the head is set in bold.
    """
    from matplotlib.patches import FancyBboxPatch

    made = Block(*centre, *size)
    colour = ABSENT if absent else INK
    axes.add_patch(
        FancyBboxPatch(
            (centre[0] - 0.5 * size[0], centre[1] - 0.5 * size[1]),
            *size,
            boxstyle="round,pad=0,rounding_size=0.03",
            facecolor="white" if absent else PALE,
            edgecolor=colour,
            linewidth=0.8,
            linestyle=(0, (3, 2)) if absent else "-",
            zorder=3,
        )
    )
    heads = head.splitlines()
    y = centre[1] - shift + 0.5 * (_HEAD_IN * len(heads) + _LINE_IN * len(lines))
    settings: dict[str, Any] = {"widest": size[0], "color": colour}
    for line in heads:
        weight = "bold" if bold else "normal"
        words(axes, (centre[0], y - 0.5 * _HEAD_IN), line, size_pt=HEAD_PT, weight=weight, **settings)
        y -= _HEAD_IN
    small = [
        words(axes, (centre[0], y - (k + 0.5) * _LINE_IN), line, **settings) for k, line in enumerate(lines)
    ]
    for text in small:  # one size per box
        text.set_fontsize(min(other.get_fontsize() for other in small))
    return made


def words(
    axes: Axes,
    at: Point,
    text: str,
    *,
    size_pt: float = LINE_PT,
    widest: float | None = None,
    color: str = INK,
    ha: str = "center",
    weight: str = "normal",
) -> Text:
    """Text at a point, set smaller where it is wider than `widest` inches."""
    settings: dict[str, Any] = {"fontsize": size_pt, "color": color, "ha": ha, "fontweight": weight}
    made = axes.text(*at, text, va="center_baseline" if "$" in text else "center", zorder=5, **settings)
    if widest is not None:
        figure = axes.figure
        width = made.get_window_extent().width / figure.dpi
        room = widest - 2.0 * _MARGIN_IN
        if width > room:
            made.set_fontsize(max(size_pt * room / width, SMALLEST_PT))
    return made


def bar(axes: Axes, x: float, low: float, high: float, *, width: float = 0.15) -> Block:
    """Tall summing point, a sum sign in its middle."""
    made = block(axes, (x, 0.5 * (low + high)), (width, high - low), "")
    words(axes, (x, 0.5 * (low + high)), r"$\Sigma$", size_pt=9)
    return made


def summing(axes: Axes, centre: Point, *, radius: float = 0.08) -> Block:
    """Round summing point."""
    from matplotlib.patches import Circle

    axes.add_patch(Circle(centre, radius, facecolor="white", edgecolor=INK, linewidth=0.8, zorder=3))
    return Block(*centre, 2.0 * radius, 2.0 * radius)


def dot(axes: Axes, at: Point) -> None:
    """Branch of a signal."""
    axes.plot(*at, "o", color=INK, markersize=2.6, zorder=4)


def connect(axes: Axes, *points: Point, head: bool = True, absent: bool = False) -> None:
    """Signal along points, with an arrow's head at the last one; grey where it belongs to an absent part."""
    from matplotlib.patches import FancyArrowPatch
    from matplotlib.path import Path

    axes.add_patch(
        FancyArrowPatch(
            path=Path(list(points)),
            arrowstyle="-|>,head_width=0.22,head_length=0.45" if head else "-",
            mutation_scale=9.0,
            color=ABSENT if absent else INK,
            linewidth=0.8,
            joinstyle="miter",
            capstyle="butt",
            fill=head,
            zorder=2,
            shrinkA=0.0,
            shrinkB=0.0,
        )
    )
