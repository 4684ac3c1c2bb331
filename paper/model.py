"""Block diagram of the model: the equation of motion with the terms that a vehicle has.

``M nu' = tau - C_RB(nu) nu - C_A(nu_r) nu_r + M_A nu_c' - D(nu_r) nu_r + tau_L(nu_r) - g(eta)``, solved for
the free axes, and the kinematics (Taubert et al. 2014, figure 2 (model) and equations 4 to 7 with the signs
of the errata page; Fossen 2011, equation 7.9). A term without a coefficient is dashed. Held by
`tests/report/test_vehicle_figures.py`.

Schema of the parameter optimisation: the loop of a stage, and how the stages follow one another.

Above: recorded inputs drive vehicle and model, the criterion judges the error, evolution strategy and
simplex move the coefficients within their bounds (Taubert et al. 2014, figure 11 (optimisation)). Below: the
stages of the campaign at hand; those in one column run side by side, an arrow says which one waits for
which. Held by `tests/examples/test_paper_figures.py`.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from paper.diagram import bar, block, connect, dot, page, summing, words
from seatrial.base.channels import AXES, VELOCITIES
from seatrial.report.plot.style import WIDTH_IN, house_style, number, symbol

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from paper.diagram import Block
    from seatrial._core import Vehicle
    from seatrial.estimation.stage import StageResult
    from seatrial.problem.problem import Problem
    from seatrial.problem.settings import Stage

_ROW_IN, _GAP_IN, _BOTTOM_IN, _TOP_IN = 0.56, 0.36, 0.08, 0.6

_MOST = 8

_LACKING = {"current": "added mass"}

_BAR_X, _TERM_X, _TERM_WIDTH, _BUS_X, _OUT_X = 1.42, 2.98, 2.26, 4.52, 6.62


@dataclass(frozen=True)
class Term:
    """A term of the sum of forces: its formula, sign, input and what the vehicle has of it."""

    key: str
    formula: str
    sign: str
    input: str
    lines: tuple[str, ...]

    @property
    def absent(self) -> bool:
        """Whether the vehicle has nothing of it."""
        return not self.lines


def terms(vehicle: Vehicle) -> list[Term]:
    """Terms of the sum of forces beside the actuators', from the top of the diagram to its foot."""
    values = {name: x for name, x in vehicle.coefficients().items() if x != 0.0 and "." not in name}
    weight = values["m"] * vehicle.environment()["g"]
    buoyancy = values.get("B", 0.0)
    added = _listed(values, r"[XYZKMN]_[uvwpqr]dot")
    linear = _listed(values, r"[XYZKMN]_[uvwpqr]")
    quadratic = _listed(values, r"[XYZKMN]_([uvwpqr])\1")
    strips = _listed(values, r"C_D[yz]")
    lift = _listed(values, r"[YZMN]_u[vwqr]")
    bias = _listed(values, r"[XYZKMN]_0")
    lever = np.array([values.get(f"{a}_g", 0.0) - values.get(f"{a}_b", 0.0) for a in "xyz"])
    levers = ", ".join(number(1e3 * float(x)) for x in lever)
    found = [
        Term(
            "rigid body",
            r"$\mathbf{C}_{RB}(\nu)\,\nu$",
            "\N{MINUS SIGN}",
            "nu",
            (f"rigid body: $m$ = {number(values['m'])} kg{_centre(values)}",),
        ),
        Term(
            "added mass",
            r"$\mathbf{C}_A(\nu_r)\,\nu_r$",
            "\N{MINUS SIGN}",
            "nu_r",
            (f"added mass: {added}",) if added else (),
        ),
        Term(
            "current",
            r"$\mathbf{M}_A\,\dot{\nu}_c$",
            "+",
            "current",
            ("added mass in a turning current",) if added else (),
        ),
        Term(
            "damping",
            r"$\mathbf{D}(\nu_r)\,\nu_r$",
            "\N{MINUS SIGN}",
            "nu_r",
            tuple(
                f"{word}: {names}"
                for word, names in (("linear", linear), ("quadratic", quadratic), ("strips", strips))
                if names
            ),
        ),
        Term("lift", r"$\tau_L(\nu_r)$", "+", "nu_r", (f"lift: {lift}",) if lift else ()),
        Term(
            "restoring",
            r"$g(\eta)$",
            "\N{MINUS SIGN}",
            "eta",
            (
                f"restoring: $W$ = {number(weight, 4)} N, $B$ = {number(buoyancy, 4)} N",
                rf"$r_g - r_b$ = ({levers}) mm",
            ),
        ),
    ]
    if bias:
        found.append(Term("bias", r"$\tau_0$", "+", "", (f"constant bias: {bias}",)))
    return found


def model_diagram(vehicle: Vehicle, *, modes: str = "free, frozen or measured axes") -> Figure:
    """Figure of the block diagram of a vehicle's model.

    Parameters
    ----------
    vehicle : Vehicle
    modes : str
        Words at the input V_const: which axes are free, frozen or measured.
    """
    shown = terms(vehicle)
    main = _BOTTOM_IN + _ROW_IN * len(shown) + _GAP_IN
    with house_style():
        figure, axes = page(WIDTH_IN, main + _TOP_IN)
        sum_bar = bar(axes, _BAR_X, _BOTTOM_IN, main + 0.25)
        _main_path(axes, vehicle, main, sum_bar, modes)
        rows = {}
        for number_, term in enumerate(shown):
            y = main - _GAP_IN - _ROW_IN * (number_ + 0.5)
            lines = term.lines or (f"{_LACKING.get(term.key, term.key)}: not given",)
            made = block(
                axes, (_TERM_X, y), (_TERM_WIDTH, _ROW_IN - 0.1), term.formula, lines, absent=term.absent
            )
            connect(axes, made.left, (sum_bar.right[0], y), absent=term.absent)
            words(axes, (sum_bar.right[0] + 0.09, y + 0.09), term.sign, size_pt=8)
            rows[term.key] = made
        _buses(axes, shown, rows, main)
    return figure


def _main_path(axes: Axes, vehicle: Vehicle, y: float, sum_bar: Block, modes: str) -> None:
    """Actuators, reduced system, integrators and kinematics, from left to right."""
    count = len(vehicle.actuators)
    words(axes, (0.02, y + 0.1), r"$u_A$", size_pt=8, ha="left")
    made = f"{count} actuator{'' if count == 1 else 's'}" if count else "no actuator"
    values = vehicle.coefficients()
    facts = vehicle.actuator_info()
    inflow = any(values.get(f"{name}.p2", 0.0) or facts[name]["kind"] == "fin" for name in vehicle.actuators)
    formula = r"$\mathbf{B}(u_A, \nu_r)$" if inflow else r"$\mathbf{B}(u_A)$"
    actuators = block(axes, (0.7, y), (0.8, 0.5), formula, [made], absent=not count)
    connect(axes, (0.02, y), actuators.left, absent=not count)
    if inflow:
        connect(axes, (actuators.x, y - 0.62), actuators.bottom)
        words(axes, (actuators.x, y - 0.7), r"$\nu_r$ (inflow)", size_pt=7)
    connect(axes, actuators.right, (sum_bar.left[0], y), absent=not count)
    words(axes, (1.22, y + 0.1), r"$\tau$", size_pt=8)
    system = block(
        axes,
        (2.72, y),
        (1.74, 0.54),
        r"$\dot{\nu}_F = \mathbf{M}_{FF}^{-1}\,(f_F - \mathbf{M}_{FC}\,\dot{\nu}_C)$",
        [r"$\mathbf{M} = \mathbf{M}_{RB} + \mathbf{M}_A$"],
    )
    connect(axes, (sum_bar.right[0], y), system.left)
    words(axes, (1.66, y + 0.1), r"$f$", size_pt=8)
    connect(axes, (system.x, y + 0.48), system.top)
    words(axes, (system.x + 0.08, y + 0.41), rf"$V_{{const}}$: {modes}", ha="left", widest=2.5)
    first = block(axes, (4.1, y), (0.28, 0.38), r"$\int$")
    connect(axes, system.right, first.left)
    words(axes, (0.5 * (system.right[0] + first.left[0]), y + 0.1), r"$\dot{\nu}$", size_pt=8)
    kinematics = block(
        axes,
        (5.32, y),
        (0.98, 0.5),
        "",
        [r"$\dot{p} = \mathbf{R}\,v$", r"$\dot{q} = \frac{1}{2}\,q\otimes\omega$"],
    )
    connect(axes, first.right, kinematics.left)
    words(axes, (_BUS_X + 0.14, y + 0.1), r"$\nu$", size_pt=8)
    second = block(axes, (6.2, y), (0.28, 0.38), r"$\int$")
    connect(axes, kinematics.right, second.left)
    words(axes, (5.93, y + 0.1), r"$\dot{\eta}$", size_pt=8)
    connect(axes, second.right, (WIDTH_IN - 0.06, y))
    words(axes, (WIDTH_IN - 0.2, y + 0.1), r"$\eta$", size_pt=8)
    dot(axes, (_OUT_X, y))
    connect(axes, (_OUT_X, y), (_OUT_X, y + 0.41), (kinematics.x, y + 0.41), kinematics.top)


def _buses(axes: Axes, shown: list[Term], rows: dict[str, Block], main: float) -> None:
    """Velocity, velocity relative to the water and position down to the terms that need them."""
    level = {term.key: rows[term.key].y for term in shown}
    dot(axes, (_BUS_X, main))
    meet = 0.5 * (level["rigid body"] + level["added mass"])
    circle = summing(axes, (_BUS_X, meet))
    connect(axes, (_BUS_X, main), circle.top)
    connect(axes, (_BUS_X, level["rigid body"]), rows["rigid body"].right)
    dot(axes, (_BUS_X, level["rigid body"]))
    ocean = _ocean(axes, level, meet)
    connect(axes, (ocean.left[0], meet), circle.right)
    words(axes, (circle.right[0] + 0.09, meet + 0.08), "\N{MINUS SIGN}", size_pt=8)
    words(axes, (_BUS_X - 0.09, circle.top[1] + 0.07), "+", size_pt=7)
    words(axes, (ocean.left[0] - 0.1, meet + 0.08), r"$\nu_c$", size_pt=8)
    below = [term for term in shown if term.input == "nu_r"]
    last = below[-1]
    connect(axes, circle.bottom, (_BUS_X, level[last.key]), rows[last.key].right, absent=False)
    words(axes, (_BUS_X + 0.13, level["damping"] + 0.12), r"$\nu_r$", size_pt=8)
    for term in below[:-1]:
        dot(axes, (_BUS_X, level[term.key]))
        connect(axes, (_BUS_X, level[term.key]), rows[term.key].right)
    connect(axes, (ocean.left[0], level["current"]), rows["current"].right)
    words(axes, (ocean.left[0] - 0.1, level["current"] + 0.09), r"$\dot{\nu}_c$", size_pt=8)
    connect(axes, (_BUS_X, level["rigid body"]), (ocean.x, level["rigid body"]), ocean.top)
    connect(axes, (_OUT_X, main), (_OUT_X, level["restoring"]), rows["restoring"].right)
    dot(axes, (_OUT_X, ocean.y))
    connect(axes, (_OUT_X, ocean.y), ocean.right)
    words(axes, (_OUT_X + 0.12, level["damping"]), r"$\eta$", size_pt=8)
    foot = (ocean.x, ocean.bottom[1] - 0.24)
    connect(axes, foot, ocean.bottom)
    words(axes, (foot[0], foot[1] - 0.08), r"$v_c$ in $n$: ocean current", size_pt=6.5)


def _ocean(axes: Axes, level: dict[str, float], meet: float) -> Block:
    """The current in body axes and its rate, beside the sum that makes the relative velocity."""
    high, low = meet + 0.14, level["current"] - 0.14
    return block(
        axes,
        (5.68, 0.5 * (high + low)),
        (1.32, high - low),
        "current in body axes",
        [r"$\nu_c = [\mathbf{R}^T v_c;\;0]$", r"$\dot{\nu}_c = [-\mathbf{S}(\omega)\,\mathbf{R}^T v_c;\;0]$"],
    )


def _listed(values: dict[str, float], pattern: str) -> str:
    """Coefficients of a kind, the diagonal's first; of many only their number."""

    def order(name: str) -> tuple[bool, int]:
        axis = AXES.index(name[0])
        return name[2] != VELOCITIES[axis], axis

    found = sorted((name for name in values if re.fullmatch(pattern, name)), key=order)
    rest = len(found) - _MOST
    return " ".join(symbol(name) for name in found[:_MOST]) + (f" and {rest} more" if rest > 0 else "")


def _centre(values: dict[str, float]) -> str:
    place = [values.get(f"{axis}_g", 0.0) for axis in "xyz"]
    if not any(place):
        return ", $r_g$ = 0"
    return ", $r_g$ = (" + ", ".join(number(1e3 * x) for x in place) + ") mm"


_LOOP_IN, _OPTIMISATION_DIAGRAM_GAP_IN, _WIDEST_IN = 2.5, 0.24, 2.05

_LETTERS_PER_IN = 17.0

_PHASES = {
    "simplex": ("simplex", "fine search"),
    "descent": ("Gauss\N{EN DASH}Newton", "descent"),
    "evolution": ("evolution strategy", "global search"),
}


def optimisation_diagram(problem: Problem, *, results: Sequence[StageResult] = ()) -> Figure:
    """Figure of the optimisation of a campaign.

    Parameters
    ----------
    problem : Problem
    results : sequence of StageResult
        Of an identification: criterion before and after stand in the boxes of the stages.
    """
    places = columns_of_stages(problem.stages)
    columns = 1 + max(column for column, _ in places.values()) + (problem.joint is not None)
    width = min((WIDTH_IN - 0.04 - _OPTIMISATION_DIAGRAM_GAP_IN * (columns - 1)) / columns, _WIDEST_IN)
    named = max(len(_wrapped(stage.name, width)) for stage in problem.stages)
    pitch = (width, 0.56 + 0.165 * named + 0.125 * bool(results))
    lanes = 1 + math.ceil(max(lane for _, lane in places.values()))
    height = _LOOP_IN + pitch[1] * lanes + 0.24
    with house_style():
        figure, axes = page(WIDTH_IN, height)
        phases = {step.phase for one in results for step in one.history} or {"evolution", "simplex"}
        _loop(axes, problem, height, phases)
        _stages(axes, problem, places, pitch, {one.name: one for one in results})
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


def _loop(axes: Axes, problem: Problem, height: float, phases: set[str]) -> None:
    """Vehicle and model side by side, criterion, search, and back to the model."""
    high, low, foot = height - 0.42, height - 1.18, height - 1.98
    middle = 0.5 * (high + low)
    trials = [name for name in problem.trials if any(name in stage.trials for stage in problem.stages)]
    named = textwrap.shorten(", ".join(trials), 34, placeholder=" \N{HORIZONTAL ELLIPSIS}")
    vehicle = block(axes, (1.95, high), (1.75, 0.5), f"vehicle {problem.vehicle.name}", [named])
    model = block(axes, (1.95, low), (1.75, 0.5), "model", ["6 degrees of freedom, actuators"])
    circle = summing(axes, (3.35, middle))
    criterion = block(
        axes,
        (4.88, middle),
        (1.95, 0.6),
        r"$Q = \Sigma_c W_c \,\Sigma_i \,\ell(e_{ci} / s_c) \;/\; \Sigma_c W_c N_c$",
        _losses(problem),
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


def _losses(problem: Problem) -> list[str]:
    losses = dict.fromkeys(
        f"Huber (knee {number(stage.knee)})" if stage.loss == "huber" else stage.loss
        for stage in problem.stages
    )
    return [rf"$\ell$: {' or '.join(losses)} error", "$s_c$: standard deviation of the channel"]


def _stages(
    axes: Axes,
    problem: Problem,
    places: Mapping[str, tuple[int, float]],
    size: tuple[float, float],
    results: Mapping[str, StageResult],
) -> None:
    """Boxes of the stages and of the joint estimate, with the arrows between them."""
    polished = problem.joint is not None
    last = max(column for column, _ in places.values())
    width, lane_in = size
    lanes = 1 + math.ceil(max(lane for _, lane in places.values()))
    top = lane_in * lanes + 0.08

    def centre(column: int, lane: float) -> tuple[float, float]:
        return 0.02 + 0.5 * width + (width + _OPTIMISATION_DIAGRAM_GAP_IN) * column, top - lane_in * (
            lane + 0.5
        )

    words(
        axes,
        (0.02, top + 0.1),
        "stages run from left to right, those in one column side by side",
        size_pt=7,
        ha="left",
    )
    boxes: dict[str, Block] = {}
    for stage in problem.stages:
        at = centre(*places[stage.name])
        boxes[stage.name] = _stage_box(axes, stage, at, (width, lane_in - 0.14), results.get(stage.name))
    for stage in problem.stages:
        sources = sorted(stage.after, key=lambda name: places[name][1])
        for number_, name in enumerate(sources):
            over = _occupied(places, places[name], places[stage.name][0])
            offset = -0.14 * (number_ - 0.5 * (len(sources) - 1))
            _arrow(axes, boxes[name], boxes[stage.name], offset=offset, detour=over)
    if not polished:
        return
    joint = block(
        axes, centre(last + 1, 0.5 * (lanes - 1)), (width, max(lane_in - 0.14, 0.7)), "joint estimate",
        ["all coefficients and trials,", "Gauss\N{EN DASH}Newton,", "standard deviations"], bold=True,
    )  # fmt: skip
    ends = [s.name for s in problem.stages if not any(s.name in other.after for other in problem.stages)]
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
    bend = x - 0.55 * _OPTIMISATION_DIAGRAM_GAP_IN
    start = source.right
    if detour:
        between = source.y - 0.5 * source.height - 0.07
        knee = start[0] + 0.3 * _OPTIMISATION_DIAGRAM_GAP_IN
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
