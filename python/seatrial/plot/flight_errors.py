"""Errors of guidance over a flight: cross-track and vertical, and how they are distributed once settled.

Held by `tests/test_flight_figures.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.plot.flight_time import event_lines, leg_lines, line, settled, shade
from seatrial.plot.style import MEASURED, RESIDUAL, SHADE, SIMULATED, house_style, new_figure, panel_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.flight.flight import Flight

__all__ = ["flight_errors"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_ERRORS = (
    ("cross_track", "cross-track error", "$y_e$, m", "positive: to starboard of the path"),
    ("vertical", "vertical error", "$z_e$, m", "positive: below the path"),
)
_BINS = 41
_SHARE = 95.0


def flight_errors(flight: Flight) -> Figure:
    """Figure of the errors against the path over time, and of their distribution on settled legs."""
    counts = settled(flight)
    under_way = flight.under_way & ~flight.holding
    with house_style():
        figure = new_figure(3.7)
        panels = figure.subplots(2, 2, width_ratios=(3.0, 1.0))
        for (key, name, label, sign), (axes, beside) in zip(_ERRORS, panels, strict=True):
            error = np.asarray(flight.errors[key])
            shade(axes, flight.t, counts, SHADE)
            leg_lines(axes, flight, numbers=axes is panels[0, 0])
            axes.axhline(0.0, color=MEASURED, linewidth=0.6, zorder=1)
            line(axes, flight.t, np.where(under_way, error, np.nan), color=SIMULATED)
            event_lines(axes, flight)
            axes.set_ylabel(label)
            axes.set_xlim(flight.t[0], flight.t[-1])
            axes.set_title(name, loc="left", fontweight="bold", pad=9)
            axes.set_title(sign, loc="right", fontsize=7.5, color="#404040", pad=9)
            _distribution(beside, error[counts & np.isfinite(error)], label)
        panels[1, 0].set_xlabel("time, s; shaded: settled, the second half of a straight leg")
        figure.suptitle(f"{flight.vehicle.name}: {flight.mission.name}", x=0.01, ha="left", fontweight="bold")
    return figure


def _distribution(axes: Axes, error: Array, label: str) -> None:
    """Histogram of the settled error with its mean and the band that holds 95 % of it."""
    axes.set_xlabel(label)
    axes.set_ylabel("share, %")
    if not len(error):
        panel_title(axes, "settled")
        axes.text(0.5, 0.5, "no leg settled", ha="center", transform=axes.transAxes, fontsize=7)
        return
    reach = max(float(np.abs(error).max()), 1e-3)
    axes.hist(
        error,
        bins=list(np.linspace(-reach, reach, _BINS)),
        weights=np.full(len(error), 100.0 / len(error)),
        color=SIMULATED,
        alpha=0.75,
        linewidth=0,
    )
    tail = 0.5 * (100.0 - _SHARE)
    low, high = np.percentile(error, (tail, 100.0 - tail))
    mean = float(error.mean())
    for at, dashes in ((low, (0, (2, 1.5))), (high, (0, (2, 1.5))), (mean, "-")):
        axes.axvline(at, color=RESIDUAL, linewidth=0.9, linestyle=dashes)
    axes.set_xlim(-reach, reach)
    axes.set_title("settled", loc="left", fontweight="bold", pad=9)
    axes.set_xlabel(f"{label}\n{_SHARE:.0f} %: {_metres(low)} to {_metres(high)}")


def _metres(value: float) -> str:
    text = f"{value:+.2f}" if abs(value) < 9.995 else f"{value:+.1f}"
    return text.replace("-", "\N{MINUS SIGN}")
