"""The limit cycles of a relay tuning, a panel per loop and speed: what was measured and asked for.

Held by tests/test_relay_figure.py.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from seatrial.plot.style import SECOND, SIMULATED, house_style, new_figure
from seatrial.tuning.relay_trial import UNITS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.tuning.relay import RelayPoint, RelayTuning
    from seatrial.tuning.relay_trial import RelayTrial

__all__ = ["relay_cycles", "relay_pages"]

_COLUMNS, _ROW_IN = 3, 1.6
_ON_A_PAGE = 5 * _COLUMNS
_LETTERS = {
    "surge": "u",
    "sway": "v",
    "heave": "depth",
    "roll": "roll",
    "pitch": "pitch",
    "heading": "heading",
}
_GAIN_UNITS = {"m/s": "N s/m", "m": "N/m", "rad": "N m/rad"}
_ROOM = 1.25
_DOUBTFUL, _PALE = "#8C8C8C", "#C8C8C8"


def relay_pages(tuning: RelayTuning) -> int:
    """Number of pages that the cycles of a relay tuning need."""
    return max(1, math.ceil(len(_drawn(tuning)) / _ON_A_PAGE))


def relay_cycles(tuning: RelayTuning, *, page: int = 1) -> Figure:
    """Figure of the cycles that the gains were made of: deviation measured, force or moment of the relay.

    Where no trial has a usable cycle, the one that was seen is shown in grey with the reason; where there
    was none, a line below says so.

    Parameters
    ----------
    tuning : RelayTuning
    page : int
        Which of `relay_pages`, from 1 on.

    Examples
    --------
    >>> from seatrial.tuning.relay import relay_autopilot
    >>> tuning = relay_autopilot("cwolf", "cwolf", speeds=[0.881])
    >>> relay_cycles(tuning).axes[0].get_title(loc="left")
    'surge, 0.881 m/s'
    """
    points = _drawn(tuning)[(page - 1) * _ON_A_PAGE : page * _ON_A_PAGE]
    columns = max(1, min(_COLUMNS, len(points)))
    rows = max(1, math.ceil(len(points) / columns))
    note = _without(tuning)
    with house_style():
        figure = new_figure(_ROW_IN * rows + 0.75 + 0.14 * len(note))
        panels = figure.subplots(rows, columns, squeeze=False).ravel()
        for axes, point in zip(panels, points, strict=False):
            _panel(axes, point)
        for k, axes in enumerate(panels):
            if k >= len(points):
                axes.set_axis_off()
            elif k + columns >= len(points):
                axes.set_xlabel("time, s", fontsize=7)
        _legend(figure, note, doubtful=any(point.gains is None for point in points))
        rule = " and ".join(word.capitalize() for word in tuning.rule.split("-"))
        figure.suptitle(
            f"{tuning.autopilot.name}: relay cycles, gains by {rule}", x=0.01, ha="left", fontweight="bold"
        )
    return figure


def _drawn(tuning: RelayTuning) -> list[RelayPoint]:
    """The points with a cycle to show."""
    return [point for point in tuning.points if _shown(point) is not None]


def _shown(point: RelayPoint) -> RelayTrial | None:
    """The trial that the gains come from, or else the first with a cycle."""
    return point.taken or next((one for one in point.trials if one.trace is not None), None)


def _without(tuning: RelayTuning) -> list[str]:
    """A line per loop about the speeds without any cycle."""
    bare: dict[str, list[str]] = {}
    for point in tuning.points:
        if _shown(point) is None:
            bare.setdefault(point.loop, []).append(f"{point.speed_m_s:.3g}")
    return [f"{loop}: no cycle at {', '.join(speeds)} m/s" for loop, speeds in bare.items()]


def _panel(axes: Axes, point: RelayPoint) -> None:
    trial = _shown(point)
    if trial is None or trial.trace is None or trial.cycle is None:
        return
    usable = point.gains is not None
    unit = UNITS[point.loop]
    degrees = unit == "rad"
    factor = math.degrees(1.0) if degrees else 1.0
    trace = trial.trace
    t = trace.t - trace.t[0]
    wrench = axes.twinx()
    wrench.step(t, trace.wrench, where="post", color=SECOND if usable else _PALE, linewidth=0.9)
    axes.plot(t, factor * trace.measured, color=SIMULATED if usable else _DOUBTFUL)
    axes.set_zorder(wrench.get_zorder() + 1)
    axes.patch.set_visible(False)
    for one, values in ((axes, factor * trace.measured), (wrench, trace.wrench)):
        most = _ROOM * float(abs(values).max())
        one.set_ylim(-most, most)
        one.locator_params(axis="y", nbins=5)
    wrench.grid(visible=False)
    wrench.spines["right"].set_visible(True)
    wrench.spines["right"].set_color(SECOND)
    axes.set_xlim(t[0], t[-1])
    axes.set_ylabel(f"{_LETTERS[point.loop]}, {'deg' if degrees else unit}", fontsize=7)
    wrench.set_ylabel("N m" if degrees else "N", fontsize=7, labelpad=1)
    axes.set_title(f"{point.loop}, {point.speed_m_s:.3g} m/s", loc="left", fontweight="bold", pad=13)
    text = f"$T_u$ = {trial.cycle.period_s:.2g} s, "
    text += f"$K_u$ = {trial.cycle.ultimate_gain:.3g} {_GAIN_UNITS[unit]}"
    axes.text(
        0.0, 1.03, text if usable else trial.why, fontsize=6.5, color="#404040", transform=axes.transAxes
    )


def _legend(figure: Figure, note: list[str], *, doubtful: bool) -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=SIMULATED, label="measured, from its mean (left)"),
        Line2D([], [], color=SECOND, linewidth=0.9, label="force or moment of the relay (right)"),
    ]
    if doubtful:
        handles.append(Line2D([], [], color=_DOUBTFUL, label="no usable cycle"))
    title = "\n".join(note) or None
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=len(handles),
        fontsize=6.5,
        title=title,
        title_fontsize=6.5,
    )
