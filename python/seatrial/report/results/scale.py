"""The words of the scale of all forces: what it rests on, what anchors imply for it, what cannot be.

Held by ``tests/estimation/test_anchor.py``.
"""

from __future__ import annotations

import math

from seatrial.estimation.homogeneity import LIFT, STATIC, THRUST, Homogeneity
from seatrial.estimation.scale import SCALE_SETTINGS, Factor, Implied, ScaleReport


def sentences(report: ScaleReport) -> list[str]:
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
