"""What the residuals say against the model: their autocorrelation, and the missing terms ranked by gain."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from seatrial.plot.style import FAINT, RESIDUAL, SHADE, SIMULATED, house_style, new_figure, panel_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.criticism.criticise import Criticism
    from seatrial.criticism.residuals import Autocorrelation

__all__ = ["model_criticism"]

_COLUMNS, _ROW_IN, _BAR_IN = 3, 1.15, 0.24
_WEAK = 0.1
_LABEL = 24  # letters of names beside a bar


def model_criticism(criticism: Criticism) -> Figure:
    """Figure of the autocorrelation of every channel's residual, and of what would explain it, ranked.

    A band holds 95 of 100 autocorrelations of white residuals. A bar is the fall of the cost in percent when
    a coefficient is freed, or the share of a channel's residual, in percent, that a signal explains.
    """
    shown = criticism.autocorrelations
    rows = -(-max(len(shown), 1) // _COLUMNS)
    bars = len(criticism.suggestions) + len(criticism.signals)
    lower = 0.55 + _BAR_IN * max(bars, 1)
    with house_style():
        figure = new_figure(0.35 + _ROW_IN * rows + lower)
        parts = np.asarray(figure.subfigures(2, 1, height_ratios=[_ROW_IN * rows + 0.3, lower]))
        upper_part, lower_part = parts[0], parts[1]
        grid = upper_part.subplots(rows, _COLUMNS, squeeze=False, sharex=True, sharey=True)
        for axes, one in zip(grid.flat, shown, strict=False):
            _autocorrelation(axes, one)
        for axes in list(grid.flat)[len(shown) :]:
            axes.set_axis_off()
        for axes in grid[:, 0]:
            axes.set_ylabel("autocorrelation")
        for column in range(_COLUMNS):
            used = [axes for k, axes in enumerate(grid[:, column]) if k * _COLUMNS + column < len(shown)]
            if used:
                used[-1].set_xlabel("lag, s")
                used[-1].tick_params(labelbottom=True)
        _ranked(lower_part.subplots(), criticism)
    return figure


def _autocorrelation(axes: Axes, one: Autocorrelation) -> None:
    axes.axhspan(-one.band, one.band, color=SHADE, linewidth=0.0)
    axes.axhline(0.0, color=FAINT, linewidth=0.6)
    coloured = bool((np.abs(one.rho) > max(_WEAK, 2.0 * one.band)).any())
    axes.plot(one.lag_s, one.rho, color=RESIDUAL if coloured else SIMULATED)
    axes.set_ylim(-0.4, 1.0)
    axes.set_xlim(0.0, float(one.lag_s[-1]))
    panel_title(
        axes, one.channel, f"{one.excess:.1f} \N{MULTIPLICATION SIGN} noise, memory {one.correlation_s:.2g} s"
    )


def _ranked(axes: Axes, criticism: Criticism) -> None:
    """Bars of suggestions, then of signals, the largest at the top."""
    entries = [
        (f"{_names([one.name, *one.alternatives])}  ({one.channel} follows {one.follows})", one.gain)
        for one in criticism.suggestions
    ]
    entries += [
        (f"{one.channel} follows {one.signal}{_lag(one.lag_s)}", 100.0 * one.r2) for one in criticism.signals
    ]
    panel_title(axes, "What would explain it")
    if not entries:
        axes.set_axis_off()
        words = f"None of {criticism.tested} coefficients is missing, and no signal is followed"
        axes.text(0.0, 0.5, words, transform=axes.transAxes, va="center")
        return
    first = len(criticism.suggestions)
    colours = [SIMULATED] * first + [FAINT] * (len(entries) - first)
    places = np.arange(len(entries))
    axes.barh(places, [value for _, value in entries], color=colours, height=0.62)
    for place, (_, value) in zip(places, entries, strict=True):
        axes.annotate(
            f"{value:.2g} %", (value, place), (3, 0), textcoords="offset points", va="center", fontsize=7
        )
    axes.set_yticks(places, [name for name, _ in entries])
    axes.set_ylim(len(entries) - 0.5, -0.5)
    axes.set_xlim(0.0, 1.12 * max(value for _, value in entries))
    axes.grid(visible=False, axis="y")
    measures = ["fall of the cost"] * bool(first) + ["share of the channel's residual"] * (
        len(entries) > first
    )
    both = len(measures) > 1
    shown = [
        f"{one} ({colour})" if both else one for one, colour in zip(measures, ("blue", "grey"), strict=False)
    ]
    axes.set_xlabel(f"{' or '.join(shown)}, %")


def _names(names: list[str]) -> str:
    """Up to three names, as many as leave room for the bars."""
    shown = [name for k, name in enumerate(names[:3]) if len(" or ".join(names[: k + 1])) <= _LABEL or k == 0]
    return " or ".join(shown) + (" …" if len(shown) < len(names) else "")


def _lag(lag_s: float) -> str:
    if lag_s == 0.0:
        return ", as it is"
    return ", integrated" if np.isinf(lag_s) else f", lag {lag_s:g} s"
