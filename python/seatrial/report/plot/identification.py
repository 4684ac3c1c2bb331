"""Figures of an identification: vehicle, convergence, uncertainty, residual analysis, every trial.

Uncertainty: relative standard deviations, verdicts, correlations. Residual analysis: autocorrelation, and the
missing terms ranked by gain. Convergence: a panel per stage with ``100 (Q - Q*) / Q*`` on a logarithmic axis,
Q* the stage's lowest cost, over the candidates tried; colour and dashes tell the searches apart. Held by
`tests/report/test_plot.py` and `tests/examples/test_paper_figures.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES, CHANNELS
from seatrial.base.files import file_name, free_name
from seatrial.report.plot import style as pen
from seatrial.report.plot.performance import characteristic
from seatrial.report.plot.trials import measured_against_simulated
from seatrial.report.plot.vehicle import three_views
from seatrial.scoring.score import score

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.diagnosis.assessment import Assessment
    from seatrial.diagnosis.residual_analysis import ResidualAnalysis
    from seatrial.diagnosis.residual_signals import Autocorrelation
    from seatrial.estimation.stage import StageResult
    from seatrial.identification.identification import Identification
    from seatrial.scoring.windows import Window
    from seatrial.trial.trial import Trial

_COLOURS = {"identifiable": pen.SIMULATED, "weak": pen.SECOND, "not identifiable": pen.RESIDUAL}


@dataclass(frozen=True)
class IdentificationFigureSettings:
    """Layout of the figures of an identification, and what of them is coloured."""

    coefficient_in: float = 0.14  #: Height of a coefficient's row, inches.
    largest: float = 1e3  #: Standard deviations beyond stand at the edge, per cent.
    columns: int = 3  #: Panels side by side.
    channel_in: float = 1.15  #: Height of a channel's autocorrelation, inches.
    bar_in: float = 0.24  #: Height of the bar of a term or signal, inches.
    stage_in: float = 1.75  #: Height of a stage's convergence, inches.
    weak: float = 0.1  #: An autocorrelation below is not coloured.
    letters: int = 24  #: Of names beside a bar.


SETTINGS = IdentificationFigureSettings()


def intervals(assessment: Assessment) -> Figure:
    """Figure of the standard deviations of the coefficients and of how they depend on one another.

    Left, per coefficient: its standard deviation in per cent of the estimate, coloured by the verdict, beside
    the naive one of independent samples (grey). Right: the correlation matrix of the same coefficients.
    """
    uncertainty, names = assessment.uncertainty, list(assessment.verdicts)
    places = [uncertainty.names.index(name) for name in names]
    size = np.maximum(np.abs(uncertainty.estimate[places]), 1e-12)
    with pen.house_style():
        figure = pen.new_figure(max(3.2, 1.1 + SETTINGS.coefficient_in * len(names)))
        left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.15])
        relative = [100.0 * part[places] / size for part in (uncertainty.sigma, uncertainty.naive)]
        _deviations(left, names, *relative, verdicts=assessment.verdicts)
        _correlations(figure, right, names, uncertainty.correlation[np.ix_(places, places)])
        pen.panel_title(left, "Standard deviations")
        left.set_xlabel(f"% of the estimate, blocks of {uncertainty.block_s:.3g} s")
        pen.panel_title(right, "Correlations")
        figure.legend(*left.get_legend_handles_labels(), loc="outside lower left", ncols=4)
    return figure


def _deviations(
    axes: Axes, names: list[str], sigma: np.ndarray, naive: np.ndarray, *, verdicts: dict[str, str]
) -> None:
    rows = np.arange(len(names))[::-1]
    most = SETTINGS.largest
    shown, plain = (np.minimum(np.nan_to_num(part, posinf=most), most) for part in (sigma, naive))
    axes.hlines(rows, plain, shown, color=pen.FAINT, linewidth=1.0)
    axes.plot(plain, rows, "o", color=pen.FAINT, markersize=3.0, label="if samples were independent")
    for verdict, colour in _COLOURS.items():
        mine = np.array([verdicts[name] == verdict for name in names])
        if mine.any():
            axes.plot(shown[mine], rows[mine], "o", color=colour, markersize=4.0, label=verdict)
    axes.set_xscale("log")
    axes.set_yticks(rows, [pen.symbol(name) for name in names])
    axes.set_ylim(-0.5, len(names) - 0.5)  # the rows of the matrix beside it


def _correlations(figure: Figure, axes: Axes, names: list[str], matrix: np.ndarray) -> None:
    image = axes.imshow(matrix, vmin=-1.0, vmax=1.0, cmap="RdBu_r", aspect="auto")
    shown = [pen.symbol(name) for name in names]
    axes.set_xticks(range(len(names)), shown, rotation=90, fontsize=min(7.0, 210.0 / len(names)))
    axes.set_yticks([])
    axes.grid(visible=False)
    bar = figure.colorbar(image, ax=axes, shrink=0.6, pad=0.02)
    bar.outline.set_visible(False)


def residual_figure(analysis: ResidualAnalysis) -> Figure:
    """Figure of the autocorrelation of every channel's residual, and of what would explain it, ranked.

    A band holds 95 of 100 autocorrelations of white residuals. A bar is the fall of the cost in percent when
    a coefficient is freed, or the share of a channel's residual, in percent, that a signal explains.
    """
    shown = analysis.autocorrelations
    rows = -(-max(len(shown), 1) // SETTINGS.columns)
    bars = len(analysis.suggestions) + len(analysis.signals)
    lower = 0.55 + SETTINGS.bar_in * max(bars, 1)
    with pen.house_style():
        figure = pen.new_figure(0.35 + SETTINGS.channel_in * rows + lower)
        parts = np.asarray(figure.subfigures(2, 1, height_ratios=[SETTINGS.channel_in * rows + 0.3, lower]))
        upper_part, lower_part = parts[0], parts[1]
        grid = pen.grid_of(upper_part, len(shown), SETTINGS.columns, sharex=True, sharey=True)
        for axes, channel in zip(grid.flat, shown, strict=False):
            _autocorrelation(axes, channel)
        for axes in grid[:, 0]:
            axes.set_ylabel("autocorrelation")
        columns = SETTINGS.columns
        for column in range(columns):
            used = [axes for k, axes in enumerate(grid[:, column]) if k * columns + column < len(shown)]
            if used:
                used[-1].set_xlabel("lag, s")
                used[-1].tick_params(labelbottom=True)
        _ranked(lower_part.subplots(), analysis)
    return figure


def _autocorrelation(axes: Axes, channel: Autocorrelation) -> None:
    axes.axhspan(-channel.band, channel.band, color=pen.SHADE, linewidth=0.0)
    axes.axhline(0.0, color=pen.FAINT, linewidth=0.6)
    coloured = bool((np.abs(channel.rho) > max(SETTINGS.weak, 2.0 * channel.band)).any())
    axes.plot(channel.lag_s, channel.rho, color=pen.RESIDUAL if coloured else pen.SIMULATED)
    axes.set_ylim(-0.4, 1.0)
    axes.set_xlim(0.0, float(channel.lag_s[-1]))
    pen.panel_title(
        axes,
        channel.channel,
        f"{channel.excess:.1f} \N{MULTIPLICATION SIGN} noise, memory {channel.correlation_s:.2g} s",
    )


def _ranked(axes: Axes, analysis: ResidualAnalysis) -> None:
    """Bars of suggestions, then of signals, the largest at the top."""
    entries = [
        (f"{_names([term.name, *term.alternatives])}  ({term.channel} follows {term.follows})", term.gain)
        for term in analysis.suggestions
    ]
    entries += [
        (f"{signal.channel} follows {signal.signal}{_lag(signal.lag_s)}", 100.0 * signal.r2)
        for signal in analysis.signals
    ]
    pen.panel_title(axes, "What would explain it")
    if not entries:
        axes.set_axis_off()
        words = f"None of {analysis.tested} coefficients is missing, and no signal is followed"
        axes.text(0.0, 0.5, words, transform=axes.transAxes, va="center")
        return
    # Two measures share the axis, and colours tell them apart.
    first = len(analysis.suggestions)
    colours = [pen.SIMULATED] * first + [pen.FAINT] * (len(entries) - first)
    places = np.arange(len(entries))
    axes.barh(places, [value for _, value in entries], color=colours, height=0.62)
    for place, (_, value) in zip(places, entries, strict=True):
        beside: pen.Style = {"textcoords": "offset points", "va": "center", "fontsize": 7}
        axes.annotate(f"{value:.2g} %", (value, place), (3, 0), **beside)
    axes.set_yticks(places, [name for name, _ in entries])
    axes.set_ylim(len(entries) - 0.5, -0.5)
    axes.set_xlim(0.0, 1.12 * max(value for _, value in entries))
    axes.grid(visible=False, axis="y")
    measures = ["fall of the cost"] * bool(first) + ["share of the channel's residual"] * (
        len(entries) > first
    )
    both = len(measures) > 1
    shown = [
        f"{measure} ({colour})" if both else measure
        for measure, colour in zip(measures, ("blue", "grey"), strict=False)
    ]
    axes.set_xlabel(f"{' or '.join(shown)}, %")


def _names(names: list[str]) -> str:
    """Up to three names, as many as leave room for the bars."""
    most = SETTINGS.letters
    shown = [name for k, name in enumerate(names[:3]) if not k or len(" or ".join(names[: k + 1])) <= most]
    return " or ".join(shown) + (" …" if len(shown) < len(names) else "")


def _lag(lag_s: float) -> str:
    if lag_s == 0.0:
        return ", as it is"
    return ", integrated" if np.isinf(lag_s) else f", lag {lag_s:g} s"


_PHASES = {
    "evolution": ("evolution strategy", pen.SIMULATED, "-"),
    "descent": ("Gauss\N{EN DASH}Newton descent", pen.THIRD, (0, (1.2, 0.8))),
    "simplex": ("simplex", pen.RESIDUAL, (0, (3, 1))),
}


def convergence(stages: Sequence[StageResult]) -> Figure:
    """Figure of the best cost that each phase found over the candidates tried, stage by stage.

    The cross is the cost at the start values, the dot the optimum's. The cost is the mean weighted error per
    sample in standard deviations of the channels; a panel's remark gives it at the start values and at the
    optimum.
    """
    columns = min(SETTINGS.columns, max(len(stages), 1))
    rows = -(-max(len(stages), 1) // columns)
    with pen.house_style():
        figure = pen.new_figure(0.45 + SETTINGS.stage_in * rows)
        grid = pen.grid_of(figure, len(stages), columns)
        for axes, stage in zip(grid.flat, stages, strict=False):
            _panel(axes, stage)
        for axes in grid[:, 0]:
            axes.set_ylabel("cost, sd")
        handles = [
            pen.stroke(label, colour, linestyle=dashes)
            for phase, (label, colour, dashes) in _PHASES.items()
            if any(step.phase == phase for stage in stages for step in stage.history)
        ]
        pen.legend_below(
            figure, [*handles, pen.stroke("optimum", pen.INK, marker="o", linestyle="", markersize=3)]
        )
    return figure


def phase_costs(stage: StageResult) -> list[tuple[str, Array, Array]]:
    """Per phase its name, candidates tried so far, and the best cost that this phase has found by itself.

    The criterion of the global search has a longer step, and the segments' starts may be estimated between
    the phases: a phase may begin above or below the end of the one before.
    """
    phases: list[tuple[str, list[float], list[float]]] = []
    for step in stage.history:
        if not phases or phases[-1][0] != step.phase:
            phases.append((step.phase, [], []))
        if np.isfinite(step.best):
            phases[-1][1].append(float(step.evaluations))
            phases[-1][2].append(step.best)
    return [(phase, np.array(tried), np.array(best)) for phase, tried, best in phases if tried]


def _panel(axes: Axes, stage: StageResult) -> None:
    from matplotlib.ticker import FixedLocator, NullLocator

    phases = phase_costs(stage)
    starts = [stage.start_cost] if np.isfinite(stage.start_cost) else []
    seen = np.concatenate([*(best for _, _, best in phases), np.array([*starts, stage.cost])])
    positive = seen[np.isfinite(seen) & (seen > 0.0)]
    low, high = 0.8 * positive.min(initial=1.0), 1.25 * positive.max(initial=1.0)
    for number_, (phase, tried, best) in enumerate(phases):
        _, colour, dashes = _PHASES.get(phase, (phase, pen.FAINT, ":"))
        axes.step(tried, best, where="post", color=colour, linestyle=dashes, linewidth=1.3)
        if number_:
            axes.axvline(tried[0], 0.0, 0.84, color=pen.FAINT, linewidth=0.8, linestyle=(0, (2, 2)), zorder=1)
    if starts:
        axes.plot(0.0, starts[0], "+", color=pen.INK, markersize=4, clip_on=False, zorder=6)
    if phases:
        axes.plot(phases[-1][1][-1], stage.cost, "o", color=pen.INK, markersize=3, clip_on=False, zorder=6)
    axes.set_yscale("log")
    axes.set_ylim(low, high)
    axes.yaxis.set_major_locator(FixedLocator(np.geomspace(low, high, 5)[1:-1].tolist()))
    axes.yaxis.set_major_formatter("{x:.2g}")
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_xlim(left=0.0)
    axes.locator_params(axis="x", nbins=4)
    axes.set_xlabel("evaluations")
    pen.panel_title(axes, stage.name)
    change = f"$Q$ {pen.number(stage.start_cost)} \N{RIGHTWARDS ARROW} {pen.number(stage.cost)}"
    axes.text(0.98, 0.98, change, transform=axes.transAxes, ha="right", va="top", fontsize=7.5)


def drawings(fit: Identification) -> dict[str, Callable[[], Figure]]:
    """Figures of an identification by name."""
    drawn: dict[str, Callable[[], Figure]] = {"vehicle": partial(three_views, fit.vehicle)}
    if fit.vehicle.actuators:
        drawn["characteristic"] = partial(characteristic, fit.vehicle)
    if fit.stages:
        drawn["convergence"] = partial(convergence, fit.stages)
    if fit.assessment is not None:
        drawn["intervals"] = partial(intervals, fit.assessment)
        drawn["residual_analysis"] = partial(residual_figure, fit.assessment.residual_analysis)
    for trial in fit.problem.trials:
        name = free_name(f"trial_{file_name(trial)}", drawn)
        drawn[name] = partial(trial_figure, fit, trial)
    return drawn


def trial_figure(fit: Identification, name: str) -> Figure:
    """Figure of one trial of an identification, simulated ten seconds ahead again and again.

    Channels are the velocities of the freed axes and those that a stage weighs.
    """
    problem = fit.problem
    trial, windows, channels = predicted(fit, name)
    held_out = problem.held_out(name)
    remark = " (held out as a whole)" if held_out.all() else ""
    restart = f"{fit.restarts.ahead_s:g} s ahead from the"
    restart += " filter's state" if name in fit.restarts.trials else " measured state"
    return measured_against_simulated(
        trial,
        windows,
        channels=channels,
        titles={channel: _scores(fit, name, channel) for channel in channels},
        held_out=None if held_out.all() else held_out,
        heading=f"{fit.vehicle.name}, trial {name}{remark}: {restart}",
    )


def predicted(fit: Identification, name: str) -> tuple[Trial, Sequence[Window], list[str]]:
    """A trial, what the vehicle predicts of it some seconds ahead, again and again, and its channels."""
    problem = fit.problem
    trial = fit.restarts.trials.get(name, problem.trials[name])
    free = "".join(axis for axis in AXES if any(axis in stage.axes.free for stage in problem.stages))
    own = [stage for stage in problem.stages if name in stage.trials] or list(problem.stages)
    shown = {CHANNELS[AXES.index(axis)] for stage in own for axis in stage.axes.free}
    if name in {trial for stage in own for trial in stage.trials}:
        shown |= {channel for stage in own for channel in stage.weights()}
    scored = [kinds["ahead"][name] for kinds in fit.scores.values() if name in kinds.get("ahead", {})]
    shown |= {channel for row in scored for channel in row}
    channels = [channel for channel in CHANNELS if channel in shown and channel in trial.channels]
    simulated = score(
        fit.vehicle,
        trial,
        ahead_s=fit.restarts.ahead_s,
        training=None,
        channels=channels,
        input=problem.input_of(name),
        free=free,
        measured="".join(axis for axis in AXES if axis not in free),
    )
    return trial, simulated.windows, channels


def _scores(fit: Identification, trial: str, channel: str) -> str:
    """Scores of a channel as they stand in the title of its panel."""
    words = []
    for part, label in (("hold_out", "held out"), ("fit", "fit")):
        scores = []
        for kind, remark in (("ahead", f"{fit.restarts.ahead_s:g} s ahead"), ("free", "free run")):
            row = fit.scores.get(part, {}).get(kind, {}).get(trial)
            if row is not None and channel in row and row[channel].blind:
                scores = ["none, commands react to waves"]
            elif row is not None and channel in row and row[channel].n > 1:
                scores.append(f"{pen.tidy(row[channel].r2)} ({remark})")
        if scores:
            words.append(f"{label} R\N{SUPERSCRIPT TWO} {', '.join(scores)}")
    return "  |  ".join(words)
