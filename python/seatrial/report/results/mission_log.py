"""The words of the verdict on a recorded mission: metrics, channels, what is suspected first, and why.

Held by ``tests/verification/test_recorded_verdict.py`` and the other ``test_recorded_`` tests.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from importlib import metadata
from typing import Literal

from seatrial.base.channels import readable
from seatrial.base.finding import Finding
from seatrial.base.report import Report, Section, Table
from seatrial.report.results.junit import JUnitCase, junit_xml
from seatrial.report.results.phrases import Phrases
from seatrial.verification.mission_log.power import SETTINGS as POWER_SETTINGS
from seatrial.verification.mission_log.power import Shown
from seatrial.verification.mission_log.suspects import Suspect
from seatrial.verification.mission_log.unknowns import UNKNOWNS_SETTINGS
from seatrial.verification.mission_log.validity import ChannelValidity, Contradiction
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


def suspect_sentence(suspect: Suspect) -> str:
    """A suspect, what it explains, and what the log cannot tell from it."""
    share = f"{100.0 * suspect.gain:.{1 if suspect.gain > 0.99 else 0}f}"
    text = (
        f"{suspect.change}: explains {share} % of the misfit, leaves {suspect.left:.2g} times the usual error"
    )
    if suspect.sigmas is not None and abs(suspect.sigmas) >= 0.1:
        text += f", {abs(suspect.sigmas):.1f} standard deviations of the identification"
    if suspect.alike:
        shown = ", ".join(suspect.alike[:4]) + (" and others" if len(suspect.alike) > 4 else "")
        text += f"; this log cannot tell it from {shown}"
    return text + "."


def channel_clause(channel: ChannelValidity) -> str:
    """A channel outside its band."""
    scale, unit = readable(channel.channel)
    return (
        f"{channel.channel}: {100.0 * channel.outside:.0f} % outside the 95 % band (error"
        f" {scale * channel.rms:.2g} {unit} rms, band ±{scale * channel.spread:.2g} {unit};"
        f" p = {p_text(channel.p)})"
    )


def contradiction_clause(wrong: Contradiction) -> str:
    """Channels that tell of two motions."""
    return (
        f"{wrong.channel} contradicts {', '.join(wrong.against)} from {wrong.from_s:.0f} to"
        f" {wrong.to_s:.0f} s: it changes by {wrong.slope:.2g} of what they imply"
    )


def p_text(p: float) -> str:
    """A p-value; below 0.0001 it says no more."""
    return f"{p:.2g}" if p >= 1e-4 else "below 0.0001"


def current_words(north_m_s: float, east_m_s: float) -> str:
    """A current by its speed and direction.

    Examples
    --------
    >>> current_words(0.3, 0.3)
    'a steady current of 0.42 m/s towards 45 deg'
    """
    towards = math.degrees(math.atan2(east_m_s, north_m_s)) % 360.0
    return f"a steady current of {math.hypot(north_m_s, east_m_s):.2f} m/s towards {towards:.0f} deg"


problem = Phrases("mission_log", "clause", {"beyond one": lambda factor: f"{100.0 * (factor - 1.0):+.0f} %"})
"""A change that is suspected, or what the band rests on."""


@problem.of("payload")
def _payload(finding: Finding) -> str:
    wet, moment = finding["wet_kg"], finding["moment_kg_m"]
    if abs(wet) <= 0.02 * abs(moment):
        return f"a trim moment of {moment:+.2g} kg m: weight moved {'forward' if moment > 0 else 'aft'}"
    what = "a payload of" if wet > 0.0 else "buoyancy added, or weight lost, of"
    return f"{what} {wet:+.2g} kg in water at x = {moment / wet:.2g} m"


@problem.of("coefficient")
def _coefficient(finding: Finding) -> str:
    name, value, change = finding.subject, finding["present"], finding["change"]
    if name == "B":
        return f"buoyancy {change:+.3g} N: {'lighter' if change > 0.0 else 'heavier'} in water"
    if name.endswith(".gain") and value:
        return f"{name.removesuffix('.gain')} gives {100.0 * change / value:+.0f} % thrust"
    unit = "" if finding["unit"] == "1" else f" {finding['unit']}"
    new = value + change
    relative = f" ({100.0 * (abs(new) - abs(value)) / abs(value):+.0f} % in magnitude)" if value else ""
    return f"{name} {value:.3g} to {new:.3g}{unit}{relative}"


@problem.of("sensor offset")
def _offset(finding: Finding) -> str:
    scale, unit = readable(finding.subject)
    return f"the sensor of {finding.subject} reads {scale * finding['offset']:+.2g} {unit} too much"


_note = Phrases("mission_log", "note")


def notes(verdict: LogVerdict) -> list[str]:
    """Sentences on what was not known."""
    return [*map(_note, verdict.remarks)]


def reason(verdict: LogVerdict) -> str:
    """Why the model has its state, in sentences."""
    text = _REASONS[verdict.cause.kind](verdict)
    if verdict.current is not None:
        water = current_words(*verdict.current)
        lead = f"In {water}, which was not recorded and is fitted to this log: "
        text = f"{lead}{text[0].lower()}{text[1:]}"
    if verdict.hidden:
        text += (
            f" Not judged: {', '.join(verdict.hidden)}: here the autopilot's commands answer disturbances and"
            " noise, which a replay does not have. Log preset steps, or a dither on top of the autopilot"
            " (seatrial plan with a campaign of this log)."
        )
    return text


def _too_few(verdict: LogVerdict) -> str:
    count, ahead_s, needed = (verdict.cause[name] for name in ("windows", "ahead_s", "needed"))
    few = f"{count} windows of {ahead_s:g} s are" if count > 1 else f"One window of {ahead_s:g} s is"
    return f"{few} too few; fly at least {needed} of them, {needed * ahead_s:g} s."


def _outside(verdict: LogVerdict) -> str:
    failing = [] if verdict.validity is None else verdict.validity.failing
    some = "one channel" if len(failing) == 1 else f"{len(failing)} channels"
    text = f"The log leaves the model's band in {some}: {'; '.join(map(channel_clause, failing[:3]))}."
    if verdict.cause["explained"]:
        return f"{text} Suspected first: {verdict.suspects[0].change}."
    return (
        f"{text} No single change of the vehicle explains this log: check units, signs and the column map,"
        " the water's density and the supply, and that this vehicle flew it, before you identify anew."
    )


def _vehicle_or_water(verdict: LogVerdict) -> str:
    water = current_words(verdict.cause["north_m_s"], verdict.cause["east_m_s"])
    other = f" as well as this change: {verdict.suspects[0].change}" if verdict.suspects else ""
    return (
        f"The log cannot tell a changed vehicle from the water: {water}, which was not recorded, explains"
        f" it{other}. Log the current (zero in a tank), or fly more than one heading."
    )


def _refuted(verdict: LogVerdict) -> str:
    against = () if verdict.power is None else verdict.power.refuted
    groups = "; ".join(
        f"{test.group.words} ({', '.join(test.group.names)}) {test.factor:.2g} times as much"
        f" (standard deviation {test.sigma:.2g}, p = {p_text(test.p)})"
        for test in against[:3]
    )
    return (
        "The log stays inside the band that the references leave, and yet asks for other coefficients than"
        f" the stated intervals allow: {groups}."
    )


def _in_doubt(verdict: LogVerdict) -> str:
    channels = {} if verdict.validity is None else verdict.validity.channels
    doubts = [channel_clause(channels[name]) for name in verdict.cause["channels"]]
    return (
        "More of the log is outside the band than a valid model should leave, and less than would refute it:"
        f" {'; '.join(doubts[:3])}. Fly longer, or give longer references."
    )


def _unexplained(verdict: LogVerdict) -> str:
    power = verdict.power
    channels = (
        ""
        if power is None
        else ", ".join(
            f"{name} ({power.left[name]:.2g} times the noise, {power.grown[name]:.2g} times its pieces)"
            for name in power.unexplained
        )
    )
    return (
        "The model misses this log by more than the noise of the sensors and the stated intervals explain"
        f" (an error of more than {POWER_SETTINGS.unexplained:g} times the noise, or"
        f" {POWER_SETTINGS.grown:g} times larger in whole windows than in pieces of"
        f" {UNKNOWNS_SETTINGS.horizon_s:g} s), and no change of one group of coefficients accounts for it:"
        f" {channels}."
    )


def _unjudged(verdict: LogVerdict) -> str:
    axes = "" if verdict.power is None else verdict.power.unjudged
    return (
        f"This log could not have refuted the model on every controlled axis: on {', '.join(axes)} no channel"
        " would have shown any group of coefficients halved and doubled with 95 % power. Record a log that"
        f" moves {'these axes' if len(axes) > 1 else 'this axis'}: change speed, heading, depth and attitude"
        " in steps."
    )


def _inside(verdict: LogVerdict) -> str:
    outside = 0.0 if verdict.validity is None else verdict.validity.outside
    tests = () if verdict.power is None else verdict.power.tests
    text = (
        f"{100.0 * outside:.1f} % of the log is outside the model's 95 % band, no channel by more than"
        " chance. It would have shown half and double of"
        f" {', '.join(test.group.words for test in tests if test.enough)}."
    )
    unseen = [test.group.words for test in tests if not test.enough]
    return f"{text} It says nothing of {', '.join(unseen)}." if unseen else text


_REASONS: dict[str, Callable[[LogVerdict], str]] = {
    "prediction diverges": lambda _: (
        "The prediction diverges: the model cannot be this vehicle's, or its step is too long."
    ),
    "too few windows": _too_few,
    "every axis answers waves": lambda _: (
        "On every axis commands react to waves: no channel of the log can test a model."
    ),
    "sensors contradict": lambda verdict: (
        f"{contradiction_clause(verdict.contradictions[0])}: whatever the model, one of them is wrong."
    ),
    "outside the band": _outside,
    "vehicle or water": _vehicle_or_water,
    "coefficients refuted": _refuted,
    "channels in doubt": _in_doubt,
    "error unexplained": _unexplained,
    "axes unjudged": _unjudged,
    "inside the band": _inside,
}
