"""Figures of a bench test: thrust over the signal with fit and 95 % band, and step responses of a motor.

Bollard test: one panel per group, both directions in one pair of axes; outliers are ringed and named; a
table over the supply voltage is a curve per voltage. Step test: commanded, measured and modelled
revolutions, their residual, and single steps (Taubert et al. 2014, figure 6 (step response)). In a single
step the dashed line is the input of the lag: the command after limits, rate limit and dead time. Held by
`tests/bench_test/test_motor_dynamics.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.base.files import file_name, free_name
from seatrial.bench_test.characteristic import SIDES
from seatrial.bench_test.motor_model import StepRecord
from seatrial.report.plot import style as pen
from seatrial.report.results.bench_test import share

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.bench_test.characteristic import UnitFit
    from seatrial.bench_test.evaluate import BenchTest
    from seatrial.bench_test.motor_estimate import MotorEstimate


@dataclass(frozen=True)
class BenchFigureSettings:
    """What of a bench test is drawn."""

    points: int = 201  #: Of a curve: smooth in print.
    named: int = 6  #: Outlying points with a number: more hide one another.
    fine: int = 600  #: Points of a step in time: smooth in print.
    clear: float = 8.0  #: A step is shown that exceeds so many standard deviations of the noise.
    usual: float = 0.96  #: Part of the residuals that sets the axis where a few are far beyond.


SETTINGS = BenchFigureSettings()

_DASHES = (
    "-",
    (0, (6, 1.5)),
    (0, (3, 1.2)),
    (0, (1.2, 1.0)),
    (0, (6, 1.5, 1.2, 1.5)),
    (0, (3, 1, 1, 1, 1, 1)),
)


def drawings(result: BenchTest) -> dict[str, Callable[[], Figure]]:
    """Figures of a bench test by name: bollard test, a step of every motor."""
    drawn: dict[str, Callable[[], Figure]] = {}
    if result.pulls:
        drawn["bollard_test"] = partial(bollard_test, result)
    for unit, motor in result.motors.items():
        name = free_name(f"motor_{file_name(unit, instead='+')}", drawn)
        drawn[name] = partial(motor_step, motor, result.step_records[unit][0])
    return drawn


def bollard_test(result: BenchTest, *, groups: Sequence[str] | None = None) -> Figure:
    """Figure of the fitted characteristics of groups, with the points behind them and their residuals."""
    shown = [result.pulls[name] for name in (groups or result.pulls)]
    with pen.house_style():
        figure = pen.new_figure(4.3, width_in=min(pen.WIDTH_IN, 3.7 * len(shown)))
        grid = figure.subplots(2, len(shown), squeeze=False, sharex="col", height_ratios=(3.0, 1.0))
        for column, fit in enumerate(shown):
            upper, lower = grid[0][column], grid[1][column]
            if fit.table is not None and len(fit.table.voltage_v) > 1:
                _voltages(upper, lower, fit)
            else:
                _curve(upper, lower, fit)
            for axes in (upper, lower):
                axes.axhline(0.0, color=pen.INK, linewidth=0.5)
                axes.axvline(0.0, color=pen.INK, linewidth=0.5)
                axes.locator_params(nbins=6)
            lower.margins(y=0.15)
            upper.set_ylabel("thrust of one actuator, N")
            lower.set_ylabel("residual, N")
            neutral = float(result.before.actuator_info()[fit.unit.actuators[0]]["neutral"])
            from_neutral = f" from neutral ({neutral:g})" if neutral else ""
            what = {"rpm": "revolutions", "us": "pulse width", "N": "commanded force"}[fit.unit.command]
            lower.set_xlabel(f"{what}{from_neutral}, {fit.unit.command.replace('us', 'µs')}")
            pen.panel_title(upper, fit.unit.name.replace("_", " "), _scores(fit))
        figure.align_ylabels(grid[:, 0])
    return figure


def _legend_below(lower: Axes, upper: Axes, **options: Any) -> None:
    """Legend of the upper panel below the lower one, where it hides no point."""
    handles, labels = upper.get_legend_handles_labels()
    place: pen.Style = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.5), "ncols": 2}
    lower.legend(handles, labels, **place, title_fontsize=7.5, **options)


def _scores(fit: UnitFit) -> str:
    if not fit.directions:
        rms = float(np.sqrt(np.mean(fit.table.residual**2))) if fit.table is not None else np.nan
        return f"table, residual {rms:.2g} N (rms)"
    words = ", ".join(f"{share(direction.fit.r2, 4)} {side}" for side, direction in fit.directions.items())
    return f"R² {words}"


def _curve(upper: Axes, lower: Axes, fit: UnitFit) -> None:
    points = fit.points
    outlying = _outlying(fit)
    for number, side in enumerate(fit.sides):
        sign = SIDES[side]
        own = sign * points.signal > 0.0
        grid = sign * np.linspace(0.0, float(np.abs(points.signal[own]).max()), SETTINGS.points)[1:]
        thrust = fit.thrust(grid)
        first = number == 0
        upper.plot(grid, thrust, color=pen.SIMULATED, label="fit" if first else None, zorder=3)
        if side in fit.directions and fit.table is None:
            curve, single = fit.directions[side].fit.bands(np.abs(grid)[:, None])
            for axes, middle in ((upper, thrust), (lower, 0.0 * thrust)):
                label = "95 %, single points" if first else None
                pen.band(axes, grid, middle - single, middle + single, pen.FAINT, alpha=0.25, label=label)
                label = "95 %, curve" if first else None
                pen.band(axes, grid, middle - curve, middle + curve, pen.SIMULATED, alpha=0.3, label=label)
    residual = points.thrust - fit.thrust(points.signal)
    honest = ~outlying
    size = 9.0 if len(points.signal) <= 60 else 2.0  # many markers shrink
    for axes, values in ((upper, points.thrust), (lower, residual)):
        look: pen.Style = {
            "s": size,
            "color": pen.MEASURED,
            "linewidths": 0.0,
            "zorder": 4 if size > 5.0 else 2,
        }
        axes.scatter(points.signal[honest], values[honest], label="measured", **look)
        if outlying.any():
            _ring(axes, points.signal[outlying], values[outlying])
    _name_outliers(upper, fit, np.flatnonzero(outlying))
    _legend_below(lower, upper)


def _outlying(fit: UnitFit) -> NDArray[np.bool_]:
    """Mask (n,) of the points that are outliers."""
    outlying = np.zeros(len(fit.points.signal), bool)
    for direction in fit.directions.values():
        outlying[direction.outliers] = True
    return outlying


def _ring(axes: Axes, signal: Array, values: Array) -> None:
    ring: pen.Style = {"s": 26.0, "facecolors": "none", "edgecolors": pen.RESIDUAL, "linewidths": 1.0}
    axes.scatter(signal, values, zorder=5, label="outlier", **ring)


def _name_outliers(axes: Axes, fit: UnitFit, outlying: NDArray[np.int_]) -> None:
    """Numbers at the outliers; pull and place of each in the corner below the curve, always empty."""
    listed = []
    for number, k in enumerate(sorted(outlying, key=lambda k: fit.points.signal[k])[: SETTINGS.named], 1):
        left = fit.points.signal[k] < 0.0
        axes.annotate(
            str(number),
            (fit.points.signal[k], fit.points.thrust[k]),
            xytext=(7.0 if left else -7.0, 5.0 if left else 3.0),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=6.5,
            color=pen.RESIDUAL,
        )
        listed.append(f"{number}  {fit.points.pull[k]}, {fit.points.label[k].split(', ', 1)[-1]}")
    more = len(outlying) - SETTINGS.named
    listed += [f"and {more} more"] if more > 0 else []
    corner: pen.Style = {"transform": axes.transAxes, "ha": "right", "va": "bottom", "linespacing": 1.4}
    axes.text(0.98, 0.03, "\n".join(listed), fontsize=6.5, color=pen.RESIDUAL, **corner)


def _voltages(upper: Axes, lower: Axes, fit: UnitFit) -> None:
    table = fit.table
    assert table is not None
    even = np.linspace(table.signal[0], table.signal[-1], SETTINGS.points)
    grid = np.unique(np.concatenate([even, table.signal]))
    for row, voltage in enumerate(table.voltage_v):
        colour, dashes = pen.CYCLE[row % len(pen.CYCLE)], _DASHES[row % len(_DASHES)]
        own = table.level == row
        signal = fit.points.signal[own]
        dot: pen.Style = {"s": 2.0, "color": colour, "linewidths": 0.0}
        upper.scatter(signal, fit.points.thrust[own], alpha=0.45, **dot)
        curve = table.at(grid, np.full(len(grid), voltage))
        upper.plot(grid, curve, color=colour, linestyle=dashes, linewidth=0.9, label=f"{voltage:.4g} V")
        lower.scatter(signal, table.residual[own], **dot)
    outlying = _outlying(fit)
    if outlying.any():
        _ring(upper, fit.points.signal[outlying], fit.points.thrust[outlying])
        _ring(lower, fit.points.signal[outlying], table.residual[outlying])
        _name_outliers(upper, fit, np.flatnonzero(outlying))
    _legend_below(lower, upper, title="supply")


def motor_step(estimate: MotorEstimate, record: StepRecord) -> Figure:
    """Figure of a record, one it was identified from or any other, and the motor that was identified."""
    times, measured = record.sampled
    stamps, commands = record.held
    unit = estimate.unit
    modelled = estimate.model.response(record, times)
    with pen.house_style():
        figure = pen.new_figure(5.6)
        grid = figure.add_gridspec(3, 2, height_ratios=[1.5, 0.75, 1.5])
        above = figure.add_subplot(grid[0, :])
        below = figure.add_subplot(grid[1, :], sharex=above)
        end = float(times[-1])
        seen = stamps < end
        steps = np.append(stamps[seen], end), np.append(commands[seen], commands[seen][-1])
        above.step(*steps, where="post", color=pen.SECOND, linewidth=0.9, label="commanded")
        above.plot(times, measured, ".", color=pen.MEASURED, markersize=1.8, label="measured")
        # Finer than the samples: the model's steps and its dead time stay visible.
        fine = np.linspace(times[0], end, max(4 * len(times), SETTINGS.fine))
        above.plot(
            fine, estimate.model.response(record, fine), color=pen.SIMULATED, linewidth=0.9, label="modelled"
        )
        above.set_ylabel(f"revolutions, {unit}")
        above.set_xlim(times[0], end)
        above.tick_params(labelbottom=False)
        above.legend(loc="upper right", ncols=3, bbox_to_anchor=(1.0, 1.17), borderaxespad=0.0)
        pen.panel_title(above, f"Step test of {record.name}")
        _residual(below, times, measured, modelled, unit)
        shown = _steps(estimate, record)
        for place, (name, k) in enumerate(shown):
            axes = figure.add_subplot(grid[2, place] if len(shown) > 1 else grid[2, :])
            _step(axes, estimate, record, k, name)
            axes.set_ylabel(f"revolutions, {unit}" if place == 0 else "")
        if shown:
            pen.legend_below(figure, figure.axes[-1].get_legend_handles_labels()[0], 4, columnspacing=1.4)
        figure.align_ylabels()
    return figure


def _residual(axes: Axes, times: Array, measured: Array, modelled: Array, unit: str) -> None:
    """Residual over time; a few values far beyond the others are counted, not drawn."""
    error = measured - modelled
    usual = 1.3 * float(np.quantile(np.abs(error), SETTINGS.usual))
    inside = np.abs(error) <= (usual if np.abs(error).max() > 4.0 * usual else np.inf)
    axes.axhline(0.0, color=pen.INK, linewidth=0.5)
    axes.plot(times[inside], error[inside], color=pen.RESIDUAL, linewidth=0.6)
    axes.set_ylabel(f"residual, {unit}")
    axes.set_xlabel("time, s")
    spread = float(np.sum((measured[inside] - measured[inside].mean()) ** 2))
    text = f"mean |e| = {np.mean(np.abs(error[inside])):.1f} {unit}"
    if spread > 0:
        text += f", R\N{SUPERSCRIPT TWO} = {1.0 - float(np.sum(error[inside] ** 2)) / spread:.5f}"
    if not inside.all():
        text += f"; {np.count_nonzero(~inside)} values are off the axis"
    pen.panel_title(axes, "Measured minus modelled", text)


def _steps(estimate: MotorEstimate, record: StepRecord) -> list[tuple[str, int]]:
    """The largest step away from rest and the smallest clear one, with their places among the commands."""
    stamps, commands = record.held
    limits = replace(estimate.model, T_1=0.0, T_t=0.0, n_acc=(np.inf, np.inf), n_dec=(np.inf, np.inf))
    levels = limits.response(record, stamps)
    ends = np.append(stamps[1:], record.sampled[0][-1])
    lasting = ends - stamps > estimate.model.T_t + 3.0 * estimate.model.T_1
    sizes = np.abs(np.diff(levels, prepend=levels[0]))
    growing = np.abs(levels) > np.abs(np.roll(levels, 1))
    fit = lasting & (sizes > SETTINGS.clear * estimate.noise.total)
    fit[0] = False
    places = np.flatnonzero(fit)
    if not len(places):
        return []
    preferred = [k for k in places if growing[k]] or list(places)
    large = int(max(preferred, key=lambda k: (sizes[k], -k)))
    # Steps into a limit are small for the motor and large on the page.
    asked = np.abs(np.diff(commands, prepend=commands[0])) * estimate.model.K_V
    plain = [k for k in places if asked[k] < 1.5 * sizes[k]] or list(places)
    small = int(min(plain, key=lambda k: (sizes[k], k)))
    return [("Large step", large)] + ([("Small step", small)] if sizes[small] < 0.5 * sizes[large] else [])


def _step(axes: Axes, estimate: MotorEstimate, record: StepRecord, k: int, name: str) -> None:
    """One step with dead time and time constant."""
    stamps, commands = record.held
    times, measured = record.sampled
    model = estimate.model
    at = float(stamps[k])
    until = float(stamps[k + 1]) if k + 1 < len(stamps) else float(times[-1])
    follow = replace(model, T_1=0.0)
    fine = np.linspace(at, until, 4 * SETTINGS.fine)
    response, led = model.response(record, fine), follow.response(record, fine)
    before, after = float(response[0]), float(response[-1])
    passed = (response - before) / (after - before)
    settled = fine[int(np.argmax(passed > 0.99))] - at
    first, last = at - 0.45 * settled, min(at + 1.4 * settled, until)
    fine = np.linspace(first, last, SETTINGS.fine)
    rows = (times >= first) & (times <= last)
    levels = [float(commands[k - 1]), float(commands[k]), float(commands[k])]
    axes.step([first - at, 0.0, last - at], levels, where="post", color=pen.SECOND, label="commanded")
    limited = follow.response(record, fine)
    axes.plot(fine - at, limited, "--", color=pen.FAINT, linewidth=0.9, label="limited and delayed")
    axes.plot(fine - at, model.response(record, fine), color=pen.SIMULATED, label="modelled")
    axes.plot(times[rows] - at, measured[rows], "o", color=pen.MEASURED, markersize=2.6, label="measured")
    inner = np.linspace(at, until, 4 * SETTINGS.fine) - at
    share = (led - before) / (after - before)
    lagged = 1.0 - math.exp(-1.0)  # of a step that a first-order lag does in its time constant
    reached = float(inner[int(np.argmax(share >= lagged))])
    level = before + lagged * (after - before)
    low = before + 0.3 * (after - before)
    _span(axes, (0.0, model.T_t), low, f"$T_t$ = {model.T_t:.3f} s", at=0.0)
    _span(axes, (reached, reached + model.T_1), level, f"$T_1$ = {model.T_1:.3f} s", at=reached + model.T_1)
    axes.set_xlim(first - at, last - at)
    axes.set_xlabel(f"time after the command, s (t = {at:.1f} s)")
    pen.panel_title(axes, name)


def _span(axes: Axes, ends: tuple[float, float], level: float, text: str, *, at: float) -> None:
    """A time between two bars, with its name beside one of them, away from the other."""
    left = at == ends[0]
    for x in ends:
        axes.plot([x], [level], "|", color=pen.INK, markersize=7, markeredgewidth=0.9, zorder=5)
    axes.plot(ends, [level, level], color=pen.INK, linewidth=0.9, zorder=5)
    aside: pen.Style = {"ha": "right" if left else "left", "va": "center", "textcoords": "offset points"}
    place = (at, level), (-5 if left else 5, 0)
    axes.annotate(text, *place, fontsize=7.5, color=pen.INK, zorder=6, bbox=pen.ON_WHITE, **aside)
