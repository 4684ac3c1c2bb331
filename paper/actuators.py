"""Block diagram of the actuators: from the desired command to the wrench, a lane per group of like actuators.

Command, static limits, rate limit, dead time and first-order lag, characteristic with inflow, geometry
(Taubert et al. 2014, figure 3 (actuators) and equations 34, 35, 39 to 47), with the numbers of the vehicle
at hand. Held by `tests/report/test_vehicle_figures.py`.

Static transfer of the motor controller: settled signal over desired command, with its limits marked.

Above ``n_max`` the command is clipped; between zero and ``n_min`` it is lifted to ``n_min`` or, with a dead
band, dropped to zero (Taubert et al. 2014, figure 4 (static behaviour)). Drawn from the model's own chain.
Held by `tests/report/test_vehicle_figures.py`.

Dynamic limiting of the revolutions: ramps of increase and decrease after steps of the command.

``n_acc`` holds while the magnitude grows, ``n_dec`` while it shrinks; a reversal first brakes to zero
(Taubert et al. 2014, figure 5 (rate limits)). Behind the ramps stand dead time and lag. Drawn from the
model's own chain. Held by `tests/report/test_vehicle_figures.py`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from paper.diagram import ABSENT, bar, block, connect, page, words
from seatrial.base.arrays import Array
from seatrial.report.plot.performance import Motor, motors
from seatrial.report.plot.style import (
    COLUMN_IN,
    FAINT,
    MEASURED,
    RESIDUAL,
    SIMULATED,
    WIDTH_IN,
    house_style,
    new_figure,
    number,
    panel_title,
)
from seatrial.vehicle.actuators import NOMINAL_V, voltage_for

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from paper.diagram import Block
    from seatrial._core import Vehicle

_LANE_IN, _BOX_IN, _HEAD_IN, _FOOT_IN = 1.16, 0.86, 0.3, 0.12

_FIRST_X, _GAP_IN, _BAR_IN = 0.8, 0.15, 0.13

_WIDTHS = (0.95, 0.88, 0.8, 1.12, 1.38)

_HEADS = ("static limits", "rate limit", "dead time, lag", "characteristic", "place, direction")

_ICON_IN = (0.46, 0.26)

_FACTORS = (("gain", "gain"), ("astern_ratio", "astern ratio"))


def actuator_diagram(vehicle: Vehicle) -> Figure:
    """Figure of the chains of a vehicle's actuators, a lane per group.

    Raises
    ------
    ValueError
        The vehicle has no actuators.
    """
    lanes = motors(vehicle)
    if not lanes:
        raise ValueError(f"{vehicle.name} has no actuators: there is nothing to draw")
    low = _FOOT_IN if _inflow(vehicle, lanes[-1]) else _FOOT_IN - (_LANE_IN - _BOX_IN) + 0.12
    height = _HEAD_IN + _LANE_IN * len(lanes) + low
    lefts = _FIRST_X + np.concatenate([[0.0], np.cumsum(np.array(_WIDTHS) + _GAP_IN)])
    with house_style():
        figure, axes = page(WIDTH_IN, height)
        for left, width, head in zip(lefts[:-1], _WIDTHS, _HEADS, strict=True):
            words(axes, (left + 0.5 * width, height - 0.13), head, size_pt=7, weight="bold")
        total = bar(
            axes,
            lefts[-1] + 0.5 * _BAR_IN,
            low + _LANE_IN - _BOX_IN - 0.06,
            height - _HEAD_IN + 0.02,
            width=_BAR_IN,
        )
        for row, motor in enumerate(lanes):
            y = height - _HEAD_IN - _LANE_IN * row - 0.5 * _BOX_IN - 0.02
            _lane(axes, vehicle, motor, y, lefts, total)
        middle = total.y
        connect(axes, (total.right[0], middle), (WIDTH_IN - 0.02, middle))
        words(axes, (total.right[0] + 0.1, middle + 0.1), r"$\tau$", size_pt=8)
    return figure


def _lane(axes: Axes, vehicle: Vehicle, motor: Motor, y: float, lefts: Array, total: Block) -> None:
    """One group: its command, five boxes and the arrow into the sum."""
    parts = (
        (_static_lines(motor), _static_icon(motor), not motor.limited),
        (_rate_lines(motor), _RATE, not math.isfinite(min(motor.n_acc, motor.n_dec))),
        (_lag_lines(motor), _LAG, max(motor.T_1, motor.T_t) == 0.0 and motor.K_V == 1.0),
        (_characteristic_lines(vehicle, motor), _CURVES.get(motor.characteristic, _LINE), False),
        (_geometry_lines(vehicle, motor), None, False),
    )
    words(axes, (0.03, y + 0.2), motor.group, size_pt=7.5, weight="bold", ha="left", widest=_FIRST_X)
    members = [] if motor.actuators == (motor.group,) else _members(motor.actuators)
    for k, line in enumerate(members):
        words(axes, (0.03, y - 0.14 - 0.12 * k), line, size_pt=6.0, ha="left", widest=_FIRST_X)
    words(axes, (0.03, y + 0.075), f"${motor.letter}_d$, {motor.printed_unit}", size_pt=6.5, ha="left")
    before = (0.03, y)
    boxes = []
    for left, width, (lines, icon, absent) in zip(lefts[:-1], _WIDTHS, parts, strict=True):
        shift = 0.16 if icon is not None and not absent else 0.0
        made = block(axes, (left + 0.5 * width, y), (width, _BOX_IN), "", lines, absent=absent, shift=shift)
        if icon is not None and not absent:
            _icon(axes, (made.x, y + 0.25), icon)
        connect(axes, before, made.left)
        before = made.right
        boxes.append(made)
    connect(axes, before, (total.left[0], y))
    if _inflow(vehicle, motor):
        foot = boxes[3].bottom
        connect(axes, (foot[0], foot[1] - 0.17), foot)
        words(axes, (foot[0] + 0.07, foot[1] - 0.13), _inflow(vehicle, motor), size_pt=6.5, ha="left")


def _members(names: Sequence[str]) -> list[str]:
    """Names of the actuators in at most three lines."""
    per_line = 2 if len(names) <= 6 else 3
    common = _prefix(names)
    if common:
        return [common + "\N{HORIZONTAL ELLIPSIS}", ", ".join(name.removeprefix(common) for name in names)]
    lines = [", ".join(names[k : k + per_line]) for k in range(0, len(names), per_line)]
    return lines if len(lines) <= 3 else [*lines[:2], f"and {len(names) - 2 * per_line} more"]


def _prefix(names: Sequence[str]) -> str:
    """Common beginning up to an underscore of several long names."""
    first = names[0].rpartition("_")[0] + "_"
    alike = len(names) > 1 and len(first) > 3 and all(name.startswith(first) for name in names)
    return first if alike else ""


def _pair(values: tuple[float, float]) -> str:
    """Limits ahead and astern, with their signs."""
    ahead, astern = (number(x, 4) if math.isfinite(x) else "\N{INFINITY}" for x in values)
    if ahead == astern:
        return f"\N{PLUS-MINUS SIGN}{ahead}"
    return f"+{ahead}, " + (astern if astern == "0" else f"\N{MINUS SIGN}{astern}")


def _static_lines(motor: Motor) -> list[str]:
    if not motor.limited:
        return ["no static limit"]
    n, unit = motor.letter, motor.printed_unit
    lines = [f"${n}_{{max}}$ {_pair(motor.maximum)} {unit}"]
    if max(motor.minimum) > 0.0:
        lines.append(f"${n}_{{min}}$ {_pair(motor.minimum)} {unit}")
        lines.append(f"lifted to ${n}_{{min}}$" if motor.lifts else f"dead band to ${n}_{{min}}$")
    if motor.neutral:
        lines.append(f"about {number(motor.neutral, 4)} {unit}")
    return lines


def _rate_lines(motor: Motor) -> list[str]:
    if not math.isfinite(min(motor.n_acc, motor.n_dec)):
        return ["no rate limit"]
    return [
        f"${motor.letter}_{{acc}}$ {number(motor.n_acc, 4)} {motor.printed_unit}/s",
        f"${motor.letter}_{{dec}}$ {number(motor.n_dec, 4)} {motor.printed_unit}/s",
    ]


def _lag_lines(motor: Motor) -> list[str]:
    if max(motor.T_1, motor.T_t) == 0.0 and motor.K_V == 1.0:
        return ["follows at once"]
    return [f"$T_t$ {number(motor.T_t)} s", f"$T_1$ {number(motor.T_1)} s", f"$K_V$ {number(motor.K_V)}"]


def _characteristic_lines(vehicle: Vehicle, motor: Motor) -> list[str]:
    name = motor.actuators[0]
    values = vehicle.coefficients()

    def said(suffix: str) -> str:
        """A coefficient of the group: one number, or its range over the actuators."""
        found = [values.get(f"{one}.{suffix}", 0.0) for one in motor.actuators]
        low, high = number(min(found)), number(max(found))
        return low if low == high else f"{low}\N{HORIZONTAL ELLIPSIS}{high}"

    if motor.characteristic == "quadratic":
        slips = said("p2") != "0"
        lines = [
            r"$F = p_1\,|n|n + p_2\,|n|V_a$" if slips else r"$F = p_1\,|n|n$",
            rf"$p_1^{{\pm}}$ {said('p1_ahead')}, {said('p1_astern')} N s²",
        ]
        lines += [f"$p_2$ {said('p2')} N s²/m"] if slips else []
    elif motor.characteristic == "polynomial":
        lines = [r"$F = a_0 + a_1 s + a_{11} s^2$"] + [
            f"{way}: " + ", ".join(said(f"{a}_{way}") for a in ("a0", "a1", "a11"))
            for way in ("ahead", "astern")
        ]
    elif motor.characteristic == "table":
        unit = motor.printed_unit
        voltage = bool(vehicle.actuator_info()[name]["needs_voltage"])
        lines = ["measured table", f"$F(s, U)$, $s$ in {unit}" if voltage else f"$F(s)$, $s$ in {unit}"]
    elif motor.characteristic == "fin":
        area = float(vehicle.actuator_info()[name]["area"])
        lines = [r"$F = \rho S\,|V|^2\,(C_L, C_D) / 2$", f"$S$ {number(area)} m²"]
    else:
        lines = ["$F$ = command, N"]
    given = [(suffix, word) for suffix, word in _FACTORS if f"{name}.{suffix}" in values]
    changed = [f"{word} {said(suffix)}" for suffix, word in given if said(suffix) != "1"]
    return lines + ([", ".join(changed)] if changed else [])


def _inflow(vehicle: Vehicle, motor: Motor) -> str:
    """Words at the inflow's arrow; empty where thrust does not depend on it."""
    values, name = vehicle.coefficients(), motor.actuators[0]
    if motor.characteristic == "fin":
        return "$V$: water past the fin"
    if vehicle.actuator_info()[name]["needs_voltage"]:
        return "supply voltage $U$"
    if not values.get(f"{name}.p2", 0.0):
        return ""
    wake = values.get(f"{name}.w", 0.0)
    return f"$V_a = (1 - w)\\,u_a$, $w$ = {number(wake)}"


def _geometry_lines(vehicle: Vehicle, motor: Motor) -> list[str]:
    facts = vehicle.actuator_info()
    if any(facts[name]["position"] is None for name in motor.actuators):
        wrench = [f"{number(float(x), 2)}" for x in facts[motor.actuators[0]]["wrench"]]
        return ["wrench per N", ", ".join(wrench[:3]), ", ".join(wrench[3:]) + " m"]
    lines = [r"$f = F\,d$,  $\tau = [f;\; r \times f]$"]
    for letter, key, unit in (("d", "direction", ""), ("r", "position", " m")):
        lines.append(f"${letter}$ = ({_spread([facts[name][key] for name in motor.actuators])}){unit}")
    return lines


def _spread(vectors: Sequence[Any]) -> str:
    """Components of like vectors: plus-minus where only the sign differs, a range where the size does."""
    shown = []
    for column in np.array(vectors, dtype=float).T:
        low, high, size = (number(round(float(x), 2)) for x in (column.min(), column.max(), abs(column[0])))
        alike = np.ptp(np.abs(column)) < 5e-3
        both = "\N{PLUS-MINUS SIGN}" + size if alike else f"{low}\N{HORIZONTAL ELLIPSIS}{high}"
        shown.append(low if low == high else both)
    return ", ".join(shown)


def _static_icon(motor: Motor) -> list[tuple[float, float]]:
    """Staircase of the static limits, with or without a step about zero."""
    low = 0.25 if max(motor.minimum) > 0.0 else 0.0
    foot = [(-low, -low), (0.0, -low if motor.lifts else 0.0), (0.0, low if motor.lifts else 0.0), (low, low)]
    if not motor.lifts and low:
        foot = [(-low, -low), (-low, 0.0), (low, 0.0), (low, low)]
    return [(-1.0, -0.75), (-0.75, -0.75), *(foot if low else []), (0.75, 0.75), (1.0, 0.75)]


_RATE = [(-1.0, -0.8), (-0.5, -0.8), (0.2, 0.8), (0.6, 0.8), (0.9, -0.8), (1.0, -0.8)]

_LAG = [(-1.0, -0.8), (-0.5, -0.8)] + [
    (x, -0.8 + 1.6 * (1.0 - math.exp(-(x + 0.5) / 0.35))) for x in np.linspace(-0.5, 1.0, 30)
]

_SQUARE = [(x, 0.9 * x * abs(x)) for x in np.linspace(-1.0, 1.0, 41)]

_LINE = [(-1.0, -0.9), (1.0, 0.9)]

_CURVES = {"quadratic": _SQUARE, "polynomial": _SQUARE, "table": _SQUARE}


def _icon(axes: Axes, centre: tuple[float, float], curve: list[tuple[float, float]]) -> None:
    """A small picture of a transfer behaviour, over two thin axes."""
    points = np.array(curve) * np.array(_ICON_IN) * 0.5 + np.array(centre)
    wide, high = 0.5 * _ICON_IN[0], 0.5 * _ICON_IN[1]
    x, y = centre
    axes.plot([x - wide, x + wide], [y, y], color=ABSENT, linewidth=0.4, zorder=4)
    axes.plot([x, x], [y - high, y + high], color=ABSENT, linewidth=0.4, zorder=4)
    axes.plot(points[:, 0], points[:, 1], color=SIMULATED, linewidth=1.1, zorder=5)


_HEIGHT_IN = 2.7

_REACH, _HIGH, _CLOSE = 1.25, 1.02, 2.6

_POINTS = 81


def static_transfer(vehicle: Vehicle) -> Figure:
    """Figure of the static transfer of every motor that differs and has a static limit.

    Raises
    ------
    ValueError
        No motor has a static limit.
    """
    shown = [(groups, motor) for groups, motor in drives(vehicle) if motor.limited]
    if not shown:
        raise ValueError(f"no motor of {vehicle.name} has a static limit")
    columns = min(len(shown), 2)
    rows = -(-len(shown) // 2)
    with house_style():
        figure = new_figure(_HEIGHT_IN * rows, width_in=COLUMN_IN if columns == 1 else WIDTH_IN)
        grid = figure.subplots(rows, columns, squeeze=False)
        for axes, (groups, motor) in zip(grid.flat, shown, strict=False):
            _panel(axes, vehicle, motor)
            panel_title(axes, ", ".join(groups))
        for axes in list(grid.flat)[len(shown) :]:
            axes.set_axis_off()
    return figure


_FAST = 1e9  # 1/s: a motor without a limit of its rate


def drives(vehicle: Vehicle) -> list[tuple[list[str], Motor]]:
    """Motors that differ, whatever they drive: names of their groups, and one of them."""
    groups_of: dict[Motor, list[str]] = {}
    for motor in motors(vehicle):
        plain = replace(motor, group="", actuators=(), characteristic="")
        groups_of.setdefault(plain, []).append(motor.group)
    first = {group: motor for motor in reversed(motors(vehicle)) for group in [motor.group]}
    return [(list(dict.fromkeys(groups)), first[groups[0]]) for groups in groups_of.values()]


def behind_motor(
    vehicle: Vehicle,
    motor: Motor,
    t: ArrayLike,
    command: ArrayLike,
    *,
    rate_limit: bool = True,
    lag: bool = True,
) -> Array:
    """Signal (n,) behind a motor, from neutral, for a command (n,) from neutral held from sample to sample.

    The vehicle is tied. The sense is that of the command, whether or not the actuator is mounted reversed.

    Parameters
    ----------
    vehicle : Vehicle
    motor : Motor
    t, command : array, shape (n,)
        Times in s, uniform; command in the motor's unit.
    rate_limit, lag : bool
        Whether the rate limit, and the lag with its dead time, are in the chain.
    """
    name = motor.actuators[0]
    ideal: dict[str, float] = {}
    if not rate_limit:
        ideal |= dict.fromkeys((f"{name}.n_acc", f"{name}.n_dec"), _FAST)
    if not lag:
        ideal |= {f"{name}.K_V": 1.0, f"{name}.T_1": 0.0, f"{name}.T_t": 0.0}
    # A motor without a lag or rate limit of its own has no such coefficient.
    known = vehicle.coefficients()
    vehicle = vehicle.with_coefficients({key: x for key, x in ideal.items() if key in known})
    times = np.asarray(t, dtype=float)
    sense = -1.0 if vehicle.actuator_info()[name]["reversed"] else 1.0
    run = vehicle.simulate(
        times,
        {name: motor.neutral + sense * np.asarray(command, dtype=float)},
        free="",
        voltage_v=voltage_for(vehicle, times, NOMINAL_V),
        max_step_s=0.01,
    )
    return np.asarray(sense * (np.asarray(run.actuators[name]) - motor.neutral))


def settled(vehicle: Vehicle, motor: Motor, command: Array) -> Array:
    """Signal (n,) from neutral to which a motor settles under commands (n,) from neutral."""
    steps = np.repeat(command, 2)
    t = np.arange(len(steps)) * 0.1
    return behind_motor(vehicle, motor, t, steps, rate_limit=False, lag=False)[1::2]


def _panel(axes: Axes, vehicle: Vehicle, motor: Motor) -> None:
    reach = _REACH * motor.largest
    _curve(axes, vehicle, motor, reach)
    letter, unit = motor.letter, motor.printed_unit
    about = f" from {number(motor.neutral, 4)} {unit}" if motor.neutral else ""
    axes.set_xlabel(f"desired ${letter}_d${about}, {unit}")
    axes.set_ylabel(f"actual ${letter}_a$, {unit}")
    for sign, limit in zip((1.0, -1.0), motor.maximum, strict=True):
        if math.isfinite(limit):
            axes.axhline(sign * limit, color=FAINT, linewidth=0.7, linestyle=(0, (4, 2)))
            mark = "+" if sign > 0 else "-"
            axes.annotate(
                f"${letter}_{{max}}^{{{mark}}}$ = {number(sign * limit, 4)}",
                (-sign * reach, sign * limit),
                (2.0 * sign, 2.0 * sign),
                textcoords="offset points",
                ha="left" if sign > 0 else "right",
                va="bottom" if sign > 0 else "top",
                fontsize=7.5,
            )
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-_HIGH * reach, _HIGH * reach)
    axes.locator_params(nbins=5)
    if max(motor.minimum) > 0.0:
        lowest = motor.maximum[1] if math.isfinite(motor.maximum[1]) else reach
        _close_up(axes, vehicle, motor, above=0.5 - 0.5 * lowest / (_HIGH * reach))


def _close_up(axes: Axes, vehicle: Vehicle, motor: Motor, *, above: float) -> None:
    """The neighbourhood of zero, in the free corner below the curve and above the limit astern."""
    foot = min(above + 0.09, 0.3)
    inset = axes.inset_axes((0.66, foot, 0.33, min(0.31, 0.52 - foot)))
    reach = _CLOSE * max(motor.minimum)
    _curve(inset, vehicle, motor, reach)
    inset.set_xlim(-reach, reach)
    inset.set_ylim(-reach, reach)
    ticks = sorted({-motor.minimum[1], 0.0, motor.minimum[0]})
    outer = [x for x in ticks if x]
    inset.set_xticks(outer, [number(x, 4) for x in outer])
    inset.set_yticks(ticks, [number(x, 4) for x in ticks])
    inset.tick_params(labelsize=6, length=2.0, pad=1.5)
    inset.set_facecolor("white")
    for side in inset.spines.values():
        side.set_visible(True)
        side.set_color(FAINT)
    word = "lifted to" if motor.lifts else "dead band to"
    inset.set_title(f"{word} ${motor.letter}_{{min}}$", fontsize=7, pad=2.5)


def _curve(axes: Axes, vehicle: Vehicle, motor: Motor, reach: float) -> None:
    """Transfer on either side of zero, zero itself, and the straight line of an ideal controller."""
    axes.plot([-reach, reach], [-reach, reach], color=FAINT, linewidth=0.7, linestyle=":")
    axes.axhline(0.0, color="#262626", linewidth=0.5)
    axes.axvline(0.0, color="#262626", linewidth=0.5)
    edges = [0.0, 0.0]
    for side, (sign, minimum) in enumerate(zip((1.0, -1.0), motor.minimum, strict=True)):
        jump = minimum * np.array([1.0 - 1e-9, 1.0 + 1e-9]) if minimum > 0.0 else np.zeros(0)
        command = sign * np.unique(np.concatenate([np.linspace(1e-6 * reach, reach, _POINTS), jump]))
        signal = settled(vehicle, motor, command)
        edges[side] = float(signal[0])
        axes.plot(command, signal, color=SIMULATED, linewidth=1.4)
    if edges[0] != edges[1]:
        axes.plot([0.0, 0.0], edges, color=SIMULATED, linewidth=1.0)
    axes.plot(0.0, settled(vehicle, motor, np.zeros(1))[0], "o", color=SIMULATED, markersize=2.6)


_RATE_LIMITING_HEIGHT_IN = 2.75

_SHARE = 0.75  # of the largest command

_SAMPLES = 1200


def rate_limiting(vehicle: Vehicle) -> Figure:
    """Figure of how every motor that differs follows a step, a reversal and a stop.

    Raises
    ------
    ValueError
        Every motor follows its command at once.
    """
    shown = [(groups, motor) for groups, motor in drives(vehicle) if motor.delayed]
    if not shown:
        raise ValueError(f"every motor of {vehicle.name} follows its command at once")
    columns = min(len(shown), 2)
    rows = -(-len(shown) // 2)
    with house_style():
        figure = new_figure(
            0.25 + _RATE_LIMITING_HEIGHT_IN * rows, width_in=COLUMN_IN if columns == 1 else WIDTH_IN
        )
        grid = figure.subplots(rows, columns, squeeze=False)
        for axes, (groups, motor) in zip(grid.flat, shown, strict=False):
            _rate_limiting_panel(axes, vehicle, motor)
            panel_title(axes, ", ".join(groups))
        for axes in list(grid.flat)[len(shown) :]:
            axes.set_axis_off()
        figure.legend(
            *figure.axes[0].get_legend_handles_labels(),
            loc="outside lower center",
            ncols=3,
            columnspacing=1.2,
            handlelength=1.8,
        )
    return figure


def _rate_limiting_panel(axes: Axes, vehicle: Vehicle, motor: Motor) -> None:
    top = _SHARE * motor.largest
    low = min(top, _SHARE * motor.maximum[1])
    t, command, changes = _steps(motor, top, low)
    letter, unit = motor.letter, motor.printed_unit
    axes.step(t, command, where="post", color=MEASURED, linewidth=0.9, linestyle=(0, (4, 2)), label="desired")
    if math.isfinite(min(motor.n_acc, motor.n_dec)):
        limited = behind_motor(vehicle, motor, t, command, lag=False)
        axes.plot(t, limited, color=RESIDUAL, linewidth=1.0, linestyle=(0, (1, 1)), label="limited")
        _rates(axes, motor, top, low, changes)
    if max(motor.T_1, motor.T_t) > 0.0:
        axes.plot(t, behind_motor(vehicle, motor, t, command), color=SIMULATED, linewidth=1.4, label="actual")
    axes.axhline(0.0, color="#262626", linewidth=0.5)
    axes.set_xlim(0.0, t[-1])
    axes.set_ylim(-1.15 * top, 1.15 * top)
    axes.locator_params(nbins=6)
    axes.set_xlabel("time, s")
    axes.set_ylabel(f"${letter}$, {unit}")


def _steps(motor: Motor, top: float, low: float) -> tuple[Array, Array, list[float]]:
    """Times, the command over them, and when it changes: ahead, reversed, stopped."""
    ramp = sum(top / rate for rate in (motor.n_acc, motor.n_dec) if math.isfinite(rate))
    hold = 2.3 * ramp + 5.0 * motor.T_1 + 2.0 * motor.T_t
    changes = [0.2 * hold, 1.2 * hold, 2.3 * hold]
    t = np.linspace(0.0, 3.0 * hold, _SAMPLES)
    command = np.select([t < changes[0], t < changes[1], t < changes[2]], [0.0, top, -low], 0.0)
    return t, np.asarray(command), changes


def _rates(axes: Axes, motor: Motor, top: float, low: float, changes: list[float]) -> None:
    """Name and number of the rate beside each ramp."""
    up, down = top / motor.n_acc, top / motor.n_dec
    behind, unit = motor.T_t + 1.2 * motor.T_1, motor.printed_unit
    for begin, height, name, rate in (
        (changes[0] + 0.5 * up, 0.5 * top, "acc", motor.n_acc),
        (changes[1] + 0.5 * down, 0.5 * top, "dec", motor.n_dec),
        (changes[1] + down + 0.5 * low / motor.n_acc, -0.5 * low, "acc", motor.n_acc),
    ):
        if height == 0.0:  # a motor that does not run astern
            continue
        axes.annotate(
            # In two lines: beside a ramp there is half as much room as a sentence takes.
            f"${motor.letter}_{{{name}}}$ =\n{number(rate)}{'' if unit in ('', '1') else f' {unit}'}/s",
            (begin + behind, height),
            (3, 0),
            textcoords="offset points",
            fontsize=7,
            va="center",
        )
