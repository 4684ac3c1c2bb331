"""A cause in a sentence, in plain words.

Held by `tests/test_causes.py`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from seatrial.verification.failure_probability import share

if TYPE_CHECKING:
    from seatrial.verification.causes import Influence

__all__ = ["sentence"]


def sentence(cause: Influence) -> str:
    """What a cause has to do with the failures; of one that is not named, that it is not shown to."""
    if not cause.named:
        return f"{cause.label} is not shown to matter (corrected p {cause.corrected:.2g})"
    if cause.by_failures:
        words = {"number": _number, "direction": _direction, "category": _category}[cause.kind](cause)
        return f"failures go with {words}"
    return f"too few failures to compare, but {_by_reserve(cause)}"


def _number(cause: Influence) -> str:
    rates = cause.groups.rates
    unit = f" {cause.unit}" if cause.unit and cause.unit != "1" else ""
    fifths = (
        f"; {share(rates[0])} of the missions fail in its lowest fifth, {share(rates[-1])} in its highest"
        if len(rates) == 5
        else ""
    )
    return (
        f"{cause.name}: {cause.failed:.3g}{unit} on average against {cause.held:.3g}{unit};"
        f" AUC {cause.auc:.2f}{fifths}"
    )


def _direction(cause: Influence) -> str:
    groups = cause.groups
    rated = [(rate, label) for rate, label in zip(groups.rates, groups.labels, strict=True) if rate == rate]
    return (
        f"{cause.name}: mostly about {math.degrees(cause.failed):.0f}\N{DEGREE SIGN}; AUC {cause.auc:.2f};"
        f" {share(max(rated)[0])} of the missions fail towards {max(rated)[1]},"
        f" {share(min(rated)[0])} towards {min(rated)[1]}"
    )


def _category(cause: Influence) -> str:
    groups = cause.groups
    place = groups.labels.index(cause.category)
    runs, failures = groups.runs[place], groups.failures[place]
    others = sum(groups.failures) - failures, sum(groups.runs) - runs
    rate, without = failures / runs, others[0] / max(others[1], 1)
    ratio = f"; odds ratio {cause.odds:.3g}" if math.isfinite(cause.odds) else ""
    which = "with" if rate >= without else "without"
    named = (
        cause.name
        if cause.label == cause.name and which == "with"
        else f"{cause.name}, {which} {cause.category}"
    )
    return (
        f"{named}: {failures} of {runs} missions"
        f" with it fail ({share(rate)}), {others[0]} of {others[1]} without it ({share(without)}){ratio}"
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
    return f"the reserve {verb} with {cause.name} (Spearman's rank correlation {size})"
