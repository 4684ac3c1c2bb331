"""Random starts: where they began and ended between the bounds, and how the criterion came down.

A row of panels per stage. Left, a line per coefficient from its lower to its upper bound with the start
values above it and the ends on it; ends elsewhere than at the optimum stand out. Right, how far the criterion
of every search lies above the lowest one of all, over the candidates tried.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from seatrial.report.plot.style import FAINT, RESIDUAL, SIMULATED, house_style, new_figure, panel_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.identification.restarts_result import Restarts, StageRestarts

_ROW_IN, _PANEL_IN, _EDGES_IN = 0.17, 0.62, 0.55

_LEAST_ROWS = 5

_LEAST = 1e-3
"""Per cent above the lowest criterion at which a curve ends: a hundredth of what the verdict allows."""


def random_starts(found: Restarts) -> Figure:
    """Figure of the starts and ends of all stages and of the course of their searches.

    Parameters
    ----------
    found : Restarts
        With at least one stage.
    """
    rows = [max(len(stage.parameters), _LEAST_ROWS) for stage in found.stages]
    with house_style():
        figure = new_figure(_EDGES_IN + sum(_PANEL_IN + _ROW_IN * row for row in rows))
        grid = figure.subplots(
            len(rows), 2, squeeze=False, width_ratios=[1.5, 1.0], height_ratios=[row + 2.5 for row in rows]
        )
        for (left, right), stage in zip(grid, found.stages, strict=True):
            _ends(left, stage)
            _courses(right, stage)
            panel_title(left, stage.name)
            panel_title(right, "", f"lowest {stage.costs[stage.best]:.4g} std dev.")
        grid[-1, 0].set_xlabel("place between the bounds, % of their width")
        grid[-1, 1].set_xlabel("candidates")
        figure.align_ylabels(list(grid[:, 1]))
        _legend(figure, found)
    return figure


def _ends(axes: Axes, stage: StageRestarts) -> None:
    width = stage.upper - stage.lower
    starts, ends = (100.0 * (values - stage.lower) / width for values in (stage.starts, stage.ends))
    places = np.arange(len(stage.parameters))[::-1]
    axes.hlines(places, 0.0, 100.0, color=FAINT, linewidth=0.6, zorder=1)
    for values in starts:
        axes.plot(values, places + 0.22, "|", color=FAINT, markersize=4, markeredgewidth=0.9, zorder=2)
    for values, good in zip(ends, stage.at_optimum, strict=True):
        marker, colour, size = ("o", SIMULATED, 3.6) if good else ("x", RESIDUAL, 4.2)
        axes.plot(values, places, marker, color=colour, markersize=size, zorder=3)
    axes.set_yticks(places, stage.parameters)
    axes.set_ylim(-0.7, len(places) - 0.2)
    axes.set_xlim(-2.0, 102.0)
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)


def _courses(axes: Axes, stage: StageRestarts) -> None:
    lowest = float(stage.costs[stage.best])
    for history, good in zip(stage.histories, stage.at_optimum, strict=True):
        # The global search takes longer steps: its last costs may lie below the optimum by a hair.
        steps = [step for step in history if np.isfinite(step.best)]
        above = [max(100.0 * (step.best / lowest - 1.0), _LEAST) for step in steps]
        colour, style = (SIMULATED, "-") if good else (RESIDUAL, (0, (3, 1)))
        axes.step(
            [step.evaluations for step in steps],
            above,
            where="post",
            color=colour,
            linestyle=style,
            linewidth=0.7,
            alpha=0.8,
        )
    axes.set_yscale("log")
    axes.set_ylim(0.5 * _LEAST, None)
    axes.set_yticks([1e-3, 1e-1, 1e1, 1e3], ["0.001", "0.1", "10", "1000"])
    axes.minorticks_off()
    axes.set_ylim(0.5 * _LEAST, max(2e3, axes.get_ylim()[1]))
    axes.set_xlim(0.0, None)
    axes.set_ylabel("% above the lowest", fontsize=7)


def _legend(figure: Figure, found: Restarts) -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=FAINT, marker="|", linestyle="none", markeredgewidth=0.9, label="random start"),
        Line2D(
            [], [], color=SIMULATED, marker="o", markersize=3.6, linewidth=0.8, label="ends at the optimum"
        ),
    ]
    if not found.same_optimum:
        handles.append(
            Line2D(
                [], [], color=RESIDUAL, marker="x", linestyle=(0, (3, 1)), linewidth=0.8, label="elsewhere"
            )
        )
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
