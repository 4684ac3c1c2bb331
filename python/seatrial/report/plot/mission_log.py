"""A log beside what should have happened: a mission and its model, ArduSub and its law.

Of a mission: envelope with the log in it, residuals with their bands, suspects. Of ArduSub: the replay, the
envelope of the loop errors, steps before and after a tuning. Held by
`tests/verification/test_recorded_verdict.py`, `tests/ardusub/test_replay.py` and
`tests/ardusub/test_from_log.py`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from seatrial.ardusub.comparison import Replay
from seatrial.ardusub.from_log import LogTuning
from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import CHANNELS, DEGREE, readable
from seatrial.report.plot import style as pen
from seatrial.report.plot.flight import line
from seatrial.verification.mission_log.verdict import QUANTITIES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.ardusub.comparison import Quantity
    from seatrial.verification.mission_log.verdict import LogVerdict

_BAND = "#CFE3F1"

_SIGN = re.compile(r"(?<!\w)-(?=\d)")


def drawings(result: LogVerdict | Replay | LogTuning) -> dict[str, Callable[[], Figure]]:
    """Figures by name, as there are: of a verdict, of a replay of ArduSub, of a tuning from its log."""
    if isinstance(result, Replay):
        return {"replay": partial(replay_figure, result)}
    if isinstance(result, LogTuning):
        return {
            "replay": partial(replay_figure, result.replay),
            "envelope": partial(envelope_figure, result),
            "steps": partial(steps_figure, result),
        }
    verdict = result
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
    with pen.house_style():
        figure = pen.new_figure(0.75 + 1.15 * len(envelope.bands))
        panels = np.atleast_1d(figure.subplots(len(envelope.bands), 1, sharex=True))
        for axes, (name, own) in zip(panels, envelope.bands.items(), strict=True):
            words, unit = QUANTITIES[name]
            scale = 1.0 / DEGREE if unit == "rad" else 1.0
            unit = "deg" if unit == "rad" else unit
            _shade(axes, envelope.t, scale * own.lower, scale * own.upper, "95 % of the flights")
            line(
                axes,
                envelope.t,
                scale * own.middle,
                color=pen.SIMULATED,
                linewidth=0.9,
                label="median flight",
            )
            line(axes, envelope.t, scale * own.log, color=pen.MEASURED, linewidth=0.9, label="log")
            _dots(axes, envelope.t, scale * own.log, own.is_outside)
            axes.set_ylabel(unit)
            _sensible(axes, scale * np.concatenate([own.lower, own.upper, own.log]))
            pen.panel_title(axes, words, f"{100.0 * own.outside:.0f} % of the log outside")
            if name == "depth":
                axes.invert_yaxis()
        panels[-1].set_xlabel("time since the start, s")
        panels[-1].set_xlim(envelope.t[0], envelope.t[-1])
        pen.legend_below(figure, panels[0].get_legend_handles_labels()[0], fontsize=7)
        pen.heading(
            figure, f"{verdict.log.trial.name}: the log in the envelope of {envelope.flights} flights"
        )
    return figure


def residual_page(verdict: LogVerdict) -> Figure:
    """Figure of measured minus predicted per channel, with the band of a valid model; windows restart."""
    judged = verdict.validity
    assert judged is not None
    names = list(judged.channels)
    rows = (len(names) + 1) // 2
    log = judged.log
    # Each window ends with a blank, so that lines break where the model restarts.
    t = np.concatenate([np.append(log.times(w), log.times(w)[-1]) for w in range(len(log.spans))])
    with pen.house_style():
        figure = pen.new_figure(0.85 + 1.0 * rows)
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
            line(axes, t, error, color=pen.MEASURED, linewidth=0.6, label="measured less predicted")
            # Gaps between windows are not numbers, and no sample of them is outside.
            with np.errstate(invalid="ignore"):
                _dots(axes, t, error, np.abs(error) > half)
            axes.set_ylabel(f"{name}, {unit}", color=pen.RESIDUAL if channel.fails else pen.INK)
            _sensible(axes, np.concatenate([error, half, -half]))
            p = f"p = {channel.p:.2g}" if channel.p >= 1e-4 else "p < 0.0001"
            pen.panel_title(
                axes, "fails" if channel.fails else "", f"{100.0 * channel.outside:.1f} % outside, {p}"
            )
            if channel.fails:
                axes.title.set_color(pen.RESIDUAL)
                axes.set_title("fails", loc="left", fontweight="bold", color=pen.RESIDUAL)
        for axes in panels.ravel()[len(names) :]:
            axes.set_visible(False)
        for axes in panels[-1]:
            axes.set_xlabel("time, s")
        panels[0, 0].set_xlim(t[0], t[-1])
        pen.legend_below(figure, panels[0, 0].get_legend_handles_labels()[0], fontsize=7)
        ahead = log.since_restart(0)[-1]
        title = f"{verdict.log.trial.name}: measured less predicted, restarted every {ahead:.3g} s"
        pen.heading(figure, title)
    return figure


def suspect_bars(verdict: LogVerdict) -> Figure:
    """Figure of the suspects: error that each leaves, in units of a valid model's, the least first."""
    import textwrap

    shown = verdict.suspects[:8]  # bars of a page, the likeliest first
    with pen.house_style():
        figure = pen.new_figure(0.9 + 0.42 * len(shown))
        axes = figure.subplots()
        rows = np.arange(len(shown))
        left = [suspect.left for suspect in shown]
        before = left[0] / max(1.0 - shown[0].gain, 1e-12) ** 0.5
        colours = [pen.THIRD if k == 0 else pen.SIMULATED for k in rows]
        axes.barh(rows, left, color=colours, height=0.55, alpha=0.85, linewidth=0)
        axes.axvline(1.0, color=pen.MEASURED, linewidth=0.8, linestyle=(0, (3, 2)))
        axes.axvline(before, color=pen.RESIDUAL, linewidth=1.0)
        ends = axes.get_xaxis_transform()
        axes.text(1.0, 1.01, "as a valid model", transform=ends, fontsize=6.5, color=pen.MEASURED, ha="right")
        axes.text(before, 1.01, "model as it is", transform=ends, fontsize=6.5, color=pen.RESIDUAL, ha="left")
        for row, suspect in zip(rows, shown, strict=True):
            share = f"{100.0 * suspect.gain:.{1 if suspect.gain > 0.99 else 0}f} %"
            x = max(suspect.left, 1.0) + 0.012 * before
            look: pen.Style = {"ha": "left", "color": pen.REMARK}
            if suspect.left > 0.2 * before:  # beside a long bar it would cross the line of the model
                x, look = suspect.left - 0.012 * before, {"ha": "right", "color": "white"}
            axes.text(x, float(row), share, va="center", fontsize=6.5, **look)
        named = [textwrap.fill(_SIGN.sub("\N{MINUS SIGN}", suspect.change), 62) for suspect in shown]
        axes.set_yticks(rows, named, fontsize=7)
        axes.invert_yaxis()
        axes.grid(False, axis="y")
        axes.set_xlim(0.0, 1.25 * max(before, 1.0))
        axes.set_xlabel("error left, over a valid model's; at its end the share explained")
        pen.heading(figure, f"{verdict.log.trial.name}: what may have changed")
    return figure


def _shade(axes: Axes, t: Array, lower: Array, upper: Array, label: str) -> None:
    every = max(1, len(t) // 4000)
    pen.band(axes, t[::every], lower[::every], upper[::every], _BAND, zorder=0.6, label=label)


def _dots(axes: Axes, t: Array, y: Array, mask: Mask) -> None:
    at, values = t[mask], y[mask]
    every = max(1, len(at) // 1500)  # markers of a panel: more are one blot
    dot: pen.Style = {"linestyle": "none", "marker": ".", "markersize": 1.8, "color": pen.RESIDUAL}
    axes.plot(at[::every], values[::every], label="log outside", zorder=3, **dot)


def _sensible(axes: Axes, values: Array) -> None:
    """Limits that hold what matters of the values: a turn on the spot must not flatten a mission."""
    good = values[np.isfinite(values)]
    if not len(good):
        pen.blank(axes, "the log has no samples of it", color=pen.FAINT)
        return
    # A fortieth at either end may leave the panel, beyond half of the span that the others take.
    low, high = np.quantile(good, (0.025, 0.975))
    span = max(float(high - low), 1e-6)
    low, high = max(good.min(), low - 0.5 * span), min(good.max(), high + 0.5 * span)
    axes.set_ylim(low - 0.08 * span, high + 0.08 * span)


def _broken(parts: list[Array]) -> Array:
    """Windows one after the other, a gap between them."""
    return np.concatenate([np.append(part, np.nan) for part in parts])


_SHOWN = ("rate wanted", "output", "acceleration wanted", "throttle", "motor 1", "motor 6")


def replay_figure(replay: Replay) -> Figure:
    """Figure of the quantities that tell most, and of what is not met, in the order of the signal."""
    chosen = [quantity for kind in _SHOWN if (quantity := _first(replay, kind)) is not None]
    # What is not met is shown, whatever its kind; a log in MANUAL may have none of the usual ones.
    spare = 3
    unmet = [quantity for quantity in replay.quantities if not quantity.holds and quantity not in chosen]
    chosen = sorted([*chosen, *unmet[:spare]] or replay.quantities[:spare], key=replay.quantities.index)
    with pen.house_style():
        figure = pen.new_figure(0.6 + 1.25 * len(chosen))
        panels = figure.subplots(len(chosen), 2, sharex=True, squeeze=False, width_ratios=(2.0, 1.0))
        for (left, right), quantity in zip(panels, chosen, strict=True):
            t = quantity.t - replay.quantities[0].t[0]
            shown = np.where(quantity.judged, quantity.replayed, np.nan)
            left.plot(t, quantity.logged, color=pen.MEASURED, label="logged")
            left.plot(t, shown, color=pen.SIMULATED, linestyle="--", label="replayed")
            right.plot(t, shown - quantity.logged, color=pen.RESIDUAL, linewidth=0.6)
            most = 1.3 * max(float(np.nanmax(np.abs(shown - quantity.logged))), quantity.limit)
            right.axhspan(-quantity.limit, quantity.limit, color="0.92", zorder=0)
            right.set_ylim(-most, most)
            printed = quantity.unit.replace("us", "µs").replace("m/s2", "m/s²")
            unit = "" if quantity.unit == "1" else f", {printed}"
            pen.panel_title(left, f"{quantity.controller}: {quantity.name}{unit}")
            pen.panel_title(right, f"difference, limit {quantity.limit:.2g}")
            right.locator_params(axis="x", nbins=4)
        panels[0, 0].legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2)
        for panel in panels[-1]:
            panel.set_xlabel("time, s")
    return figure


def _first(replay: Replay, kind: str) -> Quantity | None:
    """The quantity of a kind that is drawn: of several axes that of yaw, else the first."""
    same = [quantity for quantity in replay.quantities if quantity.name == kind]
    return next(
        (quantity for quantity in same if quantity.controller.endswith("yaw")), same[0] if same else None
    )


def envelope_figure(tuning: LogTuning) -> Figure:
    """Figure of the log's loop errors in the envelope of the flights, a row per channel."""
    shares = tuning.reflight.shares
    with pen.house_style():
        figure = pen.new_figure(0.8 + 1.15 * len(shares))
        panels = np.atleast_1d(figure.subplots(len(shares), 1, sharex=True))
        first = min(float(envelope.t[0]) for envelope in tuning.reflight.envelopes)
        for panel, share in zip(panels, shares, strict=True):
            own = [envelope for envelope in tuning.reflight.envelopes if envelope.channel == share.channel]
            for k, envelope in enumerate(own):
                t = envelope.t - first
                words = ("95 % of the flights", "median", "log") if k == 0 else (None, None, None)
                pen.band(panel, t, envelope.lower, envelope.upper, pen.SIMULATED, alpha=0.25, label=words[0])
                panel.plot(t, envelope.middle, color=pen.SIMULATED, linewidth=0.7, label=words[1])
                panel.plot(t, envelope.measured, color=pen.MEASURED, linewidth=0.7, label=words[2])
                if envelope.held_out.any():
                    kept_out = t[envelope.held_out]
                    panel.axvspan(float(kept_out[0]), float(kept_out[-1]), color="0.94", zorder=0)
            most = 1.15 * max(
                float(np.quantile(np.abs([envelope.lower, envelope.upper, envelope.measured]), 0.998))
                for envelope in own
            )
            panel.set_ylim(-most, most)
            outside = share.fit if np.isnan(share.held_out) else share.held_out
            unit = share.unit.replace("deg", "°")
            title = f"{share.channel} error, {unit}: {100 * outside:.1f} % of the held-out rows outside"
            pen.panel_title(panel, title)
        panels[0].legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=3)
        panels[-1].set_xlabel("time, s (grey: held out)")
    return figure


def steps_figure(tuning: LogTuning) -> Figure:
    """Figure of set-point steps in corridors over the missions of the first course, before and after."""
    from seatrial.ardusub.tuning import SIZES_DEG, corridors_of, slew_of

    names = list(tuning.before.bands)
    slew = slew_of(tuning.parameters)
    corridors = corridors_of(tuning.rise_s, size_deg=SIZES_DEG[0], slew_deg_s=slew)
    with pen.house_style():
        figure = pen.new_figure(0.8 + 1.5 * len(names))
        panels = figure.subplots(len(names), 2, sharex=True, sharey="row", squeeze=False)
        for name, row in zip(names, panels, strict=True):
            for panel, missions, words in zip(
                row, (tuning.before, tuning.after), ("before", "after"), strict=True
            ):
                least, low, middle, high, largest = missions.bands[name]
                t = missions.since
                lower, upper = corridors[name].sampled(t)
                pen.band(panel, t, least, largest, pen.SIMULATED, alpha=0.15, label="all missions")
                pen.band(panel, t, low, high, pen.SIMULATED, alpha=0.3, label="95 %")
                panel.plot(t, middle, color=pen.SIMULATED, linewidth=0.9, label="median")
                panel.step(t, lower, color="0.2", linewidth=0.8, where="post", label="corridor")
                panel.step(t, upper, color="0.2", linewidth=0.8, where="post")
                panel.set_ylim(-0.4, 1.6)
                worst, _, share = missions.row(name)
                pen.panel_title(
                    panel, f"{name}, {words}: worst {worst:.2f} s, in corridor {100 * share:.0f} %"
                )
        for panel in panels[-1]:
            panel.set_xlabel("time since the step, s")
        panels[0, 1].legend(loc="lower right", ncols=2)
    return figure
