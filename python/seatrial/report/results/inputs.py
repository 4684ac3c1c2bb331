"""The words of a judgement of inputs: what is driven, what moves only together, which gains may be freed.

Held by ``tests/estimation/test_inputs.py``.
"""

from __future__ import annotations

from collections.abc import Iterable

from seatrial.base.report import listed
from seatrial.estimation.inputs import Combination, Dependence, InputJudgement


def sentences(judged: InputJudgement) -> list[str]:
    """What the inputs tell, for a control engineer."""
    return [*_thrusts(judged), *_gains(judged), *_rows(judged)] or [
        "No input changes in the data that are fitted: only free decays and drift can be identified"
    ]


def combination(row: Combination) -> str:
    """A combination as it is written: ``a - b + 0.5 c``."""
    text = ""
    for i, (name, factor) in enumerate(row.parts):
        size = "" if abs(abs(factor) - 1.0) < 0.05 else f"{abs(factor):.2g} "
        sign = "-" if factor < 0.0 else "" if i == 0 else "+"
        text += f"{sign}{size}{name}" if i == 0 else f" {sign} {size}{name}"
    return text


def dependence(signals: Dependence) -> list[str]:
    """Signals that move only together, and combinations of three and more that are hardly driven."""
    texts = [
        f"{', '.join(name for name, _ in family)} move only together:"
        f" {' '.join(_proportion(factor) for _, factor in family)}"
        for family in signals.families
    ]
    return texts + [
        f"Hardly driven: {row.words} ({_share(row.strength)} of what they would give independently)"
        for row in signals.combinations
        if len(row.parts) != 2
    ]


def _thrusts(judged: InputJudgement) -> list[str]:
    """How many combinations of thrusts are driven, and what hardly changes."""
    if not judged.drives:
        return []
    driven = len(judged.thrusts.singular_values) - judged.thrusts.lost
    what = "Thrust and fins" if judged.fins else "Thrust"
    texts = [
        f"{what}: {len(judged.drives)} actuators, {driven} independent combinations driven"
        f" (singular values {', '.join(_rounded(x) for x in judged.thrusts.singular_values)})"
    ]
    if judged.thrusts.still:
        kinds: dict[str, list[str]] = {"thrust": [], "lift": []}
        for name in judged.thrusts.still:
            kinds["lift" if name in judged.fins else "thrust"].append(name)
        texts += [f"The {what} of {listed(names)} hardly changes" for what, names in kinds.items() if names]
    return texts + judged.thrusts.sentences()


def _gains(judged: InputJudgement) -> list[str]:
    """Which gains the inputs cannot separate, and which may be freed."""
    texts: list[str] = []
    lost = judged.thrusts.involved
    if lost:
        fins = [name for name in lost if name in judged.fins]
        single = "lifts" if len(fins) == len(lost) else "thrusts and lifts" if fins else "thrust gains"
        texts.append(
            f"These inputs cannot separate the {single} of {listed(lost)}: their effects differ only in"
            " axis coupling, which offset centres, levers and off-diagonal damping also cause"
        )
    if judged.offered:
        axis = next((o for o in judged.options if o.kind == "axis" and o.told_apart and lost), None)
        texts.append(
            f"Gains that may be freed, except those that set the scale: {_keys(judged.offered)}"
            + (f"; or per axis, levers with relative bounds: {_keys(axis.names)}" if axis else "")
        )
    if judged.freed:
        texts.append(
            f"The campaign frees {_keys(judged.freed)} one by one: expect wide standard deviations,"
            " or free the group's gain"
        )
    return texts


def _rows(judged: InputJudgement) -> list[str]:
    """How much every row of the wrench is driven."""
    rows = ", ".join(
        f"{row} {rms:.2g} {'N' if row in 'XYZ' else 'N m'}"
        for row, rms in judged.rows_rms.items()
        if row not in judged.rows.still
    )
    if not rows:
        return []
    still = f"; hardly driven: {listed(judged.rows.still)}" if judged.rows.still else ""
    together = [
        f"{listed([name for name, _ in combination.parts])} of the wrench move only together"
        for combination in judged.rows.combinations
    ]
    return [f"Wrench, root mean square: {rows}{still}", *together]


def _proportion(factor: float) -> str:
    return f"{round(factor):+d}" if abs(abs(factor) - 1.0) < 0.05 else f"{factor:+.2g}"


def _share(strength: float) -> str:
    return f"{100.0 * strength:.1g} %" if strength >= 5e-4 else "less than 0.05 %"


def _rounded(value: float) -> str:
    return f"{value:.2g}" if value >= 1e-4 else "0"


def _keys(names: Iterable[str]) -> str:
    return ", ".join(f'"{name}"' for name in names)
