"""Vehicles to be drawn, the words of a figure, and whether a figure can be printed."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch
from matplotlib.text import Text

from seatrial._core import Vehicle

MINUS = "\N{MINUS SIGN}"
BARE = 'format = 1\nname = "bare"\n[coefficients]\nm = 10.0\nI_x = 1.0\nI_y = 1.0\nI_z = 1.0\n'
DIRECT = """
[characteristics.direct]
kind = "direct"
[[thrusters]]
name = "one"
command = "N"
wrench_per_newton = [1.0, 0.0, 0.0, 0.0, 0.0, 0.2]
characteristic = "direct"
"""
UNEVEN = """
[motors.esc]
maximum_ahead = 300.0
maximum_astern = 250.0
minimum_ahead = 30.0
minimum_astern = 40.0
below_minimum = "zero"
n_acc_per_s = 500.0
n_dec_per_s = 900.0
T_1_s = 0.05
T_t_s = 0.2
[characteristics.curve]
kind = "polynomial"
ahead = [0.0, 0.1, 0.001]
astern = [0.0, 0.08, 0.0008]
[[thrusters]]
name = "pusher_with_a_long_name"
command = "us"
neutral = 1500.0
reversed = true
position_m = [-1.0, 0.0, 0.0]
direction = [1.0, 0.0, 0.0]
motor = "esc"
characteristic = "curve"
"""
VEHICLES = {
    **{name: Vehicle.load(name) for name in Vehicle.names()},
    "bare": Vehicle.from_toml(BARE),
    "direct": Vehicle.from_toml(BARE.replace("bare", "direct") + DIRECT),
    "uneven": Vehicle.from_toml(BARE.replace("bare", "uneven") + "X_0 = 2.0\nY_rdot = -3.0\n" + UNEVEN),
}
CWOLF, UNEVENLY = VEHICLES["cwolf"], VEHICLES["uneven"]


def texts(figure: Figure) -> list[str]:
    """All words of a figure."""
    return [text.get_text() for text in figure.findobj(Text) if isinstance(text, Text) and text.get_text()]


def assert_printable(figure: Figure) -> None:
    """No word of a block diagram leaves the page, overlaps another or crosses the side of its box."""
    figure.canvas.draw()
    words = [text for text in figure.axes[0].texts if text.get_text()]
    extents = [text.get_window_extent() for text in words]
    page = figure.bbox
    for text, one in zip(words, extents, strict=True):
        assert page.x0 <= one.x0, text
        assert page.x1 >= one.x1, text
        assert page.y0 <= one.y0, text
        assert page.y1 >= one.y1, text
    for (text, one), (other, two) in combinations(zip(words, extents, strict=True), 2):
        # An extent holds the line's ascent and descent: a quarter of the height may be shared.
        shared = min(one.y1, two.y1) - max(one.y0, two.y0)
        apart = min(one.x1, two.x1) <= max(one.x0, two.x0)
        assert apart or shared <= 0.25 * min(one.height, two.height), (text.get_text(), other.get_text())
    boxes = [p.get_window_extent() for p in figure.axes[0].patches if isinstance(p, FancyBboxPatch)]
    for text, one in zip(words, extents, strict=True):
        for box in boxes:
            if box.contains(one.x0 + 0.5 * one.width, one.y0 + 0.5 * one.height):
                assert box.x0 <= one.x0, text
                assert box.x1 >= one.x1, text


def assert_on_page(figure: Figure) -> None:
    """No word leaves the page, and no two words of a panel or legend lie on each other."""
    figure.canvas.draw()
    page = figure.bbox
    for axes in figure.axes:
        if not axes.axison:
            continue
        ticks = [*axes.get_xticklabels(), *axes.get_yticklabels()]
        titles = [axes.title, axes._left_title, axes._right_title]  # type: ignore[attr-defined]
        labels = [axes.xaxis.label, axes.yaxis.label, *axes.texts, *titles]
        shown = [text for text in labels if text.get_text() and text.get_visible()]
        for text in shown:
            box = text.get_window_extent()
            assert page.x0 <= box.x0, text
            assert box.x1 <= page.x1, text
            assert page.y0 <= box.y0, text
            assert box.y1 <= page.y1, text
        for one, other in combinations(shown, 2):
            first, second = one.get_window_extent(), other.get_window_extent()
            shared = min(first.y1, second.y1) - max(first.y0, second.y0)
            apart = min(first.x1, second.x1) <= max(first.x0, second.x0)
            # An extent holds the line's ascent and descent: a quarter of the height may be shared.
            assert apart or shared <= 0.25 * min(first.height, second.height), (one, other)
        assert ticks


def assert_legends_beside(figure: Figure) -> None:
    """No legend of the figure lies on a panel."""
    figure.canvas.draw()
    for legend in figure.legends:
        box = legend.get_window_extent()
        for axes in figure.axes:
            panel = axes.get_window_extent()
            assert box.x1 <= panel.x0 or panel.x1 <= box.x0 or box.y1 <= panel.y0 or panel.y1 <= box.y0, (
                axes.get_title(loc="left")
            )
        assert figure.bbox.y0 <= box.y0


def panel(figure: Figure, name: str) -> Axes:
    """Panel with a title at the left."""
    return next(axes for axes in figure.axes if axes.get_title(loc="left") == name)


def line(axes: Axes, label: str) -> np.ndarray:
    """Points (n, 2) of a labelled line."""
    return np.asarray(next(one for one in axes.get_lines() if one.get_label() == label).get_xydata())
