"""Dynamic limiting of the revolutions: ramps of increase and decrease after steps of the command.

``n_acc`` holds while the magnitude grows, ``n_dec`` while it shrinks; a reversal first brakes to zero
(Taubert et al. 2014, figure 7). Behind the ramps stand dead time and lag. Drawn from the model's own chain.
Held by `tests/test_vehicle_figures.py`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.plot.motor_facts import Motor, behind_motor, drives
from seatrial.plot.style import (
    COLUMN_IN,
    MEASURED,
    RESIDUAL,
    SIMULATED,
    WIDTH_IN,
    house_style,
    new_figure,
    panel_title,
)
from seatrial.plot.symbols import number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial._core import Vehicle

__all__ = ["rate_limiting"]

Array = NDArray[np.float64]

_HEIGHT_IN = 2.75
_SHARE = 0.75  # of the largest command
_SAMPLES = 1200


def rate_limiting(vehicle: Vehicle) -> Figure:
    """Figure of how every motor that differs follows a step, a reversal and a stop.

    Raises
    ------
    ValueError
        Every motor follows its command at once.
    """
    shown = [(groups, motor) for groups, motor in drives(vehicle) if motor.delayed]
    if not shown:
        raise ValueError(f"every motor of {vehicle.name} follows its command at once")
    columns = min(len(shown), 2)
    rows = -(-len(shown) // 2)
    with house_style():
        figure = new_figure(0.25 + _HEIGHT_IN * rows, width_in=COLUMN_IN if columns == 1 else WIDTH_IN)
        grid = figure.subplots(rows, columns, squeeze=False)
        for axes, (groups, motor) in zip(grid.flat, shown, strict=False):
            _panel(axes, vehicle, motor)
            panel_title(axes, ", ".join(groups))
        for axes in list(grid.flat)[len(shown) :]:
            axes.set_axis_off()
        figure.legend(
            *figure.axes[0].get_legend_handles_labels(),
            loc="outside lower center",
            ncols=3,
            columnspacing=1.2,
            handlelength=1.8,
        )
    return figure


def _panel(axes: Axes, vehicle: Vehicle, motor: Motor) -> None:
    top = _SHARE * motor.largest
    low = min(top, _SHARE * motor.maximum[1])
    t, command, changes = _steps(motor, top, low)
    letter, unit = motor.letter, motor.printed_unit
    axes.step(t, command, where="post", color=MEASURED, linewidth=0.9, linestyle=(0, (4, 2)), label="desired")
    if math.isfinite(min(motor.n_acc, motor.n_dec)):
        limited = behind_motor(vehicle, motor, t, command, lag=False)
        axes.plot(t, limited, color=RESIDUAL, linewidth=1.0, linestyle=(0, (1, 1)), label="limited")
        _rates(axes, motor, top, low, changes)
    if max(motor.T_1, motor.T_t) > 0.0:
        axes.plot(t, behind_motor(vehicle, motor, t, command), color=SIMULATED, linewidth=1.4, label="actual")
    axes.axhline(0.0, color="#262626", linewidth=0.5)
    axes.set_xlim(0.0, t[-1])
    axes.set_ylim(-1.15 * top, 1.15 * top)
    axes.locator_params(nbins=6)
    axes.set_xlabel("time, s")
    axes.set_ylabel(f"${letter}$, {unit}")


def _steps(motor: Motor, top: float, low: float) -> tuple[Array, Array, list[float]]:
    """Times, the command over them, and when it changes: ahead, reversed, stopped."""
    ramp = sum(top / rate for rate in (motor.n_acc, motor.n_dec) if math.isfinite(rate))
    hold = 2.3 * ramp + 5.0 * motor.T_1 + 2.0 * motor.T_t
    changes = [0.2 * hold, 1.2 * hold, 2.3 * hold]
    t = np.linspace(0.0, 3.0 * hold, _SAMPLES)
    command = np.select([t < changes[0], t < changes[1], t < changes[2]], [0.0, top, -low], 0.0)
    return t, np.asarray(command), changes


def _rates(axes: Axes, motor: Motor, top: float, low: float, changes: list[float]) -> None:
    """Name and number of the rate beside each ramp."""
    up, down = top / motor.n_acc, top / motor.n_dec
    behind, unit = motor.T_t + 1.2 * motor.T_1, motor.printed_unit
    for begin, height, name, rate in (
        (changes[0] + 0.5 * up, 0.5 * top, "acc", motor.n_acc),
        (changes[1] + 0.5 * down, 0.5 * top, "dec", motor.n_dec),
        (changes[1] + down + 0.5 * low / motor.n_acc, -0.5 * low, "acc", motor.n_acc),
    ):
        if height == 0.0:  # a motor that does not run astern
            continue
        axes.annotate(
            f"${motor.letter}_{{{name}}}$ = {number(rate)}{'' if unit in ('', '1') else f' {unit}'}/s",
            (begin + behind, height),
            (3, 0),
            textcoords="offset points",
            fontsize=7,
            va="center",
        )
