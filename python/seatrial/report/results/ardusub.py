"""The words of an ArduSub vehicle's tuning: gains found, what they change in its missions, what to load."""

from __future__ import annotations

import math
from pathlib import Path

from seatrial.ardusub.axes import SOUGHT, AxisVerdict
from seatrial.ardusub.reflight import ACCEPTED_OUTSIDE
from seatrial.ardusub.result import NO_WORSE, LogTuning, worst_tail
from seatrial.ardusub.tuning import Spread
from seatrial.base.report import Column, Report, Section, Table, listed

_STEEP = 2.0  # times the recorded value, beyond which a change is made in two steps


_WIDE = 3.0  # half-width over the rms of the log beyond which an envelope tells little


def report(found: LogTuning) -> Report:
    """Report of a result."""
    good, worst, next_step = _good(found), _worst(found), _next(found)
    outcome = "tuned" if found.tuned.changes else "nothing changes"
    if not found.held:
        outcome += ", not verified"
    return Report(
        title=Path(found.replay.source).name,
        outcome=outcome,
        good=good,
        worst=worst,
        next_step=next_step,
        sections=(
            Section(
                tables=(_changes(found), _loops(found), _missions(found), _margins(found), _shares(found))
            ),
            Section("What is behind it", _behind(found)),
            Section("Identified", (found.identified["good"],), (_coefficients(found),), details=True),
            *found.replay.report().sections,
        ),
    )


def _short(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.3g}"


def _share(value: float) -> str:
    return "" if math.isnan(value) else f"{100 * value:.1f}"


def _good(found: LogTuning) -> str:
    """What was tuned; first what is missing from the log."""
    missing = found.replay.missing
    lacks = f"the log lacks {listed(list(missing))}: its replay cannot be judged whole; " if missing else ""
    return lacks + _judged(found)


def _judged(found: LogTuning) -> str:
    loops = [one.loop for one in found.verdicts if one.judged]
    if not loops:
        return f"{found.replay.good()}; no loop can be judged by what the log identifies"
    told = f"{' and '.join(loops)} can be judged by the identified model"
    if not found.tuned.changes:
        return f"{told}; no gains were found that are better than the recorded ones"
    name = found.changed_channels[0] if found.changed_channels else loops[0]
    before, after = found.before.row(name), found.after.row(name)
    kept = "margins kept" if found.margins_kept else "margins not kept"
    return (
        f"{told}; worst corridor violation of {name} over {found.missions} missions {before[0]:.2f} s before,"
        f" {after[0]:.2f} s after, in the corridor {100 * before[2]:.0f} % and {100 * after[2]:.0f} % of"
        f" them; {listed([f'{one.name} {one.before:g} to {one.after:g}' for one in found.changes])}, {kept}"
    )


def _harm(found: LogTuning) -> list[str]:
    """What got worse, in words."""
    words = []
    for name in found.before.violations:
        worst = found.before.worst(name), found.after.worst(name)
        tail = worst_tail(found.before, name), worst_tail(found.after, name)
        if worst[1] > NO_WORSE * worst[0] + 0.01 or tail[1] > NO_WORSE * tail[0] + 0.01:
            words.append(
                f"the worst violation of {name} goes from {worst[0]:.2f} to {worst[1]:.2f} s, the mean of the"
                f" worst tenth from {tail[0]:.2f} to {tail[1]:.2f} s"
            )
    return words


def _worst(found: LogTuning) -> str:
    if not found.replay.held:
        return found.replay.worst()
    stays = _stays(found)
    if not found.margins_kept:
        return "the margins of a loop that changes fall below those before; see the table of margins"
    out = [one for one in found.reflight.shares if not one.inside]
    words = _harm(found)
    if out:
        one = max(out, key=lambda each: each.fit if math.isnan(each.held_out) else each.held_out)
        share = one.fit if math.isnan(one.held_out) else one.held_out
        words.append(
            f"the {one.channel} error of the log is outside the envelope in {100 * share:.0f} % of the"
            f" held-out rows, expected at most {100 * ACCEPTED_OUTSIDE:.0f} %"
        )
    if stays:
        words.append(
            f"{listed([one.loop for one in found.verdicts if not one.judged])} stay as flown: the log does"
            f" not tell these loops ({stays[0].loop}: {stays[0].why})"
        )
    if steep := [one for one in found.changes if one.before > 0.0 and one.after > _STEEP * one.before]:
        named = listed([f"{one.name} to {one.after / one.before:.1f} times" for one in steep])
        words.insert(0, f"a large change rests on one log: {named} the recorded value; load half of it first")
    words += [
        f"{one.name} is at the end of ArduPilot's range"
        for one in found.changes
        if one.bounds is not None and one.after > 0.95 * one.bounds[1]
    ]
    return "; ".join(words) or "nothing stands out"


def _stays(found: LogTuning) -> list[AxisVerdict]:
    """Loops that stay as flown, those with an implausible mass first, else the last, position, first."""
    return sorted(
        (one for one in reversed(found.verdicts) if not one.judged), key=lambda v: not v.implausible
    )


def _next(found: LogTuning) -> str:
    stays = _stays(found)
    load = (
        "load changes.param and fly a yaw step before a mission" if found.tuned.changes and found.held else ""
    )
    trial = f"for {stays[0].loop}: {stays[0].trial}; then run this again" if stays else ""
    return "; ".join(one for one in (load, trial) if one) or "fly the vehicle and replay its next log"


def _changes(found: LogTuning) -> Table:
    columns = ("parameter", "before", "after", "from", "to", Column("why", align="left"))
    rows = [
        (
            one.name,
            _short(one.before),
            _short(one.after),
            *(_short(x) for x in one.bounds or (math.nan,) * 2),
            one.why,
        )
        for one in found.changes
    ]
    return Table.of("Parameters that change (changes.param)", columns, rows, left=1)


def _loops(found: LogTuning) -> Table:
    columns = ("loop", "judged", Column("why", align="left"), Column("trial that would tell", align="left"))
    rows = [(one.loop, "yes" if one.judged else "no", one.why, one.trial) for one in found.verdicts]
    return Table.of("Loops that the identified model can judge", columns, rows, left=1)


def _missions(found: LogTuning) -> Table:
    head = ("step", "worst before, s", "after", "95 % before, s", "after", "in corridor before, %", "after")
    rows = []
    for name in found.before.violations:
        before, after = found.before.row(name), found.after.row(name)
        rows.append((
            name, _short(before[0]), _short(after[0]), _short(before[1]), _short(after[1]), _share(before[2]),
            _share(after[2]),
        ))  # fmt: skip
    return Table.of(f"Corridor violation over {found.missions} missions", head, rows, left=1)


def _margins(found: LogTuning) -> Table:
    head = ("loop", "", "phase, deg", "gain, dB", "sensitivity", "accepted")
    rows = [
        (
            loop,
            when,
            f"{one.phase_deg:.0f}",
            f"{one.gain_db:.1f}",
            f"{one.sensitivity:.2f}",
            "yes" if one.accepted else "no",
        )
        for loop, both in found.tuned.margins.items()
        for when, one in zip(("before", "after"), both, strict=True)
    ]
    return Table.of("Least margins over drawn vehicles", head, rows, left=2)


def _shares(found: LogTuning) -> Table:
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
            one.channel, one.unit, _short(one.rms), _short(one.width), _share(one.fit), _share(one.held_out),
            str(one.rows), "yes" if one.inside else "no",
        )
        for one in found.reflight.shares
    ]  # fmt: skip
    return Table.of("The log's mission flown again: errors outside the envelope of 95 %", head, rows, left=2)


def _behind(found: LogTuning) -> tuple[str, ...]:
    rig, wander = found.reflight.rig, found.reflight.wander
    assumed = [
        name for name in found.assumed if not name.endswith(("_FF", "_FLTD", "_FLTE")) and "RATE" not in name
    ]
    sought = {name for loop in SOUGHT.values() for name in loop}
    told = [
        f"Disturbances estimated from the fitted part: steady wrench {_short(rig.steady[2])} N down,"
        f" {', '.join(_short(x) for x in rig.steady[3:])} N m in roll, pitch, yaw; a wandering wrench of"
        f" {', '.join(_short(x) for x in wander[:3])} N and"
        f" {', '.join(_short(x) for x in wander[3:])} N m with a time constant of"
        f" {rig.wander_s:g} s; current {_short(float(found.reflight.current[0]))} m/s north,"
        f" {_short(float(found.reflight.current[1]))} m/s east.",
        Spread().sentence(),
        "The missions judge the loops under the model that the log identified: its errors affect the results"
        " before and after the changes alike.",
    ]
    for one in found.reflight.shares:
        if one.width > _WIDE * one.rms:
            told.append(
                f"The envelope of {one.channel} is {one.width / one.rms:.0f} times as wide as the log's rms:"
                " staying inside it proves little."
            )
    if assumed:
        told.append(
            f"Neither log nor file has {', '.join(assumed)}: ArduSub's defaults are assumed; give"
            " --parameters."
        )
    if hidden := sorted(sought & set(assumed)):
        told.append(f"Of these, tuning can change {', '.join(hidden)} if their loop can be judged.")
    return tuple(told)


def _coefficients(found: LogTuning) -> Table:
    rows = [
        (
            name, _short(one["start"]), _short(one["estimate"]),
            "" if one["sigma"] is None else _short(one["sigma"]), one["at_bound"] or "",
        )
        for name, one in found.identified["coefficients"].items()
    ]  # fmt: skip
    return Table.of("Coefficients", ("coefficient", "start", "estimate", "sd", "at bound"), rows, left=1)
