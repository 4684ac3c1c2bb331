"""Cross-track error of all missions of a verification: how often it is exceeded, and the p95 of each mission.

Where the vehicle really was stands beside what guidance perceived: the difference is the sensors' own.

Held by `tests/report/test_verification_figures.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.arrays import Array
from seatrial.report.plot.style import (
    FAINT,
    ON_WHITE,
    RESIDUAL,
    SECOND,
    SIMULATED,
    Style,
    blank,
    house_style,
    new_figure,
    panel_title,
)
from seatrial.report.plot.style import heading as figure_heading
from seatrial.statistics.proportions import share

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def exceedance(counts: ArrayLike, edges: ArrayLike) -> Array:
    """Share of the samples above each rising edge, (E,), m.

    `counts` (E + 1,): first the samples below the first edge, last those above the last one.

    Examples
    --------
    >>> exceedance([6, 3, 1], [0.1, 0.5]).tolist()
    [0.4, 0.1]
    """
    number, edge = np.asarray(counts, float), np.asarray(edges, float)
    if number.shape != (len(edge) + 1,):
        raise ValueError(f"counts: expected one more than the {len(edge)} edges, found shape {number.shape}")
    total = number.sum()
    above = total - np.cumsum(number)[:-1]
    return np.asarray(above / total if total else np.full(len(edge), np.nan))


def quantile_of_counts(counts: ArrayLike, edges: ArrayLike, *, share_below: float) -> float:
    """Value below which a share of the samples lies, m.

    Within a bin the logarithm of the share above is linear, as the figure draws it; in the last bin that has
    samples, where nothing is left above, the share itself. Infinite above the last edge, not a number without
    samples.
    """
    edge, above = np.append(0.0, np.asarray(edges, float)), np.append(1.0, exceedance(counts, edges))
    wanted = 1.0 - share_below
    if not above[-1] <= wanted:
        return float("nan") if np.isnan(above[-1]) else float("inf")
    last = int(np.argmax(above <= wanted))
    high, low = above[last - 1], above[last]
    if low > 0.0:
        high, low, wanted = np.log(high), np.log(low), np.log(wanted)
    return float(edge[last - 1] + (edge[last] - edge[last - 1]) * (high - wanted) / (high - low))


def cross_track(
    counts: ArrayLike,
    edges: ArrayLike,
    *,
    p95_m: ArrayLike,
    perceived: ArrayLike | None = None,
    of: str = "true",
    threshold_m: float | None = None,
    heading: str = "",
) -> Figure:
    """Figure of the cross-track error on settled legs of all missions together, and of each mission's p95.

    `counts` and `perceived`, (k, E + 1) or (E + 1,), are samples of |cross-track error| between `edges` (E,),
    m: where the vehicle really was, and as guidance perceived it. `p95_m` (k,) is of the error that `of`
    names, not a number of a mission that diverged; a requirement allows `threshold_m`.
    """
    pooled = np.atleast_2d(np.asarray(counts, float)).sum(axis=0)
    perceived_counts = None if perceived is None else np.atleast_2d(np.asarray(perceived, float)).sum(axis=0)
    edge, p95 = np.asarray(edges, float), np.asarray(p95_m, float)
    with house_style():
        figure = new_figure(2.7)
        curve, beside = figure.subplots(1, 2, width_ratios=(1.35, 1.0))
        _curve(curve, pooled, edge, threshold_m, perceived_counts)
        _histogram(beside, p95, threshold_m, of)
        figure_heading(figure, heading)
    return figure


def _curve(
    axes: Axes, counts: Array, edges: Array, threshold_m: float | None, perceived_counts: Array | None
) -> None:
    above = exceedance(counts, edges)
    seen = above > 0.0
    panel_title(axes, "all samples", "settled legs of all missions")
    axes.set_xlabel("cross-track error $|y_e|$, m")
    axes.set_ylabel("share of the samples above, %")
    if not seen.any():
        blank(axes, "no leg settled")
        return
    last = min(int(np.flatnonzero(seen)[-1]) + 1, len(edges) - 1)
    floor = 10.0 ** np.floor(np.log10(100.0 * above[seen].min()))
    x, y = np.append(0.0, edges[seen]), np.append(100.0, 100.0 * above[seen])
    if perceived_counts is not None:
        _perceived(axes, perceived_counts, edges)
    axes.plot(x, y, color=SIMULATED, label="true")
    for part in (0.50, 0.95, 0.99):  # shares of the samples whose error is marked
        value = quantile_of_counts(counts, edges, share_below=part)
        if not np.isfinite(value):
            continue
        level = 100.0 * (1.0 - part)
        axes.plot([value, value], [floor, level], color=FAINT, linewidth=0.8, linestyle=(0, (2, 1.5)))
        axes.plot(value, level, "o", color=SIMULATED, markersize=4.0)
        words, small = f"p{100.0 * part:.0f} {value:.2f} m", Style(fontsize=6.5, zorder=5, bbox=ON_WHITE)
        axes.annotate(words, (value, level), (5, 2), textcoords="offset points", **small)
    axes.set_yscale("log")
    axes.set_ylim(floor, 140.0)
    axes.set_xlim(0.0, 1.15 * max(edges[last], threshold_m or 0.0))
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    _threshold(axes, threshold_m, at=0.0)
    if perceived_counts is not None:
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.21), ncols=2, borderaxespad=0.0)


def _perceived(axes: Axes, counts: Array, edges: Array) -> None:
    """The error that guidance perceived, beside the true one."""
    above = exceedance(counts, edges)
    some = above > 0.0
    look = Style(color=SECOND, linewidth=1.0, linestyle=(0, (4, 1.5)), label="as guidance perceived it")
    axes.plot(np.append(0.0, edges[some]), np.append(100.0, 100.0 * above[some]), **look)


def _histogram(axes: Axes, p95: Array, threshold_m: float | None, of: str) -> None:
    known = p95[np.isfinite(p95)]
    lost = len(p95) - len(known)
    panel_title(axes, "p95 of each mission", f"{lost} without one" if lost else "")
    axes.set_xlabel(f"p95 of $|y_e|$, {of}, m")
    axes.set_ylabel("missions")
    if not len(known):
        blank(axes, "no leg settled")
        return
    reach = 1.02 * max(float(known.max()), 1e-3, 1.08 * (threshold_m or 0.0))
    # A bin ends at the threshold: no bar is partly above it.
    bins = np.linspace(0.0, reach, 41)
    if threshold_m:
        width = threshold_m / max(1.0, round(threshold_m / (reach / 40)))
        bins = np.arange(0.0, reach + width, width)
    number, _ = np.histogram(known, bins)
    centre = 0.5 * (bins[1:] + bins[:-1])
    over = centre > (threshold_m if threshold_m is not None else np.inf)
    width = float(bins[1] - bins[0])
    axes.bar(centre[~over], number[~over], width=width, color=SIMULATED, alpha=0.8, linewidth=0.0)
    axes.bar(centre[over], number[over], width=width, color=RESIDUAL, linewidth=0.0)
    # Missions are whole, and a single one beyond the threshold must be seen.
    axes.set_yscale("symlog", linthresh=1.0)
    axes.set_ylim(0.0, 2.0 * max(number.max(), 1))
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.set_xlim(0.0, bins[-1])
    _threshold(axes, threshold_m)
    if threshold_m is not None:
        more = int((known > threshold_m).sum()) + lost
        above = f"above {threshold_m:g} m: {more} of {len(p95)} ({share(more / len(p95))})"
        axes.set_xlabel(f"p95 of $|y_e|$, {of}, m\n{above}")


def _threshold(axes: Axes, threshold_m: float | None, *, at: float = 1.0) -> None:
    if threshold_m is None:
        return
    axes.axvline(threshold_m, color=RESIDUAL, linewidth=1.1)
    look = Style(fontsize=6.5, va="top" if at else "bottom", color=RESIDUAL, zorder=5)
    place = Style(xycoords=("data", "axes fraction"), textcoords="offset points")
    box = ON_WHITE | {"pad": 0.4}
    axes.annotate("allowed", (threshold_m, at), (3, -2 if at else 2), bbox=box, **look, **place)
