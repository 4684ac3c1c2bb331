"""Parts of figures over the time of a flight: thinned lines, legs, events, modes, what settled."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.plot.style import FAINT, FOURTH, RESIDUAL, SECOND, SIMULATED, THIRD

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from seatrial.flight.flight import Flight

__all__ = [
    "Event",
    "event_lines",
    "events",
    "leg_lines",
    "line",
    "mode_strip",
    "mode_style",
    "settled",
    "shade",
    "spans",
    "strip_rows",
    "thinned",
]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_MOST_POINTS, _MOST_EVENTS = 2400, 7
_MOST_LEGS = 50
_EVENT_MARKS = "XPD*v^<>"
_MODES: tuple[tuple[str, float, Any], ...] = (
    (SECOND, 2.2, "-"),
    (SIMULATED, 1.2, "-"),
    (THIRD, 1.2, (0, (4, 1.2))),
    (FOURTH, 1.2, (0, (1.4, 1.2))),
)


@dataclass(frozen=True)
class Event:
    """Something that happened: time in s, words, the marker that shows it."""

    t_s: float
    words: str
    mark: str


def mode_style(mode: int, count: int) -> dict[str, Any]:
    """Line of a mode: colour, width and dashes, which a grey print tells apart."""
    colour, width, dashes = _MODES[1 if count == 1 else min(mode, len(_MODES) - 1)]
    return {"color": colour, "linewidth": width, "linestyle": dashes}


def thinned(t: Array, y: Array) -> tuple[Array, Array]:
    """A curve with so few points as a page can show: the least and the largest of every short while."""
    size = math.ceil(2 * len(t) / _MOST_POINTS)
    if size < 4:
        return t, y
    full = len(t) // size * size
    rows = np.arange(full).reshape(-1, size)
    low = np.where(np.isnan(y), np.inf, y)[rows].argmin(axis=1)
    high = np.where(np.isnan(y), -np.inf, y)[rows].argmax(axis=1)
    picked = np.sort(np.stack([rows[:, 0] + low, rows[:, 0] + high], axis=1), axis=1).ravel()
    kept = np.unique(np.concatenate([[0], picked, np.arange(full, len(t)), [len(t) - 1]]))
    return t[kept], y[kept]


def line(axes: Axes, t: Array, y: Array, **style: Any) -> None:
    """Curve over time, thinned."""
    axes.plot(*thinned(t, y), **style)


def spans(t: Array, mask: Mask) -> list[tuple[float, float]]:
    """Beginning and duration, s, of every time over which a mask (n,) holds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    step = float(t[1] - t[0]) if len(t) > 1 else 1.0
    return [
        (float(t[first]), (last - first) * step) for first, last in zip(edges[::2], edges[1::2], strict=True)
    ]


def shade(axes: Axes, t: Array, mask: Mask, colour: str) -> None:
    """Times over which a mask (n,) holds as one shade behind a panel; what a page cannot part is joined."""
    least = 0.001 * float(t[-1] - t[0])
    joined: list[tuple[float, float]] = []
    for begin, duration in spans(t, mask):
        if joined and begin - sum(joined[-1]) < least:
            joined[-1] = (joined[-1][0], begin + duration - joined[-1][0])
        else:
            joined.append((begin, duration))
    axes.broken_barh(
        joined, (0.0, 1.0), facecolors=colour, linewidth=0, zorder=0.5, transform=axes.get_xaxis_transform()
    )


def settled(flight: Flight) -> Mask:
    """Rows on the second half of a straight leg, where the errors of guidance count, (n,)."""
    path = flight.route
    half = np.array([
        0.0 if stop.task == "circle" else 0.5 * math.hypot(*(stop.position[:2] - path.before(k)[:2]))
        for k, stop in enumerate(path.stops)
    ])
    leg = np.clip(flight.leg, 0, len(half) - 1)
    return np.asarray(flight.under_way & ~flight.holding & (flight.distance < half[leg]))


def leg_lines(axes: Axes, flight: Flight, *, numbers: bool = False, room: float = 0.028) -> None:
    """Where legs begin, with their numbers above the panel no closer than `room`, a share of its width."""
    rows = np.flatnonzero(np.diff(flight.leg) != 0) + 1
    few = len(rows) <= _MOST_LEGS
    if few:
        for row in rows:
            axes.axvline(float(flight.t[row]), color=FAINT, linewidth=0.5, zorder=0.9)
    if not numbers:
        return
    begins = np.concatenate([[0], rows])
    ends = np.concatenate([rows, [len(flight.t) - 1]])
    least, last = room * float(flight.t[-1] - flight.t[0]), -math.inf
    for first, end in zip(begins, ends, strict=True):
        middle = 0.5 * float(flight.t[first] + flight.t[end])
        if middle - last < least:
            continue
        # The word stands before the first number: left of the panel are the labels of its axis.
        alone = last > -math.inf
        _above(axes, middle, str(flight.leg[first] + 1) if alone else f"leg {flight.leg[first] + 1}")
        last = middle if alone else middle + 0.5 * least


def _above(axes: Axes, t: float, said: str) -> None:
    """Small print above a panel."""
    axes.annotate(
        said,
        (t, 1.0),
        xycoords=axes.get_xaxis_transform(),
        xytext=(0, 1.5),
        textcoords="offset points",
        ha="center",
        fontsize=5.5,
        color="#595959",
    )


def events(flight: Flight) -> list[Event]:
    """Faults, outages and reactions of a flight in order of time; of many the first."""
    what = flight.circumstances
    found = [(fault.at_s, fault.sentence()) for fault in what.faults]
    found += [(outage.from_s, outage.sentence()) for outage in what.outages]
    found += [
        (alert.t_s, f"{alert.reaction} at {alert.t_s:.0f} s: {alert.cause.replace('_', ' ')}")
        for alert in flight.alerts
    ]
    found = sorted(one for one in found if one[0] <= flight.t[-1])[:_MOST_EVENTS]
    return [Event(t, words, mark) for (t, words), mark in zip(found, _EVENT_MARKS, strict=False)]


def event_lines(axes: Axes, flight: Flight) -> None:
    """Times of the events, with their markers at the panel's upper edge."""
    for event in events(flight):
        axes.axvline(event.t_s, color=RESIDUAL, linewidth=0.7, linestyle=(0, (2, 1.5)), zorder=1.2)
        axes.plot(
            event.t_s,
            0.97,
            event.mark,
            color=RESIDUAL,
            markersize=4.0,
            markeredgecolor="white",
            markeredgewidth=0.4,
            transform=axes.get_xaxis_transform(),
            zorder=6,
            clip_on=False,
        )


def strip_rows(flight: Flight) -> list[tuple[str, Mask, str]]:
    """Rows of the strip: modes, station-keeping and reactions that occur, when, and in which colour."""
    count = len(flight.modes)
    rows = [
        (name, flight.mode == k, str(mode_style(k, count)["color"]))
        for k, name in enumerate(flight.modes)
        if (flight.mode == k).any()
    ]
    held = flight.holding & ~flight.done
    if held.any():
        rows.append(("holding", held, "#7A8791"))
    names = {1: "hold", 2: "surface", 3: "abort"}
    rows += [
        (f"reaction: {name}", flight.alert == level, RESIDUAL)
        for level, name in names.items()
        if (flight.alert == level).any()
    ]
    return rows


def mode_strip(axes: Axes, flight: Flight) -> None:
    """Modes, station-keeping and reactions over time, a row each."""
    rows = strip_rows(flight)
    for k, (_, mask, colour) in enumerate(rows):
        axes.broken_barh(
            spans(flight.t, mask), (len(rows) - 1 - k - 0.36, 0.72), facecolors=colour, linewidth=0
        )
    axes.set_yticks(range(len(rows))[::-1], [name for name, _, _ in rows])
    axes.set_ylim(-0.55, len(rows) - 0.45)
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False)
    axes.set_xlabel("time, s")
