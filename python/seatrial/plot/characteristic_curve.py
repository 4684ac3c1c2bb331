"""Characteristic: thrust over command, at rest and under way, one panel per group of like actuators."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.check.actuators import NOMINAL_V, largest, settling_s, voltage_for
from seatrial.plot.style import COLUMN_IN, CYCLE, WIDTH_IN, house_style, new_figure, panel_title

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from seatrial._core import Vehicle

__all__ = ["characteristic", "thrust"]

Array = NDArray[np.float64]

_POINTS = 161
_DASHES = ("-", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (5, 1.5, 1.2, 1.5)), "-", (0, (5, 1.5)))


def characteristic(
    vehicle: Vehicle,
    *,
    speeds_m_s: Sequence[float] = (0.0, 1.0, 2.0),
    voltages_v: Sequence[float] = (12.0, NOMINAL_V, 16.0),
) -> Figure:
    """Figure of the thrust of each group's first actuator over its command.

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
        figure = new_figure(2.6, width_in=COLUMN_IN if len(panels) == 1 else WIDTH_IN)
        grid = figure.subplots(1, len(panels), squeeze=False)
        for axes, (name, (alike, steps, curves)) in zip(grid[0], panels.items(), strict=True):
            unit = str(facts[name]["unit"]).replace("us", "\N{MICRO SIGN}s")
            for colour, dashes, (label, force) in zip(CYCLE, _DASHES, curves, strict=False):
                axes.plot(steps, force, color=colour, linestyle=dashes, label=label)
            axes.axhline(0.0, color="#262626", linewidth=0.5)
            axes.axvline(0.0, color="#262626", linewidth=0.5)
            neutral = float(facts[name]["neutral"])
            axes.set_xlabel(
                f"command from neutral ({neutral:g} {unit}), {unit}" if neutral else f"command, {unit}"
            )
            axes.set_ylabel("thrust, N")
            axes.legend(loc="upper left")
            axes.locator_params(nbins=6)
            panel_title(axes, ", ".join(alike), f"as {name}")
    return figure


def _equal(one: list[tuple[str, Array]], other: list[tuple[str, Array]]) -> bool:
    return [label for label, _ in one] == [label for label, _ in other] and all(
        a.shape == b.shape and np.allclose(a, b) for (_, a), (_, b) in zip(one, other, strict=True)
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
    found = []
    for step in np.asarray(steps, dtype=float):
        commands: dict[str, ArrayLike] = {name: np.full(len(t), facts["neutral"] + sense * step)}
        initial = State(nu=[speed_m_s, 0.0, 0.0, 0.0, 0.0, 0.0])
        run = vehicle.simulate(
            t, commands, initial, free="", voltage=voltage_for(vehicle, t, voltage_v), max_step=0.05
        )
        found.append(float(np.asarray(run.tau)[-1, axis] / direction[axis]))
    return np.array(found)
