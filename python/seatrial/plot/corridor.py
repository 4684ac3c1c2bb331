"""Set-point responses in their corridors, with the areas that the constraint criterion adds up.

After the figure "Constraint criteria with error areas" of Taubert et al. (2014): response, both bounds, what
lies below the lower and above the upper one filled. Of a bundle the worst response is drawn strongly and its
areas are filled. Held by `tests/test_corridor_figures.py`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.errors import SimulationError
from seatrial.plot.style import (
    COLUMN_IN,
    FAINT,
    MEASURED,
    RESIDUAL,
    SECOND,
    SHADE,
    SIMULATED,
    WIDTH_IN,
    house_style,
    new_figure,
    panel_title,
)
from seatrial.tuning.corridor_criterion import criterion, time_weighted_error, violations

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.tuning.corridor import Corridor

__all__ = ["InCorridor", "corridor_figure", "worst_response"]

Array = NDArray[np.float64]

_HEIGHT_IN = 2.65
_MARGIN, _MOST = 0.12, 0.6  # beyond the bounds, as shares of their range: at least, and at most
_JUST_BEFORE_S = 1e-6
_SMALLEST_S = 0.001  # an area below is told as less than that
_FAINTEST = 60  # responses of a bundle that are drawn, evenly taken from those there are


@dataclass(frozen=True, eq=False)
class InCorridor:
    """Responses to be drawn in a corridor.

    Parameters
    ----------
    name : str
        Title of the panel: loop, speed, step.
    corridor : Corridor
    t : array, shape (n,)
        Even grid of the control periods, s since the step.
    responses : array, shape (n,) or (k, n)
        Normalised responses.
    remark : str
        At the right of the title.
    label : str
        Of the vertical axis.
    each : str
        What one of a bundle is called.
    """

    name: str
    corridor: Corridor
    t: Array
    responses: Array
    remark: str = ""
    label: str = "share of the step"
    each: str = "responses"


def worst_response(shown: InCorridor) -> int:
    """Index of the response with the largest criterion; among equals, of the largest time-weighted error."""
    bundle = np.atleast_2d(shown.responses)
    cost = criterion(shown.t, bundle, shown.corridor)
    equal = cost == cost.max()
    late = time_weighted_error(shown.t, bundle, shown.corridor)
    return int(np.argmax(np.where(equal, late, -1.0)))


def corridor_figure(shown: Sequence[InCorridor]) -> Figure:
    """Figure with a panel per corridor: its bounds, the responses, the areas outside with their sizes.

    Parameters
    ----------
    shown : sequence of InCorridor
        At least one; two stand side by side.

    Raises
    ------
    SimulationError
        There is nothing to draw, or a grid does not fit its responses.

    Examples
    --------
    >>> import numpy as np
    >>> from seatrial.tuning.corridor import Corridor
    >>> t = np.arange(0.0, 40.0, 0.1)
    >>> one = InCorridor("surge", Corridor.from_figures(rise_s=10.0), t, 1.0 - np.exp(-t / 6.0))
    >>> len(corridor_figure([one]).axes)
    1
    """
    if not shown:
        raise SimulationError("no response to draw in a corridor; give at least one")
    columns = min(len(shown), 2)
    rows = -(-len(shown) // 2)
    with house_style():
        figure = new_figure(_HEIGHT_IN * rows, width_in=COLUMN_IN if columns == 1 else WIDTH_IN)
        grid = figure.subplots(rows, columns, squeeze=False)
        for row, panels in enumerate(grid):
            beside = shown[2 * row : 2 * row + 2]
            window = _common(beside)
            for axes, one in zip(panels, beside, strict=False):
                _panel(axes, one, window)
        for axes in list(grid.flat)[len(shown) :]:
            axes.set_axis_off()
        # The width of tick labels is known after a first layout: without it a panel's label leaves the page.
        figure.draw_without_rendering()
    return figure


def _common(beside: Sequence[InCorridor]) -> tuple[float, float]:
    """Vertical limits of panels that stand side by side: the eye compares their heights."""
    ends = [_window(one.corridor, np.atleast_2d(one.responses)[worst_response(one)]) for one in beside]
    return min(low for low, _ in ends), max(high for _, high in ends)


def _panel(axes: Axes, one: InCorridor, window: tuple[float, float]) -> None:
    bundle = np.atleast_2d(np.asarray(one.responses, dtype=float))
    worst = worst_response(one)
    areas = violations(one.t, bundle[worst], one.corridor)
    period = float(one.t[1] - one.t[0])  # the last sample stands for the period after it
    end = min(one.corridor.until_s, float(one.t[-1]) + period)
    low, high = window
    _excluded(axes, one.corridor, end, low, high)
    axes.axhline(one.corridor.target, color=FAINT, linewidth=0.7, linestyle=(0, (4, 2)))
    for k in np.unique(np.linspace(0, len(bundle) - 1, min(len(bundle), _FAINTEST)).astype(int)):
        if k != worst:
            axes.plot(one.t, _drawn(bundle[k]), color=SIMULATED, linewidth=0.5, alpha=0.35, zorder=2.2)
    _areas(axes, one, bundle[worst], areas)
    label = "response" if len(bundle) == 1 else f"worst of {len(bundle)} {one.each}"
    label += _beyond(bundle[worst], low, high)
    axes.plot(one.t, _drawn(bundle[worst]), color=SIMULATED, linewidth=1.4, zorder=3, label=label)
    axes.set_xlim(min(0.0, float(one.t[0])), end)
    axes.set_ylim(low, high)
    axes.set_xlabel("time since the step, s")
    axes.set_ylabel(one.label)
    panel_title(axes, one.name, one.remark)
    handles, labels = axes.get_legend_handles_labels()
    first = [labels.index(label), labels.index("corridor")]
    order = [*first, *(k for k in range(len(labels)) if k not in first)]
    axes.legend(
        [handles[k] for k in order],
        [labels[k] for k in order],
        loc="upper center",
        bbox_to_anchor=(0.48, -0.23),
        ncols=2,
        fontsize=7,
        columnspacing=1.2,
        borderaxespad=0.0,
    )


def _excluded(axes: Axes, corridor: Corridor, end: float, low: float, high: float) -> None:
    """Both bounds, and beyond them a light shade."""
    grid = _fine(corridor, np.array([0.0, end]))
    label = "corridor"
    for bound, edge in zip(corridor.sampled(grid), (low, high), strict=True):
        if np.isfinite(bound).any():
            edges = np.where(np.isfinite(bound), bound, np.nan)
            axes.fill_between(grid, edges, edge, color=SHADE, alpha=0.75, linewidth=0.0, zorder=0.6)
            axes.plot(grid, edges, color=MEASURED, linewidth=0.9, zorder=2.5, label=label)
            label = "_"


def _areas(axes: Axes, one: InCorridor, response: Array, areas: Array) -> None:
    """Areas outside the corridor, with their sizes in the legend."""
    grid = _fine(one.corridor, one.t)
    y = np.interp(grid, one.t, _drawn(response))
    sides = (
        ("below", areas[0], np.minimum, SECOND, "////"),
        ("above", areas[1], np.maximum, RESIDUAL, "\\\\\\\\"),
    )
    weights = one.corridor.weight_lower, one.corridor.weight_upper
    for bound, weight, (word, area, beyond, colour, hatch) in zip(
        one.corridor.sampled(grid), weights, sides, strict=True
    ):
        edge = np.where(np.isfinite(bound), bound, np.nan)
        axes.fill_between(
            grid,
            edge,
            beyond(edge, y),
            facecolor=colour,
            edgecolor="white",
            hatch=hatch,
            linewidth=0.0,
            alpha=0.85,
            zorder=2.0,
            label=f"{word}: {_size(float(area), weight)}",
        )


def _size(area: float, weight: float) -> str:
    if not math.isfinite(area):
        return "no end (diverged)"
    times = "" if weight == 1.0 else f"{weight:g} × "
    size = f"below {_SMALLEST_S:g}" if area < _SMALLEST_S else f"{area:.3g}" if area < 1e3 else f"{area:.0f}"
    return f"{times}{size} s" if area > 0.0 else "none"


def _beyond(response: Array, low: float, high: float) -> str:
    """Where a response goes that leaves the panel, for the legend; empty for one that does not."""
    seen = response[np.isfinite(response)]
    if not len(seen):
        return " (diverges at once)"
    ends = [float(end) for end in (seen.min(), seen.max()) if not low <= end <= high]
    return f" (to {max(ends, key=abs):.2g})".replace("-", "\N{MINUS SIGN}") if ends else ""


def _window(corridor: Corridor, response: Array) -> tuple[float, float]:
    """Vertical limits: a margin around bounds and response, of which a wild one is cut."""
    values = np.array([value for points in (corridor.lower, corridor.upper) for _, value in points])
    ends = np.array([min(values.min(), 0.0), max(values.max(), corridor.target)])
    span = float(ends[1] - ends[0]) or 1.0
    seen = response[np.isfinite(response)] if np.isfinite(response).any() else ends
    low = min(ends[0] - _MARGIN * span, float(seen.min()) - 0.5 * _MARGIN * span)
    high = max(ends[1] + _MARGIN * span, float(seen.max()) + 0.5 * _MARGIN * span)
    return max(low, float(ends[0]) - _MOST * span), min(high, float(ends[1]) + _MOST * span)


def _fine(corridor: Corridor, t: Array) -> Array:
    """Grid with the times of all bounds, and just before them, so that jumps are upright."""
    times = np.array([time for points in (corridor.lower, corridor.upper) for time, _ in points])
    grid = np.concatenate([t, times, times - _JUST_BEFORE_S])
    return np.unique(grid[(grid >= t[0]) & (grid <= t[-1])])


def _drawn(response: Array) -> Array:
    """The response without what is not finite: a gap in the line."""
    return np.where(np.isfinite(response), response, np.nan)
