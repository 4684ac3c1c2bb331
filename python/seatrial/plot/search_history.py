"""Convergence of the search: best cost over candidates, evolution strategy and simplex, a panel per stage."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.plot.style import SECOND, SIMULATED, house_style, new_figure, panel_title

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from seatrial.stage import StageResult

__all__ = ["convergence"]

_PHASES = {"evolution": ("evolution strategy", SIMULATED), "simplex": ("simplex", SECOND)}
_ROW_IN, _COLUMNS = 1.75, 3


def convergence(stages: Sequence[StageResult]) -> Figure:
    """Figure of the best cost over the candidates tried, stage by stage.

    The cost is the mean weighted error per sample in standard deviations of the channels.
    """
    from matplotlib.ticker import FixedLocator, NullLocator, StrMethodFormatter

    columns = min(_COLUMNS, max(len(stages), 1))
    rows = -(-max(len(stages), 1) // columns)
    with house_style():
        figure = new_figure(0.45 + _ROW_IN * rows)
        grid = figure.subplots(rows, columns, squeeze=False)
        for axes, stage in zip(grid.flat, stages, strict=False):
            reached: tuple[float, float] | None = None
            if np.isfinite(stage.start_cost):
                reached = (0.0, stage.start_cost)
            for phase, (_, colour) in _PHASES.items():
                steps = [s for s in stage.history if s.phase == phase and np.isfinite(s.best)]
                if not steps:
                    continue
                tried = [float(s.evaluations) for s in steps]
                best = [s.best for s in steps]
                if reached is not None:
                    tried, best = [reached[0], *tried], [reached[1], *best]
                axes.step(tried, best, where="post", color=colour)
                reached = (tried[-1], best[-1])
            if reached is not None:
                axes.plot(*reached, "o", color="#262626", markersize=3)
            axes.set_yscale("log")
            axes.yaxis.set_major_locator(FixedLocator(_ticks(*axes.get_ylim())))
            axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            axes.yaxis.set_minor_locator(NullLocator())
            axes.set_xlabel("candidates")
            axes.set_ylabel("best cost, std dev.")
            panel_title(axes, stage.name)
            axes.text(
                0.97,
                0.95,
                f"{stage.start_cost:.3g} \N{RIGHTWARDS ARROW} {stage.cost:.3g}",
                transform=axes.transAxes,
                ha="right",
                va="top",
                fontsize=7.5,
            )
        for axes in list(grid.flat)[len(stages) :]:
            axes.set_axis_off()
        handles = [
            figure.axes[0].plot([], [], color=colour, label=label)[0] for label, colour in _PHASES.values()
        ]
        figure.legend(handles=handles, loc="outside upper center", ncols=2)
    return figure


def _ticks(lower: float, upper: float) -> list[float]:
    """Round numbers in a range of costs, at least three where there are so many."""
    decades = 10.0 ** np.arange(np.floor(np.log10(lower)), np.ceil(np.log10(upper)) + 1.0)
    chosen: list[float] = []
    for digits in (
        (1.0,),
        (1.0, 3.0),
        (1.0, 2.0, 5.0),
        (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0),
        np.arange(1.0, 10.0, 0.5),
    ):
        chosen = [float(d * decade) for decade in decades for d in digits if lower <= d * decade <= upper]
        if len(chosen) >= 3:
            break
    return chosen
