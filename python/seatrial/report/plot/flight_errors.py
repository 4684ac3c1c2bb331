"""Errors, actuators and control loops of a flight, and the gallery of all its figures.

Errors: cross-track and vertical, over time and their distribution once settled. Actuators: commands and what
became of them, by groups that are driven alike, and the power. Loops: desired and done, demanded and reached,
with the modes. Held by `tests/report/test_flight_figures.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError
from seatrial.flight.metrics import saturated
from seatrial.flight.payload import CHANNELS, Phase, properties
from seatrial.report.plot import style as pen
from seatrial.report.plot.flight import (
    event_lines,
    flight_heading,
    flight_legend,
    flight_track,
    leg_lines,
    line,
    mode_strip,
    settled,
    shade,
    strip_rows,
)
from seatrial.report.plot.performance import Motor, motors
from seatrial.report.plot.track import extent
from seatrial.report.results.flight import value_text

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.flight.flight import Flight
    from seatrial.flight.payload import Samples, StopSamples

_WATER = {
    "nitrate_mg_l": "nitrate",
    "density_kg_m3": "density",
    "conductivity_s_m": "conductivity",
    "salinity_pss": "salinity",
}


def flight_samples(flight: Flight) -> Figure:
    """Figure of the samples of a flight: a map of the nitrate with its stops, and every channel over time.

    The map shows what was logged: positions as the vehicle was told, a circle of two standard deviations of
    the navigation around every stop, its mean and deviation beside it; faint lines are the true plumes.
    """
    samples = flight.samples
    if samples is None:
        raise SimulationError("expected a flight with a payload, found none; fly it with payload=FILE")
    stops = [stop for stop in samples.stops if stop.label in set(samples.stop)]
    with pen.house_style():
        figure = pen.new_figure(4.6)
        grid = figure.add_gridspec(len(CHANNELS), 2, width_ratios=(1.25, 1.0))
        plan = figure.add_subplot(grid[:, 0])
        _map(plan, flight, samples, stops)
        first: Axes | None = None
        for k, (name, unit) in enumerate(CHANNELS.items()):
            axes = figure.add_subplot(grid[k, 1], sharex=first)
            first = first or axes
            _course(axes, samples, stops, k)
            axes.set_ylabel(f"{_WATER[name]},\n{unit}")
            axes.tick_params(labelbottom=k == len(CHANNELS) - 1)
        axes.set_xlabel("time, s; shaded: samples of a stop")
        flight_heading(figure, flight)
    return figure


def _map(axes: Axes, flight: Flight, samples: Samples, stops: list[StopSamples]) -> None:
    from matplotlib.patches import Circle

    low, high = extent(samples.position, *([[p.north_m, p.east_m]] for p in samples.payload.plumes))
    room = 0.14 * float((high - low).max())  # for the labels of stops at the edge
    low, high = low - 0.5 * room, high + room
    _plumes(axes, flight, samples, low, high)
    north, east = samples.position[:, 0], samples.position[:, 1]
    shown = axes.scatter(east, north, c=samples.values[:, 0], s=7.0, cmap="viridis", zorder=3)
    places: list[list[StopSamples]] = []  # stops above one another share a label
    for stop in stops:
        if stop.count:
            near = [place for place in places if _apart(place[0], stop) < _radius(stop)]
            if near:
                near[0].append(stop)
            else:
                places.append([stop])
    for place in places:
        x, y, radius = place[0].position[1].mean, place[0].position[0].mean, _radius(place[0])
        axes.add_patch(Circle((x, y), radius, fill=False, color=pen.MEASURED, zorder=4))
        words = "\n".join(f"{stop.label}: {value_text(stop.values['nitrate_mg_l'], 2)}" for stop in place)
        look: pen.Style = {
            "ha": "center",
            "va": "bottom",
            "fontsize": 7.0,
            "bbox": pen.ON_WHITE | {"alpha": 0.75},
        }
        axes.annotate(words, (x, y + radius), (0.0, 3.0), textcoords="offset points", zorder=5, **look)
    for plume in samples.payload.plumes:
        axes.plot(plume.east_m, plume.north_m, "v", color=pen.RESIDUAL, markersize=5.0, zorder=5)
        small: pen.Style = {
            "textcoords": "offset points",
            "va": "top",
            "fontsize": 7.0,
            "color": pen.RESIDUAL,
        }
        axes.annotate("source", (plume.east_m, plume.north_m), (5.0, -3.0), **small)
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
    count, colours = 120, 6  # points of the map each way, and lines of equal nitrate
    east = np.linspace(low[1] - air, high[1] + air, count)
    north = np.linspace(low[0] - air, high[0] + air, count)
    places = np.array(np.meshgrid(north, east, indexing="ij")).reshape(2, -1).T
    depth = np.full((len(places), 1), float(samples.position[:, 2].mean()))
    payload = samples.payload
    water = properties(
        payload.water, payload.plumes, np.hstack([places, depth]), flight.circumstances.current
    )
    nitrate = water[:, 0].reshape(count, count)
    background, most = float(nitrate.min()), float(max(samples.true[:, 0].max(), np.median(nitrate)))
    if most > background:
        levels = np.linspace(background, most, colours + 1)[1:]
        axes.contour(east, north, nitrate, levels=levels, colors=pen.FAINT, linewidths=0.7, zorder=1)


def _course(axes: Axes, samples: Samples, stops: list[StopSamples], k: int) -> None:
    """A channel over time: measured, its two deviations, and the true water."""
    labels = np.array(samples.stop)
    for stop in stops:
        at = samples.t[(labels == stop.label) & (samples.phase == Phase.SETTLED)]
        if not len(at):
            continue
        axes.axvspan(float(at[0]), float(at[-1]), color=pen.SHADE, linewidth=0.0, zorder=0)
    deviation = 2.0 * float(np.hypot(samples.payload.noise[k], samples.payload.bias[k]))
    y = samples.values[:, k]
    pen.band(axes, samples.t, y - deviation, y + deviation, pen.SIMULATED, alpha=0.25)
    axes.plot(samples.t, y, color=pen.SIMULATED, linewidth=0.7, label="measured, ± two deviations")
    axes.plot(samples.t, samples.true[:, k], color=pen.MEASURED, linewidth=0.9, label="water at the vehicle")
    axes.ticklabel_format(useOffset=False)
    axes.margins(x=0.0)
    if k == 0:
        axes.legend(**pen.ABOVE, ncols=2, fontsize=6.5, frameon=False)


_ERRORS = (
    ("cross_track", "cross-track error", "$y_e$, m", "positive: to starboard of the path"),
    ("vertical", "vertical error", "$z_e$, m", "positive: below the path"),
)


def drawings(flight: Flight) -> dict[str, Callable[[], Figure]]:
    """Figures of a flight by name; none of a diverged one."""
    if flight.diverged:
        return {}
    drawn = {
        "track": flight_track,
        "loops": flight_loops,
        "actuators": flight_actuators,
        "errors": flight_errors,
        **({} if flight.samples is None else {"samples": flight_samples}),
    }
    return {name: partial(draw, flight) for name, draw in drawn.items()}


def flight_errors(flight: Flight) -> Figure:
    """Figure of the errors against the path over time, and of their distribution on settled legs."""
    counts = settled(flight)
    under_way = flight.under_way & ~flight.holding
    with pen.house_style():
        figure = pen.new_figure(3.7)
        panels = figure.subplots(2, 2, width_ratios=(3.0, 1.0))
        for (key, name, label, sign), (axes, beside) in zip(_ERRORS, panels, strict=True):
            error = np.asarray(flight.errors[key])
            shade(axes, flight.t, counts, pen.SHADE)
            leg_lines(axes, flight, numbers=axes is panels[0, 0])
            axes.axhline(0.0, color=pen.MEASURED, linewidth=0.6, zorder=1)
            line(axes, flight.t, np.where(under_way, error, np.nan), color=pen.SIMULATED)
            event_lines(axes, flight)
            axes.set_ylabel(label)
            axes.set_xlim(flight.t[0], flight.t[-1])
            axes.set_title(name, loc="left", fontweight="bold", pad=9)
            axes.set_title(sign, loc="right", fontsize=7.5, color=pen.REMARK, pad=9)
            _distribution(beside, error[counts & np.isfinite(error)], label)
        panels[1, 0].set_xlabel("time, s; shaded: settled, the second half of a straight leg")
        flight_heading(figure, flight)
    return figure


def _distribution(axes: Axes, error: Array, label: str) -> None:
    """Histogram of the settled error with its mean and the band that holds 95 % of it."""
    axes.set_xlabel(label)
    axes.set_ylabel("share, %")
    if not len(error):
        pen.panel_title(axes, "settled")
        pen.blank(axes, "no leg settled")
        return
    reach = max(float(np.abs(error).max()), 1e-3)
    bins, weights = np.linspace(-reach, reach, 41), np.full(len(error), 100.0 / len(error))
    axes.hist(error, bins=list(bins), weights=weights, color=pen.SIMULATED, alpha=0.75, linewidth=0)
    low, high = np.percentile(error, (2.5, 97.5))
    mean = float(error.mean())
    for at, dashes in ((low, (0, (2, 1.5))), (high, (0, (2, 1.5))), (mean, "-")):
        axes.axvline(at, color=pen.RESIDUAL, linewidth=0.9, linestyle=dashes)
    axes.set_xlim(-reach, reach)
    axes.set_title("settled", loc="left", fontweight="bold", pad=9)
    axes.set_xlabel(f"{label}\n95 %: {_metres(low)} to {_metres(high)}")


def _metres(value: float) -> str:
    text = f"{value:+.2f}" if abs(value) < 9.995 else f"{value:+.1f}"
    return text.replace("-", "\N{MINUS SIGN}")


_BAND = "#E4E4E4"

_DASHES = ("-", (0, (4, 1.2)), (0, (1.4, 1.2)), (0, (4, 1.2, 1.2, 1.2)))


def flight_actuators(flight: Flight) -> Figure:
    """Figure of commands and signals per group of like actuators, and of the power where it is known."""
    groups = motors(flight.vehicle)
    powered = bool(np.nanmax(np.asarray(flight.power)) > 0.0)  # a vehicle file may tell nothing of it
    rows = len(groups) + int(powered)
    with pen.house_style():
        figure = pen.new_figure(1.35 * rows + 0.75)
        panels = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
        for k, (motor, axes) in enumerate(zip(groups, panels, strict=False)):
            _group(axes, flight, motor, numbers=k == 0)
        if powered:
            _power(panels[-1], flight)
        panels[-1].set_xlabel("time, s")
        panels[-1].set_xlim(flight.t[0], flight.t[-1])
        _actuator_legend(figure, flight, groups)
        flight_heading(figure, flight)
    return figure


def _group(axes: Axes, flight: Flight, motor: Motor, *, numbers: bool) -> None:
    """Commands (pale) and signals of like actuators, with the largest and the least."""
    scale, unit = (180.0 / math.pi, "deg") if motor.unit == "rad" else (1.0, motor.printed_unit)
    leg_lines(axes, flight, numbers=numbers)
    if max(motor.minimum) > 0.0:
        band = scale * (motor.neutral + np.array([-motor.minimum[1], motor.minimum[0]]))
        axes.axhspan(*band, color=_BAND, linewidth=0, zorder=0.6)
    reached = 0.0
    for k, name in enumerate(motor.actuators):
        colour, dashes = pen.CYCLE[k % len(pen.CYCLE)], _DASHES[k % len(_DASHES)]
        command, signal = (
            np.where(flight.done, np.nan, scale * np.asarray(log[name]))
            for log in (flight.commands, flight.actuators)
        )
        line(axes, flight.t, command, color=colour, linewidth=2.2, alpha=0.35, zorder=2)
        line(axes, flight.t, signal, color=colour, linewidth=0.9, linestyle=dashes, label=name, zorder=3)
        away = np.nanmax(np.abs(np.stack([command, signal]) - scale * motor.neutral))
        reached = max(reached, float(away) / scale)
    for sign, limit in zip((1.0, -1.0), motor.maximum, strict=True):
        if math.isfinite(limit) and reached > 0.6 * limit:  # else it would flatten the commands
            at = scale * (motor.neutral + sign * limit)
            axes.axhline(at, color=pen.MEASURED, linewidth=0.8, linestyle=(0, (6, 2)), zorder=1)
    event_lines(axes, flight)
    quantity = {"rpm": "revolutions", "N": "force", "rad": "deflection"}.get(motor.unit, "signal")
    axes.set_ylabel(f"{quantity}, {unit}")
    axes.locator_params(axis="y", nbins=6)
    axes.set_title(motor.group, loc="left", fontweight="bold", pad=9 if numbers else 4)
    place = pen.ABOVE | {"bbox_to_anchor": (1.0, 1.06 if numbers else 1.0), "borderaxespad": 0.1}
    tight: pen.Style = {"fontsize": 6.5, "handlelength": 2.0, "columnspacing": 1.2, "labelspacing": 0.2}
    axes.legend(ncols=min(len(motor.actuators), 6), **place, **tight)


def _power(axes: Axes, flight: Flight) -> None:
    leg_lines(axes, flight)
    line(axes, flight.t, np.asarray(flight.power), color=pen.SIMULATED)
    event_lines(axes, flight)
    axes.set_ylabel("power, W")
    axes.set_ylim(bottom=0.0)
    axes.locator_params(axis="y", nbins=6)
    energy = float(flight.energy_wh[-1])
    mean = 3600.0 * energy / max(float(flight.t[-1] - flight.t[0]), 1e-9)
    known = f"{energy:.3g} Wh, {mean:.3g} W on average" if math.isfinite(energy) else ""
    pen.panel_title(axes, "power", known)


def _actuator_legend(figure: Figure, flight: Flight, groups: list[Motor]) -> None:
    handles: list[Artist] = [
        pen.stroke("command (broad, pale)", pen.SIMULATED, linewidth=2.2, alpha=0.35),
        pen.stroke("signal of the actuator", pen.SIMULATED, linewidth=0.9),
        pen.stroke("largest", pen.MEASURED, linewidth=0.8, linestyle=(0, (6, 2))),
    ]
    if any(max(motor.minimum) > 0.0 for motor in groups):
        handles.append(pen.field("below the least that turns", _BAND))
    flight_legend(figure, flight, handles, 4)


_FORCES = ("X, N", "Y, N", "Z, N", "K, N m", "M, N m", "N, N m")
_NAMES = ("speed", "sway speed", "depth", "roll", "pitch", "heading")


@dataclass(frozen=True, eq=False)
class Shown:
    """A loop as it is drawn: index in the order X Y Z K M N, label with unit, desired and done (n,)."""

    index: int
    label: str
    desired: Array
    done: Array


def shown_loops(flight: Flight) -> list[Shown]:
    """Loops that were at work at any time, and the depth, which a pitch loop controls where heave does not.

    Desired values are blank where their loop is not at work; of a heading both are without jumps.
    """
    active, wanted = flight.active, flight.desired
    by_pitch = np.array([mode["depth_by"] == "pitch" for mode in flight.autopilot.modes])[flight.mode]
    yaw = np.unwrap(flight.euler[:, 2])
    off = (wanted["heading"] - yaw + np.pi) % (2.0 * np.pi) - np.pi
    degrees = 180.0 / np.pi
    signals = (
        ("u, m/s", wanted["speed"], flight.nu[:, 0]),
        ("v, m/s", wanted["lateral"], flight.nu[:, 1]),
        ("depth, m", wanted["depth"], flight.position[:, 2]),
        ("roll, deg", np.zeros(len(flight.t)), degrees * flight.euler[:, 0]),
        ("pitch, deg", degrees * np.where(by_pitch, wanted["pitch"], 0.0), degrees * flight.euler[:, 1]),
        ("heading, deg", degrees * (yaw + off), degrees * yaw),
    )
    loops = []
    for i in (0, 1, 5, 4, 2, 3):
        label, desired, done = signals[i]
        rows = active[:, i] | (by_pitch & active[:, 4]) if i == 2 else active[:, i]
        if rows.any():
            loops.append(Shown(i, label, np.where(rows & ~flight.done, desired, np.nan), done))
    return loops


def flight_loops(flight: Flight) -> Figure:
    """Figure of the loops at work: desired and done, beside it demanded and reached, below it the modes."""
    rows = shown_loops(flight)
    row, strip = 1.02, 0.135 * len(strip_rows(flight)) + 0.12  # heights, inches
    with pen.house_style():
        figure = pen.new_figure(row * len(rows) + strip + 1.0)
        heights = [row] * len(rows) + [strip]
        panels = figure.subplots(
            len(rows) + 1, 2, sharex=True, width_ratios=(1.25, 1.0), height_ratios=heights, squeeze=False
        )
        for k, (shown, (left, right)) in enumerate(zip(rows, panels, strict=False)):
            _followed(left, flight, shown, numbers=k == 0)
            _demand(right, flight, shown.index, numbers=k == 0)
        for axes in panels[-1]:
            mode_strip(axes, flight)
        panels[-1, 1].tick_params(labelleft=False)
        panels[0, 0].set_xlim(flight.t[0], flight.t[-1])
        for column in panels.T:
            figure.align_ylabels(list(column[:-1]))
        _loop_legend(figure, flight)
        flight_heading(figure, flight)
    return figure


def _followed(axes: Axes, flight: Flight, shown: Shown, *, numbers: bool) -> None:
    from matplotlib.ticker import MultipleLocator

    leg_lines(axes, flight, numbers=numbers, room=0.045)
    line(axes, flight.t, shown.desired, color=pen.SECOND, linewidth=1.9)
    line(axes, flight.t, shown.done, color=pen.SIMULATED, linewidth=1.0)
    event_lines(axes, flight)
    axes.set_ylabel(shown.label)
    axes.set_title(_NAMES[shown.index], loc="left", fontweight="bold", pad=9 if numbers else 4)
    if shown.index == 2:
        axes.invert_yaxis()
    if shown.index == 5:
        span = abs(float(np.subtract(*axes.get_ylim())))
        steps = (0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0, 90.0, 180.0, 360.0)  # between ticks, degrees
        axes.yaxis.set_major_locator(MultipleLocator(next((x for x in steps if span <= 4 * x), 720.0)))
    else:
        axes.locator_params(axis="y", nbins=5)
    _least(axes, 0.2 if shown.index < 3 else 2.0)


def _demand(axes: Axes, flight: Flight, index: int, *, numbers: bool) -> None:
    """Demand and what the allocation reached of it; shaded where it is saturated."""
    rows = flight.active[:, index] & ~flight.done
    if not rows.any():
        axes.set_axis_off()
        pen.blank(axes, "depth by pitch: no force demanded", fontsize=8)
        return
    short = saturated(flight, index) & rows
    shade(axes, flight.t, short, pen.FORBIDDEN)
    leg_lines(axes, flight)
    line(axes, flight.t, np.where(rows, flight.demanded[:, index], np.nan), color=pen.SECOND, linewidth=1.9)
    line(
        axes, flight.t, np.where(rows, flight.achieved[:, index], np.nan), color=pen.SIMULATED, linewidth=1.0
    )
    event_lines(axes, flight)
    axes.set_ylabel(_FORCES[index])
    share = 100.0 * float(short.sum()) / max(int(rows.sum()), 1)
    remark = f"saturated {share:.0f} % of its time"
    axes.set_title(remark, loc="right", fontsize=7, color=pen.REMARK, pad=9 if numbers else 4)
    axes.locator_params(axis="y", nbins=5)
    _least(axes, 1.0)


def _least(axes: Axes, span: float) -> None:
    """Show no less than a span, so that rounding does not fill a panel."""
    low, high = sorted(axes.get_ylim())
    if high - low < span:
        middle = 0.5 * (low + high)
        ends = (middle - 0.5 * span, middle + 0.5 * span)
        axes.set_ylim(*(ends[::-1] if axes.yaxis_inverted() else ends))


def _loop_legend(figure: Figure, flight: Flight) -> None:
    handles = [
        pen.stroke("desired, demanded", pen.SECOND, linewidth=1.9),
        pen.stroke("done, reached by the allocation", pen.SIMULATED, linewidth=1.0),
        pen.field("saturated", pen.FORBIDDEN),
    ]
    flight_legend(figure, flight, handles, 3)
