"""The words of what a log's channels tell of one another: corrections, contradictions, what is missing.

A sentence per kind of finding, or a template of its values. Held by ``tests/inspect/test_consistency.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from seatrial.base.finding import Finding
from seatrial.base.report import Report, Section, Table
from seatrial.inspect.corrections import Consistency, SlowCurrent


def report(consistency: Consistency) -> Report:
    """How well the channels agree, the worst disagreement, what to do; then all proposals."""
    proposed = tuple(correction.sentence for correction in consistency.corrections)
    contradictions = consistency.contradictions
    paste = "; ".join(f"[{correction.table}] {correction.line}" for correction in consistency.corrections[:3])
    outcome, next_step = "consistent", "identify"
    if contradictions:
        outcome, next_step = "contradictory", "correct the column map"
    elif proposed:
        outcome, next_step = f"{len(proposed)} corrections proposed", f"accept with {paste}"
    compared = "; ".join(
        f"{of}: {before:.3g} as recorded, {after:.3g} corrected" for of, before, after in consistency.compared
    )
    current = consistency.current
    return Report(
        title="Consistency of the channels",
        outcome=outcome,
        good=compared or "nothing could be compared",
        worst=next(iter((*contradictions, *proposed)), "no channel contradicts another one"),
        next_step=next_step,
        sections=(
            Section("Proposals", proposed, (correction_table(consistency),)),
            Section("Not to be corrected", contradictions),
            Section("What the log cannot tell", consistency.missing),
            Section("Current", () if current is None else (current_sentence(current),)),
        ),
    )


def correction_table(consistency: Consistency) -> Table:
    """Proposals with value, deviation and effect."""
    rows = [
        (
            f"[{correction.table}] {correction.line}",
            _deviation(correction.sd),
            correction.unit,
            f"{correction.before:.3g}",
            f"{correction.after:.3g}",
            correction.of,
        )
        for correction in consistency.corrections
    ]
    return Table.of("", ("key", "+/-", "unit", "rms before", "after", "of"), rows)


def _deviation(sd: Any) -> str:
    if isinstance(sd, Sequence):
        return ", ".join(_deviation(item) or "-" for item in sd)
    return f"{sd:.2g}" if sd else ""


def current_sentence(current: SlowCurrent) -> str:
    """The current at the beginning and the end, its deviation, source and effect."""
    first, last = current.velocity[0], current.velocity[-1]
    sd = float(np.sqrt(np.mean(current.sd**2)))
    return (
        f"({first[0]:+.3f}, {first[1]:+.3f}) m/s north, east at the beginning, ({last[0]:+.3f},"
        f" {last[1]:+.3f}) m/s at the end (+/- {sd:.3f} m/s), from {current.source}; {current.effect}"
    )


def sentence(finding: Finding) -> str:
    """A finding in words, without its full stop."""
    words = _WORDS[finding.kind]
    text = (
        words.format(subject=finding.subject, **finding.values) if isinstance(words, str) else words(finding)
    )
    given = finding.values.get("given")
    return f"{text}, beyond the {given} that is given" if given else text


def _proposed(finding: Finding) -> str:
    trials = finding["trials"]
    where = f"trial {trials[0]}" if len(trials) == 1 else f"{len(trials)} trials ({', '.join(trials)})"
    span = "" if finding["range"] is None else "; {:.4g} to {:.4g} by trial".format(*finding["range"])
    mean = " (their mean)" if finding["averaged"] else ""
    clocks = (
        "; map.toml of the import proposes the same delay as the clock of"
        f" {', '.join(finding['clocks'])}: accept one of the two"
        if finding["clocks"]
        else ""
    )
    done = " (applied on reading)" if finding["done"] else ""
    return (
        f"{where}: {sentence(finding.root)}{span}; rms of {finding['of']} {finding['before']:.3g} to"
        f" {finding['after']:.3g}: {finding['place']}{mean}{clocks}{done}"
    )


def _current_proposed(finding: Finding) -> str:
    trial = finding.subject
    return (
        f"trial {trial}: a slow current, {current_sentence(finding['current'])}: [trials.{trial}.corrections]"
        " current"
    )


_SENSOR = {"rates": "the gyro", "specific force": "the accelerometer"}


def _follows(finding: Finding) -> str:
    return f" ({finding['follows']})" if finding["follows"] else ""


def _reversed(finding: Finding) -> str:
    weak = "" if finding["certain"] else ", which is no certain sign of it"
    return f"{finding.subject} has the opposite sign of the motion{_follows(finding)}{weak}"


def _exchanged(finding: Finding) -> str:
    minus = "minus " if finding["sign"] < 0.0 else ""
    recorded = f"{minus}{finding['recorded']}{_follows(finding)}"
    return f"{finding.subject} is recorded as {recorded}: axes are exchanged"


def _offset(finding: Finding) -> str:
    return (
        f"the clock of {finding.subject} reads {finding['offset_s']:.3f} s (+/- {finding['sd_s']:.3f} s) at"
        f" time zero of {finding['of'] or 'the attitude'}: its offset and the delay of its"
        f" {finding['group']} sensor, which appear only as this sum"
    )


def _drift(finding: Finding) -> str:
    return (
        f"the clock of {finding.subject} runs {1e6 * finding['rate']:.1f}e-6 (+/-"
        f" {1e6 * finding['sd']:.1f}e-6) fast, {finding['over_log_s']:.3f} s over the log"
    )


def _late(finding: Finding) -> str:
    sensor = _SENSOR.get(finding.subject, f"the {finding.subject}")
    delay = finding["delay_s"]
    word = "late" if delay > 0.0 else "early"
    return f"{sensor} is {abs(delay):.3f} s (+/- {finding['sd_s']:.3f} s) {word} against the attitude"


def _turned(finding: Finding) -> str:
    parts = " and ".join(
        f"{angle:+.2f} deg (+/- {sd:.2f} deg) in {name}"
        for name, (angle, sd) in finding["angles_deg"].items()
    )
    return f"the velocity sensor is turned by {parts}; an offset of the attitude looks alike"


def _beside(finding: Finding) -> str:
    place = ", ".join(f"{x:.2f}" for x in finding["place_m"])
    return f"the velocity sensor sits at ({place}) m from O, as its velocity in turns shows"


def _list(finding: Finding) -> str:
    angle = finding["list_deg"]
    return (
        f"roll is not recorded, but sway and the depth's rate show a mean list of {abs(angle):.2f} deg (+/-"
        f" {finding['sd_deg']:.2f} deg) to {'starboard' if angle > 0.0 else 'port'}"
    )


def _too_still(finding: Finding) -> str:
    pressure = finding["pressure"]
    doubt = f"; a pressure in {pressure} that is read as Pa would do that" if pressure else ""
    return (
        f"{finding.subject}: moves by {finding['moves_m_s']:.2g} m/s rms where velocity and attitude say"
        f" {finding['shown_m_s']:.2g} m/s, {finding['ratio']:.3g} times as much, so the unit of the"
        f" {finding.subject} is wrong, or its sensor is stuck{doubt}; check it in map.toml or the campaign"
    )


def _astray(finding: Finding) -> str:
    rates = " and ".join(f"{name} ({follows})" for name, follows in finding["rates"].items())
    return (
        f"the gyro does not show {rates} of the attitude, and no exchange of axes or reversed sign explains"
        " it; check in map.toml the columns and frames of both, and a quaternion's order"
    )


def _unlike(finding: Finding) -> str:
    channels = " and ".join(f"{channel} ({times:.3g} times)" for channel, times in finding["times"].items())
    return (
        f"{channels}: not as large as the motion says, beyond any scale error of a sensor; check unit and"
        " sign in map.toml or the campaign"
    )


def _opposed(finding: Finding) -> str:
    what, apart = finding.subject, finding["apart_m_s"]
    differ = (
        f"{apart:.3g} m/s rms with the best correction ({finding['recorded_m_s']:.3g} m/s as recorded)"
        if finding["corrected"]
        else f"{apart:.3g} m/s rms, and no delay, tilt or scale of the velocity brings them closer"
    )
    return (
        f"{what} contradict one another: they differ by {differ}, while the"
        f" {what.removesuffix(' and the velocity')} is {finding['motion_m_s']:.3g} m/s rms; check axes, signs"
        " and unit of the velocity in map.toml, and tilt_deg.velocity under [corrections] in the campaign"
    )


def _undated(finding: Finding) -> str:
    fits = " and ".join(f"{delay:.1f} s" for delay in finding["delays_s"])
    return (
        f"the {finding.subject} is not compared: its clock ({finding['clock'] or 'unnamed'}) differs from"
        f" that of the attitude ({finding['reference'] or 'unnamed'}), and offsets of {fits} fit alike,"
        " because the motion that both show is too small or repeats. Take the offset from an event that"
        " both files show and give it under [clocks] in map.toml"
    )


_MISSING = {
    "attitude": "no channel can be compared with another one, and no restoring moment is seen",
    "roll": (
        "it is taken as zero, so that sway leaks into the depth rate, roll coefficients (K_*) cannot be"
        " identified, and a list of the vehicle looks like a tilt of its sensors"
    ),
    "pitch": "the depth rate cannot be compared with the velocity",
    "yaw": "neither course nor current can be told",
    "position": "the heading of the compass and the horizontal scale of the velocity are unchecked",
    "depth": "the pitch tilt of the velocity sensor and its delay are unchecked",
    "velocity over ground": "it is derived from the position, if there is one",
    "velocity through the water": (
        "a current is told only from legs in several headings, and drag is fitted to speeds that are"
        " uncertain by it"
    ),
}

_NO_RATES = (
    "rates are derived from the attitude, which limits them to the attitude's rate and noise; signs and delay"
    " of a gyro cannot be checked"
)

_NO_CURRENT = {
    "channels": "the current needs heading and both horizontal velocities over ground",
    "times": "the current needs velocity and heading at the same times",
    "no leg": "no straight leg under a held command: the current stays unknown",
    "one heading": "legs in one heading only: a current cannot be told from the speed through the water",
    "few samples": "too few samples of legs under a held command: the current stays unknown",
    "uncertain": "the current stays unknown: {source} leave it uncertain by {sd_m_s:.2f} m/s",
}

_WORDS: dict[str, str | Callable[[Finding], str]] = {
    # Corrections.
    "other unit": "the log has {subject} in {unit}: {times:.4g} times as large as the motion says",
    "sign reversed": _reversed,
    "axes exchanged": _exchanged,
    "clock offset": _offset,
    "clock drift": _drift,
    "late sensor": _late,
    "velocity turned": _turned,
    "heading off": (
        "the heading of the attitude is {off_deg:+.1f} deg (+/- {sd_deg:.1f} deg) off the position's frame:"
        " add the difference to the yaw"
    ),
    "velocity beside O": _beside,
    "scale off": "{subject} is {off_percent:+.1f} % (+/- {sd_percent:.1f} %) off in scale",
    "bias": "{subject} is off by {value:+.3g} {unit} (+/- {sd:.2g} {unit})",
    "attitude in degrees": "the attitude is in degrees: its largest angle would be {largest_rad:.3g} rad",
    "frame tilted": (
        "the earth frame of the pose is tilted by {tilt_deg:.1f} deg (+/- {sd_deg:.1f} deg) against gravity,"
        " as the attitude at different headings shows"
    ),
    "correction proposed": _proposed,
    "current proposed": _current_proposed,
    # Contradictions.
    "attitude convention": "{sentence}",
    "angle stuck": (
        "{subject} stays at {rad:.4g} rad while another angle changes, so it is not compared with other"
        " channels: is the sensor stuck? Map the right column, or leave this one out"
    ),
    "pose too still": _too_still,
    "gyro astray": _astray,
    "size unlike": _unlike,
    "velocity opposed": _opposed,
    # What the log does not tell.
    "no motion": "hardly any motion: whether the channels agree cannot be told",
    "not recorded": lambda finding: f"no {finding.subject}: {_MISSING.get(finding.subject, _NO_RATES)}",
    "few samples": "fewer than {fewest} samples of {subject}: not compared with other channels",
    "too little in common": "{subject}: too little in common for a comparison",
    "too little motion": "{subject}: hardly any motion: signs, sizes and delay are not compared",
    "clocks undated": _undated,
    "delay at end": (
        "the delay of the {subject} is not estimated: what fits best, {delay_s:.2f} s, lies at the end of the"
        " range of +/- {reach_s:.2g} s that was searched; compare the clocks of both sensors, and their signs"
    ),
    "specific force": lambda finding: f"specific force: {sentence(finding.root)}",
    "list": _list,
    "clock uncertain": (
        "the clock of {subject} reads {offset_s:.1f} s (+/- {sd_s:.1f} s) against that of the attitude: too"
        " uncertain to be proposed. Take the offset from an event that both files show and give it under"
        " [clocks] in map.toml"
    ),
    "current untold": lambda finding: _NO_CURRENT[finding.subject].format(**finding.values),
}
