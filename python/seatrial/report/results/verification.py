"""The words of a verification: requirements, worst missions, causes, what to do; and its JUnit XML."""

from __future__ import annotations

import math
from importlib import metadata
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.report import Report, Section, Table, appended, listed
from seatrial.flight.excesses import KINDS
from seatrial.statistics.proportions import share
from seatrial.verification.comparison import AutopilotComparison
from seatrial.verification.judgement import JudgedRequirement
from seatrial.verification.junit import JUnitCase, junit_xml
from seatrial.verification.regression import FlownCase
from seatrial.verification.verification import WITHOUT_FILE, Verification, excess_sentences

if TYPE_CHECKING:
    pass


_CAUSES = 4


def report(found: Verification) -> Report:
    """Three lines, requirements, worst missions, comparison; causes, notes."""
    worst, next_step = _worst(found)
    held = found.outcome == "held" and not found.interrupted
    if beyond := excess_sentences(found, found.reservations if held else found.excesses):
        worst = "; ".join(beyond if held else (worst, *beyond))
        if held:
            next_step = (
                f"fly the worst one again to see where ({_again(found)}), then change mission or autopilot,"
                " or state in a requirement how often it may happen"
            )
    worst, next_step = found.flights.doubting(worst, next_step)
    comparison = () if found.comparison is None else (*_against(found.comparison), _medians(found.comparison))
    causes = [
        f"{one.requirement.name}: {text}"
        for one in found.requirements
        for text in (
            *([] if one.verdict == "held" else [one.sentence]),
            *map(str, one.named_causes[:_CAUSES]),
        )
    ]
    causes += [_of_case(one) for one in found.cases]
    details = ["\n  ".join(line.strip() for line in requirement_lines(one)) for one in found.requirements]
    closing = time_sentence(found), again(found)
    tables = (_requirement_table(found), _mission_table(found), _worst_table(found), *comparison)
    return Report(
        title=found.campaign.name,
        outcome=_outcome(found),
        good=_how_good(found),
        worst=worst,
        next_step=next_step,
        sections=(
            Section(sentences=tuple(causes), tables=tables),
            Section("Requirements", tuple(details), details=True),
            Section(
                "Notes",
                (*filter(None, [found.doubt]), *found.notes, *found.flights.left_out, *closing),
                details=True,
            ),
        ),
    )


def _how_good(found: Verification) -> str:
    """Requirements held, and the share of missions that hold all of them."""
    flights, flown = found.flights, len(found.flown)
    held = sum(one.verdict == "held" for one in found.requirements)
    counted = f"{flown} missions" if flown == found.asked else f"{flown} of {found.asked} missions"
    every = np.all([one.judgement.held for one in found.requirements], axis=0)
    line = (
        f"{held} of {len(found.requirements)} requirements held by {flights.autopilot.name} on"
        f" {flights.fitted.vehicle.name}; {share(float(np.mean(every)))} of {counted}"
        f" ({', '.join(flights.titles)}, seed {flights.seed}) hold all of them"
    )
    return appended(line, found.doubt)


def _of_case(one: FlownCase) -> str:
    """A regression case in a sentence."""
    bad = {name: value for name, value in one.robustness.items() if value <= 0.0}
    if not bad:
        return f"regression case {one.name} on {one.mission}: held"
    told = ", ".join(f"{name} (robustness {value:.3g})" for name, value in bad.items())
    return f"regression case {one.name} on {one.mission} fails: {told}"


def _worst(found: Verification) -> tuple[str, str]:
    """The worst problem of a verification, and what to do about it."""
    python = found.campaign.source == WITHOUT_FILE
    verify = f"seatrial verify {found.campaign.source}"
    if found.interrupted:
        return (
            f"Ctrl-C ended the missions after {len(found.flown)} of {found.asked}",
            "run the same command again; it goes on with the missions that are left",
        )
    if again_ := [one for one in found.cases if not one.held]:
        return _of_case(again_[0]), "mend what it shows: it was found once and must hold"
    failed = [one for one in found.requirements if one.verdict == "failed"]
    if failed:
        one = max(failed, key=lambda each: each.found.failures)
        cause = f"; {one.named_causes[0]}" if one.named_causes else ""
        return f"{one.requirement.name} {one.sentence}{cause}", (
            "look at the worst mission ("
            + (
                f"verification.replay({one.worst[0].number})"
                if python
                else f"{verify} --replay {one.worst[0].number}"
            )
            + "), then tune or change what it shows"
            if one.worst
            else "change the autopilot or the requirement"
        )
    undecided = [one for one in found.requirements if one.verdict == "undecided"]
    if undecided:
        one = max(undecided, key=lambda each: each.further_runs or 0)
        more = one.further_runs
        return f"{one.requirement.name} {one.sentence}", (
            "fly more missions: "
            + (f"runs={found.asked + more}" if python else f"{verify} --runs {found.asked + more}")
            if more
            else "relax the requirement or improve the autopilot; more missions will not decide it"
        )
    after = "fly the mission at sea and judge its log: " + (
        "st.verify_log" if python else f"{verify} --log LOG"
    )
    finite = [one for one in found.requirements if one.worst and math.isfinite(one.worst[0].reserve)]
    if not finite:
        return "no requirement failed", after
    one = min(finite, key=lambda each: (-each.found.failures, each.worst[0].reserve))
    run = one.worst[0]
    return (
        f"{one.requirement.name} has the least robustness: {one.found.failures} of {one.found.runs} missions"
        f" fail ({share(one.requirement.allowed)} are allowed), worst mission {run.number} with"
        f" {reserve(run.reserve, one.judgement.unit)}",
        after,
    )


def _again(found: Verification) -> str:
    """How to fly one of the missions again."""
    if found.campaign.source == WITHOUT_FILE:
        return "verification.replay(NUMBER)"
    return f"seatrial verify {found.campaign.source} --replay NUMBER"


def _outcome(found: Verification) -> str:
    """The outcome, with the shares of missions that failed where nothing is required."""
    reserved = [
        f"{share(one.count / one.of, 'up')} of the missions {one.words}" for one in found.reservations
    ]
    if found.outcome == "held" and reserved:
        return f"held, but {listed(reserved)}" + (" (interrupted)" if found.interrupted else "")
    return found.outcome + (" (interrupted)" if found.interrupted else "")


def _requirement_table(found: Verification) -> Table:
    rows = [
        (
            one.requirement.name,
            one.requirement.holds,
            share(one.requirement.allowed),
            str(one.found.failures),
            f"{share(one.found.interval[0], 'down')} to {share(one.found.interval[1], 'up')}",
            share(one.found.at_most, "up"),
            one.verdict,
        )
        for one in found.requirements
    ]
    sure = f"{100.0 * found.flights.table.confidence:g} %"
    flights = found.flights
    title = f"{flights.autopilot.name} on {flights.fitted.vehicle.name}: {len(found.flown)} missions"
    head = ("requirement", "holds", "allowed", "failures", f"{sure} interval", "at most", "verdict")
    return Table.of(title, head, rows, left=2)


def _mission_table(found: Verification) -> Table:
    titles = found.flights.titles
    rows = [
        (
            one.requirement.name,
            *(
                f"{part.failures} of {part.runs}" if (part := one.by_mission.get(title)) else "-"
                for title in titles
            ),
        )
        for one in found.requirements
        if len(one.by_mission) > 1
    ]
    return Table.of("Failures by mission", ("requirement", *titles), rows)


def _worst_table(found: Verification) -> Table:
    several = len(found.flights.titles) > 1
    rows = [
        (
            one.requirement.name,
            str(run.number),
            run.mission if several else "",
            reserve(run.reserve, one.judgement.unit),
            str(run.metrics["ending"]),
            _number(run.metrics["cross_track_p95_m"], 2),
            _number(run.metrics["vertical_p95_m"], 2),
            _number(run.metrics["clearance_m"], 1),
            _number(run.metrics["duration_s"], 0),
        )
        for one in found.requirements
        for run in one.worst[:3]
    ]
    head = ("requirement", "number", "mission", "robustness", "ending", "across", "vertical", "clear", "time")
    return Table.of("Worst missions (lengths in m, time in s; across and vertical: p95)", head, rows)


def _against(found: AutopilotComparison) -> list[Table]:
    """The verified autopilot against each other one."""
    verified, *others = found.autopilots
    head = ("requirement", "verified fails", "other fails", "only verified", "only other", "p", "better")
    tables = []
    for other in others:
        rows = []
        for name, failures in verified.failures.items():
            pair = found.pair(name, other.name)
            rows.append((
                name,
                share(failures.estimate),
                share(other.failures[name].estimate),
                str(pair.only_verified),
                str(pair.only_other),
                f"{pair.corrected:.2g}",
                {"verified": "verified", None: "not shown"}.get(pair.better, "other"),
            ))
        title = f"Against {other.name}, on the same {found.runs} draws (McNemar's exact test, Holm)"
        tables.append(Table.of(title, head, rows))
    return tables


_MEDIANS = {
    "cross_track_p95_m": "median cross-track p95, m",
    "vertical_p95_m": "median vertical p95, m",
    "energy_wh": "median energy, Wh",
    "duration_s": "median duration, s",
    "travel_per_s": "median command travel, 1/s",
}


def _medians(found: AutopilotComparison) -> Table:
    rows = [
        (label, *(f"{one.metrics[name]:.4g}" for one in found.autopilots))
        for name, label in _MEDIANS.items()
        if name in found.autopilots[0].metrics
    ]
    return Table.of("Metrics on the same draws", ("metric", *(one.name for one in found.autopilots)), rows)


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
        lines.append(f"  least robustness in missions {numbers}")
    return lines


def again(found: Verification) -> str:
    """How to fly a mission again."""
    if found.campaign.source == WITHOUT_FILE:
        return "Any mission flies again by its number: verification.replay(NUMBER)."
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
    """A robustness with its sign and unit; in words where it has no size."""
    if math.isinf(value):
        return "failed" if value < 0.0 else "held"
    return f"{value:+.2g} {unit}".rstrip().replace("-", "\N{MINUS SIGN}")


def _size(value: float) -> str:
    return f"{value:,.1f}" if value >= 1.0 else f"{value:.2g}"


def _number(value: float, decimals: int) -> str:
    """A number with so many decimals; nothing where there is none."""
    return f"{round(value, decimals) + 0.0:.{decimals}f}" if math.isfinite(value) else ""


def junit(found: Verification) -> str:
    """JUnit XML with a case per requirement."""
    titles = found.flights.titles
    mission = titles[0] if len(titles) == 1 else "all missions"
    part = found.flown.wall_s / len(found.requirements)
    lines = [requirement_lines(one) for one in found.requirements]
    outcomes = [
        JUnitCase(
            mission,
            one.requirement.name,
            one.verdict,
            message=one.sentence,
            # The second line is the message.
            details="\n".join([said[0], *(line.strip() for line in said[2:]), again(found)]),
            time_s=part,
        )
        for one, said in zip(found.requirements, lines, strict=True)
    ]
    outcomes += [
        JUnitCase(one.mission, f"case {one.name}", "held" if one.held else "failed", message=_of_case(one))
        for one in found.cases
    ]
    reserved = excess_sentences(found, found.reservations)
    outcomes += [
        JUnitCase(
            mission,
            f"no requirement: {KINDS[excess.kind].words}".format(limit=excess.limit),
            "held",
            message=sentence,
        )
        for excess, sentence in zip(found.reservations, reserved, strict=True)
    ]
    rests_on = {
        "seed": found.flights.seed,
        "missions": len(found.flown),
        "seatrial": metadata.version("seatrial"),
        "autopilot": found.flights.autopilot.name,
        "vehicle": found.flights.fitted.vehicle.name,
        "confidence": found.flights.table.confidence,
    }
    rests_on |= {f"reservation {k}": sentence for k, sentence in enumerate(reserved, 1)}
    rests_on |= {f"note {k}": note for k, note in enumerate((*found.notes, *found.flights.left_out), 1)}
    return junit_xml(found.campaign.name, outcomes, properties=rests_on)
