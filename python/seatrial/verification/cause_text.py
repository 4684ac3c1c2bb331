"""A cause in a sentence, in plain words.

Held by `tests/test_causes.py`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from seatrial.verification.failure_probability import share

if TYPE_CHECKING:
    from seatrial.verification.influence import Influence

__all__ = ["odds", "sentence"]


def sentence(cause: Influence) -> str:
    """What a cause has to do with the failures; of one that is not named, that it is not shown to."""
    if not cause.named:
        return f"{cause.label} is not shown to matter (corrected p {cause.corrected:.2g})"
    if cause.by_failures:
        return {"number": _number, "direction": _direction, "category": _category}[cause.kind](cause)
    return f"too few failures to compare, but {_by_reserve(cause)}"


def odds(ratio: float) -> str:
    """An odds ratio with two digits and no power of ten.

    Examples
    --------
    >>> odds(1024.0), odds(0.098)
    ('1,000', '0.098')
    """
    return f"{float(f'{ratio:.2g}'):,.6g}"


def _number(cause: Influence) -> str:
    rates = cause.groups.rates
    unit = f" {cause.unit}" if cause.unit and cause.unit != "1" else ""
    if cause.where:
        side = "far from" if cause.where == "both ends" else "close to"
        fifths = (
            f"; {share(rates[0])} of the missions fail in its lowest fifth, {share(rates[2])} in the middle"
            f" one, {share(rates[-1])} in its highest"
            if len(rates) == 5
            else ""
        )
        return (
            f"failures go with {cause.name} {side} its median: {cause.failed:.3g}{unit} away on average"
            f" against {cause.held:.3g}{unit}; AUC of that distance {cause.auc:.2f}{fifths}"
        )
    fifths = (
        f"; {share(rates[0])} of the missions fail in its lowest fifth, {share(rates[-1])} in its highest"
        if len(rates) == 5
        else ""
    )
    return (
        f"failures go with {cause.name}: {cause.failed:.3g}{unit} on average against {cause.held:.3g}{unit};"
        f" AUC {cause.auc:.2f}{fifths}"
    )


def _direction(cause: Influence) -> str:
    groups = cause.groups
    rated = [(rate, label) for rate, label in zip(groups.rates, groups.labels, strict=True) if rate == rate]
    return (
        f"failures go with {cause.name}: mostly about {math.degrees(cause.failed):.0f}\N{DEGREE SIGN} from"
        f" north; AUC {cause.auc:.2f}; {share(max(rated)[0])} of the missions fail towards {max(rated)[1]},"
        f" {share(min(rated)[0])} towards {min(rated)[1]}"
    )


def _category(cause: Influence) -> str:
    groups = cause.groups
    place = groups.labels.index(cause.category)
    runs, failures = groups.runs[place], groups.failures[place]
    others = sum(groups.failures) - failures, sum(groups.runs) - runs
    rate, without = failures / runs, others[0] / max(others[1], 1)
    ratio = f"; odds ratio {odds(cause.odds)}" if 0.0 < cause.odds < math.inf else ""
    which = "with" if rate >= without else "without"
    named = cause.name if cause.label == cause.name else f"{cause.name} {cause.category}"
    return (
        f"failures go {which} {named}: {failures} of {runs} missions with it fail ({share(rate)}),"
        f" {others[0]} of {others[1]} without it ({share(without)}){ratio}"
    )


def _by_reserve(cause: Influence) -> str:
    if cause.kind == "direction":
        return f"the reserve varies with {cause.name} (circular rank correlation {cause.correlation:.2f})"
    verb = "shrinks" if cause.correlation < 0.0 else "grows"
    if cause.kind == "category":
        return (
            f"the reserve {verb} with {cause.label.replace(': ', ' ')} (smaller than without it in"
            f" {share(0.5 * (1.0 - cause.correlation))} of the pairs)"
        )
    size = f"{cause.correlation:+.2f}".replace("-", "\N{MINUS SIGN}")
    what = f"the distance of {cause.name} from its median" if cause.where else cause.name
    return f"the reserve {verb} with {what} (Spearman's rank correlation {size})"
