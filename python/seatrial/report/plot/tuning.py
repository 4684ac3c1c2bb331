"""Figures of a tuning: corridors with error areas, responses before and after, speeds, margins.

Of the trials of a loop at a speed the one is drawn that the tuned gains hold least. Margins have a row per
loop: phase, gain and delay margin with their limits over the speeds, and the Nyquist plot of the loop opened
alone, the others closed, with the disk that it keeps out of where the sensitivity stays below two (Åström and
Hägglund, 2006: 1.4 to 2 is usual). Held by `tests/report/test_tuning_gallery.py` and
`tests/report/test_tuning_margins_figure.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.control_design.margin_constraint import MarginConstraint, PointMargins
from seatrial.control_design.margins import decibel
from seatrial.control_design.tuning_table import LOOPS
from seatrial.report.plot import style as pen
from seatrial.report.plot.corridors import (
    Course,
    InCorridor,
    SetPointStep,
    corridor_figure,
    speed_steps,
    step_responses,
)
from seatrial.vehicle.actuators import LOOPS as LOOP_NAMES

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial._core import Autopilot, Vehicle
    from seatrial.control_design.tuning_table import Margins
    from seatrial.sensors.sensor import Sensor
    from seatrial.tuning.result import Performance, Responses, Tuning

_LABELS = {
    "surge": "speed ahead u",
    "sway": "sway speed v",
    "heave": "depth z",
    "pitch": "pitch angle",
    "heading": "heading",
    "depth": "depth z",
    "cross_track": "cross-track position",
}


@dataclass(frozen=True)
class TuningFigureSettings:
    """Which trials and margins are drawn."""

    panels: int = 6  #: Speeds of a figure of responses.
    speeds_on_a_page: int = 3  #: In the figure of corridors.
    settling_s: float = 5.0  #: Of the settling, drawn before the first step, s.
    #: Largest sensitivity; the upper end of what is usual (Åström and Hägglund, 2006).
    sensitivity: float = 2.0
    largest_db: float = 45.0  #: A larger gain margin is drawn here, dB.
    least_s: float = 0.03  #: A smaller delay margin is drawn here, s.
    largest_s: float = 60.0  #: A larger delay margin is drawn here, s.


SETTINGS = TuningFigureSettings()


def drawings(tuning: Tuning) -> dict[str, Callable[[], Figure]]:
    """Figures of a tuning by name: of every loop and path its corridors and responses, speeds, margins."""
    start, tuned = tuning.of("start"), tuning.of("tuned")
    if start is None or tuned is None:
        return {}
    drawn: dict[str, Callable[[], Figure]] = {}
    for loop in tuned.responses:
        for page, trials in enumerate(_pages(start, tuned, loop), 1):
            name = f"corridor_{loop}" if page == 1 else f"corridor_{loop}_{page}"
            drawn[name] = partial(_corridors, start, tuned, loop, trials)
        drawn[f"responses_{loop}"] = partial(responses, start, tuned, loop)
    if "surge" in tuned.responses:
        drawn["speeds"] = partial(speed_steps, tuning.plan, tuning.start, tuning.autopilot)
    drawn["margins"] = partial(
        tuning_margins,
        tuning.plan.vehicle,
        (tuning.start, tuning.autopilot),
        limits=tuning.plan.table.margins,
        sensors=tuning.plan.sensors,
    )
    return drawn


def corridors(start: Performance, tuned: Performance, loop: str) -> Iterator[Figure]:
    """Figures of a loop's steps in their corridor, there and back, start gains beside tuned, a page each."""
    for trials in _pages(start, tuned, loop):
        yield _corridors(start, tuned, loop, trials)


def _pages(start: Performance, tuned: Performance, loop: str) -> list[list[int]]:
    trials, most = _one_per_speed(tuned, start, loop), SETTINGS.speeds_on_a_page
    return [trials[k : k + most] for k in range(0, len(trials), most)]


def _corridors(start: Performance, tuned: Performance, loop: str, trials: list[int]) -> Figure:
    """Figure of some trials of a loop in their corridor."""
    shown = []
    for trial in trials:
        for performance, name in ((start, "start gains"), (tuned, "tuned")):
            own = performance.responses[loop]
            since = own.t - own.trials.settle_s
            until = own.trials.until_s
            rows = (since > -1e-9) & (since < until - 1e-9)
            back = (since > until - 1e-9) & (since < 2.0 * until - 1e-9)
            answers = own.normalised(trial)
            both = np.concatenate([answers[:, rows], 1.0 - answers[:, back]])
            title = f"{_step(own, trial, loop)}: {name}"
            shown.append(InCorridor(title, own.trials.corridor, since[rows], both, each="steps"))
    return corridor_figure(shown)


def responses(start: Performance, tuned: Performance, loop: str) -> Figure:
    """Figure of a loop's responses over time at several speeds, before and after, with the set points."""
    entry = LOOPS[loop]
    courses = []
    for trial in _one_per_speed(tuned, start, loop):
        own, before = tuned.responses[loop], start.responses[loop]
        trials = own.trials
        low = own.base(trial)
        high = low + trials.sizes[trial]
        first = trials.settle_s
        set_point = np.where((own.t >= first) & (own.t < first + trials.until_s), high, low)
        scale = 1.0 / entry.to_si
        shown = own.t > first - SETTINGS.settling_s
        courses.append(
            Course(
                name=_step(own, trial, loop),
                label=f"{_LABELS[loop]}, {entry.unit}",
                t=own.t[shown] - first,
                set_point=set_point[shown] * scale,
                before=_unbroken(before.values[trial][:, shown] * scale, entry.unit),
                after=_unbroken(own.values[trial][:, shown] * scale, entry.unit),
                steps=(
                    SetPointStep(0.0, low * scale, high * scale, trials.corridor),
                    SetPointStep(trials.until_s, high * scale, low * scale, trials.corridor),
                ),
                down=loop in ("heave", "depth"),
                remark=_tells(start, loop, trial),
            )
        )
    return step_responses(courses)


def _step(of: Responses, trial: int, loop: str) -> str:
    """Loop, speed and step of a trial, for a title."""
    entry = LOOPS[loop]
    size = of.trials.sizes[trial] / entry.to_si
    numbers = f"{of.trials.speeds[trial]:.3g} m/s, {size:+.3g} {entry.unit}".replace("-", "\N{MINUS SIGN}")
    return f"{loop.replace('_', '-')} at {numbers}"


def _tells(start: Performance, loop: str, trial: int) -> str:
    """How far the start gains leave the corridor, for the right of a title."""
    own = [trial_of for trial_of in start.trials if trial_of.loop == loop][trial]
    if not np.isfinite(own.nominal_s):
        return "start gains: diverge"
    size = f"{own.nominal_s:.2g}" if own.nominal_s < 100.0 else f"{own.nominal_s:.0f}"
    return f"start gains: outside by {size} s" if own.nominal_s > 0.0 else ""


def _unbroken(values: Array, unit: str) -> Array:
    """Values (k, p) with a gap where an angle jumps from one end of the circle to the other."""
    if unit != "deg":
        return values
    jumps = np.abs(np.diff(values, axis=1, prepend=values[:, :1])) > 180.0
    return np.where(jumps, np.nan, values)


def _one_per_speed(tuned: Performance, start: Performance, loop: str) -> list[int]:
    """The trial at each speed that the tuned gains, and then the start gains, violate most, by speed."""
    own = [[trial for trial in performance.trials if trial.loop == loop] for performance in (tuned, start)]
    violated = [tuple(-performance[k].worst_s for performance in own) for k in range(len(own[0]))]
    worst: dict[float, int] = {}
    for trial in sorted(range(len(violated)), key=violated.__getitem__):
        worst.setdefault(own[0][trial].speed_m_s, trial)
    return [worst[speed] for speed in sorted(worst)][: SETTINGS.panels]


Complex = NDArray[np.complex128]

_LOOK = {"start gains": (pen.MEASURED, 0.7, 2.6), "tuned": (pen.SIMULATED, 1.7, 3.8)}  # colour, width, marker

_MARKERS = "os^D"  # per mode


@dataclass(frozen=True, eq=False)
class _Side:
    """An autopilot as it is drawn: its margins and open loops per point."""

    name: str
    points: list[PointMargins]
    loops: list[tuple[Array, Complex]]


def tuning_margins(
    vehicle: Vehicle,
    autopilots: tuple[Autopilot, Autopilot],
    *,
    speeds_m_s: Sequence[float] | None = None,
    limits: Margins | None = None,
    sensors: Mapping[str, Sensor] | str | Path | None = None,
) -> Figure:
    """Figure of the margins of an autopilot of PID loops before and after its tuning.

    At desired speeds, m/s, else at the supporting points that the vehicle reaches; latency and interval of
    the sensors count as dead time. Limits are those of a campaign that gives none where they are missing.
    """
    sides = []
    for name, autopilot in zip(_LOOK, autopilots, strict=True):
        constraint = MarginConstraint(vehicle, autopilot, speeds_m_s, limits=limits, sensors=sensors)
        sides.append(_Side(name, constraint.margins({}), constraint.open_loops({})))
    used = [
        loop for loop in LOOP_NAMES if any(loop in point.loops for side in sides for point in side.points)
    ]
    speeds = [point.speed_m_s for side in sides for point in side.points]
    slowest, span = min(speeds), max(max(speeds) - min(speeds), 1.0)
    modes = list(dict.fromkeys(point.mode for side in sides for point in side.points))
    reach_s = (SETTINGS.least_s, SETTINGS.largest_s)
    columns: tuple[tuple[str, str, str, Callable[[PointMargins, int], tuple[float, ...]]], ...] = (
        ("phase margin", "deg", "phase_deg", lambda point, k: (float(point.of.phase_deg[0, k]),)),
        ("gain margin", "dB", "gain_db", _gain),
        (
            "delay margin",
            "s",
            "delay_s",
            lambda point, k: (float(np.clip(point.of.delay_s[0, k], *reach_s)),),
        ),
    )
    with pen.house_style():
        head_in = 0.55  # title and legend
        height = 1.5 * len(used) + head_in
        figure = pen.new_figure(height)
        figure.get_layout_engine().set(rect=(0.0, 0.0, 1.0, 1.0 - head_in / height))  # type: ignore[union-attr, call-arg]
        grid = figure.subplots(len(used), 4, squeeze=False, width_ratios=(1.0, 1.0, 1.0, 1.25))
        for index, (row, loop) in enumerate(zip(grid, used, strict=True)):
            for axes, (title, unit, key, value) in zip(row, columns, strict=False):
                for side in sides:
                    _margin(axes, side, loop, value, modes)
                asked = [getattr(constraint.limits.at(speed), key) for speed in (-1.0, 1.0)]
                _limit(axes, (asked[0], asked[1]), unit)
                axes.set_xlim(slowest - 0.05 * span, slowest + 1.05 * span)
                if index == 0:
                    pen.panel_title(axes, f"{title}, {unit}")
            _nyquist(row[3], sides, loop)
            row[0].set_ylabel(loop, fontweight="bold")
        pen.panel_title(grid[0, 3], "open loop")
        for axes in grid[-1, :3]:
            axes.set_xlabel("speed ahead, m/s")
        grid[-1, 3].set_xlabel("real part")
        _legend(figure, sides, modes)
        title = f"{vehicle.name}: margins of the linear loops, each opened alone"
        pen.page_heading(figure, title, left_in=0.01 * pen.WIDTH_IN, below_in=0.14)
    return figure


def _gain(point: PointMargins, k: int) -> tuple[float, ...]:
    up, down = (float(decibel(side[0, k])) for side in (point.of.gain, point.of.reduction))
    return min(up, SETTINGS.largest_db), down if down < SETTINGS.largest_db else np.nan


def _margin(
    axes: Axes,
    side: _Side,
    loop: str,
    value: Callable[[PointMargins, int], tuple[float, ...]],
    modes: Sequence[str],
) -> None:
    """A margin over the speeds, a line per mode; downwards dashed, unstable points as crosses at the foot."""
    colour, width, size = _LOOK[side.name]
    for mode in modes:
        points = [point for point in side.points if point.mode == mode and loop in point.loops]
        if not points:
            continue
        speed = np.array([point.speed_m_s for point in points])
        stable = np.array([point.growth_per_s[0] == 0.0 for point in points])
        values = np.array([value(point, point.loops.index(loop)) for point in points])
        for column, dashes in zip(values.T, ("-", (0, (3, 2))), strict=False):
            look: pen.Style = {"color": colour, "linewidth": width, "linestyle": dashes, "markersize": size}
            look["marker"] = _MARKERS[modes.index(mode) % len(_MARKERS)]
            look["markerfacecolor"] = colour if dashes == "-" else "white"
            axes.plot(speed, np.where(stable, column, np.nan), clip_on=False, **look)
        foot: pen.Style = {"color": colour, "markersize": 4.5, "transform": axes.get_xaxis_transform()}
        axes.plot(speed[~stable], np.full((~stable).sum(), 0.06), "x", **foot)


def _limit(axes: Axes, limits: tuple[float, float], unit: str) -> None:
    """Axis of a margin in a unit, and what is short of its limit: astern and ahead."""
    if unit == "s":
        axes.set_yscale("log")
        axes.set_ylim(SETTINGS.least_s, SETTINGS.largest_s)
        axes.set_yticks([SETTINGS.least_s, 0.1, 1.0, 10.0, SETTINGS.largest_s], ["", "0.1", "1", "10", "≥60"])
        axes.minorticks_off()
    elif unit == "dB":
        axes.set_ylim(0.0, SETTINGS.largest_db)
        axes.set_yticks([0.0, 15.0, 30.0, 45.0], ["0", "15", "30", "≥45"])
    else:
        axes.set_ylim(0.0, 180.0)
        axes.set_yticks([0.0, 45.0, 90.0, 135.0, 180.0])
    bottom, far_m_s = axes.get_ylim()[0], 100.0  # a limit is drawn to the edge of its panel
    for limit, ends in zip(limits, (np.array([-far_m_s, 0.0]), np.array([0.0, far_m_s])), strict=True):
        if limit > 0.0:
            pen.band(axes, ends, bottom, limit, pen.FORBIDDEN, zorder=0.5)
            axes.plot(ends, [limit, limit], color=pen.RESIDUAL, linewidth=0.9)


def _nyquist(axes: Axes, sides: Sequence[_Side], loop: str) -> None:
    """The open loops of all points about -1."""
    from matplotlib.patches import Circle

    radius = 1.0 / SETTINGS.sensitivity  # radius of the disk that the response keeps out of
    axes.add_patch(Circle((-1.0, 0.0), radius, color=pen.FORBIDDEN, linewidth=0.0, zorder=0.5))
    axes.add_patch(Circle((0.0, 0.0), 1.0, fill=False, color=pen.FAINT, linewidth=0.7, linestyle=":"))
    axes.plot(-1.0, 0.0, "+", color=pen.RESIDUAL, markersize=5)
    for side in sides:
        colour, width, _ = _LOOK[side.name]
        for point, (_, loops) in zip(side.points, side.loops, strict=True):
            if loop in point.loops:
                response = loops[0, point.loops.index(loop)]
                dashes = "-" if point.growth_per_s[0] == 0.0 else ":"
                axes.plot(response.real, response.imag, color=colour, linewidth=0.7 * width, linestyle=dashes)
    # About -1 and the unit circle.
    axes.set_xlim(-2.2, 0.9)
    axes.set_ylim(-1.25, 1.25)
    axes.set_aspect("equal")
    axes.set_xticks([-2.0, -1.0, 0.0])
    axes.set_yticks([-1.0, 0.0, 1.0])
    axes.set_ylabel("imaginary part", labelpad=0.0)


def _legend(figure: Figure, sides: Sequence[_Side], modes: Sequence[str]) -> None:
    handles: list[Artist] = [
        pen.stroke(side.name, _LOOK[side.name][0], linewidth=_LOOK[side.name][1]) for side in sides
    ]
    handles += [
        pen.stroke(mode, pen.FAINT, linestyle="", marker=_MARKERS[k % len(_MARKERS)], markersize=4)
        for k, mode in enumerate(modes)
    ]
    hollow: pen.Style = {"linestyle": (0, (3, 2)), "marker": "o", "markerfacecolor": "white"}
    handles.append(pen.stroke("gain downwards", pen.FAINT, **hollow))
    if any(point.growth_per_s[0] > 0.0 for side in sides for point in side.points):
        handles.append(pen.stroke("unstable (dotted)", pen.FAINT, linestyle="", marker="x"))
    handles.append(pen.field(f"below its limit, $|S|$ > {SETTINGS.sensitivity:g}", pen.FORBIDDEN))
    # Two lines where the page is too narrow: one holds 126 letters, a handle takes the room of six.
    wide = sum(len(str(handle.get_label())) + 6 for handle in handles) > 126
    place: pen.Style = {"loc": "upper left", "bbox_to_anchor": (0.0, 1.0 - 0.24 / figure.get_figheight())}
    tight: pen.Style = {"labelspacing": 0.2, "columnspacing": 1.1, "handletextpad": 0.5, "borderaxespad": 0.0}
    figure.legend(handles=handles, ncols=-(-len(handles) // 2) if wide else len(handles), **place, **tight)
