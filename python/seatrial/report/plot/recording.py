"""A recording before anything is fitted: all channels over time, commands below, held-out parts shaded.

Masked samples are left out of the lines, so that gaps show as gaps. Changes of mode are dashed and named at
the top. Held by ``tests/intake/test_import_figure.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import CHANNELS, DEGREE
from seatrial.report.plot.style import CYCLE, FAINT, HULL, SHADE, house_style, joined, new_figure, panel_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.trial.trial import Trial

_PANELS = (
    ("velocity", "m/s", ("u", "v", "w")),
    ("angular velocity", "deg/s", ("p", "q", "r")),
    ("position", "m", ("x", "y")),
    ("depth z", "m", ("z",)),
    ("roll and pitch", "deg", ("roll", "pitch")),
    ("yaw", "deg", ("yaw",)),
)

_DEGREES = ("p", "q", "r", "roll", "pitch", "yaw")

_PANEL_IN, _EDGES_IN = 1.05, 0.95  # layout, inches

_MOST_POINTS = 4000  # per line: more are thinner than a pixel

_HEADROOM = 0.14  # above the curves, as a share of their range: a line of names

_MOST_NAMED, _MOST_MARKED = 8, 60  # marks with names, and with lines; more would cover each other

_UNITS = {"us": "\N{MICRO SIGN}s", "rpm": "rpm"}


def recording(
    trial: Trial,
    *,
    held_out: Sequence[tuple[float, float]] = (),
    windows: Sequence[tuple[float, float]] = (),
    marks: Sequence[tuple[float, str]] = (),
    units: Mapping[str, str] | None = None,
    heading: str = "",
) -> Figure:
    """Figure of the channels and commands of a trial over time.

    Parameters
    ----------
    trial
    held_out
        Parts (start, stop) in s that judge the result, shaded.
    windows
        Parts (start, stop) in s that are used, shaded faintly.
    marks
        Times in s and names, as changes of mode; very many are left out.
    units
        Unit by actuator, ``us`` or ``rpm``, where the log states it; by size otherwise.
    heading
        Title of the whole figure.
    """
    shown = [(title, unit, [c for c in channels if c in trial.channels]) for title, unit, channels in _PANELS]
    shown = [(title, unit, channels) for title, unit, channels in shown if channels]
    kinds = _command_panels(trial, units or {})
    marks = marks if len(marks) <= _MOST_MARKED else ()
    with house_style():
        count = len(shown) + len(kinds)
        figure = new_figure(_EDGES_IN + _PANEL_IN * max(count, 1))
        grid = figure.subplots(max(count, 1), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (title, unit, channels) in zip(grid, shown, strict=False):
            for k, channel in enumerate(channels):
                t, y = _thinned(trial.t, _values(trial, channel))
                axes.plot(t, y, color=CYCLE[k], linewidth=0.8, label=channel)
            _finish(axes, title, unit, len(channels) > 1)
        for axes, (title, unit, values) in zip(grid[len(shown) :], kinds, strict=True):
            for k, (name, y) in enumerate(values.items()):
                dashes = "-" if k < len(CYCLE) else (0, (4, 1.5))
                t, thin = _thinned(trial.t, y)
                axes.plot(
                    t,
                    thin,
                    color=CYCLE[k % len(CYCLE)],
                    linewidth=0.7,
                    linestyle=dashes,
                    label=name,
                    drawstyle="steps-post",
                )
            _finish(axes, title, unit, 1 < len(values) <= 2 * len(CYCLE))
        named = len(marks) <= _MOST_NAMED
        for axes in grid:
            _shade(axes, windows, HULL)
            _shade(axes, held_out, SHADE)
            for at, _ in marks:
                axes.axvline(at, color=FAINT, linewidth=0.7, linestyle=(0, (3, 2)), zorder=1)
        if named:
            _names(grid[0], marks, trial)
        grid[-1].set_xlabel("time, s")
        grid[-1].set_xlim(trial.t[0], trial.t[-1])
        figure.align_ylabels(list(grid))
        _legend(figure, held_out, windows, marks)
        if heading:
            figure.suptitle(f"Recording {heading}", x=0.01, ha="left", fontweight="bold", fontsize=9)
    return figure


def _values(trial: Trial, channel: str) -> Array:
    k = CHANNELS.index(channel)
    y = np.where(trial.valid[:, k], trial.observed[:, k], np.nan)
    known = np.isfinite(y)
    if channel == "yaw":
        y[known] = np.unwrap(y[known])
    return y / DEGREE if channel in _DEGREES else y


def _thinned(t: Array, y: Array) -> tuple[Array, Array]:
    """Least and most of each stretch of samples, so that a long record keeps its spikes."""
    if len(t) <= _MOST_POINTS:
        return t, y
    width = -(-len(t) // (_MOST_POINTS // 2))
    count = len(t) // width
    parts = y[: count * width].reshape(count, width)
    lost = np.logical_and.reduce(np.isnan(parts), axis=1)
    filled = np.where(lost[:, None], 0.0, parts)
    pair = np.stack([np.nanmin(filled, axis=1), np.nanmax(filled, axis=1)], axis=1)
    pair[lost] = np.nan
    return np.repeat(t[: count * width : width], 2), pair.reshape(-1)


def _command_panels(trial: Trial, units: Mapping[str, str]) -> list[tuple[str, str, dict[str, Array]]]:
    """Commands by unit: pulse widths, revolutions and angles have a panel each; then wrench and voltage."""
    stated = {name: _UNITS[units[name]] for name in trial.commands if units.get(name) in _UNITS}
    other = {name: y for name, y in trial.commands.items() if name not in stated}
    small = {name: y for name, y in other.items() if np.nanmax(np.abs(y), initial=0.0) < 10.0}
    large = {name: y for name, y in other.items() if name not in small}
    guess = _UNITS["us" if all(y.min() > 700.0 for y in large.values()) else "rpm"]
    panels: list[tuple[str, str, dict[str, Array]]] = []
    for unit in _UNITS.values():
        shown = {
            n: y for n, y in trial.commands.items() if stated.get(n, guess if n in large else "") == unit
        }
        if shown:
            panels.append(("commands", unit, shown))
    if small:
        panels.append(("commands", "deg", {name: y / DEGREE for name, y in small.items()}))
    if trial.tau is not None:
        for title, unit, first in (("force", "N", 0), ("moment", "N m", 3)):
            parts = {"XYZKMN"[k]: trial.tau[:, k] for k in range(first, first + 3) if trial.tau[:, k].any()}
            if parts:
                panels.append((title, unit, parts))
    if trial.voltage_v is not None:
        panels.append(("supply", "V", {"voltage": trial.voltage_v}))
    return panels


def _finish(axes: Axes, title: str, unit: str, several: bool) -> None:
    panel_title(axes, title)
    axes.set_ylabel(unit)
    if several:
        handles, labels = axes.get_legend_handles_labels()
        if len(labels) > 3:
            prefix = joined(labels).partition(",")[0].rpartition("_")[0]
            labels = [label.removeprefix(f"{prefix}_") for label in labels]
        axes.legend(
            handles,
            labels,
            loc="lower right",
            bbox_to_anchor=(1.0, 0.97),
            ncols=len(labels),
            handlelength=1.2,
            columnspacing=0.8,
            borderaxespad=0.0,
        )


def _shade(axes: Axes, parts: Sequence[tuple[float, float]], colour: str) -> None:
    for start, stop in parts:
        axes.axvspan(start, stop, color=colour, linewidth=0.0, zorder=0)


def _names(axes: Axes, marks: Sequence[tuple[float, str]], trial: Trial) -> None:
    """Names of the marks above the curves of the upper panel, those too near the one before left out."""
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + _HEADROOM * (high - low))
    room = 0.06 * float(trial.t[-1] - trial.t[0])
    last = -np.inf
    for at, name in marks:
        if at - last < room or at > trial.t[-1]:
            continue
        last = at
        axes.annotate(
            name,
            (at, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(2.0, -1.0),
            textcoords="offset points",
            fontsize=6,
            color="#404040",
            va="top",
        )


def _legend(
    figure: Figure,
    held_out: Sequence[tuple[float, float]],
    windows: Sequence[tuple[float, float]],
    marks: Sequence[tuple[float, str]],
) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Line2D | Patch] = []
    if held_out:
        handles.append(Patch(color=SHADE, label="proposed to be held out"))
    if windows:
        handles.append(Patch(color=HULL, label="proposed to be used"))
    if marks:
        handles.append(
            Line2D([], [], color=FAINT, linewidth=0.9, linestyle=(0, (3, 2)), label="change of mode")
        )
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
