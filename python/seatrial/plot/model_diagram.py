"""Block diagram of the model: the equation of motion with the terms that a vehicle has.

``M nu' = tau - C_RB(nu) nu - C_A(nu_r) nu_r + M_A nu_c' - D(nu_r) nu_r + tau_L(nu_r) - g(eta)``, solved for
the free axes, and the kinematics (Taubert et al. 2014, figure 3 and equations 4 to 7 with the signs of the
errata page; Fossen 2011, equation 7.9). A term without a coefficient is dashed. Held by
`tests/test_vehicle_figures.py`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.campaign_file import AXES
from seatrial.parameters import VELOCITIES
from seatrial.plot.diagram import bar, block, connect, dot, page, summing, words
from seatrial.plot.style import WIDTH_IN, house_style
from seatrial.plot.symbols import number, symbol

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial._core import Vehicle
    from seatrial.plot.diagram import Block

__all__ = ["model_diagram", "terms"]

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
                f"{word}: {names}" for word, names in (("linear", linear), ("quadratic", quadratic)) if names
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
