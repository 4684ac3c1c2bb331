"""Measured against simulated: one model with its residuals, or several variants with their errors.

A panel per channel, the held-out part shaded. Every vehicle keeps its colour and its dashes through all
panels; the recorded line is broad and grey. Held by `tests/report/test_plot.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array, Mask, runs
from seatrial.base.channels import ANGLES, AXES, CHANNELS, readable
from seatrial.base.files import file_name, free_name
from seatrial.report.plot import style as pen
from seatrial.scoring.comparison import Comparison
from seatrial.scoring.score import Score

if TYPE_CHECKING:
    from matplotlib.artist import Artist
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

IN_DEGREES = ("p", "q", "r", *ANGLES)

_RECORDED: pen.Style = {"color": pen.MEASURED, "linewidth": 2.2, "alpha": 0.4}

_MEASURED: pen.Style = {"color": pen.MEASURED, "linewidth": 1.6, "alpha": 0.55}


def measured_against_simulated(
    trial: Trial,
    windows: Sequence[Window],
    *,
    channels: Sequence[str],
    titles: Mapping[str, str] | None = None,
    held_out: Mask | None = None,
    heading: str = "",
) -> Figure:
    """Figure of a trial's channels, measured and simulated, with residuals.

    Each of the windows (as of `seatrial.scoring.score.Score`) restarts from the measurement; samples that are
    held out, (n,), are shaded, and a channel's scores stand in the title of its panel.
    """
    with pen.house_style():
        figure, panels = _panels(trial, channels, panel_in=1.35, lower=1.0)
        for channel, (upper, lower) in zip(channels, panels, strict=True):
            _channel(upper, lower, trial, windows, channel)
            pen.panel_title(upper, NAMES[channel], (titles or {}).get(channel, ""))
            for axes in (upper, lower):  # what judges the result is the same time in both
                _shade(axes, trial.t, held_out)
        handles: list[Artist] = [
            pen.stroke("measured", **_MEASURED),
            pen.stroke("simulated", pen.SIMULATED, linewidth=0.9),
            pen.stroke("measured \N{MINUS SIGN} simulated", pen.RESIDUAL, linewidth=0.7),
        ]
        if held_out is not None and held_out.any():
            handles.append(pen.field("held out of the fit", pen.SHADE))
        pen.legend_below(figure, handles)
        pen.heading(figure, heading, fontsize=9)
    return figure


def _panels(
    trial: Trial, channels: Sequence[str], *, panel_in: float, lower: float
) -> tuple[Figure, list[tuple[Axes, Axes]]]:
    """A figure over a trial's time, with a panel per channel and a lower one for its errors."""
    figure = pen.new_figure(0.85 + panel_in * len(channels))  # 0.85 inches of edges
    heights = [3.0, lower] * len(channels)
    grid = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    for axes in grid:
        axes.tick_params(axis="x", bottom=axes is grid[-1])
    grid[-1].set_xlabel("time, s")
    grid[-1].set_xlim(trial.t[0], trial.t[-1])
    for channel, upper, errors in zip(channels, grid[::2], grid[1::2], strict=True):
        upper.set_ylabel(readable(channel)[1])
        errors.set_ylabel("error", fontsize=7)
        errors.yaxis.set_major_locator(few_ticks())
    figure.align_ylabels(list(grid))
    figure.get_layout_engine().set(h_pad=0.03, hspace=0.0)  # type: ignore[union-attr, call-arg]
    return figure, list(zip(grid[::2], grid[1::2], strict=True))


def _measured(axes: Axes, trial: Trial, channel: str, look: pen.Style) -> Array:
    """Draw a measured channel, in the unit that people read; the values (n,), SI, an angle unwrapped."""
    k = CHANNELS.index(channel)
    measured = np.where(trial.valid[:, k], trial.observed[:, k], np.nan)
    known = np.isfinite(measured)
    if channel in ANGLES:
        measured[known] = np.unwrap(measured[known])
    shown = readable(channel)[0] * measured
    axes.plot(trial.t, shown, **look)
    if known.any():
        margin = 0.15 * max(float(np.ptp(shown[known])), 1e-6)
        axes.set_ylim(shown[known].min() - margin, shown[known].max() + margin)
    return measured


def _channel(upper: Axes, lower: Axes, trial: Trial, windows: Sequence[Window], channel: str) -> None:
    k, (scale, _) = CHANNELS.index(channel), readable(channel)
    measured = _measured(upper, trial, channel, _MEASURED)
    for window in windows:
        t = trial.t[window.start : window.stop]
        simulated = window.simulated[:, k].copy()
        observed = measured[window.start : window.stop]
        if channel in ANGLES:
            simulated = beside(np.unwrap(simulated), observed)
        upper.plot(t, scale * simulated, color=pen.SIMULATED, linewidth=0.9)
        lower.plot(t, scale * (observed - simulated), color=pen.RESIDUAL, linewidth=0.7)
    residual_limits(lower)
    lower.axhline(0.0, color=pen.INK, linewidth=0.4)


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


def _shade(axes: Axes, t: Array, mask: Mask | None) -> None:
    if mask is None or not mask.any():
        return
    for first, end in runs(mask):
        axes.axvspan(t[first], t[min(end, len(t) - 1)], color=pen.SHADE, linewidth=0.0, zorder=0)


def few_ticks() -> Locator:
    """Locator of two or three ticks about zero, for a low panel."""
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(nbins=2, symmetric=True)


_LOOKS: tuple[tuple[str, Any], ...] = (
    (pen.SIMULATED, "-"),
    (pen.RESIDUAL, (0, (4, 1.5))),
    (pen.THIRD, (0, (1, 1))),
    (pen.FOURTH, (0, (5, 1, 1, 1))),
)


def drawings(
    result: Score | Comparison | Mapping[str, Score], *, free: str = AXES
) -> dict[str, Callable[[], Figure]]:
    """A figure per trial, of the velocities of the `free` axes, or of all channels without any.

    Of scores by name of the vehicle, all of the same trials, or of one.
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
    ahead_s = next(iter(scores.values())).ahead_s
    looks: dict[str, pen.Style] = {
        name: {"color": colour, "linestyle": dashes}
        for name, (colour, dashes) in zip(scores, cycle(_LOOKS), strict=False)
    }
    with pen.house_style():
        figure, panels = _panels(trial, channels, panel_in=1.45, lower=1.4)
        for channel, (upper, lower) in zip(channels, panels, strict=True):
            _variants_panel(upper, lower, trial, scores, looks, channel)
            pen.panel_title(upper, NAMES[channel], _remark(scores, channel))
        handles = [pen.stroke("recorded", **_RECORDED)]
        handles += [pen.stroke(name, linewidth=1.1, **look) for name, look in looks.items()]
        pen.legend_below(figure, handles, min(len(handles), 5))
        kind = f"{ahead_s:g} s ahead from the measured state" if np.isfinite(ahead_s) else "free run"
        pen.heading(figure, f"Trial {trial.name}: {kind}", fontsize=9)
    return figure


def _variants_panel(
    upper: Axes,
    lower: Axes,
    trial: Trial,
    scores: Mapping[str, Score],
    looks: Mapping[str, pen.Style],
    channel: str,
) -> None:
    k, (scale, _) = CHANNELS.index(channel), readable(channel)
    measured = _measured(upper, trial, channel, _RECORDED)
    reach = 0.0
    for name, score in scores.items():
        t, simulated, error = _joined(trial, score.windows, measured, k, angle=channel in ANGLES)
        upper.plot(t, scale * simulated, linewidth=0.9, **looks[name])
        lower.plot(t, scale * error, linewidth=0.7, **looks[name])
        sizes = np.abs(scale * error[np.isfinite(error)])
        reach = max(reach, float(np.quantile(sizes, 0.995)) if len(sizes) else 0.0)
    if reach > 0.0:
        lower.set_ylim(-1.25 * reach, 1.25 * reach)
    lower.axhline(0.0, color=pen.INK, linewidth=0.4)


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
    scale, _ = readable(channel)
    errors = [scale * score[channel].mae for score in scores.values()]
    words = " | ".join(f"{error:#.2g}" if error < 10.0 else f"{error:.0f}" for error in errors)
    return (
        f"mean error {words},  R\N{SUPERSCRIPT TWO} {' | '.join(_r2(s[channel].r2) for s in scores.values())}"
    )


def _r2(value: float) -> str:
    """R2 in three decimals; what is far below zero in short."""
    return f"{value:.3f}" if abs(value) < 10.0 else pen.tidy(value)
