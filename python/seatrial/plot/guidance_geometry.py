"""Sketch of the line of sight in both planes: errors, lookahead point and desired angles with their signs.

Drawn from the formulas, so that the arrow of the line of sight ends at the lookahead point: `psi_d = pi_p -
atan(y_e / Delta)` and `theta_d = gamma_p + atan(z_e / Delta_z)`, with `y_e` positive to starboard of the path
and `z_e` positive below it (Taubert et al. 2014, figure 15 and equation 51 corrected; Fossen 2011, section
10.3). Held by `tests/test_control_diagrams.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.plot.style import HULL_EDGE, MEASURED, RESIDUAL, SIMULATED, house_style, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Sight", "guidance_geometry", "sight"]

Array = NDArray[np.float64]

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
