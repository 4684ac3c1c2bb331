"""A planned trial on one page: commands, depth and attitude, track from above, what it tells."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.experiment.forecast import START_TILT_DEG, UNEVEN, simulated, uneven
from seatrial.report.plot.style import (
    CYCLE,
    FAINT,
    FOURTH,
    SECOND,
    SIMULATED,
    THIRD,
    house_style,
    new_figure,
    panel_title,
)
from seatrial.vehicle.actuators import NOMINAL_V, actuator_groups, largest

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial._core import Run, Vehicle
    from seatrial.experiment.manoeuvre import Manoeuvre
    from seatrial.experiment.plan_result import Plan, Ranked

_ROW_IN = 0.135  # layout, inches

_TITLE_ROW, _HANDLE = 42, 4  # characters beside a panel's title, and those that a line of a legend takes

_DOT = 3.2  # size of a marker, points

_LEAST_M = 1.0  # the track's panel shows no less to either side of the start


def planned_trial(vehicle: Vehicle, plan: Plan, *, trial: int = 1, voltage_v: float = NOMINAL_V) -> Figure:
    """Figure of one trial of a plan's sequence.

    Parameters
    ----------
    vehicle : Vehicle
        The one that was planned for.
    plan : Plan
    trial : int
        Place in the sequence, from 1 on.
    voltage_v : float
        Supply voltage at which tables of thrust are read, V.
    """
    ranked = plan.sequence[trial - 1]
    manoeuvre = ranked.manoeuvre
    run = simulated(vehicle, manoeuvre, voltage_v=voltage_v)
    other = simulated(uneven(vehicle), manoeuvre, voltage_v=voltage_v, tilt_deg=START_TILT_DEG)
    with house_style():
        figure = new_figure(max(4.6, 1.3 + _ROW_IN * len(ranked.gains)))
        grid = figure.add_gridspec(3, 2, width_ratios=[1.35, 1.0], height_ratios=[1.0, 1.0, 1.3])
        commands = figure.add_subplot(grid[0, 0])
        motion = figure.add_subplot(grid[1, 0], sharex=commands)
        track = figure.add_subplot(grid[2, 0])
        _commands(commands, vehicle, manoeuvre)
        _motion(motion, run, ranked)
        _track(track, run, other)
        _told(figure.add_subplot(grid[:, 1]), ranked)
        repeats = f", {ranked.repeats} times" if ranked.repeats > 1 else ""
        figure.suptitle(
            f"Trial {trial}: {manoeuvre.name}, {manoeuvre.duration_s:.0f} s{repeats}",
            x=0.01,
            ha="left",
            fontweight="bold",
            fontsize=9,
        )
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
        axes.step(
            manoeuvre.t,
            shown(names[0]),
            where="post",
            color=CYCLE[k % len(CYCLE)],
            linestyle="-" if k < len(CYCLE) else "--",
            linewidth=0.9,
            label=groups.get(tuple(names), ", ".join(names)),
        )
    axes.set_ylabel(f"command, {min(units)}" if len(units) == 1 else "% of the largest")
    axes.set_xlim(manoeuvre.t[0], manoeuvre.t[-1])
    panel_title(axes, "Commands")
    _legend(axes, *axes.get_legend_handles_labels(), columns=4)


def _motion(axes: Axes, run: Run, ranked: Ranked) -> None:
    """Attitude, and on the right the depth, downwards."""
    euler = np.rad2deg(run.euler)
    axes.plot(run.t, euler[:, 0], color=SECOND, label="roll")
    axes.plot(run.t, euler[:, 1], color=THIRD, label="pitch")
    axes.set_ylabel("roll, pitch, deg")
    axes.set_xlabel("time, s")
    below: Any = axes.twinx()
    depth = ranked.forecast.start_depth_m + np.asarray(run.position)[:, 2]
    below.plot(run.t, depth, color=SIMULATED, label="depth")
    below.set_ylabel("depth, m")
    below.set_ylim(1.15 * max(float(depth.max()), 1.0), 0.0)
    below.spines["right"].set_visible(True)
    below.grid(visible=False)
    (lines, names), (deeper, deep) = axes.get_legend_handles_labels(), below.get_legend_handles_labels()
    _legend(axes, lines + deeper, names + deep)
    panel_title(axes, "Attitude and depth")


def _track(axes: Axes, run: Run, other: Run) -> None:
    """Track from above, and that of the uneven vehicle."""
    for flown, colour, label in (
        (other, FAINT, f"thrust {100 * UNEVEN:.0f} % uneven"),
        (run, SIMULATED, "as planned"),
    ):
        place = np.asarray(flown.position)
        axes.plot(place[:, 1], place[:, 0], color=colour, label=label)
    axes.plot(0.0, 0.0, "o", color="#262626", markersize=_DOT)
    axes.plot([-_LEAST_M, _LEAST_M], [-_LEAST_M, _LEAST_M], alpha=0.0)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("across the course at the start, m")
    axes.set_ylabel("along it, m")
    _legend(axes, *axes.get_legend_handles_labels())
    panel_title(axes, "Track")


def _told(axes: Axes, ranked: Ranked) -> None:
    """Standard deviations before and after, the greatest gain on top."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    rows = np.arange(len(ranked.gains))[::-1]
    before = np.array([100.0 * change.before / change.whole for change in ranked.gains])
    after = np.array([100.0 * change.after / change.whole for change in ranked.gains])
    axes.hlines(rows, after, before, color=FAINT, linewidth=0.8)
    axes.plot(before, rows, "o", color=FOURTH, markersize=_DOT, label="before")
    axes.plot(after, rows, "o", color=SIMULATED, markersize=_DOT, label="after this trial")
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
    _legend(axes, *axes.get_legend_handles_labels())
    panel_title(axes, "Coefficients")


def _legend(axes: Axes, handles: Sequence[Any], labels: Sequence[str], *, columns: int = 3) -> None:
    """Legend in the line of the panel's title, at its right end, in rows that leave the title its room."""
    columns = max(1, min(columns, _TITLE_ROW // (max(map(len, labels)) + _HANDLE)))
    axes.legend(
        handles,
        labels,
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=min(len(labels), columns),
        fontsize=6 if len(labels) <= columns else 5,
        handlelength=1.2,
        columnspacing=1.0,
        labelspacing=0.2,
        borderaxespad=0.1,
    )
