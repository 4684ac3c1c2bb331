"""Convergence of the search: how far the best cost lies above the optimum, over the candidates tried.

A panel per stage; the searches (evolution strategy, descent, simplex) are told apart by colour, dashes and
a line where one follows the other. What is drawn is ``100 (Q - Q*) / Q*`` on a logarithmic axis, Q* the
stage's lowest cost: a fine search that gains a thousandth is seen as well as a global one that halves the
cost.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.plot.style import FAINT, RESIDUAL, SIMULATED, THIRD, house_style, new_figure, panel_title
from seatrial.plot.symbols import number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.stage import StageResult

__all__ = ["above_optimum", "convergence"]

Array = NDArray[np.float64]

_PHASES = {
    "evolution": ("evolution strategy", SIMULATED, "-"),
    "descent": ("Gauss\N{EN DASH}Newton descent", THIRD, (0, (1.2, 0.8))),
    "simplex": ("simplex", RESIDUAL, (0, (3, 1))),
}
_ROW_IN, _COLUMNS = 1.75, 3
_LEAST = 1e-4
"""Per cent above the optimum that are drawn at the foot: the budget's usual tolerance is a hundred times"
" as much."""


def convergence(stages: Sequence[StageResult]) -> Figure:
    """Figure of the best cost above the optimum over the candidates tried, stage by stage.

    The cost is the mean weighted error per sample in standard deviations of the channels; a panel's remark
    gives it at the start values and at the optimum.
    """
    columns = min(_COLUMNS, max(len(stages), 1))
    rows = -(-max(len(stages), 1) // columns)
    with house_style():
        figure = new_figure(0.45 + _ROW_IN * rows)
        grid = figure.subplots(rows, columns, squeeze=False)
        for axes, stage in zip(grid.flat, stages, strict=False):
            _panel(axes, stage)
        for axes in grid[:, 0]:
            axes.set_ylabel("above the optimum, %")
        for axes in list(grid.flat)[len(stages) :]:
            axes.set_axis_off()
        handles = [
            figure.axes[0].plot([], [], color=colour, linestyle=dashes, label=label)[0]
            for phase, (label, colour, dashes) in _PHASES.items()
            if any(step.phase == phase for stage in stages for step in stage.history)
        ]
        handles.append(figure.axes[0].plot([], [], "o", color="#262626", markersize=3, label="optimum")[0])
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


def above_optimum(stage: StageResult) -> list[tuple[str, Array, Array]]:
    """Per phase its name, candidates tried so far, and best cost above the optimum, %, from the start on."""
    known = [(0.0, stage.start_cost)] if np.isfinite(stage.start_cost) else []
    optimum = min([s.best for s in stage.history if np.isfinite(s.best)] + [stage.cost])
    found = []
    for phase in dict.fromkeys(s.phase for s in stage.history):
        steps = [(float(s.evaluations), s.best) for s in stage.history if s.phase == phase]
        points = np.array(known + [step for step in steps if np.isfinite(step[1])]).reshape(-1, 2)
        if len(points) > len(known):
            # An objective that changed on the way may have been lower before.
            above = np.maximum(points[:, 1] / optimum - 1.0, 0.0) * 100.0
            found.append((phase, points[:, 0], above))
            known = [(float(points[-1, 0]), float(points[-1, 1]))]
    return found


def _panel(axes: Axes, stage: StageResult) -> None:
    from matplotlib.ticker import LogLocator, NullLocator

    phases = above_optimum(stage)
    seen = np.concatenate([above for _, _, above in phases] or [np.ones(1)])
    positive = seen[seen > _LEAST]
    low = 10.0 ** np.floor(np.log10(positive.min(initial=1.0) * 0.5))
    high = 10.0 ** np.ceil(np.log10(positive.max(initial=1.0) * 2.0))
    high = max(high, 100.0 * low)
    for number_, (phase, tried, above) in enumerate(phases):
        _, colour, dashes = _PHASES.get(phase, (phase, FAINT, ":"))
        axes.step(tried, np.maximum(above, low), where="post", color=colour, linestyle=dashes, linewidth=1.3)
        if number_:
            axes.axvline(tried[0], 0.0, 0.84, color=FAINT, linewidth=0.8, linestyle=(0, (2, 2)), zorder=1)
    if phases:
        axes.plot(phases[-1][1][-1], low, "o", color="#262626", markersize=3, clip_on=False, zorder=6)
    axes.set_yscale("log")
    axes.set_ylim(low, high)
    axes.yaxis.set_major_locator(LogLocator(numticks=6))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_xlim(left=0.0)
    axes.locator_params(axis="x", nbins=4)
    axes.set_xlabel("evaluations")
    panel_title(axes, stage.name)
    axes.text(
        0.98,
        0.98,
        f"$Q$ {number(stage.start_cost)} \N{RIGHTWARDS ARROW} {number(stage.cost)}",
        transform=axes.transAxes,
        ha="right",
        va="top",
        fontsize=7.5,
    )
