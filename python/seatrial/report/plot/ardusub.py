"""Figures of ArduSub beside a log: the replay, the envelope of the loop errors, steps before and after.

Held by ``tests/ardusub/test_replay.py`` and ``tests/ardusub/test_from_log.py``.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from seatrial.ardusub.from_log import LogTuning
from seatrial.report.plot.style import MEASURED, RESIDUAL, SIMULATED, house_style, new_figure, panel_title

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from seatrial.ardusub.comparison import Quantity
    from seatrial.ardusub.log_replay import Replay

_UNMET = 3  # checks that are not met and are shown beside the usual ones

_SHOWN = ("rate wanted", "output", "acceleration wanted", "throttle", "motor 1", "motor 6")


def drawings(result: Replay | LogTuning) -> dict[str, Callable[[], Figure]]:
    """Figures by name: the replay; of a tuning from a log also the envelope, and steps before and after."""
    if not isinstance(result, LogTuning):
        return {"replay": partial(replay_figure, result)}
    return {
        "replay": partial(replay_figure, result.replay),
        "envelope": partial(envelope_figure, result),
        "steps": partial(steps_figure, result),
    }


def replay_figure(replay: Replay) -> Figure:
    """Figure of the quantities that tell most, and of what is not met, in the order of the signal."""
    chosen = [quantity for kind in _SHOWN if (quantity := _first(replay, kind)) is not None]
    # What is not met is shown, whatever its kind; a log in MANUAL may have none of the usual ones.
    chosen += [quantity for quantity in replay.quantities if not quantity.holds and quantity not in chosen][
        :_UNMET
    ]
    chosen = sorted(chosen or replay.quantities[:_UNMET], key=replay.quantities.index)
    with house_style():
        figure = new_figure(0.6 + 1.25 * len(chosen))
        panels = figure.subplots(len(chosen), 2, sharex=True, squeeze=False, width_ratios=(2.0, 1.0))
        for (left, right), quantity in zip(panels, chosen, strict=True):
            t = quantity.t - replay.quantities[0].t[0]
            shown = np.where(quantity.judged, quantity.replayed, np.nan)
            left.plot(t, quantity.logged, color=MEASURED, label="logged")
            left.plot(t, shown, color=SIMULATED, linestyle="--", label="replayed")
            right.plot(t, shown - quantity.logged, color=RESIDUAL, linewidth=0.6)
            most = 1.3 * max(float(np.nanmax(np.abs(shown - quantity.logged))), quantity.limit)
            right.axhspan(-quantity.limit, quantity.limit, color="0.92", zorder=0)
            right.set_ylim(-most, most)
            unit = (
                ""
                if quantity.unit == "1"
                else f", {quantity.unit.replace('us', 'µs').replace('m/s2', 'm/s²')}"
            )
            panel_title(left, f"{quantity.controller}: {quantity.name}{unit}")
            panel_title(right, f"difference, limit {quantity.limit:.2g}")
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
    with house_style():
        figure = new_figure(0.8 + 1.15 * len(shares))
        panels = np.atleast_1d(figure.subplots(len(shares), 1, sharex=True))
        first = min(float(envelope.t[0]) for envelope in tuning.reflight.envelopes)
        for panel, share in zip(panels, shares, strict=True):
            own = [envelope for envelope in tuning.reflight.envelopes if envelope.channel == share.channel]
            for k, envelope in enumerate(own):
                t = envelope.t - first
                panel.fill_between(
                    t, envelope.lower, envelope.upper, color=SIMULATED, alpha=0.25, linewidth=0.0,
                    label="95 % of the flights" if k == 0 else None,
                )  # fmt: skip
                panel.plot(
                    t, envelope.middle, color=SIMULATED, linewidth=0.7, label="median" if k == 0 else None
                )
                panel.plot(
                    t, envelope.measured, color=MEASURED, linewidth=0.7, label="log" if k == 0 else None
                )
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
            panel_title(panel, title)
        panels[0].legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=3)
        panels[-1].set_xlabel("time, s (grey: held out)")
    return figure


def steps_figure(tuning: LogTuning) -> Figure:
    """Figure of set-point steps in corridors over the missions of the first course, before and after."""
    from seatrial.ardusub.tuning import SIZES_DEG, corridors_of, slew_of

    names = list(tuning.before.bands)
    slew = slew_of(tuning.parameters)
    corridors = corridors_of(tuning.rise_s, size_deg=SIZES_DEG[0], slew_deg_s=slew)
    with house_style():
        figure = new_figure(0.8 + 1.5 * len(names))
        panels = figure.subplots(len(names), 2, sharex=True, sharey="row", squeeze=False)
        for (name, row), last in zip(zip(names, panels, strict=True), range(len(names)), strict=True):
            for panel, missions, words in zip(
                row, (tuning.before, tuning.after), ("before", "after"), strict=True
            ):
                least, low, middle, high, largest = missions.bands[name]
                t = missions.since
                lower, upper = corridors[name].sampled(t)
                panel.fill_between(
                    t, least, largest, color=SIMULATED, alpha=0.15, linewidth=0.0, label="all missions"
                )
                panel.fill_between(t, low, high, color=SIMULATED, alpha=0.3, linewidth=0.0, label="95 %")
                panel.plot(t, middle, color=SIMULATED, linewidth=0.9, label="median")
                panel.step(t, lower, color="0.2", linewidth=0.8, where="post", label="corridor")
                panel.step(t, upper, color="0.2", linewidth=0.8, where="post")
                panel.set_ylim(-0.4, 1.6)
                worst, _, share = missions.row(name)
                panel_title(panel, f"{name}, {words}: worst {worst:.2f} s, in corridor {100 * share:.0f} %")
            if last == len(names) - 1:
                for panel in row:
                    panel.set_xlabel("time since the step, s")
        panels[0, 1].legend(loc="lower right", ncols=2)
    return figure
