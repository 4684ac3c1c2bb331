"""The page of a plan: view from above, profile and one legend, arranged by the shape of the track.

Held by `tests/test_flight_figures.py`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.plot.style import THIRD, WIDTH_IN

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["BOTTOM", "Layout", "current_arrow", "layout", "page_legend", "page_title", "profile_axes"]

Array = NDArray[np.float64]

BOTTOM = "#C8B99A"
_LEFT_IN, _RIGHT_IN, _TOP_IN, _AXIS_IN = 0.55, 0.2, 0.56, 0.42
_PROFILE_IN, _ROW_IN, _TALL = 1.45, 0.15, 0.85
_ARROW_IN = 0.3


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
    north, east = corners[1] - corners[0]
    wide = WIDTH_IN - _LEFT_IN - _RIGHT_IN
    longest = max(len(label) for label in labels)
    if north < _TALL * east:
        columns = 4 if longest < 26 else 3 if longest < 40 else 2
        below = _ROW_IN * math.ceil(len(labels) / columns) + 0.12 + _AXIS_IN
        high = float(np.clip(wide * north / east, 1.5, 4.4))
        plan = (_LEFT_IN, below + _PROFILE_IN + 0.3 + _AXIS_IN, wide, high)
        profile = (_LEFT_IN, below, wide, _PROFILE_IN)
        return Layout(plan, profile, plan[1] + high + _TOP_IN, (0.5 * WIDTH_IN, 0.04), columns)
    half = 0.5 * (WIDTH_IN - 2.0 * _LEFT_IN - _RIGHT_IN)
    columns = 2 if longest < 26 else 1
    legend = _ROW_IN * math.ceil(len(labels) / columns) + 0.2
    high = float(np.clip(half * north / east, _PROFILE_IN + _AXIS_IN + legend, 5.6))
    left, deep = 2.0 * _LEFT_IN + half, min(high - legend - _AXIS_IN + 0.3, 2.7)
    return Layout(
        (_LEFT_IN, _AXIS_IN, half, high),
        (left, _AXIS_IN + high - deep, half, deep),
        _AXIS_IN + high + _TOP_IN,
        (left + 0.5 * half - 0.15, _AXIS_IN + high - deep - _AXIS_IN - legend + 0.1),
        columns,
    )


def profile_axes(figure: Figure, page: Layout) -> Axes:
    """Axes of the profile."""
    left, bottom, wide, high = page.profile
    return figure.add_axes((left / WIDTH_IN, bottom / page.height, wide / WIDTH_IN, high / page.height))


def page_title(figure: Figure, page: Layout, title: str) -> None:
    """Title of the whole page at its upper left."""
    figure.text(0.12 / WIDTH_IN, 1.0 - 0.13 / page.height, title, fontweight="bold", fontsize=10, va="center")


def current_arrow(figure: Figure, page: Layout, current: Sequence[float]) -> None:
    """Arrow of a current's direction, north up, with its speed, at the page's upper right."""
    from matplotlib.patches import FancyArrowPatch

    north, east = float(current[0]), float(current[1])
    speed = math.hypot(north, east)
    if speed == 0.0:
        return
    inches = np.array([WIDTH_IN, page.height])
    middle = np.array([WIDTH_IN - _RIGHT_IN - 0.5 * _ARROW_IN, page.height - 0.19])
    half = 0.5 * _ARROW_IN * np.array([east, north]) / speed
    figure.add_artist(
        FancyArrowPatch(
            tuple((middle - half) / inches),
            tuple((middle + half) / inches),
            transform=figure.transFigure,
            arrowstyle="-|>,head_width=0.22,head_length=0.45",
            mutation_scale=8.0,
            color=THIRD,
            linewidth=1.6,
            shrinkA=0.0,
            shrinkB=0.0,
        )
    )
    x, y = (middle - np.array([0.5 * _ARROW_IN + 0.08, 0.0])) / inches
    figure.text(x, y, f"current {speed:.2g} m/s", fontsize=7, ha="right", va="center")


def page_legend(figure: Figure, panels: tuple[Axes, Axes], page: Layout) -> None:
    """One legend of both panels; what happened stands in it in words."""
    known: dict[str, Artist] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            known.setdefault(label, handle)
    figure.legend(
        list(known.values()),
        list(known),
        loc="lower center",
        bbox_to_anchor=(page.legend[0] / WIDTH_IN, page.legend[1] / page.height),
        ncols=page.columns,
        fontsize=6.5,
        handlelength=1.8,
        columnspacing=1.4,
        labelspacing=0.25,
        borderaxespad=0.0,
    )
