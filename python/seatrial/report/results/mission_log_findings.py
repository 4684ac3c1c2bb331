"""What the log of a mission says of a model, in words: why it has its state, suspects, what was not known.

A wording per kind. Held by ``tests/verification/test_recorded_verdict.py`` and the other ``test_recorded_``
tests.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from seatrial.base.channels import readable
from seatrial.base.finding import Finding
from seatrial.verification.mission_log.power import SETTINGS as POWER_SETTINGS
from seatrial.verification.mission_log.suspects import Suspect
from seatrial.verification.mission_log.unknowns import UNKNOWNS_SETTINGS
from seatrial.verification.mission_log.validity import ChannelValidity, Contradiction
from seatrial.verification.mission_log.verdict import LogVerdict


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


def problem(finding: Finding) -> str:
    """A change that is suspected, or what the band rests on."""
    return _CLAUSES[finding.kind](finding)


def _payload(finding: Finding) -> str:
    wet, moment = finding["wet_kg"], finding["moment_kg_m"]
    if abs(wet) <= 0.02 * abs(moment):
        return f"a trim moment of {moment:+.2g} kg m: weight moved {'forward' if moment > 0 else 'aft'}"
    what = "a payload of" if wet > 0.0 else "buoyancy added, or weight lost, of"
    return f"{what} {wet:+.2g} kg in water at x = {moment / wet:.2g} m"


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


def _neutral_mass(finding: Finding) -> str:
    verb = "more" if finding["mass_kg"] > 0.0 else "less"
    return f"{abs(finding['mass_kg']):.3g} kg {verb} mass that is neutral in water, as of a flooded space"


def _offset(finding: Finding) -> str:
    scale, unit = readable(finding.subject)
    return f"the sensor of {finding.subject} reads {scale * finding['offset']:+.2g} {unit} too much"


_CLAUSES: dict[str, Callable[[Finding], str]] = {
    "payload": _payload,
    "coefficient": _coefficient,
    "neutral mass": _neutral_mass,
    "factor": lambda f: f"{f.subject} {100.0 * (f['factor'] - 1.0):+.0f} %",
    "sensor offset": _offset,
    "current": lambda f: (
        f"a current of {f['north_m_s']:+.2f} m/s north and {f['east_m_s']:+.2f} m/s east beyond the recorded"
    ),
    "unlogged thrust": lambda f: (
        f"{f.subject} does not produce the thrust that its commands ask for ({f['rms_n']:.2g} N rms beyond"
        f" them, {f['mean_n']:+.2g} N on average)"
    ),
    "errors on logs": lambda f: f"the model's errors on {', '.join(f['logs'])} ({f['windows']} windows)",
    "errors given": lambda _: "the errors given",
    "noise alone": lambda _: "the log's own noise alone, without room for the usual error of a valid model",
}


def notes(verdict: LogVerdict) -> list[str]:
    """Sentences on what was not known."""
    return [_NOTES[remark.kind](remark) for remark in verdict.remarks]


_NOTES: dict[str, Callable[[Finding], str]] = {
    "no reference": lambda _: (
        "No reference was given: the band holds the log's own noise and the coefficients' spread, but not the"
        " usual error of a valid model; give a log on which the model is known to hold."
    ),
    "covariance unknown": lambda _: "The coefficients' covariance is not known: they count as exact.",
    "fit": lambda f: str(f["note"]),
    "no step": lambda f: (
        "The log holds no set-point step that stands until its corridor ends:"
        f" {', '.join(f'{name} ({until:g} s)' for name, until in f['until_s'].items())}."
    ),
}


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
