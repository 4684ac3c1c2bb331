"""Figures of a verification: failure probabilities, causes, cross-track error, the worst missions' tracks.

A failure boundary is the failure probability over one variable, or its sides over two. Of the cross-track
error: how often it is exceeded, and the p95 of each mission; where the vehicle really was stands beside what
guidance perceived, and the difference is the sensors' own. Held by
``tests/report/test_verification_figures.py``, ``tests/verification/test_verify.py`` and ``test_boundary.py``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from seatrial._core import error_edges
from seatrial.base.arrays import Array
from seatrial.base.files import file_name, free_name
from seatrial.report.plot import style as pen
from seatrial.report.plot.track import (
    extent,
    layout,
    new_plan,
    page_legend,
    planned_path,
    profile_axes,
    waypoint_label,
    waypoints,
)
from seatrial.report.results.verification import odds, reserve
from seatrial.statistics.failure_probability import FailureProbability, share, wilson
from seatrial.verification.boundary import FailureBoundary

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.flight.flight import Flight
    from seatrial.verification.boundary import RequirementBoundary
    from seatrial.verification.causes import Influence
    from seatrial.verification.judgement import JudgedRequirement
    from seatrial.verification.verify import Verification


_COLOUR = {"held": pen.THIRD, "failed": pen.RESIDUAL, "undecided": pen.SECOND}


@dataclass(frozen=True)
class Verified:
    """A row of `verified_requirements`: name, failure probability with its interval, the allowed one."""

    name: str
    probability: FailureProbability
    allowed: float


def verified_requirements(rows: Sequence[Verified], *, heading: str = "") -> Figure:
    """Figure of the failure probability of every requirement against the allowed one, on a logarithmic axis.

    A dot is the share of failures, its bar the exact interval; without any failure the bar ends at its bound.
    """
    with pen.house_style():
        figure = pen.new_figure(0.95 + 0.36 * len(rows))
        axes = figure.subplots()
        numbers = [value for row in rows for value in (*_span(row.probability), row.allowed) if value > 0.0]
        # The edge is half a decade to a whole one below the smallest number.
        left, right = 10.0 ** (0.5 * np.floor(np.log10(min(numbers)) / 0.5) - 0.5), 1.0
        for place, row in enumerate(rows):
            _requirement(axes, row, place, (left, right))
        axes.set_xscale("log")
        axes.set_xlim(left, right)
        axes.set_ylim(len(rows) - 0.45, -0.55)
        axes.set_yticks(range(len(rows)), [_short(row.name) for row in rows])
        axes.tick_params(axis="y", length=0)
        axes.grid(visible=False, axis="y")
        axes.xaxis.set_major_formatter(lambda value, _: share(value))
        sure = sorted({f"{100.0 * row.probability.confidence:g} %" for row in rows})
        axes.set_xlabel(
            f"failure probability of a mission; bar: {' and '.join(sure)} interval; tick: allowed"
        )
        beside = axes.secondary_yaxis("right")
        flown = [(row.probability, row.allowed) for row in rows]
        verdicts = [f"{own.verdict(allowed)}: {own.failures} of {own.runs} fail" for own, allowed in flown]
        beside.set_yticks(range(len(rows)), verdicts)
        beside.tick_params(axis="y", length=0)
        beside.spines["right"].set_visible(False)
        pen.panel_title(axes, heading or "requirements")
    return figure


def cause_bars(causes: Sequence[Influence], *, heading: str = "", most: int = 6) -> Figure:
    """Figure of what drives the failures: strength of each cause, failure rate along the leading ones."""
    shown = list(causes[:most])
    led = [cause for cause in shown if cause.named and cause.by_failures][:3]
    with pen.house_style():
        figure = pen.new_figure(max(2.1, 1.35 + 0.3 * len(shown)) if not led else 2.9)
        panels = figure.subplots(1, 1 + len(led), squeeze=False, width_ratios=[1.5] + [1.0] * len(led))[0]
        _strengths(panels[0], shown)
        for axes, cause in zip(panels[1:], led, strict=True):
            _rates(axes, cause)
        if led:
            panels[1].set_ylabel("missions that fail, %")
            highest = max(axes.get_ylim()[1] for axes in panels[1:])
            for axes in panels[1:]:  # the eye compares their heights
                axes.set_ylim(0.0, highest)
        failures = all(cause.by_failures for cause in shown)
        goes = f"what its {'failures go' if failures else 'reserve goes'} with"
        pen.heading(figure, f"{_short(heading, 56)}: {goes}" if heading else goes)
    return figure


def _requirement(axes: Axes, row: Verified, place: int, span: tuple[float, float]) -> None:
    colour = _COLOUR[row.probability.verdict(row.allowed)]
    low, high = _span(row.probability)
    pen.band(axes, np.array([row.allowed, span[1]]), place - 0.42, place + 0.42, pen.RESIDUAL, alpha=0.08)
    axes.plot([max(low, span[0]), high], [place, place], color=colour, linewidth=3.2, solid_capstyle="butt")
    if row.probability.failures:
        axes.plot(row.probability.estimate, place, "o", color=colour, markersize=6.0, markeredgecolor="white")
    else:
        axes.plot(high, place, "|", color=colour, markersize=9.0, markeredgewidth=1.6)
    axes.plot([row.allowed] * 2, [place - 0.42, place + 0.42], color=pen.MEASURED, linewidth=1.6)


def _span(probability: FailureProbability) -> tuple[float, float]:
    return probability.interval if probability.failures else (0.0, probability.at_most)


def _strengths(axes: Axes, causes: Sequence[Influence]) -> None:
    by_failures = all(cause.by_failures for cause in causes)
    for place, cause in enumerate(causes):
        axes.barh(place, cause.strength, height=0.62, color=pen.SIMULATED if cause.named else pen.FAINT)
        x, look = cause.strength + 0.02, pen.Style(ha="left", color=pen.INK)
        if cause.strength > 0.6:
            x, look = cause.strength - 0.02, pen.Style(ha="right", color="white" if cause.named else pen.INK)
        axes.text(x, place, _size(cause), va="center", fontsize=6.5, **look)
    axes.set_yticks(range(len(causes)), [_two_lines(entry.label, 24) for entry in causes], fontsize=6.5)
    axes.set_ylim(max(len(causes), 1) - 0.4, -0.6)
    axes.set_xlim(0.0, 1.0)
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")
    what = "strength |2 AUC \N{MINUS SIGN} 1|" if by_failures else "|rank correlation| with the reserve"
    axes.set_xlabel(f"{what}\ngrey: not shown to matter")


def _size(cause: Influence) -> str:
    if not cause.by_failures:
        return f"{cause.correlation:+.2f}".replace("-", "\N{MINUS SIGN}")
    ratio = f", odds \N{MULTIPLICATION SIGN} {odds(cause.odds)}" if 0.0 < cause.odds < np.inf else ""
    return f"AUC {cause.auc:.2f}{ratio}"


def _rates(axes: Axes, cause: Influence) -> None:
    groups = cause.groups
    failures, runs = np.array(groups.failures), np.array(groups.runs)
    met = runs > 0
    low, high = (100.0 * bound for bound in wilson(failures[met], runs[met]))
    place, rate = np.flatnonzero(met), 100.0 * failures[met] / runs[met]
    axes.bar(place, rate, width=0.8, color=pen.SIMULATED)
    error = np.clip(np.stack([rate - low, high - rate]), 0.0, None)
    axes.errorbar(place, rate, error, fmt="none", ecolor=pen.MEASURED, elinewidth=0.9, capsize=1.8)
    axes.set_ylim(bottom=0.0)
    axes.grid(visible=False, axis="x")
    axes.set_title(_two_lines(cause.name, 19), loc="left", fontweight="bold", fontsize=7)
    aslant: pen.Style = {"rotation": 30, "ha": "right", "rotation_mode": "anchor", "fontsize": 6.0}
    if groups.edges:
        first = [label.split(" to ")[0] for label in groups.labels]
        words = [*first, groups.labels[-1].split(" to ")[1]]
        words = [word.replace("-", "\N{MINUS SIGN}") for word in words]
        axes.set_xticks(np.arange(len(words)) - 0.5, words, **aslant)
        axes.set_xlabel(f"fifths, {cause.unit}" if cause.unit and cause.unit != "1" else "fifths")
    elif cause.kind == "direction":
        axes.set_xticks(range(len(runs)), groups.labels, fontsize=6.0)
        axes.set_xlabel("towards")
    else:
        axes.set_xticks(range(len(runs)), [_short(label, 12) for label in groups.labels], **aslant)


def _two_lines(name: str, width: int) -> str:
    """A name in two lines where one is too short for it."""
    return "\n".join(wrap(name, width, max_lines=2, placeholder="\N{HORIZONTAL ELLIPSIS}"))


def _short(name: str, longest: int = 34) -> str:
    return name if len(name) <= longest else f"{name[: longest - 1]}\N{HORIZONTAL ELLIPSIS}"


_OBSTACLE = "obstacle"


@dataclass(frozen=True, eq=False)
class WorstFlight:
    """A flight with its label, such as "522: -6.6 m"."""

    label: str
    flight: Flight


def worst_missions(flights: Sequence[WorstFlight], *, heading: str = "") -> Figure:
    """Figure of flights of one mission, the worst first, over its plan, with what stands in the water."""
    first = flights[0].flight
    path = planned_path(first.mission, seabed=first.circumstances.seabed)
    acceptance = np.array([stop.acceptance for stop in first.route.stops])
    tracks = [worst.flight.position[np.isfinite(worst.flight.position).all(axis=1)] for worst in flights]
    reach = [path.places[1:] + acceptance[:, None], path.places[1:] - acceptance[:, None]]
    corners = extent(path.points, *tracks, *reach)
    obstacles = [obstacle for obstacle in first.circumstances.obstacles if _within(obstacle, corners)]
    plain = ["planned path", waypoint_label(path), "sphere of acceptance"] + [_OBSTACLE] * bool(obstacles)
    page = layout(corners, [*plain, *(worst.label for worst in flights)])
    with pen.house_style():
        figure = pen.new_figure(page.height, constrained=False)
        plan = new_plan(figure, page.plan, corners)
        _obstacles(plan.axes, obstacles)
        waypoints(plan, path, acceptance, tracks[0])
        profile = profile_axes(figure, page)
        # The worst flight lies on top and is drawn strongest.
        for number, (worst, track) in enumerate(zip(flights, tracks, strict=True)):
            colour = pen.CYCLE[number % len(pen.CYCLE)]
            style = pen.Style(color=colour, linewidth=1.2 if number == 0 else 0.9, zorder=4.0 - 0.1 * number)
            plan.axes.plot(track[:, 1], track[:, 0], label=worst.label, **style)
            plan.axes.plot(track[-1, 1], track[-1, 0], "s", color=colour, markersize=4.0, zorder=5.0)
            profile.plot(worst.flight.t[: len(track)], track[:, 2], **style)
        pen.panel_title(plan.axes, "tracks", "square: end")
        profile.invert_yaxis()
        profile.set_xlabel("time, s")
        profile.set_ylabel("depth, m")
        profile.ticklabel_format(useOffset=False)
        profile.set_xlim(0.0, max(float(worst.flight.t[-1]) for worst in flights))
        pen.panel_title(profile, "depth")
        pen.page_heading(figure, heading or f"worst missions of {first.mission.name}", below_in=0.13)
        page_legend(figure, (plan.axes, profile), page)
    return figure


def _within(obstacle: tuple[float, float, float], corners: tuple[Array, Array]) -> bool:
    """Whether some of an obstacle lies in the view; a far one would make the tracks small."""
    place, radius = np.array(obstacle[:2]), obstacle[2]
    nearest = np.clip(place, *corners)
    return bool(np.hypot(*(place - nearest)) <= radius)


def _obstacles(axes: Axes, obstacles: Sequence[tuple[float, float, float]]) -> None:
    from matplotlib.patches import Circle

    look = pen.Style(facecolor=pen.SHADE, edgecolor=pen.HULL_EDGE, linewidth=0.8, zorder=1.5)
    for number, (north, east, radius) in enumerate(obstacles):
        label = None if number else _OBSTACLE
        axes.add_patch(Circle((east, north), radius, label=label, **look))


_LIMIT = re.compile(r"\b((?:true_)?cross_track_p95_m) <=? ([0-9.]+)")

_TRUE = "true_cross_track_p95_m"


def drawings(result: Verification | FailureBoundary) -> dict[str, Callable[[], Figure]]:
    """Figures by name: requirements, cross-track error, causes and worst missions; boundaries of a survey.

    The worst missions of each requirement that some mission failed are flown again for their tracks.
    """
    if isinstance(result, FailureBoundary):
        boundaries: dict[str, Callable[[], Figure]] = {}
        for own in result.requirements:
            name = free_name(file_name(f"boundary_{own.requirement.name}", instead="_"), boundaries)
            boundaries[name] = partial(boundary_figure, result, own)
        return boundaries
    missions = ", ".join(result.flights.titles)
    rows = [
        Verified(judged.requirement.name, judged.found, judged.requirement.allowed)
        for judged in result.requirements
    ]
    heading = f"{missions}: {len(result.flown)} missions"
    drawn: dict[str, Callable[[], Figure]] = {
        "requirements": partial(verified_requirements, rows, heading=heading),
        "cross_track": partial(_cross_track_of, result),
    }
    taken: set[str] = set()
    for judged in [row for row in result.requirements if row.found.failures][:6]:  # figures of a gallery
        name = free_name(file_name(judged.requirement.name, instead="_"), taken)
        taken.add(name)
        drawn[f"causes_{name}"] = partial(cause_bars, judged.causes, heading=judged.requirement.name)
        if judged.worst:
            drawn[f"worst_{name}"] = partial(_worst, result, judged)
    return drawn


def _cross_track_of(verification: Verification) -> Figure:
    """Cross-track error, true and as perceived; the missions' p95 of the one that a requirement is about."""
    asked = [
        limit for judged in verification.requirements for limit in _LIMIT.findall(judged.requirement.holds)
    ]
    # Where requirements ask for both, the true error is what matters.
    metric, limit = max(asked, key=lambda limit_of: limit_of[0] == _TRUE, default=(_TRUE, ""))
    return cross_track(
        verification.flown.true_counts,
        error_edges(),
        perceived=verification.flown.perceived_counts,
        p95_m=verification.flown.metrics[metric],
        of="true" if metric == _TRUE else "as guidance perceived it",
        threshold_m=float(limit) if limit else None,
    )


def _worst(verification: Verification, judged: JudgedRequirement) -> Figure:
    """Tracks of the worst missions, as far as they fly the same mission as the worst of all."""
    same = [run for run in judged.worst if run.mission == judged.worst[0].mission]
    same = same[:4]  # more hide one another
    flights = [
        WorstFlight(
            f"mission {run.number}: {reserve(run.reserve, judged.judgement.unit)}",
            verification.replay(run.number),
        )
        for run in same
    ]
    title = f"{same[0].mission}, {judged.requirement.name}: smallest robustness"
    return worst_missions(flights, heading=title)


_SAFE, _UNSAFE = "#CFE3F2", "#F4D3BE"


def boundary_figure(boundaries: FailureBoundary, boundary: RequirementBoundary) -> Figure:
    """Figure of a requirement's failure boundary with its uncertainty and the places that were flown."""
    with pen.house_style():
        figure = pen.new_figure(3.1 if len(boundaries.variables) == 1 else 4.6)
        axes = figure.subplots()
        (_boundary_curve if len(boundaries.variables) == 1 else _map)(axes, boundaries, boundary)
        pen.panel_title(axes, boundary.requirement.name, boundary.requirement.holds)
    return figure


def _boundary_curve(axes: Axes, boundaries: FailureBoundary, boundary: RequirementBoundary) -> None:
    from scipy.special import ndtr

    surface = boundary.surface
    x = np.array([boundaries.value(0, at) for at in surface.axis])
    low, high = (ndtr(surface.mean + sign * surface.quantile * surface.sd) for sign in (-1.0, 1.0))
    sure = f"{100.0 * boundaries.scenario.flights.table.confidence:g} %"
    pen.band(axes, x, low, high, pen.SIMULATED, alpha=0.2, label=f"{sure} band")
    axes.plot(x, surface.probability, color=pen.SIMULATED, label="failure probability")
    allowed = boundary.requirement.allowed
    axes.axhline(allowed, color=pen.RESIDUAL, linewidth=0.9, label=f"allowed, {share(allowed)}")
    for k, (value, start, stop, _) in enumerate(boundaries.crossings(boundary.requirement.name)):
        label = f"boundary and its {sure} interval" if k == 0 else None
        axes.axvspan(start, stop, color=pen.SHADE, linewidth=0.0, zorder=0.5, label=label)
        axes.axvline(value, color=pen.MEASURED, linewidth=0.9, linestyle="--", zorder=1.0)
    flown = boundaries.places[:, 0]
    axes.plot(flown, np.zeros(len(flown)), "|", color=pen.FAINT, label="places flown")
    axes.set_xlim(x[0], x[-1])
    top = float(np.max(surface.probability))
    axes.set_ylim(-0.02 * max(top, 3.0 * allowed), max(1.1 * top, 3.0 * allowed))
    axes.set_xlabel(_label(next(iter(boundaries.variables))))
    axes.set_ylabel("failure probability")
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), fontsize="small")


def _map(axes: Axes, boundaries: FailureBoundary, boundary: RequirementBoundary) -> None:
    from matplotlib.colors import ListedColormap

    surface = boundary.surface
    first, second = ([boundaries.value(k, at) for at in surface.axis] for k in (0, 1))
    off = (surface.mean - surface.level) / np.maximum(surface.sd, 1e-12)
    edges: list[float] = [-np.inf, -surface.quantile, surface.quantile, np.inf]
    colours: Any = ListedColormap([_SAFE, "white", _UNSAFE]).colors
    axes.contourf(first, second, np.clip(off, -1e6, 1e6).T, levels=np.clip(edges, -1e7, 1e7), colors=colours)
    over = (surface.mean - surface.level).T
    sure = f"{100.0 * boundaries.scenario.flights.table.confidence:g} %"
    handles: list[Artist] = [
        pen.field(f"holds, {sure} sure", _SAFE),
        pen.field("not known", "white", edgecolor=pen.FAINT),
        pen.field(f"fails, {sure} sure", _UNSAFE),
    ]
    if over.min() < 0.0 < over.max():
        axes.contour(first, second, over, levels=[0.0], colors=[pen.MEASURED], linewidths=1.2)
        allowed = share(boundary.requirement.allowed)
        handles.append(pen.stroke(f"failure probability {allowed}", pen.MEASURED))
    axes.plot(*boundaries.places[:, :2].T, ".", color=pen.FAINT, markersize=3.0, clip_on=False)
    handles.append(pen.stroke("places flown", pen.FAINT, marker=".", linestyle=""))
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


def exceedance(counts: ArrayLike, edges: ArrayLike) -> Array:
    """Share of the samples above each rising edge, (E,), m.

    `counts` (E + 1,): first the samples below the first edge, last those above the last one.

    Examples
    --------
    >>> exceedance([6, 3, 1], [0.1, 0.5]).tolist()
    [0.4, 0.1]
    """
    number, edge = np.asarray(counts, float), np.asarray(edges, float)
    if number.shape != (len(edge) + 1,):
        raise ValueError(f"counts: expected one more than the {len(edge)} edges, found shape {number.shape}")
    total = number.sum()
    above = total - np.cumsum(number)[:-1]
    return np.asarray(above / total if total else np.full(len(edge), np.nan))


def quantile_of_counts(counts: ArrayLike, edges: ArrayLike, *, share_below: float) -> float:
    """Value below which a share of the samples lies, m.

    Within a bin the logarithm of the share above is linear, as the figure draws it; in the last bin that has
    samples, where nothing is left above, the share itself. Infinite above the last edge, not a number without
    samples.
    """
    edge, above = np.append(0.0, np.asarray(edges, float)), np.append(1.0, exceedance(counts, edges))
    wanted = 1.0 - share_below
    if not above[-1] <= wanted:
        return float("nan") if np.isnan(above[-1]) else float("inf")
    last = int(np.argmax(above <= wanted))
    high, low = above[last - 1], above[last]
    if low > 0.0:
        high, low, wanted = np.log(high), np.log(low), np.log(wanted)
    return float(edge[last - 1] + (edge[last] - edge[last - 1]) * (high - wanted) / (high - low))


def cross_track(
    counts: ArrayLike,
    edges: ArrayLike,
    *,
    p95_m: ArrayLike,
    perceived: ArrayLike | None = None,
    of: str = "true",
    threshold_m: float | None = None,
    heading: str = "",
) -> Figure:
    """Figure of the cross-track error on settled legs of all missions together, and of each mission's p95.

    `counts` and `perceived`, (k, E + 1) or (E + 1,), are samples of |cross-track error| between `edges` (E,),
    m: where the vehicle really was, and as guidance perceived it. `p95_m` (k,) is of the error that `of`
    names, not a number of a mission that diverged; a requirement allows `threshold_m`.
    """
    pooled = np.atleast_2d(np.asarray(counts, float)).sum(axis=0)
    perceived_counts = None if perceived is None else np.atleast_2d(np.asarray(perceived, float)).sum(axis=0)
    edge, p95 = np.asarray(edges, float), np.asarray(p95_m, float)
    with pen.house_style():
        figure = pen.new_figure(2.7)
        curve, beside = figure.subplots(1, 2, width_ratios=(1.35, 1.0))
        _curve(curve, pooled, edge, threshold_m, perceived_counts)
        _histogram(beside, p95, threshold_m, of)
        pen.heading(figure, heading)
    return figure


def _curve(
    axes: Axes, counts: Array, edges: Array, threshold_m: float | None, perceived_counts: Array | None
) -> None:
    above = exceedance(counts, edges)
    seen = above > 0.0
    pen.panel_title(axes, "all samples", "settled legs of all missions")
    axes.set_xlabel("cross-track error $|y_e|$, m")
    axes.set_ylabel("share of the samples above, %")
    if not seen.any():
        pen.blank(axes, "no leg settled")
        return
    last = min(int(np.flatnonzero(seen)[-1]) + 1, len(edges) - 1)
    floor = 10.0 ** np.floor(np.log10(100.0 * above[seen].min()))
    x, y = np.append(0.0, edges[seen]), np.append(100.0, 100.0 * above[seen])
    if perceived_counts is not None:
        _perceived(axes, perceived_counts, edges)
    axes.plot(x, y, color=pen.SIMULATED, label="true")
    for part in (0.50, 0.95, 0.99):  # shares of the samples whose error is marked
        value = quantile_of_counts(counts, edges, share_below=part)
        if not np.isfinite(value):
            continue
        level = 100.0 * (1.0 - part)
        axes.plot([value, value], [floor, level], color=pen.FAINT, linewidth=0.8, linestyle=(0, (2, 1.5)))
        axes.plot(value, level, "o", color=pen.SIMULATED, markersize=4.0)
        words, small = (
            f"p{100.0 * part:.0f} {value:.2f} m",
            pen.Style(fontsize=6.5, zorder=5, bbox=pen.ON_WHITE),
        )
        axes.annotate(words, (value, level), (5, 2), textcoords="offset points", **small)
    axes.set_yscale("log")
    axes.set_ylim(floor, 140.0)
    axes.set_xlim(0.0, 1.15 * max(edges[last], threshold_m or 0.0))
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    _threshold(axes, threshold_m, at=0.0)
    if perceived_counts is not None:
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.21), ncols=2, borderaxespad=0.0)


def _perceived(axes: Axes, counts: Array, edges: Array) -> None:
    """The error that guidance perceived, beside the true one."""
    above = exceedance(counts, edges)
    some = above > 0.0
    look = pen.Style(
        color=pen.SECOND, linewidth=1.0, linestyle=(0, (4, 1.5)), label="as guidance perceived it"
    )
    axes.plot(np.append(0.0, edges[some]), np.append(100.0, 100.0 * above[some]), **look)


def _histogram(axes: Axes, p95: Array, threshold_m: float | None, of: str) -> None:
    known = p95[np.isfinite(p95)]
    lost = len(p95) - len(known)
    pen.panel_title(axes, "p95 of each mission", f"{lost} without one" if lost else "")
    axes.set_xlabel(f"p95 of $|y_e|$, {of}, m")
    axes.set_ylabel("missions")
    if not len(known):
        pen.blank(axes, "no leg settled")
        return
    reach = 1.02 * max(float(known.max()), 1e-3, 1.08 * (threshold_m or 0.0))
    # A bin ends at the threshold: no bar is partly above it.
    bins = np.linspace(0.0, reach, 41)
    if threshold_m:
        width = threshold_m / max(1.0, round(threshold_m / (reach / 40)))
        bins = np.arange(0.0, reach + width, width)
    number, _ = np.histogram(known, bins)
    centre = 0.5 * (bins[1:] + bins[:-1])
    over = centre > (threshold_m if threshold_m is not None else np.inf)
    width = float(bins[1] - bins[0])
    axes.bar(centre[~over], number[~over], width=width, color=pen.SIMULATED, alpha=0.8, linewidth=0.0)
    axes.bar(centre[over], number[over], width=width, color=pen.RESIDUAL, linewidth=0.0)
    # Missions are whole, and a single one beyond the threshold must be seen.
    axes.set_yscale("symlog", linthresh=1.0)
    axes.set_ylim(0.0, 2.0 * max(number.max(), 1))
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.set_xlim(0.0, bins[-1])
    _threshold(axes, threshold_m)
    if threshold_m is not None:
        more = int((known > threshold_m).sum()) + lost
        above = f"above {threshold_m:g} m: {more} of {len(p95)} ({share(more / len(p95))})"
        axes.set_xlabel(f"p95 of $|y_e|$, {of}, m\n{above}")


def _threshold(axes: Axes, threshold_m: float | None, *, at: float = 1.0) -> None:
    if threshold_m is None:
        return
    axes.axvline(threshold_m, color=pen.RESIDUAL, linewidth=1.1)
    look = pen.Style(fontsize=6.5, va="top" if at else "bottom", color=pen.RESIDUAL, zorder=5)
    place = pen.Style(xycoords=("data", "axes fraction"), textcoords="offset points")
    box = pen.ON_WHITE | {"pad": 0.4}
    axes.annotate("allowed", (threshold_m, at), (3, -2 if at else 2), bbox=box, **look, **place)
