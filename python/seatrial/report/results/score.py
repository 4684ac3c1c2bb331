"""The words of a score: how well a vehicle predicts, its worst channel, and the baselines beside it.

Held by ``tests/scoring/test_score.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from seatrial.base.channels import readable
from seatrial.base.report import Column, Report, Section, Table
from seatrial.scoring.baselines import not_beaten
from seatrial.scoring.score import Score
from seatrial.scoring.windows import score_text

_NEARLY = 0.9  # of the time ahead that the longest window lasts at least

_POOR_R2 = 0.8  # a channel below it is worth another identification


def report(score: Score, *, vehicle: str = "") -> Report:
    """R2 of the best and the worst channel, the worst problem, what to do next; then all channels."""
    rows = []
    for name, channel in score.items():
        scale, unit = readable(name)
        errors = (f"{scale * channel.mae:.4g}", f"{scale * channel.rmse:.4g}")
        most = limit_text(score.ceiling.get(name))
        band = score.bands.get(name)
        parts = ("", "") if band is None else (score_text(band.below), score_text(band.at))
        if channel.blind:
            errors = ("", "")
        rows.append((name, channel.text, most, *parts, *errors, unit, str(channel.n)))
    unit_column = Column("unit", align="left")
    head: list[str | Column] = ["channel", "R2", *LIMITS, "MAE", "RMSE", unit_column, "samples"]
    trials = ", ".join(score.trials)
    title = f"{trials}: {kind(score)} ({score.shifted} started late, {score.skipped} left out)"
    good, worst, next_step = _verdict(score)
    return Report(
        title=vehicle or trials,
        outcome="scored",
        good=good,
        worst=worst,
        next_step=next_step,
        sections=(
            Section(tables=(Table.of(title, head, rows, note=score.blind_words), baseline_table(score))),
        ),
    )


LIMITS = ("ceiling", "below waves", "at waves")
"""Heads of the columns beside an R2: the ceiling by noise and waves, the score in two bands."""


def limit_text(value: float | None) -> str:
    """A ceiling of R2 in three decimals; empty where none is known."""
    return "" if value is None else f"{value:.3f}"


_LIKELIHOOD = (
    "log-likelihood gain: mean per sample, of the model minus that of the best baseline (natural logarithm);"
    " above zero the model predicts better; 10 % less error variance is worth 0.05"
)


def baseline_table(score: Score, *, words: str = "", gains: Mapping[str, float] | None = None) -> Table:
    """R2 of a model and of the baselines by velocity channel; no row where no baseline is judged.

    `words` say for the title on what, `gains` are the log-likelihood per sample (natural logarithm) over the
    best baseline, by channel.
    """
    rows = [
        (
            channel,
            score_text(r2),
            *(score_text(row[channel]) if channel in row else "" for row in score.baselines.values()),
            f"{gains[channel]:+.2f}" if gains and channel in gains else "",
        )
        for channel, r2 in score.evidence.items()
        if any(channel in row for row in score.baselines.values())
    ]
    ahead = f"{score.ahead_s:g} s ahead" if math.isfinite(score.ahead_s) else "in a free run"
    title = f"R2 {ahead} beside baselines{words}"
    head = ("channel", "model", *score.baselines, "log-likelihood gain")
    return Table.of(title, head, rows, note=_LIKELIHOOD if gains else "")


def _verdict(score: Score) -> tuple[str, str, str]:
    """How good, the worst problem and what to do next; what is replayed is no evidence."""
    r2 = score._told
    ahead = f"{score.ahead_s:g} s ahead" if np.isfinite(score.ahead_s) else "in a free run"
    if score.unscored:
        good = f"no channel of {', '.join(score.trials)} could be scored {ahead}"
        after = "check the vehicle (seatrial check) and the commands of the trial"
        return good, score.unscored, _TELLING if score.blind else after
    best, least = max(r2, key=r2.__getitem__), min(r2, key=r2.__getitem__)
    scale, unit = readable(least)
    good = (
        f"predicts {', '.join(score.trials)} {ahead} with R2 {r2[best]:.3f} in {best}, worst {r2[least]:.3f}"
        f" in {least} (1 is perfect, 0 no better than the mean)"
    )
    if simpler := not_beaten(score.evidence, score.baselines):
        good = f"Does not beat a baseline in {simpler}. It {good}"
    worst = f"{least}: mean error {scale * score.mae[least]:.3g} {unit}, R2 {r2[least]:.3f}"
    if score.blind:
        return good, score.blind_words, _TELLING
    longest = max(
        float(window.trial.t[window.stop - 1] - window.trial.t[window.start]) for window in score.windows
    )
    if np.isfinite(score.ahead_s) and longest < _NEARLY * score.ahead_s:
        short = f"no simulation lasts {score.ahead_s:g} s: the longest piece of the log has {longest:.3g} s"
        return good, short, f"score a longer trial, or with --ahead {longest:.2g}"
    if r2[least] < _POOR_R2:
        return good, worst, f"identify with trials that excite {least}, or compare vehicles with --against"
    return good, worst, "compare with another vehicle (--against) or go on to tune the autopilot"


_TELLING = (
    "judge these axes on a trial with preset steps or a dither on top of the autopilot (seatrial plan with"
    " the campaign of this log)"
)


def kind(score: Score) -> str:
    """Words for the windows of a score: how far ahead, and how many."""
    count = len(score.windows)
    words = f"{count} {'window' if count == 1 else 'windows'}"
    return f"{score.ahead_s:g} s ahead, {words}" if np.isfinite(score.ahead_s) else f"free run, {words}"
