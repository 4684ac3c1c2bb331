"""What readers and checks find in recordings, in words, and the report on how well channels agree.

`note`: what reading a log left out or assumed. `message`: what reading a trial found about a channel.
`sentence`: what channels tell of one another. `problem` and `remedy`: what spoils a trial.

Held by ``tests/logs/test_logs.py``, ``tests/inspect/test_wiring.py``, ``tests/inspect/test_consistency.py``
and ``tests/inspect/test_consistency_trials.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from seatrial.base.errors import printable
from seatrial.base.finding import Finding, Severity
from seatrial.base.report import Report, Section, Table, listed
from seatrial.inspect.corrections import Consistency, SlowCurrent
from seatrial.logs.delimited import shared_name
from seatrial.logs.names import KNOWN_UNITS
from seatrial.report.results.phrases import Phrases, filled, templates
from seatrial.trial.signals import RecordingFinding

_THEME = "trial_findings"

# What reading a log left out or assumed.

note = Phrases(
    _THEME, "note", {"lacking": lambda n: "an attitude" if n == 3 else "all of north, east and down"}
)
"""A note of a reader, a clause."""


@note.of("bytes lost")
def _bytes_lost(finding: Finding) -> str:
    """How much is no whole message; in how many places, where and since when, as far as the reader knows."""
    lost, size, places = finding["lost"], finding["size"], finding["places"]
    since = finding.values.get("since_s", math.nan)
    after = f" ({since:.1f} s after the start of the autopilot)" if math.isfinite(since) else ""
    if "longest" in finding.values:
        where = f"from byte {finding['byte']:,} on{after}"
        if places > 1:
            where = f"in {places:,} places, the longest of {finding['longest']:,} bytes {where}"
    else:
        where = f"in {places:,} place{'s' if places > 1 else ''}"
        where += f", the first from byte {finding['byte']:,} on" if "byte" in finding.values else ""
    what = "are damaged" if finding["records"] else "are no whole messages"
    share = f"{lost:,} of {size:,} bytes ({100.0 * lost / size:.2g} %)"
    return f"{share} {what}, {where}; they were skipped, the others read"


@note.of("names shared")
def _names_shared(finding: Finding) -> str:
    called = ", ".join(f'"{printable(name)}"' for name in finding["called"])
    shared = shared_name(finding.subject, finding["places"])
    return f"{shared}; here they are called {called}: rename them in the file"


@note.of("depth")
def _depth(finding: Finding) -> str:
    surface = {
        "lowest": "the lowest one is taken for the surface",
        "gauge": f"less than the air's, {finding['lowest_pa']:.3g} Pa, so taken as above it",
    }.get(finding["surface"], f"{finding['surface_pa']:g} Pa is the surface")
    density = f"{finding['rho_kg_m3']:g} kg/m3; in fresh water depths are 2.5 % more"
    return f"depth from pressure: {surface}, {density}"


@note.of("pressure too small")
def _small_pressure(finding: Finding) -> str:
    depth = finding["depth_m"]
    guesses = ", ".join(f"{size * depth:.3g} m if {unit}" for unit, size in finding["units"].items())
    return (
        f"pressures reach {finding['highest_pa']:.3g} Pa, {depth:.2g} m of water: expected a pressure in Pa,"
        f" found one in another unit ({guesses}); give its unit in map.toml"
    )


@note.of("unit not known")
def _unit_not_known(finding: Finding) -> str:
    values = {**finding.values, "subject": finding.subject, "known": KNOWN_UNITS}
    return note.fill("unit not known", **values)


# What spoils a trial.

problem = Phrases(_THEME, "problem")
"""The problem, a clause; it names the trial where the finding does."""

remedy = Phrases(_THEME, "remedy")
"""What to do about a finding."""


@problem.of("wiring")
def _wiring(finding: Finding) -> str:
    reversed_, faults = finding["reversed"], []
    if reversed_:
        acts = "act against their signs" if len(reversed_) > 1 else "acts against its sign"
        faults.append(f"{listed(reversed_)} {acts}")
    faults += [f"{a} and {b} act in one another's place" for a, b in finding["exchanged"]]
    shares = ", ".join(
        f"{100.0 * after:.0f} % instead of {100.0 * max(before, 0.0):.0f} % of {axis}"
        for axis, (before, after) in finding["explained"].items()
    )
    trial = f"trial {finding.subject}: " if finding.subject else ""
    return (
        f"{trial}wiring: {' and '.join(faults)}: so the commands explain {shares} beyond damping"
        f" (log-likelihood {finding['evidence']:.0f} higher)"
    )


@remedy.of("wiring")
def _wiring_remedy(finding: Finding) -> str:
    reversed_, cures = finding["reversed"], []
    if reversed_:
        these = "these actuators" if len(reversed_) > 1 else "this actuator"
        columns = listed([f"cmd.{name}" for name in reversed_])
        cures.append(
            f"toggle the key reversed of {these} in the vehicle file, or give sign = -1 to {columns} in the"
            " column map"
        )
    cures += [
        f"exchange the columns of cmd.{a} and cmd.{b} in the column map" for a, b in finding["exchanged"]
    ]
    return f"{' and '.join(cures)}; check in the water"


# What reading a trial found about a channel.

_masked = Phrases(_THEME, "masked")
"""Why samples are masked, a clause of each kind."""

_cause = Phrases(_THEME, "cause")
"""The same of kinds of which a message says more than that."""

_message = Phrases(
    _THEME,
    "message",
    {
        "hertz": lambda step_s: f"{1.0 / step_s:.3g} Hz",
        "origin": lambda origin: "the attitude" if origin == ("attitude",) else "position and attitude",
    },
)


def message(finding: RecordingFinding) -> str:
    """What reading found about a channel, to follow its name and the number of samples that it concerns."""
    if finding.kind in _masked.kinds:
        after = "the value before is held" if finding.values.get("held") else "masked"
        return f"{_masked(finding)}; {after}"
    return _message(finding)


@_message.of("mostly masked")
def _mostly_masked(finding: RecordingFinding) -> str:
    cause, why = finding.cause, "missing samples"
    if isinstance(cause, RecordingFinding):
        words = _cause if cause.kind in _cause.kinds else _masked
        why = f"{cause.count or ''} {words(cause)} ({cause.subject})".strip()
    return (
        f"{100.0 * finding['share']:.0f} % of the samples are masked, most of them for {why}; look at these"
        " samples, and give another column or a part of the log if they are wrong"
    )


@_message.of("attitude convention")
def _convention(finding: RecordingFinding) -> str:
    return f"{convention(finding.values)}; left as recorded"


def convention(finding: Mapping[str, Any]) -> str:
    """The convention that an attitude has instead of the one mapped, and what to write in the column map."""
    faults = []
    if finding["scalar_last"]:
        faults.append(
            "its four columns hold x y z w, the scalar last (give q_x the column of q_w, q_y that of q_x, q_z"
            " that of q_y, and q_w that of q_z)"
        )
    if finding["inverse"]:
        faults.append("it turns the earth into the body (give sign = -1 to q_x, q_y and q_z)")
    if finding["frames"]:
        named = " or ".join(f'frame = "{frame}"' for frame in finding["frames"])
        faults.append(f"its axes have z up (give {named} to each column of the attitude)")
    gyro = ', or the gyro has them (give frame = "FLU" to p_deg_s, q_deg_s and r_deg_s)'
    return (
        f"the attitude has another convention than the map says: {', and '.join(faults)}"
        f"{gyro if finding['gyro_instead'] else ''}; so it explains {100.0 * finding['share']:.0f} % of the"
        f" motion that gyro and velocity show, and {100.0 * finding['before']:.0f} % as mapped"
    )


@_message.of("unit changes")
def _unit_changes(finding: RecordingFinding) -> str:
    larger, factor = finding["larger"], finding["factor"]
    before, after = finding["units"] if larger else finding["units"][::-1]
    several = "s" if len(finding.subject.split()) > 1 else ""
    return (
        f"the unit changes within the channel{several}: from row {finding['row']} (t ="
        f" {finding['t_s']:.6g} s) on, values are {factor if larger else 1.0 / factor:.3g} times"
        f" {'larger' if larger else 'smaller'}, as {after} after {before} would be"
        f" ({finding['ratio']:.4g} times); convert one part, or cut the recording there into two trials, each"
        " with its unit"
    )


@_message.of("current derived")
def _current(finding: RecordingFinding) -> str:
    numbers = ", ".join(
        f"{name} {mean:+.3f} (+/- {sd:.3f})"
        for name, mean, sd in zip(("north", "east", "down"), finding["mean"], finding["sd"], strict=True)
    )
    manner = "steady" if finding["steady"] else "changing, its mean"
    words = f"{manner} {numbers} m/s, from velocity over ground less that through water"
    doubt = "; the velocities do not agree on one current: check sign, unit and frame of both"
    return f"{words}{doubt}" if finding.severity > Severity.NOTE else words


# What channels tell of one another.

_sensors = {"rates": "the gyro", "specific force": "the accelerometer"}

_words = Phrases(
    _THEME,
    "sentence",
    {
        "cost": lambda channel: templates(_THEME)["missing"].get(
            channel, templates(_THEME)["missing"]["rates"]
        ),
        "millionths": lambda rate: f"{1e6 * rate:.1f}e-6",
        "sensor": lambda channel: _sensors.get(channel, f"the {channel}"),
        "without velocity": lambda names: names.removesuffix(" and the velocity"),
    },
)


def sentence(finding: Finding) -> str:
    """A finding in words, without its full stop."""
    text, given = _words(finding), finding.values.get("given")
    return f"{text}, beyond the {given} that is given" if given else text


@_words.of("correction proposed")
def _proposed(finding: Finding) -> str:
    trials = finding["trials"]
    where = f"trial {trials[0]}" if len(trials) == 1 else f"{len(trials)} trials ({', '.join(trials)})"
    span = "" if finding["range"] is None else "; {:.4g} to {:.4g} by trial".format(*finding["range"])
    return f"{where}: {sentence(finding.root)}{span}; {_words.fill('effect', **finding.values)}"


@_words.of("current proposed")
def _current_proposed(finding: Finding) -> str:
    trial, current = finding.subject, current_sentence(finding["current"])
    return f"trial {trial}: a slow current, {current}: [trials.{trial}.corrections] current"


@_words.of("specific force")
def _specific_force(finding: Finding) -> str:
    return f"specific force: {sentence(finding.root)}"


@_words.of("current untold")
def _current_untold(finding: Finding) -> str:
    return filled(templates(_THEME)["no current"][finding.subject], finding.values)


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
            f"[{each.table}] {each.line}",
            _deviation(each.sd),
            each.unit,
            f"{each.before:.3g}",
            f"{each.after:.3g}",
            each.of,
        )
        for each in consistency.corrections
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
