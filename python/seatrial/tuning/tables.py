"""Tables and phrases of a tuning: steps of its loops, autopilots side by side, gains before and after.

Held by tests/tuning/test_tune.py and tests/tuning/test_tuning_words.py.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from seatrial.tuning.gain_parameters import GAINS
from seatrial.tuning.performance import Performance, StepPerformance
from seatrial.vehicle.authority import LOOPS

if TYPE_CHECKING:
    from seatrial._core import Autopilot

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
                        _UNITS[loop][gain],
                        f"{before.speeds_m_s[point]:.2f}",
                        f"{start[name]:.4g}",
                        f"{tuned[name]:.4g}",
                    ))
    for name, value in tuned.items():
        if not name.rpartition(".")[2].isdigit() and value != start[name]:
            unit = next((unit for ending, unit in _ENDINGS.items() if name.endswith(ending)), "")
            rows.append((name, unit, "", f"{start[name]:.4g}", f"{value:.4g}"))
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
