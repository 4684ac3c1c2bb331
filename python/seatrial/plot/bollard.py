"""Bollard test: measured thrust of a single actuator over its signal, the fitted curve and its 95 % band.

One panel per group with both directions in one pair of axes, as the paper shows the characteristics of stern
propeller and vertical thruster. Outliers are ringed and named. A table over the supply voltage is a curve per
voltage, each with its points.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.bench_test.bench_text import share
from seatrial.bench_test.unit_fit import SIDES
from seatrial.plot.style import (
    CYCLE,
    FAINT,
    MEASURED,
    RESIDUAL,
    SIMULATED,
    WIDTH_IN,
    house_style,
    new_figure,
    panel_title,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.bench_test import BenchTest
    from seatrial.bench_test.unit_fit import UnitFit

__all__ = ["bollard_test"]

Array = NDArray[np.float64]

_POINTS = 201
_NAMED = 6
_DENSE = 60
_DASHES = (
    "-",
    (0, (6, 1.5)),
    (0, (3, 1.2)),
    (0, (1.2, 1.0)),
    (0, (6, 1.5, 1.2, 1.5)),
    (0, (3, 1, 1, 1, 1, 1)),
)


def bollard_test(result: BenchTest, *, groups: Sequence[str] | None = None) -> Figure:
    """Figure of the fitted characteristics, with the points behind them and their residuals.

    Parameters
    ----------
    result : BenchTest
    groups : sequence of str, optional
        Groups to show; all that were pulled by default.
    """
    shown = [result.pulls[name] for name in (groups or result.pulls)]
    with house_style():
        figure = new_figure(3.9, width_in=min(WIDTH_IN, 3.7 * len(shown)))
        grid = figure.subplots(2, len(shown), squeeze=False, sharex="col", height_ratios=(3.0, 1.0))
        for column, fit in enumerate(shown):
            upper, lower = grid[0][column], grid[1][column]
            if fit.table is not None and len(fit.table.voltage) > 1:
                _voltages(upper, lower, fit)
            else:
                _curve(upper, lower, fit)
            for axes in (upper, lower):
                axes.axhline(0.0, color="#262626", linewidth=0.5)
                axes.axvline(0.0, color="#262626", linewidth=0.5)
                axes.locator_params(nbins=6)
            lower.margins(y=0.15)
            upper.set_ylabel("thrust of one actuator, N")
            lower.set_ylabel("residual, N")
            neutral = float(result.before.actuator_info()[fit.unit.actuators[0]]["neutral"])
            from_neutral = f" from neutral ({neutral:g})" if neutral else ""
            what = {"rpm": "revolutions", "us": "pulse width", "N": "commanded force"}[fit.unit.command]
            lower.set_xlabel(f"{what}{from_neutral}, {fit.unit.command.replace('us', 'µs')}")
            panel_title(upper, fit.unit.name.replace("_", " "), _scores(fit))
        figure.align_ylabels(grid[:, 0])
    return figure


def _scores(fit: UnitFit) -> str:
    if not fit.directions:
        rms = float(np.sqrt(np.mean(fit.table.residual**2))) if fit.table is not None else np.nan
        return f"table, residual {rms:.2g} N (rms)"
    words = ", ".join(f"{share(one.fit.r2, 4)} {side}" for side, one in fit.directions.items())
    return f"R² {words}"


def _curve(upper: Axes, lower: Axes, fit: UnitFit) -> None:
    points = fit.points
    outlying = _outlying(fit)
    for number, side in enumerate(fit.sides):
        sign = SIDES[side]
        own = sign * points.signal > 0.0
        grid = sign * np.linspace(0.0, float(np.abs(points.signal[own]).max()), _POINTS)[1:]
        thrust = fit.thrust(grid)
        first = number == 0
        upper.plot(grid, thrust, color=SIMULATED, label="fit" if first else None, zorder=3)
        if side in fit.directions and fit.table is None:
            curve, single = fit.directions[side].fit.bands(np.abs(grid)[:, None])
            for axes, middle in ((upper, thrust), (lower, 0.0 * thrust)):
                axes.fill_between(
                    grid,
                    middle - single,
                    middle + single,
                    color=FAINT,
                    alpha=0.25,
                    linewidth=0.0,
                    label="95 %, single points" if first else None,
                )
                axes.fill_between(
                    grid,
                    middle - curve,
                    middle + curve,
                    color=SIMULATED,
                    alpha=0.3,
                    linewidth=0.0,
                    label="95 %, curve" if first else None,
                )
    residual = points.thrust - fit.thrust(points.signal)
    honest = ~outlying
    size = 9.0 if len(points.signal) <= _DENSE else 2.0
    for axes, values in ((upper, points.thrust), (lower, residual)):
        axes.scatter(
            points.signal[honest],
            values[honest],
            s=size,
            color=MEASURED,
            linewidths=0.0,
            zorder=4 if size > 5.0 else 2,
            label="measured",
        )
        if outlying.any():
            _ring(axes, points.signal[outlying], values[outlying])
    _name_outliers(upper, fit, np.flatnonzero(outlying))
    upper.legend(loc="upper left")


def _outlying(fit: UnitFit) -> NDArray[np.bool_]:
    """Mask (n,) of the points that are outliers."""
    outlying = np.zeros(len(fit.points.signal), bool)
    for one in fit.directions.values():
        outlying[one.outliers] = True
    return outlying


def _ring(axes: Axes, signal: Array, values: Array) -> None:
    axes.scatter(
        signal,
        values,
        s=26.0,
        facecolors="none",
        edgecolors=RESIDUAL,
        linewidths=1.0,
        zorder=5,
        label="outlier",
    )


def _name_outliers(axes: Axes, fit: UnitFit, outlying: NDArray[np.int_]) -> None:
    """Numbers at the outliers; pull and place of each in the corner below the curve, always empty."""
    listed = []
    for number, k in enumerate(sorted(outlying, key=lambda k: fit.points.signal[k])[:_NAMED], 1):
        left = fit.points.signal[k] < 0.0
        axes.annotate(
            str(number),
            (fit.points.signal[k], fit.points.thrust[k]),
            xytext=(7.0 if left else -7.0, 5.0 if left else 3.0),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=6.5,
            color=RESIDUAL,
        )
        listed.append(f"{number}  {fit.points.pull[k]}, {fit.points.place[k].split(', ', 1)[-1]}")
    more = len(outlying) - _NAMED
    listed += [f"and {more} more"] if more > 0 else []
    axes.text(
        0.98,
        0.03,
        "\n".join(listed),
        transform=axes.transAxes,
        ha="right",
        va="bottom",
        fontsize=6.5,
        color=RESIDUAL,
        linespacing=1.4,
    )


def _voltages(upper: Axes, lower: Axes, fit: UnitFit) -> None:
    table = fit.table
    assert table is not None
    grid = np.unique(np.concatenate([np.linspace(table.signal[0], table.signal[-1], _POINTS), table.signal]))
    for row, voltage in enumerate(table.voltage):
        colour, dashes = CYCLE[row % len(CYCLE)], _DASHES[row % len(_DASHES)]
        own = table.level == row
        upper.scatter(
            fit.points.signal[own], fit.points.thrust[own], s=2.0, color=colour, alpha=0.45, linewidths=0.0
        )
        upper.plot(
            grid,
            table.at(grid, np.full(len(grid), voltage)),
            color=colour,
            linestyle=dashes,
            linewidth=0.9,
            label=f"{voltage:.4g} V",
        )
        lower.scatter(fit.points.signal[own], table.residual[own], s=2.0, color=colour, linewidths=0.0)
    outlying = _outlying(fit)
    if outlying.any():
        _ring(upper, fit.points.signal[outlying], fit.points.thrust[outlying])
        _ring(lower, fit.points.signal[outlying], table.residual[outlying])
        _name_outliers(upper, fit, np.flatnonzero(outlying))
    upper.legend(loc="upper left", title="supply", title_fontsize=7.5)
