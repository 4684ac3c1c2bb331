"""The actuators of a flight: commands and what became of them, group by group, and the power.

Held by `tests/test_flight_figures.py`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.plot.flight_time import event_lines, events, leg_lines, line
from seatrial.plot.motor_facts import motors
from seatrial.plot.style import CYCLE, MEASURED, RESIDUAL, SIMULATED, house_style, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.flight.flight import Flight
    from seatrial.plot.motor_facts import Motor

__all__ = ["flight_actuators"]

Array = NDArray[np.float64]

_ROW_IN = 1.35
_BAND = "#E4E4E4"
_DASHES = ("-", (0, (4, 1.2)), (0, (1.4, 1.2)), (0, (4, 1.2, 1.2, 1.2)))
_NEAR = 0.6  # a limit is drawn once a command comes so near to it


def flight_actuators(flight: Flight) -> Figure:
    """Figure of commands and signals per group of like actuators, and of the power where it is known."""
    groups = motors(flight.vehicle)
    powered = bool(np.nanmax(np.asarray(flight.power)) > 0.0)  # a vehicle file may tell nothing of it
    rows = len(groups) + int(powered)
    with house_style():
        figure = new_figure(_ROW_IN * rows + 0.75)
        panels = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
        for k, (motor, axes) in enumerate(zip(groups, panels, strict=False)):
            _group(axes, flight, motor, numbers=k == 0)
        if powered:
            _power(panels[-1], flight)
        panels[-1].set_xlabel("time, s")
        panels[-1].set_xlim(flight.t[0], flight.t[-1])
        _legend(figure, flight, groups)
        figure.suptitle(f"{flight.vehicle.name}: {flight.mission.name}", x=0.01, ha="left", fontweight="bold")
    return figure


def _group(axes: Axes, flight: Flight, motor: Motor, *, numbers: bool) -> None:
    """Commands (pale) and signals of like actuators, with the largest and the least."""
    scale, unit = (180.0 / math.pi, "deg") if motor.unit == "rad" else (1.0, motor.printed_unit)
    leg_lines(axes, flight, numbers=numbers)
    if max(motor.minimum) > 0.0:
        band = scale * (motor.neutral + np.array([-motor.minimum[1], motor.minimum[0]]))
        axes.axhspan(*band, color=_BAND, linewidth=0, zorder=0.6)
    reached = 0.0
    for k, name in enumerate(motor.actuators):
        colour, dashes = CYCLE[k % len(CYCLE)], _DASHES[k % len(_DASHES)]
        command, signal = (
            np.where(flight.done, np.nan, scale * np.asarray(log[name]))
            for log in (flight.commands, flight.actuators)
        )
        line(axes, flight.t, command, color=colour, linewidth=2.2, alpha=0.35, zorder=2)
        line(axes, flight.t, signal, color=colour, linewidth=0.9, linestyle=dashes, label=name, zorder=3)
        away = np.nanmax(np.abs(np.stack([command, signal]) - scale * motor.neutral))
        reached = max(reached, float(away) / scale)
    for sign, limit in zip((1.0, -1.0), motor.maximum, strict=True):
        if math.isfinite(limit) and reached > _NEAR * limit:
            at = scale * (motor.neutral + sign * limit)
            axes.axhline(at, color=MEASURED, linewidth=0.8, linestyle=(0, (6, 2)), zorder=1)
    event_lines(axes, flight)
    axes.set_ylabel(f"{'signal' if motor.unit == 'us' else _quantity(motor)}, {unit}")
    axes.locator_params(axis="y", nbins=6)
    axes.set_title(motor.group, loc="left", fontweight="bold", pad=9 if numbers else 4)
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.06 if numbers else 1.0),
        ncols=min(len(motor.actuators), 6),
        fontsize=6.5,
        handlelength=2.0,
        columnspacing=1.2,
        labelspacing=0.2,
        borderaxespad=0.1,
    )


def _quantity(motor: Motor) -> str:
    return {"rpm": "revolutions", "N": "force", "rad": "deflection"}.get(motor.unit, "signal")


def _power(axes: Axes, flight: Flight) -> None:
    leg_lines(axes, flight)
    line(axes, flight.t, np.asarray(flight.power), color=SIMULATED)
    event_lines(axes, flight)
    axes.set_ylabel("power, W")
    axes.set_ylim(bottom=0.0)
    axes.locator_params(axis="y", nbins=6)
    energy = float(flight.energy_wh[-1])
    mean = 3600.0 * energy / max(float(flight.t[-1] - flight.t[0]), 1e-9)
    axes.set_title("power", loc="left", fontweight="bold")
    if math.isfinite(energy):
        axes.set_title(
            f"{energy:.3g} Wh, {mean:.3g} W on average", loc="right", fontsize=7.5, color="#404040"
        )


def _legend(figure: Figure, flight: Flight, groups: list[Motor]) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Line2D | Patch] = [
        Line2D([], [], color=SIMULATED, linewidth=2.2, alpha=0.35, label="command (broad, pale)"),
        Line2D([], [], color=SIMULATED, linewidth=0.9, label="signal of the actuator"),
        Line2D([], [], color=MEASURED, linewidth=0.8, linestyle=(0, (6, 2)), label="largest"),
    ]
    if any(max(motor.minimum) > 0.0 for motor in groups):
        handles.append(Patch(color=_BAND, label="below the least that turns"))
    handles += [
        Line2D([], [], color=RESIDUAL, marker=event.mark, linestyle="none", markersize=4, label=event.words)
        for event in events(flight)
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=6.5, columnspacing=1.4)
