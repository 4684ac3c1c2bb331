"""The words of a verification: requirements, worst missions, causes and notes, what to do; its JUnit XML.

Held by ``tests/verification/test_causes.py``, ``tests/statistics/test_failure_probability.py`` and
``tests/verification/test_verification_messages.py``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from importlib import metadata

import numpy as np

from seatrial.base.finding import Finding
from seatrial.base.report import Report, Section, Table, appended, listed
from seatrial.flight.excesses import Excess
from seatrial.report.results.flight_findings import doubting, exceeded, excess_clauses
from seatrial.report.results.junit import JUnitCase, junit_xml
from seatrial.report.results.phrases import Phrases
from seatrial.statistics.failure_probability import FailureProbability, further_runs, runs_needed, share
from seatrial.verification.causes import Influence
from seatrial.verification.chosen_missions import FlownCase
from seatrial.verification.judgement import JudgedRequirement
from seatrial.verification.verify import AutopilotComparison, Verification

_CAUSES = 4  # the strongest, that a report lists

_NO_OBSTACLE = "nothing stands in the water; add [[obstacles]] to the mission"

_MISSING = {
    "altitude_smallest_m": "there is no bottom; add seabed under [verification]",
    "clearance_m": _NO_OBSTACLE,
    "clearance_reserve_m": _NO_OBSTACLE,
}
"""Why a metric is infinite, and what to do."""

_note = Phrases("verification", "note", {"missing": _MISSING.__getitem__})


def problem(what: Finding | Influence | JudgedRequirement) -> str:
    """A note as a sentence; a cause, or the verdict on a requirement, as a clause."""
    if isinstance(what, Influence):
        return _influence(what)
    if isinstance(what, JudgedRequirement):
        return verdict(what.found, what.requirement.allowed)
    return _note(what)


def report(verification: Verification) -> Report:
    """Three lines, requirements, worst missions, comparison; causes, notes."""
    worst, next_step = _worst(verification)
    all_held = verification.outcome == "held" and not verification.interrupted
    if beyond := excess_sentences(
        verification, verification.reservations if all_held else verification.excesses
    ):
        worst = "; ".join(beyond if all_held else (worst, *beyond))
        if all_held:
            next_step = (
                f"fly the worst one again to see where ({_again(verification)}), then change mission or"
                " autopilot, or state in a requirement how often it may happen"
            )
    worst, next_step = doubting(verification.flights, worst, next_step)
    comparison = (
        ()
        if verification.comparison is None
        else (*_against(verification.comparison), _medians(verification.comparison))
    )
    causes = [
        f"{judged.requirement.name}: {text}"
        for judged in verification.requirements
        for text in (
            *([] if judged.verdict == "held" else [judged.sentence]),
            *map(str, judged.named_causes[:_CAUSES]),
        )
    ]
    causes += [_of_case(flown_case) for flown_case in verification.cases]
    details = [
        "\n  ".join(line.strip() for line in requirement_lines(judged))
        for judged in verification.requirements
    ]
    closing = time_sentence(verification), again(verification)
    tables = (
        _requirement_table(verification),
        _mission_table(verification),
        _worst_table(verification),
        *comparison,
    )
    return Report(
        title=verification.scenario.name,
        outcome=_outcome(verification),
        good=_how_good(verification),
        worst=worst,
        next_step=next_step,
        sections=(
            Section(sentences=tuple(causes), tables=tables),
            Section("Requirements", tuple(details), details=True),
            Section(
                "Notes",
                (
                    *filter(None, [verification.doubt]),
                    *verification.notes,
                    *verification.flights.left_out,
                    *closing,
                ),
                details=True,
            ),
        ),
    )


def excess_sentences(verification: Verification, excesses: Sequence[Excess]) -> list[str]:
    """A sentence for each excess: how many missions, the worst one and when."""
    flown, titles = verification.flown, verification.flights.titles

    def name(row: int) -> str:
        of = f" ({titles[flown.mission[row]]})" if len(titles) > 1 else ""
        return f"mission {flown.numbers[row]}{of}"

    return excess_clauses(excesses, name)


def _how_good(verification: Verification) -> str:
    """Requirements held, and the share of missions that hold all of them."""
    flights, flown = verification.flights, len(verification.flown)
    held_count = sum(judged.verdict == "held" for judged in verification.requirements)
    counted = (
        f"{flown} missions" if flown == verification.asked else f"{flown} of {verification.asked} missions"
    )
    every = np.all([judged.judgement.held for judged in verification.requirements], axis=0)
    line = (
        f"{held_count} of {len(verification.requirements)} requirements held by {flights.autopilot.name} on"
        f" {flights.fitted.vehicle.name}; {share(float(np.mean(every)))} of {counted}"
        f" ({', '.join(flights.titles)}, seed {flights.seed}) hold all of them"
    )
    return appended(line, verification.doubt)


def _of_case(flown_case: FlownCase) -> str:
    """A regression case in a sentence."""
    bad = {name: value for name, value in flown_case.robustness.items() if value <= 0.0}
    if not bad:
        return f"regression case {flown_case.name} on {flown_case.mission}: held"
    reserves = ", ".join(f"{name} (robustness {value:.3g})" for name, value in bad.items())
    return f"regression case {flown_case.name} on {flown_case.mission} fails: {reserves}"


def _worst(verification: Verification) -> tuple[str, str]:
    """The worst problem of a verification, and what to do about it."""
    python = verification.scenario.without_file
    verify = f"seatrial verify {verification.scenario.source}"
    if verification.interrupted:
        return (
            f"Ctrl-C ended the missions after {len(verification.flown)} of {verification.asked}",
            "run the same command again; it goes on with the missions that are left",
        )
    if again_ := [flown_case for flown_case in verification.cases if not flown_case.held]:
        return _of_case(again_[0]), "mend what it shows: it was found once and must hold"
    failed = [judged for judged in verification.requirements if judged.verdict == "failed"]
    if failed:
        judged = max(failed, key=lambda each: each.found.failures)
        cause = f"; {judged.named_causes[0]}" if judged.named_causes else ""
        return f"{judged.requirement.name} {judged.sentence}{cause}", (
            "look at the worst mission ("
            + (
                f"verification.replay({judged.worst[0].number})"
                if python
                else f"{verify} --replay {judged.worst[0].number}"
            )
            + "), then tune or change what it shows"
            if judged.worst
            else "change the autopilot or the requirement"
        )
    undecided = [judged for judged in verification.requirements if judged.verdict == "undecided"]
    if undecided:
        judged = max(undecided, key=lambda each: each.further_runs or 0)
        more = judged.further_runs
        return f"{judged.requirement.name} {judged.sentence}", (
            "fly more missions: "
            + (
                f"runs={verification.asked + more}"
                if python
                else f"{verify} --runs {verification.asked + more}"
            )
            if more
            else "relax the requirement or improve the autopilot; more missions will not decide it"
        )
    after = "fly the mission at sea and judge its log: " + (
        "st.verify_log" if python else f"seatrial verify-log {verification.scenario.source} LOG"
    )
    finite = [
        judged
        for judged in verification.requirements
        if judged.worst and math.isfinite(judged.worst[0].reserve)
    ]
    if not finite:
        return "no requirement failed", after
    judged = min(finite, key=lambda each: (-each.found.failures, each.worst[0].reserve))
    run = judged.worst[0]
    return (
        f"{judged.requirement.name} has the least robustness: {judged.found.failures} of {judged.found.runs}"
        f" missions fail ({share(judged.requirement.allowed)} are allowed), worst mission {run.number} with"
        f" {reserve(run.reserve, judged.judgement.unit)}",
        after,
    )


def _again(verification: Verification) -> str:
    """How to fly one of the missions again."""
    if verification.scenario.without_file:
        return "verification.replay(NUMBER)"
    return f"seatrial verify {verification.scenario.source} --replay NUMBER"


def _outcome(verification: Verification) -> str:
    """The outcome, with the shares of missions that failed where nothing is required."""
    reserved = [
        f"{share(reservation.count / reservation.of, 'up')} of the missions {exceeded(reservation)}"
        for reservation in verification.reservations
    ]
    if verification.outcome == "held" and reserved:
        return f"held, but {listed(reserved)}" + (" (interrupted)" if verification.interrupted else "")
    return verification.outcome + (" (interrupted)" if verification.interrupted else "")


def _requirement_table(verification: Verification) -> Table:
    rows = [
        (
            judged.requirement.name,
            judged.requirement.holds,
            share(judged.requirement.allowed),
            str(judged.found.failures),
            f"{share(judged.found.interval[0], 'down')} to {share(judged.found.interval[1], 'up')}",
            share(judged.found.at_most, "up"),
            judged.verdict,
        )
        for judged in verification.requirements
    ]
    sure = f"{100.0 * verification.flights.table.confidence:g} %"
    flights = verification.flights
    title = f"{flights.autopilot.name} on {flights.fitted.vehicle.name}: {len(verification.flown)} missions"
    head = ("requirement", "holds", "allowed", "failures", f"{sure} interval", "at most", "verdict")
    return Table.of(title, head, rows, left=2)


def _mission_table(verification: Verification) -> Table:
    titles = verification.flights.titles
    rows = [
        (
            judged.requirement.name,
            *(
                f"{part.failures} of {part.runs}" if (part := judged.by_mission.get(title)) else "-"
                for title in titles
            ),
        )
        for judged in verification.requirements
        if len(judged.by_mission) > 1
    ]
    return Table.of("Failures by mission", ("requirement", *titles), rows)


def _worst_table(verification: Verification) -> Table:
    several = len(verification.flights.titles) > 1
    rows = [
        (
            judged.requirement.name,
            str(run.number),
            run.mission if several else "",
            reserve(run.reserve, judged.judgement.unit),
            str(run.metrics["ending"]),
            _number(run.metrics["cross_track_p95_m"], 2),
            _number(run.metrics["vertical_p95_m"], 2),
            _number(run.metrics["clearance_m"], 1),
            _number(run.metrics["duration_s"], 0),
        )
        for judged in verification.requirements
        for run in judged.worst[:3]
    ]
    head = ("requirement", "number", "mission", "robustness", "ending", "across", "vertical", "clear", "time")
    return Table.of("Worst missions (lengths in m, time in s; across and vertical: p95)", head, rows)


def _against(comparison: AutopilotComparison) -> list[Table]:
    """The verified autopilot against each other one."""
    verified, *others = comparison.autopilots
    head = ("requirement", "verified fails", "other fails", "only verified", "only other", "p", "better")
    tables = []
    for other in others:
        rows = []
        for name, failures in verified.failures.items():
            pair = comparison.pair(name, other.name)
            rows.append((
                name,
                share(failures.estimate),
                share(other.failures[name].estimate),
                str(pair.only_verified),
                str(pair.only_other),
                f"{pair.corrected:.2g}",
                {"verified": "verified", None: "not shown"}.get(pair.better, "other"),
            ))
        title = f"Against {other.name}, on the same {comparison.runs} draws (McNemar's exact test, Holm)"
        tables.append(Table.of(title, head, rows))
    return tables


_MEDIANS = {
    "cross_track_p95_m": "median cross-track p95, m",
    "vertical_p95_m": "median vertical p95, m",
    "energy_wh": "median energy, Wh",
    "duration_s": "median duration, s",
    "travel_per_s": "median command travel, 1/s",
}


def _medians(comparison: AutopilotComparison) -> Table:
    rows = [
        (label, *(f"{compared.metrics[name]:.4g}" for compared in comparison.autopilots))
        for name, label in _MEDIANS.items()
        if name in comparison.autopilots[0].metrics
    ]
    return Table.of(
        "Metrics on the same draws", ("metric", *(compared.name for compared in comparison.autopilots)), rows
    )


def requirement_lines(judged: JudgedRequirement) -> list[str]:
    """Verdict, interval, causes and worst missions of a requirement."""
    asked = judged.requirement
    lines = [
        f"{asked.name}: {asked.holds}, in at least {share(asked.probability)} of the missions",
        f"  {judged.sentence}",
        f"  {judged.found}",
    ]
    if len(judged.by_mission) > 1:
        apart = (f"{name} {part.failures} of {part.runs}" for name, part in judged.by_mission.items())
        lines.append(f"  failures by mission: {', '.join(apart)}")
    lines += [f"  {cause}" for cause in judged.named_causes[:_CAUSES]]
    if judged.found.failures and not judged.named_causes:
        lines.append("  nothing that was drawn is shown to drive the failures")
    if judged.worst:
        unit = judged.judgement.unit
        numbers = ", ".join(f"{run.number} ({reserve(run.reserve, unit)})" for run in judged.worst)
        lines.append(f"  least robustness in missions {numbers}")
    return lines


def again(verification: Verification) -> str:
    """How to fly a mission again."""
    if verification.scenario.without_file:
        return "Any mission flies again by its number: verification.replay(NUMBER)."
    return (
        f"Any mission flies again by its number: seatrial verify {verification.scenario.source} --replay"
        " NUMBER (with the same --run, --autopilot and --mission), or verification.replay(NUMBER)."
    )


def time_sentence(verification: Verification) -> str:
    """How much was flown in which time."""
    flown = verification.flown
    return (
        f"{_size(flown.flown_s / 3600.0)} h were flown in {_size(flown.wall_s)} s:"
        f" {flown.per_second:,.0f} missions per second, {flown.real_time_factor:,.0f} times real time."
    )


def reserve(value: float, unit: str) -> str:
    """A robustness with its sign and unit; in words where it has no size."""
    if math.isinf(value):
        return "failed" if value < 0.0 else "held"
    return f"{value:+.2g} {unit}".rstrip().replace("-", "\N{MINUS SIGN}")


def _size(value: float) -> str:
    return f"{value:,.1f}" if value >= 1.0 else f"{value:.2g}"


def _number(value: float, decimals: int) -> str:
    """A number with so many decimals; nothing where there is none."""
    return f"{round(value, decimals) + 0.0:.{decimals}f}" if math.isfinite(value) else ""


def junit(verification: Verification) -> str:
    """JUnit XML with a case per requirement."""
    titles = verification.flights.titles
    mission = titles[0] if len(titles) == 1 else "all missions"
    part = verification.flown.wall_s / len(verification.requirements)
    lines = [requirement_lines(judged) for judged in verification.requirements]
    outcomes = [
        JUnitCase(
            mission,
            judged.requirement.name,
            judged.verdict,
            message=judged.sentence,
            # The second line is the message.
            details="\n".join([
                text_lines[0],
                *(line.strip() for line in text_lines[2:]),
                again(verification),
            ]),
            time_s=part,
        )
        for judged, text_lines in zip(verification.requirements, lines, strict=True)
    ]
    outcomes += [
        JUnitCase(
            flown_case.mission,
            f"case {flown_case.name}",
            "held" if flown_case.held else "failed",
            message=_of_case(flown_case),
        )
        for flown_case in verification.cases
    ]
    reserved = excess_sentences(verification, verification.reservations)
    outcomes += [
        JUnitCase(mission, f"no requirement: {exceeded(excess)}", "held", message=sentence)
        for excess, sentence in zip(verification.reservations, reserved, strict=True)
    ]
    rests_on = {
        "seed": verification.flights.seed,
        "missions": len(verification.flown),
        "seatrial": metadata.version("seatrial"),
        "autopilot": verification.flights.autopilot.name,
        "vehicle": verification.flights.fitted.vehicle.name,
        "confidence": verification.flights.table.confidence,
    }
    rests_on |= {f"reservation {k}": sentence for k, sentence in enumerate(reserved, 1)}
    rests_on |= {
        f"note {k}": note for k, note in enumerate((*verification.notes, *verification.flights.left_out), 1)
    }
    return junit_xml(verification.scenario.name, outcomes, properties=rests_on)


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


def _influence(cause: Influence) -> str:
    """What a cause has to do with the failures; of one that is not named, that it is not shown to."""
    if not cause.named:
        return f"{cause.label} is not shown to matter (corrected p {cause.corrected:.2g})"
    if cause.by_failures:
        return {"number": _of_number, "direction": _direction, "category": _category}[cause.kind](cause)
    return f"too few failures to compare, but {_by_reserve(cause)}"


def odds(ratio: float) -> str:
    """An odds ratio with two digits and no power of ten.

    Examples
    --------
    >>> odds(1024.0), odds(0.098)
    ('1,000', '0.098')
    """
    return f"{float(f'{ratio:.2g}'):,.6g}"


def _of_number(cause: Influence) -> str:
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
