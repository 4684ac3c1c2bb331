"""A recorded mission against its model: envelope with the log in it, residuals with their bands, suspects.

Held by `tests/verification/test_recorded_verdict.py`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.base.channels import CHANNELS, DEGREE, readable
from seatrial.report.plot.flight import line
from seatrial.report.plot.style import (
    FAINT,
    MEASURED,
    RESIDUAL,
    SIMULATED,
    THIRD,
    house_style,
    new_figure,
    panel_title,
)
from seatrial.verification.mission_log.log import QUANTITIES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.verification.mission_log.verdict import LogVerdict

_BAND = "#CFE3F1"

_RARE, _BEYOND = (
    0.025,
    0.5,
)  # share at either end that may leave the panel, and the span shown beyond the others

_SIGN = re.compile(r"(?<!\w)-(?=\d)")


def drawings(verdict: LogVerdict) -> dict[str, Callable[[], Figure]]:
    """Figures of a verdict by name: residuals, suspects, envelope, as there are."""
    there = {
        "residuals": (residual_page, verdict.validity is not None),
        "suspects": (suspect_bars, bool(verdict.suspects)),
        "envelope": (envelope_page, verdict.envelope is not None),
    }
    return {name: partial(draw, verdict) for name, (draw, known) in there.items() if known}


def envelope_page(verdict: LogVerdict) -> Figure:
    """Figure of the closed-loop envelope with the log in it, samples outside marked."""
    envelope = verdict.envelope
    assert envelope is not None
    with house_style():
        figure = new_figure(0.75 + 1.15 * len(envelope.bands))
        panels = np.atleast_1d(figure.subplots(len(envelope.bands), 1, sharex=True))
        for axes, (name, band) in zip(panels, envelope.bands.items(), strict=True):
            words, unit = QUANTITIES[name]
            scale = 1.0 / DEGREE if unit == "rad" else 1.0
            unit = "deg" if unit == "rad" else unit
            _shade(axes, envelope.t, scale * band.lower, scale * band.upper, "95 % of the flights")
            line(axes, envelope.t, scale * band.middle, color=SIMULATED, linewidth=0.9, label="median flight")
            line(axes, envelope.t, scale * band.log, color=MEASURED, linewidth=0.9, label="log")
            _dots(axes, envelope.t, scale * band.log, band.is_outside)
            axes.set_ylabel(unit)
            _sensible(axes, scale * np.concatenate([band.lower, band.upper, band.log]))
            panel_title(axes, words, f"{100.0 * band.outside:.0f} % of the log outside")
            if name == "depth":
                axes.invert_yaxis()
        panels[-1].set_xlabel("time since the start, s")
        panels[-1].set_xlim(envelope.t[0], envelope.t[-1])
        _legend(figure, panels[0])
        figure.suptitle(
            f"{verdict.log.trial.name}: the log in the envelope of {envelope.flights} flights",
            x=0.01,
            ha="left",
            fontweight="bold",
        )
    return figure


def residual_page(verdict: LogVerdict) -> Figure:
    """Figure of measured minus predicted per channel, with the band of a valid model; windows restart."""
    judged = verdict.validity
    assert judged is not None
    names = list(judged.channels)
    rows = (len(names) + 1) // 2
    log = judged.log
    t = np.concatenate([np.append(log.times(w), log.times(w)[-1]) for w in range(len(log.spans))])
    with house_style():
        figure = new_figure(0.85 + 1.0 * rows)
        panels = figure.subplots(rows, 2, sharex=True, squeeze=False)
        for place, name in enumerate(names):
            axes = panels[place % rows, place // rows]
            channel, k = judged.channels[name], CHANNELS.index(name)
            scale, unit = readable(name)
            error = _broken([
                np.where(m[:, k], e[:, k], np.nan) for e, m in zip(log.residual, log.counted, strict=True)
            ])
            half = _broken([b[:, k] for b in judged.half_width])
            error, half = scale * error, scale * half
            _shade(axes, t, -half, half, "95 % band of the model")
            line(axes, t, error, color=MEASURED, linewidth=0.6, label="measured less predicted")
            with np.errstate(invalid="ignore"):
                _dots(axes, t, error, np.abs(error) > half)
            axes.set_ylabel(f"{name}, {unit}", color=RESIDUAL if channel.fails else "#262626")
            _sensible(axes, np.concatenate([error, half, -half]))
            p = f"p = {channel.p:.2g}" if channel.p >= 1e-4 else "p < 0.0001"
            panel_title(
                axes, "fails" if channel.fails else "", f"{100.0 * channel.outside:.1f} % outside, {p}"
            )
            if channel.fails:
                axes.title.set_color(RESIDUAL)
                axes.set_title("fails", loc="left", fontweight="bold", color=RESIDUAL)
        for axes in panels.ravel()[len(names) :]:
            axes.set_visible(False)
        for axes in panels[-1]:
            axes.set_xlabel("time, s")
        panels[0, 0].set_xlim(t[0], t[-1])
        _legend(figure, panels[0, 0])
        ahead = log.since_restart(0)[-1]
        figure.suptitle(
            f"{verdict.log.trial.name}: measured less predicted, restarted every {ahead:.3g} s",
            x=0.01,
            ha="left",
            fontweight="bold",
        )
    return figure


def suspect_bars(verdict: LogVerdict) -> Figure:
    """Figure of the suspects: error that each leaves, in units of a valid model's, the least first."""
    import textwrap

    shown = verdict.suspects[:8]  # bars of a page, the likeliest first
    with house_style():
        figure = new_figure(0.9 + 0.42 * len(shown))
        axes = figure.subplots()
        rows = np.arange(len(shown))
        left = [suspect.left for suspect in shown]
        before = left[0] / max(1.0 - shown[0].gain, 1e-12) ** 0.5
        colours = [THIRD if k == 0 else SIMULATED for k in rows]
        axes.barh(rows, left, color=colours, height=0.55, alpha=0.85, linewidth=0)
        axes.axvline(1.0, color=MEASURED, linewidth=0.8, linestyle=(0, (3, 2)))
        axes.axvline(before, color=RESIDUAL, linewidth=1.0)
        ends = axes.get_xaxis_transform()
        axes.text(1.0, 1.01, "as a valid model", transform=ends, fontsize=6.5, color=MEASURED, ha="right")
        axes.text(before, 1.01, "model as it is", transform=ends, fontsize=6.5, color=RESIDUAL, ha="left")
        for row, suspect in zip(rows, shown, strict=True):
            inside = suspect.left > 0.2 * before  # beside a long bar it would cross the line of the model
            axes.text(
                suspect.left - 0.012 * before if inside else max(suspect.left, 1.0) + 0.012 * before,
                float(row),
                f"{100.0 * suspect.gain:.{1 if suspect.gain > 0.99 else 0}f} %",
                va="center",
                ha="right" if inside else "left",
                fontsize=6.5,
                color="white" if inside else "#404040",
            )
        named = [textwrap.fill(_SIGN.sub("\N{MINUS SIGN}", suspect.change), 62) for suspect in shown]
        axes.set_yticks(rows, named, fontsize=7)
        axes.invert_yaxis()
        axes.grid(False, axis="y")
        axes.set_xlim(0.0, 1.25 * max(before, 1.0))
        axes.set_xlabel("error left, over a valid model's; at its end the share explained")
        figure.suptitle(
            f"{verdict.log.trial.name}: what may have changed", x=0.01, ha="left", fontweight="bold"
        )
    return figure


def _shade(axes: Axes, t: Array, lower: Array, upper: Array, label: str) -> None:
    every = max(1, len(t) // 4000)
    axes.fill_between(
        t[::every], lower[::every], upper[::every], color=_BAND, linewidth=0, zorder=0.6, label=label
    )


def _dots(axes: Axes, t: Array, y: Array, mask: NDArray[np.bool_]) -> None:
    at, values = t[mask], y[mask]
    every = max(1, len(at) // 1500)  # markers of a panel: more are one blot
    axes.plot(
        at[::every],
        values[::every],
        linestyle="none",
        marker=".",
        markersize=1.8,
        color=RESIDUAL,
        label="log outside",
        zorder=3,
    )


def _sensible(axes: Axes, values: Array) -> None:
    """Limits that hold what matters of the values: a turn on the spot must not flatten a mission."""
    good = values[np.isfinite(values)]
    if not len(good):
        axes.text(
            0.5,
            0.5,
            "the log has no samples of it",
            ha="center",
            transform=axes.transAxes,
            fontsize=7,
            color=FAINT,
        )
        return
    low, high = np.quantile(good, (_RARE, 1.0 - _RARE))
    span = max(float(high - low), 1e-6)
    low, high = max(good.min(), low - _BEYOND * span), min(good.max(), high + _BEYOND * span)
    axes.set_ylim(low - 0.08 * span, high + 0.08 * span)


def _broken(parts: list[Array]) -> Array:
    """Windows one after the other, a gap between them."""
    return np.concatenate([np.append(part, np.nan) for part in parts])


def _legend(figure: Figure, axes: Axes) -> None:
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=7)
