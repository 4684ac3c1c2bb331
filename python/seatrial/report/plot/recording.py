"""A recording before anything is fitted, and a planned trial: channels over time, commands below.

Masked samples are left out of the lines, so that gaps show as gaps; changes of mode are named at the top. A
planned trial has its track from above and what it tells beside them. Held by
``tests/intake/test_import_figure.py`` and ``tests/experiment/test_plan.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import CHANNELS, DEGREE, readable
from seatrial.base.files import file_name, free_name
from seatrial.experiment.forecast import SETTINGS as FORECAST_SETTINGS
from seatrial.experiment.forecast import simulated, uneven
from seatrial.experiment.plan import Plan
from seatrial.report.plot import style as pen
from seatrial.report.plot.flight import line
from seatrial.vehicle.actuators import NOMINAL_V, actuator_groups, largest

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial._core import Run, Vehicle
    from seatrial.experiment.manoeuvre import Manoeuvre
    from seatrial.experiment.plan import Ranked
    from seatrial.intake.imported import Imported
    from seatrial.trial.trial import Trial

_PANELS = (
    ("velocity", "m/s", ("u", "v", "w")),
    ("angular velocity", "deg/s", ("p", "q", "r")),
    ("position", "m", ("x", "y")),
    ("depth z", "m", ("z",)),
    ("roll and pitch", "deg", ("roll", "pitch")),
    ("yaw", "deg", ("yaw",)),
)

_UNITS = {"us": "\N{MICRO SIGN}s", "rpm": "rpm"}


def drawings(result: Imported | Plan) -> dict[str, Callable[[], Figure]]:
    """A figure per imported trial, or per trial of a plan, by name."""
    drawn: dict[str, Callable[[], Figure]] = {}
    if isinstance(result, Plan):
        if (model := result.model) is not None:
            for k in range(1, len(result.sequence) + 1):
                drawn[f"trial_{k}"] = partial(planned_trial, model, result, trial=k)
        return drawn
    units = {name.removeprefix("cmd."): column.unit for name, column in result.columns.items()}
    for each in result.trials:
        name = "log" if len(result.trials) == 1 else f"log_{file_name(each.name)}"
        held = () if each.hold_out_s is None else (each.hold_out_s,)
        drawn[free_name(name, drawn)] = partial(
            recording, each.trial, held_out=held, marks=each.modes, units=units, heading=each.name
        )
    return drawn


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

    Parts (start, stop) in s that judge the result are shaded, those that are used faintly. Marks are times
    in s and names, as changes of mode; `units` are ``us`` or ``rpm`` by actuator where the log states them.
    """
    shown = [(title, unit, [c for c in channels if c in trial.channels]) for title, unit, channels in _PANELS]
    shown = [(title, unit, channels) for title, unit, channels in shown if channels]
    kinds = _command_panels(trial, units or {})
    marks = marks if len(marks) <= 60 else ()  # more lines would cover each other
    with pen.house_style():
        count = len(shown) + len(kinds)
        figure = pen.new_figure(0.95 + 1.05 * max(count, 1))
        grid = figure.subplots(max(count, 1), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (title, unit, channels) in zip(grid, shown, strict=False):
            for k, channel in enumerate(channels):
                line(axes, trial.t, _values(trial, channel), color=pen.CYCLE[k], linewidth=0.8, label=channel)
            _finish(axes, title, unit, len(channels) > 1)
        for axes, (title, unit, values) in zip(grid[len(shown) :], kinds, strict=True):
            for k, (name, y) in enumerate(values.items()):
                look: pen.Style = {"color": pen.CYCLE[k % len(pen.CYCLE)], "drawstyle": "steps-post"}
                look["linestyle"] = "-" if k < len(pen.CYCLE) else (0, (4, 1.5))
                line(axes, trial.t, y, linewidth=0.7, label=name, **look)
            _finish(axes, title, unit, 1 < len(values) <= 2 * len(pen.CYCLE))
        named = len(marks) <= 8  # more names would cover each other
        for axes in grid:
            _shade(axes, windows, pen.HULL)
            _shade(axes, held_out, pen.SHADE)
            for at, _ in marks:
                axes.axvline(at, color=pen.FAINT, linewidth=0.7, linestyle=(0, (3, 2)), zorder=1)
        if named:
            _names(grid[0], marks, trial)
        grid[-1].set_xlabel("time, s")
        grid[-1].set_xlim(trial.t[0], trial.t[-1])
        figure.align_ylabels(list(grid))
        _legend(figure, held_out, windows, marks)
        pen.heading(figure, f"Recording {heading}" if heading else "", fontsize=9)
    return figure


def _values(trial: Trial, channel: str) -> Array:
    k = CHANNELS.index(channel)
    y = np.where(trial.valid[:, k], trial.observed[:, k], np.nan)
    known = np.isfinite(y)
    if channel == "yaw":
        y[known] = np.unwrap(y[known])
    return readable(channel)[0] * y


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
    pen.panel_title(axes, title)
    axes.set_ylabel(unit)
    if several:
        handles, labels = axes.get_legend_handles_labels()
        if len(labels) > 3:
            prefix = pen.joined(labels).partition(",")[0].rpartition("_")[0]
            labels = [label.removeprefix(f"{prefix}_") for label in labels]
        place: pen.Style = {**pen.ABOVE, "bbox_to_anchor": (1.0, 0.97), "borderaxespad": 0.0}
        axes.legend(handles, labels, ncols=len(labels), handlelength=1.2, columnspacing=0.8, **place)


def _shade(axes: Axes, parts: Sequence[tuple[float, float]], colour: str) -> None:
    for start, stop in parts:
        axes.axvspan(start, stop, color=colour, linewidth=0.0, zorder=0)


def _names(axes: Axes, marks: Sequence[tuple[float, str]], trial: Trial) -> None:
    """Names of the marks above the curves of the upper panel, those too near the one before left out."""
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.14 * (high - low))  # room for a line of names
    room = 0.06 * float(trial.t[-1] - trial.t[0])
    last = -np.inf
    for at, name in marks:
        if at - last < room or at > trial.t[-1]:
            continue
        last = at
        small: pen.Style = {"fontsize": 6, "color": pen.REMARK, "va": "top", "textcoords": "offset points"}
        axes.annotate(name, (at, 1.0), (2.0, -1.0), xycoords=("data", "axes fraction"), **small)


def _legend(
    figure: Figure,
    held_out: Sequence[tuple[float, float]],
    windows: Sequence[tuple[float, float]],
    marks: Sequence[tuple[float, str]],
) -> None:
    handles: list[Artist] = [pen.field("proposed to be held out", pen.SHADE)] if held_out else []
    handles += [pen.field("proposed to be used", pen.HULL)] if windows else []
    handles += (
        [pen.stroke("change of mode", pen.FAINT, linewidth=0.9, linestyle=(0, (3, 2)))] if marks else []
    )
    if handles:
        pen.legend_below(figure, handles)


def planned_trial(vehicle: Vehicle, plan: Plan, *, trial: int = 1, voltage_v: float = NOMINAL_V) -> Figure:
    """Figure of one trial of a plan, counted from 1; tables of thrust are read at `voltage_v`, V."""
    ranked = plan.sequence[trial - 1]
    manoeuvre = ranked.manoeuvre
    run = simulated(vehicle, manoeuvre, voltage_v=voltage_v)
    other = simulated(
        uneven(vehicle), manoeuvre, voltage_v=voltage_v, tilt_deg=FORECAST_SETTINGS.start_tilt_deg
    )
    with pen.house_style():
        figure = pen.new_figure(max(4.6, 1.3 + 0.135 * len(ranked.gains)))
        grid = figure.add_gridspec(3, 2, width_ratios=[1.35, 1.0], height_ratios=[1.0, 1.0, 1.3])
        commands = figure.add_subplot(grid[0, 0])
        motion = figure.add_subplot(grid[1, 0], sharex=commands)
        track = figure.add_subplot(grid[2, 0])
        _commands(commands, vehicle, manoeuvre)
        _motion(motion, run, ranked)
        _track(track, run, other)
        _gains(figure.add_subplot(grid[:, 1]), ranked)
        repeats = f", {ranked.repeats} times" if ranked.repeats > 1 else ""
        title = f"Trial {trial}: {manoeuvre.name}, {manoeuvre.duration_s:.0f} s{repeats}"
        pen.heading(figure, title, fontsize=9)
    return figure


def _commands(axes: Axes, vehicle: Vehicle, manoeuvre: Manoeuvre) -> None:
    """Commands, one line for actuators that do the same; shares of the largest where units differ."""
    facts = vehicle.actuator_info()
    units = {str(facts_of["unit"]) for facts_of in facts.values()}
    groups = {tuple(members): group for group, members in actuator_groups(vehicle).items()}

    def shown(name: str) -> Array:
        values = np.asarray(manoeuvre.commands[name], dtype=float)
        if len(units) == 1:
            return values
        away = values - float(facts[name]["neutral"])
        sense = -1.0 if facts[name]["reversed"] else 1.0
        above, below = (max(largest(facts[name], side), 1e-12) for side in (sense, -sense))
        return 100.0 * away / np.where(away < 0.0, below, above)

    alike: dict[tuple[str, bytes], list[str]] = {}
    for name, values in manoeuvre.commands.items():
        alike.setdefault((str(facts[name]["unit"]), np.asarray(values).tobytes()), []).append(name)
    for k, names in enumerate(alike.values()):
        label = groups.get(tuple(names), ", ".join(names))
        look: pen.Style = {
            "color": pen.CYCLE[k % len(pen.CYCLE)],
            "linestyle": "-" if k < len(pen.CYCLE) else "--",
        }
        axes.step(manoeuvre.t, shown(names[0]), where="post", linewidth=0.9, label=label, **look)
    axes.set_ylabel(f"command, {min(units)}" if len(units) == 1 else "% of the largest")
    axes.set_xlim(manoeuvre.t[0], manoeuvre.t[-1])
    pen.panel_title(axes, "Commands")
    _panel_legend(axes, *axes.get_legend_handles_labels(), columns=4)


def _motion(axes: Axes, run: Run, ranked: Ranked) -> None:
    """Attitude, and on the right the depth, downwards."""
    euler = np.rad2deg(run.euler)
    axes.plot(run.t, euler[:, 0], color=pen.SECOND, label="roll")
    axes.plot(run.t, euler[:, 1], color=pen.THIRD, label="pitch")
    axes.set_ylabel("roll, pitch, deg")
    axes.set_xlabel("time, s")
    below: Any = axes.twinx()
    depth = ranked.forecast.start_depth_m + np.asarray(run.position)[:, 2]
    below.plot(run.t, depth, color=pen.SIMULATED, label="depth")
    below.set_ylabel("depth, m")
    below.set_ylim(1.15 * max(float(depth.max()), 1.0), 0.0)
    below.spines["right"].set_visible(True)
    below.grid(visible=False)
    (lines, names), (deeper, deep) = axes.get_legend_handles_labels(), below.get_legend_handles_labels()
    _panel_legend(axes, lines + deeper, names + deep)
    pen.panel_title(axes, "Attitude and depth")


def _track(axes: Axes, run: Run, other: Run) -> None:
    """Track from above, and that of the uneven vehicle."""
    for flown, colour, label in (
        (other, pen.FAINT, f"thrust {100 * FORECAST_SETTINGS.uneven:.0f} % uneven"),
        (run, pen.SIMULATED, "as planned"),
    ):
        place = np.asarray(flown.position)
        axes.plot(place[:, 1], place[:, 0], color=colour, label=label)
    axes.plot(0.0, 0.0, "o", color=pen.INK, markersize=3.2)
    axes.plot([-1.0, 1.0], [-1.0, 1.0], alpha=0.0)  # no less than 1 m to either side of the start
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("across the course at the start, m")
    axes.set_ylabel("along it, m")
    _panel_legend(axes, *axes.get_legend_handles_labels())
    pen.panel_title(axes, "Track")


def _gains(axes: Axes, ranked: Ranked) -> None:
    """Standard deviations before and after, the greatest gain on top."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    rows = np.arange(len(ranked.gains))[::-1]
    before = np.array([100.0 * change.before / change.whole for change in ranked.gains])
    after = np.array([100.0 * change.after / change.whole for change in ranked.gains])
    axes.hlines(rows, after, before, color=pen.FAINT, linewidth=0.8)
    axes.plot(before, rows, "o", color=pen.FOURTH, markersize=3.2, label="before")
    axes.plot(after, rows, "o", color=pen.SIMULATED, markersize=3.2, label="after this trial")
    axes.set_xscale("log")
    narrow = before.max() < 100.0 * after.min()
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if narrow else (1.0,)))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_yticks(rows, [change.name + ("" if change.of_value else " *") for change in ranked.gains])
    axes.set_ylim(-0.7, len(rows) - 0.3)
    zero = (
        "" if all(change.of_value for change in ranked.gains) else " (* about zero: of a tenth of its bounds)"
    )
    axes.set_xlabel(f"standard deviation, % of the value{zero}")
    _panel_legend(axes, *axes.get_legend_handles_labels())
    pen.panel_title(axes, "Coefficients")


def _panel_legend(axes: Axes, handles: Sequence[Any], labels: Sequence[str], *, columns: int = 3) -> None:
    """Legend in the line of the panel's title, at its right end, in rows that leave the title its room."""
    # 42 characters beside the title, of which a line takes four.
    columns = max(1, min(columns, 42 // (max(map(len, labels)) + 4)))
    size = 6 if len(labels) <= columns else 5
    tight: pen.Style = {"handlelength": 1.2, "columnspacing": 1.0, "labelspacing": 0.2, "borderaxespad": 0.1}
    axes.legend(handles, labels, ncols=min(len(labels), columns), fontsize=size, **tight, **pen.ABOVE)
