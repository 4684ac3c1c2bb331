"""The words of scores: how well a vehicle predicts, beside baselines and others, on trials no fit saw.

Held by ``tests/scoring/test_score.py``, ``tests/scoring/test_comparison.py`` and
``tests/identification/test_leave_one_out.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import singledispatch

import numpy as np

from seatrial.base.channels import readable
from seatrial.base.report import Column, Report, Section, Table
from seatrial.identification.leave_one_out import LEAVE_ONE_OUT_SETTINGS, LeaveOneOut
from seatrial.scoring.baselines import not_beaten
from seatrial.scoring.comparison import PAIR_SETTINGS, Comparison, Difference
from seatrial.scoring.score import Score
from seatrial.scoring.windows import score_text

_NEARLY = 0.9  # of the time ahead that the longest window lasts at least

_POOR_R2 = 0.8  # a channel below it is worth another identification


@singledispatch
def report(result: object) -> Report:
    """Report of a score, a comparison, or trials that were left out."""
    raise TypeError(f"expected a score, found {type(result).__name__}")


@report.register
def _score(score: Score, *, vehicle: str = "") -> Report:
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


_SMALL = 0.02  # a smaller difference of R2 is small, even where it is told


@report.register
def _comparison(comparison: Comparison) -> Report:
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
        outcome=_who_predicts_better(comparison),
        good=good,
        worst=worst,
        next_step=next_step,
        sections=(
            Section(
                sentences=tuple(sentences(comparison)),
                tables=(_comparison_table(comparison), _beside_baselines(comparison)),
            ),
        ),
    )


def _who_predicts_better(comparison: Comparison) -> str:
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


def _comparison_table(comparison: Comparison) -> Table:
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
    others = [_against(comparison, name) for name in comparison.scores if name != comparison.reference]
    simpler = [
        f"{name} does not beat a baseline in {where}."
        for name, scored in comparison.scores.items()
        if (where := not_beaten(scored.evidence, scored.baselines))
    ]
    return [*others, *simpler]


def _against(comparison: Comparison, name: str) -> str:
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


@report.register
def _leave_one_out(result: LeaveOneOut) -> Report:
    """Three lines, R2 by trial and channel, scatter of the coefficients."""
    judged = [trial for trial in result.left_out if trial.r2]
    cells = [(value, trial, c) for trial in judged for c, value in trial.r2.items() if value == value]
    worse = [
        f"{trial.trial}: {where}" for trial in judged if (where := not_beaten(trial.r2, trial.baselines))
    ]
    if cells:
        value, trial, channel = min(cells, key=lambda cell: cell[0])
        best = score_text(max(value for value, _, _ in cells))
        good = (
            f"Trials that were left out are predicted 10 s ahead with R2 {best} at best,"
            f" {score_text(value)} at worst ({channel} of {trial.trial}; {len(judged)} trials)"
        )
    else:
        good = "No left-out trial could be scored"
    if worse:
        good = f"Does not beat a baseline in {'; '.join(worse)}. {good}"
    worst, next_step = _worst_left_out(result)
    return Report(
        title=f"{result.campaign}, leave one out",
        outcome="interrupted" if result.interrupted else "judged",
        good=good,
        worst=worst,
        next_step=next_step,
        sections=(Section(sentences=_remarks(result), tables=(_left_out_table(result), _scatter(result))),),
    )


def _worst_left_out(result: LeaveOneOut) -> tuple[str, str]:
    """The worst problem, and what to do about it."""
    if result.interrupted:
        return (
            f"Ctrl-C ended the run after {len(result.left_out)} trials",
            "run the same command again; finished trials and stages are kept",
        )
    if failed := [trial for trial in result.left_out if trial.failed]:
        return f"without {failed[0].trial}: {failed[0].failed}", "repeat the manoeuvre in another trial"
    rows = [row for row in result.coefficients() if row["ratio"] == row["ratio"]]
    far = max(rows, key=lambda row: row["ratio"], default=None)
    lost = {trial.trial: trial.lost for trial in result.left_out if trial.lost}
    scattered = far is not None and far["ratio"] >= LEAVE_ONE_OUT_SETTINGS.scatter_ratio
    if far is not None and scattered and far["farthest_without"] in lost:
        trial = far["farthest_without"]
        return (
            f"{far['coefficient']} rests on {trial}: {far['least']:.4g} to {far['most']:.4g} {far['unit']}"
            f" over the fits, farthest without {trial}, the only trial of stage {', '.join(lost[trial])}",
            "repeat its manoeuvre in a second trial, so that each can judge the other",
        )
    if far is not None and scattered:
        return (
            f"{far['coefficient']} scatters from trial to trial by {far['ratio']:.2g} times its standard"
            f" deviation ({far['least']:.4g} to {far['most']:.4g} {far['unit']})",
            f"take {far['jackknife']:.2g} {far['unit']} as its deviation; look for what differs between the"
            " trials: current, battery, ballast, trim",
        )
    if lost:
        trial, stages = next(iter(lost.items()))
        return (
            f"stage {', '.join(stages)} has no other trial than {trial}",
            "repeat its manoeuvre in a second trial, so that each can judge the other",
        )
    return "nothing stands out: no coefficient depends on a single trial", "rely on the deviations of the fit"


def _remarks(result: LeaveOneOut) -> tuple[str, ...]:
    """Trials that could not be judged, stages without a trial, and ratios that mean little."""
    remarks = [f"Without {trial.trial}: {trial.failed}." for trial in result.left_out if trial.failed]
    remarks += [
        f"Without {trial.trial} there is no trial for stage {', '.join(trial.lost)}: what it frees was"
        " estimated with everything else, or kept its start value."
        for trial in result.left_out
        if trial.lost and not trial.failed
    ]
    small = {
        row["coefficient"]: row["ratio"]
        for row in result.coefficients()
        if row["ratio"] < LEAVE_ONE_OUT_SETTINGS.shared_ratio
    }
    if small:
        least = min(small, key=small.__getitem__)
        remarks.append(
            f"{len(small)} coefficients have a ratio below {LEAVE_ONE_OUT_SETTINGS.shared_ratio:g} ({least}"
            f" {small[least]:.2g}): their standard deviation comes mostly from what all fits share, such as"
            " the scale of the thrust, whose prior leaving out a trial does not change. This does not mean"
            " that it is too large."
        )
    return tuple(remarks)


def _left_out_table(result: LeaveOneOut) -> Table:
    """R2 by trial and channel, beside the best baseline."""
    rows = []
    for trial in result.left_out:
        for k, (channel, value) in enumerate(trial.r2.items()):
            rival = trial.best_baseline(channel)
            known = ("", "") if rival is None else (score_text(rival[1]), rival[0])
            rows.append((
                "" if k else trial.trial,
                channel,
                score_text(value),
                *known,
                "" if k else trial.result,
            ))
    words = [Column(name, align="left") for name in ("best baseline", "predicted by")]
    head: list[str | Column] = ["left out", "channel", "R2", "R2 baseline", *words]
    return Table.of("Trials that were left out, 10 s ahead", head, rows, left=2)


def _scatter(result: LeaveOneOut) -> Table:
    """Least and most of each coefficient over the fits, and its deviations."""
    rows = [
        (
            row["coefficient"],
            row["unit"],
            f"{row['least']:.4g} to {row['most']:.4g}",
            f"{row['jackknife']:.2g}" if math.isfinite(row["jackknife"]) else f"only in {row['only_from']}",
            f"{row['sigma']:.2g}" if math.isfinite(row["sigma"]) else "",
            f"{row['ratio']:.2g}" if math.isfinite(row["ratio"]) else "",
        )
        for row in result.coefficients()
    ]
    head = ("coefficient", "unit", "one trial left out", "jackknife sd", "sd of the fit", "ratio")
    return Table.of("Coefficients with one trial left out", head, rows, left=2)
