"""Figure of failure boundaries: the failure probability over one variable, or the sides over two.

Held by ``tests/verification/test_boundary.py``.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.file_names import file_name, free_name
from seatrial.report.plot.style import (
    FAINT,
    MEASURED,
    RESIDUAL,
    SHADE,
    SIMULATED,
    house_style,
    new_figure,
    panel_title,
    save,
)
from seatrial.statistics.proportions import share

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.verification.boundary import FailureBoundary, RequirementBoundary

_SAFE, _UNSAFE = "#CFE3F2", "#F4D3BE"


def boundary_gallery(
    boundaries: FailureBoundary, folder: str | Path, *, formats: tuple[str, ...] = ("png",)
) -> list[Path]:
    """Paths of the figures of the boundaries after they were written into a folder, one per requirement.

    Raises
    ------
    SeatrialError
        The folder cannot be written.
    """
    written: list[Path] = []
    taken: set[str] = set()
    for requirement in boundaries.requirements:
        name = free_name(file_name(f"boundary_{requirement.requirement.name}", instead="_"), taken)
        taken.add(name)
        written += save(boundary_figure(boundaries, requirement), Path(folder) / name, formats=formats)
    return written


def boundary_figure(boundaries: FailureBoundary, boundary: RequirementBoundary) -> Figure:
    """Figure of a requirement's failure boundary with its uncertainty and the places that were flown.

    Parameters
    ----------
    boundaries : FailureBoundary
    boundary : RequirementBoundary
        Of its requirements.
    """
    with house_style():
        figure = new_figure(3.1 if len(boundaries.variables) == 1 else 4.6)
        axes = figure.subplots()
        (_curve if len(boundaries.variables) == 1 else _map)(axes, boundaries, boundary)
        panel_title(axes, boundary.requirement.name, boundary.requirement.holds)
    return figure


def _curve(axes: Axes, boundaries: FailureBoundary, boundary: RequirementBoundary) -> None:
    from scipy.special import ndtr

    surface = boundary.surface
    x = np.array([boundaries.value(0, at) for at in surface.axis])
    low, high = (ndtr(surface.mean + sign * surface.quantile * surface.sd) for sign in (-1.0, 1.0))
    sure = f"{100.0 * boundaries.scenario.flights.table.confidence:g} %"
    axes.fill_between(x, low, high, color=SIMULATED, alpha=0.2, linewidth=0.0, label=f"{sure} band")
    axes.plot(x, surface.probability, color=SIMULATED, label="failure probability")
    allowed = boundary.requirement.allowed
    axes.axhline(allowed, color=RESIDUAL, linewidth=0.9, label=f"allowed, {share(allowed)}")
    for k, (value, start, stop, _) in enumerate(boundaries.crossings(boundary.requirement.name)):
        label = f"boundary and its {sure} interval" if k == 0 else None
        axes.axvspan(start, stop, color=SHADE, linewidth=0.0, zorder=0.5, label=label)
        axes.axvline(value, color=MEASURED, linewidth=0.9, linestyle="--", zorder=1.0)
    axes.plot(
        boundaries.places[:, 0], np.zeros(len(boundaries.places)), "|", color=FAINT, label="places flown"
    )
    axes.set_xlim(x[0], x[-1])
    top = float(np.max(surface.probability))
    axes.set_ylim(-0.02 * max(top, 3.0 * allowed), max(1.1 * top, 3.0 * allowed))
    axes.set_xlabel(_label(next(iter(boundaries.variables))))
    axes.set_ylabel("failure probability")
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), fontsize="small")


def _map(axes: Axes, boundaries: FailureBoundary, boundary: RequirementBoundary) -> None:
    from matplotlib.colors import ListedColormap
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    surface = boundary.surface
    first, second = ([boundaries.value(k, at) for at in surface.axis] for k in (0, 1))
    off = (surface.mean - surface.level) / np.maximum(surface.sd, 1e-12)
    edges: list[float] = [-np.inf, -surface.quantile, surface.quantile, np.inf]
    colours: Any = ListedColormap([_SAFE, "white", _UNSAFE]).colors
    axes.contourf(first, second, np.clip(off, -1e6, 1e6).T, levels=np.clip(edges, -1e7, 1e7), colors=colours)
    over = (surface.mean - surface.level).T
    sure = f"{100.0 * boundaries.scenario.flights.table.confidence:g} %"
    handles: list[Any] = [
        Patch(color=_SAFE, label=f"holds, {sure} sure"),
        Patch(facecolor="white", edgecolor=FAINT, label="not known"),
        Patch(color=_UNSAFE, label=f"fails, {sure} sure"),
    ]
    if over.min() < 0.0 < over.max():
        axes.contour(first, second, over, levels=[0.0], colors=[MEASURED], linewidths=1.2)
        allowed = share(boundary.requirement.allowed)
        handles.append(Line2D([], [], color=MEASURED, label=f"failure probability {allowed}"))
    axes.plot(
        boundaries.places[:, 0], boundaries.places[:, 1], ".", color=FAINT, markersize=3.0, clip_on=False
    )
    handles.append(Line2D([], [], marker=".", color=FAINT, linestyle="", label="places flown"))
    axes.grid(visible=False)
    axes.set_xlabel(_label(next(iter(boundaries.variables))))
    axes.set_ylabel(_label(list(boundaries.variables)[1]))
    axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.01, 1.0), fontsize="small")


_UNITS = (("_m_s", "m/s"), ("_deg", "deg"), ("_kg", "kg"), ("_m", "m"), ("_s", "s"), ("_v", "V"))


def _label(name: str) -> str:
    """The variable in words with its unit; a coefficient as it is called."""
    for ending, unit in _UNITS:
        if name.endswith(ending) and "." not in name:
            return f"{name.removesuffix(ending).replace('_', ' ')}, {unit}"
    return name
