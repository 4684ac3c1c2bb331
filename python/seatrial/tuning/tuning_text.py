"""A tuning in words and tables: what `Tuning.summary` prints.

Held by tests/test_tune.py.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from seatrial.control_design.authority import LOOPS
from seatrial.text_table import text_table
from seatrial.tuning.gain_parameters import GAINS

if TYPE_CHECKING:
    from seatrial.tuning.judged import Judged, JudgedTrial
    from seatrial.tuning.tuning_result import Tuning

__all__ = ["comparison_rows", "gain_rows", "sentences", "summary", "trial_rows"]

TRIAL_HEAD = ("loop", "m/s", "step", "violation", "worst", "held", "rise", "over", "settled")
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


def summary(tuning: Tuning) -> str:
    """Text that a control engineer reads: verdict, responses before and after, gains, margins."""
    from seatrial.tuning.margin_report import margin_table

    parts = ["\n".join(sentences(tuning))]
    for judged in tuning.judged:
        parts.append(f"Responses with the {judged.name} gains\n" + text_table(TRIAL_HEAD, trial_rows(judged)))
    if len(tuning.judged) > 1:
        parts.append("Side by side\n" + text_table(comparison_head(tuning), comparison_rows(tuning)))
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
        lines.append("The tuning was interrupted: the gains are the best so far, and nothing was judged.")
    elif tuned.feasible:
        whole = [trial for trial in tuned.trials if trial.held == 1.0]
        lines.append(
            f"All {len(tuned.trials)} responses stay within their corridors, there and back; {len(whole)} of"
            f" them with every one of {tuned.samples} drawn vehicles and currents, too."
        )
        for trial in tuned.trials:
            if trial.held < 1.0:
                lines.append(
                    f"{_of(trial)}: within the corridor with {trial.held:.0%} of the samples; outside by up"
                    f" to {trial.worst_s:.2g} s of a step."
                )
    else:
        out = [trial for trial in tuned.trials if trial.nominal_s > 0.0]
        lines.append(
            f"{len(out)} of {len(tuned.trials)} responses leave their corridors: widen these, or give the"
            " search more room under [tuning] (bounds, budget)."
        )
        lines += [f"{_of(trial)}: outside by {trial.nominal_s:.2g} s of a step." for trial in out]
    last = {group.name.partition(",")[0]: group for group in tuning.groups}
    ended = {name for group in last.values() for name in group.at_bound}
    if ended:
        lines.append(f"Factors at a bound of the search: {', '.join(sorted(ended))}; widen [tuning] bounds.")
    lacking = [group for group in tuning.groups[-1:] if group.after.get("margin", 0.0) > 0.0]
    lines += [
        f"The margins fall short of their limits by {group.after['margin']:.2g} in all." for group in lacking
    ]
    lines += list(tuning.plan.fitted.notes)
    return lines


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
    return ("loop", *(f"{judged.name}: {what}" for judged in tuning.judged for what in ("violation", "held")))


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
            unit = name.rpartition("_rad_s")[1].strip("_").replace("_", "/") or "SI"
            rows.append((name, unit, "", f"{start[name]:.4g}", f"{value:.4g}"))
    return rows


def _of(trial: JudgedTrial) -> str:
    return f"{trial.loop} at {trial.speed_m_s:.2f} m/s, step of {trial.step:+.3g} {trial.unit}"


def _seconds(value: float) -> str:
    return "0" if value == 0.0 else f"{value:.2g}" if math.isfinite(value) else "diverged"


def _time(value: float) -> str:
    return f"{value:.1f}" if math.isfinite(value) else "-"
