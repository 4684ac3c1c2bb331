"""Performance and characteristic of a vehicle: speed, power and range over revolutions, turns, thrust.

Steady motion is from `seatrial.vehicle.steady_state`; tracks are runs of the whole chain in the horizontal
plane; thrust over command at rest and under way has a panel per group of like actuators. Held by
`tests/vehicle/test_performance.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.arrays import Array
from seatrial.report.plot.style import COLUMN_IN, CYCLE, FAINT, WIDTH_IN, house_style, new_figure, panel_title
from seatrial.vehicle.actuators import NOMINAL_V, largest, settling_s, voltage_for
from seatrial.vehicle.steady_state import (
    KNOT_M_S,
    TURN_KINDS,
    Speed,
    Turn,
    cruise,
    drivers,
    round_speeds_kn,
    speeds,
    steady,
    turn_commands,
    turns,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial._core import Vehicle

_HEIGHT_IN, _TOP_IN, _BOTTOM_IN, _GAP_IN = 4.9, 0.62, 0.5, 0.36  # layout, inches

_LEFT_IN, _WIDE_IN, _AXIS_IN, _LEGEND_IN = 0.55, 2.55, 0.5, 0.9  # _AXIS_IN: room for an axis at the right

_ABOVE = (1.0, 1.0)  # right end of a panel's top: where a legend hides no curve

_CURVE = tuple(0.05 * k for k in range(1, 21))  # shares of the largest command

_TURN_SHARE = 0.5  # of the largest command, at which turns are drawn

_DASHES = ("-", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (5, 1.5, 1.2, 1.5)))

_LABELS = {
    "under way": "half ahead",
    "inner side stopped": "stopped",
    "inner side half astern": "half astern",
    "on the spot": "opposed",
}


def performance(vehicle: Vehicle, *, voltage_v: float = NOMINAL_V) -> Figure | None:
    """Figure of speed, power and range over revolutions beside turning circles; None where none drives ahead.

    Power, endurance and range are drawn where the vehicle file tells them, turns where the actuators that
    drive ahead lie on both sides.
    """
    if not drivers(vehicle):
        return None
    rows = speeds(vehicle, voltage_v=voltage_v, shares=_shares(vehicle))
    if not rows:
        return None
    marks = [
        cruise(vehicle, speed * KNOT_M_S, voltage_v=voltage_v) for speed in round_speeds_kn(rows[-1].speed_kn)
    ]
    held = [row for row in marks if row is not None]
    rows = tuple(sorted((*rows, *held), key=lambda row: row.command))
    turning = turns(vehicle, voltage_v=voltage_v, shares=(_TURN_SHARE,))
    curves = [_speed, _thrust if rows[-1].power_w is None else _power]
    if rows[-1].endurance_h is not None:
        curves.append(_range)
    with house_style():
        wide = WIDTH_IN if turning else _LEFT_IN + _WIDE_IN + _AXIS_IN
        figure = new_figure(_HEIGHT_IN, width_in=wide, constrained=False)

        def panel(left: float, bottom: float, width: float, height: float) -> Axes:
            box = (left / wide, bottom / _HEIGHT_IN, width / wide, height / _HEIGHT_IN)
            return figure.add_axes(box)

        each = (_HEIGHT_IN - _TOP_IN - _BOTTOM_IN + _GAP_IN) / len(curves)
        for k, draw in enumerate(curves):
            bottom = _BOTTOM_IN + (len(curves) - 1 - k) * each
            axes = panel(_LEFT_IN, bottom, _WIDE_IN, each - _GAP_IN)
            draw(axes, rows, held, vehicle)
            axes.margins(x=0.02)
            if k < len(curves) - 1:
                axes.tick_params(labelbottom=False)
        axes.set_xlabel(_command_label(vehicle, rows[0].unit))
        if turning:
            left = _LEFT_IN + _WIDE_IN + _AXIS_IN + _LEFT_IN
            below = _BOTTOM_IN + _LEGEND_IN
            axes = panel(left, below, wide - left - 0.1, _HEIGHT_IN - _TOP_IN - below)
            _circles(axes, vehicle, turning, voltage_v)
            axes.legend(
                loc="lower center",
                bbox_to_anchor=((left - 0.3) / wide, 0.06 / _HEIGHT_IN, (wide - left + 0.3) / wide, 0.1),
                bbox_transform=figure.transFigure,
                borderaxespad=0.0,
                title="inner side from the dot on: steady radius and rate",
                title_fontsize=7.5,
            )
        figure.text(
            0.12 / wide,
            1.0 - 0.16 / _HEIGHT_IN,
            f"{vehicle.name}: speed and turning" if turning else f"{vehicle.name}: speed",
            fontweight="bold",
            fontsize=10,
            va="center",
        )
    return figure


def _shares(vehicle: Vehicle) -> list[float]:
    """Shares of the largest command for the curves, from the least that the motor holds."""
    first, sense = next(iter(drivers(vehicle).items()))
    facts = vehicle.actuator_info()[first]
    least = float(facts["minimum_ahead" if sense > 0.0 else "minimum_astern"]) / largest(facts, sense)
    return [*([least] if least > _CURVE[0] else []), *(share for share in _CURVE if share > least)]


def track(vehicle: Vehicle, turn: Turn, *, voltage_v: float = NOMINAL_V) -> Array:
    """Track (n, 2) in m, advance and transfer, from straight running into a turn of 540 degrees.

    Parameters
    ----------
    vehicle : Vehicle
    turn : Turn
        A steady turn of this vehicle; at [0, 0] its inner side leaves the outer one's command for its own.
    voltage_v : float
        Supply voltage at which tables of thrust are read, V.
    """
    from seatrial._core import State

    begin = steady(vehicle, turn_commands(vehicle, turn.share, turn.share), free="X", voltage_v=voltage_v)
    # Time for the turn, and for the way that the straight course leaves.
    t = np.arange(0.0, 900.0 / abs(turn.rate_deg_s) + 30.0, 0.1)
    after = turn_commands(vehicle, turn.share, TURN_KINDS[turn.kind] * turn.share)
    commands: dict[str, ArrayLike] = {name: np.full(len(t), value) for name, value in after.items()}
    state = State(nu=begin.nu, actuators=dict(begin.actuators))
    run = vehicle.simulate(t, commands, state, free="XYN", voltage_v=voltage_for(vehicle, t, voltage_v))
    place: Array = np.asarray(run.position)[:, :2]
    step = np.diff(place, axis=0)
    course = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    turned = np.abs(course - course[0]) > np.deg2rad(540.0)  # one and a half turns: the circle closes
    return place[: int(np.argmax(turned)) if turned.any() else None]


def _command_label(vehicle: Vehicle, unit: str) -> str:
    neutral = float(vehicle.actuator_info()[next(iter(drivers(vehicle)))]["neutral"])
    return f"all that drive ahead, {unit}" + (f" from neutral ({neutral:g} {unit})" if neutral else "")


def _to_kn(speed: ArrayLike) -> Array:
    return np.asarray(speed, dtype=float) / KNOT_M_S


def _from_kn(speed: ArrayLike) -> Array:
    return np.asarray(speed, dtype=float) * KNOT_M_S


def _speed(axes: Axes, rows: tuple[Speed, ...], held: list[Speed], vehicle: Vehicle) -> None:
    axes.plot([r.command for r in rows], [r.speed_m_s for r in rows], color=CYCLE[0])
    axes.plot([r.command for r in held], [r.speed_m_s for r in held], "o", color=CYCLE[0], markersize=3)
    axes.set_ylabel("speed, m/s")
    axes.set_ylim(bottom=0.0)
    axes.locator_params(axis="y", nbins=5)
    knots = axes.secondary_yaxis("right", functions=(_to_kn, _from_kn))
    knots.set_ylabel("kn")
    # At the heights of the ticks at the left: one grid for both.
    knots.set_yticks(_to_kn([tick for tick in axes.get_yticks() if tick <= axes.get_ylim()[1]]))
    knots.yaxis.set_major_formatter(lambda speed, _: f"{speed:.1f}")
    knots.spines["right"].set_visible(True)
    remark = ", ".join(f"{row.speed_kn:g}" for row in held)
    panel_title(axes, "speed", f"dots at {remark} kn" if held else "")


def _thrust(axes: Axes, rows: tuple[Speed, ...], held: list[Speed], vehicle: Vehicle) -> None:
    axes.plot([r.command for r in rows], [r.thrust_n for r in rows], color=CYCLE[0])
    axes.plot([r.command for r in held], [r.thrust_n for r in held], "o", color=CYCLE[0], markersize=3)
    axes.set_ylabel("thrust, N")
    axes.set_ylim(bottom=0.0)
    axes.locator_params(axis="y", nbins=5)
    panel_title(axes, "thrust at that speed")


def _power(axes: Axes, rows: tuple[Speed, ...], held: list[Speed], vehicle: Vehicle) -> None:
    hotel = vehicle.power().get("hotel_w", 0.0)
    for label, load, dashes in (
        ("propulsion", 0.0, "-"),
        (f"with {hotel:g} W hotel load", hotel, (0, (5, 1.5))),
    ):
        if load or label == "propulsion":
            axes.plot(
                [r.command for r in rows],
                [(r.power_w or 0.0) + load for r in rows],
                color=CYCLE[0],
                linestyle=dashes,
                label=label,
            )
    axes.set_ylabel("power, W")
    axes.set_ylim(bottom=0.0)
    axes.locator_params(axis="y", nbins=5)
    if hotel:
        axes.legend(loc="lower right", bbox_to_anchor=_ABOVE, ncols=2, borderaxespad=0.0, fontsize=6.5)
    panel_title(axes, "power")


def _range(axes: Axes, rows: tuple[Speed, ...], held: list[Speed], vehicle: Vehicle) -> None:
    command, battery = [r.command for r in rows], vehicle.power()["battery_wh"]
    (far,) = axes.plot(
        command, [r.range_km or 0.0 for r in rows], color=CYCLE[0], label=f"range with {battery:g} Wh"
    )
    axes.set_ylabel("range, km")
    axes.set_ylim(bottom=0.0)
    axes.locator_params(axis="y", nbins=5)
    hours = axes.twinx()
    (long,) = hours.plot(
        command,
        [r.endurance_h or 0.0 for r in rows],
        color=CYCLE[5],
        linestyle=(0, (5, 1.5)),
        label="endurance",
    )
    hours.set_ylabel("endurance, h")
    hours.set_ylim(bottom=0.0)
    hours.grid(visible=False)
    hours.spines["right"].set_visible(True)
    _as_left(axes, hours)
    axes.legend(
        handles=[far, long],
        loc="lower right",
        bbox_to_anchor=_ABOVE,
        ncols=2,
        borderaxespad=0.0,
        fontsize=6.5,
    )
    panel_title(axes, "range")


def _as_left(axes: Axes, right: Axes) -> None:
    """Ticks of a right axis at the heights of those at the left, so that the grid is that of both."""
    ticks = [tick for tick in axes.get_yticks() if axes.get_ylim()[0] <= tick <= axes.get_ylim()[1]]
    top = axes.get_ylim()[1]
    step = (right.get_ylim()[1] / top) * (ticks[1] - ticks[0])
    size = 10.0 ** np.floor(np.log10(step))
    even = next(nice for nice in (1.0, 2.0, 2.5, 5.0, 10.0) if nice * size >= step * (1.0 - 1e-9)) * size
    right.set_ylim(0.0, even * top / (ticks[1] - ticks[0]))
    right.set_yticks([even * k for k in range(len(ticks))])


def _circles(axes: Axes, vehicle: Vehicle, turning: tuple[Turn, ...], voltage_v: float) -> None:
    widest = max(turn.radius_m for turn in turning)
    for turn, colour, dashes in zip(
        turning, (CYCLE[0], CYCLE[5], CYCLE[2], "#262626"), _DASHES, strict=False
    ):
        path = track(vehicle, turn, voltage_v=voltage_v)
        digits = 2 if turn.radius_m < 10.0 else 1
        axes.plot(
            path[:, 1],
            path[:, 0],
            color=colour,
            linestyle=dashes,
            label=f"{_LABELS[turn.kind]}: {turn.radius_m:.{digits}f} m, {abs(turn.rate_deg_s):.1f}°/s",
        )
    axes.plot([0.0, 0.0], [-0.6 * widest, 0.0], color=FAINT, linewidth=1.6, zorder=1)
    axes.plot(0.0, 0.0, "o", color="#262626", markersize=3.5, zorder=5)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("transfer to starboard, m")
    axes.set_ylabel("advance, m")
    facts = vehicle.actuator_info()
    first, sense = next(iter(drivers(vehicle).items()))
    outer = _TURN_SHARE * largest(facts[first], sense)
    panel_title(axes, "turning circles", f"outer side at {outer:.4g} {facts[first]['unit']}")


_POINTS, _COLUMNS = 161, 3  # of a curve, smooth at this size; panels in a row

_CURVE_DASHES = ("-", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (5, 1.5, 1.2, 1.5)), "-", (0, (5, 1.5)))


def characteristic(
    vehicle: Vehicle,
    *,
    speeds_m_s: Sequence[float] = (0.0, 1.0, 2.0),
    voltages_v: Sequence[float] = (12.0, NOMINAL_V, 16.0),
) -> Figure:
    """Figure of the thrust or fin force of each group's first actuator over its command.

    Parameters
    ----------
    vehicle : Vehicle
    speeds_m_s : sequence of float
        Speeds ahead at which thrust falls with inflow; of groups whose thrust does not depend on it only
        the first is drawn.
    voltages_v : sequence of float
        Supply voltages, where thrust depends on them.
    """
    facts = vehicle.actuator_info()
    groups: dict[str, str] = {}
    for name in vehicle.actuators:
        groups.setdefault(str(facts[name]["group"]) or name, name)
    with house_style():
        panels: dict[str, tuple[list[str], Array, list[tuple[str, Array]]]] = {}
        for group, name in groups.items():
            ahead = largest(facts[name], 1.0)
            astern = largest(facts[name], -1.0) if facts[name]["maximum_astern"] else 0.1 * ahead
            steps = np.linspace(-astern, ahead, _POINTS)
            curves = _curves(vehicle, name, steps, speeds_m_s, voltages_v)
            like = next((other for other, panel in panels.items() if _equal(panel[2], curves)), None)
            if like is None:
                panels[name] = ([group], steps, curves)
            else:
                panels[like][0].append(group)
        columns = min(len(panels), _COLUMNS)
        rows = -(-len(panels) // columns)
        figure = new_figure(0.3 + 2.5 * rows, width_in=COLUMN_IN if columns == 1 else WIDTH_IN)
        grid = figure.subplots(rows, columns, squeeze=False)
        labels = dict.fromkeys(label for _, _, curves in panels.values() for label, _ in curves)
        styles = dict(zip(labels, zip(cycle(CYCLE), cycle(_CURVE_DASHES), strict=False), strict=False))
        drawn = {}
        for axes in grid.flat[len(panels) :]:
            axes.set_axis_off()
        for axes, (name, (alike, steps, curves)) in zip(grid.flat, panels.items(), strict=False):
            unit = str(facts[name]["unit"]).replace("us", "\N{MICRO SIGN}s")
            fin = facts[name]["kind"] == "fin"
            shown = np.degrees(steps) if unit == "rad" else steps
            unit = "deg" if unit == "rad" else unit
            for label, force in curves:
                colour, dashes = styles[label]
                (drawn[label],) = axes.plot(shown, force, color=colour, linestyle=dashes)
            axes.axhline(0.0, color="#262626", linewidth=0.5)
            axes.axvline(0.0, color="#262626", linewidth=0.5)
            neutral = float(facts[name]["neutral"])
            axes.set_xlabel(
                f"command from neutral ({neutral:g} {unit}), {unit}" if neutral else f"command, {unit}"
            )
            axes.set_ylabel("fin force, N" if fin else "thrust, N")
            axes.locator_params(nbins=6 if columns < _COLUMNS else 5)
            panel_title(axes, ", ".join(alike), f"as {name}")
        figure.legend(drawn.values(), drawn, loc="outside lower center", ncols=3)
    return figure


def _equal(curves: list[tuple[str, Array]], other: list[tuple[str, Array]]) -> bool:
    return [label for label, _ in curves] == [label for label, _ in other] and all(
        a.shape == b.shape and np.allclose(a, b) for (_, a), (_, b) in zip(curves, other, strict=True)
    )


def _curves(
    vehicle: Vehicle, name: str, steps: Array, speeds_m_s: Sequence[float], voltages_v: Sequence[float]
) -> list[tuple[str, Array]]:
    if vehicle.actuator_info()[name]["needs_voltage"]:
        return [(f"{voltage:g} V", thrust(vehicle, name, steps, voltage_v=voltage)) for voltage in voltages_v]
    at_rest = thrust(vehicle, name, steps)
    curves = [("at rest", at_rest)]
    for speed in speeds_m_s:
        moving = thrust(vehicle, name, steps, speed_m_s=speed)
        if not np.allclose(moving, at_rest, atol=1e-6):
            curves.append((f"at {speed:g} m/s ahead", moving))
    return curves


def thrust(
    vehicle: Vehicle, name: str, steps: ArrayLike, *, speed_m_s: float = 0.0, voltage_v: float = NOMINAL_V
) -> Array:
    """Thrust (n,) in N along the actuator's direction for commands away from neutral, motor settled.

    The vehicle is held at a speed ahead; each command is kept until the motor follows it.
    """
    from seatrial._core import State

    facts = vehicle.actuator_info()[name]
    direction = np.asarray(facts["wrench"])
    axis = int(np.argmax(np.abs(direction)))
    sense = -1.0 if facts["reversed"] else 1.0
    hold = settling_s(vehicle)
    t = np.linspace(0.0, hold, 41)
    thrusts = []
    for step in np.asarray(steps, dtype=float):
        commands: dict[str, ArrayLike] = {name: np.full(len(t), facts["neutral"] + sense * step)}
        initial = State(nu=[speed_m_s, 0.0, 0.0, 0.0, 0.0, 0.0])
        run = vehicle.simulate(
            t, commands, initial, free="", voltage_v=voltage_for(vehicle, t, voltage_v), max_step_s=0.05
        )
        thrusts.append(float(np.asarray(run.tau)[-1, axis] / direction[axis]))
    return np.array(thrusts)
