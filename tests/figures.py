"""Vehicles to be drawn, the words of a figure, and whether a block diagram can be printed."""

from __future__ import annotations

from itertools import combinations

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
