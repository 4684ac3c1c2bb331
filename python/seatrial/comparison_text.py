"""A comparison of vehicles in words: the table and the sentences that `Comparison` prints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.channel import readable
from seatrial.paired_windows import LEAST_WINDOWS
from seatrial.score import kind

if TYPE_CHECKING:
    from seatrial.comparison import Comparison, Difference

SMALL = 0.02
"""A difference of R2 below this is small, even where it is told."""


def table(comparison: Comparison) -> str:
    """Text table: per channel a row per vehicle, with its difference from the reference."""
    scores, reference = comparison.scores, comparison.reference
    wide = max([8, *(len(name) for name in scores)]) + 2
    differences = {name: comparison.of(name) for name in scores}
    lines = [
        f"{', '.join(comparison.trials)}: {kind(scores[reference])}; intervals against {reference},"
        f" together {100 * comparison.level:g} %",
        f"{'channel':<9}{'vehicle':<{wide}}{'R2':>8}{'MAE':>10} {'unit':<7}{'R2 difference':<28}"
        f"{'error ratio':<23}verdict",
    ]
    for channel in scores[reference]:
        scale, unit = readable(channel)
        for name, score in scores.items():
            one = score[channel]
            label = channel if name == reference else ""
            line = f"{label:<9}{name:<{wide}}{one.r2:>8.3f}{one.mae * scale:>10.4g} {unit:<6} "
            if (found := differences[name].get(channel)) is not None:
                line += f"{_span(found.r2_difference, found.r2_interval, '+'):<27} "
                line += f"{_span(found.error_ratio, found.error_interval, ''):<22} {found.verdict}"
            lines.append(line.rstrip())
    for whole in comparison.overall:
        span = _span(whole.error_ratio, whole.error_interval, "")
        lines.append(f"{'all':<9}{whole.vehicle:<{wide + 54}}{span:<22} {whole.verdict}")
    return "\n".join(lines)


def sentence(comparison: Comparison, name: str) -> str:
    """What the windows tell of one vehicle against the reference, and what they do not."""
    own, reference = comparison.of(name), comparison.reference
    where = f"On {', '.join(comparison.trials)} ({kind(comparison.scores[reference])})"
    overall = next(one for one in comparison.overall if one.vehicle == name)
    if not own:
        return f"{where}, {name} and {reference} share no channel to be compared in."
    if overall.verdict == "too few windows":
        return (
            f"{where}, nothing can be said of {name} and {reference} beyond their scores: an interval takes"
            f" {LEAST_WINDOWS} windows; restart the simulation more often or add trials."
        )
    if all(d.r2_difference == 0.0 and d.error_ratio == 1.0 for d in own.values()):
        return f"{where}, {name} and {reference} predict the same."
    diverged = [d.channel for d in own.values() if d.verdict == "diverged"]
    if diverged:
        text = f"{where}, one of {name} and {reference} diverges in {', '.join(diverged)}"
    else:
        interval = overall.error_interval or (np.nan, np.nan)
        text = (
            f"{where}, the error of {name} in a typical window is {overall.error_ratio:.2f} times"
            f" ({interval[0]:.2f} to {interval[1]:.2f}) that of {reference}: "
        ) + {"better": f"{name} predicts better", "worse": f"{reference} predicts better"}.get(
            overall.verdict, "these windows do not tell which one predicts better"
        )
    told = {word: [d for d in own.values() if d.verdict == word] for word in ("better", "worse", "mixed")}
    parts = [f"{name} is {word} in {_listed(found)}" for word, found in told.items() if found]
    open_ = [c for c, d in own.items() if d.verdict == "not told apart"]
    if len(open_) == len(own):
        parts = ["no single channel is told apart"]
    elif open_:
        parts.append(f"{', '.join(open_)} {'is' if len(open_) == 1 else 'are'} not told apart")
    text = ". By channel: ".join([text, "; ".join(parts)]) + "."
    if not diverged and all(abs(d.r2_difference) < SMALL for d in own.values()):
        text += f" No R2 differs by {SMALL:g}: for most uses either will do."
    return text


def _listed(found: Sequence[Difference]) -> str:
    """Channels with both scores and the error ratio."""
    return ", ".join(
        f"{d.channel} (R2 {d.r2[1]:.3f} against {d.r2[0]:.3f}, error {d.error_ratio:.2f} times)"
        for d in found
    )


def _span(value: float, interval: tuple[float, float] | None, sign: str) -> str:
    """A value and its interval, in three decimals; in one where there are tens."""

    def number(one: float) -> str:
        return f"{one:{sign}.{3 if abs(one) < 9.9995 else 1}f}"

    if interval is None:
        return number(value)
    return f"{number(value)} ({number(interval[0])} to {number(interval[1])})"
