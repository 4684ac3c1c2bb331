"""The words of the verdict on a recorded mission: metrics, channels, what is suspected first."""

from __future__ import annotations

import math
from importlib import metadata
from typing import Literal

from seatrial.base.channels import readable
from seatrial.base.report import Report, Section, Table
from seatrial.report.results.junit import JUnitCase, junit_xml
from seatrial.report.results.mission_log_findings import contradiction_clause, p_text, suspect_sentence
from seatrial.report.results.mission_log_findings import notes as notes
from seatrial.report.results.mission_log_findings import reason as reason
from seatrial.verification.mission_log.power import Shown
from seatrial.verification.mission_log.verdict import LogVerdict

SHOWN = 6  # suspects that a report lists


def report(verdict: LogVerdict) -> Report:
    """Three lines, channels against their band, suspects, the mission's own requirements; notes."""
    worst, next_step = _worst(verdict)
    mission, checks = _mission(verdict)
    statements = [verdict.reason]
    if verdict.validity is not None:
        statements.append(f"The band is that of {verdict.validity.spread.source}.")
    suspects: list[str] = []
    if verdict.suspects:
        suspects = [
            f"{k}. {suspect_sentence(suspect)}" for k, suspect in enumerate(verdict.suspects[:SHOWN], 1)
        ]
        suspects += _inseparable(verdict)
        suspects += _look_first(verdict)
    return Report(
        title=verdict.log.trial.name,
        outcome=f"{verdict.model} (verdict: {verdict.outcome})",
        good=_how_good(verdict),
        worst=worst,
        next_step=next_step,
        sections=(
            Section(sentences=tuple(statements), tables=(_channel_table(verdict),)),
            Section("What may have changed, the best explanation first", tuple(suspects)),
            Section("The mission", tuple(mission), (checks,)),
            Section(
                "Smallest changes that this log would have shown", (), (_power_table(verdict),), details=True
            ),
            Section("Notes", verdict.notes, details=True),
        ),
    )


def cannot_judge(verdict: LogVerdict) -> list[str]:
    """Channels that would have shown no group of coefficients halved and doubled."""
    if verdict.validity is None or verdict.power is None:
        return []
    return [name for name in verdict.validity.channels if not verdict.power.shown_in(name)]


def fails(verdict: LogVerdict) -> list[str]:
    """Channels that leave their band, or whose own estimate refutes a group of coefficients."""
    if verdict.validity is None:
        return []
    tests = () if verdict.power is None else verdict.power.refuted
    against = {name for channel_against in tests for name in channel_against.against}
    return [name for name, channel in verdict.validity.channels.items() if channel.fails or name in against]


def _how_good(verdict: LogVerdict) -> str:
    """Share of the log outside the 95 % band of a valid model, in the channel that speaks most against it."""
    if verdict.contradictions:
        return "sensors of this log contradict one another"
    if verdict.validity is None or not verdict.validity.channels:
        return "no window of this log could be judged"
    channels = verdict.validity.channels
    against = [name for name, channel in channels.items() if channel.fails] or [
        name for name, channel in channels.items() if channel.doubtful
    ]
    name = min(against, key=lambda channel: (channels[channel].p, -channels[channel].outside), default="")
    name = name or max(channels, key=lambda channel: channels[channel].outside)
    failing = fails(verdict)
    unable = [channel for channel in cannot_judge(verdict) if channel not in failing]
    judged_count = len(channels) - len(unable)
    judged = f"{judged_count - len(failing)} of {judged_count} channels agree with the model"
    if unable:
        judged = (
            f"{judged}, {len(unable)} cannot judge"
            if judged_count
            else f"none of {len(unable)} channels can judge"
        )
    if not channels[name].outside:
        return f"{judged}; none left its 95 % band"
    channel = channels[name]
    most = "" if against else " most,"
    chance = (
        f", p = {p_text(channel.p)}"
        if against
        else "; model errors are correlated in time: a valid model is outside this long with probability"
        f" {p_text(channel.p)}"
    )
    return (
        f"{judged}; {name} is outside its"
        f" 95 % band{most} {100.0 * channel.outside:.1f} % of the time (5 % expected on average{chance})"
    )


def _worst(verdict: LogVerdict) -> tuple[str, str]:
    """The worst finding, and what to do about it."""
    if verdict.contradictions:
        wrong = verdict.contradictions[0]
        before = f", or the {wrong.from_s:.0f} s before" if wrong.from_s > 0.0 else ""
        return contradiction_clause(wrong), (
            "find out which of them is wrong (a stuck or reversed sensor, a clock of its own), and correct it"
            f" in the column map or judge the log without it{before}"
        )
    if verdict.suspects:
        first = verdict.suspects[0]
        look = _look_first(verdict)
        return f"suspected first: {suspect_sentence(first)}", (
            look[0] if look else f"check {first.name} on the vehicle; if it has changed, identify again"
        )
    broken = [requirement for requirement in verdict.requirements if requirement.held is False]
    if broken:
        return f"requirement {broken[0].name} ({broken[0].holds}) was not held", (
            "look at where the mission left it, then tune the autopilot or change the requirement"
        )
    if outside := [step for step in verdict.steps if step.criterion > 0.0]:
        worst = max(outside, key=lambda step: step.criterion)
        return f"the {worst.loop} step at {worst.at_s:.1f} s left its corridor by {worst.criterion:.3g} s", (
            "tune this loop again, or widen its corridor"
        )
    if verdict.model == "not judged" and verdict.power is not None and verdict.power.unexplained:
        return verdict.reason, (
            "identify these axes on trials that move them (seatrial identify), or state the error that a"
            " valid model may have per channel (reference={...} in Python)"
        )
    if not verdict.valid:
        return verdict.reason, "record a longer log with more motion, or identify again (seatrial identify)"
    return (
        "no channel, requirement or step fails",
        "keep the model; judge the next mission's log the same way",
    )


def _look_first(verdict: LogVerdict) -> list[str]:
    """What to look at before the vehicle is identified anew."""
    first = verdict.suspects[0]
    if first.kind == "sensor":
        return ["No change of the vehicle explains it as well: check the sensor before you identify anew."]
    if first.kind == "actuator":
        return [
            f"No coefficient explains it as well: look at {first.name} and at its logged commands before you"
            " identify anew."
        ]
    return []


def _channel_table(verdict: LogVerdict) -> Table:
    rows = []
    cannot, failing = cannot_judge(verdict), fails(verdict)
    for name, channel in {} if verdict.validity is None else verdict.validity.channels.items():
        scale, unit = readable(name)
        low, high = channel.interval
        rows.append((
            name,
            unit,
            f"{100.0 * channel.outside:.1f} %",
            f"{100.0 * low:.0f}-{100.0 * high:.0f}",
            f"{scale * channel.rms:.3g}",
            f"{scale * channel.spread:.3g}",
            f"{channel.band_over_signal:.2g}",
            p_text(channel.p).replace("below ", "<"),
            _best_shown(verdict, name),
            "fails"
            if name in failing
            else "doubt"
            if channel.doubtful
            else "cannot judge"
            if name in cannot
            else "",
        ))
    head = (
        "channel",
        "unit",
        "outside 95 % band",
        "95 % interval",
        "error rms",
        "band +-",
        "band/signal",
        "p",
        "shows first",
        "",
    )
    return Table.of("Errors against the band of a valid model", head, rows, left=2)


def _best_shown(verdict: LogVerdict, channel: str) -> str:
    """The group of which a channel shows the smallest change, with the factors."""
    shown = () if verdict.power is None else verdict.power.shown_in(channel)
    return f"{shown[0].group.words} {factors(shown[0].by_channel[channel])}" if shown else ""


def factors(shown: Shown) -> str:
    """Smallest factors below and above one, in words."""
    down = "none" if shown.down is None else f"{shown.down:.2f}"
    return f"x{down} / x{shown.up:.2f}" if shown.up is not None else f"x{down} / none"


def _power_table(verdict: LogVerdict) -> Table:
    """Per group the channel that shows the smallest change, the factors, and what the log asks for."""
    rows = []
    for test in () if verdict.power is None else verdict.power.tests:
        best = test.best
        rows.append((
            test.group.words,
            ", ".join(test.group.names),
            best,
            factors(test.by_channel[best]) if best else "none",
            f"{test.factor:.3g} +- {test.sigma:.2g}" if math.isfinite(test.sigma) else "",
            "refuted" if test.refuted else "" if test.enough else "not shown",
        ))
    head = ("group", "coefficients", "channel", "smallest factors, 95 % power", "this log asks for", "")
    return Table.of("Coefficient groups", head, rows, left=3)


def _inseparable(verdict: LogVerdict) -> list[str]:
    """A word on weight and buoyancy, of which logs tell the difference alone."""
    first = verdict.suspects[0]
    named = {first.name, *first.alike}
    if {"m", "B"} <= named or (first.name.startswith("payload") and {"m", "B"} & named):
        return [
            "B and m g are seen as their difference, the weight in water, unless the log tells the inertia;"
            " weigh what was changed."
        ]
    return []


def _mission(verdict: LogVerdict) -> tuple[list[str], Table]:
    """Metrics of the mission and envelope in sentences; requirements and steps as a table."""
    statements = [
        text.format(verdict.metrics[name])
        for name, text in (
            ("cross_track_p95_m", "cross-track error {:.2f} m in 95 % of the settled time"),
            ("vertical_p95_m", "vertical error {:.2f} m"),
            ("duration_s", "{:.0f} s"),
            ("energy_wh", "{:.1f} Wh"),
        )
        if name in verdict.metrics
    ]
    lines = (
        [f"The mission: {', '.join(statements)}."] if len(statements) > 1 else []
    )  # its length alone is no news
    if verdict.envelope is not None:
        shares = ", ".join(
            f"{name.replace('_', '-')} {100.0 * band.outside:.0f} %"
            for name, band in verdict.envelope.bands.items()
        )
        lines.append(
            f"Outside the closed-loop envelope of {verdict.envelope.flights} flights: {shares} of the log."
        )
    rows: list[tuple[str, ...]] = []
    for requirement in verdict.requirements:
        if requirement.held is None:
            who = "no log tells" if requirement.beyond_logs else "the log does not tell"
            rows.append((requirement.name, requirement.holds, "?", f"{who} {', '.join(requirement.missing)}"))
        else:
            # Words and truth values are infinitely far from their threshold.
            size = (
                f"{requirement.reserve:.3g} {requirement.unit}".strip()
                if math.isfinite(requirement.reserve)
                else ""
            )
            rows.append((requirement.name, requirement.holds, "held" if requirement.held else "FAILS", size))
    for step in verdict.steps:
        outside = "" if step.criterion <= 0.0 else f"outside by {step.criterion:.3g} s"
        verdict_of_step = "held" if step.criterion <= 0.0 else "FAILS"
        rows.append((
            f"{step.loop} step at {step.at_s:.1f} s",
            "inside its corridor",
            verdict_of_step,
            outside,
        ))
    head = ("requirement", "holds", "verdict", "robustness")
    return lines, Table.of("Requirements and steps of this mission", head, rows, left=4)


_STATES: dict[str, Literal["held", "failed", "undecided", "not judged"]] = {
    "model still valid": "held",
    "re-identify": "failed",
    "not judged": "not judged",
    "log too short or too quiet to tell": "undecided",
}


def junit(verdict: LogVerdict) -> str:
    """JUnit XML with a case for the model, and one per requirement and step of a set point."""
    mission = verdict.log.trial.name
    cases = [
        JUnitCase(
            mission,
            "the model still holds",
            _STATES[verdict.model],
            message=f"{verdict.model}: {verdict.reason}",
            details="\n".join(map(suspect_sentence, verdict.suspects[:SHOWN])),
            time_s=verdict.clock.elapsed_s,
        )
    ]
    for asked in verdict.requirements:
        if asked.held is None and asked.beyond_logs:
            continue
        state: Literal["held", "failed", "undecided"] = (
            "undecided" if asked.held is None else "held" if asked.held else "failed"
        )
        why = f"the log does not tell {', '.join(asked.missing)}" if asked.held is None else asked.holds
        cases.append(JUnitCase(mission, asked.name, state, message=why))
    for step in verdict.steps:
        name = f"{step.loop} step at {step.at_s:.1f} s inside its corridor"
        cases.append(JUnitCase(mission, name, "failed" if step.criterion > 0.0 else "held"))
    rests_on = {"seatrial": metadata.version("seatrial"), "vehicle": verdict.vehicle.name}
    return junit_xml(mission, cases, properties=rests_on)
