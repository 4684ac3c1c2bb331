"""Performance and characteristic of a vehicle: speed, power and range over revolutions, turns, thrust.

Steady motion is from `seatrial.vehicle.steady_state`; tracks are runs of the whole chain in the horizontal
plane; thrust over command at rest and under way has a panel per group of like actuators. Held by
`tests/vehicle/test_performance.py`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.arrays import Array
from seatrial.report.plot import style as pen
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
    from matplotlib.lines import Line2D

    from seatrial._core import Vehicle

Pair = tuple[float, float]


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
        return max(known) if known else 0.5 if self.unit == "rad" else 2.0 * max(*self.minimum, 50.0)


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


@dataclass(frozen=True)
class PerformanceFigureSettings:
    """Layout of speed and turning, inches, and where turns are drawn."""

    height: float = 4.9  #: Of the figure.
    top: float = 0.62  #: Above the panels, for title and legend.
    bottom: float = 0.5  #: Below the panels, for the label of the command.
    gap: float = 0.36  #: Between two panels above each other.
    left: float = 0.55  #: Beside the panels, for their labels.
    wide: float = 2.55  #: Of the panels over the command.
    axis: float = 0.5  #: For an axis at the right of a panel.
    legend: float = 0.9  #: Below the turning circles.
    turn_share: float = 0.5  #: Of the largest command, at which turns are drawn.


SETTINGS = PerformanceFigureSettings()

_ABOVE: pen.Style = {**pen.ABOVE, "ncols": 2, "borderaxespad": 0.0, "fontsize": 6.5}

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
    # Round speeds lie on the curves as dots, and so do their commands among those of the curves.
    marks = [
        cruise(vehicle, speed * KNOT_M_S, voltage_v=voltage_v) for speed in round_speeds_kn(rows[-1].speed_kn)
    ]
    held = [row for row in marks if row is not None]
    rows = tuple(sorted((*rows, *held), key=lambda row: row.command))
    turning = turns(vehicle, voltage_v=voltage_v, shares=(SETTINGS.turn_share,))
    curves = [_speed, _thrust if rows[-1].power_w is None else _power]
    if rows[-1].endurance_h is not None:
        curves.append(_range)
    page = SETTINGS
    with pen.house_style():
        wide = pen.WIDTH_IN if turning else page.left + page.wide + page.axis
        figure = pen.new_figure(page.height, width_in=wide, constrained=False)

        def panel(left: float, bottom: float, width: float, height: float) -> Axes:
            box = (left / wide, bottom / page.height, width / wide, height / page.height)
            return figure.add_axes(box)

        each = (page.height - page.top - page.bottom + page.gap) / len(curves)
        for k, draw in enumerate(curves):
            bottom = page.bottom + (len(curves) - 1 - k) * each
            axes = panel(page.left, bottom, page.wide, each - page.gap)
            draw(axes, rows, held, vehicle)
            axes.margins(x=0.02)
            if k < len(curves) - 1:
                axes.tick_params(labelbottom=False)
        axes.set_xlabel(_command_label(vehicle, rows[0].unit))
        if turning:
            left = page.left + page.wide + page.axis + page.left
            below = page.bottom + page.legend
            axes = panel(left, below, wide - left - 0.1, page.height - page.top - below)
            _circles(axes, vehicle, turning, voltage_v)
            axes.legend(
                loc="lower center",
                bbox_to_anchor=((left - 0.3) / wide, 0.06 / page.height, (wide - left + 0.3) / wide, 0.1),
                bbox_transform=figure.transFigure,
                borderaxespad=0.0,
                title="inner side from the dot on: steady radius and rate",
                title_fontsize=7.5,
            )
        pen.page_heading(
            figure, f"{vehicle.name}: speed and turning" if turning else f"{vehicle.name}: speed"
        )
    return figure


def _shares(vehicle: Vehicle) -> list[float]:
    """Shares of the largest command for the curves, from the least that the motor holds."""
    first, sense = next(iter(drivers(vehicle).items()))
    facts = vehicle.actuator_info()[first]
    least = float(facts["minimum_ahead" if sense > 0.0 else "minimum_astern"]) / largest(facts, sense)
    shares = [0.05 * k for k in range(1, 21)]
    return [*([least] if least > shares[0] else []), *(share for share in shares if share > least)]


def track(vehicle: Vehicle, turn: Turn, *, voltage_v: float = NOMINAL_V) -> Array:
    """Track (n, 2) in m, advance and transfer, from straight running into a turn of 540 degrees.

    At [0, 0] the inner side leaves the outer one's command for its own.
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


def _over_command(axes: Axes, rows: Sequence[Speed], values: ArrayLike, **look: Any) -> Line2D:
    """Curve of a quantity over the command of the actuators that drive ahead."""
    (curve,) = axes.plot([row.command for row in rows], values, **{"color": pen.CYCLE[0], **look})
    return curve


def _from_zero(axes: Axes, label: str) -> None:
    """Vertical axis from zero on, with its label."""
    axes.set_ylabel(label)
    axes.set_ylim(bottom=0.0)
    axes.locator_params(axis="y", nbins=5)


def _speed(axes: Axes, rows: tuple[Speed, ...], held: list[Speed], vehicle: Vehicle) -> None:
    _over_command(axes, rows, [row.speed_m_s for row in rows])
    _over_command(axes, held, [row.speed_m_s for row in held], marker="o", linestyle="none", markersize=3)
    _from_zero(axes, "speed, m/s")
    knots = axes.secondary_yaxis("right", functions=(_to_kn, lambda kn: np.asarray(kn) * KNOT_M_S))
    knots.set_ylabel("kn")
    # At the heights of the ticks at the left: one grid for both.
    knots.set_yticks(_to_kn([tick for tick in axes.get_yticks() if tick <= axes.get_ylim()[1]]))
    knots.yaxis.set_major_formatter(lambda speed, _: f"{speed:.1f}")
    knots.spines["right"].set_visible(True)
    remark = ", ".join(f"{row.speed_kn:g}" for row in held)
    pen.panel_title(axes, "speed", f"dots at {remark} kn" if held else "")


def _thrust(axes: Axes, rows: tuple[Speed, ...], held: list[Speed], vehicle: Vehicle) -> None:
    _over_command(axes, rows, [row.thrust_n for row in rows])
    _over_command(axes, held, [row.thrust_n for row in held], marker="o", linestyle="none", markersize=3)
    _from_zero(axes, "thrust, N")
    pen.panel_title(axes, "thrust at that speed")


def _power(axes: Axes, rows: tuple[Speed, ...], held: list[Speed], vehicle: Vehicle) -> None:
    hotel = vehicle.power().get("hotel_w", 0.0)
    power = np.array([row.power_w or 0.0 for row in rows])
    _over_command(axes, rows, power, label="propulsion")
    if hotel:
        _over_command(axes, rows, power + hotel, linestyle=_DASHES[1], label=f"with {hotel:g} W hotel load")
        axes.legend(**_ABOVE)
    _from_zero(axes, "power, W")
    pen.panel_title(axes, "power")


def _range(axes: Axes, rows: tuple[Speed, ...], held: list[Speed], vehicle: Vehicle) -> None:
    battery = vehicle.power()["battery_wh"]
    far = _over_command(axes, rows, [row.range_km or 0.0 for row in rows], label=f"range with {battery:g} Wh")
    _from_zero(axes, "range, km")
    hours = axes.twinx()
    look: pen.Style = {"color": pen.CYCLE[5], "linestyle": _DASHES[1]}
    long = _over_command(hours, rows, [row.endurance_h or 0.0 for row in rows], label="endurance", **look)
    hours.set_ylabel("endurance, h")
    hours.set_ylim(bottom=0.0)
    hours.grid(visible=False)
    hours.spines["right"].set_visible(True)
    _as_left(axes, hours)
    axes.legend(handles=[far, long], **_ABOVE)
    pen.panel_title(axes, "range")


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
        turning, (pen.CYCLE[0], pen.CYCLE[5], pen.CYCLE[2], pen.INK), _DASHES, strict=False
    ):
        path = track(vehicle, turn, voltage_v=voltage_v)
        digits = 2 if turn.radius_m < 10.0 else 1
        label = f"{_LABELS[turn.kind]}: {turn.radius_m:.{digits}f} m, {abs(turn.rate_deg_s):.1f}°/s"
        axes.plot(path[:, 1], path[:, 0], color=colour, linestyle=dashes, label=label)
    axes.plot([0.0, 0.0], [-0.6 * widest, 0.0], color=pen.FAINT, linewidth=1.6, zorder=1)
    axes.plot(0.0, 0.0, "o", color=pen.INK, markersize=3.5, zorder=5)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("transfer to starboard, m")
    axes.set_ylabel("advance, m")
    facts = vehicle.actuator_info()
    first, sense = next(iter(drivers(vehicle).items()))
    outer = SETTINGS.turn_share * largest(facts[first], sense)
    pen.panel_title(axes, "turning circles", f"outer side at {outer:.4g} {facts[first]['unit']}")


def characteristic(
    vehicle: Vehicle,
    *,
    speeds_m_s: Sequence[float] = (0.0, 1.0, 2.0),
    voltages_v: Sequence[float] = (12.0, NOMINAL_V, 16.0),
) -> Figure:
    """Figure of the thrust or fin force of each group's first actuator over its command.

    At speeds ahead where thrust falls with inflow, and at supply voltages where it depends on them.
    """
    panels = _characteristics(vehicle, speeds_m_s, voltages_v)
    columns = min(len(panels), 3)
    rows = -(-len(panels) // columns)
    labels = dict.fromkeys(label for panel in panels for label, _ in panel.curves)
    looks = dict(
        zip(labels, zip(cycle(pen.CYCLE), cycle((*_DASHES, *_DASHES[:2])), strict=False), strict=False)
    )
    with pen.house_style():
        figure = pen.new_figure(0.3 + 2.5 * rows, width_in=pen.COLUMN_IN if columns == 1 else pen.WIDTH_IN)
        drawn = {}
        # One look per label through all panels, so that one legend serves them.
        for axes, panel in zip(pen.grid_of(figure, len(panels), columns).flat, panels, strict=False):
            facts = vehicle.actuator_info()[panel.name]
            fin, neutral = facts["kind"] == "fin", float(facts["neutral"])
            unit = {"us": "\N{MICRO SIGN}s", "rad": "deg"}.get(str(facts["unit"]), str(facts["unit"]))
            shown = np.degrees(panel.steps) if facts["unit"] == "rad" else panel.steps
            for label, force in panel.curves:
                colour, dashes = looks[label]
                (drawn[label],) = axes.plot(shown, force, color=colour, linestyle=dashes)
            axes.axhline(0.0, color=pen.INK, linewidth=0.5)
            axes.axvline(0.0, color=pen.INK, linewidth=0.5)
            from_neutral = f" from neutral ({neutral:g} {unit})" if neutral else ""
            axes.set_xlabel(f"command{from_neutral}, {unit}")
            axes.set_ylabel("fin force, N" if fin else "thrust, N")
            axes.locator_params(nbins=6 if columns < 3 else 5)
            pen.panel_title(axes, ", ".join(panel.groups), f"as {panel.name}")
        figure.legend(drawn.values(), drawn, loc="outside lower center", ncols=3)
    return figure


@dataclass(frozen=True, eq=False)
class _Characteristic:
    """Force (n,), N, per label over commands from neutral (n,), of groups that have the same one."""

    name: str
    groups: list[str]
    steps: Array
    curves: list[tuple[str, Array]]


def _characteristics(
    vehicle: Vehicle, speeds_m_s: Sequence[float], voltages_v: Sequence[float]
) -> list[_Characteristic]:
    """What every group does over its command; groups that do the same share a panel."""
    facts = vehicle.actuator_info()
    first_of: dict[str, str] = {}
    for name in vehicle.actuators:
        first_of.setdefault(str(facts[name]["group"]) or name, name)
    panels: list[_Characteristic] = []
    for group, name in first_of.items():
        ahead = largest(facts[name], 1.0)
        astern = largest(facts[name], -1.0) if facts[name]["maximum_astern"] else 0.1 * ahead
        steps = np.linspace(-astern, ahead, 161)  # points that print as a smooth curve
        curves = _curves(vehicle, name, steps, speeds_m_s, voltages_v)
        like = next((panel for panel in panels if _equal(panel.curves, curves)), None)
        if like is None:
            panels.append(_Characteristic(name, [group], steps, curves))
        else:
            like.groups.append(group)
    return panels


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
