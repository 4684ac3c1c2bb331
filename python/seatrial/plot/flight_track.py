"""The track of a flight: from above with the planned path, and its depth over time.

Held by `tests/test_flight_figures.py`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.plot.flight_time import event_lines, events, leg_lines, line, mode_style, spans
from seatrial.plot.plan_page import BOTTOM, current_arrow, layout, page_legend, page_title, profile_axes
from seatrial.plot.plan_view import extent, mark_size, new_plan, waypoint_label, waypoints
from seatrial.plot.planned_path import planned_path
from seatrial.plot.style import MEASURED, RESIDUAL, SECOND, SIMULATED, house_style, new_figure, panel_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.flight.flight import Flight
    from seatrial.plot.plan_view import Plan
    from seatrial.plot.planned_path import PlannedPath

__all__ = ["flight_track"]

Array = NDArray[np.float64]

_INK = "#262626"


def flight_track(flight: Flight) -> Figure:
    """Figure of a flight's track: from above with plan, modes and events, and the depth over time."""
    what = flight.circumstances
    path = planned_path(flight.mission, seabed=what.seabed)
    acceptance = np.array([stop.acceptance for stop in flight.route.stops])
    reach = np.concatenate([path.places[1:] + acceptance[:, None], path.places[1:] - acceptance[:, None]])
    flown = flight.position[np.isfinite(flight.position).all(axis=1)]
    corners = extent(path.points, flown, reach)
    page = layout(corners, _labels(flight, path))
    with house_style():
        figure = new_figure(page.height, constrained=False)
        plan = new_plan(figure, page.plan, corners)
        waypoints(plan, path, acceptance, flown)
        _flown(plan, flight)
        panel_title(plan.axes, "track", _remark(flight))
        profile = profile_axes(figure, page)
        _depth(profile, flight, path)
        page_title(figure, page, f"{flight.vehicle.name}: {flight.mission.name}")
        current_arrow(figure, page, what.current)
        page_legend(figure, (plan.axes, profile), page)
    return figure


def _labels(flight: Flight, path: PlannedPath) -> list[str]:
    """Words that the legend will have, as many and as long."""
    flown = [f"flown: {flight.modes[k]}" for k in np.unique(flight.mode)]
    plain = ["planned path", waypoint_label(path), "sphere of acceptance", "start", "end", "station kept"]
    return [*plain, "desired depth", "flown depth", "depth limit", "bottom", *flown] + [
        event.words for event in events(flight)
    ]


def _remark(flight: Flight) -> str:
    """How long and how far, in the title."""
    way = flight.figures.get("distance_m", math.nan)
    length = f"{way / 1e3:.2f} km" if way >= 1e3 else f"{way:.0f} m"
    # Short: it shares its line with the panel's name.
    verdict = flight.verdict.removeprefix("flown to its end, ")
    return f"{verdict}, {length} in {flight.t[-1]:.0f} s"


def _flown(plan: Plan, flight: Flight) -> None:
    """Track by mode, start and end, stations kept, events."""
    axes, place = plan.axes, flight.position
    keep = _apart(plan.page(place), 0.004)
    for k, name in enumerate(flight.modes):
        style = mode_style(k, len(flight.modes))
        mask = flight.mode == k
        if not mask.any():
            continue
        joined = mask | np.concatenate([[False], mask[:-1]])
        rows = keep | (joined & ~np.roll(joined, 1)) | (joined & ~np.roll(joined, -1))
        east, north = (np.where(joined, place[:, i], np.nan)[rows] for i in (1, 0))
        axes.plot(east, north, label=f"flown: {name}", zorder=3.0 + 0.1 * k, **style)
    held = [round(t / flight.period_s) for t, _ in spans(flight.t, flight.holding & ~flight.done)]
    if held:
        axes.plot(
            place[held, 1],
            place[held, 0],
            "o",
            color="white",
            markeredgecolor=_INK,
            markersize=4.5,
            markeredgewidth=0.9,
            label="station kept",
            zorder=4.5,
        )
    finite = np.flatnonzero(np.isfinite(place).all(axis=1))
    ends = ((0, "o", "start"), (int(finite[-1]), "s", "end"))
    for row, mark, label in ends:
        axes.plot(place[row, 1], place[row, 0], mark, color=_INK, markersize=4.5, label=label, zorder=5)
    for event in events(flight):
        row = min(round(event.t_s / flight.period_s), int(finite[-1]))
        axes.plot(
            place[row, 1],
            place[row, 0],
            event.mark,
            color=RESIDUAL,
            markersize=6.0,
            markeredgecolor="white",
            markeredgewidth=0.5,
            label=event.words,
            linestyle="none",
            zorder=6,
        )


def _depth(axes: Axes, flight: Flight, path: PlannedPath) -> None:
    """Depth over time: waypoints as planned, desired and flown; bottom and limit where there are any."""
    t, depth = flight.t, flight.position[:, 2]
    leg_lines(axes, flight, numbers=True, room=0.045)
    rows = np.flatnonzero((np.diff(flight.leg) != 0) | (np.diff(flight.done.astype(int)) > 0)) + 1
    planned = path.places[flight.leg[rows - 1] + 1, 2]
    axes.plot(
        np.concatenate([[t[0]], t[rows]]),
        np.concatenate([[path.places[0, 2]], planned]),
        "s",
        color=MEASURED,
        markersize=mark_size(len(rows)),
        zorder=4,
    )
    wanted = np.where(flight.done | (flight.alert >= 3), np.nan, flight.desired["depth"])
    line(axes, t, wanted, color=SECOND, linewidth=1.9, label="desired depth")
    line(axes, t, depth, color=SIMULATED, linewidth=1.0, label="flown depth")
    finite = depth[np.isfinite(depth)]
    lowest = float(max(np.nanmax(path.places[:, 2]), finite.max()))
    bottom = depth + flight.altitude
    if np.isfinite(bottom).any():
        lowest = max(lowest, float(np.nanmax(bottom[np.isfinite(bottom)])))
    limit = flight.mission.limits["max_depth_m"]
    air = max(0.06 * lowest, 0.3)
    if np.isfinite(limit) and limit < 1.5 * lowest + 1.0:
        axes.axhline(
            limit, color=RESIDUAL, linewidth=0.9, linestyle=(0, (6, 1.5, 1, 1.5)), label="depth limit"
        )
        lowest = max(lowest, limit)
    axes.set_ylim(lowest + 1.6 * air, min(float(finite.min()), float(np.nanmin(path.places[:, 2]))) - air)
    if np.isfinite(bottom).any():
        axes.fill_between(
            t, bottom, lowest + 1.6 * air, color=BOTTOM, linewidth=0, label="bottom", zorder=0.8
        )
    event_lines(axes, flight)
    axes.set_xlim(t[0], t[-1])
    axes.set_xlabel("time, s")
    axes.set_ylabel("depth, m")
    axes.set_title("depth", loc="left", fontweight="bold", pad=9)


def _apart(page: Array, step_in: float) -> NDArray[np.bool_]:
    """Rows of a line on the page that a reader can tell apart, (n,)."""
    steps = np.nan_to_num(np.hypot(*np.diff(page, axis=0).T))
    cell = np.floor(np.concatenate([[0.0], np.cumsum(steps)]) / step_in)
    return np.asarray(np.concatenate([[True], np.diff(cell) > 0.0]) | ~np.isfinite(page).all(axis=1))
