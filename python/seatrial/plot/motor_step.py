"""Step test of a motor: commanded, measured and modelled revolutions, their residual, and single steps.

As the figure "Modelled and measured step response of revolution" of Taubert et al. (2014). In a single step
the dashed line is what the lag follows: the command after limits, rate limit and dead time. At 63 % of the
step the response lags behind it by T_1, exactly so after a jump and on a ramp that is long against T_1.
Held by `tests/test_motor_dynamics.py`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.motor_dynamics.step_record import StepRecord
from seatrial.plot.style import (
    FAINT,
    MEASURED,
    RESIDUAL,
    SECOND,
    SIMULATED,
    house_style,
    new_figure,
    panel_title,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.motor_dynamics.motor_estimate import MotorEstimate

__all__ = ["motor_step"]

Array = NDArray[np.float64]

_SHARE = 1.0 - np.exp(-1.0)
_CLEAR = 8.0  # standard deviations of the noise that a step must exceed to be shown
_FINE = 600
_USUAL = 0.96  # part of the residuals that sets the axis where a few are far beyond
_DARK = "#262626"


def motor_step(estimate: MotorEstimate, record: StepRecord) -> Figure:
    """Figure of a record and the motor that was identified.

    Parameters
    ----------
    estimate : MotorEstimate
    record : StepRecord
        One of those it was identified from, or any other.
    """
    times, measured = record.sampled
    stamps, commands = record.held
    unit = estimate.unit
    modelled = estimate.model.response(record, times)
    with house_style():
        figure = new_figure(5.6)
        grid = figure.add_gridspec(3, 2, height_ratios=[1.5, 0.75, 1.5])
        above = figure.add_subplot(grid[0, :])
        below = figure.add_subplot(grid[1, :], sharex=above)
        end = float(times[-1])
        seen = stamps < end
        above.step(
            np.append(stamps[seen], end),
            np.append(commands[seen], commands[seen][-1]),
            where="post",
            color=SECOND,
            linewidth=0.9,
            label="commanded",
        )
        above.plot(times, measured, ".", color=MEASURED, markersize=1.8, label="measured")
        fine = np.linspace(times[0], end, max(4 * len(times), _FINE))
        above.plot(
            fine, estimate.model.response(record, fine), color=SIMULATED, linewidth=0.9, label="modelled"
        )
        above.set_ylabel(f"revolutions, {unit}")
        above.set_xlim(times[0], end)
        above.tick_params(labelbottom=False)
        above.legend(loc="upper right", ncols=3, bbox_to_anchor=(1.0, 1.17), borderaxespad=0.0)
        panel_title(above, f"Step test of {record.name}")
        _residual(below, times, measured, modelled, unit)
        shown = _steps(estimate, record)
        for place, (name, k) in enumerate(shown):
            axes = figure.add_subplot(grid[2, place] if len(shown) > 1 else grid[2, :])
            _step(axes, estimate, record, k, name)
            axes.set_ylabel(f"revolutions, {unit}" if place == 0 else "")
        if shown:
            figure.axes[-1].legend(loc="best")
        figure.align_ylabels()
    return figure


def _residual(axes: Axes, times: Array, measured: Array, modelled: Array, unit: str) -> None:
    """Residual over time; a few values far beyond the others are counted, not drawn."""
    error = measured - modelled
    usual = 1.3 * float(np.quantile(np.abs(error), _USUAL))
    inside = np.abs(error) <= (usual if np.abs(error).max() > 4.0 * usual else np.inf)
    axes.axhline(0.0, color=_DARK, linewidth=0.5)
    axes.plot(times[inside], error[inside], color=RESIDUAL, linewidth=0.6)
    axes.set_ylabel(f"residual, {unit}")
    axes.set_xlabel("time, s")
    spread = float(np.sum((measured[inside] - measured[inside].mean()) ** 2))
    text = f"mean |e| = {np.mean(np.abs(error[inside])):.1f} {unit}"
    if spread > 0:
        text += f", R\N{SUPERSCRIPT TWO} = {1.0 - float(np.sum(error[inside] ** 2)) / spread:.5f}"
    if not inside.all():
        text += f"; {np.count_nonzero(~inside)} values are off the axis"
    panel_title(axes, "Measured minus modelled", text)


def _steps(estimate: MotorEstimate, record: StepRecord) -> list[tuple[str, int]]:
    """The largest step away from rest and the smallest clear one, with their places among the commands."""
    stamps, commands = record.held
    limits = replace(estimate.model, T_1=0.0, T_t=0.0, n_acc=(np.inf, np.inf), n_dec=(np.inf, np.inf))
    levels = limits.response(record, stamps)
    ends = np.append(stamps[1:], record.sampled[0][-1])
    lasting = ends - stamps > estimate.model.T_t + 3.0 * estimate.model.T_1
    sizes = np.abs(np.diff(levels, prepend=levels[0]))
    growing = np.abs(levels) > np.abs(np.roll(levels, 1))
    fit = lasting & (sizes > _CLEAR * estimate.noise.total)
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
    fine = np.linspace(at, until, 4 * _FINE)
    response, led = model.response(record, fine), follow.response(record, fine)
    before, after = float(response[0]), float(response[-1])
    passed = (response - before) / (after - before)
    settled = fine[int(np.argmax(passed > 0.99))] - at
    first, last = at - 0.45 * settled, min(at + 1.4 * settled, until)
    fine = np.linspace(first, last, _FINE)
    rows = (times >= first) & (times <= last)
    axes.step(
        [first - at, 0.0, last - at],
        [float(commands[k - 1]), float(commands[k]), float(commands[k])],
        where="post",
        color=SECOND,
        label="commanded",
    )
    axes.plot(
        fine - at,
        follow.response(record, fine),
        "--",
        color=FAINT,
        linewidth=0.9,
        label="limited and delayed",
    )
    axes.plot(fine - at, model.response(record, fine), color=SIMULATED, label="modelled")
    axes.plot(times[rows] - at, measured[rows], "o", color=MEASURED, markersize=2.6, label="measured")
    inner = np.linspace(at, until, 4 * _FINE) - at
    share = (led - before) / (after - before)
    reached = float(inner[int(np.argmax(share >= _SHARE))])
    level = before + _SHARE * (after - before)
    low = before + 0.3 * (after - before)
    _span(axes, (0.0, model.T_t), low, f"$T_t$ = {model.T_t:.3f} s", at=0.0)
    _span(axes, (reached, reached + model.T_1), level, f"$T_1$ = {model.T_1:.3f} s", at=reached + model.T_1)
    axes.set_xlim(first - at, last - at)
    axes.set_xlabel(f"time after the command, s (t = {at:.1f} s)")
    panel_title(axes, name)


def _span(axes: Axes, ends: tuple[float, float], level: float, text: str, *, at: float) -> None:
    """A time between two bars, with its name beside one of them, away from the other."""
    left = at == ends[0]
    for x in ends:
        axes.plot([x], [level], "|", color=_DARK, markersize=7, markeredgewidth=0.9, zorder=5)
    axes.plot(ends, [level, level], color=_DARK, linewidth=0.9, zorder=5)
    axes.annotate(
        text,
        (at, level),
        xytext=(-5 if left else 5, 0),
        textcoords="offset points",
        ha="right" if left else "left",
        va="center",
        fontsize=7.5,
        color=_DARK,
        zorder=6,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 0.6},
    )
