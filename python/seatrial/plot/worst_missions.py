"""The worst missions of a verification over their plan: tracks from above, and the depth over time.

Held by `tests/test_verify.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.plot.plan_page import layout, page_legend, page_title, profile_axes
from seatrial.plot.plan_view import extent, new_plan, waypoint_label, waypoints
from seatrial.plot.planned_path import planned_path
from seatrial.plot.style import CYCLE, HULL_EDGE, SHADE, house_style, new_figure, panel_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.flight.flight import Flight

__all__ = ["WorstFlight", "worst_missions"]

Array = NDArray[np.float64]

_OBSTACLE = "obstacle"


@dataclass(frozen=True, eq=False)
class WorstFlight:
    """A flight with its label, such as "522: -6.6 m"."""

    label: str
    flight: Flight


def worst_missions(flights: Sequence[WorstFlight], *, heading: str = "") -> Figure:
    """Figure of flights of one mission over its plan, with what stands in the water.

    Parameters
    ----------
    flights : sequence of WorstFlight
        At least one, the worst first.
    heading : str
    """
    first = flights[0].flight
    path = planned_path(first.mission, seabed=first.circumstances.seabed)
    acceptance = np.array([stop.acceptance for stop in first.route.stops])
    tracks = [one.flight.position[np.isfinite(one.flight.position).all(axis=1)] for one in flights]
    reach = [path.places[1:] + acceptance[:, None], path.places[1:] - acceptance[:, None]]
    corners = extent(path.points, *tracks, *reach)
    obstacles = [one for one in first.circumstances.obstacles if _within(one, corners)]
    plain = ["planned path", waypoint_label(path), "sphere of acceptance"] + [_OBSTACLE] * bool(obstacles)
    page = layout(corners, [*plain, *(one.label for one in flights)])
    with house_style():
        figure = new_figure(page.height, constrained=False)
        plan = new_plan(figure, page.plan, corners)
        _obstacles(plan.axes, obstacles)
        waypoints(plan, path, acceptance, tracks[0])
        profile = profile_axes(figure, page)
        for number, (one, track) in enumerate(zip(flights, tracks, strict=True)):
            colour = CYCLE[number % len(CYCLE)]
            style: dict[str, Any] = {
                "color": colour,
                "linewidth": 1.2 if number == 0 else 0.9,
                "zorder": 4.0 - 0.1 * number,
            }
            plan.axes.plot(track[:, 1], track[:, 0], label=one.label, **style)
            plan.axes.plot(track[-1, 1], track[-1, 0], "s", color=colour, markersize=4.0, zorder=5.0)
            profile.plot(one.flight.t[: len(track)], track[:, 2], **style)
        panel_title(plan.axes, "tracks", "square: end")
        profile.invert_yaxis()
        profile.set_xlabel("time, s")
        profile.set_ylabel("depth, m")
        profile.ticklabel_format(useOffset=False)
        profile.set_xlim(0.0, max(float(one.flight.t[-1]) for one in flights))
        panel_title(profile, "depth")
        page_title(figure, page, heading or f"worst missions of {first.mission.name}")
        page_legend(figure, (plan.axes, profile), page)
    return figure


def _within(obstacle: tuple[float, float, float], corners: tuple[Array, Array]) -> bool:
    """Whether some of an obstacle lies in the view; a far one would make the tracks small."""
    place, radius = np.array(obstacle[:2]), obstacle[2]
    nearest = np.clip(place, *corners)
    return bool(np.hypot(*(place - nearest)) <= radius)


def _obstacles(axes: Axes, obstacles: Sequence[tuple[float, float, float]]) -> None:
    from matplotlib.patches import Circle

    for number, (north, east, radius) in enumerate(obstacles):
        axes.add_patch(
            Circle(
                (east, north), radius, facecolor=SHADE, edgecolor=HULL_EDGE, linewidth=0.8, zorder=1.5,
                label=_OBSTACLE if number == 0 else None,
            )
        )  # fmt: skip
