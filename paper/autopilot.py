"""Block diagrams of the autopilot: the control loop, and one of its adaptive PID controllers from inside.

Above: from waypoints to commands and back over the sensors (Taubert et al. 2014, figure 16 (control loop),
with the parts that the core has: mode table, reference filters, safety, inverse characteristic). Below: a
loop with its features: gains scheduled over the desired speed, derivative on the measurement, anti-windup
and reset bias by what the allocation reached (figure 18 (PID controller), equation 54 corrected). Held by
`tests/examples/test_control_diagrams.py`.

Sketch of the line of sight in both planes: errors, lookahead point and desired angles with their signs.

Drawn from the formulas, so that the arrow of the line of sight ends at the lookahead point: `psi_d = pi_p -
atan(y_e / Delta)` and `theta_d = gamma_p + atan(z_e / Delta_z)`, with `y_e` positive to starboard of the
path and `z_e` positive below it (Taubert et al. 2014, figure 17 (line of sight) and equation 51 corrected;
Fossen 2011, section 10.3). Held by `tests/examples/test_control_diagrams.py`.

Plates of the gallery on the autopilot: its structure, the line of sight, and a flight with its mission.

Held by `tests/report/test_flight_figures.py`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from paper.diagram import bar, block, connect, dot, page, summing, words
from paper.plates import Plate
from seatrial.base.arrays import Array
from seatrial.base.errors import SeatrialError
from seatrial.report.plot.style import (
    HULL_EDGE,
    MEASURED,
    RESIDUAL,
    SIMULATED,
    WIDTH_IN,
    house_style,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from paper.diagram import Block
    from seatrial._core import Vehicle
    from seatrial.flight.flight import Flight

_HEIGHT_IN, _LOOP_IN = 5.3, 2.76

_MINUS = "\N{MINUS SIGN}"


def control_structure() -> Figure:
    """Figure of the autopilot's structure: (a) the control loop, (b) a loop's adaptive PID controller."""
    with house_style():
        figure, axes = page(WIDTH_IN, _HEIGHT_IN)
        words(axes, (0.02, _HEIGHT_IN - 0.1), "(a) control loop", size_pt=8.5, ha="left", weight="bold")
        _control_loop(axes, _LOOP_IN)
        words(axes, (0.02, _LOOP_IN - 0.32), "(b) one loop of (a)", size_pt=8.5, ha="left", weight="bold")
        _controller(axes)
    return figure


def _control_loop(axes: Axes, foot: float) -> None:
    """Guidance, filter, control law, allocation, vehicle; above what switches, below what is measured."""
    low, main, top = foot + 0.18, foot + 1.1, foot + 1.98
    guidance = block(axes, (0.92, main), (0.86, 0.6), "guidance", ["line of sight", "in both planes"])
    reference = block(axes, (1.98, main), (0.74, 0.6), "reference\nfilters", ["3rd order"])
    error = summing(axes, (2.66, main))
    law = block(axes, (3.3, main), (0.8, 0.6), "adaptive PID", ["decoupled loops,", "see (b)"])
    body = block(axes, (3.985, main), (0.25, 0.28), r"$\mathbf{J}^T$")
    allocation = block(
        axes, (4.72, main), (0.74, 0.6), "allocation", [r"$f = \mathbf{B}^{+}\tau_d$,", "limits"]
    )
    inverse = block(axes, (5.645, main), (0.74, 0.6), "inverse char-\nacteristic", ["inflow, minimum"])
    vehicle = block(axes, (6.535, main), (0.56, 0.6), "vehicle", ["motors,", "6 DOF"])
    words(axes, (0.02, main + 0.1), r"$w_k$, $U_k$", size_pt=8, ha="left")
    words(axes, (0.02, main - 0.1), "mission", ha="left")
    connect(axes, (0.02, main), guidance.left)
    for former, latter, said in (
        (guidance, reference, r"$r$"),
        (reference, error, r"$r_f$"),
        (error, law, r"$e$"),
        (law, body, r"$\tau$"),
        (body, allocation, r"$\tau_d$"),
        (allocation, inverse, r"$f$"),
        (inverse, vehicle, r"$u_A$"),
    ):
        connect(axes, former.right, latter.left)
        words(axes, (0.5 * (former.right[0] + latter.left[0]) - 0.03, main + 0.1), said, size_pt=8)
    connect(axes, vehicle.right, (WIDTH_IN - 0.02, main))
    words(axes, (WIDTH_IN - 0.13, main + 0.1), r"$\eta, \nu$", size_pt=8)
    connect(axes, (vehicle.x, main + 0.62), vehicle.top)
    words(axes, (vehicle.x, main + 0.7), "current, faults")
    _switches(axes, top, (guidance.x, law, allocation))
    _feedback(axes, (low, main), (guidance.x, error.x, law.x, vehicle.right[0]))


def _switches(axes: Axes, top: float, under: tuple[float, Block, Block]) -> None:
    """Safety and mode table, and the wrench that the allocation reached."""
    guided, law, allocation = under
    safety = block(axes, (1.98, top), (1.02, 0.42), "safety", ["hold, surface or abort"])
    modes = block(
        axes, (3.98, top), (1.7, 0.42), "mode table", ["hover, cruise: loops and actuators at work"]
    )
    words(axes, (safety.x, safety.top[1] + 0.2), "limits, stale data, signals, battery")
    connect(axes, (safety.x, safety.top[1] + 0.13), safety.top)
    connect(axes, safety.left, (guided, top), (guided, law.top[1]))
    words(axes, (guided + 0.06, top - 0.3), "reaction", ha="left")
    connect(axes, safety.right, modes.left)
    words(axes, (0.5 * (safety.right[0] + modes.left[0]), top + 0.09), "failed")
    words(axes, (modes.x, modes.top[1] + 0.2), "speed $u$ with hysteresis, holding")
    connect(axes, (modes.x, modes.top[1] + 0.13), modes.top)
    connect(axes, (law.x - 0.1, modes.bottom[1]), (law.x - 0.1, law.top[1]))
    connect(axes, (allocation.x + 0.04, modes.bottom[1]), (allocation.x + 0.04, allocation.top[1]))
    back = law.top[1] + 0.15
    connect(
        axes,
        (allocation.x - 0.14, allocation.top[1]),
        (allocation.x - 0.14, back),
        (law.x + 0.14, back),
        (law.x + 0.14, law.top[1]),
    )
    words(axes, (0.5 * (law.x + allocation.x), back + 0.09), r"reached wrench $\tau_a$")


def _feedback(axes: Axes, rows: tuple[float, float], at: tuple[float, ...]) -> None:
    """Sensors, and the measurement's way to all that need it."""
    low, main = rows
    guided, error, law, out = at
    tap = out + 0.1
    sensors = block(axes, (6.0, low), (0.9, 0.32), "sensors", ["noise, latency, gaps"])
    known = block(
        axes, (4.25, low + 0.4), (1.1, 0.34), "feed-forward", [r"$g(\eta)$, drag, $\mathbf{M}\,\ddot{r}_f$"]
    )
    dot(axes, (tap, main))
    connect(axes, (tap, main), (tap, low), sensors.right)
    connect(axes, sensors.left, (guided, low), (guided, main - 0.3))
    words(axes, (sensors.left[0] - 0.3, low + 0.1), r"$y$, $\dot{y}$", size_pt=8)
    for x, end in ((error, main - 0.08), (law - 0.16, main - 0.3), (known.x, known.bottom[1])):
        dot(axes, (x, low))
        connect(axes, (x, low), (x, end))
    words(axes, (error - 0.09, main - 0.18), _MINUS, size_pt=8)
    words(axes, (law - 0.08, main - 0.42), r"$\dot{y}$", size_pt=8)
    words(axes, (guided + 0.09, main - 0.42), r"$y$", size_pt=8)
    connect(axes, known.left, (law + 0.16, known.y), (law + 0.16, main - 0.3))
    words(axes, (law + 0.27, main - 0.42), r"$\tau_{ff}$", size_pt=8)


def _controller(axes: Axes) -> None:
    """Filter, proportional, integral and derivative lanes with scheduled gains, limit and switch."""
    integral, proportional, derivative, known = 1.62, 1.12, 0.62, 0.19
    reference = block(
        axes,
        (0.98, 0.5 * (proportional + derivative)),
        (0.86, 0.86),
        "reference\nfilter",
        [r"$\omega$, critically", "damped"],
    )
    error, rate = summing(axes, (1.86, proportional)), summing(axes, (1.86, derivative))
    sums = bar(axes, 4.66, known - 0.1, integral + 0.14)
    limit = block(axes, (5.24, proportional), (0.6, 0.5), "", ["limit", r"$\pm\tau_{max}$"], shift=0.1)
    _saturation(axes, limit)
    words(axes, (0.02, proportional + 0.1), r"$r$ desired", size_pt=7.5, ha="left")
    connect(axes, (0.02, proportional), (reference.left[0], proportional))
    words(axes, (0.02, integral + 0.1), r"$y$ measured", size_pt=7.5, ha="left")
    connect(axes, (0.02, integral), (error.x, integral), error.top)
    words(axes, (error.x - 0.09, error.top[1] + 0.09), _MINUS, size_pt=8)
    connect(axes, (reference.right[0], proportional), error.left)
    words(axes, (1.56, proportional + 0.1), r"$r_f$", size_pt=8)
    connect(axes, (reference.right[0], derivative), rate.left)
    words(axes, (1.56, derivative + 0.11), r"$\dot{r}_f$", size_pt=8)
    connect(axes, (rate.x, known - 0.02), rate.bottom)
    words(axes, (rate.x - 0.06, known + 0.1), r"$\dot{y}$ measured", size_pt=7.5, ha="right")
    words(axes, (rate.x - 0.09, rate.bottom[1] - 0.09), _MINUS, size_pt=8)
    words(axes, (2.06, proportional - 0.1), "wrapped", size_pt=6.5, ha="left")
    words(axes, (2.06, proportional + 0.1), r"$e$", size_pt=8)
    fork = (2.28, proportional)
    dot(axes, fork)
    schedule = block(axes, (2.98, 2.16), (1.3, 0.36), "gain schedule", ["six supporting points"])
    words(axes, (schedule.left[0] - 0.32, schedule.y + 0.1), r"$u_d$", size_pt=8)
    connect(axes, (schedule.left[0] - 0.42, schedule.y), schedule.left)
    lanes = ((integral, "T_s K_I"), (proportional, "K_P"), (derivative, "K_D"))
    gains = [block(axes, (schedule.x, y), (0.66, 0.3), rf"${gain}(u_d)$") for y, gain in lanes]
    for former, latter in zip((schedule, *gains), gains, strict=False):
        connect(axes, former.bottom, latter.top)
    memory = block(axes, (4.0, integral), (0.72, 0.34), r"$I(k)$", ["integral part"])
    connect(axes, fork, (fork[0], integral), gains[0].left)
    connect(axes, gains[0].right, memory.left)
    connect(axes, memory.right, (sums.left[0], integral))
    connect(axes, error.right, gains[1].left)
    connect(axes, rate.right, gains[2].left)
    for gain, y in ((gains[1], proportional), (gains[2], derivative)):
        connect(axes, gain.right, (sums.left[0], y))
    ahead = block(
        axes, (schedule.x, known), (1.3, 0.28), "", ["feed-forward: restoring,", "drag, acceleration"]
    )
    connect(axes, ahead.right, (sums.left[0], known))
    words(axes, (ahead.right[0] + 0.3, known + 0.1), r"$\tau_{ff}$", size_pt=8)
    _leaving(axes, (sums, limit, memory), schedule.y)


def _leaving(axes: Axes, blocks: tuple[Block, Block, Block], top: float) -> None:
    """From the sum to the allocation, and what it reached back to the integral part."""
    sums, limit, memory = blocks
    y = limit.y
    connect(axes, (sums.right[0], y), limit.left)
    switch = block(axes, (5.92, y), (0.44, 0.3), "switch")
    connect(axes, limit.right, switch.left)
    allocation = block(axes, (6.68, y), (0.62, 0.36), "allocation")
    connect(axes, switch.right, allocation.left)
    words(axes, (0.5 * (switch.right[0] + allocation.left[0]), y + 0.1), r"$\tau_d$", size_pt=8)
    connect(axes, (switch.x, y - 0.45), switch.bottom)
    words(axes, (switch.x, y - 0.53), "mode table: loop active")
    connect(axes, allocation.top, (allocation.x, top), (memory.x, top), memory.top)
    words(axes, (allocation.x - 0.06, top + 0.1), r"reached: $\tau_a$", size_pt=7.5, ha="right")
    words(axes, (memory.x + 0.08, top - 0.12), r"anti-windup by $\tau_a - \tau_d$;", ha="left")
    words(axes, (memory.x + 0.08, top - 0.25), r"preset where the loop enters (bumpless)", ha="left")


def _saturation(axes: Axes, limit: Block) -> None:
    """Picture of a limit in its box."""
    x, y, a = limit.x, limit.y + 0.13, 0.07
    axes.plot([x - 2 * a, x - a, x + a, x + 2 * a], [y - a, y - a, y + a, y + a], color=SIMULATED, zorder=5)


_INK = "#262626"

_LENGTH, _R_0 = 10.0, 1.1

_HULL = np.array([[0.75, 0.0], [0.35, 0.17], [-0.6, 0.17], [-0.75, 0.0], [-0.6, -0.17], [0.35, -0.17]])


@dataclass(frozen=True)
class Sight:
    """A line of sight on a page: points (right, up), the path's direction and the desired one, rad.

    Angles are measured from the first axis of the plane towards the second: north to east, or forward to up.
    """

    vehicle: Array
    foot: Array
    ahead: Array
    along: float
    desired: float


def sight(plane: str, along: float, way: float, error: float, lookahead: float) -> Sight:
    """Line of sight of a path from the origin in a plane ("horizontal" or "vertical").

    Parameters
    ----------
    plane : str
    along : float
        Course pi_p or slope gamma_p of the path, rad.
    way : float
        How far along the path the vehicle is, m.
    error : float
        y_e, positive to starboard, or z_e, positive below, m.
    lookahead : float
        Delta, m.
    """
    if plane == "horizontal":  # north is up, east to the right
        forward = np.array([math.sin(along), math.cos(along)])
        aside = np.array([math.cos(along), -math.sin(along)])
        desired = along - math.atan2(error, lookahead)
    else:  # forward to the right, depth downwards
        forward = np.array([math.cos(along), math.sin(along)])
        aside = np.array([math.sin(along), -math.cos(along)])
        desired = along + math.atan2(error, lookahead)
    foot = way * forward
    return Sight(foot + error * aside, foot, foot + lookahead * forward, along, desired)


def guidance_geometry() -> Figure:
    """Figure of the line of sight seen from above and from the side."""
    with house_style():
        figure = new_figure(3.0)
        above, beside = figure.subplots(1, 2, gridspec_kw={"wspace": 0.08})
        _horizontal(above)
        _vertical(beside)
    return figure


def _horizontal(axes: Axes) -> None:
    one = sight("horizontal", math.radians(52.0), 3.6, 2.6, 3.6)
    toward = np.array([math.sin(one.along), math.cos(one.along)])
    end = _LENGTH * toward
    _path(axes, one, end, ("$y_e$", r"$\Delta$"))
    for start, radius, angle, said in (
        (np.zeros(2), 1.7, one.along, r"$\pi_p$"),
        (one.vehicle, 2.4, one.desired, r"$\psi_d$"),
    ):
        _dashed(axes, start, start + np.array([0.0, radius + 0.5]))
        _angle(axes, start, radius, (math.pi / 2, math.pi / 2 - angle), said)
    _hull(axes, one.vehicle, math.pi / 2 - one.desired)
    _axes_of(axes, (7.3, -0.9), ("$y_n$ (east)", "$x_n$ (north)"), (1.0, 1.0))
    _finish(axes, "(a) horizontal plane", r"$\psi_d = \pi_p - \mathrm{atan}(y_e/\Delta)$")


def _vertical(axes: Axes) -> None:
    one = sight("vertical", math.radians(22.0), 3.6, 2.6, 3.9)
    end = _LENGTH * np.array([math.cos(one.along), math.sin(one.along)])
    _path(axes, one, end, ("$z_e$", r"$\Delta_z$"))
    for start, radius, angle, said in (
        (np.zeros(2), 2.1, one.along, r"$\gamma_p$"),
        (one.vehicle, 2.2, one.desired, r"$\theta_d$"),
    ):
        _dashed(axes, start, start + np.array([radius + 0.5, 0.0]))
        _angle(axes, start, radius, (0.0, angle), said)
    _hull(axes, one.vehicle, one.desired)
    _axes_of(axes, (-1.0, 6.3), ("along the leg", "$z_n$ (depth)"), (1.0, -1.0))
    _finish(axes, "(b) vertical plane", r"$\theta_d = \gamma_p + \mathrm{atan}(z_e/\Delta_z)$")


def _path(axes: Axes, one: Sight, end: Array, names: tuple[str, str]) -> None:
    """Leg with its sphere and plane of acceptance, error, lookahead and the line of sight."""
    from matplotlib.patches import Circle

    unit = end / np.hypot(*end)
    normal = np.array([-unit[1], unit[0]])
    axes.plot(*np.transpose([np.zeros(2), end]), color=MEASURED, linewidth=1.4, zorder=2)
    axes.add_patch(Circle(tuple(end), _R_0, facecolor="none", edgecolor=HULL_EDGE, linewidth=0.8))
    _dashed(axes, end - 2.0 * normal, end + 2.0 * normal)
    for point, said in ((np.zeros(2), r"$w_{k-1}$"), (end, r"$w_k$")):
        axes.plot(*point, "s", color=_INK, markersize=3.5, zorder=4)
        _word(axes, point + (0.5 * normal - 0.55 * unit if point is end else -0.75 * unit), said)
    spoke = math.cos(0.5) * unit - math.sin(0.5) * normal
    _arrow(axes, end, end + _R_0 * spoke, color=HULL_EDGE)
    _word(axes, end + (_R_0 + 0.5) * spoke, "$R_0$")
    plane = end - 2.0 * normal
    _word(axes, plane + np.array([-0.1, -0.05]), "plane: passed ", ha="right", size=6.5)
    _arrow(axes, one.foot, one.vehicle, color=RESIDUAL, both=True)
    _word(axes, 0.5 * (one.foot + one.vehicle) - 0.42 * unit, names[0], color=RESIDUAL)
    offset = 0.4 * normal
    _arrow(axes, one.foot + offset, one.ahead + offset, color=_INK, both=True)
    _word(axes, 0.5 * (one.foot + one.ahead) + 0.95 * normal, names[1])
    for point in (one.foot, one.ahead):
        axes.plot(*np.transpose([point, point + 0.55 * normal]), color=_INK, linewidth=0.6)
    axes.plot(*one.ahead, "o", color=SIMULATED, markersize=3.5, zorder=5)
    _arrow(axes, one.vehicle, one.ahead, color=SIMULATED, width=1.6)
    middle = 0.35 * one.vehicle + 0.65 * one.ahead
    side = one.ahead - one.vehicle
    side = np.array([side[1], -side[0]]) / np.hypot(*side)
    _word(axes, middle + 0.3 * side, "line of sight", color=SIMULATED, ha="left", size=6.5)


def _hull(axes: Axes, at: Array, angle: float) -> None:
    from matplotlib.patches import Polygon

    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    axes.plot(*at, "o", color=_INK, markersize=2.0, zorder=5)
    axes.add_patch(Polygon(at + _HULL @ turn, facecolor="#C9D3DA", edgecolor=_INK, linewidth=0.8, zorder=4))


def _angle(axes: Axes, at: Array, radius: float, ends: tuple[float, float], said: str) -> None:
    """Arc with an arrow's head from the first angle to the second, anticlockwise positive, and its name."""
    sweep = np.linspace(*ends, 40)
    points = at + radius * np.transpose([np.cos(sweep), np.sin(sweep)])
    axes.plot(*points[:-4].T, color=_INK, linewidth=0.8)
    _arrow(axes, points[-8], points[-1], color=_INK)
    middle = 0.5 * (ends[0] + ends[1])
    _word(axes, at + (radius + 0.45) * np.array([math.cos(middle), math.sin(middle)]), said)


def _axes_of(axes: Axes, at: tuple[float, float], names: tuple[str, str], way: tuple[float, float]) -> None:
    """Frame: the names of the axes to the right and up or down."""
    origin = np.array(at)
    right, up = np.array([1.5 * way[0], 0.0]), np.array([0.0, 1.5 * way[1]])
    _arrow(axes, origin, origin + right, color=_INK)
    _arrow(axes, origin, origin + up, color=_INK)
    _word(axes, origin + right + np.array([0.15, 0.0]), names[0], ha="left", size=6.5)
    _word(axes, origin + up + np.array([-0.1, 0.35 * way[1]]), names[1], ha="left", size=6.5)


def _dashed(axes: Axes, start: Array, end: Array) -> None:
    axes.plot(*np.transpose([start, end]), color=HULL_EDGE, linewidth=0.7, linestyle=(0, (4, 2.5)), zorder=1)


def _arrow(
    axes: Axes, start: Array, end: Array, *, color: str, both: bool = False, width: float = 0.8
) -> None:
    from matplotlib.patches import FancyArrowPatch

    axes.add_patch(
        FancyArrowPatch(
            tuple(start),
            tuple(end),
            arrowstyle="<|-|>,head_width=0.18,head_length=0.36"
            if both
            else "-|>,head_width=0.2,head_length=0.4",
            mutation_scale=9.0,
            color=color,
            linewidth=width,
            shrinkA=0.0,
            shrinkB=0.0,
            zorder=3,
        )
    )


def _word(
    axes: Axes, at: Array, said: str, *, color: str = _INK, ha: Any = "center", size: float = 8.5
) -> None:
    axes.text(float(at[0]), float(at[1]), said, color=color, ha=ha, va="center", fontsize=size, zorder=6)


def _finish(axes: Axes, name: str, formula: str) -> None:
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_axis_off()
    axes.margins(0.04)
    axes.set_title(name, loc="left", fontweight="bold")
    axes.set_title(formula, loc="right", fontsize=8)


_MISSION = """
format = 1
name = "box with a dive"
speed_m_s = {speed:.3f}
acceptance_radius_m = {radius:.3f}
[[legs]]
north_m = {side:.1f}
east_m = 0.0
depth_m = 10.0
[[legs]]
north_m = {side:.1f}
east_m = {side:.1f}
depth_m = 10.0
[[legs]]
north_m = 0.0
east_m = {side:.1f}
depth_m = 5.0
[[legs]]
north_m = 0.0
east_m = 0.0
depth_m = 5.0
"""

_SPEED_SHARE, _FASTEST_M_S = 0.6, 1.5

_CURRENT_SHARE, _STRONGEST_M_S = 0.2, 0.3

_LEG_S, _RADIUS_S = 80.0, 3.0


def autopilot_plates(vehicle: Vehicle, *, tuning: Iterable[Plate] = ()) -> Iterator[Plate]:
    """Plates of the autopilot, of its tuning, and of a flight where there is a built-in one of that name."""
    from seatrial._core import Autopilot

    if not vehicle.actuators:
        why = f"{vehicle.name} has no actuators, so nothing is controlled"
        yield Plate("control_structure", why, None, paper=(16, 17, 18))
        return
    yield Plate(
        "control_structure",
        "Structure of the autopilot: guidance, reference filters, decoupled adaptive PID controllers,"
        " allocation and inverse characteristic, with the mode table and safety; below, one controller with"
        " scheduled gains, derivative on the measurement, anti-windup, reset bias and feed-forward.",
        control_structure,
        paper=(16, 18),
    )
    yield Plate(
        "guidance",
        "Line of sight in both planes: cross-track error (positive to starboard), vertical error (positive"
        " below), lookahead distance, desired heading and pitch, sphere and plane of acceptance.",
        guidance_geometry,
        paper=(17,),
    )
    yield from tuning
    if vehicle.name not in Autopilot.names():
        yield Plate("flight_track", f"no flight: {vehicle.name} has no built-in autopilot", None)
        return
    try:
        flight = demonstration(vehicle)
    except SeatrialError as error:
        yield Plate("flight_track", f"no flight: {error}", None)
        return
    yield from flight_plates(flight)


def demonstration(vehicle: Vehicle) -> Flight:
    """Flight of a box with a dive in a cross current by the vehicle's built-in autopilot.

    Raises
    ------
    SeatrialError
        The autopilot does not fit the vehicle, or nothing drives it ahead.
    """
    from seatrial._core import Autopilot
    from seatrial.flight.conditions import Conditions, Water
    from seatrial.flight.flight import fly
    from seatrial.flight.mission import Mission
    from seatrial.vehicle.actuators import NOMINAL_V
    from seatrial.vehicle.steady_state import top_speed

    if (top := top_speed(vehicle)) is None:
        raise SeatrialError(f"nothing drives {vehicle.name} ahead at a steady speed")
    speed = min(_SPEED_SHARE * top.speed_m_s, _FASTEST_M_S)
    current = min(_CURRENT_SHARE * speed, _STRONGEST_M_S)
    text = _MISSION.format(speed=speed, side=_LEG_S * speed, radius=max(_RADIUS_S * speed, 1.0))
    needed = any(facts["needs_voltage"] for facts in vehicle.actuator_info().values())
    return fly(
        vehicle,
        Autopilot.load(vehicle.name),
        Mission.from_toml(text),
        water=Water(current=(0.0, current, 0.0)),
        conditions=Conditions(voltage_v=NOMINAL_V if needed else None),
    )


def flight_plates(flight: Flight) -> Iterator[Plate]:
    """Plates of a flight: mission, track, errors, loops, actuators."""
    from seatrial.report.plot.flight import flight_track
    from seatrial.report.plot.flight_errors import flight_actuators, flight_errors, flight_loops
    from seatrial.report.plot.track import mission_plan

    data = f"Data: simulated flight of {flight.vehicle.name} on the mission {flight.mission.name}."
    yield Plate(
        "mission",
        f"Mission {flight.mission.name} as planned: view from above and profile along the way.",
        partial(mission_plan, flight.mission, seabed=flight.circumstances.seabed),
    )
    yield Plate(
        "flight_track",
        f"Track of the flight beside the planned path, and depth over time. {data}",
        partial(flight_track, flight),
    )
    yield Plate(
        "flight_errors",
        "Cross-track and vertical error over time; shaded, the second half of each straight leg, over which"
        f" the errors are distributed as at the right (line: mean; dashed: 95 %). {data}",
        partial(flight_errors, flight),
    )
    yield Plate(
        "flight_loops",
        "Control loops: desired and actual values, demanded forces and moments and what the allocation"
        f" reached of them, modes. {data}",
        partial(flight_loops, flight),
    )
    yield Plate(
        "flight_actuators",
        f"Commands and signals of the actuators with their limits, and electrical power. {data}",
        partial(flight_actuators, flight),
    )
