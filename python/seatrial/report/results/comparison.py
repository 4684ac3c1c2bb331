"""The words of a comparison of vehicles on the same windows: which predicts best, by how much, and where.

Held by ``tests/scoring/test_comparison.py``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from seatrial.base.channels import readable
from seatrial.base.report import Report, Section, Table
from seatrial.report.results.score import kind
from seatrial.scoring.baselines import not_beaten
from seatrial.scoring.comparison import PAIR_SETTINGS, Comparison, Difference
from seatrial.scoring.windows import score_text

_SMALL = 0.02  # a smaller difference of R2 is small, even where it is told


def report(comparison: Comparison) -> Report:
    """Three lines, a sentence per further vehicle, a row per channel and vehicle."""
    reference, overall = comparison.reference, comparison.overall
    better = [other for other in overall if other.verdict == "better"]
    decided = [other for other in overall if other.verdict in ("better", "worse")]
    first = min(
        decided or overall, key=lambda other: other.error_ratio if np.isfinite(other.error_ratio) else np.inf
    )
    size = f"{first.error_ratio:.2f} times" if np.isfinite(first.error_ratio) else "not comparable with"
    good = (
        f"the error of {first.vehicle} in a typical window is {size} that of {reference} ({first.windows}"
        f" windows on {', '.join(comparison.trials)})"
    )
    worst = next_step = ""
    if better:
        worse = [d for d in comparison.of(first.vehicle).values() if d.verdict == "worse"]
        worst = (
            f"{first.vehicle} is worse in {_listed(worse)}"
            if worse
            else "no channel of the better one is worse"
        )
        next_step = f"use {first.vehicle}"
    elif all(other.verdict == "worse" for other in overall):
        worst, next_step = _weakness(comparison), f"keep {reference}"
    else:
        why = "" if first.verdict == "not told apart" else f" ({first.verdict})"
        worst = f"these windows do not tell {reference} and {first.vehicle} apart{why}"
        next_step = "add trials or restart more often (--ahead); until then either will do"
    return Report(
        title=f"{reference} against {', '.join(other.vehicle for other in overall)}",
        outcome=_outcome(comparison),
        good=good,
        worst=worst,
        next_step=next_step,
        sections=(
            Section(
                sentences=tuple(sentences(comparison)),
                tables=(_table(comparison), _beside_baselines(comparison)),
            ),
        ),
    )


def _outcome(comparison: Comparison) -> str:
    """Which vehicle predicts better, in a few words."""
    overall, reference = comparison.overall, comparison.reference
    if len(overall) == 1:
        names = {"better": overall[0].vehicle, "worse": reference}
        verdict = overall[0].verdict
        return f"{names[verdict]} predicts better" if verdict in names else verdict
    better, worse = (sum(other.verdict == word for other in overall) for word in ("better", "worse"))
    return f"of {len(overall)} others {better} predict better than {reference}, {worse} worse"


def _weakness(comparison: Comparison) -> str:
    """Where the best vehicle, the reference, is beaten all the same: by another one, or by a baseline."""
    for name in comparison.scores:
        if beaten := [channel for channel in comparison.of(name).values() if channel.verdict == "better"]:
            return f"{name} is better in {_listed(beaten)}"
    own = comparison.scores[comparison.reference]
    if simpler := not_beaten(own.evidence, own.baselines):
        return f"{comparison.reference} does not beat a baseline in {simpler}"
    return f"nothing stands out: no other vehicle is better than {comparison.reference} in any channel"


def _table(comparison: Comparison) -> Table:
    """Per channel a row per vehicle, with its difference from the reference."""
    scores, reference = comparison.scores, comparison.reference
    differences = {name: comparison.of(name) for name in scores}
    rows = []
    for channel in scores[reference]:
        scale, unit = readable(channel)
        for name, by_channel in scores.items():
            own_score = by_channel[channel]
            cells = [
                channel if name == reference else "",
                name,
                own_score.text,
                "" if own_score.blind else f"{own_score.mae * scale:.4g}",
                unit,
            ]
            if (own := differences[name].get(channel)) is not None:
                cells += [
                    _span(own.r2_difference, own.r2_interval, "+"),
                    _span(own.error_ratio, own.error_interval, ""),
                    own.verdict,
                ]
            rows.append((*cells, *[""] * (8 - len(cells))))
    rows += [
        (
            "all",
            other.vehicle,
            "",
            "",
            "",
            "",
            _span(other.error_ratio, other.error_interval, ""),
            other.verdict,
        )
        for other in comparison.overall
    ]
    skipped = scores[reference].skipped
    title = (
        f"{', '.join(comparison.trials)}: {kind(scores[reference])}"
        f"{f' ({skipped} left out)' if skipped else ''}; intervals against {reference}, together"
        f" {100 * comparison.level:g} %"
    )
    head = ("channel", "vehicle", "R2", "MAE", "unit", "R2 difference", "error ratio", "verdict")
    return Table.of(title, head, rows, left=2)


def _beside_baselines(comparison: Comparison) -> Table:
    """R2 of every vehicle and of the baselines by velocity channel."""
    scores, simple = comparison.scores, comparison.scores[comparison.reference].baselines
    rows = [
        (
            channel,
            *(score_text(scored.r2[channel]) for scored in scores.values()),
            *(score_text(row[channel]) if channel in row else "" for row in simple.values()),
        )
        for channel in scores[comparison.reference].evidence
        if any(channel in row for row in simple.values())
    ]
    return Table.of("R2 beside baselines", ("channel", *scores, *simple), rows)


def sentences(comparison: Comparison) -> list[str]:
    """What the windows tell of every further vehicle, and which does not beat a baseline."""
    others = [_sentence(comparison, name) for name in comparison.scores if name != comparison.reference]
    simpler = [
        f"{name} does not beat a baseline in {where}."
        for name, scored in comparison.scores.items()
        if (where := not_beaten(scored.evidence, scored.baselines))
    ]
    return [*others, *simpler]


def _sentence(comparison: Comparison, name: str) -> str:
    """What the windows tell of one vehicle against the reference, and what they do not."""
    own, reference = comparison.of(name), comparison.reference
    where = f"On {', '.join(comparison.trials)} ({kind(comparison.scores[reference])})"
    overall = next(other for other in comparison.overall if other.vehicle == name)
    if not own:
        return f"{where}, {name} and {reference} share no channel to be compared in."
    if overall.verdict == "too few windows":
        return (
            f"{where}, nothing can be said of {name} and {reference} beyond their scores: an interval takes"
            f" {PAIR_SETTINGS.fewest_windows} windows; restart the simulation more often or add trials."
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
    by_verdict = {
        word: [d for d in own.values() if d.verdict == word] for word in ("better", "worse", "mixed")
    }
    parts = [f"{name} is {word} in {_listed(channels)}" for word, channels in by_verdict.items() if channels]
    open_ = [c for c, d in own.items() if d.verdict == "not told apart"]
    if len(open_) == len(own):
        parts = ["no single channel is told apart"]
    elif open_:
        parts.append(f"{', '.join(open_)} {'is' if len(open_) == 1 else 'are'} not told apart")
    text = ". By channel: ".join([text, "; ".join(parts)]) + "."
    if not diverged and all(abs(d.r2_difference) < _SMALL for d in own.values()):
        text += f" No R2 differs by {_SMALL:g}: for most uses either will do."
    return text


def _listed(differences: Sequence[Difference]) -> str:
    """Channels with both scores and the error ratio."""
    return ", ".join(
        f"{d.channel} (R2 {d.r2[1]:.3f} against {d.r2[0]:.3f}, error {d.error_ratio:.2f} times)"
        for d in differences
    )


def _span(value: float, interval: tuple[float, float] | None, sign: str) -> str:
    """A value and its interval, in three decimals; in one where there are tens."""

    def decimals(number: float) -> str:
        return f"{number:{sign}.{3 if abs(number) < 9.9995 else 1}f}"

    if interval is None:
        return decimals(value)
    return f"{decimals(value)} ({decimals(interval[0])} to {decimals(interval[1])})"
