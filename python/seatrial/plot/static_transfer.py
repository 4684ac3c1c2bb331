"""Static transfer of the motor controller: settled signal over desired command, with its limits marked.

Above ``n_max`` the command is clipped; between zero and ``n_min`` it is lifted to ``n_min`` or, with a dead
band, dropped to zero (Taubert et al. 2014, figure 6). Drawn from the model's own chain. Held by
`tests/test_vehicle_figures.py`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.plot.motor_facts import Motor, behind_motor, drives
from seatrial.plot.style import COLUMN_IN, FAINT, SIMULATED, WIDTH_IN, house_style, new_figure, panel_title
from seatrial.plot.symbols import number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial._core import Vehicle

__all__ = ["settled", "static_transfer"]

Array = NDArray[np.float64]

_HEIGHT_IN = 2.7
_REACH, _HIGH, _CLOSE = 1.25, 1.02, 2.6
_POINTS = 81


def static_transfer(vehicle: Vehicle) -> Figure:
    """Figure of the static transfer of every motor that differs and has a static limit.

    Raises
    ------
    ValueError
        No motor has a static limit.
    """
    shown = [(groups, motor) for groups, motor in drives(vehicle) if motor.limited]
    if not shown:
        raise ValueError(f"no motor of {vehicle.name} has a static limit")
    columns = min(len(shown), 2)
    rows = -(-len(shown) // 2)
    with house_style():
        figure = new_figure(_HEIGHT_IN * rows, width_in=COLUMN_IN if columns == 1 else WIDTH_IN)
        grid = figure.subplots(rows, columns, squeeze=False)
        for axes, (groups, motor) in zip(grid.flat, shown, strict=False):
            _panel(axes, vehicle, motor)
            panel_title(axes, ", ".join(groups))
        for axes in list(grid.flat)[len(shown) :]:
            axes.set_axis_off()
    return figure


def settled(vehicle: Vehicle, motor: Motor, command: Array) -> Array:
    """Signal (n,) from neutral to which a motor settles under commands (n,) from neutral."""
    steps = np.repeat(command, 2)
    t = np.arange(len(steps)) * 0.1
    return behind_motor(vehicle, motor, t, steps, rate_limit=False, lag=False)[1::2]


def _panel(axes: Axes, vehicle: Vehicle, motor: Motor) -> None:
    reach = _REACH * motor.largest
    _curve(axes, vehicle, motor, reach)
    letter, unit = motor.letter, motor.printed_unit
    about = f" from {number(motor.neutral, 4)} {unit}" if motor.neutral else ""
    axes.set_xlabel(f"desired ${letter}_d${about}, {unit}")
    axes.set_ylabel(f"actual ${letter}_a$, {unit}")
    for sign, limit in zip((1.0, -1.0), motor.maximum, strict=True):
        if math.isfinite(limit):
            axes.axhline(sign * limit, color=FAINT, linewidth=0.7, linestyle=(0, (4, 2)))
            mark = "+" if sign > 0 else "-"
            axes.annotate(
                f"${letter}_{{max}}^{{{mark}}}$ = {number(sign * limit, 4)}",
                (-sign * reach, sign * limit),
                (2.0 * sign, 2.0 * sign),
                textcoords="offset points",
                ha="left" if sign > 0 else "right",
                va="bottom" if sign > 0 else "top",
                fontsize=7.5,
            )
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-_HIGH * reach, _HIGH * reach)
    axes.locator_params(nbins=5)
    if max(motor.minimum) > 0.0:
        lowest = motor.maximum[1] if math.isfinite(motor.maximum[1]) else reach
        _close_up(axes, vehicle, motor, above=0.5 - 0.5 * lowest / (_HIGH * reach))


def _close_up(axes: Axes, vehicle: Vehicle, motor: Motor, *, above: float) -> None:
    """The neighbourhood of zero, in the free corner below the curve and above the limit astern."""
    foot = min(above + 0.09, 0.3)
    inset = axes.inset_axes((0.66, foot, 0.33, min(0.31, 0.52 - foot)))
    reach = _CLOSE * max(motor.minimum)
    _curve(inset, vehicle, motor, reach)
    inset.set_xlim(-reach, reach)
    inset.set_ylim(-reach, reach)
    ticks = sorted({-motor.minimum[1], 0.0, motor.minimum[0]})
    outer = [x for x in ticks if x]
    inset.set_xticks(outer, [number(x, 4) for x in outer])
    inset.set_yticks(ticks, [number(x, 4) for x in ticks])
    inset.tick_params(labelsize=6, length=2.0, pad=1.5)
    inset.set_facecolor("white")
    for side in inset.spines.values():
        side.set_visible(True)
        side.set_color(FAINT)
    word = "lifted to" if motor.lifts else "dead band to"
    inset.set_title(f"{word} ${motor.letter}_{{min}}$", fontsize=7, pad=2.5)


def _curve(axes: Axes, vehicle: Vehicle, motor: Motor, reach: float) -> None:
    """Transfer on either side of zero, zero itself, and the straight line of an ideal controller."""
    axes.plot([-reach, reach], [-reach, reach], color=FAINT, linewidth=0.7, linestyle=":")
    axes.axhline(0.0, color="#262626", linewidth=0.5)
    axes.axvline(0.0, color="#262626", linewidth=0.5)
    edges = [0.0, 0.0]
    for side, (sign, minimum) in enumerate(zip((1.0, -1.0), motor.minimum, strict=True)):
        jump = minimum * np.array([1.0 - 1e-9, 1.0 + 1e-9]) if minimum > 0.0 else np.zeros(0)
        command = sign * np.unique(np.concatenate([np.linspace(1e-6 * reach, reach, _POINTS), jump]))
        signal = settled(vehicle, motor, command)
        edges[side] = float(signal[0])
        axes.plot(command, signal, color=SIMULATED, linewidth=1.4)
    if edges[0] != edges[1]:
        axes.plot([0.0, 0.0], edges, color=SIMULATED, linewidth=1.0)
    axes.plot(0.0, settled(vehicle, motor, np.zeros(1))[0], "o", color=SIMULATED, markersize=2.6)
