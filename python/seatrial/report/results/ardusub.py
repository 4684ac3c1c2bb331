"""The words of an ArduSub log: checks of a replay that are met and why others are not; gains tuned from it.

Held by ``tests/ardusub/test_replay.py`` and ``tests/ardusub/test_from_log.py``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import singledispatch
from pathlib import Path

from seatrial.ardusub.axes import SOUGHT, AxisVerdict
from seatrial.ardusub.comparison import Found, Replay
from seatrial.ardusub.from_log import SETTINGS as TUNING
from seatrial.ardusub.from_log import LogTuning, worst_tail
from seatrial.ardusub.reflight import SETTINGS as REFLIGHT
from seatrial.ardusub.tuning import SPREAD
from seatrial.base.report import Column, Report, Section, Table, listed


@dataclass(frozen=True)
class LogWordsSettings:
    """What of a tuning from a log is worth a sentence."""

    steep: float = 2.0  #: A change beyond so many times the recorded value is made in two steps.
    wide: float = 3.0  #: An envelope tells little beyond this half-width, over the rms of the log.


SETTINGS = LogWordsSettings()

_TRIALS = {
    "roll": "in MANUAL, pulses of roll both ways, 2 s each, then free swinging: at least five, at two"
    " strengths",
    "pitch": "in MANUAL, pulses of pitch both ways, 2 s each, then free swinging: at least five, at two"
    " strengths",
    "yaw": "in MANUAL, a zigzag of yaw at 30 and 60 % of the stick, 20 s each, with free coasting between",
    "depth": "in MANUAL, dives and rises at 30, 60 and 100 % of the throttle, 5 s each, then free coasting",
    "place": "in STABILIZE, runs ahead and sideways both ways at 30, 60 and 100 % of the stick, 8 s each,"
    " then free coasting",
}

_INERTIA_TRIALS = {
    True: "begin with pulses of 1 s at full stick from rest, with attitude and RCOU logged fast"
    " (ATTITUDE_FAST in LOG_BITMASK), and measure the moment of the thrusters with a spring balance at a"
    " known lever; an inertia that you measured belongs into the vehicle file (--vehicle)",
    False: "begin with pulses of 1 s at full stick from rest, and measure the thrust with a bollard pull",
}
"""What tells an inertia, or a mass, from a delay and from the thrust."""

_DOUBTS = {
    "hidden": "not identified, the controller's feedback dominates the log",
    "unmoved": "not identified, the log moves it too little to tell it from its controller",
    "bound": "{} ended at its bound of {:.3g}",
    "draws": "drawn vehicles disagree, apparent mass {:.3g} ± {:.2g}",
    "baseline": "R2 of {} on held-out data {:.2f}, the best baseline {:.2f}",
}
"""What speaks against a judgement of an axis."""


def doubt(axis: str, kind: str, *values: object) -> str:
    """What speaks against a judgement of an axis."""
    return f"{axis}: {_DOUBTS[kind].format(*values)}"


def why_changed(missions: int, costs: tuple[float, float, float], *, at_end: bool) -> str:
    """What a change is worth: costs in s before, after and without it, and whether its range ends there."""
    before, after, without = costs
    end = "; at the end of ArduPilot's range" if at_end else ""
    return (
        f"worst tenth of {missions} missions: out of the corridor for {before:.3f} s before, {after:.3f} s"
        f" after, {without:.3f} s without this change (cost includes missing margins){end}"
    )


def trial(loop: str, *, implausible: bool) -> str:
    """The trial that would tell a loop, where its mass was implausible with what tells that."""
    turns = loop in ("roll", "pitch", "yaw")
    return f"{_TRIALS[loop]}; {_INERTIA_TRIALS[turns]}" if implausible else _TRIALS[loop]


@singledispatch
def report(result: object) -> Report:
    """Report of a replay of ArduSub's controllers, or of a tuning from its log."""
    raise TypeError(f"expected a replay or a tuning from a log, found {type(result).__name__}")


@report.register
def _tuning(tuning: LogTuning) -> Report:
    """Report of a result."""
    good, worst, next_step = _good(tuning), _worst(tuning), _next(tuning)
    outcome = "tuned" if tuning.tuned.changes else "nothing changes"
    if not tuning.held:
        outcome += ", not verified"
    return Report(
        title=Path(tuning.replay.source).name,
        outcome=outcome,
        good=good,
        worst=worst,
        next_step=next_step,
        sections=(
            Section(
                tables=(
                    _changes(tuning),
                    _loops(tuning),
                    _missions(tuning),
                    _margins(tuning),
                    _shares(tuning),
                )
            ),
            Section("What is behind it", _behind(tuning)),
            Section("Identified", (tuning.identified["good"],), (_coefficients(tuning),), details=True),
            *_replay(tuning.replay).sections,
        ),
    )


def _short(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.3g}"


def _share(value: float) -> str:
    return "" if math.isnan(value) else f"{100 * value:.1f}"


def _good(tuning: LogTuning) -> str:
    """What was tuned; first what is missing from the log."""
    missing = tuning.replay.missing
    lacks = f"the log lacks {listed(list(missing))}: its replay cannot be judged whole; " if missing else ""
    return lacks + _judged(tuning)


def _judged(tuning: LogTuning) -> str:
    loops = [verdict.loop for verdict in tuning.verdicts if verdict.judged]
    if not loops:
        return f"{replayed(tuning.replay)}; no loop can be judged by what the log identifies"
    judged = f"{' and '.join(loops)} can be judged by the identified model"
    if not tuning.tuned.changes:
        return f"{judged}; no gains were found that are better than the recorded ones"
    name = tuning.changed_channels[0] if tuning.changed_channels else loops[0]
    before, after = tuning.before.row(name), tuning.after.row(name)
    kept = "margins kept" if tuning.margins_kept else "margins not kept"
    changes = listed([f"{change.name} {change.before:g} to {change.after:g}" for change in tuning.changes])
    return (
        f"{judged}; worst corridor violation of {name} over {tuning.missions} missions {before[0]:.2f} s"
        f" before, {after[0]:.2f} s after, in the corridor {100 * before[2]:.0f} % and {100 * after[2]:.0f} %"
        f" of them; {changes}, {kept}"
    )


def _harm(tuning: LogTuning) -> list[str]:
    """What got worse, in words."""
    words = []
    for name in tuning.before.violations:
        worst = tuning.before.worst(name), tuning.after.worst(name)
        tail = worst_tail(tuning.before, name), worst_tail(tuning.after, name)
        if (
            worst[1] > TUNING.no_worse_ratio * worst[0] + 0.01
            or tail[1] > TUNING.no_worse_ratio * tail[0] + 0.01
        ):
            words.append(
                f"the worst violation of {name} goes from {worst[0]:.2f} to {worst[1]:.2f} s, the mean of the"
                f" worst tenth from {tail[0]:.2f} to {tail[1]:.2f} s"
            )
    return words


def _worst(tuning: LogTuning) -> str:
    if not tuning.replay.held:
        return worst_replayed(tuning.replay)
    stays = _stays(tuning)
    if not tuning.margins_kept:
        return "the margins of a loop that changes fall below those before; see the table of margins"
    out = [share for share in tuning.reflight.shares if not share.inside]
    words = _harm(tuning)
    if out:
        share = max(out, key=lambda each: each.fit if math.isnan(each.held_out) else each.held_out)
        outside = share.fit if math.isnan(share.held_out) else share.held_out
        words.append(
            f"the {share.channel} error of the log is outside the envelope in {100 * outside:.0f} % of the"
            f" held-out rows, expected at most {100 * REFLIGHT.accepted_outside_share:.0f} %"
        )
    if stays:
        words.append(
            f"{listed([verdict.loop for verdict in tuning.verdicts if not verdict.judged])} stay as flown:"
            f" the log does not tell these loops ({stays[0].loop}: {stays[0].why})"
        )
    if steep := [
        change
        for change in tuning.changes
        if change.before > 0.0 and change.after > SETTINGS.steep * change.before
    ]:
        named = listed([f"{change.name} to {change.after / change.before:.1f} times" for change in steep])
        words.insert(0, f"a large change rests on one log: {named} the recorded value; load half of it first")
    words += [
        f"{change.name} is at the end of ArduPilot's range"
        for change in tuning.changes
        if change.bounds is not None and change.after > 0.95 * change.bounds[1]
    ]
    return "; ".join(words) or "nothing stands out"


def _stays(tuning: LogTuning) -> list[AxisVerdict]:
    """Loops that stay as flown, those with an implausible mass first, else the last, position, first."""
    return sorted(
        (verdict for verdict in reversed(tuning.verdicts) if not verdict.judged),
        key=lambda v: not v.implausible,
    )


def _next(tuning: LogTuning) -> str:
    stays = _stays(tuning)
    load = (
        "load changes.param and fly a yaw step before a mission"
        if tuning.tuned.changes and tuning.held
        else ""
    )
    trial = f"for {stays[0].loop}: {stays[0].trial}; then run this again" if stays else ""
    return "; ".join(step for step in (load, trial) if step) or "fly the vehicle and replay its next log"


def _changes(tuning: LogTuning) -> Table:
    columns = ("parameter", "before", "after", "from", "to", Column("why", align="left"))
    rows = [
        (
            change.name,
            _short(change.before),
            _short(change.after),
            *(_short(x) for x in change.bounds or (math.nan,) * 2),
            change.why,
        )
        for change in tuning.changes
    ]
    return Table.of("Parameters that change (changes.param)", columns, rows, left=1)


def _loops(tuning: LogTuning) -> Table:
    columns = ("loop", "judged", Column("why", align="left"), Column("trial that would tell", align="left"))
    rows = [
        (verdict.loop, "yes" if verdict.judged else "no", verdict.why, verdict.trial)
        for verdict in tuning.verdicts
    ]
    return Table.of("Loops that the identified model can judge", columns, rows, left=1)


def _missions(tuning: LogTuning) -> Table:
    head = ("step", "worst before, s", "after", "95 % before, s", "after", "in corridor before, %", "after")
    rows = []
    for name in tuning.before.violations:
        before, after = tuning.before.row(name), tuning.after.row(name)
        rows.append((
            name, _short(before[0]), _short(after[0]), _short(before[1]), _short(after[1]), _share(before[2]),
            _share(after[2]),
        ))  # fmt: skip
    return Table.of(f"Corridor violation over {tuning.missions} missions", head, rows, left=1)


def _margins(tuning: LogTuning) -> Table:
    head = ("loop", "", "phase, deg", "gain, dB", "sensitivity", "accepted")
    rows = [
        (
            loop,
            when,
            f"{margins.phase_deg:.0f}",
            f"{margins.gain_db:.1f}",
            f"{margins.sensitivity:.2f}",
            "yes" if margins.accepted else "no",
        )
        for loop, both in tuning.tuned.margins.items()
        for when, margins in zip(("before", "after"), both, strict=True)
    ]
    return Table.of("Least margins over drawn vehicles", head, rows, left=2)


def _shares(tuning: LogTuning) -> Table:
    head = (
        "loop error",
        "unit",
        "rms of the log",
        "half-width",
        "outside, fit, %",
        "outside, held out, %",
        "rows",
        "inside",
    )
    rows = [
        (
            share.channel, share.unit, _short(share.rms), _short(share.width), _share(share.fit),
            _share(share.held_out), str(share.rows), "yes" if share.inside else "no",
        )
        for share in tuning.reflight.shares
    ]  # fmt: skip
    return Table.of("The log's mission flown again: errors outside the envelope of 95 %", head, rows, left=2)


def _behind(tuning: LogTuning) -> tuple[str, ...]:
    rig, wander = tuning.reflight.rig, tuning.reflight.wander
    assumed = [
        name for name in tuning.assumed if not name.endswith(("_FF", "_FLTD", "_FLTE")) and "RATE" not in name
    ]
    sought = {name for loop in SOUGHT.values() for name in loop}
    statements = [
        f"Disturbances estimated from the fitted part: steady wrench {_short(rig.steady[2])} N down,"
        f" {', '.join(_short(x) for x in rig.steady[3:])} N m in roll, pitch, yaw; a wandering wrench of"
        f" {', '.join(_short(x) for x in wander[:3])} N and {', '.join(_short(x) for x in wander[3:])} N m"
        f" with a time constant of {rig.wander_s:g} s; current {_short(float(tuning.reflight.current[0]))}"
        f" m/s north, {_short(float(tuning.reflight.current[1]))} m/s east.",
        f"Drawn: vehicle from the covariance, current up to {SPREAD.current_m_s:g} m/s, tether up to"
        f" {SPREAD.tether_n:g} N, thrust at the beginning from {100 * SPREAD.battery:.0f} % (battery), up to"
        f" {100 * SPREAD.fall:.0f} % lost on the way and {100 * SPREAD.sag:.0f} % at full load, and the"
        " wandering wrench that was found.",
        "The missions judge the loops under the model that the log identified: its errors affect the results"
        " before and after the changes alike.",
    ]
    for share in tuning.reflight.shares:
        if share.width > SETTINGS.wide * share.rms:
            statements.append(
                f"The envelope of {share.channel} is {share.width / share.rms:.0f} times as wide as the log's"
                " rms: staying inside it proves little."
            )
    if assumed:
        statements.append(
            f"Neither log nor file has {', '.join(assumed)}: ArduSub's defaults are assumed; give"
            " --parameters."
        )
    if hidden := sorted(sought & set(assumed)):
        statements.append(f"Of these, tuning can change {', '.join(hidden)} if their loop can be judged.")
    return tuple(statements)


def _coefficients(tuning: LogTuning) -> Table:
    rows = [
        (
            name, _short(coefficient["start"]), _short(coefficient["estimate"]),
            "" if coefficient["sigma"] is None else _short(coefficient["sigma"]),
            coefficient["at_bound"] or "",
        )
        for name, coefficient in tuning.identified["coefficients"].items()
    ]  # fmt: skip
    return Table.of("Coefficients", ("coefficient", "start", "estimate", "sd", "at bound"), rows, left=1)


@report.register
def _replay(replay: Replay) -> Report:
    """How many checks are met, the worst, what to do; tables."""
    problem = worst_replayed(replay)
    against = replay.against()
    # A file that the vehicle does not fly with outweighs any check.
    apart = [(each, own) for each, own, agrees in against if not agrees]
    if apart:
        differ = ", ".join(f"{_value(each)} for {own:g}" for each, own in apart[:4])
        file = replay.given.source if replay.given else ""
        problem = f"{len(apart)} parameters found differ from {file}: {differ}"
    if replay.missing:
        next_step = (
            f"log {listed(list(replay.missing))} as well (LOG_BITMASK: attitude, PID, control tuning, RC"
            " input and output), and replay the next dive"
        )
    elif not replay.held:
        next_step = "look at the check that is not met in the figure: where does it begin?"
    elif apart:
        next_step = "find out which is right: was the file written by this vehicle before this dive?"
    elif against:
        next_step = "identify the vehicle from the same log: seatrial import LOG --out PROJECT"
    else:
        next_step = "compare the parameters found with the vehicle's own: --parameters FILE"
    return Report(
        title=Path(replay.source).name,
        outcome="replayed" if replay.held else "replayed in part" if replay.checks[0] else "not replayed",
        good=replayed(replay),
        worst=problem,
        next_step=next_step,
        sections=(
            Section(tables=(_checks(replay), _parameters(replay))),
            Section("What is left, and why", _reasons(replay), details=True),
            Section("Notes", replay.notes, details=True),
        ),
    )


def replayed(replay: Replay) -> str:
    """How many checks are met; first what is missing from the log."""
    met, owed = replay.checks
    count = f"{met} of {owed} checks are what ArduSub's law makes of the logged inputs"
    if replay.missing:
        whole = [name for name in replay.missing if name not in replay.partly]
        parts = [(whole, "missing from the log"), (list(replay.partly), "missing for part of the log")]
        lacks = " and ".join(
            f"{listed(names)} {'is' if len(names) == 1 else 'are'} {what}" for names, what in parts if names
        )
        lost = sum(bool(gap.topic) for gap in replay.impossible)
        return f"{lacks}, so that {lost} check{'s' if lost > 1 else ''} cannot be made; {count}"
    return f"{count}; {len(replay.found)} parameters found"


def worst_replayed(replay: Replay) -> str:
    """The first check that is not met, else one that could not be made, else the first note."""
    wrong = [quantity for quantity in replay.quantities if not quantity.holds]
    if wrong:
        # The first in the order of the signal: what comes after it may follow from it.
        first, more = wrong[0], len(wrong) - 1
        others = f"; {more} more {'is' if more == 1 else 'are'} not met" if more else ""
        return (
            (
                f"{first.controller}, {first.name}: replayed within {_digits(first.p95)} {first.unit} in"
                f" 95 % of the rows, expected {_digits(first.limit)} {first.unit}"
            )
            + (f" ({first.why})" if first.why else "")
            + others
        )
    if replay.impossible:
        gap = next((each for each in replay.impossible if not each.topic), replay.impossible[0])
        return f"{gap.controller}, {gap.name}: {gap.why}"
    return replay.notes[0] if replay.notes else "nothing stands out"


def _digits(value: float) -> str:
    return f"{value:.3g}"


def _checks(replay: Replay) -> Table:
    """Table of all checks; those that could not be made last."""
    rows = [
        (
            each.controller, each.name, each.unit, str(len(each.error)), _digits(each.rms),
            _digits(each.p95), _digits(each.limit), "yes" if each.holds else "no",
        )
        for each in replay.quantities
    ]  # fmt: skip
    rows += [(gap.controller, gap.name, "", "0", "", "", "", "cannot tell") for gap in replay.impossible]
    head = ("controller", "quantity", "unit", "rows", "rms", "p95 error", "limit", "right")
    return Table.of("Logged and replayed", head, rows, left=3)


def _parameters(replay: Replay) -> Table:
    """Table of the parameters found."""
    own = {each.name: (f"{value:g}", "yes" if agrees else "no") for each, value, agrees in replay.against()}
    rows = [
        (
            each.name, f"{each.bound} {each.value:.4g}".strip(), "" if math.isnan(each.sd) else
            f"{each.sd:.1g}", *own.get(each.name, ("", "")), each.how,
        )
        for each in replay.found
    ]  # fmt: skip
    columns = ("parameter", "value", "sd", "given", "agrees", Column("found from", align="left"))
    return Table.of("Parameters found", columns, rows, left=1)


def _reasons(replay: Replay) -> tuple[str, ...]:
    """Why checks are not met, or cannot be made."""
    reasons = [f"{each.controller}, {each.name}: {each.why}." for each in replay.quantities if each.why]
    reasons += [f"{gap.controller}, {gap.name}: {gap.why}." for gap in replay.impossible]
    return tuple(dict.fromkeys(reasons))


def _value(parameter: Found) -> str:
    """Name and value of a parameter, or its bound."""
    return " ".join(part for part in (parameter.name, parameter.bound, _digits(parameter.value)) if part)
