"""The words of a tuning: gains, corridors and margins before and after, what is still missed.

Held by ``tests/tuning/test_tune.py``, ``tests/tuning/test_tuning_words.py`` and
``tests/control_design/test_margin_constraint.py``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.report import Column, Report, Section, Table, appended, listed
from seatrial.control_design.corridor import SETTINGS as CORRIDOR_SETTINGS
from seatrial.control_design.corridor import Corridor
from seatrial.control_design.margin_report import ReportedMargins
from seatrial.control_design.tuning_table import ACCEPTED
from seatrial.tuning.result import SETTINGS as PERFORMANCE_SETTINGS
from seatrial.tuning.result import (
    Performance,
    StepPerformance,
    Tuning,
    missed_limits,
    shown_below,
    without_table,
)
from seatrial.tuning.scope import GAINS
from seatrial.tuning.search import GUIDANCE_SEARCH
from seatrial.vehicle.actuators import LOOPS

if TYPE_CHECKING:
    from seatrial._core import Autopilot


_NAMES = {"deg": "phase margin", "dB": "gain margin", "dB down": "gain margin", "s": "delay margin"}

_MARGINS = "margins"


def report(tuning: Tuning) -> Report:
    """Three lines, responses before and after, gains, margins; sentences."""
    worst, next_step = _worst(tuning)
    statements = tuple(sentences(tuning))
    responses = [
        Table.of(
            f"Responses with the {performance.name} gains (times in s)", TRIAL_HEAD, trial_rows(performance)
        )
        for performance in reversed(tuning.performance)
    ]
    tables, doubt = responses[:1], tuning.plan.fitted.doubt()
    if len(tuning.performance) > 1:
        tables.append(
            Table.of(
                COMPARISON_TITLE, comparison_head(tuning.performance), comparison_rows(tuning.performance)
            )
        )
    gains = gain_rows(tuning.start, tuning.autopilot, tuning.plan.places)
    tables.append(Table.of("Gains at the breakpoints that are reached", GAIN_HEAD, gains, left=2))
    if not tuning.interrupted:
        tables.append(margin_table(tuning.margins["tuned"], title="Margins with the tuned gains"))
    return Report(
        title=tuning.plan.name,
        outcome=tuning.outcome,
        good=_how_good(tuning),
        worst=worst,
        next_step=next_step,
        sections=(
            Section(tables=tuple(tables)),
            Section(
                "Remarks",
                (*filter(None, [doubt]), *statements, _effort(tuning)),
                tuple(responses[1:]),
                details=True,
            ),
        ),
    )


def _how_good(tuning: Tuning) -> str:
    """Responses inside their corridors, against the start gains; the least phase margin."""
    start, tuned = tuning.of("start"), tuning.of("tuned")
    if tuned is None:
        done = sum(not group.interrupted for group in tuning.groups)
        return f"{done} searches finished; nothing was assessed"
    inside = sum(trial.nominal_s == 0.0 for trial in tuned.trials)
    before = (
        "" if start is None else f", {sum(t.nominal_s == 0.0 for t in start.trials)} with the start gains"
    )
    phases = [
        (row.phase_deg, row)
        for row in tuning.margins["tuned"]
        if row.stable and row.phase_deg is not None  # the margins of an unstable loop mean something else
    ]
    least = ""
    if phases:
        phase, row = min(phases, key=lambda pair: pair[0])
        least = f"; least phase margin {phase:.0f} deg ({row.loop} at {row.speed_m_s:.2f} m/s)"
    least_held = min((trial.held for trial in tuned.trials), default=1.0)
    line = (
        f"{inside} of {len(tuned.trials)} responses of the vehicle stay within their corridors{before}; of"
        f" {tuned.samples} drawn vehicles at least {least_held:.0%}{least}"
    )
    line = "; ".join([line, *_worse_than_start(tuning), *_untuned(tuning)])
    return appended(line, tuning.plan.fitted.doubt())


def _worst(tuning: Tuning) -> tuple[str, str]:
    """The worst problem of a tuning, and what to do about it."""
    tuned = tuning.of("tuned")
    if tuned is None:
        return (
            "Ctrl-C ended the search before the gains were assessed",
            "run the same command again; it goes on with what is not finished",
        )
    out = [trial for trial in tuned.trials if trial.nominal_s > 0.0]
    short = tuning.short_margins
    if out:
        trial = max(out, key=lambda trial: trial.nominal_s)
        missed = f". Margin short of its limit, too: {_first_of(short)}" if short else ""
        return (
            f"{named_step(trial)}: {outside(trial.nominal_s)}{_why(tuning, trial)}{missed}",
            f"widen the corridor of {trial.loop} if it asks too much, or give the search more room under"
            " [tuning] (bounds, budget)",
        )
    if short:
        return f"margin short of its limit: {_first_of(short)}", _advice(tuning)
    verify = "verify the autopilot over drawn vehicles, currents and failures (seatrial verify CAMPAIGN)"
    loosest = min(tuned.trials, key=lambda trial: (trial.held, -trial.worst_s), default=None)
    if loosest is not None and loosest.held < 1.0:
        return (
            f"{named_step(loosest)}: {1.0 - loosest.held:.0%} of the drawn vehicles leave the corridor"
            f" (the worst: {outside(loosest.worst_s)})",
            verify,
        )
    if tuning.reverted:
        return f"start gains stay in {', '.join(tuning.reverted)}: the search found nothing better", verify
    return "no response leaves its corridor and no margin is short", verify


def _first_of(short: Sequence[str]) -> str:
    """The first of the margins that fall short, and how many others do."""
    return short[0] + (f" and {len(short) - 1} more" if len(short) > 1 else "")


def _advice(tuning: Tuning) -> str:
    """What to do about margins that fall short."""
    unstable = {(row.mode, row.speed_m_s) for row in tuning.margins["tuned"] if not row.stable}
    if unstable and unstable <= set(tuning.plan.beyond_gains):
        sound = [row.speed_m_s for row in tuning.margins["tuned"] if row.stable]
        kept = f" (stable from {min(sound):.2f} to {max(sound):.2f} m/s)" if sound else ""
        return (
            f"keep missions away from these speeds{kept}, widen [tuning] bounds, or add an actuator for what"
            " grows there (seatrial check AUTOPILOT --vehicle VEHICLE)"
        )
    return "widen the corridor of this loop (a slower response has more margin), or lower [tuning] margins"


def _effort(tuning: Tuning) -> str:
    flown = sum(group.flown_s for group in tuning.groups)
    return (
        f"Tuned in {tuning.elapsed_s:.1f} s: {sum(group.evaluations for group in tuning.groups)} sets of"
        f" gains, {flown / 3600.0:.0f} h of flight"
    )


def sentences(tuning: Tuning) -> list[str]:
    """What a reader has to know, the verdict first."""
    lines = []
    tuned = tuning.of("tuned")
    if tuned is None:
        there = (
            "" if tuning.kept is None else f" They are in {_beside(tuning.kept)}, which `seatrial fly` takes."
        )
        lines.append(
            "The tuning was interrupted: the gains are the best so far, and nothing was assessed."
            f"{there} Run the same command again to finish the rest."
        )
    elif tuned.feasible:
        whole = [trial for trial in tuned.trials if trial.held == 1.0]
        drawn = bool(tuning.plan.fitted.names)
        lines.append(_all_inside(len(tuned.trials), len(whole), tuned.samples, drawn=drawn))
        for trial in tuned.trials:
            if trial.held < 1.0:
                lines.append(
                    f"{named_step(trial)}: within the corridor with {trial.held:.0%} of the samples; the"
                    f" worst: {outside(trial.worst_s)}."
                )
    else:
        out = [trial for trial in tuned.trials if trial.nominal_s > 0.0]
        leave = "leave their corridors" if len(out) > 1 else "leaves its corridor"
        lines.append(
            f"{len(out)} of {len(tuned.trials)} responses of the vehicle itself {leave}: widen what is too"
            " narrow, or give the search more room under [tuning] (bounds, budget)."
        )
        lines += [f"{named_step(trial)}: {outside(trial.nominal_s)}{_why(tuning, trial)}." for trial in out]
    lines += [
        f"{statement[0].upper()}{statement[1:]}."
        for statement in (*_worse_than_start(tuning), *_untuned(tuning))
    ]
    lines += _guided(tuning)
    if tuning.reverted:
        lines.append(
            f"The start gains stay in {', '.join(tuning.reverted)}: the search found nothing"
            " better that suits the other loops."
        )
    last = {group.name.partition(",")[0]: group for group in tuning.groups}
    moved = {name for group in tuning.groups if group.name != _MARGINS for name in group.gains}
    ended = {
        name
        for group in last.values()
        for name in group.at_bound
        if group.name != _MARGINS or name not in moved  # a group has moved it since
    }
    if ended:
        lines.append(f"Factors at a bound of the search: {', '.join(sorted(ended))}; widen [tuning] bounds.")
    if short := tuning.short_margins:
        lines.append(f"Margins short of their limits: {'; '.join(short)}.")
    lines += without_table(tuning.plan)
    lines += list(tuning.plan.fitted.notes)
    return lines


def _why(tuning: Tuning, trial: StepPerformance) -> str:
    """Reason of a violation, after a colon."""
    if tuning.quiet is None:
        return ""
    key = (trial.loop, trial.speed_m_s, trial.step)
    for quiet in tuning.quiet.trials:
        if (quiet.loop, quiet.speed_m_s, quiet.step) == key:
            return f": {why_outside(quiet, tuning.quiet.responses[quiet.loop].trials.corridor)}"
    return ""


def why_outside(quiet: StepPerformance, corridor: Corridor) -> str:
    """What makes a response leave its corridor, and what to do, from the same step with perfect sensors."""
    if quiet.nominal_s == 0.0:
        return (
            "with perfect sensors it stays inside, so sensor noise or latency is the cause; take larger"
            " steps, or raise settled and overshoot"
        )
    if not quiet.overshoot < PERFORMANCE_SETTINGS.far_steps:  # nor where it diverged
        return "the motion grows at that speed; leave it out of speeds_m_s, or begin with gains that hold it"
    rise = next((time for time, bound in corridor.lower if bound >= CORRIDOR_SETTINGS.risen_share), math.inf)
    lower, upper = corridor.sampled([corridor.until_s])
    most = max((bound for _, bound in corridor.upper), default=math.inf) - 1.0
    if quiet.rise_s > rise:
        reached = f"in {quiet.rise_s:.1f} s" if math.isfinite(quiet.rise_s) else "not at all"
        return f"it rises {reached}, {rise:g} s are asked; raise rise_s, or take smaller steps"
    if quiet.overshoot > most:
        return (
            f"it overshoots by {quiet.overshoot:.0%} without noise, too, {most:.0%} are allowed; raise"
            " overshoot, or rise_s for gentler gains"
        )
    if not math.isfinite(quiet.settling_s):
        return (
            f"it is not within {100.0 * (1.0 - lower[0]):.0f} % below and {100.0 * (upper[0] - 1.0):.0f} %"
            f" above its set point by {corridor.until_s:g} s; raise settled or until_s"
        )
    return "it settles late, there or on the way back; raise settling_s"


def _beside(path: Path) -> str:
    """A path as a user would type it: from the working directory where it lies below it."""
    here = Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path)


def _worse_than_start(tuning: Tuning) -> list[str]:
    """Loops that the vehicle itself kept better to their corridors before, and what for."""
    start, tuned = tuning.of("start"), tuning.of("tuned")
    if start is None or tuned is None:
        return []
    was, now = start.outside_s, tuned.outside_s
    worse = [loop for loop in now if now[loop] > was[loop]]
    if not worse:
        return []
    better = [loop for loop in now if now[loop] < was[loop]]

    def sides(loops: Sequence[str]) -> str:
        return ", ".join(f"{_seconds(now[loop])} against {_seconds(was[loop])}" for loop in loops)

    gained = _gained_margin(tuning)
    if not gained and better:
        gained = f"{' and '.join(better)} ({sides(better)})"
    traded = f", traded for {gained}" if gained else ""
    are = "is" if len(worse) == 1 else "are"
    return [f"{' and '.join(worse)} {are} worse than with the start gains ({sides(worse)} outside){traded}"]


def _gained_margin(tuning: Tuning) -> str:
    """The margin that the start gains lack most of and the tuned ones less, in words; nothing where none."""
    limits = tuning.plan.table.margins
    gained: list[tuple[float, str]] = []
    for before, after in zip(tuning.margins["start"], tuning.margins["tuned"], strict=True):
        where = f"in {before.mode} at {before.speed_m_s:.2f} m/s"
        if after.stable and not before.stable:
            gained.append((math.inf, f"a stable motion {where}"))
        lacking = {unit: (value, limit) for value, limit, unit in missed_limits(before, limits)}
        still = {unit: value for value, _, unit in missed_limits(after, limits)}
        for unit, (value, limit) in lacking.items():
            now = still.get(unit, limit)
            if before.stable and after.stable and now > value:
                figure_now = (
                    f"{shown_below(now, limit)} of {limit:g}" if unit in still else f"at least {limit:g}"
                )
                words = f"the {_NAMES[unit]} of {before.loop} {where}"
                words += f" ({shown_below(value, limit)} {unit}, now {figure_now})"
                gained.append((1.0 - value / limit, words))
    return max(gained, key=lambda pair: pair[0])[1] if gained else ""


def _untuned(tuning: Tuning) -> list[str]:
    """Loops that no corridor asks to tune and whose gains changed all the same, and why."""
    if tuning.of("tuned") is None:
        return []
    start, tuned = tuning.start.gains(), tuning.autopilot.gains()
    moved = dict.fromkeys(
        loop
        for name in tuned
        if (loop := name.partition(".")[0]) in LOOPS
        and loop not in tuning.plan.steered
        and tuned[name] != start[name]
    )
    if not moved:
        return []
    return [
        f"gains of {listed([*moved])}, which no corridor tunes, changed to mend margins that the start gains"
        " lack"
    ]


def _guided(tuning: Tuning) -> list[str]:
    """What guidance was given for the tuned loops, in a sentence."""
    guidance = next((group for group in tuning.groups if group.name == GUIDANCE_SEARCH), None)
    if guidance is None:
        return []
    start, tuned = tuning.start.gains(), tuning.autopilot.gains()
    moved = "; ".join(
        f"{name.partition('.')[2]} {tuned[name]:.4g}, before {start[name]:.4g}"
        for name in sorted(guidance.gains)
    )
    return [
        f"Guidance for the tuned loops: {moved}. Path steps with the tuned loops: time-weighted error"
        f" {guidance.after['time']:.2g} s, before {guidance.before['time']:.2g} s; overshoot beyond 30 %:"
        f" {seconds(guidance.after['violation'])} s, before {seconds(guidance.before['violation'])} s."
    ]


def _seconds(value: float) -> str:
    return f"{seconds(value)} s" if np.isfinite(value) else seconds(value)


def _all_inside(count: int, whole: int, samples: int, *, drawn: bool) -> str:
    """The sentence on a feasible tuning; without a covariance what is drawn is the vehicle itself."""
    every = f"every one of {samples} others that were drawn, in their currents"
    if not drawn:
        every = f"every one of {samples} currents and noises (its coefficients count as exact)"
    if count == 1:
        also = f", and so with {every}" if whole else ""
        return f"The response of the vehicle itself stays within its corridor, there and back{also}."
    also = f"{whole} of them" if whole < count else "all of them"
    return (
        f"All {count} responses of the vehicle itself stay within their corridors, there and back, and"
        f" {also} with {every}, too."
    )


TRIAL_HEAD = ("loop", "m/s", "step", "outside", "worst", "held", "rise", "over", "settled")

GAIN_HEAD = ("gain", "unit", "m/s", "start", "tuned")

_SPEED = {"K_P": "N s/m", "K_I": "N/m", "K_D": "N s2/m"}
_DEPTH = {"K_P": "N/m", "K_I": "N/m per s", "K_D": "N s/m"}
_ANGLE = {"K_P": "N m/rad", "K_I": "N m/rad per s", "K_D": "N m s/rad"}

_UNITS = {
    "surge": _SPEED,
    "sway": _SPEED,
    "heave": _DEPTH,
    "roll": _ANGLE,
    "pitch": _ANGLE,
    "heading": _ANGLE,
}

_ENDINGS = {"_rad_s": "rad/s", "_m_s": "m/s", "_m": "m"}  # units of numbers that are no gains

_LEAST_S = 0.001  # a violation below is told as less than that

COMPARISON_TITLE = "Side by side: outside in all, samples held"


def on_another_vehicle(performance: Performance) -> str:
    """Whether the responses keep to their corridors on a vehicle that the autopilot does not know."""
    out = [trial for trial in performance.trials if trial.nominal_s > 0.0]
    if not out:
        return f"all {len(performance.trials)} responses stay within their corridors."
    listed = "; ".join(f"{named_step(trial)}, {outside(trial.nominal_s)}" for trial in out)
    return f"{len(out)} of {len(performance.trials)} responses leave their corridors: {listed}."


def trial_rows(performance: Performance) -> list[tuple[str, ...]]:
    """A row per trial, in the order of `TRIAL_HEAD`: violations in s, times in s, shares in per cent."""
    return [
        (
            trial.loop,
            f"{trial.speed_m_s:.2f}",
            f"{trial.step:+.3g} {trial.unit}",
            seconds(trial.nominal_s),
            seconds(trial.worst_s),
            f"{trial.held:.0%}",
            _time(trial.rise_s),
            f"{trial.overshoot:.0%}" if math.isfinite(trial.overshoot) else "-",
            _time(trial.settling_s),
        )
        for trial in performance.trials
    ]


def comparison_head(compared: Sequence[Performance]) -> tuple[str, ...]:
    """Head of `comparison_rows`."""
    return ("loop", *(what for performance in compared for what in (f"{performance.name}, s", "held")))


def comparison_rows(compared: Sequence[Performance]) -> list[tuple[str, ...]]:
    """A row per loop: per autopilot the sum of the nominal violations, s, and the share of samples within."""
    loops = list(dict.fromkeys(trial.loop for performance in compared for trial in performance.trials))
    rows = []
    for loop in loops:
        cells = [loop]
        for performance in compared:
            own = [trial for trial in performance.trials if trial.loop == loop]
            cells += [
                seconds(sum(trial.nominal_s for trial in own)),
                f"{sum(trial.held for trial in own) / len(own):.0%}",
            ]
        rows.append(tuple(cells))
    return rows


def gain_unit(name: str) -> str:
    """Unit of a gain or another number of an autopilot, by its name in ``gains()``; empty without one."""
    loop, _, gain = name.partition(".")
    if (unit := _UNITS.get(loop, {}).get(gain.partition(".")[0])) is not None:
        return unit
    return next((unit for ending, unit in _ENDINGS.items() if name.endswith(ending)), "")


def gain_rows(before: Autopilot, after: Autopilot, points: Sequence[int]) -> list[tuple[str, ...]]:
    """A row per gain and breakpoint of ``points`` (from 0), and per other number that changed."""
    start, tuned = before.gains(), after.gains()
    rows: list[tuple[str, ...]] = []
    for loop in LOOPS:
        for gain in GAINS:
            for point in points:
                name = f"{loop}.{gain}.{point + 1}"
                if name in start and (start[name] or tuned[name]):
                    rows.append((
                        f"{loop} {gain}",
                        gain_unit(name),
                        f"{before.speeds_m_s[point]:.2f}",
                        f"{start[name]:.4g}",
                        f"{tuned[name]:.4g}",
                    ))
    for name, value in tuned.items():
        if not name.rpartition(".")[2].isdigit() and value != start[name]:
            rows.append((name, gain_unit(name), "", f"{start[name]:.4g}", f"{value:.4g}"))
    return rows


def named_step(trial: StepPerformance) -> str:
    """A step of a loop by its speed and size."""
    return f"{trial.loop} at {trial.speed_m_s:.2f} m/s, step of {trial.step:+.3g} {trial.unit}"


def outside(value: float) -> str:
    """By how much a response leaves its corridor, in words; of a violation in s."""
    return f"outside by {seconds(value)} s of a step" if math.isfinite(value) else "diverges"


def seconds(value: float) -> str:
    """A violation in s, short."""
    if not math.isfinite(value):
        return "diverges"
    if 0.0 < value < _LEAST_S:
        return f"<{_LEAST_S:g}"
    return "0" if value == 0.0 else f"{value:.0f}" if value >= 100.0 else f"{value:.2g}"


def _time(value: float) -> str:
    return f"{value:.1f}" if math.isfinite(value) else "-"


SENSITIVITY_NOTE = (
    "Sensitivity: how much the loop enlarges a disturbance at worst,"
    f" accepted up to {ACCEPTED.sensitivity:g}."
)
"""Below every table of margins whose verdict may be the sensitivity."""


def margin_table(rows: Sequence[ReportedMargins], *, title: str = "Margins") -> Table:
    """The margins as a table of a report, a row per mode, speed and loop.

    Examples
    --------
    >>> row = ReportedMargins("cruise", 2.0, "heading", True, 29.1, 2.8, None, None, 61.2, 0.35, 3.05, 0.35,
    ...     1.16, 11.5, 60.3, 1.2)
    >>> margin_table([row]).rows
    (('cruise', '2.00', 'heading', '29.1', '-', '61', '3.05', '1.16', ''),)
    """

    def number(value: float | None, digits: int) -> str:
        return "-" if value is None else f"{value:.{digits}f}"

    cells = [
        (
            row.mode,
            f"{row.speed_m_s:.2f}",
            row.loop,
            number(row.gain_up_db, 1),
            number(row.gain_down_db, 1),
            number(row.phase_deg, 0),
            number(row.delay_s, 2),
            number(row.disk, 2),
            row.verdict,
        )
        for row in rows
    ]
    head = (
        "mode",
        "m/s",
        "loop",
        "up, dB",
        "down, dB",
        "phase, deg",
        "delay, s",
        "disk",
        Column("", align="left"),
    )
    note = (
        "Each loop opened alone; disk: gain and phase changed at once (disk margin, at most 2); last column:"
        f" what is less than accepted. {SENSITIVITY_NOTE}"
    )
    return Table.of(title, head, cells, note=note)
