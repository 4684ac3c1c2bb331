"""Measured against simulated: one model with its residuals, or several variants with their errors.

A panel per channel, the held-out part shaded. Every vehicle keeps its colour and its dashes through all
panels; the recorded line is broad and grey. Held by `tests/report/test_plot.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array, runs
from seatrial.base.channels import AXES, CHANNELS, DEGREE
from seatrial.base.file_names import file_name, free_name
from seatrial.report.plot.style import (
    FOURTH,
    MEASURED,
    RESIDUAL,
    SHADE,
    SIMULATED,
    THIRD,
    house_style,
    new_figure,
    panel_title,
    tidy,
)
from seatrial.scoring.comparison import Comparison
from seatrial.scoring.score import Score

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.ticker import Locator

    from seatrial.scoring.windows import Window
    from seatrial.trial.trial import Trial

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

_PANEL_IN, _EDGES_IN = 1.35, 0.85  # layout, inches

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
        What was simulated, for example `seatrial.scoring.score.Score.windows`; each restarts from the
        measurement.
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
    for first, end in runs(mask):
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


_LOOKS: tuple[tuple[str, Any], ...] = (
    (SIMULATED, "-"),
    (RESIDUAL, (0, (4, 1.5))),
    (THIRD, (0, (1, 1))),
    (FOURTH, (0, (5, 1, 1, 1))),
)

_ANGLES = ("roll", "pitch", "yaw")

_DEGREES = ("p", "q", "r", *_ANGLES)


def drawings(
    result: Score | Comparison | Mapping[str, Score], *, free: str = AXES
) -> dict[str, Callable[[], Figure]]:
    """A figure per trial, of the velocities of the free axes, or of all channels without any.

    Parameters
    ----------
    result
        Scores by name of the vehicle, all of the same trials, or one score.
    free : str
        Letters of the axes that were simulated.
    """
    if isinstance(result, Score):
        result = {"model": result}
    scores = result.scores if isinstance(result, Comparison) else result
    first_scores = next(iter(scores.values()))
    velocities = [CHANNELS[AXES.index(axis)] for axis in AXES if axis in free]
    drawn: dict[str, Callable[[], Figure]] = {}
    for name in dict.fromkeys(first_scores.trials):
        trial = next((w.trial for w in first_scores.windows if w.trial.name == name), None)
        if trial is None:
            continue
        channels = [c for c in first_scores if c in velocities and c in trial.channels]
        channels = channels or [c for c in first_scores if c in trial.channels]
        figure = free_name(f"variants_{file_name(name, instead='_')}", drawn)
        drawn[figure] = partial(variants, trial, scores, channels=channels)
    return drawn


def variants(trial: Trial, scores: Mapping[str, Score], *, channels: Sequence[str]) -> Figure:
    """Figure of a trial with what every vehicle predicts, per channel, and the errors below."""
    first = next(iter(scores.values()))
    looks = {name: _LOOKS[i % len(_LOOKS)] for i, name in enumerate(scores)}
    with house_style():
        figure = new_figure(0.85 + 1.45 * len(channels))  # inches of the edges, and of each panel
        grid = figure.subplots(
            2 * len(channels), 1, sharex=True, squeeze=False, height_ratios=[3.0, 1.4] * len(channels)
        )
        for row, channel in enumerate(channels):
            upper, lower = grid[2 * row, 0], grid[2 * row + 1, 0]
            _variants_panel(upper, lower, trial, scores, looks, channel)
            panel_title(upper, NAMES[channel], _remark(scores, channel))
            for axes in (upper, lower):
                axes.tick_params(axis="x", bottom=axes is grid[-1, 0])
        grid[-1, 0].set_xlabel("time, s")
        grid[-1, 0].set_xlim(trial.t[0], trial.t[-1])
        figure.align_ylabels(list(grid[:, 0]))
        figure.get_layout_engine().set(h_pad=0.03, hspace=0.0)  # type: ignore[union-attr, call-arg]
        _variants_legend(figure, looks)
        kind = (
            f"{first.ahead_s:g} s ahead from the measured state" if np.isfinite(first.ahead_s) else "free run"
        )
        figure.suptitle(f"Trial {trial.name}: {kind}", x=0.01, ha="left", fontweight="bold", fontsize=9)
    return figure


def _variants_panel(
    upper: Axes,
    lower: Axes,
    trial: Trial,
    scores: Mapping[str, Score],
    looks: Mapping[str, tuple[str, Any]],
    channel: str,
) -> None:
    k = CHANNELS.index(channel)
    scale = 1.0 / DEGREE if channel in _DEGREES else 1.0
    measured = np.where(trial.valid[:, k], trial.observed[:, k], np.nan)
    if channel in _ANGLES:
        known = np.isfinite(measured)
        measured[known] = np.unwrap(measured[known])
    upper.plot(trial.t, scale * measured, color=MEASURED, linewidth=2.2, alpha=0.4)
    errors: list[Array] = []
    for name, score in scores.items():
        colour, dashes = looks[name]
        t, simulated, error = _joined(trial, score.windows, measured, k, angle=channel in _ANGLES)
        upper.plot(t, scale * simulated, color=colour, linestyle=dashes, linewidth=0.9)
        lower.plot(t, scale * error, color=colour, linestyle=dashes, linewidth=0.7)
        errors.append(np.abs(scale * error[np.isfinite(error)]))
    shown = scale * measured[np.isfinite(measured)]
    if len(shown):
        margin = 0.15 * max(float(np.ptp(shown)), 1e-6)
        upper.set_ylim(shown.min() - margin, shown.max() + margin)
    reach = max((float(np.quantile(e, 0.995)) for e in errors if len(e)), default=0.0)
    if reach > 0.0:
        lower.set_ylim(-1.25 * reach, 1.25 * reach)
    upper.set_ylabel(("deg" if channel in _DEGREES else "m") + ("/s" if k < 6 else ""))
    lower.set_ylabel("error", fontsize=7)
    lower.axhline(0.0, color="#262626", linewidth=0.4)
    lower.yaxis.set_major_locator(_few_ticks())


def _joined(
    trial: Trial, windows: Sequence[Window], measured: Array, k: int, *, angle: bool
) -> tuple[Array, Array, Array]:
    """Times, simulated channel and error of all windows in a row, with a gap between two of them."""
    t, simulated, error = [np.zeros(0)], [np.zeros(0)], [np.zeros(0)]
    for window in windows:
        if window.trial.name != trial.name:
            continue
        observed = measured[window.start : window.stop]
        answer = window.simulated[:, k]
        if angle:  # beside the measurement, by whole turns
            answer = observed + (answer - observed + np.pi) % (2.0 * np.pi) - np.pi
        for parts, values in (
            (t, trial.t[window.start : window.stop]),
            (simulated, answer),
            (error, observed - answer),
        ):
            parts += [values, np.array([np.nan])]
    return np.concatenate(t), np.concatenate(simulated), np.concatenate(error)


def _remark(scores: Mapping[str, Score], channel: str) -> str:
    """Mean error and R2 of every vehicle, in the order of the legend."""
    if any(score[channel].blind for score in scores.values()):
        return "not scored, commands react to waves"
    scale = 1.0 / DEGREE if channel in _DEGREES else 1.0
    errors = [scale * score[channel].mae for score in scores.values()]
    words = " | ".join(f"{error:#.2g}" if error < 10.0 else f"{error:.0f}" for error in errors)
    return (
        f"mean error {words},  R\N{SUPERSCRIPT TWO} {' | '.join(_r2(s[channel].r2) for s in scores.values())}"
    )


def _r2(value: float) -> str:
    """R2 in three decimals; what is far below zero in short."""
    return f"{value:.3f}" if abs(value) < 10.0 else tidy(value)


def _few_ticks() -> Any:
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(nbins=2, symmetric=True)


def _variants_legend(figure: Figure, looks: Mapping[str, tuple[str, Any]]) -> None:
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], color=MEASURED, linewidth=2.2, alpha=0.4, label="recorded")]
    handles += [
        Line2D([], [], color=colour, linestyle=dashes, linewidth=1.1, label=name)
        for name, (colour, dashes) in looks.items()
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 5))
