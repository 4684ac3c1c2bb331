"""The words of a leave-one-out: how well trials are predicted that no fit saw, what rests on one trial."""

from __future__ import annotations

import math

from seatrial.base.report import Column, Report, Section, Table
from seatrial.identification.leave_one_out import LEAVE_ONE_OUT_SETTINGS, LeaveOneOut
from seatrial.scoring.baselines import not_beaten
from seatrial.scoring.windows import score_text


def report(result: LeaveOneOut) -> Report:
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
    worst, next_step = _worst(result)
    return Report(
        title=f"{result.campaign}, leave one out",
        outcome="interrupted" if result.interrupted else "judged",
        good=good,
        worst=worst,
        next_step=next_step,
        sections=(Section(sentences=_remarks(result), tables=(_scores(result), _scatter(result))),),
    )


def _worst(result: LeaveOneOut) -> tuple[str, str]:
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


def _scores(result: LeaveOneOut) -> Table:
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
