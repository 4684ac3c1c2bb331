"""What a verification finds, in words: verdicts on requirements, causes of failures, and notes.

Held by ``tests/verification/test_causes.py``, ``tests/statistics/test_failure_probability.py`` and
``tests/verification/test_verification_messages.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from seatrial.base.finding import Finding
from seatrial.statistics.proportions import FailureProbability, further_runs, runs_needed, share
from seatrial.verification.causes import Influence
from seatrial.verification.judgement import JudgedRequirement


def problem(what: Finding | Influence | JudgedRequirement) -> str:
    """A note as a sentence; a cause, or the verdict on a requirement, as a clause."""
    if isinstance(what, Influence):
        return _influence(what)
    if isinstance(what, JudgedRequirement):
        return verdict(what.found, what.requirement.allowed)
    return _NOTES[what.kind](what)


def verdict(found: FailureProbability, allowed: float) -> str:
    """The verdict on a failure probability against what is allowed, with what it rests on.

    Examples
    --------
    >>> print(verdict(FailureProbability(0, 100), 0.01))
    undecided: at most 3 % of the missions fail (95 % confidence), 1 % is allowed;
    268 more missions without a failure would suffice at 97.5 %
    (half the risk, because it is a second look)
    """
    state, sure = found.verdict(allowed), f"({100.0 * found.confidence:g} % confidence)"
    limit = f"{share(allowed)} is allowed"
    if state == "failed":
        return f"failed: at least {share(found.at_least, 'down')} of the missions fail {sure}, {limit}"
    bound = f"{state}: at most {share(found.at_most, 'up')} of the missions fail {sure}, {limit}"
    if state == "held":
        return bound
    again = found.looked_at_again
    careful = f"at {100.0 * again.confidence:.6g} % (half the risk, because it is a second look)"
    if found.failures == 0:
        more = runs_needed(allowed, confidence=again.confidence) - found.runs
        missions = "mission" if more == 1 else "missions"
        return f"{bound}; {more} more {missions} without a failure would suffice {careful}"
    about = further_runs(found, allowed)
    if about is None:
        return f"{bound}; the share is so close to it that a billion missions may not decide it"
    return f"{bound}; about {_rounded(about)} more missions will probably decide it {careful}"


def _rounded(number: int) -> int:
    """To two figures upwards, as is meant by "about"."""
    step = int(10 ** max(0, len(str(number)) - 2))
    return -(-number // step) * step


def _no_requirements(finding: Finding) -> str:
    holds, off = finding["holds"], finding["position_sd_m"]
    listed = "; ".join(f"{name}: {expression}" for name, expression in holds.items())
    text = f"The campaign states no requirements; these are judged, each in 95 % of the missions: {listed}."
    if not off:
        return text
    return f"{text} The path allows for a position that is off by {off:.2g} m (1 sd) on each axis."


def _out_of_time(finding: Finding) -> str:
    given = finding["max_time_s"]
    limit = "the longest time allowed" if given is None else f"max_time_s = {given:g}"
    return (
        f"{finding['count']} of {finding['of']} missions end out of time, by {limit}; flying them is planned"
        f" to take {finding['planned_s']:.0f} s."
    )


def _perceived(finding: Finding) -> str:
    asked = [f'"{name}"' for name in finding["requirements"]]
    who = f" (which {' and '.join(asked)} ask{'s' if len(asked) == 1 else ''} for)" if asked else ""
    return (
        "Errors that guidance perceived, from what its sensors told it, are cross_track_…, vertical_… and"
        f" missed_by_m{who}; true_cross_track_…, clearance, depths, altitude and attitude are of the vehicle"
        f" itself. Cross-track p95, median of the missions: {finding['perceived_m']:.2g} m perceived,"
        f" {finding['true_m']:.2g} m true."
    )


_MISSING = {
    "altitude_smallest_m": "there is no bottom; add seabed under [verification]",
    **dict.fromkeys(
        ("clearance_m", "clearance_reserve_m"),
        "nothing stands in the water; add [[obstacles]] to the mission",
    ),
}
"""Why a metric is infinite, and what to do."""

_NOTES: dict[str, Callable[[Finding], str]] = {
    "told": lambda f: str(f["sentence"]),
    "supply without effect": lambda f: (
        f"voltage_v = {f['voltage_v']:g} under [verification] does nothing: no thrust of {f.subject} depends"
        " on the supply voltage."
    ),
    "navigation filter": lambda _: (
        "The autopilot goes by the estimate of a navigation filter on the vehicle that it believes in; the"
        " filter assumes the mid-range of the drawn gusts and seas."
    ),
    "covariance unknown": lambda _: (
        "Every vehicle flies with the same coefficients, because their covariance is unknown."
    ),
    "no requirements": _no_requirements,
    "out of time": _out_of_time,
    "mission too fast": lambda f: (
        f"{f.subject} asks for {f['asked_m_s']:g} m/s, more than the top speed of {f['vehicle']},"
        f" {f['top_m_s']:.2f} m/s."
    ),
    "current too fast": lambda f: (
        f"In {f['count']} of {f['of']} missions the current is faster than the top speed of {f['vehicle']},"
        f" {f['top_m_s']:.2f} m/s."
    ),
    "metric unknown": lambda f: (
        f'"{f.subject}" asks for {f["metric"]}, which no mission has, so the requirement always fails.'
    ),
    "metric infinite": lambda f: (
        f'"{f.subject}" asks for {f["metric"]}, and {_MISSING[f["metric"]]}: as it is, the metric is'
        " infinite in all missions and shows nothing."
    ),
    "errors perceived": _perceived,
}


def _influence(cause: Influence) -> str:
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
            f"failures go with {cause.name} {side} its median: mean distance {cause.failed:.3g}{unit} in"
            f" failures, {cause.held:.3g}{unit} otherwise; AUC of that distance {cause.auc:.2f}{fifths}"
        )
    fifths = (
        f"; {share(rates[0])} of the missions fail in its lowest fifth, {share(rates[-1])} in its highest"
        if len(rates) == 5
        else ""
    )
    return (
        f"failures go with {cause.name}: mean {cause.failed:.3g}{unit} in failures, {cause.held:.3g}{unit}"
        f" otherwise; AUC {cause.auc:.2f}{fifths}"
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
        return f"the robustness varies with {cause.name} (circular rank correlation {cause.correlation:.2f})"
    verb = "shrinks" if cause.correlation < 0.0 else "grows"
    if cause.kind == "category":
        return (
            f"the robustness {verb} with {cause.label.replace(': ', ' ')} (smaller than without it in"
            f" {share(0.5 * (1.0 - cause.correlation))} of the pairs)"
        )
    size = f"{cause.correlation:+.2f}".replace("-", "\N{MINUS SIGN}")
    what = f"the distance of {cause.name} from its median" if cause.where else cause.name
    return f"the robustness {verb} with {what} (Spearman's rank correlation {size})"
