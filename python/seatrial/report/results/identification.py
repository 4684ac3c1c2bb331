"""The words of an identification: how well it predicts, coefficients, scores, the worst problem, advice."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from seatrial.base.channels import CHANNELS, MOTIONS, readable
from seatrial.base.report import Column, Report, Section, Table, appended
from seatrial.diagnosis.assessment import SETTINGS as ASSESSMENT_SETTINGS
from seatrial.estimation.event_fit import SETTINGS
from seatrial.identification.choice import Choice
from seatrial.identification.estimate import (
    ESTIMATE_SETTINGS,
    Estimate,
    derived,
    distinct,
    implausible_drags,
    implausible_masses,
    masses_of,
    plus_minus,
)
from seatrial.identification.identification import Identification, judged_score, pooled_score
from seatrial.identification.preparation import HELD_SETTINGS, sentences
from seatrial.inspect.feedback import EVENT_LIMITS
from seatrial.report.results import diagnosis, estimates, trial_findings
from seatrial.report.results.score import LIMITS, baseline_table, limit_text
from seatrial.scoring.baselines import not_beaten
from seatrial.scoring.windows import score_text

if TYPE_CHECKING:
    from seatrial.diagnosis.missing_terms import Suggestion


_NEAR_ONE = 0.985  # R2 that two digits round to 0.99


def report(fit: Identification, *, truth: Mapping[str, float] | None = None) -> Report:
    """Three lines, coefficients beside their `truth` where it is known, scores, what they mean, advice."""
    worst, next_step = _worst(fit)
    tables = (
        _coefficient_table(fit, truth or {}),
        _held_table(fit, truth or {}),
        _conditional_table(fit),
        _nuisance_table(fit),
        *(() if fit.assessment is None else (diagnosis.assumption_table(fit.assessment),)),
        _held_out_table(fit),
        *_beside_baselines(fit),
        _choice_table(fit),
        _proposal_table(fit),
        _event_table(fit),
    )
    meant = [(name, f"{value:.4g}") for name, value in derived(fit.vehicle).items()]
    meaning = Table.of("What the coefficients mean", ("quantity", "value"), meant)
    return Report(
        title=fit.problem.name,
        outcome="interrupted" if fit.interrupted else fit.tally.outcome,
        good=_how_good(fit),
        worst=worst,
        next_step=next_step,
        sections=(
            Section(tables=(*tables, meaning, _stage_table(fit))),
            Section(tables=(_score_table(fit),), details=True),
            Section("Remarks", (*filter(None, [fit.doubt]), *advice(fit)), details=True),
        ),
    )


def _how_good(fit: Identification) -> str:
    """What the trials tell, what failed, how well it predicts, what its deviations are worth."""
    lines = [_prediction(fit)]
    score = judged_score(fit)
    if score is not None and (simpler := not_beaten(score.evidence, score.baselines)):
        lines.insert(0, f"Does not beat a baseline in {simpler}.")
    choice = fit.choice
    if choice is not None and choice.result == "stages":
        lines.insert(0, "Result: the stages, because the joint estimate predicts worse outside its fit.")
    if choice is not None and not (choice.polished.converged or choice.polished.interrupted):
        count = choice.polished.rounds
        lines.insert(0, f"The joint estimate did not converge in {count} round{'s' if count > 1 else ''}.")
    line = " ".join((fit.tally.sentence, *lines) if fit.coefficients or fit.held else lines)
    return appended(line, fit.doubt)


def _prediction(fit: Identification) -> str:
    """R2 of the prediction some seconds ahead: best and worst channel, on held-out trials if there are."""
    part, words = "hold_out", "Predicts held-out motion"
    if not fit.scores.get(part, {}).get("ahead"):
        part, words = "fit", "Reproduces its own training data (nothing is held out)"
    score = pooled_score(fit.scores.get(part, {}).get("ahead", {}))
    r2 = {} if score is None else {name: value for name, value in score.r2.items() if value == value}
    if score is None or not r2:
        if filtered := _filtered(fit):
            return filtered
        why = f": {score.blind_words}" if score is not None and score.blind else ""
        return f"{len(fit.coefficients)} coefficients estimated; nothing could be scored{why}"
    # Positions and angles barely move in seconds and score well with any model: velocities tell.
    evidence = r2
    r2 = {name: value for name, value in evidence.items() if name in CHANNELS[:6]} or evidence
    best, worst = max(r2, key=r2.__getitem__), min(r2, key=r2.__getitem__)
    trials = len(score.trials)
    # A ceiling is worth a word where it is below what rounds to one, and where it is one.
    most = {
        c: f" (ceiling {_r2(limit)})" if r2.get(c, -1.0) < limit < _NEAR_ONE else ""
        for c, limit in score.ceiling.items()
    }
    channels = f"{_r2(r2[best])}{most.get(best, '')} in {best}"
    if len(r2) > 1:
        moving = "velocity " if len(r2) < len(evidence) else ""
        channels += f", worst {moving}{_r2(r2[worst])}{most.get(worst, '')} in {worst}"
    return (
        f"{words} {score.ahead_s:g} s ahead with R2 {channels}"
        f" ({trials} trial{'s' if trials > 1 else ''}; 1 is perfect, 0 no better than the mean)"
    )


def _filtered(fit: Identification) -> str:
    """R2 of predictions from the state of a filter, where a replay judges no model; empty without any."""
    choice = fit.choice
    if choice is None or not choice.rivals:
        return ""
    r2 = choice.chosen
    best, worst = max(r2, key=r2.__getitem__), min(r2, key=r2.__getitem__)
    simpler = not_beaten(r2, choice.rivals)
    return (
        f"{f'Does not beat a baseline in {simpler}. ' if simpler else ''}Predicts held-out motion"
        f" {choice.ahead_s:g} s ahead from the filter's state with R2 {_r2(r2[best])} in {best}, worst"
        f" {_r2(r2[worst])} in {worst} (1 is perfect, 0 no better than the mean); longer horizons are not"
        " scored, because commands react to waves"
    )


def _worst(fit: Identification) -> tuple[str, str]:
    """The worst problem of an identification, and what to do about it."""
    verify = "tune the autopilot on this vehicle (seatrial tune) or check its scores on another log"
    if fit.interrupted:
        left = f"; not run: {', '.join(fit.not_run)}" if fit.not_run else ""
        return f"Ctrl-C ended the search early{left}", "run the same command again; finished stages are kept"
    if fit.findings:
        problem, remedy = trial_findings.problem(fit.findings[0]), trial_findings.remedy(fit.findings[0])
        return problem, f"{remedy}; then identify again"
    if fit.fallbacks:
        first = fit.fallbacks[0]
        others = len(fit.fallbacks) - 1
        more = f" ({others} more step{'s' if others > 1 else ''} failed, see the remarks)" if others else ""
        return f"{first.name} failed: {first.cause}. Kept instead: {first.kept}{more}", first.remedy
    if strayed := [] if fit.assessment is None else fit.assessment.strayed():
        return f"a nuisance parameter left its prior: {diagnosis.problem(strayed[0])}", diagnosis.remedy(
            strayed[0]
        )
    if hidden := sentences(fit.held):
        problem, _, remedy = hidden[0].rpartition("; ")
        return problem, remedy
    score = judged_score(fit)
    residual_analysis = None if fit.assessment is None else fit.assessment.residual_analysis
    # What the rounds have tried in vain is not advised again.
    last = {proposal.name: proposal.verdict for proposal in fit.proposals}
    tried = {name for name, verdict in last.items() if verdict in ("within chance", "too little")}
    suggestions = [
        suggestion
        for suggestion in (() if residual_analysis is None else residual_analysis.suggestions)
        if suggestion.name not in tried
    ]
    # What is missing where a baseline predicts better comes before what the data do not tell.
    for suggestion in suggestions:
        if score is not None and not_beaten(
            {c: r2 for c, r2 in score.evidence.items() if c == suggestion.channel}, score.baselines
        ):
            return _missing(suggestion)
    if refused := [] if fit.assessment is None else fit.assessment.refused(tried):
        return diagnosis.problem(refused[0]), diagnosis.remedy(refused[0])
    if fit.choice is not None and fit.choice.result == "joint estimate" and fit.choice.spoilt:
        return (
            f"the joint estimate is better as a whole, but predicts {', '.join(fit.choice.spoilt)} worse"
            " than the stages (table below)",
            "take vehicle_stages.toml where these axes matter, or leave their coefficients out of [polish]"
            " (fixed)",
        )
    if odd := _implausible(fit):
        return odd[0], (
            "measure it (a mass by scales, drag by the top speed) or the thrust and its lever, and give it in"
            " the vehicle file; until then the value describes the log and not the vehicle"
        )
    combinations = () if fit.identifiability is None else fit.identifiability.combinations
    verdicts = {} if fit.identifiability is None else fit.identifiability.verdicts
    absent = {name for name, verdict in verdicts.items() if verdict == "not identifiable"}
    if missing := [combination for combination in combinations if absent.intersection(combination.names)]:
        worst = missing[0].finding
        return f"not identifiable: {diagnosis.problem(worst)}", diagnosis.remedy(worst)
    if bounds := [row for row in distinct(fit.coefficients) if row.at_bound]:
        names = ", ".join(
            f"{row.name} ({row.at_bound} bound {row.estimate:.4g} {row.unit})" for row in bounds
        )
        hold = "hold them, the data do not determine them"
        if all(row.parameter in tried for row in bounds):
            return f"not identified, ended at a bound: {names}", hold
        return f"not identified, ended at a bound: {names}", (
            "widen the bounds of these coefficients in the campaign if the values are plausible; otherwise"
            f" {hold}"
        )
    if suggestions:
        return _missing(suggestions[0])
    if residual_analysis is not None and residual_analysis.warning:
        loudest = max(residual_analysis.autocorrelations, key=lambda row: row.excess)
        return (
            f"the residual of {loudest.channel} is {loudest.excess:.2g} times the noise of its sensor and"
            f" correlated over {loudest.correlation_s:.2g} s",
            "take the intervals as those of the best model of this structure; judge a change by the held-out"
            " scores alone",
        )
    if combinations:
        worst = combinations[0].finding
        return f"weakly identifiable: {diagnosis.problem(worst)}", diagnosis.remedy(worst)
    if fit.notes:
        return fit.notes[0], verify
    if score is not None and (simpler := not_beaten(score.evidence, score.baselines)):
        return f"a baseline predicts as well as the model: {simpler}", (
            "free what the model lacks in these axes, add trials that excite them, or use the baseline"
        )
    return "nothing stands out: all coefficients identifiable, none at a bound, residuals like noise", verify


def _missing(term: Suggestion) -> tuple[str, str]:
    """A term that the model misses, and how to free it."""
    if term.faster:
        return (
            f"the residual of {term.channel} follows {term.follows}: the actuator responds faster than the"
            " file says",
            diagnosis.remedy_of_term(term),
        )
    return (
        f"the residual of {term.channel} follows {term.follows}: the model misses a term"
        f" (freeing {term.name} lowers the cost by {term.gain:.2g} %)",
        f"{diagnosis.remedy_of_term(term)} in a stage of the campaign ({term.line}), identify again and"
        f" compare the held-out"
        " scores",
    )


def _r2(value: float) -> str:
    """An R2 with two decimals, or as many up to four as tell it from 1."""
    if value <= -10.0:
        return f"{value:.0f}"
    digits = next((n for n in (2, 3) if float(f"{value:.{n}f}") < 1.0), 4)
    return f"{value:.{digits}f}"


def _coefficient_table(fit: Identification, truth: Mapping[str, float]) -> Table:
    rows = []
    doubtful = fit.tally.identifiable < fit.tally.asked  # else the first line says it of all
    origins = dict.fromkeys(row.stage for row in fit.coefficients)
    for row in distinct(fit.coefficients):
        true = truth.get(row.name, 0.0)
        error = f"{round(100.0 * (row.estimate / true - 1.0), 1) + 0.0:+.1f} %" if true else ""
        rows.append((
            row.name,
            row.unit,
            f"{true:.4g}" if truth else "",
            f"{row.start:.4g}",
            plus_minus(row.estimate, None if row.at_bound else row.sigma),
            "" if row.factor is None else f"{row.factor:.3g}",
            error,
            _told(row),
            row.verdict or "not judged" if doubtful else "",
            f"at {row.at_bound} {row.lower if row.at_bound == 'lower' else row.upper:.4g}"
            if row.at_bound
            else "",
            row.stage if len(origins) > 1 else "",
        ))
    head = ["coefficient", "unit", "truth", "start", "estimate", "factor", "error", "told by"]
    head += ["verdict", "bound"]
    title = f"{fit.vehicle.name}: identified coefficients"
    if len(origins) == 1:
        title += f" ({next(iter(origins))})"
    return Table.of(title, [*head, Column("stage", align="left")], rows, left=2)


def _told(row: Estimate) -> str:
    """Whether data or prior tell a coefficient, with the deviation over the prior's; "" without a prior."""
    if row.told is None:
        return ""
    return f"{'data' if row.told <= ASSESSMENT_SETTINGS.told_share else 'prior'} ({row.told:.2f})"


def contradictions(fit: Identification) -> list[str]:
    """Sentences on coefficients of which something else was known beforehand, the farthest first."""
    lines = []
    for row in sorted(distinct(fit.coefficients), key=lambda row: -row.contradiction):
        if row.contradiction and row.prior is not None:
            known = f"{row.prior[0]:.3g} ± {row.prior[1]:.2g} {row.unit}"
            lines.append(
                f"{row.name} is {row.estimate:.3g} {row.unit}, {row.contradiction:.2g} standard deviations"
                f" from what was known beforehand ({known}): compare part, size and wiring with the vehicle"
                " file; the estimate holds where the others are as they were known"
            )
    return lines


def _held_table(fit: Identification, truth: Mapping[str, float]) -> Table:
    """What was to be identified and keeps its value; a row per group of equal coefficients."""
    rows = {
        row.parameter: (
            row.parameter,
            row.unit,
            f"{truth[row.name]:.4g}" if row.name in truth else "",
            f"{row.value:.4g}",
            f"{row.axis} dominated by feedback",
        )
        for row in reversed(fit.held)
    }
    title = "Not identified, the vehicle file's values are kept"
    head = ("coefficient", "unit", "truth", "value", Column("why", align="left"))
    return Table.of(title, head, list(reversed(rows.values())), left=2)


def _conditional_table(fit: Identification) -> Table:
    """How far estimates would move were a held value larger."""
    rows = [
        (row.name, row.unit, row.on, f"{row.change:+.3g}", f"{row.deviations:+.1f}")
        for row in fit.conditional
    ]
    title = f"Estimates that change if a held value is {100.0 * HELD_SETTINGS.error_share:g} % larger"
    return Table.of(title, ("coefficient", "unit", "held", "change", "in deviations"), rows, left=3)


def _nuisance_table(fit: Identification) -> Table:
    """What the trials added to their records, estimated with the coefficients."""
    nuisances = [] if fit.assessment is None else fit.assessment.nuisances()
    rows = [
        (
            row["name"],
            row["unit"],
            plus_minus(row["estimate"], row["sigma"]),
            f"{row['prior']:.3g} ± {row['prior_sd']:.3g}",
            f"{row['away']:+.1f}",
        )
        for row in nuisances
    ]
    head = ("nuisance parameter", "unit", "estimate", "prior", "prior sd away")
    return Table.of("Sensor errors and currents of the trials, estimated with them", head, rows, left=2)


def _held_out_table(fit: Identification) -> Table:
    """Scores per channel on the part that was held out, over all trials that have one."""
    kinds = fit.scores.get("hold_out", {})
    ahead, free = pooled_score(kinds.get("ahead", {})), pooled_score(kinds.get("free", {}))
    rows = []
    for channel, score in {} if ahead is None else ahead.items():
        scale, unit = readable(channel)
        run = free[channel].text if free is not None and channel in free else ""
        band = ahead.bands.get(channel) if ahead is not None else None
        parts = ("", "") if band is None else (score_text(band.below), score_text(band.at))
        most = limit_text(ahead.ceiling.get(channel)) if ahead is not None else ""
        cells = (
            score.text,
            most,
            *parts,
            run,
            "" if score.blind else f"{scale * score.mae:.3g}",
            str(score.n),
        )
        rows.append((channel, unit, *cells))
    trials = "" if ahead is None else ", ".join(ahead.trials)
    trials += _replayed_words(fit)
    words = f"{fit.restarts.ahead_s:g} s ahead"
    head = ("channel", "unit", f"R2 {words}", *LIMITS, "R2 free run", f"mean error {words}", "samples")
    return Table.of(
        f"Held-out data ({trials}; R2 = 1 is perfect, 0 no better than the mean)",
        head,
        rows,
        left=2,
        note="" if ahead is None else ahead.blind_words,
    )


def _beside_baselines(fit: Identification) -> tuple[Table, ...]:
    """R2 of the model and of the baselines per velocity, some seconds ahead."""
    score = judged_score(fit)
    held_out = fit.scores.get("hold_out", {}).get("ahead")
    words = ", on held-out data" if held_out else ", on the training data"
    gains = {channel: nats for channel, (_, nats) in fit.likelihood.items()}
    return () if score is None else (baseline_table(score, words=words, gains=gains),)


def _choice_table(fit: Identification) -> Table:
    """R2 per channel of the stages and of the joint estimate, on data outside the fit."""
    choice = fit.choice
    rows = (
        []
        if choice is None
        else [
            (
                c,
                *(score_text(score[c]) for score in (choice.stages, choice.joint)),
                *(score_text(row[c]) if c in row else "" for row in choice.rivals.values()),
            )
            for c in choice.stages
        ]
    )
    words = "" if choice is None else f" ({choice.judged_on.rstrip(',')}; the result: {choice.result})"
    words += _replayed_words(fit) if rows else ""
    ahead = "" if choice is None else f"R2 {choice.ahead_s:g} s ahead, "
    head = ["channel", f"{ahead}stages", f"{ahead}joint estimate"]
    head += [] if choice is None else list(choice.rivals)
    return Table.of(f"Stages and joint estimate outside the fit{words}", head, rows)


_VERDICTS = {
    "within chance": "no: within chance",
    "too little": "no: too small to matter",
    "another gains more": "not in this round: another gains more",
    "cannot be tried": "no: the model diverges with it",
}


def _proposal_table(fit: Identification) -> Table:
    """What was tried in rounds beside the campaign's coefficients, and why it was kept or not."""
    rows = [
        (
            str(proposal.round),
            proposal.line if proposal.verdict == "kept" else proposal.name,
            "wider bound" if proposal.kind == "bound" else "free",
            f"{proposal.channel} {proposal.gain:+.1f} %" if proposal.channel else "",
            f"{proposal.p:.2g}" if proposal.channel else "",
            "kept" if proposal.verdict == "kept" else _VERDICTS[proposal.verdict],
        )
        for proposal in fit.proposals
    ]
    head = ("round", Column("proposal", align="left"), Column("change", align="left"))
    judged = ("error falls by", "p", Column("kept", align="left"))
    title = "Proposals of the residual analysis, judged on parts of the log that each fit left out"
    kept = any(proposal.verdict == "kept" for proposal in fit.proposals)
    note = "To keep them in the campaign, add the lines to [polish.coefficients]." if kept else ""
    return Table.of(title, (*head, *judged), rows, left=1, note=note)


def _event_table(fit: Identification) -> Table:
    """Open-loop stretches of closed loops: which commands, how many, how long, what they tell."""
    rows = []
    for estimate in fit.events:
        lengths = [event.stop_s - event.start_s for event in estimate.events]
        at_limit = sum(event.kind == "limit" for event in estimate.events)
        verdicts = zip(estimate.parameters, estimate.verdicts, strict=True)
        told = [parameter.name for parameter, verdict in verdicts if verdict == "identifiable"]
        rows.append((
            estimate.stage,
            str(len(lengths)),
            str(at_limit),
            f"{min(lengths):.0f} to {max(lengths):.0f}" if lengths else "",
            estimate.damping,
            ", ".join(told) or "too little",
        ))
    head = ("stage", "events", "at a limit", "length s", Column("damping", align="left"))
    title = "Events: a command that steps and is held, where the commands answer the motion elsewhere"
    return Table.of(title, (*head, Column("they tell", align="left")), rows, left=1)


def _events(fit: Identification) -> list[str]:
    """Sentences on what events tell, and on axes whose events carry too little."""
    lines = []
    for estimate in fit.events:
        count = len(estimate.events)
        if not estimate.enough:
            lines.append(
                f"{estimate.stage}: the events carry too little: {count} stretch{'es' if count != 1 else ''}"
                f" of {EVENT_LIMITS.least_s:g} s or more with a command held after a step, and it takes"
                f" {SETTINGS.fewest}; let the autopilot hold an actuator at a limit, or constant after a step"
            )
            continue
        line = f"{estimate.stage}: estimated from {count} events alone, because its commands answer waves"
        if estimate.likelier:
            kinds = ("cross-flow drag by strips", "quadratic damping")
            better, worse = kinds if estimate.strips else kinds[::-1]
            line += (
                f"; {better} predicts each event from the others better than {worse}, by"
                f" {estimate.likelier:.0f} in log-likelihood"
            )
        lines.append(line)
    return lines


def _stage_table(fit: Identification) -> Table:
    """Stages with cost before and after, candidates and time."""
    rows: list[tuple[str, ...]] = [
        (
            stage.name + (" (interrupted)" if stage.interrupted else " (kept)" if stage.reused else ""),
            f"{stage.start_cost:.4g}",
            f"{stage.phases.get('evolution', math.nan):.4g}",
            f"{stage.cost:.4g}",
            str(stage.evaluations),
            str(stage.samples),
            f"{1e3 * stage.step_s:.3g} ms",
            f"{stage.wall_s:.1f} s",
        )
        for stage in fit.stages
    ]
    if fit.choice is not None:
        polished = fit.choice.polished
        costs = [f"{polished.rms(cost):.4g}" for cost in (polished.start_cost, polished.cost)]
        rows.append((
            "joint estimate (rms in sd of the residual)" + ("" if polished.converged else ", not converged"),
            costs[0],
            "",
            costs[1],
            str(polished.evaluations),
            "",
            "",
            f"{polished.wall_s:.1f} s",
        ))
    head = ("stage", "cost at start", "global search", "best", "candidates", "samples", "step", "time")
    return Table.of("Stages (cost: mean weighted error in standard deviations)", head, rows)


def _score_table(fit: Identification) -> Table:
    titles = {"ahead": f"{fit.restarts.ahead_s:g} s ahead", "free": "free run"}
    scored = {row["channel"] for row in fit.score_rows()}
    channels = [channel for channel in CHANNELS if channel in scored]
    rows = []
    for part, kinds in fit.scores.items():
        for kind, per_trial in kinds.items():
            for trial, score in per_trial.items():
                cells = (score[c].text if c in score else "" for c in channels)
                rows.append((f"R2 {part.replace('_', ' ')}, {titles[kind]}", trial, *cells))
    title = "Scores of every trial" + _replayed_words(fit)
    return Table.of(title, ("score", "trial", *channels), rows, left=2)


def _replayed_words(fit: Identification) -> str:
    """Axes that every score replays from the recording, to add to a title; empty where there are none."""
    axes = fit.problem.replayed
    return f"; {', '.join(MOTIONS[axis] for axis in axes)} replayed, not predicted" if axes else ""


def advice(fit: Identification) -> list[str]:
    """Sentences: bounds that were hit, what the data cannot tell, what the model lacks, what did not run."""
    # A wrong sign drives coefficients to their bounds.
    wired = any(finding.kind == "wiring" for finding in fit.findings)
    lines = [
        f"{row.name} is not identified, it ended at its {row.at_bound} bound: widen the bound if the value"
        " is plausible; otherwise hold the coefficient"
        for row in distinct(fit.coefficients)
        if row.at_bound and not wired
    ]
    lines += [fallback.sentence for fallback in fit.fallbacks] + _events(fit)
    lines += _implausible(fit) + contradictions(fit)
    if fit.choice is not None:
        lines += _joint_remarks(fit.choice)
    if fit.assessment is not None:
        lines += diagnosis.sentences(fit.assessment)
    lines += fit.scale.sentences()
    lines += fit.notes
    if fit.interrupted:
        lines.append(
            "Interrupted: the best so far is shown"
            + (f"; not run: {', '.join(fit.not_run)}" if fit.not_run else "")
            + ". Run again with the same run directory to go on"
        )
    return lines


def _implausible(fit: Identification) -> list[str]:
    """Apparent masses and drags that the vehicle cannot have, however well the data determine them."""
    masses = implausible_masses(fit.problem.vehicle, fit.coefficients, masses_of(fit.vehicle))
    drags = implausible_drags(fit.vehicle, fit.coefficients)
    return [
        *map(estimates.sentence, masses.values()),
        *(
            f"{name}: implausible, its drag coefficient is {drag:.2g} on the outline of the hull, and"
            f" {ESTIMATE_SETTINGS.largest_drag:g} is the most that vehicles have; a thrust that is too"
            f" large may appear as drag"
            for name, drag in drags.items()
        ),
    ]


def _joint_remarks(choice: Choice) -> list[str]:
    """Whether the joint estimate converged, and what it predicts beside the stages."""
    polished, lines = choice.polished, []
    if not (polished.converged or polished.interrupted):
        lines.append(
            f"The joint estimate stopped after {polished.rounds} rounds before it had converged: raise rounds"
            " under [polish]; if that does not help, the data cannot determine all free values"
        )
    return [*lines, choice.sentence()]
