"""The words of surveys of missions beside a verification: rare failures, the worst missions, boundaries.

Held by ``tests/verification/test_rare.py``, ``tests/verification/test_falsify.py`` and
``tests/verification/test_boundary.py``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import singledispatch

from seatrial.base.finding import Finding
from seatrial.base.report import Report, Section, Table
from seatrial.report.results.flight_findings import doubting
from seatrial.statistics.failure_probability import share
from seatrial.verification.boundary import FailureBoundary, RequirementBoundary
from seatrial.verification.falsify import Falsification, FalsifiedRequirement
from seatrial.verification.rare import SETTINGS as RARE_SETTINGS
from seatrial.verification.rare import RareFailures, RareRequirement


@dataclass(frozen=True)
class SurveyWordsSettings:
    """How much of a survey is listed."""

    shown: int = 5  #: Common causes of failures.
    shifted: float = 0.8  #: A cause counts from this shift on, standard deviations.
    named: int = 6  #: Values of the middle.


SETTINGS = SurveyWordsSettings()


@singledispatch
def report(result: object) -> Report:
    """Report of a survey."""
    raise TypeError(f"expected a survey of missions, found {type(result).__name__}")


def _unusable(finding: Finding) -> tuple[str, str]:
    """Why the robustness of a requirement ranks no missions, and what to do about it."""
    name, holds = finding.subject, finding["holds"]
    if finding.kind == "no distance":
        return (
            f'"{name}" has no usable robustness: {holds} is held or not, without a distance',
            "add a number that comes near its limit before it fails, for example a clearance, a depth or a"
            " cross-track error",
        )
    return (
        f'"{name}" has no usable robustness: half of a level\'s missions share one value',
        f"{holds} needs a number that falls on the way to a failure",
    )


def _not_judged(requirements: Sequence[RareRequirement | FalsifiedRequirement]) -> tuple[str, ...]:
    return tuple("; ".join(_unusable(entry.why_not)) for entry in requirements if entry.why_not is not None)


@report.register
def _rare(result: RareFailures) -> Report:
    """Three lines, a table of the requirements, the likeliest failing missions."""
    judged = [entry for entry in result.requirements if entry.event is not None]
    count = sum(entry.verdict == "held" for entry in result.requirements)
    spent = sum(entry.event.evaluations for entry in judged if entry.event is not None)
    worst, next_step = doubting(result.scenario.flights, *_worst_of_rare(result))
    return Report(
        title=result.scenario.name,
        outcome=result.outcome + (" (interrupted)" if result.interrupted else ""),
        good=(
            f"{count} of {len(result.requirements)} requirements held by"
            f" {result.scenario.flights.autopilot.name} on {result.scenario.flights.fitted.vehicle.name};"
            f" {spent} missions flown"
        ),
        worst=worst,
        next_step=next_step,
        sections=(
            Section(tables=(_rare_table(result.requirements),)),
            *(
                Section(f"Failures of: {entry.requirement.name}", tuple(_drawn(entry)))
                for entry in judged
                if entry.likeliest
            ),
            Section("Not judged", _not_judged(result.requirements)),
            Section(
                "Notes",
                (
                    "The probability is that of the distributions in [verification] and of the"
                    " covariance; it is no surer than these.",
                    *result.scenario.notes,
                    *result.scenario.flights.left_out,
                ),
                details=True,
            ),
        ),
    )


def _worst_of_rare(survey: RareFailures) -> tuple[str, str]:
    """The worst problem, and what to do about it."""
    again = f"seatrial rare {survey.scenario.source}"
    if survey.interrupted:
        return "Ctrl-C ended it early", "run the same command again; finished populations are kept"
    judged = [(entry, entry.event) for entry in survey.requirements if entry.event is not None]
    apart = [entry for entry, event in judged if event.agrees is False]
    if apart:
        return (
            f"{apart[0].requirement.name}: importance sampling about the failures disagrees: failures"
            " of another kind may be missing",
            f"fly larger populations: {again} --population {2 * RARE_SETTINGS.population}",
        )
    failing = [(entry, event) for entry, event in judged if entry.verdict != "held" and event.estimate > 0.0]
    if failing:
        entry, event = max(failing, key=lambda pair: pair[1].estimate / pair[0].requirement.allowed)
        return (
            f"{entry.requirement.name} fails in {event.estimate:.2g} of the missions"
            f" ({event.interval[0]:.2g} to {event.interval[1]:.2g}); {entry.requirement.allowed:.2g} is"
            " allowed",
            "see below what its failures have in common, then change that or tune",
        )
    if reasons := [each.why_not for each in survey.requirements if each.why_not is not None]:
        return _unusable(reasons[0])
    if not judged:
        return "no requirement was judged", "state requirements in the campaign"
    entry, event = max(judged, key=lambda pair: pair[1].interval[1])
    if entry.verdict != "held":
        return (
            f"{entry.requirement.name}: at most {event.interval[1]:.2g} of the missions fail, more than the"
            f" {entry.requirement.allowed:.2g} that are allowed",
            f"fly larger populations: {again} --population {2 * RARE_SETTINGS.population}",
        )
    return (
        f"{entry.requirement.name} fails most often, in at most {event.interval[1]:.2g} of the missions",
        "ask whether the distributions in [verification] are wide enough: the figure is no surer than they",
    )


def _rare_table(requirements: Sequence[RareRequirement]) -> Table:
    rows = []
    for entry in requirements:
        event = entry.event
        if event is None:
            rows.append((
                entry.requirement.name,
                entry.verdict,
                "",
                "",
                f"{entry.requirement.allowed:.2g}",
                "",
                "",
                "",
            ))
            continue
        low, high = event.interval
        check = event.check
        rows.append((
            entry.requirement.name,
            entry.verdict,
            f"{event.estimate:.2g}" if event.estimate else "none found",
            f"{low:.2g} to {high:.2g}",
            f"{entry.requirement.allowed:.2g}",
            "" if check is None or event.agrees is None else f"{check.estimate:.2g}",
            f"{event.evaluations}",
            f"{event.plain:.2g}" if math.isfinite(event.plain) else "",
        ))
    head = (
        "requirement",
        "verdict",
        "fails in",
        f"{100 * (requirements[0].event.confidence if requirements and requirements[0].event else 0.95):g} %",
        "allowed",
        "check",
        "missions",
        "plain sampling",
    )
    return Table.of(
        "Failure probabilities", head, rows, left=2, note="plain sampling: missions for the same interval"
    )


def _drawn(entry: RareRequirement) -> list[str]:
    """What failing missions have in common, and how far out the likeliest is."""
    lines = [
        f"{name}: mean {mean:.3g} in failures, {usual:.3g} in all draws ({shift:+.1f} sd);"
        f" {entry.likeliest[name]:.3g} in the likeliest failure"
        for name, (mean, usual, shift) in list(entry.common.items())[: SETTINGS.shown]
        if abs(shift) >= SETTINGS.shifted
    ]
    return [
        *(lines or ["nothing that is drawn stands out: noise, gusts or many small things"]),
        f"the likeliest failure lies {entry.nearest_deviations:.1f} standard deviations from the middle of"
        " all draws, besides noise and gusts",
    ]


@report.register
def _falsification(result: Falsification) -> Report:
    """Three lines, then by requirement the least disturbance that fails."""
    bad, flown = result.falsified, sum(entry.missions for entry in result.requirements)
    tried = [entry for entry in result.requirements if not entry.why_not]
    worst, then = "no requirement can be searched", "add a number that comes near its limit"
    if bad:
        entry = max(bad, key=lambda each: -each.worst)
        worst = f"{entry.requirement.name} fails: {', '.join(disturbance(entry)[:3])}"
        then = "fly it (its folder is below), mend what it shows, and add cases.toml to the campaign"
    elif tried:
        entry = min(tried, key=lambda each: each.worst)
        worst = f"{entry.requirement.name} comes nearest to failing, robustness {entry.worst:.3g}"
        then = (
            "widen the ranges in [verification] if worse can happen; `seatrial rare` gives the"
            " probability of failure"
        )
    worst, then = doubting(result.scenario.flights, worst, then)
    return Report(
        title=result.scenario.name,
        outcome=("falsified" if bad else "not falsified") + (" (interrupted)" if result.interrupted else ""),
        good=(
            f"{len(tried) - len(bad)} of {len(result.requirements)} requirements withstood a search within"
            f" {result.within:g} standard deviations of everything that is drawn; {flown} missions flown"
        ),
        worst=worst,
        next_step=then,
        sections=(
            *(
                Section(
                    f"Least disturbance that fails: {entry.requirement.name} ({entry.requirement.holds},"
                    f" robustness {entry.robustness:.3g})",
                    tuple(disturbance(entry)),
                )
                for entry in bad
            ),
            Section("Not searched", _not_judged(result.requirements)),
        ),
    )


def disturbance(entry: FalsifiedRequirement) -> list[str]:
    """The least disturbance that fails, a text per number that was drawn."""
    lines = [
        f"{name} {value:.3g} (middle {middle:.3g})" for name, (value, middle) in entry.disturbance.items()
    ]
    if lines:
        return lines
    middle = [f"{name} {value:.3g}" for name, value in entry.middle.items()][: SETTINGS.named]
    return [f"the middle of all ranges fails already{': ' if middle else ''}{', '.join(middle)}"]


@report.register
def _boundary(result: FailureBoundary) -> Report:
    """Three lines, and a table of the boundaries."""
    flights = result.scenario.flights
    worst, next_step = doubting(flights, *_worst_of_boundary(result))
    names = " and ".join(result.variables)
    bounded = sum(entry.side == "boundary" for entry in result.requirements)
    return Report(
        title=result.scenario.name,
        outcome="boundary" + (" (interrupted)" if result.interrupted else ""),
        good=(
            f"{bounded} of {len(result.requirements)} requirements have a boundary in {names} with"
            f" {flights.autopilot.name} on {flights.fitted.vehicle.name};"
            f" {len(result.places) * result.runs_per_place} missions at {len(result.places)} places"
        ),
        worst=worst,
        next_step=next_step,
        sections=(
            Section(tables=(_boundary_table(result),)),
            Section(
                "Notes",
                (
                    "A boundary is where the failure probability is what the requirement allows;"
                    " everything but the variables is drawn as [verification] says.",
                    "The probability is taken to change smoothly: a jump is found on its safe side, by up"
                    " to some hundredths of the range.",
                    *result.scenario.notes,
                    *flights.left_out,
                ),
                details=True,
            ),
        ),
    )


def _worst_of_boundary(survey: FailureBoundary) -> tuple[str, str]:
    if survey.interrupted:
        return "Ctrl-C ended it early", "run the same command again; the places flown are kept"
    python = survey.scenario.without_file
    if failing := [entry.requirement.name for entry in survey.requirements if entry.side == "fails"]:
        return f"{failing[0]} fails in the whole range", "change the autopilot or the range"
    first = next(iter(survey.variables))
    nearest_one: tuple[float, str] | None = None
    for entry in survey.requirements:
        seconds: list[float | None] = [None] if len(survey.variables) == 1 else list(survey.seconds())
        for second in seconds:
            beside = "" if second is None else f" at {list(survey.variables)[1]} = {second:.3g}"
            for value, low, high, rising in survey.crossings(entry.requirement.name, second):
                reach = value - survey.value(0, 0.0) if rising else survey.value(0, 1.0) - value
                text = (
                    f"{entry.requirement.name} holds {'up to' if rising else 'from'} {first} ="
                    f" {value:.3g} ({low:.3g} to {high:.3g}){beside}"
                )
                if nearest_one is None or reach < nearest_one[0]:
                    nearest_one = (reach, text)
    runs = len(survey.places) * survey.runs_per_place
    more = f"runs={4 * runs}" if python else f"--runs {4 * runs}"
    if nearest_one is not None:
        return nearest_one[1], f"plan on the safe end of the interval; {more} halves its width"
    if unsure := [entry for entry in survey.requirements if entry.side.startswith("probably")]:
        side = "safe" if unsure[0].side == "probably safe" else "failing"
        return (
            f"{unsure[0].requirement.name} is probably {side} in the whole range; more missions would tell",
            f"fly more missions: {more}",
        )
    return "no requirement fails in the range", "widen the range until one does"


def _boundary_table(survey: FailureBoundary) -> Table:
    names = list(survey.variables)
    rows: list[tuple[str, ...]] = []
    for entry in survey.requirements:
        seconds: list[float | None] = [None] if len(names) == 1 else list(survey.seconds())
        for second in seconds:
            lines = survey.crossings(entry.requirement.name, second)
            head = (
                entry.requirement.name,
                share(entry.requirement.allowed),
                "" if second is None else f"{second:.3g}",
            )
            if not lines:
                rows.append((*head, "none", "", _side_at(survey, entry, second)))
            for value, low, high, rising in lines:
                rows.append((
                    *head,
                    f"{value:.3g}",
                    f"{low:.3g} to {high:.3g}",
                    f"safe {'below' if rising else 'above'}",
                ))
    sure = f"{100.0 * survey.scenario.flights.table.confidence:g} %"
    second_name = names[1] if len(names) > 1 else ""
    columns = ("requirement", "allowed", second_name, names[0], f"{sure} interval", "side")
    return Table.of("Failure boundaries", columns, rows)


def _side_at(survey: FailureBoundary, entry: RequirementBoundary, second: float | None) -> str:
    """The side of a whole line without a boundary."""
    sides = entry.surface.sides
    mean = entry.surface.mean
    if second is not None:
        low, high = list(survey.variables.values())[1]
        k = round((second - low) / (high - low) * (len(entry.surface.axis) - 1))
        sides, mean = sides[:, k], mean[:, k]
    words = "safe" if (mean < entry.surface.level).all() else "fails"
    return words if abs(int(sides.sum())) == len(sides) else f"probably {words}"
