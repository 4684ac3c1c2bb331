"""The words of what is known before a search: what inputs drive, what the scale of forces rests on, draws.

Held by ``tests/estimation/test_inputs.py``, ``tests/estimation/test_anchor.py``,
``tests/check/test_check_campaign.py`` and ``tests/identification/test_coefficient_covariance.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import singledispatch

from seatrial.base.channels import MOTIONS
from seatrial.base.report import listed
from seatrial.estimation.inputs import Combination, Dependence, InputJudgement
from seatrial.estimation.scale import (
    LIFT,
    SCALE_SETTINGS,
    STATIC,
    THRUST,
    Factor,
    Homogeneity,
    Implied,
    ScaleReport,
)
from seatrial.report.results.phrases import Phrases

sentence = Phrases(
    "preparation",
    "sentence",
    {
        "example": lambda names: next((name for name in names if "." in name), names[0]),
        "motion": MOTIONS.__getitem__,
        "rests on": lambda direction: rests_on(direction),
        "root": lambda names: f"{math.sqrt(len(names)):.2g}",
        "size": lambda names: str(len(names)),
    },
)
"""A finding before the search, or about draws, in words."""


@singledispatch
def sentences(judged: object) -> list[str]:
    """What inputs tell, or what the scale rests on, for a control engineer."""
    raise TypeError(f"expected a judgement of inputs or of the scale, found {type(judged).__name__}")


@sentences.register
def _of_inputs(judged: InputJudgement) -> list[str]:
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


@sentences.register
def _of_scale(report: ScaleReport) -> list[str]:
    """What the scale rests on, what the anchors imply; where there is none, a request for one."""
    texts = homogeneity(report.homogeneity)
    for known in report.implied:
        texts += implied(known, identified=report.identified)
    texts += _agreement(report)
    if report.waiting:
        texts.append(f"Judged after the identification: {', '.join(report.waiting)}")
    if report.tested:
        texts.append(
            f"The bench test measured the thrust of {', '.join(report.tested)} on a load cell: an absolute"
            " anchor, as good as that cell"
        )
    elif not report.implied and not report.waiting:
        texts.append(
            "No absolute anchor is given; only ratios are known. Give one under [anchor]: bollard (a pull at"
            " rest under known commands), ballast (a known weight, and the sink rate, angle or commands that"
            " it causes) or dry_mass (with an assumed added mass)"
        )
    if report.ratios:
        values = ", ".join(f"{name} {value:.4g}" for name, value in report.ratios.items())
        texts.append(f"Divided by the thrust gain, for any scale: {values}")
    return texts


def _agreement(report: ScaleReport) -> list[str]:
    """Whether several anchors agree."""
    values = " and ".join(f"{factor.anchor.lower()} {factor.value:.2g}" for factor in report.factors)
    if report.agreement is None:
        return []
    if report.agreement:
        return [f"The anchors agree: {values}"]
    return [f"WARNING the anchors disagree: {values}; one of them, or what it assumes, is wrong"]


def homogeneity(direction: Homogeneity) -> list[str]:
    """Name of the homogeneous direction, and what the scale rests on."""
    texts = [
        "Scaling mass, added mass, damping, lift, weight in water, bias and thrust together changes no"
        " motion: trials give ratios, and held values set the scale"
    ]
    if not direction.strong:
        static = next(
            (direction_held for direction_held in direction.held if direction_held.kind == STATIC), None
        )
        weak = "" if static is None else f" but {', '.join(static.members)}, which tell little"
        return [
            *texts,
            f"Nothing is held fixed{weak}: all estimates may grow or shrink together until one reaches a"
            " bound. Hold a thrust gain, or mass and added mass of one axis",
        ]
    texts.append(rests_on(direction))
    others = list(direction.strong.items())[1:]
    if beside := [f"lift of {members}" if kind == LIFT else members for kind, members in others]:
        texts.append(
            f"Also held at the vehicle file's values: {'; '.join(beside)}. If the scale is wrong, so is their"
            " ratio to the other terms: free or rescale them"
        )
    return texts


def rests_on(direction: Homogeneity) -> str:
    """What the scale rests on, where something is held that sets it."""
    kind, members = next(iter(direction.strong.items()))
    made = {THRUST: "thrust", LIFT: "lift"}.get(kind)
    return f"The scale rests on {f'the {made} of {members} as in the vehicle file' if made else members}"


def implied(known: Implied, *, identified: bool = True) -> list[str]:
    """The factor, what follows from it, what cannot be; before an identification of the thrust alone."""
    factor = known.factor
    texts = [f"{factor.anchor} ({factor.assumption}): {_factor(factor, identified)}"]
    if not identified:
        return texts + [f"WARNING {text}" for text in _odd_thrust(known)]
    if math.isfinite(factor.value):
        gains = ", ".join(f"{name} {gain:.2g}" for name, gain in known.gains.items())
        added = ", ".join(f"{motion} {mass:.3g}" for motion, mass in known.added_kg.items())
        side = "below" if known.centre_height_m > 0.0 else "above"
        texts.append(
            f"It implies thrust gains {gains or '(no thruster)'}; added mass {added} kg beside"
            f" {known.mass_kg:.4g} kg; net weight {known.net_weight_n:+.2g} N; centre of gravity"
            f" {1e3 * abs(known.centre_height_m):.3g} mm {side} that of buoyancy (vehicle file:"
            f" {1e3 * known.file_height_m:.3g} mm)"
        )
    return texts + [f"WARNING {text}" for text in warnings(known)]


def _factor(factor: Factor, identified: bool) -> str:
    """True over identified forces, with the range where one is known."""
    if not math.isfinite(factor.value):
        return "no factor"
    size = f"{factor.value:.2g}"
    if factor.upper > factor.lower:
        size += f" ({factor.lower:.2g} to {factor.upper:.2g})"
    if identified:
        return f"true forces are {size} of the identified"
    return f"true thrust is {size} of the file's"


def warnings(known: Implied) -> list[str]:
    """What cannot be, by an anchor."""
    if not math.isfinite(known.factor.value):
        return ["the anchor contradicts the vehicle: its answer has the other sign; check its signs"]
    texts = [
        f"added mass in {motion} would be {mass:.3g} kg, negative: anchor or apparent mass is wrong"
        for motion, mass in known.added_kg.items()
        if mass < 0.0
    ]
    texts += _odd_thrust(known)
    if known.centre_height_m <= 0.0:
        texts.append("the centre of gravity would lie above the centre of buoyancy: check z_g, z_b, B")
    if known.heavy:
        share = 100.0 * known.net_weight_n / (known.mass_kg * known.g)
        texts.append(f"net weight would be {share:+.2g} % of the weight: check B and m")
    return texts


def _odd_thrust(known: Implied) -> list[str]:
    """Gains that no bollard table is wrong by."""
    if not known.odd_gains:
        return []
    least, most = SCALE_SETTINGS.gains
    odd = ", ".join(f"{name} {gain:.2g}" for name, gain in known.odd_gains.items())
    return [
        f"thrust gains outside {least:g} to {most:g}: {odd}; check characteristic, supply voltage and anchor"
    ]
