"""A tuning in words and tables: what `Tuning.summary` prints.

Held by tests/test_tune.py.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from seatrial.control_design.authority import LOOPS
from seatrial.text_table import text_table
from seatrial.tuning.gain_parameters import GAINS

if TYPE_CHECKING:
    from seatrial.campaign import Campaign
    from seatrial.tuning.judged import Judged, JudgedTrial
    from seatrial.tuning.tuning_result import Tuning

__all__ = [
    "COMPARISON_TITLE",
    "GAIN_HEAD",
    "TRIAL_HEAD",
    "comparison_head",
    "comparison_rows",
    "gain_rows",
    "on_another_vehicle",
    "sentences",
    "summary",
    "trial_rows",
    "without_table",
]

TRIAL_HEAD = ("loop", "m/s", "step", "outside", "worst", "held", "rise", "over", "settled")
GAIN_HEAD = ("gain", "unit", "m/s", "start", "tuned")
_UNITS = {
    "surge": "N s/m",
    "sway": "N s/m",
    "heave": "N/m",
    "roll": "N m/rad",
    "pitch": "N m/rad",
    "heading": "N m/rad",
}
_OF_GAIN = {"K_P": "", "K_I": " per s", "K_D": " s"}
_ENDINGS = {"_rad_s": "rad/s", "_m_s": "m/s", "_m": "m"}  # units of numbers that are no gains
_MARGINS = "margins"
_LEAST_S = 0.001  # a violation below is told as less than that

COMPARISON_TITLE = "Side by side: outside in all, samples held"


def summary(tuning: Tuning) -> str:
    """Text that a control engineer reads: verdict, responses before and after, gains, margins."""
    from seatrial.tuning.margin_report import margin_table

    parts = ["\n".join(sentences(tuning))]
    for judged in tuning.judged:
        parts.append(
            f"Responses with the {judged.name} gains (times in s)\n"
            + text_table(TRIAL_HEAD, trial_rows(judged))
        )
    if len(tuning.judged) > 1:
        parts.append(COMPARISON_TITLE + "\n" + text_table(comparison_head(tuning), comparison_rows(tuning)))
    parts.append(
        "Gains at the supporting points that are reached\n" + text_table(GAIN_HEAD, gain_rows(tuning))
    )
    if not tuning.interrupted:
        parts.append("Margins with the tuned gains\n" + margin_table(tuning.margins["tuned"]))
    return "\n\n".join(parts)


def sentences(tuning: Tuning) -> list[str]:
    """What a reader has to know, the verdict first."""
    lines = []
    tuned = tuning.of("tuned")
    if tuned is None:
        there = (
            "" if tuning.kept is None else f" They are in {_beside(tuning.kept)}, which `seatrial fly` takes."
        )
        lines.append(
            "The tuning was interrupted: the gains are the best so far, and nothing was judged."
            f"{there} The same command goes on with what is not finished."
        )
    elif tuned.feasible:
        whole = [trial for trial in tuned.trials if trial.held == 1.0]
        drawn = bool(tuning.plan.fitted.names)
        lines.append(_all_inside(len(tuned.trials), len(whole), tuned.samples, drawn=drawn))
        for trial in tuned.trials:
            if trial.held < 1.0:
                lines.append(
                    f"{_of(trial)}: within the corridor with {trial.held:.0%} of the samples, else outside by"
                    f" up to {_seconds(trial.worst_s)} s of a step."
                )
    else:
        out = [trial for trial in tuned.trials if trial.nominal_s > 0.0]
        leave = "leave their corridors" if len(out) > 1 else "leaves its corridor"
        lines.append(
            f"{len(out)} of {len(tuned.trials)} responses of the vehicle itself {leave}: widen what is too"
            " narrow, or give the search more room under [tuning] (bounds, budget)."
        )
        lines += [
            f"{_of(trial)}: outside by {_seconds(trial.nominal_s)} s of a step{_why(tuning, trial)}."
            for trial in out
        ]
    lines += _worse_than_start(tuning)
    if tuning.taken_back:
        lines.append(
            f"The start gains stay in {', '.join(tuning.taken_back)}: nothing better was found beside the"
            " others."
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
    lines += without_table(tuning.campaign)
    lines += list(tuning.plan.fitted.notes)
    return lines


def _why(tuning: Tuning, trial: JudgedTrial) -> str:
    """Reason of a violation, after a colon."""
    from seatrial.tuning.why_outside import why_outside

    if tuning.quiet is None:
        return ""
    key = (trial.loop, trial.speed_m_s, trial.step)
    for quiet in tuning.quiet.trials:
        if (quiet.loop, quiet.speed_m_s, quiet.step) == key:
            return f": {why_outside(quiet, tuning.quiet.responses[quiet.loop].trials.corridor)}"
    return ""


def without_table(campaign: Campaign) -> tuple[str, ...]:
    """A sentence where a campaign does not say what to tune."""
    if campaign.file.tuning is not None:
        return ()
    return (
        "The campaign has no [tuning]: steps, corridors and speeds are the defaults of its vehicle and its"
        " autopilot; a table [tuning] says what the loops shall do.",
    )


def _beside(path: Path) -> str:
    """A path as a user would type it: from the working directory where it lies below it."""
    here = Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path)


def _worse_than_start(tuning: Tuning) -> list[str]:
    """Loops that the vehicle itself kept better to their corridors before, in a sentence."""
    start, tuned = tuning.of("start"), tuning.of("tuned")
    if start is None or tuned is None:
        return []
    worse = []
    for loop in dict.fromkeys(trial.loop for trial in tuned.trials):
        was, now = (sum(t.nominal_s for t in judged.trials if t.loop == loop) for judged in (start, tuned))
        if now > was:
            worse.append(f"{loop} {_seconds(now)} s, before {_seconds(was)} s")
    if not worse:
        return []
    return [
        f"Further outside than with the start gains: {'; '.join(worse)}. What another loop or the margins"
        " need was bought with it: widen that loop's corridor, or ask for less margin."
    ]


def on_another_vehicle(judged: Judged) -> str:
    """Whether the responses keep to their corridors on a vehicle that the autopilot does not know."""
    out = [trial for trial in judged.trials if trial.nominal_s > 0.0]
    if not out:
        return f"all {len(judged.trials)} responses stay within their corridors."
    listed = "; ".join(f"{_of(trial)} by {_seconds(trial.nominal_s)} s" for trial in out)
    return f"{len(out)} of {len(judged.trials)} responses leave their corridors: {listed}."


def trial_rows(judged: Judged) -> list[tuple[str, ...]]:
    """A row per trial, in the order of `TRIAL_HEAD`: violations in s, times in s, shares in per cent."""
    return [
        (
            trial.loop,
            f"{trial.speed_m_s:.2f}",
            f"{trial.step:+.3g} {trial.unit}",
            _seconds(trial.nominal_s),
            _seconds(trial.worst_s),
            f"{trial.held:.0%}",
            _time(trial.rise_s),
            f"{trial.overshoot:.0%}" if math.isfinite(trial.overshoot) else "-",
            _time(trial.settling_s),
        )
        for trial in judged.trials
    ]


def comparison_head(tuning: Tuning) -> tuple[str, ...]:
    """Head of `comparison_rows`."""
    return ("loop", *(what for judged in tuning.judged for what in (f"{judged.name}, s", "held")))


def comparison_rows(tuning: Tuning) -> list[tuple[str, ...]]:
    """A row per loop: per autopilot the sum of the nominal violations, s, and the share of samples within."""
    loops = list(dict.fromkeys(trial.loop for judged in tuning.judged for trial in judged.trials))
    rows = []
    for loop in loops:
        cells = [loop]
        for judged in tuning.judged:
            own = [trial for trial in judged.trials if trial.loop == loop]
            cells += [
                _seconds(sum(trial.nominal_s for trial in own)),
                f"{sum(trial.held for trial in own) / len(own):.0%}",
            ]
        rows.append(tuple(cells))
    return rows


def gain_rows(tuning: Tuning) -> list[tuple[str, ...]]:
    """A row per gain and supporting point that is reached, and per other number that changed."""
    start, tuned = tuning.start.gains(), tuning.autopilot.gains()
    rows: list[tuple[str, ...]] = []
    for loop in LOOPS:
        for gain in GAINS:
            for point in tuning.plan.places:
                name = f"{loop}.{gain}.{point + 1}"
                if name in start and (start[name] or tuned[name]):
                    rows.append((
                        f"{loop} {gain}",
                        _UNITS[loop] + _OF_GAIN[gain],
                        f"{tuning.start.speeds_m_s[point]:.2f}",
                        f"{start[name]:.4g}",
                        f"{tuned[name]:.4g}",
                    ))
    for name, value in tuned.items():
        if not name.rpartition(".")[2].isdigit() and value != start[name]:
            unit = next((unit for ending, unit in _ENDINGS.items() if name.endswith(ending)), "")
            rows.append((name, unit, "", f"{start[name]:.4g}", f"{value:.4g}"))
    return rows


def _of(trial: JudgedTrial) -> str:
    return f"{trial.loop} at {trial.speed_m_s:.2f} m/s, step of {trial.step:+.3g} {trial.unit}"


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


def _seconds(value: float) -> str:
    if not math.isfinite(value):
        return "diverged"
    if 0.0 < value < _LEAST_S:
        return f"<{_LEAST_S:g}"
    return "0" if value == 0.0 else f"{value:.0f}" if value >= 100.0 else f"{value:.2g}"


def _time(value: float) -> str:
    return f"{value:.1f}" if math.isfinite(value) else "-"
