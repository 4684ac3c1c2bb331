"""Water samples of a flight: a map of the nitrate with its stops, and every channel over time.

The map shows what was logged: positions as the vehicle was told, a circle of two standard deviations of the
navigation around every stop, its mean and deviation beside it; the true plumes at the depth of the samples
are faint lines. Held by ``tests/flight/test_payload.py``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.errors import SimulationError
from seatrial.flight.payload import Phase
from seatrial.flight.water import CHANNELS, properties
from seatrial.report.plot.style import FAINT, MEASURED, RESIDUAL, SHADE, SIMULATED, house_style, new_figure
from seatrial.report.plot.track import extent
from seatrial.report.results.flight_tables import value_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.flight.flight import Flight
    from seatrial.flight.payload import Samples, StopSamples

_GRID = 120  # points of the map, each way
_LEVELS = 6  # colours of the map
_ROOM = 0.14  # of the map's extent, at its edge
_NAMES = {
    "nitrate_mg_l": "nitrate",
    "density_kg_m3": "density",
    "conductivity_s_m": "conductivity",
    "salinity_pss": "salinity",
}


def flight_samples(flight: Flight) -> Figure:
    """Figure of the samples of a flight.

    Raises
    ------
    SimulationError
        The flight had no payload.
    """
    samples = flight.samples
    if samples is None:
        raise SimulationError("expected a flight with a payload, found none; fly it with payload=FILE")
    stops = [stop for stop in samples.stops if stop.label in set(samples.stop)]
    with house_style():
        figure = new_figure(4.6)
        grid = figure.add_gridspec(len(CHANNELS), 2, width_ratios=(1.25, 1.0))
        plan = figure.add_subplot(grid[:, 0])
        _plan(plan, flight, samples, stops)
        first: Axes | None = None
        for k, (name, unit) in enumerate(CHANNELS.items()):
            axes = figure.add_subplot(grid[k, 1], sharex=first)
            first = first or axes
            _course(axes, samples, stops, k)
            axes.set_ylabel(f"{_NAMES[name]},\n{unit}")
            axes.tick_params(labelbottom=k == len(CHANNELS) - 1)
        axes.set_xlabel("time, s; shaded: samples of a stop")
        figure.suptitle(f"{flight.vehicle.name}: {flight.mission.name}", x=0.01, ha="left", fontweight="bold")
    return figure


def _plan(axes: Axes, flight: Flight, samples: Samples, stops: list[StopSamples]) -> None:
    from matplotlib.patches import Circle

    low, high = extent(samples.position, *([[p.north_m, p.east_m]] for p in samples.payload.plumes))
    room = _ROOM * float((high - low).max())  # for the labels of stops at the edge
    low, high = low - 0.5 * room, high + room
    _plumes(axes, flight, samples, low, high)
    shown = axes.scatter(
        samples.position[:, 1],
        samples.position[:, 0],
        c=samples.values[:, 0],
        s=7.0,
        cmap="viridis",
        zorder=3,
    )
    places: list[list[StopSamples]] = []  # stops above one another share a label
    for stop in stops:
        if stop.count:
            near = [place for place in places if _apart(place[0], stop) < _radius(stop)]
            if near:
                near[0].append(stop)
            else:
                places.append([stop])
    for place in places:
        north, east, radius = place[0].position[0], place[0].position[1], _radius(place[0])
        axes.add_patch(Circle((east.mean, north.mean), radius, fill=False, color=MEASURED, zorder=4))
        axes.annotate(
            "\n".join(f"{stop.label}: {value_text(stop.values['nitrate_mg_l'], 2)}" for stop in place),
            (east.mean, north.mean + radius),
            xytext=(0.0, 3.0),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=7.0,
            zorder=5,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.6},
        )
    for plume in samples.payload.plumes:
        axes.plot(plume.east_m, plume.north_m, "v", color=RESIDUAL, markersize=5.0, zorder=5)
        axes.annotate(
            "source", (plume.east_m, plume.north_m), xytext=(5.0, -3.0), textcoords="offset points",
            va="top", fontsize=7.0, color=RESIDUAL,
        )  # fmt: skip
    axes.set_xlim(low[1], high[1])
    axes.set_ylim(low[0], high[0])
    axes.set_aspect("equal", adjustable="box")
    depth = float(samples.position[:, 2].mean())
    lines = f"; lines: true nitrate at {depth:.1f} m" if samples.payload.plumes else ""
    axes.set_xlabel(f"east, m\ncircles: two deviations of the navigation{lines}")
    axes.set_ylabel("north, m")
    axes.figure.colorbar(shown, ax=axes, location="top", shrink=0.8, label="nitrate as measured, mg/L")


def _radius(stop: StopSamples) -> float:
    """Two deviations of the navigation at a stop, m."""
    return 2.0 * max(stop.position[0].deviation, stop.position[1].deviation)


def _apart(stop: StopSamples, other: StopSamples) -> float:
    """Horizontal distance of two stops, m."""
    (north, east), (there, aside) = ([axis.mean for axis in stop.position[:2]] for stop in (stop, other))
    return math.hypot(there - north, aside - east)


def _plumes(axes: Axes, flight: Flight, samples: Samples, low: np.ndarray, high: np.ndarray) -> None:
    """Lines of equal true nitrate at the mean depth of the samples."""
    if not samples.payload.plumes:
        return
    air = 0.5 * float((high - low).max())
    east = np.linspace(low[1] - air, high[1] + air, _GRID)
    north = np.linspace(low[0] - air, high[0] + air, _GRID)
    places = np.array(np.meshgrid(north, east, indexing="ij")).reshape(2, -1).T
    depth = np.full((len(places), 1), float(samples.position[:, 2].mean()))
    payload = samples.payload
    water = properties(
        payload.water, payload.plumes, np.hstack([places, depth]), flight.circumstances.current
    )
    nitrate = water[:, 0].reshape(_GRID, _GRID)
    background, most = float(nitrate.min()), float(max(samples.true[:, 0].max(), np.median(nitrate)))
    if most > background:
        levels = np.linspace(background, most, _LEVELS + 1)[1:]
        axes.contour(east, north, nitrate, levels=levels, colors=FAINT, linewidths=0.7, zorder=1)


def _course(axes: Axes, samples: Samples, stops: list[StopSamples], k: int) -> None:
    """A channel over time: measured, its two deviations, and the true water."""
    labels = np.array(samples.stop)
    for stop in stops:
        at = samples.t[(labels == stop.label) & (samples.phase == Phase.SETTLED)]
        if not len(at):
            continue
        axes.axvspan(float(at[0]), float(at[-1]), color=SHADE, linewidth=0.0, zorder=0)
    deviation = 2.0 * float(np.hypot(samples.payload.noise[k], samples.payload.bias[k]))
    y = samples.values[:, k]
    axes.fill_between(samples.t, y - deviation, y + deviation, color=SIMULATED, alpha=0.25, linewidth=0.0)
    axes.plot(samples.t, y, color=SIMULATED, linewidth=0.7, label="measured, ± two deviations")
    axes.plot(samples.t, samples.true[:, k], color=MEASURED, linewidth=0.9, label="water at the vehicle")
    axes.ticklabel_format(useOffset=False)
    axes.margins(x=0.0)
    if k == 0:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, fontsize=6.5, frameon=False)
