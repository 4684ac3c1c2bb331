"""The control loops of a flight: what was desired and done, what was demanded and reached, and the modes.

Held by `tests/test_flight_figures.py`.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial._core import autopilot_names
from seatrial.plot.flight_time import event_lines, leg_lines, line, mode_strip, shade, strip_rows
from seatrial.plot.style import RESIDUAL, SECOND, SIMULATED, house_style, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.flight.flight import Flight

__all__ = ["Shown", "flight_loops", "saturated", "shown_loops"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_ROW_IN, _STRIP_IN = 1.02, 0.135
_SHORT_OF_LIMIT, _AT_LIMIT = 0.01, 0.999
_SATURATED = "#F3C9B5"
_FORCES = ("X, N", "Y, N", "Z, N", "K, N m", "M, N m", "N, N m")
_ANGLES = (0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0, 90.0, 180.0, 360.0)
_NAMES = ("speed", "sway speed", "depth", "roll", "pitch", "heading")


@dataclass(frozen=True, eq=False)
class Shown:
    """A loop as it is drawn: index in the order X Y Z K M N, label with unit, desired and done (n,)."""

    index: int
    label: str
    desired: Array
    done: Array


def shown_loops(flight: Flight) -> list[Shown]:
    """Loops that were at work at any time, and the depth, which a pitch loop controls where heave does not.

    Desired values are blank where their loop is not at work; of a heading both are without jumps.
    """
    active, wanted = flight.active, flight.desired
    by_pitch = np.array([one["depth_by"] == "pitch" for one in flight.autopilot.modes])[flight.mode]
    yaw = np.unwrap(flight.euler[:, 2])
    off = (wanted["heading"] - yaw + np.pi) % (2.0 * np.pi) - np.pi
    degrees = 180.0 / np.pi
    signals = (
        ("u, m/s", wanted["speed"], flight.nu[:, 0]),
        ("v, m/s", wanted["lateral"], flight.nu[:, 1]),
        ("depth, m", wanted["depth"], flight.position[:, 2]),
        ("roll, deg", np.zeros(len(flight.t)), degrees * flight.euler[:, 0]),
        ("pitch, deg", degrees * np.where(by_pitch, wanted["pitch"], 0.0), degrees * flight.euler[:, 1]),
        ("heading, deg", degrees * (yaw + off), degrees * yaw),
    )
    found = []
    for i in (0, 1, 5, 4, 2, 3):
        label, desired, done = signals[i]
        rows = active[:, i] | (by_pitch & active[:, 4]) if i == 2 else active[:, i]
        if rows.any():
            found.append(Shown(i, label, np.where(rows & ~flight.done, desired, np.nan), done))
    return found


def saturated(flight: Flight, index: int) -> Mask:
    """Rows in which the demand of a loop stands at its limit, or is reached in part only, (n,)."""
    name = autopilot_names()["loops"][index]
    table = tomllib.loads(flight.autopilot.to_toml()).get("loops", {}).get(name, {})
    demand, reached = flight.demanded[:, index], flight.achieved[:, index]
    limit = float(table.get("tau_max", np.nanmax(np.abs(demand))))
    limited = np.abs(demand) >= _AT_LIMIT * limit
    short = np.abs(demand - reached) > _SHORT_OF_LIMIT * limit
    return np.asarray(flight.active[:, index] & (limited | short) & (limit > 0.0))


def flight_loops(flight: Flight) -> Figure:
    """Figure of the loops at work: desired and done, beside it demanded and reached, below it the modes."""
    rows = shown_loops(flight)
    strip = _STRIP_IN * len(strip_rows(flight)) + 0.12
    with house_style():
        figure = new_figure(_ROW_IN * len(rows) + strip + 1.0)
        heights = [_ROW_IN] * len(rows) + [strip]
        panels = figure.subplots(
            len(rows) + 1, 2, sharex=True, width_ratios=(1.25, 1.0), height_ratios=heights, squeeze=False
        )
        for k, (shown, (left, right)) in enumerate(zip(rows, panels, strict=False)):
            _followed(left, flight, shown, numbers=k == 0)
            _demand(right, flight, shown.index, numbers=k == 0)
        for axes in panels[-1]:
            mode_strip(axes, flight)
        panels[-1, 1].tick_params(labelleft=False)
        panels[0, 0].set_xlim(flight.t[0], flight.t[-1])
        for column in panels.T:
            figure.align_ylabels(list(column[:-1]))
        _legend(figure, flight)
        figure.suptitle(f"{flight.vehicle.name}: {flight.mission.name}", x=0.01, ha="left", fontweight="bold")
    return figure


def _followed(axes: Axes, flight: Flight, shown: Shown, *, numbers: bool) -> None:
    from matplotlib.ticker import MultipleLocator

    leg_lines(axes, flight, numbers=numbers, room=0.045)
    line(axes, flight.t, shown.desired, color=SECOND, linewidth=1.9)
    line(axes, flight.t, shown.done, color=SIMULATED, linewidth=1.0)
    event_lines(axes, flight)
    axes.set_ylabel(shown.label)
    axes.set_title(_NAMES[shown.index], loc="left", fontweight="bold", pad=9 if numbers else 4)
    if shown.index == 2:
        axes.invert_yaxis()
    if shown.index == 5:
        span = abs(float(np.subtract(*axes.get_ylim())))
        axes.yaxis.set_major_locator(MultipleLocator(next((x for x in _ANGLES if span <= 4 * x), 720.0)))
    else:
        axes.locator_params(axis="y", nbins=5)
    _least(axes, 0.2 if shown.index < 3 else 2.0)


def _demand(axes: Axes, flight: Flight, index: int, *, numbers: bool) -> None:
    """Demand and what the allocation reached of it; shaded where it is saturated."""
    rows = flight.active[:, index] & ~flight.done
    if not rows.any():
        axes.set_axis_off()
        axes.text(0.5, 0.5, "depth by pitch: no force demanded", ha="center", transform=axes.transAxes)
        return
    short = saturated(flight, index) & rows
    shade(axes, flight.t, short, _SATURATED)
    leg_lines(axes, flight)
    line(axes, flight.t, np.where(rows, flight.demanded[:, index], np.nan), color=SECOND, linewidth=1.9)
    line(axes, flight.t, np.where(rows, flight.achieved[:, index], np.nan), color=SIMULATED, linewidth=1.0)
    event_lines(axes, flight)
    axes.set_ylabel(_FORCES[index])
    share = 100.0 * float(short.sum()) / max(int(rows.sum()), 1)
    axes.set_title(
        f"saturated {share:.0f} % of its time",
        loc="right",
        fontsize=7,
        color="#404040",
        pad=9 if numbers else 4,
    )
    axes.locator_params(axis="y", nbins=5)
    _least(axes, 1.0)


def _least(axes: Axes, span: float) -> None:
    """Show no less than a span, so that rounding does not fill a panel."""
    low, high = sorted(axes.get_ylim())
    if high - low < span:
        middle = 0.5 * (low + high)
        ends = (middle - 0.5 * span, middle + 0.5 * span)
        axes.set_ylim(*(ends[::-1] if axes.yaxis_inverted() else ends))


def _legend(figure: Figure, flight: Flight) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    from seatrial.plot.flight_time import events

    handles = [
        Line2D([], [], color=SECOND, linewidth=1.9, label="desired, demanded"),
        Line2D([], [], color=SIMULATED, linewidth=1.0, label="done, reached by the allocation"),
        Patch(color=_SATURATED, label="saturated"),
    ]
    handles += [
        Line2D([], [], color=RESIDUAL, marker=event.mark, linestyle="none", markersize=4, label=event.words)
        for event in events(flight)
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=6.5, columnspacing=1.4)
