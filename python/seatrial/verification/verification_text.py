"""A verification in words: verdicts, causes, worst missions, comparison, time.

Tests: ``tests/test_verify.py``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from seatrial.verification.failure_probability import share

if TYPE_CHECKING:
    from seatrial.verification.comparison_of_autopilots import AutopilotComparison
    from seatrial.verification.judged_requirement import JudgedRequirement
    from seatrial.verification.verification_result import Verification

__all__ = [
    "again",
    "comparison_lines",
    "headline",
    "requirement_lines",
    "reserve",
    "summary",
    "time_sentence",
]

_CAUSES = 4


def summary(found: Verification) -> str:
    """Text that a control engineer reads."""
    lines = [headline(found), ""]
    for one in found.requirements:
        lines += [*requirement_lines(one), ""]
    if found.comparison is not None:
        lines += [*comparison_lines(found.comparison), ""]
    lines.append(again(found))
    lines.append(time_sentence(found))
    lines += ["", *(f"- {note}" for note in (*found.notes, *found.flights.left_out))]
    return "\n".join(lines)


def headline(found: Verification) -> str:
    """The verdict in a line."""
    flights, flown = found.flights, len(found.flown)
    missions = ", ".join(flights.titles)
    counted = f"{flown} missions" if flown == found.asked else f"{flown} of {found.asked} missions"
    cut = " (interrupted)" if found.interrupted else ""
    return (
        f"{found.verdict.upper()}{cut}: autopilot {flights.autopilot.name} on {flights.fitted.vehicle.name},"
        f" {counted} of {missions}, seed {flights.seed}"
    )


def requirement_lines(one: JudgedRequirement) -> list[str]:
    """Verdict, interval, causes and worst missions of a requirement."""
    asked = one.requirement
    lines = [
        f"{asked.name}: {asked.holds}, in at least {share(asked.probability)} of the missions",
        f"  {one.sentence}",
        f"  {one.found}",
    ]
    if len(one.by_mission) > 1:
        apart = (f"{name} {part.failures} of {part.runs}" for name, part in one.by_mission.items())
        lines.append(f"  failures by mission: {', '.join(apart)}")
    lines += [f"  {cause}" for cause in one.named_causes[:_CAUSES]]
    if one.found.failures and not one.named_causes:
        lines.append("  nothing that was drawn is shown to drive the failures")
    if one.worst:
        unit = one.judgement.unit
        numbers = ", ".join(f"{run.number} ({reserve(run.reserve, unit)})" for run in one.worst)
        lines.append(f"  least reserve in missions {numbers}")
    return lines


def comparison_lines(found: AutopilotComparison) -> list[str]:
    """Autopilots on the same draws, a line per requirement and other autopilot."""
    verified, *others = found.autopilots
    lines = [f"On the same {found.runs} draws:"]
    for other in others:
        for name, failures in verified.failures.items():
            pair = found.pair(name, other.name)
            lines.append(
                f"  {name}: {failures.failures} failures, with {other.name} {other.failures[name].failures};"
                f" only verified failed {pair.only_verified}, only {other.name} {pair.only_other};"
                f" {pair.words} (p = {pair.corrected:.2g})"
            )
        figures = (
            f"{figure} {_figure(value)} against {_figure(other.figures[figure])}"
            for figure, value in verified.figures.items()
        )
        lines.append(f"  medians, verified against {other.name}: {', '.join(figures)}")
    return lines


def again(found: Verification) -> str:
    """How to fly a mission again."""
    return (
        f"Any mission flies again by its number: seatrial verify {found.campaign.source} --replay NUMBER"
        " (with the same --run, --autopilot and --mission), or verification.replay(NUMBER)."
    )


def time_sentence(found: Verification) -> str:
    """How much was flown in which time."""
    flown = found.flown
    return (
        f"{_size(flown.flown_s / 3600.0)} h were flown in {_size(flown.wall_s)} s:"
        f" {flown.per_second:,.0f} missions per second, {flown.real_time_factor:,.0f} times real time."
    )


def reserve(value: float, unit: str) -> str:
    """A reserve with its sign and unit; in words where it has no size."""
    if math.isinf(value):
        return "failed" if value < 0.0 else "held"
    return f"{value:+.2g} {unit}".rstrip().replace("-", "\N{MINUS SIGN}")


def _size(value: float) -> str:
    return f"{value:,.1f}" if value >= 1.0 else f"{value:.2g}"


def _figure(value: float) -> str:
    return "none" if math.isnan(value) else f"{value:.3g}"
