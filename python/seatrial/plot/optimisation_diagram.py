"""Schema of the parameter optimisation: the loop of a stage, and how the stages follow one another.

Above: recorded inputs drive vehicle and model, the criterion judges the error, evolution strategy and
simplex move the coefficients within their bounds (Taubert et al. 2014, figure 12). Below: the stages of the
campaign at hand; those in one column run side by side, an arrow says which one waits for which. Held by
`tests/test_paper_figures.py`.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from seatrial.plot.diagram import block, connect, dot, page, summing, words
from seatrial.plot.style import WIDTH_IN, house_style
from seatrial.plot.symbols import number, symbol

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.campaign import Campaign
    from seatrial.campaign_file import Stage
    from seatrial.plot.diagram import Block
    from seatrial.stage import StageResult

__all__ = ["columns_of_stages", "optimisation_diagram"]

_LOOP_IN, _GAP_IN, _WIDEST_IN = 2.5, 0.24, 2.05
_LETTERS_PER_IN = 17.0
_PHASES = {
    "simplex": ("simplex", "fine search"),
    "descent": ("Gauss\N{EN DASH}Newton", "descent"),
    "evolution": ("evolution strategy", "global search"),
}


def optimisation_diagram(campaign: Campaign, *, results: Sequence[StageResult] = ()) -> Figure:
    """Figure of the optimisation of a campaign.

    Parameters
    ----------
    campaign : Campaign
    results : sequence of StageResult
        Of an identification: criterion before and after stand in the boxes of the stages.
    """
    places = columns_of_stages(campaign.stages)
    columns = 1 + max(column for column, _ in places.values()) + (campaign.file.polish is not None)
    width = min((WIDTH_IN - 0.04 - _GAP_IN * (columns - 1)) / columns, _WIDEST_IN)
    named = max(len(_wrapped(stage.name, width)) for stage in campaign.stages)
    pitch = (width, 0.56 + 0.165 * named + 0.125 * bool(results))
    lanes = 1 + math.ceil(max(lane for _, lane in places.values()))
    height = _LOOP_IN + pitch[1] * lanes + 0.24
    with house_style():
        figure, axes = page(WIDTH_IN, height)
        phases = {step.phase for one in results for step in one.history} or {"evolution", "simplex"}
        _loop(axes, campaign, height, phases)
        _stages(axes, campaign, places, pitch, {one.name: one for one in results})
    return figure


def columns_of_stages(stages: Sequence[Stage]) -> dict[str, tuple[int, float]]:
    """Column and lane of every stage: a column after all that it waits for, beside one of them if it can be.

    A stage that is alone in its column stands between those that it waits for.
    """
    columns: dict[str, int] = {}
    for stage in stages:
        columns[stage.name] = 1 + max((columns[name] for name in stage.after), default=-1)
    places: dict[str, tuple[int, float]] = {}
    for stage in sorted(stages, key=lambda one: columns[one.name]):
        column = columns[stage.name]
        wanted = [places[name][1] for name in reversed(stage.after)]
        if list(columns.values()).count(column) == 1:
            places[stage.name] = (column, sum(wanted) / max(len(wanted), 1))
            continue
        taken = [lane for other, lane in places.values() if other == column]
        free = [float(lane) for lane in range(len(stages)) if lane not in taken]
        places[stage.name] = (column, next((x for x in wanted if x in free), free[0]))
    return places


def _loop(axes: Axes, campaign: Campaign, height: float, phases: set[str]) -> None:
    """Vehicle and model side by side, criterion, search, and back to the model."""
    high, low, foot = height - 0.42, height - 1.18, height - 1.98
    middle = 0.5 * (high + low)
    trials = [name for name in campaign.trials if any(name in stage.trials for stage in campaign.stages)]
    named = textwrap.shorten(", ".join(trials), 34, placeholder=" \N{HORIZONTAL ELLIPSIS}")
    vehicle = block(axes, (1.95, high), (1.75, 0.5), f"vehicle {campaign.vehicle.name}", [named])
    model = block(axes, (1.95, low), (1.75, 0.5), "model", ["6 degrees of freedom, actuators"])
    circle = summing(axes, (3.35, middle))
    criterion = block(
        axes,
        (4.88, middle),
        (1.95, 0.6),
        r"$Q = \Sigma_c W_c \,\Sigma_i \,\ell(e_{ci} / s_c) \;/\; \Sigma_c W_c N_c$",
        _losses(campaign),
    )
    searches = _searches(axes, foot, phases)
    simplex, evolution = searches[0], searches[-1]
    words(axes, (0.02, middle + 0.1), r"$u(t)$", size_pt=8, ha="left")
    words(axes, (0.02, middle - 0.1), "recorded", size_pt=6.5, ha="left")
    connect(axes, (0.02, middle), (0.62, middle), head=False)
    dot(axes, (0.62, middle))
    for end in (vehicle, model):
        connect(axes, (0.62, middle), (0.62, end.y), end.left)
    connect(axes, vehicle.right, (circle.x, high), circle.top)
    connect(axes, model.right, (circle.x, low), circle.bottom)
    words(axes, (3.06, high + 0.1), r"$y(t)$", size_pt=8)
    words(axes, (3.06, low + 0.11), r"$\hat{y}(t)$", size_pt=8)
    words(axes, (circle.x - 0.09, circle.top[1] + 0.09), "+", size_pt=8)
    words(axes, (circle.x - 0.09, circle.bottom[1] - 0.09), "\N{MINUS SIGN}", size_pt=8)
    connect(axes, circle.right, criterion.left)
    words(axes, (3.66, middle + 0.1), r"$e(t)$", size_pt=8)
    fork = (criterion.x, low - 0.18)
    connect(axes, criterion.bottom, fork, head=False)
    words(axes, (fork[0] + 0.1, fork[1] + 0.14), "$Q$", size_pt=8)
    dot(axes, fork)
    for end in searches:
        connect(axes, fork, (end.x, fork[1]), end.top)
    for former, latter in zip(searches[1:], searches, strict=False):
        connect(axes, former.left, latter.right)
    connect(axes, simplex.left, (model.x, foot), model.bottom)
    words(axes, (0.5 * (simplex.left[0] + model.x), foot + 0.1), "coefficients", size_pt=7)
    connect(axes, (WIDTH_IN - 0.06, foot), evolution.right)
    words(axes, (WIDTH_IN - 0.03, foot + 0.1), "start values", size_pt=6.5, ha="right")
    words(axes, (WIDTH_IN - 0.03, foot - 0.1), "and bounds", size_pt=6.5, ha="right")


def _searches(axes: Axes, y: float, phases: set[str]) -> list[Block]:
    """Boxes of the searches that the stages run, the last one at the left."""
    names = [words_ for phase, words_ in _PHASES.items() if phase in phases] or list(_PHASES.values())[::2]
    low, high, width = 2.85, 6.2, 1.12 if len(names) < 3 else 0.98
    pitch = (high - low - width) / max(len(names) - 1, 1)
    return [
        block(axes, (low + 0.5 * width + pitch * k, y), (width, 0.5), head, [line])
        for k, (head, line) in enumerate(names)
    ]


def _losses(campaign: Campaign) -> list[str]:
    losses = dict.fromkeys(
        f"Huber (knee {number(stage.knee)})" if stage.loss == "huber" else stage.loss
        for stage in campaign.stages
    )
    return [rf"$\ell$: {' or '.join(losses)} error", "$s_c$: standard deviation of the channel"]


def _stages(
    axes: Axes,
    campaign: Campaign,
    places: Mapping[str, tuple[int, float]],
    size: tuple[float, float],
    results: Mapping[str, StageResult],
) -> None:
    """Boxes of the stages and of the joint polish, with the arrows between them."""
    polished = campaign.file.polish is not None
    last = max(column for column, _ in places.values())
    width, lane_in = size
    lanes = 1 + math.ceil(max(lane for _, lane in places.values()))
    top = lane_in * lanes + 0.08

    def centre(column: int, lane: float) -> tuple[float, float]:
        return 0.02 + 0.5 * width + (width + _GAP_IN) * column, top - lane_in * (lane + 0.5)

    words(
        axes,
        (0.02, top + 0.1),
        "stages run from left to right, those in one column side by side",
        size_pt=7,
        ha="left",
    )
    boxes: dict[str, Block] = {}
    for stage in campaign.stages:
        at = centre(*places[stage.name])
        boxes[stage.name] = _stage_box(axes, stage, at, (width, lane_in - 0.14), results.get(stage.name))
    for stage in campaign.stages:
        sources = sorted(stage.after, key=lambda name: places[name][1])
        for number_, name in enumerate(sources):
            over = _occupied(places, places[name], places[stage.name][0])
            offset = -0.14 * (number_ - 0.5 * (len(sources) - 1))
            _arrow(axes, boxes[name], boxes[stage.name], offset=offset, detour=over)
    if not polished:
        return
    joint = block(
        axes, centre(last + 1, 0.5 * (lanes - 1)), (width, max(lane_in - 0.14, 0.7)), "joint polish",
        ["all coefficients and trials,", "Gauss\N{EN DASH}Newton,", "standard deviations"], bold=True,
    )  # fmt: skip
    ends = [s.name for s in campaign.stages if not any(s.name in other.after for other in campaign.stages)]
    ends.sort(key=lambda name: places[name][1])
    for number_, name in enumerate(ends):
        over = _occupied(places, places[name], last + 1)
        offset = -0.16 * (number_ - 0.5 * (len(ends) - 1))
        _arrow(axes, boxes[name], joint, offset=offset, detour=over)


def _stage_box(
    axes: Axes, stage: Stage, at: tuple[float, float], size: tuple[float, float], result: StageResult | None
) -> Block:
    letters = int(_LETTERS_PER_IN * size[0])
    names = _wrapped(stage.name, size[0])
    trials = textwrap.shorten(
        ", ".join(stage.trials), max(letters, 12), placeholder=" \N{HORIZONTAL ELLIPSIS}"
    )
    few = list(stage.coefficients) if len(stage.coefficients) <= 4 else []
    lines = [
        f"free {stage.axes.free}: {trials}",
        " ".join(symbol(name) for name in few) if few else f"{len(stage.coefficients)} coefficients",
    ]
    if result is not None:
        lines.append(f"$Q$ {number(result.start_cost)} \N{RIGHTWARDS ARROW} {number(result.cost)}")
    return block(axes, at, size, "\n".join(names), lines, bold=True)


def _wrapped(name: str, width: float) -> list[str]:
    """A stage's name in one or two lines of a box."""
    return textwrap.wrap(name, int(_LETTERS_PER_IN * width))[:2]


def _occupied(places: Mapping[str, tuple[int, float]], source: tuple[int, float], column: int) -> bool:
    """Whether a stage stands between a place and a column in the place's lane."""
    return any(abs(lane - source[1]) < 1.0 and source[0] < other < column for other, lane in places.values())


def _arrow(axes: Axes, source: Block, target: Block, *, offset: float, detour: bool) -> None:
    """Arrow from the right side of a box to the left of another, around what stands between them."""
    x, y = target.left
    bend = x - 0.55 * _GAP_IN
    start = source.right
    if detour:
        between = source.y - 0.5 * source.height - 0.07
        knee = start[0] + 0.3 * _GAP_IN
        connect(
            axes,
            start,
            (knee, start[1]),
            (knee, between),
            (bend, between),
            (bend, y + offset),
            (x, y + offset),
        )
    elif abs(start[1] - y) < 1e-9:
        connect(axes, (start[0], y + offset), (x, y + offset))
    else:
        connect(axes, start, (bend, start[1]), (bend, y + offset), (x, y + offset))
