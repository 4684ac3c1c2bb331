"""Errors, actuators and control loops of a flight, and the gallery of all its figures.

Errors: cross-track and vertical, over time and their distribution once settled. Actuators: commands and what
became of them, by groups that are driven alike, and the power. Loops: desired and done, demanded and reached,
with the modes. Held by `tests/report/test_flight_figures.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.flight.metrics import saturated
from seatrial.report.plot.flight import (
    event_lines,
    events,
    flight_track,
    leg_lines,
    line,
    mode_strip,
    settled,
    shade,
    strip_rows,
)
from seatrial.report.plot.samples import flight_samples
from seatrial.report.plot.style import (
    CYCLE,
    MEASURED,
    RESIDUAL,
    SECOND,
    SHADE,
    SIMULATED,
    house_style,
    new_figure,
    panel_title,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial._core import Vehicle
    from seatrial.flight.flight import Flight

_ERRORS = (
    ("cross_track", "cross-track error", "$y_e$, m", "positive: to starboard of the path"),
    ("vertical", "vertical error", "$z_e$, m", "positive: below the path"),
)

_BINS = 41  # bars of the histogram, odd: one about zero

_SHARE = 95.0  # percent of the samples between the marked ends


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


Pair = tuple[float, float]

_USUAL = {"rad": 0.5}


@dataclass(frozen=True)
class Motor:
    """A motor and the actuators that have it; pairs are (ahead, astern), magnitudes from neutral.

    ``unit`` is the command's; limits that are absent are infinite or zero, rates are per second.
    """

    group: str
    actuators: tuple[str, ...]
    unit: str
    neutral: float
    maximum: Pair
    minimum: Pair
    lifts: bool
    n_acc: float
    n_dec: float
    K_V: float
    T_1: float
    T_t: float
    characteristic: str

    @property
    def letter(self) -> str:
        """Letter of the signal: n for revolutions, F for a force, delta for a fin, s for any other."""
        return {"rpm": "n", "N": "F", "rad": r"\delta"}.get(self.unit, "s")

    @property
    def printed_unit(self) -> str:
        """Unit as it is printed."""
        return {"us": "\N{MICRO SIGN}s"}.get(self.unit, self.unit)

    @property
    def limited(self) -> bool:
        """Whether it has a static limit."""
        return math.isfinite(min(self.maximum)) or max(self.minimum) > 0.0

    @property
    def delayed(self) -> bool:
        """Whether it has a rate limit, a lag or a dead time."""
        return math.isfinite(min(self.n_acc, self.n_dec)) or max(self.T_1, self.T_t) > 0.0

    @property
    def largest(self) -> float:
        """Largest command from neutral, either way; a round number where it is not limited."""
        known = [limit for limit in self.maximum if math.isfinite(limit)]
        return max(known) if known else _USUAL.get(self.unit, 2.0 * max(*self.minimum, 50.0))


def motors(vehicle: Vehicle) -> list[Motor]:
    """A `Motor` per group of actuators with equal numbers, in the vehicle's order."""
    facts, values = vehicle.actuator_info(), vehicle.coefficients()
    tables = vehicle.motors()
    members_of: dict[Motor, list[str]] = {}
    for name in vehicle.actuators:
        facts_of, table = facts[name], tables[name]
        n_acc = values.get(f"{name}.n_acc", float(table.get("n_acc_per_s", math.inf)))
        key = Motor(
            group=str(facts_of["group"]) or name,
            actuators=(),
            unit=str(facts_of["unit"]),
            neutral=float(facts_of["neutral"]),
            maximum=(_limit(facts_of["maximum_ahead"]), _limit(facts_of["maximum_astern"])),
            minimum=(float(facts_of["minimum_ahead"] or 0.0), float(facts_of["minimum_astern"] or 0.0)),
            lifts=table.get("below_minimum", "lift") == "lift",
            n_acc=n_acc,
            n_dec=values.get(f"{name}.n_dec", float(table.get("n_dec_per_s", n_acc))),
            K_V=values.get(f"{name}.K_V", float(table.get("K_V", 1.0))),
            T_1=values.get(f"{name}.T_1", float(table.get("T_1_s", 0.0))),
            T_t=values.get(f"{name}.T_t", float(table.get("T_t_s", 0.0))),
            characteristic="fin" if facts_of["kind"] == "fin" else str(facts_of["characteristic"]),
        )
        members_of.setdefault(key, []).append(name)
    return [replace(key, actuators=tuple(members)) for key, members in members_of.items()]


def _limit(value: float | None) -> float:
    return math.inf if value is None else float(value)


_ROW_IN = 1.35  # layout, inches

_BAND = "#E4E4E4"

_DASHES = ("-", (0, (4, 1.2)), (0, (1.4, 1.2)), (0, (4, 1.2, 1.2, 1.2)))

_NEAR = 0.6  # a limit is drawn once a command comes so near to it


def flight_actuators(flight: Flight) -> Figure:
    """Figure of commands and signals per group of like actuators, and of the power where it is known."""
    groups = motors(flight.vehicle)
    powered = bool(np.nanmax(np.asarray(flight.power)) > 0.0)  # a vehicle file may tell nothing of it
    rows = len(groups) + int(powered)
    with house_style():
        figure = new_figure(_ROW_IN * rows + 0.75)
        panels = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
        for k, (motor, axes) in enumerate(zip(groups, panels, strict=False)):
            _group(axes, flight, motor, numbers=k == 0)
        if powered:
            _power(panels[-1], flight)
        panels[-1].set_xlabel("time, s")
        panels[-1].set_xlim(flight.t[0], flight.t[-1])
        _legend(figure, flight, groups)
        figure.suptitle(f"{flight.vehicle.name}: {flight.mission.name}", x=0.01, ha="left", fontweight="bold")
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
        colour, dashes = CYCLE[k % len(CYCLE)], _DASHES[k % len(_DASHES)]
        command, signal = (
            np.where(flight.done, np.nan, scale * np.asarray(log[name]))
            for log in (flight.commands, flight.actuators)
        )
        line(axes, flight.t, command, color=colour, linewidth=2.2, alpha=0.35, zorder=2)
        line(axes, flight.t, signal, color=colour, linewidth=0.9, linestyle=dashes, label=name, zorder=3)
        away = np.nanmax(np.abs(np.stack([command, signal]) - scale * motor.neutral))
        reached = max(reached, float(away) / scale)
    for sign, limit in zip((1.0, -1.0), motor.maximum, strict=True):
        if math.isfinite(limit) and reached > _NEAR * limit:
            at = scale * (motor.neutral + sign * limit)
            axes.axhline(at, color=MEASURED, linewidth=0.8, linestyle=(0, (6, 2)), zorder=1)
    event_lines(axes, flight)
    axes.set_ylabel(f"{'signal' if motor.unit == 'us' else _quantity(motor)}, {unit}")
    axes.locator_params(axis="y", nbins=6)
    axes.set_title(motor.group, loc="left", fontweight="bold", pad=9 if numbers else 4)
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.06 if numbers else 1.0),
        ncols=min(len(motor.actuators), 6),
        fontsize=6.5,
        handlelength=2.0,
        columnspacing=1.2,
        labelspacing=0.2,
        borderaxespad=0.1,
    )


def _quantity(motor: Motor) -> str:
    return {"rpm": "revolutions", "N": "force", "rad": "deflection"}.get(motor.unit, "signal")


def _power(axes: Axes, flight: Flight) -> None:
    leg_lines(axes, flight)
    line(axes, flight.t, np.asarray(flight.power), color=SIMULATED)
    event_lines(axes, flight)
    axes.set_ylabel("power, W")
    axes.set_ylim(bottom=0.0)
    axes.locator_params(axis="y", nbins=6)
    energy = float(flight.energy_wh[-1])
    mean = 3600.0 * energy / max(float(flight.t[-1] - flight.t[0]), 1e-9)
    axes.set_title("power", loc="left", fontweight="bold")
    if math.isfinite(energy):
        axes.set_title(
            f"{energy:.3g} Wh, {mean:.3g} W on average", loc="right", fontsize=7.5, color="#404040"
        )


def _legend(figure: Figure, flight: Flight, groups: list[Motor]) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Line2D | Patch] = [
        Line2D([], [], color=SIMULATED, linewidth=2.2, alpha=0.35, label="command (broad, pale)"),
        Line2D([], [], color=SIMULATED, linewidth=0.9, label="signal of the actuator"),
        Line2D([], [], color=MEASURED, linewidth=0.8, linestyle=(0, (6, 2)), label="largest"),
    ]
    if any(max(motor.minimum) > 0.0 for motor in groups):
        handles.append(Patch(color=_BAND, label="below the least that turns"))
    handles += [
        Line2D([], [], color=RESIDUAL, marker=event.mark, linestyle="none", markersize=4, label=event.words)
        for event in events(flight)
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=6.5, columnspacing=1.4)


_LOOP_ROW_IN, _STRIP_IN = 1.02, 0.135  # layout, inches
_SATURATED = "#F3C9B5"
_FORCES = ("X, N", "Y, N", "Z, N", "K, N m", "M, N m", "N, N m")
# Intervals of ticks on axes of angles, degrees.
_ANGLES = (0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0, 90.0, 180.0, 360.0)
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
    strip = _STRIP_IN * len(strip_rows(flight)) + 0.12
    with house_style():
        figure = new_figure(_LOOP_ROW_IN * len(rows) + strip + 1.0)
        heights = [_LOOP_ROW_IN] * len(rows) + [strip]
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
        figure.suptitle(f"{flight.vehicle.name}: {flight.mission.name}", x=0.01, ha="left", fontweight="bold")
    return figure


def _followed(axes: Axes, flight: Flight, shown: Shown, *, numbers: bool) -> None:
    from matplotlib.ticker import MultipleLocator

    leg_lines(axes, flight, numbers=numbers, room=0.045)
    line(axes, flight.t, shown.desired, color=SECOND, linewidth=1.9)
    line(axes, flight.t, shown.done, color=SIMULATED, linewidth=1.0)
    event_lines(axes, flight)
    axes.set_ylabel(shown.label)
    axes.set_title(_NAMES[shown.index], loc="left", fontweight="bold", pad=9 if numbers else 4)
    if shown.index == 2:
        axes.invert_yaxis()
    if shown.index == 5:
        span = abs(float(np.subtract(*axes.get_ylim())))
        axes.yaxis.set_major_locator(MultipleLocator(next((x for x in _ANGLES if span <= 4 * x), 720.0)))
    else:
        axes.locator_params(axis="y", nbins=5)
    _least(axes, 0.2 if shown.index < 3 else 2.0)


def _demand(axes: Axes, flight: Flight, index: int, *, numbers: bool) -> None:
    """Demand and what the allocation reached of it; shaded where it is saturated."""
    rows = flight.active[:, index] & ~flight.done
    if not rows.any():
        axes.set_axis_off()
        axes.text(0.5, 0.5, "depth by pitch: no force demanded", ha="center", transform=axes.transAxes)
        return
    short = saturated(flight, index) & rows
    shade(axes, flight.t, short, _SATURATED)
    leg_lines(axes, flight)
    line(axes, flight.t, np.where(rows, flight.demanded[:, index], np.nan), color=SECOND, linewidth=1.9)
    line(axes, flight.t, np.where(rows, flight.achieved[:, index], np.nan), color=SIMULATED, linewidth=1.0)
    event_lines(axes, flight)
    axes.set_ylabel(_FORCES[index])
    share = 100.0 * float(short.sum()) / max(int(rows.sum()), 1)
    axes.set_title(
        f"saturated {share:.0f} % of its time",
        loc="right",
        fontsize=7,
        color="#404040",
        pad=9 if numbers else 4,
    )
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
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles = [
        Line2D([], [], color=SECOND, linewidth=1.9, label="desired, demanded"),
        Line2D([], [], color=SIMULATED, linewidth=1.0, label="done, reached by the allocation"),
        Patch(color=_SATURATED, label="saturated"),
    ]
    handles += [
        Line2D([], [], color=RESIDUAL, marker=event.mark, linestyle="none", markersize=4, label=event.words)
        for event in events(flight)
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=6.5, columnspacing=1.4)
