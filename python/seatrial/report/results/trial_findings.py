"""What readers and checks find in recordings, in words, and the report on how well channels agree.

`note`: what reading a log left out or assumed. `message`: what reading a trial found about a channel.
`sentence`: what channels tell of one another. `problem` and `remedy`: what spoils a trial. `warnings`,
`done`, `windows`, `verdict`: what kind of data a trial is, what was done in it, what to hold out.

Held by ``tests/logs/test_logs.py``, and in ``tests/inspect`` by ``test_wiring.py``, ``test_consistency.py``,
``test_consistency_trials.py``, ``test_kind_of_data.py``, ``test_manoeuvres.py``, ``test_trial_windows.py``
and ``test_verdict.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from seatrial.base.channels import CHANNELS, MOTIONS, readable
from seatrial.base.errors import printable
from seatrial.base.finding import Finding, Severity
from seatrial.base.report import Report, Section, Table, listed, words_of
from seatrial.inspect.corrections import Consistency, SlowCurrent
from seatrial.inspect.feedback import Feedback
from seatrial.inspect.kind_of_data import BANDS_HZ, Contact, Excitation, KindOfData, Saturation, TrialWindows
from seatrial.inspect.manoeuvres import Manoeuvre, counted
from seatrial.inspect.verdict import Verdict
from seatrial.inspect.waves import Waves
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


def warnings(kind: KindOfData) -> list[str]:
    """What spoils the data, the worst first, with what to do about it."""
    touching = [
        f"{contact.sentence}. Leave this part out: split the trial or hold it out"
        for contact in kind.contacts
    ]
    dominated = [verdict.sentence for verdict in kind.verdicts if verdict.dominated]
    problems = [*map(words_of, kind.impossible), *touching, *dominated]
    return problems + _loops(kind.loops) + _waves(kind.waves) + _saturated(kind.saturated)


def done(kind: KindOfData) -> str:
    """What was done and what moved, in a sentence."""
    moved = ", ".join(axis.channel for axis in kind.excitation if not axis.weak)
    return f"{counted(kind.manoeuvres) or 'no manoeuvre found'}; {moved or 'nothing'} moved clearly"


def _loops(loops: Sequence[Feedback]) -> list[str]:
    if not loops:
        return []
    follows = "; ".join(
        f"{loop.command} follows {loop.channel} ({100.0 * loop.explained:.0f} % of its changes)"
        for loop in sorted(loops, key=lambda loop: -loop.explained)
    )
    return [
        f"recorded in closed loop: {follows}. A fit on such data may bias gains and damping, and its score"
        " also rates the controller: add a trial with preset steps of these commands"
    ]


def _waves(swell: Waves | None) -> list[str]:
    if swell is None:
        return []
    sizes = ", ".join(f"{c} {readable(c)[0] * a:.2g} {readable(c)[1]}" for c, a in swell.amplitude.items())
    if not swell.line:
        return [
            f"motion about a period of {swell.period_s:.1f} s (amplitude {sizes}) that a crude regression on"
            " state and commands leaves unexplained: perhaps waves, which a model takes for its own error,"
            " perhaps motion that the vehicle's model explains. In calm water ignore it"
        ]
    return [
        f"an oscillation with a period of {swell.period_s:.1f} s, as of waves (amplitude {sizes}), which"
        " no command explains; the model takes it for its own error"
    ]


def _saturated(saturated: Sequence[Saturation]) -> list[str]:
    if not saturated:
        return []
    parts = ", ".join(
        f"{command.command} at {command.limit:g} in {100.0 * command.share:.0f} %" for command in saturated
    )
    return [
        f"commands at their limits, where the loop is open and the motor tells no more: {parts} of the time"
    ]


def excitation(axis: Excitation) -> str:
    """Size, noise and main band of a velocity."""
    factor, unit = readable(axis.channel)
    low, high = BANDS_HZ[int(np.argmax(axis.shares))]
    band = f"above {low:g} Hz" if np.isinf(high) else f"from {low:g} to {high:g} Hz"
    noise = f"{axis.over_noise:.0f} times its noise" if axis.over_noise < 200.0 else "far above its noise"
    share = f"{100.0 * max(axis.shares):.0f} % of it {band}"
    return f"{axis.channel}: rms {factor * axis.rms:.2g} {unit}, {noise}, {share}"


def contact(part: Contact) -> str:
    """Where a vehicle was pushed and did not move, and what may have held it."""
    mean = part.values["mean"]
    way = {"X": ("ahead", "astern"), "Y": ("to starboard", "to port"), "Z": ("down", "up")}[part.axis]
    pushed = f"pushed {way[mean < 0.0]} by {abs(mean):.2g} {part.values['unit']}"
    words = f"from {part.start_s:.0f} to {part.end_s:.0f} s {pushed}"
    if (depth := part.values["depth_m"]) is not None:
        where = "the bottom" if mean > 0.0 else "the surface"
        return f"{words} at a constant depth of {depth:.1f} m: {where}, or a taut tether"
    moved = CHANNELS["XYZ".index(part.axis)]
    return f"{words} without motion in {moved}: a taut tether or a wall"


def windows(proposed: TrialWindows) -> str:
    """What to hold out of a trial and why, or why nothing."""
    use = proposed.use
    if proposed.why == "short":
        return f"{use[1] - use[0]:.0f} s with motion are too short to split: hold out another trial"
    if proposed.why == "moves once":
        return (
            "the vehicle moves in one stretch only, which cannot be in both parts, and a part that moves"
            " nothing tells nothing: hold out another trial"
        )
    if proposed.hold_out is None:
        first, last = proposed.driven
        return (
            f"the commands change in one stretch only, {first:.0f} to {last:.0f} s, which cannot be in both"
            " parts: hold out another trial"
        )
    part, (both, recurring) = proposed.hold_out, proposed.kept
    words = "no kind of manoeuvre recurs"
    if recurring:
        words = f"{both} of {recurring} recurring kinds of manoeuvres in both parts"
    share = (min(part[1], use[1]) - max(part[0], use[0])) / (use[1] - use[0])
    return (
        f"hold out {part[0]:.10g} to {part[1]:.10g} s ({100.0 * share:.0f} %): {words}, and it moves"
        f" {proposed.effort:.1f} times as much as the rest"
    )


def verdict(judged: Verdict) -> str:
    """Whether a recording tells how an axis answers its commands, with the evidence."""
    who = f"{MOTIONS[judged.axis]} ({judged.axis})"
    if judged.kind == "open":
        return f"{who} is in open loop: no feedback was detected in its commands"
    share = f"{100.0 * max(judged.told, 0.0):.0f} % of the motion"
    waves = math.isfinite(judged.wave_period_s)
    if judged.kind == "closed and informative":
        return (
            f"{who} is in closed loop but informative: commands independent of feedback drive"
            f" {share}{'' if waves else ', and no waves were seen'}"
        )
    by = f" in waves of {judged.wave_period_s:.1f} s" if waves else ""
    verb = "follows" if len(judged.commands) == 1 else "follow"
    return (
        f"{who} is dominated by feedback: {', '.join(judged.commands)} {verb} the motion{by}, and commands"
        f" independent of feedback drive only {share}; this log does not determine how the axis responds"
    )


TRIAL = (
    "run seatrial plan with the campaign of this log: it proposes a dither on top of the autopilot that makes"
    " the axis identifiable"
)
"""The trial that tells an axis which feedback dominates."""


def manoeuvre(part: Manoeuvre) -> str:
    """All of a manoeuvre."""
    return _MANOEUVRES[part.kind](part)


def _span(part: Manoeuvre) -> str:
    return f"from {part.start_s:.0f} to {part.end_s:.0f} s"


def _step(part: Manoeuvre) -> str:
    axis = part.values["axis"]
    drive = f"the {MOTIONS[axis]} {'force' if axis in 'XYZ' else 'moment'}" if axis else part.by
    # Levels to a hundredth of the drive's range.
    digits = max(0, 2 - int(np.floor(np.log10(max(part.values["range"], 1e-12)))) - 1)
    before, after = (f"{round(part.values[k], digits) + 0.0:.{digits}f}" for k in ("before", "after"))
    unit = f" {part.unit}" if part.unit else ""
    return (
        f"step of {drive} from {before} to {after}{unit} at {part.start_s:.0f} s, held for"
        f" {part.end_s - part.start_s:.0f} s"
    )


def _run(part: Manoeuvre) -> str:
    low, high = part.values["low"], part.values["high"]
    speed = f"{low:.2f} to {high:.2f}" if high - low > 0.1 * high else f"{0.5 * (low + high):.2f}"
    return f"straight run at {speed} m/s {_span(part)}"


def _dive(part: Manoeuvre) -> str:
    return f"{part.kind} from {part.values['from_m']:.1f} to {part.values['to_m']:.1f} m depth {_span(part)}"


def _stay(part: Manoeuvre) -> str:
    return f"{part.kind} {_span(part)}"


_MANOEUVRES: dict[str, Callable[[Manoeuvre], str]] = {
    "step": _step,
    "coast-down": lambda m: (
        f"coast-down of {MOTIONS[m.by]} from {m.size:.2g} to {m.values['last']:.2g} {m.unit}"
        f" in {m.end_s - m.start_s:.0f} s from {m.start_s:.0f} s on"
    ),
    "zigzag": lambda m: f"zigzag of {m.values['swings']} swings of about {m.size:.0f} deg {_span(m)}",
    "turn": lambda m: (
        f"turn of {abs(m.size):.0f} deg to {'starboard' if m.size > 0.0 else 'port'} {_span(m)}"
    ),
    "dive": _dive,
    "rise": _dive,
    "decay": lambda m: (
        f"free decay of {'roll' if m.by == 'K' else 'pitch'} from {m.size:.0f} deg with"
        f" {m.values['extremes']} extremes from {m.start_s:.0f} s on"
    ),
    "straight run": _run,
    "station-keeping": _stay,
    "rest": _stay,
}
