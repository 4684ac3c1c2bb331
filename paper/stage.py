"""What a stage of an identification changed: measured signals, model before and after, inputs, coefficients.

Left, over the time of the stage's trials: every fitted channel with the model at the start values, at the
stage's optimum and, where there is one, at the joint estimate; the commands below, one trial after the
other. Right: where each coefficient lies within its bounds. The model restarts with every segment from the
smoothed measurement (Taubert et al. 2014, figures 12 to 15 (stage)). Held by
`tests/examples/test_paper_figures.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array, runs
from seatrial.base.channels import ANGLES, CHANNELS, DEGREE
from seatrial.estimation.segment_model import SegmentModel, StageData, cut
from seatrial.problem.parameter import Parameter
from seatrial.report.plot.style import (
    FAINT,
    MEASURED,
    RESIDUAL,
    SECOND,
    SHADE,
    SIMULATED,
    THIRD,
    WIDTH_IN,
    house_style,
    new_figure,
    number,
    panel_title,
    printed_unit,
    symbol,
)
from seatrial.report.plot.trials import IN_DEGREES, NAMES, beside, few_ticks, residual_limits
from seatrial.scoring.windows import Window, predict
from seatrial.vehicle.actuators import actuator_groups

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial._core import Vehicle
    from seatrial.estimation.stage import StageResult
    from seatrial.identification.identification import Identification
    from seatrial.problem.settings import Stage
    from seatrial.trial.trial import Trial

_NAMED = 4
"""Inputs that are told apart; more are drawn alike."""


_AIR = 0.3  # of a row, between bar and text

_ROOM = 31  # letters of a name and its numbers that stand side by side in full size

_NOTHING = 1e-6  # of the distance between the bounds: shown as zero


@dataclass(frozen=True)
class Row:
    """A coefficient: bounds, start value, optimum of the stage; joint estimate and its standard deviation."""

    name: str
    unit: str
    lower: float
    upper: float
    start: float
    optimum: float
    polished: float | None = None
    sigma: float | None = None

    def share(self, value: float) -> float:
        """Place of a value between the bounds, 0 at the lower and 1 at the upper one."""
        return (value - self.lower) / (self.upper - self.lower)

    def words(self) -> str:
        """Start value, optimum and joint estimate, with their unit."""
        values = [self.start, self.optimum] + ([] if self.polished is None else [self.polished])
        least = _NOTHING * (self.upper - self.lower)
        shown = " \N{RIGHTWARDS ARROW} ".join(number(x if abs(x) > least else 0.0) for x in values)
        return shown if self.unit == "1" else f"{shown} {printed_unit(self.unit)}".rstrip()


def coefficient_bars(axes: Axes, rows: Sequence[Row]) -> None:
    """Draw a bar per coefficient into axes: bounds at its ends, values as marks, numbers above."""
    for place, row in enumerate(rows):
        y = -float(place)
        axes.plot([0.0, 1.0], [y, y], color=FAINT, linewidth=3.0, solid_capstyle="butt", alpha=0.45)
        axes.plot(row.share(row.start), y, "s", color=SECOND, markersize=4.2, markerfacecolor="white")
        axes.plot(row.share(row.optimum), y, "o", color=SIMULATED, markersize=4.4, zorder=4)
        if row.polished is not None:
            centre, spread = row.share(row.polished), 1.96 * (row.sigma or 0.0) / (row.upper - row.lower)
            if np.isfinite(spread):
                ends = np.clip([centre - spread, centre + spread], 0.0, 1.0)
                axes.plot(ends, [y, y], color=RESIDUAL, linewidth=1.2, zorder=5)
            # The joint estimate may have wider bounds than the stage.
            axes.plot(np.clip(centre, -0.02, 1.02), y, "D", color=RESIDUAL, markersize=3.0, zorder=6)
        words, name = row.words(), symbol(row.name)
        letters = len(words) + (4 if name.startswith("$") else len(name))
        small = min(1.0, _ROOM / letters)
        axes.text(0.0, y + _AIR, name, fontsize=7.5 * small, va="center", ha="left")
        axes.text(1.0, y + _AIR, words, fontsize=6.5 * small, va="center", ha="right")
        for x, bound, side in ((0.0, row.lower, "right"), (1.0, row.upper, "left")):
            axes.annotate(
                number(bound), (x, y), (-3 if x == 0.0 else 3, 0), textcoords="offset points",
                fontsize=5.5, va="center", ha=side, color="#595959",
            )  # fmt: skip
    axes.set_xlim(-0.16, 1.16)
    axes.set_ylim(0.6 - len(rows), 0.75)
    axes.set_axis_off()
    panel_title(axes, "coefficients in their bounds")


@dataclass(frozen=True, eq=False)
class Piece:
    """A trial of the stage: where it stands on the common time axis, and its windows per model."""

    name: str
    trial: Trial
    shift: float
    windows: list[list[Window]]


@dataclass(frozen=True, eq=False)
class Input:
    """A signal (n,) over times (n,) in s on the common axis, NaN between trials, in its own unit."""

    unit: str
    t: Array
    signal: Array


def moving_inputs(fit: Identification, pieces: Sequence[Piece]) -> dict[str, Input]:
    """Commands that move, by group where all of it moves alike, else by the actuators that do."""
    facts = fit.vehicle.actuator_info()
    driven: dict[str, Input] = {}
    times = np.concatenate([np.append(piece.trial.t + piece.shift, np.nan) for piece in pieces])
    for group, members in actuator_groups(fit.vehicle).items():
        alike: dict[bytes, tuple[list[str], Array]] = {}
        for name in members:
            signal = np.concatenate([np.append(_signal(fit, piece, name), np.nan) for piece in pieces])
            if np.nanmax(np.abs(signal - float(facts[name]["neutral"])), initial=0.0) > 0.0:
                alike.setdefault(signal.tobytes(), ([], signal))[0].append(name)
        for names, signal in alike.values():
            whole = group if len(names) == len(members) and group else ", ".join(names)
            driven[whole] = Input(str(facts[names[0]]["unit"]), times, signal)
    return driven


def _signal(fit: Identification, piece: Piece, actuator: str) -> Array:
    source = fit.problem.input_of(piece.name)
    recorded = {"commands": piece.trial.commands, "measured": piece.trial.measured}.get(source, {})
    return np.asarray(recorded.get(actuator, np.full(len(piece.trial.t), np.nan)))


def draw_inputs(axes: Axes, inputs: dict[str, Input]) -> None:
    """Draw the inputs over time; of many actuators only the number is named."""
    few = len(inputs) <= _NAMED
    styles = zip(("#262626", THIRD, SIMULATED, SECOND) * 8, ("-", "--", "-.", ":") * 8, strict=True)
    for (name, entry), (colour, dashes) in zip(inputs.items(), styles, strict=False):
        if few:
            axes.step(
                entry.t, entry.signal, where="post", color=colour, linestyle=dashes, linewidth=0.9, label=name
            )
        else:
            axes.step(entry.t, entry.signal, where="post", color="#262626", linewidth=0.35, alpha=0.6)
    units = {entry.unit.replace("us", "\N{MICRO SIGN}s") for entry in inputs.values()}
    axes.set_ylabel(" or ".join(sorted(units)))
    axes.locator_params(axis="y", nbins=4)
    panel_title(axes, "inputs", "" if few else f"{len(inputs)} actuators")
    if few:
        axes.legend(
            loc="lower right", bbox_to_anchor=(1.0, 0.97), ncols=len(inputs), borderaxespad=0.0, fontsize=7
        )


_PANEL_IN, _ERROR_IN, _INPUT_IN, _EDGES_IN, _ROW_IN = 1.1, 0.42, 0.85, 0.85, 0.33  # layout, inches

_MODELS: tuple[tuple[str, str, float, Any], ...] = (
    ("start values", SECOND, 0.9, (0, (4, 1.5))),
    ("optimum of the stage", SIMULATED, 1.1, "-"),
    ("joint estimate", RESIDUAL, 0.9, (0, (1, 1.2))),
)


def stage_result(fit: Identification, result: StageResult) -> Figure:
    """Figure of one stage of an identification.

    Parameters
    ----------
    fit : Identification
    result : StageResult
        One of ``fit.stages``.

    Raises
    ------
    TrialError, CampaignError
        A trial of the stage can no longer be read or simulated.
    """
    stage = next(stage for stage in fit.problem.stages if stage.name == result.name)
    parameters = fit.problem.parameters[stage.name]
    data = cut(fit.problem, stage)
    pieces = _pieces(fit, stage, data, _models(fit, result))
    channels = [channel for channel in CHANNELS if channel in stage.weights()]
    inputs = moving_inputs(fit, pieces)
    ratios = [_PANEL_IN, _ERROR_IN] * len(channels) + ([_INPUT_IN] if inputs else [])
    height = _EDGES_IN + max(sum(ratios), _ROW_IN * len(parameters) + 0.35)
    with house_style():
        figure = new_figure(height, width_in=WIDTH_IN)
        parts = np.asarray(figure.subfigures(1, 2, width_ratios=[1.75, 1.0]))
        left, right = parts
        grid = left.subplots(len(ratios), 1, sharex=True, squeeze=False, height_ratios=ratios)[:, 0]
        for row, channel in enumerate(channels):
            _channel(grid[2 * row], grid[2 * row + 1], pieces, channel)
            panel_title(grid[2 * row], NAMES[channel])
        if inputs:
            draw_inputs(grid[-1], inputs)
        for axes in grid:
            _mark(axes, fit, pieces)
            axes.tick_params(axis="x", bottom=axes is grid[-1])
        last = pieces[-1]
        grid[-1].set_xlim(pieces[0].trial.t[0] + pieces[0].shift, last.trial.t[-1] + last.shift)
        grid[-1].set_xlabel("time, s" if len(pieces) == 1 else "time of the trials one after the other, s")
        left.align_ylabels(list(grid))
        held_out = any(fit.problem.held_out(piece.name).any() for piece in pieces)
        _legend(figure, len(pieces[0].windows), held_out=held_out)
        coefficient_bars(right.subplots(), _rows(fit, result, parameters))
        figure.suptitle(_heading(fit, result, parameters), x=0.01, ha="left", fontweight="bold", fontsize=9)
    return figure


def polished_cost(fit: Identification, result: StageResult) -> float | None:
    """Criterion of a stage at the joint estimate, in standard deviations; None without one."""
    from seatrial.estimation.descent import Criterion

    if fit.assessment is None or not fit.assessment.polished.rounds:
        return None
    stage = next(stage for stage in fit.problem.stages if stage.name == result.name)
    chosen = fit.problem.parameters[stage.name]
    data = cut(fit.problem, stage)
    criterion = Criterion(
        SegmentModel(fit.assessment.vehicle, stage, data, chosen, result.substeps, threads=1)
    )
    values = fit.assessment.vehicle.coefficients()
    candidate = np.array([[values[p.members[0][0]] / p.members[0][1] for p in chosen]])
    return float(criterion(candidate)[0])


def _models(fit: Identification, result: StageResult) -> list[Vehicle]:
    """Vehicles to compare: at the stage's start, at its optimum, at the joint estimate where there is one."""
    before: dict[str, float] = {}
    stage = next(stage for stage in fit.problem.stages if stage.name == result.name)
    for name in fit.problem.stages_before(stage):
        before |= next(earlier.coefficients for earlier in fit.stages if earlier.name == name)
    start = dict(before)
    for parameter in fit.problem.parameters[result.name]:
        start |= parameter.coefficients(result.starts[parameter.name])
    vehicle = fit.problem.vehicle
    made = [vehicle.with_coefficients(start), vehicle.with_coefficients(before | result.coefficients)]
    if fit.assessment is not None and fit.assessment.polished.rounds:
        made.append(fit.assessment.vehicle)
    return made


def _pieces(fit: Identification, stage: Stage, data: StageData, models: Sequence[Vehicle]) -> list[Piece]:
    pieces, end = [], None
    for index, (name, trial) in enumerate(zip(data.names, data.trials, strict=True)):
        spans = [(segment.start, segment.stop) for segment in data.segments if segment.record == index]
        predictions = [
            predict(
                vehicle,
                trial,
                spans,
                input=fit.problem.input_of(name),
                free=stage.axes.free,
                measured=stage.axes.measured,
            )
            for vehicle in models
        ]
        shift = 0.0 if end is None else end - float(trial.t[0])
        pieces.append(Piece(name, trial, shift, predictions))
        end = float(trial.t[-1]) + shift
    return pieces


def _channel(axes: Axes, below: Axes, pieces: Sequence[Piece], channel: str) -> None:
    """A channel, measured and modelled, and below it measured minus modelled."""
    k = CHANNELS.index(channel)
    scale = 1.0 / DEGREE if channel in IN_DEGREES else 1.0
    shown = []
    for piece in pieces:
        measured = np.where(piece.trial.valid[:, k], piece.trial.observed[:, k], np.nan)
        if channel in ANGLES:
            known = np.isfinite(measured)
            measured[known] = np.unwrap(measured[known])
        axes.plot(piece.trial.t + piece.shift, scale * measured, color=MEASURED, linewidth=2.0, alpha=0.45)
        shown.append(scale * measured[np.isfinite(measured)])
        for place, (windows, style) in enumerate(zip(piece.windows, _MODELS, strict=False)):
            _, colour, width, dashes = style
            t, simulated, error = _joined(piece, windows, k, measured, angle=channel in ANGLES)
            axes.plot(t, scale * simulated, color=colour, linewidth=width, linestyle=dashes)
            if place < 2:  # the polish would only hide the optimum beside it
                below.plot(t, scale * error, color=colour, linewidth=0.7 * width)
    values = np.concatenate(shown)
    if len(values):
        margin = 0.2 * max(float(np.ptp(values)), 1e-6)
        axes.set_ylim(values.min() - margin, values.max() + margin)
    axes.set_ylabel(("deg" if channel in IN_DEGREES else "m") + ("/s" if k < 6 else ""))
    axes.locator_params(axis="y", nbins=4)
    below.axhline(0.0, color="#262626", linewidth=0.4, zorder=1)
    below.set_ylabel("error", fontsize=7)
    below.yaxis.set_major_locator(few_ticks())
    residual_limits(below)


def _joined(
    piece: Piece, windows: Sequence[Window], k: int, measured: Array, *, angle: bool
) -> tuple[Array, Array, Array]:
    """Times, simulated channel and its error over all segments, with a gap where the next one restarts."""
    gap = np.array([np.nan])
    times: list[Array] = []
    values: list[Array] = []
    errors: list[Array] = []
    for window in windows:
        simulated, observed = window.simulated[:, k].copy(), measured[window.start : window.stop]
        if angle:
            simulated = beside(np.unwrap(simulated), observed)
        times += [piece.trial.t[window.start : window.stop] + piece.shift, gap]
        values += [simulated, gap]
        errors += [observed - simulated, gap]
    return np.concatenate(times), np.concatenate(values), np.concatenate(errors)


def _mark(axes: Axes, fit: Identification, pieces: Sequence[Piece]) -> None:
    """What is held out is shaded; a line stands where the next trial begins."""
    for piece in pieces:
        mask = fit.problem.held_out(piece.name)
        t = piece.trial.t + piece.shift
        for first, end in runs(mask):
            axes.axvspan(t[first], t[min(end, len(t) - 1)], color=SHADE, linewidth=0.0, zorder=0)
        if piece is not pieces[0]:
            axes.axvline(t[0], color="#262626", linewidth=0.6)


def _rows(fit: Identification, result: StageResult, parameters: Sequence[Parameter]) -> list[Row]:
    """A row per parameter of the stage; the joint estimate with its interval where it is one of its own."""
    rows = []
    for parameter in parameters:
        known = None
        if fit.assessment is not None and fit.assessment.polished.rounds:
            known = fit.assessment.of(parameter.name)
        rows.append(
            Row(
                name=parameter.name,
                unit=parameter.unit,
                lower=parameter.lower,
                upper=parameter.upper,
                start=result.starts[parameter.name],
                optimum=result.estimates[parameter.name],
                polished=None if known is None else float(known["estimate"]),
                sigma=None if known is None else float(known["sigma"]),
            )
        )
    return rows


def _heading(fit: Identification, result: StageResult, parameters: Sequence[Parameter]) -> str:
    arrow = " \N{RIGHTWARDS ARROW} "
    words = f"{result.name}: criterion {number(result.start_cost)}{arrow}{number(result.cost)} std dev."
    polished = polished_cost(fit, result)
    return words + ("" if polished is None else f", joint estimate {number(polished)}")


def _legend(figure: Figure, models: int, *, held_out: bool) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Line2D | Patch] = [
        Line2D([], [], color=MEASURED, linewidth=2.0, alpha=0.45, label="measured")
    ]
    handles += [
        Line2D([], [], color=colour, linewidth=width, linestyle=dashes, label=label)
        for label, colour, width, dashes in _MODELS[:models]
    ]
    if held_out:
        handles.append(Patch(color=SHADE, label="held out"))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), columnspacing=1.4)
