"""Measured against simulated: a panel per channel with its residual below, the held-out part shaded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.plot.style import MEASURED, RESIDUAL, SHADE, SIMULATED, house_style, new_figure, panel_title
from seatrial.recording.columns import CHANNELS, DEGREE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.ticker import Locator

    from seatrial.prediction import Window
    from seatrial.trial import Trial

__all__ = ["measured_against_simulated"]

Array = NDArray[np.float64]

NAMES = dict(
    zip(
        CHANNELS,
        (
            *("surge u", "sway v", "heave w", "roll rate p", "pitch rate q", "yaw rate r"),
            *("north x", "east y", "depth z", "roll", "pitch", "yaw"),
        ),
        strict=True,
    )
)
_PANEL_IN, _EDGES_IN = 1.35, 0.85
ANGLES = ("roll", "pitch", "yaw")
IN_DEGREES = ("p", "q", "r", *ANGLES)


def measured_against_simulated(
    trial: Trial,
    windows: Sequence[Window],
    *,
    channels: Sequence[str],
    titles: Mapping[str, str] | None = None,
    held_out: NDArray[np.bool_] | None = None,
    heading: str = "",
) -> Figure:
    """Figure of a trial's channels, measured and simulated, with residuals.

    Parameters
    ----------
    trial : Trial
    windows : sequence of Window
        What was simulated, for example `seatrial.score.Score.windows`; each restarts from the measurement.
    channels : sequence of str
        Those to show, from top to bottom.
    titles : mapping of str to str, optional
        Remark in the title of a channel's panel: its scores.
    held_out : array of bool, shape (n,), optional
        Samples to shade.
    heading : str
        Title of the whole figure.
    """
    with house_style():
        figure = new_figure(_EDGES_IN + _PANEL_IN * len(channels))
        heights = [3.0, 1.0] * len(channels)
        grid = figure.subplots(2 * len(channels), 1, sharex=True, squeeze=False, height_ratios=heights)
        for row, channel in enumerate(channels):
            upper, lower = grid[2 * row, 0], grid[2 * row + 1, 0]
            _channel(upper, lower, trial, windows, channel)
            panel_title(upper, NAMES[channel], (titles or {}).get(channel, ""))
            for axes in (upper, lower):
                _shade(axes, trial.t, held_out)
                axes.tick_params(axis="x", bottom=axes is grid[-1, 0])
        grid[-1, 0].set_xlabel("time, s")
        grid[-1, 0].set_xlim(trial.t[0], trial.t[-1])
        figure.align_ylabels(list(grid[:, 0]))
        figure.get_layout_engine().set(h_pad=0.03, hspace=0.0)  # type: ignore[union-attr, call-arg]
        _legend(figure, held_out)
        if heading:
            figure.suptitle(heading, x=0.01, ha="left", fontweight="bold", fontsize=9)
    return figure


def _channel(upper: Axes, lower: Axes, trial: Trial, windows: Sequence[Window], channel: str) -> None:
    k = CHANNELS.index(channel)
    scale = 1.0 / DEGREE if channel in IN_DEGREES else 1.0
    unit = ("deg" if channel in IN_DEGREES else "m") + ("/s" if k < 6 else "")
    measured = np.where(trial.valid[:, k], trial.observed[:, k], np.nan)
    if channel in ANGLES:
        known = np.isfinite(measured)
        measured[known] = np.unwrap(measured[known])
    upper.plot(trial.t, scale * measured, color=MEASURED, linewidth=1.6, alpha=0.55)
    for window in windows:
        t = trial.t[window.start : window.stop]
        simulated = window.simulated[:, k].copy()
        observed = measured[window.start : window.stop]
        if channel in ANGLES:
            simulated = beside(np.unwrap(simulated), observed)
        upper.plot(t, scale * simulated, color=SIMULATED, linewidth=0.9)
        lower.plot(t, scale * (observed - simulated), color=RESIDUAL, linewidth=0.7)
    shown = scale * measured[np.isfinite(measured)]
    if len(shown):
        margin = 0.15 * max(np.ptp(shown), 1e-6)
        upper.set_ylim(shown.min() - margin, shown.max() + margin)
    residual_limits(lower)
    upper.set_ylabel(unit)
    lower.set_ylabel("error", fontsize=7)
    lower.axhline(0.0, color="#262626", linewidth=0.4)
    lower.yaxis.set_major_locator(few_ticks())


def residual_limits(axes: Axes) -> None:
    """Limits that single outliers do not set."""
    errors = np.concatenate([np.abs(line.get_ydata()) for line in axes.get_lines()] or [np.zeros(1)])
    errors = errors[np.isfinite(errors)]
    if len(errors) and (reach := 1.6 * float(np.quantile(errors, 0.995))) > 0.0:
        axes.set_ylim(-reach, reach)


def beside(simulated: Array, observed: Array) -> Array:
    """An unwrapped angle moved by whole turns to where the measurement begins."""
    known = np.flatnonzero(np.isfinite(observed) & np.isfinite(simulated))
    if not len(known):
        return simulated
    turns = np.round((observed[known[0]] - simulated[known[0]]) / (2.0 * np.pi))
    return np.asarray(simulated + 2.0 * np.pi * turns)


def _shade(axes: Axes, t: Array, mask: NDArray[np.bool_] | None) -> None:
    if mask is None or not mask.any():
        return
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        axes.axvspan(t[first], t[min(end, len(t) - 1)], color=SHADE, linewidth=0.0, zorder=0)


def few_ticks() -> Locator:
    """Locator of two or three ticks about zero, for a low panel."""
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(nbins=2, symmetric=True)


def _legend(figure: Figure, held_out: NDArray[np.bool_] | None) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Line2D | Patch] = [
        Line2D([], [], color=MEASURED, linewidth=1.6, alpha=0.55, label="measured"),
        Line2D([], [], color=SIMULATED, linewidth=0.9, label="simulated"),
        Line2D([], [], color=RESIDUAL, linewidth=0.7, label="measured \N{MINUS SIGN} simulated"),
    ]
    if held_out is not None and held_out.any():
        handles.append(Patch(color=SHADE, label="held out of the fit"))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
